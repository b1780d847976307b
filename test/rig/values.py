# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Any value of a type, for Hypothesis, by the types of its fields."""

from __future__ import annotations

import builtins
from collections import abc
import enum
import types
from typing import Any, get_args, get_origin, get_type_hints

from hypothesis import strategies as st

Simple = dict[Any, st.SearchStrategy[Any]]
"""What makes the values of the types without fields."""

# Whatever a message can hold: also a lone surrogate, a NUL, 10 kB.
ANYTHING: Simple = {
    str: st.text(st.characters(), max_size=50),
    int: st.integers(0, 2**63 - 1),
    float: st.floats(-9e9, 9e9),
    bool: st.booleans(),
    type(None): st.none(),
}


def any_of(kind: Any, simple: Simple = ANYTHING) -> st.SearchStrategy[Any]:
    """Return what makes any value of a type."""
    inner = [any_of(each, simple) for each in get_args(kind) if each is not ...]
    if kind in simple:
        return simple[kind]
    match get_origin(kind):
        case types.UnionType:
            return st.one_of(inner)
        case builtins.tuple:
            return st.lists(*inner).map(tuple)
        case builtins.frozenset:
            return st.frozensets(*inner)
        case abc.Mapping:
            return st.dictionaries(*inner)
    if issubclass(kind, enum.Enum):
        return st.sampled_from(kind)
    return st.builds(kind, *(any_of(each, simple) for each in get_type_hints(kind).values()))
