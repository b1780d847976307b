"""What a team's stack makes of the bridge's topic; the bridge is a bare publisher of the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import threading
import time

from evgp_kart_bridge import watch
from evgp_kart_bridge.watch import race_state_qos, RaceStateWatch
from evgp_node.states import state_message, state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs.msg import KartRaceState
from evgp_rcs_msgs.msg import RaceState as RaceStateMessage
import pytest
from race_parts.domains import Domain
from race_parts.ros_side import RosSide

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
RED_RED = RaceState.RED_RED
LEASE = 0.5


class Stack(RosSide):
    """A team's node with a watch; ``told`` is every state it was told."""

    def __init__(self, domain: int, name: str) -> None:
        super().__init__(name, domain)
        self.told: list[RaceState] = []
        self.busy = threading.Lock()
        self.busy_at: RaceState | None = None
        self.watch = RaceStateWatch(self.node, self._tell, lease=LEASE)
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
    """A publisher in the bridge's place, which says one state again and again."""

    def __init__(self, domain: int, name: str, says: RaceState, keeps: int = 1) -> None:
        super().__init__(name, domain)
        self.message = KartRaceState(state=state_message(says))
        qos = race_state_qos(LEASE)
        qos.depth = keeps
        self._publisher = self.node.create_publisher(KartRaceState, '/kart_bridge/race_state', qos)
        self._timer = self.node.create_timer(0.05, self._say)
        self.spin()

    def say(self, state: RaceState) -> None:
        self.message = KartRaceState(state=state_message(state))

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
        bridge = BareBridge(domain.number, name, says, keeps)
        parts.callback(bridge.close)
        return bridge

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


def test_a_stack_that_hears_no_bridge_is_told_red_red(stack: Stack) -> None:
    stack.wait_for_state(RED_RED)
    assert stack.told == [RED_RED]


def test_a_stack_is_told_what_the_bridge_says(stack: Stack, start_bare: StartBare) -> None:
    bridge = start_green(start_bare, stack)
    bridge.say(RaceState.RED_FLAG)
    stack.wait_for_state(RaceState.RED_FLAG)
    assert stack.watch.reason == ''


def test_a_bridge_that_falls_silent_is_red_red(stack: Stack, start_bare: StartBare) -> None:
    bridge = start_green(start_bare, stack)
    bridge.fall_silent()
    stack.wait_for_state(RED_RED)


def test_a_bridge_that_leaves_is_red_red(stack: Stack, start_bare: StartBare) -> None:
    bridge = start_green(start_bare, stack)
    bridge.close()
    stack.wait_for_state(RED_RED)


@pytest.mark.parametrize('number', [RaceStateMessage.UNKNOWN, 99])
def test_what_is_no_race_state_is_red_red(
    stack: Stack, start_bare: StartBare, number: int
) -> None:
    bridge = start_green(start_bare, stack)
    bridge.message = KartRaceState(state=RaceStateMessage(state=number))
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


def test_a_bridge_that_was_away_for_long_is_back_without_its_start(
    stack: Stack, start_bare: StartBare
) -> None:
    bridge = start_green(start_bare, stack)
    bridge.fall_silent()
    stack.wait_for_state(RED_RED)
    time.sleep(watch.FORGIVEN)  # that time passes is itself what is awaited
    bridge.go_on()
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    bridge.say(GRID_ACTIVE)
    stack.wait_for_state(GRID_ACTIVE)
    bridge.say(GREEN_GREEN)
    stack.wait_for_state(GREEN_GREEN)


def test_a_bridge_that_was_silent_for_a_moment_is_obeyed_again(
    stack: Stack, start_bare: StartBare, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', 60.0)  # however slow this machine is
    bridge = start_green(start_bare, stack)
    bridge.fall_silent()
    stack.wait_for_state(RED_RED)
    bridge.go_on()
    stack.wait_for_state(GREEN_GREEN)


def test_a_grid_active_that_is_overtaken_while_the_stack_is_busy_is_heard(
    stack: Stack, idle_stack: Stack, start_bare: StartBare, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', 60.0)  # however slow this machine is
    stack.busy_at = RaceState.IN_GARAGE
    with stack.busy:
        bridge = start_bare(says=RaceState.IN_GARAGE)
        stack.wait_for_state(RaceState.IN_GARAGE)  # and from now on its executor is busy
        bridge.say(GRID_ACTIVE)
        idle_stack.wait_for_state(GRID_ACTIVE)
        bridge.say(GREEN_GREEN)
        idle_stack.wait_for_state(GREEN_GREEN)
    stack.wait_for_state(GREEN_GREEN)


def test_a_red_that_is_overtaken_while_the_stack_is_busy_is_heard(
    stack: Stack, idle_stack: Stack, start_bare: StartBare, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', 60.0)
    stack.busy_at = GREEN_GREEN
    with stack.busy:
        bridge = start_green(start_bare, stack, idle_stack)  # and from now on it is busy
        bridge.say(RED_RED)
        idle_stack.wait_for_state(RED_RED)
        bridge.say(GREEN_GREEN)
        idle_stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert stack.watch.state is RED_RED


def test_a_stack_that_was_busy_for_long_stands(
    stack: Stack, idle_stack: Stack, start_bare: StartBare
) -> None:
    stack.busy_at = RaceState.IN_GARAGE
    with stack.busy:
        bridge = start_bare(says=RaceState.IN_GARAGE)
        stack.wait_for_state(RaceState.IN_GARAGE)  # and from now on its executor is busy
        bridge.say(GRID_ACTIVE)
        idle_stack.wait_for_state(GRID_ACTIVE)
        bridge.say(GREEN_GREEN)
        time.sleep(watch.FORGIVEN)  # that time passes is itself what is awaited
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert GREEN_GREEN not in stack.told


def test_what_a_bridge_said_before_a_stack_began_does_not_start_it(
    idle_stack: Stack, start_bare: StartBare, domain: Domain, parts: contextlib.ExitStack
) -> None:
    bridge = start_bare(keeps=1000)  # and so all that it has said, to who asks for it
    idle_stack.wait_for_state(GRID_ACTIVE)
    bridge.say(GREEN_GREEN)
    idle_stack.wait_for_state(GREEN_GREEN)
    late = Stack(domain.number, 'late')
    parts.callback(late.close)
    # It may take Fast DDS a while to get over what such a stack did not ask for; the bridge keeps
    # one message only. Until then it stands, too.
    time.sleep(3.0)  # that time passes is itself what is awaited
    assert late.told == [RED_RED]


def test_a_stack_whose_turns_are_slow_is_not_behind(stack: Stack, start_bare: StartBare) -> None:
    # In each turn it would take one message, of three that were said meanwhile.
    stack.node.create_timer(0.01, lambda: time.sleep(0.15))
    bridge = start_green(start_bare, stack)
    time.sleep(3.0)  # that time passes is itself what is awaited
    at = time.monotonic()
    bridge.say(RED_RED)
    stack.wait_for_state(RED_RED)
    assert stack.watch.reason == ''
    assert time.monotonic() - at < 1.0


def test_a_grid_active_of_a_second_bridge_starts_no_kart(
    stack: Stack, start_bare: StartBare, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, 'FORGIVEN', 60.0)
    start_bare(says=GREEN_GREEN)
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    second = start_bare('second')
    stack.wait_for_message(GRID_ACTIVE)
    stack.wait_for_reason('2 bridges speak; there must be one')
    second.close()
    stack.wait_for_reason('no GRID_ACTIVE was heard before GREEN_GREEN')
    assert GREEN_GREEN not in stack.told
