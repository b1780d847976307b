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
The clauses: what can be seen of a kart from outside, one row each.

Everything that names, selects, explains, judges or documents a check goes by these rows. An
identifier is the letter of what is inspected (K: a kart), the § of the proposal, and a number.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import dataclasses

PROPOSAL = 'proposal'
WIRE = 'docs/wire.md'


@dataclasses.dataclass(frozen=True)
class Clause:
    """
    One clause, and how it is checked.

    :ivar name: the identifier, such as ``K-3A-07``.
    :ivar title: what a good kart does, in a few words.
    :ivar source: where the sentence is: ``PROPOSAL`` or ``WIRE``.
    :ivar section: the § of the proposal that the clause belongs to.
    :ivar sentence: the sentence, as it is in the source.
    :ivar done: what the inspection does.
    :ivar judged: what makes the verdict.
    :ivar steps: the steps that show it; empty: the whole inspection does.
    :ivar limit: the name of its limit in `Limits`; empty: it has none.
    :ivar unless: clauses whose failure is the cause of this one's: it is not judged then.
    :ivar starred: without it no inspection is passed: it is about whether the wheels turn or
        stand, and not judged where nobody and nothing sees them.
    """

    name: str
    title: str
    source: str
    section: str
    sentence: str
    done: str
    judged: str
    steps: tuple[str, ...]
    limit: str = ''
    unless: tuple[str, ...] = ()
    starred: bool = False


STANDING_STEPS = ('connect', 'standing', 'alone', 'pieces', 'ready', 'again', 'backlog')
KILLING_STEPS = ('bridge', 'stack')
DRIVING_STEPS = (
    *('race', 'red', 'flag_red', 'early', 'silence', 'noise'),
    *('fin', 'reset', 'half', 'cut', 'restart', *KILLING_STEPS),
)
KART_STEPS = (*STANDING_STEPS, *DRIVING_STEPS[:-2], 'half_open', *KILLING_STEPS)
"""The steps of `inspect_kart`, in their order; in those that are not `DRIVING_STEPS`, the kart
stands. In the last two, a part of the kart's program is ended by force."""

_MOVES = 'Fail: it says GREEN_GREEN, or the wheels turn.'
_TURN_AFTER = (
    'Fail: the wheels turn after it, or it comes faster than a kart at speed can stop '
    '(fastest_stop).'
)
_STOPS = 'Fail: the wheels still turn when red_red has passed, or begin to slow down too late.'

