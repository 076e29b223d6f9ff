"""Chapter 2 of the thesis, figure by figure: corners against gravity centres.

    python benchmarks/chapter2.py [--data DIR] [--trials 400] [--docs]

Tables 2.1 to 2.3 by enumeration, with the entries in which the thesis differs; the same by Monte Carlo over positions,
orientations, sizes, blur and noise; ellipse centres from hand-measured edge points; registration of the QuickBird MS
and PAN images; the Hobart points checked on themselves by intersection. ``--docs`` writes it all into the page.
"""

import csv
import io
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from hrsi.benchmarks.pages import DATA, DOCS, make_parser
from hrsi.benchmarks.sampling_analysis import THESIS, table_2_1, table_2_2, table_2_3
from hrsi.benchmarks.sampling_simulation import CASES, simulate_sampling
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import GroundPoints, ImagePoints
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.laboratory.registration import MethodComparison, compare_kinds
from hrsi.hrsi_engine.measurement.targets.ellipse import FITS, fit_ellipse

PAGE = DOCS / "protocols/chapter2.md"
QUICKBIRD_PAN_M = 0.61
NAMES = {"center": "centre"}  # kinds of points, as the page writes them
#: Averages that table 2.1 prints for corners and centres, by case.
PRINTED_2_1 = {
    1: (2.12, 0.0), 2: (2.91, 1.0), 3: (2.25, 1.33), 4: (1.58, 1.0), 5: (2.91, 1.0), 6: (3.53, 1.41), 7: (3.43, 1.83),
    8: (2.55, 1.41), 9: (2.70, 1.33), 10: (3.43, 1.83), 11: (4.00, 1.33), 12: (4.03, 1.83), 13: (1.58, 1.0),
    14: (2.55, 1.41), 15: (4.03, 1.83), 16: (0.71, 1.41),
}  # fmt: skip
ROUNDING_PX = 0.0101  # the thesis cuts off some digits: 2.915 is printed as 2.91


def print_table_2_1() -> None:
    """Print table 2.1 with the thesis's averages; entries that differ by more than rounding are marked."""
    print("\nTable 2.1: deviation between PAN and MS (PAN px), enumerated and as printed\n")
    print("| case | corners | average | printed | centres | average | printed | remark |")
    print("|---|---|---|---|---|---|---|---|")
    for case in table_2_1():
        printed = PRINTED_2_1[case.case]
        means = float(np.mean(case.corners_px)), float(np.mean(case.centres_px))
        wrong = [
            name for name, a, b in zip(("corners", "centres"), means, printed, strict=True) if abs(a - b) > ROUNDING_PX
        ]
        print(
            f"| {case.case} | {_list(case.corners_px)} | {means[0]:.2f} | {printed[0]:.2f} | {_list(case.centres_px)} "
            f"| {means[1]:.2f} | {printed[1]:.2f} | {'thesis differs: ' + ', '.join(wrong) if wrong else ''} |"
        )


def _list(values: tuple[float, ...]) -> str:
    return "; ".join(f"{value:.2f}" for value in values)


def print_table_2_2() -> None:
    """Print table 2.2."""
    print("\nTable 2.2: spread of possible positions at the same resolution (px)\n")
    print("| case | object | corners: s1, s2 | centre positions | s1 | s2 |\n|---|---|---|---|---|---|")
    for case in table_2_2():
        corners = "; ".join(f"{corner.column:.2f}, {corner.row:.2f}" for corner in case.corners)
        centres = " ".join(f"({x:g}, {y:g})" for x, y in case.centre.positions)
        print(
            f"| {case.case} | {case.size_px:g} x {case.size_px:g} | {corners} | {centres} | {case.centre.column:.2f} "
            f"| {case.centre.row:.2f} |"
        )


