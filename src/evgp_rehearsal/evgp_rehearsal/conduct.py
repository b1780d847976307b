# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What one kart did well and badly in a race, by the record alone.

Pure: events in, findings out. No sentence of an event is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from evgp_protocol.states import RaceState
from evgp_rcs.rules.race import EventKind, StampedEvent

LIMITS = {
    RaceState.GRID_ACTIVE: 120.0,
    RaceState.GREEN_GREEN: 30.0,
    RaceState.RED_FLAG: 15.0,
    RaceState.RED_RED: 5.0,
}
"""Time that a kart has to acknowledge a state, in seconds (§3.A)."""

TOO_SOON = 0.2
"""Minimum time that a racing kart needs to stand still, in seconds."""

RACED = 1.0
"""Time in GREEN_GREEN after which a kart drives, in seconds."""

_WRONGS = {
    EventKind.MALFORMED: 'sent what is no frame',
    EventKind.WITHDRAWN: 'said another state after it had acknowledged',
    EventKind.REFUSED_CONNECTION: 'connected so often that race control refused it',
}
"""Events of the record that a good kart never causes, and what it did then."""


@dataclass(frozen=True)
class Finding:
    """Whether a kart did something well, in one sentence; a note is neither."""

    good: bool
    text: str
    note: bool = False


@dataclass(frozen=True)
class Cut:
    """
    What an incident does to the kart's connection.

    :param at: from when on race control says nothing more on it, in seconds.
    :param losses: how many losses from then on are the incident's doing, and not the kart's.
    """

    at: float = math.inf
    losses: int = 0


NO_CUT = Cut()


def conduct(
    events: Sequence[StampedEvent], kart: int, cut: Cut = NO_CUT, until: float = math.inf
) -> list[Finding]:
    """
    Return what a kart did well and badly.

    :param events: of the record, in order.
    :param until: the time at which the events end: what had still time then is not judged.
    """
    own = [event for event in events if event.event.kart == kart]
    findings: list[Finding] = []
    for index, event in enumerate(own):
        if event.event.kind is EventKind.KART_STATE and event.event.state in LIMITS:
            findings += _obeyed(own, index, cut, until)
    for kind, text in _WRONGS.items():
        times = sum(event.event.kind is kind for event in own)
        if times:
            findings.append(Finding(False, f'{text} ({times} times)'))
    return [*findings, *_connected(own, cut)]


def _connected(own: Sequence[StampedEvent], cut: Cut) -> list[Finding]:
    """Return how a kart kept its connection."""
    back = [event.monotonic for event in own if event.event.kind is EventKind.CONNECTED]
    lost = [event.monotonic for event in own if event.event.kind is EventKind.DISCONNECTED]
    if not back:
        return [Finding(False, 'never connected')]
    excused = [at for at in lost if at >= cut.at][: cut.losses]
    bad = len(lost) - len(excused)
    stayed = 'did not come back after its connection was lost'
    if bad:
        away = f', and {stayed}' if back[-1] < lost[-1] else ''
        return [Finding(False, f'lost its connection ({bad} times){away}')]
    if not excused:
        return []
    if back[-1] < excused[-1]:
        return [Finding(False, stayed)]
    waited = min(at for at in back if at >= excused[-1]) - excused[-1]
    return [Finding(True, f'came back {waited:.1f} s after the incident ended its connection')]


def _obeyed(own: Sequence[StampedEvent], index: int, cut: Cut, until: float) -> list[Finding]:
    """Return how a kart acknowledged one order; nothing if it had no time to."""
    order = own[index]
    assert order.event.state is not None
    limit = LIMITS[order.event.state]
    # Until the next order, or the loss of the connection it came on: then another one counts.
    following = index + 1
    rest = own[following:]
    stops = (EventKind.KART_STATE, EventKind.DISCONNECTED)
    end = next((at for at, each in enumerate(rest) if each.event.kind in stops), len(rest))
    said = next((each for each in rest[:end] if each.event.kind is EventKind.ACKNOWLEDGED), None)
    if said is None:
        left = (rest[end].monotonic if end < len(rest) else until) - order.monotonic
        if left < limit:
            return []
        return [
            Finding(False, f'did not acknowledge {order.event.state.value} within {limit:g} s')
        ]
    took = said.monotonic - order.monotonic
    text = f'acknowledged {order.event.state.value} after {took:.2f} s'
    raced = _raced_until(own[: index + 1], cut) if order.event.state in _REDS else None
    if raced is not None and said.monotonic - raced < TOO_SOON:
        return [Finding(False, f'{text}, and raced until then: no kart stands still so soon')]
    return [Finding(took <= limit, f'{text} (limit {limit:g} s)')]


_REDS = (RaceState.RED_FLAG, RaceState.RED_RED)


def _raced_until(before: Sequence[StampedEvent], cut: Cut) -> float | None:
    """
    Return from when on a kart that raced had to stop; None: it did not race, or has stood since.

    :param before: what happened to it, up to the order that it acknowledges.
    """
    green = stop = None
    for event in before:
        if event.event.kind is EventKind.KART_STATE and event.event.state is RaceState.GREEN_GREEN:
            green, stop = event.monotonic, None
        elif event.event.kind is EventKind.ACKNOWLEDGED and event.event.state in _REDS:
            green = None
        elif event.event.kind in (EventKind.KART_STATE, EventKind.DISCONNECTED) and stop is None:
            stop = event.monotonic
    if green is None or stop is None:
        return None
    if cut.at > green:
        stop = min(stop, cut.at)
    return stop if stop - green > RACED else None
