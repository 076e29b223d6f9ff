"""Typical mistakes in coordinates and datums: the correction, the message and the advice for each.

A mistake is corrected and the points are fitted again: it explains the misfit if all of them fit then. Mistakes in
image coordinates may concern only the images that do not fit.
"""

import contextlib
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import pyproj
from pyproj.aoi import AreaOfInterest
from pyproj.enums import PJType

from ..block.block import Image
from ..camera.rpc import RPC
from ..camera.rpc_terms import EVALUATION
from ..foundation.errors import InputError
from ..foundation.thresholds import GROUND
from ..ground.crs_operations import operations_of
from ..ground.geodesy import metres_per_degree, wrap_degrees
from ..ground.geoids import GEOID, GEOID_GRIDS, geoid_heights
from ..ground.map_crs import UPS_NORTH, UPS_SOUTH, map_epsg, utm_zone
from .control import ControlMeasurements

FEET_M = 0.3048
#: Units of heights that files do not state, in metres.
UNSTATED_UNITS_M = {"feet": FEET_M, "decimetres": 0.1, "centimetres": 0.01}
DEGREES, WEB_MERCATOR = 4326, 3857  # EPSG codes


@dataclass(frozen=True)
class Mistake:
    """A typical input error: the code of its reason, what is wrong, and what to do.

    burden : cost added for an error with parameters estimated from the data, against one without
    length : scale of the image coordinates after correction: shorter ones fit more easily
    """

    code: str
    what: str
    advice: str
    burden: float = 0.0
    length: float = 1.0


# ---- image coordinates ---------------------------------------------------------------------------------------------

UndoPixels = Callable[[np.ndarray, Image], np.ndarray]


def _mirror_axis(xy: np.ndarray, image: Image, axis: int) -> np.ndarray:
    """Return coordinates ``(n, 2)`` mirrored at the image's middle along an axis: 0 sample, 1 line."""
    turned = xy.copy()
    turned[:, axis] = 2.0 * image.centre_px[axis] - xy[:, axis]
    return turned


def _turn_image(xy: np.ndarray, image: Image, quarters: int) -> np.ndarray:
    """Return the coordinates ``(n, 2)`` in the original of an image that is a copy rotated clockwise by quarters."""
    across, down = (2.0 * image.centre_px) if quarters % 2 == 0 else (2.0 * image.centre_px)[::-1]
    sample, line = xy.T
    turned = {1: (line, across - sample), 2: (across - sample, down - line), 3: (down - line, sample)}
    return np.column_stack(turned[quarters])


def _exchange_fields(rpc: RPC, names: tuple[str, str]) -> RPC:
    return replace(
        rpc, **{name: getattr(rpc, source_name) for name, source_name in zip(names, reversed(names), strict=True)}
    )


SCALES = (
    (2.0, "twice as large"),
    (3.0, "three times as large"),
    (4.0, "four times as large"),
    (0.5, "half as large"),
    (1.0 / 3.0, "a third as large"),
    (0.25, "a quarter as large"),
)

