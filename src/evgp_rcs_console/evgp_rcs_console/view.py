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

"""
From a snapshot of the race to what a screen shows: texts, tones, and buttons with their reasons.

Pure, and without any rule of the race: a button is enabled if race control says that its command
is available, and its reason is race control's own sentence. Nothing here knows Qt or ROS, so the
terminal client shows the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import enum
import math
import string

from evgp_protocol.clock import duration
from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs_console import words
from evgp_rcs_console.commands import asks, Order
from evgp_rcs_console.effects import effects, nobody_is_heard
from evgp_rcs_console.outcome import is_so
from evgp_rcs_console.snapshot import (
    Availability,
    Available,
    Heat,
    Kart,
    Race,
    RED,
    State,
    Track,
)

GONE_AFTER = 0.9
"""
Time without a snapshot after which race control counts as gone, in seconds.

It publishes one every 0.5 s at least, and an official must know within 1 s.
"""

RACE_COMMANDS = (
    CommandKind.GRID_ACTIVE,
    CommandKind.GREEN_GREEN,
    CommandKind.RED_FLAG,
    CommandKind.RACE_OVER,
    CommandKind.IN_GARAGE,
)
"""The commands to the karts of the race, in the order of a race (§4.B)."""

KART_COMMANDS = (
    CommandKind.KART_RED_RED,
    CommandKind.KART_RED_FLAG,
    CommandKind.KART_FINISH,
    CommandKind.KART_IN_GARAGE,
    CommandKind.JOIN_RACE,
)
"""The buttons of a kart's row; one whose result holds offers to take it back."""

UNDONE_BY = {entry.undoes: kind for kind, entry in CATALOGUE.items() if entry.undoes is not None}
"""The command that takes back each one that can be taken back."""

ANSWER_KEYS = ('Y', 'N')
"""The letters that answer a question, and do nothing else: one typed too late has no effect."""

_LETTERS = tuple(letter for letter in string.ascii_uppercase if letter not in ANSWER_KEYS)

FINISH_KEYS = (*_LETTERS, *(f'Shift+{letter}' for letter in _LETTERS))
"""The keys that mark a kart as finished, by its place in the roster: a kart keeps its key."""

PART_FAILED = 'PART_FAILED'
TWO_RACE_CONTROLS = 'TWO_RACE_CONTROLS'
"""The kinds of alert that are shown in the largest type."""

Pending = Mapping[tuple[CommandKind, int], float]
"""The time that each command to each kart (0: none) has waited for its answer, in seconds."""


class Tone(enum.Enum):
    """How a text stands out: by a colour, and always also by a word or a symbol."""

    PLAIN = 'plain'
    FAINT = 'faint'
    GOOD = 'good'
    WAIT = 'wait'
    BAD = 'bad'
    GARAGE = 'garage'
    GRID = 'grid'
    GREEN = 'green'
    FLAG = 'flag'
    RED = 'red'


STATE_TONES = {
    State.UNKNOWN: Tone.FAINT,
    State.IN_GARAGE: Tone.GARAGE,
    State.GRID_ACTIVE: Tone.GRID,
    State.GREEN_GREEN: Tone.GREEN,
    State.RED_FLAG: Tone.FLAG,
    State.RED_RED: Tone.RED,
}


@dataclass(frozen=True)
class Cell:
    """A text with its tone."""

    text: str
    tone: Tone = Tone.PLAIN


