# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""`inspect_kart` against a good kart, and against karts with one fault each, on real sockets."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
import contextlib
import itertools
import os
import pathlib
import socket
import subprocess
import sys
import time

from evgp_inspection.inspection import Exit, inspect, Inspection
from evgp_inspection.inspector import Unattended
from evgp_inspection.kart_sentences import KART
from evgp_inspection.kart_script import Kill, START_KART_AGAIN
from evgp_inspection.kart_wire import KartWire, LATE_BEAT
from evgp_inspection.limits import Limits
from evgp_inspection.odometry import Take
from evgp_inspection.recording import Recording, RESET
from evgp_inspection.traces import Kind
from evgp_inspection.verdicts import select, Verdict
from inspected_kart import FAULTS, InspectedKart
from inspecting import inspect_all, those
import pytest

SHORT = Limits(
    connect=10.0,
    grid=2.0,
    green=2.0,
    red_flag=2.0,
    red_red=2.0,
    silence=0.8,
    reconnect=2.0,
    away=0.4,
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

INSPECTIONS = int(os.environ.get('EVGP_INSPECTIONS', '10'))


class OneInspection:
    """
    One inspection of one kart in this process, and its inspector, who answers nothing.

    :param fault: of the kart; empty: it is good.
    :param seen: there is odometry.
    :param starts_again: the inspector starts a kart again that has ended.
    """

    def __init__(
        self, fault: str = '', seen: bool = True, only: str = '', starts_again: bool = False
    ) -> None:
        self.lines: list[str] = []
        self.kart: InspectedKart | None = None
        self.driving = asyncio.Event()
        self.stopping = asyncio.Event()
        self._fault = fault
        self._seen = seen
        self._only = only
        self._starts_again = starts_again
        self._port = 0
        self._takes: list[Take] = []
        self._running: asyncio.Task[None] | None = None

    async def run(self) -> Inspection:
        """Inspect to the end."""
        try:
            return await inspect(
                self,
                SHORT,
                select(KART, self._only),
                self.stopping,
                odometry=self._odometry if self._seen else None,
                kills={'bridge': self._kill('bridge'), 'stack': self._kill('stack')},
                listening=self._start_kart,
            )
        finally:
            await self._end_kart()

    def tell(self, line: str) -> None:
        self.lines.append(line)

    async def ask(self, question: str, seconds: float) -> bool | None:
        if question != START_KART_AGAIN or not self._starts_again:
            return None
        await self._end_kart()
        self._start_kart(self._port)
        return True

    def _kill(self, part: str) -> Kill:
        async def kill() -> bool:
            assert self.kart is not None
            self.kart.kill(part)
            return True

        return kill

    async def _end_kart(self) -> None:
        if self._running is not None:
            self._running.cancel()
            await asyncio.gather(self._running, return_exceptions=True)

    def _start_kart(self, port: int) -> None:
        self._port = port
        # The one that nobody sees says no more than a kart has to.
        self.kart = InspectedKart(port, self._take, self._fault, SHORT.silence, self._seen)
        self._running = asyncio.create_task(self.kart.run())

    def _take(self, speed: float) -> None:
        if speed > 1.0:
            self.driving.set()
        for take in self._takes:
            take(speed)

    async def _odometry(self, take: Take) -> Callable[[], None]:
        self._takes.append(take)
        return self._takes.clear


def is_found(fault: str, inspection: Inspection) -> bool:
    """Return whether a fault is found by its own clause and by no other."""
    return bool(fault) and set(those(inspection, Verdict.FAIL)) == {FAULTS[fault]}


def inspect_karts(karts: list[tuple[str, bool]]) -> list[Inspection]:
    """Inspect karts of these faults, seen or not, at the same time."""
    last: dict[tuple[str, bool], OneInspection] = {}

    def begin(kart: tuple[str, bool]) -> Callable[[], Awaitable[Inspection]]:
        last[kart] = OneInspection(*kart)
        return last[kart].run

    return inspect_all(
        karts,
        begin,
        lambda kart, inspection: is_found(kart[0], inspection),
        # Good karts are to pass, held up or not.
        lambda kart: bool(kart[0] and (inspected := last[kart].kart) and inspected.held_up),
    )


@pytest.mark.early
@pytest.mark.timeout(600)
def test_a_good_kart_passes_and_each_fault_is_found_by_its_own_clause_and_no_other() -> None:
    karts = [('', True), ('', False), ('echoes RED_RED', False)]
    karts += [(fault, True) for fault in FAULTS]
    inspections = inspect_karts(karts)
    wrong = {
        kart: failed
        for kart, inspection in zip(karts, inspections, strict=True)
        if (failed := those(inspection, Verdict.FAIL)) or kart[0]
        if not is_found(kart[0], inspection)
    }
    assert not wrong
    seen, unseen = inspections[:2]
    assert not those(seen, Verdict.NOT_JUDGED)
    assert seen.exit_code is Exit.PASSED
    assert unseen.exit_code is Exit.NOT_PASSED
    # What nobody sees is neither passed nor failed; what the wire shows is judged.
    blind = set(those(unseen, Verdict.NOT_JUDGED))
    assert {'K-3A-05', 'K-3A-07', 'K-3A-10', 'K-3E-01', 'K-3E-06'} <= blind
    assert not {'K-3A-02', 'K-3A-09', 'K-4C-06', 'K-4D-01', 'K-4D-05'} & blind


def test_every_clause_has_a_kart_that_fails_it_but_the_one_of_connecting_at_all() -> None:
    assert sorted({*FAULTS.values(), 'K-4A-01'}) == [clause.name for clause in KART]


def test_an_inspection_that_is_stopped_while_the_kart_drives_stops_the_kart() -> None:
    async def stopped() -> tuple[Inspection, OneInspection]:
        one = OneInspection(only='K-3A-05')
        running = asyncio.create_task(one.run())
        await one.driving.wait()
        one.stopping.set()
        inspection = await running
        return inspection, one

    inspection, one = asyncio.run(stopped())
    assert one.kart is not None
    assert one.kart.speed == 0.0
    assert one.kart.last_heard == b'$RED_RED;'
    assert inspection.exit_code is Exit.NOT_PASSED


def test_an_inspection_that_fails_while_the_kart_drives_stops_the_kart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from evgp_inspection.kart_steps import KartSteps

    async def broken(self: KartSteps) -> None:
        assert await self._drive('red')
        raise ZeroDivisionError

    monkeypatch.setattr(KartSteps, '_red', broken)
    ones: list[OneInspection] = []

    async def fails() -> Inspection:
        ones.append(OneInspection(only='K-3A-10'))
        return await ones[0].run()

    with contextlib.suppress(ZeroDivisionError):
        asyncio.run(fails())
        pytest.fail('the mistake was swallowed')
    kart = ones[0].kart
    assert kart is not None
    assert ones[0].driving.is_set()
    assert kart.speed == 0.0
    assert kart.last_heard == b'$RED_RED;'


@pytest.mark.early
def test_a_kart_that_ends_is_started_again_by_the_inspector_and_inspected_to_the_end() -> None:
    (inspection,) = inspect_all(
        ['FIN ends it'], lambda fault: OneInspection(fault, only='K-4D', starts_again=True).run
    )
    assert set(those(inspection, Verdict.FAIL)) == {'K-4D-01'}
    assert inspection.finished
    # What only follows from it, and what a program that was just started cannot show.
    unseen = {'K-4D-03', 'K-4D-05', 'K-4D-06'}
    assert set(those(inspection, Verdict.NOT_JUDGED)) == unseen


@contextlib.asynccontextmanager
async def connected() -> AsyncIterator[tuple[Recording, KartWire, socket.socket]]:
    """Return a wire, and the socket of a kart that is connected."""
    recording = Recording()
    wire = KartWire(recording, lambda line: None)
    await wire.listen('127.0.0.1', 0)
    with socket.create_connection(('127.0.0.1', wire.port)) as kart:
        assert await recording.until(lambda: wire.connected, 10.0)
        yield recording, wire, kart
    await wire.shut_down()


def test_a_connection_is_closed_in_order_whatever_the_kart_has_just_said() -> None:
    async def closed() -> bytes:
        async with connected() as (_, wire, kart):
            kart.send(b'$RED_RED;')  # nobody reads it any more: a mere close would be a reset
            wire.close()
            await wire.shut_down()
            return kart.recv(1)

    assert asyncio.run(closed()) == b''


@pytest.mark.parametrize('how', ['close', 'half_close', 'reset', 'go_away'])
def test_a_connection_that_the_kart_has_just_reset_can_be_ended(how: str) -> None:
    async def ended() -> None:
        async with connected() as (_, wire, kart):
            kart.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            kart.close()
            getattr(wire, how)()  # nobody has heard of the reset yet

    asyncio.run(ended())


def test_a_frame_that_takes_too_long_to_send_is_a_hold_up_of_the_inspecting_computer() -> None:
    async def slow() -> bool:
        async with connected() as (recording, wire, _):
            wire.send(itertools.repeat([(0.05, b'$'), (0.05, b'RED_RED;')]))
            asyncio.get_running_loop().call_later(0.02, time.sleep, 2 * LATE_BEAT)
            return await recording.until(lambda: recording.trace.now.of(Kind.HELD_UP), 10.0)

    assert asyncio.run(slow())


def test_a_kart_that_never_comes_is_not_judged() -> None:
    async def alone() -> Inspection:
        limits = Limits(connect=0.1, hold=0.0)
        return await inspect(Unattended(lambda line: None), limits, KART, asyncio.Event())

    inspection = asyncio.run(alone())
    assert inspection.exit_code is Exit.NOT_PASSED
    assert 'K-4A-01' in those(inspection, Verdict.FAIL)


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
@pytest.mark.timeout(3600)
def test_of_many_inspections_of_good_karts_none_fails() -> None:
    left = INSPECTIONS
    while left > 0:
        many = min(left, 20)
        for inspection in inspect_karts([('', number % 2 == 0) for number in range(many)]):
            assert not those(inspection, Verdict.FAIL)
            assert inspection.finished
        left -= many
