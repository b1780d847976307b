# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The catalogue of officials' corrections of laps and results. No correction reaches a kart.

This module is pure.
"""

from __future__ import annotations

from evgp_node.entries import Entry, OF_TIMEKEEPER
from evgp_node.results import Act

CORRECTIONS: dict[Act, Entry] = {
    Act.COUNT: Entry(
        'LAP',
        'record that an official saw this kart cross the timing line',
        f'{OF_TIMEKEEPER}kart/count_passing',
        to_one_kart=True,
        word='count-passing',
    ),
    Act.STRIKE: Entry(
        'STRIKE PASSING',
        'strike out a passing of the timing line, so that it does not count',
        f'{OF_TIMEKEEPER}set_passing_struck',
        fixed={'struck': True},
        takes=('source', 'session', 'number', 'reason', 'race'),
        word='strike-passing',
    ),
    Act.RESTORE: Entry(
        'RESTORE PASSING',
        'restore a passing that was struck out',
        f'{OF_TIMEKEEPER}set_passing_struck',
        fixed={'struck': False},
        takes=('source', 'session', 'number', 'reason', 'race'),
        word='restore-passing',
    ),
    Act.GIVE: Entry(
        'GIVE TRANSPONDER',
        'assign a transponder to this kart; its passings in this race then count for the kart',
        f'{OF_TIMEKEEPER}kart/give_transponder',
        to_one_kart=True,
        takes=('transponder',),
        word='give-transponder',
    ),
    Act.PENALISE: Entry(
        'PENALISE',
        'penalise a kart: add seconds, take laps away, or disqualify it',
        f'{OF_TIMEKEEPER}kart/penalise',
        to_one_kart=True,
        takes=('seconds', 'laps', 'disqualified', 'reason', 'race'),
    ),
    Act.UNDO_PENALTY: Entry(
        'UNDO PENALTY',
        'undo the last penalty of a kart',
        f'{OF_TIMEKEEPER}kart/undo_penalty',
        to_one_kart=True,
        takes=('race',),
    ),
    Act.CHOOSE: Entry(
        'COUNT THIS RACE',
        'make the results of this race the results of its heat',
        f'{OF_TIMEKEEPER}choose_race',
        takes=('race',),
        word='choose-race',
    ),
    Act.PUBLISH: Entry(
        'PUBLISH RESULTS',
        'publish the results of a race',
        f'{OF_TIMEKEEPER}publish_results',
        takes=('race',),
        word='publish-results',
    ),
}
"""Label, service and request fields of each correction."""
