"""Relative shifts of a block's cameras, estimated from all matches, for the prediction of points in unmatched images.

The position in image b of a point at p in image a follows from both RPCs, the height h of the point and the shifts s of
the images relative to their RPCs::

    q = project_b(localize_a(p - s_a, h)) + s_b  ~  transfer(p, h0) - J s_a + s_b + t dh

J is the derivative of the transfer by p and t that by the height, each constant for a pair. All matches of a point have
the same dh. With U the unit columns of the t of each point, and A those of the shifts, its elimination leads to

    (A'A - A'U U'A) s = (A' - A'U U') r,        r = q - transfer(p, h0),

with a weak prior, since the block as a whole is not fixed. Only shifts are estimated: the drift of a camera over an
image is smaller than the range of the search that follows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from ...block.block import Image
from ...foundation.robust_scale import robust_sigma
from ...foundation.thresholds import ITERATIONS, MEMORY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ..tile_matching.epipolar import EPIPOLAR, transfer
from ..tile_matching.types import HeightGrid, TilePairGeometry
from .coarse import CoarseJob, PairEstimate, interpolate_median, place_height_nodes
from .joining import BlockMatches, group_by_pair


@thresholds
class CAMERAS:
    """Estimation of relative camera shifts from matches, and half width of searches at predicted positions."""

    prior_px: float = threshold(30.0, "px", "a priori standard deviation of a camera's shift")
    margin_px: float = threshold(2.0, "px", "smallest half width of a search", "Pléiades, Kahramanmaras, 2026-11-22")


@dataclass(frozen=True, eq=False)
class RelativeCameras:
    """Shifts of images relative to their RPCs, and ground points of the tracks.

    shift_px : (images, 2); sigma_px : (images,) search range of the positions predicted by them
    tracks : (n,) ascending track numbers; partners : (n,) number of images besides the reference that show them
    ground : (n, 3) their ground positions
    """

    shift_px: np.ndarray
    sigma_px: np.ndarray
    tracks: np.ndarray
    partners: np.ndarray
    ground: np.ndarray

    def estimate(self, job: CoarseJob, first: int, second: int) -> PairEstimate | None:
        """Return the predicted geometry of two images (indices); None if too few ground points are in the first one."""
        xy = job.first.rpc.project(self.ground) + self.shift_px[first]
        margin = float(np.hypot(self.sigma_px[first], self.sigma_px[second]))
        inside = ((xy > -margin) & (xy < np.array(job.first.known_size) + margin)).all(axis=1)
        if inside.sum() < SAMPLES.tested:
            return None
        xy, height = xy[inside], self.ground[inside, 2]
        nodes, shape, spacing = place_height_nodes(job.first.known_size)
        grid = HeightGrid(interpolate_median(xy, height, nodes, SAMPLES.tested).reshape(shape), (0.0, 0.0), spacing)
        # Accuracy of interpolated heights: deviations of points from their neighbours
        sigma = max(float(robust_sigma(height - interpolate_median(xy, height, xy, SAMPLES.tested, 1))), 0.5)
        reach = SIGNIFICANCE.sigmas * sigma
        turn, _ = _linearise_transfer(job.first, job.second, xy, height)
        bias = self.shift_px[second] - turn @ self.shift_px[first]
        geometry = TilePairGeometry(
            first=job.first.rpc,
            second=job.second.rpc,
            lowest_m=float(height.min()) - reach,
            highest_m=float(height.max()) + reach,
            bias_px=(float(bias[0]), float(bias[1])),
            margin_px=(margin, margin),
            heights=grid,
            height_sigma_m=sigma,
        )
        return PairEstimate(geometry, 0)


def _linearise_transfer(
    first: Image, second: Image, xy: np.ndarray, height_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean derivatives of a transfer by the position ``(2, 2)`` and by the height ``(2,)``."""
    sampled = np.linspace(0, len(xy) - 1, min(SAMPLES.local, len(xy))).astype(int)
    sampled_xy, height = xy[sampled], height_m[sampled]

    def transfer_offset(dx: float, dy: float, dh: float) -> np.ndarray:
        return transfer(first.rpc, second.rpc, sampled_xy + (dx, dy), height + dh)

    steps = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    slope = [np.nanmean(transfer_offset(*step) - transfer_offset(*np.negative(step)), axis=0) / 2.0 for step in steps]
    return np.column_stack(slope[:2]), slope[2]


