# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What a team's stack makes of the bridge's topic; the bridge is a bare publisher of the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import random
import threading
import time

from evgp_kart_bridge import watch
from evgp_kart_bridge.watch import race_state_qos, RaceStateWatch
from evgp_node.states import state_message, state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs.msg import KartRaceState
from evgp_rcs_msgs.msg import RaceState as RaceStateMessage
from evgp_rcs_msgs.srv import Acknowledge
from evgp_testing.domains import Domain
from evgp_testing.ros_side import RosSide
import pytest

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
RED_RED = RaceState.RED_RED
LEASE = 0.5
LONG = 60.0  # however slow this machine is


class Stack(RosSide):
    """A team's node with a watch; ``told`` is every state it was told."""

    def __init__(self, domain: int, name: str, lease: float = LEASE) -> None:
        super().__init__(name, domain)
        self.told: list[RaceState] = []
        self.busy = threading.Lock()
        self.busy_at: RaceState | None = None
        self.watch = RaceStateWatch(self.node, self._tell, lease=lease)
        # A message that changes no state is told to nobody: look for it now and then.
        self.node.create_timer(0.02, self._wake)
        self.spin()

    def wait_for_state(self, state: RaceState) -> None:
        self.wait_until(
            lambda: bool(self.told) and self.told[-1] is state,
            lambda: f'{state}; it was told {self.told}',
        )

    def wait_for_message(self, state: RaceState) -> None:
        def found() -> bool:
            return self.watch.message is not None and state_of(self.watch.message.state) is state

        self.wait_until(found, lambda: f'a message {state}; it was told {self.told}')

    def wait_for_reason(self, reason: str) -> None:
        self.wait_until(
            lambda: self.watch.reason == reason,
            lambda: f'{reason}; it was told {self.told}, {self.watch.reason}',
        )

    def _wake(self) -> None:
        with self.news:
            self.news.notify_all()

    def _tell(self, state: RaceState) -> None:
        with self.news:
            self.told.append(state)
            self.news.notify_all()
        if state is self.busy_at:
            with self.busy:
                pass  # as a stack that keeps its executor busy


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

    def say(self, state: RaceState) -> None:
        self.message = KartRaceState(bridge=self._identity, state=state_message(state))

    def command(self, state: RaceState, order: int, obeyed: RaceState | None = None) -> None:
        """Say that race control commands a state, and that this or another is to be obeyed."""
        self.message = KartRaceState(
            bridge=self._identity,
            state=state_message(obeyed or state),
            commanded=state_message(state),
            order=order,
        )
        self._publisher.publish(self.message)

    def answer(self) -> None:
        """Offer the service, from now on."""
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

    def go_on(self) -> None:
        self._timer.reset()

    def _say(self) -> None:
        self._publisher.publish(self.message)


StartBare = Callable[..., BareBridge]


@pytest.fixture
def domain(parts: contextlib.ExitStack) -> Domain:
    return parts.enter_context(Domain())


@pytest.fixture
def stack(domain: Domain) -> Iterator[Stack]:
    stack = Stack(domain.number, 'stack')
    yield stack
    stack.close()


@pytest.fixture
def idle_stack(domain: Domain) -> Iterator[Stack]:
    """Return a second stack, which shows what happens while the first is busy."""
    stack = Stack(domain.number, 'idle_stack')
    yield stack
    stack.close()


@pytest.fixture
def start_bare(parts: contextlib.ExitStack, domain: Domain) -> StartBare:
    """Return a function that starts a publisher in the bridge's place."""

    def start(
        name: str = 'kart_bridge', says: RaceState = GRID_ACTIVE, keeps: int = 1
    ) -> BareBridge:
        return parts.enter_context(BareBridge(domain.number, name, says, keeps))

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


def test_a_stack_is_told_what_the_bridge_says(stack: Stack, start_bare: StartBare) -> None:
    bridge = start_green(start_bare, stack)
    bridge.say(RaceState.RED_FLAG)
    stack.wait_for_state(RaceState.RED_FLAG)
    stack.wait_for_reason('')


