"""More kinds of wrong input, judged by the true errors of what they lead to: `wrong_inputs.py --true-errors` runs them.

Each kind spoils a right block as people do it. ``untold`` says why nothing in the block can show a kind; kinds without
it have to be noticed wherever they do harm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from osgeo import osr

from hrsi.benchmarks import wrong_inputs as made
from hrsi.benchmarks.wrong_inputs import Inputs, Spoil
from hrsi.hrsi_engine.block.block import ImagePoints, Role
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.ground.geoids import geoid_heights
from hrsi.hrsi_engine.ground.map_crs import map_epsg_of

#: Places by their number in `wrong_inputs.PLACES`.
PROVENCE, HOBART, CHILE, COLORADO, TURKEY, CHINA, CAPE = range(7)


class TrueKind(NamedTuple):
    """A kind of wrong input: how it is made, from which block, and why it cannot be told where it cannot."""

    name: str
    spoil: Spoil
    gcps: int = 8
    checks: int = 6
    images: int = 3
    place: int | None = None
    relief_m: float | None = None
    untold: str = ""


# ---- known points --------------------------------------------------------------------------------------------------


def _rows(inputs: Inputs, role: Role, count: int | None, rng: np.random.Generator) -> np.ndarray:
    rows = np.flatnonzero(inputs.ground.role == role)
    return rows if count is None else rng.permutation(rows)[:count]


def points_moved(
    role: Role, metres: tuple[float, float, float], pixels: float = 0.0, count: int | None = None, scatter: bool = False
) -> Spoil:
    """Known points of a role, some or all, moved alike or at random; at least by pixels of the image."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        step = np.array(metres)
        step *= max(1.0, pixels * inputs.gsd_m / np.linalg.norm(step))
        all_steps = np.zeros((len(inputs.ground), 3))
        rows = _rows(inputs, role, count, rng)
        all_steps[rows] = step * rng.standard_normal((len(rows), 3)) if scatter else step
        return inputs.with_ground(move_ground(inputs.ground.ground, all_steps))

    return spoil