@dataclass(frozen=True)
class Button:
    """
    A command as a button.

    :param enabled: pressing it sends the command, or asks for its confirmation.
    :param reason: why it is not enabled, with how long that has been so; empty if it is.
    :param condition: what the official confirms; empty if the command needs no confirmation.
    :param consequence: what it would do to each kart of the roster.
    :param statement: what race control asks the official to state; empty if nothing.
    :param karts: the karts that it would start or release, as race control says, or of its heat.
    :param hold: the hold that it would end; UNKNOWN for none.
    :param warning: why not to confirm it; empty if nothing is known against it.
    :param heat: the heat that it puts into the race, by its name.
    :param key: the key that presses it; empty if none does.
    """

    command: CommandKind
    kart: int
    label: str
    enabled: bool
    reason: str
    condition: str
    consequence: str
    statement: str = ''
    karts: tuple[int, ...] = ()
    hold: State = State.UNKNOWN
    warning: str = ''
    heat: str = ''
    key: str = ''

    def order(self) -> Order:
        """
        Return the command as given by an official who saw this button and confirmed its condition.

        Race control gets a statement only if it asked for it and the question showed its words.
        """
        return Order(
            self.command,
            self.kart,
            stated=bool(self.statement),
            karts=self.karts,
            hold=self.hold,
            heat=self.heat,
        )

    def asks_the_same(self, other: Button) -> bool:
        """Return whether both would do the same, so that one confirmation is good for both."""

        def seen(button: Button) -> tuple[object, ...]:
            said = button.condition, button.consequence, button.warning
            return *said, button.statement, button.karts, button.hold

        return seen(self) == seen(other)

    @property
    def is_stop(self) -> bool:
        """Return whether it is a stop."""
        return CATALOGUE[self.command].stop

    @property
    def is_instant(self) -> bool:
        """Return whether it is a stop that asks nothing: it acts when the button goes down."""
        return self.is_stop and not self.condition

    def is_same_command(self, other: Button) -> bool:
        """Return whether the other one is the same command for the same kart or heat."""
        return (self.command, self.kart, self.heat) == (other.command, other.kart, other.heat)

    @property
    def explanation(self) -> str:
        """Return why it is not possible; empty if it is."""
        name = words.command_name(self.command, self.kart)
        return words.BARRED.format(command=name, reason=self.reason) if self.reason else ''


@dataclass(frozen=True)
class Row:
    """
    A kart as a row.

    :param finish: what its letter presses, whatever its button offers.
    """

    number: int
    team: str
    in_race: bool
    race: Cell
    link: Cell
    sent: Cell
    since: str
    acknowledged: Cell
    says: Cell
    place: str
    note: str
    buttons: tuple[Button, ...]
    finish: Button


@dataclass(frozen=True)
class Danger:
    """
    What the screen says in the largest type, instead of the state of the race.

    :param detail: what is known, in a sentence or two.
    :param barred: why only stops can be pressed; empty if race control says what is possible.
    :param stale: the rest of the screen is out of date.
    """

    title: str
    advice: str
    detail: str
    barred: str = ''
    stale: bool = False


@dataclass(frozen=True)
class Screen:
    """
    All that a screen shows of the race itself.

    :param banner: what it says at its top; empty: nothing.
    :param state: the state of the race, in the largest type; or what is true of its karts, if none
        of them is sent it.
    :param since: for how long it has been in that state, and by whom.
    :param tally: how many karts of the race do what; empty if there is none.
    :param heat_button: offers the choice of a heat; None if the roster names none.
    :param heats: one button for each heat of the roster.
    :param places: the places of the race, or of the last one; empty if there are none.
    """

    banner: str
    state: Cell
    since: str
    tally: str
    heat_button: Button | None
    heats: tuple[Button, ...]
    places: str
    humans: Cell
    humans_reason: str
    track: Cell
    race: tuple[Button, ...]
    all_karts: tuple[Button, ...]
    track_button: Button | None
    rows: tuple[Row, ...]

    def button(self, command: CommandKind, kart: int = 0) -> Button | None:
        """Return the button of a command, if this screen has it."""
        buttons = [*self.race, *self.all_karts]
        buttons += filter(None, [self.track_button, self.heat_button])
        for row in self.rows:
            if row.number == kart:
                buttons += (*row.buttons, row.finish)
        return next(
            (each for each in buttons if (each.command, each.kart) == (command, kart)), None
        )


KEYS = {
    CommandKind.GRID_ACTIVE: 'F2',
    CommandKind.GREEN_GREEN: 'F3',
    CommandKind.RED_FLAG: 'F4',
    CommandKind.RACE_OVER: 'F5',
    CommandKind.IN_GARAGE: 'F6',
    CommandKind.OPEN_TRACK: 'F7',
    CommandKind.CLOSE_TRACK: 'F8',
    CommandKind.RECORD_MSR: 'F9',
    CommandKind.SET_HEAT: 'Ctrl+H',
}
"""The keys of the commands that concern no single kart, without ALL KILL."""

CHOSEN_KART_KEYS = {
    'R': (CommandKind.KART_RED_RED,),
    'F': (CommandKind.KART_RED_FLAG,),
    'G': (CommandKind.KART_IN_GARAGE,),
    'J': (CommandKind.JOIN_RACE, CommandKind.LEAVE_RACE),
}
"""With Ctrl, the keys of the commands to the chosen kart."""


NOTHING = Race(
    state=State.UNKNOWN,
    state_for=0.0,
    over=False,
    karts=(),
    commands={},
    track=Track(is_open=False, allowed=False, reason='', msr_used=False),
    alerts=(),
)
"""What is shown before race control is heard for the first time."""


