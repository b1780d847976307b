# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The command lines of `inspect_kart` and `inspect_rcs`."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
import contextlib
import dataclasses
import datetime
import functools
import importlib
import pathlib
import re
import signal
import sys
import time
from types import MappingProxyType
from typing import Any, TypeAlias

from evgp_inspection import rcs_judges, VERSION
from evgp_inspection.clauses import (
    Clause,
    explain,
    KART,
    KART_STEPS,
    KILLING_STEPS,
    listed,
    select,
)
from evgp_inspection.drivers import Driver, Human
from evgp_inspection.inspection import Exit, Inspection
from evgp_inspection.inspector import AtTerminal, Inspector, Printer, RCS_FIRST, Unattended, WORD
from evgp_inspection.judging import steps_for
from evgp_inspection.kart_judges import judge
from evgp_inspection.kart_steps import (
    KartNeverCameError,
    KartSteps,
    Kill,
    KILL_PART,
    NotStoppedError,
)
from evgp_inspection.kart_wire import KartWire
from evgp_inspection.limits import Limits, RcsLimits
from evgp_inspection.odometry import listen, Take
from evgp_inspection.rcs_clauses import RCS
from evgp_inspection.rcs_inspection import inspect_race_control
from evgp_inspection.recording import first, Recording
from evgp_inspection.report import as_html, as_json, as_junit, Header, summary
from evgp_inspection.telling import Telling
from evgp_inspection.traces import Kind, Trace
from evgp_inspection.verdicts import Result
from evgp_protocol.frames import DEFAULT_PORT

