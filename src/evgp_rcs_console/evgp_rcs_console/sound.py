# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The sound of an alert: a short two-tone wave, played by what the machine has to play it."""

from __future__ import annotations

import array
import math
import pathlib
import shutil
import sys
import tempfile
import wave

from evgp_rcs_console.qt import QtCore, QtWidgets

PLAYERS = ('pw-play', 'paplay', 'aplay')
"""Programs that play a file, the preferred one first."""

RATE = 22050
TONES = ((880.0, 0.18), (660.0, 0.18), (880.0, 0.18))
"""Frequency (Hz) and length (s) of each tone."""


def alarm() -> bytes:
    """Return the samples of the alarm: 16 bit, mono."""
    samples = array.array('h')
    for frequency, length in TONES:
        count = int(RATE * length)
        samples.extend(
            int(24000 * math.sin(2 * math.pi * frequency * n / RATE)) for n in range(count)
        )
    if sys.byteorder == 'big':
        samples.byteswap()
    return samples.tobytes()


class Sound:
    """
    Plays the alarm without waiting for it.

    Where no player is found it is the system's bell, which many machines have turned off.
    """

    def __init__(self) -> None:
        """Look for a player, and write the file for it."""
        found = [path for path in map(shutil.which, PLAYERS) if path]
        self._player = found[0] if found else None
        self._folder = tempfile.TemporaryDirectory(prefix='rcs_gui-')
        self._file = pathlib.Path(self._folder.name, 'alarm.wav')
        with wave.open(str(self._file), 'wb') as out:
            out.setnchannels(1)
            out.setsampwidth(2)
            out.setframerate(RATE)
            out.writeframes(alarm())

    def play(self) -> None:
        """Play it once."""
        if self._player is None:
            QtWidgets.QApplication.beep()
        else:
            QtCore.QProcess.startDetached(self._player, [str(self._file)])

    def close(self) -> None:
        """Remove the file."""
        self._folder.cleanup()
