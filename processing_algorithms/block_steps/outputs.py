"""From an adjustment to files: refined RPCs, layers, reports. Everything is staged and appears at once."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.block.block import Block, Image, Role
from ...hrsi_engine.foundation.errors import InputError, list_ids
from ...hrsi_engine.foundation.progress import advance, stage
from ...hrsi_engine.foundation.reasons import Level, Reason
from ...hrsi_engine.foundation.shared_heap import return_free_memory
from ...hrsi_engine.foundation.workers.threads import one_thread_calls
from ...hrsi_engine.io.array_files import write_arrays
from ...hrsi_engine.io.catalogue.block_records import CAMERAS_FILE, RECORD_FILE
from ...hrsi_engine.io.geopackage.layers import write_geopackage
from ...hrsi_engine.io.output_dir import check_output_dir, earlier_rpcs, stage_folder
from ...hrsi_engine.io.pages.report import write_report_html, write_report_json
from ...hrsi_engine.io.rpc_files import require_in_place
from ...hrsi_engine.io.safety.transactions import Transaction
from ...hrsi_engine.refinement.model import RefitRPC
from ...hrsi_engine.results import statistics as residual_statistics
from ...hrsi_engine.results.block_record import joint_arrays, record_of
from ...hrsi_engine.results.drawings import report_figures
from ...hrsi_engine.results.figures import block_report, rejection_warnings
from ...hrsi_engine.results.layers import block_layers, residuals_epsg
from ...hrsi_engine.results.lineage import lineage_items, state_accuracy
from ...hrsi_engine.results.residuals import residuals
from ...hrsi_engine.results.stac import RefinedFiles, has_time, item_collection, item_of_image
from ...hrsi_engine.results.tables import thinning_warnings
from ...hrsi_engine.results.verdict import Evidence, Verdict, describe_residual_fields, find_reasons, summarise_accuracy
from ..files.dry_run import PAGE_FILE, REPORT_FILE, plan
from ..files.target_chip import find_outline
from ..interface.declare import Context, Report
from ..interface.option_groups import BlockOutput
from .plausibility import explained_by
from .rpc_outputs import (
    IN_PLACE,
    WRITE_NOTHING,
    clear_the_way,
    images_with_pixels,
    planned_names,
    prepare_images,
    write_new_files,
)

FIT_WARNING_PX = 0.01  # a refined RPC farther than this from its model is worth a warning
WITHHELD = "no refined RPC was written, because the result is unusable: mend the input, or give `force_write`"
REMOVED = "the refined RPCs of the earlier run in the same folder are removed"
LAYERS_FILE, STAC_FILE = "block.gpkg", "stac.json"
#: What a dry run counts, and the roles of the points.
COUNTED = {"GCPs": Role.GCP, "check points": Role.CHECK, "tie points": Role.TIE}


class BlockOptions(Protocol):
    """What the options of every algorithm on blocks have."""

    @property
    def output(self) -> BlockOutput:
        """What is written, and where."""


class Clock:
    """Seconds of each part of a run, for the report."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._start = self._last = time.monotonic()

    def lap(self, part: str) -> None:
        """Close a part; the memory that it does not need any more is not kept for the next one."""
        return_free_memory()
        now = time.monotonic()
        self.seconds[part] = round(now - self._last, 3)
        self._last = now

    def total(self) -> dict[str, float]:
        """Return all parts and the total."""
        return {"total": round(time.monotonic() - self._start, 3), **self.seconds}


def require_room(output: BlockOutput, images: Sequence[Image], context: Context) -> None:
    """Raise `InputError`, before the work begins, where its results would replace what they may not replace."""
    names = _file_names(output, images)
    folder = output.folder
    told = check_output_dir(folder.output_dir, folder.overwrite, names, context.inputs, context.dry_run)
    for notice in told:
        context.log(notice)
    if output.stac and output.write == WRITE_NOTHING:
        raise InputError("`stac` tells of refined images: let `write` say where they go, or leave out `stac`")


