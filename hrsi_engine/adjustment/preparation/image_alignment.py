"""Initial shifts of the images from the tie points, so that rays intersect before anything is tested.

RPCs have errors of tens of pixels. Rays of neighbouring frames are almost parallel: there an error of 50 px places the
point tens of kilometres above the ground, where linearised equations are invalid and correct measurements appear wrong.
So the block is made consistent before anything is tested:

1. A few dozen points that connect each pair of images are intersected near the ground: a height has the standard
   deviation of the RPC's height range here.
2. Measurements that disagree with the others of their points (`consensus`) are left out, a test without cameras.
3. A shift of each image is estimated with the points, robustly and from coarse to fine: the scale of the weights
   falls from that of the residuals to a few standard deviations of a measurement (graduated non-convexity, Blake and
   Zisserman 1987). A pair of images with only wrong matches has no effect if other pairs connect these images.

The shifts are linear in the image, so that they are a suitable start for every model.
"""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ...foundation.large_arrays import finite_rows
from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import ITERATIONS, SAMPLES, threshold, thresholds
from ...refinement.model import RefinementModel
from ...refinement.models import MODELS
from ..equations import NormalEquations, PointPriors, State, find_pattern
from ..gauss_newton import GaussNewton, Weighting
from ..observations import Observations
from ..starting_values.consensus import find_agreeing_measurements
from ..starting_values.intersection import estimate_start_positions
from ..starting_values.weak_geometry import set_point_priors
from ..weights import cauchy


@thresholds
class IMAGE_ALIGNMENT:
    """Limits for the approximate alignment of images before tie measurements are tested."""

    least_height_m: float = threshold(200.0, "m", "smallest a priori sigma of a height in the alignment")
    coarse_share: float = threshold(0.9, "", "share of measurements with residuals below the first scale")
    finer: float = threshold(0.25, "", "scale of the robust weights relative to that before")


def align_images(
    observations: Observations,
    model: RefinementModel,
    shift_weight: np.ndarray,
    prior_weight: np.ndarray,
    threads: int = 0,
) -> np.ndarray:
    """Return values of a model ``(cameras, p)`` with which the rays of tie points intersect; zero without tie points.

    Surveys are not used: a wrong one would distort the alignment.

    observations : measurements of the block
    model : of the corrections
    shift_weight, prior_weight : (cameras, 2) in 1/px² and (cameras, p), of a shift's and of the model's parameters;
        infinite for fixed parameters
    threads : number for compiled loops; 0 for all processors
    """
    is_chosen = _choose_points(observations)
    if not is_chosen.any():
        return np.zeros((observations.cameras, len(model.parameters)))
    sample = observations.drop_points(~is_chosen)
    equations = NormalEquations(
        sample, MODELS["shift"], find_pattern(sample, 2), threads, drawn_from=observations.count
    )
    begin = estimate_start_positions(sample)
    priors, weight = bound_heights(sample, begin), 1.0 / sample.sigma_px**2
    shifts = np.zeros((sample.cameras, 2))
    # the cameras are first as far apart as their priors state
    weight_of_start = np.minimum(shift_weight[sample.camera_of_image[sample.image]].min(axis=1), weight)
    ground = equations.intersect(State(shifts, begin), weight_of_start, priors)
    usable = finite_rows(ground)
    ground[~usable] = begin[~usable]
    agreeing = find_agreeing_measurements(equations, sample, State(shifts, ground), usable) & usable[sample.point]
    loop = GaussNewton(equations, equations.pattern, shift_weight, np.diff(sample.first), ITERATIONS.most)
    factor, scale, state = agreeing.astype(np.float64), np.inf, State(shifts, ground)
    while True:
        solution = loop.iterate(state, Weighting(weight * factor, priors, usable))
        if scale == ROBUST.rejected:
            # Values of the model with the same effect on the image points as the shifts, except for their priors
            p, shifts = len(model.parameters), centre_shifts(sample, solution.state, shift_weight)
            normal, right = np.zeros((sample.cameras, p, p)), np.zeros((sample.cameras, p))
            for index, rows in enumerate(sample.by_image):
                camera, of_prior = sample.camera_of_image[index], 1.0 / sample.sigma_px[rows, None] ** 2
                linearise = model.equations(sample.images[index], sample.xy[rows])
                by_values = linearise(np.zeros(p), solution.state.ground[sample.point[rows]]).by_values
                normal[camera] += np.einsum("ncp,ncq->pq", by_values, of_prior[:, :, None] * by_values)
                shift_px = shifts[camera] / sample.images[index].camera_pixel
                right[camera] += np.einsum("ncp,nc->p", by_values, of_prior * shift_px)
            is_fixed = np.isinf(prior_weight)
            normal += np.where(is_fixed, 0.0, prior_weight)[:, :, None] * np.eye(p)
            normal[is_fixed] = 0.0
            normal.swapaxes(1, 2)[is_fixed] = 0.0
            normal[:, range(p), range(p)] += is_fixed | (normal.diagonal(axis1=1, axis2=2) == 0.0)
            return np.asarray(np.linalg.solve(normal, np.where(is_fixed, 0.0, right)[:, :, None])[:, :, 0])
        sigmas = np.linalg.norm(solution.normals.residual, axis=1) * np.sqrt(weight)
        coarse = float(np.quantile(sigmas[agreeing], IMAGE_ALIGNMENT.coarse_share)) if np.isinf(scale) else scale
        scale = max(IMAGE_ALIGNMENT.finer * coarse, ROBUST.rejected)
        factor, state = agreeing * cauchy(sigmas, scale), solution.state
        if scale == ROBUST.rejected:  # their sum would constrain the block's mean height
            priors = set_point_priors(sample, state.ground, None, None)[0]


