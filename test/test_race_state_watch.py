# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What a team's stack makes of the bridge's topic; the bridge is a bare publisher of the test.

Both watches are tried: the one in Python, and, where rclcpp is there, the one in C++.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import dataclasses
import os
import queue
import random
import subprocess
import threading
import time
from types import SimpleNamespace
from typing import Any, TypeVar

from evgp_kart_bridge.orders import Order
from evgp_kart_bridge.watch import race_state_qos, RaceStateWatch
from evgp_node.states import state_message, state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs.msg import KartRaceState
from evgp_rcs_msgs.srv import Acknowledge
from evgp_testing.part import Part, PATIENCE
from evgp_testing.process import executable
from evgp_testing.ros_side import RosSide
import pytest
from rcl_interfaces.msg import Log
from rig.needs import CPP, need_package

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
RED_RED = RaceState.RED_RED
LEASE, LONGEST_LEASE = 0.5, 2.0
STATES = {state_message(state).state: state for state in RaceState}

T = TypeVar('T')


class Stack(Part):
    """A team's node with a watch; ``told`` is every state it was told, ``turns`` counts turns."""

    watch: Any

    def __init__(self) -> None:
        self.told: list[RaceState] = []
        self.turns = 0

    @property
    def heard(self) -> RaceState | None:
        """Return the state of the last message."""
        raise NotImplementedError

    def busy_in(self, state: RaceState) -> contextlib.AbstractContextManager[None]:
        """Keep its executor busy, from when it is told this state."""
        raise NotImplementedError

    def wait_until(self, found: Callable[[], T | None], what: object) -> T:
        """Poll, as of a message that changes no state nobody is told, and nobody in C++."""
        until = time.monotonic() + PATIENCE
        while not (value := found()):
            now = f'it was told {self.told}, {self.watch.reason}'
            assert time.monotonic() < until, f'not within {PATIENCE:g} s: {what}; {now}'
            time.sleep(0.02)
        return value

    def wait_for_state(self, state: RaceState) -> None:
        self.wait_until(lambda: self.told[-1:] == [state], state)

    def wait_for_message(self, state: RaceState) -> None:
        self.wait_until(lambda: self.heard is state, f'a message {state}')

    def wait_for_reason(self, reason: str) -> None:
        self.wait_until(lambda: self.watch.reason == reason, reason)


class StackInPython(Stack):
    """:param turn: how long each turn of its executor is busy, seconds."""

    def __init__(self, domain: int, name: str, lease: float = LEASE, turn: float = 0.0) -> None:
        super().__init__()
        self._side = RosSide(name, domain)
        self._busy = threading.Lock()
        self._busy_at: RaceState | None = None
        self.watch = RaceStateWatch(self._side.node, self._tell, lease=lease)
        if turn:
            self._side.node.create_timer(0.01, lambda: self._turn(turn))
        self._side.spin()

    @property
    def heard(self) -> RaceState | None:
        return state_of(self.watch.message.state) if self.watch.message else None

    @contextlib.contextmanager
    def busy_in(self, state: RaceState) -> Iterator[None]:
        with self._busy:
            self._busy_at = state
            yield
            self._busy_at = None

    def close(self) -> None:
        self._side.close()

    def _turn(self, turn: float) -> None:
        self.turns += 1
        time.sleep(turn)

    def _tell(self, state: RaceState) -> None:
        self.told.append(state)
        if state is self._busy_at:
            with self._busy:
                pass


