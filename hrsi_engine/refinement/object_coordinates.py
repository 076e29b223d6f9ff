"""Bias compensation by a polynomial of the ground coordinates, added in the image (thesis eq. 4.4).

With (X, Y, Z) lon, lat and height as shares of the image's ground area and of the RPC's height range::

    sample = s(ground) + sum_m a_m X^i Y^j Z^k        line = l(ground) + sum_m b_m X^i Y^j Z^k

(Grodecki and Dial 2003, their object-space form; Di et al. 2003 use the first order.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..block.block import Image
from ..ground.geodesy import metres_per_degree
from .ground_area import ground_area
from .model import Equations, Linearise, Priors, RefinedRPC
from .refit import refit


@dataclass(frozen=True, eq=False)
class GroundPolynomial:
    """A polynomial of the ground coordinates; ``powers (m, 3)`` are the exponents of X, Y and Z."""

    name: str
    title: str
    parameters: tuple[str, ...]
    powers: np.ndarray

    @property
    def least_points(self) -> int:
        """GCPs from which the parameters follow."""
        return len(self.powers)

    def prior_sigmas(self, image: Image, priors: Priors) -> np.ndarray:
        """Return the shift, and the drift's pixels from the middle of the image to its edge."""
        degree = np.tile(self.powers.sum(axis=1), 2)
        return np.where(degree == 0, priors.shift_px, priors.drift * float(image.half_size_px.max()))

    def equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the observation equations; they do not depend on where the points were observed."""
        area = ground_area(image)

        def linearise(values: np.ndarray, ground: np.ndarray) -> Equations:
            projected, by_ground = image.rpc.project_with_metric_jacobian(ground)
            normalised = area.normalised(ground)
            terms = self._terms(normalised)
            by_values = np.kron(np.eye(2), terms[:, None, :]).reshape(len(ground), 2, -1)
            slope = self._slopes(normalised, values) / (area.reach * metres_per_degree(ground))[:, None, :]
            return Equations(projected + terms @ values.reshape(2, -1).T, by_values, by_ground + slope)

        return linearise

    def project(self, image: Image, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return the corrected projection of ground points."""
        terms = self._terms(ground_area(image).normalised(ground))
        return np.asarray(image.rpc.project(ground) + terms @ values.reshape(2, -1).T)

    def refined_rpc(self, image: Image, values: np.ndarray) -> RefinedRPC:
        """Fit a new RPC."""
        if not np.any(values):
            return RefinedRPC(image.rpc, 0.0)
        return refit(image, lambda ground: self.project(image, values, ground))

    def _terms(self, normalised: np.ndarray) -> np.ndarray:
        """Return the monomials, ``(n, m)``."""
        return np.prod(normalised[:, None, :] ** self.powers, axis=2)

    def _slopes(self, normalised: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the derivatives of the correction by X, Y and Z, ``(n, 2, 3)``."""
        slopes = np.empty((len(normalised), 2, 3))
        for axis in range(3):
            lowered = self.powers.copy()
            lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
            factors = self.powers[:, axis] * values.reshape(2, -1)
            slopes[:, :, axis] = np.prod(normalised[:, None, :] ** lowered, axis=2) @ factors.T
        return slopes


def _polynomial(name: str, title: str, degree: int) -> GroundPolynomial:
    powers = [
        (i, j, k)
        for total in range(degree + 1)
        for i in range(total, -1, -1)
        for j in range(total - i, -1, -1)
        for k in [total - i - j]
    ]
    suffixes = ["x" * i + "y" * j + "z" * k or "0" for i, j, k in powers]
    names = tuple(f"{coordinate}_{suffix}" for coordinate in ("sample", "line") for suffix in suffixes)
    return GroundPolynomial(name, title, names, np.array(powers))


OBJECT_COORDINATES = {
    model.name: model
    for model in (
        _polynomial("ground-linear", "a first-order polynomial of lon, lat and height, added in the image", 1),
        _polynomial("ground-quadratic", "a second-order polynomial of lon, lat and height, added in the image", 2),
    )
}
