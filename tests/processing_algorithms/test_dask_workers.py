"""Tie points found by Dask workers, through the command line: other folders, other machines, encrypted schedulers."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from hrsi.hrsi_engine.io.rasters import images as rasters
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line import cli

dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    run("simulate", output_dir=str(folder), size=300, images=2, gcps=0, checks=0, ties=10)
    return folder


@pytest.fixture
def in_scene(scene: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(scene)
    return scene


def cluster(folder: Path, **settings: object) -> object:
    """Return one worker whose working directory is another one."""
    return distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None,
                                    local_directory=str(folder), **settings)  # fmt: skip


def find(output: Path, address: str, *options: str | Path, code: int = 0) -> None:
    words = ["tie-points", "image_1.tif", "image_2.tif", "--output-dir", output, "--csv", *options]
    words += ["--scheduler", address] if address else []
    assert cli.main([*map(str, words), "--quiet"]) == code


@pytest.mark.thorough
def test_images_with_relative_paths_are_found_by_workers_in_another_folder(in_scene: Path, tmp_path: Path) -> None:
    find(tmp_path / "here", "")
    with cluster(tmp_path, processes=True) as workers:
        with distributed.Client(workers) as client:
            client.run(os.chdir, str(tmp_path))
        find(tmp_path / "there", workers.scheduler_address)
    here, there = ((tmp_path / name / "tie_points.csv") for name in ("here", "there"))
    assert there.read_bytes() == here.read_bytes()


@pytest.mark.thorough
def test_a_worker_that_lacks_an_image_is_named_with_it(
    in_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its path on the worker's machine is one where nothing lies."""
    monkeypatch.setattr(rasters, "path_elsewhere", lambda path: f"/elsewhere/{path}")
    with cluster(tmp_path, processes=True) as workers:
        find(tmp_path / "out", workers.scheduler_address, code=2)
    error = capsys.readouterr().err
    assert "/elsewhere/image_" in error
    assert "no such file" in error
    assert "on the Dask worker 0 at tcp://" in error


@pytest.fixture
def encrypted(tmp_path: Path) -> Iterator[tuple[str, dict[str, Path]]]:
    """A scheduler that encrypts, and the files that it wants to see."""
    security = distributed.Security.temporary()
    files = {"ca": security.tls_ca_file, "certificate": security.tls_client_cert, "key": security.tls_client_key}
    named = {name: tmp_path / f"{name}.pem" for name in files}
    for name, text in files.items():
        named[name].write_text(text)
    with cluster(tmp_path, processes=False, protocol="tls://", security=security) as workers:
        yield workers.scheduler_address, named


@pytest.mark.programs
def test_a_scheduler_that_encrypts(
    in_scene: Path, tmp_path: Path, encrypted: tuple[str, dict[str, Path]], capsys: pytest.CaptureFixture[str]
) -> None:
    address, files = encrypted
    assert address.startswith("tls://")
    options = [word for name, file in files.items() for word in (f"--scheduler-{name}", file)]
    find(tmp_path / "out", address, *options)
    assert (tmp_path / "out" / "tie_points.csv").stat().st_size > 1000
    with dask.config.set({"distributed.comm.tls.ca-file": str(files["ca"]),
                          "distributed.comm.tls.client.cert": str(files["certificate"]),
                          "distributed.comm.tls.client.key": str(files["key"])}):  # fmt: skip
        find(tmp_path / "configured", address)
    find(tmp_path / "without", address, code=2)
    assert "--scheduler-certificate" in capsys.readouterr().err
    find(tmp_path / "missing", address, "--scheduler-ca", tmp_path / "none.pem", code=2)
    assert "none.pem: no such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("path", "elsewhere"),
    [
        ("image_1.tif", "{here}/image_1.tif"),
        ("/vsizip/delivery.zip/a.tif", "/vsizip/{here}/delivery.zip/a.tif"),
        ("/vsicurl/https://host/a.tif", "/vsicurl/https://host/a.tif"),
        ("/vsis3/bucket/a.tif", "/vsis3/bucket/a.tif"),
        ("NETCDF:a.nc:band", "NETCDF:a.nc:band"),
    ],
)
def test_the_path_of_a_file_for_another_process(in_scene: Path, path: str, elsewhere: str) -> None:
    assert rasters.path_elsewhere(path) == elsewhere.format(here=in_scene)
