# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""How far our kart travels after a stop: the real race control and bridge, a simulated base."""

import time

from evgp_protocol.states import RaceState
from evgp_testing.process import Process
import pytest

RACE_SPEED = 5.9  # m/s
BRAKING = 8.0  # m/s², as measured on our kart

# For each stop: what brings it, and the maximum distance from there to the standstill, in m. The
# barriers must be farther away. It includes 1 s for a busy computer: use less on an idle one.
# `bring_to` returns once the kart has acknowledged the stop.
STOPS = {
    'red_red': (lambda official, control, bridge: official.bring_to(RaceState.RED_RED), 8.5),
    'red_flag': (lambda official, control, bridge: official.bring_to(RaceState.RED_FLAG), 42.0),
    'race_control_hangs': (lambda official, control, bridge: control.freeze(), 14.5),
    'bridge_dies': (lambda official, control, bridge: bridge.kill(), 11.5),
}


@pytest.mark.parametrize('stop', STOPS)
def test_the_kart_stands_within_its_distance(
    stop, start_race_control, join_official, start_bridge, start_base, parts
):
    control = start_race_control(in_race=[1], auto_race_over=False)
    official = join_official(control)
    bridge = start_bridge(control.port, 1, arguments=('-r', '~/odom:=/odom'))
    base = start_base(bridge, braking=BRAKING)  # your simulator instead, if you have one
    stack = parts.enter_context(Process('my_kart', 'stack', bridge.domain))
    official.wait_for_connected(1)
    official.bring_to(RaceState.GREEN_GREEN)
    base.wait_for_speed(lambda speed: speed > RACE_SPEED)

    before, (bring, longest) = base.distance, STOPS[stop]
    bring(official, control, bridge)
    base.wait_for_speed(lambda speed: speed == 0.0)
    assert base.distance - before < longest
    time.sleep(1.0)  # a stack that has crashed takes a moment to end
    assert stack.runs  # the base brakes without a stack, too
