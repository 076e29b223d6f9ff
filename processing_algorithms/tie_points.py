"""`tie-points`: automatic tie points of a block, as layers and files that `adjust` and `triangulate` read."""

import math
from collections.abc import Sequence

import numpy as np

from ..hrsi_engine.block.block import Image
from ..hrsi_engine.ground.geodesy import WGS84_3D
from ..hrsi_engine.io.geopackage.declared_layers import MeasurementRows, TiePointRows
from ..hrsi_engine.io.geopackage.layers import Layer, default_styles, write_geopackage
from ..hrsi_engine.io.opening.item_images import item_entry
from ..hrsi_engine.io.output_dir import check_output_dir
from ..hrsi_engine.io.point_files.csv_text import write_measurements
from ..hrsi_engine.io.point_files.kept_columns import COLUMNS_FILE, write_columns
from ..hrsi_engine.measurement.tie_points import TiePoints, find_overlapping_pairs
from .block_steps.outputs import Clock
from .block_steps.tie_search import connection_entries, find_ties, read_earlier_ties
from .declarations.image_points import TIES_FILE, TIES_LAYER, TiePointsOptions
from .files.opening import open_images, open_terrain
from .files.result_folder import plan, stage_results
from .interface.declare import Context, Report

TABLE_FILE, MEASUREMENTS_LAYER = "tie_points.csv", "image_points"


def run(options: TiePointsOptions, context: Context) -> Report:
    """Find the tie points of the images and write them."""
    check_output_dir(options.folder.output_dir, options.folder.overwrite, inputs=context.inputs)
    clock = Clock()
    new = open_images(options.images, context)
    earlier = read_earlier_ties(options.add_to, new)
    images = [*earlier.images, *new]
    surface = open_terrain(options.terrain)
    clock.lap("read")
    if context.dry_run:
        pairs = len(find_overlapping_pairs(images, options.search.search, surface, earlier.ids))
        counts = {"images": len(images), "overlapping pairs to be matched": pairs}
        files = ["report.json", TIES_FILE, COLUMNS_FILE, *([TABLE_FILE] if options.csv else [])]
        return plan(context, options.folder.output_dir, files, counts)
    searching = context.stage(0.0, 0.95)
    found, discarded = find_ties(images, options.search, surface, options.folder.output_dir, searching, earlier.ids)
    found = earlier.with_new(found)
    clock.lap("tie_points")
    report = _make_report(images, found, context.record)
    report["pairs"] = [*earlier.report.get("pairs", []), *report["pairs"]]
    report["held"] |= earlier.report.get("held", {})
    with stage_results(options.folder, report, context, discarded=discarded) as folder:
        # Layers of points and of their measurements, both at approximate ground positions
        rows = found.image_points
        ids, track = np.unique(rows.ids, return_inverse=True)
        views = np.bincount(track, minlength=len(ids))
        points = TiePointRows(
            id=ids,
            views=views,
            height=found.ground[:, 2],
            sigma=np.sqrt(np.bincount(track, rows.sigma_px**2, len(ids)) / np.maximum(views, 1)),
            quality=np.bincount(track, rows.quality, len(ids)) / np.maximum(views, 1),
            kind=rows.kind[np.searchsorted(track, np.arange(len(ids)))] if len(ids) else rows.kind,
        )
        measured = MeasurementRows(
            id=rows.ids,
            image=rows.image_ids,
            sample=rows.xy[:, 0],
            line=rows.xy[:, 1],
            sigma=rows.sigma_px,
            kind=rows.kind,
            quality=rows.quality,
        )
        layers = [
            Layer(TIES_LAYER, "PointZ", WGS84_3D, found.ground, points),
            Layer(MEASUREMENTS_LAYER, "PointZ", WGS84_3D, found.ground[track], measured),
        ]
        write_geopackage(str(folder / TIES_FILE), layers, default_styles(layers[:1]))
        write_columns(str(folder), rows)
        names = {"layers": TIES_FILE, "columns": COLUMNS_FILE}
        if options.csv:
            names["csv"] = TABLE_FILE
            write_measurements(str(folder / TABLE_FILE), found.image_points)
        outputs = {what: f"{options.folder.output_dir.rstrip('/')}/{name}" for what, name in names.items()}
        report |= {"seconds": clock.total(), "outputs": outputs}
    return report


def _make_report(images: Sequence[Image], found: TiePoints, record: Report) -> Report:
    """Return the report of a search: measurements by image, matches by pair, points by the number of images."""
    rows = found.image_points
    ids, track = np.unique(rows.ids, return_inverse=True)
    views = np.bincount(np.bincount(track, minlength=len(ids))) if len(ids) else np.zeros(0, int)
    return {
        **record,
        "images": {image.id: _image_entry(image, rows.xy[rows.image_ids == image.id]) for image in images},
        "pairs": [
            {
                "first": pair.first,
                "second": pair.second,
                "matches": pair.matches,
                "offset_px": None if math.isnan(pair.offset_px) else pair.offset_px,
            }
            for pair in found.pairs
        ],
        "ties": {
            "points": len(ids),
            "observations": len(rows),
            "by_views": {str(count): int(views[count]) for count in range(2, len(views)) if views[count]},
        },
        **connection_entries(found),
        "warnings": list(found.warnings),
    }


def _image_entry(image: Image, xy: np.ndarray) -> Report:
    """Return the report's entry of an image: number of measurements, and number of its 8 x 8 parts that have one."""
    cells = 0 if image.size is None else len(np.unique(np.floor(8 * (xy + 0.5) / image.size), axis=0))
    return {"path": image.path, **item_entry(image.path), "observations": len(xy), "cells": cells}


def summarise(report: Report) -> str:
    """Return the number of points, and the number of measurements in each image."""
    ties = report["ties"]
    by_views = ", ".join(f"{count} on {views}" for views, count in ties["by_views"].items())
    lines = [f"{ties['points']} tie points ({by_views} images), {ties['observations']} measurements"]
    lines += [
        f"{name}: {image['observations']} measurements in {image['cells']} of 64 parts"
        for name, image in report["images"].items()
    ]
    return "\n".join([*lines, *report["outputs"].values()])
