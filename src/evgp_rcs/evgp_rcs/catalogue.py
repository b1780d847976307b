"""
The catalogue of officials' commands (§4.B): what each is called, and what kind of command it is.

One row says everything about a command that does not depend on the race. What it does, and when it
is refused, stands in the table of the rules (``race.COMMANDS``). Node, console, ``rcs_ctl``, soak
and tests go by these rows; so a new command is a row here, a row there, and its service's type.

Pure: standard library only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import enum


class CommandKind(enum.Enum):
    """What an official can command (§4.B); the value is its name in messages to officials."""

    ALL_KILL = 'ALL_KILL'
    RED_FLAG = 'RED_FLAG'
    GRID_ACTIVE = 'GRID_ACTIVE'
    GREEN_GREEN = 'GREEN_GREEN'
    RACE_OVER = 'RACE_OVER'
    IN_GARAGE = 'IN_GARAGE'
    SET_HEAT = 'SET_HEAT'
    OPEN_TRACK = 'OPEN_TRACK'
    CLOSE_TRACK = 'CLOSE_TRACK'
    RECORD_MSR = 'RECORD_MSR'
    KART_RED_RED = 'KART_RED_RED'
    KART_RED_FLAG = 'KART_RED_FLAG'
    KART_FINISH = 'KART_FINISH'
    KART_IN_GARAGE = 'KART_IN_GARAGE'
    JOIN_RACE = 'JOIN_RACE'
    LEAVE_RACE = 'LEAVE_RACE'


@dataclass(frozen=True)
class Entry:
    """
    One row of the catalogue.

    :param service: the name of its service below race control's node; two commands may share one.
    :param service_type: the type of the service.
    :param fixed: the fields of a request that make it this command, where two share a service.
    :param statement: the field of the request that takes the official's statement; empty: none.
    :param call_is_statement: to call the service is the statement.
    :param to_one_kart: the request names a kart (`kart`).
    :param names_karts: the request names the karts that the official saw (`karts`).
    :param names_hold: the request names the hold that the official saw (`hold`).
    :param names_heat: the request names a heat (`heat`).
    :param stop: it stops karts: never refused for a kart of the roster, and never behind another.
    :param overtakes: it is judged before whatever waits; every stop is.
    :param loosens: it starts or releases karts, or lets humans near: refused whenever it is in
        doubt what officials see.
    :param needs_journal: what it does must be on the disk before any kart is told.
    """

    service: str
    service_type: str
    fixed: Mapping[str, bool] = field(default_factory=dict)
    statement: str = ''
    call_is_statement: bool = False
    to_one_kart: bool = False
    names_karts: bool = False
    names_hold: bool = False
    names_heat: bool = False
    stop: bool = False
    overtakes: bool = False
    loosens: bool = False
    needs_journal: bool = False


TRIGGER = 'std_srvs/srv/Trigger'
KART_COMMAND = 'evgp_rcs_msgs/srv/KartCommand'
SET_IN_RACE = 'evgp_rcs_msgs/srv/SetInRace'
SET_BOOL = 'std_srvs/srv/SetBool'

CATALOGUE: dict[CommandKind, Entry] = {
    CommandKind.ALL_KILL: Entry('all_kill', TRIGGER, stop=True, overtakes=True),
    CommandKind.RED_FLAG: Entry('red_flag', TRIGGER, stop=True, overtakes=True),
    CommandKind.KART_RED_RED: Entry(
        'kart/red_red', KART_COMMAND, to_one_kart=True, stop=True, overtakes=True
    ),
    CommandKind.KART_RED_FLAG: Entry(
        'kart/red_flag', KART_COMMAND, to_one_kart=True, stop=True, overtakes=True
    ),
    CommandKind.RECORD_MSR: Entry(
        'record_msr', TRIGGER, call_is_statement=True, stop=True, overtakes=True
    ),
    # It stops karts too, but may be refused.
    CommandKind.RACE_OVER: Entry('race_over', TRIGGER, overtakes=True),
    CommandKind.GRID_ACTIVE: Entry(
        'grid_active',
        'evgp_rcs_msgs/srv/GridActive',
        statement='track_clear',
        names_karts=True,
        loosens=True,
    ),
    CommandKind.GREEN_GREEN: Entry(
        'green_green',
        'evgp_rcs_msgs/srv/GreenGreen',
        statement='without_record',
        names_karts=True,
        loosens=True,
        needs_journal=True,
    ),
    CommandKind.IN_GARAGE: Entry(
        'in_garage',
        'evgp_rcs_msgs/srv/InGarage',
        statement='track_safe',
        names_karts=True,
        loosens=True,
    ),
    CommandKind.KART_FINISH: Entry('kart/finish', KART_COMMAND, to_one_kart=True),
    CommandKind.KART_IN_GARAGE: Entry(
        'kart/in_garage',
        'evgp_rcs_msgs/srv/KartInGarage',
        statement='made_safe_by_hand',
        to_one_kart=True,
        names_hold=True,
        loosens=True,
    ),
    CommandKind.JOIN_RACE: Entry(
        'set_in_race', SET_IN_RACE, fixed={'in_race': True}, to_one_kart=True
    ),
    CommandKind.LEAVE_RACE: Entry(
        'set_in_race', SET_IN_RACE, fixed={'in_race': False}, to_one_kart=True
    ),
    CommandKind.SET_HEAT: Entry('set_heat', 'evgp_rcs_msgs/srv/SetHeat', names_heat=True),
    CommandKind.OPEN_TRACK: Entry('set_track_open', SET_BOOL, fixed={'data': True}, loosens=True),
    CommandKind.CLOSE_TRACK: Entry('set_track_open', SET_BOOL, fixed={'data': False}),
}
"""Every command of an official, stops first."""
