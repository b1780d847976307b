# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The roster file: what is read from it, and how each fault in it is told (§3.F, §4.A)."""

from __future__ import annotations

import io
import ipaddress
import json
import os
import pathlib
import re
import sys

from evgp_node.roster import (
    CUT,
    Heat,
    load_roster,
    MAX_BYTES,
    MAX_HEAT_LENGTH,
    MAX_NUMBER,
    MAX_TEAM_LENGTH,
    MOST_FAULTS,
    parse_roster,
    Roster,
    RosterEntry,
    RosterError,
)
from evgp_rcs.rcs_roster import main as rcs_roster
from hypothesis import example, given, settings
from hypothesis import strategies as st
import pytest
import yaml

SHIPPED = pathlib.Path(__file__).parents[1] / 'src' / 'evgp_rcs' / 'config' / 'karts.yaml'

TWO_KARTS = """\
karts:
  - number: 1
    team: Georgia Tech
    address: 10.0.0.1
    in_race: true
  - number: 2
    team: Purdue
    address: 10.0.0.2
    in_race: false
"""


def fault_of(text: str) -> str:
    """Return what the refusal of a roster says."""
    with pytest.raises(RosterError) as refusal:
        parse_roster(text, 'karts.yaml')
    return str(refusal.value)


ADDED = [
    ('port: 1\n', "10: the roster has the unknown field 'port'"),
    *(
        (f'    inspected: {each}\n', '10: kart 2: inspected ')
        for each in ('yes', '', '2026-02-31', '1.5.2026', '20260501', '[2026]')
    ),
    *(
        (f'    transponders: {each}\n', '10: kart 2: transponder')
        for each in ('4711', '[]', '[[1]]', '[""]', '{a: 1}', '["a\\tb"]')
    ),
    ('    transponders: []\n', '10: kart 2: transponders (nothing) is not a list'),
    ('    transponders: [4, 4]\n', '10: kart 2: transponder 4 is already in line 10'),
    ('heats:\n  A: [1, 7]\n', "11: heat 'A': kart 7 is not in the roster"),
    ('heats:\n  A: [1, 2, 1]\n', "11: heat 'A': kart 1 is already in line 11"),
    ('heats:\n  A: []\n', "11: heat 'A': karts (nothing) is not a list"),
    ('heats:\n  A: [1]\n  A: [2]\n', '12: heat A is already in line 11'),
    ('heats:\n  Heat 1: [1]\n  heat  1: [2]\n', '12: heat heat  1 is already in line 11'),
    ('heats:\n  A: 1\n', "11: heat 'A': karts 1 is not a list"),
    ('heats:\n  A: [one]\n', "11: heat 'A': kart one is not valid"),
    (f'heats:\n  {"x" * 33}: [1]\n', '11: heat xxx'),
    ('heats:\n  "a\\tb": [1]\n', "11: heat 'a\\tb' is not a name"),
    ('heats:\n  - A\n', "11: 'heats' is not a list of names"),
    ('heats:\n  {}\n', "11: 'heats' is empty"),
    ('    transponders:\n      - AB #1\n', f'11: {CUT}'),
    ('heats:\n  A: [1, 2]\n  B: {karts: [1], grid_from: A #1\n    }\n', f'12: {CUT}'),
    *(
        (f'heats:\n  A: {{karts: [1], grid_from: {each}}}\n  B: [1]\n', "11: heat 'A': grid_from")
        for each in ('A', 'C', '""', '[practice]', 'Practice')
    ),
    *(
        (f'heats:\n  A: {{{each}}}\n', "11: heat 'A'")
        for each in (
            *('laps: 5', 'karts: {1: 2}'),
            *(f'karts: [1], {one}' for one in ('format: x', 'laps: 0', 'laps: 1000', 'lap: 3')),
            'karts: [1], auto_finish: maybe',
        )
    ),
]
"""What is added to TWO_KARTS, and how its refusal begins."""

