# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The rules of the race: what each kart is sent, which commands are refused, and why.

Rules for the code in this file:

- The code is pure: it uses no clock, socket, ROS, thread, file or log. Every input carries its
  time, in seconds on one monotonic clock.
- Only one thread uses a ``Race``, so it needs no lock.
- One table (``COMMANDS``, at the end) says in which states of the race a command is possible, what
  the official must state, and what the command does. ``Race._refusals`` says what else refuses it.
  A command is judged by its announced availability (``Race.availability``), then by what it names.
- If a message in ``evgp_rcs_msgs`` has the same field, the comment in the message explains it.
  Where the field here is None, the message has 0, NaN or UNKNOWN.

How the rules work. The race has a state, and each kart may have a *hold* of its own (RED_FLAG or
RED_RED). Together they determine what the kart is sent (``_commanded``). A kart in the race is
sent the stricter of the two. A kart outside the race is sent its hold, or IN_GARAGE if it has
none. After every change, the rules *redirect* the karts concerned: a kart whose state changes gets
a new ``Order`` with its own serial number, and loses its acknowledgement. An acknowledgement
counts only if it names the state of the kart's current order and was received under that order's
serial number. A report from before the command, or from an earlier connection, never counts.

A hold can become stricter, but only an official's explicit act ends it (``_race_in_garage`` or
``_release_kart``). Only ``_green_green`` sets GREEN_GREEN.

Commands can cross in transit, so every stop, every stall of race control and every start without
proof of how the last run ended begins a *pause*. Some commands *loosen*: they start or release
karts, let humans near them, or change the roster. Race control refuses such a command if it
arrived before the end of the pause, because its sender may not have seen the stop.

From GRID_ACTIVE on, what race control saves says that the karts on the grid may be moving
(``Race.memory``). GREEN_GREEN is refused until that is on the disk (``Race.saved``), so a crash
never makes race control forget a kart that it let move.

Race control keeps a *doubt* about each kart that may be unsafe (``Doubt``). It ends when the kart
acknowledges a red state and keeps reporting it for ``settle_time`` on the same connection, or when
an official states that the kart was made safe by hand. Losing the connection never ends it.

docs/rules.md has the rules themselves, and says what follows where race control does not know what
happened, is cut off from the karts, or is in contact with nobody who could stop the race.

Section numbers (§) are those of the EVGP proposal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
import enum
from typing import Any, NamedTuple

from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState, stricter
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.link_quality import LinkQuality, NOT_MEASURED

IN_GARAGE = RaceState.IN_GARAGE
GRID_ACTIVE = RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED

OLD = 3.0
"""Age of a button press, in seconds, above which race control mentions it."""


class EventKind(enum.Enum):
    """The kinds of event, which `RaceEvent.msg` explains."""

    COMMAND = 'COMMAND'
    RACE_STATE = 'RACE_STATE'
    KART_STATE = 'KART_STATE'
    DELIVERED = 'DELIVERED'
    ACKNOWLEDGED = 'ACKNOWLEDGED'
    REPORTED = 'REPORTED'
    CONNECTED = 'CONNECTED'
    DISCONNECTED = 'DISCONNECTED'
    REFUSED_CONNECTION = 'REFUSED_CONNECTION'
    MALFORMED = 'MALFORMED'
    LINK_GRADE = 'LINK_GRADE'
    ALERT_RAISED = 'ALERT_RAISED'
    ALERT_CLEARED = 'ALERT_CLEARED'
    ALL_ACKNOWLEDGED = 'ALL_ACKNOWLEDGED'
    WITHDRAWN = 'WITHDRAWN'
    ORDER_OF_FINISH = 'ORDER_OF_FINISH'
    ENDED = 'ENDED'


class AlertKind(enum.Enum):
    """The kinds of alert, which `Alert.msg` explains."""

    NOT_READY = 'NOT_READY'
    GREEN_UNACKNOWLEDGED = 'GREEN_UNACKNOWLEDGED'
    FLAG_UNACKNOWLEDGED = 'FLAG_UNACKNOWLEDGED'
    RED_UNACKNOWLEDGED = 'RED_UNACKNOWLEDGED'
    KART_LOST = 'KART_LOST'
    LOST_IN_MOTION = 'LOST_IN_MOTION'
    TRACK_UNSAFE = 'TRACK_UNSAFE'
    MOVING_UNASKED = 'MOVING_UNASKED'
    RECORD_FAILING = 'RECORD_FAILING'
    TWO_RACE_CONTROLS = 'TWO_RACE_CONTROLS'
    LINK_POOR = 'LINK_POOR'
    TWO_PROGRAMS = 'TWO_PROGRAMS'
    NOBODY_THERE = 'NOBODY_THERE'
    BUTTON_FAULT = 'BUTTON_FAULT'
    # The ROS half raises these two; the rules do not know about them.
    PART_FAILED = 'PART_FAILED'
    GRAPH_TROUBLE = 'GRAPH_TROUBLE'


MSR_ALERTS = frozenset(
    {
        AlertKind.FLAG_UNACKNOWLEDGED,
        AlertKind.RED_UNACKNOWLEDGED,
        AlertKind.LOST_IN_MOTION,
        AlertKind.TRACK_UNSAFE,
    }
)
"""Alerts that call for the Master Safety Remote (§2.B), until an official records its use."""


class Doubt(enum.IntEnum):
    """
    Why a kart may be unsafe, from least to most dangerous.

    ``GRID``: the kart was sent GRID_ACTIVE, and has not since been sent IN_GARAGE while connected.
    ``MOVING``: the kart was sent GREEN_GREEN or a red state, or was seen to move: it withdrew its
    acknowledgement of a red state, or reported GREEN_GREEN without being sent it.
    """

    NONE = 0
    GRID = 1
    MOVING = 2


class Heat(NamedTuple):
    """A heat in the roster; see `Heat.msg`."""

    name: str
    karts: tuple[int, ...]


class Entrant(NamedTuple):
    """A kart as the roster lists it; ``Kart`` explains the fields."""

    number: int
    team: str
    in_race: bool
    inspected: str = ''
    address: str = ''


class Roster(NamedTuple):
    """The part of the roster that the rules use. Numbers and addresses are unique."""

    karts: tuple[Entrant, ...]
    heats: tuple[Heat, ...] = ()


class Command(NamedTuple):
    """
    An official's command (§4.B).

    The service types explain the fields not listed here; ``run``, ``race`` and ``attempt`` are in
    `KartFinish.srv`. No rule depends on ``official`` or ``age``.

    :param kart: number of the kart; 0 for a command to the race, to all karts or to the track.
    :param statement: whether the official makes the statement that the command requires.
    :param karts: the karts that the command starts or releases, as the official saw them.
    :param hold: for the release of one kart, its hold as the official saw it.
    :param opening: for GRID_ACTIVE, which closes the track, the last opening of the track that the
        official saw (``TrackAccess.opening``).
    :param roster: for READ_ROSTER and TAKE_ROSTER, the roster that the file contains now.
    """

    kind: CommandKind
    kart: int = 0
    statement: bool = False
    karts: frozenset[int] = frozenset()
    hold: RaceState | None = None
    heat: str = ''
    official: str = ''
    run: str = ''
    race: int = 0
    attempt: int = 0
    opening: int = 0
    roster: Roster = Roster(())
    reading: int = 0
    age: float = 0.0

    @property
    def pressed(self) -> str:
        """Return a phrase that says how long ago an old press was made; empty if it is recent."""
        return f'pressed {self.age:.0f} s ago' if self.age > OLD else ''


@dataclass(frozen=True)
class Answer:
    """The reply to an official: whether the command was accepted, and one sentence about it."""

    success: bool
    message: str


class Attendance(NamedTuple):
    """The programs from which an official can stop the race; `Race.msg` explains the fields."""

    able_to_stop: int = 0
    who_can_stop: str = ''
    button_fault: str = ''


class Order(NamedTuple):
    """
    A state to send to a kart at once, and again with every beat (§4.C).

    :param serial: number that rises with every order to this kart. A report from the kart counts
        for this order only if it was received under this number.
    """

    kart: int
    state: RaceState
    serial: int


class Event(NamedTuple):
    """
    Something that happened. `RaceEvent.msg` explains the fields.

    :param chatter: whether a kart can cause any number of these events by itself. The server may
        publish only some of them.
    """

    kind: EventKind
    text: str
    kart: int = 0
    state: RaceState | None = None
    command: CommandKind | None = None
    success: bool = True
    chatter: bool = False
    official: str = ''
    alert: AlertKind | None = None
    after: float = 0.0
    grade: Grade | None = None
    place: int = 0
    race: int = 0
    heat: str = ''


class StampedEvent(NamedTuple):
    """
    An event, with the number and times that the kart server adds.

    :param sequence: number of the event in this run of race control, from 1 without gaps.
    :param wall_ns: wall time, in ns since the epoch.
    :param monotonic: time in seconds by the rules' clock.
    """

    sequence: int
    wall_ns: int
    monotonic: float
    event: Event


class Outcome(NamedTuple):
    """
    The result of one input: the orders to send and the events that happened.

    :param answer: the answer, if the input was a command.
    """

    orders: tuple[Order, ...]
    events: tuple[Event, ...]
    answer: Answer | None = None


