# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
An oracle for the rules of the race, and an exhaustive search that puts every question to it.

The oracle is a second reading of the proposal and of docs/rules.md. It calls nothing of ``race``
to form its opinion: it has its own order of strictness, its own judgement of every command and its
own expectation of every effect. It looks at the rules from outside (``look``), before and after an
input, and says what is wrong (``RuleBrokenError``). ``PROPERTIES`` names everything it looks for.

The rules are a parameter (a module), so that the same search can be let loose on broken ones.
"""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass, field
import functools
import gc
import itertools
import operator
from types import ModuleType, SimpleNamespace
from typing import Any, get_args, NamedTuple

from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.link_quality import LinkQuality, NOT_MEASURED
from evgp_rcs.rules.race import Attendance, Command

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED

REDS = (RED_FLAG, RED_RED)
UNDER_WAY = (GREEN_GREEN, RED_FLAG, RED_RED)

# The oracle's own strictness, copied from docs/rules.md and not taken from the code under test.
RANK = {
    state: rank
    for rank, state in enumerate((GREEN_GREEN, GRID_ACTIVE, IN_GARAGE, RED_FLAG, RED_RED))
}

RACE_STOPS = ('ALL_KILL', 'RED_FLAG', 'RECORD_MSR')
KART_STOPS = ('KART_RED_RED', 'KART_RED_FLAG')
STOPS = (*RACE_STOPS, *KART_STOPS)
KART_COMMANDS = tuple(kind.name for kind, entry in CATALOGUE.items() if entry.to_one_kart)
# What READ_ROSTER and TAKE_ROSTER change, test_reload.py asks; here no roster is read.
RACE_COMMANDS = tuple(kind.name for kind in CATALOGUE if kind.name not in KART_COMMANDS)
# Bookkeeping that is no command to karts: §4.B's "last button pressed" does not mean these.
NO_BUTTON = (
    'KART_UNDO_FINISH',
    'JOIN_RACE',
    'LEAVE_RACE',
    'SET_HEAT',
    'OPEN_TRACK',
    'CLOSE_TRACK',
    'READ_ROSTER',
    'TAKE_ROSTER',
)
# What starts karts, releases them or lets humans near, and what of it names the karts concerned.
LOOSENING = (
    'GRID_ACTIVE',
    'GREEN_GREEN',
    'IN_GARAGE',
    'KART_IN_GARAGE',
    'OPEN_TRACK',
    'TAKE_ROSTER',
)
NAMING = ('GRID_ACTIVE', 'GREEN_GREEN', 'IN_GARAGE')
# The states in which somebody must be there who can stop the race.
IN_MOTION = (GRID_ACTIVE, GREEN_GREEN)
OFFICIAL = 'Anna'
RUN = 'a run'
GONE = 'end of file'
ANNA, NOBODY = Attendance(1, 'Anna (window)'), Attendance()
GOOD, POOR = (
    NOT_MEASURED._replace(grade=each, worst_answer=0.0) for each in (Grade.GOOD, Grade.POOR)
)
# How much of a danger a kart may be.
HARMLESS, ON_GRID, MOVING = range(3)

PROPERTIES = {
    'stop-refused': 'S: a stop is never refused',
    'stop-idempotent': 'S: a stop sent twice changes nothing, and no acknowledgement falls',
    'stop-loosens': 'S: a stop never makes what a kart is sent less strict',
    'stop-at-once': 'S: a stop takes effect for every kart concerned before all else is judged',
    'green-only-by-command': 'S: only an accepted GREEN_GREEN makes a kart be sent GREEN_GREEN',
    'green-needs-grid': 'S: GREEN_GREEN is refused unless GRID_ACTIVE was the last command',
    'green-needs-acks': 'S: GREEN_GREEN is refused before every kart in the race has acknowledged',
    'red-loosened': 'S: only the two IN_GARAGE commands lift a red',
    'red-to-green': 'S: no way from red to GREEN_GREEN but by IN_GARAGE and a new GRID_ACTIVE',
    'finish-put-off': 'S: the RED_FLAG of a finish comes on time, unless it was undone before',
    'membership-loosens': 'S: joining, leaving and heats change nothing that a red kart is sent',
    'uninspected': 'if an inspection is required, no kart without one joins or starts',
    'heat': 'the heat put in last is in the race, until a kart of another one is, or none at all',
    'results': 'the order of FINISH is told once, when the race is over or goes to IN_GARAGE',
    'ack-old': 'S: an acknowledgement counts only for the order that the kart is being sent now',
    'ack-from-nothing': 'S: nothing but the kart itself sets its acknowledgement',
    'ack-survives': 'S: an acknowledgement falls with a new order and with the connection',
    'ack-stale': 'S: a kart that says another state than it acknowledged takes its word back',
    'ack-deaf': 'a kart that says the present state under the present serial is heard',
    'drop-not-held': 'S: a kart lost in a race under way, or in motion, is held in RED_RED',
    'doubt-unnoticed': 'S: who is sent GREEN_GREEN or a red, or says so unasked, may be moving',
    'doubt-forgotten': (
        "S: *possibly moving* ends only by the kart's own acknowledged red, or by an "
        "official's individual release"
    ),
    'settle': 'S: an acknowledged red ends doubt only after `settle_time` on the same connection',
    'alarm-cleared': 'S: a lost or returning link never ends a *use the MSR*',
    'alone-released': 'S: IN_GARAGE for the race releases no kart outside it that was held alone',
    'as-seen': 'S: a start or release is refused if the karts are not those that the official saw',
    'rival': 'S: while another race control runs, nothing is loosened',
    'pause': 'S: what starts, releases, opens or changes the roster is refused during a pause',
    'available-from': 'what a pause refuses, and nothing else, is announced with the end of it',
    'start-first': 'S: karts start only once it is on the disk that they may move',
    'start-memory': 'S: what the disk is given in GRID_ACTIVE says that its karts may move',
    'no-record': 'S: while the record fails, no race starts',
    'nobody-there': 'S: once nobody can stop it, the race does not start, or is stopped',
    'there-acts': (
        'S: an official who comes or goes sends no kart anything and changes nothing else'
    ),
    'restart': 'S: after a restart, all is red and the track open; no hold or doubt is forgotten',
    'cut-off': 'S: race control that is cut off is in the state of a start without proof',
    'contested': 'S: no race starts with a kart for which two programs connect in turns',
    'hold-forgotten': 'S: a hold ends only with an acknowledged red, or by an individual release',
    'order-wrong': 'S: a connected kart gets an order exactly when what it is sent changes',
    'order-serial': 'S: serials rise, and the last order sent is the one that counts',
    'sent-wrong': 'each kart is sent what *Who is sent what* in docs/rules.md says',
    'track-open-in-motion': 'S: the track is never open in GRID_ACTIVE or GREEN_GREEN',
    'track-access': 'the track can be opened exactly when docs/rules.md allows humans on it',
    'availability': 'a command is offered exactly when docs/rules.md allows it, and then it works',
    'statement': 'a command that asks for a statement is refused without it, and only then',
    'refused-changes': 'S: a refused command changes nothing and orders nothing',
    'refusal-silent': 'a refusal says which command, and names each kart that fails, up to three',
    'told-first': 'a command is told before what comes of it',
    'cause': 'every change of the state of the race names the command, and who gave it',
    'effect': 'each input does all that docs/rules.md says, and nothing else',
    'alerts': 'each alert of docs/rules.md is raised exactly while its cause lasts',
    'use-msr': 'S: where the MSR is the answer, alerts ask for it until its use is recorded',
    'alerts-act': 'S: looking, and alerts, change nothing',
    'false-news': 'that every kart has acknowledged is announced when it is true',
    'stuck': 'the officials can bring every state home, karts answering or not',
    'finish-other': 'S: a FINISH that names another run, race or attempt is refused',
    'abstraction': 'states that the search takes for one behave as one',
}
"""Every property the oracle looks for, under the name by which a violation is reported."""


class RuleBrokenError(AssertionError):
    """The rules broke a property."""

    def __init__(self, name: str, detail: str) -> None:
        assert name in PROPERTIES, name
        super().__init__(f'[{name}] {PROPERTIES[name]}: {detail}')
        self.name = name


def _none_of(broken: dict[str, Any], *about: object) -> None:
    """Raise the first of these properties that is broken, with what that is about."""
    if any(broken.values()):
        name = next(name for name, is_broken in broken.items() if is_broken)
        raise RuleBrokenError(name, '; '.join(map(str, about)))


class KartView(NamedTuple):
    """What the oracle sees of one kart: attributes of the rules' kart."""

    number: int
    in_race: bool
    connected: bool
    hold: RaceState | None
    sent: RaceState
    sent_since: float
    serial: int
    acknowledged: bool
    doubt: int
    place: int
    attempt: int
    flag_at: float | None
    settles_at: float | None
    held_alone: bool
    contested: bool
    went_silent_at: float | None
    lost: bool
    ordered_at: float
    link: LinkQuality
    inspected: str

    @property
    def moving(self) -> bool:
        return self.doubt == MOVING


class View(NamedTuple):
    """
    What the oracle sees of the race: attributes of the rules' race.

    :param strict: an inspection is required.
    """

    state: RaceState
    track_open: bool
    msr_used: bool
    over: bool
    past_unknown: bool
    unstated: bool
    has_rival: bool
    heats: tuple[Any, ...]
    starters: tuple[int, ...]
    number: int
    grids: int
    paused_until: float
    opening: int
    cut_off_by: str
    record_fails: str
    there: Attendance
    nobody_since: float | None
    race_since: float | None
    strict: bool
    karts: tuple[KartView, ...]


