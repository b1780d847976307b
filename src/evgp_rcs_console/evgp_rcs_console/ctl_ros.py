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
from evgp_rcs_console.catalogue import CATALOGUE, Kind
from evgp_rcs_console.client import Client, domain_of, looking, PRESENCE_PERIOD
from evgp_rcs_console.command_line import COMMANDS, Exit, GRACE, STARTING, Told
from evgp_rcs_console.commands import Given, Standing
from evgp_rcs_console.settings import Signature
from evgp_rcs_console.view import aligned, Latest, Screen, table
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
    command = COMMANDS.get(wanted.command)
    commands = () if command is None else (command,)
    try:
        client = Client('rcs_ctl', hearing, commands=commands, there='rcs_ctl' * _is_at(wanted))
    except RCLError as error:
        return _cannot(wanted, texts.NOT_ALLOWED.format(error=error))
    parts.callback(client.close)
    ready = now()
    until = min(ready, began + STARTING - GRACE) + float(wanted.wait)
    terminal = Terminal(client, hearing, wanted, until)
    if wanted.command == 'watch':
        return terminal.watch_events(alive) if wanted.events else terminal.watch(alive)
    try:
        told = terminal.show_results() if command is None else terminal.give(ready - began)
    except KeyboardInterrupt:
        if hearing.given is None:
            raise
        error = hearing.answer[1].message if hearing.answer else _interrupted(hearing)
        told = Told(Exit.NOT_THERE, error=error)
    return _under_banner(told, hearing.race)


