# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Links that fail, over real networks: one namespace per machine, and a relay that drops.

No time is asserted here: that a fault is noticed at all is awaited with patience.
docs/dev/performance.md says when.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import pathlib
import time

from evgp_node.stamps import seconds_of
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.kart import Bridge, Team
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl
from evgp_testing.wire_kart import WireKart
import pytest
from rig.networks import kart_address, Machine, need_networks, RACE_CONTROL, Track

RED_RED = RaceState.RED_RED
Event = msg.RaceEvent

FAULTY, GOOD = 1, 2
"""The kart whose network fails, and the one that must not notice."""


class NetworkRace:
    """
    Race control, the bridge of the faulty kart, and the plain kart ``good``, on a machine each.

    ``team`` is a node beside the bridge.

    ``began`` is when the present test or its last race began (monotonic, s).
    """

    def __init__(self, parts: contextlib.ExitStack, folder: pathlib.Path) -> None:
        """Start everything, and wait until both karts are connected."""
        self.track = parts.enter_context(Track())
        domain = parts.enter_context(Domain()).number
        # Fast DDS asks for the network interfaces of a process once. Here, where there is but
        # the loopback, what it learns is true on every machine.
        with self.track.middle.inside():
            Official(domain).close()
        given = {'address': RACE_CONTROL, 'red_alert': 1.0}
        numbers = (FAULTY, GOOD)
        with self.track.machine('rcs', RACE_CONTROL).inside():
            self.control = parts.enter_context(
                RaceControl(folder, domain, numbers, parameters=given, addresses=kart_address)
            )
            self.official = parts.enter_context(Official(domain))
        self.machine = self.track.machine('kart1', kart_address(FAULTY))
        self.good_machine = self.track.machine('kart2', kart_address(GOOD))
        self._parts = parts
        domain = parts.enter_context(Domain()).number
        with self.machine.inside():
            to = {'host': RACE_CONTROL}
            parts.enter_context(Bridge(domain, self.control.port, self.machine.address, to))
            self.team = parts.enter_context(Team(domain))
        self.start_good_kart()
        self.began = time.monotonic()

    def start_good_kart(self) -> None:
        """Connect the plain kart from its machine."""
        address, port = self.good_machine.address, self.control.port
        with self.good_machine.inside():
            kart = WireKart(address, port, acknowledges=True, host=RACE_CONTROL)
        self.good = self._parts.enter_context(kart)

    def mend(self) -> None:
        """Have both karts connected again over a network without a fault, for the next test."""
        for machine in (self.machine, self.good_machine):
            machine.ip('link set eth0 up')
            machine.air()
        if self.good.ended:
            self.start_good_kart()
        self.official.wait_for_connected(FAULTY, GOOD)
        self.began = time.monotonic()

    def green(self) -> None:
        """Bring the race to GREEN_GREEN, whatever it was in, with both karts, and let it run."""
        self.official.wait_for_connected(FAULTY, GOOD)
        for state in (RaceState.IN_GARAGE, RaceState.GREEN_GREEN):
            self.official.bring_to(state, FAULTY, GOOD, acknowledge=self._acknowledge)
        self.good.wait_for_frames(6)
        self.began = time.monotonic()

    def _acknowledge(self, state: RaceState) -> None:
        self.team.wait_for(
            lambda heard: state_of(heard.commanded) is state is state_of(heard.state),
            f'{state.value}, commanded and obeyed',
        )
        if state is not RaceState.IN_GARAGE:
            # Its order is another one once a connection that was lost is back.
            self.team.wait_until_polled(
                lambda: self.team.acknowledge(state).success, f'{state.value} acknowledged'
            )

    def events(self, **fields: int) -> list[msg.RaceEvent]:
        """Return the events with these fields since it began."""
        return [
            event
            for event in [*self.official.events]
            if seconds_of(event.monotonic) >= self.began
            and all(getattr(event, name) == value for name, value in fields.items())
        ]

    def wait_for(self, what: str, **fields: int) -> msg.RaceEvent:
        """
        Return the first event with these fields since it began.

        :raises AssertionError: if none comes in time.
        """
        return self.official.wait_until(lambda: self.events(**fields), lambda: what)[0]

    def wait_for_lost(self) -> msg.RaceEvent:
        """Return the event that says the faulty kart was lost."""
        return self.wait_for('kart 1 is lost', kind=Event.DISCONNECTED, kart=FAULTY)

    def wait_for_stopped(self) -> None:
        """Return once the faulty kart had to obey RED_RED."""
        self.team.wait_until(
            lambda: any(at >= self.began and state is RED_RED for at, state in self.team.changes),
            lambda: f'RED_RED; obeyed: {self.team.changes}',
        )

    def wait_for_back(self) -> None:
        """Return once the faulty kart is connected again, and sent RED_RED."""
        self.wait_for('kart 1 is back', kind=Event.CONNECTED, kart=FAULTY)
        self.official.wait_for_kart(
            FAULTY,
            lambda kart: kart.connected and state_of(kart.sent) is RED_RED,
            'back, and held in RED_RED',
        )


