"""Parameters of one image's refinement from ground control alone.

Observation equations of the GCPs, linearised by the model (v = observed - computed, A by values, B by ground)::

    P_i = (sigma_i² I + B_i diag(s_xy², s_xy², s_h²) B_i')^-1       image noise and survey noise together
    minimise  sum_i v_i' P_i v_i + sum_k (a_k / s_k)²               with the priors s_k of the parameters

Unknowns are scaled to their priors, a_k = s_k w_k, and the stacked equations are solved by QR, so that nearly
collinear parameters (position and attitude) do no harm. A parameter with prior 0 stays 0. P changes with B a
little: it stays while there is a minimum to find, and the minimum is found again with the P that belongs to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..block.block import Image
from ..block.columns import Columns
from ..foundation.errors import SolveError
from ..foundation.large_arrays import finite_rows
from ..foundation.levenberg_marquardt import CONVERGED, Step, descend
from .direct_rpc import DirectRPC
from .model import LOOSE_ORIENTATION, Linearise, Priors, RefinementModel

ESTIMATE_MAX_ITERATIONS = 30
LINEAR_STEPS = 3  # of the direct methods, before any other
FROM_AFAR, AFAR = 4, 100.0  # steps at most, while residuals are so many sigmas
SLOPES_ONLY = 8  # steps without the model's curvature
CURVATURE_REACH = 0.1  # differences for it, in sigmas of a parameter
LEAST_BEND = 1e-2
HARMLESS = 0.1  # distance from the minimum, in sigmas, of methods that are not iterated
UNSETTLED = 2.0  # how much more the cost may be with the weights that belong to a minimum
WEIGHED = 3  # times that the weights are computed, the start's included
#: With control alone nothing but the GCPs says how large an error is: these only keep the equations regular, for
#: errors up to 0.1 rad (tens of thousands of pixels).
CONTROL_ONLY = Priors(shift_px=1e5, drift=1.0, orientation=LOOSE_ORIENTATION)


@dataclass(frozen=True, eq=False, repr=False)
class Control(Columns):
    """Ground points measured on one image.

    Parameters
    ----------
    ids : (n,) ndarray of str
        Their names.
    ground : (n, 3) ndarray
        Lon, lat in degrees, ellipsoidal height in metres.
    xy : (n, 2) ndarray
        Sample, line in pixels.
    sigma_px : (n,) ndarray
        Of the measurements.
    sigma_m : (n, 2) ndarray
        Of the survey, horizontal and height.
    """

    ids: np.ndarray
    ground: np.ndarray
    xy: np.ndarray
    sigma_px: np.ndarray
    sigma_m: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def create(
        cls, ground: np.ndarray, xy: np.ndarray, ids: np.ndarray | None = None, sigma_px: np.ndarray | float = 0.5,
        sigma_m: np.ndarray | tuple[float, float] = (0.2, 0.3),
    ) -> Control:  # fmt: skip
        """Make columns of matching length.

        Parameters
        ----------
        ground : (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.
        xy : (n, 2) ndarray
            Sample, line in pixels.
        ids : (n,) ndarray of str, optional
            Their names; 1, 2, … by default.
        sigma_px : (n,) ndarray or float
            Of the measurements.
        sigma_m : (n, 2) ndarray or tuple of float
            Of the survey, horizontal and height.

        Returns
        -------
        Control
            The table.
        """
        ground = np.asarray(ground, dtype=np.float64).reshape(-1, 3)
        count = len(ground)
        return cls(
            np.asarray([str(k + 1) for k in range(count)] if ids is None else ids, dtype=str),
            ground,
            np.asarray(xy, dtype=np.float64).reshape(count, 2),
            np.broadcast_to(np.asarray(sigma_px, dtype=np.float64), (count,)),
            np.broadcast_to(np.asarray(sigma_m, dtype=np.float64), (count, 2)),
        )


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated parameters of one image.

    values : (p,); covariance : (p, p) of them, sigma0 included
    residual_px : (n, 2) observed - computed
    left_out_px : (n, 2) what the residual of each point would be had it been left out (exact for linear models)
    roots : (n, 2, 2) whose product R'R is P; share : (n, 2, 2) how much a point decides its own residual (leverage), in
        whitened coordinates
    sigma0 : posterior standard deviation of unit weight; 1 where nothing is redundant
    """

    values: np.ndarray
    covariance: np.ndarray
    residual_px: np.ndarray
    left_out_px: np.ndarray
    roots: np.ndarray
    share: np.ndarray
    sigma0: float
    redundancy: float
    iterations: int
    converged: bool
    status: str

    def __repr__(self) -> str:
        values = ", ".join(f"{value:.6g}" for value in self.values)
        return f"<Estimate [{values}]: sigma0 {self.sigma0:.3f}, {self.status}>"

    @property
    def sigmas(self) -> np.ndarray:
        """Standard deviations of the values, ``(p,)``."""
        return np.sqrt(self.covariance.diagonal())


@dataclass(frozen=True, eq=False)
class _WeightedEquations:
    """Equations at one state.

    values : (p,); roots : (n, 2, 2) of P; matrix : (2n, p) by scaled parameters; right : (2n,); residual : (n, 2) px
    cost : half the weighted sum of squares, priors included
    """

    values: np.ndarray
    roots: np.ndarray
    matrix: np.ndarray
    right: np.ndarray
    residual: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class _Equations:
    """The observation equations of a model and the control of an image, with the priors of the parameters."""

    model: RefinementModel
    image: Image
    control: Control
    linearise: Linearise
    sigmas: np.ndarray

    def select_point(self, index: int) -> _Equations:
        """Return the equations of one control point."""
        control = self.control.select(np.array([index]))
        return replace(self, control=control, linearise=self.model.equations(self.image, control.xy))

    def linearise_at(self, values: np.ndarray, roots: np.ndarray | None = None) -> _WeightedEquations:
        """Return the linearised equations in units of sigmas; ``roots`` of P are those of the state if not given."""
        control = self.control
        at = self.linearise(values, control.ground)
        residual = control.xy - at.computed
        if not (np.isfinite(residual).all() and np.isfinite(at.by_values).all()):
            lost = control.ids[~finite_rows(residual)].tolist()
            raise SolveError(
                f"{self.image.id}: model {self.model.name} has no solution at {', '.join(lost[:8]) or 'a point'}: it "
                "lies outside what the RPC describes; check its coordinates, or choose a simpler `model`"
            )
        if roots is None:
            survey = at.by_ground * control.sigma_m[:, None, [0, 0, 1]]
            covariance = survey @ survey.transpose(0, 2, 1) + control.sigma_px[:, None, None] ** 2 * np.eye(2)
            roots = np.linalg.inv(np.linalg.cholesky(covariance))
        matrix = self._normalize(roots, at.by_values)
        right = np.einsum("nij,nj->ni", roots, residual).ravel()
        cost = 0.5 * float(np.sum(right**2) + np.sum(_scale(values, self.sigmas) ** 2))
        return _WeightedEquations(values, roots, matrix, right, residual, cost)

    def _normalize(self, roots: np.ndarray, by_values: np.ndarray) -> np.ndarray:
        return np.asarray((roots @ by_values).reshape(2 * len(self.control), -1) * self.sigmas)

    def gradient(self, at: _WeightedEquations) -> np.ndarray:
        """Return the downward slope of the cost by the scaled parameters, ``(p,)``."""
        return np.asarray(at.matrix.T @ at.right - _scale(at.values, self.sigmas))

    def compute_hessian(self, at: _WeightedEquations) -> np.ndarray:
        """Return the second derivatives ``(p, p)`` of the cost by the scaled parameters, made positive.

        With A the matrix and r the residuals they are ``A' A + I - sum_i r_i (second derivatives of i)``; the sum by
        differences of A along each parameter. Directions along which the cost is bent downwards count as bent upwards
        as much, and none as less than `LEAST_BEND` of ``A' A + I``: so every step leads down at first (Dauphin et al.
        2014, saddle-free Newton).
        """
        p = len(self.sigmas)
        normal = at.matrix.T @ at.matrix + np.eye(p)
        second = np.empty((p, p))
        for k, reach in enumerate(CURVATURE_REACH / np.sqrt(normal.diagonal())):
            change = np.zeros(p)
            change[k] = reach * self.sigmas[k]
            ahead, behind = (self.linearise(at.values + to, self.control.ground).by_values for to in (change, -change))
            second[k] = self._normalize(at.roots, ahead - behind).T @ at.right / (2.0 * reach)
        half = np.linalg.cholesky(normal)
        inverse = np.linalg.inv(half)
        bends, vectors = np.linalg.eigh(np.eye(p) - inverse @ (0.5 * (second + second.T)) @ inverse.T)
        axes = half @ vectors
        return np.asarray((axes * np.maximum(np.abs(bends), LEAST_BEND)) @ axes.T)


def estimate(model: RefinementModel, image: Image, control: Control, priors: Priors = CONTROL_ONLY) -> Estimate:
    """Return the parameters of a model that fit the control points best.

    Raises `SolveError` where the iteration leaves the domain of the RPC.
    """
    sigmas = model.prior_sigmas(image, priors)
    equations = _Equations(model, image, control, model.equations(image, control.xy), sigmas)
    values, iterations, status = UPDATES.get(model.name, iterate_least_squares)(equations)
    return _compute_estimate(equations.linearise_at(values), sigmas, iterations, status)


def iterate_least_squares(
    equations: _Equations, values: np.ndarray | None = None, steps: int = 0
) -> tuple[np.ndarray, int, str]:
    """Batch iterative least squares, damped where a step makes the fit worse; return values, steps and status.

    ``values`` are where to begin, after so many ``steps``; by default those of the vendor.

    From afar (0.1 rad are tens of thousands of pixels) the first steps take the observations for as bad as they fit, so
    that the priors hold what a few pixels cannot tell apart there. The steps of Gauss and Newton end most problems.
    Where large residuals meet a curved model they converge slowly or not at all; after `SLOPES_ONLY` of them the
    equations have the curvature of the model too.
    """
    sigmas = equations.sigmas
    lost: list[SolveError] = []
    freedom = max(2 * len(equations.control) - int((sigmas > 0.0).sum()), 1)
    compute_hessian = lru_cache(maxsize=1)(equations.compute_hessian)  # a refused step begins at the same place again

    def by_slopes(at: _WeightedEquations, damping: float) -> Step[_WeightedEquations]:
        return try_step(at, _solve(at.matrix, at.right, at.values, sigmas, damping), damping)

    def by_curvature(at: _WeightedEquations, damping: float) -> Step[_WeightedEquations]:
        normal = compute_hessian(at) + damping * np.diag(_diagonal(at.matrix))
        return try_step(at, np.linalg.solve(normal, equations.gradient(at)), damping)

    def try_step(at: _WeightedEquations, by_values: np.ndarray, damping: float) -> Step[_WeightedEquations]:
        braked = 0.5 * damping * float(by_values @ (_diagonal(at.matrix) * by_values))
        promised = 0.5 * float(by_values @ equations.gradient(at)) + braked
        try:
            return Step(equations.linearise_at(at.values + sigmas * by_values, at.roots), promised, braked)
        except SolveError as error:
            lost.append(error)
            return Step(replace(at, cost=np.inf), promised, braked)

    def variance(at: _WeightedEquations) -> float:
        return max(1.0, 2.0 * at.cost / freedom)

    at = equations.linearise_at(np.zeros(len(sigmas)) if values is None else values)
    first = steps
    while steps < first + FROM_AFAR and (misfit := float(np.sqrt(np.mean(at.right**2)))) > AFAR:
        nearer = try_step(at, _solve(at.matrix / misfit, at.right / misfit, at.values, sigmas), 0.0).ahead
        steps += 1
        if not nearer.cost < at.cost:
            break
        at = nearer
    values, slopes_do, settled = at.values, True, np.inf
    for _ in range(WEIGHED):
        at = equations.linearise_at(values)
        unsettled = at.cost > UNSETTLED * settled
        if slopes_do:
            ended = descend(at, by_slopes, variance, min(SLOPES_ONLY, ESTIMATE_MAX_ITERATIONS - steps))
            at, steps, slopes_do = ended.at, steps + ended.steps, ended.converged
        if not slopes_do and steps < ESTIMATE_MAX_ITERATIONS:
            ended = descend(at, by_curvature, variance, ESTIMATE_MAX_ITERATIONS - steps)
            at, steps = ended.at, steps + ended.steps
        values, settled = at.values, at.cost
        if not ended.converged or steps >= ESTIMATE_MAX_ITERATIONS:
            break
    if lost and not ended.converged:
        raise lost[0]
    why = ": with the corrected RPC its control has other weights, and with these it is another RPC"
    return values, steps, ended.status + (why if unsettled and not ended.converged else "")


def iterate_from_linear(equations: _Equations) -> tuple[np.ndarray, int, str]:
    """Begin with what is linear in the coefficients of a rational function, then iterate_least_squares."""
    model, sigmas = equations.model, equations.sigmas
    if not isinstance(model, DirectRPC):
        raise ValueError(f"{type(model).__name__} is no rational function of which the coefficients are estimated")
    linear = replace(equations, linearise=model.linear_equations(equations.image, equations.control.xy))
    at = best = linear.linearise_at(np.zeros(len(sigmas)))
    for _ in range(LINEAR_STEPS):
        at = linear.linearise_at(at.values + sigmas * _solve(at.matrix, at.right, at.values, sigmas), at.roots)
        best = min(best, at, key=lambda place: place.cost)
    return iterate_least_squares(equations, best.values, LINEAR_STEPS)


def estimate_in_one_step(equations: _Equations) -> tuple[np.ndarray, int, str]:
    """Sequential least squares: one update of the old solution by all new observations, linearised at the old one."""
    sigmas = equations.sigmas
    values = np.zeros(len(sigmas))
    at = equations.linearise_at(values)
    values = sigmas * _solve(at.matrix, at.right, values, sigmas)
    return values, 1, _describe_single_pass(equations, values)


def estimate_by_kalman_filter(equations: _Equations) -> tuple[np.ndarray, int, str]:
    """Incremental discrete Kalman filter: each GCP updates state and covariance, linearised at the state before it."""
    sigmas = equations.sigmas
    values, covariance = np.zeros(len(sigmas)), np.eye(len(sigmas))
    for index in range(len(equations.control)):
        at = equations.select_point(index).linearise_at(values)
        innovation = at.matrix @ covariance @ at.matrix.T + np.eye(2)
        gain = np.linalg.solve(innovation, at.matrix @ covariance).T
        values = values + sigmas * (gain @ at.right)
        covariance = covariance - gain @ at.matrix @ covariance
        covariance = (covariance + covariance.T) / 2.0
    return values, len(equations.control), _describe_single_pass(equations, values)


def _describe_single_pass(equations: _Equations, values: np.ndarray) -> str:
    """Return the status of a method that passes over the points once: converged where that leads to the minimum."""
    at = equations.linearise_at(values)
    step = _solve(at.matrix, at.right, values, equations.sigmas)
    freedom = max(2 * len(equations.control) - len(values), 1)
    away = float(np.sqrt(max(step @ equations.gradient(at), 0.0) / max(1.0, 2.0 * at.cost / freedom)))
    return CONVERGED if away < HARMLESS else f"passed over the points once, {away:.2g} sigma from the minimum"


#: How the models that are not estimated by `iterate_least_squares` are: by the name of the model.
UPDATES: dict[str, Callable[..., tuple[np.ndarray, int, str]]] = {
    **dict.fromkeys(("direct", "bils", "pg", "upoe"), iterate_from_linear),
    "slss": estimate_in_one_step,
    "idkf": estimate_by_kalman_filter,
}


def _scale(values: np.ndarray, sigmas: np.ndarray) -> np.ndarray:
    """Return values in units of their priors, 0 for fixed ones."""
    return np.divide(values, sigmas, out=np.zeros_like(values), where=sigmas > 0.0)


def _diagonal(matrix: np.ndarray) -> np.ndarray:
    """Return the diagonal of the normal equations of scaled parameters, priors included."""
    return np.asarray(np.sum(matrix**2, axis=0) + 1.0)


def _solve(
    matrix: np.ndarray, right: np.ndarray, values: np.ndarray, sigmas: np.ndarray, damping: float = 0.0
) -> np.ndarray:
    """Return the step of the scaled parameters, their priors (towards zero values) included."""
    p = len(sigmas)
    if not p:
        return np.zeros(0)
    brake = np.diag(np.sqrt(damping * _diagonal(matrix)))
    stacked = np.vstack([matrix, np.eye(p), brake])
    target = np.concatenate([right, -_scale(values, sigmas), np.zeros(p)])
    return np.asarray(np.linalg.lstsq(stacked, target, rcond=None)[0])


def _compute_estimate(at: _WeightedEquations, sigmas: np.ndarray, iterations: int, status: str) -> Estimate:
    """Return precision, redundancy and leave-one-out residuals at the solution."""
    count, p = len(at.residual), len(sigmas)
    triangle = np.linalg.qr(np.vstack([at.matrix, np.eye(p)]), mode="r")
    inverse = np.linalg.inv(triangle) if p else np.zeros((0, 0))
    rows = (at.matrix @ inverse).reshape(count, 2, p)
    share = rows @ rows.transpose(0, 2, 1)
    whitened = np.einsum("nij,nj->ni", at.roots, at.residual)
    redundancy = float(2 * count - np.einsum("nii->", share))
    sigma0 = float(np.sqrt(np.sum(whitened**2) / redundancy)) if redundancy > 0.5 else 1.0
    # Symmetric matrices whose eigenvalues are at least ``least``: a point that alone decides has none
    eigenvalues, vectors = np.linalg.eigh(np.eye(2) - share)
    not_below = np.einsum("nij,nj,nkj->nik", vectors, np.maximum(eigenvalues, 1e-9), vectors)
    left_out = np.linalg.solve(not_below, whitened[:, :, None])
    return Estimate(
        values=at.values,
        covariance=(spread := sigma0 * sigmas[:, None] * inverse) @ spread.T,
        residual_px=at.residual,
        left_out_px=np.linalg.solve(at.roots, left_out)[:, :, 0],
        roots=at.roots,
        share=share,
        sigma0=sigma0,
        redundancy=redundancy,
        iterations=iterations,
        converged=status == CONVERGED,
        status=status,
    )
