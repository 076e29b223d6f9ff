"""The output directory of an algorithm: its planned content (for a dry run), and writing it.

What GIS software shows of a result: its layers, and quick-looks of its images before and after the adjustment.

Of a folder that `init` has understood, it shows the footprints and quick-looks of the images, the points and the DEM.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ...hrsi_engine.block.imaging_geometry import compute_footprint
from ...hrsi_engine.foundation.progress import advance, stage
from ...hrsi_engine.foundation.reasons import Level
from ...hrsi_engine.ground.geodesy import WGS84, WGS84_3D
from ...hrsi_engine.io.geopackage.layer_tables import layer_names, text_columns
from ...hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ...hrsi_engine.io.geopackage.typed_rows import LayerRows
from ...hrsi_engine.io.output_dir import check_output_dir, exists_anywhere, stage_folder
from ...hrsi_engine.io.pages.report import write_page, write_report_json
from ...hrsi_engine.io.rasters.images import close_images, open_image
from ...hrsi_engine.io.rasters.ortho_warp import write_quick_look
from ..interface.declare import QUICK_LOOKS, STATES, Context, Report
from ..interface.option_groups import OptionalFolder, ResultFolder

REPORT_FILE, PAGE_FILE = "report.json", "report.html"


#: Sentences of the verdict of a dry run without and with findings.
NOTHING_WRONG, INPUTS_CHECKED = "nothing wrong was found", "the inputs were checked"


def plan(
    context: Context,
    folder: str | None,
    names: Sequence[str],
    counts: Mapping[str, int],
    warnings: Sequence[str] = (),
    verdict: Mapping[str, Any] | None = None,
) -> Report:
    """Return the report of a dry run: files that would be written, counts, and the result of the checks.

    folder : the output directory; None if the result would only be printed
    names : files that would be written, in the folder or with their own paths
    counts : numbers of inputs, by their name in the plural; warnings : for the user
    verdict : of the checks of the inputs; by default that nothing was found
    """
    files = [os.path.join(folder or "", name) for name in names]
    tell(warnings, context)
    return {
        **context.record,
        "dry_run": True,
        "files": [{"path": file, "replaces": exists_anywhere(file)} for file in files],
        "counts": dict(counts),
        "warnings": list(warnings),
        "verdict": dict(verdict or {"level": Level.OK.label, "sentence": NOTHING_WRONG, "reasons": []}),
    }


def check_folder(options: ResultFolder | OptionalFolder, context: Context) -> None:
    """Raise `InputError` if the output directory of the options, if any, cannot take a result."""
    if options.output_dir:
        check_output_dir(options.output_dir, options.overwrite, inputs=context.inputs)


def plan_folder(
    options: ResultFolder | OptionalFolder,
    file: str,
    counts: Mapping[str, int],
    warnings: Sequence[str],
    context: Context,
    page: bool = False,
) -> Report:
    """Return the report of a dry run that would write a report, one more file and, with ``page``, a page."""
    names = [REPORT_FILE, file, *([PAGE_FILE] if page else [])] if options.output_dir else []
    return plan(context, options.output_dir, names, counts, warnings)


@contextmanager
def stage_results(options: ResultFolder, report: Report, context: Context, **settings: Any) -> Iterator[Path]:
    """Yield a temporary folder, whose files move into the output directory with the report; log the warnings.

    ``settings`` are further arguments of `stage_folder`.
    """
    with stage_folder(options.output_dir, context.inputs, options.overwrite, **settings) as folder:
        yield folder
        write_report_json(str(folder / REPORT_FILE), report)
    tell(report["warnings"], context)
    advance(context.progress, 1.0, "done")


def write_folder(
    options: ResultFolder | OptionalFolder,
    report: Report,
    file: str,
    layers: Sequence[Layer],
    context: Context,
    page: str = "",
    **pictures: Any,
) -> None:
    """Write ``report.json``, a GeoPackage of layers and a ``page`` (a template) into the output directory, if any."""
    if options.output_dir:
        with stage_folder(options.output_dir, context.inputs, options.overwrite) as folder:
            write_geopackage(str(folder / file), layers, progress=stage(context.progress, 0.9, 1.0))
            if page:
                write_page(str(folder / PAGE_FILE), page, report, **pictures)
            write_report_json(str(folder / REPORT_FILE), report)
    advance(context.progress, 1.0, "done")


def write_points(
    options: OptionalFolder, report: Report, file: str, rows: LayerRows, names: Sequence[str], context: Context
) -> None:
    """Write points with lon, lat and height as `write_folder`; without a folder the report lists them.

    names : the columns that are listed; the coordinates of points with a non-finite one are NaN
    """
    if not options.output_dir:
        numbers = [name for name in names if rows[name].dtype.kind == "f"]
        lost = ~np.all([np.isfinite(rows[name]) for name in numbers], axis=0)
        values = [np.where(lost, np.nan, rows[name]) if name in numbers else rows[name] for name in names]
        listed = zip(*(one.tolist() for one in values), strict=True)
        report["points"] = [dict(zip(names, row, strict=True)) for row in listed]
    place = np.column_stack([rows["lon"], rows["lat"], rows["height"]])
    write_folder(options, report, file, [Layer(rows.layer, "PointZ", WGS84_3D, place, rows)], context)


def tell(warnings: Sequence[str], context: Context) -> None:
    """Log warnings."""
    for warning in warnings:
        context.log(f"warning: {warning}")


MOST_IMAGES = 12  # of a block: more would cover each other


def list_written_layers(folder: str, layers: Iterable[str]) -> list[str]:
    """Return the sources (``FILE|layername=L``) of those layers below a folder that exist."""
    parts = [os.path.join(folder, layer).partition("|layername=") for layer in layers]
    return ["".join(part) for part in parts if os.path.exists(part[0]) and part[2] in layer_names(part[0])]


def write_quick_looks(report: dict[str, Any], folder: str) -> None:
    """Write quick-looks of the adjusted images with pixels into ``QUICK_LOOKS``, by the given and by the refined RPCs.

    Without refined RPCs there are none. Raises `OutputError` if GDAL fails.
    """
    entries = {name: one for name, one in report.get("images", {}).items() if one.get("output") and one.get("path")}
    if not entries:
        return
    table = text_columns(os.path.join(folder, "block.gpkg"), "images", ("id", "footprint_height_m"))
    heights = dict(zip(table["id"], map(float, table["footprint_height_m"]), strict=True))
    try:
        for name, entry in list(entries.items())[:MOST_IMAGES]:
            image = open_image(entry["path"])
            if image.raster is not None:
                os.makedirs(os.path.join(folder, QUICK_LOOKS), exist_ok=True)
                for state, rpc in zip(STATES, (image.rpc, open_image(entry["output"]).rpc), strict=True):
                    path = os.path.join(folder, QUICK_LOOKS, f"{name}_{state}.tif")
                    write_quick_look(image, rpc, heights[name], path)
    finally:
        close_images()


def write_folder_map(shown: Mapping[str, Any], folder: str) -> list[str]:
    """Write layers of a folder that `init` understood, and return all sources for a map, the lowest first.

    shown : the entry ``map`` of the report of `init`; folder : of the new files
    Raises `OutputError` if a file cannot be written.
    """
    try:
        images = [open_image(path) for path in shown["images"]]
        outlines = [compute_footprint(image, image.middle_height_m) for image in images]
        columns = {"id": np.array([image.id for image in images]), "path": np.array([image.path for image in images])}
        layers = [Layer("images", "Polygon", WGS84, outlines, columns)]
        points, path = shown["points"], os.path.join(folder, "folder.gpkg")
        if points["id"]:
            texts = {key: np.array(points[key]) for key in ("id", "file")}
            layers.append(Layer("ground_points", "PointZ", WGS84_3D, np.array(points["position"]), texts))
        write_geopackage(path, layers)
        with_pixels = [image for image in images if image.raster is not None][:MOST_IMAGES]
        quick_looks = {os.path.join(folder, f"{image.id}.tif"): image for image in with_pixels}
        for target, image in quick_looks.items():
            write_quick_look(image, image.rpc, image.middle_height_m, target)
    finally:
        close_images()
    return [*shown["dems"], *quick_looks, *(f"{path}|layername={layer.name}" for layer in layers)]
