"""Figures of docs/reference.md: GCPs from an orthoimage, blocks without GCPs, orthoimages after refinement.

``python benchmarks/reference_accuracy.py [matching] [without] [orthoimages] [real]`` prints all tables, or those named.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import reference_scenes as scenes  # noqa: E402

from hrsi.benchmarks import pages  # noqa: E402
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust  # noqa: E402
from hrsi.hrsi_engine.adjustment.statistics.precision import CIRCLE_90, LINE_90  # noqa: E402
from hrsi.hrsi_engine.block.block import ArrayRaster, Image  # noqa: E402
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m  # noqa: E402
from hrsi.hrsi_engine.laboratory.simulation import (  # noqa: E402
    SENSORS,
    BlockSimulation,
    Noise,
    OrientationError,
    PointCounts,
    SceneSpec,
    make_along_track_views,
    simulate_block,
)
from hrsi.hrsi_engine.measurement.reference.checks import ReferenceAccuracy, compute_reference_shift  # noqa: E402
from hrsi.hrsi_engine.measurement.reference.matching import ReferenceControl, match_reference  # noqa: E402
from hrsi.hrsi_engine.measurement.reference.options import ReferenceOptions  # noqa: E402
from hrsi.hrsi_engine.surface.dem import intersect_surface  # noqa: E402
from hrsi.hrsi_engine.surface.grid_surface import GridSurface  # noqa: E402

DATA = pages.DATA / "real"
OPTIONS = ReferenceOptions(points=150)
SEEDS = 100


# ---- matching --------------------------------------------------------------------------------------------------


def seasonal(scene: scenes.Scene) -> scenes.Scene:
    """Return a scene whose reference is of another season."""
    grey = scenes.another_season(scene.reference.raster.grey)  # type: ignore[attr-defined]
    return replace(scene, reference=replace(scene.reference, raster=ArrayRaster(grey)))


def inverted(scene: scenes.Scene) -> scenes.Scene:
    """Return a scene whose reference is a negative."""
    grey = 2047 - scene.reference.raster.grey  # type: ignore[attr-defined]
    return replace(scene, reference=replace(scene.reference, raster=ArrayRaster(grey)))


def rough_dem(scene: scenes.Scene) -> scenes.Scene:
    """Return a scene with a DEM of every fourth post (22 m) and 1 m of noise."""
    terrain = scene.simulated.scene.terrain
    posts = terrain.posts[::4, ::4]
    posts = posts + np.random.default_rng(1).normal(0.0, 1.0, posts.shape)
    west, lon_step, _, north, _, lat_step = terrain.geotransform
    surface = GridSurface.from_array(
        posts, (west + lon_step / 2.0, north + lat_step / 2.0), (4 * lon_step, 4 * lat_step)
    )
    return replace(scene, terrain=surface)


LARGE = OrientationError(position_m=(150.0, -90.0, 20.0))
#: What the reference is like -> the scene.
CASES: dict[str, Callable[[], scenes.Scene]] = {
    "like the image": lambda: scenes.make(size=800),
    "near infrared": lambda: scenes.make(size=800, band="nir"),
    "negative": lambda: inverted(scenes.make(size=800)),
    "another season": lambda: seasonal(scenes.make(size=800)),
    "pixels of 0.35 m": lambda: scenes.make(size=800, ratio=0.5),
    "pixels of 2.8 m": lambda: scenes.make(size=800, ratio=4.0),
    "RPC with an error of 240 px": lambda: scenes.make(size=800, error=LARGE),
    "rough DEM": lambda: rough_dem(scenes.make(size=800)),
}


def rmse(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))


def matching() -> None:
    """Print how well places are found, by what the reference is like."""
    print("\nPlaces of an orthophoto in an image of 800 x 800 px of 0.72 m, against the true camera")
    print(f"{'reference':<18}{'used':>9}{'RMSE sample, line px':>24}{'sigma px':>10}{'bias found px':>18}{'CPU s':>8}")
    for name, make in CASES.items():
        scene = make()
        start = time.process_time()
        control = match_reference(scene.images, scene.reference, scene.terrain, OPTIONS)
        seconds = time.process_time() - start
        found = control.images[0]
        place = control.ground[found.places]
        place[:, 2] = scene.simulated.scene.terrain.height_at(place)  # where the place is, whatever the DEM says
        error = scene.true_error_px(0, place, found.xy)[found.used]
        bias = found.offset_px[found.used].mean(axis=0)
        print(
            f"{name:<18}{found.used.sum():>4}/{len(found.used):<4}{rmse(error)[0]:>15.3f}{rmse(error)[1]:>9.3f}"
            f"{np.median(found.sigma_px[found.used]):>10.2f}{bias[0]:>10.1f}{bias[1]:>8.1f}{seconds:>8.1f}"
        )


# ---- without GCPs ----------------------------------------------------------------------------------------------


def pleiades_triplet(seed: int, points: PointCounts) -> BlockSimulation:
    views = make_along_track_views(SENSORS["pleiades"], 3, (1500, 1500))
    return simulate_block(SceneSpec(seed=seed), views, points, Noise())


def without() -> None:
    """Print how often the stated CE90 and LE90 hold the simulated absolute error."""
    circle, line, scaled = [], [], []
    for seed in range(SEEDS):
        simulated = pleiades_triplet(seed, PointCounts(0, 30, 80))
        result = adjust(simulated.block, AdjustOptions(reject_sigma=0.0))
        sigma = np.array(result.parts[0].sigma_m)
        error = ground_difference_m(result.ground, simulated.truth.ground).mean(axis=0)
        circle.append(np.hypot(*error[:2]) <= CIRCLE_90 * np.hypot(*sigma[:2]))
        line.append(abs(error[2]) <= LINE_90 * sigma[2])
        scaled.append(error / sigma)
    print(f"\nPleiades triplets without GCPs, {SEEDS} seeds: orbit and attitude errors drawn, ERR_BIAS stated")
    print(f"absolute error within the stated CE90: {100 * np.mean(circle):.0f} %, LE90: {100 * np.mean(line):.0f} %")
    print("true / stated sigma east, north, height:", *rmse(np.array(scaled)).round(2))


# ---- orthoimages -----------------------------------------------------------------------------------------------


def refined_images(scene: scenes.Scene, gcps: bool) -> list[Image]:
    """Return the images with RPCs refined by all ties, with or without the GCPs."""
    block = scene.simulated.block
    if not gcps:
        role = np.where(block.points.role == 0, 2, block.points.role)
        block = replace(block, points=replace(block.points, role=role))
    result = adjust(block, AdjustOptions(model="shift-drift" if gcps else "shift", reject_sigma=0.0))
    return [
        replace(image, rpc=result.model.compute_refined_rpc(image, values).rpc)
        for image, values in zip(scene.images, result.values, strict=True)
    ]


def true_shift_m(scene: scenes.Scene, number: int, image: Image) -> np.ndarray:
    """Return by how much an image's RPC puts the ground of its middle beside the truth, at the true height."""
    middle = image.centre_px[None]
    true, _ = intersect_surface(scene.simulated.truth.rpcs[number].rpc, middle, scene.terrain)
    by_rpc, _ = image.rpc.localize(middle, true[:, 2])
    return ground_difference_m(by_rpc, true)[0, :2]