class KartFacts(NamedTuple):
    """
    What the oracle remembers of one kart, from the inputs alone.

    :param ready: it answered the present GRID_ACTIVE on its present connection.
    :param phase: 0 after a red, 1 after IN_GARAGE, 2 after IN_GARAGE and then GRID_ACTIVE.
    :param stood: since when it has stood by its acknowledgement of the red it is sent, and race
        control would have heard it take that back.
    """

    ready: bool = False
    phase: int = 1
    stood: float | None = None


class Facts(NamedTuple):
    """
    What the oracle remembers: of the race, and of each kart.

    :param grid_last: GRID_ACTIVE was the last button.
    :param saved: it is on the disk that the karts on the grid may move.
    :param heat: the heat that was last put into the race, or at first the only one with its karts;
        None: not looked at.
    """

    grid_last: bool
    karts: tuple[KartFacts, ...]
    saved: bool = True
    heat: str | None = ''


def command(
    kind: str, kart: int = 0, statement: bool = False, at: float = 0.0, **fields: Any
) -> inputs.Commanded:
    """Return the input of a command that comes when it is judged."""
    given = Command(CommandKind[kind], kart, statement, official=OFFICIAL, **fields)
    return inputs.Commanded(at, given, at)


def but(given: Any, **fields: Any) -> Any:
    """Return the input of a command that names something else."""
    return given._replace(command=given.command._replace(**fields))


_OF_KARTS = {kind for kind in get_args(inputs.Input) if 'kart' in kind._fields}


def _about(given: Any) -> tuple[type[Any], str, int]:
    """Return what an input is, which command if it is one, and the number of its kart or 0."""
    if isinstance(given, inputs.Commanded):
        # As kind.name, but faster.
        return inputs.Commanded, given.command.kind._name_, given.command.kart
    return type(given), '', given.kart if type(given) in _OF_KARTS else 0


class Judgement(NamedTuple):
    """
    The oracle's opinion on a command.

    :param culprits: who is in the way.
    :param karts: whom it starts or releases.
    """

    allowed: bool
    needs_statement: bool = False
    culprits: tuple[int, ...] = ()
    karts: tuple[int, ...] = ()


_KART = operator.attrgetter(*KartView._fields)
# As KartView._make and View._make, in half the time.
_kart_view: Callable[[Iterable[Any]], KartView] = functools.partial(tuple.__new__, KartView)
_view: Callable[[Iterable[Any]], View] = functools.partial(tuple.__new__, View)
_RACE = operator.attrgetter(*View._fields[:-2], 'times.require_inspection')


def look(race: Any) -> View:
    """Return what the oracle sees of a race."""
    return _view((*_RACE(race), tuple(map(_kart_view, map(_KART, race.karts.values())))))


def remember(view: View) -> Facts:
    """Return the memory with which the oracle begins, before anything has happened."""
    racing = [kart.number for kart in view.karts if kart.in_race]
    alike = [heat.name for heat in view.heats if sorted(heat.karts) == sorted(racing)]
    heat = alike[0] if len(alike) == 1 else ''
    return Facts(False, tuple(KartFacts() for _ in view.karts), heat=heat)


def recall(view: View, heat: str | None = '') -> Facts:
    """
    Return the memory with which the oracle begins after a restart.

    :param heat: that had been put into the race, if race control can know it.
    """
    return Facts(False, tuple(KartFacts(phase=0) for _ in view.karts), heat=heat)


# ----- the oracle's reading of docs/rules.md --------------------------------------------------


def _stricter(one: RaceState, other: RaceState | None) -> RaceState:
    return one if other is None or RANK[one] >= RANK[other] else other


def _humans_allowed(view: View) -> tuple[bool, tuple[int, ...]]:
    """§3.A's three conditions, per kart, and none of them known after a restart."""
    if view.msr_used:
        return True, ()
    if view.state in (GRID_ACTIVE, GREEN_GREEN):
        return False, ()
    unsafe = _as_named(k for k in view.karts if not (_is_safe(k) or _is_covered(view, k)))
    return not (unsafe or view.past_unknown), unsafe


def _as_named(karts: Iterable[KartView]) -> tuple[int, ...]:
    """Return the numbers of dangerous karts as a sentence names them: those out of reach first."""
    return tuple(kart.number for kart in sorted(karts, key=lambda kart: kart.connected))


def _is_safe(kart: KartView) -> bool:
    """Return whether it stands by its word, or was neither told nor seen to move since."""
    if kart.connected:
        return _stands(kart) or (kart.sent is IN_GARAGE and not kart.moving)
    return not kart.doubt


def _stands(kart: Any) -> bool:
    """Return whether it has stood by its word on a red for long enough."""
    return kart.acknowledged and _red(kart) and not kart.doubt and kart.settles_at is None


def _is_away(kart: Any) -> bool:
    """Return whether it is away, was not lost, and nothing but a stop of all can hold it."""
    return not (kart.connected or kart.doubt or kart.held_alone or kart.lost)


def _is_covered(view: Any, kart: Any) -> bool:
    """Return whether IN_GARAGE's statement covers a kart that nobody has seen move."""
    return view.past_unknown and not (kart.doubt or kart.held_alone)


def _is_unanswered(view: Any, kart: Any) -> bool:
    """Return whether a stop by an official makes a kart doubtful that is covered without it."""
    answers = kart.acknowledged and _red(kart)
    return kart.connected and not answers and _is_covered(view, kart)


def _uninspected(view: View, karts: Iterable[KartView]) -> tuple[int, ...]:
    """Return which of these karts may not race for want of an inspection."""
    return tuple(kart.number for kart in karts if view.strict and not kart.inspected)


def _unfit(view: View) -> tuple[int, ...]:
    """Return with whom no race starts, whatever karts answer."""
    racing = [kart for kart in view.karts if kart.in_race]
    return (
        tuple(kart.number for kart in racing if kart.hold is not None)
        or tuple(kart.number for kart in racing if kart.contested)
        or _as_named(k for k in view.karts if k.moving or (k.doubt and not k.in_race))
    )


def _red(kart: Any) -> bool:
    return kart.sent is RED_FLAG or kart.sent is RED_RED


def is_abandoned(view: View, now: float, times: Any) -> bool:
    """Return whether the race is to be stopped now, since nobody has been there for too long."""
    limit, since = times.nobody_there, view.nobody_since
    return bool(limit) and since is not None and now >= since + limit


def judge(view: View, facts: Facts, kind: str, number: int) -> Judgement:
    """Return what the table of docs/rules.md says of a command now."""
    if kind in STOPS:
        return Judgement(True, kind == 'RECORD_MSR')
    if (view.has_rival or view.cut_off_by) and kind in LOOSENING:
        return Judgement(False)
    racing = [kart for kart in view.karts if kart.in_race]
    numbers = tuple(kart.number for kart in racing)
    state = view.state
    if kind == 'GRID_ACTIVE':
        unfit = _uninspected(view, racing) or _unfit(view)
        in_time = state in (IN_GARAGE, GRID_ACTIVE) and bool(racing)
        allowed = in_time and not unfit and not view.record_fails
        return Judgement(allowed, True, unfit * in_time, numbers)
    if kind == 'GREEN_GREEN':
        missing = tuple(
            kart.number
            for kart, memory in zip(view.karts, facts.karts, strict=True)
            if kart.in_race and not (kart.connected and memory.ready and kart.acknowledged)
        )
        missing = _unfit(view) or missing
        in_time = state is GRID_ACTIVE and facts.grid_last and bool(racing)
        in_time = in_time and not view.record_fails
        allowed = in_time and not missing and facts.saved and view.nobody_since is None
        return Judgement(allowed, False, missing * in_time, numbers)
    if kind == 'RACE_OVER':
        return Judgement(state is not IN_GARAGE)
    if kind == 'IN_GARAGE':
        if state is RED_RED:
            # The MSR answers for those who are not there, and for nobody else.
            waiting = [kart for kart in racing if kart.connected or not view.msr_used]
            if view.past_unknown:
                waiting += [
                    kart
                    for kart in view.karts
                    if kart.connected and not kart.in_race and _red(kart)
                ]
            # And the statement for those of whom nothing is known.
            silent = tuple(
                sorted(
                    kart.number
                    for kart in waiting
                    if not (_stands(kart) or _is_away(kart) or _is_covered(view, kart))
                )
            )
        elif state is GRID_ACTIVE:
            silent = _as_named(k for k in racing if k.moving or (k.doubt and not k.connected))
        else:
            return Judgement(False)
        return Judgement(not silent, True, silent, () if silent else _sent_home(view))
    if kind == 'OPEN_TRACK':
        allowed, unsafe = _humans_allowed(view)
        return Judgement(allowed, view.unstated, unsafe)
    if kind == 'CLOSE_TRACK':
        return Judgement(True)
    if kind == 'SET_HEAT':
        return Judgement(state is IN_GARAGE and bool(view.heats))
    if kind == 'READ_ROSTER':
        return Judgement(state is IN_GARAGE)
    if kind == 'TAKE_ROSTER':
        return Judgement(False)
    kart = next(kart for kart in view.karts if kart.number == number)
    if kind == 'KART_FINISH':
        drives = kart.in_race and kart.connected and kart.hold is None
        return Judgement(drives and state is GREEN_GREEN and not kart.place)
    if kind == 'KART_UNDO_FINISH':
        # Only while the order of FINISH of its race is not told.
        return Judgement(kart.place > 0 and bool(view.starters), True)
    if kind == 'KART_IN_GARAGE':
        return Judgement(_red(kart), not (kart.connected and _stands(kart)), (), (number,))
    if kind == 'JOIN_RACE':
        return Judgement(
            not kart.in_race and state is IN_GARAGE and not _uninspected(view, [kart])
        )
    assert kind == 'LEAVE_RACE', kind
    return Judgement(kart.in_race and state in (IN_GARAGE, GRID_ACTIVE))


