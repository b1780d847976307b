# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Run the inspection from a clone without any set-up: ``python3 src/evgp_inspection kart``.

Python puts this directory on its path, so it finds the package. The protocol is beside it.
"""

import pathlib
import sys

SRC = pathlib.Path(__file__).resolve().parents[1]
sys.path.append(str(SRC / 'evgp_protocol'))

if __name__ == '__main__':
    from evgp_inspection.cli import main

    sys.exit(main())
