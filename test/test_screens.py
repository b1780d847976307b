# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Every screen says the same of a race: window, terminal, board, and the messages themselves."""

from __future__ import annotations

from collections.abc import Iterator
import itertools
import pathlib
import random
import re

from evgp_board import view as board
from evgp_node.codec import message_of, value_of
from evgp_node.results import Act, Corrected, Correction, Standings, Status
from evgp_node.roster import Format, Heat
from evgp_protocol.states import RaceState
from evgp_rcs.ros.messages import events_message
from evgp_rcs.rules import race as rules
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.inputs import Recovered
from evgp_rcs.rules.race import LastRun
from evgp_rcs.rules.snapshot import Snapshot, snapshot_of
from evgp_rcs.words import STATUS
from evgp_rcs_console import results, texts
from evgp_rcs_console.view import Screen, table
from evgp_rcs_msgs import msg
from evgp_timing.desk import Desk, Roster
from evgp_timing.laps import LapSettings
from evgp_timing.timekeeper import told_of
import pytest
from recorded_races import PaperRace, report, rows_of, tables
from recorded_races import timed as keep_results

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
    RaceState.GREEN_GREEN: (CommandKind.KART_FINISH, *[None] * 6),
    RaceState.RED_FLAG: (CommandKind.RACE_OVER,),
    RaceState.RED_RED: (CommandKind.IN_GARAGE,),
}
"""What officials are likely to do; None: they count a lap."""


class Timed(PaperRace):
    """
    A run of race control beside the timekeeper, who hears all that it says.

    :ivar said: the last results of each race of this run, by its number.
    """

    def __init__(self, desk: Desk, run: str) -> None:
        super().__init__(TEAMS, [rules.Heat(heat.name, heat.karts) for heat in HEATS])
        self.race.run = run
        self.desk = desk
        self.said: dict[int, Standings] = {}
        self._heard = 0

    def correct(self, act: Act, kart: int, **terms: int | bool | str) -> None:
        self.hear()
        asked = Correction(act, 'Ben', kart, reason='it was seen')._replace(**terms)
        self.desk.feed(Corrected(self.now, asked))

    def hear(self) -> Standings:
        """Have the timekeeper hear what is new, and return the results."""
        heard, self._heard = self._heard, len(self.stamped)
        new = self.stamped[heard:]
        for event in events_message(new, self.race.run).events:
            if (told := told_of(event, self.race.run)) is not None:
                self.desk.feed(told)
        found = self.desk.standings(self.now)
        if found.run == self.race.run:
            self.said[found.race] = found
        return found

    @property
    def shown(self) -> Snapshot:
        """Return what race control says."""
        return snapshot_of(self.race, self.now)


def moments(chance: random.Random, steps: int) -> Iterator[tuple[Timed, bool]]:
    """Yield a race at moments of it, and whether race control ends there; it starts again."""
    desk = Desk(Roster((*TEAMS,), {}, HEATS), LapSettings())
    timed = Timed(desk, 'run 1')
    for step in range(steps):
        number, heat = chance.choice([*TEAMS]), chance.choice(HEATS).name
        what = chance.random()
        if what < 0.01:
            now, memory = timed.now + 5.0, timed.race.memory()
            yield timed, True
            timed = Timed(desk, f'run {step}')
            timed.now = now
            timed.feed(Recovered(now, memory, chance.choice([*LastRun])))
        elif what < 0.1:
            timed.connect(number)
        elif what < 0.11:
            timed.lose(number)
        elif what < 0.4:
            timed.acknowledge()
        elif what < 0.55:
            timed.correct(Act.COUNT, number)
        elif what < 0.56:
            timed.correct(Act.PENALISE, number, seconds=5, disqualified=chance.random() < 0.5)
        elif what < 0.65:
            timed.wait(chance.choice((0.3, 4.0)))
        elif what < 0.67:
            timed.command(chance.choice([*CATALOGUE]), number, heat=heat)
        elif (kind := chance.choice(LIKELY[timed.race.state])) is not None:
            timed.command(kind, number, heat=heat)
        else:
            timed.correct(Act.COUNT, number)
        yield timed, False
    yield timed, True


