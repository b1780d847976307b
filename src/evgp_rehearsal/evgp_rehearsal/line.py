# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The timing line of a field, which reports crossings as passings.

It recognises each kart, but misses or invents crossings as the field decides. This module is pure.
"""

from __future__ import annotations

from evgp_node.results import Passing
from evgp_rehearsal.field import Field


class TimingLine:
    """
    The timing line.

    :param session: a value that differs for each run.
    :ivar told: the identity and kart of every reported passing, and whether it really happened.
    """

    def __init__(self, session: str) -> None:
        self._session = session
        self._read = 0
        self.told: list[tuple[str, int, bool]] = []

    def read(self, field: Field, field_ns: int = 0) -> list[Passing]:
        """
        Return the new passings.

        :param field_ns: when the field began, in ns since the epoch of the line's clock.
        """
        read, self._read = self._read, len(field.crossings)
        new = field.crossings[read:]
        passings = []
        for at, kart, seen, real in new:
            if not seen:
                continue
            number, stamp = len(self.told) + 1, field_ns + round(at * 1e9)
            passing = Passing('line', self._session, number, kart, stamp_ns=stamp)
            passings.append(passing)
            self.told.append((str(passing.identity), kart, real))
        return passings
