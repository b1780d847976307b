# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Check that every source file names its copyright and licence; with --add, add what is missing.

    python3 setup/headers.py          names the files without a header; exit status 1 if any
    python3 setup/headers.py --add    adds the header to these files

A file gets the two lines of SPDX. Only Python, C and C++ files of a package in src/ get the whole
notice: ament_copyright checks them and accepts nothing shorter. Configuration, messages and
documents have no header: the file LICENSE is for them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import os
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parent.parent

COPYRIGHT = 'Copyright 2026 EVGP race control contributors'

WHOLE = f"""\
{COPYRIGHT}

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

SHORT = f'{COPYRIGHT}\nSPDX-License-Identifier: Apache-2.0\n'

CHECKED = {'.py', '.c', '.h', '.cpp', '.hpp'}
"""The suffixes that ament_copyright checks in a package."""

AROUND = {
    '.py': ('# ', ''),
    '.c': ('// ', ''),
    '.h': ('// ', ''),
    '.cpp': ('// ', ''),
    '.hpp': ('// ', ''),
    '.css': ('/* ', ' */'),
    '.html': ('<!-- ', ' -->'),
    '.j2': ('{# ', ' #}'),
    '.ino': ('// ', ''),
    '.js': ('// ', ''),
    'CMakeLists.txt': ('# ', ''),
    'Makefile': ('# ', ''),
    '#!': ('# ', ''),
}
"""By suffix, name or beginning, what stands around each line of a header."""

MADE = {'__pycache__', 'build', 'install', 'log'}
"""Folders that are made and not written; those that begin with a dot are left out too."""

HEAD = 2000
"""The number of characters from the beginning within which a header is looked for."""


def around(path: pathlib.Path, text: str) -> tuple[str, str] | None:
    """Return what stands around a line of this file's header; None: it needs no header."""
    return AROUND.get(path.suffix) or AROUND.get(path.name) or AROUND.get(text[:2])


def notice(path: pathlib.Path) -> str:
    """Return what the header of a file says; `path` is the one inside the project."""
    return WHOLE if path.parts[0] == 'src' and path.suffix in CHECKED else SHORT


def has_header(path: pathlib.Path, text: str) -> bool:
    """Return whether a file names a copyright, of any holder and year, and the licence."""
    head = text[:HEAD]
    named = re.search(r'^\W*Copyright \d{4}', head, re.MULTILINE)
    return named is not None and notice(path).splitlines()[-1] in head


def with_header(path: pathlib.Path, text: str) -> str:
    """Return the text with its header, below a first line that has to stay the first."""
    before, after = around(path, text) or ('', '')
    lines = [f'{before}{line}{after}'.rstrip() + '\n' for line in notice(path).splitlines()]
    first = re.match(r'(#!|<!doctype).*\n', text, re.IGNORECASE)
    kept = first[0] if first else ''
    rest = text.removeprefix(kept)
    gap = '' if path.suffix == '.html' else '\n'
    if path.suffix != '.py' and rest.startswith('#'):
        gap = '#\n'  # one comment with what follows
    return f'{kept}{"".join(lines)}{gap}{rest}'


def sources(root: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yield every file that may need a header, as it is named inside `root`."""
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(
            name for name in folders if name not in MADE and (name[0] != '.' or name == '.ci')
        )
        for name in sorted(names):
            path = pathlib.Path(folder, name)
            if path.suffix in AROUND or name in AROUND or not path.suffix:
                yield path.relative_to(root)


def missing(root: pathlib.Path) -> Iterator[tuple[pathlib.Path, str]]:
    """Yield every file that lacks its header, with its text; empty files and links need none."""
    for path in sources(root):
        if (root / path).is_symlink():
            continue
        try:
            text = (root / path).read_text(encoding='utf-8')
        except UnicodeDecodeError:
            continue
        if text and around(path, text) and not has_header(path, text):
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
            (ROOT / path).write_text(with_header(path, text), encoding='utf-8')
        print(f'{path}: {"header added" if add else "no copyright header"}')
    if count and not add:
        print('Add them with: python3 setup/headers.py --add')
    return 1 if count and not add else 0


if __name__ == '__main__':
    raise SystemExit(main())