def _file_names(output: BlockOutput, images: Sequence[Image]) -> list[str]:
    """Return the names of the files that a block's results are written into."""
    own = [REPORT_FILE, LAYERS_FILE, RECORD_FILE, CAMERAS_FILE, *([PAGE_FILE] if output.report else [])]
    items = [STAC_FILE, *(_item_file(image) for image in images)] if output.stac else []
    return [*own, *items, *planned_names(images, output.write).values()]


def _item_file(image: Image) -> str:
    return f"{image.id}_{STAC_FILE}"


def plan_results(
    options: BlockOptions,
    images: Sequence[Image],
    block: Block | None,
    warnings: Sequence[str],
    reasons: Sequence[Reason],
    context: Context,
    pairs: int | None = None,
    together: bool = True,
) -> Report:
    """Return the report of a dry run: the files, the counts and the verdict of the checks before an adjustment.

    Parameters
    ----------
    options : of the algorithm
    images : opened
    block : as far as it is known before tie points are found; None where nothing is
    warnings : what the user should know
    reasons : what was found in the inputs
    context : of the run
    pairs : overlapping pairs in which tie points would be looked for
    together : whether the images are adjusted together, and what is known of them so is written
    """
    counts = {"images": len(images)}
    if block is not None:
        counts |= {name: int(np.sum(block.points.role == role)) for name, role in COUNTED.items()}
        counts["image points"] = len(block.measurements)
    if pairs is not None:
        counts["overlapping pairs to be matched"] = pairs
    output = options.output
    names = [name for name in _file_names(output, images) if together or name != CAMERAS_FILE]
    if output.write == IN_PLACE:
        names += [os.path.abspath(image.path) for image in images if image.raster is not None]
    found = Verdict.create("nothing wrong was found" if not reasons else "the inputs were checked", reasons)
    return plan(context, output.folder.output_dir, names, counts, warnings, found.entry())


@one_thread_calls()  # cameras are refitted by small matrices, between which BLAS's other threads would spin
def write_results(
    options: BlockOptions,
    result: Adjustment,
    warnings: Sequence[str],
    clock: Clock,
    context: Context,
    more: Mapping[str, Any] | None = None,
    reasons: Sequence[Reason] = (),
    discarded: Sequence[str] = (),
) -> Report:
    """Write everything that the options ask for and the verdict allows; return the report.

    ``more`` are entries that the report has besides; ``reasons`` are what was found before the adjustment;
    ``discarded`` are folders that are not needed any more when all is written.
    """
    images = result.block.images
    left = residuals(result)
    with explained_by(reasons):  # corrections that wrong inputs made may lead where a camera has no ground
        refined = [
            result.model.compute_refined_rpc(image, values) for image, values in zip(images, result.values, strict=True)
        ]
        refined = state_accuracy(result, refined)
    clock.lap("residuals")
    evidence = Evidence(result, left, refined)
    report = {
        **context.record, "verdict": {}, "seconds": {},
        "crs": {**context.record["crs"], "residuals": f"EPSG:{residuals_epsg(result)}"},
        **block_report(result, left, refined),
        **residual_statistics.entries(result, left),
        "warnings": [*warnings, *result.warnings, *rejection_warnings(result), *thinning_warnings(result),
                     *_fit_warnings(images, refined), *describe_residual_fields(evidence)],
        **(more or {}),
    }  # fmt: skip
    verdict = Verdict.create(summarise_accuracy(report), find_reasons(evidence, reasons))
    report["verdict"] = verdict.entry()
    output = options.output
    how = output.write
    stale: list[str] = []
    if verdict.level is Level.UNUSABLE and how != WRITE_NOTHING and not output.force_write:
        how = WRITE_NOTHING
        stale = earlier_rpcs(output.folder.output_dir, context.inputs)
        report["warnings"] += [WITHHELD, *([REMOVED] if stale else [])]
    clock.lap("judge")
    target = output.folder
    cameras_file = os.path.join(target.output_dir, CAMERAS_FILE)
    if result.joint is None and os.path.exists(cameras_file):  # of an earlier run: it would pass for one of this
        stale.append(cameras_file)
    changes = Transaction(target.output_dir)
    with changes, stage_folder(target.output_dir, context.inputs, target.overwrite, changes, discarded) as folder:
        items = lineage_items(report, os.path.join(target.output_dir, REPORT_FILE))
        names = write_new_files(folder, images, refined, how, items, stage(context.progress, 0.0, 0.5))
        _name_outputs(report, output, how, images, names, result.joint is not None)
        advance(context.progress, 0.5, "writing layers")
        layers = block_layers(result, left, output.residual_crs)
        write_geopackage(str(folder / LAYERS_FILE), layers, progress=stage(context.progress, 0.5, 0.7), lineage=items)
        for file in stale:
            changes.remove(file)
        report["warnings"] += clear_the_way(target.output_dir, names, images, refined, changes)
        if how == IN_PLACE:
            report["warnings"] += prepare_images(images, refined, changes, items, stage(context.progress, 0.7, 0.95))
        if output.stac and how != WRITE_NOTHING:
            _write_items(folder, report, images, refined, target.output_dir)
        clock.lap("write")
        report["seconds"] = clock.total()
        if output.report:
            delivered = [replace(image, rpc=new.rpc) for image, new in zip(images, refined, strict=True)]
            write_report_html(str(folder / PAGE_FILE), report, report_figures(result, left, delivered, find_outline))
        write_report_json(str(folder / REPORT_FILE), report)
        write_report_json(str(folder / RECORD_FILE), record_of(result))
        if result.joint is not None:
            write_arrays(str(folder / CAMERAS_FILE), joint_arrays(result.joint))
        advance(context.progress, 1.0, "done")
    if how == IN_PLACE:
        for image, new in images_with_pixels(images, refined):
            require_in_place(image.path, new.rpc)
    return report


