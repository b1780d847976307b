# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The ROS part of `rcs_ctl`. It returns the text to print; only a `watch` prints by itself."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
import contextlib
from dataclasses import replace
import os
import shlex
import sys
import threading

from evgp_node.graph import GraphError
from evgp_node.official import said_by, tidy
from evgp_node.process import join_graph
from evgp_node.rclpy_private import RCLError, UnknownROSArgsError
from evgp_node.results import Standings
from evgp_protocol.clock import now
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Answer, StampedEvent
from evgp_rcs.rules.snapshot import NOTHING, Snapshot
from evgp_rcs.words import time_of_day
from evgp_rcs_console import results, texts
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.client import Client, domain_of, looking, PRESENCE_PERIOD
from evgp_rcs_console.command_line import COMMANDS, Exit, GRACE, STARTING, Told
from evgp_rcs_console.commands import Given, Standing
from evgp_rcs_console.settings import Signature
from evgp_rcs_console.view import aligned, Latest, present, Screen, table
import rclpy

SETTLED = 1.0
"""Time without an event after which all past events count as received, in seconds."""


class Hearing(Latest):
    """Keeps what the client receives, so that a caller can wait for it."""

    def __init__(self) -> None:
        super().__init__(now())
        self.news = threading.Condition()
        self.given: Given | None = None
        self.answer: tuple[Given, Answer] | None = None
        self.standing: tuple[Standing, ...] = ()
        self.dropped: tuple[Given, str] | None = None
        self.events: list[StampedEvent] = []

    @contextlib.contextmanager
    def _hears(self) -> Iterator[None]:
        """Wake the caller that waits, once what this keeps has changed."""
        with self.news:
            yield
            self.news.notify_all()

    def on_race(self, race: Snapshot, at: float, two: bool) -> None:
        with self._hears():
            self.take_race(race, at, two)

    def on_event(self, event: StampedEvent) -> None:
        with self._hears():
            self.events.append(event)
            self.take_event(event.event)

    def on_results(self, results: Standings) -> None:
        with self._hears():
            self.results = results

    def on_answer(self, given: Given, answer: Answer) -> None:
        with self._hears():
            self.answer = given, answer

    def on_pressing(self, stops: tuple[Standing, ...]) -> None:
        self.standing = stops

    def on_dropped(self, given: Given, why: str) -> None:
        with self._hears():
            self.dropped = given, why

    def wait_for(self, found: Callable[[], object], until: float) -> bool:
        with self.news:
            return bool(self.news.wait_for(found, max(0.0, until - now())))


def attend(
    given: Sequence[str],
    wanted: argparse.Namespace,
    began: float,
    parts: contextlib.ExitStack,
    alive: Callable[[], object],
) -> Told:
    """
    Carry out a command line; return what it has come to.

    :param began: when `rcs_ctl` was called, in seconds. The time of `--wait` begins once ROS has
        started.
    :param parts: collects the callbacks that leave the ROS domain after the answer is printed.
    :param alive: called after each round of a `watch`.
    """
    try:
        join_graph('rcs_ctl', given)
    except (GraphError, RCLError, UnknownROSArgsError) as error:
        return _cannot(wanted, error)
    parts.callback(rclpy.try_shutdown)
    hearing = Hearing()
    # Watching needs no permission to command, and a spectators' screen has none.
    watches = wanted.command in ('watch', 'results')
    commands = () if watches else (COMMANDS[wanted.command],)
    try:
        client = Client('rcs_ctl', hearing, commands=commands, there='rcs_ctl' * _is_at(wanted))
    except RCLError as error:
        return _cannot(wanted, texts.NOT_ALLOWED.format(error=error))
    parts.callback(client.close)
    ready = now()
    until = min(ready, began + STARTING - GRACE) + float(wanted.wait)
    if wanted.command == 'watch':
        return _watch(client, hearing, wanted, until, alive)
    if wanted.command == 'results':
        return _show_results(client, hearing, until)
    try:
        told = _give(client, hearing, wanted, until, ready - began)
    except KeyboardInterrupt:
        if hearing.given is None:
            raise
        error = hearing.answer[1].message if hearing.answer else _interrupted(hearing)
        told = Told(Exit.NOT_THERE, error=error)
    return _under_banner(told, hearing.race)


