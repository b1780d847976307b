# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Who gives a command: an official's name, by their own word.

It is a claim, not proof: whoever can give a command can give it in any name (docs/security.md). So
no rule depends on it, and no text that anybody sends as a name is ever a reason to refuse.

Pure.
"""

from __future__ import annotations

MOST = 80
"""Maximum length of what is kept as the name of a command's official, in characters."""

MOST_OF_NAME = 40
"""Maximum length of the name itself in what our own programs send, in characters."""

MOST_OF_HOST = 24
"""Maximum length of the name of the machine in what our own programs send, in characters."""

UNNAMED = 'unnamed'
"""An official who has not said who they are."""


def tidy(text: str, most: int = MOST) -> str:
    """
    Return what is kept of a name, for logs, terminals and pages: one line that can be printed.

    What cannot be printed is left out, also what turns the direction of a text.

    :param most: maximum length, in characters.
    """
    # Cut first: of a text of any length, only this much costs time.
    begun = text[: 4 * MOST]
    shown = ''.join(each for each in begun if each.isprintable() or each.isspace())
    return ' '.join(shown.split())[:most].rstrip()


TIMEKEEPER = 'timekeeper'
"""The official of a FINISH that the timekeeper gives; it never counts as somebody there."""


def heard(text: str) -> str:
    """Return the official of a command that came with any text as the name; never empty."""
    return tidy(text) or UNNAMED


def claim(name: str, host: str, process: int | None = None) -> str:
    """
    Return what our own programs send as the official: two consoles of one name are told apart.

    :param name: what the official is called; empty: unnamed.
    :param host: the name of the machine.
    :param process: the number of the process; None where a process gives one command only.
    """
    number = '' if process is None else f' {process}'
    who = tidy(name, MOST_OF_NAME) or UNNAMED
    return f'{who} ({tidy(host, MOST_OF_HOST)}{number})'


def said_by(text: str, official: str) -> str:
    """
    Return an event's sentence with who caused it.

    :param official: empty for what is no command, and in records of older versions.
    """
    return f'{text} [{official}]' if official else text
