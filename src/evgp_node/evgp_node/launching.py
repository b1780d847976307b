# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Decides for launch files when not to restart a node, which `launch` does whatever its exit code.

Only launch files import this module, because the package `launch` exists only in ROS.
"""

from __future__ import annotations

from collections.abc import Callable
import time

from evgp_node.restarting import Ends
from launch import Action, LaunchContext
from launch.actions import EmitEvent
from launch.events import matches_action
from launch.events.process import ProcessExited, ShutdownProcess

OnExit = Callable[[ProcessExited, LaunchContext], list[EmitEvent] | None]


def keep_trying_if_it_was_up(*beside: Action) -> OnExit:
    """
    Return an `on_exit` that stops restarting a node once its end is final (`Ends`).

    :param beside: nodes that must then end together with this one.
    """
    ends = Ends(time.monotonic())

    def give_up_if_final(event: ProcessExited, context: LaunchContext) -> list[EmitEvent] | None:
        if not ends.is_final(event.returncode, time.monotonic()):
            return None
        return [
            EmitEvent(event=ShutdownProcess(process_matcher=matches_action(each)))
            for each in (event.action, *beside)
        ]

    return give_up_if_final
