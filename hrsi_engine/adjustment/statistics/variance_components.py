"""Variance components: the sigmas of groups of observations, from their residuals (Helmert 1907; Förstner 1979).

For a group g with weighted squares W_g and redundancy r_g (the sum of its redundancy numbers), s_g² = W_g / r_g is the
variance factor of its sigma. The adjustment is repeated with corrected sigmas until every s_g is 1. A group that the
block does not control (r_g small) keeps its sigma; but for the image points of GCPs the factor of the tie points on
their images has the weight of `REDUNDANCY.stated` observations, and for each image that of its groups has that of
`REDUNDANCY.common` (an inverse chi² distribution of the variance; Gelman et al. 2013, section 5.4). Surveys with
correlated coordinates are a separate group, whose covariances are scaled as a whole: east, north and height can hardly
be distinguished there. GCPs that are places of a reference keep their sigmas, which contain an error common to all, on
which their scatter has no information. And no sigma of matching falls below `VARIANCE.least_matched_px`, also if points
without noise fit one another better: otherwise model errors of hundredths of a pixel would be blunders.

Image points of GCPs and check points, which are measured manually, are separated from those of tie points; further
groups are by kind of measurement, sensor, or image (`GROUPINGS`). Images are of one sensor if the user states so,
otherwise if their pixels have the same size on the ground.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...block.block import Block, Image, Role
from ...block.laser import LASER_KIND
from ...block.orthoimage import REFERENCE_KIND
from ...block.pointing import compute_gsds_m
from ...foundation.thresholds import EQUALITY, REDUNDANCY, threshold, thresholds
from ..gauss_newton import Solution
from ..observations import Observations
from ..result import VarianceComponent
from .precision import Precision


@thresholds
class VARIANCE:
    """Limits for the estimation of a priori sigmas from residuals (variance components)."""

    least_matched_px: float = threshold(0.02, "px", "smallest sigma of image matching", "Förstner 1982, Grün 1985")


SURVEY_GROUPS = ("GCP east, north", "GCP height", "GCP covariances")
SURVEYS = len(SURVEY_GROUPS)
OF_GCPS = "image points of GCPs"


def group_by_sensor(images: Sequence[Image], groups: Sequence[Sequence[str]] = ()) -> tuple[np.ndarray, list[str]]:
    """Return the sensor of each image ``(images,)`` and the sensors' names; a single one has no name.

    ``groups`` of ids from the user come first; the other images are joined if, sorted by pixel size, each is within
    `EQUALITY.size` of the one before.
    """
    number = np.full(len(images), -1)
    place = {image.id: index for index, image in enumerate(images)}
    for group, ids in enumerate(groups):
        number[[place[name] for name in ids]] = group
    names = ["+".join(ids) for ids in groups]
    remaining = np.flatnonzero(number < 0)
    size = compute_gsds_m([images[index] for index in remaining.tolist()])
    order = np.argsort(size)
    another = np.r_[True, size[order][1:] > EQUALITY.size * size[order][:-1]][: len(remaining)]
    number[remaining[order]] = len(groups) - 1 + np.cumsum(another)
    names += [
        f"{np.median(size[order][p]):.2g} m" for p in np.split(np.arange(len(remaining)), np.flatnonzero(another))[1:]
    ]
    return number, names if len(names) > 1 else [""]


def _number_kinds(block: Block, rows: np.ndarray, _groups: Sequence[Sequence[str]]) -> tuple[np.ndarray, list[str]]:
    kind = block.measurements.kind[rows]
    if not len(kind) or (kind == kind[0]).all():  # sorting millions of equal texts takes longer than the adjustment
        return np.zeros(len(kind), dtype=np.int64), kind[:1].tolist() or [""]
    kinds, number = np.unique(kind, return_inverse=True)
    return number, kinds.tolist()


def _number_sensors(block: Block, rows: np.ndarray, groups: Sequence[Sequence[str]]) -> tuple[np.ndarray, list[str]]:
    number, names = group_by_sensor(block.images, groups)
    return number[block.measurements.image[rows]], names


def _number_images(block: Block, rows: np.ndarray, _groups: Sequence[Sequence[str]]) -> tuple[np.ndarray, list[str]]:
    return block.measurements.image[rows].astype(np.int64), [image.id for image in block.images]


Grouping = Callable[[Block, np.ndarray, Sequence[Sequence[str]]], tuple[np.ndarray, list[str]]]
#: Criteria for groups of image points: functions from block, rows and the user's sensors to group indices and names.
GROUPINGS: dict[str, tuple[Grouping, ...]] = {
    "kind-sensor": (_number_kinds, _number_sensors),
    "kind": (_number_kinds,),
    "sensor": (_number_sensors,),
    "image": (_number_images,),
    "kind-image": (_number_kinds, _number_images),
}


@dataclass(frozen=True, eq=False)
class Groups:
    """Group index of each image point ``(n,)``, and the groups' names, followed by those of the surveys.

    sensor : (images,) index of the set of images that groups do not distinguish
    cautious : names of groups whose sigmas are intentionally larger than the scatter between images: they include the
        error of the match with a reference, or with a laser point, which is common to all images
    """

    of_image_point: np.ndarray
    names: tuple[str, ...]
    sensor: np.ndarray
    cautious: frozenset[str] = frozenset()

    @classmethod
    def assign_groups(
        cls, block: Block, observations: Observations, grouping: str, sensor_groups: Sequence[Sequence[str]]
    ) -> Groups:
        """Return the groups: image points by an entry of `GROUPINGS`, followed by `SURVEY_GROUPS`."""
        number, names = np.zeros(observations.count, dtype=np.int64), [""]
        for split in GROUPINGS[grouping]:
            another, subgroups = split(block, observations.rows, sensor_groups)
            number = number * len(subgroups) + another
            names = [", ".join(filter(None, (name, extra))) for name in names for extra in subgroups]
        is_surveyed = (block.points.role != Role.TIE)[block.measurements.point[observations.rows]]
        number = number * 2 + is_surveyed
        has_ties = np.bincount(number, minlength=2 * len(names))[::2] > 0
        titles = [
            f"{prefix}: {name}" if name else prefix
            for name, with_ties in zip(names, has_ties.tolist(), strict=True)
            for prefix in ("image points", OF_GCPS if with_ties else "image points")
        ]
        kind = block.measurements.kind[observations.rows]
        is_image_kind = (kind != LASER_KIND) & (kind != REFERENCE_KIND)
        count = np.bincount(number, is_image_kind, minlength=len(titles))
        cautious = frozenset(title for title, points in zip(titles, count.tolist(), strict=True) if not points)
        splits, sensor = GROUPINGS[grouping], np.zeros(len(block.images), dtype=np.int64)
        if _number_images in splits:
            sensor = np.arange(len(block.images))
        elif _number_sensors in splits:
            sensor, _ = group_by_sensor(block.images, sensor_groups)
        return cls(number, (*titles, *SURVEY_GROUPS), sensor, cautious)

    def find_median_sigmas(self, observations: Observations) -> np.ndarray:
        """Return the median of each group's given sigmas, NaN for groups without observations."""
        median_sigmas = np.full(len(self.names), np.nan)
        order = np.lexsort((observations.sigma_px, self.of_image_point))
        count = np.bincount(self.of_image_point, minlength=len(median_sigmas) - SURVEYS)
        middle = np.cumsum(count) - count + count // 2
        median_sigmas[:-SURVEYS][count > 0] = observations.sigma_px[order][middle[count > 0]]
        surveyed = observations.survey_weight > 0.0
        for group in range(SURVEYS):
            weights = observations.survey_weight[surveyed & (number_survey_groups(observations) == group)]
            median_sigmas[group - SURVEYS] = np.median(1.0 / np.sqrt(weights)) if weights.size else np.nan
        return median_sigmas