Odometry: TypeAlias = Callable[[Take], Awaitable[Callable[[], None]]]
"""Begins to hand over speeds, in m/s, and returns what ends that."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``kart`` or ``rcs``."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    programs = {'kart': inspect_kart, 'rcs': inspect_rcs}
    if words and words[0] in programs:
        return programs[words[0]](words[1:])
    print('Say what to inspect: kart or rcs. "kart --help" says more.', file=sys.stderr)
    return Exit.NOT_PASSED


def inspect_rcs(arguments: Sequence[str] | None = None) -> int:
    """Inspect a race control; return the exit code."""
    parser = _rcs_parser()
    options = parser.parse_args(arguments)
    try:
        chosen = select(RCS, options.only)
        limits = RcsLimits(**_limits_of(options, RcsLimits))
        explained = select(RCS, options.explain) if options.explain else ()
        numbers = [int(each) for each in options.karts.split(',')]
        own = [each for each in options.addresses.split(',') if each]
        addresses = dict(zip(numbers, own or map(_loopback, numbers), strict=True))
    except ValueError as error:
        parser.error(str(error))
    if _told(options, chosen, explained):
        return Exit.PASSED
    if len(addresses) != 3:
        parser.error('--karts names three karts; two of them race')
    if options.driver == 'ros' and options.word != WORD:
        parser.error(f'--driver ros starts races: say --word {WORD} if no real kart is there')
    printer = Printer()
    began = datetime.datetime.now().astimezone()
    try:
        inspection = asyncio.run(_inspect_rcs(options, chosen, limits, addresses, printer))
    except (OSError, ImportError) as error:
        print(f'The inspection cannot start: {error}', file=sys.stderr)
        return Exit.NOT_PASSED
    finally:
        printer.close()
    header = Header(
        subject='race control',
        team=options.team,
        inspector=options.inspector,
        began=began.isoformat(timespec='seconds'),
        seconds=inspection.seconds,
        limits=dataclasses.asdict(limits),
        remarks=tuple(inspection.remarks),
    )
    return _finish(header, inspection, options.report, began)


async def _inspect_rcs(
    options: argparse.Namespace,
    chosen: Sequence[Clause],
    limits: RcsLimits,
    addresses: dict[int, str],
    printer: Printer,
) -> Inspection:
    """Do the inspection of a race control from the word to the end."""
    stopping = _stopping()
    with contextlib.ExitStack() as stack:
        inspector: Inspector
        driver: Driver
        if options.driver == 'ros':
            inspector = Unattended(printer.tell)
            ros: Any = importlib.import_module('evgp_inspection.ros_driver')
            driver = ros.RosDriver()
        else:
            inspector = stack.enter_context(AtTerminal(printer, stopping.set, first=RCS_FIRST))
            driver = Human(inspector, limits.answer)
        stack.callback(driver.close)
        given = asyncio.get_running_loop().create_task(inspector.confirm())
        await first(given, stopping)
        if not given.done() or not given.result():
            given.cancel()
            not_judged = [rcs_judges.judge(each, Trace(), limits) for each in chosen]
            return Inspection(not_judged, remarks=['Not begun.'])
        return await inspect_race_control(
            inspector,
            driver,
            limits,
            chosen,
            stopping,
            (options.host, options.port),
            addresses,
            options.stranger,
        )


def inspect_kart(arguments: Sequence[str] | None = None) -> int:
    """Inspect a kart; return the exit code."""
    parser = _kart_parser()
    options = parser.parse_args(arguments)
    try:
        chosen = select(KART, options.only)
        limits = Limits(**_limits_of(options, Limits))
        explained = select(KART, options.explain) if options.explain else ()
    except ValueError as error:
        parser.error(str(error))
    if _told(options, chosen, explained):
        return Exit.PASSED
    if options.unattended and options.word != WORD:
        parser.error(
            f'--unattended makes a kart drive with nobody there: say --word {WORD} to state that '
            'its wheels are off the ground and that somebody has the MSR'
        )
    if options.odometry == '-' and not options.unattended:
        parser.error('--odometry - takes the keyboard: it needs --unattended')
    printer = Printer()
    began = datetime.datetime.now().astimezone()
    try:
        inspection = asyncio.run(_inspect_kart(options, chosen, limits, printer))
    except (OSError, ValueError, ImportError) as error:
        print(f'The inspection cannot start: {error}', file=sys.stderr)
        return Exit.NOT_PASSED
    finally:
        printer.close()
    header = Header(
        subject=f'kart {options.number}' if options.number else 'kart',
        team=options.team,
        inspector='' if options.unattended else options.inspector,
        began=began.isoformat(timespec='seconds'),
        seconds=inspection.seconds,
        limits=dataclasses.asdict(limits),
        remarks=tuple(inspection.remarks),
    )
    return _finish(header, inspection, options.report, began)


def _told(
    options: argparse.Namespace, chosen: Sequence[Clause], explained: Sequence[Clause]
) -> bool:
    """Print the clauses if that is all that is asked for; return whether it is."""
    if options.list:
        print(listed(chosen))
    elif explained:
        print('\n\n'.join(map(explain, explained)))
    return bool(options.list or explained)


def _finish(header: Header, inspection: Inspection, folder: str, began: datetime.datetime) -> Exit:
    """Print the end, write the report into a folder (empty: nowhere), return the exit code."""
    print(f'\n{header.subject} {header.team}'.rstrip())
    for remark in inspection.remarks:
        print(remark)
    print(summary(inspection.results))
    if folder:
        _write(pathlib.Path(folder), header, inspection.results, began)
    return inspection.exit_code


def _limits_of(options: argparse.Namespace, limits: type[Limits | RcsLimits]) -> dict[str, float]:
    return {field.name: getattr(options, field.name) for field in dataclasses.fields(limits)}


def _loopback(number: int) -> str:
    """Return the loopback address of a kart."""
    if not 0 < number < 250:
        raise ValueError('karts have numbers from 1 to 249, or --addresses names their addresses')
    return f'127.0.1.{number}'


def _stopping() -> asyncio.Event:
    """Return the event that a signal sets."""
    stopping = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, stopping.set)
    return stopping


def _write(
    folder: pathlib.Path, header: Header, results: list[Result], began: datetime.datetime
) -> None:
    """Write the three files of the report."""
    name = re.sub('[^a-z0-9]+', '-', header.subject.lower())
    stem = f'{name}-{began:%Y%m%d-%H%M%S}'
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for ending, write in (('html', as_html), ('xml', as_junit), ('json', as_json)):
            path = folder / f'{stem}.{ending}'
            path.write_text(write(header, results), encoding='utf-8')
            print(f'written: {path}')
    except OSError as error:
        print(f'The report cannot be written: {error}', file=sys.stderr)


def _parser(
    prog: str, description: str, example: str, limits: type[Limits | RcsLimits]
) -> argparse.ArgumentParser:
    """Return a parser of what both programs take."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description=description,
        epilog='Exit codes: 0 passed; 2 not: a check failed, or not all of it was done or judged, '
        'or wrong usage. The last lines and the report say which.',
    )
    add = parser.add_argument
    add('--list', action='store_true', help='print the clauses and end')
    add('--explain', metavar='CLAUSE', default='', help='print all about clauses and end')
    add('--only', metavar='CLAUSES', default='', help=f'such as {example}; default: all')
    add('--team', default='', help='for the report')
    add('--inspector', default='', help="the inspector's name, for the report")
    add(
        '--report',
        metavar='FOLDER',
        default='inspections',
        help='where HTML, JUnit XML and JSON go (%(default)s); empty: nowhere',
    )
    add('--version', action='version', version=VERSION)
    group = parser.add_argument_group('limits, in seconds unless they say otherwise')
    for field in dataclasses.fields(limits):
        group.add_argument(
            f'--{field.name.replace("_", "-")}',
            type=float,
            default=field.default,
            metavar='X',
            help=f'{field.metadata["meaning"]} (%(default)s)',
        )
    return parser


