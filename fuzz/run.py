# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Fuzz the decoders and the roster loader, guided by coverage (Atheris): ``make fuzz``.

    make fuzz                                   each target for a minute
    make fuzz ARGS='--seconds 600 decoder'      one target, for longer
    make fuzz ARGS='--runs 20000 --seed 1'      a fixed number of executions

Each target starts with its committed corpus. New inputs go to ``.fuzz/<target>``, where the next
run starts. An input that breaks a promise is saved as ``.fuzz/<target>-...``, and the exit code is
not 0. When you have fixed the fault, add that input to the corpus: every test run uses it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
HERE = ROOT / 'fuzz'
FOUND = ROOT / '.fuzz'
NAMES = ('decoder', 'roster', 'timing')


def fuzz(name: str, options: list[str]) -> None:
    """Fuzz one target in this process, which libFuzzer ends."""
    # The package's tests contain recordings of devices.
    sys.path.append(str(ROOT / 'src' / 'evgp_timing' / 'test'))
    # Imported here, so that only the fuzzing process is instrumented.
    import atheris

    with atheris.instrument_imports(
        include=['evgp_protocol.frames', 'evgp_node.roster', 'evgp_timing', 'yaml'],
        enable_loader_override=False,
    ):
        import fuzz_targets
    atheris.Setup([sys.argv[0], *options], fuzz_targets.TARGETS[name])
    atheris.Fuzz()


def main() -> None:
    """Fuzz the given targets one after the other, each in its own process."""
    parser = argparse.ArgumentParser(description='Fuzz the decoders and the roster loader.')
    # Not as choices, because argparse would require the default list to be one of them.
    parser.add_argument('target', nargs='*', help=f'{" or ".join(NAMES)}; default: all')
    parser.add_argument('--seconds', type=int, default=60, help='duration per target, s (60)')
    parser.add_argument('--runs', type=int, help='executions per target, not a duration')
    parser.add_argument('--seed', type=int, default=0, help='of the fuzzer; 0: a new one')
    parser.add_argument('--found', type=pathlib.Path, default=FOUND, help='folder for findings')
    arguments = parser.parse_args()
    if unknown := {*arguments.target} - {*NAMES}:
        parser.error(f'unknown: {", ".join(sorted(unknown))}')
    limit = f'-max_total_time={arguments.seconds}'
    if arguments.runs is not None:
        limit = f'-runs={arguments.runs}'
    failed = []
    for name in arguments.target or NAMES:
        found = arguments.found / name
        found.mkdir(parents=True, exist_ok=True)
        options = [
            limit,
            f'-seed={arguments.seed}',
            f'-dict={HERE / name}.dict',
            f'-artifact_prefix={found}-',
            *('-timeout=10', '-rss_limit_mb=2048', '-max_len=4096'),
            *('-verbosity=0', '-print_final_stats=1'),
            *(str(found), str(HERE / 'corpus' / name)),
        ]
        print(f'=== {name}', flush=True)
        process = multiprocessing.get_context('spawn').Process(target=fuzz, args=(name, options))
        process.start()
        process.join()
        if process.exitcode:
            failed.append(name)
    if failed:
        sys.exit(f'Faults found in: {", ".join(failed)}. The inputs are in {arguments.found}')


if __name__ == '__main__':
    main()
