# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The rules of the stack's watch: `orders.py` and ``orders.hpp`` give the same answers.

They do to the stories of a table, which says what follows, and to random histories. A fault in
either must show.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import pathlib
import shutil
import subprocess
from typing import Any, NamedTuple

from evgp_kart_bridge import orders
from evgp_kart_bridge.watch import RaceStateWatch
from evgp_node.states import state_message, state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs.msg import RaceState as RaceStateMessage
from evgp_testing.part import Part
from hypothesis import example, given, HealthCheck, Phase, settings
from hypothesis import strategies as st
import pytest
from rig.faults import faults_in, module_with

PACKAGE = pathlib.Path(__file__).parents[1] / 'src/evgp_race_watch_cpp'
HEADER = 'evgp_race_watch_cpp/orders.hpp'
WARNINGS = ('-Wall', '-Wextra', '-Wpedantic', '-Werror', '-Wconversion', '-Wshadow')
FLAGS = ('-std=c++17', '-pthread', *WARNINGS)
COMPILERS = [each for each in ('g++', 'clang++') if shutil.which(each)]
LEASE = 0.5
NO_NODE: Any = None

# Orders, bridges and times are few, so that they come back and meet their limits.
STATES = st.sampled_from(
    [state_message(each).state for each in RaceState]
    + [RaceStateMessage.GREEN_GREEN, RaceStateMessage.GRID_ACTIVE, RaceStateMessage.UNKNOWN, 99]
)
SAID = st.tuples(
    st.sampled_from([1, 1, 1, 2]), STATES, STATES, st.sampled_from([0, 7, 8]), st.booleans()
)
GRID, GREEN = (1, 2, 2, 7, False), (1, 3, 3, 8, False)
HEARD = st.one_of(
    st.lists(SAID, min_size=1, max_size=3), st.sampled_from([[GRID], [GREEN], [GRID, GREEN]])
)
OTHERS_GRID, OTHERS_GREEN, RED = (2, *GRID[1:]), (2, *GREEN[1:]), (1, 5, 5, 7, False)

Step = tuple[Any, ...]


def hear(*said: tuple[Any, ...], after: float = 0.0, age: float = 0.0) -> Step:
    return 'hear', after, [*said], age


OBEYED = 'of bridge 1'
SILENT = 'the bridge is silent, or this node was too busy to hear it'
RACE = [hear(GRID), hear(GREEN)]
NONE, ONE, TWO = (('bridges', 0.0, alive) for alive in range(3))
ASK = ('ask', 0.0, 0)


class Story(NamedTuple):
    """What happens to a watch; then the state, why, and whether the last step asks the bridge."""

    steps: list[Step]
    state: str
    reason: str
    asks: bool = False


