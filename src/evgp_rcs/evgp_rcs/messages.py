# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The race in ROS messages: what the rules say, in the words of ``evgp_rcs_msgs``.

Nothing is decided here. A snapshot goes in, a message comes out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import enum
import math
from typing import Any

from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from evgp_node.stamps import stamp_of
from evgp_node.states import state_message
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CommandKind
from evgp_rcs.laps import BY_HAND, Judged, KartResult, Mark, Passing, Penalty, Status
from evgp_rcs.link_quality import NOT_MEASURED
from evgp_rcs.official import tidy
from evgp_rcs.race import AlertKind, EventKind, StampedEvent
from evgp_rcs.snapshot import KartSnapshot, Offer, Snapshot, Standings
from evgp_rcs_msgs import msg

NS = 1_000_000_000

MOST_STRENGTH = 1e9
"""The strength of a passing is below this, in the device's own measure."""

ERRORS = (AlertKind.RECORD_FAILING, AlertKind.TWO_RACE_CONTROLS, AlertKind.NOBODY_THERE)
"""Alerts without the MSR that are errors in the diagnostics."""


def _constants(kinds: Iterable[enum.Enum], message: Any) -> dict[enum.Enum, int]:
    return {kind: int(getattr(message, kind.name)) for kind in kinds}


_COMMAND = _constants(CommandKind, msg.CommandAvailability)
_EVENT = _constants(EventKind, msg.RaceEvent)
_ALERT = _constants(AlertKind, msg.Alert)
_GRADE = _constants(Grade, msg.LinkQuality)
_MARK = _constants(Mark, msg.JudgedPassing)
_STATUS = _constants(Status, msg.KartResult)
_STATE = {state: state_message(state) for state in (None, *RaceState)}


def _known(value: float | None) -> float:
    return math.nan if value is None else value


def failure_alert(text: str, since_ns: int) -> msg.Alert:
    """Return the alert that a part of race control failed, at a wall time (ns since the epoch)."""
    return msg.Alert(kind=msg.Alert.PART_FAILED, use_msr=True, text=text, since=stamp_of(since_ns))


def graph_alert(text: str, since_ns: int) -> msg.Alert:
    """Return the alert that consoles may not reach race control, likewise."""
    return msg.Alert(kind=msg.Alert.GRAPH_TROUBLE, text=text, since=stamp_of(since_ns))


