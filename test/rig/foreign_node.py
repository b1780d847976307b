# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A ROS program of anybody, with ROS's own settings: what it finds of a graph, and who answers it.

It runs as a process (``python foreign_node.py seconds name ...``). It looks around for so long,
listens, calls what it can, plays race control to the officials, and prints what it has found.
"""

from __future__ import annotations

from collections.abc import Mapping
import faulthandler
import json
import os
import sys
import time

from evgp_testing.part import PATIENCE
from evgp_testing.process import Program

LOOKS_FOR = 8.0
"""How long one looks around who must find nothing, seconds: far more than it ever takes."""


class ForeignNode(Program):
    """
    A running foreign node, in the network of the thread that starts it.

    :param environment: what its environment has of ROS and DDS; nothing else does.
    :param awaits: services and topics of which it hears in the end. It looks around until then, or
        for `LOOKS_FOR` if there are none.
    """

    def __init__(self, domain: int, environment: Mapping[str, str], *awaits: str) -> None:
        own = ('ROS_', 'RMW_', 'FASTRTPS_', 'FASTDDS_', 'CYCLONEDDS_', 'EVGP_')
        unset = [f'--unset={name}' for name in os.environ if name.startswith(own)]
        given = [f'{name}={value}' for name, value in environment.items()]
        looks = [sys.executable, __file__, str(PATIENCE if awaits else LOOKS_FOR), *awaits]
        super().__init__('foreign', ['env', *unset, f'ROS_DOMAIN_ID={domain}', *given, *looks])

    def found(self) -> set[str]:
        """
        Return the nodes that it saw, the topics that it heard, and the services that answered it.

        :raises AssertionError: if it hung; where, its output says.
        """
        self.process.wait(3 * PATIENCE)
        assert self.wait() == 0, self.output
        return {*json.loads(self.lines[-1])}


def look_around(seconds: float, *awaits: str) -> set[str]:
    """Look, call and listen for so long, or until all that is awaited has been heard."""
    from evgp_node.qos import latched
    from evgp_rcs_msgs import msg, srv
    import rclpy
    from rclpy.node import Node

    until = time.monotonic() + seconds
    rclpy.init()
    node = Node(f'foreign_{os.getpid()}')
    found: set[str] = set()
    waiting = {
        name: node.create_client(kind, name)
        for name, kind in (
            ('/rcs/all_kill', srv.RaceCommand),
            ('/kart_bridge/acknowledge', srv.Acknowledge),
        )
    }
    for name, kind in (('/rcs/race', msg.Race), ('/kart_bridge/race_state', msg.KartRaceState)):
        # Other foreign nodes publish a race without karts.
        node.create_subscription(
            kind,
            name,
            lambda said, name=name: getattr(said, 'karts', True) and found.add(name),
            latched(1),
        )
    race = node.create_publisher(msg.Race, '/rcs/race', latched(1))
    while time.monotonic() < until and not (awaits and found.issuperset(awaits)):
        # In turns of their own: several hear each other, and would keep each other busy.
        turn = time.monotonic() + 0.2
        while (left := turn - time.monotonic()) > 0.0:
            rclpy.spin_once(node, timeout_sec=left)
        for name, namespace in node.get_node_names_and_namespaces():
            if not name.startswith(('foreign', '_')):  # none of these, and known
                found.add(f'{namespace.rstrip("/")}/{name}')
        race.publish(msg.Race())
        for name, client in [*waiting.items()]:
            if client.service_is_ready():
                del waiting[name]
                asked = client.call_async(client.srv_type.Request())
                asked.add_done_callback(lambda _, name=name: found.add(name))
    return found


if __name__ == '__main__':
    # Ends one that hangs in DDS, and says where.
    faulthandler.dump_traceback_later(float(sys.argv[1]) + PATIENCE, exit=True)
    print(json.dumps([*look_around(float(sys.argv[1]), *sys.argv[2:])]), flush=True)
    os._exit(0)
