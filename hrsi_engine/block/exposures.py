"""Images of one exposure: parts of a strip, and bands, delivered as separate images with an RPC each.

They have the same pointing and drift over the lines of the strip, and are treated as one exposure: as separate images
their errors would be assumed to be independent. Names show which images may be parts (an order's product with its part,
P001 P002 …), and the RPCs confirm it: parts are windows of one pixel grid.

Bands (PAN, MS, SWIR) have equal lines of sight and larger pixels. An image is a band of the same exposure if the ground
points of pixels of the panchromatic image, at several heights, are in the band at a common shift and scale of their
positions: the camera of another date would rotate or stretch them. A parallax is permitted, since the detectors of
bands are side by side in the focal plane. Names with different times or satellites exclude a common exposure.

**Parts of one strip.** A linear array scans a strip continuously. Vendors deliver it in parts along the flight
(WorldView's P001, P002 …) with an RPC each, and scenes in tiles (R1C1 …) with one RPC. Parts are windows of one pixel
grid, so that their offsets are whole pixels. The offsets follow from the RPCs: a pixel of one part is projected to the
ground and into the next part where they overlap, or just beyond its end. Where parts overlap, the later one is used,
which is also the one on top. The RPC of the strip is fitted to grids over the parts at the heights of their RPCs. Its
misfit over a long strip is distributed evenly: with Lawson's weights (1961), which grow with the residuals, least
squares approximate the minimum of the largest residual.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from ..camera.rpc import RPC
from ..camera.rpc_fit import CHECK_GRID, FIT, best_fit, fit_rpc, make_virtual_grid
from ..foundation.errors import InputError
from ..foundation.thresholds import EQUALITY, GRIDS, SAMPLES, threshold, thresholds
from .block import Image, Tile
from .pointing import compute_gsds_m, find_image_sensor

#: Number of a part at the end of a product's name, and the time before it, which differs between parts.
_PART = re.compile(r"[_-][RP]\d{1,3}(?:C\d{1,3})?$", re.IGNORECASE)
_TIME = re.compile(r"\d{2}[A-Z]{3}\d{8}|\d{14}", re.IGNORECASE)
#: Catalogue number of an exposure in names of DigitalGlobe and Maxar.
_CATALOGUE = re.compile(r"(?<![0-9A-F])10[1-9A-F]00[0-9A-F]{11}(?![0-9A-F])")

#: Start time of a pass, to the second, in the names of its frames.
_PASS = re.compile(r"(?<!\d)\d{8}[_T]?\d{6}(?!\d)")


@thresholds
class BANDS:
    """Conditions for two images to be bands of one exposure."""

    bent_px: float = threshold(0.5, "px", "largest deviation of a band from a shift and a scale, in its pixels")
    parallax: float = threshold(
        0.005, "m/m", "largest parallax of the lines of sight per height", "up to 0.4 s at 7.5 km/s, from 600 km"
    )
    apart_s: float = threshold(60.0, "s", "largest time between images of one exposure, from file names")


def join_exposures(images: Sequence[Image]) -> list[Image]:
    """Return the images; those that are parts of one strip or bands of one exposure become tiles of it."""
    return join_bands(join_parts_of_strips(images))


def join_parts_of_strips(images: Sequence[Image]) -> list[Image]:
    """Return the images; those that are parts of one strip become tiles of it, so that they share one camera."""
    products: dict[str, list[int]] = {}
    for index, image in enumerate(images):
        if image.tile is None and image.size is not None and _PART.search(image.id):
            products.setdefault(_TIME.sub("", _PART.sub("", image.id)), []).append(index)
    result = list(images)
    for name, members in products.items():
        parts = [images[index] for index in members]
        if len(parts) < 2 or len({part.rpc for part in parts}) == 1:
            continue
        try:
            places = place_parts(parts)
        except InputError:  # images of one product that are not windows of one pixel grid
            continue
        if places.off_px.max() > STRIP.whole_px or not _have_common_rays(parts, places.first):
            continue
        for index, first in zip(members, places.first.tolist(), strict=True):
            result[index] = replace(images[index], tile=Tile(name, (first[0], first[1]), places.size))
    return result


def _have_common_rays(parts: Sequence[Image], first: np.ndarray) -> bool:
    """Return whether adjacent parts at ``first (n, 2)`` have the same rays where they meet, tested at two heights."""
    for one, second in pairwise(np.lexsort((first[:, 0], first[:, 1])).tolist()):
        first_part, part = parts[one], parts[second]
        offset = (first[second] - first[one]).astype(np.float64)
        edge = part.centre_px + np.clip(
            first_part.centre_px - offset - part.centre_px, -part.half_size_px, part.half_size_px
        )
        for height in part.rpc.height_range:
            projected = first_part.rpc.project(part.rpc.localize(edge[None], height).ground)
            if not np.hypot(*(projected - edge - offset)[0]) <= STRIP.bent_px:
                return False
    return True


class _Relation(NamedTuple):
    """Position of a band in the scene of a finer image, ``first + pixel * xy``, and the number of nodes used."""

    pixel: float
    nodes: int
    first: np.ndarray
    fine: int
    band: int


def join_bands(images: Sequence[Image], least_pixel: float = EQUALITY.size) -> list[Image]:
    """Return the images; those that are bands of a finer image become tiles of its scene, with one camera.

    least_pixel : smallest ratio of the pixel sizes of band and finer image; 0 if it is known that they belong together
    """
    gsd, result = compute_gsds_m(images), list(images)
    order = np.argsort(gsd, kind="stable").tolist()
    if not order or gsd[order[-1]] < least_pixel * gsd[order[0]]:
        return result
    scenes: dict[str | int, list[int]] = {}
    for index in order:
        tile = images[index].tile
        scenes.setdefault(index if tile is None else tile.scene, []).append(index)
    for scene, members in scenes.items():
        finer = order[: order.index(members[0])]
        relations = [
            relation
            for fine in finer
            for band in members
            if fine not in members and least_pixel * gsd[fine] <= gsd[band]
            if least_pixel == 0.0 or _may_be_one_exposure(images[fine], images[band])
            if (relation := _relate_band(result, fine, band)) is not None
        ]
        if not relations:
            continue
        best = max(relations, key=lambda relation: (round(relation.pixel, 1), relation.nodes))
        composite = _find_scene(result[best.fine])
        result[best.fine] = replace(result[best.fine], tile=composite)
        of_band = result[best.band].tile or Tile(str(scene), (0.0, 0.0))
        for index in members:
            bands = result[index].tile or of_band
            first = best.first + best.pixel * (np.array(bands.first) - of_band.first)
            tile = Tile(composite.scene, (float(first[0]), float(first[1])), composite.size, best.pixel)
            result[index] = replace(result[index], tile=tile)
    return result


def join_named_bands(images: Sequence[Image], groups: Sequence[Sequence[str]]) -> list[Image]:
    """Return the images; those of a group of ids that are bands or windows of one exposure become tiles of it."""
    by_id = {image.id: image for image in images}
    for group in groups:
        by_id |= {image.id: image for image in join_bands([by_id[name] for name in group if name in by_id], 0.0)}
    return list(by_id.values())


def _find_scene(image: Image) -> Tile:
    """Return the scene of an image: its own area if it is not a tile."""
    _, last_sample, _, last_line = image.domain_px
    return image.tile or Tile(image.id, (0.0, 0.0), (int(np.ceil(last_sample)) + 1, int(np.ceil(last_line)) + 1))


def _relate_band(images: Sequence[Image], fine: int, band: int) -> _Relation | None:
    """Return the position of a band in the scene of a finer image; None if it is not a band of that exposure."""
    one, second = images[fine], images[band]
    heights = np.repeat(np.linspace(*one.rpc.height_range, 3), GRIDS.nodes**2)
    xy = np.tile(one.grid_px(GRIDS.nodes, GRIDS.nodes), (3, 1))
    ground, converged = one.rpc.localize(xy, heights)
    projected = second.rpc.project(ground)
    inside = converged & (np.abs(projected - second.centre_px) <= second.half_size_px + 0.5).all(axis=1)
    if inside.sum() < 3 * SAMPLES.tested:
        return None
    xy, projected, heights = xy[inside], projected[inside], heights[inside] - heights[inside].mean()
    # Unknowns for each coordinate: its shift, the common scale, and the parallax by height
    zero, unit = np.zeros(len(xy)), np.ones(len(xy))
    design = np.concatenate(
        [
            np.column_stack([unit, zero, projected[:, 0], heights, zero]),
            np.column_stack([zero, unit, projected[:, 1], zero, heights]),
        ]
    )
    right = xy.T.ravel()
    parameters = np.linalg.lstsq(design, right, rcond=None)[0]
    pixel = float(parameters[2])
    deviation = float(np.abs(design @ parameters - right).max())
    if not (
        deviation <= BANDS.bent_px * pixel and np.hypot(*parameters[3:]) * compute_gsds_m([one])[0] <= BANDS.parallax
    ):
        return None
    scene = _find_scene(one)
    return _Relation(
        scene.pixel * pixel, int(inside.sum()), np.array(scene.first) + scene.pixel * parameters[:2], fine, band
    )


def _may_be_one_exposure(one: Image, second: Image) -> bool:
    """Return whether two images can be of one exposure according to names, sensors and places."""
    if one.sensor and second.sensor and one.sensor != second.sensor:
        return False
    a, b = one.rpc, second.rpc
    apart_deg = abs((a.long_off - b.long_off + 180.0) % 360.0 - 180.0)
    if apart_deg > a.long_scale + b.long_scale or abs(a.lat_off - b.lat_off) > a.lat_scale + b.lat_scale:
        return False
    catalogue = [set(_CATALOGUE.findall(image.id.upper())) for image in (one, second)]
    if all(catalogue) and catalogue[0].isdisjoint(catalogue[1]):
        return False
    times: list[list[datetime]] = [[], []]
    for image, first in zip((one, second), times, strict=True):
        for dates, form in product(_TIME.findall(image.id), ("%y%b%d%H%M%S", "%Y%m%d%H%M%S")):
            with suppress(ValueError):
                first.append(datetime.strptime(dates, form))
    return not all(times) or abs((times[0][0] - times[1][0]).total_seconds()) <= BANDS.apart_s


def find_passes(images: Sequence[Image]) -> list[np.ndarray]:
    """Return the indices of the images of each pass: of one sensor, with the same start time to the second.

    The frames and detectors of a pass are numbered in their names; they share the errors of orbit and attitude.
    """
    passes: dict[tuple[str, ...], list[int]] = {}
    for index, image in enumerate(images):
        time = _PASS.search(image.id)
        sensor = find_image_sensor(image) if time is not None else None
        if time is not None and sensor is not None:
            key = sensor.title, re.sub(r"\D", "", time.group()), *_CATALOGUE.findall(image.id.upper())
            passes.setdefault(key, []).append(index)
    return [np.array(numbers) for numbers in passes.values() if len(numbers) > 1]


@thresholds
class STRIP:
    """Conditions for images to be parts of one strip, and limits for the fit of the strip's RPC."""

    bent_px: float = threshold(2.0, "px", "largest variation of the offset between two parts in their overlap")
    whole_px: float = threshold(0.25, "px", "largest offset of a part from whole pixels without a message")
    rounds: int = threshold(8, "rounds", "iterations that reduce the largest residual", "WorldView-1, two parts")


