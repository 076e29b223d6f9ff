"""Connection of each image to the block: rejected tie points, too few tie points, parts without GCPs, corners."""

from collections.abc import Iterator

import numpy as np
from scipy import sparse

from ...block.block import Role, stack_rpcs
from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...foundation.thresholds import threshold, thresholds
from ...refinement.stacked_cameras import linearise_images
from .evidence import Evidence
from .significance import SOUND_BLOCKS


@thresholds
class CONNECTION:
    """Limits for images that are not reliably connected to their block."""

    wrong_share: float = threshold(0.1, "", "share of wrong tie measurements that is reported", SOUND_BLOCKS)
    most_wrong: float = threshold(0.4, "", "share of wrong tie measurements beyond which a block is unusable")
    left_out_share: float = threshold(0.5, "", "share of an image's rejected tie measurements that is reported")
    fewest_ties: int = threshold(
        4, "points", "fewest tie points of an image without GCPs: two determine its shift, two reveal an error"
    )
    fewest_of_pair: int = threshold(8, "points", "fewest common points of two images that are tested")
    kept_share: float = threshold(0.5, "", "share of a pair's accepted points below which it is reported")
    extrapolation_px: float = threshold(
        5.0, "px", "sigma at image corners beyond that between the points that is reported", SOUND_BLOCKS
    )


