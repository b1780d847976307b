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

"""A race over a network that can fail: race control, a kart with ROS, and a plain one."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import dataclasses
import itertools
import pathlib
import signal
import time

from evgp_kart_bridge.watch import RaceStateWatch
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.kart import Bridge, Team
from evgp_testing.networks import kart_address, Machine, RACE_CONTROL, Track
from evgp_testing.official import Official
from evgp_testing.part import Part
from evgp_testing.race_control import RaceControl
from evgp_testing.wire_kart import Acknowledges, WireKart

FAULTY, GOOD = 1, 2
"""The kart whose network fails, and the one that must not notice."""

RESTED = 0.3
"""How long a race goes on in GREEN_GREEN before a fault, s; no fault waits for it."""


class RosKart(Part):
    """
    A kart with ROS on a machine of its own: its bridge, and a team's node beside it.

    ``obeyed`` are the states that a stack with the bridge's watch obeys, each with the monotonic
    time (s) since when: the watch also tells when the bridge is gone.
    """

    def __init__(self, machine: Machine, port: int) -> None:
        """Start it; it need not find race control."""
        self.machine = machine
        self.obeyed: list[tuple[float, RaceState]] = []
        self._port = port
        self._stack = contextlib.ExitStack()
        domain = self._stack.enter_context(Domain()).number
        try:
            with machine.inside():
                self.bridge = self._start(domain)
                self.team = self._stack.enter_context(Team(domain))
                RaceStateWatch(self.team.node, self._obey)
        except BaseException:
            self.close()
            raise

    def restart_bridge(self) -> None:
        """Start the bridge again after it was killed."""
        with self.machine.inside():
            self.bridge = self._start(self.bridge.domain)

    def close(self) -> None:
        """End it."""
        self._stack.close()

    def _obey(self, state: RaceState) -> None:
        with self.team.news:
            self.obeyed.append((time.monotonic(), state))
            self.team.news.notify_all()

    def _start(self, domain: int) -> Bridge:
        parameters = {'host': RACE_CONTROL}
        return self._stack.enter_context(
            Bridge(domain, self._port, self.machine.address, parameters)
        )


class NetworkRace(Part):
    """
    Race control, the ROS kart ``faulty`` and the plain kart ``good``, each on its own machine.

    :param folder: where race control's files are written.
    :param seed: of the dice that decide what is lost.
    :param congestion: TCP's congestion control; empty: this machine's own.
    :param parameters: more ROS parameters of race control.
    """

    def __init__(
        self, folder: pathlib.Path, seed: int = 0, congestion: str = '', **parameters: object
    ) -> None:
        """Start everything, and wait until both karts are connected."""
        self._folder = folder
        self._stack = contextlib.ExitStack()
        try:
            self._start(Track(seed, congestion), parameters)
        except BaseException:
            self.close()
            raise

    def _start(self, track: Track, parameters: dict[str, object]) -> None:
        enter = self._stack.enter_context
        self.track = enter(track)
        domain = enter(Domain()).number
        # Fast DDS asks for the network interfaces of a process once. Here, where there is but
        # the loopback, what it learns is true on every machine.
        with self.track.middle.inside():
            Official(domain).close()
        with self.track.machine('rcs', RACE_CONTROL).inside():
            self.control = enter(
                RaceControl(
                    self._folder,
                    domain,
                    (FAULTY, GOOD),
                    parameters={'address': RACE_CONTROL, **parameters},
                    addresses=kart_address,
                )
            )
            self.official = self._stack.enter_context(Official(domain))
        self.machine = self.track.machine('kart1', kart_address(FAULTY))
        self.good_machine = self.track.machine('kart2', kart_address(GOOD))
        self._faulty = enter(contextlib.ExitStack())
        self.faulty = self.start_ros_kart(self.machine)
        self.good = enter(self.connect(self.good_machine, Acknowledges.EACH_CHANGE))
        self.official.wait_for_connected(FAULTY, GOOD)

    def start_ros_kart(self, machine: Machine) -> RosKart:
        """Start a kart with ROS on a machine."""
        return self._faulty.enter_context(RosKart(machine, self.control.port))

    def connect(
        self, machine: Machine, acknowledges: Acknowledges = Acknowledges.NEVER
    ) -> WireKart:
        """Return a plain kart on a machine, connected."""
        with machine.inside():
            return WireKart(machine.address, self.control.port, acknowledges, RACE_CONTROL)

    def is_connected(self, number: int) -> bool:
        """Return whether race control says that a kart is connected."""
        race = self.official.race
        assert race is not None
        return any(kart.number == number and kart.connected for kart in race.karts)

    def reconnect_good(self) -> None:
        """Connect the good kart anew."""
        self.good.close()
        self.good = self._stack.enter_context(
            self.connect(self.good_machine, Acknowledges.EACH_CHANGE)
        )
        self.official.wait_for_connected(GOOD)

    def reboot(self, machine: Machine) -> Machine:
        """
        Cut the power of the faulty kart; return its machine as it is back, with nothing running.

        What ran on it ends without a word to race control, as its cable has gone first.
        """
        if machine.plugged:
            machine.unplug()
        self._faulty.close()
        self.track.remove(machine)
        self.machine = self.track.machine('kart1', machine.address)
        return self.machine

    def green(self) -> None:
        """Bring the race to GREEN_GREEN, whatever it was in, with both karts in it."""
        self.official.wait_for_connected(FAULTY, GOOD)
        for state in (RaceState.IN_GARAGE, RaceState.GREEN_GREEN):
            self.official.bring_to(state, FAULTY, GOOD, acknowledge=self._acknowledge)

    def _acknowledge(self, state: RaceState) -> None:
        self.faulty.team.wait_for(
            lambda heard: state_of(heard.commanded) is state is state_of(heard.state),
            f'{state.value}, commanded and obeyed',
        )
        if state is not RaceState.IN_GARAGE:
            answer = self.faulty.team.acknowledge(state)
            assert answer.success, answer.message

    def events(self, kind: int, kart: int, since: float = 0.0) -> list[msg.RaceEvent]:
        """Return the events of a kind about a kart since then (monotonic, s)."""
        with self.official.news:
            return [
                event
                for event in self.official.events
                if (event.kind, event.kart) == (kind, kart) and monotonic(event) >= since
            ]

    def wait_for(self, kind: int, kart: int, since: float, what: str) -> msg.RaceEvent:
        """
        Return the first event of a kind about a kart since then (monotonic, s).

        :raises AssertionError: if none comes in time.
        """
        return self.official.wait_for_event(
            lambda event: (event.kind, event.kart) == (kind, kart) and monotonic(event) >= since,
            what,
        )

    def wait_for_lost(self, since: float) -> msg.RaceEvent:
        """
        Return the event that says the faulty kart was lost since then (monotonic, s).

        :raises AssertionError: if race control does not notice in time.
        """
        return self.wait_for(msg.RaceEvent.DISCONNECTED, FAULTY, since, 'kart 1 is lost')

    def wait_for_stopped(self, since: float) -> float:
        """
        Return when (monotonic, s) the faulty kart's stack had to obey RED_RED since then.

        :raises AssertionError: if it need not in time.
        """
        kart = self.faulty

        def found() -> float | None:
            times = [at for at, state in kart.obeyed if state is RaceState.RED_RED]
            return next((at for at in times if at >= since), None)

        at = kart.team.wait_until(found, lambda: f'RED_RED; obeyed: {kart.obeyed}')
        assert at is not None
        return at

    def wait_for_back(self, since: float) -> msg.RaceEvent:
        """
        Return the event that says the faulty kart is back since then (monotonic, s).

        :raises AssertionError: if it does not come back in time.
        """
        return self.wait_for(msg.RaceEvent.CONNECTED, FAULTY, since, 'kart 1 is back')

    def close(self) -> None:
        """End everything and take the networks away."""
        self._stack.close()


def monotonic(event: msg.RaceEvent) -> float:
    """Return the monotonic time of an event, s; the clock is the same in all processes here."""
    return float(event.monotonic.sec + event.monotonic.nanosec * 1e-9)


@dataclasses.dataclass(frozen=True)
class Fault:
    """A way in which the link to a kart fails, and how it is mended."""

    name: str
    begin: Callable[[NetworkRace], object]
    mend: Callable[[NetworkRace], object]


CUTS = (
    Fault('link down', lambda race: race.machine.link_down(), lambda race: race.machine.link_up()),
    Fault(
        'all packets dropped',
        lambda race: race.machine.air(loss=1.0),
        lambda race: race.machine.air(),
    ),
    Fault(
        'dropped toward the kart',
        lambda race: race.machine.air(toward=1.0),
        lambda race: race.machine.air(),
    ),
    Fault(
        'dropped from the kart',
        lambda race: race.machine.air(back=1.0),
        lambda race: race.machine.air(),
    ),
)
"""The faults of the network alone: all processes go on."""


@dataclasses.dataclass(frozen=True)
class Noticed:
    """
    What became of one fault; times in s.

    :ivar by_race_control: from the first byte that was not answered, or, where a process or a
        machine failed, from that; None: it cannot see it.
    :ivar by_kart: from the last new byte that reached the kart, or from the fault likewise, to
        the RED_RED of a stack beside the bridge; None: there is nobody left to notice.
    :ivar back: from the mending to the new connection.
    :ivar gap: the worst gap between two frames of the other kart.
    """

    by_race_control: float | None
    by_kart: float | None
    back: float
    gap: float


def under_way(race: NetworkRace) -> float:
    """Bring the race to GREEN_GREEN, let it run, and return the time (monotonic, s)."""
    race.green()
    race.good.wait_for_frames(round(RESTED * 20))
    return time.monotonic()


def wait_for_held(race: NetworkRace) -> None:
    """
    Return once the faulty kart is connected and sent RED_RED.

    :raises AssertionError: if that does not happen in time.
    """
    race.official.wait_for_kart(
        FAULTY,
        lambda kart: kart.connected and state_of(kart.sent) is RaceState.RED_RED,
        'back, and held in RED_RED',
    )


def come_back(
    race: NetworkRace, began: float, mend: Callable[[], object], lost: float = 0.0
) -> tuple[float, float]:
    """Mend a fault that began then, see the kart come back held, and return ``back``, ``gap``."""
    gap = race.good.worst_gap(began)
    mended = time.monotonic()
    mend()
    back = race.wait_for_back(max(mended, lost))
    wait_for_held(race)
    return monotonic(back) - mended, gap


def cut(race: NetworkRace, fault: Fault) -> Noticed:
    """
    Let a race meet a fault of the network, both ends notice, and the kart come back held.

    :raises AssertionError: if any of that does not happen in time.
    """
    began = under_way(race)
    fault.begin(race)
    lost = race.wait_for_lost(began)
    stopped = race.wait_for_stopped(began)
    times = race.machine.times()
    assert times.came is not None
    assert times.arrived is not None
    return Noticed(
        monotonic(lost) - times.came,
        stopped - times.arrived,
        *come_back(race, began, lambda: fault.mend(race), monotonic(lost)),
    )


def kill_bridge(race: NetworkRace) -> Noticed:
    """
    Kill the faulty kart's bridge, and start it again; see ``cut``.

    :raises AssertionError: if what must happen does not in time.
    """
    began = under_way(race)
    race.faulty.bridge.kill()
    lost = race.wait_for_lost(began)
    stopped = race.wait_for_stopped(began)
    back = come_back(race, began, race.faulty.restart_bridge)
    return Noticed(monotonic(lost) - began, stopped - began, *back)


def freeze_bridge(race: NetworkRace) -> Noticed:
    """
    Have the faulty kart's bridge stand still for longer than the link may be silent.

    Its kernel goes on to answer, so race control sees nothing before the bridge goes on.

    :raises AssertionError: if what must happen does not in time.
    """
    began = under_way(race)
    race.faulty.bridge.signal(signal.SIGSTOP)
    stopped = race.wait_for_stopped(began)
    race.good.wait_for_frames(30)
    assert not race.events(msg.RaceEvent.DISCONNECTED, FAULTY, began)
    back = come_back(race, began, lambda: race.faulty.bridge.signal(signal.SIGCONT))
    return Noticed(None, stopped - began, *back)


def reboot_machine(race: NetworkRace) -> Noticed:
    """
    Cut the power of the faulty kart, wait until that is noticed, and have it boot; see ``cut``.

    :raises AssertionError: if what must happen does not in time.
    """
    began = under_way(race)
    race.machine.air()
    machine = race.machine
    machine.unplug()
    off = time.monotonic()
    lost = race.wait_for_lost(began)

    def boot() -> None:
        race.faulty = race.start_ros_kart(race.reboot(machine))

    return Noticed(monotonic(lost) - off, None, *come_back(race, began, boot))


def steal_address(race: NetworkRace) -> Noticed:
    """
    Have a second machine connect from the faulty kart's address, and leave; see ``cut``.

    :raises AssertionError: if what must happen does not in time.
    """
    began = under_way(race)
    twin = race.track.machine('thief', race.machine.address, twin=1)
    stolen = time.monotonic()
    with race.connect(twin) as thief:
        lost = race.wait_for_lost(began)
        stopped = race.wait_for_stopped(began)
        thief.wait_for_frames(3)
        assert [state for _, state in thief.changes] == [RaceState.RED_RED]
    times = race.machine.times()
    assert times.arrived is not None

    def leave() -> None:
        race.track.remove(twin)
        # As a machine does that joins the WLAN again: ask again who has race control's address,
        # and thereby tell who has its own. Else the thief is remembered for up to a minute.
        race.machine.ip('neigh flush dev eth0')

    return Noticed(
        monotonic(lost) - stolen, stopped - times.arrived, *come_back(race, began, leave)
    )


@dataclasses.dataclass
class Stretch:
    """
    A stretch of racing over a bad network.

    :ivar seconds: how long the race was in GREEN_GREEN, s.
    :ivar lost: why race control lost the faulty kart, each time.
    :ivar stopped: how often the faulty kart obeyed RED_RED.
    :ivar back: from each loss to the new connection, s.
    :ivar gaps: the times between the frames of the good kart, whose network is as bad, s.
    """

    seconds: float = 0.0
    lost: list[str] = dataclasses.field(default_factory=list)
    stopped: int = 0
    back: list[float] = dataclasses.field(default_factory=list)
    gaps: list[float] = dataclasses.field(default_factory=list)


def race_in_bad_air(race: NetworkRace, loss: float, delay: float, seconds: float) -> Stretch:
    """
    Race for so long while frames to and from both karts get lost and come late.

    After each loss the air is good for as long as it takes to start the race anew.

    :param loss: the share that is lost in each direction.
    :param delay: in each direction, s.
    """
    machines = (race.machine, race.good_machine)
    stretch = Stretch()
    while stretch.seconds < seconds:
        race.green()
        states = len(race.faulty.team.states)
        for machine in machines:
            machine.air(loss, delay)
        began = time.monotonic()
        while time.monotonic() - began < seconds - stretch.seconds:
            time.sleep(0.2)
            gone = [each for kart in (FAULTY, GOOD) for each in _lost(race, kart, began)]
            if gone or RaceState.RED_RED in race.faulty.team.states[states:]:
                break
        lost_after = time.monotonic()
        stretch.seconds += lost_after - began
        times = [at for at in race.good.times if at >= began]
        stretch.gaps += [late - early for early, late in itertools.pairwise(times)]
        _come_back(race, stretch, began, states)
        for machine in machines:
            machine.air()
        # For as long as race control may wait for an answer: a kart may be lost only now.
        time.sleep(2.0)
        if not race.is_connected(GOOD):
            race.reconnect_good()
    return stretch


def _lost(race: NetworkRace, kart: int, since: float) -> list[msg.RaceEvent]:
    return race.events(msg.RaceEvent.DISCONNECTED, kart, since)


def _come_back(race: NetworkRace, stretch: Stretch, began: float, states: int) -> None:
    """Wait, in the bad air, until whoever was lost is back."""
    if RaceState.RED_RED in race.faulty.team.states[states:]:
        stretch.stopped += 1
        race.wait_for_lost(began)
    for event in _lost(race, FAULTY, began)[:1]:
        stretch.lost.append(event.text)
        stretch.back.append(monotonic(race.wait_for_back(monotonic(event))) - monotonic(event))
    stretch.lost += [event.text for event in _lost(race, GOOD, began)]
