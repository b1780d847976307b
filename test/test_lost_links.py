# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Links that fail, over real networks: one namespace per machine, and a relay that drops.

No time is asserted here: that a fault is noticed at all is awaited with patience, and when is
printed. ``bench/lost_links.py`` measures it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import pathlib
import signal
import time

from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.lost_links import (
    cut,
    CUTS,
    Fault,
    FAULTY,
    GOOD,
    kill_bridge,
    NetworkRace,
    race_in_bad_air,
    RosKart,
    steal_address,
    wait_for_held,
)
from evgp_testing.networks import need_networks
import pytest

pytestmark = pytest.mark.own_process

RED_RED = RaceState.RED_RED
Event = msg.RaceEvent

ATTEMPTS = 5
"""Maximum number of thefts, while other programs hold up the thief."""


@pytest.fixture
def networks() -> None:
    """Skip the test where no networks can be made, and say why; not where all tests must run."""
    need_networks()


@pytest.fixture
def race(networks: None, tmp_path: pathlib.Path) -> Iterator[NetworkRace]:
    """Return a race over a network."""
    with NetworkRace(tmp_path, seed=1, red_alert=1.0) as race:
        yield race


def check_the_other_kart_raced_on(race: NetworkRace) -> None:
    race.good.wait_for_frames(10)
    assert race.good.state is RaceState.GREEN_GREEN
    assert not race.events(Event.DISCONNECTED, GOOD)
    assert not race.good.malformed


# ----- the network -------------------------------------------------------------------------


@pytest.mark.parametrize('fault', CUTS, ids=lambda fault: fault.name)
def test_a_cut_link_is_noticed_at_both_ends_and_the_kart_is_back_held(
    race: NetworkRace, fault: Fault, record_property: Callable[[str, object], None]
) -> None:
    noticed = cut(race, fault)
    check_the_other_kart_raced_on(race)
    # That it was lost; or, if it was back before the next beat, that it acknowledges no stop.
    alert = race.wait_for(Event.ALERT_RAISED, FAULTY, 0.0, 'an alert')
    assert alert.text.startswith('Use the MSR')
    assert race.faulty.team.stop is True
    print(f'{fault.name}: {noticed}')
    record_property(fault.name, noticed)


@pytest.mark.early
def test_a_kart_is_not_lost_where_a_twentieth_is_lost_and_everything_late(
    race: NetworkRace, record_property: Callable[[str, object], None]
) -> None:
    stretch = race_in_bad_air(race, 0.05, 0.05, seconds=20.0)
    assert stretch.lost == []
    assert stretch.stopped == 0
    worst = f'the worst gap between two frames was {max(stretch.gaps):.3f} s'
    print(worst)
    record_property('5 % and 50 ms', worst)


def test_where_a_third_is_lost_a_kart_that_is_lost_comes_back_held(
    race: NetworkRace, record_property: Callable[[str, object], None]
) -> None:
    race.green()
    green = len(race.faulty.team.states)
    began = time.monotonic()
    race.machine.air(loss=0.3, delay=0.2)
    race.good.wait_for_frames(100)
    if not race.events(Event.DISCONNECTED, FAULTY):
        race.machine.air(loss=1.0)  # no dice decide whether it is lost at all
    race.wait_for_lost(began)
    race.machine.air(loss=0.3, delay=0.2)
    wait_for_held(race)
    check_the_other_kart_raced_on(race)
    assert RaceState.GREEN_GREEN not in race.faulty.team.states[green:]
    lost = race.events(Event.DISCONNECTED, FAULTY)
    record_property('30 % and 200 ms', [each.text for each in lost])


def test_a_link_that_answers_all_the_time_but_too_late_is_a_lost_link(race: NetworkRace) -> None:
    race.green()
    began = time.monotonic()
    for delay in (0.2, 0.4, 0.6):  # so that no second passes without an answer
        race.machine.air(delay=delay)
        race.good.wait_for_frames(20)
    race.wait_for_lost(began)
    check_the_other_kart_raced_on(race)


