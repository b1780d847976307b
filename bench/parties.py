# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The other ends of the measurements: processes that do as little as can be done."""

from __future__ import annotations

from multiprocessing.connection import Connection
import resource
import selectors
import socket
import time
from typing import Any

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_testing.race_control import address_of
from evgp_testing.wire_kart import KartLink


def floor(bench: Connection, count: int) -> None:
    """Write each state that the bench sends to every socket in a bare loop; say when it began."""
    with socket.create_server(('127.0.0.1', 0), backlog=4096) as listening:
        bench.send(listening.getsockname()[1])
        karts = []
        while len(karts) < count:
            kart, _ = listening.accept()
            kart.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            karts.append(kart)
        bench.send('ready')
        while True:
            frame = encode(bench.recv())
            began = time.monotonic()
            for kart in karts:
                kart.send(frame)
            bench.send(began)


def service(bench: Connection, domain: int) -> None:
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
    bench.send('ready')
    rclpy.spin(node)


def crowd(bench: Connection, port: int, count: int, acknowledges: bool) -> None:
    """
    Be plain karts 1 to N. For each state that the bench sends, say once all have seen it when.

    That is the monotonic time (s) at which the last of them had read the first frame of it.

    What a kart acknowledges while a state is watched for it says when all have seen the state:
    each would have a processor of its own, and none takes time from another that reads.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, max(soft, count + 100)), hard))
    selector = selectors.DefaultSelector()
    karts = [KartLink(address_of(number), ('127.0.0.1', port)) for number in range(1, count + 1)]
    for kart in karts:
        kart.socket.setblocking(False)
        selector.register(kart.socket, selectors.EVENT_READ, kart)
    selector.register(bench, selectors.EVENT_READ)
    unsaid: list[KartLink] = []
    wanted: RaceState | None = None
    bench.send('ready')
    while True:
        for key, _ in selector.select():
            kart = key.data
            if kart is None:
                wanted = bench.recv()
                continue
            heard = kart.take()
            if heard is None:
                selector.unregister(kart.socket)
            elif acknowledges:
                unsaid += [kart for _, change in heard if change]
        if wanted and any(each.state is not wanted for each in karts):
            continue
        if wanted:
            bench.send(max(each.changes[-1][0] for each in karts))
            wanted = None
        for each in unsaid:
            assert each.state is not None
            each.say(each.state)
        unsaid.clear()
