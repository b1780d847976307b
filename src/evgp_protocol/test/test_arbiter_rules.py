# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The rules of the arbiter, held against an oracle that knows only the history of the inputs.

The oracle computes everything from the list of inputs, and shares no code with the arbiter but the
names of the states. It is checked along random histories, along every reachable state of a small
world, and by faults put into the arbiter on purpose, each of which it must find.
"""

from __future__ import annotations

import copy
import dataclasses
import enum
import functools
import itertools
import math
from types import ModuleType
from typing import Any

from evgp_protocol import arbiter as arbiter_module
from evgp_protocol.arbiter import Arbiter, Settings, StopSource, Verdict
from evgp_protocol.states import RaceState
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
import pytest
from rig.faults import faults_in, module_with

GREEN, GRID = RaceState.GREEN_GREEN, RaceState.GRID_ACTIVE
GARAGE, FLAG, RED = RaceState.IN_GARAGE, RaceState.RED_FLAG, RaceState.RED_RED
TWO = StopSource.ODOMETRIES


FIRST_ORDER = 1000


@dataclasses.dataclass(frozen=True)
class Input:
    """One input, and what the arbiter answered to it."""

    kind: str  # the method of the arbiter
    value: Any  # its argument besides the time; of an acknowledgement, the state
    at: float
    number: int = 0  # the order that an acknowledgement names
    order: int = 0  # the number of what is commanded, as the arbiter says after the input
    accepted: bool = False  # for an acknowledgement
    said: RaceState | None = None  # what was sent to race control
    gave_up: bool = False


History = tuple[Input, ...]


class Oracle:
    """
    What must hold after a history, at its last input, as the rules are worded.

    :param before: the oracle before the last input.
    """

    def __init__(self, history: History, settings: Settings, before: Oracle | None = None) -> None:
        self.history = history
        self.settings = settings
        # The oracles after each input, this one included.
        self._after: list[Oracle] = [] if before is None else [*before._after, self]
        assert len(self._after) == len(history)
        self.now = history[-1].at if history else 0.0
        # Whether the team stop is on, and whether it was when the last input came.
        self.team_stop = self._stopped(history)
        self.was_stopped = self._stopped(history[:-1])
        self.since = self._connection()
        self.connection = self._from(self.since)
        heard = [item for item in self.connection if item.kind == 'heard']
        self.commanded: RaceState | None = heard[-1].value if heard else None
        ready = self._acknowledged_grid()
        stopped = ready is not None and self.stopped_since(ready)
        # A GRID_ACTIVE was acknowledged here, and nothing came between; or a kart that was armed
        # has stopped itself under the same commands.
        self.armed, self.out = ready is not None and not stopped, stopped

    def _from(self, begin: int | None, end: int | None = None) -> History:
        return () if begin is None else self.history[begin:end]

    def _connection(self) -> int | None:
        """Where the present connection begins, if it lives."""
        since = None
        for index, item in enumerate(self.history):
            if item.kind == 'connected':
                since = index
            elif item.kind == 'disconnected':
                since = None
        if since is None:
            return None
        signs = [item.at for item in self.history[since:] if item.kind in ('connected', 'heard')]
        for earlier, later in itertools.pairwise([*signs, self.now]):
            if later - earlier >= self.settings.frame_timeout:
                return None
        return since

    def _stopped(self, past: History) -> bool:
        """Whether the team stop is on now, after these inputs."""
        stops = {item.value[0]: item.value[1] for item in past if item.kind == 'team_stop'}
        if any(stops.values()):
            return True
        signs = self._signs(past)
        return any(not each or self.now - each[-1] >= timeout for timeout, each in signs)

    def _signs(self, past: History) -> list[tuple[float, list[float]]]:
        """Return what must not be missed for how long, and when it came."""
        timeouts = {
            StopSource.TSR: self.settings.tsr_timeout,
            StopSource.MSR: self.settings.msr_timeout,
            StopSource.TEAM: self.settings.team_timeout,
        }

        def is_sign(item: Input, source: StopSource) -> bool:
            if item.kind == 'team_heard':
                return source is StopSource.TEAM
            return item.kind == 'team_stop' and item.value[0] is source

        return [
            (timeout, [item.at for item in past if is_sign(item, source)])
            for source, timeout in timeouts.items()
            if timeout > 0
        ]

    def stopped_since(self, begin: int) -> bool:
        """Whether the team stop was on at any time from the input at `begin` to now."""
        if any(each.team_stop for each in self._after[begin:]):
            return True
        # They may have been missed for too long between two of the inputs.
        for timeout, signs in self._signs(self.history):
            for earlier, later in itertools.pairwise([*signs, self.now]):
                if later >= earlier + timeout and later > self.history[begin].at:
                    return True
        return False

    def _acknowledged_grid(self) -> int | None:
        """Where the GRID_ACTIVE was acknowledged here that still lets GREEN_GREEN be obeyed."""
        if self.since is None:
            return None
        for index in range(self.since, len(self.history)):
            item = self.history[index]
            if not (item.kind == 'acknowledge' and item.accepted and item.value is GRID):
                continue
            run = [GRID]
            run += [later.value for later in self.history[index:] if later.kind == 'heard']
            names = [state for state, _ in itertools.groupby(run)]
            if names in ([GRID], [GRID, GREEN]):
                return index
        return None

    @property
    def state(self) -> RaceState:
        if self.commanded is None or self.team_stop or self.out:
            return RED
        if self.commanded is GREEN and not self.armed:
            return RED
        return self.commanded

    @property
    def _run(self) -> int | None:
        """Where the present command began."""
        begin = None
        last = None
        for index, item in enumerate(self.connection):
            if item.kind == 'heard':
                if item.value is not last:
                    begin = index
                last = item.value
        return None if begin is None or self.since is None else self.since + begin

    @property
    def _numbered(self) -> int | None:
        """Where the present command got the number that it has."""
        begin = self._run
        if begin is None:
            return None
        for index in range(begin + 1, len(self.history)):
            earlier, later = self._after[index - 1], self._after[index]
            ends = later.was_stopped and not later.team_stop
            if ends or (later.team_stop and earlier.armed):
                begin = index
        return begin

    def is_numbered(self) -> bool:
        """
        Whether one number, which nothing had before, stands for the present command.

        Since it was commanded, or since a team stop ended or took an armed kart out. It is none of
        those before the first one, which an earlier bridge may have given.
        """
        begin = self._numbered
        if begin is None:
            return not self.history or self.history[-1].order == 0
        earlier = {item.order for item in self._from(0, begin)}
        present = {item.order for item in self._from(begin)}
        return len(present) == 1 and min(present) >= FIRST_ORDER and not present & earlier

    @property
    def acknowledged(self) -> bool:
        if self._run is None:
            return False
        if self.commanded is GRID and not self.out:
            return self.armed
        said = [item.said for item in self._from(self._run) if item.said is not None]
        return self.reached in said

    @property
    def reached(self) -> RaceState | None:
        """Return what a kart that has done what it obeys says."""
        if self.out:
            return RED
        return None if self.commanded in (GRID, GREEN) and self.state is RED else self.commanded

    @property
    def may_drive(self) -> bool:
        if self.state is GREEN:
            return True
        if self.state is GARAGE:
            return self.settings.drive_in_garage
        if self.state is not FLAG or self._run is None or self.acknowledged:
            return False
        begin = self.history[self._run]
        if self.now - begin.at >= self.settings.red_flag_drive_time:
            return False
        if self.stopped_since(self._run):
            return False
        # What held when the flag came: the same moment, without the flag.
        before = (*self.history[: self._run], Input('tick', None, begin.at))
        return Oracle(before, self.settings, self._after[self._run - 1]).may_drive

    def must_accept(self, state: RaceState, number: int) -> bool:
        begin = self._numbered
        if state is not self.reached or begin is None:
            return False
        if number == 0 or number != self.history[begin].order:
            return False
        speeds = [item for item in self.history if item.kind == 'speed']
        stops = [item.value for item in self.history if item.kind == 'team_stop']
        doubts = [engaged for source, engaged in stops if source is TWO]
        by_odometry = self.settings.odometry_required or self.settings.auto_acknowledge_stop
        by_odometry = by_odometry or bool(speeds) or any(doubts)
        if state is GARAGE or not by_odometry:
            return True
        if doubts and doubts[-1]:
            return False
        speeds = self._sure_speeds(0)
        if not speeds or self.now - speeds[-1].at > 0.5:
            return False
        speed, limit = speeds[-1].value, self.settings.standstill_speed
        return bool(speed > limit if state is GREEN else speed <= limit)

    def _sure_speeds(self, begin: int) -> History:
        """Return the speeds from there on, without those that two might have measured."""
        sure: History = ()
        doubt = False
        for index, item in enumerate(self.history):
            if item.kind == 'team_stop' and item.value[0] is TWO:
                doubt, sure = item.value[1], ()
            elif item.kind == 'speed' and not doubt and index >= begin:
                sure = (*sure, item)
        return sure

    @property
    def _red_since(self) -> int | None:
        """Where it began that a kart that stands must say so."""
        if not self.out:
            return self._run if self.commanded in (FLAG, RED) else None
        begin = self._run
        assert begin is not None
        while not self._after[begin].out:
            begin += 1
        return begin

    @property
    def must_acknowledge_by_itself(self) -> bool:
        """Whether the speed that is the last input completes a standstill under a red."""
        if not self.settings.auto_acknowledge_stop or self.history[-1].kind != 'speed':
            return False
        since = self._red_since
        if since is None or any(item.said is self.reached for item in self._from(since, -1)):
            return False
        speeds = self._sure_speeds(since)
        if not speeds:
            return False
        begin = self.now
        for earlier, later in itertools.pairwise([*reversed(speeds), None]):
            if not earlier.value <= self.settings.standstill_speed:
                break
            begin = earlier.at
            if later is None or earlier.at - later.at > 0.5:
                break
        else:
            raise AssertionError('unreachable')
        stood = speeds[-1].value <= self.settings.standstill_speed
        return stood and self.now - begin >= self.settings.standstill_time


def apply(arbiter: Arbiter, kind: str, value: Any, at: float) -> tuple[Input, Verdict]:
    """Give one input to the arbiter; note it with its answer, and return what it must do then."""
    number = 0
    stop_source = type(arbiter).team_stop.__globals__['StopSource']
    if kind in ('tick', 'connected', 'team_heard'):
        outcome = getattr(arbiter, kind)(at)
    elif kind == 'team_stop':
        outcome = arbiter.team_stop(stop_source[value[0].name], value[1], at)
    elif kind == 'disconnected':
        outcome = arbiter.disconnected('the test', at)
    elif kind == 'acknowledge':
        value, named = value
        number = {'present': arbiter.verdict.order, 'none': 0}.get(named, FIRST_ORDER)
        if named == 'earlier':
            number = max(arbiter.verdict.order - 1, 0)
        outcome = arbiter.acknowledge(value, number, at)
    else:
        outcome = getattr(arbiter, kind)(value, at)
    accepted = kind == 'acknowledge' and not outcome.refusal
    verdict = outcome.verdict
    assert vars(verdict) == vars(arbiter.verdict)
    gave_up = outcome.give_up is not None
    note = Input(kind, value, at, number, verdict.order, accepted, outcome.send, gave_up)
    return note, verdict


def check(oracle: Oracle, earlier: Oracle, verdict: Verdict) -> None:
    """
    Hold one verdict, and the answer that came with it, against the oracle.

    :param earlier: the oracle before the last input.
    """
    history, settings = oracle.history, oracle.settings
    assert verdict.state is oracle.state
    assert verdict.commanded is oracle.commanded
    assert verdict.order == (history[-1].order if history else 0)
    assert oracle.is_numbered()
    assert verdict.connected == (oracle.commanded is not None)
    assert verdict.team_stop == oracle.team_stop
    assert (verdict.reached, verdict.acknowledged) == (oracle.reached, oracle.acknowledged)
    assert verdict.may_drive == oracle.may_drive
    assert (verdict.reason == '') == (verdict.state is verdict.commanded)
    if not history:
        return
    last = history[-1]
    if last.kind == 'acknowledge':
        before = Oracle((*history[:-1], Input('tick', None, last.at)), settings, earlier)
        assert last.accepted == before.must_accept(last.value, last.number)
        again = before.out and before.acknowledged  # what nobody commanded is said once
        assert last.said is (last.value if last.accepted and not again else None)
    elif last.kind == 'speed':
        assert (last.said is not None) == oracle.must_acknowledge_by_itself
        assert last.said in (None, oracle.reached)
    else:
        assert last.said is None
    # The socket is given up when a connection that lived at the last input does not at this
    # one, and nobody said so.
    if last.kind not in ('connected', 'disconnected'):
        assert last.gave_up == (earlier.since is not None and oracle.since is None)


# The small world: all durations are 1 (a speed is fresh for 0.5) and time passes in halves.

SMALL = Settings(
    frame_timeout=1.0,
    tsr_timeout=0.0,
    auto_acknowledge_stop=False,
    standstill_time=1.0,
    red_flag_drive_time=1.0,
)
LINK = [
    ('tick', None),
    ('connected', None),
    ('disconnected', None),
    *(('heard', state) for state in RaceState),
    *(('acknowledge', (state, 'present')) for state in RaceState),
    *(('acknowledge', (RED, named)) for named in ('earlier', 'none')),
]
STOPS = [('team_stop', (source, engaged)) for source in StopSource for engaged in (True, False)]
DOUBT = [('team_stop', (TWO, engaged)) for engaged in (True, False)]
TEAM = [('team_heard', None)]
SPEEDS = [('speed', value) for value in (0.0, 1.0, math.nan)]


# Of the numbers of orders, only whether there is one counts: the next is always a new one. The
# second line is for the reason only.
LEFT_OUT = {
    *('_settings', '_now', '_next_order', '_timeouts'),
    *('_race_control', '_odometry', '_absence', '_not_armed', '_starting'),
}


@functools.cache
def kept(names: tuple[str, ...]) -> list[tuple[str, bool]]:
    """Return the variables of an arbiter that an input can tell apart, and which are times."""
    left = sorted({*names} - LEFT_OUT)
    return [(name, name.endswith(('_at', '_since'))) for name in left]


def fingerprint(arbiter: Arbiter) -> tuple[Any, ...]:
    """
    Return the state of an arbiter, alike for states that no input can tell apart.

    Times are taken relative to now, and all that is long past is equally long past.
    """
    now, values = arbiter._now, vars(arbiter)
    state: list[Any] = []
    for name, is_time in kept(tuple(values)):
        value = values[name]
        if name == '_heard_at' and not arbiter._open:
            continue
        if is_time and value is not None:
            value = min(now - value, 1.5)
        elif name == '_order':
            value = value == 0
        elif name == '_engaged':
            value = tuple(sorted(each.name for each in value))
        elif name == '_signs':
            value = tuple(sorted((each.name, min(now - at, 1.5)) for each, at in value.items()))
        elif isinstance(value, float) and math.isnan(value):
            value = 'nan'
        elif isinstance(value, enum.Enum):
            value = value._name_  # quicker to compare
        state.append(value)
    return tuple(state)


def explore(
    module: ModuleType, settings: Settings, inputs: list[tuple[str, Any]], limit: int = 10**9
) -> tuple[int, int]:
    """
    Visit every state that the inputs reach, and check every step out of each.

    :return: the number of states and of steps.
    :raises AssertionError: with the history, where the arbiter and the oracle differ.
    """
    own_settings = module.Settings(**vars(settings))
    first = module.Arbiter(own_settings, FIRST_ORDER)
    first.tick(0.0)
    start = Oracle((Input('tick', None, 0.0),), settings, Oracle((), settings))
    seen = {fingerprint(first)}
    front: list[tuple[Arbiter, Oracle]] = [(first, start)]
    steps = 0
    while front and steps < limit:
        behind, front = front, []
        for arbiter, earlier in behind:
            for (kind, value), wait in itertools.product(inputs, (0.0, 0.5)):
                later = copy.copy(arbiter)
                note, verdict = apply(later, kind, value, earlier.now + wait)
                oracle = Oracle((*earlier.history, note), settings, earlier)
                steps += 1
                try:
                    check(oracle, earlier, verdict)
                except AssertionError as error:
                    told = f'{error}\nafter {oracle.history}\n{verdict}'
                    raise AssertionError(told) from error
                mark = fingerprint(later)
                if mark not in seen:
                    seen.add(mark)
                    front.append((later, oracle))
    return len(seen), steps


World = tuple[Settings, list[tuple[str, Any]]]


def world(inputs: list[tuple[str, Any]], **settings: Any) -> World:
    return dataclasses.replace(SMALL, **settings), LINK + inputs


WORLDS: dict[str, World] = {
    'plain': world(STOPS[:6]),
    'remote and MSR': world(STOPS[2:6], tsr_timeout=1.0, msr_timeout=1.0),
    'team must be heard': world(TEAM + STOPS[:2], team_timeout=1.0),
    'acknowledges by itself': world(STOPS[:2] + SPEEDS, auto_acknowledge_stop=True),
    'acknowledges by one of two': world(DOUBT + SPEEDS, auto_acknowledge_stop=True),
    'odometry required': world(DOUBT + SPEEDS, odometry_required=True),
    'odometry heard': world(DOUBT + SPEEDS),
    'drives in garage': world(STOPS[:2], drive_in_garage=True),
}
"""The settings of each world, and what can come in: few enough kinds to search it to the end."""


@pytest.mark.parametrize('name', WORLDS)
def test_every_reachable_state_keeps_the_rules(name: str) -> None:
    states, steps = explore(arbiter_module, *WORLDS[name])
    print(f'{name}: {states} states, {steps} steps')
    assert states > 50


# Faults put in on purpose.
FAULTS = faults_in(
    """
