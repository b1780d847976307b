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

"""
What one kart did well and badly in a race, by the record alone.

Pure: events in, findings out. No sentence of an event is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from evgp_rcs.record import RecordedEvent

LIMITS = {'GRID_ACTIVE': 120.0, 'GREEN_GREEN': 30.0, 'RED_FLAG': 15.0, 'RED_RED': 5.0}
"""Time that a kart has to acknowledge a state, in seconds (§3.A)."""

TOO_SOON = 0.2
"""A red acknowledged sooner than this by a kart that raced: it had hardly stopped, in seconds."""

RACED = 1.0
"""Time in GREEN_GREEN after which a kart drives, in seconds."""


@dataclass(frozen=True)
class Finding:
    """Whether a kart did something well, in one sentence; a note is neither."""

    good: bool
    text: str
    note: bool = False


def conduct(events: Sequence[RecordedEvent], kart: int) -> list[Finding]:
    """
    Return what a kart did well and badly.

    :param events: of the record, in order.
    """
    own = [event for event in events if event.kart == kart]
    findings: list[Finding] = []
    for index, event in enumerate(own):
        if event.kind == 'KART_STATE' and event.state in LIMITS:
            findings += _obeyed(own, index)
    malformed = sum(event.kind == 'MALFORMED' for event in own)
    if malformed:
        findings.append(Finding(False, f'sent what is no frame ({malformed} times)'))
    withdrawn = sum(event.kind == 'WITHDRAWN' for event in own)
    if withdrawn:
        findings.append(
            Finding(False, f'said another state after it had acknowledged ({withdrawn} times)')
        )
    if not any(event.kind == 'CONNECTED' for event in own):
        findings.append(Finding(False, 'never connected'))
    lost = [event.monotonic for event in own if event.kind == 'DISCONNECTED']
    back = [event.monotonic for event in own if event.kind == 'CONNECTED']
    if lost and (not back or back[-1] < lost[-1]):
        findings.append(Finding(False, 'did not come back after its connection was lost'))
    elif lost:
        waited = max(min(at for at in back if at >= gone) - gone for gone in lost)
        findings.append(Finding(True, f'came back after a lost connection, within {waited:.1f} s'))
    return findings


def _obeyed(own: Sequence[RecordedEvent], index: int) -> list[Finding]:
    """Return how a kart acknowledged one order; nothing if it had no time to."""
    order = own[index]
    assert order.state is not None
    limit = LIMITS[order.state]
    # Until the next order, or the loss of the connection it came on: then another one counts.
    following = index + 1
    rest = own[following:]
    stops = ('KART_STATE', 'DISCONNECTED')
    until = next((at for at, each in enumerate(rest) if each.kind in stops), len(rest))
    said = next((each for each in rest[:until] if each.kind == 'ACKNOWLEDGED'), None)
    if said is None:
        left = (rest[until].monotonic if until < len(rest) else float('inf')) - order.monotonic
        if left < limit:
            return []
        return [Finding(False, f'did not acknowledge {order.state} within {limit:g} s')]
    took = said.monotonic - order.monotonic
    found = [
        Finding(
            took <= limit, f'acknowledged {order.state} after {took:.2f} s (limit {limit:g} s)'
        )
    ]
    if order.state in ('RED_FLAG', 'RED_RED') and took < TOO_SOON and _raced(own[:index], order):
        text = f'acknowledged {order.state} after {took:.2f} s: did it really stand still?'
        found.append(Finding(True, text, note=True))
    return found


def _raced(before: Sequence[RecordedEvent], order: RecordedEvent) -> bool:
    # One that has just connected was away, and had to stop meanwhile (§3.E).
    kinds = ('KART_STATE', 'CONNECTED')
    last = next((each for each in reversed(before) if each.kind in kinds), None)
    return (
        last is not None
        and last.state == 'GREEN_GREEN'
        and order.monotonic - last.monotonic > RACED
    )
