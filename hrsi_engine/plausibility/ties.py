"""Consistency of the tie points: test for each pair of images whether the two rays of each point intersect.

Across their epipolar plane, the distance of the two rays of a point is the difference of the RPCs' errors, which is
nearly equal for all points of a pair (y-parallax); along the plane they intersect at the point's height. Points whose
distance differs from the mode of their pair, or whose height is outside the RPCs' range, are wrong. Each pair is tested
with a sample of its points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from ..block.block import Block, Role
from ..foundation.errors import list_ids
from ..foundation.reasons import Level, Reason
from ..foundation.thresholds import EQUALITY, MEMORY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ..ground.geodesy import move_ground
from .accuracy import ACCURACY, SIMULATED, ImageAccuracy
from .control import CONTROL_FIT, StraightRays, compute_sightlines
from .mistakes import PIXEL_MISTAKES, Mistake


@thresholds
class TIE_CHECK:
    """Limits for tie points whose rays do not intersect, by pairs of images."""

    least_slope: float = threshold(
        0.005,
        "m/m",
        "smallest difference in slope of rays with a height: 500 m of relief separate such rays by 2.5 "
        "m; with 0.02 every twentieth pair of correct blocks failed",
        "blocks of adjust_speed of 60 to 90 images, 2026-11-23",
    )
    miss_px: float = threshold(
        4.0, "px", "largest distance of the rays of a correct point, whatever its sigma", SIMULATED
    )
    largest_drift: float = threshold(4e-3, "px/px", "largest relative drift of two RPCs", SIMULATED)
    drift_steps: int = threshold(6, "steps", "iterations of the drift of a pair")
    doubtful_share: float = threshold(0.15, "", "share of wrong measurements that is reported", SIMULATED)
    unusable_share: float = threshold(0.37, "", "share of wrong measurements of unusable tie points", SIMULATED)
    broken_share: float = threshold(
        0.25, "", "share of agreeing points of a pair below which the tie points are unusable", SIMULATED
    )
    cured_ratio: float = threshold(
        3.0, "", "smallest ratio of wrong points before and after the correction of an input error", SIMULATED
    )
    most_suspects: int = threshold(6, "images", "largest number of images tested for input errors of their own")


@dataclass(frozen=True, eq=False)
class PairSample:
    """Sampled tie points, each on one pair of images.

    image : (n, 2) indices of the two images; xy : (n, 2, 2); sigma_px : (n,); pair : (n,) index of the pair of images
    """

    block: Block
    accuracies: Sequence[ImageAccuracy]
    point: np.ndarray
    image: np.ndarray
    xy: np.ndarray
    sigma_px: np.ndarray
    pair: np.ndarray
    height_m: float

    @cached_property
    def starts(self) -> np.ndarray:
        """Row of the first point of each pair of images, ``(pairs,)``."""
        return np.flatnonzero(np.diff(self.pair, prepend=-1))

    @property
    def ends(self) -> np.ndarray:
        """Indices of the two images of each pair, ``(pairs, 2)``."""
        return self.image[self.starts]

    def select(self, is_selected: np.ndarray) -> PairSample:
        """Return the sample of the pairs of a mask ``(pairs,)``, renumbered."""
        rows = is_selected[self.pair]
        number = np.cumsum(is_selected) - 1
        return replace(
            self,
            point=self.point[rows],
            image=self.image[rows],
            xy=self.xy[rows],
            sigma_px=self.sigma_px[rows],
            pair=number[self.pair[rows]],
        )


def sample_pairs(block: Block, accuracies: Sequence[ImageAccuracy]) -> PairSample | None:
    """Return a sample of the tie points of every pair of images; None without tie points."""
    measured = block.measurements
    tie = (block.points.role == Role.TIE)[measured.point]
    first = np.flatnonzero(
        tie[:-1] & (measured.point[1:] == measured.point[:-1]) & (measured.image[1:] != measured.image[:-1])
    )
    if len(first) < SAMPLES.tested:
        return None
    key = measured.image[first].astype(np.int64) * len(block.images) + measured.image[first + 1]
    order = np.argsort(key, kind="stable")
    first, key = first[order], key[order]
    starts = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
    sizes = np.diff(np.r_[starts, len(key)])
    pair = np.repeat(np.arange(len(starts)), sizes)
    per_pair = max(SAMPLES.tested, min(SAMPLES.local, MEMORY.rows // len(starts)))
    # every k-th point of a pair: a point is taken where rank * wanted / size passes the next integer
    rank = np.arange(len(key)) - starts[pair]
    quota = np.minimum(sizes, per_pair)[pair]
    is_sampled = np.floor((rank + 1) * quota / sizes[pair]) > np.floor(rank * quota / sizes[pair])
    rows = first[is_sampled]
    surveyed_heights = block.points.ground[block.known, 2]
    height = surveyed_heights[np.isfinite(surveyed_heights)] if len(surveyed_heights) else np.empty(0)
    middle = float(np.median(height)) if len(height) else float(np.median([i.middle_height_m for i in block.images]))
    return PairSample(
        block=block,
        accuracies=accuracies,
        point=measured.point[rows],
        image=np.column_stack([measured.image[rows], measured.image[rows + 1]]),
        xy=np.stack([measured.xy[rows], measured.xy[rows + 1]], axis=1),
        sigma_px=np.maximum(measured.sigma_px[rows], measured.sigma_px[rows + 1]),
        pair=pair[is_sampled],
        height_m=middle,
    )


@dataclass(frozen=True, eq=False)
class PairConsistency:
    """Result of the intersection test for a sample of pairs.

    wrong : (n,) True for points whose rays do not intersect; share : of these among pairs with enough points
    good : (pairs,) share of each pair's points that agree, NaN for pairs with too few points
    """

    wrong: np.ndarray
    share: float
    good: np.ndarray

    @classmethod
    def from_points(cls, pairs: PairSample, is_wrong: np.ndarray, agreeing_share: np.ndarray) -> PairConsistency:
        """Return the result from the mask of wrong points and the pairs' shares of agreeing points.

        is_wrong : (n,) of the points; agreeing_share : (pairs,), NaN for pairs with too few points
        """
        telling = np.isfinite(agreeing_share)[pairs.pair]
        return cls(is_wrong, float(is_wrong[telling].mean()) if telling.any() else 0.0, agreeing_share)


def check_pairs(
    pairs: PairSample,
    image: np.ndarray | None = None,
    xy: np.ndarray | None = None,
    stretch: float = 1.0,
    shifted: bool = False,
) -> PairConsistency:
    """Test whether the rays of each pair intersect, with the given or other images and coordinates.

    Across the epipolar plane the rays of correct points miss one another by the RPCs' relative bias, equal for all
    points of two images, and a drift; the height of the intersection is within the range of the RPCs.

    image, xy : (n, 2) indices of other images, and (n, 2, 2) other coordinates, for a test of input errors
    stretch : scale of corrected coordinates: below 1 it reduces the tolerance
    shifted : True if images may be displaced by any distance, as is a crop whose origin was lost
    """
    image = pairs.image if image is None else image
    xy = pairs.xy if xy is None else xy
    images = pairs.block.images
    flat = compute_sightlines(images, image.ravel(), xy.reshape(-1, 2))
    climb = pairs.height_m - flat.ground[:, 2]
    step = np.column_stack([flat.slope * climb[:, None], climb])
    at_height = StraightRays(move_ground(flat.ground, step), flat.slope)
    other_ends = at_height.ground.reshape(-1, 2, 3)[:, ::-1].reshape(-1, 3)  # the two points of a pair are adjacent
    separation = at_height.distance_m(other_ends)[::2]
    slope = flat.slope[::2] - flat.slope[1::2]
    length = np.hypot(*slope.T)
    steep = np.maximum(length, TIE_CHECK.least_slope)
    starts = pairs.starts
    sizes = np.diff(np.r_[starts, len(pairs.pair)])
    # decided for all points of a pair together, so that their distances have one direction
    weak = (
        np.repeat(~(np.fmin.reduceat(length, starts) > TIE_CHECK.least_slope), sizes)
        if len(starts)
        else length > TIE_CHECK.least_slope
    )
    unit = np.where(weak[:, None], [0.0, 1.0], slope / steep[:, None])
    across = unit[:, 0] * separation[:, 1] - unit[:, 1] * separation[:, 0]
    height = pairs.height_m - np.where(weak, 0.0, np.sum(separation * unit, axis=1) / steep)
    figures = np.array([[a.gsd_m, a.sigma_m] for a in pairs.accuracies])[image]
    gsd, sigma = figures[:, :, 0].max(axis=1), np.hypot(*figures[:, :, 1].T)
    reach = np.array([np.hypot(*one.half_size_px) for one in images])[image].max(axis=1)
    miss_px = np.maximum(SIGNIFICANCE.certain * pairs.sigma_px, ACCURACY.usual_drift * reach)
    tolerance = min(stretch, 1.0) * gsd * np.maximum(TIE_CHECK.miss_px, miss_px)
    low, high = np.array([one.rpc.height_range for one in images])[image].transpose(2, 0, 1)
    spare = 0.5 * (high - low).max(axis=1) + 4.0 * sigma / steep
    possible = weak | ((height > low.min(axis=1) - spare) & (height < high.max(axis=1) + spare))
    is_wrong = ~np.isfinite(across) if shifted else ~possible | ~np.isfinite(across)
    bulk = _compute_modes(across, tolerance, starts, sizes)
    deviation = across - np.repeat(bulk, sizes)
    deviating = np.add.reduceat(np.abs(deviation) > tolerance, starts, dtype=np.int64) if len(sizes) else sizes
    for number in np.flatnonzero(deviating / sizes > EQUALITY.negligible).tolist():
        start = starts[number]
        rows = slice(start, start + sizes[number])
        deviation[rows] = _remove_drift(
            deviation[rows], xy[rows, 0], tolerance[rows], TIE_CHECK.largest_drift * gsd[start]
        )
    is_wrong |= np.abs(deviation) > tolerance
    if not shifted:
        is_wrong |= np.repeat(np.abs(bulk) > CONTROL_FIT.agreeing_sigmas * sigma[starts], sizes)
    share = np.add.reduceat(is_wrong, starts, dtype=np.int64) / sizes if len(sizes) else np.empty(0)
    return PairConsistency.from_points(pairs, is_wrong, np.where(sizes >= SAMPLES.tested, 1.0 - share, np.nan))


def _remove_drift(away_m: np.ndarray, xy: np.ndarray, tolerance_m: np.ndarray, limit: float) -> np.ndarray:
    """Return the ray distances of a pair's points without RPC drift, if a drift explains nearly all of them.

    A drift is linear in the position. Wrong points do not follow one.

    away_m, tolerance_m : (n,) distances of the rays, and the largest of correct points; xy : (n, 2) px
    limit : largest drift, m/px
    """
    design = np.column_stack([np.ones(len(xy)), xy - np.median(xy, axis=0)])
    left, fits = away_m, np.abs(away_m) <= tolerance_m
    for _ in range(TIE_CHECK.drift_steps):
        if fits.sum() < SAMPLES.tested:
            return away_m
        solved, _, rank, _ = np.linalg.lstsq(design[fits], away_m[fits], rcond=None)
        if rank < design.shape[1] or np.hypot(*solved[1:]) > limit:
            return away_m
        left = away_m - design @ solved
        fits = np.abs(left) <= tolerance_m
    return left if fits.mean() >= 1.0 - EQUALITY.negligible else away_m


def _compute_modes(values: np.ndarray, tolerance: np.ndarray, starts: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the centre ``(pairs,)`` of each pair's values; 0 where none is finite.

    It is that of the interval, twice the smallest tolerance wide, that contains most of them: jitter spreads the values
    of correct points evenly. Pairs with the same numbers of values are computed together, for speed.

    values, tolerance : (n,) m; starts, sizes : (pairs,) first value of each pair, and their number
    """
    modes = np.zeros(len(starts))
    ordered = np.where(np.isfinite(values), values, np.inf)
    for size in np.unique(sizes).tolist():  # values that are not finite come last
        of_same_size = np.flatnonzero(sizes == size)
        rows = starts[of_same_size, None] + np.arange(size)
        of_size, width = np.sort(ordered[rows], axis=1), 2.0 * tolerance[rows].min(axis=1)
        inside = of_size[:, None, :] <= (of_size + width[:, None])[:, :, None]
        count = np.where(np.isfinite(of_size), inside.sum(axis=2) - np.arange(size), 0)
        first, row_index = count.argmax(axis=1), np.arange(len(of_same_size))
        last = np.minimum(first + np.maximum(count[row_index, first], 1) - 1, size - 1)
        middle = 0.5 * (of_size[row_index, first] + of_size[row_index, last])
        modes[of_same_size] = np.where(np.isfinite(middle), middle, 0.0)
    return modes


