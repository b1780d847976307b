# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the decoder makes of bytes, held against a second decoder that is too simple to err."""

from __future__ import annotations

from collections.abc import Callable
import itertools
import pickle
import sys
from types import FrameType
from typing import Any

from evgp_protocol import frames
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


def in_pieces(stream: bytes, size: int) -> list[bytes]:
    return [stream[at:][:size] for at in range(0, len(stream), size)]


valid = st.sampled_from([encode(state) for state in RaceState])
# Mostly the bytes that mean something, so that Hypothesis meets the rules and not only noise.
rubbish = st.one_of(
    st.binary(max_size=70),
    st.text('$;$; \n\rARED_G', max_size=40).map(str.encode),
    st.sampled_from(
        [
            b'$',
            b';',
            b' \r\n\t\0',
            b'$;',
            b'$READY;',
            b'$red_red;',
            b'$RED_RED ;',
            b'RED_RED;',
            b'$RED_',
            b'$' + b'A' * 30 + b';',
            b'$' + b'A' * 31 + b';',
            b'$' + b'A' * 31,
            b'$' + b'A' * 30,
            b'$\xff;',
            b'\0',
            b'$RED_RED\0;',
        ]
    ),
)
streams = st.lists(st.one_of(valid, rubbish), max_size=12).map(b''.join)


def test_frame_is_the_proposals_example() -> None:
    assert encode(RaceState.GRID_ACTIVE) == b'$GRID_ACTIVE;'


@given(streams)
@example(b'$' + b'A' * 30 + b';$RED_RED;')
@example(b'$' + b'A' * 31 + b';$RED_RED;')
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


@given(streams)
def test_every_kind_of_buffer_is_accepted(stream: bytes) -> None:
    expected = FrameDecoder().feed(stream)
    assert FrameDecoder().feed(bytearray(stream)) == expected
    assert FrameDecoder().feed(memoryview(stream)) == expected


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


NOISES = [b'$', b';', b'A', b' ', b'\0', b'\xff', b'$A', b'$RED_RED;', b'x;', b'\xff$']
NOISES += [b'$' + b'A' * 40]


@pytest.mark.parametrize('noise', NOISES, ids=repr)
def test_memory_is_bounded_whatever_arrives(noise: bytes) -> None:
    decoder = FrameDecoder()
    empty = len(pickle.dumps(decoder))
    for _ in range(50):
        decoder.feed((noise * 1024)[:1024])
        assert len(pickle.dumps(decoder)) < empty + 2 * frames.MAX_FRAME_BYTES


def lines(run: Callable[[], object]) -> int:
    """Count the lines of frames.py that are executed while `run` runs."""
    count = 0

    def trace(frame: FrameType, event: str, argument: object) -> Callable[..., Any] | None:
        nonlocal count
        if frame.f_code.co_filename != frames.__file__:
            return None
        count += event == 'line'
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        run()
    finally:
        sys.settrace(before)
    return count


@pytest.mark.parametrize('noise', NOISES, ids=repr)
@pytest.mark.parametrize(('size', 'length'), [(1, 512), (31, 512), (4096, 4096)])
def test_work_is_linear_in_the_bytes(noise: bytes, size: int, length: int) -> None:
    def cost(length: int) -> int:
        stream = (noise * length)[:length]
        pieces = in_pieces(stream, size)
        return lines(lambda: decode(pieces))

    once, eightfold = cost(length), cost(8 * length)
    assert once > 0
    assert eightfold <= 8 * once + 100
