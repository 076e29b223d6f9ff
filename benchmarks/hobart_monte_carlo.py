"""What tie points do to the heights of Hobart by chance: simulated truth on its geometry.

The 61 check points and 10 GCPs are taken as true; cameras are the vendor's with a shift and, where asked for, a drift;
the noise is that which variance components find. Each run is adjusted with the check points intersected only and with
their measurements as ties.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hrsi.benchmarks.real_blocks import check_rmse, hobart
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.block.block import Block
from hrsi.hrsi_engine.ground.geodesy import move_ground

RUNS = 200
MEASURED_M = 0.087  # by how much the height RMSE of the centres grows on the real block
SIGMA_PX = {"center": 0.28, "corner": 0.59}
SIGMA_SURVEY_M = (0.1, 0.1, 0.15)
SHIFT_PX = 5.0


def simulated(block: Block, drift: float, seed: int) -> Block:
    """Return the block with simulated measurements and surveys."""
    rng = np.random.default_rng(seed)
    rows = block.measurements
    sigma = np.where(rows.kind == "corner", SIGMA_PX["corner"], SIGMA_PX["center"])
    xy = np.empty_like(rows.xy)
    for index, image in enumerate(block.images):
        here = np.flatnonzero(rows.image == index)
        exact = image.rpc.project(block.points.ground[rows.point[here]])
        error = rng.normal(0, SHIFT_PX, 2) + (exact - image.centre_px) @ rng.normal(0, drift, (2, 2))
        xy[here] = exact + error + sigma[here, None] * rng.normal(size=exact.shape)
    survey = move_ground(block.points.ground, rng.normal(0, SIGMA_SURVEY_M, block.points.ground.shape))
    return replace(block, measurements=replace(rows, xy=xy), points=replace(block.points, ground=survey))


def height_changes(drift: float, runs: int = RUNS) -> tuple[np.ndarray, float]:
    """Return the changes of the centres' RMSE in height (m) by ties ``(runs,)``, and the scatter of that RMSE."""
    true, rmse = hobart(), np.empty((runs, 2))
    for seed in range(runs):
        block = simulated(true, drift, seed)
        for column, as_ties in enumerate((False, True)):
            result = adjust(block, AdjustOptions(model="shift", check_as_ties=as_ties, reject_sigma=0.0))
            rmse[seed, column] = check_rmse(result, "center")[2]
    return rmse[:, 1] - rmse[:, 0], float(rmse[:, 0].std())
