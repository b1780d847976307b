# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The trace of an inspection: bytes, speeds and the inspector's answers, each with its time.

This module has no sockets, clocks or tasks. The code with the connections writes a `Trace`, and
the oracle reads nothing else, so a verdict can be reproduced from the trace alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
import enum
from typing import NamedTuple

from evgp_protocol.frames import FrameDecoder, StateFrame
from evgp_protocol.hearing import Hearing, NO_ORDER
from evgp_protocol.link import BEAT_RATE
from evgp_protocol.states import RaceState

BEAT = 1 / BEAT_RATE
"""Time between two frames, in seconds. Pauses of the kart are counted in beats, too."""

LONGEST_STEP = 0.1
"""Maximum time between two events that counts towards a pause of the kart, in seconds. More may
mean that the inspecting computer hung and read nothing."""


class Kind(enum.Enum):
    """The kind of an event. The value is its name in reports."""

    STEP = 'step'  # a step of the inspection begins; `text` names it
    OPENED = 'opened'  # the other end made a connection
    CLOSED = 'closed'  # the other end ended it; `text`: closed, reset
    ENDED = 'ended'  # the inspection ended the connection; `text` says how
    SENT = 'sent'  # bytes from the inspection
    SAID = 'said'  # bytes from the kart
    SPEED = 'speed'  # odometry; `value` in m/s
    ANSWER = 'answer'  # from the inspector; `text`: the question, `value`: 1 yes, 0 no, NaN none
    HELD_UP = 'held up'  # the inspecting computer itself was late; `value` in s
    UNANSWERED = 'unanswered'  # `value`: bytes sent that the other end's TCP has not acknowledged
    KILLED = 'killed'  # a part of the kart's program was killed; `text` names it
    SILENT = 'silent'  # from here on, the inspection sends no frames; `text` says what instead
    BACK = 'back'  # the inspection accepts connections again after refusing them