def compute_group_sums(
    groups: Groups, observations: Observations, solution: Solution, precise: Precision
) -> np.ndarray:
    """Return weighted squares, redundancy and number of observations of each group, ``(groups, 3)``."""
    weighting, weight = solution.weighting, solution.weight
    is_used = (weight > 0.0) & weighting.contributes[observations.point]
    result = np.zeros((len(groups.names), 3))
    squares = weight * np.einsum("nc,nc->n", solution.normals.residual, solution.normals.residual)
    freedom = weight * np.trace(precise.residuals, axis1=1, axis2=2)
    for column, values in enumerate((squares, freedom, np.full(len(weight), 2.0))):
        sums = np.bincount(groups.of_image_point[is_used], values[is_used], minlength=len(groups.names) - SURVEYS)
        result[:-SURVEYS, column] = sums
    points = np.flatnonzero(weighting.contributes & weighting.points.held & observations.surveyed)
    priors = weighting.points
    counted, observed = priors.build_weight_matrices(points, observed=True), observations.survey_weight[points] > 0.0
    miss = priors.compute_misclosures_m(solution.state.ground[points], points)
    squares = np.where(observed, miss * np.einsum("kij,kj->ki", counted, miss), 0.0)
    decided = np.einsum("kij,kji->ki", counted, precise.points[points])
    informed = observed & (decided > REDUNDANCY.tested)
    squares, share = np.where(informed, squares, 0.0), np.where(informed, 1.0 - decided, 0.0)
    of_group = number_survey_groups(observations)[points]
    for group in range(SURVEYS):
        in_group = of_group == group
        result[group - SURVEYS] = squares[in_group].sum(), share[in_group].sum(), observed[in_group].sum()
    return result


