"""Wrong inputs on purpose: which of them are noticed, named rightly and kept from writing refined RPCs.

`wrong_inputs.py [--seeds A:B] [--kinds K …] [--checks-only] [--clean N] [--docs]`. Every kind is run on simulated
blocks of all sensors, through the files and the code of the command line (`adjust`). Right blocks and the real ones
must pass without a reason. Seeds below 100 served to tune, those from 100 on to judge. With `--true-errors` the kinds
are those of `wrong_kinds.py`, and what counts is the true error of the refined RPCs.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from osgeo import gdal

from hrsi.benchmarks.pages import DOCS, render
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints, Role
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.ground.geodesy import (
    ground_difference_m,
    metres_per_degree,
    move_ground,
)
from hrsi.hrsi_engine.ground.geoids import geoid_heights
from hrsi.hrsi_engine.ground.map_crs import map_epsg_of, project_to_map
from hrsi.hrsi_engine.io.point_files.csv_text import write_measurements
from hrsi.hrsi_engine.io.rpc_files.fields import gdal_metadata
from hrsi.hrsi_engine.laboratory.simulated_files import write_dem, write_ground_points
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    BlockSimulation,
    Noise,
    PointCounts,
    SceneSpec,
    make_along_track_views,
    simulate_block,
)
from hrsi.hrsi_engine.plausibility.accuracy import estimate_accuracies
from hrsi.hrsi_engine.plausibility.control import collect_control, fit_control
from hrsi.hrsi_engine.plausibility.mistakes import estimate_common_lift, find_datum_shifts

PAGE = DOCS / "protocols/wrong_inputs.md"
PLACES = ((5.45, 43.53), (147.3, -42.85), (-71.6, -33.4), (-105.0, 39.7), (36.9, 37.6), (113.2, 34.6), (18.4, -33.9))
FOOT_M = 0.3048


# ---- inputs --------------------------------------------------------------------------------------------------------


class TruePoints(NamedTuple):
    """Where points are: ``ground (m, 3)``; rows of it and of the images ``(n,)``, and the pixels ``xy (n, 2)``."""

    ground: np.ndarray
    point: np.ndarray
    image: np.ndarray
    xy: np.ndarray


@dataclass(frozen=True, eq=False)
class Inputs:
    """What a user has: images, ground points, measurements, perhaps a DEM and laser points; and options.

    ``dem`` and the true ``terrain`` are heights ``(rows, columns)`` and a geotransform; ``laser (n, 3)`` are lon, lat,
    height of laser points in four passes, and ``overflown (m, 3)`` the ground at the tie points. ``crs`` is what the
    ground points are written in, by default longitude and latitude; ``options`` are those of `adjust`. ``truth`` is
    where the points really are, on the ground and in the pixels that the user has.
    """

    images: tuple[Image, ...]
    ground: GroundPoints
    measured: ImagePoints
    dem: tuple[np.ndarray, tuple[float, ...]] | None = None
    terrain: tuple[np.ndarray, tuple[float, ...]] | None = None
    overflown: np.ndarray | None = None
    laser: np.ndarray | None = None
    crs: int | None = None
    options: dict[str, Any] = field(default_factory=dict)
    truth: TruePoints | None = None

    @property
    def gsd_m(self) -> float:
        """Length of a pixel on the ground in the middle of the first image."""
        rpc, centre = self.images[0].rpc, self.images[0].centre_px
        ground = rpc.localize(centre + [[0.0, 0.0], [1.0, 0.0]], rpc.height_off).ground
        return float(np.linalg.norm(ground_difference_m(ground[1:], ground[:1])))

    @property
    def of_gcps(self) -> np.ndarray:
        """Mask of the measurements of known points."""
        return np.isin(self.measured.ids, self.ground.ids)

    @property
    def gcps(self) -> np.ndarray:
        """Indices of the GCPs among the ground points."""
        return np.flatnonzero(self.ground.role == Role.GCP)

    def with_ground(self, ground: np.ndarray) -> Inputs:
        """Return the inputs with other positions of known points."""
        return replace(self, ground=replace(self.ground, ground=ground))

    def with_xy(self, xy: np.ndarray, rows: np.ndarray | None = None) -> Inputs:
        """Return the inputs with other image coordinates, of some rows (mask) or all."""
        chosen = self.measured.xy.copy()
        chosen[slice(None) if rows is None else rows] = xy if rows is None else xy[rows]
        return replace(self, measured=replace(self.measured, xy=chosen))

    def with_image_ids(self, names: dict[str, str], rows: np.ndarray | None = None) -> Inputs:
        """Return the inputs with measurements on other images, of some rows (mask) or all."""
        old = self.measured.image_ids
        new = np.array([names.get(str(name), str(name)) for name in old])
        return replace(
            self, measured=replace(self.measured, image_ids=new if rows is None else np.where(rows, new, old))
        )

    def sizes(self) -> np.ndarray:
        """Return samples and lines of each measurement's image ``(n, 2)``."""
        size = {image.id: image.size for image in self.images}
        return np.array([size[str(name)] for name in self.measured.image_ids], dtype=float)


@lru_cache(maxsize=64)
def clean(
    sensor: str, seed: int, images: int = 3, gcps: int = 8, relief_m: float | None = None, checks: int = 6,
    place: int | None = None,
) -> Inputs:  # fmt: skip
    """Return a right block of a sensor; place, relief, heading and obliqueness depend on the seed."""
    rng = np.random.default_rng([seed, sum(map(ord, sensor))])
    drawn = int(rng.integers(len(PLACES)))
    lon, lat = PLACES[drawn if place is None else place]
    relief = float(rng.choice([60.0, 150.0, 400.0])) if relief_m is None else relief_m
    spec = SceneSpec(
        lon, lat, mean_height_m=float(rng.uniform(50.0, 1500.0)), relief_m=relief, seed=1000 * seed + len(sensor)
    )
    size = (int(rng.integers(3000, 9000)), int(rng.integers(3000, 9000)))
    views = make_along_track_views(
        SENSORS[sensor], images, size, across_deg=float(rng.uniform(-15.0, 15.0)),
        heading_deg=float(rng.choice([190.0, 350.0])),
    )  # fmt: skip
    simulated = simulate_block(spec, views, PointCounts(gcps, checks, 200), Noise())
    block = simulated.block
    known = block.known
    measured = block.measurements
    return Inputs(
        tuple(replace(image, size=view.size) for image, view in zip(block.images, views, strict=True)),
        block.points.select(known),
        ImagePoints(
            block.points.ids[measured.point], np.array([i.id for i in block.images])[measured.image], measured.xy,
            measured.sigma_px, measured.kind,
        ),
        terrain=_grid_of(simulated),
        overflown=simulated.truth.ground[simulated.truth.role == Role.TIE],
        truth=TruePoints(simulated.truth.ground, *vars(simulated.truth.image_points).values()),
    )  # fmt: skip


