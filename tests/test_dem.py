"""Ray-surface intersection against analytic surfaces, a simulated cliff and a brute-force search."""

import numpy as np
import pytest

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.thresholds import ITERATIONS
from hrsi.hrsi_engine.surface.dem import RAY_TRACING, Status, dem_sigma_m, intersect_surface, surface_heights
from hrsi.hrsi_engine.surface.grid_surface import SURFACE, ConstantHeight, GridSurface
from hrsi.tests.test_rpc import synthetic_rpc

HEIGHT_M = 1e-3  # what `intersect_surface` promises
CELL_DEG = 0.0005
LON, LAT = 12.0, 48.0


def oblique_rpc() -> RPC:
    """A camera that looks 35 degrees off the vertical: samples move 0.7 px for a metre of height."""
    rpc = synthetic_rpc(LON, LAT)
    samp_num = rpc.samp_num.copy()
    samp_num[3] = 0.7 * rpc.height_scale / rpc.samp_scale * rpc.samp_scale / 5600.0
    return RPC(**{**{name: getattr(rpc, name) for name in rpc.__dataclass_fields__}, "samp_num": samp_num})


def grid_surface(heights_of: object, half_deg: float = 0.12) -> GridSurface:
    """Return the surface whose cells are ``heights_of(lon, lat)`` around the camera's field."""
    count = int(2 * half_deg / CELL_DEG) + 1
    lon = LON - half_deg + CELL_DEG * np.arange(count)
    lat = LAT + half_deg - CELL_DEG * np.arange(count)
    return GridSurface.from_array(heights_of(*np.meshgrid(lon, lat)), (lon[0], lat[0]), (CELL_DEG, -CELL_DEG))


def image_points(count: int = 400) -> np.ndarray:
    return np.random.default_rng(11).uniform(500, 10300, (count, 2))


def test_a_constant_height_is_localize() -> None:
    rpc, image = synthetic_rpc(LON, LAT), image_points()
    ground, status = intersect_surface(rpc, image, ConstantHeight(123.0))
    assert (status == Status.FOUND).all()
    expected = rpc.localize(image, 123.0).ground
    np.testing.assert_allclose(ground[:, 2], 123.0, atol=HEIGHT_M)
    np.testing.assert_allclose(ground[:, :2], expected[:, :2], atol=1e-8)  # 1 mm


