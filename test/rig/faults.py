# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Faults put into a module on purpose, for what must find them.

Each is a small change of the syntax tree of one function or constant, at a place that is named by
words that stand in it. Layout, comments, and lines that do not have these words do not matter.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path
import re
import sys
from types import ModuleType
from typing import Any, NamedTuple

ROW = re.compile(
    r'(?P<name>[^:]+):(?P<breaks>(?:,? [\w-]+)*?)(?: \[(?P<begin>[^\]]+)\])? '
    r'(?P<where>\w+): (?P<does>.+)'
)
WORD = re.compile(r'\w+|[=<>!]+|[^\w\s]')


class Fault(NamedTuple):
    """
    A fault: what a function or constant of a module does wrong, and the rules one of which breaks.

    :param begin: where the search for it begins; empty: nowhere in particular.
    """

    where: str
    does: str
    breaks: tuple[str, ...] = ()
    begin: str = ''


def faults_in(table: str) -> dict[str, Fault]:
    """
    Return the faults of a table, each under what it would mean.

    A row is ``meaning: rule, rule [begin] where: what it does wrong``, with or without rules and
    begin; lines that are indented go on. What it does wrong is one of these, where WORDS choose
    the smallest such part that has all of them. There must be one only, or ``#2`` behind the words
    says that it is the second:

    - ``skips WORDS``: a statement is left out;
    - ``without WORDS``: an operand, element, argument or target of an assignment is left out;
    - ``always WORDS``, ``never WORDS``: a condition is true, or false;
    - ``WORDS => EXPRESSION``: that stands in place of an expression, which is ``it`` therein;
    - ``before WORDS: STATEMENTS``, ``after``, ``instead of``: so with a statement;
    - ``first: STATEMENTS``: they come before everything else.

    ``¶`` is a new line, and ``¶>`` one that is indented.

    :raises AssertionError: if a row is none, or a meaning stands there twice.
    """
    faults = {}
    for row in re.split(r'\n(?=\S)', table.strip()):
        read = ROW.fullmatch(' '.join(row.split()))
        assert read, row
        name, breaks, begin, where, does = read.groups()
        assert name not in faults, name
        rules = tuple(breaks.strip().split(', ')) if breaks else ()
        faults[name] = Fault(where, does, rules, begin or '')
    return faults


class Place(NamedTuple):
    """Where a node stands: in which field of its parent, and at which place if that is a list."""

    node: ast.AST
    parent: ast.AST
    field: str
    at: int | None

    def put(self, *nodes: ast.AST) -> None:
        """Put others there; without any, leave it out, and what belongs to it."""
        if self.at is None:
            (node,) = nodes
            setattr(self.parent, self.field, node)
            return
        getattr(self.parent, self.field)[slice(self.at, self.at + 1)] = nodes
        if isinstance(self.parent, ast.Dict) and not nodes:
            del self.parent.keys[self.at]
        if isinstance(self.parent, ast.BoolOp) and len(self.parent.values) == 1:
            self.parent.values *= 2  # the syntax wants two

    @property
    def words(self) -> set[str]:
        """Return its names, numbers and signs, and those of the key or keyword before it."""
        before: Any = ''
        if isinstance(self.parent, ast.Dict) and self.field == 'values':
            before = ast.unparse(self.parent.keys[self.at])  # type: ignore[arg-type, index]
        elif isinstance(self.parent, ast.keyword):
            before = self.parent.arg
        return {*WORD.findall(f'{before} {ast.unparse(self.node)}')}


def is_statement(place: Place) -> bool:
    return isinstance(place.node, ast.stmt)


def is_expression(place: Place) -> bool:
    return isinstance(place.node, ast.expr)


def is_condition(place: Place) -> bool:
    of = getattr(place.parent, 'op', None)
    return (
        place.field in ('test', 'ifs')
        or isinstance(place.node, ast.Compare | ast.BoolOp)
        or (is_expression(place) and isinstance(of, ast.And | ast.Or | ast.Not))
    )


def can_be_left_out(place: Place) -> bool:
    """Return whether the rest makes sense without it."""
    of = ast.BoolOp | ast.Tuple | ast.List | ast.Set | ast.Dict | ast.Call | ast.Assign
    return place.at is not None and place.field != 'keys' and isinstance(place.parent, of)


