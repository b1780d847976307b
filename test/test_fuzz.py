# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Fuzzing in short: the corpus, a fixed number of executions, and proof that faults are found."""

from __future__ import annotations

import importlib.util
import pathlib
import platform
import re
import subprocess
import sys
from typing import Any

from evgp_protocol import frames
from evgp_rcs import roster
import fuzz_targets
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
CORPUS = [(name, path) for name in fuzz_targets.TARGETS for path in fuzz_targets.corpus(name)]


@pytest.mark.parametrize(('name', 'path'), CORPUS, ids=[f'{n}-{p.name}' for n, p in CORPUS])
def test_every_promise_holds_for_the_corpus(name: str, path: pathlib.Path) -> None:
    fuzz_targets.TARGETS[name](path.read_bytes())


@pytest.mark.skipif(
    importlib.util.find_spec('atheris') is None and platform.machine() != 'x86_64',
    reason='there is no wheel of Atheris for this machine',
)
@pytest.mark.parametrize('runs', [300, pytest.param(3000, marks=pytest.mark.long)])
@pytest.mark.parametrize('name', ['decoder', 'roster'])
def test_nothing_is_found_in_a_fixed_number_of_executions(
    name: str, runs: int, tmp_path: pathlib.Path
) -> None:
    done = subprocess.run(
        [
            *(sys.executable, str(ROOT / 'fuzz' / 'run.py'), name),
            *('--runs', str(runs), '--seed', '1', '--found', str(tmp_path)),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors='replace',
        timeout=100,
    )

    assert done.returncode == 0, done.stdout
    executed = re.search(r'number_of_executed_units: (\d+)', done.stdout)
    assert executed, done.stdout
    assert int(executed[1]) >= runs


def test_an_unknown_target_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / 'fuzz' / 'run.py'), 'kart'], capture_output=True, text=True
    )

    assert done.returncode == 2
    assert 'unknown: kart' in done.stderr


@pytest.mark.parametrize(
    ('where', 'what'),
    [
        ('_find_last', re.compile(rb'[;\x80-\xff]').search),
        ('_find_last', re.compile(rb'[;$]').search),
        ('_find_no_space', re.compile(rb'[^ \t\n]').search),
        ('MAX_FRAME_BYTES', 33),
    ],
)
def test_a_fault_in_the_decoder_is_found(
    where: str, what: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frames, where, what)

    with pytest.raises(AssertionError):
        for path in fuzz_targets.corpus('decoder'):
            fuzz_targets.check_decoder(path.read_bytes())


def test_a_decoder_that_forgets_half_a_frame_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    class Forgetful(frames.FrameDecoder):
        """Begins anew with every read."""

        def feed(self, data: bytes | bytearray | memoryview) -> list[Any]:
            self._frame = b''
            return super().feed(data)

    monkeypatch.setattr(frames, 'FrameDecoder', Forgetful)

    with pytest.raises(AssertionError):
        fuzz_targets.check_decoder(b'$RED_RED;')


@pytest.mark.parametrize(
    ('where', 'what'),
    [
        ('_in_race', lambda self, node, kart: True),
        ('_team', lambda self, node, kart: f' {node.value}'),
        ('_address', lambda self, node, kart: str(node.value).replace('10', '010')),
        ('_heat_name', lambda self, node: f' {node.value}'),
        ('_note', lambda self, where, reason: [][0]),
        ('_in_words', lambda self, fault: f'roster:1: {fault.reason}\n'),
    ],
)
def test_a_fault_in_the_roster_loader_is_found(
    where: str, what: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(roster._Parser, where, what)

    with pytest.raises((AssertionError, LookupError, ValueError)):
        for path in fuzz_targets.corpus('roster'):
            fuzz_targets.check_roster(path.read_bytes())
