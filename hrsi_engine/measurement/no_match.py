"""Explanation of a search for tie points without result: likely causes, tested with reduced images.

SIFT does not depend on scale and rotation, but on reflection: if features of an image match another one only after the
image is mirrored, it is a mirror image. If they match as it is, the affine map between the images, compared with that
which their RPCs predict, shows a rotation or a displacement. If nothing matches, the images show other ground, or
clouds.
(Lowe 2004, "Distinctive image features from scale-invariant keypoints".)
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..block.block import Image
from ..foundation.pixel_filters import load_opencv
from ..foundation.thresholds import EQUALITY, MEMORY, SAMPLES
from .block_matching.overlaps import CHOICE
from .block_matching.windows import read_overview
from .tie_points import PairSummary
from .tile_matching.epipolar import EPIPOLAR


class _Overview(NamedTuple):
    """Grey values (8 bit) of a reduced image, and its step in pixels of the image."""

    grey: np.ndarray
    step: int


class _AffineMap(NamedTuple):
    """Affine map (2, 3) from the reduced first to the reduced second image, and the number of matches that agree."""

    matrix: np.ndarray
    inliers: int


def explain_no_matches(images: Sequence[Image], pairs: Sequence[PairSummary], smallest_overlap: float) -> str:
    """Return the sentence for a search without matches: pairs that were tried, and the likely cause in the first ones.

    pairs : the pairs that were matched
    """
    image_by_id = {image.id: image for image in images}
    count = len(pairs)
    if not count:
        return (
            "no pair of the images was matched: their overlap is below "
            f"{smallest_overlap:.0%} of the area where their RPCs put them: check that the RPCs belong to the images"
        )
    causes = [_find_cause(image_by_id[pair.first], image_by_id[pair.second]) for pair in pairs[: CHOICE.last_tries]]
    accepted = sum(pair.matches for pair in pairs)
    return (
        f"no match in {count} pair{'s' if count > 1 else ''} of images where their RPCs predict it (accepted: "
        f"{accepted}): {'; '.join(dict.fromkeys(causes))}"
    )


def _find_cause(first: Image, second: Image) -> str:
    """Return the likely cause why two images have no matches, with what would change it."""
    names = f"{first.id} and {second.id}"
    one, second_overview = _reduce(first), _reduce(second)
    if one is None or second_overview is None:
        return f"{names} have hardly any valid pixels: check nodata and masks"
    as_given = _match(one.grey, second_overview.grey)
    mirrored = _match(np.ascontiguousarray(one.grey[:, ::-1]), second_overview.grey)
    if mirrored.inliers >= max(SAMPLES.fewest, 2 * as_given.inliers):
        return (
            f"{names} agree if one of them is mirrored ({mirrored.inliers} matches, {as_given.inliers} as they are): "
            "flip the pixels of the wrong one back, or write the RPC of its pixels into it"
        )
    if as_given.inliers < SAMPLES.fewest:
        return (
            f"{names} show nothing in common ({as_given.inliers} features agree anywhere in them): one RPC is that of "
            "another image, or clouds, water or another season hide the ground; compare the images in a viewer"
        )
    turn_deg, offset_px = _compare_with_rpcs(first, second, one.step, second_overview.step, as_given.matrix)
    if abs(turn_deg) > EQUALITY.direction_deg:
        return (
            f"{names} agree if one of them is turned by {abs(turn_deg):.0f} degrees ({as_given.inliers} matches): turn "
            "the pixels of the wrong one back, or write the RPC of its pixels into it"
        )
    return (
        f"{names} agree ({as_given.inliers} matches) about {offset_px:.0f} px from where their RPCs put them: one has "
        "the RPC of another image, or of the scene from which it was cut; see rpc-info"
    )


def _reduce(image: Image) -> _Overview | None:
    """Return a reduced image with grey values between its 1st and 99th percentile; None without valid pixels."""
    step = max(1, -(-max(image.known_size) // MEMORY.part_px))
    tile = read_overview(image, step)
    grey, valid = tile.pixels, tile.valid
    if np.count_nonzero(valid) < MEMORY.part_px:
        return None
    low, high = np.percentile(grey[valid], [1.0, 99.0])
    scaled = np.clip((grey - low) / max(high - low, 1e-9), 0.0, 1.0) * 255.0
    return _Overview(np.where(valid, scaled, 0.0).astype(np.uint8), step)


def _match(first: np.ndarray, second: np.ndarray) -> _AffineMap:
    """Return the affine map with most matches of two grey images."""
    cv2 = load_opencv()
    sift = cv2.SIFT_create(nfeatures=4000)
    (places, described), (second_places, described_others) = (
        sift.detectAndCompute(grey, None) for grey in (first, second)
    )
    nothing = _AffineMap(np.eye(2, 3), 0)
    if described is None or described_others is None or len(second_places) < 2:
        return nothing
    nearest = cv2.BFMatcher().knnMatch(described, described_others, k=2)
    distinct = [best for best, second_best in nearest if best.distance < EPIPOLAR.ratio * second_best.distance]
    if len(distinct) < SAMPLES.fewest:
        return nothing
    source = np.array([places[match.queryIdx].pt for match in distinct])
    target = np.array([second_places[match.trainIdx].pt for match in distinct])
    matrix, agree = cv2.estimateAffine2D(source, target, ransacReprojThreshold=EPIPOLAR.mode_px, maxIters=10_000)
    return nothing if matrix is None else _AffineMap(matrix, int(agree.sum()))


def _compare_with_rpcs(
    first: Image, second: Image, step: int, other_step: int, matrix: np.ndarray
) -> tuple[float, float]:
    """Return rotation (degrees) and displacement (px) of an affine map (2, 3) against the one of the RPCs."""
    places = first.centre_px + np.array([[0.0, 0.0], [100.0, 0.0]])
    by_rpc = second.rpc.project(first.rpc.localize(places, first.middle_height_m).ground)
    by_pixels = (((places + 0.5) / step - 0.5) @ matrix[:, :2].T + matrix[:, 2] + 0.5) * other_step - 0.5
    predicted, observed = by_rpc[1] - by_rpc[0], by_pixels[1] - by_pixels[0]
    turn = np.degrees(np.arctan2(observed[1], observed[0]) - np.arctan2(predicted[1], predicted[0]))
    return float((turn + 180.0) % 360.0 - 180.0), float(np.hypot(*(by_pixels[0] - by_rpc[0])))
