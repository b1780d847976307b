# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ``timing_source`` node publishes the passings that one timing device reports.

One thread owns the device: it connects, reads, decodes and publishes. The executor's thread only
reports the device's condition, once a second.
"""

from __future__ import annotations

import contextlib
import dataclasses
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from evgp_node.codec import message_of
from evgp_node.parameters import ParameterError, StrictNode
from evgp_node.process import OnFailure, run_node, wait_until_heard
from evgp_node.qos import DIAGNOSTICS_QOS, latched
from evgp_node.results import BY_HAND
from evgp_node.stamps import stamp
from evgp_protocol import clock
from evgp_rcs_msgs import msg
from evgp_timing.account import Account
from evgp_timing.contact import Contact, STUCK
from evgp_timing.device import connect, Device, read, split
from evgp_timing.kinds import CONTACT, DECODERS
from evgp_timing.passings import Event, of_device
from rclpy.clock import Clock, ClockType

PASSINGS_QOS = latched(200)
"""QoS of ``passings``, which gives late subscribers the last passings too. Each passing has a
number, so one that arrives twice counts once."""

DEVICE_LOOK = 0.2
"""Maximum time until the device's thread notices the end of the node, in seconds."""

CONTACT_LOOK = 0.001
"""Time between two readings of a contact, in seconds."""

RECONNECT_DELAYS = (0.5, 1.0, 2.0, 5.0)
"""Times before each further attempt to connect, in seconds. The last one repeats."""


@dataclasses.dataclass(frozen=True)
class TimingSettings:
    """The values of the parameters, which `read_settings` explains."""

    kind: str
    device: str
    source: str = 'line'
    baud: int = 9600
    silent_after: float = 10.0
    inverted: bool = False
    debounce: float = 0.2
    gates: str = ''


