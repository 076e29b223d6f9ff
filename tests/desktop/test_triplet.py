"""The real triplet in the window: its time beside that of the command line, a table of its progress, and cancelling."""

import resource
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest

from hrsi.hrsi_engine.foundation.version import VERSION
from hrsi.tests.desktop.conftest import DIALOG
from hrsi.tests.desktop.desktop import Desktop

pytestmark = [pytest.mark.programs, pytest.mark.real]
PROGRAM = [sys.executable, "-m", "hrsi"]
COMPILE_S, RUN_S = 300.0, 300.0  # on cores that others keep busy
LARGEST_RATIO = 2.0  # of the times in QGIS and on the command line
LARGEST_STEP_S, LARGEST_STEP = 5.0, 0.03  # seconds without news, or share of the work
CANCEL_S = 2.0
#: Statements for QGIS: a dialog whose progress is noted as (s, %, text).
WATCH = """
import time
NEWS, make_feedback = [], dialog.createFeedback
def watch():
    feedback = make_feedback()
    feedback.progressChanged.connect(lambda percent: NEWS.append((time.monotonic(), percent, None)))
    feedback.progressTextChanged.connect(lambda text: NEWS.append((time.monotonic(), None, text)))
    return feedback
dialog.createFeedback = watch
"""


class News(NamedTuple):
    """A report of progress: seconds since the start, share of the work, text."""

    time_s: float
    share: float
    text: str


def cpu_of_children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run_command_line(images: list[str], folder: Path) -> tuple[float, float]:
    """Return the time and the CPU time (s) of ``hrsi triangulate``."""
    began_s, used_s = time.monotonic(), cpu_of_children_s()
    command = [*PROGRAM, "triangulate", *images, "--output-dir", str(folder), "--overwrite"]
    subprocess.run(command, check=True, capture_output=True)
    return time.monotonic() - began_s, cpu_of_children_s() - used_s


def open_dialog(desktop: Desktop, images: list[str], folder: Path) -> None:
    given = {"IMAGES": images, "OUTPUT_DIR": str(folder)}
    desktop.ask(DIALOG.format(name="hrsi:triangulate", given=given))
    desktop.ask(WATCH)
    desktop.wait("dialog.runButton().isVisible()")


def run_in_window(desktop: Desktop, images: list[str], folder: Path) -> tuple[float, float, list[News]]:
    """Return the time and the CPU time (s) of a run by the button of its dialog, and its reports of progress."""
    open_dialog(desktop, images, folder)
    used_s, began_s = desktop.cpu_s(), desktop.ask("time.monotonic()")
    desktop.click("middle_of(dialog.runButton())")
    desktop.wait("dialog.results()", RUN_S, pause_s=0.5)
    time_s, used_s = desktop.ask("time.monotonic()") - began_s, desktop.cpu_s() - used_s
    news, share, text = [News(0.0, 0.0, "")], 0.0, ""
    for told_s, percent, new_text in desktop.ask("NEWS"):
        share, text = share if percent is None else percent / 100.0, new_text or text
        news.append(News(told_s - began_s, share, text))
    desktop.ask("dialog.close()")
    end = next(number for number, one in enumerate(news) if one.text.startswith("Loading"))  # from there on of QGIS
    return time_s, used_s, news[:end]


def print_progress(news: list[News], end_s: float) -> None:
    """Print one row for each text: time, share, and the remaining time as estimated and as it was."""
    print("    time s  done %  left s: estimated, true")
    for before, one in pairwise(news):
        if one.text.partition("(about")[0] != before.text.partition("(about")[0] and one.share > 0.0:
            left_s = one.time_s * (1.0 - one.share) / one.share
            print(f"    {one.time_s:6.1f} {100 * one.share:7.1f} {left_s:9.1f} {end_s - one.time_s:9.1f}  {one.text}")


def test_triplet_takes_at_most_twice_as_long_in_qgis(start, real_data: Path, tmp_path: Path) -> None:
    """In a stock QGIS with the packages in its profile, whose loops were compiled when the plugin started first."""
    images = [str(real_data / "s2p_triplet_phr" / f"img_0{number}.tif") for number in (1, 2, 3)]
    run_command_line(images, tmp_path / "warm_up")
    desktop = start(compiles=True)
    desktop.ask("from qgis.core import QgsSettings")
    began_s = time.monotonic()
    desktop.wait(f"QgsSettings().value('hrsi/compiled_for') == {VERSION!r}", COMPILE_S)
    print(f"compiled in the background in {time.monotonic() - began_s:.0f} s")
    first = run_command_line(images, tmp_path / "out")
    time_s, used_s, news = run_in_window(desktop, images, tmp_path / "qgis")
    second = run_command_line(images, tmp_path / "out")
    line_s, line_used_s = (sum(pair) / 2.0 for pair in zip(first, second, strict=True))
    print(f"triplet: QGIS {time_s:.1f} s ({used_s:.1f} CPU s), command line {line_s:.1f} s ({line_used_s:.1f} CPU s)")
    print_progress(news, time_s)
    assert time_s < LARGEST_RATIO * line_s
    steps = [(one.time_s - before.time_s, one.share - before.share) for before, one in pairwise(news)]
    print(f"longest time without news: {max(step_s for step_s, _ in steps):.1f} s")
    assert all(step_s <= LARGEST_STEP_S or share <= LARGEST_STEP for step_s, share in steps)
    assert all(one.share >= before.share for before, one in pairwise(news))
    shown = [one for one in news if "left)" in one.text]
    assert shown
    for one in shown:  # as it stands above the bar
        number, unit = one.text.partition("(about ")[2].split()[:2]
        told_s = float(number) * {"s": 1.0, "min": 60.0}[unit]
        assert 0.5 * told_s - 1.0 <= time_s - one.time_s <= 2.0 * told_s + 1.0, one


def test_first_run_is_cancelled_while_loops_are_compiled(start, real_data: Path, tmp_path: Path) -> None:
    """Two seconds after the click the dialog can run again, and then does so to the end."""
    images = [str(real_data / "s2p_triplet_phr" / f"img_0{number}.tif") for number in (1, 2, 3)]
    desktop = start()
    assert not list(desktop.work.rglob("*.nbi")), "the loops are compiled already"
    open_dialog(desktop, images, tmp_path / "out")
    desktop.click("middle_of(dialog.runButton())")
    desktop.wait("any(text and text.startswith('matching') for _, _, text in NEWS)", RUN_S)
    time.sleep(1.0)
    assert not list(desktop.work.rglob("lsm_kernels.match_range*.nbi")), "too late: the loops are compiled"
    began_s = time.monotonic()
    desktop.click("middle_of(dialog.cancelButton())")
    desktop.wait("dialog.runButton().isEnabled()")
    ended_s = time.monotonic() - began_s
    print(f"cancelled while numba compiles: {ended_s:.1f} s")
    desktop.picture("cancelled")
    assert ended_s < CANCEL_S and not (tmp_path / "out" / "report.json").exists()
    desktop.ask("dialog.close()")
    run_in_window(desktop, images, tmp_path / "again")
    assert (tmp_path / "again" / "report.json").exists()
