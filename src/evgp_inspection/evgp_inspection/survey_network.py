# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
`survey_network` shows whether the karts' network is good enough on the whole track.

It plays race control for karts that are driven, pushed or carried round the track. It sends only
IN_GARAGE, at race control's rate and with race control's socket options, and measures when each
kart's TCP answers. It does not need ROS.
"""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Callable, Mapping, Sequence
import contextlib
import datetime
import socket
import sys

from evgp_inspection.inspector import stopped_by_signals, Terminal, WORD
from evgp_inspection.limits import SurveyLimits
from evgp_inspection.report import deliver
from evgp_inspection.survey import LinkSurvey, LOST, Mark, Report
from evgp_inspection.traces import BEAT
from evgp_inspection.verdicts import Verdict
from evgp_protocol.clock import now as clock_now
from evgp_protocol.frames import encode
from evgp_protocol.link import Answers, Grade, make_prompt, read, unanswered, unsent
from evgp_protocol.loop import run
from evgp_protocol.states import RaceState

FRAME = encode(RaceState.IN_GARAGE)
"""The only frame that is sent."""

LOOK_EVERY = 0.01
"""Time between two looks for answers, in seconds. It limits the precision of the round trips."""

SURVEY_CONDITIONS = """\
  1. Race control is not running, and NO STOP IS IN FORCE. The survey sends IN_GARAGE to each kart
     that connects, which gives the kart to its team, whatever stopped it before.
  2. Everyone on the track knows that teams may move their karts there."""

EXAMPLE = 'PYTHONPATH=src/evgp_protocol python3 kit/python/example.py ADDRESS'
"""The command that makes a laptop act as a kart. ADDRESS is this computer's address."""


class Link(asyncio.Protocol):
    """One connection of a kart, on which the kart's replies are ignored."""

    transport: asyncio.Transport
    socket: socket.socket
    address = ''

    def __init__(self, surveyor: Surveyor) -> None:
        self.answers = Answers()
        self.resent = 0
        self.why = 'the kart closed the connection'
        self._surveyor = surveyor

    def send(self, now: float) -> None:
        """Send the frame, unless an earlier one is still unsent."""
        waits = self.transport.get_write_buffer_size() + unsent(self.socket)
        if not waits and self.answers.may_beat(now):
            self.answers.wrote(len(FRAME), now)
            self.transport.write(FRAME)

    def look(self, now: float) -> list[float]:
        """Return the round trips of the frames answered since the last look, in seconds."""
        waits = self.transport.get_write_buffer_size() + unanswered(self.socket)
        return self.answers.look(waits, now)

    def newly_resent(self) -> int:
        """Return the number of segments retransmitted since the last call."""
        info = read(self.socket)
        before, self.resent = self.resent, self.resent if info is None else info.retransmitted
        return self.resent - before

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        self.socket = transport.get_extra_info('socket')
        make_prompt(self.socket)
        self._surveyor.opened(self, transport.get_extra_info('peername')[0])

    def connection_lost(self, exc: Exception | None) -> None:
        self._surveyor.lost(self, self.why if exc is None else str(exc))


class Surveyor:
    """
    Sends IN_GARAGE to every kart that connects, and measures.

    :param tell: called with a sentence about each event.
    :ivar karts: the surveys, by the karts' addresses.
    :ivar held_up: the maximum delay of this computer itself, in seconds.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self.karts: dict[str, LinkSurvey] = {}
        self.marks: list[Mark] = []
        self.held_up = 0.0
        self._tell = tell
        self._links: dict[str, Link] = {}
        self._began = clock_now()

    @property
    def now(self) -> float:
        """Return the time since the start, in seconds."""
        return clock_now() - self._began

    def mark(self, name: str) -> None:
        """Mark the kart's current place with a name."""
        self.marks.append(Mark(self.now, name or f'mark {len(self.marks) + 1}'))
        self._tell(f'Marked: {self.marks[-1].name}')

    async def survey(
        self,
        host: str,
        port: int,
        stopping: asyncio.Event,
        listening: Callable[[int], None],
        second: Callable[[], None],
    ) -> None:
        """
        Survey until ``stopping`` is set.

        :param listening: called with the port once karts can connect.
        :param second: called at the end of each second.
        :raises OSError: if this computer cannot listen there.
        """
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: Link(self), host, port, family=socket.AF_INET)
        try:
            listening(server.sockets[0].getsockname()[1])
            beat_due = second_due = due = self.now
            while not stopping.is_set():
                now = self.now
                self.held_up = max(self.held_up, now - due)
                self._look(now)
                if now >= beat_due:
                    beat_due = max(beat_due + BEAT, now)
                    for link in self._links.values():
                        link.send(now)
                if now >= second_due:
                    second_due = max(second_due + 1.0, now)
                    self._end_second(now)
                    second()
                due = now + LOOK_EVERY  # the looks, too, may have been held up
                await asyncio.sleep(LOOK_EVERY)
            self._look(self.now)
            self._end_second(self.now)
        finally:
            server.close()
            links, self._links = self._links, {}
            for link in links.values():
                link.transport.abort()

    def _look(self, now: float) -> None:
        for address, link in list(self._links.items()):
            self.karts[address].answered(link.look(now), now)
            if link.answers.age(now) >= LOST:
                self._give_up(link, f'no answer for {LOST:g} s')

    def _end_second(self, now: float) -> None:
        for address, kart in self.karts.items():
            link = self._links.get(address)
            if link is not None:
                kart.retransmitted(link.newly_resent())
            kart.second(now, 0.0 if link is None else link.answers.age(now))

    def opened(self, link: Link, address: str) -> None:
        """Accept a new connection, which replaces an earlier one."""
        now = self.now
        if address in self._links:
            self._give_up(self._links[address], 'a new connection replaced it')
        link.address = address
        self._links[address] = link
        self.karts.setdefault(address, LinkSurvey()).opened(now)
        self._tell(f'{address} is connected.')
        link.send(now)

    def _give_up(self, link: Link, why: str) -> None:
        self.lost(link, why)
        link.transport.abort()

    def lost(self, link: Link, why: str) -> None:
        """Record the end of a connection, unless it was already recorded."""
        if self._links.get(link.address) is not link:
            return
        del self._links[link.address]
        now, kart = self.now, self.karts[link.address]
        kart.retransmitted(link.newly_resent())
        kart.lost(why, now, link.answers.look(0, now))
        self._tell(f'LOST {link.address}: {why}.')