WRONG: list[tuple[str, str, str | list[str]]] = [
    ('number: 2', '6: kart 1: number 1 is already in line 2', 'number: 1'),
    (
        'number: 2',
        '6: kart entry 2: number ',
        [
            *(f'number: {each}' for each in ('0', '10000', '-1', '010', '1_0', '0x1', '1.0')),
            *(f'number: {each}' for each in ('1:30', "'2'", 'true', 'two', '', '~')),
            *(f'number: {each}' for each in ('2\u200b', 'x' * 200)),
        ],
    ),
    ('number: 2', '6: tags (!) ', ['number: !!int 2', 'number: ! 2', 'number: !!python/x:y 2']),
    (
        'team: Purdue',
        '7: kart 2: team ',
        [
            *(f'team: {each}' for each in ('', "''", "'  '", '~', '42', 'yes', '[]', 'x' * 65)),
            *('team: "a\\nb"', 'team: "\\ud800"'),
        ],
    ),
    (
        'address: 10.0.0.2',
        '8: kart 2: address ',
        [
            f'address: {each}'
            for each in (
                *('kart2.local', '10.0.0', '10.0.0.256', '10.0.0.2/24', '10.2', '10.0.0.2:1'),
                *('10.0.0.02', '010.0.0.2', '255.255.255.255', 'fe80::1', '"::1"', '', '~'),
                *('167772162', 'true', '[10.0.0.2]'),
            )
        ],
    ),
    *(
        ('address: 10.0.0.2', f'8: kart 2: address {said} address', f'address: {said.split()[0]}')
        for said in ('0.0.0.0 is an unspecified or broadcast', '224.0.0.1 is a multicast')
    ),
    (
        'address: 10.0.0.2',
        '8: kart 2: address 10.0.0.1 is already in line 4; give every kart its own address',
        'address: 10.0.0.1',
    ),
    (
        'in_race: false',
        '9: kart 2: in_race ',
        [f'in_race: {each}' for each in ('1', "'true'", 'maybe', '', '[true]')],
    ),
    ('    in_race', "5: kart 1 has the unknown field 'colour'", '    colour: red\n    in_race'),
    ('    address: 10.0.0.2\n', "6: kart 2 has no 'address'; add it", ''),
    ('team: Purdue', "8: kart 2 has 'team' already (line 7)", 'team: A\n    team: B'),
    # Slips of the keyboard.
    ('    team: Purdue', '7: has a tab character', '\tteam: Purdue'),
    ('team: Purdue', '7: ', 'team:\tPurdue: 1'),
    ('team: Purdue', "7: has no space after the colon; write 'team: Purdue'", 'team:Purdue'),
    ('in_race: false\n', '9: has no space after the colon', 'in_race:false\n'),
    ('- number: 2', '6: has no space after the colon', '- number:2'),
    ('    team: Purdue', "7: 'team' does not begin below 'number'", '   team: Purdue'),
    ('    address: 10.0.0.2', "8: 'address' does not begin below", '      address: 10.0.0.2'),
    ('  - number: 2', "6: begin the '-' of every kart in the same column", '   - number: 2'),
    ('team: Purdue', '7: has a second colon', 'team: Purdue: B'),
    # Comments that cut off a part of a name or a list.
    ('team: Purdue', f'7: {CUT}', ['team: Team #2', 'team: Purdue # our guests']),
    (
        'in_race: false',
        f'10: {CUT}',
        'in_race: false\n    transponders: [4711, # 4712,\n      4713]',
    ),
    *(('in_race: false\n', fault, f'in_race: false\n{added}') for added, fault in ADDED),
]
"""What is in TWO_KARTS, how its refusal begins, and what takes its place."""


