"""Background tasks say why they have come to nothing; one that the user has cancelled says nothing."""

from __future__ import annotations

import ast
import gc
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from qgis.core import QgsApplication, QgsProcessingFeedback

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.progress import advance
from hrsi.plugin.background_task import BackgroundTask, in_main_thread, run_apart
from hrsi.plugin.provider import PluginAlgorithm
from hrsi.tests.parsed_sources import walk_sources
from hrsi.tests.qgis import tiny
from hrsi.tests.qgis.panels import WITH_CRS, run_in_background, wait_for

#: Qt makes these in the main thread only.
WIDGETS = {"QWidget", "QDialog", "QDockWidget", "QgsMapCanvas", "QgsAbstractProcessingParameterWidgetWrapper"}


class Work(BackgroundTask):
    """Raises what it is given, or goes on until it is cancelled."""

    def __init__(self, error: Exception | None = None, on_end: Callable[[Work], None] | None = None) -> None:
        super().__init__("work", lambda _progress: self.work(), on_end or Work.end)
        self.error, self.ended = error, ""

    def end(self) -> None:
        self.ended = "completed" if self.is_done else "terminated"

    def work(self) -> None:
        if self.error is not None:
            raise self.error
        for step in range(10_000):
            advance(self.progress, step / 10_000, "going on")
            time.sleep(0.002)


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (InputError("gcps.csv: no field 'id'"), "gcps.csv: no field 'id'"),
        (ModuleNotFoundError("No module named 'pyproj'", name="pyproj"), "pip install"),
        (ZeroDivisionError("a fault"), "ZeroDivisionError: a fault"),
    ],
)
def test_failures_are_told(qgis_app, error: Exception, told: str) -> None:
    task = Work(error)
    task.start()
    wait_for(lambda: bool(task.ended))
    assert task.ended == "terminated" and told in task.failure


def test_cancelled_says_nothing(qgis_app) -> None:
    task = Work()
    task.start()
    while not task.isActive():
        QgsApplication.processEvents()
    task.cancel()
    wait_for(lambda: bool(task.ended))
    assert (task.ended, task.failure) == ("terminated", "")


def test_cancel_does_not_wait_for_work_without_reports(qgis_app) -> None:
    """As while loops are compiled: the task ends within two seconds, the work at its next report, which is refused."""
    answers = []

    class Compiling(Work):
        def work(self) -> None:
            time.sleep(4.0)
            answers.append(self.progress(0.5))

    task = Compiling()
    task.start()
    while not task.isActive():
        QgsApplication.processEvents()
    began = time.monotonic()
    task.cancel()
    wait_for(lambda: bool(task.ended))
    assert time.monotonic() - began < 2.0 and (task.ended, task.failure) == ("terminated", "")
    wait_for(lambda: bool(answers))
    assert answers == [False]


def test_work_is_done_in_a_thread_of_python(qgis_app) -> None:
    """A thread of QGIS has a new state in Python at each call, and pyproj 3.7 has freed what it kept there."""
    threads: list[threading.Thread] = []

    class Noting(Work):
        def work(self) -> None:
            threads.append(threading.current_thread())

    task = Noting()
    task.start()
    wait_for(lambda: bool(task.ended))
    assert task.ended == "completed"
    (thread,) = threads
    assert thread is not threading.main_thread() and not isinstance(thread, threading._DummyThread)
    assert run_apart(threading.current_thread) is threading.main_thread()


def test_algorithms_do_so_too(qgis_processing, monkeypatch, tmp_path: Path) -> None:
    threads: list[threading.Thread] = []
    monkeypatch.setattr(tiny, "_fail_as_asked", lambda _text: threads.append(threading.current_thread()))
    given = {"IMAGES": ["/data/a_RPC.TXT"], "OUTPUT_DIR": str(tmp_path / "out")}
    feedback = QgsProcessingFeedback()
    is_done, _results = run_in_background(PluginAlgorithm(tiny.TINY).create(), given, feedback)
    assert is_done, feedback.textLog()
    (thread,) = threads
    assert thread is not threading.main_thread() and not isinstance(thread, threading._DummyThread)


def test_nobody_needs_to_hold_a_task(qgis_app) -> None:
    """What only QGIS knows ends, and tells its end, while Python collects all that nobody holds."""
    failures: list[str] = []
    for number in range(3):
        Work(InputError(str(number)), on_end=lambda task: failures.append(task.failure)).start()
        gc.collect()
    wait_for(lambda: gc.collect() >= 0 and len(failures) == 3)
    assert sorted(failures) == ["0", "1", "2"]


def test_work_is_handed_to_the_main_thread(qgis_app) -> None:
    """Its result, or its error, comes back to the thread that waits."""
    threads = list[threading.Thread]()

    @in_main_thread
    def work(number: int) -> float:
        threads.append(threading.current_thread())
        return 1.0 / number

    results = []
    BackgroundTask("work", lambda _progress: work(4), results.append).start()
    BackgroundTask("work", lambda _progress: work(0), results.append).start()
    wait_for(lambda: len(results) == 2)
    assert threads == [threading.main_thread()] * 2
    assert {task.outcome for task in results} == {0.25, None}
    assert {task.failure for task in results} == {"", "ZeroDivisionError: float division by zero"}


def test_what_has_a_crs_is_made_in_the_main_thread() -> None:
    """In the sources: each use of such a class is in a widget, or in a function that always runs there."""
    uses, allowed = [], 0
    for path, node in walk_sources(WITH_CRS, ["plugin"]):
        if isinstance(node, ast.Module):
            scopes = [part for part in node.body if isinstance(part, (ast.FunctionDef, ast.ClassDef))]
        elif isinstance(node, ast.ClassDef) and WIDGETS.isdisjoint(
            base.id for base in node.bases if hasattr(base, "id")
        ):
            scopes = [part for part in node.body if isinstance(part, ast.FunctionDef)]
        else:
            continue
        for scope in scopes:
            if isinstance(scope, ast.ClassDef):
                continue
            makers = [
                call.func.value if isinstance(call.func, ast.Attribute) else call.func
                for call in ast.walk(scope) if isinstance(call, ast.Call)
            ]  # fmt: skip
            used = {maker.id for maker in makers if isinstance(maker, ast.Name)} & set(WITH_CRS)
            if any(getattr(mark, "id", "") == "in_main_thread" for mark in scope.decorator_list):
                allowed += bool(used)
            elif used:
                uses.append((path.name, scope.name, used))
    assert uses == [] and allowed >= 3