def _sent_home(view: View) -> tuple[int, ...]:
    """Return whom IN_GARAGE for the race sends IN_GARAGE."""
    after = expect(view, command('IN_GARAGE'), None)
    return tuple(
        kart.number
        for kart, then in zip(view.karts, after.karts, strict=True)
        if then.sent is IN_GARAGE and kart.sent is not IN_GARAGE
    )


def _seen(view: View, kind: str, number: int) -> dict[str, Any]:
    """Return what an official names with a command who sees the race as it is."""
    if kind == 'IN_GARAGE':
        return {'karts': frozenset(_sent_home(view))}
    if kind == 'KART_IN_GARAGE':
        (hold,) = (kart.hold for kart in view.karts if kart.number == number)
        return {'hold': hold}
    if kind not in NAMING:
        return {}
    racing = {'karts': frozenset([kart.number for kart in view.karts if kart.in_race])}
    return {**racing, 'opening': view.opening} if kind == 'GRID_ACTIVE' else racing


def as_seen(view: View, given: inputs.Input) -> inputs.Input:
    """Return a command with what an official names who sees the race as it is."""
    what, kind, number = _about(given)
    return but(given, **_seen(view, kind, number)) if what is inputs.Commanded else given


def is_paused(view: View, kind: str, came: float) -> bool:
    """Return whether a command that came then may have been sent before a stop was seen."""
    return kind in LOOSENING and came < view.paused_until


def objection(view: View, facts: Facts, given: inputs.Commanded, opinion: Judgement) -> str:
    """Return the property that is broken if a command is accepted; empty: none is."""
    (_, kind, number), named = _about(given), given.command
    if _is_barred(view, given):
        return 'uninspected'
    finish = named.run, named.race, named.attempt
    if kind == 'KART_FINISH' and named.run and finish != finishes(view, named.kart)[0]:
        return 'finish-other'
    if not opinion.allowed or kind == 'READ_ROSTER':  # of no kart
        return 'availability'
    if is_paused(view, kind, given.came):
        return 'pause'
    seen = _seen(view, kind, number)
    if any(getattr(named, name) != value for name, value in seen.items()):
        return 'as-seen'
    if opinion.needs_statement and not named.statement:
        return 'statement'
    is_heat = kind != 'SET_HEAT' or named.heat in [heat.name for heat in view.heats]
    return '' if is_heat else 'availability'


def finishes(view: View, number: int) -> list[tuple[str, int, int]]:
    """Return what a FINISH of a kart may name: what is under way, then what is not."""
    (attempt,) = (kart.attempt for kart in view.karts if kart.number == number)
    return [
        (RUN, view.number, attempt),
        ('another run', view.number, attempt),
        (RUN, view.number - 1, attempt),
        (RUN, view.number, abs(attempt - 1)),
    ]


def _heat_in_race(view: View, facts: Facts) -> str | None:
    """Return the name of the heat in the race; empty: none is."""
    racing = {kart.number for kart in view.karts if kart.in_race}
    fits = any(heat.name == facts.heat and racing <= {*heat.karts} for heat in view.heats)
    return facts.heat if racing and fits else ''


def _is_barred(view: View, given: inputs.Commanded) -> bool:
    """Return whether a command is refused for want of an inspection, if for nothing else."""
    (_, kind, _), named = _about(given), given.command
    concerned = {named.kart}
    if kind == 'GRID_ACTIVE':
        concerned = {kart.number for kart in view.karts if kart.in_race}
    elif kind == 'SET_HEAT':
        concerned = {n for heat in view.heats if heat.name == named.heat for n in heat.karts}
    elif kind != 'JOIN_RACE':
        return False
    return not concerned.isdisjoint(_uninspected(view, view.karts))


def _hear(kart: Any, given: inputs.Heard, settle: float) -> None:
    """Take a kart at its word, or see it take its word back, or move."""
    if not kart.connected:
        return
    if given.state is not kart.sent:
        if given.state is GREEN_GREEN or (kart.acknowledged and _red(kart)):
            kart.doubt = MOVING
        kart.acknowledged, kart.settles_at = False, None
    elif given.serial == kart.serial and not kart.acknowledged:
        kart.acknowledged = True
        if _red(kart):
            kart.settles_at = given.at + settle
            _stand(kart, given.at)


def _stand(kart: Any, now: float) -> None:
    """Take a kart for harmless that has stood by its word for long enough."""
    if kart.settles_at is not None and now >= kart.settles_at:
        kart.doubt, kart.settles_at, kart.lost = HARMLESS, None, False


def _drop(race: Any, kart: Any) -> None:
    """Take the connection away from a kart that has one."""
    kart.connected, kart.acknowledged, kart.settles_at = False, False, None
    kart.link = NOT_MEASURED
    if kart.doubt or (kart.in_race and race.state is not IN_GARAGE):
        kart.lost = True
    if kart.doubt == MOVING or (kart.in_race and race.state in UNDER_WAY):
        kart.hold = RED_RED


def expect(view: View, given: Any, times: Any) -> View:
    """
    Return the race after an input, as docs/rules.md has it; serials apart.

    :param given: if it is a command, there is no ``objection`` to it.
    """
    (what, kind, number), now = _about(given), given.at
    race: Any = SimpleNamespace(**view._asdict())

    def pause(seconds: float) -> None:
        race.paused_until = max(race.paused_until, now + seconds)

    if kind in STOPS:
        pause(times.pause)
    if what in (inputs.Saved, inputs.Delivered):
        return view
    karts: list[Any] = [SimpleNamespace(**kart._asdict()) for kart in view.karts]
    mine = next((kart for kart in karts if kart.number == number), karts[0])
    resent = None

    def hold(red: RaceState, *chosen: Any) -> None:
        for kart in chosen:
            kart.hold = _stricter(red, kart.hold)

    if what is inputs.Connected:
        if mine.connected:
            _drop(race, mine)
        mine.connected, mine.went_silent_at = True, None
        if mine.doubt != MOVING:
            mine.lost = False
        resent = mine
    elif what is inputs.Disconnected:
        if mine.connected:
            _drop(race, mine)
            mine.went_silent_at = now if given.silent else None
    elif what is inputs.Contested:
        mine.contested = given.contested
    elif what is inputs.Measured:
        mine.link = given.link if mine.connected else mine.link
    elif what is inputs.Heard:
        _hear(mine, given, times.settle_time)
    elif what is inputs.Rival:
        race.has_rival = given.present
    elif what is inputs.Attended:
        race.there = given.there
        if given.there.able_to_stop:
            race.nobody_since = None
        elif view.there.able_to_stop:
            race.nobody_since = now
    elif what is inputs.RecordTrouble:
        race.record_fails = given.text
    elif what is inputs.CutOff:
        race.cut_off_by = given.reason
    elif what is inputs.Stalled:
        pause(max(times.pause, times.pause_after_stall))
        for kart in karts:
            if kart.settles_at is not None:
                kart.settles_at = now + times.settle_time
    elif what is inputs.Tick:
        for kart in karts:
            _stand(kart, now)
            if kart.flag_at is not None and now >= kart.flag_at:
                kart.flag_at = None
                hold(RED_FLAG, kart)
        _send(race, karts, None, now)
        if race.starters and _race_is_over(race.state, karts, now, times):
            race.state, race.over, race.starters = RED_RED, True, ()
        if is_abandoned(view, now, times) and race.state in IN_MOTION:
            race.state = RED_FLAG
            pause(times.pause)
    elif kind in ('ALL_KILL', 'RECORD_MSR'):
        race.state, race.msr_used = RED_RED, race.msr_used or kind == 'RECORD_MSR'
        for kart in karts:
            kart.doubt = MOVING if _is_unanswered(view, kart) else kart.doubt
        hold(RED_RED, *karts)
    elif kind == 'RED_FLAG':
        race.state = _stricter(race.state, RED_FLAG)
    elif kind in KART_STOPS:
        mine.doubt = MOVING if _is_unanswered(view, mine) else mine.doubt
        mine.held_alone = True
        hold(RED_RED if kind == 'KART_RED_RED' else RED_FLAG, mine)
    elif kind == 'GRID_ACTIVE' and race.state is GRID_ACTIVE:
        pass
    elif kind == 'GRID_ACTIVE':
        race.state, race.msr_used, race.starters = GRID_ACTIVE, False, ()
        race.track_open, race.nobody_since = False, None
        race.number = race.grids = race.grids + 1
        race.race_since = now
        for kart in karts:
            kart.place = kart.attempt = 0
    elif kind == 'GREEN_GREEN':
        race.state = GREEN_GREEN
        race.starters = tuple(kart.number for kart in karts if kart.in_race)
    elif kind == 'RACE_OVER':
        race.state, race.over, race.starters = RED_RED, True, ()
    elif kind == 'IN_GARAGE':
        race.state, race.over, race.msr_used, race.starters = IN_GARAGE, False, False, ()
        race.past_unknown, race.unstated = False, view.unstated and not view.past_unknown
        for kart in karts:
            kart.flag_at = None
            kept = kart.held_alone and not kart.in_race
            covered = _is_covered(view, kart)
            if (_stands(kart) and not kept) or _is_away(kart) or covered:
                kart.hold, kart.held_alone = None, False
            if covered:
                kart.lost = False
    elif kind == 'KART_FINISH':
        mine.place = 1 + max(kart.place for kart in karts)
        mine.flag_at = now + times.finish_delays[: mine.place][-1]
    elif kind == 'KART_UNDO_FINISH':
        gone, mine.place, mine.flag_at = mine.place, 0, None
        mine.attempt += 1
        for kart in karts:
            kart.place -= kart.place > gone
    elif kind == 'KART_IN_GARAGE':
        mine.hold, mine.held_alone, mine.doubt = None, False, HARMLESS
        mine.settles_at, mine.flag_at, mine.lost = None, None, False
        mine.in_race = mine.in_race and race.state is IN_GARAGE
    elif kind == 'JOIN_RACE':
        mine.in_race = True
    elif kind == 'LEAVE_RACE':
        mine.in_race = False
        if race.state is GRID_ACTIVE:
            hold(RED_RED, mine)
    elif kind == 'SET_HEAT':
        (chosen,) = (heat.karts for heat in view.heats if heat.name == given.command.heat)
        for kart in karts:
            kart.in_race = kart.number in chosen
    elif kind == 'OPEN_TRACK':
        race.track_open, race.unstated, race.opening = True, False, race.opening + 1
    else:
        assert kind == 'CLOSE_TRACK', given
        race.track_open = False
    if is_cut_off(view, given):
        race.state, race.msr_used, race.past_unknown = RED_RED, False, True
        race.track_open, race.opening = True, race.opening + 1
        pause(times.pause)
        hold(RED_RED, *karts)
    _send(race, karts, resent, now)
    if race.state is IN_GARAGE:
        race.number = 0
    race.karts = tuple([_kart_view(vars(kart).values()) for kart in karts])
    return _view(vars(race).values())


