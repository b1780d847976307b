# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What a survey of the network makes of what it saw, and what it sends on real sockets."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
import contextlib
import datetime
import itertools
from typing import Any

from evgp_inspection.limits import SurveyLimits
from evgp_inspection.survey import LinkSurvey, Mark, Report
from evgp_inspection.survey_network import figures_now, FRAME, Surveyor
from evgp_inspection.verdicts import Verdict
from evgp_protocol.link import Grade
from evgp_protocol.loop import run
from hypothesis import given
from hypothesis import strategies as st
import pytest

LIMITS = SurveyLimits()
BEGAN = datetime.datetime(2026, 5, 1, 12, 0, tzinfo=datetime.timezone.utc)
PATIENCE = 30


def driven(seconds: int = 90, trip: float = 0.02, gap: Iterable[int] = ()) -> LinkSurvey:
    """Return a kart that answered 20 times in each second, but not in those of the gap."""
    kart = LinkSurvey()
    kart.opened(0.0)
    for second in range(seconds):
        for beat in range(1, 21) if second not in gap else ():
            kart.answered([trip], second + beat / 20)
        kart.second(second + 1.0)
    return kart


def report_on(kart: LinkSurvey | None, marks: Iterable[Mark] = (), held_up: float = 0.0) -> Report:
    karts = {} if kart is None else {'10.0.0.107': kart}
    return Report(BEGAN, 90.0, karts, list(marks), held_up, LIMITS)


def not_passed(kart: LinkSurvey, held_up: float = 0.0) -> list[str]:
    figures = kart.figures(LIMITS, held_up)
    return [each.name for each in figures if each.verdict is not Verdict.PASS]


TRIP, SILENCE, LOSSES = 'round trip, 99th percentile', 'longest silence', 'lost connections'
TIME_ON = 'time on the network'

Act = tuple[Any, ...]
"""A method of `LinkSurvey` and its arguments."""

LATE: Act = ('answered', [LIMITS.round_trip * 1.1] * 20, 90.1)
SILENT: Act = ('second', 90.0 + LIMITS.silence * 1.1)
RESENT: Act = ('retransmitted', int(LIMITS.retransmissions) + 1)
LOST: Act = ('lost', 'reset', 90.1)


def then(kart: LinkSurvey, *acts: Act) -> LinkSurvey:
    for method, *arguments in acts:
        getattr(kart, method)(*arguments)
    return kart


@pytest.mark.parametrize(
    ('kart', 'held_up', 'figures', 'verdict'),
    [
        (driven(), 0.0, [], 'pass'),
        # A mere glance.
        (driven(59), 0.0, [TIME_ON], 'not judged'),
        (then(LinkSurvey(), ('opened', 0.0)), 0.0, [TRIP, TIME_ON], 'not judged'),
        # Each limit fails a network alone.
        (then(driven(), LATE), 0.0, [TRIP], 'fail'),
        (then(driven(), SILENT), 0.0, [SILENCE], 'fail'),
        (then(driven(), RESENT, ('second', 90.1)), 0.0, ['retransmissions, worst minute'], 'fail'),
        (then(driven(), LOST), 0.0, [LOSSES], 'fail'),
        # What this computer can have caused is not judged.
        (driven(gap=[30]), 0.1, [SILENCE], 'fail'),
        (driven(gap=[30]), 0.6, [SILENCE], 'not judged'),
        (then(driven(gap=[30]), LATE), 0.6, [TRIP, SILENCE], 'not judged'),
        (then(driven(gap=[30]), LATE, LOST), 0.6, [TRIP, SILENCE, LOSSES], 'fail'),
        # The kart may have closed the connection, rightly.
        (then(driven(), LOST), 1.2, [LOSSES], 'not judged'),
    ],
)
def test_a_network_fails_by_what_is_wrong_with_it_and_passes_only_if_all_was_judged(
    kart: LinkSurvey, held_up: float, figures: list[str], verdict: str
) -> None:
    report = report_on(kart, held_up=held_up)
    assert not_passed(kart, held_up) == figures
    assert report.verdict.value == verdict
    assert report.text().endswith(f'\n{verdict.upper()}\n')


def test_without_a_kart_nothing_is_judged() -> None:
    assert report_on(None).verdict is Verdict.NOT_JUDGED


def test_time_without_a_connection_is_not_time_on_the_network() -> None:
    acts = [('lost', 'reset', 50.0), ('second', 100.0), ('opened', 105.0), ('second', 110.0)]
    acts += [('lost', 'reset', 110.0), ('opened', 120.0), ('second', 122.0)]
    kart = then(driven(50), *acts)
    on = kart.figures(LIMITS)[-1]
    assert (on.value, on.verdict) == (57.0, Verdict.NOT_JUDGED)


def test_a_silence_goes_on_until_the_kart_answers_on_its_next_connection() -> None:
    kart = then(driven(), LOST, ('opened', 92.0), ('answered', [0.01], 92.5))
    assert kart.second(93.0).silence == pytest.approx(2.5)