class StackInCpp(Stack):
    """The same with a node in C++, in a process of its own; it is its own ``watch``, too."""

    node = 'node'

    def __init__(self, domain: int, name: str, lease: float = LEASE, turn: float = 0.0) -> None:
        super().__init__()
        self.watch = self
        self._looks: queue.Queue[list[str]] = queue.Queue()
        self._orders: dict[int, Order] = {}
        self._probe = subprocess.Popen(
            [executable(CPP, 'watch_probe'), self.node, name, str(lease), str(turn)],
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        self._look()  # it runs

    @property
    def state(self) -> RaceState:
        return self.order.state

    @property
    def reason(self) -> str:
        return self._look()[5]

    @property
    def heard(self) -> RaceState | None:
        return STATES.get(int(self._look()[4]))

    @property
    def order(self) -> Order:
        """Return the order: for the same serial the same object."""
        serial, state, number, reached = map(int, self._look()[:4])
        order = Order(STATES[state], number, STATES.get(reached))
        kept = self._orders.setdefault(serial, order)
        assert dataclasses.astuple(kept) == dataclasses.astuple(order)
        return kept

    def acknowledge(self, order: Order) -> None:
        (serial,) = (serial for serial, each in self._orders.items() if each is order)
        self._tell(f'acknowledge {serial}')

    @contextlib.contextmanager
    def busy_in(self, state: RaceState) -> Iterator[None]:
        self._tell(f'busy_in {state_message(state).state}')
        yield
        self._tell('busy_in -1')

    def close(self) -> None:
        assert self._probe.stdin is not None
        assert self._probe.stdout is not None
        self._probe.stdin.close()
        self._reader.join()
        self._probe.stdout.close()
        assert self._probe.wait(PATIENCE) == 0

    def _tell(self, line: str) -> None:
        assert self._probe.stdin is not None
        self._probe.stdin.write(f'{line}\n')
        self._probe.stdin.flush()

    def _look(self) -> list[str]:
        self._tell('look 0')
        return self._looks.get(timeout=PATIENCE)

    def _read(self) -> None:
        assert self._probe.stdout is not None
        for line in self._probe.stdout:
            kind, *words = line.rstrip('\n').split(' ', 6)
            if kind == 'look':
                self._looks.put(words)
            elif kind == 'turn':
                self.turns += 1
            else:
                self.told.append(STATES[int(words[0])])


class StackInCppWithLifecycle(StackInCpp):
    """The same with a LifecycleNode, which nobody configures."""

    node = 'lifecycle_node'


StartStack = Callable[..., Stack]
StartBare = Callable[..., 'BareBridge']


class BareBridge(RosSide):
    """
    A publisher in the bridge's place, which says one state again and again.

    ``asked`` are the numbers and states that it was asked to acknowledge; it accepts them if
    ``accepts``.
    """

    def __init__(self, domain: int, name: str, says: RaceState, keeps: int = 1) -> None:
        super().__init__(name, domain)
        self._identity = random.getrandbits(53)
        self.say(says)
        qos = race_state_qos(LEASE)
        qos.depth = keeps
        self._publisher = self.node.create_publisher(KartRaceState, '/kart_bridge/race_state', qos)
        self._timer = self.node.create_timer(0.05, self._say)
        self.asked: list[tuple[int, RaceState | None]] = []
        self.accepts = True
        self.spin()

    def say(self, state: RaceState, order: int = 0) -> None:
        """Say a state from now on: with an order, one that race control commands."""
        said = state_message(state)
        self.message = KartRaceState(bridge=self._identity, state=said, order=order)
        if order:
            self.message.commanded = self.message.reached = said

    def answer(self) -> None:
        self.node.create_service(Acknowledge, '/kart_bridge/acknowledge', self._answer)

    def _answer(
        self, request: Acknowledge.Request, response: Acknowledge.Response
    ) -> Acknowledge.Response:
        self.asked.append((request.order, state_of(request.reached)))
        response.success = self.accepts
        response.message = 'the test says so'
        return response

    def fall_silent(self) -> None:
        self._timer.cancel()

    def _say(self) -> None:
        self._publisher.publish(self.message)
        self.said_at = time.monotonic()


KINDS = {'Python': StackInPython, 'C++': StackInCpp, 'LifecycleNode': StackInCppWithLifecycle}


@pytest.fixture(params=KINDS.values(), ids=KINDS.keys())
def start_stack(
    request: pytest.FixtureRequest, parts: contextlib.ExitStack, domain: int
) -> StartStack:
    """Return a function that starts a stack, with the one watch or the other."""
    if request.param is not StackInPython:
        need_package(CPP)

    def start(name: str, **options: float) -> Stack:
        stack: Stack = parts.enter_context(request.param(domain, name, **options))
        return stack

    return start


@pytest.fixture
def stack(start_stack: StartStack) -> Stack:
    return start_stack('stack')


@pytest.fixture
def idle_stack(start_stack: StartStack) -> Stack:
    """Return a second stack, which shows what happens while the first is busy."""
    return start_stack('idle_stack')


@pytest.fixture
def start_bare(parts: contextlib.ExitStack, domain: int) -> StartBare:
    """Return a function that starts a publisher in the bridge's place."""

    def start(
        name: str = 'kart_bridge', says: RaceState = GRID_ACTIVE, keeps: int = 1
    ) -> BareBridge:
        return parts.enter_context(BareBridge(domain, name, says, keeps))

    return start


def start_green(start_bare: StartBare, *stacks: Stack) -> BareBridge:
    """Start a bridge, and have it say GREEN_GREEN once all have heard GRID_ACTIVE."""
    bridge = start_bare()
    for stack in stacks:
        stack.wait_for_state(GRID_ACTIVE)
    bridge.say(GREEN_GREEN)
    for stack in stacks:
        stack.wait_for_state(GREEN_GREEN)
    return bridge


def test_what_was_said_before_the_lease_is_not_obeyed_after_it_nor_by_a_busy_stack(
    stack: Stack, idle_stack: Stack, start_bare: StartBare
) -> None:
    with stack.busy_in(GRID_ACTIVE):
        bridge = start_bare()
        stack.wait_for_state(GRID_ACTIVE)  # and from now on its executor is busy
        idle_stack.wait_for_state(GRID_ACTIVE)
        bridge.say(GREEN_GREEN)
        idle_stack.wait_for_state(GREEN_GREEN)
        bridge.fall_silent()
        # Not by the idle stack's RED_RED alone, which a busy machine can bring about before.
        idle_stack.wait_until(lambda: time.monotonic() - bridge.said_at > LEASE, 'silence')
        idle_stack.wait_for_state(RED_RED)
        stack.wait_until(lambda: stack.watch.state is RED_RED, 'RED_RED')
    stack.wait_for_message(GREEN_GREEN)
    assert GREEN_GREEN not in stack.told


def test_a_stop_is_told_before_it_is_logged_and_a_message_is_as_old_as_the_turn_before_it(
    domain: int,
) -> None:
    told: list[object] = []
    with RosSide('stack', domain) as side:  # it does not spin: these are its turns
        watch: Any = RaceStateWatch(side.node, told.append, lease=LEASE)
        watch._log = SimpleNamespace(warning=told.append, info=told.append)
        watch._pass()
        watch._pass()
        watch._hear(KartRaceState(bridge=1, state=state_message(GRID_ACTIVE)))
        time.sleep(LEASE)  # that time passes is itself what is awaited
        watch._pass()  # in the same turn as the callback that was busy
        watch._hear(KartRaceState(bridge=1, state=state_message(GREEN_GREEN)))
        assert watch.state is RED_RED
    assert told[:3] == [RED_RED, GRID_ACTIVE, RED_RED]
    assert 'silent' in str(told[3])


def test_a_red_that_is_overtaken_while_the_stack_is_busy_is_heard(
    stack: Stack, idle_stack: Stack, start_bare: StartBare
) -> None:
    with stack.busy_in(GREEN_GREEN):
        bridge = start_green(start_bare, stack, idle_stack)  # and from now on it is busy
        bridge.say(RED_RED)
        idle_stack.wait_for_state(RED_RED)
        bridge.say(GREEN_GREEN)
        idle_stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert stack.watch.state is RED_RED


def test_what_a_bridge_said_before_a_stack_began_does_not_start_it(
    idle_stack: Stack, start_bare: StartBare, start_stack: StartStack
) -> None:
    bridge = start_bare(keeps=1000)  # and so all that it has said, to who asks for it
    idle_stack.wait_for_state(GRID_ACTIVE)
    bridge.say(GREEN_GREEN)
    idle_stack.wait_for_state(GREEN_GREEN)
    late = start_stack('late')
    # It may take Fast DDS a while to get over what such a stack did not ask for; the bridge keeps
    # one message only.
    late.wait_for_message(GREEN_GREEN)
    assert late.told == [RED_RED]


def test_a_stack_whose_turns_are_slow_is_not_behind(
    start_stack: StartStack, start_bare: StartBare
) -> None:
    slow = start_stack('slow', lease=LONGEST_LEASE, turn=0.3)  # six messages are said meanwhile
    prompt = start_stack('prompt', lease=LONGEST_LEASE)
    bridge = start_green(start_bare, slow, prompt)
    while_green = slow.turns + 12
    slow.wait_until(lambda: slow.turns > while_green, 'turns in GREEN_GREEN')
    bridge.say(RED_RED)
    prompt.wait_for_state(RED_RED)
    before = slow.turns
    slow.wait_for_state(RED_RED)
    # Had it taken one message in each turn, dozens would still be before this one.
    assert slow.turns - before < 6
    assert slow.watch.reason == ''


def test_a_grid_active_of_a_second_bridge_starts_no_kart(
    stack: Stack, start_bare: StartBare
) -> None:
    start_bare(says=GREEN_GREEN)
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    second = start_bare('second')
    stack.wait_for_message(GRID_ACTIVE)
    stack.wait_for_reason('2 bridges are running; there must be one')
    second.close()
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert GREEN_GREEN not in stack.told


# ----- orders and their acknowledgement ----------------------------------------------------


def wait_for_order(stack: Stack, number: int) -> Order:
    """Return the order of this number once the stack has been told of its state too."""

    def found() -> Order | None:
        order = stack.watch.order
        told = stack.told[-1:] == [order.state]
        return order if order.number == number and told else None

    return stack.wait_until(found, f'order {number}')


def acknowledge_until(stack: Stack, order: Order, done: Callable[[], object]) -> None:
    """Acknowledge an order step by step, as a stack does: on a busy machine it may begin anew."""

    def step() -> object:
        present = stack.watch.order
        stack.watch.acknowledge(present if present.number == order.number else order)
        return done()

    stack.wait_until(step, f'acknowledged {order}')


def test_an_acknowledgement_that_is_lost_or_refused_is_sent_again_unless_its_order_is_over(
    stack: Stack, start_bare: StartBare
) -> None:
    bridge = start_bare(says=RED_RED)
    bridge.say(RED_RED, 7)
    first = wait_for_order(stack, 7)
    stack.watch.acknowledge(first)  # to nobody
    bridge.accepts = False
    bridge.answer()
    acknowledge_until(stack, first, lambda: len(bridge.asked) >= 3)
    for number, state in ((8, GRID_ACTIVE), (9, RED_RED)):
        bridge.say(state, number)
        order = wait_for_order(stack, number)
        stack.watch.acknowledge(first)
        acknowledge_until(stack, order, lambda asks=(number, state): asks in bridge.asked)
    assert bridge.asked == sorted(bridge.asked, key=lambda asks: asks[0])


def test_what_a_bridge_says_anew_again_and_again_does_not_flood_the_log(
    stack: Stack, start_bare: StartBare
) -> None:
    bridge = start_bare(says=RED_RED)
    bridge.accepts = False
    bridge.answer()
    heard = bridge.hear(Log, '/rosout', 1000)

    def logged() -> list[str]:
        return [each.msg for each in heard if each.name == 'stack']

    for number in range(40):
        bridge.message.reason = f'reason {number}'
        stack.wait_for_reason(bridge.message.reason)
    bridge.say(RED_RED, 7)
    refusal = 'RED_RED cannot be acknowledged: the test says so'
    acknowledge_until(stack, wait_for_order(stack, 7), lambda: refusal in logged())
    assert 0 < sum('reason' in each for each in logged()) <= 20
