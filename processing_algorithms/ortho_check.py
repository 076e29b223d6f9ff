"""`ortho-check`: misregistration between orthoimages, or from a reference, before and after the adjustment."""

import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..hrsi_engine.block.block import Role
from ..hrsi_engine.drawing.block_figures import Picture
from ..hrsi_engine.drawing.block_map import BlockMap, GroundPicture, draw_map
from ..hrsi_engine.foundation.errors import InputError, SolveError, list_ids
from ..hrsi_engine.foundation.progress import advance, stage
from ..hrsi_engine.foundation.reasons import Level, Reason
from ..hrsi_engine.foundation.thresholds import EQUALITY, LISTS, SAMPLES, threshold, thresholds
from ..hrsi_engine.foundation.workers.threads import one_thread_calls, thread_count
from ..hrsi_engine.ground.geodesy import WGS84
from ..hrsi_engine.ground.map_crs import map_epsg_of, project_to_map
from ..hrsi_engine.io.geopackage.declared_layers import MisregistrationRows
from ..hrsi_engine.io.geopackage.layers import Layer
from ..hrsi_engine.io.output_dir import check_output_dir
from ..hrsi_engine.io.pages.report import explain_codes, read_picture
from ..hrsi_engine.io.rasters.ortho_rasters import OrthoRaster, offset_of, open_ortho, resample_to_grid
from ..hrsi_engine.ortho import misregistration
from ..hrsi_engine.results.drawings import LARGEST_PICTURE_PX
from ..hrsi_engine.results.verdict import Verdict
from .declarations.orthoimages import SHIFTS_FILE, SHIFTS_LAYERS, OrthoCheckOptions
from .files.result_folder import plan_folder, tell, write_folder
from .interface.declare import Context, Report


def run(options: OrthoCheckOptions, context: Context) -> Report:
    """Match windows of every overlapping pair and write figures, arrows and maps."""
    check_output_dir(options.folder.output_dir, options.folder.overwrite, inputs=context.inputs)
    pairs, warnings = open_pairs(options)
    if context.dry_run:
        counts = {"orthoimages": len(options.images), "overlapping pairs": len(pairs)}
        return plan_folder(options.folder, SHIFTS_FILE, counts, warnings, context, options.report)
    window_px = options.matching.window_px + options.matching.window_px % 2  # window sides are even
    with one_thread_calls():  # windows are small: BLAS threads would mostly wait for each other
        found = match_pairs(pairs, replace(options.matching, window_px=window_px), context.stage(0.0, 0.9))
    pixel_m = float(np.mean(found[0].pair.base.pixel_m()))
    pooled = {
        state: misregistration.shift_statistics(
            np.concatenate([f.matches[state].shift_px[f.good] for f in found]), pixel_m
        )
        for state in found[0].matches
    }
    warnings += [
        f"{' - '.join(pair.pair.names)}: only {int(pair.good.sum())} of {len(pair.good)} windows could be matched"
        for pair in found
        if pair.good.sum() < SAMPLES.fewest
    ]
    pairs_told = [_pair_entry(pair) for pair in found]
    verdict = _judge(pairs_told, pooled).entry()
    report: Report = {
        **context.record,
        "verdict": verdict,
        "states": list(found[0].matches),
        "pairs": pairs_told,
        "all": pooled,
        "warnings": warnings,
    }
    tell(warnings, context)
    page, drawn = "", {}
    if options.report:
        page, codes = "misregistration.html.j2", [reason["code"] for reason in verdict["reasons"]]
        drawn = {**_draw_maps(found), "explained": explain_codes(codes)}
    write_folder(options.folder, report, SHIFTS_FILE, _make_layers(found), context, page, **drawn)
    return report


def summarise(report: Report) -> str:
    """Return the table of misregistration, before and after the adjustment."""
    entries = [*report["pairs"], report["all"]]
    names = [f"{entry['first']} - {entry['second']}" if "first" in entry else "all pairs" for entry in entries]
    width = max(map(len, names))
    lines = [
        f"{'pair':<{width}}{'windows':>9}"
        + "".join(f"{f'{state} {name}':>18}" for state in report["states"] for name in ("median px", "90 % px"))
    ]
    for name, entry in zip(names, entries, strict=True):
        cells = "".join(
            f"{'-' if entry[state][key] is None else format(entry[state][key], '.3f'):>18}"
            for state in report["states"]
            for key in ("median_px", "p90_px")
        )
        lines.append(f"{name:<{width}}{entry['after']['windows']:>9}{cells}")
    return "\n".join([*lines, *(f"warning: {text}" for text in report["warnings"])])


