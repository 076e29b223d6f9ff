"""Where the pixels of an image lie in the image of its RPC, from all that image, files and names show.

The result is an RPC of the image's pixels, and a doubt (`PlacementDoubt`) if the facts contradict each other or do not
determine the position. The evidence, in the order in which it is used:

* a geotransform without a coordinate system transforms the image's pixels to the scene's: a shift or, if the crop was
  reduced, enlarged, mirrored or rotated, an affine map. Its pixels refer to the corner. Lines increase downwards, or
  upwards as negative numbers. Airbus products start at 0.5, because the centre of their first pixel is 1; other
  programs start at 0. Both mean the first pixel (0, 0): a fraction of 0.5 is subtracted. The RPC may be of the scene,
  or of the crop's pixels (GDAL moves it). OFF - SCALE distinguishes them: it is the first sample and line for which the
  RPC was made, near 0 in a scene's RPC and different in one that was moved;
* the product's file has the position of a tile, by the tile's name; the tile R1C1 begins with its scene;
* another RPC of the image that is the same but for OFF and SCALE shows how the image was cut;
* a VRT states the pixels of its source that it shows: the source's RPC determines its own;
* a geotransform with a coordinate system shows the position of each pixel on a map. Products in map projection (IKONOS
  Geo, ORStandard) have an RPC of their own pixels: from a pixel to the map, and from there through the RPC, the result
  is the same pixel, except for the error of the RPC and the height for which the product was made. With the RPC of the
  raw image the result is rotated and scaled, with that of a product from which the image was cut it is displaced. A
  displacement is evidence if it exceeds the pointing error that a refinement of the RPC may have removed. The map is
  the vendor's, and the ERR_BIAS of a refined RPC does not describe it. A smaller one may be either, and is reported;
* the size for which the RPC was delivered, which its file states or OFF and SCALE show (`block.placement`);
* vendors centre RPCs at W / 2 - c / 2 with an integer c. GDAL (to 3.13) scales OFF itself with an image resampled by r,
  which is 0.5 (1 - r) px too much: then W - 2 OFF is c r, which is no integer.
"""

from __future__ import annotations

import os
import re
from typing import NamedTuple

import numpy as np
from osgeo import gdal

from ...block.block import Image
from ...block.placement import (
    FRAME,
    PlacementDoubt,
    Size,
    format_lonlat,
    format_offset,
    judge_size,
    pixel_size_m,
    rpc_range,
)
from ...block.pointing import POINTING, SIGMAS_OF_CE90, find_sensor
from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.thresholds import EQUALITY, SIGNIFICANCE, threshold, thresholds
from ..opening.datasets import metadata_of, open_dataset
from ..opening.files import Element, parse_finite, read_xml
from ..opening.georeference import Georeference
from . import fields
from .crop import CropPlace, crop_rpc

Geotransform = tuple[float, float, float, float, float, float]
#: Metadata of images whose RPC was composed here: image size for which it is valid.
SIZE_ITEM, SIZE_TEXT = "HRSI_CROP_SIZE", "{},{}"
_FIRST_TILE = re.compile(r"_r0*1c0*1(?![0-9])", re.IGNORECASE)


@thresholds
class PLACEMENT_EVIDENCE:
    """Limits for the position of an image in the image of its RPC."""

    pixel_scales: tuple[float, float] = threshold(
        (1.0 / 32.0, 128.0), "scene px", "smallest and largest pixel of an image, in pixels of its scene"
    )
    first_px: float = threshold(
        2.0, "px", "smallest origin of a crop with another pixel size; below, the RPC's origin is ambiguous"
    )
    step_share: float = threshold(
        0.03, "", "largest relative difference of a pixel's step on the map and by the RPC", "map products: 0.002"
    )
    map_m: float = threshold(50.0, "m", "largest distance of a pixel on the map and by its RPC of any sensor")


