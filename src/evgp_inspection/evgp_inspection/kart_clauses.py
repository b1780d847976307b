# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The clauses of a kart: what can be seen of it from outside, one row each."""

from __future__ import annotations

from evgp_inspection import kart_judges as judge
from evgp_inspection.kart_judges import GREEN_GREEN, GRID_ACTIVE, RED_FLAG, RED_RED
from evgp_inspection.oracle import Law
from evgp_inspection.verdicts import Clause, DISCONNECTED, proposal, says_frames, wire

KILLING_STEPS = ('bridge', 'stack')
DRIVING_STEPS = (
    *('race', 'red', 'flag_red', 'early', 'silence', 'noise'),
    *('fin', 'reset', 'half', 'cut', 'restart', 'rounds', 'long', *KILLING_STEPS),
)
KART_STEPS = (
    *('connect', 'first_stop', 'alone', 'pieces', 'ready', 'again', 'backlog'),
    *(*DRIVING_STEPS[:-2], 'half_open', 'dwell', *KILLING_STEPS),
)
"""The steps of `inspect_kart`, in their order; in those that are not `DRIVING_STEPS`, the kart
stands. In the last two, a part of the kart's program is ended by force."""


_WHEN_TRUE = (
    'Say it when it is **true**, not when you read it: on an acknowledged stop, people walk '
    'onto the track.'
)
_PIECES = (
    'TCP does not keep frames together: one read may return half a frame, the next one ten frames.'
)

