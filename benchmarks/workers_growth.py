"""Time and memory of an adjustment by Dask workers as the block grows: ``workers_growth.py [COUNT …] [--docs]``.

Blocks of triplets over a square of scenes, 100 image points an image, as those of `adjust_speed.simulated`; but made
leaf by leaf on the workers, so that no process ever holds the whole block, and nothing of its length is ever here. Each
count runs on a `LocalCluster` of its own with two workers of one thread. Printed are the seconds of making and of
solving (with the sigmas of all points and image points), the latter in CPU seconds, too, the greatest memory of a
worker, what the workers sent, and how the result agrees with the truth. ``--docs`` puts the table into
docs/large_blocks.md.

``workers_growth.py --same COUNT`` compares one process with 1, 2 and 4 workers, and with one of two killed; with
heights of a DEM and of laser points and with cameras as observations too.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import distributed
import numpy as np

from hrsi.benchmarks.adjust_speed import _camera, simulated
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.equations import PointPriors, State
from hrsi.hrsi_engine.adjustment.intersection import fixed_cameras, start_positions
from hrsi.hrsi_engine.adjustment.observations import Observations
from hrsi.hrsi_engine.adjustment.subtrees.descent import SeparatorPriors, Workers
from hrsi.hrsi_engine.adjustment.subtrees.division import Division, Node
from hrsi.hrsi_engine.adjustment.subtrees.leaf import Leaf, LeafAt, LeafPrecision, LeafStart
from hrsi.hrsi_engine.adjustment.subtrees.loop import open_workers
from hrsi.hrsi_engine.block.block import Block, Image
from hrsi.hrsi_engine.block.laser import LaserPoints
from hrsi.hrsi_engine.foundation.progress import silent
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, moved_ground
from hrsi.hrsi_engine.io.safety.deposits import FileDeposit
from hrsi.hrsi_engine.refinement.models import MODELS
from hrsi.hrsi_engine.surface.dem import GridSurface

PAGE = Path(__file__).resolve().parents[1] / "docs" / "large_blocks.md"
BEGIN, END = "<!-- workers: made by benchmarks/workers_growth.py -->", "<!-- end of workers -->"
SAME_MARKS = "<!-- same: made by benchmarks/workers_growth.py --same -->", "<!-- end of same -->"
COUNTS = (1000, 10_000, 100_000)
VIEWS, GSD_M, HALF_PX = 3, 0.8, 6000.0
STEP_M = 0.87 * 2.0 * HALF_PX * GSD_M
REACH_M = HALF_PX * GSD_M
MODEL, SIGMA_PX, SIGMA_M, SHIFT_PX, DRIFT = "affine", 0.3, 0.1, 10.0, 1.0 / 12000
LEAF_SCENES = 12  # along a side, at most
BEYOND = 0.41  # of a step: from so far before a scene's middle on, no point is seen by the scene before it
ORIGIN = np.array([[15.0, 5.0, 500.0]])


@dataclass(frozen=True)
class Field:
    """A square of ``width`` x ``width`` scenes with three images each, in tiles of scenes; ``tiles`` along a side."""

    width: int
    tiles: int
    per_image: float = 100.0
    seed: int = 1

    def scenes(self, tile: int) -> tuple[range, range]:
        """Return the rows and columns of scenes of a tile.

        Its points begin `BEYOND` before its first scenes and end there before the next tile's: so they are seen by its
        own scenes and the first ones of the next tiles, and a separator is one row of scenes, as in a straight cut.
        """
        edges = [round(k * self.width / self.tiles) for k in range(self.tiles + 1)]
        row, column = divmod(tile, self.tiles)
        return range(edges[row], edges[row + 1]), range(edges[column], edges[column + 1])

    def cameras_near(self, tile: int) -> np.ndarray:
        """Return the numbers of the cameras that the points of a tile may be seen by, sorted."""
        rows, columns = self.scenes(tile)
        r = np.arange(rows.start, min(rows.stop + 1, self.width))
        c = np.arange(columns.start, min(columns.stop + 1, self.width))
        scenes = (r[:, None] * self.width + c).ravel()
        return (scenes[:, None] * VIEWS + np.arange(VIEWS)).ravel()

    def centre_m(self, camera: np.ndarray) -> np.ndarray:
        scene = camera // VIEWS
        middle = 0.5 * (self.width - 1)
        return np.column_stack([scene // self.width - middle, scene % self.width - middle]) * STEP_M

    def image(self, camera: int) -> Image:
        """Return an image; the same one wherever it is asked for."""
        lon, lat, _ = moved_ground(ORIGIN, np.array([[*self.centre_m(np.array([camera]))[0], 0.0]]))[0]
        tilt = 0.25 * (camera % VIEWS - 1), 0.02 * np.random.default_rng([self.seed, camera, 0]).normal()
        return Image(f"I{camera:06d}", _camera(lon, lat, tilt, HALF_PX, GSD_M))

    def error(self, camera: int) -> np.ndarray:
        """Return an image's true error, shift and drifts ``(2, 3)``."""
        rng = np.random.default_rng([self.seed, camera, 1])
        return np.column_stack([rng.normal(0, SHIFT_PX, 2), rng.normal(0, DRIFT, (2, 2))])


