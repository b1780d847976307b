# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of a race in a real browser: what is seen, pointed at, typed and printed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import dataclasses
import os
import pathlib
import random
import re
from typing import Any

from evgp_inspection.kart_clauses import KART
from evgp_inspection.limits import Limits, RcsLimits
from evgp_inspection.rcs_clauses import RCS
from evgp_inspection.report import as_html, Header
from evgp_inspection.verdicts import Clause, Finding, Result, Verdict
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CommandKind
from evgp_rcs.rcs_record import main as rcs_record
from evgp_rcs_msgs import msg
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl
from evgp_testing.wire_kart import Acknowledges, WireKart
import pytest
from recorded_races import long_event, PaperRace
from rig.browser import Browser, missing
from rig.needs import cannot_run

HOSTILE = '</script><script>document.title="broken"</script><img src=x onerror=alert(1)>'
A4 = (595, 842)
"""Width and height of a sheet, in points."""
PRINTED = 703
"""Width of what is printed on a sheet, without its margins, in pixels of the page."""


@pytest.fixture(scope='module')
def the_browser() -> Iterator[Browser]:
    """Return a browser. Skip where there is none, and fail where no test may be skipped."""
    if why := missing():
        cannot_run(why)
    with Browser() as browser:
        yield browser


@pytest.fixture
def browser(the_browser: Browser) -> Browser:
    """Return the browser with an empty page."""
    the_browser.open_page()
    return the_browser


MakeReport = Callable[..., pathlib.Path]


@pytest.fixture
def make_report(tmp_path: pathlib.Path) -> MakeReport:
    """Return a function that writes a race's record, and its report."""

    def make(paper: PaperRace, *arguments: str) -> pathlib.Path:
        record = paper.write(tmp_path / 'record.sqlite3')
        page = tmp_path / 'report.html'
        assert rcs_record(['report', str(record), '-o', str(page), *arguments]) == 0
        return page

    return make


def incident(team: str = HOSTILE, official: str = HOSTILE) -> PaperRace:
    """Return a race with a lost link, a stop to one kart, a refusal and an ALL_KILL."""
    paper = PaperRace({7: team, 8: 'Michigan', 9: 'Kennesaw'})
    paper.connect(7, 8, 9)
    paper.wait(1.0)
    for number in (7, 8, 9):
        paper.measure(number, Grade.GOOD)
    paper.wait(4.0)
    paper.command(CommandKind.GRID_ACTIVE)
    paper.wait(2.0)
    paper.command(CommandKind.GREEN_GREEN, official=official)
    paper.acknowledge()
    paper.wait(2.0)
    paper.command(CommandKind.GREEN_GREEN)
    paper.acknowledge()
    paper.wait(10.0)
    paper.measure(8, Grade.FAIR)
    paper.wait(10.0)
    paper.command(CommandKind.KART_RED_RED, 7, official='Grace')
    paper.deliver(7, 0.024)
    paper.wait(2.0)
    paper.measure(8, Grade.POOR)
    paper.wait(3.0)
    paper.lose(8)
    paper.wait(5.0)
    paper.command(CommandKind.ALL_KILL, official='Grace')
    paper.wait(2.0)
    paper.connect(8)
    paper.go_home()
    paper.wait(5.0)
    return paper


def span(browser: Browser) -> tuple[float, float]:
    """Return the time that the timeline shows, once all that was asked for is drawn."""
    start, end = browser.evaluate(
        """new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
            const {from, to} = document.getElementById('plot').dataset;
            done([Number(from), Number(to)]);
        })))"""
    )
    return start, end


def text_of(browser: Browser, selector: str) -> str:
    return str(browser.evaluate(f'document.querySelector("{selector}").innerText'))


def rows(browser: Browser) -> list[list[str]]:
    """Return the cells of the events that are in the table now."""
    found: list[list[str]] = browser.evaluate(
        "[...document.querySelectorAll('#rows tr[data-sequence]')]"
        '.map((row) => [...row.cells].map((cell) => cell.textContent))'
    )
    return found


def test_a_page_complains_of_nothing_and_asks_the_network_for_nothing(
    browser: Browser, make_report: MakeReport
) -> None:
    page = make_report(incident())
    browser.visit(page)
    span(browser)
    assert browser.complaints == []
    assert browser.requested == [page.as_uri()]


