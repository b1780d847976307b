# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The other ends of the measurements: processes that do as little as can be done."""

from __future__ import annotations

import json
import socket
import sys
import time
from typing import Any

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState


def tell(value: object) -> None:
    """Answer with one line of JSON."""
    print(json.dumps(value), flush=True)


def floor(count: int) -> None:
    """Write a state to every socket in a bare loop, when told to; answer with when it began."""
    with socket.create_server(('127.0.0.1', 0), backlog=4096) as listening:
        tell(listening.getsockname()[1])
        karts = []
        while len(karts) < count:
            kart, _ = listening.accept()
            kart.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            karts.append(kart)
        tell('ready')
        for line in sys.stdin:
            frame = encode(RaceState[line.strip()])
            began = time.monotonic()
            for kart in karts:
                kart.send(frame)
            tell(began)


def service(domain: int) -> None:
    """Offer a bare ROS service."""
    import rclpy
    from rclpy.node import Node
    from std_srvs.srv import Trigger

    def serve(_: Any, response: Any) -> Any:
        response.success = True
        return response

    rclpy.init(domain_id=domain)
    node = Node('bare')
    node.create_service(Trigger, '/bare', serve)
    tell('ready')
    rclpy.spin(node)


if __name__ == '__main__':
    {'floor': floor, 'service': service}[sys.argv[1]](int(sys.argv[2]))
