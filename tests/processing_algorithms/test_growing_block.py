"""A block that grows: images join one that was adjusted before, against one adjustment of all."""

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.catalogue.block_records import read_record
from hrsi.hrsi_engine.io.point_files import read_image_points
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


@pytest.mark.thorough
def test_all_free_is_one_adjustment(scene: Path, first: Path, at_once: dict[str, Any], tmp_path: Path) -> None:
    grown = adjust(scene, tmp_path, (NEW,), "new", add_to=str(first))
    for image in (*OLD, NEW):
        np.testing.assert_allclose(values(grown, image), values(at_once, image), atol=1e-6)
    assert grown["check"] == at_once["check"]
    assert grown["ties"]["points"] == at_once["ties"]["points"]
    assert grown["observations"] == at_once["observations"]


@pytest.mark.parametrize(
    ("model", "control"), mark_beyond(1, "rendered", [("affine", True), ("shift", True), ("shift", False)])
)
def test_observed_cameras_make_two_steps_one(scene: Path, tmp_path: Path, model: str, control: bool) -> None:
    """Nothing of the old points is used again but what they say of all cameras together: values, sigmas, redundancy.

    The equations are nearly linear, so what is left is far below any sigma. Sigmas are compared with sigma0 as given:
    that of the second step is of the new observations alone.
    """
    gcps = {"gcps": str(scene / "ground_points.csv")} if control else {}
    step = adjust(scene, tmp_path / "first", OLD, "old", model=model, **gcps)
    grown = adjust(scene, tmp_path / "grown", (NEW,), "new", add_to=str(tmp_path / "first"), model=model,
                   earlier_cameras="observed")  # fmt: skip
    whole = adjust(scene, tmp_path / "whole", (*OLD, NEW), "all", model=model, **gcps)
    scale = max(grown["sigma0"], 1.0) / max(whole["sigma0"], 1.0) if control else 1.0
    for image in (*OLD, NEW):
        here, sigma = values(grown, image)
        there, sigma_there = values(whole, image)
        assert (np.abs(here - there) < 0.01 * sigma_there).all()
        np.testing.assert_allclose(sigma / scale, sigma_there, rtol=0.01)
    # Beyond that of its own points, the second step's redundancy lacks what the old cameras learn from the new points,
    # at most all of their parameters: their deviations from what was known are no residuals
    parameters = len(OLD) * len(values(whole, NEW)[0])
    assert 0.0 <= whole["redundancy"] - step["redundancy"] - grown["redundancy"] + 0.01 <= parameters


def test_the_record_says_what_was_adjusted(scene: Path, first: Path) -> None:
    record = read_record(str(first))
    report = json.loads((first / "report.json").read_text())
    assert record.model == "shift" and [image.id for image in record.images] == list(OLD)
    for image in record.images:
        assert image.path == str(scene / f"{image.id}.tif")
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


def test_cameras_that_are_damaged_or_missing_are_named(scene: Path, first: Path, tmp_path: Path) -> None:
    earlier = Path(shutil.copytree(first, tmp_path / "earlier"))
    cameras = earlier / "block_cameras.npz"

    def message() -> str:
        with pytest.raises(InputError) as refused:
            adjust(scene, tmp_path / "out", (NEW,), "new", add_to=str(earlier), earlier_cameras="observed")
        assert not (tmp_path / "out").exists()
        return str(refused.value)

    with np.load(cameras) as arrays:
        good = {name: arrays[name] for name in arrays.files}
    for name in ("camera", "rows", "blocks", "values", "squares"):
        np.savez(cameras, **{**good, name: good[name][:-1]})
        assert "are inconsistent" in message()
    np.savez(cameras, **{**good, "columns": good["columns"] + 7})
    assert "are inconsistent" in message()
    np.savez(cameras, **{name: array for name, array in good.items() if name != "rows"})
    assert "contains no camera parameters" in message()
    np.savez(cameras, **{**good, "images": np.array(["a", "b", "c"])})
    assert "other images" in message()
    cameras.write_bytes(cameras.read_bytes()[:100])
    assert "is damaged" in message()
    cameras.unlink()
    assert "set `earlier_cameras` to free" in message()


