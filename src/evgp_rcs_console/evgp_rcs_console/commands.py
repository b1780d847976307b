# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Describes an official's command and its request, and keeps track of what is still unanswered.

The console keeps sending a stop until race control accepts it. Repeats do no harm, because a stop
only makes things stricter. But a stop must neither override a later decision by the official
(``_ends``) nor outlive its race (``superseded``).

The module is pure: callers pass in all snapshots and times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
import math
from typing import Any

from evgp_node.entries import Result
from evgp_protocol.clock import now
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.snapshot import KartSnapshot, Snapshot
from evgp_rcs_console.catalogue import CATALOGUE, Kind


@dataclass(frozen=True)
class Given:
    """
    An official's command.

    :param kart: the number of the command's kart; 0 if the command is not for a single kart.
    :param stated: whether the official made the statement that race control asked for.
    :param taken: the fields of the request that ``Entry.takes`` lists; those left out are empty.
    :param official: the official's name, as sent to race control.
    :param then: commands to send one after another if this command is accepted soon enough. They
        count as pressed together with this command.
    :param at: when the command was given, in seconds, on the boot-time clock.
    :param waited: how long the press is known to have waited by then, in seconds. This time is
        reported to race control, but it never ends a stop, because it may be too long.
    """

    command: Kind
    kart: int = 0
    stated: bool = False
    taken: Mapping[str, Any] = field(default_factory=dict)
    official: str = ''
    then: tuple[Given, ...] = ()
    at: float = field(default_factory=now)
    waited: float = 0.0

    @property
    def key(self) -> tuple[Kind, int]:
        """Return what the presses of one button share."""
        return self.command, self.kart

    @property
    def heat(self) -> str:
        """Return the name of the command's heat; empty if it is not for a heat."""
        return str(self.taken.get('heat', ''))

    def followed_by(self) -> Given | None:
        """Return the command to send once this command is accepted; None if there is none."""
        if not self.then:
            return None
        first, *rest = self.then
        return replace(first, official=self.official, at=self.at, then=tuple(rest))


def request(given: Given, at: float) -> dict[str, Any]:
    """
    Return the fields of a command's request.

    :param at: when the request is sent, in seconds. Each request for a stop states the stop's age
        at that time. If DDS delivers the request late, the stop is older than stated, never
        younger.
    """
    entry = CATALOGUE[given.command]
    fields = {'official': given.official, **entry.fixed, **given.taken}
    if entry.to_one_kart:
        fields['kart'] = given.kart
    if entry.statement:
        fields[entry.statement] = given.stated
    if entry.stop:
        fields['age'] = max(0.0, at - given.at) + given.waited
    return fields


def shows(race: Snapshot, given: Given) -> bool:
    """Return whether a snapshot shows the result of this command, or could not show it at all."""
    if not CATALOGUE[given.command].is_seen:
        return True
    if given.heat:
        racing = tuple(kart.number for kart in race.karts if kart.in_race)
        return any((heat.name, heat.karts) == (given.heat, racing) for heat in race.heats)
    return shows_result(CATALOGUE[given.command].result, race, race.kart(given.kart))


def shows_result(result: Result, race: Snapshot, kart: KartSnapshot | None) -> bool:
    shown = []
    if result.race:
        shown.append(race.state in result.race)
    if result.track_open is not None:
        shown.append(race.track.open is result.track_open)
    if kart is not None and result.hold:
        shown.append(kart.hold in result.hold)
    if kart is not None and result.in_race is not None:
        shown.append(kart.in_race is result.in_race)
    if kart is not None and result.placed is not None:
        shown.append((kart.place > 0) is result.placed)
    return bool(shown) and all(shown)


PRESS_AGAIN = 0.5
"""Time after which a stop that race control has not accepted is sent again, in seconds."""

OUTLIVES = 10.0
"""Age up to which a stop is sent even if another race has begun since, in seconds."""

SNAPSHOT_WITHIN = 2.0
"""Maximum time that an old stop waits for a snapshot once race control is found again, in seconds.
Snapshots come twice a second, but on a busy machine DDS takes longer to find their publisher."""

CERTAIN = 5.0
"""Minimum time from a press to the start of a race that counts as later, in seconds. A program's
first snapshot may have been under way for this long."""


class RaceBegan:
    """
    Converts the start of a snapshot's race to this machine's clock.

    The two machines' clocks are unrelated, but a snapshot always arrives after it was taken. The
    smallest difference seen between arrival and stamp is therefore the difference of the clocks
    plus the delay of the fastest snapshot. Neither a delayed snapshot nor one that waited while
    this machine was suspended makes a race seem later. If race control's clock is set forward, the
    difference shrinks at once. If that clock is set back, the race seems to have begun earlier.
    """

    def __init__(self) -> None:
        self._difference = math.inf

    def hear(self, stamp: float, since: float | None, now: float) -> float:
        """
        Return the earliest time, in seconds, at which a snapshot's race could have begun.

        :param stamp: when the snapshot was taken, on race control's clock.
        :param since: when the race began, on the same clock; None if this run has had no race.
        :param now: when the snapshot arrived, on this machine's clock.
        """
        self._difference = min(self._difference, now - stamp)
        return -math.inf if since is None else since + self._difference


@dataclass(frozen=True)
class Standing:
    """
    A stop that the console keeps sending until race control accepts it.

    :param given: the official's newest press of this stop.
    :param since: time of the first press after the stop was last accepted, in seconds.
    :param presses: number of times that the stop has come due for sending.
    :param due: when the stop is sent next, in seconds.
    :param said: race control's reason for not accepting the stop; empty if it gave no reason.
    :param found_since: when race control was found, in seconds; infinite if the last check did not
        find race control.
    """

    given: Given
    since: float
    presses: int = 0
    due: float = 0.0
    said: str = ''
    found_since: float = -math.inf