def shifts_m(scene: scenes.Scene, images: list[Image], control: ReferenceControl) -> list[np.ndarray]:
    found = [
        compute_reference_shift(image, part, control.ground, ReferenceAccuracy(0.1, 0.1))
        for image, part in zip(images, control.images, strict=True)
    ]
    return [np.array([np.nan, np.nan]) if s is None else np.array([s.east_m, s.north_m]) for s in found]


def orthoimages() -> None:
    """Print how orthoimages lie on the true orthophoto, with 5 GCPs and without, and whether that is the true error."""
    print("\nWhat the refined RPCs show on the true terrain, measured against the true orthophoto (0.7 m pixels)")
    print(f"{'seed':>4}{'image':>9}  {'5 GCPs: RMSE px':>16}{'without: measured E, N m':>27}{'simulated E, N m':>21}")
    for seed in (1, 2, 3):
        scene = scenes.make(seed=seed, size=600, images=2, points=PointCounts(5, 5, 150), noise_px=0.15)
        held, free = refined_images(scene, True), refined_images(scene, False)
        options = replace(OPTIONS, points=80)
        with_gcps = match_reference(held, scene.reference, scene.terrain, options)
        alone = match_reference(free, scene.reference, scene.terrain, options)
        measured = shifts_m(scene, free, alone)
        for number, image in enumerate(scene.images):
            part = with_gcps.images[number]
            left = float(np.sqrt(np.mean(part.offset_px[part.used] ** 2)))
            true = true_shift_m(scene, number, free[number])
            print(
                f"{seed:>4}{image.id:>9}  {left:>16.3f}{measured[number][0]:>18.2f}{measured[number][1]:>9.2f}"
                f"{true[0]:>12.2f}{true[1]:>9.2f}"
            )


