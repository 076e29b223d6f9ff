"""Fit of a new RPC to a corrected camera whose correction no exact change of the coefficients represents."""

import numpy as np

from ..block.block import Image
from ..camera.rpc_fit import make_image_grid, refit_rpc
from ..foundation.thresholds import EQUALITY, ITERATIONS
from .model import RefinementModel, RefitRPC


def refit_camera(model: RefinementModel, image: Image, values: np.ndarray) -> RefitRPC:
    """Return the RPC fitted to a corrected camera over its image; without a correction the vendor's RPC.

    Raises `SolveError` if the vendor's RPC has no ground positions there.
    """
    if not np.any(values):
        return RefitRPC(image.rpc, 0.0)
    # The image area in the vendor RPC's image coordinates: a correction of many pixels moves the ground of the image
    # out of the vendor's area, and an RPC fitted there would extrapolate over a part of the image.
    targets = vendors = make_image_grid(image.domain_px, (3, 3))
    area = image.domain_px
    for _ in range(ITERATIONS.most):
        shift = targets - model.project(image, values, image.rpc.localize(vendors, image.rpc.height_off).ground)
        if not np.isfinite(shift).all():
            area = image.domain_px
            break
        vendors = vendors + shift
        low, high = vendors.min(axis=0), vendors.max(axis=0)
        area = float(low[0]), float(high[0]), float(low[1]), float(high[1])
        if np.abs(shift).max() < EQUALITY.rpc_px:
            break
    fit = refit_rpc(
        image.rpc, lambda vendors, ground: model.project(image, values, ground), area, image.rpc.height_range
    )
    return RefitRPC(fit.rpc, fit.max_px)
