# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A replay finds no difference with the same rules, and names the first one with others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import dataclasses
import enum
import functools
import itertools
import math
import pathlib
import random
import sys
from typing import Any, get_args, get_type_hints

from evgp_node.stream import Gap
from evgp_protocol.states import RaceState
from evgp_rcs.rcs_record import main
from evgp_rcs.record.replay import OF_THE_SERVER, Replay
from evgp_rcs.record.runs import DONE, Kept, UNREADABLE
from evgp_rcs.record.store import rules_version
from evgp_rcs.rules import inputs
from evgp_rcs.rules import race as rules
from evgp_rcs.rules.inputs import Entry, Ordered, Rules
from evgp_rcs.rules.race import Event, EventKind, StampedEvent
import pytest
from recorded_races import edit, kept, ROSTER, Running, SETUP
from rig.faults import faults_in, module_with


@dataclasses.dataclass(frozen=True)
class Listed(Kept):
    """A stream that is not encoded, which would take most of the time."""

    listed: Sequence[Entry]

    def entries(self) -> Iterator[Entry | Gap]:
        return iter(self.listed)


def replay_of(entries: Sequence[Entry]) -> Replay:
    return Replay(Listed(kept(entries[:1]).run, [], entries))


Capture = pytest.CaptureFixture[str]


@pytest.mark.parametrize('seed', range(40))
def test_a_race_that_is_replayed_with_its_own_rules_does_not_differ(seed: int) -> None:
    running = Running(seed).run(400)
    assert any(each.event.state is RaceState.GREEN_GREEN for each in running.stamped)
    found = replay_of(running.stream()).run()
    assert (found.difference, found.missing) == (None, '')
    assert found.inputs > 800
    assert found.orders > 20
    assert found.events > 100


def an_ended_run(seed: int = 1, steps: int = 600) -> Running:
    running = Running(seed).run(steps)
    running.end()
    return running


@functools.cache
def ended(seed: int) -> tuple[Entry, ...]:
    """Return the stream of a run that has ended."""
    return tuple(an_ended_run(seed).stream())


# ----- what somebody changed ------------------------------------------------------------------


Fits = Callable[[Any, Any], bool]
"""Whether an entry, with the one after it, is of the kind that is meant."""


def an_order(entry: Any, after: Any) -> bool:
    return isinstance(entry, Ordered)


def an_event(entry: Any, after: Any) -> bool:
    return isinstance(entry, StampedEvent) and entry.event.kind not in OF_THE_SERVER


def an_event_of_the_server(entry: Any, after: Any) -> bool:
    return isinstance(entry, StampedEvent) and entry.event.kind in OF_THE_SERVER


def an_input(entry: Any, after: Any) -> bool:
    """Return whether there is something after it that it has made."""
    made = an_event(after, None) or an_order(after, None)
    return made and isinstance(entry, inputs.Input)


def a_cause(entry: Any, after: Any) -> bool:
    """Return whether it is an input that made an event, but no order."""
    return isinstance(entry, inputs.Input) and an_event(after, None)


def another(value: Any, name: str) -> Any:
    """Return a tuple that differs in this field."""
    (kind, *_) = get_args(kind := get_type_hints(type(value))[name]) or (kind,)
    old = getattr(value, name)
    if issubclass(kind, enum.Enum):
        return value._replace(**{name: next(each for each in kind if each is not old)})
    return value._replace(**{name: not old if kind is bool else old + kind(1)})


