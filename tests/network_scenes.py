"""Pairs of windows whose true correspondence is known, and ways to turn and judge real ones.

`grass` and `forest` are homogeneous: nothing stands out in them but the texture itself. The second view sees the
same ground turned, over a mild relief, with another gain and its own noise.
"""

import cmath
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from scipy import fft

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.laboratory.control_network.leaves import Tolerance
from hrsi.hrsi_engine.laboratory.control_network.leaves import rotate_offset as turned_offset
from hrsi.hrsi_engine.laboratory.simulation.texture import PeriodicField
from hrsi.hrsi_engine.measurement.tile_matching.epipolar import compute_epipolar_deviation

RELIEF_PX, RELIEF_WAVE_PX = 5.0, 220.0  # parallax between the views: amplitude, and length of its waves
NOISE = 0.06  # of the texture's standard deviation
FALSE_PX = 1.5
POINTS_PX = 200.0  # side of the square that `point_sets` fills


@dataclass(frozen=True, eq=False)
class TruePair:
    """Two views of a texture; the second one is turned and scaled about its middle."""

    first: ArrayRaster
    second: ArrayRaster
    rotation_rad: float
    scale: float
    relief_px: float

    def carried(self, xy: np.ndarray) -> np.ndarray:
        """Return where points ``(n, 2)`` of the first view truly are in the second."""
        middles = [(np.array(view.size) - 1.0) / 2.0 for view in (self.first, self.second)]
        return (xy + parallax(xy, self.relief_px) - middles[0]) @ self.matrix.T + middles[1]

    @property
    def matrix(self) -> np.ndarray:
        cos, sin = self.scale * np.cos(self.rotation_rad), self.scale * np.sin(self.rotation_rad)
        return np.array([[cos, -sin], [sin, cos]])


def parallax(xy: np.ndarray, relief_px: float) -> np.ndarray:
    """Return what the relief displaces points by, ``(n, 2)``: along a fixed direction, as in two satellite views."""
    x, y = (2.0 * np.pi / RELIEF_WAVE_PX * column for column in (xy[..., 0], xy[..., 1]))
    height = np.sin(x + 0.7 * y) * np.cos(0.6 * y - 0.3 * x)
    return relief_px * height[..., None] * np.array([0.3, 0.954])


def grass(side: int, rng: np.random.Generator) -> np.ndarray:
    """Return blades and tufts without any larger pattern."""
    field = PeriodicField.power_law(side, 1.0, 0.6, rng)
    return cv2.GaussianBlur(fft.irfft2(field.spectrum, s=(side, side)).astype(np.float32), (0, 0), 0.9)


def forest(side: int, rng: np.random.Generator) -> np.ndarray:
    """Return a closed canopy of crowns of about 12 px."""
    field = PeriodicField.tree_crowns(side, 1.0, 12.0, rng)
    return cv2.GaussianBlur(fft.irfft2(field.spectrum, s=(side, side)).astype(np.float32), (0, 0), 0.8)


TEXTURES = {"grass": grass, "forest": forest}