KART: tuple[Clause, ...] = (
    Clause(
        'K-3A-01',
        'IN_GARAGE: stands still by itself',
        PROPOSAL,
        '§3.A',
        'IN_GARAGE: The kart is not currently driving in the Race.',
        'IN_GARAGE is sent when the kart connects, and again after a race.',
        _MOVES,
        ('connect', 'race'),
        starred=True,
    ),
    Clause(
        'K-3A-02',
        'GRID_ACTIVE: acknowledged when ready',
        PROPOSAL,
        '§3.A',
        'When ready to race, karts must reply with $GRID_ACTIVE; message to the RCS.',
        'GRID_ACTIVE is sent after IN_GARAGE.',
        'Time from the order to $GRID_ACTIVE; (or $READY;).',
        ('ready',),
        'grid',
    ),
    Clause(
        'K-3A-03',
        'GRID_ACTIVE: stands still',
        WIRE,
        '§3.A',
        'stands, gets ready',
        'GRID_ACTIVE is sent, and goes on after the kart has acknowledged it.',
        _MOVES,
        ('ready',),
        starred=True,
    ),
    Clause(
        'K-3A-04',
        'GREEN_GREEN: acknowledged',
        PROPOSAL,
        '§3.A',
        'The kart should acknowledge the first $GREEN_GREEN; command.',
        'GREEN_GREEN is sent after an acknowledged GRID_ACTIVE.',
        'Time from the order to $GREEN_GREEN;.',
        ('race',),
        'green',
    ),
    Clause(
        'K-3A-05',
        'GREEN_GREEN: drives when it says so',
        PROPOSAL,
        '§3.A',
        'Upon receiving the $GREEN_GREEN; command, a kart should begin driving within 30 seconds',
        'The kart drives, and its acknowledgement is compared with its wheels.',
        'Fail: the wheels stand still when it says $GREEN_GREEN;.',
        ('race',),
        'green',
        starred=True,
    ),
    Clause(
        'K-3A-06',
        'RED_FLAG: acknowledged once it stands',
        PROPOSAL,
        '§3.A',
        'The kart should remain stopped once it has stopped moving and send a $RED_FLAG; message '
        'to the RCS.',
        'RED_FLAG is sent while the kart drives.',
        'Time from the order to $RED_FLAG;.',
        ('race',),
        'red_flag',
    ),
    Clause(
        'K-3A-07',
        'RED_FLAG: not acknowledged before it stands',
        WIRE,
        '§3.A',
        'Say it when it is **true**, not when you read it: on an acknowledged stop, people walk '
        'onto the track.',
        'The RED_FLAG acknowledgement of a driving kart is compared with its wheels.',
        _TURN_AFTER,
        ('race',),
        starred=True,
    ),
    Clause(
        'K-3A-08',
        'RED_FLAG: remains stopped',
        PROPOSAL,
        '§3.A',
        'The kart should remain stopped once it has stopped moving',
        'RED_FLAG goes on after the kart has acknowledged it.',
        _MOVES,
        ('race',),
        unless=('K-3A-07',),
        starred=True,
    ),
    Clause(
        'K-3A-09',
        'RED_RED: acknowledged once it stands',
        PROPOSAL,
        '§3.A',
        'Karts should reply with a $RED_RED; message after coming to a complete stop (Nominal '
        'speed of 0.0).',
        'RED_RED is sent to a kart that stands, to one that drives, and after each check.',
        'The longest time from the order to $RED_RED;.',
        ('standing', 'race', 'red'),
        'red_red',
    ),
    Clause(
        'K-3A-10',
        'RED_RED: not acknowledged before it stands',
        WIRE,
        '§3.A',
        'Say it when it is **true**, not when you read it: on an acknowledged stop, people walk '
        'onto the track.',
        'The RED_RED acknowledgement of a driving kart is compared with its wheels.',
        _TURN_AFTER,
        ('red',),
        starred=True,
    ),
    Clause(
        'K-3A-11',
        'GRID_ACTIVE: acknowledged every time',
        WIRE,
        '§3.A',
        'An acknowledgement is valid until the next command.',
        'GRID_ACTIVE is sent a second time, after RED_RED and IN_GARAGE.',
        'Time from the order to $GRID_ACTIVE;.',
        ('again',),
        'grid',
        ('K-3A-02',),
    ),
    Clause(
        'K-3A-12',
        'RED_RED while RED_FLAG brakes: not acknowledged before it stands',
        WIRE,
        '§3.A',
        'Say it when it is **true**, not when you read it: on an acknowledged stop, people walk '
        'onto the track.',
        'RED_RED is sent to a kart that brakes for RED_FLAG; its acknowledgement is compared with '
        'its wheels.',
        _TURN_AFTER,
        ('flag_red',),
        unless=('K-3A-07', 'K-3A-10'),
        starred=True,
    ),
    Clause(
        'K-3A-13',
        'RED_RED: brakes harder than for RED_FLAG',
        PROPOSAL,
        '§3.A',
        'RED_RED: The kart must immediately stop as quickly as possible.',
        'The stops for RED_FLAG, for RED_RED, and for RED_RED while RED_FLAG brakes are compared.',
        'Fail: for RED_RED it takes more than a part (harder) of the time that it takes for '
        'RED_FLAG. Without odometry, the times to its words count.',
        ('race', 'red', 'flag_red'),
        unless=('K-3A-07', 'K-3A-10'),
    ),
    Clause(
        'K-3A-14',
        'RED_RED right after GREEN_GREEN: stops',
        PROPOSAL,
        '§3.A',
        'RED_RED: The kart must immediately stop as quickly as possible.',
        'RED_RED is sent 0.15 s after GREEN_GREEN.',
        _STOPS,
        ('early',),
        'red_red',
        starred=True,
    ),
    Clause(
        'K-3B-01',
        'GREEN_GREEN without GRID_ACTIVE: stands',
        WIRE,
        '§3.B',
        'any other `GREEN_GREEN`',
        'GREEN_GREEN is sent after IN_GARAGE, without GRID_ACTIVE.',
        _MOVES,
        ('alone',),
        starred=True,
    ),
    Clause(
        'K-3B-02',
        'GREEN_GREEN after RED_RED: stands',
        WIRE,
        '§3.B',
        '**Nothing may come between `GRID_ACTIVE` and `GREEN_GREEN`:**',
        'GRID_ACTIVE is acknowledged; then RED_RED is sent, then GREEN_GREEN.',
        _MOVES,
        ('again',),
        unless=('K-3B-01',),
        starred=True,
    ),
    Clause(
        'K-3B-03',
        'GREEN_GREEN before the GRID_ACTIVE acknowledgement: stands',
        WIRE,
        '§3.B',
        '`GREEN_GREEN`, after a `GRID_ACTIVE` that it acknowledged **on this connection**',
        'One frame of GRID_ACTIVE and GREEN_GREEN are sent in one piece.',
        'Fail: it says GREEN_GREEN, or the wheels turn, and it has not said GRID_ACTIVE.',
        ('again',),
        unless=('K-3B-01', 'K-3B-02'),
        starred=True,
    ),
    Clause(
        'K-3B-04',
        'GREEN_GREEN after RED_FLAG: stands',
        WIRE,
        '§3.B',
        '**Nothing may come between `GRID_ACTIVE` and `GREEN_GREEN`:**',
        'GREEN_GREEN is sent to a kart that has acknowledged RED_FLAG.',
        _MOVES,
        ('race',),
        unless=('K-3A-08', 'K-3B-01', 'K-3B-02'),
        starred=True,
    ),
    Clause(
        'K-3C-01',
        'connection closed: stops',
        PROPOSAL,
        '§3.C',
        'For safety, all karts must default to an ESTOP or stopped state upon disconnecting from '
        'the RCS to prevent the kart from automatically starting up.',
        'The connection is closed (FIN) while the kart drives.',
        _STOPS,
        ('fin',),
        'red_red',
        starred=True,
    ),
    Clause(
        'K-3E-01',
        'silence: stops',
        WIRE,
        '§3.E',
        'nothing for **1 s**, or the connection is gone',
        'Nothing more is sent while the kart drives; the connection stays open.',
        _STOPS,
        ('silence',),
        'red_red',
        starred=True,
    ),
    Clause(
        'K-3E-02',
        'after silence: GREEN_GREEN does not start it',
        PROPOSAL,
        '§3.E',
        'If a kart has disconnected (as described in Connection status) during the race, the '
        'kart shall immediately enter the RED_RED state.',
        'After silence, GREEN_GREEN is sent again, without GRID_ACTIVE.',
        _MOVES,
        ('silence',),
        unless=('K-3B-01', 'K-3B-02', 'K-3E-01'),
        starred=True,
    ),
    Clause(
        'K-3E-03',
        'connection reset: stops',
        WIRE,
        '§3.E',
        'nothing for **1 s**, or the connection is gone',
        'The connection is reset (RST) while the kart drives.',
        _STOPS,
        ('reset',),
        'red_red',
        starred=True,
    ),
    Clause(
        'K-3E-04',
        'connection half-closed: stops',
        WIRE,
        '§3.E',
        'nothing for **1 s**, or the connection is gone',
        'Race control closes its half of the connection while the kart drives.',
        _STOPS,
        ('half',),
        'red_red',
        unless=('K-3C-01',),
        starred=True,
    ),
    Clause(
        'K-3E-05',
        'after a lost connection: GREEN_GREEN does not start it',
        WIRE,
        '§3.E',
        'a new connection, a kart that gets `GREEN_GREEN` stands until it has acknowledged '
        'another `GRID_ACTIVE`.',
        'When the kart is back after FIN, RST and half-close, GREEN_GREEN is sent.',
        _MOVES,
        ('fin', 'reset', 'half'),
        unless=('K-3B-01', 'K-3B-02', 'K-3C-01', 'K-3E-03', 'K-3E-04'),
        starred=True,
    ),
    Clause(
        'K-3E-06',
        'race control restarted in mid-race: never moves by itself',
        WIRE,
        '§3.E',
        'after any other state, or a new connection, a kart that gets `GREEN_GREEN` stands until '
        'it has acknowledged another `GRID_ACTIVE`.',
        'Race control goes away while the kart drives, refuses connections, then comes back '
        'with GREEN_GREEN.',
        _MOVES,
        ('restart',),
        unless=('K-3B-01', 'K-3B-02', 'K-3C-01', 'K-3E-05'),
        starred=True,
    ),
    Clause(
        'K-3E-07',
        'nothing but malformed bytes: stops',
        WIRE,
        '§3.E',
        'For a kart, malformed bytes are the same as silence: after 1 s without a whole, correct '
        'frame, it stops.',
        'Only malformed frames are sent while the kart drives.',
        _STOPS,
        ('noise',),
        'red_red',
        unless=('K-3E-01', 'K-4C-07', 'K-4C-08'),
        starred=True,
    ),
    Clause(
        'K-3E-08',
        'RED_RED on a new connection: not acknowledged before it stands',
        WIRE,
        '§3.E',
        'Say it when it is **true**, not when you read it: on an acknowledged stop, people walk '
        'onto the track.',
        'The connection is reset while the kart drives, and RED_RED is sent on the next one; its '
        'acknowledgement is compared with its wheels.',
        _TURN_AFTER,
        ('cut',),
        unless=('K-3A-10', 'K-3E-03', 'K-4C-12', 'K-4D-02'),
        starred=True,
    ),
    Clause(
        'K-3E-09',
        'its program for race control is killed: stops',
        PROPOSAL,
        '§3.E',
        'If a kart has disconnected (as described in Connection status) during the race, the '
        'kart shall immediately enter the RED_RED state.',
        'The program that is connected to race control (our bridge) is killed while the kart '
        'drives.',
        _STOPS,
        ('bridge',),
        'red_red',
        starred=True,
    ),
    Clause(
        'K-3E-10',
        'its program that drives is killed: stops',
        WIRE,
        '§3.E',
        'It must also brake if this program ends.',
        'The program that commands the motors (the stack) is killed while the kart drives.',
        _STOPS,
        ('stack',),
        'red_red',
        starred=True,
    ),
    Clause(
        'K-4A-01',
        'connects',
        PROPOSAL,
        '§4.A',
        'The kart must be able to connect to and send/receive messages to the RCS through the '
        'Transmission Control Protocol (TCP) over a WiFi network.',
        'The inspection listens in place of race control.',
        'Time from the start to the first connection.',
        ('connect',),
        'connect',
    ),
    Clause(
        'K-4A-02',
        'one connection at a time',
        WIRE,
        '§4.A',
        'One connection per kart.',
        'The connections are watched during the whole inspection.',
        'Fail: it opens a connection and keeps another one open (slack).',
        (),
        unless=('K-4D-03',),
    ),
    Clause(
        'K-4C-01',
        'says whole, correct frames only',
        PROPOSAL,
        '§4.C',
        'Each message will begin with a start character (a dollar sign: $) followed by a '
        'character byte array of the State name and finished with an end character (a '
        'semi-colon: ;)',
        'All that the kart says is read, during the whole inspection.',
        'Fail: bytes that are no frame.',
        (),
    ),
    Clause(
        'K-4C-02',
        'frames cut into single bytes',
        WIRE,
        '§4.C',
        'TCP does not keep frames together: one read may return half a frame, the next one ten '
        'frames.',
        'RED_RED is sent byte by byte to a kart that stands.',
        'Time to $RED_RED;. Fail also: it drops the connection.',
        ('pieces',),
        'red_red',
        unless=('K-4C-05',),
    ),
    Clause(
        'K-4C-03',
        'many frames in one piece',
        WIRE,
        '§4.C',
        'TCP does not keep frames together: one read may return half a frame, the next one ten '
        'frames.',
        'RED_RED is sent to a kart that stands, five frames in a piece, cut inside a frame.',
        'Time to $RED_RED;. Fail also: it drops the connection.',
        ('pieces',),
        'red_red',
        unless=('K-4C-02', 'K-4C-05'),
    ),
    Clause(
        'K-4C-04',
        'frames whose second half is late',
        WIRE,
        '§4.C',
        'TCP does not keep frames together: one read may return half a frame, the next one ten '
        'frames.',
        'RED_RED is sent to a kart that stands, each frame in two halves, 0.07 s apart.',
        'Time to $RED_RED;. Fail also: it drops the connection.',
        ('pieces',),
        'red_red',
        unless=('K-4C-02', 'K-4C-05'),
    ),
    Clause(
        'K-4C-05',
        '10 frames a second are enough',
        PROPOSAL,
        '§4.C',
        'The RCS will send the race state at least 10 times per second.',
        'RED_RED is sent 10 times a second to a kart that stands.',
        'Time to $RED_RED;. Fail also: it drops the connection.',
        ('pieces',),
        'red_red',
    ),
    Clause(
        'K-4C-06',
        'sees a stop in time, however many frames came before it',
        WIRE,
        '§4.C',
        '**Read all there is, and obey the last frame**, not those before it.',
        'IN_GARAGE is sent 100 times a second, then 400 frames at once, then RED_RED.',
        'Time from RED_RED to $RED_RED;. A kart that fails is not made to drive.',
        ('backlog',),
        'red_red',
        ('K-3A-09',),
    ),
    Clause(
        'K-4C-07',
        'obeys nothing that only looks like GREEN_GREEN',
        WIRE,
        '§4.C',
        'a name that is not a state (`$GREEN;`, `$red_red;`)',
        'A kart that has acknowledged GRID_ACTIVE is sent malformed frames that look like '
        'GREEN_GREEN.',
        _MOVES,
        ('ready',),
        unless=('K-3A-03',),
        starred=True,
    ),
    Clause(
        'K-4C-08',
        'survives malformed bytes',
        WIRE,
        '§4.C',
        'malformed; skips to the next `$`',
        'The same malformed bytes between correct frames; then RED_RED.',
        'Time to $RED_RED;. Fail also: it drops the connection.',
        ('ready',),
        'red_red',
        ('K-4C-05', 'K-4C-07'),
    ),
    Clause(
        'K-4C-09',
        'says only what it is being sent',
        WIRE,
        '§4.C',
        'To acknowledge, say the same frame back, once or with every frame.',
        'All that the kart says is compared with what it is sent.',
        'Fail: it says the state of an earlier order after slack.',
        (),
        unless=('K-3A-14', 'K-4C-06', 'K-4C-07', 'K-4C-12'),
    ),
    Clause(
        'K-4C-10',
        'does not flood race control',
        WIRE,
        '§4.C',
        'reads about 4096 bytes a beat at most; accepts no acknowledgement from it during the '
        'flood and for 1 s after; drops it after 2 s.',
        'The bytes that the kart says are counted during the whole inspection.',
        'Fail: more than 4096 bytes in 0.05 s, for 1 s.',
        (),
    ),
    Clause(
        'K-4C-11',
        'nothing sent yet: says nothing, stands',
        WIRE,
        '§4.C',
        'as `RED_RED`: it stops, or stays where it is',
        'Nothing is sent for a moment on the first connection.',
        'Fail: it says anything, or the wheels turn.',
        ('connect',),
        starred=True,
    ),
    Clause(
        'K-4C-12',
        'says nothing old on a new connection',
        WIRE,
        '§4.C',
        'A kart that comes back after a loss has to acknowledge again.',
        'Nothing is sent for a moment on the connection after FIN.',
        'Fail: it says anything.',
        ('fin',),
        unless=('K-4C-11',),
    ),
    Clause(
        'K-4D-01',
        'connects again after FIN',
        WIRE,
        '§4.D',
        'Then connect again, and wait half a second between attempts',
        'The connection is closed while the kart drives.',
        'Time to the next connection.',
        ('fin',),
        'reconnect',
    ),
    Clause(
        'K-4D-02',
        'connects again after RST',
        WIRE,
        '§4.D',
        'Then connect again, and wait half a second between attempts',
        'The connection is reset while the kart drives.',
        'Time to the next connection.',
        ('reset',),
        'reconnect',
    ),
    Clause(
        'K-4D-03',
        'connects again after a half-close',
        WIRE,
        '§4.D',
        'Then connect again, and wait half a second between attempts',
        'Race control closes its half of the connection while the kart drives.',
        'Time to the next connection.',
        ('half',),
        'reconnect',
        ('K-4D-01',),
    ),
    Clause(
        'K-4D-04',
        'connects again after silence (half-open connection)',
        WIRE,
        '§4.D',
        'nothing for **1 s**, or the connection is gone',
        'Nothing is sent to a kart that stands; the connection stays open, as when race '
        "control's computer has lost its power.",
        'Time from the last frame to the next connection.',
        ('half_open',),
        'reconnect',
    ),
    Clause(
        'K-4D-05',
        'connects again when race control was restarted',
        WIRE,
        '§4.D',
        'Then connect again, and wait half a second between attempts',
        'Connections are refused for a while, then accepted again.',
        'Time from the moment they are accepted to the connection.',
        ('restart',),
        'reconnect',
        ('K-4D-01',),
    ),
    Clause(
        'K-4D-06',
        'acknowledges again on a new connection',
        WIRE,
        '§4.D',
        'A kart that comes back after a loss has to acknowledge again.',
        'RED_RED is sent on the connection after FIN.',
        'Time from the order to $RED_RED;.',
        ('fin',),
        'red_red',
    ),
)

