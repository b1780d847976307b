# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A kart without ROS: its speed, which the kit in C does not have.

Its rules are the arbiter's, proven there; what else it adds to them, test_kart_kit.py compares
with C, and test_link.py tries on sockets.
"""

from __future__ import annotations

from evgp_protocol.arbiter import Settings
from evgp_protocol.kart import Kart


def test_a_stop_is_acknowledged_by_the_measured_speed_where_the_settings_say_so() -> None:
    kart = Kart(Settings(auto_acknowledge_stop=True, standstill_time=0.25))
    kart.connected(0.0)
    kart.received(b'$RED_RED;', 0.0)
    assert [kart.speed(0.0, at) for at in (0.0, 0.125, 0.25, 0.375)] == [
        *(b'', b'', b'$RED_RED;', b''),
    ]
