# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Declares a node's parameters, with meaning and range, and refuses wrong ones in one sentence.

``rclpy`` ignores undeclared parameters, so a misspelt key in a file would silently leave the
default in effect. Our nodes instead refuse to start, and suggest the right name.
"""

from __future__ import annotations

import difflib
import ipaddress
import sys
from typing import Any, TypeVar

from evgp_node.graph import fence_graph
from evgp_node.parameter_files import ignored
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

T = TypeVar('T', bool, int, float, str, list[float], list[str])

_ROS_OWN = ('use_sim_time', 'start_type_description_service', 'qos_overrides')
_IN_WORDS = {
    bool: 'true or false',
    int: 'a whole number',
    float: 'a number with a point',
    str: 'a text',
}


class ParameterError(ValueError):
    """A parameter is wrong. The text says which one, why, and what to do."""


def check_address(name: str, address: str) -> None:
    """
    Check that the value of a parameter is an IPv4 address.

    :raises ParameterError: if it is not.
    """
    try:
        ipaddress.IPv4Address(address)
    except ipaddress.AddressValueError as error:
        raise ParameterError(
            f'parameter {name}: {address!r} is not an IPv4 address ({error}). '
            'Set one such as 10.0.0.1'
        ) from error


class StrictNode(Node):
    """
    A node that refuses parameters that it has not declared.

    :ivar beside: other nodes of the process, each with its own thread, that only offer services.
    :raises ParameterError: if a parameter has no value.
    :raises GraphError: if the graph cannot be fenced (``graph.fence_graph``).
    """

    beside: tuple[Node, ...] = ()

    def __init__(self, name: str, **node_options: Any) -> None:
        try:
            super().__init__(
                name, automatically_declare_parameters_from_overrides=True, **node_options
            )
        except ValueError as error:
            raise ParameterError(
                f'a parameter has no value ({error}). Set one; a list must not be empty'
            ) from error
        fence_graph()
        self._declared_names: list[str] = []
        self._given_names = {
            name
            for name in self.get_parameters_by_prefix('')
            if name.split('.')[0] not in _ROS_OWN
        }
        for name in self._given_names:
            self.undeclare_parameter(name)

    def close(self) -> None:
        """End the node's threads and leave everything safe. ROS is still running."""

    def declare(
        self, name: str, default: T, meaning: str, limits: tuple[float, float] | None = None
    ) -> T:
        """
        Declare a read-only parameter and return its value.

        :param default: the default value, which also determines the type.
        :param meaning: what the parameter means, with its unit.
        :param limits: minimum and maximum of a number; None for no limits.
        :raises ParameterError: if the value has another type or is outside the limits.
        """
        descriptor = ParameterDescriptor(description=meaning, read_only=True)
        of_texts = isinstance(default, list) and isinstance(default[0], str)
        of_what = 'texts, like [Anna, Ben]' if of_texts else 'numbers with points, like [1.0, 2.0]'
        right = _IN_WORDS.get(type(default), f'a list of {of_what}')
        if limits is not None:
            least, greatest = limits
            right += f' from {least:g} to {greatest:g}'
            if isinstance(default, int):
                descriptor.integer_range = [
                    IntegerRange(from_value=int(least), to_value=int(greatest), step=1)
                ]
            else:
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=float(least), to_value=float(greatest))
                ]
        self._declared_names.append(name)
        try:
            value: T = self.declare_parameter(name, default, descriptor).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(f'parameter {name}: {error}. Set {right}') from error
        return value

    def refuse_unknown(self, own_file: bool = False) -> None:
        """
        Refuse parameters that were set but not declared. Call this after the last ``declare``.

        :param own_file: whether to refuse sections for other nodes in a parameter file as well.
        :raises ParameterError: if there is such a parameter, such a section or a duplicate key.
        """
        for name in sorted(self._given_names - set(self._declared_names)):
            meant = difflib.get_close_matches(name, self._declared_names, n=1)
            known = f'did you mean {meant[0]}?' if meant else 'known: '
            if not meant:
                known += ', '.join(self._declared_names) or 'none'
            raise ParameterError(f'parameter {name} is unknown; {known}')
        for fault in ignored(sys.argv, self.get_fully_qualified_name(), own_file):
            raise ParameterError(fault)
