# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The soak: a short one of the real race control, and proof that its witness finds faults."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass, field
import math
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import time
from typing import Any

from evgp_protocol import clock
from evgp_protocol.states import RaceState
import evgp_rcs
from evgp_rcs.karts import server
from evgp_rcs.record.replay import Replay
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.inputs import Entry, Ordered
from evgp_testing.witness import Call, Witness
import pytest
from recorded_races import kept, PaperRace
from rig.faults import Fault, tree_with

ROOT = pathlib.Path(__file__).resolve().parents[1]


def run_soak(
    *arguments: str, before_on_path: pathlib.Path | None = None
) -> subprocess.CompletedProcess[str]:
    path = [str(before_on_path)] if before_on_path else []
    return subprocess.run(
        [sys.executable, str(ROOT / 'soak' / 'run.py'), *arguments],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join([*path, os.environ['PYTHONPATH']])},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=100,
    )


@pytest.mark.parametrize('seconds', [6, pytest.param(12, marks=pytest.mark.long)])
def test_race_control_breaks_no_rule_in_a_short_soak(seconds: int, chance: random.Random) -> None:
    seed = chance.randrange(1_000_000)
    # Of the faults that come while a race is planned, one in twenty is let through.
    often = '--fault-every', '0.5'
    done = run_soak('--seconds', str(seconds), '--karts', '20', '--seed', str(seed), *often)

    assert done.returncode == 0, done.stdout
    assert f'seed {seed}, 20 karts' in done.stdout
    assert re.search(r'^violations +0$', done.stdout, re.MULTILINE), done.stdout
    assert re.search(r'^replay +[1-9].*; no difference', done.stdout, re.MULTILINE), done.stdout
    for counted in ('frames sent to karts', 'frames said by karts', 'faults injected', 'commands'):
        assert re.search(rf'^{counted} +[1-9]', done.stdout, re.MULTILINE), done.stdout
    assert re.search(r'memory of rcs_node +[\d.]+ MiB, then [\d.]+ MiB', done.stdout)


@pytest.mark.long
def test_a_race_control_with_a_fault_does_not_pass_the_soak(
    chance: random.Random, tmp_path: pathlib.Path
) -> None:
    # However far the races get on a busy computer, every connection shows it.
    fault = Fault('_send', 'link is not => link is not None and order.kart % 2')
    package = pathlib.Path(evgp_rcs.__path__[0])
    changed = tmp_path / 'evgp_rcs'
    shutil.copytree(package, changed, ignore=shutil.ignore_patterns('__pycache__'))
    faulty = ast.unparse(tree_with(server, fault))
    (changed / 'karts' / 'server.py').write_text(faulty, encoding='utf-8')

    done = run_soak(
        *('--seconds', '12', '--karts', '12'),
        *('--seed', str(chance.randrange(1_000_000))),
        before_on_path=tmp_path,
    )

    assert done.returncode == 1, done.stdout
    assert 'kart 2 was sent nothing' in done.stdout, done.stdout


# ----- the witness ------------------------------------------------------------------------


@dataclass
class Link:
    """A connection of kart 7 as the kart saw it."""

    kart: int = 7
    opened: float = 99.9
    closed_at: float = math.inf
    changes: list[tuple[float, RaceState]] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    said: list[tuple[RaceState, float, float]] = field(default_factory=list)
    malformed: list[bytes] = field(default_factory=list)

    @property
    def frames(self) -> int:
        return len(self.times)


