"""Arrows of the drawings: a line with a head, and the round length that their key shows."""

import math

HEAD_UNITS, HEAD_SLOPE = 7.0, 0.45  # length of a head, and half its width for a unit of its length
SHORTEST_UNITS = 0.5  # what is shorter would be a blot


def make_arrow_path(x: float, y: float, dx: float, dy: float, head: float = HEAD_UNITS) -> str:
    """Return the path (attribute ``d`` of SVG) of an arrow from x, y by dx, dy; empty for one too short to be seen.

    ``head`` is the length of its head; that of a short arrow is shorter.
    """
    length = math.hypot(dx, dy)
    if not length >= SHORTEST_UNITS:
        return ""
    ux, uy = dx / length, dy / length
    back = min(head, 0.6 * length)
    tip_x, tip_y = x + dx, y + dy
    sides = [(tip_x - back * (ux + HEAD_SLOPE * s * uy), tip_y - back * (uy - HEAD_SLOPE * s * ux)) for s in (1, -1)]
    (left_x, left_y), (right_x, right_y) = sides
    return (
        f"M{x:.1f},{y:.1f}L{tip_x:.1f},{tip_y:.1f}L{left_x:.1f},{left_y:.1f}"
        f"M{tip_x:.1f},{tip_y:.1f}L{right_x:.1f},{right_y:.1f}"
    )


def choose_round_length(longest: float) -> float:
    """Return the longest of 1, 2, 5 times a power of ten that is not longer than ``longest``, which is above 0."""
    power = 10.0 ** math.floor(math.log10(longest))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= longest * 1.000001)