#: Input errors of image coordinates; each with the function that corrects them for ``xy (n, 2)`` of an image.
PIXEL_MISTAKES: tuple[tuple[Mistake, UndoPixels], ...] = (
    (Mistake("image-axes", "sample and line are exchanged", "exchange the columns sample and line"),
     lambda xy, image: xy[:, ::-1]),
    (Mistake("image-axes", "lines are counted from below", "subtract the lines from the image's last line"),
     lambda xy, image: _mirror_axis(xy, image, 1)),
    (Mistake("image-axes", "lines are negative, counted upwards", "change the sign of the lines"),
     lambda xy, image: xy * [1.0, -1.0]),
    (Mistake("image-axes", "samples are counted from the right", "subtract the samples from the last sample"),
     lambda xy, image: _mirror_axis(xy, image, 0)),
    *((Mistake("image-axes", f"image coordinates belong to a copy rotated by {90 * quarters} degrees",
               "measure on the image with the orientation of its RPC, or rotate the coordinates back"),
       partial(_turn_image, quarters=quarters)) for quarters in (1, 2, 3)),
    *((Mistake("image-scale", f"image coordinates belong to an image with pixels {text}",
               "measure on the image itself, or multiply the coordinates", length=factor),
       partial(lambda xy, image, factor: (xy + 0.5) * factor - 0.5, factor=factor))  # the corners of both coincide
      for factor, text in SCALES),
)  # fmt: skip
#: Input errors of RPC fields; each with the function that corrects them.
RPC_MISTAKES: tuple[tuple[Mistake, Callable[[RPC], RPC]], ...] = tuple(
    (
        Mistake("rpc-order", f"{names[0].upper()} and {names[1].upper()} of the RPC are exchanged", "exchange them"),
        partial(_exchange_fields, names=names),
    )
    for names in (("line_scale", "samp_scale"), ("lat_scale", "long_scale"))
)


# ---- ground coordinates --------------------------------------------------------------------------------------------

GroundHypothesis = tuple[Mistake, np.ndarray]


def iterate_ground_mistakes(
    control: ControlMeasurements, shift_m: np.ndarray, suspicious_shift: bool
) -> Iterator[GroundHypothesis]:
    """Yield the input errors of ground coordinates, each with the corrected points ``(n, 3)``.

    shift_m : (images, 2) shifts of the images with the coordinates as given, east and north
    suspicious_shift : True if datums are tested too
    """
    ground = control.ground
    expected = np.nanmedian(control.sights.ground, axis=0)
    yield from _iterate_axis_exchanges(ground)
    yield from _iterate_angular_units(ground, expected)
    yield from _iterate_zones(ground, expected)
    yield from _iterate_hemispheres(ground, expected)
    yield from _iterate_projections(ground, expected)
    yield from _iterate_height_mistakes(control, shift_m)
    if suspicious_shift:
        yield from _iterate_datums(ground, expected)


def _iterate_axis_exchanges(ground: np.ndarray) -> Iterator[GroundHypothesis]:
    exchanged, remedy = "longitude and latitude are exchanged", "exchange the columns of the ground points"
    yield Mistake("lon-lat-swapped", exchanged, remedy), ground[:, [1, 0, 2]]
    for code, message, signs in (
        ("lon-lat-sign", "the longitude has the wrong sign", [-1.0, 1.0, 1.0]),
        ("lon-lat-sign", "the latitude has the wrong sign", [1.0, -1.0, 1.0]),
        ("lon-lat-sign", "longitude and latitude have the wrong sign", [-1.0, -1.0, 1.0]),
    ):
        yield Mistake(code, message, "change the sign: east and north are positive"), ground * signs
    for signs in ([-1.0, 1.0, 1.0], [1.0, -1.0, 1.0]):
        message, advice = f"{exchanged} and one has the wrong sign", f"{remedy}; east and north are positive"
        yield Mistake("lon-lat-swapped", message, advice), ground[:, [1, 0, 2]] * signs


def _iterate_angular_units(ground: np.ndarray, expected: np.ndarray) -> Iterator[GroundHypothesis]:
    """Yield longitudes and latitudes in an angular unit other than degrees, where the conversion brings them near."""
    sign, size = np.sign(ground[:, :2]), np.abs(ground[:, :2])
    whole_degrees, digits = np.floor(size + 1e-9), 100.0 * (size - np.floor(size + 1e-9))
    minutes = np.floor(digits + 1e-7)
    for unit, degrees in (
        ("in radians", np.degrees(size)),
        ("in gon", 0.9 * size),
        ("degrees and minutes (43.3150 for 43° 31.50')", whole_degrees + digits / 60.0),
        (
            "degrees, minutes and seconds (43.3130 for 43° 31' 30\")",
            whole_degrees + minutes / 60.0 + (digits - minutes) * 100.0 / 3600.0,
        ),
    ):
        converted = np.column_stack([sign * degrees, ground[:, 2]])
        if np.abs(wrap_degrees(np.median(converted[:, :2], axis=0) - expected[:2])).max() < 1.0:
            yield (
                Mistake("angular-unit", f"longitude and latitude are {unit}, not degrees", "give decimal degrees"),
                converted,
            )