def print_table_2_3() -> None:
    """Print table 2.3."""
    print("\nTable 2.3: corner, centre (px) and centre over corner, enumerated (printed)\n")
    for name, errors in table_2_3().items():
        corner, centre, ratio = THESIS[name]
        print(
            f"* {name} resolution: {errors.corner_px:.2f} ({corner}), {errors.centre_px:.2f} ({centre}), "
            f"{errors.ratio:.1%} ({ratio:.1%})"
        )


def print_monte_carlo(trials: int) -> None:
    """Print the same ratios for continuous positions and other objects."""
    print(f"\nMonte Carlo, {trials} trials a case (px of the finer image)\n")
    print("| case | corner | centre | centre / corner | corner, constant part |\n|---|---|---|---|---|")
    for name, case in CASES.items():
        result = simulate_sampling(case, trials)
        print(
            f"| {name} | {result.corner_px:.2f} | {result.centre_px:.2f} | {result.ratio:.0%} "
            f"| {result.corner_steady_px:.2f} |"
        )


def ellipse_agreement(data: Path, method: str) -> tuple[np.ndarray, np.ndarray]:
    """Return how far ellipse centres of hand-measured edge points are from table 2.6, and their sigmas, px."""
    edges = read_points(str(data / "hobart_roundabout_edges.csv")).image
    printed = read_points(str(data / "hobart_image_points.csv")).image
    assert edges is not None and printed is not None
    known = {(i, k): xy for i, k, xy in zip(printed.ids, printed.image_ids, printed.xy, strict=True)}
    away, sigmas = [], []
    for key in dict.fromkeys(zip(edges.ids.tolist(), edges.image_ids.tolist(), strict=True)):
        ellipse = fit_ellipse(edges.xy[(edges.ids == key[0]) & (edges.image_ids == key[1])], method)
        away.append(np.hypot(*(ellipse.centre - known[key])))
        sigmas.append(ellipse.sigma_px)
    return np.array(away), np.array(sigmas)


def print_ellipses(data: Path) -> None:
    """Print how ellipse centres of the hand-measured edge points agree with table 2.6."""
    print("\nEllipse centres from hand-measured edge points against table 2.6 (px)\n")
    for method in FITS:
        away, sigmas = ellipse_agreement(data, method)
        print(
            f"* {method} fit, {len(away)} centres: median {np.median(away):.3f}, 90 % {np.percentile(away, 90):.3f}, "
            f"largest {away.max():.2f}; sigma of a centre, median {np.median(sigmas):.2f}"
        )


def print_quickbird(data: Path) -> None:
    """Print the registration of the QuickBird MS and PAN images (experiment 1)."""
    print("\nQuickBird MS to PAN, standard deviation of position (m); the thesis has: centres 1.25, corners 3.72\n")
    for model in ("affine", "projective"):
        result = register_quickbird(data, model)
        alone = ", ".join(f"{NAMES.get(kind, kind)} {row.distance:.2f}" for kind, row in result.alone.items())
        together = ", ".join(f"{NAMES.get(kind, kind)} {row.distance:.2f}" for kind, row in result.together.items())
        print(f"* {model}: alone {alone} ({result.ratio():.0%}); together {together} ({result.ratio('together'):.0%})")


