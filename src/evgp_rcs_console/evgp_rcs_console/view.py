# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Turns a snapshot of the race into what screens show: text, tones and buttons.

This module contains none of the race's rules. A button is enabled if race control says that its
command is available; otherwise the button shows race control's own reason. The module is pure and
uses neither Qt nor ROS, so both the window and the terminal client can use it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import functools
import string

from evgp_node.results import Act, Standings, TIMING_GONE
from evgp_protocol.clock import duration
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import AlertKind, Availability, Event, EventKind, Heat
from evgp_rcs.rules.snapshot import KartSnapshot, NOTHING, Snapshot
from evgp_rcs.words import (
    Cell,
    clock,
    GONE_AFTER,
    headline,
    LINKS,
    milliseconds,
    numbered,
    STATE_CELLS,
    STATES,
    tally,
    time_of_day,
    Tone,
)
from evgp_rcs_console import results as timed
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import CATALOGUE, Kind, OF_RACE_CONTROL
from evgp_rcs_console.commands import Given, shows_result
from evgp_rcs_console.notices import Notice
from evgp_rcs_console.questions import Asked

NEXT: dict[RaceState | None, tuple[CommandKind, ...]] = {
    RaceState.IN_GARAGE: (CommandKind.GRID_ACTIVE,),
    RaceState.GRID_ACTIVE: (CommandKind.GREEN_GREEN,),
    RaceState.RED_FLAG: (CommandKind.IN_GARAGE, CommandKind.RACE_OVER),
    RaceState.RED_RED: (CommandKind.IN_GARAGE,),
}
"""The commands that usually come next in each state of the race, the likeliest first."""


def _placed(to_one_kart: bool) -> tuple[CommandKind, ...]:
    found = [kind for kind, entry in OF_RACE_CONTROL.items() if entry.place]
    found = [kind for kind in found if CATALOGUE[kind].to_one_kart is to_one_kart]
    return tuple(sorted(found, key=lambda kind: CATALOGUE[kind].place))


RACE_COMMANDS = _placed(to_one_kart=False)
"""The commands to the race, in the order in which a race needs them (§4.B)."""

KART_COMMANDS = _placed(to_one_kart=True)
"""The commands in a kart's row. While one is in effect, its button offers to undo that command."""

UNDONE_BY = {
    entry.undoes: kind for kind, entry in OF_RACE_CONTROL.items() if entry.undoes is not None
}
"""The command that undoes each undoable command."""

ANSWER_KEYS = ('Y', 'N')
"""The letters that answer a question. They have no other use, so pressing one late is harmless."""

_LETTERS = tuple(letter for letter in string.ascii_uppercase if letter not in ANSWER_KEYS)

FINISH_KEYS = (*_LETTERS, *(f'Shift+{letter}' for letter in _LETTERS))
"""The keys to press when a kart crosses the line: the first is for the first kart on the roster,
and so on. Each kart therefore keeps its key."""

MOST_BARS = 4
BARS = {Grade.UNKNOWN: 0, Grade.GOOD: MOST_BARS, Grade.FAIR: 2, Grade.POOR: 1}
"""Number of bars shown for each grade of link, out of ``MOST_BARS``; 0 draws no bars."""

ANSWERS = {
    RaceState.GRID_ACTIVE: '✓ ready',
    RaceState.GREEN_GREEN: '✓ driving',
    RaceState.RED_FLAG: '✓ stopped',
    RaceState.RED_RED: '✓ stopped',
}
"""What a row shows once the kart has acknowledged the state that it is being sent."""

BEGINS_WITHIN = 30.0
"""Time after GREEN_GREEN within which each kart must begin to drive, in seconds (§3.A)."""

REMINDS_FOR = 30.0
"""Minimum time to show the reminder that karts must be driving, in seconds. The reminder stays
longer if a kart has not acknowledged GREEN_GREEN."""

Pending = Mapping[tuple[Kind, int], float]
"""Time for which each command to a kart has been waiting for its answer, in seconds. The kart's
number is 0 if the command is not for a single kart."""