def of_geoid(role: Role, every: int = 1) -> Spoil:
    """Heights above the geoid where the others are ellipsoidal."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        ground = inputs.ground.ground.copy()
        rows = _rows(inputs, role, None, rng)[::every]
        ground[rows, 2] -= geoid_heights(ground[rows], "egm96")
        return inputs.with_ground(ground)

    return spoil


def with_sigmas(plan_m: float, height_m: float, spoil: Spoil) -> Spoil:
    """Known points whose stated sigmas are others than their errors."""

    def spoil_and_state(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        spoilt = spoil(inputs, rng)
        sigma = np.tile([plan_m, height_m], (len(spoilt.ground), 1))
        return replace(spoilt, ground=replace(spoilt.ground, sigma_m=sigma))

    return spoil_and_state


def mapped(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Positions changed in metres east and north of their middle, and height."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        ground = inputs.ground.ground
        middle = np.broadcast_to(ground.mean(axis=0), ground.shape)
        away = ground_difference_m(ground, middle)
        away[:, 2] = ground[:, 2]
        changed = change(away.copy())
        return inputs.with_ground(move_ground(ground, changed - away))

    return spoil


def _turn(degrees: float, scale: float, away: np.ndarray) -> np.ndarray:
    c, s = scale * np.cos(np.radians(degrees)), scale * np.sin(np.radians(degrees))
    return np.column_stack([away[:, :2] @ np.array([[c, s], [-s, c]]), away[:, 2]])


def _lean(share: float, away: np.ndarray) -> np.ndarray:
    """Relief displacement of an orthoimage that was made on a plane."""
    return away + np.outer(share * (away[:, 2] - away[:, 2].mean()), [1.0, 0.0, 0.0])


def _tilt(away: np.ndarray) -> np.ndarray:
    return away + np.outer(away[:, 0] / np.ptp(away[:, 0]) * 40.0, [0.0, 0.0, 1.0])


def _round_heights(step_m: float, away: np.ndarray) -> np.ndarray:
    away[:, 2] = step_m * np.floor(away[:, 2] / step_m)
    return away


def degrees_as(unit: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Longitudes and latitudes in another angular unit."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        ground = inputs.ground.ground.copy()
        ground[:, :2] = unit(ground[:, :2])
        return inputs.with_ground(ground)

    return spoil


def _packed(seconds: bool, degrees: np.ndarray) -> np.ndarray:
    """Degrees, minutes and seconds as digits: 43 degrees 31.8 minutes are 43.318 or, with seconds, 43.3148."""
    sign, rest = np.sign(degrees), np.abs(degrees)
    whole = np.floor(rest)
    minutes = (rest - whole) * 60.0
    if not seconds:
        return np.asarray(sign * (whole + minutes / 100.0))
    return np.asarray(sign * (whole + np.floor(minutes) / 100.0 + (minutes % 1.0) * 60.0 / 10_000.0))


def _geocentric(degrees: np.ndarray) -> np.ndarray:
    latitude = np.degrees(np.arctan((1.0 - 0.00669437999014) * np.tan(np.radians(degrees[:, 1]))))
    return np.column_stack([degrees[:, 0], latitude])


def map_numbers(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Eastings and northings of the right zone whose numbers are changed."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        epsg = map_epsg_of(inputs.ground.ground)
        to_map, from_map = _transformations(epsg)
        xy = np.array(to_map.TransformPoints(inputs.ground.ground[:, :2].tolist()))[:, :2]
        wrong = np.array(from_map.TransformPoints(change(xy).tolist()))[:, :2]
        return inputs.with_ground(np.column_stack([wrong, inputs.ground.ground[:, 2]]))

    return spoil


def _transformations(epsg: int) -> tuple[osr.CoordinateTransformation, osr.CoordinateTransformation]:
    degrees, map_crs = osr.SpatialReference(), osr.SpatialReference()
    degrees.ImportFromEPSG(4326)
    map_crs.ImportFromEPSG(epsg)
    for crs in (degrees, map_crs):
        crs.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
    return osr.CoordinateTransformation(degrees, map_crs), osr.CoordinateTransformation(map_crs, degrees)


def to_corner(share: float, spoil: Spoil) -> Spoil:
    """GCPs in a corner of the block alone, then spoilt."""

    def spoil_there(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        ground = inputs.ground.ground
        rank = np.argsort(np.argsort(ground[:, 0] + ground[:, 1]))
        kept = (inputs.ground.role == Role.CHECK) | (rank < share * len(rank))
        names = inputs.ground.ids[~kept]
        fewer = replace(
            inputs, ground=inputs.ground.select(np.flatnonzero(kept)),
            measured=inputs.measured.select(~np.isin(inputs.measured.ids, names)),
        )  # fmt: skip
        return spoil(fewer, rng)

    return spoil_there


# ---- measurements --------------------------------------------------------------------------------------------------


def measured_off(
    role: Role, pixels: float, points: int | None = None, images: int | None = None, alike: bool = True
) -> Spoil:
    """Points of a role measured pixels off on some images or all, in one direction or each in its own."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        names = (
            inputs.ground.ids[_rows(inputs, role, points, rng)]
            if role != Role.TIE
            else np.unique(inputs.measured.ids[~inputs.of_gcps])
        )
        chosen = np.isin(inputs.measured.ids, names)
        if images is not None:
            chosen &= np.isin(inputs.measured.image_ids, [image.id for image in inputs.images[:images]])
        angle = rng.uniform(0.0, 2.0 * np.pi, 1 if alike else len(chosen))
        step = pixels * np.column_stack([np.cos(angle), np.sin(angle)])
        return inputs.with_xy(inputs.measured.xy + step, chosen)

    return spoil


