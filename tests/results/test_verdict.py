"""Every reason after the adjustment, from blocks whose truth is known: what is wrong is named, and nothing else is."""

import re
from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks
from hypothesis import given
from hypothesis import strategies as st
from long_tests import mark_beyond
from scipy import stats

from hrsi.hrsi_engine import judge
from hrsi.hrsi_engine.adjustment.options import AdjustOptions
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.adjustment.solver import adjust
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.foundation.reasons import Level, Reason
from hrsi.hrsi_engine.foundation.thresholds import SIGNIFICANCE
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.plausibility import check_block
from hrsi.hrsi_engine.refinement.model import RefitRPC
from hrsi.hrsi_engine.results.residuals import compute_residuals
from hrsi.hrsi_engine.results.verdict import (
    Evidence,
    Verdict,
    describe_residual_fields,
    find_reasons,
    summarise_accuracy,
)
from hrsi.hrsi_engine.results.verdict.evidence import _find_field
from hrsi.hrsi_engine.results.verdict.verdict import format_figure

SNOOPING = AdjustOptions(model="shift", reject_sigma=4.0)


def sound(seed: int = 1, **changes) -> Block:
    """Return a block whose errors are those that its sigmas say: shifts of images, noise of points."""
    return simulated_blocks.block(seed=seed, **{"drift": 0.0, "ties": 60} | changes)[0]


def evidence_of(block: Block, options: AdjustOptions = SNOOPING, fit_px: float = 0.0) -> Evidence:
    result = adjust(block, options)
    return Evidence(result, compute_residuals(result), [RefitRPC(image.rpc, fit_px) for image in block.images])


def reasons_of(block: Block, options: AdjustOptions = SNOOPING) -> dict[str, Reason]:
    return {reason.code: reason for reason in find_reasons(evidence_of(block, options))}


def rows_of(block: Block, role: Role) -> np.ndarray:
    return np.flatnonzero(block.points.role == role)


def mismatched(block: Block, share: float, seed: int = 5) -> Block:
    """Return the block with a share of its tie points measured at wrong places of their first image."""
    rng = np.random.default_rng(seed)
    ties = rng.permutation(rows_of(block, Role.TIE))
    rows = block.measurements
    wrong = np.isin(rows.point, ties[: round(share * len(ties))]) & (rows.image == 0)
    xy = rows.xy + np.where(wrong[:, None], rng.uniform(-200.0, 200.0, rows.xy.shape), 0.0)
    return replace(block, measurements=replace(rows, xy=xy))


def without(block: Block, rows: np.ndarray) -> Block:
    return block.with_measurements(~rows)


# ---- nothing wrong --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gcps", [0, 1, 4, 10])
@pytest.mark.parametrize("seed", mark_beyond(1, "thorough", [11, 12, 13]))
def test_sound_blocks_have_no_reason(seed: int, gcps: int):
    assert reasons_of(sound(seed, gcps=gcps, bias_px=2.0)) == {}  # without GCPs 5 px are expected of an RPC


# ---- known points ---------------------------------------------------------------------------------------------------


def test_gcps_that_disagree_are_told_though_ties_fit():
    block = sound()
    found = reasons_of(simulated_blocks.move_surveys(block, rows_of(block, Role.GCP)[::2], (16.0, 0.0, 0.0)))
    assert found["control-misfit"].level is Level.UNUSABLE
    assert set(found["control-misfit"].points) <= set(block.points.ids[rows_of(block, Role.GCP)])


def test_a_single_wrong_gcp_is_left_out_and_the_rest_is_used():
    block = sound()
    wrong = rows_of(block, Role.GCP)[3:4]
    block = simulated_blocks.move_surveys(block, wrong, (0.0, 12.0, 0.0))
    found, name = reasons_of(block), str(block.points.ids[wrong[0]])
    assert found.keys() == {"control-outliers"}
    assert found["control-outliers"].level is Level.DOUBTFUL
    assert found["control-outliers"].points == (name,)
    assert f"10 GCPs (1 rejected: {name})" in summarise_accuracy(report(adjust(block, SNOOPING)))


