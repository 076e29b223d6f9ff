"""The interface of a refinement model: how an image's correction enters the observation equations and a new RPC.

A model has a few parameters for each image (its *values*, zero for the vendor's RPC without correction). For points of
the image it gives the computed image position and its derivatives by the values and by the ground position::

    computed(values, ground)      (n, 2)      sample, line in px
    by_values                     (n, 2, p)   px per unit of each parameter
    by_ground                     (n, 2, 3)   px per metre east, north, up at each point

The adjustment uses nothing else of a model. A new model is one entry in `model_table`, and a class if no family has it;
the tests of the interface are run for every entry (numeric against analytic derivatives, zero values leave the RPC
unchanged, refined RPC against the model).

Fit of a new RPC to a corrected camera whose correction no exact change of the coefficients represents.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from ..block.block import Image
from ..block.pointing import compute_gsd_m, estimate_pointing
from ..camera.rpc import RPC
from ..camera.rpc_fit import make_image_grid, refit_rpc
from ..foundation.thresholds import EQUALITY, ITERATIONS


class Equations(NamedTuple):
    """Linearised observation equations of one image's points.

    Parameters
    ----------
    computed : (n, 2) ndarray
        Sample, line in pixels.
    by_values : (n, 2, p) ndarray
        Pixels per unit of each parameter.
    by_ground : (n, 2, 3) ndarray
        Pixels per metre east, north, up at each point.
    """

    computed: np.ndarray
    by_values: np.ndarray
    by_ground: np.ndarray


@dataclass(frozen=True, eq=False)
class Structure:
    """Kronecker structure of the derivatives A of an image point by the parameters: ``A = (G (x) t') mixing``.

    A correction model has a few *quantities* (sample and line, metres, angles), each a linear combination of the same
    *terms* (1 and polynomials of a position). With G (2, q) the derivatives by the quantities and t (m,) the terms,
    compiled loops multiply q + m numbers instead of the 2 p of A.

    quantities : q; None for sample and line themselves, where G is the identity
    terms : m
    mixing : (q m, p) coefficients of the terms by the parameters, those of the first quantity first
    """

    quantities: int | None
    terms: int
    mixing: np.ndarray

    @property
    def size(self) -> int:
        """Number of quantities."""
        return 2 if self.quantities is None else self.quantities

    def fold(self, blocks: np.ndarray) -> np.ndarray:
        """Return blocks ``(b, m m, q q)`` of the coefficients' normal matrix for the parameters, ``(b, p, p)``."""
        q, m = self.size, self.terms
        by_coefficient = blocks.reshape(len(blocks), m, m, q, q).transpose(0, 3, 1, 4, 2)
        return self._mix(by_coefficient.reshape(len(blocks), q * m, q * m), self.mixing)

    def unfold(self, blocks: np.ndarray) -> np.ndarray:
        """Return blocks ``(b, p, p)`` of the parameters' cofactor matrix for the coefficients, ``(b, m m, q q)``."""
        q, m = self.size, self.terms
        by_coefficient = self._mix(blocks, self.mixing.T).reshape(len(blocks), q, m, q, m)
        return np.ascontiguousarray(by_coefficient.transpose(0, 2, 4, 1, 3).reshape(len(blocks), m * m, q * q))

    def _mix(self, blocks: np.ndarray, mixing: np.ndarray) -> np.ndarray:
        if mixing.shape[0] == mixing.shape[1] and np.array_equal(mixing, np.eye(len(mixing))):
            return blocks
        return np.asarray(mixing.T @ blocks @ mixing)


#: Row index of formulas shared by compiled loops (one row) and NumPy (all rows).
RowIndex = int | slice
ALL_ROWS = slice(None)
#: Index of the image of that row, or of the image of each row.
ImageIndex = int | np.ndarray


class RefitRPC(NamedTuple):
    """A refined RPC and its largest difference from the model.

    Parameters
    ----------
    rpc : RPC
        The camera.
    fit_max_px : float
        Largest difference on an independent grid in pixels; 0 where coefficients are changed exactly.
    """

    rpc: RPC
    fit_max_px: float


@dataclass(frozen=True)
class Orientation:
    """Standard deviations of a sensor's position and attitude.

    Drifts are changes over ``reach_m`` on the ground, from the middle of an image to its edge; for other sizes of
    images they are scaled proportionally.
    """

    position_m: float
    attitude_rad: float
    position_drift_m: float
    attitude_drift_rad: float
    reach_m: float = 30e3


@dataclass(frozen=True)
class Priors:
    """A priori standard deviations of the corrections (diagonal of C_A, thesis eq. 5.46).

    Parameters
    ----------
    shift_px : float
        Standard deviation of the constant part, px.
    drift : float
        Standard deviation of its change across the image, in px per px.
    orientation : Orientation, optional
        Standard deviations for a pseudo sensor; by default derived from the other two.
    """

    shift_px: float
    drift: float
    orientation: Orientation | None = None


#: Loose for constant errors of any satellite, tight for the drift across an image: suitable for errors from 0 to 1 km
#: and 0.1 rad (docs/protocols/accuracy_thesis.md).
LOOSE_ORIENTATION = Orientation(2000.0, 0.2, 2.0, 2e-4)
#: With GCPs the priors only keep the equations regular: far above any vendor's error. The positions of the sensors get
#: the worst accuracy of orbits, because attitude has the same effect except for its change across the image, which tie
#: points would fit to the drift (Hobart with one GCP, generic-shift: height RMSE 5.7 m with 2 km, 1.7 m with 20 m).
CONTROLLED = Priors(shift_px=100.0, drift=1e-3, orientation=replace(LOOSE_ORIENTATION, position_m=20.0))
#: Smallest prior of a drift without GCPs, px/px; if sigmas are tested, its size is estimated.
UNCONTROLLED_DRIFT = 1e-4


def select_priors(image: Image, controlled: bool) -> Priors:
    """Return the priors of an image; without GCPs from the accuracy of its sensor, as they determine the datum then.

    Parameters
    ----------
    image : Image
        The image.
    controlled : bool
        True if the image's part of the block has GCPs.

    Returns
    -------
    Priors
        A priori standard deviations.
    """
    if controlled:
        return CONTROLLED
    believed = estimate_priors(image)
    return replace(believed, drift=max(believed.drift, UNCONTROLLED_DRIFT))


def estimate_priors(image: Image) -> Priors:
    """Return the a priori accuracy (shift and drift) of an image's RPC, from the pointing accuracy of its sensor."""
    pointing = estimate_pointing(image)
    return Priors(pointing.sigma_m / compute_gsd_m(image), pointing.drift)


Linearise = Callable[[np.ndarray, np.ndarray], Equations]


class RefinementModel(Protocol):
    """Interface of every entry of `MODELS`."""

    @property
    def name(self) -> str:
        """Name on the command line."""

    @property
    def title(self) -> str:
        """Description in a few words, for help and reports."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters of one image."""

    @property
    def least_points(self) -> int:
        """Fewest GCPs on one image that determine the parameters, with priors only where the model is made for them."""

    @property
    def drifts(self) -> np.ndarray:
        """True for parameters that change the correction across the image (drifts), ``(p,)`` bool."""

    def prior_sigmas(self, image: Image, priors: Priors) -> np.ndarray:
        """Return the a priori standard deviation of each parameter.

        Parameters
        ----------
        image : Image
            The image.
        priors : Priors
            Priors of the image.

        Returns
        -------
        (p,) ndarray
            In the parameters' units.
        """

    def equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the linearised equations of points that were observed on an image.

        Parameters
        ----------
        image : Image
            The image.
        observed_px : (n, 2) ndarray
            Sample, line; quantities that depend on them only (for example pseudo rays) are computed here once.

        Returns
        -------
        callable
            ``(values, ground) -> Equations``.
        """

    def project(self, image: Image, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return image points of ground points by the corrected camera.

        Parameters
        ----------
        image : Image
            The image.
        values : (p,) ndarray
            Values of the parameters.
        ground : (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.

        Returns
        -------
        (n, 2) ndarray
            Sample, line in pixels.
        """

    def compute_refined_rpc(self, image: Image, values: np.ndarray) -> RefitRPC:
        """Return an RPC that reproduces the original RPC with its correction, over the image and its height range.

        Parameters
        ----------
        image : Image
            The image.
        values : (p,) ndarray
            Values of the parameters.

        Returns
        -------
        RefitRPC
            The RPC, and its largest difference from the corrected camera.
        """


def refit_camera(model: RefinementModel, image: Image, values: np.ndarray) -> RefitRPC:
    """Return the RPC fitted to a corrected camera over its image; without a correction the vendor's RPC.

    Raises `SolveError` if the vendor's RPC has no ground positions there.
    """
    if not np.any(values):
        return RefitRPC(image.rpc, 0.0)
    # The image area in the vendor RPC's image coordinates: a correction of many pixels moves the ground of the image
    # out of the vendor's area, and an RPC fitted there would extrapolate over a part of the image.
    targets = vendors = make_image_grid(image.domain_px, (3, 3))
    area = image.domain_px
    for _ in range(ITERATIONS.most):
        shift = targets - model.project(image, values, image.rpc.localize(vendors, image.rpc.height_off).ground)
        if not np.isfinite(shift).all():
            area = image.domain_px
            break
        vendors = vendors + shift
        low, high = vendors.min(axis=0), vendors.max(axis=0)
        area = float(low[0]), float(high[0]), float(low[1]), float(high[1])
        if np.abs(shift).max() < EQUALITY.rpc_px:
            break
    fit = refit_rpc(
        image.rpc, lambda vendors, ground: model.project(image, values, ground), area, image.rpc.height_range
    )
    return RefitRPC(fit.rpc, fit.max_px)
