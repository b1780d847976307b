# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads the kart's speed from UDP or from ROS, in place of the inspector's eyes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
import contextlib
import importlib
import math
import threading
from typing import Any

from evgp_inspection.traces import printable

Take = Callable[[float], None]


class Datagrams(asyncio.DatagramProtocol):
    """Reads UDP datagrams, each of which is a speed in m/s, as text."""

    def __init__(self, take: Take, tell: Callable[[str], object]) -> None:
        self._take, self._tell = take, tell

    def datagram_received(self, data: bytes, address: object) -> None:
        try:
            speed = abs(float(data))
        except ValueError:
            what = printable(data)
            self._tell(
                f'  !  Ignored odometry: a datagram must be one speed in m/s, not "{what}".'
            )
            self._tell = lambda line: None
            return
        self._take(speed)


async def listen(source: str, take: Take, tell: Callable[[str], object]) -> Callable[[], None]:
    """
    Start to read speeds from a source, in the running loop.

    :param source: ``udp:PORT``, ``udp:ADDRESS:PORT`` or ``ros:TOPIC``.
    :param tell: called with a sentence about the first datagram that is not a speed.
    :return: a function that ends the reading.
    :raises OSError: if the source cannot be used.
    :raises ValueError: if this is not a source.
    :raises ImportError: if ROS is missing.
    """
    loop = asyncio.get_running_loop()

    def hand_over(speed: float) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
            loop.call_soon_threadsafe(take, speed)

    if source.startswith('ros:'):
        return _listen_to_ros(source.removeprefix('ros:'), hand_over)
    address, _, port = source.removeprefix('udp:').rpartition(':')
    if not (source.startswith('udp:') and port.isdecimal()):
        raise ValueError(f'--odometry {source} is neither udp:[ADDRESS:]PORT nor ros:/TOPIC')
    transport, _ = await loop.create_datagram_endpoint(
        lambda: Datagrams(take, tell), (address or '127.0.0.1', int(port))
    )
    return transport.close


def _listen_to_ros(topic: str, take: Take) -> Callable[[], None]:
    """Subscribe to ``nav_msgs/Odometry``; only this function imports ROS."""
    try:
        rclpy: Any = importlib.import_module('rclpy')  # untyped, and usually not installed
        messages: Any = importlib.import_module('nav_msgs.msg')
    except ImportError as error:
        raise ImportError(
            f'--odometry ros:{topic} needs ROS 2 with nav_msgs in this shell ({error}). '
            'Source it, use setup/in-workspace python src/evgp_inspection kart, or send the speed '
            'to udp:PORT'
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
