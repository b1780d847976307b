"""
The officials' terminal client: `rcs_ctl`, one command per command of an official, and `watch`.

It knows no rule either. What must be stated is stated by a flag of its own.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import enum
import signal
import sys
import threading
import time

from evgp_node.graph import bind_graph, fence_graph, GraphError
from evgp_rcs_console import words
from evgp_rcs_console.client import Client, domain_of, Order
from evgp_rcs_console.commands import FORMS
from evgp_rcs_console.snapshot import Answer, Command, Event, Race, State
from evgp_rcs_console.terminal import table
from evgp_rcs_console.view import is_gone, show, silence
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args


class Exit(enum.IntEnum):
    """The exit codes, for scripts."""

    ACCEPTED = 0
    REFUSED = 1
    USAGE = 2
    NOT_THERE = 3


COMMANDS: dict[str, tuple[Command, str]] = {
    'all-kill': (Command.ALL_KILL, 'RED_RED to every kart'),
    'red-flag': (Command.RED_FLAG, 'RED_FLAG to the race'),
    'kart-red-red': (Command.KART_RED_RED, 'RED_RED to one kart'),
    'kart-red-flag': (Command.KART_RED_FLAG, 'RED_FLAG to one kart'),
    'record-msr': (Command.RECORD_MSR, 'record that you used the MSR; also RED_RED to every kart'),
    'join': (Command.JOIN_RACE, 'put a kart into the race'),
    'leave': (Command.LEAVE_RACE, 'take a kart out of the race'),
    'grid-active': (Command.GRID_ACTIVE, 'GRID_ACTIVE to the race'),
    'green-green': (Command.GREEN_GREEN, 'GREEN_GREEN to the race'),
    'kart-finish': (Command.KART_FINISH, 'a kart has crossed the line'),
    'race-over': (Command.RACE_OVER, 'RED_RED to the race, which is over'),
    'open-track': (Command.OPEN_TRACK, 'open the track to humans'),
    'close-track': (Command.CLOSE_TRACK, 'close the track to humans'),
    'in-garage': (Command.IN_GARAGE, 'IN_GARAGE to the race'),
    'kart-in-garage': (Command.KART_IN_GARAGE, 'release one kart from its hold'),
}
"""Every command of an official, by its name on the command line."""

STATEMENTS: dict[Command, tuple[str, str, bool]] = {
    Command.RECORD_MSR: ('--msr-was-used', 'you state that you used the MSR', True),
    Command.GRID_ACTIVE: (
        '--track-is-clear',
        'you state that the track is clear of humans',
        True,
    ),
    Command.IN_GARAGE: ('--track-is-safe', 'you declare the track safe for humans', True),
    Command.KART_IN_GARAGE: (
        '--made-safe-by-hand',
        'you state that someone made this kart safe; needed if it has not acknowledged its stop',
        False,
    ),
}
"""The flag of each statement: its name, what it says, and whether the command needs it always."""


class Desk:
    """What the client hears, for one who waits for it."""

    def __init__(self) -> None:
        """Begin with nothing heard."""
        self.news = threading.Condition()
        self.race: Race | None = None
        self.heard_at = 0.0
        self.answer: tuple[Order, Answer] | None = None
        self.events: list[Event] = []

    def on_race(self, race: Race, at: float) -> None:
        """Keep the newest snapshot."""
        with self.news:
            self.race = race
            self.heard_at = at
            self.news.notify_all()

    def on_event(self, event: Event) -> None:
        """Keep an event."""
        with self.news:
            self.events.append(event)
            self.news.notify_all()

    def on_answer(self, order: Order, answer: Answer) -> None:
        """Keep the answer."""
        with self.news:
            self.answer = order, answer
            self.news.notify_all()

    def wait_for_events(self, known: int, seconds: float) -> list[Event]:
        """Return the events behind the first `known`, once there are any or time is up."""
        with self.news:
            self.news.wait_for(lambda: len(self.events) > known, seconds)
            return self.events[known:]

    def on_pressing(self, count: int, since: float) -> None:
        """Nothing is shown of it."""


SETTLED = 0.5
"""So long without a further past event, and all of them have come, seconds."""


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Give one command, or watch the race.

    :return: a code of ``Exit``.
    """
    given = list(sys.argv if arguments is None else ['rcs_ctl', *arguments])
    wanted = _parser().parse_args(remove_ros_args(given)[1:])
    # Ctrl-C is Python's own KeyboardInterrupt: there is nothing to shut down in order.
    # A shell that puts it into the background has SIGINT ignored, which Python would leave so.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        bind_graph()
    except GraphError as error:
        print(f'rcs_ctl: {error}', file=sys.stderr)
        return Exit.USAGE
    rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    desk = Desk()
    client = Client('rcs_ctl', desk)
    fence_graph()
    try:
        if wanted.command == 'watch':
            return _watch(client, desk, wanted)
        return _give(client, desk, wanted)
    except (KeyboardInterrupt, ExternalShutdownException):
        return Exit.ACCEPTED if wanted.command == 'watch' else Exit.NOT_THERE
    finally:
        client.close()
        rclpy.try_shutdown()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='rcs_ctl',
        description='Command an EVGP race from the terminal. This is not the MSR.',
        epilog='Exit codes: 0 accepted, 1 refused, 2 wrong usage, 3 race control is not there '
        'or did not answer. ROS arguments go behind --ros-args.',
    )
    waiting = argparse.ArgumentParser(add_help=False)
    waiting.add_argument(
        '--wait',
        type=float,
        default=5.0,
        metavar='SECONDS',
        help='how long to wait for race control (default: %(default)s)',
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='command')
    for name, (command, meaning) in COMMANDS.items():
        each = commands.add_parser(name, help=meaning, description=meaning, parents=[waiting])
        if FORMS[command].to_one_kart:
            each.add_argument('kart', type=_kart_number, help='its number in the roster')
        if command in STATEMENTS:
            flag, statement, needed = STATEMENTS[command]
            each.add_argument(
                flag, dest='stated', action='store_true', required=needed, help=statement
            )
    watch = commands.add_parser(
        'watch', help='show the race until Ctrl-C', parents=[waiting], description='show the race'
    )
    watch.add_argument('--once', action='store_true', help='show it once and end')
    watch.add_argument('--events', action='store_true', help='print what happens, line by line')
    watch.add_argument(
        '--kart', type=_kart_number, default=0, help='with --events: only what concerns this kart'
    )
    return parser