def is_gone(silent_for: float | None) -> bool:
    """Return whether race control counts as gone; None: it was never heard."""
    return silent_for is None or silent_for >= GONE_AFTER


KILL_NOTES = (words.KILL_NOTE_NOT_YET, words.KILL_NOTE_GONE)
"""How a stop is pressed before race control is found, and once it is gone."""


def silence(
    silent_for: float | None,
    looking_for: float,
    looking: str,
    state: State,
    notes: tuple[str, str] = ('', ''),
) -> Danger | None:
    """
    Return what to say of race control's silence, None while it is heard.

    :param silent_for: time since it was last heard, in seconds; None: it never was.
    :param looking_for: time since the search for it began, in seconds.
    :param looking: where it is looked for, as a sentence says it.
    :param state: the state of the race when it was heard last.
    :param notes: what to add before it is found, and once it is gone.
    """
    if not is_gone(silent_for):
        return None
    if silent_for is None:
        title, barred, note = words.NOT_YET, words.NOT_YET_REASON, notes[0]
        detail = words.NOT_YET_DETAIL.format(looking=looking, age=duration(looking_for, 0))
    else:
        title, barred, note = words.GONE, words.GONE_REASON, notes[1]
        detail = words.GONE_SINCE.format(age=duration(silent_for), state=words.STATES[state])
    detail = f'{detail} {note}'.rstrip()
    return Danger(title, words.USE_MSR, detail, barred, stale=True)


def danger(race: Race, two: bool) -> Danger | None:
    """
    Return what to say of a race control that is heard, but must not be relied on.

    :param two: snapshots come from two race controls.
    """
    told = {alert.kind: alert.text for alert in race.alerts}
    if PART_FAILED in told:
        return Danger(words.FAILED, words.USE_MSR, told[PART_FAILED])
    if two or TWO_RACE_CONTROLS in told:
        found = told.get(TWO_RACE_CONTROLS, words.TWO_DETAIL).removesuffix('.')
        detail = f'{found}. {words.TWO_WHAT_TO_DO}'
        return Danger(words.TWO, words.TWO_ADVICE, detail, words.TWO_REASON)
    return None


WORTH_A_FIGURE = 2.0
"""Time after which the screen says for how long a command has not been possible, in seconds."""


class ReasonTimes:
    """The time for which each command has not been possible for its present reason."""

    def __init__(self) -> None:
        """Have seen no reason."""
        self._first: dict[CommandKind, tuple[str, float]] = {}

    def update(self, offered: Availability, now: float) -> dict[CommandKind, float]:
        """Take what race control says of commands at a time (s); return the times, in seconds."""
        first = {command: (each.reason, now) for command, each in offered.items()}
        for command, (reason, since) in self._first.items():
            if command in first and first[command][0] == reason:
                first[command] = reason, since
        self._first = first
        return {command: now - since for command, (_, since) in first.items()}


def show(
    race: Race,
    age: float,
    pending: Pending,
    danger: Danger | None = None,
    reasons: Mapping[CommandKind, float] | None = None,
) -> Screen:
    """
    Return what a screen shows of a snapshot.

    :param age: time since the snapshot came, in seconds.
    :param pending: the commands that wait for an answer.
    :param danger: what to say if race control is gone or must not be relied on.
    :param reasons: the time for which each command to the race has not been possible for its
        present reason, in seconds.
    """
    barred = danger.barred if danger else ''
    buttons = _Buttons(race, pending, age, barred, reasons or {})
    humans, reason = _humans(race)
    if danger is not None:
        humans, reason = Cell(words.HUMANS_NOT_KNOWN, Tone.BAD), danger.title
    return Screen(
        banner=race.banner,
        state=_headline(race),
        since=_since(race, age),
        tally=words.tally(race.karts),
        heat_button=buttons.race(CommandKind.SET_HEAT) if race.heats else None,
        heats=tuple(buttons.heat(heat) for heat in race.heats),
        places=_places(race),
        humans=humans,
        humans_reason=reason,
        track=_track(race),
        race=tuple(buttons.race(command) for command in RACE_COMMANDS),
        all_karts=(buttons.race(CommandKind.RECORD_MSR),),
        track_button=buttons.race(_offered(CommandKind.OPEN_TRACK, race, None)),
        rows=tuple(_row(kart, place, age, buttons) for place, kart in enumerate(race.karts)),
    )


