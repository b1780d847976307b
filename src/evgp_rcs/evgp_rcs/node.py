"""
The ``rcs`` node: race control as ROS topics and services (§4.B).

Each thread has its own work, and hands over what it has done; they share no state:

- the kart server's thread owns the race and the sockets (``kart_server``);
- two executors take officials' service calls, hand each to the kart server and wait for its
  answer: one for the stops alone, so that none waits behind another call, and one for the rest;
- the teller's thread (``Teller``) publishes the race and its events, and logs;
- the record's thread (``record``) writes them to the disk.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import concurrent.futures
import pathlib
import queue
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from evgp_node.graph import GraphError, refuse_open_graph, where_reachable
from evgp_node.parameters import check_address, ParameterError, Parameters, StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_node.states import state_of
from evgp_rcs.kart_server import KartServer, KartServerError, ServerSettings
from evgp_rcs.messages import event_message, race_message, record_alert
from evgp_rcs.race import (
    Answer,
    Command,
    CommandKind,
    Event,
    EventKind,
    Kart,
    Race,
    RaceTimes,
    StampedEvent,
    STOPS,
)
from evgp_rcs.record import default_path, Record, RecordError
from evgp_rcs.rival import claim_the_graph, refuse_rivals, RivalError
from evgp_rcs.roster import load_roster, Roster, RosterError
from evgp_rcs_msgs import msg, srv
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import SetBool, Trigger

END_TIMEOUT = 2.0
"""How long the record may take to be finished at the end, seconds."""

REMEMBER_TIMEOUT = 1.0
"""How long a GREEN_GREEN waits for the record to have its GRID_ACTIVE, seconds."""

ANSWER_TIMEOUT = 4.0
"""How long an official's call waits for the kart server before it says so, seconds."""

RACE_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Of ``~/race``: a late subscriber gets the present race at once."""

EVENTS_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=200,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Of ``~/events``: a late subscriber gets the last 200 events."""

TURN = 0.05
"""So long are events told before a newer race is, s; waiting for frames comes on top."""

MOST_WAITING = 5000
"""So many events wait to be told. When there are more, only the record has the lesser ones."""

LESSER = (EventKind.ACKNOWLEDGED, EventKind.KART_STATE, EventKind.REPORTED)
"""What karts do by the hundred, and what ``~/race`` shows as well."""

SERVICE_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""Of the services. With ROS's usual depth of 10, the eleventh of a burst of stops would push the
first out, unanswered. Not KEEP_ALL: a client that takes no answers must not hold up the others."""

DIAGNOSTICS_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""Of ``/diagnostics``, as diagnostic aggregators expect it."""