@pytest.fixture(scope="module")
def searched(scene: Path) -> Path:
    """Tie points of the first two images."""
    run("tie-points", images=[str(scene / f"{name}.tif") for name in OLD[:2]], output_dir=str(scene / "ties"))
    return scene / "ties"


def test_a_search_goes_on_with_new_pairs_only(scene: Path, searched: Path, tmp_path: Path) -> None:
    """The earlier points are kept to the bit; only pairs with the new image are matched; ids go on."""
    before = read_image_points(f"{searched}/block.gpkg|layername=image_points").image
    said: list[str] = []
    report = run("tie-points", images=[str(scene / f"{OLD[2]}.tif")], add_to=str(searched), output_dir=str(tmp_path),
                 log=said.append)  # fmt: skip
    after = read_image_points(f"{tmp_path}/block.gpkg|layername=image_points").image
    assert before is not None and after is not None
    known, images = np.isin(after.ids, before.ids), np.asarray(after.image_ids)
    kept = known & (images != OLD[2])
    for name in ("ids", "image_ids", "xy", "sigma_px"):
        np.testing.assert_array_equal(np.asarray(getattr(after, name))[kept], np.asarray(getattr(before, name)))
    # Earlier points are seen by the new image, else two views of the pairs would not place it; the others are new
    earlier = len(set(before.ids.tolist()))
    assert (known & ~kept).sum() > 100
    assert len(set(after.ids[~known].tolist())) == report["ties"]["points"] - earlier
    places = np.column_stack([np.unique(images, return_inverse=True)[1], after.xy])
    assert len(np.unique(places, axis=0)) == len(places)  # no place of an image is two points
    assert (report["pairs"][0]["first"], report["pairs"][0]["second"]) == OLD[:2]  # as the earlier report tells
    assert len(report["pairs"]) == 3 and set(report["images"]) == set(OLD[:3])
    assert not any(OLD[0] in line and OLD[1] in line and "matches" in line for line in said)
    with pytest.raises(InputError, match="no result of tie-points"):
        run("tie-points", images=[str(scene / f"{OLD[2]}.tif")], add_to=str(scene), output_dir=str(tmp_path / "other"))


@pytest.mark.rendered
def test_triangulate_joins_a_block(scene: Path, searched: Path, tmp_path: Path) -> None:
    """Cameras of both steps agree with one run of everything within what both can know: the ties are others."""
    options = {"model": "shift", "write": "none", "report": False, "gcps": str(scene / "ground_points.csv")}
    paths = [str(scene / f"{name}.tif") for name in OLD[:3]]
    points = str(scene / "known.csv")
    rows = list(csv.DictReader((scene / "image_points.csv").open()))
    with Path(points).open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(row for row in rows if not row["id"].startswith("T") and row["image"] in OLD[:2])
    run("adjust", images=paths[:2], tie_points=str(searched), image_points=points, output_dir=str(tmp_path / "one"),
        **options)  # fmt: skip
    whole = run("triangulate", images=paths, image_points=points, output_dir=str(tmp_path / "whole"), **options)
    joining = {key: value for key, value in options.items() if key != "gcps"} | {"add_to": str(tmp_path / "one")}
    grown = run("triangulate", images=paths[2:], output_dir=str(tmp_path / "grown"), **joining)
    assert set(grown["images"]) == set(OLD[:3])
    for image in OLD[:3]:
        apart = np.abs(values(grown, image)[0] - values(whole, image)[0])
        assert (apart < 3.0 * np.hypot(values(whole, image)[1], values(grown, image)[1])).all()
    with pytest.raises(InputError, match="set `earlier_cameras` to free"):
        run("triangulate", images=paths[2:], output_dir=str(tmp_path / "no"), earlier_cameras="observed", **joining)
