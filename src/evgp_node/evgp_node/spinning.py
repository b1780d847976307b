# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A thread that runs a node's callbacks and that can be ended."""

from __future__ import annotations

from collections.abc import Callable
import threading
import traceback
from typing import Any

from evgp_node.rclpy_private import Executor, UNREADABLE_LOG_AGAIN
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.service import Service


class Spinning:
    """
    A thread that runs the callbacks of a node.

    Input from the graph cannot end the thread. It drops requests, messages and answers that it
    cannot read, refuses a call whose callback raises an exception, and logs both. An exception in
    any other callback is a failure of this process.

    :param node: the node, which must already have all its services.
    :param on_failure: called with the error, in the thread, when the thread cannot go on.
    """

    def __init__(self, node: Node, on_failure: Callable[[BaseException], None]) -> None:
        self._on_failure = on_failure
        self._ending = threading.Event()
        for service in node.services:
            service.callback = _refusing(node, service)
        self._executor = Executor(node)
        self._thread = threading.Thread(target=self._run, name='executor', daemon=True)
        self._thread.start()

    def stop(self, timeout: float | None = None) -> bool:
        """
        End the thread once the current callback has returned.

        After that, the caller may destroy the node and its context. `rclpy` alone would destroy
        what a running executor is still using.

        :param timeout: maximum time to wait, in seconds; None for no limit.
        :return: whether the thread has ended.
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
        except BaseException as error:  # noqa: BLE001 - passed on
            self._on_failure(error)


def _refusing(node: Node, service: Service) -> Callable[[Any, Any], Any]:
    """Return a service's callback that, if it raises, logs a traceback and refuses the call."""
    callback, name, log = service.callback, service.srv_name, node.get_logger()

    def serve(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:  # noqa: BLE001 - another machine's call must not end this
            log.error(
                f'A call of {name} failed here and was refused:\n{traceback.format_exc()}',
                throttle_duration_sec=UNREADABLE_LOG_AGAIN,
            )
            return _refusal(request, type(response)(), f'{type(error).__name__}: {error}')

    return serve


def _refusal(request: Any, response: Any, reason: str) -> Any:
    """Return a response that refuses a request, as far as the type of the response allows."""
    fields = response.get_fields_and_field_types()
    if {'success', 'message'} <= fields.keys():
        response.success = False
        response.message = f'The command failed ({reason}). If it was a stop, USE THE MSR.'
    refused = SetParametersResult(successful=False, reason=reason)
    if 'results' in fields:
        response.results = [refused for _ in request.parameters]
    elif isinstance(getattr(response, 'result', None), SetParametersResult):
        response.result = refused
    return response
