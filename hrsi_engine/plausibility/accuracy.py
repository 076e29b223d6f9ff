"""What a right block shows: how far an RPC may be off, and how much of that is alike for all points of an image.

An RPC is wrong by metres to hundreds of metres, which is what this program is for: that is a shift of the whole image
with little drift. What an RPC's error cannot be is a misfit that changes from point to point, or a shift beyond
anything that its sensor does. ERR_BIAS says how large the shift usually is; where a product gives none, the ground
sample distance tells the class of the sensor:

    GSD below 1 m   5 to 25 m (CE90) for IKONOS, QuickBird, GeoEye, WorldView, Pleiades, KOMPSAT
    GSD 1.5 to 4 m  30 to 250 m for SPOT 5-7, ALOS, ZY-3, GF-1, Cartosat-1
    GSD 10 to 20 m  100 to 500 m for SPOT 1-4 and wide-field cameras

A standard deviation of 12 pixels and at least 15 m describes them all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..block.block import Image
from ..block.pointing import compute_gsds_m

UNKNOWN_SIGMA_PX, UNKNOWN_SIGMA_M = 12.0, 15.0  # of a shift, where the product says nothing
LEAST_SIGMA_PX, LEAST_SIGMA_M = 3.0, 2.0  # statements below are not believed
LARGE_SIGMAS = 10.0  # a shift worth a look
IMPOSSIBLE_SIGMAS, IMPOSSIBLE_M = 15.0, 500.0  # a shift that no RPC's error is: beyond both
MISFIT_PX = 15.0  # of points of one image among each other, beyond the worst measuring and drift
USUAL_DRIFT, MOST_DRIFT = 3e-4, 1e-3  # px/px: standard deviation of an RPC's error over its image, and the worst


@dataclass(frozen=True)
class ImageAccuracy:
    """What can be expected of an image.

    gsd_m : length of a pixel on the ground; sigma_m : standard deviation of each axis of its RPC's shift
    large_m, far_m : shifts that are worth a look, and that no RPC's error is
    misfit_m : what points of one image may differ from each other; drift : standard deviation, px/px
    """

    gsd_m: float
    sigma_m: float
    large_m: float
    far_m: float
    misfit_m: float
    drift: float


def estimate_accuracies(
    images: Sequence[Image], sigma_shift_px: float = 0.0, sigma_drift: float = 0.0
) -> list[ImageAccuracy]:
    """Return what can be expected of images, by RPCs' ERR_BIAS or their resolution, or what the user expects."""
    return [
        _accuracy(image, gsd, sigma_shift_px, sigma_drift)
        for image, gsd in zip(images, compute_gsds_m(images).tolist(), strict=True)
    ]


def _accuracy(image: Image, gsd: float, sigma_shift_px: float, sigma_drift: float) -> ImageAccuracy:
    stated = image.rpc.err_bias
    if stated and stated > 0.0 and np.isfinite(stated):
        sigma = max(float(stated), LEAST_SIGMA_M, LEAST_SIGMA_PX * gsd)
    else:
        sigma = max(UNKNOWN_SIGMA_M, UNKNOWN_SIGMA_PX * gsd)
    sigma = max(sigma, sigma_shift_px * gsd)
    drift = max(MOST_DRIFT, LARGE_SIGMAS * sigma_drift)
    return ImageAccuracy(
        gsd, sigma, LARGE_SIGMAS * sigma, max(IMPOSSIBLE_SIGMAS * sigma, IMPOSSIBLE_M),
        gsd * max(MISFIT_PX, drift * float(np.hypot(*image.half_size_px))), max(USUAL_DRIFT, sigma_drift),
    )  # fmt: skip
