# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A message is the image of its type, field by field, both ways."""

from __future__ import annotations

import dataclasses
from typing import Any, get_type_hints

from diagnostic_msgs.msg import DiagnosticStatus
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
from evgp_protocol.link import Grade
from evgp_rcs.ros.messages import diagnostics_message, event_of, events_message
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.link_quality import LinkQuality
from evgp_rcs.rules.race import (
    Alert,
    AlertKind,
    Availability,
    EventKind,
    Heat,
    StampedEvent,
    TrackAccess,
)
from evgp_rcs.rules.snapshot import KartSnapshot, NOTHING, Snapshot, snapshot_of
from evgp_rcs_msgs import msg
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from recorded_races import PaperRace
from rig.values import any_of, ANYTHING, Simple

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
    fields = {name: getattr(message, name) for name in dir(message) if name.isupper()}
    numbers = {name: value for name, value in fields.items() if isinstance(value, int)}
    assert numbers.keys() - {'UNKNOWN'} == {each.name for each in kind} - {'UNKNOWN'}
    assert len({*numbers.values()}) == len(numbers)


# What a message holds to the last bit: times are in ns there, and what is not known is 0 or NaN.
EXACT: Simple = {
    **ANYTHING,
    int: st.integers(1, 200),
    float: st.integers(1, 9999).map(lambda eighths: eighths / 8),
}


@pytest.mark.parametrize(('kind', 'message'), IMAGES)
@given(data=st.data())
@settings(max_examples=10)
def test_a_value_comes_out_of_its_message_as_it_was_put_in(
    kind: Any, message: Any, data: st.DataObject
) -> None:
    value = data.draw(any_of(kind, EXACT))
    assert value_of(message_of(value, message), kind) == value


# An event of no grade and one of an unknown grade have the same message.
@given(any_of(StampedEvent, EXACT).filter(lambda each: each.event.grade is not Grade.UNKNOWN))
@settings(max_examples=30)
def test_an_event_comes_out_of_its_message_as_it_was_put_in(stamped: StampedEvent) -> None:
    (message,) = events_message([stamped], '').events
    inner = stamped.event._replace(chatter=False)
    assert event_of(message) == stamped._replace(event=inner)


def test_what_is_not_known_is_unknown_or_0_in_the_message() -> None:
    paper = PaperRace({1: 'Purdue'})
    paper.connect(1)
    (kart,) = message_of(snapshot_of(paper.race, paper.now), msg.Race).karts
    assert (kart.hold.state, kart.flag_at.sec) == (msg.RaceState.UNKNOWN, 0)


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
    race = NOTHING._replace(alerts=(alert,))
    assert message_of(race, msg.Race, wall_ns=1_000_000_000).alerts == [message]


def test_diagnostics_name_the_msr_first_however_new_another_error_is() -> None:
    newest, msr = (
        Alert(kind, 0, 0.0, f'it is {kind.value}', use_msr=kind is AlertKind.RED_UNACKNOWLEDGED)
        for kind in (AlertKind.RECORD_FAILING, AlertKind.RED_UNACKNOWLEDGED)
    )
    race, *_ = diagnostics_message(NOTHING._replace(alerts=(newest, msr)), 0, 'rcs').status
    assert (race.level, race.message) == (DiagnosticStatus.ERROR, msr.told)


def test_sentences_can_be_changed_on_the_way_out_of_a_message_and_names_cannot() -> None:
    offered = Availability(CommandKind.GREEN_GREEN, False, 'the race is in RED_RED')
    heat = Heat('RED_RED', (1,))

    def spaced(text: str) -> str:
        return text.replace('_', ' ')

    read = value_of(message_of(offered, msg.CommandAvailability), Availability, spaced)
    assert read.reason == 'the race is in RED RED'
    assert value_of(message_of(heat, msg.Heat), Heat, spaced) == heat
