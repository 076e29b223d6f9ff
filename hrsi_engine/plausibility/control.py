"""Fit of surveyed points to the images on which they are measured, with a free shift of each image's RPC.

    e = position on the ray at the surveyed height - survey = shift of the image + misfit of the point (m east, north)

The shift of an image is the median over its points. The shifts are compared with the a priori accuracy of the RPCs, the
robust scatter of the misfits with the noise of measurement and survey. Two hypotheses about the same numbers (as given,
and with an input error corrected) are compared by minus twice the logarithm of their likelihoods::

    cost = sum over images of 4 f ln(s) + rho(shift / sigma)        f: number of points minus one, for the shift

with the scatter ``s`` of both coordinates, at least that of correct blocks; ``rho`` is the square up to ten sigmas and
grows as a logarithm beyond. A shift of five sigmas costs 25. A drift of the RPC correlates the misfits of an image: at
most five of them count as independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..block.block import Block, Image, stack_rpcs
from ..foundation.large_arrays import finite_rows
from ..foundation.robust_scale import MAD_TO_SIGMA
from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import ground_difference_m
from .accuracy import SIMULATED, ImageAccuracy


@thresholds
class CONTROL_FIT:
    """Limits for the agreement of surveyed points with the images on which they are measured."""

    agreeing_share: float = threshold(0.7, "", "smallest share of agreeing points of an image that fits", SIMULATED)
    usual_scatter: float = threshold(2.5, "", "largest robust scatter over the expected one", SIMULATED)
    agreeing_sigmas: float = threshold(8.0, "sigma", "largest error of an agreeing point in sigmas", SIMULATED)


NOWHERE_M = 2e7  # distance of a point without a ray: half round the Earth
MEDIAN_LENGTH = 1.1774  # sqrt(2 ln 2): median length of a normal vector in the plane, in its sigmas


@dataclass(frozen=True, eq=False)
class StraightRays:
    """Rays as straight lines: a point ``ground (n, 3)`` of each, and ``slope (n, 2)``, metres east, north per metre up.

    Surveys are compared with rays on the ground, not in the image: localisation works for every surveyed position,
    while projection is meaningless far outside the RPC's domain. If the surveyed height changes, the rays remain valid.
    """

    ground: np.ndarray
    slope: np.ndarray

    def distance_m(self, surveyed: np.ndarray) -> np.ndarray:
        """Return metres east and north ``(n, 2)`` from surveyed points to their rays at the surveyed height."""
        away_m = ground_difference_m(surveyed, self.ground)
        across = self.slope * away_m[:, 2:] - away_m[:, :2]
        across[~finite_rows(across)] = NOWHERE_M
        return across

    def select(self, rows: np.ndarray) -> StraightRays:
        """Return the rays of the given rows (indices or mask)."""
        return StraightRays(self.ground[rows], self.slope[rows])

    def replace(self, rows: np.ndarray, replacement: StraightRays) -> StraightRays:
        """Return a copy of the rays in which those of a mask ``rows`` are replaced by ``replacement``."""
        ground, slope = self.ground.copy(), self.slope.copy()
        ground[rows], slope[rows] = replacement.ground, replacement.slope
        return StraightRays(ground, slope)


def compute_sightlines(images: Sequence[Image], image: np.ndarray, xy: np.ndarray) -> StraightRays:
    """Return the rays of image points ``xy (n, 2)`` on images by index ``(n,)``, over the RPC's height range."""
    if not len(xy):
        return StraightRays(np.empty((0, 3)), np.empty((0, 2)))
    rpcs = [one.rpc for one in images]
    stack = stack_rpcs(images)
    middle, high = np.array([(rpc.height_off, rpc.height_range[1]) for rpc in rpcs])[image].T
    ground, upper = (stack.localize(image, xy, height) for height in (middle, high))
    return StraightRays(ground, ground_difference_m(upper, ground)[:, :2] / (high - middle)[:, None])


