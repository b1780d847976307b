# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A spare machine takes race control's address over once the first is dead, and never before."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import pathlib
import subprocess
import sys
import threading
import time

from evgp_node import graph
from evgp_node.restarting import IN_THE_WAY
from evgp_protocol.frames import DEFAULT_PORT
from evgp_protocol.states import RaceState
from evgp_rcs.neighbours import ask, Found, Look
from evgp_rcs.spare import ORIGIN
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.part import PATIENCE
from evgp_testing.process import executable, Process, Program
from evgp_testing.race_control import RaceControl, settings, write_roster
from evgp_testing.wire_kart import Acknowledges, WireKart
import pytest
from rig.networks import kart_address, Namespace, need_networks, own_disk, RACE_CONTROL

NUMBERS = range(1, 11)
FIRST, SPARE = '10.78.0.1', '10.78.0.2'
"""The addresses on the officials' network."""


class Event:
    """
    Two machines, each with a cable to the karts' switch and one to the officials', and ten karts.

    :ivar last_word: what each kart was sent last, on whatever connection, and since when.
    """

    def __init__(self, stack: contextlib.ExitStack, folder: pathlib.Path) -> None:
        """Plug all cables in, and let the karts look for race control's address."""
        self.domain = stack.enter_context(Domain()).number
        self.first, self.spare, self.switches, self.karts = (
            stack.enter_context(Namespace()) for _ in range(4)
        )
        self._stack, self._folder = stack, folder
        self._disk_of_spare = folder / 'disk of the spare'
        for network in ('karts', 'officials'):
            self.switches.ip(f'link add {network} type bridge', f'link set {network} up')
        self._cable(self.first, 'first', RACE_CONTROL, FIRST)
        self._cable(self.spare, 'spare', '10.77.0.2', SPARE)
        self._cable(self.karts, 'all', *map(kart_address, NUMBERS[:1]))
        self.karts.ip(*(f'addr add {kart_address(n)}/24 dev eth0' for n in NUMBERS[1:]))
        self.links: dict[int, WireKart] = {}
        self._ended = threading.Event()
        for number in NUMBERS:
            kart = threading.Thread(target=self._drive, args=(number,))
            kart.start()
            stack.callback(kart.join)
        stack.callback(self._ended.set)

    def _cable(self, machine: Namespace, name: str, *addresses: str) -> None:
        networks = zip(('karts', 'officials'), addresses, strict=False)
        for at, (network, address) in enumerate(networks):
            self.switches.ip(
                f'link add {name}-{network} type veth peer name eth{at} netns {machine.path}',
                f'link set {name}-{network} master {network} up',
            )
            machine.ip(f'addr add {address}/24 dev eth{at}', f'link set eth{at} up')
        if len(addresses) == 2:
            machine.ip('route add 239.0.0.0/8 dev eth1')

    def _drive(self, number: int) -> None:
        """Be a kart: connect to the address, again and again."""
        while not self._ended.wait(0.2):
            with self.karts.inside(), contextlib.suppress(OSError):
                kart = WireKart(
                    kart_address(number),
                    DEFAULT_PORT,
                    Acknowledges.EACH_CHANGE,
                    RACE_CONTROL,
                    timeout=1.0,
                )
                self.links[number] = kart
                while not (kart.ended or self._ended.wait(0.05)):
                    if time.monotonic() - max([kart.opened, *kart.times[-1:]]) > 1.0:
                        break  # race control is silent, and a kart waits no longer
                kart.close()

    def plug(self, name: str, up: bool) -> None:
        """Plug a cable in at its switch, or out."""
        self.switches.ip(f'link set {name} {"up" if up else "down"}')

    def start_first(self, monkeypatch: pytest.MonkeyPatch) -> RaceControl:
        """Start race control on the first machine, with every kart connected, and copy it."""
        folder = self._folder / 'first'
        folder.mkdir()
        monkeypatch.setenv(graph.INTERFACE, FIRST)
        with self.first.inside():
            control = RaceControl(
                folder,
                self.domain,
                NUMBERS,
                parameters={'address': RACE_CONTROL, 'port': DEFAULT_PORT},
                addresses=kart_address,
                under=own_disk(self._folder / 'disk of the first'),
            )
        self._stack.enter_context(control)
        self.wait_for(RaceState.IN_GARAGE)
        return control

    def copy(self) -> None:
        """Copy as `make spare` does."""
        (self._folder / 'first' / 'rcs.yaml').write_text(
            '/**:\n  ros__parameters:\n    pause: 1.0\n'
        )
        folder = self._folder / 'first'
        subprocess.run(
            [
                *own_disk(self._disk_of_spare),
                *(executable('evgp_rcs', 'rcs_spare'), str(folder), '--once'),
                *('--record', str(folder / 'record.sqlite3')),
                *('--roster', 'karts.yaml', '--params', 'rcs.yaml'),
            ],
            env=self._environment(),
            check=True,
        )

    def take_over(self) -> Program:
        """Start a takeover on the spare."""
        with self.spare.inside():
            return self._stack.enter_context(
                Program(
                    'takeover',
                    [
                        *own_disk(self._disk_of_spare),
                        *(executable('evgp_rcs', 'rcs_takeover'), RACE_CONTROL, 'eth0'),
                    ],
                    self.domain,
                    {**self._environment(), graph.INTERFACE: SPARE},
                    end='TERM',
                )
            )

    def _environment(self) -> dict[str, str]:
        return {**os.environ, 'ROS_HOME': str(self._folder / 'ros')}

    def wait_for(self, state: RaceState, since: float = 0.0) -> float:
        """Return when the last kart was sent a state, by a connection younger than that."""
        ends = time.monotonic() + 2 * PATIENCE
        while time.monotonic() < ends:
            links = [each for each in list(self.links.values()) if each.opened >= since]
            if len(links) == len(NUMBERS) and all(each.state is state for each in links):
                return max(each.changes[-1][0] for each in links)
            time.sleep(0.02)
        raise AssertionError({n: (each.ended, each.changes) for n, each in self.links.items()})


