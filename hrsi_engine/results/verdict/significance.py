"""Tests with a stated error probability."""

from __future__ import annotations

from scipy import special

#: Error probability of each test: some twenty tests a block make two false alarms in a thousand blocks.
RISK = 1e-4


def compute_chi_square_limit(freedom: float, risk: float = RISK) -> float:
    """Return the value that a chi² variable passes with probability ``risk``."""
    return float(special.chdtri(freedom, risk))


def is_significant(squares: float, freedom: float, risk: float = RISK) -> bool:
    """Return whether a sum of squares in units of its variance is larger than chance allows."""
    return freedom > 0.0 and squares > compute_chi_square_limit(freedom, risk)
