"""`measure-targets`: sub-pixel centres and corners near approximate positions, or from hand-measured edge points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from .files.image_pixels import ImagePixels, ground_of, open_pixels
from .files.result_folder import check_folder
from .files.terrain import GROUND_CRS, HEIGHT_DATUM
from .interface.declare import COMMON_PARAMS, OUTPUT_PARAMS, Algorithm, Context, Kind, Param, Report

if TYPE_CHECKING:
    import numpy as np

    from ..hrsi_engine.block.block import ImagePoints
    from ..hrsi_engine.io.layers import Layer
    from ..hrsi_engine.measurement.targets.measuring import TargetMeasurement

LAYERS_FILE, LAYER, PAGE_FILE = "targets.gpkg", "targets", "report.html"
MOST_CHIPS = 200  # on the page
AUTO = "auto"
KINDS = {"center": "center", "centre": "center", "corner": "corner"}


class Target(NamedTuple):
    """One target: what it is called, on which image, how it came out, and about where it was looked for."""

    id: str
    image: str
    measurement: TargetMeasurement
    approximate: np.ndarray | None = None


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Measure every target and write points, chips and report."""
    from ..hrsi_engine.foundation.errors import InputError
    from ..hrsi_engine.foundation.version import VERSION

    check_folder(options)
    if (options["points"] is None) == (options["edges"] is None):
        raise InputError("give either --points (approximate positions) or --edges (hand-measured edge points)")
    images = [open_pixels(path) for path in options["images"] or []] if options["points"] else []
    targets, warnings = _near_positions(images, options, context) if options["points"] else (_of_edges(options), [])
    made = [target for target in targets if not target.measurement.refusal]
    report: Report = {
        "schema": 1, "algorithm": "measure-targets", "version": VERSION, "measured": len(made),
        "refused": len(targets) - len(made), "targets": [_row(target) for target in targets],
        "chips_left_out": max(len(targets) - MOST_CHIPS, 0), "warnings": warnings,
        "settings": {key: value for key, value in options.items() if value is not None},
    }  # fmt: skip
    _write(options, report, targets, images, context)
    return report


def _row(target: Target) -> dict[str, Any]:
    made = target.measurement
    return {
        "id": target.id, "image": target.image, "kind": made.kind,
        "sample": float(made.xy[0]), "line": float(made.xy[1]),
        "sigma_px": made.sigma_px, "rmse_px": made.rmse_px, "edge_points": int(made.used.sum()),
        "stray_points": int((~made.used).sum()), "quality": made.quality, "refusal": made.refusal,
    }  # fmt: skip


# ---- approximate positions -------------------------------------------------------------------------------------


def _near_positions(
    images: list[ImagePixels], options: Mapping[str, Any], context: Context
) -> tuple[list[Target], list[str]]:
    """Return the targets near the positions of a point file, and warnings."""
    from ..hrsi_engine.foundation.progress import advance
    from ..hrsi_engine.measurement.targets.measuring import TargetOptions, measure_target

    by_id = {image.id: image for image in images}
    points, warnings = _approximate_points(images, options)
    settings = TargetOptions(options["search"], options["largest"], options["smallest"])
    targets = []
    rows = zip(points.ids.tolist(), points.image_ids.tolist(), points.xy, points.kind.tolist(), strict=True)
    for number, (name, image_id, xy, kind) in enumerate(rows):
        made = measure_target(by_id[image_id].raster, xy, _kind(options["kind"], kind, name), settings)
        targets.append(Target(name, image_id, made, xy))
        advance(context.progress, 0.9 * (number + 1) / len(points), f"target {name}")
    return targets, warnings


def _kind(wanted: str, stated: str, name: str) -> str:
    """Return what a target is: the option, else what its row says, else a centre."""
    from ..hrsi_engine.foundation.errors import InputError

    if wanted != AUTO:
        return wanted
    if stated and stated.lower() not in KINDS:
        raise InputError(
            f"point {name}: its kind {stated!r} is not one of {', '.join(KINDS)}: correct it or give --kind"
        )
    return KINDS[stated.lower()] if stated else "center"