def _iterate_zones(ground: np.ndarray, expected: np.ndarray) -> Iterator[GroundHypothesis]:
    """Yield UTM or 3 degree zones read as another zone: zones are congruent, so that only the longitude changes."""
    difference_deg = float(np.median(wrap_degrees(ground[:, 0] - expected[0])))
    advice = "correct the CRS of the ground points (`ground_crs`, or that of the layer)"
    for width, kind, burden in ((6.0, "UTM", 0.0), (3.0, "3 degree", 1.0)):
        zones = round(difference_deg / width)
        if zones and abs(zones) < 20:
            shifted = ground.copy()
            shifted[:, 0] = wrap_degrees(ground[:, 0] - zones * width)
            message = f"the {kind} zone is {abs(zones)} too far {'east' if zones > 0 else 'west'}"
            yield Mistake("other-projection", message, advice, burden), shifted


def _iterate_hemispheres(ground: np.ndarray, expected: np.ndarray) -> Iterator[GroundHypothesis]:
    """Yield northings of one hemisphere read as those of the other, with the right zone or a neighbouring one."""
    if not (np.abs(ground[:, 1]) < 90.0).all():
        return
    utm = utm_zone(float(expected[0]), float(expected[1]))
    for zone, south in itertools.product((utm, utm % 60 + 1, (utm - 2) % 60 + 1), (False, True)):
        moved = _reproject_misread(ground, *((32700 + zone, 32600 + zone) if south else (32600 + zone, 32700 + zone)))
        if moved is None:
            continue
        # the zone may be wrong too: zones are congruent, so that only the longitude changes
        zones = (zone - utm + 30) % 60 - 30
        moved[:, 0] = wrap_degrees(moved[:, 0] - 6.0 * zones)
        zone_text = f" and the zone is {abs(zones)} too far {'east' if zones > 0 else 'west'}" if zones else ""
        advice = "correct the CRS of the ground points (EPSG:326xx north, EPSG:327xx south)"
        yield Mistake("other-projection", f"the UTM zone belongs to the wrong hemisphere{zone_text}", advice), moved


def _iterate_projections(ground: np.ndarray, expected: np.ndarray) -> Iterator[GroundHypothesis]:
    """Yield coordinates read in another CRS than their own: Web Mercator (of web maps), UTM or UPS, and degrees."""
    if not (np.abs(ground[:, 1]) < 90.0).all():
        return
    utm = map_epsg(float(expected[0]), float(expected[1]))
    utm_name = f"{'UPS' if utm in (UPS_SOUTH, UPS_NORTH) else 'UTM'} (EPSG:{utm})"
    names = {WEB_MERCATOR: "Web Mercator", utm: utm_name, DEGREES: "degrees of longitude and latitude"}
    for read, true_crs in ((utm, WEB_MERCATOR), (WEB_MERCATOR, utm), (utm, DEGREES), (WEB_MERCATOR, DEGREES)):
        reprojected = _reproject_misread(ground, read, true_crs)
        if reprojected is not None:
            message = f"the ground points are in {names[true_crs]} but were read as {names[read]}"
            yield Mistake("other-projection", message, f"give their CRS: `ground_crs` EPSG:{true_crs}"), reprojected


