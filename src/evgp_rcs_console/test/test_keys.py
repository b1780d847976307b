# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What each key means."""

from __future__ import annotations

from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs_console.keys import (
    FORGOTTEN,
    is_kill,
    KartField,
    key_name,
    KEYS,
    meaning,
    Stroke,
    WINDOW_KEYS,
)
from evgp_rcs_console.view import ANSWER_KEYS, FINISH_KEYS, Tone
import pytest


def test_no_key_means_two_things() -> None:
    # One key opens the track and closes it: the two commands share a button.
    every = [*KEYS, *FINISH_KEYS, *ANSWER_KEYS, *WINDOW_KEYS, 'Enter']

    assert len(every) == len(set(every))
    assert not any(is_kill(key, 0) for key in every)


@pytest.mark.parametrize(
    ('name', 'code'),
    [('Space', 0), ('F12', 0), ('\u00a0', 0), ('\u202f', 0), ('_', 65), ('0', 65), ('', 96)],
)
def test_a_key_of_all_kill_is_known_by_its_name_or_its_place(name: str, code: int) -> None:
    assert is_kill(name, code)


def test_keys_of_the_race_of_the_chosen_kart_of_a_letter_and_of_the_window() -> None:
    assert meaning('F3') == Stroke((CommandKind.GREEN_GREEN,))
    assert meaning('Ctrl+G') == Stroke((CommandKind.KART_IN_GARAGE,), to_chosen=True)
    assert meaning('C') == Stroke(finish=2)
    assert meaning('F10') == Stroke(window='F10')
    assert meaning('7') == Stroke(digit='7')


def test_a_key_that_answers_a_question_finishes_no_kart() -> None:
    assert [meaning(key) for key in ('Y', 'N', 'Shift+Y', 'Shift+N')] == [None] * 4


def test_a_key_tells_whether_it_gives_a_stop() -> None:
    stops = {key for key in (*KEYS, 'A') if (stroke := meaning(key)) and stroke.stop}

    assert stops == {'F4', 'F9', 'Ctrl+R', 'Ctrl+F'}


def test_a_command_is_sent_although_shift_is_held() -> None:
    for key in KEYS:
        held, plus, last = key.rpartition('+')
        assert meaning(f'{held}{plus}Shift+{last}') == meaning(key)


def test_other_keys_mean_nothing() -> None:
    assert [meaning(key) for key in ('Alt+F4', 'Ctrl+C', 'Tab', 'Ctrl+A', '', '½')] == [None] * 6


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


@pytest.fixture
def field() -> KartField:
    """Return a field in which nothing stands."""
    field = KartField()
    field.show_roster({2: 'Purdue', 7: 'Michigan', 12: 'Kennesaw', 27: 'Berkeley', 9999: 'Tech'})
    return field


def type_number(field: KartField, digits: str, at: float = 0.0) -> None:
    for digit in digits:
        field.add(digit, at)


def in_field(field: KartField) -> tuple[str, str, Tone]:
    """Return what stands in the field, below, and in which tone."""
    title, detail = field.cells()
    return title.text, detail.text, title.tone


def test_a_digit_shows_at_once_and_a_command_acts_on_the_kart_and_clears_it(
    field: KartField,
) -> None:
    type_number(field, '2')
    assert in_field(field) == ('KART 2', 'Purdue', Tone.PLAIN)

    type_number(field, '7')
    assert in_field(field) == ('KART 27', 'Berkeley', Tone.PLAIN)
    assert field.take(0.1) == (27, '')
    assert field.kart == 0
    type_number(field, '2', at=0.2)
    assert field.take(0.3)[0] == 2
    assert field.take(0.4)[0] == 0


@pytest.mark.parametrize('number', ['1', '3', '28', '99999', '0', '99997', '9999999'])
def test_a_number_that_is_not_in_the_roster_is_no_other_kart(
    field: KartField, number: str
) -> None:
    type_number(field, number)
    assert field.kart == 0
    assert in_field(field)[2] in (Tone.BAD, Tone.WAIT)

    kart, why = field.take(0.0)

    assert (kart, bool(why)) == (0, True)
    assert in_field(field)[2] is Tone.BAD  # until another digit is typed
    type_number(field, '2')
    assert field.kart == 2


def test_digits_are_neither_joined_nor_split_by_time_until_they_are_cleared_in_sight(
    field: KartField,
) -> None:
    type_number(field, '2')
    field.expire(FORGOTTEN - 0.1)
    assert field.digits == '2'

    field.expire(FORGOTTEN)
    assert field.digits == ''
    type_number(field, '7', at=FORGOTTEN)

    assert field.take(FORGOTTEN)[0] == 7


def test_a_command_for_a_number_that_was_typed_too_long_ago_acts_on_no_kart(
    field: KartField,
) -> None:
    field.choose(2)
    for waits, kart in ((0.5, 7), (FORGOTTEN, 0)):
        type_number(field, '7', at=100.0)
        found, why = field.take(100.0 + waits)
        assert (found, bool(why)) == (kart, not kart)


def test_backspace_takes_back_a_digit(field: KartField) -> None:
    type_number(field, '28')

    field.erase(0.0)

    assert field.kart == 2
    field.erase(0.0)
    field.erase(0.0)
    assert field.kart == 0


def test_a_kart_that_was_chosen_in_the_list_stands_there_until_a_digit_is_typed(
    field: KartField,
) -> None:
    field.choose(12)
    assert in_field(field) == ('KART 12', 'Kennesaw', Tone.PLAIN)
    assert [field.take(0.0)[0], field.take(99.0)[0]] == [12, 12]

    type_number(field, '3', at=100.0)
    assert field.take(100.0)[0] == 0
    # Not back to the one before: nothing was said of it for long.
    assert field.kart == 0
    field.choose(12)
    field.show_roster({2: 'Purdue'})
    assert field.take(0.0)[0] == 0
