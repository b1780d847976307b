# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The timekeeper as a process beside a real race: what becomes of both, whatever becomes of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
import contextlib
import os
import pathlib
import shlex
import signal
import time
from types import SimpleNamespace
from typing import Any, cast

from builtin_interfaces.msg import Time
from evgp_node.restarting import IN_THE_WAY
from evgp_node.results import Act, BY_HAND, KartResult, Mark, Standings, Status
from evgp_node.stamps import stamp_of
from evgp_protocol.states import RaceState
from evgp_rcs.record.timing import entries
from evgp_rcs_msgs import msg, srv
from evgp_testing.part import PATIENCE
from evgp_testing.process import freeze, Process
from evgp_testing.race_control import Timekeeper, write_roster
from evgp_testing.ros_side import joined, RosSide
from evgp_testing.wire_race import WireRace
from evgp_timing import timekeeper
from evgp_timing.corrections import CORRECTIONS
from evgp_timing.desk import Answer, Finish, What
from evgp_timing.timekeeper import ARRIVING_QOS, passing_of, told_of
from evgp_timing.window import Client
import pytest
from rclpy.parameter import Parameter
from test_rcs_ctl import ACCEPTED, Lines, NOT_THERE, REFUSED, start

KARTS = (1, 2)

HEAT = 'Heat 1'

HEATS = {HEAT: {'karts': [*KARTS], 'laps': 2, 'auto_finish': True}}

LAP = 1.5
"""Time between two crossings of a kart by the clock of the line, in s. They are said at once:
its clock may be ahead by so much."""


class Line(RosSide):
    """
    A source of passings, and the client of a timekeeper's window.

    :ivar heard: all results so far.
    :ivar race: what the client says last of the race.
    :ivar ahead: when each kart crossed last, by the line's clock, in seconds.
    """

    def __init__(self, domain: int) -> None:
        super().__init__('line', domain)
        self._number = 0
        self._began_ns = time.time_ns()
        self.ahead = dict.fromkeys(KARTS, -LAP)
        self._passings = self.node.create_publisher(msg.Passing, '/rcs/passings', ARRIVING_QOS)
        self.heard: list[Standings] = []
        self.race: tuple[Any, ...] = ()
        self._client = Client(context=self.context, use_global_arguments=False)
        self.spin()

    def on_results(self, results: Standings) -> None:
        self.heard.append(results)

    def on_race(self, *race: object) -> None:
        self.race = race

    def now(self) -> float:
        """Return the time by its clock, in seconds."""
        return (time.time_ns() - self._began_ns) / 1e9

    def sees(self, kart: int, at: float, **fields: object) -> msg.Passing:
        """Say that a kart crossed at a time by its clock."""
        self._number += 1
        stamp = stamp_of(round(at * 1e9) + self._began_ns)
        named: dict[str, Any] = {'source': 'line', 'number': self._number, **fields}
        passing = msg.Passing(**{'session': 'today', 'kart': kart, 'stamp': stamp, **named})
        self._passings.publish(passing)
        return passing

    def laps(self, kart: int, crossings: int) -> list[msg.Passing]:
        """Have a kart cross so many times more, one lap after the other."""
        first = max(self.now(), self.ahead[kart] + LAP)
        self.ahead[kart] = first + (crossings - 1) * LAP
        return [self.sees(kart, first + number * LAP) for number in range(crossings)]

    def look(self) -> list[Standings]:
        """Return the newest results, if there are any."""
        self._client.take(self)
        return self.heard[-1:]

    def wait_for(self, found: Callable[[Standings], object], what: str) -> Standings:
        """Return the first results for which `found` is true."""
        self.wait_until_polled(lambda: any(map(found, self.look())), what)
        return self.heard[-1]

    def wait_for_more(self, count: int = 2) -> Standings:
        """Return the results once so many more have come: the timekeeper runs."""
        self.look()
        seen = len(self.heard)
        return self.wait_for(lambda _: len(self.heard) >= seen + count, 'more results')

    def wait_for_laps(self, kart: int, laps: int) -> KartResult:
        """Return the result of a kart once it has so many laps."""

        def found(results: Standings) -> bool:
            return any((each.kart, each.laps) == (kart, laps) for each in results.karts)

        results = self.wait_for(found, f'{laps} laps of kart {kart}')
        return next(each for each in results.karts if each.kart == kart)

    def send(self, act: Act, **fields: object) -> list[Answer]:
        """Send a correction; return the list to which its answer is added."""
        answers: list[Answer] = []
        entry = CORRECTIONS[act]
        self._client.give(entry, 'Tina', {**entry.fixed, **fields}, answers.append)
        return answers

    def correct(self, act: Act, **fields: object) -> bool:
        """Give a correction; return whether it is accepted."""
        answers = self.send(act, **fields)
        self.wait_for(lambda _: answers, f'an answer to {act}')
        return answers[0].success

    def close(self) -> None:
        self._client.close()
        super().close()


