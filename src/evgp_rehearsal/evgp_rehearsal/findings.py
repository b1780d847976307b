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
What must be found in the record of a demonstration's race, and in what its karts saw of it.

Pure: events and what karts saw go in, findings come out. All times are seconds of race control's
clock.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from evgp_rcs.record import RecordedEvent
from evgp_rehearsal.conduct import Finding

CLOCK_SLACK = 0.05
"""How much too late an event may be stamped, in seconds: race control stamps what it did after it
did it, and a kart's answer can be quicker."""

FINISH_LATE = 1.0
"""How much later than due a finished kart may get its RED_FLAG on a busy machine, in seconds."""

WHOLE = ('GRID_ACTIVE', 'GREEN_GREEN', 'RED_FLAG', 'RED_RED', 'IN_GARAGE')
"""What a kart is sent in a race from the garage over the finish to the garage."""

KILLED = ('GRID_ACTIVE', 'GREEN_GREEN', 'RED_RED', 'IN_GARAGE')
"""What a kart is sent in a race that ALL_KILL ends."""

Seen = Mapping[int, Sequence[tuple[float, str]]]
"""The states that each kart saw, without repetitions, and when."""


@dataclass(frozen=True)
class Order:
    """
    A state that race control began to send to a kart; None: never seen, or never acknowledged.

    :param seen: when the kart had it: a plain kart its first frame, a kart with ROS the first
        message of its bridge that says to obey it.
    """

    at: float
    kart: int
    state: str
    seen: float | None
    acknowledged: float | None

    @property
    def answered(self) -> bool:
        """Return whether it was acknowledged, if it had to be."""
        return self.acknowledged is not None or self.state == 'IN_GARAGE'


@dataclass
class Race:
    """
    All that was heard of one race.

    :param karts: of the roster, and whether each is in the race.
    :param called: when the official called ALL_KILL.
    :param failure: what was awaited in vain, so that the race went no further.
    """

    karts: Mapping[int, bool]
    events: list[RecordedEvent]
    seen: Seen
    called: float | None = None
    failure: str = ''

    def orders(self, kart: int = 0) -> list[Order]:
        """Return what each kart, or one of them, was told, and what became of it."""
        told = [each for each in self.events if each.kind == 'KART_STATE']
        return [self._order(each) for each in told if kart in (0, each.kart)]

    def commands(self, *names: str) -> Iterator[RecordedEvent]:
        """Return the commands of these names that officials gave."""
        return (each for each in self.events if each.kind == 'COMMAND' and each.command in names)

    def _order(self, told: RecordedEvent) -> Order:
        # What becomes of it must become so before the kart is told something else.
        place = self.events.index(told) + 1
        later = [each for each in self.events[place:] if each.kart == told.kart]
        ends = next((n for n, each in enumerate(later) if each.kind == 'KART_STATE'), len(later))
        state = told.state or 'UNKNOWN'
        said = (
            each.monotonic
            for each in later[:ends]
            if each.kind == 'ACKNOWLEDGED' and each.state == state
        )
        saw = (
            at
            for at, each in self.seen.get(told.kart, ())
            if each == state and at >= told.monotonic - CLOCK_SLACK
        )
        return Order(told.monotonic, told.kart, state, next(saw, None), next(said, None))


def judge_whole(race: Race, finish_delays: Sequence[float]) -> list[Finding]:
    """Return what is found of a race from the garage over the finish to the garage."""
    findings = _judge(race, WHOLE, ())
    return [*findings, _stagger(race, finish_delays), _over_by_itself(race), _in_garage(race)]


def judge_killed(race: Race) -> list[Finding]:
    """Return what is found of a race that ALL_KILL ends."""
    return [*_judge(race, KILLED, KILLED[-2:]), _all_killed(race), _in_garage(race)]


def judge_events(heard: Sequence[int], recorded: Sequence[RecordedEvent]) -> Finding:
    """Return whether officials heard every event of the record, up to the last one they heard."""
    if not heard or list(heard) != [each.sequence for each in recorded[: len(heard)]]:
        return Finding(False, f'/rcs/events has gaps, or nothing at all: {len(heard)} events')
    return Finding(True, f'/rcs/events told what the record has: {len(heard)} events, no gap')


def judge_domains(nodes: Mapping[int, set[str]], own: Mapping[int, set[str]]) -> Finding:
    """
    Return whether no ROS graph has a node of another one.

    :param nodes: the names of all nodes on each domain.
    :param own: those that belong there.
    """
    foreign = sorted(name for domain, names in nodes.items() for name in names - own[domain])
    if foreign:
        return Finding(False, f'nodes on a domain that is not theirs: {", ".join(foreign)}')
    return Finding(
        True, f'{len(nodes)} ROS domains, none with a node of another: only TCP joins them'
    )


def judge_end(codes: Mapping[str, int], left: Sequence[int]) -> Finding:
    """Return whether every process ended in an orderly way, and none is left."""
    wrong = [f'{name} ended with {code}' for name, code in codes.items() if code]
    wrong += [f'process {pid} is still there' for pid in left]
    if wrong:
        return Finding(False, f'not every process ended well: {"; ".join(wrong)}')
    return Finding(True, f'all {len(codes)} processes ended in good order; none is left')