def place_by_geotransform(geotransform: Geotransform | None, has_crs: bool) -> CropPlace | None:
    """Return the position of a crop in its scene from its geotransform; None if that does not refer to a scene."""
    if geotransform is None or has_crs or not np.isfinite(geotransform).all():
        return None
    x, dx, x_by_row, y, y_by_column, dy = geotransform
    matrix, corner = np.array([[dx, x_by_row], [y_by_column, dy]], dtype=np.float64), np.array([x, y])
    smallest, largest = PLACEMENT_EVIDENCE.pixel_scales
    if not smallest <= np.sqrt(abs(np.linalg.det(matrix))) <= largest:
        return None
    if dy < 0.0 and y <= 0.0:  # lines upwards, as negative numbers
        matrix, corner = matrix * [[1.0], [-1.0]], corner * [1.0, -1.0]
    corner = np.where(corner % 1.0 == 0.5, corner - 0.5, corner)
    return CropPlace.from_corner(matrix, corner)


def place_in_scene(
    dataset: gdal.Dataset, rpc: RPC, stated: Size | None, inside: bool
) -> tuple[CropPlace | None, PlacementDoubt | None]:
    """Return the place of an image by its geotransform in the scene of an RPC, and a doubt if they contradict.

    The place is None if the geotransform gives none, or if the RPC is that of the image's pixels.

    stated : size of the RPC's image by its file; inside : whether the RPC is in the image, where programs that cut
    images move it, but do not mirror it
    """
    size = dataset.RasterXSize, dataset.RasterYSize
    geotransform, has_crs = dataset.GetGeoTransform(can_return_null=True), bool(dataset.GetProjection())
    place = place_by_geotransform(geotransform, has_crs)
    if place is None or not place.moves:
        if place is None and geotransform is not None and not has_crs and (doubt := judge_size(rpc, size, stated)):
            message = f"its geotransform {tuple(geotransform)} does not give a position in its scene, and {doubt}"
            return None, PlacementDoubt(doubt.offset_px, message, contradictory=True)
        return None, None
    corners = _corners_of(np.zeros(2), np.array(size) - 1.0)
    distance = float(np.hypot(*(place.to_scene(corners) - corners).T).max())
    if (inside and (place.mirrored or distance < FRAME.gross_px)) or (stated == size and not place.mirrored):
        return None, None
    of_scene = _is_of_scene(rpc, place, size, stated)
    if of_scene is not None:
        return (place if of_scene else None), None
    message = (
        f"its geotransform states that it is {place}, which does not agree with the size of its RPC's image: the two "
        f"positions differ by up to {format_offset(rpc, distance)}. The first pixel is at "
        f"{_ground_of(rpc, place.first)} by the geotransform, at {_ground_of(rpc, np.zeros(2))} without it. The "
        "geotransform is not used. Correct it, or write the RPC of these pixels into the image with 'write-rpc'"
    )
    return None, PlacementDoubt(distance, message, contradictory=True)


def _is_of_scene(rpc: RPC, place: CropPlace, size: Size, stated: Size | None) -> bool | None:
    """Return whether an RPC is that of the scene in which a crop has a place, or the crop's own; None if unclear."""
    low, high = (np.zeros(2), np.array(stated) - 1.0) if stated is not None else rpc_range(rpc)
    slack = EQUALITY.alike * (high - low)
    in_scene = place.to_scene(_corners_of(np.zeros(2), np.array(size) - 1.0))
    if (in_scene.min(axis=0) < low - slack).any() or (in_scene.max(axis=0) > high + slack).any():
        return None if judge_size(rpc, size, stated) else False
    if stated is not None:
        return True
    if place.mirrored:
        # Whether the RPC's image is a mirror image of the ground; that of a sensor is never
        _, by_ground = rpc.project_with_metric_jacobian(np.array([[rpc.long_off, rpc.lat_off, rpc.height_off]]))
        return not bool(np.linalg.det(by_ground[0, :, :2]) > 0.0)
    # A scene's RPC begins at 0; a moved one begins at the scene's first pixel, in coordinates of the crop
    first_if_moved = place.to_scene(_corners_of(low, high)).min(axis=0)
    least_px = PLACEMENT_EVIDENCE.first_px * np.abs(place.matrix).max() * (place.matrix != np.eye(2)).any()
    nearer = np.sign(np.abs(first_if_moved) - np.abs(low)) * (np.abs(place.first) > least_px)
    if nearer.any():
        return not (nearer < 0.0).any()
    # An image that begins with its scene: does the range end with the image, in the scene?
    largest = EQUALITY.negligible * (high - low)
    ends_with_scene = bool((np.abs(high - in_scene.max(axis=0)) < largest).all())
    ends_with_image = bool((np.abs(high - np.array(size)) < largest).all())
    return ends_with_scene if ends_with_scene != ends_with_image else None


