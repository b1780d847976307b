# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The rehearsal with the real race control: karts over TCP, the page, and one kart's race."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import contextlib
import functools
import json
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import time
from typing import Any
import urllib.error
import urllib.request

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rehearsal.event import RefusedError, Rehearsal
from evgp_rehearsal.field import TICK_LENGTH
from evgp_rehearsal.incidents import INCIDENTS
from evgp_rehearsal.plan import Cue, Plan
from evgp_rehearsal.rehearse import main
from evgp_testing.part import PATIENCE
from evgp_testing.process import executable, Program
import pytest

DOCS = pathlib.Path(__file__).parents[1] / 'docs'


@pytest.fixture(scope='module')
def rehearsal(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rehearsal]:
    """Return a rehearsal, which may have seen others' incidents."""
    with Rehearsal(Plan(seed=2), tmp_path_factory.mktemp('rehearsal')) as each:
        yield each


JSON = {'Content-Type': 'application/json'}
KARTS = [*Plan().numbers]


def ask(url: str, data: dict[str, Any] | None = None, headers: Mapping[str, str] = JSON) -> str:
    body = None if data is None else json.dumps(data).encode()
    request = urllib.request.Request(url, body, headers)  # noqa: S310 - of our own page
    with urllib.request.urlopen(request, timeout=10) as answer:  # noqa: S310
        return str(answer.read().decode())


def wait(rehearsal: Rehearsal, seconds: float) -> None:
    with rehearsal.lock:
        until = rehearsal.field.tick + round(seconds / TICK_LENGTH)
        assert rehearsal.lock.wait_for(lambda: rehearsal.field.tick >= until, PATIENCE)


def test_a_rehearsal_that_begins_in_red_with_an_open_track_gets_to_the_garage_and_closes_it(
    rehearsal: Rehearsal,
) -> None:
    official = rehearsal.official
    official.wait_for_connected(*rehearsal.plan.numbers)
    official.command('all_kill')
    official.command('set_track_open', open=True, no_race_anywhere=True)
    official.wait_for_race(lambda race: race.track.open, 'the track open')
    rehearsal.gather()
    race = official.wait_for_race(lambda race: not race.track.open, 'the track closed')
    assert state_of(race.state) is RaceState.IN_GARAGE


def test_the_debrief_says_that_officials_sent_karts_to_a_person_on_the_track(
    rehearsal: Rehearsal,
) -> None:
    official, before = rehearsal.official, len(rehearsal.took)
    rehearsal.gather()
    official.bring_to(RaceState.GREEN_GREEN)
    # The script's incident of the grid waits for the next one, and holds up none of the race.
    rehearsal.cues = [Cue('not_ready', 0.0), Cue('person_on_track', 0.0)]
    official.wait_until_polled(lambda: rehearsal.present is not None, 'every kart races')
    rehearsal.cues = []
    official.command('all_kill', official='Anna')
    official.wait_for_acks(RaceState.RED_RED, *rehearsal.plan.numbers)
    official.bring_to(RaceState.IN_GARAGE)
    official.command('grid_active', official='Anna', track_clear=True)
    rehearsal.mend()
    rehearsal.wait_for_end(before)
    told = '\n'.join(rehearsal.debriefs()[before])
    (grid,) = re.findall(r'^.* Anna sent GRID_ACTIVE: .*$', told, re.MULTILINE)
    assert grid.endswith(' - WITH A PERSON ON THE TRACK')
    assert 'a person is off the track' in told


def test_a_race_of_other_karts_gets_no_command_and_race_control_that_ends_unasked_comes_back(
    rehearsal: Rehearsal,
) -> None:
    official, ended = rehearsal.official, rehearsal.control
    official.wait_for_connected(*rehearsal.plan.numbers)
    assert official.race is not None
    official.race.karts[0].team = 'Purdue'
    official.race.karts[0].address = '192.168.1.101'
    with pytest.raises(RefusedError):
        rehearsal._check_own(official.race)

    ended.close()
    official.wait_until_polled(lambda: rehearsal.control is not ended, 'another race control')
    official.race = None
    official.wait_for_connected(*rehearsal.plan.numbers)


