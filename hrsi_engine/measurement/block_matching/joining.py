"""Tracks from the matches of all windows: outliers, contradictions and duplicates are removed, the rest is thinned.

Two tests detect two kinds of wrong matches. *Across* the epipolar line the deviation of a match is that of the RPCs,
which changes slowly over the image: the deviations are compared with a polynomial trend, fitted robustly
(`drop_outliers`). *Along* the line a deviation is equivalent to a height h, but the pairs of a reference must agree on
it. In a pair with a parallax of s px per metre of height, a match determines h with the weight s^2, so the heights of a
track are compared with their mean

    h_mean = sum(s^2 h) / sum(s^2),        away = s (h - h_mean)  in px,

after a trend of each pair, again due to its RPCs, has been subtracted from its heights (`drop_contradictions`).

**Sigmas.** That of a match refers to the difference between two image points, since the grey values of both windows
have noise. Each end has the share 1 / sqrt(2), and the random camera errors (vibration, fit of the RPC) of c px::

    deviation across the line: variance s^2 + 2 c^2        image point: variance s^2 / 2 + c^2

c is constant in a block, such that the median of the squared deviations over their variances is that of chi squared
(`estimate_camera_sigma`). For real images s / sqrt(2) agrees with the residuals, from the best to the worst matches
(docs/protocols/tie_sigmas.md).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...block.block import Image
from ...block.columns import Columns
from ...block.points import ImagePoints
from ...foundation.robust_scale import ROBUST, robust_sigma
from ...foundation.thresholds import EQUALITY, ITERATIONS, SAMPLES, threshold, thresholds
from ...foundation.workers.scheduling import PartResult
from ..tile_matching.epipolar import EPIPOLAR, EpipolarDeviation, compute_epipolar_deviation
from ..window_matching.windows import MATCHING

_RELIEF = "simulated pairs on relief, errors along epipolar lines, 2026-11-22 (docs/protocols/tie_sigmas.md)"
_KAHRAMANMARAS = "Pléiades, Kahramanmaras, 2026-11-22"
_CLIFFS = "simulated cliffs, clouds, water, bands: nearly all false, 1 of 200 good; 2026-11-22"


@thresholds
class TESTS:
    """Limits for outliers among the matches of a pair or track, and for the sigmas of the others."""

    least_camera_px: float = threshold(0.0125, "px", "smallest random error of cameras", _RELIEF)
    deviation_px: float = threshold(
        0.25, "px", "largest deviation from the epipolar line without a test, and random error of cameras"
    )
    contradiction_px: float = threshold(0.375, "px", "largest deviation from the height of the track", _KAHRAMANMARAS)
    imprecise: float = threshold(3.0, "", "largest sigma of a match relative to its pair's median", _CLIFFS)
    island_slope: float = threshold(0.5, "px/px", "largest parallax step relative to the distance")
    island_gap: float = threshold(3.0, "", "distance over the median one, beyond which the step is constant")


MEDIAN_CHI_SQUARED = 0.4549  # with one degree of freedom


@dataclass(frozen=True, eq=False)
class BlockMatches(Columns):
    """All matches of a block, one row each; ``track`` numbers the points of all references from 0.

    In row k, point ``track[k]`` is at ``first_xy[k]`` of image ``first[k]`` and at ``second_xy[k]`` of image
    ``second[k]``, with the apparent height ``height_m[k]`` of that pair.
    """

    track: np.ndarray
    first: np.ndarray
    second: np.ndarray
    first_xy: np.ndarray
    second_xy: np.ndarray
    sigma_px: np.ndarray
    quality: np.ndarray
    kind: np.ndarray
    height_m: np.ndarray

    def __len__(self) -> int:
        return len(self.track)


def collect_matches(results: Sequence[tuple[int, PartResult]]) -> BlockMatches:
    """Concatenate the results of all star jobs, each given with the index of its reference."""
    names = ("first_xy", "second_xy", "sigma_px", "quality", "kind", "height_m")
    nonempty = [(number, result) for number, result in results if len(result["partner"])]
    if not nonempty:
        nothing, no_index = np.empty(0), np.empty(0, np.int64)
        return BlockMatches(
            track=no_index,
            first=no_index,
            second=no_index,
            first_xy=np.empty((0, 2)),
            second_xy=np.empty((0, 2)),
            sigma_px=nothing,
            quality=nothing,
            kind=np.empty(0, "U9"),
            height_m=nothing,
        )
    columns = {name: np.concatenate([result[name] for _, result in nonempty]) for name in names}
    second = np.concatenate([result["partner"] for _, result in nonempty])
    first = np.repeat([number for number, _ in nonempty], [len(result["partner"]) for _, result in nonempty])
    _, track = np.unique(np.column_stack([first, columns["first_xy"]]), axis=0, return_inverse=True)
    first_rows = np.unique(np.column_stack([track, second]), axis=0, return_index=True)[1]  # one of two windows
    return BlockMatches(track, first, second, **columns).select(first_rows)


# ---- tests ---------------------------------------------------------------------------------------------------------


def drop_outliers(matches: BlockMatches, images: Sequence[Image], islands: bool = False) -> BlockMatches:
    """Drop outliers of each pair from the smooth trend of its deviations across the epipolar lines.

    Also those far less precise than the pair's others, since their windows contain two surfaces or moving objects, and
    small islands whose height differs from all surroundings, as from repeated patterns; towers are such islands too,
    and are kept with ``islands``.
    """
    keep = np.zeros(len(matches), dtype=bool)
    for rows in group_by_pair(matches).values():
        miss = _compute_pair_miss(matches, rows, images)
        sigma = matches.sigma_px[rows]
        tolerance = np.maximum(TESTS.deviation_px, ROBUST.outlier * sigma)
        precise = sigma <= max(EQUALITY.camera_px, TESTS.imprecise * float(np.median(sigma)))
        keep[rows] = precise & _find_trend_inliers(matches.first_xy[rows], miss.across_px, tolerance)
        if not islands:
            rows, along = rows[keep[rows]], miss.along_px[keep[rows]]
            keep[rows] = _find_connected_heights(matches.first_xy[rows], along)
    return matches.select(keep)


def _compute_pair_miss(matches: BlockMatches, rows: np.ndarray, images: Sequence[Image]) -> EpipolarDeviation:
    """Return the deviations of one pair's matches from their epipolar lines, at their median height."""
    first, second = images[matches.first[rows[0]]], images[matches.second[rows[0]]]
    middle = float(np.median(matches.height_m[rows]))
    return compute_epipolar_deviation(first.rpc, second.rpc, matches.first_xy[rows], matches.second_xy[rows], middle)


