"""Orthoimages of parts of an area, put together, cover the same pixels as that of the whole area."""

from pathlib import Path

import numpy as np
from osgeo import gdal

from hrsi.processing_algorithms import run


def test_parts_of_an_orthoimage(tmp_path: Path) -> None:
    """No pixel is missing or too many at the border of the image or between parts: their nodes are the same."""
    run("simulate", images=1, along="10", size=400, gcps=2, checks=0, ties=0, relief=60.0, output_dir=str(tmp_path))
    given = {"images": [str(tmp_path / "image_1.tif")], "dem": str(tmp_path / "dem.tif"), "crs": "EPSG:32631",
             "height_datum": "ellipsoidal", "resolution": 0.5}  # fmt: skip

    def make(name: str, **extent: str) -> tuple[np.ndarray, tuple[float, ...]]:
        (entry,) = run("orthorectify", output_dir=str(tmp_path / name), **given, **extent)["images"].values()
        dataset = gdal.Open(entry["output"])
        return dataset.ReadAsArray().astype(int), dataset.GetGeoTransform()

    whole, (west, _, _, north, _, _) = make("whole")
    joined = np.zeros_like(whole)
    rows, columns = whole.shape
    for top, bottom in ((0, rows // 2 - 13), (rows // 2 - 13, rows)):
        for left, right in ((0, columns // 2 + 7), (columns // 2 + 7, columns)):
            extent = west + 0.5 * left, north - 0.5 * bottom, west + 0.5 * right, north - 0.5 * top
            part, _ = make(f"part_{top}_{left}", extent=",".join(f"{value:.1f}" for value in extent))
            joined[top:bottom, left:right] = part
    assert ((joined == 0) == (whole == 0)).all() and (whole > 0).mean() > 0.5
