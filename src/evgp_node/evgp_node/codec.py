# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Converts values to ROS messages of ``evgp_rcs_msgs`` and back.

The types of the message and of the value determine the conversion, so no field is named here. A
field of the value becomes the message's field of the same name, and ``stamp_ns`` becomes `stamp`.
A member of an enum becomes the constant of its name or, in a text, its value. None becomes UNKNOWN
for a state, 0 for a time or a constant, and NaN for any other number.
"""

from __future__ import annotations

from collections.abc import Callable
import enum
import functools
import math
import types
from typing import Any, get_args, get_origin, get_type_hints, TypeVar

from builtin_interfaces.msg import Time
from evgp_node.stamps import NS, seconds_of, stamp_of
from evgp_node.states import state_message, state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg

STAMPED = ('sequence', 'monotonic')
"""Fields of an event's message, besides `stamp`, that come from the ``StampedEvent``."""

SENTENCES = ('text', 'reason', 'statement', 'state_cause', 'hold_reason', 'button_fault')
"""Fields that contain race control's sentences. All other texts are names."""

_Value = TypeVar('_Value')
_TIME = 'builtin_interfaces/Time'


def message_of(value: Any, kind: type[Any], wall_ns: int = 0) -> Any:
    """
    Return a value as a message of this type.

    :param wall_ns: wall time at which the value's clock was 0, in ns since the epoch.
    """
    return _image(value, type(value), kind, wall_ns)


def _image(value: Any, kind: type[Any], message: type[Any], wall_ns: int) -> Any:
    image = message()
    for slot, name, write, _ in _fields(kind, message):
        setattr(image, slot, write(getattr(value, name), wall_ns))
    return image


def value_of(message: Any, kind: type[_Value], said: Callable[[str], str] = str) -> _Value:
    """
    Return a message as a value of this type. Its times are wall times in seconds.

    :param said: a function to apply to each of ``SENTENCES``.
    :raises ValueError: if the message has an unknown constant, or lacks a required state.
    """
    return kind(
        **{
            name: read(getattr(message, slot), said)
            for slot, name, _, read in _fields(kind, type(message))
        }
    )


_Write = Callable[[Any, int], Any]
_Read = Callable[[Any, Callable[[str], str]], Any]


def _find_fields(kind: Any, message: Any) -> list[tuple[str, str, _Write, _Read]]:
    """Return each field's name in the message and in the type, with its writer and reader."""
    hints = get_type_hints(kind)
    names = {name.removesuffix('_ns'): name for name in hints}
    return [
        (slot, names[slot], *_both(slot, hints[names[slot]], slot_type))
        for slot, slot_type in message.get_fields_and_field_types().items()
        if slot in names or slot not in (*STAMPED, 'stamp')
    ]


_fields: Callable[[Any, Any], list[tuple[str, str, _Write, _Read]]] = functools.cache(_find_fields)


def _both(name: str, hint: Any, slot: str) -> tuple[_Write, _Read]:
    """Return a function that writes a field of these types, and one that reads it."""
    optional = get_origin(hint) is types.UnionType
    kind = next(each for each in get_args(hint) if each is not type(None)) if optional else hint
    if slot == _TIME and kind is int:
        return lambda ns, _: stamp_of(ns), lambda time, _: time.sec * NS + time.nanosec
    if slot == _TIME:
        return _write_time, _read_optional_time if optional else _read_time
    if kind is RaceState:
        return lambda state, _: state_message(state), _read_state if optional else _read_some_state
    if slot.startswith('sequence<') and '/' in slot:
        one, inner = getattr(msg, slot[9:-1].split('/')[1]), get_args(kind)[0]
        return (
            lambda values, wall: [_image(each, inner, one, wall) for each in values],
            lambda messages, said: tuple(value_of(each, inner, said) for each in messages),
        )
    if slot.startswith('sequence<'):
        return lambda values, _: list(values), lambda values, _: tuple(values)
    if '/' in slot:
        one = getattr(msg, slot.split('/')[1])
        return (
            lambda value, wall: _image(value, kind, one, wall),
            lambda message, said: value_of(message, kind, said),
        )
    if issubclass(kind, enum.Enum) and slot == 'string':
        return lambda each, _: each.value, lambda each, _: kind(each)
    if issubclass(kind, enum.Enum):
        of = constants_of(kind)
        number = {each: int(getattr(of, each.name)) for each in kind}
        value = {at: each for each, at in number.items()}
        number, value = ({**number, None: 0}, {**value, 0: None}) if optional else (number, value)
        return lambda each, _: number[each], lambda each, _: _known(value, each, kind)
    if optional and kind is float:
        return (
            lambda number, _: math.nan if number is None else number,
            lambda number, _: None if math.isnan(number) else number,
        )
    if name in SENTENCES:
        return lambda text, _: text, lambda text, said: said(text)
    return lambda value, _: value, lambda value, _: value


def constants_of(kind: type[enum.Enum]) -> Any:
    """Return the message that has a constant for every member of an enum."""
    return next(
        each
        for each in vars(msg).values()
        if isinstance(each, type) and all(hasattr(each, member.name) for member in kind)
    )


def _known(values: dict[Any, Any], number: int, kind: type[enum.Enum]) -> Any:
    if number not in values:
        raise ValueError(f'{number} is not a {kind.__name__}')
    return values[number]


def _write_time(time: float | None, wall_ns: int) -> Time:
    return Time() if time is None else stamp_of(wall_ns + round(time * NS))


def _read_time(time: Time, _: Callable[[str], str]) -> float:
    return seconds_of(time)


def _read_optional_time(time: Time, said: Callable[[str], str]) -> float | None:
    return _read_time(time, said) or None


def _read_state(message: msg.RaceState, _: Callable[[str], str]) -> RaceState | None:
    return state_of(message)


def _read_some_state(message: msg.RaceState, _: Callable[[str], str]) -> RaceState:
    state = state_of(message)
    if state is None:
        raise ValueError(f'{message.state} is not a race state')
    return state
