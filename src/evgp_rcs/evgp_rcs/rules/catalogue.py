# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The catalogue of officials' commands (§4.B): what each is called, and what kind of command it is.

One row says everything about a command that does not depend on the race. What it does, and when it
is refused, stands in the table of the rules (``race.COMMANDS``). Node, console, ``rcs_ctl``, soak
and tests go by these rows. So a new command is a row here, a row there, and a constant of
`CommandAvailability.msg`; and a service type, if its request names more than a kart.

Pure: standard library and race states only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import enum

from evgp_protocol.states import RaceState


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
    KART_UNDO_FINISH = 'KART_UNDO_FINISH'
    KART_IN_GARAGE = 'KART_IN_GARAGE'
    JOIN_RACE = 'JOIN_RACE'
    LEAVE_RACE = 'LEAVE_RACE'

    __hash__ = object.__hash__  # as RaceState has it


@dataclass(frozen=True)
class Result:
    """
    What a screen shows once a command is in force; an empty field says nothing.

    :param race: the race is in one of these states.
    :param hold: the kart's hold is one of these; ``None`` is no hold.
    :param in_race: whether the kart is in the race.
    :param placed: whether the kart has a finishing place.
    :param track_open: whether the track is open to humans.
    """

    race: tuple[RaceState, ...] = ()
    hold: tuple[RaceState | None, ...] = ()
    in_race: bool | None = None
    placed: bool | None = None
    track_open: bool | None = None


@dataclass(frozen=True)
class Entry:
    """
    One row of the catalogue.

    :param label: what its button says; `RED RED` to one kart or to all, since the place tells.
    :param meaning: what it does, in a few words.
    :param service: the name of its service below race control's node; two commands may share one.
        Every request has `official`: who gives the command, by their own word.
    :param fixed: the fields of a request that make it this command, where two share a service.
    :param result: what is so once it is in force.
    :param undoes: the command that it takes back. The two share a button, which offers this one
        while the result of the other holds.
    :param note: what a question says of it, besides which karts are sent what; a sentence.
    :param statement: the field of the request that takes the official's statement; empty: none.
    :param call_is_statement: to call the service is the statement.
    :param to_one_kart: the request names a kart (`kart`).
    :param names_karts: the request names the karts that the official saw (`karts`).
    :param names_hold: the request names the hold that the official saw (`hold`).
    :param names_heat: the request names a heat (`heat`).
    :param takes: further fields of the request, as ``Command`` has them.
    :param flag: the option of `rcs_ctl` for a statement, and what it states; empty: none.
    :param word: what `rcs_ctl` calls it, if not as the kind.
    :param short: what its button says where there is little room, if not `label`.
    :param place: of its button, from the left: to the race in the line of the race, to a kart in
        its row; 0: it has no button there. One that undoes another is where that one is.
    :param key: the key of its button. What it is to a kart goes to the chosen one.
    :param does: what its button says it would do; ``{karts}`` is how many it starts or releases.
    :param follows: when it is possible, if the state of the race does not allow it.
    :param condition: what an official confirms if race control asks for no statement; ``{kart}``
        is the kart.
    :param sends: the state that it sends, if it asks first.
    :param then: what follows, to one kart and to several.
    :param bookkeeping: no button of §4.B: GRID_ACTIVE stays the last one that was pressed.
    :param stop: it stops karts: never refused for a kart of the roster, and never behind another.
    :param loosens: it starts or releases karts, or lets humans near: refused whenever it is in
        doubt what officials see.
    """

    label: str
    meaning: str
    service: str
    result: Result = field(default_factory=Result)
    fixed: Mapping[str, bool] = field(default_factory=dict)
    undoes: CommandKind | None = None
    note: str = ''
    statement: str = ''
    call_is_statement: bool = False
    to_one_kart: bool = False
    names_karts: bool = False
    names_hold: bool = False
    names_heat: bool = False
    takes: tuple[str, ...] = ()
    flag: tuple[str, str] | None = None
    word: str = ''
    short: str = ''
    place: int = 0
    key: str = ''
    does: str = ''
    follows: str = ''
    condition: str = ''
    sends: RaceState | None = None
    then: tuple[str, str] = ('', '')
    bookkeeping: bool = False
    stop: bool = False
    loosens: bool = False

    @property
    def asks(self) -> bool:
        """Return whether an official confirms it: it loosens, or giving it is a statement."""
        return self.loosens or self.call_is_statement

    @property
    def service_type(self) -> str:
        """Return the type of the service: of its own, if its request names more than a kart."""
        name = 'KartCommand' if self.to_one_kart else 'RaceCommand'
        names = self.names_karts or self.names_hold or self.names_heat or self.takes
        if self.fixed or self.statement or names:
            name = self.service.title().replace('_', '').replace('/', '')
        return f'evgp_rcs_msgs/srv/{name}'

    @property
    def overtakes(self) -> bool:
        """Return whether it is judged before whatever waits; RACE_OVER may still be refused."""
        return self.stop or self.result.race == (RaceState.RED_RED,)

    @property
    def needs_journal(self) -> bool:
        """Return whether it must be on the disk before any kart is told."""
        return RaceState.GREEN_GREEN in self.result.race