BY_NAME = {clause.name: clause for clause in KART}


def select(clauses: Sequence[Clause], wanted: str) -> tuple[Clause, ...]:
    """
    Return the clauses that a person names.

    :param wanted: identifiers or their beginnings, with commas between; empty: all.
    :raises ValueError: a part of it names no clause.
    """
    chosen: list[Clause] = []
    parts = [part.strip().upper() for part in wanted.split(',') if part.strip()]
    for part in parts:
        found = [clause for clause in clauses if clause.name.startswith(part)]
        if not found:
            raise ValueError(f'no clause begins with {part}: --list shows all')
        chosen += found
    return tuple(clause for clause in clauses if not parts or clause in chosen)


def explain(clause: Clause) -> str:
    """Return all that a row says, for a person."""
    lines = [
        f'{clause.name}  {clause.title}',
        f'  {clause.section}, {clause.source}: "{clause.sentence}"',
        f'  Done:    {clause.done}',
        f'  Judged:  {clause.judged}',
    ]
    if clause.limit:
        lines.append(f'  Limit:   --{clause.limit.replace("_", "-")}')
    if clause.unless:
        lines.append(f'  Not judged where {" or ".join(clause.unless)} fails: the same fault.')
    lines.append(f'  Step:    {", ".join(clause.steps) or "the whole inspection"}')
    return '\n'.join(lines)


def listed(clauses: Iterable[Clause]) -> str:
    """Return one line for each clause."""
    return '\n'.join(
        f'{each.name}{"*" if each.starred else " "} {each.section:5} {each.title}'
        for each in clauses
    )