def field_of(count: int) -> Field:
    width = max(2, round(np.sqrt(count / VIEWS)))
    return Field(width, -(-width // LEAF_SCENES))


@lru_cache(maxsize=1)
def made(field: Field, tile: int) -> tuple[Leaf, np.ndarray]:
    """Return a leaf and the true positions of its points."""
    rng = np.random.default_rng([field.seed, tile, 2])
    rows, columns = field.scenes(tile)
    cameras = field.cameras_near(tile)
    scenes = len(rows) * len(columns)
    total = max(8, round(field.per_image * VIEWS * scenes / 3.3))
    middle = 0.5 * (field.width - 1)
    low, high = (
        np.array([edge - (0.5 if edge in (0, field.width) else BEYOND) for edge in edges]) - middle
        for edges in ((rows.start, columns.start), (rows.stop, columns.stop))
    )
    place = STEP_M * rng.uniform(low, high, (total, 2))
    place = place[np.argsort(place[:, 0])]
    truth = moved_ground(np.repeat(ORIGIN, total, axis=0), np.column_stack([place, rng.uniform(-200, 200, total)]))
    images = [field.image(int(camera)) for camera in cameras]
    centres = field.centre_m(cameras)
    found = []
    for index, (camera, image) in enumerate(zip(cameras.tolist(), images, strict=True)):
        west, east = np.searchsorted(place[:, 0], centres[index, 0] + np.array([-1.1, 1.1]) * REACH_M)
        near = west + np.flatnonzero(np.abs(place[west:east, 1] - centres[index, 1]) < 1.1 * REACH_M)
        if not len(near):
            continue
        xy = image.rpc.project(truth[near])
        seen = (np.abs(xy - HALF_PX) < HALF_PX).all(axis=1) & (rng.random(len(near)) < 0.88)
        error = field.error(camera)
        xy = xy[seen] + error[:, 0] + (xy[seen] - HALF_PX) @ error[:, 1:].T
        found.append((near[seen], np.full(seen.sum(), index), xy + rng.normal(0, SIGMA_PX, xy.shape)))
    point, image_of, xy = (np.concatenate(columns) for columns in zip(*found, strict=True))
    control = rng.choice(total, max(1, scenes // 10), replace=False)
    rays = np.bincount(point, minlength=total)
    surveyed = np.zeros(total, dtype=bool)
    surveyed[control] = True
    used = (rays >= 2) | (surveyed & (rays >= 1))
    keep = used[point]
    order = np.argsort(point[keep], kind="stable")
    number = np.cumsum(used) - 1
    point, image_of, xy = number[point[keep][order]], image_of[keep][order], xy[keep][order]
    truth, surveyed = truth[used], surveyed[used]
    survey = np.where(surveyed[:, None], moved_ground(truth, rng.normal(0, SIGMA_M, truth.shape)), np.nan)
    n, m = len(point), len(truth)
    observations = Observations(
        tuple(images), np.arange(n), np.arange(m), point, image_of, xy, np.full(n, SIGMA_PX),
        np.searchsorted(point, np.arange(m + 1)), survey,
        np.where(surveyed[:, None], 1.0 / SIGMA_M**2, np.zeros((m, 3))), np.ones(n, dtype=bool),
        np.arange(len(cameras), dtype=np.int32),
    )  # fmt: skip
    return Leaf(observations, MODELS[MODEL], cameras, np.isin(cameras, inner_of(field, tile))), truth


@dataclass(frozen=True)
class MakeLeaf:
    """Makes a leaf, in whatever process."""

    field: Field
    tile: int

    def __call__(self) -> Leaf:
        return made(self.field, self.tile)[0]


@dataclass(frozen=True)
class MakeStart:
    """Makes a leaf's start: no correction, points intersected by the cameras as they are."""

    field: Field
    tile: int

    def __call__(self) -> LeafStart:
        leaf, _ = made(self.field, self.tile)
        observations, p = leaf.observations, len(leaf.model.parameters)
        values = np.zeros((len(leaf.cameras), p))
        start = State(values, start_positions(observations))
        weight = 1.0 / observations.sigma_px**2
        ground = fixed_cameras(observations, leaf.model, 1).intersect(
            start, weight, PointPriors.of(observations, start.ground)
        )
        made.cache_clear()
        return LeafStart(
            values, ground, np.tile(prior_weight(p), (len(values), 1)), weight, PointPriors.of(observations, ground),
            np.ones(len(ground), dtype=bool), np.ones(observations.count),
        )  # fmt: skip


def prior_weight(p: int) -> np.ndarray:
    """Return the weights of an image's corrections: 100 px for all, which are scaled to the image's half size."""
    return np.full(p, 1e-4)


def inner_of(field: Field, tile: int) -> np.ndarray:
    """Return the cameras that the points of no other tile see."""
    rows, columns = field.scenes(tile)
    r = np.arange(rows.start + (rows.start > 0), rows.stop)
    c = np.arange(columns.start + (columns.start > 0), columns.stop)
    scenes = (r[:, None] * field.width + c).ravel()
    return (scenes[:, None] * VIEWS + np.arange(VIEWS)).ravel()


def division_of(field: Field) -> tuple[Division, dict[int, int]]:
    """Return the tree over the tiles, halved along the longer side again and again, and the tile of each leaf."""
    nodes: list[Node] = []
    tile_of: dict[int, int] = {}
    tiles_of: list[set[int]] = []

    def add(r: range, c: range) -> int:
        if len(r) == len(c) == 1:
            tile = r.start * field.tiles + c.start
            nodes.append(Node(inner_of(field, tile), ()))
            tile_of[len(nodes) - 1] = tile
            tiles_of.append({tile})
            return len(nodes) - 1
        if len(r) >= len(c):
            half = (r.start + r.stop) // 2
            children = add(range(r.start, half), c), add(range(half, r.stop), c)
        else:
            half = (c.start + c.stop) // 2
            children = add(r, range(c.start, half)), add(r, range(half, c.stop))
        nodes.append(Node(np.empty(0, dtype=np.int64), children))
        tiles_of.append(tiles_of[children[0]] | tiles_of[children[1]])
        return len(nodes) - 1

    add(range(field.tiles), range(field.tiles))
    # Cameras of a border belong to the lowest node whose tiles are all that see them
    seen: dict[int, set[int]] = {}
    for tile in range(field.tiles**2):
        for camera in np.setdiff1d(field.cameras_near(tile), inner_of(field, tile)).tolist():
            seen.setdefault(camera, set()).add(tile)
    inner = np.concatenate([inner_of(field, tile) for tile in range(field.tiles**2)])
    own: list[list[int]] = [[] for _ in nodes]
    for camera in sorted(set(seen) - set(inner.tolist())):
        own[next(k for k, tiles in enumerate(tiles_of) if seen[camera] <= tiles)].append(camera)
    nodes = [
        node if node.is_leaf else Node(np.array(own[k], dtype=np.int64), node.children) for k, node in enumerate(nodes)
    ]
    node_of_camera = np.empty(field.width**2 * VIEWS, dtype=np.int64)
    below = np.arange(len(nodes))
    for k, node in enumerate(nodes):
        node_of_camera[node.own] = k
        below[k] = k if node.is_leaf else below[node.children[0]]
    return Division(tuple(nodes), node_of_camera, below), tile_of


def figures(leaf: Leaf, at: LeafAt, precise: LeafPrecision) -> tuple[float, ...]:
    """Return numbers of image points and points, and sums of squares: residuals, sigmas of the points' heights."""
    return (
        len(at.normals.residual), len(at.state.ground), float(np.sum(at.normals.residual**2)),
        float(np.sum(precise.points[:, 2, 2])),
    )  # fmt: skip


def errors(field: Field, tile: int, at: LeafAt) -> tuple[float, float]:
    """Return the sums of squares of the points' true errors, across and in height."""
    _, truth = made(field, tile)
    made.cache_clear()
    e = ground_difference_m(at.state.ground, truth)
    return float(np.sum(e[:, :2] ** 2)), float(np.sum(e[:, 2] ** 2))


def of_workers(client: Any) -> tuple[float, float, float]:
    """Return CPU seconds and sent MB of all workers, and the greatest memory of one in MB."""

    def read(dask_worker: Any) -> tuple[float, float, float]:
        used = resource.getrusage(resource.RUSAGE_SELF)
        return used.ru_utime + used.ru_stime, dask_worker.transfer_outgoing_bytes_total / 1e6, used.ru_maxrss / 1024.0

    cpu, sent, memory = zip(*client.run(read).values(), strict=True)
    return sum(cpu), sum(sent), max(memory)


def grow(count: int, memory_limit: str) -> list[str]:
    """Adjust a block of so many images; return the row of the table."""
    field = field_of(count)
    division, tile_of = division_of(field)
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", memory_limit=memory_limit, silence_logs=50
    )
    with cluster, open_workers(cluster.scheduler_address) as elsewhere:
        client = elsewhere.client
        p = len(MODELS[MODEL].parameters)
        separators = {k: node.own for k, node in enumerate(division.nodes) if not node.is_leaf}
        priors = SeparatorPriors({k: np.tile(prior_weight(p), (len(own), 1)) for k, own in separators.items()})
        cpu0, _, _ = of_workers(client)
        begin = time.monotonic()
        workers = Workers(client, division, {k: MakeLeaf(field, tile) for k, tile in tile_of.items()})
        starts = {k: MakeStart(field, tile) for k, tile in tile_of.items()}
        values = {k: np.zeros((len(own), p)) for k, own in separators.items()}
        at = workers.begin(starts, values, priors)
        made_s = time.monotonic() - begin
        cpu1, sent1, _ = of_workers(client)
        own0 = time.process_time()
        ended = workers.descend(at, priors, "none", 1e-9, 30, [], silent)
        del at
        precise, _ = workers.precise(ended.at, priors)
        sums = np.sum(
            workers.gather(list(workers.every(figures, workers.leaves, ended.at.leaves, precise).values())), axis=0
        )
        solved_s = time.monotonic() - begin - made_s
        cpu2, sent2, memory = of_workers(client)
        here = time.process_time() - own0
        misses = np.sum(
            workers.gather([client.submit(errors, field, tile, ended.at.leaves[k]) for k, tile in tile_of.items()]),
            axis=0,
        )
    n, m = sums[0], sums[1]
    images = field.width**2 * VIEWS
    mine = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    row = [
        f"{images}", f"{int(n)}", f"{len(tile_of)}", f"{ended.steps}", f"{made_s:.0f}", f"{solved_s:.0f}",
        f"{cpu2 - cpu1:.0f} + {here:.0f}", f"{1e6 * (cpu2 - cpu1) / n:.1f}", f"{memory:.0f}", f"{mine:.0f}",
        f"{sent2 - sent1:.0f}", f"{np.sqrt(2.0 * ended.at.cost / ended.at.freedom):.4f}",
        f"{np.sqrt(misses[1] / m):.3f} / {np.sqrt(sums[3] / m):.3f}",
    ]  # fmt: skip
    print(
        " | ".join(row),
        "converged" if ended.converged else ended.status,
        f"{cpu1 - cpu0:.0f} CPU s of making",
        flush=True,
    )
    return row


HEADER = (
    "images", "image points", "leaves", "steps", "made s", "solved s", "CPU s of workers + here", "µs an image point",
    "memory of a worker MB", "here MB", "sent MB", "sigma0", "RMSE / predicted sigma of heights m",
)  # fmt: skip


def killing(client: Any) -> Callable[[float, str], bool]:
    """Return a callback that kills a worker in the third iteration."""
    killed: list[int] = []

    def progress(_fraction: float, message: str) -> bool:
        if message.endswith("iteration 3") and not killed:
            killed.append(client.run(os.getpid).popitem()[1])
            os.kill(killed[0], signal.SIGKILL)
        return True

    return progress


def kinds(block: Block) -> dict[str, tuple[Block, AdjustOptions]]:
    """Return blocks and options by what holds points and cameras; the last has every second point of an earlier one."""
    free = AdjustOptions(model=MODEL)
    bare = replace(free, reject_sigma=0.0, test_sigmas=False)
    result = adjust(block, bare)
    rng = np.random.default_rng(4)
    places = result.ground[np.isfinite(result.ground).all(axis=1)][::3]
    beside = moved_ground(places, rng.normal(0.0, (2.0, 2.0, 0.3), places.shape))
    beside[: len(beside) // 50, 2] += 30.0
    laser = LaserPoints.create(beside, track=np.where(np.arange(len(beside)) % 2, "a", "b"), sigma_m=0.2)
    low, high = places.min(axis=0)[:2] - 0.1, places.max(axis=0)[:2] + 0.1
    flat = GridSurface.from_array(np.full((11, 11), ORIGIN[0, 2]), tuple(low), tuple((high - low) / 10))
    rows = block.measurements
    early, late = (replace(block, measurements=rows.select(rows.point % 2 == which)) for which in (0, 1))
    return {
        "surveys": (block, free),
        "a DEM": (block, replace(free, dem=flat, sigma_dem_m=120.0)),
        "laser points": (block, replace(free, laser=laser)),
        "observed cameras": (late, replace(bare, earlier=adjust(early, bare).joint)),
    }


SAME_HEADER = (
    "held by", "workers", "one process CPU s", "CPU s of workers", "sent MB", "residuals differ px",
    "sigmas differ, of themselves", "decisions differ",
)  # fmt: skip


def same(count: int) -> list[list[str]]:
    """Adjust a block by one process and by workers, of which one is killed; return rows of how they agree."""
    rows = []
    for kind, (block, options) in kinds(simulated(count)).items():
        begin = time.process_time()
        one = adjust(block, options)
        alone = time.process_time() - begin
        cases = ((1, False), (2, False), (4, False), (2, True)) if kind == "surveys" else ((2, False), (2, True))
        for workers, die in cases:
            with (
                tempfile.TemporaryDirectory() as folder,
                distributed.LocalCluster(
                    n_workers=workers, threads_per_worker=1, dashboard_address=":0", silence_logs=50
                ) as cluster,
                open_workers(cluster.scheduler_address, deposit=FileDeposit(folder)) as elsewhere,
            ):
                two = adjust(block, options, killing(elsewhere.client) if die else silent, elsewhere=elsewhere)
                cpu, sent, _ = of_workers(elsewhere.client)
            apart = np.nanmax(np.abs(two.residual_px - one.residual_px))
            sigma = np.nanmax(np.abs(two.ground_sigma_m / one.ground_sigma_m - 1.0))
            rows.append([
                kind, f"{workers}{', one killed' if die else ''}", f"{alone:.1f}", f"{cpu:.1f}", f"{sent:.1f}",
                f"{apart:.1e}", f"{sigma:.1e}", str(int((one.decision != two.decision).sum())),
            ])  # fmt: skip
            print(" | ".join(rows[-1]), flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("counts", nargs="*", type=int, default=[])
    parser.add_argument("--same", type=int, default=0, help="compare with one process on so many images")
    parser.add_argument("--memory-limit", default="8GB", help="of a worker")
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    if given.same:
        show(SAME_HEADER, same(given.same), SAME_MARKS if given.docs else None)
        return
    rows = [grow(count, given.memory_limit) for count in given.counts or COUNTS]
    show(HEADER, rows, (BEGIN, END) if given.docs else None, two_parts(rows))


def two_parts(rows: Sequence[Sequence[str]]) -> str:
    """Return the processor time of an image point as a constant, of points, and what grows with the longest cut."""
    if len(rows) < 3:
        return ""
    images, each = (
        np.array([float(row[HEADER.index(name)]) for row in rows]) for name in ("images", "µs an image point")
    )
    side = np.sqrt(images / 10_000)
    (points, cuts), *_ = np.linalg.lstsq(np.column_stack([1.0 / each, side / each]), np.ones(len(rows)), rcond=None)
    apart = np.abs((points + cuts * side) / each - 1.0).max()
    return f"µs an image point = {points:.1f} + {cuts:.1f} sqrt(images / 10 000), to {apart:.0%} in each row."


def show(header: Sequence[str], rows: Sequence[Sequence[str]], marks: tuple[str, str] | None, note: str = "") -> None:
    """Print a table and a note below it, and put both between the marks of the page."""
    lines = [" | ".join(header), "|".join(["---:"] * len(header)), *(" | ".join(row) for row in rows)]
    table = "\n".join(f"| {line} |" for line in lines) + (f"\n\n{note}" if note else "")
    print(table)
    if marks is not None:
        text = PAGE.read_text(encoding="utf-8")
        before, rest = text.split(marks[0])
        PAGE.write_text(f"{before}{marks[0]}\n\n{table}\n\n{marks[1]}{rest.split(marks[1])[1]}", encoding="utf-8")


if __name__ == "__main__":
    main()
