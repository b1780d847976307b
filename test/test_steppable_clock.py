# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The steppable clock of the tests changes no more of a program than its clocks."""

import pathlib
import subprocess

from evgp_testing.part import PATIENCE
from rig.steppable_clock import SteppableClock

LATE_SIGNAL = pathlib.Path(__file__).with_name('rig') / 'late_signal.c'


def test_a_signal_that_comes_as_a_slice_of_a_wait_ends_is_not_lost(tmp_path: pathlib.Path) -> None:
    program = tmp_path / 'late_signal'
    subprocess.run(['cc', '-O2', '-o', program, LATE_SIGNAL, '-lpthread'], check=True)
    with SteppableClock(tmp_path) as clock, clock.on_it():
        subprocess.run([program], check=True, timeout=PATIENCE)
