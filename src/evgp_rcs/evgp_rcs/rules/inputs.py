# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The stream of a run: every input and output of the rules, as typed entries in order.

The first entry is `Began`, and the second is `Rules`, with the setup of the rules. The inputs of
the ``Race`` follow, each with its exact time. After each input come the orders (`Ordered`) and
events (``StampedEvent``) that it caused. In between are events that the server itself made, and
the times at which the race was shown to officials (`Shown`). The kart server feeds the rules only
through `feed`, so a stream can be replayed.

The thread that stops karts only appends entries to a `Log`. It passes the entries on after it has
sent the frames and answers. The record's process encodes the entries in blocks. Each block says
how many entries precede it, so that missing entries are noticed and counted.

The code is pure: it uses no clock, socket, ROS, thread, file or log.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import get_args, NamedTuple

from evgp_node.stream import Began, Stream
from evgp_protocol.states import RaceState
from evgp_rcs.rules.link_quality import LinkQuality
from evgp_rcs.rules.race import (
    Attendance,
    Command,
    Entrant,
    Heat,
    Kart,
    LastRun,
    Order,
    Outcome,
    Race,
    RaceMemory,
    RaceTimes,
    StampedEvent,
)

# ----- the setup of the rules -----------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Setup:
    """
    The setup of the rules.

    :param now: time of the setup, in seconds by the rules' clock.
    """

    karts: tuple[Entrant, ...]
    times: RaceTimes
    heats: tuple[Heat, ...]
    now: float

    def race(self, run: str) -> Race:
        """Return a new race in the run with this id (``Began``)."""
        karts = [Kart(*each) for each in self.karts]
        return Race(karts, self.times, self.now, self.heats, run)


class Rules(NamedTuple):
    """The setup of the rules, and their version (``rules_version``; empty if unknown)."""

    version: str
    setup: Setup


# ----- the inputs -----------------------------------------------------------------------------


class Commanded(NamedTuple):
    """An official's command, and ``came``, the time in seconds when it arrived."""

    at: float
    command: Command
    came: float


class Connected(NamedTuple):
    """A kart has a new connection."""

    at: float
    kart: int


class Disconnected(NamedTuple):
    """A kart's connection has ended; ``silent`` means that the kart's link stopped answering."""

    at: float
    kart: int
    reason: str
    silent: bool = False


class Heard(NamedTuple):
    """
    A kart reported a state. The report can answer the order with this serial.

    :param counts_in: see `Race.heard`.
    """

    at: float
    kart: int
    serial: int
    state: RaceState
    counts_in: float = 0.0


class Delivered(NamedTuple):
    """A kart's kernel had answered the order with this serial by the time ``answered``."""

    at: float
    kart: int
    serial: int
    answered: float


class Measured(NamedTuple):
    """The quality of a kart's link, once a second and whenever it gets worse."""

    at: float
    kart: int
    link: LinkQuality


class Tick(NamedTuple):
    """Time passed."""

    at: float


class Stalled(NamedTuple):
    """Race control stalled for this number of seconds."""

    at: float
    seconds: float


class CutOff(NamedTuple):
    """Race control lost the karts' network. ``reason`` is empty once the network is back."""

    at: float
    reason: str


class Contested(NamedTuple):
    """Two programs keep connecting as one kart, or have stopped doing so."""

    at: float
    kart: int
    contested: bool


class Rival(NamedTuple):
    """Another race control appeared or disappeared."""

    at: float
    present: bool


class Attended(NamedTuple):
    """The programs that can stop the race changed."""

    at: float
    there: Attendance


class RecordTrouble(NamedTuple):
    """A sentence that tells officials why the record is failing; empty if the record works."""

    at: float
    text: str


class Saved(NamedTuple):
    """A memory is on the disk; ``gridded`` is the last `RaceMemory.gridded` there."""

    at: float
    gridded: int


class Recovered(NamedTuple):
    """What is known about the last run; `Race.recover` explains the fields."""

    at: float
    memory: RaceMemory | None
    last_run: LastRun
    why: str = ''


