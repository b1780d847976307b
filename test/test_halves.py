# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Race control's processes: whichever of the two halves dies or hangs, karts stop and officials know.

One has ROS (``rcs_node``), the other the rules and the karts' sockets. Neither outlives the other.
The third writes the record, and karts go on without it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import ctypes
import os
import pathlib
import signal

from evgp_protocol.states import RaceState
from evgp_rcs.karts.priority import NICENESS
from evgp_rcs_msgs import msg
from evgp_testing.official import Official
from evgp_testing.process import freeze, wait_until_ended
from evgp_testing.wire_race import WireRace
import pytest
from rig.faulty_nodes import program_of, RaceControlThatTakesNoStops
from rig.needs import cannot_run
from rig.niceness import may_come_first
from rig.replaying import replay_without_difference

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED

RACING = (1, 2)
OUTSIDE = 3

UNICAST_DISCOVERY = 7410
UNICAST_CALLS = 7411
"""The ports of the first ROS process of domain 0."""

_LIBC = ctypes.CDLL(None, use_errno=True)
_SEIZE, _INTERRUPT, _DETACH = 0x4206, 0x4207, 17  # of ptrace
_WALL = 0x40000000


@contextlib.contextmanager
def started(folder: pathlib.Path) -> Iterator[WireRace]:
    """Yield a race of two karts, with one outside it; its record can be replayed afterwards."""
    with WireRace(folder, RACING, [OUTSIDE]) as race:
        yield race
    replay_without_difference(folder / 'record.sqlite3')


@pytest.fixture(scope='module')
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[], WireRace]]:
    """Return a function that returns a race, and another one once that has ended."""
    races: list[WireRace] = []
    with contextlib.ExitStack() as stack:

        def race() -> WireRace:
            if not races or not races[-1].control.runs:
                stack.close()
                races.append(stack.enter_context(started(tmp_path_factory.mktemp('race'))))
            return races[-1]

        yield race


@pytest.fixture
def scene(running: Callable[[], WireRace]) -> WireRace:
    """Return a race, which the test may end."""
    return running()


def wait_for_alert(official: Official, kind: int) -> msg.Race:
    """Return the first race that is shown with an alert of this kind."""
    return official.wait_for_race(
        lambda race: any(alert.kind == kind for alert in race.alerts), f'an alert {kind}'
    )


def receiving_threads(pid: int, port: int) -> list[int]:
    """Return the threads by which Fast DDS receives in a process at a UDP port."""
    tasks = pathlib.Path(f'/proc/{pid}/task').iterdir()
    return [int(each.name) for each in tasks if (each / 'comm').read_text() == f'dds.udp.{port}\n']


@contextlib.contextmanager
def stopped_thread(thread: int) -> Iterator[None]:
    """
    Have one thread of another process stand still, while all others go on.

    :raises OSError: if it may not be traced.
    """
    _trace(_SEIZE, thread)
    _trace(_INTERRUPT, thread)
    os.waitpid(thread, _WALL)
    try:
        yield
    finally:
        # If its process has ended: nobody else can take it away.
        with contextlib.suppress(OSError):
            _trace(_DETACH, thread)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(thread, _WALL | os.WNOHANG)


def _trace(request: int, thread: int) -> None:
    if _LIBC.ptrace(request, thread, None, None):
        number = ctypes.get_errno()
        raise OSError(number, f'ptrace of thread {thread}: {os.strerror(number)}')


def mapped(pid: int) -> str:
    return pathlib.Path(f'/proc/{pid}/maps').read_text(encoding='utf-8')


def test_the_process_that_stops_karts_has_no_ros_and_the_other_no_memory_of_other_programs(
    scene: WireRace,
) -> None:
    control = scene.control
    assert 'rclpy' in mapped(control.pid)  # or this would not be how it is seen
    for what in ('rclpy', 'librcl', 'librmw', 'fastrtps', 'fastdds', 'cyclone'):
        assert what not in mapped(control.kart_server_pid)
    for pid in (control.pid, control.kart_server_pid):
        assert 'shm/fast' not in mapped(pid)  # where Fast DDS has its shared memory


