"""Bands of one exposure: found by their lines of sight, adjusted by one camera, refined without points of their own."""

from dataclasses import replace

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment import Adjustment
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import GroundPoints, Image, ImagePoints, Role, Tile
from hrsi.hrsi_engine.block.exposures import join_exposures
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.refinement.models import MODELS

from . import simulated_blocks as blocks

PIXEL, FIRST = 4.0, 1.5  # the corners of both images lie on each other


def exposure(number: int, tilt: tuple[float, float], size: int = 4000) -> list[Image]:
    """Return the PAN image and the MS image of an exposure."""
    pan = blocks.oblique_rpc(*tilt, heading=0.1 * number)
    band = pan.resample((PIXEL, PIXEL), (FIRST, FIRST))
    return [Image(f"p{number}", pan, (size, size)), Image(f"m{number}", band, (size // 4, size // 4))]


def error_of(number: int, seed: int) -> np.ndarray:
    """Return the affine error of an exposure ``(2, 3)`` in PAN pixels: constant, by sample, by line."""
    rng = np.random.default_rng([seed, number])
    return np.column_stack([rng.normal(0, 8.0, 2), rng.normal(0, 2e-5, (2, 2))])


def see(image: Image, error: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Return where the sensor sees ground points, by the PAN's geometry in closed form."""
    pixel, first = (PIXEL, FIRST) if image.id.startswith("m") else (1.0, 0.0)
    pan = image.rpc.project(ground) * pixel + first
    moved = pan + error[:, 0] + (pan - 1999.5) @ error[:, 1:].T
    return np.asarray((moved - first) / pixel)


def measure(
    images: list[Image], ground: np.ndarray, seed: int, noise_px: float = 0.2, name: str = "T"
) -> list[ImagePoints]:
    """Return the points measured on each of the images."""
    tables = []
    for index, image in enumerate(images):
        rng = np.random.default_rng([seed, index])
        xy = see(image, error_of(int(image.id[1:]), seed), ground)
        ids = [f"{name}{k:04d}" for k in range(len(ground))]
        rows = xy + rng.normal(0, noise_px, xy.shape)
        tables.append(ImagePoints(ids, [image.id] * len(ground), rows, noise_px))
    return tables


VIEWS = ((0.3, 0.05), (-0.25, 0.05))


def make_images() -> tuple[list[Image], list[Image]]:
    """Return the PAN images and the MS images of a stereo pair."""
    pans, bands = zip(*(exposure(k, view) for k, view in enumerate(VIEWS)), strict=True)
    return list(pans), list(bands)


def control(ground: np.ndarray, name: str, role: int = Role.GCP) -> GroundPoints:
    ids = np.array([f"{name}{k:04d}" for k in range(len(ground))])
    return GroundPoints(ids, ground, np.full(len(ground), role), 0.1)


def refine(result: Adjustment) -> dict[str, RPC]:
    """Return the refined RPC of each image."""
    images = zip(result.block.images, result.values, strict=True)
    return {image.id: result.model.compute_refined_rpc(image, values).rpc for image, values in images}


def off_truth_px(result: Adjustment, images: list[Image], seed: int) -> np.ndarray:
    """Return the largest distance of each image's refined RPC from the sensor over the scene, own pixels."""
    ground, refined = blocks.ground(200, 99), refine(result)
    apart = [refined[one.id].project(ground) - see(one, error_of(int(one.id[1:]), seed), ground) for one in images]
    return np.array([np.hypot(*xy.T).max() for xy in apart])


def test_bands_are_found_by_their_lines_of_sight():
    pans, bands = make_images()
    joined = join_exposures([*bands, *pans])
    for k, band in enumerate(joined[:2]):
        assert band.tile.scene == joined[2 + k].tile.scene == f"p{k}"
        assert band.tile.pixel == pytest.approx(PIXEL, abs=1e-6)
        assert band.tile.first == pytest.approx((FIRST, FIRST), abs=1e-3)
        assert band.camera_centre_px * PIXEL + FIRST == pytest.approx([1999.5, 1999.5], abs=1e-3)


def test_tiles_of_a_band_follow_to_the_scene_of_its_pan():
    (pan, band) = exposure(0, VIEWS[0])
    tiles = [replace(band, id=f"m0_{k}", rpc=band.rpc.shift(0.0, -500.0 * k), size=(1000, 500)) for k in (0, 1)]
    windows = [replace(pan, id=f"p0_{k}", rpc=pan.rpc.shift(-2000.0 * k, 0.0), size=(2000, 4000)) for k in (0, 1)]
    tiles = [replace(one, tile=Tile("RPC_MS", (0.0, 500.0 * k), (1000, 1000))) for k, one in enumerate(tiles)]
    windows = [replace(one, tile=Tile("RPC_P", (2000.0 * k, 0.0), (4000, 4000))) for k, one in enumerate(windows)]
    joined = join_exposures([*tiles, *windows])
    assert {image.tile.scene for image in joined} == {"RPC_P"}
    assert joined[1].tile.first == pytest.approx((FIRST, FIRST + 2000.0), abs=1e-3)


@pytest.mark.parametrize(
    "other",
    [
        lambda band: replace(band, rpc=blocks.oblique_rpc(0.31, 0.05).resample((4.0, 4.0), (1.5, 1.5))),  # parallax
        lambda band: replace(band, rpc=blocks.oblique_rpc(0.3, 0.05, heading=0.002).resample((4.0, 4.0), (1.5, 1.5))),
        lambda band: replace(band, id="IMG_MS_202502250025329"),
        lambda band: replace(band, sensor="WorldView-2"),
    ],
    ids=["other view", "turned", "other time", "other satellite"],
)
def test_images_of_other_exposures_stay_apart(other):
    pan, band = exposure(0, VIEWS[0])
    pan = replace(pan, id="IMG_P_202502250023329", sensor="WorldView-3")
    assert all(image.tile is not None for image in join_exposures([pan, replace(band, id="IMG_MS")]))
    assert all(image.tile is None for image in join_exposures([pan, other(replace(band, id="IMG_MS"))]))


@pytest.mark.parametrize("model", mark_beyond(2, "thorough", [name for name in MODELS if name != "none"]))
def test_a_band_without_points_gets_the_correction_of_its_pan(model):
    pans, bands = make_images()
    ties, gcps = blocks.ground(200, 1), blocks.ground(12, 2)
    points = [*measure(pans, ties, 3), *measure(pans, gcps, 3, name="G")]
    result = adjust(assemble(join_exposures([*pans, *bands]), [control(gcps, "G")], points), AdjustOptions(model=model))
    refined = refine(result)
    ground = blocks.ground(200, 99)
    for k in range(len(pans)):
        of_pan = (refined[f"p{k}"].project(ground) - FIRST) / PIXEL
        assert np.hypot(*(refined[f"m{k}"].project(ground) - of_pan).T).max() < 0.05
    if model == "affine":
        assert (off_truth_px(result, bands, 3) < 0.05).all()


@pytest.mark.parametrize("model", mark_beyond(1, "thorough", ["affine", "shift", "auto"]))
def test_pan_and_ms_are_as_accurate_as_pan_alone(model):
    pans, bands = make_images()
    ties = blocks.ground(300, 1)
    options = AdjustOptions(model=model)
    rows = measure([*pans, *bands], ties, 4)
    alone = adjust(assemble(pans, [], rows[:2]), options)
    # the bands see half of the points, and points of one exposure's bands only
    half = [table.select(np.arange(150)) for table in rows[2:]]
    parallel = measure([pans[0], bands[0]], blocks.ground(40, 8), 4, name="Q")
    for images, given in (
        (join_exposures([*bands, *pans]), options),
        ([*bands, *pans], replace(options, shared_images=(("p0", "m0"), ("m1", "p1")))),
    ):
        both = adjust(assemble(images, [], [*rows[:2], *half, *parallel]), given)
        assert both.parts[0].ce90_m == pytest.approx(alone.parts[0].ce90_m, rel=0.05)
        assert both.parts[0].le90_m == pytest.approx(alone.parts[0].le90_m, rel=0.05)
        lonely = np.char.startswith(both.block.points.ids.astype(str), "Q")
        assert np.isnan(both.ground[lonely]).all() and np.isfinite(both.ground[~lonely]).all()
        assert (both.parts[0].points, len(both.parts[0].parallel)) == (300, 0)


def test_points_on_bands_alone_leave_the_accuracy_of_the_pans():
    pans, bands = make_images()
    ties, gcps, coarse = blocks.ground(200, 1), blocks.ground(9, 2), blocks.ground(150, 7)
    of_pans = [*measure(pans, ties, 6), *measure(pans, gcps, 6, name="G")]
    of_bands = [*measure(bands, ties[:80], 6), *measure(bands, coarse, 6, name="C")]
    given, options = [control(gcps, "G")], AdjustOptions(model="shift", reject_sigma=0.0)
    alone = adjust(assemble(pans, given, of_pans), options).parts[0]
    both = adjust(assemble(join_exposures([*pans, *bands]), given, [*of_pans, *of_bands]), options).parts[0]
    only = adjust(assemble(bands, given, [*measure(bands, gcps, 6, name="G"), *of_bands]), options).parts[0]
    # what the MS add can make it better by little: they weigh a sixteenth
    assert 0.95 * alone.ce90_m < both.ce90_m < 1.01 * alone.ce90_m
    assert 0.95 * alone.le90_m < both.le90_m < 1.01 * alone.le90_m
    assert (both.points, only.points) == (200, 230)


def test_shared_images_join_what_names_keep_apart():
    pan, band = exposure(0, VIEWS[0])
    pans, bands = make_images()
    pans[0], bands[0] = (replace(pan, id="p0", sensor="WorldView-2"), replace(band, id="m0", sensor="WorldView-3"))
    assert join_exposures([*pans, *bands])[2].tile is None
    options = AdjustOptions(model="affine", shared_images=(("p0", "m0"),))
    result = adjust(assemble([*pans, *bands], [], measure(pans, blocks.ground(100, 1), 3)), options)
    ground, refined = blocks.ground(50, 9), refine(result)
    apart = (refined["p0"].project(ground) - FIRST) / PIXEL - refined["m0"].project(ground)
    assert np.abs(apart).max() < 1e-6


def test_points_of_the_bands_alone_correct_the_pan():
    pans, bands = make_images()
    gcps = blocks.ground(60, 2)
    points = measure(bands, gcps, 5, noise_px=0.05, name="G")
    options = AdjustOptions(model="affine")
    result = adjust(assemble(join_exposures([*pans, *bands]), [control(gcps, "G")], points), options)
    assert (off_truth_px(result, [*bands], 5) < 0.1).all() and (off_truth_px(result, [*pans], 5) < 0.4).all()


def test_a_pan_sharpened_image_is_joined_where_it_is_named():
    pans, _ = make_images()
    sharpened = replace(pans[0], id="s0")
    points = measure(pans, blocks.ground(100, 1), 3)
    options = AdjustOptions(model="affine", shared_images=(("s0", "p0"),))
    result = adjust(assemble([*pans, sharpened], [], points), options)
    ground, refined = blocks.ground(50, 9), refine(result)
    assert refined["s0"].project(ground) == pytest.approx(refined["p0"].project(ground), abs=1e-6)
    assert (result.block.exposure_of_image == [0, 1, 0]).all()