class RcsNode(StrictNode):
    """
    Race control's node.

    :param on_failure: is called, in another thread, when race control cannot go on: every kart
        has been sent RED_RED and the process should end.
    :raises ParameterError: if a parameter is wrong.
    :raises RosterError: if the roster is.
    :raises KartServerError: if the karts' port cannot be listened at.
    :raises GraphError: if the ROS graph can be reached from where karts connect.
    :raises RivalError: if there is another race control on it.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        """Read the parameters and the roster, listen for karts, and offer the services."""
        super().__init__('rcs', **node_options)
        parameters = Parameters(self)
        accept_open_graph = parameters.declare(
            'accept_open_graph',
            False,
            'The ROS graph may be reached from where karts connect, without SROS2: whoever is on '
            'their network can then start them (docs/security.md).',
        )
        settings, times, roster, record = read_settings(parameters)
        refuse_open_graph(settings.host, accepted=accept_open_graph)
        self._claim = claim_the_graph(self)
        refuse_rivals(self)
        race = Race(
            [
                Kart(number=entry.number, team=entry.team, in_race=entry.in_race)
                for entry in roster.entries
            ],
            times,
            now=time.monotonic(),
        )
        self._record = Record(record)
        recovered: tuple[Event, ...] = ()
        if self._record.left_behind is not None:
            recovered = race.recover(self._record.left_behind, time.monotonic()).events
        self._record.remember(race.memory(), time.monotonic())
        self._teller = Teller(self, roster, self._record)
        self._server = KartServer(
            race,
            {entry.address: entry.number for entry in roster.entries},
            settings,
            on_events=self._teller.put,
            on_copy=self._teller.put,
            on_failure=self._fail,
            first_events=recovered,
        )
        self._teller.report = self._server.report
        self._teller.courtesy = self._record.courtesy = self._server.courtesy
        self._on_failure = on_failure
        self._failed = False
        self._offer_services()
        self._server.start()
        self._teller.start()
        self.get_logger().info(
            f'Race control listens for {len(roster.entries)} karts at '
            f'{self._server.address[0]}, port {self._server.address[1]}'
        )
        self.get_logger().info(where_reachable())

    @property
    def kart_port(self) -> int:
        """Return the TCP port at which karts connect."""
        return self._server.address[1]

    def close(self) -> None:
        """Send every kart RED_RED, close their connections, and tell what is left to tell."""
        self._server.stop()
        self._teller.stop()
        self._record.end(END_TIMEOUT, in_order=not self._failed)

    def _remember_the_grid(self) -> None:
        """
        Have it on the disk that a race is under way, before a kart may move.

        If the disk does not take it, the race goes on; the alert is loud by then. No stop ever
        comes by here.
        """
        race, at = self._server.copy().result(ANSWER_TIMEOUT)
        self._record.remember(race.memory(), at)
        self._record.flush(REMEMBER_TIMEOUT)

    def _fail(self, error: BaseException) -> None:
        self._failed = True
        self._on_failure(error)

    # ----- services -----------------------------------------------------------------------

    def _offer_services(self) -> None:
        # A node has one executor, and what that has to do for each of the other services is
        # what a stop would wait for most. So the stops have a node of their own.
        stops = Node(
            f'{self.get_name()}_stops',
            context=self.context,
            namespace=self.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)],
        )
        self.beside = (stops,)
        others = self
        offer = self._offer
        offer(stops, '~/all_kill', Trigger, CommandKind.ALL_KILL)
        offer(stops, '~/red_flag', Trigger, CommandKind.RED_FLAG)
        offer(stops, '~/kart/red_red', srv.KartCommand, CommandKind.KART_RED_RED)
        offer(stops, '~/kart/red_flag', srv.KartCommand, CommandKind.KART_RED_FLAG)
        offer(stops, '~/record_msr', Trigger, CommandKind.RECORD_MSR, lambda request: True)
        offer(others, '~/race_over', Trigger, CommandKind.RACE_OVER)
        offer(
            others,
            '~/green_green',
            srv.GreenGreen,
            CommandKind.GREEN_GREEN,
            lambda request: bool(request.without_record),
        )
        offer(
            others,
            '~/grid_active',
            srv.GridActive,
            CommandKind.GRID_ACTIVE,
            lambda request: bool(request.track_clear),
        )
        offer(
            others,
            '~/in_garage',
            srv.InGarage,
            CommandKind.IN_GARAGE,
            lambda request: bool(request.track_safe),
        )
        offer(others, '~/kart/finish', srv.KartCommand, CommandKind.KART_FINISH)
        offer(
            others,
            '~/kart/in_garage',
            srv.KartInGarage,
            CommandKind.KART_IN_GARAGE,
            lambda request: bool(request.made_safe_by_hand),
        )
        offer(
            others,
            '~/set_in_race',
            srv.SetInRace,
            lambda request: CommandKind.JOIN_RACE if request.in_race else CommandKind.LEAVE_RACE,
        )
        offer(
            others,
            '~/set_track_open',
            SetBool,
            lambda request: CommandKind.OPEN_TRACK if request.data else CommandKind.CLOSE_TRACK,
        )

    def _offer(
        self,
        node: Node,
        name: str,
        service: Any,
        kind: CommandKind | Callable[[Any], CommandKind],
        statement: Callable[[Any], bool] = lambda request: False,
    ) -> None:
        def serve(request: Any, response: Any) -> Any:
            answer = self._command(
                Command(
                    kind if isinstance(kind, CommandKind) else kind(request),
                    getattr(request, 'kart', None),
                    statement(request),
                    frozenset(getattr(request, 'karts', ())),
                    state_of(request.hold) if hasattr(request, 'hold') else None,
                )
            )
            response.success = answer.success
            response.message = answer.message
            return response

        # Also below another node a name is what it is in this one, remapped or not.
        own = name if node is self else self.resolve_service_name(name)
        node.create_service(service, own, serve, qos_profile=SERVICE_QOS)

    def _command(self, command: Command) -> Answer:
        came = time.monotonic()
        waiting: concurrent.futures.Future[Answer] | None = None
        try:
            if command.kind is CommandKind.GREEN_GREEN:
                self._remember_the_grid()
            waiting = self._server.submit(command, came)
            return waiting.result(ANSWER_TIMEOUT)
        except KartServerError as error:
            return Answer(False, f'{command.kind.value} was not given: {error}.')
        except concurrent.futures.TimeoutError:
            if waiting is not None and command.kind not in STOPS:
                # What is not in force by now does not come into force later, unseen.
                waiting.cancel()
            return Answer(
                False,
                f'{command.kind.value} is not answered after {ANSWER_TIMEOUT:g} s'
                + ('; use the MSR.' if command.kind in STOPS else '; look at the race.'),
            )


def read_settings(
    parameters: Parameters,
) -> tuple[ServerSettings, RaceTimes, Roster, pathlib.Path]:
    """
    Declare every parameter of race control and read the roster it names.

    :raises ParameterError: if a parameter is wrong.
    :raises RosterError: if the roster is.
    """
    declare = parameters.declare

    def seconds(name: str, default: float, meaning: str) -> float:
        return declare(name, default, f'{meaning} for so long, s.', (0.1, 3600))

    path = declare('roster', '', 'The file that lists the karts, see config/karts.yaml.')
    record = declare(
        'record',
        '',
        'The file of the record (SQLite); empty: evgp_rcs/record.sqlite3 below ROS_HOME.',
    )
    settings = ServerSettings(
        host=declare(
            'address', '0.0.0.0', 'The IPv4 address at which karts connect; 0.0.0.0: every one.'
        ),
        port=declare('port', 12017, 'The TCP port at which karts connect; 0: any.', (0, 65535)),
        beat_rate=declare(
            'beat_rate', 20.0, 'Frames per second to each kart, Hz (§4.C: at least 10).', (10, 100)
        ),
        send_timeout=declare(
            'send_timeout',
            1.0,
            'A kart that leaves bytes unanswered so long is lost, s.',
            (0.2, 10),
        ),
        pause=declare(
            'pause',
            1.0,
            'So long after a stop nothing is taken that loosens or starts anything, s.',
            (0.5, 10),
        ),
    )
    times = RaceTimes(
        finish_delays=tuple(
            declare(
                'finish_delays',
                list(RaceTimes().finish_delays),
                'From FINISH to RED_FLAG for place 1, 2, …; the last for all further, s, 0-60.',
            )
        ),
        finish_stop=seconds('finish_stop', 15.0, 'A finished kart may not acknowledge RED_FLAG'),
        auto_race_over=declare(
            'auto_race_over', True, 'Once every kart has finished, the race goes over by itself.'
        ),
        ready_alert=seconds('ready_alert', 120.0, 'Alert: GRID_ACTIVE is not acknowledged'),
        green_alert=seconds('green_alert', 30.0, 'Alert: GREEN_GREEN is not acknowledged'),
        flag_alert=seconds('flag_alert', 15.0, 'Alert: RED_FLAG is not acknowledged'),
        red_alert=seconds('red_alert', 5.0, 'Alert: RED_RED is not acknowledged'),
    )
    parameters.refuse_unknown()
    check_address('address', settings.host)
    for delay in times.finish_delays:
        if not 0.0 <= delay <= 60.0:
            raise ParameterError(
                f'parameter finish_delays: {delay:g} is not possible. '
                'Give each place a delay from 0 to 60 s'
            )
    if not path:
        raise ParameterError(
            'parameter roster is missing. Name the file that lists the karts, '
            'as in: --ros-args -p roster:=config/karts.yaml'
        )
    return (
        settings,
        times,
        load_roster(pathlib.Path(path)),
        pathlib.Path(record).expanduser() if record else default_path(),
    )


class Teller:
    """
    Publishes what the kart server hands over, in a thread of its own.

    Events go out in order, all of them unless more than `MOST_WAITING` wait. Of several copies of
    the race only the newest does, and that may overtake events: it waits for no more of them than
    are told in `TURN`, so that what officials see is the present race.
    """

    def __init__(self, node: Node, roster: Roster, record: Record) -> None:
        """Create the publishers; nothing is published before ``start``."""
        self._node = node
        self._record = record
        self._trouble = ''
        self._trouble_since_ns = 0
        self.report: Callable[[Event], None] = lambda event: None
        """Has an event told among the others."""
        self.courtesy: Callable[[], Callable[[], object]] = lambda: lambda: None
        """Called for each message; what it returns waits while frames are on their way."""
        self._addresses = {entry.number: entry.address for entry in roster.entries}
        self._race = node.create_publisher(msg.Race, '~/race', RACE_QOS)
        self._events = node.create_publisher(msg.RaceEvent, '~/events', EVENTS_QOS)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', DIAGNOSTICS_QOS)
        self._queue: queue.SimpleQueue[tuple[Any, ...] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name='teller', daemon=True)
        self._told_diagnostics = 0.0

    def put(self, *news: Any) -> None:
        """Take events, or a copy of the race with its time, from the kart server's thread."""
        self._queue.put(news)

    def start(self) -> None:
        """Begin to publish."""
        self._thread.start()

    def stop(self) -> None:
        """Publish what is still to be told, and return."""
        if self._thread.ident is not None:
            self._queue.put(None)
            self._thread.join()

    def _run(self) -> None:
        waiting: deque[StampedEvent] = deque()
        ended = False
        while not ended or waiting:
            came = [] if waiting else [self._queue.get()]
            while not self._queue.empty():
                came.append(self._queue.get())
            newest: tuple[Race, float] | None = None
            told: list[StampedEvent] = []
            for news in came:
                if news is None:
                    ended = True
                elif len(news) == 1:
                    told += news[0]
                else:
                    newest = news[0], news[1]
            self._record.put(told)
            if newest is not None:
                self._record.remember(newest[0].memory(), newest[1])
            waiting += told
            if len(waiting) > MOST_WAITING:
                waiting = self._without_lesser(waiting)
            give_way = self.courtesy()
            until = time.monotonic() + TURN
            while waiting and time.monotonic() < until:
                give_way()
                self._tell(waiting.popleft())
            if newest is not None:
                self._look_at_the_record()
                self._tell_race(*newest)

    def _without_lesser(self, events: deque[StampedEvent]) -> deque[StampedEvent]:
        """Return the events that are told when there are too many to tell them all."""
        kept = [each for each in events if each.event.kind not in LESSER][-MOST_WAITING:]
        self._node.get_logger().warning(
            f'{len(events) - len(kept)} events came faster than they can be told; '
            'only the record has them'
        )
        return deque(kept)

    def _look_at_the_record(self) -> None:
        """Raise the alert when the record begins to fail, and clear it when it no longer does."""
        trouble = self._record.trouble()
        if bool(trouble) != bool(self._trouble):
            kind = EventKind.ALERT_RAISED if trouble else EventKind.ALERT_CLEARED
            text = f'{trouble}. The race goes on' if trouble else 'The record is written again'
            try:
                self.report(Event(kind, text, success=not trouble))
            except KartServerError:
                pass  # race control ends, which is told already
            self._trouble_since_ns = time.time_ns()
        self._trouble = trouble

    def _tell(self, stamped: StampedEvent) -> None:
        event = stamped.event
        log = self._node.get_logger()
        if event.kind is EventKind.ALERT_RAISED or not event.success:
            log.warning(event.text)
        elif event.kind is EventKind.ACKNOWLEDGED:
            log.debug(event.text)  # that all have, or that one is late, is told for itself
        elif event.kind not in (EventKind.KART_STATE, EventKind.FINISHED):  # the command says it
            log.info(event.text)
        self._events.publish(event_message(stamped))

    def _tell_race(self, race: Race, now: float) -> None:
        wall_ns = time.time_ns() - round((time.monotonic() - now) * 1e9)
        more = [record_alert(self._trouble, self._trouble_since_ns)] if self._trouble else []
        give_way = self.courtesy()
        message = race_message(race, now, wall_ns, self._addresses, more, give_way)
        give_way()
        self._race.publish(message)
        if now - self._told_diagnostics >= 1.0:
            self._told_diagnostics = now
            self._diagnostics.publish(self._diagnostic(race, now))

    def _diagnostic(self, race: Race, now: float) -> DiagnosticArray:
        give_way = self.courtesy()
        name = self._node.get_fully_qualified_name().lstrip('/')
        alerts = race.alerts(now)
        level, summary = DiagnosticStatus.OK, f'The race is in {race.state.value}'
        if alerts:
            level, summary = DiagnosticStatus.WARN, alerts[0].text
        msr = [alert for alert in alerts if alert.use_msr]
        if self._trouble:
            level, summary = DiagnosticStatus.ERROR, self._trouble
        if msr:
            level, summary = DiagnosticStatus.ERROR, msr[0].text
        array = DiagnosticArray()
        array.header.stamp = self._node.get_clock().now().to_msg()
        array.status = [
            DiagnosticStatus(
                level=level,
                name=f'{name}: race',
                message=summary,
                hardware_id='rcs',
                values=[
                    KeyValue(key='race state', value=race.state.value),
                    KeyValue(key='alerts', value=str(len(alerts))),
                ],
            ),
            *(self._kart_diagnostic(name, kart, give_way) for kart in race.karts.values()),
        ]
        return array

    def _kart_diagnostic(
        self, name: str, kart: Kart, give_way: Callable[[], object]
    ) -> DiagnosticStatus:
        give_way()
        return DiagnosticStatus(
            level=DiagnosticStatus.OK
            if kart.connected or not kart.in_race
            else DiagnosticStatus.WARN,
            name=f'{name}: kart {kart.number}',
            message='connected' if kart.connected else 'not connected',
            hardware_id=self._addresses[kart.number],
            values=[
                KeyValue(key='team', value=kart.team),
                KeyValue(key='sent', value=kart.sent.value),
                KeyValue(key='acknowledged', value=str(kart.acknowledged).lower()),
            ],
        )


def main(args: list[str] | None = None) -> int:
    """
    Run race control until SIGINT or SIGTERM; every kart is sent RED_RED at the end.

    :return: 0 after an orderly end, 1 after a failure (the karts were sent RED_RED), 2 if a
        setting is wrong.
    """
    refusals = (ParameterError, GraphError, RivalError, RosterError, RecordError, KartServerError)
    return run_node('rcs', RcsNode, refusals, args)


if __name__ == '__main__':
    sys.exit(main())