def centre_shifts(observations: Observations, aligned: State, weight: np.ndarray) -> np.ndarray:
    """Return the shifts of aligned cameras ``(cameras, 2)`` without their part that translates a whole connected block.

    Tie points do not determine it: rotations of the images, which shifts do not follow, would move the block by many
    standard deviations of its RPCs to reduce their parallaxes a little. ``weight (cameras, 2)`` are the priors of the
    shifts; a block with fixed cameras keeps its position.
    """
    by_ground, shifts = np.zeros((observations.cameras, 2, 3)), aligned.values.copy()
    for index, rows in enumerate(observations.by_image):
        image, camera = observations.images[index], observations.camera_of_image[index]
        if len(rows):
            middle = np.nanmean(aligned.ground[observations.point[rows]], axis=0, keepdims=True)
            by_ground[camera] = image.camera_pixel * image.rpc.project_with_metric_jacobian(middle)[1][0]
    seen = sparse.csr_matrix(
        (np.ones(observations.count), (observations.camera, observations.point)),
        (observations.cameras, len(aligned.ground)),
    )
    parts, part = connected_components(seen @ seen.T, directed=False)
    for number in range(parts):
        here = np.flatnonzero(part == number)
        if np.isfinite(weight[here]).all():
            J, w = by_ground[here].reshape(-1, 3), np.sqrt(weight[here].ravel())
            moved_m = np.linalg.lstsq(w[:, None] * J, w * shifts[here].ravel(), rcond=None)[0]
            shifts[here] -= (J @ moved_m).reshape(-1, 2)
    return shifts


def bound_heights(observations: Observations, ground: np.ndarray) -> PointPriors:
    """Return surveys as priors, and free heights as those of ``ground (m, 3)`` with the RPCs' height range as sigma."""
    priors = PointPriors.from_surveys(observations, ground)
    reach = np.array([abs(one.rpc.height_scale) for one in observations.images])
    sigma = np.maximum(reach, IMAGE_ALIGNMENT.least_height_m)[observations.image[observations.first[:-1]]]
    priors.weight[:, 2] = np.where(priors.observed[:, 2], priors.weight[:, 2], 1.0 / sigma**2)
    return priors


def _choose_points(observations: Observations) -> np.ndarray:
    """Return a mask of tie points ``(m,)`` that connect two images, a few of each pair, evenly distributed."""
    cameras, tie = observations.cameras, observations.contributing_points & ~observations.located
    first = np.flatnonzero(observations.point[1:] == observations.point[:-1])  # rows whose next row has the same point
    first = first[tie[observations.point[first]]]
    one, second = observations.camera[first].astype(np.int64), observations.camera[first + 1].astype(np.int64)
    key = np.minimum(one, second) * cameras + np.maximum(one, second)
    first, key = first[one != second], key[one != second].astype(np.min_scalar_type(cameras**2))  # short keys sort fast
    order = np.argsort(key, kind="stable")
    begin = np.flatnonzero(np.diff(key[order].astype(np.int64), prepend=-1))
    count = np.diff(begin, append=len(order))
    pair_count = np.stack(np.divmod(key[order[begin]].astype(np.int64), cameras))
    links = np.bincount(pair_count.ravel(), minlength=cameras)
    fewest, largest = SAMPLES.fewest, SAMPLES.local
    target_count = np.clip(SAMPLES.local // links[pair_count].min(axis=0, initial=cameras), fewest, largest)
    step, last = np.repeat(np.maximum(count // target_count, 1), count), np.repeat(target_count, count)
    rank = np.arange(len(order)) - np.repeat(begin, count)
    is_chosen = np.zeros(len(observations.points), dtype=bool)
    is_chosen[observations.point[first[order[(rank % step == 0) & (rank < step * last)]]]] = True
    return is_chosen
