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
What the two processes of race control say to each other, over one local socket pair.

The *ROS half* (``node``) and the *kart server* (``kart_process``) are the two. Each message is one
of the classes below, pickled, behind its length; a `Request` as a plain tuple, for speed. Both
ends are this package and nobody else can reach the pair, so pickle is safe here.

No ROS, no thread, no clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import pathlib
import pickle
import struct
from typing import Any, NamedTuple

from evgp_rcs.catalogue import CommandKind
from evgp_rcs.kart_server import ServerSettings
from evgp_rcs.race import Answer, Command, Race, RaceTimes, StampedEvent
from evgp_rcs.roster import Roster

_LENGTH = struct.Struct('!I')

# Both ends are of one version.
_KINDS = tuple(CommandKind)
_NUMBER = {kind: number for number, kind in enumerate(_KINDS)}


# ----- from the ROS half to the kart server ---------------------------------------------------


@dataclass(frozen=True)
class Begin:
    """The first message: with what to start, and where the record is."""

    roster: Roster
    times: RaceTimes
    settings: ServerSettings
    record: pathlib.Path


class Request(NamedTuple):
    """
    An official's command.

    A stop waits until it is packed and unpacked. So it is a named tuple, and for pickle a plain
    one, which takes half the time.

    :param number: counts the requests, so that the answer finds its way back.
    :param came: when the command came, on the clock of the rules (s).
    """

    number: int
    command: Command
    came: float

    def plain(self) -> tuple[object, ...]:
        """Return it as a tuple of which pickle need not name the class."""
        kind, *rest = self.command
        return self.number, self.came, _NUMBER[kind], *rest

    @staticmethod
    def of(plain: tuple[Any, ...]) -> Request:
        """Return the request that ``plain`` made this of."""
        number, came, kind, *rest = plain
        return Request(number, Command(_KINDS[kind], *rest), came)


@dataclass(frozen=True)
class Withdraw:
    """Do not judge a request any more: its official was told that there is no answer."""

    number: int


@dataclass(frozen=True)
class Alive:
    """The ROS half goes on and hears officials. Also: whether it hears another race control."""

    rival: bool


@dataclass(frozen=True)
class Published:
    """
    What officials were shown of a copy. It is no sign of life: it says nothing about stops.

    :param number: of the `Copy`.
    :param digest: of the commands that it offered (``inputs.digest``).
    """

    number: int
    digest: int


@dataclass(frozen=True)
class End:
    """Send RED_RED to every kart and end."""

    in_order: bool


# ----- from the kart server to the ROS half ---------------------------------------------------


@dataclass(frozen=True)
class Listening:
    """Karts can connect, at this address and port."""

    address: tuple[str, int]


@dataclass(frozen=True)
class Refused:
    """The kart server cannot start; the text says why and what would be right."""

    text: str


@dataclass(frozen=True)
class Answered:
    """The answer to a request."""

    number: int
    answer: Answer


@dataclass(frozen=True)
class Happened:
    """What happened, in order."""

    events: list[StampedEvent]


@dataclass(frozen=True)
class Copy:
    """
    The race as it was at this time (the clock of the rules, s).

    :param number: counts the copies; one that was left out is missing.
    """

    race: Race
    at: float
    number: int


@dataclass(frozen=True)
class Failed:
    """The last message of a kart server that could not go on: every kart was sent RED_RED."""

    text: str


def pack(message: object) -> bytes:
    """Return a message as bytes."""
    given = message.plain() if isinstance(message, Request) else message
    data = pickle.dumps(given, pickle.HIGHEST_PROTOCOL)
    return _LENGTH.pack(len(data)) + data


class Unpacker:
    """Cuts the bytes of one direction into messages."""

    def __init__(self) -> None:
        """Begin with no bytes."""
        self._data = bytearray()

    def feed(self, data: bytes) -> Iterator[Any]:
        """Yield the messages that are whole by now."""
        self._data += data
        head = _LENGTH.size
        while len(self._data) >= head:
            end = head + _LENGTH.unpack_from(self._data)[0]
            if len(self._data) < end:
                return
            message = pickle.loads(bytes(self._data[head:end]))  # noqa: S301 - see above
            del self._data[:end]
            yield Request.of(message) if isinstance(message, tuple) else message