def test_on_a_telephone_only_wide_tables_scroll_sideways(
    browser: Browser, make_report: MakeReport
) -> None:
    browser.resize(400, 800, mobile=True)
    browser.visit(make_report(incident()))
    assert browser.evaluate('document.documentElement.scrollWidth') == 400


def test_the_laps_of_twenty_karts_fit_a_telephone_and_a_sheet(
    browser: Browser, make_report: MakeReport
) -> None:
    paper = PaperRace({number: f'University of {number}' for number in range(1, 21)})
    paper.connect(*paper.race.karts)
    paper.drive()
    for _ in range(31):
        for number in paper.race.karts:
            paper.wait(0.5)
            paper.cross(number)
    page = make_report(paper)
    browser.resize(400, 800, mobile=True)
    browser.visit(page)
    assert browser.evaluate('document.documentElement.scrollWidth') == 400
    browser.call('Emulation.setEmulatedMedia', media='print')
    browser.resize(PRINTED, 800)
    widths = browser.evaluate(
        "[...document.querySelectorAll('.results, .laps, .chart')].map((each) => each.offsetWidth)"
    )
    assert len(widths) == 3
    assert max(widths) <= PRINTED
    assert browser.complaints == []


def test_a_hostile_name_is_seen_and_does_nothing(
    browser: Browser, make_report: MakeReport
) -> None:
    browser.visit(make_report(incident()))
    left, top, width, height = browser.place_of('#plot')
    for share in range(0, 100, 2):  # over everything that can be pointed at
        browser.mouse('mouseMoved', left + width * share / 100, top + height * (share % 10) / 10)
    browser.click('#rows tr[data-sequence]')
    assert browser.evaluate('document.title').startswith('Race report')
    assert browser.evaluate('document.images.length + document.scripts.length') == 2
    assert HOSTILE in text_of(browser, 'main')
    assert browser.complaints == []


def test_the_wheel_the_buttons_and_the_keys_zoom(
    browser: Browser, make_report: MakeReport
) -> None:
    browser.visit(make_report(incident()))
    whole = span(browser)
    left, top, width, height = browser.place_of('#plot')
    x, y = left + width / 2, top + height / 2

    browser.wheel(x, y, -200, ctrl=True)
    by_wheel = span(browser)
    assert by_wheel[0] > whole[0]
    assert by_wheel[1] < whole[1]

    browser.click('[data-do=whole]')
    assert span(browser) == whole
    browser.click('[data-do=in]')
    by_button = span(browser)
    assert by_button[1] - by_button[0] == pytest.approx((whole[1] - whole[0]) / 2)
    browser.click('[data-do=right]')
    assert span(browser)[0] > by_button[0]
    browser.click('[data-do=race]')
    assert span(browser) != whole

    left, top, width, height = browser.place_of('#plot')
    browser.click_at(left + width / 2, top + height / 2)
    browser.key('Home')
    assert span(browser) == whole
    browser.key('+')
    assert span(browser)[1] - span(browser)[0] < whole[1] - whole[0]
    browser.key('-')
    assert span(browser) == pytest.approx(whole)
    browser.wheel(left + width / 2, top + height / 2, -200)  # it was clicked: no Ctrl is needed
    assert span(browser)[1] - span(browser)[0] < whole[1] - whole[0]


def test_dragging_moves_the_timeline(browser: Browser, make_report: MakeReport) -> None:
    browser.visit(make_report(incident()))
    browser.click('[data-do=in]')
    before = span(browser)
    left, top, width, height = browser.place_of('#plot')
    x, y = left + width / 2, top + height / 2
    browser.mouse('mouseMoved', x, y)
    browser.mouse('mousePressed', x, y, button='left', clickCount=1)
    browser.mouse('mouseMoved', x + 100, y, button='left', buttons=1)
    browser.mouse('mouseReleased', x + 100, y, button='left', clickCount=1)
    after = span(browser)
    assert after[0] < before[0]
    assert after[1] - after[0] == pytest.approx(before[1] - before[0])


