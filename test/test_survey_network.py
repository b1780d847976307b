# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""`survey_network` as it is run: a program, a terminal, karts on networks that fail."""

from __future__ import annotations

import contextlib
import pathlib
import re
import signal
import sys

from evgp_testing.process import Program
from rig.networks import kart_address, need_networks, RACE_CONTROL, Track
from rig.terminal import Terminal

ROOT = pathlib.Path(__file__).parents[1]
SURVEY = [sys.executable, '-I', '-S', str(ROOT / 'src/evgp_inspection'), 'survey']
KART = ['env', f'PYTHONPATH={ROOT / "src/evgp_protocol"}', sys.executable]
KART += [str(ROOT / 'kit/python/example.py')]


def report_in(folder: pathlib.Path) -> str:
    (path,) = folder.iterdir()
    return path.read_text(encoding='utf-8')


def verdicts(report: str) -> dict[str, str]:
    """Return the verdicts on the only kart."""
    found = re.findall(r'^  (pass|fail|not judged) +(.+?)  ', report, re.MULTILINE)
    return {name: verdict for verdict, name in found}


def test_somebody_at_a_terminal_marks_places_and_ends_the_survey_of_a_good_network(
    parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    words = '--listen', '127.0.0.1', '--port', '0', '--report', str(tmp_path)
    terminal = Terminal([*SURVEY, *words, '--shortest', '0.01'])
    parts.callback(terminal.close)
    terminal.wait_for('NO STOP IS IN FORCE')
    terminal.press('ready\n')
    port = terminal.wait_for(r'on port (\d+)')[1]
    terminal.press('tarn\x7f\x7f\x7furn 3\n')
    terminal.wait_for('Marked: turn 3')
    terminal.press('\n')
    terminal.wait_for('Marked: mark 2')
    parts.callback(Program('kart', [*KART, '127.0.0.1', port, '127.0.1.7']).kill)
    terminal.wait_for(r'127\.0\.1\.7 good: \d+ ms')
    terminal.process.send_signal(signal.SIGINT)
    code, report = terminal.end(), report_in(tmp_path)
    assert re.search(r' s  at [\d:]+, \d+ s after "mark 2"\n', report)
    assert report in terminal.shown.replace('\r\n', '\n')
    found = verdicts(report)
    # A busy computer makes it late; then nothing is judged that this explains.
    assert 'fail' not in found.values()
    assert found['lost connections'] == found['time on the network'] == 'pass'
    assert code == (0 if report.endswith('\nPASS\n') else 2)


def test_a_kart_that_is_out_of_reach_for_a_while_fails_the_network(
    parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    need_networks()
    track = parts.enter_context(Track())
    office, kart = track.machine('office', RACE_CONTROL), track.machine('kart', kart_address(7))
    with office.inside():
        words = [*SURVEY, '--word', 'ready', '--report', str(tmp_path)]
        survey = parts.enter_context(Program('survey_network', words))
    survey.wait_for_line('on port')
    with kart.inside():
        parts.callback(Program('kart', [*KART, RACE_CONTROL]).kill)
    survey.wait_for_line('is connected')
    survey.wait_for_line('good')
    kart.air(1.0)
    survey.wait_for_line('LOST')
    survey.wait_for_line('NO LINK')
    assert survey.close() == 2
    report = report_in(tmp_path)
    assert report.endswith('\nFAIL\n')
    assert verdicts(report)['lost connections'] == 'fail'
    assert re.search(r'Worst places:\n.*, not connected\n', report)
