"""Progress and messages on a terminal, and in GDAL's manner where there is none."""

import os
import time
from collections.abc import Callable
from typing import TextIO

from ...hrsi_engine.foundation.thresholds import threshold, thresholds

_TICKS = 40  #: one tick is 2.5 %; every fourth shows the percentage


@thresholds
class LIVE_LINE:
    """When and how wide the live line of progress is drawn."""

    redraw_s: float = threshold(0.1, "s", "least time between two drawings")
    foreseen_share: float = threshold(0.02, "", "share of the work from which the rest is foreseen")
    foreseen_s: float = threshold(3.0, "s", "time of work from which the rest is foreseen")
    least_columns: int = threshold(20, "characters", "narrowest line")
    least_bar: int = threshold(6, "characters", "narrowest bar; below, there is none")
    most_bar: int = threshold(30, "characters", "widest bar")


_REST_COLUMNS = len(" 59:59 min left")


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


class LiveTerminal(TerminalProgress):
    """One line, as wide as the terminal and drawn again and again: what is done, how far it is, how long it will take.

    stream : a terminal; columns : returns its width; now : returns seconds
    """

    def __init__(
        self, stream: TextIO, columns: Callable[[], int] | None = None, now: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(stream)
        self._columns = columns or (lambda: _columns_of(stream))
        self._now = now
        self._start = now()
        self._drawn_at = -LIVE_LINE.redraw_s
        self._furthest, self._message, self._drawn = 0.0, "", ""

    def progress(self, fraction: float, message: str = "") -> bool:
        """Draw the line again, but not all too often; the bar never goes back."""
        self._furthest = min(max(fraction, self._furthest), 1.0)
        changed, self._message = message not in ("", self._message), message or self._message
        if changed or self._now() - self._drawn_at >= LIVE_LINE.redraw_s:
            self._draw()
        return True

    def finish(self) -> None:
        """Leave a line that says how long it took."""
        if self._drawn_at >= 0.0:
            self._erase()
            self._write(f"done in {spell_duration(self._now() - self._start)}\n", line_open=False)

    def break_line(self) -> None:
        """Erase the line: what is written next takes its place."""
        if self._line_open:
            self._erase()
            self._line_open = False

    def log(self, message: str) -> None:
        """Write a message above the line."""
        was_open = self._line_open
        super().log(message)
        if was_open:
            self._draw()

    def _draw(self) -> None:
        self._drawn_at = max(self._now(), 0.0)
        line = progress_line(self._message, self._furthest, self._now() - self._start, self._columns())
        if line != self._drawn or not self._line_open:
            self._drawn = line
            self._write(f"\r{line}\x1b[K")

    def _erase(self) -> None:
        self._write("\r\x1b[K")


def progress_line(message: str, fraction: float, elapsed_s: float, columns: int) -> str:
    """Return one line of progress that fits in a number of columns: message, bar, share, time that remains."""
    columns = max(columns, LIVE_LINE.least_columns) - 1  # a full line would break
    rest = ""
    if fraction >= LIVE_LINE.foreseen_share and elapsed_s >= LIVE_LINE.foreseen_s:
        rest = f" {spell_duration(elapsed_s * (1.0 - fraction) / fraction)} left"
    tail = f"{int(100 * fraction + 1e-9):3d} %{rest:<{_REST_COLUMNS}}"
    bar = min(LIVE_LINE.most_bar, (columns - len(tail)) // 3)
    if bar >= LIVE_LINE.least_bar:
        done = int(fraction * bar + 1e-9)
        tail = f"[{'#' * done}{'.' * (bar - done)}] {tail}"
    room = columns - len(tail) - 1
    shown = message if len(message) <= room else f"{message[: max(room - 1, 0)]}~"
    return f"{shown:<{max(room, 0)}} {tail}"[:columns].rstrip()


def spell_duration(seconds: float) -> str:
    """Return a time as people say it: ``42 s``, ``3:05 min``, ``2:10 h``."""
    whole = round(seconds)
    if whole < 100:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    return f"{minutes}:{rest:02d} min" if minutes < 100 else f"{minutes // 60}:{minutes % 60:02d} h"


def terminal_of(stream: TextIO, quiet: bool) -> TerminalProgress:
    """Return the progress writer of a stream: silent where ``quiet``, a live line on a terminal, else GDAL's ticks."""
    if quiet:
        return SilentTerminal(stream)
    is_live = stream.isatty() and os.environ.get("TERM", "") != "dumb"
    return LiveTerminal(stream) if is_live else TerminalProgress(stream)


def _columns_of(stream: TextIO) -> int:
    try:
        return os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):  # no terminal any more
        return 80


def _tick_text(tick: int) -> str:
    return str(tick * 100 // _TICKS) if tick % 4 == 0 else "."
