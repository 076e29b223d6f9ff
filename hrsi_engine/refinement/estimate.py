"""Estimation of the parameters of one image from its GCPs.

Observation equations of the GCPs, linearised by the model (v = observed - computed, A by values, B by ground)::

    P_i = (sigma_i² I + B_i diag(s_xy², s_xy², s_h²) B_i')^-1       image and survey errors
    minimise  sum_i v_i' P_i v_i + sum_k (a_k / s_k)²               with the priors s_k of the parameters

Unknowns are scaled to their priors, a_k = s_k w_k, and the stacked equations are solved by QR, so that nearly collinear
parameters (position and attitude) stay accurate. A parameter with prior 0 stays 0. P depends weakly on the values
through B: it is constant in an iteration, which is repeated with the P of its solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ..block.block import Image
from ..block.columns import Columns
from ..foundation.errors import SolveError
from ..foundation.large_arrays import finite_rows
from ..foundation.levenberg_marquardt import CONVERGED, Step, descend
from ..foundation.thresholds import EQUALITY, ITERATIONS, REDUNDANCY, threshold, thresholds
from .model import LOOSE_ORIENTATION, Linearise, Priors, RefinementModel

#: Data with which the limits of the iterations were determined.
TUNED_ON = "thesis, SPOT 5 rotated by up to 100 mrad, and IKONOS, 2026-11-22 (tests/refinement/test_convergence.py)"


@thresholds
class ESTIMATION:
    """Limits of the iterations that estimate the parameters of one image."""

    large_residual: float = threshold(100.0, "sigma", "RMS residual above which weights are reduced", TUNED_ON)
    gauss_newton_steps: int = threshold(8, "steps", "Gauss-Newton steps before second derivatives are used", TUNED_ON)


#: Priors for an image with GCPs only: they serve to keep the equations regular, for errors up to 0.1 rad (tens of
#: thousands of pixels).
CONTROL_ONLY = Priors(shift_px=1e5, drift=1.0, orientation=LOOSE_ORIENTATION)


@dataclass(frozen=True, eq=False, repr=False)
class Control(Columns):
    """Ground points measured on one image.

    Parameters
    ----------
    ground : (n, 3) ndarray
        Lon, lat in degrees, ellipsoidal height in metres.
    xy : (n, 2) ndarray
        Sample, line in pixels.
    ids : (n,) ndarray of str
        Names of the points; 1, 2, … by default.
    sigma_px : (n,) ndarray
        Standard deviations of the measurements.
    sigma_m : (n, 2) ndarray
        Standard deviations of the survey, horizontal and height.
    """

    ground: np.ndarray
    xy: np.ndarray
    ids: np.ndarray = ""  # type: ignore[assignment]  # numbers by default
    sigma_px: np.ndarray = 0.5  # type: ignore[assignment]  # one value for all becomes an array
    sigma_m: np.ndarray = (0.2, 0.3)  # type: ignore[assignment]

    if TYPE_CHECKING:  # single values and sequences become columns

        def __init__(self, *columns: Any, **named: Any) -> None: ...

    def __post_init__(self) -> None:
        if not np.ndim(self.ids):
            object.__setattr__(self, "ids", [str(number + 1) for number in range(len(self.ground))])
        self._fill(
            ground=(np.float64, (3,)),
            xy=(np.float64, (2,)),
            ids=(str, ()),
            sigma_px=(np.float64, ()),
            sigma_m=(np.float64, (2,)),
        )

    def __len__(self) -> int:
        return len(self.ground)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated parameters of one image.

    values : (p,); covariance : (p, p) covariance matrix of the values, scaled by sigma0
    residual_px : (n, 2) observed - computed
    left_out_px : (n, 2) leave-one-out residuals (exact for linear models)
    roots : (n, 2, 2) R with R'R = P; share : (n, 2, 2) leverage of each point
    sigma0 : a posteriori standard deviation of unit weight; 1 without redundancy
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
class EquationState:
    """Weighted observation equations, linearised at ``values``.

    values : (p,); roots : (n, 2, 2) R with R'R = P; matrix : (2n, p) R A for scaled parameters; right : (2n,) R v
    residual : (n, 2) v, px; cost : half the weighted sum of squares, priors included
    """

    values: np.ndarray
    roots: np.ndarray
    matrix: np.ndarray
    right: np.ndarray
    residual: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class ObservationEquations:
    """The observation equations of a model and the control of an image, with the priors of the parameters."""

    model: RefinementModel
    image: Image
    control: Control
    linearise: Linearise
    sigmas: np.ndarray

    def linearise_at(self, values: np.ndarray, roots: np.ndarray | None = None) -> EquationState:
        """Return the weighted equations at ``values (p,)``.

        roots : (n, 2, 2) R of P = R'R, by default those at the values
        Raises `SolveError` if a point has no position in the corrected image: it names the GCPs.
        """
        control = self.control
        equations = self.linearise(values, control.ground)
        residual = control.xy - equations.computed
        if not (np.isfinite(residual).all() and np.isfinite(equations.by_values).all()):
            missing = control.ids[~finite_rows(residual)].tolist()
            raise SolveError(
                f"{self.image.id}: model {self.model.name} has no solution at {', '.join(missing[:8]) or 'a point'}: "
                "the "
                "point is outside the validity range of the RPC; check its coordinates, or choose a simpler `model`"
            )
        if roots is None:
            survey = equations.by_ground * control.sigma_m[:, None, [0, 0, 1]]
            covariance = survey @ survey.transpose(0, 2, 1) + control.sigma_px[:, None, None] ** 2 * np.eye(2)
            roots = np.linalg.inv(np.linalg.cholesky(covariance))
        matrix = self._normalize(roots, equations.by_values)
        right = np.einsum("nij,nj->ni", roots, residual).ravel()
        cost = 0.5 * float(np.sum(right**2) + np.sum(_scale(values, self.sigmas) ** 2))
        return EquationState(values, roots, matrix, right, residual, cost)

    def _normalize(self, roots: np.ndarray, by_values: np.ndarray) -> np.ndarray:
        """Return R A for scaled parameters, ``(2n, p)``, of the derivatives A ``by_values (n, 2, p)``."""
        return np.asarray((roots @ by_values).reshape(2 * len(self.control), -1) * self.sigmas)

    def gradient(self, state: EquationState) -> np.ndarray:
        """Return the negative gradient of the cost by the scaled parameters, ``(p,)``."""
        return np.asarray(state.matrix.T @ state.right - _scale(state.values, self.sigmas))

    def compute_hessian(self, state: EquationState) -> np.ndarray:
        """Return the Hessian ``(p, p)`` of the cost by the scaled parameters, made positive definite.

        With A the matrix and r the residuals it is ``A' A + I - sum_i r_i H_i``; the sum by differences of A along each
        parameter. Its eigenvalues relative to ``A' A + I`` are replaced by their absolute values, at least
        `REDUNDANCY.regularised`, so that every step descends (saddle-free Newton, Dauphin et al. 2014).
        """
        p = len(self.sigmas)
        normal = state.matrix.T @ state.matrix + np.eye(p)
        second = np.empty((p, p))
        for k, reach in enumerate(EQUALITY.negligible / np.sqrt(normal.diagonal())):
            change = np.zeros(p)
            change[k] = reach * self.sigmas[k]
            ahead, behind = (
                self.linearise(state.values + column, self.control.ground).by_values for column in (change, -change)
            )
            second[k] = self._normalize(state.roots, ahead - behind).T @ state.right / (2.0 * reach)
        half = np.linalg.cholesky(normal)
        inverse = np.linalg.inv(half)
        bends, vectors = np.linalg.eigh(np.eye(p) - inverse @ (0.5 * (second + second.T)) @ inverse.T)
        axes = half @ vectors
        return np.asarray((axes * np.maximum(np.abs(bends), REDUNDANCY.regularised)) @ axes.T)


#: From the equations of an image to values ``(p,)``, number of steps and status; a model can have its own as `solve`.
Estimator = Callable[[ObservationEquations], tuple[np.ndarray, int, str]]


def estimate(model: RefinementModel, image: Image, control: Control, priors: Priors = CONTROL_ONLY) -> Estimate:
    """Return the least-squares estimate of a model's parameters from control points.

    model : its `solve`, if it has one, replaces `iterate_least_squares`
    priors : standard deviations of the parameters, by default so large that they only keep the equations regular
    Result: its ``converged`` is false if the iteration did not converge.
    Raises `SolveError` if the iteration leaves the domain of the RPC.
    """
    sigmas = model.prior_sigmas(image, priors)
    equations = ObservationEquations(model, image, control, model.equations(image, control.xy), sigmas)
    solver: Estimator = getattr(model, "solve", iterate_least_squares)
    values, iterations, status = solver(equations)
    # Precision, redundancy and leave-one-out residuals at the solution
    minimum = equations.linearise_at(values)
    count, p = len(minimum.residual), len(sigmas)
    triangle = np.linalg.qr(np.vstack([minimum.matrix, np.eye(p)]), mode="r")
    inverse = np.linalg.inv(triangle) if p else np.zeros((0, 0))
    rows = (minimum.matrix @ inverse).reshape(count, 2, p)
    share = rows @ rows.transpose(0, 2, 1)
    whitened = np.einsum("nij,nj->ni", minimum.roots, minimum.residual)
    redundancy = float(2 * count - np.einsum("nii->", share))
    sigma0 = float(np.sqrt(np.sum(whitened**2) / redundancy)) if redundancy > 0.5 else 1.0
    # I minus leverage, with eigenvalues of at least 1e-9: they are 0 for a point that alone determines a parameter
    eigenvalues, vectors = np.linalg.eigh(np.eye(2) - share)
    not_below = np.einsum("nij,nj,nkj->nik", vectors, np.maximum(eigenvalues, 1e-9), vectors)
    left_out = np.linalg.solve(not_below, whitened[:, :, None])
    return Estimate(
        values=minimum.values,
        covariance=(spread := sigma0 * sigmas[:, None] * inverse) @ spread.T,
        residual_px=minimum.residual,
        left_out_px=np.linalg.solve(minimum.roots, left_out)[:, :, 0],
        roots=minimum.roots,
        share=share,
        sigma0=sigma0,
        redundancy=redundancy,
        iterations=iterations,
        converged=status == CONVERGED,
        status=status,
    )


def iterate_least_squares(
    equations: ObservationEquations, values: np.ndarray | None = None, steps: int = 0
) -> tuple[np.ndarray, int, str]:
    """Iterate damped least squares (Levenberg-Marquardt) over all points; return values, steps and status.

    Begins with ``values`` (zero by default), after ``steps`` steps taken before. While residuals are very large (0.1
    rad are tens of thousands of pixels) the first steps scale the weights to the fit, so that the priors separate
    collinear parameters. Gauss-Newton steps solve most problems; with large residuals and a nonlinear model they
    converge slowly or not at all, so that after `ESTIMATION.gauss_newton_steps` the full Hessian is used.
    """
    sigmas = equations.sigmas
    failures: list[SolveError] = []
    freedom = max(2 * len(equations.control) - int((sigmas > 0.0).sum()), 1)
    compute_hessian = lru_cache(maxsize=1)(equations.compute_hessian)  # a rejected step is repeated from the same state

    def step_gauss_newton(state: EquationState, damping: float) -> Step[EquationState]:
        return try_step(state, solve_step(state.matrix, state.right, state.values, sigmas, damping), damping)

    def step_newton(state: EquationState, damping: float) -> Step[EquationState]:
        normal = compute_hessian(state) + damping * np.diag(_diagonal(state.matrix))
        return try_step(state, np.linalg.solve(normal, equations.gradient(state)), damping)

    def try_step(state: EquationState, by_values: np.ndarray, damping: float) -> Step[EquationState]:
        """Return the step to ``state.values + sigmas * by_values``; its cost is infinite outside the RPC's domain."""
        damping_term = 0.5 * damping * float(by_values @ (_diagonal(state.matrix) * by_values))
        predicted_decrease = 0.5 * float(by_values @ equations.gradient(state)) + damping_term
        try:
            ahead = equations.linearise_at(state.values + sigmas * by_values, state.roots)
        except SolveError as error:
            failures.append(error)
            ahead = replace(state, cost=np.inf)
        return Step(ahead, predicted_decrease, damping_term)

    def variance(state: EquationState) -> float:
        return max(1.0, 2.0 * state.cost / freedom)

    state = equations.linearise_at(np.zeros(len(sigmas)) if values is None else values)
    for _ in range(ESTIMATION.gauss_newton_steps):  # the others remain for the descent
        misfit = float(np.sqrt(np.mean(state.right**2)))
        if misfit <= ESTIMATION.large_residual:
            break
        scaled = solve_step(state.matrix / misfit, state.right / misfit, state.values, sigmas)
        candidate, steps = try_step(state, scaled, 0.0).ahead, steps + 1
        if not candidate.cost < state.cost:
            break
        state = candidate
    values, gauss_newton_converges, previous_cost = state.values, True, np.inf
    for _ in range(ITERATIONS.repeated):
        state = equations.linearise_at(values)
        unsettled = state.cost > previous_cost
        if gauss_newton_converges:
            limit = min(ESTIMATION.gauss_newton_steps, ITERATIONS.most - steps)
            ended = descend(state, step_gauss_newton, variance, limit)
            state, steps, gauss_newton_converges = ended.at, steps + ended.steps, ended.converged
        if not gauss_newton_converges and steps < ITERATIONS.most:
            ended = descend(state, step_newton, variance, ITERATIONS.most - steps)
            state, steps = ended.at, steps + ended.steps
        values, previous_cost = state.values, state.cost
        if not ended.converged or steps >= ITERATIONS.most:
            break
    if failures and not ended.converged:
        raise failures[0]
    reason = ": the weights of the GCPs and the corrected RPC depend on each other, and do not converge"
    return values, steps, ended.status + (reason if unsettled and not ended.converged else "")


