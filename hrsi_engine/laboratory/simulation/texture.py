"""Grey values of the simulated ground at any point and resolution, already blurred by the sensor.

Every part has its closed or exact blurred form, so that one evaluation a pixel is free of aliasing: random textures are
periodic fields whose Fourier coefficients are multiplied with the transfer function of a Gaussian; borders of parcels
and roads are ramps as wide as the Gaussian's equivalent width; objects have the Gaussian's integral as their edge
(`ndtr`). The blur is isotropic on the ground, with a standard deviation given in metres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from scipy import fft, ndimage
from scipy.special import ndtr

from .landscape import LAND_LATTICE, ROAD_GREY, Landscape, Objects
from .world import constant, constants

#: Width of the ramp with the same slope at the middle as a Gaussian edge of unit standard deviation.
RAMP = np.float32(np.sqrt(2.0 * np.pi))


@constants
class SNOW:
    """Grey value and distribution of snow."""

    grey: float = constant(1450.0, "DN", "grey value of snow")
    on_roads: float = constant(0.35, "", "snow on roads relative to open land")


@runtime_checkable
class LandscapeOfDate(Protocol):
    """What the landscape of a date has besides (`seasons.SeasonLandscape`)."""

    @property
    def parcel_season(self) -> np.ndarray:
        """Share of the season's own texture, and how far snow covers a parcel, ``(2, parcels, parcels)``."""

    @property
    def snow(self) -> float:
        """Share of the open land under snow."""

    @property
    def snow_line(self) -> float:
        """What the broad field falls short of where snow lies."""


@dataclass(frozen=True, eq=False)
class PeriodicField:
    """A random field that repeats; ``spectrum`` is its `rfft2`, ``cell_m`` the spacing it was made with.

    The terms of the highest frequency are 0: their phase would be lost between the nodes.
    """

    spectrum: np.ndarray
    cell_m: float

    def __post_init__(self) -> None:
        half = self.spectrum.shape[0] // 2
        self.spectrum[half], self.spectrum[:, half] = 0.0, 0.0

    @classmethod
    def power_law(cls, count: int, cell_m: float, slope: float, rng: np.random.Generator) -> PeriodicField:
        """Return a field of unit standard deviation with amplitudes falling as ``frequency ** -slope``."""
        frequency = np.hypot(fft.fftfreq(count)[:, None], fft.rfftfreq(count)[None, :])
        frequency[0, 0] = np.inf
        spectrum = fft.rfft2(rng.standard_normal((count, count), dtype=np.float32)) * frequency**-slope
        return cls(spectrum / fft.irfft2(spectrum, s=(count, count)).std(), cell_m)

    @classmethod
    def tree_crowns(
        cls, count: int, cell_m: float, crown_m: float, rng: np.random.Generator, sun_rad: float = 0.0
    ) -> PeriodicField:
        """Return a canopy of domes, lit from one side, of zero mean and unit standard deviation.

        ``sun_rad`` is by how much the light has turned from the west.
        """
        stems = np.ones((count, count), dtype=bool)
        number = int((count * cell_m / crown_m) ** 2)
        stems[tuple(rng.integers(0, count, (2, number)))] = False
        wrapped = np.pad(stems, 32, mode="wrap")
        distance = ndimage.distance_transform_edt(wrapped, sampling=cell_m)[32:-32, 32:-32]
        crown = np.sqrt(np.clip(1.0 - (distance / (0.75 * crown_m)) ** 2, 0.0, 1.0))
        slopes = [np.roll(crown, 1, axis=axis) - np.roll(crown, -1, axis=axis) for axis in (1, 0)]
        lit = crown + 0.8 * (np.cos(sun_rad) * slopes[0] + np.sin(sun_rad) * slopes[1])
        return cls(fft.rfft2((lit - lit.mean()) / lit.std()), cell_m)

    def mix(self, partner: PeriodicField, share: float) -> PeriodicField:
        """Return a field of the same strength that has a correlation of sqrt(1 - share²) with this one."""
        return PeriodicField(np.sqrt(1.0 - share**2) * self.spectrum + share * partner.spectrum, self.cell_m)

    def blur(self, sigma_m: float) -> tuple[np.ndarray, float]:
        """Return the field blurred by a Gaussian, float32, and its spacing: half the cell where the blur is fine."""
        count = self.spectrum.shape[0]
        frequency = np.hypot(fft.fftfreq(count)[:, None], fft.rfftfreq(count)[None, :]) / self.cell_m
        spectrum = self.spectrum * np.exp(-2.0 * (np.pi * sigma_m * frequency) ** 2)
        if sigma_m > 2.0 * self.cell_m:
            return fft.irfft2(spectrum, s=(count, count)).astype(np.float32), self.cell_m
        wide = np.zeros((2 * count, count + 1), dtype=spectrum.dtype)
        half = count // 2
        wide[:half, : half + 1], wide[-half:, : half + 1] = spectrum[:half], spectrum[-half:]
        return (4.0 * fft.irfft2(wide, s=(2 * count, 2 * count))).astype(np.float32), self.cell_m / 2.0


