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
    found = refine_rpc(
        image,
        control.ground,
        control.xy,
        ids=control.ids,
        sigma_px=control.sigma_px,
        sigma_m=control.sigma_m,
        model=model,
    )
    return " / ".join(found.warnings)


def test_good_control_has_no_warnings(image, control):
    assert warnings(image, control) == ""


def test_no_points(image, control):
    with pytest.raises(InputError, match="image0: no GCP is measured on it"):
        refine_image(image, control.select(np.zeros(8, dtype=bool)))


def test_arrays_of_one_image(image, control):
    found = refine_rpc(image.rpc, control.ground, control.xy, model="shift")
    np.testing.assert_allclose(found.estimate.values, (5.0, -3.0), atol=0.5)
    with pytest.raises(InputError, match="no GCP"):
        refine_rpc(image.rpc, np.empty((0, 3)), np.empty((0, 2)))


@pytest.mark.parametrize("column", ["ground", "xy"])
def test_nan(image, control, column):
    values = getattr(control, column).copy()
    values[2, 0] = np.nan
    with pytest.raises(InputError, match="coordinate of GCP 3 is missing"):
        refine_image(image, replace(control, **{column: values}))


def test_a_sigma_of_zero(image, control):
    sigma = control.sigma_px.copy()
    sigma[4] = 0.0
    with pytest.raises(InputError, match="GCP 5 has a sigma"):
        refine_image(image, replace(control, sigma_px=sigma))


def test_the_same_id_twice(image, control):
    with pytest.raises(InputError, match="GCP 1 is given more than once"):
        refine_image(image, replace(control, ids=np.array(["1", "1", *"345678"])))


def test_two_points_at_one_place(image, control):
    ground, xy = control.ground.copy(), control.xy.copy()
    ground[1], xy[1] = ground[0], xy[0]
    assert "GCPs 1 and 2 are at the same place" in warnings(image, replace(control, ground=ground, xy=xy))


def test_swapped_longitude_and_latitude(image, control):
    with pytest.raises(InputError, match=r"longitude and latitude of GCP 1, 2.* are swapped"):
        refine_image(image, replace(control, ground=control.ground[:, [1, 0, 2]]))
    ground = control.ground.copy()
    ground[5, :2] = ground[5, 1::-1]
    with pytest.raises(InputError, match="GCP 6 are swapped"):
        refine_image(image, replace(control, ground=ground))


def test_another_part_of_the_world(image, control):
    with pytest.raises(InputError, match=r"lies \d+ km from the image"):
        refine_image(image, replace(control, ground=control.ground + [10.0, 0.0, 0.0]))


def test_projected_coordinates(image, control):
    with pytest.raises(InputError, match="invalid longitude or latitude"):
        refine_image(image, replace(control, ground=control.ground * [3e3, -1e5, 1.0]))


def test_points_on_a_line(image, control):
    along = np.linspace(-1000.0, 1000.0, 8)
    ground = blocks.move_ground(
        np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (8, 1)), np.column_stack([along, 0.5 * along, 0.0 * along])
    )
    line = replace(control, ground=ground, xy=image.rpc.project(ground) + [5.0, -3.0])
    assert "lie on a line" in warnings(image, line)
    assert refine_image(image, line).model.name == "shift"
    with pytest.raises(SolveError, match="do not determine model quadratic"):
        refine_image(image, line, RefineOptions("quadratic"))


def test_points_at_one_spot(image, control):
    ground = blocks.move_ground(
        np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (8, 1)), np.random.default_rng(2).uniform(-5, 5, (8, 3))
    )
    spot = replace(control, ground=ground, xy=image.rpc.project(ground) + [5.0, -3.0])
    with pytest.raises(SolveError, match="do not determine model quadratic"):
        refine_image(image, spot, RefineOptions("quadratic"))


def test_points_far_outside_the_image(image, control):
    xy = control.xy.copy()
    xy[3] = [9000.0, 100.0]
    assert "1 of 8 points on image image0 lie outside its 4001 x 4001 px" in warnings(image, replace(control, xy=xy))


def test_a_height_outside_the_range(image, control):
    ground = control.ground.copy()
    ground[6, 2] = 3000.0
    said = warnings(image, replace(control, ground=ground))
    assert (
        "the height of ground point 7 (3000 to 3000 m) is outside the height range of the RPCs, -300 to 700 m" in said
    )


@pytest.mark.parametrize(
    ("factor", "said"),
    mark_beyond(1, "wrong_inputs", [(1.0 / FOOT_M, "are in feet"), (FOOT_M, "were converted from feet")]),
)
def test_heights_in_another_unit(image, control, factor, said):
    ground = control.ground * [1.0, 1.0, factor]
    assert said in warnings(image, replace(control, ground=ground))


def test_an_unknown_model(image, control):
    with pytest.raises(InputError, match="unknown model 'afine': choose one of auto, generic"):
        refine_image(image, control, RefineOptions("afine"))


def test_too_few_points_for_a_model(image, control):
    with pytest.raises(InputError, match="model affine needs 3 GCPs, there are 2"):
        refine_image(image, control.select(np.arange(2)), RefineOptions("affine"))
