"""Terrain through points."""

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ortho.point_surface import surface_of_points
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.tests.ortho.scenes import hills
from hrsi.tests.simulated_blocks import LAT, LON


def points(count: int, seed: int = 1) -> np.ndarray:
    lonlat = np.random.default_rng(seed).uniform([LON - 0.005, LAT - 0.005], [LON + 0.005, LAT + 0.005], (count, 2))
    return np.column_stack([lonlat, hills(*lonlat.T)])


def test_surface_follows_the_terrain_and_goes_on_outside() -> None:
    surface, left_out = surface_of_points(points(3000))
    inside = points(500, seed=2)
    inside[:, :2] = (LON, LAT) + 0.9 * (inside[:, :2] - (LON, LAT))
    truth = hills(*inside[:, :2].T)
    assert left_out == 0
    assert np.sqrt(np.mean((surface_heights(surface, inside[:, :2]) - truth) ** 2)) < 1.0  # of hills of 40 m
    outside = surface_heights(surface, np.array([[LON + 0.007, LAT]]))
    assert np.isfinite(outside).all()


def test_a_surface_of_few_points_ends_a_length_of_theirs_outside() -> None:
    """Twelve points on 1000 m by 50 m: their spacing times the margin is more than the area's own length."""
    rng = np.random.default_rng(3)
    ground = np.column_stack([rng.uniform(0.0, 1.0, (12, 2)), np.full(12, 250.0)])
    ground[:2, :2] = (0.0, 0.0), (1.0, 1.0)
    by_degree = 111.32e3 * np.array([np.cos(np.radians(LAT)), 1.0])  # m
    ground[:, :2] = (LON, LAT) + ground[:, :2] * [1000.0, 50.0] / by_degree
    surface, _ = surface_of_points(ground)
    for north_m, inside in ((950.0, True), (1150.0, False)):
        heights = surface_heights(
            surface, np.array([[LON, LAT + sign * north_m / by_degree[1]] for sign in (1.0, -1.0)])
        )
        assert np.isfinite(heights).tolist() == [inside, inside]


def test_blunders_are_left_out() -> None:
    ground = points(2000)
    ground[::100, 2] += 150.0
    surface, left_out = surface_of_points(ground)
    assert 20 <= left_out <= 40
    left = np.abs(surface_heights(surface, ground[::100, :2]) - (ground[::100, 2] - 150.0))
    assert np.median(left) < 1.0 and left.max() < 50.0  # none of 150 m is left; the largest stand outside the triangles


def metres(lonlat: np.ndarray) -> np.ndarray:
    """East and north of the middle, to 1 %."""
    return (lonlat - (LON, LAT)) * (111_320.0 * np.cos(np.radians(LAT)), 111_000.0)


def test_an_uncertainty_that_all_points_share_changes_nothing() -> None:
    """A block without GCPs: its height is known to 8 m, and the points' heights relative to one another to 0.3 m."""
    ground = points(1000)
    sigma = np.random.default_rng(4).uniform(0.2, 0.4, 1000)
    places = points(300, seed=2)[:, :2]
    alone, shared = (
        surface_heights(surface_of_points(ground, np.hypot(sigma, common))[0], places) for common in (0.0, 8.0)
    )
    np.testing.assert_allclose(alone, shared, atol=1e-6)


@pytest.mark.thorough
def test_points_that_are_less_certain_count_less() -> None:
    """Every third point is a narrow pair's, 5 m uncertain among such of 0.2 m; without sigmas the surface shows it."""
    rng = np.random.default_rng(5)
    ground, sigma = points(3000), np.where(np.arange(3000) % 3 == 0, 5.0, 0.2)
    ground[:, 2] += rng.normal(0.0, sigma)
    inside = points(500, seed=2)
    inside[:, :2] = (LON, LAT) + 0.9 * (inside[:, :2] - (LON, LAT))
    rmse = {}
    for name, known in (("sigmas", sigma), ("none", None)):
        found = surface_heights(surface_of_points(ground, known)[0], inside[:, :2])
        rmse[name] = np.sqrt(np.mean((found - hills(*inside[:, :2].T)) ** 2))
    assert rmse["sigmas"] < 0.6  # the good points alone give 0.2 m times a little more than 1, and hills between them
    assert rmse["none"] > 2.0 * rmse["sigmas"]


