# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The incidents: what happens in the field, what is said, and what a good official does.

Pure. One row of ``INCIDENTS`` says everything about an incident; the rules behind it stand in
docs/rules.md. What an official does is recognised by the events of the record: which command, to
which kart. A command is a ``Deed``; whatever no row names is judged by ``score``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import enum
from typing import NamedTuple

from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rehearsal.field import Call, Failure, Fault, Field, TICK_LENGTH

LAST_METRES = 25.0
"""Distance of the leader from the end of its last lap where an incident of the last lap begins."""

ALERTS = {'ready_alert': 10.0, 'green_alert': 6.0, 'flag_alert': 12.0, 'red_alert': 4.0}
"""The times of a rehearsal's race control: shorter than in a race, so that nobody waits."""

AFTER = 200
"""Ticks that an official has after the time of an incident is over."""


class Phase(enum.Enum):
    """When an incident can begin."""

    GRID = enum.auto()
    RACE = enum.auto()
    LAST_LAP = enum.auto()


class Deed(NamedTuple):
    """A command of an official; whether it is for the kart of the incident alone."""

    kind: CommandKind
    this_kart: bool = False


def _all(*kinds: CommandKind) -> frozenset[Deed]:
    return frozenset(Deed(kind) for kind in kinds)


def _this(*kinds: CommandKind) -> frozenset[Deed]:
    return frozenset(Deed(kind, True) for kind in kinds)


K = CommandKind
MSR = _all(K.RECORD_MSR)
KILL = _all(K.ALL_KILL)
FLAG = _all(K.RED_FLAG)
STOP_THIS = _this(K.KART_RED_RED, K.KART_RED_FLAG)
STOP_RACE = FLAG | KILL | _all(K.RACE_OVER)


AT_ONCE = 10.0
"""Time for all steps where somebody may be hit, in seconds: to hear it, to act, to say MSR."""


@dataclass(frozen=True)
class Incident:
    """
    One kind of incident.

    :param meaning: what it is, for who chooses it.
    :param begin: makes it happen to a kart of the field.
    :param good: what a good official does, with the place in docs/rules.md.
    :param steps: what must be commanded, one of each set, one after the other.
    :param fine: what may be commanded besides.
    :param wrong: what endangers somebody, though it would stop karts.
    :param limit: time for all steps, in seconds.
    :param to_kart: it happens to one kart.
    """

    name: str
    meaning: str
    phase: Phase
    begin: Callable[[Field, int], None]
    good: str
    steps: tuple[frozenset[Deed], ...]
    fine: frozenset[Deed] = frozenset()
    wrong: frozenset[Deed] = frozenset()
    limit: float = 30.0
    to_kart: bool = True

    @property
    def ticks(self) -> int:
        """Return its limit in ticks."""
        return round(self.limit / TICK_LENGTH)

    @property
    def state(self) -> RaceState:
        """Return the race's state in which it can begin."""
        grid = self.phase is Phase.GRID
        return RaceState.GRID_ACTIVE if grid else RaceState.GREEN_GREEN

    @property
    def asked(self) -> frozenset[Deed]:
        """Return whatever is one of its steps."""
        return frozenset().union(*self.steps)


def _fault(*faults: Fault) -> Callable[[Field, int], None]:
    def begin(field: Field, kart: int) -> None:
        field.karts[kart].faults.update(faults)

    return begin


def _told(
    call: Call, text: str, *faults: Fault, failure: Failure | None = None
) -> Callable[[Field, int], None]:
    def begin(field: Field, kart: int) -> None:
        if faults:
            _fault(*faults)(field, kart)
        if failure is not None:
            field.failures.append(failure)
        field.say(call, kart, text.format(kart=kart))

    return begin


def _storm(field: Field, kart: int) -> None:
    for each in field.karts.values():
        each.faults.add(Fault.STORMY)
        each.stormy_since = field.tick


def _person(field: Field, kart: int) -> None:
    field.person = field.plan.track.point(0.4 * field.plan.track.length)
    field.say(Call.PERSON, 0, 'Marshal, post 2: a person is on the track!')


