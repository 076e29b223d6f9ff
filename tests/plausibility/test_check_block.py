"""A right block has no reasons; a slip is named for what it is. Cameras that no code of the engine made."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pyproj
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.block.control_visibility import find_weak_control
from hrsi.hrsi_engine.foundation.reasons import Level
from hrsi.hrsi_engine.ground.map_crs import utm_zone
from hrsi.hrsi_engine.plausibility import check_block
from hrsi.hrsi_engine.surface.grid_surface import ConstantHeight, GridSurface

FOOT_M = 0.3048


def block(**more) -> Block:
    return blocks.block(**more)[0]


def with_ground(given: Block, ground: np.ndarray) -> Block:
    return replace(given, points=replace(given.points, ground=ground))


def with_xy(given: Block, xy: np.ndarray, rows: np.ndarray | slice = slice(None)) -> Block:
    changed = given.measurements.xy.copy()
    changed[rows] = xy[rows]
    return replace(given, measurements=replace(given.measurements, xy=changed))


def of_known(given: Block) -> np.ndarray:
    return given.known[given.measurements.point]


def codes(given: Block, **more) -> dict[str, Level]:
    return {reason.code: reason.level for reason in check_block(given, **more)}


def read_as(ground: np.ndarray, meant: int, read: int) -> np.ndarray:
    """Coordinates of one CRS (EPSG) that were taken for those of another."""
    there = pyproj.Transformer.from_crs(4326, meant, always_xy=True).transform(*ground[:, :2].T)
    back = pyproj.Transformer.from_crs(read, 4326, always_xy=True).transform(*there)
    return np.column_stack([*back, ground[:, 2]])


def rounded(ground: np.ndarray, decimals: int) -> np.ndarray:
    return np.column_stack([np.round(ground[:, :2], decimals), ground[:, 2]])


def cut_heights(ground: np.ndarray, step_m: float, geoid_m: float) -> np.ndarray:
    return np.column_stack([ground[:, :2], np.floor((ground[:, 2] - geoid_m) / step_m) * step_m + geoid_m])


def digits_of(ground: np.ndarray, form: str, parts: float) -> np.ndarray:
    """Degrees, minutes and, in forms of three, seconds, written one behind the other: 43° 31' 30" is 43.3130."""
    written = ground.copy()
    for row, column in np.ndindex(len(ground), 2):
        fields, left = [], round(abs(ground[row, column]) * (3600 if form.count("{") == 3 else 60) * parts)
        if form.count("{") == 3:
            left, seconds = divmod(left, round(60 * parts))
            fields.append(seconds)
        fields = [*divmod(left, 60 if fields else round(60 * parts)), *fields]
        written[row, column] = np.copysign(float(form.format(*fields)), ground[row, column])
    return written


@pytest.mark.parametrize("gcps", [0, 1, 2, 3, 5, 10])
@pytest.mark.parametrize("seed", range(6))
def test_a_right_block_has_no_reasons(gcps, seed):
    """Shifts of 10 px and drifts of 1e-4 are errors of RPCs."""
    assert check_block(block(gcps=gcps, checks=seed % 3, count=2 + seed % 3, seed=seed)) == []