def plane_by_definition(node: np.ndarray, xy: np.ndarray, height: np.ndarray, scatter: float) -> float:
    """Return the height of a plane at a node: least squares with weights ``1 / (1 + (v / s)²)²`` of residuals v.

    As `POINT_SURFACE` says: the 20 nearest points, a Gaussian 0.33 times as wide as the fifth is away, slopes 0 +- 0.3.
    """
    distance = np.hypot(*(xy - node).T)
    near = np.argsort(distance)[:20]
    width = 0.33 * distance[near[4]]
    gauss = np.exp(-0.5 * (distance[near] / width) ** 2)
    gauss /= gauss[0]  # the nearest point counts as it is, however far away
    A = np.vstack([np.column_stack([np.ones(20), xy[near] - node]), [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]])
    y, robust = np.array([*height[near], 0.0, 0.0]), np.ones(20)
    for rounds in (16.0, 8.0, 4.0, 2.0, 1.0, 1.0):
        root = np.sqrt(np.array([*(gauss * robust / (0.5 * scatter) ** 2), 0.3**-2, 0.3**-2]))
        plane = np.linalg.lstsq(A * root[:, None], y * root, rcond=None)[0]
        robust = (1.0 + ((y - A @ plane)[:20] / (rounds * scatter)) ** 2) ** -2.0
    return float(np.clip(plane[0], height[near].min(), height[near].max()))


def test_heights_are_those_of_robust_planes() -> None:
    """Beside a wall of 15 m, where the weights of residuals decide; NumPy, point by point, from the definition."""
    rng = np.random.default_rng(7)
    lonlat = rng.uniform([LON - 0.001, LAT - 0.001], [LON + 0.001, LAT + 0.001], (500, 2))
    height = np.where(lonlat[:, 0] > LON, 215.0, 200.0) + rng.normal(0.0, 0.3, 500)
    surface, left_out = surface_of_points(np.column_stack([lonlat, height]))
    # Metres a degree of the WGS84 ellipsoid at the points' middle
    sin2 = np.sin(np.radians(np.median(lonlat[:, 1]))) ** 2
    N = 6378137.0 / np.sqrt(1.0 - 0.00669437999 * sin2)
    M = N * (1.0 - 0.00669437999) / (1.0 - 0.00669437999 * sin2)
    up = np.median(height)
    scale = np.radians([(N + up) * np.sqrt(1.0 - sin2), M + up])
    xy = lonlat * scale
    # How far points lie from the planes of their twelve neighbours
    away = []
    for place, own in zip(xy, height, strict=True):
        near = np.argsort(np.hypot(*(xy - place).T))[1:13]
        A = np.column_stack([np.ones(12), xy[near] - place])
        away.append(abs(own - np.linalg.lstsq(A, height[near], rcond=None)[0][0]))
    scatter = max(1.4826 * float(np.median(away)), 0.1)
    # Nodes of the surface within 12 m of the wall
    start, end = surface.grid_coordinates(np.array([[LON, LAT], [LON + 1e-4, LAT + 1e-4]]))
    per_degree = (end - start) / 1e-4
    nodes = np.round(start) + rng.integers(-8, 9, (40, 2))
    places = [LON, LAT] + (nodes - start) / per_degree
    expected = [plane_by_definition(place * scale, xy, height, scatter) for place in places]
    assert left_out == 0
    assert np.ptp(expected) > 12.0  # both sides of the wall
    np.testing.assert_allclose(surface.heights(nodes), expected, atol=1e-4)


@pytest.mark.large
def test_walls_stay_steep() -> None:
    """Blocks of houses of 15 m, 30 m wide and 20 m apart; points every 6 m on roofs and ground, 0.3 m uncertain.

    A triangulation is a ramp as wide as the points are apart, wrong by more than 1 m on about a third of the area.
    """
    rng = np.random.default_rng(6)
    lonlat = rng.uniform([LON - 0.002, LAT - 0.002], [LON + 0.002, LAT + 0.002], (4500, 2))

    def town(places: np.ndarray) -> np.ndarray:
        return np.where((metres(places) % 50.0 < 30.0).all(axis=1), 215.0, 200.0)

    ground = np.column_stack([lonlat, town(lonlat) + rng.normal(0.0, 0.3, len(lonlat))])
    places = rng.uniform([LON - 0.0018, LAT - 0.0018], [LON + 0.0018, LAT + 0.0018], (4000, 2))
    surface, left_out = surface_of_points(ground, np.full(len(ground), 0.3))
    wrong = np.abs(surface_heights(surface, places) - town(places)) > 1.0
    ramps = LinearNDInterpolator(metres(lonlat), ground[:, 2])(metres(places))
    assert left_out < 0.02 * len(ground)
    assert wrong.mean() < 0.6 * np.mean(np.abs(ramps - town(places)) > 1.0)


def test_points_on_a_line_are_an_error() -> None:
    ground = points(5)
    ground[:, 1] = LAT
    with pytest.raises(InputError, match="on a line"):
        surface_of_points(ground)


def test_a_surface_needs_three_points() -> None:
    with pytest.raises(InputError, match="3 points"):
        surface_of_points(points(5)[:2])
