"""The command lines of `inspect_kart` and `inspect_rcs`."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Awaitable, Callable, Sequence
import contextlib
import dataclasses
import datetime
import enum
import functools
import pathlib
import re
import signal
import sys
import time
from typing import TypeAlias

from evgp_inspection import VERSION
from evgp_inspection.clauses import Clause, explain, KART, KART_STEPS, listed, select
from evgp_inspection.inspector import AtTerminal, Inspector, Printer, Unattended, WORD
from evgp_inspection.kart_judges import judge, NOT_DONE
from evgp_inspection.kart_steps import KartNeverCameError, KartSteps, NotStoppedError
from evgp_inspection.kart_wire import KartWire
from evgp_inspection.limits import Limits
from evgp_inspection.odometry import listen, Take
from evgp_inspection.recording import Recording
from evgp_inspection.report import as_html, as_json, as_junit, Header, line, summary
from evgp_inspection.traces import Kind, Trace
from evgp_inspection.verdicts import Result, Verdict
from evgp_protocol.frames import DEFAULT_PORT

Odometry: TypeAlias = Callable[[Take], Awaitable[Callable[[], None]]]
"""Begins to hand over speeds, in m/s, and returns what ends that."""


class Exit(enum.IntEnum):
    """The exit codes, for scripts."""

    PASSED = 0  # every check that was judged passed
    FAILED = 1  # a check failed
    USAGE = 2
    NOT_FINISHED = 3  # stopped, or there was nothing to inspect; no check failed


@dataclasses.dataclass
class Inspection:
    """
    What an inspection has come to.

    :ivar results: of the clauses that were asked for.
    :ivar seconds: how long it took, s.
    :ivar remarks: sentences on the whole.
    :ivar finished: every step was done.
    :ivar came: there was something to inspect.
    """

    results: list[Result]
    seconds: float = 0.0
    remarks: list[str] = dataclasses.field(default_factory=list)
    finished: bool = False
    came: bool = True

    @property
    def exit_code(self) -> Exit:
        """Return the exit code."""
        if not self.came:
            return Exit.NOT_FINISHED
        if any(each.verdict is Verdict.FAIL for each in self.results):
            return Exit.FAILED
        if not self.finished or all(each.verdict is Verdict.NOT_JUDGED for each in self.results):
            return Exit.NOT_FINISHED
        return Exit.PASSED


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``kart`` or ``rcs``."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    programs = {'kart': inspect_kart, 'rcs': inspect_rcs}
    if words and words[0] in programs:
        return programs[words[0]](words[1:])
    print('Say what to inspect: kart or rcs. "kart --help" says more.', file=sys.stderr)
    return Exit.USAGE


def inspect_rcs(arguments: Sequence[str] | None = None) -> int:
    """Inspect a race control."""
    print('The inspection of race control is not there yet.', file=sys.stderr)
    return Exit.USAGE


def inspect_kart(arguments: Sequence[str] | None = None) -> int:
    """Inspect a kart; return the exit code."""
    parser = _kart_parser()
    options = parser.parse_args(arguments)
    try:
        chosen = select(KART, options.only)
        limits = Limits(
            **{field.name: getattr(options, field.name) for field in dataclasses.fields(Limits)}
        )
        explained = select(KART, options.explain) if options.explain else ()
    except ValueError as error:
        parser.error(str(error))
    if options.list:
        print(listed(chosen))
        return Exit.PASSED
    if explained:
        print('\n\n'.join(map(explain, explained)))
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
        return Exit.USAGE
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
    print(f'\n{header.subject} {header.team}'.rstrip())
    for remark in inspection.remarks:
        print(remark)
    print(summary(inspection.results))
    if options.report:
        _write(pathlib.Path(options.report), header, inspection.results, began)
    return inspection.exit_code


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


def _kart_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='inspect_kart',
        description='Play race control to one kart, and judge whether it is fit to race.',
        epilog='Exit codes: 0 all judged checks passed, 1 a check failed, 2 wrong usage, '
        '3 not finished (stopped, or the kart never came).',
    )
    add = parser.add_argument
    add('--list', action='store_true', help='print the clauses and end')
    add('--explain', metavar='CLAUSE', default='', help='print all about clauses and end')
    add('--only', metavar='CLAUSES', default='', help='such as K-3A-07,K-4D; default: all')
    add('--listen', metavar='ADDRESS', default='0.0.0.0', help='own IPv4 address (%(default)s)')
    add('--port', type=int, default=DEFAULT_PORT, help='where the kart connects (%(default)s)')
    add(
        '--kart-address', default='', help="the kart's IPv4 address; default: the first to connect"
    )
    add('--number', type=int, default=0, help="the kart's number, for the report")
    add('--team', default='', help='for the report')
    add('--inspector', default='', help="the inspector's name, for the report")
    add(
        '--odometry',
        metavar='SOURCE',
        default='',
        help='the speed in place of eyes: "-" (lines "time speed" or "speed" on standard input), '
        'udp:[ADDRESS:]PORT, ros:/TOPIC (nav_msgs/Odometry), or a file or pipe',
    )
    add('--unattended', action='store_true', help='ask nothing; needs --word')
    add('--word', default='', help=f'"{WORD}": wheels off the ground, MSR in hand')
    add(
        '--report',
        metavar='FOLDER',
        default='inspections',
        help='where HTML, JUnit XML and JSON go (%(default)s); empty: nowhere',
    )
    add('--version', action='version', version=VERSION)
    limits = parser.add_argument_group('limits, in seconds unless they say otherwise')
    for field in dataclasses.fields(Limits):
        limits.add_argument(
            f'--{field.name.replace("_", "-")}',
            type=float,
            default=field.default,
            metavar='X',
            help=f'{field.metadata["meaning"]} (%(default)s)',
        )
    return parser


async def _inspect_kart(
    options: argparse.Namespace, chosen: Sequence[Clause], limits: Limits, printer: Printer
) -> Inspection:
    """Do the inspection from the word to the end."""
    stopping = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, stopping.set)
    with contextlib.ExitStack() as stack:
        inspector: Inspector
        if options.unattended:
            inspector = Unattended(printer.tell)
        else:
            inspector = stack.enter_context(AtTerminal(printer, stopping.set))
        given = loop.create_task(inspector.confirm())
        await _first(given, stopping)
        if not given.done() or not given.result():
            given.cancel()
            return Inspection(judged(chosen, Trace(), limits), remarks=['Not begun.'])
        return await inspect(
            inspector,
            limits,
            chosen,
            stopping,
            host=options.listen,
            port=options.port,
            kart_address=options.kart_address,
            odometry=functools.partial(listen, options.odometry) if options.odometry else None,
            listening=lambda port: printer.tell(
                f'Waiting for the kart on port {port} for {limits.connect:g} s.'
            ),
        )


async def inspect(
    inspector: Inspector,
    limits: Limits,
    chosen: Sequence[Clause],
    stopping: asyncio.Event,
    host: str = '127.0.0.1',
    port: int = 0,
    kart_address: str = '',
    odometry: Odometry | None = None,
    listening: Callable[[int], object] = lambda port: None,
) -> Inspection:
    """
    Inspect a kart, once the inspector has given the word.

    :param chosen: the clauses that the report is to have.
    :param stopping: ends the inspection when it is set; the kart is stopped first.
    :param port: where the kart connects; 0: the system chooses.
    :param kart_address: see `KartWire`.
    :param odometry: what begins to hand over speeds; None: there is no odometry.
    :param listening: is called with the port once the kart may connect.
    :raises OSError: the port or the odometry cannot be used.
    """
    recording = Recording()
    wire = KartWire(recording, inspector.tell, kart_address)
    steps = steps_for(chosen)
    done: set[str] = set()
    told: set[str] = set()

    def step_done(name: str) -> None:
        done.add(name)
        for clause in chosen:
            if clause.steps and clause.name not in told and done.issuperset(clause.steps):
                told.add(clause.name)
                inspector.tell(line(judge(clause, recording.trace, limits)))

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
            recording, wire, inspector, limits, step_done, steps, odometry is not None
        )
        running = asyncio.get_running_loop().create_task(play.run())
        await _first(running, stopping)
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
    results = judged(chosen, recording.trace, limits, ' '.join(remarks))
    for result in results:
        if result.clause.name not in told:
            inspector.tell(line(result))
    return Inspection(results, time.monotonic() - began, remarks, finished, wire.newest > 0)


def steps_for(chosen: Sequence[Clause]) -> tuple[str, ...]:
    """Return the steps that these clauses need, in their order."""
    if any(not clause.steps for clause in chosen):
        return KART_STEPS
    wanted = {step for clause in chosen for step in clause.steps}
    return tuple(step for step in KART_STEPS if step in wanted)


def judged(
    chosen: Sequence[Clause], trace: Trace, limits: Limits, hindrance: str = ''
) -> list[Result]:
    """
    Return the results of these clauses as of now.

    :param hindrance: why some steps were not done, a sentence; empty: all were.
    """
    results = [judge(clause, trace, limits) for clause in chosen]
    if not hindrance:
        return results
    not_done = dataclasses.replace(NOT_DONE, why=f'Not done. {hindrance}')
    return [
        dataclasses.replace(each, finding=not_done) if each.finding == NOT_DONE else each
        for each in results
    ]


async def _first(task: asyncio.Task[bool] | asyncio.Task[None], event: asyncio.Event) -> None:
    """Return once the task is done or the event is set."""
    waiting = asyncio.get_running_loop().create_task(event.wait())
    try:
        await asyncio.wait([task, waiting], return_when=asyncio.FIRST_COMPLETED)
    finally:
        waiting.cancel()
