"""Checks of a reference: against the accuracy that the RPCs state, and against surveyed GCPs.

The bias that matching determines for an image is the sum of the errors of RPC and reference. It is suspicious if it
exceeds 3.5 standard deviations of both: a wrong datum, CRS or position shifts a reference by tens to hundreds of
metres. Surveyed GCPs separate the two errors: for each of them the reference predicts the image position.

**Parts.** The bias of an image shifts all places equally (except for its drift). A shift of the places in one part
only, for example because of a wrongly placed corner of a mosaic, is an error of the reference. The places are divided
into parts of the ground, the median of their offsets in metres is computed, and the parts are compared with each other:
the shift on which most parts agree is that of the image.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...block.block import Image
from ...block.orthoimage import DEM, ORTHOIMAGE_ERRORS
from ...block.pointing import POINTING
from ...foundation.robust_scale import ROBUST, robust_sigma
from ...foundation.thresholds import GRIDS, SAMPLES, threshold, thresholds
from .matching import ImageControl, ReferenceControl


@thresholds
class REFERENCE_CHECKS:
    """Limits for the differences of a reference from RPCs and surveyed GCPs, and within itself."""

    far: float = threshold(1.3, "", "factor of this limit for a certain offset", "normal, in the plane: 1 of 25 000")
    drift_m: float = threshold(1.0, "m", "standard deviation of an image's bias between two parts")


@dataclass(frozen=True)
class ReferenceAccuracy:
    """Standard deviations of a reference: of each horizontal coordinate, and of the DEM's heights, in metres."""

    sigma_xy_m: float
    sigma_h_m: float

    def compute_sigmas(self, ground: np.ndarray) -> tuple[float, float]:
        """Return standard deviations for ``ground (k, 3)`` as independent GCPs, enlarged for the common errors."""
        sigma_h_m = DEM.compute_equivalent_sigma(self.sigma_h_m, ground)
        return ORTHOIMAGE_ERRORS.compute_equivalent_sigma(self.sigma_xy_m, ground), sigma_h_m


@dataclass(frozen=True)
class ReferenceShift:
    """Offset of an image's RPC from the reference, with its limit, in metres.

    east_m, north_m : ground position by the RPC minus that of the same object in the reference
    bias_m : standard deviation of the RPC bias; stated : whether it is from ERR_BIAS
    """

    image_id: str
    east_m: float
    north_m: float
    limit_m: float
    bias_m: float
    stated: bool

    @property
    def length_m(self) -> float:
        return float(np.hypot(self.east_m, self.north_m))

    @property
    def is_excessive(self) -> bool:
        return self.length_m > self.limit_m


def compute_reference_shift(
    image: Image, image_control: ImageControl, ground: np.ndarray, accuracy: ReferenceAccuracy
) -> ReferenceShift | None:
    """Return the shift of an image against the reference at its centre; None if no bias was found.

    ``ground (m, 3)`` are the places of the reference.
    """
    if image_control.rough_bias_px is None:
        return None
    bias = (
        image_control.rough_bias_px
        if image_control.agreement is None
        else image_control.agreement.bias(image.centre_px[None])[0]
    )
    middle, _ = image.rpc.localize(image.centre_px[None], float(np.median(ground[:, 2])))
    _, by_ground = image.rpc.project_with_metric_jacobian(middle)
    east, north = np.linalg.solve(by_ground[0, :, :2], bias)
    rpc_bias_m = image.rpc.err_bias or POINTING.unknown_m
    # height errors shift the ground position along the line of sight
    along = np.linalg.solve(by_ground[0, :, :2], by_ground[0, :, 2]) * accuracy.sigma_h_m
    limit = ROBUST.outlier * float(np.sqrt(rpc_bias_m**2 + accuracy.sigma_xy_m**2 + 0.5 * float(along @ along)))
    return ReferenceShift(image.id, float(east), float(north), limit, rpc_bias_m, bool(image.rpc.err_bias))


