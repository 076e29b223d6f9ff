"""Orthoimages of a block as files: which of them are there already, making the others, the report."""

import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyproj

from ...hrsi_engine.foundation.errors import Cancelled, InputError
from ...hrsi_engine.foundation.progress import advance, stage
from ...hrsi_engine.foundation.workers.streams import open_calls
from ...hrsi_engine.foundation.workers.threads import thread_count
from ...hrsi_engine.io.catalogue.lineage import rpc_history
from ...hrsi_engine.io.opening.json_files import read_json
from ...hrsi_engine.io.opening.virtual_files import VIRTUAL
from ...hrsi_engine.io.output_dir import require_no_input, stage_folder
from ...hrsi_engine.io.pages.page import write_page
from ...hrsi_engine.io.pages.report import write_report_json
from ...hrsi_engine.io.rasters.orthoimages import OrthoFigures, read_figures, stamp_of, write_orthoimage
from ..declarations.orthorectify import OrthorectifyOptions
from ..files.dry_run import PAGE_FILE, REPORT_FILE, plan
from ..files.result_folder import tell
from ..interface.declare import Context, Report
from .chunks import chunks_of
from .inputs import BlockPlan
from .jobs import OrthoJob

KEPT, MADE = "kept", "made"


def check_ortho_folder(options: OrthorectifyOptions, jobs: Sequence[OrthoJob], inputs: Sequence[str]) -> None:
    """Raise `InputError` where the output directory holds something that may not be replaced."""
    if options.folder.output_dir.startswith(VIRTUAL):
        raise InputError(
            f"{options.folder.output_dir}: orthoimages are put together tile by tile, which no object store takes: "
            "name a local or mounted `output_dir`, and upload what is finished"
        )
    folder = Path(options.folder.output_dir)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: give `output_dir` a directory")
    require_no_input([job.path for job in jobs], inputs)
    if options.folder.overwrite:
        return
    others = [job.path for job in jobs if os.path.exists(job.path) and not _finish(job)]
    if others:
        raise InputError(
            f"{others[0]} was made from other files or with other options: add `overwrite` or choose another directory"
        )
    try:  # the report of something else?
        is_foreign = read_json(str(folder / "report.json"), "report")["algorithm"] != "orthorectify"
    except (InputError, KeyError, TypeError):
        is_foreign = os.path.exists(folder / "report.json")
    if is_foreign:
        raise InputError(f"{folder} already holds another result: add `overwrite` or choose another directory")


def _finish(job: OrthoJob) -> bool:
    return stamp_of(job.path) == job.key


def plan_orthoimages(
    planned: BlockPlan, jobs: Sequence[OrthoJob], options: OrthorectifyOptions, context: Context
) -> Report:
    """Return the report of a dry run: the orthoimages, and which of them are finished already."""
    kept = [job for job in jobs if _finish(job)]
    counts = {"images": len(jobs), "orthoimages that are finished and kept": len(kept)}
    counts["pixels to be computed"] = sum(job.grid.columns * job.grid.rows for job in jobs if job not in kept)
    names = [REPORT_FILE, *([PAGE_FILE] if options.report else [])]
    names += [os.path.basename(job.path) for job in jobs if job not in kept]
    return plan(context, options.folder.output_dir, names, counts, planned.warnings)


