"""`crop`: a window of an image, an overview or a resampled image, with the RPC of its pixels."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..hrsi_engine.block.block import Image
from ..hrsi_engine.camera.rpc import RPC
from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.foundation.progress import advance, stage
from ..hrsi_engine.foundation.thresholds import threshold, thresholds
from ..hrsi_engine.foundation.workers.threads import thread_count
from ..hrsi_engine.io.output_dir import stage_folder
from ..hrsi_engine.io.pages.report import write_report_json
from ..hrsi_engine.io.rasters.cropping import CropWindow, ImageStorage, open_window, read_lineage, save_image
from ..hrsi_engine.io.rpc_files import Lineage, free_the_way, read_back_px, write_rpc_text
from ..hrsi_engine.io.rpc_files.crop import CropPlace, crop_rpc
from ..hrsi_engine.io.rpc_files.ignored_resampling import SIZE_ITEM, format_size
from ..hrsi_engine.io.safety.transactions import Transaction
from ..hrsi_engine.surface.dem import HeightSurface, surface_heights
from ..hrsi_engine.surface.grid_surface import ConstantHeight
from .declarations.crop import CropOptions
from .files.dry_run import REPORT_FILE, plan
from .files.image_files import open_input_images
from .files.image_pixels import window_area
from .files.result_folder import check_folder, tell
from .files.terrain import open_terrain
from .interface.declare import Context, Report
from .ortho_steps.inputs import parse_box

LONLAT = "EPSG:4326"


@thresholds
class GROUND_BOX:
    """How a box on the ground is brought into an image."""

    nodes: int = threshold(41, "nodes", "nodes along each side of a box whose places in the image are computed")


class CropJob(NamedTuple):
    """One image, its window, the window's RPC, and the name of the new file."""

    image: Image
    window: CropWindow
    rpc: RPC
    name: str


def run(options: CropOptions, context: Context) -> Report:
    """Find each image's window and its RPC first, then write all of them together."""
    if options.window and options.extent:
        raise InputError("`window` and `extent` both say what is cut: give one of them")
    if not (options.window or options.extent or options.factor):
        raise InputError("nothing says what to make: give `window`, `extent` or `factor`")
    check_folder(options.folder, context)
    images = open_input_images(options.images, context)
    surface = open_terrain(options.terrain)
    storage = ImageStorage(options.format, options.compression, options.overviews, thread_count(options.common.threads))
    warnings: list[str] = []
    jobs = [_plan_job(image, storage, options, surface, warnings) for image in images]
    folder = options.folder.output_dir
    if context.dry_run:
        names = [REPORT_FILE, *(job.name for job in jobs)]
        return plan(context, folder, names, {"images": len(images)}, warnings)
    report: Report = {**context.record, "images": {}, "warnings": warnings}
    changes = Transaction(folder)
    with changes, stage_folder(folder, context.inputs, options.folder.overwrite, changes) as staged:
        for number, job in enumerate(jobs):
            part = context.stage(number / len(jobs), (number + 1) / len(jobs))
            warnings += _write_crop(job, storage, options.resampling, staged, part)
            warnings += free_the_way(os.path.join(folder, job.name), job.image.path, job.rpc, changes)
            report["images"][job.image.id] = _describe(job, folder, read_back_px(str(staged / job.name), job.rpc))
        write_report_json(str(staged / REPORT_FILE), report)
    tell(warnings, context)
    advance(context.progress, 1.0, "done")
    return report


def _plan_job(
    image: Image, storage: ImageStorage, options: CropOptions, surface: HeightSurface | None, warnings: list[str]
) -> CropJob:
    window = _choose_window(image, options, surface, warnings)
    rpc = crop_rpc(image.rpc, CropPlace.from_window(window.bounds, window.size), window.size)
    return CropJob(image, window, rpc, f"{image.id}_crop{storage.ending if image.raster else '_RPC.TXT'}")


