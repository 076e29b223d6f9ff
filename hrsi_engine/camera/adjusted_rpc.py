"""An RPC with the rigid-body adjustment (rotation and translation) of the Ames Stereo Pipeline.

A geocentric point P of a ray becomes ``R (P - C) + C + T`` (VisionWorkbench, ``AdjustedCameraModel``). Since an RPC has
no camera centre C, ASP uses the point 100 km up the ray of pixel (0, 0), along its chord between two heights around
HEIGHT_OFF (``RPCModel::point_and_dir``). Versions that used 10 km rotate about another point: a rotation of 1e-5
then differs by 0.9 m.
"""

from dataclasses import dataclass

import numpy as np

from ..ground.geodesy import from_ecef, to_ecef
from .linescan import SampledCamera
from .rpc import RPC

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
        chord = self.rpc.localize(np.zeros((2, 2)), self.rpc.height_off + np.array([half, -half])).ground
        up, down = to_ecef(chord)
        centre = up + CENTRE_UP_M * (up - down) / np.linalg.norm(up - down)
        ground = self.rpc.localize(self.scale * image + self.offset, height_m).ground
        return from_ecef((to_ecef(ground) - centre) @ self.rotation.T + centre + self.translation)