def test_window_terminal_and_board_say_of_a_race_what_its_messages_say() -> None:
    seen, before = set(), None
    for timed, _ in itertools.chain(*(moments(random.Random(seed), 300) for seed in range(12))):
        race, standings = timed.shown, timed.hear()
        if (race, standings) == before:
            continue  # the command was refused
        before = race, standings
        message, said = message_of(race, msg.Race), message_of(standings, msg.Results)
        shown, found = value_of(message, Snapshot), value_of(said, Standings)
        screen = Screen(shown, 0.0, {}, heard=found)
        lines = table(screen)
        page = board.board(board.Heard(shown, found))
        sheet = board.results(board.Heard(shown, found))
        seen |= {message.heat, race.state.value, *(each.status for each in found.karts)}

        assert f'Race: {page["head"]}  ({screen.since})' in lines
        assert screen.state.text == page['head']
        assert page['tone'] == screen.state.tone.value
        assert message.heat == race.heat
        if message.heat:
            assert texts.heat_in_race(screen.snapshot).startswith(message.heat)
            assert page['title'].startswith(message.heat)
            (label,) = (each.label for each in screen.heats if 'in the race' in each.label)
            assert label.startswith(message.heat)
        rows = {row['kart']: row for row in page['rows']}
        for kart, row in zip(message.karts, screen.rows, strict=True):
            if kart.number in rows and kart.connected:
                assert rows[kart.number]['symbol'] == row.sent.text[0]
            if kart.number in rows:
                place = re.match(r'[PF](\d+)', row.place)
                assert rows[kart.number]['place'] == (int(place[1]) if place else '')
        _, *written = results.table(found, TEAMS)
        written = list(itertools.islice(written, len(found.karts)))
        assert [(row['place'], row['kart'], *row['cells']) for row in sheet['rows']] == [
            (int(place.rstrip('.') or 0) or '', int(kart), int(laps), total, best)
            for place, kart, _, laps, total, _, best, _ in written
        ]
        assert [(each.kart, each.place, each.laps) for each in said.karts] == [
            (int(kart), int(place.rstrip('.') or 0), int(laps))
            for place, kart, _, laps, *_ in written
        ]
    assert seen >= {*(heat.name for heat in HEATS), *(state.value for state in RaceState), *Status}


@pytest.mark.parametrize('seed', range(12))
def test_report_and_table_say_of_a_race_what_the_screens_said_of_it_last(
    seed: int, tmp_path: pathlib.Path
) -> None:
    record = tmp_path / 'record.sqlite3'
    last: list[Timed] = []
    for timed, ends in moments(random.Random(seed), 300):
        timed.hear()
        if ends:
            keep_results(timed.write(record), *timed.said.values())
            last.append(timed)

    written = rows_of(record, '--all')
    for run_number, timed in enumerate(last, 1):
        rows = [row for row in written if row['run'] == str(run_number)]
        newest = max((int(row['race']) for row in rows), default=0)
        if newest:
            assert {kart.number: kart.place for kart in timed.shown.karts if kart.place} == {
                int(row['kart']): int(row['finish'])
                for row in rows
                if row['race'] == str(newest) and row['finish']
            }
        for number, found in timed.said.items():
            told = {int(row['kart']): row for row in rows if row['race'] == str(number)}
            for kart in found.karts:
                row = told[kart.kart]
                assert row['status'] == kart.status.name
                assert int(row['place'] or 0) == kart.place
                assert int(row['laps'] or 0) == kart.laps
                assert row['heat'] == found.heat
        html = report(record, '--run', str(run_number))
        assert [row[:2] for each in tables(html, 'order') for row in each] == [
            [f'{row["finish"]}.' if row['finish'] else '-', f'Kart {row["kart"]} ({row["team"]})']
            for row in rows
        ]
        # Behind those of the races are those over all heats.
        said = [each.karts for _, each in sorted(timed.said.items()) if each.karts]
        for shown, karts in zip(tables(html, 'order results'), said, strict=False):
            assert [(place, laps, status) for place, _, laps, *_, status in shown] == [
                (f'{kart.place}.' if kart.place else '-', str(kart.laps), STATUS[kart.status])
                for kart in karts
            ]
        text = re.sub('<[^>]*>', '', html)
        for row in rows:
            heat = f' ({row["heat"]})' if row['heat'] else ''
            assert f'Race {row["race"]}{heat}: ' in text
