"""Connection of each image to the block: rejected tie points, too few tie points, parts without GCPs, corners."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ...block.block import Role
from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...foundation.thresholds import SAMPLES, threshold, thresholds
from .evidence import SOUND_BLOCKS, Evidence


@thresholds
class CONNECTION:
    """Limits for images that are not reliably connected to their block."""

    wrong_share: float = threshold(0.1, "", "share of wrong tie measurements that is reported", SOUND_BLOCKS)
    most_wrong: float = threshold(0.4, "", "share of wrong tie measurements beyond which a block is unusable")
    fewest_ties: int = threshold(
        4, "points", "fewest tie points of an image without GCPs: two determine its shift, two reveal an error"
    )


def find_ties_left_out(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for rejected tie measurements: in the block, on an image, or between two images."""
    block = evidence.result.block
    ties = evidence.row_role == Role.TIE
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
    bad = np.flatnonzero((count >= SAMPLES.tested) & (lost > CONNECTION.most_wrong * count))
    images = tuple(block.images[index].id for index in bad.tolist())
    if wrong > CONNECTION.wrong_share or images:
        where = f"; on image {list_ids(images)} more than {CONNECTION.most_wrong:.0%}" if images else ""
        yield Reason(
            "ties-wrong",
            Level.UNUSABLE if wrong > CONNECTION.most_wrong else Level.DOUBTFUL,
            f"{out} of {total} tie point measurements ({100.0 * share:.0f} %) are outliers and are not used{where}",
            "check where they are (flags in the layer image_points): clouds, water and repeated texture cause "
            "false matches; if all points of an image or image pair are outliers, its RPC or ids may be wrong",
            images=images,
        )


def _count_observations(evidence: Evidence, role: Role | None = None) -> np.ndarray:
    """Return the number of adjusted measurements of each image, all or those of a role.

    Images of one exposure are counted together: a constraint of one of them is one of all.
    """
    block = evidence.result.block
    rows = evidence.adjusting if role is None else evidence.adjusting & (evidence.row_role == role)
    exposure = block.exposure_of_image
    return np.bincount(exposure[block.measurements.image[rows]], minlength=len(block.images))[exposure]


def find_unconnected_images(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for images without any used point, and for images with few tie points and no GCP."""
    result, block = evidence.result, evidence.result.block
    count, control = _count_observations(evidence), _count_observations(evidence, Role.GCP)
    free = result.model.parameters and len(block.images) > 1
    unconnected = [block.images[index].id for index in np.flatnonzero(count == 0).tolist()]
    if unconnected:
        yield Reason(
            "few-ties",
            Level.DOUBTFUL,
            f"no GCP and no valid tie point on {list_ids(unconnected)}: the RPC was not changed",
            "find tie points to its neighbours, measure GCPs on it, or remove it from the block",
            images=tuple(unconnected),
        )
    weak = np.flatnonzero((count > 0) & (count < CONNECTION.fewest_ties) & (control == 0))
    if free and len(weak):
        ids = tuple(block.images[index].id for index in weak.tolist())
        yield Reason(
            "few-ties",
            Level.DOUBTFUL,
            f"image {list_ids(ids)} has fewer than {CONNECTION.fewest_ties} tie points and no GCP: an error in one "
            "of them cannot be detected",
            "find more tie points on it, or measure GCPs",
            images=ids,
        )


def find_untied_images(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for images that GCPs orient and in which tie points of the others lie, but none is measured."""
    block, ties = evidence.result.block, evidence.adjusting & (evidence.row_role == Role.TIE)
    untied = (_count_observations(evidence) > 0) & (_count_observations(evidence, Role.TIE) == 0)
    ground = evidence.result.ground[np.unique(block.measurements.point[ties])] if untied.any() else np.empty((0, 3))
    for index in np.flatnonzero(untied).tolist():
        image, xy = block.images[index], evidence.refined[index].rpc.project(ground)
        inside = int(((xy >= image.domain_px[::2]) & (xy <= image.domain_px[1::2])).all(axis=1).sum())
        if image.size is not None and inside >= SAMPLES.tested:
            yield Reason(
                "few-ties",
                Level.DOUBTFUL,
                f"no valid tie point on {image.id}, although {inside} of the other images lie in it",
                "look at its pixels: clouds, another season, or an image that was mirrored or rotated after its RPC",
                images=(image.id,),
            )


def find_parts_without_control(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for parts of a block without GCPs and without common points with the others."""
    parts = [part for part in evidence.result.parts if part.gcps or part.ties]
    if len(parts) < 2 or all(part.gcps for part in parts):
        return
    free = tuple(name for part in parts if not part.gcps for name in part.images)
    controlled = sum(1 for part in parts if part.gcps)
    yield Reason(
        "few-ties",
        Level.DOUBTFUL,
        f"the block falls into {len(parts)} parts without common points, {controlled} of them with GCPs; the absolute "
        f"accuracy of image {list_ids(free)} is that of its RPC, and it does not match the other parts",
        "find tie points between the parts, or measure GCPs in each",
        images=free,
    )


def find_undetermined_accuracy(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for parts whose predicted accuracy is too large for the pixels and base of the images."""
    for part in evidence.result.parts:
        if part.undetermined:
            yield Reason(
                "not-determined",
                Level.DOUBTFUL,
                f"the observations of {list_ids(part.images)} do not determine the "
                f"{' and the '.join(describe_weak_figures(part.undetermined, vars(part)))}",
                "measure GCPs, give a DEM with `sigma_dem_m`, or add an image from another direction",
                images=part.images,
            )


def describe_weak_figures(keys: Sequence[str], part: Mapping[str, Any]) -> list[str]:
    """Return texts on the plan or height that the observations do not determine; ``part`` has figures by key."""
    texts = {
        "ce90_m": "position in plan (CE90 {:.0f} m, {:.0f} times the GSD)",
        "le90_m": "height (LE90 {:.0f} m, {:.0f} times the GSD, at a base-to-height ratio of {:.2g})",
    }
    return [texts[key].format(part[key], part[key] / part["gsd_m"], part["base_to_height"]) for key in keys]