def _grid_of(simulated: BlockSimulation, side: int = 150) -> tuple[np.ndarray, tuple[float, ...]]:
    """Return heights and geotransform of the images' ground."""
    corners = np.concatenate([
        image.rpc.localize(image.outline_px(2), height).ground
        for image in simulated.block.images for height in image.rpc.height_range
    ])  # fmt: skip
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    low, high = low - 0.02 * (high - low), high + 0.02 * (high - low)
    cell = (high - low) / side
    lon = low[0] + (np.arange(side) + 0.5) * cell[0]
    lat = high[1] - (np.arange(side) + 0.5) * cell[1]
    ground = np.stack([*np.meshgrid(lon, lat), np.zeros((side, side))], axis=-1).reshape(-1, 3)
    heights = simulated.scene.terrain.height_at(ground).reshape(side, side)
    heights = np.where(np.isfinite(heights), heights, np.nanmedian(heights))
    return heights, (low[0], cell[0], 0.0, high[1], 0.0, -cell[1])


def written(inputs: Inputs, folder: Path) -> dict[str, Any]:
    """Write the inputs as files; return the options of `adjust`."""
    paths = []
    for image in inputs.images:
        path = folder / f"{image.id}.tif"
        if image.path:
            paths.append(image.path)
            continue
        _write_empty_image(path, image)
        paths.append(str(path))
    options: dict[str, Any] = {"images": paths, "output_dir": str(folder / "out"), "write": "sidecar", "report": False}
    ties = ~inputs.of_gcps
    for name, rows in (("image_points", ~ties), ("tie_points", ties)):
        if rows.any():
            options[name] = str(folder / f"{name}.csv")
            write_measurements(options[name], inputs.measured.select(rows))
    if len(inputs.ground):
        options["gcps"] = str(folder / "gcps.csv")
        _write_ground(options["gcps"], inputs)
    if inputs.dem is not None:
        options["dem"] = str(folder / "dem.tif")
        write_dem(options["dem"], *inputs.dem)  # type: ignore[arg-type]
    if inputs.laser is not None:
        options["laser"] = str(folder / "laser.csv")
        passes = np.argsort(np.argsort(inputs.laser[:, 0])) * 4 // len(inputs.laser)
        lines = [
            f"{k},{x!r},{y!r},{z!r},0.2,pass {k}" for k, (x, y, z) in zip(passes, inputs.laser.tolist(), strict=True)
        ]
        Path(options["laser"]).write_text("\n".join(["number,lon,lat,height,sigma_h,track", *lines]) + "\n")
    return {"height_datum": "ellipsoidal", **options, **inputs.options}


def _write_empty_image(path: Path, image: Image) -> None:
    samples, lines = image.size or (100, 100)
    driver = gdal.GetDriverByName("GTiff")
    dataset = driver.Create(str(path), samples, lines, 1, gdal.GDT_UInt16, ["SPARSE_OK=TRUE", "TILED=YES"])
    dataset.SetMetadata(gdal_metadata(image.rpc), "RPC")


def _write_ground(path: str, inputs: Inputs) -> None:
    if inputs.crs is None:
        write_ground_points(path, inputs.ground)
        return
    xy = project_to_map(inputs.ground.ground, inputs.crs)
    with open(path, "w", encoding="utf-8") as file:
        file.write("id,role,x,y,z,sigma_xy,sigma_h\n")
        columns = zip(
            inputs.ground.ids, inputs.ground.role, xy, inputs.ground.ground[:, 2], inputs.ground.sigma_m, strict=True
        )
        for name, role, (x, y), z, (plan, height) in columns:
            file.write(f"{name},{Role(role).label},{x!r},{y!r},{z!r},{plan!r},{height!r}\n")


# ---- kinds of wrong inputs -----------------------------------------------------------------------------------------

Spoil = Callable[[Inputs, np.random.Generator], Inputs]


class Kind(NamedTuple):
    """A kind of wrong input: how it is made, by which codes it may be named, whether nothing may be written.

    ``whole`` says that it is the adjustment that shows it; ``measure`` tells the size of one that not every block can
    see, in sigmas: above 20 it counts as gross, above 5 as subtle, below it need not be seen.
    """

    name: str
    spoil: Spoil
    codes: tuple[str, ...]
    gross: bool = True
    images: int = 3
    gcps: int = 8
    measure: Callable[[Inputs, Inputs], float] | None = None
    whole: bool = False

    def size(self, right: Inputs, wrong: Inputs) -> str:
        """Return ``gross``, ``subtle`` or ``below``: what a block can tell."""
        if self.measure is None:
            return "gross" if self.gross else "subtle"
        sigmas = self.measure(right, wrong)
        return "gross" if sigmas > 20.0 else "subtle" if sigmas > 5.0 else "below"


def by_heights(right: Inputs, wrong: Inputs) -> float:
    """How many sigmas the heights are off, as the images' views from different sides tell heights."""
    block = assemble(right.images, [right.ground], [right.measured])
    control = collect_control(block, estimate_accuracies(block.images))
    assert control is not None
    sigma = estimate_common_lift(control, fit_control(control).shift_m)[1]
    return float(np.median(np.abs(wrong.ground.ground[:, 2] - right.ground.ground[:, 2])) / sigma)


def by_position(right: Inputs, wrong: Inputs) -> float:
    """How many sigmas of the RPCs' shifts the positions are off."""
    step = ground_difference_m(wrong.ground.ground, right.ground.ground)
    return float(np.median(np.hypot(*step[:, :2].T)) / estimate_accuracies(right.images[:1])[0].sigma_m)


