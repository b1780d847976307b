# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""`inspect_rcs` against our rules and kart server, good and with one fault each."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
import dataclasses
import itertools
from types import ModuleType
from typing import Any

from evgp_inspection.drivers import Driver, Human, Press, Reply, START_RACE_CONTROL_AGAIN
from evgp_inspection.inspection import Exit, inspect_race_control, Inspection
from evgp_inspection.inspector import Inspector, Unattended
from evgp_inspection.limits import RcsLimits
from evgp_inspection.rcs_clauses import RCS, RCS_BY_NAME
from evgp_inspection.verdicts import select, Verdict
from evgp_rcs.karts import link as kart_link
from evgp_rcs.karts import server as kart_server
from evgp_rcs.rules import race
from evgp_rcs.rules.catalogue import CommandKind
from inspecting import inspect_all, those
import pytest
from rig.faults import module_with

SHORT = RcsLimits(
    connect=1.0,
    reach=1.0,
    finish=3.0,
    stagger=0.15,
    half_open=1.5,
    watch=0.5,
    settle=0.6,
    away=0.3,
    slack=0.5,
    insist=6.0,
)

TIMES: dict[str, Any] = {'finish_delays': (0.8, 0.4), 'pause': 0.1, 'settle': 0.3}
# So many at once: at 20 Hz they would hold each other up.
SETTINGS: dict[str, Any] = {
    'host': '127.0.0.1',
    'port': 0,
    'beat_rate': 12.0,
    'send_timeout': 0.5,
}


@dataclasses.dataclass
class Flaw:
    """
    A fault of a race control.

    :ivar module: where its source is changed.
    """

    module: ModuleType | None = None
    old: str = ''
    new: str = ''
    times: dict[str, Any] = dataclasses.field(default_factory=dict)
    settings: dict[str, Any] = dataclasses.field(default_factory=dict)


HOLD_OF_THE_LOST = (
    '        if under_way and self.state is not GRID_ACTIVE:\n'
    "            self._hold(kart, RED_RED, f'lost its connection in {self.state.value}', now)\n"
    '        elif kart.may_be_moving:\n'
)

TO_THE_RACE = '        for kart in self.racing():\n            self._redirect(kart, now)\n'


def for_the_first_kart_only(state: str) -> str:
    return (
        '        for kart in self.racing():\n'
        f'            if state is not {state} or kart is next(self.racing()):\n'
        '                self._redirect(kart, now)\n'
    )


COMES_BACK = '        self._redirect(kart, now, anew=True)\n'

