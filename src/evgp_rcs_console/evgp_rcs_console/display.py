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

"""What the window shows of the race: what is heard, and what time makes of it."""

from __future__ import annotations

from collections import deque

from evgp_protocol import clock
from evgp_rcs_console import words
from evgp_rcs_console.alarm import Alarm
from evgp_rcs_console.areas import Areas
from evgp_rcs_console.bottom_line import BottomLine
from evgp_rcs_console.chosen import ChosenKart
from evgp_rcs_console.commands import Order
from evgp_rcs_console.inbox import Heard
from evgp_rcs_console.qt import QtCore
from evgp_rcs_console.sight import Sight
from evgp_rcs_console.snapshot import Answer, Event, Race
from evgp_rcs_console.standing import Standing
from evgp_rcs_console.unanswered import Unanswered
from evgp_rcs_console.view import (
    Cell,
    Danger,
    danger,
    KILL_NOTES,
    NOTHING,
    ReasonTimes,
    Screen,
    show,
    silence,
    Tone,
)

AGES = 1.0
"""Time after which the ages on the screen are brought up to date, in seconds."""


class Display(QtCore.QObject):
    """
    Has every area show the newest snapshot of the race.

    :param looking: where race control is looked for, as a sentence says it.
    """

    def __init__(
        self,
        areas: Areas,
        sight: Sight,
        chosen: ChosenKart,
        alarm: Alarm,
        bottom: BottomLine,
        unanswered: Unanswered,
        looking: str,
    ) -> None:
        """Begin with no race heard."""
        super().__init__(areas.window)  # of the Qt thread: what is heard is queued for it
        self._areas = areas
        self._sight = sight
        self._chosen = chosen
        self._alarm = alarm
        self._bottom = bottom
        self._unanswered = unanswered
        self._looking = looking
        self._began = clock.now()
        self._race: Race | None = None
        self._two = False
        self._heard_at = 0.0
        self._shown_at = 0.0
        self._danger_title = ''
        self._reasons = ReasonTimes()

    # ----- what is heard ------------------------------------------------------------------

    def take_races(self, waiting: deque[Heard]) -> None:
        """Take the snapshots that wait, none of their alerts left out, and show the newest."""
        if not waiting:
            return
        while waiting:
            self._race, self._heard_at, self._two = waiting.popleft()
            self._alarm.take_race(self._race, self._two)
            self._bottom.take_race(self._race, self._heard_at)
        self.refresh()

    def take_event(self, event: Event) -> None:
        """Show an event."""
        self._areas.events.add(event)

    def take_answer(self, order: Order, answer: Answer) -> None:
        """Show the answer to a command."""
        self._unanswered.answered(order)
        self._bottom.say_answer(order, answer)
        self.refresh()

    def take_pressing(self, stops: tuple[Standing, ...]) -> None:
        """Show the stops that race control has not accepted yet."""
        self._unanswered.stops = stops
        self._show_kill()
        self._bottom.show()

    # ----- what is shown ------------------------------------------------------------------

    def look(self, now: float) -> None:
        """Show what has changed because time (s) has passed, and sound if there is a reason."""
        danger_now = self._danger(now)
        title = danger_now.title if danger_now else ''
        old = now - self._shown_at >= AGES
        if title or title != self._danger_title or self._unanswered or old:
            self.refresh()
        self._show_kill()
        if self._unanswered.stops:
            self._bottom.show()
        self._alarm.look(now, alarming=danger_now is not None and self._race is not None)

    def refresh(self) -> None:
        """Show the newest snapshot as it is now."""
        now = clock.now()
        self._shown_at = now
        danger_now = self._danger(now)
        title = danger_now.title if danger_now else ''
        if title != self._danger_title:
            self._danger_title = title
            self._alarm.sound_soon()
        race = self._race or NOTHING
        reasons = self._reasons.update(race.commands, now)
        ages = self._unanswered.ages(now)
        screen = show(race, now - self._heard_at, ages, danger_now, reasons)
        self._see(screen, now)
        self._areas.show_banner(screen.banner)
        self._areas.danger.setVisible(danger_now is not None)
        self._areas.now.setVisible(danger_now is None)
        if danger_now is not None:
            self._areas.danger.show_danger(danger_now)
        stale = danger_now is not None and danger_now.stale
        self._areas.now.show_screen(screen, stale)
        self._areas.side.show_screen(screen)
        self._areas.heats.show_heats(screen.heats)
        self._chosen.show(screen.rows, stale)
        self._areas.events.show_karts(screen.rows)
        self._alarm.show(known=not stale)
        asked = self._areas.question.button
        if self._areas.question.isVisible() and asked is not None:
            self._areas.question.update_button(screen.button(asked.command, asked.kart))
        self._show_kill()
        self._bottom.show()

    def _see(self, screen: Screen, now: float) -> None:
        """Keep what the official saw until now; close the choice of heats if they have changed."""
        before = self._sight.screen
        heats_changed = (
            self._areas.heats.isVisible()
            and before is not None
            and _heats(before) != _heats(screen)
        )
        # A click on its way to the sheet must not hit what is below it.
        self._sight.change_to(screen, now, moving=heats_changed)
        if heats_changed:
            self._areas.heats.close_sheet()
            self._bottom.say(words.HEATS_CHANGED, Tone.BAD)

    def _danger(self, now: float) -> Danger | None:
        race = self._race or NOTHING
        silent_for = now - self._heard_at if self._race is not None else None
        looking_for = now - self._began
        said = silence(silent_for, looking_for, self._looking, race.state, KILL_NOTES)
        return said or danger(race, self._two)

    def _show_kill(self) -> None:
        now = clock.now()
        stop = self._unanswered.all_kill(now)
        if stop is not None:
            age = clock.duration(now - stop.since)
            hint = Cell(words.KILL_UNANSWERED.format(count=stop.presses, age=age), Tone.BAD)
        elif self._areas.window.isActiveWindow():
            hint = Cell(words.KILL_HINT)
        else:
            hint = Cell(words.KEYS_OFF, Tone.BAD)
        self._areas.kill.show_hint(hint, pressing=stop is not None)


def _heats(screen: Screen) -> list[tuple[str, tuple[int, ...]]]:
    """Return the heats that a screen offers."""
    return [(button.heat, button.karts) for button in screen.heats]