def find_tie_reasons(block: Block, accuracies: Sequence[ImageAccuracy]) -> list[Reason]:
    """Return the reason for wrong tie points of a block; empty where the rays of most of them intersect."""
    pairs = sample_pairs(block, accuracies)
    if pairs is None:
        return []
    consistency = check_pairs(pairs)
    failing = np.flatnonzero(consistency.good < EQUALITY.majority)
    share = 1.0 - np.sqrt(1.0 - consistency.share)  # share of measurements: one wrong measurement makes a pair wrong
    if not len(failing) and (share < TIE_CHECK.doubtful_share or consistency.wrong.sum() < SAMPLES.fewest):
        return []
    suspects = _select_suspects(pairs, consistency, failing)
    left = 1.0 - check_pairs(pairs, shifted=True).good[failing]  # the other pairs fit without a shift
    shifted_alike = bool(len(failing)) and float(left.mean()) < TIE_CHECK.doubtful_share
    best_mistake = None if shifted_alike else _find_best_mistake(pairs, consistency, suspects)
    if best_mistake is not None:
        (mistake, *rivals), images, cured = best_mistake
        ids = tuple(block.images[index].id for index in images)
        image_text = "" if len(ids) == len(block.images) else f" on image {list_ids(ids)}"
        readings = "; or ".join(reading.what for reading in (mistake, *rivals))
        message = (
            f"tie points{image_text}: {readings}; the rays of {consistency.share:.0%} of them do not intersect, and of "
            f"{cured:.0%} after correction" + (" (surveyed points would show which one)" if rivals else "")
        )
        return [Reason(mistake.code, Level.UNUSABLE, message, mistake.advice, ids)]
    ids = tuple(block.images[index].id for index in _select_common_images(pairs.ends[failing]))
    wrong_ids = tuple(np.unique(block.points.ids[pairs.point[consistency.wrong]]).tolist())
    unusable = share >= TIE_CHECK.unusable_share or bool((consistency.good < TIE_CHECK.broken_share).any())
    message = (
        f"about {share:.0%} of the measurements of tie points are wrong: their rays do not intersect"
        + (f", mostly those of {list_ids(ids)}" if 0 < len(ids) < len(block.images) else "")
        + (
            "; their distances are equal, as for a crop of unknown origin or an RPC of another image"
            if shifted_alike
            else ""
        )
    )
    advice = (
        "check that the tie points belong to these images, and check columns and ids of their file; or search new tie "
        "points"
    )
    return [Reason("ties-wrong", Level.UNUSABLE if unusable else Level.DOUBTFUL, message, advice, ids, wrong_ids)]


