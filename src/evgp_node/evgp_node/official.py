# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The name under which an official sends a command.

The name is a claim and proves nothing, because anyone who can send a command can use any name
(docs/security.md). For this reason, no rule depends on the name, and race control never refuses a
command because of it.

This module is pure.
"""

from __future__ import annotations

MOST = 80
"""Maximum length of the name that race control stores, in characters."""

MOST_OF_NAME = 40
"""Maximum length of the name that our own programs send, in characters."""

MOST_OF_HOST = 24
"""Maximum length of the machine's name that our own programs send, in characters."""

UNNAMED = 'unnamed'
"""Used instead of the name of an official who has not entered one."""


def tidy(text: str, most: int = MOST) -> str:
    """
    Return a name as one printable line, for logs, terminals and pages.

    Characters that cannot be printed are left out, including those that change the direction of
    the text.

    :param text: the name, which may contain anything.
    :param most: maximum length of the line, in characters.
    """
    # Cut the text first, so that a very long text takes little time.
    begun = text[: 4 * MOST]
    shown = ''.join(each for each in begun if each.isprintable() or each.isspace())
    return ' '.join(shown.split())[:most].rstrip()


TIMEKEEPER = 'timekeeper'
"""The official of a FINISH that the timekeeper sends. The timekeeper cannot stop a race."""


def heard(text: str) -> str:
    """Return the official of a command from an untrusted text; `UNNAMED` if it has no name."""
    return tidy(text) or UNNAMED


def claim(name: str, host: str, process: int | None = None) -> str:
    """
    Return the `official` that our own programs send: the name, the machine and the process.

    :param name: name of the official; empty if it is unknown.
    :param host: name of the machine.
    :param process: number of the process; None for a process that sends only one command.
    """
    number = '' if process is None else f' {process}'
    who = tidy(name, MOST_OF_NAME) or UNNAMED
    return f'{who} ({tidy(host, MOST_OF_HOST)}{number})'


def said_by(text: str, official: str) -> str:
    """Return an event's sentence, followed by the official, if any, who caused the event."""
    return f'{text} [{official}]' if official else text
