# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The officials' window: real clicks and keys on a real X server, a real race control, real sockets.

What the window shows is asked of its widgets; what it does is seen at the karts' sockets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import time

from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs_msgs import msg
from evgp_testing.fixtures import ConnectKart, StartRaceControl
from evgp_testing.part import PATIENCE
from evgp_testing.race_control import RaceControl
from evgp_testing.wire_race import WireRace
import pytest
from rig.console import Console
from rig.needs import need_qt, need_screen
from rig.screen import Screen

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED


OpenConsole = Callable[[int], Console]


@pytest.fixture
def open_console(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> OpenConsole:
    """Return a function that opens an official's window on a screen of its own."""
    need_screen()

    def open_(domain: int) -> Console:
        screen = parts.enter_context(Screen())
        return parts.enter_context(Console(tmp_path, domain, screen))

    return open_


# ----- a window that ends or hangs ----------------------------------------------------------


def test_the_process_of_a_closed_window_ends_in_time_when_ros_hangs(domain: int) -> None:
    """DDS may hang with the interpreter's lock held; that cannot be brought about at will."""
    need_qt()
    code = (
        'import ctypes, os, signal, sys\n'
        'import rclpy\n'
        'rclpy.try_shutdown = lambda: ctypes.PyDLL(None).sleep(3600)\n'
        'from evgp_rcs_console.gui import main\n'
        'sys.exit(main([], lambda window: os.kill(os.getpid(), signal.SIGTERM)))\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code],
        env={**os.environ, 'QT_QPA_PLATFORM': 'offscreen', 'ROS_DOMAIN_ID': str(domain)},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )

    assert done.returncode == 1
    assert done.stderr.endswith('ROS has hung, so this program ended without it\n')
    assert 'File "' not in done.stderr


# ----- what is shown ------------------------------------------------------------------------


def test_every_stop_is_pressed_until_race_control_is_back(
    parts: contextlib.ExitStack,
    domain: int,
    open_console: OpenConsole,
    connect_kart: ConnectKart,
    tmp_path: pathlib.Path,
) -> None:
    console = open_console(domain)
    console.wait_for('danger_title', text='NO RACE CONTROL YET')
    console.wait_for('danger_detail', text=f'/rcs/race in ROS domain {domain}, on this m')
    console.wait_for('standing', text='not known', tone='faint')
    console.key('space')
    console.wait_for('all_kill', pressing='true')
    console.wait_for('kill_hint', text=r'SENT [3-9] times in \d\.\d s: no answer')
    control = parts.enter_context(RaceControl(tmp_path, domain, (1, 2)))
    console.wait_for('state', text='RED RED')
    console.wait_for('all_kill', pressing='false')

    # A service hangs, and the window does not: it says so, with the time. After a second, the kart
    # server ends and wakes the frozen half, which says that its karts are lost.
    control.signal(signal.SIGSTOP)
    console.key('F4')
    console.wait_for('status', text=r'RED FLAG: sent [2-9] times in .*(no answer|lost its karts)')
    console.wait_for('danger_title', text='RACE CONTROL IS GONE')
    console.wait_for('danger_advice', text='USE THE MSR')
    control.wait()
    console.key('1', 'ctrl+r')
    console.wait_for('status', text='RED RED kart 1: sent [3-9] times in .* no answer. USE THE M')

    new = {'record': tmp_path / 'another.sqlite3'}
    again = parts.enter_context(RaceControl(tmp_path, domain, (1, 2), parameters=new))

    for number, state in ((1, RED_RED), (2, RED_FLAG)):
        connect_kart(again, number, acknowledges=True).wait_for_state(state)
    console.wait_for('danger', visible=False)
    console.wait_for('status', text='✓ .*RED (RED|FLAG)')


# ----- a race at one window -----------------------------------------------------------------


HELD_UP = 1.0
"""How long a window hangs here after what was typed, seconds."""


@contextlib.contextmanager
def held_up(console: Console, whole: bool = False) -> Iterator[None]:
    """
    Have the window hang: what is typed meanwhile waits.

    :param whole: its whole process is stopped; else its own thread only.
    """
    if whole:
        console.signal(signal.SIGSTOP)
    else:
        console.block()
    try:
        yield
        time.sleep(HELD_UP)  # what was typed becomes old, however long it took to hang and type
    finally:
        console.signal(signal.SIGCONT)
        console.go_on()


def test_old_presses_start_no_race_and_a_window_that_stays_hung_ends_it(
    start_race_control: StartRaceControl, open_console: OpenConsole, connect_kart: ConnectKart
) -> None:
    """Before that, a whole race goes by clicks and by keys."""
    control = start_race_control(
        in_race=(1,), others=(2,), nobody_there=3.0, finish_delays='[0.1]'
    )
    console = open_console(control.domain)
    karts = [connect_kart(control, number, acknowledges=True) for number in (1, 2)]
    for number in (1, 2):
        console.wait_for(f'kart_{number}', linked='true')

    console.wait_for('join_race_2', barred='false')
    console.press_on('join_race_2', see='leave_race_2')
    console.press_on('leave_race_2', see='join_race_2', barred='false')
    console.press('2', 'ctrl+j', see='leave_race_2')
    console.wait_for('open_track', barred='false')
    console.press_on('open_track', see='yes', barred='false')
    console.press_on('yes', see='humans', tone='good')
    console.wait_for('grid_active', barred='false')
    console.ask('F2', text=r'track is clear of humans \(this command closes it\)')
    console.press('y', see='green_green', barred='false')
    console.wait_for('humans', text='KEEP OFF')
    console.press('F3', see='no', focus=True)
    console.press('Tab', see='yes', focus=True)
    console.press('Return', see='kart_finish_2', barred='false')
    console.press_on('kart_finish_2', see='kart_2', text='F1')
    console.press('a', see='state', text='RED RED')
    console.wait_for('state_since', text='race over')
    console.wait_for('in_garage', barred='false')
    console.ask('F6', text='track is safe for humans')
    console.press('F7', see='humans', tone='good')
    for kart in karts:
        kart.wait_for_state(IN_GARAGE)
        states = [state for _, state in kart.changes]
        assert states == [IN_GARAGE, GRID_ACTIVE, GREEN_GREEN, RED_FLAG, RED_RED, IN_GARAGE]

    console.ask('F2')
    console.press('y', see='green_green', barred='false')
    start = console.place('green_green')
    for whole, first in ((False, 'F3'), (True, 'GREEN GREEN')):
        console.press_on('green_green', see='yes', barred='false')
        yes = console.place('yes')
        with held_up(console, whole):
            console.key('y')
        console.wait_for('status', text='Y WAS NOT SENT: pressed at ')
        assert karts[0].state is GRID_ACTIVE
        console.press('n', see='question', visible=False)

        with held_up(console, whole):
            if first == 'F3':
                console.key('F3', 'y')
            else:
                console.screen.click(*start)
                console.screen.click(*yes)
        told = rf'{first}.*: pressed at [\d:]+ while the window was not responding'
        console.wait_for('status', text=told)
        assert karts[0].state is GRID_ACTIVE
        console.wait_for('question', visible=False)
    # It was said to press it again, and that does, once race control knows of the window again.
    console.wait_for('strip', text='1 official can stop')
    console.ask('F3')
    console.press('y', see='state', text='GREEN GREEN')
    karts[0].wait_for_state(GREEN_GREEN)

    console.block()  # its own thread only: DDS goes on

    karts[0].wait_for_state(RED_FLAG)
    console.kill()  # it would not end in time


# ----- nothing keeps a stop -----------------------------------------------------------------


class AtWindow:
    """A window on a race of twelve karts in the garage, and the stops that come from it."""

    def __init__(self, race: WireRace, console: Console) -> None:
        self.console = console
        self._official = race.official

    def wait_for_stop(self, command: CommandKind, kart: int = 0) -> None:
        """Wait until race control accepts this stop, since the last one that was waited for."""
        kind = getattr(msg.CommandAvailability, command.name)
        self._official.wait_for_event(
            lambda each: (each.kind, each.command, each.kart) == (each.COMMAND, kind, kart),
            f'{command.name} of kart {kart}',
        )
        with self._official.news:
            self._official.events.clear()


@pytest.fixture(scope='module')
def at_window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AtWindow]:
    need_screen()
    folder, karts = tmp_path_factory.mktemp('window'), range(1, 13)
    # With the banner's line there is the least room.
    with (
        WireRace(folder, karts, absent=karts, parameters={'banner': 'REHEARSAL'}) as race,
        Screen() as screen,
        Console(folder, race.domain, screen) as console,
    ):
        console.wait_for('kart_finish_12', barred='true')
        yield AtWindow(race, console)


