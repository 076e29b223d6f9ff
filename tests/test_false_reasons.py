"""Right blocks keep their verdict, and nine of ten errors are inside: a short `benchmarks/false_reasons.py`."""

from dataclasses import replace

import numpy as np
import pytest

from hrsi.benchmarks.false_reasons import FAMILIES, run_block, simulate
from hrsi.hrsi_engine import adjust, judge
from hrsi.hrsi_engine.laboratory.simulation import PointCounts

SEEDS = range(30_000, 30_008)
#: Of 90 %, by which a prediction may differ, and the scatter of the mean of blocks each of which is inside or not.
TOLERANCE, SCATTER = 0.04, 2.6 * np.sqrt(0.9 * 0.1 / len(SEEDS))


@pytest.mark.coverage
@pytest.mark.parametrize(
    "name", ["two GCPs, free DEM of 2 m", "jitter, three images", "free DEM alone", "one GCP, IKONOS"]
)
def test_predictions_cover_and_no_right_block_is_accused(name: str):
    """Eight blocks, each of which may be inside or outside as a whole.

    Power (comparison): figures half as large as the errors, which cover 40 % instead of 90 %, fail in nine of ten runs.
    """
    outcomes = [run_block(FAMILIES[name], seed) for seed in SEEDS]
    inside = np.mean([one.inside for one in outcomes], axis=0)
    print(name, inside, [one.codes for one in outcomes])
    assert (inside > 0.9 - TOLERANCE - SCATTER).all()
    # jitter that the images do not separate from the ground is a right reason
    assert {code for one in outcomes for code in one.codes} <= {"jitter"}


def test_a_surface_is_matched_by_rays_alone():
    """Heights of 16 m pixels have 15 m by the rays: taken from the surface, they agree with it at any position."""
    right = replace(FAMILIES["free DEM alone"], sensors=("wide-field",), landforms=("hills",))
    outcome = run_block(right, 60_033)
    assert outcome.level == "ok"
    assert outcome.ratios[0] < 1.5  # the 90 % limit of the errors in plan over the predicted one; it was 6


@pytest.mark.parametrize(("angle_deg", "codes"), [(4.0, []), (1.3, ["not-determined"])])
def test_the_sentence_states_what_narrow_rays_do_not_determine(angle_deg: float, codes: list[str]):
    narrow = replace(FAMILIES["six degrees, no GCPs"], angles_deg=(-angle_deg, angle_deg))
    narrow = replace(narrow, points=replace(narrow.points, checks=0))
    simulated, options = simulate(narrow, SEEDS[0])
    result = adjust(simulated.block, options)
    verdict, part = judge(result), result.parts[0]
    assert [reason.code for reason in verdict.reasons] == codes
    assert ("not determined: height (LE90" in verdict.sentence) == bool(codes)
    assert part.base_to_height == pytest.approx(2.0 * np.tan(np.radians(angle_deg)), rel=0.2)  # the Earth is curved
    assert "predicted CE90" in verdict.sentence


def test_jitter_that_two_images_share_stays_a_reason():
    """Along the base two images show no vibration: heights keep it. A surface determines these, not the plan.

    Three GCPs do not determine waves of constant period, as eight would.
    """
    for name, has_waves in (("jitter, two images", True), ("jitter, two images, surface", False)):
        few_gcps = replace(FAMILIES[name], lines=8000, points=PointCounts(3, 60, 1500))
        simulated, options = simulate(few_gcps, 30_001)
        reasons = {reason.code: reason for reason in judge(adjust(simulated.block, options)).reasons}
        assert ("in the heights of" in reasons["jitter"].message) == has_waves
        assert "positions in plan of" in reasons["jitter"].message


@pytest.mark.parametrize(("name", "seed"), [("jitter, two images", 81_009), ("jitter, two images, surface", 81_000)])
def test_waves_of_nearly_one_phase_are_predicted_and_accuse_no_gcps(name: str, seed: int):
    """The waves of both images differ little, and GCPs alone show their size; heights of check points keep their noise.

    Power (comparison): without the comparison with GCPs the plan errors were 1.8 times the predicted ones, and the
    sigmas of the GCPs six times the stated ones; the sigmas of heights contained 70 % of the errors, not 90 %.
    """
    outcome = run_block(FAMILIES[name], seed)
    assert set(outcome.codes) <= {"jitter"}
    assert outcome.ratios[0] < 1.3 and (outcome.inside[2:] > 0.9 - 2.6 * np.sqrt(0.9 * 0.1 / 60.0)).all()
