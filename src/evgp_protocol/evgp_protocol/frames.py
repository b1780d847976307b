# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Decodes the bytes on the wire into events, and encodes frames (§4.C).

Race control, the kart's bridge and teams without ROS use the same decoder. It has no socket,
clock, thread or log: the owner of the connection feeds it bytes and gets events. No bytes raise an
error, because anything that is not a frame becomes a ``MalformedFrame``.

Theory of operation. `_PIECES` is the grammar: it says what the next piece of a stream is, and
where it ends. Between two reads, the decoder keeps only a frame that has begun, of at most 31
bytes, or that it still skips what follows a malformed one. ``$`` starts a new frame everywhere, so
a valid frame is found after any garbage.
"""

from __future__ import annotations

import dataclasses
import re

from evgp_protocol.states import RaceState

DEFAULT_PORT = 12017
"""The TCP port on which race control listens; existing karts use it."""

MAX_FRAME_BYTES = 32
"""Maximum length of a frame, including ``$`` and ``;``, in bytes; the longest valid one has 13."""

# NUL counts as space: clients with a buffer of fixed size send the rest of it.
_PIECES = re.compile(
    rb"""
    (?P<space>   [ \t\r\n\0]+ )
  | (?P<frame>   \$[^;$\x80-\xff]{0,30}; )
  | (?P<begun>   \$[^;$\x80-\xff]{0,30} \Z )
  | (?P<cut_off> \$[^;$\x80-\xff]{0,30} (?=\$) )
  | (?P<high>    \$[^;$\x80-\xff]{0,30}[\x80-\xff] ) [^$]*
  | (?P<long>    \$[^;$\x80-\xff]{31} ) [^$]*
  | (?P<stray>   [^$] ) [^$]*
    """,
    re.DOTALL | re.VERBOSE,
)

_REASONS = {
    'frame': 'not the name of a race state',
    'cut_off': "cut off by the '$' of the next frame",
    'high': 'a byte that is not ASCII in a frame',
    'long': f"no ';' within {MAX_FRAME_BYTES} bytes",
    'stray': "a byte outside a frame: each frame begins with '$'",
}


@dataclasses.dataclass(frozen=True)
class StateFrame:
    """A valid frame: the name of a race state."""

    state: RaceState


@dataclasses.dataclass(frozen=True)
class MalformedFrame:
    """
    Bytes that are not a frame.

    :ivar reason: what is wrong with them, for people.
    :ivar raw: the first bytes, at most ``MAX_FRAME_BYTES``; outside a frame only the first one.
    """

    reason: str
    raw: bytes


def encode(state: RaceState) -> bytes:
    """Return the frame for a state, such as ``b'$RED_RED;'`` (§4.C)."""
    return b'$%b;' % state.value.encode('ascii')


class FrameDecoder:
    """
    Turns the bytes of one connection into events, however they are split (§4.C).

    One decoder serves one direction of one connection; a new connection needs a new decoder. It
    keeps fewer than ``MAX_FRAME_BYTES`` bytes, whatever arrives.

    :param ready_is_grid_active: read ``$READY;`` as ``$GRID_ACTIVE;``. The proposal mentions
        ``$READY;`` once (§3.A) as a kart's answer, so only race control's side sets this.
    """

    def __init__(self, ready_is_grid_active: bool = False) -> None:
        self._valid = {encode(state): StateFrame(state) for state in RaceState}
        if ready_is_grid_active:
            self._valid[b'$READY;'] = StateFrame(RaceState.GRID_ACTIVE)
        self._frame = b''  # the frame so far, '$' included; empty outside a frame
        self._skipping = False

    def feed(self, data: bytes | bytearray | memoryview) -> list[StateFrame | MalformedFrame]:
        """
        Decode the next bytes of the connection; return the events that they complete, in order.

        :param data: any number of bytes, including none.
        :return: the events, which do not depend on how the bytes are split.
        """
        return [event for event, _ in self.decode(data)]

    def decode(
        self, data: bytes | bytearray | memoryview
    ) -> list[tuple[StateFrame | MalformedFrame, int]]:
        """
        Decode the next bytes like `feed`, and return where in `data` each event began.

        :return: the events, and their places: below 0 for one that began in earlier data.
        """
        before = len(self._frame)
        stream, at = self._frame + bytes(data), 0
        if self._skipping:
            at = stream.find(b'$')
            if at < 0:
                return []
        self._frame, self._skipping = b'', False
        events: list[tuple[StateFrame | MalformedFrame, int]] = []
        while at < len(stream):
            piece = _PIECES.match(stream, at)
            assert piece is not None  # no byte lies outside the grammar
            kind, at = piece.lastgroup or '', piece.end()
            raw = piece[kind]
            if kind == 'begun':
                self._frame = raw
            elif kind == 'frame' and raw in self._valid:
                events.append((self._valid[raw], piece.start() - before))
            elif kind != 'space':
                events.append((MalformedFrame(_REASONS[kind], raw), piece.start() - before))
                self._skipping = kind != 'frame' and at == len(stream)
        return events
