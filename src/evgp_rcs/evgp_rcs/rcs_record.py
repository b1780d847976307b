# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0
#
# PYTHON_ARGCOMPLETE_OK

"""``rcs_record``, or ``make record``: the commands that read the record of a race."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import difflib
import os
import pathlib
import sys
from types import ModuleType

from evgp_node.output import show_what_it_can
from evgp_rcs.record import replay, timeline
from evgp_rcs.record.report import command as report
from evgp_rcs.record.report import results
from evgp_rcs.record.runs import CALLED, say, UNREADABLE, UnreadableError
from evgp_rcs.record.store import default_path
from evgp_rcs.ros import mcap_export

WAYS: dict[str, tuple[ModuleType, str]] = {
    'show': (timeline, 'print a run as a timeline (the default)'),
    'results': (results, 'write the results of each race, with laps and penalties, as CSV'),
    'report': (report, 'write a run as a report in one HTML file'),
    'replay': (replay, 'run the rules again on the recorded inputs, and compare'),
    'mcap': (mcap_export, 'make a bag for Foxglove, PlotJuggler and ros2 bag'),
}
"""
The subcommands: the module of each, and what it does.

``add_options`` of the module adds its options and its help to a parser. ``main`` returns the exit
code, and raises UnreadableError if the record or the run cannot be read.
"""

NOTES = """\
A run is everything between one start of race control and its end. A run that race control is still
writing is read up to now. Each subcommand has its own options: 'rcs_record report --help'. Without
a file, it reads FILE.

examples:
  rcs_record --list                             the runs in the record
  rcs_record --run 3 --kart 7                   what happened to kart 7 in run 3
  rcs_record --run 3 --stream                   every entry of run 3, as recorded
  rcs_record results -o results.csv             the results, for a spreadsheet
  rcs_record report -o report.html              the report, for a jury
  rcs_record replay race.sqlite3                was the software right?
  rcs_record mcap race.sqlite3 race.mcap        the race, for Foxglove

With make: make record ARGS='report -o report.html'

exit codes:
  0  done
  1  the output cannot be written, or the replay found a difference
  2  the record or the run cannot be read, or the usage is wrong
  3  done, but incomplete: the record is damaged, or a part is missing
"""


def main(arguments: Sequence[str] | None = None) -> int:
    options = _options()
    if '_ARGCOMPLETE' in os.environ:  # the shell completes a command line
        import argcomplete

        argcomplete.autocomplete(options)
    given = list(sys.argv[1:] if arguments is None else arguments)
    show_what_it_can()
    if given and (meant := _misspelt(given[0])):
        say(f'there is no subcommand and no file {given[0]}. Did you mean {meant}?')
        return UNREADABLE
    if not given or given[0] not in (*WAYS, '-h', '--help'):
        given.insert(0, 'show')
    wanted = options.parse_args(given)
    try:
        code: int = wanted.main(wanted)
        sys.stdout.flush()
    except UnreadableError as error:
        say(str(error))
        return UNREADABLE
    except BrokenPipeError:
        # The reader has closed the pipe; Python must not write the rest when it exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return 130
    return code


def _options() -> argparse.ArgumentParser:
    """Return the parser. Its own options, those of `show`, are for help and completion only."""
    options = argparse.ArgumentParser(
        prog=CALLED,
        usage=f'{CALLED} [subcommand] [FILE] [options]',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_options(options, timeline)
    options.description = 'Look at what race control recorded.'
    options.epilog = NOTES.replace('rcs_record', CALLED).replace('FILE', str(default_path()))
    ways = options.add_subparsers(prog=CALLED, metavar='subcommand')
    for name, (module, what) in WAYS.items():
        way = ways.add_parser(name, help=what)
        way.add_argument(
            'file',
            nargs='?',
            type=pathlib.Path,
            default=default_path(),
            help='the record (default: %(default)s)',
        )
        _add_options(way, module)
        way.set_defaults(main=module.main)
    return options


def _add_options(parser: argparse.ArgumentParser, module: ModuleType) -> None:
    parser.add_argument(
        '--run',
        type=int,
        metavar='NUMBER',
        help="number of the run, as in '--list' (default: the newest)",
    )
    module.add_options(parser)


def _misspelt(word: str) -> str:
    """Return the subcommand that a misspelt word probably means; empty if none."""
    if word in WAYS or not word.isalpha() or pathlib.Path(word).exists():
        return ''
    return next(iter(difflib.get_close_matches(word, WAYS)), '')


if __name__ == '__main__':
    sys.exit(main())