class StripPlaces(NamedTuple):
    """First pixel of each part in the strip ``(n, 2)`` int, size of the strip, deviation from whole pixels ``(n,)``."""

    first: np.ndarray
    size: tuple[int, int]
    off_px: np.ndarray


class StripRpc(NamedTuple):
    """RPC of a strip, its differences from each part (largest and RMS, px, ``(n,)``), and the grid it was fitted to."""

    rpc: RPC
    max_px: np.ndarray
    rms_px: np.ndarray
    ground: np.ndarray
    image: np.ndarray


def place_parts(parts: Sequence[Image]) -> StripPlaces:
    """Return the positions of parts in their strip; (0, 0) is the smallest sample and line of all parts.

    Raises `InputError` for a part that has no common ground with the others, or another pixel grid.
    """
    result: dict[int, np.ndarray] = {0: np.zeros(2)}
    scenes = {None if part.tile is None or part.camera_pixel != 1.0 else part.tile.scene for part in parts}
    if len(scenes) == 1 and None not in scenes:
        result = {number: np.array(part.tile.first) for number, part in enumerate(parts) if part.tile is not None}
    last, reached = 0, dict[int, tuple[int, np.ndarray]]()  # common nodes and position of the parts reached
    while len(result) < len(parts):
        for number in set(range(len(parts))) - set(result):
            nodes, offset = _measure_offset(parts[last], parts[number])
            if nodes > reached.get(number, (0,))[0]:
                reached[number] = nodes, result[last] + offset
        if not reached:
            missing = next(part.id for number, part in enumerate(parts) if number not in result)
            raise InputError(
                f"{missing} has no common ground with the other parts and is not adjacent to them: remove it"
            )
        last = max(reached, key=lambda number: reached[number][0])
        result[last] = reached.pop(last)[1]
    places = np.array([result[number] for number in range(len(parts))])
    rounded = np.rint(places).astype(np.int64)
    first = rounded - rounded.min(axis=0)
    end = (first + [part.known_size for part in parts]).max(axis=0)
    return StripPlaces(first, (int(end[0]), int(end[1])), np.abs(places - rounded).max(axis=1))


