"""Variance components by sensor and by image: simulated blocks whose noise is known."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks
from dense_adjustment import dense_solution
from long_tests import mark_beyond

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.statistics.variance_components import GROUPINGS, VARIANCE, group_by_sensor
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints, Role
from hrsi.hrsi_engine.block.default_sigmas import DefaultSigmas
from hrsi.hrsi_engine.block.laser import LASER_KIND
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.thresholds import REDUNDANCY
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.refinement import MODELS

VIEWS = ((0.35, 0.05), (-0.30, 0.10), (0.05, -0.40), (0.02, 0.3))
GSD = (1.0, 2.0, 1.0, 2.0)  # two sensors
NOISE = (0.2, 0.5, 0.2, 0.5)


def two_sensors(seed: int, noise: tuple[float, ...] = NOISE, kinds: bool = False) -> Block:
    """Return a block of two sensors, sigmas of 0.3 px given for all; corners are twice as noisy where there are any."""
    rng = np.random.default_rng(seed)
    cameras = [
        Image(f"I{k}", blocks.oblique_rpc(*view, gsd, 2000.0 / gsd, 0.1 * k), (int(4000 / gsd),) * 2)
        for k, (view, gsd) in enumerate(zip(VIEWS, GSD, strict=True))
    ]
    truth = blocks.ground(160, seed + 7)
    ids = np.array([f"P{k:03d}" for k in range(160)])
    corner = np.arange(160) % 2 == 0
    rows = []
    for image, sigma in zip(cameras, noise, strict=True):
        each = np.where(corner & kinds, 2.0, 1.0)[:, None] * sigma
        xy = image.rpc.project(truth) + rng.normal(0, 5.0, 2) + each * rng.normal(size=(160, 2))
        rows.append(ImagePoints(ids, [image.id] * 160, xy, 0.3, np.where(corner & kinds, "corner", "")))
    known = GroundPoints(ids[:8], truth[:8], Role.GCP, 0.05)
    return assemble(cameras, [known], rows, defaults=DefaultSigmas(0.3))


def sigmas(options: AdjustOptions, seeds: int = 5, **scene) -> dict[str, float]:
    """Return the mean sigma of each estimated group over some blocks."""
    found: dict[str, list[float]] = {}
    for seed in range(seeds):
        result = adjust(two_sensors(seed, **scene), options)
        for part in result.variance_components:
            if part.estimated:
                found.setdefault(part.group, []).append(part.sigma)
    return {name: float(np.mean(values)) for name, values in found.items()}


@pytest.mark.parametrize("stated", mark_beyond(1, "coverage", [0.2, 1.0, 5.0]))
def test_tests_of_measurements_follow_the_sigmas_found(stated: float) -> None:
    """Tests of good measurements on four rays have two conditions each: their squares are chi² of 2, mean 2.

    Power (normal, 4 %, 0.85 to 1.15): 1.00 fails with 0 %, 1.30 with 99.8 %.
    """
    block = two_sensors(1, noise=(0.3,) * 4)
    block = replace(block, measurements=replace(block.measurements, sigma_px=block.measurements.sigma_px * stated))
    for options in (AdjustOptions(), AdjustOptions(variance_components=True), AdjustOptions(test_sigmas=False)):
        squares = adjust(block, options).statistic ** 2
        assert np.nanmean(squares) == pytest.approx(2.0, rel=0.15)  # 640 tests: 4 %, of points that share cameras
        assert np.nanmax(squares) < 25.0


@pytest.mark.coverage
def test_the_sigmas_make_the_cameras_better():
    """With the sigmas that the residuals show, tie points are weighted as they deserve.

    Power (comparison): on the same ten blocks; sigmas that are wrong by a factor of four give more than half of the
    RMSE of equal ones.
    """
    with_, without = [], []
    for seed in range(10):
        block, truth = two_sensors(seed, (0.05, 1.0, 0.05, 1.0)), blocks.ground(160, seed + 7)
        # every point is compared, none may be left out
        for estimated, errors in ((True, with_), (False, without)):
            options = AdjustOptions(test_sigmas=False, variance_components=estimated, reject_sigma=0.0)
            away = (adjust(block, options).ground - truth) * [8e4, 1.1e5, 1.0]
            errors.append(np.mean(away[8:] ** 2))
    assert np.mean(with_) < 0.25 * np.mean(without)


SENSOR_PAIRS = {"variance_groups": "sensor", "sensor_images": (("I0", "I1"), ("I2", "I3"))}
GROUPS = [
    ({}, {}, {"1 m": 0.2, "2 m": 0.5}),
    ({}, {"kinds": True}, {"1 m": 0.2, "2 m": 0.5, "corner, 1 m": 0.4, "corner, 2 m": 1.0}),
    ({"variance_groups": "image"}, {"noise": (0.2, 0.3, 0.4, 0.6)}, {"I0": 0.2, "I1": 0.3, "I2": 0.4, "I3": 0.6}),
    (SENSOR_PAIRS, {"noise": (0.2, 0.2, 0.5, 0.5)}, {"I0+I1": 0.2, "I2+I3": 0.5}),
]


@pytest.mark.parametrize(("options", "scene", "expected"), mark_beyond(1, "thorough", GROUPS))
def test_the_sigma_of_each_group_is_that_of_its_noise(options: dict, scene: dict, expected: dict[str, float]):
    """About 500 residuals of a sensor in each block: its sigma is known to 3 %, the mean of five to 2 %."""
    found = sigmas(AdjustOptions(test_sigmas=False, variance_components=True, **options), **scene)
    rel = 0.06 if len(expected) == 2 else 0.1
    assert {name: found[f"image points: {name}"] for name in expected} == pytest.approx(expected, rel=rel)


def test_like_images_are_one_group_without_a_name():
    block, _, _ = blocks.block(gcps=8, checks=0, ties=60)
    result = adjust(block, AdjustOptions(test_sigmas=False, variance_components=True))
    assert result.variance_components[0].group == "image points"


def test_sensors_of_a_mixed_block():
    cameras = list(two_sensors(0).images)
    number, names = group_by_sensor(cameras)
    assert number.tolist() == [0, 1, 0, 1]
    assert names == ["1 m", "2 m"]
    number, names = group_by_sensor(cameras, [("I3",)])
    assert number.tolist() == [1, 2, 1, 0]
    assert names == ["I3", "1 m", "2 m"]
    assert group_by_sensor(cameras[:1])[1] == [""]


def test_unknown_names_are_refused():
    block = two_sensors(0)
    with pytest.raises(InputError, match="one sensor names image X"):
        adjust(block, AdjustOptions(test_sigmas=False, sensor_images=(("I0", "X"),)))
    with pytest.raises(InputError, match="unknown grouping of image points 'colour'"):
        adjust(block, AdjustOptions(test_sigmas=False, variance_groups="colour"))


@pytest.mark.parametrize("grouping", mark_beyond(2, "thorough", GROUPINGS))
def test_every_grouping_leaves_a_variance_factor_of_one(grouping):
    block = two_sensors(3, kinds=True)
    # every observation is counted, none may be left out
    result = adjust(
        block, AdjustOptions(test_sigmas=False, variance_components=True, variance_groups=grouping, reject_sigma=0.0)
    )
    assert result.sigma0 == pytest.approx(1.0, abs=0.02)
    image = sum(part.observations for part in result.variance_components if part.unit == "px")
    assert image == 2 * len(block.measurements)


def test_many_wrong_sigmas_are_said_briefly():
    block = replace(two_sensors(0), warnings=())
    rows = block.measurements
    result = adjust(
        replace(block, measurements=replace(rows, sigma_px=np.full(len(rows), 0.01))),
        AdjustOptions(test_sigmas=False, variance_components=True, variance_groups="kind-image"),
    )
    said = [text for text in result.warnings if "given sigma" in text]
    assert 4 <= len(said) <= 8


def test_redundancy_is_shared_out_as_a_dense_solution_shares_it():
    """GCPs that the images know better than the survey, and others that they do not: each group has its own share."""
    block, _, _ = blocks.block(gcps=12, checks=0, ties=8, drift=0.0, noise_px=0.4, noise_m=0.3)
    options = AdjustOptions(test_sigmas=False, model="shift", sigma_drift=0.0, variance_components=True)
    result = adjust(block, options)
    found = {part.group: part for part in result.variance_components}
    image, of_gcps, plane, height = (
        found[name] for name in ("image points", "image points of GCPs", "GCP east, north", "GCP height")
    )
    sigma_m = np.tile([plane.sigma, height.sigma], (len(block.points), 1))
    gcp = block.points.role == Role.GCP
    rows = replace(block.measurements, sigma_px=result.sigma_px)
    estimated = replace(block, points=replace(block.points, sigma_m=sigma_m), measurements=rows)
    dense = dense_solution(estimated, MODELS["shift"], drift=0.0)
    share = 1.0 - dense.ground_cofactor[gcp] / np.array([plane.sigma, plane.sigma, height.sigma]) ** 2
    assert plane.redundancy == pytest.approx(share[:, :2].sum(), rel=0.03)
    assert height.redundancy == pytest.approx(share[:, 2].sum(), rel=0.03)
    assert image.redundancy + of_gcps.redundancy == pytest.approx(
        2 * len(rows) - 3 * 20 - 2 * 3 + 3 * 12 - share.sum(), rel=0.03
    )
    assert share.sum() < 0.7 * 36  # far from all of it
    miss = ground_difference_m(block.points.ground[gcp], dense.ground[gcp])
    squares = np.sum((miss / block.points.sigma_m[gcp][:, [0, 0, 1]]) ** 2, axis=0)
    surveyor = squares.sum() / share.sum()  # the factor of all surveys, which counts for some observations of each
    pooled = (REDUNDANCY.stated * surveyor + squares[:2].sum()) / (REDUNDANCY.stated + share[:, :2].sum())
    assert plane.factor**2 == pytest.approx(pooled, rel=0.03)


def test_check_points_of_another_survey_keep_their_sigmas():
    """GCPs' sigmas are stated 5 x too large; check points that are stated alike are of that survey, others are not."""
    right, _, _ = blocks.block(gcps=12, checks=12, ties=60, seed=4)
    points = right.points
    role, sigma = points.role, points.sigma_m.copy()
    gcp, check = np.flatnonzero(role == Role.GCP), np.flatnonzero(role == Role.CHECK)
    sigma[gcp] *= 5.0
    sigma[check[:6]] *= 5.0
    stated = replace(right, points=replace(points, sigma_m=sigma))
    result = adjust(stated, AdjustOptions(variance_components=True))
    factor = (
        np.sqrt(result.survey_covariance_m2(np.arange(len(points))).diagonal(axis1=1, axis2=2)) / sigma[:, [0, 0, 1]]
    )
    assert result.survey_factors[0] < 0.5
    np.testing.assert_allclose(factor[gcp], np.tile(np.array(result.survey_factors)[[0, 0, 1]], (len(gcp), 1)))
    np.testing.assert_allclose(factor[check[:6]], factor[gcp[:6]])
    np.testing.assert_allclose(factor[check[6:]], 1.0)


