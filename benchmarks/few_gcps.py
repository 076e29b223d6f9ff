"""How models do with one, two or three GCPs, whichever they are: `few_gcps.py [--docs] [--most N]`.

Real blocks with every choice of one GCP, and with `--most` choices of two and of three, evenly taken. The check
points' measurements are ties, and the model is adjusted with the defaults. A figure is the RMSE over all choices and
check points, in m east, north, height; then the worst choice's height, and in how many choices the height is better
than a shift's.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from hrsi.benchmarks.pages import DOCS, HOBART_NOTE
from hrsi.benchmarks.real_blocks import TEN, ZY3_CONTROL, check_rmse, hobart, zy3
from hrsi.benchmarks.thesis_tables import render
from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.statistics.precision import LINE_90
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.results.residuals import compute_residuals

PAGE = DOCS / "protocols/few_gcps.md"
MODELS = ("shift", "generic-shift", "affine", "generic-12", "generic-affine", "generic-full")
BLOCKS: dict[str, tuple[Callable[[Sequence[str]], Block], tuple[str, ...]]] = {
    "Hobart, IKONOS triplet": (hobart, TEN),
    "ZY-3 pair": (zy3, ZY3_CONTROL),
}
HEAD = ("GCPs", "choices", "model", "RMSE east, north, height m", "worst height m", "height better than shift's")
INTRODUCTION = f"""# One, two or three GCPs

Printed by `python benchmarks/few_gcps.py --docs`. The table has all choices of one GCP among those in
`benchmarks/real_blocks.py`, and evenly distributed choices of two and three. Measurements of check points are used as
tie points. RMSE over all choices and check points; the height RMSE of the worst choice; in how many choices a model's
height is better than a shift's.

{HOBART_NOTE}"""


def choices(ids: Sequence[str], count: int, most: int) -> list[tuple[str, ...]]:
    """Return choices of ``count`` GCPs, at most so many, evenly from all."""
    every = list(combinations(ids, count))
    return [every[k] for k in np.unique(np.linspace(0, len(every) - 1, min(most, len(every))).astype(int))]


def errors(make: Callable[[Sequence[str]], Block], chosen: list[tuple[str, ...]], model: str) -> np.ndarray:
    """Return the check RMSE of each choice, ``(choices, 3)`` m."""
    options = AdjustOptions(model=model, check_as_ties=True, reject_sigma=0.0)
    return np.array([check_rmse(adjust(make(ids), options)) for ids in chosen])


def rows(make: Callable[[Sequence[str]], Block], ids: Sequence[str], most: int) -> list[list[str]]:
    """Return the table of a block."""
    table = []
    for count in (1, 2, 3):
        chosen = choices(ids, count, most)
        found = {model: errors(make, chosen, model) for model in MODELS}
        for model, rmse in found.items():
            numbers = " ".join(f"{value:.3f}" for value in np.sqrt(np.mean(rmse**2, axis=0)))
            better = int((rmse[:, 2] < found["shift"][:, 2]).sum())
            table.append([
                str(count), str(len(chosen)), model, numbers, f"{rmse[:, 2].max():.3f}",
                "" if model == "shift" else str(better),
            ])  # fmt: skip
    return table


HEIGHTS = """## The heights of table 5.4

The thesis prints 0.93 to 0.96 m for Hobart's heights with 1 to 10 GCPs, over 113 points. Its appendix has measurements
of 71 of them, and image 2, the third ray, has 17. By rays and kind, shift, ten GCPs, RMSE east, north, height in m:
"""


def heights() -> str:
    """Return what Hobart's heights depend on: how many images show a point, and how it was measured."""
    block = hobart()
    result = adjust(block, AdjustOptions(model="shift", check_as_ties=True, reject_sigma=0.0))
    rays = block.rays_per_point()
    kind = np.empty(len(block.points), dtype=object)
    kind[block.measurements.point] = block.measurements.kind
    groups = {
        "all": rays > 1, "on three images": rays == 3, "on two images": rays == 2,
        "centres on two": (rays == 2) & (kind == "center"), "corners on two": (rays == 2) & (kind == "corner"),
    }  # fmt: skip
    checks = block.points.role == Role.CHECK
    table = [
        [text, str(int((checks & of).sum())), " ".join(f"{value:.3f}" for value in check_rmse(result, of=of))]
        for text, of in groups.items()
    ]
    table.append(["thesis, table 5.4, 10 GCPs", "103", "0.566 0.507 0.943"])
    return (
        f"{HEIGHTS}\n{render(('check points', 'number', 'RMSE'), table)}\n\n"
        "Points on three images reach the printed heights; corners on two, measured to 0.6 px, cannot: rays that meet "
        "at 42 degrees turn that into 2 m.\n"
    )


COVERAGE = """## Predictions with more GCPs

Hobart with random choices among its 71 surveyed points, default options of `adjust`. The others are check points. With
71 GCPs each is predicted by an adjustment without its survey (leave-one-out). Errors contain survey and measurement of
the check points. *CE90* and *LE90*: shares inside the predicted figures of the block (without surveys). *Ellipse* and
*sigma*: inside the 90 % limits of each point. Errors (90 %) and predicted figures in m.
"""


