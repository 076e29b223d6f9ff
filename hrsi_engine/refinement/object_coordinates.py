"""Bias compensation by a polynomial of the ground coordinates, added in the image (thesis eq. 4.4).

With (X, Y, Z) lon, lat and height as shares of the image's ground area and of the RPC's height range::

    sample = s(ground) + sum_m a_m X^i Y^j Z^k        line = l(ground) + sum_m b_m X^i Y^j Z^k

(Grodecki and Dial 2003, their object-space form; Di et al. 2003 use the first order.)
"""

from dataclasses import dataclass

import numpy as np

from ..block.block import Image
from ..ground import ellipsoid
from ..ground.ellipsoid import Number
from .ground_area import compute_ground_area
from .model import ALL_ROWS, Equations, ImageIndex, Linearise, Priors, RefitRPC, RowIndex, Structure, refit_camera
from .model_table import OBJECT_COORDINATES_TABLE, make_models


@dataclass(frozen=True, eq=False)
class GroundPolynomial:
    """A correction by a polynomial of the ground coordinates; ``powers (m, 3)`` are the exponents of X, Y and Z."""

    name: str
    title: str
    parameters: tuple[str, ...]
    powers: np.ndarray

    @property
    def least_points(self) -> int:
        """Fewest GCPs that determine the parameters."""
        return len(self.powers)

    @property
    def drifts(self) -> np.ndarray:
        """True for parameters that change the correction across an image, ``(p,)`` bool."""
        return np.tile(self.powers.sum(axis=1) > 0, 2)

    def prior_sigmas(self, image: Image, priors: Priors) -> np.ndarray:
        """Return the prior of each parameter, px: the shift, or the drift from the middle of the image to its edge."""
        degree = np.tile(self.powers.sum(axis=1), 2)
        sigma = np.where(degree == 0, priors.shift_px, priors.drift * float(image.camera_half_size_px.max()))
        return sigma * image.camera_pixel

    def equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the observation equations; they do not depend on the observed positions."""
        constants = self.constants(image)[None]
        return lambda values, ground: self.linearise(
            constants, 0, values[None], ground, *image.rpc.project_with_metric_jacobian(ground)
        )

    def linearise(
        self,
        constants: np.ndarray,
        image_of_point: ImageIndex,
        values: np.ndarray,
        ground: np.ndarray,
        computed: np.ndarray,
        by_ground: np.ndarray,
    ) -> Equations:
        """As `image_space.ImagePolynomial.linearise`."""
        terms, (lon, lat, height) = np.empty((len(ground), len(self.powers))), ground.T
        correct_by_ground(
            self.powers,
            constants,
            self.coefficients(values),
            image_of_point,
            lon,
            lat,
            height,
            *ellipsoid.metres_of_a_degree(lat, height),
            computed,
            by_ground,
            terms,
            ALL_ROWS,
        )
        by_values = np.kron(np.eye(2), terms[:, None, :]).reshape(len(ground), 2, 2 * terms.shape[1])
        return Equations(computed, by_values, by_ground)

    def constants(self, image: Image) -> np.ndarray:
        """Return an image's constants for `correct_by_ground` ``(7,)``.

        Middle and half extents of its ground area, and `Image.camera_pixel`.
        """
        area = compute_ground_area(image)
        return np.concatenate([area.middle, area.reach, [image.camera_pixel]])

    def coefficients(self, values: np.ndarray) -> np.ndarray:
        """Return the coefficients of the monomials in sample and in line, ``(…, 2, m)``, of values ``(…, p)``."""
        return values.reshape(*values.shape[:-1], 2, len(self.powers))

    @property
    def structure(self) -> Structure:
        """Kronecker structure of the derivatives by the parameters."""
        return Structure(None, len(self.powers), np.eye(len(self.parameters)))

    def project(self, image: Image, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return the corrected projection ``(n, 2)`` of ``ground (n, 3)``, px, for parameter ``values (p,)``."""
        # The monomials, ``(n, m)``
        terms = np.prod(compute_ground_area(image).normalise(ground)[:, None, :] ** self.powers, axis=2)
        return np.asarray(image.rpc.project(ground) + terms @ values.reshape(2, -1).T / image.camera_pixel)

    def compute_refined_rpc(self, image: Image, values: np.ndarray) -> RefitRPC:
        """Return the refined RPC: a new one, fitted to the corrected camera."""
        return refit_camera(self, image, values)


def correct_by_ground(
    powers: np.ndarray,
    constants: np.ndarray,
    coefficients: np.ndarray,
    i: ImageIndex,
    lon: Number,
    lat: Number,
    height: Number,
    east: Number,
    north: Number,
    computed: np.ndarray,
    by_ground: np.ndarray,
    terms: np.ndarray,
    a: RowIndex,
) -> None:
    """Add the correction of image i to its projected points; one formula for compiled loops and NumPy.

    powers : (m, 3); constants : (images, 7); coefficients : (images, 2, m)
    lon, lat, height : degrees, metres; east, north : metres per degree there
    computed, by_ground : (n, 2) px and (n, 2, 3) px/m of the RPC; overwritten by those of the corrected camera
    terms : (n, m) output, the derivatives by the coefficients: the monomials divided by the pixel size
    i : index of the image, or of each point's image; a : row, or all rows
    """
    pixel = constants[i, 6]
    x = ellipsoid.wrap_once(lon - constants[i, 0]) / constants[i, 3]
    y, z = (lat - constants[i, 1]) / constants[i, 4], (height - constants[i, 2]) / constants[i, 5]
    sample, sample_x, sample_y, sample_z = 0.0, 0.0, 0.0, 0.0
    line, line_x, line_y, line_z = 0.0, 0.0, 0.0, 0.0
    for m in range(len(powers)):
        term, by_x, by_y, by_z = 1.0, 0.0, 0.0, 0.0
        for _ in range(powers[m, 0]):
            by_x = by_x * x + term
            term = term * x
        for _ in range(powers[m, 1]):
            by_x, by_y = by_x * y, by_y * y + term
            term = term * y
        for _ in range(powers[m, 2]):
            by_x, by_y, by_z = by_x * z, by_y * z, by_z * z + term
            term = term * z
        terms[a, m] = term / pixel
        s, t = coefficients[i, 0, m], coefficients[i, 1, m]
        sample, line = sample + s * term, line + t * term
        sample_x, sample_y, sample_z = sample_x + s * by_x, sample_y + s * by_y, sample_z + s * by_z
        line_x, line_y, line_z = line_x + t * by_x, line_y + t * by_y, line_z + t * by_z
    computed[a, 0] += sample / pixel
    computed[a, 1] += line / pixel
    x_m, y_m, z_m = constants[i, 3] * east * pixel, constants[i, 4] * north * pixel, constants[i, 5] * pixel
    by_ground[a, 0, 0] += sample_x / x_m
    by_ground[a, 0, 1] += sample_y / y_m
    by_ground[a, 0, 2] += sample_z / z_m
    by_ground[a, 1, 0] += line_x / x_m
    by_ground[a, 1, 1] += line_y / y_m
    by_ground[a, 1, 2] += line_z / z_m


def _polynomial(name: str, title: str, degree: int) -> GroundPolynomial:
    """Return the model of all monomials x^i y^j z^k up to a degree, with a coefficient each in sample and in line."""
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


OBJECT_COORDINATES = make_models(OBJECT_COORDINATES_TABLE, {"polynomial": _polynomial})