def test_officials_are_told_of_a_link_that_is_slow_again_and_again(race: NetworkRace) -> None:
    began = time.monotonic()
    race.machine.air(delay=0.2)
    race.wait_for(Event.SLOW_LINK, FAULTY, began, 'a slow link')
    assert not race.events(Event.SLOW_LINK, GOOD)


# ----- the kart's machine ------------------------------------------------------------------


def test_a_killed_bridge_is_noticed_and_comes_back_held(
    race: NetworkRace, record_property: Callable[[str, object], None]
) -> None:
    noticed = kill_bridge(race)
    check_the_other_kart_raced_on(race)
    print(f'bridge killed: {noticed}')
    record_property('bridge killed', noticed)


def test_a_frozen_bridge_is_seen_by_what_it_does_not_acknowledge(race: NetworkRace) -> None:
    """Its kernel goes on to answer TCP, so there is no lost connection to be seen."""
    race.green()
    began = time.monotonic()
    race.faulty.bridge.signal(signal.SIGSTOP)
    race.wait_for_stopped(began)
    check_the_other_kart_raced_on(race)
    race.official.command('all_kill')
    race.official.wait_for_acks(RED_RED, GOOD)
    alert = race.wait_for(Event.ALERT_RAISED, FAULTY, began, 'an alert')
    assert alert.text.startswith('Use the MSR')
    assert not race.events(Event.DISCONNECTED, FAULTY)
    states = len(race.faulty.team.states)
    race.faulty.bridge.signal(signal.SIGCONT)
    race.wait_for_lost(began)
    wait_for_held(race)
    assert RaceState.GREEN_GREEN not in race.faulty.team.states[states:]


def test_a_machine_that_reboots_takes_the_place_of_its_own_lost_connection(
    race: NetworkRace,
) -> None:
    race.green()
    began = time.monotonic()
    machine = race.reboot(race.machine)
    with race.connect(machine) as early:
        early.wait_for_frames(3)
        assert [state for _, state in early.changes] == [RED_RED]
    lost = race.wait_for_lost(began)
    check_the_other_kart_raced_on(race)
    race.faulty = race.start_ros_kart(machine)
    race.faulty.team.wait_for(lambda state: state.connected, 'a link')
    assert race.faulty.team.states == [RED_RED]
    wait_for_held(race)
    assert lost.text.endswith(
        (
            'a new connection from its address took its place',
            'its network link stopped answering',
            'connection reset by peer',  # the new kernel knows no such connection
        )
    )


def test_a_stolen_address_stops_the_kart_and_gets_the_thief_nothing_but_red_red(
    race: NetworkRace, record_property: Callable[[str, object], None]
) -> None:
    for _ in range(ATTEMPTS):
        began = time.monotonic()
        noticed = steal_address(race)
        check_the_other_kart_raced_on(race)
        lost, *_ = race.events(Event.DISCONNECTED, FAULTY, began)
        # On a busy computer the thief takes 1 s to connect, and the bridge has given up by then.
        if not lost.text.endswith('the kart closed the connection'):
            break
    assert lost.text.endswith('a new connection from its address took its place')
    print(f'address stolen: {noticed}')
    record_property('address stolen', noticed)


# ----- the networks themselves -------------------------------------------------------------


def test_networks_are_gone_after_a_failing_test(networks: None, tmp_path: pathlib.Path) -> None:
    before = open_files()
    kart: RosKart | None = None
    with pytest.raises(ZeroDivisionError), NetworkRace(tmp_path) as race:
        kart = race.faulty
        race.machine.unplug()
        raise ZeroDivisionError
    assert kart is not None
    assert kart.bridge.wait() is not None
    assert open_files() == before


def open_files() -> list[str]:
    """Return the network namespaces that this process holds open."""
    links = []
    for each in pathlib.Path('/proc/self/fd').iterdir():
        try:
            links.append(str(each.readlink()))
        except FileNotFoundError:
            pass  # the folder's own
    return sorted(link for link in links if link.startswith('net:'))
