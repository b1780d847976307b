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
of the dataclasses below, pickled, behind its length. Both ends are this package and nobody else
can reach the pair, so pickle is safe here.

No ROS, no thread, no clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import pathlib
import pickle
import struct
from typing import Any

from evgp_rcs.kart_server import ServerSettings
from evgp_rcs.race import Answer, Command, Race, RaceTimes, StampedEvent
from evgp_rcs.roster import Roster

_LENGTH = struct.Struct('!I')


# ----- from the ROS half to the kart server ---------------------------------------------------


@dataclass(frozen=True)
class Begin:
    """The first message: with what to start, and where the record is."""

    roster: Roster
    times: RaceTimes
    settings: ServerSettings
    record: pathlib.Path


@dataclass(frozen=True)
class Request:
    """
    An official's command.

    :param number: counts the requests, so that the answer finds its way back.
    :param came: when the command came, on the clock of the rules (s).
    """

    number: int
    command: Command
    came: float


@dataclass(frozen=True)
class Withdraw:
    """Do not judge a request any more: its official was told that there is no answer."""

    number: int


@dataclass(frozen=True)
class Alive:
    """The ROS half can still take a stop. Also says whether it hears another race control."""

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
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
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
            message = bytes(self._data[head:end])
            del self._data[:end]
            yield pickle.loads(message)  # noqa: S301 - see above
