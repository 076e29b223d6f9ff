"""Ground area of an image, and coordinates normalised to it: for models whose argument is the ground position."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..block.block import Image, stack_rpcs
from ..foundation.errors import SolveError
from ..ground.geodesy import ground_difference_m, metres_per_degree, wrap_degrees


@dataclass(frozen=True, eq=False)
class GroundArea:
    """Ground area of an image: middle ``(3,)`` lon, lat, height; half extents ``(3,)`` in degrees, degrees, metres.

    Both horizontal extents are equal in metres, so that the coordinates do not depend on the orientation of the image.
    """

    middle: np.ndarray
    reach: np.ndarray

    @property
    def reach_m(self) -> float:
        """Half extent of the area in metres."""
        return float(self.reach[1] * metres_per_degree(self.middle[None])[0, 1])

    def normalise(self, ground: np.ndarray) -> np.ndarray:
        """Return lon, lat, height relative to the middle in units of the half extents, ``(n, 3)``."""
        difference = ground - self.middle
        difference[:, 0] = wrap_degrees(difference[:, 0])
        return np.asarray(difference / self.reach)


def compute_ground_area(image: Image) -> GroundArea:
    """Return the ground area of an image at the reference height (offset) of its RPC.

    Raises `SolveError` if the RPC has no ground position for the image.
    """
    corners = image.camera_centre_px + image.camera_half_size_px * [[0, 0], [-1, -1], [1, -1], [-1, 1], [1, 1]]
    ground = image.rpc.localize(corners, image.rpc.height_off).ground
    if not np.isfinite(ground).all():
        raise SolveError(f"{image.id}: the RPC has no ground positions for the image: check that both belong together")
    metres = metres_per_degree(ground[:1])[0]
    half = np.sqrt(np.mean(np.sum(ground_difference_m(ground[1:], ground[:1])[:, :2] ** 2, axis=1)) / 2.0)
    return GroundArea(ground[0], np.array([half / metres[0], half / metres[1], abs(image.rpc.height_scale)]))


def compute_px_per_m(images: Sequence[Image]) -> np.ndarray:
    """Return the pixels per metre on the ground at the centre of each image, ``(images,)``."""
    stack, index = stack_rpcs(images), np.arange(len(images))
    centres = np.array([image.camera_centre_px for image in images])
    return stack.px_per_m(index, stack.localize(index, centres, stack.middles()[:, 2]))