def _find_connected_heights(xy: np.ndarray, parallax: np.ndarray) -> np.ndarray:
    """Return the mask ``(n,)`` of matches connected with many others by height steps of terrain and buildings.

    xy : (n, 2) in the first image; parallax : (n,) along the epipolar lines, px
    """
    if len(xy) <= SAMPLES.tested:
        return np.ones(len(xy), dtype=bool)
    distance, neighbours = cKDTree(xy).query(xy, k=SAMPLES.tested + 1)
    # The length of a step is limited: over a large gap any height difference would be plausible
    widest = TESTS.island_gap * float(np.median(distance[:, -1]))

    def is_plausible_step(step: np.ndarray, way: np.ndarray) -> np.ndarray:
        return np.asarray(np.abs(step) <= np.maximum(EPIPOLAR.jump_px, TESTS.island_slope * np.minimum(way, widest)))

    one, column = np.nonzero(is_plausible_step(parallax[neighbours] - parallax[:, None], distance))
    links = sparse.coo_matrix((np.ones(len(one), bool), (one, neighbours[one, column])), shape=(len(xy), len(xy)))
    _, part = csgraph.connected_components(links, directed=False)
    is_connected = np.asarray(np.bincount(part)[part] >= EQUALITY.negligible * len(xy))
    if is_connected.all() or not is_connected.any():
        return is_connected
    # An isolated part (behind water or a cloud) is accepted if most of it fits the nearest matches of the mainland
    distance, neighbours = cKDTree(xy[is_connected]).query(xy[~is_connected])
    fits = is_plausible_step(parallax[~is_connected] - parallax[is_connected][neighbours], distance)
    return is_connected | (2 * np.bincount(part[~is_connected], fits, part.max() + 1) > np.bincount(part))[part]


