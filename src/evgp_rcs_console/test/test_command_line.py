# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""How `rcs_ctl` reads a command line, and what it prints if the line is wrong."""

from __future__ import annotations

from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs_console import texts
from evgp_rcs_console.command_line import COMMANDS, Exit, NO_STOP_SENT, NOTHING_SENT, parse
from evgp_rcs_console.commands import Given
import pytest


@pytest.mark.parametrize(
    'line',
    [
        *('all-kill', 'ALL-KILL', 'All_Kill', 'ALL KILL', 'all-kill 7', 'ALL-KILL now --hard'),
        *('--wait=2 ALL-KILL', 'grid-active 1 2 all-kill', 'please ALL-KILL', '77 all kill'),
        *('all-kill --wait nan', 'all-kill --official', '--wait soon all-kill'),
    ],
)
def test_all_kill_is_taken_however_it_is_typed(line: str) -> None:
    for before in ([], ['--official', 'Join']):
        assert COMMANDS[parse([*before, *line.split()]).command] is CommandKind.ALL_KILL


@pytest.mark.parametrize(
    ('line', 'said'),
    [
        ('kart-red-red 1 2', NO_STOP_SENT),
        ('kart-red-red', NO_STOP_SENT),
        ('kart-red-red seven', NO_STOP_SENT),
        ('red-flag 7', NO_STOP_SENT),
        ('red-flag --wait -1', NO_STOP_SENT),
        ('kart-red-red 70000', NO_STOP_SENT),
        ('kart-red-red 1_2', NO_STOP_SENT),
        ('kart-in-garage 1_2 --made-safe-by-hand', NOTHING_SENT),
        ('record-msr', NO_STOP_SENT),
        ('stop', NO_STOP_SENT),
        ('', NO_STOP_SENT),
        ('leave 3 4', NOTHING_SENT),
        ('penalise 3 --race 65537 --reason cut', NOTHING_SENT),
        ('leave', NOTHING_SENT),
        ('watch --wait inf', NOTHING_SENT),
        ('results 7', NOTHING_SENT),
    ],
)
def test_a_wrong_line_says_that_nothing_was_sent_and_of_what_may_be_a_stop_that_none_was(
    line: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(line.split())

    assert ended.value.code == Exit.USAGE
    assert capsys.readouterr().err.splitlines()[-1] == said


def test_a_name_keeps_its_letters_and_the_time_to_wait_may_come_before_the_command() -> None:
    assert parse(['HEAT', 'Heat A']).heat == 'Heat A'
    assert parse(['--official', 'Watch', 'join', '7']).official == 'Watch'
    for line in ('--wait 2 all-kill', 'all-kill --wait 2'):
        assert (parse(line.split()).command, parse(line.split()).wait) == ('all-kill', 2.0)


@pytest.mark.parametrize('command', [CommandKind.ALL_KILL, CommandKind.RACE_OVER])
def test_a_command_without_an_answer_says_what_is_known(command: CommandKind) -> None:
    unheard = texts.no_answer(Given(command), 1.24, 'sent 3 times')
    heard = texts.no_answer(Given(command), 1.24, reason='the record fails.')

    assert 'no answer within 1.2 s (sent 3 times). ' in unheard
    assert heard.endswith('not accepted it: the record fails.')
    for said in (unheard, heard):
        assert ('USE THE MSR' in said) is (command is CommandKind.ALL_KILL)
        assert ('Check the race' in said) is (command is CommandKind.RACE_OVER)
