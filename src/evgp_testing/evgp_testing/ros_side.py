# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A separate ROS context, node and executor, spun in the background."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import contextlib
import os
import threading
import time
from typing import TypeVar

from evgp_node.graph import bind_graph, fence_graph
from evgp_node.spinning import Spinning
from evgp_testing.part import Part, PATIENCE
import rclpy
from rclpy.client import Client
from rclpy.context import Context
from rclpy.node import Node

T = TypeVar('T')


class RosSide(Part):
    """
    A node on a domain, in this process, with methods that wait for what it receives.

    Subclasses subscribe, change their data inside ``with self.news:`` and notify. Every wait lasts
    at most ``timeout`` seconds.
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
        with environment_kept():
            # Like our programs, without DDS's shared memory. Tests freeze and kill processes, and
            # one that holds a lock in that memory would delay every other one for seconds.
            bind_graph()
            rclpy.init(context=self.context, domain_id=domain)
            self.node = Node(
                name,
                context=self.context,
                cli_args=list(arguments),
                use_global_arguments=False,
            )
            fence_graph()
        self._spinning: Spinning | None = None

    def spin(self, only_serves: bool = False) -> None:
        """
        Start to receive; call this once everything is subscribed.

        :param only_serves: see ``Spinning``.
        """
        self._spinning = Spinning(self.node, self.failures.append, only_serves)

    def wait_until(self, found: Callable[[], T], what: Callable[[], str]) -> T:
        """
        Wait until `found` returns a true value, and return it.

        :param what: for the failure: returns what was awaited and what came instead.
        :raises AssertionError: if it does not become true in time.
        """
        with self.news:
            value = self.news.wait_for(found, self.timeout)
            assert value, f'not within {self.timeout:g} s: {what()}'
        return value

    def wait_until_polled(self, found: Callable[[], object], what: str) -> None:
        """
        Wait until `found` is true, by polling, because nothing notifies of it.

        :raises AssertionError: if it does not become true in time.
        """
        until = time.monotonic() + self.timeout
        while not found():
            assert time.monotonic() < until, f'not within {self.timeout:g} s: {what}'
            time.sleep(0.02)

    def request(self, client: Client, request: object) -> object:
        """
        Call a service and return its response.

        :raises AssertionError: if there is no such service, or no answer in time.
        """
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
