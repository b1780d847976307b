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

"""Which of what a kart says can answer an order: by counts and bytes alone, without a socket."""

from __future__ import annotations

from evgp_protocol.frames import encode, FrameDecoder, StateFrame
from evgp_protocol.states import RaceState
from evgp_rcs import hearing
from evgp_rcs.hearing import DEAF, FLOOD, FLOOD_BYTES, Heard, Hearing, NO_ORDER
from hypothesis import given
from hypothesis import strategies as st
import pytest

RED = encode(RaceState.RED_RED)
RATES = pytest.mark.parametrize('beat_rate', [10.0, 20.0, 100.0])


def say(kart: Hearing, data: bytes) -> list[int]:
    """Have all of it read and decoded, and return the order that each frame can answer."""
    kart.read(len(data))
    return [serial for _, serial in kart.decode(memoryview(data))]


@pytest.fixture
def kart() -> Hearing:
    """Return what is heard of a kart that was sent order 1."""
    kart = Hearing(20.0)
    kart.order(1, 0)
    return kart


def test_what_came_after_an_order_can_answer_it(kart: Hearing) -> None:
    assert say(kart, RED + RED) == [1, 1]


def test_what_lay_unread_when_the_order_went_out_cannot_answer_it(kart: Hearing) -> None:
    kart.order(2, 2 * len(RED))
    assert say(kart, RED) == [NO_ORDER]
    assert say(kart, RED + RED) == [NO_ORDER, 2]


def test_what_was_read_and_not_decoded_when_the_order_went_out_cannot_answer_it(
    kart: Hearing,
) -> None:
    kart.read(len(RED))
    kart.order(2, 0)
    assert [serial for _, serial in kart.decode(memoryview(RED))] == [NO_ORDER]
    assert say(kart, RED) == [2]


@pytest.mark.parametrize('begun', range(1, len(RED)))
def test_a_frame_that_began_before_the_order_cannot_answer_it(kart: Hearing, begun: int) -> None:
    assert say(kart, RED[:begun]) == []
    kart.order(2, 0)
    assert say(kart, RED[begun:] + RED) == [NO_ORDER, 2]


def test_a_frame_that_was_cut_off_by_an_answer_does_not_spoil_it(kart: Hearing) -> None:
    assert say(kart, b'$RED') == []
    kart.order(2, 0)
    assert say(kart, RED) == [NO_ORDER, 2]  # what was cut off, and the answer


def test_an_order_that_comes_of_what_was_said_is_answered_by_nothing_said_before(
    kart: Hearing,
) -> None:
    """The owner may order in the midst of what was decoded in one go."""
    data = RED + RED[:3]
    kart.read(len(data))
    kart.decode(memoryview(data))
    kart.order(2, 0)
    assert say(kart, RED[3:]) == [NO_ORDER]


@RATES
def test_a_flood_may_last_for_2_s_at_every_beat_rate(beat_rate: float) -> None:
    kart = Hearing(beat_rate)
    beats = 0
    while True:
        say(kart, b' ' * FLOOD_BYTES)
        assert kart.is_full
        if kart.beat(beats / beat_rate):
            break
        beats += 1
    assert beats / beat_rate == FLOOD


def test_a_flood_that_makes_the_beats_late_lasts_no_longer(kart: Hearing) -> None:
    say(kart, b' ' * FLOOD_BYTES)
    assert not kart.beat(0.0)
    say(kart, b' ' * FLOOD_BYTES)
    assert kart.beat(FLOOD)


@RATES
def test_a_flood_that_pauses_for_1_s_begins_again(beat_rate: float) -> None:
    kart = Hearing(beat_rate)
    for beat in range(round(5 * (FLOOD + DEAF) * beat_rate)):
        if beat % round((FLOOD + DEAF) * beat_rate) >= round(DEAF * beat_rate):
            say(kart, b' ' * FLOOD_BYTES)
        assert not kart.beat(beat / beat_rate)


@RATES
def test_a_flood_that_pauses_for_less_goes_on(beat_rate: float) -> None:
    kart = Hearing(beat_rate)
    ends = []
    for beat in range(round(FLOOD * beat_rate) + 1):
        # A busy computer reads a flood in pieces, and now and then a piece is the last for now.
        if beat % round(DEAF * beat_rate) == 0:
            say(kart, b' ' * FLOOD_BYTES)
        ends.append(kart.beat(beat / beat_rate))
    assert ends == [False] * round(FLOOD * beat_rate) + [True]