@pytest.mark.parametrize(
    ("change", "code"),
    mark_beyond(
        8,
        "wrong_inputs",
        [
            (lambda ground: ground[:, [1, 0, 2]], "lon-lat-swapped"),
            (lambda ground: ground * [-1, 1, 1], "lon-lat-sign"),
            (lambda ground: ground * [1, -1, 1], "lon-lat-sign"),
            (lambda ground: ground * [-1, -1, 1], "lon-lat-sign"),
            (lambda ground: ground * [np.pi / 180, np.pi / 180, 1], "angular-unit"),
            (lambda ground: ground * [400 / 360, 400 / 360, 1], "angular-unit"),
            (lambda ground: digits_of(ground, "{}.{:02d}{:05d}", 1e3), "angular-unit"),
            (lambda ground: digits_of(ground, "{}.{:07d}", 1e5), "angular-unit"),
            (lambda ground: ground + [6, 0, 0], "other-projection"),
            (lambda ground: ground - [12, 0, 0], "other-projection"),
            (lambda ground: ground * [1, 1, 1 / FOOT_M], "height-unit"),
            (lambda ground: ground + [0, 0, 900], "height-offset"),
            (lambda ground: ground + [1, 1.3, 0], "control-implausible"),
            (lambda ground: read_as(ground, meant=3857, read=32700 + utm_zone(*ground[0, :2])), "other-projection"),
            (lambda ground: read_as(ground, meant=32700 + utm_zone(*ground[0, :2]), read=3857), "other-projection"),
            (lambda ground: read_as(ground, meant=4326, read=32700 + utm_zone(*ground[0, :2])), "other-projection"),
            (lambda ground: rounded(ground, 3), "coordinates-rounded"),
        ],
    ),
)
def test_slips_of_ground_points(change, code):
    right = block(ties=0)
    found = check_block(with_ground(right, change(right.points.ground)))
    assert [reason.code for reason in found] == [code]
    assert found[0].level is Level.UNUSABLE
    assert set(found[0].points) == set(right.points.ids.tolist())


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda xy: xy[:, ::-1], "image-axes"),
        (lambda xy: np.column_stack([xy[:, 0], 4000.0 - xy[:, 1]]), "image-axes"),
        (lambda xy: xy * [1, -1], "image-axes"),
        (lambda xy: np.column_stack([4000.0 - xy[:, 0], xy[:, 1]]), "image-axes"),
        (lambda xy: (xy + 0.5) / 2 - 0.5, "image-scale"),
    ],
)
@pytest.mark.parametrize("image", mark_beyond(1, "wrong_inputs", [None, 1]))
def test_slips_of_image_points(change, code, image):
    """On all images, or on one that is named."""
    right = block()
    rows = of_known(right) & (True if image is None else right.measurements.image == image)
    found = check_block(with_xy(right, change(right.measurements.xy), rows))
    assert [reason.code for reason in found] == [code]
    assert found[0].level is Level.UNUSABLE
    assert found[0].images == (("image0", "image1", "image2") if image is None else ("image1",))


def test_image_ids_permuted():
    right = block()
    image = np.array([1, 2, 0])[right.measurements.image]
    wrong = replace(right, measurements=replace(right.measurements, image=image))
    assert codes(wrong) == {"ids-permuted": Level.UNUSABLE}


@pytest.mark.parametrize("order", [[1, 0, *range(2, 20)], [*range(1, 20), 0]], ids=["two", "off by one"])
def test_point_ids_permuted(order):
    right = block(ties=0)
    found = check_block(with_ground(right, right.points.ground[order]))
    assert [reason.code for reason in found] == ["ids-permuted"]
    moved = np.array(order) != np.arange(20)
    assert set(found[0].points) == set(right.points.ids[moved].tolist())
    assert f"{right.points.ids[1]} is {right.points.ids[0]}" in found[0].message or not moved[0] or moved[5]


def test_two_surveys_that_disagree():
    right = block(gcps=8, checks=0)
    wrong = np.flatnonzero(right.points.role == Role.GCP)[::2]
    found = check_block(blocks.move_surveys(right, wrong, (16.0, 0.0, 0.0)))
    assert [reason.code for reason in found] == ["control-outliers"]
    assert found[0].level is Level.UNUSABLE
    assert len(found[0].points) == 4


def test_a_few_points_off():
    right = block(gcps=12, checks=0)
    wrong = np.flatnonzero(right.points.role == Role.GCP)[[3]]
    found = check_block(blocks.move_surveys(right, wrong, (40.0, -30.0, 0.0)))
    assert [(reason.code, reason.level) for reason in found] == [("control-outliers", Level.DOUBTFUL)]
    assert found[0].points == tuple(right.points.ids[wrong].tolist())


