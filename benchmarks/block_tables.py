"""Accuracy of the block adjustment on real, published and simulated blocks: `accuracy.py blocks [NAME …] [--docs]`.

Ours stands beside the figures of the thesis (tables 5.2 to 5.5, figures 5.5 and 5.6) and of other programs. ``--docs``
writes docs/protocols/accuracy_blocks.md and its figures. The data lie in HRSI_TEST_DATA (see CONTRIBUTING.md).
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from hrsi.benchmarks import hobart_monte_carlo
from hrsi.benchmarks.pages import DOCS, make_parser, render, write_sections
from hrsi.benchmarks.real_blocks import (
    TEN,
    check_rmse,
    hobart,
    quickbird,
    spot7,
    tie_rmse,
    triplet,
    zy3,
)
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment import Adjustment
from hrsi.hrsi_engine.adjustment.statistics.precision import predict_accuracy
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.block.default_sigmas import DefaultSigmas
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    Noise,
    PointCounts,
    SceneSpec,
    make_along_track_views,
    simulate_block,
)

PAGE = DOCS / "protocols/accuracy_blocks.md"
Three = tuple[float, float, float]
Section = tuple[str, Sequence[str], list[list[str]]]  # title, head, rows
#: RMSE of check points X Y Z in m with 1 to 10 (unnamed) GCPs, shift and affine: tables 5.4 (Hobart), 5.5 (Melbourne).
TABLE_5_4: list[tuple[Three, Three]] = [
    ((0.564, 0.643, 0.943), (0.564, 0.643, 0.943)), ((0.570, 0.668, 0.928), (0.573, 0.658, 1.152)),
    ((0.761, 0.556, 0.938), (0.837, 0.628, 1.002)), ((0.601, 0.510, 0.934), (0.908, 0.512, 1.052)),
    ((0.558, 0.510, 0.958), (0.896, 0.511, 0.958)), ((0.551, 0.501, 0.936), (0.861, 0.514, 0.984)),
    ((0.562, 0.500, 0.929), (0.591, 0.512, 0.963)), ((0.558, 0.502, 0.940), (0.599, 0.512, 1.016)),
    ((0.564, 0.504, 0.951), (0.584, 0.500, 0.989)), ((0.566, 0.507, 0.943), (0.588, 0.503, 0.994)),
]  # fmt: skip
TABLE_5_5: list[tuple[Three, Three]] = [
    ((0.578, 0.473, 0.468), (0.578, 0.473, 0.468)), ((0.588, 0.473, 0.441), (0.592, 0.466, 0.440)),
    ((0.587, 0.486, 0.410), (0.639, 0.552, 0.370)), ((0.599, 0.485, 0.434), (0.660, 0.545, 0.407)),
    ((0.617, 0.511, 0.440), (0.699, 0.602, 0.423)), ((0.615, 0.509, 0.444), (0.672, 0.573, 0.421)),
    ((0.589, 0.491, 0.449), (0.587, 0.492, 0.419)), ((0.592, 0.490, 0.440), (0.596, 0.506, 0.408)),
    ((0.598, 0.485, 0.418), (0.624, 0.530, 0.394)), ((0.611, 0.481, 0.424), (0.617, 0.457, 0.407)),
]  # fmt: skip
FORMAL = {"Hobart, table 5.2": (0.346, 0.244, 1.016), "Melbourne, table 5.3": (0.162, 0.153, 0.267)}
SIMULATED = {"IKONOS triplet": ("ikonos", 3, 61), "QuickBird pair": ("quickbird", 2, 71)}
SEEDS = range(4)
#: Columns that the figures show.
DRAWN = {
    "shift, printed", "shift", "shift, simulated", "affine, printed", "affine", "affine, drift estimated",
}  # fmt: skip
NOISE = Noise(image_px=0.2, gcp_xy_m=0.1, gcp_h_m=0.15)
#: What is compared with printed results leaves nothing out, as those did.
PLAIN = AdjustOptions(model="shift", reject_sigma=0.0)
TIES = replace(PLAIN, check_as_ties=True)
ESTIMATED = replace(TIES, variance_components=True)


def metres(values: Sequence[float]) -> str:
    """Return three numbers for a table."""
    return " ".join(f"{value:.3f}" for value in values)


# ---- Hobart --------------------------------------------------------------------------------------------------------


def hobart_by_kind() -> Section:
    """Return Hobart with 10 GCPs, by what the check points' measurements may do and by model."""
    five_cm = DefaultSigmas(0.5, 0.05, 0.05)
    runs: list[tuple[str, DefaultSigmas | None, AdjustOptions]] = [
        ("shift, check points intersected only", None, PLAIN),
        ("the same, GCP sigmas of 5 cm", five_cm, PLAIN),
        ("shift, their measurements as tie points", None, TIES),
        ("shift, as tie points, variance components", None, ESTIMATED),
        ("shift, as tie points, by kind and image", None, replace(ESTIMATED, variance_groups="kind-image")),
    ]
    for model in ("shift-drift", "conformal", "affine", "auto"):
        runs += [
            (f"{model}, as tie points", None, replace(TIES, model=model)),
            (f"{model}, as tie points, variance components", None, replace(ESTIMATED, model=model)),
        ]
    rows = []
    for text, defaults, options in runs:
        result = adjust(hobart(defaults=defaults), options)
        drift = [part.sigma for part in result.variance_components if part.unit == "px/px"]
        kinds = (metres(check_rmse(result, kind)) for kind in ("center", "corner"))
        rows.append([text, *kinds, f"{drift[0]:.1e}" if drift else ""])
    return "Hobart, IKONOS triplet", ("check points", "31 centres", "30 corners", "drift"), rows


