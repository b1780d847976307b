# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The steps of `inspect_kart`: race control is played to one kart, and everything is written down.

The steps judge nothing; `evgp_inspection.kart_judges` reads the trace that they leave. They look
at the trace only to go on as soon as there is nothing more to see, and to stop the kart at once
when it does what it must not.

The kart is never left driving. Whatever ends the inspection, RED_RED is sent for some seconds
first, and the inspector is told whether the kart has said that it stands. A kart that does not
acknowledge RED_RED, or sees it late, is not made to drive again.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection, Mapping
import functools
from types import MappingProxyType
from typing import TypeAlias

from evgp_inspection.inspector import Inspector
from evgp_inspection.kart_clauses import DRIVING_STEPS, KART_STEPS, KILLING_STEPS
from evgp_inspection.kart_judges import drove, moves, STANDS, started, TURNS
from evgp_inspection.kart_wire import (
    after,
    Beats,
    between,
    KartWire,
    late_halves,
    MALFORMED,
    many_in_a_piece,
    NOTHING,
    single_bytes,
    whole,
)
from evgp_inspection.limits import Limits
from evgp_inspection.recording import EndedError, Recording
from evgp_inspection.traces import Kind
from evgp_protocol.frames import encode
from evgp_protocol.hearing import QUIET
from evgp_protocol.link import BEAT_RATE
from evgp_protocol.states import RaceState

IN_GARAGE, GRID_ACTIVE = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_FLAG, RED_RED = RaceState.RED_FLAG, RaceState.RED_RED

ODOMETRY_COMES = 5.0
"""Maximum time to wait for the first odometry once the kart has connected, in seconds."""

SLOW_RATE, FAST_RATE = 10.0, 100.0
"""How often a frame is sent where that is slow, and where it is fast, Hz."""

BURST = 400
"""Frames that are sent at once, before the stop that must be seen in time: 20 s of frames."""

MOMENT = 0.2
"""Time for which IN_GARAGE is sent between two checks, s."""

SHORT_SILENCE = 0.4
"""Part of `silence` for which a new connection is sent nothing: not a silence yet."""

EARLY_STOP = 0.15
"""Time from GREEN_GREEN to the RED_RED that must stop a kart which has hardly begun, s."""

FLAG_BRAKES = 0.8
"""Part of its highest speed to which RED_FLAG brakes a kart before RED_RED comes."""

FLAG_ALONE = 1.0
"""Maximum time for which RED_FLAG brakes alone, s; where nobody measures, a third of it."""

PIECES = {'bytes': single_bytes, 'many': many_in_a_piece, 'late': late_halves, 'slow': whole}
"""How RED_RED is sent in the step `pieces`, ten times a second."""

LOSSES: dict[str, tuple[Callable[[KartWire], None], bool, bool]] = {
    'silence': (KartWire.fall_silent, True, True),
    'noise': (lambda wire: wire.send(between()), True, False),
    'fin': (KartWire.close, False, True),
    'reset': (KartWire.reset, False, True),
    'half': (KartWire.half_close, False, True),
}
"""The steps in which a kart that drives loses race control: how, whether that is a silence on a
connection that stays open, and whether GREEN_GREEN is sent once it stands."""

Kill: TypeAlias = Callable[[], Awaitable[bool]]
"""Kills a part of the kart's program; returns whether it is killed."""

KILL_PART = {
    'bridge': "Kill (kill -9) the kart's program that is connected to race control. Killed?",
    'stack': "Kill (kill -9) the kart's program that commands the motors. Killed?",
}
"""What the inspector is asked to kill while the kart drives."""

START_KART_AGAIN = "Then end the kart's program and start it again. Is it started?"
"""What the inspector is asked about a kart that does not connect again."""


def not_stopped(why: str) -> EndedError:
    """Return the end of an inspection whose kart did not say that it stands when told to stop."""
    return EndedError(f'{why} The inspection ended there. Use the MSR.')


