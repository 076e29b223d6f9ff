"""How well the positions of a table are known: standard deviations, or a covariance of east, north and height.

``sigma_xy`` and ``sigma_h`` serve most surveys. ``sigma_east`` and ``sigma_north`` may differ; ``corr_en``, ``corr_eh``
and ``corr_nh`` are correlations; ``cov_ee`` to ``cov_nh`` are the elements of a covariance in m², as a network
adjustment prints it. Elements of the covariance win over correlations and sigmas, those over ``sigma_xy``.
"""

import numpy as np

from ...foundation.errors import InputError
from .table import PointTable

ACCURACY_FIELDS = (("cov_ee", "sigma_east"), ("cov_nn", "sigma_north"), ("cov_hh", "sigma_h"))
PAIRS = ((0, 1, "cov_en", "corr_en"), (0, 2, "cov_eh", "corr_eh"), (1, 2, "cov_nh", "corr_nh"))
_MORE_THAN_SIGMAS = {
    "sigma_east",
    "sigma_north",
    "cov_ee",
    "cov_nn",
    "cov_hh",
    *(name for pair in PAIRS for name in pair[2:]),
}


def survey_accuracy(table: PointTable) -> tuple[np.ndarray, np.ndarray | None]:
    """Return sigmas ``(n, 2)`` horizontal and height, and covariances ``(n, 3, 3)`` where the table has more than that.

    NaN where the table says nothing. Raises `InputError` naming row and field of what cannot be.
    """
    horizontal, height = positive(table, "sigma_xy"), positive(table, "sigma_h")
    if not table.columns.keys() & _MORE_THAN_SIGMAS:
        return np.column_stack([horizontal, height]), None
    # The standard deviations of east, north and height ``(n, 3)``
    columns = []
    for axis, (variance, name) in enumerate(ACCURACY_FIELDS):
        sigma = positive(table, name)
        sigma = np.where(np.isnan(sigma) & (axis < 2), horizontal, sigma)
        own = np.sqrt(positive(table, variance))
        columns.append(np.where(np.isnan(own), sigma, own))
    sigma = np.column_stack(columns)
    covariance = np.full((len(table), 3, 3), np.nan)
    covariance[:, range(3), range(3)] = sigma**2
    for row, column, element, correlation in PAIRS:
        value = _covariance(table, sigma[:, row], sigma[:, column], element, correlation)
        covariance[:, row, column] = covariance[:, column, row] = value
    both = np.sqrt((sigma[:, 0] ** 2 + sigma[:, 1] ** 2) / 2.0)
    return np.column_stack([np.where(np.isnan(both), horizontal, both), sigma[:, 2]]), covariance


def positive(table: PointTable, field: str) -> np.ndarray:
    """Return a column of standard deviations or variances, NaN where there is none."""
    values = table.columns.get(field)
    if values is None:
        return np.full(len(table), np.nan)
    wrong = values <= 0.0  # NaN: not given
    if wrong.any():
        row = np.flatnonzero(wrong)[0]
        raise InputError(
            f"{table.name_row(row)}: field {field!r} is {values[row]:g}: give a number above 0 or leave it empty"
        )
    return values


def _covariance(table: PointTable, first: np.ndarray, second: np.ndarray, element: str, correlation: str) -> np.ndarray:
    """Return the covariance of two coordinates with these sigmas ``(n,)``, NaN where none is given."""
    nothing = np.full(len(table), np.nan)
    value, share = table.columns.get(element, nothing), table.columns.get(correlation, nothing)
    with np.errstate(invalid="ignore"):
        share = np.where(np.isnan(value), share, value / (first * second))
    given = ~(np.isnan(value) & np.isnan(table.columns.get(correlation, nothing)))
    field = element if element in table.columns else correlation
    for wrong, why in (
        (given & np.isnan(first * second), "has no standard deviations of both coordinates beside it: add them"),
        (given & ~(np.abs(share) < 1.0), "is no correlation between -1 and 1: correct it or its standard deviations"),
    ):
        if wrong.any():
            raise InputError(f"{table.name_row(np.flatnonzero(wrong)[0])}: field {field!r} {why}")
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(first * second), 0.0, share * first * second)