def test_what_a_rehearsal_prints_starts_and_stops_its_race_and_its_page_lets_incidents_begin() -> (
    None
):
    """
    The debrief says how long karts moved after ALL KILL.

    The rehearsal's window cannot open, which the terminal says.
    """
    command = [sys.executable, '-m', 'evgp_rehearsal.rehearse']
    nowhere = {**os.environ, 'DISPLAY': ':64999', 'WAYLAND_DISPLAY': '', 'BROWSER': 'true'}
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=nowhere) as rehearsal,
        contextlib.ExitStack() as stack,
    ):
        stack.callback(rehearsal.terminate)  # also where it fails before its Ctrl-C
        assert rehearsal.stdout is not None
        printed = []
        for line in rehearsal.stdout:
            printed.append(line)
            if line.startswith('Ctrl-C'):
                break
        found = re.search(r'http://\S+/', ''.join(printed))
        assert found is not None

        page = found[0]

        def press(**what: Any) -> str:
            return str(json.loads(ask(f'{page}do', what))['told'])

        def shown() -> dict[str, Any]:
            state: dict[str, Any] = json.loads(ask(f'{page}state'))
            return state

        until = time.monotonic() + 2 * PATIENCE

        def wait_until(found: Callable[[], object]) -> None:
            while not found():
                assert time.monotonic() < until, shown()
                time.sleep(TICK_LENGTH)

        def is_in(state: str) -> bool:
            return bool(shown()['race'] == state)

        def are_ready() -> bool:
            state = shown()
            in_garage = state['race'] == 'IN_GARAGE'
            return all(
                each['connected' if in_garage else 'acknowledged'] for each in state['karts']
            )

        def wait(seconds: float) -> None:
            ends = shown()['time'] + seconds
            wait_until(lambda: shown()['time'] >= ends)

        assert press(do='inject', incident='msr_needed')  # not in the garage
        lines = re.findall(r'ROS_DOMAIN_ID=(\d+) make ctl ARGS=(.+)', ''.join(printed))
        states = 'IN_GARAGE', 'GRID_ACTIVE', 'GREEN_GREEN', 'RED_RED'
        for (domain, arguments), state in zip(lines, states, strict=True):
            words = shlex.split(arguments)[0].split()
            once = ['--once'] if words == ['watch'] else []
            ctl = [executable('evgp_rcs_console', 'rcs_ctl'), *words, *once]
            environment = {**os.environ, 'ROS_DOMAIN_ID': domain}
            wait_until(are_ready)
            assert not subprocess.run(ctl, env=environment).returncode
            wait_until(functools.partial(is_in, state))
            if state == 'GREEN_GREEN':
                wait_until(lambda: not press(do='inject', incident='msr_needed', kart=3))
                assert [kart['number'] for kart in shown()['karts'] if kart['connected']] == KARTS
                press(do='pause')
                at = shown()['time']
                assert shown()['paused']
                assert shown()['time'] <= at + 2 * TICK_LENGTH
                press(do='pause')
        # No page of the internet can press a button.
        for headers in ({'Host': 'evil.example', **JSON}, {'Content-Type': 'text/plain'}):
            with pytest.raises(urllib.error.HTTPError):
                ask(f'{page}do', {'do': 'msr'}, headers)
        wait(5.0)
        press(do='msr')
        wait(3.0)
        press(do='mend')
        order = f'the rule book: {INCIDENTS["msr_needed"].order}'
        for line in rehearsal.stdout:
            printed.append(line)
            if order in line:
                break
        assert order in printed[-1]  # as soon as it has ended
        debrief = ask(f'{page}debrief')
        assert debrief.startswith('msr_needed (kart 3): a kart no longer obeys anything\n')
        assert 'radio: Marshal, post 2: kart 3 is out of control!' in debrief
        assert 'sent ALL_KILL: RED_RED sent to karts 1, 2, 3, 4, 5, 6' in debrief
        assert 'the MSR is used' in debrief
        (moved,) = re.findall(r'^  moved after RED_RED at .*$', debrief, re.MULTILINE)
        took = {int(kart): float(s) for kart, s in re.findall(r'kart (\d) for (\S+) s', moved)}
        assert [*took] == KARTS
        assert took.pop(3) > 5.0  # of the field, until the MSR, and as long as it then brakes
        assert max(took.values()) < 3.0  # the field's karts brake by 4 m/s2 at least
        rehearsal.send_signal(signal.SIGINT)
        at_the_end = rehearsal.stdout.read()
        why = r'Qt for Python|could not connect to display'
        assert re.search(why, ''.join([*printed, at_the_end])), printed
        assert debrief in at_the_end
        assert rehearsal.wait() == 0


