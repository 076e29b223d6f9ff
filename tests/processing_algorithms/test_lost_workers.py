"""A worker or the scheduler of Dask is lost in the midst of a search: the same points in the end, or a clear word."""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from bad_inputs import faults_of_error
from osgeo import ogr

from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.block_steps.tie_search import UNFINISHED
from hrsi.processing_algorithms.declarations.image_points import TIES_FILE

pytest.importorskip("distributed")
WAIT_S = 120.0
Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("images")
    run("simulate", sensor="pleiades", images=3, along="-6,0,6", size=400, gcps=0, checks=0, ties=0, seed=3,
        output_dir=str(folder))  # fmt: skip
    return [str(folder / f"image_{number}.tif") for number in (1, 2, 3)]


@pytest.fixture(scope="module")
def undisturbed(images: list[str], tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    folder = tmp_path_factory.mktemp("undisturbed")
    run("tie-points", images=images, output_dir=str(folder), threads=1)
    return points_of(folder)


@pytest.fixture
def start() -> Iterator[Start]:
    """Start processes, which all end with the test."""
    started: list[subprocess.Popen[str]] = []

    def begin(*words: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", *words]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.wait(timeout=20)


def start_scheduler(start: Start) -> tuple[subprocess.Popen[str], str]:
    scheduler = start("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    assert scheduler.stdout is not None
    for line in scheduler.stdout:
        found = re.search(r"Scheduler at:\s+(tcp://\S+)", line)
        if found:
            return scheduler, found[1]
    raise AssertionError("no scheduler")


def start_worker(start: Start, address: str) -> subprocess.Popen[str]:
    return start("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")


def start_search(start: Start, images: list[str], output: Path, address: str) -> subprocess.Popen[str]:
    command = "hrsi", "tie-points", "--scheduler", address, "--output-dir", str(output), *images
    return start(*command)


def wait_until(what: Callable[[], bool], *running: subprocess.Popen[str]) -> None:
    end = time.monotonic() + WAIT_S
    while not what():
        assert time.monotonic() < end, "waited too long"
        assert all(process.poll() is None for process in running), [p.communicate()[0] for p in running]
        time.sleep(0.01)


def kept(output: Path) -> int:
    return len(list((output / UNFINISHED).glob("*.npz")))


def points_of(folder: Path) -> np.ndarray:
    """Return the measurements ``(n, 2)``, in their order."""
    source = ogr.Open(str(folder / TIES_FILE))
    layer = source.GetLayerByName("image_points")
    return np.array([[feature["sample"], feature["line"]] for feature in layer])


@pytest.mark.killed
def test_a_worker_is_killed(images: list[str], undisturbed: np.ndarray, start: Start, tmp_path: Path) -> None:
    """Its parts go to the other one."""
    output = tmp_path / "out"
    _, address = start_scheduler(start)
    workers = [start_worker(start, address) for _ in range(2)]
    search = start_search(start, images, output, address)
    wait_until(lambda: kept(output) > 0, search)
    workers[0].send_signal(signal.SIGKILL)
    said, _ = search.communicate(timeout=WAIT_S)
    assert search.returncode == 0, said
    np.testing.assert_array_equal(points_of(output), undisturbed)


@pytest.mark.killed
def test_the_scheduler_is_killed(images: list[str], undisturbed: np.ndarray, start: Start, tmp_path: Path) -> None:
    """The run ends with a word on it; the next one, without a scheduler, goes on with the parts that are kept."""
    output = tmp_path / "out"
    scheduler, address = start_scheduler(start)
    start_worker(start, address)
    search = start_search(start, images, output, address)
    wait_until(lambda: kept(output) > 0, search)
    scheduler.send_signal(signal.SIGKILL)
    said, _ = search.communicate(timeout=WAIT_S)
    assert faults_of_error(search.returncode, said, {address}) == []
    assert "was lost" in said or "no Dask scheduler answers" in said  # at work, or between two rounds
    finished = kept(output)
    assert finished > 0
    again: list[str] = []
    run("tie-points", images=images, output_dir=str(output), threads=1, log=again.append)
    assert any(f"continues with {finished} finished parts" in line for line in again)
    np.testing.assert_array_equal(points_of(output), undisturbed)
    assert not (output / UNFINISHED).exists()