def register_quickbird(data: Path, model: str) -> MethodComparison:
    """Return the registration of the printed tie points, corners and centres alone and together, in metres."""
    with open(data / "quickbird_ms_pan_tie_points.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    ms = np.array([[float(row["ms_sample"]), float(row["ms_line"])] for row in rows])
    pan = np.array([[float(row["pan_sample"]), float(row["pan_line"])] for row in rows])
    kinds = np.array([row["kind"] for row in rows])
    return compare_kinds(ms, pan, kinds, model, unit=QUICKBIRD_PAN_M)


def hobart_deviations(data: Path, kind: str, model: str = "shift", together: bool = False) -> np.ndarray:
    """Return survey - intersection (n, 3) metres east, north, up of all points of a kind, all of them control.

    With ``together`` the points of the other kind are control too. The intersection uses the refined RPCs and the image
    points alone; the survey enters only through the refinement.
    """
    images = [open_image(str(data / f"hobart_ikonos_{number}_RPC.TXT")) for number in (1, 2, 3)]
    ground = read_points(str(data / "hobart_ground_points.csv")).ground
    points = read_points(str(data / "hobart_image_points.csv"), image_ids=[image.id for image in images]).image
    assert ground is not None and points is not None
    mine = np.isin(points.kind, ("center", "corner")) if together else points.kind == kind
    measured = ImagePoints(
        points.ids[mine], points.image_ids[mine], points.xy[mine], points.sigma_px[mine], points.kind[mine],
        points.quality[mine],
    )  # fmt: skip
    known = np.isin(ground.ids, measured.ids)
    control = GroundPoints(ground.ids[known], ground.ground[known], ground.role[known], ground.sigma_m[known])
    result = adjust(assemble(images, [control], [measured]), AdjustOptions(model=model, reject_sigma=0.0))
    rpcs = [
        result.model.compute_refined_rpc(image, value).rpc for image, value in zip(images, result.values, strict=True)
    ]
    block = result.block
    deviations = []
    for point in range(len(block.points)):
        rows = np.flatnonzero(block.measurements.point == point)
        if len(rows) >= 2 and block.measurements.kind[rows[0]] == kind:
            survey = block.points.ground[point]
            cameras = [rpcs[image] for image in block.measurements.image[rows]]
            found = intersect(cameras, block.measurements.xy[rows], survey)
            deviations.append(ground_difference_m(survey[None], found[None])[0])
    return np.array(deviations)


def intersect(rpcs: list[RPC], xy: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the least-squares intersection (3,) of image points (k, 2) on k images."""
    ground = start.copy()
    for _ in range(8):
        parts = [rpc.project_with_metric_jacobian(ground[None]) for rpc in rpcs]
        design = np.vstack([jacobian[0] for _, jacobian in parts])
        miss = np.concatenate([seen - computed[0] for seen, (computed, _) in zip(xy, parts, strict=True)])
        ground = move_ground(ground[None], np.linalg.lstsq(design, miss, rcond=None)[0][None])[0]
    return ground


def planimetric_sigma(deviations: np.ndarray) -> float:
    """Return the 1-sigma of position: root of the summed variances east and north."""
    return float(np.hypot(*deviations.std(axis=0)[:2]))


def print_hobart(data: Path) -> None:
    """Print the Hobart points as control, checked on themselves by intersection (experiment 2)."""
    print("\nHobart, all points of a kind as control, checked by intersection: planimetric 1-sigma (m)")
    print("The thesis has: centres 0.55, corners 1.48. The RPCs were fitted to these image points\n")
    for model in ("shift", "affine"):
        centres, corners = (hobart_deviations(data, kind, model) for kind in ("center", "corner"))
        a, b = planimetric_sigma(centres), planimetric_sigma(corners)
        print(f"* {model}: {len(centres)} centres {a:.2f}, {len(corners)} corners {b:.2f} ({a / b:.0%})")


def print_all(data: Path, trials: int) -> None:
    """Print every section."""
    print_table_2_1()
    print_table_2_2()
    print_table_2_3()
    print_monte_carlo(trials)
    print_ellipses(data)
    print_quickbird(data)
    print_hobart(data)


def main() -> None:
    """Print the figures; ``--docs`` writes them into the page, whose conclusions stay."""
    parser = make_parser(__doc__.splitlines()[0], PAGE)
    parser.add_argument("--data", type=Path, default=DATA / "thesis")
    parser.add_argument("--trials", type=int, default=400)
    given = parser.parse_args()
    text = io.StringIO()
    with redirect_stdout(text):
        print_all(given.data, given.trials)
    print(text.getvalue())
    if given.docs:
        head, _, table = PAGE.read_text(encoding="utf-8").partition("\nTable 2.1: ")
        remarks = table.partition("\n## ")[2]
        PAGE.write_text(f"{head}{text.getvalue()}\n## {remarks}", encoding="utf-8")


if __name__ == "__main__":
    main()