@dataclass(frozen=True)
class Alert:
    """A condition that an official must act on. `Alert.msg` explains the fields."""

    kind: AlertKind
    kart: int
    since: float
    text: str
    use_msr: bool

    @property
    def told(self) -> str:
        """Return the text, with the advice to use the MSR if ``use_msr`` is set."""
        return f'Use the MSR. {self.text}' if self.use_msr else self.text


class Availability(NamedTuple):
    """Whether a command would be accepted now. `CommandAvailability.msg` explains the fields."""

    command: CommandKind
    available: bool
    reason: str = ''
    statement: str = ''
    available_from: float | None = None
    karts: tuple[int, ...] = ()


@dataclass(frozen=True)
class TrackAccess:
    """Whether humans may be on the track (§3.A). `TrackAccess.msg` explains the fields."""

    open: bool  # noqa: A003 - the message's name
    allowed: bool
    reason: str
    msr_used: bool
    opening: int = 0
    settled_by: CommandKind | None = None


LEAST_PAUSE = 1.0
"""Minimum value of the parameter ``pause``, in seconds."""


@dataclass(frozen=True)
class RaceTimes:
    """
    The times of the rules, in seconds. ``ros.settings`` explains those that are parameters.

    :param finish_delays: see §4.B, FINISH. The longest delay comes first, so that karts that
        finish later find the line clear.
    :param pause_after_stall: the pause after a stall of race control, and after a start without
        proof, because commands that were sent before may arrive late (we have seen DDS deliver
        some 3 s late). If ``pause`` is longer, ``pause`` applies instead.
    """

    finish_delays: tuple[float, ...] = (6.0, 5.0, 4.0, 3.0, 2.0, 1.0)
    finish_stop: float = 15.0
    auto_race_over: bool = True
    ready_alert: float = 120.0
    green_alert: float = 30.0
    flag_alert: float = 15.0
    red_alert: float = 5.0
    pause: float = 1.0
    pause_after_stall: float = 5.0
    settle_time: float = 3.0
    require_inspection: bool = False
    nobody_there: float = 10.0

    def finish_delay(self, place: int) -> float:
        """Return the delay in seconds for a finishing place (from 1)."""
        return self.finish_delays[min(place, len(self.finish_delays)) - 1]


def called(number: int, team: str) -> str:
    """Return the name that officials use for a kart."""
    return f'kart {number} ({team})' if team else f'kart {number}'


@dataclass(slots=True)
class Kart:
    """
    One kart in the roster. Only the rules write to it; all other code reads it.

    The first fields are those of its ``Entrant``. `KartStatus.msg` explains the fields not listed
    here. Times are in seconds.

    :param address: IPv4 address from which it connects; empty if it is no longer in the roster.
    :param sent_since: when ``sent`` was first commanded. A reconnection does not change it.
    :param serial: serial number of its current order.
    :param acknowledged: whether it has acknowledged its current order and has not withdrawn that
        acknowledgement since.
    :param lost: whether it lost its connection in a race under way or while it was in doubt. If it
        may have been moving, this remains true until the doubt ends.
    :param held_alone: whether an official has held this kart individually and not released it.
    :param ordered_at: time of its current order. Like ``delivered_after``, ``acknowledged_after``
        and ``link``, it is for officials: nothing but alerts and texts depends on it.
    :param contested: whether two programs are connecting as this kart, each displacing the other.
    :param went_silent_at: when it last lost its connection because its link stopped answering;
        None if it has a connection, or lost it in another way.
    :param link_poor_at: when its link was last measured as poor; None if it never was.
    """

    number: int
    team: str = ''
    in_race: bool = False
    inspected: str = ''
    address: str = ''
    connected: bool = False
    hold: RaceState | None = None
    hold_reason: str = ''
    sent: RaceState = IN_GARAGE
    sent_since: float = 0.0
    serial: int = 0
    acknowledged: bool = False
    reported: RaceState | None = None
    doubt: Doubt = Doubt.NONE
    settles_at: float | None = None
    lost: bool = False
    place: int = 0
    attempt: int = 0
    flag_at: float | None = None
    held_alone: bool = False
    counts_at: float | None = None
    ordered_at: float = 0.0
    delivered_after: float | None = None
    acknowledged_after: float | None = None
    link: LinkQuality = NOT_MEASURED
    link_poor_at: float | None = None
    contested: bool = False
    went_silent_at: float | None = None

    def __str__(self) -> str:
        """Return the name that officials use for this kart."""
        return called(self.number, self.team)

    @property
    def may_be_moving(self) -> bool:
        """Return whether officials must treat the kart as moving."""
        return self.doubt is Doubt.MOVING

    @property
    def stopped(self) -> bool:
        """Return whether the kart is being sent a red state it acknowledged on this connection."""
        return self.acknowledged and self.sent.is_red

    @property
    def stands(self) -> bool:
        """Return whether the kart has reported its stop long enough for humans to rely on it."""
        return self.stopped and self.doubt is Doubt.NONE and self.settles_at is None

    @property
    def away_at_rest(self) -> bool:
        """Return whether the kart is away, but was neither lost nor held individually."""
        return not (self.connected or self.lost or self.held_alone)

    @property
    def bound(self) -> str:
        """Return why the roster must keep the kart and its address; empty if it may drop them."""
        if self.connected:
            return 'is connected'
        if self.hold is not None or self.doubt:
            return 'is held, or may be moving'
        return 'is contested by two programs' if self.contested else ''

    @property
    def stopped_itself(self) -> bool:
        """Return whether the kart stopped itself (`KartStatus.msg`). Do not rely on that stop."""
        return self.reported is RED_RED and self.sent in (GRID_ACTIVE, GREEN_GREEN)

    @property
    def answered(self) -> bool:
        """Return whether the kart has carried out its order, so that the race may continue."""
        return self.stands if self.sent.is_red else self.acknowledged


class LastRun(enum.Enum):
    """
    How the previous run of race control on this machine and port ended, if known.

    ``NONE``: no earlier run is known. ``ENDED``: it ended normally with nothing under way, held or
    in doubt, and with the track closed. ``ENDED_OPEN``: as ``ENDED``, but with the track open.
    ``UNKNOWN``: a run began and it is not known how it ended, or it is uncertain whether there was
    a run at all. The values are the texts of the machine's mark (``run_mark``).
    """

    NONE = 'none'
    ENDED = 'ended'
    ENDED_OPEN = 'ended, track open'
    UNKNOWN = 'began'


@dataclass(frozen=True)
class KartMemory:
    """What race control saves about one kart. ``Kart`` explains the fields."""

    in_race: bool
    held: bool
    place: int
    doubt: Doubt
    held_alone: bool


@dataclass(frozen=True)
class RaceMemory:
    """
    What race control saves about a race, for the next run.

    :param karts: each kart in the roster, by its number.
    :param track_open: whether officials have opened the track.
    :param unstated: whether race control is still waiting for an official to state that no race is
        under way anywhere.
    :param heat: the heat that was last put into the race; empty if there was none.
    :param starters: ``Race.starters``.
    :param gridded: how many orders had sent a kart GRID_ACTIVE in the run that saved it.
    """

    state: RaceState
    karts: Mapping[int, KartMemory]
    track_open: bool = False
    unstated: bool = False
    heat: str = ''
    starters: tuple[int, ...] = ()
    gridded: int = 0

    @property
    def at_rest(self) -> bool:
        """Return whether nothing is under way, held or in doubt."""
        return self.state is IN_GARAGE and not any(
            kart.held or kart.doubt for kart in self.karts.values()
        )

    @property
    def ends_as(self) -> LastRun:
        """Return what the next run learns if this run ends normally in its present condition."""
        if not self.at_rest:
            return LastRun.UNKNOWN
        if self.unstated:
            return LastRun.NONE
        return LastRun.ENDED_OPEN if self.track_open else LastRun.ENDED


