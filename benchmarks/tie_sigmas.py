"""Are the sigmas of automatic ties right? `tie_sigmas.py [--docs] [NAME …]`.

Ties are found and adjusted with the defaults. Real images (HRSI_TEST_DATA, see CONTRIBUTING.md): residuals divided by
their own sigmas, which are those of the measurement times the root of its redundancy. Simulated images: also errors
against the truth, the place where the true camera sees the true surface point that a tie's first image shows, divided
by the sigmas that matching states. Both should have a standard deviation of 1; they are split by the number of rays and
by thirds of the matching's quality.
"""

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hrsi.benchmarks.pages import DOCS, make_parser, read_rows, render, write_sections
from hrsi.benchmarks.real_blocks import DATA
from hrsi.hrsi_engine import AdjustOptions, adjust, open_image
from hrsi.hrsi_engine.adjustment import Adjustment
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, Image, ImagePoints
from hrsi.hrsi_engine.laboratory.simulation.surface import locate_on_surface
from hrsi.hrsi_engine.laboratory.simulation.synthesis import BlockSimulation, simulate_block
from hrsi.hrsi_engine.measurement.tie_points import find_tie_points
from hrsi.processing_algorithms import REGISTRY, run
from hrsi.processing_algorithms.interface.declare import fill_options
from hrsi.processing_algorithms.interface.options import check_options
from hrsi.processing_algorithms.laboratory.simulate import make_views

PAGE = DOCS / "protocols/tie_sigmas.md"
REAL = {
    "s2p triplet": ("s2p_triplet_phr", ("img_01.tif", "img_02.tif", "img_03.tif")),
    "Kahramanmaras": (
        "kahramanmaras_phr4", tuple(f"{date}_event_img{k}.tif" for date in ("pre", "post") for k in (1, 2)),
    ),
    "Ventoux": ("ventoux_phr_pair", ("left_image.tif", "right_image.tif")),
}  # fmt: skip
SIMULATED = {
    "simulated, 3 images": {
        "images": 3, "along": (-12.0, 0.0, 12.0), "size": 1200, "gcps": 6, "checks": 20, "ties": 0,
        "relief": 60.0,
    },
    "simulated, 2 images, hills": {
        "images": 2, "along": (-9.0, 9.0), "size": 1400, "gcps": 4, "checks": 30, "ties": 0, "relief": 200.0,
        "seed": 5,
    },
}  # fmt: skip
LEAST = 60  # measurements of a group, for its standard deviation to say something


class Ties(NamedTuple):
    """Images, their ties, and the simulation where there is one."""

    images: tuple[Image, ...]
    ties: ImagePoints
    simulated: BlockSimulation | None = None


def real(name: str) -> Ties:
    """Return real images and their ties."""
    folder, files = REAL[name]
    images = [open_image(str(DATA / "real" / folder / file)) for file in files]
    return Ties(tuple(images), find_tie_points(images).image_points)


def simulated(name: str) -> Ties:
    """Return simulated images, rendered with noise, their ties and the truth."""
    with tempfile.TemporaryDirectory() as folder:
        words = SIMULATED[name] | {"output_dir": str(Path(folder) / "block")}
        run("simulate", **words)
        algorithm = REGISTRY["simulate"]
        options = fill_options(algorithm.options, check_options(algorithm, words))
        views = make_views(options.views, options.vendor, options.scene)
        truth = simulate_block(options.scene, views, options.points, options.noise)
        images = [open_image(str(Path(folder) / "block" / f"{image.id}.tif")) for image in truth.block.images]
        ties = find_tie_points(images).image_points
    bare = tuple(Image(image.id, image.rpc, image.size) for image in images)
    return Ties(bare, ties, truth)


def adjusted(found: Ties) -> Adjustment:
    """Return the ties adjusted with the defaults, with the GCPs of a simulation."""
    tables = [found.ties]
    ground = []
    if found.simulated is not None:
        ground, tables = [found.simulated.block.points], [found.ties, *_measured(found.simulated.block)]
    return adjust(assemble(found.images, ground, tables), AdjustOptions(model="shift"))


def _measured(block: Block) -> list[ImagePoints]:
    rows = block.measurements
    names = np.array([image.id for image in block.images])
    return [ImagePoints(block.points.ids[rows.point], names[rows.image], rows.xy, rows.sigma_px, source="simulated")]