RIGHT = [
    *(('number: 2', f'number: {number}', 'number', number) for number in (3, 9999)),
    *(
        ('team: Purdue', f"team: '{team}'", 'team', team)
        for team in ('42', '日本チーム', 'Gefährt', 'a: b')
    ),
    *(
        ('in_race: false', f'in_race: {word}', 'in_race', word == 'Yes')
        for word in ('false', 'False', 'no', 'off', 'Yes')
    ),
    # Comments that cut nothing off.
    ('team: Purdue', "team: 'Team #2'  # our guests", 'team', 'Team #2'),
    ('team: Purdue', 'team: Team#2', 'team', 'Team#2'),
    ('number: 2', 'number: 2  # as painted', 'number', 2),
    ('address: 10.0.0.2', 'address: 10.0.0.2 # WLAN', 'address', '10.0.0.2'),
    ('in_race: false', 'in_race: false # no\n    transponders: [4] # 1', 'transponders', ('4',)),
    ('in_race: false', 'in_race: false # no\n    # transponders: [4]', 'transponders', ()),
    # Such as begin another program's list.
    ('karts:', '# number, team, address, in_race\nkarts:', 'number', 2),
    ('karts:', '# 10.0.0.1: Team A\nkarts:', 'number', 2),
]
"""What is in TWO_KARTS, what takes its place, and what is then read of the second kart."""


@pytest.mark.parametrize(('old', 'new', 'field', 'value'), RIGHT)
def test_what_is_right_is_taken(old: str, new: str, field: str, value: object) -> None:
    _, entry = parse_roster(TWO_KARTS.replace(old, new, 1), 'karts.yaml').entries
    assert getattr(entry, field) == value


NO_LIST = [
    ('', ' is empty'),
    ('# nothing yet\n', ' is empty'),
    ('\nkarts: []\n', "2: 'karts' is empty"),
    ('{}\n', "1: the roster has no 'karts'"),
    ('- 1\n', '1: the roster has no fields'),
    ('karts: 3\n', "1: 'karts' is not a list"),
    ('karts:\n  - 3\n', '2: kart entry 1 has no fields'),
    (
        'karts:\n  - {team: A, address: 10.0.0.1}\n',
        "2: kart entry 1 has no 'number', 'in_race'; add them",
    ),
    ('karts:\n  - &one {}\n', '2: anchors (&, *)'),
    ('karts:\n  - *one\n', '2: anchors (&, *)'),
    ('karts:\n  - number: [1\n', '2: is not YAML ('),
    ('karts:\n  - team: a\x00b\n', '2: is not YAML (the character #x0000'),
    ('karts:\n  - "\\UFFFFFFFF"\n', ' is not YAML ('),
    ('karts:\n  - "\\U00110000"\n', ' is not YAML ('),
    (TWO_KARTS + '---\n' + TWO_KARTS, '10: is not YAML ('),
    ('[' * 100_000, ' is nested too deep'),
    # What is shown cannot be printed.
    (
        'karts:1\ufeff: "\n  team: A\n',
        r"""1: has no space after the colon; write 'karts: 1\ufeff: "'""",
    ),
    # Of a kart whose number cannot be read, a heat may be.
    (
        TWO_KARTS.replace('number: 2', 'number: two') + 'heats:\n  A: [1, 2]\n',
        '6: kart entry 2: number two is not valid',
    ),
]
"""Files, and how their refusals begin."""


@pytest.mark.parametrize(
    ('text', 'fault'),
    [
        *NO_LIST,
        *(
            (TWO_KARTS.replace(old, new, 1), fault)
            for old, fault, wrong in WRONG
            for new in ([wrong] if isinstance(wrong, str) else wrong)
        ),
    ],
)
def test_what_is_wrong_is_refused_with_its_line(text: str, fault: str) -> None:
    assert text != TWO_KARTS
    told = fault_of(text)
    assert told.startswith(f'karts.yaml:{fault}')
    assert told.isprintable()  # in one line
    assert len(told) < 200


OLD_SOFTWARE = '10.0.0.101: Team A\n10.0.0.102: Team B\n10.0.0.103: Team C\n'
ENTRY_LIST = """\
No,Class,FirstName,LastName,CarRegistration,DriverRegistration,Transponder1,Transponder2
7,Autonomous,Team,A,"","",5691251,""
12,Autonomous,Team,B,"","",FL-94890,""
"""