@dataclass(frozen=True)
class Button:
    """
    What a command's button shows and does.

    :param gives: the command that an official gives by pressing this button and confirming. It
        includes a statement only if race control asked for one, in which case the question shows
        the wording of the statement.
    :param enabled: whether a press has an effect other than showing the reason.
    :param reason: why the button is not enabled; empty if the button is enabled.
    :param question: what the official confirms.
    :param also: the further commands that the button ``YES, and also`` confirms.
    :param phrase: a few words shown with the label. For a command to the race, they say when its
        result took effect, what the command would do, or what the command is waiting for.
    :param current: for a command to the race, whether the race is already in the state that the
        command leads to.
    :param recedes: whether the button is less prominent, because the MSR must be used first.
    :param is_next: whether the command is the usual next step.
    """

    gives: Given
    label: str
    enabled: bool
    reason: str
    question: Asked = field(compare=False)
    also: tuple[Given, ...] = ()
    key: str = ''
    phrase: str = ''
    current: bool = False
    recedes: bool = False
    is_next: bool = False

    def asks_the_same(self, other: Button) -> bool:
        """Return whether both buttons would do the same thing, so one confirmation covers both."""
        is_same = (self.gives, self.also) == (other.gives, other.also)
        return is_same and self.question.essence == other.question.essence

    @property
    def command(self) -> Kind:
        return self.gives.command

    @property
    def kart(self) -> int:
        """Return the number of the command's kart; 0 if it is not for a single kart."""
        return self.gives.kart

    @property
    def name(self) -> str:
        return texts.command_name(self.command, self.kart)

    @property
    def is_stop(self) -> bool:
        return CATALOGUE[self.command].stop

    @property
    def asks(self) -> bool:
        """Return whether an official must confirm the command."""
        return CATALOGUE[self.command].asks or (self.gives.stated and not self.is_stop)

    @property
    def is_instant(self) -> bool:
        """Return whether the command is a stop that acts when pressed, without confirmation."""
        return self.is_stop and not self.asks

    def is_same_command(self, other: Button) -> bool:
        """Return whether both buttons have the same command for the same kart or heat."""
        one, two = self.gives, other.gives
        return (one.command, one.kart, one.heat) == (two.command, two.kart, two.heat)

    @property
    def explanation(self) -> str:
        """Return why the command is not possible; empty if it is possible."""
        return f'{self.name}: {self.reason}' if self.reason else ''


@dataclass(frozen=True)
class Row:
    """
    What a kart's row shows.

    :param use_msr: whether an alert about the kart asks for the Master Safety Remote.
    :param link: the quality of the kart's link in a word, or NO LINK.
    :param bars: the quality of the kart's link as a number of bars, out of ``MOST_BARS``.
    :param answer: the kart's answer in a word or two; empty if no answer is expected.
    :param waits: whether the kart is connected and has not yet obeyed the state it is being sent.
    :param place: the kart's position and laps; without timing, its place in the order of FINISH.
    :param letter: the command that the kart's letter gives.
    """

    number: int
    team: str
    in_race: bool
    use_msr: bool
    link: Cell
    bars: int
    link_time: str
    sent: Cell
    since: str
    answer: Cell
    waits: bool
    says: str
    place: str
    gap: str
    note: Cell
    buttons: tuple[Button, ...]
    letter: Button

    @functools.cached_property
    def cells(self) -> tuple[tuple[Cell, Cell], ...]:
        """Return the text in each of the COLUMNS, with the small text under it."""
        return (
            (Cell(str(self.number)), Cell('')),
            (Cell(self.team), self.note),
            (self.sent, Cell(self.since)),
            (self.answer, Cell(self.says, Tone.FAINT)),
            (self.link, Cell(self.link_time)),
            (Cell(self.place), Cell(self.gap)),
        )

    @functools.cached_property
    def looks(self) -> list[tuple[object, ...]]:
        """Return everything that decides how each cell looks, apart from what all cells share."""
        return [(*cell, self.in_race, self.use_msr, self.waits, self.bars) for cell in self.cells]


COLUMNS = {'Kart': 46, 'Team': 0, 'Sent, for': 150, 'Answer': 104, 'Link': 78, 'Place, lap': 56}
"""
The columns of the list of karts, in the window and in the terminal: heading, and width in pixels
on a 1366 by 768 screen. A width of 0 takes the remaining width.
"""


@dataclass(frozen=True)
class Danger:
    """
    A warning in the largest type, shown instead of the state of the race.

    :param title: empty if there is no warning.
    :param detail: what is known, in a sentence or two.
    :param barred: why only stops can be pressed; empty if other commands may be possible too.
    :param stale: whether the rest of the screen is out of date.
    """

    title: str = ''
    advice: str = ''
    detail: str = ''
    barred: str = ''
    stale: bool = False


ALL_WELL = Danger()


