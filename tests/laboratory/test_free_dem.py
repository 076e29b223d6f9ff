"""The free DEM and the landforms of `simulate`, from the files it writes: recomputed with GDAL, pyproj and SciPy."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from long_tests import mark_beyond
from osgeo import gdal, ogr
from pyproj import Geod
from scipy import ndimage, stats

from hrsi.hrsi_engine.laboratory.simulation.free_dem import simulate_free_dem
from hrsi.hrsi_engine.laboratory.simulation.options import FreeDemSpec
from hrsi.hrsi_engine.laboratory.simulation.terrain import Chart, TerrainSurface
from hrsi.processing_algorithms import run

#: 15 km of ground: 400 areas as large as the noise's correlation reaches, 2 pi (300 m)^2.
WIDE: dict[str, Any] = dict(sensor="wide-field", size=900, gcps=0, checks=0, ties=20, pixels=False, free_dem=30.0)
CORRELATED_M2 = 2.0 * np.pi * 300.0**2
GEOD = Geod(ellps="WGS84")


class Grid(NamedTuple):
    """Heights of a file, its geotransform, and the size of a cell (m)."""

    heights: np.ndarray
    transform: tuple[float, ...]
    cell_m: tuple[float, float]

    def sample(self, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        """Return the bilinear heights at places; beyond the rim the outermost ones."""
        x0, dx, _, y0, _, dy = self.transform
        return ndimage.map_coordinates(
            self.heights, [(lat - y0) / dy - 0.5, (lon - x0) / dx - 0.5], order=1, mode="nearest"
        )

    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Return longitude and latitude of the cells' centres."""
        x0, dx, _, y0, _, dy = self.transform
        rows, columns = np.indices(self.heights.shape) + 0.5
        return x0 + dx * columns, y0 + dy * rows


def read(path: Path) -> Grid:
    dataset = gdal.Open(str(path))
    x0, dx, _, y0, _, dy = transform = dataset.GetGeoTransform()
    middle = y0 + dy * dataset.RasterYSize / 2.0
    east, north = GEOD.inv(x0, middle, x0 + dx, middle)[2], GEOD.inv(x0, middle, x0, middle + dy)[2]
    return Grid(dataset.ReadAsArray().astype(float), transform, (east, north))


def simulate(folder: Path, **options: Any) -> tuple[Grid, Grid, np.ndarray]:
    """Return free DEM, true surface and true displacement (m) of a simulated block."""
    run("simulate", output_dir=str(folder), **(WIDE | options))
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    return read(folder / "free_dem.tif"), read(folder / "dem.tif"), np.array(truth["free_dem"]["displaced_m"])


