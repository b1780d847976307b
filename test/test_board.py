# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The board as a process, beside a real race control and in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
import pathlib
import signal
import socket
from typing import Any

from evgp_board import node
from evgp_board.view import Heard, Line
from evgp_node.graph import EVERY
from evgp_node.parameters import ParameterError
from evgp_node.process import IN_THE_WAY
from evgp_node.qos import latched
from evgp_node.results import KartResult, Standings, Status
from evgp_protocol import clock
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_protocol.states import RaceState as S
from evgp_rcs.rules.link_quality import NOT_MEASURED
from evgp_rcs.rules.race import Heat, Kart, Race
from evgp_rcs.rules.snapshot import KartSnapshot, NOTHING, snapshot_of
from evgp_rcs_msgs import msg
from evgp_testing.domains import free_port
from evgp_testing.fixtures import ConnectKart, JoinOfficial
from evgp_testing.process import Process
from evgp_testing.race_control import RaceControl
from evgp_testing.ros_side import joined
import pytest
from rclpy.parameter import Parameter
from rig.browser import Browser
from test_server import Board

HOSTILE = '<img src=x onerror=document.title="hacked">'


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    """Return a browser for all tests; none of their pages may complain."""
    with Browser() as made:
        yield made


def wait_for_text(browser: Browser, selector: str, text: str) -> None:
    browser.wait_for(f'document.querySelector("{selector}").innerText.includes("{text}")')


def test_pages_follow_a_race_and_say_when_they_are_old(
    browser: Browser,
    join_official: JoinOfficial,
    connect_kart: ConnectKart,
    domain: int,
    parts: contextlib.ExitStack,
    tmp_path: pathlib.Path,
) -> None:
    def is_stale() -> bool:
        return bool(browser.evaluate("document.body.classList.contains('stale')"))

    port = free_port()
    address = f'http://127.0.0.1:{port}'
    board = parts.enter_context(Process('evgp_board', 'board', domain, {'port': port}))
    board.wait_for_line(f'The board is at {address}/')
    browser.visit(f'{address}/kart/1')
    wait_for_text(browser, '#head', 'NO RACE CONTROL YET')
    assert is_stale()
    control = parts.enter_context(RaceControl(tmp_path, domain, [1, 2]))
    official = join_official(control)
    kart = connect_kart(control, 1, acknowledges=True)
    connect_kart(control, 2, acknowledges=True)
    official.wait_for_connected(1, 2)
    official.bring_to(RaceState.GREEN_GREEN)
    wait_for_text(browser, '#head', 'GREEN GREEN')
    assert not is_stale()
    wait_for_text(browser, '#list', 'GREEN GREEN answered')
    kart.close()
    wait_for_text(browser, '#head', 'NO LINK')
    browser.visit(f'{address}/')
    wait_for_text(browser, '#rows', 'no link')
    times = browser.evaluate('[307, 86399, 86401].map(timeOfDay).join()')
    assert times == '00:05:07,23:59:59,00:00:01'
    official.command('all_kill')
    wait_for_text(browser, '#head', 'RED RED')

    board.signal(signal.SIGSTOP)
    browser.wait_for("document.body.classList.contains('stale')")
    wait_for_text(browser, '#head', 'NO CONNECTION')
    board.signal(signal.SIGCONT)
    wait_for_text(browser, '#head', 'RED RED')
    assert not is_stale()

    control.freeze()
    wait_for_text(browser, '#head', 'RACE CONTROL IS GONE')
    assert is_stale()
    control.kill()
    again = official.node.create_publisher(msg.Race, '/rcs/race', latched(1))
    again.publish(official.race)
    browser.wait_for("!document.body.classList.contains('stale')")
    assert browser.complaints == []
    assert all(each.startswith(address) for each in browser.requested)
    browser.visit('about:blank')  # it would complain of the end of its board


def test_a_board_that_may_not_listen_there_says_why_in_one_sentence(
    parts: contextlib.ExitStack, domain: int
) -> None:
    given = {'address': '192.0.2.1', 'port': free_port()}
    board = parts.enter_context(Process('evgp_board', 'board', domain, given))
    assert board.wait() == IN_THE_WAY
    assert len(board.lines) == 1
    every = [Parameter('address', value=EVERY)]
    with joined(domain) as context, pytest.raises(ParameterError, match='means every network'):
        node.BoardNode(lambda _: None, context=context, parameter_overrides=every)


def test_a_board_whose_port_is_taken_may_find_it_free_later() -> None:
    with socket.create_server(('127.0.0.1', 0)) as taken, pytest.raises(node.InTheWayError):
        node.listen(*taken.getsockname())


