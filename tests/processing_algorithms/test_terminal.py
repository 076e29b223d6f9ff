"""Progress looks as GDAL's does, which is written here by GDAL itself for comparison."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest

from hrsi.processing_algorithms.interface.terminal import SilentTerminal, TerminalProgress


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
