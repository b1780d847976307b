# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
An official's command: what it asks of race control, what it does, and what became of it.

The catalogue says what each command is called and whether it is a stop; race control says whether
it is allowed.

Each stop is sent again until race control accepts it: that can do no harm, since it only ever
makes things stricter. But a stop must not outlive what an official decides later, so a command of
this console that loosens, once race control has accepted it, ends the stops given before it. ALL
KILL and the record of the MSR stand until race control has accepted them. And no stop outlives its
race: one that is over ``OUTLIVES`` old ends once it is certain that a later race has begun.

Pure: snapshots and times go in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
import math

from evgp_node.entries import Result
from evgp_protocol.clock import now
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Availability
from evgp_rcs.rules.snapshot import KartSnapshot, Snapshot
from evgp_rcs_console.catalogue import CATALOGUE, Kind


@dataclass(frozen=True)
class Given:
    """
    A command that an official gave, with what the official saw.

    :param kart: the kart it is for; 0 for a command to the race, to all, or to the track.
    :param stated: the official made the statement that race control asked for.
    :param karts: for a command that starts or releases karts: the karts that the official saw.
    :param hold: for the release of one kart: the hold that the official saw.
    :param heat: for putting a heat into the race: its name.
    :param number: for GRID_ACTIVE: the last opening of the track that the official saw; for
        TAKE_ROSTER: the reading of the roster.
    :param official: who gave it, as sent to race control.
    :param taken: the further fields of its request (``Entry.takes``).
    :param then: commands that are given once this one is accepted, one after the other, if that is
        soon enough; each as if it had been pressed with this one.
    :param at: when it was given, by the clock that counts a suspend, in seconds.
    :param waited: for how long the press had waited by then, in seconds, as far as that is known.
        Race control is told; no stop ends by it, since it may be too large.
    """

    command: Kind
    kart: int = 0
    stated: bool = False
    karts: tuple[int, ...] = ()
    hold: RaceState | None = None
    heat: str = ''
    number: int = 0
    official: str = ''
    taken: Mapping[str, int | bool | str] = field(default_factory=dict)
    then: tuple[Given, ...] = ()
    at: float = field(default_factory=now)
    waited: float = 0.0

    def followed_by(self) -> Given | None:
        """Return the command that follows once this one is accepted; None: none does."""
        if not self.then:
            return None
        first, *rest = self.then
        return replace(first, official=self.official, at=self.at, then=tuple(rest))


def request(
    given: Given, at: float
) -> dict[str, float | bool | str | list[int] | RaceState | None]:
    """
    Return the fields of the request of a command.

    :param at: when it is sent, in seconds. Each time that a stop is sent its age is written anew:
        a request that DDS delivers late is older than it says, by that delay, and no younger.
    """
    entry = CATALOGUE[given.command]
    fields: dict[str, float | bool | str | list[int] | RaceState | None] = {
        'official': given.official,
        **entry.fixed,
        **given.taken,
    }
    if entry.to_one_kart:
        fields['kart'] = given.kart
    if entry.statement:
        fields[entry.statement] = given.stated
    if entry.names_karts:
        fields['karts'] = list(given.karts)
    if entry.names_hold:
        fields['hold'] = given.hold
    if entry.names_heat:
        fields['heat'] = given.heat
    if entry.names_number:
        fields[entry.names_number] = given.number
    if entry.stop:
        fields['age'] = max(0.0, at - given.at) + given.waited
    return fields


@dataclass(frozen=True)
class Effects:
    """
    What a command would do; each kart of the roster is in one of these groups.

    :param state: the state that it sends; None if it sends nothing.
    :param now: karts that are sent the state at once.
    :param later: karts without a connection, which are sent the state when they connect.
    :param held: other karts, which stay held.
    :param rest: karts to which nothing happens.
    """

    state: RaceState | None
    now: tuple[KartSnapshot, ...] = ()
    later: tuple[KartSnapshot, ...] = ()
    held: tuple[KartSnapshot, ...] = ()
    rest: tuple[KartSnapshot, ...] = ()


def effects(
    command: Kind, race: Snapshot, offered: Availability, kart: KartSnapshot | None
) -> Effects:
    """
    Return what a command would do.

    :param offered: what race control says about the command.
    :param kart: the kart it is for, if it is for one.
    """
    sends = CATALOGUE[command].sends
    if sends is None:
        concerned: set[int] = set()
    elif kart is not None:
        concerned = {kart.number}
    elif command is CommandKind.RECORD_MSR:
        concerned = {each.number for each in race.karts}
    else:
        # GRID_ACTIVE that is given again is sent to nobody again.
        concerned = {
            each.number
            for each in race.karts
            if each.number in offered.karts and each.sent is not sends
        }

    def those(wanted: bool, part: bool) -> tuple[KartSnapshot, ...]:
        return tuple(
            each
            for each in race.karts
            if (each.number in concerned) is wanted
            and (each.connected if wanted else each.hold is not None) is part
        )

    return Effects(
        sends,
        now=those(True, True),
        later=those(True, False),
        held=those(False, True),
        rest=those(False, False),
    )


