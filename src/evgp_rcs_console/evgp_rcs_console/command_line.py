# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The command line of `rcs_ctl`: one subcommand per official's command, plus `watch` and `results`.

Officials make each statement with a flag of its own. They name the karts that a command is to
start or release.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import enum
import itertools
import os
import sys
from typing import Any, NamedTuple, NoReturn

from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs_console.catalogue import CATALOGUE, Kind


class Exit(enum.IntEnum):
    """The exit codes, for scripts."""

    ACCEPTED = 0
    REFUSED = 1
    USAGE = 2
    NOT_THERE = 3
    SUPERSEDED = 4


class Told(NamedTuple):
    """How `rcs_ctl` ends: its exit code, and the texts for stdout and stderr."""

    code: Exit
    output: str = ''
    error: str = ''


WAIT = 5.0
"""Default time to wait for race control, in seconds."""

STARTING = 5.0
"""Maximum time that ROS may take to start, before the time of ``--wait`` begins, in seconds."""

GRACE = 0.5
"""Time kept back for reporting that no answer arrived, in seconds."""

COMMANDS: dict[str, Kind] = {
    entry.word or kind.name.lower().replace('_', '-'): kind for kind, entry in CATALOGUE.items()
}
"""The officials' commands, by their names on the command line."""

ALL_KILL = 'all-kill'


def _number(kind: type[float], name: str, most: float) -> Callable[[str], float]:
    """Return a type for argparse, whose error then reads: invalid kart number value: 'x'."""

    def read(text: str) -> float:
        number = kind(text)
        if '_' in text or not 0 <= number <= most:  # Python reads 1_2 as 12
            raise ValueError
        return number

    read.__name__ = name
    return read


_seconds = _number(float, 'number of seconds', 86_400.0)
_kart_number = _number(int, 'kart number', 65535)
_race_number = _number(int, 'race number', 65535)
_count = _number(int, 'whole number', 2**32 - 1)


ARGUMENTS: dict[str, dict[str, Any]] = {
    'heat': {'help': 'name of the heat in the roster'},
    'karts': {
        'type': _kart_number,
        'nargs': '*',
        'help': 'the karts to which the command applies; if omitted, rcs_ctl lists the karts and '
        'sends nothing',
    },
    'reading': {'type': _count, 'help': 'the number that reload-roster printed'},
    'source': {'help': 'source of the passing, as `results` shows it'},
    'session': {'help': 'session of that source'},
    'number': {'type': _count, 'help': 'number of the passing in that session'},
    'transponder': {'help': 'number or name of the transponder, as the timing device reports it'},
    '--seconds': {'type': _count, 'default': 0, 'help': "seconds to add to the kart's time"},
    '--laps': {'type': _count, 'default': 0, 'help': "laps to deduct from the kart's result"},
    '--disqualified': {'action': 'store_true', 'help': 'disqualify the kart'},
    '--reason': {'default': '', 'help': 'the reason, for the record'},
    '--race': {
        'type': _race_number,
        'default': 0,
        'help': 'number of the race in this event (default: the newest race)',
    },
}
"""The argument for each further field of a request (``Entry.takes``), as argparse takes it."""


NOTHING_SENT = 'Nothing was sent.'
NO_STOP_SENT = 'NO STOP WAS SENT. all-kill stops every kart; USE THE MSR if that fails.'


class WrongLineError(Exception):
    """The command line is wrong, which the parser of a command has found."""

    def __init__(self, found_by: Parser, message: str) -> None:
        super().__init__(message)
        self.found_by = found_by


class Parser(argparse.ArgumentParser):
    """Parses a command line."""

    unsent = NO_STOP_SENT
    """The text that says that nothing was sent. It is stronger if a stop may have been meant."""

    def error(self, message: str) -> NoReturn:
        """Raise WrongLineError, so that `parse` can report it."""
        raise WrongLineError(self, message)