def _scale(values: np.ndarray, sigmas: np.ndarray) -> np.ndarray:
    """Return ``values (p,)`` in units of their prior standard deviations ``sigmas (p,)``; 0 for fixed parameters."""
    return np.divide(values, sigmas, out=np.zeros_like(values), where=sigmas > 0.0)


def _diagonal(matrix: np.ndarray) -> np.ndarray:
    """Return the diagonal ``(p,)`` of the normal equations ``matrix' matrix + I`` of scaled parameters."""
    return np.asarray(np.sum(matrix**2, axis=0) + 1.0)


def solve_step(
    matrix: np.ndarray, right: np.ndarray, values: np.ndarray, sigmas: np.ndarray, damping: float = 0.0
) -> np.ndarray:
    """Return the damped step of the scaled parameters ``(p,)``, whose priors (unit weight) draw the values to zero.

    The equations R A, the priors and the damping are stacked and solved without their normal equations.

    matrix, right : (2n, p) R A and (2n,) R v; values, sigmas : (p,) present values, and prior standard deviations
    damping : factor of the diagonal of the normal equations
    """
    p = len(sigmas)
    if not p:
        return np.zeros(0)
    brake = np.diag(np.sqrt(damping * _diagonal(matrix)))
    stacked = np.vstack([matrix, np.eye(p), brake])
    target = np.concatenate([right, -_scale(values, sigmas), np.zeros(p)])
    return np.asarray(np.linalg.lstsq(stacked, target, rcond=None)[0])
