"""The measurements and points that are used in an adjustment, in the order for the solver.

A point is used if the observations determine its position: measured on two images, or a GCP (whose surveyed position is
itself an observation). Positions of check points and held-out tie points are computed in every pass, with full
precision, but by default these points do not contribute to the cameras, so that they are an independent check.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..block.block import Block, Image, Role, number_exposures
from ..block.columns import group_by_number
from ..block.orthoimage import REFERENCE_KIND, ReferencePlaces
from ..foundation.large_arrays import any_of_rows

COORDINATE_PAIRS = ([0, 0, 1], [1, 2, 2])  # rows and columns of east-north, east-height, north-height


@dataclass(frozen=True, eq=False)
class Observations:
    """Measurements of the adjusted points, sorted by point; indices refer to the columns below.

    rows : (n,) indices of the measurements in the block
    points : (m,) indices of the adjusted points in the block
    point, image : (n,) index of each measurement's point (into ``points``) and image
    first : (m + 1,) measurements ``first[i]:first[i + 1]`` belong to point i
    survey, survey_weight : (m, 3) surveyed positions of GCPs and their weights 1/m²; weight 0 for coordinates that are
        not surveyed (an infinite sigma makes a point horizontal or height control only)
    survey_correlation : (m, 3) of east-north, east-height, north-height of each survey; None: all zero
    referenced : (m,) True for places of a reference, whose plan is observed (`reference_plan`); None: there are none
    alike : (m,) True for GCPs by matching with a reference, which share most of their error; None: there are none
    contributes : (n,) True for measurements that are used to determine the cameras
    camera_of_image : (images,) index of each image's set of parameters; images of one strip may share one
    """

    images: tuple[Image, ...]
    rows: np.ndarray
    points: np.ndarray
    point: np.ndarray
    image: np.ndarray
    xy: np.ndarray
    sigma_px: np.ndarray
    first: np.ndarray
    survey: np.ndarray
    survey_weight: np.ndarray
    contributes: np.ndarray
    camera_of_image: np.ndarray
    survey_correlation: np.ndarray | None = None
    referenced: np.ndarray | None = None
    alike: np.ndarray | None = None

    @property
    def count(self) -> int:
        """Number of image points."""
        return len(self.point)

    @property
    def cameras(self) -> int:
        """Number of sets of parameters."""
        return int(self.camera_of_image.max(initial=-1)) + 1

    @cached_property
    def camera(self) -> np.ndarray:
        """Index of the set of parameters of each measurement, ``(n,)``."""
        return self.camera_of_image[self.image]

    @cached_property
    def places(self) -> np.ndarray:
        """Position of each measurement in its image, scaled to -1 to 1 in sample and line, ``(n, 2)``."""
        middle = np.array([image.centre_px for image in self.images]).reshape(-1, 2)
        half = np.array([image.half_size_px for image in self.images]).reshape(-1, 2)
        return np.asarray((self.xy - middle[self.image]) / half[self.image])

    @property
    def surveyed(self) -> np.ndarray:
        """Mask of the points with a survey of any coordinate."""
        return any_of_rows(self.survey_weight > 0.0)

    @property
    def located(self) -> np.ndarray:
        """Mask of the points for which one ray is enough: those with a survey, and places of a reference."""
        return self.surveyed if self.referenced is None else self.surveyed | self.referenced

    @property
    def correlated(self) -> np.ndarray:
        """Mask of the points whose survey has correlations."""
        if self.survey_correlation is None:
            return np.zeros(len(self.points), dtype=bool)
        return any_of_rows(self.survey_correlation != 0.0)

    @cached_property
    def contributing_points(self) -> np.ndarray:
        """Mask of the points that are used to determine the cameras."""
        return self.contributes[self.first[:-1]]

    @cached_property
    def by_image(self) -> tuple[np.ndarray, ...]:
        """Indices of each image's measurements."""
        order, bounds = group_by_number(self.image, len(self.images))
        return tuple(order[bounds[k] : bounds[k + 1]] for k in range(len(self.images)))

    @cached_property
    def by_length(self) -> dict[int, np.ndarray]:
        """Indices of the points with k measurements, by track length k."""
        lengths = np.diff(self.first)
        return {int(k): np.flatnonzero(lengths == k) for k in np.unique(lengths)}

    def count_rays(self, is_used: np.ndarray) -> np.ndarray:
        """Return the number of rays of each point ``(m,)``, from the measurements that are ``is_used (n,)``.

        Tiles and bands of one exposure have one common ray to a point.
        """
        exposure = number_exposures(self.images)
        if exposure.max(initial=-1) + 1 == len(exposure):
            return np.add.reduceat(is_used, self.first[:-1], dtype=np.int64)
        rays = np.unique(np.column_stack([self.point, exposure[self.image]])[is_used], axis=0)
        return np.bincount(rays[:, 0], minlength=len(self.points))

    def find_rows(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the measurements of some points in order, and the first row of each point among them."""
        lengths = self.first[points + 1] - self.first[points]
        place = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(lengths)])
        rows = np.arange(place[-1]) + np.repeat(self.first[points] - place[:-1], lengths)
        return rows, place[:-1]

    def drop_points(self, dropped: np.ndarray) -> Observations:
        """Return the observations without some of the points (mask over ``points``)."""
        keep = ~dropped[self.point]
        new_index = np.cumsum(~dropped) - 1
        point = new_index[self.point[keep]]
        return Observations(
            images=self.images,
            rows=self.rows[keep],
            points=self.points[~dropped],
            point=point,
            image=self.image[keep],
            xy=self.xy[keep],
            sigma_px=self.sigma_px[keep],
            first=np.searchsorted(point, np.arange((~dropped).sum() + 1)),
            survey=self.survey[~dropped],
            survey_weight=self.survey_weight[~dropped],
            contributes=self.contributes[keep],
            camera_of_image=self.camera_of_image,
            survey_correlation=None if self.survey_correlation is None else self.survey_correlation[~dropped],
            referenced=None if self.referenced is None else self.referenced[~dropped],
            alike=None if self.alike is None else self.alike[~dropped],
        )


def select_observations(
    block: Block, check_as_ties: bool = False, reference: ReferencePlaces | None = None
) -> Observations:
    """Return the measurements of every point whose position can be computed.

    With ``check_as_ties`` the image points of check points (not their survey) are used to determine the cameras. GCPs
    that are places of a ``reference`` have no survey here; GCPs from matching with a reference have theirs.
    """
    control = block.points.role == Role.GCP
    usable = control | (block.rays_per_point() >= 2)
    passive = [Role.HELD_OUT] if check_as_ties else [Role.HELD_OUT, Role.CHECK]
    contributing = ~np.isin(block.points.role, passive)
    if reference is None:
        return select_points(block, usable, control, contributing)
    places = control & np.isin(block.points.ids, reference.ids)
    observations = select_points(block, usable, control & ~places, contributing)
    return replace(observations, referenced=places[observations.points])


def select_points(
    block: Block, usable: np.ndarray, surveyed: np.ndarray | None = None, contributing: np.ndarray | None = None
) -> Observations:
    """Return the observations of the ``usable`` points (masks over the block's points).

    ``surveyed`` points have their survey as observation (default: none), ``contributing`` ones are used to determine
    the cameras (default: all).
    """
    surveyed = np.zeros(len(block.points), dtype=bool) if surveyed is None else surveyed
    contributing = np.ones(len(block.points), dtype=bool) if contributing is None else contributing
    rows = np.flatnonzero(usable[block.measurements.point])
    is_complete = len(rows) == len(block.measurements)  # then its columns are used without a copy
    measurements = block.measurements if is_complete else block.measurements.select(rows)
    taking_part = np.zeros(len(block.points), dtype=bool)
    taking_part[measurements.point] = True
    points = np.flatnonzero(taking_part)
    point = (np.cumsum(taking_part) - 1)[measurements.point]
    survey = block.points.ground[points]
    has_survey = surveyed[points][:, None] & np.isfinite(survey)
    carrying = surveyed[points]  # (m,)
    # Each coordinate's own weight, and the correlations
    weight, correlation = np.zeros((len(points), 3)), np.zeros((len(points), 3))
    covariance = block.points.survey_covariance_m2(points[carrying])
    variance = covariance.diagonal(axis1=1, axis2=2)
    weight[carrying] = 1.0 / variance
    row, column = COORDINATE_PAIRS
    with np.errstate(invalid="ignore"):
        pairs = covariance[:, row, column] / np.sqrt(variance[:, row] * variance[:, column])
    correlation[carrying] = np.nan_to_num(pairs)  # infinite variances
    # Surveyed points that were found by matching with a reference
    of_gcps = carrying[point]
    of_reference = np.zeros(len(points), dtype=bool)
    of_reference[point[of_gcps][block.measurements.kind[rows[of_gcps]] == REFERENCE_KIND]] = True
    return Observations(
        images=block.images,
        rows=rows,
        points=points,
        point=point,
        image=measurements.image,
        xy=measurements.xy,
        sigma_px=measurements.sigma_px,
        first=np.searchsorted(point, np.arange(len(points) + 1)),
        survey=np.where(has_survey, survey, np.nan),
        survey_weight=np.where(has_survey, weight, 0.0),
        contributes=contributing[measurements.point],
        camera_of_image=np.arange(len(block.images), dtype=np.int32),
        survey_correlation=correlation if correlation.any() else None,
        alike=of_reference if of_reference.any() else None,
    )
