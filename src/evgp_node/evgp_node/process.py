# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Runs a node as a process until a signal ends it.

If the node cannot start because of a setting or an obstacle, one sentence on stderr says why.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import contextlib
import gc
import os
import re
import signal
import socket
import sys
import traceback

from evgp_node.deadline import end_within
from evgp_node.graph import bind_graph, GraphError, NotNowError, where_reachable
from evgp_node.output import open_closed_streams, unwaiting_output
from evgp_node.parameter_files import unreadable
from evgp_node.parameters import ParameterError, StrictNode
from evgp_node.rclpy_private import RCLError, UnknownROSArgsError
from evgp_node.restarting import ENDING, IN_THE_WAY, WRONG_SETTING
from evgp_node.spinning import Spinning
import rclpy
from rclpy.duration import Duration
from rclpy.publisher import Publisher

SWITCH_INTERVAL = 0.0002
"""Time after which a thread yields the interpreter to another, in seconds. With Python's default
of 5 ms, a stop would wait that long while another thread builds a message."""

LOOK_INTERVAL = 1.0
"""Time between two signs of life of the main thread, in seconds."""

HANGS = 10.0
"""Time without signs of life after which the process ends with exit code 1, in seconds. Something
such as DDS is then holding the interpreter's lock, and only a restart helps."""

CLOSE_TIMEOUT = 8.0
"""Maximum time for a node to close, in seconds. After that, the process ends with exit code 1, and
karts stop because their connections are gone."""

LAST_WORD = 0.5
"""Maximum time for subscribers to receive a publisher's last messages, in seconds."""

TEARDOWN_TIMEOUT = 2.0
"""Maximum time for shutting ROS down after the node has closed, in seconds. After that, the
process ends with its exit code anyway."""

OnFailure = Callable[[BaseException], None]


def run_node(
    name: str,
    make_node: Callable[[OnFailure], StrictNode],
    args: list[str] | None = None,
    refusals: tuple[type[Exception], ...] = (),
    obstacles: tuple[type[Exception], ...] = (),
    always_here: bool = False,
) -> int:
    """
    Run a node until a signal of `ENDING`, and then `close` it. After that, the process must end.

    Ending takes at most `CLOSE_TIMEOUT` plus `TEARDOWN_TIMEOUT`, even if DDS holds the
    interpreter's lock.

    :param name: name of the program, with which each error message on stderr begins.
    :param make_node: a function that creates the node. Its argument is a function for the node to
        call, in any thread, when it cannot go on.
    :param refusals: exceptions that mean, like `ParameterError`, that a setting is wrong;
        `make_node` raises them, or the node reports them later.
    :param obstacles: exceptions that `make_node` raises if something is in the way for now.
    :param always_here: as for ``graph.bind_graph``.
    :return: 0 after an orderly end, 1 if the node could not go on (a traceback on stderr says
        why), `WRONG_SETTING` or `IN_THE_WAY`.
    """
    open_closed_streams()
    sys.setswitchinterval(SWITCH_INTERVAL)
    # A signal may interrupt any thread, but only the main thread runs Python's handlers. It
    # therefore waits for a byte, which the interrupted thread writes.
    ending, end = socket.socketpair()
    end.setblocking(False)
    signal.set_wakeup_fd(end.fileno(), warn_on_full_buffer=False)
    for number in ENDING:
        signal.signal(number, lambda *_: None)
    # Ctrl-Z would leave karts in the state that they were sent last.
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    with unwaiting_output():
        code, take_down = _run(
            name, make_node, args, refusals, obstacles, always_here, ending, end
        )
    end_within(TEARDOWN_TIMEOUT, code)
    # Python removes its handlers before the process ends; a signal could then change its code.
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    take_down()
    return code


def join_graph(program: str, arguments: Sequence[str], *, always_here: bool = False) -> None:
    """
    Start ROS on loopback, or on the interface that is set. The program handles signals itself.

    :param arguments: the program's arguments, of which ROS reads those after ``--ros-args``.
    :param always_here: as for ``graph.bind_graph``.
    :raises GraphError: if no interface has the address that is set.
    """
    bind_graph(always_here=always_here)
    # Messages load numpy, whose threads, one for each processor, none of our programs needs.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    # A log file on a hanging disk would block everything, for the reason in `unwaiting_output`. On
    # a full disk, no program would start. The option --enable-external-lib-logs turns the file on.
    own = ['--ros-args', '--disable-external-lib-logs', '--']
    rclpy.init(
        args=[program, *own, *arguments], signal_handler_options=rclpy.SignalHandlerOptions.NO
    )


def wait_until_heard(*publishers: Publisher) -> None:
    """
    Wait until every reliable subscriber has received the messages of these publishers.

    Once a publisher is gone, it cannot repeat lost messages. If a subscriber no longer listens,
    this takes at most `LAST_WORD` for each publisher.
    """
    for publisher in publishers:
        publisher.wait_for_all_acked(Duration(seconds=LAST_WORD))


def _run(
    name: str,
    make_node: Callable[[OnFailure], StrictNode],
    args: list[str] | None,
    refusals: tuple[type[Exception], ...],
    obstacles: tuple[type[Exception], ...],
    always_here: bool,
    ending: socket.socket,
    end: socket.socket,
) -> tuple[int, Callable[[], object]]:
    """Run and close the node, and return the exit code and a function that shuts ROS down."""
    failures: list[BaseException] = []

    def fail(error: BaseException) -> None:
        failures.append(error)
        end.send(b'\0')

    program, *given = sys.argv if args is None else args
    try:
        for fault in unreadable(given):
            raise ParameterError(fault)
        join_graph(program, given, always_here=always_here)
        node = make_node(fail)
        node.get_logger().info(where_reachable())
    except (NotNowError, *obstacles) as error:
        print(f'{name}: {error}', file=sys.stderr)
        return IN_THE_WAY, rclpy.try_shutdown
    except (UnknownROSArgsError, RCLError, GraphError, ParameterError, *refusals) as error:
        unknown = 'unknown ROS arguments: ' if isinstance(error, UnknownROSArgsError) else ''
        said = re.sub(r'\s*, at \S+\.c:\d+', '', str(error))  # where in ROS's own code
        print(f'{name}: {unknown}{said}', file=sys.stderr)
        return WRONG_SETTING, rclpy.try_shutdown
    except BaseException:  # noqa: BLE001 - as an interpreter does at the end of a program
        traceback.print_exc()
        return 1, rclpy.try_shutdown
    end_within(HANGS, 1)
    spinning = [Spinning(each, fail) for each in (node, *node.beside)]
    # The node and ROS stay until the end, and garbage collection among them would block everything
    # for 20 ms.
    gc.collect()
    gc.freeze()
    ending.settimeout(LOOK_INTERVAL)
    told = b''
    while not told:
        with contextlib.suppress(TimeoutError):
            told = ending.recv(1)
        end_within(CLOSE_TIMEOUT if told else HANGS, 1)
    node.close()
    code = 0
    if failures and isinstance(failures[0], refusals):
        print(f'{name}: {failures[0]}', file=sys.stderr)
        code = WRONG_SETTING
    elif failures:
        print(f'{name} could not go on:', file=sys.stderr)
        traceback.print_exception(failures[0])
        code = 1

    def take_down() -> None:
        ended = [each.stop(TEARDOWN_TIMEOUT) for each in spinning]
        if all(ended):
            for each in (*node.beside, node):
                each.destroy_node()
            rclpy.try_shutdown()

    return code, take_down
