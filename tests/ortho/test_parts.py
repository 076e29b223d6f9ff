"""Orthoimages of parts of an area, put together, have the pixels of that of the whole area."""

from pathlib import Path

import numpy as np
import pytest
from long_tests import mark_beyond
from osgeo import gdal

from hrsi.hrsi_engine.io.rasters.ortho_warp import Warp
from hrsi.hrsi_engine.io.rasters.orthoimages import chunk_windows
from hrsi.hrsi_engine.ortho.grid import MapGrid
from hrsi.processing_algorithms import run


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An oblique image over hills, a DSM with houses and a gap."""
    folder = tmp_path_factory.mktemp("scene")
    run("simulate", images=1, along="20", size=400, gcps=2, checks=0, ties=0, relief=60.0, output_dir=str(folder))
    dsm = gdal.Warp(str(folder / "dsm.tif"), str(folder / "dem.tif"), dstSRS="EPSG:32631", xRes=1.0, yRes=1.0)
    heights = dsm.ReadAsArray()
    rows, columns = np.indices(heights.shape)
    heights[((rows % 40) < 12) & ((columns % 50) < 15)] += 6.0
    heights[150:156, 160:170] = -9999.0
    dsm.GetRasterBand(1).SetNoDataValue(-9999.0)
    dsm.WriteArray(heights)
    return folder


@pytest.mark.parametrize(
    "options",
    mark_beyond(
        2, "thorough",
        [{"dem": "dsm.tif"}, {"dem": "dem.tif", "resampling": "average", "resolution": 1.3}, {"height": 100.0},
         {"dem": "dsm.tif", "visibility": True}, {"dem": "dsm.tif", "resampling": "lanczos", "resolution": 0.9},
         {"dem": "dsm.tif", "error_px": 0.0}],
    ),
)  # fmt: skip
def test_parts_of_an_orthoimage(scene: Path, tmp_path: Path, options: dict[str, object]) -> None:
    options = {"crs": "EPSG:32631", "height_datum": "ellipsoidal", "resolution": 0.5, **options}
    if "dem" in options:
        options["dem"] = str(scene / str(options["dem"]))

    def make(name: str, **extent: str) -> tuple[np.ndarray, tuple[float, ...]]:
        given = {"images": [str(scene / "image_1.tif")], "output_dir": str(tmp_path / name), **options, **extent}
        (entry,) = run("orthorectify", **given)["images"].values()
        dataset = gdal.Open(entry["output"])
        return dataset.ReadAsArray().astype(int), dataset.GetGeoTransform()

    whole, (west, size, _, north, _, _) = make("whole")
    joined = np.zeros_like(whole)
    rows, columns = whole.shape
    for top, bottom in ((0, rows // 2 - 13), (rows // 2 - 13, rows)):
        for left, right in ((0, columns // 2 + 7), (columns // 2 + 7, columns)):
            extent = west + size * left, north - size * bottom, west + size * right, north - size * top
            part, _ = make(f"part_{top}_{left}", extent=",".join(f"{value:.1f}" for value in extent))
            joined[top:bottom, left:right] = part
    assert np.array_equal(joined, whole) and (whole > 0).mean() > 0.5


@pytest.mark.parametrize("scale", [1.0, 8.0, 64.0])
def test_chunks_of_overviews_too_are_no_slivers_and_fit_into_the_memory(scale: float) -> None:
    """GDAL takes for each chunk as long as for 50 rows; the part of the image, here bytes, has half a gigabyte."""
    windows = list(chunk_windows(MapGrid("", 1.0, 0, 0, 4096, 4096), Warp("near", scale, None)))
    assert sum(one.columns * one.rows for one in windows) == 4096 * 4096
    assert all(one.rows >= 50 for one in windows)
    assert max(one.columns * scale * one.rows * scale for one in windows) <= 2**29
