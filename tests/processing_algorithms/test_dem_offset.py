"""The warning about a block that lies off the DEM it was given."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from gdal_files import write_raster

from hrsi.hrsi_engine.block.block import Role
from hrsi.processing_algorithms.block_steps.plausibility import offset_warning
from hrsi.processing_algorithms.files.opening import dem_surface
from hrsi.processing_algorithms.interface.option_groups import DemOptions


@pytest.fixture
def dem(tmp_path: Path) -> str:
    """100 m everywhere."""
    corner = (147.0, 0.001, 0.0, -42.0, 0.0, -0.001)
    return write_raster(tmp_path / "dem.tif", np.full((100, 100), 100.0), corner, "EPSG:4326")


def warned(
    dem: str | None, above_m: float, noise_m: float = 1.5, role: Role = Role.TIE, sigma_dem_m: float | None = None
) -> list[str]:
    rng = np.random.default_rng(1)
    heights = 100.0 + above_m + rng.normal(0.0, noise_m, 200)
    ground = np.column_stack([rng.uniform(147.01, 147.08, 200), rng.uniform(-42.08, -42.01, 200), heights])
    ground[:5] = np.nan
    ground[5:15, 2] += 500.0  # blunders do not count
    roles = np.r_[np.full(199, Role.TIE), role]
    result = SimpleNamespace(ground=ground, block=SimpleNamespace(points=SimpleNamespace(role=roles)))
    return offset_warning(result, dem_surface(DemOptions(dem), "ellipsoidal"), sigma_dem_m)


def test_an_offset_is_told_with_its_sign(dem: str) -> None:
    (text,) = warned(dem, 2.1)
    assert "2." in text and " m above the DEM" in text and "`sigma_dem_m`" in text
    assert "below" in warned(dem, -2.1)[0]


def test_nothing_is_said_without_reason(dem: str) -> None:
    assert not warned(dem, 0.3)  # grass
    assert not warned(dem, 1.5, noise_m=30.0)  # not clear: sigma of the median is 2.7 m
    assert not warned(dem, 2.1, role=Role.GCP)
    assert not warned(dem, 2.1, sigma_dem_m=5.0)
    assert not warned(None, 2.1)