def by_dem(right: Inputs, wrong: Inputs) -> float:
    """A DEM tells differences of heights from 5 m on, whatever the RPCs are, not which of both is wrong."""
    step = np.median(np.abs(wrong.ground.ground[:, 2] - right.ground.ground[:, 2]))
    return 10.0 if step > 6.0 else 0.0


def never(right: Inputs, wrong: Inputs) -> float:
    """A shift of all measurements alike is what the RPCs' own errors are."""
    return 0.0


def _all(inputs: Inputs) -> np.ndarray:
    return np.ones(len(inputs.measured), dtype=bool)


def _ties(inputs: Inputs) -> np.ndarray:
    return ~inputs.of_gcps


def _gcps(inputs: Inputs) -> np.ndarray:
    return inputs.of_gcps


def _on_first_image(inputs: Inputs) -> np.ndarray:
    return inputs.of_gcps & (inputs.measured.image_ids == inputs.images[0].id)


def swapped_columns(which: Callable[[Inputs], np.ndarray]) -> Spoil:
    return lambda inputs, rng: inputs.with_xy(inputs.measured.xy[:, ::-1], which(inputs))


def from_below(which: Callable[[Inputs], np.ndarray]) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        xy = inputs.measured.xy.copy()
        xy[:, 1] = inputs.sizes()[:, 1] - 1.0 - xy[:, 1]
        return inputs.with_xy(xy, which(inputs))

    return spoil


def turned(quarters: int, which: Callable[[Inputs], np.ndarray]) -> Spoil:
    """Coordinates of copies turned clockwise by quarters of a circle."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        xy, size = inputs.measured.xy.copy(), inputs.sizes()
        for _ in range(quarters):
            xy, size = np.column_stack([size[:, 1] - 1.0 - xy[:, 1], xy[:, 0]]), size[:, ::-1]
        return inputs.with_xy(xy, which(inputs))

    return spoil


def negative_lines(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    return inputs.with_xy(inputs.measured.xy * [1.0, -1.0], inputs.of_gcps)


def half_resolution(which: Callable[[Inputs], np.ndarray]) -> Spoil:
    return lambda inputs, rng: inputs.with_xy((inputs.measured.xy + 0.5) / 2.0 - 0.5, which(inputs))


def pixel_origin(step: float) -> Spoil:
    return lambda inputs, rng: inputs.with_xy(inputs.measured.xy + step, inputs.of_gcps)


def exchanged_images(which: Callable[[Inputs], np.ndarray], count: int) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        ids = [image.id for image in inputs.images][:count]
        return inputs.with_image_ids(dict(zip(ids, [*ids[1:], ids[0]], strict=True)), which(inputs))

    return spoil


def exchanged_lonlat(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    return inputs.with_ground(inputs.ground.ground[:, [1, 0, 2]])


def signs(lon: float, lat: float) -> Spoil:
    return lambda inputs, rng: inputs.with_ground(inputs.ground.ground * [lon, lat, 1.0])


def zone(step: int, hemisphere: bool = False) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        epsg = map_epsg_of(inputs.ground.ground)
        read = epsg + step
        if hemisphere:
            read += 100 if epsg < 32700 else -100
        return replace(inputs, crs=epsg, options={**inputs.options, "ground_crs": f"EPSG:{read}"})

    return spoil


def other_projection(meant: int | None, read: int | None) -> Spoil:
    """Coordinates of one CRS (EPSG, None for the UTM zone) named as those of another."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        utm = map_epsg_of(inputs.ground.ground)
        return replace(inputs, crs=meant or utm, options={**inputs.options, "ground_crs": f"EPSG:{read or utm}"})

    return spoil


def rounded(pixels: float) -> Spoil:
    """Degrees with so many decimals that the last is still more than some pixels."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        decimals = int(np.floor(-np.log10(pixels * inputs.gsd_m / 111_320.0)))
        ground = inputs.ground.ground.copy()
        ground[:, :2] = np.round(ground[:, :2], decimals)
        return inputs.with_ground(ground)

    return spoil


def control_as_checks(metres: float = 0.0, pixels: float = 0.0) -> Spoil:
    """The check points are the GCPs once more, under other ids, with other errors of survey and measurement."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        points, measured = inputs.ground.select(inputs.gcps), inputs.measured
        rows = measured.select(np.isin(measured.ids, points.ids))
        noise = rng.normal(0.0, metres, points.ground.shape) if metres else np.zeros_like(points.ground)
        both = GroundPoints(
            np.r_[points.ids, np.char.add("X", points.ids)],
            np.vstack([points.ground, move_ground(points.ground, noise)]),
            np.r_[points.role, np.full(len(points), Role.CHECK)], np.tile(points.sigma_m, (2, 1)),
        )  # fmt: skip
        joined = ImagePoints(
            np.r_[measured.ids, np.char.add("X", rows.ids)], np.r_[measured.image_ids, rows.image_ids],
            np.vstack([measured.xy, rows.xy + pixels * rng.uniform(-1.0, 1.0, rows.xy.shape)]),
            np.r_[measured.sigma_px, rows.sigma_px],
        )  # fmt: skip
        return replace(inputs, ground=both, measured=joined)

    return spoil