def _rcs_parser() -> argparse.ArgumentParser:
    parser = _parser(
        'inspect_rcs', 'Play three karts to a race control, and judge it.', 'R-3B,R-4C', RcsLimits
    )
    add = parser.add_argument
    add('--host', default='127.0.0.1', help="race control's IPv4 address (%(default)s)")
    add('--port', type=int, default=DEFAULT_PORT, help='its TCP port (%(default)s)')
    add(
        '--karts',
        metavar='N,N,N',
        default='1,2,3',
        help='the numbers of the karts; the third is not in the race (%(default)s)',
    )
    add(
        '--addresses',
        metavar='A,A,A',
        default='',
        help='their IPv4 addresses, all of this computer; default: 127.0.1.N',
    )
    add(
        '--stranger',
        metavar='ADDRESS',
        default='127.0.1.250',
        help='an IPv4 address of this computer that is no kart (%(default)s)',
    )
    add(
        '--driver',
        choices=('human', 'ros'),
        default='human',
        help='who gives the commands: you, when asked, or our services (%(default)s)',
    )
    add('--word', default='', help=f'"{WORD}": no real kart is there; for --driver ros')
    return parser


def _kart_parser() -> argparse.ArgumentParser:
    parser = _parser(
        'inspect_kart',
        'Play race control to one kart, and judge whether it is fit to race.',
        'K-3A-07,K-4D',
        Limits,
    )
    add = parser.add_argument
    add('--listen', metavar='ADDRESS', default='0.0.0.0', help='own IPv4 address (%(default)s)')
    add('--port', type=int, default=DEFAULT_PORT, help='where the kart connects (%(default)s)')
    add(
        '--kart-address', default='', help="the kart's IPv4 address; default: the first to connect"
    )
    add('--number', type=int, default=0, help="the kart's number, for the report")
    add(
        '--odometry',
        metavar='SOURCE',
        default='',
        help='the speed in place of eyes: "-" (lines "time speed" or "speed" on standard input), '
        'udp:[ADDRESS:]PORT, ros:/TOPIC (nav_msgs/Odometry), or a file or pipe',
    )
    for part, what in (('bridge', 'is connected to race control'), ('stack', 'drives')):
        add(
            f'--kill-{part}',
            metavar='COMMAND',
            default='',
            help=f'a shell command that kills the program of the kart that {what}, such as '
            f'"ssh kart pkill -KILL {part}"; default: you are asked to',
        )
    add('--unattended', action='store_true', help='ask nothing; needs --word')
    add('--word', default='', help=f'"{WORD}": wheels off the ground, MSR in hand')
    return parser


