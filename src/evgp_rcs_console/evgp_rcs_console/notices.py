# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What an official is told besides the state of the race: alerts until seen, and the event log.

Pure: the newest snapshot goes in, lines come out.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from evgp_rcs.official import UNNAMED
from evgp_rcs_console import texts
from evgp_rcs_console.snapshot import Alert, Availability, Event, Race

Key = tuple[str, int]


@dataclass(frozen=True)
class Notice:
    """
    An alert as it is shown to the official.

    :param number: the alert's number; a higher one is newer.
    :param seen: the official has marked it as seen.
    :param standing: its cause still exists.
    :param own: it is this console's, not race control's: it stays until it is seen.
    """

    number: int
    alert: Alert
    seen: bool = False
    standing: bool = True
    own: bool = False

    @property
    def use_msr(self) -> bool:
        """Return whether to use the Master Safety Remote; never once the cause is gone."""
        return self.standing and self.alert.use_msr

    @property
    def heading(self) -> str:
        """Return what to do, in a word or two."""
        if not self.standing:
            return texts.ALERT_ENDED
        return texts.ALERT_MSR if self.alert.use_msr else texts.ALERT_OTHER

    @property
    def text(self) -> str:
        """Return the alert's sentence, without what the heading says; ended, its name only."""
        # Its sentence says what to do, which is over. Several that ended have one of their own.
        if not self.standing and self.alert.kind:
            name = self.alert.kind.replace('_', ' ')
            return f'{name}, kart {self.alert.kart}' if self.alert.kart else name
        # Race control begins its sentence with that, for screens that have no heading.
        text = self.alert.text.removeprefix(texts.MSR_PREFIX)
        return text[:1].upper() + text[1:]

    def __str__(self) -> str:
        """Return all of it in one line."""
        return f'{self.heading}: {self.text}'


