"""Whether the pixels of an image are those for which its RPC was made, from the sizes of both.

OFF and SCALE describe the image for which an RPC was made: vendors centre it, so that this image has 2 OFF + 1 samples
and lines, and OFF - SCALE, the first sample and line of its range, is near 0. The RPC of a crop has an OFF that was
moved, and its range begins far from 0: then sizes show nothing. The RPCs of 15 SkySat frames, which are the worst, give
0.89 to 1.08 of the size, and begin at -0.04 to 0.07 of the range; the 13 of other sensors whose files state the size
give 0.99 to 1.02. Those that begin at exactly 0 or -1 were made for exactly the pixels of their images.
"""

from dataclasses import dataclass

import numpy as np

from ..camera.rpc import RPC
from ..foundation.thresholds import EQUALITY, threshold, thresholds

Size = tuple[int, int]


@thresholds
class FRAME:
    """Limits for the size of an image relative to that of its RPC."""

    begin: tuple[float, float] = threshold(
        (-0.045, 0.1),
        "",
        "offset of an RPC's range from the first pixel, over the range, of a complete image",
        "37 vendor RPCs of complete images: -0.039 to 0.065, 2026-11-28",
    )
    part_share: float = threshold(
        0.85,
        "",
        "samples or lines of an image over those of its RPC, below which it is a part",
        "28 vendor RPCs with known sizes (13 stated, 15 SkySat by the sensor): 0.886 to 1.084, 2026-11-28",
    )
    part_mean: float = threshold(0.93, "", "… geometric mean of both", "the same 28 RPCs: 0.946 to 1.008, 2026-11-28")
    stated_share: float = threshold(0.01, "", "largest difference of an image's size from the size that a file states")
    gross_px: float = threshold(
        1.0, "px", "smallest error with which an adjustment is unreliable", "a shift is corrected by every model"
    )


@dataclass(frozen=True)
class PlacementDoubt:
    """Reason why an RPC may not be that of an image's pixels.

    offset_px : largest possible error of a position in the image
    message : what was found, the possible error in pixels and metres, and what to do
    contradictory : True if two facts contradict each other; False if the position is only unknown
    factor : factor by which the sizes show that the image may have been resampled
    """

    offset_px: float
    message: str
    contradictory: bool
    factor: float = 1.0

    @property
    def is_gross(self) -> bool:
        """Whether the error is more than a shift, which every model corrects."""
        return self.offset_px > FRAME.gross_px

    def __str__(self) -> str:
        return self.message


def pixel_size_m(rpc: RPC) -> float:
    """Return the size of a pixel on the ground in the centre of an RPC, in metres."""
    _, by_ground = rpc.project_with_metric_jacobian(np.array([[rpc.long_off, rpc.lat_off, rpc.height_off]]))
    return float(1.0 / np.sqrt(abs(np.linalg.det(by_ground[0, :, :2]))))


def format_offset(rpc: RPC, offset_px: float) -> str:
    """Return a distance in pixels and in metres on the ground."""
    return f"{offset_px:.3g} px ({offset_px * pixel_size_m(rpc):.3g} m)"


def format_lonlat(ground: np.ndarray) -> str:
    """Return the first of some positions ``(n, 2 or 3)`` lon, lat in degrees as text, to 0.1 m."""
    return f"lon {ground[0, 0]:.6f}, lat {ground[0, 1]:.6f}"


def rpc_range(rpc: RPC) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and last sample and line for which an RPC was made: OFF - SCALE and OFF + SCALE."""
    offset, scale = np.array([rpc.samp_off, rpc.line_off]), np.abs([rpc.samp_scale, rpc.line_scale])
    return offset - scale, offset + scale


def judge_size(rpc: RPC, size: Size, stated: Size | None = None) -> PlacementDoubt | None:
    """Return the doubt if an image has not the size for which its RPC was made; None if nothing indicates that.

    stated : samples and lines that the file of the RPC states for its image
    """
    low, high = rpc_range(rpc)
    if stated is None:
        begin = low / (high - low)
        if not ((FRAME.begin[0] <= begin) & (begin <= FRAME.begin[1])).all():
            return None
    full = low + high + 1.0 if stated is None else np.array(stated)
    ratio = full / size
    is_scaled = np.ptp(ratio) <= max(FRAME.stated_share, 1.0 / min(size)) * ratio.mean()
    is_scaled &= not 1.0 / (1.0 + EQUALITY.negligible) < ratio.mean() < (1.0 + EQUALITY.negligible)
    share = 1.0 / ratio
    if stated is None:
        is_exact = (np.abs(low) <= FRAME.gross_px).all()
        part_share, part_mean = (1.0 - FRAME.stated_share,) * 2 if is_exact else (FRAME.part_share, FRAME.part_mean)
        agrees = (share > part_share) & (share < EQUALITY.size) & (np.sqrt(share.prod()) > part_mean)
    else:
        agrees = np.abs(share - 1.0) < FRAME.stated_share
    if agrees.all() and not is_scaled:
        return None
    source = "by its OFF and SCALE" if stated is None else "as its file states"
    message = (
        f"it has {size[0]} x {size[1]} px, its RPC is that of an image of {full[0]:.0f} x {full[1]:.0f} px ({source})"
    )
    offset = float(np.abs(full - size).max())
    scaled = float((np.abs(ratio - 1.0) * (np.array(size) - 1.0)).max())
    if is_scaled:
        message += (
            f", {ratio.mean():.4g} times as long and wide: if its pixels were resampled, or it is another band with a "
            f"larger or smaller pixel, the error is up to {format_offset(rpc, scaled)}"
        )
    if (ratio > 1.0 - FRAME.stated_share).all():
        message += (
            f"{'; if' if is_scaled else ': if'} it was cut, the RPC is right for the upper left part only, and the "
            f"error is up to {format_offset(rpc, offset)}"
        )
    elif not is_scaled:
        message += f": the RPC is of another image, and the error is up to {format_offset(rpc, offset)}"
    message += (
        ". Make the image again from the original with 'crop', or, if it was only cut, set the origin of its "
        "geotransform to its first sample and line in the original"
    )
    if is_scaled:
        return PlacementDoubt(scaled, message, stated is not None, float(ratio.mean()))
    return PlacementDoubt(max(offset, scaled), message, stated is not None)
