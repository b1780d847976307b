# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Every screen says the same of a race, and the console's questions say what the rules then do.

The races go at random through the real rules. They are compared in the window, in the terminal, on
the board, in the messages themselves and, once a run has ended, in the report and its table.
"""

from __future__ import annotations

from collections.abc import Iterator
import itertools
import pathlib
import pickle
import random
import re
from typing import ClassVar

from evgp_board import view as board
from evgp_node.codec import message_of, value_of
from evgp_node.results import Act, Corrected, Correction, Standings, Status
from evgp_node.roster import Format, Heat
from evgp_protocol.states import RaceState
from evgp_rcs.ros.messages import events_message
from evgp_rcs.ros.node import _asked_for
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind, kinds_by_service
from evgp_rcs.rules.race import Command, Outcome
from evgp_rcs.rules.snapshot import Snapshot, snapshot_of
from evgp_rcs.words import Cell, Tone
from evgp_rcs_console import results, texts
from evgp_rcs_console.client import request_message
from evgp_rcs_console.commands import Given, shows
from evgp_rcs_console.view import Button, Screen, table
from evgp_rcs_msgs import msg
from evgp_timing.desk import Desk, Roster
from evgp_timing.laps import LapSettings
from evgp_timing.timekeeper import told_of
from example_race import warning
import pytest
from recorded_races import report, ROSTER, rows_of, Running, SETUP, tables
from recorded_races import timed as keep_results

TEAMS = {each.number: each.team for each in SETUP.karts}
HEATS = (
    Heat('first', (1, 2), Format.RACE, 3),
    Heat('second', (3, 4), Format.RACE, 3),
    Heat('final', (1, 2, 3, 4), Format.TIME_TRIAL, grid_from='first'),
)

ASKING = {kind for kind in CommandKind if CATALOGUE[kind].asks}
CONFIRMS_ALSO = {CommandKind.KART_IN_GARAGE, CommandKind.OPEN_TRACK}
"""What the question of IN GARAGE also offers: after the MSR was used, or otherwise."""


class Timed(Running):
    """
    A run of race control beside the timekeeper, who hears all that it says, and a console.

    :ivar said: the last results of each race of this run, by its number.
    :cvar changed: the commands whose result a console saw only once they were accepted.
    """

    changed: ClassVar[set[CommandKind]] = set()

    def __init__(self, desk: Desk, run: str, seed: int, before: Timed | None = None) -> None:
        super().__init__(seed, before)
        self.race.run = run
        self.desk = desk
        self.said: dict[int, Standings] = {}
        self._heard = 0

    def correct(self, act: Act, kart: int, **terms: int | bool | str) -> None:
        self.hear()
        assert shows(self.shown, Given(act, kart))  # no snapshot tells of it, and none denies it
        asked = Correction(act, 'Ben', kart, reason='it was seen')._replace(**terms)
        self.desk.feed(Corrected(self.now, asked))

    def feed(self, given: inputs.Input) -> Outcome:
        """Feed an input; the console sees in the race what came of a command."""
        if not isinstance(given, inputs.Commanded):
            return super().feed(given)
        kind, kart, heat = given.command.kind, given.command.kart, given.command.heat
        command = Given(kind, kart, taken={'heat': heat} if kind is CommandKind.SET_HEAT else {})
        is_new = kind not in self.changed and not shows(self.shown, command)
        outcome = super().feed(given)
        if outcome.answer and outcome.answer.success:
            assert shows(self.shown, command), (kind, outcome.answer)
            self.changed |= {kind} if is_new else set()
        return outcome

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


def moments(seed: int, steps: int) -> Iterator[tuple[Timed, bool]]:
    """Yield a race at moments of it, and whether race control ends there; it starts again."""
    desk = Desk(Roster((*TEAMS,), {}, HEATS), LapSettings())
    timed = Timed(desk, 'run 1', seed)
    chance = random.Random(seed)
    for step in range(steps):
        what, number = chance.random(), chance.choice([*TEAMS])
        if what < 0.01:
            yield timed, True
            timed = Timed(desk, f'run {step}', chance.randrange(10**9), timed)
        elif what < 0.1 and timed.race.state is RaceState.IN_GARAGE:
            timed.command(CommandKind.SET_HEAT, heat=chance.choice(HEATS).name)
        elif what < (0.55 if timed.race.state is RaceState.GREEN_GREEN else 0.1):
            timed.correct(Act.COUNT, number)
        elif what > 0.99:
            timed.correct(Act.PENALISE, number, seconds=5, disqualified=chance.random() < 0.5)
        else:
            timed.run(1)
        yield timed, False
    yield timed, True


def check_screens(race: Snapshot, standings: Standings) -> None:
    """Check that window, terminal and board say of a race what its messages say."""
    message, said = message_of(race, msg.Race), message_of(standings, msg.Results)
    shown, found = value_of(message, Snapshot), value_of(said, Standings)
    danger = warning(shown)
    screen = Screen(shown, 0.0, {}, danger, heard=found)
    lines = table(screen)
    page = board.board(board.Heard(shown, found))
    sheet = board.results(board.Heard(shown, found))

    assert f'Race: {screen.state.text}  ({screen.since})' in lines
    head = Cell(danger.title, Tone.BAD) if danger.title else screen.state
    assert (page['head'], page['tone']) == (head.text, head.tone.value)
    assert message.heat == race.heat
    if message.heat:
        assert texts.heat_in_race(screen.snapshot).startswith(message.heat)
        assert page['title'].startswith(message.heat)
        (label,) = (each.label for each in screen.heats if 'in the race' in each.label)
        assert label.startswith(message.heat)
    rows = {row['kart']: row for row in page['rows']}
    for number, row in rows.items():
        own = dict(board.kart(board.Heard(shown, found), number)['cells'])
        assert (own['Place'], own['Best']) == (str(row['place'] or '-'), row['cells'][2] or '-')
    # Until the next race is green, the window still shows the last results; the board does not.
    about = race.run, race.heat, race.number or found.race
    of_last = (found.run, found.heat, found.race) != about
    for kart, row in zip(message.karts, screen.rows, strict=True):
        if kart.number in rows and kart.connected:
            assert rows[kart.number]['symbol'] == row.sent.text[0]
        if kart.number in rows and not of_last:
            place = re.match(r'[PF](\d+)', row.place)
            assert rows[kart.number]['place'] == (int(place[1]) if place else '')
    _, *written = results.table(found, TEAMS)
    written = list(itertools.islice(written, len(found.karts)))
    assert [(row['place'], row['kart'], *row['cells']) for row in sheet['rows']] == [
        (int(place.rstrip('.') or 0) or '', int(kart), int(laps), total, best)
        for place, kart, _, laps, total, _, best, _ in written
    ]
    assert [(each.kart, each.place, each.laps) for each in said.karts] == [
        (int(kart), int(place.rstrip('.') or 0), int(laps)) for place, kart, _, laps, *_ in written
    ]


def received(given: Given) -> Command:
    """Return a console's command as race control receives it."""
    kinds = kinds_by_service()[CATALOGUE[given.command].service]
    return _asked_for(kinds, request_message(given))._replace(roster=ROSTER)


