"""A year over the scene: where the sun stands, where shadows and roofs fall, and that the truth says what changed."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.laboratory.simulation.landscape import COVERS, Objects
from hrsi.hrsi_engine.laboratory.simulation.lighting import compute_swept_cover
from hrsi.hrsi_engine.laboratory.simulation.seasons import OWN_TEXTURE, SNOW_HOLD
from hrsi.hrsi_engine.laboratory.simulation.truth_tables import make_truth_tables

CLEAN = lab.Radiometry(noise_dn=0.0, shot_dn=0.0)


@pytest.mark.parametrize(
    ("day", "hour", "lat", "azimuth", "elevation"),
    [
        (79.5, 12.0, 0.0, None, 90.0),  # equinox at the equator: the zenith
        (171.5, 12.0, 50.0, 180.0, 63.4),  # solstices: 90 - latitude +- 23.44 degrees
        (354.5, 12.0, 50.0, 180.0, 16.6),
        (79.5, 6.0, 45.0, 90.0, 0.0),  # the equinox sun rises in the east
        (354.5, 12.0, -35.0, 0.0, 78.4),  # and stands in the north over Australia
    ],
)
def test_the_sun_stands_where_the_almanac_says(day: float, hour: float, lat: float, azimuth, elevation: float):
    """Within a degree, which is what a circular orbit of the earth leaves."""
    found_azimuth, found_elevation = lab.compute_sun_position(day, hour, lat)
    assert found_elevation == pytest.approx(elevation, abs=1.0)
    if azimuth is not None:
        assert abs((found_azimuth - azimuth + 180.0) % 360.0 - 180.0) < 1.5


def test_dates_spread_over_the_year_and_views_over_the_disc():
    taken = lab.draw_acquisitions(40, 45.0, seed=3)
    days = np.array([one.day for one in taken])
    assert (np.diff(days) > 0.0).all() and (np.floor(days * 40 / 365.0) == np.arange(40)).all()
    snowy = np.array([one.snow > 0.0 for one in taken])
    assert snowy.any() and not snowy[(days > 90) & (days < 275)].any()
    views = lab.make_views_of_dates(lab.SENSORS["pleiades"], taken, 1, (500, 500), 190.0, 20.0, seed=3)
    tilt = np.array([np.hypot(view.along_deg, view.across_deg) for view in views])
    assert tilt.max() <= 20.0 and np.median(tilt) == pytest.approx(20.0 / np.sqrt(2.0), abs=3.0)
    assert len({view.id for view in views}) == 40 and views[9].id == "d10_1"


def one_building(taken: lab.Acquisition, **view: float) -> tuple[lab.BlockSimulation, int]:
    """Return a flat block and the index of its highest roof that stands all year, in the middle of the view."""
    spec = lab.SceneSpec(relief_m=0.0, seed=5)
    looking = lab.SceneView("a", lab.SENSORS["pleiades"], (400, 400), radiometry=CLEAN, acquisition=taken, **view)
    block = lab.simulate_block(spec, [looking], lab.PointCounts(0, 0, 0), lab.Noise(vendor=0.0))
    year, objects = block.scene.chronicle, block.scene.objects
    always = (objects.kind == "roof") & (year.built_day < 0.0) & (year.torn_day > 365.0)
    index = int(np.flatnonzero(always)[np.argmax(year.height_m[always])])
    position = objects.position_m[index]
    near = replace(looking, offset_m=(float(position[0]), float(position[1])))
    wide = replace(spec, half_extent_m=block.scene.half_extent_m)
    return lab.simulate_block(wide, [near], lab.PointCounts(0, 0, 0), lab.Noise(vendor=0.0)), index


SUNS = [lab.Acquisition(1, 180.0, azimuth, 45.0) for azimuth in (90.0, 270.0)]


def pixel_of(block: lab.BlockSimulation, place: np.ndarray, height_m: float) -> tuple[int, int]:
    """Return line and sample where a place is seen, so high above the flat ground."""
    ground = block.scene.chart.to_ground(place[None], np.array([block.spec.mean_height_m + height_m]))
    sample, line = np.rint(block.truth.cameras[0].ground_to_image(ground)[0]).astype(int)
    return int(line), int(sample)


@pytest.mark.rendered
def test_a_shadow_falls_away_from_the_sun():
    """Seen from above, sun from the east and from the west, 45 degrees high: shadows as long as the house."""
    (block, index), (other, _) = (one_building(sun) for sun in SUNS)
    height, foot = block.scene.chronicle.height_m[index], block.scene.objects.position_m[index]
    reach = 0.5 * float(np.ptp(block.scene.objects.corners_m()[index][:, 0])) + 0.5 * height
    with_east_sun, with_west_sun = (lab.make_renderer(one, "a").noise_free_tile(0, 0) for one in (block, other))
    west_side, east_side = (pixel_of(block, foot + [side * reach, 0.0], 0.0) for side in (-1.0, 1.0))
    assert with_east_sun[west_side] < 0.5 * with_west_sun[west_side]
    assert with_west_sun[east_side] < 0.5 * with_east_sun[east_side]


def test_a_roof_is_seen_where_a_point_so_high_is_seen():
    block, index = one_building(SUNS[0], across_deg=20.0)
    height, foot = block.scene.chronicle.height_m[index], block.scene.objects.position_m[index]
    top, bottom = pixel_of(block, foot, height), pixel_of(block, foot, 0.0)
    assert np.hypot(*np.subtract(top, bottom)) > 3.0
    grey = lab.make_renderer(block, "a").noise_free_tile(0, 0)
    middle = block.scene.objects.grey[index, 0]
    assert grey[top] == pytest.approx(middle, rel=0.02)
    # Towards the edge that leans over, where the ground behind the foot would be seen without a height
    lean = np.subtract(top, bottom) / height
    beyond = foot + 0.4 * block.scene.objects.size_m[index].min() * np.array([lean[1], -lean[0]]) / np.hypot(*lean)
    assert grey[pixel_of(block, beyond, height)] == pytest.approx(middle, rel=0.02)


def test_swept_outlines_are_the_union_of_their_places():
    rng = np.random.default_rng(1)
    east, north = np.meshgrid(np.arange(-20.0, 20.0, 0.25), np.arange(-20.0, 20.0, 0.25))
    for kind, size in (("roof", (12.0, 7.0)), ("tank", (9.0, 9.0))):
        objects = Objects(np.array([kind]), np.zeros((1, 2)), np.array([size]), np.array([0.4]), np.zeros((1, 5)))
        sweep = rng.uniform(-8.0, 8.0, 2)
        cover = compute_swept_cover(objects, 0, sweep, east, north, 0.02) > 0.5
        union = np.zeros(east.shape, dtype=bool)
        for share in np.linspace(0.0, 1.0, 200):
            x, y = east - share * sweep[0], north - share * sweep[1]
            if kind == "tank":
                union |= np.hypot(x, y) < size[0] / 2.0
            else:
                ahead, right = np.sin(0.4) * x + np.cos(0.4) * y, np.cos(0.4) * x - np.sin(0.4) * y
                union |= (np.abs(ahead) < size[0] / 2.0) & (np.abs(right) < size[1] / 2.0)
        assert np.mean(cover != union) < 0.004  # pixels on the very edge


def year(dates: int = 8, size: int = 300, seed: int = 4) -> lab.BlockSimulation:
    spec = lab.SceneSpec(relief_m=40.0, seed=seed)
    taken = lab.draw_acquisitions(dates, spec.lat_deg, seed)
    views = lab.make_views_of_dates(lab.SENSORS["pleiades"], taken, 1, (size, size), 190.0, 5.0, seed)
    return lab.simulate_block(spec, views, lab.PointCounts(0, 4, 0), lab.Noise(vendor=0.0))


@pytest.mark.rendered
def test_pixels_do_not_depend_on_the_window_nor_on_the_other_dates():
    block = year(3)
    image = lab.make_renderer(block, "d2_1")
    whole = image.window(0, 0, 300, 300)
    np.testing.assert_array_equal(whole[100:290, 40:260], lab.make_renderer(block, "d2_1").window(40, 100, 220, 190))


def test_the_truth_tells_what_was_built_torn_and_ploughed():
    block = year(8, 400)
    tables = make_truth_tables(block)
    objects, changes = tables["objects"].columns, tables["changes"].columns
    for kind, column in (("built", "built_day"), ("torn", "torn_day")):
        days = np.array([one.day for one in block.acquisitions])
        happened = objects[column][(objects[column] > 0.0) & (objects[column] <= days[-1])]
        told = changes["date"][changes["kind"] == kind]
        first = np.searchsorted(days, happened) + 1
        # Built and torn between the same two dates shows on neither
        assert 0 < len(told) <= len(first) and set(told.tolist()) <= set(first.tolist())
    ploughed = changes["day"][changes["kind"] == "ploughed"]
    assert len(ploughed) > 20 and (np.abs(ploughed - 285) < 80).sum() + (np.abs(ploughed - 95) < 80).sum() == len(
        ploughed
    )
    snow = [one.number for one in block.acquisitions if one.snow]
    assert changes["date"][changes["kind"] == "snow"].tolist() == snow


def local_correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Return the correlation of what is left without the means over 17 x 17 pixels: what windows are matched by."""
    fine = [grey - cv2.blur(grey, (17, 17)) for grey in (a, b)]
    return float(np.corrcoef(fine[0].ravel(), fine[1].ravel())[0, 1])


@pytest.mark.rendered
def test_dates_close_by_look_alike_and_half_a_year_apart_they_do_not():
    """One view direction, days 150, 158 and 330: what is left in common are roads, borders and part of the texture."""
    spec = lab.SceneSpec(relief_m=0.0, seed=7)
    greys = []
    for number, day in enumerate((150.0, 158.0, 330.0)):
        taken = lab.Acquisition(number + 1, day, *lab.compute_sun_position(day, 10.5, spec.lat_deg))
        view = lab.SceneView("a", lab.SENSORS["pleiades"], (256, 256), radiometry=CLEAN, acquisition=taken)
        block = lab.simulate_block(spec, [view], lab.PointCounts(0, 0, 0), lab.Noise(vendor=0.0))
        greys.append(lab.make_renderer(block, "a").noise_free_tile(0, 0))
    near, far = local_correlation(greys[0], greys[1]), local_correlation(greys[0], greys[2])
    assert near > 0.8 and far < near - 0.25


def test_every_cover_has_a_texture_and_holds_snow():
    """Their tables stand beside one another, in the order of the covers."""
    assert len(OWN_TEXTURE) == len(SNOW_HOLD) == len(COVERS)
