"""A survey that is turned or scaled is told from images that drift by themselves."""

from dataclasses import replace

import numpy as np
import pytest

from hrsi.benchmarks.true_errors import run_for_harm
from hrsi.benchmarks.wrong_inputs import Inputs, clean
from hrsi.benchmarks.wrong_kinds import mapped
from hrsi.hrsi_engine.results.verdict.ground_truth import fit_deformation

RNG = np.random.default_rng(5)


def turned(mm_per_km: float) -> Inputs:
    angle, right = 1e-6 * mm_per_km, clean("worldview-2", 12, 3, 8)
    turn = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return mapped(lambda away: away @ turn.T)(right, RNG)


def test_a_turned_survey_is_told():
    harm = run_for_harm(turned(1000.0))
    assert "survey-deformed" in harm.codes
    assert harm.is_harmful  # or there would be nothing to tell


def test_images_that_drift_by_themselves_are_no_deformed_survey():
    right = clean("worldview-2", 12, 3, 8)
    xy = right.measured.xy.copy()
    for number, image in enumerate(right.images):  # each turned by another angle about its own middle
        rows = right.measured.image_ids == image.id
        away = xy[rows] - image.centre_px
        xy[rows] += (1e-3, -1.4e-3, 0.3e-3)[number] * away[:, ::-1] * [-1.0, 1.0]
    assert "survey-deformed" not in run_for_harm(right.with_xy(xy)).codes


def test_a_deformation_is_found_from_the_drifts_that_it_makes():
    """Positions displaced by a known gradient; the drifts are a straight line fitted to the pixels' displacements."""
    images = clean("ikonos", 12).images
    gradient = np.array([[2e-4, -5e-4], [4e-4, 1e-4], [0.0, 3e-3]])
    drifts = []
    for image in images:
        xy = image.centre_px + np.array([[x, y] for x in (-500.0, 0.0, 500.0) for y in (-500.0, 0.0, 500.0)])
        ground = image.rpc.localize(xy, image.rpc.height_off).ground
        metres = np.array([111_320.0 * np.cos(np.radians(image.rpc.lat_off)), 110_990.0, 1.0])  # a sphere's, 0.5 %
        away = (ground - ground[4]) * metres
        moved = ground + (away[:, :2] @ gradient.T) / metres
        displaced = xy - image.rpc.project(moved)
        plane, *_ = np.linalg.lstsq(np.column_stack([np.ones(9), xy - xy[4]]), displaced, rcond=None)
        drifts.append(plane[1:].T.ravel())
    found, excess, likeness = fit_deformation(images, np.array(drifts), np.full((3, 4), 1e-4))
    np.testing.assert_allclose(found, gradient, atol=2e-5)
    assert max(excess, likeness) < 1e-6
    assert fit_deformation(images, np.array(drifts), np.full((3, 4), 1e-3))[1] > 1e-3  # such drifts are usual


@pytest.mark.parametrize("seed", range(20))
def test_drifts_of_their_own_have_no_common_cause(seed: int):
    drifts = np.random.default_rng(seed).normal(0.0, 1e-4, (3, 4))
    assert max(fit_deformation(clean("ikonos", 12).images, drifts, np.full((3, 4), 1e-4))[1:]) > 1e-3


@pytest.mark.thorough
def test_scale_of_a_map():
    """0.9996, the scale factor of UTM in the middle of a zone: 0.4 m/km."""
    right = clean("worldview-2", 13, 3, 10)
    scaled = mapped(lambda away: away * [1.0004, 1.0004, 1.0])(right, RNG)
    spoilt = replace(scaled, truth=right.truth)
    assert "survey-deformed" in run_for_harm(spoilt).codes
