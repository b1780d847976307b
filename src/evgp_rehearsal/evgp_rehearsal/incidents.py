# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The incidents: what happens in the field, the radio message, and what the rule book orders.

One row of ``INCIDENTS`` defines an incident completely. The rules behind it are in docs/rules.md.
This module is pure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import enum

from evgp_protocol.states import RaceState
from evgp_rehearsal.field import Failure, Fault, Field, TICK_LENGTH
from evgp_rehearsal.plan import Cue

ALERTS = {'ready_alert': 10.0, 'green_alert': 6.0, 'flag_alert': 12.0, 'red_alert': 4.0}
"""Alert times of a rehearsal's race control, shorter than in a race, in seconds."""

LASTS = 1800
"""Time after which an incident ends, as if people had repaired everything, in ticks."""


class Phase(enum.Enum):
    """When an incident can begin. The values are texts for the instructor."""

    GRID = 'in GRID_ACTIVE'
    RACE = 'in GREEN_GREEN, once all karts in the race are driving'
    LAST_LAP = 'in GREEN_GREEN, when the leader is near the end of its last lap'


@dataclass(frozen=True)
class Incident:
    """
    One kind of incident.

    :param meaning: description for the instructor.
    :param begin: a function that makes it happen to a kart of the field.
    :param order: what the rule book orders, with its place in the documents.
    :param to_kart: whether it happens to a single kart.
    """

    name: str
    meaning: str
    phase: Phase
    begin: Callable[[Field, int], None]
    order: str
    to_kart: bool = True

    @property
    def state(self) -> RaceState:
        """Return the state of the race in which the incident can begin."""
        grid = self.phase is Phase.GRID
        return RaceState.GRID_ACTIVE if grid else RaceState.GREEN_GREEN


def _begin(*what: Fault | Failure, radio: str = '') -> Callable[[Field, int], None]:
    """Return a function that gives a kart these faults, and race control these failures."""

    def begin(field: Field, kart: int) -> None:
        for each in what:
            if isinstance(each, Fault):
                field.karts[kart].faults.add(each)
            else:
                field.failures.append(each)
        if radio:
            field.say(radio.format(kart=kart))

    return begin


def _storm(field: Field, kart: int) -> None:
    for each in field.karts.values():
        each.faults.add(Fault.STORMY)
        each.stormy_since = field.tick


def _person(field: Field, kart: int) -> None:
    field.let_in(field.plan.track.point(0.4 * field.plan.track.length))
    field.say('Marshal, post 2: a person is on the track!')


