"""The map grid: alignment, extents, round resolutions."""

import numpy as np
import pyproj
import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ortho.grid import MapGrid, round_resolution

UTM = pyproj.CRS.from_epsg(32631).to_wkt()


@pytest.mark.parametrize(
    ("gsd", "resolution"), [(0.5, 0.5), (0.52, 0.5), (0.49, 0.5), (0.72, 0.7), (6.5, 6.0), (1.65, 1.5), (9.8, 10.0)]
)
def test_resolutions_are_round_and_never_much_coarser(gsd: float, resolution: float) -> None:
    assert round_resolution(gsd) == resolution
    assert round_resolution(gsd) <= 1.05 * gsd


@pytest.mark.parametrize("gsd", [0.0, -1.0, np.nan, np.inf])
def test_no_resolution_without_a_pixel_size(gsd: float) -> None:
    with pytest.raises(InputError, match="`resolution`"):
        round_resolution(gsd)


def test_edges_are_whole_multiples_and_hold_the_bounds() -> None:
    grid = MapGrid.from_bounds(UTM, 0.3, (500_000.1, 4_800_000.2, 500_123.4, 4_800_056.7))
    west, south, east, north = grid.bounds
    inside = np.array([500_000.1 - west, 4_800_000.2 - south, east - 500_123.4, north - 4_800_056.7])
    assert (inside > -1e-6).all()  # an edge that lies on the lattice stays there
    assert east - west < 123.3 + 0.6 and north - south < 56.5 + 0.6
    for edge in grid.bounds:
        assert edge / 0.3 == pytest.approx(round(edge / 0.3), abs=1e-6)


def test_bounds_on_the_lattice_stay_as_they_are() -> None:
    grid = MapGrid.from_bounds(UTM, 0.1, (500_000.0, 4_800_000.0, 500_010.0, 4_800_005.0))
    assert (grid.columns, grid.rows) == (100, 50)
    assert MapGrid.from_bounds(UTM, 0.1, grid.bounds) == grid


def test_positions_are_those_of_pixel_centres() -> None:
    grid = MapGrid.from_bounds(UTM, 2.0, (500_000.0, 4_800_000.0, 500_100.0, 4_800_100.0))
    back = pyproj.Transformer.from_crs(4326, 32631, always_xy=True)
    x, y = back.transform(*grid.lonlat(np.array([[0.0, 0.0], [49.0, 49.0]])).T)
    assert np.allclose(x, [500_001.0, 500_099.0], atol=1e-6) and np.allclose(y, [4_800_099.0, 4_800_001.0], atol=1e-6)


@pytest.mark.parametrize("size", [(512,), (1024, 512), (100, 130)])
def test_chunks_and_their_parts_cover_each_pixel_once(size: tuple[int, ...]) -> None:
    grid = MapGrid(UTM, 1.0, 0, 0, 1000, 700)
    count = np.zeros((2, 700, 1000), dtype=int)
    for window in grid.chunks(*size):
        for level, parts in enumerate(([window], window.parts(128, 64))):
            for part in parts:
                count[level, part.row : part.row + part.rows, part.column : part.column + part.columns] += 1
    assert (count == 1).all()


def test_pixels_lie_where_the_geotransform_and_proj_say() -> None:
    grid = MapGrid.from_bounds(UTM, 0.7, (500_010.0, 5_300_000.0, 500_150.0, 5_300_100.0))
    pixels = np.random.default_rng(1).uniform(-3.0, 200.0, (50, 2))
    x0, dx, _, y0, _, dy = grid.geotransform
    to_wgs84 = pyproj.Transformer.from_crs(32631, 4326, always_xy=True)
    expected = to_wgs84.transform(x0 + dx * (pixels[:, 0] + 0.5), y0 + dy * (pixels[:, 1] + 0.5))
    np.testing.assert_allclose(grid.lonlat(pixels), np.column_stack(expected), rtol=0.0, atol=1e-10)  # 0.01 mm
