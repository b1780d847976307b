# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Which order each word of a kart answers: by counts, bytes and beats alone, without a socket."""

from __future__ import annotations

from dataclasses import dataclass
import itertools
import math

from evgp_protocol import hearing
from evgp_protocol.frames import encode, FrameDecoder, StateFrame
from evgp_protocol.hearing import DEAF, Heard, Hearing, NO_ORDER, ONCE, QUIET
from evgp_protocol.states import RaceState
from hypothesis import example, given, settings
from hypothesis import strategies as st
import pytest

GARAGE = RaceState.IN_GARAGE

STATES = (RaceState.RED_RED, GARAGE, RaceState.GRID_ACTIVE)
"""What is sent here: few states, so that they come again."""

SHORT_QUIET = 0.2
"""In place of `QUIET`, so that Hypothesis meets pauses, s: 4 beats."""

SMALL_FLOOD = 40
"""In place of `FLOOD_BYTES`, so that Hypothesis meets floods, bytes."""

SHORT_FLOOD = 0.5
"""In place of `FLOOD`, so that some floods last for longer, s."""

ALL = 10_000
"""More bytes or frames than there are."""


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


Step = tuple[str, tuple[object, ...]]
"""The name of a method of `Wire`, and its arguments."""


class Wire:
    """
    Race control, a kart, and what is under way between them.

    TCP loses nothing and keeps the order, and a byte from the kart brings the answer to at least
    what the kart's TCP had when the byte was said. Nothing else is certain: frames and words may
    take any time, answers may come before words that are older, and the kart may leave any number
    of frames unread. But a kart that was silent for `pause` has read what was answered before.

    :ivar not_before: for each order, the place in what the kart says before which nothing answers.
    :ivar deaf: of each byte that was heard, whether nothing counted then.
    """

    def __init__(self, beat_rate: float = 20.0) -> None:
        self.hearing = Hearing(beat_rate)
        self.pause: float = round(hearing.QUIET * beat_rate)  # beats
        self.frames: list[tuple[int, RaceState]] = []  # sent, each with its order's serial
        self.ends = [0]  # of the frames in the stream to the kart, after its beginning
        self.said = b''
        self.words: list[Word] = []
        self.heard: list[tuple[Heard, int]] = []
        self.not_before: dict[int, int] = {}
        self.deaf: list[bool] = []
        self._taken = self._read = self._answered = 0  # frames: by its TCP, by it, seen by us
        self._answers_seen: list[int] = []  # at each beat
        self._arrived = 0
        self._quiet = 0
        self._beat_rate = beat_rate
        self._now = self._floods_since = 0.0
        self._in_this_beat = 0
        self._beats_since_flood = ALL

    # What may happen.

    def order(self, which: int, is_answered: bool = False) -> None:
        """Send another state than the present one, and perhaps have it answered at once."""
        present = self.frames[-1][1] if self.frames else None
        self.send([each for each in STATES if each is not present][which])
        if is_answered:
            self.deliver(ALL)

    def send(self, state: RaceState) -> None:
        """Send an order."""
        serial = len(self.not_before) + 1
        self.not_before[serial] = self._arrived
        self._send(serial, state)
        self.hearing.order(serial, state, self.ends[-1], self._arrived - len(self.deaf))

    def beat(self, count: int) -> None:
        """Send the last order's state again, a few times."""
        for _ in range(count):
            if self._quiet >= self.pause:
                if len(self.said) > len(self.deaf):
                    self.settle()
                else:
                    self._read = max(self._read, self._answers_seen[-round(self.pause)])
            self._begin_beat()
            self.look()
            if self.frames:
                self._send(*self.frames[-1])
            self._quiet += 1
            self._answers_seen.append(self._answered)

    def carry(self, count: int) -> None:
        """Have a few frames reach the kart's TCP."""
        self._taken = min(self._taken + count, len(self.frames))

    @property
    def next_state(self) -> RaceState | None:
        """Return what the kart reads next, if anything is there."""
        return self.frames[self._read][1] if self._read < self._taken else None

    def read(self, count: int, says: bool) -> None:
        """Have the kart read a few frames in one go, and say the last of them, or nothing."""
        before = self._read
        self._read = min(before + count, self._taken)
        if self._read > before and says:
            self.repeat()

    def repeat(self) -> None:
        """Have the kart say what it has read last."""
        if self._read:
            self.lie(*self.frames[self._read - 1])

    def lie(self, meant: int, state: RaceState) -> None:
        """Have the kart say anything."""
        self.words.append(Word(state, meant, self._taken, len(self.said)))
        self.said += encode(state)

    def answer(self, count: int) -> None:
        """See a few more frames answered, whatever became of older words."""
        self._answered = min(self._answered + count, self._taken)

    def arrive(self, count: int) -> None:
        """Have bytes arrive, and the answer that came with them."""
        self._arrived = min(self._arrived + count, len(self.said))
        brought = [each.taken for each in self.words if each.begin < self._arrived]
        self._answered = max([self._answered, *brought])

    def listen(self, count: int, order_comes: bool = False) -> None:
        """Have race control read some of what has arrived, and perhaps send an order meanwhile."""
        begin, end = len(self.deaf), min(len(self.deaf) + count, self._arrived)
        data = self.said[begin:end]
        if not data or self.hearing.is_full:
            return
        self._quiet = 0
        self._in_this_beat += len(data)
        self.deaf += [self._beats_since_flood < DEAF * self._beat_rate] * len(data)
        self.hearing.read(len(data))
        self.look()
        if order_comes:
            self.order(1, is_answered=True)
        self.heard += self.hearing.decode(memoryview(data))

    def say(self, data: bytes) -> None:
        """Have anything arrive at once."""
        self.said += data
        self.arrive(ALL)

    def flood(self, count: int) -> None:
        """Have a flood arrive and be read, and so many beats begin."""
        self.say(b' ' * SMALL_FLOOD)
        self.listen(SMALL_FLOOD)
        self.beat(count)

    def look(self) -> None:
        """See how much is answered: all but a byte of what is not answered whole."""
        whole = self._answered == len(self.frames)
        answered = self.ends[-1] if whole else self.ends[self._answered + 1] - 1
        seen = self.frames[self._answered - 1][0] if self._answered else 0
        for serial in range(seen + 1, len(self.not_before) + 1):
            self.not_before[serial] = self._arrived
        self.hearing.look(answered, self._arrived - len(self.deaf))
        assert self.hearing.waits == (seen < len(self.not_before))

    def settle(self) -> None:
        """Have all that was said arrive and be heard."""
        self.arrive(ALL)
        self.listen(ALL)

    def deliver(self, count: int) -> None:
        """Have a few frames reach the kart's TCP, which answers at once."""
        self.carry(count)
        self.answer(count)
        self.look()

    def have(self, steps: list[Step]) -> None:
        """Have all this happen."""
        for what, how in steps:
            getattr(self, what)(*how)

    def _send(self, serial: int, state: RaceState) -> None:
        self.frames.append((serial, state))
        self.ends.append(self.ends[-1] + len(encode(state)))

    def _begin_beat(self) -> None:
        is_full = self._in_this_beat >= hearing.FLOOD_BYTES
        assert self.hearing.is_full == is_full
        self._now += 1.0 / self._beat_rate
        if self._beats_since_flood >= DEAF * self._beat_rate:  # so it is not the flood before
            self._floods_since = self._now
        lasts = self._now - self._floods_since
        assert self.hearing.beat(self._now) == (is_full and lasts >= hearing.FLOOD)
        self._beats_since_flood = 0 if is_full else self._beats_since_flood + 1
        self._in_this_beat = 0