def test_gcps_far_off_are_told_before_the_adjustment():
    block = sound()
    (reason,) = check_block(simulated_blocks.move_surveys(block, np.flatnonzero(block.known), (2400.0, 0.0, 0.0)))
    assert (reason.code, reason.level) == ("control-implausible", Level.UNUSABLE)
    assert reason.images == tuple(image.id for image in block.images)


def test_check_points_of_another_datum():
    block = sound()
    found = reasons_of(simulated_blocks.move_surveys(block, rows_of(block, Role.CHECK), (0.0, 0.0, 20.0)))
    assert found.keys() == {"check-misfit"} and found["check-misfit"].level is Level.UNUSABLE


def test_check_heights_off_together_are_told_though_each_fits():
    """A height off by 3 sigma of each point is beyond chance for twenty; the truth of the block has none."""
    block = sound()
    check = block.points.role == Role.CHECK
    sigma = np.sqrt(np.nanmean(evidence_of(block).result.ground_covariance_m2[check, 2, 2]))
    size = max(6.0 * float(sigma), 3.0)
    reason = reasons_of(simulated_blocks.move_surveys(block, rows_of(block, Role.CHECK), (0.0, 0.0, size)))[
        "check-misfit"
    ]
    assert "mean difference in height" in reason.message and "above the block" in reason.message
    assert "difference in east" not in reason.message


@pytest.mark.parametrize("gcps", mark_beyond(1, "thorough", [2, 3]))
@pytest.mark.parametrize("step", [(20.0, 0.0, 0.0), pytest.param((0.0, 0.0, 60.0), marks=pytest.mark.thorough)])
def test_one_of_few_gcps_that_is_wrong_is_doubtful_and_in_the_prediction(gcps: int, step: tuple[float, float, float]):
    """What comes out is compared with the right survey of the wrong GCP, and with the metres that it was moved by."""
    right = sound(gcps=gcps, checks=0)
    assert "control-misfit" not in reasons_of(right, AdjustOptions())
    evidence = evidence_of(simulated_blocks.move_surveys(right, rows_of(right, Role.GCP)[:1], step), AdjustOptions())
    reason = {one.code: one for one in find_reasons(evidence)}["control-misfit"]
    assert reason.level is Level.DOUBTFUL
    assert right.points.ids[rows_of(right, Role.GCP)[0]] in reason.points
    told_m = float(re.search(r"disagree by ([0-9.]+) m", reason.message)[1])
    assert told_m == pytest.approx(20.0, rel=0.2) if step[0] else told_m > 3.0
    (part,) = evidence.result.parts
    ties = right.points.role == Role.TIE
    truth = adjust(right, AdjustOptions()).ground
    error = ground_difference_m(evidence.result.ground[ties], truth[ties])
    assert 2.0 * part.ce90_m > np.percentile(np.hypot(*error[:, :2].T), 90.0)
    assert 2.0 * part.le90_m > np.percentile(np.abs(error[:, 2]), 90.0)


@pytest.mark.parametrize(("wrong", "level"), [(1, Level.DOUBTFUL), (2, Level.DOUBTFUL), (4, Level.UNUSABLE)])
@pytest.mark.parametrize("step", [(5.0, 0.0, 0.0), (20.0, 0.0, 0.0), (0.0, 0.0, 20.0)])
@pytest.mark.parametrize("ties", [60, 0])
def test_a_minority_of_wrong_check_points_is_named_and_a_majority_refuses(
    wrong: int, level: Level, step: tuple[float, float, float], ties: int
):
    """Six check points; without tie points the images are refined separately, which tells 20 m, too."""
    block = sound(gcps=6, checks=6, ties=ties)
    rows = rows_of(block, Role.CHECK)[:wrong]
    block = simulated_blocks.move_surveys(block, rows, step)
    verdict = judge(adjust(block, SNOOPING), check_block(block))
    if step[0] == 5.0:  # a misfit of a few sigma
        assert verdict.level is Level.DOUBTFUL or wrong == 4
    else:
        assert verdict.level is level
    if wrong < 4:
        (misfit,) = (reason for reason in verdict.reasons if reason.code == "check-misfit")
        assert set(misfit.points) == set(block.points.ids[rows].tolist())
        assert "the majority agrees" in misfit.message


