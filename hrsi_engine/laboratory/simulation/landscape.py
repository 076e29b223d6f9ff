"""What lies on the ground of a simulated scene: roads, parcels of land and objects with known centres and corners.

The land is a lattice of blocks, bent smoothly so that nothing is straight or parallel for long: chart metres
``(E, N)`` go to lattice metres ``(u, v)`` by a few sines, which can be undone to any accuracy. Roads follow the borders
of the blocks; every block has a land cover and is cut into parcels. All lengths are multiplied by ``scale``, so that a
coarser sensor shows a landscape of the same richness in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...block.columns import Columns
from .world import constant, constants

SPECTRAL_BANDS = ("pan", "blue", "green", "red", "nir")


@constants
class LAND_LATTICE:
    """Roads and parcels of the landscape."""

    block_m: float = constant(160.0, "m", "side of a block between roads")
    parcel_m: float = constant(40.0, "m", "side of a parcel")
    parcels: int = constant(512, "parcels", "side of the lattice, which repeats after 20 km")
    main_road_blocks: int = constant(6, "blocks", "distance of main roads")
    main_road_half_m: float = constant(7.0, "m", "half width of a main road")
    road_half_m: float = constant(3.0, "m", "half width of a road")
    roundabout_m: float = constant(40.0, "m", "diameter of a roundabout")
    island_m: float = constant(22.0, "m", "diameter of the island of a roundabout")


PER_BLOCK = int(LAND_LATTICE.block_m / LAND_LATTICE.parcel_m)
#: Amplitude (m), wave length (m) and direction (radians from the axis) of the sines that bend the lattice.
BENDS = ((30.0, 1900.0, 0.0), (12.0, 700.0, 0.5))


class LandCover(NamedTuple):
    """A land cover: share of all blocks, grey values of `SPECTRAL_BANDS` (11 bit), and how much they vary."""

    name: str
    share: float
    grey: tuple[float, float, float, float, float]
    parcel_spread: float  # standard deviation between parcels, as a share of the grey value
    contrast: float  # of the fine texture, relative too
    canopy: float  # of tree crowns, relative too


COVERS = (
    LandCover("field", 0.42, (560.0, 390.0, 500.0, 480.0, 900.0), 0.28, 0.12, 0.0),
    LandCover("meadow", 0.12, (460.0, 330.0, 440.0, 370.0, 980.0), 0.10, 0.18, 0.15),
    LandCover("forest", 0.18, (290.0, 240.0, 300.0, 210.0, 850.0), 0.05, 0.05, 0.35),
    LandCover("town", 0.18, (500.0, 460.0, 480.0, 470.0, 600.0), 0.15, 0.15, 0.2),
    LandCover("works", 0.05, (640.0, 620.0, 640.0, 640.0, 600.0), 0.05, 0.08, 0.0),
    LandCover("water", 0.05, (150.0, 260.0, 190.0, 110.0, 50.0), 0.0, 0.0, 0.0),
)
COVER_INDEX = {cover.name: index for index, cover in enumerate(COVERS)}
ROAD_GREY = np.array([400.0, 410.0, 420.0, 430.0, 400.0], dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Objects(Columns):
    """Painted objects, in the order in which they cover one another.

    kind : (n,) str, ``roof``, ``tank``, ``roundabout``, ``island``, ``apron`` or ``target``
    position_m : (n, 2) chart metres of the centre; size_m : (n, 2) length and width, equal for discs
    azimuth_rad : (n,) of the length; grey : (n, 5)
    """

    kind: np.ndarray
    position_m: np.ndarray
    size_m: np.ndarray
    azimuth_rad: np.ndarray
    grey: np.ndarray

    def __len__(self) -> int:
        return len(self.kind)

    def append(self, additions: Objects) -> Objects:
        """Return these objects with others painted after them."""
        names = ("kind", "position_m", "size_m", "azimuth_rad", "grey")
        return Objects(*(np.concatenate([getattr(self, n), getattr(additions, n)]) for n in names))

    def corners_m(self) -> np.ndarray:
        """Return the four corners ``(n, 4, 2)`` of each object's rectangle in chart metres."""
        along = np.column_stack([np.sin(self.azimuth_rad), np.cos(self.azimuth_rad)]) * self.size_m[:, :1] / 2.0
        across = np.column_stack([np.cos(self.azimuth_rad), -np.sin(self.azimuth_rad)]) * self.size_m[:, 1:] / 2.0
        signs = ((1, 1), (1, -1), (-1, -1), (-1, 1))
        return np.stack([self.position_m + a * along + b * across for a, b in signs], axis=1)


