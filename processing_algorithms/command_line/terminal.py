"""Progress and messages of a run: on a terminal, as GDAL's ticks without a terminal, and in a log file."""

import os
import re
import time
from collections.abc import Callable, Iterable
from typing import TextIO

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.interruption import PATIENCE
from ...hrsi_engine.foundation.thresholds import EQUALITY
from ...hrsi_engine.foundation.version import run_date

_TICKS = 40  #: one tick is 2.5 %; every fourth shows the percentage


_REST_COLUMNS = len(" 59:59 min left")


class TerminalProgress:
    """Writes ``0...10...20...`` to a stream as the work proceeds, and messages on separate lines in between.

    Nothing is written before the first call, so that after an immediate failure the stream has the error only.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._ticks = -1
        self._line_open = False

    def progress(self, fraction: float, message: str = "") -> bool:
        """Write the ticks up to ``fraction``; never cancels."""
        reached = min(max(int(fraction * _TICKS + 1e-9), 0), _TICKS - 1)  # the last tick is written by `finish`
        if new := "".join(map(_tick_text, range(self._ticks + 1, reached + 1))):
            self._ticks = reached
            self._write(new)
        return True

    def log(self, message: str) -> None:
        """Write a message on a separate line."""
        self.break_line()
        self._write(f"{message}\n", line_open=False)

    def finish(self) -> None:
        """Complete the ticks, if any were written."""
        if self._ticks >= 0:
            rest = "".join(map(_tick_text, range(self._ticks + 1, _TICKS + 1)))
            self._write(f"{rest} - done.\n", line_open=False)
            self._ticks = -1

    def break_line(self) -> None:
        """End a line with ticks, if one is open."""
        if self._line_open:
            self._write("\n", line_open=False)

    def _write(self, text: str, line_open: bool = True) -> None:
        self._stream.write(text)
        self._stream.flush()
        self._line_open = line_open


class SilentTerminal(TerminalProgress):
    """Writes nothing."""

    def _write(self, text: str, line_open: bool = True) -> None:
        pass


class LiveTerminal(TerminalProgress):
    """One line of the width of the terminal, which is redrawn: message, progress and remaining time.

    stream : a terminal; columns : function that returns its width; now : function that returns seconds
    """

    def __init__(
        self, stream: TextIO, columns: Callable[[], int] | None = None, now: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(stream)
        self._columns = columns or (lambda: _columns_of(stream))
        self._now = now
        self._start = now()
        self._drawn_at = -PATIENCE.again_s
        self._furthest, self._message, self._drawn = 0.0, "", ""

    def progress(self, fraction: float, message: str = "") -> bool:
        """Redraw the line for a new message, or after a minimum time; the progress never decreases."""
        self._furthest = min(max(fraction, self._furthest), 1.0)
        changed, self._message = message not in ("", self._message), message or self._message
        if changed or self._now() - self._drawn_at >= PATIENCE.again_s:
            self._draw()
        return True

    def finish(self) -> None:
        """Replace the line by the duration of the run."""
        if self._drawn_at >= 0.0:
            self._write(f"\r\x1b[Kdone in {spell_duration(self._now() - self._start)}\n", line_open=False)

    def break_line(self) -> None:
        """Erase the line; the next text is written in its place."""
        if self._line_open:
            self._write("\r\x1b[K", line_open=False)

    def log(self, message: str) -> None:
        """Write a message above the line."""
        was_open = self._line_open
        super().log(message)
        if was_open:
            self._draw()

    def _draw(self) -> None:
        """Write the line again, in place of the previous one."""
        self._drawn_at = max(self._now(), 0.0)
        line = progress_line(self._message, self._furthest, self._now() - self._start, self._columns())
        if line != self._drawn or not self._line_open:
            self._drawn = line
            self._write(f"\r{line}\x1b[K")


def progress_line(message: str, fraction: float, elapsed_s: float, columns: int) -> str:
    """Return one line of progress for a number of columns: message, bar, percentage, remaining time."""
    columns -= 1  # a full line would wrap
    is_known = fraction >= EQUALITY.negligible
    rest = f" {spell_duration(elapsed_s * (1.0 - fraction) / fraction)} left" if is_known else ""
    tail = f"{int(100 * fraction + 1e-9):3d} %{rest:<{_REST_COLUMNS}}"
    bar = (columns - len(tail)) // 3
    if bar > 0:
        done = int(fraction * bar + 1e-9)
        tail = f"[{'#' * done}{'.' * (bar - done)}] {tail}"
    room = columns - len(tail) - 1
    shown = message if len(message) <= room else f"{message[: max(room - 1, 0)]}~"
    return f"{shown:<{max(room, 0)}} {tail}"[:columns].rstrip()


def spell_duration(seconds: float) -> str:
    """Return a duration as ``42 s``, ``3:05 min`` or ``2:10 h``."""
    whole = round(seconds)
    if whole < 100:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    return f"{minutes}:{rest:02d} min" if minutes < 100 else f"{minutes // 60}:{minutes % 60:02d} h"


def terminal_of(stream: TextIO, quiet: bool) -> TerminalProgress:
    """Return the progress writer of a stream: silent if ``quiet``, a live line on a terminal, else GDAL's ticks."""
    is_live = not quiet and stream.isatty() and os.environ.get("TERM", "") != "dumb"
    return (SilentTerminal if quiet else LiveTerminal if is_live else TerminalProgress)(stream)


