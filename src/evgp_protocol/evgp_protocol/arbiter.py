# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The arbiter decides which race state the kart must obey now (§2.B, §2.C, §3.A, §3.E).

Three rules apply to this module:

1. It uses no clock, socket, ROS, thread or log. Each input carries its monotonic time in seconds,
   and the same inputs always give the same outputs.
2. It contains all the rules that a kart obeys, and nothing else. The bridge (``evgp_kart_bridge``)
   and a kart without ROS (``kart``) use it and add no rules; tests compare ``kit/c/evgp_kart.h``
   with it.
3. Doubt means stop. A rule may only be made stricter.

Theory of operation. Every input first lets time pass: whatever was due happens before the input
is judged, so a frame that arrives after the timeout is too late. The verdict follows from a few
facts:

* *commanded*: the last frame on the current connection. Nothing is commanded without a connection
  or before its first frame, and a connection without a frame for ``frame_timeout`` is lost.
* *order*: the number of the current command. Every new command gets a number that no earlier
  command had, on this connection or another, even if it asks for the same state again. The same
  command gets a new number when a team stop takes the kart out, and when a team stop ends. A stack
  acknowledges this number, so an earlier acknowledgement never counts for a later command, nor
  after a team stop.
* *team stop*: any stop that begins on the kart. It comes from the service; from the team's safety
  remote or the MSR's contact, by a message or by silence (``tsr_timeout``, ``msr_timeout``); from
  a doubt about the kart's nodes, such as two where only one is allowed; or from a bridge that
  would not hear its team's stop (``team_timeout``).
* *armed*: the kart would obey GREEN_GREEN. Only this table sets or clears it:

  ================================================= =============================
  a commanded GRID_ACTIVE is acknowledged           armed
  GRID_ACTIVE, then GREEN_GREEN is commanded        as before
  any other change of what is commanded             not armed
  the connection is lost, or a new one made         not armed
  a team stop begins                                not armed
  ================================================= =============================

* *out*: a team stop began while the kart was armed. The kart then obeys RED_RED, even after the
  team stop ends, until race control commands anything but GREEN_GREEN or the kart reconnects.
  Race control did not command that RED_RED; as far as it knows, the kart is ready or racing. Once
  the kart stands still, it therefore reports RED_RED, like an acknowledgement, but only once for
  each command: a second report could be mistaken for an acknowledgement of a later RED_RED.
* *slowing*: the kart was allowed to drive when RED_FLAG was commanded, and since then it has not
  acknowledged RED_FLAG, has had no team stop, and has not used up ``red_flag_drive_time``.
  RED_FLAG thus lets a moving kart steer to a stop, and never lets a standing one move.

