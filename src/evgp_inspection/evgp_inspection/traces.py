# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What an inspection has seen: bytes, speeds and the inspector's answers, each with its time.

No socket, no clock, no task lives here. The shell that holds the connections writes a `Trace`;
the judges read nothing else, so a verdict can be reached again from a trace alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
import dataclasses
import enum

from evgp_protocol.frames import FrameDecoder, StateFrame
from evgp_protocol.hearing import Hearing, NO_ORDER
from evgp_protocol.link import BEAT_RATE
from evgp_protocol.states import RaceState

BEAT = 1 / BEAT_RATE
"""Time between two frames, by which a pause of what is inspected is counted too, in seconds."""

LONGEST_STEP = 0.1
"""Maximum time between two events that counts towards a pause, in seconds: while the inspecting
computer is held up, it reads nothing."""


class Kind(enum.Enum):
    """What an event is; the value is how reports name it."""

    STEP = 'step'  # a phase of the inspection begins; `text` names it
    OPENED = 'opened'  # the other end made a connection
    CLOSED = 'closed'  # the other end ended it; `text`: closed, reset
    ENDED = 'ended'  # the inspection ended it; `text` says how
    SENT = 'sent'  # by the inspection
    SAID = 'said'  # by the kart
    SPEED = 'speed'  # odometry; `value` in m/s
    ANSWER = 'answer'  # of the inspector; `text`: the question, `value`: 1 for yes, 0 for no
    HELD_UP = 'held up'  # the inspecting computer itself was late; `value` in s
    UNANSWERED = 'unanswered'  # `value`: bytes sent that the other end's TCP has not answered
    KILLED = 'killed'  # a part of the kart's program, by force; `text` names it
    SILENT = 'silent'  # from here on, the inspection sends no frame; `text` says what instead


@dataclasses.dataclass(frozen=True)
class Event:
    """
    One thing that was seen.

    :ivar at: when, in seconds since the inspection began.
    :ivar link: the number of the connection, from 1; 0: of none.
    :ivar data: the bytes, for SENT and SAID.
    :ivar text: see `Kind`.
    :ivar value: see `Kind`.
    :ivar unread: number of bytes that had arrived and were not read yet, for SENT and UNANSWERED.
    """

    at: float
    kind: Kind
    link: int = 0
    data: bytes = b''
    text: str = ''
    value: float = 0.0
    unread: int = 0


@dataclasses.dataclass(frozen=True)
class SentState:
    """A state that a connection is sent, from its first whole frame on."""

    at: float
    link: int
    state: RaceState


@dataclasses.dataclass(frozen=True)
class Said:
    """
    A frame, or what is none, that came from what is inspected.

    :ivar state: the state; None: the bytes are no frame.
    :ivar sent: what it was being sent on that connection when it was complete; None: nothing yet.
    :ivar answers: what it acknowledges, by race control's rules (`evgp_protocol.hearing`): not
        always what is being sent, since it may have been said before that was read; None: nothing.
    :ivar reason: what is wrong with bytes that are no frame.
    """

    at: float
    link: int
    state: RaceState | None
    sent: SentState | None
    answers: SentState | None = None
    reason: str = ''

    def __str__(self) -> str:
        """Return it for people."""
        return self.state.value if self.state else f'bytes that are no frame: {self.reason}'


