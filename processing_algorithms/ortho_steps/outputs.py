"""Orthoimages of a block as files: which of them are there already, making the others, the report."""

from __future__ import annotations

import hashlib
import math
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.foundation.errors import Cancelled, InputError
from ...hrsi_engine.foundation.json_values import json_text
from ...hrsi_engine.foundation.progress import advance, stage
from ...hrsi_engine.foundation.threads import thread_count
from ...hrsi_engine.io.json_files import read_json
from ...hrsi_engine.io.ortho_warp import OrthoSource, Warp
from ...hrsi_engine.io.orthoimages import (  # fmt: skip
    OrthoFigures,
    OrthoFormat,
    file_state,
    fingerprint,
    stamp_of,
    stored_figures,
    write_orthoimage,
)
from ...hrsi_engine.io.output_dir import stage_folder
from ...hrsi_engine.io.pages import write_page
from ...hrsi_engine.io.report import write_report_json
from ...hrsi_engine.io.versions import versions
from ...hrsi_engine.ortho.grid import MapGrid
from ...hrsi_engine.ortho.mapping import OrthoMapping
from ..declarations.orthorectify import OrthorectifyOptions
from ..interface.declare import Context, Report
from .inputs import BlockPlan

ENDING = "_ortho.tif"
MASK = "mask"
KEPT, MADE = "kept", "made"


@dataclass(frozen=True, eq=False)
class OrthoJob:
    """One orthoimage: how its pixels map, how it is warped, and all that it is made from, for the fingerprint."""

    image: Image
    path: str
    source: OrthoSource
    mapping: OrthoMapping
    warp: Warp
    form: OrthoFormat
    made_from: Mapping[str, Any]

    @property
    def grid(self) -> MapGrid:
        return self.mapping.grid


def jobs_of(plan: BlockPlan, options: OrthorectifyOptions) -> list[OrthoJob]:
    """Return the orthoimages of a plan."""
    form = OrthoFormat(options.format, options.compression)
    jobs = []
    for image in plan.images:
        source = OrthoSource(image.path)
        grid = plan.grids[image.id]
        mapping = OrthoMapping(image.rpc, source.size, plan.terrain.surface, grid, options.error_px)
        scale = mapping.source_pixels_per_pixel()
        warp = Warp(options.resampling, scale, _nodata(options.nodata, source))
        path = os.path.join(options.folder.output_dir, image.id + ENDING)
        made_from = _made_from(image, plan, warp, form, options.error_px)
        jobs.append(OrthoJob(image, path, source, mapping, warp, form, made_from))
    return jobs


def _made_from(image: Image, plan: BlockPlan, warp: Warp, form: OrthoFormat, error_px: float) -> dict[str, Any]:
    """Return everything on which the pixels and the file of an orthoimage depend."""
    grid, used = plan.grids[image.id], versions()
    coefficients = {name: np.asarray(value).tolist() for name, value in vars(image.rpc).items() if name[0] != "_"}
    rpc = hashlib.sha256(json_text(coefficients, sort_keys=True).encode()).hexdigest()
    return {
        "image": file_state(image.path), "rpc": rpc, "terrain": plan.terrain.identity, "crs": grid.crs,
        "grid": [grid.resolution, grid.left, grid.top, grid.columns, grid.rows], "resampling": warp.resampling,
        "nodata": str(warp.nodata), "error_px": error_px, "format": form.name, "compression": form.compression,
        "versions": {name: used[name] for name in ("hrsi", "gdal", "proj")},
    }  # fmt: skip


def _nodata(given: str | None, source: OrthoSource) -> float | None:
    """Return the value of pixels that the image does not show; None for a mask band."""
    own = [value for value in source.nodata if value is not None]
    if given == MASK or (given is None and not own and source.masked):
        return None
    if given is None:
        return float(own[0]) if own else (0.0 if source.is_integer else math.nan)
    try:
        value = float(given)
    except ValueError:
        raise InputError(f"`nodata` {given!r} is neither a number nor mask") from None
    if not source.holds(value):
        raise InputError(f"`nodata` {given}: {source.path} has {source.type_name} pixels, which cannot hold it")
    return value


def check_ortho_folder(options: OrthorectifyOptions, jobs: Sequence[OrthoJob]) -> None:
    """Raise `InputError` where the output directory holds something that may not be replaced."""
    folder = Path(options.folder.output_dir)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: give `output_dir` a directory")
    inputs = {os.path.realpath(job.image.path) for job in jobs}
    for job in jobs:
        if os.path.realpath(job.path) in inputs:
            raise InputError(f"{job.path} is an input and would be replaced: choose another `output_dir`")
    if options.folder.overwrite:
        return
    others = [job.path for job in jobs if os.path.exists(job.path) and not _finish(job)]
    if others:
        raise InputError(
            f"{others[0]} was made from other files or with other options: add `overwrite` or choose another directory"
        )
    if _foreign_report(folder):
        raise InputError(f"{folder} already holds another result: add `overwrite` or choose another directory")


