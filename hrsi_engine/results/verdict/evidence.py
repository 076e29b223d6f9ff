"""Input of the verdict's checks: adjustment, residuals, refined RPCs, systematic residuals; chi² tests.

A field is a systematic part of an image's residuals: shift, drift, affine or quadratic terms that the model does not
contain. Polynomials of the image position, with the monomials of the image-space models, are fitted to the residuals of
each image. An F test decides whether a polynomial is significant, and its RMS whether it is large enough to matter.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from ...adjustment.jitter.spectrum import WAVE_AXES, LineProfile, Wave, collect_line_profiles, find_block_waves
from ...adjustment.result import Adjustment, Decision
from ...block.block import Role, stack_rpcs
from ...foundation.errors import list_ids
from ...foundation.thresholds import EQUALITY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ...refinement.image_space import IMAGE_SPACE
from ...refinement.model import RefitRPC, estimate_priors
from ..residuals import Residuals, by_image

#: Source of most thresholds of the verdict.
SOUND_BLOCKS = "correct simulated blocks of six sensors, seeds below 1000, 2026-11-22 (docs/protocols/sound_blocks.md)"


def compute_chi_square_limit(freedom: float, risk: float = SIGNIFICANCE.false_alarm) -> float:
    """Return the critical value of chi² with error probability ``risk``."""
    return float(special.chdtri(freedom, risk))


def is_significant(squares: float, freedom: float, risk: float = SIGNIFICANCE.false_alarm) -> bool:
    """Return True if a sum of squares, in units of its variance, exceeds the critical value of chi²."""
    return freedom > 0.0 and squares > compute_chi_square_limit(freedom, risk)


@thresholds
class CAMERA:
    """Errors of cameras that no model describes."""

    unmodelled_px: float = threshold(0.5, "px", "standard deviation of a camera's unmodelled errors", SOUND_BLOCKS)


@thresholds
class FIELD:
    """Limits for systematic patterns (fields) in the residuals of images."""

    equal_share: float = threshold(
        0.8, "", "share of the squares explained by the largest model that a simpler model needs"
    )


NESTED = ("shift", "shift-drift", "affine", "quadratic")  # from few parameters to many
MONOMIALS = IMAGE_SPACE[NESTED[-1]].powers.tolist()  # includes those of all others
COLUMNS_OF_MODEL = {name: [MONOMIALS.index(powers) for powers in IMAGE_SPACE[name].powers.tolist()] for name in NESTED}


@dataclass(frozen=True)
class ResidualField:
    """Systematic field of an image: RMS (2D) of the field in px, and the model that removes it."""

    image: str
    rms_px: float
    model: str


def find_residual_fields(result: Adjustment, selected: np.ndarray, residual_px: np.ndarray) -> list[ResidualField]:
    """Return the significant fields of the ``selected`` measurements (mask) in residuals (n, 2), the largest first."""
    count = np.bincount(result.block.measurements.image[selected])
    step = max(1, int(count[count > 0].min(initial=0)) // SAMPLES.large) if len(count) else 1
    thinned = np.zeros_like(selected)
    thinned[::step] = selected[::step]
    fields = []
    for index, rows in by_image(result.block, thinned):
        rows, image = rows[:: max(1, len(rows) // SAMPLES.large)], result.block.images[index]
        if len(rows) >= SAMPLES.fewest:
            position = (result.block.measurements.xy[rows] - image.centre_px) / np.maximum(image.half_size_px, 1.0)
            field = _find_field(image.id, position, residual_px[rows])
            fields += [field] if field is not None else []
    return sorted(fields, key=lambda field: -field.rms_px)


def _find_field(image: str, position: np.ndarray, residual: np.ndarray) -> ResidualField | None:
    """Return the field of one image, None if it is not significant; ``position (n, 2)`` is scaled to [-1, 1].

    A polynomial with the monomials T explains r'T (T'T)^-1 T'r of the sum of squares r'r; the models are nested.
    """
    u, v = position.T
    terms = np.stack([u**i * v**j for i, j in MONOMIALS])
    normal, right, total = terms @ terms.T, terms @ residual, float(np.sum(residual**2))

    def explain(columns: list[int]) -> tuple[float, int]:
        solved, _, rank, _ = np.linalg.lstsq(normal[np.ix_(columns, columns)], right[columns], rcond=None)
        return float(np.sum(right[columns] * solved)), rank

    richest, rank = explain(COLUMNS_OF_MODEL[NESTED[-1]])
    freedom = 2.0 * rank
    left = 2.0 * len(residual) - freedom
    if not total > richest:
        return None
    ratio = (richest / freedom) / ((total - richest) / left)
    if special.fdtrc(freedom, left, ratio) > SIGNIFICANCE.false_alarm:
        return None
    model = next(name for name in NESTED if explain(COLUMNS_OF_MODEL[name])[0] >= FIELD.equal_share * richest)
    return ResidualField(image, float(np.sqrt(richest / len(residual))), model)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data on which the verdict is based.

    Parameters
    ----------
    result : Adjustment
        The adjustment.
    left : Residuals
        Its residuals.
    refined : sequence of RefitRPC
        The refined RPC of each image.
    """

    result: Adjustment
    left: Residuals
    refined: Sequence[RefitRPC]

    @cached_property
    def row_role(self) -> np.ndarray:
        """Role of the point of each measurement, ``(n,)``."""
        block = self.result.block
        return block.points.role[block.measurements.point]

    @cached_property
    def left_out(self) -> np.ndarray:
        """True for measurements that data snooping rejected, ``(n,)`` bool."""
        return self.result.decision != int(Decision.KEPT)

    @cached_property
    def adjusting(self) -> np.ndarray:
        """True for measurements that determine the cameras, ``(n,)`` bool: of GCPs and tie points, not rejected."""
        return self.result.has_residual & ~self.left_out & np.isin(self.row_role, [Role.GCP, Role.TIE])

    @cached_property
    def check_rays(self) -> tuple[np.ndarray, np.ndarray]:
        """The measurements of check points: rows ``(n,)``, derivatives ``(n, 2, 3)`` by the ground at the surveys."""
        block, rows = self.result.block, np.flatnonzero(self.row_role == Role.CHECK)
        ground, image = block.points.ground[block.measurements.point[rows]], block.measurements.image[rows]
        return rows, stack_rpcs(block.images).project_with_metric_jacobian(image, ground)[1]

    @cached_property
    def fields(self) -> list[ResidualField]:
        """The significant fields in the residuals of adjusted images, without their waves; the largest first."""
        is_used = self.result.has_residual & ~self.left_out & (self.row_role != Role.HELD_OUT)
        image = self.result.block.measurements.image
        is_adjusted = np.bincount(image[self.adjusting], minlength=len(self.result.block.images)) > 0
        residual, share = self.result.residual_px.copy(), np.nan_to_num(self.result.redundancy_numbers)
        for index in (index for index, waves in enumerate(self.waves) if waves):
            image_rows = np.flatnonzero(image == index)
            line = self.result.block.measurements.xy[image_rows, 1]
            for wave in self.waves[index]:
                axis = WAVE_AXES.index(wave.axis)
                residual[image_rows, axis] -= share[image_rows, axis] * wave.evaluate(line)
        return find_residual_fields(self.result, is_used & is_adjusted[image], residual)

    @cached_property
    def profiles(self) -> list[LineProfile]:
        """Line profiles of the images from the residuals."""
        return collect_line_profiles(self.result)

    @cached_property
    def waves(self) -> list[tuple[Wave, ...]]:
        """The significant waves of each image along its lines (jitter)."""
        return find_block_waves(self.profiles)

    @cached_property
    def camera_px(self) -> float:
        """Standard deviation of the cameras' unmodelled errors in sample and line, px, including fields and jitter."""
        field_px = self.fields[0].rms_px if self.fields else 0.0  # RMS (2D) of the largest systematic field of an image
        return float(np.hypot(np.hypot(CAMERA.unmodelled_px, field_px / np.sqrt(2.0)), self.jitter_px))

    @cached_property
    def jitter_px(self) -> float:
        """RMS of the waves of one image and axis, the largest one, px; 0 without any."""
        squares = [
            sum(wave.amplitude_px**2 for wave in waves if wave.axis == axis)
            for waves in self.waves
            for axis in WAVE_AXES
        ]
        return float(np.sqrt(max(squares, default=0.0) / 2.0))

    @cached_property
    def value_sigmas(self) -> np.ndarray:
        """Standard deviations ``(images, parameters)`` of the cameras' values: of sensor and estimate together."""
        cameras, images = self.result.cameras, self.result.block.images
        of_sensor = np.array([cameras.model.prior_sigmas(image, estimate_priors(image)) for image in images])
        return np.sqrt(of_sensor**2 + cameras.covariance.diagonal(axis1=1, axis2=2))

    @property
    def can_be_simpler(self) -> bool:
        """True if there are models with fewer parameters than the one that was adjusted."""
        return self.result.model.least_points > 1


def describe_residual_fields(evidence: Evidence) -> list[str]:
    """Return notes of significant systematic fields in the residuals of images, with the model that removes them."""
    fields = [field for field in evidence.fields if field.rms_px >= EQUALITY.camera_px]
    if not fields:
        return []
    worst, name = fields[0], evidence.result.model.name
    remedy = f"the model {worst.model} would remove it"
    if name in NESTED and NESTED.index(worst.model) <= NESTED.index(name):
        remedy = f"the model {name} has these terms, but their a priori standard deviations are too small for it"
    return [
        f"the residuals of image {list_ids(field.image for field in fields)} are systematic: up to "
        f"{worst.rms_px:.2g} px RMS ({worst.image}) are a polynomial of the position; {remedy}"
    ]
