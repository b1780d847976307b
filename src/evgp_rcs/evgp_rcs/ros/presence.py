# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The programs from which officials can stop the race.

Each of these programs announces itself at least once a second. Race control counts a program if
the program's last message without a fault is younger than `SILENT_AFTER`. It reports a missing
stop button until someone starts another one in its place. It never counts the timekeeper, which
sends only FINISH and cannot stop a race.

This module is pure: messages and times are inputs. Any thread may call it.
"""

from __future__ import annotations

from dataclasses import dataclass
import threading
from typing import Protocol

from evgp_node.official import MOST_OF_NAME, tidy, TIMEKEEPER
from evgp_rcs.rules.race import Attendance

SILENT_AFTER = 2.0
"""Maximum silence of a program, in seconds. After that, race control considers it gone."""

MOST_PROGRAMS = 50
"""Maximum number of programs at once. Race control ignores further programs."""

MOST_OF_FAULT = 160
"""Maximum length of the stored text of a fault, in characters."""

MOST_NAMED = 4
"""Maximum number of programs named in one text."""

BUTTON = 'rcs_button'

LABELS = {'rcs_gui': 'window', 'rcs_ctl': 'terminal', BUTTON: 'button'}
"""The name that officials use for each program."""


class Word(Protocol):
    """A program's message; `Presence.msg` explains the fields."""

    program: str
    id: str  # noqa: A003 - the field's name
    official: str
    fault: str


@dataclass
class Program:
    """
    A program that has announced itself.

    :param name: the program's name for officials, with the official who uses it.
    :param began: when race control first heard the program, in seconds.
    :param worked: when race control last heard the program without a fault, in seconds.
    :param fault: why the race cannot be stopped from the program, as a sentence. Empty if it can.
    :param replaces: whether the program can still count as the replacement for a missing button.
    """

    name: str
    is_button: bool
    began: float
    heard: float
    worked: float = float('-inf')
    fault: str = ''
    replaces: bool = True

    def works(self, now: float) -> bool:
        """Return whether officials can stop the race from the program at this time (s)."""
        return now - self.worked < SILENT_AFTER

    def is_gone(self, now: float) -> bool:
        return now - self.heard >= SILENT_AFTER


class Presences:
    """The programs from which officials can stop the race, and the buttons that are missing."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._programs: dict[str, Program] = {}

    def hear(self, word: Word, now: float) -> bool:
        """
        Record a program's message, which may contain anything, at this time (s).

        :return: False if `MOST_PROGRAMS` other programs leave no room for this one; otherwise
            True.
        """
        if word.program == TIMEKEEPER:  # a person may sign a window or a button so
            return True
        key = tidy(word.id)
        with self._lock:
            program = self._programs.get(key)
            if program is None:
                self._forget(now)  # so that a window that is gone gives way, and not a button
                missed = (each for each, other in self._programs.items() if other.is_gone(now))
                if len(self._programs) >= MOST_PROGRAMS:
                    if (first := next(missed, None)) is None:
                        return False
                    del self._programs[first]
                program = Program('', word.program == BUTTON, now, now)
                self._programs[key] = program
            label = LABELS.get(word.program) or tidy(word.program, MOST_OF_NAME) or 'a program'
            official = tidy(word.official, MOST_OF_NAME)
            program.name = f'{official} ({label})' if official else label
            program.heard = now
            program.fault = tidy(word.fault, MOST_OF_FAULT)
            if not program.fault:
                program.worked = now
        return True

    def attendance(self, now: float) -> Attendance:
        """Return who can stop the race at this time (s)."""
        with self._lock:
            self._forget(now)
            programs = list(self._programs.values())
        able = [each for each in programs if each.works(now)]
        buttons = [each for each in programs if each.is_button]
        wrong = [
            f'{each.name}: {"race control does not hear it" if each.is_gone(now) else each.fault}'
            for each in buttons
            if each.is_gone(now) or each.fault
        ]
        return Attendance(len(able), _listed([each.name for each in able]), _listed(wrong))

    def _forget(self, now: float) -> None:
        """Forget programs that are gone, but a button only once another has replaced it."""
        gone = [(key, each) for key, each in self._programs.items() if each.is_gone(now)]
        for key, each in gone:
            if each.is_button:
                buttons = (one for one in self._programs.values() if one.is_button)
                new = (one for one in buttons if one.began > each.heard and one.replaces)
                if (other := next(new, None)) is None:
                    continue
                other.replaces = False
            del self._programs[key]


def _listed(names: list[str]) -> str:
    shown = sorted(names)[:MOST_NAMED]
    more = len(names) - len(shown)
    return ', '.join([*shown, f'{more} more'] if more else shown)
