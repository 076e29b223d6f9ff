"""Pairs of orthoimages: what they share, how they are shifted, and that as report, layers and maps."""

import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...hrsi_engine.block.block import Role
from ...hrsi_engine.drawing.block_map import BlockMap, draw_block_map
from ...hrsi_engine.foundation.errors import InputError, SolveError
from ...hrsi_engine.foundation.progress import advance, stage
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.ground.geodesy import WGS84
from ...hrsi_engine.ground.map_crs import map_epsg_of, project_to_map
from ...hrsi_engine.io.geopackage.declared_layers import MisregistrationRows
from ...hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ...hrsi_engine.io.output_dir import stage_folder
from ...hrsi_engine.io.pages.page import write_page
from ...hrsi_engine.io.pages.report import write_report_json
from ...hrsi_engine.io.rasters.ortho_rasters import OrthoRaster, offset_of, open_ortho, regrid
from ...hrsi_engine.ortho.common_shift import find_common_shift
from ...hrsi_engine.ortho.misregistration import (  # fmt: skip
    MisregistrationOptions,
    Read,
    WindowOutcome,
    WindowShifts,
    measure_shifts,
    shift_statistics,
    window_centres,
)
from ..declarations.ortho_check import LAYERS, LAYERS_FILE, OrthoCheckOptions
from ..interface.declare import Context, Report


@thresholds
class PAIR_PAGE:
    """How many pairs the page shows."""

    most_maps: int = threshold(12, "maps", "maps of shifts on the page")


BEFORE, AFTER = "before", "after"


@dataclass(frozen=True, eq=False)
class Pair:
    """Two orthoimages; ``area`` is first column, first row, columns, rows of the common ground in the first.

    ``states`` has the rasters of both by state, and the offset of the second in the first.
    """

    names: tuple[str, str]
    area: tuple[int, int, int, int]
    states: Mapping[str, tuple[OrthoRaster, OrthoRaster]]
    offsets: Mapping[str, tuple[tuple[int, int], tuple[int, int]]]
    base: OrthoRaster


@dataclass(frozen=True, eq=False)
class PairMatches:
    """A pair with its windows by state, and the shift around which they were searched."""

    pair: Pair
    matches: Mapping[str, WindowShifts]
    common_px: Mapping[str, np.ndarray]

    @property
    def good(self) -> np.ndarray:
        """Windows that were matched in every state."""
        return np.asarray(np.all([found.good for found in self.matches.values()], axis=0))


def open_pairs(options: OrthoCheckOptions) -> tuple[list[Pair], list[str]]:
    """Return the pairs of orthoimages that overlap, and what the user should know."""
    paths = list(options.images)
    if options.reference is None and len(paths) < 2:
        raise InputError("one orthoimage has nothing to be compared with: name two or more, or `reference`")
    warnings: list[str] = []
    base = open_ortho(paths[0])
    sets = {AFTER: [_on_base(path, base, warnings) for path in paths]}
    if options.before is not None:
        sets = {BEFORE: [_on_base(path, base, warnings) for path in _find_originals(options.before, paths)], **sets}
    names = [Path(path).stem for path in paths]
    if options.reference is not None:
        reference = _on_base(options.reference, base, warnings)
        names.append(Path(options.reference).stem)
        sets = {state: [*rasters, reference] for state, rasters in sets.items()}
        chosen = [(len(paths), k) for k in range(len(paths))]
    else:
        chosen = list(itertools.combinations(range(len(paths)), 2))
    pairs = [found for i, j in chosen if (found := _make_pair((names[i], names[j]), sets, i, j, base)) is not None]
    if not pairs:
        raise InputError("no two of the orthoimages overlap: check their extents")
    return pairs, warnings


def _find_originals(folder: str, paths: Sequence[str]) -> list[str]:
    found = [os.path.join(folder, os.path.basename(path)) for path in paths]
    missing = [path for path in found if not os.path.exists(path)]
    if missing:
        raise InputError(f"{missing[0]} does not exist: `before` needs a folder with orthoimages of the same names")
    return found