def _cannot(wanted: argparse.Namespace, why: object) -> Told:
    """Return why `rcs_ctl` cannot take part in the graph, and that a command was not sent."""
    unsent = f'\n{wanted.parser.unsent}' if wanted.command in COMMANDS else ''
    return Told(Exit.USAGE, error=f'rcs_ctl: {why}{unsent}')


def _is_at(wanted: argparse.Namespace) -> bool:
    """Return whether an official at this terminal sees the race."""
    sees = wanted.command == 'watch' and not (wanted.once or wanted.events)
    return sees and sys.stdout.isatty()


def _give(
    client: Client, hearing: Hearing, wanted: argparse.Namespace, until: float, starting: float
) -> Told:
    """
    Send a command and return the answer.

    :param starting: how long ROS took to start, in seconds.
    """
    command, kart = COMMANDS[wanted.command], getattr(wanted, 'kart', 0)
    entry = CATALOGUE[command]
    where = _where(client)
    waited = max(0.0, until - now())
    details = f'once ROS had started, which took {starting:.1f} s; {where}'
    if not entry.stop and not client.wait_for(command, until - now()):
        not_there = texts.not_there(command, entry.label)
        return Told(Exit.NOT_THERE, error=f'{not_there} ({where})')
    given = Given(
        command,
        kart,
        wanted.stated,
        karts=tuple(sorted(set(getattr(wanted, 'karts', ())))),
        heat=getattr(wanted, 'heat', ''),
        number=getattr(wanted, 'reading', 0),
        official=Signature(wanted.official).claim,
        taken={name: getattr(wanted, name) for name in entry.takes if hasattr(wanted, name)},
    )
    released: list[str] = []
    if entry.names_hold or (entry.names_karts and (entry.names_number or not given.karts)):
        if not hearing.wait_for(lambda: hearing.race is not None, until):
            return Told(Exit.NOT_THERE, error=texts.no_answer(given, waited, details))
        race = hearing.race
        assert race is not None
        assert isinstance(command, CommandKind)
        seen = _as_seen(given, race, wanted)
        if seen is None:
            # The answer mentions the timekeeper's results, if any arrive.
            hearing.wait_for(lambda: hearing.results is not None, min(until, now() + SETTLED))
            return _name_them(wanted, race, hearing.results)
        given = seen
        if race.kart(kart) is not None:
            released = _effects(command, race, kart, hearing.results)
    hearing.given = given
    client.give(given)
    hearing.wait_for(lambda: hearing.answer is not None or hearing.dropped is not None, until)
    if hearing.dropped is not None:
        return Told(Exit.SUPERSEDED, error=hearing.dropped[1])
    if hearing.answer is None:
        reason = ' '.join(stop.said for stop in hearing.standing if stop.said)
        error = texts.no_answer(given, waited, details, reason)
        return Told(Exit.NOT_THERE, error=error)
    answer = hearing.answer[1]
    if answer.success:
        return Told(Exit.ACCEPTED, '\n'.join([*released, answer.message]))
    # The race has usually arrived long before; this limits the wait for it if it has not.
    hearing.wait_for(lambda: hearing.race is not None, min(until, now() + SETTLED))
    race, found = hearing.race, hearing.results
    steps = [] if race is None else _next_step(wanted, given, race, found)
    return Told(Exit.REFUSED, error='\n'.join([answer.message, *steps]))


def _as_seen(given: Given, race: Snapshot, wanted: argparse.Namespace) -> Given | None:
    """
    Return a command with the hold, or the opening of the track, that the race shows.

    Return None if the official must name karts or the opening first.
    """
    entry, track = CATALOGUE[given.command], race.track
    if entry.names_hold:
        kart = race.kart(given.kart)
        return replace(given, hold=None if kart is None else kart.hold)
    assert isinstance(given.command, CommandKind)
    offered = race.offered(given.command)
    # If IN GARAGE concerns no kart, none need be named.
    concerns_none = offered.available and not offered.karts and given.stated
    if not given.karts and not concerns_none:
        return None
    if not entry.names_number:
        return given
    if track.open and wanted.closes is None:
        return None
    return replace(given, number=track.opening if wanted.closes is None else wanted.closes)


