"""
Run the inspection from a clone, with nothing set up: ``python3 src/evgp_inspection kart``.

Python puts this directory on its path, so the package is found; the protocol is its neighbour.
"""

import pathlib
import sys

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / 'evgp_protocol'))

if __name__ == '__main__':
    from evgp_inspection.cli import main

    sys.exit(main())