def describe_shifts(shifts: Sequence[ReferenceShift]) -> list[str]:
    """Return warnings about shifts that exceed the accuracies of RPCs and reference."""
    excessive = [shift for shift in shifts if shift.is_excessive]
    if not excessive:
        return []
    mean = np.mean([[shift.east_m, shift.north_m] for shift in excessive], axis=0)
    is_common = all(np.hypot(s.east_m - mean[0], s.north_m - mean[1]) < 0.5 * s.limit_m for s in excessive)
    if is_common and len(excessive) == len(shifts) and len(excessive) > 1:
        first = excessive[0]
        return [
            f"the RPCs of all {len(excessive)} images differ from the reference by {np.hypot(*mean):.1f} m "
            f"({mean[0]:+.1f} m east, {mean[1]:+.1f} m north), {_explain_limit(first)}: check CRS, datum and position "
            "of the reference"
        ]
    return [
        f"the RPC of {shift.image_id} differs from the reference by {shift.length_m:.1f} m ({shift.east_m:+.1f} m "
        f"east, {shift.north_m:+.1f} m north), {_explain_limit(shift)}: check CRS and datum of the reference, and the "
        "RPC"
        for shift in excessive
    ]


def describe_far_shifts(shifts: Sequence[ReferenceShift]) -> list[str]:
    """Return the warnings for shifts beyond `REFERENCE_CHECKS.far` times the limit, which do not occur by chance."""
    return describe_shifts([shift for shift in shifts if shift.length_m > REFERENCE_CHECKS.far * shift.limit_m])


def _explain_limit(shift: ReferenceShift) -> str:
    source = "its ERR_BIAS" if shift.stated else "assumed, without ERR_BIAS"
    return (
        f"more than the {shift.limit_m:.1f} m that the RPC's sigma of {shift.bias_m:.1f} m ({source}) and that of the "
        "reference explain"
    )


@dataclass(frozen=True)
class Contradiction:
    """Surveyed GCPs against the reference: median difference survey - reference in metres, and its limit."""

    east_m: float
    north_m: float
    limit_m: float
    points: int

    @property
    def is_excessive(self) -> bool:
        return bool(np.hypot(self.east_m, self.north_m) > self.limit_m)

    @property
    def message(self) -> str:
        return (
            f"{self.points} measurements of surveyed GCPs differ from the reference by "
            f"{np.hypot(self.east_m, self.north_m):.2f} m ({self.east_m:+.2f} m east, {self.north_m:+.2f} m north), "
            f"more than the {self.limit_m:.2f} m that their sigmas allow: the reference is not used; check the datum "
            "of both"
        )


class ImageGcps(NamedTuple):
    """GCPs of one image: survey ``(k, 3)`` lon, lat, height, its sigmas ``(k, 2)`` m, and sample, line ``(k, 2)``."""

    image_id: str
    ground: np.ndarray
    sigma_m: np.ndarray
    xy: np.ndarray


def contradiction(
    images: Sequence[Image], control: ReferenceControl, gcps: Sequence[ImageGcps], accuracy: ReferenceAccuracy
) -> Contradiction | None:
    """Return the difference between surveyed GCPs and the reference; None if no image has both."""
    by_id = {image.id: image for image in images}
    agreed = {part.image_id: part.agreement for part in control.images if part.agreement is not None}
    differences, variances = [], []
    for image_id, ground, sigma_m, xy in gcps:
        if image_id not in agreed or not len(ground):
            continue
        projected, by_ground = by_id[image_id].rpc.project_with_metric_jacobian(ground)
        # Position of the survey predicted by the reference, minus the measured one
        misfit_px = projected + agreed[image_id].bias(xy) - xy
        inverse = np.linalg.inv(by_ground[:, :, :2])
        differences.append(np.einsum("kij,kj->ki", inverse, misfit_px))
        lean = np.linalg.norm(np.einsum("kij,kj->ki", inverse, by_ground[:, :, 2]), axis=1)
        variances.append(sigma_m[:, 0] ** 2 + 0.5 * lean**2 * (sigma_m[:, 1] ** 2 + accuracy.sigma_h_m**2))
    if not differences:
        return None
    all_differences, variance = np.concatenate(differences), np.concatenate(variances)
    east, north = np.median(all_differences, axis=0)
    limit = ROBUST.outlier * float(np.sqrt(accuracy.sigma_xy_m**2 + 1.57 * np.median(variance) / len(all_differences)))
    return Contradiction(float(east), float(north), limit, len(all_differences))


