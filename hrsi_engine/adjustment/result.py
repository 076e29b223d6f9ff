"""Result of an adjustment: corrected cameras, points, residuals and their precision."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from ..block.block import Block
from ..block.jitter_curve import JitterEstimate
from ..block.points import Role
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import EQUALITY
from ..ground.map_crs import middle_position
from ..refinement.model import RefinementModel
from ..refinement.selection import ModelChoice
from .priors.earlier_cameras import JointCameras
from .source_results import HeightAgreement, LaserOutcome, PlanAgreement, SurfaceOutcome


@dataclass(frozen=True)
class Iteration:
    """One row of the convergence history; ``cost`` is half the weighted sum of squares."""

    cost: float
    predicted_decrease: float
    damping: float


class Decision(IntEnum):
    """Decision of data snooping on a measurement."""

    KEPT = 0
    BLUNDER = 1  #: wrong, and rejected
    DOUBTFUL = 2  #: one measurement of the point is wrong, but not identified: all are rejected


@dataclass(frozen=True)
class Finding:
    """A GCP that contradicts the other observations: ``what`` is ``ground``, ``height`` or the id of an image.

    statistic : its error in standard deviations; size : its error in ``unit``, ``m`` or ``px``
    left_out : whether the position, its height or the measurement was rejected
    group, rivals : ids of two contradicting groups of GCPs, of which the wrong one is unknown; ``id`` is of the first
    """

    id: str
    what: str
    statistic: float
    left_out: bool
    message: str
    size: float = float("nan")
    unit: str = "m"
    group: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()

    @property
    def concerned(self) -> tuple[str, ...]:
        """Ids of all GCPs that the finding concerns."""
        return (*self.group, *self.rivals) or (self.id,)


@dataclass(frozen=True)
class VarianceComponent:
    """A group of observations whose sigma was estimated: ``sigma`` is ``factor`` times the given one."""

    group: str
    observations: int
    redundancy: float
    factor: float
    sigma: float
    unit: str
    estimated: bool


@dataclass(frozen=True)
class ModelTest:
    """The test of a group's sigma by its residuals: they are ``ratio`` times as large as expected.

    ``failed`` is True if the ratio is significant and large enough to matter; then the sigmas were estimated.
    """

    group: str
    ratio: float
    redundancy: float
    failed: bool


@dataclass(frozen=True)
class ContradictingGcps:
    """Two of a few GCPs that disagree on an image: by metres, in sigmas, and as a factor of the stated sigmas."""

    ids: tuple[str, str]
    image: str
    metres: float
    sigmas: float
    factor: float


@dataclass(frozen=True)
class DatumPart:
    """Images connected by common points: their datum, and the accuracy of ground points measured in them.

    by_priors : number of parameters that follow from priors, as a sum of shares
    sigma_m : root mean square of the standard deviations over the area, east, north, up; NaN where none is predicted
    ce90_m, le90_m : limits that 90 % of the errors over the area do not exceed, for points without survey (GCPs as
        predicted by the others); no height if no point is measured in two images
    points : number of points used for it; parallel : ids of excluded points with nearly parallel rays
    leave_one_out : ratio of the leave-one-out errors of the GCPs to the predicted ones, at least 1; the figures above
        include it, and the difference of few contradicting GCPs
    apart : the two of few GCPs with the largest contradiction, or None
    gsd_m, base_to_height : the largest GSD and base-to-height ratio of the images
    undetermined : those of ``ce90_m`` and ``le90_m`` that are too large for these (`AREA_ACCURACY`)
    """

    images: tuple[str, ...]
    gcps: int
    ties: int
    by_priors: float
    sigma_m: tuple[float, float, float]
    ce90_m: float | None = None
    le90_m: float | None = None
    points: int = 0
    parallel: tuple[str, ...] = ()
    leave_one_out: float = 1.0
    apart: ContradictingGcps | None = None
    gsd_m: float = float("nan")
    base_to_height: float = float("nan")
    undetermined: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Survey - prediction ``error_m (g, 3)`` of each GCP by the adjustment without it; NaN if not predicted."""

    ids: tuple[str, ...]
    error_m: np.ndarray


