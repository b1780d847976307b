# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The score sheet: how an official dealt with each incident.

Pure: incidents with their ticks, the events of the record and the truth of the field go in, lines
come out. Times are those of the field's ticks, and what the sheet shows is rounded to
``QUANTUM``, so the same seed and the same commands give the same sheet. No sentence of an event
is read.

Every command between the beginning of an incident and its end is

- right: it is one of the steps of the incident's row;
- fine: the row allows it, or it harms nobody (closing the track, the same stop again);
- needless: it stops karts that need not stop, or does something that has no use here;
- wrong: it endangers somebody. What that is, the row says, or the truth: a release or an open
  track while karts move, a start before the incident is dealt with, an MSR recorded that was not
  used, a finish for a kart that has not crossed the line, or in another order.

The MSR is the official's act and the instructor's button. The official acted when the instructor
pressed it or when the official recorded it, whichever came first.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
import enum
import math

from evgp_node.entries import Result
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.race import EventKind, StampedEvent
from evgp_rehearsal.field import Field, TICK_LENGTH
from evgp_rehearsal.incidents import Deed, Incident, INCIDENTS

STEWARD = 'rehearsal'
"""Official's name of the rehearsal itself, whose commands are not judged."""

QUANTUM = 0.5
"""What times on the sheet are rounded up to, in seconds."""

ROLLS_OUT = 2
"""Ticks that a kart may still seem to move after its acknowledgement was heard."""


@dataclass(frozen=True)
class Occurrence:
    """
    An incident that took place.

    :param kart: to whom; 0: to no single kart.
    :param began: the tick.
    :param ended: the tick after which nothing counts for it.
    """

    incident: str
    kart: int
    began: int
    ended: int


@dataclass(frozen=True)
class Truth:
    """
    What really happened in the field, by ticks.

    :param moving: every change of whether a kart moves: tick, kart, whether.
    :param crossed: which kart has driven its laps, in order: tick, kart.
    :param msr: when the MSR was used.
    :param grids: when karts were put onto the grid: what they crossed before, was another race.
    """

    moving: tuple[tuple[int, int, bool], ...]
    crossed: tuple[tuple[int, int], ...]
    msr: tuple[int, ...]
    grids: tuple[int, ...] = ()

    @classmethod
    def of(cls, field: Field) -> Truth:
        """Return the truth of a field up to now."""
        return cls(
            tuple(field.moving), tuple(field.crossed), tuple(field.msr_at), tuple(field.grids)
        )

    def movers(self, tick: int) -> frozenset[int]:
        """Return the karts that move at a tick."""
        last: dict[int, bool] = {}
        for at, kart, moves in self.moving:
            if at <= tick:
                last[kart] = moves
        return frozenset(kart for kart, moves in last.items() if moves)

    def started(self, began: int, ended: int) -> frozenset[int]:
        """Return the karts that began to move in this time."""
        return frozenset(kart for at, kart, moves in self.moving if moves and began < at <= ended)


class Judgement(enum.Enum):
    """What a command was."""

    RIGHT = enum.auto()
    FINE = enum.auto()
    NEEDLESS = enum.auto()
    WRONG = enum.auto()


@dataclass(frozen=True)
class Line:
    """
    A line of the score sheet.

    :param first_right: time from the incident's beginning to the first right command, in
        seconds; None: there was none.
    :param solved: time to the last step, in seconds; None: not in the time there was.
    :param wrong: names of the wrong commands, as often as they were given.
    :param needless: names of the needless ones.
    :param stopped: karts that were stopped without need.
    :param people: how often people were let onto the track, or were on it, while a kart moved.
    """

    incident: str
    kart: int
    at: float
    first_right: float | None
    solved: float | None
    wrong: tuple[str, ...] = ()
    needless: tuple[str, ...] = ()
    stopped: tuple[int, ...] = ()
    people: int = 0

    @property
    def passed(self) -> bool:
        """Return whether the official passes this incident."""
        return self.solved is not None and not (
            self.wrong or self.needless or self.stopped or self.people
        )


def score(took: Iterable[Occurrence], events: Sequence[StampedEvent], truth: Truth) -> list[Line]:
    """Return a line for each incident; the times of the events are the field's, in seconds."""
    commands = []
    red: set[int] = set()
    for stamped in events:
        event = stamped.event
        if event.kind is EventKind.KART_STATE and event.state is not None:
            (red.add if event.state.is_red else red.discard)(event.kart)
        elif event.kind is EventKind.COMMAND and event.command and event.official != STEWARD:
            tick = round(stamped.monotonic / TICK_LENGTH)
            seen = frozenset(red)
            commands.append(_Command(tick, event.command, event.kart, event.success, seen))
    return [_line(each, commands, truth) for each in took]


@dataclass(frozen=True)
class _Command:
    """An official's command; ``red`` are the karts that were sent a red before it."""

    tick: int
    kind: CommandKind
    kart: int
    accepted: bool
    red: frozenset[int]

    def __str__(self) -> str:
        name = f'{self.kind.name} {self.kart}' if self.kart else self.kind.name
        return name if self.accepted else f'{name} (refused)'


