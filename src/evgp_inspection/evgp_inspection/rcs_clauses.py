# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The clauses of a race control: what can be seen of it from three karts, one row each."""

from __future__ import annotations

import functools

from evgp_inspection import rcs_judges as judge
from evgp_inspection.rcs_judges import (
    GREEN_GREEN,
    GRID_ACTIVE,
    IN_GARAGE,
    ONE,
    OUT,
    RED_FLAG,
    RED_RED,
    TWO,
)
from evgp_inspection.verdicts import Clause, DISCONNECTED, proposal, says_frames, wire
from evgp_protocol.states import RaceState

RCS_STEPS = (
    *('connect', 'grid', 'halves', 'last', 'lost', 'race', 'again', 'flag', 'held', 'stop'),
    *('vanish', 'absent'),
)
"""The steps of `inspect_rcs`, in their order."""

_rules = functools.partial(Clause, 'docs/rules.md')

_UNTIL = (
    'The RCS will not permit the race to be started until all karts in the race have '
    'acknowledged the GRID_ACTIVE command.'
)
_RELEASE = (
    'When all karts have Acknowledged and track officials deem the track safe for humans, a '
    '*\\$IN_GARAGE*; command will be sent to all karts and teams may enter the track.'
)

RCS: tuple[Clause, ...] = (
    proposal(
        'R-3A-01',
        'IN_GARAGE first to a kart that connects',
        'All karts will be in this state as they connect to the RCS.',
        'Three karts connect; one of them is not in the race.',
        judge.is_sent_only('connect/first', {IN_GARAGE}, ONE, TWO, OUT),
        ('R-4A-01',),
    ),
    _rules(
        'R-3A-02',
        'RED_FLAG does not loosen RED_RED',
        'race to `RED_FLAG`, unless it is in `RED_RED`',
        'RED_FLAG is commanded after ALL_KILL.',
        judge.unchanged('stop/flag'),
        ('R-4B-01',),
    ),
    _rules(
        'R-3A-03',
        'RED_FLAG does not loosen a kart that is held in RED_RED',
        'A hold can only get stricter.',
        'RED_RED is commanded for one kart in GREEN_GREEN, then RED_FLAG for the race.',
        judge.stays_red('held/flag', ONE),
        ('R-3A-02', 'R-4B-03'),
    ),
    proposal(
        'R-3B-01',
        'no GREEN_GREEN without acknowledgements',
        _UNTIL,
        'GREEN_GREEN is commanded after GRID_ACTIVE; no kart has acknowledged.',
        judge.no_green('grid/silent'),
    ),
    wire(
        'R-3B-02',
        'no GREEN_GREEN on what a kart said before GRID_ACTIVE',
        'An acknowledgement counts if it is the state that the kart is being sent',
        'One kart says GRID_ACTIVE in IN_GARAGE and not after; the other acknowledges.',
        judge.no_green('grid/early'),
        ('R-3B-01',),
    ),
    _rules(
        'R-3B-03',
        'no GREEN_GREEN while a kart of the race is away',
        'none held or contested, and each has acknowledged this `GRID_ACTIVE`',
        'Both acknowledge, one closes its connection, then GREEN_GREEN is commanded.',
        judge.no_green('lost/green'),
        ('R-3B-01',),
    ),
    wire(
        'R-3B-04',
        'no GREEN_GREEN on an acknowledgement of an earlier connection',
        'A kart that comes back after a loss has to acknowledge again.',
        'The kart is back and says nothing; GREEN_GREEN is commanded.',
        judge.no_green('lost/back'),
        ('R-3B-01', 'R-3B-02', 'R-3B-03'),
    ),
    wire(
        'R-3B-05',
        'no GREEN_GREEN on an acknowledgement of an earlier GRID_ACTIVE',
        'An acknowledgement is valid until the next command.',
        'After a race, GRID_ACTIVE comes again; no kart acknowledges it.',
        judge.no_green('again/silent'),
        ('R-3B-01',),
        after=('race',),
    ),
    proposal(
        'R-3B-06',
        'GRID_ACTIVE to the karts of the race',
        'the RCS will broadcast *\\$GRID_ACTIVE*; until all In Race karts have Acknowledged the '
        'message.',
        'GRID_ACTIVE is commanded in IN_GARAGE.',
        judge.reaches('race/order', 'reach', GRID_ACTIVE, ONE, TWO),
    ),
    proposal(
        'R-3B-07',
        'GREEN_GREEN once all have acknowledged',
        _UNTIL,
        'GREEN_GREEN is commanded when both karts have acknowledged GRID_ACTIVE.',
        judge.reaches('race/started', 'reach', GREEN_GREEN, ONE, TWO),
        ('R-3B-06',),
    ),
    wire(
        'R-3B-08',
        'no GREEN_GREEN on a word that was begun before GRID_ACTIVE',
        'An acknowledgement counts if it is the state that the kart is being sent',
        'One kart says the first half of $GRID_ACTIVE; in IN_GARAGE and the other half in '
        'GRID_ACTIVE; the other acknowledges.',
        judge.no_green('halves/green'),
        ('R-3B-01', 'R-3B-02'),
    ),
    proposal(
        'R-3C-01',
        'FINISH: RED_FLAG to that kart alone',
        'The RCS will send the kart a *\\$RED_FLAG*; command as described in the RCS Software '
        'description.',
        'One kart of the race is marked as finished.',
        judge.reaches('race/finish_one', 'finish', RED_FLAG, ONE, not_to=TWO),
    ),
    proposal(
        'R-3C-02',
        'FINISH: the later place has another delay',
        'The set amount of time will depend on what place the kart finished to stagger karts '
        'and avoid a crash at the finish line.',
        'Then the other kart is marked as finished.',
        judge.staggers,
        ('R-3C-01',),
    ),
    proposal(
        'R-3C-03',
        'RACE_OVER: RED_RED to the race',
        'The RCS will then broadcast the *\\$RED_RED*; command until all participating karts '
        'have Acknowledged.',
        'RACE_OVER is commanded once both karts have their RED_FLAG.',
        judge.reaches('race/over', 'reach', RED_RED, ONE, TWO),
    ),
    proposal(
        'R-3C-04',
        'no IN_GARAGE before all have acknowledged RED_RED',
        _RELEASE,
        'IN_GARAGE is commanded when one of two karts has acknowledged.',
        judge.unchanged('race/unacknowledged'),
        ('R-3C-03',),
    ),
    proposal(
        'R-3C-05',
        'IN_GARAGE once all have acknowledged RED_RED',
        _RELEASE,
        'IN_GARAGE is commanded when both have acknowledged.',
        judge.reaches('race/released', 'reach', IN_GARAGE, ONE, TWO),
        ('R-3C-03', 'R-3C-04'),
    ),
    wire(
        'R-3E-01',
        'a kart that comes back in IN_GARAGE: IN_GARAGE',
        '`$IN_GARAGE;` when the kart connects, if no race is under way and the kart is not held.',
        'A kart closes its connection in IN_GARAGE and connects again.',
        judge.is_sent_only('connect/back', {IN_GARAGE}, TWO),
        ('R-3A-01',),
    ),
    wire(
        'R-3E-02',
        'a kart that comes back in GRID_ACTIVE: not GREEN_GREEN',
        'A kart of a race under way is sent what the rules say',
        'A kart closes its connection in GRID_ACTIVE and connects again.',
        judge.is_sent_only('lost/returned', {*RaceState} - {GREEN_GREEN}, ONE),
        ('R-3B-03',),
    ),
    proposal(
        'R-3E-03',
        'a kart that comes back in GREEN_GREEN: RED_RED',
        DISCONNECTED,
        'The connection of a kart is reset in GREEN_GREEN; it connects again.',
        judge.is_sent_only('again/back', {RED_RED}, TWO),
    ),
    proposal(
        'R-3E-04',
        'a kart that comes back in RED_FLAG: RED_RED',
        DISCONNECTED,
        'A kart closes its connection in RED_FLAG and connects again.',
        judge.is_sent_only('flag/back', {RED_RED}, ONE),
        ('R-4B-02',),
    ),
    proposal(
        'R-3E-05',
        'a kart that comes back in RED_RED: RED_RED',
        DISCONNECTED,
        'After ALL_KILL, a kart closes its connection and connects again.',
        judge.is_sent_only('stop/back', {RED_RED}, ONE),
        ('R-4B-01',),
    ),
    proposal(
        'R-3E-06',
        'a kart that vanished comes back: RED_RED',
        DISCONNECTED,
        'The kart that vanished in GREEN_GREEN connects again.',
        judge.is_sent_only('vanish/back', {RED_RED}, ONE),
        ('R-3E-03', 'R-4D-01'),
    ),
    _rules(
        'R-3E-07',
        'a kart that was away during a command comes back: RED_RED',
        'every kart of the roster, in `RED_RED`, also those that are not connected',
        'ALL_KILL is commanded while a kart of the race is away; it connects again.',
        judge.is_sent_only('absent/back', {RED_RED}, ONE, let_in=True),
        ('R-3E-05',),
    ),
    proposal(
        'R-3F-01',
        'a kart outside the race: IN_GARAGE, or RED_RED once it is stopped',
        'Any Kart that connects to the RCS that is not in the race will be kept in the IN '
        'GARAGE state and will only receive the message `$IN_GARAGE`;',
        'A kart that is not in the race is connected during the whole inspection.',
        judge.keeps_in_garage,
    ),
    proposal(
        'R-4A-01',
        'takes the connection of each kart',
        'All karts will be assigned a static IP address corresponding to their team number for '
        'use with the RCS.',
        'Each kart connects from its own address.',
        judge.connects,
    ),
    wire(
        'R-4A-02',
        'sends nothing to an unknown address, and closes its connection',
        'Race control closes a connection from any other address at once, without a frame',
        'Somebody connects from an address that is no kart.',
        judge.refuses_strangers,
    ),
    wire(
        'R-4A-03',
        'a second connection of a kart takes the place of the first',
        'A second one from the same address takes the place of the first.',
        'A kart connects a second time in IN_GARAGE and keeps the first connection.',
        judge.replaces,
    ),
    proposal(
        'R-4B-01',
        'ALL_KILL reaches every kart, in the race or not',
        'Send *\\$RED_RED*; command to All karts',
        'ALL_KILL is commanded in GREEN_GREEN.',
        judge.reaches('stop/all_kill', 'all_kill', RED_RED, ONE, TWO, OUT),
    ),
    proposal(
        'R-4B-02',
        'RED_FLAG reaches the race',
        'Sends *\\$RED_FLAG*; to In Race karts.',
        'RED_FLAG is commanded in GREEN_GREEN.',
        judge.reaches('flag/flag', 'reach', RED_FLAG, ONE, TWO),
    ),
    proposal(
        'R-4B-03',
        'RED_RED to one kart reaches it, and it alone',
        'Send *\\$RED_RED*; to the Individual kart',
        'RED_RED is commanded for one kart in GREEN_GREEN.',
        judge.reaches('again/one', 'reach', RED_RED, ONE, not_to=TWO),
    ),
    proposal(
        'R-4B-04',
        'a command that is not possible changes nothing on the wire',
        'Requires GRID_ACTIVE to be the last button pressed and every kart In Race to send the '
        '\\$GRID_ACTIVE; message to the RCS.',
        'GREEN_GREEN in IN_GARAGE; GRID_ACTIVE and IN_GARAGE in a race; GRID_ACTIVE and '
        'GREEN_GREEN after ALL_KILL.',
        judge.unchanged(
            'connect/green', 'race/grid_again', 'race/garage_in_race', 'stop/grid', 'stop/green'
        ),
        ('R-3A-02', 'R-4B-01'),
    ),
    _rules(
        'R-4B-05',
        'ALL_KILL is for karts that are away, too',
        'every kart of the roster, in `RED_RED`, also those that are not connected',
        'ALL_KILL is commanded while a kart that is not in the race is away; it connects again.',
        judge.is_sent_only('absent/back', {RED_RED}, OUT),
        ('R-3E-05', 'R-4B-01'),
    ),
    proposal(
        'R-4B-06',
        'no GREEN_GREEN unless GRID_ACTIVE was the last button pressed',
        'Requires GRID_ACTIVE to be the last button pressed',
        'Both karts acknowledge GRID_ACTIVE; RED_RED is commanded for the kart outside the '
        'race, then GREEN_GREEN.',
        judge.no_green('last/green'),
        ('R-3B-01',),
    ),
    proposal(
        'R-4C-01',
        'sends at least 10 frames a second',
        'The RCS will send the race state at least 10 times per second.',
        'All frames are counted, on each connection of 1 s or more.',
        judge.sends_often,
    ),
    proposal(
        'R-4C-02',
        'no long gap between two frames',
        'The RCS will send the race state at least 10 times per second.',
        'The time between two frames is measured, on each connection.',
        judge.leaves_no_gap,
        ('R-4C-01',),
    ),
    proposal(
        'R-4C-03',
        'sends whole, correct frames only',
        'Each message will begin with a start character (a dollar sign: \\$) followed by a '
        'character byte array of the State name and finished with an end character (a '
        'semi-colon: ;)',
        'All bytes are read, during the whole inspection.',
        says_frames,
    ),
    proposal(
        'R-4D-01',
        'notices that a kart has vanished (half-open connection)',
        'The RCS will continuously determine if a kart is connected and will follow the '
        'Disconnected protocol if the connection is lost.',
        'In GREEN_GREEN, the computer of one kart stops answering, as without WiFi.',
        judge.notices,
    ),
)

RCS_BY_NAME = {clause.name: clause for clause in RCS}