NEVER, LATE = orders.NEVER_HEARD, orders.TOO_LATE
STORIES = {
    'nothing is heard': Story([('look', 0.0)], 'RED_RED', 'the bridge has not been heard yet'),
    'a race': Story(RACE, 'GREEN_GREEN', OBEYED),
    'no grid': Story([hear(GREEN)], 'RED_RED', NEVER),
    'a red after the grid': Story([hear(GRID), hear(RED, GREEN)], 'RED_RED', NEVER),
    'no race state': Story(
        [hear((1, 99, 0, 7, False))], 'RED_RED', 'the bridge publishes an unknown race state'
    ),
    # Silence.
    'the lease': Story([*RACE, ('look', 0.5)], 'GREEN_GREEN', OBEYED),
    'more than the lease': Story([*RACE, ('look', 0.5625)], 'RED_RED', SILENT),
    'a message that may be old': Story([hear(GRID), hear(GREEN, age=0.5625)], 'RED_RED', SILENT),
    'a doubt that is forgiven': Story([*RACE, hear(GREEN, after=1.0)], 'GREEN_GREEN', OBEYED),
    'a longer doubt': Story([*RACE, hear(GREEN, after=1.0625)], 'RED_RED', LATE),
    'a doubt that ends just before it is forgiven no more': Story(
        [hear(GRID), NONE, hear(GREEN, after=0.75), ONE, ('look', 0.3125)], 'RED_RED', LATE
    ),
    # More than one bridge.
    'two': Story([*RACE, TWO], 'RED_RED', '2 bridges are running; there must be one'),
    'one of two has left': Story([*RACE, TWO, ONE], 'RED_RED', NEVER),
    'the grid of another': Story([hear(GRID), hear(OTHERS_GREEN)], 'RED_RED', NEVER),
    'a grid while there are two': Story(
        [hear(GRID), TWO, hear(OTHERS_GRID), ONE, hear(OTHERS_GREEN)], 'RED_RED', LATE
    ),
    # Whether to acknowledge.
    'an order': Story([hear(RED), ASK], 'RED_RED', OBEYED, True),
    'an order without a number': Story([hear((1, 5, 0, 0, False)), ASK], 'RED_RED', OBEYED),
    'a kart that stands in a flag': Story(
        [hear((1, 5, 4, 7, False)), ASK], 'RED_RED', OBEYED, True
    ),
    'a state that is looser than what is to be said': Story(
        [hear((1, 4, 5, 7, False)), ASK], 'RED_FLAG', OBEYED
    ),
    'asked a moment ago': Story([hear(RED), ASK, ('ask', 0.125, 0)], 'RED_RED', OBEYED),
    'asked, and not heard': Story([hear(RED), ASK, ('ask', 0.25, 0)], 'RED_RED', OBEYED, True),
    'asked, and heard': Story(
        [hear(RED), ASK, hear((1, 5, 5, 7, True), after=0.25), ASK], 'RED_RED', OBEYED
    ),
    'an order that is over, though its state is commanded again': Story(
        [hear(RED), hear(GREEN), hear((1, 5, 5, 9, False)), ('ask', 0.0, 2)], 'RED_RED', OBEYED
    ),
    # It is the third that the watch has given; if it were the second, that one would be asked for.
    'an order that follows a silence': Story(
        [hear(RED), hear(RED, after=0.5625), ('ask', 0.0, 2)], 'RED_RED', OBEYED
    ),
}

PASSES = st.sampled_from([0.0, 0.0, 0.0, 0.0625, 0.0625, 0.125, 0.25, 0.5, 0.5625, 1.0625])
STEP = st.one_of(
    st.tuples(st.just('hear'), PASSES, HEARD, st.sampled_from([0.0, 0.0, 0.0, 0.125, 0.5, 0.75])),
    st.tuples(st.just('bridges'), PASSES, st.sampled_from([0, 1, 1, 2])),
    st.tuples(st.just('look'), PASSES),
    st.tuples(st.just('ask'), PASSES, st.sampled_from([0, 0, 1, 2])),  # from the newest back
    st.tuples(st.just('ask_with_anothers'), PASSES),
)


class InPython:
    """The rules in Python; `step` answers as the probe does."""

    def __init__(self, rules: Any = orders) -> None:
        self._rules = rules
        self.begin()

    def begin(self) -> None:
        # Of two watches, which hear the same.
        self._orders, self._others = (self._rules.Orders(LEASE) for _ in range(2))
        self._seen: list[orders.Order] = []
        self._answer(RaceState.RED_RED, 0.0, False)

    def step(self, kind: str, now: float, *given: Any) -> str:
        asks = False
        glanced = self._orders.judge(now)[0]  # before anybody notices that time has passed
        if kind == 'hear':
            heard, age = given
            for each in (self._orders, self._others):
                each.hear([self._said(*said) for said in heard], now - age, now)
        elif kind == 'bridges':
            for each in (self._orders, self._others):
                each.count_bridges(*given)
        elif kind == 'look':
            for each in (self._orders, self._others):
                each.look(now)
        elif kind == 'ask_with_anothers':
            asks = self._orders.asks(self._others.order(now), now)
        else:
            asks = self._orders.asks(self._seen[-1 - given[0] % len(self._seen)], now)
        return self._answer(glanced, now, asks)

    def _said(self, bridge: int, state: int, reached: int, order: int, done: bool) -> orders.Said:
        states = [state_of(RaceStateMessage(state=each)) for each in (state, reached)]
        said: orders.Said = self._rules.Said(bridge, *states, order, done, f'of bridge {bridge}')
        return said

    def _answer(self, glanced: RaceState, now: float, asks: bool) -> str:
        order = self._orders.order(now)
        if order not in self._seen:
            self._seen.append(order)
        reached = order.reached.value if order.reached else 'UNKNOWN'
        words = (glanced.value, self._seen.index(order), order.state.value, order.number, reached)
        return ' '.join(map(str, (*words, int(asks), self._orders.judge(now)[1])))


