"""Physical models of pushbroom sensors: a line of detectors, with orbit and attitude as functions of time.

The ray of pixel (sample, line) starts at the sensor position at the time of the line, in the look direction of the
detector rotated by the attitude. If the attitude is that of the spacecraft, two corrections are needed: the aberration
of light, which tilts the apparent direction towards the velocity by v/c (about 15 m on the ground), and refraction,
which moves the ground point towards the nadir by ``N H tan(z) / cos(z)^2`` for a refractivity N that decreases
exponentially with the scale height H (1 m at 25 degrees). With both, WorldView-1's ephemeris and attitude agree with
the vendor's RPC to 0.1 px. References: NGA.SIG.0003, "Light-time and aberration"; Noerdlinger 1999, "Atmospheric
refraction effects in Earth remote sensing".

An RPC with the rigid-body adjustment (rotation and translation) of the Ames Stereo Pipeline.

A geocentric point P of a ray becomes ``R (P - C) + C + T`` (VisionWorkbench, ``AdjustedCameraModel``). Since an RPC has
no camera centre C, ASP uses the point 100 km up the ray of pixel (0, 0), along its chord between two heights around
HEIGHT_OFF (``RPCModel::point_and_dir``). Versions that used 10 km rotate about another point: a rotation of 1e-5
then differs by 0.9 m.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..foundation.thresholds import GRIDS, threshold, thresholds
from ..ground.geodesy import east_north_up, from_ecef, intersect_height, to_ecef
from .rpc import RPC

SPEED_OF_LIGHT = 299_792_458.0


@thresholds
class LINESCAN:
    """Atmospheric refraction."""

    refractivity: float = threshold(2.77e-4, "", "refractivity of air at sea level", "standard atmosphere, 0.6 um")
    scale_height_m: float = threshold(8000.0, "m", "scale height of the air's density", "standard atmosphere")


class SampledCamera:
    """Base class of cameras to which an RPC is fitted, with the image ``size``, and scene heights if they are known."""

    size: tuple[int, int]
    heights_m: tuple[float, float] | None

    def localize(self, image: np.ndarray, height_m: float) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` on the rays of samples and lines ``(n, 2)``, near a height."""
        raise NotImplementedError

    def sample_correspondences(self, low_m: float, high_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Return ground points ``(n, 3)`` and their pixels ``(n, 2)`` on a grid over the image and the height range."""
        axes = [np.linspace(0.0, count - 1.0, GRIDS.nodes) for count in self.size]
        image = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        heights = np.linspace(low_m, high_m, GRIDS.coarse).tolist()
        return np.concatenate([self.localize(image, height) for height in heights]), np.tile(image, (len(heights), 1))


@dataclass(frozen=True, eq=False)
class LinescanCamera(SampledCamera):
    """A pushbroom camera; times in seconds of any epoch, vectors geocentric.

    source : name of the file or camera
    size : samples and lines
    line_times (k, 2) : lines, from the centre of the first one, and their times; extrapolated linearly
    position, velocity : m and m/s ``(n, 3)`` at times ``(n,)``
    attitude : rotation ``(n, 3, 3)`` from the camera's frame at times ``(n,)``
    look : directions ``(n, 3)`` in the camera's frame of samples ``(n,)``
    through_air : whether aberration of light and refraction are to be applied
    heights_m : lowest and highest ellipsoidal height of the scene, None if unknown
    """

    source: str
    size: tuple[int, int]
    line_times: np.ndarray
    position: Callable[[np.ndarray], np.ndarray]
    velocity: Callable[[np.ndarray], np.ndarray]
    attitude: Callable[[np.ndarray], np.ndarray]
    look: Callable[[np.ndarray], np.ndarray]
    through_air: bool
    heights_m: tuple[float, float] | None = None

    def localize(self, image: np.ndarray, height_m: float) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` where the rays of samples and lines ``(n, 2)`` reach a height."""
        lines, times = self.line_times.T
        rate = (times[-1] - times[0]) / (lines[-1] - lines[0])
        time = np.interp(image[:, 1], lines, times)
        time += rate * (np.minimum(image[:, 1] - lines[0], 0.0) + np.maximum(image[:, 1] - lines[-1], 0.0))
        start, velocity = self.position(time), self.velocity(time)
        ray = np.einsum("nij,nj->ni", self.attitude(time), self.look(image[:, 0]))
        # towards the Earth: look vectors of CSM have the opposite direction
        ray *= (-np.sign((ray * start).sum(axis=1)) / np.linalg.norm(ray, axis=1))[:, None]
        if self.through_air:
            ray -= velocity / SPEED_OF_LIGHT
            ray /= np.linalg.norm(ray, axis=1)[:, None]
        ground = intersect_height(start, ray, height_m)
        if self.through_air:
            up = east_north_up(ground[:, 0], ground[:, 1])[:, 2]
            cosine = -(ray * up).sum(axis=1)
            horizontal = ray + cosine[:, None] * up  # of length sin(z), away from the nadir
            air = LINESCAN.refractivity * LINESCAN.scale_height_m * np.exp(-height_m / LINESCAN.scale_height_m)
            ground = from_ecef(to_ecef(ground) - (air / cosine**3)[:, None] * horizontal)
        ground[:, 2] = height_m
        return ground

    def compare_rpc(self, rpc: RPC, low_m: float, high_m: float) -> dict[str, float]:
        """Return the differences of an RPC from this camera (px), between two heights: means, RMS and the largest."""
        ground, image = self.sample_correspondences(low_m, high_m)
        difference = rpc.project(ground) - image
        distance = np.hypot(*difference.T)
        mean = difference.mean(axis=0).tolist()
        rms, largest = float(np.sqrt(np.mean(distance**2))), float(distance.max())
        return {"mean_sample_px": mean[0], "mean_line_px": mean[1], "rms_px": rms, "max_px": largest}


CENTRE_UP_M = 100_000.0
CHORD_SHARE, CHORD_M = 0.9, (0.1, 50.0)  # half height of the chord relative to HEIGHT_SCALE, and its limits in m


@dataclass(frozen=True, eq=False)
class AdjustedRpc(SampledCamera):
    """An RPC with R ``rotation (3, 3)`` and T ``translation (3,)`` (m).

    notice : a warning if it is not known that the RPC was adjusted, else ""
    size : samples and lines; a pixel position in the RPC is ``scale`` times that in the image, plus ``offset (2,)``
    """

    rpc: RPC
    size: tuple[int, int]
    rotation: np.ndarray
    translation: np.ndarray
    offset: np.ndarray
    scale: float
    heights_m: tuple[float, float]
    notice: str = ""

    def localize(self, image: np.ndarray, height_m: float) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` of image points at ``height_m`` of the RPC, moved by the adjustment."""
        half = float(np.clip(CHORD_SHARE * abs(self.rpc.height_scale), *CHORD_M))
        up, down = to_ecef(self.rpc.localize(np.zeros((2, 2)), self.rpc.height_off + np.array([half, -half])).ground)
        centre = up + CENTRE_UP_M * (up - down) / np.linalg.norm(up - down)
        ground = self.rpc.localize(self.scale * image + self.offset, height_m).ground
        return from_ecef((to_ecef(ground) - centre) @ self.rotation.T + centre + self.translation)
