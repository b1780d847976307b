# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The command line of `inspect_kart`."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Sequence
import contextlib
import dataclasses
import datetime
import functools
import ipaddress
import random
import sys

from evgp_inspection.inspection import inspect
from evgp_inspection.inspector import (
    AtTerminal,
    CONDITIONS,
    Inspector,
    stopped_by_signals,
    Unattended,
    WORD,
)
from evgp_inspection.kart_script import Kill, KILL_PART, KILLING_STEPS, RACE_STEPS, STEPS
from evgp_inspection.kart_sentences import BY_STATEMENT, KART
from evgp_inspection.limits import Limits
from evgp_inspection.odometry import listen
from evgp_inspection.report import as_html, as_json, deliver, show
from evgp_inspection.survey_network import survey_network
from evgp_inspection.verdicts import Clause, Inspection, judged, select, Verdict


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the inspection (``kart``) or the survey (``survey``)."""
    what, *rest = [*(sys.argv[1:] if arguments is None else arguments), '']
    programs = {'kart': inspect_kart, 'survey': survey_network}
    if what in programs:
        return programs[what](rest[:-1])
    print('Choose kart or survey. "kart --help" shows the options.', file=sys.stderr)
    return Verdict.NOT_JUDGED.exit_code


def inspect_kart(arguments: Sequence[str] | None = None) -> int:
    """Inspect a kart; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='inspect_kart',
        description='Play race control for one kart, and judge whether the kart is fit to race.',
        epilog='Exit codes: 0 passed; 2 not passed: a check failed, a check was not done or not '
        'judged, or wrong usage. The last lines and the report say which.',
    )
    add = parser.add_argument
    add('--list', action='store_true', help='explain the clauses and exit')
    add('--only', metavar='CLAUSES', default='', help='check only these, such as K-3A-07,K-4D')
    add('--race', action='store_true', help='only stage a race: connect, drive, RED_FLAG, RED_RED')
    add('--team', default='', help="the team's name, for the report")
    add('--inspector', default='', help="the inspector's name, for the report")
    add(
        '--kart-address',
        type=ipaddress.IPv4Address,
        help="the kart's IPv4 address; default: the first to connect",
    )
    add('--number', type=int, default=0, help="the kart's number, for the report")
    add(
        '--odometry',
        metavar='SOURCE',
        default='',
        help="source of the speed in place of an inspector's eyes: udp:[ADDRESS:]PORT (each "
        'datagram a speed) or ros:/TOPIC (nav_msgs/Odometry)',
    )
    for part, what in (('bridge', 'is connected to race control'), ('stack', 'drives')):
        add(
            f'--kill-{part}',
            metavar='COMMAND',
            default='',
            help=f"a shell command that kills the kart's program that {what}, such as "
            f'"ssh kart pkill -KILL {part}"; by default, the inspection asks you to do so',
        )
    add('--unattended', action='store_true', help='ask no questions; needs --word')
    add(
        '--word',
        default='',
        help=f'"{WORD}" states that the wheels are off the ground, and the MSR in hand',
    )
    options, limits = Limits.parse(parser, arguments, 'inspections')
    seed = limits.seed or random.randrange(1, 1_000_000)  # noqa: S311 - no secret
    limits = dataclasses.replace(limits, seed=seed)
    try:
        clauses = select(KART, options.only)
        if options.race:
            clauses = tuple(c for c in clauses if not c.steps or c.steps[0] in RACE_STEPS)
    except ValueError as error:
        parser.error(str(error))
    if options.list:
        done = {name: step.done for name, step in STEPS.items()}
        show('\n\n'.join(each.explain(done) for each in clauses))
        return Verdict.PASS.exit_code
    if options.unattended and options.word != WORD:
        parser.error(
            f'--unattended makes a kart drive with no inspector. Give --word {WORD} to state that '
            'its wheels are off the ground and that someone holds the MSR'
        )
    return _inspect(options, limits, clauses)


def _kills(options: argparse.Namespace, inspector: Inspector, limits: Limits) -> dict[str, Kill]:
    """Return functions that kill the parts of the kart's program, or ask the inspector to."""

    async def ask(part: str) -> bool:
        return bool(await inspector.ask(KILL_PART[part], limits.connect))

    async def run(command: str) -> bool:
        running = await asyncio.create_subprocess_shell(command, stdin=asyncio.subprocess.DEVNULL)
        try:
            code = await asyncio.wait_for(running.wait(), limits.answer)
        except (TimeoutError, asyncio.TimeoutError):
            running.kill()
            code = await running.wait()
        if code:
            inspector.tell(f'  !  This command failed ({code}): {command}')
        return code == 0

    commands = {part: getattr(options, f'kill_{part}') for part in KILLING_STEPS}
    return {
        part: functools.partial(run, command) if command else functools.partial(ask, part)
        for part, command in commands.items()
        if command or not options.unattended
    }


def _inspect(options: argparse.Namespace, limits: Limits, clauses: Sequence[Clause]) -> int:
    """Inspect the kart and write the report; return the exit code."""
    began = datetime.datetime.now().astimezone()
    try:
        inspection = asyncio.run(_with_the_word(options, limits, clauses))
    except (OSError, OverflowError, ValueError, ImportError) as error:
        print(f'The inspection cannot start: {error}', file=sys.stderr)
        return Verdict.NOT_JUDGED.exit_code
    inspection.subject = f'kart {options.number}' if options.number else 'kart'
    inspection.team = options.team
    inspection.inspector = '' if options.unattended else options.inspector
    inspection.began = began.isoformat(timespec='seconds')
    inspection.remarks = [
        *inspection.remarks,
        *['This was only a race, not an inspection.'] * options.race,
        *[f'This was only a part of an inspection: {options.only}.'] * bool(options.only),
    ]
    lines = [
        f'\n{inspection.subject} {inspection.team}'.rstrip(),
        *inspection.remarks,
        *(f'The team states, and the inspector ticks by hand: {each}' for each in BY_STATEMENT),
        inspection.summary(),
    ]
    files = {'html': as_html(inspection), 'json': as_json(inspection)}
    name = inspection.subject.replace(' ', '-')
    deliver('\n'.join(lines), options.report, name, began, files)
    return inspection.verdict.exit_code


async def _with_the_word(
    options: argparse.Namespace, limits: Limits, clauses: Sequence[Clause]
) -> Inspection:
    """Inspect once the inspector has typed the word; a signal ends the inspection."""
    stopping = stopped_by_signals()
    with contextlib.ExitStack() as stack:
        inspector = Unattended() if options.unattended else AtTerminal(stopping)
        odometry = functools.partial(listen, options.odometry, tell=inspector.tell)
        stack.enter_context(contextlib.closing(inspector))
        if isinstance(inspector, AtTerminal):
            stack.enter_context(inspector.reading())
            if not await inspector.confirm(CONDITIONS):
                remarks = ['Not started.']
                return Inspection(judged({}, clauses, remarks), limits, 0.0, remarks)
        return await inspect(
            inspector,
            limits,
            clauses,
            stopping,
            host=options.listen,
            port=options.port,
            kart_address=str(options.kart_address or ''),
            odometry=odometry if options.odometry else None,
            kills=_kills(options, inspector, limits),
            steps=RACE_STEPS if options.race else (),
            listening=lambda port: inspector.tell(
                f'Waiting for the kart on port {port} for {limits.connect:g} s.'
            ),
        )
