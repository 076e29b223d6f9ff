"""Fit of a new RPC to a corrected camera, where no exact change of the coefficients exists."""

from collections.abc import Callable

import numpy as np

from ..block.block import Image
from ..camera.rpc_fit import make_image_grid, refit_rpc
from ..foundation.thresholds import threshold, thresholds
from .model import RefitRPC

Project = Callable[[np.ndarray], np.ndarray]


@thresholds
class REFIT:
    """How the area of a refit is found."""

    passes: int = threshold(6, "", "iterations for the corrected image area")
    settled_px: float = threshold(0.1, "px", "movement of the area at which they end")


def refit_camera(image: Image, project: Project) -> RefitRPC:
    """Return the RPC fitted to ``project`` (ground ``(n, 3)`` to image ``(n, 2)``) over the image.

    Raises `SolveError` where the vendor's RPC has no ground positions there.
    """
    fit = refit_rpc(
        image.rpc, lambda vendors, ground: project(ground), _find_vendor_area(image, project), image.rpc.height_range
    )
    return RefitRPC(fit.rpc, fit.max_px)


def _find_vendor_area(image: Image, project: Project) -> tuple[float, float, float, float]:
    """Return the image area (first and last sample and line) in the vendor RPC's image coordinates.

    A correction of many pixels moves the ground of the image out of the vendor's area: an RPC fitted there would
    extrapolate over a part of the image.
    """
    wanted = make_image_grid(image.domain_px, (3, 3))
    vendors = wanted
    for _ in range(REFIT.passes):
        away = wanted - project(image.rpc.localize(vendors, image.rpc.height_off).ground)
        if not np.isfinite(away).all():
            return image.domain_px
        vendors = vendors + away
        if np.abs(away).max() < REFIT.settled_px:
            break
    low, high = vendors.min(axis=0), vendors.max(axis=0)
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
