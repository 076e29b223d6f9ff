"""Parts of one strip: where each lies in it, and one RPC for all of them.

A linear array takes a strip in one sweep. Vendors deliver it in parts along the flight (WorldView's P001, P002 …) with
an RPC each, and scenes in tiles (R1C1 …) with one RPC. Parts are windows of the same pixels, so that a part lies whole
pixels from the next. The places follow from the RPCs: a pixel of one part is taken to the ground and into the next part
where they overlap, or just beyond its end. Where parts overlap the later one counts, which is also the one on top.

The RPC of the strip is fitted to grids over the parts at the heights of their RPCs. What it cannot follow over a long
strip is spread evenly: by Lawson's weights (1961), which grow where the residuals are large, least squares come near to
the smallest largest residual.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..camera.rpc import RPC
from ..camera.rpc_fit import RpcFit, best_fit, fit_rpc, make_virtual_grid
from ..foundation.errors import InputError
from ..foundation.thresholds import threshold, thresholds
from .block import Image


@thresholds
class STRIP:
    """What parts of one strip are, and how well one RPC has to follow them."""

    nodes: int = threshold(41, "nodes", "nodes along each side of a part that are looked for in another one")
    reach_share: float = threshold(0.02, "", "share of a part by which the next one may lie beyond its end")
    bent_px: float = threshold(2.0, "px", "largest change of a part's offset over what it shares with another one")
    whole_px: float = threshold(0.25, "px", "largest distance of a part from whole pixels without a word")
    fit_px: float = threshold(0.1, "px", "largest difference of the strip's RPC from its parts without a word")
    same_px: float = threshold(1e-6, "px", "difference below which parts have one RPC")
    grid: tuple[int, int, int] = threshold((15, 25, 6), "nodes", "samples, lines, heights of a part that are fitted to")
    check_grid: tuple[int, int, int] = threshold((16, 34, 7), "nodes", "of a part, where the fit is judged")
    rounds: int = threshold(8, "rounds", "of weights that spread what one RPC cannot follow", "WorldView-1, two parts")
    least_growth: float = threshold(0.05, "", "by which the weight of a residual of nothing still grows")


class StripPlaces(NamedTuple):
    """First pixel of each part in the strip ``(n, 2)`` int, the strip's size, distances from whole pixels ``(n,)``."""

    first: np.ndarray
    size: tuple[int, int]
    off_px: np.ndarray


class StripRpc(NamedTuple):
    """The RPC of a strip; what it is off each part (largest and RMS, ``(n,)``); the grid that it was fitted to."""

    rpc: RPC
    max_px: np.ndarray
    rms_px: np.ndarray
    ground: np.ndarray
    image: np.ndarray


def place_parts(parts: Sequence[Image]) -> StripPlaces:
    """Return where parts lie in their strip, whose first pixel is the first of any part.

    Raises `InputError` for a part that shares nothing with the others, or has other pixels.
    """
    found: dict[int, np.ndarray] = {0: np.zeros(2)}
    scenes = {None if part.tile is None or part.camera_pixel != 1.0 else part.tile.scene for part in parts}
    if len(scenes) == 1 and None not in scenes:
        found = {number: np.array(part.tile.first) for number, part in enumerate(parts) if part.tile is not None}
    last, reached = 0, dict[int, tuple[int, np.ndarray]]()  # nodes that tell the place of a part, and the place
    while len(found) < len(parts):
        for number in set(range(len(parts))) - set(found):
            nodes, offset = _measure_offset(parts[last], parts[number])
            if nodes > reached.get(number, (0,))[0]:
                reached[number] = nodes, found[last] + offset
        if not reached:
            lost = next(part.id for number, part in enumerate(parts) if number not in found)
            raise InputError(f"{lost} shares no ground with the other parts, nor lies at their end: leave it out")
        last = max(reached, key=lambda number: reached[number][0])
        found[last] = reached.pop(last)[1]
    places = np.array([found[number] for number in range(len(parts))])
    whole = np.rint(places).astype(np.int64)
    first = whole - whole.min(axis=0)
    end = (first + [part.known_size for part in parts]).max(axis=0)
    return StripPlaces(first, (int(end[0]), int(end[1])), np.abs(places - whole).max(axis=1))