# ---- ties -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("share", "level"), [(0.1, None), (0.4, Level.DOUBTFUL)])
def test_many_wrong_ties_are_told(share: float, level: Level | None):
    """Each of them is seen by three images, and leaves some measurements: a third of four in ten are wrong."""
    found = reasons_of(mismatched(sound(ties=150), share))
    assert (found["ties-wrong"].level if "ties-wrong" in found else None) is level
    assert found.keys() <= {"ties-wrong"}


@pytest.mark.parametrize(("share", "level"), [(0.15, None), (0.3, Level.DOUBTFUL)])
def test_of_two_rays_that_do_not_meet_one_counts_as_wrong(share: float, level: Level | None):
    """On two images both measurements of a wrong point go, of which one is wrong: a tenth of the ties is a fifth."""
    block = without(sound(ties=300), sound(ties=300).measurements.image == 2)
    found = reasons_of(mismatched(block, share))
    assert (found["ties-wrong"].level if "ties-wrong" in found else None) is level
    assert found.keys() <= {"ties-wrong", "few-ties"}  # nothing lies on the third image


def test_ties_of_which_most_are_wrong_are_unusable():
    block = sound(ties=150)
    rng = np.random.default_rng(2)
    tie = (block.points.role == Role.TIE)[block.measurements.point]
    xy = block.measurements.xy + np.where(tie[:, None], rng.uniform(-200.0, 200.0, (len(tie), 2)), 0.0)
    found = reasons_of(replace(block, measurements=replace(block.measurements, xy=xy)))
    assert max(reason.level for reason in found.values()) is Level.UNUSABLE


def test_link_whose_ties_do_not_fit():
    """Half of the ties join images 0 and 1 only; these are wrong, the others hold the block."""
    block = sound(ties=300)
    rows = block.measurements
    pair = np.isin(rows.point, rows_of(block, Role.TIE)[:40])
    block = without(block, pair & (rows.image == 2))
    some = np.isin(block.measurements.point, rows_of(block, Role.TIE)[40:])
    block = without(block, some & (block.measurements.image == 1))  # the others join 0 and 2
    rng = np.random.default_rng(3)
    rows = block.measurements
    wrong = np.isin(rows.point, rows_of(block, Role.TIE)[:40]) & (rows.image == 1)
    xy = rows.xy + np.where(wrong[:, None], rng.uniform(-150.0, 150.0, rows.xy.shape), 0.0)
    found = reasons_of(replace(block, measurements=replace(rows, xy=xy)))
    named = [found[code] for code in ("ties-wrong", "ties-wrong") if code in found]
    assert named and {"image1"} <= set(named[0].images)


def test_image_held_by_two_ties_and_image_held_by_none():
    block = sound(gcps=4, checks=0, ties=20)
    rows = block.measurements
    kept = np.isin(rows.point, rows_of(block, Role.TIE)[:2])
    few = reasons_of(without(block, (rows.image == 2) & ~kept))
    assert few.keys() == {"few-ties"} and few["few-ties"].images == ("image2",)
    none = reasons_of(without(block, rows.image == 2))
    assert none.keys() == {"few-ties"} and none["few-ties"].images == ("image2",)


