# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What officials see of the race, as plain data: the only model of the race outside the rules.

The kart server makes the snapshot, and ``evgp_rcs_msgs/Race`` mirrors it field by field
(``messages``). The window, terminal, board and rehearsal have no other model. Whatever follows
from the fields is a property here, so that no screen has to work it out for itself.

Times are in seconds, on one clock: the clock of the rules in race control, or race control's wall
clock in a snapshot read from a message. Only differences between these times are meaningful.

The code is pure.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.link_quality import LinkQuality, POOR_LATELY
from evgp_rcs.rules.race import Alert, Availability, called, Heat, Kart, Race, TrackAccess

_TO_ONE_KART = tuple(kind for kind, entry in CATALOGUE.items() if entry.to_one_kart)
_TO_ALL = tuple(kind for kind in CATALOGUE if kind not in _TO_ONE_KART)


class KartSnapshot(NamedTuple):
    """One kart; `KartStatus.msg` explains the fields."""

    number: int
    team: str
    address: str
    in_race: bool
    connected: bool
    link: LinkQuality
    poor_lately: bool
    sent: RaceState
    sent_since: float
    acknowledged: bool
    delivered_after: float | None
    acknowledged_after: float | None
    reported: RaceState | None
    stopped_itself: bool
    counts_at: float | None
    hold: RaceState | None
    hold_reason: str
    may_be_moving: bool
    stands: bool
    settles_at: float | None
    place: int
    flag_at: float | None
    inspected: str
    attempt: int
    commands: tuple[Availability, ...]

    def __str__(self) -> str:
        """Return the name that officials use for this kart."""
        return called(self.number, self.team)

    @property
    def in_doubt(self) -> bool:
        """Return whether the kart may be moving while it must not move or is not connected."""
        return self.may_be_moving and not (self.connected and self.sent is RaceState.GREEN_GREEN)

    @property
    def says_no_more(self) -> bool:
        """Return whether the kart last reported the right state, but for an earlier command."""
        waits = self.connected and not self.acknowledged and self.sent is not RaceState.IN_GARAGE
        return waits and self.counts_at is None and self.reported is self.sent

    @property
    def settles(self) -> bool:
        """Return whether the kart reports its stop, but must keep reporting it for longer."""
        return self.in_doubt and self.connected and self.acknowledged and self.sent.is_red

    @property
    def flag_follows(self) -> bool:
        """Return whether the kart has finished, but drives on until it is sent its RED_FLAG."""
        drives = self.connected and self.sent is RaceState.GREEN_GREEN
        return drives and self.flag_at is not None

    @property
    def is_stopping(self) -> bool:
        """Return whether the kart is in doubt only because it is connected and being stopped."""
        return self.in_doubt and self.connected and self.sent.is_red

    def offered(self, command: CommandKind) -> Availability:
        """Return whether a command for this kart would be accepted."""
        return _offered(self.commands, command)


class Snapshot(NamedTuple):
    """
    The race at one time; `Race.msg` explains the fields.

    :param state: state of the race; None only before race control is first heard.
    :param banner: see the message. The ROS half adds this and ``officials``, which are parameters.
    """

    stamp: float
    state: RaceState | None
    state_since: float
    state_cause: str
    over: bool
    karts: tuple[KartSnapshot, ...]
    commands: tuple[Availability, ...]
    track: TrackAccess
    alerts: tuple[Alert, ...]
    race_since: float | None = None
    run: str = ''
    number: int = 0
    heats: tuple[Heat, ...] = ()
    heat: str = ''
    reading: int = 0
    banner: str = ''
    officials: tuple[str, ...] = ()
    able_to_stop: int = 0
    who_can_stop: str = ''
    button_fault: str = ''

    @property
    def heat_in_race(self) -> Heat | None:
        """Return the heat in the race; None if there is none."""
        return next((heat for heat in self.heats if heat.name == self.heat), None)

    @property
    def nobody_is_heard(self) -> bool:
        """Return whether humans are allowed on the track only because no kart is connected."""
        connected = any(kart.connected for kart in self.karts)
        return self.track.allowed and not self.track.msr_used and not connected

    @property
    def msr_alerts(self) -> list[Alert]:
        """Return the alerts that call for the Master Safety Remote, newest first."""
        return [alert for alert in self.alerts if alert.use_msr]

    @property
    def no_kart_in_doubt(self) -> bool:
        """Return whether, as far as is known, no kart may be moving where it must not."""
        is_known = self.track.allowed or self.track.settled_by is CommandKind.OPEN_TRACK
        doubted = any(kart.may_be_moving for kart in self.karts)
        return is_known and not doubted and not self.msr_alerts

    def kart(self, number: int) -> KartSnapshot | None:
        """Return the kart with this number; None if the snapshot has no such kart."""
        return next((kart for kart in self.karts if kart.number == number), None)

    def offered(self, command: CommandKind) -> Availability:
        """Return whether a command that is not for one kart would be accepted."""
        return _offered(self.commands, command)


def _offered(commands: Iterable[Availability], command: CommandKind) -> Availability:
    found = next((each for each in commands if each.command is command), None)
    return found or Availability(command, False)


NOTHING = Snapshot(
    stamp=0.0,
    state=None,
    state_since=0.0,
    state_cause='',
    over=False,
    karts=(),
    commands=(),
    track=TrackAccess(open=False, allowed=False, reason='', msr_used=False),
    alerts=(),
)
"""The snapshot that a screen has before it first hears race control."""


def snapshot_of(race: Race, now: float) -> Snapshot:
    """Return what officials see of the race at the time `now`, in seconds."""
    return Snapshot(
        stamp=now,
        state=race.state,
        state_since=race.state_since,
        state_cause=race.state_cause,
        over=race.over,
        karts=tuple(_kart(race, kart, now) for _, kart in sorted(race.karts.items())),
        commands=tuple(race.availability(kind, 0, now) for kind in _TO_ALL),
        track=race.track_access(),
        alerts=tuple(race.alerts(now)),
        race_since=race.race_since,
        run=race.run,
        number=race.number,
        heats=race.heats,
        heat=race.heat,
        reading=race.reading,
        **race.there._asdict(),
    )


_AS_IN_THE_RULES = {name for name in KartSnapshot._fields if hasattr(Kart, name)}


def _kart(race: Race, kart: Kart, now: float) -> KartSnapshot:
    return KartSnapshot(
        **{name: getattr(kart, name) for name in _AS_IN_THE_RULES},
        poor_lately=kart.link_poor_at is not None and now - kart.link_poor_at < POOR_LATELY,
        commands=tuple(race.availability(kind, kart.number, now) for kind in _TO_ONE_KART),
    )
