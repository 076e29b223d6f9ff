"""Registration of two images from matched points, of the same or of different resolution (thesis chapter 2).

The points of the first image are carried to the second by a transformation whose parameters the points determine:
directly in image space, or after both RPCs have carried them over the ground. What is left over, by kind of point,
shows how well corners and centres can be measured.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from ..foundation.errors import InputError, SolveError
from .registration_options import RegistrationOptions


class TransformationModel(NamedTuple):
    """A family of transformations: number of parameters, and the matrix of least squares.

    fit : of points ``(n, 2)`` of the first and second image and their weights ``(n,)``; returns the homogeneous
    matrix ``(3, 3)``, raises `SolveError` where the points do not determine it
    """

    unknowns: int
    fit: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Registration:
    """A transformation of the first image's points into the second image, and what it leaves over.

    matrix : (3, 3) homogeneous, on ``start_px`` (the points, or where the RPCs carry them)
    residual_px : (n, 2) second - transformed first, also of points left out; used : (n,) mask
    unknowns : number of parameters
    """

    model: str
    matrix: np.ndarray
    residual_px: np.ndarray
    used: np.ndarray
    unknowns: int


@dataclass(frozen=True)
class ResidualSummary:
    """Residuals of one kind of points, as the thesis prints them.

    mean_abs, std : sample and line; distance : sqrt(std² + std²); all times the ``unit`` they were asked in
    """

    count: int
    mean_abs: tuple[float, float]
    std: tuple[float, float]
    distance: float
    largest: float


#: Matrices ``(k, 2, 3)`` that are summed, each times a parameter, to the upper two rows of a transformation.
AFFINE_TERMS = np.eye(6).reshape(6, 2, 3)
CONFORMAL_TERMS = np.array(
    [[[1, 0, 0], [0, 1, 0]], [[0, -1, 0], [1, 0, 0]], [[0, 0, 1], [0, 0, 0]], [[0, 0, 0], [0, 0, 1]]], dtype=np.float64
)


def _fit_linear(first: np.ndarray, second: np.ndarray, weight: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Return the transformation that is linear in its parameters, by one least-squares solution."""
    homogeneous = np.column_stack([first, np.ones(len(first))])
    design = np.einsum("kij,nj->nik", terms, homogeneous).reshape(-1, len(terms))
    root = np.sqrt(np.repeat(weight, 2))
    values, _, rank, _ = np.linalg.lstsq(design * root[:, None], second.ravel() * root, rcond=1e-12)
    if rank < len(terms):
        raise SolveError("the points do not determine the transformation: they lie on a line; add points")
    return np.vstack([np.tensordot(values, terms, 1), [0.0, 0.0, 1.0]])