def renamed(surveyed: Callable[[int], str], measured: Callable[[int], str]) -> Spoil:
    """Known points are numbered, and their numbers spelt in one way in the survey and in another where measured."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        number = {name: index for index, name in enumerate(inputs.ground.ids.tolist(), start=1)}
        ids = [measured(number[name]) if name in number else name for name in inputs.measured.ids.tolist()]
        ground = [surveyed(number[name]) for name in inputs.ground.ids.tolist()]
        return replace(
            inputs, ground=replace(inputs.ground, ids=np.array(ground)),
            measured=replace(inputs.measured, ids=np.array(ids)),
        )  # fmt: skip

    return spoil


def heights(factor: float = 1.0, step_m: float = 0.0) -> Spoil:
    return lambda inputs, rng: inputs.with_ground(inputs.ground.ground * [1.0, 1.0, factor] + [0.0, 0.0, step_m])


def zero_heights(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    return inputs.with_ground(inputs.ground.ground * [1.0, 1.0, 0.0])


def geoid(sign: float) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        ground = inputs.ground.ground.copy()
        ground[:, 2] += sign * geoid_heights(ground, "egm96")
        return inputs.with_ground(ground)

    return spoil


def moved(east_m: float, north_m: float) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        c, s = np.cos(angle), np.sin(angle)
        step = np.array([c * east_m - s * north_m, s * east_m + c * north_m, 0.0])
        return inputs.with_ground(move_ground(inputs.ground.ground, np.tile(step, (len(inputs.ground), 1))))

    return spoil


def degrees_off(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    return inputs.with_ground(inputs.ground.ground + [4.4, 4.1, 0.0])


def other_datum(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    """ED50 around Provence and Turkey, AGD66 in Tasmania, and so on: the datum farthest from WGS84 at the place."""
    middle = np.median(inputs.ground.ground, axis=0)
    known = find_datum_shifts(round(float(middle[0]), 1), round(float(middle[1]), 1))
    shifts = [shift for shift in known if "UTM zone" not in shift.name]
    farthest = max(shifts, key=lambda shift: np.hypot(shift.east_m, shift.north_m))
    step = -np.array([farthest.east_m, farthest.north_m, 0.0]) / metres_per_degree(middle[None])[0]
    return inputs.with_ground(inputs.ground.ground + step)


def some_off(count: int | float, metres: tuple[float, float, float], pixels: float, alike: bool) -> Spoil:
    """Some of the GCPs, a number or a share, off by metres or, where that is more, by pixels of the image."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        number = count if isinstance(count, int) else round(count * len(inputs.gcps))
        chosen = rng.permutation(inputs.gcps)[:number]
        direction = np.array(metres) / np.linalg.norm(metres)
        size = max(float(np.linalg.norm(metres)), pixels * inputs.gsd_m)
        step = np.zeros((len(inputs.ground), 3))
        for row in chosen:
            angle = 0.0 if alike else rng.uniform(0.0, 2.0 * np.pi)
            c, s = np.cos(angle), np.sin(angle)
            step[row] = size * np.array(
                [c * direction[0] - s * direction[1], s * direction[0] + c * direction[1], direction[2]]
            )
        return inputs.with_ground(move_ground(inputs.ground.ground, step))

    return spoil


