# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A rehearsal with the real race control and timekeeper, simulated karts, incidents and debriefs.

It cannot reach a real kart or race. Race control listens on loopback, and the
rehearsal writes a roster with loopback addresses only. The ROS domain is the rehearsal's own, on
this machine only. The rehearsal commands a race only if its karts are those of this roster.
"""

from __future__ import annotations

import bisect
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
import contextlib
import copy
import dataclasses
import os
import pathlib
import secrets
import signal
import threading
import time

from evgp_node.codec import message_of, value_of
from evgp_node.qos import latched
from evgp_node.results import Corrected, Passing
from evgp_node.states import state_of
from evgp_node.stream_file import BOOK
from evgp_protocol import clock
from evgp_protocol.states import RaceState
from evgp_rcs.record.runs import open_runs
from evgp_rcs.record.timing import entries
from evgp_rcs.rules.race import StampedEvent
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.spare.copies import fetch, keep
from evgp_rcs_msgs import msg
from evgp_rehearsal.debrief import debrief, Occurrence
from evgp_rehearsal.field import Connected, Failure, Field, LINE, TICK_LENGTH
from evgp_rehearsal.incidents import ALERTS, can_begin, choose_kart, INCIDENTS, LASTS
from evgp_rehearsal.plan import Plan
from evgp_testing.domains import Domain
from evgp_testing.kart import Bridge
from evgp_testing.official import Official
from evgp_testing.part import Part
from evgp_testing.process import Process
from evgp_testing.race_control import address_of, RaceControl, Timekeeper
from evgp_testing.wire_kart import WireKart
from evgp_testing.witness import Witness
import yaml

BANNER = 'REHEARSAL'
"""Banner that every screen shows in a rehearsal."""

SETTINGS = {'banner': BANNER, **ALERTS}
"""Parameters of the rehearsal's race control."""

HEAT = 'rehearsal'
"""Name of the roster's heat, which has the plan's laps."""

CONNECT_AGAIN = 10
"""Time between a kart's attempts to connect, in ticks."""


class RefusedError(RuntimeError):
    """The rehearsal refuses a request. The text says why."""


class DrivenKart(WireKart):
    """
    The connection of a simulated kart.

    :param hear: called with the kart's number and each new state, in the thread that reads.
    :param witness: learns of this connection.
    :raises OSError: if race control cannot be reached.
    """

    def __init__(
        self,
        number: int,
        port: int,
        hear: Callable[[int, RaceState], None],
        witness: Witness | None = None,
    ) -> None:
        self._hear = hear
        super().__init__(address_of(number), port, witness=witness, kart=number)

    def answer(self, state: RaceState, change: bool) -> None:
        """Pass on a new state, which the simulated kart answers once it has carried it out."""
        if change:
            self._hear(self.kart, state)

    def acknowledge(self, state: RaceState) -> None:
        """Report the state that the simulated kart has reached."""
        with contextlib.suppress(OSError):  # the connection is gone, which the reader notices
            self.say(state)


