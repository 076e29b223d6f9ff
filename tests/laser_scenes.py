"""Blocks without GCPs with laser points over them; image points are simulated directly, no pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.block.block import Block, ImagePoints, Role, assemble
from hrsi.hrsi_engine.block.laser import LaserPoints
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.plausibility.laser_quality import laser_reasons
from hrsi.hrsi_engine.simulation import SENSORS, Noise, PointCounts, SceneSpec, along_track_views, simulate_block
from hrsi.hrsi_engine.simulation.control import measure, observe
from hrsi.hrsi_engine.simulation.laser import SimulatedLaser, simulate_laser
from hrsi.hrsi_engine.simulation.options import LaserSpec
from hrsi.hrsi_engine.simulation.synthesis import SimulatedBlock

LOOKED_UP, TIES_EACH, AROUND_M = 400, 3, 10.0


@dataclass(frozen=True, eq=False)
class LaserScene:
    """A simulated block, its laser points with the reasons of those left out, and the block with ties around them."""

    simulated: SimulatedBlock
    laser: SimulatedLaser
    points: LaserPoints
    block: Block

    def height_errors_m(self, result: Adjustment) -> np.ndarray:
        """Return computed - true of the check points, east, north, height ``(k, 3)``."""
        checks = self.block.points.role == Role.CHECK
        return ground_difference_m(result.ground[checks], self.block.points.ground[checks])


def laser_scene(
    seed: int, spec: LaserSpec | None = None, *, sensor: str = "pleiades", images: int = 2, size: int = 10_000,
    image_px: float = 0.3, relief_m: float = 150.0, looked_up: int = LOOKED_UP, checks: int = 100,
) -> LaserScene:  # fmt: skip
    """Return a block with check points, whose laser points have tie points around them, as matching would find them."""
    views = along_track_views(SENSORS[sensor], images, (size, size))
    noise = Noise(image_px=image_px, gcp_xy_m=0.01, gcp_h_m=0.01)
    scene = SceneSpec(seed=seed, post_m=8.0, relief_m=relief_m)
    simulated = simulate_block(scene, views, PointCounts(0, checks, 200), noise)
    terrain, rng = simulated.scene.terrain, np.random.default_rng([seed, 51])
    half_m = 0.5 * size * views[0].sensor.gsd_m
    laser = simulate_laser(terrain, half_m, spec or LaserSpec(3), [seed, 50])
    points = replace(laser.points, doubt=laser_reasons(laser.points))
    chosen = rng.permutation(np.flatnonzero(points.doubt == ""))[:looked_up]
    chart = terrain.chart.from_ground(points.ground[chosen])
    near = (chart[:, None] + rng.uniform(-AROUND_M, AROUND_M, (len(chosen), TIES_EACH, 2))).reshape(-1, 2)
    ground = terrain.chart.to_ground(near, terrain.height(*near.T))
    ids = np.array([f"F{number:06d}" for number in range(len(ground))])
    role = np.full(len(ground), int(Role.TIE))
    image_ids = np.array([view.id for view in views])
    more, _ = measure(ids, role, image_ids, observe(simulated.truth.cameras, terrain, ground), noise, rng)
    block = simulated.block
    rows = block.measurements
    given = ImagePoints.create(block.points.ids[rows.point], image_ids[rows.image], rows.xy, rows.sigma_px, rows.kind)
    known = block.points.select(block.points.role == Role.CHECK)
    return LaserScene(simulated, laser, points, assemble(list(block.images), [known], [given, more]))
