"""Held-out tie points: a share of the tracks that is not adjusted, and verifies the adjusted cameras.

The share is taken equally from every part of every image: tracks are sorted by their first image, their cell in it, and
the position in that cell, and every n-th is taken (systematic sampling of a stratified population, Cochran 1977,
chapter 8). No random number is used, so that a second run holds out the same tracks. If a pair of images would lose too
many of its common tracks, these stay in the adjustment: no connection of images depends on tracks that are not
adjusted.
"""

from dataclasses import replace

import numpy as np
from scipy import sparse

from ..block.block import Block, Role
from .options import HOLD_OUT


def hold_out_ties(block: Block, share: float) -> Block:
    """Return the block with some of its tie points as `Role.HELD_OUT`; if it has some already, it is unchanged.

    share : of the tie tracks to hold out, in blocks with more than `HOLD_OUT.fewest_tracks`; 0 holds out none
    """
    role = block.points.role.copy()
    tracks = (role == Role.TIE) & (block.rays_per_point() >= 2)
    if share == 0.0:
        role[role == Role.HELD_OUT] = Role.TIE
    elif not (role == Role.HELD_OUT).any() and np.count_nonzero(tracks) > HOLD_OUT.fewest_tracks:
        chosen = sample_tracks(block, tracks, share)
        # Number of common tracks of each pair of images, and number of those that would stay
        rows = block.measurements
        here = np.flatnonzero(tracks[rows.point])
        seen = sparse.csr_matrix(
            (np.ones(len(here), dtype=np.int32), (rows.point[here], rows.image[here])),
            (len(block.points), len(block.images)),
        )
        seen.data[:] = 1  # for points measured twice on an image
        common, lost = seen.T @ seen, seen[chosen].T @ seen[chosen]
        pairs = lost.tocoo()
        every = np.asarray(common[pairs.row, pairs.col]).ravel()
        kept = every - pairs.data
        poor = (kept < HOLD_OUT.least_kept * every) | (kept < np.minimum(every, HOLD_OUT.fewest_kept))
        poor &= pairs.row != pairs.col
        weak = sparse.csr_matrix((np.ones(poor.sum(), np.int32), (pairs.row[poor], pairs.col[poor])), common.shape)
        needed = np.asarray((seen[chosen] @ weak).multiply(seen[chosen]).sum(axis=1)).ravel() > 0
        role[chosen[~needed]] = Role.HELD_OUT
    return block if (role == block.points.role).all() else replace(block, points=replace(block.points, role=role))


def sample_tracks(block: Block, tracks: np.ndarray, share: float) -> np.ndarray:
    """Return the indices of a share of the ``tracks`` (mask over the points), evenly from the cells of the images."""
    rows = block.measurements
    head = np.flatnonzero(tracks[rows.point])
    head = head[np.unique(rows.point[head], return_index=True)[1]]  # of each track, its row on its first image
    image, point = rows.image[head], rows.point[head]
    centre, half = (np.array([getattr(one, what) for one in block.images]) for what in ("centre_px", "half_size_px"))
    place = (rows.xy[head] - centre[image]) / (2.0 * np.maximum(half[image], 0.5)) + 0.5
    cell = np.clip((place * HOLD_OUT.cells).astype(np.int64), 0, HOLD_OUT.cells - 1)
    order = np.lexsort((rows.xy[head, 0], rows.xy[head, 1], cell[:, 0], cell[:, 1], image))
    number = np.arange(1, len(order) + 1)
    taken = np.floor(number * share) > np.floor((number - 1) * share)
    return np.sort(point[order[taken]])
