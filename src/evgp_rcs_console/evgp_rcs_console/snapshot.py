# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What `~/race`, `~/events` and `~/results` say, as an official's screen needs it, without ROS.

Only data lives here. Times are ages in seconds at the moment race control took the snapshot, so
that no two machines' clocks are ever compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import enum
import math

from evgp_protocol.link import Grade
from evgp_rcs.catalogue import CommandKind
from evgp_rcs.laps import Judged, KartResult
from evgp_rcs.official import said_by


class State(enum.Enum):
    """A race state (§3.A); UNKNOWN is none."""

    UNKNOWN = 'UNKNOWN'
    IN_GARAGE = 'IN_GARAGE'
    GRID_ACTIVE = 'GRID_ACTIVE'
    GREEN_GREEN = 'GREEN_GREEN'
    RED_FLAG = 'RED_FLAG'
    RED_RED = 'RED_RED'


RED = (State.RED_FLAG, State.RED_RED)


@dataclass(frozen=True)
class Available:
    """
    Whether a command would be accepted, why not, and what the official must state.

    :param karts: the karts that it would start or release.
    :param again_in: time from the snapshot to the end of the pause that refuses it, in seconds;
        0 if it is not a pause that refuses it.
    """

    yes: bool
    reason: str = ''
    statement: str = ''
    karts: tuple[int, ...] = ()
    again_in: float = 0.0


Availability = Mapping[CommandKind, Available]


@dataclass(frozen=True)
class Link:
    """How good the link to a kart is; the meanings are those of `LinkQuality.msg`."""

    grade: Grade = Grade.UNKNOWN
    poor_lately: bool = False
    worst_answer: float = math.nan
    round_trip: float = math.nan
    behind: float = 0.0


@dataclass(frozen=True)
class Kart:
    """
    One kart of the roster; the meanings are those of `KartStatus.msg`.

    :param settles_in: time from the snapshot until its stop counts, if it stands by its word, in
        seconds; 0 when nothing is pending.
    :param counts_in: it says what it is sent, perhaps to an earlier command: time from the
        snapshot until that counts at the latest, in seconds; 0: only a new connection of it
        counts; None: it says no such thing.
    :param last_lap: in seconds; None: it has no lap. ``best_lap``, likewise.
    :param flag_in: time from the snapshot until its finish becomes a RED_FLAG, in seconds; 0 when
        none is due.
    """

    number: int
    team: str
    in_race: bool
    connected: bool
    sent: State
    sent_for: float
    acknowledged: bool
    reported: State
    hold: State
    hold_reason: str
    may_be_moving: bool
    place: int
    commands: Availability
    inspected: str = ''
    settles_in: float = 0.0
    counts_in: float | None = None
    flag_in: float = 0.0
    link: Link = Link()
    laps: int = 0
    last_lap: float | None = None
    best_lap: float | None = None
    last_lap_done: bool = False

    @property
    def in_doubt(self) -> bool:
        """Return whether it may be moving although it is not to, or without being heard."""
        return self.may_be_moving and not (self.connected and self.sent is State.GREEN_GREEN)

    @property
    def says_no_more(self) -> bool:
        """Return whether its last word is what it is sent, said to an earlier command."""
        waits = self.connected and not self.acknowledged and self.sent is not State.IN_GARAGE
        return waits and self.counts_in is None and self.reported is self.sent

    @property
    def settles(self) -> bool:
        """Return whether it has said that it stopped, and only must stand for a while yet."""
        return self.in_doubt and self.connected and self.acknowledged and self.sent in RED

    @property
    def flag_follows(self) -> bool:
        """Return whether it has finished, and drives on until it is sent its RED_FLAG."""
        return self.flag_in > 0.0 and self.connected and self.sent is State.GREEN_GREEN

    @property
    def is_stopping(self) -> bool:
        """Return whether it is in doubt in the ordinary way: it is told to stop, and hears it."""
        return self.in_doubt and self.connected and self.sent in RED


@dataclass(frozen=True)
class Track:
    """Whether humans may be on the track."""

    is_open: bool
    allowed: bool
    reason: str
    msr_used: bool


@dataclass(frozen=True)
class Alert:
    """Something an official must act on; `kind` is the name of its constant."""

    kind: str
    kart: int
    use_msr: bool
    text: str


@dataclass(frozen=True)
class Heat:
    """Karts that race together, as the roster names them; the meanings are those of `Heat.msg`."""

    name: str
    karts: tuple[int, ...]
    grid_from: str = ''
    grid: tuple[int, ...] = ()


@dataclass(frozen=True)
class Race:
    """
    One consistent snapshot of the race.

    :param state_cause: what brought the state about, and who; empty if that is not known.
    :param state_clock: when, by race control's wall clock, as hours:minutes:seconds.
    :param banner: what every screen says at its top; empty: nothing.
    :param laps: how many laps the race that was started last has; 0: no number is set.
    :param heat: the name of the heat in the race; empty: none.
    :param next_heat: the name of the heat whose turn is next; empty: nobody's.
    :param able_to_stop: from how many programs officials can stop it; ``who_can_stop``: which.
    """

    state: State
    state_for: float
    over: bool
    karts: tuple[Kart, ...]
    commands: Availability
    track: Track
    alerts: tuple[Alert, ...]
    heats: tuple[Heat, ...] = ()
    banner: str = ''
    state_cause: str = ''
    state_clock: str = ''
    laps: int = 0
    heat: str = ''
    next_heat: str = ''
    able_to_stop: int = 0
    who_can_stop: str = ''

    @property
    def heat_in_race(self) -> Heat | None:
        """Return the heat in the race."""
        return next((heat for heat in self.heats if heat.name == self.heat), None)

    def kart(self, number: int) -> Kart | None:
        """Return the kart with this number, if the roster has it."""
        return next((kart for kart in self.karts if kart.number == number), None)

    def laps_remain(self, kart: Kart) -> bool:
        """Return whether the crossings of a kart are still counted towards its last lap."""
        racing = self.state is State.GREEN_GREEN and kart.in_race and not kart.place
        return racing and kart.laps < self.laps


@dataclass(frozen=True)
class Event:
    """
    Something that happened.

    :param clock: race control's wall time, as hours:minutes:seconds.
    :param official: who caused it, by their own word; empty if it is no command.
    :param is_command: it is an official's command and its answer.
    :param prompt: it is that an order has reached a kart's computer, as quickly as it should.
    """

    sequence: int
    clock: str
    kart: int
    success: bool
    text: str
    official: str = ''
    is_command: bool = False
    prompt: bool = False

    @property
    def told(self) -> str:
        """Return the sentence, with who caused it."""
        return said_by(self.text, self.official)


@dataclass(frozen=True)
class Results:
    """
    The results of the race that was started last; the meanings are those of `Results.msg`.

    :param passings: the last ones, oldest first; ``older``: how many came before.
    """

    heat: str = ''
    format: str = ''  # noqa: A003 - the field's name
    laps: int = 0
    karts: tuple[KartResult, ...] = ()
    passings: tuple[Judged, ...] = ()
    older: int = 0
    grid: tuple[int, ...] = ()
    overall: tuple[KartResult, ...] = ()


@dataclass(frozen=True)
class Answer:
    """What race control answered to a command."""

    success: bool
    message: str
