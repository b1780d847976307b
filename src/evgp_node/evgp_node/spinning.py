# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A thread that runs the callbacks of a node, and ends by itself."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import threading
import traceback
from typing import Any

from rcl_interfaces.msg import SetParametersResult
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

UNREADABLE_LOG_AGAIN = 1.0
"""Minimum time between two log lines about calls that cannot be read, seconds."""


class Spinning:
    """
    Runs the callbacks of a node in a thread of its own.

    Nothing that comes in from the graph ends it: a request, message or answer that cannot be read
    is dropped, and a call whose callback raises is refused; both are logged. What raises in any
    other callback is a failure of this process.

    :param node: with all its services; it is spun from now on.
    :param on_failure: is called, in the thread, when it cannot go on.
    :param only_serves: the node has services and nothing else; a call is taken sooner then.
    """

    def __init__(
        self,
        node: Node,
        on_failure: Callable[[BaseException], None],
        only_serves: bool = False,
    ) -> None:
        """Begin to run them."""
        self._on_failure = on_failure
        self._ending = threading.Event()
        for service in node.services:
            service.callback = _refusing(node, service)
        self._executor = _Server(node) if only_serves else _Executor(node)
        self._thread = threading.Thread(target=self._run, name='executor', daemon=True)
        self._thread.start()

    def stop(self, timeout: float | None = None) -> bool:
        """
        Have the thread end once the callback that runs has returned.

        The node and its context can be taken down then. `rclpy` would also let an executor be
        shut down while it spins, but takes the ground from under its feet.

        :param timeout: maximum time until then, seconds; None: as long as it takes.
        :return: whether it has ended.
        """
        self._ending.set()
        self._executor.wake()
        self._thread.join(timeout)
        if self._thread.is_alive():
            return False
        self._executor.shutdown()
        return True

    def _run(self) -> None:
        try:
            while not self._ending.is_set():
                self._executor.run_next(self._ending.is_set)
        except ExternalShutdownException as error:
            if not self._ending.is_set():
                self._on_failure(error)
        except BaseException as error:  # noqa: BLE001 - handed on
            self._on_failure(error)


class _Executor(SingleThreadedExecutor):
    """
    An executor for a graph in which anyone may send anything.

    What cannot be read raises in rclpy where it is taken, which would also leave the node's
    callbacks locked for good. Here there is then nothing to do.
    """

    def __init__(self, node: Node) -> None:
        super().__init__(context=node.context)
        self._log = node.get_logger()
        self.add_node(node)

    def run_next(self, is_over: Callable[[], bool]) -> None:
        """Wait for a callback and run it; return early once it `is_over`."""
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
        # The callback itself refuses: what remains is an answer that could not be sent.
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
        except Exception as error:  # noqa: BLE001 - from afar: see above
            _dropped(self._log, f'{what} could not be read', error)
            return None


class _Server:
    """
    Answers the calls of a node that only serves, with one wait set for all its life.

    If the node calls others too, nobody takes their answers.

    rclpy's executor makes a new one, a task and two coroutines for each callback, which is
    0.2 ms of a stop (docs/decisions.md, record 6).
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._log = node.get_logger()
        self._services = tuple(node.services)
        self._wake = GuardCondition(None, None, node.context)
        # Its waitables are those of /parameter_events, which every node publishes.
        others = (*node.subscriptions, *node.timers, *node.guards)
        assert not others, f'{node.get_name()} has more than services'
        self._waits = rclpy_implementation.WaitSet(
            0, 1, 0, 0, len(self._services), 0, node.context.handle
        )
        node.context.on_shutdown(self.wake)

    def run_next(self, is_over: Callable[[], bool]) -> None:
        """Wait for calls and answer them; see ``_Executor``."""
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
        """Make ``run_next`` return, once."""
        with contextlib.suppress(InvalidHandle):  # it was shut down before its context was
            self._wake.trigger()

    def shutdown(self) -> None:
        """Let go of what it waits by; nobody runs ``run_next`` any more."""
        self._wake.destroy()
        self._waits.destroy_when_not_in_use()

    def _answer(self, service: Service) -> None:
        try:
            request, header = service.handle.service_take_request(service.srv_type.Request)
        except Exception as error:  # noqa: BLE001 - from afar
            _dropped(self._log, f'A call of {service.srv_name} could not be read', error)
            return
        if header is None:
            return  # no call after all; rclpy's executor checks for this too
        answer = service.callback(request, service.srv_type.Response())
        try:
            service.send_response(answer, header)
        except Exception as error:  # noqa: BLE001 - to afar
            _dropped(self._log, f'The answer of {service.srv_name} could not be sent', error)


def _dropped(log: RcutilsLogger, what: str, error: BaseException) -> None:
    log.error(
        f'{what}, and was dropped: {type(error).__name__}: {error}',
        throttle_duration_sec=UNREADABLE_LOG_AGAIN,
    )


def _refusing(node: Node, service: Service) -> Callable[[Any, Any], Any]:
    """Return a service's callback; if it raises, the call is refused, and the traceback logged."""
    callback, name, log = service.callback, service.srv_name, node.get_logger()

    def serve(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:  # noqa: BLE001 - a call from afar must not end this process
            log.error(
                f'A call of {name} was refused because it failed here:\n{traceback.format_exc()}',
                throttle_duration_sec=UNREADABLE_LOG_AGAIN,
            )
            return _refusal(request, type(response)(), f'{type(error).__name__}: {error}')

    return serve


def _refusal(request: Any, response: Any, reason: str) -> Any:
    """Return a response that says no, where it has a word for that."""
    fields = response.get_fields_and_field_types()
    if {'success', 'message'} <= fields.keys():
        response.success = False
        response.message = f'It failed in here ({reason}). If it was a stop, USE THE MSR.'
    refused = SetParametersResult(successful=False, reason=reason)
    if 'results' in fields:
        response.results = [refused for _ in request.parameters]
    elif isinstance(getattr(response, 'result', None), SetParametersResult):
        response.result = refused
    return response