def _columns_of(stream: TextIO) -> int:
    """Return the width of a terminal in characters."""
    try:
        return os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):  # not a terminal any more
        return 80


def _tick_text(tick: int) -> str:
    return str(tick * 100 // _TICKS) if tick % 4 == 0 else "."


_WARNING = re.compile(r"warning: ?", re.IGNORECASE)


_HEAD_BYTES = 4096
_OWN_LINE = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ [A-Z]+ ")
_RPC = re.compile(rb"LINE_?OFF", re.IGNORECASE)


class RunLog:
    """Appends progress and messages to a file, created if missing; each line in one call, so that lines are complete.

    ``spell`` replaces arguments in messages by options of the command line.
    """

    def __init__(self, path: str, spell: Callable[[str], str] = str) -> None:
        self._spell = spell
        self._told, self._message = -1.0, ""
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NONBLOCK, 0o666)
        except OSError as error:
            raise InputError(f"--log {path} cannot be written ({error.strerror}): name another file") from None
        if os.path.isfile(path) and os.path.getsize(path) > 0 and not _part(path, -1).endswith(b"\n"):
            # A killed program may have left an incomplete line at the end
            os.write(self._descriptor, b"\n")

    def write(self, kind: str, text: str) -> None:
        """Append a line with time and kind: ``START``, ``PROGRESS``, ``INFO``, ``WARNING``, ``ERROR``, ``END`` …."""
        line = f"{run_date()} {kind:<8} {' '.join(text.split())}\n".encode("utf-8", "backslashreplace")
        size = os.fstat(self._descriptor).st_size
        try:
            written = os.write(self._descriptor, line)
        except OSError:  # a full disk is reported where results are written
            written = 0
        if 0 < written < len(line):
            os.ftruncate(self._descriptor, size)

    def progress(self, fraction: float, message: str = "") -> bool:
        """Append the progress if the message is new or the progress has increased enough."""
        if message not in ("", self._message) or fraction >= self._told + EQUALITY.negligible:
            self._told, self._message = max(fraction, self._told), message or self._message
            self.write("PROGRESS", f"{100 * self._told:.0f} % {self._message}")
        return True

    def log(self, message: str) -> None:
        """Append a message."""
        found = _WARNING.match(message)
        self.write("WARNING" if found else "INFO", self._spell(message[found.end() :] if found else message))

    def finish(self) -> None:
        """Append the end of the work."""
        self.progress(1.0, "done")


def require_own_file(path: str, words: Iterable[str]) -> None:
    """Raise `InputError` if a log would be appended to another file: an input among ``words``, or no log.

    Files in a folder or of a pattern are not named themselves: an existing file must therefore be a log, or a text
    named ``.log`` or ``.txt`` that contains no RPC.
    """
    named = {part.partition("|")[0].lstrip("@") for word in words for part in word.split("=")[-1].split(";")}
    if os.path.realpath(path) in {os.path.realpath(file) for file in named if file}:
        raise InputError(f"--log {path} is an input: name another file")
    head = _part(path, 0)
    is_text = b"\0" not in head and not _RPC.search(head) and path.lower().endswith((".log", ".txt"))
    if head and not is_text and not _OWN_LINE.match(head):
        raise InputError(f"--log {path} exists and is no log: name another file")


def _part(path: str, start: int) -> bytes:
    """Return up to 4 kB of a file from a position on, or from its end if negative; empty if it cannot be read."""
    try:
        with open(path, "rb") as file:
            file.seek(start, os.SEEK_SET if start >= 0 else os.SEEK_END)
            return file.read(_HEAD_BYTES)
    except OSError:
        return b""