def estimate_relative_cameras(matches: BlockMatches, images: Sequence[Image]) -> RelativeCameras | None:
    """Return the relative shifts of a block's images estimated from its matches; None without matches.

    Unknowns are a shift of each image, with the prior `CAMERAS.prior_px`, and a height of each point, which is
    eliminated by the projection onto its parallaxes (U in the code). Discrepancies of matches beyond
    `CAMERAS.margin_px` lose weight (Huber).
    """
    if not len(matches):
        return None
    names, point = np.unique(matches.track, return_inverse=True)
    turn, climb = np.empty((len(matches), 2, 2)), np.empty((len(matches), 2))
    rows_of = group_by_pair(matches)
    for (a, b), rows in rows_of.items():
        xy, heights = matches.first_xy[rows], matches.height_m[rows]
        turn[rows], climb[rows] = _linearise_transfer(images[a], images[b], xy, heights)
    # One height for all matches of a point: the mean weighted by their sensitivity to it
    weight = np.maximum(np.sum(climb**2, axis=1), EPIPOLAR.least_stretch**2)
    height = (np.bincount(point, weight * matches.height_m) / np.bincount(point, weight))[point]
    discrepancy = np.empty((len(matches), 2))
    for (a, b), rows in rows_of.items():
        predicted = transfer(images[a].rpc, images[b].rpc, matches.first_xy[rows], height[rows])
        discrepancy[rows] = matches.second_xy[rows] - predicted
    equation = 2 * np.arange(len(matches))[:, None] + [0, 1]
    # Derivatives (2 n, 2 images) of the transfers by the shifts
    by_first = np.broadcast_to((2 * matches.first[:, None] + [0, 1])[:, None, :], turn.shape)
    column = np.concatenate([by_first.ravel(), (2 * matches.second[:, None] + [0, 1]).ravel()])
    entries = np.concatenate([-turn.ravel(), np.ones(equation.size)])
    row = np.concatenate([np.repeat(equation.ravel(), 2), equation.ravel()])
    design = sparse.csr_matrix((entries, (row, column)), shape=(equation.size, 2 * len(images)))
    weight = np.ones(equation.shape)
    for _ in range(ITERATIONS.repeated):
        root = np.sqrt(weight).ravel()
        A, r = sparse.diags(root) @ design, root * discrepancy.ravel()
        t = root * climb.ravel()
        length = np.sqrt(np.bincount(np.repeat(point, 2), t**2))
        unit = t / np.maximum(length, 1e-12)[np.repeat(point, 2)]
        U = sparse.csr_matrix((unit, (equation.ravel(), np.repeat(point, 2))))
        UA = U.T @ A
        N = (A.T @ A - UA.T @ UA + sparse.identity(A.shape[1]) / CAMERAS.prior_px**2).tocsc()
        shift = spsolve(N, A.T @ r - UA.T @ (U.T @ r))
        height_part = r - A @ shift
        rise = (U.T @ height_part) / np.maximum(length, 1e-12)
        deviation = (discrepancy.ravel() - design @ shift - climb.ravel() * rise[np.repeat(point, 2)]).reshape(-1, 2)
        weight[:] = np.minimum(1.0, CAMERAS.margin_px / np.maximum(np.hypot(*deviation.T), 1e-9))[:, None]
    shift = shift.reshape(-1, 2)
    head = np.unique(point, return_index=True)[1]
    ground = np.empty((len(names), 3))
    for number in np.unique(matches.first[head]):
        head_rows = head[matches.first[head] == number]
        risen = height[head_rows] + rise[point[head_rows]]
        ground[point[head_rows]] = (
            images[number].rpc.localize(matches.first_xy[head_rows] - shift[number], risen).ground
        )
    has_ground = np.isfinite(ground).all(axis=1)
    return RelativeCameras(
        *_extend_to_all_images(matches, shift, deviation),
        names[has_ground],
        np.bincount(point)[has_ground],
        ground[has_ground],
    )


def _extend_to_all_images(
    matches: BlockMatches, shift: np.ndarray, deviation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return shifts ``(images, 2)`` and search ranges ``(images,)``, px, also of images without matches."""
    matched = np.unique(np.r_[matches.first, matches.second])
    sigma = np.full(len(shift), CAMERAS.margin_px)
    sigma[matched] += SIGNIFICANCE.sigmas * float(robust_sigma(deviation.ravel()))
    unmatched = np.setdiff1d(np.arange(len(shift)), matched)
    middle = np.median(shift[matched], axis=0)
    spread = SIGNIFICANCE.sigmas * float(np.max(robust_sigma(shift[matched] - middle, axis=0), initial=0.0))
    shift[unmatched], sigma[unmatched] = middle, min(CAMERAS.margin_px + spread, MEMORY.border_px)
    return shift, sigma