class PartShift(NamedTuple):
    """A part of a reference that is shifted against the rest: position, shift (m), limit (m), number of places."""

    lon_deg: float
    lat_deg: float
    east_m: float
    north_m: float
    limit_m: float
    places: int

    @property
    def message(self) -> str:
        """The warning about this part."""
        return (
            f"the part of the reference about {self.lon_deg:.4f}, {self.lat_deg:.4f} lies "
            f"{np.hypot(self.east_m, self.north_m):.1f} m from the rest of it ({self.east_m:+.1f} m east, "
            f"{self.north_m:+.1f} m north; limit {self.limit_m:.1f} m): its {self.places} points are not used"
        )


def drop_wrong_parts(
    images: Sequence[Image], control: ReferenceControl, accuracy: ReferenceAccuracy
) -> tuple[ReferenceControl, list[PartShift]]:
    """Return the control without parts of the reference that are shifted against the rest, and these parts."""
    by_id = {image.id: image for image in images}
    # Index of the part of the ground that contains each place
    lonlat, parts = control.ground[:, :2], GRIDS.parts
    low = lonlat.min(axis=0, initial=np.inf)
    size = np.maximum(lonlat.max(axis=0, initial=-np.inf) - low, 1e-12)
    part_of = np.minimum((parts * (lonlat - low) / size).astype(np.int64), parts - 1) @ [1, parts]
    numbers = np.unique(part_of)
    middle, variance = np.full((len(numbers), 2), np.nan), np.full(len(numbers), np.inf)
    agreeing_images = [image_control for image_control in control.images if image_control.agreement is not None]
    if not agreeing_images or len(numbers) < 3:
        return control, []
    # Offsets of the places in each image from the reference, in metres east and north
    differences = []
    for image_control in agreeing_images:
        _, by_ground = by_id[image_control.image_id].rpc.project_with_metric_jacobian(
            control.ground[image_control.places]
        )
        differences.append(np.linalg.solve(by_ground[:, :, :2], image_control.offset_px[:, :, None])[:, :, 0])
    for index, number in enumerate(numbers):
        values = [
            difference[part_of[image_control.places] == number] - np.median(difference, axis=0)
            for image_control, difference in zip(agreeing_images, differences, strict=True)
        ]
        values = [value for value in values if len(value) >= SAMPLES.plane]
        if values:
            image_medians = [np.median(value, axis=0) for value in values]
            middle[index] = np.mean(image_medians, axis=0)
            spread = [
                1.57 * robust_sigma(value - image_median) ** 2 / len(value)
                for value, image_median in zip(values, image_medians, strict=True)
            ]
            variance[index] = float(np.sum(spread)) / len(values) ** 2
    variance += (ORTHOIMAGE_ERRORS.by_part * accuracy.sigma_xy_m) ** 2 + REFERENCE_CHECKS.drift_m**2
    finite = np.flatnonzero(np.isfinite(variance))
    if len(finite) < 3:
        return control, []
    squared_distance = np.sum((middle[finite, None] - middle[finite]) ** 2, axis=2) / variance[finite]
    best = int(np.argmin(np.minimum(squared_distance, ROBUST.outlier**2).sum(axis=1)))
    fitting = squared_distance[best] <= ROBUST.outlier**2
    common_shift = np.average(middle[finite[fitting]], axis=0, weights=1.0 / variance[finite[fitting]])
    is_wrong = np.sum((middle[finite] - common_shift) ** 2, axis=1) / variance[finite] > ROBUST.outlier**2
    if not is_wrong.any() or is_wrong.sum() * 2 >= len(finite):
        return control, []
    shifts = []
    for index in finite[is_wrong]:
        in_part = part_of == numbers[index]
        lon, lat = np.median(control.ground[in_part, :2], axis=0)
        # position in the reference minus that expected from the other parts
        east, north = common_shift - middle[index]
        limit_m = ROBUST.outlier * float(np.sqrt(variance[index]))
        shifts.append(PartShift(float(lon), float(lat), float(east), float(north), limit_m, int(in_part.sum())))
    is_retained = ~np.isin(part_of, numbers[finite[is_wrong]])
    remaining = tuple(replace(one, used=one.used & is_retained[one.places]) for one in control.images)
    return replace(control, images=remaining), shifts