def ties_of_one_pattern(share: float, pixels: float) -> Spoil:
    """Some tie points jump to the next furrow: the same step on the second image."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        names = np.unique(inputs.measured.ids[~inputs.of_gcps])
        wrong = rng.choice(names, round(share * len(names)), replace=False)
        rows = np.isin(inputs.measured.ids, wrong) & (inputs.measured.image_ids == inputs.images[1].id)
        return inputs.with_xy(inputs.measured.xy + pixels * np.array([0.6, 0.8]), rows)

    return spoil


def ties_shuffled_on_one_image(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    rows = ~inputs.of_gcps & (inputs.measured.image_ids == inputs.images[0].id)
    xy = inputs.measured.xy.copy()
    xy[rows] = rng.permutation(xy[rows])
    return inputs.with_xy(xy)


def ties_rounded(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    rows = ~inputs.of_gcps
    spoilt = inputs.with_xy(np.round(inputs.measured.xy / 4.0) * 4.0, rows)
    return replace(spoilt, measured=replace(spoilt.measured, sigma_px=np.where(rows, 0.1, spoilt.measured.sigma_px)))


def ties_in_corner(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    """Ties in a twentieth of the images alone, one in four of them wrong."""
    first = inputs.measured.image_ids == inputs.images[0].id
    corner = np.quantile(inputs.measured.xy[first], 0.2, axis=0)
    inside = first & (inputs.measured.xy < corner).all(axis=1)
    kept = inputs.of_gcps | np.isin(inputs.measured.ids, inputs.measured.ids[inside])
    return replace(inputs, measured=inputs.measured.select(kept))


def untied_image(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    rows = ~inputs.of_gcps & (inputs.measured.image_ids == inputs.images[0].id)
    return replace(inputs, measured=inputs.measured.select(~rows))


def duplicated_ids(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    """The ids of the last two GCPs are measured as those of the first two: copied lines of a table."""
    rows = inputs.gcps
    names = dict(zip(inputs.ground.ids[rows[-2:]], inputs.ground.ids[rows[:2]], strict=True))
    ids = np.array([names.get(name, name) for name in inputs.measured.ids.tolist()])
    pairs = np.char.add(np.char.add(ids, " "), inputs.measured.image_ids)
    _, first = np.unique(pairs[::-1], return_index=True)  # the later line counts
    kept = np.zeros(len(ids), dtype=bool)
    kept[len(ids) - 1 - first] = True
    measured = ImagePoints(
        ids[kept], inputs.measured.image_ids[kept], inputs.measured.xy[kept], inputs.measured.sigma_px[kept]
    )
    return replace(inputs, measured=measured)


def stated_exact(pixels: float, sigma_px: float) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        spoilt = inputs.with_xy(inputs.measured.xy + rng.normal(0.0, pixels, inputs.measured.xy.shape))
        return replace(spoilt, measured=replace(spoilt.measured, sigma_px=np.full(len(spoilt.measured), sigma_px)))

    return spoil


# ---- images and RPCs -----------------------------------------------------------------------------------------------


def pixels_changed(
    change: Callable[[np.ndarray, tuple[int, int]], np.ndarray],
    resize: Callable[[tuple[int, int]], tuple[int, int]] | None = None,
    images: int | None = 1,
) -> Spoil:
    """Images whose pixels lie elsewhere than their RPC says: all that is measured there, and the truth, moves along."""

    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        assert inputs.truth is not None
        xy, true_xy = inputs.measured.xy.copy(), inputs.truth.xy.copy()
        changed = []
        for index, image in enumerate(inputs.images):
            size = image.known_size
            if images is not None and index >= images:
                changed.append(image)
                continue
            rows, true_rows = inputs.measured.image_ids == image.id, inputs.truth.image == index
            xy[rows], true_xy[true_rows] = change(xy[rows], size), change(true_xy[true_rows], size)
            changed.append(replace(image, size=size if resize is None else resize(size)))
        spoilt = replace(inputs, images=tuple(changed), truth=inputs.truth._replace(xy=true_xy))
        return _without_pixels_outside(spoilt.with_xy(xy))

    return spoil


def _without_pixels_outside(inputs: Inputs) -> Inputs:
    """Return the inputs without measurements beside their image, and without points that are left on one image."""
    inside = ((inputs.measured.xy >= -0.5) & (inputs.measured.xy < inputs.sizes() - 0.5)).all(axis=1)
    _, number, count = np.unique(inputs.measured.ids[inside], return_inverse=True, return_counts=True)
    measured = inputs.measured.select(inside)
    return replace(inputs, measured=measured.select((count[number] > 1) | np.isin(measured.ids, inputs.ground.ids)))


def enlarged(factor: float) -> Spoil:
    return pixels_changed(
        lambda xy, size: (xy + 0.5) * factor - 0.5, lambda size: (round(size[0] * factor), round(size[1] * factor))
    )


def upside_down(xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return np.column_stack([xy[:, 0], size[1] - 1.0 - xy[:, 1]])


def left_to_right(xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return np.column_stack([size[0] - 1.0 - xy[:, 0], xy[:, 1]])


def stretched(xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return xy * [1.0, 1.01]


def cropped(samples: int, lines: int, images: int | None) -> Spoil:
    return pixels_changed(
        lambda xy, size: xy - [samples, lines], lambda size: (size[0] - samples, size[1] - lines), images
    )


def rpc_changed(change: Callable[[RPC], RPC], images: int | None = None) -> Spoil:
    def spoil(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        return replace(inputs, images=tuple(
            replace(image, rpc=change(image.rpc)) if images is None or index < images else image
            for index, image in enumerate(inputs.images)
        ))  # fmt: skip

    return spoil


def rpcs_exchanged(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    first, second, *others = inputs.images
    exchanged = (replace(first, rpc=second.rpc), replace(second, rpc=first.rpc), *others)
    return replace(inputs, images=exchanged)


def _rpc_shifted(east_m: float, north_m: float) -> Callable[[RPC], RPC]:
    def change(rpc: RPC) -> RPC:
        here = np.array([[rpc.long_off, rpc.lat_off, rpc.height_off]])
        moved = move_ground(here, np.array([[east_m, north_m, 0.0]]))[0]
        return replace(rpc, long_off=moved[0], lat_off=moved[1])

    return change


#: Where each term of RPC00B stands in RPC00A's order.
RPC00A = [0, 1, 2, 3, 4, 5, 6, 10, 7, 8, 9, 11, 14, 17, 12, 15, 18, 13, 16, 19]


def _reordered(rpc: RPC) -> RPC:
    names = ("line_num", "line_den", "samp_num", "samp_den")
    return replace(rpc, **{name: getattr(rpc, name)[RPC00A] for name in names})


def _sign_flipped(rpc: RPC) -> RPC:
    terms = rpc.samp_num.copy()
    terms[7] *= -1.0
    return replace(rpc, samp_num=terms)


def _exchange(first: str, second: str) -> Callable[[RPC], RPC]:
    return lambda rpc: replace(rpc, **{first: getattr(rpc, second), second: getattr(rpc, first)})


# ---- surfaces and laser --------------------------------------------------------------------------------------------


def _step(cells: np.ndarray) -> np.ndarray:
    cells[:, cells.shape[1] // 2 :] += 20.0
    return cells


def _spikes(cells: np.ndarray) -> np.ndarray:
    flat = cells.reshape(-1)
    flat[::97] += 500.0
    return cells


def _tilted(cells: np.ndarray) -> np.ndarray:
    return cells + np.linspace(-30.0, 30.0, cells.shape[1])


def _above_geoid(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    undulation = float(geoid_heights(inputs.ground.ground[:1], "egm96")[0]) if len(inputs.ground) else 0.0
    return made.holding_dem(lambda cells: cells - undulation)(inputs, rng)


def one_track_off(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    east = np.argsort(np.argsort(points[:, 0])) * 4 // len(points) == 1
    return points + 20.0 * np.outer(east, [0.0, 0.0, 1.0])


def laser_moved(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return move_ground(points, np.tile([350.0, 350.0, 0.0], (len(points), 1)))


# ---- the kinds -----------------------------------------------------------------------------------------------------

GCP, CHECK, TIE = Role.GCP, Role.CHECK, Role.TIE
UNSEEN = "a common shift of all known points has the same effect as biased RPCs, within their accuracy"
NO_OTHER_HEIGHT = "within the height accuracy of the RPCs, and no other observation of the block has a height"
AS_STATED = "within three sigmas of the stated accuracy of the RPCs if that is 35 m (SPOT 5); reported elsewhere"
AS_POINTING = "4 to 5 standard deviations of the stated pointing, and no other observation of the block shows it"
AS_DRIFTS = (
    "if the a priori standard deviation of the drift is as large as the deformation (SPOT 5); reported elsewhere"
)
ONE_POINT = "the error of a single point cannot be distinguished from biased RPCs, within their accuracy"
TRUE_KINDS: tuple[TrueKind, ...] = (
    TrueKind("one of 2 GCPs 6 m (8 px) east", points_moved(GCP, (6.0, 0.0, 0.0), 8.0, 1), 2, 0),
    TrueKind("one of 3 GCPs 6 m (8 px) east", points_moved(GCP, (6.0, 0.0, 0.0), 8.0, 1), 3, 0),
    TrueKind("one of 2 heights 17 m (25 px) up", points_moved(GCP, (0.0, 0.0, 17.0), 25.0, 1), 2, 0),
    TrueKind("one of 3 heights 17 m (25 px) up", points_moved(GCP, (0.0, 0.0, 17.0), 25.0, 1), 3, 0),
    TrueKind("one of 4 GCPs measured with an error of 10 px, all images", measured_off(GCP, 10.0, 1), 4, 0),
    TrueKind("one of 8 GCPs measured with an error of 15 px, one image", measured_off(GCP, 15.0, 1, 1)),
    TrueKind("two of 3 GCPs 10 m (10 px) north, by the same shift", points_moved(GCP, (0.0, 10.0, 0.0), 10.0, 2), 3, 0),
    TrueKind("the only GCP with an error of 30 m", points_moved(GCP, (20.0, -22.0, 0.0), 0.0), 1, 0, untold=ONE_POINT),
    TrueKind("the only GCP 30 m too high", points_moved(GCP, (0.0, 0.0, 30.0), 0.0), 1, 0, untold=ONE_POINT),
    TrueKind("GCPs 10 m (10 px) east, check points correct", points_moved(GCP, (10.0, 0.0, 0.0), 10.0)),
    TrueKind("GCPs 12 m (15 px) too high, check points correct", points_moved(GCP, (0.0, 0.0, 12.0), 15.0)),
    TrueKind("GCPs of a web map, with an error of 8 m, stated 0.3 m",
             with_sigmas(0.3, 1.0, points_moved(GCP, (6.0, 5.0, 0.0))), 8, 0, untold=UNSEEN),
    TrueKind("GCPs of 3 m stated 0.05 m", with_sigmas(0.05, 0.1, points_moved(GCP, (3.0, 3.0, 3.0), 4.0,
             scatter=True)), 10, 0),
    TrueKind("sigmas of GCPs 1e-6 m, one with an error of 5 m (6 px)",
             with_sigmas(1e-6, 1e-6, points_moved(GCP, (5.0, 0.0, 0.0), 6.0, 1))),
    TrueKind("heights of GCPs scatter by 10 m, stated 0.15", points_moved(GCP, (0.001, 0.001, 10.0), 10.0,
             scatter=True)),
    TrueKind("check points above the geoid", of_geoid(CHECK)),
    TrueKind("check points above the geoid, no GCPs", of_geoid(CHECK), 0, 12),
    TrueKind("GCPs above the geoid, check points ellipsoidal", of_geoid(GCP)),
    TrueKind("every second GCP above the geoid", of_geoid(GCP, 2), 8, 0),
    TrueKind("check points 4 m (6 px) too high", points_moved(CHECK, (0.0, 0.0, 4.0), 6.0)),
    TrueKind("check points 10 m (10 px) east", points_moved(CHECK, (10.0, 0.0, 0.0), 10.0)),
    TrueKind("one of 6 check points with an error of 50 px", measured_off(CHECK, 50.0, 1)),
    TrueKind("three of 8 heights 10 m (15 px) up", points_moved(GCP, (0.0, 0.0, 10.0), 15.0, 3)),
    TrueKind("heights cut to 10 m", mapped(partial(_round_heights, 10.0)), 8, 0),
    TrueKind("GCPs turned by 0.1 degree", mapped(partial(_turn, 0.1, 1.0)), 8, 0),
    TrueKind("GCPs scaled by 1.0004 (grid for ground)", mapped(partial(_turn, 0.0, 1.0004)), 8, 0,
             untold=AS_DRIFTS),
    TrueKind("GCPs scaled by 1.01", mapped(partial(_turn, 0.0, 1.01)), 8, 0),
    TrueKind("GCPs from an orthoimage on a plane (tan 20°)", mapped(partial(_lean, 0.36)), 8, 0, relief_m=400.0),
    TrueKind("heights tilted by 40 m across the block", mapped(_tilt), 8, 0, untold=AS_DRIFTS),
    TrueKind("GCPs in a corner, one with an error of 5 m (6 px)",
             to_corner(0.4, points_moved(GCP, (4.0, 3.0, 0.0), 6.0, 1)), 16, 0),
    TrueKind("lines of the table copied: two ids twice", duplicated_ids, 8, 0),
    TrueKind("radians for degrees", degrees_as(np.radians)),
    TrueKind("gon for degrees", degrees_as(lambda degrees: degrees / 0.9)),
    TrueKind("degrees and minutes as decimals", degrees_as(partial(_packed, False))),
    TrueKind("degrees, minutes, seconds as decimals", degrees_as(partial(_packed, True))),
    TrueKind("geocentric latitudes", degrees_as(_geocentric)),
    TrueKind("eastings without 500 000", map_numbers(lambda xy: xy - [500_000.0, 0.0])),
    TrueKind("easting and northing exchanged", map_numbers(lambda xy: xy[:, ::-1])),
    TrueKind("eastings and northings in US feet, read as metres", map_numbers(lambda xy: xy / 0.30480060960121924)),
    TrueKind("northings cut by a leading digit", map_numbers(lambda xy: np.column_stack([xy[:, 0], xy[:, 1] % 1e6]))),
    TrueKind("NAD27 / UTM 13N named WGS84", made.other_projection(26713, None), place=COLORADO),
    TrueKind("ED50 / UTM 31N named WGS84", made.other_projection(23031, None), place=PROVENCE),
    TrueKind("ED50 / UTM 37N named WGS84", made.other_projection(23037, None), place=TURKEY),
    TrueKind("AGD66 / AMG 55 named WGS84", made.other_projection(20255, None), place=HOBART),
    TrueKind("PSAD56 / UTM 19S named WGS84", made.other_projection(24879, None), place=CHILE),
    TrueKind("Lambert-93 named UTM 31N", made.other_projection(2154, None), place=PROVENCE),
    TrueKind("Beijing 1954 / zone 19 named UTM", made.other_projection(21419, None), place=CHINA),
    TrueKind("one image enlarged twice under its RPC", enlarged(2.0)),
    TrueKind("one image enlarged twice, no GCPs", enlarged(2.0), 0),
    TrueKind("one image enlarged by 1.5", enlarged(1.5)),
    TrueKind("one image upside down under its RPC", pixels_changed(upside_down)),
    TrueKind("one image upside down, no GCPs", pixels_changed(upside_down), 0),
    TrueKind("one image left to right under its RPC", pixels_changed(left_to_right)),
    TrueKind("one image stretched by 1 % along the lines", pixels_changed(stretched), 0),
    TrueKind("a crop of one image (1000, 700 px), its origin lost", cropped(1000, 700, 1)),
    TrueKind("a crop of one image by 30 px, no GCPs", cropped(30, 20, 1), 0, 0, untold=AS_POINTING),
    TrueKind("crops of all images (1000, 700 px), no GCPs", cropped(1000, 700, None), 0, 0),
    TrueKind("crops of all images (1000, 700 px), GCPs", cropped(1000, 700, None)),
    TrueKind("RPCs of two images exchanged", rpcs_exchanged),
    TrueKind("LINE_SCALE and SAMP_SCALE exchanged", rpc_changed(_exchange("line_scale", "samp_scale"), 1)),
    TrueKind("… in all images", rpc_changed(_exchange("line_scale", "samp_scale"))),
    TrueKind("LAT_SCALE and LONG_SCALE exchanged", rpc_changed(_exchange("lat_scale", "long_scale"), 1)),
    TrueKind("coefficients of line and sample exchanged", rpc_changed(_exchange("line_num", "samp_num"))),
    TrueKind("coefficients in the order of RPC00A", rpc_changed(_reordered)),
    TrueKind("one coefficient with the wrong sign", rpc_changed(_sign_flipped, 1)),
    TrueKind("HEIGHT_OFF 0", rpc_changed(lambda rpc: replace(rpc, height_off=0.0), 1)),
    TrueKind("HEIGHT_OFF and HEIGHT_SCALE in feet", rpc_changed(
        lambda rpc: replace(rpc, height_off=rpc.height_off / 0.3048, height_scale=rpc.height_scale / 0.3048))),
    TrueKind("LAT_OFF without its decimals", rpc_changed(lambda rpc: replace(rpc, lat_off=float(int(rpc.lat_off))))),
    TrueKind("one RPC with an error of 200 m, no GCPs",
             rpc_changed(_rpc_shifted(140.0, 140.0), 1), 0, 0, untold=AS_STATED),
    TrueKind("all RPCs with an error of 30 m and an ERR_BIAS of 0.1 m, no GCPs", rpc_changed(
        lambda rpc: replace(_rpc_shifted(21.0, 21.0)(rpc), err_bias=0.1, err_rand=0.1)), 0, 0,
        untold="a block without constraints has no other information than the stated accuracy of the RPCs"),
    TrueKind("tie points of one image shuffled", ties_shuffled_on_one_image),
    TrueKind("tie points of one image with an error of 30 px", measured_off(TIE, 30.0, None, 1), 0),
    TrueKind("tie points of one image with an error of 30 px, GCPs correct", measured_off(TIE, 30.0, None, 1)),
    TrueKind("a quarter of the tie points with the same error of 12 px", ties_of_one_pattern(0.25, 12.0), 0),
    TrueKind("40 % of the tie points with the same error of 12 px", ties_of_one_pattern(0.4, 12.0), 0),
    TrueKind("tie points rounded to 4 px, stated 0.1 px", ties_rounded, 0),
    TrueKind("tie points only in a corner of the images", ties_in_corner, 0),
    TrueKind("an image without tie points", untied_image, 0),
    TrueKind("measurements of 2 px stated 0.05 px", stated_exact(2.0, 0.05), 4),
    TrueKind("DEM 49 m low, sigma 3 m, GCPs and check points correct",
             made.holding_dem(lambda cells: cells - 49.0), 10, 30),
    TrueKind("DEM 10 m low, sigma 3 m, GCPs correct", made.holding_dem(lambda cells: cells - 10.0), 8, 0),
    TrueKind("DEM 10 m low, sigma 1 m, one GCP", made.holding_dem(lambda cells: cells - 10.0, sigma_m=1.0), 1, 0),
    TrueKind("DEM 40 m high, no GCPs", made.holding_dem(lambda cells: cells + 40.0), 0, 0, untold=NO_OTHER_HEIGHT),
    TrueKind("DEM above the geoid, GCPs ellipsoidal", _above_geoid, 8, 0),
    TrueKind("a step of 20 m in a mosaic, no GCPs", made.holding_dem(_step), 0, 0),
    TrueKind("a step of 20 m in a mosaic, GCPs", made.holding_dem(_step), 8, 0),
    TrueKind("DEM tilted by 60 m, no GCPs", made.holding_dem(_tilted), 0, 0, untold=AS_DRIFTS),
    TrueKind("DEM left to right, no GCPs", made.holding_dem(lambda cells: cells[:, ::-1]), 0, 0, relief_m=400.0),
    TrueKind("DEM in decimetres", made.holding_dem(lambda cells: 10.0 * cells), 0, 0),
    TrueKind("DEM with spikes of 500 m", made.holding_dem(_spikes), 0, 0),
    TrueKind("DEM in steps of 50 m", made.holding_dem(lambda cells: 50.0 * np.floor(cells / 50.0)), 0, 0,
             relief_m=400.0),
    TrueKind("DEM of a canopy of 12 m", made.holding_dem(lambda cells: cells + 12.0), 0, 0, untold=NO_OTHER_HEIGHT),
    TrueKind("DEM all of one height", made.holding_dem(lambda cells: np.full_like(cells, cells.mean())), 0, 0,
             relief_m=400.0),
    TrueKind("laser heights 8 m high, GCPs correct",
             made.with_laser(lambda points, rng: points + [0.0, 0.0, 8.0]), 8, 0),
    TrueKind("one of four laser passes 20 m high, no GCPs", made.with_laser(one_track_off), 0, 0),
    TrueKind("laser points moved by 500 m, no GCPs", made.with_laser(laser_moved), 0, 0, relief_m=400.0),
)  # fmt: skip