def _select_common_images(ends: np.ndarray) -> list[int]:
    """Return the fewest images common to failing pairs ``(k, 2)``; both images of a pair without a common one."""
    blamed: list[int] = []
    ends = np.unique(np.sort(ends, axis=1), axis=0)
    while len(ends):
        count = np.bincount(ends.ravel())
        worst = int(count.argmax())
        if count[worst] == 1:
            return sorted([*blamed, *ends.ravel().tolist()])
        blamed.append(worst)
        ends = ends[(ends != worst).all(axis=1)]
    return sorted(blamed)


def _select_suspects(pairs: PairSample, consistency: PairConsistency, failing: np.ndarray) -> np.ndarray:
    """Return the images at least half of whose pairs fail, the worst first (at most `TIE_CHECK.most_suspects`)."""
    ends, count = pairs.ends, len(pairs.block.images)
    telling = np.isfinite(consistency.good)
    pair_count = np.bincount(ends[telling].ravel(), minlength=count)
    failed = np.bincount(ends[failing].ravel(), minlength=count)
    suspects = np.flatnonzero(failed >= np.maximum(0.5 * pair_count, 1))
    return suspects[np.argsort(-failed[suspects] / pair_count[suspects], kind="stable")][: TIE_CHECK.most_suspects]


def _find_best_mistake(
    pairs: PairSample, consistency: PairConsistency, suspects: np.ndarray
) -> tuple[list[Mistake], np.ndarray, float] | None:
    """Return the input error that explains the failing pairs, its images, and the share of points still wrong then.

    It is followed by those with the same code that explain the pairs equally well: tie points of one strip do not
    distinguish an image from its mirror image. The likelier is the first. None if no error, or more than one kind,
    explains them.

    suspects : (k,) indices of images
    """
    best: dict[str, tuple[float, Mistake, np.ndarray]] = {}
    for mistake, images, share in _iterate_hypotheses(pairs, consistency, suspects):
        cured = (consistency.share - share) * len(pairs.pair) >= SAMPLES.fewest
        cured = cured and share * TIE_CHECK.cured_ratio < consistency.share
        if share < TIE_CHECK.doubtful_share and cured and (mistake.what not in best or share < best[mistake.what][0]):
            best[mistake.what] = share, mistake, images
    if not best:
        return None
    smallest = min(share for share, _, _ in best.values())
    candidates = [entry for entry in best.values() if entry[0] < 2.0 * smallest + 0.03]
    if len({mistake.code for _, mistake, _ in candidates}) > 1:
        return None
    _, _, images = min(candidates, key=lambda entry: entry[0])
    rivals = [(share, mistake) for share, mistake, touched in candidates if np.array_equal(touched, images)]
    return [mistake for _, mistake in rivals], images, rivals[0][0]


