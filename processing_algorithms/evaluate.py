"""`evaluate`: accuracy of sets of RPCs, compared on the same tracks, ground points and DEM."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..hrsi_engine.adjustment.evaluation import PairFit, TrackFit, find_wrong_tracks, fit_pairs, fit_tracks
from ..hrsi_engine.adjustment.external.surface_plan import SurfacePlan
from ..hrsi_engine.adjustment.observations import Observations
from ..hrsi_engine.adjustment.statistics.precision import errors_90
from ..hrsi_engine.block.block import Block, Image, Role
from ..hrsi_engine.block.imaging_geometry import compute_footprint
from ..hrsi_engine.block.points import ROLE_LABELS
from ..hrsi_engine.camera.rpc import RPC
from ..hrsi_engine.drawing.plots import draw_bars
from ..hrsi_engine.foundation.errors import IDS_NAMED, InputError
from ..hrsi_engine.foundation.progress import advance
from ..hrsi_engine.foundation.robust_scale import robust_sigma
from ..hrsi_engine.foundation.thresholds import SAMPLES, SIGNIFICANCE
from ..hrsi_engine.ground.geodesy import WGS84
from ..hrsi_engine.io.geopackage.declared_layers import EvaluatedPairRows, EvaluatedResidualRows
from ..hrsi_engine.io.geopackage.layer_styles import Style
from ..hrsi_engine.io.geopackage.layers import Layer, default_styles, write_geopackage
from ..hrsi_engine.io.pages.report import write_page
from ..hrsi_engine.measurement.tie_points import find_overlapping_pairs
from ..hrsi_engine.results.layers import RESIDUAL_LAYERS
from ..hrsi_engine.results.residuals import compute_given_residuals, radial_rmse, rmse
from ..hrsi_engine.results.surface_figures import describe_surface
from ..hrsi_engine.surface.dem import HeightSurface
from ..hrsi_engine.surface.grid_surface import GridSurface
from .block_steps.adjusted_block import rpcs_of_folder
from .block_steps.evaluation_points import EvaluationPoints, read_evaluation_points
from .block_steps.inputs import read_block, refuse_idle_matches
from .block_steps.outputs import Clock
from .block_steps.plausibility import describe_differences, heights_above
from .block_steps.summary import format_digits
from .declarations.rpcs import AUTOMATIC_TRACKS, EVALUATION_FILE, NO_TRACKS, OWN, EvaluateOptions
from .files.opening import dem_surface, open_control_surface, open_images
from .files.result_folder import PAGE_FILE, check_folder, plan_folder, stage_results
from .interface.declare import Context, Report

#: Source, files and RPCs of a set.
CameraSet = tuple[str, Sequence[str], Sequence[RPC]]
#: Figures of surveyed points, and of heights above a DEM, in the summary: keys of the report.
SURVEY_KEYS = (
    "rmse_east_m",
    "rmse_north_m",
    "rmse_height_m",
    "ce90_m",
    "le90_m",
    "rmse_sample_px",
    "rmse_line_px",
)
DEM_KEYS = ("median_m", "nmad_m", "p90_m")
SET_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")  # part of a layer's name


@dataclass(frozen=True, eq=False)
class RpcSet:
    """A set of RPCs: the block with these cameras, the fit of its tracks, and the differences of surveyed points.

    ``made_by`` is the report of the HRSI run that refined them, None if there is none.
    """

    name: str
    source: str
    made_by: str | None
    block: Block
    fit: TrackFit
    pairs: list[PairFit]
    known_px: np.ndarray
    known_m: np.ndarray


def run(options: EvaluateOptions, context: Context) -> Report:
    """Read or find points, fit them with every set of RPCs, and write the results."""
    check_folder(options.folder, context)
    clock = Clock()
    refuse_idle_matches(options.search, options.tracks == AUTOMATIC_TRACKS, "tracks")
    images = open_images(options.images, context)
    cameras = _open_sets(options, images, context)
    surface = dem_surface(options.dem, options.points.height_datum, options.points.gcp_epoch)
    control = open_control_surface(options.surface, options.points, options.surface_kind, images[0].rpc)
    if context.dry_run:
        return _plan_run(options, images, list(cameras), surface, context)
    clock.lap("read")
    files = {name: files for name, (_, files, _) in cameras.items()}
    judges = read_evaluation_points(options, images, surface, files, context)
    block, warnings = judges.block, judges.warnings
    clock.lap("tracks")
    # The same points for all sets: tracks in at least two images that are no outliers for at least one set
    tracks = (block.points.role == Role.TIE) & (block.rays_per_point() >= 2)
    observations, sets = _fit_sets(block, tracks, cameras, judges, context)
    wrong = find_wrong_tracks(observations, [one.pairs for one in sets], options.reject)
    everywhere = np.all([np.isfinite(one.fit.ground).all(axis=1) for one in sets], axis=0)
    kept = everywhere & ~wrong
    predicted = kept[observations.point] & np.all([np.isfinite(one.fit.enlargement) for one in sets], axis=0)
    set_entries = {
        one.name: _set_entry(one, observations, kept, predicted, surface=surface, control=control, options=options)
        for one in sets
    }
    if len(predicted) and (predictions := int(predicted.sum())) < SAMPLES.trend:
        why = "two images have none" if len(images) < 3 else "they need points on three images or more"
        warnings.append(
            f"only {predictions} image points can be predicted from others ({why}): see the pairs and the fit"
        )
    clock.lap("evaluate")
    report: Report = {
        **context.record,
        "seconds": {},
        "tracks": _tracks_entry(observations, kept, wrong, everywhere, judges),
        "sets": set_entries,
        "best": _rank_sets(set_entries, judges.are_independent),
        "warnings": warnings,
        "crs_operations": [use.entry() for use in block.all_operations],
    }
    with stage_results(options.folder, report, context, discarded=judges.discarded) as folder:
        layers, styles = _make_layers(sets, observations, kept, predicted, report)
        write_geopackage(str(folder / EVALUATION_FILE), layers, styles, context.stage(0.9, 0.98).progress)
        clock.lap("write")
        report["seconds"] = clock.total()
        if options.report:
            rmse_px = {
                name: {kind: one[f"{kind}_rmse_px"] or 0.0 for kind in ("predicted", "fit")}
                for name, one in set_entries.items()
            }
            write_page(str(folder / PAGE_FILE), "evaluation.html.j2", report, bars=draw_bars(rmse_px, "px"))
    return report


# ---- input ----------------------------------------------------------------------------------------------------------


def _plan_run(
    options: EvaluateOptions,
    images: Sequence[Image],
    sets: Sequence[str],
    surface: GridSurface | None,
    context: Context,
) -> Report:
    """Return the report of a dry run: pairs are counted, not matched."""
    counts = {"images": len(images), "sets of RPCs": len(sets)}
    warnings: list[str] = []
    if options.tracks == AUTOMATIC_TRACKS:
        counts["overlapping pairs to be matched"] = len(find_overlapping_pairs(images, options.search.search, surface))
    if options.tracks != AUTOMATIC_TRACKS or options.points.gcps or options.points.image_points:
        file = None if options.tracks in (AUTOMATIC_TRACKS, NO_TRACKS) else options.tracks
        block, warnings = read_block(images, options.points, surface, file)
        counts |= {"points": len(block.points), "image points": len(block.measurements)}
    return plan_folder(options.folder, EVALUATION_FILE, counts, warnings, context, options.report)


def _open_sets(options: EvaluateOptions, images: Sequence[Image], context: Context) -> dict[str, CameraSet]:
    """Return source, files and RPCs of each set; the set of the images' own RPCs first, unless one is equal to it."""
    own = [image.rpc for image in images]
    named: dict[str, CameraSet] = {}
    for text in options.rpcs:
        name, _, folder = (part.strip() for part in text.partition("="))
        if not SET_NAME.fullmatch(name) or name == OWN:
            raise InputError(f"`rpcs` {text!r}: choose a name of letters, digits, _ and -, other than {OWN!r}")
        if name in named:
            raise InputError(f"`rpcs` names {name} twice: give each set a name of its own")
        named[name] = folder, *rpcs_of_folder(folder, images, context.log)
    has_own = any(list(rpcs) == own for _, _, rpcs in named.values())
    return named if has_own else {OWN: ("the images", [image.path for image in images], own), **named}


