# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The sentences that an inspection checks, one row each. `oracle` reports breaches by name."""

from __future__ import annotations

from collections.abc import Iterator

from evgp_inspection.verdicts import Clause

_TABLE = """
K-3A-01* IN_GARAGE: does not move on its own | connect race dwell rolling
    IN_GARAGE: The kart is not currently driving in the Race.
K-3A-02 GRID_ACTIVE: acknowledged when ready | race malformed | grid
    When ready to race, karts must reply with $GRID_ACTIVE; message to the RCS.
K-3A-03* GRID_ACTIVE: stands still | malformed dwell
    wire: does not move, gets ready
K-3A-04 GREEN_GREEN: acknowledged | race | green
    The kart should acknowledge the first $GREEN_GREEN; command.
K-3A-05* GREEN_GREEN: drives once it has acknowledged it | race | green
    Upon receiving the $GREEN_GREEN; command, a kart should begin driving within 30 seconds
K-3A-06 RED_FLAG: acknowledged once it stands | race | red_flag
    The kart should remain stopped once it has stopped moving and send a $RED_FLAG; message to the
    RCS.
K-3A-07* RED_FLAG: not acknowledged before it stands | race
    wire: Send it only once it is **true**, because people then walk onto the track.
K-3A-08* RED_FLAG: remains stopped | race dwell
    The kart should remain stopped once it has stopped moving
K-3A-09 RED_RED: acknowledged once it stands | race first red | red_red
    Karts should reply with a $RED_RED; message after coming to a complete stop (Nominal speed of
    0.0).
K-3A-10* RED_RED: not acknowledged before it stands | red early
    wire: Send it only once it is **true**, because people then walk onto the track.
K-3A-11 GRID_ACTIVE: acknowledged every time | again malformed | grid
    wire: It is valid until the next command.
K-3A-12* RED_RED while RED_FLAG brakes: not acknowledged before it stands | flag_red red
    wire: Send it only once it is **true**, because people then walk onto the track.
K-3A-13 RED_RED: brakes harder than for RED_FLAG | red race flag_red
K-3A-14* RED_RED: brakes at once, whenever it comes | early random long | red_red
    RED_RED: The kart must immediately stop as quickly as possible.
K-3A-15* RED_RED: remains stopped | race first dwell
    The kart should remain stopped once it has stopped moving
K-3A-16* RED_FLAG: slows down to a stop, whenever it comes | race early_flag random | red_flag
    RED_FLAG: The kart should begin slowing down to a stop while continuing to steer to avoid
    obstacles.
K-3B-01* GREEN_GREEN without GRID_ACTIVE: stands | alone
    wire: any other `GREEN_GREEN`
K-3B-02* GREEN_GREEN after RED_RED: stands | again red_green
    wire: **Nothing may come between `GRID_ACTIVE` and `GREEN_GREEN`.**
K-3B-03* GREEN_GREEN before the GRID_ACTIVE acknowledgement: stands | glued
    wire: `GREEN_GREEN`, after a `GRID_ACTIVE` that it acknowledged **on this connection**
K-3B-04* GREEN_GREEN after RED_FLAG: stands | race flag_green
    wire: **Nothing may come between `GRID_ACTIVE` and `GREEN_GREEN`.**
K-3C-01* connection closed: stops | fin | red_red
    For safety, all karts must default to an ESTOP or stopped state upon disconnecting from the RCS
    to prevent the kart from automatically starting up.
K-3E-01* silence: stops | silence | red_red
    wire: nothing for **1 s**, or the connection is gone
K-3E-02* after silence: GREEN_GREEN does not start it | silence grid
    If a kart has disconnected (as described in Connection status) during the race, the kart shall
    immediately enter the RED_RED state.
K-3E-03* connection reset: stops | reset | red_red
K-3E-04* connection half-closed: stops | half | red_red
    wire: nothing for **1 s**, or the connection is gone
K-3E-05* after a lost connection: GREEN_GREEN does not start it | fin reset half dwell
    wire: or a new connection, a kart that is sent `GREEN_GREEN` stays where it is until it has
    acknowledged another `GRID_ACTIVE`.
K-3E-06* race control restarted in mid-race: never moves on its own | restart
    wire: After any other state, or a new connection, a kart that is sent `GREEN_GREEN` stays where
    it is until it has acknowledged another `GRID_ACTIVE`.
K-3E-07* nothing but malformed bytes: stops | noise | red_red
    wire: For a kart, malformed bytes are the same as silence: after 1 s without a whole, correct
    frame, it stops.
K-3E-08* RED_RED on a new connection: not acknowledged before it stands | cut red
    wire: Send it only once it is **true**, because people then walk onto the track.
K-3E-09* its program for race control is killed: stops and stays | bridge | red_red
    If a kart has disconnected (as described in Connection status) during the race, the kart shall
    immediately enter the RED_RED state.
K-3E-10* its program that drives is killed: stops | stack | red_red
    wire: must brake if this program ends.
K-3E-11* lost while braking: brakes as for RED_RED | flag_lost flag_silence red_lost red | red_red
    If a kart has disconnected (as described in Connection status) during the race, the kart shall
    immediately enter the RED_RED state.
K-4A-01 connects | connect | connect
    The kart must be able to connect to and send/receive messages to the RCS through the
    Transmission Control Protocol (TCP) over a WiFi network.
K-4A-02 one connection at a time
    wire: Open one connection per kart.
K-4C-01 sends whole, correct frames only
    Each message will begin with a start character (a dollar sign: $) followed by a character byte
    array of the State name and finished with an end character (a semi-colon: ;)
K-4C-02 frames cut into single bytes | bytes | red_red
K-4C-03 many frames in one piece | many | red_red
K-4C-04 frames whose second half is late | late | red_red
    wire: TCP does not preserve frame boundaries: one read may return half a frame, and the next
    may return ten.
K-4C-05 10 frames a second are enough | slow | red_red
    The RCS will send the race state at least 10 times per second.
K-4C-06 sees a stop in time, however many frames came before it | backlog | red_red
    wire: **Read everything that has arrived, and obey the last frame.**
K-4C-07* obeys nothing that only looks like GREEN_GREEN | malformed
    wire: a name that is not a state (`$GREEN;`, `$red_red;`)
K-4C-08 survives malformed bytes | malformed | red_red
    wire: malformed; skips to the next `$`
K-4C-09 reports only the state that it is being sent
    wire: **To acknowledge, send the frame back,** once or with every frame.
K-4C-10 does not flood race control
    wire: reads about 4096 bytes per beat; accepts no acknowledgement during the flood and for 1 s
    after; drops it after 2 s.
K-4C-11 before the first frame: sends nothing, stands | connect
    wire: as `RED_RED`: stops, or stays where it is
K-4C-12 reports nothing old on a new connection | fin
    wire: After a lost connection, acknowledge again.
K-4D-01 connects again after FIN | fin | reconnect
K-4D-02 connects again after RST | reset | reconnect
K-4D-03 connects again after a half-close | half | reconnect
    wire: After a lost connection, stop the kart, then reconnect with half a second between
    attempts.
K-4D-04 connects again after silence (half-open connection) | half_open | reconnect
    wire: nothing for **1 s**, or the connection is gone
K-4D-05 connects again when race control was restarted | restart | reconnect
    wire: After a lost connection, stop the kart, then reconnect with half a second between
    attempts.
K-4D-06 acknowledges again on a new connection | flag_lost red_lost | red_red
    wire: After a lost connection, acknowledge again.
"""
"""The name and title of each clause, the steps that show it (the best one first, or none if all
do), and its limit. The sentence follows, from the proposal or from docs/wire.md; a clause without
one has that of the next. A star marks a clause that only the wheels can show; no inspection is
passed unless all of these are judged."""


def _rows() -> Iterator[Clause]:
    sentence = ''
    for row in reversed(_TABLE.strip().replace('\n    ', '\t').split('\n')):
        head, _, own = row.partition('\t')
        sentence = own.replace('\t', ' ') or sentence
        name_title, steps, limit = (*head.split('|'), '', '')[:3]
        name, _, title = name_title.strip().partition(' ')
        yield Clause(
            'docs/wire.md' if sentence.startswith('wire: ') else 'proposal',
            name.rstrip('*'),
            title,
            sentence.removeprefix('wire: '),
            tuple(steps.split()),
            limit.strip(),
            name.endswith('*'),
        )


KART = tuple(_rows())[::-1]
BY_NAME = {clause.name: clause for clause in KART}

BY_STATEMENT = (
    "§2.B: with the MSR's remote off, the motor has no power and the kart obeys RED_RED",
    "§2.C: the team's remote stops the kart and can do nothing else during a race; releasing it "
    'starts nothing',
    '§3.A: on RED_FLAG the kart slows down gently, steers, and pulls to the inside of the track',
)
"""Points that cannot be checked on stands. The team states and demonstrates them, and the
inspector ticks them."""