def test_a_tilted_plane_is_met_exactly() -> None:
    """On a plane bilinear interpolation is exact: the point lies on the ray and on the plane."""
    rpc, image = oblique_rpc(), image_points()

    def plane(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        return 300.0 + 2000.0 * (lon - LON) - 1500.0 * (lat - LAT)

    ground, status = intersect_surface(rpc, image, grid_surface(plane))
    assert (status == Status.FOUND).all()
    np.testing.assert_allclose(ground[:, 2], plane(ground[:, 0], ground[:, 1]), atol=HEIGHT_M)
    np.testing.assert_allclose(rpc.project(ground), image, atol=1e-8)


def test_the_first_hit_counts_behind_a_cliff() -> None:
    """A wall of 300 m: points behind it, as the camera sees them, are hidden, and no hit lies under the terrain.

    The oracle is brute force: the highest of many positions along the ray that is at or under the terrain.
    """
    rpc, image = oblique_rpc(), image_points(600)
    surface = grid_surface(lambda lon, lat: np.where(np.abs(lon - LON) < 0.004, 500.0, 200.0))
    ground, status = intersect_surface(rpc, image, surface)
    assert (status == Status.FOUND).all()
    low, high = 200.0, 500.0
    heights = np.linspace(high, low, 1501)
    first = np.full(len(image), np.nan)
    for height in heights:
        point, _ = rpc.localize(image, height)
        under = np.isnan(first) & (surface_heights(surface, point[:, :2]) >= height - 1e-6)
        first[under] = height
    differs = np.abs(ground[:, 2] - first) > 1.5 * (heights[0] - heights[1])
    assert np.mean(differs) < 0.01  # rays that graze the wall's upper edge within half a cell
    assert 0.02 < np.mean((ground[:, 2] > 201.0) & (ground[:, 2] < 499.0)) < 0.5  # the wall itself is seen
    np.testing.assert_allclose(rpc.project(ground), image, atol=1e-8)


def test_gaps_and_edges_are_told_apart() -> None:
    rpc = oblique_rpc()
    surface = grid_surface(lambda lon, lat: np.where(lat > LAT + 0.01, np.nan, 300.0), half_deg=0.03)
    inside = rpc.project(np.array([[LON, LAT - 0.01, 300.0], [LON, LAT + 0.02, 300.0], [LON + 0.05, LAT, 300.0]]))
    image = np.vstack([inside, [[np.nan, 1.0]]])
    ground, status = intersect_surface(rpc, image, surface)
    assert [Status(code) for code in status] == [Status.FOUND, Status.NODATA, Status.OUTSIDE, Status.NO_RAY]
    np.testing.assert_allclose(ground[0], [LON, LAT - 0.01, 300.0], atol=HEIGHT_M)
    assert np.isnan(ground[1:]).all()


def test_a_ray_over_a_gap_meets_the_ground_behind_it() -> None:
    """A void high above the line of sight does not hide the ground; a void at the hit does."""
    rpc = oblique_rpc()
    flat = 300.0

    def with_void(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        heights = np.full(lon.shape, flat)
        heights[:2, :2] = 900.0  # so that rays start high up
        heights[np.abs(lon - (LON - 0.004)) < 0.0011] = np.nan
        return heights

    clear = rpc.project(np.array([[LON, LAT, flat], [LON - 0.004, LAT, flat], [LON - 0.02, LAT, flat]]))
    ground, status = intersect_surface(rpc, clear, grid_surface(with_void, half_deg=0.04))
    assert [Status(code) for code in status] == [Status.FOUND, Status.NODATA, Status.FOUND]
    np.testing.assert_allclose(ground[[0, 2], 2], flat, atol=HEIGHT_M)


def test_terrain_beyond_the_rpcs_height_range_is_found() -> None:
    rpc = oblique_rpc()
    image = image_points(50)
    for height in (-900.0, 4000.0):
        surface = grid_surface(lambda lon, lat, height=height: np.full(lon.shape, height))
        ground, status = intersect_surface(rpc, image, surface)
        assert (status == Status.FOUND).all()
        np.testing.assert_allclose(ground[:, 2], height, atol=HEIGHT_M)


def test_no_part_of_the_surface_is_read_that_no_ray_passes() -> None:
    reads = []
    shape = (40 * SURFACE.tile, 40 * SURFACE.tile)

    def read(row: int, column: int, rows: int, columns: int) -> np.ndarray:
        reads.append((row, column))
        return np.full((rows, columns), 250.0)

    def to_grid(lonlat: np.ndarray) -> np.ndarray:
        return np.column_stack([(lonlat[:, 0] - LON) / 1e-5 + 5000.0, (LAT - lonlat[:, 1]) / 1e-5 + 5000.0])

    ground, _ = intersect_surface(
        synthetic_rpc(LON, LAT), np.array([[5000.0, 5000.0]]), GridSurface(shape, read, to_grid)
    )
    assert ground[0, 2] == pytest.approx(250.0, abs=HEIGHT_M)
    assert len(reads) <= 6
    assert len(set(reads)) == len(reads)


def test_gaps_and_surroundings_take_the_heights_of_another_surface() -> None:
    """Between cells of one kind the heights are those of one surface; both are planes, so that bilinear is exact."""
    holes = np.add.outer(300.0 + np.arange(60.0), 2.0 * np.arange(80.0))
    holes[20:40, 30:50] = np.nan
    surface = GridSurface.from_array(holes, (LON, LAT), (1e-4, -1e-4))
    base = GridSurface.from_array(np.add.outer(50.0 + np.arange(30.0), np.zeros(40)), (LON - 4e-3, LAT + 4e-3),
                                  (5e-4, -5e-4))  # fmt: skip
    filled = surface.fill_from(base)
    lonlat = np.array([LON, LAT]) + 1e-4 * np.array([[10.3, -10.6], [40.2, -29.7], [-20.4, 10.9], [90.1, -70.2]])
    of_base = surface_heights(base, lonlat)
    expected = [surface_heights(surface, lonlat[:1])[0], *of_base[1:]]
    np.testing.assert_allclose(surface_heights(filled, lonlat), expected, atol=1e-9)
    assert np.isnan(surface_heights(surface, lonlat[1:])).all()
    ends = np.array([[LON - 4e-3, LAT + 4e-3], [LON + 15.5e-3, LAT - 10.5e-3]])
    np.testing.assert_allclose(surface_heights(filled, ends), [50.0, 79.0], atol=1e-6)  # the corners of the other one


def test_rays_are_followed_in_steps_of_the_grid() -> None:
    """A ray over 500 m of height, 35 degrees off the vertical, is sampled as often as its way over the cells asks."""
    rpc, image = oblique_rpc(), image_points()
    surface = grid_surface(lambda lon, lat: 300.0 + 2000.0 * (lon - LON))
    calls, heights = [], surface.heights

    def count(grid: np.ndarray) -> np.ndarray:
        calls.append(len(grid))
        return heights(grid)

    surface.heights = count
    _, status = intersect_surface(rpc, image, surface)
    assert (status == Status.FOUND).all()
    ends = [rpc.localize(image, height).ground[:, :2] for height in (0.0, 600.0)]  # all terrain, and some more
    cells = np.abs(ends[1] - ends[0]).max() / CELL_DEG
    assert 4.0 < cells < 20.0
    assert len(calls) < cells / RAY_TRACING.step + ITERATIONS.most + 4


def test_heights_are_bilinear_across_tiles() -> None:
    rng = np.random.default_rng(12)
    cells = rng.normal(size=(2 * SURFACE.tile + 3, SURFACE.tile + 1))
    surface = GridSurface.from_array(cells, (0.0, 0.0), (1.0, 1.0))
    grid = rng.uniform((0, 0), (SURFACE.tile, 2 * SURFACE.tile + 2), (500, 2))
    column, row = grid.T
    i, j = row.astype(int), column.astype(int)
    y, x = row - i, column - j
    expected = (
        cells[i, j] * (1 - x) * (1 - y)
        + cells[i, np.minimum(j + 1, SURFACE.tile)] * x * (1 - y)
        + cells[i + 1, j] * (1 - x) * y
        + cells[i + 1, np.minimum(j + 1, SURFACE.tile)] * x * y
    )
    np.testing.assert_allclose(surface.heights(grid), expected, atol=1e-12)
    edge = np.array([[-0.5, 0.0], [SURFACE.tile + 0.5, 2.0], [-0.51, 0.0], [0.0, 2 * SURFACE.tile + 2.51]])
    np.testing.assert_allclose(surface.heights(edge), [cells[0, 0], cells[2, SURFACE.tile], np.nan, np.nan])


def test_a_grid_across_the_180_degree_meridian() -> None:
    surface = GridSurface.from_array(np.arange(12.0).reshape(3, 4), (179.0, 10.0), (1.0, -1.0))
    np.testing.assert_allclose(
        surface_heights(surface, np.array([[-179.0, 9.0], [180.0, 8.0], [-180.0, 8.0]])), [6, 9, 9]
    )


@pytest.mark.parametrize(("cell_m", "sigma_m"), [(1.0, 0.4), (30.0, 3.0), (90.0, 9.0)])
def test_assumed_errors_of_dems_are_those_of_their_producers(cell_m: float, sigma_m: float) -> None:
    """Laser DEMs of 1 m, TanDEM-X and GLO-30, SRTM."""
    assert dem_sigma_m(cell_m) == pytest.approx(sigma_m, rel=0.15)
