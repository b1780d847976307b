# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
`inspect_kart` as inspectors run it: a program, a terminal, real karts with and without ROS.

What `survey_network` has in common with it is here, too.
"""

from __future__ import annotations

from collections.abc import Callable
import concurrent.futures
import contextlib
import functools
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time
from typing import Any

from evgp_inspection.cli import main
from evgp_inspection.traces import Kind
from evgp_rcs.ros.settings import read_settings
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.inputs import Setup
from evgp_rcs.rules.race import Command
from evgp_testing.base import SimulatedBase
from evgp_testing.domains import Domain, free_port
from evgp_testing.kart import Bridge
from evgp_testing.part import PATIENCE
from evgp_testing.process import Process, Program
from evgp_testing.race_control import address_of
import pytest
from rig.needs import cannot_run
from rig.terminal import Terminal
from test_figures import Declared
from test_wire_document import client_at

ROOT = pathlib.Path(__file__).parents[1]
PROGRAMS = [sys.executable, str(ROOT / 'src/evgp_inspection')]
INSPECT = [*PROGRAMS, 'kart']

SHORT = ['--listen', '127.0.0.1', '--port', '0', '--watch', '0.7', '--drive', '0.5']
SHORT += ['--warning', '0', '--fast', '0.5', '--hold', '1.0', '--long', '3']
SHORT += ['--dwell', '1', '--away', '2']
UNATTENDED = ['--unattended', '--word', 'ready']

ATTEMPTS = 5
"""Maximum number of inspections of the same, while other programs hold this computer up."""


def port_of(program: Program) -> int:
    return int(program.wait_for_line(r'on port (\d+)')[1])


def report_in(folder: pathlib.Path) -> dict[str, Any]:
    (path,) = folder.glob('*.json')
    report: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    return report


def those(report: dict[str, Any], verdict: str) -> dict[str, str]:
    return {each['clause']: each['why'] for each in report['checks'] if each['verdict'] == verdict}


def undisturbed(
    folder: pathlib.Path, inspect: Callable[[pathlib.Path, contextlib.ExitStack], int]
) -> tuple[dict[str, Any], int]:
    """
    Inspect, again where the report says that this computer was held up, and return the report.

    :param inspect: inspects, with its reports in this folder, and returns the exit code.
    """
    for attempt in range(ATTEMPTS):
        again = folder / f'{attempt}'
        with contextlib.ExitStack() as parts:
            code = inspect(again, parts)
        report = report_in(again)
        seen = [event for each in report['checks'] for event in each['evidence']]
        if not any(event['what'] == Kind.HELD_UP.value for event in seen):
            return report, code
    pytest.fail(f'This computer was busy with something else {ATTEMPTS} times.')


def start_bridge(
    parts: contextlib.ExitStack, program: Program, domain: int, folder: pathlib.Path
) -> None:
    """Start our bridge with the stack of README, and the bridge again when it was killed."""
    port = port_of(program)

    def start_it() -> Bridge:
        remap = ('-r', '~/odom:=/odom')
        return parts.enter_context(Bridge(domain, port, address_of(1), arguments=remap))

    bridge = start_it()
    parts.enter_context(SimulatedBase(domain, odometry_rate=20.0))
    stack = parts.enter_context(Process('evgp_kart_bridge', 'shortest_stack', domain))
    for part, killed in (('bridge', bridge), ('stack', stack)):
        (folder / part).write_text(f'{killed.pid}', encoding='utf-8')
    # An inspection that this computer holds up may end before it kills the bridge.
    while bridge.process.poll() is None and program.process.poll() is None:
        time.sleep(0.1)
    if program.process.poll() is None:
        start_it()  # as make bridge does


def start_kart(parts: contextlib.ExitStack, command: list[str], udp: int = 0) -> None:
    """Start a kart that writes its speed to descriptor 9, which is UDP, or nothing."""
    to = f'/dev/udp/127.0.0.1/{udp}' if udp else '/dev/null'
    kart = ['bash', '-c', f'exec 9> {to}; exec "$@"', 'bash', *command]
    parts.callback(Program('kart', kart).kill)


def client(port: int, folder: pathlib.Path) -> list[str]:
    """Return the client of docs/wire.md, with wheels."""
    wheels = """
import os
import threading
wheels = {'speed': 0.0, 'target': 0.0, 'braking': 0.2}


def turn():
    while True:
        change = wheels['target'] - wheels['speed']
        wheels['speed'] += max(-wheels['braking'], min(0.2, change))
        os.write(9, b'%f' % wheels['speed'])
        time.sleep(0.02)


def drive(state):
    wheels['target'] = 5.0 if state == b'GREEN_GREEN' else 0.0
    wheels['braking'] = 0.08 if state == b'RED_FLAG' else 0.2
    return (wheels['speed'] > 0) == (state == b'GREEN_GREEN')


