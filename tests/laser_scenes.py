"""Blocks without GCPs with laser points over them; image points are simulated directly, no pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, GroundPoints, ImagePoints, Role
from hrsi.hrsi_engine.block.laser import LaserPoints
from hrsi.hrsi_engine.block.orthoimage import ReferencePlaces
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, metres_per_degree
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.laboratory.simulation.control import measure_points, project_true_points
from hrsi.hrsi_engine.laboratory.simulation.free_ortho import ORTHO_ERROR, draw_ortho_errors
from hrsi.hrsi_engine.laboratory.simulation.laser import LaserSimulation, simulate_laser
from hrsi.hrsi_engine.laboratory.simulation.options import FreeOrthoSpec, LaserSpec
from hrsi.hrsi_engine.laboratory.simulation.synthesis import BlockSimulation
from hrsi.hrsi_engine.plausibility.laser_quality import find_laser_reasons

LOOKED_UP, TIES_EACH, AROUND_M = 400, 3, 10.0


@dataclass(frozen=True, eq=False)
class LaserScene:
    """A simulated block, its laser points with the reasons of those left out, and the block with ties around them."""

    simulated: BlockSimulation
    laser: LaserSimulation
    points: LaserPoints
    block: Block

    def height_errors_m(self, result: Adjustment) -> np.ndarray:
        """Return computed - true of the check points, east, north, height ``(k, 3)``."""
        checks = result.block.points.role == Role.CHECK
        return ground_difference_m(result.ground[checks], result.block.points.ground[checks])


def laser_scene(
    seed: int, spec: LaserSpec | None = None, *, sensor: str = "pleiades", images: int = 2, size: int = 10_000,
    image_px: float = 0.3, relief_m: float = 150.0, looked_up: int = LOOKED_UP, checks: int = 100,
) -> LaserScene:  # fmt: skip
    """Return a block with check points, whose laser points have tie points around them, as matching would find them."""
    views = lab.make_along_track_views(lab.SENSORS[sensor], images, (size, size))
    noise = lab.Noise(image_px=image_px, gcp_xy_m=0.01, gcp_h_m=0.01)
    scene = lab.SceneSpec(seed=seed, post_m=8.0, relief_m=relief_m)
    simulated = lab.simulate_block(scene, views, lab.PointCounts(0, checks, 200), noise)
    terrain, rng = simulated.scene.terrain, np.random.default_rng([seed, 51])
    half_m = 0.5 * size * views[0].sensor.gsd_m
    laser = simulate_laser(terrain, half_m, spec or LaserSpec(3), [seed, 50])
    points = replace(laser.points, doubt=find_laser_reasons(laser.points))
    chosen = rng.permutation(np.flatnonzero(points.doubt == ""))[:looked_up]
    chart = terrain.chart.from_ground(points.ground[chosen])
    near = (chart[:, None] + rng.uniform(-AROUND_M, AROUND_M, (len(chosen), TIES_EACH, 2))).reshape(-1, 2)
    ground = terrain.chart.to_ground(near, terrain.height(*near.T))
    ids = np.array([f"F{number:06d}" for number in range(len(ground))])
    role = np.full(len(ground), int(Role.TIE))
    image_ids = np.array([view.id for view in views])
    more, _ = measure_points(
        ids, role, image_ids, project_true_points(simulated.truth.cameras, terrain, ground), noise, rng
    )
    block = simulated.block
    rows = block.measurements
    given = ImagePoints(block.points.ids[rows.point], image_ids[rows.image], rows.xy, rows.sigma_px, rows.kind)
    known = block.points.select(block.points.role == Role.CHECK)
    return LaserScene(simulated, laser, points, assemble(list(block.images), [known], [given, more]))


@dataclass(frozen=True, eq=False)
class PlacedScene:
    """A block with laser points and places of a free orthoimage, as GCPs with the errors of the orthoimage."""

    laser: LaserScene
    block: Block
    places: ReferencePlaces
    chart_m: np.ndarray

    def with_corner(self, off_m: float) -> PlacedScene:
        """Return the scene with the north-eastern corner of the orthoimage so far off in the east."""
        half_m = np.abs(self.chart_m).max()
        corner = (self.chart_m > ORTHO_ERROR.corner_from * half_m).all(axis=1)
        ground = self.places.ground.copy()
        ground[corner, 0] += off_m / metres_per_degree(ground[corner])[:, 0]
        return replace(self, places=replace(self.places, ground=ground))


def placed_scene(
    seed: int, spec: LaserSpec | None = None, ortho: FreeOrthoSpec | None = None, *, places: int = 300,
    match_m: float = 1.0, images_agree_px: float = 0.3, **more: Any,
) -> PlacedScene:  # fmt: skip
    """Return a `laser_scene` with places of an orthoimage of 10 m, matched to a tenth of a pixel."""
    made = laser_scene(seed, spec, **more)
    ortho = ortho or FreeOrthoSpec(10.0)
    truth, rng = made.simulated.truth, np.random.default_rng([seed, 52])
    terrain, views = made.simulated.scene.terrain, made.simulated.views
    half_m = 0.5 * min(view.size[0] * view.sensor.gsd_m for view in views)
    chart = rng.uniform(-half_m, half_m, (places, 2))
    errors = draw_ortho_errors(half_m, ortho, [seed, 61])
    stated = chart + errors.errors_at(*chart.T).T + rng.normal(0.0, match_m, chart.shape)
    true = terrain.chart.to_ground(chart, terrain.height(*chart.T))
    ground = terrain.chart.to_ground(stated, true[:, 2])
    ids = np.array([f"REF{number:03d}" for number in range(places)])
    image_ids = np.array([view.id for view in views])
    measured, _ = measure_points(
        ids, np.full(places, int(Role.GCP)), image_ids, project_true_points(truth.cameras, terrain, true),
        lab.Noise(image_px=images_agree_px), rng,
    )  # fmt: skip
    sigma_m = ortho.error_m / np.sqrt(2.0)
    seen = np.isin(ids, measured.ids)
    known = GroundPoints(ids[seen], ground[seen], Role.GCP, np.tile([sigma_m, 50.0], (int(seen.sum()), 1)), "reference")
    block = made.block
    rows = block.measurements
    given = ImagePoints(block.points.ids[rows.point], image_ids[rows.image], rows.xy, rows.sigma_px, rows.kind)
    checks = block.points.select(block.points.role == Role.CHECK)
    whole = assemble(list(block.images), [checks, known], [given, measured])
    return PlacedScene(made, whole, ReferencePlaces(ids[seen], ground[seen], sigma_m), chart[seen])
