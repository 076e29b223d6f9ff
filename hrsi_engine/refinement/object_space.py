"""Corrections of the ground coordinates (thesis eqs. 4.5 and 5.6; Di et al. 2003).

In metres east, north and up about the middle of the image, scaled by half its extent R to X = (E, N, U) / R::

    E' = E + c + M X         image = RPC(E')

with c the shift and M full (affine), diagonal (scale-shift) or absent (shift). The thesis corrects the ground positions
computed by an RPC; this is the inverse, of the same form. In one image a shift in height has the effect of one in
position: the priors assign it to the latter.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..block.block import Image
from ..foundation.thresholds import threshold, thresholds
from ..ground import ellipsoid
from ..ground.ellipsoid import Number, Triple
from ..ground.geodesy import LocalFrame
from .ground_area import compute_ground_area, compute_px_per_m
from .model import ALL_ROWS, Equations, Linearise, Priors, RefitRPC, RowIndex, Structure, refit_camera
from .model_table import OBJECT_SPACE_TABLE, make_models

GROUND_AXES = ("east", "north", "up")
UP = 2


@thresholds
class OBJECT_SPACE_PRIORS:
    """A priori standard deviations of corrections in object space."""

    height_share: float = threshold(
        0.1,
        "",
        "a priori standard deviation of corrections in height over those in position: an image determines "
        "corrections across its rays only, and without priors both grow along the rays beyond the validity range of "
        "the RPC",
        "thesis, SPOT 5 rotated by up to 100 mrad, and IKONOS, 2026-11-22",
    )


@dataclass(frozen=True, eq=False)
class GroundCorrection:
    """A correction model in object space.

    entries : (p, 2) corrected coordinate of each parameter, and its argument: 0 none (shift), 1 east, 2 north, 3 up
    """

    name: str
    title: str
    parameters: tuple[str, ...]
    entries: np.ndarray
    least_points: int

    @property
    def drifts(self) -> np.ndarray:
        """True for parameters that change the correction across an image, ``(p,)`` bool."""
        return np.asarray(self.entries[:, 1] != 0)

    def prior_sigmas(self, image: Image, priors: Priors) -> np.ndarray:
        """Return the prior of each parameter ``(p,)``, m: the shift, or the drift from the image's middle to its edge.

        Heights get a share of it if plan has the same terms: an image determines corrections across its rays only.
        """
        metres = 1.0 / float(compute_px_per_m([image])[0])
        drift = priors.drift * float(image.camera_half_size_px.max()) * metres
        sigma = np.where(self.entries[:, 1] == 0, priors.shift_px * metres, drift)
        up = self.entries[:, 0] == UP
        plan_does_it = {scale for axis, scale in self.entries.tolist() if axis != UP} >= set(
            self.entries[up, 1].tolist()
        )
        return np.where(up & plan_does_it, OBJECT_SPACE_PRIORS.height_share * sigma, sigma)

    def equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the observation equations; they do not depend on the observed positions."""
        constants = self.constants(image)[None]

        def linearise(values: np.ndarray, ground: np.ndarray) -> Equations:
            coefficients, terms = self.coefficients(values)[None], np.empty((len(ground), 4))
            lon, lat, height = ground.T
            shifted = move_position(constants, coefficients, 0, ellipsoid.geocentric(lon, lat, height), terms, ALL_ROWS)
            shift_ground = np.column_stack(ellipsoid.geodetic(*shifted)) if np.any(values) else ground
            computed, by_ground = image.rpc.project_with_metric_jacobian(shift_ground)
            by_frame = np.empty((len(ground), 2, 3))
            rotate_derivatives(
                constants,
                coefficients,
                0,
                corrected_axes=ellipsoid.axes(*shift_ground.T[:2]),
                given_axes=ellipsoid.axes(lon, lat),
                by_ground=by_ground,
                by_frame=by_frame,
                a=ALL_ROWS,
            )
            by_values = by_frame[:, :, self.entries[:, 0]] * terms[:, self.entries[:, 1]][:, None, :]
            return Equations(computed, by_values, by_ground)

        return linearise

    def constants(self, image: Image) -> np.ndarray:
        """Return the constants of an image ``(13,)``: axes (9) and origin (3) of its frame, half its extent R in m."""
        area = compute_ground_area(image)
        frame, reach = LocalFrame(*(float(value) for value in area.middle)), area.reach_m
        return np.concatenate([frame.axes.ravel(), frame.origin, [reach]])

    def coefficients(self, values: np.ndarray) -> np.ndarray:
        """Return c and M, ``(…, 3, 4)``, of values ``(…, p)``."""
        matrix = np.zeros((*values.shape[:-1], 3, 4))
        matrix[..., self.entries[:, 0], self.entries[:, 1]] = values
        return matrix

    @property
    def structure(self) -> Structure:
        """Kronecker structure of the derivatives by the parameters; a pure shift has only the term 1."""
        count, parameters = (4 if self.entries[:, 1].any() else 1), len(self.parameters)
        mixing = np.zeros((3, count, parameters))
        mixing[self.entries[:, 0], self.entries[:, 1], np.arange(parameters)] = 1.0
        return Structure(3, count, mixing.reshape(-1, parameters))

    def project(self, image: Image, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return the corrected projection ``(n, 2)`` of ``ground (n, 3)``, px, for parameter ``values (p,)``."""
        if not np.any(values):
            return image.rpc.project(ground)
        constants, coefficients = self.constants(image)[None], self.coefficients(values)[None]
        terms = np.empty((len(ground), 4))
        shifted = move_position(constants, coefficients, 0, ellipsoid.geocentric(*ground.T), terms, ALL_ROWS)
        return image.rpc.project(np.column_stack(ellipsoid.geodetic(*shifted)))

    def compute_refined_rpc(self, image: Image, values: np.ndarray) -> RefitRPC:
        """Return the refined RPC: a new one, fitted to the corrected camera."""
        return refit_camera(self, image, values)


def move_position(
    constants: np.ndarray, coefficients: np.ndarray, i: int, position: Triple[Number], terms: np.ndarray, a: RowIndex
) -> Triple[Number]:
    """Return geocentric positions corrected for image i, and write the terms 1, E/R, N/R, U/R.

    Shared by compiled loops and NumPy.

    constants : (images, 13); coefficients : (images, 3, 4) m
    position : geocentric x, y, z, m
    terms : (n, 1 or 4) output, the first terms; a : row, or all rows
    """
    c, m, reach = constants, coefficients, constants[i, 12]
    x, y, z = position[0] - c[i, 9], position[1] - c[i, 10], position[2] - c[i, 11]
    basis = (
        1.0,
        (c[i, 0] * x + c[i, 1] * y + c[i, 2] * z) / reach,
        (c[i, 3] * x + c[i, 4] * y + c[i, 5] * z) / reach,
        (c[i, 6] * x + c[i, 7] * y + c[i, 8] * z) / reach,
    )
    for k in range(terms.shape[1]):
        terms[a, k] = basis[k]
    x, y, z = position
    for k in range(3):
        correction = m[i, k, 0] + m[i, k, 1] * basis[1] + m[i, k, 2] * basis[2] + m[i, k, 3] * basis[3]
        x, y, z = x + c[i, 3 * k] * correction, y + c[i, 3 * k + 1] * correction, z + c[i, 3 * k + 2] * correction
    return x, y, z


def rotate_derivatives(
    constants: np.ndarray,
    coefficients: np.ndarray,
    i: int,
    corrected_axes: Any,
    given_axes: Any,
    by_ground: np.ndarray,
    by_frame: np.ndarray,
    a: RowIndex,
) -> None:
    """Transform derivatives by the corrected position to those by the frame's coordinates and by the given position.

    constants, coefficients, i : as in `move_position`
    corrected_axes, given_axes : geocentric unit vectors east, north, up at the corrected and at the given position
    by_ground : (n, 2, 3) px/m at the corrected position; overwritten by those at the given one
    by_frame : (n, 2, 3) output, derivatives by the frame's east, north, up; a : row, or all rows
    """
    c, reach = constants, constants[i, 12]
    for row in range(2):
        e, n, u = by_ground[a, row, 0], by_ground[a, row, 1], by_ground[a, row, 2]
        x = e * corrected_axes[0][0] + n * corrected_axes[1][0] + u * corrected_axes[2][0]
        y = e * corrected_axes[0][1] + n * corrected_axes[1][1] + u * corrected_axes[2][1]
        z = e * corrected_axes[0][2] + n * corrected_axes[1][2] + u * corrected_axes[2][2]
        f0 = c[i, 0] * x + c[i, 1] * y + c[i, 2] * z
        f1 = c[i, 3] * x + c[i, 4] * y + c[i, 5] * z
        f2 = c[i, 6] * x + c[i, 7] * y + c[i, 8] * z
        by_frame[a, row, 0], by_frame[a, row, 1], by_frame[a, row, 2] = f0, f1, f2
        for k in range(3):
            # dE' by E is I + M / R, whose rows are those of the frame
            m0, m1, m2 = coefficients[i, 0, k + 1], coefficients[i, 1, k + 1], coefficients[i, 2, k + 1]
            additional = (f0 * m0 + f1 * m1 + f2 * m2) / reach
            x, y, z = x + additional * c[i, 3 * k], y + additional * c[i, 3 * k + 1], z + additional * c[i, 3 * k + 2]
        for k in range(3):
            by_ground[a, row, k] = x * given_axes[k][0] + y * given_axes[k][1] + z * given_axes[k][2]


def _correction(name: str, title: str, entries: list[tuple[int, int]], least_points: int) -> GroundCorrection:
    names = tuple(f"{GROUND_AXES[axis]}_{('0', *GROUND_AXES)[quantity]}" for axis, quantity in entries)
    return GroundCorrection(name, title, names, np.array(entries), least_points)


OBJECT_SPACE = make_models(OBJECT_SPACE_TABLE, {"correction": _correction})
