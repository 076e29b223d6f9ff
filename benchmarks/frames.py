"""Blocks of small frames: real ones of SkySat, simulated strips that point badly, and a thousand frames.

    frames.py strips [COUNT]      strips of 4 to 40 frames whose RPCs point to 5, 15, 50 and 100 px
    frames.py skysat FOLDER…      blocks of real RPCs (*.rpc) and tie points (image_points.csv.gz), by three models
    frames.py thousand            1000 frames with 300 ties each, the whole command

A strip is seen by two looks of one orbit; neighbours overlap by 40 %, their rays are parallel to a few thousandths of a
degree. *Right* is the RMS distance of exact image points from those of the refined cameras after intersection; *lost*
is the share of the tie measurements without a blunder that were left out.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np

from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment import Decision
from hrsi.hrsi_engine.adjustment.intersection import compute_image_residuals, intersect_points
from hrsi.hrsi_engine.adjustment.observations import select_points
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.foundation.errors import SolveError
from hrsi.hrsi_engine.laboratory.simulation.options import Noise, PointCounts, SceneSpec
from hrsi.hrsi_engine.laboratory.simulation.sensors import SENSORS, OrientationError
from hrsi.hrsi_engine.laboratory.simulation.synthesis import BlockSimulation, simulate_block
from hrsi.hrsi_engine.laboratory.simulation.views import make_strip_views

POINTING_PX = (5.0, 15.0, 50.0, 100.0)
FRAME_PX, OVERLAP, LOOKS = (800, 600), 0.4, 2


def simulate_strip(frames: int, pointing_px: float, seed: int, blunders: float = 0.02) -> BlockSimulation:
    """Return a strip of frames, each of which points by itself to ``pointing_px`` (a coordinate)."""
    sensor = SENSORS["worldview-2"]
    rng = np.random.default_rng([seed, frames])
    pixel_rad = sensor.gsd_m / sensor.altitude_m
    views = make_strip_views(sensor, 1, max(frames // LOOKS, 1), LOOKS, FRAME_PX, OVERLAP)
    errors = rng.normal(0.0, pointing_px * pixel_rad, (len(views), 2))
    drifts = rng.normal(0.0, 0.1 * pixel_rad, (len(views), 2))
    views = tuple(
        replace(view, vendor_error=OrientationError(attitude_rad=(*error, 0.0), attitude_drift_rad=(*drift, 0.0)))
        for view, error, drift in zip(views, errors.tolist(), drifts.tolist(), strict=True)
    )
    noise = Noise(image_px=0.1, blunders=blunders, vendor=1.0)
    return simulate_block(SceneSpec(seed=seed), views, PointCounts(0, 10, 60 * len(views)), noise)


def judge_strip(simulated: BlockSimulation, model: str) -> dict[str, Any]:
    """Adjust a strip; return what came out."""
    block, began = simulated.block, time.process_time()
    try:
        result = adjust(block, AdjustOptions(model=model))
    except SolveError as error:
        return {"error": str(error)}
    seconds = time.process_time() - began
    right, tie = ~simulated.truth.blunder, (block.points.role == Role.TIE)[block.measurements.point]
    exact = replace(block, measurements=replace(block.measurements, xy=simulated.truth.image_points.xy))
    observations = select_points(exact, (exact.points.role == Role.TIE) & (exact.rays_per_point() >= 2))
    ground = intersect_points(observations, result.model, result.values, result.ground[observations.points])
    apart = compute_image_residuals(observations, result.model, result.values, ground)
    return {
        "images": len(block.images),
        "relative_px": float(np.sqrt(np.nanmean((apart**2).sum(axis=1)))),
        "lost": float((result.decision != Decision.KEPT)[right & tie].mean()),
        "found": float((result.decision != Decision.KEPT)[~right & tie].mean()),
        "iterations": len(result.history),
        "converged": result.converged,
        "seconds": seconds,
    }


def print_strips(count: int) -> None:
    """Print a row for each pointing error: the worst of its strips."""
    print("| pointing px | strips | worst relative px | worst share lost | not converged | singular | CPU s a frame |")
    print("|---|---|---|---|---|---|---|")
    sizes = np.unique(np.linspace(4, 40, count).astype(int) // 2 * 2)
    for pointing in POINTING_PX:
        for model in ("auto", "shift"):
            rows = [judge_strip(simulate_strip(int(n), pointing, 100 + k), model) for k, n in enumerate(sizes)]
            good = [row for row in rows if "error" not in row]
            for row in rows:
                print("   ", {k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()})
            print(
                f"| {pointing:.0f}, {model} | {len(rows)} | {max(row['relative_px'] for row in good):.3f} | "
                f"{max(row['lost'] for row in good):.2%} | {sum(not row['converged'] for row in good)} | "
                f"{len(rows) - len(good)} | {sum(r['seconds'] for r in good) / sum(r['images'] for r in good):.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    print_strips(int(sys.argv[1]))
