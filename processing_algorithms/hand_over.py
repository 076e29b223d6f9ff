"""`hand-over`: reads the adjusted block of a result folder and writes it as a project of another program."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from shapely.geometry import box
from shapely.ops import unary_union

from ..hrsi_engine.block.block import Image
from ..hrsi_engine.block.imaging_geometry import ViewDirection, compute_all_pairs, intersect_footprints
from ..hrsi_engine.block.stereo_pairs import StereoPair, choose_stereo_pairs
from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.foundation.progress import advance
from ..hrsi_engine.ground.map_crs import map_epsg
from ..hrsi_engine.io.catalogue.block_records import read_record
from ..hrsi_engine.io.output_dir import find_image_outputs, read_report
from ..hrsi_engine.io.point_files import read_points
from ..hrsi_engine.io.point_files.find import read_table
from ..hrsi_engine.io.point_files.interpret import interpret
from ..hrsi_engine.io.point_files.positions import Reference
from ..hrsi_engine.io.projects import PROJECT_PLANNERS, BlockProject
from ..hrsi_engine.io.rasters.sun_angles import read_sun, read_time
from ..hrsi_engine.io.rpc_files import read_rpc
from ..hrsi_engine.ortho.point_surface import surface_of_points
from .block_steps.inputs import open_block_images
from .block_steps.outputs import RESAMPLED
from .declarations.rpcs import HandOverOptions
from .files.opening import dem_surface
from .files.orthoimage_plan import parse_box
from .files.result_folder import REPORT_FILE, check_folder, plan, stage_results
from .interface.declare import Context, Report

SHAKEN = (
    "the images contain jitter that the refined RPCs do not: surface models get waves; adjust the block with `write` "
    "resampled, and hand over that result"
)


def run(options: HandOverOptions, context: Context) -> Report:
    """Read the block, choose pairs and area, and write the project."""
    check_folder(options.folder, context)
    record, told = read_record(options.result), read_report(os.path.join(options.result, REPORT_FILE)) or {}
    images = [_use_refined_rpc(image, told, options.result) for image in open_block_images(record)]
    known = read_table(record.layer("ground_points"))
    points, surveyed = (interpret(known, Reference(adjusted=adjusted), ()).ground for adjusted in (True, False))
    measured = read_points(record.layer("image_points"), image_ids=[image.id for image in images]).image
    if points is None or measured is None:
        raise InputError(f"{options.result}: has no adjusted points: adjust the block again")
    dem = dem_surface(options.dem, options.height_datum)
    surface = surface_of_points(points.ground, points.sigma_m[:, 1])[0] if dem is None else dem
    views = [ViewDirection(image, surface) for image in images]
    geometries = {view.image.id: view.geometry() for view in views}
    advance(context.progress, 0.3, "pairs")
    suns = {image.id: sun.angles if (sun := read_sun(image.path, image.rpc)) else None for image in images}
    times = {image.id: read_time(image.path) for image in images}
    ties = {image.id: set(measured.ids[measured.image_ids == image.id].tolist()) for image in images}
    pairs = choose_stereo_pairs(
        compute_all_pairs(views), {name: view.incidence_deg for name, view in geometries.items()},
        suns, times, ties, options.most_pairs,
    )  # fmt: skip
    if not pairs:
        raise InputError(f"{options.result}: no two images overlap under a useful angle: add images to the block")
    footprints = {view.image.id: view.footprint for view in views}
    area = unary_union(
        [intersect_footprints(footprints[pair.left], footprints[pair.right]) for pair in pairs]
    ).convex_hull
    if options.extent:
        area = box(*parse_box(options.extent, "EPSG:4326", "", "degrees")).intersection(area)
        if area.is_empty:
            raise InputError(f"`extent` {options.extent}: no chosen pair shows it: check box and CRS")
    gsd = float(
        np.median([np.hypot(view.gsd_sample_m, view.gsd_line_m) / np.sqrt(2.0) for view in geometries.values()])
    )
    surveyed = points.select(np.zeros(len(points), dtype=bool)) if surveyed is None else surveyed  # no surveyed points
    project = BlockProject(
        tuple(images), tuple(pairs), area, whole=not options.extent, surface=surface, gsd_m=gsd,
        epsg=map_epsg(area.centroid.x, area.centroid.y), copy=not options.link,
        factor=options.factor, suns=suns, times=times, points=points, surveyed=surveyed, measured=measured,
    )  # fmt: skip
    planned = PROJECT_PLANNERS[options.to](project)
    warnings = [*planned.notices, *([SHAKEN] if (told.get("outputs") or {}).get("jitter") else [])]
    if context.dry_run:
        counts = {"images": len(images), "pairs": len(pairs)}
        return plan(context, options.folder.output_dir, [REPORT_FILE, *planned.files], counts, warnings)
    folder = options.folder.output_dir
    report: Report = {
        **context.record, **planned.told, "to": options.to, "pairs": [_pair_entry(pair, gsd) for pair in pairs],
        "area": list(area.bounds), "gsd_m": gsd, "epsg": project.epsg, "warnings": warnings,
        "accuracy": _accuracy_of(told, pairs, gsd), "commands": [f"cd {folder}", *planned.commands],
        "expected": os.path.join(folder, planned.result),
        "images": {
            image.id: {"path": image.path, "output": os.path.join(folder, name)}
            for image in images for name in (f"{image.id}{suffix}" for suffix in (".tif", ".vrt", ".png"))
            if name in planned.files
        },
    }  # fmt: skip
    with stage_results(options.folder, report, context) as staged:
        planned.write(staged)
    return report


def _use_refined_rpc(image: Image, told: Mapping[str, Any], folder: str) -> Image:
    """Return an image with its refined RPC from the result folder, and with the pixels to which that RPC belongs."""
    found = find_image_outputs(told, folder).get(image.id, "")
    if not os.path.isfile(found):
        raise InputError(
            f"{folder}: contains no refined RPC of {image.id}: adjust the block again and let it be written"
        )
    resampled = (told.get("options") or {}).get("write") == RESAMPLED  # without jitter, which an RPC cannot represent
    return replace(image, rpc=read_rpc(found).rpc, path=found if resampled else image.path)


def _pair_entry(pair: StereoPair, gsd_m: float) -> dict[str, Any]:
    geometry = pair.geometry
    return {
        "left": pair.left, "right": pair.right, "score": pair.score, "convergence_deg": geometry.convergence_deg,
        "base_to_height": geometry.base_to_height, "overlap": min(geometry.overlap), "sun_deg": pair.sun_deg,
        "season_days": pair.season_days, "similarity": pair.similarity, "sigma_height_m": pair.height_sigma_m(gsd_m),
    }  # fmt: skip


def _accuracy_of(told: Mapping[str, Any], pairs: Sequence[StereoPair], gsd_m: float) -> dict[str, Any]:
    """Return the expected accuracy of heights: relative, from the pairs; absolute, from the adjustment."""
    parts = told.get("parts") or [{}]
    verdict = told.get("verdict") or {}
    return {
        "relative_height_m": min(pair.height_sigma_m(gsd_m) for pair in pairs),
        "ce90_m": max((part.get("ce90_m") or 0.0 for part in parts), default=0.0) or None,
        "le90_m": max((part.get("le90_m") or 0.0 for part in parts), default=0.0) or None,
        "tie_rmse_px": (told.get("ties") or {}).get("rmse_px"), "verdict": verdict.get("sentence"),
    }  # fmt: skip


def summarise(report: Report) -> str:
    """Return the pairs, the expected accuracy, and the commands to run."""
    lines = [
        f"{pair['left']} {pair['right']}: convergence {pair['convergence_deg']:.1f} deg, overlap "
        f"{pair['overlap']:.0%}, heights +- {pair['sigma_height_m']:.2f} m, score {pair['score']:.2f}"
        for pair in report["pairs"]
    ]
    accuracy = report["accuracy"]
    absolute = [
        f"{name} {accuracy[key]:.2g} m" for name, key in (("CE90", "ce90_m"), ("LE90", "le90_m")) if accuracy[key]
    ]
    lines.append(f"expected: heights +- {accuracy['relative_height_m']:.2f} m among themselves; {', '.join(absolute)}")
    views = report.get("perspective", {}).values()
    if views:
        worst = (max(view[key] for view in views) for key in ("rms_px", "max_px"))
        lines.append("perspective cameras: differ from the RPCs by {:.3f} px (RMS), {:.3f} px at most".format(*worst))
    lines += [f"warning: {text}" for text in report["warnings"]]
    commands = [f"then type:  {' && '.join(report['commands'])}"] if len(report["commands"]) > 1 else []
    return "\n".join([*lines, *commands, f"result:  {report['expected']}"])