def seen(number: int, **fields: Any) -> KartSnapshot:
    (kart,) = snapshot_of(Race([Kart(number, '', True)]), 0.0).karts
    return kart._replace(connected=True, **fields)


def test_a_board_on_the_network_of_the_karts_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    networks = {'10.0.0.5': '10.0.0.0/24', '10.2.0.5': '10.2.0.0/24', '127.0.0.1': '127.0.0.0/8'}
    monkeypatch.setattr(node, 'network_of', lambda at: node.ipaddress.IPv4Network(networks[at]))
    karts = tuple(seen(7, address=each) for each in ('10.0.0.107', '127.0.0.8'))
    race = NOTHING._replace(karts=karts)
    for allowed_at in ('10.2.0.5', '127.0.0.1'):
        node.refuse_karts_network(allowed_at, race)
    with pytest.raises(node.PlaceError):
        node.refuse_karts_network('10.0.0.5', race)


TEAMS = ('Purdue', 'Georgia Tech', 'UC Berkeley', 'Toledo', 'Michigan', 'Kennesaw State')


def made_up(count: int) -> Heard:
    """Return a race of so many karts, with everything that a page can show of them."""
    now = 1_774_000_000.0
    numbers = [7, 3, 12, 23, 11, 21, *range(30, 24 + count)][:count]
    teams = [TEAMS[at] if at < 6 else f'University {HOSTILE}' for at in range(count)]
    link = NOT_MEASURED._replace(grade=Grade.GOOD, round_trip=0.019, worst_answer=0.12)
    sent = {7: S.RED_FLAG, 21: S.RED_RED}
    karts = tuple(
        seen(
            number,
            team=team,
            sent=sent.get(number, S.GREEN_GREEN),
            sent_since=now - 251.882,
            acknowledged=True,
            delivered_after=0.006,
            acknowledged_after=0.31,
            link=link,
            place=int(number == 7),
        )._replace(connected=number != 23)
        for number, team in zip(numbers, teams, strict=True)
    )
    heats = (
        Heat('Heat 2', tuple(numbers)),
        Heat('Heat 3', (5, 8, 42, 64)),
    )
    race = NOTHING._replace(
        stamp=now,
        state=S.GREEN_GREEN,
        state_since=now - 252,
        karts=karts,
        heats=heats,
        heat='Heat 2',
    )
    results = Standings(
        heat='Heat 2',
        laps=6,
        karts=tuple(
            KartResult(
                kart.number,
                place,
                Status.RUNNING,
                6 - place // 4,
                241.9 + 3.4 * place,
                tuple(39.4 + 0.7 * place + 0.3 * lap for lap in range(6 - place // 4)),
                (),
            )
            for place, kart in enumerate(karts, 1)
        ),
    )
    said = ['Connected', 'GRID ACTIVE sent', 'GRID ACTIVE answered', 'GREEN GREEN sent']
    log = tuple(Line(text, f'14:2{at}:11.6') for at, text in enumerate(said))
    return Heard(race, results, log={11: log}, came=clock.now())


@pytest.mark.parametrize('karts', [6, pytest.param(20, marks=pytest.mark.long)])
def test_the_screenshots_of_the_board(
    browser: Browser,
    parts: contextlib.ExitStack,
    tmp_path: pathlib.Path,
    karts: int,
) -> None:
    board = parts.enter_context(contextlib.closing(Board()))
    board.now, address = made_up(karts), f'http://127.0.0.1:{board.port}'
    folder = pathlib.Path(os.environ.get('EVGP_SCREENSHOTS', tmp_path))
    for name, path, width, height in (
        ('board', '/', 1920, 1080),
        ('board-phone', '/kart/11', 390, 844),
        ('phone', '/', 390, 844),
        ('results', '/results', 390, 844),
        ('overlay', '/overlay', 1920, 1080),
    ):
        browser.resize(width, height, mobile=width == 390)
        browser.visit(f'{address}{path}')
        wait_for_text(browser, '#head', 'GREEN GREEN')
        right, bottom = browser.evaluate(
            '[document.documentElement.scrollWidth, document.documentElement.scrollHeight]'
        )
        assert right == width
        assert bottom == height or width == 390
        assert browser.evaluate('document.images.length + document.scripts.length') == 1
        if name.startswith('board') and karts == 6:
            browser.picture(folder / f'{name}.png')
    assert browser.complaints == []
    browser.visit('about:blank')  # as above