def _measure_offset(known: Image, part: Image) -> tuple[int, np.ndarray]:
    """Return the place ``(2,)`` of a part's first pixel in another part, and before it how many nodes tell it."""
    xy = part.grid_px(STRIP.nodes, STRIP.nodes)
    ground, converged = part.rpc.localize(xy, part.middle_height_m)
    seen = known.rpc.project(ground)
    reach = (0.5 + STRIP.reach_share) * np.array(known.known_size)
    near = converged & (np.abs(seen - known.centre_px) <= reach).all(axis=1)
    offsets = (seen - xy)[near]
    if not len(offsets):
        return 0, np.zeros(2)
    if np.ptp(offsets, axis=0).max() > STRIP.bent_px:
        raise InputError(
            f"{part.id} and {known.id} are no parts of one strip: where both show the same ground the offset of their "
            f"pixels changes by {np.ptp(offsets, axis=0).max():.3g} px. Give images of one sweep with the same pixels"
        )
    return len(offsets), np.median(offsets, axis=0)


def fit_strip(parts: Sequence[Image], first: np.ndarray) -> StripRpc:
    """Return the RPC of a strip by those of its parts that lie at ``first``; exact where they are one RPC, else fitted.

    Raises `SolveError` where an RPC has no ground positions for its part.
    """
    fitted, checked = (
        [_make_grid(parts, first, number, shape) for number in range(len(parts))]
        for shape in (STRIP.grid, STRIP.check_grid)
    )
    points, check = (
        (np.concatenate([grid[0] for grid in grids]), np.concatenate([grid[1] for grid in grids]))
        for grids in (fitted, checked)
    )
    rpc = parts[0].rpc.shift(*first[0].astype(float))
    if _measure_apart(rpc, *check).max() > STRIP.same_px:
        rpc = _reduce_largest_residual(best_fit(points, check), points, check)
    errors = {name: [getattr(part.rpc, name) for part in parts] for name in ("err_bias", "err_rand")}
    known = {name: max(values) for name, values in errors.items() if None not in values}
    apart = [_measure_apart(rpc, *grid) for grid in checked]
    largest = [one.max(initial=0.0) for one in apart]  # 0 for a part that later ones cover whole
    rms = [np.sqrt(np.mean(one**2)) if len(one) else 0.0 for one in apart]
    return StripRpc(replace(rpc, **known), np.array(largest), np.array(rms), *points)


def _reduce_largest_residual(
    fit: RpcFit, points: tuple[np.ndarray, np.ndarray], check: tuple[np.ndarray, np.ndarray]
) -> RPC:
    """Return the RPC whose largest difference at the check points is smallest, of those that weighted fits give."""
    best, largest, weights = fit.rpc, fit.max_px, np.ones(len(points[0]))
    if largest <= STRIP.fit_px:
        return best
    apart = _measure_apart(best, *points)
    for _ in range(STRIP.rounds):
        weights *= apart / apart.max() + STRIP.least_growth
        rpc = fit_rpc(*points, weights=weights, ridge=fit.ridge).rpc
        apart = _measure_apart(rpc, *points)
        if (worst := float(_measure_apart(rpc, *check).max())) < largest:
            best, largest = rpc, worst
    return best


def _make_grid(
    parts: Sequence[Image], first: np.ndarray, number: int, shape: tuple[int, int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return ground ``(n, 3)`` and strip's image points ``(n, 2)`` over what is seen of a part at several heights."""
    part = parts[number]
    image, (ground, converged) = make_virtual_grid(part.rpc, part.domain_px, part.rpc.height_range, shape)
    image = image + first[number]
    for later, place in zip(parts[number + 1 :], first[number + 1 :], strict=True):
        converged = converged & ((image < place) | (image >= place + later.known_size)).any(axis=1)
    return ground[converged], image[converged]


def _measure_apart(rpc: RPC, ground: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Return the distances ``(n,)`` of image points from where an RPC has them."""
    return np.asarray(np.hypot(*(rpc.project(ground) - image).T))
