# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ``rcs`` node: race control as ROS topics and services (§4.B); the ROS half of race control.

The kart server, with the rules and the karts' sockets, is another process (``karts.process``).
This one starts it, and neither outlives the other. Each thread here has its own work:

- three threads take officials' service calls, hand each to the kart server and wait for its
  answer: one for what stops karts, one for GREEN_GREEN, which may wait for the disk, and one for
  the rest. So no stop waits behind another call;
- the client's thread (``kart_client``) hears the kart server;
- one calls this node again and again, as an official's program would, gives the kart server a sign
  of life as long as the calls come in, tells it who is there, and looks after the graph;
- the publisher's thread (``publisher``) publishes the race and its events, and logs;
- the watch's thread (``address_watch``) sees whether another machine has race control's address.
"""

from __future__ import annotations

import contextlib
import dataclasses
import ipaddress
import itertools
import sys
import threading
from typing import Any

from evgp_node.graph import (
    EVERY,
    GraphError,
    has_its_address,
    Inbox,
    refuse_open_graph,
    trouble_of_graph,
    where_reachable,
)
from evgp_node.official import heard, tidy
from evgp_node.parameters import ParameterError, Parameters, StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_node.rclpy_private import RCLError
from evgp_node.roster import RosterError
from evgp_node.services import service_class
from evgp_node.states import state_of
from evgp_protocol import clock
from evgp_rcs.karts import priority
from evgp_rcs.karts.address_watch import AddressTakenError, watch_for_race_control
from evgp_rcs.karts.channel import ANSWER_TIMEOUT, Begin
from evgp_rcs.karts.server import KartServerError
from evgp_rcs.record.run_mark import leave_began, place
from evgp_rcs.ros.kart_client import KartServerClient
from evgp_rcs.ros.presence import MOST_PROGRAMS, Presences
from evgp_rcs.ros.publisher import RacePublisher
from evgp_rcs.ros.rival import claim_the_graph, look_for_rivals, refuse_rivals, RivalError
from evgp_rcs.ros.settings import read_roster, read_settings
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind, kinds_by_service
from evgp_rcs.rules.race import Answer, Command
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs_msgs import msg
from evgp_rcs_msgs.srv import SignOfLife
from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

ALIVE_EVERY = 0.2
"""Time between two signs of life to the kart server, in seconds; after 1 s without one it sends
RED_RED to every kart."""

CALL_EVERY = 2
"""Number of signs of life for each call of race control to itself."""

MOST_UNHEARD = 4
"""Maximum number of these calls in a row that have not come in, or of looks in a row that find the
same datagram unread; one more ends race control, after 2 s. They are counted, not timed: a process
that was stopped called nobody."""

GRAPH_LOOK = 10
"""Number of signs of life for each look at the graph, which takes the kernel up to 1 ms."""

SERVICE_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""Of the services. With ROS's usual depth of 10, the eleventh of a burst of stops would push the
first out, unanswered. Not KEEP_ALL: a client that takes no answers must not hold up the others."""


PRESENCE_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
    liveliness=LivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=Infinite,
)
"""Of ``~/presence``. It asks for the least liveliness, so that whoever says anything is heard;
who says nothing for `presence.SILENT_AFTER` counts as gone."""


MOST_AGE = 86_400.0
"""Maximum age of a press that is kept, in seconds: a day."""


class DeafError(RuntimeError):
    """What officials send does not come in any more."""