@dataclass(frozen=True)
class Screen:
    """
    What a screen shows about the race itself. All of it follows from these fields.

    :param snapshot: the newest snapshot.
    :param age: time since that snapshot arrived, in seconds.
    :param pending: the commands that wait for their answers.
    :param danger: the warning to show in the largest type, if any.
    :param heard: the newest results, even if they are out of date; None if there never were any.
    """

    snapshot: Snapshot = NOTHING
    age: float = 0.0
    pending: Pending = field(default_factory=dict)
    danger: Danger = ALL_WELL
    heard: Standings | None = None

    @property
    def now(self) -> float:
        """Return the time on race control's clock, in seconds."""
        return self.snapshot.stamp + self.age

    @property
    def teams(self) -> dict[int, str]:
        return {kart.number: kart.team for kart in self.snapshot.karts}

    # ----- the results --------------------------------------------------------------------

    @functools.cached_property
    def results(self) -> Standings | None:
        """Return the newest results; None if they are out of date, so that there is no timing."""
        # A stamp in the future is as wrong as an old one.
        is_new = self.heard is not None and abs(self.now - self.heard.stamp) < TIMING_GONE
        return self.heard if is_new else None

    @functools.cached_property
    def own_results(self) -> Standings | None:
        """Return the newest results if they belong to this race or, in the garage, to the last."""
        race, found = self.snapshot, self.results
        if found is None or found.run != race.run:
            return None
        own = race.state is RaceState.IN_GARAGE or found.race == race.number
        return found if own else None

    @functools.cached_property
    def shown_results(self) -> Standings | None:
        """
        Return the results to show: the newest ones or, once this race has begun, its own.

        Return None if there are no such results, or if they contain no timed lap.
        """
        race = self.snapshot
        has_begun = race.state is RaceState.GREEN_GREEN or any(kart.place for kart in race.karts)
        shown = self.own_results if has_begun else self.results
        is_timed = shown is not None and any(each.lap_times for each in shown.karts)
        return shown if is_timed else None

    @property
    def timing(self) -> str:
        """Return a note that there is no timing; empty if there is."""
        needed = self.snapshot.state is RaceState.GREEN_GREEN
        found = self.own_results if needed else self.results
        return texts.NO_TIMING if found is None else ''

    @property
    def places(self) -> str:
        """Return the results, first place first; without timing, the order of FINISH."""
        shown = self.shown_results
        if shown is not None:
            # In the garage and on the grid, they may be those of another heat.
            name = ' of '.join(filter(None, (texts.RESULTS, shown.heat)))
            placed = [(each.place, each.kart) for each in shown.karts]
        else:
            name = texts.ORDER_OF_FINISH
            placed = [(each.place, each.number) for each in self.snapshot.karts]
        said = ', '.join(f'{place}. kart {kart}' for place, kart in sorted(placed) if place)
        return f'{name}: {said}' if said else ''

    @property
    def order(self) -> str:
        """Return the starting order of the heat's karts, and the next single-kart heat."""
        race, timing = self.snapshot, self.results
        orders, grid = [], _grid_of(race.heat, timing)
        if race.state in (RaceState.IN_GARAGE, RaceState.GRID_ACTIVE) and len(grid) > 1:
            orders.append(f'Grid: {_listed(grid)}')
        orders += [
            f'Next: kart {_listed(heat.karts)} ({heat.name})'
            for heat in race.heats
            if timing is not None and heat.name == timing.next_heat
        ]
        return ' · '.join(orders)

    # ----- the race -----------------------------------------------------------------------

    @functools.cached_property
    def state(self) -> Cell:
        """Return the state of the race or, if no kart is sent that state, what the karts do."""
        return headline(self.snapshot)

    @property
    def since(self) -> str:
        """Return how long the race has been in its present state, since when, and why."""
        race = self.snapshot
        since = clock(self.now - race.state_since)
        if race.state_cause:
            since = f'{since} · {race.state_cause}'
        if race.state is not None:
            since = f'{since}, {time_of_day(race.state_since)}'
        if self.state != STATE_CELLS[race.state]:
            since = f'race in {STATES[race.state]} {since}'
        return since

    @functools.cached_property
    def msr(self) -> Cell:
        """Return every kart that needs the MSR, or a note that the MSR is in use."""
        race = self.snapshot
        if race.msr_alerts:
            karts = numbered(sorted({alert.kart for alert in race.msr_alerts if alert.kart}))
            return Cell(f'USE THE MSR: {karts}' if karts else texts.USE_MSR, Tone.BAD)
        if not race.track.msr_used:
            return Cell('')
        karts = texts.in_doubt(race)
        used = f'MSR IN USE: nothing else can stop {karts}' if karts else 'MSR IN USE'
        return Cell(used, Tone.WAIT)

    @property
    def reminder(self) -> str:
        """
        Return the karts that are due to be sent FINISH, or a note that each must drive by now.

        Only an official can see whether a kart is driving (§3.A), so the note is shown for a while
        whatever the karts report. A kart that has crossed the line needs no reminder. What is said
        of the MSR comes first, and the line has room for one of the two.
        """
        race, own = self.snapshot, self.own_results
        if self.danger.title or self.msr.text:
            return ''
        if done := [str(kart.number) for kart in race.karts if self.last_lap_is_done(kart)]:
            return f'FINISH {", ".join(done)}: last lap done'
        late = self.now - race.state_since - BEGINS_WITHIN
        if race.state is not RaceState.GREEN_GREEN or late < 0.0:
            return ''
        sent = [kart for kart in race.karts if kart.in_race and kart.sent is RaceState.GREEN_GREEN]
        if own is not None:
            sent = [kart for kart in sent if not timed.has_crossed(own, kart.number)]
        if late >= REMINDS_FOR and all(kart.acknowledged for kart in sent):
            return ''
        within = duration(BEGINS_WITHIN, 0)
        return f'GREEN for over {within}: send RED FLAG if a kart is not driving yet' * bool(sent)

    @functools.cached_property
    def humans(self) -> Cell:
        """Return whether humans are allowed on the track."""
        return _humans(self.snapshot, self.danger)[0]

    @functools.cached_property
    def humans_reason(self) -> str:
        return _humans(self.snapshot, self.danger)[1]

    @functools.cached_property
    def rows(self) -> tuple[Row, ...]:
        return tuple(_row(self, kart, place) for place, kart in enumerate(self.snapshot.karts))

    def texts(self, commanding: Sequence[str]) -> dict[str, Cell]:
        """
        Return what each text around the list of karts shows, by the name of the text.

        :param commanding: the officials who have given commands.
        """
        race, dated = self.snapshot, Tone.FAINT if self.danger.stale else Tone.PLAIN
        by = f'commands by {", ".join(commanding)}' if commanding else ''
        # If it is too long, the end is cut off, which the rows or the events show as well.
        rest = texts.missing(race), self.timing, self.order, by, self.places
        return {
            'state': self.state,
            'state_since': Cell(self.since),
            'humans': self.humans,
            'humans_reason': Cell(self.humans_reason[:1].upper() + self.humans_reason[1:]),
            'heat': Cell(texts.heat_in_race(race)),
            'tally': Cell(tally(race) or 'no kart is in the race', dated),
            'msr': self.msr,
            'reminder': Cell(self.reminder, Tone.WAIT),
            'rest': Cell(' · '.join(filter(None, rest)), dated),
            'able': Cell(texts.can_stop(race).partition(':')[0], dated),
            'danger_title': Cell(self.danger.title),
            'danger_detail': Cell(self.danger.detail),
            'danger_advice': Cell(self.danger.advice),
        }

    # ----- the buttons --------------------------------------------------------------------

    @functools.cached_property
    def next_step(self) -> CommandKind | None:
        """
        Return the command that usually comes next; None if there is none or it is not possible.

        There is none while the MSR must be used, or while only the MSR can stop a kart. Once every
        kart has finished the heat in the race, it is HEAT, as long as a heat is left.
        """
        race = self.snapshot
        racing = [kart for kart in race.karts if kart.in_race]
        wanted = NEXT.get(race.state, ())
        if race.state is RaceState.GREEN_GREEN and all(kart.place for kart in racing):
            linked = [kart for kart in racing if kart.connected]
            stopped = all(kart.sent.is_red and kart.acknowledged for kart in linked)
            wanted = (CommandKind.RACE_OVER,) if stopped else ()
        # The places alone may be those of another heat with the same karts.
        is_run = _runs_of(race.heat, self.results) and all(kart.place for kart in racing)
        if is_run and race.state is RaceState.IN_GARAGE:
            wanted = (CommandKind.SET_HEAT,) if self.next_heat else ()
        if race.msr_alerts or (race.track.msr_used and texts.in_doubt(race)):
            wanted = ()
        return next((each for each in wanted if self.race_button(each).enabled), None)

    @functools.cached_property
    def race(self) -> tuple[Button, ...]:
        """Return the commands to the race."""
        steps = (self.race_button(command) for command in RACE_COMMANDS)
        return tuple(replace(each, is_next=each.command is self.next_step) for each in steps)

    @functools.cached_property
    def msr_button(self) -> Button:
        return self.race_button(CommandKind.RECORD_MSR)

    @functools.cached_property
    def track_button(self) -> Button:
        button = self.race_button(_offered(CommandKind.OPEN_TRACK, self.snapshot, None))
        return replace(button, phrase='to humans')

    @functools.cached_property
    def heat_button(self) -> Button:
        """Return the button that opens the sheet of heats, which also reads the roster again."""
        button = self.race_button(CommandKind.SET_HEAT)
        if self.snapshot.heats:
            return replace(button, is_next=self.next_step is CommandKind.SET_HEAT)
        read = self.race_button(CommandKind.READ_ROSTER)
        return replace(button, enabled=read.enabled, reason=read.reason)

    @functools.cached_property
    def heats(self) -> tuple[Button, ...]:
        """Return the buttons that put a heat into the race. Typing a heat's number focuses it."""
        button = self.race_button(CommandKind.SET_HEAT)
        return tuple(
            replace(
                button,
                gives=replace(button.gives, taken={'heat': heat.name}),
                label=self._heat(heat),
                key=str(number),
            )
            for number, heat in enumerate(self.snapshot.heats, 1)
        )

    def _heat(self, heat: Heat) -> str:
        """Return a heat and its karts, in the starting order if the timekeeper has set one."""
        grid, runs = _grid_of(heat.name, self.results), _runs_of(heat.name, self.results)
        notes = [f'run at {time_of_day(at)[:5]}' for at in runs[-1:]]
        notes += ['in grid order'] * (len(grid) > 1) + ['next'] * (heat.name == self.next_heat)
        if heat == self.snapshot.heat_in_race:
            out = {*heat.karts} - {kart.number for kart in self.snapshot.karts if kart.in_race}
            notes.append(f'in the race, without {numbered(sorted(out))}' if out else 'in the race')
        text = f'{heat.name}: {_listed(grid or heat.karts)}'
        return f'{text}  ({", ".join(notes)})' if notes else text

    @property
    def next_heat(self) -> str:
        """Return the timekeeper's choice of the next heat, or the first that has not been run."""
        race, timing = self.snapshot, self.results
        if timing is None or timing.next_heat:
            return timing.next_heat if timing is not None else ''
        left = (each.name for each in race.heats if not _runs_of(each.name, timing))
        return next((name for name in left if name != race.heat), '')

    @functools.cached_property
    def rosters(self) -> tuple[Button, ...]:
        """Return the button that reads the roster file again, and the one that applies it."""
        return self.race_button(CommandKind.READ_ROSTER), self.race_button(CommandKind.TAKE_ROSTER)

    @functools.cached_property
    def buttons(self) -> tuple[Button, ...]:
        """Return all buttons except those of the heats."""
        others = self.msr_button, self.track_button, self.heat_button, *self.rosters
        return *self.race, *others, *(each for row in self.rows for each in row.buttons)

    @functools.cached_property
    def commands(self) -> list[object]:
        """Return the commands of all buttons, in an order that follows their places."""
        gives = [button.gives for button in (*self.buttons, *self.heats)]
        return [(each.command, each.kart, each.heat) for each in gives]

    def button(self, command: Kind, kart: int = 0) -> Button | None:
        one = self.snapshot.kart(kart)
        if one is not None and command is CommandKind.KART_FINISH:  # it always has a key
            return self.kart_button(command, one)
        found = (each for each in self.buttons if (each.command, each.kart) == (command, kart))
        return next(found, None)

    def letter(self, kart: int) -> Button | None:
        return next((row.letter for row in self.rows if row.number == kart), None)

    @functools.cached_property
    def need_msr(self) -> set[int]:
        return {each.kart for each in self.snapshot.msr_alerts if each.kart}

    def _races(self, kart: KartSnapshot) -> bool:
        is_on = self.snapshot.state is RaceState.GREEN_GREEN and kart.in_race
        return is_on and not kart.place

    def last_lap_is_done(self, kart: KartSnapshot) -> bool:
        """Return whether a kart has driven all its laps, so that only FINISH is missing."""
        own = self.own_results
        if own is None or not own.laps or not self._races(kart) or kart.hold:
            return False
        return own.kart(kart.number) is not None and not own.laps_left(kart.number)

    def letter_button(self, kart: KartSnapshot, key: str) -> Button:
        """
        Return what a kart's letter does: count a lap or, on the kart's last lap, send FINISH.

        In a heat without timing, nobody knows whether this is the last lap, so the letter does
        nothing.
        """
        timing, finish = self.own_results, self.kart_button(CommandKind.KART_FINISH, kart, key)
        if not self._races(kart) or (timing is None and not self.snapshot.heat):
            return finish
        if timing is None or (timing.laps and timing.kart(kart.number) is None):
            reason = finish.reason or texts.NO_TIMING_REASON
            return replace(finish, enabled=False, reason=reason)
        # In a race of one lap, the first crossing may begin the lap.
        begun = timing.from_green or timed.has_crossed(timing, kart.number)
        if timing.laps and (timing.laps_left(kart.number) > 1 or not begun):
            offered = Availability(CommandKind.KART_FINISH, True)
            return self._button(Act.COUNT, kart, offered, key)
        return finish

    def race_button(self, command: CommandKind) -> Button:
        offered = self.snapshot.offered(command)
        button = self._button(command, None, offered, CATALOGUE[command].key)
        phrase, current = self._phrase(button, offered)
        return replace(button, phrase=phrase, current=current)

    def _phrase(self, button: Button, offered: Availability) -> tuple[str, bool]:
        """Return a command's phrase, and whether the race is in the state it leads to."""
        race, command = self.snapshot, button.command
        does, follows = CATALOGUE[command].does, CATALOGUE[command].follows
        if not does:
            return '', False
        current = command in STEP_STATES and STEP_STATES[command] is race.state
        current = current and (race.over or command is not CommandKind.RACE_OVER)
        if not button.enabled and (self.danger.barred or (command, 0) in self.pending):
            return button.reason, current and not self.danger.barred
        if current and command is CommandKind.RACE_OVER:
            return 'the race is over', True  # it may have been in that state before
        if current:
            return f'since {time_of_day(race.state_since)}', True
        if button.enabled:
            return does.format(karts=texts.count(offered.karts)), False
        # In another state of the race, the short text says enough; who points at the button reads
        # the whole reason. While a pause blocks the command, only the reason says how long.
        fits = command in NEXT.get(race.state, ()) or offered.available_from is not None
        return (not fits and follows) or button.reason, False

    def kart_button(self, command: CommandKind, kart: KartSnapshot, key: str = '') -> Button:
        return self._button(command, kart, kart.offered(command), key)

    def _also(self, offered: Availability) -> tuple[Given, ...]:
        """
        Return the commands that an official can confirm together with IN GARAGE.

        If the MSR was used, these commands release the karts that are still held after IN GARAGE,
        by stating that they were made safe by hand. Otherwise, the only command opens the track.
        """
        track, opening = self.snapshot.track, self.snapshot.offered(CommandKind.OPEN_TRACK)
        if not track.msr_used:
            given = Given(CommandKind.OPEN_TRACK, stated=bool(opening.statement), at=0.0)
            return (given,) if opening.available and not track.open else ()
        return tuple(
            Given(CommandKind.KART_IN_GARAGE, kart.number, True, {'hold': kart.hold}, at=0.0)
            for kart in self.snapshot.karts
            if kart.hold is not None and kart.number not in offered.karts
        )

    def _button(
        self,
        command: Kind,
        kart: KartSnapshot | None,
        offered: Availability,
        key: str,
    ) -> Button:
        entry, number = CATALOGUE[command], kart.number if kart else 0
        waits = self.pending.get((command, number))
        reason = offered.reason
        if reason and offered.available_from is not None:
            left = texts.left(offered.available_from - self.now)
            reason = f'possible again in {left} s: {reason}'
        # A stop can always be pressed, even while one waits or race control is silent.
        if not entry.stop and self.danger.barred:
            reason = self.danger.barred
        elif not entry.stop and waits is not None:
            reason = f'no answer yet ({duration(waits)})'
        seen = {
            'karts': offered.karts,
            'hold': kart.hold if kart else None,
            'opening': self.snapshot.track.opening,
            'reading': self.snapshot.reading,
        }
        gives = Given(
            command,
            number,
            stated=bool(offered.statement),
            taken={name: seen[name] for name in entry.takes if name in seen},
            at=0.0,
        )
        return Button(
            gives=gives,
            label=entry.label,
            enabled=entry.stop or (offered.available and not reason),
            reason=reason,
            question=Asked(command, self.snapshot, offered, kart, self.results),
            also=self._also(offered) if command is CommandKind.IN_GARAGE else (),
            key=key,
            recedes=command is CommandKind.KART_IN_GARAGE and number in self.need_msr,
        )


