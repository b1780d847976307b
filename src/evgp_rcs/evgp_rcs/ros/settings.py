# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The parameters of race control, each with its meaning, range and default."""

from __future__ import annotations

import pathlib
import secrets
from typing import Any

from evgp_node.parameters import check_address, ParameterError, StrictNode
from evgp_node.roster import load_roster
from evgp_rcs.karts.channel import Begin, ServerSettings
from evgp_rcs.record.store import default_path
from evgp_rcs.rules.race import Entrant, Heat, LEAST_PAUSE, RaceTimes, Roster

_SECONDS = (0.1, 3600)

OF_THE_KART_SERVER: tuple[tuple[Any, ...], ...] = (
    ('port', 'TCP port at which karts connect.', (1, 65535)),
    ('beat_rate', 'Frames per second to each kart, Hz (§4.C: 10, plus a reserve).', (11, 100)),
    (
        'send_timeout',
        'Time after which race control drops a kart that leaves bytes unanswered, s.',
        (0.2, 10),
    ),
)
"""Name, meaning and range of the kart server's parameters. `ServerSettings` has the defaults."""

OF_THE_RULES: tuple[tuple[Any, ...], ...] = (
    ('finish_stop', 'Time that a finished kart has to acknowledge its RED_FLAG, s.', _SECONDS),
    ('auto_race_over', 'Race control ends the race automatically once every kart has finished.'),
    ('ready_alert', 'Time until an alert if GRID_ACTIVE is not acknowledged, s.', _SECONDS),
    ('green_alert', 'Time until an alert if GREEN_GREEN is not acknowledged, s.', _SECONDS),
    ('flag_alert', 'Time until an alert if RED_FLAG is not acknowledged, s.', _SECONDS),
    ('red_alert', 'Time until an alert if RED_RED is not acknowledged, s.', _SECONDS),
    (
        'settle_time',
        'Time for which a kart must keep reporting its stop before humans may rely on it, s.',
        (0.5, 60),
    ),
    ('require_inspection', 'Karts without an inspection in the roster cannot race.'),
    (
        'nobody_there',
        'Time after a race has lost the last program that could stop it until race control sends '
        'RED_FLAG, s. With 0, it never does.',
        (0, 3600),
    ),
    (
        'pause',
        'Time after a stop during which race control refuses commands that lift a restriction or '
        'start anything, s.',
        (LEAST_PAUSE, 10),
    ),
)
"""Name, meaning and range of the rules' parameters. `RaceTimes` has the defaults."""


def read_roster(path: str) -> Roster:
    """
    Return the part of a roster file that the rules use.

    :raises RosterError: if the file cannot be read, or is not a valid roster.
    """
    roster = load_roster(pathlib.Path(path))
    return Roster(
        tuple(
            Entrant(each.number, each.team, each.in_race, each.inspected, each.address)
            for each in roster.entries
        ),
        tuple(Heat(heat.name, heat.karts) for heat in roster.heats),
    )


def read_settings(node: StrictNode) -> Begin:
    """
    Declare every parameter of race control, read the roster, and return what to start with.

    :raises ParameterError: if a parameter is wrong.
    :raises RosterError: if the roster is wrong.
    """
    declare = node.declare
    path = declare('roster', '', 'Path of the file that lists the karts, as in config/karts.yaml.')
    record = declare(
        'record',
        '',
        'Path of the record (SQLite). Empty means evgp_rcs/record.sqlite3 below ROS_HOME.',
    )
    address = declare(
        'address',
        ServerSettings.host,
        'IPv4 address at which karts connect. 0.0.0.0 means every address of this machine.',
    )
    server: dict[str, Any] = {
        name: declare(name, getattr(ServerSettings, name), *meaning_and_limits)
        for name, *meaning_and_limits in OF_THE_KART_SERVER
    }
    delays = declare(
        'finish_delays',
        list(RaceTimes.finish_delays),
        'Time from FINISH to RED_FLAG for place 1, 2, …, s, 0-60. The last value applies to all '
        'later places.',
    )
    rules: dict[str, Any] = {
        name: declare(name, getattr(RaceTimes, name), *meaning_and_limits)
        for name, *meaning_and_limits in OF_THE_RULES
    }
    node.refuse_unknown(own_file=True)
    check_address('address', address)
    for delay in delays:
        if not 0.0 <= delay <= 60.0:
            raise ParameterError(
                f'parameter finish_delays: {delay:g} is not possible. '
                'Give each place a delay from 0 to 60 s'
            )
    if not path:
        raise ParameterError(
            'parameter roster is missing. Name the file that lists the karts, '
            'as in: --ros-args -p roster:=config/karts.yaml'
        )
    return Begin(
        roster=read_roster(path),
        times=RaceTimes(finish_delays=tuple(delays), **rules),
        settings=ServerSettings(host=address, **server),
        record=pathlib.Path(record).expanduser() if record else default_path(),
        run=secrets.token_hex(8),
    )