def test_a_shift_beyond_every_rpc():
    right = block(ties=0)
    every = np.arange(len(right.points))
    assert codes(blocks.move_surveys(right, every, (60.0, 0.0, 0.0))) == {}
    assert codes(blocks.move_surveys(right, every, (250.0, 0.0, 0.0))) == {"control-implausible": Level.DOUBTFUL}
    assert codes(blocks.move_surveys(right, every, (1600.0, 0.0, 0.0))) == {"control-implausible": Level.UNUSABLE}
    assert codes(blocks.move_surveys(right, every, (1600.0, 0.0, 0.0)), sigma_shift_px=500.0) == {}


def test_another_datum():
    """AGD66 is 200 m from WGS84 in Tasmania (EPSG:1458 and the like)."""
    pyproj = pytest.importorskip("pyproj")
    images = blocks.images(3)
    right = block(ties=0, bias_px=0.5)
    right = replace(right, images=tuple(replace(i, rpc=replace(i.rpc, err_bias=3.0)) for i in images))
    lon, lat = pyproj.Transformer.from_crs(4326, 4202, always_xy=True).transform(*right.points.ground[:, :2].T)
    found = check_block(with_ground(right, np.column_stack([lon, lat, right.points.ground[:, 2]])))
    assert [reason.code for reason in found] == ["horizontal-datum"]
    assert "AGD66" in found[0].message


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.6])
def test_wrong_ties(share):
    right = block(ties=300)
    rng = np.random.default_rng(3)
    rows = ~of_known(right) & (rng.random(len(right.measurements)) < share)
    wrong = with_xy(right, right.measurements.xy + rng.uniform(-60.0, 60.0, right.measurements.xy.shape), rows)
    level = {0.0: None, 0.05: None, 0.3: Level.DOUBTFUL, 0.6: Level.UNUSABLE}[share]
    assert codes(wrong).get("ties-wrong") == level


def test_swapped_columns_of_ties_alone():
    right = block(gcps=0, checks=0, ties=200)
    assert codes(with_xy(right, right.measurements.xy[:, ::-1])) == {"image-axes": Level.UNUSABLE}


def test_an_image_twice():
    right = block()
    twin = replace(right.images[0], id="twin")
    assert codes(replace(right, images=(*right.images, twin))) == {"duplicate-images": Level.DOUBTFUL}


def test_points_outside_their_image():
    right = block(ties=0)
    xy = right.measurements.xy + 0.0
    xy[5] = [9000.0, 100.0]
    assert "outside-image" in codes(with_xy(right, xy))


@pytest.mark.parametrize(("beyond_px", "outside"), [(1.0, False), (20.0, True)])
def test_gcps_of_the_last_pixel_are_in_the_image_where_coordinates_begin_at_1(beyond_px: float, outside: bool):
    """Its far edge is at 0.5 px more than the last number, and a pixel more where numbers begin at 1."""
    right = block(ties=0)
    gcp = np.flatnonzero(right.points.role == Role.GCP)[0]
    xy = right.measurements.xy + 0.0
    for row in np.flatnonzero(right.measurements.point == gcp):
        xy[row, 0] = right.images[right.measurements.image[row]].size[0] - 0.5 + beyond_px
    assert (right.points.ids[gcp] in find_weak_control(with_xy(right, xy))["outside the image"]) == outside


def test_a_dem_beside_the_block():
    right = block()
    ground = right.points.ground
    low = np.nanmin(ground[:, :2], axis=0)
    far = GridSurface.from_array(np.full((50, 50), 200.0), (low[0] + 1.0, low[1]), (1e-3, 1e-3))
    assert codes(right, surface=far) == {"dem-coverage": Level.DOUBTFUL}


