# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ``timekeeper`` node counts laps and publishes results.

It has two inputs: events from race control, and passings, which are reports that something crossed
the timing line. It runs on race control's machine, because both use that machine's clock. Karts do
not depend on the timekeeper: if it ends, hangs or makes a mistake, the race continues, and screens
show that there is no timing. The only command that it sends to race control is FINISH, in a heat
with `auto_finish`.

The executor's thread does all the work, and the main thread closes the node. The timekeeper writes
events and passings into its book (``book``) before it acts on them.

Passings are batched for a moment, so that even a flood of them needs few writes. After a start or
a hang, they also wait for race control's events, which show which race each passing belongs to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import math
import os
import pathlib
import sys
import threading
import time
from typing import Any

from evgp_node.codec import message_of, value_of
from evgp_node.entries import OF_TIMEKEEPER
from evgp_node.folder import rcs_folder
from evgp_node.official import heard, tidy, TIMEKEEPER
from evgp_node.parameters import ParameterError, StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_node.qos import latched
from evgp_node.results import Act, BY_HAND, Corrected, Correction, Identity, Passing, Standings
from evgp_node.roster import load_roster, RosterError
from evgp_node.stamps import seconds_of
from evgp_node.stream import Gap
from evgp_node.stream_file import BOOK
from evgp_protocol import clock
from evgp_rcs_msgs import msg, srv
from evgp_rcs_msgs.srv import KartFinish
from evgp_timing.book import Book, BookError
from evgp_timing.corrections import CORRECTIONS
from evgp_timing.desk import (
    Answer,
    Desk,
    Finish,
    Heard,
    Input,
    Passed,
    Roster,
    Terms,
    Told,
    What,
)
from evgp_timing.laps import LapSettings
from rclpy.clock import Clock, ClockType
from rclpy.task import Future

RESULTS_QOS = latched(1)
"""QoS of ``~/results``, which gives a late subscriber the current results at once."""

EVENTS_QOS = latched(200)
"""QoS of race control's events, the same as their publisher's."""

ARRIVING_QOS = latched(1000)
"""QoS of ``passings``. Passings that a source published before DDS discovered it also arrive."""

DUE_EVERY = 0.2
"""Time between two checks for passings to process, results to publish or FINISH to request, in
seconds."""

GATHERED = 0.05
"""Maximum time between passings that count as having arrived together, in seconds."""

HANG = 1.0
"""Time without any activity after which the timekeeper counts as having been away, in seconds."""

CATCH_UP = 3.0
"""Time after an absence during which missed messages may still arrive, in seconds."""

SHOWN_EVERY = 1.0
"""Maximum time between two publications of the results, in seconds."""

KEPT_EVERY = 10.0
"""Maximum time until the timekeeper writes changed results, and the number of the last event, into
its book, in seconds."""

FINISH_EVERY = 2.0
"""Time after which the timekeeper requests a FINISH again that got no answer, in seconds. A FINISH
that race control refuses, as for a kart that was stopped, would be refused every time."""

_COMMANDS = {
    msg.CommandAvailability.GRID_ACTIVE: What.GRID_ACTIVE,
    msg.CommandAvailability.KART_FINISH: What.FINISH,
    msg.CommandAvailability.KART_UNDO_FINISH: What.UNDO_FINISH,
    msg.CommandAvailability.KART_IN_GARAGE: What.LEFT,
    msg.CommandAvailability.LEAVE_RACE: What.LEFT,
}
"""What an accepted command means for the laps of a race."""


def told_of(event: msg.RaceEvent, run: str) -> Told | None:
    """Return how an event from race control affects the laps; None if it does not."""
    what, state = None, event.state.state
    is_green = state == msg.RaceState.GREEN_GREEN
    if event.kind == msg.RaceEvent.COMMAND and event.success:
        what = _COMMANDS.get(event.command)
    # The event of the command already means GRID_ACTIVE.
    elif event.kind == msg.RaceEvent.RACE_STATE and state != msg.RaceState.GRID_ACTIVE:
        what = What.GREEN_GREEN if is_green else What.OVER
    elif event.kind == msg.RaceEvent.KART_STATE and is_green:
        what = What.SENT_GREEN
    if what is None:
        return None
    at = seconds_of(event.monotonic)
    return Told(at, what, run, event.race, event.heat, event.kart, event.sequence)