class Terminal:
    """
    Carries out one command line, and returns what it has come to.

    :param wanted: the parsed command line.
    :param until: when the time to wait for race control ends, in seconds.
    """

    def __init__(
        self, client: Client, hearing: Hearing, wanted: argparse.Namespace, until: float
    ) -> None:
        self._client, self._hearing = client, hearing
        self._wanted, self._until = wanted, until
        self._where = f'{client.topic}, ROS domain {domain_of()}'

    def give(self, starting: float) -> Told:
        """Send a command and return the answer; ROS took ``starting`` seconds to start."""
        hearing, wanted, until = self._hearing, self._wanted, self._until
        command, kart = COMMANDS[wanted.command], getattr(wanted, 'kart', 0)
        entry = CATALOGUE[command]
        waited = max(0.0, until - now())
        details = f'once ROS had started, which took {starting:.1f} s; {self._where}'
        if not entry.stop and not self._client.wait_for(command, until - now()):
            not_there = texts.not_there(command, entry.label)
            return Told(Exit.NOT_THERE, error=f'{not_there} ({self._where})')
        given = Given(
            command,
            kart,
            wanted.stated,
            {name: getattr(wanted, name) for name in entry.takes if hasattr(wanted, name)},
            official=Signature(wanted.official).claim,
        )
        released: list[str] = []
        takes, named = {*entry.takes}, given.taken.get('karts')
        if takes & {'hold', 'opening'} or ('karts' in takes and not named):
            if not hearing.wait_for(lambda: hearing.race is not None, until):
                return Told(Exit.NOT_THERE, error=texts.no_answer(given, waited, details))
            race = hearing.race
            assert race is not None
            seen = _as_seen(given, race, wanted)
            if seen is None:
                # The answer mentions the timekeeper's results, if any arrive.
                hearing.wait_for(lambda: hearing.results is not None, min(until, now() + SETTLED))
                return self._name_them(command, race)
            given = seen
            if race.kart(kart) is not None:
                released = self._effects(command, race, kart)
        hearing.given = given
        self._client.give(given)
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
        steps = [] if hearing.race is None else self._next_step(given, hearing.race)
        return Told(Exit.REFUSED, error='\n'.join([answer.message, *steps]))

    def _next_step(self, given: Given, race: Snapshot) -> list[str]:
        """Return what to type after a refusal, if only karts or a statement were missing."""
        form = CATALOGUE[given.command]
        if not isinstance(given.command, CommandKind):
            return []
        offered = (race.kart(given.kart) or race).offered(given.command)
        if not offered.available:
            return []
        karts = offered.karts if 'karts' in form.takes else ()
        others = set(karts) != set(given.taken.get('karts', ()))
        unsaid = '' if given.stated or form.call_is_statement else offered.statement
        if not others and not unsaid:
            return []
        effects = self._effects(given.command, race, 0) if others else []
        return [*effects, self._line(race, karts, unsaid)]

    def _name_them(self, command: Kind, race: Snapshot) -> Told:
        """Return the karts that a command would start or release, without sending anything."""
        assert isinstance(command, CommandKind)
        offered, label = race.offered(command), CATALOGUE[command].label
        if not offered.available:
            reason = offered.reason or 'race control does not offer it'
            error = f'{label}: nothing was sent. The command is not possible now: {reason}.'
            return Told(Exit.REFUSED, error=error)
        karts = ', '.join(str(race.kart(number) or number) for number in offered.karts)
        lines = [
            f'{label}: nothing was sent. The command is for {karts or "no kart"}.',
            *self._effects(command, race, 0),
            self._line(race, offered.karts, '' if self._wanted.stated else offered.statement),
        ]
        return Told(Exit.USAGE, error='\n'.join(lines))

    def _line(self, race: Snapshot, karts: Sequence[int], unsaid: str) -> str:
        """Return the line to type for these karts, with the statement that is still unsaid."""
        wanted = self._wanted
        entry = CATALOGUE[COMMANDS[wanted.command]]
        flag, _ = entry.flag or ('', '')
        parts = [wanted.command, getattr(wanted, 'kart', ''), getattr(wanted, 'heat', ''), *karts]
        parts.append(flag if wanted.stated or unsaid else '')
        if 'opening' in entry.takes and race.track.open:
            parts += ['--closes', race.track.opening]
        parts += ['--official', tidy(wanted.official)] if wanted.official else []
        called = os.environ.get('EVGP_CTL', 'rcs_ctl %s')  # by make, or by the package's commands
        line = called.replace('%s', shlex.join(str(part) for part in parts if part != ''))
        return f'{f"If you state that {unsaid}" if unsaid else "To send it"}, type: {line}'

    def _effects(self, command: Kind, race: Snapshot, kart: int) -> list[str]:
        """Return the sentences of the window's question before a command."""
        assert isinstance(command, CommandKind)
        one, screen = race.kart(kart), Screen(race, heard=self._hearing.results)
        button = screen.race_button(command) if one is None else screen.kart_button(command, one)
        return [*button.question.sentences, *filter(None, [button.question.caution])]

    def watch(self, alive: Callable[[], object]) -> Told:
        """Show the race until Ctrl-C, or once."""
        client, hearing, wanted, until = self._client, self._hearing, self._wanted, self._until
        hearing.looking = looking(client.topic)
        if wanted.once:
            hearing.wait_for(lambda: hearing.race is not None, until)
            hearing.wait_for(lambda: hearing.results is not None, min(until, now() + SETTLED))
        official, said_at = Signature().name, now()
        while True:
            with hearing.news:
                at = now()
                screen = hearing.screen(at, {})
            danger = screen.danger
            lines = []
            if danger.title:
                lines += [f'*** {danger.title}: {danger.advice} ***', danger.detail]
            if screen.snapshot is not NOTHING:
                lines += table(screen)
            text = '\n'.join(lines)
            if wanted.once:
                code = Exit.NOT_THERE if screen.danger.stale else Exit.ACCEPTED
                return Told(code, text)
            print(f'\x1b[H\x1b[2J{text}' if _is_at(wanted) else f'{text}\n', flush=True)
            alive()
            # Rounds begin with snapshots, every 0.5 s or a little less; none may be left out.
            if at - said_at >= PRESENCE_PERIOD / 2:
                client.announce(official, texts.GONE_REASON if screen.danger.stale else '')
                said_at = at
            with hearing.news:
                hearing.news.wait(1.0)

    def show_results(self) -> Told:
        """Show laps, places, the last passings and the races of the event."""
        hearing = self._hearing
        hearing.wait_for(lambda: None not in (hearing.race, hearing.results), self._until)
        with hearing.news:
            screen = hearing.screen(now(), {})
        if screen.snapshot is NOTHING:
            return self._not_found()
        found = screen.results
        if found is None:
            return Told(Exit.NOT_THERE, error=texts.NO_TIMING)
        lines = [results.title(found)]
        if found.grid:
            lines.append(f'Grid: {", ".join(map(str, found.grid))}')
        if found.karts or found.overall:
            lines += aligned(results.table(found, screen.teams))
        lines += [f'For the timekeeper: {each}' for each in found.questions]
        races = 'Races: number, time the grid formed, heat, classified karts'
        passings = 'Passings: time since GREEN GREEN, kart, source, session and number, outcome'
        for headings, listed in (
            (races, results.races(found)),
            (passings, results.passings(found)),
        ):
            lines += ['', headings, *aligned(listed)] if listed else []
        return Told(Exit.ACCEPTED, '\n'.join(lines))

    def watch_events(self, alive: Callable[[], object]) -> Told:
        """Print one event per line until Ctrl-C, or only the past ones."""
        hearing, wanted, until = self._hearing, self._wanted, self._until
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
                return self._not_found()
            lines = [
                f'{time_of_day(wall_ns // 1_000_000_000)} {" " if event.success else "!"} '
                f'{said_by(event.text, event.official)}'
                for _, wall_ns, _, event in fresh
            ]
            if banner != said and banner:
                lines.insert(0, texts.BANNER.format(banner=banner))
            if lines:
                print('\n'.join(lines), flush=True)
            if not wanted.once:
                alive()
            elif not fresh or now() >= until:
                return Told(Exit.ACCEPTED)

    def _not_found(self) -> Told:
        return Told(Exit.NOT_THERE, error=f'{texts.NOT_YET} ({self._where})')


def _cannot(wanted: argparse.Namespace, why: object) -> Told:
    """Return why `rcs_ctl` cannot take part in the graph, and that a command was not sent."""
    unsent = f'\n{wanted.parser.unsent}' if wanted.command in COMMANDS else ''
    return Told(Exit.USAGE, error=f'rcs_ctl: {why}{unsent}')


def _is_at(wanted: argparse.Namespace) -> bool:
    """Return whether an official at this terminal sees the race."""
    sees = wanted.command == 'watch' and not (wanted.once or wanted.events)
    return sees and sys.stdout.isatty()


def _as_seen(given: Given, race: Snapshot, wanted: argparse.Namespace) -> Given | None:
    """
    Return a command with the hold, or the opening of the track, that the race shows.

    Return None if the official must name karts or the opening first.
    """
    entry, track = CATALOGUE[given.command], race.track
    if 'hold' in entry.takes:
        kart = race.kart(given.kart)
        return replace(given, taken={'hold': kart and kart.hold})
    assert isinstance(given.command, CommandKind)
    offered = race.offered(given.command)
    # If IN GARAGE concerns no kart, none need be named.
    concerns_none = offered.available and not offered.karts and given.stated
    if not given.taken['karts'] and not concerns_none:
        return None
    if 'opening' not in entry.takes:
        return given
    opening = wanted.closes
    if opening is None and track.open:
        return None
    opening = track.opening if opening is None else opening
    return replace(given, taken={**given.taken, 'opening': opening})


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