def _reproject_misread(ground: np.ndarray, read: int, meant: int) -> np.ndarray | None:
    """Return points ``(n, 3)`` of CRS ``meant`` (EPSG) that were read in CRS ``read``; None if that is impossible."""
    try:
        there = operations_of(f"EPSG:{read}").from_wgs84(ground)
        if meant == DEGREES and not (np.abs(there) <= [180.0, 90.0]).all():
            return None
        moved = operations_of(f"EPSG:{meant}").to_wgs84(np.column_stack([there, ground[:, 2]]))
    except InputError:
        return None
    return moved if np.isfinite(moved).all() else None


def describe_height_unit(metres: np.ndarray, heights: np.ndarray) -> str:
    """Return the unit in which heights (n,) of a raster agree with those in metres (n,), and how to state it; or ""."""
    for unit, factor in {"": 1.0, **UNSTATED_UNITS_M}.items():
        if np.nanmedian(np.abs(metres - factor * heights)) < GROUND.margin_m:
            state_it = f"state it in the file with gdal_edit.py -scale {factor:g}"
            return f"they agree if these are in {unit}: {state_it}" if unit else ""
    return ""


def _iterate_height_mistakes(control: ControlMeasurements, shift_m: np.ndarray) -> Iterator[GroundHypothesis]:
    """Yield heights in feet, of another datum, and with one error common to all."""
    ground, heights = control.ground, "the heights of the ground points"
    for factor, message in (
        (FEET_M, "are in feet"),
        (1.0 / FEET_M, "were converted from feet although they were in metres"),
    ):
        yield (Mistake("height-unit", f"{heights} {message}", "give heights in metres"), ground * [1.0, 1.0, factor])
    undulations = find_undulations(ground)
    if undulations is not None:  # geoid models differ by less than images resolve: any is used
        name, undulation = undulations
        middle = float(np.median(undulation))
        up = np.column_stack([np.zeros((len(ground), 2)), undulation])
        advice = "give their height datum: `height_datum`"
        message = f"{heights} refer to the geoid (undulation {middle:+.1f} m) and not to the ellipsoid"
        yield Mistake("height-datum", message, f"{advice} {name}"), ground + up
        message = f"{heights} are ellipsoidal but were converted as heights above the geoid ({middle:+.1f} m)"
        yield Mistake("height-datum", message, f"{advice} ellipsoidal"), ground - up
    lift, _ = estimate_common_lift(control, shift_m)
    if _leaves_height_range(control, lift):
        return
    message = f"{heights} are {abs(lift):.0f} m too {'high' if lift > 0.0 else 'low'}"
    advice = "check height datum and unit"
    yield Mistake("height-offset", message, advice, 8.0), ground - [0.0, 0.0, lift]


def _leaves_height_range(control: ControlMeasurements, lift_m: float) -> bool:
    """Return whether heights within the RPCs' height range would leave it with a lift removed.

    The height range of an RPC is that of its ground. One image moved under its RPC, such as a crop, looks like a
    lift of kilometres.
    """
    rpcs = [control.block.images[index].rpc for index in control.image]
    middle, half = (np.array([getattr(rpc, name) for rpc in rpcs]) for name in ("height_off", "height_scale"))
    before, after = (np.median(np.abs(control.ground[:, 2] - move - middle) / half) for move in (0.0, lift_m))
    return bool(before < EVALUATION.domain_margin < after)


def estimate_common_lift(control: ControlMeasurements, shift_m: np.ndarray) -> tuple[float, float]:
    """Return by how much all surveyed heights are too high, from the images' shifts, with standard deviation, in m.

    Heights too high by h shift every image by h times the slope of its rays. The RPCs' errors are modelled with one
    standard deviation for each image and the same for a part common to all (images of one pass).

    shift_m : (images, 2) east, north
    """
    rows, right, sigma = [], [], []
    for index in control.images:
        slope = np.median(control.sights.slope[control.image == index], axis=0)
        for axis in (0, 1):
            unit = np.zeros(3)
            unit[axis], unit[2] = 1.0, slope[axis]
            rows.append(unit)
            right.append(shift_m[index, axis])
            sigma.append(control.accuracies[index].sigma_m)
    matrix, weight = np.array(rows), 1.0 / np.array(sigma) ** 2
    normal = (matrix.T * weight) @ matrix
    normal[0, 0] += weight.mean()
    normal[1, 1] += weight.mean()
    if not np.isfinite(normal).all():  # rays without a slope: far outside an RPC's area
        return 0.0, np.inf
    inverse = np.linalg.pinv(normal)
    solved = inverse @ (matrix.T * weight) @ np.array(right)
    return float(solved[2]), float(np.sqrt(max(inverse[2, 2], 0.0)))