Input = (
    Commanded
    | Connected
    | Disconnected
    | Heard
    | Delivered
    | Measured
    | Tick
    | Stalled
    | CutOff
    | Contested
    | Rival
    | Attended
    | RecordTrouble
    | Saved
    | Recovered
)


def feed(given: Input, race: Race) -> Outcome:
    """Feed an input to the rules."""
    match given:
        case Heard(at, kart, serial, state, counts_in):
            return race.heard(kart, serial, state, at, counts_in)
        case Tick(at):
            return race.tick(at)
        case Delivered(at, kart, serial, answered):
            return race.delivered(kart, serial, answered, at)
        case Measured(at, kart, link):
            return race.measured(kart, link, at)
        case Commanded(at, command, came):
            return race.command(command, at, came)
        case Connected(at, kart):
            return race.connected(kart, at)
        case Disconnected(at, kart, reason, silent):
            return race.disconnected(kart, reason, at, silent)
        case Stalled(at, seconds):
            return race.stalled(seconds, at)
        case CutOff(at, reason):
            return race.cut_off(reason, at)
        case Contested(at, kart, contested):
            return race.contested(kart, contested, at)
        case Rival(at, present):
            return race.rival(present, at)
        case Attended(at, there):
            return race.attended(there, at)
        case RecordTrouble(at, text):
            return race.record_trouble(text, at)
        case Saved(_, gridded):
            return race.saved(gridded)
        case Recovered(at, memory, last_run, why):
            return race.recover(memory, last_run, at, why)


# ----- the outputs ------------------------------------------------------------------------


class Ordered(NamedTuple):
    """The orders that the previous input caused. An input without orders has no such entry."""

    orders: tuple[Order, ...]


class Shown(NamedTuple):
    """The server sent a snapshot of the race to the ROS half at this point."""

    at: float


Entry = Began | Rules | Input | Ordered | StampedEvent | Shown


# ----- encoding -------------------------------------------------------------------------------

_MOST = 2**32 - 1


def _check(entry: Entry) -> None:
    """
    Refuse numbers and texts that a ROS message cannot hold.

    :raises ValueError: if an event, a setup or an attendance contains one.
    """
    texts: list[str] = []
    numbers: list[int] = []
    if isinstance(entry, StampedEvent):
        event = entry.event
        texts = [event.text, event.official, event.heat]
        numbers = [event.kart, event.place, event.race]
    elif isinstance(entry, Attended):
        texts = [entry.there.who_can_stop, entry.there.button_fault]
        numbers = [entry.there.able_to_stop]
    elif isinstance(entry, Rules):
        karts, heats = entry.setup.karts, entry.setup.heats
        texts = [heat.name for heat in heats]
        texts += [name for kart in karts for name in (kart.team, kart.inspected)]
        # There is no kart 0.
        numbers = [number - 1 for heat in heats for number in heat.karts]
        numbers += [kart.number - 1 for kart in karts]
    ''.join(texts).encode()
    if not all(0 <= number < _MOST for number in numbers):
        raise ValueError('a number is out of range')


# ----- the log, in blocks ---------------------------------------------------------------------


class Batch(NamedTuple):
    """
    Consecutive entries in a log.

    :param first: number of entries before them.
    """

    first: int
    entries: Sequence[Entry]


class Log:
    """The entries of one race after ``Rules``, that is, all inputs and outputs of the rules."""

    def __init__(self) -> None:
        self._new: list[Entry] = []
        self._taken = 1

    def add(self, *entries: Entry) -> None:
        """Append an input before it reaches the rules, or what an input has caused."""
        self._new += entries

    def take(self) -> Batch:
        """Return the entries added since the last call."""
        batch = Batch(self._taken, self._new)
        self._taken += len(self._new)
        self._new = []
        return batch


STREAM: Stream[Entry] = Stream(get_args(Entry), _check)
"""The encoding of entries."""

encode, decode, entries_of = STREAM.encode, STREAM.decode, STREAM.entries_of
