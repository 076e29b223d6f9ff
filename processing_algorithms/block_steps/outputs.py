"""From an adjustment to files: refined RPCs, layers, reports. They are staged and moved into place together.

Refined RPCs are written to copies of the images, virtual images, ``_RPC.TXT`` files, or the images themselves.
"""

import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from ...hrsi_engine.block.block import Block, Image, Role
from ...hrsi_engine.block.jitter_curve import JitterCurve
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError, list_ids
from ...hrsi_engine.foundation.progress import Progress, advance, stage
from ...hrsi_engine.foundation.reasons import Reason
from ...hrsi_engine.foundation.shared_heap import return_free_memory
from ...hrsi_engine.io.catalogue.block_records import CAMERAS_FILE, RECORD_FILE
from ...hrsi_engine.io.geopackage.layers import write_geopackage
from ...hrsi_engine.io.jitter_files import JITTER_FILE, write_jitter
from ...hrsi_engine.io.large_tables import write_large_table
from ...hrsi_engine.io.output_dir import check_output_dir, earlier_rpcs, stage_folder
from ...hrsi_engine.io.pages.report import write_report_html, write_report_json
from ...hrsi_engine.io.point_files.kept_columns import COMPLETE_FILES
from ...hrsi_engine.io.rasters.dejitter import rewrite_without_jitter
from ...hrsi_engine.io.rpc_files import (
    Lineage,
    prepare_in_place,
    require_in_place,
    set_aside_conflicting_rpcs,
    write_geotiff_copy,
    write_rpc_text,
    write_vrt,
)
from ...hrsi_engine.io.safety.array_files import write_arrays
from ...hrsi_engine.io.safety.transactions import Transaction
from ...hrsi_engine.refinement.model import RefitRPC
from ...hrsi_engine.results.block_results import BlockResult
from ...hrsi_engine.results.stac import describe_assets
from ...hrsi_engine.results.verdict import Verdict
from ..files.result_folder import INPUTS_CHECKED, NOTHING_WRONG, PAGE_FILE, REPORT_FILE, plan
from ..files.target_chip import find_outline
from ..interface.declare import Context, Report
from ..interface.option_groups import BlockOutput

Writer = Callable[[str, str, RPC, Lineage, Progress], object]
Pairs = Sequence[tuple[Image, RefitRPC]]


#: By the choice of `write`: ending of the new file, and the function that writes it.
NEW_FILES: dict[str, tuple[str, Writer]] = {
    "copy": (".tif", lambda source, target, rpc, lineage, part: write_geotiff_copy(source, target, rpc, part, lineage)),
    "vrt": (".vrt", lambda source, target, rpc, lineage, part: write_vrt(source, target, rpc, lineage)),
    "sidecar": ("_RPC.TXT", lambda source, target, rpc, lineage, part: write_rpc_text(target, rpc, lineage)),
}
IN_PLACE, WRITE_NOTHING, RESAMPLED = "in-place", "none", "resampled"
NEW_FILES[RESAMPLED] = NEW_FILES["copy"]  # the pixels of the copy are then replaced by those without jitter
WITHOUT_PIXELS = "sidecar"  # for an RPC file alone a new RPC file is written in any case
WITHHELD = "no refined RPC was written, because the result is unusable: correct the input, or give `force_write`"
REMOVED = "the refined RPCs of the earlier run in the same folder are removed"
UNWANTED_RESIDUALS = {"wgs84": "residuals_utm", "utm": "residuals_wgs84"}  #: omitted layer, by `residual_crs`
LAYERS_FILE, STAC_FILE = "block.gpkg", "stac.json"
HELD_OUT_TIES = "held-out tie points"
#: Counts of a dry run, and the roles of their points.
COUNTED = {"GCPs": Role.GCP, "check points": Role.CHECK, "tie points": Role.TIE, HELD_OUT_TIES: Role.HELD_OUT}


def plan_file_names(images: Sequence[Image], how: str) -> dict[str, str]:
    """Return the names of the new files with refined RPCs, by image id."""
    choices = {image.id: how if image.has_file or how == WRITE_NOTHING else WITHOUT_PIXELS for image in images}
    return {name: name + NEW_FILES[choice][0] for name, choice in choices.items() if choice in NEW_FILES}


def _lineage_of(image: Image, items: Mapping[str, str]) -> Lineage:
    return Lineage({**items, "HRSI_SOURCE": os.path.basename(image.path)}, image.rpc)


