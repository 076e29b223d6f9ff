"""Drifts common to all images of a part: tie points do not determine them, so that they keep their priors.

Let the ground of a block without GCPs be deformed by a field d of first degree: a scale, a rotation, a skew, a tilt of
its heights. With B the derivatives of an image by the ground, drifts of the images that give ``B d`` in every image
follow the deformation, and the residuals of tie points change only by the effects of relief and of the cameras' second
order, which are smaller than the errors that neighbouring image points share. So these *common* drifts keep the a
priori standard deviations of their sensors, whatever is estimated for the differences between images.

With the drifts in units of these standard deviations, U (k p, r) an orthonormal basis of the common ones, and F the
factors estimated from the block (`drift_prior`), the weights of all drifts are::

    F^-2 + U G U'      G = I - U' F^-2 U, its positive part

Neighbouring image points share their errors (relief, windows of least-squares matching), so that the tie points of an
image have the information of as many points as it has patches of `COMMON_DRIFT.patch_px` with points in them. In a part
determined by tie points and RPCs only, the m points of each patch have a weight of 1/m relative to the priors. As a
point's own error does not change, the priors' weights are multiplied by m instead, and the covariance of cameras is m
times their cofactors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...foundation.thresholds import REDUNDANCY, SAMPLES, threshold, thresholds
from ...ground.geodesy import ground_difference_m
from ...refinement.image_space import ImagePolynomial
from ...refinement.model import RefinementModel
from ..equations import Normals, Pattern
from ..observations import Observations


@thresholds
class COMMON_DRIFT:
    """Limits for parts of a block with common drifts, and for image points with correlated errors."""

    patch_px: float = threshold(
        300.0,
        "px",
        "side of the cells within which image points have correlated matching errors",
        "Kahramanmaras, two Pleiades pairs, 2026-11-25",
    )


GRID = 5  # grid points along each axis of an image, for the fit of its drifts to a deformation of the ground


@dataclass(frozen=True, eq=False)
class CommonDrift:
    """The common drifts of k cameras (indices in ascending order), and their prior.

    free : (k, p) mask of the parameters that are estimated drifts; n of them
    basis : (n, r) orthonormal, in units of the drifts' a priori standard deviations ``prior_sigma (n,)``
    points_per_error : number of image points that share their errors; factor of the weights of the cameras' priors
    weight : (r, r) weight matrix G
    """

    camera: np.ndarray
    free: np.ndarray
    prior_sigma: np.ndarray
    basis: np.ndarray
    points_per_error: float
    weight: np.ndarray

    @property
    def place(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns ``(n,)`` of the drifts in arrays ``(cameras, p)``."""
        rows, columns = np.nonzero(self.free)
        return self.camera[rows], columns

    @property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of connected cameras, each with itself included: rows and columns, ``row <= column``."""
        rows, columns = np.triu_indices(len(self.camera))
        return self.camera[rows], self.camera[columns]

    def balance_with(self, factor: np.ndarray, unit_variance: float) -> CommonDrift:
        """Return the prior for drift weights with ``factor (n,)``; all weights are multiplied by ``unit_variance``."""
        values, vectors = np.linalg.eigh(np.eye(self.basis.shape[1]) - (self.basis.T / factor**2) @ self.basis)
        scale = unit_variance * self.points_per_error
        return replace(self, weight=scale * (vectors * np.maximum(values, 0.0)) @ vectors.T)

    def select_drifts(
        self, cofactors: np.ndarray, values: np.ndarray, pattern: Pattern
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the drifts' cofactors ``(n, n)`` and values ``(n,)``, in their units, from those of all cameras."""
        k, p = self.free.shape
        rows, columns = np.triu_indices(k)
        full = np.empty((k, k, p, p))
        full[rows, columns] = cofactors[pattern.find_blocks(*self.pairs)]
        full[columns, rows] = full[rows, columns].transpose(0, 2, 1)
        selected = np.flatnonzero(self.free)
        drift_cofactors = full.transpose(0, 2, 1, 3).reshape(k * p, k * p)[np.ix_(selected, selected)]
        return drift_cofactors / self.prior_sigma[:, None] / self.prior_sigma, values[self.place] / self.prior_sigma

    def predict_differences(
        self,
        next_drift: CommonDrift,
        cofactors: np.ndarray,
        values: np.ndarray,
        prior_weight: np.ndarray,
        weight: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return squares and redundancies ``(n,)`` of the drifts without the common ones, for other priors.

        ``cofactors`` and ``values`` are the results of `select_drifts`; ``prior_weight (n,)`` are the drifts' prior
        weights of the solution, ``weight (n,)`` the new ones, and ``next_drift`` has the new weights of the common
        drifts.
        """
        weight = weight * self.prior_sigma**2
        weight_change = np.diag(weight - prior_weight * self.prior_sigma**2)
        weight_change += self.basis @ (next_drift.weight - self.weight) @ self.basis.T
        ahead = np.linalg.solve(np.eye(len(values)) + cofactors @ weight_change, np.column_stack([cofactors, values]))
        complement = np.eye(len(values)) - self.basis @ self.basis.T
        share = np.einsum("ij,jk,ki->i", complement, ahead[:, :-1], complement)
        return (complement @ ahead[:, -1]) ** 2, np.clip(complement.diagonal() - weight * share, 0.0, 1.0)

    def reorder(self, order: np.ndarray) -> CommonDrift:
        """Return the same common drifts for cameras with their parameters in another order."""
        number = np.zeros(self.free.shape, dtype=np.int64)
        number[self.free] = np.arange(len(self.basis))
        free = self.free[:, order]
        rows = number[:, order][free]
        return replace(self, free=free, prior_sigma=self.prior_sigma[rows], basis=self.basis[rows])

    # ---- the prior in the iterations (`gauss_newton`, as `earlier_cameras`) -----------------------------------------

    def add_to(self, normals: Normals, values: np.ndarray, pattern: Pattern) -> None:
        """Add the prior at ``values (cameras, p)`` to the reduced normal equations."""
        # The derivatives of the common drifts by the cameras' parameters, (k, p, r)
        by_value = np.zeros((*self.free.shape, self.basis.shape[1]))
        by_value[self.free] = self.basis / self.prior_sigma[:, None]
        rows, columns = np.triu_indices(len(self.camera))
        blocks = np.einsum("bpr,bqr->bpq", (by_value @ self.weight)[rows], by_value[columns])
        normals.blocks[pattern.find_blocks(*self.pairs)] += blocks
        normals.right[self.camera] -= by_value @ (self.weight @ self._measure_modes(values))

    def compute_cost(self, values: np.ndarray) -> float:
        """Return half the weighted sum of squares of the common drifts at ``values (cameras, p)``."""
        modes = self._measure_modes(values)
        return 0.5 * float(modes @ self.weight @ modes)

    def count_parameters(self, cofactors: np.ndarray, pattern: Pattern) -> float:
        """Return the number of parameters that the prior determines, for ``cofactors`` on the pattern."""
        drift_cofactors, _ = self.select_drifts(cofactors, np.zeros((pattern.cameras, pattern.parameters)), pattern)
        return float(np.sum(self.weight * (self.basis.T @ drift_cofactors @ self.basis)))

    def _measure_modes(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(self.basis.T @ (values[self.place] / self.prior_sigma))


def find_common_drift(
    observations: Observations,
    model: RefinementModel,
    images: np.ndarray,
    free: np.ndarray,
    sigma: np.ndarray,
    only_ties: bool,
) -> CommonDrift | None:
    """Return the common drifts of a part of a block, or None if there are none.

    ``images`` are its images, ``free (cameras, p)`` is the mask of drift parameters, and ``sigma (cameras, p)`` their a
    priori standard deviations; ``only_ties`` : only tie points and RPCs determine the cameras.
    """
    camera = np.unique(observations.camera_of_image[images])
    is_free, sigma = free[camera], sigma[camera]
    if len(camera) > SAMPLES.dense or not is_free.any():
        return None
    # Derivatives (2 n, p) of points of each image by the parameters, and (2 n, d) by deformations of the ground. A
    # deformation is a monomial of east and north, up to the model's degree, in one of the three coordinates; its value
    # is 1 at a distance of about a scene from the middle
    equations: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
    degree = int(model.powers.sum(axis=1).max(initial=1)) if isinstance(model, ImagePolynomial) else 1
    powers = [(a, total - a) for total in range(1, degree + 1) for a in range(total + 1)]
    places = [observations.images[index].rpc for index in images]
    middle, reach_m = np.mean([[rpc.long_off, rpc.lat_off, rpc.height_off] for rpc in places], axis=0), None
    for index in images.tolist():
        image, place = observations.images[index], int(np.searchsorted(camera, observations.camera_of_image[index]))
        xy = image.grid_px(GRID, GRID)
        ground = image.rpc.localize(xy, image.rpc.height_off).ground
        xy, ground = xy[np.isfinite(ground[:, 0])], ground[np.isfinite(ground[:, 0])]
        away_m = ground_difference_m(ground, np.broadcast_to(middle, ground.shape))[:, :2]
        reach_m = reach_m or float(np.abs(away_m).max())
        linearised = model.equations(image, xy)(np.zeros(len(model.parameters)), ground)
        monomials = np.stack([np.prod((away_m / reach_m) ** power, axis=1) for power in powers], axis=1)
        fields = linearised.by_ground[:, :, :, None] * monomials[:, None, None, :]
        by_values = linearised.by_values.reshape(2 * len(xy), -1) * sigma[place]
        equations.setdefault(place, []).append((by_values, -fields.reshape(2 * len(xy), -1)))
    modes = np.concatenate(
        [
            # the a priori likeliest of all corrections that fit the deformation
            np.linalg.lstsq(
                np.concatenate([by_values for by_values, _ in equations[place]]),
                np.concatenate([by_fields for _, by_fields in equations[place]]),
                rcond=1e-9,
            )[0][is_selected]
            for place, is_selected in enumerate(is_free)
        ]
    )
    basis, size, _ = np.linalg.svd(modes, full_matrices=False)
    basis = basis[:, size > REDUNDANCY.tested * size[0]]
    points = patches = 0  # their ratio: image points per independent error
    for index in images.tolist() if only_ties else ():
        xy = observations.xy[observations.by_image[index]]
        points += len(xy)
        patches += len(np.unique(np.floor(xy / COMMON_DRIFT.patch_px), axis=0))
    points_per_error = max(points / max(patches, 1), 1.0)
    return CommonDrift(
        camera, is_free, sigma[is_free], basis, points_per_error, np.zeros((basis.shape[1], basis.shape[1]))
    )


def count_points_per_error(cameras: int, common: Sequence[CommonDrift]) -> np.ndarray:
    """Return the factors of the cameras' priors for image points that share errors, ``(cameras,)``; 1 without."""
    points_per_error = np.ones(cameras)
    for one in common:
        points_per_error[one.camera] = one.points_per_error
    return points_per_error
