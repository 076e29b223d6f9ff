"""Positions of orthoimage pixels in the raw image: GDAL's RPC transformer with the same DEM is the oracle."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest
from osgeo import gdal

import hrsi.hrsi_engine.ortho.mapping as mapping_module
from hrsi.hrsi_engine.block.jitter_curve import JitterCurve
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.thresholds import GRIDS, MEMORY
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.ortho.grid import GridWindow, MapGrid, find_terrain_points, round_resolution
from hrsi.hrsi_engine.ortho.mapping import OrthoMapping
from hrsi.hrsi_engine.surface.grid_surface import ConstantHeight, GridSurface
from hrsi.tests.ortho.scenes import CELL_DEG, SIZE, rpc_image, utm_wkt, write_dem

POSITION_PX = 1e-6  # both evaluate the same formula in double precision
MAPPED_PX = 1e-3  # interpolation between nodes of 32 px, and the polynomial of the height


def mapping(folder: Path, cell_deg: float = CELL_DEG, error_px: float = 0.05, roughness: float = 0.0) -> OrthoMapping:
    """Return the mapping of a small oblique image over a DEM."""
    image = rpc_image(folder / "image.tif")
    surface = open_dem(write_dem(folder / "dem.tif", cell_deg, roughness), "ellipsoidal")
    centre = image.rpc.localize(image.centre_px[None], 250.0).ground
    x, y = pyproj.Transformer.from_crs(4326, utm_wkt(), always_xy=True).transform(centre[0, 0], centre[0, 1])
    grid = MapGrid.from_bounds(utm_wkt(), 1.0, (x - 300.0, y - 280.0, x + 310.0, y + 270.0))
    return OrthoMapping(image.rpc, image.size, surface, find_terrain_points(image, surface), grid, error_px)


def by_gdal(folder: Path, found: OrthoMapping, pixels: np.ndarray) -> np.ndarray:
    """Return GDAL's image positions of the grid's pixels; its pixel counts from the corner."""
    dataset = gdal.Open(str(folder / "image.tif"))
    options = ["METHOD=RPC", f"RPC_DEM={folder / 'dem.tif'}", f"DST_SRS={found.grid.crs}"]
    transformer = gdal.Transformer(dataset, None, options)
    x = (found.grid.left + pixels[:, 0] + 0.5) * found.grid.resolution
    y = (found.grid.top - pixels[:, 1] - 0.5) * found.grid.resolution
    points, good = transformer.TransformPoints(1, np.column_stack([x, y, np.zeros(len(x))]).tolist())
    assert all(good)
    return np.array(points)[:, :2] - 0.5


def pixels_of(grid: MapGrid, count: int = 300) -> np.ndarray:
    return np.random.default_rng(5).integers(0, [grid.columns, grid.rows], (count, 2)).astype(float)


def test_exact_positions_are_gdals(tmp_path: Path) -> None:
    found = mapping(tmp_path)
    pixels = pixels_of(found.grid)
    assert np.abs(found.exact(pixels) - by_gdal(tmp_path, found, pixels)).max() < POSITION_PX


@pytest.mark.parametrize(("cell_deg", "roughness"), [(3e-4, 0.0), (1e-5, 3.0)])
def test_positions_follow_hills_and_houses(tmp_path: Path, cell_deg: float, roughness: float) -> None:
    found = mapping(tmp_path, cell_deg, 0.05, roughness)
    errors = []
    for window in found.grid.chunks(256):
        chunk = found.chunk(window)
        if chunk is None:
            continue  # beside the image
        at = pixels_of(MapGrid(found.grid.crs, 1.0, 0, 0, window.columns, window.rows), 100)
        theirs = by_gdal(tmp_path, found, at + (window.column, window.row))
        errors.append(np.hypot(*(chunk.interpolate(at) - theirs).T))
        assert chunk.errors_px.max() <= MAPPED_PX
    assert len(errors) >= 4 and np.concatenate(errors).max() <= MAPPED_PX


@pytest.mark.parametrize("relief_m", [20.0, 4000.0])
def test_the_polynomial_of_the_height_follows_any_relief(tmp_path: Path, relief_m: float) -> None:
    found = mapping(tmp_path)
    assert isinstance(found.surface, GridSurface)
    flat = found.surface
    slope = GridSurface(
        flat.shape, lambda row, column, rows, columns: np.tile(
            np.linspace(0.0, relief_m, flat.shape[1])[column : column + columns], (rows, 1)), flat.grid_coordinates,
    )  # fmt: skip
    terrain = found.terrain.copy()
    terrain[:, 2] = slope.heights(slope.grid_coordinates(terrain[:, :2]))
    steep = replace(found, surface=slope, terrain=terrain)
    chunk = steep.chunk(GridWindow(0, 0, 512, 512))
    assert chunk is not None and chunk.errors_px.max() < MAPPED_PX


def test_constant_height_needs_no_position_between_the_nodes(tmp_path: Path) -> None:
    found = mapping(tmp_path)
    terrain = np.column_stack([found.terrain[:, :2], np.full(len(found.terrain), 240.0)])
    chunk = replace(found, surface=ConstantHeight(240.0), terrain=terrain).chunk(GridWindow(0, 0, 256, 256))
    assert chunk is not None and chunk.step == GRIDS.spacing_px and chunk.errors_px.max() < 1e-3


def test_error_zero_takes_every_pixel(tmp_path: Path) -> None:
    found = mapping(tmp_path, error_px=0.0)
    window = GridWindow(100, 90, 40, 30)
    chunk = found.chunk(window)
    assert chunk is not None and chunk.step == 1
    rows, columns = np.indices((30, 40))
    pixels = np.column_stack([columns.ravel() + 100.0, rows.ravel() + 90.0])
    assert np.abs(chunk.interpolate(pixels - (100.0, 90.0)) - by_gdal(tmp_path, found, pixels)).max() < POSITION_PX


@pytest.mark.parametrize("size", [(200, 150), (256, 33), (31, 64), (1, 1)])
def test_windows_of_any_size_have_the_same_positions(tmp_path: Path, size: tuple[int, int]) -> None:
    """Those of the complete grid to the rounding of BLAS, with the pixels around it that GDAL's averages need."""
    found = mapping(tmp_path, 1e-5, roughness=3.0)
    whole = found.chunk(GridWindow(0, 0, found.grid.columns, found.grid.rows))
    part = found.chunk(GridWindow(250, 230, *size))
    assert whole is not None and part is not None and part.positions.shape == (2, size[1] + 2, size[0] + 2)
    assert np.abs(part.positions - whole.positions[:, 230 : 232 + size[1], 250 : 252 + size[0]]).max() < 1e-10


