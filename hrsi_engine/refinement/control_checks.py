"""Checks of an image's GCPs: errors and warnings that name the points.

An error where no result is possible (no point, no number, longitude and latitude swapped, another part of the world), a
warning where the points do not determine a model: on a line, at one place. Implausible inputs (heights in feet, points
outside the image) are found by `plausibility`.
"""

from collections.abc import Callable
from itertools import islice

import numpy as np

from ..block.block import Image
from ..foundation.errors import InputError, list_ids
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import distances_m, ground_difference_m
from .estimate import Control
from .ground_area import compute_ground_area


@thresholds
class CONTROL:
    """When GCPs of an image cannot be right, or do not determine it."""

    farthest_m: float = threshold(300e3, "m", "from an image: 120 km by attitude, at most", "0.1 rad from 800 km")
    same_place_m: float = threshold(0.05, "m", "GCPs nearer than this count as one")
    least_width: float = threshold(0.03, "", "spread of the GCPs across their line, over that along it")


def check_control(image: Image, control: Control) -> list[str]:
    """Return warnings about the control of an image. Raises `InputError` that names the points."""
    if not len(control):
        raise InputError(f"{image.id}: no GCP is measured on it: measure one, name its image file, or leave it out")
    finite = finite_rows(control.ground) & finite_rows(control.xy)
    sigmas = (control.sigma_px > 0.0) & (control.sigma_m > 0.0).all(axis=1)
    if not finite.all():
        raise InputError(f"{image.id}: GCP {list_ids(control.ids[~finite])} has no number as coordinate: complete it")
    if not sigmas.all():
        raise InputError(
            f"{image.id}: GCP {list_ids(control.ids[~sigmas])} has a sigma that is not above 0: correct it"
        )
    ids, count = np.unique(control.ids, return_counts=True)
    if (count > 1).any():
        raise InputError(
            f"{image.id}: GCP {list_ids(ids[count > 1])} is given more than once: keep one measurement of it"
        )
    wild = (np.abs(control.ground[:, 0]) > 540.0) | (np.abs(control.ground[:, 1]) > 90.0)
    if wild.any() and not _has_swapped_axes(image, control.ground)[wild].all():
        raise InputError(
            f"{image.id}: GCP {list_ids(control.ids[wild])} is at no longitude and latitude "
            f"({control.ground[wild][0, 0]:g}, {control.ground[wild][0, 1]:g}): give degrees, or the CRS of the layer"
        )
    swapped = _has_swapped_axes(image, control.ground)
    if swapped.any():
        raise InputError(
            f"{image.id}: longitude and latitude of GCP {list_ids(control.ids[swapped])} are swapped: exchange them"
        )
    distance = _compute_distance_m(image, control.ground)
    far = distance > CONTROL.farthest_m
    if far.any():
        raise InputError(
            f"{image.id}: GCP {list_ids(control.ids[far])} lies {distance[far].max() / 1e3:.0f} km from the image: "
            "check its coordinates and the CRS"
        )
    return [warning for check in WARNINGS for warning in check(image, control)]


def _compute_distance_m(image: Image, ground: np.ndarray) -> np.ndarray:
    middle = np.broadcast_to(compute_ground_area(image).middle, ground.shape)
    return np.linalg.norm(ground_difference_m(ground, middle)[:, :2], axis=1)


def _has_swapped_axes(image: Image, ground: np.ndarray) -> np.ndarray:
    """Return which points are near the image only with longitude and latitude exchanged, ``(n,)`` bool."""
    return (_compute_distance_m(image, ground) > CONTROL.farthest_m) & (
        _compute_distance_m(image, ground[:, [1, 0, 2]]) < CONTROL.farthest_m
    )


# ---- warnings ------------------------------------------------------------------------------------------------------


def _warn_of_same_place(image: Image, control: Control) -> list[str]:
    first, second = np.triu_indices(len(control), 1)
    near = distances_m(control.ground[first], control.ground[second]) < CONTROL.same_place_m
    pairs = zip(first[near], second[near], strict=True)
    return [
        f"{image.id}: GCPs {control.ids[first]} and {control.ids[second]} are at the same place: they count as one"
        for first, second in islice(pairs, 8)
    ]


def _warn_of_alignment(image: Image, control: Control) -> list[str]:
    if len(control) < 3:
        return []
    along, across = np.linalg.svd(control.xy - control.xy.mean(axis=0), compute_uv=False)
    if across > CONTROL.least_width * along:
        return []
    where = "at one place" if along < CONTROL.least_width * float(np.hypot(*image.half_size_px)) else "on a line"
    return [
        f"{image.id}: the GCPs {list_ids(control.ids)} lie {where}: they tell nothing of the rest of the image; "
        "spread them, or trust a shift only"
    ]


WARNINGS: tuple[Callable[[Image, Control], list[str]], ...] = (_warn_of_same_place, _warn_of_alignment)
