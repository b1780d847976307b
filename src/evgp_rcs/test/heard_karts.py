# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Karts of many habits, as `Hearing` hears them: what each had read when it said a word is known.

Time is simulated, so that hours take seconds. TCP loses nothing and answers at once: what matters
here is what a kart's program reads, when, and what it says.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
import enum
import heapq
import itertools

from evgp_protocol.frames import encode, StateFrame
from evgp_protocol.hearing import Hearing
from evgp_protocol.states import RaceState

GARAGE = RaceState.IN_GARAGE


class Says(enum.Enum):
    """When a kart says back what it reads."""

    CHANGES = 'each change once'
    FRAMES = 'each frame'
    NEWS = 'only what differs from its last word'


@dataclass(frozen=True)
class Habit:
    """
    What a kart says.

    :ivar garage: it says IN_GARAGE back, too; ``greets``: it says it once, when it connects.
    """

    says: Says
    garage: bool = False
    greets: bool = False

    def says_back(self, state: RaceState, is_new: bool, last_word: RaceState | None) -> bool:
        """
        Return whether a kart says a state back that it reads.

        :param is_new: it has not said this one back since the state changed.
        """
        if state is GARAGE and not self.garage:
            return False
        if self.says is Says.NEWS:
            return state is not last_word
        return is_new or self.says is Says.FRAMES

    def __str__(self) -> str:
        """Return it in a few words."""
        garage = 'with IN_GARAGE' if self.garage else 'without IN_GARAGE'
        return f'{self.says.value}, {garage}{", with a greeting" if self.greets else ""}'


HABITS = (
    Habit(Says.CHANGES, garage=True),
    Habit(Says.CHANGES),
    Habit(Says.FRAMES, garage=True),
    Habit(Says.FRAMES),
    Habit(Says.FRAMES, greets=True),
    Habit(Says.CHANGES, greets=True),
)
"""The habits of whose words every one counts in the end, if the kart reads in time."""


@dataclass(frozen=True)
class Reader:
    """
    How a kart reads.

    :ivar rate: it reads so often a second; 0: at once.
    :ivar one_frame: it reads one frame each time; otherwise all that has come, and says the last.
    :ivar says_after: time from reading a frame until its word has arrived, s.
    :ivar freezes: from when and how long it reads nothing, s.
    :ivar acts_in: time that it takes to do what an order says, from when it first reads it, s.
    """

    rate: float = 0.0
    one_frame: bool = True
    says_after: float = 0.0
    freezes: tuple[tuple[float, float], ...] = ()
    acts_in: float = 0.0


@dataclass
class Given:
    """
    An order.

    :ivar said_at: when the first word for it, or what could be one, was heard (s).
    :ivar counted_at: when a word first counted for it (s).
    :ivar counts_in: how long it was said to take at most when the first word was heard, s.
    """

    at: float
    state: RaceState
    said_at: float | None = None
    counted_at: float | None = None
    counts_in: float = 0.0


