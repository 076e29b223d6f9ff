"""The solution: convergence, sigma0, corrections against their priors, refined RPCs against their models."""

from collections.abc import Iterator

import numpy as np

from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...foundation.thresholds import threshold, thresholds
from ...refinement.model import Priors, estimate_priors, select_priors
from .evidence import CAMERA, Evidence
from .significance import SOUND_BLOCKS, is_significant


@thresholds
class SOLUTION:
    """Limits beyond which the solution of an adjustment is not reliable."""

    settled_sigmas: float = threshold(1.0, "sigma", "change by another iteration from which a block is unusable")
    doubtful_residuals: float = threshold(3.0, "", "smallest reported residuals over noise and camera", SOUND_BLOCKS)
    unusable_residuals: float = threshold(10.0, "", "… at which a block is unusable", SOUND_BLOCKS)
    implausible_factor: float = threshold(2.5, "", "smallest reported residuals over a group's sigmas", SOUND_BLOCKS)
    implausible_sigma0: float = threshold(2.0, "", "smallest reported sigma0 after the estimates", SOUND_BLOCKS)
    doubtful_sigmas: float = threshold(5.0, "sigma", "smallest reported correction, in prior sigmas", SOUND_BLOCKS)
    unusable_sigmas: float = threshold(15.0, "sigma", "… beyond which a block is unusable", SOUND_BLOCKS)
    granted_shift_px: float = threshold(20.0, "px", "smallest prior sigma of a shift in this test", SOUND_BLOCKS)
    granted_drift: float = threshold(2e-4, "px/px", "smallest prior sigma of a drift in this test", SOUND_BLOCKS)
    showing_gcps: int = threshold(3, "GCPs", "fewest GCPs of a part that show an affine deformation of its ground")
    implausible_drift: float = threshold(
        5.0, "sigma", "largest drift of an image that no GCPs confirm, in a priori sigmas of its sensor", SOUND_BLOCKS
    )
    doubtful_fit_px: float = threshold(0.1, "px", "difference of a refined RPC from its model that is reported")
    unusable_fit_px: float = threshold(1.0, "px", "… beyond which a block is unusable")
    least_prior_share: float = threshold(1e-12, "", "smallest share of a prior from which its sigma is computed")


#: Smallest prior with which a correction is compared.
GRANTED = Priors(shift_px=SOLUTION.granted_shift_px, drift=SOLUTION.granted_drift)


