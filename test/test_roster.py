# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The roster file: what is read from it, and how each fault in it is told (§3.F, §4.A)."""

from __future__ import annotations

import pathlib
import re

from evgp_node.roster import (
    Format,
    Heat,
    load_roster,
    MAX_BYTES,
    parse_roster,
    Roster,
    RosterEntry,
    RosterError,
)
from evgp_rcs.files.roster_check import main as check_roster
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

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


def fault_of_two_karts_with(old: str, new: str) -> str:
    """Return what the refusal says of TWO_KARTS with one thing changed."""
    assert old in TWO_KARTS
    return fault_of(TWO_KARTS.replace(old, new, 1))


def test_a_right_roster_gives_its_karts_in_the_order_of_the_file() -> None:
    assert parse_roster(TWO_KARTS, 'karts.yaml') == Roster(
        (
            RosterEntry(1, 'Georgia Tech', '10.0.0.1', True),
            RosterEntry(2, 'Purdue', '10.0.0.2', False),
        )
    )


def test_the_refusal_of_a_double_address_is_one_sentence_an_official_can_act_on() -> None:
    assert fault_of_two_karts_with('10.0.0.2', '10.0.0.1') == (
        "karts.yaml:8: kart 2: address 10.0.0.1 is already kart 1's (line 4); "
        'give every kart its own address'
    )


def test_the_refusal_of_a_double_number_names_both_lines() -> None:
    assert fault_of_two_karts_with('number: 2', 'number: 1') == (
        'karts.yaml:6: kart 1: number 1 is already taken (line 2); give every kart its own number'
    )


WRONG_FIELDS = {
    'number: 2': (
        '6: kart entry 2: number ',
        [*('0', '10000', '-1', '010', '1_0', '0x1', '1.0', '1:30'), "'2'", 'true', 'two', '', '~'],
    ),
    'team: Purdue': (
        '7: kart 2: team ',
        ['', "''", "'  '", '~', '42', 'yes', '[]', '"a\\nb"', '"\\ud800"', 'x' * 65],
    ),
    'address: 10.0.0.2': (
        '8: kart 2: address ',
        [
            *('kart2.local', '10.0.0', '10.0.0.256', '10.0.0.2/24', '10.2', '10.0.0.2:1', '"::1"'),
            *('10.0.0.02', '010.0.0.2', '0.0.0.0', '255.255.255.255', '224.0.0.1', 'fe80::1'),
            *('', '~', '167772162', 'true', '[10.0.0.2]'),
        ],
    ),
    'in_race: false': ('9: kart 2: in_race ', ['1', "'true'", 'maybe', '', '[true]']),
}


@pytest.mark.parametrize(
    ('field', 'fault', 'word'),
    [(field, fault, word) for field, (fault, words) in WRONG_FIELDS.items() for word in words],
)
def test_a_field_that_is_wrong_is_refused_with_its_line(field: str, fault: str, word: str) -> None:
    name, _, _ = field.partition(' ')
    told = fault_of_two_karts_with(field, f'{name} {word}')
    assert told.startswith(f'karts.yaml:{fault}')
    assert '\n' not in told


@pytest.mark.parametrize('number', [1, 9999])
def test_a_number_at_the_end_of_the_range_is_taken(number: int) -> None:
    text = TWO_KARTS.replace('number: 2', 'number: 2').replace('number: 1', f'number: {number}')
    assert parse_roster(text, 'karts.yaml').entries[0].number == number


@pytest.mark.parametrize('team', ["'42'", '日本チーム', 'Gefährt', 'a: b'])
def test_a_team_may_be_any_printable_name(team: str) -> None:
    text = TWO_KARTS.replace('team: Purdue', f"team: '{team.strip(chr(39))}'")
    assert parse_roster(text, 'karts.yaml').entries[1].team == team.strip("'")


@pytest.mark.parametrize('word', ['false', 'False', 'no', 'off'])
def test_every_way_to_say_false_in_yaml_keeps_a_kart_out_of_the_race(word: str) -> None:
    text = TWO_KARTS.replace('in_race: true', f'in_race: {word}')
    assert parse_roster(text, 'karts.yaml').entries[0].in_race is False


def test_an_unknown_field_is_refused_with_those_there_are() -> None:
    assert fault_of_two_karts_with('    in_race', '    colour: red\n    in_race') == (
        "karts.yaml:5: kart 1 has the unknown field 'colour'; "
        "it has 'number', 'team', 'address', 'in_race', 'inspected', 'transponders'"
    )


