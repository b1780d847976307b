# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The script of `inspect_kart`, which plays race control for one kart and records everything.

The script judges nothing, because `evgp_inspection.oracle` does that meanwhile. The script watches
the oracle only to continue once there is nothing more to see, and to stop the kart at once when it
does something forbidden.

The kart is never left driving. Whatever ends the inspection, the script first sends RED_RED for
some seconds, and then tells the inspector whether the kart has reported a standstill. It does not
let a kart drive again that does not acknowledge RED_RED or is late to see it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection, Iterator, Mapping
import dataclasses
import math
import random
from typing import NamedTuple, TypeAlias

from evgp_inspection.inspector import Inspector
from evgp_inspection.kart_wire import (
    after,
    between,
    KartWire,
    late_halves,
    MALFORMED,
    many_in_a_piece,
    NOTHING,
    nothing_but_malformed,
    single_bytes,
    TRIES,
    whole,
)
from evgp_inspection.limits import Limits
from evgp_inspection.oracle import Law, STANDS, TURNS
from evgp_inspection.recording import EndedError, Recording
from evgp_inspection.traces import Kind
from evgp_protocol.frames import encode
from evgp_protocol.hearing import QUIET
from evgp_protocol.link import BEAT_RATE
from evgp_protocol.states import RaceState

IN_GARAGE, GRID_ACTIVE = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_FLAG, RED_RED = RaceState.RED_FLAG, RaceState.RED_RED

RANDOM_STOPS = (
    *('red', 'flag', 'lose:closed', 'brake lose:closed', 'silence:silent', 'red', 'red', 'flag'),
)
"""The stops of the step `random`, whose order depends on the seed."""

PIECES = {'bytes': single_bytes, 'many': many_in_a_piece, 'late': late_halves, 'slow': whole}
"""The form in which each of these steps sends RED_RED, ten times a second."""

KILLING_STEPS = ('bridge', 'stack')
"""The last steps, in which a part of the kart's program is killed."""

Kill: TypeAlias = Callable[[], Awaitable[bool]]
"""Kills a part of the kart's program; returns whether that worked."""

KILL_PART = {
    'bridge': "Kill (kill -9) the kart's program that is connected to race control. Is it dead?",
    'stack': "Kill (kill -9) the kart's program that commands the motors. Is it dead?",
}
"""Requests to the inspector to kill a part of the kart's program while the kart drives."""


class Step(NamedTuple):
    """A step, with its description for people and its acts (see `KartScript`)."""

    done: str
    acts: tuple[str, ...]

    @property
    def drives(self) -> bool:
        return any(act.startswith(DRIVING_ACTS) for act in self.acts)


