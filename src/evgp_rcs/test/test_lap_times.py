# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The laps of a recorded race, as CSV and JSON: what the rules counted, in any number of races."""

from __future__ import annotations

import csv
import io
import json
import pathlib
import re

from evgp_rcs.rcs_record import main
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.laps import Format
from evgp_rcs.rules.race import Heat
import pytest
from recorded_races import PaperRace

HEATS = (
    Heat('one', (1,), Format.TIME_TRIAL, 2),
    Heat('two', (2,), Format.TIME_TRIAL, 2),
    Heat('again', (1,), Format.TIME_TRIAL, 2),
)


def drives(paper: PaperRace, heat: str, kart: int, *laps: float) -> None:
    """Have one kart drive laps alone."""
    paper.command(CommandKind.SET_HEAT, heat=heat)
    paper.drive()
    for step in (3.0, *laps):
        paper.wait(step)
        paper.cross(kart)
    paper.command(CommandKind.ALL_KILL)
    paper.go_home()


@pytest.fixture
def paper() -> PaperRace:
    """Return a time trial of two karts, one after the other."""
    paper = PaperRace({1: '=Ohm', 2: 'Volta'}, HEATS)
    paper.connect(1, 2)
    drives(paper, 'one', 1, 12.5, 11.25)
    drives(paper, 'two', 2, 11.0, 11.5)
    paper.command(CommandKind.PENALISE, 2, 'Anna', seconds=5, reason='a cone')
    return paper


@pytest.fixture
def file(paper: PaperRace, tmp_path: pathlib.Path) -> pathlib.Path:
    return paper.write(tmp_path / 'record.sqlite3')


def test_the_laps_are_those_that_the_rules_counted_with_a_place_over_all_races(
    file: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['laps', str(file), '--json']) == 0

    first, second = json.loads(capsys.readouterr().out)

    assert (first['kart'], first['lap_times'], first['total']) == (1, [12.5, 11.25], 23.75)
    assert (second['kart'], second['best'], second['total']) == (2, 11.0, 27.5)
    assert [each['place'] for each in (first, second)] == [1, 1]
    assert [each['overall'] for each in (first, second)] == [1, 2]
    assert second['penalties'] == ['+5 s: a cone (Anna)']
    assert {each['status'] for each in (first, second)} == {'CLASSIFIED'}
    assert (first['race'], first['heat'], first['format']) == (1, 'one', 'time_trial')


def test_the_csv_has_the_same_and_no_cell_that_a_spreadsheet_runs(
    file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    output = tmp_path / 'laps.csv'
    assert main(['laps', str(file), '-o', str(output)]) == 0

    rows = list(csv.DictReader(io.StringIO(output.read_text(encoding='utf-8'))))

    assert [row['total'] for row in rows] == ['23.750', '27.500']
    assert rows[0]['lap_times'] == '12.500 11.250'
    assert rows[0]['team'] == "'=Ohm"
    assert rows[1]['penalties'].startswith("'+5 s")


def test_of_a_kart_with_several_results_the_best_alone_has_a_place_over_all(
    paper: PaperRace, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drives(paper, 'again', 1, 12.0, 11.25)
    assert main(['laps', str(paper.write(tmp_path / 'record.sqlite3')), '--json']) == 0

    rows = json.loads(capsys.readouterr().out)

    seen = [(row['kart'], row['total'], row['overall']) for row in rows]
    assert seen == [(1, 23.75, 0), (2, 27.5, 2), (1, 23.25, 1)]


def test_the_report_has_the_same_places_over_all_races(file: pathlib.Path) -> None:
    page = file.with_name('report.html')
    assert main(['report', str(file), '-o', str(page)]) == 0

    *_, over_all = page.read_text(encoding='utf-8').split('the best result of each kart')

    rows = re.findall(r'<tr><td>(\d)\.</td><td>Kart (\d)', over_all)
    assert rows == [('1', '1'), ('2', '2')]
