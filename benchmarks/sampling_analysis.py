"""What sampling alone does to corners and centres: tables 2.1 to 2.3 of the thesis, entry by entry.

An object covers pixels in part. A pixel covered by more than half belongs to the object, one covered by less does not,
one covered by exactly half may or may not; a row or column of such pixels decides as one (figure 2.2). All outcomes are
enumerated; the corner is every convex upper left corner pixel that occurs, the centre every middle of the outermost
rows and columns that occurs, and each distinct position counts once, as in the thesis.
"""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

RATIO = 4  # PAN pixels on a side of an MS pixel
OBJECT_PAN_PX = 8
HALF = 0.5
#: Errors of corner and centre (px) and their ratio that the thesis prints (table 2.3).
THESIS = {"different": (2.77, 1.31, 0.473), "same": (0.89, 0.53, 0.596)}


class Deviations(NamedTuple):
    """One case of table 2.1: by how many columns and rows of PAN pixels the object begins before an MS pixel."""

    case: int
    columns: int
    rows: int
    corners_px: tuple[float, ...]
    centres_px: tuple[float, ...]


def table_2_1() -> list[Deviations]:
    """Return deviations between corners and centres on PAN and MS images for the 16 relative positions."""
    return [
        Deviations(
            case + 1, case % RATIO, case // RATIO,
            _sorted(_corner_deviations(case % RATIO, case // RATIO)),
            _sorted(_centre_deviations(case % RATIO, case // RATIO)),
        )
        for case in range(RATIO * RATIO)
    ]  # fmt: skip


def _sorted(values: list[float]) -> tuple[float, ...]:
    return tuple(sorted(values))


def _choices(coverage: float) -> tuple[bool, ...]:
    """Return whether pixels of a coverage are recognised as object: both where it is exactly half."""
    return (True, False) if coverage == HALF else (coverage > HALF,)


def _corner_deviations(columns: int, rows: int) -> list[float]:
    """Return distances between the PAN corner pixel and every possible MS corner pixel (PAN px).

    MS pixel (0, 0) is the first one that the object, which extends right and down, covers fully.
    """
    left, above = columns / RATIO, rows / RATIO
    pan = np.array([-columns + 0.5, -rows + 0.5])
    found = set()
    for with_left, with_above in product(_choices(left), _choices(above)):
        for with_both in _choices(left * above):
            found |= _convex_corners(with_left, with_above, with_both)
    centres = [(np.array(pixel) + 0.5) * RATIO for pixel in sorted(found)]
    return [float(np.hypot(*(centre - pan))) for centre in centres]


def _convex_corners(with_left: bool, with_above: bool, with_both: bool) -> set[tuple[int, int]]:
    """Return the upper left corner pixels (column, row) of the recognised object: none to the left, none above."""
    is_object = {(-1, 0): with_left, (0, -1): with_above, (-1, -1): with_both, (0, 0): True}
    return {
        (c, r)
        for (c, r), inside in is_object.items()
        if inside and not is_object.get((c - 1, r), False) and not is_object.get((c, r - 1), False)
    }


def _centre_deviations(columns: int, rows: int) -> list[float]:
    """Return distances between the PAN centre and every possible MS centre of the 8 x 8 object (PAN px)."""
    pan = np.array([OBJECT_PAN_PX / 2.0 - columns, OBJECT_PAN_PX / 2.0 - rows])
    middles = [_middles(-offset / RATIO, (OBJECT_PAN_PX - offset) / RATIO) for offset in (columns, rows)]
    return [float(np.hypot(x * RATIO - pan[0], y * RATIO - pan[1])) for x, y in product(*middles)]


def _ends(start: float, end: float) -> tuple[list[int], list[int]]:
    """Return the possible first pixels and the possible ends (not included) of what covers start … end."""
    first, last = int(np.floor(start)), int(np.ceil(end)) - 1
    firsts = [first if inside else first + 1 for inside in _choices(first + 1 - start)]
    ends = [last + 1 if inside else last for inside in _choices(end - last)]
    return firsts, ends


def _middles(start: float, end: float) -> list[float]:
    """Return the distinct middles of a recognised extent, in pixel-edge coordinates."""
    firsts, ends = _ends(start, end)
    return sorted({(first + last) / 2.0 for first, last in product(firsts, ends)})


class Spread(NamedTuple):
    """Standard deviations (columns, rows) of one corner's, or the centre's, possible positions."""

    positions: tuple[tuple[float, float], ...]
    column: float
    row: float


@dataclass(frozen=True)
class SameResolutionCase:
    """One case of table 2.2: an object of ``size_px`` at a position; its four corners and its centre."""

    case: int
    size_px: float
    start: tuple[float, float]
    corners: tuple[Spread, ...]
    centre: Spread


def table_2_2() -> list[SameResolutionCase]:
    """Return the six cases of table 2.2: a 6 x 6 and a 5.5 x 5.5 square, each aligned or half a pixel off.

    Column and row numbers are those of figure 2.6. Cases 1 and 4 have no ambiguity.
    """
    placed = [
        (1, 6.0, (2.0, 2.0)), (2, 6.0, (2.0, 2.5)), (3, 6.0, (2.5, 2.5)),
        (4, 5.5, (2.75, 2.75)), (5, 5.5, (2.75, 2.5)), (6, 5.5, (2.5, 2.5)),
    ]  # fmt: skip
    return [_same_resolution_case(case, size, start) for case, size, start in placed]


def _same_resolution_case(case: int, size: float, start: tuple[float, float]) -> SameResolutionCase:
    columns, rows = (_ends(at, at + size) for at in start)
    corners = [
        _spread(list(product(sorted({c - side_c for c in cs}), sorted({r - side_r for r in rs}))))
        for (cs, side_c), (rs, side_r) in product(((columns[0], 0), (columns[1], 1)), ((rows[0], 0), (rows[1], 1)))
    ]
    middles = [_middles(at, at + size) for at in start]
    centre = _spread([(x - 0.5, y - 0.5) for x, y in product(*middles)])
    return SameResolutionCase(case, size, start, tuple(corners), centre)


def _spread(positions: list[tuple[float, float]]) -> Spread:
    """Return positions and their standard deviations with n - 1 (thesis eq. 2.4), 0 for a single one."""
    array = np.array(positions, dtype=np.float64)
    deviation = array.std(axis=0, ddof=1) if len(array) > 1 else np.zeros(2)
    return Spread(tuple((float(x), float(y)) for x, y in array), float(deviation[0]), float(deviation[1]))


@dataclass(frozen=True)
class SamplingErrors:
    """Errors of corners and centres (px), and centre over corner."""

    corner_px: float
    centre_px: float

    @property
    def ratio(self) -> float:
        return self.centre_px / self.corner_px


def table_2_3() -> dict[str, SamplingErrors]:
    """Return the averages of tables 2.1 (``different`` resolution) and 2.2 (``same``)."""
    cases = table_2_1()
    different = SamplingErrors(
        float(np.mean([np.mean(case.corners_px) for case in cases])),
        float(np.mean([np.mean(case.centres_px) for case in cases])),
    )
    rows = table_2_2()
    corners = [corner for row in rows for corner in row.corners]
    return {
        "different": different,
        "same": SamplingErrors(_mean_distance(corners), _mean_distance([row.centre for row in rows])),
    }


def _mean_distance(spreads: list[Spread]) -> float:
    """Return sqrt(s1² + s2²) of the mean deviations; deviations of 0 are left out, as the thesis does."""
    columns, rows = np.array([spread.column for spread in spreads]), np.array([spread.row for spread in spreads])
    return float(np.hypot(columns[columns > 0.0].mean(), rows[rows > 0.0].mean()))
