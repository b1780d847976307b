# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Which order each word of a kart answers: by counts, bytes and beats alone, without a socket."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import itertools
import math

from evgp_protocol import hearing
from evgp_protocol.frames import encode, FrameDecoder, StateFrame
from evgp_protocol.hearing import DEAF, FLOOD_BYTES, Heard, Hearing, NO_ORDER, QUIET
from evgp_protocol.states import RaceState
from hypothesis import given
from hypothesis import strategies as st
import pytest

GARAGE, GRID, GREEN = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN
RED = encode(RaceState.RED_RED)


class OneKart:
    """What is heard of a kart whose TCP answers every order at once, unless told otherwise."""

    def __init__(self, beat_rate: float = 20.0) -> None:
        self.hearing = Hearing(beat_rate)
        self.pause = round(QUIET * beat_rate) + 1
        self._sent = 0
        self._serial = 0

    def order(self, *states: RaceState, answered: bool = True) -> None:
        for state in states:
            self._sent += len(encode(state))
            self._serial += 1
            self.hearing.order(self._serial, state, self._sent, 0)
        if answered:
            self.answer()

    def answer(self, lacking: int = 0) -> None:
        """See how much its TCP has answered."""
        self.hearing.look(self._sent - lacking, 0)

    def say(self, *said: RaceState | bytes) -> list[int]:
        """Have all of it read and decoded, and return the order that each frame answers."""
        data = b''.join(each if isinstance(each, bytes) else encode(each) for each in said)
        self.hearing.read(len(data))
        return [serial for _, serial in self.hearing.decode(memoryview(data))]

    def beats(self, count: int) -> None:
        for _ in range(count):
            self.hearing.beat(0.0)


@pytest.fixture
def kart() -> OneKart:
    """Return a kart that was sent RED_RED, order 1."""
    kart = OneKart()
    kart.order(RaceState.RED_RED)
    return kart


def test_what_was_there_while_the_karts_tcp_had_not_answered_the_order_does_not_answer_it(
    kart: OneKart,
) -> None:
    kart.order(GRID, answered=False)
    assert kart.hearing.waits
    kart.hearing.read(len(encode(GRID)))
    kart.answer(lacking=1)
    assert [serial for _, serial in kart.hearing.decode(memoryview(encode(GRID)))] == [NO_ORDER]
    kart.answer()
    assert not kart.hearing.waits
    assert kart.say(GRID) == [2]


PAUSE = OneKart().pause


@pytest.mark.parametrize(
    ('before', 'answered', 'after', 'order'),
    [
        pytest.param(0, True, PAUSE, 3, id='a pause: it has read what its TCP had answered'),
        pytest.param(0, True, PAUSE - 1, 1, id='a shorter one shows nothing'),
        pytest.param(0, False, PAUSE, 1, id='nor one before its TCP has answered'),
        pytest.param(PAUSE, True, 1, 1, id='it is counted from when its TCP has answered'),
    ],
)
def test_a_kart_that_is_silent_for_a_pause_has_read_what_its_tcp_had_answered(
    kart: OneKart, before: int, answered: bool, after: int, order: int
) -> None:
    kart.say(RED)
    kart.beats(before)
    kart.order(GARAGE, answered=answered)
    kart.beats(after)
    kart.order(RaceState.RED_RED)
    assert kart.say(RED) == [order]


def test_a_frame_that_began_while_nothing_counted_does_not_count(kart: OneKart) -> None:
    kart.say(b' ' * FLOOD_BYTES)
    kart.beats(round(DEAF * 20.0))
    assert kart.say(RED[:4]) == []
    kart.beats(1)
    assert kart.say(RED[4:] + RED) == [NO_ORDER, 1]


# ----- the wire: bytes under way in both directions, and a kart that reads when it likes ---------

SHORT_QUIET = 0.2
"""In place of `QUIET`, so that Hypothesis meets pauses, s: 4 beats."""

SMALL_FLOOD = 40
"""In place of `FLOOD_BYTES`, so that Hypothesis meets floods, bytes."""

SHORT_FLOOD = 0.5
"""In place of `FLOOD`, so that some floods last for longer, s."""


