"""Terrain and where rays meet it, against other ways to compute the same."""

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.laboratory.simulation import SENSORS, aim_camera
from hrsi.hrsi_engine.laboratory.simulation.surface import compute_ray_paths, locate_on_surface, meet_surface
from hrsi.hrsi_engine.laboratory.simulation.terrain import (
    Chart,
    TerrainSurface,
    make_fractal_relief,
    make_fractal_terrain,
)

CHART = Chart(5.45, 43.53)


def terrain(relief_m: float = 100.0, cliff_m: float = 0.0, seed: int = 1) -> TerrainSurface:
    return make_fractal_terrain(CHART, 1500.0, 5.0, 250.0, relief_m, seed, cliff_m)


def test_relief_has_the_fractal_spectrum():
    """Amplitudes fall as frequency ** -(1 + H); estimated on a periodic piece large against the window."""
    relief = make_fractal_relief(1024, 0.95, np.random.default_rng(1))
    window = np.hanning(1024)[:, None] * np.hanning(1024)
    power = np.abs(np.fft.rfft2(relief * window)) ** 2
    frequency = np.hypot(np.fft.fftfreq(1024)[:, None], np.fft.rfftfreq(1024)[None, :])
    band = (frequency > 0.01) & (frequency < 0.1)
    slope = np.polyfit(np.log(frequency[band]), np.log(power[band]), 1)[0]
    assert slope == pytest.approx(-2.0 * 1.95, abs=0.15)


def test_cliffs_are_as_high_as_asked():
    ground = terrain(relief_m=0.0, cliff_m=40.0)
    assert set(np.round(np.unique(np.abs(np.diff(ground.posts, axis=1))))) == {0.0, 40.0}


def brute_force(camera, ground: TerrainSurface, image: np.ndarray) -> np.ndarray:
    """Return the first ground point of each ray by stepping down every 2 cm with exact positions."""
    low, high = ground.height_range
    found = []
    for point in image:
        heights = np.arange(high + 0.02, low - 0.02, -0.02)
        path = camera.image_to_ground(np.repeat(point[None], len(heights), axis=0), heights)
        found.append(path[np.argmax(heights <= ground.height_at(path))])
    return np.array(found)


@pytest.mark.parametrize("cliff_m", mark_beyond(1, "rendered", [60.0, 0.0]))
def test_first_intersection_against_small_steps(cliff_m: float):
    ground = terrain(cliff_m=cliff_m)
    camera = aim_camera(SENSORS["pleiades"], (1200, 1200), np.array([5.45, 43.53, 250.0]), 28.0, -15.0)
    image = np.random.default_rng(5).uniform(0.0, 1199.0, (100, 2))
    met, expected = locate_on_surface(camera, ground, image), brute_force(camera, ground, image)
    away = np.linalg.norm(ground_difference_m(met, expected), axis=1)
    # 2 cm of height are 1.3 cm on the ground; grazing a cliff's edge within a step may find the other side.
    assert np.mean(away < 0.04) >= 0.98
    on_surface = np.abs(met[:, 2] - ground.height_at(met)).max()
    assert on_surface < (5e-3 if cliff_m == 0.0 else 0.1)  # on a cliff of 60 m a post a millimetre aside is centimetres


def test_paths_are_exact_over_the_relief():
    """The quadratic path against exact intersections at heights between its three nodes."""
    ground = terrain(relief_m=600.0)
    camera = aim_camera(SENSORS["worldview-2"], (2000, 2000), np.array([5.45, 43.53, 250.0]), 30.0, 20.0)
    image = np.random.default_rng(6).uniform(0.0, 1999.0, (500, 2))
    paths = compute_ray_paths(camera, ground, image)
    heights = np.random.default_rng(7).uniform(*ground.height_range, 500)
    exact = CHART.from_ground(camera.image_to_ground(image, heights))
    off = np.abs(np.column_stack(paths.position_at(heights)) - exact).max()
    assert off < 1e-4


def test_hidden_ground_is_never_met():
    """Behind a cliff that faces away from the sensor some ground is not seen: gaps in the ground positions."""
    ground = terrain(relief_m=0.0, cliff_m=60.0)
    camera = aim_camera(SENSORS["pleiades"], (1200, 1200), np.array([5.45, 43.53, 250.0]), 30.0, 0.0)
    lines = np.column_stack([np.full(1200, 600.0), np.arange(1200.0)])
    heights = meet_surface(compute_ray_paths(camera, ground, lines), ground)
    east, north = ground.chart.from_ground(camera.image_to_ground(lines, heights)).T
    steps = np.hypot(np.diff(east), np.diff(north))
    assert steps.max() > 20.0  # 60 m at 30 degrees hide 35 m
    assert np.median(steps) < 1.5
