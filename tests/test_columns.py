"""Rows brought together by their numbers, against one search after the other."""

import numpy as np
import pytest

from hrsi.hrsi_engine.block.columns import group_by_number


@pytest.mark.parametrize("count", [1, 7, 1 << 16, (1 << 16) + 1])
def test_rows_of_a_number_stay_in_order(count: int):
    number = np.random.default_rng(3).integers(0, count, 500)
    number[:2] = 0, count - 1
    order, bounds = group_by_number(number, count)
    assert bounds[0] == 0 and len(bounds) == count + 1
    for one in np.unique(number):
        assert order[bounds[one] : bounds[one + 1]].tolist() == np.flatnonzero(number == one).tolist()
    nothing, begins = group_by_number(number[:0], count)
    assert not len(nothing) and not begins.any()
