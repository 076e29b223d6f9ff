"""How well is jitter removed? `jitter_removed.py [--seeds FIRST COUNT] [--curves NAME … | --docs]`.

The blocks are those of `jitter_found`: one to three images of 4000 x 20 000 px whose attitude vibrates, with 8 GCPs
and 1500 tie points (one image: 80 GCPs), adjusted without and with `jitter` auto. With a surface the tie points lie on
a DEM of 0.3 m.

The y-parallax is that of error-free measurements of the tie points in each two images after the correction: what
remains when their rays are intersected (one image: the distance of GCPs and check points from where it has them, an
axis). Height errors are the true errors of the tie points along the lines of the first image. A cubic and a sine with
the curve's first period (of the real curve: the period with the largest amplitude before) are fitted to them
together: the wave is the sine's amplitude, the bending the root mean square of the cubic beyond its constant and
linear part, in pixels on the ground. Inside are the coordinates of check points whose error is below what is
predicted for 90 %.

Thresholds were tuned on seeds below 8000; judge on others.
"""

import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import combinations, product

import numpy as np

from hrsi.benchmarks.jitter_found import CURVES, PAGE, SIZE, UYUNI_CURVES, simulate_shaken
from hrsi.benchmarks.pages import make_parser, put_between, render
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.laboratory.simulation import BlockSimulation
from hrsi.hrsi_engine.refinement.stacked_cameras import linearise_images
from hrsi.hrsi_engine.surface.grid_surface import GridSurface

KINDS = ((1, False), (2, False), (2, True), (3, False), (3, True))
SIGMA_DEM_M, CELL_DEG = 0.3, 1e-4
LINE_90 = 1.6449  # standard deviations of a line
HEADER = ("curve", "images", "surface", "y-parallax px", "height wave m", "bending px", "inside %", "CPU s")


