"""`strip`: one image with one RPC from parts or tiles of a strip."""

import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..hrsi_engine.block.block import Image
from ..hrsi_engine.block.exposures import STRIP, StripPlaces, fit_strip, place_parts
from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.foundation.thresholds import EQUALITY
from ..hrsi_engine.io.output_dir import require_plain_name
from ..hrsi_engine.io.point_files.csv_text import write_csv
from ..hrsi_engine.io.rasters.cropping import join_images, read_lineage, save_image
from ..hrsi_engine.io.rasters.orthoimages import OrthoFormat
from ..hrsi_engine.io.rpc_files import Lineage, read_back_px, set_aside_conflicting_rpcs, write_rpc_text
from ..hrsi_engine.io.safety.transactions import Transaction
from .declarations.rpcs import FORMAT_ENDINGS, StripOptions
from .files.opening import open_images
from .files.result_folder import REPORT_FILE, check_folder, plan, stage_results
from .interface.declare import Context, Report


def run(options: StripOptions, context: Context) -> Report:
    """Determine the positions of the parts, fit the RPC of the strip, and write both."""
    check_folder(options.folder, context)
    parts = open_images(options.images, context)
    if len(parts) < 2:
        raise InputError("a strip is made of two parts and more: name all of them")
    name = options.id or f"{parts[0].id}_strip"
    require_plain_name(name)
    places = place_parts(parts)
    strip = fit_strip(parts, places.first)
    with_pixels = all(part.has_file for part in parts)
    file = name + (FORMAT_ENDINGS[options.format] if with_pixels else "_RPC.TXT")
    grid_file = f"{name}_grid.csv" if strip.max_px.max() > EQUALITY.rpc_px else ""
    warnings = [
        f"{part.id}: by the RPCs it lies {off:.2g} px from whole pixels; it is placed at the next one, and the RPC of "
        "the strip lies between"
        for part, off in zip(parts, places.off_px.tolist(), strict=True)
        if off > STRIP.whole_px
    ]
    if grid_file:
        worst = int(strip.max_px.argmax())
        warnings.append(
            f"one RPC cannot represent the strip: the difference is up to {strip.max_px[worst]:.2g} px in "
            f"{parts[worst].id}. The grid of the RPCs of the parts is in {grid_file}; join fewer parts, or use the "
            "parts as images of a block"
        )
    folder = options.folder.output_dir
    if context.dry_run:
        return plan(context, folder, [REPORT_FILE, file, *filter(None, [grid_file])], {"parts": len(parts)}, warnings)
    rows = zip(parts, places.first.tolist(), places.off_px, strip.max_px, strip.rms_px, strict=True)
    entry: Report = {
        "path": None, "output": os.path.join(folder, file), "samples": places.size[0], "lines": places.size[1],
        "rpc_fit_max_px": strip.max_px.max(),
        "parts": {
            part.id: {"path": part.path, "sample": x, "line": y, "off_whole_px": off, "fit_max_px": most,
                      "fit_rms_px": rms}
            for part, (x, y), off, most, rms in rows
        },
    }  # fmt: skip
    report: Report = {**context.record, "images": {name: entry}, "warnings": warnings}
    changes = Transaction(folder)
    with changes, stage_results(options.folder, report, context, transaction=changes) as staged:
        target = str(staged / file)
        if with_pixels:
            joined = join_images([part.path for part in parts], places.first, places.size)
            form, lineage = OrthoFormat(options.format, options.compression), _join_lineages(parts, places)
            warnings += save_image(joined, target, strip.rpc, form=form, lineage=lineage, progress=context.progress)
        else:
            write_rpc_text(target, strip.rpc)
        warnings += set_aside_conflicting_rpcs(os.path.join(folder, file), parts[0].path, strip.rpc, changes)
        entry["max_difference_px"] = read_back_px(target, strip.rpc)
        if grid_file:  # in the format that `fit-rpc` reads
            rows = np.column_stack([strip.ground, strip.image]).tolist()
            write_csv(str(staged / grid_file), ("lon", "lat", "height", "sample", "line"), rows)
    return report


def _join_lineages(parts: Sequence[Image], places: StripPlaces) -> Lineage:
    """Return the lineage of the strip: metadata that all parts share, and the RPC before their refinement."""
    told = [read_lineage(part) for part in parts]
    items = dict(set.intersection(*(set(lineage.items.items()) for lineage in told)))
    items["HRSI_STRIP_PARTS"] = "; ".join(
        f"{os.path.basename(part.path)} {x},{y}" for part, (x, y) in zip(parts, places.first.tolist(), strict=True)
    )
    if all(lineage.original is None for lineage in told):
        return Lineage(items)
    before = [replace(part, rpc=one.original or part.rpc) for part, one in zip(parts, told, strict=True)]
    return Lineage(items, fit_strip(before, places.first).rpc)


def summarise(report: Report) -> str:
    """Return the strip, its parts, and the warnings."""
    lines = []
    for entry in report["images"].values():
        lines.append(f"{entry['output']}: {entry['samples']} x {entry['lines']} px")
        lines += [
            f"{name}: from sample {part['sample']}, line {part['line']}; difference of the "
            f"strip RPC up to {part['fit_max_px']:.3g} px, RMS {part['fit_rms_px']:.2g}"
            for name, part in entry["parts"].items()
        ]
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])