@pytest.mark.parametrize('how', ['falls silent', 'leaves', RaceStateMessage.UNKNOWN, 99])
def test_a_bridge_that_falls_silent_leaves_or_says_no_race_state_is_red_red(
    stack: Stack, start_bare: StartBare, how: str | int
) -> None:
    bridge = start_green(start_bare, stack)
    if how == 'falls silent':
        bridge.fall_silent()
    elif how == 'leaves':
        bridge.close()
    else:
        bridge.message = KartRaceState(state=RaceStateMessage(state=how))
    stack.wait_for_state(RED_RED)


def test_two_bridges_on_one_topic_are_red_red(stack: Stack, start_bare: StartBare) -> None:
    start_green(start_bare, stack)
    start_bare('second')
    stack.wait_for_state(RED_RED)


def test_a_busy_stack_that_asks_is_told_red_red_when_the_bridge_is_silent(
    stack: Stack, idle_stack: Stack, start_bare: StartBare
) -> None:
    stack.busy_at = GREEN_GREEN
    bridge = start_bare()
    stack.wait_for_state(GRID_ACTIVE)
    idle_stack.wait_for_state(GRID_ACTIVE)
    with stack.busy:
        bridge.say(GREEN_GREEN)
        stack.wait_for_state(GREEN_GREEN)  # and from now on its executor is busy
        idle_stack.wait_for_state(GREEN_GREEN)
        bridge.fall_silent()
        # Not at the same moment as an idle one, which may have heard the last word earlier.
        stack.wait_until_polled(lambda: stack.watch.state is RED_RED, 'RED_RED')


def test_what_was_said_before_the_lease_is_not_obeyed_after_it(
    stack: Stack, idle_stack: Stack, start_bare: StartBare
) -> None:
    stack.busy_at = GRID_ACTIVE
    bridge = start_bare()
    with stack.busy:
        stack.wait_for_state(GRID_ACTIVE)  # and from now on its executor is busy
        idle_stack.wait_for_state(GRID_ACTIVE)
        bridge.say(GREEN_GREEN)
        idle_stack.wait_for_state(GREEN_GREEN)
        bridge.fall_silent()
        time.sleep(LEASE)  # that time passes is itself what is awaited
    stack.wait_for_message(GREEN_GREEN)
    assert GREEN_GREEN not in stack.told


@pytest.mark.parametrize('before', [RaceState.IN_GARAGE, RaceState.RED_FLAG, RED_RED])
def test_a_red_or_the_garage_takes_the_start_away(
    stack: Stack, start_bare: StartBare, before: RaceState
) -> None:
    bridge = start_bare()
    stack.wait_for_state(GRID_ACTIVE)
    bridge.say(before)
    stack.wait_for_state(before)
    bridge.say(GREEN_GREEN)
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert stack.watch.state is RED_RED
    assert GREEN_GREEN not in stack.told


def test_a_stack_that_begins_in_mid_race_does_not_drive_off(
    stack: Stack, start_bare: StartBare
) -> None:
    start_bare(says=GREEN_GREEN)
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert stack.told == [RED_RED]


