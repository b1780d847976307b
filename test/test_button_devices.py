# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A stop button on real devices of the kernel (uinput, evdev).

As a program it does all of it, where the kernel has them. As a test it runs that program here, or
else by a command `run-in-vm` in a virtual machine, which is too slow for ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import errno
import fcntl
import os
import pathlib
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import threading
import time

from evgp_rcs_console.button_devices import attend, Keys, why
from evgp_rcs_console.presses import EVENT, PressCounter
import pytest

UNPLUGS = 100
UINPUT = pathlib.Path('/dev/uinput')
SET_EVENT, SET_KEY, SET_STICK, SET_UP = 0x40045564, 0x40045565, 0x40045567, 0x405C5503
CREATE, DESTROY, GET_NAME = 0x5501, 0x5502, 0x8040552C
KEY, ABS = 1, 3


class Pad:
    """A gamepad that the kernel holds for real."""

    def __init__(self) -> None:
        self._hand = os.open(UINPUT, os.O_WRONLY)
        for request, value in ((SET_EVENT, KEY), (SET_EVENT, ABS), (SET_STICK, 0)):
            fcntl.ioctl(self._hand, request, value)
        for key in range(30, 35):
            fcntl.ioctl(self._hand, SET_KEY, key)
        fcntl.ioctl(self._hand, SET_UP, struct.pack('HHHH80sI', 3, 1, 2, 3, b'Test Pad', 0))
        fcntl.ioctl(self._hand, CREATE)
        name = fcntl.ioctl(self._hand, GET_NAME, bytes(64)).partition(b'\0')[0].decode()
        (event,) = pathlib.Path('/sys/devices/virtual/input', name).glob('event*')
        self.path = f'/dev/input/{event.name}'

    def say(self, kind: int, code: int, value: int) -> None:
        os.write(self._hand, EVENT.pack(0, 0, kind, code, value) + EVENT.pack(0, 0, 0, 0, 0))

    def press(self, key: int = 30) -> None:
        """Press a key, and let it go."""
        self.say(KEY, key, 1)
        time.sleep(0.03)
        self.say(KEY, key, 0)
        time.sleep(0.03)

    def unplug(self) -> None:
        fcntl.ioctl(self._hand, DESTROY)
        os.close(self._hand)


class Button:
    """The loop of `rcs_button` on a path, in a thread, and what it tells."""

    def __init__(self, path: pathlib.Path) -> None:
        self.presses, self.pressed, self.trouble, self.looks = PressCounter(), 0, '?', 0
        self._ending = threading.Event()
        given = (str(path), self.presses, self._press, self._look, self._ending)
        self._thread = threading.Thread(target=attend, args=given)
        self._thread.start()

    def _press(self) -> None:
        self.pressed += 1

    def _look(self, trouble: str) -> None:
        self.trouble = trouble
        self.looks += 1

    def close(self) -> None:
        self._ending.set()
        self._thread.join()


def wait_until(found: Callable[[], object]) -> None:
    """Return once something is true."""
    until = time.monotonic() + 30
    while not found():
        assert time.monotonic() < until
        time.sleep(0.001)


@contextlib.contextmanager
def plugged(path: pathlib.Path) -> Iterator[Pad]:
    """Have a pad plugged in by its stable name; it is unplugged at the end."""
    pad = Pad()
    path.symlink_to(pad.path)
    try:
        yield pad
    finally:
        path.unlink()
        pad.unplug()


def check_what_the_kernel_says(path: pathlib.Path) -> None:
    """Check names, keys, the grab, sticks that move, and a queue that runs over."""
    with plugged(path) as pad, contextlib.closing(Keys(str(path))) as keys:
        assert keys.name == 'Test Pad'
        with pytest.raises(OSError, match='busy') as taken:
            Keys(str(path))
        assert taken.value.errno == errno.EBUSY
        pad.say(KEY, 31, 1)
        assert keys.down() == {31}
        for value in range(5000):
            pad.say(ABS, 0, value % 200)
        pad.say(KEY, 31, 0)
        assert list(keys.changes(1.0)) == [(31, False)]
        for _ in range(400):
            pad.say(KEY, 32, 1)
            pad.say(KEY, 32, 0)
        assert None in list(keys.changes(1.0))
    with plugged(path):
        if os.fork() == 0:
            os.setuid(65534)
            try:
                Keys(str(path))
            except OSError as error:
                os._exit('input' not in why(error))
            os._exit(2)
        assert os.waitstatus_to_exitcode(os.wait()[1]) == 0


def check_the_loop(path: pathlib.Path) -> None:
    """Check every press of one that is plugged in and out at random moments."""
    button, dice, slowest = Button(path), random.Random(1), 0.0
    with contextlib.closing(button):
        wait_until(lambda: button.trouble not in ('', '?'))
        for _ in range(UNPLUGS):
            with plugged(path) as pad:
                wait_until(lambda: not button.trouble)
                before = button.pressed
                pad.press()
                wait_until(lambda before=before: button.pressed == before + 1)
                if dice.random() < 0.5:
                    pad.say(KEY, 33, 1)  # it is pulled out with a key that is down
                time.sleep(dice.random() / 10)
            pulled = time.monotonic()
            wait_until(lambda: button.trouble)
            slowest = max(slowest, time.monotonic() - pulled)
        with plugged(path) as pad:
            wait_until(lambda: not button.trouble)
            before = button.pressed + 1
            pad.press(33)  # the kernel let it go
            wait_until(lambda: button.pressed == before)
            for _ in range(100):
                pad.press()
            wait_until(lambda: button.pressed == before + 100)
    pad = Pad()
    pad.say(KEY, 30, 1)
    path.symlink_to(pad.path)
    with contextlib.closing(Button(path)) as held:
        wait_until(lambda: held.looks and held.trouble)
        assert not held.pressed
        pad.say(KEY, 30, 0)
        wait_until(lambda: not held.trouble)
        pad.press()
        wait_until(lambda: held.pressed == 1)
        path.unlink()
        pad.unplug()
        wait_until(lambda: held.trouble)
        pad = Pad()
        pad.say(KEY, 30, 1)
        path.symlink_to(pad.path)
        wait_until(lambda: held.pressed == 2)
    path.unlink()
    pad.unplug()
    print(f'{UNPLUGS} unplugs, each told within {slowest * 1000:.0f} ms')


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_button_on_real_devices() -> None:
    command = [sys.executable, __file__]
    if not os.access(UINPUT, os.W_OK):
        if not shutil.which('run-in-vm'):
            pytest.skip('this kernel has no uinput, and there is no run-in-vm')
        path = os.pathsep.join(each for each in sys.path if each)
        command = ['run-in-vm', '-t', '800', 'env', f'PYTHONPATH={path}', *command]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    print(done.stdout)


if __name__ == '__main__':
    link = pathlib.Path(tempfile.mkdtemp()) / 'button'
    check_what_the_kernel_says(link)
    check_the_loop(link)
