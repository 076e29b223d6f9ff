"""Images of one exposure: parts of a strip, and bands, that a vendor delivers as images of their own, with an RPC each.

They have one pointing and one drift over the strip's lines, and count as one look: as images of their own their errors
would be taken for independent. Names tell which images may be parts (an order's product with its part, P001 P002 …),
and the RPCs decide: parts are windows of the same pixels (`block.strips`).

Bands (PAN, MS, SWIR) have equal lines of sight and larger pixels. Where the ground that pixels of the panchromatic
image see, high and low, lies in the band at a shift and a scale of their positions, it is the same exposure: the
camera of another day would turn or stretch them. A parallax is left to it, for detectors of bands lie side by side in
the focal plane. Names that tell of another time, and another satellite, exclude it.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..foundation.errors import InputError
from ..foundation.thresholds import threshold, thresholds
from .block import Image, Tile
from .pointing import compute_gsds_m, find_image_sensor
from .strips import STRIP, place_parts

#: Number of a part at the end of a product's name, and the time before it, which differs from part to part.
_PART = re.compile(r"[_-][RP]\d{1,3}(?:C\d{1,3})?$", re.IGNORECASE)
_TIME = re.compile(r"\d{2}[A-Z]{3}\d{8}|\d{14}", re.IGNORECASE)
#: Catalogue number of an exposure in names of DigitalGlobe and Maxar.
_CATALOGUE = re.compile(r"(?<![0-9A-F])10[1-9A-F]00[0-9A-F]{11}(?![0-9A-F])")

#: Second in which a pass began, in the names of its frames.
_PASS = re.compile(r"(?<!\d)\d{8}[_T]?\d{6}(?!\d)")


@thresholds
class BANDS:
    """What tells that two images are bands of one exposure."""

    least_pixel: float = threshold(1.5, "", "pixel of a band over that of a finer image of its exposure, at least")
    nodes: int = threshold(15, "nodes", "along each side of the finer image that are looked for in the other one")
    least_nodes: int = threshold(9, "nodes", "of a height that both images have to show")
    bent_px: float = threshold(0.5, "px", "of the band, by which positions may lie off a shift and a scale")
    parallax: float = threshold(
        0.005, "m/m", "of height between the lines of sight", "taken up to 0.4 s apart at 7.5 km/s from 600 km"
    )  # fmt: skip
    apart_s: float = threshold(60.0, "s", "between the times in names of one exposure, whose bands begin one by one")


def join_exposures(images: Sequence[Image]) -> list[Image]:
    """Return the images, those that are parts of one strip or bands of one exposure as tiles of it."""
    return join_bands(join_parts_of_strips(images))


def join_parts_of_strips(images: Sequence[Image]) -> list[Image]:
    """Return the images, those that are parts of one strip as tiles of it: then they have one camera."""
    products: dict[str, list[int]] = {}
    for index, image in enumerate(images):
        if image.tile is None and image.size is not None and _PART.search(image.id):
            products.setdefault(_TIME.sub("", _PART.sub("", image.id)), []).append(index)
    joined = list(images)
    for product, members in products.items():
        parts = [images[index] for index in members]
        if len(parts) < 2 or len({part.rpc for part in parts}) == 1:
            continue
        try:
            places = place_parts(parts)
        except InputError:  # images of one product that are no windows of the same pixels
            continue
        if places.off_px.max() > STRIP.whole_px or not _have_common_rays(parts, places.first):
            continue
        for index, first in zip(members, places.first.tolist(), strict=True):
            joined[index] = replace(images[index], tile=Tile(product, (first[0], first[1]), places.size))
    return joined


def _have_common_rays(parts: Sequence[Image], first: np.ndarray) -> bool:
    """Return whether parts at ``first (n, 2)`` see the same places where they meet, high and low."""
    order = np.lexsort((first[:, 0], first[:, 1]))
    for one, other in pairwise(order.tolist()):
        known, part = parts[one], parts[other]
        offset = (first[other] - first[one]).astype(np.float64)
        edge = part.centre_px + np.clip(
            known.centre_px - offset - part.centre_px, -part.half_size_px, part.half_size_px
        )
        for height in part.rpc.height_range:
            seen = known.rpc.project(part.rpc.localize(edge[None], height).ground)
            if not np.hypot(*(seen - edge - offset)[0]) <= STRIP.bent_px:
                return False
    return True


class _Relation(NamedTuple):
    """Where a band lies in the scene of a finer image: ``first + pixel * xy``; the nodes that tell so."""

    pixel: float
    nodes: int
    first: np.ndarray
    fine: int
    band: int


def join_bands(images: Sequence[Image], least_pixel: float = BANDS.least_pixel) -> list[Image]:
    """Return the images, those that are bands of a finer one as tiles of its scene: then they have one camera.

    least_pixel : pixel of a band over that of the finer image, at least; 0 where it is known that they belong together
    """
    gsd, joined = compute_gsds_m(images), list(images)
    order = np.argsort(gsd, kind="stable").tolist()
    if not order or gsd[order[-1]] < least_pixel * gsd[order[0]]:
        return joined
    scenes: dict[str | int, list[int]] = {}
    for index in order:
        tile = images[index].tile
        scenes.setdefault(index if tile is None else tile.scene, []).append(index)
    for scene, members in scenes.items():
        finer = order[: order.index(members[0])]
        found = [
            relation
            for fine in finer
            for band in members
            if fine not in members and least_pixel * gsd[fine] <= gsd[band]
            if least_pixel == 0.0 or _may_be_one_exposure(images[fine], images[band])
            if (relation := _relate_band(joined, fine, band)) is not None
        ]
        if not found:
            continue
        best = max(found, key=lambda relation: (round(relation.pixel, 1), relation.nodes))
        whole = _find_scene(joined[best.fine])
        joined[best.fine] = replace(joined[best.fine], tile=whole)
        of_band = joined[best.band].tile or Tile(str(scene), (0.0, 0.0))
        for index in members:
            own = joined[index].tile or of_band
            first = best.first + best.pixel * (np.array(own.first) - of_band.first)
            tile = Tile(whole.scene, (float(first[0]), float(first[1])), whole.size, best.pixel)
            joined[index] = replace(joined[index], tile=tile)
    return joined


def join_named_bands(images: Sequence[Image], groups: Sequence[Sequence[str]]) -> list[Image]:
    """Return the images, those of a group of ids that are bands or windows of one exposure as tiles of it."""
    joined = {image.id: image for image in images}
    for group in groups:
        named = [joined[name] for name in group if name in joined]
        joined |= {image.id: image for image in join_bands(named, 0.0)}
    return list(joined.values())


def _find_scene(image: Image) -> Tile:
    """Return the scene of an image, which is itself where it is no tile of one."""
    _, last_sample, _, last_line = image.domain_px
    return image.tile or Tile(image.id, (0.0, 0.0), (int(np.ceil(last_sample)) + 1, int(np.ceil(last_line)) + 1))


def _relate_band(images: Sequence[Image], fine: int, band: int) -> _Relation | None:
    """Return where a band lies in the scene of a finer image, None where it is none of that exposure."""
    one, other = images[fine], images[band]
    heights = np.repeat(np.linspace(*one.rpc.height_range, 3), BANDS.nodes**2)
    xy = np.tile(one.grid_px(BANDS.nodes, BANDS.nodes), (3, 1))
    ground, converged = one.rpc.localize(xy, heights)
    seen = other.rpc.project(ground)
    near = converged & (np.abs(seen - other.centre_px) <= other.half_size_px + 0.5).all(axis=1)
    if near.sum() < 3 * BANDS.least_nodes:
        return None
    xy, seen, heights = xy[near], seen[near], heights[near] - heights[near].mean()
    # of a coordinate: its shift, the scale that both share, and the parallax by height
    zero, unit = np.zeros(len(xy)), np.ones(len(xy))
    design = np.concatenate([
        np.column_stack([unit, zero, seen[:, 0], heights, zero]),
        np.column_stack([zero, unit, seen[:, 1], zero, heights]),
    ])  # fmt: skip
    right = xy.T.ravel()
    found = np.linalg.lstsq(design, right, rcond=None)[0]
    pixel = float(found[2])
    apart = float(np.abs(design @ found - right).max())
    if not (apart <= BANDS.bent_px * pixel and np.hypot(*found[3:]) * compute_gsds_m([one])[0] <= BANDS.parallax):
        return None
    scene = _find_scene(one)
    return _Relation(scene.pixel * pixel, int(near.sum()), np.array(scene.first) + scene.pixel * found[:2], fine, band)


def _may_be_one_exposure(one: Image, other: Image) -> bool:
    """Return whether neither names nor places exclude that two images are of one exposure."""
    if one.sensor and other.sensor and one.sensor != other.sensor:
        return False
    a, b = one.rpc, other.rpc
    apart_deg = abs((a.long_off - b.long_off + 180.0) % 360.0 - 180.0)
    if apart_deg > a.long_scale + b.long_scale or abs(a.lat_off - b.lat_off) > a.lat_scale + b.lat_scale:
        return False
    catalogue = [set(_CATALOGUE.findall(image.id.upper())) for image in (one, other)]
    if all(catalogue) and catalogue[0].isdisjoint(catalogue[1]):
        return False
    time, later = (_read_time_in_name(image.id) for image in (one, other))
    return time is None or later is None or abs((time - later).total_seconds()) <= BANDS.apart_s


def _read_time_in_name(name: str) -> datetime | None:
    """Return the time of an exposure in its name, None without one."""
    for found in _TIME.findall(name):
        for form in ("%y%b%d%H%M%S", "%Y%m%d%H%M%S"):
            with suppress(ValueError):
                return datetime.strptime(found, form)
    return None


def find_passes(images: Sequence[Image]) -> list[np.ndarray]:
    """Return the numbers of the images of each pass: of one sensor, and begun at one second by their names.

    Frames and detectors of a pass are numbered; they share the errors of the orbit and of the attitude.
    """
    found: dict[tuple[str, ...], list[int]] = {}
    for index, image in enumerate(images):
        time = _PASS.search(image.id)
        sensor = find_image_sensor(image) if time is not None else None
        if time is not None and sensor is not None:
            key = sensor.title, re.sub(r"\D", "", time.group()), *_CATALOGUE.findall(image.id.upper())
            found.setdefault(key, []).append(index)
    return [np.array(numbers) for numbers in found.values() if len(numbers) > 1]
