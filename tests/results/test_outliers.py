"""What stands out in a block is one thing: dividing a residual by the sigma beside it gives what the flag says."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.results.drawings import report_figures
from hrsi.hrsi_engine.results.figures import block_report
from hrsi.hrsi_engine.results.layers import block_layers
from hrsi.hrsi_engine.results.residuals import compute_residuals

SEEDS = range(4)
#: Nothing is left out: what stands out is to be seen in the residuals.
AFFINE = AdjustOptions(model="affine", reject_sigma=0.0)
DRIFT = AdjustOptions(model="shift", sigma_drift=1e-4, reject_sigma=0.0)


def adjusted(options=AFFINE, single=False, **scene):
    """Return an adjusted block, its residuals and its layers' columns; ``single`` check points are on one image."""
    block, _, _ = blocks.block(**scene)
    if single:
        check = (block.points.role == Role.CHECK)[block.measurements.point]
        keep = ~check | (block.measurements.image == block.measurements.point % len(block.images))
        block = replace(block, measurements=block.measurements.select(np.flatnonzero(keep)))
    result = adjust(block, options)
    left = compute_residuals(result)
    return result, left, {layer.name: layer.fields for layer in block_layers(result, left)}


def lengths(columns, level):
    """Return the length of each row's residual in the sigmas beside it."""
    names = ("sample_px", "line_px") if level == "image" else ("east_m", "north_m", "height_m")
    ratios = np.array([columns[f"residual_{name}"] / columns[f"sigma_{name}"] for name in names])
    return np.sqrt(np.nansum(ratios**2, axis=0))


def shifted(block, point, image, px):
    """Return a block one of whose measurements is wrong by ``px``."""
    rows = block.measurements
    return blocks.move_measurements(block, (rows.point == point) & (rows.image == image), px)


@pytest.mark.parametrize("options", [AFFINE, DRIFT], ids=["affine", "drift"])
def test_dividing_gives_the_flag(options):
    block, _, _ = blocks.block(gcps=6, checks=20, ties=400, drift=1e-4, noise_px=0.05)
    # a tie point and a GCP wrong by 1 px, and a check point by 10 px: robust weights would hide nothing of it
    wrong = shifted(shifted(shifted(block, 100, 1, 1.0), 2, 0, 3.0), 10, 2, 10.0)
    result = adjust(wrong, options)
    left = compute_residuals(result)
    layers = {layer.name: layer.fields for layer in block_layers(result, left)}
    rows = layers["residuals_utm"]
    for level in ("image", "ground"):
        here = rows["level"] == level
        outlier = lengths(rows, level)[here] > 4.0
        np.testing.assert_array_equal(rows["flag"][here] == "outlier", outlier)
        assert 0 < outlier.sum() < 20
    np.testing.assert_array_equal(
        layers["image_points"]["flag"] == "outlier", lengths(layers["image_points"], "image") > 4.0
    )
    # the report's list and the drawings name the same
    refined = [result.model.compute_refined_rpc(image, v) for image, v in zip(wrong.images, result.values, strict=True)]
    report = block_report(result, left, refined)
    here = (rows["level"] == "image") & (rows["flag"] == "outlier")
    named = {(row["id"], row["image"]): row["statistic"] for row in report["outliers"]}
    assert named == pytest.approx(
        dict(zip(zip(rows["id"][here].tolist(), rows["image"][here].tolist(), strict=True),
                 lengths(rows, "image")[here], strict=True))
    )  # fmt: skip
    assert report["outlier_count"] == here.sum()
    drawn = sum(int((vectors.groups == "outlier").sum()) for vectors in report_figures(result, left).cards)
    assert drawn == here.sum()


@pytest.mark.parametrize("single", mark_beyond(1, "thorough", [False, True]), ids=["stereo", "one image"])
@pytest.mark.parametrize(
    ("options", "scene"),
    mark_beyond(
        1,
        "thorough",
        [
            (AFFINE, {"noise_px": 0.05}),
            (AFFINE, {"noise_px": 0.3, "noise_m": 0.01}),
            (DRIFT, {"noise_px": 0.05, "noise_m": 0.1, "drift": 1e-4}),
        ],
    ),
    ids=["surveys decide", "images decide", "drift"],
)
def test_check_points_are_judged_with_what_was_predicted(options, scene, single):
    """Their residuals over their sigmas have the standard deviation 1, in the image and on the ground."""
    squares = {"image": [], "ground": []}
    outliers = 0
    for seed in SEEDS:
        _, _, layers = adjusted(options, single, gcps=10, checks=60, ties=200, seed=seed, **scene)
        rows = layers["residuals_utm"]
        for level, names in (("image", ("sample_px", "line_px")), ("ground", ("east_m", "north_m", "height_m"))):
            here = (rows["level"] == level) & (rows["role"] == "check")
            ratios = np.array([rows[f"residual_{name}"][here] / rows[f"sigma_{name}"][here] for name in names])
            there = np.isfinite(ratios).all(axis=1)  # of points on one image there is no height
            squares[level].append(np.mean(ratios[there] ** 2, axis=1))
        outliers += int((rows["flag"][rows["role"] == "check"] == "outlier").sum())
    # 240 points, whose common part is that of four blocks: known to about 10 %
    for level, found in squares.items():
        ratio = np.sqrt(np.mean(found, axis=0))
        assert len(ratio) == 3 - (single or level == "image")
        np.testing.assert_allclose(ratio, 1.0, atol=0.2)
    assert outliers <= 4  # one in 1000 to 3000 of 960 rows, three of one point together


def test_counts_are_counts():
    """More outliers than the report lists: the count is of all."""
    block, _, _ = blocks.block(gcps=10, checks=100, ties=50)
    rng = np.random.default_rng(1)
    rows = block.measurements
    check = (block.points.role == Role.CHECK)[rows.point]
    xy = rows.xy + np.where(check[:, None], rng.choice([-20.0, 20.0], rows.xy.shape), 0.0)
    result = adjust(replace(block, measurements=replace(rows, xy=xy)), AFFINE)
    left = compute_residuals(result)
    refined = [result.model.compute_refined_rpc(image, v) for image, v in zip(block.images, result.values, strict=True)]
    report = block_report(result, left, refined)
    assert report["outlier_count"] == check.sum() == 300
    assert len(report["outliers"]) == 200


def test_a_point_without_surveyed_height_is_judged_where_it_came_out():
    block, _, _ = blocks.block(gcps=6, checks=10, ties=100)
    sigma = block.points.sigma_m.copy()
    sigma[7, 1] = np.inf
    ground = block.points.ground.copy()
    ground[7, 2] += 100.0  # whatever the file says there
    points = replace(block.points, sigma_m=sigma, ground=ground)
    result = adjust(replace(block, points=points), AFFINE)
    left = compute_residuals(result)
    rows = block.measurements.point == 7
    assert np.abs(left.measured_px[rows]).max() < 2.0
    assert np.abs(left.at_known_px[rows]).max() > 10.0
    assert np.isfinite(left.ground_sigma_m[7]).tolist() == [True, True, False]
