# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ``timekeeper`` node: laps and results, from race control's events and the timing line.

It runs on race control's machine, whose clock both go by. No kart depends on it: if it ends, hangs
or is wrong, the race goes on, and screens say that there is no timing. Its one word to race
control is FINISH, for a heat with `auto_finish`.

The executor's thread does all of it, and the main thread closes it. Whatever comes is written into
the book before the timekeeper goes by it.

Passings wait for a moment, so that a flood of them costs few writes. After a start or a hang they
wait until race control's events are here too: a passing belongs to the race of its time.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import math
import pathlib
import sys
import threading
import time
from typing import Any, ParamSpec

from evgp_node.codec import message_of, value_of
from evgp_node.entries import OF_TIMEKEEPER
from evgp_node.folder import rcs_folder
from evgp_node.graph import where_reachable
from evgp_node.official import heard, tidy, TIMEKEEPER
from evgp_node.parameters import ParameterError, Parameters, StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_node.qos import latched
from evgp_node.results import Act, BY_HAND, Corrected, Correction, Identity, Passing, Standings
from evgp_node.roster import load_roster, RosterError
from evgp_node.services import service_class
from evgp_node.stream import BOOK, Gap
from evgp_protocol import clock
from evgp_rcs_msgs import msg
from evgp_rcs_msgs.srv import KartFinish
from evgp_timing.book import Book, BookError
from evgp_timing.corrections import CORRECTIONS
from evgp_timing.desk import Answer, Desk, Finish, Heard, Input, Missed, Passed, Roster, Told, What
from evgp_timing.laps import LapSettings
from rclpy.clock import Clock, ClockType
from rclpy.task import Future

_P = ParamSpec('_P')

RESULTS_QOS = latched(1)
"""Of ``~/results``: a late subscriber gets the present ones at once."""

EVENTS_QOS = latched(200)
"""Of race control's events, as it publishes them."""

ARRIVING_QOS = latched(1000)
"""Of ``passings``: what a source said before it was found comes too."""

DUE_EVERY = 0.2
"""Time between two looks at what is due, in seconds."""

GATHERED = 0.05
"""Maximum time for which passings wait to be taken together, in seconds."""

MOST_WAITING = 1000
"""Maximum number of passings that wait; what more come is counted."""

HANG = 1.0
"""Time without a look after which the timekeeper counts as having been away, in seconds."""

CATCH_UP = 3.0
"""Time after that in which it hears what it has missed, in seconds."""

SHOWN_EVERY = 1.0
"""Maximum time between two publications of the results, in seconds."""

KEPT_EVERY = 10.0
"""Maximum time until results that changed, and which events have come, are in the book, in s."""

FINISH_EVERY = 2.0
"""Time until FINISH is asked for again where nothing says that the kart has finished, in s."""

MOST_STRENGTH = 1e9
"""The strength of a passing is below this, in the device's own measure."""

_COMMANDS = {
    msg.CommandAvailability.GRID_ACTIVE: What.GRID_ACTIVE,
    msg.CommandAvailability.KART_FINISH: What.FINISH,
    msg.CommandAvailability.KART_UNDO_FINISH: What.UNDO_FINISH,
    msg.CommandAvailability.KART_IN_GARAGE: What.LEFT,
    msg.CommandAvailability.LEAVE_RACE: What.LEFT,
}
"""What a command that was accepted says of a race."""


def told_of(event: msg.RaceEvent, run: str) -> Told | None:
    """Return what an event of race control says of laps; None: nothing."""
    what = None
    if event.kind == msg.RaceEvent.COMMAND and event.success:
        what = _COMMANDS.get(event.command)
    elif event.kind == msg.RaceEvent.RACE_STATE:
        green = event.state.state == msg.RaceState.GREEN_GREEN
        what = What.GREEN_GREEN if green else What.OVER
        if event.state.state == msg.RaceState.GRID_ACTIVE:
            what = None  # its command says it
    elif (event.kind, event.state.state) == (
        msg.RaceEvent.KART_STATE,
        msg.RaceState.GREEN_GREEN,
    ):
        what = What.SENT_GREEN
    if what is None:
        return None
    at = event.monotonic.sec + event.monotonic.nanosec / 1e9
    return Told(at, what, run, event.race, event.heat, event.kart, event.sequence)


def passing_of(message: msg.Passing) -> Passing:
    """
    Return a passing of a message, whatever is in it.

    What a message can say and the book cannot keep is what says nothing: a strength that is no
    number or beyond measure, a time before 1970. Names are one line that can be printed. Nobody
    but officials is called as they are.
    """
    passing = value_of(message, Passing)
    source, strength = tidy(passing.source), passing.strength
    return passing._replace(
        source='' if source == BY_HAND else source,
        session=tidy(passing.session),
        transponder=tidy(passing.transponder),
        stamp_ns=max(0, passing.stamp_ns),
        strength=strength if strength is not None and abs(strength) < MOST_STRENGTH else None,
    )


