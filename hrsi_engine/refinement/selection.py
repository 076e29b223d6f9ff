"""Selection of the refinement model that the GCPs support, and detection of GCPs that are blunders.

**Model (rule auto).** Each candidate is tested by leave-one-out prediction: each GCP is predicted from the others. The
simplest candidate is taken whose mean squared prediction error is not significantly larger than the smallest one, by a
one-sided paired t-test of the points' errors at `SELECTION.significance` (in the spirit of the "one standard error"
rule; Breiman et al. 1984, CART, section 3.4.3). A model with more parameters fits the GCPs more closely but may predict
worse, which this test shows without check points. A candidate is tested if each image has twice the GCPs that it needs;
the generic method only if no other candidate predicts within `SELECTION.expected_error` sigmas. If no tested model
predicts within `SIGNIFICANCE.certain` sigmas, the generic method, which has a satellite's priors, is taken from 3 GCPs
on if it predicts better. Where it is tested, it must predict within that limit: otherwise the GCPs are wrong.

**Rule generic** is the thesis's (section 4.3): by the number of GCPs, constants below 3, linear terms from 3, all terms
from 50. From 4 GCPs it is an upper limit here: constants are kept where they predict as well.

**Blunders.** For each model the worst GCP is removed repeatedly and tested against the remaining ones: with q the
squared prediction error normalised by its covariance, q / 2 over the variance of unit weight without the point has
Fisher's F distribution. All GCPs up to the last significant one count as blunders (Rosner 1983, Technometrics 25(2):
two blunders do not mask each other). A GCP is suspect only if it is an outlier of *every* model with enough redundancy,
because an outlier of the shift model may be the effect of a drift.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy import special  # not scipy.stats, which takes a quarter of a second to load

from ..block.block import Block, Image, Role
from ..foundation.errors import SolveError
from ..foundation.large_arrays import finite_rows
from ..foundation.robust_scale import ROBUST
from ..foundation.thresholds import MEMORY, REDUNDANCY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from .estimate import Control, Estimate, estimate
from .models import MODELS

#: Candidates of `auto`, the simplest first.
CANDIDATE_MODELS = ("shift", "shift-drift", "affine", "generic-affine")
#: Candidates of `generic` from 4 GCPs on; from 50 the last is "generic-full".
GENERIC_CANDIDATES = ("generic-position", "generic-shift", "generic-affine")
#: Models with which GCPs are tested for blunders.
JUDGES = ("shift", "shift-drift", "conformal", "affine", "generic-affine")


@thresholds
class SELECTION:
    """Limits for the choice of a model by GCPs, and for the detection of wrong GCPs."""

    expected_error: float = threshold(2.0, "sigma", "RMS prediction error of a good model", "accuracy_blunders.md")
    significance: float = threshold(
        0.05,
        "",
        "significance level at which a model with more parameters predicts better",
        "Breiman et al. 1984, one standard error rule",
    )
    many_gcps: int = threshold(50, "GCPs", "fewest for all terms of the generic method", "thesis, section 4.3")


WITHOUT_CONTROL = "shift"
DISTORTED = "generic-affine"  # taken if simpler models are refuted and no other can be tested
#: Models nested in `DRIFTING`: with the standard deviation of the drift estimated from the block
#: (`adjustment.drift_prior`), `DRIFTING` replaces each of them and no choice is needed.
NESTED_MODELS, DRIFTING = ("shift", "shift-drift", "affine"), "affine"


class SuspectGcp(NamedTuple):
    """A GCP that contradicts the others: prediction error in px, and test statistic divided by its critical value."""

    id: str
    image: str
    deviation_px: float
    statistic: float


@dataclass(frozen=True)
class ModelChoice:
    """A selected model and the reason for it.

    scores : RMS leave-one-out prediction error of each candidate (px, 2D), None if it could not be tested
    drift_unknown : True if the GCPs do not determine a drift: its estimation begins at the sensor's prior
    delivered : RMS leave-one-out prediction error (px, 2D) by the adjustment of the block with its priors, of the final
        model and of those nested in it
    """

    model: str
    reason: str
    scores: Mapping[str, float | None] = field(default_factory=dict)
    suspects: tuple[SuspectGcp, ...] = ()
    warnings: tuple[str, ...] = ()
    drift_unknown: bool = False
    delivered: Mapping[str, float] = field(default_factory=dict)


Controls = Sequence[tuple[Image, Control]]


def select_control(block: Block, image: int, role: Role) -> Control:
    """Return the points of a role (GCPs, check points, …) that were measured on an image (by index)."""
    rows, points = block.measurements, block.points
    indices = np.flatnonzero((points.role[rows.point] == role) & (rows.image == image))
    point = rows.point[indices]
    return Control(
        points.ground[point], rows.xy[indices], points.ids[point], rows.sigma_px[indices], points.sigma_m[point]
    )


def choose_model(block: Block, rule: str = "auto", drift_held: bool = True) -> ModelChoice:
    """Return the model for a block; a shift if the GCPs support no other one.

    Parameters
    ----------
    block : Block
        The block with its GCPs.
    rule : str
        One of `RULES`.
    drift_held : bool
        True if the adjustment constrains the drift by its estimated or given standard deviation.

    Returns
    -------
    ModelChoice
        The model, the reason for it and the suspected GCPs.
    """
    rows, points = block.measurements, block.points
    located = ((points.role == Role.GCP) & finite_rows(points.sigma_m))[rows.point]  # surveyed in plan and height
    with_gcps = np.unique(rows.image[located]).tolist()
    sample = block.with_measurements(located)  # leaves out millions of tie points
    choice = RULES[rule]([(block.images[index], select_control(sample, index, Role.GCP)) for index in with_gcps])
    if not drift_held or rule != "auto" or choice.model not in NESTED_MODELS:
        return choice
    # Do the block's points determine the drift of its images?
    rays, is_gcp = block.rays_per_point(), points.role == Role.GCP
    holds = ((rays >= 2) & (points.role == Role.TIE)) | (is_gcp & (rays >= 1))
    holding_rows, exposure = holds[rows.point], block.exposure_of_image
    per_exposure = np.bincount(exposure[rows.image[holding_rows]], minlength=exposure.max() + 1)
    observed = 2 * int(holding_rows.sum()) + 3 * int((holds & is_gcp).sum())
    unknown = 3 * int(holds.sum()) + len(MODELS[DRIFTING].parameters) * len(per_exposure)
    sufficient = (per_exposure >= SAMPLES.redundant).all() and observed >= unknown
    if not sufficient or not can_estimate_drift(len(rows), len(block.images)):
        return choice
    reason = (
        "the standard deviation of the attitude drift is estimated from the block (variance component); "
        f"{choice.reason}"
    )
    return replace(choice, model=DRIFTING, reason=reason, drift_unknown=choice.model == WITHOUT_CONTROL)


def can_estimate_drift(measurements: int, images: int) -> bool:
    """Return True if the drift's standard deviation can be estimated: with more measurements it is overestimated."""
    return measurements <= MEMORY.rows * images