def figures_now(karts: Mapping[str, LinkSurvey]) -> str:
    """Return the current figures of every kart, worst grade first."""
    found = []
    grades = list(Grade)
    order = sorted(karts.items(), key=lambda each: grades.index(each[1].grade), reverse=True)
    for address, kart in order:
        second = kart.seconds[-1]
        if not second.connected:
            found.append(f'{address} NO LINK for {second.silence:.1f} s')
            continue
        trip = '-' if second.round_trip is None else f'{second.round_trip * 1000:.0f}'
        found.append(
            f'{address} {kart.grade.value}: {trip} ms, '
            f'worst {second.worst * 1000:.0f} (ever {kart.worst * 1000:.0f}) ms, '
            f'silence {second.silence:.2f} s, {second.retransmitted} resent'
        )
    return ' | '.join(found) or 'No kart is connected yet.'


def survey_network(arguments: Sequence[str] | None = None) -> int:
    """Survey the network; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='survey_network',
        description='Play race control, in IN_GARAGE only, for karts that are driven, pushed or '
        "carried round the track, and measure each kart's link. Race control must not be running.",
        epilog='Exit codes: 0 passed; 2 not passed: a limit was broken, too little was measured, '
        'or wrong usage. To make a laptop a kart: ' + EXAMPLE,
    )
    parser.add_argument(
        '--word', default='', help=f'"{WORD}" confirms what the survey asks at the start'
    )
    options, limits = SurveyLimits.parse(parser, arguments, 'surveys')
    try:
        report = run(_survey(options, limits))
    except (OSError, OverflowError) as error:  # OverflowError: a port above 65535
        print(
            f'The survey cannot start: {error}. Race control must not be running on this '
            "computer, and --listen must be one of this computer's addresses",
            file=sys.stderr,
        )
        return Verdict.NOT_JUDGED.exit_code
    if report is None:
        print(f'The survey did not start: the word was not "{WORD}".', file=sys.stderr)
        return Verdict.NOT_JUDGED.exit_code
    text = report.text()
    deliver(text.rstrip(), options.report, 'survey', report.began, {'txt': text})
    return report.verdict.exit_code


class AtTerminal(Terminal):
    """Somebody at a terminal, each of whose lines marks a place."""

    surveyor: Surveyor

    def on_key(self, key: str) -> None:
        self.edit(key, self.surveyor.mark)


async def _survey(options: argparse.Namespace, limits: SurveyLimits) -> Report | None:
    """Survey until a signal or Ctrl-D; None if the word was not typed."""
    stopping = stopped_by_signals()
    terminal = AtTerminal(stopping, options.word)

    def listening(port: int) -> None:
        terminal.tell(
            f'Waiting for karts on port {port}. To make a laptop a kart: {EXAMPLE} {port}\n'
            'At each place, type its name and press Enter. End the survey with Ctrl-C before you '
            'switch the kart off.'
        )

    with contextlib.closing(terminal), terminal.reading():
        if not await terminal.confirm(SURVEY_CONDITIONS):
            return None
        began = datetime.datetime.now().astimezone()
        surveyor = terminal.surveyor = Surveyor(terminal.tell)
        await surveyor.survey(
            options.listen,
            options.port,
            stopping,
            listening,
            lambda: terminal.show(figures_now(surveyor.karts)),
        )
    return Report(
        began=began,
        seconds=surveyor.now,
        karts=surveyor.karts,
        marks=surveyor.marks,
        held_up=surveyor.held_up,
        limits=limits,
    )