def _headline(race: Race) -> Cell:
    """
    Return what is said in the largest type: what is true of the karts of the race.

    A kart without a link stops by itself: RED RED is true of it.
    """
    karts = [kart for kart in race.karts if kart.in_race] or race.karts
    there = [kart for kart in karts if kart.connected]
    sent = {kart.sent for kart in there}
    if race.state in sent:
        return _state_cell(race.state)
    if sent:
        if race.state in RED and len(sent) == 1:
            return _state_cell(*sent)
        return Cell(words.OTHERWISE[race.state], Tone.WAIT)
    if race.state is State.GRID_ACTIVE:
        return Cell(words.NONE_CONNECTED, Tone.WAIT)
    if race.state in (State.GREEN_GREEN, State.RED_FLAG):
        return Cell(words.ALL_LOST, Tone.BAD)
    return _state_cell(race.state)


def _since(race: Race, age: float) -> str:
    """Return for how long the race has been in its state, by whom, and whether it is over."""
    since = words.STATE_SINCE.format(age=duration(race.state_for + age, 0))
    if race.state_cause:
        since = words.STATE_CAUSE.format(since=since, cause=race.state_cause)
    if race.state_clock:
        since = words.STATE_AT.format(since=since, clock=race.state_clock)
    if _headline(race) != _state_cell(race.state):
        since = words.STATE_OF_RACE.format(state=words.STATES[race.state], since=since)
    return f'{since}, {words.OVER}' if race.over else since


def _humans(race: Race) -> tuple[Cell, str]:
    """
    Return whether humans are allowed on the track, and why or why not.

    They are not while anything else on the screen speaks against it.
    """
    against, under_way = words.against_humans(race), words.under_way(race)
    if against or under_way or not race.track.allowed:
        told = any(alert.use_msr for alert in race.alerts)
        doubtful = any(kart.in_doubt and not kart.is_stopping for kart in race.karts)
        wrong = told or doubtful or race.track.is_open
        reason = '' if race.track.allowed else race.track.reason
        if under_way or not reason:
            reason = against or reason or under_way
        return Cell(words.HUMANS_NOT_ALLOWED, Tone.BAD if wrong else Tone.WAIT), reason
    if nobody_is_heard(race):
        return Cell(words.HUMANS_UNKNOWN), words.HUMANS_UNKNOWN_REASON
    karts = words.in_doubt(race)
    if karts:
        reason = words.HUMANS_BY_MSR_REASON.format(reason=race.track.reason, karts=karts)
        return Cell(words.HUMANS_BY_MSR, Tone.WAIT), reason
    return Cell(words.HUMANS_ALLOWED, Tone.GOOD), race.track.reason


def _track(race: Race) -> Cell:
    """Return whether the track is open; in red if nobody may be there."""
    if not race.track.is_open:
        return Cell(words.TRACK_CLOSED)
    unsafe = _humans(race)[0].text == words.HUMANS_NOT_ALLOWED
    return Cell(words.TRACK_OPEN, Tone.BAD if unsafe else Tone.WAIT)


def _places(race: Race) -> str:
    """Return the places, the first one first."""
    finished = sorted((kart for kart in race.karts if kart.place), key=lambda kart: kart.place)
    return ', '.join(f'{kart.place}. {words.kart_name(kart)}' for kart in finished)