def measure_parallax(result: Adjustment, simulated: BlockSimulation, truth: np.ndarray) -> float:
    """Return the root mean square of the y-parallax of error-free measurements, px; see the module's text."""
    block, cameras, each = result.block, result.cameras, list[np.ndarray]()
    points = np.flatnonzero(block.points.role == Role.TIE)
    points = np.arange(len(truth)) if not len(points) else points
    for number in range(len(block.images)):
        xy = simulated.truth.cameras[number].ground_to_image(truth[points])
        which = np.full(len(points), number)
        if result.jitter is not None:
            xy = result.jitter.displace([image.id for image in block.images], which, xy, remove=True)
        at = linearise_images(cameras.model, block.images, which, xy, cameras.values[which], truth[points])
        inside = ((xy >= 0.0) & (xy <= SIZE)).all(axis=1)
        each.append(np.concatenate([np.where(inside, (xy - at.computed).T, np.nan).T[:, :, None], at.by_ground], 2))
    if len(each) == 1:
        return float(np.sqrt(np.nanmean(each[0][:, :, 0] ** 2)))
    squares = []
    for one, other in combinations(each, 2):
        both = np.concatenate([one, other], axis=1)
        both = both[np.isfinite(both).all(axis=(1, 2))]
        # The fourth of the orthogonal directions is what no ground point explains; half of the parallax's square
        normal = np.linalg.qr(both[:, :, 1:], mode="complete")[0][:, :, 3]
        squares.append(2.0 * np.sum(normal * both[:, :, 0], axis=1) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def fit_wave(line: np.ndarray, error: np.ndarray, period: float) -> tuple[float, float]:
    """Return the amplitude of a sine in height errors, and the root mean square of the bending beside it."""
    cubic, angle = np.polynomial.legendre.legvander(2.0 * line / SIZE[1] - 1.0, 3), 2.0 * np.pi * line / period
    design = np.column_stack([cubic, np.cos(angle), np.sin(angle)])
    solved = np.linalg.lstsq(design, error, rcond=None)[0]
    return float(np.hypot(*solved[4:])), float(np.hypot(*(solved[2:4] / np.sqrt([5.0, 7.0]))))


def describe(
    result: Adjustment, simulated: BlockSimulation, truth: np.ndarray, period: float
) -> tuple[float, float, float, np.ndarray, float]:
    """Return parallax (px), amplitude of the wave of heights (m), bending (px), which check coordinates are inside.

    truth : (points, 3) true positions in the block's order
    period : of the wave, NaN where it is to be found; it is returned at last
    """
    role, error = result.block.points.role, ground_difference_m(result.ground, truth)
    known = np.isfinite(result.ground_sigma_m).all(axis=1) & np.isfinite(error).all(axis=1)
    check = known & (role == Role.CHECK)
    inside = np.abs(error[check]) <= LINE_90 * result.ground_sigma_m[check]
    ties = np.flatnonzero(known & (role == Role.TIE))
    wave = bending = np.nan
    if len(ties):
        line, height = result.block.images[0].rpc.project(truth[ties])[:, 1], error[ties, 2]
        if not np.isfinite(period):
            period = max(np.geomspace(200.0, 8000.0, 200).tolist(), key=lambda one: fit_wave(line, height, one)[0])
        wave, bent = fit_wave(line, height, period)
        bending = bent * result.block.images[0].rpc.px_per_m(truth[ties[:1]])[0].max()
    return measure_parallax(result, simulated, truth), wave, bending, inside, period


def make_dem(simulated: BlockSimulation) -> GridSurface:
    """Return the terrain of a scene with cells of about 10 m."""
    ground = simulated.truth.ground
    low, high = ground[:, :2].min(axis=0) - 1e-3, ground[:, :2].max(axis=0) + 1e-3
    lon, lat = (np.arange(a, b + CELL_DEG, CELL_DEG) for a, b in zip(low, high, strict=True))
    nodes = np.stack([*np.meshgrid(lon, lat), np.zeros((len(lat), len(lon)))], axis=-1).reshape(-1, 3)
    heights = simulated.scene.terrain.height_at(nodes).reshape(len(lat), len(lon))
    return GridSurface.from_array(heights, (float(low[0]), float(low[1])), (CELL_DEG, CELL_DEG))


def run(curve: str, images: int, surface: bool, seeds: Sequence[int]) -> tuple[list[str], dict[str, np.ndarray]]:
    """Return a row of the table, and which check coordinates are inside their predictions before and after."""
    found: dict[str, list[tuple[float, float, float]]] = {"none": [], "auto": []}
    inside: dict[str, list[np.ndarray]] = {"none": [], "auto": []}
    seconds = {"none": 0.0, "auto": 0.0}
    for seed in seeds:
        simulated = simulate_shaken(curve, images, seed)
        place = {name: number for number, name in enumerate(simulated.truth.ids.tolist())}
        block = simulated.block
        truth = simulated.truth.ground[[place[name] for name in block.points.ids.tolist()]]
        dem = {"dem": make_dem(simulated), "sigma_dem_m": SIGMA_DEM_M} if surface else {}
        period = CURVES[curve][0][1] if curve in CURVES else np.nan
        for how in found:
            begin = time.process_time()
            result = adjust(block, AdjustOptions(jitter=how, **dem))
            seconds[how] += time.process_time() - begin
            *figures, within, period = describe(result, simulated, truth, period)
            found[how].append(tuple(figures))
            inside[how].append(within)
    before, after = (np.sqrt(np.mean(np.square(found[how]), axis=0)) for how in ("none", "auto"))
    cells = [f"{a:.2f} → {b:.2f}" if np.isfinite(a) else "" for a, b in zip(before, after, strict=True)]
    within = {how: np.concatenate(parts) for how, parts in inside.items()}
    shares = [100.0 * one.mean() for one in within.values() if one.size]
    cells.append(" → ".join(f"{share:.0f}" for share in shares))
    used = f"{seconds['none'] / len(seeds):.1f} → {seconds['auto'] / len(seeds):.1f}"
    return [curve, str(images), "yes" if surface else "", *cells, used], within


def main(words: Sequence[str] | None = None) -> None:
    """Print the table; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--seeds", nargs=2, type=int, default=(8001, 1), metavar=("FIRST", "COUNT"), help="of a row")
    parser.add_argument("--curves", nargs="*", default=[*CURVES, *UYUNI_CURVES], help="default: all")
    given = parser.parse_args(words)
    is_part = not {*CURVES, *UYUNI_CURVES} <= set(given.curves)
    if given.docs and is_part:
        parser.error("--docs writes all tables: leave --curves out")
    groups: dict[tuple[int, bool], list[dict[str, np.ndarray]]] = {kind: [] for kind in KINDS}
    first, count = given.seeds
    # Each row has blocks of its own, for GCPs and check points of one block err together
    tasks = [
        (curve, *kind, range(first + count * number, first + count * (number + 1)))
        for number, (curve, kind) in enumerate(product((*CURVES, *UYUNI_CURVES), KINDS))
        if curve in given.curves
    ]
    rows = []
    with ProcessPoolExecutor(2) as pool:
        for task, (row, within) in zip(tasks, pool.map(run, *zip(*tasks, strict=True)), strict=True):
            rows.append(row)
            groups[task[1:3]].append(within)
            print(render(HEADER, [row]), flush=True)
    if is_part:  # what follows is of all curves
        return
    named = {
        f"{images} images" + surface * ", surface": groups[images, bool(surface)]
        for images in (2, 3)
        for surface in (0, 1)
    }
    named["all"] = [one for group in named.values() for one in group]
    shares = []
    for name, group in named.items():
        before, after = (np.concatenate([one[how] for one in group]) for how in ("none", "auto"))
        of_axes = [f"{100.0 * share:.1f}" for share in after.mean(axis=0)]
        shares.append([name, str(len(after)), f"{100.0 * before.mean():.1f}", f"{100.0 * after.mean():.1f}", *of_axes])
    header = ("blocks", "check points", "inside before %", "after %", "east %", "north %", "height %")
    text = render(HEADER, rows).strip() + "\n\n" + render(header, shares).strip()
    print(text)
    if given.docs:
        put_between(PAGE, "removed", text)


if __name__ == "__main__":
    main()
