"""Workers that share no disk: images, finished parts and results in an object store.

The store is moto's server in a process of its own; GDAL reaches it as it reaches S3.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.hrsi_engine.io.opening.datasets import list_virtual, read_virtual, remove_virtual, write_virtual
from hrsi.hrsi_engine.io.safety.array_files import PartStore
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.block_steps.tie_search import UNFINISHED

pytest.importorskip("moto.server", reason="moto[s3] and flask make an object store on this machine")
distributed = pytest.importorskip("distributed")

BUCKET = "/vsis3/blocks"
SERVE = """
from moto.server import ThreadedMotoServer
server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
server.start()
print(*server.get_host_and_port(), flush=True)
server._thread.join()
"""
TIES = {"cells": 3, "per_cell": 2}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A bucket ``blocks`` with the images of a block; gives the folder that they were made in."""
    folder = tmp_path_factory.mktemp("scene")
    run("simulate", output_dir=str(folder), size=300, images=3, along="-10,0,10", gcps=8, checks=4, ties=60)
    log = (folder / "server.log").open("w")
    server = subprocess.Popen([sys.executable, "-c", SERVE], stdout=subprocess.PIPE, stderr=log, text=True)
    host, port = server.stdout.readline().split()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {
            "AWS_S3_ENDPOINT": f"{host}:{port}", "AWS_HTTPS": "NO", "AWS_VIRTUAL_HOSTING": "FALSE",
            "AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_DEFAULT_REGION": "us-east-1",
        }.items():  # fmt: skip
            patch.setenv(name, value)
        import boto3

        client = boto3.client("s3", endpoint_url=f"http://{host}:{port}")
        client.create_bucket(Bucket="blocks")
        for file in folder.glob("image_*.tif"):
            client.upload_file(str(file), "blocks", f"images/{file.name}")
        yield folder
    server.terminate()
    server.wait()
    log.close()


@pytest.fixture(scope="module")
def cluster(store: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Two workers whose folder is another one; nothing that they are told of lies on a disk."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=str(tmp_path_factory.mktemp("away"))
    ) as workers:
        with distributed.Client(workers) as client:
            client.run(os.chdir, "/")
        yield workers.scheduler_address


@pytest.fixture(scope="module")
def at_home(store: Path) -> Path:
    """Tie points of the same images from the disk, by threads."""
    images = [str(store / f"image_{k}.tif") for k in (1, 2, 3)]
    run("tie-points", images=images, output_dir=str(store / "ties"), csv=True, **TIES)
    return store / "ties"


IMAGES = [f"{BUCKET}/images/image_{k}.tif" for k in (1, 2, 3)]


def test_files_in_a_store(store: Path):
    write_virtual(f"{BUCKET}/some/a.bin", [b"one", b"two"])
    assert read_virtual(f"{BUCKET}/some/a.bin") == b"onetwo"
    assert read_virtual(f"{BUCKET}/some/a.bin", 4) == b"onet"
    assert read_virtual(f"{BUCKET}/some/b.bin") is None
    assert list_virtual(f"{BUCKET}/some") == ["a.bin"]
    remove_virtual(f"{BUCKET}/some")
    assert list_virtual(f"{BUCKET}/some") == []


def test_finished_parts_in_a_store(store: Path):
    parts = PartStore(f"{BUCKET}/parts")
    assert parts.load("a") is None
    parts.save("a", {"value": np.arange(5.0)})
    assert len(parts) == 1
    assert np.array_equal(PartStore(f"{BUCKET}/parts").load("a")["value"], np.arange(5.0))
    write_virtual(f"{BUCKET}/parts/b.npz", [b"PK half a file"])
    assert parts.load("b") is None


