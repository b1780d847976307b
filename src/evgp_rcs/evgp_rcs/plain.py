# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
