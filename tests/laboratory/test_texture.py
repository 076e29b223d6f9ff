"""Blurred shapes and textures against numerical convolution."""

import numpy as np
import pytest
from long_tests import mark_beyond
from scipy import ndimage, signal

from hrsi.hrsi_engine.laboratory.simulation.landscape import Landscape
from hrsi.hrsi_engine.laboratory.simulation.texture import PeriodicField, Texture, sample_periodic


@pytest.mark.parametrize("sigma", mark_beyond(1, "thorough", [0.3, 2.0]))
def test_periodic_field_is_blurred_exactly(sigma: float):
    field = PeriodicField.power_law(256, 0.5, 0.9, np.random.default_rng(0))
    fine = signal.resample(signal.resample(np.fft.irfft2(field.spectrum, s=(256, 256)), 2048), 2048, axis=1)
    oracle = ndimage.gaussian_filter(fine, sigma / 0.0625, mode="wrap", truncate=8.0)[::8, ::8]
    raster, cell = field.blur(sigma)
    step = round(0.5 / cell)
    np.testing.assert_allclose(raster[::step, ::step], oracle, atol=1e-4)  # of a standard deviation of 1


@pytest.mark.rendered
def test_another_date_looks_different_by_the_share_asked_for():
    """Correlation of the fine textures sqrt(1 - change²); the first date and a change of 0 stay as they are."""
    texture = Texture(Landscape(seed=5))
    rng = np.random.default_rng(4)
    east, north = rng.uniform(-900.0, 900.0, (2, 20000)).astype(np.float32)
    first = texture.blur(0.3, 0)
    for unchanged in (texture.blur(0.3, 0, date=0, change=0.6), texture.blur(0.3, 0, date=1, change=0.0)):
        np.testing.assert_array_equal(first.grey(east, north), unchanged.grey(east, north))
    second = texture.blur(0.3, 0, date=1, change=0.6)
    fields = [sample_periodic(*view.fields[0], east, north) for view in (first, second)]
    assert np.corrcoef(fields)[0, 1] == pytest.approx(0.8, abs=0.05)
    assert fields[1].std() == pytest.approx(fields[0].std(), rel=0.1)


def test_objects_do_not_depend_on_the_extent():
    landscape = Landscape(seed=4)
    small, large = landscape.objects(800.0), landscape.objects(1600.0)
    inside = np.abs(large.position_m).max(axis=1) < 800.0
    assert len(small) > 50
    np.testing.assert_array_equal(small.position_m, large.select(inside).position_m)
    assert set(small.kind) == {"roof", "tank", "roundabout", "island"}
