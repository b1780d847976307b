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
What goes into the rules, as data: enough to run them again, and to compare what came out.

Every input of a ``Race`` is a value here, with its time to the last bit, and `feed` hands it on.
The kart server feeds its race in no other way, and keeps each input in a `Log`, in order. Between
the inputs the log has *marks*: the orders that an input has brought about, which of the record's
events it made, where the race was shown to the ROS half, and what the ROS half published of it.

A log is cut into blocks. A block says how many entries came before it, so that a missing one is
noticed. The thread that stops karts only appends to the log, and encodes what is new when frames
and answers are out; ``compressed`` is for the record's thread.

Pure. No clock, socket, ROS, thread, file or log. All numbers are little-endian.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import dataclasses
import enum
import json
import struct
from typing import Any, NamedTuple
import zlib

from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs.race import (
    Availability,
    Command,
    Doubt,
    Heat,
    Kart,
    KartMemory,
    Order,
    Outcome,
    Race,
    RaceMemory,
    RaceTimes,
    StartPhase,
)

FORMAT = 1
"""Version of the encoding; a record of another one cannot be replayed."""


class InputsError(ValueError):
    """What was recorded of the inputs is damaged, or of another version."""


class BlockError(InputsError):
    """A block of inputs is damaged; `number` says which."""

    def __init__(self, number: int, why: InputsError) -> None:
        """Take the number of the block, and what is wrong with it."""
        super().__init__(str(why))
        self.number = number


class GapError(InputsError):
    """Inputs are missing; `next_at` is the time of the next that are there (s)."""

    def __init__(self, next_at: float) -> None:
        """Take the time at which the inputs go on."""
        super().__init__('inputs are missing')
        self.next_at = next_at


# ----- with what the rules begin --------------------------------------------------------------


class Entrant(NamedTuple):
    """A kart of the roster, as far as the rules know it; records of before lack `inspected`."""

    number: int
    team: str
    in_race: bool
    inspected: str = ''


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
            Kart(kart.number, kart.team, kart.in_race, inspected=kart.inspected)
            for kart in self.karts
        ]
        return Race(karts, self.times, self.now, self.heats)

    def to_json(self) -> str:
        """Return it as JSON."""
        return json.dumps({'format': FORMAT, **dataclasses.asdict(self)})

    @staticmethod
    def from_json(text: str) -> Setup:
        """
        Return what ``to_json`` made JSON of.

        :raises InputsError: if it is damaged, or of another version.
        """
        try:
            given = json.loads(text)
            if given['format'] != FORMAT:
                raise InputsError(f'its format is {given["format"]!r}, not {FORMAT}')
            times = given['times']
            setup = Setup(
                tuple(Entrant(*kart) for kart in given['karts']),
                RaceTimes(**{**times, 'finish_delays': tuple(times['finish_delays'])}),
                tuple(Heat(heat['name'], tuple(heat['karts'])) for heat in given['heats']),
                given['now'],
            )
            setup._check()
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
            raise InputsError(f'the setup cannot be read: {error}') from error
        return setup

    def _check(self) -> None:
        """Raise a ValueError or TypeError at what is good JSON and no setup."""
        names = [heat.name for heat in self.heats]
        numbers = [number for heat in self.heats for number in heat.karts]
        for kart in self.karts:
            numbers.append(kart.number)
            names += [kart.team, kart.inspected]
        ''.join(names).encode()
        if not all(type(number) is int and 0 < number < 2**32 for number in numbers):
            raise ValueError('a kart has no number')
        delays, *times = dataclasses.astuple(self.times)
        if not all(abs(time) < 1e10 for time in (self.now, *delays, *times)):
            raise ValueError('a time is none')


# ----- the inputs -----------------------------------------------------------------------------


class Commanded(NamedTuple):
    """An official's command, and when it came (s)."""

    at: float
    command: Command
    came: float

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.command(self.command, self.at, self.came)


class Connected(NamedTuple):
    """A kart has a new connection."""

    at: float
    kart: int

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.connected(self.kart, self.at)


CLOSED_BY_KART = 'the kart closed the connection'
"""Why a connection is gone that its kart ended in good order."""


class Disconnected(NamedTuple):
    """A kart's connection is gone."""

    at: float
    kart: int
    reason: str

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.disconnected(self.kart, self.reason, self.at)


class Heard(NamedTuple):
    """A kart said a state, and can have meant the order of this serial."""

    at: float
    kart: int
    serial: int
    state: RaceState

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.heard(self.kart, self.serial, self.state, self.at)


class Tick(NamedTuple):
    """Time passed."""

    at: float

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.tick(self.at)


class HeldUp(NamedTuple):
    """Race control was held up for so long (s)."""

    at: float
    seconds: float

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.held_up(self.seconds, self.at)


class Rival(NamedTuple):
    """Another race control came or went."""

    at: float
    present: bool

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.rival(self.present, self.at)


class RecordTrouble(NamedTuple):
    """Why the record fails, as a sentence for officials; empty: it works."""

    at: float
    text: str

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.record_trouble(self.text, self.at)