def test_all_of_race_control_comes_before_other_programs_and_the_loop_of_the_karts_first(
    scene: WireRace,
) -> None:
    if not may_come_first():
        cannot_run('it takes root, or a limit for the user')
    control = scene.control
    processes = [control.pid, control.kart_server_pid, control.record_pid]
    taking_stops = receiving_threads(control.pid, UNICAST_CALLS + 250 * scene.domain)
    for each in (*processes, *taking_stops):
        assert os.getpriority(os.PRIO_PROCESS, each) == NICENESS
    session = pathlib.Path(f'/proc/{control.kart_server_pid}/autogroup')
    if session.exists():  # Linux shares by sessions, and this one is the kart server's own
        assert session.read_text().split()[-1] == str(NICENESS)
    first = [each for each in processes if os.sched_getscheduler(each) != os.SCHED_OTHER]
    assert first == [control.kart_server_pid]


def test_every_kart_hears_red_red_when_a_thread_that_receives_for_dds_hangs(
    scene: WireRace,
) -> None:
    # Of the threads, the one without which race control still hears its calls to itself.
    scene.bring_to(GREEN_GREEN)
    (thread,) = receiving_threads(scene.control.pid, UNICAST_DISCOVERY + 250 * scene.domain)
    with stopped_thread(thread):
        for kart in scene.karts:
            kart.wait_for_end()
            assert kart.state is RED_RED
        wait_for_alert(scene.official, msg.Alert.PART_FAILED)
    assert scene.control.wait() == 1


def test_every_kart_hears_red_red_when_the_thread_that_takes_the_stops_hangs(
    tmp_path: pathlib.Path,
) -> None:
    program = program_of(RaceControlThatTakesNoStops, tmp_path)
    with WireRace(tmp_path, [1], program=program) as race:
        race.bring_to(GREEN_GREEN)
        race.official.timeout = 1.0
        with pytest.raises(AssertionError):
            race.official.call('red_flag')
        race.karts[0].wait_for_end()
        assert race.karts[0].state is RED_RED
        assert race.control.wait() in (1, -signal.SIGKILL)
        wait_until_ended(race.control.kart_server_pid)


def test_no_race_starts_while_a_disk_hangs_one_goes_on_without_a_record_and_none_without_its_karts(
    scene: WireRace,
) -> None:
    scene.bring_to(GRID_ACTIVE)
    official = scene.official
    official.wait_for_available('green_green')
    offers: list[bool] = []  # whether GREEN_GREEN is offered

    def hear(race: msg.Race) -> None:
        green = msg.CommandAvailability.GREEN_GREEN
        offers.append(next(each.available for each in race.commands if each.command == green))

    freeze(scene.control.record_pid)
    wait_for_alert(official, msg.Alert.RECORD_FAILING)  # although nothing happens meanwhile
    official.node.create_subscription(msg.Race, '/rcs/race', hear, 100)
    assert not official.call('green_green').success
    official.wait_until_polled(lambda: len(offers) > 3, 'the race is shown again')
    assert not any(offers)
    os.kill(scene.control.record_pid, signal.SIGCONT)
    official.wait_for_available('green_green')
    failing, cleared = msg.Alert.RECORD_FAILING, msg.RaceEvent.ALERT_CLEARED
    official.wait_for_event(
        lambda event: (event.alert, event.kind) == (failing, cleared), 'all clear'
    )
    alerts = [
        event.kind
        for event in official.events
        if event.alert == failing and event.kind in (msg.RaceEvent.ALERT_RAISED, cleared)
    ]
    assert alerts == [msg.RaceEvent.ALERT_RAISED, cleared]
    official.command('green_green')

    os.kill(scene.control.record_pid, signal.SIGKILL)
    wait_for_alert(official, msg.Alert.RECORD_FAILING)
    for kart in scene.karts[: len(RACING)]:
        kart.wait_for_frames(3)
        assert kart.state is GREEN_GREEN
    scene.bring_to(RED_RED)
    scene.bring_to(IN_GARAGE)
    answer = official.call('grid_active', track_clear=True)
    assert not answer.success
    assert 'record' in answer.message

    freeze(scene.control.kart_server_pid)
    answer = official.call('all_kill')
    assert not answer.success
    assert 'lost its karts, so use the MSR' in answer.message  # at once, not after 4 s
    assert wait_for_alert(official, msg.Alert.PART_FAILED).alerts[0].use_msr
    for kart in scene.karts:
        kart.wait_for_end()
    assert scene.control.wait() == 1
    wait_until_ended(scene.control.kart_server_pid)
