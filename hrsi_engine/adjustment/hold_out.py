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
from ..block.columns import group_by_number
from ..foundation.thresholds import EQUALITY, GRIDS, SAMPLES
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
        sample = sample_tracks(block, tracks, share)
        # Number of common tracks of each pair of images, and number of those that would stay
        rows = block.measurements
        rows_of_tracks = np.flatnonzero(tracks[rows.point])
        incidence = sparse.csr_matrix(
            (np.ones(len(rows_of_tracks), dtype=np.int32), (rows.point[rows_of_tracks], rows.image[rows_of_tracks])),
            (len(block.points), len(block.images)),
        )
        incidence.data[:] = 1  # for points measured twice on an image
        common, common_sample = incidence.T @ incidence, incidence[sample].T @ incidence[sample]
        pairs = common_sample.tocoo()
        common_count = np.asarray(common[pairs.row, pairs.col]).ravel()
        remaining = common_count - pairs.data
        poor = (remaining < EQUALITY.majority * common_count) | (remaining < np.minimum(common_count, SAMPLES.tested))
        poor &= pairs.row != pairs.col
        weak = sparse.csr_matrix((np.ones(poor.sum(), np.int32), (pairs.row[poor], pairs.col[poor])), common.shape)
        is_needed = np.asarray((incidence[sample] @ weak).multiply(incidence[sample]).sum(axis=1)).ravel() > 0
        role[sample[~is_needed]] = Role.HELD_OUT
    return block if (role == block.points.role).all() else replace(block, points=replace(block.points, role=role))


def sample_tracks(block: Block, tracks: np.ndarray, share: float) -> np.ndarray:
    """Return the indices of a share of the ``tracks`` (mask over the points), evenly from the cells of the images."""
    rows = block.measurements
    used = np.flatnonzero(tracks[rows.point])
    head = np.full(len(tracks), -1)
    head[rows.point[used[::-1]]] = used[::-1]  # of each track, its row on its first image
    head = head[head >= 0]
    image, point = rows.image[head], rows.point[head]
    centre, half = (
        np.array([getattr(one, attribute) for one in block.images]) for attribute in ("centre_px", "half_size_px")
    )
    place = (rows.xy[head] - centre[image]) / (2.0 * np.maximum(half[image], 0.5)) + 0.5
    cell = np.clip((place * GRIDS.cells).astype(np.int64), 0, GRIDS.cells - 1)
    cell_of_block = (image * GRIDS.cells + cell[:, 1]) * GRIDS.cells + cell[:, 0]
    order = np.lexsort((rows.xy[head, 0], rows.xy[head, 1]))
    order = order[group_by_number(cell_of_block[order], len(block.images) * GRIDS.cells**2)[0]]
    number = np.arange(1, len(order) + 1)
    is_taken = np.floor(number * share) > np.floor((number - 1) * share)
    return np.sort(point[order[is_taken]])