class Rehearsal(Part):
    """
    A field, its race control, and the incidents.

    Read and change ``field`` only inside ``with rehearsal.lock:``.

    :param folder: the folder for roster and record.
    :param bridged: number of karts, from the last one backwards, that have the real bridge and the
        example stack. They are in the race, but no incident happens to them.
    :param window: whether to open the officials' window.
    :param witness: learns of what the simulated karts are sent and answer, and every command.
    :ivar links: the connections of the simulated karts.
    :ivar present: the current incident, or None.
    :ivar paused: whether the karts pause, with their connections open.
    :ivar dead: set once race control's laptop has died.
    """

    def __init__(
        self,
        plan: Plan,
        folder: pathlib.Path,
        bridged: int = 0,
        window: bool = False,
        witness: Witness | None = None,
    ) -> None:
        """Start race control and the timekeeper and let the karts connect."""
        # The nodes in this process must not see or command another race either.
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        os.environ['EVGP_GRAPH_INTERFACE'] = ''
        self.plan = plan
        simulated = plan.karts - bridged
        self.field = Field(plan, plan.numbers[:simulated])
        self.lock = threading.Condition()
        self.paused = False
        self.took: list[Occurrence] = []
        self.cues = list(plan.script)
        self.window: Process | None = None
        self.folder = folder
        self._times: list[float] = []  # when each tick was, by race control's clock
        self.present: Occurrence | None = None
        self._first: dict[RaceState, int] = {}  # the tick at which the race reached it
        self._ended = False
        self._again: Future[None] | None = None
        self.dead = threading.Event()
        self.links: dict[int, DrivenKart | WireKart] = {}
        self._witness = witness
        with contextlib.ExitStack() as stack:
            # A process ends with the thread that started it (evgp_testing.process), so this thread
            # lives as long as the rehearsal.
            self._starter = stack.enter_context(ThreadPoolExecutor(1, 'starter'))
            self.domain = stack.enter_context(Domain()).number
            self.control = self._race_control({})
            stack.callback(lambda: self.control.close())
            self._timekeeper = stack.enter_context(Timekeeper(folder, self.domain))
            hears = 'race', 'events', 'results'
            self.official = stack.enter_context(Official(self.domain, 'rehearsal', witness, hears))
            self._session = secrets.token_hex(4)  # of the timing line
            self._passings = self.official.node.create_publisher(
                msg.Passing, '/rcs/passings', latched(200)
            )
            race = self.official.wait_for_race(lambda race: True, 'a first look at the race')
            self._check_own(race)
            for number in plan.numbers[simulated:]:
                domain = stack.enter_context(Domain()).number
                stack.enter_context(Bridge(domain, self.control.port, address_of(number)))
                stack.enter_context(Process('evgp_kart_bridge', 'example_stack', domain))
            if window:
                self.open_window()
            stack.callback(lambda: self.window is not None and self.window.close())
            self._stack = stack.pop_all()
        self._thread = threading.Thread(target=self._run, name='field', daemon=True)
        self._thread.start()

    # ----- what the instructor does -------------------------------------------------------

    def inject(self, name: str, kart: int = 0) -> Occurrence:
        """
        Begin an incident now, and end the previous one.

        :raises RefusedError: if there is no such incident or kart, or it cannot begin now.
        """
        row = INCIDENTS.get(name)
        if row is None:
            raise RefusedError(f'there is no incident {name}')
        state = self.state
        with self.lock:
            if kart and kart not in self.field.karts:
                raise RefusedError(f'kart {kart} is not simulated here')
            if not can_begin(row, self.field, state, kart):
                whom = f' to kart {kart}' if kart else ''
                raise RefusedError(f'Not now{whom}: {name} begins {row.phase.value}')
            self._end_incident()
            number = choose_kart(self.field, row, kart)
            self.present = Occurrence(name, number, self.field.tick, self.field.tick)
            row.begin(self.field, number)
            return self.present

    def can_begin(self, name: str) -> bool:
        """Return whether an incident can begin now."""
        state = self.state
        with self.lock:
            return can_begin(INCIDENTS[name], self.field, state)

    def mend(self) -> None:
        """End the incident, as if marshals and teams had repaired everything."""
        with self.lock:
            self._end_incident()

    def use_msr(self) -> None:
        """Cut the power of every kart, which the official must then record."""
        with self.lock:
            self.field.use_msr()

    def open_window(self) -> None:
        """Open the officials' window, unless it is open already."""

        def start() -> None:
            if self.window is None or not self.window.runs:
                words = {'official': 'trainee'}
                self.window = Process(
                    'evgp_rcs_console', 'rcs_gui', self.domain, words, shown=True
                )  # it prints only why it cannot open

        self._starter.submit(start).result()

    @property
    def drill(self) -> str:
        """Return the command line with which to take over once race control's laptop has died."""
        called = os.environ.get('EVGP_TAKEOVER', "make takeover %s ARGS='%s'")
        words = 'ADDRESS=127.0.0.1 INTERFACE=lo', f'--port {self.control.port}'
        return f'ROS_HOME={self.folder} ROS_DOMAIN_ID={self.domain} {called % words}'

    # ----- what an official sees ----------------------------------------------------------

    @property
    def state(self) -> RaceState:
        """Return the last received state of the race."""
        # This is called in every tick, so it reads only this part of the message.
        race = self.official.race
        return (state_of(race.state) if race else None) or RaceState.RED_RED

    @property
    def race(self) -> Snapshot | None:
        """Return the last received race, or None."""
        race = self.official.race
        return None if race is None else value_of(race, Snapshot)

    def gather(self) -> None:
        """
        Bring the race to IN_GARAGE and close the track, whatever state race control started in.

        :raises AssertionError: if the race does not get there in time.
        """
        official = self.official
        official.wait_for_connected(*self.plan.numbers)
        official.bring_to(RaceState.IN_GARAGE)
        if official.race is not None and official.race.track.open:
            official.command('set_track_open', open=False)
        official.command('set_heat', heat=HEAT)

    # ----- the debrief --------------------------------------------------------------------

    def debriefs(self) -> list[list[str]]:
        """Return the debrief of each incident so far, from the record on the disk."""
        with self.lock:
            took = list(self.took)
            if self.present is not None:
                took.append(dataclasses.replace(self.present, ended=self.field.tick))
            truth = copy.deepcopy(self.field.truth)
            times = list(self._times)
        happened = [
            event._replace(monotonic=_in_ticks(event.monotonic, times)) for event in self.events()
        ]
        asked = [each._replace(at=_in_ticks(each.at, times)) for each in corrected(self.folder)]
        return [debrief(each, happened, truth, asked) for each in took]

    def wait_for_end(self, number: int) -> None:
        """Wait until more than this number of incidents have ended and are in the record."""
        with self.lock:
            self.lock.wait_for(lambda: len(self.took) > number)
            until = self.took[number].ended + 20  # ticks, after which its events are on the disk
            self.lock.wait_for(lambda: self.field.tick >= until)

    def events(self) -> list[StampedEvent]:
        """Return all events of the record, from every run of race control."""
        # After a takeover, the newest record also contains the earlier runs.
        records = self.folder.rglob('record.sqlite3')
        newest = max(records, key=lambda path: path.stat().st_mtime)
        with open_runs(newest) as runs:
            found = [each for run in runs.listed for each in runs.read(run).events()]
        return [each for each in found if isinstance(each, StampedEvent)]

    # ----- the field's thread -------------------------------------------------------------

    def close(self) -> None:
        """End everything."""
        self._ended = True
        self._thread.join()
        if self._again is not None:
            self._again.exception()  # wait until it has started, because it must be ended too
        for link in self.links.values():
            link.close()
        self._stack.close()

    def _run(self) -> None:
        due, reported = time.monotonic(), 0
        while not self._ended:
            due = max(
                due + TICK_LENGTH, time.monotonic() - TICK_LENGTH
            )  # do not catch up on missed ticks
            time.sleep(max(0.0, due - time.monotonic()))
            if self.paused:
                continue
            with self.lock:
                said = self.field.step()
                self._times.append(clock.now())
                epoch_ns = time.time_ns() - round(self.field.tick * TICK_LENGTH * 1e9)
                crossings = self.field.truth.crossings[reported:]
                failures, self.field.failures = self.field.failures, []
                if self.present is not None and self.field.tick >= self.present.began + LASTS:
                    self._end_incident()
                self._cue()
                self.lock.notify_all()
            for number, state in said:
                link = self.links.get(number)
                if isinstance(link, DrivenKart):
                    link.acknowledge(state)
            for crossing in crossings:
                reported += 1
                passing = Passing(
                    LINE,
                    self._session,
                    reported,
                    crossing.kart,
                    stamp_ns=epoch_ns + round(crossing.at * 1e9),
                )
                self._passings.publish(message_of(passing, msg.Passing))
            for number, kart in self.field.karts.items():
                self._connect(number, kart.link(self.field.tick))
            for each in failures:
                self._happen(each)
            self._keep_race_control()

    def _connect(self, number: int, wanted: Connected) -> None:
        link = self.links.get(number)
        present = Connected.NOBODY
        if link is not None and not link.ended:
            present = Connected.KART if isinstance(link, DrivenKart) else Connected.STRANGER
        if present is wanted:
            return
        if link is None:
            if self.field.tick % CONNECT_AGAIN == 0:
                self._join(number, wanted)
            return
        del self.links[number]
        if wanted is Connected.STRANGER and present is Connected.KART:
            # The new connection replaces the kart's own, which race control then ends.
            self._join(number, wanted)
            link.wait_for_end()
        link.close()
        if isinstance(link, DrivenKart):
            with self.lock:
                self.field.karts[number].drop()

    def _join(self, number: int, wanted: Connected) -> None:
        with contextlib.suppress(OSError):  # race control is not running, so try again later
            self.links[number] = (
                DrivenKart(number, self.control.port, self._hear, self._witness)
                if wanted is Connected.KART
                else WireKart(address_of(number), self.control.port)
            )

    def _hear(self, number: int, state: RaceState) -> None:
        with self.lock:
            self.field.hear(number, state)

    def _happen(self, what: Failure) -> None:
        if what is Failure.CLOSE_CONSOLE:
            if self.window is not None:
                self.window.kill()
                self.window = None
            return
        os.kill(self.control.kart_server_pid, signal.SIGKILL)
        self.control.kill()
        if what is Failure.DIE:
            self._timekeeper.kill()
            copy, record = str(self.folder), self.folder / 'record.sqlite3'
            parameters = self.folder / 'rcs.yaml'
            # Otherwise, the copy would affect the marks of a real race control on this machine.
            where = {'address': '127.0.0.1', 'port': self.control.port}
            settings = {'/**': {'ros__parameters': {**SETTINGS, **where}}}
            parameters.write_text(yaml.safe_dump(settings), encoding='utf-8')
            packed = fetch(copy, 'karts.yaml', parameters.name, str(record))
            keep(packed, copy, self.folder / 'evgp_rcs' / 'spare')
            self.dead.set()

    def _keep_race_control(self) -> None:
        """Restart race control after 1 s, whatever ended it, as ``make run`` does."""
        same_machine = {'port': self.control.port}

        def again() -> None:
            time.sleep(1.0)
            self.control = self._race_control(same_machine)

        if not (self.dead.is_set() or self.control.runs) and (
            self._again is None or self._again.done()
        ):
            self._again = self._starter.submit(again)

    def _cue(self) -> None:
        """Begin the script's first incident that is due and can begin."""
        self._first.setdefault(self.state, self.field.tick)
        for cue in self.cues:
            since = self._first.get(INCIDENTS[cue.incident].state)
            if since is None or (self.field.tick - since) * TICK_LENGTH < cue.at:
                continue
            with contextlib.suppress(RefusedError):  # it begins as soon as it can
                self.inject(cue.incident)
                self.cues.remove(cue)
                return

    def _end_incident(self) -> None:
        if self.present is not None:
            self.took.append(dataclasses.replace(self.present, ended=self.field.tick))
            self.present = None
        self.field.mend()

    def _race_control(self, where: Mapping[str, object]) -> RaceControl:
        return RaceControl(
            self.folder,
            self.domain,
            self.plan.numbers,
            parameters={**where, **SETTINGS},
            teams=self._teams(),
            heats={HEAT: {'karts': list(self.plan.numbers), 'laps': self.plan.laps}},
        )

    def _teams(self) -> dict[int, str]:
        return {number: f'{BANNER} {number}' for number in self.plan.numbers}

    def _check_own(self, race: Snapshot) -> None:
        heard = {kart.number: (kart.team, kart.address) for kart in race.karts}
        own = {number: (team, address_of(number)) for number, team in self._teams().items()}
        if heard != own:
            raise RefusedError("the race is not this rehearsal's own")


def corrected(folder: pathlib.Path) -> list[Corrected]:
    """Return the corrections that the timekeeper accepted, from its book in a folder."""
    return [each for _, each in entries(folder / BOOK) if isinstance(each, Corrected)]


def _in_ticks(at: float, times: Sequence[float]) -> float:
    """Convert race control's time to the field's clock, which stops during a pause."""
    return bisect.bisect_left(times, at) * TICK_LENGTH
