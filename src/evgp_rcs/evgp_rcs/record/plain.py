# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Makes untrusted texts safe, so that a terminal, a page or a table only displays them.

This module is pure.
"""

from __future__ import annotations

import unicodedata


def plain(text: str) -> str:
    """Return an untrusted text without invisible characters or changes of writing direction."""
    if text.isascii() and text.isprintable():
        return text
    return ''.join(
        '\N{REPLACEMENT CHARACTER}' if _does_more_than_show(each) else each for each in text
    )


def _does_more_than_show(character: str) -> bool:
    category = unicodedata.category(character)
    # Control, format and unassigned characters; line and paragraph separators.
    return category[0] == 'C' or category in ('Zl', 'Zp')