class Event(WireRace):
    """
    Race control, an official, karts, a timing line, and a timekeeper that comes and goes.

    :ivar races: number of races so far.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        super().__init__(folder, KARTS, parameters={'banner': 'REHEARSAL'}, heats=HEATS)
        self._folder, self.book = folder, folder / 'timing.sqlite3'
        self.line = self._stack.enter_context(Line(self.domain))
        self.races = self._before = 0
        self.timekeeper = self.start_timekeeper()

    def start_timekeeper(self, clock_tolerance: float = 9.0) -> Process:
        """Start a timekeeper with the book of the one before."""
        given = {'min_lap_time': 1.0, 'clock_tolerance': clock_tolerance}
        return self._stack.enter_context(Timekeeper(self._folder, self.domain, given))

    def bring_to(self, state: RaceState) -> None:
        """Bring the race to a state, with the heat in it."""
        super().bring_to(RaceState.IN_GARAGE)
        self.official.command('set_heat', heat=HEAT)
        super().bring_to(state)

    def race(self) -> None:
        """Start a race of the heat, beside a timekeeper."""
        if not self.timekeeper.runs:
            self.timekeeper = self.start_timekeeper()
        self.races += 1
        self.bring_to(RaceState.GREEN_GREEN)
        self._before = len(self.official.events)
        self.line.wait_for(
            lambda seen: len(seen.races) == self.races and len(seen.karts) == len(KARTS),
            f'race {self.races}',
        )

    def assert_green(self) -> None:
        """Check that karts race on, now and for a while."""
        for kart in self.karts:
            kart.wait_for_frames(3)
            assert kart.state is RaceState.GREEN_GREEN

    def finishes(self) -> list[msg.RaceEvent]:
        """Return every FINISH that race control has answered since the last `race`."""
        finish, before = msg.CommandAvailability.KART_FINISH, self._before
        return [
            each
            for each in self.official.events[before:]
            if (each.kind, each.command) == (msg.RaceEvent.COMMAND, finish)
        ]


@pytest.fixture(scope='module')
def event(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Event]:
    """Return an event, which may have had races."""
    with Event(tmp_path_factory.mktemp('event')) as made:
        yield made


def marks(results: Standings) -> list[Mark]:
    return [each.mark for each in results.passings]


def test_laps_are_counted_and_a_kart_with_all_of_them_is_finished_once(event: Event) -> None:
    line, official = event.line, event.official
    event.race()
    _, second = line.laps(1, 2)
    line.sees(1, 0.0, number=second.number, stamp=second.stamp)  # the same one, said again
    (lap,) = line.wait_for_laps(1, 1).lap_times
    assert lap == pytest.approx(LAP)
    assert marks(line.wait_for_more()) == [Mark.COUNTED] * 2
    line.wait_for(lambda _: line.race[0] == 'GREEN GREEN', 'the race')
    _, seconds, *more = line.race
    assert 0.0 <= seconds < PATIENCE
    assert more == [{kart: f'Team {kart}' for kart in KARTS}, 'REHEARSAL']

    assert not event.finishes()
    line.laps(1, 1)
    official.wait_for_kart(1, lambda kart: kart.place == 1, 'the finish')
    assert line.wait_for_laps(1, 2).status is Status.CLASSIFIED
    (finish,) = event.finishes()
    assert (finish.kart, finish.official, finish.success) == (1, 'timekeeper', True)

    official.command('kart/undo_finish', kart=1)
    official.command('kart/red_red', kart=2)  # a kart that was stopped cannot finish
    line.laps(2, 3)
    line.wait_for_laps(2, 2)
    line.wait_for_more(5)  # it asks again after 2 s, where it must
    # What an official has undone, an official gives again; a refusal is final.
    assert [(each.kart, each.success) for each in event.finishes()] == [(1, True), (2, False)]


def test_a_flood_of_passings_is_bounded_and_told_and_holds_up_neither_stops_nor_laps(
    event: Event,
) -> None:
    line = event.line
    event.race()
    line.laps(1, 2)
    line.wait_for_laps(1, 1)  # a flood by the same publisher would take their place

    def flood() -> bool:
        """Say many passings, and return whether the timekeeper has told that some do not count."""
        for _ in range(2_000):
            line.sees(0, line.now(), source='gate', transponder='4711')
        return any('the limit' in each for seen in line.look() for each in seen.questions)

    for _ in range(10):
        flood()
    event.official.command('kart/red_red', kart=2)
    event.karts[1].wait_for_state(RaceState.RED_RED)
    event.karts[0].wait_for_frames(3)
    assert event.karts[0].state is RaceState.GREEN_GREEN
    # On a busy machine, too few of them may have arrived.
    line.wait_until_polled(flood, 'that some are over the limit')
    assert any('no kart has the transponder 4711' in each for each in line.heard[-1].questions)
    line.laps(1, 1)
    line.wait_for_laps(1, 2)
    event.official.wait_for_kart(1, lambda kart: kart.place == 1, 'the finish')


def kept(book: pathlib.Path) -> list[KartResult | None]:
    """Return the last result of kart 1 in each race, as the report finds it in the book."""
    found = [each for _, each in entries(book) if isinstance(each, Standings)]
    return [*{(each.run, each.race): each.kart(1) for each in found}.values()]


def test_one_that_hangs_holds_up_nobody_and_what_it_says_in_the_next_race_concerns_no_kart(
    event: Event,
) -> None:
    line = event.line
    event.race()
    line.laps(1, 2)
    line.wait_for_laps(1, 1)
    line.wait_until_polled(lambda: line.now() > line.ahead[1] + LAP, 'the time of its last lap')
    event.timekeeper.signal(signal.SIGSTOP)
    line.laps(1, 1)  # its last lap: the timekeeper would have it finish
    answers = line.send(Act.GIVE, kart=2, transponder='t9')
    event.assert_green()
    event.official.command('all_kill')
    event.bring_to(RaceState.GREEN_GREEN)
    event.timekeeper.signal(signal.SIGCONT)

    seen = line.wait_for(
        lambda seen: len(seen.races) > event.races and len(seen.passings) == 1, 'the next race'
    )
    assert marks(seen) == [Mark.NOT_COUNTED]
    line.wait_for(lambda _: answers, 'a late answer')
    assert answers == [Answer(True, 'transponder t9 belongs to kart 2')]
    assert [each.classified for each in seen.races[-2:]] == [0, 0]
    assert line.correct(Act.PENALISE, kart=1, race=event.races, seconds=5, reason='a short cut')
    first = kept(event.book)[event.races - 1]
    assert first is not None
    assert first.penalties
    line.laps(1, 2)
    line.wait_for_laps(1, 1)
    event.assert_green()
    assert not any(each.success for each in event.finishes())
    # Its book serves no second one.
    own = {'roster': event.book.with_name('karts.yaml'), 'book': event.book}
    with Process('evgp_timing', 'timekeeper', event.domain, own) as second:
        assert second.wait() == IN_THE_WAY
    assert 'another running timekeeper is using' in second.output
    event.timekeeper.close()
    assert [each and each.laps for each in kept(event.book)[-2:]] == [1, 1]
    event.races += 1


def test_karts_race_on_without_a_timekeeper_and_one_that_comes_back_has_every_lap(
    event: Event,
) -> None:
    event.timekeeper.close()
    line = event.line
    gone = [Answer(False, 'the timekeeper was not found. Nothing was sent')]
    line.wait_until_polled(lambda: line.send(Act.COUNT, kart=1) == gone, 'it is gone')
    event.timekeeper = event.start_timekeeper(clock_tolerance=0.5)
    crossed: list[float] = []

    def cross() -> None:
        """Have kart 1 cross now, a lap after the last time."""
        ready = crossed[-1] + LAP if crossed else 0.0
        line.wait_until_polled(lambda: line.now() >= ready, 'a lap')
        crossed.append(line.now())
        line.sees(1, crossed[-1])

    event.race()
    cross()
    line.wait_for(lambda seen: marks(seen) == [Mark.COUNTED], 'the first crossing')
    event.timekeeper.kill()
    event.assert_green()
    event.official.command('kart/finish', kart=2)
    cross()
    event.timekeeper = event.start_timekeeper(clock_tolerance=0.5)
    cross()
    times = line.wait_for_laps(1, 2).lap_times

    assert [*times] == pytest.approx([crossed[1] - crossed[0], crossed[2] - crossed[1]], abs=0.01)
    seen = line.wait_for_more()
    assert not [each for each in seen.questions if 'clock' in each or 'were lost' in each]
    event.official.wait_for_kart(1, lambda kart: kart.place == 2, 'the finish by its laps')


def test_corrections_go_to_the_timekeeper_and_no_stop_waits_for_one_that_is_frozen(
    event: Event, parts: contextlib.ExitStack
) -> None:
    event.race()
    lines = parts.enter_context(Lines(event.domain, event.official))

    def ends(code: int, *words: str) -> str:
        """Carry out a line, and return what it prints."""
        told = lines.run(*words)
        assert told.code == code, told
        return told.output + told.error

    def shown(text: str) -> str:
        """Return the results once this text is in them."""
        event.official.wait_until_polled(
            lambda: text in lines.run('results').output, f'{text} in the results'
        )
        return lines.run('results').output

    ends(ACCEPTED, 'count-passing', '1')
    which = shown('counted').splitlines()[-1].split(maxsplit=3)[3].removesuffix('counted')
    strike = 'strike-passing', *shlex.split(which), '--reason', 'a marshal crossed'
    ends(ACCEPTED, *strike)
    assert 'is struck out' in ends(REFUSED, *strike)
    ends(ACCEPTED, 'restore-passing', *shlex.split(which))
    assert 'give a reason' in ends(REFUSED, 'penalise', '2', '--seconds', '5')
    ends(ACCEPTED, 'penalise', '2', '--seconds', '5', '--reason', 'a short cut')
    shown('+5 s: a short cut')
    ends(ACCEPTED, 'undo-penalty', '2', '--race', f'{event.races}')
    assert 'under way' in ends(REFUSED, 'publish-results')
    assert 'no heat' in ends(REFUSED, 'choose-race', '--race', f'{event.races}')

    freeze(event.timekeeper.pid)
    ends(NOT_THERE, 'count-passing', '1', '--wait', '1')
    ends(ACCEPTED, 'kart-red-flag', '1')
    event.karts[0].wait_for_state(RaceState.RED_FLAG)
    ends(ACCEPTED, 'all-kill')
    event.karts[1].wait_for_state(RaceState.RED_RED)
    event.timekeeper.kill()
    # On a busy machine, ROS itself may need longer to start than a short wait allows.
    calls = {'count-passing 1': 'the timekeeper was not found', 'results': 'no timing'}
    started = [start(event.domain, *line.split(), '--wait', '10') for line in calls]
    for lost, said in zip(started, calls.values(), strict=True):
        with lost:
            assert said in lost.communicate(timeout=2 * PATIENCE)[1]
            assert lost.returncode == NOT_THERE


# ----- events and passings on paper ---------------------------------------------------------


def test_lost_events_are_told_but_none_of_before_a_restart(
    tmp_path: pathlib.Path, domain: int
) -> None:
    own = {'roster': write_roster(tmp_path, KARTS), 'book': tmp_path / 'timing.sqlite3'}
    given = [Parameter(name, value=str(path)) for name, path in own.items()]
    grid = msg.RaceEvent(
        kind=msg.RaceEvent.COMMAND, command=msg.CommandAvailability.GRID_ACTIVE, success=True
    )
    green = msg.RaceEvent(
        kind=msg.RaceEvent.RACE_STATE, state=msg.RaceState(state=msg.RaceState.GREEN_GREEN)
    )
    more, *others = [msg.RaceEvent(kind=msg.RaceEvent.ACKNOWLEDGED) for _ in range(401)]

    with joined(domain) as context:
        for after, events, lost in (
            (0, [grid, green, *others], 0),
            (402, [more], 0),
            (410, [more], 7),
        ):
            restarted = timekeeper.Timekeeper(
                lambda _: None, context=context, parameter_overrides=given
            )
            for number, each in enumerate(events, after + 1):
                each.sequence, each.race = number, 1
            restarted._hear(msg.RaceEvents(run='a run', events=events))
            told = f'{lost} events from race control were lost. Check the laps'
            assert restarted._desk.questions() == [told] * bool(lost)
            restarted.close()
            restarted.destroy_node()


def test_a_command_that_was_refused_says_nothing_of_laps() -> None:
    event = msg.RaceEvent(kind=msg.RaceEvent.COMMAND, command=msg.CommandAvailability.KART_FINISH)
    assert told_of(event, 'run') is None
    event.success = True
    told = told_of(event, 'run')
    assert told is not None
    assert told.what is What.FINISH


@pytest.mark.parametrize('name', [BY_HAND, f' {BY_HAND}\n'])
def test_no_source_passes_for_an_official_or_saw_anything_before_1970(name: str) -> None:
    passing = passing_of(msg.Passing(source=name, stamp=Time(sec=-1)))
    assert (passing.source, passing.stamp_ns) == ('', 0)


def test_each_finish_names_the_run_and_the_race_that_it_is_for() -> None:
    asked: list[srv.KartFinish.Request] = []

    def call_async(request: srv.KartFinish.Request) -> Future[Any]:
        asked.append(request)
        return Future()

    node = SimpleNamespace(_finish=SimpleNamespace(call_async=call_async))
    timekeeper.Timekeeper._ask_for(cast(Any, node), Finish('a run', 3, 1))
    (request,) = asked
    assert (request.run, request.race, request.attempt, request.kart) == ('a run', 3, 0, 1)


def test_with_the_enclave_of_race_control_it_takes_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(timekeeper, 'run_node', lambda *_: 0)
    enclaves = {'': '', '/rcs': '/timekeeper', '/event/rcs': '/event/timekeeper'}
    for given, own in {**enclaves, '/timekeeper': '/timekeeper'}.items():
        monkeypatch.setenv('ROS_SECURITY_ENCLAVE_OVERRIDE', given)
        timekeeper.main([])
        assert os.environ['ROS_SECURITY_ENCLAVE_OVERRIDE'] == own