class Race:
    """
    The state of one race and of every kart in the roster (§3, §4.B).

    Each input is a method that returns the orders to send and the events that happened
    (``inputs.feed`` calls these methods). Times never go backwards. An input about a kart raises
    KeyError if the roster has no such kart.

    :param now: current time, in seconds.
    :param karts: karts with different numbers.
    :param run: id of this run of race control.
    """

    def __init__(
        self,
        karts: Iterable[Kart],
        times: RaceTimes = RaceTimes(),
        now: float = 0.0,
        heats: Iterable[Heat] = (),
        run: str = '',
    ) -> None:
        """Begin in IN_GARAGE (§3.B)."""
        self.times = times
        self.run = run
        self.karts = {kart.number: kart for kart in karts}
        for kart in self.karts.values():
            kart.sent_since = now
        self.heats = tuple(heats)
        self.reading = 0
        """Number of the roster that was read but not taken yet; 0 if there is none."""
        self._readings = 0
        self._read = Roster(())
        self.state = IN_GARAGE
        self.state_since = now
        self.state_cause = ''
        """A phrase that says why the race is in its state; empty until its state first changes."""
        self.over = False
        self.starters: tuple[int, ...] = ()
        """Karts sent GREEN_GREEN in the race whose order of FINISH has not been reported yet."""
        self.grid_was_last = False
        self.grids = 0
        """Number of times that GRID_ACTIVE was accepted."""
        self.number = 0
        """Number of the race under way, from GRID_ACTIVE to IN_GARAGE; 0 if there is none."""
        self.race_since: float | None = None
        """The time in seconds when the last race of this run began; None if there was no race."""
        racing = {each.number for each in self.racing()}
        alike = [heat.name for heat in self.heats if {*heat.karts} == racing]
        self._put_in = alike[0] if len(alike) == 1 else ''  # the heat that was last put in
        self.track_open = False
        self.opening = 0
        """Number of the last opening of the track in this run; 0 if there was none."""
        self._opened = '', now  # by whom or why, as a phrase, and when (s)
        self.msr_used = False
        self.past_unknown = False
        """True until IN_GARAGE if race control does not know what happened before it started, or
        while it was cut off."""
        self.unstated = False
        """Whether an official must still state that no race is under way anywhere."""
        self.has_rival = False
        self.cut_off_by = ''
        """What cuts race control off from the karts' network, as a phrase; empty if nothing."""
        self.record_fails = ''
        self.there = Attendance()
        self.nobody_since: float | None = None
        """The time in seconds when this race lost the last program that could stop it. None while
        there is such a program, or if this race has not lost one."""
        self.paused_until = now
        """The time in seconds when the current pause ends, or when the last pause ended."""
        self._paused_by = ''
        self._gridded = 0  # how many orders have sent a kart GRID_ACTIVE
        self._saved = 0  # the same, in the memory that is on the disk
        self._reported_all_answered = False
        self._by: Command | None = None  # the command that is taking effect
        self._alerts: dict[tuple[AlertKind, int], Alert] = {}
        self._orders: list[Order] = []
        self._events: list[Event] = []

    def memory(self, ended: bool = False) -> RaceMemory:
        """
        Return what race control must save.

        The karts on the grid count as moving, because GREEN_GREEN may be next.

        :param ended: whether this run has ended, so that no GREEN_GREEN can follow.
        """
        may_start = self.state is GRID_ACTIVE and not ended
        karts = {
            number: KartMemory(
                kart.in_race,
                kart.hold is not None,
                kart.place,
                Doubt.MOVING if may_start and kart.in_race and kart.doubt else kart.doubt,
                kart.held_alone,
            )
            for number, kart in self.karts.items()
        }
        return RaceMemory(
            *(self.state, karts, self.track_open, self.unstated, self._put_in),
            *(self.starters, self._gridded),
        )

    def recover(
        self, memory: RaceMemory | None, last_run: LastRun, now: float, why: str = ''
    ) -> Outcome:
        """
        Restore the race from what the last run saved; call this before any other input.

        Unless the last run ended normally with nothing under way, or no earlier run is known, the
        race resumes as after ALL_KILL: a stop never waits for the disk, so it may be unsaved.

        :param memory: what the record contains; None if it contains nothing.
        :param why: a phrase that says why race control rejects the proof that the last run ended
            normally; empty if race control does not reject it.
        """
        if last_run is not LastRun.UNKNOWN and (memory is None or memory.at_rest):
            if last_run is LastRun.ENDED_OPEN:
                self._count_opening('before race control was restarted', now)
            self.unstated = last_run is LastRun.NONE
            return self._outcome()
        memory = memory or RaceMemory(RED_RED, {})
        self._put_in = memory.heat
        for number, before in memory.karts.items():
            kart = self.karts.get(number)
            if kart is None:
                if not (before.in_race or before.held or before.doubt):
                    continue
                kart = self.karts[number] = Kart(number, 'no longer in the roster')
                text = f'{kart} is held in RED_RED; find it, make it safe, then release it '
                self._add_event(EventKind.KART_STATE, f'{text}individually', number, RED_RED)
            else:
                kart.in_race = before.in_race
            kart.place = before.place
            kart.doubt = before.doubt
            kart.held_alone = before.held_alone
            kart.lost = bool(kart.doubt)
        self.starters = tuple(number for number in memory.starters if number in self.karts)
        self.grids = self.number = int(bool(self.starters))
        cause = 'race control has started and does not know what happened before that'
        cause += f': {why}' if why else ''
        self._lose_track('since race control started', cause, now, late=True)
        return self._outcome()

    def _lose_track(self, held: str, cause: str, now: float, late: bool = False) -> None:
        """Assume the worst about everything, because race control does not know what happened."""
        self._pause(cause, now, late)
        self.past_unknown = True
        self._count_opening(cause, now)
        self.msr_used = False
        for kart in self.karts.values():
            self._hold(kart, RED_RED, held, now)
        self._go(RED_RED, now, cause)

    def _count_opening(self, how: str, now: float) -> None:
        self.track_open = True
        self.opening += 1
        self._opened = how, now

    # ----- inputs -------------------------------------------------------------------------

    def command(self, command: Command, now: float, came: float | None = None) -> Outcome:
        """
        Judge an official's command and, if it is allowed, put it into effect (§4.B).

        A refused command changes nothing, except that a stop begins a pause even if its kart is
        not in the roster.

        :param came: the time in seconds when the command arrived; None if it arrived just now.
        :returns: an outcome with the answer.
        """
        kind, entry = command.kind, CATALOGUE[command.kind]
        if entry.stop:
            # Another official may have sent a release without having seen this stop, and it may
            # arrive after the stop. It must not undo the stop.
            self._pause('a stop was sent just now', now)
        refusal = self._refusal_of(command, now if came is None else came)
        answer = Answer(False, f'{kind.value} refused: {refusal}.')
        self._by = command
        if not refusal:
            if not entry.bookkeeping:
                self.grid_was_last = kind is CommandKind.GRID_ACTIVE
            pressed = f' {kind.value} was {command.pressed}.' if command.pressed else ''
            effect = COMMANDS[kind].effect(self, command, now)
            answer = Answer(True, _capital(f'{effect}.{pressed}'))
        after = command.age if command.pressed else 0.0
        self._add_event(
            EventKind.COMMAND, answer.message, command.kart, success=answer.success, after=after
        )
        self._events.insert(0, self._events.pop())  # the command comes before its effects
        self._by = None
        return self._outcome(answer)

    def saved(self, gridded: int) -> Outcome:
        """Record that a memory with this ``RaceMemory.gridded`` is on the disk."""
        self._saved = gridded
        return self._outcome()

    def stalled(self, seconds: float, now: float) -> Outcome:
        """
        Record that race control stalled, so commands that arrive now may have been sent long ago.

        Race control has not yet read what karts reported during the stall, nor noticed which karts
        have gone, so each ``settle_time`` that has not ended starts again.
        """
        for kart in (each for each in self.karts.values() if each.settles_at is not None):
            kart.settles_at = now + self.times.settle_time
        self._pause(f'race control stalled for {seconds:.1f} s', now, late=True)
        return self._outcome()

    def cut_off(self, reason: str, now: float) -> Outcome:
        """
        Record that race control has lost the karts' network, or has regained it.

        A loss is treated like a crash. Until the network is back, another race control may command
        the karts, so this one refuses commands that loosen.

        :param reason: what is lost, as a phrase; empty once the network is back.
        """
        if reason and not self.cut_off_by:
            self._cut_off(reason, now)
        self.cut_off_by = reason
        return self._outcome()

    def _cut_off(self, reason: str, now: float) -> None:
        cause = f'race control was cut off from the karts ({reason})'
        self._lose_track('race control was cut off', cause, now)

    def contested(self, number: int, contested: bool, now: float) -> Outcome:
        """Record whether two programs keep connecting as one kart."""
        self.karts[number].contested = contested
        return self._outcome()

    def _pause(self, why: str, now: float, late: bool = False) -> None:
        """Begin a pause, which is longer if commands may have been sent long ago."""
        until = now + max(self.times.pause, late * self.times.pause_after_stall)
        if until > self.paused_until:
            self.paused_until = until
            self._paused_by = why

    def _refusal_of(self, command: Command, came: float) -> str:
        """Return why a command that arrived at `came` is refused; empty if it is allowed."""
        kind, entry = command.kind, CATALOGUE[command.kind]
        if entry.to_one_kart and command.kart not in self.karts:
            numbers = ', '.join(map(str, sorted(self.karts))) or 'no kart'
            has = f'the roster has no kart {command.kart}; it has {numbers}'
            return f'{has}; ALL_KILL stops every kart'
        offered = self.availability(kind, command.kart, came)
        if not offered.available:
            return offered.reason
        if offered.statement and not command.statement:
            wait = ''
            if 'hold' in entry.takes:
                kart = self.karts[command.kart]
                wait = f'{kart}: {self._silence(kart)}. Wait for it, or '
            return f'{wait}state that {offered.statement}'
        return self._misnamed(command, {*offered.karts}, came)

    def connected(self, number: int, now: float) -> Outcome:
        """
        Record a kart's new connection (§3.B, §4.A).

        If the kart is still connected, the new connection replaces the old one, and the loss of
        the old one is recorded first.
        """
        kart = self.karts[number]
        if kart.connected:
            self._drop(kart, 'a new connection from its address replaced it', now)
        kart.connected = True
        if not kart.may_be_moving:
            kart.lost = False
        kart.went_silent_at = None
        self._add_event(EventKind.CONNECTED, f'{kart} connected', number, chatter=kart.contested)
        self._redirect(kart, now, resend=True)
        return self._outcome()

    def disconnected(self, number: int, reason: str, now: float, silent: bool = False) -> Outcome:
        """
        Record that a kart's connection is gone (§3.E, §4.D).

        :param reason: why the connection ended, for the officials.
        :param silent: whether its link stopped answering, and neither side closed the connection.
        """
        kart = self.karts[number]
        if kart.connected:
            self._drop(kart, reason, now)
            if silent:
                kart.went_silent_at = now
                self._check_whether_all_went_silent(kart, now)
        return self._outcome()

    def _check_whether_all_went_silent(self, lost: Kart, now: float) -> None:
        """Treat race control as cut off if it has lost every kart in the race at once."""
        in_garage = self.state is IN_GARAGE
        if self.state is RED_RED or not (lost.in_race or in_garage):
            return  # in RED_RED there is nothing to stop, and teams switch their karts off
        everyone = list(self.karts.values())
        concerned = [each for each in everyone if each.in_race or in_garage]
        silent = [
            each
            for each in concerned
            if each.went_silent_at is not None and each.went_silent_at >= now - LOST_AT_ONCE
        ]
        # One silent kart is not enough while any other kart is connected. In the garage it is
        # never enough, because a team may disconnect its kart's battery.
        if len(silent) == 1:
            concerned = everyone
        if len(silent) > in_garage and not any(each.connected for each in concerned):
            self._cut_off(f'no kart answers: {_listed(silent)}', now)

    def heard(
        self, number: int, serial: int, state: RaceState, now: float, counts_in: float = 0.0
    ) -> Outcome:
        """
        Judge what a kart reports: an acknowledgement, or any other report (§3.A, §4.C).

        A kart withdraws its acknowledgement when it reports another state. That report may be an
        old one, but then the acknowledgement may have been just as old.

        :param serial: serial of the order that had been sent when the frame began to arrive.
        :param counts_in: if the report does not count yet, the maximum time in seconds before a
            repeat of it would count; 0 if unknown, or if no repeat would ever count.
        """
        kart = self.karts[number]
        if not kart.connected:
            return self._outcome()
        before, kart.reported = kart.reported, state
        counts = state is kart.sent and serial == kart.serial
        if counts and not kart.acknowledged:
            again = kart.acknowledged_after is not None
            kart.acknowledged = True
            kart.counts_at = None
            if not again:
                kart.acknowledged_after = now - kart.ordered_at
            if state.is_red:
                kart.settles_at = now + self.times.settle_time
                self._settle(kart, now)
            # The next tick reports when all have acknowledged; checking here would cost O(N²).
            # IN_GARAGE asks for no acknowledgement (§3.A).
            did = 'reports' if state is IN_GARAGE else 'acknowledged'
            text = f'{kart} {did} {state.value}'
            self._add_event(EventKind.ACKNOWLEDGED, text, number, state, chatter=again)
        elif kart.acknowledged and state is not kart.sent:
            kart.acknowledged = False
            kart.settles_at = None
            if kart.sent.is_red:
                kart.doubt = Doubt.MOVING
            taken_back = f'its acknowledgement of {kart.sent.value} no longer counts'
            text = f'{kart} reports {state.value}, so {taken_back}'
            self._add_event(EventKind.WITHDRAWN, text, number, state, chatter=True)
        elif state is not kart.sent:
            kart.counts_at = None
            if state is not before:
                text = f'{kart} reports {state.value} while being sent {kart.sent.value}'
                self._add_event(EventKind.REPORTED, text, number, state, chatter=True)
        elif not kart.acknowledged and state is not IN_GARAGE:
            if kart.counts_at is None:
                text = f'{kart} {self._silence(kart)}'
                self._add_event(EventKind.REPORTED, text, number, state, chatter=True)
            kart.counts_at = now + counts_in
        if state is GREEN_GREEN and kart.sent is not GREEN_GREEN:
            kart.doubt = Doubt.MOVING
        return self._outcome()

    def delivered(self, number: int, serial: int, answered: float, now: float) -> Outcome:
        """
        Record that a kart's kernel has answered an order, which its program may not have read yet.

        :param serial: serial of the order. If there is a newer order, nothing happens.
        :param answered: the latest time in seconds at which the kernel can have answered.
        """
        kart = self.karts[number]
        if kart.connected and serial == kart.serial and kart.delivered_after is None:
            kart.delivered_after = after = max(answered - kart.ordered_at, 0.0)
            text = f"{kart.sent.value} reached {kart}'s computer after {after:.2f} s"
            self._add_event(EventKind.DELIVERED, text, number, kart.sent, after=after)
        return self._outcome()

    def measured(self, number: int, link: LinkQuality, now: float) -> Outcome:
        """Record the quality of a kart's link, which is for officials only and changes nothing."""
        kart = self.karts[number]
        if not kart.connected:
            return self._outcome()
        before, kart.link = kart.link, link
        if link.grade is Grade.POOR:
            kart.link_poor_at = now
        if before.grade is not link.grade:
            why = '' if link.grade is Grade.GOOD else f': the kart {link.delay}'
            text = f'The link to {kart} is {link.grade.value}{why}'
            self._add_event(EventKind.LINK_GRADE, text, number, grade=link.grade)
        return self._outcome()

    def rival(self, present: bool, now: float) -> Outcome:
        """Record whether another race control is running on the officials' network."""
        self.has_rival = present
        return self._outcome()

    def attended(self, there: Attendance, now: float) -> Outcome:
        """Record the programs from which officials can now stop the race."""
        if there.able_to_stop:
            self.nobody_since = None
        elif self.there.able_to_stop:
            self.nobody_since = now
        self.there = there
        return self._outcome()

    def record_trouble(self, text: str, now: float) -> Outcome:
        """Keep a sentence that says why the record is failing; empty if the record works."""
        self.record_fails = text
        return self._outcome()

    def tick(self, now: float) -> Outcome:
        """
        Do everything that is now due.

        This sends RED_FLAG to each kart whose finish is due, ends a race that all karts have
        finished, and stops a race that officials can no longer stop. It also reports alerts, which
        by themselves change nothing.
        """
        for kart in self.karts.values():
            self._settle(kart, now)
            if kart.flag_at is not None and now >= kart.flag_at:
                kart.flag_at = None
                # This reason stays true if places move up or the finish is undone later.
                self._hold(kart, RED_FLAG, 'marked as finished', now)
        if self._all_have_finished(now):
            self.over = True
            self._go(RED_RED, now, 'race over (all karts have finished)')
            self._report_order_of_finish()
        since, limit = self._unattended_since(), self.times.nobody_there
        if since is not None and limit and now >= since + limit:
            self._pause('race control has just stopped the race', now)
            self._go(RED_FLAG, now, f'race control was not {IN_CONTACT}')
        self._report_all_answered()
        self._report_alerts(now)
        return self._outcome()

    # ----- what officials see -------------------------------------------------------------

    def availability(self, kind: CommandKind, number: int, now: float) -> Availability:
        """
        Return whether a command arriving now would be accepted, or why it would be refused.

        :param number: number of the kart, for a command to one kart; otherwise 0.
        :raises KeyError: if the command is to one kart and the roster has no such kart.
        """
        rule = COMMANDS[kind]
        kart = self.karts[number] if CATALOGUE[kind].to_one_kart else NO_KART
        reason = next(filter(None, self._refusals(kind, kart)), '')
        if reason:
            return Availability(kind, False, reason)
        # A reason from the rules is more useful to the official than a mention of the pause.
        if CATALOGUE[kind].loosens and now < self.paused_until:
            paused = f'{self._paused_by}. Check the race, then send this command again'
            return Availability(kind, False, paused, available_from=self.paused_until)
        karts = tuple(sorted(each.number for each in rule.karts(self, kart)))
        return Availability(kind, True, statement=rule.statement(self, kart), karts=karts)

    def alerts(self, now: float) -> list[Alert]:
        """Return the current alerts, newest first. Each began when a tick first reported it."""
        alerts = []
        for kind, number, text in self._current_alerts(now):
            reported = self._alerts.get((kind, number))
            since = reported.since if reported else now
            use_msr = kind in MSR_ALERTS and not self.msr_used
            if kind is AlertKind.TRACK_UNSAFE:
                # A kart that has acknowledged its stop obeys without the MSR.
                doubtful = (each for each in self.karts.values() if each.doubt)
                use_msr = use_msr and not all(each.stopped for each in doubtful)
            alerts.append(Alert(kind, number, since, _capital(text), use_msr))
        alerts.sort(key=lambda alert: alert.since, reverse=True)
        return alerts

    def track_access(self) -> TrackAccess:
        """Return whether humans may be on the track now, and why or why not (§3.A)."""
        allowed, settled_by = False, None
        if self.msr_used:
            allowed, reason = True, 'the Master Safety Remote was used'
        elif self.state in (GRID_ACTIVE, GREEN_GREEN):
            reason = f'the race is in {self.state.value}'
        elif unsafe := self._dangers(
            each for each in self.karts.values() if not self._covered_by_statement(each)
        ):
            reason = unsafe
        elif self.past_unknown:
            settled_by = CommandKind.IN_GARAGE
            reason = (
                'race control does not know what happened: look at every kart, then send IN_GARAGE'
            )
        elif self.unstated:
            settled_by = CommandKind.OPEN_TRACK
            reason = f'an official must state that {NO_RACE_ANYWHERE}; OPEN_TRACK asks for this'
        elif not any(kart.connected for kart in self.karts.values()):
            allowed = True
            reason = 'no kart is connected, so race control does not know what the karts are doing'
        else:
            allowed = True
            reason = 'every connected kart is in IN_GARAGE or has acknowledged its stop'
        return TrackAccess(
            self.track_open, allowed, reason, self.msr_used, self.opening, settled_by
        )

    # ----- what a kart is sent ------------------------------------------------------------

    def _commanded(self, kart: Kart) -> RaceState:
        own = self.state if kart.in_race else IN_GARAGE
        return own if kart.hold is None else stricter(own, kart.hold)

    def _redirect(self, kart: Kart, now: float, resend: bool = False) -> None:
        """Send a kart the state that the race and its hold require; void its acknowledgement."""
        state = self._commanded(kart)
        changed = state is not kart.sent
        if not (changed or resend):
            return
        if changed:
            kart.sent = state
            kart.sent_since = now
        kart.serial += 1
        kart.ordered_at = now
        self._void_answers(kart)
        if kart.connected:
            if state is GRID_ACTIVE:
                kart.doubt = max(kart.doubt, Doubt.GRID)
                self._gridded += 1
            elif state is IN_GARAGE:
                kart.doubt = Doubt.MOVING if kart.may_be_moving else Doubt.NONE
            elif not self._covered_by_statement(kart):
                # This order tells the kart to race, or it tells the kart to stop and the kart has
                # not confirmed that yet. A kart that the statement covers is different: race
                # control sends it RED_RED only because it may have missed something.
                kart.doubt = Doubt.MOVING
            self._orders.append(Order(kart.number, state, kart.serial))
            text = f'{kart} is being sent {state.value}'
            chatter = kart.contested and resend
            self._add_event(EventKind.KART_STATE, text, kart.number, state, chatter=chatter)

    def _void_answers(self, kart: Kart) -> None:
        """Forget how a kart answered its order, which is over or has lost its connection."""
        kart.acknowledged = False
        kart.delivered_after = kart.acknowledged_after = None
        kart.counts_at = kart.settles_at = None

    def _hold(
        self, kart: Kart, hold: RaceState, reason: str, now: float, alone: bool = False
    ) -> None:
        # A kart that an official stops is no longer covered, unless it has confirmed a stop.
        unconfirmed = kart.connected and not kart.stopped and self._covered_by_statement(kart)
        if unconfirmed and self._by is not None:
            kart.doubt = Doubt.MOVING
        before = kart.hold, kart.held_alone
        kart.hold = hold if kart.hold is None else stricter(kart.hold, hold)
        kart.held_alone = kart.held_alone or alone
        if before != (kart.hold, kart.held_alone):
            kart.hold_reason += f'; {reason}' if kart.hold_reason else reason
        self._redirect(kart, now)

    def _unhold(self, kart: Kart) -> None:
        kart.hold = None
        kart.hold_reason = ''
        kart.held_alone = False
        kart.lost = False

    def _settle(self, kart: Kart, now: float) -> None:
        """End the doubt about a kart that has kept reporting its red state for long enough."""
        if kart.settles_at is not None and now >= kart.settles_at:
            self._end_doubt(kart)

    def _end_doubt(self, kart: Kart) -> None:
        kart.doubt = Doubt.NONE
        kart.settles_at = None
        kart.lost = False

    def _cause(self) -> str:
        """Return the command that is taking effect, and who sent it."""
        assert self._by is not None
        kind = self._by.kind.value.removeprefix('KART_')
        official = f' by {self._by.official}' if self._by.official else ''
        return ', '.join(filter(None, (f'{kind}{official}', self._by.pressed)))

    def _go(self, state: RaceState, now: float, why: str = '') -> str:
        """Bring the race into a state, and return which karts are now being sent that state."""
        if state is not self.state:
            self.state = state
            self.state_since = now
            self.state_cause = why or self._cause()
            self._reported_all_answered = False
            text = f'The race is in {state.value}: {self.state_cause}'
            self._add_event(EventKind.RACE_STATE, text, state=state)
        for kart in self.racing():
            self._redirect(kart, now)
        return f'{state.value} sent to {_receivers(k for k in self.racing() if k.sent is state)}'

    def _drop(self, kart: Kart, reason: str, now: float) -> None:
        kart.connected = False
        kart.reported = None
        kart.link = NOT_MEASURED
        self._void_answers(kart)
        under_way = kart.in_race and self.state is not IN_GARAGE
        if under_way or kart.doubt:
            kart.lost = True
        text = f'{kart} disconnected: {reason}'
        self._add_event(EventKind.DISCONNECTED, text, kart.number, chatter=kart.contested)
        if (under_way and self.state is not GRID_ACTIVE) or kart.may_be_moving:
            self._hold(kart, RED_RED, f'lost its connection in {self.state.value}', now)

    # ----- the effects of the commands ----------------------------------------------------

    def _all_kill(self, command: Command, now: float) -> str:
        cause = self._cause()
        for each in self.karts.values():
            self._hold(each, RED_RED, cause, now)
        self._go(RED_RED, now)
        return f'RED_RED sent to {_receivers(self.karts.values())}'

    def _red_flag(self, command: Command, now: float) -> str:
        if self.state is RED_RED:
            return 'The race is already in RED_RED, which is stricter than RED_FLAG'
        return self._go(RED_FLAG, now)

    def _grid_active(self, command: Command, now: float) -> str:
        if self.state is GRID_ACTIVE:
            return (
                'GRID_ACTIVE was repeated and is the latest command again. Karts that have '
                'already acknowledged it need not do so again'
            )
        self.grids += 1
        self.number = self.grids
        self.race_since = now
        self.track_open = False
        self.reading = 0
        self.nobody_since = None  # no program that could stop this race has been lost yet
        for each in self.karts.values():
            each.place = each.attempt = 0
        return self._go(GRID_ACTIVE, now)

    def _green_green(self, command: Command, now: float) -> str:
        self.starters = tuple(each.number for each in self.racing())
        return self._go(GREEN_GREEN, now)

    def _race_over(self, command: Command, now: float) -> str:
        self.over = True
        sent = self._go(RED_RED, now)
        self._report_order_of_finish()
        return f'Race over: {sent}'

    def _race_in_garage(self, command: Command, now: float) -> str:
        released = list(self._released_by_garage())
        for each in released:
            self._unhold(each)
        kept = [each for each in self.karts.values() if each.hold is not None]
        self.over = self.msr_used = False
        if self.past_unknown:
            self.past_unknown = self.unstated = False
        self._report_order_of_finish()  # of a race that was stopped and never declared over
        self._go(IN_GARAGE, now)
        for each in self.karts.values():
            each.flag_at = None
            self._redirect(each, now)
        message = f'IN_GARAGE sent to {_receivers(released)}'
        if kept:
            message += f'. Still held until released individually: {_listed(kept)}'
        return message

    def _open_track(self, command: Command, now: float) -> str:
        self._count_opening(f'by {command.official or "an official"}', now)
        self.unstated = False
        return f'The track is open to humans: {self.track_access().reason}'

    def _close_track(self, command: Command, now: float) -> str:
        self.track_open = False
        return 'The track is closed to humans'

    def _record_msr(self, command: Command, now: float) -> str:
        # The MSR's relay may restore power later; by then every kart must be held in RED_RED.
        sent = self._all_kill(command, now)
        self.msr_used = True
        return f'MSR use recorded. {sent}'

    def _stop_kart(self, command: Command, now: float) -> str:
        kart = self.karts[command.kart]
        hold = RED_RED if command.kind is CommandKind.KART_RED_RED else RED_FLAG
        self._hold(kart, hold, self._cause(), now, alone=True)
        absent = '' if kart.connected else ', but it is not connected'
        return f'{kart} is held in {kart.sent.value}{absent}'

    def _kart_finish(self, command: Command, now: float) -> str:
        kart = self.karts[command.kart]
        kart.place = 1 + max(each.place for each in self.karts.values())
        delay = self.times.finish_delay(kart.place)
        kart.flag_at = now + delay
        return f'{kart} finished as P{kart.place}; RED_FLAG follows in {delay:g} s'

    def _kart_undo_finish(self, command: Command, now: float) -> str:
        kart = self.karts[command.kart]
        place, kart.place = kart.place, 0
        kart.attempt += 1
        for each in self.karts.values():
            each.place -= each.place > place
        # This loosens no state that has been sent; it only cancels a RED_FLAG that has not been.
        kart.flag_at = None
        return f'{kart} no longer has a place, and is still being sent {kart.sent.value}'

    def _release_kart(self, command: Command, now: float) -> str:
        kart = self.karts[command.kart]
        self._unhold(kart)
        self._end_doubt(kart)
        kart.flag_at = None
        out = kart.in_race and self.state is not IN_GARAGE
        kart.in_race = kart.in_race and not out
        self._redirect(kart, now)
        return f'{kart} is released to IN_GARAGE{" and is out of the race" * out}'

    def _join_race(self, command: Command, now: float) -> str:
        kart = self.karts[command.kart]
        kart.in_race = True
        self._redirect(kart, now)
        return f'{kart} is in the race'

    def _leave_race(self, command: Command, now: float) -> str:
        kart = self.karts[command.kart]
        kart.in_race = False
        if self.state is not IN_GARAGE:
            self._hold(kart, RED_RED, 'taken out of the race on the grid', now)
        self._redirect(kart, now)
        return f'{kart} is out of the race and is being sent {kart.sent.value}'

    def _set_heat(self, command: Command, now: float) -> str:
        (heat,) = (each for each in self.heats if each.name == command.heat)
        for each in self.karts.values():
            each.in_race = each.number in heat.karts
            self._redirect(each, now)
        self._put_in = heat.name
        text = f'"{heat.name}" is now in the race ({_numbers(heat.karts)}), with no other karts'
        held = _held(self.racing())
        return text + (f'. Still held: {held}' if held else '')

    def _read_roster(self, command: Command, now: float) -> str:
        self._readings += 1
        self.reading, self._read = self._readings, command.roster
        return (
            f'The roster file was read (reading {self.reading}): {self._changes()}. '
            f'Nothing has changed yet. TAKE_ROSTER {self.reading} puts it into effect'
        )

    def _take_roster(self, command: Command, now: float) -> str:
        changes, self.reading = self._changes(), 0
        before, self.karts = self.karts, {}
        for each in self._read.karts:
            kart = before.pop(each.number, None) or Kart(*each, sent_since=now)
            kart.team, kart.inspected, kart.address = each.team, each.inspected, each.address
            self.karts[each.number] = kart
        # The new roster contains every bound kart that the old one contained.
        self.karts.update((number, kart) for number, kart in before.items() if kart.bound)
        self.heats = self._read.heats
        return f'The new roster is in effect: {changes}'

    # ----- why a command is refused -------------------------------------------------------

    def _refusals(self, kind: CommandKind, kart: Kart) -> Iterator[str]:
        """
        Yield why a command is refused now, whatever it names, with the most useful reason first.

        A reason that is empty does not apply. There is never a reason to refuse a stop.

        :param kart: the kart that the command is for; ``NO_KART`` if it is not for one kart.
        """
        if CATALOGUE[kind].loosens and self.has_rival:
            yield 'another race control is running; shut it down first. Every stop still works'
        if CATALOGUE[kind].loosens and self.cut_off_by:
            yield f'race control is still cut off from the karts: {self.cut_off_by}'
        if self.state not in COMMANDS[kind].states:
            possible = ' or '.join(state.value for state in COMMANDS[kind].states)
            text = f'the race is in {self.state.value}; {kind.value} is possible only in '
            cure = {
                CommandKind.IN_GARAGE: '. Send RACE_OVER or ALL_KILL first',
                CommandKind.LEAVE_RACE: '. Stop the kart with RED_RED instead',
            }.get(kind, '')
            yield f'{text}{possible}{cure * (self.state in (GREEN_GREEN, RED_FLAG))}'
        match kind:
            case CommandKind.KART_FINISH:
                if not kart.in_race:
                    yield f'{kart} is not in the race'
                if kart.place:
                    yield f'{kart} has already finished as P{kart.place}'
                if kart.hold is not None:  # so is a kart that lost its connection
                    yield f'{kart} is held: {kart.hold_reason}'
            case CommandKind.KART_UNDO_FINISH:
                if not kart.place:
                    yield f'{kart} has no place'
                if kart.number not in self.starters:
                    yield f'the order of FINISH already names {kart}; correct it at the timekeeper'
            case CommandKind.KART_IN_GARAGE if not kart.sent.is_red:
                sent, stop = kart.sent, '. Stop it with RED_RED first'
                text = f'{kart} is being sent {sent.value}; only a kart sent a red can be released'
                yield text + stop * (sent is not IN_GARAGE)
            case CommandKind.JOIN_RACE:
                if kart.in_race:
                    yield f'{kart} is already in the race'
                yield self._uninspected([kart])
            case CommandKind.LEAVE_RACE if not kart.in_race:
                yield f'{kart} is not in the race'
            case CommandKind.GRID_ACTIVE:
                yield self._uninspected(self.racing())
                yield from self._no_race()
            case CommandKind.GREEN_GREEN:
                if not self.grid_was_last:
                    yield 'another command was sent after GRID_ACTIVE; send GRID_ACTIVE again'
                yield from self._no_race()
                yield self._unanswered(self.racing())
                if self.nobody_since is not None:
                    what_to_do = 'open a window, or start again from IN_GARAGE'
                    yield f'race control is no longer {IN_CONTACT}; {what_to_do}'
                if self._saved != self._gridded:
                    yield 'race control is still saving who may start; send it again in a moment'
            case CommandKind.IN_GARAGE if self.state is GRID_ACTIVE:
                yield self._dangers(
                    each
                    for each in self.racing()
                    if each.may_be_moving or (each.doubt and not each.connected)
                )
            case CommandKind.IN_GARAGE:
                if missing := self._unanswered(self._waited_for()):
                    msr = 'use the MSR and record its use, or, if the kart is off the track, '
                    yield (
                        f'{missing}. If a kart does not answer, {"" if self.msr_used else msr}'
                        'make it safe by hand and release it individually'
                    )
            case CommandKind.OPEN_TRACK:
                access = self.track_access()
                if not access.allowed and access.settled_by is not CommandKind.OPEN_TRACK:
                    yield access.reason
            case CommandKind.SET_HEAT if not self.heats:
                yield "the roster has no heats; list them under 'heats:' and read it again"
            case CommandKind.TAKE_ROSTER:
                if not self.reading:
                    yield 'no roster is waiting to be taken; send READ_ROSTER first'
                yield self._bound(self._read)

    def _no_race(self) -> Iterator[str]:
        """Yield why no race can start, and so why GRID_ACTIVE and GREEN_GREEN are refused."""
        racing = list(self.racing())
        if not racing:
            yield 'no kart is in the race'
        if held := _held(racing):
            yield f'karts in the race are held; release them first: {held}'
        if contested := _listed(each for each in racing if each.contested):
            yield f'two programs keep connecting as {contested}; have the team stop one of them'
        yield self._dangers(
            each
            for each in self.karts.values()
            if each.may_be_moving or (each.doubt and not each.in_race)
        )
        if self.record_fails:
            yield (
                f'{self.record_fails}. A race cannot start without a record. Make room on the '
                'disk, or restart race control with the parameter record set to a path on another '
                'disk. As a last resort, use /dev/shm'
            )

    def _unanswered(self, karts: Iterable[Kart]) -> str:
        missing = [f'{each}: {self._silence(each)}' for each in karts if not each.answered]
        return f'waiting for {_cut(missing)}' if missing else ''

    def _uninspected(self, karts: Iterable[Kart]) -> str:
        if not self.times.require_inspection:
            return ''
        missing = _listed(each for each in karts if not each.inspected)
        text = f'not inspected: {missing}. Race without it; or inspect it, enter the date in the '
        return f'{text}roster and read the roster again' if missing else ''

    def _bound(self, roster: Roster) -> str:
        """Return which karts a roster must have, or must not have, as before; empty if none."""
        addresses = {each.number: each.address for each in roster.karts}
        bound = [
            f'{kart} {kart.bound}'
            for kart in self.karts.values()
            if kart.bound and addresses.get(kart.number, '') != kart.address
        ]
        keep = (
            'Until this changes, keep these numbers and addresses in the roster, and put no kart '
            'back that is no longer in it'
        )
        return f'{_cut(bound)}. {keep}' if bound else ''

    # ----- what the official saw ----------------------------------------------------------

    def _released_by_garage(self) -> Iterable[Kart]:
        """Yield the karts that the race's IN_GARAGE releases."""
        return (
            each
            for each in self.karts.values()
            if each.sent is not IN_GARAGE
            and (
                each.hold is None
                or (each.stands and (each.in_race or not each.held_alone))
                or each.away_at_rest
                or self._covered_by_statement(each)
            )
        )

    def _misnamed(self, command: Command, concerned: set[int], came: float) -> str:
        """
        Return what is wrong with what a command names; empty if the official saw the race so.

        :param concerned: numbers of the karts that the command starts or releases.
        """
        kind, entry = command.kind, CATALOGUE[command.kind]
        kart = self.karts.get(command.kart, NO_KART)
        if 'heat' in entry.takes:
            return self._no_such_heat(command.heat)
        if 'hold' in entry.takes and command.hold is not kart.hold:
            held = f'held in {kart.hold.value}' if kart.hold else 'not held'
            return f'{kart} has changed since you looked: it is now {held}. Look again'
        meant = command.run, command.race, command.attempt
        finishes = kind is CommandKind.KART_FINISH and command.run
        if finishes and meant != (self.run, self.number, kart.attempt):
            return f'this FINISH is for another race, or the finish of {kart} has been undone'
        if kind is CommandKind.READ_ROSTER:
            roster = command.roster
            return self._bound(roster) if roster.karts else 'the roster has no kart'
        if 'reading' in entry.takes and command.reading != self.reading:
            return (
                f'the last reading is {self.reading}, but you named {command.reading}. Look again'
            )
        if kind is CommandKind.TAKE_ROSTER and command.roster != self._read:
            return 'the file has changed since it was read; read it again'
        if 'opening' in entry.takes and command.opening != self.opening:
            if not self.opening:
                return f'you named opening {command.opening}, but the track has not been opened'
            how, at = self._opened
            return (
                f'the track was opened since you looked ({how}, {max(came - at, 0.0):.0f} s ago); '
                'make sure that nobody is on it, then send this command again'
            )
        if 'karts' not in entry.takes or concerned == command.karts:
            return ''
        if not command.karts:  # typed by hand
            return f'no kart is named. Add karts: {sorted(concerned)}'
        text = 'the race has changed since you looked'
        if concerned - command.karts:
            text += f'. You did not name {_numbers(concerned - command.karts)}'
        if command.karts - concerned:
            text += f'. The command does not apply to {_numbers(command.karts - concerned)}'
        return f'{text}. Look again'

    def _no_such_heat(self, name: str) -> str:
        for heat in self.heats:
            if heat.name == name:
                return self._uninspected(self.karts[number] for number in heat.karts)
        names = ', '.join(f'"{heat.name}"' for heat in self.heats)
        return f'the roster has no heat {name[:40]!r}; it has {names}'

    # ----- what the official must state ---------------------------------------------------

    def _state_track_safe(self) -> str:
        if not self.past_unknown:
            return 'the track is safe for humans'
        covered = filter(self._covered_by_statement, self.karts.values())
        silent = _listed(each for each in covered if not each.stands)
        text = f'the track is safe for humans, {NO_RACE_ANYWHERE}'
        if silent:
            text += f', not even those that have not confirmed a stop: {silent}'
        return text

    def _changes(self) -> str:
        """Return what TAKE_ROSTER would change, as a list of phrases."""
        named = {each.number: each for each in self._read.karts}
        said = [
            f'{called(each.number, each.team)} is added with the address {each.address}'
            for each in self._read.karts
            if each.number not in self.karts
        ]
        for kart in self.karts.values():
            new = named.get(kart.number)
            if new is None:
                said += [] if kart.bound else [f'{kart} is removed']
                continue
            for what in ('address', 'team', 'inspected'):
                value = getattr(new, what)
                if value != getattr(kart, what):
                    said.append(f'{kart} has a new entry "{what}: {value}"')
        heats = dict(self._read.heats)
        new_heats = (heat for heat in self._read.heats if heat not in self.heats)
        said += [f'"{heat.name}": {_numbers(heat.karts)}' for heat in new_heats]
        said += [f'"{heat.name}" is removed' for heat in self.heats if heat.name not in heats]
        return '; '.join(said) or 'the same karts in the same heats; laps and grids may differ'

    # ----- derived ------------------------------------------------------------------------

    @property
    def heat(self) -> str:
        """
        Return the name of the heat in the race; empty if there is none.

        It stays in the race until a kart from outside it joins, or none of its karts is left.
        """
        racing = {each.number for each in self.racing()}
        inside = any(heat.name == self._put_in and racing <= {*heat.karts} for heat in self.heats)
        return self._put_in if inside and racing else ''

    def racing(self) -> Iterator[Kart]:
        """Yield the karts in the race, in roster order."""
        return (kart for kart in self.karts.values() if kart.in_race)

    def _dangers(self, karts: Iterable[Kart]) -> str:
        # A kart that no command reaches comes first, because a reader may see only the first.
        first = sorted(karts, key=lambda kart: kart.connected)
        return _cut([danger for danger in map(self._danger, first) if danger])

    def _danger(self, kart: Kart) -> str:
        """Return why humans must not be near a kart now (§3.A); empty if they may be near it."""
        if kart.stands:
            return ''
        if kart.connected and kart.sent.is_red:
            return f'{kart} {self._silence(kart)}'
        if kart.connected:
            return f'{kart} may be moving: stop it with RED_RED' if kart.may_be_moving else ''
        if kart.may_be_moving:
            return f'{kart} was lost while it may have been moving: use the MSR'
        if kart.doubt is Doubt.GRID:
            return (
                f'{kart} was lost on the grid. Wait until it is back and has acknowledged a stop, '
                'or use the MSR and record its use, or, if the team has the kart off the track, '
                'make it safe by hand, send it RED_RED and release it individually'
            )
        return ''

    def _covered_by_statement(self, kart: Kart) -> bool:
        """
        Return whether the official's statement with the next IN_GARAGE covers a kart.

        It does so if race control does not know what happened, there is no doubt about this kart,
        and no official holds it individually.
        """
        return self.past_unknown and not (kart.doubt or kart.held_alone)

    def _silence(self, kart: Kart) -> str:
        """Return why a kart's answer is missing or does not count, and what to do about it."""
        if not kart.connected:
            return 'not connected'
        if kart.stopped:
            return f'has stopped, and must stay stopped for {self.times.settle_time:g} s'
        if kart.stopped_itself:
            return 'stopped itself; take it out of the race, or start again from IN_GARAGE'
        if kart.reported is kart.sent:
            return (
                f'reported {kart.sent.value}, perhaps in answer to an earlier command (if waiting '
                'does not help, it must reconnect, and will be held)'
            )
        if kart.acknowledged_after is not None:
            return f'withdrew its acknowledgement of {kart.sent.value}'
        return f'has not acknowledged {kart.sent.value}'

    def _waited_for(self) -> list[Kart]:
        """
        Return the karts that the race is waiting for, including lost ones unless the MSR was used.

        The race does not wait for a red state to be acknowledged by a kart that is away at rest
        (``Kart.away_at_rest``). If race control does not know what happened, the race also waits
        for every connected kart that is being sent a red state. The race never waits for a kart
        that the official's statement covers.
        """
        return [
            kart
            for kart in self.karts.values()
            if (
                (kart.connected and (kart.in_race or (self.past_unknown and kart.sent.is_red)))
                or (kart.in_race and not self.msr_used)
            )
            and not (kart.sent.is_red and kart.away_at_rest)
            and not self._covered_by_statement(kart)
        ]

    def _unattended_since(self) -> float | None:
        """Return `nobody_since` in GRID_ACTIVE and GREEN_GREEN; otherwise None."""
        return self.nobody_since if self.state in (GRID_ACTIVE, GREEN_GREEN) else None

    def _all_have_finished(self, now: float) -> bool:
        """Return whether the race ends now because all its karts have finished (§3.C)."""
        racing = list(self.racing())
        if not (self.times.auto_race_over and racing and self.state in (GREEN_GREEN, RED_FLAG)):
            return False
        # Without starters, the places belong to the last race.
        return bool(self.starters) and all(
            kart.place
            and kart.flag_at is None
            and (kart.stopped or now >= kart.sent_since + self.times.finish_stop)
            for kart in racing
        )

    def _report_all_answered(self) -> None:
        waited_for = [] if self.state is IN_GARAGE else self._waited_for()
        answered = bool(waited_for) and all(kart.answered for kart in waited_for)
        if answered and not self._reported_all_answered:
            whole = all(kart.acknowledged for kart in self.racing())
            alike = all(kart.sent is self.state for kart in waited_for)
            text = f'Every kart {"in the race" if whole else "that the race is waiting for"} '
            text += f'acknowledged {self.state.value if alike else "its order"}'
            self._add_event(EventKind.ALL_ACKNOWLEDGED, text, state=self.state)
        self._reported_all_answered = answered

    def _report_order_of_finish(self) -> None:
        """Report the order of FINISH and the karts that did not finish, once for each race."""
        starters = [self.karts[number] for number in self.starters]
        self.starters = ()
        if not starters:
            return
        finished = sorted((each for each in starters if each.place), key=lambda each: each.place)
        missing = [str(each) for each in starters if not each.place]
        order = ', '.join(f'{each.place}. {each}' for each in finished) or 'no kart finished'
        text = f'Order of FINISH: {order}'
        if missing:
            text += f'; did not finish: {", ".join(missing)}'
        self._events.append(Event(EventKind.ORDER_OF_FINISH, text))

    def _current_alerts(self, now: float) -> Iterator[tuple[AlertKind, int, str]]:
        """Yield each alert, the number of its kart, and its text."""
        late = {
            GRID_ACTIVE: (AlertKind.NOT_READY, self.times.ready_alert),
            GREEN_GREEN: (AlertKind.GREEN_UNACKNOWLEDGED, self.times.green_alert),
            RED_FLAG: (AlertKind.FLAG_UNACKNOWLEDGED, self.times.flag_alert),
            RED_RED: (AlertKind.RED_UNACKNOWLEDGED, self.times.red_alert),
        }
        for number, kart in self.karts.items():
            if kart.lost:
                # A kart that is back may not have stopped yet; only its report ends the alert.
                if kart.may_be_moving:
                    text = f'{kart} lost its connection while it may have been moving'
                    stopped = 'and reports that it has stopped: check that it is not rolling'
                    how = stopped if kart.stopped else 'but has not stopped yet'
                    text += f'. It is back {how}' * kart.connected
                    yield AlertKind.LOST_IN_MOTION, number, text
                elif not kart.connected:
                    yield AlertKind.KART_LOST, number, f'{kart} lost its connection'
            if kart.connected and kart.may_be_moving and kart.sent in (IN_GARAGE, GRID_ACTIVE):
                text = f'it reported GREEN_GREEN while being sent {kart.sent.value}'
                yield AlertKind.MOVING_UNASKED, number, f'Stop {kart} with RED_RED: {text}'
            if kart.in_race and kart.link.grade is Grade.POOR:
                # A kart that is being sent a red is being stopped already.
                advice = 'Send RED_FLAG: ' if kart.sent is GREEN_GREEN else ''
                if kart.sent in (IN_GARAGE, GRID_ACTIVE):
                    advice = 'LEAVE_RACE before GREEN_GREEN: '
                yield AlertKind.LINK_POOR, number, f'{advice}{kart} {kart.link.delay}'
            if kart.contested:
                text = f'Two programs keep connecting as {kart}: have the team stop one of them'
                yield AlertKind.TWO_PROGRAMS, number, text
            if kart.sent in late and not kart.acknowledged:
                alert, limit = late[kart.sent]
                # In a red state, a new connection restarts the time unless the kart had been lost.
                is_new = kart.sent.is_red and not kart.lost
                due = (kart.ordered_at if is_new else kart.sent_since) + limit
                if due > now or not (kart.connected or alert is AlertKind.NOT_READY):
                    continue
                if self._covered_by_statement(kart):
                    continue  # its program may still be booting, and nobody has seen the kart move
                text = f'{kart} has not acknowledged {kart.sent.value}'
                if kart.stopped_itself:
                    text = f'{kart} stopped itself while being sent {kart.sent.value}'
                if alert not in MSR_ALERTS and not kart.connected:
                    text += ' because it is not connected'
                yield alert, number, text
        if self.track_open and not (access := self.track_access()).allowed:
            yield AlertKind.TRACK_UNSAFE, 0, f'Clear the track: {access.reason}'
        if self.has_rival:
            text = (
                'Another race control is running: shut it down. Until then, nothing can be '
                'started or released. Stops still work, but each stop reaches only the karts '
                'that are connected to the race control that receives it'
            )
            yield AlertKind.TWO_RACE_CONTROLS, 0, text
        if self._unattended_since() is not None:
            text = f'Open a window: race control is not {IN_CONTACT}'
            if self.times.nobody_there:
                text += f'. If there is none for {self.times.nobody_there:g} s, it sends RED_FLAG'
            yield AlertKind.NOBODY_THERE, 0, text
        if self.there.button_fault:
            yield AlertKind.BUTTON_FAULT, 0, f'Check the stop button: {self.there.button_fault}'
        if self.record_fails:
            yield AlertKind.RECORD_FAILING, 0, self.record_fails

    def _report_alerts(self, now: float) -> None:
        current = {(alert.kind, alert.kart): alert for alert in self.alerts(now)}
        for key, alert in current.items():
            if key not in self._alerts:
                self._add_event(EventKind.ALERT_RAISED, alert.told, alert.kart, alert=alert.kind)
        for key, alert in self._alerts.items():
            if key not in current:
                # The kart may have left the roster in the meantime.
                kart = self.karts.get(alert.kart, called(alert.kart, ''))
                of = f', {kart}' if alert.kart else ''
                text = f'Alert ended: {alert.kind.value.replace("_", " ")}{of}'
                self._add_event(EventKind.ALERT_CLEARED, text, alert.kart, alert=alert.kind)
        self._alerts = current

    def _add_event(
        self,
        kind: EventKind,
        text: str,
        kart: int = 0,
        state: RaceState | None = None,
        **more: Any,
    ) -> None:
        """Add an event, which names the command that is taking effect, if any."""
        command, by = (None, '') if self._by is None else (self._by.kind, self._by.official)
        event = Event(kind, _capital(text), kart, state, command, official=by, **more)
        self._events.append(event)

    def _outcome(self, answer: Answer | None = None) -> Outcome:
        of_race, karts = (self.number, self.heat if self._events else ''), self.karts
        # Not `_replace`, which is slow: it would delay a stop to a hundred karts by 0.3 ms.
        events = tuple(
            # An event may concern no kart, or one that has left the roster.
            Event(*each[:-3], karts[each.kart].place if each.kart in karts else 0, *of_race)
            for each in self._events
        )
        outcome = Outcome(tuple(self._orders), events, answer)
        self._orders = []
        self._events = []
        if self.state is IN_GARAGE:
            self.number = 0  # only from now on: IN_GARAGE itself belongs to the race that it ends
        return outcome


