# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The timekeeper's corrections: what each is called, its service, and what its request names.

The node, `rcs_ctl` and the timekeeper's window go by these rows.

Pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from evgp_timing.desk import Act


@dataclass(frozen=True)
class Entry:
    """
    A row.

    :param label: what its button says; ``meaning``: what it does, in a few words.
    :param service: its name below the timekeeper's node; two may share one.
    :param kind: the type of the service, of ``evgp_rcs_msgs``.
    :param fixed: the fields of a request that make it this one, where two share a service.
    :param takes: the other fields of the request, besides `official`.
    """

    label: str
    meaning: str
    service: str
    kind: str
    takes: tuple[str, ...]
    fixed: Mapping[str, bool] = field(default_factory=dict)

    @property
    def service_type(self) -> str:
        """Return the ROS name of the type of its service."""
        return f'evgp_rcs_msgs/srv/{self.kind}'


_PASSING = ('race', 'source', 'session', 'number', 'reason')

CORRECTIONS: dict[Act, Entry] = {
    Act.COUNT: Entry(
        'COUNT PASSING',
        'an official saw this kart cross the timing line',
        'count_passing',
        'KartCommand',
        ('kart',),
    ),
    Act.STRIKE: Entry(
        'STRIKE PASSING',
        'strike a passing of the timing line out: it does not count',
        'set_passing_struck',
        'SetPassingStruck',
        _PASSING,
        {'struck': True},
    ),
    Act.RESTORE: Entry(
        'RESTORE PASSING',
        'put a passing back that was struck out',
        'set_passing_struck',
        'SetPassingStruck',
        _PASSING,
        {'struck': False},
    ),
    Act.GIVE: Entry(
        'GIVE TRANSPONDER',
        'a transponder is of this kart; its passings in this race count for it',
        'give_transponder',
        'KartGiveTransponder',
        ('kart', 'transponder'),
    ),
    Act.PENALISE: Entry(
        'PENALISE',
        'add seconds to the result of a kart, take laps away, or disqualify it',
        'penalise',
        'KartPenalise',
        ('kart', 'race', 'seconds', 'laps', 'disqualified', 'reason'),
    ),
    Act.UNDO_PENALTY: Entry(
        'UNDO PENALTY',
        'take the last penalty of a kart back',
        'undo_penalty',
        'KartUndoPenalty',
        ('kart', 'race'),
    ),
    Act.CHOOSE: Entry(
        'COUNT THIS RACE',
        'the results of this race are those of its heat',
        'choose_race',
        'ChooseRace',
        ('race',),
    ),
    Act.PUBLISH: Entry(
        'PUBLISH RESULTS',
        'publish the results of a race',
        'publish_results',
        'ChooseRace',
        ('race',),
    ),
}
"""Every correction."""