def choose_by_number(controls: Controls) -> ModelChoice:
    """Rule ``generic``: by the number of GCPs on the image with fewest, or a simpler model that predicts as well."""
    suspects, warnings, clean = _exclude_suspects(controls)
    count = min((len(control) for _, control in clean), default=0)
    if count < SAMPLES.plane:
        reason = (
            f"{_count_gcps(count)}: with fewer than {SAMPLES.plane} only constants of position, roll and "
            "pitch are estimated"
        )
        return ModelChoice("generic-shift", reason, {}, suspects, warnings)
    is_few = count < SELECTION.many_gcps
    largest = "generic-affine" if is_few else "generic-full"
    smallest = SAMPLES.plane if is_few else SELECTION.many_gcps
    reason = f"{_count_gcps(count)}: from {smallest} corrections linear in the image"
    errors = {name: _predict_if_redundant(name, clean, 1).squared for name in (*GENERIC_CANDIDATES[:-1], largest)}
    if errors[largest] is None:
        return ModelChoice(largest, reason, {}, suspects, warnings)
    model, said = select_simplest(errors)
    return ModelChoice(model, f"{reason}; {said}", _compute_scores(errors), suspects, warnings)


def choose_by_prediction(controls: Controls) -> ModelChoice:
    """Rule ``auto``: see the module's docstring."""
    if not controls:
        return ModelChoice(WITHOUT_CONTROL, "without GCPs only a shift of each image is determined")
    suspects, warnings, clean = _exclude_suspects(controls)
    count = min(len(control) for _, control in clean)
    result: dict[str, Prediction] = {}
    for name in CANDIDATE_MODELS:
        if name == DISTORTED and any(one.sigmas < SELECTION.expected_error for one in result.values()):
            result[name] = Prediction(None)
        else:
            result[name] = _predict_if_redundant(name, clean, MODELS[name].least_points)
    errors = {name: one.squared for name, one in result.items()}
    if all(squared is None for squared in errors.values()):
        reason = f"{_count_gcps(count)} on an image determine only a shift"
        return ModelChoice(WITHOUT_CONTROL, reason, {}, suspects, warnings)
    model, reason = select_simplest(errors)
    candidates = {name: None if name == DISTORTED else squared for name, squared in errors.items()}
    explained = model != DISTORTED or result[model].sigmas <= SIGNIFICANCE.certain
    if not explained and any(squared is not None for squared in candidates.values()):
        model, reason = select_simplest(candidates)  # some GCPs are wrong, and are to be detected
    refused = [f"{name} {one.refused}" for name, one in result.items() if one.refused]
    reason += "".join(f"; {said}" for said in refused)
    sigmas = result[model].sigmas
    # Only a model with too few GCPs for a test may be taken without one, not a model without a minimum.
    unjudged = errors[DISTORTED] is None and not result[DISTORTED].refused
    if unjudged and count >= SAMPLES.plane and sigmas > SIGNIFICANCE.certain:
        distorted, simple = _predict_by_leave_one_out(DISTORTED, clean).squared, errors[model]
        if distorted is not None and simple is not None and distorted.sum() < simple.sum():
            reason = (
                f"{_count_gcps(count)}: errors of {model} are {sigmas:.0f} sigmas, and more complex models cannot be "
                f"tested; {reason}"
            )
            model = DISTORTED
    return ModelChoice(model, reason, _compute_scores(errors), suspects, warnings)


