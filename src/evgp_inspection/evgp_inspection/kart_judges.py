# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
from typing import TypeAlias

from evgp_inspection.clauses import Clause
from evgp_inspection.judging import failed, judge_by, NOT_DONE, not_judged, passed
from evgp_inspection.limits import Limits
from evgp_inspection.traces import Event, Kind, Section, Trace, Word
from evgp_inspection.verdicts import Finding, Result, Verdict
from evgp_protocol.states import RaceState

GRID_ACTIVE, GREEN_GREEN = RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN
RED_FLAG, RED_RED = RaceState.RED_FLAG, RaceState.RED_RED

STANDS, TURNS = 'the wheels stand still', 'the wheels turn'
"""The names of the two questions, as they are in the trace."""

MOST_BYTES_A_SECOND = 4096 * 20
"""More bytes than this in one second are a flood."""

ROLLING = 0.1
"""Part of its highest speed at which a kart rolls, however it measures its standstill."""

ODOMETRY_VARIES = 0.15
"""By how much more odometry may be late than it was at the beginning of the same stop, s."""

SOONER = 0.95
"""Part of the time of a RED_FLAG stop after which a kart that nobody sees must say RED_RED."""

EARLY = 0.05
"""A wait that ended this much before its limit was not cut short, s."""

Judge: TypeAlias = Callable[[Trace, Limits], Finding]


def judge(clause: Clause, trace: Trace, limits: Limits) -> Result:
    """Judge a clause of a kart."""
    return judge_by(JUDGES, clause, trace, limits)


# ----- what several judges look at ------------------------------------------------------------


def moves(speed: float, limits: Limits) -> bool:
    """Return whether a speed, m/s, is none of a kart that stands still; NaN is none."""
    return not abs(speed) <= limits.standstill


def started(section: Section, limits: Limits) -> str:
    """Return how a kart that must stand has begun to drive, a sentence; empty: it has not."""
    for word in section.words:
        meant = word.order is not None and word.order.state is GREEN_GREEN
        if word.state is GREEN_GREEN and (meant or word.at > section.began + limits.slack):
            return f'It said $GREEN_GREEN; after {word.at - section.began:.2f} s.'
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
        green.word(GREEN_GREEN) is not None
        or any(moves(speed, limits) for _, speed in green.speeds)
    )


def _watched(section: Section, limits: Limits) -> bool:
    """Return whether odometry was there to the end of a phase."""
    speeds = section.speeds
    return bool(speeds) and section.ended - speeds[-1][0] <= limits.slack


NOT_DRIVEN = not_judged('The kart did not come to drive in this step.')


def _worst(findings: list[Finding]) -> Finding:
    """Return a failure if there is one, else what was not judged, else the slowest pass."""
    rank = {Verdict.FAIL: 2, Verdict.NOT_JUDGED: 1, Verdict.PASS: 0}
    return max(findings, key=lambda each: (rank[each.verdict], each.measured or 0.0))


# ----- the kinds of judges --------------------------------------------------------------------


def _acknowledges_in(
    section: Section, state: RaceState, seconds: float, link_stays: bool = False
) -> Finding:
    """Judge whether a kart acknowledges what it is sent in a phase, within so many seconds."""
    order = section.order(state)
    lost = section.of(Kind.CLOSED)
    if link_stays and lost:
        after = lost[0].at - section.began
        return failed(f'It dropped the connection after {after:.2f} s.', section)
    if order is None:
        return NOT_DONE
    # A connection that is made meanwhile is sent the order, too.
    words = [word for word in section.words if word.state is state]
    word = next((each for each in words if _is_due(each, state)), None)
    if word is not None:
        took = word.at - order.at
        if took > seconds + EARLY:
            return failed(f'It took {took:.2f} s to say ${state.value};.', section, measured=took)
        return passed(
            f'${state.value}; came {took:.3f} s after the order.', section, measured=took
        )
    waited = section.ended - order.at
    if waited < seconds - EARLY:
        return not_judged(f'The wait was cut short after {waited:.1f} s.', section)
    return failed(f'No ${state.value}; in {waited:.1f} s.', section, measured=waited)


def _acknowledges(state: RaceState, limit: str, *phases: str, link_stays: bool = False) -> Judge:
    """Judge whether the order of this state is acknowledged in each phase, within a limit."""

    def judge_phases(trace: Trace, limits: Limits) -> Finding:
        sections = [section for name in phases if (section := trace.called(name)) is not None]
        seconds: float = getattr(limits, limit)
        findings = [_acknowledges_in(each, state, seconds, link_stays) for each in sections]
        failed = [each for each in findings if each.verdict is Verdict.FAIL]
        if failed:
            return failed[0]
        return _worst(findings) if len(findings) == len(phases) else NOT_DONE

    return judge_phases