# ---- figures ---------------------------------------------------------------------------------------------------------


def _fit_sets(
    block: Block, tracks: np.ndarray, cameras: Mapping[str, CameraSet], judges: EvaluationPoints, context: Context
) -> tuple[Observations, list[RpcSet]]:
    """Return the observations of the selected ``tracks (points,)``, and their fit by each set of RPCs."""
    sets = []
    for done, (name, (source, _, rpcs)) in enumerate(cameras.items()):
        advance(context.progress, 0.8 + 0.1 * done / len(cameras), f"RPCs {name}")
        seen = block.with_cameras(rpcs)
        observations, fit = fit_tracks(seen, tracks)
        known_px, known_m = compute_given_residuals(seen)
        made_by = judges.makers[name].report if name in judges.makers else None
        pairs = fit_pairs(observations, fit)
        sets.append(RpcSet(name, source, made_by, seen, fit, pairs=pairs, known_px=known_px, known_m=known_m))
    return observations, sets


def _set_entry(
    one: RpcSet,
    observations: Observations,
    kept: np.ndarray,
    predicted: np.ndarray,
    surface: HeightSurface | None,
    control: tuple[GridSurface, float] | None,
    options: EvaluateOptions,
) -> Report:
    """Return the figures of one set of RPCs."""
    fit, used, rays = one.fit, kept[observations.point], np.diff(observations.first)
    length = np.hypot(*fit.predicted_px[predicted].T)
    entry: Report = {
        "source": one.source,
        "made_by": one.made_by,
        "predictions": int(predicted.sum()),
        "predicted_rmse_px": radial_rmse(fit.predicted_px[predicted]),
        "predicted_median_px": float(np.median(length)) if len(length) else None,
        "predicted_p90_px": float(np.percentile(length, 90.0)) if len(length) else None,
        "noise_enlargement": rmse(fit.enlargement[predicted]),
        "fit_rmse_px": radial_rmse(fit.fit_px[used]),
        "fit_by_views": {
            str(k): radial_rmse(fit.fit_px[(kept & (rays == k))[observations.point]])
            for k in np.unique(rays[kept]).tolist()
        },
        "scatter_px": rmse(np.concatenate([np.zeros(0), *(pair.left_px[kept[pair.points]] for pair in one.pairs)])),
        "images": _describe_images(one, observations, used, predicted),
        "pairs": _describe_pairs(one, kept),
        "control": _survey_entry(one, Role.GCP),
        "check": _survey_entry(one, Role.CHECK),
        "dem": None
        if surface is None
        else describe_differences(heights_above(one.fit.ground[kept], surface), ("points", *DEM_KEYS)),
    }
    # Displacement of the tracks from a surface in plan and height, if one is given. displacement_m moves them
    # onto the surface: the error of the RPCs has the opposite sign
    if control is not None:
        found = SurfacePlan.match_points(
            one.block.images,
            control[0],
            np.flatnonzero(kept),
            ground=one.fit.ground,
            sigma_m=control[1],
            kind=options.surface_kind,
            search_m=options.surface_search_m,
        )
        entry["surface"] = None if found is None else describe_surface(found.summarise(np.arange(len(kept))))
    return entry


