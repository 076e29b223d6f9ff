"""GCPs measured in one block are found in images of another by their chips, on rendered blocks with known truth.

One block has images of two days a year apart in sun, season and direction: those of the first day are the old project,
those of the second the new one. Another block shows other ground at the same place.
"""

import base64
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.drawing.target_chips import decode_png, encode_png
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.point_session import (
    ChipLibrary,
    PointSession,
    files,
    find_transfers,
    list_library_points,
    save_chips,
)
from hrsi.processing_algorithms.point_session.adjusting import adjust_block, block_of
from hrsi.processing_algorithms.point_session.rows import ImageMeasurement

LARGEST_PX = 0.3  # what the panel promises of GCPs found by their chips
BIAS_PX = (55.0, -40.0)  # of the new images' RPCs beyond the vendor's own error
Truth = dict[tuple[str, str], tuple[float, float]]


def simulate(folder: Path, seed: int, **options: object) -> Path:
    run("simulate", output_dir=str(folder), images=2, along="-10,12", size=600, gcps=10, checks=0, ties=6, seed=seed,
        dates=2, noise_image=0.0, noise_gcp_xy=0.02, noise_gcp_h=0.03, relief=40.0, **options)  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate(tmp_path_factory.mktemp("chips") / "block", 24)


@pytest.fixture(scope="module")
def truth(folder: Path) -> Truth:
    with open(folder / "image_points.csv", encoding="utf-8") as lines:
        rows = [row for row in csv.DictReader(lines) if row["id"].startswith("G")]
    return {(row["id"], row["image"]): (float(row["sample"]), float(row["line"])) for row in rows}


def open_day(folder: Path, day: int, points: str = "ground_points.csv") -> PointSession:
    images = [str(folder / f"d{day}_{number}.tif") for number in (1, 2)]
    return files.new_session(images, str(folder / points) if points else "")


@pytest.fixture(scope="module")
def library(folder: Path, truth: Truth, tmp_path_factory: pytest.TempPathFactory) -> str:
    """What the first day's project leaves."""
    old = open_day(folder, 1)
    for (name, image), place in truth.items():
        if image in old.images:
            old.set_measurement(name, image, ImageMeasurement(*place, kind="center"))
    path = str(tmp_path_factory.mktemp("library") / "chips.gpkg")
    old.library = ChipLibrary(path)
    assert save_chips(old) == len(old.measured) == len(ChipLibrary(path))
    assert save_chips(old) == 0, "what is there already is written again"
    return path


def open_new(folder: Path, library: str, points: str = "ground_points.csv") -> PointSession:
    """Return the second day's project, whose RPCs are far off, with the library."""
    session = open_day(folder, 2, points)
    for name, image in session.images.items():
        rpc = replace(image.rpc, samp_off=image.rpc.samp_off + BIAS_PX[0], line_off=image.rpc.line_off + BIAS_PX[1])
        session.images[name] = replace(image, rpc=rpc)
    session.library = ChipLibrary(library)
    return session


def list_found(session: PointSession, truth: Truth) -> tuple[list[float], int]:
    """Return how far from the truth (px) points were found by their chips, and how many were looked for."""
    off, asked = list[float](), 0
    for name in session.points:
        if session.library.find_rows(session.points[name]).size:
            for image, one in find_transfers(session, name).items():
                asked += (name, image) in truth
                if not one.refusal:
                    off.append(float(np.hypot(*np.subtract(one.xy, truth.get((name, image), (np.inf, np.inf))))))
    return off, asked


def test_points_are_found_on_another_day(folder: Path, truth: Truth, library: str) -> None:
    """At RPCs as delivered half of them, the rest being refused; with the first ones accepted those nearby are more."""
    session = open_new(folder, library)
    off, asked = list_found(session, truth)
    assert asked >= 10 and len(off) >= 0.5 * asked and max(off) < LARGEST_PX
    for image in session.images:
        name, one = next(
            (name, one)
            for name in session.points
            for one in [find_transfers(session, name, [image])[image]]
            if session.library.find_rows(session.points[name]).size and not one.refusal
        )
        session.accept_transfers(name, {image: one})
    more, asked = list_found(session, truth)
    assert len(more) >= 0.6 * asked and max(more) < LARGEST_PX


def test_other_ground_is_refused(folder: Path, library: str) -> None:
    """Of images turned upside down every place shows other ground, with discs like those that were measured."""
    session = open_new(folder, library)
    for name, image in session.images.items():
        grey, valid = image.pixels.read(0, 0, *image.known_size)
        session.images[name] = replace(image, raster=ArrayRaster(grey[::-1].copy(), valid[::-1].copy()))
    off, _ = list_found(session, {})
    assert not off, "found where there is nothing of the kind"