class StartBecame(NamedTuple):
    """What the start of this number waits for came to this ``StartPhase``."""

    at: float
    phase: int
    number: int

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.start_becomes(StartPhase(self.phase), self.number, self.at)


class Recovered(NamedTuple):
    """What is known of the last run; None: nothing."""

    at: float
    memory: RaceMemory | None

    def feed(self, race: Race) -> Outcome:
        """Hand it to the rules."""
        return race.recover(self.memory, self.at)


Input = (
    Commanded
    | Connected
    | Disconnected
    | Heard
    | Tick
    | HeldUp
    | Rival
    | RecordTrouble
    | StartBecame
    | Recovered
)


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
    """A copy of the race of this number was shown to the ROS half here."""

    at: float
    number: int


class Published(NamedTuple):
    """What the ROS half published of the copy of this number: the `digest` of what it offered."""

    number: int
    digest: int


Mark = Ordered | Told | Shown | Published
Entry = Input | Mark


# ----- what officials are offered -------------------------------------------------------------

_TO_ONE_KART = tuple(kind for kind, entry in CATALOGUE.items() if entry.to_one_kart)
_TO_ALL = tuple(kind for kind, entry in CATALOGUE.items() if not entry.to_one_kart)

Offers = Mapping[int, list[Availability]]
"""Every command that is offered, by the number of the kart; 0: no single kart."""


def offers(race: Race, now: float) -> Offers:
    """Return for every command whether it would be accepted at this time (s)."""
    offered = {0: [race.availability(kind, 0, now) for kind in _TO_ALL]}
    for number in sorted(race.karts):
        offered[number] = [race.availability(kind, number, now) for kind in _TO_ONE_KART]
    return offered


def digest(offered: Offers) -> int:
    """Return a number (32 bits) in which any two that differ will hardly ever be alike."""
    return zlib.crc32(
        '\n'.join(
            [
                f'{number}\t{each.reason}\t{each.statement}\t{each.karts}\t{each.available_from}'
                for number, availabilities in offered.items()
                for each in availabilities
            ]
        ).encode(errors='surrogatepass')
    )


# ----- encoding -------------------------------------------------------------------------------

_HEARD = struct.Struct('<BdIIB')
_HEARD_CODE = 1
_ORDERED = struct.Struct('<BI')
_ORDERED_CODE = 2
_ORDER = struct.Struct('<IBI')
_WRITTEN = struct.Struct('<BdI')
"""Of an entry in JSON: its code, its time, and how many bytes of JSON follow."""

_STATES = tuple(RaceState)

_FIXED: dict[type[Any], tuple[int, struct.Struct]] = {
    Tick: (3, struct.Struct('<Bd')),
    Connected: (4, struct.Struct('<BdI')),
    HeldUp: (5, struct.Struct('<Bdd')),
    Rival: (6, struct.Struct('<Bd?')),
    StartBecame: (7, struct.Struct('<BdBQ')),
    Told: (10, struct.Struct('<BQQ')),
    Shown: (11, struct.Struct('<BdQ')),
    Published: (12, struct.Struct('<BQI')),
}
"""Entries whose fields stand one after the other behind their code."""

_JSON: dict[type[Any], int] = {Commanded: 20, Disconnected: 21, RecordTrouble: 22, Recovered: 23}
"""Entries whose fields but the time are JSON."""

_FIXED_OF_CODE = {code: (kind, layout) for kind, (code, layout) in _FIXED.items()}
_JSON_OF_CODE = {code: kind for kind, code in _JSON.items()}


def encode(entry: Entry) -> bytes:
    """Return an entry as bytes."""
    if type(entry) is Heard:  # by far the most frequent
        at, kart, serial, state = entry
        return _HEARD.pack(_HEARD_CODE, at, kart, serial, state.strictness)
    fixed = _FIXED.get(type(entry))
    if fixed is not None:
        code, layout = fixed
        return layout.pack(code, *entry)
    if isinstance(entry, Ordered):
        orders = [_ORDER.pack(each.kart, each.state.strictness, each.serial) for each in entry[0]]
        return _ORDERED.pack(_ORDERED_CODE, len(orders)) + b''.join(orders)
    at, *rest = entry
    # JSON would make a list of a command.
    fields = [each._asdict() if isinstance(each, Command) else each for each in rest]
    data = json.dumps(fields, default=_in_json).encode()
    return _WRITTEN.pack(_JSON[type(entry)], at, len(data)) + data


