"""Hidden ground against lines of sight that are followed in steps of centimetres by the RPC itself."""

from dataclasses import replace

import numpy as np
import pytest

from hrsi.hrsi_engine.ground.crs_operations import operations_of
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.ortho import mapping as mapping_module
from hrsi.hrsi_engine.ortho.grid import GridWindow, MapGrid, find_terrain_points
from hrsi.hrsi_engine.ortho.mapping import OrthoMapping
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.hrsi_engine.surface.grid_surface import GridSurface
from hrsi.tests.ortho.scenes import camera, rpc_image, utm_wkt, write_dem

HOUSES_M = 25.0


@pytest.fixture(scope="module")
def mapping(tmp_path_factory: pytest.TempPathFactory) -> OrthoMapping:
    """An oblique view (20 degrees) of hills with houses of 25 m."""
    folder = tmp_path_factory.mktemp("scene")
    image = rpc_image(folder / "a.tif", camera(0.35))
    surface = open_dem(write_dem(folder / "dsm.tif", 1e-5, HOUSES_M), "ellipsoidal")
    terrain = find_terrain_points(image, surface)
    x, y = np.round(operations_of(utm_wkt()).from_wgs84(terrain[len(terrain) // 2][None])[0, :2])
    grid = MapGrid.from_bounds(utm_wkt(), 0.5, (x - 60, y - 50, x + 60, y + 50))
    assert image.size is not None
    return OrthoMapping(image.rpc, image.size, surface, terrain, grid, 0.05, masks_occlusions=True)


def hidden_of(mapping: OrthoMapping, window: GridWindow) -> np.ndarray:
    chunk = mapping.chunk(window)
    return np.isnan(chunk.positions[0, 1:-1, 1:-1])


def highest_above_ray(mapping: OrthoMapping, pixels: np.ndarray) -> np.ndarray:
    """Return the largest height (m) of the surface above the lines of sight of pixels, in steps of 2 cm."""
    lonlat = mapping.grid.lonlat(pixels)
    height = surface_heights(mapping.surface, lonlat)
    image = mapping.rpc.project(np.column_stack([lonlat, height]))
    largest = np.full(len(pixels), -np.inf)
    for rise in np.arange(0.02, HOUSES_M + 10.0, 0.02):
        on_ray = mapping.rpc.localize(image, height + rise).ground
        largest = np.maximum(largest, surface_heights(mapping.surface, on_ray[:, :2]) - on_ray[:, 2])
    return largest


def test_hidden_pixels_are_those_of_dense_ray_casting(mapping: OrthoMapping) -> None:
    """Only rays that touch the surface may differ, to 3 cm: steps of the oracle, and the limit of 1 cm."""
    grid = mapping.grid
    hidden = hidden_of(mapping, GridWindow(0, 0, grid.columns, grid.rows))
    pixels = np.random.default_rng(4).integers(0, [grid.columns, grid.rows], (2000, 2))
    clearance = highest_above_ray(mapping, pixels)
    ours, is_clear = hidden[pixels[:, 1], pixels[:, 0]], (clearance < -0.005) | (clearance > 0.03)
    assert np.array_equal(ours[is_clear], clearance[is_clear] > 0.0)
    assert is_clear.mean() > 0.98 and 0.05 < ours.mean() < 0.5


def test_any_window_and_any_size_of_the_surface_give_the_same(
    mapping: OrthoMapping, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = mapping.grid
    whole = hidden_of(mapping, GridWindow(0, 0, grid.columns, grid.rows))
    window = GridWindow(37, 51, 150, 120)
    part = np.s_[51:171, 37:187]
    assert np.array_equal(hidden_of(mapping, window), whole[part])
    monkeypatch.setattr(mapping_module, "MEMORY", replace(mapping_module.MEMORY, cells=3000))
    assert np.array_equal(hidden_of(mapping, window), whole[part])
    monkeypatch.setattr(type(mapping_module.VISIBILITY), "block", 5)
    assert np.array_equal(hidden_of(mapping, window), whole[part])


def test_a_wall_hides_what_its_height_and_the_view_direction_say() -> None:
    """On a plane with a wall 10 m high, a sensor in the east at 45 degrees does not see 10 m west of it."""
    cells = np.zeros((40, 200))
    cells[:, 100:110] = 10.0
    cells[5, 103] = np.nan  # a gap in the wall hides nothing itself
    surface = GridSurface(cells.shape, lambda i, j, m, n: cells[i : i + m, j : j + n], lambda lonlat: lonlat)
    column, row = np.meshgrid(np.arange(0.0, 224.0, 32.0), np.arange(0.0, 72.0, 32.0))
    lattice = np.stack([column, row, np.ones_like(column), np.zeros_like(column)])  # a cell to the east for each metre
    hidden = mapping_module.find_occlusions(surface, lattice, 32, (0, 0), (40, 192))
    # Foot of the wall: 99; its edge at 100 is above the line of sight from 91 to 99
    assert np.array_equal(np.flatnonzero(hidden[20]), np.arange(91, 100))


def test_level_ground_and_a_view_from_above_hide_nothing() -> None:
    for cells, slope in ((np.zeros((50, 50)), 1.0), (np.random.default_rng(1).uniform(0, 30, (50, 50)), 0.0)):
        surface = GridSurface(cells.shape, lambda i, j, m, n, c=cells: c[i : i + m, j : j + n], lambda lonlat: lonlat)
        column, row = np.meshgrid(np.arange(0.0, 96.0, 32.0), np.arange(0.0, 96.0, 32.0))
        lattice = np.stack([column, row, np.full_like(column, slope), np.zeros_like(column)])
        assert not mapping_module.find_occlusions(surface, lattice, 32, (0, 0), (48, 48)).any()