@pytest.mark.thorough
def test_coarser_images_are_searched(folder: Path, truth: Truth, library: str, tmp_path: Path) -> None:
    """Images of half the resolution, as of another sensor: within the same part of their pixels."""
    paths = [str(folder / f"d2_{number}.tif") for number in (1, 2)]
    run("crop", images=paths, factor=0.5, output_dir=str(tmp_path / "half"))
    halves = sorted(str(path) for path in (tmp_path / "half").glob("*.tif"))
    session = files.new_session(halves, str(folder / "ground_points.csv"))
    session.library = ChipLibrary(library)
    ids = {image: next(full for full in ("d2_1", "d2_2") if image.startswith(full)) for image in session.images}
    places = {
        (name, image): tuple((np.array(truth[(name, full)]) + 0.5) / 2.0 - 0.5)
        for name in session.points for image, full in ids.items() if (name, full) in truth
    }  # fmt: skip
    off, asked = list_found(session, places)
    assert len(off) >= 0.3 * asked and max(off) < LARGEST_PX


def test_library_points_come_into_a_new_list(folder: Path, truth: Truth, library: str) -> None:
    """A project without GCPs gets those of the library that it shows, as they were surveyed; another place none."""
    session, known = open_day(folder, 2, points=""), open_day(folder, 1).points
    session.library = ChipLibrary(library)
    found = list_library_points(session)
    measured, seen = ({name for name, image in truth if image.startswith(day)} for day in ("d1", "d2"))
    inside = {name for (name, image), xy in truth.items() if image.startswith("d2") and 20 < min(xy) < max(xy) < 579}
    assert len(measured & inside) > 4 and measured & inside <= {one.id for one in found} <= measured & seen
    for one in found:
        assert one == known[one.id]
    session.add_points([replace(found[0], id="another name"), replace(found[1], lon=found[1].lon + 0.01)])
    assert {one.id for one in list_library_points(session)} == {one.id for one in found[2:]}
    assert not session.library.find_rows(session.points[found[1].id]).size, "the same id a kilometre away"
    for name, image in session.images.items():
        session.images[name] = replace(image, rpc=replace(image.rpc, long_off=image.rpc.long_off + 7.0))
    session.add_points([])  # and so predicts anew
    assert not session.is_seen(found[2])


def test_suspected_and_unused_measurements_get_no_chip(folder: Path, truth: Truth, tmp_path: Path) -> None:
    session = open_day(folder, 1)
    for (name, image), (sample, line) in truth.items():
        if image in session.images:
            session.set_measurement(name, image, ImageMeasurement(sample, line))
    bad = next(name for name, image in session.measured if (name, "d1_2") in session.measured)
    session.set_measurement(bad, "d1_2", ImageMeasurement(truth[(bad, "d1_2")][0] + 9.0, truth[(bad, "d1_2")][1]))
    session.accept(adjust_block(block_of(session), "shift"))
    unused = next(name for name, _ in session.measured if name != bad)
    session.set_role(unused, "off")
    session.library = ChipLibrary(str(tmp_path / "chips.gpkg"))
    save_chips(session)
    rows = ChipLibrary(session.library.path).rows
    kept = set(zip(rows.id.tolist(), rows.image.tolist(), strict=True))
    assert kept and (bad, "d1_2") not in kept and unused not in {name for name, _ in kept}
    assert kept >= {key for key in session.measured if key[0] not in (bad, unused)}


def test_chips_are_pictures_of_any_program(folder: Path, truth: Truth, library: str) -> None:
    """GDAL reads what stands in the field: the image's pixels, stretched from 1 to 65535."""
    rows, session = ChipLibrary(library).rows, open_day(folder, 1)
    for row in range(len(rows.id)):
        gdal.FileFromMemBuffer("/vsimem/chip.png", base64.b64decode(rows.pixels[row]))
        seen = gdal.Open("/vsimem/chip.png").ReadAsArray().astype(float)
        place = np.array(truth[(rows.id[row], rows.image[row])])
        low = np.round(place - [rows.sample[row], rows.line[row]]).astype(int)
        grey, _ = session.images[rows.image[row]].pixels.read(*low.tolist(), seen.shape[1], seen.shape[0])
        share = (grey - grey.min(initial=65535)) / (float(grey.max()) - float(grey.min()))
        np.testing.assert_allclose(seen, 1.0 + 65534.0 * share, atol=0.51)
        gsd_m = np.sqrt(abs(np.linalg.det(ChipLibrary(library).read_geometry(row))))
        assert gsd_m == pytest.approx(rows.gsd_m[row]) and 0.4 < gsd_m < 1.0  # Pléiades: 0.7 m
    gdal.Unlink("/vsimem/chip.png")


def test_what_is_no_library_is_told(folder: Path, tmp_path: Path) -> None:
    session = open_day(folder, 1)
    files.save(session, str(tmp_path / "block.gpkg"))
    with pytest.raises(InputError, match="has no layer 'chips'"):
        ChipLibrary(str(tmp_path / "block.gpkg"))
    png = encode_png(np.arange(1200, dtype=np.uint16).reshape(30, 40))
    assert decode_png(png).sum() == np.arange(1200).sum()
    for damaged in (png[:20], png[:60], b"\x89PNG" + bytes(60), png[:41] + bytes(20) + png[61:]):
        with pytest.raises(InputError, match="save the chip again"):
            decode_png(damaged)