CUTS: dict[str, tuple[Callable[[Machine], object], Callable[[Machine], object]]] = {
    'link down': (
        lambda kart: kart.ip('link set eth0 down'),
        lambda kart: kart.ip('link set eth0 up'),
    ),
    'all packets dropped': (lambda kart: kart.air(loss=1.0), lambda kart: kart.air()),
    'dropped toward the kart': (lambda kart: kart.air(toward=1.0), lambda kart: kart.air()),
    'dropped from the kart': (lambda kart: kart.air(back=1.0), lambda kart: kart.air()),
}
"""The faults of the network alone, each with how it is mended: all processes go on."""


@pytest.fixture(scope='module')
def the_race(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NetworkRace]:
    """Return the race over a network of all tests of this file."""
    need_networks()
    with contextlib.ExitStack() as parts:
        yield NetworkRace(parts, tmp_path_factory.mktemp('race_control'))


@pytest.fixture
def race(the_race: NetworkRace) -> NetworkRace:
    """Return the race with nothing wrong, whatever the test before has left."""
    the_race.mend()
    return the_race


def check_the_other_kart_raced_on(race: NetworkRace) -> None:
    race.good.wait_for_frames(10)
    assert race.good.state is RaceState.GREEN_GREEN
    assert not race.events(kind=Event.DISCONNECTED, kart=GOOD)
    assert not race.good.malformed


@pytest.mark.parametrize('fault', CUTS)
def test_a_cut_link_is_noticed_at_both_ends_and_the_kart_is_back_held(
    race: NetworkRace, fault: str
) -> None:
    race.green()
    begin, mend = CUTS[fault]
    begin(race.machine)
    race.wait_for_lost()
    race.wait_for_stopped()
    mend(race.machine)
    race.wait_for_back()
    check_the_other_kart_raced_on(race)
    # That it was lost; or, if it was back before the next beat, that it acknowledges no stop.
    raised = {'kind': Event.ALERT_RAISED, 'kart': FAULTY}
    alert, *_ = race.official.wait_until(
        lambda: [each for each in race.events(**raised) if each.alert != msg.Alert.LINK_POOR],
        lambda: 'an alert',
    )
    assert alert.text.startswith('Use the MSR')
    assert race.team.stop is True


def test_a_kart_is_not_lost_where_a_twentieth_is_lost_and_everything_late(
    race: NetworkRace,
) -> None:
    race.green()
    states = len(race.team.states)
    for machine in (race.machine, race.good_machine):
        machine.air(loss=0.05, delay=0.05)
    race.good.wait_for_frames(240)  # 20 s
    for kart in (FAULTY, GOOD):
        assert not race.events(kind=Event.DISCONNECTED, kart=kart)
    assert race.team.states[states:] == []


def test_a_link_that_answers_all_the_time_but_too_late_is_a_lost_link(race: NetworkRace) -> None:
    race.green()
    for delay in (0.2, 0.4, 0.6):  # so that no second passes without an answer
        race.machine.air(delay=delay)
        race.good.wait_for_frames(20)
    lost = race.wait_for_lost()
    assert lost.text.endswith('its network link stopped answering')
    check_the_other_kart_raced_on(race)


def test_on_a_narrow_link_frames_go_further_apart_and_the_kart_is_not_lost(
    race: NetworkRace,
) -> None:
    race.green()
    race.machine.air(rate=8_000.0)
    race.good.wait_for_frames(180)  # 15 s
    assert not race.events(kind=Event.DISCONNECTED, kart=FAULTY)
    race.official.command('all_kill')
    race.wait_for_stopped()


def is_good(kart: msg.KartStatus) -> bool:
    return bool(kart.link.grade == msg.LinkQuality.GOOD)


def test_officials_are_told_of_a_link_that_answers_late_before_it_is_lost(
    race: NetworkRace,
) -> None:
    for kart in (FAULTY, GOOD):
        race.official.wait_for_kart(kart, is_good, 'a good link')
    race.began = time.monotonic()
    for delay, grade in ((0.13, msg.LinkQuality.FAIR), (0.3, msg.LinkQuality.POOR)):
        race.machine.air(delay=delay)
        race.wait_for('a link that is not good', kart=FAULTY, grade=grade)
    alert = race.wait_for('a warning', kind=Event.ALERT_RAISED, kart=FAULTY)
    assert alert.alert == msg.Alert.LINK_POOR
    assert not race.events(kind=Event.DISCONNECTED, kart=FAULTY)
    others = race.events(kind=Event.LINK_GRADE, kart=GOOD)
    assert all(each.grade == msg.LinkQuality.GOOD for each in others)
