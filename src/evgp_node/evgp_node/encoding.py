# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The record's encoding of values of the rules as JSON.

The types determine the encoding. A dataclass or a named tuple becomes the list of its fields. A
member of an enum becomes its name, or its number in an ``IntEnum``. A set becomes a sorted list.
JSON that does not fit its type is damaged.

This module is pure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses
import enum
import functools
import json
import types
from typing import Any, get_args, get_origin, get_type_hints, TypeVar

MOST_SECONDS = 1e10
"""Limit of a time by the rules' clock, in seconds. Times from there on are damaged."""

MOST_NUMBER = 2**63
"""Limit of a whole number. Numbers from there on are damaged."""

DAMAGED = (ValueError, LookupError, TypeError, RecursionError)
"""The exceptions that `reader` and `json` raise for damaged JSON."""

_Value = TypeVar('_Value')


def written(value: object) -> str:
    """Return a value as JSON."""
    return _encoder.encode(value)


def read(kind: type[_Value], text: str) -> _Value:
    """
    Return the value of this type that is encoded in a JSON text.

    :raises ValueError: if the JSON is damaged.
    """
    try:
        value: _Value = reader(kind)(json.loads(text))
    except DAMAGED as error:
        raise ValueError(str(error)[:200]) from error
    return value


def _plain(value: Any) -> object:
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, frozenset):
        return sorted(value)
    return [getattr(value, field.name) for field in dataclasses.fields(value)]


_encoder = json.JSONEncoder(default=_plain, separators=(',', ':'))


def reader(kind: Any) -> Callable[[Any], Any]:
    """Return a function that makes a value of this type from parsed JSON, or raises `DAMAGED`."""
    origin, inner = get_origin(kind), get_args(kind)
    if kind in _CHECKS:
        return functools.partial(_checked, kind, _CHECKS[kind])
    if origin is types.UnionType:
        some = reader(inner[0])  # the other type is None
        return lambda value: None if value is None else some(value)
    if origin in (tuple, frozenset):
        each = reader(inner[0])
        return lambda value: origin(map(each, _a_list(value)))
    if origin is Mapping:
        of_key, of_value = map(reader, inner)
        parsed: Callable[[str], Any] = str if inner[0] is str else int  # keys are texts in JSON
        return lambda value: {of_key(parsed(key)): of_value(value[key]) for key in value}
    if issubclass(kind, enum.Enum):
        by_name: Callable[[Any], Any] = kind.__getitem__
        return kind if issubclass(kind, int) else by_name
    fields = [reader(hint) for hint in get_type_hints(kind).values()]
    return lambda value: kind(
        *(of_field(each) for of_field, each in zip(fields, _a_list(value), strict=True))
    )


_CHECKS: Mapping[type[Any], Callable[[Any], bool]] = {
    str: lambda value: type(value) is str,
    bool: lambda value: type(value) is bool,
    int: lambda value: type(value) is int and 0 <= value < MOST_NUMBER,
    float: lambda value: type(value) in (int, float) and abs(value) < MOST_SECONDS,
    list: lambda value: type(value) is list,
}


def _checked(kind: type[Any], fits: Callable[[Any], bool], value: Any) -> Any:
    if not fits(value):
        raise ValueError(f'{value!r:.50} is not a {kind.__name__}')
    return kind(value)


_a_list = functools.partial(_checked, list, _CHECKS[list])
