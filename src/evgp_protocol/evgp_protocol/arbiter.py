# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The arbiter: which race state the kart must obey now (§2.B, §2.C, §3.A, §3.E).

Three rules of what lives here:

1. No clock, socket, ROS, thread or log. Each input brings its monotonic time in seconds, and
   the same inputs always give the same outputs.
2. All of the rules that a kart obeys, and nothing else. The bridge (``evgp_kart_bridge``) and a
   kart without ROS (``kart``) ask it and know none; ``kit/c/evgp_kart.h`` is held against it.
3. Doubt means stop. Each rule may only be made stricter.

Theory of operation. Every input first lets time pass: what was due by then happens before the
input is judged, so a frame that comes after a silence that was too long comes too late. The
verdict follows from a few facts:

* *commanded*: the last frame on the present connection; none while there is no connection, or
  no frame on it yet. A connection on which ``frame_timeout`` passes without a frame is lost.
* *order*: the number of what is commanded. Every new command has one that no earlier command had,
  on this connection or another, also when it asks for the same state again. The same command gets
  a new one when a team stop takes the kart out, and when a team stop ends. A stack acknowledges by
  this number, so what it said before never counts for a later command, nor after a team stop.
* *team stop*: any stop that begins on the kart: the service, the word or the silence of the team's
  safety remote (``tsr_timeout``) or of the MSR's contact (``msr_timeout``), two nodes where there
  must be one, or a bridge that would not hear its team's stop (``team_timeout``).
* *armed*: GREEN_GREEN would be obeyed. This table is all that makes it so or ends it:

  ================================================= =============================
  a commanded GRID_ACTIVE is acknowledged           armed
  GRID_ACTIVE, then GREEN_GREEN is commanded        as before
  any other change of what is commanded             not armed
  the connection is lost, or a new one made         not armed
  a team stop begins                                not armed
  ================================================= =============================

* *out*: a team stop began while the kart was armed. It then obeys RED_RED until race control
  commands anything but GREEN_GREEN, or is connected to again, also once the team stop is over.
  Nobody commanded that RED_RED, and race control takes the kart for one that is ready or races. So
  once it stands the kart says RED_RED, as it acknowledges one that is commanded: but once only for
  each command, since no second one must be there for a later RED_RED.

* *slowing*: the kart was allowed to drive when RED_FLAG was commanded, and has since neither
  acknowledged it, nor met a team stop, nor used up ``red_flag_drive_time``. So RED_FLAG lets a
  moving kart steer itself to a stop, and never lets a standing one move.

