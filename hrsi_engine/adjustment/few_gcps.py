"""Do two or three GCPs of a part agree with one another, after a shift of each image and the drift of its sensor?

Ties make no statement about a block's scale, rotation and place, and two or three GCPs leave these little or no
redundancy: one that is wrong bends the block, and everything fits. Between two of them the shift of an image cancels::

    d = (observed - vendor's camera)_a - (observed - vendor's camera)_b      variance: surveys, measurements, drift

where the drift is what is known of the sensor, over the distance of the two in the image. A point that is wrong on
the ground is off alike in all images, whose drifts are independent: three images that would each have to drift by 3
sigma tell more than one. Beyond chance one GCP is wrong, or the images are distorted; the data do not show which, and
predictions have to contain it.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy import special

from ..block.block import Image
from ..block.pointing import estimate_pointing
from ..foundation.thresholds import threshold, thresholds
from .gauss_newton import Solution
from .problem import Part, Problem
from .result import GcpsApart


@thresholds
class FEW_GCPS:
    """When few GCPs disagree."""

    most: int = threshold(3, "GCPs", "of a part: with more, data snooping finds the wrong one")
    risk: float = threshold(1e-4, "", "error probability of the test of two GCPs on their images", "theory: chi²")


def compare_few_gcps(problem: Problem, solution: Solution, part: Part) -> GcpsApart | None:
    """Return the two GCPs of a part that disagree most, None where they agree or are more than few."""
    observations = problem.observations
    located = (observations.survey_weight > 0.0).all(axis=1) & solution.weighting.contributes
    used = located[observations.point] & (solution.weight > 0.0) & np.isin(observations.image, part.images)
    points = np.unique(observations.point[used])
    if not 2 <= len(points) <= FEW_GCPS.most:
        return None
    found = [_compare_pair(problem, used, list(pair)) for pair in combinations(points.tolist(), 2)]
    excess, worst = max(found, key=lambda one: one[0])
    return worst if excess > 1.0 else None


def _compare_pair(problem: Problem, used: np.ndarray, pair: list[int]) -> tuple[float, GcpsApart | None]:
    """Return chi² of the difference of two points on the images that see both, over its limit, and that difference."""
    observations = problem.observations
    images: list[Image] = []
    apart: list[np.ndarray] = []
    slopes: list[np.ndarray] = []
    noise: list[float] = []  # variances of the two coordinates of each image
    drifts: list[float] = []
    for index in np.unique(observations.image[used]).tolist():
        both = [np.flatnonzero(used & (observations.image == index) & (observations.point == point)) for point in pair]
        if not all(map(len, both)):
            continue
        image, rows = observations.images[index], [of_point[0] for of_point in both]
        projected, by_ground = image.rpc.project_with_metric_jacobian(observations.survey[pair])
        images.append(image)
        apart.append(np.subtract(*(observations.xy[rows] - projected)))
        slopes.append(by_ground)
        noise += [np.sum(observations.sigma_px[rows] ** 2)] * 2
        drifts += [(estimate_pointing(image).drift * np.hypot(*np.subtract(*observations.xy[rows]))) ** 2] * 2
    if not images:
        return 0.0, None
    slope = np.concatenate(slopes, axis=1)  # (2, 2 images, 3)
    stated = np.diag(noise) + np.sum((slope / observations.survey_weight[pair][:, None]) @ slope.swapaxes(1, 2), axis=0)
    difference = np.concatenate(apart)
    covariance = stated + np.diag(drifts)
    moved = np.linalg.solve(covariance, slope[0]).T  # a point moved on the ground: all images see it alike
    by_ground = float(moved @ difference @ np.linalg.pinv(moved @ slope[0]) @ moved @ difference)
    blocks = [slice(2 * k, 2 * k + 2) for k in range(len(images))]  # or measured wrongly on one of them
    alone = max(float(difference[k] @ np.linalg.solve(covariance[k, k], difference[k])) for k in blocks)
    excess = max(one / special.chdtri(freedom, FEW_GCPS.risk) for one, freedom in ((by_ground, 3.0), (alone, 2.0)))
    factor = float(np.sqrt(difference @ np.linalg.solve(stated, difference) / len(difference)))
    worst = int(np.argmax(np.linalg.norm(apart, axis=1)))
    metres = float(np.hypot(*np.linalg.solve(slopes[worst][0][:, :2], apart[worst])))
    name_a, name_b = (str(problem.block.points.ids[observations.points[point]]) for point in pair)
    told = GcpsApart((name_a, name_b), images[worst].id, metres, float(np.sqrt(max(by_ground, alone))), factor)
    return float(excess), told
