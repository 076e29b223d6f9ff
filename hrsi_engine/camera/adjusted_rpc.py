"""An RPC that the Ames Stereo Pipeline has moved and turned as a whole.

A geocentric point P of a ray becomes ``R (P - C) + C + T`` (VisionWorkbench, ``AdjustedCameraModel``). For the camera's
centre C, which an RPC has not, ASP takes the point 100 km up the ray of pixel (0, 0), along its chord between two
heights around HEIGHT_OFF (``RPCModel::point_and_dir``). Versions that went up by 10 km turn about another point: 1e-5
are 0.9 m there.
"""

from dataclasses import dataclass

import numpy as np

from ..ground.geodesy import from_ecef, to_ecef
from .linescan import SampledCamera
from .rpc import RPC

CENTRE_UP_M = 100_000.0
CHORD_SHARE, CHORD_M = 0.9, (0.1, 50.0)  # half of the chord's height: of HEIGHT_SCALE, and its limits


@dataclass(frozen=True, eq=False)
class AdjustedRpc(SampledCamera):
    """An RPC with R ``rotation (3, 3)`` and T ``translation (3,)`` (m).

    size : samples and lines; the RPC's pixel is ``scale`` times that of the image, plus ``offset (2,)``
    """

    rpc: RPC
    size: tuple[int, int]
    rotation: np.ndarray
    translation: np.ndarray
    offset: np.ndarray
    scale: float
    heights_m: tuple[float, float]

    def localize(self, image: np.ndarray, height_m: float) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` on the moved rays of samples, lines; they had ``height_m`` before."""
        half = float(np.clip(CHORD_SHARE * abs(self.rpc.height_scale), *CHORD_M))
        chord = self.rpc.localize(np.zeros((2, 2)), self.rpc.height_off + np.array([half, -half])).ground
        up, down = to_ecef(chord)
        centre = up + CENTRE_UP_M * (up - down) / np.linalg.norm(up - down)
        ground = self.rpc.localize(self.scale * image + self.offset, height_m).ground
        return from_ecef((to_ecef(ground) - centre) @ self.rotation.T + centre + self.translation)
