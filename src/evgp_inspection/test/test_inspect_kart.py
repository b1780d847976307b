# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""`inspect_kart` against good karts and karts with one fault each, on a simulated clock."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Collection, Coroutine
import contextlib
import dataclasses
import functools
import itertools
import os
import pathlib
import selectors
import socket
import subprocess
import sys
import time
from typing import Any, TypeVar

from evgp_inspection.inspection import inspect
from evgp_inspection.inspector import Unattended
from evgp_inspection.kart_script import KartScript, KILLING_STEPS, RACE_STEPS
from evgp_inspection.kart_sentences import KART
from evgp_inspection.kart_wire import KartWire, LATE_BEAT
from evgp_inspection.limits import Limits
from evgp_inspection.odometry import Datagrams, Take
from evgp_inspection.recording import Recording, RESET
from evgp_inspection.traces import Kind
from evgp_inspection.verdicts import Inspection, select, Verdict
from evgp_protocol.states import RaceState
from inspected_kart import BREAKS, FAULTS, HABITS, Kart
import pytest

T = TypeVar('T')

INSPECTIONS = int(os.environ.get('EVGP_INSPECTIONS', '200'))

SHORT = Limits(
    connect=10.0,
    grid=2.0,
    green=2.0,
    red_flag=2.0,
    red_red=2.0,
    silence=0.8,
    reconnect=2.0,
    away=2.5,
    drive=1.4,
    long=6.0,
    dwell=2.5,
    seed=1.0,
    watch=0.8,
    slack=0.4,
    fast=0.6,
    warning=0.0,
    hold=0.8,
)
"""Limits for a kart that stops within a second."""

FULL = dataclasses.replace(Limits(), seed=1.0)
"""The limits of real inspections."""


class _Clock(selectors.EpollSelector):
    """
    Waits by moving the clock, so that an inspection of eight minutes takes seconds.

    Sockets are real, on loopback, where a byte that was sent is there to be read when `send`
    returns. So whenever nothing is ready, nothing can become ready but a timer.
    """

    now = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if not ready and timeout is None:
            return super().select(None)  # no timer is left: something outside ends this
        if not ready and timeout is not None and timeout > 0:
            self.now += timeout
        return ready