class Story:
    """
    What becomes of a kart's orders and words.

    :param orders: each with how long it lasts, s.
    :ivar stale: each word that counted for an order that the kart had not read: for which, and
        which one the kart had read last.
    :ivar behind: when it was said to be behind, and how far (s).
    """

    def __init__(
        self,
        habit: Habit,
        reader: Reader,
        orders: Iterable[tuple[RaceState, float]],
        beat_rate: float = 12.0,
    ) -> None:
        self.orders: list[Given] = []
        self.stale: list[tuple[int, int]] = []
        self.behind: list[tuple[float, float]] = []
        self.habit, self.reader, self.beat_rate = habit, reader, beat_rate
        self.hearing = Hearing(beat_rate)
        self.sent = 0  # bytes
        self.unread: deque[int] = deque()  # the serial of each frame
        self.change = 0  # the serial of the state that it read last, where that changed
        self.change_at = 0.0
        self.last_word: RaceState | None = None
        self.last_heard: tuple[RaceState, int] | None = None  # and which order it was meant for
        self.said_change = 0
        self.counter = itertools.count()
        self.to_come: list[tuple[float, int, str, RaceState, int]] = []
        self.tell(orders)

    def at(self, when: float, what: str, state: RaceState = GARAGE, serial: int = 0) -> None:
        heapq.heappush(self.to_come, (when, next(self.counter), what, state, serial))

    def tell(self, orders: Iterable[tuple[RaceState, float]]) -> None:
        ends = 0.0
        for state, lasts in orders:
            self.at(ends, 'order', state)
            ends += lasts
        period = 1.0 / self.beat_rate
        self.at(0.37 * period, 'beat')
        if self.reader.rate:
            self.at(0.61 / self.reader.rate, 'turn')
        if self.habit.greets:
            self.at(0.001, 'greet')
        while True:
            now, _, what, state, serial = heapq.heappop(self.to_come)
            if now > ends:
                return
            if what == 'order':
                self.order(state, now)
            elif what == 'beat':
                self.beat(now)
                self.at(now + period, 'beat')
            elif what == 'greet':
                self.say(GARAGE, 1, now)
            elif what == 'arrive':
                self.arrive(state, serial, now)
            if what == 'turn':
                self.read(now)
                self.at(now + 1.0 / self.reader.rate, 'turn')
            elif not self.reader.rate:
                self.read(now)

    def order(self, state: RaceState, now: float) -> None:
        self.orders.append(Given(now, state))
        self.sent += len(encode(state))
        serial = len(self.orders)
        self.hearing.order(serial, state, self.sent, 0)
        self.unread.append(serial)
        self.hearing.look(self.sent, 0)

    def beat(self, now: float) -> None:
        self.hearing.beat(now)
        for frame, serial in self.hearing.settled():
            # The last word of all that were said: nothing followed it.
            assert self.last_heard is not None
            assert frame.state is self.last_heard[0]
            self.count(serial, self.last_heard[1], now)
        if self.orders:
            self.sent += len(encode(self.orders[-1].state))
            self.unread.append(len(self.orders))
            self.hearing.sent_again()
        if self.hearing.behind:
            self.behind.append((now, self.hearing.behind))

    def read(self, now: float) -> None:
        if any(begin <= now < begin + lasts for begin, lasts in self.reader.freezes):
            return
        while self.unread:
            serial = self.unread.popleft()
            if not self.reader.one_frame:
                self.unread.clear() if serial == len(self.orders) else None
                if self.unread:
                    continue
            order = self.orders[serial - 1]
            if serial != self.change:
                self.change, self.change_at = serial, now
            self.speak(order.state, serial, now)
            if self.reader.rate and self.reader.one_frame:
                return

    def speak(self, state: RaceState, serial: int, now: float) -> None:
        if state is not GARAGE and now - self.change_at < self.reader.acts_in:
            return
        if self.habit.says_back(state, self.said_change != serial, self.last_word):
            self.said_change = serial
            self.say(state, serial, now)

    def say(self, state: RaceState, serial: int, now: float) -> None:
        self.last_word = state
        if self.reader.says_after:
            self.at(now + self.reader.says_after, 'arrive', state, serial)
        else:
            self.arrive(state, serial, now)

    def arrive(self, state: RaceState, meant: int, now: float) -> None:
        data = encode(state)
        self.hearing.read(len(data))
        self.hearing.look(self.sent, 0)
        ((heard, serial),) = self.hearing.decode(memoryview(data))
        assert isinstance(heard, StateFrame)
        self.last_heard = state, meant
        present = self.orders[-1]
        if state is present.state and present.said_at is None:
            present.said_at, present.counts_in = now, self.hearing.counts_in()
        if serial:
            self.count(serial, meant, now)

    def count(self, serial: int, meant: int, now: float) -> None:
        if serial > meant:
            self.stale.append((serial, meant))
        order = self.orders[serial - 1]
        if serial == len(self.orders) and order.counted_at is None:
            order.counted_at = now
