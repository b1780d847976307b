"""
Soak race control with random faults, acknowledgements and commands; see ``--help``.

    make soak ARGS='--seconds 600 --karts 100'
"""

import pathlib
import sys


def _main() -> int:
    # The parts of a race live with the tests; they can be imported only from here on.
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / 'test'))
    from race_soak.main import main

    return main()


if __name__ == '__main__':
    sys.exit(_main())
