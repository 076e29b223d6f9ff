"""Tables 4.6 to 4.11 and figures 4.2 to 4.5 of the thesis, printed and computed: `accuracy.py thesis`.

Printed figures stand left, computed ones right. ``--docs`` writes docs/protocols/accuracy_thesis.md and the plots. The
thesis data lie in HRSI_TEST_DATA (see CONTRIBUTING.md).
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from hrsi.benchmarks import thesis_formulas
from hrsi.benchmarks.pages import DATA, DOCS, make_parser, render, write_sections
from hrsi.benchmarks.spot5 import CASES, Spot5, read_printed_checks, read_spot5
from hrsi.hrsi_engine import open_image
from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.laboratory.direct_methods import DIRECT
from hrsi.hrsi_engine.refinement.estimate import Control, estimate
from hrsi.hrsi_engine.refinement.selection import choose_by_number
from hrsi.processing_algorithms.laboratory.direct_methods import SINGLE_IMAGE_MODELS

PAGE = DOCS / "protocols/accuracy_thesis.md"
#: RMSE in px from which a direct method has failed: no image of the sets has residuals of that size with a result.
FAILED_PX = 1000.0
Pair = tuple[float, float]
#: RMSE (sample, line) in px: number of GCPs -> generic, bias.
TABLE_4_6: dict[int, tuple[Pair, Pair]] = {
    0: ((2.12, 19.65), (2.12, 19.65)), 1: ((4.28, 5.57), (4.38, 5.54)), 3: ((1.13, 0.86), (1.13, 0.87)),
    7: ((1.15, 0.95), (1.15, 0.95)), 37: ((0.91, 0.70), (0.99, 0.76)),
}  # fmt: skip
TABLE_4_7: dict[int, tuple[Pair, Pair]] = {
    0: ((5.09, 3.41), (5.09, 3.41)), 1: ((0.90, 0.79), (0.90, 0.79)), 9: ((0.76, 0.83), (0.76, 0.83)),
    113: ((0.62, 0.70), (0.68, 0.71)),
}  # fmt: skip
#: Tables 4.9, 4.10, 4.11: number of GCPs -> bias and generic of the nine cases.
TABLES_BY_CASE: dict[int, list[tuple[Pair, Pair]]] = {
    1: [
        ((1040.90, 166.77), (959.91, 17.22)), ((109.06, 7.59), (98.33, 5.45)), ((15.86, 4.58), (14.79, 3.32)),
        ((5.40, 7.36), (3.41, 5.94)), ((5.52, 4.68), (5.34, 4.45)), ((5.53, 4.42), (5.54, 4.30)),
        ((1040.75, 160.96), (961.33, 19.70)), ((109.07, 7.27), (98.55, 5.62)), ((15.86, 4.55), (14.81, 3.31)),
    ],
    3: [
        ((4.22, 7.88), (0.86, 1.29)), ((0.85, 1.50), (0.88, 1.13)), ((0.86, 1.15), (0.87, 1.13)),
        ((0.87, 1.13), (0.87, 1.14)), ((0.87, 1.13), (0.87, 1.13)), ((0.87, 1.137), (0.86, 1.13)),
        ((4.20, 7.97), (0.86, 1.21)), ((0.85, 1.51), (0.88, 1.13)), ((0.86, 1.15), (0.87, 1.13)),
    ],
    7: [
        ((4.02, 6.71), (0.97, 1.25)), ((0.95, 1.39), (0.97, 1.15)), ((0.95, 1.15), (0.95, 1.15)),
        ((0.95, 1.16), (0.95, 1.15)), ((0.95, 1.15), (0.95, 1.15)), ((0.95, 1.15), (0.95, 1.15)),
        ((3.99, 6.79), (0.98, 1.18)), ((0.95, 1.39), (0.97, 1.15)), ((0.95, 1.15), (0.95, 1.15)),
    ],
}  # fmt: skip
TABLE_NAMES = {1: "4.9", 3: "4.10", 7: "4.11"}
IKONOS_ONE = ("H098",)
#: Found by the residuals of tables 5 and 6 of appendix VII, which print the same points with one and with nine GCPs.
IKONOS_NINE = ("H001", "H009", "H022", "H035", "H036", "H049", "H084", "H092", "H100")
IKONOS_SIGMA_PX = 0.6  # positions rounded to whole pixels, on corners as good as a pixel


# ---- computation ---------------------------------------------------------------------------------------------------


def bias_model(count: int) -> str:
    """Return the thesis's bias compensation: a shift with one GCP, affine with more."""
    return "shift" if count < 3 else "affine"


def generic_model(image: Image, control: Control) -> str:
    """Return the variant of the generic method by the rule of ``--model generic``."""
    return choose_by_number([(image, control)]).model


def check_residuals(model: str, image: Image, control: Control, check: Control) -> np.ndarray:
    """Return observed - computed ``(n, 2)`` of check points."""
    values = estimate(SINGLE_IMAGE_MODELS[model], image, control).values
    return np.asarray(check.xy - SINGLE_IMAGE_MODELS[model].project(image, values, check.ground))