STATES = (RaceState.RED_RED, GARAGE, GRID)
"""What is sent on a wire here: few states, so that they come again."""


@dataclass
class Word:
    """
    What a kart said.

    :ivar meant: the serial of the order that the kart had read last.
    :ivar taken: number of frames that its TCP had answered by then.
    :ivar begin: its place in the stream from the kart.
    """

    state: RaceState
    meant: int
    taken: int
    begin: int


class Wire:
    """
    Race control, a kart, and what is under way between them; the kart says only what it has read.

    TCP loses nothing and keeps the order, and a byte from the kart brings the answer to at least
    what the kart's TCP had when the byte was said. Nothing else is certain: frames and words may
    take any time, answers may come before words that are older, and the kart may leave any number
    of frames unread. But a kart that was silent for `QUIET` has read what was answered before.
    """

    def __init__(self) -> None:
        self.hearing = Hearing(20.0)
        self.pause = round(SHORT_QUIET * 20.0)
        self.frames: list[tuple[int, RaceState]] = []  # sent, each with its order's serial
        self.ends: list[int] = []
        self.words: list[Word] = []
        self.heard: list[tuple[Heard, int]] = []
        self.not_before: dict[int, int] = {}
        self._state: RaceState | None = None
        self._serial = 0
        self._taken = self._read = self._answered = 0  # frames: by its TCP, by it, seen by us
        self._answers_seen = [0] * self.pause  # at the last beats
        self._said = b''
        self._arrived = self._taken_in = 0
        self._quiet = 0

    # What may happen; the argument is any number.

    def order(self, which: int) -> None:
        """Send another state than the present one."""
        others = [each for each in STATES if each is not self._state]
        self._state = others[which % len(others)]
        self._serial += 1
        self.not_before[self._serial] = self._arrived
        end = (self.ends[-1] if self.ends else 0) + len(encode(self._state))
        unread = self._arrived - self._taken_in
        self.hearing.order(self._serial, self._state, end, unread)
        self._send()

    def beat(self, count: int) -> None:
        """Send the state again, a few times."""
        for _ in range(count % 6 + 1):
            if self._quiet >= self.pause:
                if len(self._said) > self._taken_in:
                    self.arrive(len(self._said))
                    self.listen(len(self._said))
                else:
                    self._read = max(self._read, self._answers_seen[0])
            self.hearing.beat(0.0)
            self.look()
            if self._state is not None:
                self._send()
            self._quiet += 1
            self._answers_seen = [*self._answers_seen[1:], self._answered]

    def carry(self, count: int) -> None:
        """Have a few frames reach the kart's TCP."""
        self._taken = min(self._taken + count % 8 + 1, len(self.frames))

    def read(self, how: int) -> None:
        """Have the kart read a few frames in one go, and say the last of them, or nothing."""
        before = self._read
        self._read = min(self._read + how // 2 % 4 + 1, self._taken)
        if self._read > before and how % 2:
            self.repeat(0)

    def repeat(self, _: int) -> None:
        """Have the kart say what it has read last."""
        if self._read:
            serial, state = self.frames[self._read - 1]
            self._say(state, serial)

    def lie(self, which: int) -> None:
        """Have the kart say anything."""
        self._say(list(RaceState)[which % len(RaceState)], 0)

    def answer(self, count: int) -> None:
        """See a few more frames answered, whatever became of older words."""
        self._answered = min(self._answered + count % 8, self._taken)

    def arrive(self, count: int) -> None:
        """Have bytes arrive, and the answer that came with them."""
        self._arrived = min(self._arrived + count, len(self._said))
        brought = [each.taken for each in self.words if each.begin < self._arrived]
        self._answered = max([self._answered, *brought])

    def listen(self, count: int) -> None:
        """Have race control read some of what has arrived."""
        end = min(self._taken_in + count, self._arrived)
        begin = self._taken_in
        data = self._said[begin:end]
        if not data or self.hearing.is_full:
            return
        self._taken_in += len(data)
        self._quiet = 0
        self.hearing.read(len(data))
        self.look()
        self.heard += self.hearing.decode(memoryview(data))

    def look(self) -> None:
        """See how much is answered, as a link does when it reads and at each beat."""
        answered = self.ends[self._answered - 1] if self._answered else 0
        seen = {serial for serial, _ in self.frames[: self._answered]}
        for serial in self.not_before.keys() - seen:
            self.not_before[serial] = self._arrived
        self.hearing.look(answered, self._arrived - self._taken_in)

    # What follows.

    def settle(self) -> None:
        """Have a prompt kart's world come to rest: all is carried, answered, arrived and heard."""
        self.arrive(len(self._said))
        self.listen(len(self._said))

    def pairs(self) -> Iterator[tuple[Word, int]]:
        """Return each word that was heard, and the serial of the order that it answered."""
        for word, (heard, serial) in zip(self.words, self.heard, strict=False):
            assert heard == StateFrame(word.state)
            yield word, serial

    def _send(self) -> None:
        assert self._state is not None
        self.frames.append((self._serial, self._state))
        self.ends.append((self.ends[-1] if self.ends else 0) + len(encode(self._state)))

    def _say(self, state: RaceState, meant: int) -> None:
        self.words.append(Word(state, meant, self._taken, len(self._said)))
        self._said += encode(state)


def steps(*more: str) -> st.SearchStrategy[list[tuple[str, int]]]:
    """Return what may happen on a wire."""
    names = ['order', 'beat', 'carry', 'read', 'repeat', 'answer', 'arrive', 'listen', *more]
    return st.lists(
        st.tuples(st.sampled_from(names), st.integers(0, 60)), min_size=20, max_size=80
    )


def wire_after(steps: list[tuple[str, int]]) -> Wire:
    """Return a wire on which all this has happened, and everything has been heard."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hearing, 'QUIET', SHORT_QUIET)
        wire = Wire()
        for what, how in steps:
            getattr(wire, what)(how)
        wire.settle()
    return wire


@given(steps())
def test_no_word_answers_an_order_that_the_kart_had_not_read_when_it_said_it(
    steps: list[tuple[str, int]],
) -> None:
    for word, serial in wire_after(steps).pairs():
        assert serial <= word.meant


@given(st.lists(st.sampled_from(['order', 'beat', 'read', 'hear']), min_size=30, max_size=120))
def test_no_word_of_a_kart_that_says_each_change_answers_an_unread_order_however_late_it_reads(
    steps: list[str],
) -> None:
    """Nothing is assumed of its silence, once it has said IN_GARAGE."""
    sent, unread = [GARAGE], list[int]()
    words: list[tuple[RaceState, int]] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hearing, 'QUIET', SHORT_QUIET)
        kart = OneKart()
    kart.order(GARAGE)
    assert kart.say(GARAGE) == [1]
    state = GARAGE
    for step in steps:
        if step == 'order':
            # IN_GARAGE comes between any two orders of the same state.
            sent.append(GARAGE if sent[-1] is not GARAGE else STATES[2 * (len(sent) // 2 % 2)])
            kart.order(sent[-1])
            unread.append(len(sent))
        elif step == 'beat':
            kart.beats(2)
            unread.append(len(sent))
        elif step == 'read' and unread:
            serial = unread.pop(0)
            if sent[serial - 1] is not state:
                state = sent[serial - 1]
                words.append((state, serial))
        elif step == 'hear' and words:
            word, meant = words.pop(0)
            (serial,) = kart.say(word)
            assert serial <= meant


@given(steps('lie'))
def test_no_word_answers_an_order_that_was_unanswered_when_the_word_was_there(
    steps: list[tuple[str, int]],
) -> None:
    wire = wire_after(steps)
    for word, serial in wire.pairs():
        assert serial == NO_ORDER or word.begin >= wire.not_before[serial]


@pytest.mark.parametrize('says', ['each frame', 'each change', 'each change but IN_GARAGE'])
def test_a_prompt_kart_answers_every_order_at_once(says: str) -> None:
    for orders in itertools.product(range(2), repeat=6):
        wire = Wire()
        for which in orders:
            wire.order(which)
            wire.carry(0)
            state = wire.frames[-1][1]
            silent = says.endswith('IN_GARAGE') and state is GARAGE
            wire.read(0 if silent else 1)
            wire.settle()
            if not silent:
                assert [serial for _, serial in wire.pairs()][-1] == len(wire.not_before)
            # Nothing but its silence shows that it has read IN_GARAGE.
            for _ in range(round(QUIET * 20.0) + 4 if silent else 2):
                wire.beat(0)
                wire.carry(0)
                wire.answer(7)
                wire.read(1 if says == 'each frame' else 0)
                wire.settle()


# ----- every way to cut what a kart says ------------------------------------------------------

said = st.one_of(
    st.sampled_from([encode(state) for state in RaceState]),
    st.sampled_from([b'$', b';', b'$RED_', b'RED;', b'$READY;', b' ', b'\xff', b'$' * 33]),
    st.binary(max_size=6),
)
pieces = st.lists(
    st.one_of(
        st.tuples(st.just('arrive'), said),
        # How many bytes are read; whether an order goes out before they are decoded.
        st.tuples(st.just('read'), st.tuples(st.integers(1, SMALL_FLOOD), st.booleans())),
        st.tuples(st.just('order'), st.none()),
        st.tuples(st.just('beats'), st.integers(1, 25)),
        st.tuples(st.just('flood'), st.sampled_from([1, 4, 7, 8, 9])),  # and so many beats
    ),
    min_size=20,
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
        self.deaf: list[bool] = []  # of each decoded byte: whether nothing counted then
        self.orders: list[tuple[RaceState, int]] = []  # and how much had arrived by then
        self._read = 0
        self._in_this_beat = 0
        self._quiet_beats = 1000
        self._deaf_beats = DEAF * beat_rate
        self._floods_since = 0.0

    def arrive(self, data: bytes) -> None:
        self.arrived += data

    def order(self, _: None = None) -> None:
        state = list(RaceState)[len(self.orders) % len(RaceState)]
        self.orders.append((state, len(self.arrived)))
        # Its end is never reached: no pause plays a part here.
        self.kart.order(len(self.orders), state, 1, len(self.arrived) - self._read)

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
        self.deaf += [self._quiet_beats < self._deaf_beats] * len(data)

    def flood(self, count: int) -> None:
        self.arrive(b' ' * SMALL_FLOOD)
        self.read((SMALL_FLOOD, False))
        self.beats(count)

    def beats(self, count: int) -> None:
        for _ in range(count):
            is_full = self._in_this_beat >= SMALL_FLOOD
            assert self.kart.is_full == is_full
            self._now += 1.0 / self._beat_rate
            if self._quiet_beats >= self._deaf_beats:  # so it is no longer the flood before
                self._floods_since = self._now
            lasts = self._now - self._floods_since
            assert self.kart.beat(self._now) == (is_full and lasts >= SHORT_FLOOD)
            self._quiet_beats = 0 if is_full else self._quiet_beats + 1
            self._in_this_beat = 0


@given(pieces, st.sampled_from([8.0, 16.0]))  # whose beats floats add exactly
def test_a_frame_answers_the_first_order_of_its_state_that_all_of_it_came_after(
    pieces: list[tuple[str, object]], beat_rate: float
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hearing, 'FLOOD_BYTES', SMALL_FLOOD)
        patch.setattr(hearing, 'FLOOD', SHORT_FLOOD)
        patch.setattr(hearing, 'ONCE', math.inf)  # no single reply plays a part either
        connection = Connection(beat_rate)
        for what, how in pieces:
            getattr(connection, what)(how)
    decoder = FrameDecoder(ready_is_grid_active=True)
    stream = connection.arrived[: len(connection.deaf)]
    reached = 0
    expected: list[tuple[Heard, int]] = []
    for end, byte in enumerate(stream, 1):
        for event in decoder.feed(bytes([byte])):
            answers = NO_ORDER
            if isinstance(event, StateFrame):
                begin = stream.rindex(b'$', 0, end)
                if not any(connection.deaf[begin:end]):
                    for number in range(max(reached, 1), len(connection.orders) + 1):
                        state, before = connection.orders[number - 1]
                        if state is event.state and before <= begin:
                            answers = reached = number
                            break
            expected.append((event, answers))
    assert connection.heard == expected