class Section:
    """
    The events of one phase, and what they mean.

    :ivar name: of the phase, such as ``race/green``.
    :ivar events: all of its events, in order of time.
    :ivar began: when it began, s.
    :ivar ended: when the next phase began, or the trace ended, s.
    :ivar sent: what each connection began to be sent in this phase.
    :ivar said: what was said.
    """

    def __init__(self, name: str, began: float) -> None:
        self.name = name
        self.began = self.ended = began
        self.events: list[Event] = []
        self.sent: list[SentState] = []
        self.said: list[Said] = []

    def of(self, *kinds: Kind) -> list[Event]:
        """Return its events of these kinds."""
        return [event for event in self.events if event.kind in kinds]

    @property
    def speeds(self) -> list[tuple[float, float]]:
        """Return the times, s, and speeds, m/s, of odometry."""
        return [(event.at, event.value) for event in self.of(Kind.SPEED)]

    def first_sent(self, state: RaceState) -> SentState | None:
        """Return when this phase began to send a state."""
        return next((sent for sent in self.sent if sent.state is state), None)

    def first_said(self, state: RaceState) -> Said | None:
        """Return the first time that a state was said in this phase."""
        return next((said for said in self.said if said.state is state), None)

    def acknowledged(self, state: RaceState) -> tuple[SentState, Said] | None:
        """Return when a state was sent first and when that was acknowledged, in this phase."""
        sent = self.first_sent(state)
        return next(((sent, said) for said in self.said if sent and said.answers == sent), None)

    def answer(self, question: str) -> Event | None:
        """Return the inspector's answer to a question, if there is one."""
        return next((each for each in self.of(Kind.ANSWER) if each.text == question), None)


class _Wire:
    """One connection: what was sent on it, and which of that each word answers."""

    def __init__(self) -> None:
        self.hearing = Hearing(1 / BEAT)
        self.sending = FrameDecoder()
        self.bytes_sent = 0
        self.orders: list[SentState] = []