@dataclass(frozen=True, eq=False)
class ControlMeasurements:
    """Measurements of surveyed points (GCPs and check points).

    point, image : (n,) indices into the block's points and images
    xy : (n, 2) sample, line; ground : (n, 3) surveyed lon, lat, height; sights : rays of the measurements
    noise_m : (n,) standard deviation of a misfit from measurement and survey; expected_m : (n,) including RPC drift
    accuracies : a priori accuracy of every image of the block
    """

    block: Block
    point: np.ndarray
    image: np.ndarray
    xy: np.ndarray
    ground: np.ndarray
    sights: StraightRays
    noise_m: np.ndarray
    expected_m: np.ndarray
    accuracies: Sequence[ImageAccuracy]

    def __len__(self) -> int:
        return len(self.point)

    @cached_property
    def images(self) -> np.ndarray:
        """Indices of the images on which surveyed points are measured."""
        return np.unique(self.image)

    @cached_property
    def points(self) -> np.ndarray:
        """Indices of the surveyed points that are measured."""
        return np.unique(self.point)

    def get_figures(self, name: str) -> np.ndarray:
        """Return one field of `ImageAccuracy` for every image of the block, ``(images,)``."""
        return np.array([getattr(accuracy, name) for accuracy in self.accuracies])

    def select(self, rows: np.ndarray) -> ControlMeasurements:
        """Return the measurements of the given rows (indices or mask)."""
        columns = ("point", "image", "xy", "ground", "noise_m", "expected_m")
        return replace(self, sights=self.sights.select(rows), **{name: getattr(self, name)[rows] for name in columns})

    def point_ids(self, points: np.ndarray) -> tuple[str, ...]:
        """Return the ids of points by index."""
        return tuple(self.block.points.ids[points].tolist())

    def image_ids(self, images: np.ndarray) -> tuple[str, ...]:
        """Return the ids of images by index."""
        return tuple(self.block.images[index].id for index in images)


def collect_control(block: Block, accuracies: Sequence[ImageAccuracy]) -> ControlMeasurements | None:
    """Return the measurements of a block's surveyed points (GCPs and check points), or None if there are none."""
    sigma = np.sqrt(np.maximum(block.points.survey_covariance_m2().diagonal(axis1=1, axis2=2), 0.0))
    is_surveyed = block.known & finite_rows(block.points.ground) & finite_rows(sigma)
    rows = np.flatnonzero(is_surveyed[block.measurements.point])
    if not len(rows):
        return None
    measured = block.measurements
    point, image, xy = measured.point[rows], measured.image[rows], measured.xy[rows]
    rays = compute_sightlines(block.images, image, xy)
    gsd = np.array([accuracy.gsd_m for accuracy in accuracies])[image]
    noise = np.sqrt(
        (gsd * measured.sigma_px[rows]) ** 2
        + sigma[point, :2].max(axis=1) ** 2
        + np.nan_to_num(np.sum(rays.slope**2, axis=1)) * sigma[point, 2] ** 2
    )
    centre = np.array([one.centre_px for one in block.images])[image]
    drift = np.array([accuracy.drift for accuracy in accuracies])[image]
    expected = np.hypot(noise, drift * gsd * np.hypot(*(xy - centre).T))
    return ControlMeasurements(
        block=block,
        point=point,
        image=image,
        xy=xy,
        ground=block.points.ground[point],
        sights=rays,
        noise_m=noise,
        expected_m=expected,
        accuracies=accuracies,
    )


