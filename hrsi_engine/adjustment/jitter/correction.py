"""Adjustment without jitter: curves from its residuals, measurements corrected by them, and a new adjustment.

For linear equations the alternation converges at once; corrections change the lines, so that a second round follows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
from scipy import sparse

from ...block.block import Block, Role, number_exposures
from ...block.jitter_curve import JitterEstimate
from ...foundation.errors import InputError
from ...foundation.progress import Progress, stage
from ...foundation.thresholds import EQUALITY, ITERATIONS
from ..gauss_newton import Solution
from ..options import JITTER_CHOICES, AdjustOptions
from ..preparation.problem import Problem
from ..result import Adjustment
from .estimation import JITTER_CURVES, estimate_jitter
from .spectrum import collect_line_profiles, find_block_waves


class AdjustmentRun(Protocol):
    """Problem and last solution of an adjustment."""

    problem: Problem
    solution: Solution


AdjustOnce = Callable[[Block, AdjustOptions, Progress], tuple[Adjustment, AdjustmentRun]]


def adjust_without_jitter(
    block: Block, options: AdjustOptions, adjust_once: AdjustOnce, progress: Progress
) -> Adjustment:
    """Return the adjustment of a block whose measurements are corrected by the jitter curves of its residuals.

    Without significant jitter it is the ordinary adjustment. After the removal of strong waves, weaker ones are
    searched again. The result's measurements are the corrected ones. Jitter that all images of a point share does not
    show in tie points: the sigmas of the GCPs' measurements contain that of the curves.
    """
    result, adjuster = adjust_once(block, options, stage(progress, 0.0, 0.3))
    is_gcp = block.points.role[block.measurements.point] == Role.GCP
    xy, ids, image = block.measurements.xy, [one.id for one in block.images], block.measurements.image
    earlier: JitterEstimate | None = None
    progress_share = 0.3
    for _ in range(JITTER_CURVES.most_parts if options.jitter in JITTER_CHOICES else 1):
        spacing, period = choose_spacings(result, options.jitter)
        corrected_xy, priors = xy, None  # measurements corrected by the curves so far
        for number in range(ITERATIONS.most if spacing else 0):
            problem, done_before = adjuster.problem, progress_share
            progress_share += 0.3 * (1.0 - progress_share)
            measured = replace(block.measurements, xy=corrected_xy)
            estimate = estimate_jitter(problem, adjuster.solution, measured, spacing, period, priors)
            priors = estimate.priors
            total_estimate = estimate if earlier is None else earlier.add(estimate)
            previous_xy, xy = xy, total_estimate.displace(ids, image, block.measurements.xy, remove=True)
            if np.sqrt(np.mean((xy - previous_xy) ** 2)) < EQUALITY.camera_px and number:
                xy = previous_xy
                break
            sigma_px = total_estimate.add_sigmas(ids, image, xy, block.measurements.sigma_px, is_gcp)
            corrected = replace(block, measurements=replace(block.measurements, xy=xy, sigma_px=sigma_px))
            result, adjuster = adjust_once(
                corrected,
                replace(options, jitter_estimate=total_estimate),
                stage(progress, done_before, progress_share),
            )
        earlier = result.jitter
        if not spacing:
            break
    return result


def choose_spacings(result: Adjustment, choice: str) -> tuple[dict[int, float], float]:
    """Return the lines between knots of the curves, by the exposures' numbers, and the strongest wave's period.

    Exposures without jitter have no entry.

    choice : ``none``, ``auto`` for exposures with significant waves and those with common points, or lines for all
    """
    images = result.block.images
    exposures = number_exposures(images)
    pixel = np.array([image.camera_pixel for image in images])
    if choice not in JITTER_CHOICES:
        try:
            asked_lines = float(choice)
        except ValueError:
            asked_lines = np.nan
        if not asked_lines >= JITTER_CURVES.least_spacing:
            raise InputError(
                f"`jitter` {choice!r}: give {', '.join(JITTER_CHOICES)} or the lines between the knots of the curves, "
                f"at least {JITTER_CURVES.least_spacing:g}"
            )
        spacings = {int(one): asked_lines * float(pixel[exposures == one].min()) for one in np.unique(exposures)}
        return spacings, JITTER_CURVES.knots_in_period * min(spacings.values())
    if choice != "auto":
        return {}, np.inf
    waves_of_images = find_block_waves(collect_line_profiles(result))
    waves = [
        [wave for wave in image_waves if wave.amplitude_px >= EQUALITY.camera_px] for image_waves in waves_of_images
    ]
    shortest = pixel * [min((wave.period_lines for wave in image_waves), default=np.inf) for image_waves in waves]
    if not np.isfinite(shortest).any():
        return {}, np.inf
    strongest = max(
        (
            (wave.amplitude_px * size, wave.period_lines * size)
            for image_waves, size in zip(waves, pixel, strict=True)
            for wave in image_waves
        )
    )[1]
    # A wave of one image also appears in those with common points, and the spectrum does not show which one has it
    rows, count = result.block.measurements, len(result.block.points)
    incidence = sparse.csr_matrix((np.ones(len(rows)), (rows.image, rows.point)), (len(images), count))
    are_connected = (incidence @ incidence.T).tocsr()
    period = np.array([shortest[are_connected[number].indices].min(initial=np.inf) for number in range(len(images))])
    finest = {int(one): float(period[exposures == one].min()) for one in np.unique(exposures)}
    spacings = {one: lines / JITTER_CURVES.knots_in_period for one, lines in finest.items() if np.isfinite(lines)}
    return spacings, strongest
