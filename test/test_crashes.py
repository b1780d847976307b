# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Race control is killed, again and again, and each time it comes back no kart may move."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import concurrent.futures
import contextlib
import os
import pathlib
import random
import threading
from typing import Any

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs.record.store import events, open_read_only, sessions
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.official import Answer, Official, seen, SERVICES
from evgp_testing.race_control import address_of, new_port, RaceControl
from evgp_testing.wire_kart import Acknowledges, WireKart
import pytest
from rig.replaying import replay_without_difference

GRID_ACTIVE = RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
IN_GARAGE = RaceState.IN_GARAGE
RED_RED = RaceState.RED_RED

RACING = (1, 2)
OUTSIDE = 3
FEW, MANY = 2, int(os.environ.get('EVGP_KILLS', '8'))
"""How often race control is killed in `make test`, and in `make test-long`."""


class Asker(Official):
    """An official who knows what the last command was answered; None: nothing so far."""

    answer: Answer | None = None

    def call(self, service: str, **request: Any) -> Answer:
        self.answer = None
        self.answer = super().call(service, **request)
        return self.answer


class Event:
    """One race control after the other, on the same record, with the same karts."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.record = folder / 'record.sqlite3'
        self.folder = folder
        self._stack = contextlib.ExitStack()
        self.domain = self._stack.enter_context(Domain()).number
        self._port = new_port()
        self.harmed = False  # the record was, by the test
        self.racing = RACING
        self.start()

    def start(
        self,
        connect: tuple[int, ...] = (*RACING, OUTSIDE),
        **parameters: object,
    ) -> None:
        """Start race control, and have these karts and the official with it."""
        self.run = contextlib.ExitStack()
        self.control = self.run.enter_context(
            RaceControl(
                self.folder,
                self.domain,
                self.racing,
                [OUTSIDE],
                {
                    'port': self._port,
                    'finish_delays': '[0.05]',
                    'auto_race_over': False,
                    **parameters,
                },
            )
        )
        self._port = self.control.port
        self.karts = {
            number: self.run.enter_context(
                WireKart(address_of(number), self._port, Acknowledges.EACH_CHANGE)
            )
            for number in connect
        }
        self.official = self.run.enter_context(Asker(self.domain))
        self.official.wait_for_connected(*connect)

    def kill(self) -> None:
        """Kill race control, and close what was connected to it."""
        self.control.kill()
        self.seen = list(self.official.events)
        self.run.close()

    def close(self) -> None:
        self.run.close()
        self._stack.close()

    def recorded(self) -> list[int]:
        """Return the sequence numbers that the last run has recorded."""
        with contextlib.closing(open_read_only(self.record)) as database:
            last = next(sessions(database)).number
            return [event.sequence for event in events(database, last)]

    # The steps of a race, each from where the official has seen the one before it leave off.

    def grid(self) -> None:
        self.official.bring_to(GRID_ACTIVE)

    def green(self) -> None:
        self.official.bring_to(GREEN_GREEN)

    def finish(self) -> None:
        self.official.command('kart/finish', kart=RACING[0])
        self.karts[RACING[0]].wait_for_state(RaceState.RED_FLAG)

    def over(self) -> None:
        self.official.command('race_over')
        self.official.wait_for_acks(RED_RED, *RACING)

    def home(self) -> None:
        self.official.command('in_garage', track_safe=True)
        # What an official held alone is not released with the race.
        race = self.official.wait_for_race(
            lambda race: state_of(race.state) is IN_GARAGE, 'the race in IN_GARAGE'
        )
        for status in race.karts:
            if state_of(status.hold) is not None:
                self.official.command('kart/in_garage', kart=status.number)
        for kart in self.karts.values():
            kart.wait_for_state(IN_GARAGE)
        self.official.wait_for_race(
            lambda race: all(state_of(kart.hold) is None for kart in race.karts), 'no kart held'
        )
        self.official.command('set_track_open', open=False)

    def kill_all(self) -> None:
        self.official.command('all_kill')
        self.official.wait_for_acks(RED_RED, *RACING)

    def hold_the_spectator(self) -> None:
        self.official.command('kart/red_red', kart=OUTSIDE)
        self.official.wait_for_acks(RED_RED, OUTSIDE)


STEPS: tuple[Callable[[Event], None], ...] = (
    Event.hold_the_spectator,
    Event.grid,
    Event.green,
    Event.finish,
    Event.kill_all,
    Event.over,
    Event.home,
)


@pytest.fixture
def meeting(tmp_path: pathlib.Path) -> Iterator[Event]:
    event = Event(tmp_path)
    yield event
    event.close()
    if not event.harmed:
        replay_without_difference(event.record)


def check_restart(meeting: Event) -> None:
    """Check, from outside, that everything stands still, and bring it home."""
    race = meeting.official.wait_for_race(
        lambda race: all(kart.connected and kart.acknowledged for kart in race.karts),
        'every kart back and stopped',
    )
    assert state_of(race.state) is RED_RED
    assert {state_of(kart.hold) for kart in race.karts} == {RED_RED}
    assert [kart.in_race for kart in race.karts] == [True, True, False]
    assert race.track.open
    for kart in meeting.karts.values():
        assert [state for _, state in kart.changes] == [RED_RED]
    refused = meeting.official.call('green_green')
    assert not refused.success
    meeting.home()


# Each kill takes about two seconds, most of it starting a process.
@pytest.mark.timeout(600)
@pytest.mark.parametrize('kills', [FEW, pytest.param(MANY, marks=pytest.mark.long)])
def test_race_control_killed_at_random_comes_back_with_every_kart_held(
    kills: int,
    meeting: Event,
    chance: random.Random,
    record_property: Callable[[str, object], None],
) -> None:
    published = unrecorded = 0
    for _ in range(kills):
        steps = STEPS[: chance.randint(1, len(STEPS))]
        for step in steps[:-1]:
            step(meeting)
        # The last step is under way while race control dies.
        killer = threading.Timer(chance.uniform(0.0, 0.03), meeting.control.kill)
        killer.start()
        try:
            meeting.official.timeout = 0.5
            steps[-1](meeting)
        except AssertionError:
            # Only if nobody answered any more, or what was accepted did not come about any more.
            answer = meeting.official.answer
            assert answer is None or answer.success, answer.message
        killer.join()
        meeting.kill()
        recorded = meeting.recorded()
        assert recorded == list(range(1, len(recorded) + 1))
        replay_without_difference(meeting.record)
        published += len(meeting.seen)
        unrecorded += sum(event.sequence > len(recorded) for event in meeting.seen)
        meeting.start()
        check_restart(meeting)
    figures = f'{kills} kills, {published} events published, {unrecorded} of them not recorded'
    print(figures)
    record_property('crashes', figures)


def crashed_in_green(meeting: Event) -> None:
    """Have race control die while karts race."""
    meeting.grid()
    meeting.green()
    meeting.control.lose_power()
    meeting.run.close()


def test_a_release_that_was_sent_before_race_control_was_back_undoes_no_restart(
    meeting: Event,
) -> None:
    meeting.kill_all()
    before = meeting.official.wait_for_available('in_garage')
    request = SERVICES['in_garage'].Request(track_safe=True, **seen(before, 'in_garage', 0))
    meeting.kill()
    with (
        Official(meeting.domain) as waiting,
        concurrent.futures.ThreadPoolExecutor(1) as elsewhere,
    ):
        client = waiting.node.create_client(SERVICES['in_garage'], '/rcs/in_garage')
        sent = elsewhere.submit(waiting.request, client, request)  # waits for race control
        meeting.start(connect=())
        assert 'does not know what happened' in sent.result().message
    race = meeting.official.wait_for_race(lambda race: True, 'the race')
    assert state_of(race.state) is RED_RED
    meeting.home()


def test_without_the_record_of_a_race_the_next_race_control_stops_karts_and_asks_for_one_look(
    meeting: Event,
) -> None:
    crashed_in_green(meeting)
    meeting.harmed = True
    for beside in meeting.record.parent.glob(f'{meeting.record.name}-*'):
        beside.unlink()
    meeting.record.write_bytes(b'no record any more, but something else' * 100)
    meeting.start()
    race = meeting.official.wait_for_race(lambda race: True, 'the race')
    assert state_of(race.state) is RED_RED
    assert {state_of(kart.hold) for kart in race.karts} == {RED_RED}
    assert race.track.open
    assert not race.track.allowed
    assert msg.Alert.TRACK_UNSAFE in {alert.kind for alert in race.alerts}
    for kart in meeting.karts.values():
        assert [state for _, state in kart.changes] == [RED_RED]
    assert not meeting.official.call('in_garage', track_safe=False).success
    meeting.home()


def test_a_kart_that_left_the_roster_after_a_crash_is_named_and_keeps_the_track_closed(
    meeting: Event,
) -> None:
    crashed_in_green(meeting)
    meeting.racing = (2,)  # somebody took kart 1 out of the roster
    meeting.start(connect=(2, OUTSIDE))
    meeting.official.wait_for_acks(RED_RED, 2, OUTSIDE)
    gone = meeting.official.wait_for_kart(1, lambda kart: not kart.connected, 'named')
    assert (state_of(gone.hold), gone.may_be_moving, gone.address) == (RED_RED, True, '')
    assert not meeting.official.call('set_track_open', open=True).success
    assert not meeting.official.call('in_garage', track_safe=False).success
    meeting.official.command('in_garage', track_safe=True)
    assert not meeting.official.call('set_track_open', open=True).success
    meeting.official.command('kart/in_garage', kart=1, made_safe_by_hand=True)
    meeting.official.command('set_track_open', open=True, no_race_anywhere=True)
