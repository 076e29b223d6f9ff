"""A block that grows: images join one that was adjusted before, against one adjustment of all."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.block_records import read_record
from hrsi.processing_algorithms import run

OLD, NEW = ("image_1", "image_2", "image_3"), "image_4"


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four images; ties on the first three, others on the last three; the GCPs are measured on the first three."""
    folder = tmp_path_factory.mktemp("scene")
    run("simulate", sensor="pleiades", images=4, along="-9,-3,3,9", size=240, gcps=8, checks=6, ties=120, seed=5,
        output_dir=str(folder))  # fmt: skip
    rows = list(csv.DictReader((folder / "image_points.csv").open()))
    ties = sorted({row["id"] for row in rows if row["id"].startswith("T")})
    late = set(ties[::2])
    old = [row for row in rows if row["image"] in OLD and row["id"] not in late]
    new = [row for row in rows if row["image"] in ("image_2", "image_3", NEW) and row["id"] in late]
    for name, some in (("old", old), ("new", new), ("all", old + new)):
        with (folder / f"{name}.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0].keys())
            writer.writeheader()
            writer.writerows(some)
    return folder


def adjust(scene: Path, out: Path, images: tuple[str, ...], points: str, **options: Any) -> dict[str, Any]:
    given = {"model": "shift", "write": "none", "report": False, "test_sigmas": False, "reject": 0.0, **options}
    return run(
        "adjust", images=[str(scene / f"{name}.tif") for name in images], image_points=str(scene / f"{points}.csv"),
        output_dir=str(out), **given,
    )  # fmt: skip


@pytest.fixture(scope="module")
def first(scene: Path) -> Path:
    adjust(scene, scene / "first", OLD, "old", gcps=str(scene / "ground_points.csv"))
    return scene / "first"


@pytest.fixture(scope="module")
def at_once(scene: Path) -> dict[str, Any]:
    return adjust(scene, scene / "at_once", (*OLD, NEW), "all", gcps=str(scene / "ground_points.csv"))


def values(report: dict[str, Any], image: str) -> tuple[np.ndarray, np.ndarray]:
    found = report["images"][image]["parameters"].values()
    return np.array([one["value"] for one in found]), np.array([one["sigma"] for one in found])


def test_all_free_is_one_adjustment(scene: Path, first: Path, at_once: dict[str, Any], tmp_path: Path) -> None:
    grown = adjust(scene, tmp_path, (NEW,), "new", add_to=str(first))
    for image in (*OLD, NEW):
        np.testing.assert_allclose(values(grown, image), values(at_once, image), atol=1e-6)
    assert grown["check"] == at_once["check"]
    assert grown["ties"]["points"] == at_once["ties"]["points"]
    assert grown["observations"] == at_once["observations"]


def test_observed_cameras_agree_within_the_sigmas(
    scene: Path, first: Path, at_once: dict[str, Any], tmp_path: Path
) -> None:
    """The new image comes to where one adjustment puts it; the old ones hardly move, but for what the new ties say.

    What the errors of earlier cameras have in common is not carried over: where two of them hold a new image and have
    the same error, its sigma is too small by the root of two.
    """
    grown = adjust(scene, tmp_path, (NEW,), "new", add_to=str(first), earlier_cameras="observed")
    here, sigma = values(grown, NEW)
    there, sigma_there = values(at_once, NEW)
    print("new image, apart in sigmas:", (here - there) / sigma, "ratio of sigmas:", sigma / sigma_there)
    assert (np.abs(here - there) < sigma).all()
    assert (sigma > sigma_there / np.sqrt(2.0)).all() and (sigma < 2.0 * sigma_there).all()
    for image in OLD:
        total = values(json.loads((first / "report.json").read_text()), image)[0] + values(grown, image)[0]
        assert (np.abs(total - values(at_once, image)[0]) < values(at_once, image)[1]).all()


def test_the_record_says_what_was_adjusted(scene: Path, first: Path) -> None:
    record = read_record(str(first))
    report = json.loads((first / "report.json").read_text())
    assert record.model == "shift" and [image.id for image in record.images] == list(OLD)
    for image in record.images:
        assert image.path == str(scene / f"{image.id}.tif")
        assert image.covariance is not None
        found, sigma = values(report, image.id)
        np.testing.assert_allclose(image.values, found)
        np.testing.assert_allclose(np.sqrt(image.covariance.diagonal()), sigma, rtol=1e-9)
    pairs = json.loads((first / "block.json").read_text())["pairs"]
    assert sorted(pair[:2] for pair in pairs) == [
        ["image_1", "image_2"],
        ["image_1", "image_3"],
        ["image_2", "image_3"],
    ]
    assert all(count > 20 for *_, count in pairs)


def test_same_ids_of_other_points_are_told_apart(scene: Path, first: Path, tmp_path: Path) -> None:
    """Two searches for tie points both begin with number 1; what is at another place of an image is another point."""
    text = (scene / "old.csv").read_text().splitlines()
    earlier = sorted({line.split(",")[0] for line in text if line.startswith("T")})
    rows = list(csv.DictReader((scene / "new.csv").open()))
    names = dict(zip(sorted({row["id"] for row in rows}), earlier, strict=False))
    with (tmp_path / "clash.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows({**row, "id": names[row["id"]]} for row in rows if row["id"] in names)
    run("adjust", images=[str(scene / f"{NEW}.tif")], tie_points=str(tmp_path / "clash.csv"), add_to=str(first),
        output_dir=str(tmp_path / "out"), model="shift", write="none", report=False, reject=0.0)  # fmt: skip
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["ties"]["rmse_px"] < 1.0


def test_a_folder_without_a_record_is_named(scene: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"block\.json"):
        adjust(scene, tmp_path / "out", (NEW,), "new", add_to=str(scene))
    (tmp_path / "block.json").write_text('{"images": [{"id": 1}]}')
    with pytest.raises(InputError, match="no record of a block"):
        adjust(scene, tmp_path / "out", (NEW,), "new", add_to=str(tmp_path))