The state to obey is RED_RED without a command, under a team stop, while the kart is out, and under
a GREEN_GREEN that is not armed; otherwise it is what is commanded. So the release of a team stop,
or the return of a lost connection, never makes a kart race.
"""

from __future__ import annotations

import dataclasses
import enum
import math

from evgp_protocol.states import RaceState, stricter

ODOMETRY_FRESH = 0.5
"""Time for which a speed says something about the kart, in seconds."""

_NOT_YET = 'not connected to race control yet'
_NOTHING_SAID = 'race control has said nothing on this connection yet'
_NEVER_ARMED = 'no GRID_ACTIVE was acknowledged on this connection'
_NOT_ACKNOWLEDGED = 'the last GRID_ACTIVE was not acknowledged'
_OUT = 'it has stopped itself since it acknowledged GRID_ACTIVE, and needs another one'


class StopSource(enum.Enum):
    """Where a team stop comes from (§2.B, §2.C); each must release its own."""

    SERVICE = 'service'
    TSR = 'tsr'  # the team's safety remote
    MSR = 'msr'  # the contact of the officials' remote is open: it takes the motor's power
    TEAM = 'team'  # the bridge does not hear its team, so it would hear no stop either
    UNRELIABLE = 'unreliable'  # a remote's messages could get lost; nobody can release it
    TWO_REMOTES = 'two remotes'  # one may say stop and the other go
    TWO_BRIDGES = 'two bridges'  # nobody knows to which of them the stack listens
    TWO_LOCKS = 'two locks'  # nobody knows to which of them the motors listen
    TWO_ODOMETRIES = 'two odometries'  # one may stand while the other moves
    TWO_ANSWERERS = 'two answerers'  # one may say that a state is acknowledged which is not
    TWO_STOPPERS = 'two stoppers'  # one may say that the kart stops which does not


_WHY = {
    StopSource.SERVICE: 'asked for by service',
    StopSource.TSR: 'the safety remote says stop',
    StopSource.MSR: "the MSR's contact is open",
    StopSource.TEAM: 'the bridge does not hear its own team',
    StopSource.UNRELIABLE: (
        'a publisher of ~/tsr or ~/msr is not RELIABLE; start the bridge again'
    ),
    StopSource.TWO_REMOTES: 'more than one publisher of ~/tsr or of ~/msr',
    StopSource.TWO_BRIDGES: 'two bridges',
    StopSource.TWO_LOCKS: 'another node publishes ~/stop or ~/state',
    StopSource.TWO_ODOMETRIES: 'more than one publisher of odometry',
    StopSource.TWO_ANSWERERS: 'another node offers ~/acknowledge',
    StopSource.TWO_STOPPERS: 'another node offers ~/team_stop',
}
"""What each source says when it stops the kart, for people."""

_SILENCE = {
    StopSource.TSR: 'nothing from the safety remote',
    StopSource.MSR: "nothing from the MSR's contact",
    StopSource.TEAM: 'the bridge has not heard its own team',
}
"""What its silence means, for people."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """
    The parameters of the rules. Times are in seconds, speeds in m/s.

    :ivar frame_timeout: time without a frame after which the connection is lost; above 0.
    :ivar tsr_timeout: time without a message of the team's safety remote after which it is a team
        stop; 0: no remote is required.
    :ivar msr_timeout: time without a message about the MSR's contact after which it is a team
        stop; 0: no contact is wired.
    :ivar team_timeout: time without a sign that the bridge hears its team after which it is a team
        stop; 0: no sign is required.
    :ivar odometry_required: a red state is not acknowledged without odometry that shows a
        standstill, nor GREEN_GREEN without odometry that shows a movement (§3.A). This holds
        anyway once any odometry was heard, or with `auto_acknowledge_stop`.
    :ivar auto_acknowledge_stop: acknowledge the red states when odometry shows a standstill.
    :ivar standstill_speed: maximum speed of a kart that stands still; from 0.
    :ivar standstill_time: time at standstill, without a gap, after which the kart has stopped;
        from 0.
    :ivar red_flag_drive_time: time for which a RED_FLAG lets a kart that was driving go on;
        from 0.
    :ivar drive_in_garage: the kart may drive in IN_GARAGE, where its team has it (§3.A).
    :raises ValueError: a value is outside its range, or no finite number.
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
        """Refuse what no rule can work with."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f'{field.name} must be a finite number from 0, not {value!r}')
        if self.frame_timeout == 0:
            raise ValueError('frame_timeout must be above 0')


@dataclasses.dataclass(frozen=True)
class Names:
    """
    What the sentences for people call the things around the arbiter. No rule depends on them.

    :ivar race_control: where race control is.
    :ivar odometry: the topic of the kart's odometry.
    :ivar graph: the ROS graph of the kart.
    """

    race_control: str = 'race control'
    odometry: str = '~/odom'
    graph: str = 'this ROS domain'


@dataclasses.dataclass(frozen=True)
class Verdict:
    """
    What holds now.

    :ivar state: the state to obey.
    :ivar commanded: what race control commands on the present connection; None: nothing.
    :ivar order: the number of that command, another one after a team stop; 0 while there is none.
    :ivar connected: race control is being heard.
    :ivar team_stop: a stop of the kart's own is on: the team's (§2.C), the MSR's contact (§2.B),
        or a doubt about either.
    :ivar reached: what to acknowledge once the kart has reached `state`: what is commanded, or
        RED_RED if it is out; None: nothing.
    :ivar acknowledged: that was acknowledged. A team stop that takes the kart out takes it back.
    :ivar reason: why `state` and `commanded` differ, a sentence; empty when they do not.
    :ivar may_drive: the kart may move. Steering and braking are always the stack's.
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
class Answer:
    """
    The answer to an acknowledgement.

    :ivar accepted: it is sent to race control.
    :ivar message: a sentence for the person; when refused, what is missing.
    """

    accepted: bool
    message: str


@dataclasses.dataclass(frozen=True)
class Outcome:
    """
    What follows from one input.

    :ivar verdict: what holds after it.
    :ivar send: the state to say to race control, if any.
    :ivar give_up: why the socket must be given up; None: it need not.
    :ivar answer: the answer, if the input was an acknowledgement.
    :ivar hindrance: why the speed that was the input keeps a red from being acknowledged, a
        sentence; empty when it does not.
    """

    verdict: Verdict
    send: RaceState | None = None
    give_up: str | None = None
    answer: Answer | None = None
    hindrance: str = ''