def _describe_images(one: RpcSet, observations: Observations, used: np.ndarray, predicted: np.ndarray) -> Report:
    """Return for each image the residuals of its points and of their predictions, in pixels."""
    fit, entries = one.fit, {}
    for index, image in enumerate(one.block.images):
        rows = observations.by_image[index]
        rows, foreseen = rows[used[rows]], rows[predicted[rows]]
        mean = fit.predicted_px[foreseen].mean(axis=0) if len(foreseen) else np.full(2, np.nan)
        entries[image.id] = {
            "observations": len(rows),
            "predictions": len(foreseen),
            "fit_rmse_px": radial_rmse(fit.fit_px[rows]),
            "predicted_rmse_px": radial_rmse(fit.predicted_px[foreseen]),
            "predicted_mean_sample_px": mean[0],
            "predicted_mean_line_px": mean[1],
        }
    return entries


def _describe_pairs(one: RpcSet, kept: np.ndarray) -> list[Report]:
    """Return the deviations of the tracks of each pair across their epipolar lines, in pixels."""
    entries = []
    for pair in one.pairs:
        across = pair.across_px[kept[pair.points]]
        if len(across):
            bias = float(np.median(across))
            entries.append(
                {
                    "first": one.block.images[pair.first].id,
                    "second": one.block.images[pair.second].id,
                    "points": len(across),
                    "bias_px": bias,
                    "nmad_px": float(robust_sigma(across - bias)),
                    "rmse_px": rmse(across),
                }
            )
    return entries


def _tracks_entry(
    observations: Observations, kept: np.ndarray, wrong: np.ndarray, everywhere: np.ndarray, judges: EvaluationPoints
) -> Report:
    """Return how many tracks are compared, and on how many images; the masks are of tracks, ``(n,)``."""
    rays = np.diff(observations.first)
    return {
        "points": int(kept.sum()),
        "observations": int(kept[observations.point].sum()),
        "wrong": int(wrong.sum()),
        "without_position": int((~everywhere).sum()),
        "by_views": {str(k): int(np.sum(kept & (rays == k))) for k in np.unique(rays[kept]).tolist()},
        "made_rpcs": judges.left_out,
        "held_out": judges.held_out,
        "independent": judges.are_independent,
    }