LOST_AT_ONCE = 2.0
"""Maximum time in seconds between the losses of karts that count as lost together. Each kart is
lost `send_timeout` after its last answer."""

NO_RACE_ANYWHERE = 'no race is under way anywhere, and no kart is moving'
"""What an official must state once if race control does not know what happened before."""

IN_CONTACT = 'in contact with any screen or button that can stop the race'

NO_KART = Kart(0)
"""The kart of a command that is not for one kart. The rules only read it."""


def _cut(phrases: list[str]) -> str:
    """Join at most four phrases, because an official cannot act on more at once."""
    more = len(phrases) - 3
    shown = phrases if more <= 1 else [*phrases[:3], f'and {more} more karts']
    return '; '.join(shown)


def _numbers(numbers: Iterable[int]) -> str:
    """Return a phrase that lists kart numbers."""
    ascending = sorted(numbers)
    listed = [str(number) for number in ascending[:12]]
    if len(ascending) > 12:
        listed.append(f'and {len(ascending) - 12} more')
    if not listed:
        return 'no kart'
    return f'kart{"s" if len(listed) > 1 else ""} {", ".join(listed)}'


def _listed(karts: Iterable[Kart]) -> str:
    return _cut([str(kart) for kart in karts])


def _held(karts: Iterable[Kart]) -> str:
    return _cut([f'{kart}: {kart.hold_reason}' for kart in karts if kart.hold is not None])


