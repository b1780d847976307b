# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Protection against a second race control on the same ROS graph.

The answers and races of two race controls would mix, and officials could not tell them apart. The
second one therefore does not start (`claim_the_graph`, `refuse_rivals`). If two graphs are joined
later, both race controls notice (`look_for_rivals`). For the karts' network, ``address_watch``
checks whether another machine has race control's address.
"""

from __future__ import annotations

import socket
import time

from evgp_node.graph import reachable_at
from rclpy.node import Node

FIRST_LOOK = 1.5
"""Time for which race control looks for rivals on other machines before it starts, in seconds."""

_STEP = 0.05


class RivalError(RuntimeError):
    """Another race control runs on this graph. The text says what to do."""


def claim_the_graph(node: Node) -> socket.socket:
    """
    Claim the node's name on this machine's graph, for as long as the returned socket is open.

    The claim is an abstract UNIX socket. The kernel keeps such sockets separately for each network
    namespace, like the loopback interface that the graph uses. It removes them when the process
    ends.

    :raises RivalError: if another process holds the claim.
    """
    name = node.get_fully_qualified_name()
    domain = node.context.get_domain_id()
    claim = socket.socket(socket.AF_UNIX)
    try:
        claim.bind(f'\0evgp race control {name} on domain {domain}')
    except OSError as error:
        claim.close()
        raise RivalError(
            f'another race control runs on this machine as {name} on ROS domain {domain}. '
            'End it first, or give this one another ROS_DOMAIN_ID'
        ) from error
    return claim


def refuse_rivals(node: Node) -> None:
    """
    Refuse to start if another machine on the graph runs a race control.

    Call this before the node publishes the race. It takes `FIRST_LOOK`, unless the graph stays on
    this machine.

    :raises RivalError: if there is another race control.
    """
    if not reachable_at():
        return  # the graph stays on this machine, so the claim is enough
    until = time.monotonic() + FIRST_LOOK
    while time.monotonic() < until:
        if look_for_rivals(node):
            raise RivalError(
                f'another race control publishes {node.resolve_topic_name("~/race")} on ROS '
                f'domain {node.context.get_domain_id()}. End it first, or give this one another '
                'ROS_DOMAIN_ID'
            )
        time.sleep(_STEP)  # rclpy cannot wait for a change of the graph


def look_for_rivals(node: Node) -> bool:
    """
    Return whether another node publishes the topic of this race control's race.

    The result stays True for 20 s after a rival was killed, until DDS gives the rival up. The call
    takes a few microseconds per publisher and never blocks. Any thread may make it.
    """
    topic = node.resolve_topic_name('~/race')
    own = sum(publisher.topic_name == topic for publisher in node.publishers)
    return bool(node.count_publishers(topic) > own)
