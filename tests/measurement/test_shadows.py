"""Dark centres on the shadow side: crowns lit from one side, seen with the sun where it is and where it is not."""

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.ground.geodesy import move_ground
from hrsi.hrsi_engine.laboratory.interest_points import DetectionOptions, detect_interest_points
from hrsi.hrsi_engine.laboratory.interest_points.shadows import compute_image_direction, find_shadows
from hrsi.hrsi_engine.measurement.interest_points import CentreOptions

SIDE, STEP, RADIUS_PX = 480, 48, 7.0
GROUND, CROWN, DARK = 800.0, 550.0, 250.0


def picture(towards_sun: np.ndarray, with_crowns: bool) -> ArrayRaster:
    """Return open ground with dark spots: shadows with their crowns on the sun's side, or pits with nothing beside."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(np.float64)
    grey = np.full((SIDE, SIDE), GROUND)
    for cx in range(STEP // 2, SIDE, STEP):
        for cy in range(STEP // 2, SIDE, STEP):
            if with_crowns:
                crown = np.array([cx, cy]) + 1.1 * RADIUS_PX * towards_sun
                grey[np.hypot(x - crown[0], y - crown[1]) < RADIUS_PX] = CROWN
            along = (x - cx) * towards_sun[0] + (y - cy) * towards_sun[1]
            spot = np.hypot(x - cx, y - cy) < RADIUS_PX
            lit = 12.0 * along if with_crowns else 0.0 * along  # the half towards the sun gets some of its light
            grey[spot] = (DARK + lit)[spot]
    grey += np.random.default_rng(1).normal(0.0, 8.0, grey.shape)
    return ArrayRaster(grey.astype(np.uint16), np.ones(grey.shape, dtype=bool))


@pytest.mark.parametrize("azimuth_deg", mark_beyond(1, "rendered", [20.0, 150.0, 260.0]))
def test_shadows_are_where_the_sun_says(azimuth_deg: float):
    towards = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))])
    options = DetectionOptions(centres=CentreOptions(quality=0.2), threads=1)
    share = {}
    for crowns in (True, False):
        raster = picture(towards, crowns)
        points = detect_interest_points(raster, "centres", options)
        middles = np.arange(STEP // 2, SIDE, STEP)
        spots = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
        of_spot = np.hypot(*(points.xy[:, None] - spots).transpose(2, 0, 1)) < 0.3 * RADIUS_PX  # not crown and shadow
        assert (of_spot.any(axis=0)).mean() > 0.9
        share[crowns] = []
        for sign in (1.0, -1.0):
            flagged = find_shadows(raster, points, sign * towards)
            assert not flagged[points.contrast > 0.0].any()
            share[crowns].append(float((flagged[:, None] & of_spot).any(axis=0).mean()))
    assert share[True][0] > 0.7 and share[True][1] == 0.0  # with the sun on the other side none is
    assert share[False][0] < 0.05  # pits


def test_a_direction_on_the_ground_is_carried_into_the_image():
    rpc = blocks.oblique_rpc(0.3, 0.1, heading=0.4)
    direction = compute_image_direction(rpc, (4001, 4001), 37.0)
    ground = np.array([[blocks.LON, blocks.LAT, blocks.HEIGHT]])
    step = np.array([[np.sin(np.radians(37.0)), np.cos(np.radians(37.0)), 0.0]])
    moved = rpc.project(move_ground(ground, 10.0 * step)) - rpc.project(ground)
    assert np.hypot(*direction) == pytest.approx(1.0) and direction @ moved[0] == pytest.approx(np.hypot(*moved[0]))
