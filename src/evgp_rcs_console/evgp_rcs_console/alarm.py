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

"""The alerts that the official has to see, and the sound that comes until they are seen."""

from __future__ import annotations

from evgp_rcs_console.alerts import AlertsArea
from evgp_rcs_console.notices import AlertBook
from evgp_rcs_console.snapshot import Race
from evgp_rcs_console.sound import Sound

SOUND_AGAIN = 4.0
"""Time between two sounds while an alert is not seen, in seconds."""


class Alarm:
    """
    Shows the alerts, and sounds.

    :param area: where the alerts are shown.
    """

    def __init__(self, area: AlertsArea) -> None:
        """Begin with no alert, and with the sound on."""
        self._area = area
        self._book = AlertBook()
        self._known = False
        self._sound = Sound()
        self._muted = False
        self._sounded_at = 0.0
        area.show_sound(muted=False)

    def take_race(self, race: Race, two: bool) -> None:
        """Take the alerts of a snapshot; a new one sounds soon."""
        if self._book.update(race.alerts, two):
            self.sound_soon()

    def show(self, known: bool) -> None:
        """
        Show the alerts.

        :param known: race control is heard; if it is not, it may have alerts of which we do not
            know.
        """
        self._known = known
        self._area.show_notices(self._book.shown, known=known)

    def see(self, number: int) -> None:
        """Mark an alert as seen."""
        self._book.see(number)
        self._area.show_notices(self._book.shown, own=True, known=self._known)

    def see_all(self) -> None:
        """Mark every alert as seen."""
        self._book.see_all()
        self._area.show_notices(self._book.shown, own=True, known=self._known)

    def toggle_sound(self) -> None:
        """Turn the sound off or on."""
        self._muted = not self._muted
        self.sound_soon()
        self._area.show_sound(self._muted)

    def sound_soon(self) -> None:
        """Sound at the next look, if there is a reason to."""
        self._sounded_at = 0.0

    def look(self, now: float, alarming: bool) -> None:
        """
        Sound if it is time.

        :param now: the time, in seconds.
        :param alarming: race control is gone or must not be relied on.
        """
        due = now - self._sounded_at >= SOUND_AGAIN
        if due and (alarming or self._book.unseen) and not self._muted:
            self._sounded_at = now
            self._sound.play()

    def sound_now(self) -> None:
        """Sound once: a stop was not sent."""
        if not self._muted:
            self._sound.play()

    def close(self) -> None:
        """Tidy up."""
        self._sound.close()