def find_divergence(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for an adjustment that did not converge, by the change of the unknowns in one more step.

    The predicted decrease of half the weighted sum of squares is half the squared length of the step in sigmas.
    """
    result = evidence.result
    if result.converged:
        return
    still = 2.0 * result.history[-1].predicted_decrease if result.history else np.inf
    moving = np.sqrt(max(still, 0.0)) / max(result.sigma0, 1.0)
    level = Level.UNUSABLE if not moving < SOLUTION.settled_sigmas else Level.DOUBTFUL
    distance = f"; the next iteration would change the unknowns by {moving:.2g} sigma" if np.isfinite(moving) else ""
    yield Reason(
        "not-converged", level, f"the adjustment {result.status}{distance}",
        "look for wrong points and images first"
        + ("; then choose a model of fewer parameters" if evidence.can_be_simpler else ""),
    )  # fmt: skip


def find_large_sigma0(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for residuals much larger than the observations' and cameras' standard deviations."""
    result = evidence.result
    stated, adjusted = float(np.median(result.block.measurements.sigma_px)), float(np.median(result.sigma_px))
    sigma0 = result.sigma0 * adjusted / stated  # for the given sigmas, if they were estimated
    if not is_significant(sigma0**2 * result.redundancy, result.redundancy):
        return
    needed, allowed = sigma0 * stated, float(np.sqrt(stated**2 + CAMERA.unmodelled_px**2 + evidence.jitter_px**2))
    if needed < SOLUTION.doubtful_residuals * allowed:
        return
    yield Reason(
        "residuals-too-large",
        Level.UNUSABLE if needed >= SOLUTION.unusable_residuals * allowed else Level.DOUBTFUL,
        f"sigma0 is {sigma0:.2g}: the residuals are larger than the sigmas of the observations by this factor; they "
        f"correspond to a sigma of image points of {needed:.2g} px instead of {stated:.2g} px",
        "look for wrong points (outliers in the report) and for a model with more parameters; if the points are "
        "correct, give realistic sigmas",
    )


def find_implausible_sigmas(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for stated sigmas that are much too small by the residuals, or for a sigma0 far above 1."""
    result = evidence.result
    wrong = [
        f"{part.group} {part.factor:.1f} times ({part.sigma:.2g} {part.unit} instead of {part.sigma / part.factor:.2g})"
        for part in result.variance_components
        if part.estimated and part.unit in ("px", "m") and part.factor >= SOLUTION.implausible_factor
        and is_significant(part.factor**2 * part.redundancy, part.redundancy)
    ]  # fmt: skip
    left = result.sigma0 >= SOLUTION.implausible_sigma0
    if left and is_significant(result.sigma0**2 * result.redundancy, result.redundancy):
        wrong.append(f"all observations {result.sigma0:.1f} times (sigma0)")
    if wrong:
        yield Reason(
            "sigmas-implausible", Level.DOUBTFUL,
            f"the residuals are larger than the given standard deviations: {'; '.join(wrong)}; the predicted "
            "accuracy accounts for this",
            "remove the jitter first, which is in these residuals"
            if evidence.jitter_px > 0.0
            else "check the largest residuals first: if these points are correct, give realistic standard deviations "
            "(`sigma_image`, `sigma_gcp_xy`, `sigma_gcp_h`, or the columns of the files)",
        )  # fmt: skip


def find_large_corrections(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for corrections larger than any satellite's RPC needs, as wrong points cause them."""
    result = evidence.result
    sigma = prior_sigmas(evidence)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(sigma > 0.0, np.abs(result.values) / sigma, 0.0)
    far = np.nan_to_num(far)
    for level, low, high in (
        (Level.UNUSABLE, SOLUTION.unusable_sigmas, np.inf),
        (Level.DOUBTFUL, SOLUTION.doubtful_sigmas, SOLUTION.unusable_sigmas),
    ):
        largest = far.max(axis=1, initial=0.0)
        images = np.flatnonzero((largest >= low) & (largest < high))
        if not len(images):
            continue
        worst = int(images[np.argmax(largest[images])])
        parameter = int(np.argmax(far[worst]))
        ids = tuple(result.block.images[index].id for index in images.tolist())
        yield Reason(
            "correction-too-large", level,
            f"the correction of image {list_ids(ids)} is larger than a plausible error of its RPC: "
            f"{result.model.parameters[parameter]} of {result.block.images[worst].id} is "
            f"{result.values[worst, parameter]:.3g}, {far[worst, parameter]:.0f} times its a priori standard "
            f"deviation ({sigma[worst, parameter]:.2g})",
            "check that the points belong to these images (coordinates, columns, ids, datum), and that the RPCs belong "
            "to the pixels",
            images=ids,
        )  # fmt: skip


def find_implausible_drifts(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for drifts that are implausibly large for their sensors and not confirmed by GCPs.

    Tie points determine differences between images only, and matches of a scene on two dates may have common errors.
    """
    result = evidence.result
    estimated = result.cameras
    if estimated is None or result.plan is not None:
        return
    by_ties = {name for part in result.parts if part.gcps < SOLUTION.showing_gcps for name in part.images}
    drifts, images = estimated.model.drifts, result.block.images
    far = np.zeros(estimated.values.shape)
    for index in [index for index, image in enumerate(images) if image.id in by_ties]:
        sigma = estimated.model.prior_sigmas(images[index], estimate_priors(images[index]))[drifts]
        far[index, drifts] = np.abs(estimated.values[index, drifts]) / sigma
    found = np.flatnonzero(far.max(axis=1, initial=0.0) > SOLUTION.implausible_drift)
    if not len(found):
        return
    worst, parameter = np.unravel_index(int(np.argmax(far)), far.shape)
    ids = tuple(images[index].id for index in found.tolist())
    value = float(estimated.values[worst, parameter])
    yield Reason(
        "drift-implausible", Level.DOUBTFUL,
        f"the attitude drift of image {list_ids(ids)} from tie points is implausible for the sensor, and no GCPs "
        f"confirm it: {estimated.model.parameters[parameter]} of {images[worst].id} is {value:.1e}, "
        f"{far[worst, parameter]:.0f} times the a priori standard deviation ("
        f"{abs(value) / far[worst, parameter]:.1e})",
        f"measure at least {SOLUTION.showing_gcps} GCPs spread over the images; without GCPs, look for systematic "
        "errors of tie points (between dates, on relief or shadows)",
        images=ids,
    )  # fmt: skip


def prior_sigmas(evidence: Evidence) -> np.ndarray:
    """Return the prior standard deviation of each parameter, ``(images, p)``; 0 for fixed ones.

    It follows from the prior's share in the parameter (weight times variance), which is part of the adjustment's
    result; without that (images refined separately), from the model. Without GCPs the prior is an assumption that real
    products exceed, so it is at least `GRANTED`.
    """
    result = evidence.result
    part_of = {name: part for part in result.parts for name in part.images}
    sigma = np.zeros_like(result.values)
    for index, image in enumerate(result.block.images):
        part = part_of.get(image.id)
        factor = max(result.sigma0, 1.0) if part is not None and part.gcps else 1.0
        share, own = result.prior_share[index], result.values_sigma[index] / factor
        controlled = part is None or part.gcps > 0
        with np.errstate(divide="ignore", invalid="ignore"):
            kept = np.where(share < 1.0, own / np.sqrt(share), 0.0)
        told = np.isfinite(kept) & (share > SOLUTION.least_prior_share)
        prior = (
            kept
            if told.all()
            else np.where(told, kept, result.model.prior_sigmas(image, select_priors(image, controlled)))
        )
        sigma[index] = np.where(prior > 0.0, np.maximum(prior, result.model.prior_sigmas(image, GRANTED)), 0.0)
    return sigma


def find_refit_errors(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for refined RPCs that differ from their models."""
    block = evidence.result.block
    fit = np.array([one.fit_max_px for one in evidence.refined])
    for level, low, high in (
        (Level.UNUSABLE, SOLUTION.unusable_fit_px, np.inf),
        (Level.DOUBTFUL, SOLUTION.doubtful_fit_px, SOLUTION.unusable_fit_px),
    ):
        images = np.flatnonzero(~(fit < low) & ~(fit >= high))
        if len(images):
            ids = tuple(block.images[index].id for index in images.tolist())
            yield Reason(
                "rpc-unlike-model", level,
                f"the refined RPC of image {list_ids(ids)} differs from its model by up to {fit[images].max():.2g} px",
                "choose a model with fewer parameters: an RPC cannot represent this correction"
                if evidence.can_be_simpler
                else "look for wrong points: an RPC cannot represent this correction",
                images=ids,
            )  # fmt: skip


ON_SOLUTION = (
    find_divergence,
    find_large_sigma0,
    find_implausible_sigmas,
    find_large_corrections,
    find_implausible_drifts,
    find_refit_errors,
)