def _name_outputs(
    report: Report,
    options: BlockOutput,
    how: str,
    images: Sequence[Image],
    names: Mapping[str, str],
    together: bool,
) -> None:
    """Enter where the results will lie; ``how`` refined RPCs are written, of images that were adjusted ``together``."""
    folder = options.folder.output_dir
    for image in images:
        output = os.path.join(folder, names[image.id]) if image.id in names else None
        if how == IN_PLACE and image.raster is not None and image.path:
            output = image.path
        report["images"][image.id] = {"path": image.path, "output": output, **report["images"][image.id]}
    files = {"report": REPORT_FILE, "layers": LAYERS_FILE, "block": RECORD_FILE} | (
        {"html": PAGE_FILE} if options.report else {}
    )
    if together:
        files["cameras"] = CAMERAS_FILE
    report["outputs"] = {what: os.path.join(folder, name) for what, name in files.items()}


def _write_items(
    folder: Path, report: Report, images: Sequence[Image], refined: Sequence[RefitRPC], output_dir: str
) -> None:
    """Write the STAC items of refined images whose files lie in a temporary ``folder``, or are the images."""
    items = []
    for image, new in zip(images, refined, strict=True):
        entry = report["images"][image.id]
        written = entry["output"]
        staged = folder / os.path.basename(written)
        apart = written.upper().endswith(".TXT")  # a sidecar: the pixels stay where they are
        files = RefinedFiles(
            output_dir, image.path if apart else written, written if apart else None,
            {written: str(staged)} if staged.is_file() else {},
        )  # fmt: skip
        items.append(item_of_image(image, new, files, report))
        entry["stac"] = os.path.join(output_dir, _item_file(image))
        write_report_json(str(folder / _item_file(image)), items[-1])
    write_report_json(str(folder / STAC_FILE), item_collection(items))
    report["outputs"]["stac"] = os.path.join(output_dir, STAC_FILE)
    unknown = [item["id"] for item in items if not has_time(item)]
    if unknown:
        report["warnings"].append(
            f"no file tells when {list_ids(unknown)} was taken: STAC items have a span of time instead"
        )


def _fit_warnings(images: Sequence[Image], refined: Sequence[RefitRPC]) -> list[str]:
    return [
        f"{image.id}: the refined RPC differs from its model by up to {new.fit_max_px:.3f} px"
        for image, new in zip(images, refined, strict=True)
        if new.fit_max_px > FIT_WARNING_PX
    ]
