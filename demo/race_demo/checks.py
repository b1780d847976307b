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

"""What must be found in the record of a race; each finding is one sentence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.judge import Judge
from race_demo.record import CLOCK_SLACK, Entrant, Order, RaceRecord, time_of

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED

RACE_CONTROL_NODES = frozenset({'rcs', 'rcs_stops', 'rcs_starts', 'official'})

FINISH_LATE = 0.5
"""How much later than due a finished kart may get its RED_FLAG, s; a busy machine needs some."""


@dataclass(frozen=True)
class Finding:
    """Whether something that must be there is there, in one sentence."""

    ok: bool
    text: str


def check_race(record: RaceRecord) -> list[Finding]:
    """Return what is found of a race that goes from the garage over the finish to the garage."""
    return [
        *_check_any_race(
            record,
            racing=(GRID_ACTIVE, GREEN_GREEN, RED_FLAG, RED_RED, IN_GARAGE),
            others=(),
        ),
        _stagger(record),
        _over_by_itself(record),
        _in_garage(record),
    ]


def check_incident(record: RaceRecord) -> list[Finding]:
    """Return what is found of a race that ALL_KILL ends."""
    return [
        *_check_any_race(
            record,
            racing=(GRID_ACTIVE, GREEN_GREEN, RED_RED, IN_GARAGE),
            others=(RED_RED, IN_GARAGE),
        ),
        _all_killed(record),
        _in_garage(record),
    ]


def check_domains(nodes: Mapping[int, set[str]]) -> Finding:
    """
    Return whether no ROS graph has a node of another one.

    :param nodes: the names of all nodes each kart's domain has; race control's at number 0.
    """
    foreign = []
    for number, names in nodes.items():
        own = {'kart_bridge', 'example_stack', f'team_{number}'} if number else RACE_CONTROL_NODES
        foreign.extend(sorted(names - own))
    if foreign:
        return Finding(False, f'nodes on a domain that is not theirs: {", ".join(foreign)}')
    return Finding(
        True, f'{len(nodes)} ROS domains, none with a node of another: only TCP joins them'
    )


def check_wire(judge: Judge) -> Finding:
    """Return whether the karts without ROS were sent what they had to be, to the last frame."""
    judge.finish()
    if judge.violations:
        first = judge.violations[0]
        return Finding(False, f'on the wire, {first.rule}: {first.text}')
    judged = judge.judged
    return Finding(
        True,
        f'{judged["frame"]} frames to the karts without ROS and {judged["call_ended"]} commands '
        'judged: none was against the rules',
    )


def check_end(exit_codes: Mapping[str, int], leftovers: Sequence[str]) -> Finding:
    """Return whether every process ended in an orderly way and none is left."""
    wrong = [f'{name} ended with {code}' for name, code in exit_codes.items() if code]
    wrong += [f'still there: {process}' for process in leftovers]
    if wrong:
        return Finding(False, f'not every process ended well: {"; ".join(wrong)}')
    return Finding(True, f'all {len(exit_codes)} processes ended in good order; none is left')


def _check_any_race(
    record: RaceRecord, racing: Sequence[RaceState], others: Sequence[RaceState]
) -> list[Finding]:
    findings = [
        _events_complete(record),
        *(
            _sequence(record, entrant, racing if entrant.in_race else others)
            for entrant in record.entrants
        ),
        _acknowledged(record),
        _refused(record),
    ]
    if record.failure:
        findings.insert(0, Finding(False, f'the race went no further: {record.failure}'))
    return findings


def _events_complete(record: RaceRecord) -> Finding:
    heard = [event.sequence for event in record.events]
    if not heard or heard != list(range(record.first_event, record.first_event + len(heard))):
        return Finding(False, f'/rcs/events has gaps, or nothing at all: {len(heard)} events')
    return Finding(True, f'/rcs/events told everything: {len(heard)} events without a gap')


def _sequence(record: RaceRecord, entrant: Entrant, expected: Sequence[RaceState]) -> Finding:
    told = [order.state for order in record.orders_to(entrant.number)]
    seen = [state for _, state in record.seen.get(entrant.number, [])]
    wanted = _in_order(expected)
    if told != list(expected):
        return Finding(False, f'{entrant} had to be told {wanted}; told: {_in_order(told)}')
    if seen != list(expected):
        return Finding(False, f'{entrant} had to see {wanted}; saw: {_in_order(seen)}')
    return Finding(True, f'{entrant} saw {wanted}')


def _acknowledged(record: RaceRecord) -> Finding:
    # No kart has to acknowledge IN_GARAGE.
    orders = [order for order in record.orders() if order.state is not IN_GARAGE]
    missing = [
        f'{order.state.value} by kart {order.kart}'
        for order in orders
        if order.acknowledged is None
    ]
    if missing or not orders:
        return Finding(False, f'not acknowledged: {", ".join(missing) or "there was no order"}')
    delays = [(order.acknowledged - order.at, order) for order in orders if order.acknowledged]
    longest, order = max(delays, key=lambda each: each[0])
    return Finding(
        True,
        f'each of the {len(orders)} orders that ask for it was acknowledged; the longest took '
        f'{longest:.2f} s ({order.state.value} by kart {order.kart})',
    )


def _refused(record: RaceRecord) -> Finding:
    accepted = [answer.message for answer in record.refused if answer.success]
    if accepted:
        return Finding(False, f'GREEN_GREEN had to be refused, and was not: {accepted[0]}')
    if not record.refused:
        return Finding(False, 'no GREEN_GREEN was refused')
    return Finding(True, f'the official was told: {record.refused[0].message}')


def _stagger(record: RaceRecord) -> Finding:
    finished = [
        event
        for event in record.events
        if event.kind == msg.RaceEvent.COMMAND
        and event.command == msg.CommandAvailability.KART_FINISH
        and event.success
    ]
    racing = [entrant for entrant in record.entrants if entrant.in_race]
    if sorted(event.kart for event in finished) != sorted(entrant.number for entrant in racing):
        return Finding(False, f'{len(finished)} of {len(racing)} karts finished')
    delays = []
    for place, event in enumerate(finished, start=1):
        due = record.finish_delays[min(place, len(record.finish_delays)) - 1]
        order = _order(record, event.kart, RED_FLAG)
        delay = order.at - time_of(event) if order is not None else None
        if delay is None or not due - CLOCK_SLACK <= delay <= due + FINISH_LATE:
            came = f'{delay:.2f} s' if delay is not None else 'never'
            return Finding(
                False,
                f'kart {event.kart} finished in place {place}: its RED_FLAG had to come '
                f'{due:g} s later; it came: {came}',
            )
        delays.append(f'{event.kart} {delay:.2f} s')
    return Finding(True, f'RED_FLAG came staggered after FINISH: kart {", ".join(delays)}')


def _over_by_itself(record: RaceRecord) -> Finding:
    ended = next(
        (
            event
            for event in record.events
            if event.kind == msg.RaceEvent.RACE_STATE and state_of(event.state) is RED_RED
        ),
        None,
    )
    by_hand = [
        event.text
        for event in record.events
        if event.kind == msg.RaceEvent.COMMAND
        and event.command in (msg.CommandAvailability.RACE_OVER, msg.CommandAvailability.ALL_KILL)
    ]
    if ended is None or by_hand or not record.over:
        why = f': {by_hand[0]}' if by_hand else ''
        return Finding(False, f'the race did not go over by itself{why}')
    return Finding(True, 'the race went over by itself when every kart had finished and stopped')


def _in_garage(record: RaceRecord) -> Finding:
    race = record.final
    if race is None:
        return Finding(False, '/rcs/race was never heard')
    if state_of(race.state) is not IN_GARAGE:
        return Finding(False, f'at the end the race is in {_name(state_of(race.state))}')
    astray = [
        f'kart {kart.number} is sent {_name(state_of(kart.sent))}'
        for kart in race.karts
        if state_of(kart.sent) is not IN_GARAGE or not kart.connected
    ]
    if astray:
        return Finding(False, f'not every kart is in IN_GARAGE at the end: {"; ".join(astray)}')
    return Finding(True, f'at the end the race and all {len(race.karts)} karts are in IN_GARAGE')


def _all_killed(record: RaceRecord) -> Finding:
    called = record.all_kill_called
    if called is None:
        return Finding(False, 'ALL_KILL was not called')
    seen = []
    acknowledged = []
    for entrant in record.entrants:
        order = _order(record, entrant.number, RED_RED)
        if order is None or order.seen is None or order.acknowledged is None:
            return Finding(False, f'ALL_KILL: {entrant} did not see or acknowledge RED_RED')
        seen.append((order.seen - called, str(entrant)))
        acknowledged.append((order.acknowledged - called, str(entrant)))
    return Finding(
        True,
        f'ALL_KILL: from the call to the last kart that saw RED_RED {max(seen)[0] * 1000:.0f} ms '
        f'({max(seen)[1]}), to the last acknowledgement {max(acknowledged)[0]:.2f} s '
        f'({max(acknowledged)[1]})',
    )


def _order(record: RaceRecord, number: int, state: RaceState) -> Order | None:
    return next((order for order in record.orders_to(number) if order.state is state), None)


def _in_order(states: Iterable[RaceState | None]) -> str:
    return ' > '.join(map(_name, states)) or 'nothing but IN_GARAGE'


def _name(state: RaceState | None) -> str:
    return state.value if state is not None else 'UNKNOWN'
