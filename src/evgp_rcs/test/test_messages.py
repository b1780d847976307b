# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A message is the image of its type, field by field, both ways."""

from __future__ import annotations

import dataclasses
from typing import Any, get_type_hints

from evgp_node.codec import constants_of, message_of, value_of
from evgp_node.results import (
    HeatGrid,
    Judged,
    KartResult,
    Mark,
    Passing,
    Penalty,
    RaceOfEvent,
    Standings,
    Status,
)
from evgp_node.roster import Format
from evgp_protocol.link import Grade
from evgp_rcs.ros.messages import event_of, events_message
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.link_quality import LinkQuality
from evgp_rcs.rules.race import Alert, AlertKind, Availability, EventKind, Heat, TrackAccess
from evgp_rcs.rules.snapshot import (
    KartSnapshot,
    Snapshot,
    snapshot_of,
)
from evgp_rcs_msgs import msg
import pytest
from recorded_races import PaperRace
from test_replay import Running

IMAGES: list[tuple[Any, Any]] = [
    (Snapshot, msg.Race),
    (KartSnapshot, msg.KartStatus),
    (LinkQuality, msg.LinkQuality),
    (Availability, msg.CommandAvailability),
    (TrackAccess, msg.TrackAccess),
    (Alert, msg.Alert),
    (Heat, msg.Heat),
    (Standings, msg.Results),
    (KartResult, msg.KartResult),
    (Penalty, msg.Penalty),
    (Judged, msg.JudgedPassing),
    (Passing, msg.Passing),
    (HeatGrid, msg.HeatGrid),
    (RaceOfEvent, msg.RaceOfEvent),
]


@pytest.mark.parametrize(('kind', 'message'), IMAGES)
def test_a_type_and_its_message_have_the_same_fields(kind: Any, message: Any) -> None:
    fields = {name.removesuffix('_ns') for name in get_type_hints(kind)}
    assert fields == set(message.get_fields_and_field_types())


@pytest.mark.parametrize(
    ('kind', 'message'),
    [
        (AlertKind, msg.Alert),
        (CommandKind, msg.CommandAvailability),
        (EventKind, msg.RaceEvent),
        (Grade, msg.LinkQuality),
        (Mark, msg.JudgedPassing),
        (Status, msg.KartResult),
    ],
)
def test_each_constant_of_a_message_is_one_of_its_enum(kind: Any, message: Any) -> None:
    assert constants_of(kind) is message
    numbers = [getattr(message, each.name) for each in kind]
    assert len({*numbers}) == len(numbers)


def test_a_race_comes_out_of_its_message_as_race_control_put_it_in() -> None:
    paper = Running(7).run(600)
    for race, now in ((paper.race, paper.now), (paper.race, paper.now + 3.0)):
        seen = snapshot_of(race, now)._replace(banner='REHEARSAL')
        read = value_of(message_of(seen, msg.Race), Snapshot)
        # As texts, since what is not known is NaN.
        assert str(message_of(read, msg.Race)) == str(message_of(seen, msg.Race))
        given, found = (
            [[each._replace(available_from=None) for each in kart.commands] for kart in its.karts]
            for its in (seen, read)
        )
        assert found == given
        assert (read.state, read.heats, read.track) == (seen.state, seen.heats, seen.track)
        assert read.stamp == pytest.approx(seen.stamp)
    for stamped in paper.stamped[:200]:
        (message,) = events_message([stamped]).events
        inner = stamped.event._replace(chatter=False)
        assert event_of(message).event == inner
        assert event_of(message)[:2] == stamped[:2]


def test_results_come_out_of_their_message_as_the_timekeeper_put_them_in() -> None:
    passing = Passing('line', 'today', 3, 7, '4711', 5_000_000_000)
    unsure = Passing('line', 'today', 4)
    penalty = Penalty(7, 5, 1, disqualified=True, reason='RED_RED', official='Ada')
    karts = (
        KartResult(7, 0, Status.DISQUALIFIED, 2, 61.5, (30.0, 31.5), (penalty,)),
        KartResult(8, 1, Status.RUNNING, 0, None, (), ()),
    )
    standings = Standings(
        stamp=0.0,
        run='ab',
        race=2,
        heat='Heat 1',
        format=Format.TIME_TRIAL,
        laps=2,
        grid=(8, 7),
        karts=karts,
        overall=karts[1:],
        passings=(
            Judged(passing, 7, Mark.COUNTED, 12.5, ''),
            Judged(unsure, 0, Mark.STRUCK, 13.0, 'why not'),
        ),
        grids=(HeatGrid('Final', (8, 7)),),
        next_heat='Final',
        races=(RaceOfEvent(1, 'Heat 1', 2.5, 2, counts=True),),
        questions=('Which race counts?',),
        published=True,
    )
    assert value_of(message_of(standings, msg.Results), Standings) == standings


def test_what_is_not_known_is_none_in_the_value_and_says_so_in_the_message() -> None:
    paper = PaperRace({1: 'Purdue'})
    paper.connect(1)
    (kart,) = value_of(message_of(snapshot_of(paper.race, paper.now), msg.Race), Snapshot).karts
    assert (kart.reported, kart.hold, kart.counts_at, kart.flag_at) == (None,) * 4
    message = message_of(kart, msg.KartStatus)
    assert (message.hold.state, message.flag_at.sec) == (msg.RaceState.UNKNOWN, 0)


@pytest.mark.parametrize(
    'message',
    [
        msg.KartStatus(),  # it is sent no state
        msg.CommandAvailability(command=255),
        msg.Results(format='a contest'),
    ],
)
def test_a_message_that_race_control_never_sends_is_refused(message: Any) -> None:
    kinds = {image: kind for kind, image in IMAGES}
    with pytest.raises(ValueError, match=r'\w'):
        value_of(message, kinds[type(message)])


def test_a_time_counts_from_where_the_clock_of_the_value_began() -> None:
    alert = Alert(AlertKind.KART_LOST, 7, 2.5, 'it is so', use_msr=False)
    message = message_of(alert, msg.Alert, wall_ns=1_000_000_000)
    assert (message.since.sec, message.since.nanosec) == (3, 500_000_000)
    assert value_of(message, Alert) == dataclasses.replace(alert, since=3.5)


def test_sentences_can_be_changed_on_the_way_out_of_a_message_and_names_cannot() -> None:
    offered = Availability(CommandKind.GREEN_GREEN, False, 'the race is in RED_RED')
    heat = Heat('RED_RED', (1,))

    def spaced(text: str) -> str:
        return text.replace('_', ' ')

    read = value_of(message_of(offered, msg.CommandAvailability), Availability, spaced)
    assert read.reason == 'the race is in RED RED'
    assert value_of(message_of(heat, msg.Heat), Heat, spaced) == heat
