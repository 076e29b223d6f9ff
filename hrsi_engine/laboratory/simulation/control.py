"""Points of a simulated block: where they are, which cameras see them, and how they are measured with errors.

Surveyed points are placed as a surveyor would: far from each other, on gentle ground, on two images where there are
two. Tie points fill every image evenly. Whether a point is visible in an image is decided by its own ray: the point is
projected, the ray of that image position is followed to the terrain, and a mountain in between hides the point. Errors
are normal with the standard deviations of `Noise`, except for the blunders, which are marked in the truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...block.block import GroundPoints, ImagePoints, Role
from ...block.columns import Columns
from ...foundation.errors import InputError
from .options import Noise
from .pushbroom import PushbroomCamera
from .surface import locate_on_surface
from .terrain import TerrainSurface
from .world import constant, constants


@constants
class CONTROL_PLACES:
    """Limits for the positions of surveyed points."""

    empty_border: float = constant(0.03, "", "margin of an image without points, relative to its size")
    steepest: float = constant(0.35, "", "largest slope at a surveyed point")


@dataclass(frozen=True, eq=False)
class TrueImagePoints(Columns):
    """Exact image points: ``point`` and ``image`` are indices, ``(n,)``; ``xy`` is sample, line ``(n, 2)``."""

    point: np.ndarray
    image: np.ndarray
    xy: np.ndarray


# ---- positions -------------------------------------------------------------------------------------------------


def project_true_points(
    cameras: Sequence[PushbroomCamera], terrain: TerrainSurface, ground: np.ndarray
) -> TrueImagePoints:
    """Return the image points of ground points on the terrain's surface, where they are inside and not hidden."""
    visible = []
    chart_m = terrain.chart.from_ground(ground)
    for index, camera in enumerate(cameras):
        # Indices of the positions within the upright rectangle around a camera's footprint
        samples, lines = (size - 1.0 for size in camera.size)
        rim = np.array([[s * samples, t * lines] for s in (0.0, 0.5, 1.0) for t in (0.0, 0.5, 1.0)])
        corners = np.concatenate(
            [terrain.chart.from_ground(camera.image_to_ground(rim, height)) for height in terrain.height_range]
        )
        spare = 0.05 * np.ptp(corners, axis=0)
        low, high = corners.min(axis=0) - spare, corners.max(axis=0) + spare
        rows = np.flatnonzero(((chart_m >= low) & (chart_m <= high)).all(axis=1))
        position = camera.ground_to_image(ground[rows])
        with np.errstate(invalid="ignore"):
            inside = ((position >= 0.0) & (position <= np.array(camera.size) - 1.0)).all(axis=1)
        rows, position = rows[inside], position[inside]
        if rows.size:
            ground_m = terrain.chart.from_ground(locate_on_surface(camera, terrain, position))
            clear = np.hypot(*(ground_m - chart_m[rows]).T) < 0.5 * terrain.post_m
            rows, position = rows[clear], position[clear]
        visible.append((rows, np.full(rows.size, index), position))
    return TrueImagePoints(*(np.concatenate(parts) for parts in zip(*visible, strict=True)))