def test_heights_that_disagree_with_the_dem():
    right = block(gcps=20)
    ground = right.points.ground.copy()
    ground[right.known, 2] = 200.0 + np.random.default_rng(2).normal(0.0, 0.2, int(right.known.sum()))
    flat = with_ground(right, ground)
    xy = flat.measurements.xy.copy()
    for index, image in enumerate(flat.images):
        rows = of_known(flat) & (flat.measurements.image == index)
        xy[rows] = image.rpc.project(ground[flat.measurements.point[rows]])
    flat = with_xy(flat, xy)
    assert codes(flat, surface=ConstantHeight(203.0)) == {}
    assert codes(flat, surface=ConstantHeight(150.0)) == {"height-offset": Level.DOUBTFUL}
    low, side = np.nanmin(ground[:, :2], axis=0) - 0.02, np.nanmax(np.ptp(ground[right.known], axis=0)[:2]) + 0.04
    for cell, height, told in ((3e-4, 188.0, False), (3e-4, 180.0, True), (5e-5, 188.0, True)):  # of 30 m and 5 m
        cells = np.full((round(side / cell), round(side / cell)), height)
        found = codes(flat, surface=GridSurface.from_array(cells, tuple(low), (cell, cell)))
        assert found == ({"height-offset": Level.DOUBTFUL} if told else {})
    for height in (200.0 / FOOT_M, 2000.0, 20000.0):  # in feet, decimetres and centimetres
        assert codes(flat, surface=ConstantHeight(height)) == {"height-unit": Level.DOUBTFUL}


def test_heights_all_alike():
    right = block(ties=0)
    found = codes(with_ground(right, right.points.ground * [1, 1, 0]))
    assert found["heights-alike"] is Level.UNUSABLE


def test_a_crop_of_unknown_origin():
    right = block()
    small = replace(right.images[0], size=(900, 900))
    assert codes(replace(right, images=(small, *right.images[1:])))["rpc-placement"] is Level.DOUBTFUL


@pytest.mark.parametrize(
    ("change", "sigma_m", "told"),
    [
        (lambda ground: rounded(ground, 4), 0.1, True),
        (lambda ground: rounded(ground, 4), 5.0, False),
        (lambda ground: rounded(ground, 6), 0.1, False),
        (lambda ground: cut_heights(ground, 10.0, 0.0), 0.1, True),
        (lambda ground: cut_heights(ground, 10.0, 37.3), 0.1, True),  # read above a geoid
        (lambda ground: cut_heights(ground, 10.0, 0.0), 5.0, False),
        (lambda ground: cut_heights(ground, 0.1, 0.0), 0.1, False),
    ],
)
def test_coordinates_with_few_decimals(change: Callable, sigma_m: float, told: bool):
    """The fourth decimal is 11 m; nothing is said where the sigma says as much, or where the sixth is still there."""
    right = block()
    ground = change(right.points.ground)
    sigma = np.full((len(ground), 2), sigma_m)
    points = replace(right.points, ground=np.where(right.known[:, None], ground, right.points.ground), sigma_m=sigma)
    found = check_block(replace(right, points=points))
    assert ("coordinates-rounded" in {reason.code for reason in found}) == told


def test_check_points_that_are_gcps():
    """A block agrees with what it was fitted to: said, with the ids, whether all check points are such or one."""
    right = block(gcps=5, checks=3)
    gcps, checks = (np.flatnonzero(right.points.role == role) for role in (Role.GCP, Role.CHECK))
    for count in (1, 3):
        ground = right.points.ground.copy()
        ground[checks[:count]] = ground[gcps[:count]] + [1e-7, 0.0, 0.01]
        xy = right.measurements.xy.copy()
        for check, gcp in zip(checks[:count], gcps[:count], strict=True):
            xy[right.measurements.point == check] = xy[right.measurements.point == gcp]
        found = check_block(replace(
            with_ground(right, ground), measurements=replace(right.measurements, xy=xy),
        ))  # fmt: skip
        assert [(reason.code, reason.level) for reason in found] == [("check-is-control", Level.DOUBTFUL)]
        assert set(found[0].points) == set(right.points.ids[checks[:count]].tolist())
        assert f"{count} of 3 check points" in found[0].message