def race_message(
    race: Snapshot, wall_ns: int, addresses: Mapping[int, str], banner: str = ''
) -> msg.Race:
    """
    Return the whole race as one message.

    :param wall_ns: the wall time of the snapshot (ns since the epoch).
    :param addresses: the address of each kart of the roster.
    :param banner: what every screen says at its top.
    """

    def wall(monotonic: float | None) -> Time:
        if monotonic is None:
            return Time()
        return stamp_of(wall_ns + round((monotonic - race.at) * NS))

    def availability(offer: Offer) -> msg.CommandAvailability:
        kind, _, reason, statement, karts, available_from = offer
        return msg.CommandAvailability(
            command=_COMMAND[kind],
            available=not reason,
            reason=reason,
            statement=statement,
            karts=karts,
            available_from=wall(available_from),
        )

    def quality(kart: KartSnapshot) -> msg.LinkQuality:
        link = kart.link or NOT_MEASURED
        return msg.LinkQuality(
            grade=_GRADE[link.grade],
            poor_lately=kart.poor_lately,
            worst_answer=_known(link.worst_answer),
            round_trip=_known(link.round_trip),
            round_trip_variation=_known(link.variation),
            retransmitted=link.retransmitted,
            retransmitted_last_second=link.retransmitted_lately,
            unanswered_bytes=link.unanswered,
            answered_ago=_known(link.answered_ago),
            worst_gap=_known(link.worst_gap),
            behind=link.behind,
            delivered_after=_known(kart.delivered_at) - kart.ordered_at,
            acknowledged_after=_known(kart.acknowledged_at) - kart.ordered_at,
        )

    def status(kart: KartSnapshot) -> msg.KartStatus:
        return msg.KartStatus(
            number=kart.number,
            team=kart.team,
            address=addresses.get(kart.number, ''),
            in_race=kart.in_race,
            connected=kart.connected,
            link=quality(kart),
            sent=_STATE[kart.sent],
            sent_since=wall(kart.sent_since),
            acknowledged=kart.acknowledged,
            reported=_STATE[kart.reported],
            counts_at=wall(kart.counts_at),
            hold=_STATE[kart.hold],
            hold_reason=kart.hold_reason,
            may_be_moving=kart.may_be_moving,
            settles_at=wall(kart.settles_at),
            place=kart.place,
            flag_at=wall(kart.finish_due),
            inspected=kart.inspected,
            laps=kart.laps,
            last_lap=_known(kart.last_lap),
            best_lap=_known(kart.best_lap),
            last_lap_done=kart.last_lap_done,
            commands=[availability(each) for each in kart.commands],
        )

    return msg.Race(
        stamp=stamp_of(wall_ns),
        state=state_message(race.state),
        state_since=wall(race.state_since),
        state_cause=race.state_cause,
        over=race.over,
        karts=[status(kart) for kart in race.karts],
        commands=[availability(each) for each in race.commands],
        track=msg.TrackAccess(
            open=race.track.is_open,
            allowed=race.track.allowed,
            reason=race.track.reason,
            msr_used=race.track.msr_used,
        ),
        alerts=[
            msg.Alert(
                kind=_ALERT[alert.kind],
                kart=alert.kart,
                use_msr=alert.use_msr,
                text=alert.text,
                since=wall(alert.since),
            )
            for alert in race.alerts
        ],
        race_since=wall(race.race_since),
        laps=race.laps,
        heats=[
            msg.Heat(
                name=heat.name,
                karts=heat.karts,
                format=heat.format.value,
                laps=heat.laps,
                grid_from=heat.grid_from,
                grid=grid,
            )
            for heat, grid in zip(race.heats, race.starts.grids, strict=True)
        ],
        heat=race.starts.heat,
        next_heat=race.starts.next_heat,
        banner=banner,
        able_to_stop=race.there.able,
        who_can_stop=race.there.who,
        button_fault=race.there.button_fault,
    )


def passing_of(message: msg.Passing) -> Passing:
    """
    Return a passing of a message, whatever is in it.

    What a message can say and the record cannot keep is what says nothing: a strength that is no
    number or beyond measure, a time before 1970. Names are one line that can be printed. Nobody
    but officials is called as they are.
    """
    return Passing(
        '' if (source := tidy(message.source)) == BY_HAND else source,
        tidy(message.session),
        message.number,
        message.kart,
        tidy(message.transponder),
        max(0, message.stamp.sec * NS + message.stamp.nanosec),
        message.clock,
        message.hits,
        message.strength if abs(message.strength) < MOST_STRENGTH else None,
    )


def _passing_message(passing: Passing) -> msg.Passing:
    return msg.Passing(
        source=passing.source,
        session=passing.session,
        number=passing.number,
        kart=passing.kart,
        transponder=passing.transponder,
        stamp=stamp_of(passing.stamp_ns),
        clock=passing.clock,
        hits=passing.hits,
        strength=_known(passing.strength),
    )


