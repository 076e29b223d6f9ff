"""Limits that all statistical estimates share: one significance level, one weight of stated standard deviations.

A test, an estimate or an iteration takes its limits from here, and robust ones from `robust_scale`, so that the same
question has the same answer wherever it is asked; limits of one method alone are in its module. Sizes of parts that
are computed together, and of grids, are in `working_sizes`.
"""

from .thresholds import threshold, thresholds


@thresholds
class SIGNIFICANCE:
    """Error probabilities of statistical tests."""

    level: float = threshold(0.01, "", "significance level of a test that changes a model, a sigma or a weight")
    false_alarm: float = threshold(1e-4, "", "error probability of a test that calls an observation wrong")
    decisive: float = threshold(9.0, "chi²", "difference that decides between two explanations (3 sigma)")
    sigmas: float = threshold(3.0, "sigma", "error that a search or a comparison allows for", "normal: 0.3 %")
    gross: float = threshold(4.0, "sigma", "difference of two sources that has a cause", "normal: 6e-5")


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
    tested: int = threshold(8, "points", "fewest common points of two images, or points of a cell, that are tested")
    redundant: int = threshold(6, "points", "fewest for an estimate of up to five unknowns", "theory")
    plane: int = threshold(3, "points", "fewest that determine a plane, or reveal an error of a shift", "theory")
    trend: int = threshold(30, "points", "fewest for a trend linear in position that is estimated robustly")
    quadratic: int = threshold(60, "points", "… for a quadratic trend: ten per coefficient")
    neighbours: int = threshold(8, "points", "neighbours by whose median a point is predicted")
    local: int = threshold(64, "points", "sample by which two images, or the differences of two rays, are compared")


@thresholds
class ITERATIONS:
    """Ends of iterations that solve or weight again."""

    most: int = threshold(30, "iterations", "largest number; all but a few end earlier by convergence")
    coarse: float = threshold(0.05, "", "relative change that ends an iteration inside another one")
    settled: float = threshold(0.01, "", "relative change of a standard deviation that needs no new solution")
    fine: float = threshold(1e-3, "", "relative change that ends an iteration without a new solution")


@thresholds
class EQUALITY:
    """Differences that do not matter."""

    alike: float = threshold(0.02, "", "relative difference of variances, or of explanations, that are equally good")
    size: float = threshold(1.25, "", "ratio up to which two pixel sizes or standard deviations count as equal")
    rounding: float = threshold(1e-9, "", "difference of equal numbers, relative or in pixels", "rounding of sums")
    negligible: float = threshold(0.05, "", "share of a variance or number without effect", "2.5 % of a sigma")
    majority: float = threshold(0.5, "", "smallest share of a majority")
    rpc_px: float = threshold(0.1, "px", "difference of two RPCs that needs no new fit")
    file_px: float = threshold(0.01, "px", "difference of a position by one RPC in two files", "digits of the formats")
    written_px: float = threshold(1e-4, "px", "difference by rounding in a file", "15 digits of GDAL")