def one_gcp(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        ground = inputs.ground.ground.copy()
        row = rng.choice(inputs.gcps)
        ground[row] = change(ground[row])
        return inputs.with_ground(ground)

    return spoil


def other_ids(order: Callable[[int, np.random.Generator], np.ndarray]) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        rows = inputs.gcps
        ground = inputs.ground.ground.copy()
        ground[rows] = ground[rows[order(len(rows), rng)]]
        return inputs.with_ground(ground)

    return spoil


def _two_exchanged(count: int, rng: np.random.Generator) -> np.ndarray:
    order = np.arange(count)
    a, b = rng.choice(count, 2, replace=False)
    order[[a, b]] = order[[b, a]]
    return order


def _derangement(count: int, rng: np.random.Generator) -> np.ndarray:
    while True:
        order = rng.permutation(count)
        if (order != np.arange(count)).all():
            return order


def wrong_ties(share: float) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        rows = _ties(inputs) & (rng.random(len(inputs.measured)) < share)
        angle = rng.uniform(0.0, 2.0 * np.pi, len(rows))
        size = 30.0 * rng.uniform(0.5, 1.5, len(rows))
        return inputs.with_xy(
            inputs.measured.xy + size[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), rows
        )

    return spoil


def scattered_gcps(pixels: float) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        step = rng.normal(0.0, pixels * inputs.gsd_m, (len(inputs.ground), 3)) * [1.0, 1.0, 0.0]
        return inputs.with_ground(move_ground(inputs.ground.ground, step))

    return spoil


def twin(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    """The first image a second time under another name, measured there too."""
    first = inputs.images[0]
    copy = replace(first, id="copy")
    rows = inputs.measured.select(inputs.measured.image_ids == first.id)
    joined = ImagePoints(
        np.r_[inputs.measured.ids, rows.ids], np.r_[inputs.measured.image_ids, np.full(len(rows), "copy")],
        np.vstack([inputs.measured.xy, rows.xy]), np.r_[inputs.measured.sigma_px, rows.sigma_px],
    )  # fmt: skip
    return replace(inputs, images=(*inputs.images, copy), measured=joined)


def with_dem(shift_share: float = 0.0, heights_m: float = 0.0) -> Spoil:
    """The block's terrain as a DEM; moved by a share of its size, lifted."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        assert inputs.terrain is not None
        surface, (west, step_east, _, north, _, step_south) = inputs.terrain
        east = shift_share * step_east * surface.shape[1]
        return replace(inputs, dem=(surface + heights_m, (west + east, step_east, 0.0, north, 0.0, step_south)))

    return spoil


def holding_dem(change: Callable[[np.ndarray], np.ndarray], shift_cells: int = 0, sigma_m: float = 3.0) -> Spoil:
    """A DEM that holds the heights, whose cells are changed; or that lies some cells too far east."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        assert inputs.terrain is not None
        heights, (west, step, *rest) = inputs.terrain
        return replace(
            inputs, dem=(change(heights.copy()), (west + shift_cells * step, step, *rest)),
            options={**inputs.options, "sigma_dem": sigma_m},
        )  # fmt: skip

    return spoil


def filled(value: float) -> Callable[[np.ndarray], np.ndarray]:
    """A value that means no data in a third of a DEM."""

    def change(heights: np.ndarray) -> np.ndarray:
        heights[: len(heights) // 3] = value
        return heights

    return change


def with_laser(
    change: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None, dem: bool = False
) -> Spoil:
    """Laser points (0.2 m) at the tie points' ground, whose positions and heights ``(n, 3)`` are changed."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        assert inputs.overflown is not None
        points = inputs.overflown + rng.normal(0.0, 0.2, (len(inputs.overflown), 1)) * [0.0, 0.0, 1.0]
        points = points if change is None else change(points, rng)
        with_both = holding_dem(lambda heights: heights)(inputs, rng) if dem else inputs
        return replace(with_both, laser=points)

    return spoil


def _canopy(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return points + 15.0 * (rng.random((len(points), 1)) < 0.65) * [0.0, 0.0, 1.0]


def _above_geoid(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.column_stack([points[:, :2], points[:, 2] - geoid_heights(points, "egm96")])


def by_relief(right: Inputs, wrong: Inputs) -> float:
    """The relief tells a DEM from another where it is more than a DEM's errors."""
    assert right.terrain is not None
    return 10.0 if np.std(right.terrain[0]) > 35.0 else 0.0


def by_height(right: Inputs, wrong: Inputs) -> float:
    """The ground's own height tells that a height is none."""
    assert right.terrain is not None
    return 10.0 if np.median(right.terrain[0]) > 120.0 else 0.0


def by_pixels(right: Inputs, wrong: Inputs) -> float:
    """Trees of 15 m are told by images that see heights of a few metres."""
    return 10.0 if right.gsd_m < 3.0 else 0.0


def by_geoid(right: Inputs, wrong: Inputs) -> float:
    """A DEM tells from 10 m and two pixels on that laser points have another datum, not which of both."""
    return (
        10.0
        if max(10.0, 2.0 * right.gsd_m) < abs(float(np.median(geoid_heights(right.ground.ground, "egm96"))))
        else 0.0
    )


def _dem_then(spoil: Spoil) -> Spoil:
    """A right DEM, then points spoilt."""
    return lambda inputs, rng: spoil(with_dem()(inputs, rng), rng)


OTHER_GROUND = ("dem-unlike-ground", "sources-disagree")
OF_DEM_HEIGHTS = ("height-offset", "height-datum", *OTHER_GROUND)
OF_LASER = ("sources-disagree", "laser-few", "none of its points")
ON_TREES = ("sources-disagree", "laser-few")
APART = ("control-outliers",)
KINDS: tuple[Kind, ...] = (
    Kind("longitude and latitude swapped", exchanged_lonlat, ("lon-lat-swapped",)),
    Kind("sign of the longitude", signs(-1.0, 1.0), ("lon-lat-sign",)),
    Kind("sign of the latitude", signs(1.0, -1.0), ("lon-lat-sign",)),
    Kind("UTM zone one too far east", zone(1), ("other-projection",)),
    Kind("UTM zone one too far west", zone(-1), ("other-projection",)),
    Kind("UTM zone of the other hemisphere", zone(0, True), ("other-projection",)),
    Kind("Web Mercator read as UTM", other_projection(3857, None), ("other-projection",)),
    Kind("UTM read as Web Mercator", other_projection(None, 3857), ("other-projection",)),
    Kind("degrees rounded, 30 to 300 px", rounded(30.0), ("coordinates-rounded",)),
    Kind("degrees rounded, 5 to 50 px", rounded(5.0), ("coordinates-rounded",), False),
    Kind("check points are the GCPs once more", control_as_checks(), ("check-is-control",), False),
    Kind("… surveyed and measured once more", control_as_checks(0.3, 0.5), ("check-is-control",), False),
    Kind("ids in capitals in one file", renamed("G{}".format, "g{}".format), ("control-unmeasured",)),
    Kind("ids with zeros in front in one file", renamed("{:03d}".format, "{}".format), ("control-unmeasured",)),
    Kind("ids as numbers with .0 in one file", renamed("{}.0".format, "{}".format), ("control-unmeasured",)),
    Kind("image points of other GCPs", renamed("A{}".format, "B{}".format), ("control-unmeasured",), False),
    Kind("sample and line swapped, all points", swapped_columns(_all), ("image-axes",)),
    Kind("sample and line swapped, GCPs", swapped_columns(_gcps), ("image-axes",)),
    Kind("sample and line swapped, GCPs of one image", swapped_columns(_on_first_image), ("image-axes",)),
    Kind("sample and line swapped, tie points", swapped_columns(_ties), ("image-axes",)),
    Kind("lines from below, all points", from_below(_all), ("image-axes",)),
    Kind("lines from below, GCPs", from_below(_gcps), ("image-axes",)),
    Kind("lines negative, GCPs", negative_lines, ("image-axes",)),
    Kind("coordinates of a half-size copy, GCPs", half_resolution(_gcps), ("image-scale",)),
    Kind("coordinates of a half-size copy, all points", half_resolution(_all), ("image-scale",)),
    Kind("ids of two images swapped, all points", exchanged_images(_all, 2), ("ids-permuted",)),
    Kind("ids of two images swapped, GCPs", exchanged_images(_gcps, 2), ("ids-permuted",)),
    Kind("ids of three images in a circle", exchanged_images(_all, 3), ("ids-permuted",)),
    Kind("GCP ids shifted by one", other_ids(lambda count, rng: np.roll(np.arange(count), 1)), ("ids-permuted",)),
    Kind("GCP ids shuffled", other_ids(_derangement), ("ids-permuted",)),
    Kind("two GCP ids exchanged", other_ids(_two_exchanged), ("ids-permuted",)),
    Kind("heights in feet", heights(1.0 / FOOT_M), ("height-unit",), measure=by_heights),
    Kind("heights + 5000 m", heights(step_m=5000.0), ("height-offset",), measure=by_heights),
    Kind("heights all 0", zero_heights, ("heights-alike", "height-offset"), measure=by_heights),
    Kind("GCPs moved by 1.6 km", moved(1600.0, 0.0), ("control-implausible",), measure=by_position),
    Kind("GCPs moved by 6 degrees", degrees_off, ("control-implausible",)),
    Kind("GCPs scatter by 100 px", scattered_gcps(100.0), ("control-implausible",)),
    Kind("half of the GCPs 16 m (25 px) east", some_off(0.5, (16.0, 0.0, 0.0), 25.0, True), ("control-outliers",)),
    # found and left out: the other four agree, and hold the block
    Kind("two of six GCPs 16 m (25 px) east", some_off(2, (16.0, 0.0, 0.0), 25.0, True), APART, False, gcps=6),
    Kind("two of six heights 25 m (60 px) too high", some_off(2, (0.0, 0.0, 25.0), 60.0, True), APART, False, gcps=6),
    Kind("one of eight GCPs moved by 100 px", some_off(1, (1.0, 0.0, 0.0), 100.0, False), ("control-outliers",), False),
    Kind("one GCP with the wrong sign", one_gcp(lambda ground: ground * [-1.0, 1.0, 1.0]), ("lon-lat-sign",), False),
    Kind("30 % of the tie points wrong", wrong_ties(0.3), ("ties-wrong",), False),
    Kind("55 % of the tie points wrong", wrong_ties(0.55), ("ties-wrong",)),
    Kind("heights above the geoid, read as ellipsoidal", geoid(-1.0), ("height-datum",), measure=by_heights),
    Kind("ellipsoidal heights, converted", geoid(1.0), ("height-datum",), measure=by_heights),
    Kind("heights above the geoid, with a DEM", _dem_then(geoid(-1.0)), ("height-datum",), measure=by_dem),
    # up to ten times the RPCs' CE90, that is 21 sigmas, a biased RPC looks the same
    Kind("another datum", other_datum, ("horizontal-datum", "rpc-biased"), measure=by_position),
    Kind("an image twice under two names", twin, ("duplicate-images",), False),
    Kind("a DEM of another place", with_dem(shift_share=5.0), ("dem-coverage",), False),
    Kind("a DEM that covers half of the block", with_dem(shift_share=0.5), ("dem-coverage",), False),
    Kind("a DEM 100 m too high", with_dem(heights_m=100.0), ("height-offset",), False),
    Kind("0 for no data in a third of a DEM", holding_dem(filled(0.0)), ("dem-unlike-ground",), False,
         measure=by_height, whole=True),
    Kind("-9999 for no data in a third of a DEM", holding_dem(filled(-9999.0)), ("means no data",), whole=True),
    Kind("a DEM ten cells too far east", holding_dem(np.array, 10), ("dem-unlike-ground",), False, measure=by_relief,
         whole=True),
    Kind("a DEM upside down", holding_dem(lambda cells: cells[::-1]), OTHER_GROUND, False, measure=by_relief,
         whole=True),
    Kind("… without GCPs", holding_dem(lambda cells: cells[::-1]), OTHER_GROUND, False, gcps=0, measure=by_relief,
         whole=True),
    Kind("a DEM in feet", holding_dem(lambda cells: cells / FOOT_M), OF_DEM_HEIGHTS, False,
         measure=by_height, whole=True),
    Kind("laser heights in feet, no GCPs", with_laser(lambda points, rng: points * [1.0, 1.0, 1.0 / FOOT_M]),
         OF_LASER, False, gcps=0, measure=by_height, whole=True),
    Kind("laser longitude and latitude swapped", with_laser(lambda points, rng: points[:, [1, 0, 2]]),
         ("none of its laser points", "look swapped", "laser-few"), False, gcps=0, whole=True),
    Kind("laser heights of other places, no GCPs", with_laser(
        lambda points, rng: np.column_stack([points[:, :2], rng.permutation(points[:, 2])])), OF_LASER, False, gcps=0,
         measure=by_relief, whole=True),
    Kind("two thirds of the laser points on trees of 15 m", with_laser(_canopy), ON_TREES, False, gcps=0,
         measure=by_pixels, whole=True),
    Kind("laser heights above the geoid, with a DEM", with_laser(_above_geoid, True), OF_LASER, False, gcps=0,
         measure=by_geoid, whole=True),
    Kind("turned by 90 degrees, all points", turned(1, _all), ("image-axes",)),
    Kind("turned by 180 degrees, GCPs", turned(2, _gcps), ("image-axes",)),
    Kind("GCP coordinates from the corner (+ 0.5 px)", pixel_origin(0.5), (), measure=never),
    Kind("GCP coordinates from 1 (+ 1 px)", pixel_origin(1.0), (), measure=never),
)  # fmt: skip


# ---- running -------------------------------------------------------------------------------------------------------


class Outcome(NamedTuple):
    """What came of a run: codes with levels, whether refined RPCs were written, an error, a traceback."""

    codes: tuple[tuple[str, str], ...]
    written: bool
    error: str = ""
    crash: str = ""

    @property
    def level(self) -> str:
        levels = {level for _, level in self.codes}
        return next((level for level in ("unusable", "doubtful") if level in levels), "ok")

    def names(self, codes: Sequence[str]) -> bool:
        """Whether one of the codes was given, or an error before it says the same."""
        said = {code for code, _ in self.codes}
        return (
            bool(said & set(codes))
            or any(word in self.error for word in codes)
            or ("lon-lat-swapped" in codes and "swapped" in self.error)
        )


def run_whole(inputs: Inputs) -> Outcome:
    """Run `adjust` on files, as the command line does."""
    from hrsi.processing_algorithms import run

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            report = run("adjust", **written(inputs, folder))
        except HrsiError as error:
            return Outcome((), False, str(error))
        except Exception:
            return Outcome((), False, crash=traceback.format_exc())
        reasons = tuple((reason["code"], reason["level"]) for reason in report["verdict"]["reasons"])
        return Outcome(reasons, any((folder / "out").glob("*_RPC.TXT")))


def run_checks(inputs: Inputs) -> Outcome:
    """Read the files as `adjust` does, and run the checks of the inputs alone."""
    from hrsi.hrsi_engine.foundation.progress import silent
    from hrsi.hrsi_engine.foundation.reasons import Level
    from hrsi.processing_algorithms import REGISTRY
    from hrsi.processing_algorithms.block_steps.inputs import read_block
    from hrsi.processing_algorithms.block_steps.plausibility import input_reasons
    from hrsi.processing_algorithms.declarations.triangulation import AdjustAlgorithmOptions
    from hrsi.processing_algorithms.files.opening import dem_surface, open_images
    from hrsi.processing_algorithms.interface.declare import Context, fill_options
    from hrsi.processing_algorithms.interface.options import check_options

    with tempfile.TemporaryDirectory() as name:
        try:
            given = check_options(REGISTRY["adjust"], written(inputs, Path(name)))
            options = fill_options(AdjustAlgorithmOptions, given)
            images = open_images(options.images, Context(silent, lambda message: None))
            surface = dem_surface(options.dem, options.points.height_datum, options.points.gcp_epoch)
            block, _ = read_block(images, options.points, surface, options.tie_points)
            reasons = input_reasons(block, surface)
        except HrsiError as error:
            return Outcome((), False, str(error))
        except Exception:
            return Outcome((), False, crash=traceback.format_exc())
    unusable = any(reason.level is Level.UNUSABLE for reason in reasons)
    return Outcome(tuple((reason.code, reason.level.label) for reason in reasons), not unusable)


Runner = Callable[[Inputs], Outcome]
SIZES = ("gross", "subtle", "below")


@dataclass
class Row:
    """What came of the runs of one kind, by size: runs, noticed, named rightly, no refined RPC; crashes; the others."""

    counts: dict[str, np.ndarray] = field(default_factory=lambda: {size: np.zeros(4, dtype=int) for size in SIZES})
    crashed: int = 0
    others: dict[str, int] = field(default_factory=lambda: defaultdict(int))

    def cells(self) -> list[str]:
        """Return the row's figures as text."""
        gross, subtle, below = (self.counts[size] for size in SIZES)
        return [
            f"{gross[2]} of {gross[0]}" if gross[0] else "", f"{gross[3]} of {gross[0]}" if gross[0] else "",
            f"{subtle[2]} of {subtle[0]}" if subtle[0] else "", f"{below[1]} of {below[0]}" if below[0] else "",
            str(self.crashed),
        ]  # fmt: skip


#: Lengths of the earlier names of kinds that were renamed: the length is part of the seed of a kind's random numbers.
EARLIER_LENGTHS = {
    "sample and line swapped, tie points": 29,
    "GCP ids shifted by one": 18,
    "GCPs moved by 1.6 km": 15,
    "GCPs moved by 6 degrees": 18,
    "two of six heights 25 m (60 px) too high": 35,
    "one of eight GCPs moved by 100 px": 28,
    "30 % of the tie points wrong": 22,
    "55 % of the tie points wrong": 22,
    "heights above the geoid, read as ellipsoidal": 45,
    "one of 4 GCPs measured with an error of 10 px, all images": 44,
    "one of 8 GCPs measured with an error of 15 px, one image": 43,
    "two of 3 GCPs 10 m (10 px) north, by the same shift": 39,
    "the only GCP with an error of 30 m": 21,
    "GCPs of a web map, with an error of 8 m, stated 0.3 m": 40,
    "sigmas of GCPs 1e-6 m, one with an error of 5 m (6 px)": 41,
    "one of 6 check points with an error of 50 px": 31,
    "GCPs in a corner, one with an error of 5 m (6 px)": 36,
    "one RPC with an error of 200 m, no GCPs": 26,
    "all RPCs with an error of 30 m and an ERR_BIAS of 0.1 m, no GCPs": 53,
    "tie points of one image shuffled": 26,
    "tie points of one image with an error of 30 px, GCPs correct": 39,
    "tie points of one image with an error of 30 px": 27,
    "a quarter of the tie points with the same error of 12 px": 38,
    "40 % of the tie points with the same error of 12 px": 33,
    "tie points rounded to 4 px, stated 0.1 px": 35,
    "tie points only in a corner of the images": 36,
    "an image without tie points": 21,
    "DEM of a canopy of 12 m": 22,
    "laser points moved by 500 m, no GCPs": 31,
    "GCPs 10 m (10 px) east, check points correct": 42,
    "GCPs 12 m (15 px) too high, check points correct": 46,
    "DEM 49 m low, sigma 3 m, GCPs and check points correct": 46,
    "DEM 10 m low, sigma 3 m, GCPs correct": 35,
    "laser heights 8 m high, GCPs correct": 34,
}


def make_generator(seed: int, name: str) -> np.random.Generator:
    """Return the generator of random numbers for a kind of this name, the same as before it was renamed."""
    return np.random.default_rng([seed, EARLIER_LENGTHS.get(name, len(name))])


def judge(kind: Kind, sensors: Sequence[str], seeds: Sequence[int], runner: Runner, tell: bool = False) -> Row:
    """Return how often a kind of wrong input is noticed and named."""
    row = Row()
    for sensor, seed in itertools.product(sensors, seeds):
        rng = make_generator(seed, kind.name)
        right = clean(sensor, seed, kind.images, kind.gcps)
        wrong = kind.spoil(right, rng)
        size = kind.size(right, wrong)
        found = runner(wrong)
        named = found.names(kind.codes)
        row.counts[size] += [1, bool(found.codes or found.error), named, not found.written]
        row.crashed += bool(found.crash)
        if (not named and size != "below") or (size == "gross" and found.written) or found.crash:
            said = ", ".join(f"{code} {level}" for code, level in found.codes)
            text = said or found.error or found.crash[-300:] or "nothing"
            row.others[text if not named else "written"] += 1
            if tell:
                print("   ", sensor, seed, size, text[-200:].replace("\n", " "), flush=True)
    return row


def clean_blocks(seeds: Sequence[int], sensors: Sequence[str], runner: Runner) -> Iterator[tuple[str, int, Outcome]]:
    """Yield the outcome of right blocks with 0 to 12 GCPs and 1 to 4 images."""
    for seed in seeds:
        for sensor in sensors:
            rng = np.random.default_rng([seed, 7])
            gcps, images = int(rng.integers(0, 13)), int(rng.integers(1, 5))
            images = max(images, 2) if gcps == 0 else images
            right = clean(sensor, seed, images, gcps)
            yield sensor, seed, runner(with_dem()(right, rng) if rng.random() < 0.5 else right)


HEAD = ["wrong input", "gross: named", "not written", "subtle: named", "below: noticed", "crashed", "else"]
INTRODUCTION = """# Wrong inputs: detection and prevention of wrong results

Made by `python benchmarks/wrong_inputs.py --docs {words}`. The page [verdict](../verdict.md) explains the reasons.

Each kind of wrong input is made from correct simulated blocks of {sensors}.
A block has 3000 to 9000 px a side, three images, eight GCPs, six check points and 200 tie points. The places are on
five continents, with a relief of 60 to 400 m. The seeds were not used for tuning. {how} reads the files.

A run counts as *gross* above 20 standard deviations of the quantity in the block, as *subtle* between 5 and 20, and as
*below* under 5. The common height of GCPs follows from images with different directions, and is 5 to 15 times less
accurate than their RPCs. A common shift follows from the errors of the RPCs. So the same 50 m of undulation are subtle
for one sensor and not detectable for another; with a DEM they are detected from 5 m on. A shift of half a pixel or one
pixel of all measurements has the same effect as the error of an RPC. It cannot be detected, and it has no other effect.
Kinds without a size are the same for every block. *Not written*: a reason prevented refined RPCs, and the complete
`adjust` wrote none.
"""


def real_blocks_outcome(matching: bool = True) -> list[list[str]]:
    """Return the reasons that the checks of the input find in the real blocks, ``none`` where all is plausible.

    ``matching`` takes also those whose tie points have to be found first.
    """
    from hrsi.benchmarks import real_blocks as real
    from hrsi.hrsi_engine.io.rasters.images import open_image
    from hrsi.hrsi_engine.plausibility import check_block

    def matched(folder: str, names: Sequence[str]) -> Block:
        images = [open_image(str(real.DATA / "real" / folder / f"{name}.tif")) for name in names]
        return assemble(images, [], real.sift_tracks(images))

    four = [f"{when}_event_img{number}" for when in ("pre", "post") for number in (1, 2)]
    blocks: dict[str, Callable[[], Block]] = {
        "Hobart, 10 GCPs (IKONOS)": real.hobart,
        "Hobart, 1 GCP": lambda: real.hobart(real.TEN[:1]),
        "ZY-3, 7 GCPs": real.zy3,
        "QuickBird-2, 5 GCPs": real.quickbird,
        "SPOT 7, tie points": real.spot7,
    }
    blocks |= (
        {
            "Pleiades triplet, tie points": real.triplet,
            "Kahramanmaras, four crops, tie points": lambda: matched("kahramanmaras_phr4", four),
            "Ventoux, two crops, tie points": lambda: matched("ventoux_phr_pair", ("left_image", "right_image")),
        }
        if matching
        else {}
    )
    rows = []
    for name, make in blocks.items():
        found = check_block(make())
        rows.append([name, ", ".join(f"{reason.code} {reason.level.label}" for reason in found) or "none"])
    return rows


def renew_rows(rows: Sequence[Sequence[str]], seeds: str) -> None:
    """Put rows of some kinds into the page's table, anew or in addition, in the order of the kinds; say by what."""
    before, *tables = PAGE.read_text(encoding="utf-8").split("\n| ")
    table, after = "\n| ".join(tables).split("\n\n", 1)
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in f"| {table}".splitlines()[2:]]
    by_name = {line[0]: line for line in [*lines, *map(list, rows)]}
    names = "; ".join(row[0] for row in rows)
    told = f"\nMade with `{seeds}`: {names}."
    ordered = [by_name[kind.name] for kind in KINDS if kind.name in by_name]
    PAGE.write_text(f"{before}{told}\n\n{render(HEAD, ordered)}\n\n{after}", encoding="utf-8")


def main(words: Sequence[str] = ()) -> None:
    """Print the tables; ``--docs`` writes the page."""
    parser = argparse.ArgumentParser(prog="wrong_inputs.py", description=__doc__)
    parser.add_argument("--seeds", default="100:103", metavar="A:B", help="seeds from A to below B")
    parser.add_argument("--kinds", nargs="*", help="kinds whose name begins so")
    parser.add_argument("--sensors", nargs="*", default=list(SENSORS))
    parser.add_argument("--clean", type=int, default=0, metavar="N", help="also N seeds of right blocks a sensor")
    parser.add_argument("--checks-only", action="store_true", help="only the checks before the adjustment")
    parser.add_argument("--true-errors", action="store_true", help="other kinds, judged by what they do to the result")
    parser.add_argument("--tell", action="store_true", help="say what came instead")
    parser.add_argument(
        "--docs", action="store_true", help=f"write {PAGE.name}, the real blocks too; with kinds only their rows"
    )
    options = parser.parse_args(list(words))
    first, last = map(int, options.seeds.split(":"))
    if options.true_errors:
        from hrsi.benchmarks.true_errors import print_harm, write_page

        harm = print_harm(options.sensors, range(first, last), options.kinds, options.tell)
        if options.docs:
            write_page(harm, options.sensors, f"--seeds {options.seeds} --sensors {' '.join(options.sensors)}")
        return
    runner = run_checks if options.checks_only else run_whole
    rows, parts = [], []
    for kind in KINDS:
        if options.kinds is not None and not any(kind.name.startswith(name) for name in options.kinds):
            continue
        if kind.whole and options.checks_only:
            continue
        row = judge(kind, options.sensors, range(first, last), runner, options.tell)
        others = "; ".join(f"{text[:70]} ({count})" for text, count in list(row.others.items())[:2])
        rows.append([kind.name, *row.cells(), others])
        print(" | ".join(rows[-1]), flush=True)
    asked = " ".join(words).replace("--docs", "").strip()
    if options.docs and options.kinds is not None:
        renew_rows(rows, f"--seeds {options.seeds}")
        return
    parts.append(render(HEAD, rows))
    if options.clean:
        outcomes = list(clean_blocks(range(first, first + options.clean), options.sensors, runner))
        bad = [(sensor, seed, found) for sensor, seed, found in outcomes if found != Outcome((), True)]
        said = "; ".join(f"{sensor} {seed}: {out.codes or out.error or out.crash[-200:]}" for sensor, seed, out in bad)
        parts.append(
            f"## Right blocks\n\n{len(outcomes)} right blocks (0 to 12 GCPs, 1 to 4 images, half of them with a DEM): "
            f"{len(bad)} with any reason{f' ({said})' if said else ''}."
        )
    if options.docs:
        parts.append("## Real blocks\n\n" + render(["block", "reasons"], real_blocks_outcome()))
        how = "The check of the input" if options.checks_only else "The complete command `adjust`"
        head = INTRODUCTION.format(words=asked, how=how, sensors=", ".join(options.sensors))
        PAGE.write_text("\n\n".join([head.rstrip(), *parts]) + "\n", encoding="utf-8")
    print("\n\n".join(parts))


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
