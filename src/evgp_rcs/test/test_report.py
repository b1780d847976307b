# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of a run: what the events say, and nothing that they do not say."""

from __future__ import annotations

from collections.abc import Sequence
import hashlib
import pathlib
import random
import re

from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CommandKind
from evgp_rcs.encoding import written as as_json
from evgp_rcs.inputs import CLOSED_BY_KART
from evgp_rcs.race import Event, EventKind, Heat, Kart, LastRun, Race, RaceMemory
from evgp_rcs.rcs_record import main as rcs_record
from evgp_rcs.record import Record, RecordedEvent, rules_version
from evgp_rcs.report import wording
from evgp_rcs.report.command import seconds_of
from evgp_rcs.report.model import (
    Account,
    Change,
    GREEN_GREEN,
    IN_GARAGE,
    Lane,
    NOT_CONNECTED,
    NOT_KNOWN,
    OF_THE_SERVER,
    Part,
    read,
    RED_FLAG,
    RED_RED,
    Silence,
    Stop,
    Why,
)
from evgp_rcs.report.wording import Clock
from evgp_rcs.runs import PARTLY
import pytest
from recorded_races import PaperRace
from test_replay import change, Running, SETUP

TEAMS = {7: 'Purdue', 8: 'Michigan', 9: 'Kennesaw'}


@pytest.fixture
def paper() -> PaperRace:
    """Return a race with three karts, all connected."""
    race = PaperRace(TEAMS, [Heat('Heat A', (7, 8, 9)), Heat('Heat B', (7, 8, 9))])
    race.connect(*TEAMS)
    race.wait(1.0)
    return race


def lane(account: Account, number: int) -> Lane:
    (found,) = [each for each in account.lanes if each.kart == number]
    return found


def sent(account: Account, number: int) -> list[str]:
    return [band.what for band in lane(account, number).bands]


def without(events: Sequence[RecordedEvent], first: int, last: int) -> list[RecordedEvent]:
    return [event for event in events if not first <= event.sequence <= last]


