"""Traps for the matching of tie points: simulated pairs with full truth, and how many of the matches are false.

    python benchmarks/matching_traps.py [--seeds 3] [--traps NAME,NAME…] [--docs]

Every pair shows the same kind of scene, and something that leads matching astray: what repeats itself, what looks
different in one image, what is hidden. A match is false where it lies more than 3 px from where the ground that the
first image shows there is in the second, by the cameras that took the images and the surface itself. --docs puts the
table into docs/protocols/matching_traps.md. Clouds and water: `tests/measurement/test_tie_points.py`.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from hrsi.benchmarks.pages import DOCS, make_parser, write_sections
from hrsi.hrsi_engine.block.block import ArrayRaster, Image
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    BlockSimulation,
    Noise,
    PointCounts,
    SceneSpec,
    make_along_track_views,
    simulate_block,
)
from hrsi.hrsi_engine.laboratory.simulation.render import make_renderer
from hrsi.hrsi_engine.laboratory.simulation.surface import locate_on_surface
from hrsi.hrsi_engine.measurement.tie_points import find_tie_points

FALSE_PX = 3.0
SIZE = (1000, 1000)
PAGE = DOCS / "protocols/matching_traps.md"

Pixels = tuple[np.ndarray, np.ndarray]  # both images, float32
Change = Callable[["Pair", np.ndarray, int], np.ndarray]  # pixels of an image and its number -> pixels


@dataclass(frozen=True)
class Pair:
    """A simulated pair: the block, which band the second image is of, and the random numbers of the trap."""

    block: BlockSimulation
    band: str
    seed: int

    def ground_m(self, index: int) -> np.ndarray:
        """Return east and north (m) of the scene's centre for every pixel of an image, ``(lines, samples, 2)``."""
        camera, terrain = self.block.truth.cameras[index], self.block.scene.terrain
        step = 20
        samples, lines = camera.size
        nodes = np.stack(
            np.meshgrid(np.arange(0, samples + step, step), np.arange(0, lines + step, step)), axis=-1
        ).astype(float)
        ground = locate_on_surface(camera, terrain, nodes.reshape(-1, 2))
        metres = terrain.chart.from_ground(ground).reshape(*nodes.shape).astype(np.float32)
        at = np.indices((lines, samples)).astype(np.float32) / step
        return np.stack([cv2.remap(metres[..., axis], at[1], at[0], cv2.INTER_LINEAR) for axis in (0, 1)], axis=-1)


@dataclass(frozen=True)
class Trap:
    """What leads matching astray: the scene, the views, and what happens to the pixels."""

    text: str
    change: Change | None = None
    scene: dict[str, float] | None = None
    along_deg: tuple[float, float] = (8.0, -8.0)
    band: str = "pan"
    reduced: int = 1  #: of the second image


# ---- what happens to the pixels ------------------------------------------------------------------------------------


def repeat(pair: Pair, grey: np.ndarray, index: int) -> np.ndarray:
    """An orchard of 7 m and greenhouses of 12 m cover two thirds of the ground, each plant like the next."""
    east, north = np.moveaxis(pair.ground_m(index), -1, 0)
    plants = 400.0 + 250.0 * np.cos(2 * np.pi * east / 7.0) * np.cos(2 * np.pi * north / 7.0)
    glass = 500.0 + 300.0 * np.sign(np.cos(2 * np.pi * east / 12.0))
    noise = np.random.default_rng([pair.seed, index, 1]).normal(0, 6, grey.shape)
    return np.where(north > 80.0, plants + noise, np.where(north < -80.0, glass + noise, grey))


def snow(pair: Pair, grey: np.ndarray, index: int) -> np.ndarray:
    """The second image under snow: bright, saturated in the sun, a tenth of the contrast."""
    return grey if index == 0 else np.minimum(1850.0 + 0.1 * (grey - grey.mean()) * 2.0, 1900.0)


def haze(pair: Pair, grey: np.ndarray, index: int) -> np.ndarray:
    """The second image through haze that grows across it: down to a seventh of the contrast."""
    share = np.linspace(0.4, 0.85, grey.shape[1]) * index
    return grey * (1.0 - share) + 900.0 * share


def invert(pair: Pair, grey: np.ndarray, index: int) -> np.ndarray:
    return grey if index == 0 else grey.max() + grey.min() - grey


def noisy(snr: float) -> Change:
    """White noise in both images; the signal is the texture's standard deviation."""

    def change(pair: Pair, grey: np.ndarray, index: int) -> np.ndarray:
        return grey + np.random.default_rng([pair.seed, index, 4]).normal(0, np.std(grey) / snr, grey.shape)

    return change


def jpeg(quality: int) -> Change:
    def change(pair: Pair, grey: np.ndarray, index: int) -> np.ndarray:
        low, high = np.percentile(grey, (0.5, 99.5))
        byte = np.clip((grey - low) * (255.0 / (high - low)), 0, 255).astype(np.uint8)
        _, stream = cv2.imencode(".jpg", byte, [cv2.IMWRITE_JPEG_QUALITY, quality])
        return cv2.imdecode(stream, cv2.IMREAD_GRAYSCALE).astype(np.float32)

    return change


def fold(pair: Pair, grey: np.ndarray, index: int) -> np.ndarray:
    """Another band: what is brighter than the median is as much darker in the second image."""
    middle = np.median(grey)
    return grey if index == 0 else 400.0 - np.abs(grey - middle)