@pytest.mark.programs
def test_tie_points_of_workers_that_share_no_disk(store: Path, cluster: str, at_home: Path):
    """Images, finished parts and results in the bucket: the bytes of threads with files; nothing is left behind."""
    run("tie-points", images=IMAGES, output_dir=f"{BUCKET}/run", scheduler=cluster, csv=True, **TIES)
    assert read_virtual(f"{BUCKET}/run/tie_points.csv") == (at_home / "tie_points.csv").read_bytes()
    assert sorted(list_virtual(f"{BUCKET}/run")) == sorted(file.name for file in at_home.iterdir())
    assert not Path("/vsis3").exists()


@pytest.mark.programs
def test_a_stopped_search_goes_on_with_the_parts_in_the_store(store: Path, cluster: str, at_home: Path, tmp_path: Path):
    """Parts that were finished before are taken from the bucket, by another client with another output directory."""
    options = {"images": IMAGES, "work_dir": f"{BUCKET}/work", "scheduler": cluster, "csv": True, **TIES}
    with pytest.raises(Cancelled):
        run("tie-points", output_dir=str(tmp_path / "first"), **options,
            progress=lambda _fraction, _text: len(list_virtual(f"{BUCKET}/work")) < 2)  # fmt: skip
    finished = len(list_virtual(f"{BUCKET}/work"))
    assert finished >= 2
    told: list[str] = []
    run("tie-points", output_dir=str(tmp_path / "second"), log=told.append, **options)
    assert f"continues with {finished} finished parts in {BUCKET}/work" in told
    assert (tmp_path / "second" / "tie_points.csv").read_bytes() == (at_home / "tie_points.csv").read_bytes()
    assert len(list_virtual(f"{BUCKET}/work")) > finished  # a work directory stays


@pytest.mark.programs
def test_without_a_work_directory_nothing_of_the_search_stays(store: Path, cluster: str):
    run("tie-points", images=IMAGES[:2], output_dir=f"{BUCKET}/short", **TIES)
    assert UNFINISHED not in list_virtual(f"{BUCKET}/short")


def adjusted(store: Path, output_dir: str, **more: Any) -> dict[str, Any]:
    return run(
        "adjust", images=IMAGES, gcps=str(store / "ground_points.csv"), image_points=str(store / "image_points.csv"),
        output_dir=output_dir, model="shift", **more,
    )  # fmt: skip


@pytest.mark.programs
def test_an_adjustment_of_images_in_a_store(store: Path, tmp_path: Path):
    """Refined images, items and reports are in the bucket in the end, and nothing else."""
    at_once = adjusted(store, str(tmp_path / "out"))
    there = adjusted(store, f"{BUCKET}/adjusted", stac=True)
    assert there["ties"]["rmse_px"] == pytest.approx(at_once["ties"]["rmse_px"], abs=1e-8)
    for name, image in at_once["images"].items():
        for one, other in zip(image["parameters"].values(), there["images"][name]["parameters"].values(), strict=True):
            assert other["value"] == pytest.approx(one["value"], abs=1e-8)
    names = list_virtual(f"{BUCKET}/adjusted")
    assert {"report.json", "block.gpkg", "image_1.tif", "stac.json"} <= set(names)
    assert not any(name.startswith(".") for name in names)
    item = json.loads(read_virtual(f"{BUCKET}/adjusted/stac.json") or b"")["features"][0]
    assert item["assets"]["image"]["href"] == "./image_1.tif"
    told = run("rpc-info", images=[f"{BUCKET}/adjusted/stac.json"], height=100.0)
    assert list(told["images"]) == ["image_1", "image_2", "image_3"]


def test_a_bucket_that_takes_nothing(store: Path):
    with pytest.raises(Exception, match=r"/vsis3/nowhere/.*cannot be written"):
        run("tie-points", images=IMAGES[:2], output_dir="/vsis3/nowhere/run", **TIES)


def test_orthoimages_go_to_a_disk(store: Path):
    with pytest.raises(InputError, match="which no object store takes"):
        run("orthorectify", images=IMAGES[:1], height=200.0, output_dir=f"{BUCKET}/ortho")