class Clock:
    """Seconds of each part of a run, for the report."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._start = self._last = time.monotonic()

    def lap(self, part: str) -> None:
        """Add the time since the last call to a part, and release free memory before the next one."""
        return_free_memory()
        now = time.monotonic()
        self.seconds[part] = round(self.seconds.get(part, 0.0) + now - self._last, 3)
        self._last = now

    def total(self) -> dict[str, float]:
        """Return all parts and the total."""
        return {"total": round(time.monotonic() - self._start, 3), **self.seconds}


def require_room(output: BlockOutput, images: Sequence[Image], context: Context) -> None:
    """Raise `InputError`, before the computation, if its results would replace files that must not be replaced."""
    folder = output.folder
    check_output_dir(folder.output_dir, folder.overwrite, _file_names(output, images), context.inputs)
    if output.stac and output.write == WRITE_NOTHING:
        raise InputError("`stac` describes refined images: set `write`, or remove `stac`")


def _file_names(output: BlockOutput, images: Sequence[Image]) -> list[str]:
    """Return the names of the files with a block's results."""
    own = [REPORT_FILE, LAYERS_FILE, RECORD_FILE, CAMERAS_FILE, *([PAGE_FILE] if output.report else [])]
    items = [STAC_FILE, *(f"{image.id}_{STAC_FILE}" for image in images)] if output.stac else []
    return [*own, *items, *plan_file_names(images, output.write).values()]


def plan_results(
    output: BlockOutput,
    images: Sequence[Image],
    block: Block | None,
    warnings: Sequence[str],
    reasons: Sequence[Reason],
    context: Context,
    pairs: int | None = None,
    together: bool = True,
) -> Report:
    """Return the report of a dry run: the files, the counts and the verdict of the checks before an adjustment.

    block : as far as it is known before tie points are found; None if nothing is known
    warnings : for the user; reasons : findings of the checks of the inputs
    pairs : overlapping pairs that would be matched for tie points
    together : whether the images are adjusted together, so that the joint estimate of their cameras is written
    """
    counts = {"images": len(images)}
    if block is not None:
        counts |= {name: int(np.sum(block.points.role == role)) for name, role in COUNTED.items()}
        if not counts[HELD_OUT_TIES]:  # they are chosen in the run; only earlier ones exist
            del counts[HELD_OUT_TIES]
        counts["image points"] = len(block.measurements)
    if pairs is not None:
        counts["overlapping pairs to be matched"] = pairs
    names = [name for name in _file_names(output, images) if together or name != CAMERAS_FILE]
    if output.write == IN_PLACE:
        names += [os.path.abspath(image.path) for image in images if image.raster is not None]
    found = Verdict.create(INPUTS_CHECKED if reasons else NOTHING_WRONG, reasons)
    return plan(context, output.folder.output_dir, names, counts, warnings, found.entry())


def write_results(
    output: BlockOutput, result: BlockResult, clock: Clock, context: Context, discarded: Sequence[str] = ()
) -> Report:
    """Write all files that the options request and the verdict allows; return the report."""
    report, pairs, target, cameras = result.report, result.pairs, output.folder, result.cameras
    images = [image for image, _ in pairs]
    report["document"] = {name: getattr(output.document, name) for name in ("title", "client", "place")}
    how, stale = output.write, list[str]()  # files of earlier runs that must be removed
    if result.is_unusable and how != WRITE_NOTHING and not output.force_write:
        how, stale = WRITE_NOTHING, earlier_rpcs(target.output_dir, context.inputs)
        report["warnings"] += [WITHHELD, *([REMOVED] if stale else [])]
    stale += _list_stale_files(result, how, target.output_dir)
    curves = {} if how == WRITE_NOTHING else dict(result.jitter_curves or {})
    in_place = [(image, new) for image, new in pairs if how == IN_PLACE and image.has_file]
    changes = Transaction(target.output_dir)
    with changes, stage_folder(target.output_dir, context.inputs, target.overwrite, changes, discarded) as folder:
        names = plan_file_names(images, how)
        new_files = [(image, new) for image, new in pairs if image.id in names]
        _write_new_files(
            folder, new_files, names, how=how, curves=curves, items=result.lineage, context=context.stage(0.0, 0.5)
        )
        _name_outputs(report, output, how, images, names, cameras is not None)
        if curves:
            write_jitter(str(folder / JITTER_FILE), curves, {image.id: new.rpc for image, new in pairs})
            report["outputs"]["jitter"] = os.path.join(target.output_dir, JITTER_FILE)
        advance(context.progress, 0.5, "writing layers")
        layers = [layer for layer in result.layers if layer.name != UNWANTED_RESIDUALS.get(output.residual_crs)]
        for name, rows in result.tables.items():  # the complete tables of a large block
            write_large_table(str(folder / COMPLETE_FILES[name]), rows)
        part = stage(context.progress, 0.5, 0.7)
        write_geopackage(str(folder / LAYERS_FILE), layers, progress=part, lineage=result.lineage)
        report["outputs"] |= {name: os.path.join(target.output_dir, COMPLETE_FILES[name]) for name in result.tables}
        for file in stale:
            changes.remove(file)
        for image, new in new_files:  # older RPC files that would take precedence over those in new images
            if names[image.id].endswith(NEW_FILES["copy"][0]):
                path = os.path.join(target.output_dir, names[image.id])
                report["warnings"] += set_aside_conflicting_rpcs(path, image.path, new.rpc, changes)
        for part, (image, new) in _tell_writing(in_place, context.stage(0.7, 0.95)):  # all images or none
            report["warnings"] += prepare_in_place(
                image.path, new.rpc, changes, part, _lineage_of(image, result.lineage)
            )
        _write_curves_in_place(in_place, curves, target.output_dir, changes)
        if output.stac and how != WRITE_NOTHING:
            _write_items(folder, report, images, result.items, target.output_dir)
        clock.lap("write")
        drawings = result.draw(find_outline) if output.report else {}
        clock.lap("draw")
        report["seconds"] = clock.total()
        if output.report:
            write_report_html(str(folder / PAGE_FILE), report, drawings)
        write_report_json(str(folder / REPORT_FILE), report)
        write_report_json(str(folder / RECORD_FILE), result.record)
        if cameras is not None:
            write_arrays(str(folder / CAMERAS_FILE), cameras)
        advance(context.progress, 1.0, "done")
    for image, new in in_place:
        require_in_place(image.path, new.rpc)
    return report