def _kart_number(text: str) -> int:
    number = int(text)
    if not 0 <= number <= 65535:
        raise ValueError
    return number


_kart_number.__name__ = 'kart number'  # argparse says: invalid kart number value: 'x'


def _give(client: Client, desk: Desk, wanted: argparse.Namespace) -> int:
    command, _ = COMMANDS[wanted.command]
    ends = time.monotonic() + wanted.wait
    if command is not Command.ALL_KILL and not client.wait_for(command, wanted.wait):
        return _not_there(command, f'race control is not there ({client.topic}, {_domain()})')
    order = client.give(command, getattr(wanted, 'kart', 0), getattr(wanted, 'stated', False))
    with desk.news:
        desk.news.wait_for(lambda: desk.answer is not None, max(0.1, ends - time.monotonic()))
        answered = desk.answer
    if answered is None:
        return _not_there(
            command,
            f'no answer within {wanted.wait:g} s ({client.topic}, {_domain()}). '
            'Look at the race whether it was carried out',
        )
    answer = answered[1]
    if answer.success:
        print(answer.message)
        return Exit.ACCEPTED
    hint = ''
    if not order.stated and command in STATEMENTS:
        hint = f' ({STATEMENTS[command][0]})'
    print(f'{answer.message}{hint}', file=sys.stderr)
    return Exit.REFUSED


def _not_there(command: Command, why: str) -> int:
    advice = ' USE THE MSR.' if FORMS[command].stop else ''
    print(f'{words.LABELS[command]} was not given: {why}.{advice}', file=sys.stderr)
    return Exit.NOT_THERE


def _domain() -> str:
    return f'ROS domain {domain_of()}'


def _watch(client: Client, desk: Desk, wanted: argparse.Namespace) -> int:
    began = time.monotonic()
    if wanted.events:
        return _watch_events(desk, wanted)
    if wanted.once:
        with desk.news:
            desk.news.wait_for(lambda: desk.race is not None, wanted.wait)
    redraw = sys.stdout.isatty() and not wanted.once
    while True:
        with desk.news:
            race, heard_at = desk.race, desk.heard_at
        now = time.monotonic()
        silent_for = now - heard_at if race is not None else None
        quiet = silence(
            silent_for,
            now - began,
            client.topic,
            domain_of(),
            race.state if race else State.UNKNOWN,
        )
        lines = []
        if quiet:
            lines += [f'*** {quiet.title}: {quiet.advice} ***', quiet.detail]
        if race is not None:
            lines += table(show(race, now - heard_at, {}, quiet), race.alerts)
        print(('\x1b[H\x1b[2J' if redraw else '') + '\n'.join(lines), flush=True)
        if wanted.once:
            return Exit.NOT_THERE if is_gone(silent_for) else Exit.ACCEPTED
        if not redraw:
            print()
        with desk.news:
            desk.news.wait(1.0)


def _watch_events(desk: Desk, wanted: argparse.Namespace) -> int:
    shown = 0
    while True:
        # The past events come one by one: it is over when no further one follows.
        fresh = desk.wait_for_events(shown, SETTLED if wanted.once and shown else wanted.wait)
        shown += len(fresh)
        silent = desk.race is None and not shown
        if silent and not fresh:
            print(f'{words.NOT_YET}: {words.GONE_ADVICE} ({_domain()})', file=sys.stderr)
            return Exit.NOT_THERE
        for event in fresh:
            if not wanted.kart or event.kart in (0, wanted.kart):
                print(f'{event.clock} {" " if event.success else "!"} {event.text}', flush=True)
        if wanted.once and not fresh:
            return Exit.ACCEPTED


if __name__ == '__main__':
    sys.exit(main())