_TABLE = """
connect | connect garage stay:watch | Nothing is sent for a moment, then IN_GARAGE.
first | red | RED_RED is sent to a kart that stands.
alone | garage green stop garage grid garage green | GREEN_GREEN is sent after IN_GARAGE: before
    any GRID_ACTIVE, then after an acknowledged one.
bytes | garage pieces | RED_RED is sent byte by byte.
many | garage pieces | RED_RED is sent in pieces of five frames, cut inside a frame.
late | garage pieces | RED_RED is sent in halves, 0.07 s apart.
slow | garage pieces | RED_RED is sent 10 times a second.
again | garage grid red green garage | GRID_ACTIVE is acknowledged once more; then RED_RED is sent,
    then GREEN_GREEN.
glued | garage glued | GRID_ACTIVE and GREEN_GREEN are sent in one piece.
backlog | backlog | IN_GARAGE is sent 100 times a second, then 400 frames at once, then
    RED_RED.
malformed | garage grid stay:watch malformed | After an acknowledged GRID_ACTIVE, malformed frames
    that look like GREEN_GREEN are sent between correct ones; then RED_RED.
race | DRIVE flag stay:dwell green red stay:dwell garage stay:dwell | A drive; RED_FLAG for some
    time, GREEN_GREEN, RED_RED for some time, IN_GARAGE for some time.
red | garage grid drive:drive:100 red | A drive with 100 frames a second; RED_RED.
flag_red | DRIVE brake red | A drive; RED_RED while RED_FLAG brakes.
flag_lost | DRIVE brake lose:closed | A drive; the connection is closed while RED_FLAG brakes.
flag_silence | DRIVE brake silence:silent | A drive; nothing is sent for a while, while RED_FLAG
    brakes.
flag_green | DRIVE brake green_again | A drive; GREEN_GREEN while RED_FLAG brakes.
red_lost | DRIVE brake:RED_RED lose:closed | A drive; the connection is closed while RED_RED
    brakes.
early | garage grid start:0.15 red | RED_RED is sent 0.15 s after GREEN_GREEN.
early_flag | garage grid start:0.15 flag | RED_FLAG is sent 0.15 s after GREEN_GREEN.
silence | DRIVE silence:silent green | A drive; nothing is sent for a while, then GREEN_GREEN.
noise | DRIVE silence:malformed | A drive; only malformed frames are sent.
fin | DRIVE lose:closed quiet green | A drive; the connection is closed (FIN). On the next one,
    nothing is sent for a moment, then GREEN_GREEN, then RED_RED.
reset | DRIVE lose:reset green | A drive; the connection is reset (RST), then GREEN_GREEN.
half | DRIVE lose:half-closed green | A drive; race control closes its half, then GREEN_GREEN.
cut | DRIVE cut | A drive; a reset, and RED_RED on the next connection.
rolling | DRIVE reset_to_garage | A drive; a reset, and IN_GARAGE on the next connection.
grid | garage grid silence:silent green | After an acknowledged GRID_ACTIVE, nothing is sent for a
    while, then GREEN_GREEN.
restart | DRIVE away back | A drive; race control goes away, refuses connections, comes back with
    GREEN_GREEN.
random | at_random | Eight drives, stopped in every way at random times after GREEN_GREEN.
long | garage grid drive:long:20 red | A drive of a minute with 20 frames a second; RED_RED.
half_open | red half_open | Nothing is sent to a kart that stands.
dwell | dwells garage grid close green | Each state is sent for some time to a kart that stands,
    and then its connection is closed; after GRID_ACTIVE, GREEN_GREEN follows.
red_green | DRIVE brake:RED_RED green_again garage | A drive; GREEN_GREEN while RED_RED brakes.
bridge | DRIVE kill stay:dwell back | A drive; the program that is connected to race control is
    killed. It can connect again only after some time, and is then sent GREEN_GREEN.
stack | DRIVE kill stay:dwell | A drive; the program that commands the motors is killed, and
    GREEN_GREEN is sent for some time.
"""
"""The name, acts and description of each step. DRIVE replaces the acts that begin every drive.
After `red_green`, a kart that does not stand may have no way to acknowledge RED_RED again."""


def _steps() -> Iterator[tuple[str, Step]]:
    for row in (
        _TABLE.strip().replace('\n    ', ' ').replace('DRIVE', 'garage grid drive').split('\n')
    ):
        name, acts, done = row.split(' | ')
        yield name, Step(done, tuple(acts.split()))


STEPS: Mapping[str, Step] = dict(_steps())
"""The steps of an inspection, in order."""

DRIVING_ACTS = ('drive', 'start', 'at_random')

RACE_STEPS = ('connect', 'race')
"""The steps of a race only."""