def happening(**what: st.SearchStrategy[tuple[object, ...]]) -> st.SearchStrategy[Step]:
    """Return what may happen on a wire: each method with its arguments."""
    return st.one_of(*(st.tuples(st.just(name), how) for name, how in what.items()))


def number(least: int, most: int) -> st.SearchStrategy[tuple[int]]:
    """Return an argument."""
    return st.tuples(st.integers(least, most))


words = happening(
    order=number(0, 1),
    beat=number(1, 6),
    carry=number(1, 8),
    read=st.tuples(st.integers(1, 4), st.booleans()),
    repeat=st.just(()),
    answer=number(0, 7),
    arrive=number(0, 60),
    listen=number(0, 60),
)
lies = happening(lie=st.tuples(st.just(0), st.sampled_from(RaceState)))


@pytest.mark.parametrize(('steps', 'is_honest'), [(words, True), (words | lies, False)])
@given(data=st.data())
def test_no_word_answers_an_order_that_the_kart_had_not_read_when_it_said_it(
    data: st.DataObject, steps: st.SearchStrategy[Step], is_honest: bool
) -> None:
    """A kart that lies had at least been sent the order, as far as race control can know."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hearing, 'QUIET', SHORT_QUIET)
        wire = Wire()
    wire.have(data.draw(st.lists(steps, min_size=20, max_size=80)))
    wire.settle()
    for word, (heard, serial) in zip(wire.words, wire.heard, strict=False):
        assert heard == StateFrame(word.state)
        assert serial == NO_ORDER or word.begin >= wire.not_before[serial]
        assert serial <= word.meant or not is_honest


@given(st.lists(st.sampled_from(['order', 'beat', 'read', 'hear']), min_size=30, max_size=120))
def test_no_word_of_a_kart_that_says_each_change_answers_an_unread_order_however_late_it_reads(
    steps: list[str],
) -> None:
    """Nothing is assumed of its silence, once it has said IN_GARAGE."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hearing, 'QUIET', SHORT_QUIET)
        wire = Wire()
    wire.pause = math.inf
    wire.send(GARAGE)
    wire.deliver(ALL)
    wire.read(1, says=True)
    wire.settle()
    for step in steps:
        if step == 'order':
            # IN_GARAGE comes between any two orders of the same state.
            sent = len(wire.not_before)
            wire.send(STATES[2 * (sent // 2 % 2) if sent % 2 else 1])
            wire.deliver(ALL)
        elif step == 'beat':
            wire.beat(2)
            wire.deliver(ALL)
        elif step == 'read':
            for _ in range(2):
                wire.read(1, says=wire.next_state is not wire.words[-1].state)
        elif len(wire.words) > len(wire.heard):
            count = len(encode(wire.words[len(wire.heard)].state))
            wire.arrive(count)
            wire.listen(count)
    for word, (_, serial) in zip(wire.words, wire.heard, strict=False):
        assert serial <= word.meant


PAUSE = round(QUIET * 20.0) + 1
"""In beats."""


@pytest.mark.parametrize(
    ('before', 'answered', 'after', 'order'),
    [
        pytest.param(0, True, PAUSE, 3, id='a pause: it has read what its TCP had answered'),
        pytest.param(0, True, PAUSE - 1, 1, id='a shorter one shows nothing'),
        pytest.param(0, False, PAUSE, 1, id='nor one before its TCP has answered'),
        pytest.param(PAUSE, True, PAUSE - 1, 1, id='it is counted from when its TCP has answered'),
    ],
)
def test_a_kart_that_is_silent_for_a_pause_has_read_what_its_tcp_had_answered(
    before: int, answered: bool, after: int, order: int
) -> None:
    wire = Wire()
    for state, beats in ((RaceState.RED_RED, before), (GARAGE, after), (RaceState.RED_RED, 0)):
        wire.send(state)
        wire.deliver(0 if state is GARAGE and not answered else ALL)
        if state is not GARAGE:
            wire.say(encode(state))
            wire.settle()
        wire.beat(beats)
    assert wire.heard[-1][1] == order


def test_a_kart_that_once_said_more_than_it_was_sent_does_not_pass_an_order_by_its_count() -> None:
    wire, red = Wire(), encode(RaceState.RED_RED)
    wire.send(RaceState.RED_RED)
    wire.deliver(ALL)
    wire.say(red * 2)
    wire.settle()
    wire.send(GARAGE)
    wire.send(RaceState.RED_RED)
    wire.deliver(ALL)
    for _ in range(100):
        wire.say(red)
        wire.settle()
        wire.beat(1)
    assert wire.heard[-1][1] == 1


@pytest.mark.parametrize(('apart', 'orders'), [(ONCE, [3]), (ONCE - 0.05, [])])
def test_a_last_word_is_for_the_later_order_only_if_the_one_before_was_long_ago(
    apart: float, orders: list[int]
) -> None:
    wire = Wire()
    for state in (RaceState.RED_RED, GARAGE, RaceState.RED_RED):
        wire.send(state)
    wire.deliver(ALL)
    for beats in (round(apart * 20.0), PAUSE):
        wire.say(encode(RaceState.RED_RED))
        wire.settle()
        wire.beat(beats)
    assert [serial for _, serial in wire.hearing.settled()] == orders


@pytest.mark.parametrize('says', ['each frame', 'each change', 'each change but IN_GARAGE'])
def test_a_prompt_kart_answers_every_order_at_once(says: str) -> None:
    for orders in itertools.product(range(2), repeat=6):
        wire = Wire()
        for which in orders:
            wire.order(which)
            wire.carry(1)
            silent = says.endswith('IN_GARAGE') and wire.next_state is GARAGE
            wire.read(1, says=not silent)
            wire.settle()
            assert silent or wire.heard[-1][1] == len(wire.not_before)
            # Nothing but its silence shows that it has read IN_GARAGE.
            for _ in range(round(QUIET * 20.0) + 4 if silent else 2):
                wire.beat(1)
                wire.deliver(ALL)
                wire.read(1, says=says == 'each frame')
                wire.settle()


said = st.one_of(
    st.sampled_from([encode(state) for state in RaceState]),
    st.sampled_from([b'$', b';', b'$RED_', b'RED;', b'$READY;', b' ', b'\xff', b'$' * 33]),
    st.binary(max_size=6),
)
pieces = happening(
    say=st.tuples(said),
    listen=st.tuples(st.integers(1, SMALL_FLOOD), st.booleans()),
    order=st.tuples(st.integers(0, 1), st.booleans()),
    deliver=st.just((ALL,)),
    beat=number(1, 25),
    flood=st.sampled_from([(1,), (4,), (7,), (8,), (9,)]),
)


@example(  # a frame that began while nothing counted, and ends when everything does
    [
        ('order', (0, True)),
        ('flood', (1,)),
        *(('say', (encode(STATES[0])[:5],)), ('listen', (SMALL_FLOOD,)), ('beat', (20,))),
        *(('say', (encode(STATES[0])[5:],)), ('listen', (SMALL_FLOOD,))),
    ],
    8.0,
)
@given(st.lists(pieces, min_size=20, max_size=60), st.sampled_from([8.0, 16.0]))  # exact floats
@settings(max_examples=200)
def test_a_frame_answers_the_first_order_of_its_state_that_all_of_it_came_after(
    steps: list[Step], beat_rate: float
) -> None:
    """However what the kart says is cut, and whatever it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hearing, 'FLOOD_BYTES', SMALL_FLOOD)
        patch.setattr(hearing, 'FLOOD', SHORT_FLOOD)
        patch.setattr(hearing, 'QUIET', 1000.0)  # no pause plays a part
        wire = Wire(beat_rate)
        wire.have(steps)
    decoder = FrameDecoder(ready_is_grid_active=True)
    stream, states = wire.said[: len(wire.deaf)], dict(wire.frames)
    reached = 1
    expected: list[tuple[Heard, int]] = []
    for end, byte in enumerate(stream, 1):
        for event in decoder.feed(bytes([byte])):
            answers = NO_ORDER
            if isinstance(event, StateFrame):
                begin = stream.rindex(b'$', 0, end)
                if not any(wire.deaf[begin:end]):
                    for serial in range(reached, len(states) + 1):
                        if states[serial] is event.state and wire.not_before[serial] <= begin:
                            answers = reached = serial
                            break
            expected.append((event, answers))
    assert wire.heard == expected
