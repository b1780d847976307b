# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The other ends of the measurements: processes that do as little as can be done."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
import time
from typing import Any

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_testing.race_control import address_of


def tell(value: object) -> None:
    """Answer with one line of JSON."""
    print(json.dumps(value), flush=True)


def floor(count: int) -> None:
    """Write a state to every socket in a bare loop, when told to; answer with when it began."""
    with socket.create_server(('127.0.0.1', 0), backlog=4096) as listening:
        tell(listening.getsockname()[1])
        karts = []
        while len(karts) < count:
            kart, _ = listening.accept()
            kart.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            karts.append(kart)
        tell('ready')
        for line in sys.stdin:
            frame = encode(RaceState[line.strip()])
            began = time.monotonic()
            for kart in karts:
                kart.send(frame)
            tell(began)


def rules(count: int) -> None:
    """Run the kart server and the rules without ROS; give commands, and answer with when."""
    from evgp_protocol import clock
    from evgp_rcs.catalogue import CommandKind
    from evgp_rcs.kart_server import KartServer, ServerSettings
    from evgp_rcs.race import Answer, Command, Kart, Race, RaceTimes

    class Outside:
        """No ROS half, and no record."""

        def look(self) -> None:
            """Nothing comes by here."""

        def tell(self, events: object, log: object) -> None:
            """Nobody listens."""

        def show(self, race: object, at: float, number: int) -> None:
            """Nobody looks."""

        def remember(self, memory: object, at: float) -> None:
            """Nothing is kept."""

        def make_sure(self, memory: object, at: float, done: Any) -> None:
            """Nothing is kept."""

        def trouble(self) -> str:
            """Have none."""
            return ''

        def silent_since(self) -> float | None:
            """Expect nobody."""
            return None

    race = Race(
        [Kart(number, f'Team {number}', True) for number in range(1, count + 1)],
        RaceTimes(pause=0.0),
    )
    server = KartServer(
        race,
        {address_of(number): number for number in race.karts},
        ServerSettings(host='127.0.0.1', port=0),
        Outside(),
    )

    def give() -> None:
        line = sys.stdin.readline()
        if not line:
            server.end()
            return
        kind = CommandKind[line.strip()]
        seen = race.availability(kind, 0, clock.now()).karts
        command = Command(kind, statement=True, karts=frozenset(seen))
        began = time.monotonic()
        answers: list[Answer] = []
        server.submit(command, answers.append)
        server.take_commands()
        tell([began, answers[0].success])

    async def serve() -> None:
        asyncio.get_running_loop().add_reader(sys.stdin, give)
        await server.serve(lambda address: tell(address[1]))

    clock.run(serve())


def service(domain: int) -> None:
    """Offer a bare ROS service."""
    import rclpy
    from rclpy.node import Node
    from std_srvs.srv import Trigger

    def serve(_: Any, response: Any) -> Any:
        response.success = True
        return response

    rclpy.init(domain_id=domain)
    node = Node('bare')
    node.create_service(Trigger, '/bare', serve)
    tell('ready')
    rclpy.spin(node)


if __name__ == '__main__':
    {'floor': floor, 'rules': rules, 'service': service}[sys.argv[1]](int(sys.argv[2]))