def estimate_camera_sigma(matches: BlockMatches, images: Sequence[Image]) -> float:
    """Return the standard deviation (px) of random camera errors of image points, from deviations across the lines.

    It is that with which the median of the squared deviations from each pair's trend, over their variances, equals the
    median of chi² with one degree of freedom.
    """
    deviation, variance = [], []
    for rows in group_by_pair(matches).values():
        if len(rows) < SAMPLES.tested:
            continue
        miss = _compute_pair_miss(matches, rows, images)
        terms = _build_trend_design(matches.first_xy[rows])
        finite = np.isfinite(miss.across_px)
        trend = terms @ np.linalg.lstsq(terms[finite], miss.across_px[finite], rcond=1e-10)[0]
        deviation.append((miss.across_px - trend)[finite])
        variance.append(matches.sigma_px[rows][finite] ** 2)
    if not deviation:
        return TESTS.least_camera_px
    squares, noise_variance = np.concatenate(deviation) ** 2, np.concatenate(variance)
    low, high = TESTS.least_camera_px, TESTS.deviation_px
    while high - low > 1e-4:
        middle = (low + high) / 2.0
        too_small = float(np.median(squares / (noise_variance + 2.0 * middle**2))) > MEDIAN_CHI_SQUARED
        low, high = (middle, high) if too_small else (low, middle)
    return low


def group_by_pair(matches: BlockMatches) -> dict[tuple[int, int], np.ndarray]:
    """Return the row indices of each pair of images (indices)."""
    order = np.lexsort((matches.second, matches.first))
    pairs = np.column_stack([matches.first, matches.second])[order]
    if not len(pairs):
        return {}
    heads = np.flatnonzero(np.r_[True, (pairs[1:] != pairs[:-1]).any(axis=1)])
    return {
        (int(pairs[row, 0]), int(pairs[row, 1])): rows
        for row, rows in zip(heads, np.split(order, heads[1:]), strict=True)
    }


def _build_trend_design(xy: np.ndarray) -> np.ndarray:
    """Return the design matrix ``(n, 6)`` of a quadratic trend over ``xy (n, 2)``; of a plane with few points."""
    x, y = ((xy - xy.mean(axis=0)) / (np.ptp(xy, axis=0).max() + 1.0)).T
    columns = [np.ones(len(xy)), x, y] + ([x * x, x * y, y * y] if len(xy) >= SAMPLES.quadratic else [])
    return np.column_stack(columns)