def test_a_frame_that_was_never_answered_counts_with_its_age() -> None:
    kart = then(driven(), ('lost', 'reset', 91.0, [0.9] * 100))
    assert 'round trip, 99th percentile' in not_passed(kart)
    assert kart.second(91.0).worst == 0.9


def test_the_worst_places_are_apart_and_after_their_marks() -> None:
    kart = driven(gap=[30, 31, 60])
    report = report_on(kart, [Mark(10.0, 'pits'), Mark(25.0, 'turn 3'), Mark(80.0, 'home')])
    first, second, *_ = kart.worst_places()
    assert [first.at, second.at] == [33.0, 62.0]
    assert [first.silence, second.silence] == pytest.approx([2.05, 1.05])
    assert report.place(first.at) == 'at 12:00:33, 8 s after "turn 3"'
    assert report.place(5.0) == 'at 12:00:05'


def test_a_link_is_as_good_as_its_last_seconds() -> None:
    kart = driven(30)
    grades = [kart.grade]
    for acts in (
        [('answered', [0.3], 30.1), ('second', 31.0)],
        [
            act
            for at in range(31, 41)
            for act in (('answered', [0.02], at + 0.5), ('second', at + 1.0))
        ],
        [('lost', 'reset', 41.1), ('second', 42.0)],
    ):
        grades.append(then(kart, *acts).grade)
    assert grades == [Grade.GOOD, Grade.FAIR, Grade.GOOD, Grade.POOR]


def test_the_worst_kart_is_where_the_line_is_not_cut_off() -> None:
    away = then(driven(), LOST, ('second', 91.0))
    line = figures_now({'10.0.0.101': driven(), '10.0.0.102': away, '10.0.0.103': driven()})
    found = [each.split()[0] for each in line.split(' | ')]
    assert found == ['10.0.0.102', '10.0.0.101', '10.0.0.103']


@given(st.lists(st.floats(0, 2), min_size=1, max_size=400))
def test_no_more_than_one_of_a_hundred_is_above_the_percentile(trips: list[float]) -> None:
    kart = LinkSurvey()
    kart.opened(0.0)
    kart.answered(trips, 1.0)
    assert kart.percentile in trips
    assert sum(each > kart.percentile for each in trips) <= len(trips) / 100
    assert sum(each >= kart.percentile for each in trips) > len(trips) / 100


@given(st.lists(st.integers(0, 9), max_size=150))
def test_the_worst_minute_is_the_worst_of_all_minutes(resent: list[int]) -> None:
    kart = LinkSurvey()
    kart.opened(0.0)
    for second, segments in enumerate(resent):
        kart.retransmitted(segments)
        kart.second(second + 1.0)
    minutes = [sum(itertools.islice(resent, at, at + 60)) for at in range(len(resent))]
    assert kart.worst_minute == max(minutes, default=0)


# ----- on real sockets ----------------------------------------------------------------------


def surveyed(visit: Callable[[Surveyor, int], Awaitable[None]]) -> Surveyor:
    """Survey while karts visit, and return what was found."""

    async def survey() -> Surveyor:
        surveyor = Surveyor(lambda line: None)
        stopping = asyncio.Event()
        port: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        running = asyncio.ensure_future(
            surveyor.survey('127.0.0.1', 0, stopping, port.set_result, lambda: None)
        )
        try:
            await asyncio.wait_for(visit(surveyor, await port), PATIENCE)
        finally:
            stopping.set()
            await running
        return surveyor

    return run(survey())


@contextlib.asynccontextmanager
async def connection(
    port: int, address: str = '127.0.0.1'
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    reader, writer = await asyncio.open_connection('127.0.0.1', port, local_addr=(address, 0))
    try:
        yield reader, writer
    finally:
        writer.close()


async def read_until_the_end(reader: asyncio.StreamReader) -> bytes:
    data = b''
    with contextlib.suppress(ConnectionError):
        while more := await reader.read(1000):
            data += more
    return data


def test_nothing_but_in_garage_is_ever_sent_and_a_second_connection_counts_as_a_loss() -> None:
    heard = bytearray()

    async def visit(surveyor: Surveyor, port: int) -> None:
        async with connection(port) as (first, _), connection(port) as (second, _):
            heard.extend(await read_until_the_end(first))
            heard.extend(await second.readexactly(5 * len(FRAME)))
            (kart,) = surveyor.karts.values()
            assert len(kart.losses) == 1
        # Whatever a kart says: GREEN_GREEN, rubbish, half a frame.
        for says in (b'$GREEN_GREEN;', b'\xff' * 1000, b'$RED', b''):
            async with connection(port) as (reader, writer):
                writer.write(says)
                heard.extend(await reader.readexactly(5 * len(FRAME)))
                if says:
                    writer.write_eof()
                    heard.extend(await read_until_the_end(reader))

    surveyor = surveyed(visit)
    assert FRAME == b'$IN_GARAGE;'
    frames = bytes(heard).split(b';')[:-1]
    assert len(frames) >= 20
    assert set(frames) == {FRAME[:-1]}
    (kart,) = surveyor.karts.values()
    assert kart.percentile is not None
    assert len(kart.losses) >= 5
