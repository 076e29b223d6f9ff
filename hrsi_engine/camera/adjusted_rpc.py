"""An RPC that the Ames Stereo Pipeline has moved and turned as a whole.

bundle_adjust corrects a camera that it cannot change by a rigid motion: a geocentric point P of one of its rays becomes
``R (P - C) + C + T`` (VisionWorkbench, ``AdjustedCameraModel``). C is the camera's centre, which an RPC has not: the
Ames Stereo Pipeline takes the point ``CENTRE_UP_M`` above the terrain on the chord of the ray of pixel (0, 0) between
two heights around HEIGHT_OFF (StereoPipeline, ``RPCModel::point_and_dir``). A turn of 1e-5 about a point 90 km lower is
a shift of 0.9 m, so adjustments of the versions that went up by 10 km only are not these.
"""

from dataclasses import dataclass

import numpy as np

from ..ground.geodesy import from_ecef, to_ecef
from .linescan import sample_rays
from .rpc import RPC

CENTRE_UP_M = 100_000.0
CHORD_SHARE, CHORD_M = 0.9, (0.1, 50.0)  # half of the chord's height: of HEIGHT_SCALE, and its limits


@dataclass(frozen=True, eq=False)
class AdjustedRpc:
    """An RPC and a rigid motion of its rays.

    source : what it was read from
    size : samples and lines
    rotation (3, 3), translation (3,) : R and T (m), geocentric
    offset (2,), scale : the RPC's pixel is ``scale`` times that of the image, plus ``offset``
    """

    source: str
    rpc: RPC
    size: tuple[int, int]
    rotation: np.ndarray
    translation: np.ndarray
    offset: np.ndarray
    scale: float

    @property
    def heights_m(self) -> tuple[float, float]:
        """Lowest and highest height for which the RPC was made."""
        return self.rpc.height_off - abs(self.rpc.height_scale), self.rpc.height_off + abs(self.rpc.height_scale)

    def centre(self) -> np.ndarray:
        """Return C (3,), geocentric."""
        half = float(np.clip(CHORD_SHARE * abs(self.rpc.height_scale), *CHORD_M))
        heights = self.rpc.height_off + np.array([half, -half])
        up, down = to_ecef(self.rpc.localize(np.zeros((2, 2)), heights).ground)
        return np.asarray(up + CENTRE_UP_M * (up - down) / np.linalg.norm(up - down))

    def localize(self, image: np.ndarray, height_m: float) -> np.ndarray:
        """Return points ``(n, 3)`` lon, lat, height on the moved rays of samples and lines ``(n, 2)``.

        Their heights are ``height_m`` before the motion.
        """
        ground = self.rpc.localize(self.scale * image + self.offset, height_m).ground
        centre = self.centre()
        return from_ecef((to_ecef(ground) - centre) @ self.rotation.T + centre + self.translation)

    def sample_correspondences(self, low_m: float, high_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Return ground points ``(n, 3)`` and their pixels ``(n, 2)`` on a grid over the image and between heights."""
        return sample_rays(self.localize, self.size, low_m, high_m)
