"""Options of an adjustment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..foundation.options import option, options, threads_option
from ..foundation.thresholds import threshold, thresholds
from ..refinement.model_table import BLOCK_MODEL_NAMES, RULE_NAMES

if TYPE_CHECKING:
    from ..block.jitter_curve import JitterEstimate
    from ..block.laser import LaserPoints
    from ..block.orthoimage import ReferencePlaces
    from ..surface.dem import HeightSurface
    from .priors.earlier_cameras import JointCameras

#: Models and rules that choose one.
MODEL_NAMES = (*RULE_NAMES, *BLOCK_MODEL_NAMES)
#: Weight functions (`weights.WEIGHTS`).
WEIGHT_NAMES = ("none", "huber", "cauchy", "tukey")
#: Criteria by which image points are grouped (`variance_components.GROUPINGS`).
GROUPING_NAMES = ("kind-sensor", "kind", "sensor", "image", "kind-image")


#: Values of `jitter` other than a number.
JITTER_CHOICES = ("auto", "none")
#: Kinds of surfaces: with buildings and vegetation (DSM), or of the ground alone (DTM).
SURFACE_KINDS = ("dsm", "dtm")


def surface_search_option() -> Any:
    """Return the option of the search distance for the relief of a surface."""
    return option(
        100.0,
        "Search distance in plan for the relief of a surface that constrains a block without GCPs; 0: the surface "
        "constrains heights only",
        name="surface-search",
        minimum=0.0,
        unit="m",
        advanced=True,
        metavar="M",
    )


def surface_kind_option() -> Any:
    """Return the option of the kind of a surface."""
    return option(
        SURFACE_KINDS[0],
        "Whether the heights of the DEM or surface include trees and buildings (dsm) or not (dtm)",
        choices=SURFACE_KINDS,
        advanced=True,
    )


@thresholds
class HOLD_OUT:
    """Limits for holding out tie tracks."""

    fewest_tracks: int = threshold(500, "tracks", "number of tie tracks up to which none is held out")
    most_evaluated: int = threshold(
        5000, "tracks", "held-out tracks evaluated, chosen evenly", "standard deviation of their RMSE below 1 %"
    )


@options
class AdjustOptions:
    """How to adjust; the descriptions of the options are also their help on the command line and in the dialogs.

    Parameters
    ----------
    dem : HeightSurface, optional
        A surface whose heights constrain the tie points, with the standard deviation ``sigma_dem_m``.
    laser : LaserPoints, optional
        Laser points that constrain the heights of the tie points around them; those with a ``doubt`` are not used.
    reference : ReferencePlaces, optional
        GCPs of the block that are places of an orthoimage: they constrain it in plan, and share most of their error.
    earlier : JointCameras, optional
        The cameras of an earlier adjustment, as the prior of some of the images.
    jitter_estimate : JitterEstimate, optional
        The curves by which the measurements were corrected already, for the accuracy of the result.
    max_iterations : int
        Largest number of Gauss-Newton iterations.
    tolerance : float
        The iterations end if a step decreases the cost by less than this share.
    """

    model: str = option(
        "auto", "Correction model of the RPCs; auto and generic choose it from GCPs and tie points", choices=MODEL_NAMES
    )
    robust: str = option("none", "Weight function against blunders", choices=WEIGHT_NAMES)
    reject_sigma: float = option(
        4.0,
        "Reject tie point measurements and GCPs whose test statistic exceeds this value (data snooping); 0 rejects "
        "none",
        name="reject",
        minimum=0.0,
        unit="sigma",
        advanced=True,
        metavar="SIGMAS",
    )
    check_as_ties: bool = option(
        False,
        "Use image points of check points like tie points (their surveyed positions are never used)",
        advanced=True,
    )
    test_sigmas: bool = option(
        True,
        "Test the sigmas of the observations with the residuals, estimate those that fail, and estimate the attitude "
        "drift; otherwise all remain as given",
        advanced=True,
    )
    variance_components: bool = option(
        False,
        "Estimate the sigmas of image points by kind and sensor and of GCPs from the residuals, and adjust with them",
        advanced=True,
    )
    variance_groups: str = option(
        "kind-sensor",
        "Grouping of image points for the estimation of their sigmas",
        choices=GROUPING_NAMES,
        advanced=True,
    )
    sensor_images: tuple[tuple[str, ...], ...] = option(
        (),
        "Images of one sensor, whose image points have one sigma; groups joined by +; by default images of "
        "similar resolution",
        advanced=True,
        metavar="A+B,C+D,…",
    )
    cross_validate: bool = option(
        False, "Predict each GCP from an adjustment without it (leave-one-out)", advanced=True
    )
    fixed_images: tuple[str, ...] = option(
        (), "Reference images, whose RPCs stay as they are", advanced=True, metavar="A,B,…"
    )
    shared_images: tuple[tuple[str, ...], ...] = option(
        (),
        "Images of one exposure, strip or orbit that get the same correction; groups joined by +",
        advanced=True,
        metavar="A+B,C+D,…",
    )
    dem: HeightSurface | None = None
    sigma_dem_m: float | None = option(
        None,
        "Standard deviation of the heights of `dem`, which then constrain the tie points; by default they are not "
        "used for this",
        name="sigma-dem",
        minimum=1e-6,
        unit="m",
        advanced=True,
        metavar="M",
    )
    surface_search_m: float = surface_search_option()
    surface_kind: str = surface_kind_option()
    laser: LaserPoints | None = None
    laser_reach_m: float = option(
        25.0,
        "Radius around a laser point within which tie points describe the terrain, and are constrained by its height",
        name="laser-reach",
        minimum=0.1,
        unit="m",
        advanced=True,
        metavar="M",
    )
    sigma_laser_m: float = option(
        0.1,
        "Additional standard deviation of every laser height, added to that of its file",
        name="sigma-laser",
        minimum=0.0,
        unit="m",
        advanced=True,
        metavar="M",
    )
    reference: ReferencePlaces | None = None
    sigma_shift_px: float | None = option(
        None,
        "A priori standard deviation of the shift of each image; by default 100 px with GCPs, else ERR_BIAS of the "
        "RPC, the published accuracy of the sensor, or 7 m on the ground",
        name="sigma-shift",
        minimum=1e-9,
        unit="px",
        advanced=True,
        metavar="PX",
    )
    sigma_drift: float | None = option(
        None,
        "A priori standard deviation of the attitude drift of an image; by default 1e-3 with GCPs, else 1e-4; for "
        "models without drift the published value of the sensor, at least 3e-5; 0: no drift",
        minimum=0.0,
        unit="px/px",
        advanced=True,
        metavar="X",
    )
    jitter: str = option(
        "none",
        "Remove jitter (vibration of the attitude) along the lines of each image: auto where residuals show "
        "significant waves, none, or LINES between the knots of the curves",
        advanced=True,
        metavar="auto|none|LINES",
    )
    jitter_estimate: JitterEstimate | None = None
    earlier: JointCameras | None = None
    max_iterations: int = 30
    tolerance: float = 1e-9
    threads: int = threads_option()
