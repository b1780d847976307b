# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A kart without ROS. Its rules are the arbiter's, proven there; here is what it adds to them."""

from __future__ import annotations

from evgp_protocol.arbiter import Settings
from evgp_protocol.kart import Kart
from evgp_protocol.states import RaceState


def connected(settings: Settings | None = None) -> Kart:
    kart = Kart(settings)
    kart.connected(0.0)
    return kart


def race(kart: Kart) -> None:
    """Bring a connected kart to GREEN_GREEN at 0.0 s."""
    kart.received(b'$GRID_ACTIVE;', 0.0)
    assert kart.acknowledge(kart.verdict.order, 0.0) == b'$GRID_ACTIVE;'
    kart.received(b'$GREEN_GREEN;', 0.0)
    assert kart.verdict.state is RaceState.GREEN_GREEN


def test_a_kart_stands_before_race_control_has_said_anything() -> None:
    kart = Kart()
    assert (kart.verdict.state, kart.is_open) == (RaceState.RED_RED, False)
    kart.connected(0.0)
    assert (kart.verdict.state, kart.is_open) == (RaceState.RED_RED, True)
    assert kart.acknowledge(kart.verdict.order, 0.0) == b''


def test_a_second_of_silence_is_a_lost_connection_and_what_waited_comes_too_late() -> None:
    kart = connected()
    race(kart)
    kart.tick(0.999)
    assert kart.verdict.state is RaceState.GREEN_GREEN
    kart.received(b'$GREEN_GREEN;', 1.0)
    assert (kart.verdict.state, kart.is_open) == (RaceState.RED_RED, False)
    kart.received(b'$GREEN_GREEN;', 1.1)
    assert (kart.verdict.commanded, kart.is_open) == (None, False)


def test_what_waited_while_the_kart_was_held_up_is_obeyed_but_does_not_end_the_silence() -> None:
    kart = connected()
    race(kart)
    kart.tick(0.0625)  # all that had arrived by now was read
    kart.tick(0.875)
    kart.received(b'$RED_FLAG;', 0.9375)
    assert kart.verdict.commanded is RaceState.RED_FLAG
    for at, is_open in ((1.0, True), (1.0625, False)):
        kart.tick(at)
        assert kart.is_open is is_open


def test_half_a_frame_of_a_connection_is_not_ended_by_the_next() -> None:
    kart = connected()
    kart.received(b'$IN_', 0.1)
    kart.closed(0.2)
    kart.connected(0.3)
    kart.received(b'GARAGE;', 0.4)
    assert (kart.verdict.commanded, kart.malformed) == (None, 1)


def test_the_last_of_the_frames_that_came_together_is_obeyed() -> None:
    kart = connected()
    race(kart)
    kart.received(b'$GREEN_GREEN;$RED_RED;', 0.1)
    assert kart.verdict.state is RaceState.RED_RED


def test_an_acknowledgement_is_sent_once_for_each_time_that_frames_come() -> None:
    kart = connected()
    kart.received(b'$RED_RED;', 0.1)
    order = kart.verdict.order
    said = [kart.acknowledge(order, 0.1) for _ in range(3)]
    kart.received(b'$RED_RED;$RED_RED;', 0.2)
    said += [kart.acknowledge(order, 0.2) for _ in range(3)]
    assert said == [b'$RED_RED;', b'', b''] * 2


def test_a_stop_is_acknowledged_by_the_measured_speed_where_the_settings_say_so() -> None:
    kart = connected(Settings(auto_acknowledge_stop=True, standstill_time=0.25))
    kart.received(b'$RED_RED;', 0.0)
    assert [kart.speed(0.0, at) for at in (0.0, 0.125, 0.25, 0.375)] == [
        *(b'', b'', b'$RED_RED;', b''),
    ]


def test_a_garage_that_the_next_frame_overtakes_is_said_before_the_word_for_that() -> None:
    kart = connected()
    kart.received(b'$RED_RED;', 0.1)
    assert kart.acknowledge(kart.verdict.order, 0.1) == b'$RED_RED;'
    # Or race control would take the next RED_RED for an answer to the first.
    kart.received(b'$IN_GARAGE;$RED_RED;', 0.8)
    assert kart.acknowledge(kart.verdict.order, 0.8) == b'$IN_GARAGE;$RED_RED;'
    kart.received(b'$RED_RED;', 0.9)
    assert kart.acknowledge(kart.verdict.order, 0.9) == b'$RED_RED;'


def test_a_garage_of_a_connection_that_is_lost_is_not_said_on_the_next() -> None:
    kart = connected()
    kart.received(b'$IN_GARAGE;', 0.1)
    kart.closed(0.2)
    kart.connected(0.3)
    kart.received(b'$RED_RED;', 0.4)
    assert kart.acknowledge(kart.verdict.order, 0.4) == b'$RED_RED;'
