# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ``rcs`` node: the ROS half of race control, which serves officials (§4.B).

The kart server, with the rules and the karts' sockets, is another process (``karts.process``).
This process starts the kart server, and neither outlives the other. This process has these
threads:

- Three threads serve officials' calls. One serves stops, one serves the commands that read the
  roster, and one serves the rest. Each thread passes a command to the kart server and waits for
  the answer. A stop therefore never waits behind another kind of call, and no other command waits
  while a disk is slow to return the roster.
- The client's thread (``kart_client``) hears the kart server.
- The asking thread calls this node repeatedly, as an official's program would. As long as the
  calls arrive, it gives the kart server signs of life. It also reports who can stop the race, and
  checks the graph.
- The publisher's thread (``publisher``) publishes the race and its events, and logs them.
- The watch's thread (``address_watch``) notices if another machine has race control's address.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import dataclasses
import ipaddress
import itertools
import sys
import threading
from typing import Any

from evgp_node.graph import (
    EVERY,
    Inbox,
    refuse_open_graph,
    trouble_of_graph,
)
from evgp_node.official import heard, tidy
from evgp_node.parameters import StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_node.qos import volatile
from evgp_node.rclpy_private import RCLError
from evgp_node.roster import RosterError
from evgp_node.states import state_of
from evgp_protocol import clock
from evgp_rcs.karts import priority
from evgp_rcs.karts.address_watch import AddressTakenError, AddressWatch, to_be_asked
from evgp_rcs.karts.channel import ANSWER_TIMEOUT, Begin, KartServerError
from evgp_rcs.record.run_mark import leave_began, place
from evgp_rcs.ros.kart_client import KartServerClient
from evgp_rcs.ros.presence import MOST_PROGRAMS, Presences
from evgp_rcs.ros.publisher import RacePublisher
from evgp_rcs.ros.rival import claim_the_graph, look_for_rivals, refuse_rivals, RivalError
from evgp_rcs.ros.settings import read_roster, read_settings
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind, kinds_by_service
from evgp_rcs.rules.race import Answer, Command, StampedEvent
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs_msgs import msg, srv
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
"""Time between two signs of life to the kart server, in seconds. After 1 s without one, the kart
server sends RED_RED to every kart."""

CALL_EVERY = 2
"""Number of signs of life for each call that race control makes to itself."""

MOST_UNHEARD = 4
"""Maximum number of these calls in a row that do not arrive, or of checks in a row that find the
same datagram unread. One more ends race control, after 2 s. Race control counts the calls instead
of measuring time, because a stopped process makes no calls."""

GRAPH_LOOK = 10
"""Number of signs of life for each check of the graph. A check takes the kernel up to 1 ms."""

SERVICE_QOS = volatile(1000)
"""QoS of the services. With ROS's usual depth of 10, the eleventh stop of a burst would push out
the first stop before its answer. With KEEP_ALL, a client that does not read its answers could
block the others."""


PRESENCE_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
    liveliness=LivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=Infinite,
)
"""QoS of ``~/presence``. It requests the weakest liveliness, so that race control can hear every
program. After `presence.SILENT_AFTER` of silence, race control considers a program gone."""


READ_THE_ROSTER = (CommandKind.READ_ROSTER, CommandKind.TAKE_ROSTER)
"""The commands for which race control reads the roster's file, however long the disk takes."""

READS: dict[str, Callable[[Any], Any]] = {'karts': frozenset, 'hold': state_of, 'run': tidy}
"""The fields of requests (``Entry.takes``) that race control converts. A heat's name is not one of
them, because it is exactly as the roster writes it."""

ENDS = 'Race control sends RED_RED to every kart and ends. Use the MSR if a kart is still moving'
"""What officials read after the reason why race control cannot go on."""

MOST_AGE = 86_400.0
"""Maximum age of a press, in seconds (one day). The age of an older press is set to this."""


class DeafError(RuntimeError):
    """Race control's calls to itself do not arrive, so officials' calls would not either."""