def race_control_is_back(rehearsal: Rehearsal, name: str, stack: contextlib.ExitStack) -> None:
    """Return once the race control that an incident has ended is there again."""
    ended, official = rehearsal.control, rehearsal.official
    if name == 'laptop_dies':
        assert rehearsal.dead.wait(PATIENCE)
        words = ['127.0.0.1', 'lo', '--port', str(ended.port)]
        command, home = [executable('evgp_rcs', 'rcs_takeover'), *words], rehearsal.folder
        taken = Program('takeover', command, rehearsal.domain, {'ROS_HOME': str(home)}, end='TERM')
        stack.enter_context(taken)
    else:
        official.wait_until_polled(lambda: rehearsal.control is not ended, 'another race control')
    official.race = None
    official.wait_for_connected(*rehearsal.plan.numbers)


@pytest.mark.long
@pytest.mark.parametrize('name', INCIDENTS)
def test_each_incident_happens_with_the_real_race_control_and_is_debriefed(
    name: str, tmp_path: pathlib.Path
) -> None:
    plan = Plan(laps=1 if name == 'slow_leader' else 6, seed=2)
    with Rehearsal(plan, tmp_path) as rehearsal, contextlib.ExitStack() as stack:
        official = rehearsal.official
        rehearsal.gather()
        official.bring_to(INCIDENTS[name].state)
        official.wait_until_polled(lambda: rehearsal.can_begin(name), f'{name} can begin')
        took = rehearsal.inject(name)
        wait(rehearsal, 1.0)
        if name in ('race_control_crash', 'laptop_dies'):
            race_control_is_back(rehearsal, name, stack)
        official.command('all_kill', official='Anna')
        rehearsal.use_msr()
        wait(rehearsal, 3.0)
        rehearsal.mend()
        rehearsal.wait_for_end(0)
        (lines,) = rehearsal.debriefs()
    assert lines[0].startswith(f'{name} (kart {took.kart})' if took.kart else name)
    assert any('Anna sent ALL_KILL' in line for line in lines), lines
    assert not any('still moving' in line for line in lines), lines
    assert lines[-1].endswith(INCIDENTS[name].order)


@pytest.mark.parametrize(('option', 'value'), [('--debrief', '/nowhere/it'), ('--karts', '61')])
def test_a_wrong_setting_is_refused_before_anybody_rehearses(
    option: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([option, value])
    assert ended.value.code == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert (value if option == '--debrief' else option) in said


def test_the_rule_books_order_is_in_the_rules_where_the_table_says() -> None:
    rules = (DOCS / 'rules.md').read_text(encoding='utf-8')
    headings = re.findall(r'^#+ (.*?)(?: \(§.*\))?$', rules, re.MULTILINE)
    for row in INCIDENTS.values():
        (places,) = re.findall(r'\(([^()]*)\)$', row.order)
        for place in places.split('; '):
            section, _, what = place.partition(': ')
            assert section in headings or section.startswith(('§', 'docs/')), (row.name, place)
            # A name of an alert or a state is found as it stands.
            assert not what.isupper() or what in rules, (row.name, place)
