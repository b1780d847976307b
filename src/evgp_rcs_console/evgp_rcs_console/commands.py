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
An official's command as a request: what goes into it, and whether the screen wants it confirmed.

What each command is called, and whether it is a stop, stands in the catalogue; whether it is
allowed is race control's to say.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from evgp_protocol.clock import now
from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs_console.snapshot import State


@dataclass(frozen=True)
class Order:
    """
    A command that an official gave, with what the official saw.

    :param kart: the kart it is for; 0 for a command to the race, to all, or to the track.
    :param stated: the official made the statement that race control asked for.
    :param karts: for a command that starts or releases karts: which, as the official saw it.
    :param hold: for the release of one kart: its hold, as the official saw it.
    :param heat: for putting a heat into the race: its name.
    :param official: who gave it, as it is sent.
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
    """Return whether the official confirms it: it loosens, or to give it is a statement."""
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
