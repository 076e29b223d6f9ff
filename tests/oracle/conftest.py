"""One simulated block with full truth for all oracles, made and adjusted by the commands of HRSI once a process."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from independent_formulas import Camera, numbers, table

from hrsi.processing_algorithms import run

IMAGES = ("image_1", "image_2", "image_3")


def report_of(folder: Path) -> dict:
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """Three images of 160 px, 60 m of relief, known points and tie points; paths, tables and cameras."""
    # A block that was made before is the same for all mutants of `benchmarks/generated_mutants.py`
    folder = Path(os.environ.get("HRSI_ORACLE_BLOCK") or tmp_path_factory.mktemp("oracle") / "block")
    if not folder.exists():
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
    """`adjust` with an affine correction and the sigmas as given; folder, report, refined cameras."""
    folder = tmp_path_factory.mktemp("oracle_adjusted") / "out"
    run(
        "adjust", images=scene.images, gcps=scene.gcps, image_points=scene.image_points, height_datum="ellipsoidal",
        model="affine", test_sigmas=False, hold_out=0.0, stac=True, output_dir=str(folder),
    )  # fmt: skip
    refined = {name: Camera(folder / f"{name}.tif") for name in IMAGES}
    return SimpleNamespace(folder=folder, package=folder / "block.gpkg", report=report_of(folder), refined=refined)
