"""The log of runs (`--log`): a text file to which each run adds whole lines, each with its time."""

import os
import re
from collections.abc import Callable, Iterable

from ...hrsi_engine.foundation.dates import run_date
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds

_WARNING = re.compile(r"warning: ?", re.IGNORECASE)


@thresholds
class LOG:
    """What of the progress is logged."""

    step_share: float = threshold(0.05, "", "progress that is worth a line though the message is the same")


_HEAD_BYTES = 4096
_OWN_LINE = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ [A-Z]+ ")
_RPC = re.compile(rb"LINE_?OFF", re.IGNORECASE)


class RunLog:
    """Appends progress and messages to a file, made where missing; each line in one go, so that there are no half ones.

    ``spell`` brings messages into the words of the command line.
    """

    def __init__(self, path: str, spell: Callable[[str], str] = str) -> None:
        self._spell = spell
        self._told, self._message = -1.0, ""
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NONBLOCK, 0o666)
        except OSError as error:
            raise InputError(f"--log {path} cannot be written ({error.strerror}): name another file") from None
        if os.path.isfile(path) and os.path.getsize(path) > 0 and not _part(path, -1).endswith(b"\n"):
            # It ends within a line, as a program that was killed leaves it
            os.write(self._descriptor, b"\n")

    def write(self, kind: str, text: str) -> None:
        """Append a line: its time, what it is (``START``, ``PROGRESS``, ``INFO``, ``WARNING``, ``ERROR``, ``END``)."""
        line = f"{run_date()} {kind:<8} {' '.join(text.split())}\n".encode("utf-8", "backslashreplace")
        size = os.fstat(self._descriptor).st_size
        try:
            written = os.write(self._descriptor, line)
        except OSError:  # a full disk is told where results are written, not here
            written = 0
        if 0 < written < len(line):
            os.ftruncate(self._descriptor, size)

    def progress(self, fraction: float, message: str = "") -> bool:
        """Append how far the work is, where that is news."""
        if message not in ("", self._message) or fraction >= self._told + LOG.step_share:
            self._told, self._message = max(fraction, self._told), message or self._message
            self.write("PROGRESS", f"{100 * self._told:.0f} % {self._message}")
        return True

    def log(self, message: str) -> None:
        """Append a message."""
        found = _WARNING.match(message)
        self.write("WARNING" if found else "INFO", self._spell(message[found.end() :] if found else message))

    def finish(self) -> None:
        """Append that the work is done."""
        self.progress(1.0, "done")


def require_own_file(path: str, words: Iterable[str]) -> None:
    """Raise `InputError` where a log would be written into another file: one that ``words`` name, or no log.

    What stands in a folder or fits a pattern is not named itself: so an existing file has to be a log, or a text that
    is called ``.log`` or ``.txt`` and holds no RPC.
    """
    named = {part.partition("|")[0].lstrip("@") for word in words for part in word.split("=")[-1].split(";")}
    if os.path.realpath(path) in {os.path.realpath(file) for file in named if file}:
        raise InputError(f"--log {path} is an input: name another file")
    head = _part(path, 0)
    is_text = b"\0" not in head and not _RPC.search(head) and path.lower().endswith((".log", ".txt"))
    if head and not is_text and not _OWN_LINE.match(head):
        raise InputError(f"--log {path} exists and is no log: name another file")


def _part(path: str, start: int) -> bytes:
    try:
        with open(path, "rb") as file:
            file.seek(start, os.SEEK_SET if start >= 0 else os.SEEK_END)
            return file.read(_HEAD_BYTES)
    except OSError:
        return b""