def is_cut_off(view: View, given: Any) -> bool:
    """Return whether race control is cut off by this, or can only take itself for that."""
    if type(given) is not inputs.Disconnected:
        return type(given) is inputs.CutOff and bool(given.reason) and not view.cut_off_by
    if not given.silent or view.state is RED_RED:
        return False
    in_garage = view.state is IN_GARAGE
    concerned = [kart for kart in view.karts if kart.in_race or in_garage]
    if not any(kart.number == given.kart and kart.connected for kart in concerned):
        return False
    others = [kart for kart in concerned if kart.number != given.kart]
    lately = [
        kart
        for kart in others
        if kart.went_silent_at is not None and given.at - kart.went_silent_at <= 2.0
    ]
    if not lately:
        # One alone is no sign of that while any other kart is heard.
        return not in_garage and not any(
            kart.connected for kart in view.karts if kart.number != given.kart
        )
    return not any(kart.connected for kart in others)


def _send(race: Any, karts: list[Any], resent: Any, now: float) -> None:
    """
    Give every kart what the sentence of docs/rules.md says.

    :param resent: a kart that is given it although it is being sent that; None: none is.
    """
    for kart in karts:
        sent = _stricter(race.state if kart.in_race else IN_GARAGE, kart.hold)
        if sent is not kart.sent:
            kart.sent, kart.sent_since = sent, now
        elif kart is not resent:
            continue
        kart.acknowledged, kart.settles_at, kart.ordered_at = False, None, now
        if not kart.connected:
            continue
        if sent is GREEN_GREEN or _red(kart):
            # If it is covered, nobody has seen it move, and nobody but it knows more.
            kart.doubt = kart.doubt if _is_covered(race, kart) else MOVING
        elif kart.doubt != MOVING:
            kart.doubt = ON_GRID if sent is GRID_ACTIVE else HARMLESS


def _race_is_over(state: RaceState, karts: list[Any], now: float, times: Any) -> bool:
    if not times.auto_race_over or state not in (GREEN_GREEN, RED_FLAG):
        return False
    racing = [kart for kart in karts if kart.in_race]
    return bool(racing) and all(
        kart.place
        and kart.flag_at is None
        and ((kart.acknowledged and _red(kart)) or now >= kart.sent_since + times.finish_stop)
        for kart in racing
    )


def expect_alerts(view: View, now: float, times: Any) -> set[tuple[str, int]]:
    """Return the alerts of docs/rules.md: which, and of which kart."""
    alerts = set()
    for kart in view.karts:
        if kart.lost:
            if kart.moving:
                alerts.add(('LOST_IN_MOTION', kart.number))
            elif not kart.connected:
                alerts.add(('KART_LOST', kart.number))
        if kart.connected and kart.moving and kart.sent in (IN_GARAGE, GRID_ACTIVE):
            alerts.add(('MOVING_UNASKED', kart.number))
        if kart.in_race and kart.link.grade is Grade.POOR:
            alerts.add(('LINK_POOR', kart.number))
        if kart.contested:
            alerts.add(('TWO_PROGRAMS', kart.number))
        if kart.acknowledged or _is_covered(view, kart):
            continue
        if kart.sent is GRID_ACTIVE and now >= kart.sent_since + times.ready_alert:
            alerts.add(('NOT_READY', kart.number))
        if not kart.connected:
            continue
        if kart.sent is GREEN_GREEN and now >= kart.sent_since + times.green_alert:
            alerts.add(('GREEN_UNACKNOWLEDGED', kart.number))
        # A kart that was not lost in motion has the whole time from when it comes.
        since = kart.sent_since if kart.lost else kart.ordered_at
        if kart.sent is RED_FLAG and now >= since + times.flag_alert:
            alerts.add(('FLAG_UNACKNOWLEDGED', kart.number))
        if kart.sent is RED_RED and now >= since + times.red_alert:
            alerts.add(('RED_UNACKNOWLEDGED', kart.number))
    if view.track_open and not _humans_allowed(view)[0]:
        alerts.add(('TRACK_UNSAFE', 0))
    if view.has_rival:
        alerts.add(('TWO_RACE_CONTROLS', 0))
    if view.record_fails:
        alerts.add(('RECORD_FAILING', 0))
    if view.state in IN_MOTION and view.nobody_since is not None:
        alerts.add(('NOBODY_THERE', 0))
    if view.there.button_fault:
        alerts.add(('BUTTON_FAULT', 0))
    return alerts


def learn(before: View, facts: Facts, given: Any, after: View, gridded: int) -> Facts:
    """
    Return what the oracle remembers after an input that was not refused.

    :param gridded: what the disk is given now says of the grid.
    """
    what, kind, number = _about(given)
    if after == before and what is inputs.Heard:
        return facts
    grid_last, _, saved, heat = facts
    if kind and kind not in NO_BUTTON:
        grid_last = kind == 'GRID_ACTIVE'
    saved = given.gridded == gridded if what is inputs.Saved else saved
    saved = saved or after.state is not GRID_ACTIVE
    if kind == 'SET_HEAT' and heat is not None:
        heat = given.command.heat
    karts = []
    for old, kart, memory in zip(before.karts, after.karts, facts.karts, strict=True):
        ready, phase, stood = memory
        if what is inputs.Heard and number == kart.number and old.connected:
            if old.sent is GRID_ACTIVE:
                ready = given.state is GRID_ACTIVE and (ready or given.serial == old.serial)
            if given.state is not old.sent:
                stood = None
            elif given.state in REDS and given.serial == old.serial and stood is None:
                stood = given.at
        if kart.serial != old.serial or not kart.connected:
            ready, stood = False, None
        saved = saved and (kart.serial == old.serial or kart.sent is not GRID_ACTIVE)
        if what is inputs.Stalled and stood is not None:
            stood = given.at
        if kart.sent is RED_RED or kart.sent is RED_FLAG:
            phase = 0
        elif kart.sent is IN_GARAGE:
            phase = 1
        elif kart.sent is GRID_ACTIVE and phase == 1:
            phase = 2
        karts.append(KartFacts(ready, phase, stood))
    return Facts(grid_last, tuple(karts), saved, heat)


# ----- the properties ---------------------------------------------------------------------


def check_input(
    race: Any, before: View, facts: Facts, given: Any, outcome: Any, after: View
) -> Facts:
    """
    Check one input and all that came of it, and return what there is to remember.

    The S rules are asserted one by one and on their own, before the whole effect is compared:
    they must hold even if the oracle's expectation of the effect were wrong.
    """
    (what, kind, number), now = _about(given), given.at
    if after.state is GREEN_GREEN and before.state is not GREEN_GREEN:
        known = zip(before.karts, facts.karts, strict=True)
        racing = [(kart, memory) for kart, memory in known if kart.in_race]
        broken: dict[str, Any] = {
            'green-needs-grid': not facts.grid_last,
            'no-record': before.record_fails,
            'start-first': not facts.saved,
            'green-needs-acks': not all(m.ready and kart.connected for kart, m in racing),
            'nobody-there': before.nobody_since is not None,
            'contested': any(kart.contested for kart, _ in racing),
        }
        _none_of(broken, facts, before)
    if what is inputs.Commanded:
        answer = outcome.answer
        if (
            kind in STOPS
            and (given.command.statement or kind != 'RECORD_MSR')
            and not answer.success
        ):
            raise RuleBrokenError('stop-refused', f'{given} in {before}: {answer}')
        opinion = judge(before, facts, kind, number)
        objected = objection(before, facts, given, opinion)
        if answer.success is bool(objected):
            raise RuleBrokenError(objected or 'availability', f'{given} in {before}: {answer}')
        if not answer.success:
            paused = before.paused_until
            if kind in STOPS:
                paused = max(paused, now + race.times.pause)
            if after != before._replace(paused_until=paused) or outcome.orders:
                raise RuleBrokenError('refused-changes', f'{given}: {before} became {after}')
            _check_refusal(race, before, given, opinion, answer.message, objected == 'pause')
            return facts
    _check_safety(before, facts, given, outcome, after, race.times)
    _check_events(race, before, given, outcome, after)
    memory = learn(
        before, facts, given, after, race.memory().gridded if what is inputs.Saved else 0
    )
    if what in (inputs.Connected, inputs.Disconnected) and not is_cut_off(before, given):
        _check_alarms(
            given,
            expect_alerts(before, now, race.times),
            {(alert.kind.name, alert.kart) for alert in race.alerts(now)},
        )
    for kart, known in zip(after.karts, memory.karts, strict=True):
        if kart.sent is GREEN_GREEN and known.phase != 2:
            raise RuleBrokenError('red-to-green', f'{kart} {known}')
    expected = expect(before, given, race.times)
    if after == expected:
        return memory
    for kart, wanted in zip(after.karts, expected.karts, strict=True):
        if kart == wanted or kart._replace(serial=wanted.serial) == wanted:
            continue
        differs = kart.acknowledged != wanted.acknowledged
        broken = {
            'sent-wrong': kart.sent is not wanted.sent,
            'ack-deaf': differs and wanted.acknowledged and what is inputs.Heard,
            'ack-old': differs,
            'effect': True,
        }
        _none_of(broken, given, before, kart, 'expected', wanted)
    _none_of({'effect': after[:-1] != expected[:-1]}, given, before, after, 'expected', expected)
    return memory


