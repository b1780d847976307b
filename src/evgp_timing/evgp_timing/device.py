# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The connection to a timing device, by a serial port or TCP."""

from __future__ import annotations

import os
import select
import socket
import termios
from typing import TypeAlias

import serial

CONNECT_TIMEOUT = 2.0
"""Maximum time to connect to a device over TCP, in seconds."""

READ_BYTES = 4096


Device: TypeAlias = serial.Serial | socket.socket
"""An open connection to a device."""


def split(device: str) -> tuple[str, int] | None:
    """
    Return the host and port of a TCP device, or None for the path of a serial port.

    :raises ValueError: if the text is neither.
    """
    if device.startswith('/'):
        return None
    host, _, port = device.rpartition(':')
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(f'{device!r} is neither a path nor host:port')
    return host, int(port)


def connect(device: str, baud: int) -> Device:
    """
    Open the connection to a device.

    :param device: path of a serial port, or host:port.
    :param baud: baud rate of a serial port.
    :raises OSError: if the connection cannot be opened.
    :raises ValueError: if `device` is neither.
    """
    at = split(device)
    if at is None:
        try:
            return serial.Serial(device, baud, exclusive=True)
        except (ValueError, termios.error) as error:  # wrong baud rate, or just unplugged
            raise OSError(str(error)) from error
    connection = socket.create_connection(at, CONNECT_TIMEOUT)
    connection.setblocking(False)
    return connection


def read(device: Device, timeout: float) -> bytes:
    """
    Return the bytes, if any, that arrive within the timeout, in seconds.

    :raises OSError: if the device is gone.
    """
    if not select.select([device], [], [], timeout)[0]:
        return b''
    data = os.read(device.fileno(), READ_BYTES)
    if not data:
        raise ConnectionError('the device closed the connection')
    return data
