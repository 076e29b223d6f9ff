"""Images of one exposure: parts of a strip are found by names and RPCs, and have one camera."""

from dataclasses import replace

import numpy as np
import pytest

from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Image, ImagePoints
from hrsi.hrsi_engine.block.exposures import find_passes, join_parts_of_strips
from hrsi.hrsi_engine.block.pointing import estimate_pointing

from . import simulated_blocks as blocks

SIZE, CUT, OVERLAP = (4001, 4001), 2200, 400


def strip(number: int, tilt: float) -> tuple[Image, list[Image]]:
    """Return a strip and its two parts, which overlap by `OVERLAP` lines."""
    rpc = blocks.oblique_rpc(tilt, 0.05)
    name = f"WV01_2021020100513{{}}_10200100A186580{number}_21FEB0100513{{}}-P1BS-01626304801{number}_01"
    parts = [
        Image(name.format(0, 0) + "_P001", rpc, (SIZE[0], CUT + OVERLAP)),
        Image(name.format(1, 1) + "_P002", rpc.shift(0.0, -float(CUT)), (SIZE[0], SIZE[1] - CUT)),
    ]
    return Image(f"WV01_strip{number}", rpc, SIZE), parts


def measure(images: list[Image], truth: np.ndarray, pointing: np.ndarray) -> ImagePoints:
    """Return the image points of ground points on each image that shows them, shifted by its own pointing (px)."""
    tables = []
    for image, error in zip(images, pointing, strict=True):
        rng = np.random.default_rng(len(tables))
        xy = image.rpc.project(truth)
        seen = np.flatnonzero(((xy > 0) & (xy < image.size)).all(axis=1))
        noise = rng.normal(0.0, 0.2, (len(seen), 2))
        tables.append((np.array([f"T{k:04d}" for k in seen]), np.full(len(seen), image.id), xy[seen] + error + noise))
    return ImagePoints(*(np.concatenate(column) for column in zip(*tables, strict=True)), 0.2)


def test_parts_of_a_strip_are_one_look():
    wholes, parts = zip(*(strip(k, tilt) for k, tilt in enumerate((0.3, -0.25))), strict=True)
    several = [part for pair in parts for part in pair]
    joined = join_parts_of_strips(several)
    assert [image.tile.first for image in joined] == [(0, 0), (0, CUT)] * 2
    assert all(image.tile.size == SIZE for image in joined)
    truth, error = blocks.ground(300, 4), np.array([[4.0, -3.0], [-5.0, 2.0]])
    options = AdjustOptions(model="shift", reject_sigma=0.0)
    whole = adjust(assemble(wholes, [], [measure(list(wholes), truth, error)]), options)
    rows = measure(several, truth, np.repeat(error, 2, axis=0))
    as_one, apart = (adjust(assemble(images, [], [rows]), options) for images in (joined, several))
    assert np.allclose(as_one.values[0], as_one.values[1]) and np.allclose(as_one.values[2], as_one.values[3])
    assert as_one.parts[0].sigma_m == pytest.approx(whole.parts[0].sigma_m, rel=0.03)
    assert apart.parts[0].sigma_m[0] < 0.9 * whole.parts[0].sigma_m[0]


def test_images_that_are_no_windows_of_the_same_pixels_stay_apart():
    _, (first, second) = strip(1, 0.3)
    turned = replace(second, rpc=blocks.oblique_rpc(0.0, 0.3).shift(0.0, -float(CUT)))
    assert all(image.tile is None for image in join_parts_of_strips([first, turned]))
    assert all(image.tile is None for image in join_parts_of_strips([replace(first, id="a"), replace(second, id="b")]))


FRAMES = [f"20200930_154933_ssc13d{detector}_00{number}" for detector, number in ((1, 17), (2, 17), (2, 18))]


def test_frames_of_one_second_are_a_pass():
    rpc = blocks.oblique_rpc(0.1, 0.05)
    names = [*FRAMES, "20200930_155007_ssc13d2_0012", "20200930_155007_a", "b"]
    assert [one.tolist() for one in find_passes([Image(name, rpc, SIZE) for name in names])] == [[0, 1, 2]]


def test_frames_of_a_pass_point_no_better_than_one():
    """Theory: errors of k images leave 1/k of the variance of their mean, an error that they share leaves all of it."""
    names = [name.replace("_154933_", f"_15493{k}_") for k, name in enumerate(FRAMES)]
    truth, error = blocks.ground(300, 4), np.array([[4.0, -3.0]] * 3)
    found = {}
    for what, ids in (("pass", FRAMES), ("apart", names)):
        images = [
            Image(name, blocks.oblique_rpc(tilt, 0.05), SIZE)
            for name, tilt in zip(ids, (0.25, 0.0, -0.25), strict=True)
        ]
        block = assemble(images, [], [measure(images, truth, error)])
        found[what] = adjust(block, AdjustOptions(model="shift", reject_sigma=0.0, sigma_drift=0.0))
    sigma_m = estimate_pointing(images[0]).sigma_m
    joint, apart = (np.array(found[what].parts[0].sigma_m) for what in ("pass", "apart"))
    assert joint[:2] == pytest.approx([sigma_m, sigma_m], rel=0.06)
    assert apart[:2] == pytest.approx([sigma_m / 3**0.5, sigma_m / 3**0.5], rel=0.06)
    assert joint[2] < 0.3 * apart[2]  # heights follow from differences of pointing, which are small in a pass
    kept = np.isfinite(found["pass"].ground_sigma_m).all(axis=1)
    covariance = found["pass"].covariance_to_surveys_m2(np.flatnonzero(kept))
    assert np.sqrt(covariance.diagonal(axis1=1, axis2=2)) == pytest.approx(found["pass"].ground_sigma_m[kept], rel=1e-9)
    assert (np.linalg.eigvalsh(found["pass"].ground_covariance_m2[kept]) > 0.0).all()
