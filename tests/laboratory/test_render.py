"""Pixels: they do not depend on blocks, lie where the cameras say, and have the noise asked for."""

from dataclasses import replace

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.laboratory.simulation.surface import compute_ray_paths, locate_on_surface
from hrsi.hrsi_engine.laboratory.simulation.tiles import TILES

CLEAN = lab.Radiometry(noise_dn=0.0, shot_dn=0.0)
JITTER = lab.OrientationError(vibration=lab.Vibration(((500.0, 1e-6, 0.0),)))


def simulated(
    spec: lab.SceneSpec, size: int = 800, radiometry: lab.Radiometry = CLEAN, **view: object
) -> lab.BlockSimulation:
    views = lab.make_along_track_views(lab.SENSORS["pleiades"], 2, (size, size))
    views = tuple(replace(v, radiometry=radiometry, **view) for v in views)  # type: ignore[arg-type]
    return lab.simulate_block(spec, views, lab.PointCounts(4, 16, 0), lab.Noise(vendor=0.0))


@pytest.fixture(scope="module")
def hilly() -> lab.BlockSimulation:
    return simulated(lab.SceneSpec(relief_m=80.0))


@pytest.mark.rendered
def test_pixels_do_not_depend_on_the_window():
    block = simulated(lab.SceneSpec(relief_m=80.0, cliff_m=30.0), size=400, radiometry=lab.Radiometry())
    image = lab.make_renderer(block, "image_1")
    whole = image.window(0, 0, 400, 400)
    pieces = np.empty_like(whole)
    for line in range(0, 400, 170):
        for sample in range(0, 400, 230):
            samples, lines = min(230, 400 - sample), min(170, 400 - line)
            pieces[line : line + lines, sample : sample + samples] = image.window(sample, line, samples, lines)
    np.testing.assert_array_equal(whole, pieces)
    again = simulated(lab.SceneSpec(relief_m=80.0, cliff_m=30.0), size=400, radiometry=lab.Radiometry())
    np.testing.assert_array_equal(lab.render_window(again, "image_1", 100, 300, 200, 40), whole[300:340, 100:300])


def test_window_outside_is_refused(hilly: lab.BlockSimulation):
    with pytest.raises(ValueError, match="is not inside 800 x 800"):
        lab.make_renderer(hilly, "image_1").window(700, 0, 200, 10)


@pytest.mark.parametrize(
    "jitter", mark_beyond(1, "thorough", [JITTER, lab.OrientationError()]), ids=["jitter", "steady"]
)
def test_interpolated_rays_are_true_ones(jitter: lab.OrientationError):
    block = simulated(lab.SceneSpec(relief_m=80.0), jitter=jitter)
    image = lab.make_renderer(block, "image_2")
    column, row = np.meshgrid(
        np.arange(TILES.tile_px, 2 * TILES.tile_px, 5), np.arange(2 * TILES.tile_px, 3 * TILES.tile_px, 5)
    )
    points = np.column_stack([column.ravel(), row.ravel()]).astype(float)
    exact = compute_ray_paths(image.camera, block.scene.terrain, points).coefficients.reshape(3, 2, *column.shape)
    found = image.tile_paths(2, 1).coefficients[:, :, ::5, ::5]
    off = np.abs(found - exact[:, :, : found.shape[2], : found.shape[3]])[0].max() / image.camera.gsd_m()[0]
    assert off < 2e-3