@pytest.fixture
def event(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> Event:
    """Return the machines; skip where none can be made, but not where all tests must run."""
    need_networks()
    return Event(parts, tmp_path)


@pytest.mark.own_process
def test_a_spare_takes_over_and_sends_every_kart_red_red_and_ends_when_the_first_comes_back(
    event: Event,
    monkeypatch: pytest.MonkeyPatch,
    parts: contextlib.ExitStack,
    record_property: Callable[[str, object], None],
) -> None:
    control = event.start_first(monkeypatch)
    with event.first.inside():
        graph.bind_graph()
        official = Official(event.domain)
    parts.callback(official.close)
    official.wait_for_connected(*NUMBERS)
    official.bring_to(RaceState.GREEN_GREEN, *NUMBERS)
    official.command('kart/red_red', kart=3)
    event.copy()

    died_at = time.monotonic()
    event.plug('first-karts', up=False)
    event.plug('first-officials', up=False)
    control.lose_power()
    takeover = event.take_over()
    took = event.wait_for(RaceState.RED_RED, died_at) - died_at
    record_property('from the death to the last RED_RED', f'{took:.1f} s')
    print(f'{took:.1f} s from the death of the first to the last RED_RED')
    assert all(
        {state for _, state in kart.changes} == {RaceState.RED_RED}
        for kart in event.links.values()
    )
    assert took < 60.0

    event.plug('first-karts', up=True)
    assert takeover.wait() == 1, takeover.output
    assert all(kart.state is RaceState.RED_RED for kart in event.links.values())
    with event.spare.inside():
        left = subprocess.run(['ip', 'address'], capture_output=True, text=True, check=True)
    assert f'{RACE_CONTROL}/' not in left.stdout


@pytest.mark.own_process
@pytest.mark.parametrize(
    'cut',
    [
        pytest.param('', marks=pytest.mark.long),
        'first-karts',
        'first-officials',
        pytest.param('spare-karts', marks=pytest.mark.long),
    ],
)
def test_nothing_is_taken_over_while_the_first_answers_on_any_network_or_that_is_not_known(
    cut: str, event: Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    control = event.start_first(monkeypatch)
    event.copy()
    if cut:
        event.plug(cut, up=False)
    if cut == 'spare-karts':
        control.lose_power()

    takeover = event.take_over()

    assert takeover.wait() == IN_THE_WAY, takeover.output
    assert len(takeover.output.splitlines()) == 2
    if cut not in ('first-karts', 'spare-karts'):
        event.wait_for(RaceState.IN_GARAGE)


@pytest.mark.long
@pytest.mark.own_process
def test_a_machine_without_race_control_that_still_has_its_power_is_no_dead_one(
    event: Event, monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path
) -> None:
    """Its race control would start again, or was frozen and goes on."""
    control = event.start_first(monkeypatch)
    event.copy()
    (tmp_path / 'ros' / 'evgp_rcs' / 'spare' / ORIGIN).write_text(FIRST)
    control.lose_power()
    event.plug('first-karts', up=False)

    takeover = event.take_over()

    assert takeover.wait() == IN_THE_WAY, takeover.output
    assert FIRST in takeover.output


HOLDING = """
import ipaddress, sys
from evgp_rcs.takeover import held
with held(ipaddress.IPv4Interface('10.77.0.1/24'), 'lo'):
    print('held', flush=True)
    sys.stdin.read()
"""


def test_the_address_is_given_back_however_the_takeover_ends() -> None:
    need_networks()
    with Namespace() as machine, machine.inside():

        def has_it() -> bool:
            shown = subprocess.run(['ip', 'address'], capture_output=True, text=True, check=True)
            return f'{RACE_CONTROL}/' in shown.stdout

        with subprocess.Popen(
            [sys.executable, '-c', HOLDING], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline()
            assert has_it()
            holder.kill()
        ends = time.monotonic() + PATIENCE
        while has_it():
            assert time.monotonic() < ends
            time.sleep(0.02)


@pytest.mark.own_process
def test_race_control_does_not_start_where_another_machine_has_its_address(
    event: Event, tmp_path: pathlib.Path
) -> None:
    event.spare.ip(f'addr add {RACE_CONTROL}/24 dev eth0')
    roster = write_roster(tmp_path, NUMBERS, addresses=kart_address)
    with (
        event.first.inside(),
        Process(
            'evgp_rcs',
            'rcs_node',
            event.domain,
            {**settings(tmp_path, roster), 'address': RACE_CONTROL},
        ) as control,
    ):
        assert control.wait() == IN_THE_WAY
    (line,) = control.output.splitlines()
    assert RACE_CONTROL in line


def test_a_machine_with_two_interfaces_on_one_network_is_no_rival_of_itself() -> None:
    with contextlib.ExitStack() as stack:
        machine, switch = (stack.enter_context(Namespace()) for _ in range(2))
        switch.ip('link add karts type bridge', 'link set karts up')
        for at, address in enumerate((RACE_CONTROL, '10.77.0.2')):
            switch.ip(
                f'link add cable{at} type veth peer name eth{at} netns {machine.path}',
                f'link set cable{at} master karts up',
            )
            machine.ip(f'addr add {address}/24 dev eth{at}', f'link set eth{at} up')
        with machine.inside():
            assert ask(RACE_CONTROL, 'eth0', probes=1) == Look(Found.NOTHING)
            # The other interface has that address, but it is the same machine.
            assert ask('10.77.0.2', 'eth0', probes=1) == Look(Found.NOTHING)
