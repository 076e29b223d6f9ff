"""A year over the scene: what is different on the ground from date to date.

Fields go through the
year of a crop, ploughed, green, ripe, stubble; meadows and deciduous forest follow the season; the texture of soil and
plants decorrelates over two months, that of roads and roofs never; snow lies in patches on winter days; a share of the
buildings is built or torn down on some day; cars are on the roads, others every time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from .acquisitions import YEAR_DAYS, Acquisition, compute_day_of_season
from .landscape import LAND_LATTICE, Landscape, Objects, make_strips
from .texture import PeriodicField, SensorTexture, Texture
from .world import constant, constants


@constants
class YEAR:
    """Changes of the ground within a year."""

    texture_days: float = constant(60.0, "d", "time after which the texture of soil and plants has changed")
    built_share: float = constant(0.12, "", "share of the buildings that are built in the year")
    torn_share: float = constant(0.08, "", "share of the buildings that are demolished in the year")
    car_spacing_m: float = constant(45.0, "m", "length of road and lane for each car")
    car_size_m: tuple[float, float] = constant((4.6, 1.9), "m", "length and width of a car")
    ploughed_days: float = constant(40.0, "d", "time that a field lies bare")
    winter_crop_day: float = constant(285.0, "d", "day of the year on which winter crops are sown")
    summer_crop_day: float = constant(95.0, "d", "day on which summer crops are sown")
    ploughing_spread_d: float = constant(18.0, "d", "standard deviation of the sowing days")


#: Visible and near infrared brightness of a field by the days since it was ploughed, relative to its usual one.
CROP_DAYS = (0.0, 40.0, 110.0, 190.0, 225.0, 260.0, 330.0, 365.0)
CROP_VISIBLE = (0.70, 0.78, 0.62, 0.80, 1.25, 1.10, 0.95, 0.90)
CROP_NEAR_INFRARED = (0.45, 0.50, 1.15, 1.05, 0.70, 0.60, 0.55, 0.50)
#: By land cover (the order of `COVERS`): share of the fine texture that belongs to the season; how far snow covers it.
OWN_TEXTURE = (0.95, 0.9, 0.75, 0.45, 0.3, 0.0)
SNOW_HOLD = (1.0, 1.0, 0.45, 0.7, 0.8, 0.0)


# ---- the land ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SeasonLandscape(Landscape):
    """The landscape on one date; ``day`` is that of the northern year with the same season."""

    day: float = 0.0
    snow: float = 0.0

    @classmethod
    def from_acquisition(cls, landscape: Landscape, acquisition: Acquisition, lat_deg: float) -> SeasonLandscape:
        """Return a landscape on the date of an acquisition."""
        day = compute_day_of_season(acquisition.day, lat_deg)
        return cls(landscape.seed, landscape.scale, town=landscape.town, day=day, snow=acquisition.snow)

    @cached_property
    def ploughing_day(self) -> np.ndarray:
        """Day on which each parcel is ploughed, ``(parcels, parcels)``; that of fields counts, equal along strips."""
        rng = np.random.default_rng([self.seed, 62])
        is_by_row = np.random.default_rng([self.seed, 12]).random(self.block_cover.shape) < 0.5  # as `parcel_grey`'s
        day = np.where(
            rng.random((LAND_LATTICE.parcels, LAND_LATTICE.parcels)) < 0.6, YEAR.winter_crop_day, YEAR.summer_crop_day
        )
        day += YEAR.ploughing_spread_d * rng.standard_normal((LAND_LATTICE.parcels, LAND_LATTICE.parcels))
        return make_strips(day, is_by_row) % YEAR_DAYS

    @property
    def ploughed(self) -> np.ndarray:
        """Mask of the parcels that lie ploughed and bare, ``(parcels, parcels)``."""
        return (self.parcel_cover == 0) & ((self.day - self.ploughing_day) % YEAR_DAYS < YEAR.ploughed_days)

    @property
    def summer(self) -> float:
        """How far it is summer: 0 on 21 January, 1 half a year later, a cosine between."""
        return float(0.5 - 0.5 * np.cos(2.0 * np.pi * (self.day - 20.0) / YEAR_DAYS))

    @cached_property
    def parcel_grey(self) -> np.ndarray:
        """As `Landscape.parcel_grey`, by the season."""
        usual = super().parcel_grey
        age = (self.day - self.ploughing_day) % YEAR_DAYS
        leaves = np.clip(2.0 * self.summer - 0.5, 0.0, 1.0)
        # By land cover (the order of `COVERS`); fields follow their crop
        covers_visible = np.array([1.0, 1.15 - 0.3 * leaves, 1.3 - 0.3 * leaves, 1.0, 1.0, 1.0])
        covers_near_infrared = np.array([1.0, 0.6 + 0.4 * leaves, 0.6 + 0.4 * leaves, 1.0, 1.0, 1.0])
        visible, near_infrared = (
            np.where(self.parcel_cover == 0, np.interp(age, CROP_DAYS, crop), covers[self.parcel_cover])
            for crop, covers in ((CROP_VISIBLE, covers_visible), (CROP_NEAR_INFRARED, covers_near_infrared))
        )
        pan = 0.7 * visible + 0.3 * near_infrared
        return (usual * np.stack([pan, visible, visible, visible, near_infrared])).astype(np.float32)

    @cached_property
    def parcel_contrast(self) -> np.ndarray:
        """As `Landscape.parcel_contrast`: bare soil is rougher, bare trees are fainter."""
        contrast = super().parcel_contrast.copy()
        contrast[0] *= np.where(self.ploughed, 1.6, 1.0)
        contrast[1] *= 0.55 + 0.45 * self.summer
        return contrast

    @cached_property
    def parcel_season(self) -> np.ndarray:
        """Share of the season's own texture, and how far snow covers a parcel, ``(2, parcels, parcels)`` float32."""
        return np.array([OWN_TEXTURE, SNOW_HOLD], dtype=np.float32)[:, self.parcel_cover]

    @property
    def snow_line(self) -> float:
        """What the broad field, of unit standard deviation, falls short of where snow lies."""
        return float(ndtri(np.clip(self.snow, 1e-9, 1.0 - 1e-9)))


