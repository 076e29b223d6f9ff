"""Parts of a reference that are shifted against the rest: a corner of a mosaic that was placed wrongly.

An image's bias moves all places alike (its drift, a little); what moves those of one part only is the reference's. The
places are divided into parts of the ground, the middle of their offsets in metres is taken, and the parts are compared
with one another: the shift that most of them agree on is the image's.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...block.block import Image
from ...block.orthoimage import ORTHOIMAGE
from ...foundation.robust_scale import robust_sigma
from .checks import REFERENCE_CHECKS, ReferenceAccuracy
from .matching import ReferenceControl


class PartShift(NamedTuple):
    """A part of a reference that is shifted against the rest: its middle, its shift (m), and its number of places."""

    lon_deg: float
    lat_deg: float
    east_m: float
    north_m: float
    limit_m: float
    places: int

    @property
    def message(self) -> str:
        """What to say of it."""
        return (
            f"the part of the reference about {self.lon_deg:.4f}, {self.lat_deg:.4f} lies "
            f"{np.hypot(self.east_m, self.north_m):.1f} m beside the rest of it ({self.east_m:+.1f} m east, "
            f"{self.north_m:+.1f} m north; limit {self.limit_m:.1f} m): its {self.places} places are left out"
        )


def drop_wrong_parts(
    images: Sequence[Image], control: ReferenceControl, accuracy: ReferenceAccuracy
) -> tuple[ReferenceControl, list[PartShift]]:
    """Return the control without the parts of the reference that lie beside the rest, and these parts."""
    by_id = {image.id: image for image in images}
    part_of = _number_parts(control.ground)
    numbers = np.unique(part_of)
    middle, variance = np.full((len(numbers), 2), np.nan), np.full(len(numbers), np.inf)
    seen = [found for found in control.images if found.agreement is not None]
    if not seen or len(numbers) < 3:
        return control, []
    # Where each image shows its places, less where the reference has them, in metres east and north
    beside = []
    for found in seen:
        _, by_ground = by_id[found.image_id].rpc.project_with_metric_jacobian(control.ground[found.places])
        beside.append(np.linalg.solve(by_ground[:, :, :2], found.offset_px[:, :, None])[:, :, 0])
    for index, number in enumerate(numbers):
        values = [
            away[part_of[found.places] == number] - np.median(away, axis=0)
            for found, away in zip(seen, beside, strict=True)
        ]
        values = [value for value in values if len(value) >= REFERENCE_CHECKS.fewest_places]
        if values:
            own = [np.median(value, axis=0) for value in values]
            middle[index] = np.mean(own, axis=0)
            spread = [1.57 * robust_sigma(value - at) ** 2 / len(value) for value, at in zip(values, own, strict=True)]
            variance[index] = float(np.sum(spread)) / len(values) ** 2
    variance += (ORTHOIMAGE.by_part * accuracy.sigma_xy_m) ** 2 + REFERENCE_CHECKS.drift_m**2
    known = np.flatnonzero(np.isfinite(variance))
    if len(known) < 3:
        return control, []
    apart = np.sum((middle[known, None] - middle[known]) ** 2, axis=2) / variance[known]
    best = int(np.argmin(np.minimum(apart, REFERENCE_CHECKS.limit**2).sum(axis=1)))
    fitting = apart[best] <= REFERENCE_CHECKS.limit**2
    rest = np.average(middle[known[fitting]], axis=0, weights=1.0 / variance[known[fitting]])
    wrong = np.sum((middle[known] - rest) ** 2, axis=1) / variance[known] > REFERENCE_CHECKS.limit**2
    if not wrong.any() or wrong.sum() * 2 >= len(known):
        return control, []
    shifts = []
    for index in known[wrong]:
        here = part_of == numbers[index]
        lon, lat = np.median(control.ground[here, :2], axis=0)
        # the ground by the reference, less where the rest of it would put it
        east, north = rest - middle[index]
        shifts.append(PartShift(float(lon), float(lat), float(east), float(north),
                                REFERENCE_CHECKS.limit * float(np.sqrt(variance[index])), int(here.sum())))  # fmt: skip
    left = ~np.isin(part_of, numbers[known[wrong]])
    remaining = tuple(replace(one, used=one.used & left[one.places]) for one in control.images)
    return replace(control, images=remaining), shifts


def _number_parts(ground: np.ndarray) -> np.ndarray:
    """Return the part that each place ``(m, 3)`` belongs to."""
    if not len(ground):
        return np.zeros(0, dtype=np.int64)
    low, size = ground[:, :2].min(axis=0), np.maximum(np.ptp(ground[:, :2], axis=0), 1e-12)
    parts = REFERENCE_CHECKS.parts
    cell = np.minimum((parts * (ground[:, :2] - low) / size).astype(np.int64), parts - 1)
    return np.asarray(cell[:, 1] * parts + cell[:, 0])