@dataclass(frozen=True, eq=False)
class CameraEstimates:
    """The estimated cameras, with the drift that the final model does not contain.

    model : the requested model, with the drift's parameters after its own if there is such a drift
    values : (images, q) its parameters
    covariance : (images, q, q) of each image's parameters, scaled by sigma0; NaN if it was not computed
    """

    model: RefinementModel
    values: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Result of `adjust`; arrays are in the order of the block's images, points and measurements.

    Parameters
    ----------
    block : Block
        The adjusted block; its measurements are corrected by ``jitter``.
    model : RefinementModel
        The model of the final cameras.
    values, values_sigma : (images, p) ndarray
        Parameters of the model and their standard deviations.
    cameras : CameraEstimates
        The estimated cameras with covariances: ``model`` and ``values``, plus the additional drift if there is one.
    ground, ground_sigma_m : (points, 3) ndarray
        Adjusted positions (lon, lat, height) and sigmas (east, north, up); NaN where not adjusted.
    ground_covariance_m2 : (points, 3, 3) ndarray
        Covariance of each position, scaled by sigma0.
    residual_px : (measurements, 2) ndarray
        Observed - computed at the adjusted position; NaN for measurements that are not used.
    weight : (measurements,) ndarray
        Robust weight factor, 0 for rejected ones.
    redundancy_numbers : (measurements, 2) ndarray
        Share of an error in sample and in line that appears in its residual.
    statistic : (measurements,) ndarray
        Test value, in standard deviations, of "this measurement is a blunder"; for those left out by data snooping the
        value of the failed test; NaN: untested.
    decision : (measurements,) ndarray of int
        A `Decision`.
    sigma0 : float
        Standard deviation of unit weight.
    observations, unknowns : int
        Of the last solution.
    redundancy : float
        Number of observations, including priors, minus number of unknowns.
    converged : bool
        True if the iterations converged.
    status : str
        How the iterations ended, as text.
    history : tuple of Iteration
        The passes of all rounds.
    solves : int
        Total number of linear systems solved.
    findings : tuple of Finding
        Wrong or contradicting GCPs, and whether they are used.
    variance_components : tuple of VarianceComponent
        Estimated sigmas of groups of observations.
    parts : tuple of DatumPart
        Parts of the block that share no points.
    cross_validation : CrossValidation or None
        Leave-one-out errors of the GCPs, if they were requested.
    warnings : tuple of str
        Warnings for the user.
    heights : tuple of HeightAgreement
        Agreement of tie points with the DEM and the laser points that constrain their heights.
    plan : PlanAgreement or None
        Agreement of the places of a reference, if one constrains the block in plan.
    surfaces : tuple of SurfaceOutcome
        Position in plan of each part of the block by the relief of a surface, or why it is not determined.
    rpcs_alone_m : tuple of float or None
        Movement of the block, east, north and up, if its RPCs alone determined it: the median of its tie points; None
        without any.
    rpcs_height_sigma_m : float or None
        Standard deviation of the block's height by its RPCs alone; None if GCPs or fixed images determine it, too.
    laser : LaserOutcome or None
        Result of each laser point.
    estimate_residual_px : (measurements, 2) ndarray or None
        The residuals by the estimated cameras, with the drift that the model does not contain; redundancy numbers and
        statistic belong to these. None: there is no such drift.
    tests : tuple of ModelTest
        Tests of the given sigmas by the residuals.
    estimated_sigma_px : (measurements,) ndarray or None
        Estimated standard deviations of the measurements; None: the given ones were used.
    survey_factors : tuple of float
        Factors of the surveys' standard deviations for the prediction of other points: horizontal, height, correlated;
        estimated ones include the uncertainty of their estimate, all include a sigma0 above 1.
    choice : ModelChoice or None
        Reason for the model, if a rule chose it.
    joint : JointCameras or None
        The cameras with their joint normal matrix, for blocks to which further images are added.
    shared_shifts_m : (points, 3, errors) ndarray or None
        East, north and up by which one standard deviation of each error that many positions share moves each of them:
        those of the GCPs' coordinate operations, then those of the pointing of passes; ``ground_sigma_m`` includes
        them, ``ground_covariance_m2`` does not. None without any.
    jitter : JitterEstimate or None
        The curves along the lines of images that correct the measurements; None without any.
    """

    block: Block
    model: RefinementModel
    values: np.ndarray
    values_sigma: np.ndarray
    cameras: CameraEstimates
    ground: np.ndarray
    ground_sigma_m: np.ndarray
    ground_covariance_m2: np.ndarray
    residual_px: np.ndarray
    weight: np.ndarray
    redundancy_numbers: np.ndarray
    statistic: np.ndarray
    decision: np.ndarray
    sigma0: float
    observations: int
    unknowns: int
    redundancy: float
    converged: bool
    status: str
    history: tuple[Iteration, ...]
    solves: int
    findings: tuple[Finding, ...]
    variance_components: tuple[VarianceComponent, ...]
    parts: tuple[DatumPart, ...]
    cross_validation: CrossValidation | None
    warnings: tuple[str, ...]
    heights: tuple[HeightAgreement, ...] = ()
    plan: PlanAgreement | None = None
    surfaces: tuple[SurfaceOutcome, ...] = ()
    rpcs_alone_m: tuple[float, float, float] | None = None
    rpcs_height_sigma_m: float | None = None
    laser: LaserOutcome | None = None
    estimate_residual_px: np.ndarray | None = None
    tests: tuple[ModelTest, ...] = ()
    estimated_sigma_px: np.ndarray | None = None
    survey_factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    choice: ModelChoice | None = None
    joint: JointCameras | None = None
    shared_shifts_m: np.ndarray | None = None
    jitter: JitterEstimate | None = None

    def __repr__(self) -> str:
        return (
            f"<Adjustment of {len(self.block.images)} images, model {self.model.name}: sigma0 {self.sigma0:.3f}, "
            f"{self.status}, {self.observations} observations, {self.unknowns} unknowns>"
        )

    @cached_property
    def measured_xy(self) -> np.ndarray:
        """Original measurements ``(measurements, 2)``, with jitter."""
        rows = self.block.measurements
        if self.jitter is None:
            return rows.xy
        return self.jitter.displace([image.id for image in self.block.images], rows.image, rows.xy)

    @property
    def sigma_px(self) -> np.ndarray:
        """Standard deviations of the measurements in the adjustment ``(measurements,)``: given, or estimated."""
        return self.block.measurements.sigma_px if self.estimated_sigma_px is None else self.estimated_sigma_px

    @property
    def unit_sigma(self) -> float:
        """Factor of all sigmas: sigma0, but not below 1, because a smaller one may be chance."""
        return max(self.sigma0, 1.0)

    def survey_covariance_m2(self, points: np.ndarray) -> np.ndarray:
        """Return the covariances ``(k, 3, 3)`` of some points' surveys in the adjustment: given, or estimated.

        Estimated factors of the GCPs' sigmas, and a remaining sigma0 above 1, are used for points with the same stated
        sigmas, which are assumed to be of one survey. Check points with other sigmas keep them. Coordinates that are
        not surveyed have an infinite variance.

        Parameters
        ----------
        points : (k,) ndarray or slice
            The points.

        Returns
        -------
        (k, 3, 3) ndarray
            Of east, north and height in square metres.
        """
        covariance = self.block.points.survey_covariance_m2(points)
        horizontal, height, correlated = self.survey_factors
        row, column = np.triu_indices(3, 1)
        with np.errstate(invalid="ignore"):
            mixed = (covariance[:, row, column] != 0.0).any(axis=1)
            scale = np.where(mixed[:, None], correlated, [horizontal, horizontal, height])
            # Factors apply only to variances within the range of those stated for the GCPs
            gcps = np.flatnonzero(self.block.points.role == Role.GCP)
            stated = self.block.points.survey_covariance_m2(gcps).diagonal(axis1=1, axis2=2)
            low = np.min(stated, axis=0, initial=np.inf, where=np.isfinite(stated)) * (1.0 - EQUALITY.alike)
            high = np.max(stated, axis=0, initial=0.0, where=np.isfinite(stated)) * (1.0 + EQUALITY.alike)
            variance = covariance.diagonal(axis1=1, axis2=2)
            scale = np.where((variance >= low) & (variance <= high), scale, 1.0)
            return np.asarray(covariance * scale[:, :, None] * scale[:, None, :])

    def covariance_to_surveys_m2(self, points: np.ndarray) -> np.ndarray:
        """Return the covariances ``(k, 3, 3)`` of the differences of adjusted positions from the points' own surveys.

        The error of a coordinate operation that converted a check point as well as the GCPs shifts both, and is not
        part of the difference.

        Parameters
        ----------
        points : (k,) ndarray
            Check points.

        Returns
        -------
        (k, 3, 3) ndarray
            Of east, north and height in square metres, without the surveys' own.
        """
        covariance = self.ground_covariance_m2[points]
        if self.shared_shifts_m is None:
            return covariance
        shifts, operation_shifts = self.shared_shifts_m[points], self.block.points.operation_shifts_m(points)
        shifts[:, :, : operation_shifts.shape[2]] -= operation_shifts
        return np.asarray(covariance + shifts @ shifts.swapaxes(1, 2))

    @cached_property
    def positions(self) -> np.ndarray:
        """The best known position of each point, ``(points, 3)``: adjusted, else surveyed; NaN without either."""
        return np.where(np.isfinite(self.ground), self.ground, self.block.points.ground)

    @cached_property
    def middle(self) -> tuple[float, ...]:
        """Longitude, latitude and height of the middle of the block, the median of its points."""
        return middle_position(self.positions)

    @cached_property
    def has_residual(self) -> np.ndarray:
        """True for measurements that have residuals, ``(measurements,)``."""
        return finite_rows(self.residual_px)

    @cached_property
    def is_used_tie(self) -> np.ndarray:
        """True for the measurements of tie points that are used, ``(measurements,)``."""
        return self.has_residual & (self.block.points.role == Role.TIE)[self.block.measurements.point]

    @property
    def tested_residual_px(self) -> np.ndarray:
        """The residuals by which measurements are tested, ``(measurements, 2)``: those of the estimated cameras."""
        return self.residual_px if self.estimate_residual_px is None else self.estimate_residual_px
