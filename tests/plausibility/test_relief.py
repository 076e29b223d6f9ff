"""A DEM against the ground that adjusted tie points have: what is right passes, what is displaced is measured."""

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.foundation.reasons import Level
from hrsi.hrsi_engine.ground.geodesy import metres_per_degree
from hrsi.hrsi_engine.plausibility.relief import find_relief_reasons
from hrsi.hrsi_engine.surface.grid_surface import GridSurface

ORIGIN = np.array([11.0, 47.0])
STEP = 3e-4  # degrees: cells of about 23 x 33 m
SIDE = 220


def terrain(lonlat: np.ndarray, seed: int, relief_m: float) -> np.ndarray:
    """Return heights of hills of 0.8 to 5 km; waves whose lengths no grid knows."""
    rng = np.random.default_rng(seed)
    metres = (lonlat - ORIGIN) * metres_per_degree(np.array([[*ORIGIN, 0.0]]))[0, :2]
    height = np.full(len(lonlat), 600.0)
    for _ in range(8):
        angle, length = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(800.0, 5000.0)
        height += (
            relief_m / 5.0 * np.sin(2.0 * np.pi * metres @ [np.cos(angle), np.sin(angle)] / length + rng.uniform(0, 6))
        )
    return height


def cells(seed: int, relief_m: float) -> np.ndarray:
    lon = ORIGIN[0] + STEP * np.arange(SIDE)
    lat = ORIGIN[1] - STEP * np.arange(SIDE)
    return terrain(np.stack(np.meshgrid(lon, lat), axis=-1).reshape(-1, 2), seed, relief_m).reshape(SIDE, SIDE)


def dem(heights: np.ndarray, east: float = 0.0, north: float = 0.0) -> GridSurface:
    """Return a DEM that lies some cells too far east and north."""
    return GridSurface.from_array(heights, (ORIGIN[0] + east * STEP, ORIGIN[1] + north * STEP), (STEP, -STEP))


def ties(seed: int, relief_m: float, count: int = 300, noise_m: float = 1.5, trees_m: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng([seed, 1])
    lonlat = ORIGIN + STEP * SIDE * np.column_stack([rng.uniform(0.1, 0.9, count), -rng.uniform(0.1, 0.9, count)])
    height = terrain(lonlat, seed, relief_m) + rng.normal(0.0, noise_m, count)
    return np.column_stack([lonlat, height + trees_m * (rng.random(count) < 0.5)])


def codes(ground: np.ndarray, surface: GridSurface, **more) -> dict[str, Level]:
    return {reason.code: reason.level for reason in find_relief_reasons(ground, surface, **more)}


@pytest.mark.parametrize("relief_m", [2.0, 20.0, 100.0, 600.0])
@pytest.mark.parametrize("seed", range(10))
def test_a_right_dem_passes(seed: int, relief_m: float) -> None:
    """Of another datum, under trees, one cell beside, and where a twentieth of the tie points is wrong."""
    heights = cells(seed, relief_m)
    ground = ties(seed, relief_m)
    assert codes(ground, dem(heights)) == {}
    assert codes(ground, dem(heights - 48.0)) == {}
    assert codes(ties(seed, relief_m, trees_m=12.0), dem(heights)) == {}
    assert codes(ground, dem(heights, east=1.0)) == {}
    ground[::20, 2] += np.random.default_rng(seed).normal(0.0, 200.0, len(ground[::20]))
    assert codes(ground, dem(heights)) == {}


@pytest.mark.parametrize("seed", range(6))
def test_a_displaced_dem(seed: int) -> None:
    (reason,) = find_relief_reasons(ties(seed, 200.0), dem(cells(seed, 200.0), east=8.0, north=-5.0))
    metres = STEP * metres_per_degree(np.array([[*ORIGIN, 0.0]]))[0, :2]
    said = [float(word) for word in reason.message.split() if word.replace(".", "").isdigit()]
    assert reason.code == "dem-unlike-ground"
    assert "east" in reason.message and "south" in reason.message
    assert said[:2] == pytest.approx([8.0 * metres[0], 5.0 * metres[1]], abs=0.2 * metres[0])
    # what the block's own place may be off is not the DEM's
    assert codes(ties(seed, 200.0), dem(cells(seed, 200.0), east=3.0), sigma_plan_m=15.0) == {}


@pytest.mark.parametrize("seed", mark_beyond(2, "thorough", range(6)))
def test_a_dem_of_other_ground(seed: int) -> None:
    heights, ground = cells(seed, 200.0), ties(seed, 200.0)
    for wrong in (heights[::-1], heights[:, ::-1], heights.T, 600.0 + 0.0 * heights, -heights, cells(seed + 99, 200.0)):
        assert codes(ground, dem(wrong), holds=True) == {"dem-unlike-ground": Level.UNUSABLE}
        assert codes(ground, dem(wrong)) == {"dem-unlike-ground": Level.DOUBTFUL}
        assert codes(ground, dem(wrong), sigma_h_m=100.0) == {"dem-unlike-ground": Level.DOUBTFUL}


@pytest.mark.parametrize("seed", range(2))
def test_a_tilt_of_a_block_without_gcps_is_no_error_of_the_dem(seed: int) -> None:
    ground = ties(seed, 20.0)
    ground[:, 2] += 60.0 * (ground[:, 0] - ground[:, 0].mean()) / np.ptp(ground[:, 0])
    assert codes(ground, dem(cells(seed, 20.0)), sigma_h_m=15.0) == {}
    assert codes(ground, dem(cells(seed, 20.0)), sigma_h_m=0.5) == {"dem-unlike-ground": Level.DOUBTFUL}


@pytest.mark.parametrize("value", [0.0, 255.0, -500.0])
@pytest.mark.parametrize("share", [0.05, 0.4])
def test_undeclared_no_data(value: float, share: float) -> None:
    heights = cells(1, 60.0)
    heights[: round(0.1 * SIDE + 0.8 * share * SIDE)] = value
    assert codes(ties(1, 60.0), dem(heights)) == {"dem-unlike-ground": Level.DOUBTFUL}