def _is_unknown(view: View) -> bool:
    """Return whether all is as after a restart that knows nothing."""
    all_red = all(kart.hold is kart.sent is RED_RED for kart in view.karts)
    open_to_worst = view.past_unknown and view.track_open and not view.msr_used
    return view.state is RED_RED and all_red and open_to_worst


def _check_events(race: Any, before: View, given: Any, outcome: Any, after: View) -> None:
    """Check what is told: why the state of the race changed, who has answered, and who won."""
    kind = _about(given)[1]
    if not (kind or outcome.events or before.starters or after.state is not before.state):
        return
    told: dict[str, list[Any]] = defaultdict(list)
    for event in outcome.events:
        told[event.kind.name].append(event)
    changes, results = told['RACE_STATE'], [event.text for event in told['ORDER_OF_FINISH']]
    official = (kind, OFFICIAL) if kind else False
    cause = race.state_cause
    wrong = len(changes) != (after.state is not before.state)
    for event in changes:
        named = event.command is not None and (event.command.name, event.official)
        wrong |= named != official or not cause or cause not in event.text
        wrong |= f'{kind} by {OFFICIAL}' not in cause if official else OFFICIAL in cause
    answered = all(
        (kart.acknowledged and (_stands(kart) or not _red(kart))) or _is_covered(after, kart)
        for kart in (after.karts if told['ALL_ACKNOWLEDGED'] else ())
        if kart.in_race and kart.connected
    )
    # The order of FINISH comes once, with every kart that started.
    ends = kind in ('RACE_OVER', 'IN_GARAGE') or (after.over and not before.over)
    due = bool(before.starters) and ends
    complete = len(results) == due and not (due and after.starters)
    for text in results:
        finished, _, missing = text.partition('did not finish')
        complete = complete and all(
            f'{kart.place}. kart {kart.number}' in finished
            if kart.place
            else f'kart {kart.number}' in missing
            for kart in before.karts
            if kart.number in before.starters
        )
    broken: dict[str, Any] = {
        'told-first': kind and outcome.events[0].kind.name != 'COMMAND',
        'cause': wrong,
        'false-news': not answered,
        'results': not complete,
    }
    _none_of(broken, given, before, after, cause, outcome.events)


def _check_safety(
    before: View,
    facts: Facts,
    given: Any,
    outcome: Any,
    after: View,
    times: Any,
) -> None:
    """Check the S rules that need no expectation of the effect."""
    (what, kind, number), now = _about(given), given.at
    least = RED_FLAG if kind == 'RED_FLAG' else RED_RED

    def acts(**apart: Any) -> bool:
        return bool(outcome.orders) or after._replace(**apart) != before

    broken: dict[str, Any] = {
        'cut-off': is_cut_off(before, given) and not _is_unknown(after),
        'nobody-there': what is inputs.Tick
        and after.state in IN_MOTION
        and is_abandoned(before, now, times),
        'there-acts': what is inputs.Attended
        and acts(there=before.there, nobody_since=before.nobody_since),
        'track-open-in-motion': after.track_open and after.state in IN_MOTION,
        'stop-idempotent': kind in STOPS
        and _in_force(before, kind, number)
        and acts(paused_until=before.paused_until),
        'stop-at-once': kind in RACE_STOPS and RANK[after.state] < RANK[least],
    }
    _none_of(broken, given, before, after)
    ordered: dict[int, Any] = {}
    for order in outcome.orders:
        earlier = ordered.setdefault(order.kart, order)
        # A finish and the end of the race may fall due together: then the last order counts.
        stricter = order.serial > earlier.serial and RANK[order.state] > RANK[earlier.state]
        if earlier is not order and not (what is inputs.Tick and stricter):
            raise RuleBrokenError('order-wrong', f'two orders to one kart: {outcome.orders}')
        ordered[order.kart] = order
    for old, kart, known in zip(before.karts, after.karts, facts.karts, strict=True):
        this, order = number == kart.number, ordered.get(kart.number)
        if kart == old and not (this or order or kind in RACE_STOPS):
            continue
        was, sent = old.sent, kart.sent
        looser, was_red = RANK[sent] < RANK[was], _red(old)
        anew, drops = (
            this and what is inputs.Connected,
            this and what in (inputs.Connected, inputs.Disconnected),
        )
        heard = this and what is inputs.Heard and old.connected
        answers = heard and given.state is was and given.serial == old.serial
        unasked = heard and given.state is not was
        by_hand = this and kind == 'KART_IN_GARAGE'
        home = kind == 'IN_GARAGE'
        undone = this and kind == 'KART_UNDO_FINISH'
        held = kart.hold is sent is RED_RED
        falls = old.hold and (kart.hold is None or RANK[kart.hold] < RANK[old.hold])
        goes_home = (old.connected and _stands(old)) or _is_away(old) or _is_covered(before, old)
        flag, flag_now = old.flag_at, kart.flag_at
        flagged = home or by_hand or undone or (what is inputs.Tick and _red(kart))
        seen = unasked and (given.state is GREEN_GREEN or (old.acknowledged and was_red))
        told = order and (order.state is GREEN_GREEN or order.state in REDS)
        gridded = order and order.state is GRID_ACTIVE
        sent_home = order and order.state is IN_GARAGE and not old.moving
        may_stand = was_red and (
            answers or (what is inputs.Tick and old.acknowledged and old.connected)
        )
        stood = known.stood if what is not inputs.Heard else known.stood or now
        acknowledges = kart.acknowledged and not old.acknowledged
        broken = {
            'stop-loosens': looser and kind in STOPS,
            'membership-loosens': looser
            and was_red
            and kind in ('JOIN_RACE', 'LEAVE_RACE', 'SET_HEAT'),
            'red-loosened': looser and was_red and not (home or by_hand),
            'green-only-by-command': sent is GREEN_GREEN is not was and kind != 'GREEN_GREEN',
            'finish-put-off': flag is not None
            and (not flagged if flag_now is None else flag_now > flag),
            'alone-released': falls and home and old.held_alone and not old.in_race,
            'hold-forgotten': falls and not (by_hand or (home and goes_home)),
            'drop-not-held': drops
            and old.connected
            and not held
            and (old.moving or (old.in_race and before.state in UNDER_WAY)),
            'rival': looser and before.has_rival,
            'cut-off': looser and before.cut_off_by,
            'ack-stale': unasked and old.acknowledged and kart.acknowledged,
            'doubt-unnoticed': (gridded and not kart.doubt)
            or (not kart.moving and (seen or (told and not _is_covered(after, old)))),
            'doubt-forgotten': kart.doubt < old.doubt and not (may_stand or by_hand or sent_home),
            'settle': old.moving
            and not (kart.doubt or by_hand)
            and (stood is None or now < stood + times.settle_time),
            'order-wrong': bool(order) != (kart.connected and (anew or sent is not was))
            or (order and (order.state is not sent or order.serial != kart.serial)),
            'order-serial': kart.serial < old.serial
            or (kart.connected and bool(order) is (kart.serial == old.serial)),
            'ack-survives': kart.acknowledged
            and (anew or sent is not was or order or not kart.connected),
            'ack-from-nothing': acknowledges and not (this and what is inputs.Heard),
            'ack-old': acknowledges and not answers,
            'stop-at-once': (
                not held
                and (kind in ('ALL_KILL', 'RECORD_MSR') or (kind == 'KART_RED_RED' and this))
            )
            or (
                not _red(kart)
                and ((kind == 'RED_FLAG' and kart.in_race) or (kind == 'KART_RED_FLAG' and this))
            ),
        }
        _none_of(broken, given, old, kart, order)


MSR_ALERTS = ('FLAG_UNACKNOWLEDGED', 'RED_UNACKNOWLEDGED', 'LOST_IN_MOTION', 'TRACK_UNSAFE')


def _check_alarms(given: Any, before: set[tuple[str, int]], after: set[tuple[str, int]]) -> None:
    """Check that what a kart's connection does ends no alarm, nor makes one less urgent."""
    for kind, kart in before:
        same = [other for other, number in after if number == kart]
        urgent = kind in MSR_ALERTS
        if urgent and not any(other in MSR_ALERTS for other in same):
            raise RuleBrokenError('alarm-cleared', f'{given}: {before} became {after}')
        if type(given) is inputs.Disconnected and not same and kind != 'LINK_POOR':
            raise RuleBrokenError('alarm-cleared', f'{given}: {before} became {after}')


