# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A stop button whose device is a pseudo-terminal: few test machines have an input device.

As a program it is the real `rcs_button`; what the kernel says of a device by ioctl is all that is
not so. The bytes are those of a real one.
"""

from __future__ import annotations

from collections.abc import Callable
import os
import pathlib
import sys
import tty
from types import SimpleNamespace

from evgp_rcs_console import button, button_devices
from evgp_rcs_console.presses import EVENT
from evgp_rcs_msgs.msg import Presence
from evgp_testing.part import Part
from evgp_testing.process import Program
from evgp_testing.ros_side import RosSide

KEY = 57


def nothing(_: int, request: int, given: int | bytes) -> int | bytes:
    """Answer an ioctl: no key is down, and whatever is asked for is done."""
    return bytes(len(given)) if isinstance(given, bytes) else 0


class StopButton(Part):
    """
    The program and the hand on its device, which is plugged in.

    :param folder: where its device is.
    """

    def __init__(self, folder: pathlib.Path, domain: int, official: str = 'Anna') -> None:
        self._path = folder / 'usb-button'
        self.plug()
        parameters = ['-p', f'device:={self._path}', '-p', f'official:={official}']
        command = [sys.executable, __file__, '--ros-args', *parameters]
        self.program = Program('rcs_button', command, domain)

    def plug(self) -> None:
        self._line, self._port = os.openpty()
        tty.setraw(self._port)
        self._path.symlink_to(os.ttyname(self._port))

    def unplug(self) -> None:
        self._path.unlink()
        os.close(self._port)
        os.close(self._line)

    def move(self, down: bool, key: int = KEY) -> None:
        """Let a key go down or up."""
        os.write(self._line, EVENT.pack(0, 0, 1, key, down) + EVENT.pack(0, 0, 0, 0, 0))

    def close(self) -> None:
        self.program.close()
        if self._path.is_symlink():
            self.unplug()


class Ear(RosSide):
    """Whoever hears that somebody is there; `heard` has it all."""

    def __init__(self, domain: int) -> None:
        super().__init__('ear', domain)
        self.heard: list[Presence] = self.hear(Presence, '/rcs/presence')
        self.spin()

    def wait_for(self, found: Callable[[Presence], object], since: int = 0) -> Presence:
        """Return the first message, from one on, for which something is true."""
        return self.wait_until(
            lambda: next((each for each in self.heard[since:] if found(each)), None),
            lambda: f'such a presence; heard last: {self.heard[-3:]}',
        )

    def wait_for_working(self) -> None:
        """Return once the button says from now on that it works."""
        self.wait_for(lambda each: not each.fault, len(self.heard))


if __name__ == '__main__':
    vars(button_devices).update(fcntl=SimpleNamespace(ioctl=nothing))
    sys.exit(button.main())
