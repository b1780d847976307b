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
Run the inspection from a clone, with nothing set up: ``python3 src/evgp_inspection kart``.

Python puts this directory on its path, so the package is found. The protocol, and the rule which
order a word answers, are its neighbours.
"""

import pathlib
import sys

SRC = pathlib.Path(__file__).resolve().parents[1]
sys.path += [str(SRC / 'evgp_protocol'), str(SRC / 'evgp_rcs')]

if __name__ == '__main__':
    from evgp_inspection.cli import main

    sys.exit(main())