def _where(client: Client) -> str:
    return f'{client.topic}, ROS domain {domain_of()}'


def _not_found(client: Client) -> Told:
    return Told(Exit.NOT_THERE, error=f'{texts.NOT_YET} ({_where(client)})')


def _interrupted(hearing: Hearing) -> str:
    """Return what is known about an unanswered command when an official interrupts `rcs_ctl`."""
    assert hearing.given is not None
    stop = next(iter(hearing.standing), Standing(hearing.given, hearing.given.at))
    details = f'interrupted; sent {stop.presses} times' if stop.presses else 'interrupted'
    return texts.no_answer(hearing.given, now() - hearing.given.at, details, stop.said)


def _under_banner(told: Told, race: Snapshot | None) -> Told:
    """Put race control's banner above each text that does not contain the banner yet."""
    if race is None or not race.banner:
        return told
    line, known = texts.BANNER.format(banner=race.banner), f'{race.banner}: '
    output, error = (
        f'{line}\n{said}' if said and known not in said else said
        for said in (told.output, told.error)
    )
    return Told(told.code, output, error)


def _next_step(
    wanted: argparse.Namespace, given: Given, race: Snapshot, found: Standings | None
) -> list[str]:
    """Return what to type after a refusal, if only karts or a statement were missing."""
    form = CATALOGUE[given.command]
    kart = race.kart(given.kart) if form.to_one_kart else None
    if not isinstance(given.command, CommandKind) or (form.to_one_kart and kart is None):
        return []
    offered = (kart or race).offered(given.command)
    if not offered.available:
        return []
    karts = offered.karts if form.names_karts else ()
    others = set(karts) != set(given.karts)
    unsaid = '' if given.stated or form.call_is_statement else offered.statement
    if not others and not unsaid:
        return []
    effects = _effects(given.command, race, 0, found) if others else []
    return [*effects, _line(wanted, race, karts, unsaid)]


def _name_them(wanted: argparse.Namespace, race: Snapshot, found: Standings | None) -> Told:
    """Return the karts that a command would start or release, without sending anything."""
    command = COMMANDS[wanted.command]
    assert isinstance(command, CommandKind)
    offered = race.offered(command)
    label = CATALOGUE[command].label
    if not offered.available:
        reason = offered.reason or 'race control does not offer it'
        error = f'{label}: nothing was sent. The command is not possible now: {reason}.'
        return Told(Exit.REFUSED, error=error)
    names = ', '.join(str(race.kart(number) or number) for number in offered.karts) or 'no kart'
    lines = [
        f'{label}: nothing was sent. The command is for {names}.',
        *_effects(command, race, 0, found),
        _line(wanted, race, offered.karts, '' if wanted.stated else offered.statement),
    ]
    return Told(Exit.USAGE, error='\n'.join(lines))


def _line(wanted: argparse.Namespace, race: Snapshot, karts: Sequence[int], unsaid: str) -> str:
    """
    Return the line to type so that a command is sent with these karts.

    :param unsaid: the statement that the line adds; empty if none is missing.
    """
    entry = CATALOGUE[COMMANDS[wanted.command]]
    flag, _ = entry.flag or ('', '')
    parts = [wanted.command, getattr(wanted, 'kart', ''), getattr(wanted, 'heat', ''), *karts]
    parts.append(flag if wanted.stated or unsaid else '')
    parts += ['--closes', race.track.opening] if entry.names_number and race.track.open else []
    parts += ['--official', tidy(wanted.official)] if wanted.official else []
    called = os.environ.get('EVGP_CTL', 'rcs_ctl %s')  # by make, or by the package's commands
    line = called.replace('%s', shlex.join(str(part) for part in parts if part != ''))
    return f'{f"If you state that {unsaid}" if unsaid else "To send it"}, type: {line}'


def _effects(
    command: CommandKind, race: Snapshot, kart: int, found: Standings | None
) -> list[str]:
    """Return the sentences of the window's question before a command."""
    button = Screen(race, 0.0, {}, None, found).button(command, kart)
    assert button is not None
    question = button.question()
    return [*question.sentences, *filter(None, [question.caution])]


