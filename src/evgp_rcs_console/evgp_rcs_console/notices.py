# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Keeps what the screen shows besides the state of the race: the alerts and the event log.

The module is pure.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
import itertools
from typing import NamedTuple

from evgp_node.official import UNNAMED
from evgp_protocol.link import Grade, GRADES
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.race import Alert, AlertKind, Event, EventKind, StampedEvent
from evgp_rcs.words import Cell, numbered, STATES, time_of_day, Tone
from evgp_rcs_console import texts

NO_SINGLE_KART = 'the whole race'
ALERT_MSR, ALERT_OTHER, ALERT_ENDED = '⚠ USE THE MSR', '! ALERT', 'ENDED'
ALERT_WAS = {
    AlertKind.NOT_READY: '{kart} was not ready',
    AlertKind.GREEN_UNACKNOWLEDGED: '{kart} had not acknowledged GREEN GREEN',
    AlertKind.FLAG_UNACKNOWLEDGED: '{kart} had not acknowledged RED FLAG',
    AlertKind.RED_UNACKNOWLEDGED: '{kart} had not acknowledged RED RED',
    AlertKind.KART_LOST: '{kart} had lost its connection',
    AlertKind.LOST_IN_MOTION: '{kart} lost its connection, perhaps while moving',
    AlertKind.TRACK_UNSAFE: 'the track was open but not safe',
    AlertKind.MOVING_UNASKED: '{kart} reported GREEN GREEN without being asked to',
    AlertKind.RECORD_FAILING: 'the record failed',
    AlertKind.TWO_RACE_CONTROLS: 'two race controls were running',
    AlertKind.LINK_POOR: '{kart} had a poor link',
    AlertKind.TWO_PROGRAMS: '{kart} had two programs trying to control it',
    AlertKind.NOBODY_THERE: 'no official could stop the race',
    AlertKind.BUTTON_FAULT: 'a stop button did not work',
    AlertKind.PART_FAILED: 'part of race control had failed',
    AlertKind.GRAPH_TROUBLE: "the officials' network had a fault",
}
"""What each alert was about, shown once it has ended."""

NEW_RUN = '— race control was restarted —'


def alert_was(kind: AlertKind, kart: int) -> str:
    """Return what an alert that has ended was about, as a sentence."""
    about = ALERT_WAS[kind].format(kart=f'kart {kart}')
    return f'{about[:1].upper()}{about[1:]}'


@dataclass(frozen=True)
class Notice:
    """
    An alert as the official sees it.

    :param number: identifies the notice on this screen. Newer notices have higher numbers.
    :param alert: race control's alert; None for a notice that this console raised itself.
    :param lasts: whether the cause of the alert still exists.
    :param said: the text to show instead of the alert's sentence; empty to show the sentence.
    """

    number: int
    alert: Alert | None
    seen: bool = False
    lasts: bool = True
    said: str = ''

    @property
    def use_msr(self) -> bool:
        """Return whether to use the Master Safety Remote; False once the alert has ended."""
        return self.lasts and self.alert is not None and self.alert.use_msr

    @property
    def kart(self) -> int:
        """Return the number of the alert's kart; 0 if the alert is not about a single kart."""
        return self.alert.kart if self.alert else 0

    @property
    def heading(self) -> str:
        """Return in a word or two what to do, or that the alert has ended."""
        if not self.lasts:
            return ALERT_ENDED
        return ALERT_MSR if self.use_msr else ALERT_OTHER

    @property
    def text(self) -> str:
        """Return the alert's sentence or, once the alert has ended, what the alert was about."""
        # The sentence also says what to do, which no longer applies.
        if self.said or self.alert is None:
            return self.said
        return self.alert.text if self.lasts else alert_was(self.alert.kind, self.kart)

    def __str__(self) -> str:
        return f'{self.heading}: {self.text}'