def _ground_of(rpc: RPC, pixel: np.ndarray) -> str:
    return format_lonlat(rpc.localize(pixel[None], rpc.height_off).ground)


def place_by_other_rpc(scene: RPC, second: RPC) -> CropPlace | None:
    """Return the place of an image whose RPC is ``second`` in the image of the RPC ``scene``; None if they differ."""
    names = [name for name in fields.SCALARS if not name.startswith(("line", "samp"))]
    is_same_scene = all(np.isclose(getattr(scene, name), getattr(second, name), rtol=1e-12) for name in names)
    if not is_same_scene or not all(
        np.allclose(getattr(scene, n), getattr(second, n), rtol=1e-12) for n in fields.POLYNOMIALS
    ):
        return None
    step = np.array([scene.samp_scale / second.samp_scale, scene.line_scale / second.line_scale])
    step = np.where(np.isclose(step, 1.0, rtol=1e-9), 1.0, step)  # digits of the formats
    first = np.array([scene.samp_off, scene.line_off]) - step * [second.samp_off, second.line_off]
    return CropPlace(np.diag(step), first)


def _corners_of(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])


# ---- doubts ----------------------------------------------------------------------------------------------------------


def find_placement_doubt(path: str, dataset: gdal.Dataset, rpc_source: fields.FoundRpc) -> PlacementDoubt | None:
    """Return why the RPC found for an image may not be that of its pixels; None if nothing indicates it."""
    rpc, size = rpc_source.rpc, (dataset.RasterXSize, dataset.RasterYSize)
    if rpc_source.doubt is not None or metadata_of(dataset).get(SIZE_ITEM) == SIZE_TEXT.format(*size):
        return rpc_source.doubt
    if dataset.GetDriver().ShortName == "VRT" and os.path.isfile(path):
        return _compare_with_source(path, rpc, size)
    by_size = None if rpc_source.is_placed else judge_size(rpc, size, rpc_source.stated_size)
    if _FIRST_TILE.search(os.path.basename(path)):
        by_size = None
    difference = compare_with_map(path, dataset, rpc, rpc_source.sensor)
    if difference is not None:
        if doubt := _doubt_by_map(difference, rpc, size[0]):
            return doubt
        if by_size is not None and difference.distance_px <= PLACEMENT_EVIDENCE.first_px:
            return None
        if by_size is not None:
            message = (
                f"{by_size}. Map coordinates and RPC of the same pixels differ by "
                f"{format_offset(rpc, difference.distance_px)}: {difference.places}"
            )
            return PlacementDoubt(by_size.offset_px, message, contradictory=True)
    return by_size or _find_scaled_centre(size, rpc)


def _compare_with_source(path: str, rpc: RPC, size: Size) -> PlacementDoubt | None:
    """Return the difference of a VRT's RPC from that of the one image whose pixels it shows, if the RPC ignores it."""
    sources = [source for band in read_xml(path).findall("VRTRasterBand") for source in band if "Source" in source.tag]
    places = {(source.findtext("SourceFilename") or "", _read_rectangles(source)) for source in sources}
    if len(places) != 1:
        return None
    name, numbers = places.pop()
    first, extent, target_first, target_extent = np.reshape(numbers, (4, 2))
    if not (name and (extent > 0.0).all() and (target_extent > 0.0).all()):
        return None
    relative = next(sources[0].iter("SourceFilename")).get("relativeToVRT") == "1"
    source = open_dataset(os.path.join(os.path.dirname(path), name) if relative else name)[0]
    metadata = {} if source is None else metadata_of(source, "RPC")
    if not metadata:
        return None
    source_rpc, step = fields.rpc_from_entries(name, metadata), extent / target_extent
    right = crop_rpc(source_rpc, CropPlace.from_corner(np.diag(step), first - step * target_first), size)
    offset, same_px = difference_px(right, rpc, size), EQUALITY.file_px
    half, is_resampled = 0.5 * (1.0 - 1.0 / step), (step != 1.0).any()
    if offset < same_px:
        return None
    shows = (
        f"its pixels are {step[0]:.4g} x {step[1]:.4g} of those of {name}, from sample {first[0]:g}, line {first[1]:g} "
        "on, and its RPC ignores"
    )
    advice = f"the error is up to {format_offset(rpc, offset)}. Make the image again from the original with 'crop'"
    if is_resampled and difference_px(rpc, right.shift(*half), size) < same_px:
        return PlacementDoubt(float(np.abs(half).max()), f"{shows} half a pixel: {advice}", contradictory=True)
    unchanged = (
        min(difference_px(rpc, uncropped, size) for uncropped in (source_rpc, source_rpc.shift(*-first))) < same_px
    )
    return PlacementDoubt(offset, f"{shows} that: {advice}", contradictory=True) if unchanged else None