threading.Thread(target=turn, daemon=True).start()
"""
    begin = '\nwhile True:\n    drive('
    return [sys.executable, '-c', client_at(port).replace(begin, f'{wheels}{begin}')]


def c_kit(port: int, folder: pathlib.Path) -> list[str]:
    """Compile kit/c's example for POSIX."""
    compiler = next(filter(None, map(shutil.which, ('gcc', 'clang'))), None)
    if compiler is None:
        cannot_run('there is neither gcc nor clang')
    before, turn, after = (
        (ROOT / 'kit/c/examples/posix.c')
        .read_text(encoding='utf-8')
        .partition('static void wait_for_turn(void)\n{\n')
    )
    assert turn, 'the example has another loop'
    source, program = folder / 'posix.c', folder / 'posix'
    tell = '    (void)dprintf(9, "%f\\n", speed);\n'
    source.write_text(f'{before}{turn}{tell}{after}', encoding='utf-8')
    command = [compiler, '-std=c99', '-Wall', '-Werror', f'-I{ROOT / "kit/c"}', str(source)]
    subprocess.run([*command, '-o', str(program)], check=True)
    return [str(program), '127.0.0.1', f'{port}', address_of(1)]


UDP = ['--odometry', 'udp:{udp}']
ROS = ['--odometry', 'ros:/odom']
ROS += ['--kill-bridge', "kill -9 $(cat '{folder}/bridge')"]
ROS += ['--kill-stack', "kill -9 $(cat '{folder}/stack')"]

KILLED = {'K-3E-09', 'K-3E-10'}
"""The clauses of a kart whose wheels are turned by the very program that is to be killed."""


GOOD: dict[str, tuple[Callable[[int, pathlib.Path], list[str]] | None, list[str], set[str]]] = {
    'the bridge': (None, ROS, set()),
    'the client of wire.md': (client, UDP, KILLED),
    'the kit in C': (c_kit, UDP, KILLED),
    'only a race': (client, [*UDP, '--race'], set()),
}
"""Karts, None for our bridge; options; clauses that cannot be judged."""


@pytest.mark.early
@pytest.mark.timeout(400)
@pytest.mark.parametrize(
    ('karts', 'busy'),
    [
        pytest.param([*GOOD], 0, id='all'),
        # With a program on every core that does nothing but use it.
        pytest.param(
            ['the bridge'],
            os.cpu_count() or 1,
            marks=[pytest.mark.long, pytest.mark.alone],
            id='bridge-busy',
        ),
    ],
)
def test_a_good_kart_with_or_without_ros_passes_every_clause_but_that_nobody_kills_it(
    karts: list[str], busy: int, tmp_path: pathlib.Path
) -> None:
    def inspect(name: str, folder: pathlib.Path, parts: contextlib.ExitStack) -> int:
        for _ in range(busy):
            parts.callback(Program('busy', [sys.executable, '-c', 'while True: pass']).kill)
        domain, udp = parts.enter_context(Domain()).number, free_port()
        kart, words, _ = GOOD[name]
        given = [each.format(udp=udp, folder=tmp_path) for each in words]
        command = [*INSPECT, *SHORT, '--report', str(folder), *UNATTENDED, *given]
        program = parts.enter_context(Program(f'inspect_kart: {name}', command, domain))
        if kart is None:
            start_bridge(parts, program, domain, tmp_path)
        else:
            start_kart(parts, kart(port_of(program), tmp_path), udp)
        program.process.wait(200)  # longer than other programs' ends
        return program.wait()

    # An inspection mostly waits, so all karts are inspected at the same time.
    with concurrent.futures.ThreadPoolExecutor(len(karts)) as pool:
        inspections = {
            name: pool.submit(undisturbed, tmp_path / name, functools.partial(inspect, name))
            for name in karts
        }
    for name, inspection in inspections.items():
        report, code = inspection.result()
        not_judged = GOOD[name][2]
        told = name, report['remarks']
        assert those(report, 'fail') == {}, told
        assert set(those(report, 'not judged')) == not_judged, told
        assert (report['verdict'], code) == (('not judged', 2) if not_judged else ('pass', 0))
        assert ('not an inspection' in ' '.join(report['remarks'])) is (name == 'only a race')


class Inspector(Terminal):
    """An inspector who has typed the word, and gives one answer to all that is asked."""

    def __init__(
        self, parts: contextlib.ExitStack, folder: pathlib.Path, *words: str, answer: str = 'y'
    ) -> None:
        self._answer, self._answered = answer, 0
        super().__init__([*INSPECT, *SHORT, '--report', str(folder), *words])
        parts.callback(self.close)
        self.press('ready\n')
        self.port = int(self.wait_for(r'on port (\d+)')[1])

    def _read(self) -> bool:
        more = super()._read()
        asked = len(re.findall(r'\?  .*?\?  y/n ', self.shown))
        self.press(self._answer * (asked - self._answered))
        self._answered = asked
        return more


