# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
An adapter that lets Autoware drive only in GREEN_GREEN (docs/autoware.md).

The adapter requests its stops from Autoware's command gate: a gentle stop in every state but
GREEN_GREEN, and an emergency stop in RED_RED or if Autoware does not grant the gentle one. The
gate also stops the kart if this node's heartbeat ends, or reports that the node is not ready.
"""

from __future__ import annotations

from collections.abc import Callable
import sys
from typing import Any

from autoware_adapi_v1_msgs.msg import ManualOperatorHeartbeat, MotionState, OperationModeState
from evgp_kart_bridge.watch import RaceStateWatch
from evgp_node.parameters import StrictNode
from evgp_node.process import OnFailure, run_node
from evgp_node.qos import latched, volatile
from evgp_node.stamps import stamp
from evgp_protocol import clock
from evgp_protocol.states import RaceState
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.task import Future
from tier4_control_msgs.srv import SetStop
from tier4_external_api_msgs.srv import SetEmergency

HEARTBEAT_INTERVAL = 0.05
"""Time between two heartbeats, in seconds."""

REQUEST_AGAIN = 0.2
"""Time before the adapter repeats a request, in seconds. The gate may have restarted."""

GRANTED_FOR = 1.0
"""Time for which the adapter relies on a granted stop, in seconds. It waits equally long for
Autoware to grant a new one."""

HEARTBEAT_QOS = volatile(1)


class StopRequest:
    """
    A repeated request to Autoware to begin, or to end, one kind of stop.

    :param client: the client of the service.
    :param request: a function that makes the request to begin (True) or end (False) the stop.
    :ivar stop: whether the last request was for a stop.
    :ivar granted: whether Autoware has granted this stop.
    """

    def __init__(self, client: Client, request: Callable[[bool], Any]) -> None:
        self.stop, self.granted = True, False
        self._client, self._request = client, request
        self._asking: Future | None = None
        self._again_at = 0.0
        self._held_at = clock.now()  # when the stop was last granted, or first requested

    def is_refused(self) -> bool:
        """Return whether a stop has been requested, but not granted, for over `GRANTED_FOR`."""
        return self.stop and clock.now() - self._held_at > GRANTED_FOR

    def ask(self, stop: bool) -> None:
        """Request that the stop begin (True) or end, repeating it only after `REQUEST_AGAIN`."""
        now = clock.now()
        if stop is self.stop and now < self._again_at:
            return
        if stop is not self.stop:
            self.stop, self.granted, self._held_at = stop, False, now
        self._again_at = now + REQUEST_AGAIN
        if self._asking is not None:
            self._client.remove_pending_request(self._asking)  # the gate may have died
        self._asking = self._client.call_async(self._request(stop))
        self._asking.add_done_callback(lambda answered: self._hear(stop, answered))

    def _hear(self, stop: bool, answered: Future) -> None:
        status = getattr(answered.result(), 'status', None)
        success = getattr(status, 'success', False)  # the status of SetEmergency has no such field
        self.granted = stop and self.stop and success
        if self.granted:
            self._held_at = clock.now()


class AutowareAdapter(StrictNode):
    """The node that requests stops from Autoware and acknowledges to race control."""

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        super().__init__('autoware_adapter', **node_options)
        self.refuse_unknown()
        self._mode, self._motion = OperationModeState(), MotionState()
        self._watch = RaceStateWatch(self)
        self._heartbeat = self.create_publisher(
            ManualOperatorHeartbeat, '~/heartbeat', HEARTBEAT_QOS
        )
        self._gentle = StopRequest(
            self.create_client(SetStop, '/control/vehicle_cmd_gate/set_stop'),
            lambda stop: SetStop.Request(stop=stop, request_source='evgp'),
        )
        self._emergency = StopRequest(
            self.create_client(SetEmergency, '/api/autoware/set/emergency'),
            lambda stop: SetEmergency.Request(emergency=stop),
        )
        self.create_subscription(
            OperationModeState, '/api/operation_mode/state', self._hear_mode, latched(1)
        )
        self.create_subscription(MotionState, '/api/motion/state', self._hear_motion, latched(1))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(HEARTBEAT_INTERVAL, self._step, clock=steady)

    def close(self) -> None:
        """Request the emergency stop, which the end of the heartbeat causes as well."""
        self._request(RaceState.RED_RED)

    def _step(self) -> None:
        order = self._watch.order
        self._request(order.state)
        if self._has_reached(order.state):
            self._watch.acknowledge(order)

    def _request(self, state: RaceState) -> None:
        drive = state is RaceState.GREEN_GREEN
        # An emergency stop lasts until the gentle one is granted, and begins when the gentle one
        # is no longer certain, for example after the gate restarted.
        unsure = (self._emergency.stop and not self._gentle.granted) or self._gentle.is_refused()
        emergency = state is RaceState.RED_RED or (unsure and not drive)
        self._heartbeat.publish(
            ManualOperatorHeartbeat(stamp=stamp(self.get_clock()), ready=not emergency)
        )
        self._gentle.ask(not drive)
        self._emergency.ask(emergency)

    def _has_reached(self, state: RaceState) -> bool:
        """Return whether the kart is ready or driving. The bridge itself detects a standstill."""
        if state is RaceState.GRID_ACTIVE:
            # The mode is latched, so Autoware may have died since. A granted stop shows that
            # Autoware is alive.
            autonomous = self._mode.mode == OperationModeState.AUTONOMOUS
            controlled = autonomous and self._mode.is_autoware_control_enabled
            return bool(controlled and self._gentle.granted and not self._gentle.is_refused())
        return bool(state is RaceState.GREEN_GREEN and self._motion.state == MotionState.MOVING)

    def _hear_mode(self, mode: OperationModeState) -> None:
        self._mode = mode

    def _hear_motion(self, motion: MotionState) -> None:
        self._motion = motion


def main(args: list[str] | None = None) -> int:
    """Run the adapter until SIGINT or SIGTERM."""
    return run_node('autoware_adapter', AutowareAdapter, args)


if __name__ == '__main__':
    sys.exit(main())
