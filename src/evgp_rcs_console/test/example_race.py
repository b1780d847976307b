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

"""The race of one kart from which the tests of the console make theirs."""

from __future__ import annotations

from evgp_rcs.catalogue import CommandKind
from evgp_rcs_console.snapshot import Available, Kart, Race, State, Track

EVERYTHING = {command: Available(True) for command in CommandKind}
"""Race control offers every command."""

KART = Kart(
    number=7,
    team='Purdue',
    in_race=True,
    connected=True,
    sent=State.GRID_ACTIVE,
    sent_for=40.0,
    acknowledged=False,
    reported=State.IN_GARAGE,
    hold=State.UNKNOWN,
    hold_reason='',
    may_be_moving=False,
    place=0,
    commands=EVERYTHING,
)
RACE = Race(
    state=State.GRID_ACTIVE,
    state_for=40.0,
    over=False,
    karts=(KART,),
    commands=EVERYTHING,
    track=Track(is_open=False, allowed=False, reason='the race is in GRID_ACTIVE', msr_used=False),
    alerts=(),
)
