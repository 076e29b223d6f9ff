"""An adjustment of a session, as the panel shows it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...hrsi_engine.adjustment.following import Follower
from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.block.block import Block
from ...hrsi_engine.refinement.model import RefinementModel
from ...hrsi_engine.results.residuals import Residuals
from ...hrsi_engine.results.verdict import Verdict
from ..block_steps.summary import verdict_lines
from .history import Key


def suspicion(image_id: str, statistic: float) -> str:
    """Return what a table says of a measurement that stands out."""
    return f"{image_id}: {statistic:.1f} sigma off"


def reasons_by_point(image_suspicions: Mapping[Key, str]) -> dict[str, list[str]]:
    """Return why measurements of a point are suspicious, by the point."""
    found: dict[str, list[str]] = {}
    for (point, _), reason in image_suspicions.items():
        found.setdefault(point, []).append(reason)
    return found


@dataclass(frozen=True, eq=False)
class ListedMeasurements:
    """A block with the measurements that a table lists alone: which they are, and what each is judged by (n, 2)."""

    block: Block
    keys: Sequence[Key]
    sigma_px: np.ndarray

    @cached_property
    def row_of(self) -> dict[Key, int]:
        """Where each measurement stands."""
        return {key: row for row, key in enumerate(self.keys)}

    @cached_property
    def typical_px(self) -> np.ndarray:
        """What known points' measurements on each image are judged by in the middle ``(images, 2)``, 0 without."""
        rows = self.block.measurements
        usable = np.flatnonzero(self.block.known[rows.point] & np.isfinite(self.sigma_px).all(axis=1))
        image, typical = rows.image[usable], np.zeros((len(self.block.images), 2))
        for index in np.unique(image).tolist():
            typical[index] = np.median(self.sigma_px[usable[image == index]], axis=0)
        return typical


@dataclass(frozen=True, eq=False)
class AdjustmentView:
    """An adjustment as the panel shows it.

    corrections : parameters of the model by image id
    residual_px : by (point, image), observed - computed at the surveyed position; residual_m : by point, survey -
    computed; image_suspicions, point_suspicions : why, by the same keys; verdict : on the block; check : figures of the
    check points as in the report; follower : goes on from it when points
    are edited; listed : ids of the points of the list
    """

    model: RefinementModel
    corrections: Mapping[str, np.ndarray]
    residual_px: Mapping[tuple[str, str], tuple[float, float]]
    residual_m: Mapping[str, tuple[float, float, float]]
    image_suspicions: Mapping[tuple[str, str], str]
    point_suspicions: Mapping[str, str]
    verdict: Verdict
    check: Mapping[str, Any]
    warnings: tuple[str, ...]
    result: Adjustment
    left: Residuals
    follower: Follower
    listed: Collection[str] = frozenset()

    @cached_property
    def watched(self) -> ListedMeasurements:
        """What is shown of the measurements when cameras follow an edit."""
        block, ids = self.result.block, self.result.block.points.ids
        rows = (block.known | np.isin(ids, list(self.listed)))[block.measurements.point]
        kept = block.with_measurements(rows)
        names, images = ids[kept.measurements.point].tolist(), [image.id for image in block.images]
        keys = list(zip(names, [images[index] for index in kept.measurements.image.tolist()], strict=True))
        return ListedMeasurements(kept, keys, self.left.measured_sigma_px[rows])

    @cached_property
    def measurement_suspicions(self) -> dict[str, list[str]]:
        """Why measurements of a point are suspicious, by the point."""
        return reasons_by_point(self.image_suspicions)

    @property
    def told(self) -> str:
        """What the panel says: the verdict, its reasons with what to do, and warnings."""

        *reasons, last = verdict_lines(self.verdict.entry())
        return "\n".join([last, *reasons, *self.warnings])
