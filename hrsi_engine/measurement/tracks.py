"""Tracks: the same ground point on two or more images, from pairwise matches, and chosen to lie evenly."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components


def build_tracks(first: np.ndarray, second: np.ndarray, image_of_node: np.ndarray) -> np.ndarray:
    """Return the track number of each node (keypoint), -1 for nodes without one.

    Matches join nodes ``first[i]`` and ``second[i]``; connected nodes form a track. A track that meets an image twice
    contradicts itself and is dropped whole. Numbers run from 0.
    """
    count = len(image_of_node)
    graph = sparse.coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    size = np.bincount(label)
    images = np.unique(np.column_stack([label, image_of_node]), axis=0)
    different = np.bincount(images[:, 0], minlength=len(size))
    valid = (size >= 2) & (different == size)
    number = np.where(valid, np.cumsum(valid) - 1, -1)
    return number[label]


def select_tracks_by_cell(
    track: np.ndarray, image: np.ndarray, xy: np.ndarray, quality: np.ndarray, cell_px: np.ndarray, per_cell: np.ndarray
) -> np.ndarray:
    """Return a mask of tracks to keep so that no image's grid cell gets more than it needs.

    Longer tracks come first, then those of higher quality. A track is kept when at least one of its cells still has
    room, so that images with few points keep theirs.

    track, image : (n,) of each measurement; xy : (n, 2); quality : (tracks,); cell_px : (images, 2) cell sizes;
    per_cell : (images,) tracks that a cell of an image has room for
    """
    tracks = len(quality)
    length = np.bincount(track, minlength=tracks)
    cell = np.column_stack([image, np.floor(xy / cell_px[image]).astype(np.int64)])
    distinct, cell_number = np.unique(cell, axis=0, return_inverse=True)
    room = per_cell[distinct[:, 0]].tolist()
    order = np.argsort(track, kind="stable")
    cells = np.split(cell_number[order], np.cumsum(length)[:-1])
    keep = np.zeros(tracks, dtype=bool)
    for candidate in np.lexsort((-quality, -length)):
        own = cells[candidate].tolist()
        if any(room[number] > 0 for number in own):
            keep[candidate] = True
            for number in own:
                room[number] -= 1
    return keep