def test_a_missing_field_is_refused_at_the_kart_that_lacks_it() -> None:
    assert fault_of_two_karts_with('    address: 10.0.0.2\n', '') == (
        "karts.yaml:6: kart 2 has no 'address'; add it"
    )
    assert fault_of('karts:\n  - {team: A, address: 10.0.0.1}\n') == (
        "karts.yaml:2: kart entry 1 has no 'number', 'in_race'; add them"
    )


def test_a_field_given_twice_is_refused() -> None:
    assert fault_of_two_karts_with('    team: Purdue\n', '    team: A\n    team: B\n') == (
        "karts.yaml:8: kart 2 has 'team' already (line 7); give it once"
    )


def test_an_unknown_field_of_the_file_is_refused() -> None:
    assert fault_of(TWO_KARTS + 'port: 12017\n') == (
        "karts.yaml:10: the roster has the unknown field 'port'; it has 'karts', 'heats'"
    )


@pytest.mark.parametrize(
    ('text', 'fault'),
    [
        ('', "karts.yaml: is empty; list the karts under 'karts:'"),
        ('# nothing yet\n', "karts.yaml: is empty; list the karts under 'karts:'"),
        ('\nkarts: []\n', "karts.yaml:2: 'karts' is empty; list at least one kart"),
        ('{}\n', "karts.yaml:1: the roster has no 'karts'; add it"),
        ('- 1\n', "karts.yaml:1: the roster has no fields; give it 'karts'"),
        (
            'karts: 3\n',
            "karts.yaml:1: 'karts' is not a list; begin each kart with '- number: ...'",
        ),
        (
            'karts:\n  - 3\n',
            'karts.yaml:2: kart entry 1 has no fields; '
            "give it 'number', 'team', 'address', 'in_race'",
        ),
    ],
)
def test_a_file_that_is_no_list_of_karts_is_refused(text: str, fault: str) -> None:
    assert fault_of(text) == fault


@pytest.mark.parametrize(
    ('text', 'beginning'),
    [
        ('karts:\n  - number: [1\n', 'karts.yaml:2: is not YAML ('),
        ('karts:\n  - team: a\x00b\n', 'karts.yaml:2: is not YAML (the character #x0000'),
        ('karts:\n  - "\\UFFFFFFFF"\n', 'karts.yaml: is not YAML ('),
        (TWO_KARTS + '---\n' + TWO_KARTS, 'karts.yaml:10: is not YAML ('),
    ],
)
def test_what_is_not_yaml_is_refused(text: str, beginning: str) -> None:
    assert fault_of(text).startswith(beginning)


@pytest.mark.parametrize(
    ('old', 'new', 'fault'),
    [
        ('    team: Purdue', '\tteam: Purdue', '7: has a tab character'),
        ('team: Purdue', 'team:\tPurdue: 1', '7: '),
        ('team: Purdue', 'team:Purdue', "7: has no space after the colon; write 'team: Purdue'"),
        ('in_race: false\n', 'in_race:false\n', '9: has no space after the colon'),
        ('- number: 2', '- number:2', '6: has no space after the colon'),
        ('    team: Purdue', '   team: Purdue', "7: 'team' does not begin below 'number'"),
        ('    address: 10.0.0.2', '      address: 10.0.0.2', "8: 'address' does not begin below"),
        ('  - number: 2', '   - number: 2', "6: begin the '-' of every kart in the same column"),
        ('team: Purdue', 'team: Purdue: B', '7: has a second colon'),
    ],
)
def test_a_slip_of_the_keyboard_is_refused_with_what_to_do(old: str, new: str, fault: str) -> None:
    assert fault_of_two_karts_with(old, new).startswith(f'karts.yaml:{fault}')


