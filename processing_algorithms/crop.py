"""`crop`: a window of an image, an overview or a resampled image, with the RPC of its pixels."""

import os
from typing import NamedTuple

import numpy as np

from ..hrsi_engine.block.block import Image
from ..hrsi_engine.camera.rpc import RPC
from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.foundation.progress import Progress, stage
from ..hrsi_engine.foundation.thresholds import GRIDS
from ..hrsi_engine.io.rasters.cropping import CropWindow, open_window, read_lineage, save_image
from ..hrsi_engine.io.rasters.orthoimages import OrthoFormat
from ..hrsi_engine.io.rpc_files import Lineage, read_back_px, set_aside_conflicting_rpcs, write_rpc_text
from ..hrsi_engine.io.rpc_files.crop import crop_rpc
from ..hrsi_engine.io.rpc_files.placement import SIZE_ITEM, SIZE_TEXT
from ..hrsi_engine.io.safety.transactions import Transaction
from ..hrsi_engine.surface.dem import HeightSurface, surface_heights
from ..hrsi_engine.surface.grid_surface import ConstantHeight
from .declarations.rpcs import FORMAT_ENDINGS, CropOptions
from .files.opening import open_images, open_terrain, window_area
from .files.orthoimage_plan import parse_box
from .files.result_folder import REPORT_FILE, check_folder, plan, stage_results
from .interface.declare import Context, Report

LONLAT = "EPSG:4326"


class CropJob(NamedTuple):
    """One image, its window, the window's RPC, and the name of the new file."""

    image: Image
    window: CropWindow
    rpc: RPC
    name: str


def run(options: CropOptions, context: Context) -> Report:
    """Determine the window and RPC of each image first, then write all of them together."""
    if options.window and options.extent:
        raise InputError("`window` and `extent` both define the area: give one of them")
    if not (options.window or options.extent or options.factor):
        raise InputError("the result is not defined: give `window`, `extent` or `factor`")
    check_folder(options.folder, context)
    images, surface = open_images(options.images, context), open_terrain(options.terrain)
    warnings: list[str] = []
    jobs: list[CropJob] = []
    for image in images:
        size, area = image.known_size, window_area(options.window, "window")
        left, top, right, bottom = (0, 0, *size) if area is None else area.bounds
        if not (0 <= left < right <= size[0] and 0 <= top < bottom <= size[1]):
            raise InputError(
                f"`window` {options.window} does not lie in {image.id}, which has {size[0]} x {size[1]} px from 0,0 on"
            )
        if options.extent:
            left, top, right, bottom = _find_ground_box(image, options.extent, surface, warnings)
        factor, extent = options.factor or 1.0, (right - left, bottom - top)
        shape = max(1, round(factor * extent[0])), max(1, round(factor * extent[1]))
        window = CropWindow((left, top, *extent), shape)
        ending = FORMAT_ENDINGS[options.format] if image.has_file else "_RPC.TXT"
        jobs.append(CropJob(image, window, crop_rpc(image.rpc, window.place, window.size), f"{image.id}_crop{ending}"))
    folder = options.folder.output_dir
    if context.dry_run:
        return plan(context, folder, [REPORT_FILE, *(job.name for job in jobs)], {"images": len(images)}, warnings)
    report: Report = {**context.record, "images": {}, "warnings": warnings}
    changes = Transaction(folder)
    with changes, stage_results(options.folder, report, context, transaction=changes) as staged:
        for number, job in enumerate(jobs):
            part = stage(context.progress, number / len(jobs), (number + 1) / len(jobs))
            target, output = str(staged / job.name), os.path.join(folder, job.name)
            warnings += _write_crop(job, options, target, part)
            warnings += set_aside_conflicting_rpcs(output, job.image.path, job.rpc, changes)
            (samples, lines), bounds = job.window.size, job.window.bounds
            report["images"][job.image.id] = {
                "path": job.image.path,
                "output": output,
                "window": list(bounds),
                "samples": samples,
                "lines": lines,
                "step_sample_px": bounds[2] / samples,
                "step_line_px": bounds[3] / lines,
                "max_difference_px": read_back_px(target, job.rpc),
            }
    return report


def _find_ground_box(image: Image, extent: str, surface: HeightSurface | None, warnings: list[str]) -> list[int]:
    """Return first sample, first line, and the sample and line after the last of the window that shows a ground box."""
    west, south, east, north = parse_box(extent, LONLAT, "", "degrees")
    x, y = np.meshgrid(np.linspace(west, east, GRIDS.fine), np.linspace(south, north, GRIDS.fine))
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
    box = np.concatenate([np.floor(xy.min(axis=0) + 0.5), np.ceil(xy.max(axis=0) + 0.5)])
    inside = np.clip(box, 0, image.known_size * 2)
    if (inside[:2] >= inside[2:]).any():
        raise InputError(f"`extent` {extent} lies outside {image.id}: check box and CRS, or leave the image out")
    if (inside != box).any():
        warnings.append(f"{image.id}: `extent` reaches beyond the image, which shows a part of it")
    return [int(value) for value in inside]


def _write_crop(job: CropJob, options: CropOptions, target: str, progress: Progress) -> tuple[str, ...]:
    """Write the window of an image, or only its RPC if the image has no pixels; return notices."""
    window = job.window
    items = {
        "HRSI_CROP_SOURCE": os.path.basename(job.image.path),
        "HRSI_CROP_WINDOW": ",".join(map(str, window.bounds)),
        SIZE_ITEM: SIZE_TEXT.format(*window.size),
    }
    if not job.image.has_file:
        write_rpc_text(target, job.rpc, Lineage(items))
        return ()
    told = read_lineage(job.image)
    original = None if told.original is None else crop_rpc(told.original, window.place, window.size)
    lineage = Lineage({**told.items, **items}, original)
    pixels = open_window(job.image.path, window, options.resampling)
    form = OrthoFormat(options.format, options.compression)
    return save_image(pixels, target, job.rpc, form=form, lineage=lineage, progress=progress)


def summarise(report: Report) -> str:
    """Return one line for each image, and the warnings."""
    lines = [
        f"{entry['output']}: {entry['samples']} x {entry['lines']} px; from sample {entry['window'][0]}, line "
        f"{entry['window'][1]} {entry['window'][2]} x {entry['window'][3]} px of {name}"
        for name, entry in report["images"].items()
    ]
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])