def check_recovery(
    rules: ModuleType, race: Any, view: View, now: float, known: bool, last_run: Any
) -> None:
    """
    Crash here, edit the last kart out of the roster, start again, and look what is known.

    :param known: the memory is not lost.
    :param last_run: what is known of how the last run ended: a ``LastRun``.
    """
    roster = [kart.number for kart in view.karts][:-1]
    karts = [
        rules.Kart(number, in_race=True, inspected=race.karts[number].inspected)
        for number in roster
    ]
    again = rules.Race([*karts, rules.Kart(99, in_race=True)], race.times, now, race.heats)
    fresh = look(again)
    memory = race.memory()
    home = view.state is IN_GARAGE and not any(kart.hold or kart.doubt for kart in view.karts)
    ends = ('NONE' if view.unstated else 'ENDED_OPEN' if view.track_open else 'ENDED') * home
    if memory.at_rest != home or memory.ends_as.name != (ends or 'UNKNOWN'):
        raise RuleBrokenError('restart', f'{memory.at_rest=}, {memory.ends_as} in {view}')
    outcome = again.recover(memory if known else None, last_run, now)
    after = look(again)
    after = after._replace(karts=tuple(kart._replace(serial=0) for kart in after.karts))
    if last_run.name != 'UNKNOWN' and (home or not known):
        is_open = last_run.name == 'ENDED_OPEN'
        wanted = fresh._replace(
            track_open=is_open, opening=int(is_open), unstated=last_run.name == 'NONE'
        )
        if outcome.orders or after != wanted:
            raise RuleBrokenError('restart', f'{view} became {after}, expected {wanted}')
        return
    remembered = {
        old.number: old
        for old in view.karts * known
        if old.number in roster or old.in_race or old.hold or old.doubt
    }
    # A kart that the roster lacks is one of which nothing is known but what is remembered.
    gone = [number for number in remembered if number not in roster]
    lacking = look(rules.Race([rules.Kart(number) for number in gone], race.times))
    found = []
    for kart in (*fresh.karts, *lacking.karts):
        if old := remembered.get(kart.number):
            may_start = view.state is GRID_ACTIVE and old.in_race and old.doubt
            doubt = MOVING if may_start else old.doubt
            kart = kart._replace(
                in_race=old.in_race and kart.number in roster,
                place=old.place,
                doubt=doubt,
                held_alone=old.held_alone,
                lost=bool(doubt),
            )
        found.append(kart)
    starters = tuple(number for number in view.starters * known if number in remembered)
    races = int(bool(starters))
    known_now = fresh._replace(starters=starters, number=races, grids=races, karts=tuple(found))
    wanted = expect(known_now, inputs.CutOff(now, 'no cable'), race.times)._replace(
        cut_off_by='',
        # What was sent to the last run is not taken.
        paused_until=now + max(race.times.pause, race.times.pause_after_stall),
    )
    named = {event.kart for event in outcome.events}
    if outcome.orders or after != wanted or not named.issuperset(gone):
        raise RuleBrokenError('restart', f'{view} became {after}, expected {wanted}: {outcome}')
    check_state(again, look(again), recall(after, None), now)


def _in_force(view: View, kind: str, number: int) -> bool:
    """Return whether a stop has nothing left to do."""
    if kind == 'RED_FLAG':
        return view.state in REDS
    if kind in KART_STOPS:
        rank = RANK[RED_RED if kind == 'KART_RED_RED' else RED_FLAG]
        return all(
            kart.held_alone and kart.hold is not None and RANK[kart.hold] >= rank
            for kart in view.karts
            if kart.number == number
        )
    done = view.state is RED_RED and all(
        kart.hold is RED_RED and not _is_unanswered(view, kart) for kart in view.karts
    )
    return done and (kind == 'ALL_KILL' or view.msr_used)


def _check_refusal(
    race: Any, view: View, given: inputs.Commanded, opinion: Judgement, message: str, late: bool
) -> None:
    """
    Check that a refusal says what an official can act on.

    :param late: a pause refuses it.
    """
    (_, kind, _), of = _about(given), given.command
    if not message.startswith(f'{kind} refused: ') or message.endswith('refused: .'):
        raise RuleBrokenError('refusal-silent', message)
    named = opinion.culprits[:3]
    known = of.heat in [heat.name for heat in race.heats]
    heats = race.heats if kind == 'SET_HEAT' and opinion.allowed and not known else ()
    if any(heat.name not in message for heat in heats):
        raise RuleBrokenError('refusal-silent', f'{message} does not name the heats')
    if late or (kind in LOOSENING and (view.has_rival or view.cut_off_by)):
        return
    if kind in KART_COMMANDS and 'the race is in' not in message:
        named = (of.kart,)
    elif (
        opinion.allowed
        and 'changed since you looked' in message
        and any(str(number) not in message for number in of.karts ^ set(opinion.karts))
    ):
        raise RuleBrokenError('refusal-silent', f'{message} does not name the difference')
    for number in named:
        if str(race.karts[number]) not in message:
            raise RuleBrokenError('refusal-silent', f'{message} does not name kart {number}')


def check_state(race: Any, view: View, facts: Facts, now: float) -> None:
    """Check what must hold in every state, whatever the input was that led here."""
    access = race.track_access()
    allowed, unsafe = _humans_allowed(view)
    allowed = allowed and (view.msr_used or not view.unstated)
    settled_by = None
    if not allowed and not unsafe and view.state not in IN_MOTION:
        settled_by = 'IN_GARAGE' if view.past_unknown else 'OPEN_TRACK'
    wanted = view.track_open, allowed, view.msr_used, view.opening, settled_by
    told_by = access.settled_by and access.settled_by.name
    told = race.alerts(now)
    alerts = {(alert.kind.name, alert.kart) for alert in told}
    # Where every kart that may have moved has acknowledged its stop, to clear the track is enough.
    obeys = (kart.acknowledged and kart.sent in REDS for kart in view.karts if kart.doubt)
    harmless = all(obeys) and 'TRACK_UNSAFE'
    for_msr = [kind for kind in MSR_ALERTS if kind != harmless and not view.msr_used]
    memory_is_wrong = False
    if view.state is GRID_ACTIVE:
        memory, at_end = race.memory(), race.memory(ended=True).karts
        gridded = (kart.number for kart in view.karts if kart.in_race and kart.doubt)
        memory_is_wrong = (
            memory.at_rest
            or any(memory.karts[each].doubt != MOVING for each in gridded)
            or any(at_end[kart.number].doubt != kart.doubt for kart in view.karts)
        )
    broken: dict[str, Any] = {
        'track-access': (access.open, access.allowed, access.msr_used, access.opening, told_by)
        != wanted
        or not access.reason
        or any(str(race.karts[number]) not in access.reason for number in unsafe[:3]),
        'heat': facts.heat is not None and race.heat != _heat_in_race(view, facts),
        'alerts': alerts != expect_alerts(view, now, race.times) or not all(a.text for a in told),
        'use-msr': any(a.use_msr != (a.kind.name in for_msr) for a in told),
        'start-memory': memory_is_wrong,
        'alerts-act': look(race) != view,
    }
    _none_of(broken, view, facts, access, race.heat, told)


def check_announced(
    race: Any, view: View, facts: Facts, kind: str, number: int, now: float
) -> Judgement:
    """Check the announced availability of a command against the oracle's judgement."""
    opinion = judge(view, facts, kind, number)
    told = race.availability(CommandKind[kind], number, now)
    paused = opinion.allowed and is_paused(view, kind, now)
    if paused:
        opinion = opinion._replace(allowed=False)
    allowed = opinion.allowed
    if told.available_from != (view.paused_until if paused else None):
        raise RuleBrokenError('available-from', f'{told} in {view}')
    if told.available != allowed or told.command.name != kind:
        raise RuleBrokenError('availability', f'{told}, expected {opinion} in {view}')
    if allowed and bool(told.statement) != opinion.needs_statement:
        raise RuleBrokenError('statement', f'{told}, expected {opinion} in {view}')
    if told.karts != (opinion.karts if allowed else ()):
        raise RuleBrokenError('as-seen', f'{told}, expected {opinion} in {view}')
    return opinion


# ----- the exhaustive search --------------------------------------------------------------


Loaded = tuple[dict[str, Any], list[tuple[Any, ...]]]
Key = tuple[int, ...]


class Scratch:
    """
    One race into which states are loaded, which is several times faster than to copy a race.

    It knows no attribute of the rules by name, only that karts are slotted and that lists and
    dictionaries of the race hold nothing mutable.
    """

    def __init__(self, race: Any) -> None:
        self.race = race
        self.karts = list(race.karts.values())
        self._names = self.karts[0].__slots__
        self._getter = operator.attrgetter(*self._names)
        self._fields = [name for name in race.__dict__ if name != 'karts']
        self._holders = [
            name for name in self._fields if isinstance(race.__dict__[name], (list, dict))
        ]

    def save(self) -> Loaded:
        own = self.race.__dict__
        fields = {name: own[name] for name in self._fields}
        for name in self._holders:
            fields[name] = fields[name].copy()
        return fields, [self._getter(kart) for kart in self.karts]

    def load(self, saved: Loaded) -> None:
        fields, karts = saved
        own = self.race.__dict__
        own.update(fields)
        for name in self._holders:
            own[name] = fields[name].copy()
        for kart, values in zip(self.karts, karts, strict=True):
            if self._getter(kart) != values:
                for name, value in zip(self._names, values, strict=True):
                    setattr(kart, name, value)


