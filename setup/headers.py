# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
List every source file that lacks the two lines of copyright and licence; exit code 1 if any.

Configuration, messages and documents do not need them: the file LICENSE covers them.
"""

from __future__ import annotations

from collections.abc import Iterator
import os
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parent.parent

NAMES = re.compile(r'.*\.(c|cpp|css|h|hpp|html|ino|j2|js|py)|CMakeLists\.txt|Makefile|[^.]+')
"""Files that need the header; those without a suffix, only if they are scripts."""

LINES = re.compile(r'^\W*Copyright \d{4} .*\n\W*SPDX-License-Identifier: Apache-2\.0\b', re.M)

MADE = {'__pycache__', 'build', 'install', 'log'}
"""Folders with generated files, which are skipped like those that begin with a dot."""


def missing(root: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yield every file that lacks its header, by its path inside `root`."""
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(
            name for name in folders if name not in MADE and (name[0] != '.' or name == '.ci')
        )
        for path in sorted(pathlib.Path(folder, name) for name in names if NAMES.fullmatch(name)):
            text = '' if path.is_symlink() else path.read_bytes().decode(errors='replace')[:2000]
            named = path.suffix or path.name == 'Makefile'
            if text and (named or text.startswith('#!')) and not LINES.search(text):
                yield path.relative_to(root)


if __name__ == '__main__':
    found = [*missing(ROOT)]
    for each in found:
        print(f'{each}: add the copyright and licence lines, as at the top of setup/headers.py')
    raise SystemExit(1 if found else 0)