def _find_trend_inliers(xy: np.ndarray, values: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """Return which values agree with a robust smooth trend, within the tolerance or the robust outlier limit."""
    inliers = np.isfinite(values)
    if inliers.sum() < SAMPLES.tested:
        return np.zeros(len(values), dtype=bool)
    widest = np.maximum(3.0 * ROBUST.outlier * _robust_sigma(values[inliers]), 10.0 * tolerance)
    inliers &= np.abs(values - np.median(values[inliers])) < widest
    terms = _build_trend_design(xy)
    for _ in range(ITERATIONS.most):
        trend = terms @ np.linalg.lstsq(terms[inliers], values[inliers], rcond=1e-10)[0]
        deviation = np.abs(values - trend)
        now = deviation < np.maximum(ROBUST.outlier * _robust_sigma((values - trend)[inliers]), tolerance)
        now &= np.isfinite(values)
        if now.sum() < SAMPLES.tested or np.array_equal(now, inliers):
            break
        inliers = now
    return inliers


def _robust_sigma(values: np.ndarray) -> float:
    return float(robust_sigma(values - np.median(values)))


def drop_contradictions(matches: BlockMatches, images: Sequence[Image]) -> BlockMatches:
    """Drop matches whose height contradicts the other matches of their track; both if only two disagree.

    Apparent heights of pairs differ by a smooth function over the reference, which is estimated and subtracted.
    """
    keep = np.ones(len(matches), dtype=bool)
    for number in np.unique(matches.first):
        rows = np.flatnonzero(matches.first == number)
        keep[rows] = _check_heights(matches.select(rows), images)
    return matches.select(keep)


def _check_heights(matches: BlockMatches, images: Sequence[Image]) -> np.ndarray:
    """Return the mask ``(n,)`` of the matches of one reference whose heights agree with those of their tracks.

    Heights are weighted by the square of their parallax in px per metre; after each pair's trend is subtracted, the
    worst match of a track is dropped first, since it biases the mean of the others.
    """
    # Parallax along the epipolar lines in px per metre of height, the mean of each pair
    stretch = np.zeros(len(matches))
    for (first, second), rows in group_by_pair(matches).items():
        sampled = rows[:: max(1, len(rows) // 16)]
        miss = compute_epipolar_deviation(
            images[first].rpc,
            images[second].rpc,
            matches.first_xy[sampled],
            matches.second_xy[sampled],
            float(np.median(matches.height_m[sampled])),
            1,
        )
        stretch[rows] = np.nanmedian(miss.stretch)
    height = matches.height_m.copy()
    _, point = np.unique(matches.track, return_inverse=True)
    is_stereo = stretch > EPIPOLAR.least_stretch
    weight = np.where(is_stereo, stretch**2, 0.0)
    for _ in range(3):
        mean = _average_by_group(point, height, weight * is_stereo)
        for partner in np.unique(matches.second):
            partner_rows = np.flatnonzero((matches.second == partner) & is_stereo)
            common_rows = partner_rows[np.bincount(point[is_stereo])[point[partner_rows]] > 1]
            if len(common_rows) < SAMPLES.tested:
                continue
            difference = height[common_rows] - mean[point[common_rows]]
            fits = _find_trend_inliers(matches.first_xy[common_rows], difference, np.full(len(common_rows), np.inf))
            terms = _build_trend_design(matches.first_xy[common_rows])
            height[common_rows] -= terms @ np.linalg.lstsq(terms[fits], difference[fits], rcond=1e-10)[0]
    keep = np.ones(len(matches), dtype=bool)
    for _ in range(2):  # the worst match of each track first, since it biases the mean of the others
        away_px = np.abs(height - _average_by_group(point, height, weight * (is_stereo & keep))[point]) * stretch
        away_px[~keep | ~is_stereo] = 0.0
        worst = np.zeros(len(mean))
        np.maximum.at(worst, point, away_px)
        several = np.bincount(point, keep & is_stereo, len(mean)) > 2
        deviations = away_px[keep & is_stereo]
        nonzero = deviations[deviations > 1e-9]
        spread_of = float(robust_sigma(nonzero)) if len(nonzero) else 0.0
        limit = np.maximum(TESTS.contradiction_px, ROBUST.outlier * spread_of)
        outliers = (away_px > limit) & ((away_px >= worst[point]) | ~several[point])
        keep &= ~outliers
    return keep


def _average_by_group(group: np.ndarray, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the weighted means ``(groups,)`` of ``values (n,)`` by the number of their ``group (n,)``."""
    count = int(group.max(initial=-1)) + 1
    total = np.bincount(group, weight, count)
    return np.asarray(np.bincount(group, weight * values, count) / np.maximum(total, 1e-300))


# ---- tracks --------------------------------------------------------------------------------------------------------


def to_image_points(
    matches: BlockMatches, images: Sequence[Image], cells: int, per_cell: Mapping[int, int]
) -> tuple[ImagePoints, np.ndarray]:
    """Return the image points of the selected tracks and their approximate ground positions ``(tracks, 3)``.

    Every cell of an image's grid of ``cells`` x ``cells`` keeps about ``per_cell[image]`` tracks: those in most images
    first, then the best. Point ids are in the order of the tracks.
    """
    if not len(matches):
        return ImagePoints([], [], np.empty((0, 2))), np.empty((0, 3))
    names, track = np.unique(matches.track, return_inverse=True)
    head = np.unique(track, return_index=True)[1]
    match_sigma, camera = matches.sigma_px / np.sqrt(2.0), estimate_camera_sigma(matches, images)
    sigma = np.sqrt(np.bincount(track, match_sigma**2) / np.bincount(track))
    quality = np.bincount(track, matches.quality) / np.bincount(track)
    # The measurements: one of each track in its reference, one for each match in the other images
    of_track, image = np.r_[np.arange(len(names)), track], np.r_[matches.first[head], matches.second]
    xy = np.concatenate([matches.first_xy[head], matches.second_xy])
    rank = quality - np.sqrt(2.0) * sigma  # prefers accurate points of distinct matches
    # Of tracks that are close to each other in two images or more, found from two references, the better one is kept
    length = np.bincount(of_track, minlength=len(rank))
    duplicates: list[np.ndarray] = []
    for number in np.unique(image):
        rows_of_image = np.flatnonzero(image == number)
        close_pairs = cKDTree(xy[rows_of_image]).query_pairs(MATCHING.rival_px, output_type="ndarray")
        duplicates.append(np.sort(of_track[rows_of_image][close_pairs], axis=1))
    pairs, count = np.unique(np.concatenate(duplicates), axis=0, return_counts=True)
    pairs = pairs[count >= 2]
    first_better = np.lexsort((np.arange(len(rank)), -rank, -length)).argsort()
    worse = np.where(first_better[pairs[:, 0]] < first_better[pairs[:, 1]], pairs[:, 1], pairs[:, 0])
    is_single = np.ones(len(rank), dtype=bool)
    is_single[worse] = False
    rows_of_image = is_single[of_track]
    cell_px = np.array([np.maximum(np.array(image.size or (1, 1)) / cells, 1.0) for image in images])
    quota = np.array([per_cell.get(k, 0) for k in range(len(images))])
    is_selected = is_single.copy()
    is_selected[is_single] = select_tracks_by_cell(
        (np.cumsum(is_single) - 1)[of_track[rows_of_image]],
        image[rows_of_image],
        xy[rows_of_image],
        rank[is_single],
        cell_px,
        quota,
    )
    height = _average_by_group(track, matches.height_m, 1.0 / np.maximum(matches.sigma_px, 1e-3) ** 2)
    first = matches.first[head]
    ground = np.full((len(first), 3), np.nan)
    for number in np.unique(first):
        rows_of_image = first == number
        ground[rows_of_image] = (
            images[number].rpc.localize(matches.first_xy[head][rows_of_image], height[rows_of_image]).ground
        )
    # Image points `T1`, `T2` …, sorted by track and image
    rows = np.flatnonzero(is_selected[of_track])
    rows = rows[np.lexsort((image[rows], of_track[rows]))]
    ids = np.char.zfill(np.cumsum(is_selected)[of_track[rows]].astype(str), len(str(int(is_selected.sum()))))
    points = ImagePoints(
        ids=np.char.add("T", ids), image_ids=np.array([one.id for one in images])[image[rows]], xy=xy[rows],
        sigma_px=np.hypot(np.r_[sigma, match_sigma], camera)[rows], kind=np.r_[matches.kind[head], matches.kind][rows],
        quality=np.r_[quality, matches.quality][rows], source="tie points",
    )  # fmt: skip
    return points, ground[is_selected]


def build_tracks(first: np.ndarray, second: np.ndarray, image_of_node: np.ndarray) -> np.ndarray:
    """Return the track number of each node (keypoint), -1 for nodes without a track.

    Matches connect the nodes ``first[i]`` and ``second[i]``; a connected component is a track. A track with two nodes
    in one image is contradictory and dropped completely. Numbers start at 0.
    """
    count = len(image_of_node)
    graph = sparse.coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    size = np.bincount(label)
    different = np.bincount(np.unique(np.column_stack([label, image_of_node]), axis=0)[:, 0], minlength=len(size))
    valid = (size >= 2) & (different == size)
    return np.where(valid, np.cumsum(valid) - 1, -1)[label]


def select_tracks_by_cell(
    track: np.ndarray, image: np.ndarray, xy: np.ndarray, quality: np.ndarray, cell_px: np.ndarray, per_cell: np.ndarray
) -> np.ndarray:
    """Return a mask of tracks to keep, so that no grid cell of an image gets more than needed.

    Longer tracks are first, then those of higher quality. A track is kept if at least one of its cells still has
    room, so that images with few points keep theirs.

    track, image : (n,) of each measurement; xy : (n, 2); quality : (tracks,); cell_px : (images, 2) cell sizes;
    per_cell : (images,) number of tracks wanted in a cell of an image
    """
    tracks = len(quality)
    length = np.bincount(track, minlength=tracks)
    cell = np.column_stack([image, np.floor(xy / cell_px[image]).astype(np.int64)])
    distinct, cell_number = np.unique(cell, axis=0, return_inverse=True)
    room = per_cell[distinct[:, 0]].tolist()
    cells = np.split(cell_number[np.argsort(track, kind="stable")], np.cumsum(length)[:-1])
    keep = np.zeros(tracks, dtype=bool)
    for candidate in np.lexsort((-quality, -length)):
        track_cells = cells[candidate].tolist()
        if any(room[number] > 0 for number in track_cells):
            keep[candidate] = True
            for number in track_cells:
                room[number] -= 1
    return keep