def _iterate_hypotheses(
    pairs: PairSample, consistency: PairConsistency, suspects: np.ndarray
) -> Iterator[tuple[Mistake, np.ndarray, float]]:
    """Yield every input error with the images on which it is corrected, and the share of points still wrong then.

    An error on all images makes many pairs fail; one on few of the ``suspects (k,)`` is tested in the pairs of these
    only.
    """
    if consistency.share >= TIE_CHECK.doubtful_share:
        all_images = np.arange(len(pairs.block.images))
        for mistake, undo in PIXEL_MISTAKES:
            yield (
                mistake,
                all_images,
                check_pairs(pairs, xy=_undo_pixel_mistake(pairs, undo, all_images), stretch=mistake.length).share,
            )
    for images in (suspects[k : k + 1] for k in range(len(suspects))):
        size = np.isin(pairs.ends, images).any(axis=1)
        sample = pairs.select(size)
        for mistake, undo in PIXEL_MISTAKES:
            read = check_pairs(sample, xy=_undo_pixel_mistake(sample, undo, images), stretch=mistake.length)
            yield mistake, images, _compute_share_with(pairs, consistency, size, read)
    for size in (2, 3):
        for group in combinations(suspects.tolist(), size):
            for owners in ((group[1:] + group[:1]),) if size == 2 else (group[1:] + group[:1], group[2:] + group[:2]):
                names = [pairs.block.images[index].id for index in group]
                owner_ids = [pairs.block.images[index].id for index in owners]
                text = ", ".join(f"{a} are of {b}" for a, b in zip(names, owner_ids, strict=True))
                mistake = Mistake(
                    "ids-permuted",
                    f"image ids of measurements are exchanged: those on {text}",
                    "correct the field 'image', or exchange the RPCs",
                )
                touched = np.isin(pairs.ends, group).any(axis=1)
                sample = pairs.select(touched)
                image = sample.image.copy()
                for label, owner in zip(group, owners, strict=True):
                    image[sample.image == label] = owner
                yield (
                    mistake,
                    np.array(group),
                    _compute_share_with(pairs, consistency, touched, check_pairs(sample, image=image)),
                )


def _compute_share_with(pairs: PairSample, given: PairConsistency, some: np.ndarray, read: PairConsistency) -> float:
    """Return the share of wrong points if the pairs of mask ``some`` have the result ``read``, the others ``given``."""
    wrong, good = given.wrong.copy(), given.good.copy()
    wrong[some[pairs.pair]], good[some] = read.wrong, read.good
    return PairConsistency.from_points(pairs, wrong, good).share


def _undo_pixel_mistake(pairs: PairSample, undo: Callable[..., np.ndarray], images: np.ndarray) -> np.ndarray:
    """Return the image coordinates ``(n, 2, 2)`` with an input error on ``images`` corrected by ``undo(xy, image)``."""
    xy = pairs.xy.reshape(-1, 2).copy()
    rows = np.flatnonzero(np.isin(pairs.image.ravel(), images))
    index = pairs.image.ravel()[rows]
    order = np.argsort(index, kind="stable")
    rows, index = rows[order], index[order]
    for image_rows in np.split(rows, np.flatnonzero(np.diff(index)) + 1) if len(rows) else ():
        xy[image_rows] = undo(xy[image_rows], pairs.block.images[pairs.image.ravel()[image_rows[0]]])
    return xy.reshape(pairs.xy.shape)
