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
What a command would do to each kart, for the question that asks the official to confirm it.

Pure. Race control says which karts a command starts or releases (``Available.karts``); the rest is
read from the same snapshot.
"""

from __future__ import annotations

from dataclasses import dataclass

from evgp_rcs.catalogue import CommandKind
from evgp_rcs_console.snapshot import Available, Kart, Race, State

SENDS = {
    CommandKind.GRID_ACTIVE: State.GRID_ACTIVE,
    CommandKind.GREEN_GREEN: State.GREEN_GREEN,
    CommandKind.IN_GARAGE: State.IN_GARAGE,
    CommandKind.RECORD_MSR: State.RED_RED,
    CommandKind.KART_IN_GARAGE: State.IN_GARAGE,
}
"""What the commands that ask send; OPEN_TRACK sends nothing."""


@dataclass(frozen=True)
class Effects:
    """
    What a command would do; each kart of the roster is in one of these.

    :param state: what it sends; UNKNOWN if it sends nothing.
    :param now: karts that are sent it at once.
    :param later: karts without a connection, which are sent it when they have one.
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

    :param offered: what race control says of the command.
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