@dataclass(frozen=True, eq=False)
class ControlFit:
    """Fit of the surveyed points to their images under one hypothesis about the coordinates.

    distance_m : (n, 2) east, north from the survey to the ray; shift_m : (images, 2) median of it, NaN without points
    misfit_m : (n, 2) distance without the shift
    scatter : (images,) robust sigma of the misfits over the expected one; 0 for fewer than two points
    """

    control: ControlMeasurements
    distance_m: np.ndarray
    shift_m: np.ndarray
    misfit_m: np.ndarray
    scatter: np.ndarray

    @cached_property
    def shift_length_m(self) -> np.ndarray:
        """Length of each image's shift in metres ``(images,)``, 0 without points."""
        return np.asarray(np.hypot(*np.nan_to_num(self.shift_m).T))

    @cached_property
    def shift_sigmas(self) -> np.ndarray:
        """Length of each image's shift in a priori standard deviations of its RPC ``(images,)``."""
        return np.asarray(self.shift_length_m / self.control.get_figures("sigma_m"))

    @cached_property
    def agreeing_m(self) -> np.ndarray:
        """Largest misfit of a measurement that agrees with the shift of its image, the largest drift included."""
        drifting_m = self.control.get_figures("misfit_m")[self.control.image]
        return np.maximum(drifting_m, CONTROL_FIT.agreeing_sigmas * self.control.expected_m)

    @cached_property
    def belongs(self) -> np.ndarray:
        """True for measurements that agree with the shift of their image up to the largest drift, ``(n,)`` bool."""
        return np.asarray(np.hypot(*self.misfit_m.T) <= self.agreeing_m)

    @cached_property
    def fitting(self) -> np.ndarray:
        """True for images whose shift an RPC can have and with which most points agree, ``(images,)`` bool."""
        control = self.control
        count = np.bincount(control.image, minlength=len(control.accuracies))
        agree = np.bincount(control.image[self.belongs], minlength=len(control.accuracies))
        is_near = self.shift_length_m <= control.get_figures("far_m")
        return np.asarray((agree >= np.where(count < 4, count, CONTROL_FIT.agreeing_share * count)) & is_near)

    @property
    def fits(self) -> bool:
        """True if all images fit their points."""
        return bool(self.fitting[self.control.images].all())

    @cached_property
    def cost(self) -> float:
        """Minus twice the logarithm of the likelihood."""
        control = self.control
        freedom = np.maximum(np.bincount(control.image, minlength=len(self.scatter)) - 1, 0)
        by_shift = np.minimum(self.shift_sigmas[control.images], 1e9) ** 2
        by_scatter = 4.0 * freedom * np.log(np.maximum(self.scatter, CONTROL_FIT.usual_scatter))
        return float(by_scatter.sum() + by_shift.sum())


def fit_control(
    control: ControlMeasurements, ground: np.ndarray | None = None, rays: StraightRays | None = None
) -> ControlFit:
    """Return the fit of surveyed points ``ground (n, 3)`` to the rays ``rays``; by default as in the control."""
    surveyed = control.ground if ground is None else ground
    distance = (control.sights if rays is None else rays).distance_m(surveyed)
    shift = np.full((len(control.accuracies), 2), np.nan)
    scatter = np.zeros(len(control.accuracies))
    for index in control.images:
        rows = control.image == index
        shift[index] = np.median(distance[rows], axis=0)
        if (count := int(rows.sum())) > 1:  # the shift is estimated: k points have k - 1 degrees of freedom
            relative = np.hypot(*(distance[rows] - shift[index]).T) / control.expected_m[rows]
            scatter[index] = np.median(relative) * np.sqrt(count / (count - 1.0)) / MEDIAN_LENGTH
    return ControlFit(control, distance, shift, distance - shift[control.image], scatter)


# ---- points that disagree with the others ----------------------------------------------------------------------------


@thresholds
class GROUP:
    """Limits for surveyed points that disagree with the others, singly or as a cluster of misfits."""

    gap_ratio: float = threshold(8.0, "", "smallest gap of two clusters or points over their spread", SIMULATED)
    fewest_points: int = threshold(4, "points", "fewest points that can be tested for clusters")
    directions: int = threshold(12, "directions", "directions in plan in which clusters are sought")
    least_lean: float = threshold(0.02, "m/m", "smallest difference of a ray's slope from the others' for a height")


@dataclass(frozen=True, eq=False)
class InconsistentPoints:
    """Surveyed points that disagree with the other ones.

    points : (k,) indices into the block's points
    step_m : (3,) their median offset from the others east, north, up; up is NaN where the rays do not determine it
    gap : distance from the others over the spread; group : True if they have a common offset
    """

    points: np.ndarray
    step_m: np.ndarray
    gap: float
    group: bool