def hobart_kinds() -> Section:
    """Return what variance components say of centres and corners."""
    rows = []
    for text, block in (("check points as tie points", hobart()), ("all 71 points as control", hobart(()))):
        sigma = {part.group: part.sigma for part in adjust(block, ESTIMATED).variance_components}
        centre, corner = sigma["image points: center"], sigma["image points: corner"]
        rows.append([text, f"{centre:.3f}", f"{corner:.3f}", f"{corner / centre:.2f}"])
    return "Hobart, variance components", ("points", "centres", "corners", "ratio"), rows


def hobart_chance() -> Section:
    """Return how often ties would cost Hobart its height by chance."""
    rows = []
    for drift in (0.0, 2e-5, 4e-5):
        change, spread = hobart_monte_carlo.height_changes(drift)
        more = float(np.mean(change >= hobart_monte_carlo.MEASURED_M))
        rows.append([f"{drift:.0e}", f"{change.mean():+.3f}", f"{change.std():.3f}", f"{more:.1%}", f"{spread:.3f}"])
    head = ("true drift, px/px", "mean change m", "its std m", "share as large or larger", "std of the RMSE m")
    return "Hobart, Monte Carlo", head, rows


def table_5_4() -> Section:
    """Return Hobart with 1 to 10 GCPs beside the thesis's."""
    rows = []
    for count, (shift, affine) in enumerate(TABLE_5_4, 1):
        bias = [_hobart_cell(count, TIES, "shift"), _hobart_cell(count, TIES, "generic-shift")]
        more = [_hobart_cell(count, options, "affine") for options in (TIES, ESTIMATED)]
        generic = _hobart_cell(count, TIES, "generic-affine")
        rows.append([str(count), metres(shift), *bias, metres(affine), *more, generic])
    head = (
        "GCPs", "shift, printed", "shift", "generic-shift", "affine, printed", "affine", "affine, drift estimated",
        "generic-affine",
    )  # fmt: skip
    return "Table 5.4 and figure 5.5: Hobart, 1 to 10 GCPs", head, rows


def _hobart_cell(count: int, options: AdjustOptions, model: str) -> str:
    try:
        return metres(check_rmse(adjust(hobart(TEN[:count]), replace(options, model=model))))
    except HrsiError:  # too few GCPs for this model
        return ""


# ---- simulated -----------------------------------------------------------------------------------------------------


@cache
def simulated_blocks(name: str) -> list[Block]:
    """Return blocks like the thesis's test fields, 10 GCPs each."""
    sensor, images, checks = SIMULATED[name]
    views = make_along_track_views(SENSORS[sensor], images, (12000, 12000))
    counts = PointCounts(10, checks, 200)
    return [simulate_block(SceneSpec(seed=seed), views, counts, NOISE).block for seed in SEEDS]