def _read_rectangles(source: Element) -> tuple[float, ...]:
    """Return offset and size of the rectangles in the source and in the VRT; NaN if they are not stated."""
    texts = [
        place.get(name)
        for tag in ("SrcRect", "DstRect")
        for place in [source.find(tag)]
        if place is not None
        for name in ("xOff", "yOff", "xSize", "ySize")
    ]
    numbers = [parse_finite(text) for text in texts]
    return tuple(float("nan") if number is None else number for number in numbers) if len(texts) == 8 else (np.nan,) * 8


class MapDifference(NamedTuple):
    """Difference of the positions of an image's pixels on its map from those by its RPC.

    distance_px : mean distance, at the height of the RPC's range where it is smallest
    limit_m : distance that an RPC of these pixels does not exceed
    turn : (2, 2) steps of the RPC's image along the image's columns and rows; the identity without rotation and scale
    places : text of both positions of the middle of the image, and of the map's name
    """

    distance_px: float
    limit_m: float
    turn: np.ndarray
    places: str


def compare_with_map(path: str, dataset: gdal.Dataset, rpc: RPC, sensor: str = "") -> MapDifference | None:
    """Return the difference of an image's map from its RPC; None without a map, or where they cannot be compared.

    The height for which the map was made is unknown: that with the smallest distance is used.
    """
    if dataset.GetGeoTransform(can_return_null=True) is None or not dataset.GetProjection():
        return None
    try:
        grid = Georeference(dataset, path, "image")
    except InputError:
        return None
    half = 0.25 * np.array([dataset.RasterXSize, dataset.RasterYSize])
    pixels = 2.0 * half - 0.5 + half * [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]]
    lonlat = grid.to_lonlat(pixels)
    by_height = np.array(
        [rpc.project(np.column_stack([lonlat, np.full(4, height)])) for height in (rpc.height_off, *rpc.height_range)]
    )
    if not np.isfinite(by_height).all():
        return None
    _, low, high = by_height.mean(axis=1) - pixels.mean(axis=0)
    along = high - low
    share = float(np.clip(-(low @ along) / max(along @ along, 1e-12), 0.0, 1.0))
    steps = np.column_stack([by_height[0, 1] - by_height[0, 0], by_height[0, 3] - by_height[0, 2]]) / (2.0 * half)
    published = find_sensor(sensor, os.path.basename(path))
    sigma_m = published.ce90_m / SIGMAS_OF_CE90 if published else POINTING.unknown_m
    limit_m = min(PLACEMENT_EVIDENCE.map_m, SIGNIFICANCE.gross * max(sigma_m, rpc.err_bias or 0.0))
    middle, height = 2.0 * half[None] - 0.5, rpc.height_range[0] + share * np.ptp(rpc.height_range)
    by_map, by_rpc = grid.to_lonlat(middle), rpc.localize(middle, height).ground[:, :2]
    places = (
        f"the middle of the image is at {format_lonlat(by_map)} by the grid of the map ({grid.horizontal.name}), at "
        f"{format_lonlat(by_rpc)} by the RPC at height {height:.0f} m"
    )
    return MapDifference(float(np.hypot(*(low + share * along))), limit_m, steps, places)