def make_discs(kind: str, position_m: np.ndarray, diameter_m: np.ndarray, grey: np.ndarray) -> Objects:
    """Return round objects; ``grey`` is ``(n, 5)`` or ``(5,)``."""
    count = len(position_m)
    return Objects(
        np.full(count, kind, dtype="U12"),
        np.asarray(position_m, dtype=np.float64).reshape(count, 2),
        np.repeat(np.broadcast_to(diameter_m, (count,))[:, None], 2, axis=1),
        np.zeros(count),
        np.broadcast_to(grey, (count, len(SPECTRAL_BANDS))).astype(np.float32),
    )


def make_strips(values: np.ndarray, is_by_row: np.ndarray) -> np.ndarray:
    """Return values of parcels ``(parcels, parcels)`` that are equal along the strips of each block.

    The strips of a block are its rows of parcels where ``is_by_row (blocks, blocks)``, otherwise its columns; the value
    of the first parcel is that of the strip.
    """
    by_row = np.kron(is_by_row, np.ones((PER_BLOCK, PER_BLOCK), dtype=bool))
    rows = np.repeat(values[:, ::PER_BLOCK], PER_BLOCK, axis=1)
    return np.where(by_row, rows, np.repeat(values[::PER_BLOCK], PER_BLOCK, axis=0))


