"""A node as a process: runs until it is told to end, and says in one sentence why it cannot."""

from __future__ import annotations

from collections.abc import Callable
import signal
import sys
import threading
from typing import Protocol

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.executors import Executor, ExternalShutdownException

OnFailure = Callable[[BaseException], None]


class ClosableNode(Protocol):
    """A node with threads of its own."""

    def close(self) -> None:
        """End them and leave everything in its safe state; ROS still works meanwhile."""

    def destroy_node(self) -> None:
        """As `rclpy.node.Node` has it."""


class NodeFailedError(RuntimeError):
    """Something that must not fail did, while the node was running."""


def run_node(
    name: str,
    make_node: Callable[[OnFailure], ClosableNode],
    make_executor: Callable[[], Executor],
    refusals: tuple[type[Exception], ...],
    args: list[str] | None = None,
) -> int:
    """
    Run a node until SIGINT or SIGTERM, then `close` it.

    :param name: stands before the sentence on stderr that says what is wrong.
    :param make_node: makes the node; what it is given is called,
        in any thread, when the node cannot go on.
    :param refusals: what `make_node` raises when a setting is wrong.
    :return: 0 after an orderly end, 2 if a setting is wrong.
    :raises NodeFailedError: after the node was closed, because it could not go on.
    """
    ending = threading.Event()
    failures: list[BaseException] = []

    def fail(error: BaseException) -> None:
        failures.append(error)
        ending.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.set())
    try:
        rclpy.init(args=args, signal_handler_options=rclpy.SignalHandlerOptions.NO)
        node = make_node(fail)
    except (RCLError, *refusals) as error:
        print(f'{name}: {error}', file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    executor = make_executor()
    executor.add_node(node)

    def spin() -> None:
        # Not in the main thread: Python runs signal handlers only there, and only when it is free.
        try:
            executor.spin()
        except ExternalShutdownException:
            ending.set()
        except BaseException as error:  # noqa: BLE001 - raised again by the main thread
            fail(error)

    spinning = threading.Thread(target=spin, name='executor', daemon=True)
    spinning.start()
    ending.wait()
    node.close()
    executor.shutdown()
    spinning.join()
    node.destroy_node()
    rclpy.try_shutdown()
    if failures:
        raise NodeFailedError(f'{name} could not go on') from failures[0]
    return 0
