"""Systematic residuals of an image: shift, drift, affine or quadratic terms that the model does not contain.

Polynomials of the image position, with the monomials of the image-space models, are fitted to the residuals of each
image. An F test decides whether a polynomial is significant, and its RMS whether it is large enough to matter.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from ...adjustment.result import Adjustment
from ...foundation.thresholds import threshold, thresholds
from ...refinement.image_space import IMAGE_SPACE
from ..residuals import by_image
from .significance import SIGNIFICANCE, SOUND_BLOCKS


@thresholds
class FIELD:
    """Limits for systematic patterns (fields) in the residuals of images."""

    most_rows: int = threshold(1000, "points", "most points of an image that are tested")
    fewest_rows: int = threshold(12, "points", "fewest points of an image that is tested")
    images_at_once: int = threshold(100, "images", "number of images tested together (30 MB)")
    rank_tolerance: float = threshold(
        1e-9, "", "relative eigenvalue below which the rank is uncertain and each image is tested alone"
    )
    risk_margin: float = threshold(1.001, "", "factor for rounding in the joint test of many images")
    equal_share: float = threshold(
        0.8, "", "share of the squares explained by the largest model that a simpler model needs"
    )
    noted_px: float = threshold(0.05, "px", "smallest RMS of a field in the notes")
    large_px: float = threshold(4.0, "px", "RMS of a field that visibly deforms orthoimages", SOUND_BLOCKS)


NESTED = ("shift", "shift-drift", "affine", "quadratic")  # from few parameters to many
MONOMIALS = IMAGE_SPACE[NESTED[-1]].powers.tolist()  # includes those of all others
COLUMNS_OF_MODEL = {name: [MONOMIALS.index(powers) for powers in IMAGE_SPACE[name].powers.tolist()] for name in NESTED}


@dataclass(frozen=True)
class ResidualField:
    """Systematic field of an image: RMS (2D) of the field and of all residuals in px, and the model that removes it."""

    image: str
    rms_px: float
    all_px: float
    model: str


def find_residual_fields(result: Adjustment, chosen: np.ndarray, residual_px: np.ndarray) -> list[ResidualField]:
    """Return the significant fields of the ``chosen`` measurements (mask) in residuals (n, 2), the largest first."""
    count = np.bincount(result.block.measurements.image[chosen])
    step = max(1, int(count[count > 0].min(initial=0)) // FIELD.most_rows) if len(count) else 1
    thinned = np.zeros_like(chosen)
    thinned[::step] = chosen[::step]
    found = []
    shown = [(index, rows[:: max(1, len(rows) // FIELD.most_rows)]) for index, rows in by_image(result.block, thinned)]
    shown = [(index, rows) for index, rows in shown if len(rows) >= FIELD.fewest_rows]
    for first in range(0, len(shown), FIELD.images_at_once):
        part = shown[first : first + FIELD.images_at_once]
        images = [result.block.images[index] for index, _ in part]
        rows, lengths = np.concatenate([rows for _, rows in part]), np.array([len(rows) for _, rows in part])
        centre = np.array([image.centre_px for image in images])
        reach = np.maximum([image.half_size_px for image in images], 1.0)
        position = result.block.measurements.xy[rows] - np.repeat(centre, lengths, axis=0)
        position /= np.repeat(reach, lengths, axis=0)
        residual = residual_px[rows]
        begin = np.cumsum(lengths) - lengths
        for number in np.flatnonzero(_test_fields(position, residual, begin, lengths)).tolist():
            own = slice(begin[number], begin[number] + lengths[number])
            field = _find_field(images[number].id, position[own], residual[own])
            found += [field] if field is not None else []
    return sorted(found, key=lambda field: -field.rms_px)


def _test_fields(
    position: np.ndarray, residual: np.ndarray, begin: np.ndarray, lengths: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Return True for images for which `_find_field` is needed, ``(k,)`` bool, computed together.

    It is the F test of the largest model, with a margin for rounding. The rows of an image are ``lengths (k,)`` rows
    from ``begin (k,)`` on.
    """
    u, v = position.T
    terms = np.column_stack([u**i * v**j for i, j in MONOMIALS])
    normal = np.add.reduceat(terms[:, :, None] * terms[:, None, :], begin)
    right = np.add.reduceat(terms[:, :, None] * residual[:, None, :], begin)
    total = np.add.reduceat((residual**2).sum(axis=1), begin)
    size, along = np.linalg.eigh(normal)
    counts = size > size[:, -1:] * size.shape[1] * np.finfo(float).eps
    share = np.sum((along.swapaxes(1, 2) @ right) ** 2, axis=2) / np.where(counts, size, np.inf)
    richest, freedom = share.sum(axis=1), 2.0 * counts.sum(axis=1)
    left = 2.0 * lengths - freedom
    sound = (total > richest) & (np.abs(size) > size[:, -1:] * FIELD.rank_tolerance).all(axis=1)
    ratio = np.divide(richest * left, (total - richest) * freedom, out=np.full(len(total), np.inf), where=sound)
    return np.asarray(special.fdtrc(freedom, left, ratio) <= SIGNIFICANCE.risk * FIELD.risk_margin)


def _find_field(image: str, position: np.ndarray, residual: np.ndarray) -> ResidualField | None:
    """Return the field of one image, None if it is not significant; ``position (n, 2)`` is scaled to [-1, 1].

    A polynomial with the monomials T explains r'T (T'T)^-1 T'r of the sum of squares r'r; the models are nested.
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
    if special.fdtrc(freedom, left, ratio) > SIGNIFICANCE.risk:
        return None
    model = next(name for name in NESTED if explained[name] >= FIELD.equal_share * richest)
    return ResidualField(image, float(np.sqrt(richest / len(residual))), float(np.sqrt(total / len(residual))), model)
