"""Do two or three GCPs of a part agree with one another, after a shift of each image and the drift of its sensor?

Ties make no statement about a block's scale, rotation and place, and two or three GCPs leave these little or no
redundancy: one that is wrong bends the block, and everything fits. Between two of them the shift of an image cancels::

    d = (observed - vendor's camera)_a - (observed - vendor's camera)_b      variance: surveys, measurements, drift

where the drift is what is known of the sensor, over the distance of the two in the image. Beyond chance one is wrong,
or the image is distorted; the data do not show which, and predictions have to contain it.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy import special

from ..block.pointing import estimate_pointing
from ..foundation.thresholds import threshold, thresholds
from .gauss_newton import Solution
from .problem import Part, Problem
from .result import GcpsApart


@thresholds
class FEW_GCPS:
    """When few GCPs disagree."""

    most: int = threshold(3, "GCPs", "of a part: with more, data snooping finds the wrong one")
    risk: float = threshold(1e-4, "", "error probability of the test of two GCPs on an image", "theory: chi²")


def compare_few_gcps(problem: Problem, solution: Solution, part: Part) -> GcpsApart | None:
    """Return the two GCPs of a part that disagree most, None where they agree or are more than few."""
    observations = problem.observations
    located = (observations.survey_weight > 0.0).all(axis=1) & solution.weighting.contributes
    used = located[observations.point] & (solution.weight > 0.0) & np.isin(observations.image, part.images)
    if not 2 <= len(np.unique(observations.point[used])) <= FEW_GCPS.most:
        return None
    ids, worst, least = problem.block.points.ids[observations.points], None, special.chdtri(2.0, FEW_GCPS.risk)
    for index in part.images.tolist():
        image, rows = observations.images[index], np.flatnonzero(used & (observations.image == index))
        points = observations.point[rows]
        projected, by_ground = image.rpc.project_with_metric_jacobian(observations.survey[points])
        miss, drift = observations.xy[rows] - projected, estimate_pointing(image).drift
        covariance = (by_ground / observations.survey_weight[points][:, None, :]) @ by_ground.swapaxes(1, 2)
        covariance += observations.sigma_px[rows, None, None] ** 2 * np.eye(2)
        for a, b in combinations(range(len(rows)), 2):
            apart, stated = miss[a] - miss[b], covariance[a] + covariance[b]
            by_drift = (drift * np.hypot(*(observations.xy[rows[a]] - observations.xy[rows[b]]))) ** 2 * np.eye(2)
            squares = float(apart @ np.linalg.solve(stated + by_drift, apart))
            if squares > least:
                metres = float(np.hypot(*np.linalg.solve(by_ground[a][:, :2], apart)))
                factor = float(np.sqrt(apart @ np.linalg.solve(stated, apart) / 2.0))
                names = str(ids[points[a]]), str(ids[points[b]])
                least, worst = squares, GcpsApart(names, image.id, metres, float(np.sqrt(squares)), factor)
    return worst