class AlertBook:
    """
    The alerts that an official has not seen yet, and those whose cause still exists.

    If the cause of an alert goes away and comes back, that is a new alert. So is one that asks for
    the MSR from now on: whoever marked it as seen did so when the use of the MSR was recorded.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self._notices: list[Notice] = []
        self._count = 0

    def begin_race(self) -> None:
        """Forget the alerts that have ended: they do not follow into the next race."""
        self._notices = [notice for notice in self._notices if notice.standing]

    def update(self, alerts: Iterable[Alert], two: bool = False) -> bool:
        """
        Take the alerts of a snapshot, newest first; return whether there is a new one.

        :param two: snapshots come from two race controls in turn: an alert that is missing in
            this one may be in the next.
        """
        now: dict[Key, Alert] = {(alert.kind, alert.kart): alert for alert in alerts}
        kept: list[Notice] = []
        known: set[Key] = set()
        for notice in self._notices:
            key = notice.alert.kind, notice.alert.kart
            if notice.own or not notice.standing:
                kept.append(notice)
            elif key in now:
                if two or notice.alert.use_msr or not now[key].use_msr:
                    known.add(key)
                    kept.append(replace(notice, alert=now[key]))
            elif two:
                kept.append(notice)
            elif not notice.seen:
                kept.append(replace(notice, standing=False))
        news = [alert for key, alert in reversed(now.items()) if key not in known]
        for alert in news:
            self._count += 1
            kept.append(Notice(self._count, alert))
        self._notices = kept
        return bool(news)

    def add_own(self, text: str) -> None:
        """Take an alert of this console: it stays until it is seen."""
        self._count += 1
        self._notices.append(Notice(self._count, Alert('', 0, False, text), own=True))

    def see(self, number: int) -> None:
        """Mark an alert as seen; one that has ended with all that have."""
        if any(notice.number == number and not notice.standing for notice in self._notices):
            self.begin_race()
        self._notices = [
            replace(notice, seen=True) if notice.number == number else notice
            for notice in self._notices
            if notice.number != number or (notice.standing and not notice.own)
        ]

    def see_all(self) -> None:
        """Mark every alert as seen."""
        for notice in self.unseen:
            self.see(notice.number)

    @property
    def unseen(self) -> list[Notice]:
        """Return what the official has not marked as seen, newest first."""
        return [notice for notice in reversed(self._notices) if not notice.seen]

    @property
    def shown(self) -> list[Notice]:
        """
        Return the notices: the unseen first, and of those the ones that need the MSR.

        Those that have ended are one notice, the last.
        """

        def rank(notice: Notice) -> tuple[int, int]:
            group = 2 if not notice.standing else 3 * notice.seen + (not notice.use_msr)
            return group, -notice.number

        ended = [notice for notice in self._notices if not notice.standing]
        if len(ended) > 1:
            karts = sorted({notice.alert.kart for notice in ended if notice.alert.kart})
            told = texts.SEVERAL_ENDED.format(
                count=len(ended), karts=texts.kart_numbers(karts) or texts.NO_SINGLE_KART
            )
            ended = [replace(ended[-1], alert=Alert('', 0, False, told))]
        standing = [notice for notice in self._notices if notice.standing]
        return sorted([*standing, *ended], key=rank)


def summary(notices: Sequence[Notice], places: int) -> str:
    """
    Return how many notices there are, and which ones are not among the first places.

    :param notices: in the order in which they are shown.
    """
    if not notices:
        return texts.NO_ALERT
    new = sum(not notice.seen and notice.standing for notice in notices)
    seen = sum(notice.seen for notice in notices)
    counted = ((new, texts.ALERTS_NEW), (seen, texts.ALERTS_SEEN))
    ended = ((len(notices) - new - seen, texts.ALERTS_ENDED),)
    told = [text.format(count=count) for count, text in counted + ended if count]
    more = notices[places:]
    for msr, text in ((True, texts.MORE_MSR), (False, texts.MORE_OTHER)):
        those = [notice for notice in more if notice.use_msr is msr and notice.standing]
        karts = sorted({notice.alert.kart for notice in those if notice.alert.kart})
        if those:
            told.append(text.format(karts=texts.kart_numbers(karts) or texts.NO_SINGLE_KART))
    return '; '.join(told)


class Officials:
    """Who has commanded: each is called by name, unless two of one name have."""

    def __init__(self) -> None:
        """Know none."""
        self._claims: dict[str, set[str]] = {}

    def take(self, claim: str) -> None:
        """Take who has commanded, as it was sent."""
        if claim:
            self._claims.setdefault(claim.partition(' (')[0], set()).add(claim)

    @property
    def names(self) -> list[str]:
        """Return their names, in the order of their first command."""
        return list(self._claims)

    def called(self, claim: str) -> str:
        """Return what an official is called."""
        name = claim.partition(' (')[0]
        return claim if len(self._claims[name]) > 1 or name == UNNAMED else name

    def in_text(self, text: str) -> str:
        """Return a sentence of race control with each official as they are called."""
        for claims in self._claims.values():
            for claim in claims:
                text = text.replace(f' by {claim}', f' by {self.called(claim)}')
        return text

    def in_race(self, race: Race) -> Race:
        """Return a snapshot with each official as they are called."""

        def offered(commands: Availability) -> Availability:
            return {
                kind: replace(each, reason=self.in_text(each.reason))
                for kind, each in commands.items()
            }

        karts = tuple(
            replace(
                kart,
                hold_reason=self.in_text(kart.hold_reason),
                commands=offered(kart.commands),
            )
            for kart in race.karts
        )
        cause = self.in_text(race.state_cause)
        return replace(race, state_cause=cause, karts=karts, commands=offered(race.commands))


class EventLog:
    """
    The newest events, in order, each with the text that is shown.

    :param most: maximum number of lines.
    :ivar officials: who has commanded.
    """

    def __init__(self, most: int = 2000) -> None:
        """Begin with none."""
        self._lines: deque[Event] = deque(maxlen=most)
        self._last = 0
        self.officials = Officials()

    def add(self, event: Event) -> list[Event]:
        """Take an event and return the lines it adds."""
        added = []
        if event.sequence <= self._last:
            added.append(Event(0, '', 0, True, texts.NEW_RUN))
        self._last = event.sequence
        refused = '' if event.success else texts.REFUSED
        added.append(replace(event, text=f'{refused}{self._told(event)}'))
        self._lines.extend(added)
        return added

    def _told(self, event: Event) -> str:
        """Return the sentence and who caused it: by name, where that is enough."""
        self.officials.take(event.official)
        text = self.officials.in_text(event.text)
        return f'{text} · {self.officials.called(event.official)}' if event.official else text

    def lines(self, kart: int = 0) -> list[Event]:
        """Return the lines that concern one kart (0: all lines), oldest first."""
        return [line for line in self._lines if concerns(line, kart)]


def concerns(line: Event, kart: int) -> bool:
    """Return whether a line concerns a kart; lines without a kart concern every one."""
    return not kart or line.kart in (0, kart)
