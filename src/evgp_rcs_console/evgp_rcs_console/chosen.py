# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The kart that a command by key acts on: in its field, and marked in the list of karts."""

from __future__ import annotations

from evgp_rcs_console.karts import KartList
from evgp_rcs_console.keys import KartField
from evgp_rcs_console.view import Row
from evgp_rcs_console.widgets import NumberField


class ChosenKart:
    """
    Keeps the field and the list showing the same kart.

    :param field: the field below ALL KILL.
    :param karts: the list.
    """

    def __init__(self, field: NumberField, karts: KartList) -> None:
        """Choose none."""
        self._field = KartField()
        self._shown_in = field
        self._karts = karts
        self._rows: tuple[Row, ...] = ()
        self._stale = False
        self._marked = 0

    @property
    def kart(self) -> int:
        """Return the kart that a command acts on now; 0: none."""
        return self._field.kart

    @property
    def digits(self) -> str:
        """Return what is typed."""
        return self._field.digits

    def show(self, rows: tuple[Row, ...], stale: bool) -> None:
        """Show the karts that there are, and mark the chosen one."""
        self._rows, self._stale = rows, stale
        self._field.show_roster({row.number: row.team for row in rows})
        self._shown_in.show_cells(*self._field.cells())
        self._mark()

    def choose(self, number: int) -> None:
        """Choose a kart, and scroll to it."""
        self._field.choose(number)
        self._follow()

    def choose_in_sight(self, number: int) -> None:
        """Choose a kart whose row was clicked: nothing moves under the official's hand."""
        self._field.choose(number)
        self._follow(scroll=False)

    def choose_next(self, step: int) -> None:
        """Choose the kart some rows below (negative: above) the chosen one, or the first."""
        numbers = self._karts.numbers
        if numbers:
            place = numbers.index(self.kart) + step if self.kart else 0
            self.choose(numbers[max(0, min(place, len(numbers) - 1))])

    def type_digit(self, digit: str, at: float) -> None:
        """Take a digit that was typed at a time (s)."""
        self._field.add(digit, at)
        self._follow()

    def erase(self, at: float) -> None:
        """Delete the last digit."""
        self._field.erase(at)
        self._follow()

    def clear(self) -> None:
        """Clear what is typed; a kart that was chosen in the list stays."""
        self._field.clear()
        self._follow()

    def expire(self, now: float) -> None:
        """Clear what is too old at a time (s)."""
        self._field.expire(now)
        self._follow()

    def take(self, command: str, at: float) -> tuple[int, str]:
        """Return the kart for a command by key at a time (s), or 0 and why there is none."""
        taken = self._field.take(command, at)
        self._follow()
        return taken

    def _follow(self, scroll: bool = True) -> None:
        self._shown_in.show_cells(*self._field.cells())
        if self.kart != self._marked:
            self._mark()
            if scroll:
                self._karts.bring_into_view(self._marked)

    def _mark(self) -> None:
        self._marked = self.kart
        self._karts.show_rows(self._rows, self._marked, self._stale)
