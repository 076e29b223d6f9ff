"""From a simulated block to its files and report."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ....hrsi_engine.block.block import Role
from ....hrsi_engine.foundation.progress import Progress, stage
from ....hrsi_engine.foundation.workers.threads import thread_count
from ....hrsi_engine.ground.geodesy import WGS84_3D
from ....hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ....hrsi_engine.io.output_dir import names_of_last_run, read_report
from ....hrsi_engine.io.pages.report import write_report_json
from ....hrsi_engine.io.rpc_files import write_rpc_text
from ....hrsi_engine.laboratory.simulated_files import (
    write_dem,
    write_ground_points,
    write_image,
    write_image_points,
    write_laser_points,
)
from ....hrsi_engine.laboratory.simulation.free_dem import FreeDem, simulate_free_dem
from ....hrsi_engine.laboratory.simulation.free_ortho import draw_ortho_errors, simulate_free_orthoimage
from ....hrsi_engine.laboratory.simulation.laser import simulate_laser
from ....hrsi_engine.laboratory.simulation.render import make_multispectral_renderers, make_orthophoto, make_renderer
from ....hrsi_engine.laboratory.simulation.synthesis import BlockSimulation
from ....hrsi_engine.laboratory.simulation.truth_tables import make_truth_document, make_truth_tables
from ....hrsi_engine.laboratory.simulation.vendor import fit_multispectral_rpc
from ....hrsi_engine.laboratory.simulation.views import SceneView
from ...interface.declare import Report
from ..declarations.simulate import SimulateOptions

LASER_SEED = 50  # of the laser points, different from the scene's own
TRUTH_FILES = ("dem.tif", "ground_points.csv", "image_points.csv", "truth.json", "truth.gpkg")
LASER_FILES = ("laser.csv", "true_laser.gpkg")
FREE_DEM, FREE_ORTHO = "free_dem.tif", "free_ortho.tif"
FREE_DEM_SEED, FREE_ORTHO_SEED = 60, 61


def report_simulated_block(simulated: BlockSimulation, record: Report) -> Report:
    """Return the entries of the report on the block: images with their RPC fits, and how many points there are."""
    truth, roles = simulated.truth, simulated.truth.role
    return {
        **record,
        "images": {
            view.id: {
                "size": list(view.size),
                "gsd_m": list(camera.gsd_m()),
                "rpc_fit_max_px": fit.max_px,
                "rpc_fit_rms_px": fit.rms_px,
            }
            for view, camera, fit in zip(simulated.views, truth.cameras, truth.vendor_rpcs, strict=True)
        },
        "points": {role.label: int(np.sum(roles == role)) for role in Role if role not in (Role.OFF, Role.HELD_OUT)},
        "observations": len(truth.image_points.point),
        "blunders": int(truth.blunder.sum()),
        "wrong_heights": int(truth.wrong_height.sum()),
    }


def write_points_and_truth(folder: Path, simulated: BlockSimulation, dem: FreeDem | None) -> list[str]:
    """Write terrain, points and truth, that of the free DEM included; return the names of the files."""
    terrain = simulated.scene.terrain
    write_dem(str(folder / "dem.tif"), terrain.posts, terrain.geotransform)
    write_ground_points(str(folder / "ground_points.csv"), simulated.block.points)
    write_image_points(str(folder / "image_points.csv"), simulated.block)
    truth = make_truth_document(simulated)
    if dem is not None:
        truth["free_dem"] = {"displaced_m": list(dem.shift_m)}
    write_report_json(str(folder / "truth.json"), truth)
    layers = [
        Layer(name, "PointZ", WGS84_3D, table.positions, table.columns)
        for name, table in make_truth_tables(simulated).items()
    ]
    write_geopackage(str(folder / "truth.gpkg"), layers)
    return list(TRUTH_FILES)


def files_of_simulation(views: Sequence[SceneView], options: SimulateOptions) -> list[str]:
    """Return the names of the files that a simulation writes besides its report."""
    ends = [".tif", *(["_ms.tif"] if options.ms else [])] if options.pixels else ["_RPC.TXT"]
    cameras = [f"{view.id}{end}" for view in views for end in ends]
    laser = LASER_FILES if options.laser.passes else ()
    wanted = (
        (FREE_DEM, options.free_dem.cell_m),
        ("orthophoto.tif", options.ortho),
        (FREE_ORTHO, options.free_ortho.pixel_m),
    )
    return [*TRUTH_FILES, *laser, *cameras, *(name for name, made in wanted if made)]


def files_of_earlier_run(folder: str) -> set[str]:
    """Return the names of the files in a folder that the report of an earlier simulation there lists."""
    report = read_report(os.path.join(folder, "report.json")) or {}
    if report.get("algorithm") != "simulate":
        return set()
    cameras = {f"{image}{end}" for image in report.get("images", ()) for end in (".tif", "_ms.tif", "_RPC.TXT")}
    return names_of_last_run(folder) & {*TRUTH_FILES, *LASER_FILES, *cameras, FREE_DEM, FREE_ORTHO, "orthophoto.tif"}


def write_laser(folder: Path, simulated: BlockSimulation, options: SimulateOptions) -> list[str]:
    """Write laser points and what is true of them; return the names of the files."""
    if not options.laser.passes:
        return []
    half_m = simulated.scene.half_extent_m
    laser = simulate_laser(simulated.scene.terrain, half_m, options.laser, [options.scene.seed, LASER_SEED])
    write_laser_points(str(folder / "laser.csv"), laser.points)
    met = np.array(["ground", "canopy", "cloud"])[laser.met]
    columns = {"id": laser.points.ids, "track": laser.points.track, "met": met, "error_m": laser.error_m}
    write_geopackage(
        str(folder / "true_laser.gpkg"), [Layer("true_laser_points", "PointZ", WGS84_3D, laser.points.ground, columns)]
    )
    return list(LASER_FILES)


def make_free_dem(simulated: BlockSimulation, options: SimulateOptions) -> FreeDem | None:
    """Return a DEM as free ones are; None where it is not wanted."""
    scene, spec = simulated.scene, options.free_dem
    seed = [options.scene.seed, FREE_DEM_SEED]
    return simulate_free_dem(scene.terrain, scene.half_extent_m, spec, seed) if spec.cell_m else None


def write_free_dem(folder: Path, dem: FreeDem | None) -> list[str]:
    """Write a DEM as free ones are; return the names of the files."""
    if dem is None:
        return []
    write_dem(str(folder / FREE_DEM), dem.heights_m, dem.geotransform)
    return [FREE_DEM]


def write_free_ortho(folder: Path, simulated: BlockSimulation, options: SimulateOptions, progress: Progress) -> Report:
    """Write an orthoimage as free ones are; return its displacement from the truth in its middle."""
    scene, spec = simulated.scene, options.free_ortho
    seen_m = max(0.5 * max(view.size) * view.sensor.gsd_m for view in simulated.views)  # the scene is larger
    errors = draw_ortho_errors(seen_m, spec, [options.scene.seed, FREE_ORTHO_SEED])
    bands = simulate_free_orthoimage(scene, spec, errors)
    threads = thread_count()
    write_image(str(folder / FREE_ORTHO), bands, None, bands[0].geotransform, threads, stage(progress, 0.99, 1.0))
    east, north = errors.mean_m
    return {"mean_east_m": east, "mean_north_m": north, "error_m": spec.error_m, "corner_m": spec.corner_m}


def write_cameras(folder: Path, simulated: BlockSimulation, options: SimulateOptions, progress: Progress) -> list[str]:
    """Write images, or RPC files in their place, and the orthophoto; return the names of the files."""
    threads = thread_count()
    count = len(simulated.views) + options.ortho
    names: list[str] = []
    for index, image in enumerate(simulated.block.images):
        part = stage(progress, index / count, (index + 1) / count)
        if options.pixels:
            names += _write_images(folder, simulated, index, options.ms, threads, part)
        else:
            names.append(f"{image.id}_RPC.TXT")
            write_rpc_text(str(folder / names[-1]), image.rpc)
    if options.ortho:
        ortho = make_orthophoto(simulated.scene, simulated.scene.finest_gsd_m)
        names.append("orthophoto.tif")
        write_image(
            str(folder / names[-1]), [ortho], None, ortho.geotransform, threads, stage(progress, 1 - 1 / count, 1.0)
        )
    return names


def _write_images(
    folder: Path, simulated: BlockSimulation, index: int, ms: bool, threads: int, progress: Progress
) -> list[str]:
    """Write the panchromatic and, where wanted, the multispectral image of a view."""
    image, ratio = simulated.block.images[index], simulated.views[index].sensor.ms_ratio
    names = [f"{image.id}.tif"]
    write_image(
        str(folder / names[0]),
        [make_renderer(simulated, image.id)],
        image.rpc,
        None,
        threads,
        stage(progress, 0.0, 0.8),
    )
    if ms:
        names.append(f"{image.id}_ms.tif")
        rpc = fit_multispectral_rpc(image.rpc, ratio)
        bands = make_multispectral_renderers(simulated, image.id)
        write_image(str(folder / names[1]), bands, rpc, None, threads, stage(progress, 0.8, 1.0))
    return names