def _list_stale_files(result: BlockResult, how: str, output_dir: str) -> list[str]:
    """Return files of an earlier run that would be mistaken for some of this one, which has none of their kind."""
    has_jitter = result.jitter_curves is not None and how not in (WRITE_NOTHING, RESAMPLED)
    is_written = {CAMERAS_FILE: result.cameras is not None, JITTER_FILE: has_jitter}
    is_written |= {file: name in result.tables for name, file in COMPLETE_FILES.items()}
    paths = [os.path.join(output_dir, file) for file, written in is_written.items() if not written]
    return list(filter(os.path.exists, paths))


def _write_new_files(
    folder: Path,
    pairs: Pairs,
    names: Mapping[str, str],
    how: str,
    curves: dict[str, JitterCurve],
    items: Mapping[str, str],
    context: Context,
) -> None:
    """Write refined RPCs to new files, with ``names`` by image id; ``curves`` of resampled images are removed."""
    for part, (image, new) in _tell_writing(pairs, context):
        (_, write), target = NEW_FILES[how if image.has_file else WITHOUT_PIXELS], str(folder / names[image.id])
        write(image.path, target, new.rpc, _lineage_of(image, items), part)
        if how == RESAMPLED and image.id in curves and image.has_file:
            rewrite_without_jitter(image.path, target, curves.pop(image.id), part)


def _write_curves_in_place(
    in_place: Pairs, curves: dict[str, JitterCurve], output_dir: str, changes: Transaction
) -> None:
    """Write the jitter curves of images that are written in place into their folders, except the output folder."""
    rpcs = defaultdict[str, dict[str, RPC]](dict)  # by folder and image
    for image, new in in_place:
        if image.id in curves:
            rpcs[os.path.dirname(os.path.abspath(image.path))][image.id] = new.rpc
    rpcs.pop(os.path.abspath(output_dir), None)
    for place, here in rpcs.items():
        with changes.replacing(os.path.join(place, JITTER_FILE)) as temporary:
            write_jitter(temporary, {name: curves[name] for name in here}, here)


def _tell_writing(pairs: Pairs, context: Context) -> Iterator[tuple[Progress, tuple[Image, RefitRPC]]]:
    """Yield the images with refined RPCs, each with the part of the progress that belongs to it."""
    for done, (image, new) in enumerate(pairs):
        part = stage(context.progress, done / len(pairs), (done + 1) / len(pairs))
        advance(part, 0.0, f"writing {image.id}")
        yield part, (image, new)


def _name_outputs(
    report: Report, options: BlockOutput, how: str, images: Sequence[Image], names: Mapping[str, str], together: bool
) -> None:
    """Enter the paths of the results; ``how`` refined RPCs are written, ``together`` is whether the cameras are."""
    folder = options.folder.output_dir
    for image in images:
        output = os.path.join(folder, names[image.id]) if image.id in names else None
        if how == IN_PLACE and image.raster is not None and image.path:
            output = image.path
        report["images"][image.id] = {"path": image.path, "output": output, **report["images"][image.id]}
    report["outputs"] = {
        what: os.path.join(folder, name)
        for what, name, is_made in (
            ("report", REPORT_FILE, True),
            ("layers", LAYERS_FILE, True),
            ("block", RECORD_FILE, True),
            ("html", PAGE_FILE, options.report),
            ("cameras", CAMERAS_FILE, together),
        )
        if is_made
    }


def _write_items(
    folder: Path, report: Report, images: Sequence[Image], described: Sequence[Report], output_dir: str
) -> None:
    """Write the STAC items of refined images, whose files are in a temporary ``folder`` or are the images."""
    items = []
    for image, item in zip(images, described, strict=True):
        entry = report["images"][image.id]
        staged = str(folder / os.path.basename(entry["output"]))
        items.append({**item, "assets": describe_assets(image, entry["output"], staged, output_dir)})
        entry["stac"] = os.path.join(output_dir, f"{image.id}_{STAC_FILE}")
        write_report_json(str(folder / f"{image.id}_{STAC_FILE}"), items[-1])
    write_report_json(str(folder / STAC_FILE), {"type": "FeatureCollection", "features": items})
    report["outputs"]["stac"] = os.path.join(output_dir, STAC_FILE)
    unknown = [item["id"] for item in items if item["properties"]["datetime"] is None]
    if unknown:
        report["warnings"].append(
            f"the acquisition time of {list_ids(unknown)} is not known: its STAC items have a time interval instead"
        )
