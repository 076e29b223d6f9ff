"""Laser points of a block as options, points and report: for `triangulate` and `adjust`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.laser import LaserPoints
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.laser_files import read_laser
from ...hrsi_engine.measurement.reference.checks import dem_sigma_m
from ...hrsi_engine.plausibility.laser_quality import laser_reasons
from ...hrsi_engine.surface.dem import cell_size_m
from ..files.terrain import dem_surface
from ..interface.declare import Context, Report
from ..interface.option_groups import DemOptions, LaserFile, PointFiles

MAY_LIE_BESIDE_PX = 100.0  # a laser point so far beside an image may come to lie on it when the block moves
NOT_SEEN = "not on two images"
FEW_HOLD = 10  # laser points, below which a user should know


def read_laser_points(images: Sequence[Image], options: LaserFile, context: Context) -> LaserPoints | None:
    """Return the laser points that options name, with a doubt where one is not to be used; None without.

    Only those on two images or more count; raises `InputError` where there are none.
    """
    if not options.laser:
        return None
    points = read_laser(options.laser, options.laser_datum)
    points = points.select(np.flatnonzero(_seen_by(images, points.ground, 10.0 * MAY_LIE_BESIDE_PX) >= 1))
    if not len(points):
        raise InputError(
            f"{options.laser}: none of its laser points lies on an image: check that they are of this area"
        )
    reasons = laser_reasons(points)
    beside = _seen_by(images, points.ground, MAY_LIE_BESIDE_PX) < 2
    points = replace(points, doubt=np.where((reasons == "") & beside, NOT_SEEN, reasons))
    good = int((points.doubt == "").sum())
    context.log(f"{options.laser}: {len(points)} laser points on the images or near them, {good} of them usable")
    return points


def _seen_by(images: Sequence[Image], ground: np.ndarray, beside_px: float) -> np.ndarray:
    """Return how many images each place ``(n, 3)`` lies on, or at most so far beside."""
    count = np.zeros(len(ground), dtype=np.int64)
    for image in images:
        first_sample, last_sample, first_line, last_line = image.domain_px
        xy = image.rpc.project(ground)
        low = np.array([first_sample, first_line]) - beside_px
        high = np.array([last_sample, last_line]) + beside_px
        with np.errstate(invalid="ignore"):
            seen = np.flatnonzero(((xy >= low) & (xy <= high)).all(axis=1))
        # a polynomial comes back into the image far outside its domain: the ray must come back to the place
        back = image.rpc.localize(xy[seen], ground[seen, 2]).ground
        count[seen[np.abs(back[:, :2] - ground[seen, :2]).max(axis=1) < 1e-3]] += 1
    return count


def with_laser(options: AdjustOptions, laser: LaserPoints | None, dem: DemOptions, files: PointFiles) -> AdjustOptions:
    """Return options of an adjustment with laser points; a DEM that is named then holds heights too.

    Its standard deviation is that of its cell size, where none is given.
    """
    if laser is None:
        return options
    sigma_m = options.sigma_dem_m
    surface = dem_surface(dem, files.height_datum)
    if surface is not None and sigma_m is None:
        sigma_m = dem_sigma_m(cell_size_m(surface, laser.ground[len(laser) // 2]))
    return replace(options, laser=laser, sigma_dem_m=sigma_m)


def laser_entries(result: Adjustment, options: LaserFile) -> Report:
    """Return what the report says of the laser points."""
    found = result.laser
    if found is None:
        return {}
    holds = found.reason == ""
    residual = found.residual_m[holds]
    return {
        "laser": {
            "path": options.laser,
            "height_datum": options.laser_datum,
            "points": len(found.reason),
            "used": int(holds.sum()),
            "ties": int(found.ties[holds].sum()),
            "median_m": float(np.median(residual)) if residual.size else None,
            "rmse_m": float(np.sqrt(np.mean(residual**2))) if residual.size else None,
            "left_out": dict(Counter(found.reason[~holds].tolist()).most_common()),
        }
    }  # fmt: skip


def laser_warnings(result: Adjustment) -> list[str]:
    """Return what a user should know where few laser points hold anything."""
    found = result.laser
    if found is None:
        return []
    used = int((found.reason == "").sum())
    if used >= FEW_HOLD:
        return []
    most = Counter(found.reason[found.reason != ""].tolist()).most_common(1)
    why = f"; most of the others: {most[0][0]}" if most else ""
    return [f"only {used} of {len(found.reason)} laser points hold the block's height{why}"]
