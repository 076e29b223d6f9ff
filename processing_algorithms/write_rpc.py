"""`write-rpc`: an RPC into a GeoTIFF, a sidecar or a VRT, and the original back."""

import os
from collections.abc import Callable
from typing import NamedTuple

from ..hrsi_engine.camera.rpc import RPC
from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.foundation.progress import Progress, advance, stage
from ..hrsi_engine.io import rpc_files
from ..hrsi_engine.io.rasters.images import image_id
from ..hrsi_engine.io.rpc_files import (
    FoundRpc,
    read_back_px,
    read_rpc,
    read_rpc_or_none,
    restore,
    rpc_for_image,
    rpc_in_folder,
    rpc_reader_of,
)
from .declarations.write_rpc import OUTPUT_ENDINGS, WriteRpcOptions
from .files.dry_run import plan
from .interface.declare import Context, Report

_NEEDS_FOLDER = ("copy", "vrt")
#: Ways of writing an RPC beside pixels, and the kinds of files that hold it alone.
WRITERS: dict[str, Callable[[str, str, RPC, Progress], tuple[str, ...]]] = {
    "copy": rpc_files.write_geotiff_copy,
    "in-place": lambda path, output, rpc, progress: rpc_files.write_in_place(path, rpc, progress),
    "vrt": lambda path, output, rpc, progress: rpc_files.write_vrt(path, output, rpc),
}
SIDECAR_KINDS = {"sidecar": "rpc-txt", "rpb": "rpb", "xml": "isd", "geom": "geom", "json": "rpcm-json"}


def run(options: WriteRpcOptions, context: Context) -> Report:
    """Find every image's RPC and its output first, then write; or restore."""
    report: Report = {**context.record, "images": {}, "warnings": []}
    jobs = [] if options.restore else _plan_jobs(options)
    if context.dry_run:
        return plan(context, None, [job.output for job in jobs] or options.images, {"images": len(options.images)})
    if options.output_dir:
        os.makedirs(options.output_dir, exist_ok=True)
    entry: Report
    steps = len(jobs) or len(options.images)
    for index in range(steps):
        part = stage(context.progress, index / steps, (index + 1) / steps)
        advance(part, 0.0)
        if options.restore:
            path = options.images[index]
            notices, found = restore(path, part), read_rpc_or_none(path)
            entry = {"path": path, "output": path, "source": found.source if found else None, "max_difference_px": None}
        else:
            path, output, how, job_rpc = jobs[index]
            rpc = job_rpc.rpc
            if how in SIDECAR_KINDS:
                notices = rpc_files.write_sidecar(output, rpc, SIDECAR_KINDS[how])
            else:
                notices = WRITERS[how](path, output, rpc, part)
            entry = {
                "path": path, "output": output, "source": job_rpc.source, "ignored": list(job_rpc.ignored),
                "max_difference_px": read_back_px(output, rpc),
            }  # fmt: skip
        report["images"][image_id(path)] = entry
        report["warnings"] += notices
    for notice in report["warnings"]:
        context.log(notice)
    advance(context.progress, 1.0, "done")
    return report


class WriteJob(NamedTuple):
    """One image: where it lies, where its RPC goes and how, and the RPC."""

    path: str
    output: str
    how: str
    found: FoundRpc


def _plan_jobs(options: WriteRpcOptions) -> list[WriteJob]:
    """Return what is to be written; raise `InputError` before anything is."""
    if options.write in _NEEDS_FOLDER and not options.output_dir:
        raise InputError(f"`write` {options.write} needs `output_dir`: name a directory for the results")
    jobs = []
    for path in options.images:
        # An RPC file alone has no pixels to copy and becomes a sidecar
        how = "sidecar" if options.write in _NEEDS_FOLDER and rpc_reader_of(path) is not None else options.write
        suffix, folder = OUTPUT_ENDINGS[how], options.output_dir or os.path.dirname(path)
        output = path if suffix is None else os.path.join(folder, image_id(path) + suffix)
        jobs.append(WriteJob(path, output, how, _choose_rpc(path, options)))
    for job in jobs:
        if job.how != "in-place" and os.path.exists(job.output) and not options.overwrite:
            raise InputError(f"{job.output} exists already: add `overwrite`, or choose another `output_dir`")
    made_from: dict[str, str] = {}
    for job in jobs:
        first = made_from.setdefault(os.path.realpath(job.output), job.path)
        if first is not job.path:
            raise InputError(
                f"{first} and {job.path} have the same id, so that one result would replace the other: rename one"
            )
    return jobs


def _choose_rpc(path: str, options: WriteRpcOptions) -> FoundRpc:
    """Return the RPC to be written: that of `rpc`, else the image's own."""
    given = options.rpc
    if not given:
        return read_rpc(path)
    if os.path.isdir(given):
        return rpc_for_image(rpc_in_folder(given, path), path)
    if len(options.images) > 1:
        raise InputError(
            f"`rpc` {given} is the RPC of one image: give one image, or a folder of files named like images"
        )
    return rpc_for_image(given, path)


def summarise(report: Report) -> str:
    """Return one line for each image, and the notices."""
    lines = [f"{entry['output']}: RPC from {entry['source']}" for entry in report["images"].values()]
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])
