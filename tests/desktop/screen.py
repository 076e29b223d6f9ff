"""A virtual screen with a keyboard and a mouse: Xvfb, and events of the X server itself (XTest).

What arrives in a program comes through the same doors as from a user: the X server's event queue, Qt's platform
plugin, its focus, shortcuts and grabs.
"""

import ctypes
import ctypes.util
import os
import subprocess
import time
from typing import Any

SIZE_PX = (1600, 1000)
LEFT = 1
#: Names of X keysyms for characters that are none themselves.
KEYSYMS = {" ": "space", ".": "period", ",": "comma", "-": "minus", "_": "underscore", "/": "slash", ":": "colon",
           '"': "quotedbl"}  # fmt: skip
SHIFTED = set('ABCDEFGHIJKLMNOPQRSTUVWXYZ_:"?')
MODIFIERS = {"Ctrl": "Control_L", "Shift": "Shift_L", "Alt": "Alt_L"}
PAUSE_S, KEY_PAUSE_S = 0.02, 0.003  # between events of the mouse, and of the keyboard


class Screen:
    """An X server of its own; `close` ends it."""

    def __init__(self, size_px: tuple[int, int] = SIZE_PX) -> None:
        read, write = os.pipe()
        self.size_px = size_px
        command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "{}x{}x24".format(*size_px), "-nolisten", "tcp"]
        self._server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as answer:
            self.name = f":{answer.readline().strip()}"
        self._x, self._test = (ctypes.CDLL(f"lib{name}.so.6") for name in ("X11", "Xtst"))
        self._x.XOpenDisplay.restype = ctypes.c_void_p
        self._x.XStringToKeysym.restype = ctypes.c_ulong
        self._x.XKeysymToKeycode.argtypes = [ctypes.c_void_p, ctypes.c_ulong]
        self.releases = 0  # of buttons and keys, sent so far
        self._display = ctypes.c_void_p(self._x.XOpenDisplay(self.name.encode()))

    def close(self) -> None:
        self._x.XCloseDisplay(self._display)
        self._server.terminate()
        self._server.wait()

    def move(self, x: int, y: int) -> None:
        self._send(self._test.XTestFakeMotionEvent, -1, x, y)

    def click(self, x: int, y: int, times: int = 1, button: int = LEFT) -> None:
        """Move there, press and release."""
        self.move(x, y)
        for _ in range(times):
            self._send(self._test.XTestFakeButtonEvent, button, True)
            self._send(self._test.XTestFakeButtonEvent, button, False)
            self.releases += 1

    def drag(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """Press the left button at a place and release it at another."""
        self.move(*start)
        self._send(self._test.XTestFakeButtonEvent, LEFT, True)
        for part in (0.3, 0.6, 1.0):
            self.move(*(round(a + part * (b - a)) for a, b in zip(start, end, strict=True)))
        self._send(self._test.XTestFakeButtonEvent, LEFT, False)
        self.releases += 1

    def press(self, keys: str) -> None:
        """Press a key with its modifiers, such as ``F5``, ``Ctrl+Shift+Z``, ``Return``."""
        *modifiers, key = keys.split("+")
        codes = [self._code(MODIFIERS[name]) for name in modifiers] + [self._code(key)]
        for code in codes:
            self._send(self._test.XTestFakeKeyEvent, code, True, pause_s=KEY_PAUSE_S)
        for code in reversed(codes):
            self._send(self._test.XTestFakeKeyEvent, code, False, pause_s=KEY_PAUSE_S)
            self.releases += 1

    def write(self, text: str) -> None:
        """Type a text on an American keyboard."""
        for character in text:
            key = KEYSYMS.get(character, character)
            self.press(f"Shift+{key}" if character in SHIFTED else key)

    def _code(self, key: str) -> int:
        symbol = self._x.XStringToKeysym(key.encode())
        if not symbol:
            raise ValueError(f"no key is named {key!r}")
        return int(self._x.XKeysymToKeycode(self._display, symbol))

    def _send(self, event: Any, *arguments: Any, pause_s: float = PAUSE_S) -> None:
        event(self._display, *arguments, 0)
        self._x.XFlush(self._display)
        time.sleep(pause_s)
