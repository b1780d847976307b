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
Measure how long an official's stop takes over a network that loses packets; see ``--help``.

    setup/in-workspace python bench/lost_calls.py --loss 0 0.02 0.1
"""

from __future__ import annotations

import argparse
import pathlib
import statistics
import sys
import tempfile
import time

from evgp_testing.desk import official_at_a_desk
from evgp_testing.networks import NetworkError
from evgp_testing.official import Official


def main() -> int:
    """Print a line for each share that is lost; return 2 where no networks can be made."""
    parser = argparse.ArgumentParser(description='Measure calls on a network that loses packets.')
    parser.add_argument('--times', type=int, default=200, help='stops for each share (200)')
    parser.add_argument(
        '--loss', type=float, nargs='+', default=[0.0, 0.02, 0.1], help='shares (0 0.02 0.1)'
    )
    parser.add_argument('--seed', type=int, default=0, help='of what is lost (0)')
    options = parser.parse_args()
    print('| lost, each way | call → answer, ms, median / 99th percentile / worst | over 1 s |')
    print('|---|---|---|')
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            official_at_a_desk(pathlib.Path(folder), options.seed) as (official, desk),
        ):
            official.command('all_kill')
            for loss in options.loss:
                desk.air(loss)
                took = sorted(timed(official) for _ in range(options.times))
                late = sum(each > 1.0 for each in took)
                three = statistics.median(took), took[int(len(took) * 0.99)], took[-1]
                times = ' / '.join(f'{each * 1000:.1f}' for each in three)
                print(f'| {loss:.0%} | {times} | {late} of {len(took)} |', flush=True)
                desk.air()
    except NetworkError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def timed(official: Official) -> float:
    """Return how long a stop takes from its call to its answer, s."""
    began = time.monotonic()
    assert official.call('all_kill').success
    return time.monotonic() - began


if __name__ == '__main__':
    sys.exit(main())
