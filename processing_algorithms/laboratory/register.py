"""`register`: registration of two images from their matched points, centres against corners (thesis chapter 2)."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import ImagePoints
from ...hrsi_engine.drawing.plots import choose_round_length, compute_typical_length, draw_bars, make_arrow_path
from ...hrsi_engine.foundation.errors import InputError, list_ids
from ...hrsi_engine.foundation.progress import advance
from ...hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ...hrsi_engine.io.output_dir import stage_folder
from ...hrsi_engine.io.pages.report import write_page, write_report_json
from ...hrsi_engine.io.point_files import read_points
from ...hrsi_engine.io.rasters.images import image_id, open_image
from ...hrsi_engine.laboratory.registration import MethodComparison, choose_group, compare_kinds
from ...hrsi_engine.surface.dem import intersect_surface
from ...hrsi_engine.surface.grid_surface import ConstantHeight
from ..files.opening import open_terrain
from ..files.result_folder import check_folder, plan_folder
from ..interface.declare import Context, Report
from .declarations.register import LAYER, LAYERS_FILE, RegisterOptions
from .layers import RegisteredPointRows

PAGE_FILE = "report.html"


def run(options: RegisterOptions, context: Context) -> Report:
    """Register the images, tabulate the residuals by kind and write tables and plots."""
    check_folder(options.folder, context)
    first, second, points = _match(options)
    start = _carry(options, points["first"]) if options.registration.by_rpcs else points["first"]
    known = np.isfinite(start).all(axis=1)
    lost = [f"{(~known).sum()} points of {first} have no position on the terrain: left out"] if not known.all() else []
    if not known.any():
        raise InputError(
            f"{options.image_points}: no point of {first} has a position on the terrain: check sample and line, and "
            "`dem` or `height`"
        )
    start, points = start[known], {name: column[known] for name, column in points.items()}
    if context.dry_run:
        return plan_folder(options.folder, LAYERS_FILE, {"matched points": len(start)}, lost, context, options.report)
    unit = options.gsd or 1.0
    result = compare_kinds(
        start,
        points["second"],
        points["kind"],
        model=options.registration.form,
        sigma_px=points["sigma"],
        reject_sigma=options.registration.reject_sigma,
        unit=unit,
    )
    advance(context.progress, 0.6, "registered")
    everything = result.registrations["all"]
    ratios = {name: result.ratio(name) for name in ("alone", "together")}
    report: Report = {
        **context.record,
        "model": options.registration.model,
        "first": first,
        "second": second,
        "points": len(points["ids"]),
        "unit": "m" if options.gsd else "px",
        "alone": {kind: asdict(row) for kind, row in result.alone.items()},
        "together": {kind: asdict(row) for kind, row in result.together.items()},
        "center_over_corner": ratios if any(ratios.values()) else None,
        "matrix": everything.matrix.tolist(),
        "outliers": points["ids"][~everything.used].tolist(),
        "warnings": lost,
    }
    if 2 * len(start) == everything.unknowns:
        lost.append(f"{len(start)} points for {everything.unknowns} parameters: nothing checks the registration")
    residual = everything.residual_px * unit
    rows = _tabulate_points(points, residual, everything.used)
    with stage_folder(options.folder.output_dir, context.inputs, options.folder.overwrite) as folder:
        write_geopackage(str(folder / LAYERS_FILE), [Layer(LAYER, "None", 4326, residual, rows)])
        if options.report:
            write_page(
                str(folder / PAGE_FILE), "registration.html.j2", report, **_drawings(points, result, unit, report)
            )
        write_report_json(str(folder / "report.json"), report)
    advance(context.progress, 1.0, "done")
    return report


def _tabulate_points(points: dict[str, np.ndarray], residual: np.ndarray, used: np.ndarray) -> RegisteredPointRows:
    """Return the rows of the layer of points, with their residuals ``(n, 2)`` in the unit of the report."""
    return RegisteredPointRows(
        id=points["ids"],
        kind=points["kind"].astype(str),
        used=used,
        first_sample=points["first"][:, 0],
        first_line=points["first"][:, 1],
        second_sample=points["second"][:, 0],
        second_line=points["second"][:, 1],
        residual_x=residual[:, 0],
        residual_y=residual[:, 1],
    )


def _match(options: RegisterOptions) -> tuple[str, str, dict[str, np.ndarray]]:
    """Return the ids of the two images and the columns of the points measured on both."""
    names = [image_id(path) for path in options.images or []]
    table = read_points(options.image_points, image_ids=names).image
    if table is None:
        raise InputError(f"{options.image_points} has no image points: give the fields id, image, sample and line")
    first, second = _pair(options, names, table)
    rows = [_rows_by_id(table, name) for name in (first, second)]
    ids = [name for name in rows[0] if name in rows[1]]
    if not ids:
        raise InputError(f"{options.image_points}: no id is measured on both {first} and {second}: check the ids")
    a, b = (np.array([row[name] for name in ids]) for row in rows)
    sigma = np.hypot(table.sigma_px[a], table.sigma_px[b])
    return (
        first,
        second,
        {
            "ids": np.array(ids, dtype=str),
            "first": table.xy[a],
            "second": table.xy[b],
            "kind": table.kind[a],
            "sigma": np.where(np.isfinite(sigma), np.maximum(sigma, 0.02), 1.0),
        },
    )


def _rows_by_id(table: ImagePoints, image: str) -> dict[str, int]:
    """Return the row of each id on one image; raise `InputError` where one is there twice."""
    rows = np.flatnonzero(table.image_ids == image)
    ids, counts = np.unique(table.ids[rows], return_counts=True)
    if (counts > 1).any():
        raise InputError(f"{table.source}: {list_ids(ids[counts > 1])} occurs twice on {image}: keep one of the rows")
    return {str(table.ids[row]): int(row) for row in rows}


def _pair(options: RegisterOptions, names: list[str], table: ImagePoints) -> tuple[str, str]:
    """Return the ids of the first and the second image: as the options state, else in the order of the file."""
    present = list(dict.fromkeys(table.image_ids.tolist()))
    chosen = names or present
    first = options.first or next(iter(chosen), None)
    second = options.second or next((name for name in chosen if name != first), None)
    missing = [name for name in (first, second) if name not in present]
    if first is None or second is None or missing:
        raise InputError(
            f"{options.image_points} has no points on image {missing[0]!r} (it has {', '.join(present)}): "
            "name two of them by `first` and `second`"
        )
    return first, second


def _carry(options: RegisterOptions, first_px: np.ndarray) -> np.ndarray:
    """Return where the RPCs carry points of the first image to in the second."""
    if len(options.images or []) != 2:
        raise InputError(f"`model` {options.registration.model} needs both images with their RPCs: name two images")
    first, second = (open_image(path) for path in options.images)
    surface = open_terrain(options.terrain) or ConstantHeight(first.middle_height_m)
    ground, _ = intersect_surface(first.rpc, first_px, surface)
    return second.rpc.project(ground)


def _drawings(
    points: Mapping[str, np.ndarray], result: MethodComparison, unit: float, report: Report
) -> dict[str, Any]:
    """Return the plots: distance errors by kind, and the residuals of each registration."""
    groups = np.array([choose_group(str(kind)) for kind in points["kind"]])
    bars = {
        title: {kind: row["distance"] for kind, row in report[table].items()}
        for title, table in (("alone", "alone"), ("all together", "together"))
    }
    vectors = []
    for name, registration in result.registrations.items():
        shown = registration.used & ((groups == name) | (name == "all"))
        title = "All points together" if name == "all" else f"{name} points alone"
        residual = registration.residual_px[shown] * unit
        vectors.append((title, draw_residual_vectors(points["second"][shown], residual, groups[shown], report["unit"])))
    return {"bars": draw_bars(bars, report["unit"]), "vectors": vectors}


def summarise(report: Report) -> str:
    """Return the table of residuals by kind."""
    unit = report["unit"]
    lines = [f"{report['first']} to {report['second']}, {report['model']}, {report['points']} points"]
    lines += [
        f"{kind:8s} {table:8s} {row['count']:5d} points: std {row['std'][0]:.2f} {row['std'][1]:.2f}, "
        f"distance {row['distance']:.2f} {unit}"
        for table in ("alone", "together")
        for kind, row in report[table].items()
    ]
    ratios = report["center_over_corner"] or {}
    lines += [f"centre over corner, {table}: {ratio:.0%}" for table, ratio in ratios.items() if ratio is not None]
    return "\n".join(lines)


_WIDTH, _MARGIN = 560.0, 34.0  # of the residual vectors, SVG units


def draw_residual_vectors(xy: np.ndarray, residual: np.ndarray, groups: np.ndarray, unit: str) -> str:
    """Return residual arrows at the points' places (thesis figures 2.13, 2.14, 2.17 to 2.20).

    xy, residual : (n, 2) places and residuals, lines downwards; groups : (n,) they name the colour
    unit : of the residuals, for the scale
    """
    low, high = xy.min(axis=0), xy.max(axis=0)
    scale = (_WIDTH - 2.0 * _MARGIN) / max(float((high - low).max()), 1e-9)
    height = float((high - low)[1]) * scale + 2.0 * _MARGIN + 24.0
    typical = compute_typical_length(residual)
    per_unit = 32.0 / typical if typical > 0.0 else 0.0  # drawing units of the 90th percentile
    parts = [f'<svg class="card" viewBox="0 0 {_WIDTH:.0f} {height:.0f}" role="img" aria-label="Residuals">']
    arrows = zip((xy - low) * scale + _MARGIN, residual * per_unit, groups, strict=True)
    parts += [_draw_arrow(x, y, dx, dy, str(group)) for (x, y), (dx, dy), group in arrows]
    if typical > 0.0:
        length = choose_round_length(1.5 * typical)
        parts.append(_draw_arrow(_MARGIN, height - 14.0, length * per_unit, 0.0, "scale"))
        x = _MARGIN + length * per_unit + 8.0
        parts.append(f'<text x="{x:.1f}" y="{height - 10.0:.1f}">{length:g} {html.escape(unit)}</text>')
    return "".join([*parts, "</svg>"])


def _draw_arrow(x: float, y: float, dx: float, dy: float, group: str) -> str:
    return f'<path class="v {html.escape(group)}" d="M{x:.1f},{y:.1f}h0{make_arrow_path(x, y, dx, dy, head=5.0)}"/>'
