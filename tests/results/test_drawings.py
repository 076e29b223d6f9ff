"""Pictures and chips of a report: what they show, and how much is read and written for them."""

from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from osgeo import gdal
from rpc_samples import sample_rpc

from hrsi.hrsi_engine.block.block import ArrayRaster, Image
from hrsi.hrsi_engine.block.points import GroundPoints, Role
from hrsi.hrsi_engine.io.rasters.images import GdalRaster
from hrsi.hrsi_engine.results.drawings import _make_chips, _PointSelection, _read_pictures


def test_pictures_are_those_of_images_that_are_read_in_seconds(tmp_path: Path) -> None:
    """Of a scene of gigabytes (here a hole on the disk) no picture delays the report."""
    images = []
    for name, side in (("crop", 500), ("scene", 30_000)):
        gdal.GetDriverByName("GTiff").Create(str(tmp_path / name), side, side, 1, gdal.GDT_Byte)
        images.append(Image(name, sample_rpc(), (side, side), raster=GdalRaster(str(tmp_path / name))))
    assert list(_read_pictures(images, ["crop", "scene"])) == ["crop"]


@pytest.mark.parametrize(
    ("residual_px", "is_inside"),
    [(0.3, True), (15.0, True), (5000.0, False)],  # noise, another object nearby, a number mistyped
)
def test_a_chip_shows_what_is_around_a_point_and_stays_small(residual_px: float, is_inside: bool) -> None:
    """A target of some pixels and its surroundings, and the computed position unless it is far away."""
    grey = np.random.default_rng(5).integers(0, 256, (600, 600)).astype(np.uint8)
    image = Image("image", sample_rpc(), (600, 600), raster=ArrayRaster(grey))
    one, gcps = np.zeros(1, dtype=np.int64), GroundPoints(["A"], [[7.0, 45.0, 300.0]], Role.GCP)
    block = mock.Mock(images=(image,), points=gcps, measurements=mock.Mock(point=one, image=one))
    visible = _PointSelection(np.array([[residual_px, 0.0]]), np.array([1.0]), one, one)
    (chip,) = _make_chips(mock.Mock(block=block, measured_xy=np.array([[300.0, 310.0]])), visible, None)
    assert chip.chip.grey is not None
    rows, columns = chip.chip.grey.shape
    assert 16 <= rows == columns <= 100
    assert (abs(chip.chip.origin[0] + columns / 2.0 - (300.0 - residual_px)) < columns / 2.0) == is_inside