def make_all(jobs: Sequence[OrthoJob], options: OrthorectifyOptions, context: Context) -> dict[str, Report]:
    """Make the orthoimages that are not there; return an entry for each image."""
    Path(options.folder.output_dir).mkdir(parents=True, exist_ok=True)
    threads = thread_count(options.common.threads)
    sizes = np.array([job.grid.columns * job.grid.rows for job in jobs], dtype=float)
    share = np.r_[0.0, np.cumsum(sizes) / sizes.sum()]
    entries: dict[str, Report] = {}
    missing = {job.key for job in jobs if not _finish(job)}
    workers = options.workers
    with open_calls(workers.scheduler if missing else None, threads, workers.certificates) as calls:
        chunks = chunks_of([job for job in jobs if job.key in missing], options, calls)
        for number, job in enumerate(jobs):
            part = stage(context.progress, float(share[number]), float(share[number + 1]))
            if job.key not in missing:
                entries[job.image.id] = _image_entry(job, KEPT, None, 0.0)
                context.log(f"{job.image.id}: {os.path.basename(job.path)} is finished and kept")
                continue
            begin = time.monotonic()
            try:
                figures = write_orthoimage(
                    job.path, job.source, job.grid, chunks, job.warp, job.form, job.made_from, threads, part,
                    _lineage_items(job, options, context.record),
                )  # fmt: skip
            except Cancelled:
                raise Cancelled(
                    f"cancelled; {number} of {len(jobs)} orthoimages are finished: the same command goes on with the "
                    "rest"
                ) from None
            entries[job.image.id] = _image_entry(job, MADE, figures, time.monotonic() - begin)
    return entries


def _lineage_items(job: OrthoJob, options: OrthorectifyOptions, record: Report) -> dict[str, str]:
    """Return what an orthoimage tells of itself: from which image, with which RPC, on which terrain.

    Not when: whoever makes it again from the same files gets the same bytes. The report has the date.
    """
    terrain, height = options.terrain, options.terrain.height
    return {
        "HRSI_VERSION": record["version"],
        "HRSI_ALGORITHM": record["algorithm"],
        "HRSI_SOURCE": os.path.basename(job.image.path),
        "HRSI_RPC": rpc_history(job.image.path),
        "HRSI_RPC_SHA256": str(job.made_from["rpc"]),
        "HRSI_TERRAIN": str(terrain.dem.dem or options.terrain_points or f"height {height:g} m"),
    }


def _image_entry(job: OrthoJob, status: str, figures: OrthoFigures | None, seconds: float) -> Report:
    """Return what the report says of an orthoimage; figures of one that was kept are those of its making."""
    found = figures.summary() if figures is not None else read_figures(job.path)
    return {
        "path": job.image.path, "output": job.path, "status": status, "columns": job.grid.columns,
        "rows": job.grid.rows, "bounds": list(job.grid.bounds), "nodata": job.warp.nodata,
        "source_pixels_per_pixel": job.warp.scale, "seconds": round(seconds, 3), **found,
    }  # fmt: skip


def write_report(
    plan: BlockPlan, entries: Mapping[str, Report], options: OrthorectifyOptions, seconds: float, context: Context
) -> Report:
    """Write ``report.json`` and, where wanted, ``report.html``; return the report."""
    warnings = [
        *plan.warnings,
        *(f"{name}: the orthoimage shows nothing: check the image's pixels and its nodata value"
          for name, entry in entries.items() if not entry["shown_pixels"]),
        *(f"{name}: about {entry['unknown_pixels']} pixels of the image lie where the terrain is not known: they are "
          "nodata; `fill_gaps` bridges small gaps of the DEM, another DEM large ones"
          for name, entry in entries.items() if entry["unknown_pixels"]),
    ]  # fmt: skip
    crs = pyproj.CRS.from_wkt(plan.crs)
    code = crs.to_epsg()
    name = f"EPSG:{code}" if code else str(crs.name)
    report: Report = {
        **context.record, "seconds": {"total": round(seconds, 3)}, "crs": {**context.record["crs"], "map": name},
        "crs_operations": [use.entry() for use in plan.operations],
        "grid": {"crs": name, "wkt": plan.crs, "resolution": plan.resolution},
        "resampling": options.resampling, "error_px": options.error_px,
        "images": {key: {"gsd_m": plan.gsd_m[key], **entry} for key, entry in entries.items()},
        "warnings": warnings,
    }  # fmt: skip
    tell(warnings, context)
    with stage_folder(options.folder.output_dir, context.inputs, options.folder.overwrite) as folder:
        if options.report:
            write_page(str(folder / "report.html"), "orthoimages.html.j2", report)
        write_report_json(str(folder / "report.json"), report)
    advance(context.progress, 1.0, "done")
    return report
