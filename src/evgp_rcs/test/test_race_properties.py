# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The rules of the race along random histories of up to eight karts, against the oracle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from evgp_protocol.states import RaceState
from evgp_rcs.rules import inputs
from evgp_rcs.rules import race as rules
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    initialize,
    precondition,
    rule,
    RuleBasedStateMachine,
    run_state_machine_as_test,
)
import pytest
import race_oracle as oracle

pytestmark = [pytest.mark.usefixtures('others_first'), pytest.mark.timeout(900)]

MOST_KARTS = 8
MOST_HEATS = 3

# Steps of time that fall before, on and after what is due, and some that fall anywhere.
STEPS = st.one_of(
    st.sampled_from((0.0, 0.0, 0.05, 0.25, 1.0, 5.0, 15.0, 30.0, 120.0)),
    st.floats(0.0, 200.0, allow_nan=False),
)
KARTS = st.integers(1, MOST_KARTS)
HEATS = st.integers(1, MOST_HEATS).map('heat {}'.format)
TIMES = st.builds(
    rules.RaceTimes,
    finish_delays=st.lists(st.floats(0.0, 10.0), min_size=1, max_size=4).map(tuple),
    finish_stop=st.floats(0.0, 20.0),
    auto_race_over=st.booleans(),
    ready_alert=st.floats(0.0, 150.0),
    green_alert=st.floats(0.0, 40.0),
    flag_alert=st.floats(0.0, 20.0),
    red_alert=st.floats(0.0, 20.0),
    pause=st.floats(0.0, 10.0),
    pause_after_stall=st.floats(0.0, 10.0),
    settle_time=st.floats(0.0, 10.0),
    nobody_there=st.just(0.0) | st.floats(0.0, 20.0),
)


RARELY = st.sampled_from((False, False, True))


def gives(kind: Any, *fields: st.SearchStrategy[Any]) -> Callable[..., None]:
    """Return a rule that gives inputs of a kind, with any such fields behind the time."""

    def give(self: Races, given: Any) -> None:
        self.give(given)

    give.__name__ = kind.__name__  # by which Hypothesis leaves some rules out of a race
    return rule(given=st.builds(kind, st.just(0.0), *fields))(give)