def test_what_is_pointed_at_is_explained(browser: Browser, make_report: MakeReport) -> None:
    browser.visit(make_report(incident()))
    seen = set()
    for state in ('GREEN_GREEN', 'RED_RED'):
        left, top, width, _ = browser.place_of(f'.line:nth-child(6) .band.{state}')
        browser.mouse('mouseMoved', left + width / 2, top + 2)
        seen.add(text_of(browser, '#detail').split('\n')[0])
    assert seen == {f'Kart 8 (Michigan) is sent {state}' for state in ('GREEN GREEN', 'RED RED')}
    assert browser.evaluate('document.getElementById("tip").hidden') is False


def test_the_arrow_keys_go_from_event_to_event(browser: Browser, make_report: MakeReport) -> None:
    browser.visit(make_report(incident()))
    browser.evaluate("document.getElementById('plot').focus()")
    browser.key('ArrowRight')
    browser.key('ArrowLeft')
    assert text_of(browser, '#detail').startswith('GRID ACTIVE')
    browser.key('ArrowRight')
    assert text_of(browser, '#detail').startswith('GREEN GREEN, refused')
    for _ in range(3):
        browser.key('ArrowDown')
    assert text_of(browser, '#detail').startswith('Kart 7')


def test_the_table_shows_the_events_that_are_asked_for(
    browser: Browser, make_report: MakeReport
) -> None:
    paper = incident()
    browser.visit(make_report(paper))
    browser.evaluate("document.getElementById('kart').focus()")
    browser.enter('Kart 8')
    assert {row[3] for row in rows(browser)} == {'8'}
    browser.evaluate("document.getElementById('kind').focus()")
    browser.enter('Connection')
    assert {row[4] for row in rows(browser)} == {'Connection lost'}
    browser.key('Home')
    browser.evaluate("document.getElementById('kart').focus()")
    browser.key('Home')
    assert len({row[3] for row in rows(browser)}) > 1
    browser.click('#find')
    browser.enter('michigan')
    assert rows(browser)
    assert all('Michigan' in row[5] for row in rows(browser))
    assert 'of' in text_of(browser, '#found')


def test_an_hour_with_twenty_karts_can_be_used(
    browser: Browser, make_report: MakeReport, chance: random.Random
) -> None:
    paper = long_event(3600.0, 20, chance, busy=10.0)
    browser.visit(make_report(paper, '--quick'))
    assert text_of(browser, '#found') == f'{len(paper.stamped):,} events'
    whole = span(browser)
    left, top, width, _ = browser.place_of('#plot')
    for _ in range(10):
        browser.wheel(left + width / 2, top + 100, -200, ctrl=True)
    assert span(browser)[1] - span(browser)[0] < (whole[1] - whole[0]) / 50
    # However many events there are, few rows are in the document: those that are seen.
    assert len(rows(browser)) < 100
    browser.evaluate("document.getElementById('scroll').scrollTop = 1e9")
    browser.wait_for(
        f'document.querySelector(\'#rows tr[data-sequence="{paper.stamped[-1].sequence}"]\')'
    )
    assert browser.complaints == []


def sheets_of(browser: Browser) -> list[tuple[int, ...]]:
    """Return the sizes of the sheets on which the page is printed, in points."""
    return [
        tuple(sorted(round(float(each)) for each in box))
        for box in re.findall(rb'/MediaBox\s*\[\s*0\s+0\s+([\d.]+)\s+([\d.]+)\s*\]', browser.pdf())
    ]


def test_a_report_is_printed_on_a4(browser: Browser, make_report: MakeReport) -> None:
    browser.visit(make_report(incident()))
    sheets = sheets_of(browser)
    assert len(sheets) >= 3
    assert set(sheets) == {A4}


def test_on_paper_there_is_the_timeline_of_the_run_and_of_each_race_with_every_kart(
    browser: Browser, make_report: MakeReport, chance: random.Random
) -> None:
    paper = long_event(900.0, 25, chance)
    browser.visit(make_report(paper, '--quick'))
    whole = span(browser)
    browser.pdf()
    greens = browser.evaluate(
        "[...document.querySelectorAll('#pictures figure')]"
        ".map((each) => each.querySelectorAll('.GREEN_GREEN').length)"
    )
    grids = [each for each in paper.events if each.state == 'GRID_ACTIVE' and not each.kart]
    assert len(greens) == 2 * (1 + sum(each.kind == 'RACE_STATE' for each in grids))
    assert all(greens)
    assert span(browser) == whole
    assert browser.complaints == []


