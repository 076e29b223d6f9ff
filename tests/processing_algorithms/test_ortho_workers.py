"""Orthoimages warped by Dask workers: the bytes that threads make, whoever is lost on the way."""

import hashlib
import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.files import orthoimage_plan
from hrsi.tests.ortho.scenes import camera, rpc_image, write_dem

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    rpc_image(folder / "a.tif", camera(0.35))
    rpc_image(folder / "b.tif", camera(-0.2))
    write_dem(folder / "dem.tif")
    return folder


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as workers:
        yield workers


def ortho(scene: Path, out: Path, **options: Any) -> dict[str, str]:
    """Return the digests of the orthoimages that a run makes, several chunks each, by their names."""
    given = {
        "dem": "dem.tif",
        "height_datum": "ellipsoidal",
        "visibility": True,
        "resolution": 0.7,
        "compression": "none",
        "report": False,
        "threads": 1,
        **options,
    }
    run("orthorectify", images=["a.tif", "b.tif"], output_dir=str(out), **given)
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(out.glob("*.tif"))}


@pytest.mark.parametrize("format", mark_beyond(1, "thorough", ["cog", "gtiff"]))
def test_the_bytes_are_those_of_threads(
    scene: Path, cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, format: str
) -> None:
    """Relative paths are found by workers in another folder; all files are in one."""
    monkeypatch.chdir(scene)
    one = ortho(scene, tmp_path / "one", format=format)
    assert sorted(one) == ["a_ortho.tif", "b_ortho.tif"]
    assert ortho(scene, tmp_path / "several", format=format, threads=3) == one
    with distributed.Client(cluster) as client:
        client.run(os.chdir, str(tmp_path))
    assert ortho(scene, tmp_path / "workers", format=format, scheduler=cluster.scheduler_address) == one


def test_who_looks_at_frames_keeps_no_file_open(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Dask's profiler keeps frames of a worker's threads beyond their return, with the datasets that they hold."""
    monkeypatch.chdir(scene)
    undisturbed = ortho(scene, tmp_path / "undisturbed")
    kept: list[Any] = []

    def keep(frame: Any, event: str, _argument: object) -> None:
        if event == "return" and "hrsi_engine" in frame.f_code.co_filename:
            kept.append(frame)
            del kept[:-50]

    threading.setprofile(keep)
    try:
        assert ortho(scene, tmp_path / "watched") == undisturbed
    finally:
        threading.setprofile(None)  # type: ignore[arg-type]
    assert any(frame.f_code.co_name == "warp_chunk" for frame in kept)


@pytest.mark.killed
def test_a_killed_worker_does_not_matter(
    scene: Path, cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(scene)
    undisturbed = ortho(scene, tmp_path / "undisturbed")
    with distributed.Client(cluster) as client:
        victims = list(client.run(os.getpid).values())[:1]
    killed: list[int] = []

    def kill(fraction: float, _message: str) -> bool:
        if fraction > 0.1 and victims:
            killed.append(victims.pop())
            os.kill(killed[0], signal.SIGKILL)
        return True

    made = ortho(scene, tmp_path / "disturbed", scheduler=cluster.scheduler_address, progress=kill)
    assert killed and made == undisturbed


@pytest.mark.thorough
def test_a_worker_with_another_version_is_refused(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(scene)
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as workers:
        monkeypatch.setattr(orthoimage_plan, "versions", lambda: {"hrsi": "0", "gdal": str(next(count)), "proj": "0"})
        count = iter(range(100))
        with pytest.raises(InputError, match=r"gdal \d+ where \d+ is wanted.*on the Dask worker"):
            ortho(scene, tmp_path, scheduler=workers.scheduler_address)
    assert not list(tmp_path.glob("*.tif"))
