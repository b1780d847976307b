# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The catalogue of officials' commands (§4.B): the name of each, and what kind of command it is.

A row contains everything about a command that does not depend on the race. The table of the rules
(``race.COMMANDS``) says what the command does and when it is refused. The node, console,
``rcs_ctl``, soak and tests use these rows. A new command therefore needs a row in each table, a
constant in `CommandAvailability.msg`, and a service type if its request names more than a kart.

The code is pure.
"""

from __future__ import annotations

import enum

from evgp_node.entries import Entry, Result
from evgp_protocol.states import RaceState


class CommandKind(enum.Enum):
    """An official's command (§4.B); the value is its name in messages to officials."""

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
    TAKE_ROSTER = 'TAKE_ROSTER'
    READ_ROSTER = 'READ_ROSTER'

    __hash__ = object.__hash__  # as in RaceState


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
        'record that you used the MSR, and send RED_RED to every kart',
        'record_msr',
        Result(race=(RaceState.RED_RED,)),
        note='Records that you used the MSR, but does not trigger it.',
        call_is_statement=True,
        flag=('--msr-was-used', 'you state that you used the MSR'),
        key='F9',
        does='also sends ALL KILL',
        condition='the Master Safety Remote was used',
        sends=RaceState.RED_RED,
        stop=True,
    ),
    # RACE_OVER stops karts as well, but it may be refused.
    CommandKind.RACE_OVER: Entry(
        'RACE OVER',
        'RED_RED to the race, which is then over',
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
        takes=('karts', 'opening'),
        flag=('--track-is-clear', 'you state that the track is clear of humans'),
        place=1,
        key='F2',
        does='{karts} in the race',
        follows='after IN GARAGE',
        sends=RaceState.GRID_ACTIVE,
        loosens=True,
    ),
    CommandKind.GREEN_GREEN: Entry(
        'GREEN GREEN',
        'GREEN_GREEN to the race',
        'green_green',
        Result(race=(RaceState.GREEN_GREEN,)),
        takes=('karts',),
        place=2,
        key='F3',
        does='{karts} in the race',
        follows='after GRID ACTIVE',
        condition='the race may start, and the track is clear of humans',
        sends=RaceState.GREEN_GREEN,
        then=('It will start to drive.', 'They will start to drive.'),
        loosens=True,
    ),
    CommandKind.IN_GARAGE: Entry(
        'IN GARAGE',
        'IN_GARAGE to the race',
        'in_garage',
        Result(race=(RaceState.IN_GARAGE,)),
        statement='track_safe',
        takes=('karts',),
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
        'undo the finish of a kart',
        'kart/undo_finish',
        Result(placed=False),
        undoes=CommandKind.KART_FINISH,
        note='Removes the place. Later places move up. A RED FLAG that has already been sent '
        'stays in force.',
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
        takes=('hold',),
        flag=(
            '--made-safe-by-hand',
            'you state that someone made this kart safe; required if it has not acknowledged '
            'its stop',
        ),
        place=4,
        key='Ctrl+G',
        condition='{kart} is at a standstill and may go to its team',
        sends=RaceState.IN_GARAGE,
        to_one_kart=True,
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
        'put the karts of a heat into the race, and take all others out',
        'set_heat',
        takes=('heat',),
        word='heat',
        key='Ctrl+H',
        bookkeeping=True,
    ),
    CommandKind.TAKE_ROSTER: Entry(
        'TAKE ROSTER',
        'apply the roster that was read, with its karts and heats',
        'reload_roster',
        fixed={'take': True},
        takes=('reading',),
        call_is_statement=True,
        loosens=True,
        bookkeeping=True,
    ),
    CommandKind.READ_ROSTER: Entry(
        'READ ROSTER',
        'read the roster file again, and say what would change',
        'reload_roster',
        fixed={'take': False},
        word='reload-roster',
        bookkeeping=True,
    ),
    CommandKind.OPEN_TRACK: Entry(
        'OPEN TRACK',
        'open the track to humans',
        'set_track_open',
        Result(track_open=True),
        fixed={'open': True},
        note='Opens the track to humans. Sends nothing to the karts. Teams must end their '
        'programs before they unplug.',
        statement='no_race_anywhere',
        flag=(
            '--no-race-anywhere',
            'you state that no race is under way anywhere, and no kart is moving; required once, '
            'after the first start',
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
        key='F7',
        bookkeeping=True,
    ),
}
"""Every command of an official, with the stops first."""


def kinds_by_service() -> dict[str, tuple[CommandKind, ...]]:
    """Return the commands of each service. Commands that share a service differ in ``fixed``."""
    found: dict[str, tuple[CommandKind, ...]] = {}
    for kind, entry in CATALOGUE.items():
        found[entry.service] = (*found.get(entry.service, ()), kind)
    return found
