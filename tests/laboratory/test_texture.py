"""Blurred shapes and textures against numerical convolution."""

import numpy as np
import pytest
from long_tests import mark_beyond
from scipy import ndimage, signal

from hrsi.hrsi_engine.laboratory.simulation.landscape import COVERS, Landscape
from hrsi.hrsi_engine.laboratory.simulation.texture import (
    PeriodicField,
    Texture,
    compute_disc_cover,
    compute_rectangle_cover,
    sample_periodic,
)

SIGMA = 0.4
SPACING = 0.02


def grid(half: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    axis = np.arange(-half, half + SPACING / 2, SPACING)
    return tuple(np.meshgrid(axis, axis))  # type: ignore[return-value]


def test_disc_cover_is_a_blurred_disc():
    right, ahead = grid()
    sharp = (np.hypot(right, ahead) < 4.5).astype(float)
    oracle = ndimage.gaussian_filter(sharp, SIGMA / SPACING)
    cover = compute_disc_cover(right, ahead, np.array([9.0, 9.0]), SIGMA)
    print(f"disc: largest difference {np.abs(cover - oracle).max():.4f}")
    assert np.abs(cover - oracle).max() < 0.025  # the edge is taken as straight: 0.4 sigma / (2 r), the same all round


def test_rectangle_cover_is_a_blurred_rectangle():
    right, ahead = grid()
    sharp = ((np.abs(right) < 2.0) & (np.abs(ahead) < 5.0)).astype(float)
    oracle = ndimage.gaussian_filter(sharp, SIGMA / SPACING)
    cover = compute_rectangle_cover(right, ahead, np.array([10.0, 4.0]), SIGMA)
    assert np.abs(cover - oracle).max() < 0.02  # half a grid cell of the oracle's edge


@pytest.mark.parametrize("sigma", mark_beyond(1, "thorough", [0.3, 2.0]))
def test_periodic_field_is_blurred_exactly(sigma: float):
    field = PeriodicField.power_law(256, 0.5, 0.9, np.random.default_rng(0))
    fine = signal.resample(signal.resample(np.fft.irfft2(field.spectrum, s=(256, 256)), 2048), 2048, axis=1)
    oracle = ndimage.gaussian_filter(fine, sigma / 0.0625, mode="wrap", truncate=8.0)[::8, ::8]
    raster, cell = field.blur(sigma)
    step = round(0.5 / cell)
    np.testing.assert_allclose(raster[::step, ::step], oracle, atol=1e-4)  # of a standard deviation of 1


def test_periodic_sampling_is_bilinear_and_wraps():
    field = np.random.default_rng(1).random((64, 64)).astype(np.float32)
    east, north = np.random.default_rng(2).uniform(-200.0, 200.0, (2, 1000)).astype(np.float32)
    oracle = ndimage.map_coordinates(field, [north / 1.5, east / 1.5], order=1, mode="grid-wrap")
    np.testing.assert_allclose(sample_periodic(field, 1.5, east, north), oracle, atol=2e-4)


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


def test_lattice_is_undone():
    landscape = Landscape(seed=3)
    lattice = np.random.default_rng(3).uniform(-8000.0, 8000.0, (1000, 2))
    back = np.column_stack(landscape.to_lattice(*landscape.from_lattice(lattice).T))
    assert np.abs(back - lattice).max() < 1e-8


def test_objects_do_not_depend_on_the_extent():
    landscape = Landscape(seed=4)
    small, large = landscape.objects(800.0), landscape.objects(1600.0)
    inside = np.abs(large.position_m).max(axis=1) < 800.0
    assert len(small) > 50
    np.testing.assert_array_equal(small.position_m, large.select(inside).position_m)
    assert set(small.kind) == {"roof", "tank", "roundabout", "island"}


@pytest.mark.rendered
def test_grey_values_stay_in_eleven_bits_and_have_contrast():
    texture = Texture(Landscape(seed=5)).blur(0.35, 0)
    east, north = np.meshgrid(np.arange(0.0, 1000.0, 0.7), np.arange(0.0, 1000.0, 0.7))
    grey = texture.grey(east, north)
    assert 100.0 < grey.mean() < 900.0
    assert grey.std() > 80.0
    assert np.mean((grey < 0.0) | (grey > 2047.0)) < 0.01
    assert sum(cover.share for cover in COVERS) == pytest.approx(1.0)
