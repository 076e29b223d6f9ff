"""`measure-targets`: sub-pixel centres and corners near approximate positions, or from hand-measured edge points."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..hrsi_engine.block.block import ImagePoints
from ..hrsi_engine.block.control_visibility import CONTROL_VISIBILITY
from ..hrsi_engine.drawing.target_chips import draw_target_chip
from ..hrsi_engine.foundation.errors import InputError, list_ids
from ..hrsi_engine.foundation.progress import advance
from ..hrsi_engine.foundation.thresholds import LISTS
from ..hrsi_engine.io.geopackage.declared_layers import TargetRows
from ..hrsi_engine.io.geopackage.layers import Layer
from ..hrsi_engine.io.point_files import read_points
from ..hrsi_engine.io.rasters.images import image_id
from ..hrsi_engine.measurement.targets.measuring import TARGETS, TargetMeasurement, measure_edges, measure_target
from .declarations.image_points import AUTOMATIC_KIND, TARGETS_FILE, TARGETS_LAYER, MeasureTargetsOptions
from .files.opening import ImagePixels, ground_of, open_pixels, require_ids
from .files.result_folder import check_folder, plan_folder, tell, write_folder
from .files.target_chip import chip_of
from .interface.declare import Context, Report

TARGET_KINDS = {"center": "center", "centre": "center", "corner": "corner"}


class Target(NamedTuple):
    """One target: id, image, measurement, and the approximate position at which it was searched."""

    id: str
    image: str
    measurement: TargetMeasurement
    approximate: np.ndarray | None = None


def run(options: MeasureTargetsOptions, context: Context) -> Report:
    """Measure all targets and write points, chips and report."""
    check_folder(options.folder, context)
    if (options.points is None) == (options.edges is None):
        raise InputError("give either `points` (approximate positions) or `edges` (hand-measured edge points)")
    images = [open_pixels(path) for path in options.images]
    require_ids(options.images, [image.id for image in images])
    by_id = {image.id: image for image in images}
    if options.points is not None:
        points, warnings = _approximate_points(images, options.points, options)
        listed = zip(points.ids.tolist(), points.image_ids.tolist(), points.xy, points.kind.tolist(), strict=True)
        targets, count = list[Target](), len(points)
        for number, (name, image, xy, kind) in enumerate(() if context.dry_run else listed):
            found = measure_target(by_id[image].raster, xy, _choose_kind(options.kind, kind, name), options.target)
            targets.append(Target(name, image, found, xy))
            advance(context.progress, 0.9 * (number + 1) / count, f"target {name}")
    else:
        targets, warnings = _of_edges(str(options.edges), images, options)
        by_id, count = {}, len(targets)  # edge points are evaluated without pixels
    if context.dry_run:
        return plan_folder(options.folder, TARGETS_FILE, {"targets": count}, warnings, context, options.report)
    made = [target for target in targets if not target.measurement.refusal]
    # A warning for each image in which no target could be measured
    paths = {image_id(path): path for path in options.images}
    for image in dict.fromkeys(target.image for target in targets):
        refusals = [target.measurement.refusal for target in targets if target.image == image]
        if all(refusals):
            warnings.append(f"{paths.get(image, image)}: none of {len(refusals)} targets is measured ({refusals[0]})")
    tell(warnings, context)
    rows = [
        {"id": one.id, "image": one.image, "kind": found.kind, "sample": float(found.xy[0]), "line": float(found.xy[1]),
         "sigma_px": found.sigma_px, "rmse_px": found.rmse_px, "edge_points": int(found.used.sum()),
         "stray_points": int((~found.used).sum()), "quality": found.quality, "refusal": found.refusal}
        for one in targets for found in [one.measurement]
    ]  # fmt: skip
    report: Report = {
        **context.record,
        "measured": len(made),
        "refused": len(targets) - len(made),
        "targets": rows,
        "chips_left_out": max(len(targets) - LISTS.rows, 0),
        "warnings": warnings,
    }
    rasters = {image.id: image.raster for image in by_id.values()}
    chips = [
        (one.id, one.image, draw_target_chip(chip_of(one.measurement, one.approximate, rasters.get(one.image))))
        for one in targets[: LISTS.rows if options.report else 0]
    ]
    page = "targets.html.j2" if options.report else ""
    # The layer of measured targets, a file of image points; with ground positions if all images have RPCs
    fields = TargetRows.of_entries([{**row, "sigma": row["sigma_px"]} for row in rows if not row["refusal"]])
    located = bool(made) and all(one.image in by_id and by_id[one.image].rpc is not None for one in made)
    positions = [ground_of(by_id[one.image], one.measurement.xy[None], None) for one in made if located]
    ground = np.concatenate(positions) if located else np.empty((len(made), 3))
    layer = Layer(TARGETS_LAYER, "PointZ" if located else "None", 4326, ground, fields)
    write_folder(options.folder, report, TARGETS_FILE, [layer], context, page, chips=chips)
    return report


def _choose_kind(wanted: str, stated: str, name: str) -> str:
    """Return the kind of a target: that of the option, else that of its row, else centre."""
    if wanted != AUTOMATIC_KIND:
        return wanted
    if stated and stated.lower() not in TARGET_KINDS:
        raise InputError(
            f"point {name}: its kind {stated!r} is not one of {', '.join(TARGET_KINDS)}: correct it or give `kind`"
        )
    return TARGET_KINDS[stated.lower()] if stated else "center"


def _approximate_points(
    images: list[ImagePixels], file: str, options: MeasureTargetsOptions
) -> tuple[ImagePoints, list[str]]:
    """Return the image positions in a file, or the projections of its ground points, with warnings."""
    ids = [image.id for image in images]
    if not ids:
        raise InputError("approximate positions need the images they are on: name them")
    tables = read_points(file, ground_crs=options.ground_crs, height_datum=options.height_datum, image_ids=ids)
    warnings = list(tables.warnings)
    if tables.image is not None:
        if unknown := sorted(set(tables.image.image_ids.tolist()) - set(ids)):
            raise InputError(f"{file} names the image {unknown[0]!r}, which is not given: add it, or remove its points")
        return tables.image, warnings
    if tables.ground is None:
        raise InputError(f"{file} contains no points: add some")
    # Projections of the ground points, for all images that contain them; warnings for the other images
    names, image_ids, places = [], [], []
    for image in images:
        if image.rpc is None:
            raise InputError(f"{image.path} has no RPC to find ground points with: give sample and line of the points")
        xy = image.rpc.project(tables.ground.ground)
        inside = np.all((xy > -0.5) & (xy < np.array(image.raster.size) - 0.5), axis=1)
        names += tables.ground.ids[inside].tolist()
        image_ids += [image.id] * int(inside.sum())
        places.append(xy[inside])
        if not inside.any():
            warnings.append(f"{image.path}: no point of {file} lies in it: check its RPC, and the points' CRS")
    if not names:
        raise InputError(f"{file}: no ground point lies in any of the images: check their CRS, or give sample and line")
    return ImagePoints(names, image_ids, np.concatenate(places)), warnings


# ---- hand-measured edge points ---------------------------------------------------------------------------------


def _of_edges(
    file: str, images: Sequence[ImagePixels], options: MeasureTargetsOptions
) -> tuple[list[Target], list[str]]:
    """Return one target for the edge points with the same id and image, and warnings."""
    tables = read_points(file, image_ids=[image.id for image in images])
    points, warnings = tables.image, list(tables.warnings)
    if points is None:
        raise InputError(f"{file} has no edge points: give the fields id, image, sample and line")
    # Without the image it is only known that no image begins before its first pixel
    size = {image.id: image.raster.size for image in images}
    last = np.array([size.get(name, (np.inf, np.inf)) for name in points.image_ids.tolist()]).reshape(-1, 2)
    outside = ~np.all(
        (points.xy > -0.5 - CONTROL_VISIBILITY.edge_px) & (points.xy < last - 0.5 + CONTROL_VISIBILITY.edge_px), axis=1
    )
    if outside.any():
        ids = list_ids(np.unique(points.ids[outside]).tolist())
        warnings.append(f"{file}: {outside.sum()} edge points lie outside their image ({ids}): check sample and line")
    keys = np.array([f"{image}\n{name}" for name, image in zip(points.ids, points.image_ids, strict=True)])
    targets = []
    for key in dict.fromkeys(keys.tolist()):
        rows = np.flatnonzero(keys == key)
        name, image = str(points.ids[rows[0]]), str(points.image_ids[rows[0]])
        made = measure_edges(points.xy[rows], _choose_kind(options.kind, str(points.kind[rows[0]]), name))
        targets.append(Target(name, image, made))
        if not made.refusal and (made.sigma_px > TARGETS.largest_sigma_px or not made.used.all()):
            warnings.append(
                f"{file}: the edge points of {name} on {image} do not fit one another (RMSE {made.rmse_px:.1f} px, "
                f"{np.sum(~made.used)} of {len(rows)} left out): measure again those that lie apart"
            )
    return targets, warnings


def summarise(report: Report) -> str:
    """Return one line for each target."""
    lines = [f"{report['measured']} targets measured, {report['refused']} refused"]
    lines += [  # a refused target has no position
        f"{row['id']} {row['image']} {row['kind']}: "
        + (row["refusal"] or f"{row['sample']:.2f} {row['line']:.2f} +- {row['sigma_px']:.2f} px")
        for row in report["targets"]
    ]
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])