def test_nothing_that_opens_takes_a_stop(at_window: AtWindow) -> None:
    console = at_window.console
    x, y = console.place('log')
    bar = console.wait_for('karts')

    def point_for_a_tip() -> None:
        console.hover('kart_finish_3')
        time.sleep(1.5)  # a tip comes after a while

    for begin in (
        lambda: console.click('filter'),
        lambda: console.screen.right_click(x, y),
        lambda: console.screen.right_click(bar['x'] + bar['width'] - 10, y - 200),
        point_for_a_tip,
    ):
        begin()
        if begin is point_for_a_tip:  # just below the pointer, where it would lie
            left, middle = console.place('kart_red_red_4')
            console.screen.click(left, middle)
        else:
            console.click('kart_red_red_4')
        at_window.wait_for_stop(CommandKind.KART_RED_RED, 4)
        begin()
        console.key('5', 'ctrl+f')
        at_window.wait_for_stop(CommandKind.KART_RED_FLAG, 5)
        begin()
        console.click('red_flag')
        at_window.wait_for_stop(CommandKind.RED_FLAG)
        begin()
        console.click('all_kill')
        at_window.wait_for_stop(CommandKind.ALL_KILL)


HELD = ('shift', 'altgr', 'shift+altgr', 'ctrl', 'caps', 'shift+caps', 'caps+altgr', 'caps')
"""What is held with the space bar. The lock is put on by one of them and off again by another."""


@pytest.mark.parametrize(
    ('layout', 'digit', 'kart'),
    [
        *(('fr bepo', '', 0), ('ca', '', 0), ('de neo', '', 0), ('bt', '', 0)),
        ('fr', 'shift+7', 7),  # its digits need Shift
        ('ru', '2', 2),  # it has no Latin letters
    ],
)
def test_the_keys_of_stops_are_stops_on_every_layout_whatever_is_held_with_all_kill(
    at_window: AtWindow, layout: str, digit: str, kart: int
) -> None:
    console = at_window.console
    console.screen.lay_out(*layout.split())
    # Where AltGr is Alt, that is a key of the X server.
    last = 'F12' if layout == 'ru' else 'ctrl+altgr+F12'

    for keys in ('space', *(f'{each}+space' for each in HELD), last):
        console.key(keys)

        at_window.wait_for_stop(CommandKind.ALL_KILL)
        console.wait_for('kill_hint', text='SPACE BAR')  # accepted: not the one before once more
    if kart:
        console.key(digit, 'ctrl+r')
        at_window.wait_for_stop(CommandKind.KART_RED_RED, kart)
    console.screen.lay_out('us')
