"""Progress and messages on a terminal, in GDAL's manner."""

from __future__ import annotations

from typing import TextIO

_TICKS = 40  #: one tick is 2.5 %; every fourth shows the percentage


class TerminalProgress:
    """Write ``0...10...20...`` to a stream as work goes on, and messages on lines of their own between them.

    Nothing is written before the first call, so that what fails at once leaves the error alone on the stream.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._ticks = -1
        self._line_open = False

    def progress(self, fraction: float, message: str = "") -> bool:
        """Write the ticks up to ``fraction``; never cancels."""
        reached = min(max(int(fraction * _TICKS + 1e-9), 0), _TICKS - 1)  # the last tick is `finish`'s
        new = "".join(map(_tick_text, range(self._ticks + 1, reached + 1)))
        if new:
            self._ticks = reached
            self._write(new)
        return True

    def log(self, message: str) -> None:
        """Write a message on a line of its own."""
        self.break_line()
        self._write(f"{message}\n", line_open=False)

    def finish(self) -> None:
        """Complete the bar, if it was begun."""
        if self._ticks >= 0:
            rest = "".join(map(_tick_text, range(self._ticks + 1, _TICKS + 1)))
            self._write(f"{rest} - done.\n", line_open=False)
            self._ticks = -1

    def break_line(self) -> None:
        """End a line that ticks have begun."""
        if self._line_open:
            self._write("\n", line_open=False)

    def _write(self, text: str, line_open: bool = True) -> None:
        self._stream.write(text)
        self._stream.flush()
        self._line_open = line_open


class SilentTerminal(TerminalProgress):
    """Write nothing."""

    def _write(self, text: str, line_open: bool = True) -> None:
        pass


def _tick_text(tick: int) -> str:
    return str(tick * 100 // _TICKS) if tick % 4 == 0 else "."
