# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Between the rooms of race control imports go one way; the rules know nothing of the world."""

from __future__ import annotations

import ast
from collections.abc import Iterator
import pathlib

import evgp_node
import evgp_rcs
import pytest

ROOMS = ('rules', 'record', 'karts', 'ros', 'spare')
"""Each may import those before it, and all but the rules the words for people, `words`."""

HOUSE = pathlib.Path(evgp_rcs.__path__[0])
SHARED = pathlib.Path(evgp_node.__path__[0])
IMPURE = {'asyncio', 'logging', 'os', 'pathlib', 'random', 'socket', 'threading', 'time'}
IMPURE |= {'evgp_rcs_msgs', 'rclpy', 'sqlite3', 'subprocess'}


def imports(room: str) -> Iterator[tuple[str, str]]:
    """Yield each file of a room with each module that it imports, as ``package.room``."""
    for path in sorted((HOUSE / room).rglob('*.py')):
        yield from ((path.name, module) for module in imports_of(path))


def imports_of(path: pathlib.Path) -> Iterator[str]:
    """Yield each module that a file imports, as ``package.room``."""
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            names = (each.name for each in node.names) if node.module == 'evgp_rcs' else ('',)
            yield from (f'{node.module}.{name}'.rstrip('.') for name in names)


@pytest.mark.parametrize('room', ROOMS)
def test_a_room_imports_only_those_before_it(room: str) -> None:
    allowed = {*ROOMS[: ROOMS.index(room) + 1], *(['words'] if room != 'rules' else [])}
    found = {
        (file, module)
        for file, module in imports(room)
        if module.split('.')[0] == 'evgp_rcs' and module.split('.')[1] not in allowed
    }
    assert not found


def test_the_rules_know_no_clock_socket_thread_file_ros_or_log() -> None:
    # Nor does what they import of the package that all nodes share.
    todo, looked_at = [*(HOUSE / 'rules').rglob('*.py')], set()
    while todo:
        path = todo.pop()
        looked_at.add(path.name)
        found = {*imports_of(path)}
        assert not {name for name in found if name.split('.')[0] in IMPURE}, path
        shared = (name.split('.')[1] for name in found if name.startswith('evgp_node.'))
        todo += [SHARED / f'{name}.py' for name in shared]
    assert looked_at >= {'race.py', 'entries.py', 'stream.py', 'encoding.py'}


def test_there_is_no_other_room() -> None:
    folders = {path.parent.name for path in HOUSE.glob('*/*.py')}
    assert folders == {*ROOMS}
