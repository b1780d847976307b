"""The runs in a record: which one is asked for, and why it cannot be read."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import contextlib
from dataclasses import dataclass
import pathlib
import sqlite3

from evgp_rcs.record import default_path, is_being_written, open_read_only, Session, sessions


class UnreadableError(RuntimeError):
    """The record, or the run in it, cannot be read; the text says why and what would be right."""


@dataclass(frozen=True)
class Runs:
    """
    A record that is open to be read.

    :param listed: every run, oldest first.
    :param present: the run that race control is writing now.
    """

    file: pathlib.Path
    database: sqlite3.Connection
    listed: list[Session]
    present: Session | None

    def choose(self, number: int | None) -> Session:
        """
        Return the run of this number, or the newest.

        :raises UnreadableError: if there is none.
        """
        for run in reversed(self.listed):
            if number in (None, run.number):
                return run
        known = ', '.join(str(each.number) for each in self.listed)
        what = f'no run {number}; it has {known}' if self.listed else 'no run yet'
        raise UnreadableError(f'{self.file} has {what}')


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Let a parser take `file` and `--run`."""
    parser.add_argument(
        'file',
        nargs='?',
        type=pathlib.Path,
        default=default_path(),
        help='the record, if it is not %(default)s',
    )
    parser.add_argument(
        '--run', type=int, metavar='NUMBER', help='this run, by its number in the list'
    )


@contextlib.contextmanager
def open_runs(file: pathlib.Path) -> Iterator[Runs]:
    """
    Open a record to read it, also while race control writes it.

    :raises UnreadableError: if it cannot be read, also later.
    """
    try:
        with contextlib.closing(open_read_only(file)) as database:
            runs = sessions(database)
            # Race control writes the newest run only.
            present = runs[-1] if runs and is_being_written(file) else None
            yield Runs(file, database, runs, present)
    except FileNotFoundError:
        raise UnreadableError(
            f'there is no {file}. Name the file that the parameter "record" of race control names'
        ) from None
    except (OSError, sqlite3.Error) as error:
        raise UnreadableError(f'{file} cannot be read: {error}') from error
