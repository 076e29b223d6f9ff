"""Measurement of an image point in another image, by the least-squares matching that is used for tie points.

The second image is resampled into the geometry of the first around the predicted position, so that differences of
rotation, scale and view are removed. The window is searched along the epipolar segment of the possible heights
(`search_windows`), measured with sub-pixel accuracy (`match_patches`), and measured back from the second image to the
first. It is rejected if the reverse measurement differs, the correlation is low, or a second place is similar.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..block.block import Raster
from ..foundation.pixel_filters import BLUR
from ..foundation.thresholds import EQUALITY, threshold, thresholds
from .given_matches import EXTERNAL
from .window_matching.correlation import compute_orientation_field
from .window_matching.least_squares_matching import match_patches, search_windows
from .window_matching.windows import DONE, LsmOptions, MatchImage


@thresholds
class TRANSFER:
    """Conditions for the measurement of a point of one image in another."""

    half_px: int = threshold(15, "px", "half side of the correlation window")
    correlation: float = threshold(0.7, "", "smallest accepted correlation coefficient")
    rival: float = threshold(0.9, "", "largest ratio of the second and the highest correlation (ambiguity)")
    closure_px: float = threshold(0.5, "px", "largest difference of the reverse measurement from the point")
    sigma_px: float = threshold(0.3, "px", "largest accepted standard deviation of a position")
    surroundings: float = threshold(
        0.1, "", "smallest correlation of gradient directions around the window", "3 sigma of 1000 independent pixels"
    )
    deformation: float = threshold(
        0.12, "", "largest deformation of a chip relative to the cameras", "slopes of 30 % at 20 degrees between views"
    )


@dataclass(frozen=True)
class Transfer:
    """Position ``xy`` (sample, line) of a point in another image, its sigma (px), correlation; or the ``refusal``."""

    xy: tuple[float, float] = (np.nan, np.nan)
    sigma_px: float = np.nan
    correlation: float = np.nan
    refusal: str = ""


def transfer_point(
    first: Raster, xy: np.ndarray, second: Raster, line: np.ndarray, by_first: np.ndarray, margin_px: float = 0.0,
    around_px: int = 0,
) -> Transfer:  # fmt: skip
    """Measure a point of one image in another; return its position there, or the reason of the refusal.

    xy : (2,) position in the first image (sample, line)
    line : (2, 2) positions in the second image at the lowest and at the highest possible height
    by_first : (2, 2) derivatives of positions in the second image by those in the first
    margin_px : largest error of the predicted position, in pixels of the second image
    around_px : half the side of the surroundings, in pixels of the first, that must be similar too, while the window
        must have no parallaxes: for targets at ground level in old images; 0: no such test
    """
    scale = np.sqrt(abs(np.linalg.det(by_first)))
    if not np.isfinite(line).all() or not scale > 0.0:
        return Transfer(refusal="the cameras do not determine its position")
    # If the first image has smaller pixels, it is reduced to about those of the second
    step = max(1.0, float((1.0 / EQUALITY.size) / scale))
    by_first, scale = by_first * step, scale * step
    middle, span = line.mean(axis=0), np.linalg.inv(by_first) @ (line[1] - line[0])
    along = float(np.hypot(*span)) / 2.0 + (margin_px + EXTERNAL.error_px) / scale
    across = (margin_px + EXTERNAL.error_px) / scale
    half = int(np.ceil(along)) + 2 * TRANSFER.half_px + 4
    centre = np.round(xy)
    template = _read_window(first, centre, step * np.eye(2), TRANSFER.half_px + 2 * LsmOptions().half)
    second_window = _read_window(second, middle, by_first, half)
    if template is None or second_window is None:
        return Transfer(refusal="the image does not show it")
    origin = np.array([[template.grey.shape[1] // 2, template.grey.shape[0] // 2]])
    direction = span / max(float(np.hypot(*span)), 1e-9) if np.hypot(*span) > 0.0 else np.array([1.0, 0.0])
    peak = search_windows(
        template, second_window, origin, predicted=np.array([[half, half]], dtype=np.float64),
        direction=direction[None],
        reach=np.array([[along, across]]), half=TRANSFER.half_px,
    )  # fmt: skip
    if peak.correlation[0] < TRANSFER.correlation:
        return Transfer(refusal=f"no similar place is found (correlation {max(peak.correlation[0], 0.0):.2f})")
    if peak.rival[0] > TRANSFER.rival * peak.correlation[0]:
        return Transfer(refusal="two places are similar to it")
    forward_match = match_patches(template, second_window, origin, peak.xy, np.eye(2)[None])
    matched_xy = forward_match.xy[0] + forward_match.affine[0] @ (np.asarray(xy) - centre) / step
    sigma_px = float(forward_match.sigma_px[0]) * scale
    if (
        forward_match.status[0] != DONE
        or not sigma_px < TRANSFER.sigma_px
        or forward_match.correlation[0] < TRANSFER.correlation
    ):
        return Transfer(refusal="it cannot be measured there: too little texture, or the images differ")
    back_from = np.round(forward_match.xy)
    expected_back = origin[0] + np.linalg.solve(forward_match.affine[0], back_from[0] - forward_match.xy[0])
    back_match = match_patches(
        second_window, template, back_from.astype(np.int64), expected_back[None], np.linalg.inv(forward_match.affine)
    )
    if back_match.status[0] != DONE or np.hypot(*(back_match.xy[0] - expected_back)) > TRANSFER.closure_px:
        return Transfer(refusal="the reverse measurement gives another place")
    position = middle + by_first @ (matched_xy - half)
    if reach := int(around_px / step):
        if np.abs(forward_match.affine[0] - np.eye(2)).max() > TRANSFER.deformation:
            return Transfer(refusal="objects of several heights lie within the window")
        sides = (
            _read_window(first, np.asarray(xy), step * np.eye(2), reach),
            _read_window(second, position, by_first, reach),
        )
        if _correlate_surroundings(*sides) < TRANSFER.surroundings:
            return Transfer(refusal="what lies around it differs")
    return Transfer((float(position[0]), float(position[1])), sigma_px, float(forward_match.correlation[0]))


def _correlate_surroundings(first: MatchImage | None, second: MatchImage | None) -> float:
    """Return the correlation of gradient directions outside the matched windows; 0 without pixels.

    It is less affected by seasons than that of grey values, and homogeneous areas do not contribute.
    """
    if first is None or second is None:
        return 0.0
    fields = [compute_orientation_field(one.grey, one.valid) for one in (first, second)]
    distance = np.abs(np.arange(len(first.grey)) - len(first.grey) // 2)
    is_surrounding = first.valid & second.valid & (np.maximum(*np.meshgrid(distance, distance)) > TRANSFER.half_px)
    first_field, second_field = (np.where(is_surrounding, field, 0.0) for field in fields)
    energy = float(np.sum(np.abs(first_field) ** 2) * np.sum(np.abs(second_field) ** 2))
    return float(np.sum(first_field * np.conj(second_field)).real) / max(np.sqrt(energy), 1e-30)


def _read_window(raster: Raster, middle: np.ndarray, by_window: np.ndarray, half: int) -> MatchImage | None:
    """Return the pixels at ``middle + by_window @ offset`` for integer offsets up to ``half``; None outside."""
    corners = middle + np.array([[i, j] for i in (-half, half) for j in (-half, half)]) @ by_window.T
    low, high = np.floor(corners.min(axis=0)).astype(int) - 3, np.ceil(corners.max(axis=0)).astype(int) + 4
    inside_low, inside_high = np.maximum(low, 0), np.minimum(high, raster.size)
    if (inside_high - inside_low < 2 * TRANSFER.half_px).any():
        return None
    grey, valid = raster.read(*inside_low.tolist(), *(inside_high - inside_low).tolist())
    offset = np.arange(-half, half + 1)
    grid = np.stack(np.meshgrid(offset, offset), axis=-1) @ by_window.T + middle - inside_low
    coordinates = [grid[..., 1], grid[..., 0]]
    # Low-pass filter against aliasing if the window has larger pixels than the image
    finer = float(np.sqrt(abs(np.linalg.det(by_window))))
    source = np.where(valid, grey, float(np.mean(grey[valid])) if valid.any() else 0.0).astype(np.float64)
    if finer > 1.05:
        source = ndimage.gaussian_filter(source, 0.45 * np.sqrt(finer**2 - 1.0))
    pixels = ndimage.map_coordinates(source, coordinates, order=3, mode="nearest")
    usable = ndimage.map_coordinates(valid.astype(np.float64), coordinates, order=1, mode="constant", cval=0.0) > 0.999
    contrast = float(np.std(pixels[usable])) if usable.any() else 0.0
    if contrast < EQUALITY.rounding:
        return None
    # Scale to unit contrast, since sensors have different grey values and the gain between windows is tested
    return MatchImage((pixels / contrast).astype(np.float32), usable, BLUR.sigma_px)