def _foreign_report(folder: Path) -> bool:
    """Tell whether the folder holds the report of something else."""
    try:
        return bool(read_json(str(folder / "report.json"), "report")["algorithm"] != "orthorectify")
    except (InputError, KeyError, TypeError):
        return os.path.exists(folder / "report.json")


def _finish(job: OrthoJob) -> bool:
    return stamp_of(job.path) == fingerprint(job.made_from)


def make_all(jobs: Sequence[OrthoJob], options: OrthorectifyOptions, context: Context) -> dict[str, Report]:
    """Make the orthoimages that are not there; return an entry for each image."""
    Path(options.folder.output_dir).mkdir(parents=True, exist_ok=True)
    threads = thread_count(options.common.threads)
    sizes = np.array([job.grid.columns * job.grid.rows for job in jobs], dtype=float)
    share = np.r_[0.0, np.cumsum(sizes) / sizes.sum()]
    entries: dict[str, Report] = {}
    for number, job in enumerate(jobs):
        part = stage(context.progress, float(share[number]), float(share[number + 1]))
        if _finish(job):
            entries[job.image.id] = _entry(job, KEPT, None, 0.0)
            context.log(f"{job.image.id}: {os.path.basename(job.path)} is finished and kept")
            continue
        begin = time.monotonic()
        try:
            figures = write_orthoimage(
                job.path, job.source, job.grid, job.mapping.chunk, job.warp, job.form, job.made_from, threads, part
            )
        except Cancelled:
            raise Cancelled(
                f"cancelled; {number} of {len(jobs)} orthoimages are finished: the same command goes on with the rest"
            ) from None
        entries[job.image.id] = _entry(job, MADE, figures, time.monotonic() - begin)
    return entries


def _entry(job: OrthoJob, status: str, figures: OrthoFigures | None, seconds: float) -> Report:
    """Return what the report says of an orthoimage; figures of one that was kept are those of its making."""
    found = figures.summary() if figures is not None else stored_figures(job.path)
    return {
        "path": job.image.path, "output": job.path, "status": status, "columns": job.grid.columns,
        "rows": job.grid.rows, "bounds": list(job.grid.bounds), "nodata": job.warp.nodata,
        "source_pixels_per_pixel": job.warp.scale, "seconds": round(seconds, 3), **found,
    }  # fmt: skip


def write_report(
    plan: BlockPlan, entries: Mapping[str, Report], options: OrthorectifyOptions, seconds: float, context: Context
) -> Report:
    """Write ``report.json`` and, where wanted, ``report.html``; return the report."""
    warnings = [*plan.warnings, *_unknown_warnings(entries)]
    crs = pyproj.CRS.from_wkt(plan.crs)
    code = crs.to_epsg()
    name = f"EPSG:{code}" if code else str(crs.name)
    report: Report = {
        **context.record, "seconds": {"total": round(seconds, 3)}, "crs": {**context.record["crs"], "map": name},
        "grid": {"crs": name, "wkt": plan.crs, "resolution": plan.resolution},
        "resampling": options.resampling, "error_px": options.error_px,
        "images": {key: {"gsd_m": plan.gsd_m[key], **entry} for key, entry in entries.items()},
        "warnings": warnings,
    }  # fmt: skip
    for text in warnings:
        context.log(f"warning: {text}")
    with stage_folder(options.folder.output_dir, context.inputs, options.folder.overwrite) as folder:
        if options.report:
            write_page(str(folder / "report.html"), "orthoimages.html.j2", report)
        write_report_json(str(folder / "report.json"), report)
    advance(context.progress, 1.0, "done")
    return report


def _unknown_warnings(entries: Mapping[str, Report]) -> list[str]:
    empty = [
        f"{name}: the orthoimage shows nothing: check the image's pixels and its nodata value"
        for name, entry in entries.items()
        if not entry["shown_pixels"]
    ]
    return empty + [
        f"{name}: about {entry['unknown_pixels']} pixels of the image lie where the terrain is not known: they are "
        "nodata; `fill_gaps` bridges small gaps of the DEM, another DEM large ones"
        for name, entry in entries.items()
        if entry["unknown_pixels"]
    ]