_ROWS = (
    Incident(
        'wifi_gone',
        'a kart loses its WiFi in mid-race',
        Phase.RACE,
        _begin(Fault.OFFLINE),
        'stop the race, or use the MSR and record its use, because the kart may still move '
        '(Disconnections; Alerts: LOST_IN_MOTION)',
    ),
    Incident(
        'kart_stuck',
        'a kart has stopped on the track but still acknowledges',
        Phase.RACE,
        _begin(
            Fault.STUCK, radio='Marshal, post 1: kart {kart} has stopped and is not moving on.'
        ),
        'flag the race, or stop only this kart, which has stopped already; do not use anything '
        'stronger (Commands: stops)',
    ),
    Incident(
        'red_red_unacknowledged',
        'a kart does not acknowledge RED_RED',
        Phase.RACE,
        _begin(Fault.MUTE, radio='Race director: debris everywhere. Stop every kart now.'),
        'press ALL_KILL, and because one kart does not answer, use the MSR and record its use '
        '(Alerts: RED_UNACKNOWLEDGED)',
    ),
    Incident(
        'red_flag_not_obeyed',
        'a kart keeps driving in RED_FLAG',
        Phase.RACE,
        _begin(Fault.IGNORES_FLAG, Fault.MUTE, radio='Race director: red flag, please.'),
        'send RED_FLAG, and because one kart keeps driving, use the MSR and record its use '
        '(Alerts: FLAG_UNACKNOWLEDGED)',
    ),
    Incident(
        'false_start',
        'a kart drives off in GRID_ACTIVE',
        Phase.GRID,
        _begin(Fault.CREEPS),
        'stop the kart, or take it out of the race, which also stops it (One kart: leave)',
    ),
    Incident(
        'spin',
        'a kart spins in front of others',
        Phase.RACE,
        _begin(Fault.SPUN, radio='Marshal, post 3: kart {kart} has spun, and others are coming!'),
        'flag the race, so that the others stop and still steer (States: RED_FLAG)',
    ),
    Incident(
        'person_on_track',
        'a person is on the track while karts race',
        Phase.RACE,
        _person,
        'press ALL_KILL, use the MSR at once and record it, because humans are in danger (§3.D)',
        to_kart=False,
    ),
    Incident(
        'slow_leader',
        'the leader crosses the line slowly, with others close behind',
        Phase.LAST_LAP,
        _begin(Fault.SLOW),
        'mark the karts as finished in the order in which they cross the line, and do not stop a '
        'kart (Finish and race over)',
    ),
    Incident(
        'reconnect_storm',
        'every kart loses its connection again and again',
        Phase.RACE,
        _storm,
        'stop the race, or use the MSR, and do not release a kart until it has stopped '
        '(Disconnections)',
        to_kart=False,
    ),
    Incident(
        'second_machine',
        "a second machine has a kart's address",
        Phase.RACE,
        _begin(Fault.REPLACED),
        'stop the race, or use the MSR, because race control no longer hears the real kart '
        '(Disconnections: a second connection)',
    ),
    Incident(
        'race_control_crash',
        'race control dies in mid-race, and comes back',
        Phase.RACE,
        _begin(Failure.CRASH),
        'press ALL_KILL or use the MSR; or wait until every kart has acknowledged RED_RED, '
        'check the track, and then send IN_GARAGE (When race control itself ends)',
        to_kart=False,
    ),
    Incident(
        'laptop_dies',
        "race control's laptop dies in mid-race, and a spare has a copy",
        Phase.RACE,
        _begin(Failure.DIE),
        'do the drill; then record the MSR, or wait until every kart has acknowledged '
        'RED_RED, check the track, and send IN_GARAGE (docs/race-day.md)',
        to_kart=False,
    ),
    Incident(
        'console_lost',
        "the officials' window dies, and then a red flag is needed",
        Phase.RACE,
        _begin(Failure.CLOSE_CONSOLE, radio='Race director: oil on the track. Red flag, please.'),
        'flag the race from another window or with rcs_ctl, or use the MSR (docs/safety.md)',
        to_kart=False,
    ),
    Incident(
        'msr_needed',
        'a kart no longer obeys anything',
        Phase.RACE,
        _begin(
            Fault.IGNORES_RED, Fault.MUTE, radio='Marshal, post 2: kart {kart} is out of control!'
        ),
        'stop it, use the MSR at once and record it (§2.B)',
    ),
    Incident(
        'not_ready',
        'a kart does not get ready on the grid',
        Phase.GRID,
        _begin(Fault.NEVER_READY),
        'take the kart out of the race, or return to IN_GARAGE (Alerts: NOT_READY)',
    ),
    Incident(
        'missed_passing',
        'the timing line misses a kart',
        Phase.RACE,
        _begin(Fault.UNSEEN),
        'count the crossing by hand (LAP), and do not stop a kart (docs/timing.md: Corrections)',
    ),
    Incident(
        'false_passing',
        'the timing line sees a kart that is elsewhere',
        Phase.RACE,
        _begin(Fault.SEEN_ELSEWHERE),
        'strike out the passing (STRIKE PASSING), and do not stop a kart (docs/timing.md: '
        'Corrections)',
    ),
)

INCIDENTS = {row.name: row for row in _ROWS}
"""Every incident by its name."""


def script_of(names: Sequence[str]) -> tuple[Cue, ...]:
    """
    Return a script of these incidents, in this order.

    The first one is due after 20 s. An incident that begins when it is due has ended before the
    next one is due.
    """
    apart = LASTS * TICK_LENGTH
    return tuple(Cue(name, 20.0 + apart * number) for number, name in enumerate(names))


def choose_kart(field: Field, incident: Incident, kart: int = 0) -> int:
    """
    Return the kart to which an incident happens, or 0.

    :param kart: the wanted kart. With 0, an incident of the last lap happens to the leader. For
        other incidents, the seed decides.
    """
    if not incident.to_kart:
        return 0
    if incident.phase is Phase.LAST_LAP:
        return kart or field.leader()
    return kart or field.rng.choice([each.number for each in field.sent(incident.state)])


def can_begin(row: Incident, field: Field, state: RaceState, kart: int = 0) -> bool:
    """Return whether an incident can begin now, to this kart or (0) to any."""
    karts = field.sent(row.state)
    if state is not row.state or not karts:
        return False
    if row.to_kart and kart and kart not in {each.number for each in karts}:
        return False
    if row.phase is Phase.GRID:
        return True
    if not all(each.moves for each in karts):
        return False
    if row.phase is Phase.RACE:
        return all(each.speed > 0.5 * each.ability.top for each in karts)
    leader = field.karts.get(field.leader())
    return leader is not None and leader.distance > field.finish - 25.0