class Arbiter:
    """
    Decides what the kart obeys. It has one owner, who gives every input in order of time.

    A time before an earlier one is doubt: the connection is lost and the remote unheard. Every
    input raises ValueError when its time is no finite number.

    :param first_order: the number of the first command, from 1; the next commands have the numbers
        after it. Take one that no earlier arbiter of this kart came near to: an acknowledgement
        may be on its way while the bridge starts again.
    :param names: for the sentences.
    """

    def __init__(self, settings: Settings, first_order: int, names: Names | None = None) -> None:
        if first_order < 1:
            raise ValueError(f'first_order must be 1 or more, not {first_order}')
        self._settings = settings
        self._names = names or Names()
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
        self._engaged = dict.fromkeys(StopSource, False)
        self._who: dict[StopSource, str] = {}  # for the reason only
        self._stopped = True  # it was on after the last input, or began in this one
        timeouts = {
            StopSource.TSR: settings.tsr_timeout,
            StopSource.MSR: settings.msr_timeout,
            StopSource.TEAM: settings.team_timeout,
        }
        self._timeouts = {source: time for source, time in timeouts.items() if time > 0}
        # When each of these was heard; not in here: not yet, or silent for too long.
        self._signs: dict[StopSource, float] = {}
        self._starting = True  # the team was not heard yet; for the reason only
        # Odometry.
        self._speed = math.nan
        self._speed_at = -math.inf
        self._odometry_expected = settings.odometry_required or settings.auto_acknowledge_stop
        self._still_since: float | None = None  # only while a red waits to be acknowledged

    @property
    def verdict(self) -> Verdict:
        """Return what holds as of the last input."""
        commanded = self._commanded
        reasons = []
        if self._engaged[StopSource.TWO_BRIDGES]:  # first: the others may follow from it
            reasons.append(f'another bridge runs in {self._names.graph}: end one of them')
        if commanded is None:
            reasons.append(self._absence)
        team_stop = self._team_stop
        if team_stop:
            reasons.append(self._team_stop_reason())
        if commanded is RaceState.GREEN_GREEN and not self._armed:
            reasons.append(
                'GREEN_GREEN needs a GRID_ACTIVE that is acknowledged before it: '
                + self._not_armed
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
        """When `tick` will change something if nothing comes before; None: never."""
        due = []
        if self._open:
            due.append(self._heard_at + self._settings.frame_timeout)
        due += [at + self._timeouts[source] for source, at in self._signs.items()]
        if self._slowing_since is not None:
            due.append(self._slowing_since + self._settings.red_flag_drive_time)
        return min(due, default=None)

    @property
    def starting(self) -> bool:
        """Whether the bridge has not heard its own team yet, as it must first of all."""
        return self._starting and StopSource.TEAM in self._missed

    @property
    def missing_odometry(self) -> str:
        """Why, as of the last input, no red can be acknowledged for want of odometry; or empty."""
        if not self._odometry_expected:
            return ''
        topic = self._names.odometry
        if self._engaged[StopSource.TWO_ODOMETRIES]:
            return f'{self._why(StopSource.TWO_ODOMETRIES)}; {topic} must have one'
        if self._now - self._speed_at <= ODOMETRY_FRESH:
            return ''
        return f'no odometry on {topic} for {ODOMETRY_FRESH:g} s: is this its topic?'

    @property
    def awaited(self) -> RaceState | None:
        """What the stack could acknowledge as of the last input, and has not; None: nothing."""
        reached = self.verdict.reached
        if reached in (None, RaceState.IN_GARAGE) or self._acknowledged:
            return None
        return None if self._refusal(reached, self._order) else reached

    def tick(self, now: float) -> Outcome:
        """Let time pass."""
        return self._outcome(self._pass(now))

    def connected(self, now: float) -> Outcome:
        """Begin a new connection to race control, whatever became of the last."""
        self._pass(now)  # what it may give up is an earlier connection's socket
        self._lose(_NOTHING_SAID)
        self._open = True
        self._heard_at = now
        return self._outcome(None)

    def disconnected(self, reason: str, now: float) -> Outcome:
        """
        End the connection, or say why there still is none.

        :param reason: why, to go behind 'not connected to race control: '.
        """
        give_up = self._pass(now)
        self._lose(f'not connected to race control: {reason}')
        return self._outcome(give_up)

    def heard(self, state: RaceState, now: float) -> Outcome:
        """Take a frame from race control. Without a connection it comes too late to count."""
        give_up = self._pass(now)
        if self._open:
            self._heard_at = now
            if state is not self._commanded:
                self._command(state, now)
        return self._outcome(give_up)

    def team_stop(self, source: StopSource, engaged: bool, now: float, who: str = '') -> Outcome:
        """
        Engage or release the team's stop; it is on while any source engages it (§2.C).

        :param who: who the cause is, for the reason.
        """
        give_up = self._pass(now)
        self._engaged[source] = engaged
        self._who[source] = who
        self._sign(source, now)
        if source is StopSource.TWO_ODOMETRIES:
            # Who has two has odometry; and whose the last speed was, nobody knows.
            self._odometry_expected = self._odometry_expected or engaged
            self._speed_at = -math.inf
        if self._team_stop:
            self._on_team_stop()
        return self._outcome(give_up)

    def team_heard(self, now: float) -> Outcome:
        """Take note that the bridge hears its team now: a stop would get here."""
        give_up = self._pass(now)
        self._starting = False
        self._sign(StopSource.TEAM, now)
        return self._outcome(give_up)

    def acknowledge(self, state: RaceState, order: int, now: float) -> Outcome:
        """
        Judge the stack's word that it has carried out a command (§4.C).

        An acknowledgement that was accepted before is accepted, and sent, again; but of a kart
        that is out it is sent once.

        :param state: the state that it has reached, as a verdict had it in `reached`.
        :param order: the number of the command, as a verdict had it.
        :return: with `answer`, and if it is accepted with `send`.
        """
        give_up = self._pass(now)
        refusal = self._refusal(state, order)
        if refusal is not None:
            return self._outcome(give_up, answer=Answer(False, refusal))
        said = self._out and self._acknowledged
        self._acknowledge()
        return self._outcome(
            give_up,
            send=None if said else state,
            answer=Answer(True, f'{state.value} is acknowledged'),
        )

    def speed(self, metres_per_s: float, now: float) -> Outcome:
        """Take the kart's speed from odometry, in m/s; the sign means nothing."""
        give_up = self._pass(now)
        gap = now - self._speed_at > ODOMETRY_FRESH
        self._speed, self._speed_at = abs(metres_per_s), now
        # A base that had odometry and lost it may have died at speed.
        self._odometry_expected = True
        reached = self.verdict.reached
        waiting = reached is not None and reached.is_red and not self._acknowledged
        # A speed that is no number is not within the limit, hence not a standstill.
        still = not self.missing_odometry and self._speed <= self._settings.standstill_speed
        if not (self._settings.auto_acknowledge_stop and waiting and still):
            self._still_since = None
        elif self._still_since is None or gap:
            self._still_since = now
        if self._still_since is None or (now < self._still_since + self._settings.standstill_time):
            hindrance = self.missing_odometry or self._motion()
            return self._outcome(give_up, hindrance=hindrance if waiting else '')
        self._acknowledge()
        return self._outcome(give_up, send=reached)

    # What the inputs have in common.

    def _outcome(
        self,
        give_up: str | None,
        send: RaceState | None = None,
        answer: Answer | None = None,
        hindrance: str = '',
    ) -> Outcome:
        stopped = self._team_stop
        if self._stopped and not stopped:
            self._number()  # what was said before the team stop must not count after it
        self._stopped = stopped
        return Outcome(self.verdict, send, give_up, answer, hindrance)

    def _pass(self, now: float) -> str | None:
        """Let what is due by `now` happen; return why the socket must be given up, if so."""
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
            peer = self._names.race_control
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
        """Have no connection; `absence` says why."""
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
        """Have race control command another state than before."""
        was_driving = self.verdict.may_drive
        to_race = self._commanded is RaceState.GRID_ACTIVE and state is RaceState.GREEN_GREEN
        self._commanded = state
        self._number()
        self._acknowledged = False
        self._still_since = None
        slows = was_driving and state is RaceState.RED_FLAG
        self._slowing_since = now if slows and self._settings.red_flag_drive_time > 0 else None
        if not to_race:
            self._disarm(f'{state.value} was commanded since')
            self._out = False
        if state is RaceState.GRID_ACTIVE:
            self._not_armed = _NOT_ACKNOWLEDGED

    def _number(self) -> None:
        """Give what is commanded, if anything is, a number that nothing had before."""
        if self._commanded is not None:
            self._order, self._next_order = self._next_order, self._next_order + 1

    def _acknowledge(self) -> None:
        """Have what the verdict has in `reached` acknowledged."""
        self._acknowledged = True
        self._slowing_since = None
        self._still_since = None
        self._armed = self._armed or (self._commanded is RaceState.GRID_ACTIVE and not self._out)

    def _refusal(self, state: RaceState, order: int) -> str | None:
        """Return why this acknowledgement is refused now; None: it is not."""
        verdict = self.verdict
        if verdict.commanded is None:
            return f'{state.value} is not commanded: {self._absence}'
        if order == 0:
            return (
                'order is missing: fill in the number that ~/race_state had as `order` with the '
                'command that the kart has carried out'
            )
        if order != verdict.order:
            return (
                f'order {order} is out of date: the present one is {verdict.order}, '
                f'{verdict.commanded.value}'
            )
        if state is not verdict.reached:
            if state is verdict.commanded:
                return f'the kart must obey {verdict.state.value}: {verdict.reason}'
            return (
                f'race control commands {verdict.commanded.value}, not {state.value}: '
                f'acknowledge {verdict.commanded.value} once the kart has reached it'
            )
        if state.is_red and self._odometry_expected:
            return self.missing_odometry or self._motion() or None
        if state is RaceState.GREEN_GREEN and self._odometry_expected:
            return self._standstill() or None
        return None

    def _reached(self, state: RaceState) -> RaceState | None:
        """Return what to acknowledge once a kart that obeys `state` has reached it."""
        if self._out:
            return RaceState.RED_RED
        to_race = self._commanded in (RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN)
        return None if to_race and state is not self._commanded else self._commanded

    def _standstill(self) -> str:
        """Return why nothing shows that the kart has begun to drive; empty: odometry does."""
        if self.missing_odometry or self._speed > self._settings.standstill_speed:
            return self.missing_odometry
        return f'odometry says {self._speed:.2f} m/s: acknowledge GREEN_GREEN once the kart drives'

    def _motion(self) -> str:
        """Return why the last speed is no standstill; empty: it is one."""
        limit = self._settings.standstill_speed
        if self._speed <= limit:
            return ''
        if math.isnan(self._speed):
            return (
                'odometry gives NaN as the speed, so nobody knows whether the kart stands '
                f'(standstill_speed is {limit:g} m/s)'
            )
        return (
            f'odometry says {self._speed:.2f} m/s, which is more than standstill_speed '
            f'({limit:g} m/s), so the kart still moves'
        )

    def _disarm(self, why: str) -> None:
        """Have GREEN_GREEN not obeyed, until a GRID_ACTIVE is acknowledged."""
        if self._armed:
            self._armed = False
            self._not_armed = why

    # The team's stop.

    @property
    def _team_stop(self) -> bool:
        return any(self._engaged.values()) or bool(self._missed)

    @property
    def _missed(self) -> list[StopSource]:
        """What must be heard, and is not."""
        return [source for source in self._timeouts if source not in self._signs]

    def _sign(self, source: StopSource, now: float) -> None:
        if source in self._timeouts:
            self._signs = {**self._signs, source: now}

    def _why(self, source: StopSource) -> str:
        """Return what a source says when it stops the kart."""
        who = self._who.get(source)
        return f'{_WHY[source]}: {who}' if who else _WHY[source]

    def _team_stop_reason(self) -> str:
        reasons = [self._why(source) for source, engaged in self._engaged.items() if engaged]
        for source in self._missed:
            if source is StopSource.TEAM and self._starting:
                reasons.append('the bridge is starting')
            else:
                reasons.append(f'{_SILENCE[source]} for {self._timeouts[source]:g} s')
        return 'the kart stops itself: ' + ', '.join(reasons)

    def _on_team_stop(self) -> None:
        """Let nothing that allowed the kart to drive outlive a team stop."""
        self._stopped = True
        self._slowing_since = None
        if self._armed:
            self._out = True
            self._acknowledged = False
            # Who acted on the GREEN_GREEN of the same command must not say that the kart stands.
            self._number()
        self._disarm('the team stop was engaged since')

    def _may_drive(self, state: RaceState) -> bool:
        """Return whether the kart may drive while it obeys `state`."""
        if state is RaceState.RED_FLAG:
            return self._slowing_since is not None
        if state is RaceState.IN_GARAGE:
            return self._settings.drive_in_garage
        return state is RaceState.GREEN_GREEN