def find_disagreement(control_fit: ControlFit) -> InconsistentPoints | None:
    """Return the surveyed points, at most half of them, that disagree with the others; None where all agree.

    Each point has one vector: the mean over its images of its misfit east and north, and its parallax, the mean misfit
    along the direction in which the image's ray leans from the point's mean ray. The parallax shows a wrong height,
    which moves images of different directions against each other. Two clusters of these vectors, whose gap is several
    times their spread, show that two surveys were mixed.
    """
    control = control_fit.control
    points = control.points
    if len(points) < GROUP.fewest_points:
        return None
    place = np.searchsorted(points, control.point)
    count = np.bincount(place)

    def average(values: np.ndarray) -> np.ndarray:
        """Return the means ``(p, …)`` over the points' measurements."""
        return np.column_stack([np.bincount(place, column) for column in values.T]) / count[:, None]

    lean = control.sights.slope - average(control.sights.slope)[place]
    length = np.hypot(*lean.T)
    along = np.sum(control_fit.misfit_m * lean, axis=1) / np.maximum(length, 1e-9)
    along[length < GROUP.least_lean] = 0.0
    vector = average(np.column_stack([control_fit.misfit_m, along]))
    expected = np.sqrt(np.bincount(place, control.noise_m**2) / count)
    # The smaller of two clusters of points, and the gap between them over their spread
    best: tuple[np.ndarray, float] | None = None
    angles = np.pi * np.arange(GROUP.directions) / GROUP.directions
    directions = np.vstack(
        [np.column_stack([np.cos(angles), np.sin(angles), np.zeros(GROUP.directions)]), [[0.0, 0.0, 1.0]]]
    )
    for direction in directions:
        along = vector @ direction
        order = np.argsort(along)
        step = np.diff(along[order])
        step[[0, -1]] = 0.0  # a cluster has at least two points
        cut = int(np.argmax(step))
        if not step[cut] > 0.0:
            continue
        low, high = order[: cut + 1], order[cut + 1 :]
        # The standard deviation within a cluster, doubled for two or three points, whose range determines it poorly
        spreads = [float(np.std(along[part], ddof=1)) * (2.0 if len(part) < 4 else 1.0) for part in (low, high)]
        scatter = max(*spreads, float(np.median(expected)))
        gap = float(step[cut] / scatter)
        if gap > GROUP.gap_ratio and (best is None or gap > best[1]):
            smaller = np.zeros(len(vector), dtype=bool)
            smaller[low if len(low) <= len(high) else high] = True
            best = smaller, gap
    if best is not None:
        return _describe_disagreement(control_fit, points, vector, *best, group=True)
    deviation = np.abs(vector - np.median(vector, axis=0))  # jitter spreads the parallaxes alone
    away = (deviation / np.maximum(MAD_TO_SIGMA * np.median(deviation, axis=0), expected[:, None])).max(axis=1)
    is_off = away > GROUP.gap_ratio
    if not is_off.any() or is_off.sum() > len(points) / 2:
        return None
    return _describe_disagreement(control_fit, points, vector, is_off, float(away[is_off].min()), group=False)


def _describe_disagreement(
    control_fit: ControlFit, points: np.ndarray, vector: np.ndarray, is_off: np.ndarray, gap: float, group: bool
) -> InconsistentPoints:
    step = -(np.median(vector[is_off], axis=0) - np.median(vector[~is_off], axis=0))
    control = control_fit.control
    place = np.searchsorted(points, control.point)
    lean = np.hypot(*(control.sights.slope - np.median(control.sights.slope, axis=0)).T)[is_off[place]]
    typical = float(np.median(lean)) if len(lean) else 0.0
    height = -step[2] / typical if typical > GROUP.least_lean else np.nan
    return InconsistentPoints(points[is_off], np.array([step[0], step[1], height]), gap, group)
