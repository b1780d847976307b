# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ``board`` node shows the race on web pages.

It receives the race as any screen does, but cannot reach race control: it has no service clients,
and only the publishers that every node has. The web server runs in its own thread, and ROS's
thread only stores the newest messages.
"""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import math
import os
import socket
import sys
import threading
from typing import Any

from evgp_board.server import Server
from evgp_board.view import Heard, Line, line_of
from evgp_node.codec import value_of
from evgp_node.graph import EVERY, keep_to_interface, network_of
from evgp_node.parameters import check_address, ParameterError, StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_node.qos import latched
from evgp_node.results import Standings, TIMING_GONE
from evgp_protocol import clock
from evgp_protocol.loop import run
from evgp_rcs.ros.messages import event_of
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import GONE_AFTER
from evgp_rcs_msgs import msg
from rclpy.serialization import deserialize_message


class PlaceError(RuntimeError):
    """The board must not listen at its address. The text says why, and what to do."""


class InTheWayError(PlaceError):
    """The board cannot listen at its address now, but perhaps later."""


class BoardNode(StrictNode):
    """
    The node of a board.

    :param on_failure: called with the error, in another thread, if the board cannot go on.
    :raises ParameterError: if a parameter is wrong.
    :raises PlaceError: if the board must not or cannot listen at that address.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        super().__init__('board', **{'namespace': 'rcs', **node_options})
        self._address = self.declare(
            'address',
            '127.0.0.1',
            "This machine's address for viewers, never one on the karts' network.",
        )
        port = self.declare('port', 8080, 'TCP port of the pages.', (1, 65535))
        self.refuse_unknown()
        check_address('address', self._address)
        if self._address == EVERY:
            raise ParameterError(
                f'parameter address: {EVERY} means every network of this machine, including the '
                "karts'. Set the one address at which viewers reach the board"
            )
        self._listening = listen(self._address, port)
        self._on_failure = on_failure
        # ROS's thread replaces each of these as a whole, and the server's thread reads them.
        self._race: tuple[bytes, float] | None = None
        self._results = Standings(), -math.inf
        self._log: dict[int, tuple[Line, ...]] = {}
        self._last_event = (0, 0)
        self.create_subscription(msg.Race, 'race', self._hear_race, latched(1), raw=True)
        self.create_subscription(msg.Results, 'timekeeper/results', self._hear_results, latched(1))
        self.create_subscription(msg.RaceEvents, 'events', self._hear_events, latched(200))
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, name='server', daemon=True)
        self._thread.start()
        self.get_logger().info(f'The board is at http://{self._address}:{port}/')

    def close(self) -> None:
        """End the server and drop every viewer."""
        self._ending.set()
        self._thread.join()

    # ----- in ROS's thread ----------------------------------------------------------------

    def _hear_race(self, message: bytes) -> None:
        # `_look` decodes the message, because many may arrive at once.
        self._race = message, clock.now()

    def _hear_results(self, message: msg.Results) -> None:
        with contextlib.suppress(ValueError):  # it does not fit this race control
            self._results = value_of(message, Standings), clock.now()

    def _hear_events(self, message: msg.RaceEvents) -> None:
        log = dict(self._log)
        for each in message.events:
            try:
                stamped = event_of(each)
            except ValueError:
                continue  # it does not fit this race control
            last, this = self._last_event, (stamped.sequence, stamped.wall_ns)
            line, kart = line_of(stamped), stamped.event.kart
            # After a network failure, the last events come again.
            if line is not None and not (this[0] <= last[0] and this[1] <= last[1]):
                self._last_event = this
                log[kart] = (*log.get(kart, ()), line)[-8:]  # as many as a phone shows
        self._log = log

    # ----- in the server's thread ---------------------------------------------------------

    def _serve(self) -> None:
        try:
            run(Server(self._look).run(self._listening, self._ending))
        except BaseException as error:  # noqa: BLE001 - passed on
            self._on_failure(error)
        finally:
            self._listening.close()

    def _look(self, at: float) -> Heard:
        """
        Return the messages to show.

        :raises PlaceError: if the board is on the karts' network.
        """
        keep_to_interface(self._listening, self._address)  # it may have been replugged
        if self._race is None:
            return Heard()
        (message, came), (results, timed), race = self._race, self._results, None
        with contextlib.suppress(ValueError):  # it does not fit this race control
            race = value_of(deserialize_message(message, msg.Race), Snapshot)
            refuse_karts_network(self._address, race)
        gone, no_timing = at - came >= GONE_AFTER, at - timed >= TIMING_GONE
        return Heard(race, results, gone, no_timing, self._log, came)


def listen(address: str, port: int) -> socket.socket:
    """
    Return a socket that listens at an address, and only on the interface that has it.

    :raises InTheWayError: if this machine does not have the address, or the port is taken.
    :raises PlaceError: if the board cannot listen there for another reason.
    """
    listening = socket.socket()
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((address, port))
        keep_to_interface(listening, address)
        listening.listen(128)  # connections may wait until the server accepts them
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRNOTAVAIL:
            raise InTheWayError(
                f'this machine does not have the address {address}. Connect its network, or use '
                'another address (make board AT=...)'
            ) from error
        if error.errno == errno.EADDRINUSE:
            raise InTheWayError(
                f'another program, perhaps another board, is using port {port} of {address}. '
                f"End it, or use another port (ARGS='-p port:={port + 1}')"
            ) from error
        raise PlaceError(f'the board cannot listen at {address}, port {port}: {error}') from error
    return listening


def refuse_karts_network(address: str, race: Snapshot) -> None:
    """
    Refuse to listen on the karts' network.

    :raises PlaceError: if a kart on the roster is on the network of this address.
    """
    network = network_of(address)
    for kart in race.karts:
        try:
            at = ipaddress.IPv4Address(kart.address)
        except ValueError:
            continue
        if network is not None and at in network and not at.is_loopback:
            raise PlaceError(
                f"{address} is on the karts' network ({network}): kart {kart.number} is {at}. "
                'Viewers must not share that network. Give the board an address on another one'
            )


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM and return the exit code of `run_node`."""
    os.nice(5)  # programs that command or serve karts run first
    return run_node('board', BoardNode, args, refusals=(PlaceError,), obstacles=(InTheWayError,))


if __name__ == '__main__':
    sys.exit(main())
