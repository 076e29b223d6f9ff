"""Thresholds by topic: frozen dataclasses whose fields have a unit, a meaning and an origin.

Each topic is declared once as a constant (``EPIPOLAR.mode_px``), in the module that uses it::

    @thresholds
    class LINKS:
        ...  # docstring: conditions for links between images to be used
        closure_px: float = threshold(3.0, "px", "largest median closure of a triangle of images", MANY_DATES)
        fewest_closures: int = threshold(8, "points", "fewest common points of a triangle that is tested", JUDGEMENT)

``docs/developing/thresholds.md`` lists all of them (`scripts/list_thresholds.py`). Numbers of mathematical origin
(a quantile, the coefficients of a formula) are not thresholds and are written where they are used.

At the end are the topics that all rooms share: one significance level, one weight of stated standard deviations, sizes
of samples, ends of iterations, differences that do not matter; so that the same question has the same answer wherever
it is asked. Sizes of parts that are computed together, and of grids and lists, decide on time, memory and length.
"""

from dataclasses import dataclass, field
from typing import Any, TypeVar, dataclass_transform

Value = TypeVar("Value")
Topic = TypeVar("Topic")

#: Origin of a value that was chosen by engineering judgement and never tuned on data.
JUDGEMENT = "judgement"


def threshold(value: Value, unit: str, meaning: str, origin: str = JUDGEMENT) -> Value:
    """Declare a threshold as a field of a class made by `thresholds`.

    unit : ``"px"``, ``"m"``, ``"sigma"``, ``"matches"``; empty for a ratio
    meaning : the quantity in standard terms, as a noun phrase, and what happens beyond the value
    origin : a theory or publication, or the data and date by which it was tuned, or `JUDGEMENT`
    """
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "origin": origin})


@dataclass_transform(frozen_default=True)  # type checkers treat each `threshold` as a plain default
def thresholds(topic: type[Topic]) -> type[Topic]:
    """Make a class of `threshold` fields with a docstring a frozen dataclass, and return its only instance.

    Type checkers see the class, with the fields as attributes. If its name is not in capitals, the class is returned.
    """
    frozen_class: Any = dataclass(frozen=True)(topic)
    if not topic.__doc__ or topic.__doc__.startswith(f"{topic.__name__}("):
        raise TypeError(f"{topic.__name__}: describe in a docstring what its thresholds decide")
    bare = [name for name, declared in frozen_class.__dataclass_fields__.items() if "meaning" not in declared.metadata]
    if bare:
        raise TypeError(f"{topic.__name__}.{bare[0]}: declare it by `threshold`, with unit, meaning and origin")
    return frozen_class() if topic.__name__.isupper() else frozen_class


# ---- shared by all rooms ---------------------------------------------------------------------------------------------


@thresholds
class SIGNIFICANCE:
    """Error probabilities of statistical tests."""

    level: float = threshold(0.01, "", "significance level of a test that changes a model, a sigma or a weight")
    false_alarm: float = threshold(1e-4, "", "error probability of a test that calls an observation wrong")
    decisive: float = threshold(9.0, "chi²", "difference that decides between two explanations (3 sigma)")
    sigmas: float = threshold(3.0, "sigma", "error that a search or a comparison allows for", "normal: 0.3 %")
    gross: float = threshold(4.0, "sigma", "difference of two sources that has a cause", "normal: 6e-5")
    certain: float = threshold(5.0, "sigma", "deviation that no correct observation of a block has", "normal: 6e-7")
    extreme: float = threshold(10.0, "sigma", "error with which a result cannot be used")


@thresholds
class REDUNDANCY:
    """Redundancies with which residuals are tested, and standard deviations estimated."""

    tested: float = threshold(1e-3, "", "smallest share of an error in its residual that is tested")
    estimated: float = threshold(
        4.0,
        "",
        "smallest redundancy of a group whose standard deviation is tested or estimated (to a third)",
        "1 / sqrt(2 r) of a variance component with redundancy r",
    )
    stated: float = threshold(
        6.0,
        "observations",
        "weight of a stated or common standard deviation in the estimate of a single one",
        "inverse chi² prior (Gelman et al. 2013, section 5.4)",
    )
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
    large: int = threshold(1000, "items", "sample that represents more to 3 %, and most that are shown or remembered")
    local: int = threshold(64, "points", "sample by which two images, or the differences of two rays, are compared")


@thresholds
class ITERATIONS:
    """Ends of iterations that solve or weight again."""

    most: int = threshold(30, "iterations", "largest number; all but a few end earlier by convergence")
    repeated: int = threshold(3, "times", "largest number of weightings or searches, each from the result of the last")
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
    majority: float = threshold(0.5, "", "smallest share of a majority, and largest that an explanation leaves")
    camera_px: float = threshold(0.05, "px", "errors of cameras that are not modelled, without effect")
    rpc_px: float = threshold(0.1, "px", "difference of two RPCs that needs no new fit")
    position_m: float = threshold(0.1, "m", "distance, scatter or loss of accuracy without effect")
    direction_deg: float = threshold(20.0, "°", "angle up to which two directions count as equal")
    file_px: float = threshold(0.01, "px", "difference of a position by one RPC in two files", "digits of the formats")
    written_px: float = threshold(1e-4, "px", "difference by rounding in a file", "15 digits of GDAL")


@thresholds
class GROUND:
    """The ground between known heights, with buildings and vegetation."""

    margin_m: float = threshold(50.0, "m", "heights beyond known ones, in which objects and errors of a DEM lie")
    canopy_m: float = threshold(3.0, "m", "height of vegetation below which images show the ground")
    slope: float = threshold(0.3, "m/m", "slope of steep ground")


# ---- sizes of parts, grids and lists ---------------------------------------------------------------------------------


@thresholds
class MEMORY:
    """Parts that are read, computed or kept in memory together."""

    rows: int = threshold(20_000, "rows", "points, rays or measurements that are computed together")
    values: int = threshold(4_000_000, "values", "numbers of one kind in memory")
    cells: int = threshold(16_000_000, "cells", "cells of one surface in memory")
    images: int = threshold(64, "images", "images or pairs of images whose features are in memory")
    part_px: int = threshold(1024, "px", "side of a part of an image, or lines of it, that are read together")
    window_px: int = threshold(512, "px", "side of a window that is matched, or whose statistics are computed, as one")
    border_px: int = threshold(24, "px", "border of such parts, for filters and windows of matching")


@thresholds
class GRIDS:
    """Positions and cells that are distributed over an image or area."""

    parts: int = threshold(3, "parts", "parts along each side that are compared with each other")
    cells: int = threshold(10, "cells", "cells along each side, from which points are chosen evenly")
    coarse: int = threshold(5, "nodes", "nodes along each side at which a smooth difference is computed")
    fine: int = threshold(41, "nodes", "nodes along each side at which the terrain, or an edge, is found")
    nodes: int = threshold(15, "nodes", "nodes along each side at which two cameras are compared")
    spacing_px: int = threshold(32, "px", "spacing of positions that are computed exactly, bilinear between them")


@thresholds
class LISTS:
    """Lengths of the lists of a report; longer ones show the worst."""

    rows: int = threshold(200, "rows", "points, outliers or images in a list")
    images: int = threshold(24, "images", "images with a drawing of their own")
