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

"""The parameters of race control: each declared once, with its meaning, range and default."""

from __future__ import annotations

import pathlib

from evgp_node.parameters import check_address, ParameterError, Parameters
from evgp_rcs.channel import Begin, ServerSettings
from evgp_rcs.race import RaceTimes
from evgp_rcs.record import default_path
from evgp_rcs.roster import load_roster


def read_settings(parameters: Parameters) -> Begin:
    """
    Declare every parameter of race control, read the roster, and return with what to start.

    :raises ParameterError: if a parameter is wrong.
    :raises RosterError: if the roster is.
    """
    declare = parameters.declare
    server, rules = ServerSettings(), RaceTimes()

    def seconds(name: str, default: float, meaning: str) -> float:
        return declare(name, default, f'{meaning}, s.', (0.1, 3600))

    path = declare('roster', '', 'The file that lists the karts, see config/karts.yaml.')
    record = declare(
        'record',
        '',
        'The file of the record (SQLite); empty: evgp_rcs/record.sqlite3 below ROS_HOME.',
    )
    settings = ServerSettings(
        host=declare(
            'address', server.host, 'The IPv4 address at which karts connect; 0.0.0.0: every one.'
        ),
        port=declare(
            'port', server.port, 'The TCP port at which karts connect; 0: any.', (0, 65535)
        ),
        beat_rate=declare(
            'beat_rate',
            server.beat_rate,
            'Frames per second to each kart, Hz (§4.C: at least 10).',
            (10, 100),
        ),
        send_timeout=declare(
            'send_timeout',
            server.send_timeout,
            'Time after which a kart that leaves bytes unanswered is lost, s.',
            (0.2, 10),
        ),
    )
    times = RaceTimes(
        finish_delays=tuple(
            declare(
                'finish_delays',
                list(rules.finish_delays),
                'From FINISH to RED_FLAG for place 1, 2, …; the last for all further, s, 0-60.',
            )
        ),
        finish_stop=seconds(
            'finish_stop',
            rules.finish_stop,
            'Time that a finished kart has to acknowledge its RED_FLAG',
        ),
        auto_race_over=declare(
            'auto_race_over',
            rules.auto_race_over,
            'Once every kart has finished, the race goes over by itself.',
        ),
        ready_alert=seconds(
            'ready_alert',
            rules.ready_alert,
            'Time until the alert that GRID_ACTIVE is not acknowledged',
        ),
        green_alert=seconds(
            'green_alert',
            rules.green_alert,
            'Time until the alert that GREEN_GREEN is not acknowledged',
        ),
        flag_alert=seconds(
            'flag_alert',
            rules.flag_alert,
            'Time until the alert that RED_FLAG is not acknowledged',
        ),
        red_alert=seconds(
            'red_alert',
            rules.red_alert,
            'Time until the alert that RED_RED is not acknowledged',
        ),
        settle=declare(
            'settle_time',
            rules.settle,
            'A kart that acknowledges a red must stand by it for this long before humans may rely '
            'on it, s.',
            (0.5, 60),
        ),
        require_inspection=declare(
            'require_inspection',
            rules.require_inspection,
            'A kart without an inspection in the roster cannot race.',
        ),
        pause=declare(
            'pause',
            rules.pause,
            'After a stop, commands that loosen or start anything are refused for this long, s.',
            (0.5, 10),
        ),
    )
    parameters.refuse_unknown()
    check_address('address', settings.host)
    for delay in times.finish_delays:
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
        roster=load_roster(pathlib.Path(path)),
        times=times,
        settings=settings,
        record=pathlib.Path(record).expanduser() if record else default_path(),
    )