def cover(counts: Sequence[int] = (10, 25, 45, 71), repeats: int = 12) -> str:
    """Return how many check points lie inside their predictions, by the number of GCPs."""
    block, rng, table = hobart(), np.random.default_rng(5), []
    surveyed = np.flatnonzero(np.isin(block.points.role, [Role.GCP, Role.CHECK]))
    for count in counts:
        everything, shares = count == len(surveyed), list[list[float]]()
        for number in range(len(surveyed) if everything else repeats):
            gcps = np.delete(surveyed, number) if everything else rng.permutation(surveyed)[:count]
            role = block.points.role.copy()
            role[surveyed], role[gcps] = Role.CHECK, Role.GCP
            result = adjust(replace(block, points=replace(block.points, role=role)))
            check = np.flatnonzero(role == Role.CHECK)
            error = compute_residuals(result).ground_m[check]
            covariance = result.covariance_to_surveys_m2(check) + result.survey_covariance_m2(check)
            squares = np.einsum("ki,kij,kj->k", error[:, :2], np.linalg.inv(covariance[:, :2, :2]), error[:, :2])
            plan_m, height_m, part = np.hypot(*error[:, :2].T), np.abs(error[:, 2]), result.parts[0]
            assert part.ce90_m is not None and part.le90_m is not None
            inside = [plan_m <= part.ce90_m, height_m <= part.le90_m, squares <= -2.0 * np.log(0.1),
                      height_m <= LINE_90 * np.sqrt(covariance[:, 2, 2])]  # fmt: skip
            shares.append([*(100.0 * np.mean(inside, axis=1)), np.quantile(plan_m, 0.9), part.ce90_m,
                           np.quantile(height_m, 0.9), part.le90_m])  # fmt: skip
        mean = np.mean(shares, axis=0)
        if everything:  # one point each: quantiles over all
            mean[[4, 6]] = np.quantile(np.array(shares)[:, [4, 6]], 0.9, axis=0)
        table.append([str(count), *(f"{one:.0f}" for one in mean[:4]), *(f"{one:.2f}" for one in mean[4:])])
    head = ("GCPs", "CE90 %", "LE90 %", "ellipse %", "sigma %", "plan m", "CE90 m", "height m", "LE90 m")
    return f"{COVERAGE}\n{render(head, table)}\n"


HALVES = """## Two halves of the GCPs

The 71 surveyed points of Hobart are divided by chance into 35 and 36, and each half adjusts the block alone (model
`shift`, drifts within their a priori sigmas). The image corrections of the halves differ by the errors of both.
*Found*: root mean square of the difference in px (sample, line); *predicted*: root of the sum of both variances.
*Inside* is the share of the differences in both coordinates inside the 90 % ellipse of that sum.
"""


def compare_halves(repeats: int = 20) -> str:
    """Return how much the cameras of two halves of the GCPs differ, against the sum of their covariances."""
    block, rng = hobart(), np.random.default_rng(7)
    surveyed = np.flatnonzero(np.isin(block.points.role, [Role.GCP, Role.CHECK]))
    differences, covariances = [], []
    for _ in range(repeats):
        halves = np.array_split(rng.permutation(surveyed), 2)
        cameras = []
        for half in halves:
            role = block.points.role.copy()
            role[surveyed], role[half] = Role.CHECK, Role.GCP
            one = replace(block, points=replace(block.points, role=role))
            cameras.append(adjust(one, AdjustOptions(model="shift")).cameras)
        differences.append((cameras[0].values - cameras[1].values)[:, :2])
        covariances.append((cameras[0].covariance + cameras[1].covariance)[:, :2, :2])
    squares = np.einsum("rip,ripq,riq->ri", differences, np.linalg.inv(covariances), differences)
    found = np.sqrt(np.mean(np.square(differences), axis=0))
    predicted = np.sqrt(np.mean(np.diagonal(covariances, axis1=2, axis2=3), axis=0))
    table = [
        [image.id, *(" ".join(f"{one:.2f}" for one in row) for row in rows_of_image), f"{100.0 * share:.0f}"]
        for image, *rows_of_image, share in zip(
            block.images, found, predicted, np.mean(squares <= -2.0 * np.log(0.1), axis=0), strict=True
        )
    ]
    return f"{HALVES}\n{render(('image', 'found px', 'predicted px', 'inside %'), table)}\n"


def main() -> None:
    """Print the tables; ``--docs`` writes the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--most", type=int, default=20, help="choices of two and of three GCPs")
    words = parser.parse_args()
    parts = [INTRODUCTION]
    for title, (make, ids) in BLOCKS.items():
        parts.append(f"## {title}\n\n{render(HEAD, rows(make, ids, words.most))}\n")
        print(parts[-1], flush=True)
    for part in (heights(), cover(), compare_halves()):
        parts.append(part)
        print(part, flush=True)
    if words.docs:
        PAGE.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