class Scene:
    """A race of one kart, its record, and a witness who saw all of it."""

    def __init__(self) -> None:
        self.paper = PaperRace({7: 'Purdue'})
        self.link: Any = Link(changes=[(100.0, RaceState.IN_GARAGE)])
        self.witness = Witness()
        self.witness.links.append(self.link)
        self.paper.connect(7)
        self.paper.wait(1.0)
        for kind in (CommandKind.GRID_ACTIVE, CommandKind.GREEN_GREEN, CommandKind.ALL_KILL):
            now = self.paper.now
            self.paper.command(kind)
            self.link.changes.append((now, self.paper.race.karts[7].sent))
            self.witness.calls.append(Call('Ada', kind, 0, True, now, now, True))
            self.paper.wait(2.0)
            self.paper.say(7)
            self.link.said.append((self.paper.race.karts[7].sent, *[self.paper.now] * 2))
            self.paper.wait(1.0)
        self.link.closed_at = self.paper.now
        self.link.times = [at / 10 for at in range(1000, round(self.paper.now * 10))]
        self.paper.lose(7)
        self.paper.wait(5.0)
        self.entries: list[Entry] = self.paper.stream()

    def wrong(self) -> list[str]:
        return self.witness.compare(Replay(kept(self.entries)))


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Scene:
    """Return a scene in which everything was as it must be."""
    monkeypatch.setattr(clock, 'now', time.monotonic)
    return Scene()


def test_the_witness_raises_no_false_alarm(scene: Scene) -> None:
    assert scene.wrong() == []


def _order_missing(scene: Scene) -> None:
    scene.entries.remove(next(each for each in scene.entries if isinstance(each, Ordered)))


def _change(scene: Scene, place: int, later: float, state: RaceState | None = None) -> None:
    at, sent = scene.link.changes[place]
    scene.link.changes[place] = at + later, state or sent


WRONG: dict[str, tuple[Callable[[Scene], object], str]] = {
    'another state': (
        lambda scene: _change(scene, 2, 0.0, RaceState.RED_FLAG),
        'it was sent RED_FLAG instead of GREEN_GREEN',
    ),
    'a state too early': (lambda scene: _change(scene, 2, -0.5), 'before that was decided'),
    'a stop too late': (lambda scene: _change(scene, 3, 1.5), 'not sent RED_RED within 1 s'),
    'no stop': (lambda scene: scene.link.changes.pop(), 'not sent RED_RED within 1 s'),
    'one state more': (
        lambda scene: scene.link.changes.append((109.5, RaceState.IN_GARAGE)),
        'it was sent IN_GARAGE, which nobody had decided',
    ),
    'nothing': (lambda scene: scene.link.times.clear(), 'was sent nothing'),
    'no connection in the record': (
        lambda scene: setattr(scene.link, 'opened', 105.0),
        'a connection is not in the record',
    ),
    'an old word counts': (
        lambda scene: scene.link.said.insert(0, (scene.link.said.pop(0)[0], 100.8, 100.9)),
        'its GRID_ACTIVE counted',
    ),
    'a word counts before it is said': (
        lambda scene: scene.link.said.insert(0, (scene.link.said.pop(0)[0], 103.1, 103.1)),
        'its GRID_ACTIVE counted',
    ),
    'an end that nobody notices': (
        lambda scene: setattr(scene.link, 'closed_at', scene.link.closed_at - 2.5),
        'its end was not noticed within 2 s',
    ),
    'rubbish': (lambda scene: scene.link.malformed.append(b'$GO;'), "was sent b'$GO;'"),
    'a stranger': (lambda scene: scene.witness.strangers.append('who?'), 'who?'),
    'a call without effect': (
        lambda scene: scene.witness.calls.append(scene.witness.calls[0]),
        'it is not in the record',
    ),
    'a command that nobody called': (lambda scene: scene.witness.calls.pop(), 'nobody called ALL'),
    'another command': (
        lambda scene: scene.witness.calls.reverse(),
        'ALL_KILL by Ada, success True: the record has',
    ),
    'another answer': (
        lambda scene: setattr(scene.witness.calls[1], 'success', False),
        'the record has',
    ),
    'a statement that was not made': (
        lambda scene: setattr(scene.witness.calls[0], 'statement', False),
        'the record has',
    ),
    'a stop that is answered first': (
        lambda scene: setattr(scene.witness.calls[2], 'ended', 106.5),
        'judged before the call or after the answer',
    ),
    'another rule': (_order_missing, 'in the replay'),
}


@pytest.mark.parametrize('name', WRONG)
def test_the_witness_finds(name: str, scene: Scene) -> None:
    harm, words = WRONG[name]
    harm(scene)
    assert any(words in each for each in scene.wrong()), scene.wrong()