starts open: __init__: instead of _open: self._open = True
silence is no loss: _pass: never _open #2
timeout a little late: _pass: _heard_at >= => now > self._heard_at + settings.frame_timeout
socket kept after silence: _pass: after _lose: give_up = None
command outlives the connection: _lose: skips _commanded
acknowledged outlives the connection: _lose: skips _acknowledged
acknowledged outlives the command: _command: skips _acknowledged
late frame counts: heard: always _open
nothing disarms: [drives in garage] _command: never to_race not
grid again does not disarm: [drives in garage] _command: to_race not => it and state is not
    RaceState.GRID_ACTIVE
green needs no grid: verdict: never _armed not
team stop does not disarm: [drives in garage] _on_team_stop: skips _disarm
remote silence does not disarm: [remote and MSR] _pass: never _signs
remote is not missed: [remote and MSR] __init__: tsr_timeout => 0.0
the contact of the MSR is not missed: [remote and MSR] __init__: msr_timeout => 0.0
silence is told apart too late: [remote and MSR] _pass: _timeouts < => now <= at +
    self._timeouts[each]
the word of one remote is a sign of the other: [remote and MSR] _sign: instead of _timeouts:
    self._signs = dict.fromkeys(self._timeouts, now)
a deaf bridge is not missed: __init__: team_timeout => 0.0
hearing the team releases its stop: team_heard: instead of _starting: self._engaged = {}
one source releases the other: team_stop: others #2 => {}
service stop is ignored: _team_stop: _engaged => self._engaged.get(StopSource.TSR)
team stop is looser than red: verdict: never team_stop
a new command keeps its number: _command: instead of _number: self._order = self._order or
    self._next_order
