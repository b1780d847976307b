# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the decoder makes of bytes, held against a second decoder that is too simple to err."""

from __future__ import annotations

import itertools

from evgp_protocol.frames import (
    encode,
    FrameDecoder,
    MalformedFrame,
    MAX_FRAME_BYTES,
    StateFrame,
)
from evgp_protocol.states import RaceState
from hypothesis import example, given
from hypothesis import strategies as st
import pytest

Event = StateFrame | MalformedFrame


def decode(pieces: list[bytes]) -> list[Event]:
    decoder = FrameDecoder()
    return [event for piece in pieces for event in decoder.feed(piece)]


def by_bytes(data: bytes, ready: bool = False) -> tuple[list[object], bool]:
    """Return the events in a stream, byte by byte, and whether it ends inside a frame."""
    names = {state.value.encode(): state for state in RaceState}
    if ready:
        names[b'READY'] = RaceState.GRID_ACTIVE
    events: list[object] = []
    place, frame = 'between', b''
    for byte in data:
        if byte == ord('$'):
            if place == 'in':
                events.append(frame)
            place, frame = 'in', b'$'
        elif place == 'between':
            if byte not in b' \t\r\n\0':
                events.append(bytes([byte]))
                place = 'skipping'
        elif place == 'in':
            frame += bytes([byte])
            if byte == ord(';'):
                events.append(names.get(frame[1:-1], frame))
                place = 'between'
            elif byte > 127 or len(frame) == MAX_FRAME_BYTES:
                events.append(frame)
                place = 'skipping'
    return events, place == 'in'


def comparable(event: Event) -> object:
    """Return what `by_bytes` says of an event: the state, or the bytes."""
    return event.state if isinstance(event, StateFrame) else event.raw


valid = st.sampled_from([encode(state) for state in RaceState])
# Mostly the bytes that mean something, so that Hypothesis meets the rules and not only noise.
telling = st.text('$;$; \n\rARED_G', max_size=40).map(str.encode)
streams = st.lists(valid | st.binary(max_size=70) | telling, max_size=12).map(b''.join)


def test_frame_is_the_proposals_example() -> None:
    assert encode(RaceState.GRID_ACTIVE) == b'$GRID_ACTIVE;'


@given(streams, st.lists(st.integers(1, 40), min_size=1, max_size=8), st.booleans())
@example(b'$' + b'A' * 30 + b';$RED_RED;', [40], False)
@example(b'$' + b'A' * 31 + b';$RED_RED;', [40], False)
@example(b'$READY;$red_red;$RED_RED ;RED_RED;$RED_RED\0;', [7], True)
@example(b' \t\r\n\0$RED_RED;\0\r\n \t', [3], False)
def test_a_stream_is_decoded_by_the_rules_however_it_is_cut(
    stream: bytes, cuts: list[int], ready: bool
) -> None:
    expected, begun = by_bytes(stream, ready)
    for lengths in ([max(len(stream), 1)], [1], cuts):
        decoder = FrameDecoder(ready_is_grid_active=ready)
        found: list[object] = []
        rest, each = stream, itertools.cycle(lengths)
        while rest:
            length = next(each)
            found += map(comparable, decoder.feed(rest[:length]))
            rest = rest[length:]
            kept = [value for value in vars(decoder).values() if isinstance(value, bytes)]
            assert sum(map(len, kept)) < MAX_FRAME_BYTES
        assert found == expected
        assert (decoder._frame != b'') == begun
        for state in RaceState:  # none is lost behind it
            assert decoder.feed(encode(state))[-1:] == [StateFrame(state)]


@pytest.mark.parametrize('length', range(1, 5))
def test_every_short_stream_of_telling_bytes_is_decoded_by_the_rules(length: int) -> None:
    pieces = [b'$', b';', b' ', b'\0', b'x', b'\x80', b'RED_RED', b'A' * 29]
    for chosen in itertools.product(pieces, repeat=length):
        stream = b''.join(chosen)
        expected, _ = by_bytes(stream)
        assert [*map(comparable, decode([stream]))] == expected, stream
        assert [*map(comparable, decode(list(chosen)))] == expected, chosen


def test_buffer_may_be_reused_after_feed() -> None:
    decoder = FrameDecoder()
    buffer = bytearray(b'$RED_')
    decoder.feed(buffer)
    buffer[:] = b'XXXXX'
    assert decoder.feed(b'RED;') == [StateFrame(RaceState.RED_RED)]


@pytest.mark.parametrize(
    ('stream', 'word'),
    [
        (b'GRID_ACTIVE;', 'outside'),
        (b'$GRID_$', 'cut off'),
        (b'$' + b'A' * 40, '32 bytes'),
        (b'$RED\xe9', 'ASCII'),
        (b'$PURPLE;', 'name of a race state'),
    ],
)
def test_reason_names_the_mistake(stream: bytes, word: str) -> None:
    (event,) = decode([stream])
    assert isinstance(event, MalformedFrame)
    assert word in event.reason