def parse(given: Sequence[str]) -> argparse.Namespace:
    """
    Return the parsed command line; exit if it is wrong.

    The command may be in capitals and contain underscores. No other words on the line keep ALL
    KILL from being sent; options that are wrong are then left out.
    """
    own = without_ros_arguments(given)
    command = ''
    for place, (before, word) in enumerate(itertools.pairwise(['', *own])):
        name = word.lower().replace('_', '-')
        if before in ('--official', '--reason', '--wait'):
            continue
        if name == ALL_KILL or (before.lower(), name) == ('all', 'kill'):
            del own[place]
            own.insert(0, ALL_KILL)
            break
        if name in COMMANDS and not command:
            command = own[place] = name
    try:
        wanted, more = parser().parse_known_args(own)
        if more and wanted.command != ALL_KILL:
            wanted.parser.error(f'not understood: {" ".join(more)}')
    except WrongLineError as wrong:
        if own[:1] == [ALL_KILL]:
            return parser().parse_args([ALL_KILL])
        wrong.found_by.print_usage(sys.stderr)
        said = f'{wrong.found_by.prog}: {wrong}\n{wrong.found_by.unsent}\n'
        wrong.found_by.exit(Exit.USAGE, said)
    return wanted


def without_ros_arguments(given: Sequence[str]) -> list[str]:
    """Return a command line without the arguments for ROS, from `--ros-args` to `--`."""
    own = []
    ros = False
    for argument in given:
        if argument == '--ros-args':
            ros = True
        elif ros and argument == '--':
            ros = False
        elif not ros:
            own.append(argument)
    return own


def parser() -> argparse.ArgumentParser:
    whole = Parser(
        prog=os.environ.get('EVGP_CALLED', 'rcs_ctl'),
        description='Direct an EVGP race from the terminal. This is not the MSR.',
        epilog='Exit codes: 0 accepted, 1 refused, 2 wrong usage, 3 race control was not found '
        'or did not answer, or has no timing (results), 4 the stop was too old because another '
        'race had begun. Put ROS arguments after --ros-args.',
    )
    waiting, signing = Parser(add_help=False), Parser(add_help=False)
    # `--wait` and `--official` may come before the command or after it.
    for each in (whole, waiting):
        each.add_argument(
            '--wait',
            type=_seconds,
            default=WAIT if each is whole else argparse.SUPPRESS,
            metavar='SECONDS',
            help=f'how long to wait for race control (default: {WAIT:g}); before that, ROS may '
            f'take up to {STARTING:g} s to start',
        )
    for each in (whole, signing):
        each.add_argument(
            '--official',
            default='' if each is whole else argparse.SUPPRESS,
            metavar='NAME',
            help="the official's name, for the record (default: the saved name)",
        )
    commands = whole.add_subparsers(dest='command', required=True, metavar='command')
    for name, command in COMMANDS.items():
        entry = CATALOGUE[command]
        each = commands.add_parser(
            name, help=entry.meaning, description=entry.meaning, parents=[waiting, signing]
        )
        each.unsent = NO_STOP_SENT if entry.stop else NOTHING_SENT
        each.set_defaults(parser=each)
        if entry.to_one_kart:
            each.add_argument('kart', type=_kart_number, help='number of the kart in the roster')
        for name, how in ARGUMENTS.items():
            # The timekeeper's FINISH names its race. An official's is for the present one.
            if name.removeprefix('--') in entry.takes and command is not CommandKind.KART_FINISH:
                each.add_argument(name, **how)
        if 'opening' in entry.takes:
            each.add_argument(
                '--closes',
                type=_count,
                metavar='NUMBER',
                help='if the track is open: number of the opening that this command closes; '
                'without it, rcs_ctl prints that number and sends nothing',
            )
        if entry.flag is not None:
            flag, statement = entry.flag
            # If race control asks for the statement and the flag is missing, race control refuses,
            # and `rcs_ctl` prints what to type.
            each.add_argument(
                flag,
                dest='stated',
                action='store_true',
                required=entry.call_is_statement,
                help=statement,
            )
        else:
            each.set_defaults(stated=False)
    watch = commands.add_parser(
        'watch', help='show the race until Ctrl-C', parents=[waiting], description='show the race'
    )
    watch.set_defaults(parser=watch)
    watch.add_argument('--once', action='store_true', help='show it once and exit')
    watch.add_argument('--events', action='store_true', help='print one event per line')
    results = 'show laps, places, the last passings and the races of the event'
    each = commands.add_parser('results', help=results, parents=[waiting], description=results)
    each.set_defaults(parser=each)
    watch.unsent = each.unsent = NOTHING_SENT
    return whole