class Latest:
    """
    The latest information that a program has received about the race.

    :param began: when the program began to look for race control, in seconds.
    :ivar looking: where it looks, as part of a sentence.
    :ivar race: the newest snapshot; None if there never was one.
    :ivar results: the newest results; None if there never were any.
    """

    def __init__(self, began: float, looking: str = '') -> None:
        self.race: Snapshot | None = None
        self.results: Standings | None = None
        self.heard_at = 0.0
        self.two = False
        self.looking, self._began = looking, began
        self._ended_run: str | None = None

    def take_race(self, race: Snapshot, at: float, two: bool) -> None:
        """Accept a snapshot that arrived at a time (s), perhaps from one of two race controls."""
        self.race, self.heard_at, self.two = race, at, two

    def take_event(self, event: Event) -> None:
        """Remember a normal shutdown that race control announces."""
        is_end = event.kind is EventKind.ENDED and event.success
        # With two race controls, nobody knows which of them has ended.
        if is_end and self.race is not None and not self.two:
            self._ended_run = self.race.run

    def danger(self, at: float) -> Danger:
        """
        Return the warning to show at a given time (s); ALL_WELL if race control works.

        If race control is silent, the warning says to use the MSR, except before the first
        snapshot and after a normal shutdown with no kart in doubt.
        """
        race = self.race
        if race is None:
            detail = (
                f'Start race control: make run ROSTER=… Looking for {self.looking}: not found '
                f'after {duration(at - self._began, 0)}. Press a stop once. It will be sent '
                f'repeatedly until race control is found and accepts it.'
            )
            barred = texts.NOT_YET_REASON
            return Danger(texts.NOT_YET, 'NO STOP WORKS YET', detail, barred, stale=True)
        silent_for = at - self.heard_at
        if silent_for >= GONE_AFTER and self._ended_run == race.run and race.no_kart_in_doubt:
            detail = (
                f'Race control was shut down normally {duration(silent_for, 0)} ago. At that '
                f'time, no kart could have been moving where it should not have been. To start '
                f'it again: make run ROSTER=…'
            )
            barred = texts.GONE_REASON
            return Danger(texts.ENDED, 'NO STOP WORKS NOW', detail, barred, stale=True)
        if silent_for >= GONE_AFTER:
            detail = (
                f'Last update {duration(silent_for)} ago, in {STATES[race.state]}. The list below '
                f'is out of date. It may just be the network: check another window. Press a stop '
                f'once. It will be sent repeatedly until race control accepts it.'
            )
            return Danger(texts.GONE, texts.USE_MSR, detail, texts.GONE_REASON, stale=True)
        told = {alert.kind: alert.text for alert in race.alerts}
        if AlertKind.PART_FAILED in told:
            return Danger(texts.FAILED, texts.USE_MSR, told[AlertKind.PART_FAILED])
        if self.two or AlertKind.TWO_RACE_CONTROLS in told:
            found = 'Two race controls are running in this ROS domain'
            found = told.get(AlertKind.TWO_RACE_CONTROLS, found)
            detail = f'{found.removesuffix(".")}. Stops go to both. No other command can be sent.'
            barred = 'two race controls are running: shut one down'
            return Danger(texts.TWO, texts.TWO_ADVICE, detail, barred)
        return ALL_WELL

    def screen(self, at: float, pending: Pending) -> Screen:
        age = at - self.heard_at
        return Screen(self.race or NOTHING, age, pending, self.danger(at), self.results)