# ---- real images -----------------------------------------------------------------------------------------------


def real() -> None:
    """Match two images of the s2p triplet with an orthoimage of the third, changed as by another season."""
    from osgeo import gdal

    from hrsi.hrsi_engine.io.rasters.dems import open_dem
    from hrsi.hrsi_engine.io.rasters.images import open_image
    from hrsi.hrsi_engine.io.rasters.ortho_rasters import open_reference

    folder, work = DATA / "s2p_triplet_phr", ROOT / "build" / "reference"
    if not folder.is_dir():
        print(f"\n{folder} is not there")
        return
    work.mkdir(parents=True, exist_ok=True)
    dem = str(folder / "s2p_reference_dsm.tif")
    options = gdal.WarpOptions(
        rpc=True, transformerOptions=[f"RPC_DEM={dem}", "RPC_DEM_MISSING_VALUE=200"], dstSRS="EPSG:32631", xRes=0.5,
        yRes=0.5, resampleAlg="cubic", errorThreshold=0.0,
    )  # fmt: skip
    gdal.Warp(str(work / "img_01.tif"), str(folder / "img_01.tif"), options=options)
    dataset = gdal.Open(str(work / "img_01.tif"))
    band = dataset.GetRasterBand(1).ReadAsArray()
    print("\nPleiades: images 2 and 3 of the s2p triplet against an orthoimage of image 1 (6.5 and 12.8 degrees aside)")
    print(f"{'reference':<18}{'image':>8}{'used':>10}{'spread px':>11}{'bias px':>18}")
    reference = open_reference(str(work / "img_01.tif"))
    grey = np.clip(band.astype(np.float64) / max(float(np.percentile(band, 99.9)), 1.0) * 1500.0, 0, 2047)
    for name, pixels in (("as it is", band), ("another season", scenes.another_season(grey.astype(np.uint16)))):
        changed = replace(reference, raster=ArrayRaster(pixels))
        images = [open_image(str(folder / f"img_0{k}.tif")) for k in (2, 3)]
        control = match_reference(images, changed, open_dem(dem, "ellipsoidal"), OPTIONS)
        for image, found in zip(images, control.images, strict=True):
            if found.agreement is None:
                print(f"{name:<18}{image.id:>8}  {found.refusal}")
                continue
            bias = found.agreement.bias(image.centre_px[None])[0]
            print(
                f"{name:<18}{image.id:>8}{found.used.sum():>5}/{len(found.used):<4}{found.agreement.spread_px:>11.2f}"
                f"{bias[0]:>10.2f}{bias[1]:>8.2f}"
            )


TABLES = {"matching": matching, "without": without, "orthoimages": orthoimages, "real": real}

if __name__ == "__main__":
    for table in sys.argv[1:] or TABLES:
        TABLES[table]()