@dataclass
class Report:
    """What a search did."""

    states: int = 0
    inputs: int = 0
    transitions: int = 0
    refusals: int = 0
    pairs_compared: int = 0
    by_state: Counter[RaceState] = field(default_factory=Counter)
    finished: bool = False


@dataclass
class Search:
    """
    Every reachable state, under every input, breadth first.

    What is left out of a state's key (``_key``) because the rules do not read it:

    - whatever only events, alerts and screens are made of: for example what a kart reported last,
      texts, the alerts told, since when a kart is missing (but not that one without doubt is), how
      often the track was opened, how good a link is, and whether the race is over;
    - whether somebody was there, and when they left, but in a race that is in motion without them;
    - the age of what a kart is sent, but for the time until the race goes over by itself, which
      reads it for a kart of the race that has a place and is being sent a red (one that
      acknowledged it may drop, or take its word back, and have to do so again; one that is sent
      a red without a place gets none any more); alerts read it too, and do not act;
    - that a finish is due, where its RED_FLAG can change nothing, and the race does not wait for
      it to go over by itself;
    - the acknowledgement of IN_GARAGE and GREEN_GREEN: no rule asks for it;
    - the number of a place: only whether a kart has one in a race whose results are not told yet
      (later nothing but the telling reads it), which says how many have;
    - who started the race whose results are not told yet: only the telling reads it;
    - the number of the race, and how often a finish was undone: a FINISH names what is shown, or
      something else;
    - when a pause ended, and whether what is on the disk is of an earlier race;
    - which kart is which: no rule knows a number, so states are taken for one if they differ by
      a permutation of the karts. (A heat does know numbers: so here every set of karts is one.)

    That this is right is itself checked (``abstraction``): of the states that have one key, some
    are tried under every input, and must lead to the same keys.

    :param rules: the module of the rules.
    :param racing: how many karts are in the race to begin with.
    :param outside: how many are not.
    :param times: keyword arguments of its ``RaceTimes``; small whole numbers, as time passes by
        steps of 1.
    :param compare: of the states met again, compare one in this many.
    :param around: another race control comes and goes, the record fails and works again, and links
        are poor and good again.
    :param silence: connections are lost since their links stopped answering, too.
    :param network: race control is cut off, and is not any more; two programs connect as a kart,
        or do so no more.
    :param people: those who can stop the race come and go, and a button.
    :param begin: where: in the 'garage', on the 'grid' or in 'green' with every kart of the race
        connected and its word given, after a 'crash' in mid-race, or in a race without its karts,
        which were 'lost on the grid', where all is 'unknown', or at the 'first' start.
    :param then: what happens before the search begins.
    :param uninspected: the karts whose inspection the roster does not have.
    :param without: commands that are not given.
    :param heats: which heat is in the race is looked at; two have all karts.
    :param waits: the disk takes its time, commands come before they are judged, and race control
        is held up. If not, everything is on the disk at once, and there is no pause.
    """

    rules: ModuleType
    racing: int = 2
    outside: int = 1
    times: Any = None
    uninspected: tuple[int, ...] = ()
    compare: int = 4000
    around: bool = False
    silence: bool = False
    network: bool = False
    people: bool = False
    begin: str = 'garage'
    without: Container[str] = ()
    waits: bool = False
    heats: bool = False
    then: Iterable[inputs.Input] = ()

    def __post_init__(self) -> None:
        rules, waits = self.rules, self.waits
        self.times = rules.RaceTimes(
            **{
                'finish_delays': (2.0, 1.0),
                'finish_stop': 1.0,
                'ready_alert': 1.0,
                'green_alert': 1.0,
                'flag_alert': 1.0,
                'red_alert': 1.0,
                'pause': 1.0 if waits else 0.0,
                'pause_after_stall': 2.0,
                'nobody_there': 2.0,
                'settle_time': 1.0,
                **(self.times or {}),
            }
        )
        karts = [
            rules.Kart(
                number,
                in_race=number <= self.racing,
                inspected='' if number in self.uninspected else '2026-05-01',
            )
            for number in range(1, self.racing + self.outside + 1)
        ]
        self.numbers = [kart.number for kart in karts]
        of_roster = [
            rules.Heat(f'heat {chosen}', chosen)
            for size in range(1, len(karts) + 1)
            for chosen in itertools.combinations(self.numbers, size)
        ] + [rules.Heat('the same karts', (*self.numbers,))] * self.heats
        self.race = rules.Race(karts, self.times, heats=of_roster, run=RUN)
        self.commands = [(kind, 0) for kind in RACE_COMMANDS if kind not in self.without]
        for kind in KART_COMMANDS:
            if kind not in self.without:
                self.commands.extend((kind, kart.number) for kart in karts)
        self.scratch = Scratch(self.race)
        self._names: dict[tuple[Any, ...], int] = {}
        self.report = Report()
        self._met = 0

    def _key(self, view: View, facts: Facts, now: float) -> Key:
        state = view.state
        green = state is GREEN_GREEN
        # A race that nobody has started yet, or that is over, does not go over by itself.
        timed = green or (state is RED_FLAG and bool(view.starters))
        karts = [
            self._kart_key(kart, memory, timed, bool(view.starters), now)
            for kart, memory in zip(view.karts, facts.karts, strict=True)
        ]
        karts.sort()
        missed = state in IN_MOTION and view.nobody_since is not None
        race = (
            RANK[state],
            timed,
            facts.grid_last,
            view.track_open,
            view.msr_used,
            view.past_unknown,
            view.unstated,
            view.has_rival,
            view.cut_off_by,
            view.record_fails,
            max(view.paused_until - now, 0.0),
            facts.saved and state is GRID_ACTIVE,
            view.there.able_to_stop,
            missed and (max(view.nobody_since + self.times.nobody_there - now, 0.0),),
            facts.heat,
        )
        return (self._names.setdefault(race, len(self._names)), *karts)

    def _kart_key(
        self,
        kart: KartView,
        memory: KartFacts,
        timed: bool,
        untold: bool,
        now: float,
    ) -> int:
        red = kart.sent is RED_FLAG or kart.sent is RED_RED
        finishing = timed and kart.in_race
        due = left = settles = -1.0
        if kart.settles_at is not None:
            settles = max(kart.settles_at - now, 0.0)
        silent = (
            -1.0 if kart.went_silent_at is None else max(kart.went_silent_at + 2.0 - now, -1.0)
        )
        if kart.flag_at is not None and ((timed and kart.place) or kart.hold is None):
            due = max(kart.flag_at - now, 0.0)
        if finishing and red and kart.place:
            left = max(kart.sent_since + self.times.finish_stop - now, due, 0.0)
        key = (
            kart.in_race,
            kart.connected,
            -1 if kart.hold is None else RANK[kart.hold],
            kart.acknowledged and (red or kart.sent is GRID_ACTIVE),
            kart.doubt,
            kart.held_alone,
            kart.contested,
            silent,
            kart.lost and not (kart.connected or kart.doubt),
            untold and kart.place > 0,
            due,
            left,
            settles,
            memory.ready,
            memory.phase,
        )
        # A number for each, so that a million keys fit into memory.
        return self._names.setdefault(key, len(self._names))

    def run(self, most: int | None = None) -> Report:
        """
        Search until there is nothing new, or until ``most`` states have been searched.

        :raises RuleBrokenError: if the rules break a property, with the shortest way to it.
        """
        facts, now = self._begin()
        view = look(self.race)
        check_state(self.race, view, facts, now)
        saved = self.scratch.save()
        key = self._key(view, facts, now)
        # For each key the state that stands for it, and whence and by what it was reached.
        self._seen: dict[tuple[Any, ...], tuple[Any, Facts, float]] = {key: (saved, facts, now)}
        self._parent: dict[tuple[Any, ...], tuple[tuple[Any, ...], inputs.Input] | None] = {
            key: None
        }
        todo = deque([key])
        # There is no cycle to collect, and ever more to look through.
        collecting = gc.isenabled()
        gc.disable()
        try:
            return self._run(todo, most)
        finally:
            if collecting:
                gc.enable()

    def _begin(self) -> tuple[Facts, float]:
        if self.begin in ('crash', 'lost on the grid', 'unknown'):
            racing = tuple(kart.number for kart in self.race.racing())
            doubt, state, starters = self.rules.Doubt.MOVING, GREEN_GREEN, racing
            if self.begin == 'lost on the grid':
                doubt, state, starters = self.rules.Doubt.GRID, RED_FLAG, ()
            kart = self.rules.KartMemory(True, False, 0, doubt, False)
            karts = dict.fromkeys(racing, kart)
            memory = self.rules.RaceMemory(state, karts, starters=starters)
            known = None if self.begin == 'unknown' else memory
            self.race.recover(known, self.rules.LastRun.UNKNOWN, 0.0)
            return recall(look(self.race), '' if self.heats else None), 0.0
        if self.begin == 'first':
            self.race.recover(None, self.rules.LastRun.NONE, 0.0)
        facts = remember(look(self.race))
        if not self.heats:
            facts = facts._replace(heat=None)
        way: list[inputs.Input] = []
        if self.begin in ('grid', 'green'):
            way += [inputs.Connected(0.0, number) for number in self.numbers]
            way.append(command('GRID_ACTIVE', 0, True))
            way += [inputs.Heard(0.0, number, 2, GRID_ACTIVE) for number in self.numbers]
        if self.begin == 'green':
            way.append(command('GREEN_GREEN'))
        now = 0.0
        for given in (*way, *self.then):
            before = look(self.race)
            now = given.at
            _, facts, _ = self._take(before, facts, as_seen(before, given))
        return facts, now

    def _take(self, view: View, facts: Facts, given: inputs.Input) -> tuple[bool, Facts, View]:
        """
        Give an input to the rules, and tell them that it is on the disk if that is so at once.

        :return: whether it was accepted, or is no command; what is remembered and seen then.
        """
        race = self.race
        outcome = inputs.feed(given, race)
        after = look(race)
        facts = check_input(race, view, facts, given, outcome, after)
        accepted = outcome.answer is None or outcome.answer.success
        if not (facts.saved or self.waits):
            _, facts, after = self._take(
                after, facts, inputs.Saved(given.at, race.memory().gridded)
            )
        return accepted, facts, after

    def _run(self, todo: deque[Key], most: int | None) -> Report:
        while todo:
            if most is not None and self.report.states >= most:
                return self.report
            key = todo.popleft()
            try:
                self._visit(key, todo)
            except RuleBrokenError as violation:
                violation.add_note(f'after {self._way(key)}')
                raise
        self.report.finished = True
        return self.report

    def _way(self, key: tuple[Any, ...]) -> list[inputs.Input]:
        way: list[inputs.Input] = []
        step = self._parent[key]
        while step is not None:
            way.append(step[1])
            step = self._parent[step[0]]
        return way[::-1]

    def _visit(self, key: tuple[Any, ...], todo: deque[tuple[Any, ...]]) -> None:
        saved, facts, now = self._seen[key]
        report, race, scratch = self.report, self.race, self.scratch
        report.states += 1
        scratch.load(saved)
        view = look(race)
        report.by_state[view.state] += 1
        known = bool(report.states % 3)
        last_run = [*self.rules.LastRun][report.states % 4]
        check_recovery(self.rules, race, view, now, known, last_run)
        for given in self._inputs(view, facts, now):
            report.inputs += 1
            accepted, learned, after = self._take(view, facts, given)
            if not accepted:
                report.refusals += 1
                if _about(given)[1] not in STOPS:
                    if scratch.save() != saved:
                        raise RuleBrokenError('refused-changes', f'{given} in {view}')
                    continue
            report.transitions += 1
            if after == view and learned == facts and given.at == now:
                # It changed nothing but what was reported and told; nor, unseen, the last button
                # or what counts as saved.
                if isinstance(given, inputs.Commanded | inputs.Saved):
                    check_announced(race, after, facts, 'GREEN_GREEN', 0, now)
                scratch.load(saved)
                continue
            check_state(race, after, learned, given.at)
            found = self._key(after, learned, given.at)
            if found == key and after == view:
                pass  # time that brings nothing nearer
            elif found not in self._seen:
                self._seen[found] = (scratch.save(), learned, given.at)
                self._parent[found] = (key, given)
                todo.append(found)
            else:
                self._met += 1
                if self.compare and self._met % self.compare == 0:
                    self._compare(found, (scratch.save(), learned, given.at))
            scratch.load(saved)
        if _in_force(view, 'ALL_KILL', 0):
            # From every other state ALL_KILL leads to one of these, and is never refused.
            self._check_homeward(saved, now)

    def _inputs(self, view: View, facts: Facts, now: float) -> Iterator[Any]:
        """Yield every input; the rules are in the state of ``view`` meanwhile."""
        for kind, number in self.commands:
            opinion = check_announced(self.race, view, facts, kind, number, now)
            if kind in ('READ_ROSTER', 'TAKE_ROSTER'):
                continue
            if kind == 'SET_HEAT':
                for heat in view.heats if opinion.allowed else view.heats[:1]:
                    yield command(kind, at=now, heat=heat.name)
                yield command(kind, at=now, heat='no such heat')
                continue
            right = command(kind, number, True, now, **_seen(view, kind, number))
            if opinion.allowed and opinion.needs_statement:
                yield but(right, statement=False)
            yield right
            if kind == 'ALL_KILL':  # whatever it names
                yield but(right, run='another run', race=1, attempt=1)
            if opinion.allowed and not opinion.needs_statement:
                yield but(right, statement=False)
            if opinion.allowed and kind in NAMING:
                yield but(right, karts=right.command.karts ^ {self.numbers[-1]})
            if opinion.allowed and kind == 'GRID_ACTIVE':
                yield but(right, opening=view.opening - 1)
            if opinion.allowed and kind == 'KART_FINISH':
                for run, race, attempt in finishes(view, number):
                    yield but(right, run=run, race=race, attempt=attempt)
            if opinion.allowed and kind == 'KART_IN_GARAGE':
                yield but(right, hold=RED_RED if right.command.hold is None else None)
            if self.waits and kind in LOOSENING:
                yield right._replace(came=view.paused_until - 0.5)
        for kart in view.karts:
            number = kart.number
            for state in RaceState:
                yield inputs.Heard(now, number, kart.serial, state)
            for state in (kart.sent, GREEN_GREEN):
                yield inputs.Heard(now, number, kart.serial - 1, state)
            yield inputs.Connected(now, number)
            for silent in (False, True) if self.silence else (False,):
                yield inputs.Disconnected(now, number, GONE, silent)
            if self.network:
                yield inputs.Contested(now, number, not kart.contested)
        for reason in ('no cable', '') if self.network else ():
            yield inputs.CutOff(now, reason)
        if self.around:
            for kart in view.karts:
                yield inputs.Delivered(now, kart.number, kart.serial, now)
                yield inputs.Measured(now, kart.number, POOR)
                yield inputs.Measured(now, kart.number, GOOD)
            for present, trouble in ((True, 'the disk is full'), (False, '')):
                yield inputs.Rival(now, present)
                yield inputs.RecordTrouble(now, trouble)
        for there in (ANNA, ANNA._replace(button_fault='is gone'), NOBODY) if self.people else ():
            yield inputs.Attended(now, there)
        if self.waits:
            yield inputs.Stalled(now, 2.0)
            gridded = self.race.memory().gridded
            yield inputs.Saved(now, gridded)
            yield inputs.Saved(now, gridded - 1)
        yield inputs.Tick(now)
        yield inputs.Tick(now + 1.0)

    def _command(self, kind: str, now: float, number: int = 0) -> Any:
        seen = _seen(look(self.race), kind, number)
        return inputs.feed(command(kind, number, True, now, **seen), self.race)

    def _check_homeward(self, saved: Any, now: float) -> None:
        """Bring the race home with karts that answer, with karts that never do, and by the MSR."""
        race = self.race
        later = now + 10.0  # every pause is over

        def begin() -> None:
            self.scratch.load(saved)
            race.cut_off('', now)
            race.rival(False, now)
            race.record_trouble('', now)

        begin()
        for kart in race.karts.values():
            race.contested(kart.number, False, now)
            if not kart.connected:
                race.connected(kart.number, now)
        for kart in race.karts.values():
            race.heard(kart.number, kart.serial, kart.sent, now)
        race.tick(later)  # they stand
        outcome = self._command('IN_GARAGE', later)
        for number in self.numbers:
            if race.karts[number].held_alone:
                self._command('KART_IN_GARAGE', later, number)
        self._check_home(outcome)
        # And the next race can begin, of those who may race.
        view = look(race)
        barred = _uninspected(view, view.karts)
        for kart in view.karts:
            if kart.in_race is (kart.number in barred):
                self._command('LEAVE_RACE' if kart.in_race else 'JOIN_RACE', later, kart.number)
        self._command('CLOSE_TRACK', later)
        race.attended(ANNA, later)
        if not self._command('GRID_ACTIVE', later + 10.0).answer.success:
            raise RuleBrokenError('stuck', f'no new race: {look(race)}')
        begin()
        for number in self.numbers:
            self._command('KART_IN_GARAGE', later, number)
        self._check_home(self._command('IN_GARAGE', later))
        begin()
        for number in self.numbers:
            race.disconnected(number, GONE, now)
        self._command('RECORD_MSR', now)
        allowed = race.track_access().allowed
        if not allowed or not self._command('IN_GARAGE', later).answer.success:
            raise RuleBrokenError('stuck', f'in spite of the MSR: {look(race)}')

    def _check_home(self, outcome: Any) -> None:
        view = look(self.race)
        home = view.state is IN_GARAGE and not view.over and not view.msr_used
        if not home or any(kart.hold or kart.sent is not IN_GARAGE for kart in view.karts):
            raise RuleBrokenError('stuck', f'{view}: {outcome.answer}')
        allowed = self.race.track_access().allowed or view.unstated
        if not allowed or not self.race.memory().at_rest:
            raise RuleBrokenError('stuck', f'{view}: {self.race.track_access()}')

    def _compare(self, key: tuple[Any, ...], other: tuple[Any, Facts, float]) -> None:
        """Try two states of one key under every input: they must lead to the same keys."""
        self.report.pairs_compared += 1
        first = self._successors(*self._seen[key])
        second = self._successors(*other)
        if first != second:
            raise RuleBrokenError(
                'abstraction', f'{self._seen[key]} and {other}: {first - second}'
            )

    def _successors(self, saved: Any, facts: Facts, now: float) -> Counter[tuple[Any, ...]]:
        successors: Counter[tuple[Any, ...]] = Counter()
        self.scratch.load(saved)
        view = look(self.race)
        for given in self._inputs(view, facts, now):
            _, learned, after = self._take(view, facts, given)
            successors[self._key(after, learned, given.at)] += 1
            self.scratch.load(saved)
        return successors