class AlertBook:
    """
    Keeps the alerts that an official has not seen yet, and those whose cause still exists.

    If the cause of an alert goes away and comes back, the alert counts as new. An alert also
    counts as new when it begins to ask for the MSR, because the official may have seen the same
    alert while the MSR was recorded as used.

    :ivar notices: the alerts, oldest first.
    """

    def __init__(self) -> None:
        self.notices: list[Notice] = []
        self._count = 0

    def begin_race(self) -> None:
        """Remove the alerts that have ended, so that the next race begins without them."""
        self.notices = [notice for notice in self.notices if notice.lasts]

    def update(self, alerts: Iterable[Alert], two: bool = False) -> bool:
        """
        Update the notices from a snapshot's alerts, and return whether one of the alerts is new.

        :param alerts: the alerts in the snapshot, newest first.
        :param two: whether snapshots come from two race controls in turn. If so, an alert missing
            from this snapshot may be in the next one.
        """
        new = {(alert.kind, alert.kart): alert for alert in alerts}
        kept: list[Notice] = []
        for notice in self.notices:
            if notice.alert is None or not notice.lasts:
                kept.append(notice)
                continue
            key = notice.alert.kind, notice.alert.kart
            if key in new:
                if two or notice.alert.use_msr or not new[key].use_msr:
                    kept.append(replace(notice, alert=new.pop(key)))
            elif two:
                kept.append(notice)
            elif not notice.seen:
                kept.append(replace(notice, lasts=False))
        for alert in reversed(new.values()):
            self._count += 1
            kept.append(Notice(self._count, alert))
        self.notices = kept
        return bool(new)

    def add_own(self, text: str) -> None:
        """Add a notice that this console raises itself; it stays until the official sees it."""
        self._count += 1
        self.notices.append(Notice(self._count, None, said=text))

    def see(self, numbers: Collection[int]) -> None:
        """Mark alerts as seen. If one of them has ended, all ended alerts are removed."""
        if any(each.number in numbers and not each.lasts for each in self.notices):
            self.begin_race()
        self.notices = [
            replace(notice, seen=True) if notice.number in numbers else notice
            for notice in self.notices
            if notice.number not in numbers or notice.alert
        ]

    @property
    def shown(self) -> list[Notice]:
        """
        Return the notices in the order in which to show them.

        Unseen alerts come first, with those that need the MSR at the top. Next is a single notice
        for all ended alerts, and then come the seen alerts.
        """

        def rank(notice: Notice) -> tuple[int, int]:
            group = 2 if not notice.lasts else 3 * notice.seen + (not notice.use_msr)
            return group, -notice.number

        ended = [notice for notice in self.notices if not notice.lasts]
        if len(ended) > 1:
            about = f'{len(ended)} alerts, the last: {ended[-1].text}'
            ended = [replace(ended[-1], said=about)]
        lasting = [notice for notice in self.notices if notice.lasts]
        return sorted([*lasting, *ended], key=rank)


def summary(notices: Sequence[Notice], places: int) -> Cell:
    """Return how many notices there are, or the karts that need the MSR but find no place."""
    if not notices:
        return Cell('✓ No alerts', Tone.GOOD)
    new = sum(not notice.seen and notice.lasts for notice in notices)
    seen = sum(notice.seen for notice in notices)
    tone, hidden = Tone.BAD if new else Tone.PLAIN, notices[places:]
    if karts := sorted({each.kart for each in hidden if each.use_msr and each.kart}):
        return Cell(f'⚠ MSR {", ".join(map(str, karts))}', tone)
    counted = (new, 'new'), (seen, 'seen, ongoing'), (len(notices) - new - seen, 'ended')
    parts = [f'{count} {which}' for count, which in counted if count]
    if any(each.lasts for each in hidden):
        karts = sorted({each.kart for each in hidden if each.lasts and each.kart})
        parts.append(f'not shown: {numbered(karts) or NO_SINGLE_KART}')
    return Cell('; '.join(parts), tone)


class OfficialNames:
    """
    The officials who have given commands. Each is shown by name, unless two share a name.

    One thread may add claims while other threads read them.
    """

    def __init__(self) -> None:
        self._claims: dict[str, frozenset[str]] = {}

    def take(self, claim: str) -> None:
        if claim:
            name = claim.partition(' (')[0]
            self._claims = {**self._claims, name: self._claims.get(name, frozenset()) | {claim}}

    @property
    def names(self) -> list[str]:
        return list(self._claims)

    def called(self, claim: str) -> str:
        """Return the name shown for an official."""
        name = claim.partition(' (')[0]
        return claim if len(self._claims.get(name, ())) > 1 or name == UNNAMED else name

    def in_text(self, text: str) -> str:
        """Return a sentence from race control with each official named as on the screen."""
        if ' by ' in text:
            for claim in itertools.chain(*self._claims.values()):
                text = text.replace(f' by {claim}', f' by {self.called(claim)}')
        return text


class Line(NamedTuple):
    """
    A line of the event log.

    :param clock: race control's wall time, as hours:minutes:seconds.
    :param said: what the line says, without how often.
    :param is_command: whether the line shows an official's command and race control's answer.
    :param karts: the numbers of the karts that the line is about; empty if about no kart.
    :param what: what the line says about these karts. If the next event says the same about
        another kart, that kart is added to this line.
    :param times: how often the line was said; a line that is said again replaces the one before.
    """

    clock: str
    success: bool
    said: str
    is_command: bool = False
    karts: tuple[int, ...] = ()
    what: str = ''
    times: int = 0

    @property
    def text(self) -> str:
        """Return the line as it is shown."""
        return f'{self.said} (at least {self.times} times)' if self.times > 1 else self.said


_BY_LABEL = frozenset(
    kind
    for kind, entry in CATALOGUE.items()
    if entry.stop
    or entry.result.race
    or kind in (CommandKind.KART_IN_GARAGE, CommandKind.KART_FINISH)
) - {CommandKind.IN_GARAGE}
"""Commands that the log shows by name only, because the rest of the screen shows their effect. IN
GARAGE is not among them, because race control's sentence also says which karts stay held."""

