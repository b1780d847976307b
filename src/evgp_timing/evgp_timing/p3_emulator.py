# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
An emulator of a MYLAPS P3 decoder, for trying out timing without hardware and for tests.

The emulator follows the public descriptions, so it cannot prove that they are right.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import random
import socket
import sys
import time

from evgp_timing import p3

STATUS_RECORD = p3.P3.encode(p3.Kind.STATUS, [(0x01, b'\x28\0'), (0x07, b'\x16\0')])
"""A sign of life, with noise and temperature."""

STATUS_PERIOD = 4.0
"""Time between two signs of life, in seconds."""


def passing(number: int, transponder: int, time_us: int) -> bytes:
    """Return the record of a passing, whose time is in microseconds since 1970."""
    fields = (
        (p3.Field.NUMBER, number, 4),
        (p3.Field.TRANSPONDER, transponder, 4),
        (p3.Field.RTC_TIME, time_us, 8),
        (p3.Field.STRENGTH, 120, 2),
        (p3.Field.HITS, 30, 2),
    )
    return p3.P3.encode(
        p3.Kind.PASSING, [(name, value.to_bytes(size, 'little')) for name, value, size in fields]
    )


async def serve(server: socket.socket, transponders: list[int], lap: float) -> None:
    """
    Simulate laps until the process ends, and send the passings to every connected program.

    :param server: the listening socket.
    :param transponders: number of each kart's transponder.
    :param lap: mean lap time, in seconds.
    """
    listeners: set[asyncio.StreamWriter] = set()
    numbers, chance = itertools.count(1), random.Random()  # noqa: S311 - lap times

    async def listen(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        listeners.add(writer)
        with contextlib.suppress(OSError):
            await reader.read()  # until the program disconnects
        listeners.remove(writer)
        writer.close()

    def send(data: bytes) -> None:
        for each in listeners:
            each.write(data)

    async def signs() -> None:
        while True:
            send(STATUS_RECORD)
            await asyncio.sleep(STATUS_PERIOD)

    async def kart(place: int, transponder: int) -> None:
        await asyncio.sleep(0.5 * place)
        while True:
            send(passing(next(numbers), transponder, time.time_ns() // 1000))
            await asyncio.sleep(lap * chance.uniform(0.9, 1.1))

    await asyncio.start_server(listen, sock=server)
    await asyncio.gather(signs(), *itertools.starmap(kart, enumerate(transponders, 1)))


def main(args: list[str] | None = None) -> int:
    """Run the emulator until Ctrl-C."""
    parser = argparse.ArgumentParser(description='A MYLAPS P3 decoder without hardware.')
    parser.add_argument('--port', type=int, default=p3.PORT, help='port to listen on; 0 for any')
    parser.add_argument('--transponders', type=int, nargs='+', default=[1001, 1002])
    parser.add_argument('--lap', type=float, default=20.0, help='mean lap time, s')
    given = parser.parse_args(args)
    with socket.create_server(('127.0.0.1', given.port)) as server:
        host, port = server.getsockname()
        print(f'A P3 decoder listens at {host}:{port}', flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(serve(server, given.transponders, given.lap))
    return 0


if __name__ == '__main__':
    sys.exit(main())