async def _inspect_kart(
    options: argparse.Namespace, chosen: Sequence[Clause], limits: Limits, printer: Printer
) -> Inspection:
    """Do the inspection from the word to the end."""
    stopping = _stopping()
    loop = asyncio.get_running_loop()
    with contextlib.ExitStack() as stack:
        inspector: Inspector
        if options.unattended:
            inspector = Unattended(printer.tell)
        else:
            inspector = stack.enter_context(AtTerminal(printer, stopping.set))
        given = loop.create_task(inspector.confirm())
        await first(given, stopping)
        if not given.done() or not given.result():
            given.cancel()
            not_judged = [judge(each, Trace(), limits) for each in chosen]
            return Inspection(not_judged, remarks=['Not begun.'])
        return await inspect(
            inspector,
            limits,
            chosen,
            stopping,
            host=options.listen,
            port=options.port,
            kart_address=options.kart_address,
            odometry=functools.partial(listen, options.odometry) if options.odometry else None,
            kills=_kills(options, inspector, limits),
            listening=lambda port: printer.tell(
                f'Waiting for the kart on port {port} for {limits.connect:g} s.'
            ),
        )


def _kills(options: argparse.Namespace, inspector: Inspector, limits: Limits) -> dict[str, Kill]:
    """Return what kills the parts of the kart's program: commands, or the inspector's hand."""

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


async def inspect(
    inspector: Inspector,
    limits: Limits,
    chosen: Sequence[Clause],
    stopping: asyncio.Event,
    host: str = '127.0.0.1',
    port: int = 0,
    kart_address: str = '',
    odometry: Odometry | None = None,
    kills: Mapping[str, Kill] = MappingProxyType({}),
    listening: Callable[[int], object] = lambda port: None,
) -> Inspection:
    """
    Inspect a kart, once the inspector has given the word.

    :param chosen: the clauses that the report is to have.
    :param stopping: ends the inspection when it is set; the kart is stopped first.
    :param port: where the kart connects; 0: the system chooses.
    :param kart_address: see `KartWire`.
    :param odometry: what begins to hand over speeds; None: there is no odometry.
    :param kills: see `KartSteps`.
    :param listening: is called with the port once the kart may connect.
    :raises OSError: the port or the odometry cannot be used.
    """
    recording = Recording()
    wire = KartWire(recording, inspector.tell, kart_address)
    steps = steps_for(chosen, KART_STEPS)
    telling = Telling(
        chosen, lambda clause: judge(clause, recording.trace, limits), inspector.tell
    )
    began = time.monotonic()
    finished = False
    remarks: list[str] = []
    end_odometry = None
    if odometry is not None:
        end_odometry = await odometry(lambda speed: recording.note(Kind.SPEED, value=speed))
    try:
        await wire.listen(host, port)
        listening(wire.port)
        play = KartSteps(
            recording,
            wire,
            inspector,
            limits,
            telling.step_done,
            steps,
            odometry is not None,
            kills,
        )
        running = asyncio.get_running_loop().create_task(play.run())
        await first(running, stopping)
        if not running.done():
            inspector.tell('\a  !  STOPPED. RED_RED is sent to the kart.')
            running.cancel()  # once: the end of the steps stops the kart
            remarks.append('The inspection was stopped.')
        try:
            await running
            finished = True
        except asyncio.CancelledError:
            pass
        except KartNeverCameError:
            remarks.append(f'No kart connected within {limits.connect:g} s.')
        except NotStoppedError as error:
            remarks.append(f'{error} The inspection ended there. Use the MSR.')
        if play.hindrance and not remarks:
            remarks.append(f'{play.hindrance} It was not made to drive.')
    finally:
        await wire.shut_down()
        if end_odometry is not None:
            end_odometry()
    results = telling.end(' '.join(remarks))
    return Inspection(results, time.monotonic() - began, remarks, finished, wire.newest > 0)
