"""Evidence on a height datum that nothing states: heights of surveyed points, or of rays, against those of a DEM.

If heights above the geoid are used as ellipsoidal, they are wrong by its undulation N. Surveyed points whose datum is
known show that of a DEM, and the reverse. So do rays of two images: a point measured in both has the height h at which
its position in the second image is on the line of the positions of all heights along the ray of the first. The error
of h is that of the RPCs relative to each other, in pixels, over the length of this line for one metre of height.
"""

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...hrsi_engine.block.block import Image, ImagePoints
from ...hrsi_engine.block.imaging_geometry import GEOMETRY
from ...hrsi_engine.block.pointing import compute_gsd_m, estimate_pointing
from ...hrsi_engine.foundation.robust_scale import robust_sigma
from ...hrsi_engine.foundation.thresholds import GRIDS, GROUND, SAMPLES, threshold, thresholds
from ...hrsi_engine.io.rasters.dems import open_geoid
from ...hrsi_engine.measurement.point_transfer import transfer_point
from ...hrsi_engine.plausibility.mistakes import describe_height_unit, find_undulations


@thresholds
class HEIGHT_EVIDENCE:
    """Limits for the decision on a height datum."""

    decisive_ratio: float = threshold(20.0, "", "smallest ratio of the likelihoods of both hypotheses that decides")


class DatumEvidence(NamedTuple):
    """Decision on a height datum: the option's value, None if undecided, and the figures."""

    datum: str | None
    reason: str


class RayHeights(NamedTuple):
    """Positions lon, lat (n, 2), ellipsoidal heights (n,), the standard deviation common to all (m), and ids (n)."""

    lonlat: np.ndarray
    height_m: np.ndarray
    sigma_m: float
    ids: tuple[str, ...]


def weigh_hypotheses(
    lonlat: np.ndarray, ellipsoidal_m: np.ndarray, unknown_m: np.ndarray, sigma_m: float, what: str
) -> DatumEvidence:
    """Return whether unknown heights (n,) are ellipsoidal, or above the geoid, by known ones at the same places.

    sigma_m : standard deviation that the differences have in common; what : names the comparison in the reason
    """
    known = np.isfinite(ellipsoidal_m) & np.isfinite(unknown_m)
    geoid = find_installed_geoid(lonlat[known])
    if known.sum() < SAMPLES.plane or geoid is None:
        return DatumEvidence(None, "")
    difference = (ellipsoidal_m - unknown_m)[known]
    spread = float(robust_sigma(difference - np.median(difference))) / np.sqrt(known.sum())
    sigma = float(np.hypot(np.hypot(sigma_m, spread), GROUND.canopy_m))
    middle = [float(np.median(difference)), float(np.median(difference - geoid[1]))]
    loss = 0.5 * np.square(middle) / sigma**2  # negative logarithms of the likelihoods of normal errors
    best, limit = int(np.argmin(loss)), np.log(HEIGHT_EVIDENCE.decisive_ratio)
    is_decisive = loss[1 - best] - loss[best] > limit > loss[best]  # other units, other places agree with neither
    figures = (
        f"{what} are {middle[0]:+.1f} m higher if these are ellipsoidal, {middle[1]:+.1f} m if these refer to the "
        f"geoid ({known.sum()} points, sigma {sigma:.1f} m)"
    )
    if not is_decisive and (unit := describe_height_unit(ellipsoidal_m[known], unknown_m[known])):
        figures += f"; {unit}"
    return DatumEvidence(("ellipsoidal", geoid[0])[best] if is_decisive else None, figures)


def find_installed_geoid(lonlat: np.ndarray) -> tuple[str, np.ndarray] | None:
    """Return the name of the finest installed geoid model, and its undulations (m) at positions (n, 2 or 3)."""
    found = find_undulations(np.pad(lonlat[:, :2], ((0, 0), (0, 1))))
    return None if found is None else (open_geoid(found[0]).name, found[1])


