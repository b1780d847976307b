"""A ROS context, node and executor of one's own, spun in the background."""

from __future__ import annotations

from collections.abc import Callable
import threading
from typing import TypeVar

from race_parts.process import PATIENCE
import rclpy
from rclpy._rclpy_pybind11 import InvalidHandle
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

T = TypeVar('T')


class RosSide:
    """
    A node on a domain, in this process, and a place to await what it hears.

    Subclasses subscribe, change what they keep inside ``with self.news:`` and notify.
    Anything is awaited for ``patience`` seconds.
    """

    patience = PATIENCE

    def __init__(self, name: str, domain: int) -> None:
        """Join the domain and spin."""
        self.news = threading.Condition()
        self._closing = False
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node(name, context=self.context, use_global_arguments=False)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)

    def spin(self) -> None:
        """Begin to hear; called once everything is subscribed."""
        self._thread.start()

    def wait_until(self, found: Callable[[], T], what: Callable[[], str]) -> T:
        """
        Return what `found` returns as soon as that is true.

        :param what: says what was awaited and what there is, if it never becomes true.
        :raises AssertionError: if it does not become true in time.
        """
        with self.news:
            value = self.news.wait_for(found, self.patience)
            assert value, f'not within {self.patience:g} s: {what()}'
        return value

    def request(self, client: Client, request: object) -> object:
        """
        Call a service and return its response.

        :raises AssertionError: if there is no such service, or no answer in time.
        """
        assert client.wait_for_service(self.patience), f'there is no service {client.srv_name}'
        done = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: done.set())
        answered = done.wait(self.patience)
        assert answered, f'{client.srv_name} did not answer within {self.patience:g} s'
        return future.result()

    def close(self) -> None:
        """Leave the domain."""
        self._closing = True
        self._executor.shutdown()
        if self._thread.ident is not None:
            self._thread.join(PATIENCE)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            pass  # closed while waiting: that is how it ends
        except InvalidHandle:
            if not self._closing:  # closed while a message came in
                raise