class Event(NamedTuple):
    """
    An observed event.

    :ivar at: time since the inspection began, in seconds.
    :ivar link: the number of the connection, from 1; 0 if there is none.
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


class SentState(NamedTuple):
    """A state sent on a connection, and the time of its first whole frame."""

    at: float
    link: int
    state: RaceState


class Said(NamedTuple):
    """
    A frame from the kart, or bytes that do not form one.

    :ivar state: the state; None if the bytes do not form a frame.
    :ivar sent: the state being sent on that connection when the frame was complete, if any.
    :ivar reason: why the bytes do not form a frame.
    """

    at: float
    link: int
    state: RaceState | None
    sent: SentState | None
    reason: str = ''

    def __str__(self) -> str:
        return self.state.value if self.state else f'bytes that are not a frame: {self.reason}'


class Wire:
    """
    One connection.

    :ivar hearing: which order a frame of the kart answers, by race control's rules. It may be an
        earlier one, if the kart sent the frame before it read the current one.
    :ivar orders: the orders sent on it; a repeated state counts as one order.
    :ivar framed_at: the time at which a whole, correct frame was last sent on it.
    """

    def __init__(self) -> None:
        self.hearing = Hearing(1 / BEAT)
        self.sending = FrameDecoder()
        self.bytes_sent = 0
        self.orders: list[SentState] = []
        self.framed_at = 0.0


class Trace:
    """
    Everything observed, in order of time. It can be read while it is written.

    :ivar said: everything that the kart sent.
    :ivar wires: the connections, by their numbers.
    """

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.said: list[Said] = []
        self.wires: defaultdict[int, Wire] = defaultdict(Wire)
        self._time = self._beats = 0.0
        self._sent: dict[int, SentState] = {}  # of the connections that are open
        self._acknowledged: set[SentState] = set()

    def acknowledged(self, state: RaceState) -> bool:
        """Return whether the kart is now being sent this state, and has acknowledged it."""
        return any(sent.state is state and self.has(sent) for sent in self._sent.values())

    def has(self, sent: SentState) -> bool:
        """Return whether the kart has acknowledged a sent state."""
        return sent in self._acknowledged

    def waits(self, link: int) -> bool:
        """Return whether the number of unanswered bytes on a connection matters."""
        return self.wires[link].hearing.waits

    @property
    def reached(self) -> bool:
        """Return whether the kart has certainly read what it is being sent, on each connection."""
        return all(self.wires[link].hearing.has_reached_last for link in self._sent)

    def add(self, event: Event) -> None:
        self._let_pass(event.at)
        self.events.append(event)
        if event.kind in (Kind.CLOSED, Kind.ENDED):
            self._sent.pop(event.link, None)
        if event.kind is Kind.SENT:
            self._take_sent(event, self.wires[event.link])
        elif event.kind is Kind.SAID:
            self._take_said(event, self.wires[event.link])
        elif event.kind is Kind.UNANSWERED:
            wire = self.wires[event.link]
            wire.hearing.look(wire.bytes_sent - int(event.value), event.unread)

    def _take_sent(self, event: Event, wire: Wire) -> None:
        wire.bytes_sent += len(event.data)
        for frame in wire.sending.feed(event.data):
            sent = self._sent.get(event.link)
            if not isinstance(frame, StateFrame):
                continue
            wire.framed_at = event.at
            if sent is None or sent.state is not frame.state:
                sent = self._sent[event.link] = SentState(event.at, event.link, frame.state)
                wire.orders.append(sent)
                wire.hearing.order(len(wire.orders), sent.state, wire.bytes_sent, event.unread)

    def _take_said(self, event: Event, wire: Wire) -> None:
        wire.hearing.read(len(event.data))
        for frame, serial in wire.hearing.decode(memoryview(event.data)):
            sent = self._sent.get(event.link)
            state, reason = None, ''
            if isinstance(frame, StateFrame):
                state = frame.state
            else:
                reason = f'{frame.reason}: {printable(frame.raw)}'
            self.said.append(Said(event.at, event.link, state, sent, reason))
            if serial != NO_ORDER:
                self._acknowledged.add(wire.orders[serial - 1])

    def _let_pass(self, now: float) -> None:
        last = self.events[-1].at if self.events else now
        self._time += min(now - last, LONGEST_STEP)
        while self._beats + BEAT <= self._time:
            self._beats += BEAT
            for wire in (self.wires[link] for link in self._sent):
                wire.hearing.beat(now)
                for _, serial in wire.hearing.settled():
                    self._acknowledged.add(wire.orders[serial - 1])


def printable(data: bytes, most: int = 80) -> str:
    """Return bytes as text for people, with non-ASCII bytes in hex."""
    text = ''.join(chr(byte) if 32 <= byte < 127 else f'\\x{byte:02x}' for byte in data[:most])
    return text if len(data) <= most else f'{text}… ({len(data)} bytes)'


def describe(events: Sequence[Event], most: int = 60) -> list[str]:
    """
    Return events as lines for people.

    Repeated bytes, and half a second's odometry, share one line.

    :param most: maximum number of lines. If there are more, those in the middle are left out.
    """
    lines: list[tuple[str, list[Event]]] = []
    newest: dict[tuple[Kind, int], list[Event]] = {}  # the events of each stream's newest line

    def is_like(event: Event, first: Event) -> bool:
        if event.kind is Kind.SPEED:
            return event.at - first.at < 0.5
        return event.data == first.data

    for event in events:
        stream = event.kind, event.link
        if event.kind not in (Kind.SPEED, Kind.SENT, Kind.SAID):
            newest.clear()
        elif stream in newest and is_like(event, newest[stream][0]):
            newest[stream].append(event)
            continue
        newest[stream] = [event]
        yes = {1.0: 'yes', 0.0: 'no'}.get(event.value, 'no answer')
        what = _DESCRIBED[event.kind].format(event, yes, printable(event.data))
        lines.append((what, newest[stream]))
    described = []
    for what, same in lines:
        first, last = same[0], same[-1]
        if first.kind is Kind.SPEED:
            low, high = min(each.value for each in same), max(each.value for each in same)
            what += f'{low:.2f} m/s' if low == high else f'{low:.2f} to {high:.2f} m/s'
        times = f' to {last.at:.3f} {what} ({len(same)} times)' if len(same) > 1 else f' {what}'
        described.append(f'{first.at:8.3f}{times}')
    if len(described) > most:
        half = most // 2
        described[half:-half] = [f'         … {len(described) - most} more']
    return described


_DESCRIBED = {
    Kind.STEP: '-- {0.text}',
    Kind.OPENED: 'connection {0.link}: opened from {0.text}',
    Kind.CLOSED: 'connection {0.link}: {0.text} by the other end',
    Kind.ENDED: 'connection {0.link}: {0.text} by the inspection',
    Kind.SENT: 'connection {0.link}: sent {2}',
    Kind.SAID: 'connection {0.link}: heard {2}',
    Kind.SPEED: 'odometry ',
    Kind.ANSWER: 'inspector, {0.text}: {1}',
    Kind.HELD_UP: 'the inspecting computer hung for {0.value:.2f} s',
    Kind.UNANSWERED: 'connection {0.link}: TCP has not acknowledged {0.value:.0f} bytes',
    Kind.KILLED: 'the {0.text} of the kart was killed',
    Kind.SILENT: 'no frames from here on: {0.text}',
    Kind.BACK: 'connections are accepted again',
}
