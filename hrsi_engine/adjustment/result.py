"""What an adjustment delivers: corrected cameras, points, residuals and how good they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..block import Block
from ..refinement import RefinementModel


@dataclass(frozen=True)
class Iteration:
    """One row of the convergence history; ``cost`` is half the weighted sum of squares."""

    cost: float
    predicted_decrease: float
    damping: float


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Result of `adjust`; arrays are in the order of the block's images, points and measurements.

    values, values_sigma : (images, p) parameters of the model and their standard deviations
    ground, ground_sigma_m : (points, 3) adjusted positions and sigmas (east, north, up); NaN where not adjusted
    residual_px : (measurements, 2) observed - computed at the adjusted position; NaN where it took no part
    weight : (measurements,) robust weight factor, 0 for rejected ones
    prior_share : (images, p) how much of each parameter comes from its prior (0 … 1)
    """

    block: Block
    model: RefinementModel
    values: np.ndarray
    values_sigma: np.ndarray
    ground: np.ndarray
    ground_sigma_m: np.ndarray
    residual_px: np.ndarray
    weight: np.ndarray
    prior_share: np.ndarray
    sigma0: float
    observations: int
    unknowns: int
    redundancy: float
    converged: bool
    status: str
    history: tuple[Iteration, ...]
    warnings: tuple[str, ...]
