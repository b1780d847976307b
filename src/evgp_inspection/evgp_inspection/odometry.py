# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads the kart's speed from lines of text or from ROS, in place of the inspector's eyes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
import contextlib
import importlib
import math
import os
import pathlib
import threading
from typing import Any

Take = Callable[[float], None]


def speed_in(line: str) -> float | None:
    """
    Return the absolute speed in a line of the form ``speed`` or ``time speed``, in m/s.

    A time in the line is ignored, because what counts is when the line arrives.

    :return: the speed; None if the line has another form.
    """
    words = line.split()
    if len(words) not in (1, 2):
        return None
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return None
    return abs(numbers[-1])


class Lines(asyncio.DatagramProtocol):
    """Reads lines of text from UDP datagrams."""

    def __init__(self, take: Take) -> None:
        self._take = take

    def datagram_received(self, data: bytes, address: object) -> None:
        for line in data.decode('ascii', 'replace').splitlines():
            speed = speed_in(line)
            if speed is not None:
                self._take(speed)


async def listen(source: str, take: Take) -> Callable[[], None]:
    """
    Start to read speeds from a source, in the running loop.

    :param source: ``-`` (standard input), ``udp:PORT`` or ``udp:ADDRESS:PORT``, ``ros:TOPIC``, or
        the path of a file or pipe.
    :return: a function that ends the reading.
    :raises OSError: if the source cannot be used.
    :raises ValueError: if this is not a source.
    :raises ImportError: if ROS is missing.
    """
    loop = asyncio.get_running_loop()

    def hand_over(speed: float) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
            loop.call_soon_threadsafe(take, speed)

    if source.startswith('udp:'):
        address, _, port = source.removeprefix('udp:').rpartition(':')
        if not port.isdecimal():
            raise ValueError(f'--odometry {source} has no port: udp:[ADDRESS:]PORT')
        transport, _ = await loop.create_datagram_endpoint(
            lambda: Lines(take), (address or '127.0.0.1', int(port))
        )
        return transport.close
    if source.startswith('ros:'):
        return _listen_to_ros(source.removeprefix('ros:'), hand_over)
    return _listen_to_file(source, hand_over)


def _listen_to_file(source: str, take: Take) -> Callable[[], None]:
    path = pathlib.Path(source)
    if source != '-' and (path.is_dir() or not os.access(path, os.R_OK)):
        raise OSError(f'--odometry {source} is not a file or pipe that can be read')
    threading.Thread(target=_read, args=(source, take), daemon=True).start()
    return lambda: None


def _read(source: str, take: Take) -> None:
    """Read the speeds in a file, in its own thread because opening a pipe may block forever."""
    path = 0 if source == '-' else source
    with open(path, encoding='ascii', errors='replace', closefd=source != '-') as text:
        for line in text:
            speed = speed_in(line)
            if speed is not None:
                take(speed)


def _listen_to_ros(topic: str, take: Take) -> Callable[[], None]:
    """Subscribe to ``nav_msgs/Odometry``; only this function imports ROS."""
    try:
        rclpy: Any = importlib.import_module('rclpy')  # untyped, and usually not installed
        messages: Any = importlib.import_module('nav_msgs.msg')
    except ImportError as error:
        raise ImportError(
            f'--odometry ros:{topic} needs ROS 2 with nav_msgs in this shell ({error}). '
            'Source it, use setup/in-workspace python src/evgp_inspection kart, or deliver the '
            'speed in another way: udp:PORT, a file or a pipe'
        ) from error
    executors: Any = importlib.import_module('rclpy.executors')
    qos: Any = importlib.import_module('rclpy.qos')
    signals: Any = importlib.import_module('rclpy.signals')

    rclpy.init(signal_handler_options=signals.SignalHandlerOptions.NO)
    node = rclpy.create_node('inspect_kart')

    def heard(odometry: Any) -> None:
        speed = odometry.twist.twist.linear
        take(math.hypot(speed.x, speed.y, speed.z))

    node.create_subscription(messages.Odometry, topic, heard, qos.qos_profile_sensor_data)

    def spin() -> None:
        with contextlib.suppress(executors.ExternalShutdownException):
            rclpy.spin(node)

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()

    def end() -> None:
        rclpy.try_shutdown()
        thread.join(5.0)

    return end
