"""A synthetic block with its full truth: scene, cameras, vendor RPCs, points and measurements; no pixels needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...block.assembly import assemble
from ...block.block import Block, Image, Role
from ...foundation.errors import InputError
from ...foundation.progress import Progress, advance, silent, stage
from ...ground.geodesy import metres_per_degree
from .acquisitions import Acquisition
from .control import (
    TrueImagePoints,
    measure_points,
    place_control,
    place_ties,
    project_true_points,
    survey_points,
)
from .options import Noise, PointCounts, SceneSpec
from .pushbroom import PushbroomCamera
from .scene import Scene, make_scene
from .vendor import VendorRPC, fit_camera, make_accuracy_statement
from .views import SceneView


@dataclass(frozen=True, eq=False)
class BlockTruth:
    """Everything that is exactly so.

    Parameters
    ----------
    cameras : tuple of PushbroomCamera
        The physical cameras that took the images.
    vendor_cameras : tuple of PushbroomCamera
        The vendor's assumption.
    vendor_rpcs : tuple of VendorRPC
        The delivered RPCs with their fit errors.
    height_range_m : tuple of float
        The heights they were made for.
    ids : (m,) ndarray of str
        Of all points, sorted.
    ground : (m, 3) ndarray
        True positions: lon, lat in degrees, ellipsoidal height in metres.
    role : (m,) ndarray of int
        Values of `Role`.
    image_points : TrueImagePoints
        Exact image points.
    blunder : (n,) ndarray
        True for measurements that were made gross errors.
    wrong_height : (m,) ndarray
        True for GCPs whose surveyed height is wrong.
    """

    cameras: tuple[PushbroomCamera, ...]
    vendor_cameras: tuple[PushbroomCamera, ...]
    vendor_rpcs: tuple[VendorRPC, ...]
    height_range_m: tuple[float, float]
    ids: np.ndarray
    ground: np.ndarray
    role: np.ndarray
    image_points: TrueImagePoints
    blunder: np.ndarray
    wrong_height: np.ndarray

    @cached_property
    def rpcs(self) -> tuple[VendorRPC, ...]:
        """RPCs fitted to the true cameras, as `vendor_rpcs` were to the vendor's."""
        return tuple(fit_camera(camera, self.height_range_m) for camera in self.cameras)


@dataclass(frozen=True, eq=False)
class BlockSimulation:
    """A block as a user would have it, the scene it shows and the truth; rows of the two point tables agree.

    Parameters
    ----------
    spec : SceneSpec
        What the scene was made from.
    views : tuple of SceneView
        What the images were made from.
    noise : Noise
        What the errors were made from.
    scene : Scene
        The ground.
    block : Block
        What a user would have.
    truth : BlockTruth
        What is exactly so.
    """

    spec: SceneSpec
    views: tuple[SceneView, ...]
    noise: Noise
    scene: Scene
    block: Block
    truth: BlockTruth

    def __repr__(self) -> str:
        return f"<SimulatedBlock: {self.block!r}>"

    @property
    def acquisitions(self) -> tuple[Acquisition, ...]:
        """The dates of the views, in the order of time; none where all were taken on one day."""
        dates = {view.acquisition.number: view.acquisition for view in self.views if view.acquisition is not None}
        return tuple(dates[number] for number in sorted(dates))

    def index(self, image_id: str) -> int:
        """Return the position of an image.

        Parameters
        ----------
        image_id : str
            The image.

        Returns
        -------
        int
            Its row among the images.

        Raises
        ------
        InputError
            The id is not known.
        """
        for position, view in enumerate(self.views):
            if view.id == image_id:
                return position
        raise InputError(f"no image {image_id!r} in the simulated block: {', '.join(v.id for v in self.views)}")