def _approximate_points(images: list[ImagePixels], options: Mapping[str, Any]) -> tuple[ImagePoints, list[str]]:
    """Return the positions that a file has on the images, or where the RPCs see its ground points."""
    from ..hrsi_engine.foundation.errors import InputError
    from ..hrsi_engine.io.point_files import read_points

    ids = [image.id for image in images]
    if not ids:
        raise InputError("approximate positions need the images they are on: name them")
    tables = read_points(
        options["points"], ground_crs=options["ground_crs"], height_datum=options["height_datum"], image_ids=ids
    )
    warnings = list(tables.warnings)
    if tables.image is not None:
        unknown = sorted(set(tables.image.image_ids.tolist()) - set(ids))
        if unknown:
            raise InputError(
                f"{options['points']} names the image {unknown[0]!r}, which is not given: add it, or remove its points"
            )
        return tables.image, warnings
    if tables.ground is None:
        raise InputError(f"{options['points']} holds no points: add some")
    return _projected(images, tables.ground.ids, tables.ground.ground), warnings


def _projected(images: list[ImagePixels], ids: np.ndarray, ground: np.ndarray) -> ImagePoints:
    """Return where the RPCs see ground points, for all images in which they lie."""
    import numpy as np

    from ..hrsi_engine.block.block import ImagePoints
    from ..hrsi_engine.foundation.errors import InputError

    names, image_ids, places = [], [], []
    for image in images:
        if image.rpc is None:
            raise InputError(f"{image.path} has no RPC to find ground points with: give sample and line of the points")
        xy = image.rpc.project(ground)
        inside = np.all((xy > -0.5) & (xy < np.array(image.raster.size) - 0.5), axis=1)
        names += ids[inside].tolist()
        image_ids += [image.id] * int(inside.sum())
        places.append(xy[inside])
    if not names:
        raise InputError("no ground point lies in any of the images: check their CRS, or give sample and line")
    return ImagePoints.create(names, image_ids, np.concatenate(places))


# ---- hand-measured edge points ---------------------------------------------------------------------------------


def _of_edges(options: Mapping[str, Any]) -> list[Target]:
    """Return the targets of the edge points that share an id and an image."""
    import numpy as np

    from ..hrsi_engine.foundation.errors import InputError
    from ..hrsi_engine.io.point_files import read_points
    from ..hrsi_engine.io.rasters import image_id
    from ..hrsi_engine.measurement.targets.measuring import measure_edges

    points = read_points(options["edges"], image_ids=[image_id(path) for path in options["images"] or []]).image
    if points is None:
        raise InputError(f"{options['edges']} has no edge points: give the fields id, image, sample and line")
    keys = np.array([f"{image}\n{name}" for name, image in zip(points.ids, points.image_ids, strict=True)])
    targets = []
    for key in dict.fromkeys(keys.tolist()):
        rows = np.flatnonzero(keys == key)
        name, image = str(points.ids[rows[0]]), str(points.image_ids[rows[0]])
        kind = _kind(options["kind"], str(points.kind[rows[0]]), name)
        targets.append(Target(name, image, measure_edges(points.xy[rows], kind)))
    return targets


# ---- results ---------------------------------------------------------------------------------------------------


def _write(
    options: Mapping[str, Any], report: Report, targets: list[Target], images: list[ImagePixels], context: Context
) -> None:
    from ..hrsi_engine.drawing.target_chips import chip_svg
    from ..hrsi_engine.foundation.progress import advance, stage
    from ..hrsi_engine.io.layers import write_geopackage
    from ..hrsi_engine.io.output_dir import stage_folder
    from ..hrsi_engine.io.pages import write_page
    from ..hrsi_engine.io.report import write_report_json
    from .files.target_chip import chip_of

    by_id = {image.id: image for image in images}
    with stage_folder(options["output_dir"], context.inputs, options["overwrite"]) as folder:
        write_geopackage(
            str(folder / LAYERS_FILE), _layers(targets, by_id), progress=stage(context.progress, 0.9, 0.95)
        )
        if options["report"]:
            rasters = {image.id: image.raster for image in images}
            chips = [
                (target.id, target.image, chip_svg(chip_of(target.measurement, target.approximate, raster)))
                for target in targets[:MOST_CHIPS]
                for raster in [rasters.get(target.image)]
            ]
            write_page(str(folder / PAGE_FILE), "targets.html.j2", report, chips=chips)
        write_report_json(str(folder / "report.json"), report)
    advance(context.progress, 1.0, "done")


