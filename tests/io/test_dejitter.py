"""Images are resampled without jitter: against images of the same scene that a formula gives without and with it."""

import numpy as np
import pytest
from osgeo import gdal

from hrsi.hrsi_engine.block.jitter_curve import JitterCurve
from hrsi.hrsi_engine.io.rasters.dejitter import rewrite_without_jitter

SAMPLES, LINES = 150, 700  # of lines more than are done at once


def scene(sample, line):
    """Return grey values of a smooth scene, whose shortest wave is 12 px."""
    return 1000.0 + 300.0 * np.sin(2 * np.pi * sample / 12.0 + 0.4) * np.cos(2 * np.pi * line / 15.0)


def write(path, grey, nodata=None):
    kind = {"uint16": gdal.GDT_UInt16, "float32": gdal.GDT_Float32}[str(grey.dtype)]
    made = gdal.GetDriverByName("GTiff").Create(str(path), SAMPLES, LINES, 1, kind, ["TILED=YES", "COMPRESS=DEFLATE"])
    if nodata is not None:
        made.GetRasterBand(1).SetNoDataValue(nodata)
    made.GetRasterBand(1).WriteArray(grey)
    made.FlushCache()


@pytest.mark.parametrize("kind", ["uint16", "float32"])
def test_pixels_are_those_of_the_steady_image(tmp_path, kind):
    line = np.arange(LINES)
    curve = JitterCurve(
        0, np.column_stack([2.3 * np.sin(line / 40.0), 1.4 * np.cos(line / 55.0)]), np.zeros((LINES, 2))
    )
    # A shaken image shows at its pixel what the steady one has where the curve is removed
    pixels = np.stack(np.meshgrid(np.arange(SAMPLES), line), axis=-1).reshape(-1, 2).astype(float)
    shaken = scene(*curve.remove_from(pixels).T).reshape(LINES, SAMPLES).round().astype(kind)
    steady = scene(*pixels.T).reshape(LINES, SAMPLES)
    for name in ("source.tif", "copy.tif"):
        write(tmp_path / name, shaken)
    rewrite_without_jitter(str(tmp_path / "source.tif"), str(tmp_path / "copy.tif"), curve)
    found = gdal.Open(str(tmp_path / "copy.tif")).ReadAsArray()
    assert found.dtype == kind
    inner = np.s_[5:-5, 5:-5]
    assert np.abs(shaken - steady)[inner].max() > 250.0
    # cubic convolution of a wave of 12 px: below 2 % of its 300, and the rounding
    assert np.abs(found - steady)[inner].max() < 6.0 + 1.0
    assert np.array_equal(gdal.Open(str(tmp_path / "source.tif")).ReadAsArray(), shaken)


def test_nodata_does_not_mix(tmp_path):
    grey = np.full((LINES, SAMPLES), 1000, dtype=np.uint16)
    grey[:, :40] = 0
    shift = np.tile([0.5, 0.25], (LINES, 1))
    for name in ("source.tif", "copy.tif"):
        write(tmp_path / name, grey, 0)
    rewrite_without_jitter(
        str(tmp_path / "source.tif"), str(tmp_path / "copy.tif"), JitterCurve(0, shift, np.zeros((LINES, 2)))
    )
    assert set(np.unique(gdal.Open(str(tmp_path / "copy.tif")).ReadAsArray())) == {0, 1000}
