"""
Soak race control with random faults, acknowledgements and commands; see ``--help``.

    make soak ARGS='--seconds 600 --karts 100'
"""

import sys

from race_soak.main import main

if __name__ == '__main__':
    sys.exit(main())
