# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Texts of others, so that a terminal, a page or a table shows them and does nothing else.

Pure.
"""

from __future__ import annotations

import unicodedata


def plain(text: str) -> str:
    """Return a text of others without characters that are not seen or that turn the line round."""
    if text.isascii() and text.isprintable():
        return text
    return ''.join(
        '\N{REPLACEMENT CHARACTER}' if _does_more_than_show(each) else each for each in text
    )


def _does_more_than_show(character: str) -> bool:
    category = unicodedata.category(character)
    # Controls, formats and what has no meaning; separators of lines and of paragraphs.
    return category[0] == 'C' or category in ('Zl', 'Zp')