class InCpp(Part):
    """The rules in C++, in a process of their own."""

    def __init__(self, program: pathlib.Path) -> None:
        self._probe = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def begin(self) -> None:
        self._tell('begin 0')

    def step(self, kind: str, now: float, *given: Any) -> str:
        words = [kind, now, *given]
        if kind == 'hear':
            heard, age = given
            words[2:] = [now - age, len(heard), *(int(word) for each in heard for word in each)]
        return self._tell(' '.join(map(str, words)))

    def close(self) -> None:
        self._probe.communicate()

    def _tell(self, line: str) -> str:
        assert self._probe.stdin is not None
        assert self._probe.stdout is not None
        self._probe.stdin.write(f'{line}\n')
        self._probe.stdin.flush()
        return self._probe.stdout.readline().rstrip('\n')


def compare(one: InPython, other: InCpp, examples: int, *, shrink: bool = True) -> None:
    """Give both the same histories; a difference is an AssertionError."""

    @settings(
        max_examples=examples,
        database=None,
        report_multiple_bugs=False,
        phases=[Phase.explicit, Phase.generate, *([Phase.shrink] if shrink else [])],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.lists(STEP, min_size=10, max_size=40))
    def same(steps: Sequence[tuple[Any, ...]]) -> None:
        one.begin()
        other.begin()
        now = 10.0
        for kind, passes, *words in steps:
            now += passes
            assert other.step(kind, now, *words) == one.step(kind, now, *words)

    for story in STORIES.values():  # of which chance finds some too seldom
        same = example(story.steps)(same)
    same()


Compile = Callable[..., pathlib.Path]


@pytest.fixture(scope='module')
def compile_probe(tmp_path_factory: pytest.TempPathFactory) -> Compile:
    """Return a function that compiles a probe with a header's text, without a warning."""

    def compile_it(
        text: str, compiler: str = COMPILERS[0], probe: str = 'orders_probe.cpp'
    ) -> pathlib.Path:
        folder = tmp_path_factory.mktemp('rules')
        header, program = folder / HEADER, folder / 'probe'
        header.parent.mkdir()
        header.write_text(text)
        command = [compiler, *FLAGS, '-I', folder, PACKAGE / 'test' / probe, '-o', program]
        subprocess.run(command, check=True)
        return program

    return compile_it


IN_CPP = (PACKAGE / 'include' / HEADER).read_text()


def check_stories(rules: InPython) -> None:
    for name, story in STORIES.items():
        rules.begin()
        now = 10.0
        for kind, passes, *words in story.steps:
            now += passes
            answer = rules.step(kind, now, *words)
        *_, obeyed, _, _, asked, why = answer.split(' ', 6)
        assert (obeyed, why, asked == '1') == story[1:], (name, answer)


def test_what_a_stack_must_do_in_each_story() -> None:
    check_stories(InPython())


@pytest.mark.parametrize('compiler', COMPILERS)
def test_the_rules_in_cpp_are_those_in_python_and_neither_takes_a_lease_that_is_too_long(
    compile_probe: Compile, compiler: str
) -> None:
    with InCpp(compile_probe(IN_CPP, compiler)) as rules:
        compare(InPython(), rules, 200)
        for lease in (0.5, 2.0, 2.1, 6.0, 0.0, -1.0):
            right = lease in (0.5, 2.0)
            refused = rules.step('lease', lease).split()[5]
            assert refused == str(int(not right)), lease
            with pytest.raises(AttributeError if right else ValueError):
                RaceStateWatch(NO_NODE, lease=lease)