def passing_of(message: msg.Passing) -> Passing:
    """
    Return the passing in a message, with values that the book can store.

    A time before 1970 becomes 1970, and names become one printable line. A source with the name
    reserved for officials' passings is renamed.
    """
    passing = value_of(message, Passing)
    source = tidy(passing.source)
    return passing._replace(
        source='' if source == BY_HAND else source,
        session=tidy(passing.session),
        transponder=tidy(passing.transponder),
        stamp_ns=max(0, passing.stamp_ns),
    )


def read_roster(path: pathlib.Path) -> Roster:
    """
    Return the part of a roster file that timing uses.

    :raises RosterError: if the file cannot be read or is not a roster.
    """
    roster = load_roster(path)
    owners = {name: each.number for each in roster.entries for name in each.transponders}
    return Roster(tuple(each.number for each in roster.entries), owners, roster.heats)


class Timekeeper(StrictNode):
    """
    The timekeeper's node.

    :param node_options: further arguments for rclpy's node.
    :raises ParameterError: if a parameter is wrong.
    :raises RosterError: if the roster is wrong.
    :raises BookError: if the book cannot be used.
    """

    def __init__(self, _: OnFailure, **node_options: Any) -> None:
        """Restore this event's races from the book and start to listen."""
        super().__init__('timekeeper', **{'namespace': 'rcs', **node_options})
        self._roster, book, self._settings = read_settings(self)
        roster = read_roster(self._roster)
        self._desk = Desk(roster, self._settings)
        self._last: dict[str, int] = {}  # number of the newest event of each run
        self._book = Book(book)
        self._awake = -math.inf
        for each in self._book.known():
            if isinstance(each, Gap):
                self.get_logger().warning(f'{book}: {each}')
            else:
                self._feed(each)
                self._awake = max(self._awake, each.at)
        now = clock.now()
        self._take(Terms(now, roster, self._settings))
        self._away_since = min(now, self._awake) if self._desk.races else now
        self._back = self._awake = now
        self._waiting: list[Passed] = []
        self._turn = threading.Lock()
        self._ended = False
        self._asked: dict[Finish, tuple[float, Future]] = {}
        self._shown: Standings | None = None
        self._kept_at = self._noted_at = -math.inf
        self._kept: Mapping[int, tuple[object, ...]] = {}  # what the book has of each race
        self._results = self.create_publisher(msg.Results, '~/results', RESULTS_QOS)
        self._finish = self.create_client(KartFinish, 'kart/finish')
        for act, entry in CORRECTIONS.items():
            if act is not Act.RESTORE:
                name = entry.service.removeprefix(OF_TIMEKEEPER)
                self._offer(name, getattr(srv, entry.service_type), act)
        subscribe = self.create_subscription
        subscribe(msg.RaceEvents, 'events', self._alone(self._hear), EVENTS_QOS)
        subscribe(msg.Passing, 'passings', self._alone(self._see), ARRIVING_QOS)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(DUE_EVERY, self._alone(self._look), clock=steady)
        known = f'with {len(self._desk.races)} races of this event'
        self.get_logger().info(f'The timekeeper keeps its book in {book}, {known}')

    def close(self) -> None:
        """Write the current results into the book and close it."""
        with self._turn:
            self._ended = True
            self._keep(clock.now())
            self._book.close()

    def _alone(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Return a callback that never runs at the same time as another, or on a closed node."""

        def run(*arguments: Any) -> None:
            with self._turn:
                if not self._ended:
                    now = clock.now()
                    if now - self._awake > HANG:
                        self._away_since, self._back = self._awake, now
                    self._awake = now
                    callback(*arguments)

        return run

    # ----- inputs -------------------------------------------------------------------------

    def _take(self, *given: Input) -> None:
        """Write inputs into the book and process them."""
        self._write(*given)
        for each in given:
            self._feed(each)

    def _write(self, *given: Input | Standings) -> bool:
        """Write entries into the book and return whether they are in it."""
        try:
            self._book.write(*given)
        except OSError as error:
            self.get_logger().error(f'{error}. After a restart, or in the report, this is missing')
            return False
        return True

    def _feed(self, given: Input) -> Answer | None:
        if isinstance(given, (Told, Heard)):
            self._last[given.run] = max(given.sequence, self._last.get(given.run, 0))
        return self._desk.feed(given)

    def _hear(self, message: msg.RaceEvents) -> None:
        self._take_waiting()
        for event in message.events:
            last = self._last.get(message.run, 0)
            if event.sequence <= last:
                continue
            if missed := event.sequence - 1 - last:
                self._take(Heard(clock.now(), message.run, event.sequence - 1, missed))
            self._last[message.run] = event.sequence
            told = told_of(event, message.run)
            if told is not None:
                self._take(told)
            if event.command == msg.CommandAvailability.TAKE_ROSTER and event.success:
                self._read_roster()
        now = clock.now()
        if message.events and now - self._noted_at > KEPT_EVERY:
            self._noted_at = now
            self._take(Heard(now, message.run, self._last[message.run]))
        self._look()

    def _read_roster(self) -> None:
        try:
            self._take(Terms(clock.now(), read_roster(self._roster), self._settings))
            self.get_logger().info(f'Reloaded {self._roster}, because race control did')
        except RosterError as error:
            self.get_logger().error(f'The old roster stays in use: {error}')

    def _see(self, message: msg.Passing) -> None:
        now, passing = clock.now(), passing_of(message)
        if self._waiting and now - self._waiting[-1].at < GATHERED:
            together = *self._waiting[-1].passings, passing
            self._waiting[-1] = self._waiting[-1]._replace(passings=together)
        else:
            self._waiting.append(Passed(now, (passing,)))

    @property
    def _catches_up(self) -> bool:
        """Return whether messages that were missed during an absence may still arrive."""
        return self._awake - self._back < CATCH_UP

    def _take_waiting(self) -> None:
        """Process the passings that are waiting, unless missed messages may still arrive."""
        if not self._waiting or self._catches_up:
            return
        waiting, self._waiting = self._waiting, []
        self._take(
            *(
                each._replace(away=self._back - self._away_since)
                if each.at - self._back < CATCH_UP
                else each
                for each in waiting
            )
        )

    def _offer(self, name: str, kind: type[Any], act: Act) -> None:
        def serve(request: Any, response: Any) -> None:
            self._take_waiting()
            asked = asked_for(act, request)
            given = self._desk.about(Corrected(clock.now(), asked))
            answer = self._feed(given)
            assert answer is not None
            if answer.success:
                self._write(given)
                self._keep(given.at)
            response.success, response.message = answer.success, answer.text
            self.get_logger().info(f'{answer.text} [{heard(request.official)}]')

        alone = self._alone(serve)

        def answered(request: Any, response: Any) -> Any:
            response.message = 'the timekeeper is shutting down'
            alone(request, response)
            return response

        self.create_service(kind, f'~/{name}', answered)

    # ----- outputs ------------------------------------------------------------------------

    def _look(self) -> None:
        self._take_waiting()
        now = clock.now()
        seen, last = self._desk.standings(now), self._shown
        if last is None or seen[1:] != last[1:] or now - last.stamp > SHOWN_EVERY:
            self._shown = seen
            wall_ns = time.time_ns() - round(now * 1e9)
            self._results.publish(message_of(seen, msg.Results, wall_ns))
        if now - self._kept_at > KEPT_EVERY:
            self._keep(now)
        if self._catches_up:
            return
        for wanted in self._desk.finishes():
            asked_at, call = self._asked.get(wanted, (-math.inf, None))
            if now - asked_at > FINISH_EVERY and not (call and call.done()):
                if call is not None:
                    self._finish.remove_pending_request(call)
                self._asked[wanted] = now, self._ask_for(wanted)

    def _keep(self, now: float) -> None:
        """Write the results of each race that has changed into the book, for reports."""
        self._kept_at = now
        listed = zip(self._desk.races, self._desk.standings(now).races, strict=True)
        known = {row.number: (race.laps, race.published, row.counts) for race, row in listed}
        new = [number for number, each in known.items() if each != self._kept.get(number)]
        results = [self._desk.standings(now, self._desk.races[number - 1]) for number in new]
        if results and self._write(*results):
            self._kept = known

    def _ask_for(self, wanted: Finish) -> Future:
        call = self._finish.call_async(KartFinish.Request(official=TIMEKEEPER, **wanted._asdict()))
        call.add_done_callback(lambda done: self.get_logger().info(done.result().message))
        return call


def asked_for(act: Act, request: Any) -> Correction:
    """Return the correction that a request to this act's service asks for."""
    if act is Act.STRIKE and not request.struck:
        act = Act.RESTORE
    entry = CORRECTIONS[act]
    taken = {name: getattr(request, name) for name in entry.takes}
    if entry.to_one_kart:
        taken['kart'] = request.kart
    taken = {name: tidy(each) if isinstance(each, str) else each for name, each in taken.items()}
    if 'source' in taken:
        names = (taken.pop('source'), taken.pop('session'), taken.pop('number'))
        taken['passing'] = Identity(*names)
    return Correction(act, heard(request.official), **taken)


def read_settings(node: StrictNode) -> tuple[pathlib.Path, pathlib.Path, LapSettings]:
    """
    Declare every parameter of the node, and return the paths of roster and book, and the rest.

    :raises ParameterError: if a parameter is wrong.
    """
    declare, default = node.declare, LapSettings
    roster = declare('roster', '', "Race control's roster: the file that lists the karts.")
    book = declare('book', '', 'The book, a file. Empty: evgp_rcs/timing.sqlite3 in ROS_HOME.')
    settings = LapSettings(
        min_lap_time=declare(
            'min_lap_time',
            default.min_lap_time,
            'Time after a counted passing during which the next one is doubtful, in seconds.',
            (0.1, 3600),
        ),
        first_crossing=declare(
            'first_crossing',
            default.first_crossing,
            'What the first crossing of a kart does to lap 1: starts or ends.',
        ),
        clock_tolerance=declare(
            'clock_tolerance',
            default.clock_tolerance,
            "Maximum difference between a source's clock and the times of arrival, in seconds.",
            (0.01, 10),
        ),
    )
    node.refuse_unknown(own_file=True)
    if settings.first_crossing not in ('starts', 'ends'):
        raise ParameterError(
            f'parameter first_crossing: {settings.first_crossing!r} is not valid. Set starts or '
            'ends'
        )
    if not roster:
        raise ParameterError(
            'parameter roster is missing. Name the file that lists the karts, '
            'such as: --ros-args -p roster:=config/karts.yaml'
        )
    path = pathlib.Path(book).expanduser() if book else rcs_folder() / BOOK
    return pathlib.Path(roster), path, settings


def main(args: list[str] | None = None) -> int:
    """Run the timekeeper until SIGINT or SIGTERM and return the exit code of `run_node`."""
    # Started beside race control, with SROS2, it is given race control's enclave. It has its own.
    enclave = os.environ.get('ROS_SECURITY_ENCLAVE_OVERRIDE', '')
    if enclave.endswith('/rcs'):
        own = f'{enclave.removesuffix("rcs")}timekeeper'
        os.environ['ROS_SECURITY_ENCLAVE_OVERRIDE'] = own
    refusals, obstacles = (RosterError,), (BookError,)
    return run_node('timekeeper', Timekeeper, args, refusals, obstacles)


if __name__ == '__main__':
    sys.exit(main())