PHASES: tuple[Clause, ...] = (
    proposal(
        'K-3A-01',
        'IN_GARAGE: stands still by itself',
        'IN_GARAGE: The kart is not currently driving in the Race.',
        'IN_GARAGE is sent when the kart connects, and again after a race.',
        judge.stands('connect/garage', 'race/after', 'dwell/IN_GARAGE'),
    ),
    proposal(
        'K-3A-02',
        'GRID_ACTIVE: acknowledged when ready',
        'When ready to race, karts must reply with $GRID_ACTIVE; message to the RCS.',
        'GRID_ACTIVE is sent after IN_GARAGE. $READY; counts, too.',
        judge.acknowledges(GRID_ACTIVE, 'grid', 'ready/grid'),
    ),
    wire(
        'K-3A-03',
        'GRID_ACTIVE: stands still',
        'stands, gets ready',
        'GRID_ACTIVE is sent, and goes on after the kart has acknowledged it.',
        judge.stands('ready/grid', 'dwell/GRID_ACTIVE'),
    ),
    proposal(
        'K-3A-04',
        'GREEN_GREEN: acknowledged',
        'The kart should acknowledge the first $GREEN_GREEN; command.',
        'GREEN_GREEN is sent after an acknowledged GRID_ACTIVE.',
        judge.acknowledges(GREEN_GREEN, 'green', 'race/green'),
    ),
    proposal(
        'K-3A-05',
        'GREEN_GREEN: drives when it says so',
        'Upon receiving the $GREEN_GREEN; command, a kart should begin driving within 30 seconds',
        'The kart drives, and its acknowledgement is compared with its wheels.',
        judge.drives,
    ),
    proposal(
        'K-3A-06',
        'RED_FLAG: acknowledged once it stands',
        'The kart should remain stopped once it has stopped moving and send a $RED_FLAG; '
        'message to the RCS.',
        'RED_FLAG is sent while the kart drives.',
        judge.acknowledges(RED_FLAG, 'red_flag', 'race/red_flag'),
    ),
    wire(
        'K-3A-07',
        'RED_FLAG: not acknowledged before it stands',
        _WHEN_TRUE,
        'The RED_FLAG acknowledgement of a driving kart is compared with its wheels.',
        judge.says_it_when_true(RED_FLAG, 'race', 'red_flag'),
    ),
    proposal(
        'K-3A-08',
        'RED_FLAG: remains stopped',
        'The kart should remain stopped once it has stopped moving',
        'RED_FLAG goes on after the kart has acknowledged it.',
        judge.stands('race/stays', needs=judge.has_driven('race')),
        ('K-3A-07',),
    ),
    proposal(
        'K-3A-09',
        'RED_RED: acknowledged once it stands',
        'Karts should reply with a $RED_RED; message after coming to a complete stop (Nominal '
        'speed of 0.0).',
        'RED_RED is sent to a kart that stands, to one that drives and was sent GREEN_GREEN 100 '
        'times a second, and after each check.',
        judge.stops_when_told,
    ),
    wire(
        'K-3A-10',
        'RED_RED: not acknowledged before it stands',
        _WHEN_TRUE,
        'The RED_RED acknowledgement of a driving kart is compared with its wheels.',
        judge.says_it_when_true(RED_RED, 'red', 'red'),
    ),
    wire(
        'K-3A-11',
        'GRID_ACTIVE: acknowledged every time',
        'An acknowledgement is valid until the next command.',
        'GRID_ACTIVE is sent a second time, after RED_RED and IN_GARAGE.',
        judge.acknowledges(GRID_ACTIVE, 'grid', 'again/grid'),
        ('K-3A-02',),
    ),
    wire(
        'K-3A-12',
        'RED_RED while RED_FLAG brakes: not acknowledged before it stands',
        _WHEN_TRUE,
        'RED_RED is sent to a kart that brakes for RED_FLAG; its acknowledgement is compared '
        'with its wheels.',
        judge.says_it_when_true(RED_RED, 'flag_red', 'red'),
        ('K-3A-07', 'K-3A-10'),
    ),
    proposal(
        'K-3A-13',
        'RED_RED: brakes harder than for RED_FLAG',
        'RED_RED: The kart must immediately stop as quickly as possible.',
        'The stops for RED_FLAG, for RED_RED, and for RED_RED while RED_FLAG brakes are compared.',
        judge.brakes_harder,
        ('K-3A-07', 'K-3A-10'),
    ),
    proposal(
        'K-3A-14',
        'RED_RED right after GREEN_GREEN: stops',
        'RED_RED: The kart must immediately stop as quickly as possible.',
        'RED_RED is sent 0.15 s after GREEN_GREEN, as a kart may only be starting to move.',
        judge.stops_early,
        ('K-3A-10',),
    ),
    proposal(
        'K-3A-15',
        'RED_RED and RED_FLAG: remains stopped',
        'The kart should remain stopped once it has stopped moving',
        'RED_RED and RED_FLAG are sent for a long time to a kart that stands.',
        judge.stands('dwell/RED_RED', 'dwell/RED_FLAG'),
        ('K-3A-08',),
    ),
    wire(
        'K-3B-01',
        'GREEN_GREEN without GRID_ACTIVE: stands',
        'any other `GREEN_GREEN`',
        'GREEN_GREEN is sent after IN_GARAGE, without GRID_ACTIVE.',
        judge.stands('alone/green'),
    ),
    wire(
        'K-3B-02',
        'GREEN_GREEN after RED_RED: stands',
        '**Nothing may come between `GRID_ACTIVE` and `GREEN_GREEN`:**',
        'GRID_ACTIVE is acknowledged; then RED_RED is sent, then GREEN_GREEN.',
        judge.stands('again/green', needs=judge.has_acknowledged(GRID_ACTIVE, 'again/grid')),
        ('K-3B-01',),
    ),
    wire(
        'K-3B-03',
        'GREEN_GREEN before the GRID_ACTIVE acknowledgement: stands',
        '`GREEN_GREEN`, after a `GRID_ACTIVE` that it acknowledged **on this connection**',
        'One frame of GRID_ACTIVE and GREEN_GREEN are sent in one piece.',
        judge.waits_for_its_own_word,
        ('K-3B-01', 'K-3B-02'),
    ),
    wire(
        'K-3B-04',
        'GREEN_GREEN after RED_FLAG: stands',
        '**Nothing may come between `GRID_ACTIVE` and `GREEN_GREEN`:**',
        'GREEN_GREEN is sent to a kart that has acknowledged RED_FLAG.',
        judge.stands('race/flag_green', needs=judge.has_driven('race')),
        ('K-3A-08', 'K-3B-01', 'K-3B-02'),
    ),
    proposal(
        'K-3C-01',
        'connection closed: stops',
        'For safety, all karts must default to an ESTOP or stopped state upon disconnecting '
        'from the RCS to prevent the kart from automatically starting up.',
        'The connection is closed (FIN) while the kart drives.',
        judge.stops('fin'),
    ),
    wire(
        'K-3E-01',
        'silence: stops',
        'nothing for **1 s**, or the connection is gone',
        'Nothing more is sent while the kart drives; the connection stays open.',
        judge.stops('silence', silent=True),
    ),
    proposal(
        'K-3E-02',
        'after silence: GREEN_GREEN does not start it',
        DISCONNECTED,
        'After silence, GREEN_GREEN is sent again, without GRID_ACTIVE.',
        judge.stands('silence/back', needs=judge.has_driven('silence')),
        ('K-3B-01', 'K-3B-02', 'K-3E-01'),
    ),
    wire(
        'K-3E-03',
        'connection reset: stops',
        'nothing for **1 s**, or the connection is gone',
        'The connection is reset (RST) while the kart drives.',
        judge.stops('reset'),
    ),
    wire(
        'K-3E-04',
        'connection half-closed: stops',
        'nothing for **1 s**, or the connection is gone',
        'Race control closes its half of the connection while the kart drives.',
        judge.stops('half'),
        ('K-3C-01',),
    ),
    wire(
        'K-3E-05',
        'after a lost connection: GREEN_GREEN does not start it',
        'a new connection, a kart that gets `GREEN_GREEN` stands until it has acknowledged '
        'another `GRID_ACTIVE`.',
        'When the kart is back after FIN, RST and half-close, GREEN_GREEN is sent.',
        judge.stands(
            'fin/back', 'reset/back', 'half/back', needs=judge.has_driven('fin', 'reset', 'half')
        ),
        ('K-3B-01', 'K-3B-02', 'K-3C-01', 'K-3E-03', 'K-3E-04'),
    ),
    wire(
        'K-3E-06',
        'race control restarted in mid-race: never moves by itself',
        'after any other state, or a new connection, a kart that gets `GREEN_GREEN` stands '
        'until it has acknowledged another `GRID_ACTIVE`.',
        'Race control goes away while the kart drives, refuses connections, then comes back '
        'with GREEN_GREEN.',
        judge.stands('restart/away', 'restart/back', needs=judge.has_driven('restart')),
        ('K-3B-01', 'K-3B-02', 'K-3C-01', 'K-3E-05'),
    ),
    wire(
        'K-3E-07',
        'nothing but malformed bytes: stops',
        'For a kart, malformed bytes are the same as silence: after 1 s without a whole, '
        'correct frame, it stops.',
        'Only malformed frames are sent while the kart drives.',
        judge.stops('noise', silent=True),
        ('K-3E-01', 'K-4C-07', 'K-4C-08'),
    ),
    wire(
        'K-3E-08',
        'RED_RED on a new connection: not acknowledged before it stands',
        _WHEN_TRUE,
        'The connection is reset while the kart drives, and RED_RED is sent on the next one; '
        'its acknowledgement is compared with its wheels.',
        judge.says_it_when_true(RED_RED, 'cut', 'lost', back=True),
        ('K-3A-10', 'K-3E-03', 'K-4C-12', 'K-4D-02'),
    ),
    proposal(
        'K-3E-09',
        'its program for race control is killed: stops',
        DISCONNECTED,
        'The program that is connected to race control (our bridge) is killed while the kart '
        'drives.',
        judge.stops_when_killed('bridge'),
    ),
    wire(
        'K-3E-10',
        'its program that drives is killed: stops',
        'It must also brake if this program ends.',
        'The program that commands the motors (the stack) is killed while the kart drives.',
        judge.stops_when_killed('stack'),
    ),
    proposal(
        'K-4A-01',
        'connects',
        'The kart must be able to connect to and send/receive messages to the RCS through the '
        'Transmission Control Protocol (TCP) over a WiFi network.',
        'The inspection listens in place of race control.',
        judge.connects('connect', 'wait', 'connect'),
    ),
    wire(
        'K-4A-02',
        'one connection at a time',
        'One connection per kart.',
        'The connections are watched during the whole inspection.',
        judge.has_one_connection,
        ('K-4D-03',),
    ),
    proposal(
        'K-4C-01',
        'says whole, correct frames only',
        'Each message will begin with a start character (a dollar sign: $) followed by a '
        'character byte array of the State name and finished with an end character (a '
        'semi-colon: ;)',
        'All that the kart says is read, during the whole inspection.',
        says_frames,
    ),
    wire(
        'K-4C-02',
        'frames cut into single bytes',
        _PIECES,
        'RED_RED is sent byte by byte to a kart that stands.',
        judge.acknowledges(RED_RED, 'red_red', 'pieces/bytes', link_stays=True),
        ('K-4C-05',),
    ),
    wire(
        'K-4C-03',
        'many frames in one piece',
        _PIECES,
        'RED_RED is sent to a kart that stands, five frames in a piece, cut inside a frame.',
        judge.acknowledges(RED_RED, 'red_red', 'pieces/many', link_stays=True),
        ('K-4C-02', 'K-4C-05'),
    ),
    wire(
        'K-4C-04',
        'frames whose second half is late',
        _PIECES,
        'RED_RED is sent to a kart that stands, each frame in two halves, 0.07 s apart.',
        judge.acknowledges(RED_RED, 'red_red', 'pieces/late', link_stays=True),
        ('K-4C-02', 'K-4C-05'),
    ),
    proposal(
        'K-4C-05',
        '10 frames a second are enough',
        'The RCS will send the race state at least 10 times per second.',
        'RED_RED is sent 10 times a second to a kart that stands.',
        judge.acknowledges(RED_RED, 'red_red', 'pieces/slow', link_stays=True),
    ),
    wire(
        'K-4C-06',
        'sees a stop in time, however many frames came before it',
        '**Read all there is, and obey the last frame**, not those before it.',
        'IN_GARAGE is sent 100 times a second, then 400 frames at once, then RED_RED. A kart '
        'that fails is not made to drive.',
        judge.acknowledges(RED_RED, 'red_red', 'backlog/red'),
        ('K-3A-09',),
    ),
    wire(
        'K-4C-07',
        'obeys nothing that only looks like GREEN_GREEN',
        'a name that is not a state (`$GREEN;`, `$red_red;`)',
        'A kart that has acknowledged GRID_ACTIVE is sent malformed frames that look like '
        'GREEN_GREEN.',
        judge.stands('ready/malformed', needs=judge.has_acknowledged(GRID_ACTIVE, 'ready/grid')),
        ('K-3A-03',),
    ),
    wire(
        'K-4C-08',
        'survives malformed bytes',
        'malformed; skips to the next `$`',
        'The same malformed bytes between correct frames; then RED_RED.',
        judge.survives,
        ('K-4C-05', 'K-4C-07'),
    ),
    wire(
        'K-4C-09',
        'says only what it is being sent',
        'To acknowledge, say the same frame back, once or with every frame.',
        'All that the kart says is compared with what it is sent.',
        judge.says_what_it_is_sent,
        ('K-3A-14', 'K-4C-06', 'K-4C-07', 'K-4C-12'),
    ),
    wire(
        'K-4C-10',
        'does not flood race control',
        'reads about 4096 bytes a beat at most; accepts no acknowledgement from it during the '
        'flood and for 1 s after; drops it after 2 s.',
        'The bytes that the kart says are counted during the whole inspection.',
        judge.does_not_flood,
    ),
    wire(
        'K-4C-11',
        'nothing sent yet: says nothing, stands',
        'as `RED_RED`: it stops, or stays where it is',
        'Nothing is sent for a moment on the first connection.',
        judge.says_nothing_first,
    ),
    wire(
        'K-4C-12',
        'says nothing old on a new connection',
        'A kart that comes back after a loss has to acknowledge again.',
        'Nothing is sent for a moment on the connection after FIN.',
        judge.says_nothing_old,
        ('K-4C-11',),
    ),
    wire(
        'K-4D-01',
        'connects again after FIN',
        'Then connect again, and wait half a second between attempts',
        'The connection is closed while the kart drives.',
        judge.connects('fin'),
    ),
    wire(
        'K-4D-02',
        'connects again after RST',
        'Then connect again, and wait half a second between attempts',
        'The connection is reset while the kart drives.',
        judge.connects('reset'),
    ),
    wire(
        'K-4D-03',
        'connects again after a half-close',
        'Then connect again, and wait half a second between attempts',
        'Race control closes its half of the connection while the kart drives.',
        judge.connects('half'),
        ('K-4D-01',),
    ),
    wire(
        'K-4D-04',
        'connects again after silence (half-open connection)',
        'nothing for **1 s**, or the connection is gone',
        'Nothing is sent to a kart that stands; the connection stays open, as when race '
        "control's computer has lost its power.",
        judge.connects('half_open'),
    ),
    wire(
        'K-4D-05',
        'connects again when race control was restarted',
        'Then connect again, and wait half a second between attempts',
        'Connections are refused for a while, then accepted again; the time counts from then.',
        judge.connects('restart', 'back'),
        ('K-4D-01',),
    ),
    wire(
        'K-4D-06',
        'acknowledges again on a new connection',
        'A kart that comes back after a loss has to acknowledge again.',
        'RED_RED is sent on the connection after FIN.',
        judge.acknowledges_again,
    ),
)