FLAWS = {
    'R-3A-01': Flaw(
        race,
        COMES_BACK,
        '        if kart.in_race and self.state is IN_GARAGE:\n'
        "            self._hold(kart, RED_RED, '', now)\n" + COMES_BACK,
    ),
    'R-3B-01': Flaw(
        race,
        "        if missing:\n            return f'waiting for {_cut(missing)}'\n",
        '',
    ),
    'R-3B-02': Flaw(
        race,
        '        kart.acknowledged = False\n        kart.withdrawn = False\n',
        '        kart.acknowledged = state is GRID_ACTIVE and kart.reported is state\n'
        '        kart.withdrawn = False\n',
    ),
    'R-3B-03': Flaw(
        race,
        'if not (each.connected and each.acknowledged)',
        'if each.connected and not each.acknowledged',
    ),
    'R-3B-04': Flaw(
        race,
        COMES_BACK,
        COMES_BACK + '        kart.acknowledged = kart.sent is GRID_ACTIVE\n',
    ),
    'R-3B-05': Flaw(
        race,
        '        for each in self.karts.values():\n'
        '            each.place = 0\n'
        '        self._go(GRID_ACTIVE, now)\n',
        '        raced = [each for each in self.karts.values() if each.place]\n'
        '        for each in raced:\n'
        '            each.place = 0\n'
        '        self._go(GRID_ACTIVE, now)\n'
        '        for each in raced:\n'
        '            each.acknowledged = True\n',
    ),
    'R-3B-06': Flaw(race, TO_THE_RACE, for_the_first_kart_only('GRID_ACTIVE')),
    'R-3B-07': Flaw(race, TO_THE_RACE, for_the_first_kart_only('GREEN_GREEN')),
    'R-3A-03': Flaw(
        race,
        '        self._go(stricter(self.state, RED_FLAG), now)\n',
        '        for each in self.racing():\n'
        '            if self.state is not RED_RED:\n'
        '                self._unhold(each)\n'
        '        self._go(stricter(self.state, RED_FLAG), now)\n',
    ),
    'R-3B-08': Flaw(
        race,
        '        counts = state is kart.sent and serial == kart.serial\n',
        '        counts = state is kart.sent\n',
    ),
    'R-4B-06': Flaw(race, '        if not self.grid_was_last:\n', '        if False:\n'),
    'R-3A-02': Flaw(
        race,
        '        self._go(stricter(self.state, RED_FLAG), now)\n',
        '        for each in self.karts.values():\n'
        '            self._unhold(each)\n'
        '        self._go(RED_FLAG, now)\n',
    ),
    'R-3C-01': Flaw(
        race,
        '                self._hold(kart, RED_FLAG, MARKED_AS_FINISHED, now)\n',
        '                for each in self.racing():\n'
        '                    self._hold(each, RED_FLAG, MARKED_AS_FINISHED, now)\n',
    ),
    'R-3C-02': Flaw(times={'finish_delays': (0.5,)}),
    'R-3C-03': Flaw(
        race,
        '        self.over = True\n        self._go(RED_RED, now)\n        self._tell_results()\n',
        '        self.over = True\n'
        '        self.state = RED_RED\n'
        '        for each in self.racing():\n'
        '            if not each.place:\n'
        '                self._redirect(each, now)\n',
    ),
    'R-3C-05': Flaw(
        race,
        '            if each.sent is not IN_GARAGE\n',
        '            if each.sent is not IN_GARAGE and each.hold_reason != MARKED_AS_FINISHED\n',
    ),
    'R-3E-01': Flaw(
        race,
        HOLD_OF_THE_LOST,
        HOLD_OF_THE_LOST.replace('if under_way', 'if kart.in_race'),
    ),
    'R-3E-02': Flaw(
        race,
        COMES_BACK,
        COMES_BACK + '        if kart.in_race and self.state is GRID_ACTIVE:\n'
        '            self._go(GREEN_GREEN, now, str(kart))\n',
    ),
    'R-3E-05': Flaw(
        race,
        COMES_BACK,
        '        if self.state is RED_RED:\n'
        '            self._unhold(kart)\n'
        '            kart.in_race = False\n' + COMES_BACK,
    ),
    'R-3E-06': Flaw(
        race,
        HOLD_OF_THE_LOST,
        "        if reason == 'its network link stopped answering':\n            return\n"
        + HOLD_OF_THE_LOST,
    ),
    'R-3E-07': Flaw(
        kart_server,
        '        old = self._links.pop(number, None)\n',
        '        kart = self._race.karts[number]\n'
        "        if kart.hold_reason == 'ALL_KILL' and kart.lost_since is None:\n"
        "            link.drop('it was away')\n"
        '            return\n'
        '        old = self._links.pop(number, None)\n',
    ),
    'R-4B-05': Flaw(
        race,
        '            self._hold(each, RED_RED, cause, now)\n',
        '            if each.connected:\n                self._hold(each, RED_RED, cause, now)\n',
    ),
    'R-3C-04': Flaw(
        race,
        "        if not missing:\n            return ''\n        how",
        "        if True:\n            return ''\n        how",
    ),
    'R-3E-04': Flaw(
        race,
        HOLD_OF_THE_LOST,
        HOLD_OF_THE_LOST.replace('is not GRID_ACTIVE', 'not in (GRID_ACTIVE, RED_FLAG)').replace(
            'elif kart.may_be_moving', 'elif self.state is not RED_FLAG and kart.may_be_moving'
        ),
    ),
    'R-3E-03': Flaw(
        race,
        HOLD_OF_THE_LOST,
        HOLD_OF_THE_LOST.replace(
            'is not GRID_ACTIVE', 'not in (GRID_ACTIVE, GREEN_GREEN)'
        ).replace(
            'elif kart.may_be_moving', 'elif self.state is not GREEN_GREEN and kart.may_be_moving'
        ),
    ),
    'R-3F-01': Flaw(
        race,
        '        self._go(stricter(self.state, RED_FLAG), now)\n',
        '        self._go(stricter(self.state, RED_FLAG), now)\n'
        '        for each in self.karts.values():\n'
        "            self._hold(each, RED_FLAG, '', now)\n",
    ),
    'R-4A-01': Flaw(
        kart_server,
        '        old = self._links.pop(number, None)\n',
        '        old = self._links.pop(number, None)\n'
        '        if len(self._links) > 1:\n'
        "            link.drop('there is no room')\n"
        '            return\n',
    ),
    'R-4A-03': Flaw(
        kart_server,
        '        old = self._links.pop(number, None)\n',
        '        if number in self._links:\n'
        "            link.drop('it is connected')\n"
        '            return\n'
        '        old = None\n',
    ),
    'R-4A-02': Flaw(
        kart_server,
        "            link.drop('its address is not in the roster')\n",
        "            link._transport.write(b'$IN_GARAGE;')\n",
    ),
    'R-4B-01': Flaw(
        race,
        'for each in self.karts.values():\n            self._doubt_that',
        'for each in self.racing():\n            self._doubt_that',
    ),
    'R-4B-02': Flaw(race, TO_THE_RACE, for_the_first_kart_only('RED_FLAG')),
    'R-4B-03': Flaw(
        race,
        '        self._hold(kart, hold, reason, now)\n',
        '        for each in self.racing():\n            self._hold(each, hold, reason, now)\n',
    ),
    'R-4B-04': Flaw(
        race,
        '        if self.state is not RED_RED:\n            return f',
        '        if self.state not in (RED_RED, GREEN_GREEN):\n            return f',
    ),
    'R-4C-01': Flaw(settings={'beat_rate': 5.0}),
    'R-4C-02': Flaw(
        kart_link,
        '        if self._answers.may_beat(now) and not self._unsent():\n',
        # Not at the beginning: a short connection would have too few frames as well.
        "        since = now - self.__dict__.setdefault('since', now)\n"
        '        if not self._unsent() and not 2.5 < since % 4 < 3.1:\n',
        settings={'beat_rate': 50.0},
    ),
    'R-4C-03': Flaw(
        kart_link,
        'FRAMES = {state: encode(state) for state in RaceState}',
        "FRAMES = {state: encode(state) + b'x' for state in RaceState}",
    ),
    'R-4D-01': Flaw(settings={'send_timeout': 3600.0}),
}
"""A fault for each clause, which that clause alone must find."""


