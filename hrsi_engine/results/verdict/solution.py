"""The solution: convergence, sigma0, drifts against those of the sensor, refined RPCs, coordinate operations.

Refined RPCs are compared with their models, the loss by a missing grid or geoid with the accuracy of the block.
"""

from collections.abc import Iterator

import numpy as np

from ...adjustment.outcome.area_accuracy import MOST_POINTS
from ...adjustment.statistics.precision import predict_accuracy
from ...block.placement import FRAME
from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import EQUALITY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ...ground.geoids import GEOID
from ...ground.operation_uses import advise_grids, describe_missing_grid, describe_substitute
from .evidence import CAMERA, Evidence, is_significant


@thresholds
class SOLUTION:
    """Limits beyond which the solution of an adjustment is not reliable."""

    settled_sigmas: float = threshold(
        0.1, "sigma", "reported change of the unknowns by another iteration: it increases errors by 0.5 %"
    )


def find_divergence(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for an adjustment that did not converge, by the change of the unknowns in one more step.

    The predicted decrease of half the weighted sum of squares is half the squared length of the step in sigmas.
    """
    result = evidence.result
    still = 2.0 * result.history[-1].predicted_decrease if result.history else np.inf
    moving = np.sqrt(max(still, 0.0)) / max(result.sigma0, 1.0)
    if result.converged or moving < SOLUTION.settled_sigmas:
        return
    is_unusable = not moving < SOLUTION.settled_sigmas * SIGNIFICANCE.extreme
    level = Level.UNUSABLE if is_unusable else Level.DOUBTFUL
    distance = f"; the next iteration would change the unknowns by {moving:.2g} sigma" if np.isfinite(moving) else ""
    yield Reason(
        "not-converged",
        level,
        f"the adjustment {result.status}{distance}",
        "look for wrong points and images first"
        + ("; then choose a model of fewer parameters" if evidence.can_be_simpler else ""),
    )


def find_implausible_sigmas(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for residuals much larger than the stated standard deviations, of all or of one group.

    Residuals are unusable if they are much larger than the noise, the unmodelled errors of cameras, and jitter.
    """
    result, reported_px = evidence.result, ROBUST.full_weight * EQUALITY.camera_px
    texts = [
        f"{part.group} {part.factor:.1f} times ({part.sigma:.2g} {part.unit} instead of {part.sigma / part.factor:.2g})"
        for part in result.variance_components
        if part.estimated
        and part.unit in ("px", "m")
        and part.factor >= ROBUST.full_weight
        and (part.unit == "m" or part.sigma >= reported_px)
        and is_significant(part.factor**2 * part.redundancy, part.redundancy)
    ]
    stated, adjusted = float(np.median(result.block.measurements.sigma_px)), float(np.median(result.sigma_px))
    required = result.sigma0 * adjusted
    allowed = float(np.sqrt(stated**2 + CAMERA.unmodelled_px**2 + evidence.jitter_px**2))
    unusable = required >= SIGNIFICANCE.extreme * allowed
    reported = result.sigma0 >= ROBUST.full_weight and required >= reported_px
    if (unusable or reported) and is_significant((required / stated) ** 2 * result.redundancy, result.redundancy):
        texts.append(
            f"all observations {result.sigma0:.1f} times (sigma0; image points of {required:.2g} px instead of "
            f"{stated:.2g} px)"
        )
    if texts:
        yield Reason(
            "sigmas-implausible",
            Level.UNUSABLE if unusable else Level.DOUBTFUL,
            f"the residuals are larger than the given standard deviations: {'; '.join(texts)}; the predicted "
            "accuracy accounts for this",
            "remove the jitter first, which is in these residuals"
            if evidence.jitter_px > 0.0
            else "check the largest residuals first: if these points are correct, choose a model with more parameters, "
            "or give realistic standard deviations (`sigma_image`, `sigma_gcp_xy`, `sigma_gcp_h`, or the columns of "
            "the files); a vibration that all images have in common is seen at GCPs alone",
        )


def find_implausible_drifts(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for drifts that are implausibly large for their sensors and not confirmed by GCPs.

    Tie points determine differences between images only, and matches of a scene on two dates may have common errors.
    """
    result = evidence.result
    estimated = result.cameras
    if result.plan is not None:
        return
    by_ties = {name for part in result.parts if part.gcps < SAMPLES.plane for name in part.images}
    images, is_free = result.block.images, np.array([image.id in by_ties for image in result.block.images])
    tested = np.outer(is_free, estimated.model.drifts)
    normalised = np.where(tested, np.abs(estimated.values) / np.where(tested, evidence.value_sigmas, 1.0), 0.0)
    implausible = np.flatnonzero(normalised.max(axis=1, initial=0.0) > SIGNIFICANCE.certain)
    if not len(implausible):
        return
    worst, parameter = np.unravel_index(int(np.argmax(normalised)), normalised.shape)
    ids = tuple(images[index].id for index in implausible.tolist())
    value = float(estimated.values[worst, parameter])
    yield Reason(
        "drift-implausible",
        Level.DOUBTFUL,
        f"the attitude drift of image {list_ids(ids)} from tie points is implausible for the sensor, and no GCPs "
        f"confirm it: {estimated.model.parameters[parameter]} of {images[worst].id} is {value:.1e}, "
        f"{normalised[worst, parameter]:.0f} times the standard deviation ("
        f"{abs(value) / normalised[worst, parameter]:.1e})",
        f"measure at least {SAMPLES.plane} GCPs spread over the images; without GCPs, look for systematic "
        "errors of tie points (between dates, on relief or shadows)",
        images=ids,
    )


def find_refit_errors(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for refined RPCs that differ from their models."""
    block = evidence.result.block
    fit = np.array([one.fit_max_px for one in evidence.refined])
    for level, low, high in (
        (Level.UNUSABLE, FRAME.gross_px, np.inf),
        (Level.DOUBTFUL, EQUALITY.rpc_px, FRAME.gross_px),
    ):
        images = np.flatnonzero(~(fit < low) & ~(fit >= high))
        if len(images):
            ids = tuple(block.images[index].id for index in images.tolist())
            yield Reason(
                "rpc-unlike-model",
                level,
                f"the refined RPC of image {list_ids(ids)} differs from its model by up to {fit[images].max():.2g} px",
                "choose a model with fewer parameters: an RPC cannot represent this correction"
                if evidence.can_be_simpler
                else "look for wrong points: an RPC cannot represent this correction",
                images=ids,
            )


def find_missing_grids(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for missing grids and substituted geoids, if their loss exceeds the block's CE90 or LE90."""
    # CE90 and LE90 of the block's points, without the errors of coordinate operations
    covariance = evidence.result.ground_covariance_m2
    accuracy = predict_accuracy(covariance[:: -(-len(covariance) // MOST_POINTS) or 1])
    least = min((value for key in ("ce90_m", "le90_m") if (value := accuracy[key]) is not None), default=0.0)
    for use in evidence.result.block.all_operations:
        for code, text, loss_m, limit_m in (
            ("datum-grid-missing", describe_missing_grid(use), use.loss_m, least),
            ("geoid-substituted", describe_substitute(use), GEOID.substitute_sigma_m, accuracy["le90_m"] or 0.0),
        ):
            if text and not loss_m <= limit_m:
                yield Reason(code, Level.DOUBTFUL, text, advise_grids(use))


def find_ballpark_operations(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for datums without a PROJ operation to WGS84, which are treated as equal: errors up to 1 km."""
    for use in evidence.result.block.all_operations:
        if use.operation.is_ballpark:
            yield Reason(
                "horizontal-datum",
                Level.DOUBTFUL,
                f"{use.source}: PROJ has no operation from {use.crs} to WGS84, so the two are treated as equal",
                "convert the source to WGS84 with the parameters of the national survey before the run",
            )