def test_without_scripts_there_are_the_words_and_the_tables(
    browser: Browser, make_report: MakeReport
) -> None:
    browser.without_scripts()
    browser.visit(make_report(incident()))
    seen: dict[str, Any] = browser.call('Accessibility.getFullAXTree')
    names = {node.get('name', {}).get('value', '') for node in seen['nodes']}
    assert {'In short', 'The race', 'Alerts', 'Timeline', 'Events'} <= names
    assert 'Kart 8 (Michigan) is sent GREEN_GREEN' in names
    assert 'Zoom in' not in names


def test_the_report_of_a_real_race_control_tells_what_karts_and_officials_did(
    browser: Browser,
    start_race_control: Any,
    join_official: Any,
    connect_kart: Any,
    tmp_path: pathlib.Path,
) -> None:
    control: RaceControl = start_race_control(in_race=[1, 2])
    official: Official = join_official(control)
    karts: dict[int, WireKart] = {
        number: connect_kart(control, number, Acknowledges.EACH_CHANGE) for number in (1, 2)
    }
    official.wait_for_connected(1, 2)
    official.bring_to(RaceState.GREEN_GREEN)
    karts[2].close()
    official.wait_for_event(
        lambda event: event.kind == msg.RaceEvent.DISCONNECTED, 'kart 2 is lost'
    )
    official.command('all_kill')
    karts[1].wait_for_state(RaceState.RED_RED)
    assert control.close() == 0
    record = next(iter(tmp_path.rglob('record.sqlite3')))
    page = tmp_path / 'report.html'
    assert rcs_record(['report', str(record), '-o', str(page)]) == 0
    browser.visit(page)
    words = text_of(browser, 'main')
    assert 'Stopped: RED RED by official, ALL KILL, ' in words
    assert 'no difference' in words
    assert 'did not finish: it lost its connection' in words
    assert 'ended in good order' in words
    assert browser.complaints == []


@pytest.mark.long
def test_the_screenshots_of_the_report(
    browser: Browser, make_report: MakeReport, tmp_path: pathlib.Path
) -> None:
    browser.resize(1366, 1100)  # all of the timeline, with the lines in the middle
    browser.visit(make_report(incident('Purdue', 'Ada')))
    left, top, width, _ = browser.place_of('.line:nth-child(6) .NOT_CONNECTED')
    browser.mouse('mouseMoved', left + width / 2, top + 2)
    span(browser)
    folder = pathlib.Path(os.environ.get('EVGP_SCREENSHOTS', tmp_path))
    browser.picture(folder / 'report.png', '.timeline')
    assert text_of(browser, '#tip').startswith('Kart 8')
    assert browser.complaints == []


# ----- the report of an inspection -----------------------------------------------------------


def results_of(clauses: Sequence[Clause]) -> list[Result]:
    """Return a pass of these clauses."""
    judged = Finding(Verdict.PASS, 'It took 100.00 s.', 100.0)
    return [Result(clause, judged, 120.0 if clause.judge.limit else None) for clause in clauses]


@pytest.mark.parametrize(
    ('clauses', 'limits'), [(KART, Limits()), (RCS, RcsLimits())], ids=['a kart', 'a race control']
)
def test_the_report_of_an_inspection_that_was_passed_is_one_sheet(
    browser: Browser,
    tmp_path: pathlib.Path,
    clauses: Sequence[Clause],
    limits: Limits | RcsLimits,
) -> None:
    header = Header(
        'race control' if clauses is RCS else 'kart 123',
        'University of Illinois Urbana-Champaign, Autonomous Karting',
        'Augusta Ada King, Countess of Lovelace',
        '2026-05-01T10:00:00+02:00',
        170.0,
        dataclasses.asdict(limits),
    )
    page = tmp_path / 'inspection.html'
    page.write_text(as_html(header, results_of(clauses)), encoding='utf-8')
    browser.visit(page)
    assert sheets_of(browser) == [A4]
