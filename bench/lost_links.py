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

"""
Measure how soon a lost link is noticed, at both ends, over real networks; see ``--help``.

    setup/in-workspace python bench/lost_links.py
    setup/in-workspace python bench/lost_links.py --minutes 10 --loss 0.05 --delay 0.05
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import functools
import os
import pathlib
import statistics
import sys
import tempfile

from evgp_testing import lost_links
from evgp_testing.lost_links import NetworkRace, Noticed
from evgp_testing.networks import NetworkError


def figures(times: list[float | None]) -> str:
    """Return the median and the worst of some times, in seconds."""
    seen = [each for each in times if each is not None]
    if not seen:
        return '-'
    return f'{statistics.median(seen):.3f} / {max(seen):.3f}'


def measure_faults(race: NetworkRace, repetitions: int, only: str) -> None:
    """Print a line per fault: how soon it was noticed."""
    faults: dict[str, Callable[[NetworkRace], Noticed]] = {
        fault.name: functools.partial(lost_links.cut, fault=fault) for fault in lost_links.CUTS
    }
    faults['bridge frozen (SIGSTOP)'] = lost_links.freeze_bridge
    faults['bridge killed'] = lost_links.kill_bridge
    faults['machine rebooted'] = lost_links.reboot_machine
    faults['address stolen'] = lost_links.steal_address
    print(f'Median / worst of {repetitions}, s')
    print('| fault | race control | kart | back after | worst gap of the other kart |')
    print('|---|---|---|---|---|')
    for name, fault in faults.items():
        if only not in name:
            continue
        noticed = [fault(race) for _ in range(repetitions)]
        columns = (
            figures([each.by_race_control for each in noticed]),
            figures([each.by_kart for each in noticed]),
            figures([each.back for each in noticed]),
            figures([each.gap for each in noticed]),
        )
        print(f'| {name} | {" | ".join(columns)} |', flush=True)


def measure_bad_air(race: NetworkRace, loss: float, delay: float, minutes: float) -> int:
    """Print what became of a race in bad air; return how often a kart was lost."""
    from evgp_testing.lost_links import race_in_bad_air

    stretch = race_in_bad_air(race, loss, delay, minutes * 60)
    gaps = sorted(stretch.gaps)
    print(
        f'{loss:.0%} lost and {delay * 1000:.0f} ms late in each direction, two karts, '
        f'{stretch.seconds / 60:.1f} minutes in GREEN_GREEN:'
    )
    print(f'  lost, by race control: {len(stretch.lost)} times; by the bridge: {stretch.stopped}')
    for text in stretch.lost[:5]:
        print(f'    {text}')
    print(f'  back after (median / worst, s): {figures([*stretch.back])}')
    print(
        f'  between two frames (s): median {statistics.median(gaps):.3f}, '
        f'99.9 % {gaps[int(len(gaps) * 0.999)]:.3f}, worst {gaps[-1]:.3f}'
    )
    return len(stretch.lost) + stretch.stopped


def main() -> int:
    """Measure; return 0, or 1 if a kart was lost in bad air."""
    parser = argparse.ArgumentParser(description='Measure how soon a lost link is noticed.')
    parser.add_argument('--repetitions', type=int, default=20, help='of each fault (20)')
    parser.add_argument('--only', default='', help='only faults whose name has this in it')
    parser.add_argument(
        '--minutes', type=float, default=0.0, help='race so long in bad air instead'
    )
    parser.add_argument('--loss', type=float, default=0.05, help='share lost (0.05)')
    parser.add_argument('--delay', type=float, default=0.05, help='how late, s (0.05)')
    parser.add_argument('--seed', type=int, default=0, help='of what is lost (0)')
    parser.add_argument(
        '--congestion', default='', help="TCP's congestion control, such as cubic (the system's)"
    )
    options = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            NetworkRace(pathlib.Path(folder), options.seed, options.congestion) as race,
        ):
            if options.minutes:
                return int(measure_bad_air(race, options.loss, options.delay, options.minutes) > 0)
            measure_faults(race, options.repetitions, options.only)
    except NetworkError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