def make_season_texture(
    texture: Texture, acquisition: Acquisition, lat_deg: float, sigma_m: float, band: int
) -> SensorTexture:
    """Return the ground on a date as observed by a sensor whose blur has ``sigma_m``, in one of `SPECTRAL_BANDS`.

    Soil and plants go from one texture of their own to the next within two months (`YEAR`); the sun lights crowns.
    """
    landscape, seed = SeasonLandscape.from_acquisition(texture.landscape, acquisition, lat_deg), texture.landscape.seed
    epoch, share = divmod(acquisition.day / YEAR.texture_days, 1.0)
    first, second = (
        PeriodicField.power_law(1024, 0.5, 0.9, np.random.default_rng([seed, 63, int(epoch) + k])) for k in (0, 1)
    )
    soil = first.mix(second, float(np.sin(0.5 * np.pi * share)))
    turned = np.radians(270.0 - acquisition.sun_azimuth_deg)  # from the west
    canopy = PeriodicField.tree_crowns(1024, 0.5, 6.0, np.random.default_rng([seed, 32]), turned)
    sigma = sigma_m / landscape.scale
    fields = tuple(field.blur(sigma) for field in (texture.fine, texture.broad, canopy, soil))
    return SensorTexture(landscape, fields, sigma, band)


# ---- objects on the ground ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Chronicle:
    """When the objects of a scene were built and torn down, and how high they are; days of the year.

    ``built_day`` is below 0 for what stood before the year, ``torn_day`` beyond it for what stays.
    """

    height_m: np.ndarray
    built_day: np.ndarray
    torn_day: np.ndarray

    @classmethod
    def draw(cls, objects: Objects, seed: int, scale: float) -> Chronicle:
        """Return the year of the objects of a scene."""
        draw = np.random.default_rng([seed, 64]).random((len(objects), 4))
        high = {"roof": (3.5, 9.0), "tank": (6.0, 6.0)}
        low_m, range_m = np.array([high.get(str(kind), (0.0, 0.0)) for kind in objects.kind]).reshape(-1, 2).T
        building = low_m > 0.0
        built_day = np.where(building & (draw[:, 1] < YEAR.built_share), YEAR_DAYS * draw[:, 2], -1.0)
        is_torn = (draw[:, 1] > 1.0 - YEAR.torn_share) & building
        return cls(
            scale * (low_m + range_m * draw[:, 0]),
            built_day,
            np.where(is_torn, YEAR_DAYS * draw[:, 3], 2.0 * YEAR_DAYS),
        )

    def standing(self, day: float) -> np.ndarray:
        """Return a mask of the objects that exist on a day."""
        return (self.built_day <= day) & (day < self.torn_day)


def park_cars(landscape: Landscape, half_extent_m: float, acquisition: Acquisition) -> Objects:
    """Return the cars on the roads of a date, on either lane, as painted objects."""
    rng = np.random.default_rng([landscape.seed, 65, acquisition.number])
    reach = half_extent_m / landscape.scale
    lines = int(np.ceil((reach + 100.0) / LAND_LATTICE.block_m))
    count = int((2 * lines + 1) * 2 * reach / YEAR.car_spacing_m)
    lattice, ahead = [], []
    for axis in (0, 1):
        place = np.empty((count, 2))
        lane = rng.choice([-1.5, 1.5], count)
        place[:, axis] = LAND_LATTICE.block_m * rng.integers(-lines, lines + 1, count) + lane
        place[:, 1 - axis] = rng.uniform(-reach, reach, count)
        lattice.append(place)
        ahead.append(place + np.eye(2)[1 - axis])
    position, next_one = (landscape.from_lattice(np.concatenate(parts)) for parts in (lattice, ahead))
    inside = np.abs(position).max(axis=1) < reach
    position, direction = position[inside], (next_one - position)[inside]
    grey = np.where(
        rng.random(len(position)) < 0.5, rng.uniform(900, 1500, len(position)), rng.uniform(80, 300, len(position))
    )
    return Objects(
        np.full(len(position), "car", dtype="U12"),
        position * landscape.scale,
        np.tile(np.array(YEAR.car_size_m) * landscape.scale, (len(position), 1)),
        np.arctan2(*direction.T),
        np.repeat(grey[:, None], 5, axis=1).astype(np.float32),
    )
