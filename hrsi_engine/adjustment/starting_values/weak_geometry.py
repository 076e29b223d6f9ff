"""The constraint of a point's height: its survey, a DEM, its rays, or only the height range of the RPCs.

Rays that determine a height within the RPC's range get no prior: thousands of priors together would pull the whole
block to the middle of that range. Only points on more parallel rays get a prior there.
"""

from collections.abc import Sequence

import numpy as np

from ...block.block import Image, stack_rpcs
from ...foundation.errors import list_ids
from ...foundation.thresholds import threshold, thresholds
from ...refinement.ground_area import compute_px_per_m
from ...surface.dem import HeightSurface, surface_heights
from ..equations import PointPriors
from ..observations import Observations

BASE_DIRECTIONS = 16  # of the base in plan, of which the largest is within 0.5 %


@thresholds
class RAY_GEOMETRY:
    """Limit for rays that determine a height."""

    weak_angle_deg: float = threshold(3.0, "°", "smallest convergence angle for a reliable height", "1 / tan 3° = 19")


def compute_ray_directions(images: Sequence[Image]) -> np.ndarray:
    """Return unit vectors ``(images, 3)`` east, north, up of the rays at the images' centres.

    Across a scene the direction changes by at most a degree.
    """
    stack = stack_rpcs(images)
    _, by_ground = stack.project_with_metric_jacobian(np.arange(len(images)), stack.middles())
    ray = np.cross(by_ground[:, 0], by_ground[:, 1])
    return np.asarray(ray * np.sign(ray[:, 2:]) / np.linalg.norm(ray, axis=1, keepdims=True))


def compute_base_to_height(images: Sequence[Image]) -> float:
    """Return the largest base-to-height ratio of images: the distance of their rays at unit height."""
    direction = compute_ray_directions(images)
    angle = np.arange(BASE_DIRECTIONS) * (np.pi / BASE_DIRECTIONS)
    across = direction[:, :2] / direction[:, 2:] @ np.stack([np.cos(angle), np.sin(angle)])
    return float(np.ptp(across, axis=0).max())


def set_point_priors(
    observations: Observations, ground: np.ndarray, dem: HeightSurface | None, sigma_dem_m: float | None
) -> tuple[PointPriors, list[str]]:
    """Return the points' priors and warnings of weak geometry; ``ground (m, 3)`` are the initial positions."""
    image, pixels_per_m = observations.image[observations.first[:-1]], compute_px_per_m(observations.images)
    priors = PointPriors.from_surveys(observations, ground)
    unknown = observations.survey_weight[:, 2] == 0.0
    if dem is not None and sigma_dem_m is not None:
        heights = np.full(len(ground), np.nan)
        heights[unknown] = surface_heights(dem, ground[unknown, :2])
        has_height = np.isfinite(heights)
        priors.target[has_height, 2], priors.weight[has_height, 2] = heights[has_height], 1.0 / sigma_dem_m**2
        priors.observed[has_height, 2] = True
        unknown &= ~has_height
    # The largest angle between rays of each point, twice the largest from their mean, (m,)
    first = observations.first[:-1]
    ray_direction = compute_ray_directions(observations.images)[observations.image]
    mean = np.add.reduceat(ray_direction, first, axis=0)
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    cosine = np.einsum("ni,ni->n", ray_direction, mean[observations.point])
    converging = 2.0 * np.degrees(np.arccos(np.clip(np.minimum.reduceat(cosine, first), -1.0, 1.0)))
    weak = unknown & (converging < RAY_GEOMETRY.weak_angle_deg) & (np.diff(observations.first) > 1)
    if not weak.any():
        return priors, []
    reach = np.array([abs(one.rpc.height_scale) for one in observations.images])[image]
    pixels = pixels_per_m[image] * np.radians(converging) * reach
    open_height = weak & (pixels < 1.0)
    middle = np.array([one.middle_height_m for one in observations.images])[image]
    surveyed_heights = observations.survey[observations.survey_weight[:, 2] > 0.0, 2]
    priors.target[open_height, 2] = np.median(surveyed_heights) if len(surveyed_heights) else middle[open_height]
    priors.weight[open_height, 2] = 1.0 / reach[open_height] ** 2
    # Warn of images most of whose points have uncertain or no heights
    warnings, count = [], len(observations.images)
    all_points = np.maximum(np.bincount(observations.image, minlength=count), 1)
    by_range = "moves a pixel over the height range of the RPC: the heights of these points follow from the RPC height"
    uncertain = f"{RAY_GEOMETRY.weak_angle_deg:g} degrees: the heights of these points are uncertain"
    for points, consequence in ((open_height, f"{by_range} range only"), (weak & ~open_height, uncertain)):
        share = np.bincount(observations.image[points[observations.point]], minlength=count) / all_points
        images = [observations.images[index].id for index in np.flatnonzero(share > 0.5)]
        if images:
            warnings.append(
                f"most rays of image {list_ids(images)} converge by less than {consequence}; name a DEM to constrain "
                "them"
            )
    return priors, warnings
