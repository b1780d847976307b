"""
Every command of an official as a request: which service, and what goes into it.

Not whether a command is allowed: that is race control's to say. What stands here of a command's
nature is only how to ask for it: whether the screen wants it confirmed (it loosens something), and
whether it is a stop, which is sent even into silence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from evgp_rcs_console.snapshot import Command


@dataclass(frozen=True)
class Form:
    """
    How a command is asked for.

    :param service: its name below race control's node.
    :param kind: the type of the service.
    :param to_one_kart: the request names a kart.
    :param statement: the field of the request in which the official's statement goes.
    :param fixed: further fields of the request.
    :param confirmed: it loosens something, so the official confirms it.
    :param stop: it stops karts.
    """

    service: str
    kind: str = 'Trigger'
    to_one_kart: bool = False
    statement: str = ''
    fixed: Mapping[str, bool] = field(default_factory=dict)
    confirmed: bool = False
    stop: bool = False

    def request(self, kart: int, stated: bool) -> dict[str, int | bool]:
        """Return the fields of a request."""
        fields: dict[str, int | bool] = dict(self.fixed)
        if self.to_one_kart:
            fields['kart'] = kart
        if self.statement:
            fields[self.statement] = stated
        return fields


FORMS: dict[Command, Form] = {
    Command.ALL_KILL: Form('all_kill', stop=True),
    Command.RED_FLAG: Form('red_flag', stop=True),
    Command.GRID_ACTIVE: Form(
        'grid_active', 'GridActive', statement='track_clear', confirmed=True
    ),
    Command.GREEN_GREEN: Form('green_green', 'GreenGreen', confirmed=True),
    Command.RACE_OVER: Form('race_over'),
    Command.IN_GARAGE: Form('in_garage', 'InGarage', statement='track_safe', confirmed=True),
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
        confirmed=True,
    ),
    Command.JOIN_RACE: Form('set_in_race', 'SetInRace', to_one_kart=True, fixed={'in_race': True}),
    Command.LEAVE_RACE: Form(
        'set_in_race', 'SetInRace', to_one_kart=True, fixed={'in_race': False}
    ),
}
"""Every command of an official."""