def find_ties_left_out(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for rejected tie measurements: in the block, on an image, or between two images."""
    block = evidence.result.block
    ties = evidence.is_role(Role.TIE)
    total, out = int(ties.sum()), int((ties & evidence.left_out).sum())
    if not total:
        return
    share = out / total
    point = block.measurements.point
    rays = np.bincount(point[ties], minlength=len(block.points.ids))
    rays_out = np.bincount(point[ties & evidence.left_out], minlength=len(block.points.ids))
    wrong = (out - int(((rays > 0) & (rays_out == rays)).sum())) / total  # if all rays disagree, one may be correct
    count = np.bincount(block.measurements.image[ties], minlength=len(block.images))
    lost = np.bincount(block.measurements.image[ties & evidence.left_out], minlength=len(block.images))
    bad = np.flatnonzero((count >= CONNECTION.fewest_of_pair) & (lost > CONNECTION.left_out_share * count))
    images = tuple(block.images[index].id for index in bad.tolist())
    if wrong > CONNECTION.wrong_share or images:
        where = f"; on image {list_ids(images)} more than half of them" if images else ""
        yield Reason(
            "ties-left-out",
            Level.UNUSABLE if wrong > CONNECTION.most_wrong else Level.DOUBTFUL,
            f"{out} of {total} tie point measurements ({100.0 * share:.0f} %) are outliers and are not used{where}",
            "check where they are (flags in the layer image_points): clouds, water and repeated texture cause "
            "false matches; if all points of an image or image pair are outliers, its RPC or ids may be wrong",
            images=images,
        )
        return
    links = find_broken_links(evidence)
    if links:
        listed = list_ids(f"{one} and {other} ({kept} of {points} points used)" for one, other, points, kept in links)
        yield Reason(
            "link-left-out", Level.DOUBTFUL,
            f"most tie points between two images are outliers: {listed}",
            "check the tie points between these images; without them, these images are connected through other "
            "images only",
            images=tuple(dict.fromkeys(name for first, second, _, _ in links for name in (first, second))),
        )  # fmt: skip


def find_broken_links(evidence: Evidence) -> list[tuple[str, str, int, int]]:
    """Return the pairs of images most of whose common tie points were rejected: ids, points, points kept."""
    block = evidence.result.block
    if not (evidence.left_out & evidence.is_role(Role.TIE)).any():
        return []
    points, kept = (_count_common_points(evidence, chosen) for chosen in (None, ~evidence.left_out))
    first, second = points.nonzero()
    common, left = (np.asarray(count[first, second]).ravel() for count in (points, kept))
    return [
        (block.images[first[pair]].id, block.images[second[pair]].id, int(common[pair]), int(left[pair]))
        for pair in np.flatnonzero(
            (common >= CONNECTION.fewest_of_pair) & (left < CONNECTION.kept_share * common)
        ).tolist()
    ]


def _count_common_points(evidence: Evidence, chosen: np.ndarray | None) -> sparse.csr_matrix:
    """Return the number of common tie points of image pairs, ``(images, images)`` sparse, above the diagonal."""
    block = evidence.result.block
    rows = block.measurements
    ties = np.flatnonzero(evidence.is_role(Role.TIE) if chosen is None else evidence.is_role(Role.TIE) & chosen)
    shape = len(block.points), len(block.images)
    shown = sparse.csr_matrix((np.ones(len(ties), np.int64), (rows.point[ties], rows.image[ties])), shape)
    common = sparse.triu(shown.T @ shown, 1, format="csr")
    common.sort_indices()
    return common


def find_unconnected_images(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for images without any used point, and for images with few tie points and no GCP."""
    result, block = evidence.result, evidence.result.block
    used = evidence.adjusting
    exposure = block.exposure_of_image  # a constraint of one image of an exposure is one of all
    count, control = (
        np.bincount(exposure[block.measurements.image[chosen]], minlength=len(block.images))[exposure]
        for chosen in (used, used & evidence.is_role(Role.GCP))
    )
    free = result.model.parameters and len(block.images) > 1
    alone = [block.images[index].id for index in np.flatnonzero(count == 0).tolist()]
    if alone:
        yield Reason(
            "image-not-held", Level.DOUBTFUL,
            f"no GCP and no valid tie point on {list_ids(alone)}: the RPC was not changed",
            "find tie points to its neighbours, measure GCPs on it, or remove it from the block",
            images=tuple(alone),
        )  # fmt: skip
    weak = np.flatnonzero((count > 0) & (count < CONNECTION.fewest_ties) & (control == 0))
    if free and len(weak):
        ids = tuple(block.images[index].id for index in weak.tolist())
        yield Reason(
            "few-ties", Level.DOUBTFUL,
            f"image {list_ids(ids)} has fewer than {CONNECTION.fewest_ties} tie points and no GCP: an error in one "
            "of them cannot be detected",
            "find more tie points on it, or measure GCPs",
            images=ids,
        )  # fmt: skip


def find_parts_without_control(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for parts of a block without GCPs and without common points with the others."""
    parts = [part for part in evidence.result.parts if part.gcps or part.ties]
    if len(parts) < 2 or all(part.gcps for part in parts):
        return
    free = tuple(name for part in parts if not part.gcps for name in part.images)
    held = sum(1 for part in parts if part.gcps)
    yield Reason(
        "part-without-control", Level.DOUBTFUL,
        f"the block falls into {len(parts)} parts without common points, {held} of them with GCPs; the absolute "
        f"accuracy of image {list_ids(free)} is that of its RPC, and it does not match the other parts",
        "find tie points between the parts, or measure GCPs in each",
        images=free,
    )  # fmt: skip


def find_extrapolation(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for images whose points do not determine the model at their corners.

    With Q the covariance of the parameters, the variance of the correction is A Q A'. The excess of the worst corner
    over the middle of the points is tested, because the uncertainty of the block's position is common to both.
    """
    result, block = evidence.result, evidence.result.block
    used = evidence.adjusting
    where, xy = block.measurements.image[used], block.measurements.xy[used]
    count = np.bincount(where, minlength=len(block.images))
    sums = np.column_stack([np.bincount(where, xy[:, axis], minlength=len(block.images)) for axis in (0, 1)])
    beyond = np.zeros(len(block.images))
    measured = np.flatnonzero(count)
    corners = np.array([block.images[index].outline_px(1) for index in measured.tolist()]).reshape(len(measured), 4, 2)
    places = np.concatenate([(sums / np.maximum(count, 1)[:, None])[measured, None], corners], axis=1)
    heights = np.array([image.middle_height_m for image in block.images])
    which = np.repeat(measured, 5)
    ground = stack_rpcs(block.images).localize(which, places.reshape(-1, 2), heights[which])
    cameras = result.cameras
    at = linearise_images(cameras.model, block.images, which, places.reshape(-1, 2), cameras.values, ground)
    by_values = at.by_values.reshape(len(measured), 10, at.by_values.shape[2])  # sample and line of five places
    variances = np.sum((by_values @ cameras.covariance[measured]) * by_values, axis=2).reshape(-1, 5, 2).max(axis=2)
    variances = np.maximum(variances, 0.0)
    beyond[measured] = np.sqrt(np.maximum(variances[:, 1:].max(axis=1) - variances[:, 0], 0.0))
    weak = np.flatnonzero(beyond > CONNECTION.extrapolation_px)
    if len(weak):
        ids = tuple(block.images[index].id for index in weak.tolist())
        worst = block.images[int(np.argmax(np.nan_to_num(beyond)))].id
        yield Reason(
            "extrapolation", Level.DOUBTFUL,
            f"the points of image {list_ids(ids)} do not determine its corners: the standard deviation of the model "
            f"{result.model.name} is {np.nanmax(beyond):.2g} px there ({worst})",
            "measure GCPs or find tie points near the corners"
            + (", or choose a model with fewer parameters (shift)" if evidence.can_be_simpler else ""),
            images=ids,
        )  # fmt: skip


ON_CONNECTIONS = (find_ties_left_out, find_unconnected_images, find_parts_without_control, find_extrapolation)