def results_message(standings: Standings, wall_ns: int, teams: Mapping[int, str]) -> msg.Results:
    """
    Return the results as a message.

    :param wall_ns: the wall time of them (ns since the epoch).
    :param teams: the team of each kart of the roster.
    """

    def penalty(each: Penalty) -> msg.Penalty:
        return msg.Penalty(
            seconds=each.seconds,
            laps=each.laps,
            disqualified=each.disqualified,
            reason=each.reason,
            official=each.official,
        )

    def result(each: KartResult) -> msg.KartResult:
        return msg.KartResult(
            kart=each.kart,
            team=teams.get(each.kart, ''),
            place=each.place,
            status=_STATUS[each.status],
            laps=each.laps,
            total=_known(each.total),
            best=_known(each.best),
            last=_known(each.lap_times[-1] if each.lap_times else None),
            lap_times=each.lap_times,
            penalties=[penalty(one) for one in each.penalties],
        )

    def judged(each: Judged) -> msg.JudgedPassing:
        return msg.JudgedPassing(
            passing=_passing_message(each.passing),
            kart=each.kart,
            mark=_MARK[each.mark],
            at=each.at,
            struck=each.struck,
        )

    return msg.Results(
        stamp=stamp_of(wall_ns),
        heat=standings.heat,
        format=standings.format.value,
        laps=standings.wanted,
        grid=standings.grid,
        karts=[result(each) for each in standings.results],
        overall=[result(each) for each in standings.overall],
        passings=[judged(each) for each in standings.passings],
        older=standings.older,
    )


def events_message(events: Iterable[StampedEvent]) -> msg.RaceEvents:
    """Return events as a message."""
    return msg.RaceEvents(events=list(map(_event, events)))


def _event(stamped: StampedEvent) -> msg.RaceEvent:
    event = stamped.event
    monotonic_ns = round(stamped.monotonic * NS)
    return msg.RaceEvent(
        sequence=stamped.sequence,
        stamp=stamp_of(stamped.wall_ns),
        monotonic=Duration(sec=monotonic_ns // NS, nanosec=monotonic_ns % NS),
        kind=_EVENT[event.kind],
        kart=event.kart,
        command=_COMMAND[event.command] if event.command is not None else 0,
        success=event.success,
        state=_STATE[event.state],
        text=event.text,
        official=event.official,
        alert=_ALERT[event.alert] if event.alert is not None else 0,
        after=event.after,
        lap=event.lap,
        grade=_GRADE[event.grade] if event.grade is not None else 0,
    )


def diagnostics_message(
    race: Snapshot, wall_ns: int, name: str, addresses: Mapping[int, str]
) -> DiagnosticArray:
    """
    Return race control's diagnostics: the race, and each kart.

    :param wall_ns: the wall time of the message (ns since the epoch).
    :param name: the node's, with its namespace.
    :param addresses: the address of each kart of the roster.
    """
    alerts = race.alerts
    level, summary = DiagnosticStatus.OK, f'The race is in {race.state.value}'
    if alerts:
        level, summary = DiagnosticStatus.WARN, alerts[0].text
    severe = [alert for alert in alerts if alert.use_msr or alert.kind in ERRORS]
    if severe:
        severe.sort(key=lambda alert: not alert.use_msr)
        level, summary = DiagnosticStatus.ERROR, severe[0].text
    array = DiagnosticArray()
    array.header.stamp = stamp_of(wall_ns)
    array.status = [
        DiagnosticStatus(
            level=level,
            name=f'{name}: race',
            message=summary,
            hardware_id='rcs',
            values=[
                KeyValue(key='race state', value=race.state.value),
                KeyValue(key='alerts', value=str(len(alerts))),
            ],
        ),
        *(_kart_diagnostic(name, kart, addresses.get(kart.number, '')) for kart in race.karts),
    ]
    return array


def _kart_diagnostic(name: str, kart: KartSnapshot, address: str) -> DiagnosticStatus:
    link = kart.link or NOT_MEASURED
    bad = not kart.connected or link.grade is Grade.POOR
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if kart.in_race and bad else DiagnosticStatus.OK,
        name=f'{name}: kart {kart.number}',
        message='connected' if kart.connected else 'not connected',
        hardware_id=address,
        values=[
            KeyValue(key='team', value=kart.team),
            KeyValue(key='sent', value=kart.sent.value),
            KeyValue(key='acknowledged', value=str(kart.acknowledged).lower()),
            KeyValue(key='link', value=link.grade.value),
            KeyValue(key='worst answer (s)', value=f'{link.worst_answer:.3f}'),
            KeyValue(key='round trip (s)', value=f'{_known(link.round_trip):.4f}'),
            KeyValue(key='retransmitted', value=str(link.retransmitted)),
        ],
    )