def rmse(residual: np.ndarray) -> Pair:
    """Return the RMSE of sample and line."""
    sample, line = np.sqrt(np.mean(residual**2, axis=0))
    return float(sample), float(line)


def compare(image: Image, control: Control, check: Control, count: int) -> tuple[Pair, Pair]:
    """Return the check RMSE of bias compensation and generic method."""
    if not count:
        before = rmse(check.xy - image.rpc.project(check.ground))
        return before, before
    names = bias_model(count), generic_model(image, control)
    bias, generic = (rmse(check_residuals(name, image, control, check)) for name in names)
    return bias, generic


def ikonos(folder: Path) -> tuple[Image, Control]:
    """Return the first Hobart image and the 113 GPS points at their whole-pixel positions on it."""
    with open(folder / "hobart_ground_points.csv", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["id"].startswith("H") and row["image1_sample_rounded"]]
    ground = np.array([[float(row[name]) for name in ("lon", "lat", "height")] for row in rows])
    xy = np.array([[float(row[f"image1_{name}_rounded"]) for name in ("sample", "line")] for row in rows])
    image = open_image(str(folder / "hobart_ikonos_1_RPC.TXT"))
    return image, Control(ground, xy, np.array([row["id"] for row in rows]), IKONOS_SIGMA_PX)


# ---- tables --------------------------------------------------------------------------------------------------------


def pair(value: Pair) -> str:
    """Return sample and line RMSE as in the thesis."""
    return f"{value[0]:.2f} / {value[1]:.2f}"


def rows_4_6(spot5: Spot5) -> list[list[str]]:
    """Return table 4.6: SPOT 5, undisturbed."""
    image, rows = spot5.image(0), []
    for count, (generic, bias) in TABLE_4_6.items():
        control, check = spot5.control(count)
        our_bias, our_generic = compare(image, control, check, count)
        formulas = pair(by_formulas(spot5, 0, count)) if count else ""
        rows.append([str(count), pair(bias), pair(our_bias), pair(generic), formulas, pair(our_generic)])
    return rows


def by_formulas(spot5: Spot5, case: int, count: int) -> Pair:
    """Return the check RMSE of the thesis's own formulas."""
    return rmse(thesis_formulas.residuals_of_checks(spot5.disturbed_camera(case), *spot5.control(count)))


def rows_4_7(folder: Path) -> list[list[str]]:
    """Return table 4.7: IKONOS."""
    image, everything = ikonos(folder)
    rows = []
    for count, (generic, bias) in TABLE_4_7.items():
        used = np.isin(everything.ids, {1: IKONOS_ONE, 9: IKONOS_NINE}.get(count, tuple(everything.ids)))
        check = everything.select(~used) if count in (1, 9) else everything
        our_bias, our_generic = compare(image, everything.select(used), check, count)
        rows.append([str(count), pair(bias), pair(our_bias), pair(generic), pair(our_generic)])
    return rows


def rows_by_case(spot5: Spot5, count: int) -> list[list[str]]:
    """Return one of the tables 4.9 to 4.11; with 37 GCPs there is none printed."""
    control, check = spot5.control(count)
    rows = []
    for case in range(1, len(CASES)):
        ours = compare(spot5.image(case), control, check, count)
        printed = TABLES_BY_CASE.get(count)
        bias, generic = (pair(value[::-1]) for value in printed[case - 1]) if printed else ("", "")
        formulas = pair(by_formulas(spot5, case, count)) if printed else ""
        rows.append([str(case), bias, pair(ours[0]), generic, formulas, pair(ours[1])])
    return rows


def rows_of_models(spot5: Spot5, case: int) -> list[list[str]]:
    """Return every model with 3, 7 and 37 GCPs; where a direct method fails, digits depend on the machine: none."""
    image, rows = spot5.image(case), []
    for name, model in SINGLE_IMAGE_MODELS.items():
        cells = [name]
        for count in (3, 7, 37):
            control, check = spot5.control(count)
            if len(control) < model.least_points:
                cells.append("")
                continue
            found = rmse(check_residuals(name, image, control, check))
            cells.append(f"> {FAILED_PX:g}" if name in DIRECT and max(found) > FAILED_PX else pair(found))
        rows.append(cells)
    return rows


def rows_of_points(spot5: Spot5, folder: Path) -> list[list[str]]:
    """Return the largest difference from the printed residual of any check point, bias columns."""
    image, rows = spot5.image(0), []
    for count, printed in read_printed_checks(folder).items():
        control, check = spot5.control(count)
        ours = -check_residuals(bias_model(count), image, control, check)  # the thesis prints computed - observed
        away = np.abs(ours - [printed[name][:2] for name in check.ids.tolist()])
        rows.append([str(count), str(len(check)), f"{away[:, 0].max():.3f}", f"{away[:, 1].max():.3f}"])
    return rows


# ---- figures -------------------------------------------------------------------------------------------------------


def edge_difference(height_m: float, off_nadir: np.ndarray, error: np.ndarray, half_field: np.ndarray) -> np.ndarray:
    """Return X1 - X1' in metres (equations 4.6 to 4.8); angles in radians."""
    shift = height_m * (np.tan(off_nadir + error) - np.tan(off_nadir))
    true = -height_m * np.tan(off_nadir + half_field)
    compensated = shift - height_m * np.tan(off_nadir + half_field + error)
    return np.asarray(true - compensated)