def _row(kart: Kart, place: int, age: float, buttons: _Buttons) -> Row:
    race = buttons.snapshot
    notes = []
    if kart.in_doubt and not kart.settles:
        notes.append(words.MSR_STOPS_IT if race.track.msr_used else words.MAY_MOVE)
    if kart.hold is not State.UNKNOWN:
        notes.append(words.HELD.format(reason=kart.hold_reason))
    asks = kart.sent is not State.IN_GARAGE
    if not kart.connected or not asks:
        acknowledged = Cell(words.NOTHING_ASKED, Tone.FAINT)
    elif kart.acknowledged and kart.in_doubt:
        left = max(1, math.ceil(kart.settles_in - age))
        acknowledged = Cell(words.SETTLING.format(seconds=left), Tone.WAIT)
    elif kart.acknowledged:
        acknowledged = Cell(words.YES, Tone.GOOD)
    else:
        acknowledged = Cell(words.WAITING, Tone.WAIT)
    says = Cell(words.STATES[kart.reported], Tone.PLAIN)
    if kart.reported not in (State.UNKNOWN, kart.sent):
        says = Cell(words.STATES[kart.reported], Tone.WAIT)
    missing = Tone.WAIT if kart.in_race else Tone.FAINT  # in the garage it may come yet
    if kart.may_be_moving or (kart.in_race and race.state is not State.IN_GARAGE):
        missing = Tone.BAD
    key = FINISH_KEYS[place] if place < len(FINISH_KEYS) else ''
    finish = buttons.kart(CommandKind.KART_FINISH, kart, key)
    return Row(
        number=kart.number,
        team=kart.team,
        in_race=kart.in_race,
        race=Cell(words.RACING) if kart.in_race else Cell(words.NOT_RACING, Tone.FAINT),
        link=Cell(words.LINKED) if kart.connected else Cell(words.NOT_LINKED, missing),
        # Without a link it is sent nothing: it would be.
        sent=_state_cell(kart.sent) if kart.connected else _faint(_state_cell(kart.sent)),
        since=duration(kart.sent_for + age, 0),
        acknowledged=acknowledged,
        says=says,
        place=f'P{kart.place}' if kart.place else '',
        # Never beside what an official must read; of a kart at rest there is nothing else.
        note=', '.join(notes) or words.inspected(kart),
        buttons=tuple(
            finish if command is finish.command else buttons.kart(command, kart)
            for command in (_offered(each, race, kart) for each in KART_COMMANDS)
        ),
        finish=finish,
    )


def _offered(command: CommandKind, race: Race, kart: Kart | None) -> CommandKind:
    """Return what the button of a command offers: to take it back, while its result holds."""
    undone_by = UNDONE_BY.get(command)
    if undone_by is not None and is_so(CATALOGUE[command].result, race, kart):
        return undone_by
    return command


def _state_cell(state: State) -> Cell:
    return Cell(f'{words.SYMBOLS[state]} {words.STATES[state]}'.strip(), STATE_TONES[state])


def _faint(cell: Cell) -> Cell:
    return replace(cell, tone=Tone.FAINT)


@dataclass(frozen=True)
class _Buttons:
    """The buttons of one snapshot."""

    snapshot: Race
    pending: Pending
    age: float
    barred: str
    reasons: Mapping[CommandKind, float]

    def race(self, command: CommandKind) -> Button:
        offered = self.snapshot.commands.get(command, Available(False))
        return self._button(command, None, offered, KEYS.get(command, ''))

    def kart(self, command: CommandKind, kart: Kart, key: str = '') -> Button:
        offered = kart.commands.get(command, Available(False))
        return self._button(command, kart, offered, key)

    def heat(self, heat: Heat) -> Button:
        """Return the button that puts a heat into the race."""
        racing = tuple(kart.number for kart in self.snapshot.karts if kart.in_race)
        label = words.heat(heat, in_race=heat.karts == racing)
        return replace(
            self.race(CommandKind.SET_HEAT), label=label, heat=heat.name, karts=heat.karts, key=''
        )

    def _button(
        self,
        command: CommandKind,
        kart: Kart | None,
        offered: Available,
        key: str,
    ) -> Button:
        entry = CATALOGUE[command]
        waits = self.pending.get((command, kart.number if kart else 0))
        reason = offered.reason
        since = self.reasons.get(command, 0.0) if kart is None else 0.0
        if reason and offered.again_in:
            reason = words.again_in(reason, offered.again_in - self.age)
        elif reason and since >= WORTH_A_FIGURE:
            reason = words.WITH_AGE.format(reason=reason, age=duration(since, 0))
        # A stop can always be pressed, also while one waits or nobody answers: it does no harm.
        if not entry.stop and self.barred:
            reason = self.barred
        elif not entry.stop and waits is not None:
            reason = words.PENDING_REASON.format(age=duration(waits))
        condition = consequence = warning = ''
        if asks(command) or (offered.statement and not entry.stop):
            race = self.snapshot
            does = effects(command, race, offered, kart)
            condition = words.condition(command, kart, race, offered.statement)
            consequence = '\n'.join(words.consequences(command, does, race, kart))
            warning = words.warning(command, race, nobody_is_heard(race))
        return Button(
            command=command,
            kart=kart.number if kart else 0,
            label=entry.label,
            enabled=entry.stop or (offered.yes and not reason),
            reason=reason,
            condition=condition,
            consequence=consequence,
            statement=offered.statement,
            karts=offered.karts,
            hold=kart.hold if kart and entry.names_hold else State.UNKNOWN,
            warning=warning,
            key=key,
        )