CUT = "' #' begins a comment and cuts off the rest; "


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('team: Purdue', 'team: Team #2'),
        ('team: Purdue', 'team: Purdue # our guests'),
        ('in_race: false', 'in_race: false\n    transponders: [4711, # 4712,\n      4713]'),
        ('in_race: false', 'in_race: false\n    transponders:\n      - AB #1'),
        (
            'in_race: false',
            'in_race: false\nheats:\n  A: [1, 2]\n  B: {karts: [1], grid_from: A #1\n    }',
        ),
    ],
)
def test_a_comment_that_cuts_a_name_or_a_list_is_refused_with_its_line(old: str, new: str) -> None:
    text = TWO_KARTS.replace(old, new, 1)
    line = 1 + text.count('\n', 0, text.index(' #'))
    assert fault_of(text).startswith(f'karts.yaml:{line}: {CUT}')
    assert '\n' not in fault_of(text)


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('team: Purdue', "team: 'Team #2'  # our guests"),
        ('team: Purdue', 'team: Team#2'),
        ('number: 2', 'number: 2  # as painted'),
        ('address: 10.0.0.2', 'address: 10.0.0.2 # WLAN'),
        ('in_race: false', 'in_race: false # not yet\n    transponders: [4711] # one'),
        ('in_race: false', 'in_race: false # not yet\n    # transponders: [4711]'),
    ],
)
def test_a_comment_that_cuts_nothing_is_one(old: str, new: str) -> None:
    assert len(parse_roster(TWO_KARTS.replace(old, new, 1), 'karts.yaml').entries) == 2


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
    assert check_roster(['check', str(path)]) == 2
    shown = capsys.readouterr()
    assert f'fill in each {missing}' in shown.err
    assert len(shown.err.splitlines()) == 1
    assert {f'{missing} (nothing)' in line for line in fault_of(shown.out).split('\n')} == {True}
    values = iter(str(getattr(each, missing)) for each in entries)
    filled = re.sub(f'(?m)(?<= {missing}:)$', lambda _: f' {next(values)}', shown.out)
    assert list(parse_roster(filled, 'karts.yaml').entries) == entries


@pytest.mark.parametrize('comment', ['# number, team, address, in_race', '# 10.0.0.1: Team A'])
def test_a_comment_makes_no_foreign_list_of_a_roster(comment: str) -> None:
    assert len(parse_roster(f'{comment}\n{TWO_KARTS}', 'karts.yaml').entries) == 2


def test_a_race_control_that_is_given_a_foreign_list_says_what_makes_a_roster_of_it() -> None:
    for text in (OLD_SOFTWARE, ENTRY_LIST):
        assert fault_of(text).startswith('karts.yaml: is a list of another program, ')
        assert 'roster ROSTER=karts.yaml > new.yaml' in fault_of(text)


def test_a_hint_shows_what_cannot_be_printed_as_python_writes_it() -> None:
    assert fault_of('karts:1\ufeff: "\n  team: A\n').endswith(r"""write 'karts: 1\ufeff: "'""")


@pytest.mark.parametrize('text', ['karts:\n  - &one {}\n', 'karts:\n  - *one\n'])
def test_anchors_and_aliases_are_refused(text: str) -> None:
    assert fault_of(text) == 'karts.yaml:2: anchors (&, *) are not used here; write it out'


@pytest.mark.parametrize('tag', ['!!int', '!', '!!python/object/apply:os.getcwd'])
def test_tags_are_refused(tag: str) -> None:
    fault = fault_of_two_karts_with('number: 2', f'number: {tag} 2')
    assert fault == 'karts.yaml:6: tags (!) are not used here; leave it out'


def test_a_deep_nest_is_refused_without_being_followed() -> None:
    assert fault_of('[' * 100_000).startswith('karts.yaml:1: is nested too deep')


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


def test_what_is_too_large_for_a_roster_is_refused_unread(tmp_path: pathlib.Path) -> None:
    path = tmp_path / 'karts.yaml'
    path.write_bytes(b'#' * (MAX_BYTES + 1))
    with pytest.raises(RosterError, match='is larger than'):
        load_roster(path)
    assert fault_of('#' * (MAX_BYTES + 1)).startswith('karts.yaml: is larger than')


@pytest.mark.parametrize('name', ['absent.yaml', '.', 'null\0byte'])
def test_a_file_that_cannot_be_read_is_refused_by_its_name(
    tmp_path: pathlib.Path, name: str
) -> None:
    with pytest.raises(RosterError, match=r'name a readable file$') as refusal:
        load_roster(tmp_path / name)
    assert str(refusal.value).startswith(f'{tmp_path / name}: ')


def test_a_file_that_is_not_utf_8_is_refused_with_the_line(tmp_path: pathlib.Path) -> None:
    path = tmp_path / 'karts.yaml'
    path.write_bytes(TWO_KARTS.replace('Purdue', 'Gefährt').encode('latin-1'))
    with pytest.raises(RosterError) as refusal:
        load_roster(path)
    assert str(refusal.value) == (
        f'{path}:7: is not UTF-8 text (byte 0xe4); save the file as UTF-8'
    )


@pytest.mark.parametrize('end', ['\n', '\r\n'])
@pytest.mark.parametrize('mark', ['', '\ufeff'])
def test_a_file_of_any_editor_is_read(tmp_path: pathlib.Path, end: str, mark: str) -> None:
    path = tmp_path / 'karts.yaml'
    path.write_bytes((mark + TWO_KARTS).replace('\n', end).encode())
    assert load_roster(path) == parse_roster(TWO_KARTS, 'karts.yaml')