@dataclasses.dataclass(frozen=True)
class Settings:
    """The parameters; `read_settings` says what they mean."""

    roster: pathlib.Path
    book: pathlib.Path
    laps: LapSettings


def read_roster(path: pathlib.Path) -> Roster:
    """
    Return what the desk knows of the roster in a file.

    :raises RosterError: if it cannot be read, or is none.
    """
    roster = load_roster(path)
    owners = {name: each.number for each in roster.entries for name in each.transponders}
    return Roster(tuple(each.number for each in roster.entries), owners, roster.heats)


class Timekeeper(StrictNode):
    """
    The node.

    :param on_failure: is called when it cannot go on.
    :raises ParameterError: if a parameter is wrong.
    :raises RosterError: if the roster is.
    :raises BookError: if its file cannot be used.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        """Read what is known of this event, and begin to hear."""
        super().__init__('timekeeper', **{'namespace': 'rcs', **node_options})
        settings = read_settings(Parameters(self))
        self._on_failure = on_failure
        self._roster = settings.roster
        self._desk = Desk(read_roster(self._roster), settings.laps)
        self._last: dict[str, int] = {}  # the number of the newest event of each run
        self._book = Book(settings.book)
        self._awake = -math.inf
        for each in self._book.known():
            if isinstance(each, Gap):
                self.get_logger().warning(f'{settings.book}: {each}')
            else:
                self._feed(each)
                self._awake = max(self._awake, each.at)
        now = clock.now()
        self._away_since = min(now, self._awake) if self._desk.races else now
        self._back = self._awake = now
        self._waiting: list[Passed] = []
        self._turn = threading.Lock()
        self._ended = False
        self._asked: dict[Finish, tuple[float, Future]] = {}
        self._shown: Standings | None = None
        self._shown_at = self._kept_at = self._noted_at = -math.inf
        self._kept: Standings | None = None
        self._results = self.create_publisher(msg.Results, '~/results', RESULTS_QOS)
        self._finish = self.create_client(KartFinish, 'kart/finish')
        for act, entry in CORRECTIONS.items():
            if act is not Act.RESTORE:
                name = entry.service.removeprefix(OF_TIMEKEEPER)
                self._offer(name, service_class(entry.service_type), act)
        subscribe = self.create_subscription
        subscribe(msg.RaceEvents, 'events', self._alone(self._hear), EVENTS_QOS)
        subscribe(msg.Passing, 'passings', self._alone(self._see), ARRIVING_QOS)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(DUE_EVERY, self._alone(self._look), clock=steady)
        self.create_timer(GATHERED, self._alone(self._take_waiting), clock=steady)
        known = f'{len(self._desk.races)} races of this event are known'
        self.get_logger().info(f'The timekeeper keeps its book in {settings.book}; {known}')
        self.get_logger().info(where_reachable())

    def close(self) -> None:
        """Write the results as they are, and let the file go."""
        with self._turn:
            self._ended = True
            self._keep(clock.now(), at_once=True)
            self._book.close()

    def _alone(self, callback: Callable[_P, None]) -> Callable[_P, None]:
        """Return a callback that runs while nothing else does, and not after the end."""

        def run(*arguments: _P.args, **named: _P.kwargs) -> None:
            with self._turn:
                if not self._ended:
                    now = clock.now()
                    if now - self._awake > HANG:
                        self._away_since, self._back = self._awake, now
                    self._awake = now
                    callback(*arguments, **named)

        return run

    # ----- what comes ---------------------------------------------------------------------

    def _take(self, *given: Input) -> Answer | None:
        """Write what came into the book, and go by it; return the answer to the last of it."""
        self._write(*given)
        return [self._feed(each) for each in given][-1]

    def _write(self, *given: Input) -> None:
        try:
            self._book.write(*given)
        except OSError as error:
            self.get_logger().error(f'{error}: a restart would not know it')

    def _feed(self, given: Input) -> Answer | None:
        if isinstance(given, (Told, Heard)):
            self._last[given.run] = max(given.sequence, self._last.get(given.run, 0))
        return self._desk.feed(given)

    def _hear(self, message: msg.RaceEvents) -> None:
        self._take_waiting()
        for event in message.events:
            last = self._last.get(message.run)
            if last is not None and event.sequence <= last:
                continue
            missed = event.sequence - 1 - (last or 0)
            if missed:
                self._take(Missed(clock.now(), message.run, event.race, missed))
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
            self._desk.roster = read_roster(self._roster)
            self.get_logger().info(f'{self._roster} was read again, as race control took it')
        except RosterError as error:
            self.get_logger().error(f'The roster stays as it was: {error}')

    def _see(self, message: msg.Passing) -> None:
        if sum(len(each.passings) for each in self._waiting) >= MOST_WAITING:
            self._waiting[-1] = self._waiting[-1]._replace(dropped=self._waiting[-1].dropped + 1)
            return
        now, passing = clock.now(), passing_of(message)
        if self._waiting and now - self._waiting[-1].at < GATHERED:
            together = *self._waiting[-1].passings, passing
            self._waiting[-1] = self._waiting[-1]._replace(passings=together)
        else:
            self._waiting.append(Passed(now, (passing,)))

    @property
    def _catches_up(self) -> bool:
        """Return whether what it missed while it was away may still come."""
        return self._awake - self._back < CATCH_UP

    def _take_waiting(self) -> None:
        """Take the passings that wait."""
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
            asked = _asked_for(act, request)
            given = self._desk.about(Corrected(clock.now(), asked))
            answer = self._feed(given)
            assert answer is not None
            if answer.success:
                self._write(given)
            response.success, response.message = answer.success, answer.text
            self.get_logger().info(f'{answer.text} [{heard(request.official)}]')

        alone = self._alone(serve)

        def answered(request: Any, response: Any) -> Any:
            response.message = 'the timekeeper ends'
            alone(request, response)
            return response

        self.create_service(kind, f'~/{name}', answered)

    # ----- what goes out ------------------------------------------------------------------

    def _look(self) -> None:
        now = clock.now()
        seen = self._desk.standings(now)
        if (
            self._shown is None
            or seen[1:] != self._shown[1:]
            or now - self._shown_at > SHOWN_EVERY
        ):
            self._shown, self._shown_at = seen, now
            wall_ns = time.time_ns() - round(now * 1e9)
            self._results.publish(message_of(seen, msg.Results, wall_ns))
        self._keep(now)
        if self._catches_up:
            return
        for wanted in self._desk.finishes():
            asked_at, call = self._asked.get(wanted, (-math.inf, None))
            if now - asked_at > FINISH_EVERY:
                if call is not None:
                    self._finish.remove_pending_request(call)
                self._asked[wanted] = now, self._ask_for(wanted)

    def _keep(self, now: float, at_once: bool = False) -> None:
        """Have the results in the book once they have changed."""
        if self._shown is None or not self._shown.race:
            return
        is_new = self._kept is None or self._kept[1:] != self._shown[1:]
        if is_new and (at_once or now - self._kept_at > KEPT_EVERY):
            self._kept, self._kept_at = self._shown, now
            try:
                self._book.write(self._shown)
            except OSError as error:
                self.get_logger().error(f'{error}: the report would not have it')

    def _ask_for(self, wanted: Finish) -> Future:
        call = self._finish.call_async(KartFinish.Request(official=TIMEKEEPER, **wanted._asdict()))
        call.add_done_callback(lambda done: self.get_logger().info(done.result().message))
        return call


def _asked_for(act: Act, request: Any) -> Correction:
    """Return the correction that a request asks for."""
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


def read_settings(parameters: Parameters) -> Settings:
    """
    Declare every parameter of the node.

    :raises ParameterError: if a parameter is wrong.
    """
    declare, default = parameters.declare, LapSettings
    roster = declare('roster', '', 'The file that lists the karts: the one of race control.')
    book = declare('book', '', 'Its file (SQLite); empty: evgp_rcs/timing.sqlite3 below ROS_HOME.')
    settings = LapSettings(
        min_lap_time=declare(
            'min_lap_time',
            default.min_lap_time,
            'A passing nearer to the last one that counted is doubtful, s.',
            (0.1, 3600),
        ),
        first_crossing=declare(
            'first_crossing',
            default.first_crossing,
            'The first crossing of a kart starts lap 1, or ends it: starts, or ends.',
        ),
        clock_tolerance=declare(
            'clock_tolerance',
            default.clock_tolerance,
            "How far a source's clock may be from the times of arrival, s.",
            (0.01, 10),
        ),
    )
    parameters.refuse_unknown(own_file=True)
    if settings.first_crossing not in ('starts', 'ends'):
        raise ParameterError(
            f'parameter first_crossing: {settings.first_crossing!r} is not possible. Give starts '
            'or ends'
        )
    if not roster:
        raise ParameterError(
            'parameter roster is missing. Name the file that lists the karts, '
            'as in: --ros-args -p roster:=config/karts.yaml'
        )
    path = pathlib.Path(book).expanduser() if book else rcs_folder() / BOOK
    return Settings(pathlib.Path(roster), path, settings)


def main(args: list[str] | None = None) -> int:
    """
    Run the node until SIGINT or SIGTERM.

    :return: 0 after an orderly end, 1 after a failure, 2 if a setting is wrong, 3 if another
        timekeeper is in the way.
    """
    refusals = (ParameterError, RosterError)
    return run_node('timekeeper', Timekeeper, refusals, args, obstacles=(BookError,))


if __name__ == '__main__':
    sys.exit(main())
