# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Check that every source file names its copyright and licence; with --add, add what is missing.

    python3 setup/headers.py          names the files without a header; exit status 1 if any
    python3 setup/headers.py --add    adds the header to these files

The header is the two lines of SPDX. Configuration, messages and documents have none: the file
LICENSE is for them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import os
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parent.parent

COPYRIGHT = 'Copyright 2026 EVGP race control contributors'

NOTICE = f'{COPYRIGHT}\nSPDX-License-Identifier: Apache-2.0\n'

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


def has_header(text: str) -> bool:
    """Return whether a file names a copyright, of any holder and year, and the licence."""
    head = text[:HEAD]
    named = re.search(r'^\W*Copyright \d{4}', head, re.MULTILINE)
    return named is not None and NOTICE.splitlines()[-1] in head


def with_header(path: pathlib.Path, text: str) -> str:
    """Return the text with its header, below a first line that has to stay the first."""
    before, after = around(path, text) or ('', '')
    lines = [f'{before}{line}{after}'.rstrip() + '\n' for line in NOTICE.splitlines()]
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
        if text and around(path, text) and not has_header(text):
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
