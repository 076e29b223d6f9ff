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

MOST_ROWS = 1000  # of an image: enough for every field that matters
FEWEST_ROWS = 12
NESTED = ("shift", "shift-drift", "affine", "quadratic")  # from few parameters to many
MONOMIALS = IMAGE_SPACE[NESTED[-1]].powers.tolist()  # those of all the others are among them
COLUMNS_OF_MODEL = {name: [MONOMIALS.index(powers) for powers in IMAGE_SPACE[name].powers.tolist()] for name in NESTED}
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
    count = np.bincount(result.block.measurements.image[chosen])
    step = max(1, int(count[count > 0].min(initial=0)) // MOST_ROWS) if len(count) else 1
    thinned = np.zeros_like(chosen)
    thinned[::step] = chosen[::step]
    found = []
    for index, rows in by_image(result.block, thinned):
        rows = rows[:: max(1, len(rows) // MOST_ROWS)]
        if len(rows) >= FEWEST_ROWS:
            image = result.block.images[index]
            position = (result.block.measurements.xy[rows] - image.centre_px) / np.maximum(image.half_size_px, 1.0)
            field = _field(image.id, position, result.residual_px[rows])
            found += [field] if field is not None else []
    return sorted(found, key=lambda field: -field.rms_px)


def _field(image: str, position: np.ndarray, residual: np.ndarray) -> ResidualField | None:
    """Return the field of one image, None where there is none beyond chance; ``position (n, 2)`` from -1 to 1.

    A polynomial with the monomials T explains r'T (T'T)^-1 T'r of the squares r'r; the models are nested.
    """
    u, v = position.T
    terms = np.stack([u**i * v**j for i, j in MONOMIALS])
    normal, right = terms @ terms.T, terms @ residual
    explained = {}
    for name, columns in COLUMNS_OF_MODEL.items():
        solved, *_ = np.linalg.lstsq(normal[np.ix_(columns, columns)], right[columns], rcond=None)
        explained[name] = float(np.sum(right[columns] * solved))
    total, richest = float(np.sum(residual**2)), explained[NESTED[-1]]
    freedom = 2.0 * np.linalg.matrix_rank(normal)
    left = 2.0 * len(residual) - freedom
    if not total > richest:
        return None
    ratio = (richest / freedom) / ((total - richest) / left)
    if special.fdtrc(freedom, left, ratio) > RISK:
        return None
    model = next(name for name in NESTED if explained[name] >= SAME_FIELD * richest)
    return ResidualField(image, float(np.sqrt(richest / len(residual))), float(np.sqrt(total / len(residual))), model)
