"""A bridge and a stack with a fault of the kind that programmers make, to be run as processes."""

from __future__ import annotations

import pathlib
import sys
import threading
from typing import Any

from evgp_kart_bridge.example_stack import ExampleStack
from evgp_kart_bridge.node import KartBridge
from evgp_node.process import run_node
from nav_msgs.msg import Odometry

FAULT_SPEED = 2.0
"""The fault shows above this speed, in m/s."""


class BridgeThatRaises(KartBridge):
    """Raises in its executor."""

    def _odometry(self, message: Odometry) -> None:
        if message.twist.twist.linear.x > FAULT_SPEED:
            raise LookupError('the fault')
        super()._odometry(message)


class BridgeThatHangs(KartBridge):
    """Keeps its executor busy for ever; its link goes on."""

    def _odometry(self, message: Odometry) -> None:
        if message.twist.twist.linear.x > FAULT_SPEED:
            threading.Event().wait()
        super()._odometry(message)


class StackThatRaises(ExampleStack):
    """Raises in its executor."""

    def _acknowledge(self, state: Any) -> None:
        if self._speed > FAULT_SPEED:
            raise LookupError('the fault')
        super()._acknowledge(state)


def program_of(node: type, folder: pathlib.Path) -> str:
    """Return the path of a program that runs one of these nodes."""
    path = folder / node.__name__
    path.write_text(
        f'#!{sys.executable}\n'
        'import sys\n'
        f'sys.path.insert(0, {str(pathlib.Path(__file__).parents[1])!r})\n'
        f'from race_parts.faulty_nodes import run, {node.__name__}\n'
        f'sys.exit(run({node.__name__}))\n',
        encoding='utf-8',
    )
    path.chmod(0o755)
    return str(path)


def run(node: Any) -> int:
    """Run a node as its own program does."""
    return run_node(node.__name__, node, ())
