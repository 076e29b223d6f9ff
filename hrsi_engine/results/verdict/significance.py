"""Chi² tests with a stated error probability."""

from scipy import special

from ...foundation.thresholds import SIGNIFICANCE

#: Source of most thresholds of the verdict.
SOUND_BLOCKS = "correct simulated blocks of six sensors, seeds below 1000, 2026-11-22 (docs/protocols/sound_blocks.md)"


def compute_chi_square_limit(freedom: float, risk: float = SIGNIFICANCE.false_alarm) -> float:
    """Return the critical value of chi² with error probability ``risk``."""
    return float(special.chdtri(freedom, risk))


def is_significant(squares: float, freedom: float, risk: float = SIGNIFICANCE.false_alarm) -> bool:
    """Return True if a sum of squares, in units of its variance, exceeds the critical value of chi²."""
    return freedom > 0.0 and squares > compute_chi_square_limit(freedom, risk)
