"""`orthorectify`: orthoimages of a complete block on one map grid, by GDAL's warper."""

import os
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..hrsi_engine.block.block import Image
from ..hrsi_engine.foundation.errors import Cancelled, InputError
from ..hrsi_engine.foundation.progress import stage
from ..hrsi_engine.foundation.thresholds import LISTS
from ..hrsi_engine.foundation.workers.scheduling import open_calls
from ..hrsi_engine.io.catalogue.deliveries import resolve_images
from ..hrsi_engine.io.catalogue.lineage import read_refinement
from ..hrsi_engine.io.opening.datasets import VIRTUAL
from ..hrsi_engine.io.opening.files import read_json
from ..hrsi_engine.io.output_dir import require_no_input
from ..hrsi_engine.io.pages.report import name_crs_unit, read_picture, write_page
from ..hrsi_engine.io.rasters.images import GdalRaster
from ..hrsi_engine.io.rasters.orthoimages import OrthoFigures, read_figures, stamp_of, write_orthoimage
from ..hrsi_engine.results.drawings import LARGEST_PICTURE_PX
from .declarations.orthoimages import MOSAIC_FILE, SEAMLINES_FILE, OrthorectifyOptions
from .files.exposure_pairs import add_colour, pair_exposures
from .files.opening import open_images
from .files.orthoimage_plan import OrthoJob, chunks_of, jobs_of, label_crs, open_ortho_terrain, plan_block
from .files.orthomosaic import MosaicPlan, make_mosaic, plan_mosaic
from .files.result_folder import PAGE_FILE, REPORT_FILE, plan, stage_results
from .interface.declare import Context, Report

ORTHO_SHARE = 0.7  # of the running time, with a mosaic


def run(options: OrthorectifyOptions, context: Context) -> Report:
    """Plan the grids, make the orthoimages that do not exist yet, and write the report."""
    start = time.monotonic()
    images, colour = open_exposures(options, context)
    planned = plan_block(images, open_ortho_terrain(options), options)
    jobs, folder = jobs_of(planned, options), options.folder.output_dir
    if colour:
        jobs = [add_colour(job, colour[job.image.id], planned, options) for job in jobs]
    mosaic = plan_mosaic(jobs, planned, options) if options.mosaic else None
    check_ortho_folder(options, [*jobs, *([mosaic] if mosaic else [])], context.inputs)
    if context.dry_run:
        missing = [job for job in jobs if stamp_of(job.path) != job.key]
        counts = {"images": len(jobs), "orthoimages that are finished and kept": len(jobs) - len(missing)}
        counts["pixels to be computed"] = sum(job.grid.columns * job.grid.rows for job in missing)
        names = [REPORT_FILE, *([PAGE_FILE] if options.report else [])]
        names += [os.path.basename(job.path) for job in missing]
        if mosaic is not None and not mosaic.is_finished:
            names += [MOSAIC_FILE, SEAMLINES_FILE]
        return plan(context, folder, names, counts, planned.warnings)
    end = ORTHO_SHARE if mosaic else 1.0
    entries = make_all(jobs, options, context.stage(0.0, end))
    blended = make_mosaic(mosaic, options, stage(context.progress, end, 1.0), context.record) if mosaic else None
    warnings = [
        *planned.warnings,
        *(
            f"{name}: the orthoimage is empty: check the pixels and the nodata value of the image"
            for name, entry in entries.items()
            if not entry["shown_pixels"]
        ),
        *(
            f"{name}: about {entry['unknown_pixels']} pixels have no DEM height and become nodata: `fill_gaps` closes "
            "small gaps of the DEM; for large ones use another DEM"
            for name, entry in entries.items()
            if entry["unknown_pixels"]
        ),
    ]
    if blended and blended["unfilled_pixels"]:
        warnings.append(
            f"{blended['unfilled_pixels']} pixels of the mosaic are nodata: their ground is hidden in all images, or "
            "has no DEM height: add images from other directions, or use `fill_gaps`"
        )
    name = label_crs(planned.crs)
    report: Report = {
        **context.record,
        "seconds": {"total": round(time.monotonic() - start, 3)},
        "crs": {**context.record["crs"], "map": name},
        "crs_operations": [use.entry() for use in planned.operations],
        "grid": {"crs": name, "wkt": planned.crs, "resolution": planned.resolution},
        "resampling": options.resampling,
        "error_px": options.error_px,
        "images": {key: {"gsd_m": planned.gsd_m[key], **entry} for key, entry in entries.items()},
        "warnings": warnings,
        **({"mosaic": blended} if blended else {}),
    }
    with stage_results(options.folder, report, context) as staged:
        if options.report:
            read = [(key, GdalRaster(entry["output"])) for key, entry in entries.items() if entry["shown_pixels"]]
            read = read[: LISTS.images]
            pictures = [read_picture(raster, key, k, LARGEST_PICTURE_PX) for k, (key, raster) in enumerate(read)]
            write_page(str(staged / PAGE_FILE), "orthoimages.html.j2", report, pictures=[p for p in pictures if p])
    return report


