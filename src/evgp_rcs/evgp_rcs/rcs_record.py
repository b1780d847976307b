"""``rcs_record``, or ``make record``: what can be done with the record of a race."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import sys

from evgp_rcs import mcap_export, replay, timeline
from evgp_rcs.report import command as report
from evgp_rcs.runs import UnreadableError

WAYS: dict[str, tuple[Callable[[Sequence[str]], int], str]] = {
    'show': (timeline.main, 'print a run as a timeline; also without this word'),
    'mcap': (
        mcap_export.main,
        'make a bag of it, for Foxglove, PlotJuggler and ros2 bag',
    ),
    'replay': (replay.main, 'run the rules again on its inputs, and compare what comes out'),
    'report': (report.main, 'write a run, or a part of it, as a report in one HTML file'),
}
"""What the first argument may be: what it calls with the rest, and what that does."""


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Do with a record what the first argument says; without one, print the newest run.

    :return: 0, or 2 if the record or the run cannot be read; 1 as the way itself says.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    way = given.pop(0) if given and given[0] in WAYS else 'show'
    try:
        return WAYS[way][0](given)
    except UnreadableError as error:
        print(f'rcs_record: {error}', file=sys.stderr)
        return 2


if __name__ == '__main__':
    sys.exit(main())
