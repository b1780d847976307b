# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What ROS reads over in a file of parameters: a key given twice, a section for another node.

A setting that its file only seems to make would silently keep its default.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import itertools
import pathlib
import re

import yaml


def ignored(arguments: Sequence[str], node: str, alone: bool) -> Iterator[str]:
    """
    Yield what ROS ignores in the files of these arguments: a sentence for each, with its line.

    :param node: the node's name, with its namespace, such as /rcs.
    :param alone: the files are for this node alone; else they may have sections for others too.
    """
    for before, path in itertools.pairwise(arguments):
        if before != '--params-file':
            continue
        root = yaml.compose(pathlib.Path(path).read_text(encoding='utf-8'), yaml.SafeLoader)
        for key, first in _twice(root):
            line = first.start_mark.line + 1
            yield _said(path, key, f'{key.value!r} is there already (line {line}). Give it once')
        sections = [*_sections(root)]
        others = [(name, key) for name, key in sections if not _is_for(name, node)]
        if alone or len(others) == len(sections):
            for name, key in others:
                yield _said(path, key, f'{name!r} is for another node. Write /**: or {node}:')


def _said(path: str, key: yaml.Node, what: str) -> str:
    return f'{path}:{key.start_mark.line + 1}: {what}'


def _twice(node: yaml.Node | None) -> Iterator[tuple[yaml.Node, yaml.Node]]:
    """Yield each key that its mapping has already, and that earlier key."""
    if isinstance(node, yaml.MappingNode):
        first: dict[str, yaml.Node] = {}
        for key, value in node.value:
            if first.setdefault(str(key.value), key) is not key:
                yield key, first[str(key.value)]
            yield from _twice(value)


def _sections(node: yaml.Node | None, name: str = '') -> Iterator[tuple[str, yaml.Node]]:
    """Yield each name of a node that has parameters, and its key."""
    for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
        inner = f'{name}/{key.value}' if name else str(key.value)
        if isinstance(value, yaml.MappingNode):
            if any(each.value == 'ros__parameters' for each, _ in value.value):
                yield inner, key
            else:
                yield from _sections(value, inner)


def _is_for(name: str, node: str) -> bool:
    """Return whether a name, perhaps with * and **, is that of a node."""
    pattern = re.escape('/' + name.lstrip('/'))
    pattern = pattern.replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')
    return re.fullmatch(pattern, node) is not None