def open_exposures(options: OrthorectifyOptions, context: Context) -> tuple[list[Image], dict[str, Image]]:
    """Return the images, and the multispectral ones that they are combined with, by the ids of the former."""
    if options.pansharpen is None:
        return open_images(options.images, context), {}
    if options.workers.scheduler:
        raise InputError("`pansharpen` runs on this machine: leave `scheduler` out")
    found = resolve_images([part.strip() for part in options.pansharpen.split(";") if part.strip()], context.log)
    files = [file for file in found if file not in options.images]
    return pair_exposures(open_images([*options.images, *files], context), files)


def summarise(report: Report) -> str:
    """Return one line for each orthoimage, and the warnings."""
    grid = report["grid"]
    lines = [f"{grid['crs']}, pixels of {grid['resolution']:g} {name_crs_unit(grid['crs'])}, {report['resampling']}"]
    for name, entry in report["images"].items():
        error = entry["position_error_max_px"]
        lines.append(
            f"{name}: {entry['columns']} x {entry['rows']} px, {entry['status']}"
            + ("" if error is None else f", interpolated positions within {error:.3f} px at {entry['checked']} points")
            + (f", {entry['hidden_share']:.1%} of the ground is hidden" if "hidden_share" in entry else "")
        )
    if entry := report.get("mosaic"):
        lines.append(f"{MOSAIC_FILE}: {entry['columns']} x {entry['rows']} px, {entry['status']}")
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])


def check_ortho_folder(
    options: OrthorectifyOptions, jobs: Sequence[OrthoJob | MosaicPlan], inputs: Sequence[str]
) -> None:
    """Raise `InputError` if the output directory contains files that must not be replaced."""
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
    if others := [job.path for job in jobs if os.path.exists(job.path) and stamp_of(job.path) != job.key]:
        raise InputError(
            f"{others[0]} was made from other files or with other options: add `overwrite` or choose another directory"
        )
    try:  # a report of another algorithm
        is_foreign = read_json(str(folder / "report.json"), "report")["algorithm"] != "orthorectify"
    except (InputError, KeyError, TypeError):
        is_foreign = os.path.exists(folder / "report.json")
    if is_foreign:
        raise InputError(f"{folder} already contains another result: add `overwrite` or choose another directory")


def make_all(jobs: Sequence[OrthoJob], options: OrthorectifyOptions, context: Context) -> dict[str, Report]:
    """Make the orthoimages that do not exist yet; return the report's entry of each image."""
    Path(options.folder.output_dir).mkdir(parents=True, exist_ok=True)
    sizes = np.array([job.grid.columns * job.grid.rows for job in jobs], dtype=float)
    share = np.r_[0.0, np.cumsum(sizes) / sizes.sum()]
    entries: dict[str, Report] = {}
    terrain, workers = options.terrain, options.workers
    missing = {job.key for job in jobs if stamp_of(job.path) != job.key}
    with open_calls(workers.scheduler if missing else None, certificates=workers.certificates) as calls:
        chunks = chunks_of([job for job in jobs if job.key in missing], options, calls)
        for number, job in enumerate(jobs):
            part = stage(context.progress, float(share[number]), float(share[number + 1]))
            if job.key not in missing:
                entries[job.image.id] = _image_entry(job, "kept", None, 0.0)
                continue
            begin = time.monotonic()
            history = "as delivered"
            if (made := read_refinement(job.image.path)) is not None:
                run = f"HRSI {made.get('HRSI_VERSION')} on {made.get('HRSI_DATE')}"
                history = f"refined by {run}, model {made['HRSI_MODEL']}"
            # Metadata without the time: from the same files an orthoimage has the same bytes
            lineage = {
                "HRSI_VERSION": context.record["version"],
                "HRSI_ALGORITHM": context.record["algorithm"],
                "HRSI_SOURCE": os.path.basename(job.image.path),
                "HRSI_RPC": history,
                "HRSI_RPC_SHA256": str(job.made_from["rpc"]),
                "HRSI_TERRAIN": str(terrain.dem.dem or options.terrain_points or f"height {terrain.height:g} m"),
            }
            try:
                figures = write_orthoimage(
                    job.path,
                    job.source,
                    job.grid,
                    chunks=chunks,
                    warp=job.warp,
                    form=job.form,
                    made_from=job.made_from,
                    progress=part,
                    lineage=lineage,
                )
            except Cancelled:
                raise Cancelled(
                    f"cancelled; {number} of {len(jobs)} orthoimages are finished: run the same command again to "
                    "continue"
                ) from None
            entries[job.image.id] = _image_entry(job, "made", figures, time.monotonic() - begin)
    return entries


def _image_entry(job: OrthoJob, status: str, figures: OrthoFigures | None, seconds: float) -> Report:
    """Return the report's entry of an orthoimage; for one that was kept, with the figures of its computation."""
    found = figures.summary() if figures is not None else read_figures(job.path)
    if job.mapping.masks_occlusions:
        found["hidden_share"] = found["hidden_pixels"] / max(1, found["hidden_pixels"] + found["shown_pixels"])
    return {
        "path": job.image.path,
        "output": job.path,
        "status": status,
        "columns": job.grid.columns,
        "rows": job.grid.rows,
        "bounds": list(job.grid.bounds),
        "nodata": job.warp.nodata,
        "source_pixels_per_pixel": job.warp.scale,
        "jitter": job.mapping.jitter is not None,
        "seconds": round(seconds, 3),
        **found,
    }
