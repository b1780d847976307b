# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the decoder makes of bytes, held against a second decoder that is too simple to err."""

from __future__ import annotations

import itertools

from evgp_protocol.frames import encode, FrameDecoder, MalformedFrame, StateFrame
from evgp_protocol.states import RaceState
from fuzz_targets import by_bytes, check_decoder, comparable
from hypothesis import example, given
from hypothesis import strategies as st
import pytest

Event = StateFrame | MalformedFrame


def decode(pieces: list[bytes]) -> list[Event]:
    decoder = FrameDecoder()
    return [event for piece in pieces for event in decoder.feed(piece)]


valid = st.sampled_from([encode(state) for state in RaceState])
# Mostly the bytes that mean something, so that Hypothesis meets the rules and not only noise.
telling = st.text('$;$; \n\rARED_G', max_size=40).map(str.encode)
streams = st.lists(valid | st.binary(max_size=70) | telling, max_size=12).map(b''.join)


def test_frame_is_the_proposals_example() -> None:
    assert encode(RaceState.GRID_ACTIVE) == b'$GRID_ACTIVE;'


@given(streams)
@example(b'$' + b'A' * 30 + b';$RED_RED;')
@example(b'$' + b'A' * 31 + b';$RED_RED;')
@example(b'$READY;$red_red;$RED_RED ;RED_RED;$RED_RED\0;')
@example(b' \t\r\n\0$RED_RED;\0\r\n \t')
def test_a_stream_is_decoded_by_the_rules_however_it_is_cut(stream: bytes) -> None:
    check_decoder(stream)


@pytest.mark.parametrize('length', range(1, 5))
def test_every_short_stream_of_telling_bytes_is_decoded_by_the_rules(length: int) -> None:
    pieces = [b'$', b';', b' ', b'\0', b'x', b'\x80', b'RED_RED', b'A' * 29]
    for chosen in itertools.product(pieces, repeat=length):
        stream = b''.join(chosen)
        expected, _ = by_bytes(stream, False)
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
