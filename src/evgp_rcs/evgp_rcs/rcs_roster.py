# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Prints a roster, or every fault in it: ``rcs_roster check karts.yaml``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import os
import pathlib
import sys

from evgp_node.output import show_what_it_can
from evgp_node.roster import load_roster, Roster, RosterError


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Check a roster: print its karts and heats, or every fault with its line.

    :return: 0 if race control would accept the roster, 2 if not.
    """
    parser = argparse.ArgumentParser(
        prog=os.environ.get('EVGP_CALLED', 'rcs_roster'),
        description='Check the list of karts that race control starts with.',
    )
    commands = parser.add_subparsers(required=True, metavar='check')
    check = commands.add_parser(
        'check', help='print the karts and heats of a roster, or every fault in it'
    )
    check.add_argument('file', type=pathlib.Path, help='the roster, such as karts.yaml')
    path = parser.parse_args(arguments).file
    try:
        roster = load_roster(path)
    except RosterError as error:
        print(error, file=sys.stderr)
        print(error.as_roster, end='')
        return 2
    show_what_it_can()
    print(f'{path} is right:')
    for line in _lines(roster):
        print(f'  {line}')
    return 0


def _lines(roster: Roster) -> list[str]:
    width = max(len(str(entry.number)) for entry in roster.entries)
    team = max(len(entry.team) for entry in roster.entries)
    lines = [
        f'kart {entry.number:{width}}  {entry.team:{team}}  {entry.address:15}  '
        + ('in the first race' if entry.in_race else 'not in the first race')
        + (f', inspected {entry.inspected}' if entry.inspected else '')
        + (f', transponders {", ".join(entry.transponders)}' if entry.transponders else '')
        for entry in roster.entries
    ]
    for heat in roster.heats:
        laps = f', {heat.laps} laps' if heat.laps else ''
        karts = ', '.join(map(str, heat.karts))
        grid = f', grid from {heat.grid_from}' if heat.grid_from else ''
        lines.append(f'heat "{heat.name}": {karts} ({heat.format.value}{laps}{grid})')
    return lines


if __name__ == '__main__':
    sys.exit(main())