The kart must obey RED_RED without a command, during a team stop, while it is out, and if
GREEN_GREEN is commanded while it is not armed. Otherwise it must obey the command. So releasing a
team stop or reconnecting never makes a kart race.
"""

from __future__ import annotations

import dataclasses
import enum
import math

from evgp_protocol.states import RaceState, stricter

ODOMETRY_FRESH = 0.5
"""Maximum age of a speed that counts, in seconds."""

_NOT_YET = 'not connected to race control yet'
_NOTHING_SAID = 'race control has sent nothing on this connection yet'
_NEVER_ARMED = 'no GRID_ACTIVE was acknowledged on this connection'
_NOT_ACKNOWLEDGED = 'the last GRID_ACTIVE was not acknowledged'
_OUT = 'the kart stopped itself after it acknowledged GRID_ACTIVE, and needs a new GRID_ACTIVE'


class StopSource(enum.Enum):
    """
    The source of a team stop (§2.B, §2.C). Each source must release its own stop.

    The value is the reason that people read when the source stops the kart.
    """

    SERVICE = 'requested by service'
    TSR = 'the safety remote says stop'
    MSR = "the MSR's contact is open"
    TEAM = "the bridge does not receive its team's messages"
    GRAPH = 'two nodes have one role, or a remote cannot be heard'
    ODOMETRIES = 'more than one publisher of odometry'  # one may stand still, the other move

    __hash__ = object.__hash__  # as of RaceState


_SILENCE = {
    StopSource.TSR: 'nothing from the safety remote',
    StopSource.MSR: "nothing from the MSR's contact",
    StopSource.TEAM: "the bridge has not received its team's messages",
}
"""The reason that people read when the silence of a source stops the kart."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """
    The parameters of the rules. Times are in seconds, speeds in m/s.

    :ivar frame_timeout: time without a frame after which the connection is lost; above 0.
    :ivar tsr_timeout: time without a message from the team's safety remote after which this counts
        as a team stop; with 0, no remote is required.
    :ivar msr_timeout: time without a message about the MSR's contact after which this counts as a
        team stop; with 0, no contact is wired.
    :ivar team_timeout: time without a sign that the bridge receives its team's messages after
        which this counts as a team stop; with 0, no sign is required.
    :ivar odometry_required: refuse to acknowledge GRID_ACTIVE or a red state unless odometry shows
        a standstill, and GREEN_GREEN unless it shows motion (§3.A). Once any odometry was heard,
        and with `auto_acknowledge_stop`, this always applies.
    :ivar auto_acknowledge_stop: acknowledge the red states when odometry shows a standstill.
    :ivar standstill_speed: maximum speed of a kart that stands still; 0 or more.
    :ivar standstill_time: uninterrupted time at standstill after which the kart has stopped; 0 or
        more.
    :ivar red_flag_drive_time: time for which RED_FLAG lets a kart that was driving continue; 0 or
        more.
    :ivar drive_in_garage: let the kart drive in IN_GARAGE, where its team has it (§3.A).
    :raises ValueError: if a value is outside its range or not finite.
    """

    frame_timeout: float = 1.0
    tsr_timeout: float = 0.0
    msr_timeout: float = 0.0
    team_timeout: float = 0.0
    odometry_required: bool = False
    auto_acknowledge_stop: bool = False
    standstill_speed: float = 0.05
    standstill_time: float = 0.5
    red_flag_drive_time: float = 15.0
    drive_in_garage: bool = False

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f'{field.name} must be a finite number from 0, not {value!r}')
        if self.frame_timeout == 0:
            raise ValueError('frame_timeout must be above 0')


@dataclasses.dataclass(frozen=True)
class Verdict:
    """
    What the kart must do now.

    The other fields are those of ``KartRaceState.msg`` (evgp_rcs_msgs), but None means UNKNOWN.

    :ivar acknowledged: whether `reached` has been acknowledged. A team stop that takes the kart
        out resets this.
    :ivar may_drive: whether the kart may move. It may always steer and brake.
    """

    state: RaceState
    commanded: RaceState | None
    order: int
    connected: bool
    team_stop: bool
    reached: RaceState | None
    acknowledged: bool
    reason: str
    may_drive: bool


@dataclasses.dataclass(frozen=True)
class Reaction:
    """
    The result of one input.

    :ivar verdict: what the kart must do after the input.
    :ivar send: the state to send to race control, if any.
    :ivar give_up: why the socket must be closed; None if it must not.
    :ivar refusal: why an acknowledgement is refused, and what is missing; empty if it is accepted.
    """

    verdict: Verdict
    send: RaceState | None = None
    give_up: str | None = None
    refusal: str = ''


class Arbiter:
    """
    Decides what the kart must obey. Its one owner passes in every input in order of time.

    If a time is before an earlier one, that is a doubt: the connection counts as lost and the
    remotes as silent. Every input raises ValueError if its time is not finite.

    :param first_order: the number of the first command, 1 or more; later commands count up from
        it. Choose one far from those of earlier arbiters of this kart, because an acknowledgement
        may be on its way while the bridge restarts.
    :param race_control: the address of race control, for messages only.
    :param odometry: the topic of the kart's odometry, for messages only.
    """

    def __init__(
        self,
        settings: Settings,
        first_order: int,
        race_control: str = 'race control',
        odometry: str = '~/odom',
    ) -> None:
        if first_order < 1:
            raise ValueError(f'first_order must be 1 or more, not {first_order}')
        self._settings = settings
        self._race_control, self._odometry = race_control, odometry
        self._next_order = first_order
        self._now = -math.inf
        # The connection.
        self._open = False
        self._absence = _NOT_YET
        self._heard_at = 0.0  # the last frame, or the connection if there was none yet
        self._commanded: RaceState | None = None
        self._order = 0
        self._acknowledged = False
        self._armed = False
        self._not_armed = _NEVER_ARMED
        self._out = False
        self._slowing_since: float | None = None
        # The team's stop.
        self._engaged: dict[StopSource, str] = {}  # with the reasons
        self._stopped = True  # the stop was on after the last input, or began in this one
        timeouts = {
            StopSource.TSR: settings.tsr_timeout,
            StopSource.MSR: settings.msr_timeout,
            StopSource.TEAM: settings.team_timeout,
        }
        self._timeouts = {source: time for source, time in timeouts.items() if time > 0}
        # When each was last heard. Those not heard yet, or silent for too long, are missing.
        self._signs: dict[StopSource, float] = {}
        self._starting = True  # no message from the team yet; for the reason only
        # Odometry.
        self._speed = math.nan
        self._speed_at = -math.inf
        self._odometry_expected = settings.odometry_required or settings.auto_acknowledge_stop
        self._still_since: float | None = None  # only while a red state is unacknowledged

    @property
    def verdict(self) -> Verdict:
        """Return what the kart must do as of the last input."""
        commanded = self._commanded
        reasons = []
        team_stop = self._team_stop
        if team_stop:  # first, because a second bridge may cause the others
            reasons.append(self._team_stop_reason())
        if commanded is None:
            reasons.append(self._absence)
        if commanded is RaceState.GREEN_GREEN and not self._armed:
            reasons.append(
                'GREEN_GREEN needs an acknowledged GRID_ACTIVE before it: ' + self._not_armed
            )
        elif self._out:
            reasons.append(_OUT)
        own = RaceState.RED_RED if reasons else RaceState.GREEN_GREEN
        state = stricter(own, RaceState.RED_RED if commanded is None else commanded)
        return Verdict(
            state=state,
            commanded=commanded,
            order=self._order,
            connected=commanded is not None,
            team_stop=team_stop,
            reached=self._reached(state),
            acknowledged=self._acknowledged,
            reason='; '.join(reasons) if state is not commanded else '',
            may_drive=self._may_drive(state),
        )

    @property
    def deadline(self) -> float | None:
        """Time at which `tick` changes something if no input arrives first; None for never."""
        due = []
        if self._open:
            due.append(self._heard_at + self._settings.frame_timeout)
        due += [at + self._timeouts[source] for source, at in self._signs.items()]
        if self._slowing_since is not None:
            due.append(self._slowing_since + self._settings.red_flag_drive_time)
        return min(due, default=None)

    @property
    def starting(self) -> bool:
        """Return whether the bridge still waits for the first sign that it receives its team."""
        return self._starting and StopSource.TEAM in self._missed

    @property
    def missing_odometry(self) -> str:
        """Return why missing odometry prevents acknowledgements; empty if it does not."""
        if not self._odometry_expected:
            return ''
        topic = self._odometry
        if two := self._engaged.get(StopSource.ODOMETRIES):
            return f'{two}; only one may publish {topic}'
        if self._now - self._speed_at <= ODOMETRY_FRESH:
            return ''
        return f'no odometry on {topic} for {ODOMETRY_FRESH:g} s: is this its topic?'

    @property
    def awaited(self) -> tuple[RaceState, str] | None:
        """Return the state not acknowledged yet, and why it cannot be now; None if none."""
        reached = self.verdict.reached
        if reached is None or reached is RaceState.IN_GARAGE or self._acknowledged:
            return None
        return reached, self._refusal(reached, self._order)

    def tick(self, now: float) -> Reaction:
        """Let time pass."""
        return self._reaction(self._pass(now))

    def connected(self, now: float) -> Reaction:
        """Begin a new connection to race control; the previous one counts as lost."""
        self._pass(now)  # any socket to give up belongs to the earlier connection
        self._lose(_NOTHING_SAID)
        self._open = True
        self._heard_at = now
        return self._reaction(None)

    def disconnected(self, reason: str, now: float) -> Reaction:
        """
        End the connection, or update the reason why there is none.

        :param reason: the reason, to follow 'not connected to race control: '.
        """
        give_up = self._pass(now)
        self._lose(f'not connected to race control: {reason}')
        return self._reaction(give_up)

    def heard(self, state: RaceState, now: float, since: float | None = None) -> Reaction:
        """
        Handle a frame from race control. Without a connection it is too late, and ignored.

        :param since: a time before which the frame had not arrived; None for `now`. The silence
            counts from then, because the frame may have waited until the kart read it.
        """
        give_up = self._pass(now)
        if self._open:
            self._heard_at = max(self._heard_at, now if since is None else since)
            if state is not self._commanded:
                self._command(state, now)
        return self._reaction(give_up)

    def team_stop(self, source: StopSource, engaged: bool, now: float, why: str = '') -> Reaction:
        """
        Engage or release one source's team stop; the kart stops while any is engaged (§2.C).

        :param why: the reason that people read; empty for the source's own.
        """
        give_up = self._pass(now)
        others = {each: reason for each, reason in self._engaged.items() if each is not source}
        self._engaged = others | ({source: why or source.value} if engaged else {})
        self._sign(source, now)
        if source is StopSource.ODOMETRIES:
            # Two publishers count as odometry too, but the last speed may be the wrong one's.
            self._odometry_expected = self._odometry_expected or engaged
            self._speed_at = -math.inf
        if self._team_stop:
            self._on_team_stop()
        return self._reaction(give_up)

    def team_heard(self, now: float) -> Reaction:
        """Record that the bridge receives its team's messages, so that a stop would arrive."""
        give_up = self._pass(now)
        self._starting = False
        self._sign(StopSource.TEAM, now)
        return self._reaction(give_up)

    def acknowledge(self, state: RaceState, order: int, now: float) -> Reaction:
        """
        Judge the stack's acknowledgement of a command (§4.C).

        A repeated acknowledgement is accepted and sent again, but if the kart is out, it is sent
        only once.

        :param state: the state that the kart has reached, from a verdict's `reached`.
        :param order: the number of the command, from the same verdict.
        :return: a reaction with `refusal` or `send`.
        """
        give_up = self._pass(now)
        if refusal := self._refusal(state, order):
            return self._reaction(give_up, refusal=refusal)
        said = self._out and self._acknowledged
        self._acknowledge()
        return self._reaction(give_up, send=None if said else state)

    def speed(self, metres_per_s: float, now: float) -> Reaction:
        """Record the kart's speed from odometry, in m/s; the sign does not matter."""
        give_up = self._pass(now)
        gap = now - self._speed_at > ODOMETRY_FRESH
        self._speed, self._speed_at = abs(metres_per_s), now
        # A base whose odometry stops may have failed at speed.
        self._odometry_expected = True
        reached = self.verdict.reached
        waiting = reached is not None and reached.is_red and not self._acknowledged
        # NaN is not within the limit, so it is not a standstill.
        still = not self.missing_odometry and self._speed <= self._settings.standstill_speed
        if not (self._settings.auto_acknowledge_stop and waiting and still):
            self._still_since = None
        elif self._still_since is None or gap:
            self._still_since = now
        if self._still_since is None or now < self._still_since + self._settings.standstill_time:
            return self._reaction(give_up)
        self._acknowledge()
        return self._reaction(give_up, send=reached)

    # Common to all inputs.

    def _reaction(
        self, give_up: str | None, send: RaceState | None = None, refusal: str = ''
    ) -> Reaction:
        stopped = self._team_stop
        if self._stopped and not stopped:
            self._number()  # an acknowledgement from before the team stop must not count after it
        self._stopped = stopped
        return Reaction(self.verdict, send, give_up, refusal)

    def _pass(self, now: float) -> str | None:
        """Let what is due by `now` happen; return why the socket must be closed, if it must."""
        if not math.isfinite(now):
            raise ValueError(f'a time must be a finite number, not {now!r}')
        settings = self._settings
        give_up = None
        if now < self._now:
            self._signs = {}
            self._speed_at = -math.inf
            if self._open:
                give_up = 'the clock went backwards'
        elif self._open and now >= self._heard_at + settings.frame_timeout:
            peer = self._race_control
            if self._commanded is None:
                give_up = f'{peer} accepts but sends no race state: is it race control?'
            else:
                give_up = f'{peer} was silent for {settings.frame_timeout:g} s'
        self._now = now
        if give_up is not None:
            self._lose(f'not connected to race control: {give_up}')
        signs = self._signs
        self._signs = {each: at for each, at in signs.items() if now < at + self._timeouts[each]}
        if len(self._signs) < len(signs):
            self._on_team_stop()
        slowing = self._slowing_since
        if slowing is not None and now >= slowing + settings.red_flag_drive_time:
            self._slowing_since = None
        return give_up

    # The connection.

    def _lose(self, absence: str) -> None:
        """Reset the connection; `absence` says why there is none."""
        self._open = False
        self._absence = absence
        self._commanded = None
        self._order = 0
        self._acknowledged = False
        self._armed = False
        self._not_armed = _NEVER_ARMED
        self._out = False
        self._slowing_since = None
        self._still_since = None

    def _command(self, state: RaceState, now: float) -> None:
        was_driving = self.verdict.may_drive
        to_race = self._commanded is RaceState.GRID_ACTIVE and state is RaceState.GREEN_GREEN
        self._commanded = state
        self._number()
        self._acknowledged = False
        self._still_since = None
        slows = was_driving and state is RaceState.RED_FLAG
        self._slowing_since = now if slows and self._settings.red_flag_drive_time > 0 else None
        if not to_race:
            self._disarm(f'{state.value} was commanded after it')
            self._out = False
        if state is RaceState.GRID_ACTIVE:
            self._not_armed = _NOT_ACKNOWLEDGED

    def _number(self) -> None:
        """Give the current command, if any, a new number."""
        if self._commanded is not None:
            self._order, self._next_order = self._next_order, self._next_order + 1

    def _acknowledge(self) -> None:
        """Record that the verdict's `reached` is acknowledged."""
        self._acknowledged = True
        self._slowing_since = None
        self._still_since = None
        self._armed = self._armed or (self._commanded is RaceState.GRID_ACTIVE and not self._out)

    def _refusal(self, state: RaceState, order: int) -> str:
        """Return why this acknowledgement is refused now; empty if it is accepted."""
        verdict = self.verdict
        if verdict.commanded is None:
            return f'{state.value} is not commanded: {self._absence}'
        if order == 0:
            return (
                'order is missing: use the `order` of the ~/race_state message that the kart '
                'acted on'
            )
        if order != verdict.order:
            return (
                f'order {order} is out of date: the current order is {verdict.order}, '
                f'{verdict.commanded.value}'
            )
        if state is not verdict.reached:
            if state is verdict.commanded:
                return f'the kart must obey {verdict.state.value}: {verdict.reason}'
            return (
                f'race control commands {verdict.commanded.value}, not {state.value}: '
                f'acknowledge {verdict.commanded.value} once the kart has reached it'
            )
        if state is RaceState.IN_GARAGE or not self._odometry_expected:
            return ''
        if missing := self.missing_odometry:
            return missing
        return self._contradiction(state)

    def _reached(self, state: RaceState) -> RaceState | None:
        """Return what to acknowledge once a kart that obeys `state` has reached it."""
        if self._out:
            return RaceState.RED_RED
        to_race = self._commanded in (RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN)
        return None if to_race and state is not self._commanded else self._commanded

    def _contradiction(self, state: RaceState) -> str:
        """Return how the last speed contradicts this state; NaN does. Empty if it does not."""
        speed, limit = self._speed, self._settings.standstill_speed
        said = f'odometry says {speed:.2f} m/s'
        if state is RaceState.GREEN_GREEN:
            return '' if speed > limit else f'{said}: acknowledge GREEN_GREEN once the kart drives'
        if speed <= limit:
            return ''
        said += f', which is not a standstill (standstill_speed is {limit:g} m/s)'
        return said + ': the kart is still moving' * (speed > limit)

    def _disarm(self, why: str) -> None:
        """Do not obey GREEN_GREEN until a GRID_ACTIVE is acknowledged."""
        if self._armed:
            self._armed = False
            self._not_armed = why

    # The team's stop.

    @property
    def _team_stop(self) -> bool:
        return bool(self._engaged or self._missed)

    @property
    def _missed(self) -> list[StopSource]:
        """Return the sources that must be heard but are silent."""
        return [source for source in self._timeouts if source not in self._signs]

    def _sign(self, source: StopSource, now: float) -> None:
        if source in self._timeouts:
            self._signs = {**self._signs, source: now}

    def _team_stop_reason(self) -> str:
        reasons = [self._engaged[each] for each in StopSource if each in self._engaged]
        for source in self._missed:
            if source is StopSource.TEAM and self._starting:
                reasons.append('the bridge is starting')
            else:
                reasons.append(f'{_SILENCE[source]} for {self._timeouts[source]:g} s')
        return 'the kart stops itself: ' + ', '.join(reasons)

    def _on_team_stop(self) -> None:
        """End everything that allowed the kart to drive, so that it does not outlive the stop."""
        self._stopped = True
        self._slowing_since = None
        if self._armed:
            self._out = True
            self._acknowledged = False
            # A stack that acted on this command's GREEN_GREEN must not acknowledge the RED_RED.
            self._number()
        self._disarm('a team stop came after it')

    def _may_drive(self, state: RaceState) -> bool:
        if state is RaceState.RED_FLAG:
            return self._slowing_since is not None
        if state is RaceState.IN_GARAGE:
            return self._settings.drive_in_garage
        return state is RaceState.GREEN_GREEN
