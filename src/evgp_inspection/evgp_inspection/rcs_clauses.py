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

"""The clauses of a race control: what can be seen of it from three karts, one row each."""

from __future__ import annotations

from evgp_inspection.clauses import Clause, PROPOSAL, WIRE

RCS_STEPS = (
    *('connect', 'grid', 'halves', 'last', 'lost', 'race', 'again', 'flag', 'held', 'stop'),
    *('vanish', 'absent'),
)
"""The steps of `inspect_rcs`, in their order."""

RULES_DOCUMENT = 'docs/rules.md'

_GREEN = 'Fail: a kart is sent GREEN_GREEN.'
_BACK_RED = 'Fail: the kart is sent anything but RED_RED.'
_REACH = 'Time from the command to the last kart.'

_UNTIL = (
    'The RCS will not permit the race to be started until all karts in the race have '
    'acknowledged the GRID_ACTIVE command.'
)
_COUNTS = 'An acknowledgement counts if it is the state that the kart is being sent'
_HELD = (
    'If a kart has disconnected (as described in Connection status) during the race, the kart '
    'shall immediately enter the RED_RED state.'
)

RCS: tuple[Clause, ...] = (
    Clause(
        'R-3A-01',
        'IN_GARAGE first to a kart that connects',
        PROPOSAL,
        '§3.A',
        'All karts will be in this state as they connect to the RCS.',
        'Three karts connect; one of them is not in the race.',
        'Fail: another state is sent first.',
        ('connect',),
        unless=('R-4A-01',),
    ),
    Clause(
        'R-3A-02',
        'RED_FLAG does not loosen RED_RED',
        RULES_DOCUMENT,
        '§3.A',
        'race to `RED_FLAG`, unless it is in `RED_RED`',
        'RED_FLAG is commanded after ALL_KILL.',
        'Fail: a kart is sent anything but RED_RED.',
        ('stop',),
        unless=('R-4B-01',),
    ),
    Clause(
        'R-3A-03',
        'RED_FLAG does not loosen a kart that is held in RED_RED',
        RULES_DOCUMENT,
        '§3.A',
        'A hold can only get stricter.',
        'RED_RED is commanded for one kart in GREEN_GREEN, then RED_FLAG for the race.',
        'Fail: that kart is sent anything but RED_RED.',
        ('held',),
        unless=('R-3A-02', 'R-4B-03'),
    ),
    Clause(
        'R-3B-01',
        'no GREEN_GREEN without acknowledgements',
        PROPOSAL,
        '§3.B',
        _UNTIL,
        'GREEN_GREEN is commanded after GRID_ACTIVE; no kart has acknowledged.',
        _GREEN,
        ('grid',),
    ),
    Clause(
        'R-3B-02',
        'no GREEN_GREEN on what a kart said before GRID_ACTIVE',
        WIRE,
        '§3.B',
        _COUNTS,
        'One kart says GRID_ACTIVE in IN_GARAGE and not after; the other acknowledges.',
        _GREEN,
        ('grid',),
        unless=('R-3B-01',),
    ),
    Clause(
        'R-3B-03',
        'no GREEN_GREEN while a kart of the race is away',
        RULES_DOCUMENT,
        '§3.B',
        'all of them connected, none held, and each has acknowledged this `GRID_ACTIVE`',
        'Both acknowledge, one closes its connection, then GREEN_GREEN is commanded.',
        _GREEN,
        ('lost',),
        unless=('R-3B-01',),
    ),
    Clause(
        'R-3B-04',
        'no GREEN_GREEN on an acknowledgement of an earlier connection',
        WIRE,
        '§3.B',
        'A kart that comes back after a loss has to acknowledge again.',
        'The kart is back and says nothing; GREEN_GREEN is commanded.',
        _GREEN,
        ('lost',),
        unless=('R-3B-01', 'R-3B-02', 'R-3B-03'),
    ),
    Clause(
        'R-3B-05',
        'no GREEN_GREEN on an acknowledgement of an earlier GRID_ACTIVE',
        WIRE,
        '§3.B',
        'An acknowledgement is valid until the next command.',
        'After a race, GRID_ACTIVE comes again; no kart acknowledges it.',
        _GREEN,
        ('race', 'again'),
        unless=('R-3B-01',),
    ),
    Clause(
        'R-3B-06',
        'GRID_ACTIVE to the karts of the race',
        PROPOSAL,
        '§3.B',
        'the RCS will broadcast *\\$GRID_ACTIVE*; until all In Race karts have Acknowledged the '
        'message.',
        'GRID_ACTIVE is commanded in IN_GARAGE.',
        _REACH,
        ('race',),
        'reach',
    ),
    Clause(
        'R-3B-07',
        'GREEN_GREEN once all have acknowledged',
        PROPOSAL,
        '§3.B',
        _UNTIL,
        'GREEN_GREEN is commanded when both karts have acknowledged GRID_ACTIVE.',
        _REACH,
        ('race',),
        'reach',
        ('R-3B-06',),
    ),
    Clause(
        'R-3B-08',
        'no GREEN_GREEN on a word that was begun before GRID_ACTIVE',
        WIRE,
        '§3.B',
        _COUNTS,
        'One kart says the first half of $GRID_ACTIVE; in IN_GARAGE and the other half in '
        'GRID_ACTIVE; the other acknowledges.',
        _GREEN,
        ('halves',),
        unless=('R-3B-01', 'R-3B-02'),
    ),
    Clause(
        'R-3C-01',
        'FINISH: RED_FLAG to that kart alone',
        PROPOSAL,
        '§3.C',
        'The RCS will send the kart a *\\$RED_FLAG*; command as described in the RCS Software '
        'description.',
        'One kart of the race is marked as finished.',
        'Time from FINISH to RED_FLAG. Fail also: the other kart is sent a red.',
        ('race',),
        'finish',
    ),
    Clause(
        'R-3C-02',
        'FINISH: the later place has another delay',
        PROPOSAL,
        '§3.C',
        'The set amount of time will depend on what place the kart finished to stagger karts and '
        'avoid a crash at the finish line.',
        'Then the other kart is marked as finished.',
        'Fail: the two delays differ by less than stagger.',
        ('race',),
        'stagger',
        ('R-3C-01',),
    ),
    Clause(
        'R-3C-03',
        'RACE_OVER: RED_RED to the race',
        PROPOSAL,
        '§3.C',
        'The RCS will then broadcast the *\\$RED_RED*; command until all participating karts have '
        'Acknowledged.',
        'RACE_OVER is commanded once both karts have their RED_FLAG.',
        _REACH,
        ('race',),
        'reach',
    ),
    Clause(
        'R-3C-04',
        'no IN_GARAGE before all have acknowledged RED_RED',
        PROPOSAL,
        '§3.C',
        'When all karts have Acknowledged and track officials deem the track safe for humans, a '
        '*\\$IN_GARAGE*; command will be sent to all karts and teams may enter the track.',
        'IN_GARAGE is commanded when one of two karts has acknowledged.',
        'Fail: a kart is sent anything but RED_RED.',
        ('race',),
        unless=('R-3C-03',),
    ),
    Clause(
        'R-3C-05',
        'IN_GARAGE once all have acknowledged RED_RED',
        PROPOSAL,
        '§3.C',
        'When all karts have Acknowledged and track officials deem the track safe for humans, a '
        '*\\$IN_GARAGE*; command will be sent to all karts and teams may enter the track.',
        'IN_GARAGE is commanded when both have acknowledged.',
        _REACH,
        ('race',),
        'reach',
        ('R-3C-03', 'R-3C-04'),
    ),
    Clause(
        'R-3E-01',
        'a kart that comes back in IN_GARAGE: IN_GARAGE',
        WIRE,
        '§3.E',
        '`$IN_GARAGE;` when the kart connects, if no race is under way and the kart is not held.',
        'A kart closes its connection in IN_GARAGE and connects again.',
        'Fail: the kart is sent anything but IN_GARAGE.',
        ('connect',),
        unless=('R-3A-01',),
    ),
    Clause(
        'R-3E-02',
        'a kart that comes back in GRID_ACTIVE: not GREEN_GREEN',
        WIRE,
        '§3.E',
        'A kart of a race under way is sent what the rules say',
        'A kart closes its connection in GRID_ACTIVE and connects again.',
        'Fail: the first frame is GREEN_GREEN.',
        ('lost',),
        unless=('R-3B-03',),
    ),
    Clause(
        'R-3E-03',
        'a kart that comes back in GREEN_GREEN: RED_RED',
        PROPOSAL,
        '§3.E',
        _HELD,
        'The connection of a kart is reset in GREEN_GREEN; it connects again.',
        _BACK_RED,
        ('again',),
    ),
    Clause(
        'R-3E-04',
        'a kart that comes back in RED_FLAG: RED_RED',
        PROPOSAL,
        '§3.E',
        _HELD,
        'A kart closes its connection in RED_FLAG and connects again.',
        _BACK_RED,
        ('flag',),
        unless=('R-4B-02',),
    ),
    Clause(
        'R-3E-05',
        'a kart that comes back in RED_RED: RED_RED',
        PROPOSAL,
        '§3.E',
        _HELD,
        'After ALL_KILL, a kart closes its connection and connects again.',
        _BACK_RED,
        ('stop',),
        unless=('R-4B-01',),
    ),
    Clause(
        'R-3E-06',
        'a kart that vanished comes back: RED_RED',
        PROPOSAL,
        '§3.E',
        _HELD,
        'The kart that vanished in GREEN_GREEN connects again.',
        _BACK_RED,
        ('vanish',),
        unless=('R-3E-03', 'R-4D-01'),
    ),
    Clause(
        'R-3E-07',
        'a kart that was away during a command comes back: RED_RED',
        RULES_DOCUMENT,
        '§3.E',
        'every kart of the roster, in `RED_RED`, also those that are not connected',
        'ALL_KILL is commanded while a kart of the race is away; it connects again.',
        'Fail: it is not let in (connect), or is sent anything but RED_RED.',
        ('absent',),
        unless=('R-3E-05',),
    ),
    Clause(
        'R-3F-01',
        'a kart outside the race: IN_GARAGE, or RED_RED once it is stopped',
        PROPOSAL,
        '§3.F',
        'Any Kart that connects to the RCS that is not in the race will be kept in the IN GARAGE '
        'state and will only receive the message `$IN_GARAGE`;',
        'A kart that is not in the race is connected during the whole inspection.',
        'Fail: it is sent another state; RED_RED counts as one unless ALL_KILL was commanded, or '
        'RED_RED for it alone.',
        (),
    ),
    Clause(
        'R-4A-01',
        'takes the connection of each kart',
        PROPOSAL,
        '§4.A',
        'All karts will be assigned a static IP address corresponding to their team number for '
        'use with the RCS.',
        'Each kart connects from its own address.',
        'Time from the connection to the first frame.',
        ('connect',),
        'connect',
    ),
    Clause(
        'R-4A-02',
        'sends nothing to an unknown address, and closes its connection',
        WIRE,
        '§4.A',
        'Race control closes a connection from any other address at once, without a frame',
        'Somebody connects from an address that is no kart.',
        'Fail: a byte comes, or the connection stays open (slack).',
        ('connect',),
    ),
    Clause(
        'R-4A-03',
        'a second connection of a kart takes the place of the first',
        WIRE,
        '§4.A',
        'A second one from the same address takes the place of the first.',
        'A kart connects a second time in IN_GARAGE and keeps the first connection.',
        'Fail: the first stays open (slack), or nothing is sent on the second.',
        ('connect',),
    ),
    Clause(
        'R-4B-01',
        'ALL_KILL reaches every kart, in the race or not',
        PROPOSAL,
        '§4.B',
        'Send *\\$RED_RED*; command to All karts',
        'ALL_KILL is commanded in GREEN_GREEN.',
        _REACH,
        ('stop',),
        'all_kill',
    ),
    Clause(
        'R-4B-02',
        'RED_FLAG reaches the race',
        PROPOSAL,
        '§4.B',
        'Sends *\\$RED_FLAG*; to In Race karts.',
        'RED_FLAG is commanded in GREEN_GREEN.',
        _REACH,
        ('flag',),
        'reach',
    ),
    Clause(
        'R-4B-03',
        'RED_RED to one kart reaches it, and it alone',
        PROPOSAL,
        '§4.B',
        'Send *\\$RED_RED*; to the Individual kart',
        'RED_RED is commanded for one kart in GREEN_GREEN.',
        'Time from the command. Fail also: the other kart is sent another state.',
        ('again',),
        'reach',
    ),
    Clause(
        'R-4B-04',
        'a command that is not possible changes nothing on the wire',
        PROPOSAL,
        '§4.B',
        'Requires GRID_ACTIVE to be the last button pressed and every kart In Race to send the '
        '\\$GRID_ACTIVE; message to the RCS.',
        'GREEN_GREEN in IN_GARAGE; GRID_ACTIVE and IN_GARAGE in a race; GRID_ACTIVE and '
        'GREEN_GREEN after ALL_KILL.',
        'Fail: a kart is sent another state than before.',
        ('connect', 'race', 'stop'),
        unless=('R-3A-02', 'R-4B-01'),
    ),
    Clause(
        'R-4B-05',
        'ALL_KILL is for karts that are away, too',
        RULES_DOCUMENT,
        '§4.B',
        'every kart of the roster, in `RED_RED`, also those that are not connected',
        'ALL_KILL is commanded while a kart that is not in the race is away; it connects again.',
        _BACK_RED,
        ('absent',),
        unless=('R-3E-05', 'R-4B-01'),
    ),
    Clause(
        'R-4B-06',
        'no GREEN_GREEN unless GRID_ACTIVE was the last button pressed',
        PROPOSAL,
        '§4.B',
        'Requires GRID_ACTIVE to be the last button pressed',
        'Both karts acknowledge GRID_ACTIVE; RED_RED is commanded for the kart outside the race, '
        'then GREEN_GREEN.',
        _GREEN,
        ('last',),
        unless=('R-3B-01',),
    ),
    Clause(
        'R-4C-01',
        'sends at least 10 frames a second',
        PROPOSAL,
        '§4.C',
        'The RCS will send the race state at least 10 times per second.',
        'All frames are counted, on each connection of 1 s or more.',
        'Fail: fewer than 10 a second (2 % are allowed for).',
        (),
    ),
    Clause(
        'R-4C-02',
        'no long gap between two frames',
        PROPOSAL,
        '§4.C',
        'The RCS will send the race state at least 10 times per second.',
        'The time between two frames is measured, on each connection.',
        'The longest gap.',
        (),
        'gap',
        ('R-4C-01',),
    ),
    Clause(
        'R-4C-03',
        'sends whole, correct frames only',
        PROPOSAL,
        '§4.C',
        'Each message will begin with a start character (a dollar sign: \\$) followed by a '
        'character byte array of the State name and finished with an end character (a '
        'semi-colon: ;)',
        'All bytes are read, during the whole inspection.',
        'Fail: bytes that are no frame.',
        (),
    ),
    Clause(
        'R-4D-01',
        'notices that a kart has vanished (half-open connection)',
        PROPOSAL,
        '§4.D',
        'The RCS will continuously determine if a kart is connected and will follow the '
        'Disconnected protocol if the connection is lost.',
        'In GREEN_GREEN, the computer of one kart stops answering, as without WiFi.',
        'Fail: after half_open, the connection is still there.',
        ('vanish',),
        'half_open',
    ),
)

RCS_BY_NAME = {clause.name: clause for clause in RCS}
