"""The scene: what is on the ground, apart from the images that are taken of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...foundation.errors import InputError
from .acquisitions import Acquisition
from .landscape import Landscape, Objects, make_discs
from .options import LANDFORMS, SceneSpec
from .seasons import Chronicle, park_cars
from .terrain import Chart, TerrainSurface, make_fractal_terrain
from .texture import Texture
from .views import SceneView
from .world import constant, constants


@constants
class SCENE:
    """Size of a scene, and the places of objects."""

    most_posts: int = constant(4000, "posts", "largest number of posts along a side of the terrain")
    polar_share: float = constant(0.2, "", "half side of a scene over its distance from the pole, at most")
    unit_gsd_m: float = constant(0.7, "m", "ground sampling distance for which the landscape is true to scale")
    steepest_built: float = constant(0.5, "", "largest slope along the diagonal of an object")
    town_post_px: float = constant(
        4.0, "px", "spacing of the terrain's posts in a city, which has walls; 8 px elsewhere"
    )
    storeys_m: tuple[float, float] = constant(
        (5.0, 11.0), "m", "smallest height of a building in a city, and mean of the additional height"
    )
    target_px: float = constant(9.0, "px", "diameter of a target in the finest view")
    apron_px: float = constant(20.0, "px", "diameter of the apron around a target")


TARGET_GREY = np.array([1350.0, 1300.0, 1350.0, 1350.0, 1300.0])
APRON_GREY = np.array([330.0, 330.0, 340.0, 340.0, 330.0])


@dataclass(frozen=True, eq=False)
class Scene:
    """Terrain, landscape and painted objects.

    Parameters
    ----------
    spec : SceneSpec
        What it was made from.
    chart : Chart
        Metres east and north of the centre.
    terrain : TerrainSurface
        Heights.
    landscape : Landscape
        What lies on it.
    half_extent_m : float
        Half the side.
    finest_gsd_m : float
        Of the images, which sets how fine the texture is.
    targets_m : (n, 2) ndarray
        Surveyed targets in chart metres.
    bare : TerrainSurface
        The ground without the buildings on the terrain.
    """

    spec: SceneSpec
    chart: Chart
    terrain: TerrainSurface
    landscape: Landscape
    half_extent_m: float
    finest_gsd_m: float
    targets_m: np.ndarray
    bare: TerrainSurface

    @property
    def target_radius_m(self) -> float:
        """Radius of a target itself, without its apron."""
        return SCENE.target_px * self.finest_gsd_m / 2.0

    @property
    def has_walls(self) -> bool:
        """Whether the terrain has the buildings of a city."""
        return self.terrain is not self.bare

    @cached_property
    def objects(self) -> Objects:
        """Everything with a known shape, in painting order; targets last, each on a dark apron."""
        apron = make_discs("apron", self.targets_m, np.array(SCENE.apron_px * self.finest_gsd_m), APRON_GREY)
        target = make_discs("target", self.targets_m, np.array(SCENE.target_px * self.finest_gsd_m), TARGET_GREY)
        return select_buildable(self.landscape, self.bare, self.half_extent_m).append(apron).append(target)

    @cached_property
    def chronicle(self) -> Chronicle:
        """Objects by date with their heights, where the scene has dates."""
        return Chronicle.draw(self.objects, self.spec.seed, self.landscape.scale)

    @cached_property
    def texture(self) -> Texture:
        """The random fields of the landscape."""
        return Texture(self.landscape)

    def object_ground(self) -> np.ndarray:
        """Return the positions of the objects' centres.

        Returns
        -------
        (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.
        """
        position = self.objects.position_m
        return self.chart.to_ground(position, self.terrain.height(*position.T))


def make_scene(spec: SceneSpec, views: Sequence[SceneView]) -> Scene:
    """Return the scene that covers the views, without targets yet. Raises `InputError` without views."""
    if not views:
        raise InputError("a block needs at least one view: give some")
    finest = min(view.sensor.gsd_m for view in views)
    reach = max(float(np.hypot(*view.offset_m)) + view.half_diagonal_m for view in views)
    landform, relief_m = LANDFORMS[spec.landform], spec.relief_range_m
    half_extent = spec.half_extent_m or 1.05 * reach + 2.0 * (relief_m + spec.cliff_m) + 50.0 * finest
    post_px = 8.0 if landform.town is None else SCENE.town_post_px
    post = spec.post_m or max(post_px * finest, 2.0 * half_extent / SCENE.most_posts)
    if half_extent / post > SCENE.most_posts:
        raise InputError(
            f"a scene of {2e-3 * half_extent:.1f} km with posts of {post} m has more than {2 * SCENE.most_posts} posts "
            "a side: make the posts wider"
        )
    chart = Chart(spec.lon_deg, spec.lat_deg)
    to_pole = (90.0 - abs(spec.lat_deg)) * chart.scale[1]
    if half_extent > SCENE.polar_share * to_pole:
        raise InputError(
            f"a scene of {2e-3 * half_extent:.1f} km so near the pole ({1e-3 * to_pole:.1f} km): an RPC in longitude "
            "and latitude does not follow it: make the scene smaller, or move it away"
        )
    bare = make_fractal_terrain(
        chart,
        half_extent,
        post,
        mean_height_m=spec.mean_height_m,
        relief_m=relief_m,
        seed=spec.seed,
        cliff_m=spec.cliff_m,
    )
    scale = spec.scale or max(1.0, finest / SCENE.unit_gsd_m)
    landscape = Landscape(spec.seed, scale, town=landform.town)
    dated = any(view.acquisition is not None for view in views)  # then the chronicle determines them
    terrain = bare if landform.town is None or dated else build_town(bare, landscape, half_extent)
    return Scene(
        spec,
        chart,
        terrain,
        landscape=landscape,
        half_extent_m=half_extent,
        finest_gsd_m=finest,
        targets_m=np.empty((0, 2)),
        bare=bare,
    )


def select_buildable(landscape: Landscape, ground: TerrainSurface, half_extent_m: float) -> Objects:
    """Return the objects that do not lie across a cliff or on a very steep slope."""
    objects = landscape.objects(half_extent_m)
    corners = ground.height(*np.moveaxis(objects.corners_m(), 2, 0))
    return objects.select(np.ptp(corners, axis=1) < SCENE.steepest_built * np.hypot(*objects.size_m.T))


def build_town(ground: TerrainSurface, landscape: Landscape, half_extent_m: float) -> TerrainSurface:
    """Return the ground with the landscape's buildings on it, as high as those of a city."""
    objects = select_buildable(landscape, ground, half_extent_m)
    buildings = objects.select(np.isin(objects.kind, ("roof", "tank")))
    lowest, above = SCENE.storeys_m
    high_m = lowest + np.random.default_rng([landscape.seed, 66]).exponential(above, len(buildings))
    return ground.raise_rectangles(buildings.corners_m(), ground.height(*buildings.position_m.T) + high_m)


def select_objects(scene: Scene, acquisition: Acquisition) -> tuple[Objects, np.ndarray]:
    """Return the objects of a scene on a date, cars included, and the heights of these objects ``(n,)``."""
    standing = scene.chronicle.standing(acquisition.day)
    existing, height_m = scene.objects.select(standing), scene.chronicle.height_m[standing]
    cars = park_cars(scene.landscape, scene.half_extent_m, acquisition)
    # Cars below the targets, which are surveyed and stay free
    target = np.isin(existing.kind, ("apron", "target"))
    objects = existing.select(~target).append(cars).append(existing.select(target))
    return objects, np.concatenate([height_m[~target], np.zeros(len(cars)), height_m[target]])
