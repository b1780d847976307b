# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
An automatic official who knows the rules, and the steward who starts the race for it.

Pure. An official looks (``View``) and does at most one thing at a time (``Act``). The good one
goes by docs/rules.md, the radio and its eyes; it does not know which incident there is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rehearsal.field import Call, Field, Message

K = CommandKind

LOOKS = 10
"""Ticks between two looks of an official."""

USE_MSR = ('FLAG_UNACKNOWLEDGED', 'RED_UNACKNOWLEDGED', 'LOST_IN_MOTION')
"""Alerts whose answer is the MSR while the kart moves or nobody sees it."""


@dataclass(frozen=True)
class KartView:
    """A kart as officials see it; the names are those of the rules."""

    in_race: bool
    connected: bool
    sent: RaceState
    acknowledged: bool
    place: int


@dataclass(frozen=True)
class View:
    """
    What an official sees and hears.

    :param alerts: the names of their kinds, and the kart or 0.
    :param available: the commands that would be accepted, with the kart or 0.
    :param radio: everything heard since the incident began.
    :param moving: the karts that are seen to move.
    :param crossed: the karts that were seen to drive their last lap to its end, in order.
    """

    state: RaceState
    karts: Mapping[int, KartView]
    alerts: frozenset[tuple[str, int]]
    available: frozenset[tuple[CommandKind, int]]
    radio: Sequence[Message]
    moving: frozenset[int]
    crossed: Sequence[int]
    msr_used: bool
    track_open: bool


@dataclass(frozen=True)
class Act:
    """
    What an official does: a command, or (None) the button of the MSR.

    :param kart: of STRIKE_PASSING: whose last passing that is none.
    """

    kind: CommandKind | None
    kart: int = 0


USE_THE_MSR = Act(None)


_CORRECTIONS = {Call.NOT_COUNTED: K.COUNT_PASSING, Call.NOT_THERE: K.STRIKE_PASSING}


class AnOfficial(Protocol):
    """Someone who looks and acts."""

    def act(self, view: View) -> Act | None:
        """Return what is done now, after this look; None: nothing."""


class Steward:
    """
    Brings a race to where an incident can begin: first to the garage, then to its goal.

    :param goal: IN_GARAGE, GRID_ACTIVE or GREEN_GREEN.
    """

    def __init__(self, goal: RaceState) -> None:
        self._goal = goal
        self._gathered = False

    def act(self, view: View) -> Act | None:
        """Return the next step."""
        if not self._gathered:
            return self._to_garage(view)
        if view.track_open:
            return Act(K.CLOSE_TRACK)
        for state, kind in (
            (RaceState.IN_GARAGE, K.GRID_ACTIVE),
            (RaceState.GRID_ACTIVE, K.GREEN_GREEN),
        ):
            if view.state is state and state is not self._goal and (kind, 0) in view.available:
                return Act(kind)
        return None

    def _to_garage(self, view: View) -> Act | None:
        """Return what brings the race, or one of its karts, nearer to the garage."""
        if view.state is RaceState.RED_RED:
            wanted = [(K.IN_GARAGE, 0)]
        elif view.state is RaceState.IN_GARAGE:
            wanted = [
                (kind, number) for kind in (K.KART_IN_GARAGE, K.JOIN_RACE) for number in view.karts
            ]
            self._gathered = all(
                kart.in_race and kart.connected and kart.sent is RaceState.IN_GARAGE
                for kart in view.karts.values()
            )
        else:
            wanted = [(K.RACE_OVER, 0)]
        return next((Act(*each) for each in wanted if each in view.available), None)


class Good:
    """An official who knows the rules."""

    def __init__(self) -> None:
        self._recorded = False
        self._started = False
        self._corrected: list[Message] = []

    def act(self, view: View) -> Act | None:
        """Return the most urgent thing to do."""
        return (
            self._msr(view)
            or self._radio(view)
            or self._eyes(view)
            or self._alerts(view)
            or self._finish(view)
            or self._release(view)
        )

    def _msr(self, view: View) -> Act | None:
        danger = any(each.call in (Call.PERSON, Call.OUT_OF_CONTROL) for each in view.radio)
        # What stands does not need it; what is lost may move, whatever it seems.
        alerts = any(kind in USE_MSR for kind, _ in view.alerts)
        if self._recorded or not (danger or alerts):
            return None
        if not view.msr_used:
            return USE_THE_MSR
        self._recorded = True
        return Act(K.RECORD_MSR)

    def _radio(self, view: View) -> Act | None:
        for each in view.radio:
            if each.call in (Call.SPUN, Call.FLAG_ALL) and view.state is RaceState.GREEN_GREEN:
                return Act(K.RED_FLAG)
            if each.call is Call.STOP_ALL and view.state is not RaceState.RED_RED:
                return Act(K.ALL_KILL)
            if each.call is Call.STANDS and not view.karts[each.kart].sent.is_red:
                return Act(K.KART_RED_RED, each.kart)
            correction = _CORRECTIONS.get(each.call)
            if correction is not None and each not in self._corrected:
                self._corrected.append(each)
                return Act(correction, each.kart)
        return None

    def _eyes(self, view: View) -> Act | None:
        if view.state is RaceState.GRID_ACTIVE:
            for number in sorted(view.moving):
                if not view.karts[number].sent.is_red:
                    return Act(K.KART_RED_RED, number)
        return None

    def _alerts(self, view: View) -> Act | None:
        for kind, kart in sorted(view.alerts):
            if kind == 'NOT_READY' and view.state is RaceState.GRID_ACTIVE:
                return Act(K.LEAVE_RACE, kart)
            if kind == 'KART_LOST' and view.state is RaceState.GREEN_GREEN:
                return Act(K.RED_FLAG)
        return None

    def _finish(self, view: View) -> Act | None:
        for number in view.crossed:
            if (K.KART_FINISH, number) in view.available:
                return Act(K.KART_FINISH, number)
        return None

    def _release(self, view: View) -> Act | None:
        quiet = not view.moving and not view.radio and not self._recorded
        if view.state is RaceState.RED_RED and quiet and (K.IN_GARAGE, 0) in view.available:
            return Act(K.IN_GARAGE)
        return None


def look(field: Field, began: int) -> tuple[list[Message], frozenset[int], list[int]]:
    """Return what is heard since a tick, who moves, and who has driven the last lap, in order."""
    return (
        [each for each in field.messages if each.tick >= began],
        frozenset(number for number, kart in field.karts.items() if kart.moves),
        [number for at, number in field.crossed if at > max(field.grids, default=0)],
    )