def find_undulations(ground: np.ndarray) -> tuple[str, np.ndarray] | None:
    """Return the name of an installed geoid model and its undulations ``(n,)`` at ``ground``, m; None without one."""
    if not len(ground) or not (np.abs(ground[:, 1]) <= 90.0).all():
        return None
    for name in GEOID_GRIDS:
        with contextlib.suppress(InputError):
            return name, geoid_heights(ground, name)
    return None


def _iterate_datums(ground: np.ndarray, expected: np.ndarray) -> Iterator[GroundHypothesis]:
    """Yield the points moved by the difference of each datum in use at the place from WGS84, in either direction."""
    degrees = 1.0 / metres_per_degree(expected[None])[0]
    place = round(float(wrap_degrees(expected[0])), 1), round(float(expected[1]), 1)
    for sign, said in (
        (1.0, "refer to {} but are used as WGS84"),
        (-1.0, "were converted from {} although they were WGS84"),
    ):
        for datum in find_datum_shifts(*place):
            step = sign * np.array([datum.east_m, datum.north_m, 0.0])
            message = f"the ground points {said.format(datum.name)} ({np.hypot(*step[:2]):.0f} m there)"
            advice = "give the actual CRS of the coordinates"
            yield Mistake("horizontal-datum", message, advice, 4.0), ground + step * degrees


# ---- datums --------------------------------------------------------------------------------------------------------


class DatumShift(NamedTuple):
    """Offset in metres east and north from the position with the coordinates read as WGS84 to the true position."""

    name: str
    east_m: float
    north_m: float


@lru_cache(maxsize=16)
def find_datum_shifts(lon_deg: float, lat_deg: float) -> tuple[DatumShift, ...]:
    """Return the datums in use at a place, and their UTM systems, that differ measurably from WGS84 (`DATUM`).

    The shift is that of longitude and latitude in the datum, or of coordinates in its UTM system, read as WGS84.
    """
    area = AreaOfInterest(lon_deg - 0.01, lat_deg - 0.01, lon_deg + 0.01, lat_deg + 0.01)
    place = np.array([[lon_deg, lat_deg, 0.0]])
    factors, shifts = metres_per_degree(place)[0], []
    for kind in (PJType.GEOGRAPHIC_2D_CRS, PJType.PROJECTED_CRS):
        for info in pyproj.database.query_crs_info(
            auth_name="EPSG", pj_types=kind, area_of_interest=area, contains=True
        ):
            projected = kind is PJType.PROJECTED_CRS
            if projected and ("UTM zone" not in info.name or info.name.startswith("WGS 84 /")):
                continue
            with contextlib.suppress(InputError):
                coordinates = (
                    operations_of(f"EPSG:{map_epsg(lon_deg, lat_deg)}").from_wgs84(place) if projected else place
                )
                numbers = np.column_stack([coordinates[:, :2], [0.0]])
                lon, lat, _ = operations_of(f"EPSG:{info.code}").to_wgs84(numbers)[0]
                east, north = wrap_degrees(np.array(lon - lon_deg)) * factors[0], (lat - lat_deg) * factors[1]
                if np.hypot(east, north) > GEOID.smallest_difference_m:
                    shifts.append(DatumShift(info.name, float(east), float(north)))
    return tuple(shifts)
