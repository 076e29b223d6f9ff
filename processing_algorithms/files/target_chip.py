"""Picture (chip) of a measured target: its surroundings, edge points and fitted curve."""

import numpy as np

from ...hrsi_engine.block.block import Image, Raster
from ...hrsi_engine.drawing.target_chips import TargetChip
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.measurement.targets.measuring import TargetMeasurement, measure_target
from ...hrsi_engine.plausibility.places import SURVEY


@thresholds
class TARGET_CHIP:
    """Limits for the picture of a target."""

    margin_px: float = threshold(8.0, "px", "margin around the target")


def chip_of(made: TargetMeasurement, approximate: np.ndarray | None, raster: Raster | None) -> TargetChip:
    """Return the picture of a target; if the measurement was refused, around the approximate position."""
    grey, origin = None, np.zeros(2)
    middle = approximate if made.refusal else made.xy
    if raster is not None and middle is not None:
        shown = np.vstack([made.edges, middle[None]])
        margin = TARGET_CHIP.margin_px if len(made.edges) else 3.0 * TARGET_CHIP.margin_px
        low = np.maximum(np.floor(shown.min(axis=0) - margin), 0).astype(int)
        high = np.minimum(np.ceil(shown.max(axis=0) + margin) + 1, raster.size).astype(int)
        if np.all(high > low):
            grey, _ = raster.read(*low.tolist(), *(high - low).tolist())
        origin = low.astype(np.float64)
    return TargetChip(grey, origin, made.edges, made.used, made.curves, made.xy)


def find_outline(image: Image, measured_px: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the outline of the target that was measured in an image; empty if no clear target is found there."""
    if image.raster is None:
        return ()
    made = measure_target(image.raster, measured_px, "center")
    is_found = not made.refusal and float(np.linalg.norm(made.xy - measured_px)) < SURVEY.same_target_px
    return made.curves if is_found else ()