class StandingStops:
    """Keeps the stops that the console is still sending."""

    def __init__(self) -> None:
        self._stops: dict[tuple[Kind, int], Standing] = {}
        self._heard_at = -math.inf  # when the last snapshot arrived

    @property
    def pressed(self) -> tuple[Standing, ...]:
        """Return the stops that are still being sent, oldest first."""
        return tuple(self._stops.values())

    def add(self, given: Given, now: float) -> None:
        known = self._stops.get(given.key) or Standing(given, since=now)
        self._stops[given.key] = replace(known, given=given, due=now)

    def press(self, now: float, finds: Callable[[Given], bool]) -> list[Given]:
        """
        Return the stops that are due now, and count them as sent.

        An old stop is not sent until race control is found. Even then, DDS may have found only the
        service that takes the stop, so this console may not know of a later race yet. The stop
        therefore waits for a snapshot, which ends the stop if a later race has begun. If no
        snapshot arrives within ``SNAPSHOT_WITHIN``, the stop is sent.

        :param finds: returns whether race control can be reached; called for old stops only.
        """
        pressed = []
        for key, stop in self._stops.items():
            if stop.due > now:
                continue
            since, waits = stop.found_since, False
            if now - stop.given.at > OUTLIVES:
                since = min(since, now) if finds(stop.given) else math.inf
                waits = now < since + SNAPSHOT_WITHIN and self._heard_at < since
            due = now + PRESS_AGAIN
            self._stops[key] = replace(stop, presses=stop.presses + 1, due=due, found_since=since)
            if not waits:
                pressed.append(stop.given)
        return pressed

    def superseded(self, begun: float, now: float) -> list[Given]:
        """
        Remove and return the stops that end because a snapshot shows a later race.

        A stop ends only if an official's GRID_ACTIVE was certainly accepted after the press.
        Neither a restart of race control nor a new race number proves that.

        :param begun: earliest time, in seconds, at which the snapshot's race could have begun.
        :param now: when the snapshot arrived, in seconds.
        """
        self._heard_at = now
        ended = [
            stop.given
            for stop in self._stops.values()
            if now - stop.given.at > OUTLIVES and begun - stop.given.at > CERTAIN
        ]
        for given in ended:
            del self._stops[given.key]
        return ended

    def next_press(self, now: float) -> float:
        """Return the time until the next stop is due, in seconds, at most ``PRESS_AGAIN``."""
        due = (stop.due for stop in self._stops.values())
        return max(0.0, min(due, default=now + PRESS_AGAIN) - now)

    def waits(self, given: Given) -> bool:
        """Return whether this press of a stop has not been accepted yet."""
        stop = self._stops.get(given.key)
        return stop is not None and stop.given is given

    def accepted(self, given: Given) -> bool:
        """
        Record that race control accepted a command; return whether that ends any stop.

        If the official has pressed a stop again since, the console still sends the newer press.
        """
        before = len(self._stops)
        if self.waits(given):
            del self._stops[given.key]
        for key, stop in list(self._stops.items()):
            if stop.given.at < given.at and _ends(given, stop.given):
                del self._stops[key]
        return len(self._stops) < before

    def refused(self, given: Given, said: str, final: bool) -> bool:
        """
        Record that race control has not accepted a stop, and why; return whether that ends it.

        :param final: whether race control will never accept the stop.
        """
        if not self.waits(given):
            return False
        if final:
            del self._stops[given.key]
        else:
            self._stops[given.key] = replace(self._stops[given.key], said=said)
        return final


def _ends(later: Given, stop: Given) -> bool:
    """
    Return whether accepting a later command ends a stop: never ALL KILL or RECORD_MSR.

    Releasing a kart ends only the stops for that kart.
    """
    entry, to_one_kart = CATALOGUE[later.command], CATALOGUE[stop.command].to_one_kart
    if entry.loosens and 'karts' in entry.takes:
        return to_one_kart or stop.command is CommandKind.RED_FLAG
    released = later.command is CommandKind.KART_IN_GARAGE
    return released and to_one_kart and stop.kart == later.kart


LATE = 0.3
"""Time after which the window reports that a command has no answer, in seconds."""


class Unanswered:
    """
    Keeps commands that have no answer yet, and stops that race control has not accepted yet.

    :ivar stops: the stops that the client keeps sending, oldest first.
    """

    def __init__(self) -> None:
        self.stops: tuple[Standing, ...] = ()
        self._given: dict[tuple[Kind, int], Given] = {}

    def __bool__(self) -> bool:
        """Return whether any command is still waiting."""
        return bool(self._given or self.stops)

    def add(self, given: Given) -> None:
        self._given[given.key] = given

    def answered(self, given: Given) -> None:
        """Remove an answered command, unless a newer press of it is still waiting."""
        if self._given.get(given.key) is given:
            del self._given[given.key]

    def ages(self, now: float) -> dict[tuple[Kind, int], float]:
        """Return how long each command has been waiting for its answer, in seconds."""
        return {key: now - given.at for key, given in self._given.items()}

    def oldest(self, now: float) -> Given | None:
        """Return the command that has waited longest; None if no wait is longer than ``LATE``."""
        given = min(self._given.values(), key=lambda given: given.at, default=None)
        return given if given is not None and now - given.at > LATE else None

    def late_stops(self, now: float) -> list[Standing]:
        """Return the stops that have been waiting for acceptance for longer than ``LATE``."""
        return [stop for stop in self.stops if now - stop.since > LATE]
