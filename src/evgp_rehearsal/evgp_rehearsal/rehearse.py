# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
``rehearse``, or ``make rehearsal``: a race with simulated karts, for officials to train.

People act as the officials. After each incident, and at the end, the terminal shows the debrief.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import contextlib
import itertools
import os
import pathlib
import signal
import sys
import tempfile
import webbrowser

from evgp_rehearsal.event import BANNER, Rehearsal
from evgp_rehearsal.incidents import INCIDENTS, script_of
from evgp_rehearsal.page import Page
from evgp_rehearsal.plan import Plan

MOST_KARTS = 60
"""Maximum number of karts in a rehearsal."""


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run a rehearsal until Ctrl-C.

    :return: 0. If a setting is wrong, the program exits with 2.
    """
    parser = argparse.ArgumentParser(
        prog=os.environ.get('EVGP_CALLED', 'rehearse'), description='Rehearse a race.'
    )
    parser.add_argument(
        '--karts',
        type=int,
        default=Plan.karts,
        metavar='N',
        help=f'number of karts, from 1 to {MOST_KARTS} (%(default)s)',
    )
    parser.add_argument(
        '--seed',
        type=int,
        default=Plan.seed,
        metavar='N',
        help="decides the karts' abilities, and which kart has which incident (%(default)s)",
    )
    parser.add_argument('--debrief', type=pathlib.Path, help='write the debriefs to this file')
    parser.add_argument('--no-window', action='store_true', help='open neither window nor browser')
    parser.add_argument(
        '--incident',
        action='append',
        choices=INCIDENTS,
        default=[],
        help='begin it 20 s after GREEN_GREEN; if given again, the next begins 90 s later',
    )
    given = parser.parse_args(arguments)
    if not 1 <= given.karts <= MOST_KARTS:
        parser.error(f'--karts must be from 1 to {MOST_KARTS}')
    plan = Plan(karts=given.karts, seed=given.seed, script=script_of(given.incident))
    try:
        if given.debrief is not None:
            given.debrief.touch()
    except OSError as error:
        parser.error(str(error))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    with tempfile.TemporaryDirectory() as folder:
        return _train(plan, pathlib.Path(folder), given)


def _train(plan: Plan, folder: pathlib.Path, given: argparse.Namespace) -> int:
    screen = not given.no_window and any(map(os.environ.get, ('DISPLAY', 'WAYLAND_DISPLAY')))
    with contextlib.ExitStack() as stack:
        rehearsal = stack.enter_context(Rehearsal(plan, folder, window=screen))
        page = stack.enter_context(Page(rehearsal))
        print(f'--- {BANNER}')
        opened = screen and webbrowser.open(page.url)
        where = '' if opened else ' (open it on this machine to begin incidents)'
        print(f'Instructor: {page.url}{where}', flush=True)
        if screen:
            print("Official: the officials' window opens on this screen, if it can.", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            rehearsal.gather()
            _explain(rehearsal)
            for number in itertools.count():
                rehearsal.wait_for_end(number)
                _show(rehearsal.debriefs()[number])
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C would lose the debriefs
        none = "No incident began. Begin one on the instructor's page, or with --incident spin."
        lines = [line for each in rehearsal.debriefs() for line in each] or [none]
        _show(lines)
        if given.debrief is not None:
            given.debrief.write_text('\n'.join([*lines, '']), encoding='utf-8')
    return 0


def _explain(rehearsal: Rehearsal) -> None:
    """Print how to command the race from a terminal."""
    ctl = os.environ.get('EVGP_CTL', 'make ctl ARGS="%s"')
    print('Official, in a terminal, to see the race, start it and stop it:')
    karts = ' '.join(map(str, rehearsal.plan.numbers))
    start = f'grid-active {karts} --track-is-clear', f'green-green {karts}'
    for words in ('watch', *start, 'all-kill'):
        print(f'  ROS_DOMAIN_ID={rehearsal.domain} {ctl.replace("%s", words)}')
    print('If the laptop dies (laptop_dies), take over as in docs/race-day.md:')
    print(f'  {rehearsal.drill}')
    print('Ctrl-C ends the rehearsal and shows the debriefs.', flush=True)


def _show(lines: Sequence[str]) -> None:
    print(f'--- {BANNER}: debrief', *lines, sep='\n', flush=True)


if __name__ == '__main__':
    sys.exit(main())
