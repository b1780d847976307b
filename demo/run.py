"""
Show two races: race control, karts with ROS and without, an official; see ``--help``.

    make demo
"""

import sys

from race_demo.main import main

if __name__ == '__main__':
    sys.exit(main())