def test_cells_of_very_fine_terrain_are_not_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Heights are then those of the surface."""
    nodes = []
    for most in (MEMORY.values, 1000):
        monkeypatch.setattr(mapping_module, "MEMORY", replace(MEMORY, values=most))
        chunk = mapping(tmp_path, 1e-5, roughness=3.0).chunk(GridWindow(64, 64, 200, 150))
        nodes.append(chunk.positions)
    assert np.abs(nodes[0] - nodes[1]).max() < POSITION_PX


def test_ground_without_height_has_no_position(tmp_path: Path) -> None:
    found = mapping(tmp_path)
    assert isinstance(found.surface, GridSurface)
    surface = found.surface
    hole = GridSurface(surface.shape, lambda *window: with_hole(surface, *window), surface.grid_coordinates)
    found = replace(found, surface=hole)
    window = GridWindow(0, 0, found.grid.columns, found.grid.rows)
    chunk = found.chunk(window)
    assert chunk is not None and chunk.step == 1
    known = np.isfinite(chunk.positions[0, 1:-1, 1:-1])
    rows, columns = np.indices(known.shape)
    grid = surface.grid_coordinates(found.grid.lonlat(np.column_stack([columns.ravel(), rows.ravel()]).astype(float)))
    expected = np.isfinite(hole.heights(grid)).reshape(known.shape)
    assert (known == expected).all() and 0 < (~known).sum() < known.size
    assert chunk.unknown == pytest.approx((~known).sum(), rel=0.2)  # counted on a coarse grid


def with_hole(surface: GridSurface, row: int, column: int, rows: int, columns: int) -> np.ndarray:
    """Return cells of a surface without those near its middle."""
    first_row, first_column, cells = surface.window(
        np.array([column, row], dtype=float), np.array([column + columns - 1, row + rows - 1], dtype=float)
    )
    i, j = np.indices(cells.shape)
    near = np.hypot(i + first_row - surface.shape[0] / 2, j + first_column - surface.shape[1] / 2) < 4.0
    return np.where(near, np.nan, cells)[row - first_row :, column - first_column :][:rows, :columns]


def test_chunks_beside_the_image_are_left_out(tmp_path: Path) -> None:
    found = mapping(tmp_path)
    far = replace(found, size=(5, 5))
    assert far.chunk(GridWindow(0, 0, 64, 64)) is None
    assert SIZE[0] > 5


@pytest.mark.parametrize("error_px", [0.0, 0.02])
def test_jitter_of_the_image_displaces_its_lines(tmp_path: Path, error_px: float) -> None:
    plain = mapping(tmp_path, error_px=error_px)
    line = np.arange(plain.size[1])
    shift = np.column_stack([2.0 * np.sin(2.0 * np.pi * line / 90.0), 0.7 * np.cos(2.0 * np.pi * line / 120.0)])
    shaken = replace(plain, jitter=JitterCurve(0, shift, np.zeros_like(shift)))
    window = GridWindow(150, 150, 200, 200)
    pixels = np.random.default_rng(6).integers(150, 350, (500, 2)).astype(float)
    ideal = by_gdal(tmp_path, plain, pixels)
    expected = ideal + np.column_stack([np.interp(ideal[:, 1], line, axis) for axis in shift.T])
    assert np.abs(shaken.exact(pixels) - expected).max() < POSITION_PX
    found = shaken.chunk(window)
    assert np.hypot(*(found.interpolate(pixels - 150.0) - expected).T).max() <= (MAPPED_PX if error_px else POSITION_PX)


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
