# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What the inspection of a race control does, step by step; it does not judge.

Each phase of a step is named in the trace, `step/phase`, and `evgp_inspection.rcs_judges` knows
the names. A step that race control has left (it started a race that it must not, say) ends there:
the rest is not judged, and the next step begins in IN_GARAGE again.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from evgp_inspection.drivers import Driver, Press
from evgp_inspection.limits import RcsLimits
from evgp_inspection.rcs_karts import PlayedKart, PlayedKarts
from evgp_inspection.recording import EndedError, Recording
from evgp_inspection.traces import Kind
from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState

IN_GARAGE, GRID_ACTIVE = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE
GREEN_GREEN, RED_FLAG, RED_RED = RaceState.GREEN_GREEN, RaceState.RED_FLAG, RaceState.RED_RED

ALL = frozenset(RaceState)
NOTHING: frozenset[RaceState] = frozenset()


class LeftError(Exception):
    """Race control is not where this step needs it to be."""


class RcsSteps:
    """
    Plays the karts, and has the commands given.

    :param step_done: is told the name of each step that is done.
    :param steps: the names of the steps to be done.
    """

    def __init__(
        self,
        recording: Recording,
        field: PlayedKarts,
        driver: Driver,
        limits: RcsLimits,
        step_done: Callable[[str], None],
        steps: Sequence[str],
    ) -> None:
        self._recording = recording
        self._driver = driver
        self._limits = limits
        self._step_done = step_done
        self._steps = steps
        self._field = field
        self._all = tuple(field.karts)
        self._one, self._two, self._out = self._all
        self._racing = (self._one, self._two)
        self._step = ''

    async def run(self) -> str:
        """
        Do the steps, and return nothing to remark.

        :raises EndedError: race control cannot be brought to IN_GARAGE.
        """
        for step in self._steps:
            self._step = step
            try:
                if self._field.count == 0:
                    await self._connect_first()
                await self._to_the_garage()
                await getattr(self, f'_{step}')()
            except LeftError:
                pass
            self._step_done(step)
        await self._to_the_garage()
        return ''

    # ----- the steps ----------------------------------------------------------------------

    async def _connect_first(self) -> None:
        """
        Connect every kart for the first time that counts.

        Race control may begin in RED_RED, until an official says that the track is safe. Then it
        is brought to IN_GARAGE, and every kart connects again.
        """
        await self._connect_all('first', self._all)
        if self._field.count and any(kart.sent is RED_RED for kart in self._all):
            await self._to_the_garage()
            for kart in self._all:
                kart.end()
            await asyncio.sleep(self._limits.away)
            await self._connect_all('first', self._all)

    async def _connect_all(self, phase: str, karts: Sequence[PlayedKart]) -> None:
        self._phase(phase)
        for kart in karts:
            await kart.connect()
        await self._wait(lambda: all(kart.sent for kart in karts), self._limits.connect)

    async def _connect(self) -> None:
        self._phase('stranger')
        stranger = self._field.stranger
        await stranger.connect()
        await self._wait(
            lambda: stranger.link is None or not stranger.link.open, self._limits.slack
        )
        stranger.end()
        await self._refused('green', Press.GREEN_GREEN)
        self._phase('second')
        first = self._one.link
        await self._one.connect()
        await self._wait(
            lambda: self._one.sent and (first is None or not first.open), self._limits.slack
        )
        if first is not None:
            first.end()
        await self._back('back', self._two)

    async def _grid(self) -> None:
        self._answer(NOTHING)
        self._phase('before')
        self._one.write(encode(GRID_ACTIVE))
        await self._order()
        await self._refused('silent', Press.GREEN_GREEN)
        self._two.answers = ALL
        await self._arrive()
        await self._refused('early', Press.GREEN_GREEN)

    async def _halves(self) -> None:
        self._answer(NOTHING)
        self._phase('before')
        self._one.write(b'$GRID_')
        await self._order()
        self._one.write(b'ACTIVE;')
        self._two.answers = ALL
        await self._arrive()
        await self._refused('green', Press.GREEN_GREEN)

    async def _last(self) -> None:
        self._answer(ALL)
        await self._order()
        await self._arrive()
        await self._reach('stop', Press.KART_RED_RED, RED_RED, self._out)
        await asyncio.sleep(self._limits.settle)
        await self._refused('green', Press.GREEN_GREEN)

    async def _lost(self) -> None:
        self._answer(ALL)
        await self._order()
        await self._arrive()
        self._one.answers = NOTHING
        self._one.end()
        await asyncio.sleep(self._limits.away)
        await self._refused('green', Press.GREEN_GREEN)
        await self._back('returned', self._one)
        await self._refused('back', Press.GREEN_GREEN)

    async def _race(self) -> None:
        await self._start()
        await self._refused('grid_again', Press.GRID_ACTIVE)
        await self._refused('garage_in_race', Press.IN_GARAGE)
        self._answer(NOTHING)
        await self._reach('finish_one', Press.KART_FINISH, RED_FLAG, self._one)
        await self._reach('finish_two', Press.KART_FINISH, RED_FLAG, self._two)
        await self._reach('over', Press.RACE_OVER, RED_RED, *self._racing)
        self._two.answers = ALL
        await asyncio.sleep(self._limits.settle)
        await self._refused('unacknowledged', Press.IN_GARAGE)
        self._one.answers = ALL
        await self._arrive()
        await self._reach('released', Press.IN_GARAGE, IN_GARAGE, *self._racing)

    async def _again(self) -> None:
        self._answer(NOTHING)
        await self._order()
        await self._refused('silent', Press.GREEN_GREEN)
        await self._green()
        await self._reach('one', Press.KART_RED_RED, RED_RED, self._one, more=True)
        await self._back('back', self._two, reset=True)

    async def _flag(self) -> None:
        await self._start()
        await self._reach('flag', Press.RED_FLAG, RED_FLAG, *self._racing)
        await self._back('back', self._one)

    async def _held(self) -> None:
        await self._start()
        await self._reach('one', Press.KART_RED_RED, RED_RED, self._one)
        await self._reach('flag', Press.RED_FLAG, RED_FLAG, self._two, more=True)

    async def _stop(self) -> None:
        await self._start()
        await self._reach('all_kill', Press.ALL_KILL, RED_RED, *self._all)
        await self._refused('flag', Press.RED_FLAG)
        await self._back('back', self._one)
        await asyncio.sleep(self._limits.settle)
        await self._refused('grid', Press.GRID_ACTIVE)
        await self._refused('green', Press.GREEN_GREEN)

    async def _vanish(self) -> None:
        await self._start()
        self._phase('lost')
        link = self._one.link
        assert link is not None
        # What it said must have arrived: otherwise TCP would be late to say more, in the end.
        self._one.answers = NOTHING
        await asyncio.sleep(0.1)
        link.vanish()
        await asyncio.sleep(self._limits.half_open)
        link.appear()
        noticed = await self._wait(lambda: not link.open, self._limits.slack)
        link.end()
        if not noticed:
            raise LeftError
        await self._back('back', self._one)

    async def _absent(self) -> None:
        absent = (self._one, self._out)
        for kart in absent:
            kart.end()
        await asyncio.sleep(self._limits.away)
        await self._reach('all_kill', Press.ALL_KILL, RED_RED, self._two)
        await self._connect_all('back', absent)
        await asyncio.sleep(self._limits.watch)

    # ----- what they consist of -----------------------------------------------------------

    def _answer(self, states: frozenset[RaceState]) -> None:
        """Have the karts of the race acknowledge these states from now on."""
        self._one.answers = self._two.answers = states

    async def _arrive(self) -> None:
        """Let what the karts say arrive."""
        await asyncio.sleep(self._limits.watch / 2)

    async def _order(self) -> None:
        await self._arrive()  # what was said before it
        await self._reach('order', Press.GRID_ACTIVE, GRID_ACTIVE, *self._racing)

    async def _start(self) -> None:
        """Start a race."""
        self._answer(ALL)
        await self._reach('order', Press.GRID_ACTIVE, GRID_ACTIVE, *self._racing)
        await self._green()

    async def _green(self) -> None:
        self._answer(ALL)
        await self._arrive()
        await self._reach('started', Press.GREEN_GREEN, GREEN_GREEN, *self._racing)

    async def _to_the_garage(self) -> None:
        """Bring race control to IN_GARAGE with every kart connected."""
        self._phase('garage')
        while not await self._all_in_the_garage():
            if not await self._driver.start_again():
                raise EndedError('Race control cannot be brought to IN_GARAGE.')
        why = await self._driver.prepare(
            tuple(kart.number for kart in self._racing), (self._out.number,)
        )
        if why:
            raise EndedError(why)

    async def _all_in_the_garage(self) -> bool:
        """Connect every kart, and have it sent IN_GARAGE; return whether it is."""
        for kart in self._all:
            kart.answers = ALL
            if kart.sent is None:
                await asyncio.sleep(self._limits.away)
                await kart.connect()
        await self._wait(lambda: all(kart.sent for kart in self._all), self._limits.connect)
        if self._all_are(IN_GARAGE, self._all)():
            return True
        await self._give(Press.ALL_KILL)
        await self._wait(self._all_are(RED_RED, self._all), self._limits.reach)
        await asyncio.sleep(self._limits.settle)
        await self._insist(Press.IN_GARAGE, IN_GARAGE, self._racing)
        if self._out.sent is RED_RED:  # it was stopped alone, and is released alone
            await self._insist(Press.KART_IN_GARAGE, IN_GARAGE, (self._out,))
        return await self._wait(self._all_are(IN_GARAGE, self._all), self._limits.reach)

    async def _reach(
        self, phase: str, act: Press, state: RaceState, *karts: PlayedKart, more: bool = False
    ) -> None:
        """
        Give a command that must be possible, until these karts are sent a state.

        :param more: watch what follows.
        """
        self._phase(phase)
        if not await self._insist(act, state, karts):
            raise LeftError
        if more:
            await asyncio.sleep(self._limits.watch)

    async def _insist(self, act: Press, state: RaceState, karts: Sequence[PlayedKart]) -> bool:
        """Give a command, again where it is refused; return whether it has come."""
        loop = asyncio.get_running_loop()
        deadline = loop.time() + self._limits.insist
        seconds = self._limits.finish if act is Press.KART_FINISH else self._limits.reach
        reached = self._all_are(state, karts)
        while True:
            accepted = await self._give(act, karts[0].number if act.to_one_kart else 0)
            if accepted or reached():
                return await self._wait(reached, seconds)
            if loop.time() > deadline or act is Press.ALL_KILL:
                return await self._wait(reached, self._limits.reach)
            # A refusal may be for a time: until a kart has stood long enough, for example.
            await asyncio.sleep(0.2 if self._driver.exact else self._limits.settle)

    async def _refused(self, phase: str, act: Press) -> None:
        """Give a command that must change nothing, and watch."""
        before = [kart.sent for kart in self._all]
        self._phase(phase)
        await self._give(act)
        await asyncio.sleep(self._limits.watch)
        if [kart.sent for kart in self._all] != before:
            raise LeftError

    async def _back(self, phase: str, kart: PlayedKart, reset: bool = False) -> None:
        """Have a kart lose its connection, if it has one, and come back; watch."""
        kart.end(reset)
        await asyncio.sleep(self._limits.away)
        self._phase(phase)
        await kart.connect()
        await self._wait(lambda: kart.sent, self._limits.connect)
        await asyncio.sleep(self._limits.watch)

    async def _give(self, act: Press, kart: int = 0) -> bool:
        text = f'{act.name} {kart}' if kart else act.name

        def given() -> None:
            self._recording.note(Kind.COMMAND, text=text, value=float(self._driver.exact))

        accepted, said = await self._driver.give(act, kart, given)
        self._recording.note(Kind.ANSWERED, text=said, value=float(accepted))
        return accepted

    def _all_are(self, state: RaceState, karts: Sequence[PlayedKart]) -> Callable[[], bool]:
        return lambda: all(kart.sent is state for kart in karts)

    async def _wait(self, found: Callable[[], object], seconds: float) -> bool:
        return await self._recording.until(found, seconds)

    def _phase(self, name: str) -> None:
        self._recording.note(Kind.STEP, text=f'{self._step}/{name}')
