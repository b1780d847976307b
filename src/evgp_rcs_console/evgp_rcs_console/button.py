# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The stop button as a process: `rcs_button`, on an official's machine, without a screen.

It gives one command, ALL KILL, as the window does. One thread reads the device and says that it is
there, by way of the thread that sends stops: if either hangs, race control no longer hears that.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
from dataclasses import dataclass
import math
import os
import sys
import threading
from typing import Any

from evgp_node.graph import where_reachable
from evgp_node.parameters import ParameterError, Parameters, StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_protocol.clock import now
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs_console import texts
from evgp_rcs_console.button_devices import (
    attend,
    BUTTON_LOOK,
    Keys,
    stable_paths,
    why,
)
from evgp_rcs_console.client import Client, THERE_EVERY
from evgp_rcs_console.commands import Given
from evgp_rcs_console.ctl_ros import Hearing
from evgp_rcs_console.presses import Presses
from evgp_rcs_console.settings import Signature

ACCEPTED_WITHIN = 1.0
"""Maximum time until race control has accepted ALL KILL, in seconds; then officials are told."""


DROPPED_FOR = 5.0
"""Time for which the button says that it dropped a press, in seconds. Meanwhile it does not count
as one that works. So it is shorter than ``nobody_there`` usually is: after that, race control
would stop the new race."""


@dataclass(frozen=True)
class ButtonSettings:
    """The parameters; `read_settings` says what they mean."""

    device: str
    key: int
    official: str


class StopButton(StrictNode):
    """
    The node of one button.

    :param on_failure: is called, in another thread, when the node cannot go on.
    :raises ParameterError: if a parameter is wrong.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        """Read the parameters and begin to open the device."""
        super().__init__('rcs_button', **node_options)
        self._settings = read_settings(Parameters(self))
        self._signature = Signature(self._settings.official, os.getpid())
        self._presses = Presses(self._settings.key)
        self._said = ('?', 0)
        self._due = 0.0
        self._heard = Hearing()
        self._given: Given | None = None
        self._since = 0.0
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
        self.get_logger().info(where_reachable())
        self._ending = threading.Event()
        self._on_failure = on_failure
        self._thread = threading.Thread(target=self._run, name='device', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Let go of the device, and say so."""
        self._ending.set()
        self._thread.join()
        self._say(texts.BUTTON_ENDED, now())
        self._client.close()

    # ----- in the thread of the device ----------------------------------------------------

    def _run(self) -> None:
        settings, ending = self._settings, self._ending
        try:
            attend(settings.device, self._presses, self._kill, self._look, ending)
        except BaseException as error:  # noqa: BLE001 - handed on
            self._on_failure(error)

    def _kill(self) -> None:
        at = now()
        self._since = at if self._is_accepted() else self._since
        self._given = Given(CommandKind.ALL_KILL, official=self._signature.claim, at=at)
        self._client.give(self._given)  # what there is to say of it comes after it

    def _is_accepted(self) -> bool:
        """Return whether race control has accepted the last press."""
        answer = self._heard.answer
        return self._given is None or (answer is not None and answer[0] is self._given)

    def _take_dropped(self, at: float) -> None:
        """Take that the last press is not sent any more; a button that is held is a new one."""
        dropped = self._heard.dropped
        if dropped is None or dropped[0] is not self._given:
            return
        age = round(at - dropped[0].at)
        self._given = None
        self._dropped, self._dropped_at = texts.BUTTON_DROPPED.format(age=age), at
        if self._presses.is_down:
            self._kill()

    def _look(self, trouble: str) -> None:
        """Say that this button is there, and why it cannot stop the race, if it cannot."""
        at = now()
        self._take_dropped(at)
        if at - self._dropped_at < DROPPED_FOR:
            trouble = trouble or self._dropped
        elif not self._is_accepted() and at - self._since >= ACCEPTED_WITHIN:
            trouble = trouble or texts.BUTTON_UNANSWERED
        elif not self._client.wait_for(CommandKind.ALL_KILL, 0.0):
            trouble = trouble or texts.BUTTON_FINDS_NOBODY
        self._say(trouble, at)

    def _say(self, fault: str, at: float) -> None:
        """Publish that this button is there, if that is due or something is new."""
        said = fault, self._presses.count
        if said == self._said and at < self._due:
            return
        if fault and fault != self._said[0]:
            self.get_logger().warning(fault)
        elif fault != self._said[0]:
            self.get_logger().info(texts.BUTTON_WORKS)
        self._said, self._due = said, at + THERE_EVERY
        self._client.say_there(self._signature.name, fault, self._presses.count)


def read_settings(parameters: Parameters) -> ButtonSettings:
    """
    Declare every parameter of the node.

    :raises ParameterError: if a parameter is wrong.
    """
    declare = parameters.declare
    settings = ButtonSettings(
        device=declare('device', '', 'Path of the device, by a name that stays the same.'),
        key=declare('key', 0, 'Code of the only key that is a press; 0: every key.', (0, 767)),
        official=declare('official', '', 'Who sits there; empty: the name that is kept.'),
    )
    parameters.refuse_unknown()
    if not settings.device.startswith('/'):
        raise ParameterError(
            'parameter device: give a path, as /dev/input/by-id/...; rcs_button test shows all'
        )
    return settings


def show(paths: Sequence[str]) -> int:
    """
    Print which devices there are, and each press of one, until Ctrl-C; nothing is sent.

    :param paths: the only devices to look at; none: every input device.
    :return: 0 after Ctrl-C; 1 if none of them can be read any more.
    """
    watched: dict[str, tuple[Keys, Presses]] = {}
    with contextlib.ExitStack() as stack, contextlib.suppress(KeyboardInterrupt):
        for path in paths or stable_paths():
            try:
                device = Keys(path)
                stack.callback(device.close)
                device.grab(False)  # whoever looks may have no other keyboard
                print(texts.BUTTON_KEYS.format(path=path, name=device.name))
                watched[path] = device, Presses()
            except OSError as error:
                print(f'{path}: {why(error)}')
        print(texts.BUTTON_TRY if watched else texts.BUTTON_NONE, flush=True)
        while watched:
            for path, (device, presses) in list(watched.items()):
                try:
                    for change in device.changes(BUTTON_LOOK / len(watched)):
                        if change is not None and presses.take(*change, now()):
                            said = texts.BUTTON_PRESSED.format(path=path, key=change[0])
                            print(said, flush=True)
                except OSError as error:
                    print(f'{path}: {why(error)}', flush=True)
                    del watched[path]
    return 0 if watched else 1


def main(args: list[str] | None = None) -> int:
    """
    Run the node until SIGINT or SIGTERM, or with `test` show which devices there are.

    :return: 0 after an orderly end, 1 after a failure, 2 if a setting is wrong.
    """
    given = sys.argv if args is None else args
    if given[1:2] == ['test']:
        return show(given[2:])
    return run_node('rcs_button', StopButton, (ParameterError,), given)


if __name__ == '__main__':
    sys.exit(main())