@pytest.mark.parametrize(
    ('text', 'missing', 'entries'),
    [
        (
            OLD_SOFTWARE,
            'number',
            [RosterEntry(at, f'Team {"ABC"[at - 1]}', f'10.0.0.10{at}', True) for at in (1, 2, 3)],
        ),
        (
            ENTRY_LIST,
            'address',
            [
                RosterEntry(7, 'Team A', '10.0.0.1', True, '', ('5691251',)),
                RosterEntry(12, 'Team B', '10.0.0.2', True, '', ('FL-94890',)),
            ],
        ),
        (
            '\ufeffStart number;Team name;Transponder\r\n1;"Team ""A"" #1";\r\n',
            'address',
            [RosterEntry(1, 'Team "A" #1', '10.0.0.1', True)],
        ),
        (
            'Kart\tTeam\n3\tÉcole\n\n',
            'address',
            [RosterEntry(3, 'École', '10.0.0.1', True)],
        ),
        (
            'sep=;\r\nStart No.;Team\r\n1;A\r\n;\r\n;\r\n',
            'address',
            [RosterEntry(1, 'A', '10.0.0.1', True)],
        ),
        (
            'No,Team\n1,"Quick\n2,B\n3,"C"\n',
            'address',
            [
                RosterEntry(number, team, f'10.0.0.{number}', True)
                for number, team in enumerate(('Quick', 'B', 'C'), start=1)
            ],
        ),
    ],
)
def test_a_foreign_list_is_shown_as_a_roster_that_lacks_only_what_the_list_does_not_say(
    text: str,
    missing: str,
    entries: list[RosterEntry],
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / 'list.csv'
    path.write_text(text, encoding='utf-8', newline='')
    assert rcs_roster(['check', str(path)]) == 2
    shown = capsys.readouterr()
    assert f'fill in each {missing}' in shown.err
    assert f'roster ROSTER={path} > new.yaml' in shown.err
    assert len(shown.err.splitlines()) == 1
    assert {f'{missing} (nothing)' in line for line in fault_of(shown.out).split('\n')} == {True}
    values = iter(str(getattr(each, missing)) for each in entries)
    filled = re.sub(f'(?m)(?<= {missing}:)$', lambda _: f' {next(values)}', shown.out)
    assert list(parse_roster(filled, 'karts.yaml').entries) == entries


def test_more_karts_than_race_control_is_built_for_are_refused_in_one_sentence() -> None:
    def of(karts: int) -> str:
        return 'karts:\n' + ''.join(
            f'- {{number: {each}, team: A, address: 10.0.0.{each}, in_race: false}}\n'
            for each in range(1, karts + 1)
        )

    assert len(parse_roster(of(200), 'karts.yaml').entries) == 200
    assert fault_of(of(201)) == (
        'karts.yaml:2: lists 201 karts; list 200 at most, and keep the others in a roster of '
        'their own'
    )


@pytest.mark.parametrize(
    ('name', 'content', 'said'),
    [
        *(
            (name, None, r': cannot be read \(.*\); name a readable file')
            for name in ('absent.yaml', '.', 'null\0byte', 'pipe')
        ),
        ('karts.yaml', b'#' * (MAX_BYTES + 1), ': is larger than 200,000 bytes; give the .*'),
        (
            'karts.yaml',
            TWO_KARTS.replace('Purdue', 'Gefährt').encode('latin-1'),
            r':7: is not UTF-8 text \(byte 0xe4\); save the file as UTF-8',
        ),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_by_its_name(
    name: str, content: bytes | None, said: str, tmp_path: pathlib.Path
) -> None:
    os.mkfifo(tmp_path / 'pipe')  # which nobody writes to
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RosterError) as refusal:
        load_roster(tmp_path / name)
    assert re.fullmatch(re.escape(str(tmp_path / name)) + said, str(refusal.value))


@pytest.mark.parametrize('end', ['\n', '\r\n'])
@pytest.mark.parametrize('mark', ['', '\ufeff'])
def test_a_file_of_any_editor_is_read(tmp_path: pathlib.Path, end: str, mark: str) -> None:
    path = tmp_path / 'karts.yaml'
    path.write_bytes((mark + TWO_KARTS).replace('\n', end).encode())
    assert load_roster(path) == Roster(
        (
            RosterEntry(1, 'Georgia Tech', '10.0.0.1', True),
            RosterEntry(2, 'Purdue', '10.0.0.2', False),
        )
    )


# ----- every fault at once -----------------------------------------------------------------


def test_every_fault_is_told_at_once_in_the_order_of_the_file() -> None:
    text = """\
karts:
  - number: 0
    team: ''
    address: 10.0.0.1
    in_race: maybe
  - number: 2
    name: Purdue
    address: 10.0.0.1
    in_race: true
  - 3
  - number: 2
    team: Ohm
    address: 127.0.2.004
    in_race: true
port: 1
heats:
  A: []
"""
    lines = [line.split(' ', 1)[0] for line in fault_of(text).split('\n')]
    assert lines == [f'karts.yaml:{line}:' for line in (2, 3, 5, 6, 7, 8, 10, 11, 13, 15, 17)]


def test_a_file_with_more_faults_than_anybody_reads_is_told_with_their_number() -> None:
    lines = fault_of('karts:\n' + '  - 1\n' * 150).split('\n')
    assert len(lines) == 101
    assert lines[-1] == 'karts.yaml: 50 more faults'


# ----- heats -------------------------------------------------------------------------------


def test_heats_are_read_in_the_order_of_the_file_with_their_karts_ascending() -> None:
    text = TWO_KARTS + 'heats:\n  Heat 2: [2, 1]\n  1: [1]\n  "yes":\n    - 2\n'
    assert parse_roster(text, 'karts.yaml').heats == (
        Heat('Heat 2', (1, 2)),
        Heat('1', (1,)),
        Heat('yes', (2,)),
    )


def test_a_comment_that_cuts_the_name_of_a_heat_is_told_before_what_follows_from_it() -> None:
    told = fault_of(TWO_KARTS + 'heats:\n  Heat #1: [1]\n').split('\n')
    assert told[0] == f'karts.yaml:11: {CUT}'


def test_the_heats_shown_in_the_shipped_roster_are_right_when_they_are_taken_in() -> None:
    text = re.sub('(?m)^# (?=heats:|  Heat|  Final)', '', SHIPPED.read_text(encoding='utf-8'))
    assert len(parse_roster(text, 'karts.yaml').heats) > 1


# ----- rcs_roster ---------------------------------------------------------------------------


def test_a_right_roster_is_shown_with_its_karts_and_heats(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'karts.yaml'
    text = TWO_KARTS.replace('Purdue', 'Zürich')
    text += "    inspected: '2026-05-01'\n    transponders: [4711, '08', FL-9]\n"
    heat = 'karts: [2, 1], format: time_trial, laps: 6, grid_from: practice'
    path.write_text(f'{text}heats:\n  Final: {{{heat}}}\n', encoding='utf-8')
    assert isinstance(sys.stdout, io.TextIOWrapper)
    sys.stdout.reconfigure(encoding='ascii')  # as of a terminal with few characters
    assert rcs_roster(['check', str(path)]) == 0
    out = capsys.readouterr().out.splitlines()
    assert [' '.join(line.split()) for line in out[1:]] == [
        'kart 1 Georgia Tech 10.0.0.1 in the first race',
        'kart 2 Z?rich 10.0.0.2 not in the first race, inspected 2026-05-01, '
        'transponders 4711, 08, FL-9',
        'heat "Final": 1, 2 (time_trial, 6 laps, grid from practice)',
    ]


# ----- any text -------------------------------------------------------------------------------

TELLING = (
    *('karts:', '- number: ', '  team: ', '  address: ', '  in_race: ', 'heats:', '  A: [1]'),
    *('true', 'false', 'yes', 'off', '10.0.0.1', '255.255.255.255', '224.0.0.1', '0x1', '010'),
    *('1:30', '~', 'null', '&a', '*a', '!!', '!!python/object:', '<<: ', '%YAML 1.1', '%TAG ! '),
    *('---', '...', '? ', '|', '>', '"', "'", '\\x', '\\U', '{', '}', '[', ']', ', ', ': ', '#'),
    *('\ufeff', '\x85', '\u2028', '\u202e', '\r\n', '\t', '\n', '\n  '),
)
HEATS = """\
karts:
  - {number: 1, team: Ohm, address: 10.0.0.1, in_race: true}
  - {number: 2, team: Volta, address: 10.0.0.2, in_race: true, transponders: [4, x]}
heats:
  Heat 1: [2, 1]
  2: {karts: [1], format: race, laps: 3, auto_finish: true, grid_from: Heat 1}
"""
edits = st.lists(
    st.tuples(
        st.integers(0, len(HEATS)),
        st.sampled_from([0, 0, 1, 1, 2, 5, 20, 100]),
        st.sampled_from(TELLING) | st.text(max_size=5) | st.integers(0, 10**5).map(str),
    ),
    max_size=6,
)


@settings(max_examples=300)
@given(st.sampled_from([TWO_KARTS, HEATS, SHIPPED.read_text(encoding='utf-8')]), edits)
@example(HEATS, [])
@example('%YAML 99999999999999999999.1\n---\nkarts: []\n', [])
@example(TWO_KARTS.replace('Purdue', '>\n      Two\n      lines'), [])
def test_any_text_is_a_roster_that_other_readers_read_alike_or_is_refused_in_few_short_lines(
    text: str, edits: list[tuple[int, int, str]]
) -> None:
    for at, length, new in edits:
        end = at + length
        text = text[:at] + new + text[end:]
    try:
        roster = parse_roster(text, 'roster')
    except RosterError as error:
        # YAML ends a line at any of these; a fault may be reported after the last one.
        lines = len(re.split('\r\n|[\r\n\x85\u2028\u2029]', text))
        told = str(error).split('\n')
        assert len(told) <= MOST_FAULTS + 1
        for each in told:
            found = re.match(r'roster(?::([1-9]\d*))?: ', each)
            assert found, each
            assert int(found[1] or 0) <= lines + 1, each
            assert each.isprintable(), each
            assert len(each) < 1000, each
        return
    karts = yaml.safe_load(text)['karts']
    assert [(each.number, each.team, each.address, each.in_race) for each in roster.entries] == [
        (each['number'], each['team'].strip(), each['address'], each['in_race']) for each in karts
    ]
    numbers = {each.number for each in roster.entries}
    assert len(numbers) == len({each.address for each in roster.entries}) == len(karts) > 0
    for entry in roster.entries:
        assert type(entry.number) is int
        assert 1 <= entry.number <= MAX_NUMBER
        assert 1 <= len(entry.team) <= MAX_TEAM_LENGTH
        assert entry.team.isprintable()
        assert type(entry.in_race) is bool
        address = ipaddress.IPv4Address(entry.address)
        assert str(address) == entry.address
        assert not any((address.is_multicast, address.is_reserved, address.packed[0] == 0))
    assert len({heat.name for heat in roster.heats}) == len(roster.heats)
    for heat in roster.heats:
        assert list(heat.karts) == sorted({*heat.karts} & numbers) != []
        assert heat.name.isprintable()
        assert 1 <= len(heat.name.strip()) == len(heat.name) <= MAX_HEAT_LENGTH
    again: dict[str, object] = {'karts': [*map(given_of, roster.entries)]}
    if roster.heats:
        again['heats'] = {each.name: given_of(each) for each in roster.heats}
    # YAML as well
    assert parse_roster(json.dumps(again, default=lambda each: each.value), 'roster') == roster


def given_of(part: RosterEntry | Heat) -> dict[str, object]:
    """Return the fields of a part of a roster that do not have their default; a heat's no name."""
    return {
        name: value
        for name, value in vars(part).items()
        if name != 'name' and value != getattr(type(part), name, None)
    }
