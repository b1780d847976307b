# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What each key means."""

from __future__ import annotations

import re

from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.words import Cell, Tone
from evgp_rcs_console.keys import (
    is_kill,
    KartField,
    key_help,
    key_name,
    KEYS,
    meaning,
    Stroke,
    WINDOW_KEYS,
)
from evgp_rcs_console.view import ANSWER_KEYS, FINISH_KEYS
import pytest


def test_no_key_means_two_things() -> None:
    # One key opens the track and closes it: the two commands share a button.
    every = [*KEYS, *FINISH_KEYS, *ANSWER_KEYS, *WINDOW_KEYS, 'Enter']

    assert len(every) == len(set(every))
    assert not any(is_kill(key, 0) for key in every)
    helped = dict(key_help())
    assert (helped['F3'], helped['Ctrl+G']) == ('GREEN GREEN', 'GARAGE: chosen kart')


@pytest.mark.parametrize(
    ('name', 'code'),
    [('Space', 0), ('F12', 0), ('\u00a0', 0), ('\u202f', 0), ('_', 65), ('0', 65), ('', 96)],
)
def test_a_key_of_all_kill_is_known_by_its_name_or_its_place(name: str, code: int) -> None:
    assert is_kill(name, code)


@pytest.mark.parametrize(
    ('keys', 'stroke'),
    [
        ('F3', Stroke((CommandKind.GREEN_GREEN,))),
        ('Ctrl+G', Stroke((CommandKind.KART_IN_GARAGE,), to_chosen=True)),
        ('C', Stroke(finish=2)),
        ('F10', Stroke(window='F10')),
        ('7', Stroke(digit='7')),
        ('Y N Shift+Y Shift+N', None),  # they answer a question, and finish no kart
        ('Alt+F4 Ctrl+C Tab Ctrl+A ½', None),
    ],
)
def test_each_key_means_a_command_a_finish_a_digit_something_in_the_window_or_nothing(
    keys: str, stroke: Stroke | None
) -> None:
    assert {meaning(key) for key in keys.split()} == {stroke}


def test_a_key_tells_whether_it_gives_a_stop() -> None:
    stops = {key for key in (*KEYS, 'A') if (stroke := meaning(key)) and stroke.stop}

    assert stops == {'F4', 'F9', 'Ctrl+R', 'Ctrl+F'}


def test_a_command_is_sent_although_shift_is_held() -> None:
    for key in KEYS:
        held, plus, last = key.rpartition('+')
        assert meaning(f'{held}{plus}Shift+{last}') == meaning(key)


@pytest.mark.parametrize(
    ('name', 'text', 'code', 'called'),
    [
        ('Shift+7', '7', 16, '7'),  # French: the digits need Shift
        ('7', '7', 16, '7'),
        ('Shift+A', 'A', 38, 'Shift+A'),
        ('Ctrl+\u041a', '', 27, 'Ctrl+R'),  # Russian: the letter at the place of R
        ('Ф', 'ф', 38, 'A'),
        ('Ctrl+R', '', 32, 'Ctrl+R'),  # Dvorak: the letter counts, not its place
        ('Ö', 'ö', 47, 'Ö'),
        ('Ctrl+7', '', 16, 'Ctrl+7'),
        ('F4', '', 70, 'F4'),
        ('Num+Up', '', 80, '8'),  # the keypad without Num Lock, and then an arrow
        ('Num+Clear', '', 84, '5'),
        ('Num+Ins', '', 90, '0'),
        ('Up', '', 111, 'Up'),
    ],
)
def test_a_key_means_the_same_on_every_layout(
    name: str, text: str, code: int, called: str
) -> None:
    assert key_name(name, text, code) == called


# ----- the kart of a command by key -----------------------------------------------------------


def play(script: str) -> tuple[list[int], KartField]:
    """
    Do what a script says in a new field; return the karts that its commands went to, and it.

    ``!`` is a command, ``<`` the key Backspace, ``@7`` chooses kart 7 in the list, ``+5`` lets 5 s
    pass, and each other digit is typed.
    """
    field, now, taken = KartField(), 100.0, []
    field.show_roster({2: 'Purdue', 7: 'Michigan', 12: 'Kennesaw', 27: 'Berkeley', 9999: 'Tech'})
    for what in re.findall(r'@\d+|\+[\d.]+|\S', script):
        if what[0] == '@':
            field.choose(int(what[1:]))
        elif what[0] == '+':
            now += float(what)
        elif what == '<':
            field.erase(now)
        elif what == '!':
            kart, why = field.take(now)
            assert bool(why) is (kart == 0)
            taken.append(kart)
        else:
            field.add(what, now)
    field.expire(now)
    return taken, field


@pytest.mark.parametrize(
    ('script', 'karts'),
    [
        ('27! ! 2! !', [27, 0, 2, 0]),
        *((f'{number}! 2!', [0, 2]) for number in (1, 3, 28, 99999, 0, 99997, 9999999)),
        # Digits are neither joined nor split by time until they are too old.
        ('2 +4.9 7!', [27]),
        ('2 +5 7!', [7]),
        ('@2 7 +4.9 !', [7]),
        ('@2 7 +5 !', [0]),
        ('28 <!', [2]),
        ('28 < < <!', [0]),
        ('27 +5 <!', [0]),
        ('@12! +99!', [12, 12]),
        ('@12 3! !', [0, 0]),  # not back to kart 12: nothing was said of it for long
    ],
)
def test_a_command_by_key_goes_to_the_kart_that_is_typed_or_chosen_or_to_none(
    script: str, karts: list[int]
) -> None:
    assert play(script)[0] == karts


def test_a_chosen_kart_that_leaves_the_roster_is_no_longer_chosen() -> None:
    _, field = play('@12')
    field.show_roster({2: 'Purdue'})
    assert field.take(0.0)[0] == 0


@pytest.mark.parametrize(
    ('script', 'title', 'detail', 'tone'),
    [
        ('2', 'KART 2', 'Purdue', Tone.PLAIN),
        ('@12', 'KART 12', 'Kennesaw', Tone.PLAIN),
        ('1', '1 …', 'no kart 1: keep typing', Tone.WAIT),
        ('28', 'NO KART 28', 'not in the roster', Tone.BAD),
        ('1!', 'NO KART 1', 'nothing was sent', Tone.BAD),  # until another digit is typed
        ('1! 2', 'KART 2', 'Purdue', Tone.PLAIN),
        ('2 +5', '', 'Type a kart number', Tone.FAINT),
    ],
)
def test_the_field_shows_the_kart_at_once_and_what_is_wrong_with_a_number(
    script: str, title: str, detail: str, tone: Tone
) -> None:
    assert play(script)[1].cells() == (Cell(title, tone), Cell(detail, tone))
