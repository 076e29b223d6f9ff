"""Which measurements and points take part in an adjustment, in the order the solver wants.

A point takes part when its position can follow from the observations: measured on two images, or a GCP (whose
surveyed position is itself an observation). Check points ride along: their positions are intersected in every pass,
with full precision, but by default they have no say in the cameras, so that they check independently.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..block import Block, Image, Role
from ..refinement import RefinementModel
from ..refinement.model import Linearise


@dataclass(frozen=True, eq=False)
class Observations:
    """Measurements of the adjusted points, sorted by point; indices refer to the columns below.

    rows : (n,) indices of the measurements in the block
    points : (m,) indices of the adjusted points in the block
    point, image : (n,) index of each measurement's point (into ``points``) and image
    first : (m + 1,) measurements ``first[i]:first[i + 1]`` belong to point i
    survey, survey_weight : (m, 3) surveyed positions of GCPs and their weights 1/m²; weight 0 where not surveyed
    contributes : (n,) whether the measurement has a say in the cameras
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

    @property
    def count(self) -> int:
        """Number of image points."""
        return len(self.point)

    @property
    def surveyed(self) -> np.ndarray:
        """Mask of the points with a survey."""
        return self.survey_weight[:, 0] > 0.0

    @cached_property
    def contributing_points(self) -> np.ndarray:
        """Mask of the points that have a say in the cameras."""
        return self.contributes[self.first[:-1]]

    @cached_property
    def by_image(self) -> tuple[np.ndarray, ...]:
        """Indices of each image's measurements."""
        order = np.argsort(self.image, kind="stable")
        bounds = np.searchsorted(self.image[order], np.arange(len(self.images) + 1))
        return tuple(order[bounds[k] : bounds[k + 1]] for k in range(len(self.images)))

    @cached_property
    def by_length(self) -> dict[int, np.ndarray]:
        """Track length k -> indices of the points with k measurements."""
        lengths = np.diff(self.first)
        return {int(k): np.flatnonzero(lengths == k) for k in np.unique(lengths)}

    def without(self, lost: np.ndarray) -> Observations:
        """Return the observations without some of the points (mask over ``points``)."""
        keep = ~lost[self.point]
        new_index = np.cumsum(~lost) - 1
        point = new_index[self.point[keep]]
        return Observations(
            self.images, self.rows[keep], self.points[~lost], point, self.image[keep], self.xy[keep],
            self.sigma_px[keep], np.searchsorted(point, np.arange((~lost).sum() + 1)), self.survey[~lost],
            self.survey_weight[~lost], self.contributes[keep],
        )  # fmt: skip

    def linearisers(self, model: RefinementModel) -> list[Linearise]:
        """Return the model's equations for each image's measurements."""
        return [model.equations(image, self.xy[rows]) for image, rows in zip(self.images, self.by_image, strict=True)]


def select(block: Block, check_as_ties: bool = False) -> Observations:
    """Return the measurements of every point whose position can be computed.

    ``check_as_ties`` lets the image points of check points (not their survey) take part in the cameras' estimation.
    """
    surveyed = block.points.role == Role.GCP
    usable = surveyed | (block.rays_per_point() >= 2)
    contributing = np.ones(len(block.points), dtype=bool) if check_as_ties else block.points.role != Role.CHECK
    return subset(block, usable, surveyed, contributing)


def subset(
    block: Block, usable: np.ndarray, surveyed: np.ndarray | None = None, contributing: np.ndarray | None = None
) -> Observations:
    """Return the observations of the ``usable`` points (masks over the block's points).

    ``surveyed`` points carry their survey (default: none), ``contributing`` ones have a say in the cameras
    (default: all).
    """
    surveyed = np.zeros(len(block.points), dtype=bool) if surveyed is None else surveyed
    contributing = np.ones(len(block.points), dtype=bool) if contributing is None else contributing
    rows = np.flatnonzero(usable[block.measurements.point])
    chosen = block.measurements.select(rows)
    points, point = np.unique(chosen.point, return_inverse=True)
    has_survey = surveyed[points]
    weight = np.zeros((len(points), 3))
    weight[has_survey] = 1.0 / block.points.sigma_m[points[has_survey]][:, [0, 0, 1]] ** 2
    return Observations(
        images=block.images,
        rows=rows,
        points=points,
        point=point,
        image=chosen.image,
        xy=chosen.xy,
        sigma_px=chosen.sigma_px,
        first=np.searchsorted(point, np.arange(len(points) + 1)),
        survey=np.where(has_survey[:, None], block.points.ground[points], np.nan),
        survey_weight=weight,
        contributes=contributing[chosen.point],
    )