STEP_STATES = {
    kind: CATALOGUE[kind].result.race[0] for kind in RACE_COMMANDS if CATALOGUE[kind].result.race
}
"""The state of the race to which commands to the race lead."""


def _runs_of(heat: str, timing: Standings | None) -> list[float]:
    """Return the times (s) at which the timekeeper saw a heat run; empty if it never did."""
    return [] if timing is None else [each.stamp for each in timing.races if each.heat == heat]


def _grid_of(heat: str, timing: Standings | None) -> tuple[int, ...]:
    """Return the starting order of a heat; empty if the timekeeper has set none."""
    found = () if timing is None else (each.karts for each in timing.grids if each.name == heat)
    return next(iter(found), ())


def _listed(karts: Sequence[int]) -> str:
    return ', '.join(map(str, karts))


def _humans(race: Snapshot, danger: Danger) -> tuple[Cell, str]:
    """
    Return whether humans are allowed on the track, and why.

    Humans are never allowed before an official has opened the track, nor while anything else on
    the screen says that they are not. If the last run may not have ended normally, race control
    starts with the track marked as open. That mark alone does not prove that it was opened by an
    official.
    """
    if danger.title:
        return Cell('? KEEP OFF THE TRACK', Tone.BAD), danger.title
    is_open = race.track.open
    against, under_way = texts.against_humans(race), texts.under_way(race)
    if against or under_way or not race.track.allowed:
        told = bool(race.msr_alerts)
        doubtful = any(kart.in_doubt and not kart.is_stopping for kart in race.karts)
        reason = against if race.track.allowed else race.track.reason
        if under_way:
            reasons = (against, under_way) if told else (under_way, against)
            reason = '; '.join(filter(None, reasons))
        if is_open:
            return Cell(texts.CLEAR_TRACK, Tone.BAD), f'humans could be on the track: {reason}'
        unstated = race.track.settled_by is CommandKind.OPEN_TRACK
        if unstated and not (told or against or under_way):
            return Cell(texts.TRACK_CLOSED), reason
        tone = Tone.PLAIN if under_way and not against else Tone.WAIT
        return Cell(texts.KEEP_OFF, Tone.BAD if told or doubtful else tone), reason
    if race.nobody_is_heard:
        unknown = Cell(texts.UNHEARD_OPEN, Tone.WAIT) if is_open else Cell(texts.UNHEARD_CLOSED)
        return unknown, texts.HUMANS_UNKNOWN_REASON
    karts = texts.in_doubt(race)
    if karts:
        by_msr = texts.TRACK_OPEN_MSR if is_open else texts.TRACK_CLOSED_MSR
        until = f'{karts} {"are" if "," in karts else "is"} switched off'
        only = f'Only the MSR can stop {karts}. Leave the MSR on until {until}'
        return Cell(by_msr, Tone.WAIT), f'{race.track.reason}. {only}'
    if is_open:
        return Cell(texts.TRACK_OPEN, Tone.GOOD), race.track.reason
    closed = f'nobody may go onto the track until you open it: {race.track.reason}'
    return Cell(texts.TRACK_CLOSED), closed


