"""An adjustment of a session, as the panel shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.refinement.model import RefinementModel
from ...hrsi_engine.results.residuals import Residuals
from ...hrsi_engine.results.verdict import Verdict
from ..block_steps.summary import verdict_lines


@dataclass(frozen=True, eq=False)
class Adjusted:
    """An adjustment as the panel shows it.

    corrections : parameters of the model by image id
    residual_px : by (point, image), observed - computed at the surveyed position; residual_m : by point, survey -
    computed; image_suspicions, point_suspicions : why, by the same keys; verdict : on the block; check : figures of the
    check points as in the report
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

    @cached_property
    def measurement_suspicions(self) -> dict[str, list[str]]:
        """Why measurements of a point are suspicious, by the point."""
        found: dict[str, list[str]] = {}
        for (point, _), reason in self.image_suspicions.items():
            found.setdefault(point, []).append(reason)
        return found

    @property
    def told(self) -> str:
        """What the panel says: the verdict, its reasons with what to do, and warnings."""

        *reasons, last = verdict_lines(self.verdict.entry())
        return "\n".join([last, *reasons, *self.warnings])
