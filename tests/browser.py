"""A browser without a window, driven through the DevTools protocol: one Chromium for a module, a page at a time.

Commands and events are JSON texts, each ended by a zero byte, on a pair of pipes (``--remote-debugging-pipe``): no
server, no port, no further package. https://chromedevtools.github.io/devtools-protocol has the commands.
"""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

TIMEOUT_S = 60.0
#: Console messages and errors of a page, as they are told.
EVENTS = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
KEY_CODES = {"Enter": 13, "Escape": 27, "Tab": 9, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}


def chromium_program() -> str | None:
    """Return the path of a Chromium, None without."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class Browser:
    """A running Chromium with one page; to be used in a ``with`` statement."""

    def __init__(self, profile: Path) -> None:
        ours_out, theirs_in = os.pipe()[::-1]  # we write what it reads from its descriptor 3
        ours_in, theirs_out = os.pipe()
        program = chromium_program()
        assert program is not None
        command = [
            program, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--remote-debugging-pipe",
            f"--user-data-dir={profile}", "about:blank",
        ]  # fmt: skip
        redirect = f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}'
        self._process = subprocess.Popen(
            ["bash", "-c", redirect, "bash", *command], pass_fds=(theirs_in, theirs_out), stderr=subprocess.DEVNULL
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._out, self._in = os.fdopen(ours_out, "wb", buffering=0), os.fdopen(ours_in, "rb", buffering=0)
        self._rest, self._number, self._session = b"", 0, None
        self.messages: list[str] = []
        self._loaded = False
        page = next(t for t in self.command("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self.command("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.command(f"{domain}.enable")

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._process.kill()
        self._process.wait(TIMEOUT_S)
        self._out.close()
        self._in.close()

    def command(self, method: str, **params: Any) -> dict[str, Any]:
        """Send a command and return its result; events that come before it are kept."""
        self._number += 1
        number = self._number
        session = {"sessionId": self._session} if self._session else {}
        self._out.write(json.dumps({"id": number, "method": method, "params": params, **session}).encode() + b"\0")
        while True:
            message = self._receive()
            if message.get("id") == number:
                assert "error" not in message, (method, message["error"])
                return message["result"]

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._in.fileno(), 1 << 20)
            assert part, "the browser has ended"
            self._rest += part
        text, _, self._rest = self._rest.partition(b"\0")
        message = json.loads(text)
        if message.get("method") in EVENTS:
            self.messages.append(json.dumps(message["params"]))
        self._loaded |= message.get("method") == "Page.loadEventFired"
        return message

    def open(self, page: Path, width: int = 1400, height: int = 900, dark: bool = False, phone: bool = False) -> None:
        """Open a page on a screen of a size, in light or dark, and wait until it is there."""
        self.command(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=phone
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.command("Emulation.setEmulatedMedia", features=[scheme])
        self.messages.clear()
        self._loaded = False
        self.command("Page.navigate", url=page.as_uri())
        end = time.monotonic() + TIMEOUT_S
        while not self._loaded:
            assert time.monotonic() < end, f"{page} does not load"
            self._receive()

    def value(self, expression: str) -> Any:
        """Return the value of a JavaScript expression."""
        found = self.command("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def click(self, selector: str, offset: tuple[float, float] = (0.0, 0.0)) -> None:
        """Click in the middle of an element, as a mouse does; it is scrolled into view first."""
        x, y = self.place_of(selector)
        self._mouse("mousePressed", x + offset[0], y + offset[1])
        self._mouse("mouseReleased", x + offset[0], y + offset[1])

    def drag(self, selector: str, dx: float, dy: float) -> None:
        """Drag from the middle of an element."""
        x, y = self.place_of(selector)
        self._mouse("mousePressed", x, y)
        for part in (0.5, 1.0):
            self._mouse("mouseMoved", x + part * dx, y + part * dy)
        self._mouse("mouseReleased", x + dx, y + dy)

    def wheel(self, selector: str, delta: float, control: bool = False) -> None:
        """Turn the wheel over the middle of an element, with or without the control key."""
        x, y = self.place_of(selector)
        self.command(
            "Input.dispatchMouseEvent",
            type="mouseWheel",
            x=x,
            y=y,
            deltaX=0,
            deltaY=delta,
            modifiers=2 if control else 0,
        )

    def hover(self, selector: str) -> None:
        self._mouse("mouseMoved", *self.place_of(selector))

    def place_of(self, selector: str) -> tuple[float, float]:
        """Return where the middle of an element is on the screen."""
        box = self.value(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)}); if (!e) return null;"
            "e.scrollIntoView({block: 'center', inline: 'center'}); const r = e.getBoundingClientRect();"
            "return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        assert box is not None, f"no element {selector}"
        return box[0], box[1]

    def _mouse(self, kind: str, x: float, y: float) -> None:
        buttons = 1 if kind == "mouseMoved" else 0
        self.command(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left" if kind != "mouseMoved" else "none",
            buttons=buttons, clickCount=1, pointerType="mouse",
        )  # fmt: skip

    def press(self, key: str) -> None:
        """Press and release a key."""
        text = {"text": key} if len(key) == 1 else {"text": "\r"} if key == "Enter" else {}
        code = KEY_CODES.get(key, 0)
        for kind, more in (("keyDown", text), ("keyUp", {})):
            self.command("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **more)

    def select(self, selector: str, value: str) -> None:
        """Choose an entry of a list, as a person does."""
        self.value(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)}); e.value = {json.dumps(value)};"
            "e.dispatchEvent(new Event('change', {bubbles: true})); })()"
        )

    def picture(self, file: Path, whole: bool = True) -> None:
        """Save a picture of the page as PNG: the whole of it, or what the screen shows."""
        size = self.command("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"clip": {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}} if whole else {}
        found = self.command("Page.captureScreenshot", format="png", captureBeyondViewport=whole, **clip)
        file.write_bytes(base64.b64decode(found["data"]))

    def print(self, file: Path) -> None:
        """Print the page to a PDF file (A4)."""
        found = self.command(
            "Page.printToPDF", printBackground=True, preferCSSPageSize=True, paperWidth=8.27, paperHeight=11.69
        )
        file.write_bytes(base64.b64decode(found["data"]))
