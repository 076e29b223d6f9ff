"""Bias compensation in image space: a polynomial of the projected position added to it (thesis eqs. 4.2, 4.3).

With (s, l) = RPC(ground), u = s - s0, v = l - l0 relative to the image's centre::

    sample = s + sum_m a_m u^i v^j        line = l + sum_m b_m u^i v^j

The correction's argument is the *projected* position, so that the corrected camera is a plain function of the ground
and can be written as an RPC (Fraser and Hanley 2003; Grodecki and Dial 2003). The parameters are linear; the models of
the family differ in their monomials and in how coefficients are shared. With t the monomials, the derivatives by all
coefficients are I2 (x) t', and by the ground (I2 + slope of the correction) times those of the RPC.

The bands of one exposure have the coefficients of its panchromatic image: with pixels p times as large, u and v are p
times those in pixels of the band, and the sums are divided by p.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..block.block import Image
from ..camera.rpc_fit import fold_affine
from .model import ALL_ROWS, Equations, ImageIndex, Linearise, Priors, RefitRPC, RowIndex, Structure, refit_camera
from .model_table import IMAGE_SPACE_TABLE, make_models


@dataclass(frozen=True, eq=False)
class ImagePolynomial:
    """An image-space model.

    powers : (m, 2) exponents (i, j) of u and v of each monomial
    mixing : (2, m, p) how each parameter enters the coefficients of sample and line
    """

    name: str
    title: str
    parameters: tuple[str, ...]
    powers: np.ndarray
    mixing: np.ndarray

    @property
    def least_points(self) -> int:
        """Fewest GCPs that determine the parameters."""
        return (len(self.parameters) + 1) // 2

    @property
    def drifts(self) -> np.ndarray:
        """True for parameters that change the correction across an image, ``(p,)`` bool."""
        constant = self.powers.sum(axis=1) == 0
        return np.asarray(~(self.mixing[:, constant] != 0.0).any(axis=(0, 1)))

    def prior_sigmas(self, image: Image, priors: Priors) -> np.ndarray:
        """Return the priors of the parameters: shift (px), drift (px/px), for higher degrees per half image size."""
        degree, pixel = self.powers.sum(axis=1), image.camera_pixel
        reach = image.camera_half_size_px.max() * pixel
        by_monomial = np.where(
            degree == 0, priors.shift_px * pixel, priors.drift / np.maximum(reach, 1.0) ** np.maximum(degree - 1, 0)
        )
        return np.asarray(np.where((self.mixing != 0.0).any(0), by_monomial[:, None], 0.0).max(axis=0, initial=0.0))

    def equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the observation equations; they do not depend on the observed positions."""
        constants = self.constants(image)[None]
        return lambda values, ground: self.linearise(
            constants, 0, values[None], ground, *image.rpc.project_with_metric_jacobian(ground)
        )

    def linearise(
        self,
        constants: np.ndarray,
        which: ImageIndex,
        values: np.ndarray,
        ground: np.ndarray,
        computed: np.ndarray,
        by_ground: np.ndarray,
    ) -> Equations:
        """Return the equations of points of many images, from positions and derivatives by their RPCs.

        constants, values : (images, 3) and (images, p) of the images; which : index of each point's image
        ground : (n, 3), not used; computed, by_ground : (n, 2) px and (n, 2, 3) px/m by the RPCs, overwritten
        """
        terms = np.empty((len(ground), len(self.powers)))
        coefficients = self.coefficients(values)
        correct_in_image(
            self.powers,
            constants,
            coefficients,
            i=which,
            computed=computed,
            by_ground=by_ground,
            terms=terms,
            a=ALL_ROWS,
        )
        return Equations(computed, np.einsum("nm,cmp->ncp", terms, self.mixing), by_ground)

    def constants(self, image: Image) -> np.ndarray:
        """Return the constants of an image for `correct_in_image` ``(3,)``: centre, px, and `Image.camera_pixel`."""
        return np.append(image.camera_centre_px, image.camera_pixel)

    def coefficients(self, values: np.ndarray) -> np.ndarray:
        """Return the coefficients of the monomials in sample and in line, ``(…, 2, m)``, of values ``(…, p)``."""
        return np.ascontiguousarray(np.einsum("cmp,...p->...cm", self.mixing, values))

    @property
    def structure(self) -> Structure:
        """Kronecker structure of the derivatives by the parameters."""
        return Structure(None, len(self.powers), self.mixing.reshape(2 * len(self.powers), len(self.parameters)))

    def correction(self, image: Image, values: np.ndarray, projected: np.ndarray) -> np.ndarray:
        """Return the correction at projected positions ``(n, 2)``, px, for parameter ``values (p,)``."""
        return np.asarray(self._compute_terms(image, projected) @ (self.mixing @ values).T)

    def compute_normal(self, image: Image, projected: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Return the normal matrix ``(p, p)`` of the correction's derivatives.

        projected : (n, 2) positions by the RPC, px; weight : (n,) 1/px²
        """
        terms = self._compute_terms(image, projected)
        product = (terms.T * weight) @ terms
        return np.asarray(sum(mixed.T @ product @ mixed for mixed in self.mixing))

    def project(self, image: Image, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return the corrected projection ``(n, 2)`` of ``ground (n, 3)``, px, for parameter ``values (p,)``."""
        projected = image.rpc.project(ground)
        return projected + self.correction(image, values, projected)

    def compute_refined_rpc(self, image: Image, values: np.ndarray) -> RefitRPC:
        """Return the refined RPC for ``values (p,)``: exact for corrections up to the first degree, else fitted."""
        if not np.any(values):
            return RefitRPC(image.rpc, 0.0)
        if self.powers.sum(axis=1).max(initial=0) > 1:
            return refit_camera(self, image, values)
        affine = np.column_stack([np.zeros(2), np.eye(2)])  # columns: constant, sample, line
        for (by_sample, by_line), column in zip(self.powers, (self.mixing @ values).T, strict=True):
            affine[:, by_sample + 2 * by_line] += column if by_sample + by_line else column / image.camera_pixel
        affine[:, 0] -= (affine[:, 1:] - np.eye(2)) @ image.camera_centre_px
        folded = fold_affine(image.rpc, affine)
        return refit_camera(self, image, values) if folded is None else RefitRPC(folded, 0.0)

    def _compute_terms(self, image: Image, projected: np.ndarray) -> np.ndarray:
        """Return the derivatives of the correction (px) by the coefficients of the monomials, ``(n, m)``.

        projected : (n, 2) positions by the RPC, px
        """
        offset = (projected - image.camera_centre_px) * image.camera_pixel
        of_axes = np.ones((2, int(self.powers.max(initial=0)) + 1, len(offset)))
        for power in range(1, of_axes.shape[1]):  # products: general powers take twenty times as long
            np.multiply(of_axes[:, power - 1], offset.T, out=of_axes[:, power])
        return np.asarray((of_axes[0, self.powers[:, 0]] * of_axes[1, self.powers[:, 1]]).T) / image.camera_pixel


def correct_in_image(
    powers: np.ndarray,
    constants: np.ndarray,
    coefficients: np.ndarray,
    i: ImageIndex,
    computed: np.ndarray,
    by_ground: np.ndarray,
    terms: np.ndarray,
    a: RowIndex,
) -> None:
    """Add the correction of image i to its projected points; one formula for compiled loops and NumPy.

    powers : (m, 2); constants : (images, 3) centre (px) and `Image.camera_pixel`; coefficients : (images, 2, m)
    computed, by_ground : (n, 2) px and (n, 2, 3) px/m of the RPC; overwritten by those of the corrected camera
    terms : (n, m) output, the derivatives by the coefficients: the monomials divided by the pixel size
    i : index of the image, or of each point's image; a : row, or all rows
    """
    pixel = constants[i, 2]
    u, v = (computed[a, 0] - constants[i, 0]) * pixel, (computed[a, 1] - constants[i, 1]) * pixel
    sample, sample_by_u, sample_by_v = 0.0, 0.0, 0.0
    line, line_by_u, line_by_v = 0.0, 0.0, 0.0
    for m in range(len(powers)):
        term, by_u, by_v = 1.0, 0.0, 0.0
        for _ in range(powers[m, 0]):
            by_u = by_u * u + term
            term = term * u
        for _ in range(powers[m, 1]):
            by_u = by_u * v
            by_v = by_v * v + term
            term = term * v
        terms[a, m] = term / pixel
        x, y = coefficients[i, 0, m], coefficients[i, 1, m]
        sample, sample_by_u, sample_by_v = sample + x * term, sample_by_u + x * by_u, sample_by_v + x * by_v
        line, line_by_u, line_by_v = line + y * term, line_by_u + y * by_u, line_by_v + y * by_v
    computed[a, 0] += sample / pixel
    computed[a, 1] += line / pixel
    for k in range(3):
        by_sample, by_line = by_ground[a, 0, k], by_ground[a, 1, k]
        more_sample = sample_by_u * by_sample + sample_by_v * by_line
        more_line = line_by_u * by_sample + line_by_v * by_line
        by_ground[a, 0, k] += more_sample
        by_ground[a, 1, k] += more_line


def add_drift_parameters(model: ImagePolynomial) -> ImagePolynomial:
    """Return the model with those parameters of an affine correction appended that it does not have.

    A drift of the camera that a model with few parameters cannot represent is an error common to all points of the
    image; these parameters, with a prior, represent it in the observation equations.
    """
    affine = IMAGE_SPACE["affine"]
    powers = np.unique(np.concatenate([model.powers, affine.powers]), axis=0)
    model_mixing, all_rows = _express_in_monomials(model, powers), _express_in_monomials(affine, powers)
    mixing, names = model_mixing, list(model.parameters)
    for column in range(all_rows.shape[2]):
        wider = np.concatenate([mixing, all_rows[:, :, column : column + 1]], axis=2)
        if np.linalg.matrix_rank(wider.reshape(-1, wider.shape[2])) == wider.shape[2]:
            mixing = wider
            names.append(f"drift_{affine.parameters[column]}")
    return ImagePolynomial(model.name, model.title, tuple(names), powers, mixing)


def _express_in_monomials(model: ImagePolynomial, powers: np.ndarray) -> np.ndarray:
    """Return a model's mixing ``(2, m, p)`` for ``powers (m, 2)``, which contain the model's own."""
    mixing = np.zeros((2, len(powers), len(model.parameters)))
    for index, power in enumerate(model.powers):
        mixing[:, np.flatnonzero((powers == power).all(axis=1))[0]] = model.mixing[:, index]
    return mixing


def _polynomial(name: str, title: str, powers: list[tuple[int, int]]) -> ImagePolynomial:
    """Return the model with one coefficient for each monomial in sample and one in line."""
    count = len(powers)
    mixing = np.zeros((2, count, 2 * count))
    mixing[0, :, :count] = np.eye(count)
    mixing[1, :, count:] = np.eye(count)
    suffixes = ["0" if powers == (0, 0) else "s" * powers[0] + "l" * powers[1] for powers in powers]
    names = [f"{coordinate}_{suffix}" for coordinate in ("sample", "line") for suffix in suffixes]
    return ImagePolynomial(name, title, tuple(names), np.array(powers, dtype=np.int64).reshape(-1, 2), mixing)


def _similarity(name: str, title: str) -> ImagePolynomial:
    """Return the model with shift, scale k and rotation r: sample + k u - r v, line + r u + k v."""
    mixing = np.zeros((2, 3, 4))
    mixing[0, 0, 0] = mixing[1, 0, 1] = 1.0
    mixing[0, 1, 2] = mixing[1, 2, 2] = 1.0
    mixing[0, 2, 3], mixing[1, 1, 3] = -1.0, 1.0
    parameters = ("sample_0", "line_0", "scale", "rotation")
    return ImagePolynomial(name, title, parameters, np.array([(0, 0), (1, 0), (0, 1)]), mixing)


_MAKERS: dict[str, Callable[..., ImagePolynomial]] = {"polynomial": _polynomial, "similarity": _similarity}
IMAGE_SPACE = make_models(IMAGE_SPACE_TABLE, _MAKERS)
