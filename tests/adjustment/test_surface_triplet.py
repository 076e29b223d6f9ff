"""The real Pleiades triplet, its RPCs displaced, on its own DSM: the benchmark's figures for two of its vectors."""

import numpy as np
import pytest

from hrsi.benchmarks import surface_triplet as triplet
from hrsi.hrsi_engine import find_tie_points, open_image
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Role


@pytest.mark.real
def test_the_displaced_triplet_comes_back(real_data, tmp_path):
    images = [open_image(str(triplet.FOLDER / f"img_0{k}.tif")) for k in (1, 2, 3)]
    ties, judge = find_tie_points(images).image_points, triplet.Judge()
    coarse = triplet.write_degraded(str(tmp_path))
    for offset in triplet.draw_vectors(12)[[1, 9]]:
        block = assemble([triplet.displace_rpc(image, offset) for image in images], [], [ties])
        # what was asked for: 0.5 m in plan and 0.3 m in height; 3 m with cells of 30 m
        for dem, sigma_m, plan_m, height_m in ((str(triplet.DSM), 1.0, 0.5, 0.3), (coarse, 3.0, 3.0, 3.0)):
            result, _ = triplet.adjust_on(block, dem, sigma_m, 100.0)
            error = judge.find_offset(result.ground[result.block.points.role == Role.TIE])
            assert np.hypot(*error[:2]) < min(plan_m, result.parts[0].ce90_m)
            assert abs(error[2]) < min(height_m, result.parts[0].le90_m)