def _measure_offset(frame: Image, part: Image) -> tuple[int, np.ndarray]:
    """Return the number of common nodes, and the position ``(2,)`` of a part's first pixel in another part."""
    xy = part.grid_px(GRIDS.fine, GRIDS.fine)
    ground, converged = part.rpc.localize(xy, part.middle_height_m)
    offset_px = frame.rpc.project(ground)
    reach = (0.5 + EQUALITY.negligible) * np.array(frame.known_size)
    inside = converged & (np.abs(offset_px - frame.centre_px) <= reach).all(axis=1)
    offsets = (offset_px - xy)[inside]
    if not len(offsets):
        return 0, np.zeros(2)
    if np.ptp(offsets, axis=0).max() > STRIP.bent_px:
        raise InputError(
            f"{part.id} and {frame.id} are not parts of one strip: in their overlap the offset of their pixels changes "
            f"by {np.ptp(offsets, axis=0).max():.3g} px. Name images of one acquisition with the same pixel grid"
        )
    return len(offsets), np.median(offsets, axis=0)


def fit_strip(parts: Sequence[Image], first: np.ndarray) -> StripRpc:
    """Return the RPC of a strip from its parts at ``first``; exact if they have one RPC, else fitted.

    Raises `SolveError` if an RPC has no ground positions for its part.
    """
    rpc_fit, checked = (
        [_make_grid(parts, first, number, shape) for number in range(len(parts))] for shape in (FIT.grid, CHECK_GRID)
    )
    points, check = (
        (np.concatenate([grid[0] for grid in grids]), np.concatenate([grid[1] for grid in grids]))
        for grids in (rpc_fit, checked)
    )
    rpc = parts[0].rpc.shift(*first[0].astype(float))
    if _measure_apart(rpc, *check).max() > EQUALITY.file_px:
        fit = best_fit(points, check)
        rpc, largest_px, weights = fit.rpc, fit.max_px, np.ones(len(points[0]))
        residual_px = _measure_apart(rpc, *points)
        # Of the weighted fits, use the one with the smallest maximum difference at the check points
        for _ in range(STRIP.rounds if largest_px > EQUALITY.rpc_px else 0):
            weights *= residual_px / residual_px.max() + EQUALITY.negligible
            weighted = fit_rpc(*points, weights=weights, ridge=fit.ridge).rpc
            residual_px = _measure_apart(weighted, *points)
            if (worst := float(_measure_apart(weighted, *check).max())) < largest_px:
                rpc, largest_px = weighted, worst
    errors = {name: [getattr(part.rpc, name) for part in parts] for name in ("err_bias", "err_rand")}
    stated_errors = {name: max(values) for name, values in errors.items() if None not in values}
    off_px = [_measure_apart(rpc, *grid) for grid in checked]
    largest = [one.max(initial=0.0) for one in off_px]  # 0 for a part that is covered completely by later ones
    rms = [np.sqrt(np.mean(one**2)) if len(one) else 0.0 for one in off_px]
    return StripRpc(replace(rpc, **stated_errors), np.array(largest), np.array(rms), *points)


def _make_grid(
    parts: Sequence[Image], first: np.ndarray, number: int, shape: tuple[int, int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return ground points ``(n, 3)`` and strip coordinates ``(n, 2)`` of the part not covered by later ones."""
    part = parts[number]
    image, (ground, converged) = make_virtual_grid(part.rpc, part.domain_px, part.rpc.height_range, shape)
    image = image + first[number]
    for later, place in zip(parts[number + 1 :], first[number + 1 :], strict=True):
        converged = converged & ((image < place) | (image >= place + later.known_size)).any(axis=1)
    return ground[converged], image[converged]


def _measure_apart(rpc: RPC, ground: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Return the distances ``(n,)`` in px of image points from the projections of their ground points."""
    return np.asarray(np.hypot(*(rpc.project(ground) - image).T))