def _is_due(word: Word, state: RaceState) -> bool:
    return word.order is not None and word.order.state is state


def _stands(*phases: str, needs: Callable[[Trace, Limits], bool] | None = None) -> Judge:
    """Judge whether a kart that stands does not begin to drive in any of the phases."""

    def one(section: Section, limits: Limits) -> Finding:
        why = started(section, limits)
        if why:
            return failed(why, section)
        answer = section.answer(STANDS)
        if answer is not None and not answer.value:
            return failed('The inspector saw the wheels turn.', section)
        took = section.ended - section.began
        if answer is not None or _watched(section, limits):
            who = 'odometry' if answer is None else 'the inspector'
            return passed(f'It stood for {took:.1f} s; seen by {who}.', section)
        return not_judged('It did not say $GREEN_GREEN;, but nobody saw the wheels.', section)

    def judge_phases(trace: Trace, limits: Limits) -> Finding:
        sections = [section for name in phases if (section := trace.called(name)) is not None]
        if not sections or (needs is not None and not needs(trace, limits)):
            return NOT_DONE
        return _worst([one(section, limits) for section in sections])

    return judge_phases


def _stops(step: str, silent: bool) -> Judge:
    """Judge whether a kart that drives stops when it loses race control."""

    def judge_stop(trace: Trace, limits: Limits) -> Finding:
        lost = trace.called(f'{step}/lost')
        if lost is None:
            return NOT_DONE
        if not drove(trace, step, limits):
            return NOT_DRIVEN
        if lost.speeds and not any(moves(speed, limits) for _, speed in lost.speeds):
            return not_judged('The wheels did not turn when the connection was lost.', lost)
        return _stops_in(lost, lost.began, limits.silence if silent else 0.0, limits)

    return judge_stop


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
    return not_judged('Nobody saw the wheels.', section)


def _stops_early(trace: Trace, limits: Limits) -> Finding:
    section = trace.called('early/red')
    order = None if section is None else section.order(RED_RED)
    if section is None or order is None:
        return NOT_DONE
    return _stops_in(section, order.at, 0.0, limits)


def _killed(step: str) -> Judge:
    """Judge whether a kart that drives stops when a part of its program is killed."""

    def judge_stop(trace: Trace, limits: Limits) -> Finding:
        section = trace.called(f'{step}/kill')
        killed = [] if section is None else section.of(Kind.KILLED)
        if section is None or not killed:
            return not_judged(f'It was not killed: an inspector does that, or --kill-{step}.')
        if not drove(trace, step, limits):
            return NOT_DRIVEN
        # Who killed it says so a little later; a connection that ends does so at once.
        since = min(event.at for event in (killed[0], *section.of(Kind.CLOSED)))
        return _stops_in(section, since, limits.silence, limits)

    return judge_stop


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
    order = None if both is None else both.order(RED_RED)
    gentle = _finite(flag)
    compared: list[tuple[float, float]] = []  # for RED_RED, for RED_FLAG
    for section, since in ((red, red.began), (both, order.at if order else 0.0)):
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
    if hardly > limits.harder * gently:
        return failed(why, *shown, measured=hardly)
    return passed(why, *shown, measured=hardly)


def _says_so_sooner(flag: Section, red: Section) -> Finding:
    took: list[float] = []
    for section, state in ((flag, RED_FLAG), (red, RED_RED)):
        order = section.order(state)
        word = None if order is None else section.acknowledgement(order)
        if order is None or word is None:
            return not_judged('It did not acknowledge.', section)
        took.append(word.at - order.at)
    why = (
        f'It says that it stands after {took[0]:.2f} s for RED_FLAG, {took[1]:.2f} s for RED_RED.'
    )
    if took[1] > SOONER * took[0]:
        return failed(why, flag, red, measured=took[1])
    return passed(why, flag, red, measured=took[1])


