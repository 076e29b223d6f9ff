"""Features compared within bands along lines: against comparing all with all."""

import numpy as np

from hrsi.hrsi_engine.measurement.block_matching.overview import OVERVIEW, EpipolarLines, match_in_bands
from hrsi.hrsi_engine.measurement.tile_matching.features import compute_root_sift

MARGIN_PX = 40.0


def test_what_is_found_is_what_comparing_all_with_all_finds():
    """Also features of lines that are nowhere, and points that several lines pass by."""
    rng = np.random.default_rng(8)
    first = rng.integers(0, 160, (700, 128)).astype(np.uint8)
    partner = rng.permutation(700)
    second = np.clip(first[partner] + rng.normal(0.0, 35.0, (700, 128)), 0, 255).astype(np.uint8)
    origin = rng.uniform(0.0, 500.0, (700, 2))
    xy = origin[partner] + rng.normal(0.0, 25.0, (700, 2))
    angle = 0.4 + rng.normal(0.0, 0.05, 700)
    lines = EpipolarLines(origin, np.column_stack([np.cos(angle), np.sin(angle)]), rng.uniform(5.0, 60.0, 700))
    lines.origin[::50] = np.nan
    found = match_in_bands(first, second, lines, xy, MARGIN_PX)

    apart = xy - lines.origin[:, None]
    along = np.abs((apart * lines.direction[:, None]).sum(axis=2))
    across = np.abs(lines.direction[:, :1] * apart[..., 1] - lines.direction[:, 1:] * apart[..., 0])
    inside = (across <= MARGIN_PX) & (along <= lines.reach[:, None] + MARGIN_PX)
    likeness = np.where(
        inside, compute_root_sift(first).astype(np.float64) @ compute_root_sift(second).T.astype(np.float64), -1.0
    )
    expected = []
    for i in range(700):
        j, rival = np.argsort(-likeness[i])[:2]
        clear = 1.0 - likeness[i, j] < OVERVIEW.ratio**2 * (1.0 - max(likeness[i, rival], 0.0))
        if likeness[i, j] > 0.0 and clear and likeness[:, j].argmax() == i:
            expected.append((i, int(j)))
    assert len(expected) > 300 and not any(i % 50 == 0 for i, _ in expected)
    assert set(map(tuple, found.tolist())) == set(expected)
