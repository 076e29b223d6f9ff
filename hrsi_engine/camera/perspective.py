"""Perspective cameras that replace an RPC over a small area, for programs that do not support RPCs.

The projection centre is far away: ``x w = p1 . X + p14``, ``y w = p2 . X + p24``, ``w = 1 + q e . X``, where e is the
unit vector of the viewing direction and ``1 / q`` the distance of the projection centre. With e known, this is linear
in the other nine unknowns. The decomposition of P into calibration and rotation has two focal lengths, the principal
point, and a skew of the pixel axes (Earth rotation during pushbroom scanning). Programs whose cameras have no skew get
images that are sheared accordingly: ``x' = x - shear (y - cy)``. Idea: Zhang, Snavely and Sun 2019, "Leveraging vision
reconstruction pipelines for satellite imagery".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..foundation.errors import InputError
from ..foundation.thresholds import threshold, thresholds


@thresholds
class PERSPECTIVE:
    """Limits for the distance of a perspective camera in orbit."""

    distance_m: tuple[float, ...] = threshold(
        (2e5, 2e7),
        "m",
        "smallest and largest distance of the projection centre, which pushbroom images lack along the track",
        "lowest orbit; affine",
    )


@dataclass(frozen=True, eq=False)
class PerspectiveCamera:
    """``x = K (R X + t)`` in pixels from the centre of the first pixel, for the sheared image.

    rotation (3, 3), translation (3,) : from the ground frame (m) to the camera frame: right, down, forward
    focal (2,), principal (2,) : px
    shear, left : ``x' = x - shear (y - principal[1]) - left`` in the sheared image
    """

    rotation: np.ndarray
    translation: np.ndarray
    focal: np.ndarray
    principal: np.ndarray
    shear: float
    left: float = 0.0

    def project(self, local: np.ndarray) -> np.ndarray:
        """Return sample, line ``(n, 2)`` in the sheared image of ground points ``(n, 3)``."""
        in_camera = local @ self.rotation.T + self.translation
        return np.asarray(in_camera[:, :2] / in_camera[:, 2:] * self.focal + self.principal)

    def shear_points(self, xy: np.ndarray) -> np.ndarray:
        """Return the positions ``(n, 2)`` in the sheared image of points ``(n, 2)`` of the image."""
        return np.column_stack([xy[:, 0] - self.shear * (xy[:, 1] - self.principal[1]) - self.left, xy[:, 1]])

    def begin_at(self, left: float) -> PerspectiveCamera:
        """Return the camera of the part of the sheared image from column ``left`` on."""
        return replace(self, left=self.left + left, principal=self.principal - [left, 0.0])


def fit_perspective_camera(local: np.ndarray, xy: np.ndarray, sight: np.ndarray) -> PerspectiveCamera:
    """Return the camera that fits the correspondences of ground points and pixels best (least squares).

    local : (n, 3) ground points distributed over the volume of interest, m; xy : (n, 2) their pixels
    sight : (3,) unit vector from the camera to the ground

    Raises `InputError` if the image is mirrored, since no camera with these parameters has a mirrored image.
    """
    extent = np.abs(local).max()
    scaled, depth = np.column_stack([local / extent, np.ones(len(local))]), local @ sight / extent
    empty = np.zeros_like(scaled)
    design = np.vstack(
        [np.column_stack([scaled, empty, -xy[:, 0] * depth]), np.column_stack([empty, scaled, -xy[:, 1] * depth])]
    )
    solution = np.linalg.lstsq(design, xy.T.ravel(), rcond=None)[0]
    nearest, farthest = PERSPECTIVE.distance_m
    inverse = float(np.clip(solution[8] / extent, 1.0 / farthest, 1.0 / nearest))
    solution = np.linalg.lstsq(design[:, :8], xy.T.ravel() - design[:, 8] * inverse * extent, rcond=None)[0]
    rows = solution.reshape(2, 4) / [extent, extent, extent, 1.0] / inverse  # the third row is (sight, 1 / inverse)
    principal = rows[:, :3] @ sight
    across, down = rows[:, :3] - principal[:, None] * sight
    focal_y = np.linalg.norm(down)
    down /= focal_y
    skew = across @ down
    across -= skew * down
    focal_x = np.linalg.norm(across)
    across /= focal_x
    if np.cross(across, down) @ sight < 0.0:
        raise InputError("a mirrored image has no perspective camera: hand its RPC over instead")
    distance = 1.0 / inverse
    y = (rows[1, 3] - principal[1] * distance) / focal_y
    x = (rows[0, 3] - principal[0] * distance - skew * y) / focal_x
    focal = np.array([focal_x, focal_y])
    return PerspectiveCamera(
        np.array([across, down, sight]), np.array([x, y, distance]), focal, principal, skew / focal_y
    )
