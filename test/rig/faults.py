# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Faults put into a module on purpose, for what must find them.

Each is a piece of the module's source text, and what stands in its place.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
import re
import sys
from types import ModuleType
from typing import NamedTuple

ROW = re.compile(
    r'(?P<name>[^:]+):(?P<breaks>(?:,? [\w-]+)*?)(?: \[(?P<begin>[^\]]+)\])? '
    r'(?P<where>\w+): (?P<old>.+?) =>(?P<new>.*)'
)
BLANK = r'(?:\s|#.*\n)*'


class Fault(NamedTuple):
    """
    A fault: what is put in place of what, and the rules one of which it must break.

    :param where: the function or constant of the module in which it stands; empty: anywhere.
    :param begin: where the search for it begins; empty: nowhere in particular.
    """

    old: str
    new: str
    breaks: tuple[str, ...] = ()
    where: str = ''
    begin: str = ''


def faults_in(table: str) -> dict[str, Fault]:
    """
    Return the faults of a table, each under what it would mean.

    A row is ``meaning: rule, rule [begin] where: old => new``, with or without rules and begin;
    lines that are indented go on. ``¶`` is a new line, and ``¶>`` one that is indented once more
    than what is replaced.

    :raises AssertionError: if a row is none, or a meaning stands there twice.
    """
    faults = {}
    for row in re.split(r'\n(?=\S)', table.strip()):
        read = ROW.fullmatch(' '.join(row.split()))
        assert read, row
        name, breaks, begin, where, old, new = read.groups()
        assert name not in faults, name
        rules = tuple(breaks.strip().split(', ')) if breaks else ()
        faults[name] = Fault(old, new.strip(), rules, where, begin or '')
    return faults


def source_with(module: ModuleType, old: str, new: str, where: str = '') -> str:
    """
    Return the source of a module with one fault.

    :param where: the function or constant in which it stands; there line breaks and comments do
        not matter.
    :raises AssertionError: if `old` is not there exactly once: the fault no longer fits.
    """
    assert module.__file__ is not None
    text = Path(module.__file__).read_text(encoding='utf-8')
    if not where:
        assert text.count(old) == 1, f'{text.count(old)} times in {module.__name__}: {old}'
        return text.replace(old, new)
    lines = text.splitlines(keepends=True)
    (node,) = (node for name, node in _named(ast.parse(text)) if name == where)
    first, last = node.lineno - 1, node.end_lineno
    part = ''.join(lines[first:last])
    symbols = re.findall(r'\w+|[^\w\s]', old)
    found = list(re.finditer(BLANK.join(map(re.escape, symbols)), part))
    assert len(found) == 1, f'{len(found)} times in {where}: {old}'
    start, end = found[0].span()
    indent = '\n' + re.match(' *', part[:start].rpartition('\n')[2])[0]  # type: ignore[index]
    new = new.replace(' ¶> ', f'{indent}    ').replace(' ¶ ', indent)
    return ''.join([*lines[:first], part[:start], new, part[end:], *lines[last:]])


def _named(tree: ast.Module) -> Iterator[tuple[str, ast.stmt]]:
    """Yield every function of a module and its classes, and every constant, with its name."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            yield ast.unparse(target), node
        for each in node.body if isinstance(node, ast.ClassDef) else [node]:
            if isinstance(each, ast.FunctionDef):
                yield each.name, each


def module_with(module: ModuleType, old: str, new: str, where: str = '') -> ModuleType:
    """Return a module, a second time and with one fault; see ``source_with``."""
    faulty = ModuleType(f'faulty_{module.__name__.rpartition(".")[2]}')
    text = source_with(module, old, new, where)
    # A dataclass looks its module up by name, while it is made.
    sys.modules[faulty.__name__] = faulty
    try:
        exec(compile(text, str(module.__file__), 'exec'), vars(faulty))  # noqa: S102
    finally:
        del sys.modules[faulty.__name__]
    return faulty
