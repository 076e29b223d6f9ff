"""Small blocks with known truth, for tests: cameras that no code of the engine made, points, measurements."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints, Role
from hrsi.hrsi_engine.block.default_sigmas import DefaultSigmas
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground

LON, LAT, HEIGHT = 147.3, -42.85, 200.0


def oblique_rpc(
    tilt_east: float, tilt_north: float, gsd_m: float = 1.0, half_px: float = 2000.0, heading: float = 0.1
) -> RPC:
    """Return a parallel-ray camera: a point ``h`` metres up moves by ``h * tilt`` metres on the ground.

    A touch of perspective in the denominators and of curvature in the numerators makes the derivatives non-trivial.
    """
    metres_lon = 111_319.5 * np.cos(np.radians(LAT))
    metres_lat = 111_120.0
    scale_m, height_scale = half_px * gsd_m, 500.0
    cosine, sine = np.cos(heading), np.sin(heading)
    samp, line = np.zeros(20), np.zeros(20)
    samp[1], samp[2] = cosine, sine
    line[1], line[2] = sine, -cosine
    samp[3] = (cosine * tilt_east + sine * tilt_north) * height_scale / scale_m
    line[3] = (sine * tilt_east - cosine * tilt_north) * height_scale / scale_m
    samp[7], line[8], samp[4] = 2e-4, -1e-4, 1e-4
    denominator = np.zeros(20)
    denominator[0], denominator[1], denominator[3] = 1.0, 1e-4, -5e-4
    line_denominator = denominator.copy()
    line_denominator[2] = 2e-4
    return RPC(
        half_px, half_px, LAT, LON, HEIGHT, half_px, half_px, scale_m / metres_lat, scale_m / metres_lon, height_scale,
        line, line_denominator, samp, denominator,
    )  # fmt: skip


VIEWS = ((0.35, 0.05), (-0.30, 0.10), (0.05, -0.40), (0.0, 0.3))


def images(count: int = 3) -> list[Image]:
    """Return ``count`` images with different views."""
    return [Image(f"image{k}", oblique_rpc(*VIEWS[k], heading=0.1 * k), (4001, 4001)) for k in range(count)]


def ground(count: int, seed: int) -> np.ndarray:
    """Return points spread over the images' common area, heights of hilly terrain."""
    rng = np.random.default_rng(seed)
    metres = np.column_stack([rng.uniform(-1500, 1500, (count, 2)), rng.uniform(-100, 200, count)])
    return move_ground(np.tile([LON, LAT, HEIGHT], (count, 1)), metres)


def block(
    gcps: int = 10,
    checks: int = 10,
    ties: int = 30,
    *,
    count: int = 3,
    seed: int = 1,
    bias_px: float = 10.0,
    drift: float = 1e-4,
    noise_px: float = 0.3,
    noise_m: float = 0.1,
) -> tuple[Block, np.ndarray, list[np.ndarray]]:
    """Return a block, the true ground points (in the block's order) and each image's true affine error ``(2, 3)``.

    Measurements are RPC + error + noise; the affine error is [constant, per px of sample, per px of line], counted
    from the image's centre.
    """
    rng = np.random.default_rng(seed)
    cameras = images(count)
    total = gcps + checks + ties
    truth = ground(total, seed + 1000)
    ids = [f"P{k:04d}" for k in range(total)]
    role = np.repeat([Role.GCP, Role.CHECK, Role.TIE], [gcps, checks, ties])
    errors, rows = [], []
    for image in cameras:
        error = np.column_stack([rng.normal(0, bias_px, 2), rng.normal(0, drift, (2, 2))])
        errors.append(error)
        exact = image.rpc.project(truth)
        measured = (
            exact + error[:, 0] + (exact - image.centre_px) @ error[:, 1:].T + rng.normal(0, noise_px, exact.shape)
        )
        rows.append(ImagePoints(ids, [image.id] * total, measured, noise_px))
    surveyed = move_ground(truth, rng.normal(0, noise_m, truth.shape))
    known = role != Role.TIE
    table = GroundPoints(np.array(ids)[known], surveyed[known], role[known], noise_m)
    made = assemble(cameras, [table], rows, defaults=DefaultSigmas(noise_px, noise_m, noise_m))
    return made, truth, errors


def move_measurements(block: Block, rows: np.ndarray | int, px: np.ndarray | Sequence[float]) -> Block:
    """Return the block with some rows of its measurements moved by pixels ``(2,)`` or ``(n, 2)``."""
    xy = block.measurements.xy.copy()
    xy[rows] += px
    return replace(block, measurements=replace(block.measurements, xy=xy))


def move_surveys(block: Block, points: np.ndarray | int, metres: np.ndarray | Sequence[float]) -> Block:
    """Return the block with the surveyed positions of some points moved by metres east, north, up, ``(3,)`` each."""
    step = np.zeros((len(block.points), 3))
    step[points] = metres
    return replace(block, points=replace(block.points, ground=move_ground(block.points.ground, step)))


def check_rmse_m(truth: np.ndarray, result: Adjustment) -> np.ndarray:
    """Return the true errors of adjusted check points, RMSE east, north, up."""
    check = result.block.points.role == Role.CHECK
    return np.sqrt(np.mean(ground_difference_m(truth[check], result.ground[check]) ** 2, axis=0))
