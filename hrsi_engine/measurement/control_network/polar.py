"""Networks in polar coordinates: every leaf's distance from the root and direction (thesis §3.3.2, fig. 3.5)."""

from typing import NamedTuple

import numpy as np


class Leaves(NamedTuple):
    """Leaves of one root: rows (k,) into the point set, distances (k,) px and directions (k,) radians."""

    rows: np.ndarray
    distance_px: np.ndarray
    angle_rad: np.ndarray


def find_leaves(points: np.ndarray, root: int, reach_px: float) -> Leaves:
    """Return the other points ``(n, 2)`` within reach of a root, in the order of their indices."""
    offset = points - points[root]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    near = np.flatnonzero((distance > 0.0) & (distance <= reach_px))
    return Leaves(near, distance[near], np.arctan2(offset[near, 1], offset[near, 0]))


def wrap_angle(angle_rad: np.ndarray) -> np.ndarray:
    """Return angles brought into [-pi, pi)."""
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi


def rotate_offset(offset: np.ndarray, rotation_rad: np.ndarray | float, scale: np.ndarray | float = 1.0) -> np.ndarray:
    """Return offsets ``(…, 2)`` turned from sample towards line and scaled."""
    cos, sin = scale * np.cos(rotation_rad), scale * np.sin(rotation_rad)
    return np.stack([cos * offset[..., 0] - sin * offset[..., 1], sin * offset[..., 0] + cos * offset[..., 1]], axis=-1)
