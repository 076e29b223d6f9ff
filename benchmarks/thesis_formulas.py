"""The thesis's generic method exactly as printed: equations 4.10 to 4.17, for one image.

The engine's generic models turn rays in space and put the pseudo sensor where the rays of a line meet. The thesis has
angles of a ray in the vertical planes through the map's axes, and adds corrections to them:

    x = (Xs + dX + (Hs + dH - h) tan(psi_x + dpsi_x)) cos(dpsi_z) + (Ys + dY + …) sin(dpsi_z)

so that a correction of 1 mrad moves a ray that is 17 degrees off nadir by 9 % more than a vertical one. Among GCPs that
makes a difference in the third digit; with one GCP and an error of yaw it makes one in the second (table 4.9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyproj
from scipy.optimize import least_squares

from hrsi.benchmarks.spot5 import SIZE, UTM
from hrsi.hrsi_engine.laboratory.simulation import PushbroomCamera
from hrsi.hrsi_engine.refinement.estimate import Control

HEIGHTS_M = (0.0, 500.0)  # of the two points that span a pseudo ray
SENSOR_HEIGHT_M = 827e3  # of the pseudo sensor; the thesis: "e.g. 600 km"
X, Y, HEIGHT, PSI_X, PSI_Y, PSI_Z = range(6)
UNITS = np.array([1e3, 1e3, 1e3, 1e-3, 1e-3, 1e-3])


@dataclass(frozen=True)
class Formulas:
    """The method on one image; `corrections` (6, 3): constant, by sample, by line, of X, Y, H, psi_x, psi_y, psi_z."""

    camera: PushbroomCamera
    corrections: np.ndarray

    def to_map(self, image: np.ndarray, height_m: np.ndarray) -> np.ndarray:
        """Return where the corrected rays of image points (n, 2) meet heights (n,), easting and northing (n, 2)."""
        low, high = (to_map(self.camera.image_to_ground(image, height)) for height in HEIGHTS_M)
        slope = -(high - low) / (HEIGHTS_M[1] - HEIGHTS_M[0])  # tangents of psi_x and psi_y
        sensor = low - slope * (SENSOR_HEIGHT_M - HEIGHTS_M[0])
        half = np.array(SIZE) / 2.0
        terms = np.column_stack([np.ones(len(image)), (image - half) / half])
        d_x, d_y, d_h, d_psi_x, d_psi_y, d_psi_z = (terms @ self.corrections.T).T
        above = SENSOR_HEIGHT_M + d_h - height_m
        east = sensor[:, 0] + d_x + above * np.tan(np.arctan(slope[:, 0]) + d_psi_x)
        north = sensor[:, 1] + d_y + above * np.tan(np.arctan(slope[:, 1]) + d_psi_y)
        cos, sin = np.cos(d_psi_z), np.sin(d_psi_z)
        return np.column_stack([east * cos + north * sin, -east * sin + north * cos])

    def residuals(self, points: Control) -> np.ndarray:
        """Return observed - computed (n, 2) px; computed: whose corrected rays hit the ground points, by Newton."""
        target, height = to_map(points.ground), points.ground[:, 2]
        image = points.xy.copy()
        for _ in range(20):
            miss = self.to_map(image, height) - target
            change = [self.to_map(image + step, height) - target - miss for step in np.eye(2)]
            move = np.linalg.solve(np.stack(change, axis=2), miss[..., None])[..., 0]
            image = image - move
            if np.abs(move).max() < 1e-6:
                break
        return np.asarray(points.xy - image)


def to_map(ground: np.ndarray) -> np.ndarray:
    """Return eastings and northings (n, 2) of longitudes and latitudes."""
    transformer = pyproj.Transformer.from_crs(4326, UTM, always_xy=True)
    return np.column_stack(transformer.transform(ground[:, 0], ground[:, 1]))


def estimate(camera: PushbroomCamera, control: Control, rounds: Sequence[Sequence[int]], linear: bool) -> Formulas:
    """Return the method with the corrections estimated from GCPs, one round of parameters after the other.

    The thesis: "we solve these parameters in the following order": the angles, then the position; with fewer than three
    GCPs constants only. ``linear`` adds the terms in sample and line.
    """
    found = Formulas(camera, np.zeros((6, 3)))
    for rows in rounds:
        free = np.zeros((6, 3), dtype=bool)
        free[list(rows), : 3 if linear else 1] = True
        found = _solve(found, free, control)
    return found


def _solve(before: Formulas, free: np.ndarray, control: Control) -> Formulas:
    target, height = to_map(control.ground), control.ground[:, 2]
    units = np.broadcast_to(UNITS[:, None], free.shape)[free]

    def apply(values: np.ndarray) -> Formulas:
        corrections = before.corrections.copy()
        corrections[free] += values * units
        return Formulas(before.camera, corrections)

    def miss(values: np.ndarray) -> np.ndarray:
        return np.asarray(apply(values).to_map(control.xy, height) - target).ravel()

    return apply(least_squares(miss, np.zeros(len(units)), x_scale="jac", xtol=1e-12, ftol=1e-12).x)


def residuals_of_checks(camera: PushbroomCamera, control: Control, check: Control) -> np.ndarray:
    """Return the residuals (n, 2) px of check points: angles, then positions, linear from three GCPs on."""
    return estimate(camera, control, ((PSI_X, PSI_Y), (X, Y)), len(control) >= 3).residuals(check)