def _watch(
    client: Client,
    hearing: Hearing,
    wanted: argparse.Namespace,
    until: float,
    alive: Callable[[], object],
) -> Told:
    if wanted.events:
        return _watch_events(client, hearing, wanted, until, alive)
    hearing.looking = looking(client.topic)
    if wanted.once:
        hearing.wait_for(lambda: hearing.race is not None, until)
        hearing.wait_for(lambda: hearing.results is not None, min(until, now() + SETTLED))
    redraw = _is_at(wanted)
    official, said_at = Signature().name, now()
    while True:
        with hearing.news:
            at = now()
            screen = hearing.screen(at, {})
        danger = screen.danger
        lines = [f'*** {danger.title}: {danger.advice} ***', danger.detail] if danger else []
        if screen.snapshot is not NOTHING:
            lines += table(screen)
        text = '\n'.join(lines)
        if wanted.once:
            code = Exit.NOT_THERE if screen.stale else Exit.ACCEPTED
            return Told(code, text)
        print(('\x1b[H\x1b[2J' if redraw else '') + text + ('' if redraw else '\n'), flush=True)
        alive()
        # Rounds begin with snapshots, every 0.5 s or a little less; none may be left out.
        if at - said_at >= PRESENCE_PERIOD / 2:
            client.announce(official, texts.GONE_REASON if screen.stale else '')
            said_at = at
        with hearing.news:
            hearing.news.wait(1.0)


def _show_results(client: Client, hearing: Hearing, until: float) -> Told:
    hearing.wait_for(lambda: hearing.race is not None and hearing.results is not None, until)
    with hearing.news:
        race, found, heard_at = hearing.race, hearing.results, hearing.heard_at
    if race is None:
        return _not_found(client)
    found = present(found, race.stamp + now() - heard_at)
    if found is None:
        return _under_banner(Told(Exit.NOT_THERE, error=texts.NO_TIMING), race)
    teams = {kart.number: kart.team for kart in race.karts}
    lines = [results.title(found)]
    if found.grid:
        lines.append(texts.GRID.format(karts=', '.join(map(str, found.grid))))
    if found.karts or found.overall:
        lines += aligned(results.table(found, teams))
    lines += [f'For the timekeeper: {each}' for each in found.questions]
    if found.races:
        headings = 'Races: number, time the grid formed, heat, classified karts'
        lines += ['', headings, *aligned(results.races(found))]
    if found.passings:
        headings = 'Passings: time since GREEN GREEN, kart, source, session and number, outcome'
        lines += ['', headings, *aligned(results.passings(found))]
    return _under_banner(Told(Exit.ACCEPTED, '\n'.join(lines)), race)


def _watch_events(
    client: Client,
    hearing: Hearing,
    wanted: argparse.Namespace,
    until: float,
    alive: Callable[[], object],
) -> Told:
    shown, banner = 0, ''
    # The snapshot has the banner, which is printed first.
    hearing.wait_for(lambda: hearing.race is not None, until)
    while True:
        # Past events arrive one by one; they are complete once no further event follows.
        ends = now() + SETTLED if shown or now() >= until else until
        hearing.wait_for(lambda known=shown: len(hearing.events) > known, ends)
        with hearing.news:
            fresh = hearing.events[shown:]
            heard = hearing.race is not None
            said, banner = banner, hearing.race.banner if hearing.race else ''
        shown += len(fresh)
        if not shown and not heard:
            return _not_found(client)
        lines = [
            f'{time_of_day(wall_ns // 1_000_000_000)} {" " if event.success else "!"} '
            f'{said_by(event.text, event.official)}'
            for _, wall_ns, _, event in fresh
            if not wanted.kart or event.kart in (0, wanted.kart)
        ]
        if banner != said and banner:
            lines.insert(0, texts.BANNER.format(banner=banner))
        if lines:
            print('\n'.join(lines), flush=True)
        if not wanted.once:
            alive()
        elif not fresh or now() >= until:
            return Told(Exit.ACCEPTED)