def test_a_lane_shows_what_the_kart_was_sent_and_when_it_acknowledged(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(10.0)
    paper.command(CommandKind.ALL_KILL)
    paper.wait(2.0)
    paper.say(7)
    paper.go_home()
    paper.wait(1.0)
    account = read(paper.events)
    # The grid was left at the moment at which it was formed: it did not last.
    assert sent(account, 7) == [IN_GARAGE, GREEN_GREEN, RED_RED, IN_GARAGE]
    _, green, red, _ = lane(account, 7).bands
    assert green.acknowledged == green.start
    assert red.acknowledged == pytest.approx(red.start + 2.0)
    assert [band.what for band in account.race_bands] == [
        IN_GARAGE,
        GREEN_GREEN,
        RED_RED,
        IN_GARAGE,
    ]


def test_a_stop_has_its_two_times_for_each_kart(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(10.0)
    paper.command(CommandKind.RED_FLAG)
    paper.deliver(7, 0.031)
    paper.deliver(8, 0.62)
    paper.wait(5.0)
    account = read(paper.events)
    (stop,) = account.stops(account.races[0])
    after = [told.delivered and told.delivered - stop.at for told in stop.told]
    assert after == [pytest.approx(0.031), pytest.approx(0.62), None]
    cells = [wording.answers(stop, told, Clock(0))[1] for told in stop.told]
    assert cells == ['0.031 s', '0.620 s', 'not seen']


def test_a_lane_shows_how_good_the_link_was(paper: PaperRace) -> None:
    def link() -> list[tuple[str, float]]:
        bands = lane(read(paper.events), 7).links
        return [(band.what, round(band.end - band.start, 2)) for band in bands]

    for grade in (Grade.GOOD, Grade.POOR):
        paper.measure(7, grade)
        paper.wait(3.0)
    paper.lose(7)
    paper.wait(2.0)
    paper.connect(7)
    paper.measure(7, Grade.FAIR)
    paper.wait(1.0)
    paper.say(8)
    known = [('GOOD', 3.0), ('POOR', 3.0), ('UNKNOWN', 2.0), ('FAIR', 1.0)]
    assert link() == [('UNKNOWN', 1.0), *known]
    part = Part(2.0, 5.0).narrow(read(paper.events))
    assert [band.what for band in lane(part, 7).links] == ['GOOD', 'POOR']


def test_bands_say_what_the_rules_sent_at_every_moment(chance: random.Random) -> None:
    paper = PaperRace(dict.fromkeys(range(1, 6), ''))
    truth: list[tuple[int, int, str]] = []
    take = paper.take

    def look(outcome: object) -> object:
        taken = take(outcome)  # type: ignore[arg-type]
        for kart in paper.race.karts.values():
            what = kart.sent.name if kart.connected else NOT_CONNECTED
            truth.append((len(paper.stamped), kart.number, what))
        return taken

    paper.take = look  # type: ignore[method-assign, assignment]
    commands = list(CommandKind)
    for _ in range(300):
        number = chance.randint(1, 5)
        kart = paper.race.karts[number]
        chance.choice(
            [
                lambda n=number: paper.lose(n),
                lambda n=number: paper.connect(n),
                lambda n=number: paper.say(n),
                lambda n=number: paper.say(n, chance.choice(list(RaceState))),
                lambda n=number: paper.command(chance.choice(commands), n),
                paper.drive,
            ]
        )()
        assert kart.number == number
        paper.wait(0.5)
    events = paper.events
    account = read(events)
    for count, number, what in truth[:: len(truth) // 2000 + 1]:
        if not count or number not in {each.kart for each in account.lanes}:
            continue
        # Between this input and the next one.
        at = account.at(events[count - 1]) + 0.001
        later = account.at(events[count]) if count < len(events) else account.length
        if at < later:
            (band,) = [each for each in lane(account, number).bands if each.start <= at < each.end]
            assert band.what == what


def test_holds_that_are_shown_are_holds_of_the_rules(chance: random.Random) -> None:
    paper = PaperRace(dict.fromkeys(range(1, 6), ''))
    held: list[tuple[float, set[int]]] = []
    for _ in range(300):
        number = chance.randint(1, 5)
        chance.choice(
            [
                lambda n=number: paper.lose(n),
                lambda n=number: paper.connect(n),
                paper.acknowledge,
                lambda n=number: paper.command(chance.choice(list(CommandKind)), n),
                paper.drive,
            ]
        )()
        now = {kart.number for kart in paper.race.karts.values() if kart.hold is not None}
        held.append((paper.now - paper.stamped[0].monotonic if paper.stamped else -1.0, now))
        paper.wait(0.5)
    account = read(paper.events)
    shown = 0
    for at, numbers in held:
        for each in account.lanes:
            for hold in each.holds:
                if hold.start <= at + 0.1 < hold.end:
                    shown += 1
                    assert each.kart in numbers
    assert shown


@pytest.mark.parametrize('kind', sorted(OF_THE_SERVER))
def test_what_the_server_tells_of_a_kart_ends_no_hold(paper: PaperRace, kind: str) -> None:
    paper.drive()
    paper.command(CommandKind.KART_RED_RED, 7)
    paper.wait(5.0)
    paper.tell([Event(EventKind[kind], 'it is so', 7, success=False)])
    paper.wait(5.0)
    paper.command(CommandKind.RACE_OVER)
    account = read(paper.events)
    assert [hold.end for hold in lane(account, 7).holds] == [account.length]


def test_a_hold_is_not_put_down_to_a_command_that_came_later(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(5.0)
    paper.lose(7)
    paper.wait(5.0)
    paper.command(CommandKind.ALL_KILL)
    paper.wait(5.0)
    account = read(paper.events)
    assert [hold.command for hold in lane(account, 7).holds] == ['']
    assert [hold.command for hold in lane(account, 8).holds] == ['ALL_KILL']


def test_every_change_of_state_has_the_command_that_caused_it(paper: PaperRace) -> None:
    paper.drive()
    paper.command(CommandKind.KART_FINISH, 7)
    paper.command(CommandKind.RED_FLAG)
    paper.wait(1.0)
    paper.command(CommandKind.ALL_KILL, official='Grace')
    paper.wait(1.0)
    paper.go_home()
    (race,) = read(paper.events).races
    by = {event.sequence: (event.command, event.official) for event in paper.events}
    assert [(change.state, *by[change.by]) for change in race.changes] == [
        ('GRID_ACTIVE', 'GRID_ACTIVE', 'Ada'),
        ('GREEN_GREEN', 'GREEN_GREEN', 'Ada'),
        ('RED_FLAG', 'RED_FLAG', 'Ada'),
        ('RED_RED', 'ALL_KILL', 'Grace'),
        ('IN_GARAGE', 'IN_GARAGE', 'Ada'),
    ]
    assert race.garage is not None
    assert race.results


def test_every_kind_of_event_has_a_name() -> None:
    assert wording.KINDS.keys() == EventKind.__members__.keys()


@pytest.mark.parametrize('waits', [1.0, 8.0], ids=['at once', 'after its RED_FLAG'])
def test_a_starter_that_was_stopped_and_has_no_place_is_an_incident(
    paper: PaperRace, waits: float
) -> None:
    paper.drive()
    paper.command(CommandKind.KART_FINISH, 7)
    paper.wait(waits)
    paper.command(CommandKind.KART_UNDO_FINISH, 7)
    paper.wait(20.0)
    stopped = paper.race.karts[7].sent is RaceState.RED_FLAG
    paper.command(CommandKind.RACE_OVER)
    (race,) = read(paper.events).races
    assert bool(race.incidents) is (7 in race.out) is stopped
    assert {out.sequence for out in race.out.values()} <= set(race.incidents)


def test_who_was_lost_or_stopped_alone_did_not_finish_for_that_reason(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(5.0)
    paper.command(CommandKind.KART_RED_RED, 7)
    paper.wait(5.0)
    paper.lose(8)
    paper.wait(5.0)
    paper.command(CommandKind.ALL_KILL)
    account = read(paper.events)
    (race,) = account.races
    texts = {event.sequence: event.command or event.kind for event in paper.events}
    out = {result.kart: result.out for result in account.results(race)}
    assert {kart: (why.why, texts[why.sequence]) for kart, why in out.items() if why} == {
        7: (Why.STOPPED_ALONE, 'KART_RED_RED'),
        8: (Why.LOST, 'DISCONNECTED'),
        9: (Why.RACE_STOPPED, 'ALL_KILL'),
    }
    incidents = [texts[number] for number in race.incidents]
    assert incidents == ['KART_RED_RED', 'DISCONNECTED', 'ALL_KILL']


def test_a_stop_has_who_was_told_who_acknowledged_and_who_was_slowest(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(5.0)
    paper.command(CommandKind.KART_RED_RED, 9)
    paper.wait(1.0)
    paper.say(9)
    paper.command(CommandKind.RED_FLAG)
    paper.wait(2.0)
    paper.say(7)
    paper.command(CommandKind.ALL_KILL)
    paper.wait(1.0)
    paper.say(8)
    paper.wait(0.5)
    paper.lose(7)
    paper.wait(2.0)
    paper.command(CommandKind.ALL_KILL)
    account = read(paper.events)
    (race,) = account.races
    alone, flag, kill, again = account.stops(race)
    kinds = {event.sequence: event.command for event in paper.events}
    assert [kinds[each.sequence] for each in (alone, flag, kill, again)] == [
        'KART_RED_RED',
        'RED_FLAG',
        'ALL_KILL',
        'ALL_KILL',
    ]

    def told(stop: Stop) -> dict[int, tuple[str, float | None, Silence | None]]:
        return {
            each.kart: (
                each.what,
                None if each.acknowledged is None else round(each.acknowledged - each.since, 3),
                each.silence,
            )
            for each in stop.told
        }

    assert told(alone) == {9: (RED_RED, 1.0, None)}
    assert told(flag) == {
        7: (RED_FLAG, 2.0, None),
        8: (RED_FLAG, None, Silence.TOLD_ELSE),
        9: (RED_RED, 1.0, None),
    }
    assert told(kill) == {
        7: (RED_RED, None, Silence.LOST),
        8: (RED_RED, 1.0, None),
        9: (RED_RED, 1.0, None),
    }
    assert told(again)[7] == (NOT_CONNECTED, None, None)
    # Kart 9 had been told before: it says nothing about these stops.
    slowest = [each.slowest() for each in (alone, flag, kill, again)]
    assert [each and each.kart for each in slowest] == [9, 7, 8, None]


def test_a_stop_that_no_kart_acknowledges_until_the_record_ends_says_so(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(5.0)
    paper.command(CommandKind.RACE_OVER)
    paper.wait(5.0)
    account = read(paper.events)
    (stop,) = account.stops(account.races[0])
    assert [each.silence for each in stop.told] == [Silence.RECORD_ENDS] * 3
    assert stop.slowest() is None


def test_a_race_that_goes_over_by_itself_has_a_stop_without_a_command(paper: PaperRace) -> None:
    paper.drive()
    for number in TEAMS:
        paper.command(CommandKind.KART_FINISH, number)
    paper.wait(30.0)
    account = read(paper.events)
    last = account.stops(account.races[0])[-1]
    (event,) = [each for each in paper.events if each.sequence == last.sequence]
    assert (event.kind, event.state) == ('RACE_STATE', RED_RED)
    assert account.races[0].stop == Change(last.at, RED_RED, event.sequence, by=0)
    assert [each.what for each in last.told] == [RED_RED] * 3


def test_where_events_are_missing_a_stop_is_not_said_to_be_unacknowledged(
    paper: PaperRace,
) -> None:
    paper.drive()
    paper.wait(5.0)
    paper.command(CommandKind.ALL_KILL)
    paper.wait(1.0)
    paper.say(8)
    paper.say(7)
    hidden = len(paper.stamped)
    paper.wait(1.0)
    paper.lose(9)
    account = read(without(paper.events, hidden, hidden))
    (stop,) = account.stops(account.races[0])
    assert [each.silence for each in stop.told] == [Silence.NOT_KNOWN, None, Silence.NOT_KNOWN]


def test_a_stop_at_which_race_control_ends_unacknowledged_lost_no_connection(
    paper: PaperRace,
) -> None:
    paper.drive()
    paper.command(CommandKind.ALL_KILL)
    paper.wait(1.0)
    paper.end()
    account = read(paper.events)
    (stop,) = account.stops(account.races[0])
    assert {each.silence for each in stop.told} == {Silence.RECORD_ENDS}


def test_a_connection_that_the_kart_closed_is_counted_apart(
    paper: PaperRace, tmp_path: pathlib.Path
) -> None:
    paper.drive()
    paper.lose(7)
    paper.wait(1.0)
    paper.take(paper.race.disconnected(8, CLOSED_BY_KART, paper.now))
    paper.wait(1.0)
    page = report(paper.write(tmp_path / 'record.sqlite3'))
    assert '1 lost connection during' in page
    assert 'closed 1 connection ' in page


def test_the_page_has_the_stops_the_refusals_and_the_label_of_each_command(
    paper: PaperRace, tmp_path: pathlib.Path
) -> None:
    paper.drive()
    paper.wait(5.0)
    paper.command(CommandKind.GRID_ACTIVE, official='Grace')
    paper.command(CommandKind.ALL_KILL)
    paper.wait(2.0)
    paper.say(7)
    page = report(paper.write(tmp_path / 'record.sqlite3'))
    (stops,) = re.findall(r'<table class="stops">.*?</table>', page, re.DOTALL)
    assert stops.count('<tr><td>') == 3
    assert '2.000 s' in stops
    (refusals,) = re.findall(r'<table class="refusals">.*?</table>', page, re.DOTALL)
    assert refusals.count('<tr><td>') == 1
    assert 'Grace' in refusals
    (events,) = re.findall(r'<div id="paper">.*?</table>', page, re.DOTALL)
    assert '<b>ALL KILL</b>' in events


def test_a_race_has_the_commands_that_were_refused_in_it(paper: PaperRace) -> None:
    paper.command(CommandKind.GREEN_GREEN)  # before the race
    paper.drive()
    paper.command(CommandKind.GRID_ACTIVE)
    account = read(paper.events)
    (race,) = account.races
    refused = [event for event in paper.events if event.sequence in race.refused]
    assert [event.command for event in refused] == ['GRID_ACTIVE']
    assert not any(event.success for event in refused)


def test_all_kill_in_the_garage_is_no_race(paper: PaperRace) -> None:
    paper.command(CommandKind.ALL_KILL)
    account = read(paper.events)
    assert account.races == []
    assert len(account.outside) == 1


def test_an_alert_stands_until_it_is_cleared_also_beside_another_of_that_kart(
    paper: PaperRace,
) -> None:
    paper.drive()
    paper.lose(7)
    # Back, it must still stop, which it was told to long ago: two alerts.
    paper.wait(11.0)
    paper.connect(7)
    paper.wait(1.0)
    paper.lose(7)  # then only the first one
    paper.wait(1.0)
    lost, unanswered = (each for each in read(paper.events).alerts if each.kart == 7)
    assert lost.stands
    assert not unanswered.stands
    assert unanswered.raised is not None
    assert unanswered.ended == pytest.approx(unanswered.raised + 1.0)


def test_after_a_gap_nothing_is_known_until_the_record_says_it_again(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(10.0)
    paper.command(CommandKind.KART_RED_RED, 8)
    paper.wait(10.0)
    before = len(paper.stamped)
    paper.command(CommandKind.KART_RED_FLAG, 7)
    hidden = len(paper.stamped)
    paper.wait(10.0)
    paper.say(9, RED)
    paper.wait(10.0)
    paper.say(9)
    paper.wait(1.0)
    paper.command(CommandKind.ALL_KILL)
    paper.wait(1.0)
    paper.tell(paper.race.tick(paper.now).events)
    paper.lose(9)
    account = read(without(paper.events, before + 1, hidden))
    (gap,) = account.gaps
    assert gap.missing == hidden - before
    assert sent(account, 7)[-3:] == [GREEN_GREEN, NOT_KNOWN, RED_RED]
    assert NOT_KNOWN in [band.what for band in account.race_bands]
    # Only what it is being sent can be acknowledged: that is known again.
    known_again = sent(account, 9).index(NOT_KNOWN) + 1
    assert sent(account, 9)[known_again] == GREEN_GREEN
    assert account.races[0].incomplete
    assert not any(alert.stands for alert in account.alerts if (alert.raised or 0) < gap.start)


RED = RaceState.RED_RED


def test_two_races_are_told_apart_where_what_was_between_them_is_missing(paper: PaperRace) -> None:
    paper.command(CommandKind.SET_HEAT, heat='Heat A')
    paper.drive()
    paper.wait(10.0)
    paper.command(CommandKind.RACE_OVER)
    before = len(paper.stamped)
    paper.go_home()
    paper.command(CommandKind.SET_HEAT, heat='Heat B')
    paper.command(CommandKind.GRID_ACTIVE)
    after = len(paper.stamped) + 1
    paper.acknowledge()
    paper.command(CommandKind.GREEN_GREEN)
    paper.wait(1.0)
    first, second = read(without(paper.events, before + 1, after - 1)).races
    assert [(each.number, each.heat) for each in (first, second)] == [(1, 'Heat A'), (2, 'Heat B')]
    assert first.incomplete
    assert second.incomplete
    assert second.starters == [7, 8, 9]


def test_a_record_without_its_beginning_says_so(paper: PaperRace) -> None:
    paper.drive()
    hidden = len(paper.stamped)
    paper.say(7, RED)
    paper.wait(10.0)
    paper.command(CommandKind.ALL_KILL)
    paper.wait(10.0)
    paper.lose(9)
    account = read(without(paper.events, 1, hidden))
    assert account.gaps[0].missing == hidden
    assert sent(account, 9) == [NOT_KNOWN, RED_RED, NOT_CONNECTED]
    assert [band.what for band in account.race_bands] == [NOT_KNOWN, RED_RED]


def test_a_race_that_was_taken_up_is_shown_as_begun_before() -> None:
    paper = PaperRace(TEAMS)
    memory = Race([Kart(number, team, True) for number, team in TEAMS.items()]).memory()
    crashed = RaceMemory(RaceState.GREEN_GREEN, memory.karts)
    paper.take(paper.race.recover(crashed, LastRun.UNKNOWN, paper.now))
    paper.connect(*TEAMS)
    paper.wait(1.0)
    paper.go_home()
    paper.wait(1.0)
    account = read(paper.events)
    (race,) = account.races
    assert race.taken_up
    assert not race.incomplete
    assert race.garage is not None
    assert all(each.holds for each in account.lanes)


def test_a_connection_that_ends_with_race_control_is_no_incident(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(1.0)
    paper.end()
    account = read(paper.events)
    assert account.ended is not None
    assert account.outside == []
    assert account.races[0].incidents == []


def test_a_wall_clock_that_was_set_changes_no_duration(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(10.0)
    paper.wall_offset_ns -= 3600 * 10**9
    paper.command(CommandKind.ALL_KILL)
    account = read(paper.events)
    (step,) = account.clock_steps
    assert step.by == pytest.approx(-3600.0)
    assert account.length == pytest.approx(11.0)


def test_a_command_to_a_kart_that_does_not_exist_makes_no_lane(paper: PaperRace) -> None:
    paper.command(CommandKind.KART_RED_RED, 99)
    account = read(paper.events)
    assert [each.kart for each in account.lanes] == [7, 8, 9]
    assert len(account.commands) == 1


def test_a_part_keeps_what_was_sent_before_it(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(20.0)
    paper.command(CommandKind.KART_RED_FLAG, 7)
    paper.wait(20.0)
    account = read(paper.events)
    part = Part(10.0, 30.0, 7).narrow(account)
    assert [(band.start, band.what) for band in lane(part, 7).bands] == [
        (10.0, GREEN_GREEN),
        (pytest.approx(21.0), RED_FLAG),
    ]
    assert [each.kart for each in part.lanes] == [7]
    assert {event.kart for event in part.events} == {7}
    assert part.races


@pytest.mark.parametrize(
    ('text', 'seconds'),
    [
        ('+90', 90.0),
        ('23:59:30', 30.0),
        ('23:59', 0.0),
        ('00:00:30', 90.0),
        ('2026-05-31T00:01', 120.0),
    ],
)
def test_a_time_is_given_as_the_clock_showed_it(text: str, seconds: float) -> None:
    clock = Clock(0)
    began = clock.moment(0).replace(year=2026, month=5, day=30, hour=23, minute=59)
    assert seconds_of(text, Clock(round(began.timestamp()) * 10**9)) == seconds


@pytest.mark.parametrize('text', ['', 'noon', '25:00', '12', '+', '-5', '12:00:00:00'])
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match='no time'):
        seconds_of(text, Clock(0))


@pytest.mark.parametrize('began_ns', [0, 499_999, 500_000, 999_999_999])
def test_the_times_that_are_shown_add_up(chance: random.Random, began_ns: int) -> None:
    clock = Clock(began_ns)

    def shown(at: float) -> int:
        hours, minutes, rest = clock.at(at, 3).split(':')
        return (int(hours) * 60 + int(minutes)) * 60_000 + round(float(rest) * 1000)

    for _ in range(1000):
        start = chance.uniform(0.0, 50.0)
        end = start + chance.uniform(0.0, 9.0)
        took = float(wording.exact(start, end).removesuffix(' s'))
        assert (shown(end) - shown(start)) % 86_400_000 == round(took * 1000)
        assert took == wording.between(start, end)


def test_a_time_of_day_is_rounded_never_cut() -> None:
    clock = Clock(1_780_135_500_000_000_000)
    assert clock.at(50.26, 1).endswith(':50.3')
    assert clock.at(50.96, 1).endswith(':51.0')
    assert clock.at(50.5).endswith(':51')


# ----- rcs_record report ----------------------------------------------------------------------

HOSTILE = (
    '<script>document.title="broken"</script>',
    '</script><script>document.title="broken"</script>',
    '"><img src="http://192.0.2.1/x" onerror="document.title=1">',
    '\u202egnp.exe\u202c',
    '=cmd()',
    'x' * 10_000,
    '${title}\x00\x1b[2J',
)


@pytest.fixture
def written(paper: PaperRace, tmp_path: pathlib.Path) -> pathlib.Path:
    paper.drive()
    paper.wait(5.0)
    paper.command(CommandKind.ALL_KILL)
    paper.end()
    return paper.write(tmp_path / 'record.sqlite3')


def report(record: pathlib.Path, *arguments: str) -> str:
    page = record.with_name('report.html')
    assert rcs_record(['report', str(record), '-o', str(page), *arguments]) == 0
    return page.read_text(encoding='utf-8')


@pytest.mark.parametrize('is_in_order', [True, False])
def test_that_a_run_ended_in_good_order_is_what_its_events_say(
    written: pathlib.Path, is_in_order: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    if not is_in_order:
        change(written, "UPDATE event SET success = 0 WHERE kind = 'ENDED'")
    capsys.readouterr()
    assert rcs_record([str(written), '--list']) == 0
    assert ('not ended in good order' in capsys.readouterr().out) is not is_in_order
    assert ('ended in good order at' in report(written)) is is_in_order


def test_a_damaged_record_too_says_that_a_run_did_not_end_in_good_order(
    written: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(written, "UPDATE event SET success = 0 WHERE kind = 'ENDED'")
    change(written, "UPDATE session SET began_ns = 'noon'")
    capsys.readouterr()
    assert rcs_record([str(written), '--list']) == PARTLY
    assert 'not ended in good order' in capsys.readouterr().out


def table(page: str, kind: str) -> list[list[str]]:
    """Return the cells of the only table of this kind."""
    (found,) = re.findall(rf'<table class="{kind}">.*?<tbody>(.*?)</table>', page, re.DOTALL)
    rows = [re.split('</t[dh]>', row)[:-1] for row in found.split('</tr>')[:-1]]
    return [[' '.join(re.sub('<[^>]*>', '', cell).split()) for cell in row] for row in rows]


def with_laps(paper: PaperRace) -> None:
    """Have 7 and 8 drive two laps, where 8 overtakes; 9 does one, and is seen twice."""
    paper.drive()
    for crossing in ((7, 8, 9), (8, 7, 9, 9), (8, 7)):
        for kart in crossing:
            paper.wait(1.0)
            paper.cross(kart)
        paper.wait(10.0)
    paper.cross(transponder='4711')
    paper.command(CommandKind.KART_FINISH, 7)
    paper.command(CommandKind.KART_FINISH, 8)
    paper.command(CommandKind.ALL_KILL)


def test_a_race_has_its_results_by_laps_its_lap_times_and_its_lap_chart(
    paper: PaperRace, tmp_path: pathlib.Path
) -> None:
    with_laps(paper)
    page = report(paper.write(tmp_path / 'record.sqlite3'))
    assert 'no difference' in page
    assert table(page, 'order results') == [
        ['1.', 'Kart 8 (Michigan)', '2', '28.000 s', '12.000 s', '', 'CLASSIFIED'],
        ['2.', 'Kart 7 (Purdue)', '2', '29.000 s', '14.000 s', '', 'CLASSIFIED'],
        ['-', 'Kart 9 (Kennesaw)', '1', '16.000 s', '13.000 s', '', 'DNF'],
    ]
    assert [row[1] for row in table(page, 'laps')] == [
        '1: 12.000 ★ 2: 14.000',
        '1: 14.000 ★ 2: 14.000 ★',
        '1: 13.000 ★',
    ]
    assert table(page, 'chart') == [['1', '8', '7', '9'], ['2', '8', '7']]
    seen = [row[1:] for row in table(page, 'passings')]
    assert seen == [
        ['Kart 9 (Kennesaw)', 'line 7', 'doubtful'],
        ['not known', 'line 10, transponder 4711', 'unknown'],
    ]


def test_a_race_has_its_corrections_until_the_next_one_begins(
    paper: PaperRace, tmp_path: pathlib.Path
) -> None:
    with_laps(paper)
    paper.strike(8, 'it was 9', 'Grace')
    paper.go_home()
    paper.command(CommandKind.PENALISE, 7, seconds=5, reason='a cone')
    paper.command(CommandKind.UNDO_PENALTY, 8)
    paper.drive()
    paper.command(CommandKind.PENALISE, 7, 'Eve', seconds=5, reason='another')
    account = read(paper.events)
    by = [[(each.command, each.official) for each in account.corrections(n)] for n in (1, 2)]
    assert by == [
        [('STRIKE_PASSING', 'Grace'), ('PENALISE', 'Ada')],
        [('PENALISE', 'Eve')],
    ]
    first, _ = report(paper.write(tmp_path / 'record.sqlite3')).split('<h3>Race 2')
    assert table(first, 'passings')[1][3] == 'struck out: it was 9, by Grace'
    assert [row[5] for row in table(first, 'order results')] == ['+5 s: a cone (Ada)', '', '']


def test_laps_that_were_not_counted_are_said_to_be_missing(
    paper: PaperRace, tmp_path: pathlib.Path
) -> None:
    missing = re.compile('<li class=bad>Laps are missing')
    record = PaperRace(TEAMS).write(tmp_path / 'none.sqlite3')
    assert not missing.search(report(record, '--quick'))
    with_laps(paper)
    record = paper.write(tmp_path / 'record.sqlite3')
    assert missing.search(report(record, '--quick'))
    change(record, 'UPDATE session SET setup = NULL')
    assert missing.search(report(record))


def test_a_report_names_who_brought_the_race_to_each_state_with_what(
    written: pathlib.Path,
) -> None:
    (changes,) = re.findall(r'<ul class="changes">(.*?)</ul>', report(written), re.DOTALL)
    *_, stop = changes.strip().splitlines()
    assert re.search(r'Stopped: RED RED.*<bdi>Ada</bdi>.*ALL KILL', stop)


def test_a_report_says_whether_the_run_was_replayed(tmp_path: pathlib.Path) -> None:
    record = tmp_path / 'record.sqlite3'
    writer = Record(record)
    writer.begin(rules_version(), SETUP)
    for events, block in Running(seed=1).run(300).end().handed_over:
        writer.put(events, block)
    writer.end()
    replayed = re.compile(r'<li>(?:(?!</li>).)*no difference</bdi></li>')
    assert replayed.search(report(record))
    assert 'was not replayed' in report(record, '--quick')
    change(record, 'UPDATE event SET monotonic = monotonic - 1 WHERE sequence = 20')
    assert re.search(r'<li class=bad>.*The first difference is event 20,', report(record))
    change(record, 'UPDATE session SET setup = NULL')
    assert 'was not replayed' in report(record)


def test_the_sums_are_of_the_file_and_of_the_events_and_change_with_any_of_them(
    written: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    def sums(page: str) -> list[str]:
        return re.findall(r'<code>(\w{64})</code>', page)

    first, again = sums(report(written)), sums(report(written))
    assert first == again
    assert hashlib.sha256(written.read_bytes()).hexdigest() in first
    change(written, "UPDATE event SET official = 'Eve' WHERE command = 'ALL_KILL'")
    assert not set(sums(report(written))) & set(first)


def test_of_a_record_that_is_being_written_only_what_was_read_is_summed(
    written: pathlib.Path,
) -> None:
    record = Record(written)
    try:
        page = report(written)
    finally:
        record.end()
    assert len(re.findall(r'<code>\w{64}</code>', page)) == 1
    assert 'race control was writing it' in page


def test_a_report_of_a_part_says_so_wherever_it_could_be_mistaken(written: pathlib.Path) -> None:
    assert 'only a part' not in report(written)
    for arguments in (('--from', '+1'), ('--to', '+2'), ('--kart', '7')):
        page = report(written, *arguments)
        # At the top, at the timeline, at the table; and on each sheet of paper, and in the title.
        assert page.count('This report shows only a part of the run') == 3
        assert 'shows only' in re.findall(r'@bottom-left.*', page)[0]
        assert '(a part only)</title>' in page


@pytest.mark.parametrize(
    'arguments', [('--from', '+999'), ('--from', '+3', '--to', '+2'), ('--kart', '99')]
)
def test_a_part_that_has_nothing_in_it_is_refused(
    written: pathlib.Path, arguments: tuple[str, ...]
) -> None:
    with pytest.raises(SystemExit) as ended:
        report(written, *arguments)
    assert ended.value.code == 2
    assert not written.with_name('report.html').exists()


def test_a_report_that_cannot_be_written_is_a_sentence(
    written: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = written / 'report.html'
    assert rcs_record(['report', str(written), '-o', str(output)]) == 1
    assert str(output) in capsys.readouterr().err


def test_a_report_of_a_run_without_events_can_be_made(tmp_path: pathlib.Path) -> None:
    written = PaperRace(TEAMS).write(tmp_path / 'record.sqlite3')
    assert '<html' in report(written)
    assert '<html' in report(written, '--from', '+0')


def test_a_kart_has_the_name_of_its_team_and_the_rules_their_version(
    written: pathlib.Path,
) -> None:
    setup = PaperRace({7: 'Purdue', 12: 'The <b>Absent</b>'}).setup
    change(written, "UPDATE session SET rules = 'rules-1234', setup = ?", as_json(setup))
    page = report(written)
    assert 'rules-1234' in page
    assert 'Kart 7 (<bdi>Purdue</bdi>)' in page
    assert '"kart":12,"team":"The \\u003cb\\u003eAbsent' in page


def test_names_of_others_are_nothing_but_text(tmp_path: pathlib.Path) -> None:
    paper = PaperRace(dict(enumerate(HOSTILE, 1)))
    paper.connect(*paper.race.karts)
    paper.drive()
    for number, name in enumerate(HOSTILE, 1):
        paper.command(CommandKind.KART_RED_RED, number, official=name)
    paper.wait(1.0)
    page = report(paper.write(tmp_path / 'record.sqlite3'))
    assert page.count('<script') == 2
    assert page.count('</script') == 2
    assert '<img' not in page
    assert not re.search('[\u202a-\u202e\u2066-\u2069\x00\x1b]', page)


def test_what_others_say_of_laps_is_nothing_but_text(
    paper: PaperRace, tmp_path: pathlib.Path
) -> None:
    paper.drive()
    for number, hostile in enumerate(HOSTILE, 1):
        paper.cross(transponder=hostile)
        paper.strike(number, hostile, hostile)
        paper.command(CommandKind.PENALISE, 7, hostile, seconds=1, reason=hostile)
    page = report(paper.write(tmp_path / 'record.sqlite3'))
    assert [row[3][:11] for row in table(page, 'passings')] == ['struck out:'] * len(HOSTILE)
    assert len(table(page, 'corrections')) == 2 * len(HOSTILE)
    assert page.count('<script') == page.count('</script') == 2
    assert '<img' not in page
    assert not re.search('[\u202a-\u202e\u2066-\u2069\x00\x1b]', page)


def test_a_page_lets_nothing_in_but_its_own_script_and_style(written: pathlib.Path) -> None:
    page = report(written)
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy.startswith("default-src 'none';")
    assert 'unsafe' not in policy
    assert not re.search(r'\s(src|href|style|on\w+)=', re.sub(r'<script.*', '', page, flags=re.S))


def test_an_event_has_one_time_of_day_wherever_it_stands_unless_the_clock_was_set() -> None:
    began = 1_795_348_011_109_400_000
    clock = Clock(began)
    for apart in (-1_400_000, 0, 1_400_000):
        wall_ns = began + 1_000_000_000 + apart
        assert clock.time(clock.of(wall_ns, 1.0), 3) == clock.at(1.0, 3)
    set_back = began - 59_000_000_000
    assert clock.of(set_back, 1.0) == set_back
