# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A separate ROS context with a node and an executor that spins in the background."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import contextlib
import os
import threading
import time
from typing import Any, TypeVar

from evgp_node.graph import bind_graph, fence_graph
from evgp_node.spinning import Spinning
from evgp_testing.part import Part, PATIENCE
import rclpy
from rclpy.client import Client
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile

T = TypeVar('T')


class RosSide(Part):
    """
    A node on a domain, in this process, with methods that wait for what it receives.

    Subclasses subscribe, and ``learn`` what they hear. A method that
    waits raises AssertionError if what it waits for does not come within ``timeout`` seconds.
    """

    timeout = PATIENCE

    def __init__(self, name: str, domain: int, arguments: Sequence[str] = ()) -> None:
        """
        Join the domain and spin.

        :param arguments: the node's ROS arguments, from `--ros-args` on.
        """
        self.news = threading.Condition()
        self.failures: list[BaseException] = []
        self.context = Context()
        with bound():
            rclpy.init(context=self.context, domain_id=domain)
            self.node = Node(
                name,
                context=self.context,
                cli_args=list(arguments),
                use_global_arguments=False,
                start_parameter_services=False,  # nobody asks for them
            )
            fence_graph()
        self._spinning: Spinning | None = None

    def spin(self) -> None:
        """Start to receive. Call this once everything is subscribed."""
        self._spinning = Spinning(self.node, self.failures.append)

    def hear(self, kind: type, topic: str, qos: QoSProfile | int = 10) -> list[Any]:
        """Return a list to which every message of a topic is added from now on."""
        heard: list[Any] = []

        def add(message: Any) -> None:
            with self.news:
                heard.append(message)
                self.news.notify_all()

        self.node.create_subscription(kind, topic, add, qos)
        return heard

    def learn(self, **news: object) -> None:
        """Set these attributes, and wake whoever waits for news."""
        with self.news:
            vars(self).update(news)
            self.news.notify_all()

    def wait_until(self, found: Callable[[], T], what: Callable[[], str]) -> T:
        """
        Wait until `found` returns a true value, and return that value.

        :param what: returns, for the failure message, what was awaited and what came instead.
        """
        with self.news:
            value = self.news.wait_for(found, self.timeout)
            assert value, f'not within {self.timeout:g} s: {what()}'
        return value

    def wait_until_polled(self, found: Callable[[], object], what: str) -> None:
        """Wait until `found` is true. This polls, because nothing notifies of the change."""
        until = time.monotonic() + self.timeout
        while not found():
            assert time.monotonic() < until, f'not within {self.timeout:g} s: {what}'
            time.sleep(0.02)

    def request(self, client: Client, request: object) -> object:
        """Call a service and return its response."""
        assert client.wait_for_service(self.timeout), f'there is no service {client.srv_name}'
        done = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: done.set())
        answered = done.wait(self.timeout)
        assert answered, f'{client.srv_name} did not answer within {self.timeout:g} s'
        return future.result()

    def close(self) -> None:
        """
        Leave the domain.

        :raises AssertionError: if a callback of this side failed.
        """
        ended = self._spinning is None or self._spinning.stop(PATIENCE)
        assert ended, 'a callback has not returned'
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)
        assert not self.failures, self.failures


@contextlib.contextmanager
def bound() -> Iterator[None]:
    """
    Have DDS bind the nodes that are made in this block as it binds our programs.

    Make no node in a test's process without it: Fast DDS reads its settings once in each process,
    for the first node. With them, it uses no shared memory. Tests freeze and kill processes, and
    one that holds a lock there would delay all others for seconds.
    """
    with environment_kept():
        bind_graph()
        yield


@contextlib.contextmanager
def joined(domain: int) -> Iterator[Context]:
    """Provide a ROS context on a domain, whose nodes are bound as our programs are."""
    context = Context()
    with bound():
        rclpy.init(context=context, domain_id=domain)
        try:
            yield context
        finally:
            rclpy.try_shutdown(context=context)


@contextlib.contextmanager
def environment_kept() -> Iterator[None]:
    """Restore this process's environment afterwards."""
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        for name, value in before.items():
            if os.environ.get(name) != value:
                os.environ[name] = value
