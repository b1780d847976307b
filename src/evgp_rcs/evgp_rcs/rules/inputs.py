# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The stream of a run: all that went into the rules and came out of them, as typed entries in order.

`Began` is the first entry, then `Rules`: with what the rules begin. Then come the inputs of the
``Race``, each with its time to the last bit. After an input are the orders that it has brought
about (`Ordered`) and the events that it made (``StampedEvent``), whole. Between these are the
events that the server itself made, and where the race was shown to officials (`Shown`). `feed`
hands an input to the rules: the kart server has no other way to them, so a stream can be run
again.

The thread that stops karts only appends entries to a `Log`, and hands them on when frames and
answers are out. The record's process encodes them, in blocks. A block says how many entries came
before it, so that missing ones are noticed and counted.

Pure. No clock, socket, ROS, thread, file or log.
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
    StartPhase,
)

# ----- with what the rules begin --------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Setup:
    """
    With what the rules begin.

    :param now: the time of it, on the clock of the rules (s).
    :param run: the id of this run, as in ``Began``.
    """

    karts: tuple[Entrant, ...]
    times: RaceTimes
    heats: tuple[Heat, ...]
    now: float
    run: str = ''

    def race(self) -> Race:
        """Return a race that has just begun."""
        karts = [
            Kart(
                each.number,
                each.team,
                each.in_race,
                inspected=each.inspected,
                address=each.address,
            )
            for each in self.karts
        ]
        return Race(karts, self.times, self.now, self.heats, self.run)


class Rules(NamedTuple):
    """With what the rules begin, and their version (``rules_version``); empty: not known."""

    version: str
    setup: Setup


# ----- the inputs -----------------------------------------------------------------------------


class Commanded(NamedTuple):
    """An official's command, and when it came (s)."""

    at: float
    command: Command
    came: float


class Connected(NamedTuple):
    """A kart has a new connection."""

    at: float
    kart: int


CLOSED_BY_KART = 'the kart closed the connection'
"""Why a connection is gone that its kart ended in good order."""


class Disconnected(NamedTuple):
    """A kart's connection is gone; ``silent``: its link stopped answering."""

    at: float
    kart: int
    reason: str
    silent: bool = False


class Heard(NamedTuple):
    """
    A kart said a state, and can have meant the order of this serial.

    :param counts_in: see `Race.heard`.
    """

    at: float
    kart: int
    serial: int
    state: RaceState
    counts_in: float = 0.0


class Delivered(NamedTuple):
    """A kart's kernel answered the order of this serial, at a time (s)."""

    at: float
    kart: int
    serial: int
    answered: float


class Measured(NamedTuple):
    """How good a kart's link is: each second, and when it gets worse."""

    at: float
    kart: int
    link: LinkQuality


class Tick(NamedTuple):
    """Time passed."""

    at: float


class Stalled(NamedTuple):
    """Race control stalled for this long (s)."""

    at: float
    seconds: float


class CutOff(NamedTuple):
    """Race control lost the karts' network, for this reason; empty: it has it back."""

    at: float
    reason: str


class Contested(NamedTuple):
    """Two programs connect as a kart again and again, or do so no more."""

    at: float
    kart: int
    contested: bool


class Rival(NamedTuple):
    """Another race control came or went."""

    at: float
    present: bool


class Attended(NamedTuple):
    """Who is there to stop the race changed."""

    at: float
    there: Attendance


class RecordTrouble(NamedTuple):
    """Why the record fails, as a sentence for officials; empty: it works."""

    at: float
    text: str


class StartBecame(NamedTuple):
    """What the start of this number waits for came to this ``StartPhase``."""

    at: float
    phase: StartPhase
    number: int


class Recovered(NamedTuple):
    """
    What is known of the last run.

    :param memory: what the record has of it; None: nothing.
    :param last_run: how it ended, by the mark of the machine (``run_mark``).
    :param why: why no proof of a good end is believed, as a phrase; empty: no such reason.
    """

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
    | StartBecame
    | Recovered
)


def feed(given: Input, race: Race) -> Outcome:
    """Hand an input to the rules."""
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
        case StartBecame(at, phase, number):
            return race.start_becomes(phase, number, at)
        case Recovered(at, memory, last_run, why):
            return race.recover(memory, last_run, at, why)


# ----- what comes of them -----------------------------------------------------------------


class Ordered(NamedTuple):
    """What the input before has ordered karts; without this entry, nothing."""

    orders: tuple[Order, ...]


class Shown(NamedTuple):
    """A snapshot of the race was sent to the ROS half here."""

    at: float


Entry = Began | Rules | Input | Ordered | StampedEvent | Shown


# ----- encoding -------------------------------------------------------------------------------

_MOST = 2**32 - 1


def _check(entry: Entry) -> None:
    """
    Refuse what no message of ROS can have: numbers of 32 bits, text.

    :raises ValueError: if an event or a setup has it.
    """
    texts: list[str] = []
    numbers: list[int] = []
    if isinstance(entry, StampedEvent):
        event = entry.event
        texts = [event.text, event.official, event.heat]
        numbers = [event.kart, event.place, event.race]
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
    Entries that follow each other in a log.

    :param first: how many came before them.
    :param entries: None is in the place of an event that is in `happened`.
    :param happened: these events, packed as the ROS half gets them: so they are packed once.
    """

    first: int
    entries: Sequence[Entry | None]
    happened: bytes = b''


class Log:
    """Everything that goes into the rules of one race and comes out of them, behind ``Rules``."""

    def __init__(self) -> None:
        self._new: list[Entry | None] = []
        self._taken = 1

    def add(self, *entries: Entry | None) -> None:
        """
        Take entries: an input before it goes into the rules, then what it brings about.

        :param entries: None: an event, which whoever takes the batch adds.
        """
        self._new += entries

    def take(self, but: int = 0) -> Batch:
        """Return what was added since this was asked last, but for so many; perhaps nothing."""
        count = len(self._new) - but
        batch = Batch(self._taken, self._new[:count])
        self._taken += count
        self._new = self._new[count:]
        return batch


STREAM: Stream[Entry] = Stream(get_args(Entry), _check)
"""How entries are written and read."""

encode, decode, entries_of = STREAM.encode, STREAM.decode, STREAM.entries_of
