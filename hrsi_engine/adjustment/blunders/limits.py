"""Error probabilities of the tests, shared over all of them.

``reject_sigma`` names an error probability: that of an image point (two dimensions) this many standard deviations off.
A block has thousands of tests, so that probability alone would accuse somebody in every clean block. The limit of the
tie points is therefore that of Benjamini and Hochberg (1995): of all N points tested those R are wrong whose
probability is below p R / N with p = `FALSE_ALARMS.false_share`, so that a clean block is accused in p of cases, and a
bad one tested as sharply as the user asks. GCPs share the probability equally (Bonferroni).
"""

import numpy as np
from scipy import special

from ...foundation.thresholds import threshold, thresholds


@thresholds
class FALSE_ALARMS:
    """How often tests of many points may be wrong."""

    false_share: float = threshold(
        0.002, "",
        "share of clean blocks in which a tie point is accused; of the points accused, share of those "
        "that are right",
    )  # fmt: skip


def error_probability(sigmas: float) -> float:
    """Return the probability that an image point lies more than ``sigmas`` off by chance."""
    return float(np.exp(-0.5 * sigmas**2))


def critical_value(sigmas: float, dimensions: int, candidates: int = 1) -> float:
    """Return the limit of a chi² test with the error probability of ``sigmas``, shared by several ``candidates``."""
    return float(special.chdtri(dimensions, error_probability(sigmas) / candidates))


def compute_shared_limit(probability: np.ndarray, tests: int, sigmas: float) -> float:
    """Return the limit in sigmas at which the wrong ones among many ``tests`` are found, at least ``sigmas``.

    ``probability (k,)`` are those of the suspicious ones; all others are taken to be right.
    """
    ordered = np.sort(probability)
    allowed = FALSE_ALARMS.false_share * np.arange(1, len(ordered) + 1) / max(tests, 1)
    passed = np.flatnonzero(ordered <= allowed)
    limit = allowed[passed[-1]] if len(passed) else FALSE_ALARMS.false_share / max(tests, 1)
    return max(sigmas, float(np.sqrt(-2.0 * np.log(limit))))
