"""Limits that all statistical estimates share: one significance level, one weight of stated standard deviations.

A test, an estimate or an iteration takes its limits from here, and robust ones from `robust_scale`, so that the same
question has the same answer wherever it is asked; limits of one method alone are in its module.
"""

from .thresholds import threshold, thresholds


@thresholds
class SIGNIFICANCE:
    """Error probabilities of statistical tests."""

    level: float = threshold(0.01, "", "significance level of a test that changes a model, a sigma or a weight")
    false_alarm: float = threshold(1e-4, "", "error probability of a test that calls an observation wrong")
    decisive: float = threshold(9.0, "chi²", "difference that decides between two explanations (3 sigma)")


@thresholds
class REDUNDANCY:
    """Redundancies with which residuals are tested, and standard deviations estimated."""

    tested: float = threshold(1e-3, "", "smallest share of an error in its residual that is tested")
    estimated: float = threshold(
        4.0, "", "smallest redundancy of a group whose standard deviation is tested or estimated (to a third)",
        "1 / sqrt(2 r) of a variance component with redundancy r",
    )  # fmt: skip
    stated: float = threshold(
        6.0, "observations", "weight of a stated or common standard deviation in the estimate of a single one",
        "inverse chi² prior (Gelman et al. 2013, section 5.4)",
    )  # fmt: skip
    common: float = threshold(
        20.0, "observations", "weight of the standard deviation of a sensor or a source in that of its parts"
    )
    regularised: float = threshold(1e-3, "", "relative weight that keeps poorly determined coefficients at zero")


@thresholds
class SAMPLES:
    """Sizes of samples."""

    fewest: int = threshold(12, "observations", "fewest of a group for a robust trend or scale of its own")
    dense: int = threshold(50, "items", "largest number whose joint covariance is computed as one matrix")


@thresholds
class ITERATIONS:
    """Ends of iterations that solve or weight again."""

    most: int = threshold(30, "iterations", "largest number; all but a few end earlier by convergence")
    coarse: float = threshold(0.05, "", "relative change that ends an iteration inside another one")
    settled: float = threshold(0.01, "", "relative change of a standard deviation that needs no new solution")
    fine: float = threshold(1e-3, "", "relative change that ends an iteration without a new solution")
