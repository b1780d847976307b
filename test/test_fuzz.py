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

from evgp_node import roster
from evgp_protocol import frames
from evgp_timing import framing
from evgp_timing.passings import Sign
import fuzz_targets
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
CORPUS = [(name, path) for name in fuzz_targets.TARGETS for path in fuzz_targets.corpus(name)]


@pytest.mark.parametrize(('name', 'path'), CORPUS, ids=[f'{n}-{p.name}' for n, p in CORPUS])
def test_every_promise_holds_for_the_corpus(name: str, path: pathlib.Path) -> None:
    fuzz_targets.TARGETS[name](path.read_bytes())


@pytest.mark.skipif(
    importlib.util.find_spec('atheris') is None
    and (platform.machine() != 'x86_64' or sys.version_info >= (3, 13)),
    reason='there is no wheel of Atheris for this machine or this Python',
)
@pytest.mark.parametrize(
    'runs', [300, pytest.param(3000, marks=[pytest.mark.long, pytest.mark.longest])]
)
@pytest.mark.parametrize('name', ['decoder', 'roster', 'timing'])
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


def pieces(old: bytes, new: bytes) -> re.Pattern[bytes]:
    """Return the decoder's grammar with a fault."""
    right = frames._PIECES
    assert old in right.pattern
    return re.compile(right.pattern.replace(old, new), right.flags)


class Forgetful(frames.FrameDecoder):
    """Begins anew with every read."""

    def feed(self, data: bytes | bytearray | memoryview) -> list[Any]:
        self._frame = b''
        return super().feed(data)


@pytest.mark.parametrize(
    ('target', 'owner', 'where', 'what'),
    [
        ('decoder', frames, '_PIECES', pieces(rb'[^;$\x80-\xff]', rb'[^;\x80-\xff]')),
        ('decoder', frames, '_PIECES', pieces(rb'[^;$\x80-\xff]', rb'[^;$]')),
        ('decoder', frames, '_PIECES', pieces(rb'\r\n\0', rb'\n')),
        ('decoder', frames, '_PIECES', pieces(rb'{0,30}', rb'{0,31}')),
        ('decoder', frames, 'FrameDecoder', Forgetful),
        ('roster', roster, '_truth', lambda node: True),
        ('roster', roster, '_team', lambda node: f' {node.value}'),
        ('roster', roster, '_address', lambda node: node.value.replace('10', '010')),
        ('roster', roster._Reading, '_heat_name', lambda self, node: f'{node.value}\n'),
        ('roster', roster._Reading, '_note', lambda self, where, reason: [][0]),
        ('timing', framing.MarkedDecoder, 'feed', lambda self, data: [Sign()]),
        ('timing', framing, 'MAX_RECORD_BYTES', 20),
        ('timing', framing.Framing, 'unpack', lambda self, record: [][len(record)]),
        ('roster', roster, '_shown', lambda node: '\n'),
    ],
)
def test_a_fault_is_found(
    target: str, owner: Any, where: str, what: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(owner, where, what)

    with pytest.raises((AssertionError, LookupError, ValueError)):
        for path in fuzz_targets.corpus(target):
            fuzz_targets.TARGETS[target](path.read_bytes())