NEW = Ordered((rules.Order(1, RaceState.GREEN_GREEN, 99),))
OF_INPUTS = 'an input is later', 'an input is before the one before it'
HARMS: dict[str, tuple[Fits, Callable[[Any], list[Any]]]] = {
    OF_INPUTS[0]: (a_cause, lambda each: [each._replace(at=each.at + 1e-6)]),
    OF_INPUTS[1]: (an_input, lambda each: [each._replace(at=SETUP.now - 1.0)]),
    'an input is missing': (an_input, lambda each: []),
    'a reason is other': (
        lambda entry, after: isinstance(entry, inputs.Disconnected) and an_input(entry, after),
        lambda each: [each._replace(reason='another one')],
    ),
    'an order is missing': (an_order, lambda each: []),
    'an order is there twice': (an_order, lambda each: [each, each]),
    'an order is new': (an_event_of_the_server, lambda each: [each, NEW]),
    'an event is missing': (an_event, lambda each: []),
    'an event is there twice': (an_event, lambda each: [each, each]),
    'an event is new': (
        an_event,
        lambda each: [each, each._replace(event=each.event._replace(kind=EventKind.COMMAND))],
    ),
    'an event is called one of the server': (
        an_event,
        lambda each: [each._replace(event=each.event._replace(kind=EventKind.MALFORMED))],
    ),
    'an event is later by the least of its clock': (
        an_event,
        lambda each: [each._replace(monotonic=math.nextafter(each.monotonic, math.inf))],
    ),
    'an event of the server is missing': (an_event_of_the_server, lambda each: []),
    'an event of the server is before the one before it': (
        an_event_of_the_server,
        lambda each: [each._replace(monotonic=SETUP.now - 1.0)],
    ),
    'the roster is other': (
        lambda entry, after: isinstance(entry, Rules),
        lambda each: [each._replace(setup=dataclasses.replace(SETUP, karts=ROSTER.karts))],
    ),
    'it begins twice': (a_cause, lambda each: [Rules('', SETUP), each]),
    **{
        f'another {name} of an event': (
            an_event,
            lambda each, name=name: [each._replace(event=another(each.event, name))],
        )
        for name in Event._fields
    },
    **{
        f'another {name} of an order': (
            an_order,
            lambda each, name=name: [Ordered((another(each.orders[0], name), *each.orders[1:]))],
        )
        for name in rules.Order._fields
    },
}


@pytest.mark.parametrize('seed', range(2))
@pytest.mark.parametrize('harm', HARMS)
def test_what_was_changed_is_found_and_named_with_its_time(harm: str, seed: int) -> None:
    entries = [*ended(seed)]
    fits, change = HARMS[harm]
    pairs = enumerate(itertools.pairwise([*entries, None]))
    place = random.Random(seed).choice([place for place, pair in pairs if fits(*pair)])
    entries = [*entries[:place], *change(entries[place]), *entries[place:][1:]]
    replay = replay_of(entries)
    # From the difference on nothing is known but what the stream says, and it is all said.
    told = [event for step in replay.steps() for event in step.events]
    assert told == [each for each in entries if isinstance(each, StampedEvent)]
    difference = replay.difference
    assert difference is not None
    assert difference.recorded != difference.replayed
    given = [each for each in entries if isinstance(each, inputs.Input)][replay.inputs - 1]
    if harm not in OF_INPUTS:
        assert replay.seconds == given.at - SETUP.now
    assert 0 <= replay.seconds < SETUP.now + 9e6


FAULTS = faults_in(
    """
an old acknowledgement counts: heard: without serial
a reason is other: _refusals: in already f => f'the race has {kart} already'
the pause is longer: _pause: pause times => 1.0
"""
)


@pytest.mark.parametrize('name', FAULTS)
def test_a_change_of_the_rules_is_found_in_a_record_of_the_right_ones(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    streams = [ended(seed) for seed in range(10)]
    faulty = module_with(rules, FAULTS[name])
    monkeypatch.setattr(inputs, 'Race', faulty.Race)
    assert any(replay_of(stream).run().difference for stream in streams)


def test_rules_that_fail_are_a_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    running = Running(1).run(200)

    def broken(*given: object) -> None:
        raise ZeroDivisionError('a fault put in by the test')

    monkeypatch.setattr(rules.Race, 'tick', broken)
    difference = replay_of(running.stream()).run().difference
    assert difference is not None
    assert 'ZeroDivisionError' in difference.replayed


def test_rules_of_which_a_part_was_changed_have_another_version(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or nothing would say why a record differs that was made by the same race.py."""
    used = {str(getattr(each, '__module__', '')) for each in vars(rules).values()}
    for name in sorted(each for each in used if each.startswith('evgp_')):
        changed, before = tmp_path / name, rules_version()
        changed.write_bytes(pathlib.Path(str(sys.modules[name].__file__)).read_bytes() + b'#')
        monkeypatch.setattr(sys.modules[name], '__file__', str(changed))
        assert rules_version() != before, name


# ----- on the disk ------------------------------------------------------------------------


def test_a_run_without_its_beginning_says_plainly_that_it_cannot_be_replayed(
    path: pathlib.Path, capsys: Capture
) -> None:
    Running(1).run(200).write(path)
    edit(path, lambda entries: entries.pop(1))
    assert main(['replay', str(path)]) == UNREADABLE
    (line,) = capsys.readouterr().err.splitlines()
    assert 'lacks the setup of the rules' in line
    assert main(['show', str(path)]) == DONE
