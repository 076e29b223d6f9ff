"""Ground control from an orthoimage: places in it, measured in raw images with sub-pixel accuracy.

A place is a textured spot of the orthoimage, with the position from the orthoimage and the height from the DEM; the
same places are used for all images, so that a place in several images also connects them. For each image

1. the bias of the RPC is searched, coarse to fine, by correlating the gradient directions of the image (or of parts of
   a large one) with the prediction from orthoimage, RPC and DEM; the range is increased until there is a distinct peak;
2. every place is searched near its position by RPC and bias, first by gradient directions to a pixel, then by
   least-squares matching of grey values with sub-pixel accuracy;
3. matches that deviate from an affine bias of the image are rejected, and the number of others must be significant.

Places are the spots with most texture in the cells of a grid over the images' ground. The affine bias of an image is
estimated robustly from their offsets, most of which may be false: the densest cluster of the offsets is the initial
value of an affine function with Tukey's weights. It is significant if the number of agreeing offsets is much larger
than expected for matches at random positions in their search windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special  # not scipy.stats, which takes a quarter of a second to load

from ...block.block import Image
from ...block.orthoimage import Orthoimage
from ...foundation.pixel_filters import BLUR, SCHARR, blur, box_mean, compute_smaller_eigenvalue, erode, slopes
from ...foundation.progress import Progress, advance, silent
from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import EQUALITY, GRIDS, ITERATIONS, MEMORY, SAMPLES, threshold, thresholds
from ...foundation.workers.scheduling import open_calls
from ...surface.dem import HeightSurface, Status, intersect_surface, surface_heights
from ..tile_matching.options import TILE_MATCH
from ..window_matching.correlation import compute_orientation_field, correlate_orientations, find_correlation_peak
from ..window_matching.least_squares_matching import match_patches
from ..window_matching.windows import DONE, MATCHING, LsmOptions, MatchImage
from .options import ReferenceOptions
from .predicted_patches import BIAS, ImageBias, predict_patch, read_means, read_patch, search_bias


@thresholds
class REFERENCE_MATCHES:
    """Conditions for matching a reference with an image, and for the agreement of offsets with an affine bias."""

    chance_log10: float = threshold(-6.0, "log10", "largest probability of a chance agreement of offsets")
    agreement: float = threshold(2.0, "working px", "tolerance of agreeing offsets: error of the DEM")
    direction_sigma: float = threshold(0.4, "working px", "sigma of a correlation peak without least-squares matching")
    correlation: float = threshold(0.5, "", "smallest correlation of accepted least-squares matching")
    lsm_reach: float = threshold(1.5, "working px", "largest shift by least-squares matching")


@dataclass(frozen=True, eq=False)
class ImageControl:
    """Places found in one image.

    image_id, gsd_m (of its pixels), step (image pixels per working pixel)
    places : (n,) indices into the places; xy, sigma_px : (n, 2), (n,) their positions and standard deviations
    offset_px : (n, 2) found - projected by the RPC; score : (n,) correlation of gradient directions
    used : (n,) mask of the matches that agree; agreement : bias of the image, None if it is not significant
    refusal : the reason in this case; rough_bias_px : (2,) bias from the search over the image; None without
    """

    image_id: str
    gsd_m: float
    step: float
    places: np.ndarray
    xy: np.ndarray
    sigma_px: np.ndarray
    offset_px: np.ndarray
    score: np.ndarray
    used: np.ndarray
    agreement: Agreement | None
    refusal: str = ""
    rough_bias_px: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class ReferenceControl:
    """Places on the ground and their measurements in images.

    Parameters
    ----------
    ids : (m,) ndarray of str
        Ids of the places.
    ground : (m, 3) ndarray
        Lon, lat in degrees, ellipsoidal height in metres.
    images : tuple of ImageControl
        Measurements in each image.
    """

    ids: np.ndarray
    ground: np.ndarray
    images: tuple[ImageControl, ...]


def match_reference(
    images: Sequence[Image],
    reference: Orthoimage,
    surface: HeightSurface,
    options: ReferenceOptions | None = None,
    progress: Progress = silent,
) -> ReferenceControl:
    """Return the places of an orthoimage that are found in images.

    Parameters
    ----------
    images : sequence of Image
        Images with pixels (`Image.raster`).
    reference : Orthoimage
        The reference.
    surface : HeightSurface
        The terrain.
    options : ReferenceOptions, optional
        Options for finding places.
    progress : Progress
        Callback; False cancels.

    Returns
    -------
    ReferenceControl
        The places, and their measurements in each image.

    Raises
    ------
    Cancelled
        ``progress`` returned False.
    """
    options = options or ReferenceOptions()
    places = choose_places(images, reference, surface, options.points, options.window_px)
    advance(progress, 0.1, f"{len(places)} places in the reference")
    controls = []
    for number, image in enumerate(images):
        controls.append(_match_image(image, reference, surface, places, options))
        advance(progress, 0.1 + 0.9 * (number + 1) / len(images), f"matched {image.id} with the reference")
    width = len(str(len(places)))
    ids = np.array([f"R{number + 1:0{width}d}" for number in range(len(places))], dtype=str)
    return ReferenceControl(ids, places, tuple(controls))


def _match_image(
    image: Image, reference: Orthoimage, surface: HeightSurface, places: np.ndarray, options: ReferenceOptions
) -> ImageControl:
    gsd = float(1.0 / image.rpc.px_per_m(places[:1])[0]) if len(places) else 1.0
    ratio = reference.gsd_m / gsd
    step = ratio if ratio > EQUALITY.size else 1.0
    if not len(places):
        return _refuse_image(image, gsd, step, "it shows no textured window of the reference with a height")
    bias = search_bias(image, reference, surface, gsd, step, options.search_px)
    if bias is None:
        return _refuse_image(
            image,
            gsd,
            step,
            f"it does not match the reference within {options.search_px:g} px of its position by the RPC",
        )
    return _match_places(_Task(image, reference, surface, gsd, step, bias), places, options)


def _refuse_image(
    image: Image, gsd_m: float, step: float, refusal: str, rough_bias_px: np.ndarray | None = None
) -> ImageControl:
    none = np.zeros(0)
    return ImageControl(
        image.id,
        gsd_m,
        step,
        places=none.astype(np.int64),
        xy=np.zeros((0, 2)),
        sigma_px=none,
        offset_px=np.zeros((0, 2)),
        score=none,
        used=none.astype(bool),
        agreement=None,
        refusal=refusal,
        rough_bias_px=rough_bias_px,
    )


@dataclass(frozen=True, eq=False)
class _Task:
    """An image to be matched: the size of its pixels, the resolution, and its approximate bias."""

    image: Image
    reference: Orthoimage
    surface: HeightSurface
    gsd_m: float
    step: float
    bias: ImageBias


class _Match(NamedTuple):
    xy: np.ndarray
    sigma_px: float
    score: float


def _match_places(task: _Task, places: np.ndarray, options: ReferenceOptions) -> ImageControl:
    projected = task.image.rpc.project(places)
    expected = projected + task.bias.offset_px
    margin = task.step * (options.window_px // 2 + 1)
    rows = np.flatnonzero(np.all((expected > margin) & (expected < np.array(task.image.size) - 1.0 - margin), axis=1))
    with open_calls(threads=options.threads) as calls:
        matches = list(calls.answers(lambda row: _match_place(task, expected[row], options), rows))
    successful = [match for match in matches if match is not None]
    rows = rows[[match is not None for match in matches]]
    if not rows.size:
        refusal = "no window of the reference was found in it"
        return _refuse_image(task.image, task.gsd_m, task.step, refusal, task.bias.offset_px)
    xy = np.array([match.xy for match in successful])
    sigma = np.array([match.sigma_px for match in successful])
    score = np.array([match.score for match in successful])
    offset = xy - projected[rows]
    agreement = find_agreement(
        xy,
        offset,
        task.image.centre_px,
        task.image.half_size_px,
        task.step * options.reach_px,
        REFERENCE_MATCHES.agreement * task.step,
    )
    refusal = ""
    if agreement is None or agreement.chance_log10 > REFERENCE_MATCHES.chance_log10:
        refusal = f"{len(rows)} windows match the reference, but with different shifts: it may show another area"
        agreement = None
    agreeing = np.zeros(len(rows), dtype=bool) if agreement is None else agreement.agreeing
    return ImageControl(
        task.image.id,
        task.gsd_m,
        task.step,
        places=rows,
        xy=xy,
        sigma_px=sigma,
        offset_px=offset,
        score=score,
        used=agreeing,
        agreement=agreement,
        refusal=refusal,
        rough_bias_px=task.bias.offset_px,
    )


def _match_place(task: _Task, expected: np.ndarray, options: ReferenceOptions) -> _Match | None:
    """Return the measurement of a place near its expected position ``(2,)``; None if it is not found."""
    half, reach = options.window_px // 2, options.reach_px
    side = 2 * half + 1
    origin = expected - task.step * (half + MATCHING.edge_px)
    template = predict_patch(
        task.image,
        task.reference,
        task.surface,
        origin=origin,
        shape=(side + 2 * MATCHING.edge_px, side + 2 * MATCHING.edge_px),
        step=task.step,
        offset_px=task.bias.offset_px,
        node_px=options.node_px,
        gsd_m=task.gsd_m,
    )
    if template.valid.mean() < 0.9:
        return None
    corner = expected - task.step * (half + reach + MATCHING.edge_px)
    corner = np.round(corner) if task.step == 1.0 else corner
    window = side + 2 * (reach + MATCHING.edge_px)
    search = read_patch(task.image.pixels, corner, (window, window), task.step)
    if not search.valid.any():
        return None
    inner = (slice(MATCHING.edge_px, -MATCHING.edge_px),) * 2
    surface = correlate_orientations(
        compute_orientation_field(template.grey, template.valid)[inner],
        compute_orientation_field(search.grey, search.valid)[inner],
    )
    peak = find_correlation_peak(surface)
    if np.any(peak.shift < 1.0) or np.any(peak.shift > np.array(surface.shape[::-1]) - 2.0):
        return None  # the real peak is outside the search range
    position = peak.shift + MATCHING.edge_px + half  # position of the place's centre in the search window
    # Least-squares matching; if grey values do not correlate, the peak itself with a larger sigma
    middle = half + MATCHING.edge_px
    step = task.step
    settings = LsmOptions(window_px=2 * (middle - MATCHING.edge_px) + 1, reach_px=REFERENCE_MATCHES.lsm_reach)
    first = MatchImage(template.grey, template.valid, BLUR.sigma_px)
    second = MatchImage(search.grey, search.valid, BLUR.sigma_px)
    matched = match_patches(first, second, np.array([[middle, middle]]), position[None], np.eye(2)[None], settings)
    if matched.status[0] == DONE and matched.correlation[0] >= REFERENCE_MATCHES.correlation and matched.gain[0] > 0.0:
        sigma = float(np.hypot(matched.sigma_px[0], EQUALITY.camera_px))
        return _Match(search.origin + step * matched.xy[0], step * sigma, peak.score)
    return _Match(search.origin + step * position, step * REFERENCE_MATCHES.direction_sigma, peak.score)


def choose_places(
    images: Sequence[Image], reference: Orthoimage, surface: HeightSurface, points: int, window_px: int
) -> np.ndarray:
    """Return lon, lat, height ``(m, 3)`` of places, about ``points`` of them in each image."""
    rays = [intersect_surface(image.rpc, image.grid_px(GRIDS.fine, GRIDS.fine), surface) for image in images]
    ground_of_images = [ground[status == Status.FOUND] for ground, status in rays if (status == Status.FOUND).any()]
    if not ground_of_images:
        return np.zeros((0, 3))
    # Areas of the bounding boxes of the images' ground, in pixels of the orthoimage
    extents = [np.ptp(reference.to_pixels(ground[:, :2]), axis=0) for ground in ground_of_images]
    cell = max(float(np.sqrt(min(np.prod(np.maximum(extent, 1.0)) for extent in extents) / points)), 4.0)
    px_per_m = float(images[0].rpc.px_per_m(ground_of_images[0][len(ground_of_images[0]) // 2][None])[0])
    step = max(round(1.0 / px_per_m / reference.gsd_m), 1)
    # Column and row of the cells shown by images; thinned evenly if there are too many
    pixels = np.concatenate([reference.to_pixels(ground[:, :2]) for ground in ground_of_images])
    size = np.array(reference.raster.size)
    inside = np.all((pixels >= 0.0) & (pixels < size), axis=1)
    # Also the cells half a cell away, since rays may be farther apart than cells
    steps = np.array([[x, y] for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)]) * cell
    dense = np.unique(np.floor((pixels[inside][:, None] + steps).reshape(-1, 2) / cell).astype(np.int64), axis=0)
    last = np.floor((size - 1) / cell)
    dense = dense[np.all((dense >= 0) & (dense <= last), axis=1)]
    cells = dense[:: max(len(dense) // MEMORY.rows, 1)]
    spots, texture = [], []
    for column, row in cells:
        spot = _find_best_spot(reference, column * cell, row * cell, cell, step, window_px)
        if spot is not None:
            spots.append(spot[0])
            texture.append(spot[1])
    if not spots:
        return np.zeros((0, 3))
    strong = np.array(texture) > TILE_MATCH.weakest_corner * np.median(texture)
    lonlat = reference.to_lonlat(np.array(spots)[strong])
    ground = np.column_stack([lonlat, surface_heights(surface, lonlat)])
    return ground[np.isfinite(ground[:, 2])]


def _find_best_spot(
    reference: Orthoimage, left: float, top: float, cell: float, step: int, window_px: int
) -> tuple[np.ndarray, float] | None:
    """Return the pixel position of a cell's window with most texture, and the texture; None without texture."""
    looked = int(min(cell / step, BIAS.site))
    margin = window_px // 2 + 2
    side = max(looked, 1) + 2 * margin
    start = np.floor(np.array([left, top]) + 0.5 * cell - 0.5 * step * side).astype(int)
    grey, valid = read_means(reference.raster, int(start[0]), int(start[1]), step * side, step * side, step)
    if not valid.any():
        return None
    # The smaller eigenvalue of the structure tensor over a window around each pixel; 0 if a pixel is invalid. Gradients
    # count by the square root of their length, so that one bright roof does not outweigh a complete field pattern.
    gx, gy = slopes(blur(grey, 1.0), *SCHARR)
    damp = 1.0 / np.maximum(np.sqrt(np.hypot(gx, gy)), 1e-6)
    xx, yy, xy = (box_mean(a * b * damp**2, window_px) for a, b in ((gx, gx), (gy, gy), (gx, gy)))
    smaller_eigenvalue = compute_smaller_eigenvalue(xx, yy, xy)
    is_complete = erode(valid, window_px, outside=False)
    texture = np.where(is_complete, np.maximum(smaller_eigenvalue, 0.0), 0.0)[margin:-margin, margin:-margin]
    row, column = np.unravel_index(int(np.argmax(texture)), texture.shape)
    if texture[row, column] <= 0.0:
        return None
    return start + step * (margin + np.array([column, row])) + (step - 1) / 2.0, float(texture[row, column])


