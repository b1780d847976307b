# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Count the lines of product, tests and tools, and documents, by folder."""

from collections import Counter
import pathlib
import re
import subprocess

COUNTED = (
    *('.py', '.c', '.h', '.cpp', '.hpp', '.msg', '.srv'),
    *('.css', '.js', '.html', '.j2', '.md', '.rst'),
)
TOOLS = re.compile(r'(^|/)(test|bench|soak|setup|evgp_testing)/|^conftest\.py$')


def part_of(path: str) -> str:
    """Return the part of the project that a file belongs to."""
    if path.endswith(('.md', '.rst')):
        return 'documents'
    return 'tests and tools' if TOOLS.search(path) else 'product'


parts: dict[str, Counter[str]] = {}
for line in subprocess.check_output(['git', 'ls-files'], text=True).splitlines():
    path = pathlib.Path(line)
    if path.suffix in COUNTED and not path.is_symlink():
        folder = '/'.join(path.parts[: 2 if path.parts[0] == 'src' else 1])
        count = len(path.read_bytes().splitlines())
        parts.setdefault(part_of(line), Counter())[folder] += count
for part, folders in sorted(parts.items()):
    print(f'{part:28}{folders.total():7,}')
    for folder, count in folders.most_common():
        print(f'    {folder:24}{count:7,}')
