# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Commands to our race control, by its services.

The only module here that needs ROS and our packages; it is imported where they are asked for.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
import contextlib
import importlib
import threading
from typing import Any

from evgp_inspection.drivers import Act, Reply

ANSWER = 10.0
"""Maximum time to wait for race control or its answer, s."""

OFFICIAL = 'inspect_rcs'


class SpinningNode:
    """A node in a context of its own, with a thread that serves it."""

    def __init__(self, name: str) -> None:
        """Join the graph."""
        rclpy: Any = importlib.import_module('rclpy')
        executors: Any = importlib.import_module('rclpy.executors')
        signals: Any = importlib.import_module('rclpy.signals')
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=signals.SignalHandlerOptions.NO)
        self.node = rclpy.create_node(name, context=self._context)
        self._executor = executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        ended = executors.ExternalShutdownException

        def spin() -> None:
            with contextlib.suppress(ended):
                self._executor.spin()

        self._thread = threading.Thread(target=spin, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._thread.join(5.0)
        self.node.destroy_node()
        self._context.try_shutdown()


class RosDriver:
    """A client of our race control's services, on the officials' graph."""

    exact = True

    def __init__(self) -> None:
        """Join the graph."""
        qos: Any = importlib.import_module('rclpy.qos')
        messages: Any = importlib.import_module('evgp_rcs_msgs.msg')
        catalogue: Any = importlib.import_module('evgp_rcs.catalogue')
        graph: Any = importlib.import_module('evgp_node.graph')
        self._catalogue = catalogue
        self._messages = messages
        graph.bind_graph()
        self._side = SpinningNode(OFFICIAL)
        self._node = self._side.node
        self._clients: dict[str, tuple[Any, Any]] = {}
        self._race: Any = None
        latched = qos.QoSProfile(
            depth=1,
            reliability=qos.ReliabilityPolicy.RELIABLE,
            durability=qos.DurabilityPolicy.TRANSIENT_LOCAL,
        )
        self._node.create_subscription(messages.Race, 'rcs/race', self._hear, latched)
        # All of them now: to load a service later would hold up the karts that are played.
        for kind in (*(act.name for act in Act), 'JOIN_RACE', 'LEAVE_RACE', 'CLOSE_TRACK'):
            self._connect(catalogue.CATALOGUE[catalogue.CommandKind[kind]])
        self.close = self._side.close

    async def prepare(self, in_race: tuple[int, ...], outside: tuple[int, ...]) -> str:
        """Put these karts into the race, and every other kart out of it."""
        if not await self._until(lambda: self._race is not None):
            return 'Race control is not to be heard on rcs/race.'
        known = {each.number for each in self._race.karts}
        missing = {*in_race, *outside} - known
        if missing:
            return f'Race control has no kart {min(missing)} in its roster.'
        await self._call('CLOSE_TRACK', 0, lambda: None)  # it may be open since an earlier run
        for kart in self._race.karts:
            wanted = kart.number in in_race
            if kart.in_race is not wanted:
                kind = 'JOIN_RACE' if wanted else 'LEAVE_RACE'
                reply = await self._call(kind, kart.number, lambda: None)
                if not reply.accepted:
                    return reply.why
        if not await self._until(
            lambda: {each.number for each in self._race.karts if each.in_race} == set(in_race)
        ):
            return 'The karts of the race are others than were asked for.'
        return ''

    async def give(self, act: Act, kart: int, given: Callable[[], None]) -> Reply:
        """Call the service, with the statement and the karts that an official would name."""
        return await self._call(act.name, kart, given)

    async def start_again(self) -> bool:
        """Return False: nobody is there to do it."""
        return False

    def _hear(self, race: Any) -> None:
        self._race = race

    async def _until(self, found: Callable[[], bool]) -> bool:
        deadline = asyncio.get_running_loop().time() + ANSWER
        while not found():
            if asyncio.get_running_loop().time() > deadline:
                return False
            await asyncio.sleep(0.02)
        return True

    async def _call(self, kind: str, kart: int, given: Callable[[], None]) -> Reply:
        command = self._catalogue.CommandKind[kind]
        entry = self._catalogue.CATALOGUE[command]
        service, client = self._clients[entry.service]
        if not await self._until(client.service_is_ready):
            return Reply(False, f'Race control does not offer rcs/{entry.service}.')
        request = service.Request(official=OFFICIAL, **entry.fixed)
        # No statement for a record that fails: GREEN_GREEN must not need it.
        if entry.statement and command is not self._catalogue.CommandKind.GREEN_GREEN:
            setattr(request, entry.statement, True)
        if entry.to_one_kart:
            request.kart = kart
        if entry.names_hold and self._race is not None:
            request.hold = next(each.hold for each in self._race.karts if each.number == kart)
        if entry.names_karts:
            request.karts = self._seen(getattr(self._messages.CommandAvailability, kind))
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[Any] = loop.create_future()

        def take(future: Any) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
                loop.call_soon_threadsafe(settle, future.result())

        def settle(response: Any) -> None:
            if not answered.done():
                answered.set_result(response)

        given()
        client.call_async(request).add_done_callback(take)
        try:
            response = await asyncio.wait_for(answered, ANSWER)
        except (TimeoutError, asyncio.TimeoutError):
            return Reply(False, f'No answer in {ANSWER:g} s.')
        return Reply(response.success, response.message)

    def _connect(self, entry: Any) -> None:
        """Become a client of the service of a command of the catalogue."""
        package, _, name = entry.service_type.split('/')
        service = getattr(importlib.import_module(f'{package}.srv'), name)
        if entry.service not in self._clients:
            client = self._node.create_client(service, f'rcs/{entry.service}')
            self._clients[entry.service] = (service, client)

    def _seen(self, command: int) -> list[int]:
        """Return the karts that race control offers a command for; where it does not, the race."""
        race = self._race
        if race is None:
            return []
        for each in race.commands:
            if each.command == command and each.available:
                return list(each.karts)
        return sorted(kart.number for kart in race.karts if kart.in_race)
