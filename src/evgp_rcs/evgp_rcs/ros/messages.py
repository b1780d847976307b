# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Conversions between the race and messages.

``evgp_node.codec`` converts field by field. This module contains the exceptions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from evgp_node.codec import message_of, value_of
from evgp_node.stamps import NS, seconds_of, stamp_of
from evgp_protocol.link import Grade
from evgp_rcs.rules.race import AlertKind, Event, StampedEvent
from evgp_rcs.rules.snapshot import KartSnapshot, Snapshot
from evgp_rcs_msgs import msg

ERRORS = (AlertKind.RECORD_FAILING, AlertKind.TWO_RACE_CONTROLS, AlertKind.NOBODY_THERE)
"""Alerts that are errors in the diagnostics, although they do not ask for the MSR."""

# ----- conversions that are not field by field ------------------------------------------------


def events_message(events: Iterable[StampedEvent], run: str) -> msg.RaceEvents:
    """Return events as a message of the run with this id."""
    return msg.RaceEvents(run=run, events=list(map(_event, events)))


def _event(stamped: StampedEvent) -> msg.RaceEvent:
    message: msg.RaceEvent = message_of(stamped.event, msg.RaceEvent)
    monotonic_ns = round(stamped.monotonic * NS)
    message.sequence = stamped.sequence
    message.stamp = stamp_of(stamped.wall_ns)
    message.monotonic = Duration(sec=monotonic_ns // NS, nanosec=monotonic_ns % NS)
    return message


def event_of(message: msg.RaceEvent, said: Callable[[str], str] = str) -> StampedEvent:
    """
    Return the event that a message contains.

    :param said: the conversion of its texts, as for ``value_of``.
    :raises ValueError: if the message is invalid.
    """
    wall_ns = message.stamp.sec * NS + message.stamp.nanosec
    monotonic = seconds_of(message.monotonic)
    return StampedEvent(message.sequence, wall_ns, monotonic, value_of(message, Event, said))


def diagnostics_message(race: Snapshot, wall_ns: int, name: str) -> DiagnosticArray:
    """
    Return race control's diagnostics, with one status for the race and one for each kart.

    :param wall_ns: wall time of the message, in ns since the epoch.
    :param name: name of the node, with its namespace.
    """
    alerts, state = race.alerts, race.state.value if race.state else 'UNKNOWN'
    level, summary = DiagnosticStatus.OK, f'The race is in {state}'
    if alerts:
        level, summary = DiagnosticStatus.WARN, alerts[0].told
    severe = [alert for alert in alerts if alert.use_msr or alert.kind in ERRORS]
    if severe:
        severe.sort(key=lambda alert: not alert.use_msr)
        level, summary = DiagnosticStatus.ERROR, severe[0].told
    array = DiagnosticArray()
    array.header.stamp = stamp_of(wall_ns)
    array.status = [
        DiagnosticStatus(
            level=level,
            name=f'{name}: race',
            message=summary,
            hardware_id='rcs',
            values=[
                KeyValue(key='race state', value=state),
                KeyValue(key='alerts', value=str(len(alerts))),
            ],
        ),
        *(_kart_diagnostic(name, kart) for kart in race.karts),
    ]
    return array


def _kart_diagnostic(name: str, kart: KartSnapshot) -> DiagnosticStatus:
    link = kart.link
    bad = not kart.connected or link.grade is Grade.POOR
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if kart.in_race and bad else DiagnosticStatus.OK,
        name=f'{name}: kart {kart.number}',
        message='connected' if kart.connected else 'not connected',
        hardware_id=kart.address,
        values=[
            KeyValue(key='team', value=kart.team),
            KeyValue(key='sent', value=kart.sent.value),
            KeyValue(key='acknowledged', value=str(kart.acknowledged).lower()),
            KeyValue(key='link', value=link.grade.value),
            KeyValue(key='worst answer (s)', value=_figure(link.worst_answer, 3)),
            KeyValue(key='round trip (s)', value=_figure(link.round_trip, 4)),
            KeyValue(key='retransmitted', value=str(link.retransmitted)),
        ],
    )


def _figure(number: float | None, digits: int) -> str:
    return 'nan' if number is None else f'{number:.{digits}f}'
