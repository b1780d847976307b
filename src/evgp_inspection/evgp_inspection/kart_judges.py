# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The judges of a kart: a trace in, a finding out.

Pure: no socket, no clock, no question. Three rules:

1. A judge fails a kart only for something that is in the trace. What was not seen is not judged.
2. What a judge has not seen it does not pass: a kart that says nothing wrong may still drive.
3. Whoever judges knows what the step did before (`evgp_inspection.kart_steps` names the phases).
"""

from __future__ import annotations

from collections.abc import Callable
import math

from evgp_inspection.limits import Limits
from evgp_inspection.oracle import AROUND, breaches, halts, Law
from evgp_inspection.traces import Event, Kind, Section, Trace
from evgp_inspection.verdicts import (
    EARLY,
    failed,
    Finding,
    Judge,
    judge_of,
    NOT_DONE,
    not_judged,
    passed,
    SAID_NOTHING,
    Verdict,
    worst,
)
from evgp_protocol.states import RaceState

GRID_ACTIVE, GREEN_GREEN = RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN
RED_FLAG, RED_RED = RaceState.RED_FLAG, RaceState.RED_RED

STANDS, TURNS = 'the wheels stand still', 'the wheels turn'
"""The names of the two questions, as they are in the trace."""

MOST_BYTES_A_SECOND = 4096 * 12
"""More bytes than this in one second are a flood."""

ROLLING = 0.1
"""Part of its highest speed at which a kart rolls, however it measures its standstill."""

ODOMETRY_VARIES = 0.15
"""By how much more odometry may be late than it was at the beginning of the same stop, s."""

SOONER = 0.95
"""Part of the time of a RED_FLAG stop after which a kart that nobody sees must say RED_RED."""

MOVES = 'Fail: it says GREEN_GREEN, or the wheels turn.'
WHEELS_STOP = 'Fail: the wheels still turn after red_red, or begin to slow down too late.'
TURNS = ' Fail also: they turn after it has said that it stands.'
LINK_STAYS = ' Fail also: it drops the connection.'

NOT_DRIVEN = not_judged('The kart did not come to drive in this step.')
UNSEEN = 'Nobody saw the wheels.'


# ----- what several judges look at ------------------------------------------------------------


def moves(speed: float, limits: Limits) -> bool:
    """Return whether a speed, m/s, is none of a kart that stands still; NaN is none."""
    return not abs(speed) <= limits.standstill


def started(section: Section, limits: Limits) -> str:
    """Return how a kart that must stand has begun to drive, a sentence; empty: it has not."""
    for said in section.said:
        meant = said.sent is not None and said.sent.state is GREEN_GREEN
        if said.state is GREEN_GREEN and (meant or said.at > section.began + limits.slack):
            return f'It said $GREEN_GREEN; after {said.at - section.began:.2f} s.'
    stood = False
    for at, speed in section.speeds:
        if not moves(speed, limits):
            stood = True
        elif stood or at > section.began + limits.slack:
            return f'Odometry says {speed:.2f} m/s after {at - section.began:.2f} s.'
    return ''


def drove(trace: Trace, step: str, limits: Limits) -> bool:
    """Return whether the kart came to drive in a step."""
    green = trace.called(f'{step}/green')
    return green is not None and (
        green.first_said(GREEN_GREEN) is not None
        or any(moves(speed, limits) for _, speed in green.speeds)
    )


# ----- the kinds of judges --------------------------------------------------------------------


def _acknowledges_in(
    section: Section, state: RaceState, seconds: float, link_stays: bool = False
) -> Finding:
    """Judge whether a kart acknowledges what it is sent in a phase, within so many seconds."""
    sent = section.first_sent(state)
    lost = section.of(Kind.CLOSED)
    if link_stays and lost:
        after = lost[0].at - section.began
        return failed(f'It dropped the connection after {after:.2f} s.', section)
    if sent is None:
        return NOT_DONE
    # A connection that is made meanwhile is sent the state, too.
    due = (each for each in section.said if each.answers and each.answers.at >= sent.at)
    said = next((each for each in due if each.state is state), None)
    if said is not None:
        took = said.at - sent.at
        if took > seconds + EARLY:
            return failed(f'It took {took:.2f} s to say ${state.value};.', section, measured=took)
        why = f'${state.value}; came {took:.3f} s after the order.'
        return passed(why, section, measured=took)
    waited = section.ended - sent.at
    if waited < seconds - EARLY:
        return not_judged(f'The wait was cut short after {waited:.1f} s.', section)
    return failed(f'No ${state.value}; in {waited:.1f} s.', section, measured=waited)


def acknowledges(state: RaceState, limit: str, phase: str, link_stays: bool = False) -> Judge:
    """Judge whether the kart acknowledges this state in a phase, within a limit."""
    judged = f'Time from the order to ${state.value};.{LINK_STAYS if link_stays else ""}'

    @judge_of(phase, judged=judged, limit=limit)
    def find(trace: Trace, limits: Limits, section: Section) -> Finding:
        return _acknowledges_in(section, state, getattr(limits, limit), link_stays)

    return find


Needs = Callable[[Trace, Limits], bool]


def has_acknowledged(state: RaceState, phase: str) -> Needs:
    """Judge only where the kart has said a state in a phase."""

    def holds(trace: Trace, limits: Limits) -> bool:
        section = trace.called(phase)
        return section is not None and section.acknowledged(state) is not None

    return holds


def has_driven(*steps: str) -> Needs:
    """Judge only where the kart came to drive in those of these steps in which it came back."""
    return lambda trace, limits: all(
        drove(trace, step, limits) for step in steps if trace.called(f'{step}/back') is not None
    )


def stands(*phases: str, needs: Needs = lambda trace, limits: True) -> Judge:
    """Judge whether a kart that stands does not begin to drive in any of the phases."""

    def find(trace: Trace, limits: Limits) -> Finding:
        sections = [section for name in phases if (section := trace.called(name)) is not None]
        if not sections or not needs(trace, limits):
            return NOT_DONE
        return worst([_stands_in(section, limits) for section in sections])

    return Judge(find, MOVES, phases, starred=True)


def _stands_in(section: Section, limits: Limits) -> Finding:
    why = started(section, limits)
    if why:
        return failed(why, section)
    answer = section.answer(STANDS)
    if answer is not None and not answer.value:
        return failed('The inspector saw the wheels turn.', section)
    took, speeds = section.ended - section.began, section.speeds
    if answer is not None or (speeds and section.ended - speeds[-1][0] <= limits.slack):
        who = 'odometry' if answer is None else 'the inspector'
        return passed(f'It stood for {took:.1f} s; seen by {who}.', section)
    return not_judged('It did not say $GREEN_GREEN;, but nobody saw the wheels.', section)


def stops(step: str, silent: bool = False) -> Judge:
    """Judge whether a kart that drives stops when it loses race control."""

    @judge_of(f'{step}/lost', judged=WHEELS_STOP, limit='red_red', starred=True)
    def find(trace: Trace, limits: Limits, lost: Section) -> Finding:
        if not drove(trace, step, limits):
            return NOT_DRIVEN
        if lost.speeds and not any(moves(speed, limits) for _, speed in lost.speeds):
            return not_judged('The wheels did not turn when the connection was lost.', lost)
        return _stops_in(lost, lost.began, limits.silence if silent else 0.0, limits)

    return find


def _stops_in(section: Section, since: float, grace: float, limits: Limits) -> Finding:
    """
    Judge whether a kart comes to stand in a phase.

    :param since: when it had to stop, s.
    :param grace: time after that in which it need not know it yet, s.
    """
    due, limit = grace + limits.slack, grace + limits.red_red
    speeds = [(at - since, speed) for at, speed in section.speeds]
    moving = [at for at, speed in speeds if moves(speed, limits)]
    stood = next((at for at, _ in speeds if not moving or at > moving[-1]), None)
    answer = section.answer(STANDS)
    if stood is not None:
        stood = max(stood, 0.0)
        highest = max(abs(speed) for _, speed in speeds)
        fast = [at for at, speed in speeds if not abs(speed) < 0.9 * highest]
        if stood > limit + EARLY:
            why = f'The wheels stood after {stood:.1f} s only.'
            return failed(why, section, measured=stood)
        if moving and fast[-1] > due:
            why = f'It began to slow down after {fast[-1]:.2f} s only, not within {due:.2f} s.'
            return failed(why, section, measured=stood)
        return passed(f'The wheels stood after {stood:.2f} s.', section, measured=stood)
    if speeds and speeds[-1][0] >= limit - limits.slack:
        return failed(f'The wheels still turned after {speeds[-1][0]:.1f} s.', section)
    if answer is not None:
        took = answer.at - since
        if not answer.value:
            return failed('The inspector saw the wheels go on turning.', section, measured=took)
        # Where odometry fell silent, the question came late.
        if not speeds and took > limit + 2 * limits.slack:
            why = f'The inspector saw the wheels stand after {took:.1f} s only.'
            return failed(why, section, measured=took)
        why = f'The inspector saw the wheels stand, after {took:.1f} s at the latest.'
        return passed(why, section, measured=took)
    if speeds:
        return not_judged('Odometry fell silent, or the check was cut short.', section)
    return not_judged(UNSEEN, section)


@judge_of('early/red', judged=WHEELS_STOP + TURNS, limit='red_red', starred=True)
def stops_early(trace: Trace, limits: Limits, section: Section) -> Finding:
    """Judge whether a kart that has hardly begun to drive stops, and says so only then."""
    sent = section.first_sent(RED_RED)
    if sent is None:
        return NOT_DONE
    acknowledged = section.acknowledged(RED_RED)
    if acknowledged is not None:
        said = acknowledged[1].at
        stop = trace.called('red/red')  # where odometry shows how late it is
        lag = limits.slack if stop is None else _lag(stop, limits)
        for at, speed in section.speeds:
            if at > said + lag and moves(speed, limits):
                why = f'It said $RED_RED;; {at - said:.2f} s later, odometry says {speed:.2f} m/s.'
                return failed(why, section)
    return _stops_in(section, sent.at, 0.0, limits)


def stops_when_killed(step: str) -> Judge:
    """Judge whether a kart that drives stops when a part of its program is killed."""

    def find(trace: Trace, limits: Limits) -> Finding:
        section = trace.called(f'{step}/kill')
        killed = [] if section is None else section.of(Kind.KILLED)
        if section is None or not killed:
            return not_judged(f'It was not killed: an inspector does that, or --kill-{step}.')
        if not drove(trace, step, limits):
            return NOT_DRIVEN
        # Who killed it says so a little later; a connection that ends does so at once.
        since = min(event.at for event in (killed[0], *section.of(Kind.CLOSED)))
        return _stops_in(section, since, limits.silence, limits)

    return Judge(find, WHEELS_STOP, (f'{step}/kill',), 'red_red', starred=True)


def _fell(speeds: list[tuple[float, float]], level: float) -> float | None:
    """Return when the speed fell below a level for the last time, s; None: it did not."""
    above = [place for place, (_, speed) in enumerate(speeds) if speed >= level]
    if not above or above[-1] + 1 == len(speeds):
        return None
    (at, speed), (then, lower) = speeds[above[-1]], speeds[above[-1] + 1]
    return at + (then - at) * (speed - level) / max(speed - lower, 1e-9)


def _falling(speeds: list[tuple[float, float]], top: float) -> float | None:
    """Return how long it took to slow down from most of a speed to little of it, s."""
    fast, slow = _fell(speeds, 0.8 * top), _fell(speeds, 0.2 * top)
    return None if fast is None or slow is None else slow - fast


def _finite(section: Section) -> list[tuple[float, float]]:
    return [(at, abs(speed)) for at, speed in section.speeds if math.isfinite(speed)]


def _lag(section: Section, limits: Limits) -> float:
    """
    Return how late odometry is in a stop, at most, s.

    No kart brakes before it is told to, so odometry is no later than what it shows of that.
    """
    speeds = _finite(section)
    highest = max((speed for _, speed in speeds), default=0.0)
    slower, half = _fell(speeds, 0.8 * highest), _fell(speeds, 0.5 * highest)
    if not highest or slower is None or half is None:
        return limits.slack
    began = slower - (half - slower) * (0.2 / 0.3)
    return min(max(began - section.began, 0.0) + ODOMETRY_VARIES, limits.slack)


def _brakes_harder(trace: Trace, limits: Limits) -> Finding:
    flag, red = trace.called('race/red_flag'), trace.called('red/red')
    if flag is None or red is None:
        return NOT_DONE
    if not (drove(trace, 'race', limits) and drove(trace, 'red', limits)):
        return NOT_DRIVEN
    if not (flag.speeds and red.speeds):
        return _says_so_sooner(flag, red)
    both = trace.called('flag_red/red')
    sent = None if both is None else both.first_sent(RED_RED)
    gentle = _finite(flag)
    compared: list[tuple[float, float]] = []  # for RED_RED, for RED_FLAG
    for section, since in ((red, red.began), (both, sent.at if sent else 0.0)):
        if section is None or not since:
            continue
        begins = section.began if section is red else since + _lag(section, limits)
        hard = [each for each in _finite(section) if each[0] >= begins]
        highest = max((speed for _, speed in gentle), default=0.0)
        top = min(max((speed for _, speed in hard), default=0.0), highest)
        if top < 2 * ROLLING * highest:
            continue  # it stood nearly
        took, took_gently = _falling(hard, top), _falling(gentle, top)
        if took is not None and took_gently is not None:
            compared.append((took, took_gently))
    if not compared:
        return not_judged('No two stops could be measured.', flag, red)
    hardly, gently = max(compared, key=lambda each: each[0] / max(each[1], 1e-9))
    shown = [each for each in (flag, red, both) if each is not None]
    why = (
        f'From the same speed it stops in {hardly:.2f} s for RED_RED, {gently:.2f} s for RED_FLAG.'
    )
    told = failed if hardly > limits.harder * gently else passed
    return told(why, *shown, measured=hardly)


def _says_so_sooner(flag: Section, red: Section) -> Finding:
    took: list[float] = []
    for section, state in ((flag, RED_FLAG), (red, RED_RED)):
        acknowledged = section.acknowledged(state)
        if acknowledged is None:
            return not_judged('It did not acknowledge.', section)
        took.append(acknowledged[1].at - acknowledged[0].at)
    why = (
        f'It says that it stands after {took[0]:.2f} s for RED_FLAG, {took[1]:.2f} s for RED_RED.'
    )
    told = failed if took[1] > SOONER * took[0] else passed
    return told(why, flag, red, measured=took[1])


brakes_harder = Judge(
    _brakes_harder,
    'Fail: for RED_RED it takes more than a part (harder) of the time that it takes for RED_FLAG. '
    'Without odometry, the times to its words count.',
    ('race/red_flag', 'red/red', 'flag_red/red'),
)


def says_it_when_true(state: RaceState, step: str, phase: str, back: bool = False) -> Judge:
    """
    Judge whether the kart says that it stands only when it does.

    :param back: it is sent the state as it comes back, and has braked since it was away.
    """
    judged = (
        'Fail: the wheels turn after it, or it comes faster than a kart at speed can stop '
        '(fastest_stop).'
    )

    @judge_of(f'{step}/{phase}', judged=judged, starred=True)
    def find(trace: Trace, limits: Limits, section: Section) -> Finding:
        if not drove(trace, step, limits):
            return NOT_DRIVEN
        acknowledged = section.acknowledged(state)
        if acknowledged is None:
            return not_judged('It did not acknowledge.', section)
        sent, said = acknowledged
        took = said.at - sent.at
        why = f'It said ${state.value}; after {took:.3f} s'
        speeds = section.speeds
        as_sent = [speed for at, speed in speeds if at <= sent.at]
        if as_sent and not moves(as_sent[-1], limits) and not back:
            return not_judged(f'It stood already when {state.value} was sent.', section)
        late = [(at, speed) for at, speed in speeds if at > said.at + limits.slack]
        lag = _lag(section, limits)
        rolling = ROLLING * max((speed for _, speed in _finite(section)), default=0.0)
        for at, speed in speeds:
            if (at > said.at + limits.slack and moves(speed, limits)) or (
                at > said.at + lag and abs(speed) > max(rolling, limits.standstill)
            ):
                why += f'; {at - said.at:.2f} s later, odometry says {speed:.2f} m/s.'
                return failed(why, section, measured=took)
        before = [speed for at, speed in speeds if at <= section.began + limits.slack]
        at_speed = not speeds or (bool(before) and moves(before[0], limits))
        if at_speed and said.at - section.began < limits.fastest_stop:
            why += ': no kart at speed stops that fast.'
            return failed(why, section, measured=took)
        answer = section.answer(STANDS)
        if answer is not None and not answer.value:
            return failed(f'{why}; the inspector saw the wheels turn.', section, measured=took)
        if late or answer is not None:
            who = 'odometry' if late else 'the inspector'
            return passed(f'{why}; {who} saw it stand.', section, measured=took)
        return not_judged(f'{why}; nobody saw the wheels.', section)

    return find


def connects(step: str, phase: str = 'lost', limit: str = 'reconnect') -> Judge:
    """Judge whether the kart makes a connection, from the beginning of a phase on."""

    @judge_of(f'{step}/{phase}', judged='Time to the next connection.', limit=limit)
    def find(trace: Trace, limits: Limits, section: Section) -> Finding:
        back = trace.called(f'{step}/back')
        sections = [section] if back is None else [section, back]
        opened = [event for section in sections for event in section.of(Kind.OPENED)]
        seconds: float = getattr(limits, limit)
        if opened:
            took = opened[0].at - section.began
            if took > seconds + EARLY:
                return failed(f'It connected after {took:.1f} s only.', section, measured=took)
            return passed(f'It connected after {took:.2f} s.', section, measured=took)
        waited = section.ended - section.began
        if waited < seconds - EARLY:
            return not_judged(f'The wait was cut short after {waited:.1f} s.', section)
        return failed(f'No new connection in {waited:.1f} s.', section, measured=waited)

    return find


def keeps(law: Law) -> Judge:
    """Judge whether the wheels keep a law at every moment of the whole inspection."""

    def find(trace: Trace, limits: Limits) -> Finding:
        seen = [halt for halt in halts(trace, limits) if halt.speeds]
        asked = [halt for halt in seen if any(told.law is law for told in halt.told)]
        if not asked:
            return not_judged('No odometry showed it.')
        breach = next((each for each in breaches(trace, limits) if each.law is law), None)
        if breach is None:
            speeds = sum(len(halt.speeds) for halt in asked)
            return passed(f'{speeds} speeds of odometry in {len(asked)} halts were judged.')
        around = tuple(each for each in trace.events if abs(each.at - breach.at) <= AROUND)
        return Finding(Verdict.FAIL, f'At {breach.at:.2f} s. {breach.why}', None, around)

    return Judge(
        find,
        'Fail: at any moment of the inspection, the wheels turn where they must stand, turn '
        'again, begin to slow down too late, or slow down less than for other RED_RED. Needs '
        'odometry.',
    )


# ----- the judges that stand alone ------------------------------------------------------------


@judge_of(
    'race/green',
    judged='Fail: the wheels stand still when it says $GREEN_GREEN;.',
    limit='green',
    starred=True,
)
def drives(trace: Trace, limits: Limits, section: Section) -> Finding:
    """Judge whether the kart drives when it says so."""
    if section.first_sent(GREEN_GREEN) is None:
        return NOT_DONE
    acknowledged = section.acknowledged(GREEN_GREEN)
    if acknowledged is None:
        return not_judged('It did not acknowledge.', section)
    sent, word = acknowledged
    said = word.at - sent.at
    turned = next((at for at, speed in section.speeds if moves(speed, limits)), None)
    if section.speeds:
        if turned is None or turned > word.at + limits.slack:
            why = f'It said $GREEN_GREEN; after {said:.2f} s, and its wheels stood still.'
            return failed(why, section, measured=said)
        took = max(turned - sent.at, 0.0)
        return passed(f'The wheels turned after {took:.2f} s.', section, measured=took)
    answer = section.answer(TURNS)
    if answer is None:
        return not_judged(UNSEEN, section)
    if not answer.value:
        why = 'It said $GREEN_GREEN;, and the inspector saw the wheels stand still.'
        return failed(why, section, measured=said)
    return passed('The inspector saw the wheels turn.', section, measured=said)


@judge_of('again/glued', judged=f'{MOVES[:-1]}, and it has not said GRID_ACTIVE.', starred=True)
def waits_for_its_own_word(trace: Trace, limits: Limits, section: Section) -> Finding:
    """Judge whether GRID_ACTIVE that the kart has not acknowledged does not arm it."""
    acknowledged, green = section.acknowledged(GRID_ACTIVE), section.first_said(GREEN_GREEN)
    if acknowledged is not None and (green is None or acknowledged[1].at <= green.at):
        return passed('It acknowledged GRID_ACTIVE in between.', section)
    return _stands_in(section, limits)


def _survives(trace: Trace, limits: Limits) -> Finding:
    section, red = trace.called('ready/malformed'), trace.called('ready/red')
    if section is None:
        return NOT_DONE
    lost = section.of(Kind.CLOSED)
    if lost:
        after = lost[0].at - section.began
        return failed(f'It dropped the connection after {after:.2f} s.', section)
    return NOT_DONE if red is None else _acknowledges_in(red, RED_RED, limits.red_red, True)


survives = Judge(
    _survives, f'Time to $RED_RED;.{LINK_STAYS}', ('ready/malformed', 'ready/red'), 'red_red'
)


@judge_of('connect/quiet', judged='Fail: it says anything, or the wheels turn.', starred=True)
def says_nothing_first(trace: Trace, limits: Limits, section: Section) -> Finding:
    """Judge whether a kart that was sent nothing yet is quiet and stands."""
    if section.said:
        return failed(f'It said {section.said[0]}.', section)
    return _stands_in(section, limits)


def _says_nothing_old(trace: Trace, limits: Limits) -> Finding:
    sections = [each for name in ('lost', 'quiet') if (each := trace.called(f'fin/{name}'))]
    links = {event.link for each in sections for event in each.of(Kind.OPENED)}
    if not links:
        return NOT_DONE
    for said in (said for section in sections for said in section.said):
        if said.link in links and said.sent is None:
            why = f'It said {said}; nothing was sent on this connection yet.'
            return failed(why, *sections)
    return passed('It said nothing before it was sent anything.', *sections)


says_nothing_old = Judge(_says_nothing_old, 'Fail: it says anything.', ('fin/lost', 'fin/quiet'))


@judge_of('fin/red', judged='Time from the order to $RED_RED;.', limit='red_red')
def acknowledges_again(trace: Trace, limits: Limits, section: Section) -> Finding:
    """Judge whether a kart that has come back by itself acknowledges a stop."""
    if connects('fin').find(trace, limits).verdict is not Verdict.PASS:
        return not_judged('It did not connect again by itself.')
    return _acknowledges_in(section, RED_RED, limits.red_red)


OF_ANOTHER_CLAUSE = ('ready/red', 'backlog/red', 'fin/red', 'end/red')
"""The phases with a RED_RED that another clause is about."""


def _stops_when_told(trace: Trace, limits: Limits) -> Finding:
    sections = [
        section
        for section in trace.sections
        if section.first_sent(RED_RED) is not None
        and section.name not in OF_ANOTHER_CLAUSE
        and not section.name.startswith('pieces/')
    ]
    findings = [_acknowledges_in(each, RED_RED, limits.red_red) for each in sections]
    return worst(findings) if findings else NOT_DONE


stops_when_told = Judge(
    _stops_when_told,
    'The longest time from the order to $RED_RED;.',
    ('first_stop/red', 'race/red', 'red/red'),
    'red_red',
)


@judge_of(judged='Fail: it says the state of an earlier order after slack.')
def says_what_it_is_sent(trace: Trace, limits: Limits) -> Finding:
    """Judge whether the kart says back nothing but what it is being sent."""
    for section in trace.sections:
        for said in section.said:
            if said.state is None or said.sent is None or said.state is said.sent.state:
                continue
            # GREEN_GREEN that is not to be obeyed is RED_RED to the kart. And it may stop itself.
            careful = said.sent.state in (GRID_ACTIVE, GREEN_GREEN) and said.state is RED_RED
            since = said.at - said.sent.at
            if since > limits.slack and not careful:
                why = f'It said {said} {since:.2f} s after it was sent {said.sent.state.value}.'
                return failed(why, section, measured=since)
    if not any(section.said for section in trace.sections):
        return SAID_NOTHING
    return passed('It said nothing but what it was being sent.')


@judge_of(judged='Fail: more than 49152 bytes in 1 s, 4096 for each frame that is sent.')
def does_not_flood(trace: Trace, limits: Limits) -> Finding:
    """Judge whether the kart says no more than race control can read."""
    said = [event for event in trace.events if event.kind is Kind.SAID]
    first, size, most = 0, 0, 0
    for event in said:
        size += len(event.data)
        while said[first].at < event.at - 1.0:
            size -= len(said[first].data)
            first += 1
        most = max(most, size)
        if size > MOST_BYTES_A_SECOND:
            why = f'It said {size} bytes in one second.'
            return Finding(Verdict.FAIL, why, None, tuple(said[first:][-20:]))
    return passed(f'It said {most} bytes a second at most.') if said else SAID_NOTHING


@judge_of(judged='Fail: it opens a connection and keeps another one open (slack).')
def has_one_connection(trace: Trace, limits: Limits) -> Finding:
    """Judge whether the kart never keeps two connections."""
    open_since: dict[int, float] = {}
    doubtful: dict[int, Event] = {}  # the older connection, and the event that opened the newer
    last = trace.events[-1].at if trace.events else 0.0
    ended: list[tuple[int, Event, float]] = []
    for event in trace.events:
        if event.kind is Kind.OPENED:
            doubtful.update(dict.fromkeys(open_since, event))
            open_since[event.link] = event.at
        elif event.kind is Kind.CLOSED or (
            event.kind is Kind.ENDED and event.text != 'half-closed'
        ):
            open_since.pop(event.link, None)
            if newer := doubtful.pop(event.link, None):
                ended.append((event.link, newer, event.at))
    for older, newer, until in (*ended, *((link, new, last) for link, new in doubtful.items())):
        if until > newer.at + limits.slack:
            why = f'It opened connection {newer.link} and kept connection {older} open '
            why += f'for {until - newer.at:.1f} s.'
            return Finding(Verdict.FAIL, why, None, (newer,))
    if not any(event.kind is Kind.OPENED for event in trace.events):
        return NOT_DONE
    return passed('It never had two connections.')
