# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Race control's messages as the plain data of ``snapshot``, and back."""

from __future__ import annotations

from collections.abc import Iterable
import time
from typing import Any

from evgp_rcs.catalogue import CommandKind
from evgp_rcs_console.snapshot import (
    Alert,
    Availability,
    Available,
    Event,
    Heat,
    Kart,
    Race,
    State,
    Track,
)
from evgp_rcs_msgs import msg

_STATES = {int(getattr(msg.RaceState, state.name)): state for state in State}
_COMMANDS = {int(getattr(msg.CommandAvailability, each.name)): each for each in CommandKind}
_ALERTS = {
    value: name
    for name in dir(msg.Alert)
    if name.isupper() and isinstance(value := getattr(msg.Alert, name), int)
}


def read_race(race: msg.Race) -> Race:
    """Return the race of a message."""
    stamp = _seconds(race.stamp)
    return Race(
        state=_state(race.state),
        state_for=stamp - _seconds(race.state_since),
        over=race.over,
        karts=tuple(_kart(kart, stamp) for kart in race.karts),
        commands=_availability(race.commands, stamp),
        track=Track(
            is_open=race.track.open,
            allowed=race.track.allowed,
            reason=race.track.reason,
            msr_used=race.track.msr_used,
        ),
        alerts=tuple(
            Alert(
                kind=_ALERTS.get(alert.kind, 'UNKNOWN'),
                kart=alert.kart,
                use_msr=alert.use_msr,
                text=alert.text,
            )
            for alert in race.alerts
        ),
        heats=tuple(Heat(heat.name, tuple(heat.karts)) for heat in race.heats),
        banner=race.banner,
        state_cause=race.state_cause,
        state_clock=_clock(race.state_since),
    )


def read_event(event: msg.RaceEvent) -> Event:
    """Return the event of a message."""
    return Event(
        sequence=event.sequence,
        clock=_clock(event.stamp),
        kart=event.kart,
        success=event.success,
        text=event.text,
        official=event.official,
    )


def state_message(state: State) -> msg.RaceState:
    """Return a state as a message."""
    return msg.RaceState(state=getattr(msg.RaceState, state.name))


def _kart(kart: msg.KartStatus, stamp: float) -> Kart:
    return Kart(
        number=kart.number,
        team=kart.team,
        in_race=kart.in_race,
        connected=kart.connected,
        sent=_state(kart.sent),
        sent_for=stamp - _seconds(kart.sent_since),
        acknowledged=kart.acknowledged,
        reported=_state(kart.reported),
        hold=_state(kart.hold),
        hold_reason=kart.hold_reason,
        may_be_moving=kart.may_be_moving,
        place=kart.place,
        inspected=kart.inspected,
        settles_in=max(0.0, _seconds(kart.settles_at) - stamp),
        commands=_availability(kart.commands, stamp),
    )


def _availability(commands: Iterable[msg.CommandAvailability], stamp: float) -> Availability:
    return {
        _COMMANDS[each.command]: Available(
            each.available,
            each.reason,
            each.statement,
            tuple(each.karts),
            max(0.0, _seconds(each.available_from) - stamp),
        )
        for each in commands
        if each.command in _COMMANDS
    }


def _state(message: msg.RaceState) -> State:
    return _STATES.get(message.state, State.UNKNOWN)


def _clock(stamp: Any) -> str:
    return time.strftime('%H:%M:%S', time.localtime(stamp.sec))


def _seconds(message: Any) -> float:
    return float(message.sec) + float(message.nanosec) / 1e9