def _on_base(path: str, base: OrthoRaster, warnings: list[str]) -> OrthoRaster:
    ortho = open_ortho(path)
    if offset_of(base, ortho) is not None:
        return ortho
    warnings.append(
        f"{path} has other pixels than {base.path} and is resampled to them; that smooths it and may shift it by some "
        "hundredths of a pixel"
    )
    return regrid(ortho, base)


def _base_offset(base: OrthoRaster, ortho: OrthoRaster) -> tuple[int, int]:
    """Return column and row of an orthoimage's corner in the base, on whose pixels it lies."""
    offset = offset_of(base, ortho)
    if offset is None:
        raise InputError(f"{ortho.path} has other pixels than {base.path}: resample it to them")
    return offset


def _make_pair(
    names: tuple[str, str], sets: Mapping[str, Sequence[OrthoRaster]], i: int, j: int, base: OrthoRaster
) -> Pair | None:
    """Return the pair of the orthoimages i and j, None where they do not overlap in every state."""
    states = {state: (rasters[i], rasters[j]) for state, rasters in sets.items()}
    offsets = {state: (_base_offset(base, both[0]), _base_offset(base, both[1])) for state, both in states.items()}
    corners = [
        (offset, ortho.raster.size)
        for state, both in states.items()
        for offset, ortho in zip(offsets[state], both, strict=True)
    ]
    low = np.max([offset for offset, _ in corners], axis=0)
    high = np.min([np.add(offset, size) for offset, size in corners], axis=0)
    if (high <= low).any():
        return None
    return Pair(names, (*low.tolist(), *(high - low).tolist()), states, offsets, base)


def match_pairs(
    pairs: Sequence[Pair], options: MisregistrationOptions, threads: int, context: Context
) -> list[PairMatches]:
    """Match the windows of all pairs, in every state at the same places, around the shift that most of them share."""
    found = []
    for number, pair in enumerate(pairs):
        part = stage(context.progress, number / len(pairs), (number + 1) / len(pairs))
        centres = window_centres(pair.area[2], pair.area[3], options)
        matches, common_px = {}, {}
        for k, (state, both) in enumerate(pair.states.items()):
            here = stage(part, k / len(pair.states), (k + 1) / len(pair.states))
            first, second = (
                _window_reader(ortho, offset, pair.area)
                for ortho, offset in zip(both, pair.offsets[state], strict=True)
            )
            tell = partial(advance, here, message=" - ".join(pair.names))
            tell(0.0)
            common = find_common_shift(first, second, *pair.area[2:])
            found_here = measure_shifts(first, _shift_reader(second, common), centres, options, tell, threads)
            matches[state], common_px[state] = found_here._replace(shift_px=found_here.shift_px + common), common
        found.append(PairMatches(pair, matches, common_px))
    if not any(pair.good.any() for pair in found):
        files = " and ".join(ortho.path for ortho in pairs[0].states[AFTER])
        others = f", nor in the other pairs ({len(pairs)} in all)" if len(pairs) > 1 else ""
        raise SolveError(
            f"{files}: no window could be matched{others}: the orthoimages show different things, or their shifts "
            "differ by more than `search` from place to place; raise `search`, or lower `min_correlation`"
        )
    return found


def _window_reader(ortho: OrthoRaster, offset: tuple[int, int], area: tuple[int, int, int, int]) -> Read:
    """Return a function that reads windows counted from the common area's corner."""
    column, row = area[0] - offset[0], area[1] - offset[1]
    return lambda x, y, columns, rows: ortho.raster.read(x + column, y + row, columns, rows)


def _shift_reader(read: Read, shift: np.ndarray) -> Read:
    """Return a function that reads windows moved by a shift."""
    right, down = shift.tolist()
    return lambda x, y, columns, rows: read(x + right, y + down, columns, rows)


# ---- results ---------------------------------------------------------------------------------------------------------