@dataclass(frozen=True)
class Landscape:
    """The bent lattice of a scene, its land covers and its objects; everything follows from ``seed`` and ``scale``.

    ``town`` is the share of built-up blocks, where it is not that of `COVERS`. On a ``date`` other than 0 parcels
    differ by the share ``change`` of their usual differences.
    """

    seed: int
    scale: float = 1.0
    date: int = 0
    change: float = 0.0
    town: float | None = None

    # ---- lattice -----------------------------------------------------------------------------------------------

    @cached_property
    def phases(self) -> np.ndarray:
        """Phases of the bends of u and of v, ``(2, bends)``."""
        return np.random.default_rng([self.seed, 10]).uniform(0.0, 2.0 * np.pi, (2, len(BENDS))).astype(np.float32)

    def to_lattice(self, east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ``u, v`` of unscaled chart metres (float32 or float64, kept)."""
        u, v = east, north
        for bend, (amplitude, length, direction) in enumerate(BENDS):
            rate = east.dtype.type(2.0 * np.pi / length)
            a, b = rate * east.dtype.type(np.sin(direction)), rate * east.dtype.type(np.cos(direction))
            u = u + east.dtype.type(amplitude) * np.sin(a * east + b * north + self.phases[0, bend])
            v = v + east.dtype.type(amplitude) * np.sin(b * east + a * north + self.phases[1, bend])
        return u, v

    def from_lattice(self, lattice: np.ndarray) -> np.ndarray:
        """Return unscaled chart metres ``(n, 2)`` of lattice points; the bends contract by 0.3, to 1e-9 m."""
        chart = np.array(lattice, dtype=np.float64)
        for _ in range(40):
            chart = chart + lattice - np.column_stack(self.to_lattice(chart[:, 0], chart[:, 1]))
        return chart

    @cached_property
    def block_cover(self) -> np.ndarray:
        """Index into `COVERS` of each block, (rows of v, columns of u)."""
        blocks = LAND_LATTICE.parcels // PER_BLOCK
        shares = np.array([cover.share for cover in COVERS])
        if self.town is not None:
            town = np.arange(len(COVERS)) == COVER_INDEX["town"]
            shares = np.where(town, self.town, (1.0 - self.town) * shares / shares[~town].sum())
        rng = np.random.default_rng([self.seed, 11])
        return rng.choice(len(COVERS), size=(blocks, blocks), p=shares / shares.sum())

    @cached_property
    def parcel_cover(self) -> np.ndarray:
        """Index into `COVERS` of each parcel, ``(parcels, parcels)``."""
        return np.kron(self.block_cover, np.ones((PER_BLOCK, PER_BLOCK), dtype=int))

    @cached_property
    def parcel_grey(self) -> np.ndarray:
        """Grey value of each parcel in each band, ``(5, parcels, parcels)`` float32; fields are strips of parcels."""
        rng = np.random.default_rng([self.seed, 12])
        is_by_row = rng.random(self.block_cover.shape) < 0.5
        variation = rng.standard_normal((LAND_LATTICE.parcels, LAND_LATTICE.parcels))
        if self.date and self.change:
            change_noise = np.random.default_rng([self.seed, 13, self.date]).standard_normal(
                (LAND_LATTICE.parcels, LAND_LATTICE.parcels)
            )
            variation = np.sqrt(1.0 - self.change**2) * variation + self.change * change_noise
        spread = np.array([c.parcel_spread for c in COVERS])[self.parcel_cover]
        factor = np.maximum(1.0 + spread * make_strips(variation, is_by_row), 0.3)
        return (np.array([c.grey for c in COVERS]).T[:, self.parcel_cover] * factor).astype(np.float32)

    @cached_property
    def parcel_contrast(self) -> np.ndarray:
        """Contrast of the fine texture and of tree crowns in each parcel, ``(2, parcels, parcels)`` float32."""
        return np.array([[c.contrast, c.canopy] for c in COVERS], dtype=np.float32).T[:, self.parcel_cover]

    # ---- objects -----------------------------------------------------------------------------------------------

    def objects(self, half_extent_m: float) -> Objects:
        """Return roofs, tanks and roundabouts within a square around the chart's origin (metres, scaled)."""
        reach = half_extent_m / self.scale
        spacing = LAND_LATTICE.main_road_blocks * LAND_LATTICE.block_m
        count = int(np.ceil((reach + 100.0) / spacing))
        steps = spacing * np.arange(-count, count + 1)
        crossings = self.from_lattice(np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2))
        island = np.array([680.0, 500.0, 680.0, 560.0, 900.0])
        outer = make_discs("roundabout", crossings, np.full(len(crossings), LAND_LATTICE.roundabout_m), ROAD_GREY)
        roundabouts = outer.append(
            make_discs("island", crossings, np.full(len(crossings), LAND_LATTICE.island_m), island)
        )
        cells = self._parcels_of("town", reach)
        draw = self._draws(cells, 20, 7)
        cells, draw = cells[draw[:, 0] < 0.8], draw[draw[:, 0] < 0.8]
        tone = 330.0 + 1100.0 * draw[:, 1]
        colour = np.tile([1.0, 0.8, 0.9, 1.0, 0.8], (len(cells), 1))
        colour[:, 1] += 0.2 * draw[:, 2]
        roofs = Objects(
            np.full(len(cells), "roof", dtype="U12"),
            self._centres(cells, 8.0 * draw[:, 3:5] - 4.0),
            np.column_stack([12.0 + 8.0 * draw[:, 5], 8.0 + 5.0 * draw[:, 6]]),
            np.pi * np.floor(4.0 * draw[:, 2]) / 4.0 + 0.3 * (draw[:, 1] - 0.5),
            (tone[:, None] * colour).astype(np.float32),
        )
        objects = roundabouts.append(roofs).append(self._tanks(reach))
        objects = objects.select(np.abs(objects.position_m).max(axis=1) < reach)
        return replace(objects, position_m=objects.position_m * self.scale, size_m=objects.size_m * self.scale)

    def parcels_within(self, half_extent_m: float) -> np.ndarray:
        """Return row and column (unwrapped) of the parcels within a square around the chart's origin, ``(n, 2)``."""
        count = int(np.ceil((half_extent_m / self.scale + 100.0) / LAND_LATTICE.parcel_m))
        return np.mgrid[-count:count, -count:count].reshape(2, -1).T

    def parcel_centres(self, parcels: np.ndarray) -> np.ndarray:
        """Return chart metres of the middles of parcels ``(n, 2)``, scaled."""
        return self.scale * self._centres(parcels, np.zeros((len(parcels), 2)))

    def _parcels_of(self, cover: str, reach: float) -> np.ndarray:
        """Return row and column (unwrapped) of the parcels of a land cover within reach, ``(n, 2)``."""
        parcels = self.parcels_within(reach * self.scale)
        return parcels[self.parcel_cover[tuple(parcels.T % LAND_LATTICE.parcels)] == COVER_INDEX[cover]]

    def _draws(self, cells: np.ndarray, stream: int, count: int) -> np.ndarray:
        """Return ``(n, count)`` uniform draws in [0, 1) that belong to each parcel, whatever the scene's extent."""
        table = np.random.default_rng([self.seed, stream]).random(
            (LAND_LATTICE.parcels, LAND_LATTICE.parcels, count), dtype=np.float32
        )
        return table[cells[:, 0] % LAND_LATTICE.parcels, cells[:, 1] % LAND_LATTICE.parcels].astype(np.float64)

    def _centres(self, cells: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Return chart metres of parcel centres moved by ``shift`` (u, v metres)."""
        return self.from_lattice((cells[:, ::-1] + 0.5) * LAND_LATTICE.parcel_m + shift)

    def _tanks(self, reach: float) -> Objects:
        """Return tanks on most parcels of works, bright or dark, the bright ones large (metres, unscaled)."""
        cells = self._parcels_of("works", reach)
        draw = self._draws(cells, 21, 5)
        cells, draw = cells[draw[:, 0] < 0.6], draw[draw[:, 0] < 0.6]
        tone = np.where(draw[:, 1] < 0.5, 1150.0 + 300.0 * draw[:, 2], 230.0 + 100.0 * draw[:, 2])
        return make_discs(
            "tank", self._centres(cells, 6.0 * draw[:, 3:5] - 3.0), 12.0 + 14.0 * draw[:, 2], tone[:, None]
        )
