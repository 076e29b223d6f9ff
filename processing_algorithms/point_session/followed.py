"""What the panel shows between two adjustments: residuals by cameras that follow every edit."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import Block
from ...hrsi_engine.refinement.model import RefinementModel
from ...hrsi_engine.results.outliers import compute_statistic, is_outlier
from ...hrsi_engine.results.residuals import ground_residuals_m, residuals_at_px
from .adjusted import AdjustmentView, ListedMeasurements, reasons_by_point, suspicion
from .history import Key

ResidualPx = tuple[float, float]


class CurrentResiduals:
    """Residuals (px) by point and image, by cameras that follow; those of edited points are given apart."""

    def __init__(
        self, watched: ListedMeasurements, left: np.ndarray, edited: Collection[str], now: dict[Key, ResidualPx]
    ) -> None:
        self._watched, self._left, self._edited, self._now = watched, left, frozenset(edited), now

    def get(self, key: Key, default: ResidualPx) -> ResidualPx:
        """Return the residual of a measurement."""
        row = None if key[0] in self._edited else self._watched.row_of.get(key)
        return self._now.get(key, default) if row is None else (float(self._left[row, 0]), float(self._left[row, 1]))


@dataclass(frozen=True, eq=False)
class CurrentView:
    """Residuals and cameras as in `AdjustmentView`, of the measurements as they are now."""

    model: RefinementModel
    corrections: Mapping[str, np.ndarray]
    residual_px: CurrentResiduals
    residual_m: dict[str, tuple[float, float, float]]
    image_suspicions: dict[Key, str]
    point_suspicions: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def measurement_suspicions(self) -> dict[str, list[str]]:
        """Why measurements of a point are suspicious, by the point."""
        return reasons_by_point(self.image_suspicions)


def update_view(adjusted: AdjustmentView, edited: Collection[str], now: Block) -> CurrentView:
    """Return an adjusted block with some points as they are ``now``, a block of these alone."""
    new, watched, model = adjusted.follower.follow(edited, now), adjusted.watched, adjusted.model
    own = adjusted.result.unit_sigma * now.measurements.sigma_px
    sigma_now = np.maximum(own[:, None], watched.typical_px[now.measurements.image])
    left = _residuals(watched.block, model, new.values, new.ground)
    left_now = _residuals(now, model, new.values, new.edited_ground)
    keys_now, others = _keys(now), ~np.isin(watched.block.points.ids, list(edited))[watched.block.measurements.point]
    still = np.where(others[:, None], left, np.nan)
    suspicions = dict(_suspicions(watched.keys, still, watched.sigma_px))
    suspicions |= dict(_suspicions(keys_now, left_now, sigma_now))
    residual_m = dict(_ground_residuals(watched.block, model, new.values, new.ground))
    residual_m |= dict(_ground_residuals(now, model, new.values, new.edited_ground))
    return CurrentView(
        model, {image.id: new.values[index] for index, image in enumerate(adjusted.result.block.images)},
        CurrentResiduals(watched, left, edited, dict(zip(keys_now, map(tuple, left_now.tolist()), strict=True))),
        residual_m, suspicions,
    )  # fmt: skip


def _residuals(block: Block, model: RefinementModel, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Return the residuals (px) of measurements: of known points at their survey, of others where they are now."""
    return residuals_at_px(block, model, values, np.where(block.known[:, None], block.points.ground, ground))


def _ground_residuals(
    block: Block, model: RefinementModel, values: np.ndarray, ground: np.ndarray
) -> Iterator[tuple[str, Any]]:
    left_m = ground_residuals_m(block, model, values, ground)
    shown = np.flatnonzero(block.known & (np.bincount(block.measurements.point, minlength=len(block.points)) > 0))
    yield from zip(block.points.ids[shown].tolist(), map(tuple, left_m[shown].tolist()), strict=True)


def _suspicions(keys: Sequence[Key], left: np.ndarray, sigma_px: np.ndarray) -> Iterator[tuple[Key, str]]:
    found = compute_statistic(left, sigma_px)
    for row in np.flatnonzero(is_outlier(found)).tolist():
        yield keys[row], suspicion(keys[row][1], found[row])


def _keys(block: Block) -> list[Key]:
    rows, ids = block.measurements, block.points.ids
    return [
        (str(ids[point]), block.images[image].id)
        for point, image in zip(rows.point.tolist(), rows.image.tolist(), strict=True)
    ]