class Trace:
    """Everything that was seen, in the order of time, read while it is written."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.sections: list[Section] = [Section('', 0.0)]
        self._wires: defaultdict[int, _Wire] = defaultdict(_Wire)
        self._time = self._beats = 0.0
        self._sent: dict[int, SentState] = {}  # of the connections that are open
        self._acknowledged: set[SentState] = set()

    @classmethod
    def of(cls, events: Iterable[Event]) -> Trace:
        """Return the trace that consists of these events."""
        trace = cls()
        for event in events:
            trace.add(event)
        return trace

    @property
    def now(self) -> Section:
        """Return the phase that goes on."""
        return self.sections[-1]

    def called(self, name: str) -> Section | None:
        """Return the last phase of this name; None: there was none."""
        return next((each for each in reversed(self.sections) if each.name == name), None)

    def acknowledged(self, state: RaceState) -> bool:
        """Return whether a state is what the kart is sent and has acknowledged, now."""
        return any(
            sent.state is state and sent in self._acknowledged for sent in self._sent.values()
        )

    def waits(self, link: int) -> bool:
        """Return whether it matters how many bytes of a connection are unanswered."""
        return link in self._wires and self._wires[link].hearing.waits

    @property
    def reached(self) -> bool:
        """Return whether the kart is known to have read what it is sent, on each connection."""
        return all(self._wires[link].hearing.has_reached_last for link in self._sent)

    def add(self, event: Event) -> None:
        """Take the next event."""
        self._let_pass(event.at)
        self.events.append(event)
        self.now.ended = max(self.now.ended, event.at)
        if event.kind is Kind.STEP:
            self.sections.append(Section(event.text, event.at))
        section = self.now
        section.events.append(event)
        if event.kind in (Kind.CLOSED, Kind.ENDED):
            self._sent.pop(event.link, None)
        if event.kind is Kind.SENT:
            self._take_sent(event, self._wires[event.link])
        elif event.kind is Kind.SAID:
            self._take_said(event, self._wires[event.link])
        elif event.kind is Kind.UNANSWERED:
            wire = self._wires[event.link]
            wire.hearing.look(wire.bytes_sent - int(event.value), event.unread)

    def _take_sent(self, event: Event, wire: _Wire) -> None:
        wire.bytes_sent += len(event.data)
        for frame in wire.sending.feed(event.data):
            sent = self._sent.get(event.link)
            if isinstance(frame, StateFrame) and (sent is None or sent.state is not frame.state):
                sent = self._sent[event.link] = SentState(event.at, event.link, frame.state)
                self.now.sent.append(sent)
                wire.orders.append(sent)
                wire.hearing.order(len(wire.orders), sent.state, wire.bytes_sent, event.unread)

    def _take_said(self, event: Event, wire: _Wire) -> None:
        wire.hearing.read(len(event.data))
        for frame, serial in wire.hearing.decode(memoryview(event.data)):
            sent = self._sent.get(event.link)
            answers = None if serial == NO_ORDER else wire.orders[serial - 1]
            state, reason = None, ''
            if isinstance(frame, StateFrame):
                state = frame.state
            else:
                reason = f'{frame.reason}: {printable(frame.raw)}'
            self.now.said.append(Said(event.at, event.link, state, sent, answers, reason))
            if answers is not None:
                self._acknowledged.add(answers)

    def _let_pass(self, now: float) -> None:
        last = self.events[-1].at if self.events else now
        self._time += min(now - last, LONGEST_STEP)
        while self._beats + BEAT <= self._time:
            self._beats += BEAT
            for wire in self._wires.values():
                wire.hearing.beat(now)
                for _, serial in wire.hearing.settled():
                    self._acknowledged.add(wire.orders[serial - 1])


def printable(data: bytes, most: int = 80) -> str:
    """Return bytes as text for people: what is not ASCII by its number in hex."""
    text = ''.join(chr(byte) if 32 <= byte < 127 else f'\\x{byte:02x}' for byte in data[:most])
    return text if len(data) <= most else f'{text}… ({len(data)} bytes)'


def describe(events: Sequence[Event], most: int = 60) -> list[str]:
    """
    Return events as lines for people; the same bytes again and again are one line.

    :param most: the greatest number of lines; of more, the middle is left out.
    """
    lines: list[tuple[str, float, float, int]] = []  # what, first time, last time, how often
    speeds: list[Event] = []
    at_line: dict[tuple[Kind, int], int] = {}

    def put(what: str, at: float, stream: tuple[Kind, int] | None = None) -> None:
        index = at_line.get(stream) if stream is not None else None
        if index is not None and lines[index][0] == what:
            what, first, _, times = lines[index]
            lines[index] = (what, first, at, times + 1)
            return
        lines.append((what, at, at, 1))
        if stream is not None:
            at_line[stream] = len(lines) - 1

    def put_speeds() -> None:
        if speeds:
            low, high = min(each.value for each in speeds), max(each.value for each in speeds)
            span = f'{low:.2f}' if low == high else f'{low:.2f} to {high:.2f}'
            lines.append((f'odometry {span} m/s', speeds[0].at, speeds[-1].at, len(speeds)))
            speeds.clear()

    for event in events:
        if event.kind is Kind.SPEED:
            speeds.append(event)
            if event.at - speeds[0].at >= 0.5:
                put_speeds()
        elif event.kind in (Kind.SENT, Kind.SAID):
            who = 'sent' if event.kind is Kind.SENT else 'heard'
            what = f'connection {event.link}: {who} {printable(event.data)}'
            put(what, event.at, (event.kind, event.link))
        else:
            put_speeds()
            at_line.clear()
            yes = 'yes' if event.value else 'no'
            put(_DESCRIBED[event.kind].format(event, yes), event.at)
    put_speeds()
    lines.sort(key=lambda line: line[1])
    if len(lines) > most:
        left = len(lines) - most
        half = most // 2
        lines[half:-half] = [(f'… {left} more', lines[half][1], lines[-half - 1][2], 1)]
    return [
        f'{first:8.3f}' + (f' to {last:.3f} {what} ({times} times)' if times > 1 else f' {what}')
        for what, first, last, times in lines
    ]


_DESCRIBED = {
    Kind.STEP: '-- {0.text}',
    Kind.OPENED: 'connection {0.link}: opened from {0.text}',
    Kind.CLOSED: 'connection {0.link}: {0.text} by the other end',
    Kind.ENDED: 'connection {0.link}: {0.text} by the inspection',
    Kind.ANSWER: 'inspector, {0.text}: {1}',
    Kind.HELD_UP: 'the inspecting computer was held up for {0.value:.2f} s',
    Kind.UNANSWERED: 'connection {0.link}: TCP has not answered {0.value:.0f} bytes',
    Kind.KILLED: 'the {0.text} of the kart was killed',
    Kind.SILENT: 'no frame from here on: {0.text}',
}