def with_gcps(block: Block, count: int) -> Block:
    """Return the block with its first GCPs only; the others are tie points."""
    role = block.points.role.copy()
    role[np.flatnonzero(role == Role.GCP)[count:]] = Role.TIE
    return replace(block, points=replace(block.points, role=role))


def table_5_5(name: str, printed: list[tuple[Three, Three]]) -> Section:
    """Return simulated blocks with 1 to 10 GCPs beside the thesis's field."""
    blocks, rows = simulated_blocks(name), []
    for count, (shift, affine) in enumerate(printed, 1):
        some = [with_gcps(block, count) for block in blocks]
        ours = [_simulated_cell(some, replace(PLAIN, model="affine", variance_components=yes)) for yes in (False, True)]
        rows.append([str(count), metres(shift), _simulated_cell(some, PLAIN), metres(affine), *ours])
    head = ("GCPs", "shift, printed", "shift, simulated", "affine, printed", "affine", "affine, drift estimated")
    return f"Simulated {name}, 1 to 10 GCPs", head, rows


def _simulated_cell(blocks: list[Block], options: AdjustOptions) -> str:
    """Return the RMS over blocks of the check points' RMSE."""
    try:
        return metres(np.sqrt(np.mean([check_rmse(adjust(block, options)) ** 2 for block in blocks], axis=0)))
    except HrsiError:  # too few GCPs for this model
        return ""


def formal_sigmas() -> Section:
    """Return tables 5.2 and 5.3: mean formal sigmas, and observed errors against predicted ones."""
    rows = [[name, "", metres(sigma), "", ""] for name, sigma in FORMAL.items()]
    result = adjust(hobart(), ESTIMATED)
    rows.append(["Hobart, HRSI (shift)", *_formal(result)])
    for name in SIMULATED:
        block = simulated_blocks(name)[0]
        for model in ("shift", "affine"):
            rows.append([f"{name}, simulated ({model})", *_formal(adjust(block, replace(PLAIN, model=model)))])
    head = ("block", "observed RMSE", "mean sigma", "predicted RMSE", "sigma0")
    return "Tables 5.2 and 5.3: formal accuracy", head, rows


def _formal(result: Adjustment) -> list[str]:
    block = result.block
    check = np.flatnonzero(block.points.role == Role.CHECK)
    predicted = predict_accuracy(result.ground_covariance_m2[check] + block.points.survey_covariance_m2(check))
    expected = [predicted[f"rmse_{axis}_m"] for axis in ("east", "north", "height")]
    sigma = np.nanmean(result.ground_sigma_m[check], axis=0)
    return [metres(check_rmse(result)), metres(sigma), metres(expected), f"{result.sigma0:.3f}"]


# ---- ZY-3, QuickBird, ties -----------------------------------------------------------------------------------------


def zy3_models() -> Section:
    """Return ZY-3 with 7 GCPs."""
    rows = [["Orthority, shift", "3.20 4.30 3.71"], ["Orthority, shift-drift", "3.35 3.96 3.81"]]
    for text, options in (
        ("shift", PLAIN),
        ("shift, check points as tie points", TIES),
        ("shift-drift", replace(PLAIN, model="shift-drift")),
        ("shift-drift, as tie points, variance components", replace(ESTIMATED, model="shift-drift")),
        ("affine", replace(PLAIN, model="affine")),
        ("auto, the default", AdjustOptions()),
        ("affine, as tie points, variance components", replace(ESTIMATED, model="affine")),
    ):
        rows.append([text, metres(check_rmse(adjust(zy3(), options)))])
    return "ZY-3, 7 control and 35 check points", ("model", "35 check points"), rows


def quickbird_loo() -> Section:
    """Return the QuickBird-2 image, each GCP left out in turn."""
    rows = []
    for model in ("shift", "affine"):
        error = adjust(quickbird(), replace(PLAIN, model=model, cross_validate=True)).cross_validation.error_m
        away = np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1)))
        rows.append([model, f"{away / 6.5:.3f}", metres(np.sqrt(np.mean(error[:, :2] ** 2, axis=0)))])
    return "QuickBird-2, 5 GCPs", ("model", "RMSE, px", "east, north, m"), rows