SETTLED = 1.0
"""Time after an answer from which on every snapshot is newer than the answer, in seconds. Race
control publishes a snapshot at least every 0.5 s."""


class Outcome:
    """
    The effect of an accepted command.

    :param at: time of the answer to it, in seconds.
    """

    def __init__(self, given: Given, at: float) -> None:
        self.given = given
        self._at = at
        self._seen: object = None

    def stands(self, race: Snapshot, at: float) -> bool:
        """
        Return whether a snapshot, like every one before it, agrees with the answer.

        :param at: time when the snapshot came, in seconds.
        """
        shown = self._shown(race)
        if self._seen is None and self._is_done(race):
            self._seen = shown
        if self._seen is None:
            return at - self._at < SETTLED  # it may be older than the answer
        return shown == self._seen

    def _shown(self, race: Snapshot) -> object:
        """Return the part of a snapshot that the command can change."""
        entry = CATALOGUE[self.given.command]
        if entry.result.track_open is not None:
            return race.track.open
        if entry.names_heat:
            return race.state, _racing(race)
        kart = race.kart(self.given.kart)
        if kart is None:
            return (race.state,)
        return kart.sent, kart.hold, kart.in_race, kart.place

    def _is_done(self, race: Snapshot) -> bool:
        given = self.given
        entry = CATALOGUE[given.command]
        if entry.names_heat:
            return any(
                heat.name == given.heat and heat.karts == _racing(race) for heat in race.heats
            )
        return is_so(entry.result, race, race.kart(given.kart))


def is_so(result: Result, race: Snapshot, kart: KartSnapshot | None) -> bool:
    """
    Return whether a snapshot shows the result of a command.

    :param kart: the kart that the command is for, if it is for one.
    """
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


def _racing(race: Snapshot) -> tuple[int, ...]:
    return tuple(kart.number for kart in race.karts if kart.in_race)


PRESS_AGAIN = 0.5
"""Time between two presses of a stop that is not answered, in seconds."""

LOOSENS_RACE = frozenset(
    kind for kind, entry in CATALOGUE.items() if entry.loosens and entry.names_karts
)
"""Commands that end the stops given before them: those to the race and to its karts."""

ENDED_BY_RELEASE = frozenset(
    kind for kind, entry in CATALOGUE.items() if entry.stop and entry.to_one_kart
)
"""The stops of a kart that end with its accepted release."""

ENDED_BY_RACE = ENDED_BY_RELEASE | {CommandKind.RED_FLAG}
"""The stops that end with an accepted command of ``LOOSENS_RACE``."""


OUTLIVES = 10.0
"""Age up to which a stop is sent whatever race has begun since, in seconds."""

SNAPSHOT_WITHIN = 2.0
"""Maximum time for which an old stop waits for a snapshot once race control is found again, in
seconds. Snapshots come twice a second, but on a busy machine DDS takes longer to find them."""

CERTAIN = 5.0
"""Time after a press from which on a race counts as later, in seconds: for as long the first
snapshot that a program hears may have been under way."""


class RaceBegan:
    """
    When the race that a snapshot shows began, by this machine's clock.

    The clocks of the two machines have nothing in common. But a snapshot comes after it was taken.
    So the smallest difference seen between when one came and its stamp is that of the clocks, plus
    the delay of the one that came fastest. A snapshot that was held up, or that waited while this
    machine was suspended, makes no race seem later. Nor does a clock of race control that is set:
    set forward, the difference gets smaller at once; set back, the race seems an earlier one.
    """

    def __init__(self) -> None:
        self._difference = math.inf

    def hear(self, stamp: float, since: float | None, now: float) -> float:
        """
        Take a snapshot and return when its race began, at the earliest, in seconds.

        :param stamp: when it was taken; ``since``: when its race began, by the clock of race
            control; None: none has begun in this run.
        :param now: when it came.
        """
        self._difference = min(self._difference, now - stamp)
        return -math.inf if since is None else since + self._difference


@dataclass(frozen=True)
class Standing:
    """
    A stop that is being pressed.

    :param given: the newest press of it by the official.
    :param since: when it was asked for first and not accepted, in seconds.
    :param presses: how often it was sent.
    :param due: when it is sent next.
    :param said: why race control did not accept it, if it said so.
    :param found_since: since when race control is there, as far as that was looked at, in seconds;
        infinite: it is not.
    """

    given: Given
    since: float
    presses: int = 0
    due: float = 0.0
    said: str = ''
    found_since: float = -math.inf


