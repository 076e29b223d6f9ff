"""Two windows matched by control networks, without knowing anything of cameras, position, rotation or scale.

Where the scale is unknown, SIFT features (Lowe 2004) that pass the ratio test vote for one similarity by random samples
(RANSAC; Fischler and Bolles 1981). Its scale is that of the networks searched. Where those find no root, as in small
windows with little overlap and few common super points, a clear vote gives the place where the network begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from ...block.block import Raster
from ...foundation.errors import InputError
from ...foundation.pixel_filters import reduce_by_area, reduce_mask
from ...foundation.progress import Progress, advance, silent, stage
from ...foundation.robust_scale import robust_sigma
from ...foundation.thresholds import threshold, thresholds
from ...measurement.interest_points.options import CANDIDATE_QUALITY, CentreOptions
from ...measurement.interest_points.windows import Area
from ...measurement.tile_matching.epipolar import match_descriptors
from ...measurement.tile_matching.features import compute_root_sift, detect_sift_features
from ..interest_points.detectors import clip_to_image
from ..interest_points.options import DETECTOR_SETS, CornerOptions, DetectionOptions
from .growth import GrowthOptions, GrowthStage, NodePositions, grow_network, refine_matches
from .leaves import NETWORK_PAIRS, make_tolerance
from .options import ControlNetworkOptions
from .seeding import SeedOptions, find_seeds
from .super_points import AMBIGUOUS, FOUND, NO_MATCH, SuperPointMatch
from .views import NetworkWindow, read_network_window


@thresholds
class CONTROL_NETWORK:
    """Stages of the growth of a network, and size of the windows."""

    steep_deg: float = threshold(30.0, "°", "slope of the ground in later stages")
    near_px: float = threshold(60.0, "px", "largest distance from a node in the first stages")
    far_px: float = threshold(150.0, "px", "… and in the last stage, across gaps")
    reduction_ratio: float = threshold(1.25, "", "ratio of pixel sizes at which the finer window is reduced")
    equal_scales: tuple[float, float] = threshold((1.0, 1.0), "", "range of scales tried first")
    largest_window_px: int = threshold(8192 * 8192, "px", "largest area of a window (memory)")


@dataclass(frozen=True, eq=False)
class ControlNetworkMatch:
    """Correspondences of two images, and how sure they are.

    Parameters
    ----------
    status : str
        ``found``, ``ambiguous`` or ``no match``.
    message : str
        What that means here, empty where found.
    positions : NodePositions
        Sample and line in both images with their sigmas and residuals.
    kind : (k,) ndarray of str
        Of the interest points.
    generation : (k,) ndarray of int
        0 for the root, 1 for its leaves, then one more than the father's.
    father : (k,) ndarray of int
        Row of the father, or -1.
    network : int
        Correspondences of the super-point match (0 without).
    runner_up : int
        … of its nearest rival.
    points : tuple of int
        Interest points in both windows.
    affine : (2, 3) ndarray
        Of the second image's position by the first's.
    """

    status: str
    message: str
    positions: NodePositions
    kind: np.ndarray
    generation: np.ndarray
    father: np.ndarray
    network: int
    runner_up: int
    points: tuple[int, int]
    affine: np.ndarray

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def rotation_deg(self) -> float:
        """Turn from the first image to the second, from sample towards line; NaN without a match."""
        (a, b), (c, d) = self.affine[:, :2]
        return float(np.degrees(np.arctan2(c - b, a + d)))

    @property
    def scale(self) -> float:
        """Pixels of the second image for one of the first; NaN without a match."""
        (a, b), (c, d) = self.affine[:, :2]
        return float(np.sqrt(abs(a * d - b * c)))


def match_windows(
    first: Raster,
    second: Raster,
    options: ControlNetworkOptions | None = None,
    first_window: Area | None = None,
    second_window: Area | None = None,
    progress: Progress = silent,
) -> ControlNetworkMatch:
    """Match two images, or a window of each.

    Windows that cannot be matched are a status of the result.

    Parameters
    ----------
    first, second : Raster
        The images' pixels.
    options : ControlNetworkOptions, optional
        How they are matched.
    first_window, second_window : Area, optional
        The parts to match; by default all.
    progress : Progress
        Callback; False cancels.

    Returns
    -------
    ControlNetworkMatch
        The correspondences, and how sure they are.

    Raises
    ------
    InputError
        An unknown detector, or windows without pixels or too large for the memory.
    Cancelled
        When ``progress`` asks to stop.
    """
    options = options or ControlNetworkOptions()
    if options.detector not in DETECTOR_SETS:
        raise InputError(f"no interest points {options.detector!r}: choose one of {', '.join(DETECTOR_SETS)}")
    areas = clip_to_image(first_window, first), clip_to_image(second_window, second)
    if options.scales is not None:
        return _match_at_scale(first, second, options, FeatureVote(options.scales), areas, progress)
    # Features of reduced windows give most scales; else equal scales are tried first, then features at full resolution
    vote, equal = vote_by_features(first, second, *areas), FeatureVote(CONTROL_NETWORK.equal_scales)
    is_known = vote.scales != SCALE.unknown_scales and not _votes_equal(vote)
    if not is_known:
        equal = equal._replace(affine=vote.affine)
    match = _match_at_scale(first, second, options, vote if is_known else equal, areas, stage(progress, 0.0, 0.5))
    if match.status == FOUND:
        return match
    votes_equal = _votes_equal(vote)
    vote = vote_by_features(first, second, *areas, most_px=SCALE.look_px)
    if vote.affine is None:
        if votes_equal or (not is_known and _votes_equal(vote)):
            return match  # the scale was right: another one would not help
        if is_known:
            vote = equal
    second_match = _match_at_scale(first, second, options, vote, areas, stage(progress, 0.5, 1.0))
    # Where features give no scale, an ambiguous match at one of those tried is no statement on the windows
    is_voted = vote.scales not in (SCALE.unknown_scales, CONTROL_NETWORK.equal_scales)
    return second_match if second_match.status == FOUND or is_voted else match


def _votes_equal(vote: FeatureVote) -> bool:
    """Return whether features vote for equal scales."""
    return vote.scales != SCALE.unknown_scales and vote.scales[0] <= 1.0 <= vote.scales[1]


def _match_at_scale(
    first: Raster,
    second: Raster,
    options: ControlNetworkOptions,
    vote: FeatureVote,
    areas: tuple[Area, Area],
    progress: Progress,
) -> ControlNetworkMatch:
    """Match two windows whose scale is known, or lies in a range."""
    scale_range = vote.scales
    usual = float(np.sqrt(scale_range[0] * scale_range[1]))
    reductions = [max(r, 1.0) if r >= CONTROL_NETWORK.reduction_ratio else 1.0 for r in (1.0 / usual, usual)]
    views = [
        _open_window(raster, window, options, reduction, stage(progress, 0.15 * k, 0.15 * (k + 1)))
        for k, (raster, window, reduction) in enumerate(zip((first, second), areas, reductions, strict=True))
    ]
    between = reductions[0] / reductions[1]
    scales = scale_range[0] * between, scale_range[1] * between
    similarity = None
    if vote.affine is not None:  # as a map (2, 3) of the windows' own positions
        corners = views[0].to_image(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        partner_corners = corners @ vote.affine[:, :2].T + vote.affine[:, 2]
        origin, right, down = (partner_corners - views[1].origin + 0.5) / views[1].reduction - 0.5
        similarity = np.column_stack([right - origin, down - origin, origin])
    return match_views(views[0], views[1], options, scales, stage(progress, 0.3, 1.0), similarity)


def _open_window(
    raster: Raster, area: Area, options: ControlNetworkOptions, reduction: float, progress: Progress
) -> NetworkWindow:
    """Return a window with its interest points, reduced; raises `InputError` where it is too large for the memory."""
    samples, lines = area.right - area.left, area.bottom - area.top
    if samples * lines > CONTROL_NETWORK.largest_window_px:
        raise InputError(
            f"a window of {samples} x {lines} pixels is too large to match at once: "
            "choose windows of at most 8192 x 8192, or use tie-points for whole scenes with RPCs"
        )
    corners = CornerOptions(radius_px=options.radius_px, interest_share=options.share)
    centres = CentreOptions(quality=CANDIDATE_QUALITY)
    settings = DetectionOptions(corners, centres, mask_saturated=options.mask_saturated, threads=options.threads)
    return read_network_window(raster, area, DETECTOR_SETS[options.detector], settings, reduction, progress)


def match_views(
    first: NetworkWindow,
    second: NetworkWindow,
    options: ControlNetworkOptions,
    scales: tuple[float, float] = (1.0, 1.0),
    progress: Progress = silent,
    similarity: np.ndarray | None = None,
) -> ControlNetworkMatch:
    """Match two windows with their interest points; ``scales`` are those between the windows' own pixels.

    ``similarity (2, 3)`` is where features put the points of the first window, if they determine it.
    """
    radius_px = options.radius_px + 1.0  # a maximum within 7 x 7 pixels is one of radius 3
    gentle, steep = (
        make_tolerance(radius_px, (options.incidence_deg, options.incidence_deg), slope_deg)
        for slope_deg in (options.max_slope_deg, max(CONTROL_NETWORK.steep_deg, options.max_slope_deg))
    )
    # Scales so close that the tolerances take what lies between
    lowest, highest = scales
    steps = int(np.ceil(np.log(highest / lowest) / np.log1p(2.0 * gentle.gradient))) if highest > lowest else 0
    tried = tuple(np.geomspace(lowest, highest, steps + 1).tolist())
    beginning = SeedOptions(gentle, options.reach_px, tried, options.correlation)
    # The network grows on gentle ground, then up and down steep ground, then across gaps
    near_px, far_px = CONTROL_NETWORK.near_px, CONTROL_NETWORK.far_px
    stages = GrowthStage(gentle, near_px), GrowthStage(steep, near_px), GrowthStage(steep, far_px)
    growth = GrowthOptions(stages, options.correlation, options.consistency_px)
    attempts: list[SuperPointMatch] = []
    best: ControlNetworkMatch | None = None
    for seed in find_seeds(first, second, beginning, attempts, stage(progress, 0.0, 0.4), similarity):
        network = grow_network(seed.network, first, second, growth, stage(progress, 0.4, 0.9))
        advance(progress, 0.9, "least-squares matching")
        refined, positions = refine_matches(network, first, second, options.consistency_px)
        if not len(refined) or robust_sigma(positions.epipolar_px) > seed.largest_spread_px:
            continue
        first_xy, second_xy = first.to_image(positions.first), second.to_image(positions.second)
        scaled = {
            "first": first_xy,
            "second": second_xy,
            "sigma_px": positions.sigma_px * second.reduction,
            "residual_px": positions.residual_px * second.reduction,
            "epipolar_px": positions.epipolar_px * second.reduction,
        }
        design = np.column_stack([first_xy, np.ones(len(first_xy))])
        affine = np.linalg.lstsq(design, second_xy, rcond=None)[0].T if len(first_xy) >= 3 else np.full((2, 3), np.nan)
        candidate = ControlNetworkMatch(
            FOUND,
            "",
            positions._replace(**scaled),
            kind=first.points.kind[refined.first_row],
            generation=refined.generation,
            father=refined.father,
            network=seed.hypothesis.count,
            runner_up=seed.runner_up,
            points=(len(first.xy), len(second.xy)),
            affine=affine,
        )
        if best is None or len(candidate) > len(best):
            best = candidate
        if len(best) >= options.least:
            advance(progress, 1.0, f"{len(best)} correspondences")
            return best
    return _make_failure(first, second, attempts, 0 if best is None else len(best))


def _make_failure(
    first: NetworkWindow, second: NetworkWindow, attempts: list[SuperPointMatch], largest_count: int
) -> ControlNetworkMatch:
    """Return the result without correspondences, and why."""
    ambiguous = [(match.best.count, match.runner_up) for match in attempts if match.status == AMBIGUOUS and match.best]
    nothing = np.empty((0, 2))
    empty = NodePositions(nothing, nothing, *(np.empty(0) for _ in range(4)))
    status, network, runner_up = NO_MATCH, 0, 0
    count_note = f" ({largest_count} correspondences are too few)" if largest_count else ""
    message = f"no common control network was found{count_note}: check that both windows show the same place at `scale`"
    for name, view in (("second", second), ("first", first)):
        if len(view.xy) < 20:
            message = f"the {name} window has {len(view.xy)} interest points only: choose one with more texture"
    if ambiguous and not largest_count:
        status, (network, runner_up) = AMBIGUOUS, max(ambiguous, key=itemgetter(0))
        message = (
            f"the texture repeats: {network} super points fit in one place, {runner_up} in another; "
            "choose larger windows or others with something that is there once"
        )
    return ControlNetworkMatch(
        status,
        message,
        empty,
        kind=np.empty(0, dtype="U9"),
        generation=np.empty(0, dtype=int),
        father=np.empty(0, dtype=int),
        network=network,
        runner_up=runner_up,
        points=(len(first.xy), len(second.xy)),
        affine=np.full((2, 3), np.nan),
    )


@thresholds
class SCALE:
    """Limits for the similarity transformation of two windows from features."""

    features: int = threshold(6000, "features", "largest number of features of a window")
    ratio: float = threshold(
        0.85, "", "largest ratio of the two nearest descriptors, as most votes reject wrong ones", "Lowe 2004: 0.8"
    )
    vote_px: float = threshold(4.0, "px", "largest residual of a pair with a vote, relief included")
    samples: int = threshold(5000, "samples", "random samples of two pairs of features")
    shortest_base_px: float = threshold(20.0, "px", "smallest distance of the two points of a sample")
    fewest_votes: int = threshold(10, "pairs", "fewest votes that determine the scale", NETWORK_PAIRS)
    clear_votes: int = threshold(15, "pairs", "fewest votes for a network (by chance at most 4)", NETWORK_PAIRS)
    unknown_scales: tuple[float, float] = threshold((0.6, 1.7), "", "range of scales if features do not determine it")
    margin: float = threshold(1.05, "", "margin of the scale: factor to both sides")
    glance_px: int = threshold(500_000, "px", "area of a window in the first search for features")
    look_px: int = threshold(16_000_000, "px", "… and in the second")


class FeatureVote(NamedTuple):
    """Similarity that the features of two windows vote for.

    scales : range of pixels of the second window for one of the first, in which the true scale lies
    affine : (2, 3) similarity from positions of the first image to those of the second; None without a clear vote
    """

    scales: tuple[float, float] = SCALE.unknown_scales
    affine: np.ndarray | None = None


def vote_by_features(
    first: Raster, second: Raster, first_window: Area, second_window: Area, most_px: int = SCALE.glance_px
) -> FeatureVote:
    """Return the similarity that features vote for; `SCALE.unknown_scales` where they do not agree.

    Both windows are reduced equally until the larger has at most ``most_px`` pixels: that is quick, and enough where
    they overlap well.
    """
    areas = first_window, second_window
    largest = max((area.right - area.left) * (area.bottom - area.top) for area in areas)
    reduction = max(float(np.sqrt(largest / most_px)), 1.0)
    features = []
    for raster, area in zip((first, second), areas, strict=True):
        grey, valid = raster.read(area.left, area.top, area.right - area.left, area.bottom - area.top)
        if reduction > 1.0:
            size = int(grey.shape[1] / reduction), int(grey.shape[0] / reduction)
            grey, valid = reduce_by_area(np.asarray(grey, np.float32), size), reduce_mask(valid, size)
        features.append(detect_sift_features(grey, valid, SCALE.features))
    first_features, second_features = features
    i, j = match_descriptors(
        compute_root_sift(first_features.descriptors), compute_root_sift(second_features.descriptors), SCALE.ratio
    )
    common = _find_common_similarity(first_features.xy[i], second_features.xy[j])
    if common is None:
        return FeatureVote()
    matrix, shift, votes = common
    scale = float(np.hypot(*matrix[:, 0]))
    # From the reduced windows' pixels to those of the images
    origins = [np.array([area.left, area.top], dtype=np.float64) for area in areas]
    shift = origins[1] - 0.5 + reduction * (shift + 0.5 - 0.5 * matrix.sum(axis=1)) - matrix @ (origins[0] - 0.5)
    return FeatureVote(
        (scale / SCALE.margin, scale * SCALE.margin),
        np.column_stack([matrix, shift]) if votes >= SCALE.clear_votes else None,
    )


def _find_common_similarity(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray, int] | None:
    """Return matrix ``(2, 2)``, shift ``(2,)`` and votes of the similarity that most pairs ``(n, 2)`` agree with.

    None where too few do. A similarity is ``w = a z + b`` in complex numbers; two pairs are a sample.
    """
    if len(first) < SCALE.fewest_votes:
        return None
    z, w = (np.ascontiguousarray(xy, dtype=np.float64).view(np.complex128)[:, 0] for xy in (first, second))
    index, partner = np.random.default_rng(1).integers(0, len(z), (2, SCALE.samples))
    is_distant = np.abs(z[index] - z[partner]) > SCALE.shortest_base_px
    index, partner = index[is_distant], partner[is_distant]
    a = (w[index] - w[partner]) / (z[index] - z[partner])
    b = w[index] - a * z[index]
    votes = [int(np.sum(np.abs(w - (a_k * z + b_k)) <= SCALE.vote_px)) for a_k, b_k in zip(a, b, strict=True)]
    if not votes or max(votes) < SCALE.fewest_votes:
        return None
    best = int(np.argmax(votes))
    agree = np.abs(w - (a[best] * z + b[best])) <= SCALE.vote_px
    (a_all, b_all), *_ = np.linalg.lstsq(np.column_stack([z[agree], np.ones(max(votes))]), w[agree], rcond=None)
    matrix = np.array([[a_all.real, -a_all.imag], [a_all.imag, a_all.real]])
    return matrix, np.array([b_all.real, b_all.imag]), max(votes)