def refusal_of_anything(text: str) -> str:
    """Parse a text that may be anything; return what the refusal says, '' if there is none."""
    try:
        assert parse_roster(text, 'karts.yaml').entries
    except RosterError as error:
        return str(error)
    return ''


ONE_LINE = re.compile(r'(karts\.yaml(:\d+)?: .+)?')

TEXTS_YAML_GIVES_A_MEANING_TO = st.text(
    alphabet='kartsnumbe: -[]{}&*!|>%@`"\'\\\n\t#~?,<=.0123456789xUu'
)

ROSTERS_WITH_A_STRETCH_REPLACED = st.builds(
    lambda at, new, end: TWO_KARTS[:at] + new + TWO_KARTS[end:],
    st.integers(0, len(TWO_KARTS)),
    st.one_of(
        st.text(max_size=5),
        st.sampled_from(
            ['\n', '    team: ', '  - number: ', 'karts:', '&a', '*a', '!!int ', '"\\u', '? ']
        ),
    ),
    st.integers(0, len(TWO_KARTS)),
)


@settings(deadline=None)
@given(st.one_of(st.text(), TEXTS_YAML_GIVES_A_MEANING_TO, ROSTERS_WITH_A_STRETCH_REPLACED))
def test_any_text_is_a_roster_or_refused_in_lines_that_name_the_file(text: str) -> None:
    for line in refusal_of_anything(text).split('\n'):
        assert ONE_LINE.fullmatch(line)


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


def fault_of_heats(heats: str) -> str:
    """Return what the refusal says of TWO_KARTS with these heats, which begin in line 11."""
    return fault_of(f'{TWO_KARTS}heats:\n{heats}')


def test_heats_are_read_in_the_order_of_the_file_with_their_karts_ascending() -> None:
    text = TWO_KARTS + 'heats:\n  Heat 2: [2, 1]\n  1: [1]\n  "yes":\n    - 2\n'
    assert parse_roster(text, 'karts.yaml').heats == (
        Heat('Heat 2', (1, 2)),
        Heat('1', (1,)),
        Heat('yes', (2,)),
    )


@pytest.mark.parametrize(
    ('heats', 'fault'),
    [
        ('  A: [1, 7]\n', "11: heat 'A': the roster has no kart 7"),
        ('  A: [1, 2, 1]\n', "11: heat 'A' has kart 1 already"),
        ('  A: []\n', "11: heat 'A' is empty"),
        ('  A: [1]\n  A: [2]\n', "12: heat 'A' is already there (line 11)"),
        ('  Heat 1: [1]\n  heat  1: [2]\n', "12: heat 'heat  1' is already there (line 11)"),
        ('  Heat #1: [1]\n', "11: ' #' begins a comment"),
        ('  A: 1\n', "11: heat 'A' is not a list of karts"),
        ('  A: [one]\n', "11: heat 'A': number one is not valid"),
        (f'  {"x" * 33}: [1]\n', f'11: heat {"x" * 33} has no name that can be displayed'),
        ('  "a\\tb": [1]\n', "11: heat 'a\\tb' has no name that can be displayed"),
        ('  - A\n', "11: 'heats' is not a list of names"),
        ('  {}\n', "11: 'heats' is empty"),
    ],
)
def test_a_wrong_heat_is_refused_with_its_line_and_what_would_be_right(
    heats: str, fault: str
) -> None:
    told = fault_of_heats(heats)
    assert told.startswith(f'karts.yaml:{fault}')
    assert '; ' in told


def test_a_number_that_cannot_be_read_makes_no_kart_of_a_heat_unknown() -> None:
    text = TWO_KARTS.replace('number: 2', 'number: two') + 'heats:\n  A: [1, 2]\n'
    assert fault_of(text).split('\n')[1:] == []


def test_the_heats_shown_in_the_shipped_roster_are_right_when_they_are_taken_in() -> None:
    text = re.sub('(?m)^# (?=heats:|  Heat|  Final)', '', SHIPPED.read_text(encoding='utf-8'))
    assert len(parse_roster(text, 'karts.yaml').heats) > 1


# ----- rcs_roster ---------------------------------------------------------------------------


