# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The name of the official who sends a command, as the sender gives it.

The name is a claim, not proof: anyone who can send a command can use any name (docs/security.md).
Therefore no rule depends on it, and no text that is sent as a name leads to a refusal.

Pure.
"""

from __future__ import annotations

MOST = 80
"""Maximum stored length of the official of a command, in characters."""

MOST_OF_NAME = 40
"""Maximum length of the name that our own programs send, in characters."""

MOST_OF_HOST = 24
"""Maximum length of the machine's name that our own programs send, in characters."""

UNNAMED = 'unnamed'
"""The name of an official who has not given one."""


def tidy(text: str, most: int = MOST) -> str:
    """
    Return a name as one printable line, for logs, terminals and pages.

    Characters that cannot be printed are left out, including those that change the direction of
    the text.

    :param most: maximum length, in characters.
    """
    # Cut first, so that a text of any length costs little time.
    begun = text[: 4 * MOST]
    shown = ''.join(each for each in begun if each.isprintable() or each.isspace())
    return ' '.join(shown.split())[:most].rstrip()


TIMEKEEPER = 'timekeeper'
"""The official of a FINISH that the timekeeper sends; it never counts as able to stop."""


def heard(text: str) -> str:
    """Return the official of a command from an untrusted text; never empty."""
    return tidy(text) or UNNAMED


def claim(name: str, host: str, process: int | None = None) -> str:
    """
    Return what our own programs send as the official, different for each program.

    :param name: name of the official; empty if unnamed.
    :param host: name of the machine.
    :param process: number of the process; None if the process sends only one command.
    """
    number = '' if process is None else f' {process}'
    who = tidy(name, MOST_OF_NAME) or UNNAMED
    return f'{who} ({tidy(host, MOST_OF_HOST)}{number})'


def said_by(text: str, official: str) -> str:
    """
    Return an event's sentence with the official who caused it.

    :param official: empty if no command caused it.
    """
    return f'{text} [{official}]' if official else text
