"""GCPs from a reference orthoimage: options, points and report entries, for `gcps-from-reference` and `triangulate`."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints, Role
from ...hrsi_engine.block.orthoimage import REFERENCE_KIND, ReferencePlaces
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.reasons import Level, Reason
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.ground.operation_uses import OperationUse, largest_sigma_m
from ...hrsi_engine.io.rasters.ortho_rasters import open_reference
from ...hrsi_engine.measurement.reference import checks
from ...hrsi_engine.measurement.reference.matching import ReferenceControl, match_reference
from ...hrsi_engine.surface.dem import HeightSurface, cell_size_m, dem_sigma_m
from ...hrsi_engine.surface.grid_surface import GridSurface
from ..interface.declare import Context, Report
from ..interface.option_groups import PointFiles, ReferenceImage
from .inputs import check_operations
from .inputs import read_block as read_files


@thresholds
class REFERENCE_SIGMA:
    """Default standard deviation of a reference orthoimage."""

    pixels: float = threshold(2.0, "px", "standard deviation in its pixels, at most that of satellite images")
    satellite_m: float = threshold(
        5.0,
        "m",
        "standard deviation of free satellite orthoimages (minimum)",
        "Sentinel-2: 12.5 m for 95 %; Landsat: 12 m CE90",
    )
    satellite_pixels: float = threshold(
        0.5, "px", "standard deviation of free satellite orthoimages in their pixels, at least", "Landsat: 30 m pixels"
    )


PREFIX = "REF"


class FromReference(NamedTuple):
    """Result of matching: images, places found, accuracy of the reference, report entries and warnings.

    excessive : whether the RPC and the reference differ by more than their accuracies can explain
    operations : transformations of the reference and the DEM to WGS84
    """

    images: Sequence[Image]
    control: ReferenceControl
    accuracy: checks.ReferenceAccuracy
    entries: Report
    warnings: list[str]
    excessive: bool = False
    operations: tuple[OperationUse, ...] = ()


def default_sigma_m(gsd_m: float) -> float:
    """Return the standard deviation of places in a reference orthoimage (m) by its pixel size."""
    satellite_m = max(REFERENCE_SIGMA.satellite_m, REFERENCE_SIGMA.satellite_pixels * gsd_m)
    return min(REFERENCE_SIGMA.pixels * gsd_m, satellite_m)


def find_reference_control(
    images: Sequence[Image],
    options: ReferenceImage,
    surface: HeightSurface | None,
    sigma_dem_m: float | None,
    context: Context,
    epoch: float | None = None,
) -> FromReference:
    """Match the images that have pixels with a reference orthoimage.

    surface : heights of the points; None raises `InputError`
    sigma_dem_m : standard deviation of these heights; None derives it from the cell size of the DEM
    epoch : year at which coordinates in a plate-fixed CRS are transformed to WGS84

    Raises `InputError` if there is no orthoimage or no DEM, or no image has pixels.
    """
    path = options.reference
    if path is None:
        raise InputError("there is no orthoimage to match with: name one with `reference`")
    if surface is None:
        raise InputError(f"{path}: the heights of its points come from a DEM: name one with `dem`")
    with_pixels = [image for image in images if image.raster is not None]
    if not with_pixels:
        raise InputError("a reference can only be matched with images that have pixels: name the images themselves")
    reference = open_reference(path, options.reference_band, epoch)
    control = match_reference(with_pixels, reference, surface, options.matching, context.progress)
    of_dem = tuple(getattr(surface, "operations", ()))
    sigma_h_m = sigma_dem_m
    if sigma_h_m is None:
        middle = control.ground[len(control.ground) // 2 :][:1]
        sigma_h_m = dem_sigma_m(cell_size_m(surface, middle[0])) if len(middle) else 1.0
    sigma_xy_m = options.reference_sigma or default_sigma_m(reference.gsd_m)
    # The errors of the coordinate operations of the places are included
    shared_m = largest_sigma_m(reference.operations)[0], largest_sigma_m(of_dem)[1]
    accuracy = checks.ReferenceAccuracy(*np.hypot((sigma_xy_m, sigma_h_m), shared_m).tolist())
    control, wrong_parts = checks.drop_wrong_parts(with_pixels, control, accuracy)
    shifts = [
        checks.compute_reference_shift(image, found, control.ground, accuracy)
        for image, found in zip(with_pixels, control.images, strict=True)
    ]
    warnings = [f"{found.image_id}: {found.refusal}" for found in control.images if found.refusal]
    warnings += [f"{path}: {part.message}" for part in wrong_parts]
    known = [shift for shift in shifts if shift is not None]
    warnings += checks.describe_shifts(known)
    entries: Report = {
        "path": path,
        "gsd_m": reference.gsd_m,
        "places": len(control.ground),
        "sigma_xy_m": accuracy.sigma_xy_m,
        "sigma_h_m": accuracy.sigma_h_m,
        "used": True,
        "wrong_parts": [part._asdict() for part in wrong_parts],
        "far": checks.describe_far_shifts(known),
        "images": {
            found.image_id: _image_entry(found, shift) for found, shift in zip(control.images, shifts, strict=True)
        },
    }
    excessive = any(shift.is_excessive for shift in known)
    return FromReference(
        with_pixels,
        control,
        accuracy,
        entries=entries,
        warnings=warnings,
        excessive=excessive,
        operations=reference.operations + of_dem,
    )


def _image_entry(found: Any, shift: Any) -> Report:
    """Return the report's entry of an image matched with the reference: matches, and how well they agree (px)."""
    used, agreement = found.used, found.agreement
    bias = [None, None] if agreement is None else agreement.coefficients[:, 0].tolist()
    return {
        "matched": len(used),
        "used": int(used.sum()),
        "working_pixel_px": found.step,
        "bias_sample_px": bias[0],
        "bias_line_px": bias[1],
        "spread_px": None if agreement is None else agreement.spread_px,
        "east_m": None if shift is None else shift.east_m,
        "north_m": None if shift is None else shift.north_m,
        "limit_m": None if shift is None else shift.limit_m,
        "refusal": found.refusal or None,
    }


