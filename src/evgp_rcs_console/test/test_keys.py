"""What each key means."""

from __future__ import annotations

from evgp_rcs_console.keys import Act, KILL_KEYS, meaning, Typed
from evgp_rcs_console.snapshot import Command
from evgp_rcs_console.view import ANSWER_KEYS, CHOSEN_KART_KEYS, FINISH_KEYS, KEYS


def test_no_key_means_two_things() -> None:
    every = [
        *KEYS.values(),
        *FINISH_KEYS,
        *(f'Ctrl+{letter}' for letter in CHOSEN_KART_KEYS),
        *ANSWER_KEYS,
        *KILL_KEYS,
        *(key for key in ('F1', 'F10', 'F11', 'Up', 'Down', 'Return', 'Enter', 'Esc', 'Ctrl+L')),
    ]

    assert len(every) == len(set(every))
    assert not KILL_KEYS & set(every[: -len(KILL_KEYS) - 9])


def test_a_letter_is_the_finish_of_the_kart_that_shows_it() -> None:
    stroke = meaning('C')

    assert stroke is not None
    assert stroke.commands == (Command.KART_FINISH,)
    assert stroke.finish == 2


def test_keys_of_the_race_of_the_chosen_kart_and_of_the_window() -> None:
    green, garage, seen = meaning('F3'), meaning('Ctrl+G'), meaning('F10')

    assert green is not None
    assert green.commands == (Command.GREEN_GREEN,)
    assert garage is not None
    assert (garage.commands, garage.to_chosen) == ((Command.KART_IN_GARAGE,), True)
    assert seen is not None
    assert seen.act is Act.SEEN


def test_a_key_that_answers_a_question_finishes_no_kart() -> None:
    assert [meaning(key) for key in ('Y', 'N', 'Shift+Y', 'Shift+N')] == [None] * 4


def test_a_key_tells_whether_it_gives_a_stop() -> None:
    stops = {
        key
        for key in (*KEYS.values(), 'Ctrl+R', 'Ctrl+F', 'Ctrl+G', 'Ctrl+J', 'A')
        if (stroke := meaning(key)) and stroke.stop
    }

    assert stops == {'F4', 'F9', 'Ctrl+R', 'Ctrl+F'}


def test_other_keys_mean_nothing() -> None:
    assert [meaning(key) for key in ('Alt+F4', 'Ctrl+C', 'Tab', 'Ctrl+A', '', '½')] == [None] * 6


def test_digits_make_a_number_until_there_is_a_pause() -> None:
    typed = Typed(pause=1.5)

    assert [typed.add('1', 0.0), typed.add('2', 0.5), typed.add('7', 1.0)] == [1, 12, 127]
    assert typed.add('4', 5.0) == 4