TUKEY = 4.685


@dataclass(frozen=True, eq=False)
class Agreement:
    """An affine bias and the offsets that agree with it.

    coefficients : (2, 3): per axis the constant and the change by normalised sample and line
    centre, half_size : of the normalisation of sample and line, ``(2,)`` each
    residual_px : (n, 2) offset - bias; agreeing : (n,) mask; spread_px : robust standard deviation of a coordinate
    chance_log10 : log10 of the probability that as many false matches agree
    """

    coefficients: np.ndarray
    centre: np.ndarray
    half_size: np.ndarray
    residual_px: np.ndarray
    agreeing: np.ndarray
    spread_px: float
    chance_log10: float

    def bias(self, xy: np.ndarray) -> np.ndarray:
        """Return the bias at image points, ``(n, 2)``."""
        return _build_design(xy, self.centre, self.half_size) @ self.coefficients.T


def find_agreement(
    xy: np.ndarray, offset: np.ndarray, centre: np.ndarray, half_size: np.ndarray, reach_px: float, tolerance_px: float
) -> Agreement | None:
    """Return the affine bias on which most offsets agree; None if fewer than six do.

    xy, offset : (n, 2) image points and their offsets, each found within ``reach_px`` of the expected position
    tolerance_px : radius around the densest point of the offsets, for the initial value
    """
    if len(offset) < SAMPLES.redundant:
        return None
    is_near = np.hypot(*(offset[:, None] - offset[None]).transpose(2, 0, 1)) <= tolerance_px
    start = is_near[int(is_near.sum(axis=1).argmax())]
    if start.sum() < SAMPLES.redundant:
        return None
    design = _build_design(xy, centre, half_size)
    coefficients = np.zeros((2, 3))
    coefficients[:, 0] = np.median(offset[start], axis=0)
    residual, spread, inliers = offset - design @ coefficients.T, tolerance_px / 2.0, start
    for _ in range(ITERATIONS.most):
        columns = 3 if inliers.sum() >= SAMPLES.fewest else 1
        weight = np.maximum(1.0 - ((np.hypot(*residual.T) / (spread * np.sqrt(2.0))) / TUKEY) ** 2, 0.0) ** 2
        root = np.sqrt(weight)[:, None]
        values = np.linalg.lstsq(design[:, :columns] * root, offset * root, rcond=1e-8)[0]
        coefficients = np.zeros((2, 3))
        coefficients[:, :columns] = values.T
        residual = offset - design @ coefficients.T
        # Robust standard deviation of a coordinate, from the median length (Rayleigh distribution)
        length = np.hypot(*residual[inliers].T)
        spread = float(np.clip(np.median(length) / 1.1774, EQUALITY.negligible * tolerance_px, tolerance_px))
        is_within = np.hypot(*residual.T) <= ROBUST.outlier * spread
        if is_within.sum() < SAMPLES.redundant:
            return None
        if np.array_equal(is_within, inliers):
            break
        inliers = is_within
    radius = ROBUST.outlier * spread
    chance = min(np.pi * radius**2 / (2.0 * reach_px + 1.0) ** 2, 1.0)
    # the cluster was selected among all offsets, so the probability is multiplied by their number
    tail = max(float(special.bdtrc(inliers.sum() - 2, len(offset) - 1, chance)), float(np.finfo(np.float64).tiny))
    log10 = float(np.log10(tail) + np.log10(len(offset)))
    return Agreement(
        coefficients, centre, half_size, residual_px=residual, agreeing=inliers, spread_px=spread, chance_log10=log10
    )


def _build_design(xy: np.ndarray, centre: np.ndarray, half_size: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(xy)), (xy - centre) / np.maximum(half_size, 1.0)])
