# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What `survey_network` says of networks that lose, delay and narrow; ``--help`` says how.

    setup/in-workspace python bench/bad_networks.py

The survey and a kart are machines with networks of their own, and a relay between them is told
what to do to every packet, each way. It prints a table in Markdown.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import pathlib
import sys
import tempfile

from evgp_testing.process import Program

ROOT = pathlib.Path(__file__).parents[1]
sys.path.append(str(ROOT / 'test'))
from rig.networks import kart_address, NetworkError, RACE_CONTROL, Track  # noqa: E402

AIRS: dict[str, dict[str, float]] = {
    'nothing': {},
    '5 % lost': {'loss': 0.05},
    '20 % lost': {'loss': 0.2},
    '40 % lost': {'loss': 0.4},
    '20 ms': {'delay': 0.02},
    '200 ms': {'delay': 0.2},
    '800 ms': {'delay': 0.8},
    '20 kbit/s': {'rate': 20_000},
    '20 ms, 5 % lost': {'loss': 0.05, 'delay': 0.02},
}
"""What is set, each way."""

AT_ONCE = 3


def survey(airs: list[str], seconds: float) -> list[str]:
    """Survey these networks at the same time; return the rows of the table."""
    reports = {}
    with contextlib.ExitStack() as parts:
        for air in airs:
            track = parts.enter_context(Track())
            office = track.machine('office', RACE_CONTROL)
            kart = track.machine('kart', kart_address(7))
            kart.air(**AIRS[air])
            folder = pathlib.Path(parts.enter_context(tempfile.TemporaryDirectory()))
            command = [sys.executable, str(ROOT / 'src/evgp_inspection'), 'survey']
            with office.inside():
                words = ['--word', 'ready', '--seconds', f'{seconds + 5}', '--report', str(folder)]
                program = parts.enter_context(Program(air, [*command, *words]))
            program.wait_for_line('on port')
            with kart.inside():
                example = [sys.executable, str(ROOT / 'kit/python/example.py'), RACE_CONTROL]
                parts.callback(Program('kart', example).kill)
            reports[air] = folder, program
        for _, program in reports.values():
            program.process.wait()
        return [row(air, folder) for air, (folder, _) in reports.items()]


def row(air: str, folder: pathlib.Path) -> str:
    """Return what the report of a survey says."""
    (path,) = folder.glob('*.json')
    report = json.loads(path.read_text(encoding='utf-8'))
    if not report['karts']:
        return f'| {air} | no kart connected | | | | {report["verdict"]} |'
    (kart,) = report['karts'].values()
    cells = [air]
    for figure in kart['figures'][:4]:
        value = figure['value']
        text = '-' if value is None else f'{value:.3f} s' if figure['unit'] else f'{value}'
        cells.append(f'**{text}**' if figure['verdict'] == 'fail' else text)
    return f'| {" | ".join(cells)} | {report["verdict"]} |'


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=120.0, help='for each (%(default)s)')
    options = parser.parse_args()
    print('| set | round trip, 99th percentile | longest silence | sent again | lost | verdict |')
    print('|---|---|---|---|---|---|')
    try:
        left = iter(AIRS)
        while airs := list(itertools.islice(left, AT_ONCE)):
            print('\n'.join(survey(airs, options.seconds)), flush=True)
    except NetworkError as error:
        sys.exit(str(error))


if __name__ == '__main__':
    main()
