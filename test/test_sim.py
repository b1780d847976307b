# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""`make sim`: three karts of three kinds in a simulator."""

from __future__ import annotations

import pathlib
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest

ROOT = pathlib.Path(__file__).parents[1]


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.timeout(300)
def test_three_karts_of_three_kinds_drive_a_race_and_it_is_drawn(tmp_path: pathlib.Path) -> None:
    picture = tmp_path / 'sim.svg'
    words = [sys.executable, ROOT / 'kit/sim/race.py', '--laps', '1', '--picture', picture]

    done = subprocess.run(words, capture_output=True, text=True)

    assert done.returncode == 0, done.stdout + done.stderr
    assert len(re.findall(r'^\d\. kart \d, .*: 1 laps', done.stdout, re.MULTILINE)) == 3
    drawn = ElementTree.parse(picture)  # noqa: S314 - written just now
    assert {each.text[0] for each in drawn.findall('.//{*}text') if each.text} >= {*'123R'}