def test_a_right_roster_is_shown_with_its_karts_and_heats(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'karts.yaml'
    text = TWO_KARTS + "    inspected: 2026-05-01\n    transponders: [4711, 'FL-9']\n"
    path.write_text(text + 'heats:\n  Final: {karts: [2, 1], laps: 6, grid_from: practice}\n')
    assert check_roster(['check', str(path)]) == 0
    out = capsys.readouterr().out.splitlines()
    assert [' '.join(line.split()) for line in out[1:]] == [
        'kart 1 Georgia Tech 10.0.0.1 in the first race',
        'kart 2 Purdue 10.0.0.2 not in the first race, inspected 2026-05-01, '
        'transponders 4711, FL-9',
        'heat "Final": 1, 2 (race, 6 laps, grid from practice)',
    ]


def test_every_fault_of_a_wrong_roster_is_printed_with_its_line(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'karts.yaml'
    path.write_text(TWO_KARTS.replace('number: 2', 'number: x').replace('team: Purdue', 'team: 3'))
    assert check_roster(['check', str(path)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ''
    first, second = captured.err.splitlines()
    assert first.startswith(f'{path}:6: ')
    assert second.startswith(f'{path}:7: ')


ONE_KART = """\
karts:
  - number: 1
    team: Purdue
    address: 10.0.0.1
    in_race: true
"""


def test_the_day_of_an_inspection_may_be_there_or_not() -> None:
    (kart,) = parse_roster(ONE_KART, 'karts.yaml').entries
    assert kart.inspected == ''
    for written in ('2026-05-01', "'2026-05-01'"):
        (kart,) = parse_roster(f'{ONE_KART}    inspected: {written}\n', 'karts.yaml').entries
        assert kart.inspected == '2026-05-01'


@pytest.mark.parametrize('written', ['yes', '', '2026-02-31', '1.5.2026', '20260501', '[2026]'])
def test_an_inspection_that_is_no_day_is_refused_with_its_line(written: str) -> None:
    with pytest.raises(RosterError, match=r'karts\.yaml:6: kart 1: inspected'):
        parse_roster(f'{ONE_KART}    inspected: {written}\n', 'karts.yaml')


def test_a_kart_may_have_transponders_as_the_device_names_them() -> None:
    text = f'{ONE_KART}    transponders: [4711, "0815", AB-1]\n'
    (kart,) = parse_roster(text, 'karts.yaml').entries
    assert kart.transponders == ('4711', '0815', 'AB-1')


@pytest.mark.parametrize('written', ['4711', '[]', '[[1]]', '[""]', '{a: 1}', '["a\\tb"]'])
def test_transponders_that_are_no_list_of_names_are_refused(written: str) -> None:
    with pytest.raises(RosterError, match=r'karts\.yaml:6: kart 1: transponder'):
        parse_roster(f'{ONE_KART}    transponders: {written}\n', 'karts.yaml')


def test_a_transponder_of_two_karts_is_refused_and_both_are_named() -> None:
    second = ONE_KART.partition('\n')[2].replace('number: 1', 'number: 2')
    second = second.replace('10.0.0.1', '10.0.0.2')
    carries = '    transponders: [4711]\n'
    with pytest.raises(RosterError, match=r"kart 2: transponder 4711 is already kart 1's"):
        parse_roster(f'{ONE_KART}{carries}{second}{carries}', 'karts.yaml')


def test_a_heat_may_have_a_format_and_a_number_of_laps() -> None:
    heats = 'heats:\n  A: {karts: [1], format: time_trial, laps: 5}\n  B: [1]\n'
    first, second = parse_roster(f'{ONE_KART}{heats}', 'karts.yaml').heats
    assert (first.karts, first.format, first.laps) == ((1,), Format.TIME_TRIAL, 5)
    assert (second.format, second.laps) == (Format.RACE, 0)


def test_a_heat_may_start_in_the_order_of_another_heat_or_of_a_format() -> None:
    heats = 'heats:\n  A: {karts: [1], grid_from: "B "}\n  B: {karts: [1], grid_from: practice}\n'
    first, second = parse_roster(f'{ONE_KART}{heats}', 'karts.yaml').heats
    assert (first.grid_from, second.grid_from) == ('B', 'practice')


@pytest.mark.parametrize('source', ['A', 'C', '""', '[practice]', 'Practice'])
def test_an_order_from_no_other_heat_and_no_format_is_refused(source: str) -> None:
    heats = f'heats:\n  A: {{karts: [1], grid_from: {source}}}\n  B: [1]\n'
    with pytest.raises(RosterError, match=r"karts\.yaml:7: heat 'A': grid_from"):
        parse_roster(f'{ONE_KART}{heats}', 'karts.yaml')


@pytest.mark.parametrize(
    'written',
    ['{laps: 5}', '{karts: [1], format: rally}', '{karts: [1], laps: 0}', '{karts: [1], lap: 3}'],
)
def test_a_heat_with_a_wrong_field_is_refused(written: str) -> None:
    with pytest.raises(RosterError, match=r"karts\.yaml:7: heat 'A'"):
        parse_roster(f'{ONE_KART}heats:\n  A: {written}\n', 'karts.yaml')
