"""Matching of two windows with RPC geometry: interest points of the first, measured in the second to about 0.05 px.

1. The second window is resampled to the geometry of the first (`TileFrame`). Matches of the overviews in the window are
   the seeds. If there are few, SIFT features (Lowe 2004) with square-rooted descriptors that are mutual nearest
   neighbours are candidates, and the test against the RPC geometry, which permits a bias, selects the correct ones.
2. Every interest point of the first window (`features`) is searched at the position predicted by neighbouring seeds,
   in a box along the epipolar line (`search_windows`), and measured by least-squares matching of the original pixels of
   both windows. The matches found are the seeds of the next round.
3. Matches that contradict the epipolar geometry, their neighbours, or their own precision are rejected.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...foundation.robust_scale import ROBUST, robust_sigma
from ...foundation.thresholds import SAMPLES
from ..window_matching.least_squares_matching import match_patches, search_windows
from ..window_matching.windows import DONE, MATCHING_BANDS, SEARCH_BAND, LsmOptions, MatchImage
from .epipolar import EPIPOLAR, Consistency, check_rpc_consistency, match_descriptors
from .features import FEATURES, compute_root_sift, detect_sift_features, detect_tile_points
from .options import TILE_MATCH, TileMatchOptions
from .types import ImageTile, TileFrame, TileMatches, TilePairGeometry, make_empty_matches


def match_tile(
    first: ImageTile, second: ImageTile, geometry: TilePairGeometry, options: TileMatchOptions | None = None
) -> TileMatches:
    """Return the interest points of the first tile that are found in the second."""
    options = options or TileMatchOptions()
    points = first.compute_once(("points", *options.point_choice), lambda: detect_tile_points(first, options))
    task = _Task(TileFrame(first, second, geometry), options, points)
    if not len(task.points):
        return make_empty_matches()
    seeds = _find_seeds(task)
    if len(seeds.points) < SAMPLES.redundant:
        return make_empty_matches()
    table = _MatchTable.nothing(len(task.points))
    for window in options.windows_px:
        rows = np.flatnonzero(~table.done)
        table.add(rows, *_match_points(task, rows, _predict(task, rows, seeds), window))
        matched = np.flatnonzero(table.done)
        table.done[matched[~_check_consistency(task, task.points[matched], table.xy[matched]).good]] = False
        matched = np.flatnonzero(table.done)
        if len(matched) < SAMPLES.redundant:
            return make_empty_matches()
        seeds = _Seeds(task.points[matched], task.frame.compute_displacements(task.points[matched], table.xy[matched]))
    return _select_matches(task, table)


def transfer_points(
    first: ImageTile,
    second: ImageTile,
    geometry: TilePairGeometry,
    first_xy: np.ndarray,
    height_m: np.ndarray,
    options: TileMatchOptions | None = None,
) -> TileMatches:
    """Return the positions in the second tile of given points of the first tile with known heights, if they are found.

    ``first_xy (n, 2)`` are whole pixels of the first tile (as `match_tile` returns them), ``height_m (n,)`` their
    heights, known from a match in another image. ``geometry.bias_px`` should be that of the pair, as the height is
    from another pair; points are searched within a few pixels.
    """
    options = options or TileMatchOptions()
    frame = TileFrame(first, second, geometry)
    points = np.round(first.to_tile(first_xy)).astype(np.int64).reshape(-1, 2)
    inside = np.all((points >= 0) & (points < first.pixels.shape[::-1]), axis=1)
    task = _Task(frame, options, points[inside])
    if len(task.points) < SAMPLES.redundant:
        return make_empty_matches()
    shift = frame.compute_displacements(task.points, frame.predict(task.points, heights_m=np.asarray(height_m)[inside]))
    return _select_matches(task, _match_near(task, shift))


def refine_points(
    first: ImageTile,
    second: ImageTile,
    geometry: TilePairGeometry,
    first_xy: np.ndarray,
    second_xy: np.ndarray,
    options: TileMatchOptions | None = None,
) -> TileMatches:
    """Return given matches, measured again, that pass the tests of `match_tile`.

    Points are the whole pixels of the first tile nearest to ``first_xy (n, 2)``; they are searched within a few pixels
    of ``second_xy (n, 2)``.
    """
    options = options or TileMatchOptions()
    frame = TileFrame(first, second, geometry)
    tile_xy = first.to_tile(first_xy)
    points, rows = np.unique(np.round(tile_xy).astype(np.int64), axis=0, return_index=True)
    inside = np.all((points >= 0) & (points < first.pixels.shape[::-1]), axis=1)
    task = _Task(frame, options, points[inside])
    if len(task.points) < SAMPLES.redundant:
        return make_empty_matches()
    return _select_matches(
        task, _match_near(task, frame.compute_displacements(tile_xy, second.to_tile(second_xy))[rows[inside]])
    )


def _match_near(task: _Task, shift: np.ndarray) -> _MatchTable:
    """Return the points that are found within a few pixels of known displacements ``(n, 2)``."""
    table = _MatchTable.nothing(len(task.points))
    reach_px = task.options.reach_px[0], task.options.across_px
    for window in dict.fromkeys(task.options.windows_px):
        rows = np.flatnonzero(~table.done)
        table.add(rows, *_match_points(task, rows, _Prediction(shift[rows], np.tile(reach_px, (len(rows), 1))), window))
    return table


# ---- tables of the steps -------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Task:
    """Two windows, the interest points of the first, and quantities derived from them when first needed."""

    frame: TileFrame
    options: TileMatchOptions
    points: np.ndarray

    @cached_property
    def direction(self) -> np.ndarray:
        """Unit vectors of the parallax at the points, in the first window."""
        return self.frame.parallax(self.points)[0]

    @cached_property
    def jacobian(self) -> np.ndarray:
        return self.frame.compute_jacobians(self.points)

    @cached_property
    def searched(self) -> tuple[MatchImage, MatchImage]:
        """The first window and the resampled second one, filtered for the search."""
        first, second = self.frame.first, self.frame.resampled
        first_image = first.compute_once("searched", lambda: SEARCH_BAND.filter_image(first.pixels, first.valid))
        return first_image, SEARCH_BAND.filter_image(second.pixels, second.valid)

    @cached_property
    def _images(self) -> dict[str, tuple[MatchImage, MatchImage]]:
        return {}

    def images(self, name: str) -> tuple[MatchImage, MatchImage]:
        """Return both windows in a band; the one with higher resolution is smoothed to the resolution of the other."""
        if name not in self._images:
            first, second, scale = self.frame.first, self.frame.second, self.frame.scale
            band, coarser = MATCHING_BANDS[name], max(1.0, 1.0 / scale)
            key = "band", name, coarser
            first_image = first.compute_once(key, lambda: band.filter_image(first.pixels, first.valid, coarser))
            self._images[name] = first_image, band.filter_image(second.pixels, second.valid, max(1.0, scale))
        return self._images[name]

    @cached_property
    def chosen(self) -> list[tuple[str, bool]]:
        """The name of the selected band, and whether there were enough matches to select it; empty before."""
        return [(self.options.bands[0], True)] if len(self.options.bands) == 1 else []


class _Seeds(NamedTuple):
    """Positions in the first window and displacements in its frame, ``(n, 2)`` each."""

    points: np.ndarray
    shift: np.ndarray


class _Prediction(NamedTuple):
    """Predicted displacement of each point ``(n, 2)``, and half length and half width of the search box, ``(n, 2)``."""

    shift: np.ndarray
    reach: np.ndarray


@dataclass(eq=False)
class _MatchTable:
    """State of each interest point: whether it is matched, position, correlation and sigma (px)."""

    done: np.ndarray
    xy: np.ndarray
    correlation: np.ndarray
    sigma: np.ndarray

    @classmethod
    def nothing(cls, count: int) -> _MatchTable:
        return cls(np.zeros(count, bool), np.full((count, 2), np.nan), np.zeros(count), np.full(count, np.nan))

    def add(
        self, rows: np.ndarray, matched: np.ndarray, xy: np.ndarray, correlation: np.ndarray, sigma: np.ndarray
    ) -> None:
        """Enter matches of the points ``rows[found]``."""
        index = rows[matched]
        self.done[index], self.xy[index], self.correlation[index], self.sigma[index] = True, xy, correlation, sigma


# ---- steps ---------------------------------------------------------------------------------------------------------


def _find_seeds(task: _Task) -> _Seeds:
    """Return known matches in or near the first window, or its SIFT matches consistent with the RPCs if these are few.

    Without features, all points are returned with displacement 0.
    """
    frame, limit = task.frame, task.options.features
    if not limit:
        return _Seeds(task.points, np.zeros((len(task.points), 2)))
    overview_matches = frame.geometry.seeds
    if overview_matches is not None:
        points = frame.first.to_tile(overview_matches[:, :2])
        margin, size = TILE_MATCH.seed_margin_px, np.array(frame.first.pixels.shape[::-1])
        nearby = np.flatnonzero(((points >= -margin) & (points < size + margin)).all(axis=1))
        if len(nearby) >= TILE_MATCH.fewest_seeds:
            return _Seeds(
                points[nearby],
                frame.compute_displacements(points[nearby], frame.second.to_tile(overview_matches[nearby, 2:])),
            )
    # features of the first tile are used for all partners; the ratio test is lenient, since the geometry is tested
    first_tile, second_tile = frame.first, frame.resampled
    first_features = first_tile.compute_once(
        ("sift", limit), lambda: detect_sift_features(first_tile.pixels, first_tile.valid, limit)
    )
    second_features = detect_sift_features(second_tile.pixels, second_tile.valid, limit)
    ours, theirs = (compute_root_sift(features.descriptors) for features in (first_features, second_features))
    i, j = match_descriptors(ours, theirs, FEATURES.lenient_ratio)
    first, second = first_features.xy[i], second_features.xy[j] + second_tile.origin_px
    nearby = np.linalg.norm(first - second, axis=1) <= 1.5 * float(np.hypot(*frame.reach_px))
    first, second = first[nearby], second[nearby]
    if len(first) < SAMPLES.redundant:
        return _Seeds(np.empty((0, 2)), np.empty((0, 2)))
    consistent = _check_consistency(task, first, frame.predict(second)).good
    return _Seeds(first[consistent], (second - first)[consistent])


def _predict(task: _Task, rows: np.ndarray, seeds: _Seeds) -> _Prediction:
    """Return the search boxes of points: the median displacement of neighbouring seeds, with a size by their spread."""
    options = task.options
    direction = task.direction[rows]
    if not options.features and seeds.points is task.points:
        reach = np.tile(np.maximum(task.frame.reach_px, 1.5), (len(rows), 1))
        return _Prediction(np.zeros((len(rows), 2)), reach)
    normal = np.column_stack([direction[:, 1], -direction[:, 0]])
    count = min(SAMPLES.tested, len(seeds.points))
    distance, neighbours = cKDTree(seeds.points).query(task.points[rows], k=np.arange(1, count + 1))
    along, across = (
        np.sort(np.einsum("nki,ni->nk", seeds.shift[neighbours], axis), axis=1) for axis in (direction, normal)
    )
    middle = np.median(along, axis=1)[:, None] * direction + np.median(across, axis=1)[:, None] * normal
    spread = along[:, -2] - along[:, 1] if count > 3 else along[:, -1] - along[:, 0]
    length = TILE_MATCH.spread * spread + TILE_MATCH.slope * distance[:, -1] + options.reach_px[0]
    reach = np.minimum(length, options.reach_px[1])
    return _Prediction(middle, np.column_stack([reach, np.full(len(rows), options.across_px)]))


def _match_points(
    task: _Task, rows: np.ndarray, expected: _Prediction, window: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Search points and match them; return which of ``rows`` are found, positions, correlations and sigmas (px)."""
    frame, options, points = task.frame, task.options, task.points[rows]
    half = max(window // 2 - TILE_MATCH.search_margin_px, 4)
    pad = frame.pad_px
    predicted = points + expected.shift + pad
    correlated = search_windows(*task.searched, points, predicted, task.direction[rows], expected.reach, half)
    clear = correlated.inside & (correlated.correlation > options.min_correlation)
    hits = np.flatnonzero(clear & (correlated.rival < options.largest_rival * correlated.correlation))
    start = frame.predict(correlated.xy[hits] - pad)
    if not task.chosen:
        task.chosen.append(_choose_band(task, rows[hits], start, correlated.correlation[hits], window))
    name, _ = task.chosen[0]
    band, images = MATCHING_BANDS[name], task.images(name)
    fine = match_patches(*images, points[hits], start, task.jacobian[rows[hits]], _make_lsm_options(task, window))
    lsm_sigma = band.sigma_factor * fine.sigma_px
    similar = (fine.status == DONE) & (fine.correlation > options.min_correlation)
    candidates = np.flatnonzero(similar & (lsm_sigma < options.largest_sigma_px))
    smaller = _make_lsm_options(task, int(window * TILE_MATCH.inner))
    inner = match_patches(*images, points[hits[candidates]], fine.xy[candidates], fine.affine[candidates], smaller)
    change = np.where(inner.status == DONE, np.linalg.norm(inner.xy - fine.xy[candidates], axis=1), np.inf)
    sigma = np.hypot(lsm_sigma[candidates], TILE_MATCH.change_weight * change)
    precise = sigma < options.largest_sigma_px
    matched = candidates[precise]
    return hits[matched], fine.xy[matched], fine.correlation[matched], sigma[precise]


def _make_lsm_options(task: _Task, window: int) -> LsmOptions:
    """Return the options of least-squares matching; windows are enlarged if the second image has larger pixels."""
    half_window = round(window // 2 * float(np.clip(1.0 / task.frame.scale, 1.0, 3.0)))
    return LsmOptions(2 * half_window + 1, reach_px=4.0 * max(1.0, task.frame.scale))


def _choose_band(
    task: _Task, rows: np.ndarray, start: np.ndarray, correlation: np.ndarray, window: int
) -> tuple[str, bool]:
    """Return the band with the smallest scatter of matches across the epipolar lines, tried on some of the matches."""
    clearer = np.argsort(-correlation, kind="stable")[: max(len(correlation) // 2, TILE_MATCH.fewest_seeds)]
    trial = np.sort(clearer[:: max(1, len(clearer) // TILE_MATCH.trial)])
    if len(trial) < TILE_MATCH.fewest_seeds:
        return task.options.bands[0], False
    trial_rows = rows[trial]
    trial_windows = (task.points[trial_rows], start[trial], task.jacobian[trial_rows])
    lsm = _make_lsm_options(task, window)
    trials = {name: match_patches(*task.images(name), *trial_windows, lsm) for name in task.options.bands}
    everywhere = np.all([patches.status == DONE for patches in trials.values()], axis=0)
    if everywhere.sum() < TILE_MATCH.fewest_seeds:
        return task.options.bands[0], False
    scatter = {
        name: _check_consistency(task, task.points[trial_rows[everywhere]], patches.xy[everywhere]).sigma_px
        for name, patches in trials.items()
    }
    return min(scatter, key=lambda name: scatter[name] if np.isfinite(scatter[name]) else np.inf), True


def _check_consistency(task: _Task, points: np.ndarray, second_tile_xy: np.ndarray) -> Consistency:
    frame = task.frame
    xy, geometry = frame.first.to_image(points), frame.geometry
    second_xy = frame.second.to_image(second_tile_xy) - geometry.bias_px
    unit = frame.second.step * max(frame.scale, 1.0)
    return check_rpc_consistency(geometry.first, geometry.second, xy, second_xy, geometry.heights_at(xy), unit_px=unit)


def _select_matches(task: _Task, table: _MatchTable) -> TileMatches:
    """Return the matches consistent with the others, with sigmas scaled by the observed deviations."""
    matched = np.flatnonzero(table.done)
    if len(matched) < SAMPLES.redundant:
        return make_empty_matches()
    frame = task.frame
    fit = _check_consistency(task, task.points[matched], table.xy[matched])
    sigma = table.sigma[matched] * frame.second.step
    normal = np.abs(fit.deviation_px) / sigma
    scale = max(1.0, float(robust_sigma(normal[fit.good]))) if fit.good.any() else 1.0
    accepted = (
        fit.good
        & (normal < ROBUST.rejected * scale)
        & (sigma * scale < task.options.largest_sigma_px * frame.second.step)
    )
    xy = frame.first.to_image(task.points[matched])
    offset = float(np.median(fit.miss.across_px[accepted])) if accepted.any() else 0.0
    # Unit vector across the epipolar lines in the second image, with the sign of `compute_epipolar_deviation`
    points = frame.first.to_tile(xy[:: max(1, len(xy) // 50)])
    direction = np.mean(np.einsum("nij,nj->ni", frame.compute_jacobians(points), frame.parallax(points)[0]), axis=0)
    direction /= max(float(np.linalg.norm(direction)), EPIPOLAR.least_stretch)
    matches = TileMatches(
        first_xy=xy,
        second_xy=frame.second.to_image(table.xy[matched]),
        sigma_px=sigma * scale,
        quality=1.0 / (1.0 + (sigma * scale / (TILE_MATCH.expected_sigma_px * frame.second.step)) ** 2),
        kind=np.full(len(matched), "corner", dtype="U9"),
        height_m=fit.miss.height_m,
        bias_px=np.asarray(frame.geometry.bias_px) + offset * np.array([-direction[1], direction[0]]),
        band=task.chosen[0][0] if task.chosen[0][1] else "",
    )
    return matches.select(accepted)
