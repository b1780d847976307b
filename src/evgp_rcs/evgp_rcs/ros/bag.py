# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes bags of ROS messages in the MCAP format, for Foxglove, PlotJuggler and ``ros2 bag``."""

from __future__ import annotations

from collections.abc import Iterable
import pathlib
import re
from typing import Any

from ament_index_python.packages import get_package_share_directory
from mcap.writer import Writer
from rclpy.serialization import serialize_message

_NESTED = re.compile(r'([a-z][a-z0-9_]*)/([A-Z]\w*)')


def definition(message: Any) -> str:
    """Return the definition of a message type and of every type in it, in MCAP's format."""
    texts = [_source(*_name(message))]
    known = {_name(message)}
    waiting = [message]
    while waiting:
        for kind in waiting.pop().get_fields_and_field_types().values():
            for name in _NESTED.findall(kind):
                if name not in known:
                    known.add(name)
                    texts.append(f'{"=" * 80}\nMSG: {"/".join(name)}\n{_source(*name)}')
                    waiting.append(_class(*name))
    return '\n'.join(texts)


def _name(message: Any) -> tuple[str, str]:
    package, _, _ = message.__module__.partition('.')
    return package, message.__name__


def _class(package: str, name: str) -> Any:
    return getattr(__import__(f'{package}.msg', fromlist=[name]), name)


def _source(package: str, name: str) -> str:
    share = get_package_share_directory(package)
    return pathlib.Path(share, 'msg', f'{name}.msg').read_text('utf-8')


def write_bag(path: pathlib.Path, messages: Iterable[tuple[str, int, Any]]) -> int:
    """
    Write messages to a new bag, and return how many were written.

    :param messages: the topic, wall time of publication (in ns since the epoch) and content of
        each message.
    :raises FileExistsError: if the file exists already. It is not changed.
    :raises OSError: if the file cannot be written. It is then removed.
    """
    channels: dict[str, int] = {}
    written = 0
    with path.open('xb') as stream:
        try:
            writer: Any = Writer(stream)
            writer.start(profile='ros2', library='evgp_rcs')
            for topic, wall_ns, message in messages:
                if topic not in channels:
                    kind = type(message)
                    name, source = '/msg/'.join(_name(kind)), definition(kind).encode()
                    schema = writer.register_schema(name, 'ros2msg', source)
                    channels[topic] = writer.register_channel(topic, 'cdr', schema)
                data = serialize_message(message)
                writer.add_message(channels[topic], wall_ns, data, wall_ns)
                written += 1
            writer.finish()
        except BaseException:
            path.unlink()
            raise
    return written