the same state has the same number: [drives in garage] _command: instead of _number: self._order =
    1 + list(RaceState).index(state)
a number outlives its connection: _lose: skips _order
the end of a team stop keeps the number: _reaction: never _stopped stopped
what a team stop takes back keeps its number: _on_team_stop: skips _number
a team stop takes nobody out: _on_team_stop: skips _out
a kart that was not ready is out: [drives in garage] _on_team_stop: _armed => self._commanded is
    not None
what was said before the kart was out counts: [drives in garage] _on_team_stop: skips _acknowledged
out only for as long as the team stop is on: verdict: never _out
out for ever: _command: skips _out
out on the next connection: _lose: skips _out
a kart that is out is ready again: [drives in garage] _reached: never _out
a kart that is out is armed again: [drives in garage] _acknowledge: without _out
says again that it is out: acknowledge: never _out _acknowledged
one of two odometries shows a standstill: [odometry required] missing_odometry: never two
one of two odometries acknowledges: [acknowledges by one of two] speed: without missing_odometry
    not
one of two odometries shows a standstill after the other is gone: [odometry required] team_stop:
    skips inf
two odometries are none: [odometry heard] team_stop: skips _odometry_expected
an order of old is acknowledged: _refusal: order != => order > verdict.order
an order without a number is acknowledged: _refusal: instead of missing order: if order == 0: ¶>
    return None
