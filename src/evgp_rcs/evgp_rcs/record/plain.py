# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Makes untrusted texts safe, so that a terminal, a page or a table only displays them.

This module is pure.
"""

from __future__ import annotations


def plain(text: str) -> str:
    """Return an untrusted text without invisible characters or changes of writing direction."""
    if text.isprintable():
        return text
    return ''.join(
        each if each.isprintable() else ' ' if each.isspace() else '\N{REPLACEMENT CHARACTER}'
        for each in text
    )