def _judge(race: Race, racing: Sequence[str], others: Sequence[str]) -> list[Finding]:
    failed = [Finding(False, f'the race went no further: {race.failure}')] if race.failure else []
    return [
        *failed,
        *(
            _sequence(race, kart, racing if is_in else others)
            for kart, is_in in race.karts.items()
        ),
        _acknowledged(race),
        _refused(race),
    ]


def _sequence(race: Race, kart: int, expected: Sequence[str]) -> Finding:
    wanted = _in_order(expected)
    told = [order.state for order in race.orders(kart)]
    seen = [state for _, state in race.seen.get(kart, ())]
    if told != list(expected):
        return Finding(False, f'kart {kart} had to be told {wanted}; told: {_in_order(told)}')
    if seen != list(expected):
        return Finding(False, f'kart {kart} had to see {wanted}; saw: {_in_order(seen)}')
    return Finding(True, f'kart {kart} saw {wanted}')


def _acknowledged(race: Race) -> Finding:
    orders = race.orders()
    missing = [f'{each.state} by kart {each.kart}' for each in orders if not each.answered]
    if missing or not orders:
        return Finding(False, f'not acknowledged: {", ".join(missing) or "there was no order"}')
    delays = [(each.acknowledged - each.at, each) for each in orders if each.acknowledged]
    longest, order = max(delays, key=lambda each: each[0])
    return Finding(
        True,
        f'each of the {len(delays)} orders that ask for it was acknowledged; the longest took '
        f'{longest:.2f} s ({order.state} by kart {order.kart})',
    )


def _refused(race: Race) -> Finding:
    answers = list(race.commands('GREEN_GREEN'))
    refused = [each.text for each in answers if not each.success]
    if not refused or len(answers) - len(refused) != 1:
        was = f'refused {len(refused)} times and accepted {len(answers) - len(refused)} times'
        return Finding(False, f'GREEN_GREEN had to be refused, then accepted once; it was {was}')
    return Finding(True, f'the official was told: {refused[0]}')


def _stagger(race: Race, finish_delays: Sequence[float]) -> Finding:
    finished = [each for each in race.commands('KART_FINISH') if each.success]
    racing = [kart for kart, is_in in race.karts.items() if is_in]
    if sorted(each.kart for each in finished) != racing:
        return Finding(False, f'{len(finished)} of {len(racing)} karts finished')
    delays = []
    for place, each in enumerate(finished, start=1):
        due = finish_delays[min(place, len(finish_delays)) - 1]
        at = _told_at(race, each.kart, 'RED_FLAG')
        delay = float('inf') if at is None else at - each.monotonic
        if not due - CLOCK_SLACK <= delay <= due + FINISH_LATE:
            return Finding(
                False,
                f'kart {each.kart} finished in place {place}: its RED_FLAG had to come '
                f'{due:g} s later; it came after {delay:.2f} s',
            )
        delays.append(f'{each.kart} {delay:.2f} s')
    return Finding(True, f'RED_FLAG came staggered after FINISH: kart {", ".join(delays)}')


def _over_by_itself(race: Race) -> Finding:
    over = any(each.kind == 'RACE_STATE' and each.state == 'RED_RED' for each in race.events)
    by_hand = [each.text for each in race.commands('RACE_OVER', 'ALL_KILL', 'RECORD_MSR')]
    if not over or by_hand:
        why = f': {by_hand[0]}' if by_hand else ''
        return Finding(False, f'the race did not go over by itself{why}')
    return Finding(True, 'the race went over by itself when every kart had finished and stopped')


def _in_garage(race: Race) -> Finding:
    states = [each.state for each in race.events if each.kind == 'RACE_STATE']
    if states[-1:] != ['IN_GARAGE']:
        return Finding(False, f'at the end the race is in {states[-1] if states else "no state"}')
    lost = sorted({each.kart for each in race.events if each.kind == 'DISCONNECTED'})
    if lost:
        return Finding(False, f'karts lost their connection: {", ".join(map(str, lost))}')
    return Finding(True, f'at the end the race and all {len(race.karts)} karts are in IN_GARAGE')


def _all_killed(race: Race) -> Finding:
    if race.called is None:
        return Finding(False, 'ALL_KILL was not called')
    orders = [order for order in race.orders() if order.state == 'RED_RED']
    seen = [(each.seen - race.called, each.kart) for each in orders if each.seen]
    said = [(each.acknowledged - race.called, each.kart) for each in orders if each.acknowledged]
    for each in (seen, said):
        silent = sorted(set(race.karts) - {kart for _, kart in each})
        if silent:
            listed = ', '.join(map(str, silent))
            return Finding(False, f'ALL_KILL: RED_RED not seen or acknowledged by kart {listed}')
    return Finding(
        True,
        f'ALL_KILL: from the call to the last kart that saw RED_RED {max(seen)[0] * 1000:.0f} ms '
        f'(kart {max(seen)[1]}), to the last acknowledgement {max(said)[0]:.2f} s '
        f'(kart {max(said)[1]})',
    )


def _told_at(race: Race, kart: int, state: str) -> float | None:
    return next((order.at for order in race.orders(kart) if order.state == state), None)


def _in_order(states: Sequence[str]) -> str:
    return ' > '.join(states) or 'nothing but IN_GARAGE'