class StandingStops:
    """The stops that are being pressed, by command and kart."""

    def __init__(self) -> None:
        self._stops: dict[tuple[Kind, int], Standing] = {}
        self._heard_at = -math.inf  # when the last snapshot came

    @property
    def pressed(self) -> tuple[Standing, ...]:
        """Return what is being pressed, the oldest first."""
        return tuple(self._stops.values())

    def add(self, given: Given, now: float) -> None:
        """Take a stop that an official gave; it is due at once."""
        known = self._stops.get(_key(given))
        if known is None:
            known = Standing(given, since=now)
        self._stops[_key(given)] = replace(known, given=given, due=now)

    def press(self, now: float, finds: Callable[[Given], bool]) -> list[Given]:
        """
        Return what is to be sent now, and count each stop that is due as sent.

        An old stop is not sent while race control is not found: DDS may have found half of it,
        which would take the stop before this console has heard of a later race. Once race control
        is found, the stop waits for a snapshot, which ends it if a later race has begun. If none
        comes within ``SNAPSHOT_WITHIN``, it is sent all the same.

        :param finds: whether race control is there to take a stop; asked for old ones only.
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

    def outlived(self, begun: float, now: float) -> list[Given]:
        """
        Take a snapshot; return the stops that end by it.

        No restart of race control ends a stop, nor does a race of which only the number is known:
        a stop ends only where an official's GRID_ACTIVE was certainly accepted after the press.

        :param begun: when its race began, at the earliest; ``now``: when it came, in seconds.
        """
        self._heard_at = now
        ended = [
            (key, stop.given)
            for key, stop in self._stops.items()
            if now - stop.given.at > OUTLIVES and begun - stop.given.at > CERTAIN
        ]
        for key, _ in ended:
            del self._stops[key]
        return [given for _, given in ended]

    def next_press(self, now: float) -> float | None:
        """Return the time until something is to be sent, in seconds; None: nothing is."""
        if not self._stops:
            return None
        return max(0.0, min(stop.due for stop in self._stops.values()) - now)

    def stands(self, given: Given) -> bool:
        """Return whether this very press of a stop still waits to be accepted."""
        stop = self._stops.get(_key(given))
        return stop is not None and stop.given is given

    def accepted(self, given: Given) -> bool:
        """
        Take that race control has accepted a command; return whether something stops standing.

        A stop that was pressed again by the official after this press stands on.
        """
        before = len(self._stops)
        if self.stands(given):
            del self._stops[_key(given)]
        for key, stop in list(self._stops.items()):
            if stop.given.at < given.at and _ends(given, stop.given):
                del self._stops[key]
        return len(self._stops) < before

    def refused(self, given: Given, said: str, final: bool) -> None:
        """
        Take that race control has not accepted a stop, and why.

        :param final: it never will: the stop is given up.
        """
        if not self.stands(given):
            return
        if final:
            del self._stops[_key(given)]
        else:
            stop = self._stops[_key(given)]
            self._stops[_key(given)] = replace(stop, said=said)


def _key(given: Given) -> tuple[Kind, int]:
    return given.command, given.kart


def _ends(later: Given, stop: Given) -> bool:
    if later.command in LOOSENS_RACE:
        return stop.command in ENDED_BY_RACE
    if later.command is CommandKind.KART_IN_GARAGE:
        return stop.command in ENDED_BY_RELEASE and stop.kart == later.kart
    return False


LATE = 0.3
"""Time without an answer after which the window says so, in seconds."""


class Unanswered:
    """
    Commands that wait for an answer, and stops that are sent until they are accepted.

    :ivar stops: the stops that the client sends again and again, the oldest first.
    """

    def __init__(self) -> None:
        self.stops: tuple[Standing, ...] = ()
        self._given: dict[tuple[Kind, int], Given] = {}

    def __bool__(self) -> bool:
        """Return whether a command waits for its answer; stops do not count."""
        return bool(self._given)

    def add(self, given: Given) -> None:
        """Take a command that was sent and is no stop."""
        self._given[given.command, given.kart] = given

    def answered(self, given: Given) -> None:
        """Take that a command has its answer; a newer one of the same kind still waits."""
        if self._given.get((given.command, given.kart)) is given:
            del self._given[given.command, given.kart]

    def ages(self, now: float) -> dict[tuple[Kind, int], float]:
        """Return for how long each command has waited, in seconds."""
        return {key: now - given.at for key, given in self._given.items()}

    def oldest(self, now: float) -> Given | None:
        """Return the command that has waited longest, if that is longer than ``LATE``."""
        given = min(self._given.values(), key=lambda given: given.at, default=None)
        return given if given is not None and now - given.at > LATE else None

    def all_kill(self, now: float) -> Standing | None:
        """Return ALL KILL, if race control has not accepted it for longer than ``LATE``."""
        return next((stop for stop in self._late(now) if _is_all_kill(stop)), None)

    def other_stops(self, now: float) -> list[Standing]:
        """Return the other stops that race control has not accepted for longer than ``LATE``."""
        return [stop for stop in self._late(now) if not _is_all_kill(stop)]

    def _late(self, now: float) -> list[Standing]:
        return [stop for stop in self.stops if now - stop.since > LATE]


def _is_all_kill(stop: Standing) -> bool:
    return stop.given.command is CommandKind.ALL_KILL