def errors(dem: Grid, truth: Grid, displaced: np.ndarray, side: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of the DEM's cells against means of the truth displaced, and the truth's slope, inside the rim."""
    lon, lat = dem.centres()
    _, dx, _, _, _, dy = dem.transform
    inner = (np.arange(side) + 0.5) / side - 0.5
    east, north = displaced[0] / dem.cell_m[0] * dx, displaced[1] / dem.cell_m[1] * -dy
    means = np.mean([truth.sample(lon - east + dx * x, lat - north + dy * y) for x in inner for y in inner], axis=0)
    slope = np.hypot(*np.gradient(means, dem.cell_m[1], dem.cell_m[0]))
    inside = slice(20, -20)
    return (dem.heights - means - displaced[2])[inside, inside], slope[inside, inside]


@pytest.mark.thorough
def test_cell_noise_and_correlation_length(tmp_path: Path):
    dem, truth, displaced = simulate(tmp_path, landform="flat", free_dem_trees=0.0)
    np.testing.assert_allclose(dem.cell_m, 30.0, rtol=2e-3)
    error, _ = errors(dem, truth, displaced)
    independent = error.size * 900.0 / CORRELATED_M2
    assert abs(error.mean()) < 4.0 / np.sqrt(independent)
    np.testing.assert_allclose(error.std(), 1.0, rtol=4.0 / np.sqrt(2.0 * independent))
    for cells in (5, 10, 20):
        pairs = [(error[:, :-cells], error[:, cells:]), (error[:-cells], error[cells:])]
        correlation = np.mean([np.mean(a * b) for a, b in pairs]) / error.var()
        np.testing.assert_allclose(correlation, np.exp(-cells * 30.0 / 300.0), atol=4.0 / np.sqrt(independent))


def test_noise_of_three_times_that_on_steep_slopes(tmp_path: Path):
    dem, truth, displaced = simulate(tmp_path, landform="mountains", relief=2000.0, size=200, free_dem_trees=0.0)
    error, slope = errors(dem, truth, displaced)
    gentle, steep = slope < 0.1, slope > 0.4
    assert min(gentle.sum(), steep.sum()) > 3000
    # Each class is a good part of the scene: its standard deviation is known to a tenth or so
    np.testing.assert_allclose(error[steep].std(), 3.0, rtol=0.15)
    np.testing.assert_allclose((error / (1.0 + 2.0 * slope / 0.4))[gentle].std(), 1.0, rtol=0.2)


def test_truth_is_the_displacement_that_the_relief_shows(tmp_path: Path):
    dem, truth, displaced = simulate(
        tmp_path, landform="mountains", size=200, free_dem_trees=0.0, free_dem_noise=0.1, free_dem_place=25.0
    )
    assert np.hypot(*displaced[:2]) > 5.0
    found = np.zeros(3)
    for _ in range(3):  # Nuth and Kääb (2011), linear
        error, _ = errors(dem, truth, found, side=5)
        lon, lat = dem.centres()
        south, east = np.gradient(truth.sample(lon, lat)[20:-20, 20:-20], dem.cell_m[1], dem.cell_m[0])
        design = np.column_stack([-east.ravel(), south.ravel(), np.ones(error.size)])
        found = found + np.linalg.lstsq(design, error.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found, displaced, atol=0.3)


def test_buildings_are_smoothed_into_cells(tmp_path: Path):
    dem, truth, displaced = simulate(
        tmp_path, sensor="pleiades", size=1500, landform="city", relief=0.0, free_dem_trees=0.0, free_dem_noise=0.01
    )
    error, _ = errors(dem, truth, displaced, side=30)
    high = truth.heights - np.median(truth.heights)
    assert 5.0 < np.quantile(high, 0.98) < 60.0
    assert dem.heights.std() < 0.7 * truth.heights.std()
    # A cell's mean is taken at 5 x 5 places: building edges are half of them off by some metres each
    assert error.std() < 0.35 * truth.heights.std()
    assert abs(error.mean()) < 0.1
    layers = ogr.Open(str(tmp_path / "truth.gpkg"))
    objects = layers.GetLayerByName("objects")
    place = np.array([one.GetGeometryRef().GetPoint() for one in objects if one["kind"] in ("roof", "tank")])
    assert len(place) > 300
    assert np.mean(truth.sample(*place.T[:2]) - np.median(truth.heights) > 4.9) > 0.99


def test_trees_stand_in_their_share_of_the_cells(tmp_path: Path):
    dem, truth, displaced = simulate(
        tmp_path,
        landform="flat",
        relief=0.0,
        size=400,
        free_dem_trees=0.3,
        free_dem_tree_height=12.0,
        free_dem_noise=0.0,
    )
    error, _ = errors(dem, truth, displaced)
    np.testing.assert_allclose(np.mean(error > 6.0), 0.3, atol=0.05)
    assert error.max() < 12.001


@pytest.mark.parametrize(
    ("landform", "relief_m"),
    mark_beyond(2, "thorough", [("hills", 300.0), ("flat", 2.0), ("mountains", 1000.0), ("farmland", 100.0)]),
)
def test_landforms_have_their_relief(landform: str, relief_m: float, tmp_path: Path):
    _, truth, _ = simulate(tmp_path, landform=landform, size=200)
    np.testing.assert_allclose(np.ptp(truth.heights), relief_m, rtol=1e-4)


@pytest.mark.thorough
def test_displacements_are_as_large_as_glo30_is_stated_to():
    terrain = TerrainSurface(Chart(5.0, 43.0), np.full((3, 3), 100.0, dtype=np.float32), -50.0, 50.0, 50.0)
    drawn = np.array([simulate_free_dem(terrain, 60.0, FreeDemSpec(30.0), [seed, 60]).shift_m for seed in range(1000)])
    low, high = stats.binom.ppf([0.001, 0.999], len(drawn), 0.9)
    assert low <= np.sum(np.hypot(*drawn[:, :2].T) < 6.0) <= high  # 6 m CE90
    # 4 m LE90 holds the noise as well, of 1.4 m: the mean of flat ground and slopes
    assert low <= np.sum(np.abs(drawn[:, 2] + np.random.default_rng(1).normal(0.0, 1.4, len(drawn))) < 4.0) <= high
