"""Effect on an adjusted block of errors that many observations share: of coordinate operations, of a pass's pointing.

The unknown shifts d of the operations, with the covariance D of their stated accuracies, are no unknowns of the
adjustment: usually only the GCPs determine the block's position, and then they cannot be estimated. They are
*considered* (Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chapter 8): the estimate does not
change, and its covariance becomes

    C + G D G'        G = dx / dd

Check points that the same operation converted are shifted by d too, so their errors have C + (G - E) D (G - E)' with E
the identity at their operation: if only the GCPs determine the block, G = E, and they cannot test the operation at all.

G follows from the normal equations at the solution: the GCPs' positions are moved by one standard deviation, and the
resulting step is computed. All other constraints (heights of a DEM, priors of the cameras) keep their weights.

The frames of one pass of a satellite share the error of its orbit and attitude: the mean of k of them is not more
accurate than one by the square root of k. In the adjustment their priors are independent, so that its covariance C
contains s^2 J_c J_c' of each camera c, with the a priori standard deviation s and J_c = dx / dl_c. Actually a share q
of s is the camera's own, and the rest is common to the pass. With J the sum of the J_c the covariance is::

    C - s^2 (1 - q^2) sum J_c J_c' + s^2 (1 - q^2) J J'

The remaining error of jitter displaces whole lines: samples of its posterior, added to the measurements, move the
points, and the mean of k products of these movements is added to the covariance.
"""

from dataclasses import replace

import numpy as np
from scipy.special import ndtri, stdtrit

from ...block.jitter_curve import JitterEstimate
from ...foundation.thresholds import SAMPLES, threshold, thresholds
from ...ground.geodesy import move_ground
from ...refinement.model import RefinementModel
from ...refinement.stacked_cameras import linearise_images
from ..gauss_newton import GaussNewton, Solution


def propagate_shifts(loop: GaussNewton, solution: Solution, surveyed: np.ndarray, shifts_m: np.ndarray) -> np.ndarray:
    """Return the movement of each point, ``(m, 3, k)`` east, north, up, caused by shifts of the GCPs.

    surveyed : (m,) mask of the points with a survey
    shifts_m : (m, 3, k) east, north and up of each point's survey, for k shifts
    """
    priors, point_shifts = solution.weighting.points, np.zeros_like(shifts_m)
    arguments = solution.state, solution.weight, priors, solution.weighting.contributes
    unmoved = loop.equations.form_normals(*arguments)
    loop.system.factorise(solution.normals.blocks, loop.prior_weight)
    for column in range(shifts_m.shape[2]):
        step = np.where(surveyed[:, None] & priors.observed, shifts_m[:, :, column], 0.0)
        if step.any():
            shifted = replace(priors, target=move_ground(priors.target, step))
            shifted_normals = loop.equations.form_normals(*arguments[:2], shifted, arguments[3])
            cameras = loop.system.solve(shifted_normals.right - unmoved.right)
            change = replace(unmoved, point_right=shifted_normals.point_right - unmoved.point_right)
            point_shifts[:, :, column] = loop.equations.compute_point_steps(
                solution.state, solution.weight, change, cameras
            )
    return point_shifts


@thresholds
class PASS_POINTING:
    """Limits for the pointing error common to the frames of one pass."""

    own_share: float = threshold(
        0.15,
        "",
        "sigma of a frame's own pointing error relative to that of the pass",
        "SkySat over Miami University 0.05; views 12 degrees apart see a common error 0.1 differently; 2026-11-25",
    )


def propagate_pointing(
    loop: GaussNewton, solution: Solution, prior_sigma: np.ndarray, cameras: np.ndarray, parameters: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the effect of a pass's pointing error on each point.

    prior_sigma : (cameras, p) a priori standard deviations
    cameras, parameters : indices of the pass's cameras, and of the parameters that are a camera's pointing
    Result: movement of each point by the common error, east, north, up, (m, 3, parameters); and the excess of the own
    errors in C, (m, 3, 3).
    """
    arguments = solution.state, solution.weight, solution.weighting.points, solution.weighting.contributes
    unmoved = loop.equations.form_normals(*arguments)
    change = replace(unmoved, point_right=np.zeros_like(unmoved.point_right))
    loop.system.factorise(solution.normals.blocks, loop.prior_weight)

    def move(by: np.ndarray, parameter: int) -> np.ndarray:
        """Return the points' steps ``(m, 3)`` if some cameras change by a prior standard deviation together."""
        right = np.zeros_like(prior_sigma)
        right[by, parameter] = loop.prior_weight[by, parameter] * prior_sigma[by, parameter]
        return loop.equations.compute_point_steps(solution.state, solution.weight, change, loop.system.solve(right))

    common = np.stack([move(cameras, parameter) for parameter in parameters.tolist()], axis=2)
    excess = np.zeros((len(common), 3, 3))
    if len(cameras) > SAMPLES.dense:  # C contains 1/k of the common variance
        return np.sqrt(1.0 - 1.0 / len(cameras)) * common, excess
    shared_share = 1.0 - PASS_POINTING.own_share**2
    for parameter in parameters.tolist():
        for camera in cameras.tolist():
            single_shift = move(np.array([camera]), parameter)
            excess += shared_share * single_shift[:, :, None] * single_shift[:, None, :]
    return np.sqrt(shared_share) * common, excess


def propagate_jitter(
    loop: GaussNewton, solution: Solution, camera: RefinementModel, jitter: JitterEstimate
) -> np.ndarray:
    """Return the movement of each point, ``(m, 3, samples)``, by each sample of the errors of the jitter curves.

    A variance from k samples has k degrees of freedom: the samples are scaled by Student's factor at 90 %.
    """
    observations, size, (values, ground) = loop.equations.observations, len(jitter.samples), solution.state
    linearised = linearise_images(
        camera,
        observations.images,
        observations.image,
        observations.xy,
        values[observations.camera_of_image],
        ground[observations.point],
    )
    shift = np.zeros((observations.count, 2, size))
    for image, rows in zip(observations.images, observations.by_image, strict=True):
        if image.id in jitter.curves:
            line = observations.xy[rows, 1]
            shift[rows] = np.stack([curves[image.id].evaluate(line) for curves in jitter.samples], axis=2)
    shift *= float(stdtrit(size, 0.95) / ndtri(0.95)) / np.sqrt(size)
    weighted = solution.weight[:, None, None] * linearised.by_ground

    def intersect(moved: np.ndarray) -> np.ndarray:
        """Return the points' steps for movements of their image points, with fixed cameras."""
        pulled = np.add.reduceat(weighted.swapaxes(1, 2) @ moved, observations.first[:-1])
        return np.asarray(solution.normals.inverse @ pulled)

    used_weight = solution.weight * solution.weighting.contributes[observations.point]
    left = used_weight[:, None, None] * (shift - linearised.by_ground @ intersect(shift)[observations.point])
    pulls = linearised.by_values.swapaxes(1, 2) @ left
    right = np.zeros((observations.cameras, linearised.by_values.shape[2], size))
    np.add.at(right, observations.camera, pulls)
    loop.system.factorise(solution.normals.blocks, loop.prior_weight)
    return intersect(shift - linearised.by_values @ loop.system.solve(right)[observations.camera])
