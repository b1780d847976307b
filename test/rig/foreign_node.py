# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A ROS program of anybody, with ROS's own settings: what it finds of a graph, and who answers it.

It runs as a process (``python foreign_node.py seconds name ...``). It looks around for so long,
calls every command it knows in all the ways that are dangerous, plays race control to the
officials, and prints what came of it.
"""

from __future__ import annotations

from collections.abc import Mapping
import contextlib
import dataclasses
import faulthandler
import json
import os
import subprocess
import sys
import time
from typing import Any

from evgp_testing.part import PATIENCE

LOOKS_FOR = 8.0
"""How long one looks around who must find nothing, seconds: far more than it ever takes."""


@dataclasses.dataclass(frozen=True)
class Findings:
    """
    What a foreign node found.

    :ivar seen: the nodes of others, their services, and the topics that they publish or listen to.
    :ivar answered: the calls that were answered.
    :ivar heard: the topics on which something came.
    """

    seen: list[str]
    answered: list[str]
    heard: list[str]

    @property
    def got_in(self) -> bool:
        """Return whether it found anything at all."""
        return bool(self.seen or self.answered or self.heard)


class ForeignNode:
    """
    A running foreign node, in the network of the thread that starts it.

    :param environment: what its environment has of ROS and DDS; nothing else does.
    :param awaits: services and topics of which it hears in the end. It looks around until then, or
        for `LOOKS_FOR` if there are none.
    """

    def __init__(self, domain: int, environment: Mapping[str, str], *awaits: str) -> None:
        self._seconds = PATIENCE if awaits else LOOKS_FOR
        own = ('ROS_', 'RMW_', 'FASTRTPS_', 'FASTDDS_', 'CYCLONEDDS_', 'EVGP_')
        self._process = subprocess.Popen(
            [sys.executable, __file__, str(self._seconds), *awaits],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            env={
                **{name: value for name, value in os.environ.items() if not name.startswith(own)},
                'ROS_DOMAIN_ID': str(domain),
                **environment,
            },
        )

    def findings(self) -> Findings:
        """
        Return what it found, once it has looked.

        :raises AssertionError: if it hung; where, stands on its stderr.
        """
        printed, _ = self._process.communicate(timeout=self._seconds + 2 * PATIENCE)
        assert printed, 'the foreign node has not looked around to its end'
        return Findings(**json.loads(printed.splitlines()[-1]))


def look_around(seconds: float, *awaits: str) -> Findings:
    """Look, call and listen for so long, or until all that is awaited has been heard."""
    from evgp_node.qos import latched
    from evgp_rcs_msgs import msg, srv
    from evgp_testing.official import SERVICES
    import rclpy
    from rclpy.node import Node, NodeNameNonExistentError
    from std_msgs.msg import Bool
    from std_srvs.srv import SetBool

    until = time.monotonic() + seconds
    rclpy.init()
    # Several may be in one graph; they are no finding.
    node = Node(f'foreign_{os.getpid()}')
    heard: set[str] = set()
    answered: set[str] = set()
    commands: dict[str, tuple[Any, Any]] = {
        f'/rcs/{name}': (kind, most_dangerous(kind)) for name, kind in SERVICES.items()
    }
    commands['/kart_bridge/acknowledge'] = srv.Acknowledge, srv.Acknowledge.Request()
    commands['/kart_bridge/team_stop'] = SetBool, SetBool.Request(data=True)
    clients = {
        name: (node.create_client(kind, name), request)
        for name, (kind, request) in commands.items()
    }
    state = '/kart_bridge/race_state'
    node.create_subscription(msg.KartRaceState, state, lambda _: heard.add(state), latched(1))
    node.create_subscription(
        msg.Race, '/rcs/race', lambda race: race.karts and heard.add('/rcs/race'), latched(1)
    )
    stop = node.create_publisher(Bool, '/kart_bridge/tsr', latched(1))
    race = node.create_publisher(msg.Race, '/rcs/race', latched(1))
    asked: set[str] = set()
    seen: set[str] = set()
    while time.monotonic() < until:
        # In turns of their own: several hear each other, and would keep each other busy.
        turn = time.monotonic() + 0.2
        while (left := turn - time.monotonic()) > 0.0:
            rclpy.spin_once(node, timeout_sec=left)
        there = [each for each in node.get_node_names_and_namespaces() if of_others(each[0])]
        for name, namespace in there:
            seen.add(f'{namespace.rstrip("/")}/{name}')
            with contextlib.suppress(NodeNameNonExistentError):  # gone since
                offered = node.get_service_names_and_types_by_node(name, namespace)
                seen |= {service for service, _ in offered}
        for topic in ('/rcs/race', '/rcs/events', '/kart_bridge/race_state', '/kart_bridge/tsr'):
            ends = (
                *node.get_publishers_info_by_topic(topic),
                *node.get_subscriptions_info_by_topic(topic),
            )
            if any(of_others(end.node_name) for end in ends):
                seen.add(topic)
        stop.publish(Bool(data=True))
        race.publish(msg.Race())
        for name, (client, request) in clients.items():
            if name not in asked and client.service_is_ready():
                asked.add(name)
                client.call_async(request).add_done_callback(
                    lambda _, name=name: answered.add(name)
                )
        if awaits and {*awaits} <= answered | heard and answered == asked:
            break
    return Findings(sorted(seen), sorted(answered), sorted(heard))


def of_others(name: str) -> bool:
    """Return whether a node is known, and none of these."""
    return not name.startswith(('foreign', '_'))


def most_dangerous(kind: Any) -> Any:
    """Return a request with every statement made."""
    request = kind.Request()
    for field, of in request.get_fields_and_field_types().items():
        if of == 'boolean':
            setattr(request, field, True)
    return request


if __name__ == '__main__':
    # Ends one that hangs in DDS, and says where.
    faulthandler.dump_traceback_later(float(sys.argv[1]) + PATIENCE, exit=True)
    print(
        json.dumps(dataclasses.asdict(look_around(float(sys.argv[1]), *sys.argv[2:]))), flush=True
    )
    os._exit(0)