class RcsNode(StrictNode):
    """
    Race control's node.

    :param on_failure: is called, in another thread, when race control cannot go on and the process
        should end: every kart has been sent RED_RED, or ``close`` sends it.
    :raises ParameterError: if a parameter is wrong.
    :raises RosterError: if the roster is.
    :raises KartServerError: if the kart server cannot start.
    :raises GraphError: if the ROS graph can be reached from where karts connect.
    :raises RivalError: if there is another race control on it.
    :raises AddressTakenError: if another machine has race control's address.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        """Read the parameters and the roster, start the kart server, and offer the services."""
        super().__init__('rcs', **node_options)
        parameters = Parameters(self)
        accept_open_graph = parameters.declare(
            'accept_open_graph',
            False,
            'The ROS graph may be reached from where karts connect, without SROS2: whoever is on '
            'their network can then start them (docs/security.md).',
        )
        self._banner = parameters.declare(
            'banner',
            '',
            'What every screen says at its top, and every answer at its beginning, such as '
            'REHEARSAL; empty: nothing. Screens that say it are trusted to be in no race: never '
            'set it for one.',
        )
        officials = parameters.declare(
            'officials',
            [''],
            "The event's officials, by name: a window offers them as who commands from it.",
        )
        begin = read_settings(parameters)
        self._roster = str(self.get_parameter('roster').value)
        refuse_open_graph(begin.settings.host, accepted=accept_open_graph)
        self._claim = claim_the_graph(self)
        # It asks while the graph is looked at, and goes on until the end.
        self._addresses = [each.address for each in begin.roster.karts]
        self._watch = watch_for_race_control(begin.settings.host, lambda: self._addresses)
        try:
            refuse_rivals(self)
            begin = self._after_the_first_look(begin)
        except (RivalError, AddressTakenError):
            # Another machine races: what this one knew of its own last run proves nothing.
            with contextlib.suppress(OSError):  # then there is no proof either
                leave_began(place(begin.settings.host, begin.settings.port))
            raise
        self._on_failure = on_failure
        self._failure = ''
        self._closing = threading.Event()
        self._calls = self._heard = 0
        self._rival = False
        self._signing = threading.Lock()
        self._asking = threading.Thread(target=self._ask, name='asking', daemon=True)
        self._publisher = RacePublisher(
            self,
            self._publisher_failed,
            self._banner,
            tuple(filter(None, map(tidy, officials))),
            begin.run,
        )
        self._server = KartServerClient(
            begin,
            on_events=self._publisher.events,
            on_snapshot=self._take_snapshot,
            on_end=self._kart_server_ended,
        )
        self._presences = Presences()
        self.create_subscription(msg.Presence, '~/presence', self._hear_presence, PRESENCE_QOS)
        self._offer_services()
        self._server.start()
        self._publisher.start()
        self._asking.start()
        self._watch.tell(self._hear_watch)
        self.get_logger().info(
            f'Race control listens for {len(self._addresses)} karts at '
            f'{self._server.address[0]}, port {self._server.address[1]}'
        )
        self.get_logger().info(where_reachable())

    def close(self) -> None:
        """Send every kart RED_RED, close their connections, and tell what is left to tell."""
        if self._failure:
            # At once: what follows may take its time.
            self._server.end(in_order=False)
            self._publisher.stop()
            try:
                self._publisher.last_words(self._failure)
            except RCLError as error:  # as Fast DDS publishes nothing past 2038
                self.get_logger().error(
                    f'Officials cannot be told that race control ends: {error}'
                )
        self._server.stop(in_order=not self._failure)
        self._publisher.stop()
        self._closing.set()
        self._asking.join()
        self._watch.close()

    def _after_the_first_look(self, begin: Begin) -> Begin:
        """
        Wait until another machine that has the address must have answered.

        :return: with what to start, and whether that can be known.
        :raises AddressTakenError: if one has answered.
        """
        try:
            not_known = self._watch.first_look()
        except AddressTakenError as error:
            raise AddressTakenError(
                f'{error}: karts would reach either. Unplug one of the two machines, or end the '
                'other race control and take its address away'
            ) from error
        if not not_known or ipaddress.IPv4Address(begin.settings.host).is_loopback:
            return begin
        if begin.settings.host == EVERY:
            # Nobody has said that this machine is where karts look for race control.
            self.get_logger().info(f'Other race controls are not looked for: {not_known}')
            return begin
        self.get_logger().warning(f'Is there a second race control? {not_known}')
        return dataclasses.replace(begin, cannot_know=not_known)

    def _take_snapshot(self, race: Snapshot) -> None:
        self._addresses = [kart.address for kart in race.karts if kart.address]
        self._publisher.race(race)

    def _hear_watch(self) -> None:
        """Hand on what the watch of the address has found, in its thread."""
        if self._watch.error is not None:
            self._fail(
                'Race control cannot see any more whether another machine has its address, and '
                'sends RED_RED to every kart: use the MSR if a kart still moves',
                self._watch.error,
            )
        elif self._watch.answer:
            found = f'{self._watch.answer[0].upper()}{self._watch.answer[1:]}'
            self._fail(
                f"{found}, which is race control's. Race control sends RED_RED to every kart "
                'and ends. Use the MSR if a kart still moves, and unplug one of the two machines',
                AddressTakenError(self._watch.answer),
            )
            # First of all: the watch then says that it is here, and karts may turn to it.
            self._server.end(in_order=False)
        else:
            self._give_sign_of_life()

    def _give_sign_of_life(self) -> None:
        with self._signing:
            try:
                there = self._presences.attendance(clock.now())
                self._server.alive(self._rival, there, self._watch.cut_off)
            except KartServerError:
                pass  # its end is noticed, and told, by the thread that hears it

    def _publisher_failed(self, error: BaseException) -> None:
        self._fail(
            f'Race control has failed and sends RED_RED to every kart ({error}): use the MSR if a '
            'kart still moves',
            error,
        )

    def _kart_server_ended(self, why: str) -> None:
        self._fail(
            f'Use the MSR: race control has ended, and no kart is connected ({why})',
            KartServerError(f'the kart server has ended: {why}'),
        )

    def _fail(self, text: str, error: BaseException) -> None:
        self._failure = self._failure or text
        self._on_failure(error)

    def _ask(self) -> None:
        inbox = Inbox()
        trouble = ''
        for sign in itertools.count():
            if sign % GRAPH_LOOK == 0:
                before, trouble = trouble, trouble_of_graph(self.context.get_domain_id())
                if trouble != before:
                    self._publisher.graph_trouble(trouble)
            if sign % CALL_EVERY == 0:
                missing, unread = self._calls - self._heard, inbox.unread()
                if max(missing, unread) > MOST_UNHEARD:
                    # No further sign of life either, should this not end it.
                    self._fail(
                        'Race control no longer hears officials and sends RED_RED to every kart: '
                        'use the MSR if a kart still moves',
                        DeafError(
                            'what officials send does not come in through DDS: of the calls to '
                            f'itself {missing} in a row are missing, and a datagram was found '
                            f'unread {unread} times in a row'
                        ),
                    )
                    return
                self._rival = look_for_rivals(self)
                # To itself DDS sends by the officials' address only. While that is gone (their
                # cable was pulled), no call can come in, though those of this machine do.
                if has_its_address():
                    self._calls += 1
                    called = self._self_call.call_async(SignOfLife.Request(number=self._calls))
                    self._self_call.remove_pending_request(called)
            self._give_sign_of_life()
            if self._closing.wait(ALIVE_EVERY):
                return

    def _hear(self, request: Any, response: Any) -> Any:
        """Take a call of this process to itself, in the thread that takes the stops."""
        # Whoever else may call: it came in.
        self._heard = max(self._heard, min(request.number, self._calls))
        return response

    def _hear_presence(self, message: msg.Presence) -> None:
        if not self._presences.hear(message, clock.now()):
            self.get_logger().warning(
                f'More than {MOST_PROGRAMS} programs say that officials can stop the race from '
                'them: not all of them are heard',
                throttle_duration_sec=60.0,
            )

    # ----- services -----------------------------------------------------------------------

    def _offer_services(self) -> None:
        # One thread serves each node. On a shared one a stop would usually wait behind other
        # services, so the stops have a node of their own.
        stops, starts = self._node_beside('stops'), self._node_beside('starts')
        self.beside = (stops, starts)
        # From one node to another, through DDS's sockets and threads, as a stop comes in. A thread
        # calls, as a timer would not do: some middlewares wait for one by the wall clock. Nobody
        # takes the answers: that a call came in is all there is to know.
        name = self.resolve_service_name('~/sign_of_life')
        stops.create_service(SignOfLife, name, self._hear, qos_profile=SERVICE_QOS)
        self._self_call = starts.create_client(SignOfLife, name, qos_profile=SERVICE_QOS)
        for name, kinds in kinds_by_service().items():
            entry = CATALOGUE[kinds[0]]
            node = stops if entry.overtakes else starts if entry.needs_journal else self
            self._offer(node, name, kinds)

    def _node_beside(self, what: str) -> Node:
        """Return a node of this process that only offers services, and has a thread of its own."""
        return Node(
            f'{self.get_name()}_{what}',
            context=self.context,
            namespace=self.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)],
        )

    def _offer(self, node: Node, name: str, kinds: tuple[CommandKind, ...]) -> None:
        """Offer a service below a node, for the commands that share it."""

        def serve(request: Any, response: Any) -> Any:
            answer = self._command(_asked_for(kinds, request))
            response.success = answer.success
            # In a rehearsal nobody must believe that a real kart was stopped.
            response.message = ': '.join(filter(None, (self._banner, answer.message)))
            return response

        # Also below another node a name is what it is in this one, remapped or not.
        own = f'~/{name}' if node is self else self.resolve_service_name(f'~/{name}')
        service = service_class(CATALOGUE[kinds[0]].service_type)
        node.create_service(service, own, serve, qos_profile=SERVICE_QOS)

    def _command(self, command: Command) -> Answer:
        try:
            if command.kind in (CommandKind.READ_ROSTER, CommandKind.TAKE_ROSTER):
                command = command._replace(roster=read_roster(self._roster))
            answer = self._server.command(command, clock.now())
            if answer is not None:
                return answer
        except (KartServerError, RosterError) as error:
            return Answer(False, f'{command.kind.value} was not sent: {error}.')
        return Answer(
            False,
            f'{command.kind.value} has not been answered for {ANSWER_TIMEOUT:g} s'
            + (
                '; use the MSR.'
                if CATALOGUE[command.kind].overtakes
                else '; check the race to see whether it took effect.'
            ),
        )


def _asked_for(kinds: tuple[CommandKind, ...], request: Any) -> Command:
    """Return the command of a request to the service that these commands share."""
    kind = next(
        each
        for each in kinds
        if all(getattr(request, name) == value for name, value in CATALOGUE[each].fixed.items())
    )
    entry = CATALOGUE[kind]
    taken: dict[str, Any] = {name: getattr(request, name) for name in entry.takes}
    taken |= {name: tidy(text) for name, text in taken.items() if isinstance(text, str)}
    if entry.names_heat:
        taken['heat'] = request.heat  # as the roster has it
    if entry.names_number:
        taken[entry.names_number] = getattr(request, entry.names_number)
    return Command(
        kind,
        request.kart if entry.to_one_kart else 0,
        entry.call_is_statement or (bool(entry.statement) and getattr(request, entry.statement)),
        frozenset(request.karts) if entry.names_karts else frozenset(),
        state_of(request.hold) if entry.names_hold else None,
        official=heard(request.official),
        age=_age(request.age) if entry.stop else 0.0,
        **taken,
    )


def _age(said: float) -> float:
    """Return the age of a press (s), whatever was sent as one; not a number: 0."""
    return min(said, MOST_AGE) if said > 0.0 else 0.0


def main(args: list[str] | None = None) -> int:
    """
    Run race control until SIGINT or SIGTERM; every kart is sent RED_RED at the end.

    :return: 0 after an orderly end, 1 after a failure (the karts were sent RED_RED, or lost their
        connection), 2 if a setting is wrong, 3 if another program is in the way. What a crashed
        race control left behind may be in the way for a few seconds.
    """
    # First: what ROS starts gets it too, and so does the kart server.
    priority.come_before_others()
    refusals = (ParameterError, GraphError, RosterError)
    obstacles = (RivalError, AddressTakenError, KartServerError)
    return run_node('rcs', RcsNode, refusals, args, obstacles=obstacles)


if __name__ == '__main__':
    sys.exit(main())