def compute_image_sums(
    observations: Observations, solution: Solution, precise: Precision, sigma_ratio: np.ndarray
) -> np.ndarray:
    """Return squares and redundancy of the image points of each image ``(images, 2)``.

    The squares are those with sigmas that are ``sigma_ratio (n,)`` times as large as those of the solution.
    """
    used_rows = np.flatnonzero((solution.weight > 0.0) & solution.weighting.contributes[observations.point])
    weight, image = solution.weight[used_rows], observations.image[used_rows]
    residual = solution.normals.residual[used_rows]
    squares = np.einsum("nc,nc->n", residual, residual) / sigma_ratio[used_rows] ** 2
    columns = squares, np.trace(precise.residuals[used_rows], axis1=1, axis2=2)
    count = len(observations.images)
    return np.column_stack([np.bincount(image, weight * values, minlength=count) for values in columns])


def number_survey_groups(observations: Observations) -> np.ndarray:
    """Return the index in `SURVEY_GROUPS` of each coordinate of each point, ``(m, 3)``; `SURVEYS` for those of none."""
    groups = np.where(observations.correlated[:, None], 2, [0, 0, 1])
    return groups if observations.alike is None else np.where(observations.alike[:, None], SURVEYS, groups)


@dataclass(eq=False)
class Sigmas:
    """The current factors, one for each group, at least ``least``; those of groups that are not ``free`` do not change.

    The surveys' groups have a common factor with the weight of `REDUNDANCY.stated` observations in each, because, for
    example, the block hardly controls the heights of few GCPs. Image points of one group differ by image: ``of_image
    (images,)`` are additional factors.
    """

    factor: np.ndarray
    free: np.ndarray
    least: np.ndarray
    of_image: np.ndarray

    @classmethod
    def start_groups(cls, groups: Groups, observations: Observations, corrected: bool = False) -> Sigmas:
        """Return the given sigmas (factors of 1), none of them free.

        corrected : True if image points are corrected by curves of jitter. Then the sigmas of the GCPs' image points
            contain that of the curves, whose errors points share: small residuals do not show a small noise
        """
        median_sigmas, count = groups.find_median_sigmas(observations), len(groups.names)
        smallest = np.zeros(count)
        smallest[:-SURVEYS] = np.minimum(VARIANCE.least_matched_px / median_sigmas[:-SURVEYS], 1.0)
        if corrected:
            smallest[1:-SURVEYS:2] = smallest[-SURVEYS:] = 1.0
        images = np.ones(len(observations.images))
        return cls(np.ones(count), np.zeros(count, dtype=bool), np.nan_to_num(smallest), images)

    def correct_factors(self, sums: np.ndarray) -> float:
        """Correct the factors of the groups by their `compute_group_sums`; return the largest relative change."""
        squares, freedom = sums[:, 0] * self.factor**2, sums[:, 1]  # for the given sigmas
        usable = (freedom >= REDUNDANCY.estimated) & (squares > 0.0) & self.free
        variance_factors = np.where(usable, squares / np.maximum(freedom, REDUNDANCY.estimated), self.factor**2)
        # image points of GCPs (odd indices) are measured on the same images as the tie points (index before)
        ties, gcps = slice(0, -SURVEYS, 2), slice(1, -SURVEYS, 2)
        weight_of_ties = REDUNDANCY.stated * (self.free[gcps] & (freedom[ties] >= REDUNDANCY.estimated))
        pooled = (weight_of_ties * variance_factors[ties] + squares[gcps]) / np.maximum(
            weight_of_ties + freedom[gcps], REDUNDANCY.stated
        )
        variance_factors[gcps] = np.where(
            (weight_of_ties > 0.0) & (sums[gcps, 2] > 0.0), pooled, variance_factors[gcps]
        )
        survey = slice(-SURVEYS, None)
        if self.free[survey].all() and freedom[survey].sum() >= REDUNDANCY.estimated:
            surveyor = squares[survey].sum() / freedom[survey].sum()
            variance_factors[survey] = (REDUNDANCY.stated * surveyor + squares[survey]) / (
                REDUNDANCY.stated + freedom[survey]
            )
        ratio = np.clip(np.maximum(np.sqrt(variance_factors), self.least) / self.factor, 0.2, 5.0)
        self.factor = self.factor * ratio
        return float(np.abs(ratio - 1.0).max())

    def correct_images(self, sums: np.ndarray, sensor: np.ndarray) -> None:
        """Correct the factors of the images of each ``sensor (images,)`` by their `compute_image_sums`."""
        if self.free[:-SURVEYS].any():
            image_squares = REDUNDANCY.common + sums[:, 0] * self.of_image**2
            weight = REDUNDANCY.common + sums[:, 1]
            log_factor = 0.5 * np.log(image_squares / weight)
            # a factor common to all images of a sensor belongs to their groups
            mean = np.bincount(sensor, weight * log_factor) / np.maximum(np.bincount(sensor, weight), 1e-300)
            self.of_image = np.exp(log_factor - mean[sensor])

    def predict_survey_factors(self, sums: np.ndarray) -> np.ndarray:
        """Return the surveys' factors for the sigmas of new points, including the uncertainty of estimated ones.

        A sigma from r redundant observations has a relative standard deviation of 1 / sqrt(2 r); the error of a new
        point over it has Student's distribution, whose variance is r / (r - 2). Without this factor, limits stated for
        90 % of the errors would contain 86 % (r = 14).
        """
        factor, freedom = self.factor[-SURVEYS:], sums[-SURVEYS:, 1]
        freedom = np.minimum(freedom + REDUNDANCY.stated, freedom.sum())
        estimated = self.free[-SURVEYS:] & (freedom >= REDUNDANCY.estimated)
        r = np.maximum(freedom, REDUNDANCY.estimated)
        return np.asarray(factor * np.where(estimated, np.sqrt(r / (r - 2.0)), 1.0))

    def survey_weight(self, observations: Observations) -> np.ndarray:
        """Return the weights of all surveys ``(m, 3)``, also of rejected ones."""
        of_surveys = np.append(self.factor[-SURVEYS:], 1.0)  # surveys of no group keep their sigma
        return observations.survey_weight / of_surveys[number_survey_groups(observations)] ** 2


