# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of a race in a real browser: what is seen and printed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import os
import pathlib
import random
import re

from evgp_inspection.kart_sentences import KART
from evgp_inspection.limits import Limits
from evgp_inspection.report import as_html
from evgp_inspection.verdicts import Finding, Inspection, Verdict
from evgp_node.results import KartResult, Standings
from evgp_node.results import Status as KartStatus
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
import pytest
from recorded_races import PaperRace, report, timed
from rig.browser import Browser

HOSTILE = '</script><script>document.title="broken"</script><img src=x onerror=alert(1)>'
A4 = (595, 842)
"""Width and height of a sheet, in points."""
PRINTED = 703
"""Width of what is printed on a sheet, without its margins, in pixels of the page."""


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    """Return a browser for all tests; none of their pages may complain."""
    with Browser() as made:
        yield made


def page_of(paper: PaperRace, folder: pathlib.Path, *results: Standings) -> pathlib.Path:
    """Write a race's record, with the timekeeper's book, and its report."""
    record = timed(paper.write(folder / 'record.sqlite3'), *results)
    report(record)
    return record.with_name('report.html')


def incident() -> PaperRace:
    """Return a race with a lost link, a stop to one kart, a refusal and an ALL_KILL."""
    paper = PaperRace({7: 'Purdue', 8: 'Michigan', 9: 'Kennesaw'})
    paper.go(
        'connect 7 8 9, wait 1, measure 7 GOOD, measure 8 GOOD, measure 9 GOOD, wait 4, '
        'GRID_ACTIVE, wait 2, GREEN_GREEN, acknowledge, wait 2, GREEN_GREEN, acknowledge, '
        'wait 10, measure 8 FAIR, wait 10, KART_RED_RED 7 Grace, deliver 7 0.024, wait 2, '
        'measure 8 POOR, wait 3, lose 8, wait 5, ALL_KILL 0 Grace, wait 2, connect 8, go_home, '
        'wait 5'
    )
    return paper


def an_hour(chance: random.Random) -> PaperRace:
    """Return an hour of races with 20 karts, lost links, stops, and much that karts say."""
    numbers = range(1, 21)
    paper = PaperRace({number: HOSTILE if number == 7 else f'Team {number}' for number in numbers})
    happenings: list[Callable[[int], object]] = [
        paper.lose,
        lambda number: paper.command(CommandKind.KART_RED_RED, number, official=HOSTILE),
        *[lambda number: paper.measure(number, chance.choice([*Grade]))] * 20,
        *[lambda number: paper.say(number, chance.choice([*RaceState]))] * 500,
    ]
    paper.connect(*numbers)
    while paper.now < 3700.0:
        paper.drive()
        ends = paper.now + chance.uniform(60.0, 240.0)
        while paper.now < ends:
            paper.wait(chance.expovariate(2.0))
            chance.choice(happenings)(chance.choice(numbers))
        for number in chance.sample(numbers, 20):
            paper.command(CommandKind.KART_FINISH, number)
            paper.wait(1.0)
        paper.command(CommandKind.ALL_KILL)
        paper.connect(*numbers)  # or the race stays in RED_RED, and its karts are released from it
        paper.go_home()
        for number in numbers:
            paper.command(CommandKind.KART_IN_GARAGE, number)
    return paper


def text_of(browser: Browser, selector: str) -> str:
    return str(browser.evaluate(f'document.querySelector("{selector}").innerText'))


def sheets_of(browser: Browser) -> list[tuple[int, ...]]:
    """Return the sizes of the sheets on which the page is printed, in points."""
    return [
        tuple(sorted(round(float(each)) for each in box))
        for box in re.findall(rb'/MediaBox\s*\[\s*0\s+0\s+([\d.]+)\s+([\d.]+)\s*\]', browser.pdf())
    ]


def test_an_hour_with_twenty_karts_has_a_timeline_of_each_race_and_fits_a_telephone_and_a_sheet(
    browser: Browser, tmp_path: pathlib.Path, chance: random.Random
) -> None:
    """Nor does the page complain, or ask the network for anything."""
    paper = an_hour(chance)
    laps = tuple(40.0 + lap / 7 for lap in range(30))
    karts = (
        KartResult(number, number, KartStatus.CLASSIFIED, 30, sum(laps) + number, laps, ())
        for number in paper.race.karts
    )
    page = page_of(paper, tmp_path, Standings(race=1, karts=tuple(karts)))
    assert page.stat().st_size < 10_000_000
    browser.visit(page)
    assert HOSTILE in text_of(browser, 'main')
    assert f'This table has 1,000 of {len(paper.stamped):,} events' in text_of(browser, '.events')
    titles, drawn, outside = browser.evaluate(
        """[
            [...document.querySelectorAll('figcaption')].map((each) => each.textContent),
            [...document.querySelectorAll('figure')].map((each) =>
                new Set([...each.querySelectorAll('.band.GREEN_GREEN rect')].map((band) =>
                    band.getAttribute('y'))).size),
            [...document.querySelectorAll('figure rect')].filter((each) => {
                const {width, height} = each.closest('figure > svg').viewBox.baseVal;
                const box = each.getBBox();
                return box.x < 0 || box.x + box.width > width + 1 || box.y + box.height > height;
            }).length,
        ]"""
    )
    assert titles[:3] == ['Everything', 'Race 1', 'Race 2']
    assert set(drawn) == {21}  # and that of the race itself
    assert outside == 0
    browser.resize(400, 800, mobile=True)
    assert browser.evaluate('document.documentElement.scrollWidth') == 400
    browser.call('Emulation.setEmulatedMedia', media='print')
    browser.resize(PRINTED, 800)
    widths = browser.evaluate(
        "[...document.querySelectorAll('table')].map((each) => [each.offsetWidth, each.className])"
    )
    assert max(widths)[0] <= PRINTED, max(widths)
    browser.call('Emulation.setEmulatedMedia')
    assert browser.complaints == []
    assert browser.requested == [page.as_uri()]


def test_the_screenshots_of_the_report_which_is_printed_on_a4(
    browser: Browser, tmp_path: pathlib.Path
) -> None:
    browser.resize(1366, 800)
    browser.visit(page_of(incident(), tmp_path))
    folder = pathlib.Path(os.environ.get('EVGP_SCREENSHOTS', tmp_path))
    browser.picture(folder / 'report.png', '.timeline')
    sheets = sheets_of(browser)
    assert len(sheets) >= 3
    assert set(sheets) == {A4}
    assert browser.complaints == []


# ----- the report of an inspection -----------------------------------------------------------


def test_the_report_of_an_inspection_that_was_passed_is_one_sheet(
    browser: Browser, tmp_path: pathlib.Path
) -> None:
    judged = Finding(Verdict.PASS, 'It took 100.00 s.', 100.0)
    inspection = Inspection(
        dict.fromkeys(KART, judged),
        Limits(**{each.limit: 120.0 for each in KART if each.limit}),
        170.0,
        finished=True,
        subject='kart 123',
        team='University of Illinois Urbana-Champaign, Autonomous Karting',
        inspector='Augusta Ada King, Countess of Lovelace',
        began='2026-05-01T10:00:00+02:00',
    )
    page = tmp_path / 'inspection.html'
    page.write_text(as_html(inspection), encoding='utf-8')
    browser.visit(page)
    assert sheets_of(browser) == [A4]
