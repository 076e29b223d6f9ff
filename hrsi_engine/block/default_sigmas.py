"""Standard deviations for points and measurements whose file gives none."""

from __future__ import annotations

from ..foundation.options import option, options


@options
class DefaultSigmas:
    """Standard deviations for points and measurements whose file gives none."""

    sigma_image_px: float = option(
        0.5,
        "Standard deviation of image points without one in their file",
        name="sigma-image",
        minimum=1e-6,
        unit="px",
        metavar="PX",
    )
    sigma_gcp_xy_m: float = option(
        0.2,
        "Standard deviation of each horizontal coordinate of GCPs without one in their file",
        name="sigma-gcp-xy",
        minimum=1e-6,
        unit="m",
        metavar="M",
    )
    sigma_gcp_h_m: float = option(
        0.3,
        "Standard deviation of the heights of GCPs without one in their file",
        name="sigma-gcp-h",
        minimum=1e-6,
        unit="m",
        metavar="M",
    )