class KartSteps:
    """
    The steps, in their order.

    :param wanted: the names of the steps to be done.
    :param seen: whether odometry is expected.
    :param kills: what kills the parts of the kart's program, by the names of `KILLING_STEPS`; a
        step for which there is none is not done.
    :param step_done: is called after each step with its name.
    """

    def __init__(
        self,
        recording: Recording,
        wire: KartWire,
        inspector: Inspector,
        limits: Limits,
        step_done: Callable[[str], None],
        wanted: Collection[str] = KART_STEPS,
        seen: bool = False,
        kills: Mapping[str, Kill] = MappingProxyType({}),
    ) -> None:
        self._hindrance = ''
        self._recording = recording
        self._trace = recording.trace
        self._wire = wire
        self._inspector = inspector
        self._limits = limits
        self._step_done = step_done
        self._wanted = wanted
        self._seen = seen
        self._kills = kills
        self._speechless = False  # what acknowledges was killed

    async def run(self) -> str:
        """
        Do the steps, and stop the kart.

        :return: why it was not made to drive, a sentence; empty: it was.
        :raises EndedError: the kart did not connect, or was not stopped.
        """
        try:
            for name in KART_STEPS:
                if name not in self._wanted and name != 'connect':
                    continue
                if name in DRIVING_STEPS and self._hindrance:
                    continue
                if name in KILLING_STEPS and name not in self._kills:
                    continue
                if name in LOSSES:
                    await self._lose(name, *LOSSES[name])
                else:
                    await getattr(self, f'_{name}')()
                self._step_done(name)
        except asyncio.CancelledError:
            self._inspector.tell('\a  !  STOPPED. RED_RED is sent to the kart.')
            raise
        finally:
            await self._end()
        return f'{self._hindrance} It was not made to drive.' if self._hindrance else ''

    # ----- what the steps are made of ------------------------------------------------------

    def _phase(self, name: str) -> None:
        self._recording.note(Kind.STEP, text=name)

    async def _until(self, found: Callable[[], object], seconds: float) -> bool:
        return await self._recording.until(found, seconds)

    async def _pass(self, seconds: float) -> None:
        """Let time pass, while everything is written down."""
        await self._until(lambda: None, seconds)

    async def _watch(self, seconds: float) -> None:
        """Watch a kart that must not drive; no longer than until it does."""
        section = self._trace.now
        await self._until(lambda: started(section, self._limits), seconds)

    async def _ask(self, question: str) -> bool | None:
        """Have the inspector look, unless odometry does; return the answer, if there is one."""
        return None if self._seen else await self._look(question)

    async def _look(self, question: str) -> bool | None:
        answer = await self._inspector.ask(f'Do {question}?', self._limits.answer)
        if answer is not None:
            self._recording.note(Kind.ANSWER, text=question, value=float(answer))
        return answer

    async def _look_at_wheels(self) -> None:
        """Watch the wheels of a kart that has said that it stands."""
        await self._pass(2 * self._limits.slack)
        await self._ask(STANDS)

    async def _must_stand(
        self,
        name: str,
        state: RaceState | None = None,
        beats: Callable[[RaceState], Beats] = whole,
        seconds: float = 0.0,
    ) -> None:
        """
        Have the kart sent something from which it must not start; None: the same as before.

        :param seconds: for how long; 0: `watch`.
        """
        self._phase(name)
        if state is not None:
            self._wire.order(state, beats)
        await self._watch(seconds or self._limits.watch)
        if not started(self._trace.now, self._limits):
            await self._ask(STANDS)

    async def _acknowledged(self, state: RaceState, seconds: float) -> bool:
        """Return whether the kart acknowledges a state, which it is being sent, in time."""
        return await self._until(lambda: self._trace.acknowledged(state), seconds)

    async def _connected(self) -> bool:
        """Return whether the kart is connected, or connects in time."""
        return await self._until(lambda: self._wire.connected, self._limits.reconnect)

    async def _start_it_again(self) -> None:
        """
        Have the inspector start the program of a kart that does not connect any more.

        One fault that ends a kart would hide all others otherwise.

        :raises EndedError: it is not connected after that either.
        """
        limits = self._limits
        why = f'The kart has not connected again for {limits.reconnect:g} s.'
        self._inspector.tell(f'\a  !  {why} If its wheels turn, USE THE MSR.')
        again = await self._inspector.ask(START_KART_AGAIN, limits.connect)
        if not (again and await self._until(lambda: self._wire.connected, limits.connect)):
            raise not_stopped(why)

    async def _stop(self, name: str) -> None:
        """
        Bring the kart to a standstill.

        :raises EndedError: it does not connect, or acknowledge RED_RED, in time.
        """
        self._phase(name)
        self._wire.order(RED_RED)
        if not await self._connected():
            await self._start_it_again()
        if not await self._acknowledged(RED_RED, self._limits.red_red):
            raise not_stopped(
                f'The kart has not acknowledged RED_RED within {self._limits.red_red:g} s.'
            )

    async def _garage(self, name: str) -> None:
        self._phase(name)
        self._wire.order(IN_GARAGE)
        await self._watch(MOMENT)
        await self._is_read()

    async def _is_read(self) -> None:
        """
        Wait until a kart that stands has read what it is sent: it says so, or it is silent.

        What it says after that cannot answer an order of before (docs/wire.md).
        """
        section = self._trace.now
        await self._until(
            lambda: self._trace.reached or started(section, self._limits),
            QUIET + self._limits.red_red,
        )

    async def _grid(self, step: str) -> bool:
        """Have the kart get ready; return whether it says that it is."""
        await self._garage(f'{step}/garage')
        self._phase(f'{step}/grid')
        self._wire.order(GRID_ACTIVE)
        ready = await self._acknowledged(GRID_ACTIVE, self._limits.grid)
        if not ready:
            self._hindrance = 'The kart has not acknowledged GRID_ACTIVE.'
        return ready

    async def _announce(self, step: str) -> None:
        self._inspector.tell(f'\a  !  THE KART DRIVES NOW ({step}).')
        await self._watch(self._limits.warning)

    async def _drive(self, step: str) -> bool:
        """Have the kart drive for a while; return whether it does."""
        limits = self._limits
        if not await self._grid(step):
            return False
        await self._announce(step)
        self._phase(f'{step}/green')
        # Before a stop: a kart that reads too little while it drives is late by now.
        self._wire.order(GREEN_GREEN, rate=FAST_RATE if step == 'red' else BEAT_RATE)
        section = self._trace.now
        if not await self._acknowledged(GREEN_GREEN, limits.green):
            self._hindrance = 'The kart has not acknowledged GREEN_GREEN.'
        elif self._seen:
            await self._until(
                lambda: any(moves(speed, limits) for _, speed in section.speeds),
                max(section.began + limits.green - self._recording.now, 0.0),
            )
        if step == 'race':
            await self._ask(TURNS)
        await self._pass(limits.drive)
        return drove(self._trace, step, limits)

    async def _comes_to_stand(self, seconds: float) -> bool:
        """
        Wait until the wheels stand, for so long at most; ask where there is no odometry.

        :return: False: they were seen to turn on.
        """
        limits = self._limits
        section = self._trace.now
        if not self._seen:
            return await self._ask(STANDS) is not False

        def stands() -> bool:
            speeds = section.speeds[-3:]
            return len(speeds) == 3 and not any(moves(speed, limits) for _, speed in speeds)

        return await self._until(stands, seconds)

    # ----- the steps ------------------------------------------------------------------------

    async def _connect(self) -> None:
        limits = self._limits
        self._phase('connect/wait')
        if not await self._until(lambda: self._wire.connected, limits.connect):
            raise EndedError(f'No kart connected within {limits.connect:g} s.')
        if self._seen:
            # The first of it takes its time: until then nobody sees the wheels.
            await self._until(lambda: self._trace.now.speeds, ODOMETRY_COMES)
            await self._until(lambda: self._wire.connected, limits.connect)
        self._phase('connect/quiet')
        section = self._trace.now
        await self._until(
            lambda: section.said or started(section, limits), limits.silence * SHORT_SILENCE
        )
        await self._must_stand('connect/garage', IN_GARAGE)

    async def _first_stop(self) -> None:
        await self._stop('first_stop/red')

    async def _alone(self) -> None:
        await self._garage('alone/garage')
        await self._must_stand('alone/green', GREEN_GREEN)
        await self._stop('alone/red')

    async def _pieces(self) -> None:
        for name, beats in PIECES.items():
            await self._garage(f'pieces/{name}_before')
            self._phase(f'pieces/{name}')
            self._wire.order(RED_RED, beats, SLOW_RATE)
            section = self._trace.now
            await self._acknowledged(RED_RED, self._limits.red_red)
            # A kart that takes slow frames for silence needs time to say so.
            longer = self._limits.watch if name == 'slow' else self._limits.slack
            await self._until(functools.partial(section.of, Kind.CLOSED), longer)
            await self._stop(f'pieces/{name}_after')

    async def _ready(self) -> None:
        ready = await self._grid('ready')
        await self._watch(self._limits.watch)
        await self._ask(STANDS)
        if ready:
            seconds = max(self._limits.watch, len(MALFORMED) / BEAT_RATE)
            await self._must_stand('ready/malformed', GRID_ACTIVE, between, seconds)
        await self._stop('ready/red')

    async def _again(self) -> None:
        if not self._hindrance and await self._grid('again'):
            await self._stop('again/red')
            await self._must_stand('again/green', GREEN_GREEN)
            if not started(self._trace.now, self._limits):
                await self._garage('again/between')
        await self._stop('again/stopped')
        await self._garage('again/out')
        await self._must_stand(
            'again/glued', GREEN_GREEN, lambda state: after(encode(GRID_ACTIVE), state)
        )
        await self._stop('again/end')

    async def _backlog(self) -> None:
        self._phase('backlog/fast')
        self._wire.order(IN_GARAGE, rate=FAST_RATE)
        await self._watch(self._limits.fast)
        await self._is_read()
        self._phase('backlog/red')
        self._wire.order(RED_RED, lambda state: after(encode(IN_GARAGE) * BURST, state))
        if not await self._acknowledged(RED_RED, self._limits.red_red):
            self._hindrance = 'The kart sees a stop too late.'
            raise not_stopped(self._hindrance)

    async def _race(self) -> None:
        if await self._drive('race'):
            self._phase('race/red_flag')
            self._wire.order(RED_FLAG)
            if await self._acknowledged(RED_FLAG, self._limits.red_flag):
                await self._look_at_wheels()
                await self._must_stand('race/stays')
                await self._must_stand('race/flag_green', GREEN_GREEN)
        await self._stop('race/red')
        await self._must_stand('race/after', IN_GARAGE)
        await self._is_read()

    async def _red(self) -> None:
        if await self._drive('red'):
            await self._stop('red/red')
            await self._look_at_wheels()
        await self._stop('red/end')

    async def _flag_red(self) -> None:
        if await self._drive('flag_red'):
            self._phase('flag_red/red')
            section = self._trace.now
            self._wire.order(RED_FLAG)

            def slower() -> bool:
                speeds = [speed for _, speed in section.speeds]
                return bool(speeds) and speeds[-1] < FLAG_BRAKES * max(speeds)

            await self._until(slower, FLAG_ALONE if self._seen else FLAG_ALONE / 3)
            self._wire.order(RED_RED)
            await self._acknowledged(RED_RED, self._limits.red_red)
            await self._look_at_wheels()
        await self._stop('flag_red/end')

    async def _early(self) -> None:
        if await self._grid('early'):
            await self._announce('early')
            self._phase('early/green')
            self._wire.order(GREEN_GREEN)
            await self._pass(EARLY_STOP)
            self._phase('early/red')
            self._wire.order(RED_RED)
            await self._comes_to_stand(self._limits.red_red)
            await self._pass(2 * self._limits.slack)  # its wheels are watched
        await self._stop('early/end')

    async def _lose(
        self, step: str, lose: Callable[[KartWire], None], silent: bool, back: bool
    ) -> None:
        """Have a kart that drives lose race control, and find it again with GREEN_GREEN."""
        limits = self._limits
        if await self._drive(step):
            self._phase(f'{step}/lost')
            newest = self._wire.newest
            if not silent:
                self._wire.send(NOTHING)  # to a new connection, for now
            lose(self._wire)
            section = self._trace.now
            stands = await self._comes_to_stand(
                (limits.silence if silent else 0.0) + limits.red_red
            )
            if silent:  # also where nobody looks: there is a silence to be noticed
                due = section.began + limits.silence + limits.slack
                await self._pass(max(due - self._recording.now, 0.0))
            else:
                back = await self._until(lambda: self._wire.newest > newest, limits.reconnect)
                if step == 'fin':
                    self._phase('fin/quiet')
                    await self._pass(limits.silence * SHORT_SILENCE)
            # GREEN_GREEN is for no kart that still moves.
            if back and stands and await self._connected():
                await self._must_stand(f'{step}/back', GREEN_GREEN)
        await self._stop(f'{step}/red')

    async def _cut(self) -> None:
        if await self._drive('cut'):
            self._phase('cut/lost')
            self._wire.reset()
            self._wire.order(RED_RED)
            if await self._connected() and await self._acknowledged(RED_RED, self._limits.red_red):
                await self._look_at_wheels()
        await self._stop('cut/red')

    async def _restart(self) -> None:
        limits = self._limits
        if await self._drive('restart'):
            self._phase('restart/lost')
            self._wire.go_away()
            stands = await self._comes_to_stand(limits.red_red)
            await self._must_stand('restart/away', seconds=limits.away)
            self._phase('restart/back')
            self._wire.order(GREEN_GREEN if stands else RED_RED)
            await self._wire.come_back()
            if await self._connected():
                await self._watch(limits.watch)
                await self._ask(STANDS)
        await self._stop('restart/red')

    async def _half_open(self) -> None:
        await self._stop('half_open/red')
        self._phase('half_open/lost')
        self._wire.fall_silent()
        newest = self._wire.newest
        await self._until(lambda: self._wire.newest > newest, self._limits.reconnect)
        await self._stop('half_open/end')

    async def _bridge(self) -> None:
        if await self._drive('bridge'):
            await self._kill('bridge')
        await self._stop('bridge/red')

    async def _stack(self) -> None:
        self._speechless = await self._drive('stack') and await self._kill('stack')
        if not self._speechless:
            await self._stop('stack/red')

    async def _kill(self, part: str) -> bool:
        """Kill a part of the program of a kart that drives; return whether it was killed."""
        limits = self._limits
        self._phase(f'{part}/kill')
        section = self._trace.now
        killing = asyncio.ensure_future(self._kills[part]())
        try:
            await self._until(
                lambda: killing.done() or section.of(Kind.CLOSED), limits.connect + limits.answer
            )
            ends = part == 'bridge'  # its connection, in this moment or never
            if ends and await self._until(lambda: section.of(Kind.CLOSED), limits.slack):
                self._wire.send(NOTHING)  # to a new connection, for now
            done = await killing
        finally:
            killing.cancel()
        if not done:
            return False
        self._recording.note(Kind.KILLED, text=part)
        if not await self._comes_to_stand(limits.silence + limits.red_red):
            silent = self._recording.now - section.speeds[-1][0] if section.speeds else 0.0
            if silent <= limits.slack or not await self._look(STANDS):
                self._inspector.tell('\a  !  THE WHEELS ARE NOT SEEN TO STAND. USE THE MSR.')
        return True

    # ----- the end --------------------------------------------------------------------------

    async def _end(self) -> None:
        """Send RED_RED for some seconds, and say whether the kart stands."""
        self._phase('end/red')
        self._wire.send_now(encode(RED_RED))
        self._wire.order(RED_RED)
        self._wire.keep_beating()
        if self._wire.newest == 0:
            return
        try:
            await self._wire.come_back()
        except OSError as error:
            self._inspector.tell(f'  !  The port is gone: {error}')
        await self._pass(self._limits.hold)
        if self._speechless:
            self._inspector.tell('  What drives the kart was killed. LOOK WHETHER IT STANDS.')
        elif not self._trace.acknowledged(RED_RED):
            self._inspector.tell('\a  !  THE KART HAS NOT SAID THAT IT STANDS. USE THE MSR.')
        else:
            self._inspector.tell('  RED_RED was sent last, and the kart says that it stands.')
