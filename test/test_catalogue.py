# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Whatever names officials' commands has just those of the catalogue."""

from __future__ import annotations

import pathlib
import re
from typing import Any, get_type_hints

from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind, Entry, kinds_by_service, Result
from evgp_rcs.rules.race import Command, COMMANDS
from evgp_rcs_msgs import srv
import pytest
import race_oracle

DOCS = pathlib.Path(__file__).parents[1] / 'docs'


def fields_of(entry: Entry) -> dict[str, str]:
    """Return the fields of the request of a command, with their types, as the catalogue has it."""
    fields = {'official': 'string', **dict.fromkeys(entry.fixed, 'boolean')}
    if entry.to_one_kart:
        fields['kart'] = 'uint16'
    if entry.statement:
        fields[entry.statement] = 'boolean'
    if entry.service_type in ('RaceCommand', 'KartCommand'):
        fields['age'] = 'double'  # the types of all stops; what is no stop does not use it
    # Under the same names, and of the same types, as the rules have them.
    of_command: dict[Any, str] = {
        str: 'string',
        int: 'uint32',
        frozenset[int]: 'sequence<uint16>',
        RaceState | None: 'evgp_rcs_msgs/RaceState',
    }
    hints = get_type_hints(Command)
    fields |= {name: of_command[hints[name]] for name in entry.takes}
    if 'attempt' in entry.takes:
        fields['attempt'] = 'uint16'  # as `KartStatus` has it
    return fields


def table_rows(page: str, section: str) -> list[list[str]]:
    """Return the rows of the tables of a section of a page of docs/, cell by cell."""
    text = (DOCS / page).read_text(encoding='utf-8')
    level = section.split(' ')[0]
    _, _, rest = text.partition(f'\n{section}\n')
    lines = re.split(rf'\n#{{2,{len(level)}}} ', rest)[0].splitlines()
    return [line.strip('|').split('|') for line in lines if line.startswith('| ')]


def test_every_command_has_a_row_here_and_one_in_the_rules() -> None:
    assert set(CATALOGUE) == set(COMMANDS) == set(CommandKind)


@pytest.mark.parametrize('name', kinds_by_service())
def test_a_request_has_the_fields_of_its_commands_and_one_that_tells_two_apart(name: str) -> None:
    entries = [CATALOGUE[kind] for kind in kinds_by_service()[name]]
    ((service_type, *_),) = {(each.service_type, each.overtakes, *each.fixed) for each in entries}
    fields = {field: of for entry in entries for field, of in fields_of(entry).items()}

    request = getattr(srv, service_type).Request

    assert request.get_fields_and_field_types() == fields
    values = [[*entry.fixed.values()] for entry in entries]
    assert values == ([[]] if len(entries) == 1 else [[True], [False]])


def test_what_overtakes_is_what_stops_and_none_of_it_loosens() -> None:
    overtaking = {kind.name for kind, entry in CATALOGUE.items() if entry.overtakes}
    assert overtaking == {*race_oracle.STOPS, 'RACE_OVER'}
    for entry in CATALOGUE.values():
        assert not (entry.overtakes and entry.loosens)


def test_what_takes_a_command_back_can_have_its_button() -> None:
    for entry in CATALOGUE.values():
        if entry.undoes is not None:
            undone = CATALOGUE[entry.undoes]
            assert entry.to_one_kart == undone.to_one_kart
            assert undone.result != Result()


def test_the_oracle_knows_every_command_and_calls_it_what_the_catalogue_does() -> None:
    assert set(race_oracle.STOPS) == {k.name for k, entry in CATALOGUE.items() if entry.stop}
    assert set(race_oracle.LOOSENING) == {k.name for k, each in CATALOGUE.items() if each.loosens}
    assert set(race_oracle.NAMING) == {
        k.name for k, each in CATALOGUE.items() if 'karts' in each.takes
    }
    bookkeeping = {k.name for k, entry in CATALOGUE.items() if entry.bookkeeping}
    assert set(race_oracle.NO_BUTTON) == bookkeeping


def test_the_rules_name_the_service_of_every_command() -> None:
    rows = table_rows('rules.md', '## Commands (§4.B)')
    named = {name for row in rows for name in re.findall(r'`(\S+)`', row[1])}

    assert {entry.service for entry in CATALOGUE.values()} <= named