def _doubt_by_map(difference: MapDifference, rpc: RPC, samples: int) -> PlacementDoubt | None:
    """Return the doubt if the map and the RPC of an image of that many samples contradict each other."""
    distance, turn = difference.distance_px, difference.turn
    if np.abs(turn - np.eye(2)).max() >= PLACEMENT_EVIDENCE.step_share:
        angle = np.degrees(np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]))
        message = (
            "its pixels are on the grid of a map that its RPC does not follow: turned by "
            f"{abs(angle):.0f} degrees, {np.sqrt(abs(np.linalg.det(turn))):.3g} of its pixels long; "
            f"{difference.places}. If it is an orthoimage that kept the RPC of the raw image, name the raw image"
        )
        return PlacementDoubt(max(distance, float(samples)), message, contradictory=True)
    if distance * pixel_size_m(rpc) <= difference.limit_m:
        return None
    message = (
        f"its map coordinates and its RPC place the same pixels {format_offset(rpc, distance)} apart, at the height "
        f"where they fit best: {difference.places}. The RPC is that of the image from which it was cut, or its map "
        "coordinates are wrong. Cut the original with 'crop', which moves the RPC"
    )
    return PlacementDoubt(distance, message, contradictory=True)


def describe_map_evidence(path: str, dataset: gdal.Dataset, found: fields.FoundRpc) -> str:
    """Return how closely map and RPC of an image agree, if not to the pixel, and what would not be seen; else ""."""
    difference = compare_with_map(path, dataset, found.rpc, found.sensor)
    if difference is None or difference.distance_px <= PLACEMENT_EVIDENCE.first_px:
        return ""
    if _doubt_by_map(difference, found.rpc, dataset.RasterXSize):
        return ""
    return (
        f"its map coordinates and its RPC differ by {format_offset(found.rpc, difference.distance_px)}, as a refined "
        f"RPC may (to {difference.limit_m:.3g} m), or one of an image from which a thin edge was cut: "
        f"{difference.places}"
    )


def _find_scaled_centre(size: Size, rpc: RPC) -> PlacementDoubt | None:
    """Return the error if OFF of an RPC was scaled without half a pixel."""
    off, scale = np.array([rpc.samp_off, rpc.line_off]), np.array([rpc.samp_scale, rpc.line_scale])
    beyond, tolerance = np.array(size) - 2.0 * off, EQUALITY.written_px
    if not (beyond > 0.0).all() or (np.abs(beyond - np.round(beyond)) < tolerance).any():
        return None  # as vendors make them
    doubled = (np.abs(2.0 * (scale - off) - beyond) < tolerance * beyond).all()  # SPOT, WorldView: OFF + 1 is SCALE
    factors = beyond / (2.0 if doubled else 1.0)
    originals = size / factors
    if not np.ptp(factors) <= 1.0 / min(size) or not (np.abs(originals - np.round(originals)) <= tolerance).all():
        return None
    offset = float(np.abs(0.5 * (1.0 - factors)).max())
    message = (
        f"its RPC was scaled with an image resampled by {factors.mean():.4g} without half a pixel (gdal_translate): "
        f"the error is up to {format_offset(rpc, offset)}. Make the image again from the original with 'crop'"
    )
    return PlacementDoubt(offset, message, contradictory=False)


# ---- comparison ----------------------------------------------------------------------------------------------------


def difference_px(reference: RPC, second: RPC, size: tuple[int, int] | None = None) -> float:
    """Return the largest distance (px) between the image points of two RPCs.

    They are compared on a 9 x 9 grid over the image (its ``size``, else OFF and SCALE) at lowest, middle and highest
    height of ``reference``; infinite if ``reference`` cannot be inverted and the two differ.
    """
    if same_numbers(reference, second):
        return 0.0
    grid = Image("", reference, size).grid_px(9, 9)
    heights = np.repeat((*reference.height_range, reference.height_off), len(grid))
    ground, converged = reference.localize(np.tile(grid, (3, 1)), heights)
    difference = second.project(ground[converged]) - reference.project(ground[converged])
    largest = float(np.hypot(*difference.T).max(initial=-np.inf))
    return largest if np.isfinite(largest) else float("inf")


def same_numbers(first: RPC, second: RPC) -> bool:
    """Return whether the 90 numbers of two RPCs, without their stated errors, are the same doubles."""
    return fields.numbers_of(first)[len(fields.ERRORS) :] == fields.numbers_of(second)[len(fields.ERRORS) :]