_OTHERS = tuple(clause.name for clause in PHASES)

ALWAYS: tuple[Clause, ...] = (
    proposal(
        'K-3A-16',
        'at any moment: stands where it must stand',
        'The kart should remain stopped once it has stopped moving',
        'Every speed of odometry is compared with what the kart was sent at that moment.',
        judge.keeps(Law.STAND),
        (*_OTHERS, 'K-3A-17', 'K-3A-18'),
    ),
    proposal(
        'K-3A-17',
        'at any moment: RED_FLAG is obeyed',
        'RED_FLAG: The kart should begin slowing down to a stop while continuing to steer to '
        'avoid obstacles.',
        'RED_FLAG is sent at random times after GREEN_GREEN, too.',
        judge.keeps(Law.FLAG),
        (*_OTHERS, 'K-3A-18'),
    ),
    proposal(
        'K-3A-18',
        'at any moment: RED_RED is obeyed',
        'RED_RED: The kart must immediately stop as quickly as possible.',
        'RED_RED is sent at random times after GREEN_GREEN, and after a long drive, too.',
        judge.keeps(Law.RED),
        _OTHERS,
    ),
    proposal(
        'K-3E-11',
        'at any moment: a lost connection is obeyed as RED_RED',
        DISCONNECTED,
        'The connection is lost in every state, also while RED_FLAG brakes.',
        judge.keeps(Law.LOST),
        (*_OTHERS, 'K-3A-18'),
    ),
)
"""The clauses that the whole inspection shows, whatever its steps were about."""

KART = tuple(sorted((*PHASES, *ALWAYS), key=lambda clause: clause.name))

BY_STATEMENT = (
    "§2.B: with the MSR's remote off, the motor has no power and the kart obeys RED_RED",
    "§2.C: the team's remote stops the kart and can do nothing else during a race; releasing it "
    'starts nothing',
    '§3.A: on RED_FLAG the kart slows down gently, steers, and pulls to the inside of the track',
)
"""What nobody sees on stands: the team states it, the inspector has it shown and ticks it."""

BY_NAME = {clause.name: clause for clause in KART}