SAYS_NO_MORE = 5.0
"""How long a kart has to report again, in seconds, if its last report names the right state but
answered an earlier order. After that time, the kart's row says what to do."""


def _row(screen: Screen, kart: KartSnapshot, place: int) -> Row:
    race, now, shown = screen.snapshot, screen.now, screen.shown_results
    use_msr = kart.number in screen.need_msr
    notes = [texts.USE_MSR] if use_msr else []
    if kart.in_doubt and not kart.settles:
        notes.append(texts.MSR_STOPS_IT if race.track.msr_used else texts.MAY_MOVE)
    if kart.counts_at is not None and kart.counts_at <= now:
        older = f'its {STATES[kart.sent]} report may answer an older order'
        notes.append(f'{older}: have it reconnect (it will be held)')
    elif kart.says_no_more and now - kart.sent_since > SAYS_NO_MORE:
        older = f'its {STATES[kart.sent]} report answered an older order'
        notes.append(f'{older}: if it stays silent, have it reconnect')
    if kart.flag_follows and kart.flag_at is not None:
        left = texts.left(kart.flag_at - now)
        notes.append(f'F{kart.place}, flag in {left} s')
    done = screen.last_lap_is_done(kart)
    if done:
        notes.append(texts.LAST_LAP_DONE)
    if kart.hold is not None:
        notes.append(texts.HELD.format(reason=kart.hold_reason))
    if not kart.in_race:
        notes.append('not in the race')
    urgent = use_msr or (kart.in_doubt and not kart.is_stopping)
    # The inspection is shown only if there is nothing that an official must read.
    note = ', '.join(notes) or f'inspected {kart.inspected}' * bool(kart.inspected)
    missing = Tone.WAIT if kart.in_race else Tone.FAINT  # in the garage it may still connect
    if kart.may_be_moving or (kart.in_race and race.state is not RaceState.IN_GARAGE):
        missing = Tone.BAD
    link, bars, link_time = _link(kart, missing)
    key = FINISH_KEYS[place] if place < len(FINISH_KEYS) else ''
    letter = screen.letter_button(kart, key)
    asks = kart.sent is not RaceState.IN_GARAGE
    says, sent = '', STATE_CELLS[kart.sent]
    if kart.connected and kart.reported not in (None, kart.sent):
        says = f'says {STATES[kart.reported]}'
    elif kart.counts_at is not None:
        says = 'for an older order?'
    return Row(
        number=kart.number,
        team=kart.team,
        in_race=kart.in_race,
        use_msr=use_msr,
        link=link,
        bars=bars,
        link_time=link_time,
        # A kart without a link is sent nothing; the cell shows what it would be sent.
        sent=sent if kart.connected else sent._replace(tone=Tone.FAINT),
        since=_age(now - kart.sent_since),
        answer=_answer(kart, now, missing),
        waits=kart.connected and asks and (kart.in_doubt or not kart.acknowledged),
        says=says,
        place=timed.position(shown, kart.number) if shown else f'F{kart.place}' * bool(kart.place),
        gap=shown.behind(kart.number) if shown else '',
        note=Cell(note, Tone.BAD if urgent else Tone.WAIT if done else Tone.FAINT),
        buttons=tuple(
            letter if command is CommandKind.KART_FINISH else screen.kart_button(command, kart)
            for command in (_offered(each, race, kart) for each in KART_COMMANDS)
        ),
        letter=letter,
    )


