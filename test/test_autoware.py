# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Autoware's adapter, with Autoware's interfaces and a stand-in for its command gate."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import dataclasses
from typing import Any

from evgp_node.qos import latched
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_testing.base import SimulatedBase
from evgp_testing.fixtures import JoinOfficial, StartBase, StartBridge, StartRaceControl
from evgp_testing.kart import Bridge
from evgp_testing.official import Official
from evgp_testing.process import Process
from evgp_testing.ros_side import RosSide
from geometry_msgs.msg import Twist
import pytest

adapi = pytest.importorskip('autoware_adapi_v1_msgs.msg', reason="needs Autoware's interfaces")
external = pytest.importorskip('tier4_external_api_msgs.srv', reason="needs Autoware's interfaces")
control_srv = pytest.importorskip('tier4_control_msgs.srv', reason="needs Autoware's interfaces")


class Gate(RosSide):
    """
    Autoware in autonomous mode: its command gate lets it drive unless it was asked to stop.

    ``ready`` is the newest heartbeat; without a service for the gentle stop it grants none.
    """

    def __init__(self, base: SimulatedBase, domain: int, gentle: bool = True) -> None:
        super().__init__('gate', domain)
        self.emergency, self.stop, self.ready, self.asked = True, False, False, 0
        self.emergencies = 0  # how often one began
        self._base = base
        self._motors = self.node.create_publisher(Twist, '/cmd_vel', 1)
        self._motion = self.node.create_publisher(
            adapi.MotionState, '/api/motion/state', latched(1)
        )
        self._mode = self.node.create_publisher(
            adapi.OperationModeState, '/api/operation_mode/state', latched(1)
        )
        state = adapi.OperationModeState
        self._mode.publish(state(mode=state.AUTONOMOUS, is_autoware_control_enabled=True))
        self.node.create_service(
            external.SetEmergency, '/api/autoware/set/emergency', self._set_emergency
        )
        if gentle:
            self._gentle = self.node.create_service(
                control_srv.SetStop, '/control/vehicle_cmd_gate/set_stop', self._set_stop
            )
        self.node.create_subscription(
            adapi.ManualOperatorHeartbeat, '/autoware_adapter/heartbeat', self._hear, 1
        )
        self.node.create_timer(0.05, self._step)
        self.spin()

    def wait_for(self, emergency: bool, stop: bool) -> None:
        self.wait_until(
            lambda: (self.emergency, self.stop, self.ready) == (emergency, stop, not emergency),
            lambda: f'{self.emergency=} {self.stop=} {self.ready=}',
        )

    def wait_for_requests(self, count: int) -> None:
        """Return once the emergency stop, or its end, was asked for so many times more."""
        asked = self.asked
        self.wait_until(lambda: self.asked >= asked + count, lambda: f'{count} more requests')

    def refuse_gentle_stops(self) -> None:
        """Answer no more requests of them."""
        self.node.destroy_service(self._gentle)

    def _set_emergency(self, request: Any, response: Any) -> Any:
        with self.news:
            self.emergencies += request.emergency and not self.emergency
            self.emergency = request.emergency
            self.asked += 1
            self.news.notify_all()
        return response

    def _set_stop(self, request: Any, response: Any) -> Any:
        with self.news:
            self.stop = request.stop
            self.news.notify_all()
        response.status.success = True
        return response

    def _hear(self, heartbeat: Any) -> None:
        with self.news:
            self.ready = heartbeat.ready
            self.news.notify_all()

    def _step(self) -> None:
        command = Twist()
        command.linear.x = 0.0 if self.emergency or self.stop else 3.0
        self._motors.publish(command)
        moves = adapi.MotionState.MOVING if self._base.speed > 0.1 else adapi.MotionState.STOPPED
        self._motion.publish(adapi.MotionState(state=moves))


@dataclasses.dataclass
class Race:
    official: Official
    bridge: Bridge
    base: SimulatedBase
    gate: Gate


StartRace = Callable[..., Race]


@pytest.fixture
def start_race(
    start_race_control: StartRaceControl,
    join_official: JoinOfficial,
    start_bridge: StartBridge,
    start_base: StartBase,
    parts: contextlib.ExitStack,
) -> StartRace:
    """Return a function that starts a race of one kart with the adapter; it takes `gentle`."""

    def start(gentle: bool = True) -> Race:
        control = start_race_control(in_race=[1], auto_race_over=False)
        to_the_bridge = ('-r', '~/odom:=/odom')
        bridge = start_bridge(control.port, arguments=to_the_bridge, auto_acknowledge_stop=True)
        base = start_base(bridge)
        gate = parts.enter_context(Gate(base, bridge.domain, gentle))
        parts.enter_context(Process('evgp_kart_bridge', 'autoware_adapter', bridge.domain))
        official = join_official(control)
        official.wait_for_connected(1)
        return Race(official, bridge, base, gate)

    return start


def test_autoware_drives_under_green_green_alone_and_stops_as_the_state_asks(
    start_race: StartRace,
) -> None:
    race = start_race()
    for state, emergency, stop in [
        (RaceState.GRID_ACTIVE, False, True),
        (RaceState.GREEN_GREEN, False, False),
        (RaceState.RED_FLAG, False, True),
        (RaceState.RED_RED, True, True),
    ]:
        before = race.gate.emergencies
        race.official.bring_to(state)  # and it is acknowledged
        race.gate.wait_for(emergency, stop)
        race.gate.wait_for_requests(6)  # for longer than a stop may wait to be granted
        # RED_FLAG is gentle from its beginning: others follow.
        assert race.gate.emergencies - before == (state is RaceState.RED_RED)
    assert race.base.speed == 0.0


def test_without_a_bridge_autoware_makes_an_emergency_stop(start_race: StartRace) -> None:
    race = start_race()
    race.official.bring_to(RaceState.GREEN_GREEN)
    race.bridge.kill()
    race.gate.wait_for(emergency=True, stop=True)


def test_an_emergency_stop_goes_on_where_the_gentle_one_is_not_granted(
    start_race: StartRace,
) -> None:
    race = start_race(gentle=False)
    race.official.bring_to(RaceState.IN_GARAGE)
    race.official.command('set_track_open', open=False)
    race.official.command('grid_active', track_clear=True)
    race.official.wait_for_kart(
        1, lambda kart: state_of(kart.sent) is RaceState.GRID_ACTIVE, 'to be sent GRID_ACTIVE'
    )
    race.gate.wait_for_requests(6)
    assert (race.gate.emergency, race.gate.ready) == (True, False)
    # Nor is such a kart ready.
    race.official.wait_for_kart(1, lambda kart: not kart.acknowledged, 'no word of it')


@pytest.mark.parametrize('state', [RaceState.GRID_ACTIVE, RaceState.RED_FLAG])
def test_where_the_gentle_stop_is_not_granted_any_more_there_is_an_emergency_stop(
    state: RaceState, start_race: StartRace
) -> None:
    race = start_race()
    race.official.bring_to(state)
    race.gate.wait_for(emergency=False, stop=True)
    race.gate.refuse_gentle_stops()
    race.gate.wait_for(emergency=True, stop=True)