def reference_points(found: FromReference) -> tuple[GroundPoints, ImagePoints]:
    """Return the GCPs and their image measurements that agree with the bias of their image."""
    control = found.control
    seen = np.unique(np.concatenate([part.places[part.used] for part in control.images]))
    sigma = np.tile(found.accuracy.compute_sigmas(control.ground[seen]), (len(seen), 1))
    ids = np.char.add(PREFIX, np.char.lstrip(control.ids, "R"))
    ground = GroundPoints(ids[seen], control.ground[seen], Role.GCP, sigma, found.entries["path"])
    rows = [(part, part.used) for part in control.images]
    image_points = ImagePoints(
        np.concatenate([ids[part.places[used]] for part, used in rows]),
        np.concatenate([np.full(int(used.sum()), part.image_id) for part, used in rows]),
        np.concatenate([part.xy[used] for part, used in rows]),
        sigma_px=np.concatenate([part.sigma_px[used] for part, used in rows]),
        kind=REFERENCE_KIND,
        quality=np.concatenate([part.score[used] for part, used in rows]),
        source=found.entries["path"],
    )
    return ground, image_points


def reference_reasons(entries: Report) -> list[Reason]:
    """Return reasons against the reference of a block: no image matches it, or the RPCs differ from it too much.

    ``entries`` are those of the block's report.
    """
    entry = entries.get("reference")
    if entry is None:
        return []
    told = ["no image of the block matches it, so it is not used"]
    advice = "name an orthoimage of this area with similar pixel size and season, or remove it"
    if any(image["used"] for image in entry["images"].values()):
        told = entry["far"][:1] if entry["used"] else []
        advice = "check the georeference of the reference; the block was adjusted to it"
    return [Reason("reference-not-found", Level.DOUBTFUL, f"{entry['path']}: {one}", advice) for one in told]


def read_reference_block(
    images: Sequence[Image],
    files: PointFiles,
    dem: GridSurface | None,
    tie_points: str | None,
    ties: Sequence[ImagePoints],
    reference: ReferenceImage,
    sigma_dem_m: float | None,
    context: Context,
) -> tuple[Block, ReferencePlaces | None, list[str], Report]:
    """Read a block with the GCPs of the reference among its points; also return them as places, warnings, entries.

    If surveyed GCPs contradict the reference, it is not used. If the RPCs differ from it by more than both accuracies
    can explain, the reference is used, and a warning is given.
    """
    found = find_reference_control(images, reference, dem, sigma_dem_m, context, files.gcp_epoch)
    ground, measured = reference_points(found)
    control = files
    if files.gcp_ids:
        control = replace(files, gcp_ids=(*files.gcp_ids, *ground.ids.tolist()))
    block, warnings = read_files(images, control, dem, tie_points, [*ties, measured], [ground])
    rows, gcps = block.measurements, []
    surveyed = (block.points.role == Role.GCP)[rows.point] & (rows.kind != REFERENCE_KIND)
    for index, image in enumerate(block.images):
        here = surveyed & (rows.image == index)
        point = rows.point[here]
        if here.any():
            gcps.append(
                checks.ImageGcps(image.id, block.points.ground[point], block.points.sigma_m[point], rows.xy[here])
            )
    differ = checks.contradiction(found.images, found.control, gcps, found.accuracy) if gcps else None
    if differ is not None:
        found.entries["surveyed_gcps"] = {
            "measurements": differ.points,
            "east_m": differ.east_m,
            "north_m": differ.north_m,
            "limit_m": differ.limit_m,
        }
    places: ReferencePlaces | None = None
    if differ is not None and differ.is_excessive and np.isfinite(differ.limit_m):
        found.entries["used"] = False
        block, warnings = read_files(images, files, dem, tie_points, ties)
        found.warnings.append(differ.message)
    elif len(ground):
        places = ReferencePlaces(ground.ids, ground.ground, found.accuracy.sigma_xy_m, found.excessive)
    block = replace(block, operations=found.operations)
    told = check_operations(block, found.operations, files.strict_datum)
    return block, places, [*found.warnings, *dict.fromkeys([*told, *warnings])], {"reference": found.entries}
