"""Background tasks say why they have come to nothing; one that the user has cancelled says nothing."""

from __future__ import annotations

import time

import pytest
from qgis.core import QgsApplication

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.progress import advance
from hrsi.plugin.background_task import BackgroundTask


class Work(BackgroundTask):
    """Raises what it is given, or goes on until it is cancelled."""

    def __init__(self, error: Exception | None = None) -> None:
        super().__init__("work")
        self.error, self.ended = error, ""
        self.taskCompleted.connect(lambda: self.end("completed"))
        self.taskTerminated.connect(lambda: self.end("terminated"))

    def end(self, how: str) -> None:
        self.ended = how

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
    QgsApplication.taskManager().addTask(task)
    wait_for(task)
    assert task.ended == "terminated" and told in task.failure


def test_cancelled_says_nothing(qgis_app) -> None:
    task = Work()
    QgsApplication.taskManager().addTask(task)
    while not task.isActive():
        QgsApplication.processEvents()
    task.cancel()
    wait_for(task)
    assert (task.ended, task.failure) == ("terminated", "")
