"""Dark gravity centres that are shadows of objects standing on the ground, by the direction of the sun.

An object above the ground has its lit side towards the sun and its shadow behind. A dark centre that is such a
shadow is brighter in its half towards the sun. Beyond its outline lies the object itself on the sun's side, darker than
the open, lit ground on all other sides. Pits, ponds and dark plots have neither, or the opposite.

The rule was found on real images, where only the side of the sun differs (with
the sun turned by 180 degrees a fifth as many are found, in open country a twelfth). A bright object on the sun's
side, as the simulator's roofs are, is no criterion: on real ground it is as frequent on any other side.
"""

import numpy as np

from ...block.block import Raster
from ...camera.rpc import RPC
from ...foundation.thresholds import threshold, thresholds
from ...ground.geodesy import move_ground
from ...measurement.interest_points.outlines import interpolate_bilinear
from ...measurement.interest_points.windows import Area, tile_region
from .points import InterestPoints

SHADOW_IMAGES = "four real images, 2026-11-22"


@thresholds
class SHADOW:
    """Limits for dark centres that are shadows, by the grey values around them."""

    beyond_px: float = threshold(
        5.0, "px", "distance from the outline at which the object with this shadow is sampled", SHADOW_IMAGES
    )
    inside: float = threshold(0.6, "", "share of the radius at which the two halves are compared", SHADOW_IMAGES)
    samples: int = threshold(32, "points", "number of samples around an outline")
    side: float = threshold(
        0.7, "", "cosine of the angle to the sun above which a sample is on the sunny side", SHADOW_IMAGES
    )
    other_half: float = threshold(0.0, "", "… and below which it belongs to the surroundings", SHADOW_IMAGES)
    object_darker: float = threshold(
        0.2, "", "smallest difference of the object's grey value from the ground over the contrast", SHADOW_IMAGES
    )
    half_brighter: float = threshold(
        0.1, "", "smallest difference of the halves' grey values over the contrast", SHADOW_IMAGES
    )
    margin_px: int = threshold(8, "px", "margin of the pixels read")
    step_m: float = threshold(100.0, "m", "distance for the numerical direction in the image")


def find_shadows(raster: Raster, points: InterestPoints, towards_sun: np.ndarray) -> np.ndarray:
    """Return which points (n,) are shadows of objects; only dark gravity centres can be.

    towards_sun : (2,) unit vector in the image, sample and line, from anything towards the sun
    """
    is_shadow = np.zeros(len(points), dtype=bool)
    dark = np.flatnonzero(points.is_centre & (points.contrast < 0.0))
    if not len(dark):
        return is_shadow
    reach = int(np.ceil(points.size_px[dark, 0].max() / 2.0 + SHADOW.beyond_px)) + SHADOW.margin_px
    for core in tile_region(Area(0, 0, *raster.size)):
        inside = dark[core.contains(points.xy[dark])]
        if len(inside):
            left, top = max(core.left - reach, 0), max(core.top - reach, 0)
            right, bottom = (min(end + reach, size) for end, size in zip(core.bounds[2:], raster.size, strict=True))
            grey, _ = raster.read(left, top, right - left, bottom - top)
            is_shadow[inside] = _is_on_shadow_side(
                grey.astype(np.float32),
                points.xy[inside] - (left, top),
                points.size_px[inside],
                points.azimuth_rad[inside],
                towards_sun,
            )
    return is_shadow


def compute_image_direction(rpc: RPC, size: tuple[int, int], azimuth_deg: float) -> np.ndarray:
    """Return the unit vector (2,), sample and line, of an azimuth (clockwise from north) in the middle of an image."""
    middle = (np.array([size], dtype=np.float64) - 1.0) / 2.0
    ground = rpc.localize(middle, rpc.height_off).ground
    step = SHADOW.step_m * np.array([[np.sin(np.radians(azimuth_deg)), np.cos(np.radians(azimuth_deg)), 0.0]])
    along = rpc.project(move_ground(ground, step)) - rpc.project(ground)
    return np.asarray(along[0] / np.hypot(*along[0]))


def _is_on_shadow_side(
    grey: np.ndarray, xy: np.ndarray, size_px: np.ndarray, azimuth_rad: np.ndarray, towards_sun: np.ndarray
) -> np.ndarray:
    """Return the mask ``(n,)`` of centres at ``xy (n, 2)`` in a window's pixels; their outlines are taken as ovals."""
    direction = 2.0 * np.pi * np.arange(SHADOW.samples) / SHADOW.samples
    cosine = np.cos(direction) * towards_sun[0] + np.sin(direction) * towards_sun[1]
    sunny, shady, is_aside = cosine > SHADOW.side, cosine < -SHADOW.side, cosine < SHADOW.other_half
    half = size_px / 2.0
    turn = direction - azimuth_rad[:, None]
    radius = half.prod(axis=1)[:, None] / np.hypot(half[:, 1:] * np.cos(turn), half[:, :1] * np.sin(turn))

    def sample_ring(share: float, beyond_px: float) -> np.ndarray:
        distance_px = share * radius + beyond_px
        x, y = xy[:, :1] + distance_px * np.cos(direction), xy[:, 1:] + distance_px * np.sin(direction)
        return np.asarray(interpolate_bilinear(grey, x, y))

    inside, beyond = sample_ring(SHADOW.inside, 0.0), sample_ring(1.0, SHADOW.beyond_px)
    ground = np.median(beyond[:, is_aside], axis=1)
    contrast = ground - np.median(sample_ring(0.5, 0.0), axis=1)
    shade = ground - beyond[:, sunny].mean(axis=1)
    halves = inside[:, sunny].mean(axis=1) - inside[:, shady].mean(axis=1)
    is_dark = (shade > SHADOW.object_darker * contrast) & (halves > SHADOW.half_brighter * contrast)
    return np.asarray((contrast > 0.0) & is_dark)
