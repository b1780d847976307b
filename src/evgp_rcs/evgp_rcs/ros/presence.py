# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Who is there to stop the race: the programs that say so at least once a second, by their ids.

A program counts while its last word without a fault is not older than `SILENT_AFTER`. A stop
button that is gone is reported for longer: until another is started in its place. The timekeeper
never counts: it gives FINISH, and cannot stop a race.

Pure: words and times go in, from any thread.
"""

from __future__ import annotations

from dataclasses import dataclass
import threading
from typing import Protocol

from evgp_node.official import MOST_OF_NAME, tidy, TIMEKEEPER
from evgp_rcs.rules.race import Attendance

SILENT_AFTER = 2.0
"""Time after its last word from which on a program counts as gone, in seconds."""

MOST_PROGRAMS = 50
"""Maximum number of programs that are heard at once; further ones are not."""

MOST_OF_FAULT = 160
"""Maximum length of what is kept of a fault, in characters."""

MOST_NAMED = 4
"""Maximum number of programs that are named at once."""

BUTTON = 'rcs_button'

LABELS = {'rcs_gui': 'window', 'rcs_ctl': 'terminal', BUTTON: 'button'}
"""What officials call each program."""


class Word(Protocol):
    """What a program says; the meanings are those of `Presence.msg`."""

    program: str
    id: str  # noqa: A003 - the field's name
    official: str
    fault: str


@dataclass
class Program:
    """
    A program that said that it is there.

    :param name: what officials call it, and whose it is.
    :param began: when it was heard first; ``heard``: last; ``worked``: last without a fault (s).
    :param replaces: it may have been started in place of one that is gone.
    """

    name: str
    is_button: bool
    began: float
    heard: float
    worked: float = float('-inf')
    fault: str = ''
    replaces: bool = True

    def works(self, now: float) -> bool:
        """Return whether officials can stop the race from it."""
        return now - self.worked < SILENT_AFTER

    def is_gone(self, now: float) -> bool:
        """Return whether nothing is heard of it any more."""
        return now - self.heard >= SILENT_AFTER


class Presences:
    """The programs that are there, or were and are missed."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._programs: dict[str, Program] = {}

    def hear(self, word: Word, now: float) -> bool:
        """
        Take what a program says, whatever is in it, at a time (s).

        :return: whether there is room for it; there is none if `MOST_PROGRAMS` others are there.
        """
        if TIMEKEEPER in (word.program, tidy(word.official)):
            return True
        key = tidy(word.id)
        with self._lock:
            program = self._programs.get(key)
            if program is None:
                self._forget(now)
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
        """Return who is there at this time (s)."""
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
        """Forget who is gone; of the buttons, those in whose place others were started."""
        gone = [(key, each) for key, each in self._programs.items() if each.is_gone(now)]
        for key, each in gone:
            others = self._programs.values()
            new = (one for one in others if one.is_button and one.began > each.heard)
            other = next((one for one in new if one.replaces), None)
            if each.is_button and other is None:
                continue
            if each.is_button and other is not None:
                other.replaces = False
            del self._programs[key]


def _listed(names: list[str]) -> str:
    shown = sorted(names)[:MOST_NAMED]
    more = len(names) - len(shown)
    return ', '.join([*shown, f'{more} more'] if more else shown)
