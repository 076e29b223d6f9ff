"""A field left in the residuals of an image: drift, affine or quadratic terms that the model does not follow.

Each image's residuals are explained by polynomials of the position, with the monomials of the models in image space. An
F test says whether a polynomial explains more than noise would; the size of what it explains, whether that matters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from ...adjustment.result import Adjustment
from ...refinement.image_space import IMAGE_SPACE
from ..residuals import by_image
from .significance import RISK

MOST_ROWS = 4000  # of an image: enough for every field that matters
FEWEST_ROWS = 12
MODELS = ("shift", "shift-drift", "affine", "quadratic")  # from few parameters to many
SAME_FIELD = 0.8  # share of what the richest model explains from which a simpler one does


@dataclass(frozen=True)
class ResidualField:
    """What is left systematically in an image: RMS of the field and of all residuals in px, and the model for it."""

    image: str
    rms_px: float
    all_px: float
    model: str


def residual_fields(result: Adjustment, chosen: np.ndarray) -> list[ResidualField]:
    """Return the significant fields in the residuals of the ``chosen`` measurements (mask), the largest first."""
    found = []
    for index, rows in by_image(result.block, chosen):
        rows = rows[:: max(1, len(rows) // MOST_ROWS)]
        if len(rows) >= FEWEST_ROWS:
            image = result.block.images[index]
            position = (result.block.measurements.xy[rows] - image.centre_px) / np.maximum(image.half_size_px, 1.0)
            field = _field(image.id, position, result.residual_px[rows])
            found += [field] if field is not None else []
    return sorted(found, key=lambda field: -field.rms_px)


def _field(image: str, position: np.ndarray, residual: np.ndarray) -> ResidualField | None:
    """Return the field of one image, None where there is none beyond chance; ``position (n, 2)`` from -1 to 1."""
    total = float(np.sum(residual**2))
    explained = {}
    for name in MODELS:
        terms = np.prod(position[:, None, :] ** IMAGE_SPACE[name].powers, axis=2)
        coefficients, _, rank, _ = np.linalg.lstsq(terms, residual, rcond=None)
        explained[name] = float(np.sum((terms @ coefficients) ** 2))
        freedom, left = 2.0 * rank, 2.0 * (len(residual) - rank)
    richest = explained[MODELS[-1]]
    if not total > richest:
        return None
    ratio = (richest / freedom) / ((total - richest) / left)
    if special.fdtrc(freedom, left, ratio) > RISK:
        return None
    model = next(name for name in MODELS if explained[name] >= SAME_FIELD * richest)
    return ResidualField(image, float(np.sqrt(richest / len(residual))), float(np.sqrt(total / len(residual))), model)