def write_pair_results(
    found: Sequence[PairMatches], options: OrthoCheckOptions, warnings: list[str], context: Context
) -> Report:
    """Write report, layers and maps; return the report."""
    report: Report = {
        **context.record, "states": list(found[0].matches),
        "pairs": [_pair_entry(pair) for pair in found], "all": _pool_statistics(found),
        "warnings": [*warnings, *_warn_of_failures(found)],
    }  # fmt: skip
    for text in report["warnings"]:
        context.log(f"warning: {text}")
    with stage_folder(options.folder.output_dir, context.inputs, options.folder.overwrite) as folder:
        write_geopackage(str(folder / LAYERS_FILE), _make_layers(found), progress=stage(context.progress, 0.9, 1.0))
        if options.report:
            write_page(str(folder / "report.html"), "misregistration.html.j2", report, maps=_draw_maps(found))
        write_report_json(str(folder / "report.json"), report)
    advance(context.progress, 1.0, "done")
    return report


def _pair_entry(found: PairMatches) -> Report:
    """Return figures of a pair, before and after in the windows matched in both."""
    pixel_m = float(np.mean(found.pair.base.pixel_m()))
    entry: Report = {"first": found.pair.names[0], "second": found.pair.names[1], "pixel_m": pixel_m}
    for state, matches in found.matches.items():
        entry[state] = shift_statistics(matches.shift_px[found.good], pixel_m) | {
            "tried": len(matches.centre), "matched": int(matches.good.sum()),
            "searched_around_px": found.common_px[state].tolist(),
            "outcomes": {o.label: int(np.sum(matches.outcome == o)) for o in WindowOutcome},
        }  # fmt: skip
    return entry


def _pool_statistics(found: Sequence[PairMatches]) -> Report:
    pixel_m = float(np.mean(found[0].pair.base.pixel_m()))
    return {
        state: shift_statistics(np.concatenate([f.matches[state].shift_px[f.good] for f in found]), pixel_m)
        for state in found[0].matches
    }


def _warn_of_failures(found: Sequence[PairMatches]) -> list[str]:
    return [
        f"{' - '.join(pair.pair.names)}: only {int(pair.good.sum())} of {len(pair.good)} windows could be matched"
        for pair in found
        if pair.good.sum() < 10
    ]


def _window_positions(found: PairMatches) -> tuple[np.ndarray, np.ndarray]:
    """Return lon, lat of all windows and metres per pixel east and down."""
    pixels = found.matches[AFTER].centre + np.array(found.pair.area[:2])
    return found.pair.base.lonlat(pixels.astype(float)), np.array(found.pair.base.pixel_m())


def _make_layers(found: Sequence[PairMatches]) -> list[Layer]:
    """Return the windows with their shifts, in UTM and in WGS84."""
    parts: list[MisregistrationRows] = []
    places = []
    for pair in found:
        lonlat, pixel_m = _window_positions(pair)
        for state, matches in pair.matches.items():
            count, shift = len(matches.centre), matches.shift_px
            part = MisregistrationRows(
                first=np.full(count, pair.pair.names[0]), second=np.full(count, pair.pair.names[1]),
                state=np.full(count, state), outcome=np.array([WindowOutcome(o).label for o in matches.outcome]),
                dx_px=shift[:, 0], dy_px=shift[:, 1], shift_px=np.hypot(*shift.T),
                east_m=shift[:, 0] * pixel_m[0], north_m=-shift[:, 1] * pixel_m[1],
                correlation=matches.correlation, sigma_px=matches.sigma_px,
            )  # fmt: skip
            parts.append(part)
            places.append(lonlat)
    fields = MisregistrationRows(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    lonlat = np.concatenate(places)
    epsg = map_epsg_of(lonlat)
    return [
        Layer(LAYERS[0], "Point", epsg, project_to_map(lonlat, epsg), fields),
        Layer(LAYERS[1], "Point", WGS84, lonlat, fields),
    ]


def _draw_maps(found: Sequence[PairMatches]) -> list[tuple[str, str]]:
    """Return titles and arrow maps of the first pairs."""
    maps = []
    for pair in found[: PAIR_PAGE.most_maps]:
        lonlat, pixel_m = _window_positions(pair)
        for state, matches in pair.matches.items():
            metres = matches.shift_px[pair.good] * pixel_m * [1.0, -1.0]
            count = len(metres)
            data = BlockMap({}, lonlat[pair.good], np.full(count, Role.CHECK), metres, np.full(count, ""))
            maps.append((f"{' - '.join(pair.pair.names)}, {state}", draw_block_map(data)))
    return maps