@pytest.mark.parametrize("quarters", [1, 2, 3])
@pytest.mark.parametrize("of_ground", [True, False])
def test_points_of_a_turned_copy(quarters, of_ground):
    """A copy turned clockwise: what was the left edge is its upper edge."""
    given = block(gcps=8, seed=quarters)
    size = np.array([image.size for image in given.images], dtype=float)[given.measurements.image]
    xy = given.measurements.xy.copy()
    for _ in range(quarters):
        xy, size = np.column_stack([size[:, 1] - 1.0 - xy[:, 1], xy[:, 0]]), size[:, ::-1]
    rows = of_known(given) if of_ground else slice(None)
    assert codes(with_xy(given, xy, rows))["image-axes"] is Level.UNUSABLE


def test_points_of_a_crop_tell_its_origin():
    given = block(gcps=8, seed=3)
    (reason,) = [r for r in check_block(with_xy(given, given.measurements.xy - [200.0, 300.0])) if "control" in r.code]
    assert reason.code == "control-implausible"
    words = reason.message.replace("(", " ").split()
    origin = [float(word) for word in words if word[0] in "+-" and word[1:].isdigit()]
    assert origin[:2] == pytest.approx([200.0, 300.0], abs=35.0)  # the RPCs are 10 px off in each axis (1 sigma)
    worst = check_block(with_xy(given, given.measurements.xy - [2000.0, 3000.0]))[0]
    assert worst.code == "control-implausible" and "px in line on" in worst.message


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_crop_of_a_single_image_is_no_error_of_heights(sign: float):
    """Along its rays, an image moved under its RPC looks like heights kilometres off, where its RPC has no ground."""
    given = block(count=1, ties=0, checks=0)
    image = given.images[0]
    along = np.diff(image.rpc.project(given.points.ground[:1] + [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), axis=0)
    moved = with_xy(given, given.measurements.xy + sign * 2500.0 * along + [0.0, 3.0])
    (reason,) = [one for one in check_block(moved) if one.level is Level.UNUSABLE]
    assert reason.code == "control-implausible" and "a crop and its scene have different RPCs" in reason.advice


def test_a_crop_of_one_image_is_no_slip_of_its_coordinates():
    """Ties of a crop whose origin was lost miss the others' rays alike; an image left to right does not."""
    right = block(gcps=0, checks=0)
    rows = right.measurements.image == 1
    found = check_block(with_xy(right, right.measurements.xy + [900.0, 700.0], rows))
    assert [reason.code for reason in found] == ["ties-wrong"]
    assert "their distances are equal" in found[0].message


def test_a_single_point_proves_no_slip():
    right = block(gcps=1, checks=0, ties=0)
    found = check_block(with_ground(right, right.points.ground[:, [1, 0, 2]]))
    assert [reason.code for reason in found] == ["control-implausible"]
    assert "longitude and latitude are exchanged (then" in found[0].message


@pytest.mark.parametrize("names", [("line_scale", "samp_scale"), ("lat_scale", "long_scale")])
def test_exchanged_scales_of_an_rpc_are_named(names):
    right = block(ties=0)
    first, *others = right.images
    a, b = names
    wrong = replace(first.rpc, **{a: 1.3 * getattr(first.rpc, b), b: getattr(first.rpc, a)})
    sound = replace(first.rpc, **{a: getattr(first.rpc, a), b: 1.3 * getattr(first.rpc, b)})
    measured = right.measurements
    rows = measured.image == 0
    xy = measured.xy.copy()
    xy[rows] = sound.project(right.points.ground[measured.point[rows]])
    found = check_block(with_xy(replace(right, images=(replace(first, rpc=wrong), *others)), xy))
    assert [reason.code for reason in found] == ["rpc-order"]
    assert found[0].images == (first.id,)
