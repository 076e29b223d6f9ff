"""`simulate`: a synthetic block with images, DEM, GCPs, noise and full truth."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import Role
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.progress import Progress, stage
from ...hrsi_engine.foundation.workers.threads import thread_count
from ...hrsi_engine.ground.geodesy import WGS84_3D
from ...hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ...hrsi_engine.io.opening.files import read_text
from ...hrsi_engine.io.output_dir import check_output_dir, names_of_last_run, read_report, stage_folder
from ...hrsi_engine.io.pages.report import write_report_json
from ...hrsi_engine.io.rpc_files import write_rpc_text
from ...hrsi_engine.io.safety.transactions import Transaction
from ...hrsi_engine.laboratory.simulated_files import (
    write_dem,
    write_ground_points,
    write_image,
    write_image_points,
    write_laser_points,
)
from ...hrsi_engine.laboratory.simulation.acquisitions import draw_acquisitions
from ...hrsi_engine.laboratory.simulation.free_dem import FreeDem, simulate_free_dem
from ...hrsi_engine.laboratory.simulation.free_ortho import draw_ortho_errors, simulate_free_orthoimage
from ...hrsi_engine.laboratory.simulation.laser import simulate_laser
from ...hrsi_engine.laboratory.simulation.options import SceneSpec
from ...hrsi_engine.laboratory.simulation.render import make_multispectral_renderers, make_orthophoto, make_renderer
from ...hrsi_engine.laboratory.simulation.sensors import SENSORS, OrientationError, Sensor, Vibration
from ...hrsi_engine.laboratory.simulation.synthesis import BlockSimulation, simulate_block
from ...hrsi_engine.laboratory.simulation.truth_tables import make_truth_document, make_truth_tables
from ...hrsi_engine.laboratory.simulation.vendor import fit_multispectral_rpc
from ...hrsi_engine.laboratory.simulation.views import (
    SceneView,
    make_along_track_views,
    make_strip_views,
    make_views_of_dates,
)
from ..files.result_folder import plan
from ..interface.declare import Context, Report
from .declarations.simulate import SimulateOptions, VendorErrorOptions, ViewOptions

SHORTEST_PERIOD = 50.0  #: lines
#: Options that give the vendor's error, and the field of `OrientationError` that each one sets.
VENDOR_ERRORS = {
    "vendor_position": "position_m",
    "vendor_position_drift": "position_drift_m",
    "vendor_attitude": "attitude_rad",
    "vendor_attitude_drift": "attitude_drift_rad",
}
LASER_SEED = 50  # of the laser points, different from the scene's own
TRUTH_FILES = ("dem.tif", "ground_points.csv", "image_points.csv", "truth.json", "truth.gpkg")
LASER_FILES = ("laser.csv", "true_laser.gpkg")
FREE_DEM, FREE_ORTHO = "free_dem.tif", "free_ortho.tif"
FREE_DEM_SEED, FREE_ORTHO_SEED = 60, 61


def run(options: SimulateOptions, context: Context) -> Report:
    """Simulate a block and write its files."""
    folder = options.folder.output_dir
    check_output_dir(folder, options.folder.overwrite)
    views = make_views(options.views, options.vendor, options.scene)
    if context.dry_run:
        names = ["report.json", *files_of_simulation(views, options)]
        return plan(context, folder, names, {"images": len(views), "GCPs": options.points.gcps})
    simulated = simulate_block(options.scene, views, options.points, options.noise, stage(context.progress, 0.0, 0.1))
    report = report_simulated_block(simulated, context.record)
    scene, dem_spec = simulated.scene, options.free_dem
    free_dem = (
        simulate_free_dem(scene.terrain, scene.half_extent_m, dem_spec, [options.scene.seed, FREE_DEM_SEED])
        if dem_spec.cell_m
        else None
    )
    changes = Transaction(folder)
    with changes, stage_folder(folder, context.inputs, options.folder.overwrite, changes) as temporary:
        names = write_points_and_truth(temporary, simulated, free_dem)
        names += write_laser(temporary, simulated, options)
        if free_dem is not None:
            write_dem(str(temporary / FREE_DEM), free_dem.heights_m, free_dem.geotransform)
            names.append(FREE_DEM)
        names += write_cameras(temporary, simulated, options, stage(context.progress, 0.1, 1.0))
        if options.free_ortho.pixel_m:
            report["free_ortho"] = write_free_ortho(temporary, simulated, options, context.progress)
            names.append(FREE_ORTHO)
        for name in files_of_earlier_run(folder) - {*names} if options.folder.overwrite else ():
            changes.remove(os.path.join(folder, name))
        report["outputs"] = [os.path.join(folder, name) for name in names]
        write_report_json(str(temporary / "report.json"), report)
    return report


def summarise(report: Report) -> str:
    """Return the numbers of points and observations, the size and pixels of each image, and the files."""
    points = report["points"]
    lines = [
        f"{len(report['images'])} images, {points['gcp']} GCPs, {points['check']} check points, "
        f"{points['tie']} tie points, {report['observations']} observations"
    ]
    for name, image in report["images"].items():
        (samples, rows), (across, along) = image["size"], image["gsd_m"]
        lines.append(
            f"{name}: {samples} x {rows} px of {across:.2f} x {along:.2f} m, "
            f"RPC fits its camera to {image['rpc_fit_max_px']:.1e} px"
        )
    return "\n".join([*lines, *report["outputs"]])


# ---- views -----------------------------------------------------------------------------------------------------------


def make_views(options: ViewOptions, vendor: VendorErrorOptions, scene: SceneSpec) -> tuple[SceneView, ...]:
    """Return the views that the options describe; raises `InputError` for angles that do not match the images."""
    sensor, size = SENSORS[options.sensor], (options.size, options.lines or options.size)
    heading, images = options.heading, options.images
    across: float | None = options.across
    if options.dates > 1:
        if options.strips * options.places > 1:
            raise InputError("`dates` are taken of one place: leave `strips` and `places` at 1")
        taken = make_views_of_dates(
            sensor,
            draw_acquisitions(options.dates, scene.lat_deg, scene.seed),
            images,
            size=size,
            heading_deg=heading,
            off_nadir_deg=options.off_nadir,
            seed=scene.seed,
        )
        across = options.across or None
    elif options.strips * options.places > 1:
        taken = make_strip_views(
            sensor,
            options.strips,
            options.places,
            images_per_place=images,
            size=size,
            overlap=options.overlap,
            heading_deg=heading,
        )
    else:
        taken = make_along_track_views(sensor, images, size, heading_deg=heading)
    angles = _numbers("along", options.along, images) if options.along else None
    error, vibration = _vendor_error(vendor), _make_vibration(vendor, sensor)
    # A pass has the images of one strip or date that look in one direction; each pass has its own phases
    of_pass = [(number // (images * options.places), number % images) for number in range(len(taken))]
    return tuple(
        replace(
            view,
            across_deg=view.across_deg if across is None else across,
            along_deg=view.along_deg if angles is None else angles[number % images],
            vendor_error=error,
            jitter=OrientationError(vibration=_start_vibration(vibration, [scene.seed, 62, *of_pass[number]])),
        )
        for number, view in enumerate(taken)
    )


def _numbers(argument: str, given: Sequence[str], count: int) -> tuple[float, ...]:
    """Return the numbers of an option such as ``1.5,0,-3``."""
    try:
        numbers = tuple(float(text) for text in given)
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise InputError(f"`{argument}` is {','.join(given)}: give {count} numbers separated by commas")
    return numbers


def _vendor_error(options: VendorErrorOptions) -> OrientationError | None:
    """Return the error of the vendor's orientation, None where it is to be random."""
    found: dict[str, Any] = {
        field: _numbers(name, values, 3) for name, field in VENDOR_ERRORS.items() if (values := getattr(options, name))
    }
    return OrientationError(**found) if found else None


