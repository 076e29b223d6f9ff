"""The generic method: corrections of a pseudo sensor's position and attitude (thesis eqs. 4.10-4.23, 5.7-5.41).

With the pseudo rays of `pseudo_rays` (X along the samples, z up) the corrected ray of an image point is at height z::

    t = tangents of the ray's direction, rotated by dpsi_x (roll), dpsi_y (pitch) and dyaw at the sensor
    X = Xs + dXs + (H + dH - z) t_x              x =  X cos(dpsi_z) + Y sin(dpsi_z)
    Y = Ys + dYs + (H + dH - z) t_y              y = -X sin(dpsi_z) + Y cos(dpsi_z)

and each correction is a constant or ``a0 + aS u + aL v`` with (u, v) the image position centred and scaled to [-1, 1]
(eqs. 4.18-4.23). Two formulas differ from the thesis, both below a hundredth of a pixel for errors of 1 mrad and worth
several pixels at 0.1 rad. Directions are transformed by rotation matrices, whereas the thesis adds angles to psi_x and
psi_y separately. And yaw has its own correction: the thesis's psi_z rotates the sensor's position with its direction
about the middle of the image, while a yaw error of the sensor does not move the orbit. So yaw has the constant, and
psi_z has drifts only.

Position and attitude are nearly collinear; all corrections are estimated together, constrained by prior standard
deviations (the diagonal of C_A, eq. 5.46): loose for the constants, tight for the drifts. So dH, dpsi_z and dyaw can
also be estimated with few GCPs; the thesis omits them below 50.

The observation equation in metres, (x, y)(image point, values, z) = ground, is converted to pixels by Newton steps
towards the corrected camera's projection. `pseudo_rays.linearise_by_rays` takes two of them; `project` iterates to
convergence, with the ray of each new position. Both compute image -> ray -> ground, because with a large attitude error
the ground is outside the area in which the vendor's RPC is accurate.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..block.block import Image
from ..camera.rpc_fit import CHECK_GRID, FIT, best_fit, make_image_grid
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import EQUALITY, ITERATIONS
from ..ground import ellipsoid
from .ground_area import compute_ground_area, compute_px_per_m
from .model import ALL_ROWS, Equations, Linearise, Orientation, Priors, RefitRPC, Structure
from .model_table import PSEUDO_SENSOR_TABLE, make_models
from .pseudo_rays import compute_sensor_frame, intersect_frame_height, linearise_by_rays, rays_of_image

#: The corrected quantities; the first three are in metres, the others in radians.
QUANTITIES = ("xs", "ys", "hs", "psi_x", "psi_y", "yaw", "psi_z")
YAW, PSI_Z = 5, 6  # indices in QUANTITIES


@dataclass(frozen=True, eq=False)
class PseudoSensor:
    """A variant of the generic method.

    terms : (p, 2) quantity of each parameter, and its term: 0 constant, 1 sample, 2 line
    least_points : fewest GCPs; parameters that they do not determine follow from their priors
    drift_factor : factor of the drifts' prior standard deviations
    """

    name: str
    title: str
    parameters: tuple[str, ...]
    terms: np.ndarray
    least_points: int
    drift_factor: float = 1.0

    @property
    def drifts(self) -> np.ndarray:
        """True for parameters that change the correction across the image (also constant yaw), ``(p,)`` bool."""
        return np.asarray((self.terms[:, 1] != 0) | (self.terms[:, 0] == YAW))

    def prior_sigmas(self, image: Image, priors: Priors) -> np.ndarray:
        """Return the priors of the parameters (m, rad); drifts are changes from the image's centre to its edge."""
        reach_m, orientation = compute_ground_area(image).reach_m, priors.orientation
        if orientation is None:  # the position and attitude errors that correspond to the priors in pixels
            metres, height = 1.0 / float(compute_px_per_m([image])[0]), compute_sensor_frame(image).heights_m[1]
            shift, change = priors.shift_px * metres, priors.drift * float(image.camera_half_size_px.max()) * metres
            orientation = Orientation(shift, shift / height, change, change / height, reach_m)
        share = self.drift_factor * reach_m / orientation.reach_m
        position, drift = orientation.position_m, share * orientation.position_drift_m
        angle, angle_drift = orientation.attitude_rad, share * orientation.attitude_drift_rad
        table = np.array([[position, drift, drift]] * 3 + [[angle, angle_drift, angle_drift]] * 4)
        return table[self.terms[:, 0], self.terms[:, 1]]

    def equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the observation equations; the rays of the observed positions are computed here, once."""
        constants = self.constants(image)[None]
        rays = rays_of_image(image, observed_px)
        structure, quantities = self.structure, self.used

        def linearise(values: np.ndarray, ground: np.ndarray) -> Equations:
            count = len(ground)
            computed, by_ground = np.empty((count, 2)), np.empty((count, 2, 3))
            by_quantity, terms = np.empty((count, 2, len(quantities))), np.empty((count, structure.terms))
            lon, lat, height = ground.T
            linearise_by_rays(
                quantities,
                constants,
                self.coefficients(values)[None],
                i=0,
                rays=rays,
                xy=observed_px,
                row=ALL_ROWS,
                position=ellipsoid.geocentric(lon, lat, height),
                axes=ellipsoid.axes(lon, lat),
                computed=computed,
                by_ground=by_ground,
                by_quantity=by_quantity,
                terms=terms,
                a=ALL_ROWS,
            )
            by_coefficient = by_quantity[:, :, :, None] * terms[:, None, None, :]
            by_coefficient = by_coefficient.reshape(count, 2, len(quantities) * structure.terms)
            return Equations(computed, by_coefficient @ structure.mixing, by_ground)

        return linearise

    def constants(self, image: Image) -> np.ndarray:
        """Return the constants of an image for `linearise_by_rays` ``(19,)``: `SensorFrame.constants`."""
        return compute_sensor_frame(image).constants

    def coefficients(self, values: np.ndarray) -> np.ndarray:
        """Return a0, aS, aL of the corrections, ``(…, 7, 3)``, of values ``(…, p)``."""
        table = np.zeros((*values.shape[:-1], len(QUANTITIES), 3))
        table[..., self.terms[:, 0], self.terms[:, 1]] = values
        return table

    @cached_property
    def used(self) -> np.ndarray:
        """Indices of the quantities that the variant corrects."""
        return np.unique(self.terms[:, 0])

    @cached_property
    def structure(self) -> Structure:
        """Kronecker structure of the derivatives by the parameters."""
        count, parameters = int(self.terms[:, 1].max()) + 1, len(self.parameters)
        mixing = np.zeros((len(self.used), count, parameters))
        mixing[np.searchsorted(self.used, self.terms[:, 0]), self.terms[:, 1], np.arange(parameters)] = 1.0
        return Structure(len(self.used), count, mixing.reshape(-1, parameters))

    def project(self, image: Image, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return the corrected projection; NaN where the iteration does not converge to a ray through the point."""
        if not np.any(values):
            return image.rpc.project(ground)
        frame = compute_sensor_frame(image)
        constants, coefficients = self.constants(image)[None], self.coefficients(values)[None]
        place = frame.from_ground(ground)
        position = np.tile(image.camera_centre_px, (len(ground), 1))
        for _ in range(ITERATIONS.most):
            rays = rays_of_image(image, position)
            xy, by_image = self._intersect(constants, coefficients, rays, position, place[:, 2])
            # matrices with NaN are replaced by the identity: their right sides are NaN already
            is_singular = ~np.isfinite(by_image).all(axis=(1, 2))
            regular = np.where(is_singular[:, None, None], np.eye(2), by_image)
            step = np.linalg.solve(regular, (place[:, :2] - xy)[:, :, None])[:, :, 0]
            position = position + step
            if not np.nanmax(np.abs(step), initial=0.0) > EQUALITY.rounding:
                break
        position[~(np.abs(step).max(axis=1, initial=0.0) <= 1e3 * EQUALITY.rounding)] = np.nan
        return position

    def compute_refined_rpc(self, image: Image, values: np.ndarray) -> RefitRPC:
        """Fit an RPC to a grid of corrected rays at several heights (thesis 4.3, steps 4 and 5)."""
        if not np.any(values):
            return RefitRPC(image.rpc, 0.0)
        fit = best_fit(
            self.compute_corrected_grid(image, values, FIT.grid), self.compute_corrected_grid(image, values, CHECK_GRID)
        )
        return RefitRPC(replace(fit.rpc, err_bias=image.rpc.err_bias, err_rand=image.rpc.err_rand), fit.max_px)

    def compute_corrected_grid(
        self, image: Image, values: np.ndarray, shape: tuple[int, int, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return ground ``(n, 3)`` and image points ``(n, 2)`` of corrected rays over the image and its heights."""
        layer = make_image_grid(image.domain_px, shape[:2])
        position = np.tile(layer, (shape[2], 1))
        heights = np.repeat(np.linspace(*image.rpc.height_range, shape[2]), len(layer))
        frame = compute_sensor_frame(image)
        constants, coefficients = self.constants(image)[None], self.coefficients(values)[None]
        rays = rays_of_image(image, position)
        z = heights.copy()
        # The Earth is curved relative to the frame: iterate the frame height of each ellipsoidal height
        for _ in range(ITERATIONS.most):
            xy, _ = self._intersect(constants, coefficients, rays, position, z)
            ground = frame.to_ground(np.column_stack([xy, z]))
            z = z + heights - ground[:, 2]
            if not np.nanmax(np.abs(heights - ground[:, 2])) > EQUALITY.rounding:
                break
        finite = finite_rows(ground)
        return ground[finite], position[finite]

    def _intersect(
        self, constants: np.ndarray, coefficients: np.ndarray, rays: np.ndarray, position: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the intersections ``(n, 2)`` m of corrected rays with heights ``z (n,)``, and ``(n, 2, 2)`` m/px."""
        rows = np.zeros_like(z), np.zeros_like(z)
        hit = intersect_frame_height(
            constants,
            coefficients,
            0,
            rays=rays,
            row=ALL_ROWS,
            sample=position[:, 0],
            line=position[:, 1],
            z=z,
            ahead=rows,
        )
        return np.column_stack(hit[0]), np.column_stack(hit[3]).reshape(-1, 2, 2)


def _variant(
    name: str, title: str, quantities: tuple[str, ...], linear: bool, least_points: int, drift_factor: float = 1.0
) -> PseudoSensor:
    terms = [
        (quantity, term)
        for quantity in map(QUANTITIES.index, quantities)
        for term in range(3 if linear else 1)
        if (quantity, term) != (PSI_Z, 0)  # the constant of yaw has the same effect
    ]
    names = tuple(f"{QUANTITIES[quantity]}_{'0sl'[term]}" for quantity, term in terms)
    return PseudoSensor(name, title, names, np.array(terms), least_points, drift_factor)


PSEUDO_SENSOR = make_models(PSEUDO_SENSOR_TABLE, {"pseudo-sensor": _variant})
