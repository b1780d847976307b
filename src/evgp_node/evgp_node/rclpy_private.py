# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The only module of ours that uses private parts of rclpy.

It exports two errors that have no public name, and does what the public executors cannot: drop
calls and messages that cannot be read, answer a stop without a new wait set, and take everything
that is waiting in a subscription.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
from typing import Any

from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
)
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.service import Service
from rclpy.subscription import Subscription

__all__ = ['Executor', 'RCLError', 'Server', 'UnknownROSArgsError', 'take_waiting']

UNREADABLE_LOG_AGAIN = 1.0
"""Minimum time between two log lines about calls that cannot be read, in seconds."""


class Executor(SingleThreadedExecutor):
    """
    An executor for a graph in which anyone may send anything.

    rclpy raises an error when it receives something that it cannot read, and the error would lock
    the node's callbacks forever. This executor drops what it cannot read instead.
    """

    def __init__(self, node: Node) -> None:
        super().__init__(context=node.context)
        self._log = node.get_logger()
        self.add_node(node)

    def run_next(self, is_over: Callable[[], bool]) -> None:
        """Wait for a callback and run it, or return without one as soon as `is_over` is true."""
        try:
            handler, entity, _ = self.wait_for_ready_callbacks(None, None, is_over)
        except (ShutdownException, ConditionReachedException):
            return
        handler()
        error = handler.exception()
        if error is None:
            return
        if not isinstance(entity, Service):
            raise error
        # The callback itself refuses calls that fail, so here it was the answer that failed.
        _dropped(self._log, f'The answer of {entity.srv_name} could not be sent', error)

    def _take_service(self, srv: Any) -> Any:
        return self._taken(super()._take_service, srv, f'A call of {srv.srv_name}')

    def _take_subscription(self, sub: Any) -> Any:
        return self._taken(super()._take_subscription, sub, f'A message on {sub.topic_name}')

    def _take_client(self, client: Any) -> Any:
        return self._taken(super()._take_client, client, f'An answer of {client.srv_name}')

    def _taken(self, take: Callable[[Any], Any], entity: Any, what: str) -> Any:
        try:
            return take(entity)
        except Exception as error:  # noqa: BLE001 - from another machine
            _dropped(self._log, f'{what} could not be read', error)
            return None


class Server:
    """
    An executor with a single wait set, for a node that only offers services.

    rclpy's executor creates a new wait set, a task and two coroutines for each callback, which
    would delay a stop by 0.2 ms (docs/dev/decisions.md, 6).
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._log = node.get_logger()
        self._services = tuple(node.services)
        self._wake = GuardCondition(None, None, node.context)
        # The node's only waitables are those of /parameter_events, which every node publishes.
        others = (*node.subscriptions, *node.timers, *node.guards)
        assert not others, f'{node.get_name()} has more than services'
        self._waits = rclpy_implementation.WaitSet(
            0, 1, 0, 0, len(self._services), 0, node.context.handle
        )
        node.context.on_shutdown(self.wake)

    def run_next(self, is_over: Callable[[], bool]) -> None:
        """Wait for calls and answer them, unless `is_over` is true."""
        waits = self._waits
        waits.clear_entities()
        for service in self._services:
            waits.add_service(service.handle)
        waits.add_guard_condition(self._wake.handle)
        waits.wait(-1)
        called = waits.get_ready_entities('service')
        for service in self._services:
            if service.handle.pointer in called and not is_over():
                self._answer(service)
        if not self._node.context.ok():
            raise ExternalShutdownException

    def wake(self) -> None:
        """Make ``run_next`` return once."""
        with contextlib.suppress(InvalidHandle):  # this executor was shut down before its context
            self._wake.trigger()

    def shutdown(self) -> None:
        """Release the wait set. Call this only when ``run_next`` no longer runs."""
        self._wake.destroy()
        self._waits.destroy_when_not_in_use()

    def _answer(self, service: Service) -> None:
        try:
            request, header = service.handle.service_take_request(service.srv_type.Request)
        except Exception as error:  # noqa: BLE001 - from another machine
            _dropped(self._log, f'A call of {service.srv_name} could not be read', error)
            return
        if header is None:
            return  # there was no call after all; rclpy's executor has the same check
        answer = service.callback(request, service.srv_type.Response())
        try:
            service.send_response(answer, header)
        except Exception as error:  # noqa: BLE001 - to another machine
            _dropped(self._log, f'The answer of {service.srv_name} could not be sent', error)


def take_waiting(subscription: Subscription, most: int) -> list[Any]:
    """Return up to `most` messages that are waiting behind the callback's own, oldest first."""
    waiting: list[Any] = []
    with subscription.handle:
        while len(waiting) < most:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                break
            waiting.append(taken[0])
    return waiting


def _dropped(log: RcutilsLogger, what: str, error: BaseException) -> None:
    log.error(
        f'{what}, and was dropped: {type(error).__name__}: {error}',
        throttle_duration_sec=UNREADABLE_LOG_AGAIN,
    )