def _survey_entry(one: RpcSet, role: Role) -> Report:
    """Return the differences of the surveyed points of a role, in metres on the ground and pixels in the images."""
    points = one.block.points.role == role
    rows = points[one.block.measurements.point]
    known_m = dict(zip(("east_m", "north_m", "height_m"), one.known_m[points].T, strict=True))
    return {
        "points": int(points.sum()),
        **{f"rmse_{axis}": rmse(column) for axis, column in known_m.items()},
        **{
            f"mean_{axis}": float(np.nanmean(column)) if np.isfinite(column).any() else None
            for axis, column in known_m.items()
        },
        **errors_90(*map(rmse, known_m.values())),
        "rmse_sample_px": rmse(one.known_px[rows, 0]),
        "rmse_line_px": rmse(one.known_px[rows, 1]),
    }


def _rank_sets(sets: Mapping[str, Report], independent: bool) -> Report:
    """Return the best set by each figure; None without figures, or if the next best is as good within its accuracy.

    If one of the sets was estimated from the tracks, these give no best set. An RMS value or quantile of n values has
    a relative standard deviation of about 1 / sqrt(2 n).
    """
    keys: dict[str, Callable[[Report], tuple[float | None, int]]] = {
        "predicted": lambda entry: (entry["predicted_rmse_px"] if independent else None, entry["predictions"]),
        "fit": lambda entry: (entry["fit_rmse_px"] if independent else None, entry["predictions"]),
        "check": lambda entry: (entry["check"]["ce90_m"], entry["check"]["points"]),
        "dem": lambda entry: ((entry["dem"] or {}).get("p90_m"), (entry["dem"] or {}).get("points", 0)),
    }
    best: Report = dict.fromkeys(keys)
    for what, key in keys.items():
        figures = {name: value for name, entry in sets.items() if (value := key(entry)[0]) is not None}
        if len(figures) < max(len(sets), 2):
            continue
        first, second = sorted(figures, key=lambda name: figures[name])[:2]
        count = max(key(sets[first])[1], 1)
        if figures[second] > figures[first] * (1.0 + SIGNIFICANCE.sigmas / math.sqrt(2.0 * count)):
            best[what] = first
    return best


# ---- layers ----------------------------------------------------------------------------------------------------------


def _make_layers(
    sets: Sequence[RpcSet], observations: Observations, kept: np.ndarray, predicted: np.ndarray, report: Report
) -> tuple[list[Layer], dict[str, Style]]:
    """Return the layers of footprints with figures, pairs (a table) and residuals of each set; and their styles."""
    images = sets[0].block.images
    ground = np.vstack([sets[0].fit.ground[kept], sets[0].block.points.ground[sets[0].block.known]])
    height = float(np.nanmedian(ground[:, 2])) if len(ground) else images[0].middle_height_m
    columns: dict[str, Any] = {"id": np.array([image.id for image in images])}
    for name, entry in report["sets"].items():
        for key in ("predicted_rmse_px", "fit_rmse_px"):
            values = [entry["images"][image.id][key] for image in images]
            columns[f"{key.removesuffix('_px')}_{name}"] = np.array(values, dtype=np.float64)
    layers = [Layer("images", "Polygon", WGS84, [compute_footprint(image, height) for image in images], columns)]
    if pairs := [{"set": name, **pair} for name, entry in report["sets"].items() for pair in entry["pairs"]]:
        layers.append(Layer("pairs", "None", WGS84, [], EvaluatedPairRows.of_entries(pairs)))
    arrows = [_residual_layer(one, observations, kept, predicted) for one in sets]
    like_block = {layer.name: default_styles([replace(layer, name=RESIDUAL_LAYERS[0])]) for layer in arrows}
    styles = default_styles([*layers, *arrows])
    return [*layers, *arrows], styles | {name: style[RESIDUAL_LAYERS[0]] for name, style in like_block.items()}