class OurRaceControl:
    """
    Our rules and kart server in this loop, with a fault or none; and who gives them commands.

    It is the server's ROS half and record itself, and keeps nothing.
    """

    exact = True

    def __init__(self, flaw: Flaw | None, port: int = 0) -> None:
        flaw = flaw or Flaw()
        rules: Any = race
        whole = 'HELD_UP = 1.0', 'HELD_UP = 1.0'
        change = (flaw.old, flaw.new) if flaw.module is kart_server else whole
        served: Any = module_with(kart_server, *change)
        served.pack = lambda message: b''  # what is of no module of Python cannot be packed
        if flaw.module is race:
            rules = module_with(race, flaw.old, flaw.new)
        elif flaw.module is kart_link:
            served.KartLink = module_with(kart_link, flaw.old, flaw.new).KartLink
        self.race = rules.Race(
            [rules.Kart(number, '', number <= 2) for number in (1, 2, 3)],
            rules.RaceTimes(**{**TIMES, **flaw.times}),
        )
        self.server = served.KartServer(
            self.race,
            {f'127.0.1.{number}': number for number in (1, 2, 3)},
            kart_server.ServerSettings(**{**SETTINGS, 'port': port, **flaw.settings}),
            self,
            self,
        )

    async def start(self) -> tuple[str, int]:
        """Let karts connect; return where."""
        listening: asyncio.Future[tuple[str, int]] = asyncio.get_running_loop().create_future()
        self._serving = asyncio.create_task(self.server.serve(listening.set_result))
        return await listening

    async def end(self) -> None:
        self.server.end()
        await self._serving

    async def inspect(self) -> Inspection:
        """Inspect it to the end."""
        where = await self.start()
        try:
            return await inspected(Unattended(lambda line: None), self, where)
        finally:
            await self.end()

    # ----- the driver ---------------------------------------------------------------------

    async def prepare(self, in_race: tuple[int, ...], outside: tuple[int, ...]) -> str:
        return ''

    async def give(self, act: Press, kart: int, given: Callable[[], None]) -> Reply:
        kind = CommandKind[act.name]
        answered: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        offered = self.race.availability(kind, kart, self.server.now())
        karts = offered.karts or tuple(each.number for each in self.race.racing())
        given()
        hold = self.race.karts[kart].hold if kart else None
        command = race.Command(kind, kart, True, frozenset(karts), hold)
        self.server.submit(command, answered.set_result)
        self.server.take_commands()
        answer = await answered
        return answer.success, answer.message

    async def start_again(self) -> bool:
        return False

    def close(self) -> None:
        pass

    # ----- the ROS half and the record ----------------------------------------------------

    gone = ''
    unsent = 1  # so that it is shown nothing

    def receive(self) -> tuple[()]:
        return ()

    def send(self, data: bytes) -> None:
        pass

    def put(self, batch: Any) -> None:
        pass

    def remember(self, memory: Any) -> None:
        pass

    def make_sure(self, memory: Any, within: float, done: Callable[[bool], None]) -> None:
        done(True)

    def trouble(self) -> str:
        return ''


