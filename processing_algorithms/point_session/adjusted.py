"""The adjustment of a session, and its continuation after edits, for display in the panel."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ...hrsi_engine.adjustment.following import BlockUpdater
from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.block.block import Block
from ...hrsi_engine.refinement.model import RefinementModel
from ...hrsi_engine.results.residuals import Residuals
from ...hrsi_engine.results.verdict import Verdict
from ..block_steps.summary import verdict_lines
from .rows import Key


def describe_outlier(image_id: str, statistic: float) -> str:
    """Return the remark of a table on an outlying measurement."""
    return f"{image_id}: {statistic:.1f} sigma off"


@dataclass(frozen=True, eq=False)
class ListedMeasurements:
    """The measurements that tables list: block, keys, and the standard deviations (n, 2) for their tests, px."""

    block: Block
    keys: Sequence[Key]
    sigma_px: np.ndarray

    @cached_property
    def row_of(self) -> dict[Key, int]:
        """Row number of each measurement."""
        return {key: row for row, key in enumerate(self.keys)}

    @cached_property
    def typical_px(self) -> np.ndarray:
        """Median of `sigma_px` of the known points' measurements in each image ``(images, 2)``; 0 if there are none."""
        rows = self.block.measurements
        usable = np.flatnonzero(self.block.known[rows.point] & np.isfinite(self.sigma_px).all(axis=1))
        image, typical = rows.image[usable], np.zeros((len(self.block.images), 2))
        for index in np.unique(image).tolist():
            typical[index] = np.median(self.sigma_px[usable[image == index]], axis=0)
        return typical


class CurrentResiduals:
    """Residuals (px) by point and image, with the present cameras; ``now`` has those of edited points."""

    def __init__(
        self,
        watched: ListedMeasurements,
        left: np.ndarray,
        edited: Collection[str],
        now: dict[Key, tuple[float, float]],
    ) -> None:
        self._watched, self._left, self._edited, self._now = watched, left, frozenset(edited), now

    def get(self, key: Key, default: tuple[float, float]) -> tuple[float, float]:
        """Return the residual of a measurement, or ``default``."""
        row = None if key[0] in self._edited else self._watched.row_of.get(key)
        return self._now.get(key, default) if row is None else (float(self._left[row, 0]), float(self._left[row, 1]))


@dataclass(frozen=True, eq=False)
class CurrentView:
    """State of a block with its present measurements, for display in the panel.

    corrections : parameters of the model by image id
    residual_px : by (point, image), observed - computed from the surveyed position
    residual_m : by point, survey - computed
    statistics : by (point, image), length of the residual in standard deviations
    image_suspicions, point_suspicions : reasons, by the same keys
    """

    model: RefinementModel
    corrections: Mapping[str, np.ndarray]
    residual_px: CurrentResiduals | Mapping[Key, tuple[float, float]]
    residual_m: Mapping[str, tuple[float, float, float]]
    statistics: Mapping[Key, float]
    image_suspicions: Mapping[Key, str]
    point_suspicions: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def measurement_suspicions(self) -> dict[str, list[str]]:
        """Reasons why measurements of a point are suspicious, by point."""
        found: dict[str, list[str]] = {}
        for (point, _), reason in self.image_suspicions.items():
            found.setdefault(point, []).append(reason)
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class AdjustmentView(CurrentView):
    """An adjustment for display in the panel.

    verdict : of the block; check : figures of the check points as in the report
    unchecked_gcps : number of GCPs if no residual can show an error of one, otherwise None
    follower : continues the adjustment after edits of points; listed : ids of the points of the list
    """

    verdict: Verdict
    unchecked_gcps: int | None
    check: Mapping[str, Any]
    warnings: tuple[str, ...]
    result: Adjustment
    left: Residuals
    follower: BlockUpdater
    listed: Collection[str] = frozenset()

    @cached_property
    def watched(self) -> ListedMeasurements:
        """The listed measurements, whose residuals are computed again after each edit."""
        block = self.result.block
        rows = (block.known | np.isin(block.points.ids, list(self.listed)))[block.measurements.point]
        kept = block.with_measurements(rows)
        return ListedMeasurements(kept, list_keys(kept), self.left.measured_sigma_px[rows])

    @property
    def headline(self) -> str:
        """The verdict in one line."""
        return verdict_lines(self.verdict.entry())[-1]


def list_keys(block: Block) -> list[Key]:
    """Return point and image ids of each measurement."""
    rows, image_ids = block.measurements, np.array([image.id for image in block.images], dtype=object)
    return list(zip(block.points.ids[rows.point].tolist(), image_ids[rows.image].tolist(), strict=True))
