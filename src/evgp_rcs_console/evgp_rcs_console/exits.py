"""How `rcs_ctl` ends."""

import enum


class Exit(enum.IntEnum):
    """The exit codes, for scripts."""

    ACCEPTED = 0
    REFUSED = 1
    USAGE = 2
    NOT_THERE = 3