def test_part_without_control():
    block = sound(gcps=6, checks=0, ties=40, count=4, bias_px=2.0)
    rows = block.measurements
    tie = (block.points.role == Role.TIE)[rows.point]
    first = np.isin(rows.point, rows_of(block, Role.TIE)[:20])
    apart = np.where(rows.image < 2, tie & ~first, ~tie | first)
    found = reasons_of(without(block, apart))
    assert found.keys() == {"few-ties"}
    assert set(found["few-ties"].images) == {"image2", "image3"}


# ---- solution -------------------------------------------------------------------------------------------------------


def test_drift_that_a_shift_leaves_is_measured_and_its_model_named():
    """Known drifts of an image: the RMS of what a shift leaves of them is found to 15 %."""
    block, _, errors = simulated_blocks.block(gcps=60, checks=0, ties=0, drift=3e-3, count=1, seed=4)
    evidence = evidence_of(block, AdjustOptions(model="shift", reject_sigma=0.0, sigma_drift=0.0))
    image = block.images[0]
    field = (block.measurements.xy - image.centre_px) @ errors[0][:, 1:].T
    field -= field.mean(axis=0)
    (found,) = evidence.fields
    assert found.rms_px == pytest.approx(np.sqrt(np.mean(np.sum(field**2, axis=1))), rel=0.15)
    assert found.model == "affine"


@pytest.mark.thorough
def test_small_field_is_a_note_and_no_reason():
    block = simulated_blocks.block(gcps=300, checks=0, ties=0, drift=2e-4, count=1, noise_px=0.1, seed=8)[0]
    evidence = evidence_of(block)
    assert find_reasons(evidence) == []
    assert any("affine" in note for note in describe_residual_fields(evidence))


@pytest.mark.thorough
def test_no_advice_names_what_is_done_already():
    """The affine drift that a tight prior holds down is not removed by the model affine; a shift has no simpler one."""
    block = simulated_blocks.block(gcps=300, checks=0, ties=0, drift=2e-4, count=1, noise_px=0.1, seed=8)[0]
    (note,) = describe_residual_fields(evidence_of(block, replace(SNOOPING, model="affine", sigma_drift=1e-7)))
    assert "the model affine has these terms" in note and "would remove" not in note
    stopped = replace(SNOOPING, max_iterations=1, test_sigmas=False)
    for model, simpler in (("shift", False), ("affine", True)):
        reason = reasons_of(sound(drift=1e-3, bias_px=300.0), replace(stopped, model=model)).get("not-converged")
        assert reason is None or ("fewer parameters" in reason.advice) == simpler


def test_stopped_iterations():
    block = sound(drift=1e-3)
    assert reasons_of(block, AdjustOptions(model="affine", max_iterations=1, test_sigmas=False)).keys() >= {
        "not-converged"
    }


@pytest.mark.parametrize(("fit_px", "level"), [(0.01, None), (0.5, Level.DOUBTFUL), (2.0, Level.UNUSABLE)])
def test_rpc_that_is_not_its_model(fit_px: float, level: Level | None):
    found = {reason.code: reason.level for reason in find_reasons(evidence_of(sound(), fit_px=fit_px))}
    assert found.get("rpc-unlike-model") is level


def test_residuals_beyond_all_sigmas():
    block = sound()
    xy = block.measurements.xy + np.random.default_rng(1).normal(0.0, 8.0, block.measurements.xy.shape)
    found = reasons_of(replace(block, measurements=replace(block.measurements, xy=xy)), AdjustOptions(model="shift"))
    assert found["sigmas-implausible"].level is Level.UNUSABLE
    needed = re.search(r"image points of ([\d.]+) px instead of 0.3 px", found["sigmas-implausible"].message)
    assert float(needed[1]) == pytest.approx(8.0, rel=0.15)  # GCPs have their survey's sigma too


@pytest.mark.parametrize(("noise_px", "reported"), [(0.06, False), (0.2, True)])
def test_residuals_as_small_as_the_errors_of_cameras_are_no_reason(noise_px: float, reported: bool):
    """Pixels without noise have sigmas near 0: residuals of a tenth of a pixel are many of these, and right."""
    block = sound(noise_px=noise_px)
    measurements = replace(block.measurements, sigma_px=np.full_like(block.measurements.sigma_px, 0.01))
    options = AdjustOptions(model="shift", variance_components=False, test_sigmas=False)
    assert ("sigmas-implausible" in reasons_of(replace(block, measurements=measurements), options)) == reported