def rms(values: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def centroid(window: np.ndarray, background: float) -> np.ndarray:
    """Return the gravity centre (sample, line) of what is brighter than the background, 8 px around the middle."""
    line, sample = np.indices(window.shape)
    weight = (window - background) * (np.hypot(line - len(window) // 2, sample - len(window) // 2) < 8.0)
    return np.array([(weight * sample).sum(), (weight * line).sum()]) / weight.sum()


@pytest.mark.parametrize("relief_m", mark_beyond(1, "rendered", [0.0, 80.0]))
def test_targets_are_where_the_truth_says(relief_m: float):
    """Gravity centre of the bright disc (radius 4.5 px) on its dark apron (10 px), without noise."""
    block = simulated(lab.SceneSpec(relief_m=relief_m))
    points, offsets = block.truth.image_points, []
    for image_id in ("image_1", "image_2"):
        image = lab.make_renderer(block, image_id)
        seen = points.image == block.index(image_id)
        for xy in points.xy[seen]:
            first = np.rint(xy).astype(int) - 8
            offsets.append(centroid(image.window(*first, 17, 17), 330.0) - (xy - first))
    worst = np.abs(offsets).max()
    assert len(offsets) >= 30
    assert worst < 0.05


def phase_shift(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the shift (sample, line) of ``second`` against ``first`` from the slope of the cross-spectrum's phase."""
    window = np.hanning(len(first))[:, None] * np.hanning(len(first))
    spectra = [np.fft.fft2((w - w.mean()) * window) for w in (first.astype(float), second.astype(float))]
    cross = spectra[1] * np.conj(spectra[0])
    line, sample = np.meshgrid(np.fft.fftfreq(len(first)), np.fft.fftfreq(len(first)), indexing="ij")
    low = (np.hypot(line, sample) < 0.15) & (np.hypot(line, sample) > 0)
    weight = np.abs(cross[low])
    A = -2.0 * np.pi * np.column_stack([sample[low], line[low]])
    normal = A.T @ (weight[:, None] * A)
    return np.linalg.solve(normal, A.T @ (weight * np.angle(cross[low])))


@pytest.mark.rendered
def test_two_views_of_flat_ground_register_as_the_truth_says():
    block = simulated(lab.SceneSpec(relief_m=0.0))
    one, two = (lab.make_renderer(block, image_id) for image_id in ("image_1", "image_2"))
    offsets = []
    for sample in (100, 350, 600):
        for line in (100, 350, 600):
            centre = np.array([[sample + 63.5, line + 63.5]])
            ground = one.camera.image_to_ground(centre, 250.0)
            truth = two.camera.ground_to_image(ground)[0]
            first = np.rint(truth - 63.5).astype(int)
            shift = phase_shift(one.window(sample, line, 128, 128), two.window(*first, 128, 128))
            offsets.append(shift - (truth - 63.5 - first))
    assert np.abs(offsets).max() < 0.05


@pytest.mark.rendered
def test_noise_and_radiometry():
    radiometry = lab.Radiometry(gain=0.8, offset=50.0, noise_dn=3.0, shot_dn=0.05)
    noisy, clean = (lab.make_renderer(simulated(lab.SceneSpec(), radiometry=r), "image_1") for r in (radiometry, CLEAN))
    expected = 0.8 * clean.noise_free_tile(0, 0) + 50.0
    normalised = (noisy.tile(0, 0) - expected) / np.sqrt(9.0 + 0.05 * expected + 1.0 / 12.0)
    inside = (expected > 100.0) & (expected < 1900.0)
    assert normalised[inside].mean() == pytest.approx(0.0, abs=0.02)
    assert normalised[inside].std() == pytest.approx(1.0, abs=0.01)
    assert noisy.tile(0, 0).dtype == np.uint16
    neighbours = np.corrcoef(normalised[:, :-1].ravel(), normalised[:, 1:].ravel())[0, 1]
    assert abs(neighbours) < 0.02  # white: 1 / sqrt(65 000) is 0.004


@pytest.mark.rendered
def test_multispectral_bands_are_the_same_ground(hilly: lab.BlockSimulation):
    pan = lab.make_renderer(hilly, "image_1").window(0, 0, 800, 800).astype(float)
    bands = lab.make_multispectral_renderers(hilly, "image_1")
    assert [band.size for band in bands] == [(200, 200)] * 4
    mean = pan.reshape(200, 4, 200, 4).mean(axis=(1, 3))
    red = bands[2].window(0, 0, 200, 200).astype(float)
    assert np.corrcoef(mean.ravel(), red.ravel())[0, 1] > 0.8
    texture = replace(bands[2].painter.texture, band=0)  # panchromatic, to tell position from colour
    coarse = replace(bands[2], painter=replace(bands[2].painter, texture=texture)).window(0, 0, 200, 200)
    assert np.abs(phase_shift(mean[36:164, 36:164], coarse[36:164, 36:164])).max() < 0.02


def test_orthophoto_shows_what_the_image_shows(hilly: lab.BlockSimulation):
    image, ortho = lab.make_renderer(hilly, "image_1"), lab.make_orthophoto(hilly.scene, 0.7)
    pixels = image.window(300, 300, 128, 128).astype(float)
    sample, line = np.meshgrid(np.arange(300.0, 428.0), np.arange(300.0, 428.0))
    ground = locate_on_surface(image.camera, hilly.scene.terrain, np.column_stack([sample.ravel(), line.ravel()]))
    west, lon_step, _, north, _, lat_step = ortho.geotransform
    column, row = (ground[:, 0] - west) / lon_step - 0.5, (ground[:, 1] - north) / lat_step - 0.5
    first = np.floor([column.min(), row.min()]).astype(int) - 2
    reach = np.ceil([column.max(), row.max()]).astype(int) + 3 - first
    window, valid = ortho.read(*first, *reach)
    nearest = window[np.rint(row - first[1]).astype(int), np.rint(column - first[0]).astype(int)].reshape(128, 128)
    assert valid.all()
    assert np.corrcoef(nearest.ravel(), pixels.ravel())[0, 1] > 0.95
    assert np.abs(phase_shift(pixels, nearest)).max() < 0.1


def test_block_with_pixels_keeps_the_raster_contract(hilly: lab.BlockSimulation):
    image = lab.add_pixels(hilly).images[1]
    grey, valid = image.raster.read(10, 20, 30, 40)
    assert grey.shape == valid.shape == (40, 30)
    assert image.raster.size == image.size == (800, 800)
    assert valid.all()
