# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What becomes of each crossing, as the timekeeper's window shows it.

A story has a line for each thing that happens, in the order in which the timekeeper hears of it:
when it happened, in seconds since GREEN_GREEN, and behind an arrow what the window shows of it at
the end. `line 1` and `beam` are crossings. If they are heard later, or the source's clock shows
another time, the line says so, and how long the timekeeper had been away. `press` is LAP.
`strike 2` is about the second crossing that the timekeeper heard of, presses among them.
"""

from __future__ import annotations

from evgp_node.results import Act, lap_time, Passing
from evgp_timing import window_view as view
from evgp_timing.desk import Passed, What
import pytest
from test_desk import Event

TOLD = {
    'finish': What.FINISH,
    'undo': What.UNDO_FINISH,
    'left': What.LEFT,
    'over': What.OVER,
}


def happen(event: Event, green: float, number: int, line: str) -> None:
    """Have what this line of a story says happen."""
    at, what, *words = line.split()
    event.now = green + float(at)
    said = dict(zip(words[-2::-2], words[::-2], strict=False))
    kart = int(words[0]) if words and words[0].isdigit() else 0
    if what in ('line', 'beam'):
        stamp = round((green + float(said.get('clock', at))) * 1e9)
        passing = Passing(what, 'today', number, 0, f't{kart}' * bool(kart), stamp)
        event.now = green + float(said.get('heard', at))
        event.desk.feed(Passed(event.now, (passing,), float(said.get('away', 0))))
    elif what == 'press':
        assert event.correct(Act.COUNT, kart)
    elif what in ('strike', 'restore'):
        identity = event.desk.races[-1].laps.crossings[kart - 1].passing.identity
        assert event.correct(Act[what.upper()], passing=identity, reason='twice')
    elif what == 'restart':
        event.run = 'run 2'
    elif what == 'penalise':
        assert event.correct(Act.PENALISE, kart, laps=1, reason='a short cut')
    elif what == 'asks':
        asked = '; '.join(event.desk.questions(event.now)) or 'nothing'
        assert ' '.join(words) in asked
    elif what == 'due':
        assert [each.kart for each in event.desk.finishes()] == [*map(int, words)]
    else:
        event.tell(TOLD[what], kart)


STORIES = {
    'a press gives the kart the oldest crossing that a beam saw in the last 3 s': """
        1 2
        10 beam -> 2: starts lap 1
        12.9 press 2
        29 beam -> 2: lap 1, 0:19.000
        30 beam -> 1: starts lap 1
        30.5 press 2
        30.6 press 2 -> 2: by hand, doubtful: too soon after the last crossing
        31 press 1
        49 beam -> ?: kart unknown
        50 beam -> 1: lap 1, 0:20.000
        50.5 press 2 -> 2: by hand, struck: twice (Tina)
        51 press 1
        60 strike 10
    """,
    'nobody asks who crossed while an official may still press': """
        1 2
        10 beam -> ?: kart unknown
        13 asks nothing
        13.1 asks Check the laps: a kart crossed the line but was not identified
        13.1 beam -> ?: kart unknown
        13.2 asks a kart crossed the line but was not identified
    """,
    'what a source sees within 0.5 s after a press takes its place if it counts': """
        1 2
        10 press 2
        10.4 line 2 -> 2: starts lap 1
        20 press 2
        20.2 press 2
        20.4 beam -> 2: lap 1, 0:10.000
        30 press 2 -> 2: by hand, lap 2, 0:09.600
        30.6 line 2 -> 2: doubtful: too soon after the last crossing
        40 press 2 -> 2: by hand, lap 3, 0:10.000
        40.6 beam -> ?: kart unknown
        50 press 1 -> 1: by hand, starts lap 1
        50.1 left 1
        50.4 line 1 -> 1: not counted
        60 press 2 -> 2: by hand, lap 4, 0:20.000
        60.1 left 2
        60.4 beam -> ?: kart unknown
    """,
    'a press counts and is listed while the crossing that it claims is struck': """
        1 2
        10 beam -> 2: struck: twice (Tina)
        10.2 press 2 -> 2: by hand, starts lap 1
        19.8 press 2 -> 2: by hand, lap 1, 0:09.600
        20 beam -> 2: struck: twice (Tina)
        30 beam -> 2: lap 2, 0:10.200
        30.2 press 2
        39.8 press 2
        40 beam -> 2: lap 3, 0:10.000
        50 strike 1
        50 strike 4
        50 strike 5
        50 strike 8
        60 restore 5
        60 restore 8
    """,
    'a press that is restored counts by itself if another has claimed its crossing': """
        1 2
        10 beam -> 1: starts lap 1
        10.2 press 2 -> 2: by hand, starts lap 1
        10.4 strike 2
        10.5 press 1
        11 restore 2
    """,
    'an official counts a lap that lacks after FINISH until all are there': """
        Heat 1: 1 2
        10 line 1 -> 1: starts lap 1
        20 line 1 -> 1: lap 1, 0:10.000
        30 line 1 -> 1: struck: twice (Tina)
        30 finish 1
        31 strike 3
        40 line 1 -> 1: not counted
        50 press 1 -> 1: by hand, lap 2, 0:30.000: finish
        60 press 1 -> 1: by hand, not counted
    """,
    'a beam sees the only kart, and of a race without a number of laps none lacks': """
        1
        10 beam -> 1: starts lap 1
        20 finish 1
        30 press 1 -> 1: by hand, not counted
    """,
    'auto_finish sends FINISH to each kart with all its laps, in the order of their crossings': """
        Heat 2: 3 4
        10 line 3 -> 3: starts lap 1
        11 line 4 -> 4: starts lap 1
        20 line 3 -> 3: lap 1, 0:10.000
        20 line 4 -> 4: lap 1, 0:09.000
        20 due
        30 line 4 -> 4: lap 2, 0:10.000: finish
        30 due 4
        30.1 line 3 -> 3: lap 2, 0:10.100: finish
        30.1 due 4 3
        31 finish 4
        31 due 3
        31 finish 3
        31 due
    """,
    'UNDO FINISH strikes the crossing of FINISH, and auto_finish does not send it again': """
        Heat 2: 3
        10 line 3 -> 3: starts lap 1
        20 line 3 -> 3: lap 1, 0:10.000
        20 due
        30 finish 3 -> 3: by hand, struck: its FINISH was undone
        31 undo 3
        40 line 3 -> 3: lap 2, 0:20.000: finish
        40 due
    """,
    'FINISH is the last crossing, with the time of the line; of a wrong kart, it is undone': """
        Heat 1: 1 2
        10 line 1 -> 1: starts lap 1
        11 line 2 -> 2: starts lap 1
        20 line 1 -> 1: lap 1, 0:10.000
        21 line 2 -> 2: lap 1, 0:10.000
        60 beam -> 1: lap 2, 0:40.000: finish
        60.5 finish 2 -> 2: by hand, struck: its FINISH was undone
        62 undo 2
        62.5 asks nothing
        63 finish 1
        63 asks nothing
        70 finish 2 -> 2: by hand, struck: its FINISH was undone
        69.9 line 2 heard 70.3 -> 2: lap 2, 0:48.900: finish
        80 line 2 -> 2: not counted
        81 undo 2
    """,
    'a FINISH of the wrong kart gives back what a beam saw after it': """
        Heat 1: 1 2
        10 line 1 -> 1: starts lap 1
        11 line 2 -> 2: starts lap 1
        20 line 1 -> 1: lap 1, 0:10.000
        21 line 2 -> 2: lap 1, 0:10.000
        60 finish 2 -> 2: by hand, struck: its FINISH was undone
        60.3 beam -> 1: lap 2, 0:40.300: finish
        62 undo 2
        62.5 asks nothing
        63 finish 1
        63 asks nothing
        70 finish 2 -> 2: by hand, lap 2, 0:49.000: finish
    """,
    'a kart that is finished with laps missing is a question': """
        Heat 1: 1 2
        20 finish 1
        20 asks Kart 1 is marked as finished, but 2 laps are missing
        30 line 2 -> 2: starts lap 1
        50 finish 2
        50 asks Kart 2 is marked as finished, but 2 laps are missing
    """,
    'a passing that comes before the word of what was earlier does not count': """
        1 2 3
        10 line 1 -> 1: starts lap 1
        21 line 1 -> 1: not counted
        20 finish 1
        31 line 2 -> 2: not counted
        30 left 2
        41 line 3 -> 3: not counted
        40 over
    """,
    'a clock that jumps is told, the arrival counts, and then the clock counts again': """
        1 2
        10 line 1 -> 1: starts lap 1
        10 asks nothing
        20 line 1 clock 86420 -> 1: lap 1, 0:10.000
        20 asks Check the laps: the clock of line jumped, or its passings arrived late
        29.7 line 1 clock 86429.7 heard 30 -> 1: lap 2, 0:09.700
        40 line 1 clock -560 -> 1: lap 3, 0:10.300
        49.7 line 1 clock -550.3 heard 50 -> 1: lap 4, 0:09.700
    """,
    'what the line saw while the timekeeper was away counts whatever happened since': """
        1 2 3
        10 line 1 -> 1: starts lap 1
        60 finish 1
        60 left 2
        60 over
        30 line 1 heard 90 away 80 -> 1: lap 1, 0:20.000
        31 line 2 heard 90 away 80 -> 2: starts lap 1
        32 line 3 heard 90 away 80 -> 3: starts lap 1
        55 line 1 heard 90 away 80 -> 1: lap 2, 0:25.000
        80 line 1 heard 90 away 80 -> 1: not counted
        80 line 2 heard 90 away 80 -> 2: not counted
        80 line 3 heard 90 away 80 -> 3: not counted
    """,
    'a press takes a crossing just before it that is heard after an absence': """
        1 2
        1 beam -> ?: kart unknown
        2 line 2 -> 2: starts lap 1
        31 press 1
        30 beam heard 32 away 21 -> 1: starts lap 1
        61 press 1
        60 line 1 heard 62 away 21 -> 1: lap 1, 0:30.000
        120 press 1 -> 1: by hand, lap 2, 1:00.000
        90 beam heard 121 away 50 -> ?: kart unknown
    """,
    'a kart that is released a second time left the race the first time': """
        1
        10 line 1 -> 1: starts lap 1
        20 line 1 -> 1: lap 1, 0:10.000
        20 left 1
        30 line 1 -> 1: not counted
        40 left 1
    """,
    'a transponder of no kart is a question, and a kart outside the race is none': """
        1 2
        1 line 1 -> 1: starts lap 1
        2 line 9 -> ?: transponder t9
        3 line 3 -> 3: not counted
        3 asks Check the laps: no kart has the transponder t9
    """,
    'a restart of race control ends the race': """
        Heat 1: 1 2
        10 line 1 -> 1: starts lap 1
        20 line 1 -> 1: lap 1, 0:10.000
        30 restart
        30 over
        40 line 1 -> 1: not counted
    """,
    'a kart or heat that is not in the roster here is a question': """
        Heat 9: 1 7
        0 asks Race control has Heat 9, kart 7, but the roster here does not. Start both with
    """,
    'a lap that is taken away is still the lap of its crossing': """
        1 2
        10 line 1 -> 1: starts lap 1
        20 line 1 -> 1: lap 1, 0:10.000
        21 penalise 1
        30 line 1 -> 1: lap 2, 0:10.000
    """,
}


@pytest.mark.parametrize('story', STORIES.values(), ids=STORIES)
def test_each_crossing_becomes_what_the_rules_say(story: str) -> None:
    event = Event()
    begins, *lines = (each.strip() for each in story.strip().splitlines())
    heat, _, karts = begins.rpartition(': ')
    event.start(heat, *map(int, karts.split()))
    green, expected = event.now, []
    for number, line in enumerate(lines, 1):
        happens, _, shown = line.partition(' -> ')
        happen(event, green, number, happens)
        if shown:
            expected.append(f'{lap_time(float(line.split()[0]), 1)} {shown}')

    results = event.desk.standings(event.now)
    found = [*view.crossings(results)]
    assert sorted(f'{each.at} {each.kart}: {each.text}' for each in found) == sorted(expected)
    for each in found:
        acts = {'struck: ': Act.RESTORE, 'transponder ': Act.GIVE}
        assert each.act is next((acts[said] for said in acts if said in each.text), Act.STRIKE)
    # Also if only the last passings are there, they are those of the last laps.
    last = results._replace(passings=results.passings[-2:])
    assert [*view.crossings(last)] == found[:2]
