"""Corners by line intersection against known lines and Monte Carlo."""

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import SolveError
from hrsi.hrsi_engine.measurement.targets.line_corner import fit_line, intersect_lines, split_into_lines

CORNER = np.array([131.2, 3881.8])


def edge(azimuth_deg: float, count: int, first: float = 1.0, step: float = 1.5) -> np.ndarray:
    along = first + step * np.arange(count)
    azimuth = np.radians(azimuth_deg)
    return CORNER + along[:, None] * np.array([np.cos(azimuth), np.sin(azimuth)])


def test_exact_edges_meet_in_the_corner():
    corner = intersect_lines(fit_line(edge(20.0, 3)), fit_line(edge(95.0, 5)))
    np.testing.assert_allclose(corner.position, CORNER, atol=1e-9)
    assert corner.angle_deg == pytest.approx(75.0)
    assert corner.rmse_px < 1e-9


def test_covariance_is_that_of_repeated_measurements():
    """The corner lies beyond the points, so its offset is an extrapolation; 500 draws are good to 7 %.

    Power (normal, 5 %, 0.85 to 1.15): 1.00 fails with 0.3 %, 1.30 with 99 %.
    """
    rng = np.random.default_rng(3)
    first, second = edge(20.0, 8), edge(95.0, 6)
    corners = [
        intersect_lines(*(fit_line(points + rng.normal(0, 0.2, points.shape)) for points in (first, second)))
        for _ in range(500)
    ]
    scatter = np.cov(np.array([corner.position for corner in corners]).T)
    stated = np.mean([corner.covariance_px2 for corner in corners], axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(stated)), np.sqrt(np.diag(scatter)), rtol=0.15)


def test_mixed_edge_points_are_told_apart():
    rng = np.random.default_rng(4)
    points = np.concatenate([edge(20.0, 4), edge(110.0, 3)]) + rng.normal(0, 0.1, (7, 2))
    order = rng.permutation(7)
    first, second = split_into_lines(points[order])
    assert {frozenset(order[first].tolist()), frozenset(order[second].tolist())} == {
        frozenset(range(4)), frozenset(range(4, 7)),
    }  # fmt: skip


def test_stray_points_are_left_out():
    points = edge(30.0, 12)
    points[5] += (2.0, -2.0)
    line = fit_line(points, tolerance_px=0.5)
    assert line.used.sum() == 11
    assert not line.used[5]
    assert line.rmse_px < 1e-9


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: fit_line(edge(0.0, 2)), "needs 3"),
        (lambda: fit_line(np.ones((4, 2))), "coincide"),
        (lambda: intersect_lines(fit_line(edge(10.0, 5)), fit_line(edge(14.0, 5))), "no corner"),
        (lambda: split_into_lines(edge(10.0, 6)), "two lines"),
    ],
)
def test_what_is_no_corner(make, reason: str):
    with pytest.raises(SolveError, match=reason):
        make()