_OF_KARTS = {
    EventKind.CONNECTED: ' connected',
    EventKind.ACKNOWLEDGED: ' acknowledged {state}',
    EventKind.KART_STATE: ': {state}',
}
"""Events that one line can show for several karts, and what it says about them."""

_REPEATED = EventKind.REFUSED_CONNECTION, EventKind.MALFORMED
"""Events that a kart or another machine can repeat for ever."""


class EventLog:
    """
    The newest events, oldest first, as short texts.

    The consequences of a command get no lines of their own. If the same thing happens to several
    karts in a row, they share one line. What one of them repeats has one line with a count.
    """

    def __init__(self, officials: OfficialNames) -> None:
        self._lines: deque[Line] = deque(maxlen=2000)
        self._last = 0
        self._officials = officials

    def add(self, stamped: StampedEvent) -> None:
        """Add an event as a new line or to the last line, or leave it out if shown elsewhere."""
        if stamped.sequence <= self._last:
            self._lines.append(Line('', True, NEW_RUN))
        self._last, event = stamped.sequence, stamped.event
        at = time_of_day(stamped.wall_ns // 1_000_000_000)
        line = self._line(at, event)
        if line is not None:
            if line.what and self._lines and line.what == self._lines[-1].what:
                before = self._lines.pop()
                if line.karts:
                    karts = tuple(sorted({*before.karts, *line.karts}))
                    line = line._replace(said=self._of_karts(karts, line.what), karts=karts)
            if event.kind in _REPEATED:
                line = self._counted(line)
            # No later event joins a line about all karts.
            self._lines.append(line if line.karts else line._replace(what=''))

    def _counted(self, line: Line) -> Line:
        """Return a line with the number of times it was said in this run; remove its last one."""
        of_run = itertools.takewhile(lambda each: each.said != NEW_RUN, reversed(self._lines))
        repeated = (each for each in of_run if each.times and each.said == line.said)
        before = next(repeated, None)
        if before is None:
            return line._replace(times=1)
        self._lines.remove(before)
        return line._replace(times=before.times + 1)

    def _line(self, at: str, event: Event) -> Line | None:
        """Return the line for an event; None if the event needs no line."""
        what, karts = '', (event.kart,) * bool(event.kart)
        state = STATES[event.state]
        of_state = event.kind in (EventKind.RACE_STATE, EventKind.KART_STATE)
        if of_state and event.command is not None:
            return None  # the command has a line
        if event.state is RaceState.IN_GARAGE and event.kind in _OF_KARTS:
            return None  # every kart that connects is sent IN_GARAGE, and no kart must answer
        if event.kind is EventKind.LINK_GRADE and event.grade is not Grade.POOR:
            return None  # the rows show the grade
        if event.kind is EventKind.DELIVERED and event.after < GRADES[Grade.FAIR]:
            return None  # a stop that arrives in time
        finished = event.place and event.state is RaceState.RED_FLAG
        if finished and event.kind is EventKind.KART_STATE:
            told = f'Kart {event.kart}: {state} (finished, P{event.place})'
        elif event.kind in _OF_KARTS and event.kart:
            what = _OF_KARTS[event.kind].format(state=state)
            told = self._of_karts(karts, what)
        elif event.kind is EventKind.ALL_ACKNOWLEDGED:
            told = self._told(event)
            what = _OF_KARTS[EventKind.ACKNOWLEDGED].format(state=state)
        elif event.kind is EventKind.ALERT_CLEARED and event.alert is not None:
            told = f'{ALERT_ENDED}: {alert_was(event.alert, event.kart)}'
        else:
            told = f'{"" if event.success else texts.REFUSED}{self._told(event)}'
        is_command = event.kind is EventKind.COMMAND
        return Line(at, event.success, told, is_command, karts, what)

    @staticmethod
    def _of_karts(karts: Sequence[int], what: str) -> str:
        named = numbered(karts)
        return f'{named[:1].upper()}{named[1:]}{what}'

    def _told(self, event: Event) -> str:
        """Return the event's sentence or its command's label, and the official who caused it."""
        text = event.text.removesuffix('.')
        if event.kind is EventKind.COMMAND and event.success and event.command in _BY_LABEL:
            text = texts.command_name(event.command, event.kart)
            if event.after:
                text += f', pressed {round(event.after)} s ago'
            if event.command is CommandKind.KART_FINISH:
                text += f', P{event.place}'
        return f'{text} · {self._officials.called(event.official)}' if event.official else text

    def lines(self, kart: int = 0) -> list[Line]:
        """Return the lines about a kart, and those about no kart, oldest first; 0: all lines."""
        return [each for each in self._lines if not (kart and each.karts) or kart in each.karts]
