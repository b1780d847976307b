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

"""
An official's command: what it asks of race control, what it does, and what became of it.

The catalogue says what each command is called and whether it is a stop; race control says whether
it is allowed. Pure: snapshots and times go in.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from evgp_protocol.clock import now
from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CATALOGUE, CommandKind, Result
from evgp_rcs_console.snapshot import Available, Kart, Race, State


@dataclass(frozen=True)
class Order:
    """
    A command that an official gave, with what the official saw.

    :param kart: the kart it is for; 0 for a command to the race, to all, or to the track.
    :param stated: the official made the statement that race control asked for.
    :param karts: for a command that starts or releases karts: the karts that the official saw.
    :param hold: for the release of one kart: the hold that the official saw.
    :param heat: for putting a heat into the race: its name.
    :param official: who gave it, as sent to race control.
    :param at: when it was given, by the clock that counts a suspend, in seconds.
    """

    command: CommandKind
    kart: int = 0
    stated: bool = False
    karts: tuple[int, ...] = ()
    hold: State = State.UNKNOWN
    heat: str = ''
    official: str = ''
    at: float = field(default_factory=now)


def asks(command: CommandKind) -> bool:
    """Return whether the official confirms it: it loosens, or giving it is a statement."""
    entry = CATALOGUE[command]
    return entry.loosens or entry.call_is_statement


def request(order: Order) -> dict[str, int | bool | str | list[int] | State]:
    """Return the fields of the request of a command."""
    entry = CATALOGUE[order.command]
    fields: dict[str, int | bool | str | list[int] | State] = {
        'official': order.official,
        **entry.fixed,
    }
    if entry.to_one_kart:
        fields['kart'] = order.kart
    if entry.statement:
        fields[entry.statement] = order.stated
    if entry.names_karts:
        fields['karts'] = list(order.karts)
    if entry.names_hold:
        fields['hold'] = order.hold
    if entry.names_heat:
        fields['heat'] = order.heat
    return fields


SENDS = {
    CommandKind.GRID_ACTIVE: State.GRID_ACTIVE,
    CommandKind.GREEN_GREEN: State.GREEN_GREEN,
    CommandKind.IN_GARAGE: State.IN_GARAGE,
    CommandKind.RECORD_MSR: State.RED_RED,
    CommandKind.KART_IN_GARAGE: State.IN_GARAGE,
}
"""The state that each command sends that asks first; OPEN_TRACK sends none."""


@dataclass(frozen=True)
class Effects:
    """
    What a command would do; each kart of the roster is in one of these groups.

    :param state: the state that it sends; UNKNOWN if it sends nothing.
    :param now: karts that are sent the state at once.
    :param later: karts without a connection, which are sent the state when they connect.
    :param held: other karts, which stay held.
    :param rest: karts to which nothing happens.
    """

    state: State
    now: tuple[Kart, ...] = ()
    later: tuple[Kart, ...] = ()
    held: tuple[Kart, ...] = ()
    rest: tuple[Kart, ...] = ()


def effects(command: CommandKind, race: Race, offered: Available, kart: Kart | None) -> Effects:
    """
    Return what a command would do.

    :param offered: what race control says about the command.
    :param kart: the kart it is for, if it is for one.
    """
    if command not in SENDS:
        concerned: set[int] = set()
    elif kart is not None:
        concerned = {kart.number}
    elif command is CommandKind.RECORD_MSR:
        concerned = {each.number for each in race.karts}
    else:
        concerned = set(offered.karts)

    def those(wanted: bool, part: bool) -> tuple[Kart, ...]:
        return tuple(
            each
            for each in race.karts
            if (each.number in concerned) is wanted
            and (each.connected if wanted else each.hold is not State.UNKNOWN) is part
        )

    return Effects(
        SENDS.get(command, State.UNKNOWN),
        now=those(True, True),
        later=those(True, False),
        held=those(False, True),
        rest=those(False, False),
    )


def nobody_is_heard(race: Race) -> bool:
    """Return whether humans are allowed on the track only because no kart is connected."""
    connected = any(kart.connected for kart in race.karts)
    return race.track.allowed and not race.track.msr_used and not connected


SETTLED = 1.0
"""Time after an answer from which on every snapshot is newer than the answer, in seconds. Race
control publishes a snapshot at least every 0.5 s."""


class Outcome:
    """
    The effect of an accepted command.

    :param at: time of the answer to it, in seconds.
    """

    def __init__(self, order: Order, at: float) -> None:
        """Wait for a snapshot that shows the effect."""
        self.order = order
        self._at = at
        self._seen: object = None

    def stands(self, race: Race, at: float) -> bool:
        """
        Return whether a snapshot, like every one before it, agrees with the answer.

        :param at: time when the snapshot came, in seconds.
        """
        shown = self._shown(race)
        if self._seen is None and self._is_done(race):
            self._seen = shown
        if self._seen is None:
            return at - self._at < SETTLED  # it may be older than the answer
        return shown == self._seen

    def _shown(self, race: Race) -> object:
        """Return the part of a snapshot that the command can change."""
        entry = CATALOGUE[self.order.command]
        if entry.result.track_open is not None:
            return race.track.is_open
        if entry.names_heat:
            return race.state, _racing(race)
        kart = race.kart(self.order.kart)
        if kart is None:
            return (race.state,)
        return kart.sent, kart.hold, kart.in_race, kart.place

    def _is_done(self, race: Race) -> bool:
        order = self.order
        entry = CATALOGUE[order.command]
        if entry.names_heat:
            return any(
                heat.name == order.heat and heat.karts == _racing(race) for heat in race.heats
            )
        return is_so(entry.result, race, race.kart(order.kart))


def is_so(result: Result, race: Race, kart: Kart | None) -> bool:
    """
    Return whether a snapshot shows the result of a command.

    :param kart: the kart that the command is for, if it is for one.
    """
    shown = []
    if result.race:
        shown.append(race.state in map(_state, result.race))
    if result.track_open is not None:
        shown.append(race.track.is_open is result.track_open)
    if kart is not None and result.hold:
        shown.append(kart.hold in map(_state, result.hold))
    if kart is not None and result.in_race is not None:
        shown.append(kart.in_race is result.in_race)
    if kart is not None and result.placed is not None:
        shown.append((kart.place > 0) is result.placed)
    return bool(shown) and all(shown)


def _state(each: RaceState | None) -> State:
    return State.UNKNOWN if each is None else State[each.name]


def _racing(race: Race) -> tuple[int, ...]:
    return tuple(kart.number for kart in race.karts if kart.in_race)
