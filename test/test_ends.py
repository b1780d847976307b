# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The end of a node's process: without an error, and in time whatever DDS does."""

from __future__ import annotations

import contextlib
import os
import pathlib
import subprocess
import sys
import threading
import time

from evgp_node.process import CLOSE_TIMEOUT, TEARDOWN_TIMEOUT
from evgp_node.spinning import Spinning
from evgp_testing.domains import Domain
from evgp_testing.part import PATIENCE
from evgp_testing.ros_side import joined
import pytest
from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

ENDS = 100
"""With `executor.shutdown()` beside the spinning thread, 12 of 1,000 ends raised."""


def test_a_spinning_thread_that_is_stopped_amid_callbacks_ends_without_an_error(
    parts: contextlib.ExitStack,
) -> None:
    context = parts.enter_context(joined(parts.enter_context(Domain()).number))
    busy = Node('busy', context=context, use_global_arguments=False)
    parts.callback(busy.destroy_node)
    publisher = busy.create_publisher(Bool, '/busy', 10)
    client = busy.create_client(Trigger, '/called')
    over = threading.Event()

    def flood() -> None:
        while not over.wait(0.0003):
            publisher.publish(Bool())
            client.remove_pending_request(client.call_async(Trigger.Request()))

    flooding = threading.Thread(target=flood)
    flooding.start()
    parts.callback(flooding.join)
    parts.callback(over.set)
    failures: list[BaseException] = []

    for at in range(ENDS):
        node = Node('ending', context=context, use_global_arguments=False)
        node.create_service(Trigger, '/called', lambda _, response: response)
        node.create_subscription(Bool, '/busy', lambda _: None, 10)
        node.create_timer(0.0005, lambda: None)
        spinning = Spinning(node, failures.append)
        time.sleep(0.002 * (at % 7))  # the moment of the end differs
        assert spinning.stop(PATIENCE)
        node.destroy_node()

    assert not failures


PROGRAM = """
import ctypes, signal, sys, time
from evgp_node import process
from evgp_node.parameters import StrictNode
process.HANGS = 2.0

def hang():  # as DDS may: holding the interpreter's lock, whatever signals come
    signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    ctypes.PyDLL(None).sleep(60)

class Hanging(StrictNode):
    def __init__(self, on_failure):
        super().__init__('hanging')
        print('runs', flush=True)
        if 'running' in sys.argv:
            # Once the test has read what was printed: who hangs hands nothing on.
            self.create_timer(0.01, lambda: sys.stdin.readline() and hang())
        if 'fails' in sys.argv:
            on_failure(ArithmeticError('of its own'))

    def close(self):
        print('closed', flush=True)
        if 'close' in sys.argv:
            time.sleep(1)  # what was printed goes out
            hang()

    def destroy_node(self):
        if 'teardown' in sys.argv:
            hang()
        super().destroy_node()

sys.exit(process.run_node('hanging', Hanging))
"""


@pytest.mark.parametrize(
    ('where', 'code'),
    [
        (['teardown'], 0),
        (['close'], 1),
        (['running'], 1),
        (['fails', 'teardown'], 1),
    ],
)
def test_a_process_ends_in_time_and_with_its_exit_code_whatever_hangs_however_often_it_is_told(
    where: list[str], code: int, parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    program = tmp_path / 'hanging.py'
    program.write_text(PROGRAM)
    process = subprocess.Popen(
        [sys.executable, str(program), *where],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, 'ROS_DOMAIN_ID': str(parts.enter_context(Domain()).number)},
    )
    parts.enter_context(process)
    parts.callback(process.kill)
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    assert process.stdout.readline() == 'runs\n'
    process.stdin.write('\n')
    process.stdin.flush()
    began = time.monotonic()
    while process.poll() is None:
        # Less than it hangs. The exit code tells which time limit ended it.
        assert time.monotonic() - began < CLOSE_TIMEOUT + TEARDOWN_TIMEOUT + PATIENCE
        if 'running' not in where:
            process.terminate()  # also in its last moment
        time.sleep(0.001)

    printed, errors = process.stdout.read(), process.stderr.read()
    assert process.returncode == code, errors
    assert printed == ('' if 'running' in where else 'closed\n')
    assert ('ArithmeticError: of its own' in errors) == ('fails' in where)


LOGGING = """
import pathlib, sys
from evgp_node import process
from evgp_node.parameters import StrictNode

class Logging(StrictNode):
    def __init__(self, on_failure):
        super().__init__('logging')
        self._lines = 0
        self.create_timer(0.05, self._log)

    def _log(self):
        self.get_logger().info('a line')
        self._lines += 1
        if self._lines == 10:
            pathlib.Path(sys.argv[1]).touch()

sys.exit(process.run_node('logging', Logging))
"""


@pytest.mark.parametrize('kept', [[], ['-m', 'evgp_node.restarting', sys.executable]])
def test_a_node_without_standard_streams_goes_on_until_it_is_told_to_end(
    kept: list[str], parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    program, up = tmp_path / 'says.py', tmp_path / 'up'
    program.write_text(LOGGING)
    closed = ['sh', '-c', 'exec "$@" <&- >&- 2>&-', 'sh']
    process = subprocess.Popen(
        [*closed, sys.executable, *kept, str(program), str(up)],
        env={**os.environ, 'ROS_DOMAIN_ID': str(parts.enter_context(Domain()).number)},
    )
    parts.callback(process.wait)
    parts.callback(process.kill)
    until = time.monotonic() + PATIENCE
    while not up.exists():
        assert time.monotonic() < until
        time.sleep(0.01)
    assert process.poll() is None
    process.terminate()
    assert process.wait(PATIENCE) == 0
