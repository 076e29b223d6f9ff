"""Laser points as ICESat-2 measures them, over a simulated terrain: tracks, places, heights and their errors.

Six beams fly over the scene at once, in three pairs 3.3 km apart, 90 m within a pair. A segment's height is the mean
of the terrain below it, 40 m along the track by default, at a place that is known to some metres: the same error for
all of a pass. The spread of the photons and their number are drawn from distributions fitted to 10 527 segments of
ATL06-SR over Utqiagvik, Alaska (2018 to 2024, medians 0.24 m and 24 photons): 82 % of the spreads are log-normal about
0.23 m, 18 % about 0.26 m with a tail of four times the width; the standard deviation that a segment states is the
spread over the root of the number of photons, times 1 to 1.8. The error has in addition what no segment states. Canopy
comes in patches along the track and reads high by some metres with a wider spread; clouds read anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...block.laser import LaserPoints
from .options import LaserSpec
from .terrain import TerrainSurface
from .world import constant, constants

ICESAT_2 = "ICESat-2: 10 527 segments of ATL06-SR over Utqiagvik, 2018 to 2024"


@constants
class LASER:
    """Geometry, errors and photons of a laser altimeter like ICESat-2."""

    pair_distance_m: float = constant(3300.0, "m", "distance of the pairs of beams", ICESAT_2)
    beam_distance_m: float = constant(90.0, "m", "distance of the beams of a pair", ICESAT_2)
    azimuth_deg: float = constant(7.0, "°", "direction of a pass at middle latitudes", ICESAT_2)
    footprint_m: float = constant(11.0, "m", "diameter of a footprint", ICESAT_2)
    spacings_m: tuple[float, float] = constant((20.0, 40.0), "m", "distances of points along a beam", ICESAT_2)
    place_m: float = constant(2.5, "m", "standard deviation of the position in plan", ICESAT_2)
    pass_m: float = constant(0.1, "m", "standard deviation of the height of a pass")
    common_m: float = constant(0.05, "m", "standard deviation of the height of all passes together")
    segment_m: float = constant(0.1, "m", "standard deviation of the height of a segment")
    spread: tuple[tuple[float, float, float], ...] = constant(
        ((0.82, np.log(0.232), 0.487), (0.18, np.log(0.263), 1.254)),
        "",
        "spread of photons, two groups: share, mean and sigma of the logarithm",
        ICESAT_2,
    )
    photons: tuple[float, float] = constant(
        (np.log(24.0), 0.95), "", "photons of a segment: mean and sigma of the logarithm", ICESAT_2
    )
    stated_share: tuple[float, float] = constant(
        (1.0, 1.8), "", "stated standard deviation over spread per root of the photons", ICESAT_2
    )
    canopy_patch_m: float = constant(200.0, "m", "side of a patch of one height of trees")
    canopy_height_m: tuple[float, float] = constant(
        (2.0, 3.0), "", "shape and scale of the gamma distribution of heights in trees"
    )
    canopy_spread: tuple[float, float] = constant(
        (np.log(0.7), 0.6), "", "spread there: mean and sigma of the logarithm"
    )
    cloud_m: tuple[float, float] = constant((20.0, 600.0), "m", "heights of clouds above the ground")
    cloud_spread: tuple[float, float] = constant(
        (np.log(2.0), 0.8), "", "spread there: mean and sigma of the logarithm"
    )


GROUND_HIT, CANOPY_HIT, CLOUD_HIT = 0, 1, 2  #: what a laser point met


@dataclass(frozen=True, eq=False)
class LaserSimulation:
    """Laser points as a user has them, and what is true of them.

    Parameters
    ----------
    points : LaserPoints
        What a user has.
    met : (n,) ndarray of int
        Ground 0, canopy 1, cloud 2.
    error_m : (n,) ndarray
        Of the heights, against the terrain at the places that the points state.
    """

    points: LaserPoints
    met: np.ndarray
    error_m: np.ndarray


def simulate_laser(
    terrain: TerrainSurface, half_extent_m: float, spec: LaserSpec, seed: int | Sequence[int]
) -> LaserSimulation:
    """Return the laser points of some passes over a terrain.

    Parameters
    ----------
    terrain : TerrainSurface
        The ground.
    half_extent_m : float
        How far from the middle points are wanted.
    spec : LaserSpec
        How many, and what they met.
    seed : int or sequence of int
        The same seed gives the same points.

    Returns
    -------
    LaserSimulation
        Every pass has a pair of beams at least within the area.
    """
    rng = np.random.default_rng(seed)
    of_all = rng.normal(0.0, LASER.common_m)
    tracks = [
        track
        for number in range(spec.passes)
        for track in _draw_pass(terrain, half_extent_m, spec, f"pass {number + 1}", of_all, rng)
    ]
    if not tracks:
        return LaserSimulation(LaserPoints(np.zeros((0, 3))), np.zeros(0, dtype=np.int64), np.zeros(0))
    names = ("ground", "sigma_m", "slope", "misfit_m", "photons", "track", "met", "error_m")
    columns = {name: np.concatenate([track[name] for track in tracks]) for name in names}
    surfaces, error = columns.pop("met"), columns.pop("error_m")
    return LaserSimulation(LaserPoints(**columns, source="simulation"), surfaces, error)


def _draw_pass(
    terrain: TerrainSurface, half_m: float, spec: LaserSpec, name: str, of_all: float, rng: np.random.Generator
) -> list[dict[str, np.ndarray]]:
    """Return the beams of a pass that cross the area, as columns."""
    azimuth = np.radians(rng.choice([LASER.azimuth_deg, 180.0 - LASER.azimuth_deg]))
    along, across = np.array([np.sin(azimuth), np.cos(azimuth)]), np.array([np.cos(azimuth), -np.sin(azimuth)])
    middle = LASER.pair_distance_m * rng.integers(-1, 2) + rng.uniform(-0.8, 0.8) * half_m
    spacing = rng.choice(LASER.spacings_m)
    place, bias = rng.normal(0.0, LASER.place_m, 2), rng.normal(0.0, LASER.pass_m) + of_all
    beams = []
    for beam in range(6):
        offset_m = middle + LASER.pair_distance_m * (beam // 2 - 1) + LASER.beam_distance_m * (beam % 2 - 0.5)
        way = np.arange(-1.5 * half_m, 1.5 * half_m, spacing) + rng.uniform(0.0, spacing)
        stated = offset_m * across + way[:, None] * along
        stated = stated[(np.abs(stated) < half_m).all(axis=1)]
        if len(stated):
            track = _measure_heights(
                terrain, stated, stated + place, along=along, across=across, spec=spec, bias=bias, rng=rng
            )
            beams.append(track | {"track": np.full(len(stated), name)})
    return beams


def _measure_heights(
    terrain: TerrainSurface,
    stated: np.ndarray,
    true: np.ndarray,
    along: np.ndarray,
    across: np.ndarray,
    spec: LaserSpec,
    bias: float,
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Return the segments of a beam at ``stated (n, 2)`` chart positions, which were measured at the ``true`` ones."""
    count = len(stated)
    ahead, side = np.meshgrid(np.linspace(-0.5, 0.5, 9) * spec.segment_m, np.linspace(-0.5, 0.5, 3) * LASER.footprint_m)
    offsets = ahead.ravel()[:, None] * along + side.ravel()[:, None] * across
    footprint_m = terrain.height(*np.moveaxis(true[:, None] + offsets, 2, 0))
    height = footprint_m.mean(axis=1)
    slope = ((footprint_m - height[:, None]) * ahead.ravel()).mean(axis=1) / float(np.mean(ahead**2))
    part = np.where(rng.random(count) < LASER.spread[0][0], 0, 1)
    middle, width = np.array(LASER.spread)[part, 1], np.array(LASER.spread)[part, 2]
    rough = (footprint_m - height[:, None] - slope[:, None] * ahead.ravel()).std(axis=1)  # buildings, a step, a terrace
    spread = np.hypot(np.exp(rng.normal(middle, width)), rough)
    photons = np.maximum(np.round(np.exp(rng.normal(*LASER.photons, count))), 5.0)
    sigma = rng.uniform(*LASER.stated_share, count) * spread / np.sqrt(photons)
    surfaces = _classify_points(count, np.hypot(*(stated[-1] - stated[0])) / max(count - 1, 1), spec, rng)
    leaves, cloud = surfaces == CANOPY_HIT, surfaces == CLOUD_HIT
    height += bias + rng.normal(0.0, np.hypot(sigma, LASER.segment_m))
    height[leaves] += rng.gamma(*LASER.canopy_height_m, int(leaves.sum()))
    height[cloud] += rng.uniform(*LASER.cloud_m, int(cloud.sum()))
    for hit, (log_middle, log_width) in ((leaves, LASER.canopy_spread), (cloud, LASER.cloud_spread)):
        wider = np.exp(rng.normal(log_middle, log_width, count)) / spread
        spread, sigma = np.where(hit, spread * np.maximum(wider, 1.0), spread), np.where(hit, sigma * wider, sigma)
    return {
        "ground": terrain.chart.to_ground(stated, height),
        "sigma_m": sigma,
        "slope": slope,
        "misfit_m": spread,
        "photons": photons,
        "met": surfaces,
        "error_m": height - terrain.height(*stated.T),
    }


def _classify_points(count: int, spacing_m: float, spec: LaserSpec, rng: np.random.Generator) -> np.ndarray:
    """Return what the points of a beam met; canopy in patches."""
    patch = max(round(LASER.canopy_patch_m / max(spacing_m, 1.0)), 1)
    leaves = np.repeat(rng.random(count // patch + 2) < spec.canopy, patch)[rng.integers(0, patch) :][:count]
    return np.where(rng.random(count) < spec.clouds, CLOUD_HIT, np.where(leaves, CANOPY_HIT, GROUND_HIT))
