"""`hand-over`: reads the adjusted block of a result folder and writes it as a project of another program."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from shapely.geometry import box

from ..hrsi_engine.block.stereo_pairs import StereoPair
from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.foundation.progress import advance
from ..hrsi_engine.ground.map_crs import map_epsg
from ..hrsi_engine.io.projects import PROJECT_PLANNERS, BlockProject
from .block_steps.adjusted_block import read_adjusted_block
from .declarations.rpcs import HandOverOptions
from .files.orthoimage_plan import parse_box
from .files.result_folder import REPORT_FILE, check_folder, plan, stage_results
from .interface.declare import Context, Report


def run(options: HandOverOptions, context: Context) -> Report:
    """Read the block, choose pairs and area, and write the project."""
    check_folder(options.folder, context)
    block = read_adjusted_block(options.result, options.dem, options.height_datum)
    advance(context.progress, 0.3, "pairs")
    pairs = block.choose_pairs(options.most_pairs)
    if not pairs:
        raise InputError(f"{options.result}: no two images overlap under a useful angle: add images to the block")
    area = block.common_area(pairs).convex_hull
    if options.extent:
        area = box(*parse_box(options.extent, "EPSG:4326", "", "degrees")).intersection(area)
        if area.is_empty:
            raise InputError(f"`extent` {options.extent}: no chosen pair shows it: check box and CRS")
    views = [view.geometry() for view in block.views.values()]
    gsd = float(np.median([np.hypot(view.gsd_sample_m, view.gsd_line_m) / np.sqrt(2.0) for view in views]))
    surveyed = block.points.select(np.empty(0, dtype=int)) if block.surveyed is None else block.surveyed
    project = BlockProject(
        block.images, tuple(pairs), area, whole=not options.extent, surface=block.surface, gsd_m=gsd,
        epsg=map_epsg(area.centroid.x, area.centroid.y), copy=not options.link, factor=options.factor,
        suns=block.suns, times=block.times, points=block.points, surveyed=surveyed, measured=block.measured,
    )  # fmt: skip
    planned = PROJECT_PLANNERS[options.to](project)
    warnings, folder = [*planned.notices, *block.warnings], options.folder.output_dir
    if context.dry_run:
        counts = {"images": len(block.images), "pairs": len(pairs)}
        return plan(context, folder, [REPORT_FILE, *planned.files], counts, warnings)
    report: Report = {
        **context.record, **planned.told, "to": options.to, "pairs": [pair_entry(pair, gsd) for pair in pairs],
        "area": list(area.bounds), "gsd_m": gsd, "epsg": project.epsg, "warnings": warnings,
        "accuracy": _accuracy_of(block.told, pairs, gsd), "commands": [f"cd {folder}", *planned.commands],
        "expected": os.path.join(folder, planned.result),
        "images": {
            image.id: {"path": image.path, "output": os.path.join(folder, name)}
            for image in block.images for name in (f"{image.id}{suffix}" for suffix in (".tif", ".vrt", ".png"))
            if name in planned.files
        },
    }  # fmt: skip
    with stage_results(options.folder, report, context) as staged:
        planned.write(staged)
    return report


def pair_entry(pair: StereoPair, gsd_m: float) -> dict[str, Any]:
    """Return the report's entry of a stereo pair, with the standard deviation of its heights at a pixel size (m)."""
    return {
        "left": pair.left,
        "right": pair.right,
        "score": pair.score,
        "convergence_deg": pair.geometry.convergence_deg,
        "base_to_height": pair.geometry.base_to_height,
        "overlap": min(pair.geometry.overlap),
        "sun_deg": pair.sun_deg,
        "season_days": pair.season_days,
        "similarity": pair.similarity,
        "sigma_height_m": pair.height_sigma_m(gsd_m),
    }


def _accuracy_of(told: Mapping[str, Any], pairs: Sequence[StereoPair], gsd_m: float) -> dict[str, Any]:
    """Return the expected accuracy of heights: relative, from the pairs; absolute, from the adjustment."""
    parts = told.get("parts") or ()
    return {
        "relative_height_m": min(pair.height_sigma_m(gsd_m) for pair in pairs),
        **{key: max((part.get(key) or 0.0 for part in parts), default=0.0) or None for key in ("ce90_m", "le90_m")},
        "tie_rmse_px": (told.get("ties") or {}).get("rmse_px"),
        "verdict": (told.get("verdict") or {}).get("sentence"),
    }


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
    if views := report.get("perspective", {}).values():
        worst = (max(view[key] for view in views) for key in ("rms_px", "max_px"))
        lines.append("perspective cameras: differ from the RPCs by {:.3f} px (RMS), {:.3f} px at most".format(*worst))
    lines += [f"warning: {text}" for text in report["warnings"]]
    commands = [f"then type:  {' && '.join(report['commands'])}"] if len(report["commands"]) > 1 else []
    return "\n".join([*lines, *commands, f"result:  {report['expected']}"])
