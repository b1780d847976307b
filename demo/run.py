"""
Show two races: race control, karts with ROS and without, an official; see ``--help``.

    make demo
"""

import pathlib
import sys


def _main() -> int:
    # The parts of a race live with the tests; they can be imported only from here on.
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / 'test'))
    from race_demo.main import main

    return main()


if __name__ == '__main__':
    sys.exit(_main())
