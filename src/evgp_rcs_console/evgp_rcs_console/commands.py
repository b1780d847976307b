"""
Every command of an official as a request: which service, and what goes into it.

Not whether a command is allowed: that is race control's to say. What stands here of a command's
nature is only how to ask for it: whether the screen wants it confirmed (it loosens something), and
whether it is a stop, which is sent even into silence, and again until race control has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from evgp_protocol.clock import now
from evgp_rcs_console.snapshot import Command, State


@dataclass(frozen=True)
class Order:
    """
    A command that an official gave, with what the official saw.

    :param kart: the kart it is for; 0 for a command to the race, to all, or to the track.
    :param stated: the official made the statement that race control asked for.
    :param karts: for a command that starts or releases karts: which, as the official saw it.
    :param hold: for the release of one kart: its hold, as the official saw it.
    :param heat: for putting a heat into the race: its name.
    :param at: when it was given, by the clock that counts a suspend, in seconds.
    """

    command: Command
    kart: int = 0
    stated: bool = False
    karts: tuple[int, ...] = ()
    hold: State = State.UNKNOWN
    heat: str = ''
    at: float = field(default_factory=now)


@dataclass(frozen=True)
class Form:
    """
    How a command is asked for.

    :param service: its name below race control's node.
    :param kind: the type of the service.
    :param to_one_kart: the request names a kart.
    :param statement: the field of the request in which the official's statement goes.
    :param fixed: further fields of the request.
    :param names_karts: the request names the karts that the official saw.
    :param names_hold: the request names the hold that the official saw.
    :param names_heat: the request names a heat.
    :param confirmed: it loosens something, so the official confirms it.
    :param stop: it stops karts.
    """

    service: str
    kind: str = 'Trigger'
    to_one_kart: bool = False
    statement: str = ''
    fixed: Mapping[str, bool] = field(default_factory=dict)
    names_karts: bool = False
    names_hold: bool = False
    names_heat: bool = False
    confirmed: bool = False
    stop: bool = False

    def request(self, order: Order) -> dict[str, int | bool | str | list[int] | State]:
        """Return the fields of a request."""
        fields: dict[str, int | bool | str | list[int] | State] = dict(self.fixed)
        if self.to_one_kart:
            fields['kart'] = order.kart
        if self.statement:
            fields[self.statement] = order.stated
        if self.names_karts:
            fields['karts'] = list(order.karts)
        if self.names_hold:
            fields['hold'] = order.hold
        if self.names_heat:
            fields['heat'] = order.heat
        return fields


FORMS: dict[Command, Form] = {
    Command.ALL_KILL: Form('all_kill', stop=True),
    Command.RED_FLAG: Form('red_flag', stop=True),
    Command.GRID_ACTIVE: Form(
        'grid_active', 'GridActive', statement='track_clear', names_karts=True, confirmed=True
    ),
    Command.GREEN_GREEN: Form(
        'green_green', 'GreenGreen', statement='without_record', names_karts=True, confirmed=True
    ),
    Command.RACE_OVER: Form('race_over'),
    Command.IN_GARAGE: Form(
        'in_garage', 'InGarage', statement='track_safe', names_karts=True, confirmed=True
    ),
    Command.OPEN_TRACK: Form('set_track_open', 'SetBool', fixed={'data': True}, confirmed=True),
    Command.CLOSE_TRACK: Form('set_track_open', 'SetBool', fixed={'data': False}),
    Command.RECORD_MSR: Form('record_msr', confirmed=True, stop=True),
    Command.KART_RED_RED: Form('kart/red_red', 'KartCommand', to_one_kart=True, stop=True),
    Command.KART_RED_FLAG: Form('kart/red_flag', 'KartCommand', to_one_kart=True, stop=True),
    Command.KART_FINISH: Form('kart/finish', 'KartCommand', to_one_kart=True),
    Command.KART_IN_GARAGE: Form(
        'kart/in_garage',
        'KartInGarage',
        to_one_kart=True,
        statement='made_safe_by_hand',
        names_hold=True,
        confirmed=True,
    ),
    Command.JOIN_RACE: Form('set_in_race', 'SetInRace', to_one_kart=True, fixed={'in_race': True}),
    Command.LEAVE_RACE: Form(
        'set_in_race', 'SetInRace', to_one_kart=True, fixed={'in_race': False}
    ),
    Command.SET_HEAT: Form('set_heat', 'SetHeat', names_heat=True),
}
"""Every command of an official."""