class RcsNode(StrictNode):
    """
    Race control's node.

    :param on_failure: called in another thread when race control cannot go on and the process must
        end. Every kart has then been sent RED_RED, or ``close`` sends it.
    :param node_options: further arguments for the node of rclpy.
    :raises ParameterError: if a parameter is wrong.
    :raises RosterError: if the roster is wrong.
    :raises KartServerError: if the kart server cannot start.
    :raises GraphError: if programs where karts connect could reach the ROS graph.
    :raises RivalError: if another race control runs on the ROS graph.
    :raises AddressTakenError: if another machine has race control's address.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        super().__init__('rcs', **node_options)
        accept_open_graph = self.declare(
            'accept_open_graph',
            False,
            'Accept that the ROS graph can be reached from where karts connect, without SROS2. '
            "Anyone on the karts' network can then start karts (docs/security.md).",
        )
        self._banner = self.declare(
            'banner',
            '',
            'Text at the top of every screen and at the beginning of every answer, such as '
            'REHEARSAL. Empty means none. People take the text to mean that no race is under way, '
            'so never set it for a race.',
        )
        officials = self.declare(
            'officials',
            [''],
            "Names of the event's officials. A window offers them to whoever sends commands "
            'from it.',
        )
        begin = read_settings(self)
        self._roster = str(self.get_parameter('roster').value)
        if not accept_open_graph:
            refuse_open_graph(begin.settings.host)
        self._claim = claim_the_graph(self)
        # The watch already asks while this process looks for rivals.
        self._addresses = [each.address for each in begin.roster.karts]
        self._watch = AddressWatch(
            lambda there: to_be_asked(begin.settings.host, self._addresses, there)
        )
        try:
            refuse_rivals(self)
            begin = self._after_the_first_look(begin)
        except (RivalError, AddressTakenError):
            # Another machine may run the race, so this machine's mark of its last run proves
            # nothing any longer.
            with contextlib.suppress(OSError):  # without a mark, there is no proof either
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
            on_news=self._take_news,
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

    def close(self) -> None:
        """Send every kart RED_RED, close their connections, and publish the remaining events."""
        if self._failure:
            # Do this first, because the rest may take a while.
            self._server.end(in_order=False)
            self._publisher.stop()
            try:
                self._publisher.last_words(self._failure)
            except RCLError as error:  # after 2038, Fast DDS publishes nothing
                self.get_logger().error(
                    f'Race control cannot report to officials that it ends: {error}'
                )
        self._server.stop(in_order=not self._failure)
        self._publisher.stop()
        self._closing.set()
        self._asking.join()
        self._watch.close()

    def _after_the_first_look(self, begin: Begin) -> Begin:
        """
        Wait long enough for any other machine that has the address to answer.

        :return: what to start with, including why another machine cannot be ruled out.
        :raises AddressTakenError: if another machine has answered.
        """
        try:
            not_known = self._watch.first_look()
        except AddressTakenError as error:
            raise AddressTakenError(
                f'{error}, so karts could connect to either machine. Unplug one of the two, or '
                'end the other race control and remove its address'
            ) from error
        if not not_known or ipaddress.IPv4Address(begin.settings.host).is_loopback:
            return begin
        if begin.settings.host == EVERY:
            # No setting names the address at which karts look for race control.
            self.get_logger().info(
                f'Race control does not look for other race controls: {not_known}'
            )
            return begin
        self.get_logger().warning(
            f'Race control cannot rule out a second race control: {not_known}'
        )
        return dataclasses.replace(begin, cannot_know=not_known)

    def _take_news(self, news: list[StampedEvent] | Snapshot) -> None:
        if isinstance(news, Snapshot):
            self._addresses = [kart.address for kart in news.karts if kart.address]
        self._publisher.publish(news)

    def _hear_watch(self) -> None:
        """Act on what the watch of the address has found, in the watch's thread."""
        if self._watch.error is not None:
            why = 'can no longer see whether another machine has its address'
            self._fail(f'Race control {why}. {ENDS}', self._watch.error)
        elif self._watch.answer:
            found = f'{self._watch.answer[0].upper()}{self._watch.answer[1:]}'
            self._fail(
                f"{found}, which is race control's. {ENDS}, and unplug one of the two machines",
                AddressTakenError(self._watch.answer),
            )
        else:
            self._give_sign_of_life()

    def _give_sign_of_life(self) -> None:
        with self._signing:
            try:
                there = self._presences.attendance(clock.now())
                self._server.alive(self._rival, there, self._watch.cut_off)
            except KartServerError:
                pass  # the client's thread notices and reports the end of the kart server

    def _publisher_failed(self, error: BaseException) -> None:
        self._fail(f'Race control has failed ({error}). {ENDS}', error)

    def _kart_server_ended(self, why: str) -> None:
        text = f'Race control has ended, and no kart is connected ({why}). Use the MSR'
        self._fail(text, KartServerError(why))

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
                    self._publisher.publish(trouble)
            if sign % CALL_EVERY == 0:
                missing, unread = self._calls - self._heard, inbox.unread()
                if max(missing, unread) > MOST_UNHEARD:
                    # The signs of life also stop here, in case `_fail` does not end the process.
                    self._fail(
                        f'Race control no longer hears officials. {ENDS}',
                        DeafError(
                            "officials' calls do not arrive through DDS: race control misses "
                            f'{missing} calls to itself in a row, and has found a datagram unread '
                            f'{unread} times in a row'
                        ),
                    )
                    return
                self._rival = look_for_rivals(self)
                self._calls += 1
                called = self._self_call.call_async(SignOfLife.Request(number=self._calls))
                self._self_call.remove_pending_request(called)
            self._give_sign_of_life()
            if self._closing.wait(ALIVE_EVERY):
                return

    def _hear(self, request: Any, response: Any) -> Any:
        """Receive one of this process's calls to itself, in the thread that serves stops."""
        # A call of another program also shows that calls arrive, but its number may be wrong.
        self._heard = max(self._heard, min(request.number, self._calls))
        return response

    def _hear_presence(self, message: msg.Presence) -> None:
        if not self._presences.hear(message, clock.now()):
            self.get_logger().warning(
                f'More than {MOST_PROGRAMS} programs announce that officials can stop the race '
                'from them. Race control ignores the rest',
                throttle_duration_sec=60.0,
            )

    # ----- services -----------------------------------------------------------------------

    def _offer_services(self) -> None:
        # One thread serves each node. On a shared node, a stop would often wait behind calls of
        # other services, so stops have a node of their own. A command that waited behind another
        # one would also seem newer than it is, as if its sender knew of the latest stop.
        stops, roster = self._node_beside('stops'), self._node_beside('roster')
        self.beside = (stops, roster)
        # The call to itself goes from one node to another through DDS's sockets and threads, as a
        # stop does. A thread makes the call, because some middlewares run timers by the wall
        # clock. Race control ignores the answers, because only the arrival of the call matters.
        name = self.resolve_service_name('~/sign_of_life')
        stops.create_service(SignOfLife, name, self._hear, qos_profile=SERVICE_QOS)
        self._self_call = self.create_client(SignOfLife, name, qos_profile=SERVICE_QOS)
        for name, kinds in kinds_by_service().items():
            entry = CATALOGUE[kinds[0]]
            node = stops if entry.overtakes else self
            self._offer(roster if kinds[0] in READ_THE_ROSTER else node, name, kinds)

    def _node_beside(self, what: str) -> Node:
        """Return another node of this process, which only offers services, in its own thread."""
        node = Node(
            f'{self.get_name()}_{what}',
            context=self.context,
            namespace=self.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)],
        )
        # rclpy's own one, of /parameter_events, would log every node that cannot read it, and a
        # stop would wait meanwhile.
        for each in [*node.publishers]:
            node.destroy_publisher(each)
        return node

    def _offer(self, node: Node, name: str, kinds: tuple[CommandKind, ...]) -> None:
        """Offer at this node the service that these kinds of commands share."""

        def serve(request: Any, response: Any) -> Any:
            answer = self._command(_asked_for(kinds, request))
            response.success = answer.success
            # In a rehearsal, officials must not believe that a real kart was stopped.
            response.message = ': '.join(filter(None, (self._banner, answer.message)))
            return response

        # At the other nodes, the service has the name that it would have at this node, even if
        # this node is remapped.
        own = f'~/{name}' if node is self else self.resolve_service_name(f'~/{name}')
        service = getattr(srv, CATALOGUE[kinds[0]].service_type)
        node.create_service(service, own, serve, qos_profile=SERVICE_QOS)

    def _command(self, command: Command) -> Answer:
        came = clock.now()
        try:
            if command.kind in READ_THE_ROSTER:
                command = command._replace(roster=read_roster(self._roster))
                took = clock.now() - came
                if took > ANSWER_TIMEOUT:  # so old a command has expired
                    why = f'the disk took {took:.1f} s to return the roster. Send it again'
                    raise RosterError(why)
            answer = self._server.command(command, came)
            if answer is not None:
                return answer
        except RosterError as error:
            return Answer(False, f'{command.kind.value} changed nothing: {error}.')
        except KartServerError as error:
            return Answer(False, f'{command.kind.value} was not sent: {error}.')
        return Answer(
            False,
            f'{command.kind.value} had no answer within {ANSWER_TIMEOUT:g} s'
            + (
                '; use the MSR.'
                if CATALOGUE[command.kind].overtakes
                else '; check the race to see whether it took effect.'
            ),
        )