def _true(state: RaceState, step: str, phase: str) -> Judge:
    """Judge whether the kart says that it stands only when it does."""

    def judge_word(trace: Trace, limits: Limits) -> Finding:
        section = trace.called(f'{step}/{phase}')
        if section is None:
            return NOT_DONE
        if not drove(trace, step, limits):
            return NOT_DRIVEN
        order = section.order(state)
        word = None if order is None else section.acknowledgement(order)
        if order is None or word is None:
            return not_judged('It did not acknowledge.', section)
        took = word.at - order.at
        speeds = section.speeds
        late = [(at, speed) for at, speed in speeds if at > word.at + limits.slack]
        lag = _lag(section, limits)
        rolling = ROLLING * max((speed for _, speed in _finite(section)), default=0.0)
        for at, speed in speeds:
            if (at > word.at + limits.slack and moves(speed, limits)) or (
                at > word.at + lag and abs(speed) > max(rolling, limits.standstill)
            ):
                why = (
                    f'It said ${state.value}; after {took:.3f} s; {at - word.at:.2f} s later, '
                    f'odometry says {speed:.2f} m/s.'
                )
                return failed(why, section, measured=took)
        before = [speed for at, speed in speeds if at <= section.began + limits.slack]
        at_speed = not speeds or (bool(before) and moves(before[0], limits))
        if at_speed and word.at - section.began < limits.fastest_stop:
            why = f'It said ${state.value}; after {took:.3f} s: no kart at speed stops that fast.'
            return failed(why, section, measured=took)
        answer = section.answer(STANDS)
        if answer is not None and not answer.value:
            why = f'It said ${state.value}; after {took:.3f} s; the inspector saw the wheels turn.'
            return failed(why, section, measured=took)
        if late or answer is not None:
            who = 'odometry' if late else 'the inspector'
            why = f'It said so after {took:.2f} s; {who} saw it stand.'
            return passed(why, section, measured=took)
        return not_judged(f'It said so after {took:.2f} s; nobody saw the wheels.', section)

    return judge_word


def _connects_again(step: str, phase: str = 'lost', since: str = 'lost') -> Judge:
    """Judge whether the kart makes a new connection after a loss."""

    def judge_connection(trace: Trace, limits: Limits) -> Finding:
        lost, back = trace.called(f'{step}/{since}'), trace.called(f'{step}/back')
        first = trace.called(f'{step}/{phase}')
        if lost is None or first is None:
            return NOT_DONE
        sections = [section for section in (first, back) if section is not None]
        opened = [event for section in sections for event in section.of(Kind.OPENED)]
        if opened:
            took = opened[0].at - lost.began
            if took > limits.reconnect + EARLY:
                return failed(f'It connected after {took:.1f} s only.', first, measured=took)
            return passed(f'It connected {took:.2f} s after the loss.', first, measured=took)
        waited = first.ended - lost.began
        if waited < limits.reconnect - EARLY:
            return not_judged(f'The wait was cut short after {waited:.1f} s.', first)
        return failed(f'No new connection in {waited:.1f} s.', first, measured=waited)

    return judge_connection


# ----- the judges that stand alone ------------------------------------------------------------


def _connects(trace: Trace, limits: Limits) -> Finding:
    section = trace.called('connect/wait')
    if section is None:
        return NOT_DONE
    opened = section.of(Kind.OPENED)
    if opened:
        took = opened[0].at - section.began
        return passed(f'It connected after {took:.1f} s.', section, measured=took)
    waited = section.ended - section.began
    if waited < limits.connect - EARLY:
        return not_judged('The wait was cut short.', section)
    return failed(f'No connection in {waited:.0f} s.', section, measured=waited)


def _drives(trace: Trace, limits: Limits) -> Finding:
    section = trace.called('race/green')
    order = None if section is None else section.order(GREEN_GREEN)
    if section is None or order is None:
        return NOT_DONE
    word = section.acknowledgement(order)
    if word is None:
        return not_judged('It did not acknowledge.', section)
    said = word.at - order.at
    turned = next((at for at, speed in section.speeds if moves(speed, limits)), None)
    if section.speeds:
        if turned is None or turned > word.at + limits.slack:
            why = f'It said $GREEN_GREEN; after {said:.2f} s, and its wheels stood still.'
            return failed(why, section, measured=said)
        took = max(turned - order.at, 0.0)
        return passed(f'The wheels turned after {took:.2f} s.', section, measured=took)
    answer = section.answer(TURNS)
    if answer is None:
        return not_judged('Nobody saw the wheels.', section)
    if not answer.value:
        why = 'It said $GREEN_GREEN;, and the inspector saw the wheels stand still.'
        return failed(why, section, measured=said)
    return passed('The inspector saw the wheels turn.', section, measured=said)