def _age(seconds: float) -> str:
    """Return an age that changes seldom, so that the rows do not all change every second."""
    return clock(seconds) if seconds < 60.0 else f'{seconds // 60:.0f} min'


def _link(kart: KartSnapshot, missing: Tone) -> tuple[Cell, int, str]:
    """Return a link's quality in a word and in bars, and its round trip or, if not good, delay."""
    grade, link = kart.link.grade, kart.link
    if not kart.connected:
        return Cell(texts.NOT_LINKED, missing), 0, ''
    late = None if grade is Grade.UNKNOWN else max(link.worst_answer or 0.0, link.behind)
    poor = Tone.WAIT if grade is Grade.POOR and kart.in_race else Tone.PLAIN
    time = milliseconds(link.round_trip if grade is Grade.GOOD else late)
    return Cell(LINKS[grade], poor), BARS[grade], time


def _answer(kart: KartSnapshot, now: float, missing: Tone) -> Cell:
    if not kart.connected:
        return Cell('! no answer', missing) if missing is Tone.BAD else Cell('')
    if kart.sent is RaceState.IN_GARAGE:
        return Cell('')
    if kart.acknowledged and kart.in_doubt:
        if kart.settles_at is None:  # it moved, and no waiting ends the doubt
            return Cell('! may move', Tone.BAD)
        return Cell(f'… wait {texts.left(kart.settles_at - now)} s', Tone.WAIT)
    if kart.acknowledged:
        return Cell(ANSWERS[kart.sent], Tone.GOOD)
    if kart.stopped_itself:
        return Cell('! stopped itself', Tone.BAD)
    if kart.counts_at is not None and kart.counts_at > now:
        return Cell(f'… in {texts.left(kart.counts_at - now)} s', Tone.WAIT)
    return Cell('… not yet', Tone.WAIT)