@RATES
def test_nothing_counts_during_a_flood_and_for_1_s_after_at_every_beat_rate(
    beat_rate: float,
) -> None:
    kart = Hearing(beat_rate)
    kart.order(1, 0)
    for _ in range(3):
        say(kart, b' ' * FLOOD_BYTES)
        kart.beat(0.0)
        assert say(kart, RED) == [NO_ORDER]
    beats = 0
    while say(kart, RED) == [NO_ORDER]:
        kart.beat(0.0)
        beats += 1
    assert beats / beat_rate == DEAF


def test_a_frame_that_began_while_nothing_counted_does_not_count(kart: Hearing) -> None:
    say(kart, b' ' * FLOOD_BYTES)
    kart.beat(0.0)
    for _ in range(round(DEAF * 20.0) - 1):
        kart.beat(0.0)
    assert say(kart, RED[:4]) == []
    kart.beat(0.0)
    assert say(kart, RED[4:] + RED) == [NO_ORDER, 1]


# ----- every interleaving --------------------------------------------------------------------

SMALL_FLOOD = 40
"""In place of `FLOOD_BYTES`, so that Hypothesis meets floods, bytes."""

said = st.one_of(
    st.sampled_from([encode(state) for state in RaceState]),
    st.sampled_from([b'$', b';', b'$RED_', b'RED;', b'$READY;', b' ', b'\xff', b'$' * 33]),
    st.binary(max_size=6),
)
steps = st.lists(
    st.one_of(
        st.tuples(st.just('arrive'), said),
        # How many bytes are read; whether an order goes out before they are decoded.
        st.tuples(st.just('read'), st.tuples(st.integers(1, SMALL_FLOOD), st.booleans())),
        st.tuples(st.just('order'), st.none()),
        st.tuples(st.just('beats'), st.integers(1, 25)),
    ),
    max_size=60,
)


class Connection:
    """A connection as the kernel and a slow judge see it: every byte with all that befell it."""

    def __init__(self, beat_rate: float) -> None:
        self.kart = Hearing(beat_rate)
        self._beat_rate = beat_rate
        self._now = 0.0
        self.heard: list[tuple[Heard, int]] = []
        self.arrived = b''
        self.order_of: list[int] = []  # of each decoded byte: the newest order that it can answer
        self._read = 0
        self._serial = 0
        self._arrived_at_order = 0
        self._in_this_beat = 0
        self._quiet_beats = 1000
        self._deaf_beats = DEAF * beat_rate

    def arrive(self, data: bytes) -> None:
        self.arrived += data

    def order(self, _: None = None) -> None:
        self._serial += 1
        self._arrived_at_order = len(self.arrived)
        self.kart.order(self._serial, len(self.arrived) - self._read)

    def read(self, how: tuple[int, bool]) -> None:
        count, order_comes = how
        begin, end = self._read, self._read + count
        data = self.arrived[begin:end]
        if not data or self.kart.is_full:
            return
        self._read += len(data)
        self._in_this_beat += len(data)
        self.kart.read(len(data))
        if order_comes:
            self.order()
        self.heard += self.kart.decode(memoryview(data))
        deaf = self._quiet_beats < self._deaf_beats
        for place in range(self._read - len(data), self._read):
            fresh = place >= self._arrived_at_order and not deaf
            self.order_of.append(self._serial if fresh else NO_ORDER)

    def beats(self, count: int) -> None:
        for _ in range(count):
            assert self.kart.is_full == (self._in_this_beat >= SMALL_FLOOD)
            self._quiet_beats = 0 if self.kart.is_full else self._quiet_beats + 1
            self._in_this_beat = 0
            self._now += 1.0 / self._beat_rate
            self.kart.beat(self._now)


@given(steps, st.sampled_from([10.0, 20.0]))
def test_a_frame_answers_an_order_only_if_all_of_it_came_after_the_order_and_no_flood(
    steps: list[tuple[str, object]], beat_rate: float
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hearing, 'FLOOD_BYTES', SMALL_FLOOD)
        connection = Connection(beat_rate)
        for what, how in steps:
            getattr(connection, what)(how)
    decoder = FrameDecoder(ready_is_grid_active=True)
    stream = connection.arrived[: len(connection.order_of)]
    expected: list[tuple[Heard, int | None]] = []
    for end, byte in enumerate(stream, 1):
        for event in decoder.feed(bytes([byte])):
            serials = set()
            if isinstance(event, StateFrame):
                begin = stream.rindex(b'$', 0, end)
                serials = set(connection.order_of[begin:end])
            expected.append((event, serials.pop() if len(serials) == 1 else NO_ORDER))
    assert [event for event, _ in connection.heard] == [event for event, _ in expected]
    for (event, serial), (_, wanted) in zip(connection.heard, expected, strict=True):
        if isinstance(event, StateFrame):
            assert serial == wanted
