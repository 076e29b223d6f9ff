"""`tie-points`: automatic tie points over a block, as layers and files that `adjust` and `triangulate` take."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..hrsi_engine.block.block import Image
from ..hrsi_engine.foundation.progress import advance
from ..hrsi_engine.ground.geodesy import WGS84_3D
from ..hrsi_engine.io.csv_tables import write_measurements
from ..hrsi_engine.io.geopackage.declared_layers import MeasurementRows, TiePointRows
from ..hrsi_engine.io.geopackage.layers import Layer, default_styles, write_geopackage
from ..hrsi_engine.io.opening.item_images import item_entry
from ..hrsi_engine.io.output_dir import check_output_dir, stage_folder
from ..hrsi_engine.io.pages.report import write_report_json
from ..hrsi_engine.io.point_files.kept_columns import COLUMNS_FILE, write_columns
from ..hrsi_engine.measurement.tie_points import TiePoints
from .block_steps.earlier_ties import read_earlier_ties, with_earlier
from .block_steps.outputs import Clock
from .block_steps.tie_search import connection_entries, count_pairs, find_ties
from .declarations.tie_points import LAYER, LAYERS_FILE, TiePointsOptions
from .files.dry_run import plan
from .files.image_files import open_input_images
from .files.result_folder import tell
from .files.terrain import open_terrain
from .interface.declare import Context, Report

TABLE_FILE, MEASUREMENTS_LAYER = "tie_points.csv", "image_points"


def run(options: TiePointsOptions, context: Context) -> Report:
    """Find the tie points of the images and write them."""
    check_output_dir(options.folder.output_dir, options.folder.overwrite, inputs=context.inputs)
    clock = Clock()
    new = open_input_images(options.images, context)
    earlier = read_earlier_ties(options.add_to, new)
    images = [*earlier.images, *new]
    surface = open_terrain(options.terrain)
    clock.lap("read")
    if context.dry_run:
        pairs = count_pairs(images, options.search, surface, earlier.ids)
        counts = {"images": len(images), "overlapping pairs to be matched": pairs}
        files = ["report.json", LAYERS_FILE, COLUMNS_FILE, *([TABLE_FILE] if options.csv else [])]
        return plan(context, options.folder.output_dir, files, counts)
    searching = context.stage(0.0, 0.95)
    found, finished = find_ties(images, options.search, surface, options.folder.output_dir, searching, earlier.ids)
    found = earlier.with_new(found)
    clock.lap("tie_points")
    target = options.folder
    with stage_folder(target.output_dir, context.inputs, target.overwrite, discarded=finished.discarded) as folder:
        # The layer of points and that of their measurements, both at approximate ground positions
        rows = found.image_points
        ids, track = np.unique(rows.ids, return_inverse=True)
        views = np.bincount(track, minlength=len(ids))
        points = TiePointRows(
            id=ids, views=views, height=found.ground[:, 2],
            sigma=np.sqrt(np.bincount(track, rows.sigma_px**2, len(ids)) / np.maximum(views, 1)),
            quality=np.bincount(track, rows.quality, len(ids)) / np.maximum(views, 1),
            kind=rows.kind[np.searchsorted(track, np.arange(len(ids)))] if len(ids) else rows.kind,
        )  # fmt: skip
        measured = MeasurementRows(
            id=rows.ids, image=rows.image_ids, sample=rows.xy[:, 0], line=rows.xy[:, 1],
            sigma=rows.sigma_px, kind=rows.kind, quality=rows.quality,
        )  # fmt: skip
        layers = [
            Layer(LAYER, "PointZ", WGS84_3D, found.ground, points),
            Layer(MEASUREMENTS_LAYER, "PointZ", WGS84_3D, found.ground[track], measured),
        ]
        styles = default_styles(layers[:1])
        write_geopackage(str(folder / LAYERS_FILE), layers, styles)
        write_columns(str(folder), rows)
        names = {"layers": LAYERS_FILE, "columns": COLUMNS_FILE}
        if options.csv:
            names["csv"] = TABLE_FILE
            write_measurements(str(folder / TABLE_FILE), found.image_points)
        outputs = {what: f"{options.folder.output_dir.rstrip('/')}/{name}" for what, name in names.items()}
        report = with_earlier(_make_report(images, found, context.record), earlier.report)
        report |= {"seconds": clock.total(), "outputs": outputs}
        write_report_json(str(folder / "report.json"), report)
    tell(found.warnings, context)
    advance(context.progress, 1.0, "done")
    return report


def _make_report(images: Sequence[Image], found: TiePoints, record: Report) -> Report:
    rows = found.image_points
    ids, track = np.unique(rows.ids, return_inverse=True)
    views = np.bincount(np.bincount(track, minlength=len(ids))) if len(ids) else np.zeros(0, int)
    return {
        **record,
        "images": {
            image.id: {"path": image.path, **item_entry(image.path),
                       "observations": int((rows.image_ids == image.id).sum()),
                       "cells": _cells_with_points(image, rows.xy[rows.image_ids == image.id])}
            for image in images
        },
        "pairs": [
            {"first": pair.first, "second": pair.second, "matches": pair.matches,
             "offset_px": None if math.isnan(pair.offset_px) else pair.offset_px}
            for pair in found.pairs
        ],
        "ties": {"points": len(ids), "observations": len(rows),
                 "by_views": {str(count): int(views[count]) for count in range(2, len(views)) if views[count]}},
        **connection_entries(found), "warnings": list(found.warnings),
    }  # fmt: skip


def _cells_with_points(image: Image, xy: Any, cells: int = 8) -> int:
    """Return how many of an image's 8 x 8 parts hold a tie point."""
    if image.size is None:
        return 0
    return len(np.unique(np.floor(cells * (xy + 0.5) / image.size), axis=0))


def summarise(report: Report) -> str:
    """Return the numbers of points and of measurements on each image."""
    ties = report["ties"]
    by_views = ", ".join(f"{count} on {views}" for views, count in ties["by_views"].items())
    lines = [f"{ties['points']} tie points ({by_views} images), {ties['observations']} measurements"]
    lines += [f"{name}: {image['observations']} measurements in {image['cells']} of 64 parts"
              for name, image in report["images"].items()]  # fmt: skip
    return "\n".join([*lines, *report["outputs"].values()])
