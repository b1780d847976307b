# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A kart without ROS: an example, and its speed, which the kit in C does not have.

Its rules are the arbiter's, proven there; what it adds to them, test_kart_kit.py compares with C.
"""

from __future__ import annotations

from evgp_protocol.arbiter import Settings
from evgp_protocol.kart import Kart
from evgp_protocol.states import RaceState


def test_what_waited_while_the_kart_was_held_up_is_obeyed_but_does_not_end_the_silence() -> None:
    kart = Kart()
    kart.connected(0.0)
    kart.received(b'$GRID_ACTIVE;', 0.0)
    assert kart.acknowledge(kart.verdict.order, 0.0) == b'$GRID_ACTIVE;'
    kart.received(b'$GREEN_GREEN;', 0.0)
    assert kart.verdict.state is RaceState.GREEN_GREEN
    kart.tick(0.0625)  # all that had arrived by now was read
    kart.tick(0.875)
    kart.received(b'$RED_FLAG;', 0.9375)
    assert kart.verdict.commanded is RaceState.RED_FLAG
    for at, is_open in ((1.0, True), (1.0625, False)):
        kart.tick(at)
        assert kart.is_open is is_open


def test_a_stop_is_acknowledged_by_the_measured_speed_where_the_settings_say_so() -> None:
    kart = Kart(Settings(auto_acknowledge_stop=True, standstill_time=0.25))
    kart.connected(0.0)
    kart.received(b'$RED_RED;', 0.0)
    assert [kart.speed(0.0, at) for at in (0.0, 0.125, 0.25, 0.375)] == [
        *(b'', b'', b'$RED_RED;', b''),
    ]