async def inspected(
    inspector: Inspector, driver: Driver, where: tuple[str, int], only: str = ''
) -> Inspection:
    addresses = {number: f'127.0.1.{number}' for number in (1, 2, 3)}
    return await inspect_race_control(
        inspector,
        driver,
        SHORT,
        select(RCS, only),
        asyncio.Event(),
        where,
        addresses,
        '127.0.1.250',
    )


class AtTheScreen:
    """A person at the screen of a race control with a fault, or none, who does what is asked."""

    def __init__(self, flaw: Flaw | None) -> None:
        self.restarts = 0
        self.refused: list[Press] = []
        self._flaw = flaw
        self._control = OurRaceControl(flaw)
        self._where = ('', 0)

    async def inspect(self, only: str = '') -> Inspection:
        self._where = await self._control.start()
        try:
            return await inspected(self, Human(self, 60.0), self._where, only)
        finally:
            await self._control.end()

    def tell(self, line: str) -> None:
        pass

    async def ask(self, question: str, seconds: float) -> bool | None:
        if question == START_RACE_CONTROL_AGAIN:
            self.restarts += 1
            await self._control.end()
            self._control = OurRaceControl(self._flaw, self._where[1])
            await self._control.start()
            return True
        for act, kart in itertools.product(Press, (0, 1, 2, 3)):
            if question.startswith(act.value.format(kart=kart)):
                accepted, _ = await self._control.give(act, kart, lambda: None)
                if not accepted:
                    self.refused.append(act)
                return accepted
        return True  # karts 1 and 2 are in the race from the beginning


def is_found(name: str, inspection: Inspection) -> bool:
    return name in FLAWS and set(those(inspection, Verdict.FAIL)) == {name}


def test_every_clause_of_a_race_control_has_a_fault_that_it_finds() -> None:
    assert sorted(FLAWS) == sorted(RCS_BY_NAME)


@pytest.mark.early
@pytest.mark.timeout(600)
def test_our_race_control_passes_and_each_fault_is_found_by_its_own_clause_and_no_other() -> None:
    names = ['', *FLAWS]
    # All are made first: to compile one holds up those that are inspected already.
    begun = inspect_all(names, lambda name: OurRaceControl(FLAWS.get(name)).inspect, is_found)
    inspections = dict(zip(names, begun, strict=True))
    wrong = {
        name: those(inspection, Verdict.FAIL)
        for name, inspection in inspections.items()
        if name and not is_found(name, inspection)
    }
    assert not wrong
    assert not those(inspections[''], Verdict.FAIL)
    assert not those(inspections[''], Verdict.NOT_JUDGED)
    assert inspections[''].exit_code is Exit.PASSED


def test_a_race_control_that_begins_in_red_red_is_brought_to_in_garage_first() -> None:
    def begin(name: str) -> Callable[[], Awaitable[Inspection]]:
        control = OurRaceControl(None)

        async def stopped_before() -> Inspection:
            where = await control.start()
            await control.give(Press.ALL_KILL, 0, lambda: None)
            try:
                return await inspected(Unattended(lambda line: None), control, where)
            finally:
                await control.end()

        return stopped_before

    (inspection,) = inspect_all([''], begin)
    assert not those(inspection, Verdict.FAIL)
    assert not those(inspection, Verdict.NOT_JUDGED)


@pytest.mark.early
@pytest.mark.timeout(300)
def test_a_person_at_its_screen_can_give_our_race_control_every_command() -> None:
    person = AtTheScreen(None)
    inspection = asyncio.run(person.inspect())
    assert not those(inspection, Verdict.FAIL)
    assert inspection.finished
    assert not person.restarts
    assert {Press.GREEN_GREEN, Press.GRID_ACTIVE, Press.IN_GARAGE} <= set(person.refused)


def test_a_race_control_that_lets_a_kart_in_no_more_is_started_again_by_the_person() -> None:
    people: list[AtTheScreen] = []

    def begin(name: str) -> Callable[[], Awaitable[Inspection]]:
        people.append(AtTheScreen(FLAWS[name]))
        return lambda: people[-1].inspect('R-3E-07')

    (inspection,) = inspect_all(['R-3E-07'], begin)
    assert set(those(inspection, Verdict.FAIL)) == {'R-3E-07'}
    assert inspection.finished
    assert people[-1].restarts == 1
