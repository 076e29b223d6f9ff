"""Background tasks say why they have come to nothing; one that the user has cancelled says nothing."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from qgis.core import QgsApplication, QgsProcessingAlgRunnerTask, QgsProcessingContext, QgsProcessingFeedback

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.progress import advance
from hrsi.plugin.background_task import BackgroundTask, run_apart
from hrsi.plugin.provider import PluginAlgorithm
from hrsi.tests.qgis import tiny


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


def wait_for(task: Work) -> None:
    end = time.monotonic() + 30.0
    while not task.ended:
        assert time.monotonic() < end, "waited in vain"
        QgsApplication.processEvents()


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
    wait_for(task)
    assert task.ended == "terminated" and told in task.failure


def test_cancelled_says_nothing(qgis_app) -> None:
    task = Work()
    task.start()
    while not task.isActive():
        QgsApplication.processEvents()
    task.cancel()
    wait_for(task)
    assert (task.ended, task.failure) == ("terminated", "")


def test_work_is_done_in_a_thread_of_python(qgis_app) -> None:
    """A thread of QGIS has a new state in Python at each call, and pyproj 3.7 has freed what it kept there."""
    threads: list[threading.Thread] = []

    class Noting(Work):
        def work(self) -> None:
            threads.append(threading.current_thread())

    task = Noting()
    task.start()
    wait_for(task)
    assert task.ended == "completed"
    (thread,) = threads
    assert thread is not threading.main_thread() and not isinstance(thread, threading._DummyThread)
    assert run_apart(threading.current_thread) is threading.main_thread()


def test_algorithms_do_so_too(qgis_processing, monkeypatch, tmp_path: Path) -> None:
    threads: list[threading.Thread] = []
    monkeypatch.setattr(tiny, "_fail_as_asked", lambda _text: threads.append(threading.current_thread()))
    context, feedback = QgsProcessingContext(), QgsProcessingFeedback()
    given = {"IMAGES": ["/data/a_RPC.TXT"], "OUTPUT_DIR": str(tmp_path / "out")}
    algorithm, ended = PluginAlgorithm(tiny.TINY).create(), list[bool]()
    task = QgsProcessingAlgRunnerTask(algorithm, given, context, feedback)
    task.executed.connect(lambda is_done, _results: ended.append(is_done))
    QgsApplication.taskManager().addTask(task)
    end = time.monotonic() + 30.0
    while not ended:
        assert time.monotonic() < end, "waited in vain"
        QgsApplication.processEvents()
    assert ended == [True], feedback.textLog()
    (thread,) = threads
    assert thread is not threading.main_thread() and not isinstance(thread, threading._DummyThread)


def test_nobody_needs_to_hold_a_task(qgis_app) -> None:
    """What only QGIS knows ends, and tells its end, while Python collects all that nobody holds."""
    failures: list[str] = []
    for number in range(3):
        Work(InputError(str(number)), on_end=lambda task: failures.append(task.failure)).start()
        gc.collect()
    end = time.monotonic() + 30.0
    while len(failures) < 3:
        assert time.monotonic() < end, "waited in vain"
        QgsApplication.processEvents()
        gc.collect()
    assert sorted(failures) == ["0", "1", "2"]
