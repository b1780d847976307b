# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Decodes the bytes on the wire into events, and encodes frames (§4.C).

Race control, the kart's bridge and teams without ROS use the same decoder. It has no socket,
clock, thread or log: the owner of the connection feeds it bytes and gets events. No bytes raise an
error, because anything that is not a frame becomes a ``MalformedFrame``.

Theory of operation. The decoder is always in one of three places:

============== ===================================================== =======================
place          what is kept                                          left by
============== ===================================================== =======================
between frames nothing                                               ``$`` → in a frame;
                                                                     a stray byte → skipping
in a frame     the frame so far, at most 31 bytes                    ``;`` → between frames;
                                                                     ``$`` → in a new frame;
                                                                     too long, or a byte that
                                                                     is not ASCII → skipping
skipping       nothing                                               ``$`` → in a frame
============== ===================================================== =======================

``$`` starts a new frame from every place, so a valid frame is found after any garbage. Each byte
is examined once, by the C code of ``re``, wherever the reads cut the stream.
"""

from __future__ import annotations

import dataclasses
import re

from evgp_protocol.states import RaceState

DEFAULT_PORT = 12017
"""The TCP port on which race control listens; existing karts use it."""

MAX_FRAME_BYTES = 32
"""Maximum length of a frame, including ``$`` and ``;``, in bytes; the longest valid one has 13."""

_FIRST = b'$'

# Named so that tests can put faults into them.
# NUL counts as space: clients with a buffer of fixed size send the rest of it.
_find_no_space = re.compile(rb'[^ \t\r\n\0]').search
_find_first = re.compile(rb'\$').search
_find_last = re.compile(rb'[;$\x80-\xff]').search


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
        self._valid = {state.value.encode('ascii'): StateFrame(state) for state in RaceState}
        if ready_is_grid_active:
            self._valid[b'READY'] = StateFrame(RaceState.GRID_ACTIVE)
        self._frame = b''  # the frame so far, '$' included; empty outside a frame
        self._skipping = False

    @property
    def in_frame(self) -> bool:
        """
        Return whether a frame has begun but not ended.

        Race control checks this when it sends a command: a frame that began before the command
        cannot acknowledge it.
        """
        return self._frame != b''

    def feed(self, data: bytes | bytearray | memoryview) -> list[StateFrame | MalformedFrame]:
        """
        Decode the next bytes of the connection; return the events that they complete, in order.

        :param data: any number of bytes, including none.
        :return: the events, which do not depend on how the bytes are split.
        """
        data = bytes(data)
        events: list[StateFrame | MalformedFrame] = []
        at = 0
        while at < len(data):
            go_on = self._inside if self._frame else self._outside
            at = go_on(data, at, events)
        return events

    def _outside(self, data: bytes, at: int, events: list[StateFrame | MalformedFrame]) -> int:
        """Decode between frames, or while skipping, from `data[at]`; return where to continue."""
        found = (_find_first if self._skipping else _find_no_space)(data, at)
        if found is None:
            return len(data)
        if found.group() == _FIRST:
            self._skipping = False
            self._frame = _FIRST
        else:
            self._skipping = True
            events.append(
                MalformedFrame("a byte outside a frame: each frame begins with '$'", found.group())
            )
        return found.end()

    def _inside(self, data: bytes, at: int, events: list[StateFrame | MalformedFrame]) -> int:
        """Decode inside a frame from `data[at]`; return where to continue."""
        end = min(len(data), at + MAX_FRAME_BYTES - len(self._frame))
        found = _find_last(data, at, end)
        if found is None:
            self._frame += data[at:end]
            if len(self._frame) == MAX_FRAME_BYTES:
                self._give_up(f"no ';' within {MAX_FRAME_BYTES} bytes", events)
            return end
        last, end = found.group(), found.end()
        self._frame += data[at:end]
        if last == _FIRST:
            cut_off = MalformedFrame("cut off by the '$' of the next frame", self._frame[:-1])
            events.append(cut_off)
            self._frame = _FIRST
            return end
        if last != b';':
            self._give_up('a byte that is not ASCII in a frame', events)
            return end
        valid = self._valid.get(self._frame[1:-1])
        events.append(valid or MalformedFrame('not the name of a race state', self._frame))
        self._frame = b''
        return end

    def _give_up(self, reason: str, events: list[StateFrame | MalformedFrame]) -> None:
        """Report the frame so far and skip the rest up to the next ``$``."""
        events.append(MalformedFrame(reason, self._frame))
        self._frame = b''
        self._skipping = True
