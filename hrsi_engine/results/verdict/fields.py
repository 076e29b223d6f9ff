"""Systematic residuals of an image: shift, drift, affine or quadratic terms that the model does not contain.

Polynomials of the image position, with the monomials of the image-space models, are fitted to the residuals of each
image. An F test decides whether a polynomial is significant, and its RMS whether it is large enough to matter.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from ...adjustment.result import Adjustment
from ...foundation.thresholds import SAMPLES, SIGNIFICANCE, threshold, thresholds
from ...refinement.image_space import IMAGE_SPACE
from ..residuals import by_image


@thresholds
class FIELD:
    """Limits for systematic patterns (fields) in the residuals of images."""

    equal_share: float = threshold(
        0.8, "", "share of the squares explained by the largest model that a simpler model needs"
    )


NESTED = ("shift", "shift-drift", "affine", "quadratic")  # from few parameters to many
MONOMIALS = IMAGE_SPACE[NESTED[-1]].powers.tolist()  # includes those of all others
COLUMNS_OF_MODEL = {name: [MONOMIALS.index(powers) for powers in IMAGE_SPACE[name].powers.tolist()] for name in NESTED}


@dataclass(frozen=True)
class ResidualField:
    """Systematic field of an image: RMS (2D) of the field in px, and the model that removes it."""

    image: str
    rms_px: float
    model: str


def find_residual_fields(result: Adjustment, selected: np.ndarray, residual_px: np.ndarray) -> list[ResidualField]:
    """Return the significant fields of the ``selected`` measurements (mask) in residuals (n, 2), the largest first."""
    count = np.bincount(result.block.measurements.image[selected])
    step = max(1, int(count[count > 0].min(initial=0)) // SAMPLES.large) if len(count) else 1
    thinned = np.zeros_like(selected)
    thinned[::step] = selected[::step]
    fields = []
    for index, rows in by_image(result.block, thinned):
        rows, image = rows[:: max(1, len(rows) // SAMPLES.large)], result.block.images[index]
        if len(rows) >= SAMPLES.fewest:
            position = (result.block.measurements.xy[rows] - image.centre_px) / np.maximum(image.half_size_px, 1.0)
            field = _find_field(image.id, position, residual_px[rows])
            fields += [field] if field is not None else []
    return sorted(fields, key=lambda field: -field.rms_px)


def _find_field(image: str, position: np.ndarray, residual: np.ndarray) -> ResidualField | None:
    """Return the field of one image, None if it is not significant; ``position (n, 2)`` is scaled to [-1, 1].

    A polynomial with the monomials T explains r'T (T'T)^-1 T'r of the sum of squares r'r; the models are nested.
    """
    u, v = position.T
    terms = np.stack([u**i * v**j for i, j in MONOMIALS])
    normal, right, total = terms @ terms.T, terms @ residual, float(np.sum(residual**2))

    def explain(columns: list[int]) -> tuple[float, int]:
        solved, _, rank, _ = np.linalg.lstsq(normal[np.ix_(columns, columns)], right[columns], rcond=None)
        return float(np.sum(right[columns] * solved)), rank

    richest, rank = explain(COLUMNS_OF_MODEL[NESTED[-1]])
    freedom = 2.0 * rank
    left = 2.0 * len(residual) - freedom
    if not total > richest:
        return None
    ratio = (richest / freedom) / ((total - richest) / left)
    if special.fdtrc(freedom, left, ratio) > SIGNIFICANCE.false_alarm:
        return None
    model = next(name for name in NESTED if explain(COLUMNS_OF_MODEL[name])[0] >= FIELD.equal_share * richest)
    return ResidualField(image, float(np.sqrt(richest / len(residual))), model)
