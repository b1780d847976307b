# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Measure how fast a stop reaches every kart, and compare it with a floor from the same run.

``make bench`` prints the first table of docs/dev/performance.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
import contextlib
import gc
import multiprocessing
from multiprocessing.connection import Connection
import os
import pathlib
import platform
import random
import signal
import statistics
import tempfile
import time

from evgp_protocol.states import RaceState
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl
import parties
from std_srvs.srv import Trigger

RED_RED, IN_GARAGE = RaceState.RED_RED, RaceState.IN_GARAGE

SPAWN = multiprocessing.get_context('spawn')


@contextlib.contextmanager
def party(acts: Callable[..., None], *arguments: object) -> Iterator[Connection]:
    """Run a function of parties.py in a process of its own, and provide the connection to it."""
    here, there = SPAWN.Pipe()
    process = SPAWN.Process(target=acts, args=(there, *arguments))
    process.start()
    there.close()  # so that an end of the process ends the connection
    try:
        yield here
    finally:
        process.kill()
        process.join()


@contextlib.contextmanager
def racing(folder: pathlib.Path, count: int) -> Iterator[tuple[RaceControl, Official, Connection]]:
    """Run race control, an official, and this number of karts."""
    own = pathlib.Path(tempfile.mkdtemp(dir=folder))
    with (
        Domain() as domain,
        RaceControl(own, domain.number, range(1, count + 1)) as control,
        Official(domain.number) as official,
        party(parties.crowd, control.port, count, True) as crowd,
    ):
        assert crowd.recv() == 'ready'
        official.wait_for_race(
            lambda race: all(kart.connected for kart in race.karts), 'every kart connected'
        )
        yield control, official, crowd


def spread(seconds: Sequence[float]) -> str:
    """Return median and 99th percentile, ms."""
    ordered = sorted(seconds)
    return f'{ms(statistics.median(ordered))} / {ms(ordered[int(len(ordered) * 0.99)])}'


def ms(seconds: float) -> str:
    return f'{seconds * 1e3:.2f}'


def table(title: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table in Markdown, each row as soon as it is measured."""
    print(f'\n### {title}\n')
    print('| ' + ' | '.join(head) + ' |')
    print('|' + '---|' * len(head), flush=True)
    for row in rows:
        print('| ' + ' | '.join(map(str, row)) + ' |', flush=True)


def stop_latency(folder: pathlib.Path, counts: Sequence[int], times: int) -> None:
    """Measure the time from a stop until the last of N karts reads it."""
    call = bare_call(times)
    table(
        f'Stop latency, ms, median / p99 of {times}',
        (
            'karts',
            'floor',
            'bare service call',
            'whole path',
            '÷ (call + floor)',
            'call → answer',
            'as all acknowledge IN_GARAGE',
        ),
        (stop_latency_of(folder, count, times, call) for count in counts),
    )


def stop_latency_of(
    folder: pathlib.Path, count: int, times: int, call: Sequence[float]
) -> tuple[object, ...]:
    """Return the row for one number of karts."""
    bare = floor_latency(count, times)
    whole, answered = whole_latency(folder, count, times)
    behind, _ = whole_latency(folder, count, times, at_rest=False)
    median = statistics.median
    return (
        count,
        spread(bare),
        spread(call),
        spread(whole),
        f'{median(whole) / (median(call) + median(bare)):.2f}',
        spread(answered),
        spread(behind),
    )


def floor_latency(count: int, times: int) -> list[float]:
    """Return the times of a bare loop, s."""
    with (
        party(parties.floor, count) as writer,
        party(parties.crowd, writer.recv(), count, False) as crowd,
    ):
        assert crowd.recv() == 'ready'
        assert writer.recv() == 'ready'
        return [
            timed(crowd, state, lambda state=state: (writer.send(state), writer.recv())[1])
            for state in (IN_GARAGE, RED_RED) * times
        ][1::2]


def rest() -> None:
    """Wait at least as long as an official would, at a random point of the beat."""
    time.sleep(random.uniform(0.1, 0.2))  # noqa: S311 - no secret


def timed(
    crowd: Connection, state: RaceState, send: Callable[[], float], at_rest: bool = True
) -> float:
    """Return the time from sending a state until the last kart saw it, s."""
    crowd.send(state)
    if at_rest:
        rest()
    else:
        time.sleep(0.01)  # the crowd gets the word before the frames
    began = send()
    read: float = crowd.recv()
    return read - began


def whole_latency(
    folder: pathlib.Path, count: int, times: int, at_rest: bool = True
) -> tuple[list[float], list[float]]:
    """
    Return the times from a client's call to the last kart, and to its answer, s.

    :param at_rest: False: the stop comes while race control reports acknowledgements from all
        karts.
    """
    answered = []

    def kill() -> float:
        began = time.monotonic()
        assert official.call('all_kill').success
        answered.append(time.monotonic() - began)
        return began

    with racing(folder, count) as (_, official, crowd):
        seen = []
        for _ in range(times + 1):
            seen.append(timed(crowd, RED_RED, kill, at_rest))
            bring_home(official, crowd, at_rest)
        # In a client's first call, DDS still makes the connection.
        return seen[1:], answered[1:]


def bring_home(official: Official, crowd: Connection, acknowledged: bool) -> None:
    """Give IN_GARAGE as soon as it is allowed, and wait until all karts have it."""
    crowd.send(IN_GARAGE)
    while not official.call('in_garage', track_safe=True).success:
        time.sleep(0.02)  # refused while acknowledgements are missing
    crowd.recv()
    if acknowledged:
        official.wait_for_race(
            lambda race: all(kart.acknowledged for kart in race.karts), 'every acknowledgement'
        )


def bare_call(times: int) -> list[float]:
    """Return the times of a bare service call between two processes, s."""
    with (
        Domain() as domain,
        party(parties.service, domain.number) as other,
        Official(domain.number) as official,
    ):
        assert other.recv() == 'ready'
        client = official.node.create_client(Trigger, '/bare')
        result = []
        for _ in range(times + 10):
            began = time.monotonic()
            official.request(client, Trigger.Request())
            result.append(time.monotonic() - began)
            rest()
        return result[10:]


def main() -> None:
    """Measure for the given numbers of karts."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    parser = argparse.ArgumentParser(prog='bench/performance.py', description=__doc__)
    parser.add_argument('--karts', type=int, nargs='+', default=[1, 10, 20, 100])
    parser.add_argument('--times', type=int, default=50, help='repetitions of each latency')
    given = parser.parse_args()
    print(
        f'{time.strftime("%Y-%m-%d")}, {os.cpu_count()} cores, Python '
        f'{platform.python_version()}, Linux {platform.release()}'
    )
    # Garbage collection here would add 20 ms to an official's stop, which is not race control's.
    gc.collect()
    gc.freeze()
    with tempfile.TemporaryDirectory() as folder:
        stop_latency(pathlib.Path(folder), given.karts, given.times)


if __name__ == '__main__':
    main()
