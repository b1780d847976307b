# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Finds what is wrong in parameter files: broken YAML, duplicate keys and other nodes' sections.

ROS reports the first in its own terms, and silently ignores the others, so a setting there would
have no effect. Files that this module cannot read are faults too, even if ROS could.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import itertools
import pathlib
import re

import yaml


def unreadable(arguments: Sequence[str]) -> Iterator[str]:
    """Yield a sentence for each fault of a parameter file on a command line that ROS stops at."""
    for path in _files(arguments):
        try:
            for each in _misplaced(_tree(path)):
                what = repr(each.value[:40]) if isinstance(each, yaml.ScalarNode) else 'a list'
                said = f'{what} is not below ros__parameters'
                yield _said(path, each, f'{said}. Put it there, as in the files in config/')
        except OSError as error:
            yield f'{path}: cannot be read ({error.strerror}). Name a readable file'
        except (yaml.YAMLError, ValueError) as error:  # the parser of ROS accepts more
            mark = getattr(error, 'problem_mark', None)
            where = f':{mark.line + 1}' if mark else ''
            fault: object = getattr(error, 'problem', None) or error
            yield f'{path}{where}: {fault}. Write one document in UTF-8, with spaces and no tabs'
        except RecursionError:
            yield f'{path}: is nested too deeply. Put each parameter just below ros__parameters'


def ignored(arguments: Sequence[str], node: str, alone: bool) -> Iterator[str]:
    """
    Yield a sentence, with file and line, for everything that ROS ignores in parameter files.

    :param arguments: the command line, which names files that can be read.
    :param node: name of the node, with its namespace, such as /rcs.
    :param alone: whether the files are for this node only, so that they must not have sections for
        other nodes.
    """
    for path in _files(arguments):
        root = _tree(path)
        for key, first in _twice(root):
            line = first.start_mark.line + 1
            yield _said(path, key, f'{key.value!r} is already in line {line}. Write it once')
        sections = [*_sections(root)]
        others = [(name, key) for name, key in sections if not _is_for(name, node)]
        if alone or len(others) == len(sections):
            for name, key in others:
                yield _said(path, key, f'{name!r} is for another node. Write /**: or {node}:')


def _files(arguments: Sequence[str]) -> list[str]:
    pairs = itertools.pairwise(arguments)
    return [path for before, path in pairs if before == '--params-file']


class _Loader(yaml.SafeLoader):
    """A loader that refuses aliases, as ROS does, because with one a node may contain itself."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem='aliases (*) are not used here', problem_mark=mark)
        return super().compose_node(parent, index)


def _tree(path: str) -> yaml.Node | None:
    return yaml.compose(pathlib.Path(path).read_text(encoding='utf-8'), _Loader)


def _said(path: str, key: yaml.Node, what: str) -> str:
    return f'{path}:{key.start_mark.line + 1}: {what}'


def _misplaced(node: yaml.Node | None) -> Iterator[yaml.Node]:
    """Yield what is neither a parameter nor the name of nodes that have some."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value != 'ros__parameters':
                yield from _misplaced(value) if isinstance(value, yaml.MappingNode) else [key]
    elif node is not None:
        yield node


def _twice(node: yaml.Node | None) -> Iterator[tuple[yaml.Node, yaml.Node]]:
    """Yield each duplicate key in a mapping at any depth, with the first one."""
    if isinstance(node, yaml.MappingNode):
        first: dict[str, yaml.Node] = {}
        for key, value in node.value:
            if first.setdefault(str(key.value), key) is not key:
                yield key, first[str(key.value)]
            yield from _twice(value)


def _sections(node: yaml.Node | None, name: str = '') -> Iterator[tuple[str, yaml.Node]]:
    """Yield the name and the key of each section that has parameters."""
    for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
        inner = f'{name}/{key.value}' if name else str(key.value)
        if isinstance(value, yaml.MappingNode):
            if any(each.value == 'ros__parameters' for each, _ in value.value):
                yield inner, key
            else:
                yield from _sections(value, inner)


def _is_for(name: str, node: str) -> bool:
    """Return whether a name, which may contain * and **, matches a node."""
    pattern = re.escape('/' + name.lstrip('/'))
    pattern = pattern.replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')
    return re.fullmatch(pattern, node) is not None