def sample_periodic(field: np.ndarray, cell_m: float, east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """Return a periodic raster (side a power of two) at chart positions, bilinear, float32."""
    count = field.shape[0]
    x, y = east / np.float32(cell_m), north / np.float32(cell_m)
    column, row = np.floor(x).astype(np.int32), np.floor(y).astype(np.int32)
    x, y = x - column, y - row
    return _blend_fields(field, row, column, x.astype(np.float32), y.astype(np.float32), count - 1)


def _blend_fields(
    table: np.ndarray, row: np.ndarray, column: np.ndarray, x: np.ndarray, y: np.ndarray, mask: int
) -> np.ndarray:
    """Return the bilinear mixture of four neighbours in a periodic table, weights ``x`` and ``y`` of the next ones."""
    flat, count = table.ravel(), mask + 1
    left, right = column & mask, (column + 1) & mask
    first, second = (row & mask) * count, ((row + 1) & mask) * count
    upper = flat.take(first + left)
    upper += x * (flat.take(first + right) - upper)
    lower = flat.take(second + left)
    lower += x * (flat.take(second + right) - lower)
    upper += y * (lower - upper)
    return upper


@dataclass(frozen=True)
class Texture:
    """The random fields that belong to a landscape."""

    landscape: Landscape

    @cached_property
    def fine(self) -> PeriodicField:
        """Soil, grass, asphalt: 1 m to 512 m."""
        return PeriodicField.power_law(1024, 0.5, 0.9, np.random.default_rng([self.landscape.seed, 30]))

    @cached_property
    def broad(self) -> PeriodicField:
        """Patches of 8 m to 4 km; its period breaks the repetition of the fine one."""
        return PeriodicField.power_law(1024, 3.7, 1.1, np.random.default_rng([self.landscape.seed, 31]))

    @cached_property
    def canopy(self) -> PeriodicField:
        """Tree crowns of about 6 m."""
        return PeriodicField.tree_crowns(1024, 0.5, 6.0, np.random.default_rng([self.landscape.seed, 32]))

    def blur(self, sigma_m: float, band: int, date: int = 0, change: float = 0.0) -> SensorTexture:
        """Return the ground as observed by a sensor whose blur on the ground has ``sigma_m``, in one of `BANDS`.

        At dates other than 0 the ``change``, 0 … 1, is how much of soil and plants looks different: their fine texture
        is mixed with one of its own, parcels have other grey values, and the sun lights the crowns from elsewhere.
        """
        sigma = sigma_m / self.landscape.scale
        landscape, fine, canopy = self.landscape, self.fine, self.canopy
        if date and change:
            seed = self.landscape.seed
            date_noise = PeriodicField.power_law(1024, 0.5, 0.9, np.random.default_rng([seed, 33, date]))
            fine = fine.mix(date_noise, change)
            sun = change * np.random.default_rng([seed, 34, date]).uniform(-np.pi, np.pi)
            canopy = PeriodicField.tree_crowns(1024, 0.5, 6.0, np.random.default_rng([seed, 32]), sun)
            landscape = replace(self.landscape, date=date, change=change)
        fields = tuple(field.blur(sigma) for field in (fine, self.broad, canopy))
        return SensorTexture(landscape, fields, sigma, band)


@dataclass(frozen=True, eq=False)
class SensorTexture:
    """Grey values of one band at one resolution; ``sigma_m`` is in unscaled metres of the landscape."""

    landscape: Landscape
    fields: tuple[tuple[np.ndarray, float], ...]
    sigma_m: float
    band: int

    def grey(self, east: np.ndarray, north: np.ndarray) -> np.ndarray:
        """Return the ground without objects at chart metres, float32 in the positions' shape."""
        e = (east / self.landscape.scale).astype(np.float32)
        n = (north / self.landscape.scale).astype(np.float32)
        u, v = self.landscape.to_lattice(e, n)
        # Grey value, contrast and canopy, mixed across the borders of parcels
        column, x = self._border_mixture(u)
        row, y = self._border_mixture(v)
        landscape = self.landscape
        tables = (landscape.parcel_grey[self.band], *landscape.parcel_contrast)
        grey, contrast, canopy = (_blend_fields(table, row, column, x, y, LAND_LATTICE.parcels - 1) for table in tables)
        fine, broad, crowns, *season = (sample_periodic(*field, e, n) for field in self.fields)
        soil, snow = fine, None
        if season and isinstance(landscape, LandscapeOfDate):
            share, hold = (
                _blend_fields(table, row, column, x, y, LAND_LATTICE.parcels - 1) for table in landscape.parcel_season
            )
            soil = np.sqrt(1.0 - share**2) * fine + share * season[0]
            if landscape.snow:
                snow = hold * np.clip(4.0 * (landscape.snow_line - broad - 0.2 * season[0]) + 0.5, 0.0, 1.0)
        grey *= 1.0 + contrast * (soil + 0.6 * broad) + canopy * crowns
        # The share of road in each pixel
        free = (1.0 - self._roads_along(u)) * (1.0 - self._roads_along(v))
        road = 1.0 - free
        grey = grey + road * (ROAD_GREY[self.band] * (1.0 + np.float32(0.05) * fine) - grey)
        if snow is not None:
            grey += (
                snow
                * (1.0 - np.float32(1.0 - SNOW.on_roads) * road)
                * (np.float32(SNOW.grey) * (1.0 + np.float32(0.03) * soil) - grey)
            )
        return grey

    def _border_mixture(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the parcel before the nearest border and the share of the one behind it."""
        position = u / np.float32(LAND_LATTICE.parcel_m)
        border = np.rint(position)
        width = max(RAMP * np.float32(self.sigma_m), np.float32(1e-3)) / np.float32(LAND_LATTICE.parcel_m)
        share = np.clip((position - border) / width + np.float32(0.5), 0.0, 1.0)
        return border.astype(np.int32) - 1, share

    def _roads_along(self, u: np.ndarray) -> np.ndarray:
        """Return the share of each pixel on roads that run along one axis; ``u`` is the lattice metre across them."""
        position = u / np.float32(LAND_LATTICE.block_m)
        border = np.rint(position)
        main = np.rint(border / LAND_LATTICE.main_road_blocks) * LAND_LATTICE.main_road_blocks == border
        half = np.where(main, np.float32(LAND_LATTICE.main_road_half_m), np.float32(LAND_LATTICE.road_half_m))
        inside = half - np.abs(position - border) * np.float32(LAND_LATTICE.block_m)
        width = max(RAMP * np.float32(self.sigma_m), np.float32(1e-3))
        return np.clip(inside / width + np.float32(0.5), 0.0, 1.0)


# ---- objects ---------------------------------------------------------------------------------------------------


def compute_disc_cover(right: np.ndarray, ahead: np.ndarray, size_m: np.ndarray, sigma_m: float) -> np.ndarray:
    """Return the share of a disc in each pixel; ``right`` and ``ahead`` are metres from its centre."""
    return ndtr((np.float32(size_m[0] / 2.0) - np.hypot(right, ahead)) / np.float32(sigma_m))


def compute_rectangle_cover(right: np.ndarray, ahead: np.ndarray, size_m: np.ndarray, sigma_m: float) -> np.ndarray:
    """Return the share of a rectangle, ``size_m`` long ahead and wide to the right, in each pixel; exact."""
    cover = np.ones_like(right)
    for distance, size in ((ahead, size_m[0]), (right, size_m[1])):
        half, sigma = np.float32(size / 2.0), np.float32(sigma_m)
        cover *= ndtr((half - distance) / sigma) - ndtr((-half - distance) / sigma)
    return cover


CoverFunction = Callable[[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray]
COVERAGE: dict[str, CoverFunction] = {
    "roof": compute_rectangle_cover,
    "tank": compute_disc_cover,
    "car": compute_rectangle_cover,
    "roundabout": compute_disc_cover,
    "island": compute_disc_cover,
    "apron": compute_disc_cover,
    "target": compute_disc_cover,
}


def compute_cover(objects: Objects, index: int, east: np.ndarray, north: np.ndarray, blur_m: float) -> np.ndarray:
    """Return the share of each pixel that an object covers at chart positions."""
    east_off = (east - objects.position_m[index, 0]).astype(np.float32)
    north_off = (north - objects.position_m[index, 1]).astype(np.float32)
    sin, cos = np.float32(np.sin(objects.azimuth_rad[index])), np.float32(np.cos(objects.azimuth_rad[index]))
    ahead, right = sin * east_off + cos * north_off, cos * east_off - sin * north_off
    return COVERAGE[str(objects.kind[index])](right, ahead, objects.size_m[index], blur_m)
