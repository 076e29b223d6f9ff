"""Control that cannot be right is named, in an error or a warning."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.hrsi_engine.foundation.errors import InputError, SolveError
from hrsi.hrsi_engine.refinement.estimate import Control
from hrsi.hrsi_engine.refinement.model_table import RefineOptions
from hrsi.hrsi_engine.refinement.refine import refine_image, refine_rpc

FOOT_M = 0.3048


@pytest.fixture
def image():
    return blocks.images(1)[0]


@pytest.fixture
def control(image):
    ground = blocks.ground(8, 3)
    noise = np.random.default_rng(1).normal(0.0, 0.3, (8, 2))
    return Control(ground, image.rpc.project(ground) + [5.0, -3.0] + noise)


def warnings(image, control, model="shift"):
    given = {name: getattr(control, name) for name in ("ids", "sigma_px", "sigma_m")}
    return " / ".join(refine_rpc(image, control.ground, control.xy, model=model, **given).warnings)


def with_value(control, name, place, value):
    """Return control with one value of a column changed."""
    column = getattr(control, name).copy()
    column[place] = value
    return replace(control, **{name: column})


def at_places(image, control, east_north_up):
    """Return control at other places around the middle of the image, measured with the same shift."""
    ground = blocks.move_ground(np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (8, 1)), east_north_up)
    return replace(control, ground=ground, xy=image.rpc.project(ground) + [5.0, -3.0])


def test_good_control_has_no_warnings(image, control):
    assert warnings(image, control) == ""


def test_arrays_of_one_image(image, control):
    found = refine_rpc(image.rpc, control.ground, control.xy, model="shift")
    np.testing.assert_allclose(found.estimate.values, (5.0, -3.0), atol=0.5)
    with pytest.raises(InputError, match="no GCP"):
        refine_rpc(image.rpc, np.empty((0, 3)), np.empty((0, 2)))


@pytest.mark.parametrize(
    ("spoil", "model", "message"),
    [
        (lambda c: c.select(np.zeros(8, dtype=bool)), "shift", "image0: no GCP is measured on it"),
        (lambda c: with_value(c, "ground", (2, 0), np.nan), "shift", "coordinate of GCP 3 is missing"),
        (lambda c: with_value(c, "xy", (2, 0), np.nan), "shift", "coordinate of GCP 3 is missing"),
        (lambda c: with_value(c, "sigma_px", 4, 0.0), "shift", "GCP 5 has a sigma"),
        (lambda c: replace(c, ids=np.array(["1", "1", *"345678"])), "shift", "GCP 1 is given more than once"),
        (
            lambda c: replace(c, ground=c.ground[:, [1, 0, 2]]),
            "shift",
            "longitude and latitude of GCP 1, 2.* are swapped",
        ),
        (lambda c: with_value(c, "ground", (5, slice(2)), c.ground[5, 1::-1]), "shift", "GCP 6 are swapped"),
        (lambda c: replace(c, ground=c.ground + [10.0, 0.0, 0.0]), "shift", r"lies \d+ km from the image"),
        (lambda c: replace(c, ground=c.ground * [3e3, -1e5, 1.0]), "shift", "invalid longitude or latitude"),
        (lambda c: c, "afine", "unknown model 'afine': choose one of auto, generic"),
        (lambda c: c.select(np.arange(2)), "affine", "model affine needs 3 GCPs, there are 2"),
    ],
)
def test_what_cannot_be_is_an_error(image, control, spoil, model, message):
    with pytest.raises(InputError, match=message):
        refine_image(image, spoil(control), RefineOptions(model))


@pytest.mark.parametrize(
    ("spoil", "said"),
    mark_beyond(
        4,
        "wrong_inputs",
        [
            (
                lambda c: with_value(with_value(c, "ground", 1, c.ground[0]), "xy", 1, c.xy[0]),
                "GCPs 1 and 2 are at the same",
            ),
            (
                lambda c: with_value(c, "xy", 3, [9000.0, 100.0]),
                "1 of 8 points on image image0 lie outside its 4001 x 4001 px",
            ),
            (
                lambda c: with_value(c, "ground", (6, 2), 3000.0),
                "the height of ground point 7 (3000 to 3000 m) is outside the height range of the RPCs, -300 to 700 m",
            ),
            (lambda c: replace(c, ground=c.ground * [1.0, 1.0, 1.0 / FOOT_M]), "are in feet"),
            (lambda c: replace(c, ground=c.ground * [1.0, 1.0, FOOT_M]), "were converted from feet"),
        ],
    ),
)
def test_what_is_doubtful_is_a_warning(image, control, spoil, said):
    assert said in warnings(image, spoil(control))


def test_points_on_a_line_or_at_one_spot(image, control):
    along = np.linspace(-1000.0, 1000.0, 8)
    line = at_places(image, control, np.column_stack([along, 0.5 * along, 0.0 * along]))
    assert "lie on a line" in warnings(image, line)
    assert refine_image(image, line).model.name == "shift"
    spot = at_places(image, control, np.random.default_rng(2).uniform(-5, 5, (8, 3)))
    for points in (line, spot):
        with pytest.raises(SolveError, match="do not determine model quadratic"):
            refine_image(image, points, RefineOptions("quadratic"))