def test_sigmas_of_surveys_settle_where_their_residuals_are_what_they_let_expect():
    """Stated five and four times too small; adjusted anew with what was found, every ratio is one."""
    block, _, _ = blocks.block(gcps=40, checks=0, ties=100, noise_m=0.6, drift=1e-6, seed=1)
    block = replace(block, points=replace(block.points, sigma_m=block.points.sigma_m * [0.2, 0.25]))
    known_drift = AdjustOptions(sigma_drift=1e-5, reject_sigma=0.0)
    found = {part.group: part.factor for part in adjust(block, known_drift).variance_components}
    assert found["GCP east, north"] == pytest.approx(5.0, rel=0.15)  # 72 observations tell it to 8 %
    rows = block.measurements
    of_gcps = (block.points.role == Role.GCP)[rows.point]
    factor = np.where(of_gcps, found["image points of GCPs"], found["image points"])
    restated = replace(
        block,
        points=replace(block.points, sigma_m=block.points.sigma_m * [found["GCP east, north"], found["GCP height"]]),
        measurements=replace(rows, sigma_px=rows.sigma_px * factor),
    )
    again = adjust(restated, known_drift)
    assert len(again.tests) == 4 and not again.variance_components
    assert [test.ratio for test in again.tests] == pytest.approx([1.0] * 4, abs=0.01)


def test_ties_that_only_the_drift_as_guessed_leaves_out_come_back():
    """Without noise to speak of, by their sigmas some ties hardly fit a drift as tight as it is taken to be at first.

    That most of them have sigmas eight times their errors keeps the drift there until it is estimated.
    """
    views = lab.make_along_track_views(lab.SENSORS["worldview-2"], 3, (4000, 4000))
    simulated = lab.simulate_block(
        lab.SceneSpec(seed=2, post_m=8.0), views, lab.PointCounts(0, 0, 800), lab.Noise(image_px=0.006)
    )
    rows = simulated.block.measurements
    precise = rows.point % 5 < 2
    sigma, kind = np.where(precise, 0.015, 0.05), np.where(precise, "corner", LASER_KIND)
    block = replace(simulated.block, measurements=replace(rows, sigma_px=sigma, kind=kind))
    result = adjust(block, AdjustOptions())
    assert (result.weight > 0.0).mean() > 0.99
    found = {part.group: part.sigma for part in result.variance_components}
    # matching is not believed to be better than a fiftieth of a pixel, nor is it news that laser ties' sigmas are large
    assert found["image points: laser"] == pytest.approx(VARIANCE.least_matched_px)
    assert not [text for text in result.warnings if "given sigma" in text]