def tie_blocks() -> Section:
    """Return the blocks that have tie points only."""
    rows = []
    for text, make, rays in (
        ("s2p triplet, 3 views", triplet, 3),
        ("s2p triplet, all", triplet, None),
        ("SPOT 7", spot7, None),
    ):
        block = make()
        before = tie_rmse(adjust(block, replace(PLAIN, model="none")), rays)
        for model in ("shift", "affine", "auto"):
            began = time.perf_counter()
            result = adjust(block, AdjustOptions(model=model))
            seconds = time.perf_counter() - began
            every = tie_rmse(adjust(block, replace(PLAIN, model=model)), rays)
            out = int((result.decision > 0).sum())
            gross = int((np.nan_to_num(result.statistic) > 10.0).sum())
            rows.append([
                text, model, f"{before:.3f}", f"{every:.3f}", f"{tie_rmse(result, rays):.3f}",
                f"{out} of {len(block.measurements)}", str(gross), f"{seconds:.1f}",
            ])  # fmt: skip
    head = (
        "block", "model", "RPCs of the vendor", "all measurements", "tested", "rejected", "beyond 10 sigma", "seconds",
    )  # fmt: skip
    return "Tie points only", head, rows


# ---- output --------------------------------------------------------------------------------------------------------


SUBJECTS: dict[str, tuple[Callable[[], Section], ...]] = {
    "hobart": (hobart_by_kind, hobart_kinds, hobart_chance, table_5_4),
    "simulated": (
        formal_sigmas,
        lambda: table_5_5("QuickBird pair", TABLE_5_5),
        lambda: table_5_5("IKONOS triplet", TABLE_5_4),
    ),
    "zy3": (zy3_models,),
    "quickbird": (quickbird_loo,),
    "ties": (tie_blocks,),
}


def sections(names: Sequence[str]) -> Iterator[Section]:
    """Yield the tables of the named subjects, or of all."""
    for name in names or SUBJECTS:
        for make in SUBJECTS[name]:
            yield make()


def figure(path: Path, title: str, rows: list[list[str]], curves: dict[str, int]) -> None:
    """Write check RMSE against the number of GCPs as SVG, printed dashed; the same bytes every time."""
    drawn = Figure(figsize=(9.0, 3.4), layout="constrained")
    for axis, axes in enumerate(drawn.subplots(1, 3, sharex=True)):
        for label, column in curves.items():
            given = [(int(row[0]), float(row[column].split()[axis])) for row in rows if row[column]]
            style = "--" if "printed" in label else "-"
            axes.plot(*zip(*given, strict=True), style, marker="o", markersize=3, label=label)
        axes.set(title=f"{title}, {'XYZ'[axis]}", xlabel="GCPs", ylabel="RMSE of check points (m)", ylim=(0.0, 2.0))
        axes.grid(alpha=0.3)
    drawn.axes[0].legend(fontsize=7)
    with mpl.rc_context({"svg.hashsalt": "hrsi"}):
        drawn.savefig(path, format="svg", metadata={"Date": None})


def main(words: Sequence[str] | None = None, write: Callable[[str], object] = print) -> None:
    """Print the tables of the named subjects, or all; ``--docs`` writes them into the page, and its figures."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("names", nargs="*", choices=[*SUBJECTS, []], metavar="NAME", help="subjects; default: all")
    options = parser.parse_args(words)
    tables = {}
    for title, head, rows in sections(options.names):
        tables[title] = render(head, rows)
        write(f"\n{title}\n\n{tables[title]}")
        if options.docs and title.startswith(("Table 5.4", "Simulated QuickBird")):
            name, field = ("figure_5_5", "Hobart") if "5.4" in title else ("figure_5_6", "QuickBird")
            figure(
                PAGE.parent / f"{name}.svg", field, rows, {label: head.index(label) for label in head if label in DRAWN}
            )
    if options.docs:
        write_sections(PAGE, tables)


if __name__ == "__main__":
    main()
