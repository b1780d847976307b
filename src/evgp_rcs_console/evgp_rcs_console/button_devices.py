# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The device of a stop button: an input device, each key of which is a press.

The module reads the device directly from the kernel (linux/input.h), without a library, so that no
read can hang. It does not use ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
import contextlib
import ctypes
import errno
import fcntl
import math
import os
import pathlib
import select
import struct
import threading

from evgp_protocol.clock import now
from evgp_rcs_console.presses import changes, EVENT, PressCounter

BUTTON_LOOK = 0.1
"""Maximum time for which only the device is watched, in seconds."""

REOPEN = 0.25
"""Time between two attempts to open a missing device, in seconds."""

INPUT = pathlib.Path('/dev/input')
SYS = pathlib.Path('/sys/class/input')

_KEYS = 768 // 8
"""Size of the bit field with one bit per key, in bytes."""

# EVIOCGNAME, EVIOCGKEY, EVIOCGRAB and EVIOCSMASK of linux/input.h.
GET_NAME, GET_KEYS_DOWN, GRAB, SET_MASK = 0x81004506, 0x80604518, 0x40044590, 0x40104593


class Keys:
    """
    An input device.

    :raises OSError: if it cannot be opened. EBUSY means that another program holds it.
    """

    def __init__(self, path: str) -> None:
        """Open the device for its keys only: a moving joystick must not push out key events."""
        self.descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            wanted = ctypes.c_uint64(1 << 0 | 1 << 1)  # EV_SYN, EV_KEY
            mask = struct.pack('IIQ', 0, ctypes.sizeof(wanted), ctypes.addressof(wanted))
            fcntl.ioctl(self.descriptor, SET_MASK, mask)
            self.grab(True)
        except OSError:
            self.close()
            raise

    @property
    def name(self) -> str:
        return self._ask(GET_NAME, 256).partition(b'\0')[0].decode(errors='replace')

    def grab(self, mine: bool) -> None:
        """Take the device for this program alone, so that its keys type nowhere, or release it."""
        fcntl.ioctl(self.descriptor, GRAB, int(mine))

    def down(self) -> frozenset[int]:
        """Return the keys that are down. The kernel then drops their unread changes."""
        bits = int.from_bytes(self._ask(GET_KEYS_DOWN, _KEYS), 'little')
        return frozenset(key for key in range(_KEYS * 8) if bits >> key & 1)

    def changes(self, timeout: float) -> Iterable[tuple[int, bool] | None]:
        """Wait for changes, at most for a time in seconds, and return them."""
        if not select.select([self.descriptor], [], [], timeout)[0]:
            return ()
        data = os.read(self.descriptor, 64 * EVENT.size)
        if not data:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        return tuple(changes(data))

    def close(self) -> None:
        os.close(self.descriptor)

    def _ask(self, request: int, size: int) -> bytes:
        return fcntl.ioctl(self.descriptor, request, bytes(size))


def is_asleep(path: str) -> bool:
    """Return whether the USB device of an input device is suspended, so that keys may not work."""
    folder = (SYS / pathlib.Path(path).resolve().name / 'device').resolve()
    for each in folder.parents:
        try:
            if (each / 'idVendor').exists():
                return (each / 'power/runtime_status').read_text().strip() == 'suspended'
        except OSError:
            pass
    return False


def why(error: OSError) -> str:
    """Return why a device cannot be read and what to do, as a sentence."""
    return {
        errno.EACCES: 'This user is not allowed to read the device. Run sudo usermod -aG input '
        '$USER, then log out and back in',
        errno.EBUSY: 'Another program holds the device. End that program',
        **dict.fromkeys(
            (errno.EIO, errno.ENODEV, errno.ENOENT, errno.ENXIO),
            'The device is not connected. Plug it in',
        ),
    }.get(error.errno or 0, f'The device cannot be read: {error}')


def attend(
    path: str,
    presses: PressCounter,
    on_press: Callable[[], object],
    on_look: Callable[[str], object],
    ending: threading.Event,
) -> None:
    """
    Handle every press until `ending` is set. Whenever the device is gone, reopen it.

    :param on_press: called at each press.
    :param on_look: called at least every `REOPEN`, with the device's fault or an empty text.
    """
    held = 'A key is held down. Release it so that it can send ALL KILL again'
    asleep = 'The USB port is asleep. Turn USB power saving off'
    while not ending.is_set():
        try:
            with contextlib.closing(Keys(path)) as device:
                if presses.look(device.down(), now()):
                    on_press()
                looked_at = -math.inf
                while not ending.is_set():
                    at = now()
                    if at - looked_at >= BUTTON_LOOK:
                        looked_at = at
                        on_look(held if presses.is_held(at) else asleep if is_asleep(path) else '')
                    for change in device.changes(BUTTON_LOOK):
                        if change is None:
                            presses.miss(device.down(), now())
                            on_press()
                            break  # the other changes read with it are older
                        if presses.take(*change, now()):
                            on_press()
        except OSError as error:
            on_look(why(error))
            ending.wait(REOPEN)


def stable_paths() -> list[str]:
    """Return the path of every input device; if it has one that never changes, that path."""
    found = {path.resolve(): path for path in sorted(INPUT.glob('event*'))}
    for folder in ('by-path', 'by-id'):
        found |= {path.resolve(): path for path in sorted((INPUT / folder).glob('*event*'))}
    return [str(path) for path in found.values()]
