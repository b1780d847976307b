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
Check that every source file names its copyright and licence; with --add, add what is missing.

    python3 setup/headers.py          names the files without a header; exit status 1 if any
    python3 setup/headers.py --add    adds the header to these files

Python, C and CMake files get the whole notice, which ament_copyright looks for; all others the two
lines of SPDX. Configuration, messages and documents have no header: the file LICENSE is for them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import os
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parent.parent

HOLDER = 'EVGP race control contributors'
YEAR = 2026

NOTICE = """\
Licensed under the Apache License, Version 2.0 (the "License");
you may not use this file except in compliance with the License.
You may obtain a copy of the License at

    http://www.apache.org/licenses/LICENSE-2.0

Unless required by applicable law or agreed to in writing, software
distributed under the License is distributed on an "AS IS" BASIS,
WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
See the License for the specific language governing permissions and
limitations under the License."""
"""What ament_copyright takes for Apache-2.0."""

IDENTIFIER = 'SPDX-License-Identifier: Apache-2.0'

WHOLE = {'.py': '#', '.cmake': '#', '.c': '//', '.h': '//', '.cpp': '//', '.hpp': '//'}
"""By suffix, what begins a comment in the files that get the whole notice."""

SHORT = {
    '.css': ('/* ', ' */'),
    '.html': ('<!-- ', ' -->'),
    '.j2': ('{# ', ' #}'),
    '.ino': ('// ', ''),
    '.js': ('// ', ''),
    'CMakeLists.txt': ('# ', ''),
    'Makefile': ('# ', ''),
    '#!': ('# ', ''),
}
"""By suffix, name or beginning, what stands around each line in the files that get two lines."""

MADE = {'__pycache__', 'build', 'install', 'log'}
"""Folders that are made and not written; those that begin with a dot are left out too."""

HEAD = 2000
"""The number of characters from the beginning within which a header is looked for."""


def header(path: pathlib.Path, text: str) -> str | None:
    """Return the header that a file of this name and content has to have; None: it needs none."""
    copyright_line = f'Copyright {YEAR} {HOLDER}'
    mark = WHOLE.get(path.suffix)
    if mark is not None:
        lines = [copyright_line, '', *NOTICE.splitlines()]
        return ''.join(f'{mark} {line}'.rstrip() + '\n' for line in lines)
    around = SHORT.get(path.suffix) or SHORT.get(path.name) or SHORT.get(text[:2])
    if around is None:
        return None
    return ''.join(f'{around[0]}{line}{around[1]}\n' for line in (copyright_line, IDENTIFIER))


def has_header(path: pathlib.Path, text: str) -> bool:
    """Return whether a file names a copyright, of any holder and year, and the licence."""
    wanted = 'Licensed under the Apache License' if path.suffix in WHOLE else IDENTIFIER
    head = text[:HEAD]
    return wanted in head and re.search(r'^\W*Copyright \d{4}', head, re.MULTILINE) is not None


def with_header(path: pathlib.Path, text: str) -> str:
    """Return the text with its header, below a first line that has to stay the first."""
    first = re.match(r'(#!|<!doctype).*\n', text, re.IGNORECASE)
    kept = first[0] if first else ''
    gap = '' if path.suffix == '.html' else '\n'
    rest = text.removeprefix(kept)
    if path.suffix not in WHOLE and rest.startswith('#'):
        gap = '#\n'  # one comment with what follows
    return f'{kept}{header(path, text) or ""}{gap}{rest}'


def sources(root: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yield every source file that has to have a header."""
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(
            name for name in folders if name not in MADE and (name[0] != '.' or name == '.ci')
        )
        for name in sorted(names):
            path = pathlib.Path(folder, name)
            if path.suffix in WHOLE or path.suffix in SHORT or name in SHORT or not path.suffix:
                yield path


def missing(root: pathlib.Path) -> Iterator[tuple[pathlib.Path, str]]:
    """Yield every file that lacks its header, with its text; empty files need none."""
    for path in sources(root):
        try:
            text = path.read_text(encoding='utf-8')
        except UnicodeDecodeError:
            continue
        if text and header(path, text) is not None and not has_header(path, text):
            yield path, text


def main() -> int:
    """Check, or add; return the exit status."""
    parser = argparse.ArgumentParser(description='Check the copyright headers of source files.')
    parser.add_argument('--add', action='store_true', help='add the headers that are missing')
    add = parser.parse_args().add
    count = 0
    for path, text in missing(ROOT):
        count += 1
        if add:
            path.write_text(with_header(path, text), encoding='utf-8')
        print(f'{path.relative_to(ROOT)}: {"header added" if add else "no copyright header"}')
    if count and not add:
        print('Add them with: python3 setup/headers.py --add')
    return 1 if count and not add else 0


if __name__ == '__main__':
    raise SystemExit(main())