@dataclasses.dataclass
class KartScript:
    """
    Runs the steps in order.

    An act is a method of this class, with its arguments after colons. It returns False if the rest
    of its step makes no sense.

    :ivar seen: whether odometry is expected.
    :ivar kills: functions that kill parts of the kart's program, by the names of
        `KILLING_STEPS`; a step without a function is skipped.
    """

    recording: Recording
    wire: KartWire
    inspector: Inspector
    limits: Limits
    seen: bool
    kills: Mapping[str, Kill]
    _step: str = ''
    _hindrance: str = ''  # why the kart is not made to drive any more
    _speechless: bool = False  # the program that acknowledges was killed

    def __post_init__(self) -> None:
        self._oracle, self._trace = self.recording.oracle, self.recording.trace
        self._until = self.recording.until

    async def run(self, wanted: Collection[str]) -> str:
        """
        Run the steps, then stop the kart.

        :param wanted: the names of the steps to do; `connect` is always done.
        :return: a sentence that says why the kart was not made to drive; empty if it was.
        :raises EndedError: if the kart did not connect or did not stop.
        """
        try:
            for name, step in STEPS.items():
                undone = name not in wanted and name != 'connect'
                if undone or (self._hindrance and step.drives):
                    continue
                if name in KILLING_STEPS and name not in self.kills:
                    continue
                self.inspector.tell(f'{self.recording.now:6.1f}  {name}: {step.done}')
                random_step = step.acts == ('at_random',)
                for acts in self._at_random() if random_step else [step.acts]:
                    await self._do(name, acts)
        except asyncio.CancelledError:
            self.inspector.tell('\a  !  STOPPED. Sending RED_RED to the kart.')
            raise
        finally:
            await self._end()
        return f'{self._hindrance} It was not made to drive.' if self._hindrance else ''

    async def _do(self, name: str, acts: tuple[str, ...]) -> None:
        """Do the acts of a step, but end it as soon as the kart moves when it must not."""
        self._step = name
        # The step's name tells the oracle how frames are sent, but at first they go out as usual.
        before = 'before ' if {'pieces', 'malformed', 'backlog'} & {*acts} else ''
        self.recording.note(Kind.STEP, text=before + name)
        moves = self._oracle.moves
        for act in acts:
            method, *arguments = act.split(':')
            done = await getattr(self, f'_{method}')(*arguments)
            if done is False or self._oracle.moves > moves:
                break
        if not self._speechless and name != 'connect':
            await self._stop()

    def _at_random(self) -> Iterator[tuple[str, ...]]:
        """Yield the acts of the step `random`, one stop in each part of the range of times."""
        chance = random.Random(self.limits.seed)  # noqa: S311 - no secret
        stops = chance.sample(RANDOM_STOPS, len(RANDOM_STOPS))
        first, last = 0.1, 2.0  # s from GREEN_GREEN to the stop
        part = (last - first) / len(stops)
        for place, stop in enumerate(stops):
            delay = first + part * (place + chance.random())
            yield ('garage', 'grid', f'start:{delay}', *stop.split())

    # ----- what the acts are made of --------------------------------------------------------

    async def _pass(self, seconds: float) -> None:
        """Let time pass while everything is recorded."""
        await self._until(lambda: None, seconds)

    async def _stay(self, limit: str, least: float = 0.0) -> bool:
        """Watch a kart that must not drive and ask the inspector; return False once it drives."""
        moves, seconds = self._oracle.moves, max(getattr(self.limits, limit), least)
        if await self._until(lambda: self._oracle.moves > moves, seconds):
            return False
        await self._ask(STANDS)
        return True

    async def _ask(self, question: str) -> bool | None:
        """Ask the inspector to look, unless there is odometry; return the answer, if any."""
        return None if self.seen else await self._look(question)

    async def _look(self, question: str) -> bool | None:
        answer = await self.inspector.ask(f'Do {question}?', self.limits.answer)
        value = math.nan if answer is None else float(answer)
        self.recording.note(Kind.ANSWER, text=question, value=value)
        return answer

    async def _acknowledged(self, state: RaceState, seconds: float) -> bool:
        """Return whether the kart acknowledges in time the state that it is being sent."""
        return await self._until(lambda: self._trace.acknowledged(state), seconds)

    async def _connected(self) -> bool:
        """Return whether the kart is connected, after waiting for it if necessary."""
        return await self._until(lambda: self.wire.connected, self.limits.reconnect)

    async def _stop(self) -> None:
        """
        Bring the kart to a standstill.

        :raises EndedError: if the kart does not connect or acknowledge RED_RED in time.
        """
        limits = self.limits
        self.wire.order(RED_RED)
        await self.wire.come_back()
        if not await self._connected():
            raise self._not_stopped(
                f'The kart has not connected again for {limits.reconnect:g} s.'
            )
        if not await self._acknowledged(RED_RED, limits.red_red):
            raise self._not_stopped(
                f'The kart has not acknowledged RED_RED within {limits.red_red:g} s.'
            )

    def _not_stopped(self, why: str) -> EndedError:
        """Warn that the kart did not acknowledge a stop; return what ends the inspection."""
        self.inspector.tell(f'\a  !  {why} If its wheels turn, USE THE MSR.')
        return EndedError(f'{why} The inspection ended there. Use the MSR.')

    async def _see_it_stand(self, seconds: float) -> bool:
        """
        Wait until the wheels stand still, but no longer than this, or ask if there is no odometry.

        :return: False if the wheels were seen to keep turning.
        """
        if not self.seen:
            return await self._look(STANDS) is not False
        return await self._until(lambda: self._oracle.still > 2 and self._oracle.stands, seconds)

    async def _announce(self) -> None:
        self.inspector.tell(f'\a  !  THE KART DRIVES NOW ({self._step}).')
        await self._pass(self.limits.warning)

    # ----- acts: to a kart that stands ----------------------------------------------------------

    async def _connect(self) -> None:
        limits = self.limits
        if not await self._until(lambda: self.wire.connected, limits.connect):
            raise EndedError(f'No kart connected within {limits.connect:g} s.')
        if self.seen:
            # The first odometry may take a while, and until it comes, nothing sees the wheels.
            await self._until(lambda: self._oracle.spell.speeds, 5.0)
            await self._until(lambda: self.wire.connected, limits.connect)
        await self._quiet()

    async def _quiet(self) -> None:
        short = 0.4 * self.limits.silence  # too short to count as silence
        said = len(self._trace.said)
        await self._until(lambda: len(self._trace.said) > said, short)

    async def _garage(self, seconds: float = 0.2, rate: float = BEAT_RATE) -> None:
        self.wire.order(IN_GARAGE, rate=rate)
        await self._pass(seconds)
        # Wait until a standing kart has read this, which it shows by a report or by its silence.
        # After that, no report can answer an earlier order (docs/wire.md).
        await self._until(lambda: self._trace.reached, QUIET + self.limits.red_red)

    async def _green(self) -> bool:
        """Send a GREEN_GREEN that the kart must not obey."""
        if not await self._connected():
            return False
        self.wire.order(GREEN_GREEN)
        return await self._stay('watch')

    async def _green_again(self) -> bool:
        """Send GREEN_GREEN to a braking kart, which must continue to brake."""
        self.wire.order(GREEN_GREEN)
        return await self._see_it_stand(self.limits.red_flag)

    async def _pieces(self) -> None:
        self.recording.note(Kind.STEP, text=self._step)
        self.wire.order(RED_RED, PIECES[self._step], rate=10.0)
        await self._acknowledged(RED_RED, self.limits.red_red)
        # A kart that takes slow frames for silence needs time to show it.
        longer = self.limits.watch if self._step == 'slow' else 0.0
        await self._pass(self.limits.slack + longer)
        self.recording.note(Kind.STEP, text=f'after {self._step}')

    async def _malformed(self) -> bool:
        self.recording.note(Kind.STEP, text=self._step)
        self.wire.order(GRID_ACTIVE, between, rate=2 * BEAT_RATE)  # half of them with a frame
        return await self._stay('watch', TRIES * len(MALFORMED) / BEAT_RATE)

    async def _glued(self) -> bool:
        self.wire.order(GREEN_GREEN, lambda state: after(encode(GRID_ACTIVE), state))
        return await self._stay('watch')

    async def _backlog(self) -> None:
        await self._garage(self.limits.fast, 100.0)
        self.recording.note(Kind.STEP, text=self._step)
        self.wire.order(RED_RED, lambda state: after(encode(IN_GARAGE) * 400, state))
        if not await self._acknowledged(RED_RED, self.limits.red_red):
            self._hindrance = 'The kart saw a stop too late.'
            raise self._not_stopped(self._hindrance)

    async def _half_open(self) -> None:
        self._fall_silent('silent')
        newest = self.wire.newest
        await self._until(lambda: self.wire.newest > newest, self.limits.reconnect)

    async def _dwells(self) -> bool:
        for state in (RED_RED, IN_GARAGE, GRID_ACTIVE, RED_FLAG):
            self.wire.order(state)
            if not (await self._stay('dwell') and await self._close()):
                return False
        return True

    async def _close(self) -> bool:
        """Close the connection of a standing kart."""
        self.wire.end('closed')
        await self._pass(self.limits.slack)
        return await self._connected()

    # ----- acts: drives -------------------------------------------------------------------------

    async def _grid(self) -> bool:
        self.wire.order(GRID_ACTIVE)
        ready = await self._acknowledged(GRID_ACTIVE, self.limits.grid)
        if not ready:
            self._hindrance = 'The kart has not acknowledged GRID_ACTIVE.'
        return ready

    async def _drive(self, limit: str = 'drive', rate: str = f'{BEAT_RATE}') -> bool:
        """
        Make the kart drive; return whether it does.

        :param limit: the name of the limit for how long.
        :param rate: frames per second. A kart that reads too slowly while it drives is late by
            the time of the stop.
        """
        limits = self.limits
        await self._announce()
        self.wire.order(GREEN_GREEN, rate=float(rate))
        began = self.recording.now
        if not await self._acknowledged(GREEN_GREEN, limits.green):
            self._hindrance = 'The kart has not acknowledged GREEN_GREEN.'
        elif self.seen:
            left = max(began + limits.green - self.recording.now, 0.0)
            await self._until(lambda: self._oracle.still == 0, left)
        if self._step == 'race':
            await self._ask(TURNS)
        await self._pass(getattr(limits, limit))
        return not self._hindrance or self._oracle.still == 0

    async def _start(self, seconds: str) -> None:
        await self._announce()
        self.wire.order(GREEN_GREEN)
        await self._pass(float(seconds))

    async def _red(self) -> None:
        await self._stop()
        await self._pass(2 * self.limits.slack)
        await self._ask(STANDS)

    async def _flag(self) -> bool:
        self.wire.order(RED_FLAG)
        said = await self._acknowledged(RED_FLAG, self.limits.red_flag)
        await self._pass(2 * self.limits.slack)
        await self._ask(STANDS)
        return said

    async def _brake(self, state: str = 'RED_FLAG') -> None:
        """Let a red slow the kart to 80 % of its speed, for at most 1 s, or 0.3 s if unseen."""
        self.wire.order(RaceState(state))

        def slower() -> bool:
            spell = self._oracle.spell
            if spell.law not in (Law.FLAG, Law.RED) or not spell.speeds:
                return False
            return spell.speeds[-1][1] < 0.8 * spell.top

        await self._until(slower, 1.0 if self.seen else 1 / 3)

    async def _lose(self, how: str) -> bool:
        """Make the kart lose race control and wait until it stands and has reconnected."""
        newest = self.wire.newest
        self.wire.send(NOTHING)  # not even on a new connection
        self.wire.end(how)
        stands = await self._see_it_stand(self.limits.red_red)
        back = await self._until(lambda: self.wire.newest > newest, self.limits.reconnect)
        return stands and back

    def _fall_silent(self, how: str) -> None:
        """Send nothing from now on (`silent`), or only malformed bytes (`malformed`)."""
        self.recording.note(Kind.SILENT, text=how)
        self.wire.send(NOTHING if how == 'silent' else nothing_but_malformed())

    async def _silence(self, how: str) -> bool:
        limits, began = self.limits, self.recording.now
        self._fall_silent(how)
        stands = await self._see_it_stand(limits.silence + limits.red_red)
        # Even if nobody looks, the silence must last long enough to be noticed.
        await self._pass(max(began + limits.silence + limits.slack - self.recording.now, 0.0))
        return stands

    async def _cut(self) -> None:
        self.wire.end('reset')
        await self._red()

    async def _reset_to_garage(self) -> bool:
        self.wire.end('reset')
        self.wire.order(IN_GARAGE)
        return await self._see_it_stand(self.limits.red_red + self.limits.slack)

    async def _away(self) -> bool:
        self.wire.go_away()
        stands = await self._see_it_stand(self.limits.red_red)
        return await self._stay('away') and stands

    async def _back(self) -> bool:
        self.wire.order(GREEN_GREEN)
        await self.wire.come_back()
        return await self._green()

    async def _kill(self) -> bool:
        """Kill a part of a driving kart's program; return whether it was killed."""
        limits, part = self.limits, self._step
        killing = asyncio.ensure_future(self.kills[part]())
        newest = self.wire.newest

        def ended() -> bool:
            return part == 'bridge' and not self.wire.connected

        try:
            await self._until(lambda: killing.done() or ended(), limits.connect + limits.answer)
            # The connection ends now or never.
            if part == 'bridge' and await self._until(ended, limits.slack):
                self.wire.go_away()  # until it is known what the kart does without its bridge
            done = await killing
        finally:
            killing.cancel()
        if not done:
            return False
        if part == 'stack' or self.wire.newest == newest:
            self.recording.note(Kind.KILLED, text=part)
        self._speechless = part == 'stack'
        if not await self._see_it_stand(limits.silence + limits.red_red):
            speeds = self._oracle.spell.speeds
            silent = self.recording.now - speeds[-1][0] if speeds else math.inf
            if silent <= limits.slack or not await self._look(STANDS):
                self.inspector.tell('\a  !  THE WHEELS ARE NOT SEEN TO STAND. USE THE MSR.')
        return True

    # ----- the end --------------------------------------------------------------------------

    async def _end(self) -> None:
        """Send RED_RED for some seconds, then tell the inspector whether the kart stands."""
        self.recording.note(Kind.STEP, text='end')
        self.wire.send_now(encode(RED_RED))
        self.wire.order(RED_RED)
        self.wire.keep_beating()
        if self.wire.newest == 0:
            return
        try:
            await self.wire.come_back()
        except OSError as error:
            self.inspector.tell(f'  !  The port is gone: {error}')
        await self._pass(self.limits.hold)
        if self._speechless:
            self.inspector.tell('  The driving program was killed. CHECK THAT THE KART STANDS.')
        elif not self._trace.acknowledged(RED_RED):
            self.inspector.tell('\a  !  THE KART HAS NOT REPORTED A STANDSTILL. USE THE MSR.')
        else:
            self.inspector.tell('  RED_RED was sent last, and the kart reports a standstill.')
