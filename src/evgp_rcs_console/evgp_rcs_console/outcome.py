"""
Whether the answer to a command is still true.

An answer is true when it comes: "GREEN_GREEN is sent to karts 1, 2". A moment later another
official may send RED FLAG. So the effect of the command is compared with each new snapshot, and
once the effect has changed, the answer must no longer be shown.

Pure: snapshots and times go in.
"""

from __future__ import annotations

from evgp_rcs_console.commands import Order
from evgp_rcs_console.snapshot import Command, Kart, Race, State

SETTLED = 1.0
"""Time after an answer when every snapshot that comes is newer than it, in seconds. Race control
publishes one every 0.5 s at least."""

_STATES = {
    Command.ALL_KILL: (State.RED_RED,),
    Command.RECORD_MSR: (State.RED_RED,),
    Command.RACE_OVER: (State.RED_RED,),
    Command.RED_FLAG: (State.RED_FLAG, State.RED_RED),
    Command.GRID_ACTIVE: (State.GRID_ACTIVE,),
    Command.GREEN_GREEN: (State.GREEN_GREEN,),
    Command.IN_GARAGE: (State.IN_GARAGE,),
}
"""The states of the race after each command to it."""

_HOLDS = {
    Command.KART_RED_RED: (State.RED_RED,),
    Command.KART_RED_FLAG: (State.RED_FLAG, State.RED_RED),
    Command.KART_IN_GARAGE: (State.UNKNOWN,),
}
"""The holds of a kart after each command to it."""


class Outcome:
    """
    The effect of an accepted command.

    :param at: time of its answer, in seconds.
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
        command = self.order.command
        if command in (Command.OPEN_TRACK, Command.CLOSE_TRACK):
            return race.track.is_open
        if command is Command.SET_HEAT:
            return race.state, _racing(race)
        kart = race.kart(self.order.kart)
        if kart is None:
            return (race.state,)
        return kart.sent, kart.hold, kart.in_race, kart.place

    def _is_done(self, race: Race) -> bool:
        order = self.order
        if order.command in _STATES:
            return race.state in _STATES[order.command]
        if order.command in (Command.OPEN_TRACK, Command.CLOSE_TRACK):
            return race.track.is_open is (order.command is Command.OPEN_TRACK)
        if order.command is Command.SET_HEAT:
            return any(
                heat.name == order.heat and heat.karts == _racing(race) for heat in race.heats
            )
        kart = race.kart(order.kart)
        return kart is not None and _is_done_to(kart, order.command)


def _racing(race: Race) -> tuple[int, ...]:
    return tuple(kart.number for kart in race.karts if kart.in_race)


def _is_done_to(kart: Kart, command: Command) -> bool:
    if command in _HOLDS:
        return kart.hold in _HOLDS[command]
    if command is Command.KART_FINISH:
        return kart.place > 0
    return kart.in_race is (command is Command.JOIN_RACE)