def decode(data: bytes) -> Iterator[Entry]:
    """
    Yield the entries that were encoded, in order.

    :raises InputsError: where they are damaged, or of another version.
    """
    place = 0
    try:
        while place < len(data):
            code = data[place]
            if code == _HEARD_CODE:
                _, at, kart, serial, state = _HEARD.unpack_from(data, place)
                place += _HEARD.size
                yield Heard(at, kart, serial, _STATES[state])
            elif code in _FIXED_OF_CODE:
                kind, layout = _FIXED_OF_CODE[code]
                _, *fields = layout.unpack_from(data, place)
                place += layout.size
                yield kind(*fields)
            elif code == _ORDERED_CODE:
                _, count = _ORDERED.unpack_from(data, place)
                place += _ORDERED.size
                end = place + count * _ORDER.size
                orders = _ORDER.iter_unpack(_part(data, place, end))
                place = end
                yield Ordered(tuple(Order(kart, _STATES[n], serial) for kart, n, serial in orders))
            else:
                kind = _JSON_OF_CODE[code]
                _, at, length = _WRITTEN.unpack_from(data, place)
                place += _WRITTEN.size
                fields = json.loads(_part(data, place, place + length))
                place += length
                yield _written(kind, at, fields)
    except (
        *(ValueError, LookupError, TypeError, AttributeError),
        *(RecursionError, struct.error),
    ) as error:
        raise InputsError(f'an entry cannot be read: {error!r}') from error


def _part(data: bytes, begin: int, end: int) -> bytes:
    if end > len(data):
        raise InputsError('an entry is cut off')
    return data[begin:end]


def _in_json(value: object) -> object:
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, frozenset):
        return sorted(value)
    assert isinstance(value, RaceMemory | KartMemory)
    return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}


def _written(kind: type[Any], at: float, fields: list[Any]) -> Input:
    """Return an entry of which JSON was made."""
    if kind is Commanded:
        given, came = fields
        hold = given['hold']
        command = Command(
            **{
                **given,
                'kind': CommandKind[given['kind']],
                'karts': frozenset(given['karts']),
                'hold': None if hold is None else RaceState[hold],
            }
        )
        return Commanded(at, command, came)
    if kind is Recovered:
        (given,) = fields
        if given is None:
            return Recovered(at, None)
        karts = {
            int(number): KartMemory(**{**kart, 'doubt': Doubt(kart['doubt'])})
            for number, kart in given['karts'].items()
        }
        memory = {**given, 'state': RaceState[given['state']], 'karts': karts}
        return Recovered(at, RaceMemory(**memory))
    entry: Input = kind(at, *fields)
    return entry


# ----- the log, in blocks ---------------------------------------------------------------------

_HEAD = struct.Struct('<QQdI')


class Block(NamedTuple):
    """
    A part of a log.

    :param entries: how many entries came before it.
    :param inputs: how many of them were inputs.
    :param at: the time of the last of these (s).
    :param length: how many entries it has.
    :param data: these, encoded.
    """

    entries: int
    inputs: int
    at: float
    length: int
    data: bytes

    def compressed(self) -> bytes:
        """Return the block in few bytes, which show whether they were damaged."""
        return zlib.compress(_HEAD.pack(*self[:4]) + self.data)

    @staticmethod
    def of(data: bytes) -> Block:
        """
        Return the block that was compressed.

        :raises InputsError: if it is damaged.
        """
        try:
            whole = zlib.decompress(data)
            entries, before, at, length = _HEAD.unpack_from(whole)
            begin = _HEAD.size
            return Block(entries, before, at, length, whole[begin:])
        except (zlib.error, struct.error) as error:
            raise InputsError(f'a block cannot be read: {error}') from error


def joined(blocks: Iterable[Block]) -> Iterator[Block]:
    """Yield the same entries in few blocks: a new one only where some are missing."""
    parts: list[Block] = []
    for block in blocks:
        if parts and block.entries != parts[-1].entries + parts[-1].length:
            yield _one(parts)
            parts = []
        parts.append(block)
    if parts:
        yield _one(parts)


def _one(parts: list[Block]) -> Block:
    length = sum(part.length for part in parts)
    return parts[0]._replace(length=length, data=b''.join(part.data for part in parts))


class Log:
    """
    Everything that went into the rules of one race, and the marks between.

    :param at: when the race began (s).
    """

    def __init__(self, at: float) -> None:
        """Begin with nothing."""
        self._new: list[Entry] = []
        self._begins = Block(0, 0, at, 0, b'')
        self._at = at
        self._inputs = 0

    def add(self, given: Input) -> None:
        """Take an input, before it goes into the rules."""
        self._new.append(given)
        self._at = given.at
        self._inputs += 1

    def mark(self, mark: Mark) -> None:
        """Take a mark."""
        self._new.append(mark)

    def take(self) -> Block:
        """Return what was added since this was asked last; perhaps nothing."""
        data = b''.join(map(encode, self._new))
        block = self._begins._replace(length=len(self._new), data=data)
        self._begins = Block(
            block.entries + block.length, block.inputs + self._inputs, self._at, 0, b''
        )
        self._new.clear()
        self._inputs = 0
        return block


def entries_of(blocks: Iterable[tuple[int, bytes]]) -> Iterator[Entry]:
    """
    Yield the entries of a run.

    :param blocks: each block with its number, in order and compressed.
    :raises GapError: where entries are missing.
    :raises BlockError: where a block is damaged.
    """
    entries = 0
    for number, data in blocks:
        try:
            block = Block.of(data)
            if block.entries == entries:
                yield from decode(block.data)
        except InputsError as error:
            raise BlockError(number, error) from error
        if block.entries != entries:
            raise GapError(block.at)
        entries += block.length