any number will do: _refusal: never order verdict
acknowledges what is not commanded: _refusal: never reached
acknowledges grid under a team stop: _reached: never _commanded to_race
refuses a red under a team stop: _reached: _commanded to_race => state is not self._commanded
acknowledges a red while moving: [acknowledges by itself] _contradiction: always speed <=
a kart that moves is ready for the grid: [odometry required] _refusal: _contradiction ( ) => state
    is not RaceState.GRID_ACTIVE and it
no number is slow enough for a red: [acknowledges by itself] _contradiction: speed <= => not speed
    > limit
acknowledges green while it stands: [odometry required] _contradiction: always speed > #1
no number drives: [odometry required] _contradiction: speed > #1 => not speed <= limit
required odometry is not missed: [odometry required] __init__: without odometry_required
odometry that acknowledges is not missed: [acknowledges by itself] __init__: without
    auto_acknowledge_stop
odometry that was lost is not missed: [odometry heard] speed: skips _odometry_expected
a kart without odometry is ready for the grid: [odometry required] _refusal: missing
    missing_odometry => state is not RaceState.GRID_ACTIVE and it
odometry of old shows a standstill: [odometry required] _refusal: missing_odometry =>
    math.isinf(self._speed_at) and it
flag lets a standing kart drive: _command: RED_FLAG was_driving => state is RaceState.RED_FLAG
flag lets drive for ever: [drives in garage] _pass: red_flag_drive_time is => slowing is not None
    and now < now and (now >= slowing + settings.red_flag_drive_time)
