# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Every screen says the same of a race: window, terminal, board, and the messages themselves."""

from __future__ import annotations

from collections.abc import Iterator
import csv
import io
import itertools
import pathlib
import random
import re

from evgp_board import view as board
from evgp_node.codec import message_of, value_of
from evgp_protocol.states import RaceState
from evgp_rcs.rcs_record import main as rcs_record
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.inputs import Recovered
from evgp_rcs.rules.laps import Format
from evgp_rcs.rules.race import Heat, LastRun
from evgp_rcs.rules.snapshot import Snapshot, snapshot_of, Standings, standings_of
from evgp_rcs_console import results
from evgp_rcs_console.view import show, table
from evgp_rcs_msgs import msg
import pytest
from recorded_races import PaperRace

TEAMS = {1: 'Purdue', 2: 'Toledo', 3: 'Michigan', 4: 'Kennesaw State'}
HEATS = (
    Heat('Heat 1', (1, 2), Format.RACE, 3),
    Heat('Heat 2', (3, 4), Format.RACE, 3),
    Heat('Final', (1, 2, 3, 4), Format.TIME_TRIAL, grid_from='Heat 1'),
)
LIKELY = {
    RaceState.IN_GARAGE: (
        CommandKind.KART_IN_GARAGE,
        CommandKind.SET_HEAT,
        CommandKind.GRID_ACTIVE,
    ),
    RaceState.GRID_ACTIVE: (CommandKind.GREEN_GREEN,),
    RaceState.GREEN_GREEN: (CommandKind.KART_FINISH, *[CommandKind.COUNT_PASSING] * 9),
    RaceState.RED_FLAG: (CommandKind.RACE_OVER,),
    RaceState.RED_RED: (CommandKind.IN_GARAGE,),
}


def moments(chance: random.Random, steps: int) -> Iterator[tuple[PaperRace, bool]]:
    """Yield a race at moments of it, and whether race control ends there; it starts again."""
    paper = PaperRace(TEAMS, HEATS)
    for _ in range(steps):
        race, number = paper.race, chance.choice([*TEAMS])
        what = chance.random()
        if what < 0.01:
            now, memory = paper.now + 5.0, race.memory()
            yield paper, True
            paper = PaperRace(TEAMS, HEATS)
            paper.now = now
            paper.feed(Recovered(now, memory, chance.choice([*LastRun])))
        elif what < 0.1:
            paper.connect(number)
        elif what < 0.11:
            paper.lose(number)
        elif what < 0.4:
            paper.acknowledge()
        elif what < 0.55:
            paper.cross(number)
        elif what < 0.65:
            paper.wait(chance.choice((0.3, 4.0)))
        elif what < 0.67:
            paper.command(chance.choice([*CATALOGUE]), number, heat=chance.choice(HEATS).name)
        else:
            paper.command(
                chance.choice(LIKELY[race.state]), number, heat=chance.choice(HEATS).name
            )
        yield paper, False
    yield paper, True


def test_window_terminal_and_board_say_of_a_race_what_its_messages_say() -> None:
    seen = set()
    for paper, _ in itertools.chain(*(moments(random.Random(seed), 300) for seed in range(12))):
        race, now = paper.race, paper.now
        message = message_of(snapshot_of(race, now), msg.Race)
        said = message_of(standings_of(race, now), msg.Results)
        shown, found = value_of(message, Snapshot), value_of(said, Standings)
        screen = show(shown, 0.0, {})
        lines = table(screen, shown.alerts)
        page = board.board(board.Heard(shown, found))
        sheet = board.results(board.Heard(shown, found))
        seen |= {message.heat, race.state.value}

        assert f'Race: {page["head"]}  ({screen.since})' in lines
        assert screen.state.text == page['head']
        assert page['tone'] == screen.state.tone.value
        assert message.heat == race.heat
        if message.heat:
            assert screen.heat.startswith(message.heat)
            assert page['title'].startswith(message.heat)
            (label,) = (each.label for each in screen.heats if 'in the race' in each.label)
            assert label.startswith(message.heat)
        rows = {row['kart']: row for row in page['rows']}
        for kart, row in zip(message.karts, screen.rows, strict=True):
            assert row.place == (f'P{kart.place}' if kart.place else '')
            if kart.number in rows and kart.connected:
                assert rows[kart.number]['symbol'] == row.sent.text[0]
            if kart.number in rows and not any(each.place for each in found.karts):
                assert rows[kart.number]['place'] == (kart.place or '')
        written = results.table(found, TEAMS)[: len(found.karts)]
        assert [(row['place'], row['kart'], *row['cells']) for row in sheet['rows']] == [
            (int(place.rstrip('.') or 0) or '', int(kart), int(laps), total, best)
            for place, kart, _, laps, total, _, best, _ in written
        ]
        assert [(each.kart, each.place, each.laps) for each in said.karts] == [
            (int(kart), int(place.rstrip('.') or 0), int(laps))
            for place, kart, _, laps, *_ in written
        ]
    assert seen >= {*(heat.name for heat in HEATS), *(state.value for state in RaceState)}


@pytest.mark.parametrize('seed', range(12))
def test_report_and_tables_say_of_a_race_what_the_screens_said_of_it_last(
    seed: int, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record, page = tmp_path / 'record.sqlite3', tmp_path / 'report.html'
    last: list[tuple[Snapshot, Standings]] = []
    for paper, ends in moments(random.Random(seed), 300):
        if ends:
            paper.write(record)
            last.append((snapshot_of(paper.race, paper.now), standings_of(paper.race, paper.now)))

    def table_of(what: str) -> list[dict[str, str]]:
        assert rcs_record([what, '--all', str(record)]) == 0
        return [*csv.DictReader(io.StringIO(capsys.readouterr().out))]

    finishes, laps = table_of('results'), table_of('laps')
    for run, (shown, found) in enumerate(last, 1):
        races = [row for row in finishes if row['run'] == str(run)]
        newest = max((int(row['race']) for row in races), default=0)
        if newest or shown.state is not RaceState.IN_GARAGE:
            order = {kart.number: kart.place for kart in shown.karts if kart.place}
            assert order == {
                int(row['kart']): int(row['place'])
                for row in races
                if row['race'] == str(newest) and row['place']
            }
        counted = [row for row in laps if row['run'] == str(run)]
        if counted and found.karts:
            number = max(int(row['race'] or 0) for row in counted)
            told = [row for row in counted if int(row['race'] or 0) == number]
            assert [(each.kart, each.place, each.laps) for each in found.karts] == [
                (int(row['kart']), int(row['place'] or 0), int(row['laps'] or 0)) for row in told
            ]
            assert {row['heat'] for row in told} == {found.heat}
        assert rcs_record(['report', '--run', str(run), '-o', str(page), str(record)]) == 0
        capsys.readouterr()
        text = re.sub('<[^>]*>', '', page.read_text())
        for row in races:
            heat = f' ({row["heat"]})' if row['heat'] else ''
            assert f'Race {row["race"]}{heat}: ' in text
