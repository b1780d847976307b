# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Nodes with a fault of the kind that programmers make, to be run as processes."""

from __future__ import annotations

import pathlib
import sys
import threading
from typing import Any

from evgp_kart_bridge.example_stack import ExampleStack
from evgp_kart_bridge.node import KartBridge
from evgp_kart_bridge.orders import Order
from evgp_node.process import run_node
from evgp_rcs.ros.node import RcsNode
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Answer, Command
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

    def _acknowledge(self, order: Order) -> None:
        if self._speed > FAULT_SPEED:
            raise LookupError('the fault')
        super()._acknowledge(order)


class RaceControlThatTakesNoStops(RcsNode):
    """Keeps the thread that takes the stops busy for ever, from the first RED_FLAG on."""

    def _command(self, command: Command) -> Answer:
        if command.kind is CommandKind.RED_FLAG:
            threading.Event().wait()
        return super()._command(command)


def program_of(node: type, folder: pathlib.Path) -> str:
    """Return the path of a program that runs one of these nodes."""
    path = folder / node.__name__
    path.write_text(
        f'#!{sys.executable}\n'
        f'import sys; sys.path = {sys.path!r}\n'
        f'from rig.faulty_nodes import run, {node.__name__}\n'
        f'sys.exit(run({node.__name__}))\n',
        encoding='utf-8',
    )
    path.chmod(0o755)
    return str(path)


def run(node: Any) -> int:
    """Run a node as its own program does."""
    return run_node(node.__name__, node)
