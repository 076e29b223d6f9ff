"""Reasons for surveyed points that do not fit their images, with the input error that explains the misfit, if any.

Each typical mistake (`mistakes`) is corrected and the points are fitted again. It is named if everything fits then,
and clearly better than with every other correction. Otherwise the reason states the misfit without a cause.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..block.points import Role
from ..foundation.errors import list_ids
from ..foundation.reasons import Level, Reason
from ..foundation.robust_scale import ROBUST
from ..foundation.thresholds import EQUALITY, SIGNIFICANCE, threshold, thresholds
from .accuracy import ACCURACY
from .control import (
    CONTROL_FIT,
    ControlFit,
    ControlMeasurements,
    InconsistentPoints,
    compute_sightlines,
    find_disagreement,
    fit_control,
)
from .identities import find_image_permutation, find_point_permutation
from .mistakes import PIXEL_MISTAKES, RPC_MISTAKES, Mistake, estimate_common_lift, iterate_ground_mistakes
from .ties import TIE_CHECK


@thresholds
class MISTAKE:
    """Limits for naming a typical input error (a mistake) as the cause of a misfit of the surveyed points."""

    fewest_points: int = threshold(2, "points", "fewest points that can prove an input error")
    least_cost: float = threshold(
        22.0, "", "smallest decrease of the cost by an input error: by chance 1 in 10 000", "theory: likelihood ratio"
    )
    wrong_share: float = threshold(0.25, "", "share of GCPs, or of all points, whose errors make surveys unusable")


#: Input errors of heights, which the data hardly distinguish: only the likeliest is named.
HEIGHT_CODES = {"height-unit", "height-offset", "height-datum"}
#: Input errors of image coordinates that differ from an image shift only in how the misfit changes over the image.
SHIFTING_CODES = {"image-axes", "image-scale"}


@dataclass(frozen=True, eq=False)
class MistakeHypothesis:
    """An input error that may have been made, and the fit with it corrected.

    points, images : indices of the points and images that have it, None for all
    """

    mistake: Mistake
    fit: ControlFit
    points: np.ndarray | None = None
    images: np.ndarray | None = None

    @property
    def cost(self) -> float:
        """Cost of the fit, plus the extra cost of an input error with estimated parameters (`Mistake.burden`)."""
        return self.fit.cost + self.mistake.burden


def find_control_reasons(control: ControlMeasurements) -> list[Reason]:
    """Return the reasons for surveyed points of a block that do not fit their images; empty where all fit."""
    control_fit = fit_control(control)
    disagreement = find_disagreement(control_fit)
    # In a correct block this is hardly ever true: the search for input errors is not needed there
    lift, sigma = estimate_common_lift(control_fit.control, control_fit.shift_m)
    suspicious = (
        not control_fit.fits
        or bool((control_fit.scatter > CONTROL_FIT.usual_scatter).any())
        or bool((control_fit.shift_sigmas > ROBUST.outlier).any())
        or (sigma > 0.0 and abs(lift / sigma) > ROBUST.outlier)
    )
    if not suspicious and disagreement is None:
        return []
    named_mistake, datum, rivals = _find_best_mistake(control, control_fit)
    if named_mistake is not None:
        points = control.points if named_mistake.points is None else named_mistake.points
        images = control.images if named_mistake.images is None else named_mistake.images
        where = "" if named_mistake.images is None else f" on image {list_ids(control.image_ids(images))}"
        return [
            Reason(
                named_mistake.mistake.code,
                Level.UNUSABLE,
                f"{named_mistake.mistake.what}{where}: the median distance of the ground points from their positions "
                f"by the RPCs is {_format_median_distance(control_fit, images)}, and "
                f"{_format_median_distance(named_mistake.fit, images)} after correction",
                named_mistake.mistake.advice,
                control.image_ids(images),
                control.point_ids(points),
            )
        ]
    if disagreement is not None:
        single = _find_mistake_of_points(control, control_fit, disagreement)
        return [_make_disagreement_reason(control, disagreement) if single is None else single]
    if not control_fit.fits:
        return [_make_misfit_reason(control, control_fit, rivals)]
    reasons = _find_large_shifts(control, control_fit, datum)
    if sigma > 0.0 and abs(lift) >= SIGNIFICANCE.certain * sigma:
        reasons.append(
            Reason(
                "height-offset",
                Level.DOUBTFUL,
                f"the heights of the ground points seem to be {abs(lift):.0f} m too {'high' if lift > 0.0 else 'low'} "
                f"(standard deviation {sigma:.0f} m), according to images from different directions",
                "check the height datum (`height_datum`) and the unit of the heights",
                control.image_ids(control.images),
                control.point_ids(control.points),
            )
        )
    return reasons


# ---- the mistake that explains -------------------------------------------------------------------------------------


def _find_best_mistake(
    control: ControlMeasurements, control_fit: ControlFit
) -> tuple[MistakeHypothesis | None, MistakeHypothesis | None, list[MistakeHypothesis]]:
    """Return the input error that explains the misfit clearly better than every other, or None; then datum and rivals.

    A single point proves no input error: nearly every one would explain it. The second value is a horizontal datum that
    may be wrong; the third lists all errors that explain the misfit, the likeliest first, if none is named.

    A wrong datum moves all points equally, as a biased RPC does. A datum in use at a place often has nearly the shift
    of such a bias: it is named only if the shift is too large for a bias, otherwise it is the second value.
    """
    best: dict[str, MistakeHypothesis] = {}
    for reading in _iterate_hypotheses(control, control_fit):
        code, fit = reading.mistake.code, reading.fit
        images = control.images if reading.images is None else reading.images
        if code in SHIFTING_CODES and (control_fit.scatter[images] <= CONTROL_FIT.usual_scatter).all():
            continue  # a shift explains all: of a crop, of a biased RPC, or of a single point
        # all points fit as in a correct block, and the misfit has become clearly smaller
        largest, shift_before = float(fit.shift_sigmas.max()), float(control_fit.shift_sigmas.max())
        good_shift = largest < max(SIGNIFICANCE.certain, EQUALITY.alike * shift_before)
        explains = control_fit.cost - reading.cost > MISTAKE.least_cost and fit.fits and good_shift
        if explains and (code not in best or reading.cost < best[code].cost):
            best[code] = reading
    biased = bool((control_fit.shift_length_m <= control.get_figures("biased_m")).all())
    datum = best.pop("horizontal-datum", None) if biased else None
    ranked = sorted(best.values(), key=lambda reading: reading.cost)
    rivals = [reading for reading in ranked[1:] if not {reading.mistake.code, ranked[0].mistake.code} <= HEIGHT_CODES]
    beaten = not rivals or rivals[0].cost - ranked[0].cost >= SIGNIFICANCE.decisive
    if not ranked or not beaten or len(control.points) < MISTAKE.fewest_points:
        return None, datum, ranked
    return ranked[0], datum, []


def _iterate_hypotheses(control: ControlMeasurements, control_fit: ControlFit) -> Iterator[MistakeHypothesis]:
    """Yield every input error, corrected; those of image coordinates on all images, or only where these do not fit."""
    is_far = bool((control_fit.shift_sigmas > ROBUST.outlier).any())
    for mistake, ground in iterate_ground_mistakes(control, control_fit.shift_m, is_far):
        yield MistakeHypothesis(mistake, fit_control(control, ground))
    misfitting = control.images[~control_fit.fitting[control.images]]
    for image_subset in (misfitting, None) if 0 < len(misfitting) < len(control.images) else (None,):
        for mistake, undo in PIXEL_MISTAKES:
            yield MistakeHypothesis(
                mistake, _fit_without_pixel_mistake(control, undo, image_subset), images=image_subset
            )
        for mistake, change in RPC_MISTAKES:
            block = control.block
            chosen = control.images if image_subset is None else image_subset
            images = [
                replace(image, rpc=change(image.rpc)) if index in chosen else image
                for index, image in enumerate(block.images)
            ]
            rays = compute_sightlines(images, control.image, control.xy)
            yield MistakeHypothesis(mistake, fit_control(control, rays=rays), images=image_subset)
    suspects = misfitting if len(misfitting) > 1 else control.images
    permuted = find_image_permutation(control, suspects)
    if permuted is not None:
        changed = np.unique(control.image[permuted[0] != control.image])
        owner, names = permuted[0].tolist(), control.block.images
        pairs = sorted({(a, b) for a, b in zip(control.image.tolist(), owner, strict=True) if a != b})
        text = ", ".join(f"{names[a].id} are of {names[b].id}" for a, b in pairs[:4])
        message = f"image ids of measurements are exchanged: those on {text}"
        mistake = Mistake("ids-permuted", message, "correct the field 'image', or exchange the RPCs", 4.0)
        yield MistakeHypothesis(
            mistake, fit_control(replace(control, image=permuted[0], sights=permuted[1])), images=changed
        )
    owners = find_point_permutation(control)
    if owners is not None:
        points = control.points
        survey = control.block.points.ground[points[owners]]
        is_exchanged = owners != np.arange(len(points))
        mistake = Mistake(
            "ids-permuted",
            _describe_point_exchange(control.block.points.ids[points], owners),
            "correct the ids of these points",
            4.0,
        )
        yield MistakeHypothesis(
            mistake, fit_control(control, survey[np.searchsorted(points, control.point)]), points=points[is_exchanged]
        )


def _fit_without_pixel_mistake(
    control: ControlMeasurements, undo: Callable[..., np.ndarray], image_subset: np.ndarray | None
) -> ControlFit:
    xy = control.xy.copy()
    for index in control.images if image_subset is None else image_subset:
        rows = control.image == index
        xy[rows] = undo(control.xy[rows], control.block.images[index])
    rows = np.any(xy != control.xy, axis=1)
    if not rows.any():
        return fit_control(control)
    fresh = compute_sightlines(control.block.images, control.image[rows], xy[rows])
    return fit_control(control, rays=control.sights.replace(rows, fresh))


def _describe_point_exchange(ids: np.ndarray, owners: np.ndarray) -> str:
    exchanged = np.flatnonzero(owners != np.arange(len(owners)))
    text = ", ".join(f"{ids[a]} is {ids[owners[a]]}" for a in exchanged[:4])
    return f"ids of ground points are exchanged: the measured point {text}{' …' if len(exchanged) > 4 else ''}"


# ---- reasons -------------------------------------------------------------------------------------------------------


def _format_median_distance(read: ControlFit, images: np.ndarray | None = None) -> str:
    """Return the median distance of points from their rays on images (all by default), as text ``1.2 km (2400 px)``."""
    rows = np.isin(read.control.image, read.control.images if images is None else images)
    distance = np.hypot(*read.distance_m[rows].T)
    pixels = distance / read.control.get_figures("gsd_m")[read.control.image[rows]]
    return f"{_format_distance(float(np.median(distance)))} ({float(np.median(pixels)):.3g} px)"


def _format_distance(distance: float) -> str:
    return f"{distance / 1e3:.4g} km" if distance >= 2e3 else f"{distance:.3g} m"


def _find_mistake_of_points(
    control: ControlMeasurements, control_fit: ControlFit, disagreement: InconsistentPoints
) -> Reason | None:
    """Return the reason for the points that disagree with the others, if exactly one input error explains them."""
    rows = np.isin(control.point, disagreement.points)
    shift = fit_control(control.select(~rows)).shift_m
    limit = control_fit.agreeing_m[rows] / TIE_CHECK.cured_ratio
    distance_before = np.hypot(*(control_fit.distance_m - shift[control.image])[rows].T)
    if np.median(distance_before / limit) < TIE_CHECK.cured_ratio:
        return None
    fitting: dict[str, Mistake] = {}
    owners = find_point_permutation(control.select(rows))
    if owners is not None:
        points = control.block.points
        survey = points.ground[disagreement.points[owners]][np.searchsorted(disagreement.points, control.point[rows])]
        distance = np.hypot(*(control.sights.select(rows).distance_m(survey) - shift[control.image[rows]]).T)
        if (distance < limit).all():
            fitting["ids-permuted"] = Mistake(
                "ids-permuted",
                _describe_point_exchange(points.ids[disagreement.points], owners),
                "correct the ids of these points",
            )
    for mistake, ground in iterate_ground_mistakes(control, shift, False):
        distance = np.hypot(*(control.sights.distance_m(ground) - shift[control.image])[rows].T)
        # A few points cannot prove a wrong height or a common shift: other errors of heights look the same
        if (distance < limit).all() and mistake.code not in {*HEIGHT_CODES, "horizontal-datum"}:
            fitting.setdefault(mistake.code, mistake)
    for mistake, undo in PIXEL_MISTAKES:
        read = _fit_without_pixel_mistake(control, undo, None)
        if (np.hypot(*(read.distance_m - shift[control.image])[rows].T) < limit).all():
            fitting.setdefault(mistake.code, mistake)
    if len(fitting) != 1:
        return None
    mistake = next(iter(fitting.values()))
    ids = control.point_ids(disagreement.points)
    return Reason(
        mistake.code,
        _choose_level(control, disagreement.points),
        f"ground point {list_ids(ids)}: {mistake.what}",
        mistake.advice,
        control.image_ids(np.unique(control.image[rows])),
        ids,
    )


def _choose_level(control: ControlMeasurements, points: np.ndarray) -> Level:
    """Return unusable if the wrong points (two or more) are a quarter of the GCPs or of all points, else doubtful."""
    gcps = control.points[control.block.points.role[control.points] == Role.GCP]
    is_wrong = np.isin(gcps, points)
    of_gcps = is_wrong.sum() > 1 and is_wrong.sum() >= MISTAKE.wrong_share * len(gcps)
    of_all = len(points) > 1 and len(points) >= MISTAKE.wrong_share * len(control.points)
    return Level.UNUSABLE if of_gcps or of_all else Level.DOUBTFUL


def _make_disagreement_reason(control: ControlMeasurements, apart: InconsistentPoints) -> Reason:
    ids = control.point_ids(apart.points)
    east, north, up = apart.step_m
    images = control.image_ids(np.unique(control.image[np.isin(control.point, apart.points)]))
    count = f"{len(ids)} of {len(control.points)} ground points"
    sides = "east" if east >= 0.0 else "west", "north" if north >= 0.0 else "south"
    off = f"{abs(east):.3g} m {sides[0]} and {abs(north):.3g} m {sides[1]}"
    if np.isfinite(up) and abs(up) > 3.0 * np.hypot(east, north):
        off = f"{abs(up):.3g} m {'above' if up > 0.0 else 'below'}"
    if apart.group:
        return Reason(
            "control-outliers",
            _choose_level(control, apart.points),
            f"{count} ({list_ids(ids)}) have a common offset of {off} from the others: two surveys contradict each "
            "other",
            "find the correct survey (datum, base station, epoch), and remove the other one",
            images,
            ids,
        )
    message = f"{count} ({list_ids(ids)}) contradict the others, by at least {apart.gap:.0f} times their scatter"
    advice = "check measurements, coordinates and ids of these points"
    return Reason("control-outliers", _choose_level(control, apart.points), message, advice, images, ids)


def _make_misfit_reason(control: ControlMeasurements, given: ControlFit, rivals: list[MistakeHypothesis]) -> Reason:
    """Return the reason for a misfit without proven cause; each of ``rivals`` is an input error that explains it."""
    wrong = control.images[~given.fitting[control.images]]
    sigma = max(control.accuracies[index].sigma_m for index in wrong)
    rows = np.isin(control.image, wrong)
    far = (given.shift_length_m > control.get_figures("far_m"))[control.image]
    points = np.unique(control.point[rows & (far | ~given.belongs)])
    alike = given.belongs[rows].mean() > CONTROL_FIT.agreeing_share
    causes = dict.fromkeys(
        f"{one.mistake.what} (then {_format_median_distance(one.fit, one.images)} remain)" for one in rivals
    )
    return Reason(
        "control-implausible",
        Level.UNUSABLE,
        "the median distance of the ground points from their positions by the RPCs of "
        f"{list_ids(control.image_ids(wrong))} is {_format_median_distance(given, wrong)}, "
        + (f"too much for an error of these RPCs (about {sigma:.3g} m); " if alike else "and differs between points; ")
        + (f"possible causes: {', or '.join(causes)}" if rivals else "no frequent input error explains it")
        + (f" (equal for all points: {_format_shifts(control, wrong)})" if alike else ""),
        "check CRS, columns and ids of ground and image points, and that the RPC belongs to these pixels: a crop and "
        "its scene have different RPCs",
        control.image_ids(wrong),
        control.point_ids(points),
    )


def _find_large_shifts(
    control: ControlMeasurements, given: ControlFit, datum: MistakeHypothesis | None
) -> list[Reason]:
    """Return the reason for RPCs whose bias exceeds their stated accuracy, or is too large for a bias at all."""
    figures, size = control.get_figures("ce90_m"), given.shift_length_m
    large = np.flatnonzero(size > control.get_figures("large_m"))
    if not len(large):
        return []
    worst = int(large[np.argmax((size / figures)[large])])
    where = list_ids(control.image_ids(large))
    off = f"{_format_distance(float(size[worst]))}, {size[worst] / figures[worst]:.2g} times the stated accuracy (CE90 "
    off += f"{figures[worst]:.3g} m; {_format_shifts(control, large)})"
    concerned = control.image_ids(large), control.point_ids(np.unique(control.point[np.isin(control.image, large)]))
    if (size > control.get_figures("biased_m")).any():
        unwritten_m = np.maximum(
            control.get_figures("biased_m"), ACCURACY.unwritten_sigmas * control.get_figures("sigma_m")
        )
        level = Level.UNUSABLE if (size > unwritten_m).any() else Level.DOUBTFUL
        message = f"the RPCs of {where} differ from all ground points by {off}: this is more than the bias of an RPC"
        advice = (
            "check the datum of the ground points, and that RPC and image points belong to these pixels, not to a "
            "crop or the scene"
        )
        return [Reason("control-implausible", level, message, advice, *concerned)]
    also = "" if datum is None else f": the same difference occurs if {datum.mistake.what}"
    message = f"the RPCs of {where} have a bias of {off}, equal for all ground points; the GCPs correct it"
    advice = f"check the datum of the ground points{also}"
    return [Reason("rpc-biased", Level.DOUBTFUL, message, advice, *concerned)]


def _format_shifts(control: ControlMeasurements, images: np.ndarray) -> str:
    """Return shifts of three images at most as text, ``-200 px in sample, 300 px in line on img`` (crop origins)."""
    texts = []
    for index in images[:3].tolist():
        rows = control.image == index
        projected = control.block.images[index].rpc.project(control.ground[rows])
        sample, line = np.median(projected - control.xy[rows], axis=0)
        texts.append(f"{sample:+.0f} px in sample, {line:+.0f} px in line on {control.block.images[index].id}")
    return "; ".join(texts)