class TimingSource(StrictNode):
    """
    The node of one timing device.

    :param on_failure: called with the error, in another thread, if the node cannot go on.
    :param node_options: further arguments for rclpy's node.
    :raises ParameterError: if a parameter is wrong.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        """Read the parameters and start connecting to the device."""
        super().__init__('timing_source', **{'namespace': 'rcs', **node_options})
        self._settings = read_settings(self)
        self._passings = self.create_publisher(msg.Passing, 'passings', PASSINGS_QOS)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', DIAGNOSTICS_QOS)
        gates = frozenset(each.strip() for each in self._settings.gates.split(','))
        self._account = Account(clock.now(), gates - {''})
        self._gone = 'The device is not connected yet'  # empty if it is connected
        self._stuck = False
        self._connections = 0
        self._told = ''
        self._ending = threading.Event()
        self._on_failure = on_failure
        self.get_logger().info(
            f'{self._settings.source}: {self._settings.kind} at {self._settings.device}, '
            f'to {self._passings.topic_name}'
        )
        self.create_timer(1.0, self._tell, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._thread = threading.Thread(target=self._run, name='device', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Release the device and wait for subscribers to receive every passing."""
        self._ending.set()
        self._thread.join()
        wait_until_heard(self._passings)

    # ----- in the thread of the device ----------------------------------------------------

    def _run(self) -> None:
        try:
            attempts = 0
            while not self._ending.is_set():
                heard = self._account.heard_at
                try:
                    with contextlib.closing(
                        connect(self._settings.device, self._settings.baud)
                    ) as device:
                        self._gone = ''
                        self._connections += 1
                        self._follow(device)
                except OSError as error:
                    self._gone = f'The device is not connected: {error}'
                attempts = 0 if self._account.heard_at != heard else attempts + 1
                self._ending.wait(RECONNECT_DELAYS[min(attempts, len(RECONNECT_DELAYS) - 1)])
        except BaseException as error:  # noqa: BLE001 - passed on
            self._on_failure(error)

    def _follow(self, device: Device) -> None:
        """Publish the device's passings until this node ends or the device is gone."""
        if self._settings.kind == CONTACT:
            self._follow_contact(device)
            return
        decoder, since = DECODERS[self._settings.kind](), clock.now()
        at_tcp = split(self._settings.device) is not None
        while not self._ending.is_set():
            data = read(device, DEVICE_LOOK)
            now = clock.now()
            for event in decoder.feed(data):
                self._take(event, now)
            # A device that was unplugged does not close its connection.
            if at_tcp and self._is_silent(now, since):
                return

    def _follow_contact(self, device: Any) -> None:
        contact = Contact(self._settings.debounce)
        while not self._ending.is_set():
            is_active, now = bool(device.cts), clock.now()
            broken = is_active is not self._settings.inverted
            if contact.look(broken, now):
                self._take(of_device(time.time_ns() // 1000), now)
            self._stuck = contact.is_stuck(now)
            time.sleep(CONTACT_LOOK)

    def _take(self, event: Event, now: float) -> None:
        passing = self._account.take(event, now)
        if passing is not None:
            passing = passing._replace(source=self._settings.source)
            self._passings.publish(message_of(passing, msg.Passing))

    # ----- in the executor's thread -------------------------------------------------------

    def _tell(self) -> None:
        now, level = clock.now(), DiagnosticStatus.ERROR
        trouble = self._account.trouble(now)
        if self._gone:
            said = self._gone
        elif self._is_silent(now):
            after = self._settings.silent_after
            said = f'The device has been silent for {after:g} s. Check plug, power and settings'
        elif self._stuck:
            said = f'The beam has been broken for {STUCK:g} s. Clear it, or set inverted'
        elif trouble is not None:
            level, said = DiagnosticStatus.WARN, trouble.value
        else:
            level, said = DiagnosticStatus.OK, 'The device is connected'
        if said != self._told:
            self._told = said
            if level == DiagnosticStatus.OK:
                self.get_logger().info(f'{self._settings.source}: {said}')
            else:
                self.get_logger().warning(f'{self._settings.source}: {said}')
        values = {
            'kind': self._settings.kind,
            'session': self._account.session,
            'passings': self._account.taken,
            'connections': self._connections,
            **{each.name.lower(): count for each, count in self._account.counts.items()},
            'last refusal': self._account.last_refusal,
        }
        status = DiagnosticStatus(
            level=level,
            name=f'timing: {self._settings.source}',
            message=said,
            hardware_id=self._settings.device,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = stamp(self.get_clock())
        self._diagnostics.publish(array)

    def _is_silent(self, now: float, since: float = 0.0) -> bool:
        """Return whether the device has been silent for too long, not counting before `since`."""
        after = self._settings.silent_after
        if self._settings.kind == CONTACT or not after:
            return False
        return now - max(self._account.heard_at, since) >= after


def read_settings(node: StrictNode) -> TimingSettings:
    """
    Declare every parameter of the node, and return the values.

    :raises ParameterError: if a parameter is wrong.
    """
    declare, default = node.declare, TimingSettings
    kinds = (CONTACT, *DECODERS)
    settings = TimingSettings(
        kind=declare('kind', '', f'Kind of device: {", ".join(kinds)}.'),
        device=declare('device', '', "Path of the device's serial port, or its host:port."),
        source=declare('source', default.source, 'Name of the source, which must not change.'),
        baud=declare('baud', default.baud, 'Baud rate of a serial port.', (300, 3_000_000)),
        silent_after=declare(
            'silent_after',
            default.silent_after,
            'Time without data after which a device counts as silent, in seconds. 0: never.',
            (0.0, 3600.0),
        ),
        inverted=declare('inverted', default.inverted, 'Active while no kart crosses the line.'),
        debounce=declare(
            'debounce',
            default.debounce,
            'Minimum time for which the contact must be free before a crossing, in seconds.',
            (0.01, 10.0),
        ),
        gates=declare(
            'gates',
            default.gates,
            'Numbers or labels of transponders that belong to gates and not to karts: 9992, 9995.',
        ),
    )
    node.refuse_unknown()
    if settings.kind not in kinds:
        raise ParameterError(
            f'parameter kind: {settings.kind!r} is not valid. Set {" or ".join(kinds)}'
        )
    if settings.source in ('', BY_HAND):
        raise ParameterError(
            f'parameter source: {settings.source!r} is not valid. Set another name, such as line'
        )
    try:
        at = split(settings.device)
    except ValueError as error:
        raise ParameterError(
            f'parameter device: {error}. Examples: /dev/ttyUSB0, 10.1.0.20:5403'
        ) from error
    if settings.kind == CONTACT and at is not None:
        raise ParameterError(
            'parameter device: a contact needs a serial port such as /dev/ttyUSB0'
        )
    return settings


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM and return the exit code of `run_node`."""
    return run_node('timing_source', TimingSource, args)


if __name__ == '__main__':
    sys.exit(main())
