# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Name every source file without the two lines of copyright and licence; exit status 1 if any.

Configuration, messages and documents have none: the file LICENSE is for them.
"""

from __future__ import annotations

from collections.abc import Iterator
import os
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parent.parent

NAMES = re.compile(r'.*\.(c|cpp|css|h|hpp|html|ino|j2|js|py)|CMakeLists\.txt|Makefile|[^.]+')
"""Files that have them; those without a suffix, if they can be run."""

LINES = re.compile(r'^\W*Copyright \d{4} .*\n\W*SPDX-License-Identifier: Apache-2\.0\b', re.M)

MADE = {'__pycache__', 'build', 'install', 'log'}
"""Folders that are made and not written; those that begin with a dot are left out too."""


def missing(root: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yield every file that lacks its header, as it is named inside `root`."""
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
        print(f'{each}: its first lines name no copyright and licence, as in setup/headers.py')
    raise SystemExit(1 if found else 0)
