"""Parts of a block, determined by their GCPs or by the priors of the images' RPCs; what determines none is refused.

Cameras that share points belong together. Each such *part* of a block is determined by its GCPs or, without any, by the
priors of its images' RPCs; it has its own priors accordingly, and warnings name parts without GCPs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ...block.pointing import estimate_pointing
from ...foundation.errors import IDS_NAMED, SolveError, list_ids
from ...refinement.model import RefinementModel
from ..external.surface_plan import SurfacePlan
from ..observations import Observations
from ..options import AdjustOptions
from ..priors.earlier_cameras import JointPrior


@dataclass(frozen=True, eq=False)
class Part:
    """Cameras connected by common points: their images, and numbers of GCPs, tie points and places of a reference."""

    images: np.ndarray
    gcps: int
    ties: int
    places: int = 0


def find_parts(observations: Observations, earlier: JointPrior | None) -> tuple[Part, ...]:
    """Return the connected parts of the block, those with most images first; every image belongs to one."""
    rows = np.flatnonzero(observations.contributes)
    shape = (len(observations.points), observations.cameras)
    incidence = sparse.csr_matrix(
        (np.ones(len(rows), dtype=np.float32), (observations.point[rows], observations.camera[rows])), shape=shape
    )
    component = incidence.T @ incidence
    if earlier is not None:
        pairs = earlier.pairs
        component += sparse.csr_matrix((np.ones(len(pairs[0]), dtype=np.float32), pairs), shape=component.shape)
    count, label = csgraph.connected_components(component, directed=False)
    heads = np.flatnonzero(observations.contributing_points)
    of_point = label[observations.camera[observations.first[heads]]]
    surveyed, located = observations.surveyed[heads], observations.located[heads]
    gcps = np.bincount(of_point[surveyed], minlength=count)
    ties = np.bincount(of_point[~located], minlength=count)
    places = np.bincount(of_point[located & ~surveyed], minlength=count)
    if earlier is not None:  # each of its images has the number of GCPs of its part
        earlier_gcps = np.zeros(count, dtype=np.int64)
        np.maximum.at(earlier_gcps, label[earlier.camera[earlier.known.camera]], earlier.known.gcps)
        gcps = gcps + earlier_gcps
    of_image = label[observations.camera_of_image]
    groups = np.split(np.argsort(of_image, kind="stable"), np.cumsum(np.bincount(of_image, minlength=count))[:-1])
    numbers = zip(groups, gcps.tolist(), ties.tolist(), places.tolist(), strict=True)
    return tuple(sorted([Part(images, *counts) for images, *counts in numbers], key=lambda part: -len(part.images)))


def warn_of_parts(
    observations: Observations,
    parts: Sequence[Part],
    options: AdjustOptions,
    weak: Sequence[str],
    surfaces: Sequence[SurfacePlan],
) -> list[str]:
    """Return the warnings about the block before its adjustment, including those of ``weak`` geometry.

    They list images without common points with others, and parts of the block whose plan position follows from their
    RPCs only.
    """
    names = [image.id for image in observations.images]
    determined = [part for part in parts if part.gcps or part.ties or part.places]
    matched = {name for surface in surfaces if not surface.why_open for name in surface.images}
    free = [part for part in determined if not part.gcps and not part.places and names[part.images[0]] not in matched]
    warnings = [
        *weak,
        *(
            f"the relief of the DEM does not determine {list_ids(surface.images)} in plan: {surface.why_open}; the "
            "RPCs determine its position"
            for surface in surfaces
            if surface.why_open
        ),
    ]
    single = [names[part.images[0]] for part in parts if part not in determined and len(part.images) == 1]
    if single:
        warnings.append(f"no GCP and no tie point on {list_ids(single)}: the RPC is not changed")
    if len(determined) > 1:
        part_texts = "; ".join(
            f"{list_ids(names[i] for i in part.images)} ({part.gcps} GCPs)" for part in determined[:IDS_NAMED]
        )
        warnings.append(f"the block falls into {len(determined)} parts without common points: {part_texts}")
    if free:
        part_texts = "; ".join(list_ids(names[i] for i in part.images) for part in free[:IDS_NAMED])
        reasons = dict.fromkeys(estimate_pointing(observations.images[i]).reason for part in free for i in part.images)
        has_heights = options.laser is not None or (options.dem is not None and options.sigma_dem_m is not None)
        subject = "position in plan" if has_heights else "position"
        warnings.append(
            f"no GCP on {part_texts}: the {subject} follows from the RPCs and their a priori accuracy "
            f"({' | '.join([*reasons][:3])})"
        )
    return warnings


def require_solvable(
    observations: Observations, model: RefinementModel, prior_weight: np.ndarray, earlier: JointPrior | None
) -> None:
    """Raise `SolveError` if there are fewer observations than unknowns."""
    p = min(len(model.parameters), 2 * model.least_points)  # parameters that need observations
    per_camera = np.bincount(observations.camera[observations.contributes], minlength=observations.cameras)
    free = np.isfinite(prior_weight).any(axis=1) & (per_camera > 0)
    if earlier is not None:
        free[earlier.camera] = False
    contributes, surveyed = observations.contributing_points, (observations.survey_weight > 0.0).sum(axis=1)
    if observations.referenced is not None:
        surveyed += 3 * observations.referenced  # their height follows from a DEM or rays
    observed = 2 * int(np.diff(observations.first) @ contributes) + int(surveyed @ contributes)
    unknowns = 3 * int(contributes.sum()) + p * int(free.sum())
    if not observations.located.any() or not free.all():
        observed += min(3, unknowns)  # priors or fixed images determine the position
    if observed >= unknowns:
        return
    simpler = "choose a simpler `model`, or " if model.least_points > 1 else ""
    poor = np.flatnonzero(free & (2 * per_camera < p))
    if len(poor):
        image = observations.images[int(np.flatnonzero(observations.camera_of_image == poor[0])[0])]
        raise SolveError(
            f"image {image.id}: {2 * per_camera[poor[0]]} observations for the {p} parameters of model {model.name}: "
            f"{simpler}measure more points on it"
        )
    raise SolveError(f"{observed} observations for {unknowns} unknowns: {simpler}add GCPs or tie points")
