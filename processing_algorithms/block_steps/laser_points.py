"""Laser points of a block: reading by options, adjustment and report entries, for `triangulate` and `adjust`."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ...hrsi_engine.adjustment.external.laser_heights import LASER_FIT
from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.adjustment.solver import adjust
from ...hrsi_engine.block.block import Block, Image, Role
from ...hrsi_engine.block.laser import LaserPoints
from ...hrsi_engine.block.orthoimage import ReferencePlaces
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.large_arrays import finite_rows
from ...hrsi_engine.foundation.progress import stage
from ...hrsi_engine.foundation.thresholds import ITERATIONS, SAMPLES, threshold, thresholds
from ...hrsi_engine.ground.geodesy import LocalFrame, ground_difference_m
from ...hrsi_engine.io.laser_files import read_laser
from ...hrsi_engine.plausibility.laser_quality import find_laser_reasons
from ...hrsi_engine.surface.dem import HeightSurface, cell_size_m, dem_sigma_m
from ..files.opening import open_control_surface
from ..interface.declare import Context, Report
from ..interface.option_groups import LaserFile, PointFiles, SurfaceFile
from .inputs import check_operations


@thresholds
class LASER_SEARCH:
    """Selection of laser points near the images, and iterations of measuring tie points at them."""

    margin_px: float = threshold(
        100.0, "px", "distance of a laser point from an image within which a shift of the block may bring it in"
    )


NOT_SEEN = "not on two images"


def add_laser_points(
    block: Block, options: LaserFile, files: PointFiles, context: Context
) -> tuple[LaserPoints | None, Block, list[str]]:
    """Read the laser points that options name, with a doubt for those that are not used; None if none are named.

    Only points in at least two images are used; raises `InputError` if there are none near the images. Also returned
    are the block with their coordinate operations, and warnings on these.
    """
    if not options.laser:
        return None, block, []
    points = read_laser(options.laser, options.laser_datum, files.ground_crs, files.gcp_epoch)
    points = points.select(
        np.flatnonzero(_count_views(block.images, points.ground, 10.0 * LASER_SEARCH.margin_px) >= 1)
    )
    if not len(points):
        raise InputError(
            f"{options.laser}: none of its laser points lies on an image: check that they are of this area"
        )
    reasons = find_laser_reasons(points)
    beside = _count_views(block.images, points.ground, LASER_SEARCH.margin_px) < 2
    points = replace(points, doubt=np.where((reasons == "") & beside, NOT_SEEN, reasons))
    good = int((points.doubt == "").sum())
    context.log(f"{options.laser}: {len(points)} laser points on the images or near them, {good} of them usable")
    told = check_operations(block, points.operations, files.strict_datum)
    return points, replace(block, operations=block.operations + points.operations), told


def _count_views(images: Sequence[Image], ground: np.ndarray, margin_px: float) -> np.ndarray:
    """Return the number of images that contain each position ``(n, 3)``, or are at most ``margin_px`` away from it."""
    count = np.zeros(len(ground), dtype=np.int64)
    for image in images:
        xy, (low, high) = image.rpc.project(ground), np.reshape(image.domain_px, (2, 2)).T  # of sample and line
        with np.errstate(invalid="ignore"):
            seen = np.flatnonzero(((xy >= low - margin_px) & (xy <= high + margin_px)).all(axis=1))
        # far outside its domain a polynomial returns into the image: the ray must lead back to the position
        back = image.rpc.localize(xy[seen], ground[seen, 2]).ground
        count[seen[np.abs(back[:, :2] - ground[seen, :2]).max(axis=1) < 1e-3]] += 1
    return count


def with_surface(
    options: AdjustOptions, file: SurfaceFile, points: PointFiles, block: Block
) -> tuple[AdjustOptions, Block, list[str]]:
    """Open the surface that constrains the block, if one is named.

    Return the options with the surface, the block with its coordinate operations, and warnings on these.
    """
    opened = open_control_surface(file, points, options.surface_kind, block.images[0].rpc)
    if opened is None:
        return options, block, []
    if options.sigma_dem_m is not None:
        raise InputError(
            "`surface` and `sigma_dem_m` both constrain the block: give one of them; with `surface` also "
            "`sigma_surface`"
        )
    surface, sigma_m = opened
    told = check_operations(block, surface.operations, points.strict_datum)
    block = replace(block, operations=block.operations + surface.operations)
    return replace(options, dem=surface, sigma_dem_m=sigma_m), block, told


def add_height_control(
    options: AdjustOptions,
    surface: HeightSurface | None,
    laser: LaserPoints | None,
    reference: ReferencePlaces | None = None,
) -> AdjustOptions:
    """Return the options of an adjustment with laser points, places of a reference, and a DEM that constrains heights.

    ``surface`` is that DEM. It is used if its standard deviation is given, or with laser points or places; then the
    default of its standard deviation follows from its cell size.
    """
    places = [points.ground for points in (laser, reference) if points is not None]
    if options.sigma_dem_m is None and not places:
        return options
    surface, sigma_m = options.dem or surface, options.sigma_dem_m
    if sigma_m is not None and surface is None:
        raise InputError("`sigma_dem_m` needs a DEM: name it with `dem`")
    if surface is not None and sigma_m is None:
        sigma_m = dem_sigma_m(cell_size_m(surface, places[0][len(places[0]) // 2]))
    return replace(options, laser=laser, reference=reference, sigma_dem_m=sigma_m, dem=surface)


def adjust_at_laser_points(
    block: Block, options: AdjustOptions, threads: int, context: Context
) -> tuple[Adjustment, list[str]]:
    """Adjust a block with laser points, and tie points measured at them; also return warnings.

    The laser points are projected with the cameras of a preceding adjustment, and again if the block has moved by more
    than the allowed distance of tie points from laser points.
    """
    laser = options.laser
    if laser is None or sum(image.raster is not None for image in block.images) < 2:
        return adjust(block, options, context.progress), []
    result = adjust(block, options, stage(context.progress, 0.0, 0.1))
    from ...hrsi_engine.measurement.laser_ties import measure_laser_ties  # matching takes a fifth of a second to load

    for number in range(ITERATIONS.repeated):
        part = context.stage(0.1 + 0.3 * number, 0.4 + 0.3 * number)
        images = [
            replace(image, rpc=result.model.compute_refined_rpc(image, values).rpc)
            for image, values in zip(block.images, result.values, strict=True)
        ]
        lifted = replace(laser, ground=laser.ground + [0.0, 0.0, _above_laser_m(result, laser)])
        ties = measure_laser_ties(images, lifted, threads, stage(part.progress, 0.0, 0.7))
        context.log(f"{len(np.unique(ties.ids))} tie points measured at laser points")
        if not len(ties):
            return result, [
                "no tie point could be measured at a laser point: the terrain there follows from other tie points"
            ]
        before, result = result, adjust(block.with_ties(ties), options, stage(part.progress, 0.7, 1.0))
        moved = ground_difference_m(result.ground[: len(block.points)], before.ground[: len(block.points)])
        moved = np.abs(np.median(moved[finite_rows(moved)], axis=0))
        if np.hypot(*moved[:2]) < LASER_FIT.moved_m and moved[2] < LASER_FIT.moved_m:
            break
    return result, []


def _above_laser_m(result: Adjustment, laser: LaserPoints) -> float:
    """Return the median height of the block above the laser points; 0 if they constrain the block already."""
    found = result.laser
    if found is not None and (found.reason == "").sum() >= SAMPLES.fewest:
        return 0.0
    ties = result.ground[(result.block.points.role == Role.TIE) & finite_rows(result.ground)]
    good = laser.ground[laser.doubt == ""]
    if not len(ties) or not len(good):
        return 0.0
    tie_xy, laser_xy = (LocalFrame(*ties[0]).from_ground(ground)[:, :2] for ground in (ties, good))
    _, near = cKDTree(tie_xy).query(laser_xy, k=min(SAMPLES.tested, len(ties)))
    return float(np.median(np.median(ties[near.reshape(len(good), -1), 2], axis=1) - good[:, 2]))


def describe_laser(result: Adjustment, options: LaserFile) -> tuple[Report, list[str]]:
    """Return the report's entry on the laser points, and a warning if few of them are used."""
    found = result.laser
    if found is None:
        return {}, []
    holds = found.reason == ""
    used, residual, left_out = int(holds.sum()), found.residual_m[holds], Counter(found.reason[~holds].tolist())
    entry = {
        "path": options.laser,
        "height_datum": options.laser_datum,
        "points": len(found.reason),
        "used": used,
        "ties": int(found.ties[holds].sum()),
        "median_m": float(np.median(residual)) if residual.size else None,
        "rmse_m": float(np.sqrt(np.mean(residual**2))) if residual.size else None,
        "left_out": dict(left_out.most_common()),
    }
    why = f"; most of the others: {left_out.most_common(1)[0][0]}" if left_out else ""
    warning = f"only {used} of {len(found.reason)} laser points are used for the height of the block{why}"
    return {"laser": entry}, [warning] if used < SAMPLES.fewest else []
