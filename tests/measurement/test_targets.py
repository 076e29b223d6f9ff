"""Targets near approximate positions: synthetic images with exact truth, stray edges, refusals."""

import numpy as np
import pytest
from scipy.special import ndtr

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.measurement.targets.measuring import MEASURES, TargetOptions, measure_edges, measure_target

SIZE, BLUR = 400, 0.6
NOISE = 6.0
CENTRE = np.array([180.37, 211.62])


def image(cover: np.ndarray, contrast: float = 300.0, seed: int = 1) -> ArrayRaster:
    """Return an object on ground with broad and fine texture, 11 bit."""
    rng = np.random.default_rng(seed)
    rows, columns = np.indices((SIZE, SIZE))
    ground = 400.0 + 25.0 * np.sin(columns / 23.0) * np.cos(rows / 31.0) + rng.normal(0, NOISE, (SIZE, SIZE))
    return ArrayRaster(np.clip(np.rint(ground + contrast * cover), 0, 2047).astype(np.uint16))


def disc(radius: float) -> np.ndarray:
    rows, columns = np.indices((SIZE, SIZE))
    return ndtr((radius - np.hypot(columns - CENTRE[0], rows - CENTRE[1])) / BLUR)


def quarter_plane(azimuth: float) -> np.ndarray:
    """A corner at `CENTRE` whose edges run along ``azimuth`` and 90 degrees on."""
    rows, columns = np.indices((SIZE, SIZE))
    x, y = columns - CENTRE[0], rows - CENTRE[1]
    along, aside = np.cos(azimuth) * x + np.sin(azimuth) * y, np.cos(azimuth) * y - np.sin(azimuth) * x
    return ndtr(along / BLUR) * ndtr(aside / BLUR)


@pytest.mark.parametrize("contrast", [300.0, -200.0])
@pytest.mark.parametrize("radius", [5.0, 12.0, 25.0])
def test_centre_of_a_disc(radius: float, contrast: float):
    made = measure_target(image(disc(radius), contrast), CENTRE + [6.0, -5.0], "center")
    assert not made.refusal
    assert np.hypot(*(made.xy - CENTRE)) < 0.1  # noise 6 on a contrast of 200: the wanted tenth of a pixel
    assert made.sigma_px < 0.1
    assert made.used.mean() > 0.8


@pytest.mark.parametrize("azimuth", np.radians([3.0, 27.0, 200.0]))
def test_corner_of_two_edges(azimuth: float):
    made = measure_target(image(quarter_plane(azimuth)), CENTRE + [3.0, 4.0], "corner")
    assert not made.refusal
    assert np.hypot(*(made.xy - CENTRE)) < 0.2  # 20 px of edge with 0.1 px each, extrapolated by 2 px
    assert made.sigma_px < 0.2
    assert len(made.curves) == 2


def test_stray_edges_do_not_move_the_centre():
    cover = disc(14.0)
    cover[206:208, 192:215] = 1.0  # a path that leads out of the disc
    made = measure_target(image(cover), CENTRE, "center")
    assert not made.refusal
    assert np.hypot(*(made.xy - CENTRE)) < 0.25


@pytest.mark.parametrize("kind", MEASURES)
def test_nothing_is_measured_where_nothing_is(kind: str):
    empty = measure_target(image(np.zeros((SIZE, SIZE))), CENTRE, kind)
    assert empty.refusal
    assert np.isnan(empty.xy).all()
    assert np.isnan(empty.sigma_px)
    outside = measure_target(image(disc(10.0)), np.array([-20.0, 50.0]), kind)
    assert "outside the image" in outside.refusal
    nodata = image(disc(10.0))
    nodata.valid[:] = False
    assert measure_target(nodata, CENTRE, kind).refusal


def test_a_disc_has_no_corner_and_far_objects_do_not_count():
    assert measure_target(image(disc(12.0)), CENTRE, "corner").refusal
    assert measure_target(image(disc(12.0)), CENTRE + 30.0, "center", TargetOptions(search_px=10.0)).refusal


def test_weak_objects_beside_the_position_are_not_taken_for_the_target():
    faint = image(disc(4.0), 40.0)  # 7 times the noise
    on_it, beside = (measure_target(faint, CENTRE + [shift, 0.0]) for shift in (2.0, 9.0))
    assert np.hypot(*(on_it.xy - CENTRE)) < 0.5
    assert "no clear closed object" in beside.refusal
    assert not measure_target(image(disc(4.0)), CENTRE + [9.0, 0.0]).refusal


def test_hand_measured_edges():
    t = np.radians(np.arange(0, 360, 45))
    ring = CENTRE + 9.0 * np.column_stack([np.cos(t), np.sin(t)])
    np.testing.assert_allclose(measure_edges(ring, "center").xy, CENTRE, atol=1e-6)
    sides = np.array([[0, 3], [0, 6], [0, 9], [2, 0], [5, 0], [8, 0.0]])
    np.testing.assert_allclose(measure_edges(sides + CENTRE, "corner").xy, CENTRE, atol=1e-9)
    assert "needs 6" in measure_edges(ring[:5], "center").refusal
    with pytest.raises(InputError, match="is not one of"):
        measure_edges(ring, "tower")