@pytest.mark.parametrize('forgiven', [watch.FORGIVEN, LONG])
def test_a_bridge_that_was_away_for_long_is_back_without_its_start_and_after_a_moment_with_it(
    stack: Stack, start_bare: StartBare, monkeypatch: pytest.MonkeyPatch, forgiven: float
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', forgiven)
    bridge = start_green(start_bare, stack)
    bridge.fall_silent()
    stack.wait_for_state(RED_RED)
    if forgiven is not LONG:
        time.sleep(forgiven)  # that time passes is itself what is awaited
        bridge.go_on()
        stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
        bridge.say(GRID_ACTIVE)
        stack.wait_for_state(GRID_ACTIVE)
        bridge.say(GREEN_GREEN)
    bridge.go_on()
    stack.wait_for_state(GREEN_GREEN)


@pytest.mark.parametrize('forgiven', [watch.FORGIVEN, LONG])
def test_a_grid_active_that_is_overtaken_while_the_stack_is_busy_is_heard_unless_that_was_long(
    stack: Stack,
    idle_stack: Stack,
    start_bare: StartBare,
    monkeypatch: pytest.MonkeyPatch,
    forgiven: float,
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', forgiven)
    stack.busy_at = RaceState.IN_GARAGE
    with stack.busy:
        bridge = start_bare(says=RaceState.IN_GARAGE)
        stack.wait_for_state(RaceState.IN_GARAGE)  # and from now on its executor is busy
        bridge.say(GRID_ACTIVE)
        idle_stack.wait_for_state(GRID_ACTIVE)
        bridge.say(GREEN_GREEN)
        idle_stack.wait_for_state(GREEN_GREEN)
        if forgiven is not LONG:
            time.sleep(forgiven)  # that time passes is itself what is awaited
    if forgiven is LONG:
        stack.wait_for_state(GREEN_GREEN)
    else:
        stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
        assert GREEN_GREEN not in stack.told


def test_a_red_that_is_overtaken_while_the_stack_is_busy_is_heard(
    stack: Stack, idle_stack: Stack, start_bare: StartBare, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', LONG)
    stack.busy_at = GREEN_GREEN
    with stack.busy:
        bridge = start_green(start_bare, stack, idle_stack)  # and from now on it is busy
        bridge.say(RED_RED)
        idle_stack.wait_for_state(RED_RED)
        bridge.say(GREEN_GREEN)
        idle_stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert stack.watch.state is RED_RED


def test_what_a_bridge_said_before_a_stack_began_does_not_start_it(
    idle_stack: Stack, start_bare: StartBare, domain: Domain, parts: contextlib.ExitStack
) -> None:
    bridge = start_bare(keeps=1000)  # and so all that it has said, to who asks for it
    idle_stack.wait_for_state(GRID_ACTIVE)
    bridge.say(GREEN_GREEN)
    idle_stack.wait_for_state(GREEN_GREEN)
    late = parts.enter_context(Stack(domain.number, 'late'))
    # It may take Fast DDS a while to get over what such a stack did not ask for; the bridge keeps
    # one message only. Until then it stands, too.
    time.sleep(3.0)  # that time passes is itself what is awaited
    assert late.told == [RED_RED]


def test_a_stack_whose_turns_are_slow_is_not_behind(
    parts: contextlib.ExitStack, domain: Domain, start_bare: StartBare
) -> None:
    slow, prompt = (
        parts.enter_context(Stack(domain.number, name, lease=60.0)) for name in ('slow', 'prompt')
    )
    turns: list[float] = []

    def turn() -> None:
        turns.append(time.monotonic())
        time.sleep(0.3)  # six messages are said meanwhile

    slow.node.create_timer(0.01, turn)
    bridge = start_green(start_bare, slow, prompt)
    while_green = len(turns) + 12
    slow.wait_until_polled(lambda: len(turns) > while_green, 'turns in GREEN_GREEN')
    bridge.say(RED_RED)
    prompt.wait_for_state(RED_RED)
    before = len(turns)
    slow.wait_for_state(RED_RED)
    # Had it taken one message in each turn, dozens would still be before this one.
    assert len(turns) - before < 6
    assert slow.watch.reason == ''


def test_a_grid_active_of_a_second_bridge_starts_no_kart(
    stack: Stack, start_bare: StartBare, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', LONG)
    start_bare(says=GREEN_GREEN)
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    second = start_bare('second')
    stack.wait_for_message(GRID_ACTIVE)
    stack.wait_for_reason('2 bridges speak; there must be one')
    second.close()
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert GREEN_GREEN not in stack.told


def test_a_second_bridge_that_came_and_went_while_the_stack_was_busy_starts_no_kart(
    stack: Stack, idle_stack: Stack, start_bare: StartBare, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', LONG)
    stack.busy_at = RaceState.IN_GARAGE
    with stack.busy:
        first = start_bare(says=RaceState.IN_GARAGE)
        stack.wait_for_state(RaceState.IN_GARAGE)  # and from now on its executor is busy
        second = start_bare('second')
        idle_stack.wait_for_message(GRID_ACTIVE)
        second.close()
        first.say(GREEN_GREEN)
        idle_stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    stack.wait_for_message(GREEN_GREEN)
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert GREEN_GREEN not in stack.told


# ----- orders and their acknowledgement ----------------------------------------------------


def wait_for_order(stack: Stack, number: int) -> watch.Order:
    """Return the order of this number once the stack has been told of its state too."""

    def found() -> watch.Order | None:
        order = stack.watch.order
        told = stack.told[-1:] == [order.state]
        return order if order.number == number and told else None

    return stack.wait_until(found, lambda: f'order {number}; it is {stack.watch.order}')


def acknowledge_until(stack: Stack, order: watch.Order, done: Callable[[], object]) -> None:
    """Acknowledge an order step by step, as a stack does."""

    def step() -> object:
        stack.watch.acknowledge(order)
        return done()

    stack.wait_until_polled(step, f'acknowledged {order}')


def acknowledge_in_vain(stack: Stack, bridge: BareBridge, *orders: watch.Order) -> None:
    """Acknowledge what must not be, then what may be: had the first been sent, it came first."""
    asked = len(bridge.asked)
    for order in orders:
        stack.watch.acknowledge(order)
    bridge.command(RaceState.IN_GARAGE, 99)
    present = wait_for_order(stack, 99)
    acknowledge_until(stack, present, lambda: len(bridge.asked) > asked)
    assert bridge.asked[asked] == (99, RaceState.IN_GARAGE)


@pytest.fixture
def bridge(start_bare: StartBare) -> BareBridge:
    """Return a bare bridge that answers, and commands nothing yet."""
    bare = start_bare(says=RED_RED)
    bare.answer()
    return bare


def test_a_stack_acknowledges_the_order_that_it_was_given(
    stack: Stack, bridge: BareBridge
) -> None:
    bridge.command(RED_RED, 7)
    order = wait_for_order(stack, 7)
    assert order.state is RED_RED
    assert stack.watch.order is order
    acknowledge_until(stack, order, lambda: bridge.asked)
    assert bridge.asked[0] == (7, RED_RED)


def test_an_order_that_is_over_is_not_acknowledged_even_if_the_same_state_is_commanded_again(
    stack: Stack, bridge: BareBridge
) -> None:
    bridge.command(RED_RED, 7)
    first = wait_for_order(stack, 7)
    bridge.command(GRID_ACTIVE, 8)
    grid = wait_for_order(stack, 8)
    bridge.command(RED_RED, 9)
    assert wait_for_order(stack, 9) is not first
    acknowledge_in_vain(stack, bridge, first, grid)


def test_an_order_that_was_over_while_the_stack_was_busy_is_not_acknowledged(
    stack: Stack, idle_stack: Stack, bridge: BareBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', LONG)
    stack.busy_at = GRID_ACTIVE
    with stack.busy:
        bridge.command(GRID_ACTIVE, 7)
        before = wait_for_order(stack, 7)
        stack.wait_for_state(GRID_ACTIVE)  # and from now on its executor is busy
        wait_for_order(idle_stack, 7)
        bridge.command(GRID_ACTIVE, 7, obeyed=RED_RED)  # a team stop
        idle_stack.wait_for_state(RED_RED)
        bridge.command(GRID_ACTIVE, 7)
        idle_stack.wait_for_state(GRID_ACTIVE)
    stack.busy_at = None
    stack.wait_until(lambda: stack.watch.order is not before, lambda: 'another order')
    acknowledge_in_vain(stack, bridge, before)


@pytest.mark.parametrize('commanded', [RaceState.IN_GARAGE, GRID_ACTIVE, GREEN_GREEN])
def test_what_is_no_red_is_not_acknowledged_while_the_kart_must_obey_something_stricter(
    stack: Stack, bridge: BareBridge, commanded: RaceState
) -> None:
    bridge.command(GRID_ACTIVE, 6)
    wait_for_order(stack, 6)
    bridge.command(commanded, 7)
    before = wait_for_order(stack, 7)
    bridge.command(commanded, 7, obeyed=RED_RED)  # a team stop
    stack.wait_for_state(RED_RED)
    stop = stack.watch.order
    assert (stop.number, stop.commanded) == (0, None)
    acknowledge_in_vain(stack, bridge, before, stop)


def test_a_red_flag_is_acknowledged_by_a_kart_that_stands_under_its_team_stop(
    stack: Stack, bridge: BareBridge
) -> None:
    bridge.command(RaceState.RED_FLAG, 7)
    flag = wait_for_order(stack, 7)
    bridge.command(RaceState.RED_FLAG, 7, obeyed=RED_RED)  # a team stop
    stack.wait_for_state(RED_RED)
    stop = stack.watch.order
    assert (stop.state, stop.number, stop.commanded) == (RED_RED, 7, RaceState.RED_FLAG)
    assert stop is not flag
    acknowledge_until(stack, stop, lambda: bridge.asked)
    assert set(bridge.asked) == {(7, RaceState.RED_FLAG)}


def test_a_red_red_is_not_acknowledged_by_what_is_looser(stack: Stack, bridge: BareBridge) -> None:
    bridge.command(RED_RED, 7, obeyed=RaceState.RED_FLAG)  # which no bridge says
    stack.wait_for_state(RaceState.RED_FLAG)
    assert stack.watch.order.number == 0
    acknowledge_in_vain(stack, bridge, stack.watch.order)


def test_a_green_that_is_not_armed_is_not_acknowledged(stack: Stack, bridge: BareBridge) -> None:
    bridge.command(GREEN_GREEN, 7)
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    order = stack.watch.order
    assert (order.state, order.number) == (RED_RED, 0)
    acknowledge_in_vain(stack, bridge, order)


def test_nothing_is_acknowledged_while_the_bridge_is_silent(
    stack: Stack, bridge: BareBridge
) -> None:
    bridge.command(RED_RED, 7)
    order = wait_for_order(stack, 7)
    bridge.fall_silent()
    stack.wait_for_reason('the bridge is silent, or this node was too busy to hear it')
    doubt = stack.watch.order
    assert (doubt.state, doubt.number) == (RED_RED, 0)
    stack.watch.acknowledge(order)
    stack.watch.acknowledge(doubt)
    bridge.go_on()
    acknowledge_in_vain(stack, bridge, order, doubt)


def test_an_acknowledgement_that_is_lost_or_refused_is_sent_again(
    stack: Stack, start_bare: StartBare
) -> None:
    bridge = start_bare(says=RED_RED)
    bridge.command(RED_RED, 7)
    order = wait_for_order(stack, 7)
    stack.watch.acknowledge(order)  # to nobody
    bridge.accepts = False
    bridge.answer()
    acknowledge_until(stack, order, lambda: len(bridge.asked) >= 3)
    assert set(bridge.asked) == {(7, RED_RED)}


def test_what_is_acknowledged_is_not_sent_again(stack: Stack, bridge: BareBridge) -> None:
    bridge.command(RED_RED, 7)
    order = wait_for_order(stack, 7)
    acknowledge_until(stack, order, lambda: bridge.asked)
    bridge.message.acknowledged = True
    stack.wait_until(
        lambda: stack.watch.message is not None and stack.watch.message.acknowledged,
        lambda: 'an acknowledged order',
    )
    assert stack.watch.order is order
    acknowledge_in_vain(stack, bridge, order)


def test_an_order_of_a_bridge_that_is_gone_is_not_acknowledged_to_the_next(
    stack: Stack, start_bare: StartBare
) -> None:
    first = start_bare(says=RED_RED)
    first.command(RED_RED, 7)
    order = wait_for_order(stack, 7)
    first.close()
    stack.wait_until(lambda: stack.watch.order is not order, lambda: 'that it is gone')
    second = start_bare('second', says=RED_RED)
    second.answer()
    second.command(RED_RED, 7)  # the worst case: by chance it has the same number
    wait_for_order(stack, 7)
    acknowledge_in_vain(stack, second, order)
