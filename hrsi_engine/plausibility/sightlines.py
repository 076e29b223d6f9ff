"""Rays of image points as straight lines: a ground point, and the slope east and north per metre of height.

Surveys are compared with rays on the ground, not in the image: localisation works wherever the survey lies, while
projection is meaningless far outside the RPC's domain. A survey with another height needs no new ray.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..block.block import Image, stack_of
from ..foundation.large_arrays import finite_rows
from ..ground.geodesy import ground_difference_m, metres_per_degree, wrap_degrees

NOWHERE_M = 2e7  # distance of a point without a ray: half round the Earth


@dataclass(frozen=True, eq=False)
class Sightlines:
    """Rays: a point ``ground (n, 3)`` of each, and ``slope (n, 2)`` in metres east, north per metre up."""

    ground: np.ndarray
    slope: np.ndarray

    def distance_m(self, surveyed: np.ndarray) -> np.ndarray:
        """Return metres east and north ``(n, 2)`` from surveyed points to their rays at the surveyed height."""
        difference = self.ground[:, :2] - surveyed[:, :2]
        difference[:, 0] = wrap_degrees(difference[:, 0])
        across = difference * metres_per_degree(self.ground)[:, :2]
        across += self.slope * (surveyed[:, 2] - self.ground[:, 2])[:, None]
        lost = ~finite_rows(across)
        across[lost] = NOWHERE_M
        return across

    def select(self, rows: np.ndarray) -> Sightlines:
        """Return some of the rays."""
        return Sightlines(self.ground[rows], self.slope[rows])

    def replace(self, rows: np.ndarray, others: Sightlines) -> Sightlines:
        """Return the rays with others at some rows (mask)."""
        ground, slope = self.ground.copy(), self.slope.copy()
        ground[rows], slope[rows] = others.ground, others.slope
        return Sightlines(ground, slope)


def compute_sightlines(images: Sequence[Image], image: np.ndarray, xy: np.ndarray) -> Sightlines:
    """Return the rays of image points ``xy (n, 2)`` on images by index ``(n,)``, over the RPC's height range."""
    if not len(xy):
        return Sightlines(np.empty((0, 3)), np.empty((0, 2)))
    rpcs = [one.rpc for one in images]
    stack = stack_of(images)
    middle, high = np.array([(rpc.height_off, rpc.height_range[1]) for rpc in rpcs])[image].T
    ground, upper = (stack.localize(image, xy, height) for height in (middle, high))
    return Sightlines(ground, ground_difference_m(upper, ground)[:, :2] / (high - middle)[:, None])
