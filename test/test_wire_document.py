# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The client in docs/wire.md, with no change but its two addresses.

test_inspection.py inspects it, and it drives in the race of test_kart_kit.py; here is what they do
not try.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import time

from evgp_protocol.states import RaceState
from evgp_testing.process import Program
from evgp_testing.race_control import address_of
import pytest
from rig.bare_race_control import BareRaceControl, BEAT
from test_team_workspace import blocks

GRID_ACTIVE, GREEN_GREEN = RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN
RED_FLAG, RED_RED = RaceState.RED_FLAG, RaceState.RED_RED
ADDRESSES = "RACE_CONTROL = ('10.0.0.1', 12017)\nOWN_ADDRESS = None"
(CLIENT,) = blocks('docs/wire.md', 'python')


def client_at(port: int, number: int = 1) -> str:
    """Return the client of a kart for a race control at a port of this machine."""
    assert ADDRESSES in CLIENT
    here = f"RACE_CONTROL = ('127.0.0.1', {port})\nOWN_ADDRESS = ('{address_of(number)}', 0)"
    return CLIENT.replace(ADDRESSES, here)


class Heard:
    """Race control's end of the wire, and all that the client has said."""

    def __init__(self, parts: contextlib.ExitStack) -> None:
        self.states: list[RaceState] = []
        self.race = parts.enter_context(BareRaceControl(self.states.append))
        self.client = Program('client', [sys.executable, '-c', client_at(self.race.port)])
        parts.callback(self.client.kill)
        self.race.wait_for_connections(1)


@pytest.fixture
def heard(parts: contextlib.ExitStack) -> Heard:
    return Heard(parts)


def test_old_frames_give_the_client_no_more_time(heard: Heard) -> None:
    def back_after(attempt: int) -> float:
        heard.race.exchange(GRID_ACTIVE)
        heard.client.signal(signal.SIGSTOP)
        silent_at = time.monotonic()
        time.sleep(0.9)  # that time passes is itself what is awaited
        heard.race.fall_silent()
        heard.client.signal(signal.SIGCONT)
        heard.race.wait_for_connections(attempt + 1)
        return time.monotonic() - silent_at

    # It leaves after 1 s and pauses for 0.5 s. A busy machine may be late, but not each time.
    assert any(back_after(attempt) < 2.2 for attempt in (1, 2, 3))


@pytest.mark.parametrize('between', [RED_RED, RaceState.IN_GARAGE, RED_FLAG])
def test_the_client_obeys_the_last_of_the_frames_that_came_together(
    heard: Heard, between: RaceState
) -> None:
    heard.race.exchange(GRID_ACTIVE)
    heard.states.clear()
    heard.race.say(GRID_ACTIVE, between, GREEN_GREEN)
    time.sleep(10 * BEAT)  # that time passes is itself what is awaited
    heard.race.exchange(RED_RED)
    # Neither what was overtaken, nor a green with something between it and the grid. IN_GARAGE is
    # said at once, for nothing has to be reached.
    garage = {RaceState.IN_GARAGE} if between is RaceState.IN_GARAGE else set()
    assert garage <= set(heard.states) <= {GRID_ACTIVE, RED_RED} | garage