def _exclude_suspects(
    controls: Controls,
) -> tuple[tuple[SuspectGcp, ...], tuple[str, ...], list[tuple[Image, Control]]]:
    """Return the suspects, warnings, and the GCPs of each image without the suspects."""
    suspects = [suspect for image, control in controls for suspect in find_suspects(image, control)]
    warnings = []  # for images with too few GCPs to detect a wrong one
    for image, control in controls:
        if len(control) == 1:
            warnings.append(f"{image.id}: no other GCP controls {control.ids[0]}: an error in it cannot be detected")
        result = _estimate_or_none("shift", image, control) if 1 < len(control) <= SAMPLES.plane else None
        if result is not None and _normalize_errors(result).max() > SIGNIFICANCE.certain:
            distance = float(np.linalg.norm(result.left_out_px, axis=1).max())
            warnings.append(
                f"{image.id}: the GCPs {', '.join(control.ids.tolist())} contradict each other by up to "
                f"{distance:.1f} px "
                "after a shift; these are too few to decide whether one is wrong or the image is distorted: measure "
                "more GCPs"
            )
    suspect_keys = {(suspect.image, suspect.id) for suspect in suspects}
    clean = [
        (image, control.select(np.array([(image.id, name) not in suspect_keys for name in control.ids.tolist()])))
        for image, control in controls
    ]
    return tuple(suspects), tuple(warnings), clean


def _compute_scores(errors: Mapping[str, np.ndarray | None]) -> dict[str, float | None]:
    return {name: None if e is None else float(np.sqrt(np.mean(e))) for name, e in errors.items()}


#: Rules that choose a model, by the name of the option `model`.
RULES: dict[str, Callable[[Controls], ModelChoice]] = {"auto": choose_by_prediction, "generic": choose_by_number}


# ---- prediction ----------------------------------------------------------------------------------------------------


class Prediction(NamedTuple):
    """Leave-one-out prediction errors of all GCPs by a model.

    squared : (n,) squared errors in px², None if the model was not tested; refused : reason why it has no solution
    sigmas : RMS error (2D) in standard deviations
    """

    squared: np.ndarray | None
    refused: str = ""
    sigmas: float = np.inf


def _predict_if_redundant(name: str, controls: Controls, spare: int) -> Prediction:
    """Return the prediction by a model; an empty one with fewer than ``spare`` GCPs more than it needs."""
    smallest = MODELS[name].least_points + max(spare, 1)
    if any(len(control) < smallest for _, control in controls):
        return Prediction(None)
    return _predict_by_leave_one_out(name, controls)


def _predict_by_leave_one_out(name: str, controls: Controls) -> Prediction:
    """Return the prediction of each GCP from the others (and from the priors, if these are too few)."""
    errors, in_sigmas = [], []
    for image, control in controls:
        try:
            result = estimate(MODELS[name], image, control)
        except SolveError:
            return Prediction(None, f"has no solution on {image.id}")
        if not result.converged:
            return Prediction(None, f"{result.status} on {image.id}")
        errors.append(np.sum(result.left_out_px**2, axis=1))
        in_sigmas.append(_normalize_errors(result))
    return Prediction(np.concatenate(errors), "", float(np.sqrt(np.mean(np.concatenate(in_sigmas) ** 2))))


