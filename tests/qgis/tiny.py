"""A tiny declared algorithm with a parameter of every kind: it says what it was given, and waits when asked to."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path

from osgeo import ogr, osr

from hrsi.hrsi_engine.foundation.errors import InputError, MissingPackageError
from hrsi.hrsi_engine.foundation.options import nest_options, option
from hrsi.hrsi_engine.foundation.progress import advance
from hrsi.processing_algorithms.interface.declare import Algorithm, Context, Kind, Report, settings_of
from hrsi.processing_algorithms.interface.option_groups import ResultFolder

STEP_S = 0.02
STYLE = """<!DOCTYPE qgis><qgis version="3.22"><renderer-v2 type="RuleRenderer" symbollevels="0"><rules key="r">
<rule key="a" symbol="0" filter="&quot;id&quot; = 1"/></rules><symbols><symbol name="0" type="marker" alpha="1">
<layer class="SimpleMarker" enabled="1"/></symbol></symbols></renderer-v2></qgis>"""


#: Reasons of the verdicts that the option ``text`` asks for.
REASONS: dict[str, list[dict[str, str]]] = {
    "ok": [],
    "doubtful": [{"level": "doubtful", "message": "few ties", "advice": "find more", "code": "few-ties"}],
    "unusable": [{"level": "unusable", "message": "all is wrong", "advice": "look at `gcps`", "code": "ties-wrong"}],
}


def _fail_as_asked(text: str) -> None:
    """Raise the error that the option names."""
    if text == "input error":
        raise InputError("gcps.gpkg, layer gcps: no field 'id': rename the field that holds the point ids")
    if text == "no opencv":
        raise MissingPackageError("run pip", "opencv-python-headless")
    if text == "bug":
        raise ZeroDivisionError("a bug")


def _write_points(path: Path) -> None:
    """Write one point and, as the GeoPackage's default style, a rule-based renderer."""
    wgs84 = osr.SpatialReference()
    wgs84.ImportFromEPSG(4326)
    data = ogr.GetDriverByName("GPKG").CreateDataSource(str(path))
    layer = data.CreateLayer("points", wgs84, ogr.wkbPoint)
    layer.CreateField(ogr.FieldDefn("id", ogr.OFTInteger))
    feature = ogr.Feature(layer.GetLayerDefn())
    feature.SetField("id", 1)
    feature.SetGeometry(ogr.CreateGeometryFromWkt("POINT (147.3 -42.9)"))
    layer.CreateFeature(feature)
    styles = data.CreateLayer("layer_styles", None, ogr.wkbNone, ["ASPATIAL_VARIANT=GPKG_ATTRIBUTES"])
    row = {
        "f_table_catalog": "", "f_table_schema": "", "f_table_name": "points", "f_geometry_column": "geom",
        "styleName": "points", "styleQML": STYLE, "styleSLD": "", "useAsDefault": "1", "description": "",
        "owner": "", "ui": "", "update_time": "",
    }  # fmt: skip
    for name in row:
        styles.CreateField(ogr.FieldDefn(name, ogr.OFTString))
    feature = ogr.Feature(styles.GetLayerDefn())
    for name, value in row.items():
        feature.SetField(name, value)
    styles.CreateFeature(feature)


@dataclass(frozen=True, kw_only=True)
class TinyFields:
    """An option of every kind but the output folder."""

    images: tuple[str, ...] = option(help="Images or RPC files", kind=Kind.IMAGES)
    dem: str | None = option(None, "Heights", kind=Kind.RASTER)
    gcps: str | None = option(None, "Ground points", kind=Kind.POINTS)
    tie_points: str = option("auto", "Tie points", kind=Kind.POINTS, metavar="auto|none|FILE")
    height_datum: str = option("layer", "Heights", metavar="layer|ellipsoidal|FILE")
    ground_crs: str | None = option(None, "CRS of points", kind=Kind.CRS)
    extent: str = option("each", "What is shown", kind=Kind.EXTENT, metavar="each|union|W,S,E,N [CRS]")
    geoid: str | None = option(None, "Geoid grid", kind=Kind.FILE)
    text: str = option("none", "Text")
    gcp_ids: tuple[str, ...] | None = option(None, "Control points")
    strips: tuple[tuple[str, ...], ...] = option((), "Images of one strip")
    earlier: str | None = option(None, "Folder of an earlier result", kind=Kind.RESULT)
    project: str | None = option(None, "Project file", kind=Kind.PROJECT)
    sets: tuple[str, ...] = option((), "Folders with names", kind=Kind.FOLDERS, metavar="NAME=DIR")
    scale: tuple[float, float] = option((0.8, 1.25), "Ratio of the pixels")
    model: str = option("auto", "Model", choices=("auto", "shift", "affine"))
    max_iterations: int = option(10, "Iterations", minimum=1, maximum=99, advanced=True)
    sigma_image_px: float = option(0.5, "Sigma of a measurement", name="sigma-image", unit="px", minimum=0.0)
    wait: float | None = option(None, "Time to wait, beside `sigma_image_px`", unit="s")
    report: bool = option(True, "Write a report")


@dataclass(frozen=True, kw_only=True)
class TinyOptions(TinyFields):
    """An option of every kind."""

    folder: ResultFolder = nest_options(ResultFolder)


def run(options: TinyOptions, context: Context) -> Report:
    """Report the options; ``wait`` seconds pass in steps that can be cancelled."""
    _fail_as_asked(options.text)
    steps = max(1, round((options.wait or 0.0) / STEP_S))
    for step in range(steps):
        advance(context.progress, step / steps, "waiting")
        time.sleep(STEP_S)
    context.log("waited")
    report = {"schema": 1, "algorithm": "tiny-test", "options": settings_of(options)}
    if options.text in REASONS:
        report["verdict"] = {"level": options.text, "sentence": "2 images", "reasons": REASONS[options.text]}
    if options.folder.output_dir:
        folder = Path(options.folder.output_dir)
        folder.mkdir(parents=True, exist_ok=True)
        _write_points(folder / "tiny.gpkg")
        (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    return report


def summarise(report: Report) -> str:
    """Return the algorithm's name."""
    return f"algorithm {report['algorithm']}"


TINY = Algorithm(
    name="tiny-test",
    title="Tiny test",
    group="Tests",
    summary="Says what it was given",
    help="First paragraph.\n\nSecond with a < sign.",
    options=TinyOptions,
    module=__name__,
    layers=("tiny.gpkg|layername=points", "tiny.gpkg|layername=not_written"),
)
