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

"""The laps of a recorded race, as CSV and JSON: what the rules counted, in any number of races."""

from __future__ import annotations

import csv
import io
import json
import pathlib

from evgp_rcs import inputs
from evgp_rcs.catalogue import CommandKind
from evgp_rcs.inputs import Block, Entrant, Log, Setup
from evgp_rcs.laps import Format, Passing
from evgp_rcs.race import Command, Heat, RaceTimes, StampedEvent, StartPhase
from evgp_rcs.rcs_record import main
from evgp_rcs.record import Record, rules_version
import pytest

SETUP = Setup(
    (Entrant(1, '=Ohm', False), Entrant(2, 'Volta', False)),
    RaceTimes(pause=0.0, settle=0.0, min_lap_time=1.0),
    (Heat('one', (1,), Format.TIME_TRIAL, 2), Heat('two', (2,), Format.TIME_TRIAL, 2)),
    now=100.0,
)


class Paper:
    """A race that is fed and logged as the kart server does it."""

    def __init__(self) -> None:
        self.race = SETUP.race()
        self.log = Log()
        self.now = SETUP.now
        self.passings = 0
        for kart in (1, 2):
            self.feed(inputs.Connected(self.now, kart))

    def feed(self, given: inputs.Input) -> None:
        self.log.add(given)
        outcome = inputs.feed(given, self.race)
        if outcome.orders:
            self.log.add(inputs.Ordered(outcome.orders))
        if outcome.start is not None:
            written = StartPhase.WRITTEN, outcome.start.number
            self.feed(inputs.StartBecame(self.now, *written))

    def command(self, kind: CommandKind, kart: int = 0, **fields: object) -> None:
        offered = self.race.availability(kind, kart, self.now)
        command = Command(kind, kart, True, frozenset(offered.karts), official='Anna')
        self.feed(inputs.Commanded(self.now, command._replace(**fields), self.now))
        for each in self.race.karts.values():
            self.feed(inputs.Heard(self.now, each.number, each.serial, each.sent))

    def drives(self, heat: str, kart: int, *laps: float) -> None:
        """Have one kart drive laps alone."""
        self.command(CommandKind.SET_HEAT, heat=heat)
        self.command(CommandKind.GRID_ACTIVE)
        self.command(CommandKind.GREEN_GREEN)
        for step in (3.0, *laps):
            self.now += step
            self.passings += 1
            stamp = round(self.now * 1e9)
            passing = Passing('line', 'today', self.passings, kart, stamp_ns=stamp)
            self.feed(inputs.Passed(self.now, (passing,), 0))
        self.command(CommandKind.ALL_KILL)
        self.command(CommandKind.IN_GARAGE)


@pytest.fixture
def file(tmp_path: pathlib.Path) -> pathlib.Path:
    """Return a record of a time trial of two karts, one after the other."""
    paper = Paper()
    paper.drives('one', 1, 12.5, 11.25)
    paper.drives('two', 2, 11.0, 11.5)
    penalty = {'seconds': 5, 'reason': 'a cone'}
    paper.command(CommandKind.PENALISE, 2, **penalty)
    record = Record(tmp_path / 'record.sqlite3')
    record.begin(rules_version(), SETUP)
    none: list[StampedEvent] = []
    block: Block = paper.log.take()
    record.put(none, block)
    record.end()
    return tmp_path / 'record.sqlite3'


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