def simulate_block(
    spec: SceneSpec,
    views: Sequence[SceneView],
    points: PointCounts | None = None,
    noise: Noise | None = None,
    progress: Progress = silent,
) -> BlockSimulation:
    """Return a synthetic block; the same arguments give the same block to the last bit.

    Parameters
    ----------
    spec : SceneSpec
        The ground.
    views : sequence of SceneView
        The images.
    points : PointCounts, optional
        How many points there are.
    noise : Noise, optional
        Their errors.
    progress : Progress
        Callback; False cancels.

    Returns
    -------
    BlockSimulation
        The block, its scene and the truth.

    Raises
    ------
    InputError
        The views do not see enough in common.
    Cancelled
        When ``progress`` asks to stop.
    """
    points, noise = points or PointCounts(), noise or Noise()
    scene = make_scene(spec, views)
    cameras = tuple(view.camera(scene.chart, spec.mean_height_m) for view in views)
    vendor_cameras = tuple(
        camera.disturb(
            view.vendor_error or view.sensor.accuracy.draw(np.random.default_rng([spec.seed, 42, index]), noise.vendor)
        )
        for index, (view, camera) in enumerate(zip(views, cameras, strict=True))
    )
    advance(progress, 0.2, "terrain simulated")
    scene = _place_targets(scene, cameras, points)
    ids, ground, role = _place_points(cameras, scene, points)
    is_surveyed = role != Role.TIE
    visible = project_true_points(cameras, scene.terrain, ground)
    image_points = visible.select(np.lexsort((visible.image, visible.point)))  # the order of a block's measurements
    advance(progress, 0.6, "points placed")
    vendor_rpcs = tuple(
        replace(fit, rpc=make_accuracy_statement(fit.rpc, camera, view.sensor.accuracy, noise.vendor))
        for fit, camera, view in zip(
            _fit_cameras(vendor_cameras, scene, stage(progress, 0.6, 1.0)), vendor_cameras, views, strict=True
        )
    )

    surveyed, has_wrong_height = survey_points(
        ids[is_surveyed],
        ground[is_surveyed],
        role[is_surveyed],
        noise,
        1.0 / metres_per_degree(ground[is_surveyed]),
        np.random.default_rng([spec.seed, 40]),
    )
    image_ids = np.array([view.id for view in views])
    measured, blunder = measure_points(
        ids, role, image_ids, image_points, noise, np.random.default_rng([spec.seed, 41])
    )
    images = [Image(view.id, fit.rpc, view.size) for view, fit in zip(views, vendor_rpcs, strict=True)]
    wrong_height = np.zeros(len(ids), dtype=bool)
    wrong_height[is_surveyed] = has_wrong_height
    truth = BlockTruth(
        cameras, vendor_cameras, vendor_rpcs, height_range_m=scene.terrain.height_range, ids=ids, ground=ground,
        role=role, image_points=image_points, blunder=blunder,
        wrong_height=wrong_height,
    )  # fmt: skip
    return BlockSimulation(spec, tuple(views), noise, scene, assemble(images, [surveyed], [measured]), truth)


def _fit_cameras(cameras: Sequence[PushbroomCamera], scene: Scene, progress: Progress) -> tuple[VendorRPC, ...]:
    """Return the RPCs of the vendor's cameras over the scene's heights; the only slow part, so it reports."""
    rpcs = []
    for index, camera in enumerate(cameras):
        rpcs.append(fit_camera(camera, scene.terrain.height_range))
        advance(progress, (index + 1) / len(cameras), "fitting RPCs")
    return tuple(rpcs)


def _place_targets(scene: Scene, cameras: Sequence[PushbroomCamera], points: PointCounts) -> Scene:
    """Return the scene with a target on plane ground for every surveyed point, GCPs first."""
    rng = np.random.default_rng([scene.spec.seed, 43])
    ground = place_control(cameras, scene.terrain, points.gcps + points.checks, rng)
    targets = scene.chart.from_ground(ground)
    terrain = scene.terrain.plane_around(targets, scene.target_radius_m + 1.5 * scene.terrain.post_m)
    bare = terrain if scene.bare is scene.terrain else scene.bare
    return replace(scene, terrain=terrain, targets_m=targets, bare=bare)


def _place_points(
    cameras: Sequence[PushbroomCamera], scene: Scene, points: PointCounts
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ids, positions and roles: check points C…, GCPs G…, tie points T…, sorted by id."""
    targets = scene.chart.to_ground(scene.targets_m, scene.terrain.height(*scene.targets_m.T))
    ties = place_ties(cameras, scene.terrain, points.ties, np.random.default_rng([scene.spec.seed, 44]))
    gcps, checks = targets[: points.gcps], targets[points.gcps :]
    tables = ((checks, "C", Role.CHECK), (gcps, "G", Role.GCP), (ties, "T", Role.TIE))
    ids = [f"{letter}{number + 1:06d}" for table, letter, _ in tables for number in range(len(table))]
    role = np.concatenate([np.full(len(table), role, dtype=np.int8) for table, _, role in tables])
    return np.array(ids, dtype=str), np.concatenate([table for table, _, _ in tables]), role