def _trace(first: Image, second: Image, xy: np.ndarray, low_m: float, high_m: float) -> np.ndarray:
    """Return the positions (2, n, 2) in the second image of points of the first at the lowest and highest height."""
    return np.array([second.rpc.project(first.rpc.localize(xy, height).ground) for height in (low_m, high_m)])


def _intersect(
    first: Image, second: Image, xy: np.ndarray, other_xy: np.ndarray, height_m: float, ids: Sequence[str]
) -> RayHeights:
    """Return the heights of points (n, 2) that are measured in two images."""
    low_m, high_m = height_m - GEOMETRY.ray_reach_m, height_m + GEOMETRY.ray_reach_m
    low, high = _trace(first, second, xy, low_m, high_m)
    line = high - low
    length2 = np.square(line).sum(axis=1)
    height = low_m + (high_m - low_m) * ((other_xy - low) * line).sum(axis=1) / length2
    ground = first.rpc.localize(xy, height).ground
    error_px = np.linalg.norm([estimate_pointing(one).sigma_m / compute_gsd_m(one) for one in (first, second)])
    sigma_m = float(error_px / np.median(np.sqrt(length2)) * (high_m - low_m))
    return RayHeights(ground[:, :2], height, sigma_m, tuple(ids))


def intersect_tracks(images: Sequence[Image], tables: Sequence[ImagePoints], height_m: float) -> RayHeights | None:
    """Return the ray heights of the pair of images with the most accurate ones of points measured in both."""
    places = defaultdict[str, dict[str, np.ndarray]](dict)  # by image and point
    for table in tables:
        for name, image_id, xy in zip(table.ids.tolist(), table.image_ids.tolist(), table.xy, strict=True):
            places[image_id][name] = xy
    found = []
    for first, second in combinations(images, 2):
        common = sorted(places[first.id].keys() & places[second.id].keys())
        if len(common) >= SAMPLES.plane:
            xy, other = (np.array([places[image.id][name] for name in common]) for image in (first, second))
            found.append(_intersect(first, second, xy, other, height_m, common))
    return min(found, key=lambda one: one.sigma_m, default=None)


def measure_rays(images: Sequence[Image], height_m: float) -> RayHeights | None:
    """Return ray heights of a few points that are measured in the pixels of the pair with the steepest intersection."""
    reach = GEOMETRY.ray_reach_m
    pairs = []
    for first, second in combinations([image for image in images if image.raster is not None], 2):
        line = _trace(first, second, first.centre_px[None], height_m - reach, height_m + reach)
        if np.isfinite(line).all():
            inside = (np.abs(line.mean(axis=0)[0] - second.centre_px) < second.half_size_px).all()
            pairs.append((not inside, -float(np.hypot(*(line[1] - line[0])[0])), first, second))
    if not pairs:
        return None
    _, _, first, second = min(pairs, key=lambda one: one[:2])
    xy = first.grid_px(GRIDS.cells, GRIDS.cells, margin=-0.1)
    lines = _trace(first, second, xy, height_m - reach, height_m + reach)
    steps = [_trace(first, second, xy + step, height_m, height_m)[0] for step in ((0, 0), (1, 0), (0, 1))]
    margin = float(np.linalg.norm([estimate_pointing(one).sigma_m for one in (first, second)])) / compute_gsd_m(second)
    slopes = np.stack([steps[1] - steps[0], steps[2] - steps[0]], axis=-1)
    moved = [
        transfer_point(first.pixels, place, second.pixels, line, by_first, margin)
        for place, line, by_first in zip(xy, lines.swapaxes(0, 1), slopes, strict=True)
    ]
    rows = [row for row, one in enumerate(moved) if not one.refusal]
    if len(rows) < SAMPLES.plane:
        return None
    return _intersect(first, second, xy[rows], np.array([moved[row].xy for row in rows]), height_m, [""] * len(rows))
