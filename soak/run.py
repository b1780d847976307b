# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Soak race control with random faults, acknowledgements and commands; see ``--help``.

    make soak ARGS='--seconds 600 --karts 100'
"""

from __future__ import annotations

import argparse
import contextlib
import pathlib
import random
import secrets
import sys
import tempfile
import time

from evgp_rcs.record.replay import Replay
from evgp_rcs.record.runs import open_runs
from evgp_testing.domains import Domain
from evgp_testing.race_control import address_of, RaceControl
from evgp_testing.usage import resident
from evgp_testing.witness import Witness
from race_soak.fleet import Fleet
from race_soak.officials import Officials

STRANGERS = tuple(f'127.0.9.{number}' for number in range(1, 9))
REPORT_EVERY = 30.0


def main(arguments: list[str] | None = None) -> int:
    """Soak race control; return 0 if all was as its record has it, else 1."""
    parser = argparse.ArgumentParser(
        description='Soak a real race control with random faults, acknowledgements and commands.'
    )
    parser.add_argument('--seconds', type=float, default=600.0, help='duration, s (600)')
    parser.add_argument('--karts', type=int, default=100, help='their number, at most 250 (100)')
    parser.add_argument('--seed', type=int, help='random seed (default: a new one)')
    parser.add_argument(
        '--fault-every', type=float, default=4.0, help="mean time between a kart's faults, s (4)"
    )
    options = parser.parse_args(arguments)
    if not 1 <= options.karts <= 250:
        parser.error('--karts must be 1 to 250')
    seed = secrets.randbelow(1_000_000) if options.seed is None else options.seed
    print(f'seed {seed}, {options.karts} karts, {options.seconds:g} s', flush=True)
    with contextlib.ExitStack() as stack:
        return _soak(stack, options, random.Random(seed))


def _soak(stack: contextlib.ExitStack, options: argparse.Namespace, rng: random.Random) -> int:
    numbers = list(range(1, options.karts + 1))
    in_race = set(rng.sample(numbers, min(10, len(numbers))))
    folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
    domain = stack.enter_context(Domain())
    control = stack.enter_context(
        RaceControl(
            folder,
            domain.number,
            in_race,
            set(numbers) - in_race,
            {'finish_delays': '[0.5, 0.3, 0.1]', 'finish_stop': 2.0, 'settle_time': 0.5},
        )
    )
    witness = Witness()
    fleet = Fleet(
        control.port,
        {number: address_of(number) for number in numbers},
        STRANGERS,
        witness,
        random.Random(rng.random()),
        options.fault_every,
    )
    officials = stack.enter_context(
        Officials(domain.number, numbers, witness, random.Random(rng.random()), fleet.disciplined)
    )
    fleet.start()
    began = time.monotonic()
    reported = began
    memory_at_start = resident(control.pid) / 1024
    trouble = ''
    try:
        while time.monotonic() - began < options.seconds and not trouble:
            officials.step()
            if fleet.failure is not None:
                raise fleet.failure
            if time.monotonic() - reported > REPORT_EVERY:
                reported = time.monotonic()
                print(
                    f'{reported - began:6.0f} s  {witness.frames} frames, '
                    f'{sum(fleet.faults.values())} faults, {officials.calls} commands, '
                    f'{officials.greens} races started, {resident(control.pid) / 1024:.1f} MiB',
                    flush=True,
                )
    except AssertionError as error:
        trouble = '\n'.join([f'race control does not answer: {error}', *control.lines[-15:]])
    elapsed = time.monotonic() - began
    memory_at_end = 0.0 if trouble else resident(control.pid) / 1024
    fleet.stop()
    if fleet.failure is not None:
        raise fleet.failure
    control.close()
    began_replay = time.monotonic()
    with open_runs(folder / 'record.sqlite3') as runs:
        replay = Replay(runs.read(runs.choose(None)))
    violations = witness.compare(replay)
    replay_took = time.monotonic() - began_replay

    print(f'\n{elapsed:.0f} s of {options.karts} karts')
    print(f'frames sent to karts   {witness.frames}')
    print(f'frames said by karts   {sum(len(link.said) for link in witness.links)}')
    faults = ', '.join(f'{name} {count}' for name, count in sorted(fleet.faults.items()))
    print(f'faults injected        {sum(fleet.faults.values())}: {faults}')
    print(f'commands               {officials.calls}, {officials.accepted} of them accepted')
    print(f'races planned, started {officials.races}, {officials.greens}')
    print(f'connections            {len(witness.links)}')
    print(f'memory of rcs_node     {memory_at_start:.1f} MiB, then {memory_at_end:.1f} MiB')
    differs = replay.lacks or 'no difference'
    print(f'replay                 {replay}; {differs}; {replay_took:.1f} s')
    print(f'violations             {len(violations)}')
    for violation in violations[:50]:
        print(f'  {violation}')
    if trouble:
        print(trouble)
    return 1 if violations or trouble else 0


if __name__ == '__main__':
    sys.exit(main())