def _draw_candidates(
    cameras: Sequence[PushbroomCamera], terrain: TerrainSurface, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Return ground points on the surface, about ``count`` an image, evenly spread over each image."""
    candidates = []
    side = int(np.ceil(np.sqrt(count)))
    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    for camera in cameras:
        share = (
            CONTROL_PLACES.empty_border
            + (1.0 - 2.0 * CONTROL_PLACES.empty_border) * (cells + rng.random(cells.shape)) / side
        )
        image = share * (np.array(camera.size) - 1.0)
        ground = locate_on_surface(camera, terrain, image)
        # To a millimetre: the last bits of a ray depend on where arrays lie in memory, and a seed is to give one block.
        ground[:, :2] = ground[:, :2].round(8)
        ground[:, 2] = terrain.height_at(ground)
        candidates.append(rng.permutation(ground[~np.isnan(ground).any(axis=1)])[:count])
    return np.concatenate(candidates)


def _has_enough_views(
    cameras: Sequence[PushbroomCamera], terrain: TerrainSurface, ground: np.ndarray, border: float
) -> np.ndarray:
    """Return the points that two cameras see (one, where there is only one camera)."""
    projected = project_true_points(cameras, terrain, ground)
    sizes = np.array([camera.size for camera in cameras], dtype=np.float64)[projected.image]
    inner = ((projected.xy > border * sizes) & (projected.xy < (1.0 - border) * sizes)).all(axis=1)
    views = np.bincount(projected.point[inner], minlength=len(ground))
    return ground[views >= min(2, len(cameras))]


def place_control(
    cameras: Sequence[PushbroomCamera], terrain: TerrainSurface, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Return ``count`` surveyed points ``(count, 3)``, far from each other and on gentle ground.

    Raises `InputError` where the cameras do not see so many places in common.
    """
    if count == 0:
        return np.empty((0, 3))
    pool = _has_enough_views(
        cameras,
        terrain,
        _draw_candidates(cameras, terrain, 12 * count // len(cameras) + 40, rng),
        CONTROL_PLACES.empty_border,
    )
    # The steepest slope within two posts of each point
    east, north = terrain.chart.from_ground(pool).T
    reach = 2.0 * terrain.post_m
    neighbours = [
        np.abs(terrain.height(east + reach * np.sin(a), north + reach * np.cos(a)) - pool[:, 2]) / reach
        for a in np.arange(8) * np.pi / 4.0
    ]
    slopes = np.max(neighbours, axis=0) if len(pool) else np.empty(0)
    pool = pool[slopes < CONTROL_PLACES.steepest]
    _require_points(len(pool), count, "surveyed points")
    # Indices of points each of which is the farthest from those before it
    positions = terrain.chart.from_ground(pool)
    selected = [int(np.argmin(np.hypot(*(positions - positions.mean(axis=0)).T)))]
    nearest = np.hypot(*(positions - positions[selected[0]]).T)
    while len(selected) < count:
        selected.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.hypot(*(positions - positions[selected[-1]]).T))
    return pool[np.array(selected)]


def place_ties(
    cameras: Sequence[PushbroomCamera], terrain: TerrainSurface, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Return ``count`` tie points ``(count, 3)``; raises `InputError` where the images do not overlap."""
    if count == 0:
        return np.empty((0, 3))
    per_image = int(np.ceil(1.6 * count / len(cameras))) + 20
    for _ in range(4):
        pool = _has_enough_views(cameras, terrain, _draw_candidates(cameras, terrain, per_image, rng), 0.0)
        if len(pool) >= count:
            break
        per_image *= 4
    _require_points(len(pool), count, "tie points")
    return rng.permutation(pool)[:count]


def _require_points(count: int, required: int, kind: str) -> None:
    if count < required:
        raise InputError(
            f"only {count} of {required} {kind} find a place that the images see in common: "
            "bring the views closer together or ask for fewer points"
        )


# ---- measurements ----------------------------------------------------------------------------------------------


def survey_points(
    ids: np.ndarray, ground: np.ndarray, role: np.ndarray, noise: Noise, per_metre: np.ndarray, rng: np.random.Generator
) -> tuple[GroundPoints, np.ndarray]:
    """Return surveyed positions of known points with errors, and the mask of GCPs with a wrong height.

    ``per_metre`` is ``(n, 3)``: degrees, degrees and metres per metre east, north and up.
    """
    error = rng.standard_normal((len(ids), 3)) * [noise.gcp_xy_m, noise.gcp_xy_m, noise.gcp_h_m]
    control = role == Role.GCP
    is_wrong = np.zeros(len(ids), dtype=bool)
    is_wrong[np.flatnonzero(control)[: round(noise.wrong_heights * control.sum())]] = True
    is_wrong[control] = rng.permutation(is_wrong[control])
    error[is_wrong, 2] += rng.choice([-1.0, 1.0], is_wrong.sum()) * noise.wrong_height_m
    sigma = np.array([max(noise.gcp_xy_m, 0.01), max(noise.gcp_h_m, 0.01)])
    return GroundPoints(ids.tolist(), ground + error * per_metre, role, sigma, "simulation"), is_wrong


def measure_points(
    ids: np.ndarray,
    role: np.ndarray,
    image_ids: np.ndarray,
    truth: TrueImagePoints,
    noise: Noise,
    rng: np.random.Generator,
) -> tuple[ImagePoints, np.ndarray]:
    """Return image measurements with errors, and the mask of those that are blunders."""
    xy = truth.xy + noise.image_px * rng.standard_normal(truth.xy.shape)
    share = np.zeros(len(truth.point))
    share[role[truth.point] == Role.TIE] = noise.blunders
    share[role[truth.point] == Role.GCP] = noise.gcp_blunders
    blunder = rng.random(len(truth.point)) < share
    direction = rng.uniform(0.0, 2.0 * np.pi, int(blunder.sum()))
    size = noise.blunder_px * rng.uniform(0.5, 1.5, int(blunder.sum()))
    xy[blunder] += size[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    kind = np.where(role[truth.point] == Role.TIE, "", "center")
    return (
        ImagePoints(
            ids=ids[truth.point].tolist(),
            image_ids=image_ids[truth.image].tolist(),
            xy=xy,
            sigma_px=max(noise.image_px, 0.01),
            kind=kind,
            quality=1.0,
            source="simulation",
        ),
        blunder,
    )
