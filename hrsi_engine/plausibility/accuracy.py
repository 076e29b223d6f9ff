"""A priori accuracy of each image's RPC: standard deviation of its shift, its drift, and limits that no RPC exceeds.

The error of an RPC is metres to hundreds of metres, nearly the same for all points of an image: a shift with a small
drift. A misfit that changes from point to point, or a shift beyond the sensor's pointing error, has another cause.
ERR_BIAS states the standard deviation of the shift; where a product gives none, the ground sampling distance determines
the class of the sensor:

    GSD below 1 m   5 to 25 m (CE90) for IKONOS, QuickBird, GeoEye, WorldView, Pleiades, KOMPSAT
    GSD 1.5 to 4 m  30 to 250 m for SPOT 5-7, ALOS, ZY-3, GF-1, Cartosat-1
    GSD 10 to 20 m  100 to 500 m for SPOT 1-4 and wide-field cameras

A standard deviation of 12 pixels, and at least 15 m, is consistent with all of them.

Products exceed their stated figure. An error of up to ten times the CE90 that is equal for all points is a bias of the
RPC, which GCPs correct like any smaller one; a larger error has another cause. For products that state nothing, a bias
is accepted up to ten standard deviations.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..block.block import Image
from ..block.pointing import SIGMAS_OF_CE90, compute_gsds_m, find_image_sensor
from ..foundation.pixel_filters import BLUR
from ..foundation.thresholds import SIGNIFICANCE, threshold, thresholds

#: Source of most thresholds of this room.
SIMULATED = "simulated blocks of six sensors, seeds below 1000, 2026-11-22 (docs/protocols/wrong_inputs.md)"
OF_SENSORS = "published accuracies of sensors (table of the module)"


@thresholds
class ACCURACY:
    """A priori accuracy of RPCs, and errors that are too large for any RPC."""

    unknown_sigma_px: float = threshold(12.0, "px", "sigma of the shift if the product states none", OF_SENSORS)
    unknown_sigma_m: float = threshold(15.0, "m", "… in metres; the larger of the two applies", OF_SENSORS)
    least_sigma_px: float = threshold(3.0, "px", "smallest sigma of a shift (ERR_BIAS) in use", SIMULATED)
    biased_ce90: float = threshold(2.0, "CE90", "shift of an image that is reported as a bias of its RPC")
    most_biased_ce90: float = threshold(10.5, "CE90", "largest shift common to all points that is a bias of the RPC")
    unwritten_sigmas: float = threshold(
        30.0,
        "sigma",
        "shift beyond which, and beyond `most_biased_ce90`, no refined RPC is written",
        "ten times the "
        "published CE90 of Pleiades, 26 sigma of its simulated RPCs (tests/plausibility/test_biased_rpcs.py)",
    )
    impossible_shift_m: float = threshold(500.0, "m", "shift that an RPC of any sensor can have", SIMULATED)
    usual_drift: float = threshold(3e-4, "px/px", "sigma of the drift of an RPC over its image", SIMULATED)


@dataclass(frozen=True)
class ImageAccuracy:
    """A priori accuracy of an image's RPC.

    gsd_m : ground sampling distance; sigma_m : standard deviation of each horizontal coordinate of the shift
    ce90_m : the CE90 that a shift is compared with: the larger of that of sigma_m and the published one of the sensor
    large_m : a larger shift is reported; biased_m : a shift up to this, equal for all points, is a bias of the RPC
    far_m : a larger shift is not an error of an RPC
    misfit_m : largest difference between the misfits of two points; drift : standard deviation, px/px
    """

    gsd_m: float
    sigma_m: float
    ce90_m: float
    large_m: float
    biased_m: float
    far_m: float
    misfit_m: float
    drift: float


def estimate_accuracies(
    images: Sequence[Image], sigma_shift_px: float = 0.0, sigma_drift: float = 0.0
) -> list[ImageAccuracy]:
    """Return the a priori accuracy of each image from ERR_BIAS or its resolution, or larger if the user states so."""
    accuracies = []
    for image, gsd in zip(images, compute_gsds_m(images).tolist(), strict=True):
        stated = image.rpc.err_bias
        sigma = float(stated) if stated and stated > 0.0 and np.isfinite(stated) else 0.0
        published = find_image_sensor(image)
        has_figure = sigma > 0.0 or published is not None
        if sigma > 0.0:
            sigma = max(sigma, ACCURACY.least_sigma_px * gsd)
        else:
            sigma = max(ACCURACY.unknown_sigma_m, ACCURACY.unknown_sigma_px * gsd)
        sigma = max(sigma, sigma_shift_px * gsd)
        ce90_m = max(SIGMAS_OF_CE90 * sigma, published.ce90_m if published else 0.0)
        large_m = biased_m = SIGNIFICANCE.extreme * sigma
        if has_figure:
            large_m, biased_m = ACCURACY.biased_ce90 * ce90_m, ACCURACY.most_biased_ce90 * ce90_m
        far_m = max(ACCURACY.impossible_shift_m, biased_m)
        drift = max(SIGNIFICANCE.sigmas * ACCURACY.usual_drift, SIGNIFICANCE.extreme * sigma_drift)
        # a point is measured within the blur of its edges
        misfit_m = gsd * max(SIGNIFICANCE.extreme * BLUR.edge_px, drift * float(np.hypot(*image.half_size_px)))
        usual_drift = max(ACCURACY.usual_drift, sigma_drift)
        accuracies.append(
            ImageAccuracy(
                gsd_m=gsd,
                sigma_m=sigma,
                ce90_m=ce90_m,
                large_m=large_m,
                biased_m=biased_m,
                far_m=far_m,
                misfit_m=misfit_m,
                drift=usual_drift,
            )
        )
    return accuracies
