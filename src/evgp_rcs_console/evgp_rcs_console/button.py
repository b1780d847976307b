# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The stop button as a process: `rcs_button`, on an official's machine, without a screen.

It sends one command, ALL KILL, as the window does. One thread reads the device and announces the
button through the thread that sends stops. If either thread hangs, the announcements end.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import math
import os
import sys
import threading
from typing import Any

from evgp_node.parameters import ParameterError, StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_protocol.clock import now
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs_console.button_devices import (
    attend,
    BUTTON_LOOK,
    Keys,
    stable_paths,
    why,
)
from evgp_rcs_console.client import Client, PRESENCE_PERIOD
from evgp_rcs_console.commands import Given
from evgp_rcs_console.ctl_ros import Hearing
from evgp_rcs_console.presses import PressCounter
from evgp_rcs_console.settings import Signature

ACCEPTED_WITHIN = 1.0
"""Time without an acceptance of ALL KILL after which the button reports a fault, in seconds."""

DROPPED_FOR = 5.0
"""Time for which the button reports a dropped press, in seconds. During this time, race control
does not count the button as working. It is shorter than the usual ``nobody_there``. Otherwise,
race control could stop the new race because no official could."""


class StopButton(StrictNode):
    """
    The node of one button.

    :param on_failure: called in another thread if the node cannot continue.
    :raises ParameterError: if a parameter is wrong.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        super().__init__('rcs_button', **node_options)
        self._device, key, official = read_settings(self)
        self._signature = Signature(official, os.getpid())
        self._presses = PressCounter(key)
        self._said = ('?', 0)
        self._due = 0.0
        self._heard = Hearing()
        self._given: Given | None = None
        self._dropped, self._dropped_at = '', -math.inf
        self._client = Client(
            'rcs_button_calls',
            self._heard,
            self.context,
            (CommandKind.ALL_KILL,),
            there='rcs_button',
            hears=False,
            namespace=self.get_namespace(),
            use_global_arguments=False,
        )
        self._ending = threading.Event()
        self._on_failure = on_failure
        self._thread = threading.Thread(target=self._run, name='device', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Release the device and announce the end."""
        self._ending.set()
        self._thread.join()
        self._say('The program has ended. Start it again', now())
        self._client.close()

    # ----- in the thread of the device ----------------------------------------------------

    def _run(self) -> None:
        try:
            attend(self._device, self._presses, self._kill, self._look, self._ending)
        except BaseException as error:  # noqa: BLE001 - handed on
            self._on_failure(error)

    def _kill(self) -> None:
        self._given = Given(CommandKind.ALL_KILL, official=self._signature.claim)
        self._client.give(self._given)  # send first, report afterwards

    def _take_dropped(self, at: float) -> None:
        """If the last press was dropped, report it; a button that is still held presses again."""
        dropped = self._heard.dropped
        if dropped is None or dropped[0] is not self._given:
            return
        self._given, self._dropped_at = None, at
        self._dropped = (
            f'The ALL KILL pressed {round(at - dropped[0].at)} s ago is no longer being sent, '
            'because another race has begun since then. Press again to stop that race'
        )
        if self._presses.is_down:
            self._kill()

    def _look(self, trouble: str) -> None:
        """Announce this button and, if it cannot stop the race, say why."""
        at = now()
        self._take_dropped(at)
        if at - self._dropped_at < DROPPED_FOR:
            trouble = trouble or self._dropped
        elif any(at - stop.since >= ACCEPTED_WITHIN for stop in self._heard.standing):
            trouble = trouble or 'Race control has not accepted ALL KILL yet. USE THE MSR'
        elif not self._client.wait_for(CommandKind.ALL_KILL, 0.0):
            trouble = trouble or 'Race control is not found, so a press does not stop the race'
        self._say(trouble, at)

    def _say(self, fault: str, at: float) -> None:
        """Publish the button's presence if it is due or has changed."""
        said = fault, self._presses.count
        if said == self._said and at < self._due:
            return
        if fault and fault != self._said[0]:
            self.get_logger().warning(f'{fault} ({self._device})')
        elif fault != self._said[0]:
            self.get_logger().info('A press sends ALL KILL')
        self._said, self._due = said, at + PRESENCE_PERIOD
        self._client.announce(self._signature.name, fault, self._presses.count)


def read_settings(node: StrictNode) -> tuple[str, int, str]:
    """
    Declare every parameter of the node, and return the device, the key and the official.

    :raises ParameterError: if a parameter is wrong.
    """
    declare = node.declare
    device = declare('device', '', 'Path of the device, by a name that never changes.')
    key = declare('key', 0, 'Code of the only key that sends ALL KILL; 0: every key.', (0, 767))
    official = declare('official', '', 'Official at the button; empty: the saved name.')
    node.refuse_unknown()
    if not device.startswith('/'):
        raise ParameterError(
            'parameter device: give a path such as /dev/input/by-id/...; rcs_button test lists all'
        )
    return device, key, official


def show(paths: Sequence[str]) -> int:
    """
    List the input devices and print each press until Ctrl-C. Nothing is sent.

    :param paths: the devices to list; empty: every input device.
    :return: 0 after Ctrl-C; 1 once none of them can be read.
    """
    watched: dict[str, tuple[Keys, PressCounter]] = {}
    with contextlib.ExitStack() as stack, contextlib.suppress(KeyboardInterrupt):
        for path in paths or stable_paths():
            try:
                device = Keys(path)
                stack.callback(device.close)
                device.grab(False)  # this may be the user's only keyboard
                print(f'{path}: {device.name}. As a stop button, each of its keys sends ALL KILL')
                watched[path] = device, PressCounter()
            except OSError as error:
                print(f'{path}: {why(error)}')
        none = 'No connected device can serve as a stop button. Plug one in'
        test = 'Press each button to test it. Nothing is sent. Ctrl-C ends the test'
        print(test if watched else none, flush=True)
        while watched:
            for path, (device, presses) in list(watched.items()):
                try:
                    for change in device.changes(BUTTON_LOOK / len(watched)):
                        if change is not None and presses.take(*change, now()):
                            print(f'{path}: PRESSED (key {change[0]}). ', end='')
                            print('While rcs_button runs, this sends ALL KILL', flush=True)
                except OSError as error:
                    print(f'{path}: {why(error)}', flush=True)
                    del watched[path]
    return 0 if watched else 1


def main(args: list[str] | None = None) -> int:
    """
    Run the node until SIGINT or SIGTERM; with `test`, list the input devices instead.

    :return: 0 after an orderly end, 1 after a failure, 2 if a setting is wrong.
    """
    given = sys.argv if args is None else args
    if given[1:2] == ['test']:
        return show(given[2:])
    return run_node('rcs_button', StopButton, given)


if __name__ == '__main__':
    sys.exit(main())