def simulated(what: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine on a clock that moves only while nothing is left to do."""
    clock = _Clock()
    loop = asyncio.SelectorEventLoop(clock)
    loop.time = lambda: clock.now  # type: ignore[method-assign]
    with contextlib.closing(loop):
        return loop.run_until_complete(what)


def those(inspection: Inspection, verdict: Verdict) -> dict[str, str]:
    """Return the clauses with this verdict, and why."""
    return {clause.name: found.why for clause, found in inspection.having(verdict).items()}


@dataclasses.dataclass
class OneInspection:
    """
    One inspection of one kart in this process, and its inspector.

    :param kind: the fault or habit of the kart; empty: it is good and has none.
    :param seen: there is odometry.
    :param long_after: time after which the kart moves off by itself, if that is its fault, s;
        longer than any phase in which it stands, but for `dwell`.
    :param steps: those to be done; none: all that the clauses need.
    :param eyes: the inspector looks at the wheels; otherwise nothing is answered.
    """

    kind: str = ''
    seen: bool = True
    only: str = ''
    limits: Limits = SHORT
    steps: Collection[str] = ()
    long_after: float = 1.8
    eyes: bool = False
    told: list[str] = dataclasses.field(default_factory=list)
    kart: Kart | None = None
    driving: asyncio.Event = dataclasses.field(default_factory=asyncio.Event)
    stopping: asyncio.Event = dataclasses.field(default_factory=asyncio.Event)
    _take: Take = lambda speed: None

    def inspect(self) -> Inspection:
        """Inspect to the end, on a simulated clock."""
        return simulated(self.run())

    async def run(self) -> Inspection:
        try:
            return await inspect(
                self,
                self.limits,
                select(KART, self.only),
                self.stopping,
                odometry=self._odometry if self.seen else None,
                kills={part: functools.partial(self._kill, part) for part in KILLING_STEPS},
                listening=self._start_kart,
                steps=self.steps,
            )
        finally:
            self._end_kart()

    def tell(self, line: str) -> None:
        self.told.append(line)

    async def ask(self, question: str, seconds: float) -> bool | None:
        assert self.kart is not None
        if self.eyes and 'wheels' in question:
            turn = 'turn' in question
            for _ in range(20):  # whoever sees what is asked for says so, a little later
                await asyncio.sleep(0.3)
                if (self.kart.speed > 0.0) is turn:
                    return True
            return False
        return None

    async def _kill(self, part: str) -> bool:
        assert self.kart is not None
        self.kart.kill(part)
        return True

    def _end_kart(self) -> None:
        if self.kart is not None:
            self.kart.end()

    def _start_kart(self, port: int) -> None:
        # One that nobody sees says no more than a kart has to.
        self.kart = Kart(
            port, self._see, self.kind, self.limits.silence, self.seen, self.long_after
        )

    def _see(self, speed: float) -> None:
        if speed > 1.0:
            self.driving.set()
        self._take(speed)

    async def _odometry(self, take: Take) -> Callable[[], None]:
        self._take = take
        return lambda: None


ALL = {clause.name for clause in KART}
REAL = {'limits': FULL, 'long_after': 7.0}
EYES: dict[str, Any] = {'seen': False, 'eyes': True, 'limits': FULL}


@pytest.mark.parametrize(
    ('kind', 'how'),
    [('', {}), ('is slow and gentle', EYES), *((habit, {'limits': FULL}) for habit in HABITS)],
)
def test_a_good_kart_passes_whatever_its_habits_and_with_eyes_in_place_of_odometry(
    kind: str, how: dict[str, Any]
) -> None:
    inspection = OneInspection(kind, **how).inspect()
    assert not those(inspection, Verdict.FAIL)
    assert set(those(inspection, Verdict.NOT_JUDGED)) <= ({'K-4C-11'} if how is EYES else set())
    assert inspection.verdict is Verdict.PASS


def test_a_good_kart_whose_wheels_nobody_sees_fails_nothing_and_does_not_pass() -> None:
    inspection = OneInspection(seen=False).inspect()
    assert not those(inspection, Verdict.FAIL)
    # What nobody sees is neither passed nor failed; what the wire shows is judged.
    blind = set(those(inspection, Verdict.NOT_JUDGED))
    assert blind == {'K-4C-11', *(clause.name for clause in KART if clause.starred)}
    assert inspection.verdict is not Verdict.PASS


@pytest.mark.parametrize(
    ('fault', 'how', 'breaks', 'may_break'),
    [
        *((fault, {}, {clause}, {*BREAKS[fault]}) for fault, clause in FAULTS.items()),
        # The steps of its clause find it, with the limits of real inspections.
        *((fault, {'only': clause, **REAL}, {clause}, ALL) for fault, clause in FAULTS.items()),
        # An inspector who looks finds wheels that turn. Too early is also before it rolls off.
        ('drives in the garage', EYES, {'K-3A-01'}, set()),
        ('takes malformed bytes for life', EYES, {'K-3E-07'}, set()),
        ('rolls off after RED_FLAG', EYES, {'K-3A-08'}, {'K-3A-07'}),
        ('echoes RED_RED', {'seen': False}, {'K-3A-10'}, {'K-3E-08'}),
        ('brakes for RED_RED as for RED_FLAG', {'seen': False}, {'K-3A-13'}, set()),
    ],
)
def test_a_fault_is_found_by_the_sentence_that_it_breaks(
    fault: str, how: dict[str, Any], breaks: set[str], may_break: set[str]
) -> None:
    failed = set(those(OneInspection(fault, **how).inspect(), Verdict.FAIL))
    assert breaks <= failed <= breaks | may_break


def test_a_kart_that_moves_while_race_control_is_away_is_inspected_to_the_end() -> None:
    fault = 'drives off long after race control went away'
    assert OneInspection(fault, only='K-3E-06').inspect().finished


def test_a_kart_that_does_not_connect_again_ends_the_inspection_with_a_warning() -> None:
    one = OneInspection('FIN ends it', only='K-4D-01,K-4D-02')
    assert not one.inspect().finished
    assert any('not connected again' in line and 'USE THE MSR' in line for line in one.told)


def test_a_race_only_judges_what_a_race_shows() -> None:
    inspection = OneInspection(steps=RACE_STEPS).inspect()
    judged = set(those(inspection, Verdict.PASS))
    assert {'K-3A-02', 'K-3A-05', 'K-3A-07', 'K-3A-09'} <= judged
    assert 'K-3C-01' not in judged
    assert not those(inspection, Verdict.FAIL)


def test_every_clause_has_a_kart_that_fails_it_but_the_one_of_connecting_at_all() -> None:
    assert sorted({*FAULTS.values(), 'K-4A-01'}) == [clause.name for clause in KART]


def test_an_inspection_that_is_stopped_while_the_kart_drives_stops_the_kart() -> None:
    async def stopped() -> tuple[Inspection, OneInspection]:
        one = OneInspection(only='K-3A-05')
        running = asyncio.create_task(one.run())
        await one.driving.wait()
        one.stopping.set()
        return await running, one

    inspection, one = simulated(stopped())
    assert one.kart is not None
    assert one.kart.speed == 0.0
    assert one.kart.last_heard == b'$RED_RED;'
    assert inspection.verdict is not Verdict.PASS


def test_an_inspection_that_fails_while_the_kart_drives_stops_the_kart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def broken(self: KartScript) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(KartScript, '_brake', broken)
    one = OneInspection(only='K-3A-12')
    with pytest.raises(ZeroDivisionError):
        one.inspect()
    assert one.kart is not None
    assert one.driving.is_set()
    assert one.kart.speed == 0.0
    assert one.kart.last_heard == b'$RED_RED;'


@contextlib.asynccontextmanager
async def connected() -> AsyncIterator[tuple[Recording, KartWire, socket.socket]]:
    """Return a wire, and the socket of a kart that is connected."""
    recording = Recording(Limits(), lambda name, found: None)
    wire = KartWire(recording, lambda line: None)
    await wire.listen('127.0.0.1', 0)
    with socket.create_connection(('127.0.0.1', wire.port)) as kart:
        assert await recording.until(lambda: wire.connected, 10.0)
        yield recording, wire, kart
    await wire.shut_down()


@pytest.mark.parametrize(
    ('kart_address', 'heard'), [('', [b'$', b'']), ('127.0.0.7', [b'', b'$'])]
)
def test_no_more_than_one_kart_is_sent_anything(kart_address: str, heard: list[bytes]) -> None:
    async def two_karts() -> list[bytes]:
        wire = KartWire(Recording(Limits(), print), lambda line: None, kart_address)
        await wire.listen('127.0.0.1', 0)
        wire.order(RaceState.RED_RED)
        found = []
        for address in ('127.0.0.1', '127.0.0.7'):
            reader, writer = await asyncio.open_connection(
                '127.0.0.1', wire.port, local_addr=(address, 0)
            )
            try:
                found.append(await reader.read(1))
            except ConnectionResetError:
                found.append(b'')
            writer.close()
        await wire.shut_down()
        return found

    assert asyncio.run(two_karts()) == heard


def test_a_connection_is_closed_in_order_whatever_the_kart_has_just_said() -> None:
    async def closed() -> bytes:
        async with connected() as (_, wire, kart):
            kart.send(b'$RED_RED;')  # nobody reads it any more: a mere close would be a reset
            wire.end('closed')
            await wire.shut_down()
            return kart.recv(1)

    assert asyncio.run(closed()) == b''


@pytest.mark.parametrize('how', ['closed', 'half-closed', 'reset', 'away'])
def test_a_connection_that_the_kart_has_just_reset_can_be_ended(how: str) -> None:
    async def ended() -> None:
        async with connected() as (_, wire, kart):
            kart.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            kart.close()
            wire.end(how)  # nobody has heard of the reset yet

    asyncio.run(ended())


def test_a_frame_that_takes_too_long_to_send_is_a_hold_up_of_the_inspecting_computer() -> None:
    async def slow() -> bool:
        async with connected() as (recording, wire, _):
            wire.send(itertools.repeat([(0.05, b'$'), (0.05, b'RED_RED;')]))
            asyncio.get_running_loop().call_later(0.02, time.sleep, 2 * LATE_BEAT)
            return await recording.until(
                lambda: any(each.kind is Kind.HELD_UP for each in recording.trace.events), 10.0
            )

    assert asyncio.run(slow())


def test_a_kart_that_never_comes_is_not_judged() -> None:
    async def alone() -> Inspection:
        limits = Limits(connect=0.1, hold=0.0)
        return await inspect(Unattended(), limits, KART, asyncio.Event())

    inspection = simulated(alone())
    assert inspection.verdict is not Verdict.PASS
    assert 'K-4A-01' in those(inspection, Verdict.FAIL)


def test_odometry_goes_on_after_bytes_that_are_no_speed_and_the_first_of_these_are_shown() -> None:
    speeds: list[float] = []
    told: list[str] = []
    datagrams = Datagrams(speeds.append, told.append)
    for data in (b'0.5\n', b'1 2', b'\xff\xfe 1', b'', b'-1.5'):
        datagrams.datagram_received(data, None)
    assert speeds == [0.5, 1.5]
    assert [line[-6:] for line in told] == ['"1 2".']


def test_odometry_from_ros_where_there_is_no_ros_says_what_to_do() -> None:
    package = pathlib.Path(__file__).resolve().parents[1]
    asked = ['kart', '--port', '0', '--unattended', '--word', 'ready', '--odometry', 'ros:/odom']
    done = subprocess.run(
        [sys.executable, '-S', '-E', str(package), *asked],  # no packages but Python's own
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert '--odometry ros:/odom needs ROS 2 with nav_msgs in this shell' in done.stderr
    assert 'Traceback' not in done.stderr


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.timeout(3600)
def test_of_many_inspections_of_good_karts_none_fails() -> None:
    habits = ('', *HABITS)
    for seed in range(1, INSPECTIONS + 1):
        limits = dataclasses.replace(SHORT, seed=float(seed), red_red=3.0, red_flag=5.0)
        habit = habits[seed % len(habits)]
        inspection = OneInspection(habit, seen=seed % 4 > 0, limits=limits).inspect()
        assert not those(inspection, Verdict.FAIL), (seed, habit)
        assert inspection.finished
