# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""There is one race control: each asks for its address all its life, and two never command."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import contextlib
import itertools
import os
import pathlib
import re
import select
import shutil
import subprocess
import sys
import time

from evgp_node.network_cards import cards
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.official import Official
from evgp_testing.part import PATIENCE
from evgp_testing.process import Process
from evgp_testing.race_control import RaceControl, settings, write_roster
from evgp_testing.usage import family
import pytest
from rig.masters import KARTS_CARD, Masters, NUMBERS
from rig.needs import cannot_run
from rig.networks import Namespace, need_networks, RACE_CONTROL

UNIT = pathlib.Path(__file__).resolve().parents[1] / 'src/evgp_rcs/config/evgp-rcs.service'

NOTICED_WITHIN = 2.0
"""Maximum time from the cable's return to the end of one of two race controls, in seconds."""


@pytest.fixture
def masters(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> Masters:
    """Return the machines; skip where none can be made, but not where all tests must run."""
    need_networks()
    return Masters(parts, tmp_path)


def says_why_it_ended(official: Official) -> str:
    """Return what the last alert on a screen says of the other machine."""
    race = official.wait_for_race(
        lambda race: any(each.kind == msg.Alert.PART_FAILED for each in race.alerts),
        'the alert that race control ends',
    )
    return next(each.text for each in race.alerts if each.kind == msg.Alert.PART_FAILED)


def first_end(servers: Sequence[int]) -> float:
    """Return when the first of these kart servers, open by their process, ended (monotonic, s)."""
    ended, _, _ = select.select(servers, [], [], PATIENCE)
    assert ended, 'two race controls, and none ends'
    return time.monotonic()


def hardware_of(machine: Namespace) -> str:
    """Return the hardware address of a machine's interface on the karts' network."""
    with machine.inside():
        return next(each.hardware for each in cards() if each.name == KARTS_CARD)


@contextlib.contextmanager
def two_machines() -> Iterator[tuple[Namespace, Namespace]]:
    """Give two machines on one network; the first one has a second cable to it."""
    with Namespace() as own, Namespace() as other, Namespace() as switch:
        switch.ip('link add karts type bridge', 'link set karts up')
        plugs = ((own, 'eth0', 2), (own, 'eth1', 3), (other, 'eth0', 4))
        for at, (machine, name, last) in enumerate(plugs):
            switch.ip(
                f'link add cable{at} type veth peer name {name} netns {machine.path}',
                f'link set cable{at} master karts up',
            )
            machine.ip(f'addr add 10.77.0.{last}/24 dev {name}', f'link set {name} up')
        yield own, other


MEETINGS = [*itertools.product((False, True), RaceState, RaceState)][::11]
"""Whether the old race control sees its cable go, what it is in, and the new one: each state once,
of 50 ways to meet."""

WORST = (False, RaceState.IN_GARAGE, RaceState.GREEN_GREEN)
"""The old one allows humans, the karts race, and it saw no cable go."""


@pytest.mark.parametrize(
    'met',
    [
        pytest.param(WORST, marks=pytest.mark.early, id='the worst'),
        *(pytest.param(each, marks=pytest.mark.long) for each in MEETINGS),
    ],
)
def test_an_old_race_control_that_comes_back_in_any_state_loosens_no_kart_and_one_ends(
    masters: Masters,
    met: tuple[bool, RaceState, RaceState],
    record_property: Callable[[str, object], None],
) -> None:
    seen, old_state, new_state = met
    cut = masters.plug if seen else masters.reach
    old = masters.start(masters.first)
    old_official = masters.official(masters.first)
    old_official.wait_for_connected(*NUMBERS)
    old_official.bring_to(old_state, *NUMBERS)
    cut('first-karts', False)
    cut_at = time.monotonic()
    masters.spare.ip(f'addr add {RACE_CONTROL}/24 dev eth0')
    new = masters.start(masters.spare)
    new_official = masters.official(masters.spare)
    new_official.wait_for_connected(*NUMBERS)
    new_official.bring_to(new_state, *NUMBERS)
    masters.wait_for(new_state, cut_at)

    servers = [os.pidfd_open(each.kart_server_pid) for each in (old, new)]
    for each in servers:
        masters.stack.callback(os.close, each)
    back_at = time.monotonic()
    cut('first-karts', True)
    took = first_end(servers) - back_at
    texts = [says_why_it_ended(each) for each in (old_official, new_official)]
    assert [each.wait() for each in (old, new)] == [1, 1]
    time.sleep(1.0)  # what a kart is sent after that counts, too
    record_property('one of two ended within', f'{took:.2f} s')
    for number in NUMBERS:
        before, after = masters.sent(number, back_at)
        assert after <= {before, RaceState.RED_RED}, (number, before, after)
    assert all(RACE_CONTROL in text for text in texts), texts
    assert took < NOTICED_WITHIN


CHANGES = {
    'the address': (
        lambda masters: masters.first.ip(f'addr del {RACE_CONTROL}/24 dev eth0'),
        lambda masters: masters.first.ip(f'addr add {RACE_CONTROL}/24 dev eth0'),
    ),
    'a moment of the cable': (
        lambda masters: masters.switches.ip(
            'link set first-karts down', 'link set first-karts up'
        ),
        lambda masters: None,
    ),
    'the interface': (
        lambda masters: masters.switches.ip('link del first-karts'),
        lambda masters: masters.cable(masters.first, 'first', RACE_CONTROL),
    ),
}
"""What race control loses of its place on the karts' network, and how that comes back."""


def test_a_race_goes_to_red_red_when_its_address_or_its_interface_is_lost_and_is_followed(
    masters: Masters,
) -> None:
    control = masters.start(masters.first)
    official = masters.official(masters.first)
    for lost, (lose, give_back) in CHANGES.items():
        official.wait_for_connected(*NUMBERS)
        official.bring_to(RaceState.GRID_ACTIVE, *NUMBERS)
        lose(masters)
        official.wait_for_race(lambda race: state_of(race.state) is RaceState.RED_RED, lost)
        give_back(masters)
    official.wait_for_connected(*NUMBERS)

    # It goes on asking there.
    masters.spare.ip(f'addr add {RACE_CONTROL}/24 dev eth0')
    assert control.wait() == 1
    assert hardware_of(masters.spare) in says_why_it_ended(official)


# ----- with what rights -----------------------------------------------------------------------

PLAIN = (shutil.which('setpriv') or 'setpriv', '--securebits', '+noroot')
"""As a user without rights."""

CAUTIOUS = (*PLAIN, '--no-new-privs')
"""So that no program that it starts has more, either."""

ASKING = """
import sys
from evgp_rcs.spare import neighbours
neighbours.ASK_FOR = 1.0
for _ in sys.stdin:
    print(neighbours.ask(sys.argv[1], 'eth0'), flush=True)
"""


@contextlib.contextmanager
def asking(
    machine: Namespace, under: tuple[str, ...], **environment: str
) -> Iterator[Callable[[], str]]:
    """Yield a function that has a program ask there who has race control's address."""
    with machine.inside():
        program = subprocess.Popen(
            [*under, sys.executable, '-c', ASKING, RACE_CONTROL],
            env={**os.environ, **environment},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
    assert program.stdin is not None
    assert program.stdout is not None
    with program, program.stdin as words:
        said = program.stdout

        def ask() -> str:
            print(file=words, flush=True)
            return said.readline().removesuffix('\n')

        yield ask


def rights_of(pid: int) -> int:
    """Return the capabilities that a process has, or hands on."""
    text = pathlib.Path(f'/proc/{pid}/status').read_text(encoding='ascii')
    return max(int(each, 16) for each in re.findall(r'Cap(?:Prm|Eff|Amb):\s+(\w+)', text))


def need_arping() -> None:
    """Skip the test where there is no arping, and say so; not where all tests must run."""
    if shutil.which('arping') is None:
        cannot_run('there is no arping (apt-get install iputils-arping)')


def under_the_unit() -> tuple[str, ...]:
    """Return what gives a program the rights that the shipped unit gives it."""
    words = UNIT.read_text(encoding='utf-8').split()
    given = [word.partition('=')[2] for word in words if word.startswith('AmbientCapabilities=')]
    caps = ''.join(f',+{each.removeprefix("CAP_").lower()}' for each in given)
    assert 'NoNewPrivileges=yes' in words
    return (*CAUTIOUS, f'--inh-caps=-all{caps}', f'--ambient-caps=-all{caps}')


@pytest.mark.parametrize(
    ('under', 'path', 'knows'),
    [
        pytest.param((), '/nowhere', True, id='raw socket'),
        pytest.param(PLAIN, '', True, id='arping'),
        pytest.param(PLAIN, '/nowhere', False, id='neither'),
        pytest.param(CAUTIOUS, '', False, id='arping that may not ask'),
        pytest.param('unit', '/nowhere', True, id='the shipped unit'),
    ],
)
def test_a_raw_socket_or_arping_asks_and_no_interface_of_this_machine_is_a_rival_or_hides_one(
    under: tuple[str, ...] | str, path: str, knows: bool
) -> None:
    need_networks()
    if not path:
        need_arping()
    with two_machines() as (own, other):
        words = under if isinstance(under, tuple) else under_the_unit()
        with asking(own, words, **({'PATH': path} if path else {})) as ask:
            for answers in (False, True):
                if answers:
                    other.ip(f'addr add {RACE_CONTROL}/24 dev eth0')
                said = ask()
                assert (said == '') == (knows and not answers), said
                assert (hardware_of(other) in said) == (knows and answers), said
            other.ip(f'addr del {RACE_CONTROL}/24 dev eth0')
            own.ip(f'addr add {RACE_CONTROL}/24 dev eth0')  # for which eth1 answers as well
            for turn in range(4 * knows):
                if turn:
                    other.ip(f'addr replace {RACE_CONTROL}/24 dev eth0')
                said = ask()
                # arping hears the first answer only, which may be this machine's own.
                found = hardware_of(other) in said, said == ''
                assert found in [(turn > 0, turn == 0), *[(False, False)] * (not path)], said


def test_where_it_cannot_be_known_no_proof_of_an_orderly_end_is_believed_and_nothing_is_hidden(
    masters: Masters,
) -> None:
    official = masters.official(masters.first)
    control = masters.start(masters.first, under=CAUTIOUS)
    masters.wait_for(RaceState.RED_RED)
    official.wait_for_race(lambda race: state_of(race.state) is RaceState.RED_RED, 'RED_RED')
    assert 'arping' in control.output


def test_of_its_right_to_ask_race_control_leaves_nothing_to_the_processes_that_strangers_reach(
    domain: int, tmp_path: pathlib.Path
) -> None:
    given = settings(tmp_path, write_roster(tmp_path, [1]))
    under = under_the_unit()
    with Process('evgp_rcs', 'rcs_node', domain, given, under=under) as control:
        control.wait_for_line('listens for')
        own, *others = family(control.pid)
        assert rights_of(own) != 0
        assert len(others) == 2
        assert [rights_of(each) for each in others] == [0, 0]


def test_make_run_on_a_machine_without_a_network_warns_of_no_second_race_control(
    parts: contextlib.ExitStack, domain: int, tmp_path: pathlib.Path
) -> None:
    need_networks()
    with parts.enter_context(Namespace()).inside():
        control = parts.enter_context(
            RaceControl(tmp_path, domain, [1], parameters={'address': '0.0.0.0'})
        )
    assert 'race control' in control.output
    assert '[WARN]' not in control.output
