# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A real X screen without a monitor, and a hand on its mouse and keyboard."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import shutil
from string import ascii_lowercase, digits
import subprocess

from evgp_testing.part import Part

_MODIFIERS = {
    'ctrl': 'Control_L',
    'shift': 'Shift_L',
    'altgr': 'Alt_R',
    'caps': 'Caps_Lock',
}
"""Keys that are held down with another one, by their names on the screen's first layout."""


def why_no_screen() -> str:
    """Return what is missing for a screen, and how to install it; empty if nothing is."""
    for program, package in (('Xvfb', 'xvfb'), ('setxkbmap', 'x11-xkb-utils')):
        if shutil.which(program) is None:
            return f"there is no {program}: 'apt-get install {package}'"
    missing = [name for name in ('X11', 'Xtst') if ctypes.util.find_library(name) is None]
    return f"there is no lib{missing[0]}: 'apt-get install libxtst6'" if missing else ''


class Screen(Part):
    """
    An X server of its own (Xvfb), with its mouse and keyboard.

    Clicks and keys go in by the XTEST extension: to a program they are those of a real device.
    """

    width, height = 1366, 768

    def __init__(self) -> None:
        """Start the server, at the first display that is free."""
        reading, writing = os.pipe()
        try:
            self._server = subprocess.Popen(
                f'Xvfb -displayfd {writing} -screen 0 {self.width}x{self.height}x24 '
                '-nolisten tcp -noreset'.split(),
                pass_fds=(writing,),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        finally:
            os.close(writing)
        with os.fdopen(reading) as told:
            number = told.readline().strip()
        if not number:
            self._server.wait()
            raise RuntimeError('Xvfb did not start')
        self.display = f':{number}'
        self._x = ctypes.CDLL(ctypes.util.find_library('X11'))
        self._test = ctypes.CDLL(ctypes.util.find_library('Xtst'))
        self._x.XOpenDisplay.restype = ctypes.c_void_p
        self._x.XStringToKeysym.restype = ctypes.c_ulong
        self._codes: dict[str, int] = {}
        self._open = ctypes.c_void_p(self._x.XOpenDisplay(self.display.encode()))
        assert self._open.value, f'no connection to {self.display}'

    def move(self, x: int, y: int) -> None:
        self._test.XTestFakeMotionEvent(self._open, -1, x, y, ctypes.c_ulong(0))
        self._x.XSync(self._open, 0)

    def right_click(self, x: int, y: int) -> None:
        """Click there with the right mouse button."""
        self.move(x, y)
        self._button(1, 3)
        self._button(0, 3)

    def lay_out(self, layout: str, variant: str = '') -> None:
        """
        Have another layout of the keyboard, as xkb-data names it.

        ``key`` still finds each key where it is on the first layout.
        """
        for name in ('space', 'F12', *ascii_lowercase, *digits, *_MODIFIERS.values()):
            self._code(name)
        subprocess.run(
            ['setxkbmap', '-display', self.display, '-layout', layout, '-variant', variant],
            check=True,
        )

    def click(self, x: int, y: int) -> None:
        self.move(x, y)
        self._button(1)
        self._button(0)

    def key(self, name: str) -> None:
        """Press and release a key by its X name, as 'space' or 'F2'; 'ctrl+r' with a modifier."""
        *modifiers, last = name.split('+')
        codes = [self._code(_MODIFIERS[each]) for each in modifiers]
        codes.append(self._code(last))
        for code in codes:
            self._test.XTestFakeKeyEvent(self._open, code, 1, ctypes.c_ulong(0))
        for code in reversed(codes):
            self._test.XTestFakeKeyEvent(self._open, code, 0, ctypes.c_ulong(0))
        self._x.XSync(self._open, 0)

    def close(self) -> None:
        self._x.XCloseDisplay(self._open)
        self._server.terminate()
        self._server.wait()

    def _button(self, down: int, which: int = 1) -> None:
        self._test.XTestFakeButtonEvent(self._open, which, down, ctypes.c_ulong(0))
        self._x.XSync(self._open, 0)

    def _code(self, name: str) -> int:
        if name in self._codes:
            return self._codes[name]
        symbol = self._x.XStringToKeysym(name.encode())
        assert symbol, f'there is no key {name}'
        code: int = self._x.XKeysymToKeycode(self._open, ctypes.c_ulong(symbol))
        self._codes[name] = code
        return code