flag lets drive once acknowledged: [drives in garage] _acknowledge: skips _slowing_since
flag drives on after a team stop: [drives in garage] _on_team_stop: skips _slowing_since
drives in garage unasked: _may_drive: drive_in_garage => True
standing before the red counts: [acknowledges by itself] _command: skips _still_since
one speed is a standstill: [acknowledges by itself] speed: never standstill_time
no number is a standstill: [acknowledges by itself] speed: _speed _settings => not self._speed >
    self._settings.standstill_speed
a gap is a standstill: [acknowledges by itself] speed: _still_since gap => self._still_since is
    None
acknowledges a red unasked: [odometry required] speed: without auto_acknowledge_stop
says by odometry what is commanded: [acknowledges by itself] speed: send => self._commanded
odometry does not say that it is out: [acknowledges by itself] speed: _settings is => self._out or
    self._still_since is None or now < self._still_since + self._settings.standstill_time
"""
)
"""Each fault, and the world that shows it soonest, if it takes long to come by."""


DAILY = {fault.where: name for name, fault in reversed(FAULTS.items())}
"""The first fault of each function."""


def test_every_fault_has_one_place_in_the_function_that_it_names() -> None:
    for fault in FAULTS.values():
        module_with(arbiter_module, fault)


@pytest.mark.parametrize(
    'name',
    [
        pytest.param(each, marks=() if each in DAILY.values() else pytest.mark.long)
        for each in FAULTS
    ],
)
def test_fault_is_found(name: str) -> None:
    fault = FAULTS[name]
    module = module_with(arbiter_module, fault)
    with pytest.raises(AssertionError, match='after'):
        if fault.begin:
            explore(module, *WORLDS[fault.begin], limit=30_000)
        # Most show near the beginning of a world, and the others as it is searched to the end.
        for limit, each in itertools.product((100, 1_000, 10**9), WORLDS.values()):
            explore(module, *each, limit)


@pytest.mark.parametrize(('speed', 'named'), [(0.07, '0.07 m/s'), (math.nan, 'nan m/s')])
def test_odometry_that_keeps_a_red_from_being_acknowledged_is_named(
    speed: float, named: str
) -> None:
    arbiter = Arbiter(Settings(auto_acknowledge_stop=True, standstill_time=0.1), FIRST_ORDER)
    arbiter.connected(0.0)
    arbiter.speed(speed, 0.1)
    assert arbiter.awaited is None
    order = arbiter.heard(FLAG, 0.1).verdict.order
    refusal = arbiter.acknowledge(FLAG, order, 0.2).refusal
    assert arbiter.awaited == (FLAG, refusal)
    assert named in refusal
    assert 'standstill_speed' in refusal
    arbiter.speed(0.0, 0.3)
    assert arbiter.awaited == (FLAG, '')
    assert arbiter.speed(0.0, 0.4).verdict.acknowledged
    assert arbiter.awaited is None


# Binary fractions, so that arbiter and oracle round alike.
WAITS = st.integers(0, 40).map(lambda ticks: ticks / 64) | st.just(0.0)
COMMANDED = 'what is commanded'
TICK_AT_THE_DEADLINE = [('tick', None)]
COME_TO_RACE: list[tuple[str, Any]] = [
    *(('team_stop', (source, False)) for source in StopSource),
    ('team_heard', None),
    ('connected', None),
    ('heard', GRID),
    ('speed', 0.0),
    ('acknowledge', (GRID, 'present')),
    ('heard', GREEN),
]


def inputs(kind: str, *values: st.SearchStrategy[Any]) -> st.SearchStrategy[list[tuple[str, Any]]]:
    """Return the strategy of one input of a kind."""
    value = st.tuples(*values) if len(values) > 1 else values[0] if values else st.none()
    return st.tuples(st.just(kind), value).map(lambda each: [each])


NAMED = st.sampled_from(['present', 'present', 'earlier', 'first', 'none'])
STEPS = st.one_of(
    inputs('tick'),
    st.just(TICK_AT_THE_DEADLINE),
    inputs('connected'),
    inputs('disconnected'),
    inputs('team_heard'),
    inputs('heard', st.sampled_from(RaceState)),
    inputs('acknowledge', st.sampled_from(RaceState), NAMED),
    inputs('acknowledge', st.just(COMMANDED), st.just('present')),
    inputs('acknowledge', st.just(COMMANDED), st.sampled_from(['earlier', 'first', 'none'])),
    inputs('team_stop', st.sampled_from(StopSource), st.booleans()),
    inputs('speed', st.sampled_from([0.0, 0.04, 0.06, 5.0, math.nan, math.inf])),
    st.just(COME_TO_RACE),
)


@hypothesis_settings(max_examples=150)
@given(
    st.builds(
        Settings,
        frame_timeout=st.sampled_from([0.25, 1.0]),
        tsr_timeout=st.sampled_from([0.0, 0.0, 0.375]),
        msr_timeout=st.sampled_from([0.0, 0.0, 0.25]),
        team_timeout=st.sampled_from([0.0, 0.0, 0.375]),
        odometry_required=st.booleans(),
        auto_acknowledge_stop=st.booleans(),
        standstill_time=st.sampled_from([0.0, 0.5]),
        red_flag_drive_time=st.sampled_from([0.0, 1.0, 15.0]),
        drive_in_garage=st.booleans(),
    ),
    st.lists(st.tuples(WAITS, STEPS), min_size=30, max_size=50),
)
def test_random_histories_with_times_that_fit_no_grid_keep_the_rules(
    settings: Settings, steps: list[tuple[float, list[tuple[str, Any]]]]
) -> None:
    arbiter, now = Arbiter(settings, FIRST_ORDER), 0.0
    oracle = Oracle((), settings)
    check(oracle, oracle, arbiter.verdict)
    for wait, step in steps:
        before, deadline = (arbiter.verdict, fingerprint(arbiter)), arbiter.deadline
        # Else it follows itself 50 times: 600 inputs, and the oracle's work is their square.
        if step is COME_TO_RACE and arbiter.verdict.may_drive:
            continue
        if step is TICK_AT_THE_DEADLINE:
            if deadline is None:
                continue
            assert deadline > now
            wait = deadline - now
        now += wait
        for kind, value in step:
            if kind == 'acknowledge' and value[0] == COMMANDED:
                value = arbiter.verdict.commanded or RED, value[1]
            earlier = oracle
            note, verdict = apply(arbiter, kind, value, now)
            oracle = Oracle((*earlier.history, note), settings, earlier)
            check(oracle, earlier, verdict)
        if step is TICK_AT_THE_DEADLINE:
            assert before != (arbiter.verdict, fingerprint(arbiter))
            assert arbiter.deadline is None or arbiter.deadline > now
        assert step is not COME_TO_RACE or arbiter.verdict.may_drive


def test_a_clock_that_goes_back_ends_the_connection_and_all_that_was_heard_is_too_old() -> None:
    settings = Settings(tsr_timeout=1.0, odometry_required=True)
    arbiter = Arbiter(settings, FIRST_ORDER)
    arbiter.connected(10.0)
    arbiter.heard(RED, 10.0)
    arbiter.speed(0.0, 10.0)
    assert not arbiter.team_stop(StopSource.TSR, False, 10.0).verdict.team_stop
    earlier = arbiter.tick(9.0)
    assert earlier.give_up is not None
    assert (earlier.verdict.commanded, earlier.verdict.team_stop) == (None, True)
    arbiter.connected(9.0)
    order = arbiter.heard(RED, 9.0).verdict.order
    assert arbiter.acknowledge(RED, order, 9.0).refusal


def test_silence_counts_from_when_a_frame_that_is_obeyed_had_not_arrived_yet() -> None:
    arbiter = Arbiter(Settings(), FIRST_ORDER)
    arbiter.connected(0.0)
    arbiter.heard(RaceState.IN_GARAGE, 0.0)
    for since, deadline in ((-1.0, 1.0), (0.25, 1.25)):
        assert arbiter.heard(RED, 0.9, since).verdict.commanded is RED
        assert arbiter.deadline == deadline
    assert arbiter.heard(RED, 1.25).give_up is not None