BEFORE, AFTER = "before", "after"


class PlacedOrtho(NamedTuple):
    """An orthoimage, with column and row of its corner in the first orthoimage, whose grid it has."""

    ortho: OrthoRaster
    offset: tuple[int, int]

    def reader(
        self, area: tuple[int, int, int, int], shift: Sequence[int] | np.ndarray = (0, 0)
    ) -> misregistration.Read:
        """Return a function that reads windows relative to the corner of an area, displaced by ``shift`` (px)."""
        column, row = (np.subtract(area[:2], self.offset) + shift).tolist()
        return lambda x, y, columns, rows: self.ortho.raster.read(x + column, y + row, columns, rows)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two orthoimages by state; ``area`` (first column, first row, columns, rows) is their overlap in ``base``."""

    names: tuple[str, str]
    area: tuple[int, int, int, int]
    states: Mapping[str, tuple[PlacedOrtho, PlacedOrtho]]
    base: OrthoRaster


@dataclass(frozen=True, eq=False)
class PairMatches:
    """A pair with its windows by state, and the common shift around which they were matched."""

    pair: Pair
    matches: Mapping[str, misregistration.WindowShifts]
    common_px: Mapping[str, np.ndarray]

    @property
    def good(self) -> np.ndarray:
        """Mask of the windows that were matched in every state."""
        return np.asarray(np.all([found.good for found in self.matches.values()], axis=0))


def open_pairs(options: OrthoCheckOptions) -> tuple[list[Pair], list[str]]:
    """Return the pairs of overlapping orthoimages, and warnings for the user."""
    paths = list(options.images)
    if options.reference is None and len(paths) < 2:
        raise InputError("one orthoimage has nothing to be compared with: name two or more, or `reference`")
    warnings: list[str] = []
    base = open_ortho(paths[0])
    sets = {AFTER: [_on_base(path, base, warnings) for path in paths]}
    if options.before is not None:
        originals = [os.path.join(options.before, os.path.basename(path)) for path in paths]
        if missing := [path for path in originals if not os.path.exists(path)]:
            raise InputError(f"{missing[0]} does not exist: `before` needs a folder with orthoimages of the same names")
        sets = {BEFORE: [_on_base(path, base, warnings) for path in originals], **sets}
    names = [Path(path).stem for path in paths]
    chosen = list(itertools.combinations(range(len(paths)), 2))
    if options.reference is not None:
        reference = _on_base(options.reference, base, warnings)
        names.append(Path(options.reference).stem)
        sets = {state: [*placed, reference] for state, placed in sets.items()}
        chosen = [(len(paths), k) for k in range(len(paths))]
    pairs = []
    for i, j in chosen:
        states = {state: (placed[i], placed[j]) for state, placed in sets.items()}
        corners = [(one.offset, np.add(one.offset, one.ortho.raster.size)) for both in states.values() for one in both]
        low, high = np.max([first for first, _ in corners], axis=0), np.min([last for _, last in corners], axis=0)
        if (high > low).all():  # in every state
            pairs.append(Pair((names[i], names[j]), (*low.tolist(), *(high - low).tolist()), states, base))
    if not pairs:
        raise InputError("no two of the orthoimages overlap: check their extents")
    return pairs, warnings


def _on_base(path: str, base: OrthoRaster, warnings: list[str]) -> PlacedOrtho:
    """Return an orthoimage on the grid of the first one, resampled if its own grid differs."""
    ortho = open_ortho(path)
    offset = offset_of(base, ortho)
    if offset is not None:
        return PlacedOrtho(ortho, offset)
    warnings.append(
        f"{path} has other pixels than {base.path} and is resampled to them; that smooths it and may shift it by some "
        "hundredths of a pixel"
    )
    return PlacedOrtho(resample_to_grid(ortho, base), (0, 0))


def match_pairs(
    pairs: Sequence[Pair], options: misregistration.MisregistrationOptions, context: Context
) -> list[PairMatches]:
    """Match the windows of all pairs, at equal positions in every state, around the common shift of each pair."""
    found = []
    for number, pair in enumerate(pairs):
        part = stage(context.progress, number / len(pairs), (number + 1) / len(pairs))
        centres = misregistration.window_centres(pair.area[2], pair.area[3], options)
        matches, common_px = {}, {}
        for k, (state, both) in enumerate(pair.states.items()):
            here = stage(part, k / len(pair.states), (k + 1) / len(pair.states))
            first, second = both[0].reader(pair.area), both[1].reader(pair.area)
            progress = partial(advance, here, message=" - ".join(pair.names))
            progress(0.0)
            common = misregistration.find_common_shift(first, second, *pair.area[2:])
            moved = both[1].reader(pair.area, common)
            found_here = misregistration.measure_shifts(first, moved, centres, options, progress, thread_count())
            matches[state], common_px[state] = found_here._replace(shift_px=found_here.shift_px + common), common
        found.append(PairMatches(pair, matches, common_px))
    if not any(pair.good.any() for pair in found):
        files = " and ".join(one.ortho.path for one in pairs[0].states[AFTER])
        others = f", nor in the other pairs ({len(pairs)} in all)" if len(pairs) > 1 else ""
        outcomes = np.concatenate([matches.outcome for one in found for matches in one.matches.values()])
        holes = int((outcomes == misregistration.WindowOutcome.NODATA).sum())
        raise SolveError(
            f"{files}: no window could be matched{others}: "
            + (
                f"{holes} of {len(outcomes)} windows contain nodata pixels, for example at gaps of the DEM; make the "
                "orthoimages with the option fill-gaps of orthorectify, or lower `window`"
                if 2 * holes > len(outcomes)
                else "the orthoimages show different contents, or their shifts differ by more than `search` from place "
                "to place; raise `search`, or lower `min_correlation`"
            )
        )
    return found


# ---- results ---------------------------------------------------------------------------------------------------------


def _pair_entry(found: PairMatches) -> Report:
    """Return the figures of a pair, before and after, from the windows matched in both."""
    pixel_m = float(np.mean(found.pair.base.pixel_m()))
    return {"first": found.pair.names[0], "second": found.pair.names[1], "pixel_m": pixel_m} | {
        state: misregistration.shift_statistics(matches.shift_px[found.good], pixel_m)
        | {
            "tried": len(matches.centre),
            "matched": int(matches.good.sum()),
            "searched_around_px": found.common_px[state].tolist(),
            "outcomes": {o.label: int(np.sum(matches.outcome == o)) for o in misregistration.WindowOutcome},
        }
        for state, matches in found.matches.items()
    }


def _window_positions(found: PairMatches) -> tuple[np.ndarray, np.ndarray]:
    """Return lon, lat of all windows ``(n, 2)``, and the pixel size east and down in metres."""
    pixels = (found.matches[AFTER].centre + np.array(found.pair.area[:2])).astype(float)
    return found.pair.base.lonlat(pixels), np.array(found.pair.base.pixel_m())


def _make_layers(found: Sequence[PairMatches]) -> list[Layer]:
    """Return the layers of the windows with their shifts, in UTM and in WGS84."""
    parts: list[MisregistrationRows] = []
    places = []
    for pair in found:
        lonlat, pixel_m = _window_positions(pair)
        for state, matches in pair.matches.items():
            count, shift = len(matches.centre), matches.shift_px
            places.append(lonlat)
            parts.append(
                MisregistrationRows(
                    first=np.full(count, pair.pair.names[0]),
                    second=np.full(count, pair.pair.names[1]),
                    state=np.full(count, state),
                    outcome=np.array([misregistration.WindowOutcome(o).label for o in matches.outcome]),
                    dx_px=shift[:, 0],
                    dy_px=shift[:, 1],
                    shift_px=np.hypot(*shift.T),
                    east_m=shift[:, 0] * pixel_m[0],
                    north_m=-shift[:, 1] * pixel_m[1],
                    correlation=matches.correlation,
                    sigma_px=matches.sigma_px,
                )
            )
    fields = MisregistrationRows(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    lonlat = np.concatenate(places)
    epsg = map_epsg_of(lonlat)
    return [
        Layer(SHIFTS_LAYERS[0], "Point", epsg, project_to_map(lonlat, epsg), fields),
        Layer(SHIFTS_LAYERS[1], "Point", WGS84, lonlat, fields),
    ]


def _draw_maps(found: Sequence[PairMatches]) -> dict[str, Any]:
    """Return the drawings of the pairs with the largest misregistration: arrows on the first orthoimage.

    ``pairs`` are names and maps: state, drawing, windows matched, windows tried; ``pictures`` of the orthoimages.
    """
    pictures: dict[str, Picture | None] = {}
    pairs = []
    lengths = [np.hypot(*pair.matches[AFTER].shift_px[pair.good].T) for pair in found]
    medians = [float(np.median(length)) if len(length) else 0.0 for length in lengths]
    worst = [found[number] for number in np.argsort(np.negative(medians), kind="stable")]
    for pair in worst[: LISTS.images]:
        lonlat, pixel_m = _window_positions(pair)
        name, maps, good = pair.pair.names[0], [], np.flatnonzero(pair.good)
        good = good[:: max(1, -(-len(good) // LISTS.rows))]
        for state, matches in pair.matches.items():
            ortho, key = pair.pair.states[state][0].ortho, f"{name} {state}"
            if key not in pictures:
                pictures[key] = read_picture(ortho.raster, name, len(pictures), LARGEST_PICTURE_PX)
            data = BlockMap(
                {},
                lonlat[good],
                np.full(len(good), Role.TIE),
                matches.shift_px[good] * pixel_m * [1.0, -1.0],
                np.full(len(good), ""),
                pictures=_lay_out(ortho, pictures[key]),
                arrows="shift",
            )
            maps.append((state, draw_map(data).svg, int(pair.good.sum()), len(matches.centre)))
        pairs.append((pair.pair.names, maps))
    return {"pairs": pairs, "pictures": [picture for picture in pictures.values() if picture is not None]}


def _lay_out(ortho: OrthoRaster, picture: Picture | None) -> list[GroundPicture]:
    """Return the picture of an orthoimage with its corners on the ground."""
    if picture is None:
        return []
    columns, rows = ortho.raster.size
    corners = np.array([[0.0, 0.0], [columns, 0.0], [columns, rows], [0.0, rows]]) - 0.5
    return [GroundPicture(picture.name, picture.image, picture.covers, ortho.lonlat(corners))]


@thresholds
class REGISTRATION:
    """Limits for the misregistration of orthoimages."""

    most_median_px: float = threshold(
        1.0,
        "px",
        "median misregistration of a pair above which the verdict is doubtful",
        "visible in mosaics and change detection",
    )


def _judge(pairs: Sequence[Report], pooled: Report) -> Verdict:
    """Return the verdict on the registration: doubtful if a pair exceeds a pixel, or is worse than before."""
    reasons = []
    told = [(f"{pair['first']} – {pair['second']}", pair) for pair in pairs if pair[AFTER]["windows"]]
    beyond = [(name, pair) for name, pair in told if pair[AFTER]["median_px"] > REGISTRATION.most_median_px]
    if beyond:
        name, worst = max(beyond, key=lambda one: float(one[1][AFTER]["median_px"]))
        reasons.append(
            Reason(
                "misregistration",
                Level.DOUBTFUL,
                f"{len(beyond)} of {len(told)} pairs differ by more than {REGISTRATION.most_median_px:g} px "
                f"(median): most {name}, by {worst[AFTER]['median_px']:.2f} px ({worst[AFTER]['median_m']:.2f} m)",
                "check the DEM where the arrows are large, and adjust the images together if they were not",
                tuple(sorted({image for _, pair in beyond for image in (pair["first"], pair["second"])})),
            )
        )
    worse = [
        name
        for name, pair in told
        if BEFORE in pair and pair[AFTER]["median_px"] > pair[BEFORE]["median_px"] + EQUALITY.rpc_px
    ]
    if worse:
        reasons.append(
            Reason(
                "misregistration",
                Level.DOUBTFUL,
                f"{list_ids(worse)}: the median is larger than before the adjustment",
                "check that both sets of orthoimages were made with the same DEM, and look into the adjustment's "
                "report",
            )
        )
    before = f" (before {pooled[BEFORE]['median_px']:.2f} px)" if BEFORE in pooled else ""
    after = pooled[AFTER]
    return Verdict.create(
        f"{len(told)} pair{'s' if len(told) != 1 else ''} of orthoimages: median misregistration "
        f"{after['median_px']:.2f} px, {after['median_m']:.2f} m{before}; 90 % of {after['windows']} windows within "
        f"{after['p90_px']:.2f} px",
        reasons,
    )