FLAG_OR_RED = (RaceState.RED_FLAG, RaceState.RED_RED)

CATALOGUE: dict[CommandKind, Entry] = {
    CommandKind.ALL_KILL: Entry(
        'ALL KILL',
        'RED_RED to every kart',
        'all_kill',
        Result(race=(RaceState.RED_RED,)),
        stop=True,
    ),
    CommandKind.RED_FLAG: Entry(
        'RED FLAG',
        'RED_FLAG to the race',
        'red_flag',
        Result(race=FLAG_OR_RED),
        place=3,
        key='F4',
        does='stops the race, which cannot be resumed',
        stop=True,
    ),
    CommandKind.KART_RED_RED: Entry(
        'RED RED',
        'RED_RED to one kart',
        'kart/red_red',
        Result(hold=(RaceState.RED_RED,)),
        place=1,
        key='Ctrl+R',
        to_one_kart=True,
        stop=True,
    ),
    CommandKind.KART_RED_FLAG: Entry(
        'RED FLAG',
        'RED_FLAG to one kart',
        'kart/red_flag',
        Result(hold=FLAG_OR_RED),
        place=2,
        key='Ctrl+F',
        to_one_kart=True,
        stop=True,
    ),
    CommandKind.RECORD_MSR: Entry(
        'MSR WAS USED',
        'record that you used the MSR; also RED_RED to every kart',
        'record_msr',
        Result(race=(RaceState.RED_RED,)),
        note='Records that you used the MSR. It does not trigger the MSR.',
        call_is_statement=True,
        flag=('--msr-was-used', 'you state that you used the MSR'),
        key='F9',
        does='also stops every kart',
        condition='the Master Safety Remote was used',
        sends=RaceState.RED_RED,
        stop=True,
    ),
    # It stops karts too, but may be refused.
    CommandKind.RACE_OVER: Entry(
        'RACE OVER',
        'RED_RED to the race, which is over',
        'race_over',
        Result(race=(RaceState.RED_RED,)),
        place=4,
        key='F5',
        does='stops and ends the race',
        follows='during a race',
    ),
    CommandKind.GRID_ACTIVE: Entry(
        'GRID ACTIVE',
        'GRID_ACTIVE to the race',
        'grid_active',
        Result(race=(RaceState.GRID_ACTIVE,)),
        statement='track_clear',
        names_karts=True,
        flag=('--track-is-clear', 'you state that the track is clear of humans'),
        place=1,
        key='F2',
        does='{karts}',
        follows='after IN GARAGE',
        sends=RaceState.GRID_ACTIVE,
        loosens=True,
    ),
    CommandKind.GREEN_GREEN: Entry(
        'GREEN GREEN',
        'GREEN_GREEN to the race',
        'green_green',
        Result(race=(RaceState.GREEN_GREEN,)),
        names_karts=True,
        place=2,
        key='F3',
        does='{karts}',
        follows='after GRID ACTIVE',
        condition='the race may start, and the track is clear of humans',
        sends=RaceState.GREEN_GREEN,
        then=('It drives off.', 'They drive off.'),
        loosens=True,
    ),
    CommandKind.IN_GARAGE: Entry(
        'IN GARAGE',
        'IN_GARAGE to the race',
        'in_garage',
        Result(race=(RaceState.IN_GARAGE,)),
        statement='track_safe',
        names_karts=True,
        flag=('--track-is-safe', 'you declare the track safe for humans'),
        place=5,
        key='F6',
        does='{karts}',
        follows='after RACE OVER or ALL KILL',
        sends=RaceState.IN_GARAGE,
        then=('The team has its kart back.', 'The teams have their karts back.'),
        loosens=True,
    ),
    CommandKind.KART_FINISH: Entry(
        'FINISH',
        'a kart has crossed the line',
        'kart/finish',
        Result(placed=True),
        takes=('run', 'race', 'attempt'),
        place=3,
        key='Ctrl+E',
        to_one_kart=True,
    ),
    CommandKind.KART_UNDO_FINISH: Entry(
        'UNDO FINISH',
        'take back that a kart has finished',
        'kart/undo_finish',
        Result(placed=False),
        undoes=CommandKind.KART_FINISH,
        note='Takes its place away; later places move up. A RED FLAG that was sent stays.',
        short='UNDO',
        condition='{kart} has not finished',
        call_is_statement=True,
        to_one_kart=True,
        bookkeeping=True,
    ),
    CommandKind.KART_IN_GARAGE: Entry(
        'GARAGE',
        'release one kart from its hold',
        'kart/in_garage',
        Result(hold=(None,)),
        statement='made_safe_by_hand',
        flag=(
            '--made-safe-by-hand',
            'you state that someone made this kart safe; needed if it has not acknowledged its '
            'stop',
        ),
        place=4,
        key='Ctrl+G',
        condition='{kart} stands still and may go to its team',
        sends=RaceState.IN_GARAGE,
        to_one_kart=True,
        names_hold=True,
        loosens=True,
    ),
    CommandKind.JOIN_RACE: Entry(
        'JOIN',
        'put a kart into the race',
        'set_in_race',
        Result(in_race=True),
        fixed={'in_race': True},
        word='join',
        place=5,
        key='Ctrl+J',
        to_one_kart=True,
        bookkeeping=True,
    ),
    CommandKind.LEAVE_RACE: Entry(
        'LEAVE',
        'take a kart out of the race',
        'set_in_race',
        Result(in_race=False),
        fixed={'in_race': False},
        word='leave',
        key='Ctrl+J',
        undoes=CommandKind.JOIN_RACE,
        to_one_kart=True,
        bookkeeping=True,
    ),
    CommandKind.SET_HEAT: Entry(
        'HEAT',
        'put a heat of the roster into the race, and all others out',
        'set_heat',
        names_heat=True,
        word='heat',
        key='Ctrl+H',
        bookkeeping=True,
    ),
    CommandKind.OPEN_TRACK: Entry(
        'OPEN TRACK',
        'open the track to humans',
        'set_track_open',
        Result(track_open=True),
        fixed={'open': True},
        note='Opens the track to humans. Sends nothing to the karts. Teams end their programs '
        'before they unplug.',
        statement='no_race_anywhere',
        flag=(
            '--no-race-anywhere',
            'you state that no race is under way anywhere, and no kart moves; needed once after '
            'the first start',
        ),
        key='F7',
        condition='teams may go onto the track',
        loosens=True,
        bookkeeping=True,
    ),
    CommandKind.CLOSE_TRACK: Entry(
        'CLOSE TRACK',
        'close the track to humans',
        'set_track_open',
        Result(track_open=False),
        fixed={'open': False},
        undoes=CommandKind.OPEN_TRACK,
        statement='no_race_anywhere',  # of the request that the two share; to close needs none
        key='F7',
        bookkeeping=True,
    ),
}
"""Every command of an official, stops first."""


def kinds_by_service() -> dict[str, tuple[CommandKind, ...]]:
    """Return each service with its commands: one, or two that ``fixed`` tells apart."""
    found: dict[str, tuple[CommandKind, ...]] = {}
    for kind, entry in CATALOGUE.items():
        found[entry.service] = (*found.get(entry.service, ()), kind)
    return found