def _receivers(karts: Iterable[Kart]) -> str:
    """Return which karts are being sent a new state, and which will be when they connect."""
    known = list(karts)
    absent = _listed(kart for kart in known if not kart.connected)
    text = _numbers(kart.number for kart in known if kart.connected)
    return f'{text}; once connected, also to: {absent}' if absent else text


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


@dataclass(frozen=True)
class Rule:
    """
    One row of the table of commands (§4.B). ``CATALOGUE`` holds what does not depend on the race.

    :param effect: puts the command into effect and returns the message to the official.
    :param states: the states of the race in which the command is possible. ``Race._refusals`` has
        every other reason to refuse it.
    :param statement: returns what the official must state; empty if no statement is needed.
    :param karts: returns the karts that the command starts or releases.
    """

    effect: Callable[[Race, Command, float], str]
    states: tuple[RaceState, ...] = tuple(RaceState)
    statement: Callable[[Race, Kart], str] = lambda race, kart: ''
    karts: Callable[[Race, Kart], Iterable[Kart]] = lambda race, kart: ()


COMMANDS: dict[CommandKind, Rule] = {
    # The stops, which are never refused.
    CommandKind.ALL_KILL: Rule(Race._all_kill),
    CommandKind.RED_FLAG: Rule(Race._red_flag),
    CommandKind.KART_RED_RED: Rule(Race._stop_kart),
    CommandKind.KART_RED_FLAG: Rule(Race._stop_kart),
    CommandKind.RECORD_MSR: Rule(
        Race._record_msr, statement=lambda race, kart: 'the Master Safety Remote was used'
    ),
    # The race.
    CommandKind.GRID_ACTIVE: Rule(
        Race._grid_active,
        (IN_GARAGE, GRID_ACTIVE),
        lambda race, kart: 'the track is clear of humans (this command closes it)',
        lambda race, kart: race.racing(),
    ),
    CommandKind.GREEN_GREEN: Rule(
        Race._green_green, (GRID_ACTIVE,), karts=lambda race, kart: race.racing()
    ),
    CommandKind.RACE_OVER: Rule(Race._race_over, (GRID_ACTIVE, GREEN_GREEN, RED_FLAG, RED_RED)),
    CommandKind.IN_GARAGE: Rule(
        Race._race_in_garage,
        (GRID_ACTIVE, RED_RED),
        lambda race, kart: race._state_track_safe(),
        lambda race, kart: race._released_by_garage(),
    ),
    # One kart.
    CommandKind.KART_FINISH: Rule(Race._kart_finish, (GREEN_GREEN,)),
    CommandKind.KART_IN_GARAGE: Rule(
        Race._release_kart,
        statement=lambda race, kart: '' if kart.stands else f'{kart} was made safe by hand',
        karts=lambda race, kart: [kart],
    ),
    # The rest are not buttons in §4.B, so GRID_ACTIVE remains the last button pressed.
    CommandKind.KART_UNDO_FINISH: Rule(
        Race._kart_undo_finish, statement=lambda race, kart: f'{kart} has not finished'
    ),
    CommandKind.JOIN_RACE: Rule(Race._join_race, (IN_GARAGE,)),
    CommandKind.LEAVE_RACE: Rule(Race._leave_race, (IN_GARAGE, GRID_ACTIVE)),
    CommandKind.SET_HEAT: Rule(Race._set_heat, (IN_GARAGE,)),
    CommandKind.READ_ROSTER: Rule(Race._read_roster, (IN_GARAGE,)),
    CommandKind.TAKE_ROSTER: Rule(
        Race._take_roster, (IN_GARAGE,), lambda race, kart: race._changes()
    ),
    CommandKind.OPEN_TRACK: Rule(
        Race._open_track, statement=lambda race, kart: NO_RACE_ANYWHERE if race.unstated else ''
    ),
    CommandKind.CLOSE_TRACK: Rule(Race._close_track),
}
"""The rule of every command."""