def plot(path: Path, label: str, x: np.ndarray, curves: dict[str, np.ndarray]) -> None:
    """Write a figure as SVG, the same bytes every time."""
    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axes = figure.subplots()
    for name, y in curves.items():
        axes.plot(x, np.abs(y), label=name)
    axes.set(xlabel=label, ylabel="|X1 − X1'| at the edge (m)", yscale="log")
    axes.grid(alpha=0.3)
    axes.legend()
    with mpl.rc_context({"svg.hashsalt": "hrsi"}):
        figure.savefig(path, format="svg", metadata={"Date": None})


def write_figures(folder: Path, height_m: float = 680e3) -> None:
    """Write figures 4.2 to 4.5: where bias compensation breaks down (an orbit of 680 km)."""
    degree, small, large = np.radians(1.0), np.linspace(1e-6, 1e-3, 200), np.linspace(1e-4, 0.1, 200)
    fields = {f"field of view {field:g}°": np.radians(field / 2.0) for field in (1.0, 2.0, 5.0, 10.0)}
    errors = {f"attitude error {error:g} rad": error for error in (1e-5, 1e-3, 1e-2, 1e-1)}
    for name, angles in (("4_2", large), ("4_3", small)):
        curves = {label: edge_difference(height_m, 0.0 * angles, angles, half) for label, half in fields.items()}
        plot(folder / f"figure_{name}.svg", "attitude error (rad), nadir", angles, curves)
    field = np.linspace(0.1, 20.0, 200)
    curves = {label: edge_difference(height_m, 0.0, error, np.radians(field / 2.0)) for label, error in errors.items()}
    plot(folder / "figure_4_4.svg", "field of view (°), nadir", field, curves)
    tilt = np.linspace(0.0, 45.0, 200)
    curves = {label: edge_difference(height_m, np.radians(tilt), error, degree / 2) for label, error in errors.items()}
    plot(folder / "figure_4_5.svg", "off-nadir angle (°), field of view 1°", tilt, curves)


# ---- page ----------------------------------------------------------------------------------------------------------

HEAD = ("bias, printed", "bias, computed", "generic, printed", "its formulas, computed", "generic, HRSI")


def sections(folder: Path) -> list[tuple[str, str]]:
    """Return titles and tables."""
    spot5 = read_spot5(folder)
    by_case: list[tuple[str, str]] = []
    for count in (1, 3, 7, 37):
        title = f"Table {TABLE_NAMES[count]}" if count in TABLE_NAMES else "Nine cases"
        text = f"{title}: errors of table 4.8, {count} GCP{'' if count == 1 else 's'}"
        by_case.append((text, render(("case", *HEAD), rows_by_case(spot5, count))))
    model_head = ("model", "3 GCPs", "7 GCPs", "37 GCPs")
    point_head = ("GCPs", "check points", "largest difference, sample px", "line px")
    return [
        ("Table 4.6: SPOT 5", render(("GCPs", *HEAD), rows_4_6(spot5))),
        ("Residuals of single check points, bias", render(point_head, rows_of_points(spot5, folder))),
        ("Table 4.7: IKONOS, Hobart", render(("GCPs", *HEAD[:3], HEAD[4]), rows_4_7(folder))),
        *by_case,
        ("All models, SPOT 5 undisturbed", render(model_head, rows_of_models(spot5, 0))),
        ("All models, case 7 (0.1 rad)", render(model_head, rows_of_models(spot5, 7))),
    ]


def describe_figures() -> tuple[str, str]:
    """Return title and text of the section on figures 4.2 to 4.5."""
    second = np.radians(1.0 / 3600.0)
    ikonos_m = float(edge_difference(680e3, np.array(0.0), np.array(2.0 * second), np.radians(0.93 / 2.0)))
    names = ("attitude error to 0.1 rad", "attitude error to 1 mrad", "field of view", "off-nadir angle")
    pictures = "\n".join(f"![Figure 4.{k}: {name}](../figure_4_{k}.svg)" for k, name in enumerate(names, 2))
    return (
        "Figures 4.2 to 4.5: limits of bias compensation",
        "The figures have the error that a shift leaves at the "
        "edge of the image (equations 4.6 to 4.8), from an orbit of 680 km. "
        f'For IKONOS with 2" of roll it is {abs(ikonos_m):.6f} m (printed 0.000454 m).\n\n{pictures}\n',
    )


def main(words: Sequence[str] | None = None, write: Callable[[str], object] = print) -> None:
    """Print the tables; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--data", type=Path, default=DATA / "thesis", help="folder with the thesis's tables")
    options = parser.parse_args(words)
    tables = sections(options.data)
    for title, table in tables:
        write(f"\n{title}\n\n{table}")
    title, text = describe_figures()
    write(f"\n## {title}\n\n{text}")
    if options.docs:
        write_sections(PAGE, dict(tables) | {title: text})
        write_figures(PAGE.parent)


if __name__ == "__main__":
    main()