def _line(took: Occurrence, commands: Sequence[_Command], truth: Truth) -> Line:
    row = INCIDENTS[took.incident]
    last = took.began + row.ticks
    first_right = solved = None
    left = list(row.steps)
    wrong, needless = [], []
    stopped: set[int] = set()
    people = 0
    is_open = False
    commands = sorted((_acted(each, took, truth) for each in commands), key=lambda each: each.tick)
    finished = [each for each in commands if _places(each) and each.tick < took.began]
    for command in commands:
        if command.kind is CommandKind.OPEN_TRACK and command.accepted:
            is_open = True
        elif command.kind in (CommandKind.CLOSE_TRACK, CommandKind.GRID_ACTIVE):
            is_open = is_open and not command.accepted
        if not took.began <= command.tick <= took.ended:
            continue
        judged = _judge(command, row, took, truth, tuple(finished), not left)
        if judged is Judgement.RIGHT:
            if first_right is None:
                first_right = command.tick
            while left and _deed(command, took) in left[0] and command.tick <= last:
                left.pop(0)
                if not left:
                    solved = command.tick
                if command.kind is not CommandKind.RECORD_MSR:
                    break  # one command is one step; the MSR is the strongest, and all of them
        elif judged is Judgement.WRONG:
            wrong.append(str(command))
            people += _lets_people_in(command) and bool(truth.movers(command.tick - ROLLS_OUT))
        elif judged is Judgement.NEEDLESS:
            needless.append(str(command))
            stopped |= _stopped_by(command, truth) - {took.kart}
        if _places(command):
            finished.append(command)
    if is_open:
        people += bool(truth.started(took.began, took.ended))
    return Line(
        took.incident,
        took.kart,
        _seconds(took.began),
        None if first_right is None else _rounded(first_right - took.began),
        None if solved is None else _rounded(solved - took.began),
        tuple(wrong),
        tuple(needless),
        tuple(sorted(stopped)),
        people,
    )


def _deed(command: _Command, took: Occurrence) -> Deed:
    return Deed(command.kind, command.kart != 0 and command.kart == took.kart)


def _judge(
    command: _Command,
    row: Incident,
    took: Occurrence,
    truth: Truth,
    finished: tuple[_Command, ...],
    solved: bool,
) -> Judgement:
    entry = CATALOGUE[command.kind]
    deed = _deed(command, took)
    meant = command.kart in (0, took.kart)
    if command.kind is CommandKind.RECORD_MSR and not _msr_clicks(took, truth):
        return Judgement.WRONG
    if entry.loosens and command.accepted and not _may_loosen(command, truth):
        return Judgement.WRONG
    if command.kind is CommandKind.KART_FINISH and not _has_crossed(command, truth, finished):
        return Judgement.WRONG
    if meant and deed in row.wrong:
        return Judgement.WRONG
    if meant and deed in row.asked and command.accepted:
        return Judgement.RIGHT
    if (meant and deed in row.fine | row.asked) or command.kind in _HARMLESS:
        return Judgement.FINE
    if entry.loosens and not solved:
        return Judgement.WRONG
    if solved and (entry.loosens or not _stopped_by(command, truth)):
        return Judgement.FINE
    return Judgement.NEEDLESS


_HARMLESS = (
    CommandKind.CLOSE_TRACK,
    CommandKind.KART_FINISH,
    # Bookkeeping that changes nothing of what karts are in the race, or of the track.
    *(
        kind
        for kind, e in CATALOGUE.items()
        if e.bookkeeping and not e.names_heat and e.result == Result()
    ),
)


def _places(command: _Command) -> bool:
    return command.kind is CommandKind.KART_FINISH and command.accepted


def _lets_people_in(command: _Command) -> bool:
    return command.accepted and command.kind in (
        CommandKind.OPEN_TRACK,
        CommandKind.IN_GARAGE,
        CommandKind.KART_IN_GARAGE,
    )


def _may_loosen(command: _Command, truth: Truth) -> bool:
    """Return whether what a command loosens endangers nobody: the karts concerned stand."""
    movers = truth.movers(command.tick - ROLLS_OUT) & truth.movers(command.tick)
    if command.kind is CommandKind.KART_IN_GARAGE:
        return command.kart not in movers
    return not movers


def _msr_clicks(took: Occurrence, truth: Truth) -> list[int]:
    """
    Return when the instructor pressed the MSR in an incident, at the official's word.

    That is later than the word, and may be later than the official's own record of it.
    """
    return [at for at in truth.msr if took.began <= at <= took.ended]


def _acted(command: _Command, took: Occurrence, truth: Truth) -> _Command:
    """Return a command with the tick at which the official acted, as far as that is known."""
    if command.kind is not CommandKind.RECORD_MSR or not took.began <= command.tick <= took.ended:
        return command
    return replace(command, tick=min([command.tick, *_msr_clicks(took, truth)]))


def _has_crossed(command: _Command, truth: Truth, finished: tuple[_Command, ...]) -> bool:
    """Return whether a kart has driven its laps, and every kart before it has its place."""
    grid = max((at for at in truth.grids if at <= command.tick), default=0)
    placed = {each.kart for each in finished if each.tick > grid}
    for at, kart in truth.crossed:
        if at > command.tick:
            return False
        if at > grid and kart == command.kart:
            return True
        if at > grid and kart not in placed:
            return False
    return False


def _stopped_by(command: _Command, truth: Truth) -> frozenset[int]:
    """Return the karts that this command stopped: they moved, and were sent no red before."""
    if not command.accepted or not (
        CATALOGUE[command.kind].stop or command.kind is CommandKind.RACE_OVER
    ):
        return frozenset()
    movers = truth.movers(command.tick) - command.red
    return movers if command.kart == 0 else movers & {command.kart}


def _seconds(ticks: int) -> float:
    return round(ticks * TICK_LENGTH, 2)


def _rounded(ticks: int) -> float:
    return math.ceil(ticks * TICK_LENGTH / QUANTUM) * QUANTUM