def test_sigmas_stated_four_times_too_small_are_doubtful_with_their_figures():
    """Noise of 0.3 px and 0.4 m is told by its group: what is stated right is not named."""
    right = sound(gcps=20, ties=120, noise_m=0.4)
    points = replace(right.points, sigma_m=np.full_like(right.points.sigma_m, 0.4))
    assert "sigmas-implausible" not in reasons_of(replace(right, points=points), AdjustOptions(model="shift"))
    points = replace(points, sigma_m=np.full_like(points.sigma_m, 0.1))
    found = reasons_of(replace(right, points=points), AdjustOptions(model="shift"))
    assert found["sigmas-implausible"].level is Level.DOUBTFUL
    factor = re.search(
        r"GCP east, north ([\d.]+) times \(([\d.]+) m instead of 0.1\)", found["sigmas-implausible"].message
    )
    assert float(factor[1]) == pytest.approx(4.0, rel=0.3) and "image points" not in found["sigmas-implausible"].message


def test_gcps_that_the_others_predict_badly_are_a_reason_where_no_check_points_tell():
    """GCPs of 0.5 m stated as 0.05 m, believed: the factor is that of adjustments without each of them."""
    believed = AdjustOptions(model="shift", test_sigmas=False, reject_sigma=0.0)
    right = sound(gcps=12, checks=0, ties=400, noise_m=0.5, noise_px=0.1)
    wrong = replace(right, points=replace(right.points, sigma_m=np.where(right.known[:, None], 0.05, np.inf)))
    assert "control-misfit" not in reasons_of(right, believed)
    found = reasons_of(wrong, believed)["control-misfit"]
    assert found.level is Level.DOUBTFUL
    squares = []
    for point in rows_of(wrong, Role.GCP):
        role = wrong.points.role.copy()
        role[point] = Role.TIE
        others = adjust(replace(wrong, points=replace(wrong.points, role=role)), believed)
        error = ground_difference_m(wrong.points.ground[[point]], others.ground[[point]])[0]
        squares.append(error @ np.linalg.solve(others.ground_covariance_m2[point] + 0.05**2 * np.eye(3), error))
    expected = np.sqrt((4.0 + np.sum(squares)) / (4.0 + 36.0))  # predictions count for four observations
    told = re.search(r"are ([\d.]+) times the predicted", found.message)
    assert told is not None and float(told[1]) == pytest.approx(expected, rel=0.05)


# ---- the verdict ----------------------------------------------------------------------------------------------------


def test_a_named_cause_stands_alone():
    block = sound()
    wrong = evidence_of(simulated_blocks.move_surveys(block, rows_of(block, Role.GCP)[::2], (16.0, 0.0, 0.0)))
    cause = Reason("height-datum", Level.UNUSABLE, "heights", "convert them")
    assert find_reasons(wrong, [cause]) == [cause]
    hint = replace(cause, level=Level.DOUBTFUL)
    assert {reason.code for reason in find_reasons(wrong, [hint])} > {"height-datum"}


def test_level_is_the_worst_and_stands_first():
    doubtful, unusable = Reason("one", Level.DOUBTFUL, "m", "a"), Reason("other", Level.UNUSABLE, "m", "a")
    assert Verdict.create("s", []).level is Level.OK
    verdict = Verdict.create("s", [doubtful, unusable, doubtful])
    assert verdict.level is Level.UNUSABLE
    assert [reason["level"] for reason in verdict.entry()["reasons"]] == ["unusable", "doubtful", "doubtful"]


