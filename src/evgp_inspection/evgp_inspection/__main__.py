"""``python3 -m evgp_inspection kart`` and ``python3 -m evgp_inspection rcs``."""

import sys

from evgp_inspection.cli import main

if __name__ == '__main__':
    sys.exit(main())