def residual_ratios(result: Adjustment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return residuals of ties over their sigmas ``(n, 2)``, their rays and their quality; without what is left out."""
    block = result.block
    rows = block.measurements
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = result.tested_residual_px / (result.sigma_px[:, None] * np.sqrt(result.redundancy_numbers))
    tie = np.char.startswith(block.points.ids[rows.point], "T")
    used = tie & np.isfinite(result.residual_px).all(axis=1) & (result.weight > 0.0)
    ratio[result.redundancy_numbers < 0.02] = np.nan
    rays = np.bincount(rows.point[used], minlength=len(block.points))[rows.point]
    return ratio[used], rays[used], rows.quality[used]


def true_ratios(found: Ties) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return errors of ties over their stated sigmas ``(n, 2)``, rays and quality; sigmas of both ends count."""
    assert found.simulated is not None
    truth, ties = found.simulated.truth, found.ties
    names = [image.id for image in found.images]
    image = np.array([names.index(name) for name in ties.image_ids.tolist()])
    _, point = np.unique(ties.ids, return_inverse=True)
    order = np.lexsort((image, point))
    head = order[np.r_[True, point[order][1:] != point[order][:-1]]]  # a tie's first image
    first = np.empty(len(head), dtype=np.int64)
    first[point[head]] = head
    seen = np.full((len(first), 3), np.nan)
    terrain = found.simulated.scene.terrain
    for number in np.unique(image[first]):
        here = np.flatnonzero(image[first] == number)
        seen[here] = locate_on_surface(truth.cameras[number], terrain, ties.xy[first[here]])
    rays = np.bincount(point)[point]
    other = np.flatnonzero(first[point] != np.arange(len(point)))
    expected = np.empty((len(other), 2))
    for number in np.unique(image[other]):
        here = np.flatnonzero(image[other] == number)
        expected[here] = truth.cameras[number].ground_to_image(seen[point[other[here]]])
    sigma = np.hypot(ties.sigma_px[other], ties.sigma_px[first[point[other]]])
    return (ties.xy[other] - expected) / sigma[:, None], rays[other], ties.quality[other]


def deviation(ratio: np.ndarray) -> str:
    """Return the standard deviation about 0 of finite values, and the share beyond 4; empty for too few."""
    values = ratio[np.isfinite(ratio)]
    if len(values) < LEAST:
        return ""
    inner = values[np.abs(values) < 4.0]
    return f"{np.sqrt(np.mean(inner**2)):.2f} ({100.0 * np.mean(np.abs(values) >= 4.0):.1f} %)"


def split(ratio: np.ndarray, rays: np.ndarray, quality: np.ndarray) -> list[str]:
    """Return the deviation of all, by rays 2, 3, 4, and by thirds of quality."""
    low, high = np.quantile(quality, (1 / 3, 2 / 3)) if len(quality) else (0.0, 0.0)
    groups = [rays == 2, rays == 3, rays >= 4, quality <= low, (quality > low) & (quality <= high), quality > high]
    return [deviation(ratio), *(deviation(ratio[group]) for group in groups)]


HEAD = ("block", "compared", "tie points", "median sigma px", "sigma0", "all", "2 rays", "3 rays", "4 rays",
        "worst third", "middle", "best third")  # fmt: skip


def rows(name: str, found: Ties) -> Iterator[list[str]]:
    """Yield the rows of a block."""
    result = adjusted(found)
    count, middle = str(len(np.unique(found.ties.ids))), f"{np.median(found.ties.sigma_px):.3f}"
    if found.simulated is not None:
        yield [name, "truth", count, middle, "", *split(*true_ratios(found))]
    yield [name, "residuals", count, middle, f"{result.sigma0:.2f}", *split(*residual_ratios(result))]


def main() -> None:
    """Print the table; ``--docs`` writes its rows into the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("names", nargs="*")
    words = parser.parse_args()
    makers: dict[str, Callable[[], Ties]] = {name: partial(real, name) for name in REAL}
    makers |= {name: partial(simulated, name) for name in SIMULATED}
    table: list[list[str]] = []
    for name, make in makers.items():
        if words.names and not any(word in name for word in words.names):
            continue
        table += rows(name, make())
        print(render(HEAD, table[-2:]), flush=True)
    if words.docs:
        made = {row[0] for row in table}
        table += [row for row in read_rows(PAGE) if row[0] not in made]
        table.sort(key=lambda row: list(makers).index(row[0]))
        write_sections(PAGE, {"": render(HEAD, table)})


if __name__ == "__main__":
    main()