def places_in(parent: ast.AST) -> Iterator[Place]:
    """Yield every node below one, with its place, but no docstring."""
    for field, value in ast.iter_fields(parent):
        several = isinstance(value, list)
        for at, node in enumerate(value if several else [value]):
            is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            if isinstance(node, ast.AST) and not is_text:
                yield Place(node, parent, field, at if several else None)
                yield from places_in(node)


def chosen(root: ast.AST, words: str, fits: Callable[[Place], bool]) -> Place:
    """
    Return the smallest place of a kind below a node that has all words.

    :raises AssertionError: if there is none, or another one that is not around it.
    """
    words, _, which = words.partition(' #')
    found = [each for each in places_in(root) if fits(each) and {*words.split()} <= each.words]
    inside = [{id(node) for node in ast.walk(each.node)} for each in found]
    smallest = [
        each
        for each, ids in zip(found, inside, strict=True)
        if not any(other.node is not each.node and id(other.node) in ids for other in found)
    ]
    if which:
        return smallest[int(which) - 1]
    texts = [ast.unparse(each.node) for each in smallest]
    assert len(smallest) == 1, f'{len(smallest)} times in it: {words} {texts}'
    return smallest[0]


def put(fault: Fault, tree: ast.Module) -> None:
    """
    Put a fault into the tree of a module.

    :raises AssertionError: if it does not fit exactly once.
    """
    (root,) = (node for name, node in _named(tree) if name == fault.where)
    verb, _, words = fault.does.partition(' ')
    if verb == 'without':
        chosen(root, words, can_be_left_out).put()
    elif verb == 'skips':
        chosen(root, words, is_statement).put(ast.Pass())
    elif verb in ('always', 'never'):
        chosen(root, words, is_condition).put(ast.Constant(verb == 'always'))
    elif verb == 'first:':
        assert isinstance(root, ast.FunctionDef)
        root.body[:0] = _statements(words)
    elif ' => ' in fault.does:
        words, _, new = fault.does.partition(' => ')
        place = chosen(root, words, is_expression)
        expression = _It(place.node).visit(ast.parse(new, mode='eval').body)
        if isinstance(getattr(place.node, 'ctx', None), ast.Store):
            expression.ctx = ast.Store()
        place.put(expression)
    else:
        before, after = verb == 'before', verb == 'after'
        assert before or after or words.startswith('of '), fault.does
        words, _, new = words.removeprefix('of ').partition(': ')
        place = chosen(root, words, is_statement)
        place.put(*[place.node] * after, *_statements(new), *[place.node] * before)


def _statements(text: str) -> list[ast.stmt]:
    return ast.parse(re.sub(r' ?¶ ?', '\n', text.replace('¶> ', '¶    '))).body


class _It(ast.NodeTransformer):
    """Puts the old expression where the new one says ``it``."""

    def __init__(self, it: ast.AST) -> None:
        self._it = it

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return self._it if node.id == 'it' else node


def _named(tree: ast.Module) -> Iterator[tuple[str, ast.stmt]]:
    """Yield every function of a module and its classes, and every constant, with its name."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            yield ast.unparse(target), node
        for each in node.body if isinstance(node, ast.ClassDef) else [node]:
            if isinstance(each, ast.FunctionDef):
                yield each.name, each


def tree_with(module: ModuleType, fault: Fault | None) -> ast.Module:
    """
    Return the syntax tree of a module with one fault.

    :param fault: None: none is put in.
    :raises AssertionError: if it does not fit exactly once.
    """
    assert module.__file__ is not None
    tree = ast.parse(Path(module.__file__).read_text(encoding='utf-8'))
    if fault is not None:
        put(fault, tree)
    return ast.fix_missing_locations(tree)


def module_with(module: ModuleType, fault: Fault | None) -> ModuleType:
    """Return a module, a second time and with one fault; see ``tree_with``."""
    faulty = ModuleType(f'faulty_{module.__name__.rpartition(".")[2]}')
    # A dataclass looks its module up by name, while it is made.
    sys.modules[faulty.__name__] = faulty
    try:
        code = compile(tree_with(module, fault), str(module.__file__), 'exec')
        exec(code, vars(faulty))  # noqa: S102
    finally:
        del sys.modules[faulty.__name__]
    return faulty