def check_effects(button: Button, timed: Timed, shown: Snapshot) -> None:
    """Give a command to a copy of the race, and compare what it does with what was said."""
    race = pickle.loads(pickle.dumps(timed.race))  # noqa: S301 - our own; deepcopy takes long
    said = button.question.effects
    before = {kart.number: (kart.sent, kart.hold) for kart in race.karts.values()}

    outcome = race.command(received(button.gives), timed.now)
    assert outcome.answer is not None
    assert outcome.answer.success, outcome.answer.message
    assert shows(snapshot_of(race, timed.now), button.gives)
    timed.changed |= set() if shows(shown, button.gives) else {button.command}
    after = {kart.number: (kart.sent, kart.hold) for kart in race.karts.values()}
    parts = said.now, said.later, said.held, said.rest
    at_once, later, held, rest = ({kart.number for kart in part} for part in parts)
    assert sorted([*at_once, *later, *held, *rest]) == sorted(before), 'each is named once'
    changed = {number for number in before if before[number] != after[number]}
    sent = {order.kart for order in outcome.orders}
    if button.command is CommandKind.RECORD_MSR:
        assert changed <= at_once | later  # who was stopped already is sent the same again
        assert sent <= at_once
    else:
        assert changed == at_once | later
        assert sent == at_once
    for number in at_once | later:
        assert after[number][0].value == CATALOGUE[button.command].sends.value
    assert all(race.karts[number].connected for number in at_once)
    assert not any(race.karts[number].connected for number in later)
    assert all(after[number][1] is not None for number in held)
    assert all(after[number][1] is None for number in rest - changed)
    consequences = '\n'.join(button.question.consequences)
    for number in before:
        assert f'{number}' in consequences or button.kart or not at_once | later
    for also in button.also:
        answer = race.command(received(also), timed.now).answer
        assert answer is not None
        assert answer.success, answer.message
    if button.command is CommandKind.IN_GARAGE and shown.track.msr_used:
        assert not any(kart.hold for kart in race.karts.values()), 'each was made safe by hand'


def check_records(record: pathlib.Path, last: list[Timed]) -> None:
    """Check that report and table say of each run what the screens said of it last."""
    written = rows_of(record, '--all')
    for run_number, timed in enumerate(last, 1):
        rows = [row for row in written if row['run'] == str(run_number)]
        newest = max((int(row['race']) for row in rows), default=0)
        if newest and newest == timed.race.grids:
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
                (f'{kart.place}.' if kart.place else '-', str(kart.laps), kart.status.value)
                for kart in karts
            ]
        text = re.sub('<[^>]*>', '', html)
        for row in rows:
            heat = f' ({row["heat"]})' if row['heat'] else ''
            assert f'Race {row["race"]}{heat}: ' in text


@pytest.mark.early
def test_screens_questions_and_records_say_of_a_race_what_it_is(tmp_path: pathlib.Path) -> None:
    seen: set[object] = set()
    asked, offered = set[CommandKind](), set[CommandKind]()
    for seed in range(12):
        record, last, before = tmp_path / f'record{seed}' / 'record.sqlite3', list[Timed](), None
        record.parent.mkdir()
        for timed, ends in moments(seed, 300):
            race, standings = timed.shown, timed.hear()
            if (race, standings) != before:  # else the command was refused
                before = race, standings
                seen |= {race.heat, race.state, *(each.status for each in standings.karts)}
                check_screens(race, standings)
                for button in Screen(race, 0.0, {}).buttons:
                    if button.command in ASKING and button.enabled:
                        asked.add(button.command)
                        offered |= {each.command for each in button.also}
                        check_effects(button, timed, race)
            if ends:
                keep_results(timed.write(record), *timed.said.values())
                last.append(timed)
        check_records(record, last)
    assert seen >= {*(heat.name for heat in HEATS), *RaceState, *Status}
    assert (asked, offered) == (ASKING, CONFIRMS_ALSO)
    assert Timed.changed == {each for each in CommandKind if CATALOGUE[each].is_seen}