TRAPS: dict[str, Trap] = {
    "none": Trap("nothing"),
    "repetition": Trap("orchard and greenhouses that repeat", repeat),
    "snow": Trap("the second image under snow", snow),
    "haze": Trap("the second image through haze", haze),
    "inverted": Trap("the second image a negative", invert),
    "red": Trap("panchromatic and red, 1:4", band="red"),
    "nir": Trap("panchromatic and near infrared, 1:4", band="nir"),
    "folded": Trap("a band in which all that is bright is dark", fold),
    "1:4": Trap("the second image of a quarter of the resolution", reduced=4),
    "snr 3": Trap("noise, a third of the texture", noisy(3.0)),
    "snr 1": Trap("noise as strong as the texture", noisy(1.0)),
    "jpeg 20": Trap("JPEG of quality 20", jpeg(20)),
    "cliffs": Trap("cliffs of 60 m", scene={"cliff_m": 60.0}),
    "35 degrees": Trap("35 degrees between the views", along_deg=(17.0, -17.0), scene={"relief_m": 150.0}),
    "2000 m": Trap("2000 m of relief", scene={"relief_m": 2000.0}),
}


# ---- running -------------------------------------------------------------------------------------------------------


def make_pair(trap: Trap, seed: int) -> tuple[Pair, list[Image]]:
    """Return a simulated pair and its images with the vendor's RPCs."""
    views = make_along_track_views(SENSORS["pleiades"], 2, SIZE)
    views = tuple(replace(view, along_deg=angle) for view, angle in zip(views, trap.along_deg, strict=True))
    spec = SceneSpec(seed=seed, **(trap.scene or {}))
    block = simulate_block(spec, views, PointCounts(0, 0, 20), Noise())
    pair, images = Pair(block, trap.band, seed), []
    for index, image in enumerate(block.block.images):
        band = trap.band if index else "pan"
        raster = make_renderer(block, image.id, band)
        grey = raster.read(0, 0, *raster.size)[0].astype(np.float32)
        rpc, ratio = image.rpc, SIZE[0] // raster.size[0]
        if trap.change is not None:
            grey = trap.change(pair, grey, index).astype(np.float32)
        if index and trap.reduced > 1:
            ratio = trap.reduced
            grey = grey.reshape(SIZE[1] // ratio, ratio, SIZE[0] // ratio, ratio).mean(axis=(1, 3))
        if ratio > 1:
            middle = (ratio - 1) / 2.0
            rpc = replace(rpc, samp_off=(rpc.samp_off - middle) / ratio, line_off=(rpc.line_off - middle) / ratio,
                          samp_scale=rpc.samp_scale / ratio, line_scale=rpc.line_scale / ratio)  # fmt: skip
        pixels = np.clip(grey, 0, 65535).round().astype(np.uint16)
        images.append(Image(image.id, rpc, pixels.shape[::-1], raster=ArrayRaster(pixels)))
    return pair, images


def run_trap(trap: Trap, seed: int) -> tuple[np.ndarray, float]:
    """Match a pair; return the distances of the matches from the truth (px of the coarser image), and CPU seconds."""
    pair, images = make_pair(trap, seed)
    began = time.process_time()
    try:
        points = find_tie_points(images).image_points
    except InputError:
        return np.empty(0), time.process_time() - began
    seconds = time.process_time() - began
    xy = {image.id: {} for image in images}
    for name, image, place in zip(points.ids.tolist(), points.image_ids.tolist(), points.xy, strict=True):
        xy[image][name] = place
    names = sorted(set(xy[images[0].id]) & set(xy[images[1].id]))
    if not names:
        return np.empty(0), seconds
    seen = [np.array([xy[image.id][name] for name in names]) for image in images]
    ratios = [SIZE[0] / image.known_size[0] for image in images]
    full = [ratio * place + (ratio - 1.0) / 2.0 for ratio, place in zip(ratios, seen, strict=True)]
    cameras, terrain = pair.block.truth.cameras, pair.block.scene.terrain
    ground = locate_on_surface(cameras[0], terrain, full[0])
    return np.linalg.norm(cameras[1].ground_to_image(ground) - full[1], axis=1) / max(ratios), seconds


def table(names: Sequence[str], seeds: Sequence[int]) -> str:
    """Return the table of traps as markdown."""
    lines = [
        "| trap | matches | false beyond 3 px | median error (px) | 99 % within (px) | pairs with matches | CPU s |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in names:
        distances, seconds = zip(*(run_trap(TRAPS[name], seed) for seed in seeds), strict=True)
        away = np.concatenate(distances)
        middle, most = (f"{value:.2f}" for value in np.percentile(away, (50, 99))) if len(away) else ("", "")
        lines.append(
            f"| {TRAPS[name].text} | {len(away)} | {(away > FALSE_PX).sum()} | {middle} | {most} | "
            f"{sum(len(one) > 0 for one in distances)} of {len(seeds)} | {np.mean(seconds):.1f} |"
        )
        print(lines[-1], flush=True)
    return "\n".join(lines)


def main(words: Sequence[str] | None = None) -> None:
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--traps", default=",".join(TRAPS))
    options = parser.parse_args(words)
    text = table(options.traps.split(","), range(options.first_seed, options.first_seed + options.seeds))
    if options.docs:
        write_sections(PAGE, {"": text})


if __name__ == "__main__":
    main()
