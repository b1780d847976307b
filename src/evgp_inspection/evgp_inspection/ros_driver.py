# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Commands to our race control, by its services.

The only module here that needs our other packages; it is imported where it is asked for.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
import importlib
import os
from typing import Any

from evgp_inspection.drivers import Press, Reply

ANSWER = 10.0
"""Maximum time to wait for race control or its answer, s."""


class RosDriver:
    """An official of our race control, on the graph of this shell's ROS domain."""

    exact = True

    def __init__(self) -> None:
        """Join the graph."""
        self._catalogue: Any = importlib.import_module('evgp_rcs.rules.catalogue')
        self._messages: Any = importlib.import_module('evgp_rcs_msgs.msg')
        testing: Any = importlib.import_module('evgp_testing.official')
        domain = int(os.environ.get('ROS_DOMAIN_ID') or 0)
        self._official = testing.Official(domain, 'inspect_rcs', hears=['race'])
        self._official.timeout = ANSWER
        self.close = self._official.close

    async def prepare(self, in_race: tuple[int, ...], outside: tuple[int, ...]) -> str:
        """Put these karts into the race, and every other kart out of it."""
        try:
            return await asyncio.to_thread(self._prepare, in_race, outside)
        except AssertionError as error:
            return f'Race control: {error}'

    def _prepare(self, in_race: tuple[int, ...], outside: tuple[int, ...]) -> str:
        official = self._official
        race = official.wait_for_race(lambda race: True, 'a message on rcs/race')
        missing = {*in_race, *outside} - {each.number for each in race.karts}
        if missing:
            return f'Race control has no kart {min(missing)} in its roster.'
        official.call('set_track_open', open=False)  # it may be open since an earlier run
        for kart in race.karts:
            wanted = kart.number in in_race
            if kart.in_race is not wanted:
                answer = official.call('set_in_race', kart=kart.number, in_race=wanted)
                if not answer.success:
                    return str(answer.message)
        official.wait_for_race(lambda race: _racing(race) == sorted(in_race), 'these karts alone')
        return ''

    async def give(self, act: Press, kart: int, given: Callable[[], None]) -> Reply:
        """Call the service, with the statement and the karts that an official would name."""
        entry = self._catalogue.CATALOGUE[self._catalogue.CommandKind[act.name]]
        request = dict(entry.fixed)
        # No statement for a record that fails: GREEN_GREEN must not need it.
        if entry.statement and act is not Press.GREEN_GREEN:
            request[entry.statement] = True
        if entry.to_one_kart:
            request['kart'] = kart
        if entry.names_karts:
            request['karts'] = self._seen(getattr(self._messages.CommandAvailability, act.name))
        given()
        try:
            answer = await asyncio.to_thread(self._official.call, entry.service, **request)
        except AssertionError as error:
            return False, str(error)
        return answer.success, answer.message

    async def start_again(self) -> bool:
        """Return False: nobody is there to do it."""
        return False

    def _seen(self, command: int) -> list[int]:
        """Return the karts that race control offers a command for; where it does not, the race."""
        race = self._official.race
        for each in race.commands if race is not None else ():
            if each.command == command and each.available:
                return list(each.karts)
        return _racing(race) if race is not None else []


def _racing(race: Any) -> list[int]:
    return sorted(kart.number for kart in race.karts if kart.in_race)
