"""One simulated block with full truth for all oracles, made and adjusted by the commands of HRSI once a process."""

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from dense_affine_block import IMAGE_PX, SURVEY_M
from independent_formulas import Camera, numbers, table

from hrsi.processing_algorithms import run

IMAGES = ("image_1", "image_2", "image_3")


def report_of(folder: Path) -> dict:
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """Three images of 160 px, 60 m of relief, known points and tie points; paths, tables and cameras."""
    folder = tmp_path_factory.mktemp("oracle") / "block"
    run(
        "simulate", images=3, along="-14,3,11", size=160, gcps=10, checks=8, ties=40, relief=60.0, ortho=True,
        seed=11, output_dir=str(folder),
    )  # fmt: skip
    surveyed = {row["id"]: row for row in table(folder / "ground_points.csv")}
    measured: dict[str, dict] = {}
    for row in table(folder / "image_points.csv"):
        measured.setdefault(row["id"], {})[row["image"]] = numbers(row, "sample", "line")
    return SimpleNamespace(
        folder=folder, images=[str(folder / f"{name}.tif") for name in IMAGES], dem=str(folder / "dem.tif"),
        gcps=str(folder / "ground_points.csv"), image_points=str(folder / "image_points.csv"), surveyed=surveyed,
        measured=measured, places={name: numbers(row, "lon", "lat", "height") for name, row in surveyed.items()},
        cameras={name: Camera(folder / f"{name}.tif") for name in IMAGES},
        truth=json.loads((folder / "truth.json").read_text(encoding="utf-8")),
    )  # fmt: skip


@pytest.fixture(scope="session")
def adjusted(scene: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """`adjust` with an affine correction; folder, report, refined cameras.

    Stated sigmas of image points are a third of the true ones, so that sigma0 is far above 1 and scales every figure;
    those of surveys differ in east, north and height, so that none stands for another.
    """
    folder = tmp_path_factory.mktemp("oracle_adjusted")
    east, north, height = SURVEY_M.tolist()
    stated = {
        "gcps": {"sigma_east": east, "sigma_north": north, "sigma_h": height}, "image_points": {"sigma": IMAGE_PX},
    }  # fmt: skip
    for name, sigmas in stated.items():
        rows = [{key: value for key, value in row.items() if key != "sigma_xy"} | sigmas
                for row in table(getattr(scene, name))]  # fmt: skip
        with (folder / f"{name}.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)
    files = {name: str(folder / f"{name}.csv") for name in stated}
    folder = folder / "out"
    run(
        "adjust", images=scene.images, **files, height_datum="ellipsoidal", model="affine", test_sigmas=False,
        reject=0.0, hold_out=0.0, stac=True, title="A title", client="Client", place="Somewhere",
        output_dir=str(folder),
    )  # fmt: skip
    refined = {name: Camera(folder / f"{name}.tif") for name in IMAGES}
    return SimpleNamespace(folder=folder, package=folder / "block.gpkg", report=report_of(folder), refined=refined)