def _asked_for(kinds: tuple[CommandKind, ...], request: Any) -> Command:
    """Return the command that a request means, among the kinds that share the service."""
    kind = next(
        each
        for each in kinds
        if all(getattr(request, name) == value for name, value in CATALOGUE[each].fixed.items())
    )
    entry = CATALOGUE[kind]
    taken = {name: getattr(request, name) for name in entry.takes}
    taken |= {name: read(taken[name]) for name, read in READS.items() if name in taken}
    return Command(
        kind,
        request.kart if entry.to_one_kart else 0,
        entry.call_is_statement or (bool(entry.statement) and getattr(request, entry.statement)),
        official=heard(request.official),
        age=_age(request.age) if entry.stop else 0.0,
        **taken,
    )


def _age(said: float) -> float:
    """Return the age of a press, in seconds, from an untrusted number; 0 if that is NaN."""
    return min(said, MOST_AGE) if said > 0.0 else 0.0


def main(args: list[str] | None = None) -> int:
    """
    Run race control until SIGINT or SIGTERM, and then send every kart RED_RED.

    :return: 0 after an orderly end. 1 after a failure, in which every kart was sent RED_RED or
        lost its connection. 2 if a setting is wrong. 3 if another program is in the way. For a few
        seconds after a crash, that may be what is left of race control.
    """
    # Do this first, so that the kart server and ROS's threads inherit the priority.
    priority.come_before_others()
    obstacles = (RivalError, AddressTakenError, KartServerError)
    return run_node('rcs', RcsNode, args, (RosterError,), obstacles, always_here=True)


if __name__ == '__main__':
    sys.exit(main())
