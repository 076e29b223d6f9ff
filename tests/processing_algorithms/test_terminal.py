"""Progress looks as GDAL's does, which is written here by GDAL itself for comparison."""

import io
import re
import subprocess
import sys

import pytest

from hrsi.processing_algorithms.command_line.terminal import (
    LiveTerminal,
    SilentTerminal,
    TerminalProgress,
    progress_line,
    terminal_of,
)


def gdal_bar(fractions: list[float]) -> str:
    """Return what GDAL's own progress function writes to the terminal."""
    code = f"from osgeo import gdal\nfor fraction in {fractions}: gdal.TermProgress_nocb(fraction)"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def our_bar(fractions: list[float]) -> str:
    stream = io.StringIO()
    terminal = TerminalProgress(stream)
    for fraction in fractions:
        terminal.progress(fraction)
    terminal.finish()
    return stream.getvalue()


@pytest.mark.parametrize(
    "fractions",
    [[0.0, 1.0], [0.0, 0.1, 0.33, 0.331, 1.0], [step / 1000 for step in range(1001)]],
    ids=["at once", "uneven", "fine"],
)
def test_same_as_gdal(fractions):
    assert our_bar(fractions) == gdal_bar(fractions)


def test_never_runs_backwards_or_beyond():
    assert our_bar([0.5, 0.2, 2.0, -1.0]) == our_bar([0.0, 1.0])


def test_nothing_where_nothing_was_reported():
    assert our_bar([]) == ""


def test_messages_stand_on_lines_of_their_own():
    stream = io.StringIO()
    terminal = TerminalProgress(stream)
    terminal.log("first")
    terminal.progress(0.1)
    terminal.log("second")
    terminal.progress(0.125)
    terminal.break_line()
    terminal.break_line()
    assert stream.getvalue() == "first\n0...10\nsecond\n.\n"


def test_silent_terminal():
    stream = io.StringIO()
    terminal = SilentTerminal(stream)
    assert terminal.progress(0.5)
    terminal.log("message")
    terminal.finish()
    assert stream.getvalue() == ""


class Screen(io.StringIO):
    """A terminal, and what it shows: the last line drawn."""

    def isatty(self) -> bool:
        return True

    @property
    def shown(self) -> str:
        return self.getvalue().rpartition("\r")[2].removesuffix("\x1b[K")


@pytest.mark.parametrize("columns", [10, 24, 40, 80, 200])
@pytest.mark.parametrize("message", ["", "matching image_1 (3 of 12 parts done)", "x" * 300])
def test_a_line_of_progress_fits_its_terminal(columns, message):
    for fraction, elapsed in ((0.0, 0.0), (0.5, 90.0), (0.021, 90_000.0), (1.0, 1e5)):
        line = progress_line(message, fraction, elapsed, columns)
        assert len(line) < max(columns, 20)
        assert f"{int(100 * fraction)} %" in line


def test_live_progress_tells_name_share_and_remaining_time():
    seconds = [0.0]
    screen = Screen()
    terminal = LiveTerminal(screen, columns=lambda: 90, now=lambda: seconds[0])
    terminal.progress(0.0, "reading")
    seconds[0] = 60.0
    terminal.progress(0.25, "matching image_1 (3 of 12 parts done)")
    assert screen.shown.startswith("matching image_1 (3 of 12 parts done)")
    assert re.search(r"\[#+\.+\] +25 % 3:00 min left$", screen.shown)  # a quarter in 60 s: three more of them
    terminal.log("a message")
    assert "\r\x1b[Ka message\n" in screen.getvalue()  # the line goes, the message stays, the line comes again
    assert screen.shown.startswith("matching")
    terminal.finish()
    assert screen.getvalue().endswith("\r\x1b[Kdone in 60 s\n")


def test_live_progress_is_drawn_no_faster_than_it_is_read():
    seconds = [0.0]
    screen = Screen()
    terminal = LiveTerminal(screen, columns=lambda: 80, now=lambda: seconds[0])
    for step in range(1000):
        seconds[0] = step / 1000.0
        terminal.progress(step / 1000.0, "one stage")
    assert screen.getvalue().count("\r") <= 12


def test_terminal_fits_the_stream(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    assert type(terminal_of(Screen(), quiet=False)) is LiveTerminal
    assert type(terminal_of(Screen(), quiet=True)) is SilentTerminal
    assert type(terminal_of(io.StringIO(), quiet=False)) is TerminalProgress
    monkeypatch.setenv("TERM", "dumb")
    assert type(terminal_of(Screen(), quiet=False)) is TerminalProgress