def _waits_for_its_own_word(trace: Trace, limits: Limits) -> Finding:
    section = trace.called('again/glued')
    if section is not None:
        said = section.word(GRID_ACTIVE)
        green = section.word(GREEN_GREEN)
        if said is not None and (green is None or said.at <= green.at):
            return passed('It acknowledged GRID_ACTIVE in between.', section)
    return _stands('again/glued')(trace, limits)


def _survives(trace: Trace, limits: Limits) -> Finding:
    section = trace.called('ready/malformed')
    if section is None:
        return NOT_DONE
    lost = section.of(Kind.CLOSED)
    if lost:
        after = lost[0].at - section.began
        return failed(f'It dropped the connection after {after:.2f} s.', section)
    return _acknowledges(RED_RED, 'red_red', 'ready/red', link_stays=True)(trace, limits)


def _says_nothing_first(trace: Trace, limits: Limits) -> Finding:
    section = trace.called('connect/quiet')
    if section is None:
        return NOT_DONE
    if section.words:
        return failed(f'It said {_what(section.words[0])}.', section)
    return _stands('connect/quiet')(trace, limits)


def _says_nothing_old(trace: Trace, limits: Limits) -> Finding:
    sections = [each for name in ('lost', 'quiet') if (each := trace.called(f'fin/{name}'))]
    links = {event.link for each in sections for event in each.of(Kind.OPENED)}
    if not links:
        return NOT_DONE
    for section in sections:
        for word in section.words:
            if word.link in links and word.order is None:
                why = f'It said {_what(word)}; nothing was sent on this connection yet.'
                return failed(why, *sections)
    return passed('It said nothing before it was sent anything.', *sections)


def _acknowledges_again(trace: Trace, limits: Limits) -> Finding:
    if trace.called('fin/red') is None:
        return NOT_DONE
    if _connects_again('fin')(trace, limits).verdict is not Verdict.PASS:
        return not_judged('It did not connect again by itself.')
    return _acknowledges(RED_RED, 'red_red', 'fin/red')(trace, limits)


OWN_CLAUSE = ('ready/red', 'backlog/red', 'fin/red', 'end/red')
"""The phases with a RED_RED that another clause is about."""


def _stops_when_told(trace: Trace, limits: Limits) -> Finding:
    sections = [
        section
        for section in trace.sections
        if section.order(RED_RED) is not None
        and section.name not in OWN_CLAUSE
        and not section.name.startswith('pieces/')
    ]
    if not sections:
        return NOT_DONE
    return _worst([_acknowledges_in(each, RED_RED, limits.red_red) for each in sections])


def _says_frames(trace: Trace, limits: Limits) -> Finding:
    words = [word for section in trace.sections for word in section.words]
    for section in trace.sections:
        for word in section.words:
            if word.state is None:
                return failed(f'It said {_what(word)}', section)
    if not words:
        return not_judged('It said nothing at all.')
    return passed(f'It said {len(words)} frames.')


def _says_what_it_is_sent(trace: Trace, limits: Limits) -> Finding:
    said = False
    for section in trace.sections:
        for word in section.words:
            said = True
            if word.state is None or word.order is None or word.state is word.order.state:
                continue
            # GREEN_GREEN that is not to be obeyed is RED_RED to the kart.
            careful = word.order.state is GREEN_GREEN and word.state is RED_RED
            since = word.at - word.order.at
            if since > limits.slack and not careful:
                why = f'It said {_what(word)} {since:.2f} s after it was sent '
                return failed(f'{why}{word.order.state.value}.', section, measured=since)
    if not said:
        return not_judged('It said nothing at all.')
    return passed('It said nothing but what it was being sent.')


def _what(word: Word) -> str:
    return f'bytes that are no frame: {word.reason}' if word.state is None else word.state.value


def _does_not_flood(trace: Trace, limits: Limits) -> Finding:
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
    if not said:
        return not_judged('It said nothing at all.')
    return passed(f'It said {most} bytes a second at most.')


def _one_connection(trace: Trace, limits: Limits) -> Finding:
    open_since: dict[int, float] = {}
    doubtful: dict[int, Event] = {}  # the older connection, and the event that opened the newer
    last = trace.events[-1].at if trace.events else 0.0
    for event in trace.events:
        if event.kind is Kind.OPENED:
            doubtful.update(dict.fromkeys(open_since, event))
            open_since[event.link] = event.at
        elif event.kind is Kind.CLOSED or (
            event.kind is Kind.ENDED and event.text != 'half-closed'
        ):
            open_since.pop(event.link, None)
            newer = doubtful.pop(event.link, None)
            if newer is not None and event.at > newer.at + limits.slack:
                return _two(event.link, newer, event.at)
    for link, newer in doubtful.items():
        if last > newer.at + limits.slack:
            return _two(link, newer, last)
    if not any(event.kind is Kind.OPENED for event in trace.events):
        return NOT_DONE
    return passed('It never had two connections.')


