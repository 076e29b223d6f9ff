"""`write-rpc`: an RPC into a GeoTIFF, a sidecar or a VRT; or restoring the original."""

import itertools
import os
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..hrsi_engine.camera.rpc import RPC
from ..hrsi_engine.foundation.errors import InputError, list_ids
from ..hrsi_engine.foundation.progress import Progress, advance, stage
from ..hrsi_engine.io import rpc_files
from ..hrsi_engine.io.jitter_files import JitterFile, find_jitter_file
from ..hrsi_engine.io.opening.files import open_raster
from ..hrsi_engine.io.output_dir import require_no_input
from ..hrsi_engine.io.rasters.images import image_id
from ..hrsi_engine.io.safety.transactions import Transaction
from .declarations.rpcs import OUTPUT_ENDINGS, WriteRpcOptions
from .files.result_folder import plan
from .interface.declare import Context, Report

_NEEDS_FOLDER = ("copy", "vrt")
#: Functions that write an RPC with pixels, by the choice of `write`; and the kinds of files with an RPC alone.
WRITERS: dict[str, Callable[[str, str, RPC, Transaction, Progress], tuple[str, ...]]] = {
    "copy": rpc_files.prepare_geotiff_copy,
    "in-place": lambda path, _, rpc, changes, progress: rpc_files.prepare_in_place(path, rpc, changes, progress),
    "vrt": lambda path, output, rpc, changes, _: rpc_files.write_vrt(path, output, rpc, replace=changes.replacing),
}
SIDECAR_KINDS = {"sidecar": "rpc-txt", "rpb": "rpb", "xml": "isd", "geom": "geom", "json": "rpcm-json"}


def run(options: WriteRpcOptions, context: Context) -> Report:
    """Determine the RPC and the output of every image first, then write or restore all of them, or none."""
    jobs = [] if options.restore else _plan_jobs(options, context.inputs)
    if context.dry_run:
        return plan(context, None, [job.output for job in jobs] or options.images, {"images": len(options.images)})
    report: Report = {**context.record, "images": {}, "warnings": []}
    with Transaction(options.output_dir or os.path.dirname(options.images[0])) as changes:
        count = len(jobs) or len(options.images)
        parts = [stage(context.progress, index / count, (index + 1) / count) for index in range(count)]
        # If no image keeps an original, an earlier run may have restored all, and nothing is to be done
        notices: dict[str, tuple[str, ...]] = {}
        for path, part in zip(options.images, parts, strict=True) if options.restore else ():
            advance(part, 0.0)
            notices[path] = rpc_files.prepare_restoring(path, changes, part)
        restored = {image_id(path): path for path, told in notices.items() if told}
        for file in {file for path in restored.values() if (file := find_jitter_file(path)) is not None}:
            if JitterFile(file).ids <= set(restored):  # else it is used by other images; each curve identifies its RPC
                changes.remove(file)
        without = [path for path, told in notices.items() if not told]
        if without and len(without) < len(notices):
            raise InputError(f"{list_ids(without)}: {rpc_files.KEEPS_NONE}: leave it out; nothing was changed")
        report["warnings"] += [
            *itertools.chain(*notices.values()),
            *(f"{path}: {rpc_files.KEEPS_NONE}" for path in without),
        ]
        for job, part in zip(jobs, parts, strict=False):
            advance(part, 0.0)
            if job.how in SIDECAR_KINDS:
                report["warnings"] += rpc_files.prepare_sidecar(
                    job.output, job.found.rpc, changes, SIDECAR_KINDS[job.how]
                )
            else:
                report["warnings"] += WRITERS[job.how](job.path, job.output, job.found.rpc, changes, part)
        changes.commit()
    for path in options.images if options.restore else ():
        found = rpc_files.read_rpc_or_none(path)
        report["images"][image_id(path)] = {
            "path": path,
            "output": path,
            "source": found.source if found else None,
            "max_difference_px": None,
        }
    for job in jobs:
        if job.how in WRITERS:
            rpc_files.require_in_place(job.output, job.found.rpc)
        report["images"][image_id(job.path)] = {
            "path": job.path,
            "output": job.output,
            "source": job.found.source,
            "ignored": list(job.found.ignored),
            "max_difference_px": rpc_files.read_back_px(job.output, job.found.rpc),
        }
    for notice in report["warnings"]:
        context.log(notice)
    advance(context.progress, 1.0, "done")
    return report


class WriteJob(NamedTuple):
    """One image: its path, the output and way of writing, and the RPC."""

    path: str
    output: str
    how: str
    found: rpc_files.FoundRpc


def _plan_jobs(options: WriteRpcOptions, inputs: Sequence[str]) -> list[WriteJob]:
    """Return the outputs to be written; raise `InputError` before anything is written."""
    if options.write in _NEEDS_FOLDER and not options.output_dir:
        raise InputError(f"`write` {options.write} needs `output_dir`: name a directory for the results")
    jobs, given = [], options.rpc
    if given and len(options.images) > 1 and not os.path.isdir(given):
        raise InputError(
            f"`rpc` {given} is the RPC of one image: give one image, or a folder of files named like images"
        )
    for path in options.images:
        # An RPC file alone has no pixels: it becomes a sidecar
        is_bare = options.write in _NEEDS_FOLDER and rpc_files.rpc_reader_of(path) is not None
        how = "sidecar" if is_bare else options.write
        suffix, folder = OUTPUT_ENDINGS[how], options.output_dir or os.path.dirname(path)
        output = path if suffix is None else os.path.join(folder, image_id(path) + suffix)
        # The RPC to be written: that of `rpc`, otherwise the image's own
        file = rpc_files.rpc_in_folder(given, path) if given and os.path.isdir(given) else given
        found = rpc_files.rpc_for_image(file, path) if file else rpc_files.read_rpc(path)
        _require_place(path, found, is_given=bool(file))
        jobs.append(WriteJob(path, output, how, found))
    for job in jobs:
        if job.how != "in-place" and os.path.exists(job.output) and not options.overwrite:
            raise InputError(f"{job.output} exists already: add `overwrite`, or choose another `output_dir`")
    require_no_input([job.output for job in jobs if job.how != "in-place"], inputs)
    made_from: dict[str, str] = {}
    for job in jobs:
        first = made_from.setdefault(os.path.realpath(job.output), job.path)
        if first is not job.path:
            raise InputError(
                f"{first} and {job.path} have the same id, so that one result would replace the other: rename one"
            )
    return jobs


def _require_place(path: str, found: rpc_files.FoundRpc, is_given: bool) -> None:
    """Raise `InputError` if an RPC contradicts the pixels of an image.

    is_given : True for the RPC of another file, which may be that of an image with smaller pixels (PAN of MS)
    """
    if rpc_files.rpc_reader_of(path) is not None:
        return
    doubt = rpc_files.find_placement_doubt(path, open_raster(path), found)
    if doubt is not None and doubt.is_gross and (doubt.contradictory or (is_given and doubt.factor != 1.0)):
        raise InputError(f"{path}: the RPC from {found.source} is not written: {doubt}")


def summarise(report: Report) -> str:
    """Return one line for each image, and the notices."""
    lines = [f"{entry['output']}: RPC from {entry['source']}" for entry in report["images"].values()]
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])