_ROWS = (
    Incident(
        'wifi_gone',
        'a kart loses its WiFi in mid-race',
        Phase.RACE,
        _fault(Fault.OFFLINE),
        'stops the race, or uses the MSR and records it: the kart may still move (Disconnections; '
        'Alerts: LOST_IN_MOTION)',
        (STOP_RACE | MSR,),
        fine=MSR | STOP_THIS,
    ),
    Incident(
        'kart_stuck',
        'a kart stands on the track; it acknowledges all the same',
        Phase.RACE,
        _told(Call.STANDS, 'Marshal, post 1: kart {kart} stands and does not go on.', Fault.STUCK),
        'flags the race, or stops this one kart, which stands already; nothing stronger '
        '(Commands: stops)',
        (STOP_THIS | FLAG,),
        fine=STOP_THIS | FLAG,
    ),
    Incident(
        'red_red_unacknowledged',
        'a kart does not acknowledge RED_RED',
        Phase.RACE,
        _told(Call.STOP_ALL, 'Race director: debris everywhere. Stop every kart now.', Fault.MUTE),
        'sends ALL_KILL; then, since one kart does not answer, uses the MSR and records it '
        '(Alerts: RED_UNACKNOWLEDGED)',
        (KILL | MSR | _all(K.RACE_OVER), MSR),
        fine=STOP_THIS | FLAG,
    ),
    Incident(
        'red_flag_not_obeyed',
        'a kart drives on in RED_FLAG',
        Phase.RACE,
        _told(Call.FLAG_ALL, 'Race director: red flag, please.', Fault.IGNORES_FLAG, Fault.MUTE),
        'sends RED_FLAG; then, since one kart drives on, uses the MSR and records it (Alerts: '
        'FLAG_UNACKNOWLEDGED)',
        (STOP_RACE | MSR, MSR),
        fine=STOP_THIS,
        limit=45.0,
    ),
    Incident(
        'false_start',
        'a kart drives off in GRID_ACTIVE',
        Phase.GRID,
        _fault(Fault.CREEPS),
        'stops the kart, or takes it out of the race, which stops it too (One kart: leave)',
        (STOP_THIS | _this(K.LEAVE_RACE) | STOP_RACE | MSR,),
        fine=MSR | STOP_THIS,
    ),
    Incident(
        'spin',
        'a kart spins in front of others',
        Phase.RACE,
        _told(Call.SPUN, 'Marshal, post 3: kart {kart} has spun, others come!', Fault.SPUN),
        'flags the race, so that the others stop and still steer (States: RED_FLAG)',
        (FLAG | KILL,),
        fine=STOP_THIS,
    ),
    Incident(
        'person_on_track',
        'a person is on the track while karts race',
        Phase.RACE,
        _person,
        'sends ALL_KILL, uses the MSR at once and records it: humans are in danger (§3.D)',
        (KILL | MSR, MSR),
        fine=KILL,
        wrong=FLAG,
        limit=AT_ONCE,
        to_kart=False,
    ),
    Incident(
        'slow_leader',
        'the leader crosses the line slowly, with others close behind',
        Phase.LAST_LAP,
        _fault(Fault.SLOW),
        'marks the karts as finished in the order in which they cross the line; stops nobody '
        '(Finish and race over)',
        (_this(K.KART_FINISH),),
        limit=40.0,
    ),
    Incident(
        'reconnect_storm',
        'every kart loses its connection again and again',
        Phase.RACE,
        _storm,
        'stops the race, or uses the MSR; releases no kart until it stands (Disconnections)',
        (STOP_RACE | MSR,),
        fine=MSR,
        to_kart=False,
    ),
    Incident(
        'second_machine',
        "a second machine has a kart's address",
        Phase.RACE,
        _fault(Fault.REPLACED),
        'stops the race, or uses the MSR: nobody hears the real kart any more (Disconnections: '
        'a second connection)',
        (STOP_RACE | MSR,),
        fine=MSR | STOP_THIS,
    ),
    Incident(
        'race_control_crash',
        'race control dies in mid-race, and comes back',
        Phase.RACE,
        lambda field, kart: field.failures.append(Failure.CRASH),
        'sends ALL_KILL or uses the MSR; or waits until every kart has acknowledged RED_RED, '
        'looks at the track, and then states IN_GARAGE (When race control itself ends)',
        (KILL | MSR | _all(K.IN_GARAGE),),
        fine=MSR,
        to_kart=False,
    ),
    Incident(
        'laptop_dies',
        "race control's laptop dies in mid-race; a spare has a copy",
        Phase.RACE,
        lambda field, kart: field.failures.append(Failure.DIE),
        'does the drill; then records the MSR, or waits until every kart has acknowledged '
        'RED_RED, looks at the track, and states IN_GARAGE (docs/operations.md)',
        (KILL | MSR | _all(K.IN_GARAGE),),
        fine=MSR,
        limit=90.0,
        to_kart=False,
    ),
    Incident(
        'console_lost',
        "the officials' window dies, and then a red flag is needed",
        Phase.RACE,
        _told(
            Call.FLAG_ALL,
            'Race director: oil on the track. Red flag, please.',
            failure=Failure.CLOSE_CONSOLE,
        ),
        'flags the race from another window or by rcs_ctl, or uses the MSR (docs/safety.md)',
        (STOP_RACE | MSR,),
        fine=MSR,
        to_kart=False,
    ),
    Incident(
        'msr_needed',
        'a kart obeys nothing any more',
        Phase.RACE,
        _told(
            Call.OUT_OF_CONTROL,
            'Marshal, post 2: kart {kart} is out of control!',
            Fault.IGNORES_RED,
            Fault.MUTE,
        ),
        'stops it, uses the MSR at once and records it (§2.B)',
        (KILL | STOP_THIS | MSR, MSR),
        fine=FLAG | STOP_THIS,
        limit=AT_ONCE,
    ),
    Incident(
        'not_ready',
        'a kart does not get ready on the grid',
        Phase.GRID,
        _fault(Fault.NEVER_READY),
        'takes the kart out of the race, or goes back to IN_GARAGE (Alerts: NOT_READY)',
        (_this(K.LEAVE_RACE) | _all(K.IN_GARAGE, K.RACE_OVER),),
        fine=STOP_THIS,
        limit=40.0,
    ),
    Incident(
        'missed_passing',
        'the timing line misses a kart',
        Phase.RACE,
        _fault(Fault.UNSEEN),
        'counts the passing by hand; stops nobody (Corrections of laps: COUNT_PASSING)',
        (_this(K.COUNT_PASSING),),
        limit=90.0,
    ),
    Incident(
        'false_passing',
        'the timing line sees a kart that is elsewhere',
        Phase.RACE,
        _fault(Fault.SEEN_ELSEWHERE),
        'strikes the passing out; stops nobody (Corrections of laps: STRIKE_PASSING)',
        (_all(K.STRIKE_PASSING),),
        limit=90.0,
    ),
)

INCIDENTS = {row.name: row for row in _ROWS}
"""Every incident by its name."""


def choose_kart(field: Field, incident: Incident, kart: int = 0) -> int:
    """
    Return which kart an incident happens to; 0: none in particular.

    :param kart: the one that is wanted; 0: the leader where it is about the leader, else the
        seed decides.
    """
    if not incident.to_kart:
        return 0
    if incident.phase is Phase.LAST_LAP:
        return kart or field.leader()
    there = field.karts if incident.phase is Phase.GRID else [k.number for k in field.racing()]
    return kart or field.rng.choice(sorted(there))


def can_begin(row: Incident, field: Field, state: RaceState) -> bool:
    """Return whether an incident can begin now."""
    karts = field.racing()
    if state is not row.state or row.phase is Phase.GRID:
        return state is row.state
    if not karts or not all(kart.moves for kart in karts):
        return False
    if row.phase is Phase.RACE:
        return all(kart.speed > 0.5 * kart.ability.top for kart in karts)
    return max(kart.distance for kart in karts) > field.finish - LAST_METRES
