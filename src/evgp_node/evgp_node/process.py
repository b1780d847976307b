"""A node as a process: runs until it is told to end, and says in one sentence why it cannot."""

from __future__ import annotations

from collections.abc import Callable
import signal
import socket
import sys
import threading
from typing import Protocol

from evgp_node.output import unwaiting_output
import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

SWITCH_INTERVAL = 0.0002
"""How long one thread keeps the interpreter from another that wants it, seconds. With Python's
usual 5 ms, a stop waits for as long while another thread makes a message."""

OnFailure = Callable[[BaseException], None]

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""What ends a node in good order: also a terminal that is closed."""


class ClosableNode(Protocol):
    """
    A node with threads of its own.

    :ivar beside: nodes of the same process, each with an executor of its own.
    """

    beside: tuple[Node, ...]

    def close(self) -> None:
        """End them and leave everything in its safe state; ROS still works meanwhile."""

    def destroy_node(self) -> None:
        """As `rclpy.node.Node` has it."""


class NodeFailedError(RuntimeError):
    """Something that must not fail did, while the node was running."""


def run_node(
    name: str,
    make_node: Callable[[OnFailure], ClosableNode],
    refusals: tuple[type[Exception], ...],
    args: list[str] | None = None,
) -> int:
    """
    Run a node until a signal of `ENDING`, then `close` it.

    :param name: stands before the sentence on stderr that says what is wrong.
    :param make_node: makes the node; what it is given is called, in any thread, when the node
        cannot go on.
    :param refusals: what `make_node` raises when a setting is wrong.
    :return: 0 after an orderly end, 2 if a setting is wrong.
    :raises NodeFailedError: after the node was closed, because it could not go on.
    """
    sys.setswitchinterval(SWITCH_INTERVAL)
    # Any thread may be the one that the kernel interrupts with a signal, and only the main one
    # runs Python's handlers. So it waits for a byte, which whoever is interrupted writes.
    ending, end = socket.socketpair()
    with ending, end:
        end.setblocking(False)
        signal.set_wakeup_fd(end.fileno(), warn_on_full_buffer=False)
        for number in ENDING:
            signal.signal(number, lambda *_: None)
        # Ctrl-Z would leave the karts with what they were sent last.
        signal.signal(signal.SIGTSTP, signal.SIG_IGN)
        try:
            with unwaiting_output():
                return _run(name, make_node, refusals, args, ending, end)
        finally:
            signal.set_wakeup_fd(-1)


def _run(
    name: str,
    make_node: Callable[[OnFailure], ClosableNode],
    refusals: tuple[type[Exception], ...],
    args: list[str] | None,
    ending: socket.socket,
    end: socket.socket,
) -> int:
    failures: list[BaseException] = []

    def fail(error: BaseException) -> None:
        failures.append(error)
        end.send(b'\0')

    program, *given = sys.argv if args is None else args
    # A log file on a disk that hangs would hold up everything, as `unwaiting_output` says. Whoever
    # wants it says --enable-external-lib-logs.
    own = ['--ros-args', '--disable-external-lib-logs', '--']
    try:
        rclpy.init(
            args=[program, *own, *given], signal_handler_options=rclpy.SignalHandlerOptions.NO
        )
        node = make_node(fail)
    except UnknownROSArgsError as error:
        print(f'{name}: unknown ROS arguments: {error}', file=sys.stderr)
        return 2
    except (RCLError, *refusals) as error:
        print(f'{name}: {error}', file=sys.stderr)
        rclpy.try_shutdown()
        return 2

    def spin(executor: Executor) -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            end.send(b'\0')
        except BaseException as error:  # noqa: BLE001 - raised again by the main thread
            fail(error)

    spinning = []
    for each in (node, *node.beside):
        executor = SingleThreadedExecutor()
        executor.add_node(each)
        thread = threading.Thread(target=spin, args=(executor,), name='executor', daemon=True)
        thread.start()
        spinning.append((executor, thread, each))
    ending.recv(1)
    node.close()
    for executor, thread, each in spinning:
        executor.shutdown()
        thread.join()
        each.destroy_node()
    rclpy.try_shutdown()
    if failures:
        raise NodeFailedError(f'{name} could not go on') from failures[0]
    return 0
