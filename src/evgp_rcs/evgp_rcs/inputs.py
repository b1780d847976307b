# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What goes into the rules, as data: enough to run them again, and to compare what came out.

Every input of a ``Race`` is a value here, with its time to the last bit, and `feed` hands it on.
The kart server feeds its race in no other way, and keeps each input in a `Log`, in order. Between
the inputs the log has *marks*: the orders that an input has brought about, which of the record's
events it made, and where the race was shown to officials.

A log is cut into blocks. A block says how many entries came before it, so that a missing one is
noticed. The process that stops karts only appends to the log, and encodes what is new when frames
and answers are out; ``compressed`` is for the record's.

Pure. No clock, socket, ROS, thread, file or log.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import dataclasses
import json
from typing import get_args, NamedTuple
import zlib

from evgp_protocol.states import RaceState
from evgp_rcs.encoding import DAMAGED, read, reader, written
from evgp_rcs.laps import Passing
from evgp_rcs.link_quality import LinkQuality
from evgp_rcs.race import (
    Attendance,
    Command,
    Heat,
    Kart,
    LastRun,
    Order,
    Outcome,
    Race,
    RaceMemory,
    RaceTimes,
    StartPhase,
)


class InputsError(ValueError):
    """What was recorded of the inputs is damaged; the text says where, and what is wrong."""


class GapError(InputsError):
    """Inputs are missing."""


# ----- with what the rules begin --------------------------------------------------------------


class Entrant(NamedTuple):
    """A kart of the roster, as far as the rules know it."""

    number: int
    team: str
    in_race: bool
    inspected: str = ''
    transponders: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Setup:
    """
    With what the rules begin.

    :param now: the time of it, on the clock of the rules (s).
    """

    karts: tuple[Entrant, ...]
    times: RaceTimes
    heats: tuple[Heat, ...]
    now: float

    def race(self) -> Race:
        """Return a race that has just begun."""
        karts = [
            Kart(
                kart.number,
                kart.team,
                kart.in_race,
                inspected=kart.inspected,
                transponders=kart.transponders,
            )
            for kart in self.karts
        ]
        return Race(karts, self.times, self.now, self.heats)

    @staticmethod
    def read(text: str) -> Setup:
        """
        Return the setup that was written.

        :raises InputsError: if it is damaged.
        """
        try:
            setup = read(Setup, text)
            names = [name for heat in setup.heats for name in (heat.name, heat.grid_from)]
            names += [
                name
                for kart in setup.karts
                for name in (kart.team, kart.inspected, *kart.transponders)
            ]
            ''.join(names).encode()
            numbers = [number for heat in setup.heats for number in heat.karts]
            numbers += [kart.number for kart in setup.karts]
            if not all(0 < number < 2**32 for number in numbers):
                raise ValueError('a kart has no number')
        except ValueError as error:
            raise InputsError(f'the setup cannot be read: {error}') from error
        return setup


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


class Passed(NamedTuple):
    """What sources saw at the timing line; ``dropped`` more were too many to be taken."""

    at: float
    passings: tuple[Passing, ...]
    dropped: int


class Tick(NamedTuple):
    """Time passed."""

    at: float


class HeldUp(NamedTuple):
    """Race control was held up for so long (s)."""

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
    | Passed
    | Tick
    | HeldUp
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
        case Passed(at, passings, dropped):
            return race.passed(passings, dropped, at)
        case Commanded(at, command, came):
            return race.command(command, at, came)
        case Connected(at, kart):
            return race.connected(kart, at)
        case Disconnected(at, kart, reason, silent):
            return race.disconnected(kart, reason, at, silent)
        case HeldUp(at, seconds):
            return race.held_up(seconds, at)
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


# ----- the marks between them -----------------------------------------------------------------


class Ordered(NamedTuple):
    """What the input before has ordered karts; without this mark, nothing."""

    orders: tuple[Order, ...]


class Told(NamedTuple):
    """
    Which events of the record the input before has made; without this mark, none.

    :param first: the sequence number of the first one; ``last``: of the last.
    """

    first: int
    last: int


class Shown(NamedTuple):
    """A snapshot of the race was sent to the ROS half here."""

    at: float


Mark = Ordered | Told | Shown
Entry = Input | Mark


# ----- encoding -------------------------------------------------------------------------------

_READERS = {kind.__name__: reader(kind) for kind in get_args(Entry)}


def encode(entry: Entry) -> bytes:
    """Return an entry as a line: a list of the name of its type and its fields."""
    return f'{written([type(entry).__name__, *entry])}\n'.encode()


def decode(data: bytes) -> Iterator[Entry]:
    """
    Yield the entries that were encoded, in order.

    :raises InputsError: where they are damaged.
    """
    for number, line in enumerate(data.splitlines(), 1):
        try:
            name, *fields = json.loads(line)
            entry: Entry = _READERS[name](fields)
        except DAMAGED as error:
            raise InputsError(f'entry {number} cannot be read: {error!r:.200}') from error
        yield entry


# ----- the log, in blocks ---------------------------------------------------------------------


class Block(NamedTuple):
    """
    A part of a log.

    :param entries: how many entries came before it.
    :param data: those that it has, encoded.
    """

    entries: int
    data: bytes

    @property
    def length(self) -> int:
        """Return how many entries it has."""
        return self.data.count(b'\n')

    def compressed(self) -> bytes:
        """Return the block in few bytes, which show whether they were damaged."""
        return zlib.compress(b'%d\n%s' % self)

    @staticmethod
    def of(data: bytes) -> Block:
        """
        Return the block that was compressed.

        :raises InputsError: if it is damaged.
        """
        try:
            entries, _, lines = zlib.decompress(data).partition(b'\n')
            return Block(int(entries), lines)
        except (zlib.error, ValueError) as error:
            raise InputsError(f'it cannot be read: {error}') from error


def joined(blocks: Iterable[Block]) -> Iterator[Block]:
    """Yield the same entries in few blocks: a new one only where some are missing."""
    parts: list[Block] = []
    expected = 0
    for block in blocks:
        if parts and block.entries != expected:
            yield Block(parts[0].entries, b''.join(part.data for part in parts))
            parts = []
        parts.append(block)
        expected = block.entries + block.length
    if parts:
        yield Block(parts[0].entries, b''.join(part.data for part in parts))


class Log:
    """Everything that went into the rules of one race, and the marks between."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._new: list[Entry] = []
        self._taken = 0

    def add(self, entry: Entry) -> None:
        """Take an input, before it goes into the rules, or a mark."""
        self._new.append(entry)

    def take(self) -> Block:
        """Return what was added since this was asked last; perhaps nothing."""
        block = Block(self._taken, b''.join(map(encode, self._new)))
        self._taken += len(self._new)
        self._new.clear()
        return block


def entries_of(blocks: Iterable[tuple[int, bytes]]) -> Iterator[Entry]:
    """
    Yield the entries of a run.

    :param blocks: each block with its number, in order and compressed.
    :raises GapError: where entries are missing.
    :raises InputsError: where a block is damaged.
    """
    entries = 0
    for number, data in blocks:
        try:
            block = Block.of(data)
            if block.entries == entries:
                yield from decode(block.data)
        except InputsError as error:
            raise InputsError(f'block {number} of the inputs is damaged: {error}') from error
        if block.entries != entries:
            raise GapError('inputs are missing')
        entries += block.length