def _fit_shift(first: np.ndarray, second: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the weighted mean of the shifts, which any points determine."""
    offset = np.average(second - first, axis=0, weights=weight)
    return np.array([[1.0, 0.0, offset[0]], [0.0, 1.0, offset[1]], [0.0, 0.0, 1.0]])


def _fit_projective(first: np.ndarray, second: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the homography with least residuals in the second image, by Gauss-Newton from the affine solution."""
    H = _fit_linear(first, second, weight, AFFINE_TERMS)
    root = np.sqrt(np.repeat(weight, 2))
    for _ in range(20):
        xyw = np.column_stack([first, np.ones(len(first))])
        computed = apply_matrix(H, first)
        w = (xyw @ H[2])[:, None]
        design = np.zeros((2 * len(first), 8))
        design[0::2, :3] = design[1::2, 3:6] = xyw / w
        design[:, 6:] = -(computed.reshape(-1, 1)) * np.repeat(first / w, 2, axis=0)
        miss = (second - computed).ravel()
        step, _, rank, _ = np.linalg.lstsq(design * root[:, None], miss * root, rcond=1e-14)
        if rank < 8:
            raise SolveError("the points do not determine a projective transformation: add points away from one line")
        H = H + np.append(step, 0.0).reshape(3, 3)
        if np.abs(step[[2, 5]]).max() < 1e-9:
            break
    return H


def apply_matrix(H: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return points ``(n, 2)`` transformed by a homogeneous matrix."""
    homogeneous = np.column_stack([xy, np.ones(len(xy))]) @ H.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


REGISTRATION_FORMS: dict[str, TransformationModel] = {
    "shift": TransformationModel(2, _fit_shift),
    "conformal": TransformationModel(4, partial(_fit_linear, terms=CONFORMAL_TERMS)),
    "affine": TransformationModel(6, partial(_fit_linear, terms=AFFINE_TERMS)),
    "projective": TransformationModel(8, _fit_projective),
}


def register_points(
    first_px: np.ndarray,
    second_px: np.ndarray,
    model: str = RegistrationOptions.model,
    sigma_px: np.ndarray | float = 1.0,
    reject_sigma: float = RegistrationOptions.reject_sigma,
    taking_part: np.ndarray | None = None,
) -> Registration:
    """Return the transformation of a `REGISTRATION_FORMS` model of points ``(n, 2)`` of the first image in the second.

    ``reject_sigma`` leaves out points whose residual is that many robust standard deviations, 0 keeps all;
    ``taking_part`` masks the points that determine it, the others only get residuals. Raises `InputError` for an
    unknown model, `SolveError` for too few points or points that do not determine it.
    """
    if model not in REGISTRATION_FORMS:
        raise InputError(f"registration model {model!r} is not one of {', '.join(REGISTRATION_FORMS)}: choose one")
    form = REGISTRATION_FORMS[model]
    sigma = np.broadcast_to(np.asarray(sigma_px, dtype=np.float64), (len(first_px),))
    is_used = np.ones(len(first_px), dtype=bool) if taking_part is None else taking_part.copy()
    allowed = is_used.copy()
    while True:
        matrix, residual = _fit_transformation(form, first_px, second_px, sigma, is_used)
        keep = allowed & _is_inlier(residual, sigma, is_used, reject_sigma)
        if np.array_equal(keep, is_used) or keep.sum() >= is_used.sum():
            return Registration(model, matrix, residual, is_used, form.unknowns)
        is_used = keep


def _fit_transformation(
    form: TransformationModel, first: np.ndarray, second: np.ndarray, sigma: np.ndarray, is_used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix by the points in use, and the residuals ``(n, 2)`` of all points.

    The equations are solved for coordinates about the points' middle, of order 1; a shift needs no such scaling.
    """
    if 2 * is_used.sum() < form.unknowns:
        raise SolveError(f"{is_used.sum()} points are too few for {form.unknowns} parameters: add points")
    a, b, weight = first[is_used], second[is_used], 1.0 / sigma[is_used] ** 2
    if form.unknowns > 2:
        origins, scale = (a.mean(axis=0), b.mean(axis=0)), max(float(np.ptp(a)), 1.0)
        inner = form.fit((a - origins[0]) / scale, (b - origins[1]) / scale, weight)
        matrix = _make_similarity(scale, origins[1]) @ inner @ np.linalg.inv(_make_similarity(scale, origins[0]))
    else:
        matrix = form.fit(a, b, weight)
    matrix = matrix / matrix[2, 2]
    return matrix, second - apply_matrix(matrix, first)


def _make_similarity(scale: float, origin: np.ndarray) -> np.ndarray:
    return np.array([[scale, 0.0, origin[0]], [0.0, scale, origin[1]], [0.0, 0.0, 1.0]])


def _is_inlier(residual: np.ndarray, sigma: np.ndarray, is_used: np.ndarray, reject_sigma: float) -> np.ndarray:
    """Return the mask ``(n,)`` of points within so many robust standard deviations of those in use; 0 keeps all."""
    if reject_sigma <= 0.0:
        return np.ones(len(residual), dtype=bool)
    relative = np.hypot(*residual.T) / sigma
    typical = float(np.median(relative[is_used])) / 1.1774  # median of a Rayleigh distribution
    return relative <= reject_sigma * max(typical, 1e-9)


def summarise_residuals(residual: np.ndarray, unit: float = 1.0) -> ResidualSummary | None:
    """Return the summary of residuals ``(n, 2)`` times ``unit`` (metres per pixel); None without any."""
    values = residual[np.isfinite(residual).all(axis=1)] * unit
    if not len(values):
        return None
    mean_abs, std = np.abs(values).mean(axis=0), values.std(axis=0, ddof=1 if len(values) > 1 else 0)
    return ResidualSummary(
        len(values),
        (float(mean_abs[0]), float(mean_abs[1])),
        (float(std[0]), float(std[1])),
        float(np.hypot(*std)),
        float(np.hypot(*values.T).max()),
    )


GROUPS: dict[str, tuple[str, ...]] = {
    "center": ("center", "centre", "ellipse", "rectangle", "region", "blob"),
    "corner": ("corner", "super"),
}


def choose_group(kind: str) -> str:
    """Return ``center`` or ``corner`` for a kind of point, the kind itself (or ``point``) for others."""
    return next((group for group, kinds in GROUPS.items() if kind.lower() in kinds), kind or "point")


@dataclass(frozen=True, eq=False)
class MethodComparison:
    """Registrations with each kind alone and with all points together (thesis experiments 1 to 3).

    Parameters
    ----------
    alone, together : mapping of str to ResidualSummary
        By group of points, in pixels of the second image times the unit.
    registrations : mapping of str to Registration
        The registrations themselves.
    """

    alone: Mapping[str, ResidualSummary]
    together: Mapping[str, ResidualSummary]
    registrations: Mapping[str, Registration] = field(default_factory=dict)

    def ratio(self, table: str = "alone") -> float | None:
        """Return centre error over corner error.

        Parameters
        ----------
        table : str
            ``alone`` or ``together``.

        Returns
        -------
        float or None
            None where one is missing.
        """
        rows = getattr(self, table)
        if not {"center", "corner"} <= rows.keys() or rows["corner"].distance == 0.0:
            return None
        return float(rows["center"].distance / rows["corner"].distance)


def compare_kinds(
    first_px: np.ndarray,
    second_px: np.ndarray,
    kinds: np.ndarray,
    model: str = RegistrationOptions.model,
    sigma_px: np.ndarray | float = 1.0,
    reject_sigma: float = RegistrationOptions.reject_sigma,
    unit: float = 1.0,
) -> MethodComparison:
    """Return how well each group of points registers two images, alone and together with the others.

    Groups with too few points are left out.

    Parameters
    ----------
    first_px, second_px : (n, 2) ndarray
        Sample, line in both images.
    kinds : (n,) ndarray of str
        Of the points.
    model : str
        One of `REGISTRATION_FORMS`.
    sigma_px : (n,) ndarray or float
        Standard deviations of the measurements.
    reject_sigma : float
        Points farther off are left out; 0 keeps all.
    unit : float
        What one pixel of the second image is in the summaries.

    Returns
    -------
    MethodComparison
        The registrations and their residuals.

    Raises
    ------
    InputError
        The model is not known.
    SolveError
        Even all points together are too few, or lie on a line.
    """
    groups = np.array([choose_group(str(kind)) for kind in kinds])
    members = {group: groups == group for group in sorted(set(groups.tolist()))}
    everything = register_points(first_px, second_px, model, sigma_px, reject_sigma)
    separate = {
        group: register_points(first_px, second_px, model, sigma_px, reject_sigma, in_group)
        for group, in_group in members.items()
        if 2 * in_group.sum() > REGISTRATION_FORMS[model].unknowns
    }
    alone = {group: summarise_residuals(one.residual_px[one.used], unit) for group, one in separate.items()}
    together = {
        group: summarise_residuals(everything.residual_px[in_group & everything.used], unit)
        for group, in_group in members.items()
    }
    return MethodComparison(
        {group: summary for group, summary in alone.items() if summary is not None},
        {group: summary for group, summary in together.items() if summary is not None},
        {"all": everything} | separate,
    )