def _layers(targets: list[Target], images: Mapping[str, ImagePixels]) -> list[Layer]:
    """Return the measured points, ready as image points; at their ground positions where the images have RPCs."""
    import numpy as np

    from ..hrsi_engine.io.layers import Layer

    made = [target for target in targets if not target.measurement.refusal]
    rows = [_row(target) for target in made]
    names = ("id", "image", "kind")
    fields = {name: np.array([row[name] for row in rows], dtype=str) for name in names}
    fields |= {
        name: np.array([row[source] for row in rows], dtype=np.float64)
        for name, source in (
            ("sample", "sample"), ("line", "line"), ("sigma", "sigma_px"), ("quality", "quality"),
            ("rmse_px", "rmse_px"),
        )
    }  # fmt: skip
    fields["edge_points"] = np.array([row["edge_points"] for row in rows], dtype=np.int64)
    located = bool(made) and all(t.image in images and images[t.image].rpc is not None for t in made)
    ground = (
        np.concatenate([ground_of(images[t.image], t.measurement.xy[None], None) for t in made])
        if located
        else np.empty((len(made), 3))
    )
    return [Layer(LAYER, "PointZ" if located else "None", 4326, ground, fields)]


def summarise(report: Report) -> str:
    """Return one line a target."""
    lines = [f"{report['measured']} targets measured, {report['refused']} refused"]
    for row in report["targets"]:
        place = f"{row['sample']:.2f} {row['line']:.2f} +- {row['sigma_px']:.2f} px"
        lines.append(f"{row['id']} {row['image']} {row['kind']}: {row['refusal'] or place}")
    return "\n".join(lines)


ALGORITHM = Algorithm(
    name="measure-targets",
    title="Measure targets",
    group="Image points",
    summary="Sub-pixel centre or corner near given positions, or from hand-measured edge points",
    help=(
        "Measures points that were clicked roughly: the centre of a round or otherwise closed object (an ellipse or "
        "rectangle through its sub-pixel edge points), or the corner where two straight edges meet (a line through "
        "three edge points or more each). Stray edge points are left out, every point gets its standard deviation, and "
        "a point is refused where the feature is not there; an object that does not cover the position must be a clear "
        "one. Positions come from a point file with sample and line, or from ground points that the images' RPCs "
        "project.\n\n"
        "With --edges no pixels are needed: the edge points of a file (id, image, sample, line) are evaluated, six or "
        "more around an ellipse, or three or more on each of two lines. The report shows a chip of every target."
    ),
    declared=(
        Param("images", Kind.IMAGES, "Images; not needed with --edges", metavar="IMAGE"),
        Param("points", Kind.POINTS, "Approximate positions, on images or on the ground", metavar="FILE[|layername=L]"),
        Param("edges", Kind.POINTS, "Hand-measured edge points, those of a target under one id", metavar="FILE"),
        Param(
            "kind", Kind.CHOICE, "What the targets are; auto takes the field kind, and centres where there is none",
            default=AUTO, choices=(AUTO, "center", "corner"),
        ),
        Param("search", Kind.NUMBER, "The target lies within this distance", default=15.0, minimum=1.0, unit="px"),
        Param("smallest", Kind.NUMBER, "Smallest diameter of a centre's object", default=5.0, minimum=4.0, unit="px"),
        Param("largest", Kind.NUMBER, "Largest diameter", default=80.0, minimum=8.0, maximum=512.0, unit="px"),
        GROUND_CRS,
        HEIGHT_DATUM,
        *OUTPUT_PARAMS,
        Param("report", Kind.FLAG, "Write report.html with a chip of every target", default=True),
        *COMMON_PARAMS,
    ),
    run=run,
    packages=("cv2",),
    summarise=summarise,
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
)  # fmt: skip