def _make_vibration(options: VendorErrorOptions, sensor: Sensor) -> Vibration:
    """Return the vibration that is asked for; raises `InputError` for what is neither numbers nor a file of a curve."""
    given, pixel_rad = options.jitter, sensor.detector_angle_rad
    if len(given) == 1 and not _is_number(given[0]):
        table = _read_curve(given[0]) * (1.0, -pixel_rad, -pixel_rad)
        return Vibration(curve=tuple((line, roll, pitch) for line, roll, pitch in table.tolist()))
    if len(given) == 1:
        given = (given[0], str(options.jitter_period))
    numbers = _numbers("jitter", given, len(given) + len(given) % 2)
    if any(value < 0.0 for value in numbers) or any(period < SHORTEST_PERIOD for period in numbers[1::2]):
        raise InputError(
            f"`jitter` is {','.join(given)}: give amplitudes in px and periods of {SHORTEST_PERIOD:g} lines or more"
        )
    pairs = zip(numbers[::2], numbers[1::2], strict=True)
    return Vibration(waves=tuple((period, amplitude * pixel_rad, 0.0) for amplitude, period in pairs))


def _is_number(text: str) -> bool:
    """Return whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_curve(path: str) -> np.ndarray:
    """Return line, across and along (px) of the lines of a CSV file, ``(n, 3)``."""
    lines = read_text(path).splitlines()
    if lines and not _is_number(lines[0].partition(",")[0]):
        lines = lines[1:]
    try:
        table = np.array([line.split(",")[:3] for line in lines if line.strip()], dtype=np.float64)
    except ValueError:
        table = np.empty((0, 0))
    if table.ndim != 2 or table.shape[1:] != (3,) or len(table) < 2 or not np.isfinite(table).all():
        raise InputError(f"{path}: `jitter` takes a CSV file of numbers line, across and along (px), two rows or more")
    if not (np.diff(table[:, 0]) > 0.0).all():
        row = int(np.argmin(np.diff(table[:, 0]) > 0.0)) + 1
        raise InputError(f"{path}: line {table[row, 0]:g} follows line {table[row - 1, 0]:g}: sort the rows by line")
    return table


def _start_vibration(vibration: Vibration, seed: Sequence[int]) -> Vibration:
    """Return the vibration of a pass: its sines with random phases, its curve from a random line on."""
    rng = np.random.default_rng(seed)
    waves = tuple((period, size, float(rng.uniform(0.0, 2.0 * np.pi))) for period, size, _ in vibration.waves)
    start = float(rng.uniform(vibration.curve[0][0], vibration.curve[-1][0])) if vibration.curve else 0.0
    return replace(vibration, waves=waves, start_line=start)


# ---- files -----------------------------------------------------------------------------------------------------------


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
    scene, seed = simulated.scene, [options.scene.seed, LASER_SEED]
    laser = simulate_laser(scene.terrain, scene.half_extent_m, options.laser, seed)
    write_laser_points(str(folder / "laser.csv"), laser.points)
    met = np.array(["ground", "canopy", "cloud"])[laser.met]
    columns = {"id": laser.points.ids, "track": laser.points.track, "met": met, "error_m": laser.error_m}
    write_geopackage(
        str(folder / "true_laser.gpkg"), [Layer("true_laser_points", "PointZ", WGS84_3D, laser.points.ground, columns)]
    )
    return list(LASER_FILES)


def write_free_ortho(folder: Path, simulated: BlockSimulation, options: SimulateOptions, progress: Progress) -> Report:
    """Write an orthoimage as free ones are; return its displacement from the truth in its middle."""
    scene, spec = simulated.scene, options.free_ortho
    seen_m = max(0.5 * max(view.size) * view.sensor.gsd_m for view in simulated.views)  # the scene is larger
    errors = draw_ortho_errors(seen_m, spec, [options.scene.seed, FREE_ORTHO_SEED])
    bands, threads = simulate_free_orthoimage(scene, spec, errors), thread_count()
    write_image(str(folder / FREE_ORTHO), bands, None, bands[0].geotransform, threads, stage(progress, 0.99, 1.0))
    east, north = errors.mean_m
    return {"mean_east_m": east, "mean_north_m": north, "error_m": spec.error_m, "corner_m": spec.corner_m}


def write_cameras(folder: Path, simulated: BlockSimulation, options: SimulateOptions, progress: Progress) -> list[str]:
    """Write images, or RPC files in their place, and the orthophoto; return the names of the files."""
    threads, count, names = thread_count(), len(simulated.views) + options.ortho, list[str]()
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
    part, renderer = stage(progress, 0.0, 0.8), make_renderer(simulated, image.id)
    write_image(str(folder / names[0]), [renderer], image.rpc, None, threads, part)
    if ms:
        names.append(f"{image.id}_ms.tif")
        rpc, bands = fit_multispectral_rpc(image.rpc, ratio), make_multispectral_renderers(simulated, image.id)
        write_image(str(folder / names[1]), bands, rpc, None, threads, stage(progress, 0.8, 1.0))
    return names
