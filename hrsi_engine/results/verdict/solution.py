"""The solution itself: did it converge, do sigma0, corrections and refined RPCs lie where they should."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...refinement.model import Priors, select_priors
from .evidence import CAMERA_PX, Evidence
from .significance import is_significant

SETTLED_SIGMAS = 1.0  # movement of the unknowns in a further step that still leaves the result what it is
LARGE_RESIDUALS, RUINED_RESIDUALS = 3.0, 10.0  # times what measurement and camera explain
FAR_SIGMAS, RUINED_SIGMAS = 5.0, 15.0  # of a correction from zero, in its prior's standard deviations
COARSE_FIT_PX, RUINED_FIT_PX = 0.1, 1.0
GRANTED = Priors(shift_px=20.0, drift=2e-4)  # standard deviations that any RPC may have
LEAST_PRIOR_SHARE = 1e-12  # of a parameter from its prior, below which its prior cannot be told from the share


def find_divergence(evidence: Evidence) -> Iterator[Reason]:
    """The iterations stopped at their limit: how far a further step would still have moved the unknowns.

    Half of what the weighted sum of squares would fall by is half the squared length of the step in sigmas.
    """
    result = evidence.result
    if result.converged:
        return
    still = 2.0 * result.history[-1].predicted_decrease if result.history else np.inf
    moving = np.sqrt(max(still, 0.0)) / max(result.sigma0, 1.0)
    level = Level.UNUSABLE if not moving < SETTLED_SIGMAS else Level.DOUBTFUL
    distance = f": another step would move the unknowns by {moving:.2g} sigma" if np.isfinite(moving) else ""
    yield Reason(
        "not-converged", level, f"the adjustment {result.status}{distance}",
        "look for wrong points and wrong images first; then choose a model of fewer parameters",
    )  # fmt: skip


def find_large_sigma0(evidence: Evidence) -> Iterator[Reason]:
    """Residuals that are much larger than the sigmas of the observations and the cameras' own errors explain."""
    result = evidence.result
    stated, adjusted = float(np.median(result.block.measurements.sigma_px)), float(np.median(result.sigma_px))
    sigma0 = result.sigma0 * adjusted / stated  # of the sigmas as they were given, should they have been estimated
    if not is_significant(sigma0**2 * result.redundancy, result.redundancy):
        return
    needed, allowed = sigma0 * stated, float(np.hypot(stated, CAMERA_PX))
    if needed < LARGE_RESIDUALS * allowed:
        return
    yield Reason(
        "residuals-too-large",
        Level.UNUSABLE if needed >= RUINED_RESIDUALS * allowed else Level.DOUBTFUL,
        f"sigma0 is {sigma0:.2g}: residuals are that many times as large as the sigmas of the observations let "
        f"expect; image points would need a sigma of {needed:.2g} px instead of {stated:.2g} px",
        "look for wrong points (the outliers of the report) and for a model that follows the images better; if the "
        "points are no better than that, state their sigmas as they are",
    )


def find_large_corrections(evidence: Evidence) -> Iterator[Reason]:
    """Corrections that no satellite's RPC needs: wrong points bend the images to them."""
    result = evidence.result
    sigma = prior_sigmas(evidence)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(sigma > 0.0, np.abs(result.values) / sigma, 0.0)
    far = np.nan_to_num(far)
    for level, low, high in ((Level.UNUSABLE, RUINED_SIGMAS, np.inf), (Level.DOUBTFUL, FAR_SIGMAS, RUINED_SIGMAS)):
        largest = far.max(axis=1, initial=0.0)
        images = np.flatnonzero((largest >= low) & (largest < high))
        if not len(images):
            continue
        worst = int(images[np.argmax(largest[images])])
        parameter = int(np.argmax(far[worst]))
        ids = tuple(result.block.images[index].id for index in images.tolist())
        yield Reason(
            "correction-too-large", level,
            f"the correction of image {list_ids(ids)} is larger than any error of its RPC: "
            f"{result.model.parameters[parameter]} of {result.block.images[worst].id} is "
            f"{result.values[worst, parameter]:.3g}, {far[worst, parameter]:.0f} times what is expected "
            f"({sigma[worst, parameter]:.2g})",
            "check that the points belong to these images (coordinates, columns, ids, datum), and that the RPCs belong "
            "to the pixels",
            images=ids,
        )  # fmt: skip


def prior_sigmas(evidence: Evidence) -> np.ndarray:
    """Return the prior standard deviation of each parameter, ``(images, p)``; 0 where it was not free.

    An adjustment keeps how much of a parameter came from its prior, weight times variance: the prior follows from it.
    Where it does not (images refined one by one) the model's own priors count. Without GCPs the prior is a guess that
    holds the block, and real products miss it: no correction below `GRANTED` is strange.
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
        told = np.isfinite(kept) & (share > LEAST_PRIOR_SHARE)
        prior = (
            kept
            if told.all()
            else np.where(told, kept, result.model.prior_sigmas(image, select_priors(image, controlled)))
        )
        sigma[index] = np.where(prior > 0.0, np.maximum(prior, result.model.prior_sigmas(image, GRANTED)), 0.0)
    return sigma


def find_refit_errors(evidence: Evidence) -> Iterator[Reason]:
    """A refined RPC that does not do what its model does."""
    block = evidence.result.block
    fit = np.array([one.fit_max_px for one in evidence.refined])
    for level, low, high in ((Level.UNUSABLE, RUINED_FIT_PX, np.inf), (Level.DOUBTFUL, COARSE_FIT_PX, RUINED_FIT_PX)):
        images = np.flatnonzero(~(fit < low) & ~(fit >= high))
        if len(images):
            ids = tuple(block.images[index].id for index in images.tolist())
            yield Reason(
                "rpc-unlike-model", level,
                f"the refined RPC of image {list_ids(ids)} differs from its model by up to {fit[images].max():.2g} px",
                "choose a model of fewer parameters: an RPC cannot follow this correction",
                images=ids,
            )  # fmt: skip


ON_SOLUTION = (find_divergence, find_large_sigma0, find_large_corrections, find_refit_errors)
