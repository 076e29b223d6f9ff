"""Parts of a computation: threads and worker processes give the same, finished parts are kept, runs can be stopped."""

import threading
import time
from dataclasses import dataclass

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.hrsi_engine.foundation.workers.scheduling import WorkPart, digest, open_scheduler, run_parts
from hrsi.hrsi_engine.foundation.workers.threads import one_thread_calls
from hrsi.hrsi_engine.io.safety import replacing
from hrsi.hrsi_engine.io.safety.array_files import PartStore


@dataclass(frozen=True)
class Job:
    number: int
    wait_s: float = 0.0


RAN: list[int] = []


def square(job: Job) -> dict[str, np.ndarray]:
    time.sleep(job.wait_s)
    RAN.append(job.number)
    return {"value": np.array([job.number**2])}


def total(job: Job, *needed: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {"value": np.array([job.number + sum(int(part["value"][0]) for part in needed)])}


def failing(job: Job) -> dict[str, np.ndarray]:
    raise InputError(f"image {job.number} cannot be read")


def squares(count: int, wait_s: float = 0.0) -> list[WorkPart]:
    return [WorkPart(f"square-{k}", square, Job(k, wait_s), label=f"square {k}") for k in range(count)]


@pytest.fixture(autouse=True)
def nothing_ran():
    RAN.clear()


@pytest.mark.parametrize("threads", [1, 4])
def test_results_of_what_is_wanted(threads: int):
    parts = [*squares(6), WorkPart("sum", total, Job(100), tuple(f"square-{k}" for k in range(4)))]
    found = run_parts(parts, ["sum", "square-5"], open_scheduler(threads=threads))
    assert {key: int(result["value"][0]) for key, result in found.items()} == {"sum": 114, "square-5": 25}
    assert sorted(RAN) == [0, 1, 2, 3, 5]  # what nobody needs does not run


def test_strings_of_a_job_are_never_taken_for_parts():
    """Dask replaces texts that are keys of the graph by results: inside a job they must stay texts."""

    def name(job: tuple[str, ...]) -> dict[str, np.ndarray]:
        return {"value": np.array(job)}

    found = run_parts(
        [WorkPart("a", name, ("b", "a")), WorkPart("b", name, ("a",))], ["a", "b"], open_scheduler(threads=1)
    )
    assert found["a"]["value"].tolist() == ["b", "a"]


def test_finished_parts_do_not_run_again(tmp_path):
    keeper = PartStore(str(tmp_path / "parts"))
    run_parts(squares(3), ["square-0", "square-2"], open_scheduler(threads=1), keeper)
    assert len(keeper) == 2
    RAN.clear()
    found = run_parts(squares(3), ["square-2", "square-1", "square-0"], open_scheduler(threads=1), keeper)
    assert RAN == [1]
    assert [int(found[key]["value"][0]) for key in found] == [4, 1, 0]
    (keeper.folder / "square-1.npz").write_bytes(b"PK half a file")
    RAN.clear()
    run_parts(squares(3), ["square-1"], open_scheduler(threads=1), keeper)
    assert RAN == [1]  # a damaged file counts as none


def test_cancelled_run_keeps_what_is_finished(tmp_path):
    keeper = PartStore(str(tmp_path / "parts"))
    began = time.monotonic()
    with pytest.raises(Cancelled):
        run_parts(
            squares(200, wait_s=0.05), [f"square-{k}" for k in range(200)], open_scheduler(threads=2), keeper,
            lambda fraction, message: fraction < 0.03,
        )  # fmt: skip
    assert time.monotonic() - began < 5.0  # 200 parts would take that long
    assert 6 <= len(keeper) <= 12
    assert threading.active_count() < 20


def test_error_of_a_part_is_the_error_of_the_run():
    with pytest.raises(InputError, match="image 7 cannot be read"):
        run_parts([*squares(2), WorkPart("bad", failing, Job(7))], ["square-0", "bad"], open_scheduler(threads=2))


def test_scheduler_that_does_not_answer(monkeypatch):
    monkeypatch.setattr("hrsi.hrsi_engine.foundation.workers.cluster.CONNECT_S", 1)
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        run_parts(squares(1), ["square-0"], open_scheduler("tcp://127.0.0.1:9"))


def test_digest_tells_values_apart():
    base = (1, "a", np.arange(3.0), Job(1), {"x": (1, 2)}, None)
    changed = [
        (2, *base[1:]), (1, "b", *base[2:]), (1, "a", np.arange(3), *base[3:]),
        (1, "a", np.arange(3.0)[::-1], *base[3:]),
        (*base[:3], Job(1, 0.1), *base[4:]), (*base[:4], {"x": (2, 1)}, None), (*base[:5], 0),
    ]  # fmt: skip
    digests = [digest(*values) for values in (base, *changed)]
    assert len(set(digests)) == len(digests)
    assert digest(*base) == digest(1, "a", np.arange(3.0), Job(1), {"x": (1, 2)}, None)
    assert digest("ab", "c") != digest("a", "bc")


def test_what_a_killed_run_was_writing_goes(tmp_path):
    dead = tmp_path / f".a.{replacing._machine_name()}-{2**22 + 1}-1-0123abcd.tmp.npz"
    dead.touch()
    assert len(PartStore(str(tmp_path))) == 0
    assert not dead.exists()


def test_parts_side_by_side_call_opencv_with_one_thread_each():
    opencv = pytest.importorskip("cv2")
    before = opencv.getNumThreads()
    parts = [
        WorkPart(f"part {number}", lambda _: {"threads": np.array(opencv.getNumThreads())}, None) for number in range(3)
    ]
    opencv.setNumThreads(3)
    try:
        found = run_parts(parts, [part.key for part in parts], open_scheduler(None, 2))
        assert all(result["threads"] == 1 for result in found.values())
        assert opencv.getNumThreads() == 3
    finally:
        opencv.setNumThreads(before)


def test_parts_side_by_side_call_blas_with_one_thread_each():
    threadpoolctl = pytest.importorskip("threadpoolctl")

    def blas_threads(_: object = None) -> dict[str, np.ndarray]:
        libraries = [one for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"]  # others keep theirs
        return {"threads": np.array([library["num_threads"] for library in libraries])}

    parts = [WorkPart(f"part {number}", blas_threads, None) for number in range(3)]
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        before = blas_threads()["threads"]
        with one_thread_calls():  # another run at the same time
            found = run_parts(parts, [part.key for part in parts], open_scheduler(None, 2))
            assert all((result["threads"] == 1).all() for result in found.values())
            assert (blas_threads()["threads"] == 1).all()
        assert (blas_threads()["threads"] == before).all()