def test_python_users_get_the_same_verdict():
    block = sound()
    verdict = judge(adjust(block, SNOOPING), check_block(block))
    assert verdict.level is Level.OK and verdict.reasons == ()
    assert verdict.sentence == summarise_accuracy(report(adjust(block, SNOOPING)))


def report(result: Adjustment) -> dict:
    from hrsi.hrsi_engine.results.figures import block_report

    refined = [RefitRPC(image.rpc, 0.0) for image in result.block.images]
    return block_report(result, compute_residuals(result), refined)


def test_sentence_tells_what_was_reached():
    figures = report(adjust(sound(), SNOOPING))
    check, predicted = figures["check"], figures["check"]["predicted"]
    assert summarise_accuracy(figures) == (
        f"3 images, tie points {format_figure(figures['ties']['rmse_px'])} px RMSE; 10 GCPs, 10 check points: "
        f"CE90 {format_figure(check['ce90_m'])} m (predicted {format_figure(predicted['ce90_m'])}), "
        f"LE90 {format_figure(check['le90_m'])} m (predicted {format_figure(predicted['le90_m'])})"
    )


def test_the_predicted_accuracy_of_the_block_does_not_contain_the_surveys_of_check_points():
    """Surveys of 3 m are an error of the check points, not of the block; their errors are compared with both."""
    block = sound()
    sigma = np.where((block.points.role == Role.CHECK)[:, None], 3.0, block.points.sigma_m)
    coarse = report(adjust(replace(block, points=replace(block.points, sigma_m=sigma)), SNOOPING))
    assert coarse["parts"] == report(adjust(block, SNOOPING))["parts"]
    assert coarse["check"]["predicted"]["ce90_m"] > 6.0  # 2.146 sigma of 3 m
    assert f"(predicted {format_figure(coarse['check']['predicted']['ce90_m'])})" in summarise_accuracy(coarse)


def test_sentence_without_gcps_and_check_points_says_what_is_predicted():
    figures = report(adjust(sound(gcps=0, checks=0), SNOOPING))
    text = summarise_accuracy(figures)
    assert text.startswith("3 images, tie points ")
    assert f"; no GCPs, no check points: predicted CE90 {format_figure(figures['parts'][0]['ce90_m'])} m" in text


def test_sentence_counts_the_images_that_are_tied():
    block = sound(gcps=0, checks=0)
    figures = report(adjust(without(block, block.measurements.image == 2), SNOOPING))
    assert summarise_accuracy(figures).startswith("2 of 3 images, tie points ")


@given(st.floats(1e-3, 1e5))
def test_brief_figures_are_right_to_a_twentieth(value: float):
    """Two digits that count, or two decimals: five per cent, or half of the last decimal."""
    assert float(format_figure(value)) == pytest.approx(value, rel=0.051, abs=0.0051)


def test_fields_are_those_of_the_f_test():
    """Drifts around the size at which they begin to count, also where the points lie on a line, against the design."""
    rng = np.random.default_rng(12)
    found, expected = [], []
    for number in range(400):
        position = rng.uniform(-1.0, 1.0, (rng.integers(12, 200), 2))
        position[:, 1] = 0.3 if number % 10 == 0 else position[:, 1]  # all on a line: fewer terms than rows
        residual = rng.normal(size=position.shape)
        residual[:, 0] += rng.uniform(0.0, 2.0) * (number % 2) * position[:, 0]
        found.append(_find_field("A", position, residual) is not None)
        u, v = position.T
        design = np.column_stack([np.ones_like(u), u, v, u * v, u * u, v * v])
        solved, _, rank, _ = np.linalg.lstsq(design, residual, rcond=None)
        rest, freedom = np.sum((residual - design @ solved) ** 2), 2 * (len(u) - rank)
        ratio = (np.sum(residual**2) - rest) / (2 * rank) / (rest / freedom)
        expected.append(stats.f.sf(ratio, 2 * rank, freedom) <= SIGNIFICANCE.false_alarm)
    assert found == expected
    assert 50 < sum(found) < 250