def true_pair(
    texture: str, side: int = 400, rotation_deg: float = 0.0, seed: int = 1, scale: float = 1.0,
    relief_px: float = RELIEF_PX, noise: float = NOISE,
) -> TruePair:  # fmt: skip
    """Return two views of ``side`` x ``side`` pixels."""
    rng = np.random.default_rng(seed)
    margin = int(side * (0.75 / scale - 0.5)) + 32  # the turned view, with the relief
    ground = TEXTURES[texture](fft.next_fast_len(side + 2 * margin, real=True) // 2 * 2, rng)
    ground /= ground.std()
    pair = TruePair(None, None, np.radians(rotation_deg), scale, relief_px)  # type: ignore[arg-type]
    y, x = np.mgrid[:side, :side].astype(np.float64)
    middle = (side - 1.0) / 2.0
    here = (np.stack([x, y], axis=-1) - middle) @ np.linalg.inv(pair.matrix).T + middle
    seen = here.copy()
    for _ in range(12):  # the parallax belongs to the point on the ground
        seen = here - parallax(seen, relief_px)
    views = []
    for places, gain, offset in ((np.stack([x, y], axis=-1), 60.0, 400.0), (seen, 48.0, 350.0)):
        u, v = ((places[..., k] + margin).astype(np.float32) for k in (0, 1))
        grey = cv2.remap(ground, u, v, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_WRAP)
        grey = grey + noise * rng.standard_normal(grey.shape)
        views.append(
            ArrayRaster(np.clip(np.rint(offset + gain * grey), 1, 2047).astype(np.uint16), np.ones((side, side), bool))
        )
    return TruePair(views[0], views[1], pair.rotation_rad, scale, relief_px)


@dataclass(frozen=True, eq=False)
class Turned:
    """A window turned about its middle into a frame that holds all of it; the corners are not valid."""

    window: ArrayRaster
    matrix: np.ndarray
    shift: np.ndarray

    def back(self, xy: np.ndarray) -> np.ndarray:
        """Return where points of the turned window are in the original one."""
        return (xy - self.shift) @ self.matrix  # the inverse of a rotation is its transpose


def turned(window: ArrayRaster, degrees: float) -> Turned:
    """Return a window turned by an angle from sample towards line; by 0 it stays as it is."""
    if degrees == 0.0:
        return Turned(window, np.eye(2), np.zeros(2))
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.array([[cos, -sin], [sin, cos]])
    samples, lines = window.size
    corners = np.array([[0, 0], [samples - 1, 0], [0, lines - 1], [samples - 1, lines - 1]]) @ matrix.T
    low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    frame = tuple(int(length) for length in high - low + 1)
    affine = np.column_stack([matrix, -low])
    grey = cv2.warpAffine(window.grey.astype(np.float32), affine, frame, flags=cv2.INTER_LANCZOS4)
    valid = cv2.warpAffine(window.valid.astype(np.uint8), affine, frame, flags=cv2.INTER_NEAREST)
    valid = cv2.erode(valid, np.ones((9, 9), np.uint8)).astype(bool)  # Lanczos saw nothing else
    grey = np.where(valid, np.clip(np.rint(grey), 1, 65535), 0).astype(np.uint16)
    return Turned(ArrayRaster(grey, valid), matrix, -low)


def across_epipolar(
    first: RPC, second: RPC, first_xy: np.ndarray, second_xy: np.ndarray, height_m: float
) -> np.ndarray:
    """Return distances ``(n,)`` px across the RPCs' epipolar lines, without the pair's constant bias."""
    across = compute_epipolar_deviation(first, second, first_xy, second_xy, height_m).across_px
    return across - np.median(across)


def by_trying_everything(
    first: np.ndarray, second: np.ndarray, allowed: Tolerance, reach_px: float, scales: tuple[float, ...]
) -> tuple[int, float, frozenset]:
    """Return correspondences and cost of the best of all roots and starting points, with plain loops."""
    a, b = ([complex(*point) for point in points] for points in (first, second))
    best = (0, 0.0, frozenset())
    for scale, i, j in product(scales, range(len(a)), range(len(b))):
        near = {k: cmath.polar(point - a[i]) for k, point in enumerate(a) if k != i and abs(point - a[i]) <= reach_px}
        far = {k: cmath.polar((point - b[j]) / scale) for k, point in enumerate(b) if k != j}
        limit = {k: allowed.base_px + allowed.gradient * distance for k, (distance, _) in near.items()}
        alike = [(k, n) for k, n in product(near, far) if abs(near[k][0] - far[n][0]) <= limit[k]]
        for start, other in alike:
            turn = far[other][1] - near[start][1]
            cost = {}
            for k, n in alike:
                angle = abs(cmath.phase(cmath.exp(1j * (far[n][1] - near[k][1] - turn)))) * near[k][0] / limit[k]
                if angle <= 1.0:
                    cost[k, n] = ((far[n][0] - near[k][0]) / limit[k]) ** 2 + angle**2
            chosen = {
                pair
                for pair, value in cost.items()
                if all(value <= v for (k, n), v in cost.items() if k == pair[0] or n == pair[1])
            }
            total = sum(cost[pair] for pair in chosen)
            if (-len(chosen) - 1, total) < (-best[0], best[1]):
                best = (len(chosen) + 1, total, frozenset(chosen | {(i, j)}))
    return best


def point_sets(
    seed: int, common: int, outliers: int, noise_px: float = 0.3, scale: float = 1.0
) -> tuple[np.ndarray, np.ndarray, set]:
    """Return two sets with so many points in common, the second one turned, scaled, shuffled, with its own outliers."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(0.0, POINTS_PX, (common + outliers, 2))
    second = turned_offset(first + rng.normal(0.0, noise_px, first.shape), rng.uniform(-np.pi, np.pi), scale)
    second[common:] = rng.uniform(second.min(axis=0), second.max(axis=0), (outliers, 2))
    order = rng.permutation(len(second))
    return first, second[order] + (31.0, -12.0), {(int(k), int(np.flatnonzero(order == k)[0])) for k in range(common)}