def _two(older: int, newer: Event, until: float) -> Finding:
    why = f'It opened connection {newer.link} and kept connection {older} open '
    return Finding(Verdict.FAIL, f'{why}for {until - newer.at:.1f} s.', None, (newer,))


def _acknowledged(state: RaceState, phase: str) -> Callable[[Trace, Limits], bool]:
    def holds(trace: Trace, limits: Limits) -> bool:
        section = trace.called(phase)
        return section is not None and section.word(state) is not None

    return holds


def _drove(*steps: str) -> Callable[[Trace, Limits], bool]:
    return lambda trace, limits: all(
        drove(trace, step, limits) for step in steps if trace.called(f'{step}/back') is not None
    )


JUDGES: dict[str, Judge] = {
    'K-3A-01': _stands('connect/garage', 'race/after'),
    'K-3A-02': _acknowledges(GRID_ACTIVE, 'grid', 'ready/grid'),
    'K-3A-03': _stands('ready/grid'),
    'K-3A-04': _acknowledges(GREEN_GREEN, 'green', 'race/green'),
    'K-3A-05': _drives,
    'K-3A-06': _acknowledges(RED_FLAG, 'red_flag', 'race/red_flag'),
    'K-3A-07': _true(RED_FLAG, 'race', 'red_flag'),
    'K-3A-08': _stands('race/stays', needs=_drove('race')),
    'K-3A-09': _stops_when_told,
    'K-3A-10': _true(RED_RED, 'red', 'red'),
    'K-3A-11': _acknowledges(GRID_ACTIVE, 'grid', 'again/grid'),
    'K-3A-12': _true(RED_RED, 'flag_red', 'red'),
    'K-3A-13': _brakes_harder,
    'K-3A-14': _stops_early,
    'K-3B-01': _stands('alone/green'),
    'K-3B-02': _stands('again/green', needs=_acknowledged(GRID_ACTIVE, 'again/grid')),
    'K-3B-03': _waits_for_its_own_word,
    'K-3B-04': _stands('race/flag_green', needs=_drove('race')),
    'K-3C-01': _stops('fin', silent=False),
    'K-3E-01': _stops('silence', silent=True),
    'K-3E-02': _stands('silence/back', needs=_drove('silence')),
    'K-3E-03': _stops('reset', silent=False),
    'K-3E-04': _stops('half', silent=False),
    'K-3E-05': _stands(
        'fin/back', 'reset/back', 'half/back', needs=_drove('fin', 'reset', 'half')
    ),
    'K-3E-06': _stands('restart/away', 'restart/back', needs=_drove('restart')),
    'K-3E-07': _stops('noise', silent=True),
    'K-3E-08': _true(RED_RED, 'cut', 'lost'),
    'K-3E-09': _killed('bridge'),
    'K-3E-10': _killed('stack'),
    'K-4A-01': _connects,
    'K-4A-02': _one_connection,
    'K-4C-01': _says_frames,
    'K-4C-02': _acknowledges(RED_RED, 'red_red', 'pieces/bytes', link_stays=True),
    'K-4C-03': _acknowledges(RED_RED, 'red_red', 'pieces/many', link_stays=True),
    'K-4C-04': _acknowledges(RED_RED, 'red_red', 'pieces/late', link_stays=True),
    'K-4C-05': _acknowledges(RED_RED, 'red_red', 'pieces/slow', link_stays=True),
    'K-4C-06': _acknowledges(RED_RED, 'red_red', 'backlog/red'),
    'K-4C-07': _stands('ready/malformed', needs=_acknowledged(GRID_ACTIVE, 'ready/grid')),
    'K-4C-08': _survives,
    'K-4C-09': _says_what_it_is_sent,
    'K-4C-10': _does_not_flood,
    'K-4C-11': _says_nothing_first,
    'K-4C-12': _says_nothing_old,
    'K-4D-01': _connects_again('fin'),
    'K-4D-02': _connects_again('reset'),
    'K-4D-03': _connects_again('half'),
    'K-4D-04': _connects_again('half_open'),
    'K-4D-05': _connects_again('restart', phase='back', since='back'),
    'K-4D-06': _acknowledges_again,
}
"""The judge of each clause."""