def select_simplest(errors: Mapping[str, np.ndarray | None], standard_errors: float | None = None) -> tuple[str, str]:
    """Return the simplest model that predicts as well as the best one, and the reason as text.

    ``errors`` are squared errors by model, the simplest first. A model predicts as well if it is not significantly
    worse, or within the given number of ``standard_errors`` of the difference.
    """
    judged = {name: e for name, e in errors.items() if e is not None}
    best = min(judged, key=lambda name: float(np.mean(judged[name])))
    for name, squared in judged.items():
        excess = squared - judged[best]
        standard_error = float(np.std(excess, ddof=1) / np.sqrt(len(excess))) if len(excess) > 1 else 0.0
        quantile = float(-special.stdtrit(max(len(excess) - 1, 1), SELECTION.significance))
        allowed = standard_error * (quantile if standard_errors is None else standard_errors)
        if float(np.mean(excess)) <= allowed:
            rms = {key: np.sqrt(np.mean(squared)) for key, squared in judged.items()}
            said = f"leave-one-out error of the GCPs: {name} {rms[name]:.3f} px"
            if name != best:
                method = "not significantly" if standard_errors is None else "within one standard error"
                said += f"; {best} {rms[best]:.3f} px is better, but {method}"
            alternatives = [f"{key} {value:.3f}" for key, value in rms.items() if key not in (name, best)]
            return name, said + (f"; others {', '.join(alternatives)} px" if alternatives else "")
    raise AssertionError("the best model is as good as itself")


def _count_gcps(count: int) -> str:
    return f"{count} GCP" + ("" if count == 1 else "s")


# ---- blunders ------------------------------------------------------------------------------------------------------


def find_suspects(image: Image, control: Control) -> list[SuspectGcp]:
    """Return the GCPs of an image that are blunders by every model with enough redundancy, the worst first."""
    verdicts: list[dict[int, tuple[float, float]]] = []  # index -> (deviation px, statistic over critical value)
    for name in JUDGES:
        left = np.arange(len(control))
        removed: list[tuple[int, tuple[float, float]]] = []
        failed = 0
        for _ in range(max(1, (len(control) - 1) // 3)):
            result = _estimate_or_none(name, image, control.select(left))
            if result is None or result.redundancy - 2.0 < REDUNDANCY.estimated:
                break
            # The GCP with the largest F statistic, and the statistic over its critical value, of F(2, redundancy - 2)
            whitened, predicted = (
                np.einsum("nij,nj->ni", result.roots, residual) for residual in (result.residual_px, result.left_out_px)
            )
            q, freedom = np.sum(whitened * predicted, axis=1), result.redundancy - 2.0
            remaining = np.maximum(result.sigma0**2 * result.redundancy - q, 1e-12) / freedom
            critical = 1.0 / special.fdtri(freedom, 2, SIGNIFICANCE.false_alarm / len(control))
            worst = int(np.argmax(q / remaining))
            ratio = float(q[worst] / 2.0 / remaining[worst] / critical)
            deviation = float(np.linalg.norm(result.left_out_px[worst]))
            removed.append((int(left[worst]), (deviation, ratio)))
            if ratio > 1.0 and _normalize_errors(result)[worst] > ROBUST.outlier:
                failed = len(removed)
            left = np.delete(left, worst)
        if removed and not failed:  # no blunder by this model: the others, which take longer, are not needed
            return []
        verdicts += [dict(removed[:failed])] if removed else []  # models without enough redundancy are not counted
    if not verdicts:
        return []
    common = set(verdicts[0]).intersection(*verdicts[1:])
    suspects = [SuspectGcp(str(control.ids[k]), image.id, *min(verdict[k] for verdict in verdicts)) for k in common]
    return sorted(suspects, key=lambda suspect: -suspect.deviation_px)


def _estimate_or_none(name: str, image: Image, control: Control) -> Estimate | None:
    if len(control) <= MODELS[name].least_points:
        return None
    try:
        result = estimate(MODELS[name], image, control)
    except SolveError:
        return None
    return result if result.converged else None


def _normalize_errors(result: Estimate) -> np.ndarray:
    return np.linalg.norm(np.einsum("nij,nj->ni", result.roots, result.left_out_px), axis=1)
