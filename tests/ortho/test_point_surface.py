"""Terrain through points."""

from __future__ import annotations

import numpy as np
import pytest

from hrsi.hrsi_engine.dem import surface_heights
from hrsi.hrsi_engine.errors import InputError
from hrsi.hrsi_engine.ortho.point_surface import surface_of_points
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


def test_blunders_are_left_out() -> None:
    ground = points(2000)
    ground[::100, 2] += 150.0
    surface, left_out = surface_of_points(ground)
    assert 20 <= left_out <= 40
    left = np.abs(surface_heights(surface, ground[::100, :2]) - (ground[::100, 2] - 150.0))
    assert np.median(left) < 1.0 and left.max() < 50.0  # none of 150 m is left; the largest stand outside the triangles


def test_a_surface_needs_three_points() -> None:
    with pytest.raises(InputError, match="3 points"):
        surface_of_points(points(5)[:2])
