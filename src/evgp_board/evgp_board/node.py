# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ``board`` node: the race, heard as any screen hears it, on web pages.

It subscribes, and has no way back: no client of a service, no publisher but those of every node.
A thread of its own runs the web server; ROS's only keeps what came last.
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

from evgp_board.server import Now, Server
from evgp_board.view import Heard, Line, line_of
from evgp_node.codec import value_of
from evgp_node.graph import EVERY, keep_to_interface, network_of, where_reachable
from evgp_node.parameters import check_address, ParameterError, Parameters, StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_node.qos import latched
from evgp_node.results import Standings, TIMING_GONE
from evgp_protocol import clock
from evgp_rcs.ros.messages import event_of, race_of
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs_msgs import msg
from rclpy.serialization import deserialize_message

GONE_AFTER = 0.9
"""Time without a snapshot after which race control counts as gone, as in the window, seconds."""

MOST_LOGGED = 8
"""Number of lines about one kart, the newest ones."""

BOARD_NICENESS = 5
"""Niceness of the board: it comes after all that commands or sees to karts."""

ACCEPT_QUEUE = 128
"""Maximum number of connections that wait to be taken."""


class PlaceError(RuntimeError):
    """The board may not listen where it was told to; the text says why, and what to do."""


class InTheWayError(PlaceError):
    """It cannot listen there now, and may be able to later."""


class BoardNode(StrictNode):
    """
    The node of a board.

    :param on_failure: is called, in another thread, when the board cannot go on.
    :raises ParameterError: if a parameter is wrong.
    :raises PlaceError: if it may or can not listen at that address.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        super().__init__('board', **{'namespace': 'rcs', **node_options})
        parameters = Parameters(self)
        self._address = parameters.declare(
            'address',
            '127.0.0.1',
            'The address of this machine at which viewers reach the board; never one on the '
            "karts' network.",
        )
        port = parameters.declare('port', 8080, 'TCP port of the pages.', (1, 65535))
        parameters.refuse_unknown()
        check_address('address', self._address)
        if self._address == EVERY:
            raise ParameterError(
                f"parameter address: {EVERY} is every network of this machine, also the karts'. "
                'Give the one address at which viewers are to reach the board'
            )
        self._listening = listen(self._address, port)
        self._on_failure = on_failure
        # Each is replaced as a whole, in ROS's thread, and read in the server's.
        self._race: tuple[bytes, float] | None = None
        self._results = Standings(), -math.inf
        self._log: dict[int, tuple[Line, ...]] = {}
        self._last_event = (0, 0)
        self._shown: tuple[object, ...] = ()
        self._heard = Heard()
        self.create_subscription(msg.Race, 'race', self._hear_race, latched(1), raw=True)
        self.create_subscription(msg.Results, 'timekeeper/results', self._hear_results, latched(1))
        self.create_subscription(msg.RaceEvents, 'events', self._hear_events, latched(200))
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, name='server', daemon=True)
        self._thread.start()
        self.get_logger().info(f'The board is at http://{self._address}:{port}/')
        self.get_logger().info(where_reachable())

    def close(self) -> None:
        """End the server; every viewer is dropped."""
        self._ending.set()
        self._thread.join()

    # ----- in ROS's thread ----------------------------------------------------------------

    def _hear_race(self, message: bytes) -> None:
        # Read only when it is looked at: there may be many in a second.
        self._race = message, clock.now()

    def _hear_results(self, message: msg.Results) -> None:
        with contextlib.suppress(ValueError):  # it is not of this race control
            self._results = value_of(message, Standings), clock.now()

    def _hear_events(self, message: msg.RaceEvents) -> None:
        log = dict(self._log)
        for each in message.events:
            try:
                stamped = event_of(each)
            except ValueError:
                continue  # it is not of this race control
            last, this = self._last_event, (stamped.sequence, stamped.wall_ns)
            line, kart = line_of(stamped), stamped.event.kart
            # The last ones come again after the network was away.
            if line is not None and not (this[0] <= last[0] and this[1] <= last[1]):
                self._last_event = this
                log[kart] = (*log.get(kart, ()), line)[-MOST_LOGGED:]
        self._log = log

    # ----- in the server's thread ---------------------------------------------------------

    def _serve(self) -> None:
        try:
            clock.run(Server(self._look).run(self._listening, self._ending))
        except BaseException as error:  # noqa: BLE001 - handed on
            self._on_failure(error)
        finally:
            self._listening.close()

    def _look(self, at: float) -> Now:
        """
        Return what there is to show.

        :raises PlaceError: if the board is where karts are.
        """
        keep_to_interface(self._listening, self._address)  # it has a new number once replugged
        if self._race is None:
            return Now(self._heard, None)
        (message, came), (results, timed), log = self._race, self._results, self._log
        gone, no_timing = at - came >= GONE_AFTER, at - timed >= TIMING_GONE
        shown = message, results, log, gone, no_timing
        if [*map(id, shown)] != [*map(id, self._shown)]:
            race = None
            with contextlib.suppress(ValueError):  # it is not of this race control
                race = race_of(deserialize_message(message, msg.Race))
                refuse_karts_network(self._address, race)
            self._shown, self._heard = shown, Heard(race, results, gone, no_timing, log)
        return Now(self._heard, at - came)


def listen(address: str, port: int) -> socket.socket:
    """
    Return a socket that listens at an address, for what comes through the interface that has it.

    :raises InTheWayError: if this machine does not have the address, or the port is taken.
    :raises PlaceError: if the port may not be used.
    """
    listening = socket.socket()
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((address, port))
        keep_to_interface(listening, address)
        listening.listen(ACCEPT_QUEUE)
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRNOTAVAIL:
            raise InTheWayError(
                f'this machine does not have the address {address}. Plug its network in, or give '
                'another (make board AT=...)'
            ) from error
        if error.errno == errno.EADDRINUSE:
            raise InTheWayError(
                f'another program listens at port {port} of {address}, perhaps another board. End '
                f"it, or give another port (ARGS='-p port:={port + 1}')"
            ) from error
        raise PlaceError(f'the board cannot listen at {address}, port {port}: {error}') from error
    return listening


def refuse_karts_network(address: str, race: Snapshot) -> None:
    """
    Refuse to be where karts are.

    :raises PlaceError: if a kart of the roster is on the network of this address.
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
                'Viewers must not be there: give the board an address on another network'
            )


def main(args: list[str] | None = None) -> int:
    """
    Run the node until SIGINT or SIGTERM.

    :return: 0 after an orderly end, 1 after a failure, 2 if a setting is wrong, 3 if the address
        is not there or taken.
    """
    os.nice(BOARD_NICENESS)
    refusals, obstacles = (ParameterError, PlaceError), (InTheWayError,)
    return run_node('board', BoardNode, refusals, args, obstacles)


if __name__ == '__main__':
    sys.exit(main())
