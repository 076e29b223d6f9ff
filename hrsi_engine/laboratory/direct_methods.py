"""Direct methods: new values of the RPC's own coefficients (thesis section 4.2.2).

The 78 coefficients (20 + 19 of sample, 20 + 19 of line; the constants of the denominators stay) are corrected by
``L w``, where ``L L'`` is a prior covariance C of the coefficients and the parameters w are standard normal before any
observation. So every method is the same model with another C, and the same equations serve an estimation in one batch,
point by point, or in one step. With N the normal matrix of the coefficients from the RPC's own virtual grid
(10 x 10 x 5: image points at several heights, weighted so that together they determine the image to 20 px):

| method   | source               | information C^-1                          | estimation                          |
|----------|----------------------|-------------------------------------------|-------------------------------------|
| `direct` | Di et al. 2003       | diagonal, 1 and 0.01: nearly nothing      | batch, iterated                     |
| `bils`   | Hu and Tao 2002      | N                                         | batch, iterated                     |
| `idkf`   | Hu and Tao 2002      | the same                                  | Kalman filter, one GCP at a time    |
| `pg`     | Bang et al. 2003     | N of few pseudo GCPs, 3 x 3 x 3           | batch, iterated                     |
| `upoe`   | Bang et al. 2003     | diagonal, 20 px each                      | batch, iterated                     |
| `slss`   | Bang et al. 2003     | N                                         | one update of the old solution      |

What the sources leave open is in `DIRECT_METHOD`. The covariance of the coefficients, which no vendor gives, comes from
the virtual grid, unless the user has one (`coefficient_covariance` of `refine-rpc`, `with_covariance`). It describes
the *systematic* error of a vendor's RPC, about 20 px, not the noise of the fit: otherwise no GCP could move the image.
Pseudo GCPs weigh as much together. A parameter observation is as good as its effect in the image at the edge of the
normalised domain, again 20 px.
Eigenvalues of the information are at least `DIRECT_METHOD.least_eigenvalue` of the largest: numerators and denominators
are nearly collinear, and left free they give the RPC poles between the GCPs; for the same reason `direct`, without
other information, takes a prior by which a denominator changes by a few hundredths over the image. Coefficients of
equal denominators are corrected separately.

Iteration begins with what is linear. With the denominators D of the last step and y what was observed, the equations
``(y D(w) - N(w)) / D`` have no poles (Sanathanan and Koerner 1963); their solution is near that of y - N(w) / D(w),
whose own linearisation at the vendor's values may lead anywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..block.block import Image
from ..camera.rpc import RPC
from ..camera.rpc_fit import make_virtual_grid
from ..camera.rpc_terms import monomials
from ..foundation.errors import InputError
from ..foundation.levenberg_marquardt import CONVERGED
from ..foundation.thresholds import threshold, thresholds
from ..refinement.estimate import Estimator, ObservationEquations, iterate_least_squares, solve_step
from ..refinement.model import Equations, Linearise, Priors, RefitRPC
from ..refinement.model_table import DIRECT_TABLE, make_models

COEFFICIENTS = 78
SLICES = {"samp_num": slice(0, 20), "samp_den": slice(20, 39), "line_num": slice(39, 59), "line_den": slice(59, 78)}


@thresholds
class DIRECT_METHOD:
    """A priori standard deviations and limits of the direct methods."""

    systematic_px: float = threshold(
        20.0, "px", "systematic error of a vendor's RPC: a priori sigma of its coefficients"
    )
    denominator_sigma: float = threshold(0.01, "", "sigma of the denominators' coefficients for `direct`")
    least_eigenvalue: float = threshold(1e-4, "", "smallest eigenvalue of the information over the largest one")
    linear_steps: int = threshold(3, "steps", "steps with linear equations before the others")
    harmless_sigmas: float = threshold(
        0.1, "sigma", "distance from the minimum up to which a single pass has converged"
    )


Information = Callable[[Image], np.ndarray]


@dataclass(frozen=True, eq=False)
class DirectRPC:
    """A direct method; ``information`` gives C^-1 ``(78, 78)`` of an image's normalised coefficients."""

    name: str
    title: str
    information: Information
    parameters: tuple[str, ...] = tuple(f"w_{k + 1}" for k in range(COEFFICIENTS))
    least_points: int = 1
    solve: Estimator = iterate_least_squares
    least_eigenvalue: float = DIRECT_METHOD.least_eigenvalue
    roots: dict[tuple[str, RPC], np.ndarray] = field(default_factory=dict, repr=False)

    @property
    def drifts(self) -> np.ndarray:
        """None that is separate from the rest, ``(p,)``."""
        return np.zeros(COEFFICIENTS, dtype=bool)

    def prior_sigmas(self, image: Image, priors: Priors) -> np.ndarray:
        """Return ones: the prior covariance is in the parameters' definition."""
        return np.ones(COEFFICIENTS)

    def with_covariance(self, covariance: np.ndarray) -> DirectRPC:
        """Return the method with a given covariance ``(78, 78)`` of the normalised coefficients (order: `SLICES`).

        It is used as it is, without a least eigenvalue. Raises `InputError` where it is not symmetric and positive
        definite.
        """
        covariance = np.asarray(covariance, dtype=np.float64)
        if covariance.shape != (COEFFICIENTS, COEFFICIENTS) or not np.allclose(covariance, covariance.T):
            raise InputError(f"covariance of shape {covariance.shape}: a symmetric (78, 78) matrix is needed")
        try:
            root = np.linalg.inv(np.linalg.cholesky(covariance))
        except np.linalg.LinAlgError:
            raise InputError("the covariance of the coefficients is not positive definite: check its order") from None
        return replace(self, information=lambda image: root.T @ root, least_eigenvalue=0.0, roots={})

    def equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the observation equations; they do not depend on where the points were observed."""
        return self._linearise(image, None)

    def linear_equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the equations times the denominators, over those of the values: see the module's text."""
        return self._linearise(image, observed_px)

    def _linearise(self, image: Image, derived_at_px: np.ndarray | None) -> Linearise:
        """Return the equations with derivatives at image points ``(n, 2)``, or where the values compute them."""
        root = self._root(image)

        def linearise(values: np.ndarray, ground: np.ndarray) -> Equations:
            rpc = correct_coefficients(image.rpc, root @ values)
            computed, by_ground = rpc.project_with_metric_jacobian(ground)
            image_points = computed if derived_at_px is None else derived_at_px
            return Equations(computed, differentiate_by_coefficients(rpc, ground, image_points) @ root, by_ground)

        return linearise

    def project(self, image: Image, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return the projection with the new coefficients."""
        return self.compute_refined_rpc(image, values).rpc.project(ground)

    def compute_refined_rpc(self, image: Image, values: np.ndarray) -> RefitRPC:
        """Return the RPC with the new coefficients: exact."""
        changed = np.any(values)
        return RefitRPC(correct_coefficients(image.rpc, self._root(image) @ values) if changed else image.rpc, 0.0)

    def _root(self, image: Image) -> np.ndarray:
        """Return L; kept, because every pass asks for it again."""
        key = (image.id, image.rpc)
        if key not in self.roots:
            self.roots.clear()
            eigenvalues, vectors = np.linalg.eigh(self.information(image))
            self.roots[key] = vectors / np.sqrt(np.maximum(eigenvalues, self.least_eigenvalue * eigenvalues[-1]))
        return self.roots[key]


def correct_coefficients(rpc: RPC, change: np.ndarray) -> RPC:
    """Return an RPC with its coefficients changed by ``(78,)``, in the order of `SLICES`."""
    changes = {name: change[part] for name, part in SLICES.items()}  # 20, or 19 without a denominator's constant
    return replace(rpc, **{name: getattr(rpc, name) + np.pad(one, (20 - len(one), 0)) for name, one in changes.items()})


def differentiate_by_coefficients(rpc: RPC, ground: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return the derivatives ``(n, 2, 78)`` of image points ``xy (n, 2)`` by the coefficients, px."""
    terms = monomials(rpc.normalise(ground)).T
    ratios = (xy - [rpc.samp_off, rpc.line_off]) / [rpc.samp_scale, rpc.line_scale]
    denominators = rpc.denominators(ground).T
    result = np.zeros((len(ground), 2, COEFFICIENTS))
    for axis, (scale, names) in enumerate(
        ((rpc.samp_scale, ("samp_num", "samp_den")), (rpc.line_scale, ("line_num", "line_den")))
    ):
        relative = scale * terms / denominators[:, axis, None]
        result[:, axis, SLICES[names[0]]] = relative
        result[:, axis, SLICES[names[1]]] = -ratios[:, axis, None] * relative[:, 1:]
    return result


def _virtual_information(image: Image, shape: tuple[int, int, int]) -> np.ndarray:
    """Return the normal matrix of the coefficients from a virtual grid over the image."""
    xy, (ground, converged) = make_virtual_grid(image.rpc, image.domain_px, image.rpc.height_range, shape)
    sigma_px = DIRECT_METHOD.systematic_px * np.sqrt(np.count_nonzero(converged))
    matrix = (
        differentiate_by_coefficients(image.rpc, ground[converged], xy[converged]).reshape(-1, COEFFICIENTS) / sigma_px
    )
    return np.asarray(matrix.T @ matrix)


def _loose_information(_image: Image) -> np.ndarray:
    """Return the information of coefficients of which only the size is known: of order 1, denominators nearly 1."""
    sigma = np.ones(COEFFICIENTS)
    sigma[SLICES["samp_den"]] = sigma[SLICES["line_den"]] = DIRECT_METHOD.denominator_sigma
    return np.diag(1.0 / sigma**2)


def _parameter_information(image: Image) -> np.ndarray:
    """Return the weights of observed coefficients: each as good as its effect in the image."""
    effect = np.repeat(np.abs([image.rpc.samp_scale, image.rpc.line_scale]), COEFFICIENTS // 2)
    return np.diag((effect / DIRECT_METHOD.systematic_px) ** 2)


def iterate_from_linear(equations: ObservationEquations) -> tuple[np.ndarray, int, str]:
    """Solve the equations that are linear in the coefficients, then iterate the others from there."""
    model, sigmas = equations.model, equations.sigmas
    if not isinstance(model, DirectRPC):
        raise ValueError(f"{type(model).__name__} is no rational function of which the coefficients are estimated")
    linear = replace(equations, linearise=model.linear_equations(equations.image, equations.control.xy))
    state = best = linear.linearise_at(np.zeros(len(sigmas)))
    for _ in range(DIRECT_METHOD.linear_steps):
        state = linear.linearise_at(
            state.values + sigmas * solve_step(state.matrix, state.right, state.values, sigmas), state.roots
        )
        best = min(best, state, key=lambda place: place.cost)
    return iterate_least_squares(equations, best.values, DIRECT_METHOD.linear_steps)


def estimate_in_one_step(equations: ObservationEquations) -> tuple[np.ndarray, int, str]:
    """Sequential least squares: one update of the old solution by all new observations, linearised at the old one."""
    sigmas = equations.sigmas
    state = equations.linearise_at(np.zeros(len(sigmas)))
    values = sigmas * solve_step(state.matrix, state.right, state.values, sigmas)
    return values, 1, _describe_single_pass(equations, values)


def estimate_by_kalman_filter(equations: ObservationEquations) -> tuple[np.ndarray, int, str]:
    """Incremental discrete Kalman filter: each GCP updates state and covariance, linearised at the state before it."""
    sigmas = equations.sigmas
    values, covariance = np.zeros(len(sigmas)), np.eye(len(sigmas))
    for index in range(len(equations.control)):
        gcp = equations.control.select(np.array([index]))
        update = replace(equations, control=gcp, linearise=equations.model.equations(equations.image, gcp.xy))
        state = update.linearise_at(values)
        innovation = state.matrix @ covariance @ state.matrix.T + np.eye(2)
        gain = np.linalg.solve(innovation, state.matrix @ covariance).T
        values = values + sigmas * (gain @ state.right)
        covariance = covariance - gain @ state.matrix @ covariance
        covariance = (covariance + covariance.T) / 2.0
    return values, len(equations.control), _describe_single_pass(equations, values)


def _describe_single_pass(equations: ObservationEquations, values: np.ndarray) -> str:
    """Return the status of a method with a single pass: converged if it ends near the minimum."""
    state = equations.linearise_at(values)
    step = solve_step(state.matrix, state.right, values, equations.sigmas)
    freedom = max(2 * len(equations.control) - len(values), 1)
    distance_sigmas = float(np.sqrt(max(step @ equations.gradient(state), 0.0) / max(1.0, 2.0 * state.cost / freedom)))
    note = f"passed over the points once, {distance_sigmas:.2g} sigma from the minimum"
    return CONVERGED if distance_sigmas < DIRECT_METHOD.harmless_sigmas else note


#: Estimation of the methods that do not iterate from the linear equations.
_SOLVERS: dict[str, Estimator] = {"slss": estimate_in_one_step, "idkf": estimate_by_kalman_filter}


def _make_method(name: str, title: str, information: Information) -> DirectRPC:
    """Return a direct method with its own estimation, or the iteration from the linear equations."""
    return DirectRPC(name, title, information, solve=_SOLVERS.get(name, iterate_from_linear))


_MAKERS: dict[str, Callable[..., DirectRPC]] = {
    "loose": lambda name, title: _make_method(name, title, _loose_information),
    "grid": lambda name, title, shape: _make_method(name, title, lambda image: _virtual_information(image, shape)),
    "coefficients": lambda name, title: _make_method(name, title, _parameter_information),
}
DIRECT = make_models(DIRECT_TABLE, _MAKERS)