WHOLE = '0 torn, 0 over, 0 allocated\n'


def read_in_three_threads(compile_probe: Compile, text: str) -> str:
    program = compile_probe(text, probe='glance_probe.cpp')
    return subprocess.run([program], stdout=subprocess.PIPE, text=True, check=True).stdout


def test_an_order_is_read_whole_beside_its_writer_without_memory_and_none_that_is_over(
    compile_probe: Compile,
) -> None:
    assert read_in_three_threads(compile_probe, IN_CPP) == WHOLE


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.parametrize(
    'fault',
    [
        ('slots_[(turn_ + 1) %', 'slots_[turn_ %'),
        ('      settle(now);\n    }', '      order(now);\n    }'),
    ],
    ids=str,
)
def test_a_fault_in_the_reading_of_orders_is_found(
    compile_probe: Compile, fault: tuple[str, str]
) -> None:
    assert read_in_three_threads(compile_probe, faulty(IN_CPP, fault)) != WHOLE


FAULTS_IN_CPP = [
    ('now - heard_at_ > lease_', 'now - heard_at_ > 2 * lease_'),
    ('now - heard_at_ > lease_', 'now - heard_at_ >= lease_'),
    ('heard_at_ = since;', 'heard_at_ = since + 0.125;'),
    ('*bridges_alive_ == 1', '*bridges_alive_ >= 1'),
    ('RaceState::GREEN_GREEN && !is_armed(now)', 'RaceState::UNKNOWN'),
    ('settle(now);  // a doubt', '// a doubt'),
    ('      follow(now);\n      settle(now);', '      follow(now);'),
    ('forgives = now - sure_at_ <= FORGIVEN && is_alone()', 'forgives = true'),
    ('if (alive > 1)', 'if (alive > 2)'),
    ('done != present || ', ''),
    ('++watches_ << 40 | 1', '1'),
    ('now > slot.ends_at', 'now > slot.ends_at + 0.125'),
    ('starts ? sure_at_ + FORGIVEN', 'starts ? endless'),
    ('(order.serial | 1) +', 'order.serial + 1 +'),
    (' || said_->acknowledged', ''),
    ('now < ask_again_at_', 'false'),
    ('state == RaceState::RED_RED && reached == RaceState::RED_FLAG', 'false'),
    ('reached == RaceState::RED_FLAG);', 'reached != RaceState::UNKNOWN);'),
]

FAULTS_IN_PYTHON = faults_in(
    """
silence is noticed late: doubt: _lease => it + 0.1
what came late is fresh: hear: instead of _heard_at: self._heard_at = now
two bridges are no doubt: doubt: ( => (None, 1, 2)
GREEN_GREEN needs no grid: judge: _is_armed GREEN_GREEN => state is None
a grid in doubt arms: _follow: bridge forgiven => said.bridge
what is over is not looked at before it is heard anew: hear: skips order #1
a second bridge is not counted: count_bridges: 1 => 2
what was done for an order of old is said: asks: without order not
it asks again at once: asks: never _ask_again_at
a red says that the other one is reached: _includes: state or => it or both_red
the grid of another bridge arms: _is_armed: said _armed_by => self._armed_by is None
"""
)


def faulty(text: str, fault: tuple[str, str]) -> str:
    assert text.count(fault[0]) == 1
    return text.replace(*fault)


def test_every_fault_in_cpp_has_one_place() -> None:
    for fault in FAULTS_IN_CPP:
        faulty(IN_CPP, fault)


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.parametrize('fault', FAULTS_IN_CPP, ids=str)
def test_a_fault_in_cpp_is_found(compile_probe: Compile, fault: tuple[str, str]) -> None:
    with InCpp(compile_probe(faulty(IN_CPP, fault))) as rules, pytest.raises(AssertionError):
        compare(InPython(), rules, 10_000, shrink=False)


@pytest.mark.parametrize('name', FAULTS_IN_PYTHON)
def test_a_fault_in_python_is_found(name: str) -> None:
    module = module_with(orders, FAULTS_IN_PYTHON[name])
    with pytest.raises(AssertionError):
        check_stories(InPython(module))
