"""Leaves of a network in polar coordinates about their root (thesis §3.3.2, fig. 3.5), and their tolerances.

Tolerances (thesis §3.3.4, eqs. 3.4-3.6): a ground distance ``s`` on a slope ``beta`` is seen by two sensors with
incidence angles ``theta1`` and ``theta2`` as ``s cos(theta1 - beta)`` and ``s cos(theta2 + beta)``. The difference
grows with the distance from the node of the network, so that the tolerance is that of a local maximum plus a share of
the distance.
"""

from typing import NamedTuple

import numpy as np

from ...foundation.thresholds import threshold, thresholds

#: Origin of what was tuned on the real pairs.
NETWORK_PAIRS = "real pairs, 2026-11-21 and 22 (docs/matching.md)"


@thresholds
class NETWORK:
    """Limits for leaves (points around a root) at predicted positions, and for the direction of a network."""

    radius_share: float = threshold(0.5, "", "tolerance over the radius of a maximum", "thesis 3.3.4: 2 px or less")
    shortest_arm_px: float = threshold(
        20.0, "px", "smallest distance of an ancestor that gives a direction (0.5 px is 1°)"
    )
    ancestors: int = threshold(8, "generations", "largest number to an ancestor for a direction")
    smoothing_px: float = threshold(0.7, "px", "sigma of the Gaussian before least-squares matching")


def compute_effective_distances(
    distance: np.ndarray | float, incidence_deg: tuple[float, float], slope_deg: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Return a ground distance on a slope as the two sensors see it (thesis eqs. 3.4 and 3.5), in its own unit."""
    first, second = np.radians(incidence_deg)
    slope = np.radians(slope_deg)
    return np.asarray(distance * np.cos(first - slope)), np.asarray(distance * np.cos(second + slope))


def compute_distance_difference(
    distance: np.ndarray | float, incidence_deg: tuple[float, float], slope_deg: np.ndarray | float
) -> np.ndarray:
    """Return by how much the two effective distances differ (thesis eq. 3.6), in the unit of ``distance``.

    For equal incidence angles that is ``2 s sin(theta) sin(beta)``.
    """
    first, second = compute_effective_distances(distance, incidence_deg, slope_deg)
    return first - second


class Tolerance(NamedTuple):
    """Allowed difference of position at a distance from the root: ``base_px + gradient * distance``."""

    base_px: float
    gradient: float

    def limit_px(self, distance_px: np.ndarray) -> np.ndarray:
        """Return the tolerance along the ray and, as an arc, of the angle: px."""
        return self.base_px + self.gradient * distance_px

    def limit_rad(self, distance_px: np.ndarray) -> np.ndarray:
        """Return the tolerance of the angle at a distance > 0, radians: the same arc as `limit_px`."""
        return self.limit_px(distance_px) / distance_px


def make_tolerance(radius_px: float, incidence_deg: tuple[float, float], slope_deg: float) -> Tolerance:
    """Return the tolerance for local maxima of a radius, incidence angles and the steepest slope, up or down."""
    up, down = (abs(float(compute_distance_difference(1.0, incidence_deg, sign * slope_deg))) for sign in (1.0, -1.0))
    return Tolerance(NETWORK.radius_share * radius_px, max(up, down))


class Leaves(NamedTuple):
    """Leaves of one root: rows (k,) into the point set, distances (k,) px and directions (k,) radians."""

    rows: np.ndarray
    distance_px: np.ndarray
    angle_rad: np.ndarray


def find_leaves(points: np.ndarray, root: int, reach_px: float) -> Leaves:
    """Return the other points ``(n, 2)`` within reach of a root, in the order of their indices."""
    offset = points - points[root]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    neighbours = np.flatnonzero((distance > 0.0) & (distance <= reach_px))
    return Leaves(neighbours, distance[neighbours], np.arctan2(offset[neighbours, 1], offset[neighbours, 0]))


def wrap_angle(angle_rad: np.ndarray) -> np.ndarray:
    """Return angles brought into [-pi, pi)."""
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi


def rotate_offset(offset: np.ndarray, rotation_rad: np.ndarray | float, scale: np.ndarray | float = 1.0) -> np.ndarray:
    """Return offsets ``(…, 2)`` turned from sample towards line and scaled."""
    cos, sin = scale * np.cos(rotation_rad), scale * np.sin(rotation_rad)
    return np.stack([cos * offset[..., 0] - sin * offset[..., 1], sin * offset[..., 0] + cos * offset[..., 1]], axis=-1)


def find_mutual_best(first: np.ndarray, second: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Return the indices ``(j,)`` of the candidate pairs ``(k,)`` that cost both their points least.

    Equal costs are settled by the lower numbers of the points.
    """
    order = np.lexsort((second, first, cost))
    best_of_first = np.unique(first[order], return_index=True)[1]
    best_of_second = np.unique(second[order], return_index=True)[1]
    return order[np.intersect1d(best_of_first, best_of_second, assume_unique=True)]
