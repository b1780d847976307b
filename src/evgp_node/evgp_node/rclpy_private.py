# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The only module of ours that uses private parts of rclpy.

It exports two errors that have no public name, and does what the public executors cannot: drop
calls and messages that cannot be read, and take everything that is waiting in a subscription.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.executors import (
    ConditionReachedException,
    ShutdownException,
    SingleThreadedExecutor,
)
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.service import Service
from rclpy.subscription import Subscription

__all__ = ['Executor', 'RCLError', 'UnknownROSArgsError', 'take_waiting']

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
