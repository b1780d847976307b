# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Frames on the wire: bytes in, events out (§4.C).

Two rules of what lives here:

1. No socket, no clock, no thread, no log: whoever holds the connection feeds bytes and gets
   events. The same decoder serves race control, the kart's bridge and a team without ROS.
2. Bytes never raise. Whatever is no frame comes out as a ``MalformedFrame``.

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

``$`` leads into a new frame from everywhere, so a valid frame is found behind whatever rubbish.
Each byte is looked at once, by the C code of ``re``, wherever the reads cut the stream.
"""

from __future__ import annotations

import dataclasses
import re

from evgp_protocol.states import RaceState

DEFAULT_PORT = 12017
"""The TCP port at which race control listens; the one existing karts use."""

MAX_FRAME_BYTES = 32
"""The longest frame, in bytes, its ``$`` and ``;`` included. The longest valid one has 13."""

_FIRST = b'$'

# Named so that the tests can put something that counts in their place.
# A NUL, too: clients with a buffer of a fixed size send what is left of it.
_find_no_space = re.compile(rb'[^ \t\r\n\0]').search
_find_first = re.compile(rb'\$').search
_find_last = re.compile(rb'[;$\x80-\xff]').search


@dataclasses.dataclass(frozen=True)
class StateFrame:
    """A valid frame: the peer said the name of a race state."""

    state: RaceState


@dataclasses.dataclass(frozen=True)
class MalformedFrame:
    """
    Bytes that are no frame.

    :ivar reason: what is wrong with them, for the person who looks for the mistake.
    :ivar raw: the offending bytes from their first one, at most ``MAX_FRAME_BYTES`` of them;
        of a run outside a frame only the first byte.
    """

    reason: str
    raw: bytes


def encode(state: RaceState) -> bytes:
    """Return the frame that says `state`, such as ``b'$RED_RED;'`` (§4.C)."""
    return b'$%b;' % state.value.encode('ascii')


class FrameDecoder:
    """
    Turns the bytes of one connection into events, in whatever pieces they come (§4.C).

    One decoder serves one direction of one connection; a new connection needs a new one. It
    keeps less than ``MAX_FRAME_BYTES`` bytes, whatever arrives.

    :param ready_is_grid_active: take ``$READY;`` for ``$GRID_ACTIVE;``. The proposal names
        it once (§3.A) as what a kart answers, so only race control's side says True.
    """

    def __init__(self, ready_is_grid_active: bool = False) -> None:
        self._states = {state.value.encode('ascii'): state for state in RaceState}
        if ready_is_grid_active:
            self._states[b'READY'] = RaceState.GRID_ACTIVE
        self._frame = b''  # the frame so far, '$' included; empty: not in a frame
        self._skipping = False

    @property
    def in_frame(self) -> bool:
        """
        Return whether a frame has begun and not ended.

        Race control asks this at the moment of a command: a frame that began before it is
        no acknowledgement of it.
        """
        return self._frame != b''

    def feed(self, data: bytes | bytearray | memoryview) -> list[StateFrame | MalformedFrame]:
        """
        Take the next bytes of the connection and return what they complete, in order.

        :param data: any number of bytes, none included; not kept.
        :return: the events; the same ones in whatever pieces the bytes come.
        """
        data = bytes(data)
        events: list[StateFrame | MalformedFrame] = []
        at = 0
        while at < len(data):
            go_on = self._inside if self._frame else self._outside
            at = go_on(data, at, events)
        return events

    def _outside(self, data: bytes, at: int, events: list[StateFrame | MalformedFrame]) -> int:
        """Go on between frames, or skipping, from `data[at]`; return where to go on next."""
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
        """Go on in a frame from `data[at]`; return where to go on next."""
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
        state = self._states.get(self._frame[1:-1])
        if state is not None:
            events.append(StateFrame(state))
        else:
            events.append(MalformedFrame('not the name of a race state', self._frame))
        self._frame = b''
        return end

    def _give_up(self, reason: str, events: list[StateFrame | MalformedFrame]) -> None:
        """Report the frame so far, and skip what is left of it up to the next ``$``."""
        events.append(MalformedFrame(reason, self._frame))
        self._frame = b''
        self._skipping = True
