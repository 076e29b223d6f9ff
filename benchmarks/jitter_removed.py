"""How well is jitter removed? `jitter_removed.py [--seeds FIRST COUNT] [--curves NAME …]`.

The blocks are those of `jitter_found`: one to three images of 4000 x 20 000 px whose attitude vibrates, with 8 GCPs
and 1500 tie points (one image: 80 GCPs), adjusted without and with `jitter` auto. With a surface the tie points lie on
a DEM of 0.3 m. Residuals are those of tie points (one image: of GCPs). Waves of heights and their bending are those of
the tie points' true errors along the lines of the first image: the amplitude of a sine with the curve's first period,
and the root mean square of a cubic beyond its constant and linear part, in pixels on the ground.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

import numpy as np

from hrsi.benchmarks.jitter_found import CURVES, SIZE, UYUNI_CURVES, simulate_shaken
from hrsi.benchmarks.thesis_tables import render
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.laboratory.simulation import BlockSimulation
from hrsi.hrsi_engine.surface.grid_surface import GridSurface

KINDS = ((1, False), (2, False), (2, True), (3, False), (3, True))
SIGMA_DEM_M, CELL_DEG = 0.3, 1e-4
LINE_90 = 1.6449  # standard deviations of a line
HEADER = ("curve", "images", "surface", "residual px", "height wave m", "bending px", "inside 90 %", "CPU s")


def describe(result: Adjustment, truth: np.ndarray, period: float) -> tuple[float, float, float, np.ndarray]:
    """Return residual (px), amplitude of the wave of heights (m), bending (px) and which check coordinates are inside.

    truth : (points, 3) true positions in the block's order
    """
    role, rows = result.block.points.role, result.block.measurements
    judged = Role.TIE if (role == Role.TIE).any() else Role.GCP
    used = result.took_part & (role[rows.point] == judged)
    residual = float(np.sqrt(np.mean(result.residual_px[used] ** 2)))
    error = ground_difference_m(result.ground, truth)
    known = np.isfinite(result.ground_sigma_m).all(axis=1) & np.isfinite(error).all(axis=1)
    check = known & (role == Role.CHECK)
    inside = np.abs(error[check]) <= LINE_90 * result.ground_sigma_m[check]
    ties = np.flatnonzero(known & (role == Role.TIE))
    wave = bending = np.nan
    if len(ties):
        line = result.block.images[0].rpc.project(truth[ties])[:, 1]
        u, angle = 2.0 * line / SIZE[1] - 1.0, 2.0 * np.pi * line / period
        cubic = np.polynomial.legendre.legvander(u, 3)
        design = np.column_stack([cubic, np.cos(angle), np.sin(angle)])
        solved = np.linalg.lstsq(design, error[ties, 2], rcond=None)[0]
        wave = float(np.hypot(*solved[4:]))
        bent = np.linalg.lstsq(cubic, error[ties, 2], rcond=None)[0]
        gsd = 1.0 / result.block.images[0].rpc.px_per_m(truth[ties[:1]])[0].max()
        bending = float(np.hypot(*(bent[2:] / np.sqrt([5.0, 7.0])))) / gsd
    return residual, wave, bending, inside


def make_dem(simulated: BlockSimulation) -> GridSurface:
    """Return the terrain of a scene with cells of about 10 m."""
    ground = simulated.truth.ground
    low, high = ground[:, :2].min(axis=0) - 1e-3, ground[:, :2].max(axis=0) + 1e-3
    lon, lat = (np.arange(a, b + CELL_DEG, CELL_DEG) for a, b in zip(low, high, strict=True))
    nodes = np.stack([*np.meshgrid(lon, lat), np.zeros((len(lat), len(lon)))], axis=-1).reshape(-1, 3)
    heights = simulated.scene.terrain.height_at(nodes).reshape(len(lat), len(lon))
    return GridSurface.from_array(heights, (float(low[0]), float(low[1])), (CELL_DEG, CELL_DEG))


def run(curve: str, images: int, surface: bool, seeds: Sequence[int]) -> tuple[list[str], np.ndarray]:
    """Return a row of the table, and which check coordinates are inside their predictions."""
    found: dict[str, list[tuple[float, float, float]]] = {"none": [], "auto": []}
    inside: dict[str, list[np.ndarray]] = {"none": [], "auto": []}
    seconds = {"none": 0.0, "auto": 0.0}
    period = CURVES[curve][0][1] if curve in CURVES else 3000.0
    for seed in seeds:
        simulated = simulate_shaken(curve, images, seed)
        place = {name: number for number, name in enumerate(simulated.truth.ids.tolist())}
        block = simulated.block
        truth = simulated.truth.ground[[place[name] for name in block.points.ids.tolist()]]
        dem = {"dem": make_dem(simulated), "sigma_dem_m": SIGMA_DEM_M} if surface else {}
        for how in found:
            begin = time.process_time()
            result = adjust(block, AdjustOptions(jitter=how, **dem))
            seconds[how] += time.process_time() - begin
            *figures, within = describe(result, truth, period)
            found[how].append(tuple(figures))
            inside[how].append(within)
    before, after = (np.sqrt(np.mean(np.square(found[how]), axis=0)) for how in ("none", "auto"))
    shares = [100.0 * float(np.mean(np.concatenate(inside[how]))) for how in ("none", "auto")]
    cells = [f"{a:.2f} → {b:.2f}" if np.isfinite(a) else "" for a, b in zip(before, after, strict=True)]
    used = f"{seconds['none'] / len(seeds):.1f} → {seconds['auto'] / len(seeds):.1f}"
    row = [curve, str(images), "yes" if surface else "", *cells, f"{shares[0]:.0f} → {shares[1]:.0f}", used]
    return row, np.concatenate(inside["auto"])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=(5001, 2), metavar=("FIRST", "COUNT"))
    parser.add_argument("--curves", nargs="*", default=[*CURVES, *UYUNI_CURVES])
    given = parser.parse_args()
    seeds, rows, inside = range(given.seeds[0], sum(given.seeds)), [], []
    for curve in given.curves:
        for images, surface in KINDS:
            row, within = run(curve, images, surface, seeds)
            rows.append(row)
            inside.append(within)
            print(" | ".join(row), flush=True)
    print(render(HEADER, rows))
    share = 100.0 * np.mean(np.concatenate(inside), axis=0)
    told = "Check points inside the predicted 90 %: east {:.1f} %, north {:.1f} %, height {:.1f} %.".format(*share)
    print(told)


if __name__ == "__main__":
    main()