class Races(RuleBasedStateMachine):
    """Officials, karts and time do what they like; the oracle judges every single input."""

    @initialize(
        racing=st.lists(st.booleans(), min_size=1, max_size=MOST_KARTS),
        times=st.one_of(st.just(rules.RaceTimes()), TIMES),
        now=st.floats(0.0, 1e6),
        linked=st.booleans(),
        heats=st.lists(st.frozensets(KARTS, min_size=1), max_size=MOST_HEATS),
    )
    def line_up(
        self,
        racing: list[bool],
        times: rules.RaceTimes,
        now: float,
        linked: bool,
        heats: list[frozenset[int]],
    ) -> None:
        karts = [rules.Kart(number, in_race=each) for number, each in enumerate(racing, 1)]
        self.race = rules.Race(
            karts,
            times,
            now,
            [
                rules.Heat(f'heat {name}', tuple(sorted({1 + n % len(karts) for n in chosen})))
                for name, chosen in enumerate(heats, 1)
            ],
            oracle.RUN,
        )
        self.now = now
        self.facts = oracle.remember(oracle.look(self.race))
        for number in self.race.karts if linked else ():
            self.give(inputs.Connected(now, number))

    def kart(self, number: int) -> int:
        """Return the number of a kart of the roster: this one, if it has it."""
        return 1 + (number - 1) % len(self.race.karts)

    def give(self, given: Any, blind: bool = False) -> None:
        """
        Give one input, which comes now to a kart of the roster, and ask the oracle everything.

        :param blind: the official does not see the race as it is.
        """
        if not isinstance(given, inputs.Commanded):
            given = given._replace(at=self.now)
            if hasattr(given, 'kart'):
                given = given._replace(kart=self.kart(given.kart))
        before = oracle.look(self.race)
        if not blind:
            given = oracle.as_seen(before, given)
        if isinstance(given, inputs.Commanded):
            kind, kart = given.command.kind.name, given.command.kart
            oracle.check_announced(self.race, before, self.facts, kind, kart, self.now)
        outcome = inputs.feed(given, self.race)
        after = oracle.look(self.race)
        self.facts = oracle.check_input(self.race, before, self.facts, given, outcome, after)
        oracle.check_state(self.race, after, self.facts, self.now)

    def command(
        self, kind: str, kart: int = 0, statement: bool = True, blind: bool = False, **fields: Any
    ) -> None:
        kart = self.kart(kart) if kind in oracle.KART_COMMANDS else 0
        self.give(oracle.command(kind, kart, statement, self.now, **fields), blind)

    def save(self, stale: bool = False) -> None:
        self.give(inputs.Saved(self.now, self.race.memory().gridded - stale))

    def let_pass(self, step: float) -> None:
        self.now += step
        self.give(inputs.Tick(self.now))

    def let_the_pause_pass(self) -> None:
        self.now = max(self.now, self.race.paused_until)

    def let_every_kart_stop(self) -> None:
        self.every_kart_answers()
        self.let_the_pause_pass()
        self.let_pass(self.race.times.settle_time)

    # ----- officials ----------------------------------------------------------------------

    @rule(kind=st.sampled_from(oracle.RACE_COMMANDS), statement=st.booleans(), heat=HEATS)
    def command_race(self, kind: str, statement: bool, heat: str) -> None:
        self.command(kind, 0, statement, heat=heat)

    @rule(kind=st.sampled_from(oracle.KART_COMMANDS), kart=KARTS, statement=st.booleans())
    def command_kart(self, kind: str, kart: int, statement: bool) -> None:
        self.command(kind, kart, statement)

    @rule(
        kind=st.sampled_from((*oracle.NAMING, 'KART_IN_GARAGE')),
        kart=KARTS,
        karts=st.frozensets(KARTS),
        hold=st.sampled_from((None, RaceState.RED_FLAG, RaceState.RED_RED)),
    )
    def command_without_a_look(
        self, kind: str, kart: int, karts: frozenset[int], hold: RaceState | None
    ) -> None:
        named = {'hold': hold} if kind == 'KART_IN_GARAGE' else {'karts': karts}
        self.command(kind, kart, blind=True, **named)

    @rule(data=st.data())
    def command_what_is_allowed(self, data: st.DataObject) -> None:
        # Blind commands alone would seldom get a race under way.
        view = oracle.look(self.race)
        allowed = [
            (kind, number)
            for kinds, numbers in (
                (oracle.RACE_COMMANDS, (0,)),
                (oracle.KART_COMMANDS, tuple(self.race.karts)),
            )
            for kind in kinds
            for number in numbers
            if oracle.judge(view, self.facts, kind, number).allowed
        ]
        kind, number = data.draw(st.sampled_from(allowed))
        self.command(kind, number, heat=data.draw(HEATS))

    @rule(kart=st.integers(MOST_KARTS + 1, 300), kind=st.sampled_from(oracle.KART_COMMANDS))
    def command_a_kart_that_is_not_in_the_roster(self, kart: int, kind: str) -> None:
        before = oracle.look(self.race)
        command = rules.Command(rules.CommandKind[kind], kart, True)
        outcome = self.race.command(command, self.now)
        assert outcome.answer is not None
        assert not outcome.answer.success
        assert str(kart) in outcome.answer.message
        # A stop begins a pause all the same: the official meant some kart.
        paused = before.paused_until
        if kind in oracle.STOPS:
            paused = max(paused, self.now + self.race.times.pause)
        assert oracle.look(self.race) == before._replace(paused_until=paused)
        assert not outcome.orders

    @precondition(lambda self: self.race.state is not RaceState.GREEN_GREEN)
    @rule(
        joining=st.sets(KARTS),
        stop_short=st.sampled_from((0, 0, 0, 1, 2)),
        between=st.sampled_from(('', '', '', 'disconnected', 'KART_RED_FLAG')),
        kart=KARTS,
        stale=st.sampled_from((False, False, False, True, None)),
    )
    def bring_a_race_under_way(
        self, joining: set[int], stop_short: int, between: str, kart: int, stale: bool | None
    ) -> None:
        self.give(inputs.CutOff(self.now, ''))
        self.give(inputs.Rival(self.now, False))
        self.give(inputs.RecordTrouble(self.now, ''))
        for number, each in self.race.karts.items():
            self.give(inputs.Contested(self.now, number, False))
            if not each.connected:
                self.give(inputs.Connected(self.now, number))
        if self.race.state is not RaceState.IN_GARAGE:
            self.command('ALL_KILL')
            self.let_every_kart_stop()
            self.command('IN_GARAGE')
        for number, each in self.race.karts.items():
            if each.may_be_moving:
                self.command('KART_RED_RED', number)
            if each.hold is not None:
                self.let_the_pause_pass()
                self.command('KART_IN_GARAGE', number)
            if number in joining:
                self.command('JOIN_RACE', number)
        self.command('CLOSE_TRACK')
        self.let_the_pause_pass()
        self.command('GRID_ACTIVE')
        # All of them answer, or all but the last one or two.
        for number in list(self.race.karts)[: len(self.race.karts) - stop_short]:
            self.answer(number)
        if between == 'disconnected':
            self.give(inputs.Disconnected(self.now, kart, oracle.GONE))
        elif between:
            self.command(between, kart)
        self.give(inputs.Tick(self.now))
        if stale is not None:
            self.save(stale)
        self.command('GREEN_GREEN')

    @precondition(lambda self: self.race.state is RaceState.GREEN_GREEN)
    @rule(kart=KARTS, named=st.integers(0, 4), undo=st.booleans(), step=st.floats(0.0, 12.0))
    def finish(self, kart: int, named: int, undo: bool, step: float) -> None:
        kart = self.kart(kart)
        run, number, attempt = (
            ('', 0, 0),
            *oracle.finishes(oracle.look(self.race), kart),
        )[named]
        self.command('KART_FINISH', kart, run=run, race=number, attempt=attempt)
        if undo:
            self.command('KART_UNDO_FINISH', kart)
        self.let_pass(step)

    # ----- karts --------------------------------------------------------------------------

    def answer(self, number: int) -> None:
        kart = self.race.karts[number]
        self.give(inputs.Heard(self.now, number, kart.serial, kart.sent))

    connect = gives(inputs.Connected, KARTS)
    disconnect = gives(inputs.Disconnected, KARTS, st.just(oracle.GONE))
    is_measured = gives(inputs.Measured, KARTS, st.sampled_from((oracle.GOOD, oracle.POOR)))

    @rule(kart=KARTS, state=st.sampled_from(RaceState), age=st.integers(0, 3))
    def say(self, kart: int, state: RaceState, age: int) -> None:
        serial = self.race.karts[self.kart(kart)].serial - age
        self.give(inputs.Heard(self.now, kart, serial, state))

    @rule(kart=KARTS, age=st.integers(0, 2))
    def an_order_has_arrived(self, kart: int, age: int) -> None:
        serial = self.race.karts[self.kart(kart)].serial - age
        self.give(inputs.Delivered(self.now, kart, serial, self.now))

    @rule()
    def every_kart_answers(self) -> None:
        for number in self.race.karts:
            self.answer(number)

    # ----- race control itself ------------------------------------------------------------

    @rule(known=st.sampled_from((True, True, False)), last_run=st.sampled_from(rules.LastRun))
    def race_control_is_restarted(self, known: bool, last_run: rules.LastRun) -> None:
        """Nothing moves after it; unless all was home, every kart is held."""
        left, heat = self.race, self.facts.heat
        before = oracle.look(left)
        oracle.check_recovery(rules, left, before, self.now, known, last_run)
        karts = [rules.Kart(number, in_race=number == 1) for number in left.karts]
        self.race = rules.Race(karts, left.times, self.now, left.heats, oracle.RUN)
        memory = left.memory() if known else None
        outcome = self.race.recover(memory, last_run, self.now)
        assert not outcome.orders
        view = oracle.look(self.race)
        if view.state is RaceState.IN_GARAGE:
            assert last_run is not rules.LastRun.UNKNOWN
            assert not known or before.state is RaceState.IN_GARAGE
            self.facts = oracle.remember(view)
        else:
            assert view.state is RaceState.RED_RED
            assert view.track_open
            for kart in view.karts:
                assert kart.hold is kart.sent is RaceState.RED_RED
            self.facts = oracle.recall(view, heat if known else '')
        oracle.check_state(self.race, view, self.facts, self.now)

    is_cut_off_or_not = gives(inputs.CutOff, st.sampled_from(('', '', 'no cable')))
    two_programs_connect_or_not = gives(inputs.Contested, KARTS, RARELY)
    another_race_control_comes_or_goes = gives(inputs.Rival, RARELY)
    somebody_comes_or_goes = gives(
        inputs.Attended,
        st.builds(rules.Attendance, st.integers(0, 1), button_fault=st.sampled_from(('', 'x'))),
    )
    is_held_up = gives(inputs.Stalled, st.just(2.0))
    the_record_fails_or_works = gives(inputs.RecordTrouble, st.sampled_from(('', 'no space')))

    @rule(karts=st.lists(KARTS, min_size=1), step=st.floats(0.0, 1.0))
    def karts_go_silent(self, karts: list[int], step: float) -> None:
        for kart in karts:
            self.now += step
            self.give(inputs.Disconnected(self.now, kart, oracle.GONE, True))

    @rule(stale=RARELY)
    def something_is_on_the_disk(self, stale: bool) -> None:
        self.save(stale)

    @rule(
        kind=st.sampled_from(oracle.LOOSENING),
        kart=KARTS,
        before=st.sampled_from((0.0, 0.05, 1.0, 5.0)),
        of_the_pause=st.booleans(),
    )
    def a_command_comes_late(
        self, kind: str, kart: int, before: float, of_the_pause: bool
    ) -> None:
        came = min(self.now, self.race.paused_until if of_the_pause else self.now) - before
        kart = self.kart(kart) if kind in oracle.KART_COMMANDS else 0
        self.give(oracle.command(kind, kart, True, self.now)._replace(came=came))

    # ----- time ---------------------------------------------------------------------------

    @rule(step=STEPS)
    def time_passes(self, step: float) -> None:
        self.let_pass(step)

    @rule(step=STEPS)
    def time_passes_untold(self, step: float) -> None:
        # An input may come at any time after the last tick.
        self.now += step


FEW, MANY = (settings(max_examples=races, stateful_step_count=80) for races in (50, 300))
"""How many races are tried in `make test`, and in `make test-long`."""


@pytest.mark.parametrize(
    'races',
    [
        pytest.param(FEW, id='few'),
        pytest.param(MANY, id='many', marks=[pytest.mark.long, pytest.mark.longest]),
    ],
)
def test_every_input_of_a_random_race_is_as_the_oracle_says(races: settings) -> None:
    run_state_machine_as_test(Races, settings=races)