def list_components(
    groups: Groups, observations: Observations, sigmas: Sigmas, sums: np.ndarray
) -> tuple[VarianceComponent, ...]:
    """Return the variance components of groups with observations: their given sigmas and estimated factors."""
    given = groups.find_median_sigmas(observations)
    return tuple(
        VarianceComponent(
            group=name,
            observations=int(sums[k, 2]),
            redundancy=float(sums[k, 1]),
            factor=float(sigmas.factor[k]),
            sigma=float(sigmas.factor[k] * given[k]),
            unit="m" if name in SURVEY_GROUPS else "px",
            estimated=bool(sums[k, 1] >= REDUNDANCY.estimated and sigmas.free[k]),
        )
        for k, name in enumerate(groups.names)
        if sums[k, 2] > 0
    )


def describe_wrong_sigmas(
    components_found: Sequence[VarianceComponent], cautious: frozenset[str] = frozenset()
) -> list[str]:
    """Return messages on given sigmas that are wrong by half or more, the worst first, at most 8 of them.

    For ``cautious`` groups, sigmas that are too large are intended and not reported.
    """
    wrong_components = [
        part
        for part in components_found
        if part.estimated and (part.factor >= 1.5 or (part.factor <= 0.67 and part.group not in cautious))
    ]
    wrong_components.sort(key=lambda part: -abs(np.log(part.factor)))
    said = [
        f"{part.group}: the given sigma is {'too small' if part.factor > 1.0 else 'too large'}: from the residuals it "
        f"is {part.sigma:.3g} {part.unit} ({part.factor:.2f} times)"
        for part in wrong_components[:8]
    ]
    omitted = len(wrong_components) - len(said)
    return (
        [*said, f"the given sigmas of {omitted} more groups are wrong: see variance_components in the report"]
        if omitted
        else said
    )