@pytest.mark.parametrize('keys', ['no\n', '\x04'])
@pytest.mark.parametrize(
    ('program', 'asked'), [('kart', 'OFF THE GROUND'), ('survey', 'NO STOP IS IN FORCE')]
)
def test_nothing_listens_before_somebody_has_typed_the_word(
    program: str, asked: str, keys: str, parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    terminal = Terminal([*PROGRAMS, program, '--port', '0', '--report', str(tmp_path)])
    parts.callback(terminal.close)
    terminal.wait_for(asked)
    terminal.press(keys)
    assert terminal.end() == 2
    assert 'on port' not in terminal.shown


def test_an_inspector_who_sees_the_wheels_turn_after_a_stop_fails_the_kart(
    parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    words = ['--only', 'K-3A-10', '--inspector', 'Ada <&>', '--number', '7']
    terminal = Inspector(parts, tmp_path, *words, answer='n')
    start_kart(parts, client(terminal.port, tmp_path))
    assert terminal.end() == 2
    report = report_in(tmp_path)
    assert set(those(report, 'fail')) == {'K-3A-10'}
    assert report['inspector'] == 'Ada <&>'
    (page,) = tmp_path.glob('kart-7-*.html')
    assert 'Ada &lt;&amp;&gt;' in page.read_text(encoding='utf-8')


def test_a_kart_without_an_inspection_stays_out_of_the_race(tmp_path: pathlib.Path) -> None:
    roster = tmp_path / 'inspected.yaml'
    roster.write_text(
        """\
karts:
- {number: 1, team: T, address: 127.0.1.1, in_race: false}
- {number: 2, team: T, address: 127.0.1.2, in_race: false, inspected: 2026-05-01}
""",
        encoding='utf-8',
    )
    node: Any = Declared({'roster': str(roster), 'require_inspection': True})
    begin = read_settings(node)
    race = Setup(begin.roster.karts, begin.times, begin.roster.heats, 0.0).race('')
    answers = [race.command(Command(CommandKind.JOIN_RACE, kart), 5.0).answer for kart in (1, 2)]
    assert [answer is not None and answer.success for answer in answers] == [False, True]


def test_the_space_bar_stops_the_kart_and_ends_the_inspection(
    parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    terminal = Inspector(parts, tmp_path, '--only', 'K-3A-05', '--drive', '60')
    start_kart(parts, client(terminal.port, tmp_path))
    terminal.wait_for('DRIVES NOW')
    began = time.monotonic()
    terminal.press(' ')
    terminal.wait_for('the kart reports a standstill')
    assert terminal.end() == 2
    assert time.monotonic() - began < PATIENCE


def test_an_inspection_whose_terminal_is_closed_leaves_its_report(
    parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    terminal = Inspector(parts, tmp_path)
    terminal.hang_up()
    assert terminal.process.wait(PATIENCE) == 2
    assert 'stopped' in ' '.join(report_in(tmp_path)['remarks'])


@pytest.mark.parametrize(
    'words',
    [
        ['kart', '--unattended'],
        ['kart', '--only', 'K-9'],
        ['kart', '--red-red', '-1'],
        ['kart', '--odometry', '/odom', *UNATTENDED],
        ['kart', '--odometry', 'udp:99999', *UNATTENDED],
        ['kart', '--odometry', 'udp:odom', *UNATTENDED],
        ['kart', '--port', '99999', *UNATTENDED],
        ['kart', '--kart-address', '300.1.1.1', *UNATTENDED],
        ['kart', '--report', '/dev/null', *UNATTENDED],
        ['survey', '--word', 'ready', '--report', '/dev/null/today'],
        ['survey'],  # nobody can type the word
        ['survey', '--word', 'yes'],
        ['survey', '--word', 'ready', '--listen', '192.0.2.1'],
        ['survey', '--word', 'ready', '--port', '99999'],
    ],
)
def test_a_wrong_use_is_told_and_nothing_begins(
    words: list[str], tmp_path: pathlib.Path, capfd: pytest.CaptureFixture[str]
) -> None:
    program, *rest = words
    try:
        code: object = main([program, '--port', '0', '--report', str(tmp_path), *rest])
    except SystemExit as ended:
        code = ended.code
    shown, told = capfd.readouterr()
    assert code == 2
    assert told
    assert 'invalid literal' not in told  # which tells nobody what to type
    assert 'on port' not in shown
    assert not list(tmp_path.iterdir())


def test_a_list_that_nobody_reads_to_its_end_ends_without_a_traceback() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer) as gone:  # noqa: PTH123 - to close it
        done = subprocess.run([*INSPECT, '--list'], stdout=gone, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (0, '')


@pytest.mark.parametrize(
    ('target', 'right', 'wrong'),
    [('inspect-kart', '--list', '--only K-9'), ('survey', '--version', '--silence -1')],
)
def test_make_ends_with_the_exit_code_of_the_program(target: str, right: str, wrong: str) -> None:
    for words, code in ((right, 0), (wrong, 2)):
        make = ['make', '-C', str(ROOT), target, f'ARGS={words}']
        assert subprocess.run(make, capture_output=True, check=False).returncode == code