def _residual_layer(one: RpcSet, observations: Observations, kept: np.ndarray, predicted: np.ndarray) -> Layer:
    """Return the residuals of one set: of tracks in the images, of known points in the images and on the ground.

    ``residual`` is ``predicted`` (from the other images), ``fit`` (from all images) or ``known`` (a known position).
    """
    block, fit = one.block, one.fit
    rows, names = block.measurements, np.array([image.id for image in block.images])
    tracks = np.flatnonzero(kept[observations.point])
    known = np.flatnonzero(np.isfinite(one.known_px).all(axis=1))
    survey = np.flatnonzero(np.isfinite(one.known_m[:, :2]).all(axis=1))
    point = np.concatenate([observations.points[observations.point[tracks]], rows.point[known], survey])
    told, sizes = predicted[tracks], (len(tracks), len(known), len(survey))
    of_tracks = np.where(told[:, None], fit.predicted_px[tracks], fit.fit_px[tracks])
    pixels = np.vstack([of_tracks, one.known_px[known], np.full((len(survey), 2), np.nan)])
    metres = np.vstack([np.full((sizes[0] + sizes[1], 3), np.nan), one.known_m[survey]])
    fields = EvaluatedResidualRows(
        id=block.points.ids[point],
        role=ROLE_LABELS[block.points.role[point]],
        image=np.r_[names[observations.image[tracks]], names[rows.image[known]], np.full(len(survey), "")],
        level=np.repeat(["image", "ground"], [sizes[0] + sizes[1], sizes[2]]),
        residual=np.concatenate([np.where(told, "predicted", "fit"), np.full(sizes[1] + sizes[2], "known")]),
        residual_sample_px=pixels[:, 0],
        residual_line_px=pixels[:, 1],
        residual_east_m=metres[:, 0],
        residual_north_m=metres[:, 1],
        residual_height_m=metres[:, 2],
        flag=np.full(sum(sizes), "ok"),
    )
    at = np.vstack([fit.ground[observations.point[tracks]], block.points.ground[point[len(tracks) :]]])
    return Layer(f"residuals_{one.name}", "PointZ", WGS84, at, fields)


def summarise(report: Report) -> str:
    """Return a table of the sets of RPCs, with figures by image, the warnings, and the best set."""
    sets, tracks = report["sets"], report["tracks"]
    any_set = next(iter(sets.values()))
    rows = {
        "tracks: predicted RMSE px": [entry["predicted_rmse_px"] for entry in sets.values()],
        "        median px": [entry["predicted_median_px"] for entry in sets.values()],
        "        90 % px": [entry["predicted_p90_px"] for entry in sets.values()],
        "        fit RMSE px": [entry["fit_rmse_px"] for entry in sets.values()],
        "pairs: scatter px": [entry["scatter_px"] for entry in sets.values()],
    }
    parts = [("control", "control", SURVEY_KEYS), ("check", "check", SURVEY_KEYS), ("dem", "above the DEM", DEM_KEYS)]
    rows |= {
        f"{label}: {key.replace('_', ' ')}": [entry[part][key] for entry in sets.values()]
        for part, label, keys in parts
        if any_set[part] is not None and (part == "dem" or any_set[part]["points"])
        for key in keys
    }
    rows |= {
        f"predicted on {name} px": [entry["images"][name]["predicted_rmse_px"] for entry in sets.values()]
        for name in list(any_set["images"])[:IDS_NAMED]
    }
    matched = [entry.get("surface") for entry in sets.values()]
    rows |= {
        label.format(name): [one and one[key][axis] for one in matched]
        for axis, name in enumerate(("east", "north", "up"))
        for label, key in (
            ("to the surface: {} m", "displacement_m"),
            ("        {}: standard deviation m", "sigma_m"),
        )
    }
    width, cell = max(map(len, rows)), max(12, 2 + max(map(len, sets)))
    views = ", ".join(f"{count} on {k}" for k, count in tracks["by_views"].items())
    lines = [
        f"{tracks['points']} tracks ({views} images), {tracks['wrong']} wrong ones left out, "
        f"{any_set['predictions']} predictions"
        if tracks["points"]
        else "no tracks",
        f"{'':<{width}}" + "".join(f"{name:>{cell}}" for name in sets),
    ]
    known = {label: values for label, values in rows.items() if any(value is not None for value in values)}
    for label, values in known.items():
        lines.append(f"{label:<{width}}" + "".join(f"{format_digits(value):>{cell}}" for value in values))
    lines += [f"warning: {text}" for text in report["warnings"]]
    first = next((name for name in report["best"].values() if name), None)
    last = [f"best: {first}"] if len(sets) > 1 and first else []
    if known:
        label, values = next(iter(known.items()))
        told = (f"{name} {format_digits(value)}" for name, value in zip(sets, values, strict=True))
        last = [f"{label}: {', '.join(told)}", *last]
    return "\n".join([*lines, "; ".join(last)]).rstrip()
