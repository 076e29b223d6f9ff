"""Crops: the RPC of a full scene beside a cut-out whose origin stands only in the geotransform.

A geotransform is a crop origin where it has no coordinate system and no rotation and its pixels are exactly 1 x 1
(lines counted down, or up as negative numbers). Airbus products start at 0.5, because their first pixel's centre
is 1; tools without that habit start at 0. Both give the first pixel (0, 0): the fraction 0.5 is taken off.

An RPC *inside* the image (GeoTIFF tag, NITF, VRT, PAM) is that of its pixels and is never moved. An RPC *beside* it may
be of the scene or of the crop (when it was written for the crop, by GDAL or by this program). OFF - SCALE tells
them apart: it is the first sample and line that the RPC was made for, near 0 in a scene's RPC and near minus the origin
in one that was moved. The RPC is taken for the scene's where the crop lies inside that range and
its beginning is nearer to 0.
"""

from __future__ import annotations

from ...camera.rpc import RPC

Geotransform = tuple[float, float, float, float, float, float]
RANGE_TOLERANCE = 0.02  # share of the RPC's range by which it may end inside the image


def crop_origin(geotransform: Geotransform | None, has_crs: bool) -> tuple[float, float]:
    """Return the scene's (sample, line) of the crop's first pixel; (0, 0) where the geotransform is no crop origin."""
    if geotransform is None or has_crs:
        return 0.0, 0.0
    x, dx, row_rotation, y, column_rotation, dy = geotransform
    if row_rotation or column_rotation or dx != 1.0 or abs(dy) != 1.0:
        return 0.0, 0.0
    return _without_half(x), _without_half(y * dy)


def _without_half(origin: float) -> float:
    return origin - 0.5 if origin % 1.0 == 0.5 else origin


def is_of_full_scene(rpc: RPC, origin: tuple[float, float], size: tuple[int, int]) -> bool:
    """Return whether an RPC that stands beside a crop is that of the scene it was cut from."""
    offs, scales = (rpc.samp_off, rpc.line_off), (abs(rpc.samp_scale), abs(rpc.line_scale))
    for first, count, off, scale in zip(origin, size, offs, scales, strict=True):
        margin = RANGE_TOLERANCE * 2.0 * scale
        if first < off - scale - margin or first + count - 1 > off + scale + margin:
            return False
        begin = off - scale
        if abs(begin + first) < abs(begin):
            return False
    return True