def _offered(command: CommandKind, race: Snapshot, kart: KartSnapshot | None) -> CommandKind:
    """Return this command or, while it is in effect, the command that undoes it."""
    undone_by = UNDONE_BY.get(command)
    if undone_by is not None and shows_result(CATALOGUE[command].result, race, kart):
        return undone_by
    return command


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the rows of a table as lines of text, with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        '  '.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def table(screen: Screen) -> list[str]:
    """Return the race as lines of text: state, track, alerts, karts and commands."""
    race, karts = screen.snapshot, tally(screen.snapshot)
    found = [
        race.banner and texts.BANNER.format(banner=race.banner),
        f'Race: {screen.state.text}  ({screen.since})',
        karts and f'Karts: {karts}',
        screen.msr.text,
        screen.reminder and f'{screen.reminder}  {texts.missing(race)}'.rstrip(),
        f'{screen.humans.text}: {screen.humans_reason}.',
        *(str(Notice(0, alert)) for alert in race.alerts),
        screen.places,
        screen.timing,
        screen.order,
        texts.can_stop(race),
    ]
    columns = [[*COLUMNS]]
    for row in screen.rows:
        columns.append(
            [' '.join(filter(None, (cell.text, below.text))) for cell, below in row.cells]
        )
    lines = [*filter(None, found), '', *aligned(columns), '']
    lines += [_line(button) for button in screen.race]
    lines += [_line(screen.heat_button), *(f'  {button.label}' for button in screen.heats)]
    lines += map(_line, screen.rosters)
    return lines


def _line(button: Button) -> str:
    said = 'possible' if button.enabled else button.reason
    return f'{button.label:12} {said}{f" ({button.phrase})" if button.current else ""}'