def _choose_window(
    image: Image, options: CropOptions, surface: HeightSurface | None, warnings: list[str]
) -> CropWindow:
    """Return the window that the options name, and the size of its result; raise `InputError` where it leaves it."""
    size = image.known_size
    area = window_area(options.window, "window")
    low, high = ((0, 0), size) if area is None else ((area.left, area.top), (area.right, area.bottom))
    if min(low) < 0 or high[0] > size[0] or high[1] > size[1] or high[0] <= low[0] or high[1] <= low[1]:
        raise InputError(
            f"`window` {options.window} does not lie in {image.id}, which has {size[0]} x {size[1]} px from 0,0 on"
        )
    if options.extent:
        low, high = _find_ground_box(image, options.extent, surface, warnings)
    extent = high[0] - low[0], high[1] - low[1]
    factor = options.factor or 1.0
    return CropWindow(*low, *extent, (max(1, round(factor * extent[0])), max(1, round(factor * extent[1]))))


def _find_ground_box(
    image: Image, extent: str, surface: HeightSurface | None, warnings: list[str]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the first pixel of the window that shows a box on the ground, and the one after its last."""
    west, south, east, north = parse_box(extent, LONLAT, "", "degrees")
    x, y = np.meshgrid(np.linspace(west, east, GROUND_BOX.nodes), np.linspace(south, north, GROUND_BOX.nodes))
    lonlat = np.column_stack([x.ravel(), y.ravel()])
    if surface is None:
        warnings.append(
            f"{image.id}: the height of the ground is not known; {image.middle_height_m:.0f} m is taken for `extent`: "
            "give `dem` or `height`"
        )
    heights = surface_heights(surface or ConstantHeight(image.middle_height_m), lonlat)
    known = np.isfinite(heights)
    if not known.any():
        raise InputError(f"`extent` {extent}: no height of the ground is known there: give another `dem`, or `height`")
    xy = image.rpc.project(np.column_stack([lonlat, heights])[known])
    first, end = np.floor(xy.min(axis=0) + 0.5).astype(int), np.ceil(xy.max(axis=0) + 0.5).astype(int)
    low, high = np.maximum(first, 0), np.minimum(end, image.known_size)
    if (low >= high).any():
        raise InputError(f"`extent` {extent} lies outside {image.id}: check box and CRS, or leave the image out")
    if (low != first).any() or (high != end).any():
        warnings.append(f"{image.id}: `extent` reaches beyond the image, which shows a part of it")
    return (int(low[0]), int(low[1])), (int(high[0]), int(high[1]))


def _write_crop(job: CropJob, storage: ImageStorage, resampling: str, folder: Path, context: Context) -> Sequence[str]:
    """Write an image's window, or the RPC of one that has no pixels; return notices."""
    target, path = str(folder / job.name), job.image.path
    made = {
        "HRSI_CROP_SOURCE": os.path.basename(path),
        "HRSI_CROP_WINDOW": ",".join(map(str, job.window.bounds)),
        SIZE_ITEM: format_size(job.window.size),
    }
    if job.image.raster is None:
        write_rpc_text(target, job.rpc, Lineage(made))
        return ()
    told = read_lineage(job.image)
    place = CropPlace.from_window(job.window.bounds, job.window.size)
    original = None if told.original is None else crop_rpc(told.original, place, job.window.size)
    lineage = Lineage({**told.items, **made}, original)
    return save_image(
        open_window(path, job.window, resampling), target, job.rpc, storage, lineage, stage(context.progress, 0.0, 1.0)
    )


def _describe(job: CropJob, folder: str, difference_px: float) -> Report:
    window = job.window
    return {
        "path": job.image.path, "output": os.path.join(folder, job.name), "window": list(window.bounds),
        "samples": window.size[0], "lines": window.size[1],
        "step_sample_px": window.samples / window.size[0], "step_line_px": window.lines / window.size[1],
        "max_difference_px": difference_px,
    }  # fmt: skip


def summarise(report: Report) -> str:
    """Return one line for each image, and the warnings."""
    lines = [
        f"{entry['output']}: {entry['samples']} x {entry['lines']} px; from sample {entry['window'][0]}, line "
        f"{entry['window'][1]} {entry['window'][2]} x {entry['window'][3]} px of {name}"
        for name, entry in report["images"].items()
    ]
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])
