"""Do the tests and the pages notice when an output is wrong? Each mutation goes into a copy, and its check must fail.

    python benchmarks/output_mutants.py [WORD ...]      "2 %": only changes of two per cent

Only the mutants whose names hold one of the words are tried; all of them take about two minutes. Exit code 1 where one
survives, where its tests fail without it, or where the text that it changes is gone.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hrsi.benchmarks.pages import DATA, ROOT

COPIED = (
    "__init__.py", "pyproject.toml", "hrsi_engine", "processing_algorithms", "plugin", "tests", "examples",
    "benchmarks", "docs", "scripts", "metadata.txt",
)  # fmt: skip
PAGE = "figures.py check "
TRUTH = "tests/oracle/test_adjustment.py"
OUTLIERS = "tests/results/test_outliers.py"


@dataclass(frozen=True)
class Mutant:
    """A mutation: ``old`` becomes ``new`` in a file of the engine.

    ``tests`` are those that must fail, or ``figures.py check NAME``, the page of the registry that must differ.
    """

    name: str
    file: str
    old: str
    new: str
    tests: str


MUTANTS = (
    Mutant(
        "sign of the ground residual", "results/residuals.py",
        "ground_difference_m(block.points.ground[usable], computed[usable])",
        "ground_difference_m(computed[usable], block.points.ground[usable])", TRUTH,
    ),
    Mutant(
        "sigma_east of ground_points is that of north", "results/tables.py", "sigma_east_m=sigma[:, 0]",
        "sigma_east_m=sigma[:, 1]", TRUTH,
    ),
    Mutant(
        "sigma_height of ground_points is that of east", "results/tables.py", "sigma_height_m=sigma[:, 2]",
        "sigma_height_m=sigma[:, 0]", TRUTH,
    ),
    Mutant(
        "sigma_north of the residual layers is that of height", "results/tables.py", "left.ground_sigma_m[surveyed, 1]",
        "left.ground_sigma_m[surveyed, 2]", TRUTH,
    ),
    Mutant(
        "CE90 of check points 2.146 RMSE", "adjustment/statistics/precision.py", "CIRCLE_90, LINE_90 = 1.5175, ",
        "CIRCLE_90, LINE_90 = 2.146, ", TRUTH,
    ),
    Mutant(
        "line RMSE of an image from its samples", "results/figures.py",
        '"rmse_line_px": rmse(left.at_known_px[image_rows, 1])',
        '"rmse_line_px": rmse(left.at_known_px[image_rows, 0])', TRUTH,
    ),
    Mutant(
        "sigma0 dropped from all covariances", "adjustment/outcome/assembly.py", "max(sigma0, 1.0) ** 2", "1.0", TRUTH,
    ),
    Mutant(
        "sigma0 dropped from the parameters' sigmas", "adjustment/outcome/assembly.py",
        "np.sqrt(factor[:, None] * precise.parameters", "np.sqrt(precise.parameters", TRUTH,
    ),
    Mutant(
        "sigma0 dropped from the points' covariances", "adjustment/outcome/assembly.py",
        "of_point * precise.points + systematic", "precise.points + systematic", TRUTH,
    ),
    Mutant(
        "sigma0 dropped from the parameters of single images", "refinement/estimate.py",
        "sigma0 * sigmas[:, None] * inverse", "sigmas[:, None] * inverse",
        "tests/refinement/test_models.py -k follow_from_the_residuals",
    ),
    Mutant(
        "GCPs count wholly in variance components", "adjustment/statistics/variance_components.py", "1.0 - decided,",
        "1.0 - 0.0 * decided,", "tests/adjustment/test_variance_groups.py",
    ),
    Mutant(
        "ICHIPB without the half pixel", "io/rpc_files/crop.py", ".reshape(2, 4) - 0.5",
        ".reshape(2, 4)", "tests/io/test_rpc_files.py -k ichipb",
    ),
    Mutant(
        "match keeps what lies across epipolar lines", "laboratory/control_network/growth.py",
        "keep &= np.abs(across[rows])", "keep &= 0.0 * np.abs(across[rows])",
        "tests/measurement/test_control_network.py -k epipolar",
    ),
    Mutant(
        "quadratic drift held as loosely as linear", "refinement/image_space.py", "np.maximum(degree - 1, 0)", "0",
        "tests/refinement/test_models.py -k edge_of_the_image",
    ),
    Mutant(
        "ellipse's noise over n points", "measurement/targets/ellipse.py", "(weight > 0.0).sum(axis=1) - 5",
        "(weight > 0.0).sum(axis=1)", "tests/measurement/test_ellipse.py",
    ),
    Mutant(
        "rivals from half of the misfit", "adjustment/blunders/control.py", "EQUALITY.alike * best)", "0.5 * best)",
        "tests/adjustment/test_rival_gcps.py",
    ),
    Mutant(
        "no rivals at all", "adjustment/blunders/control.py", "self.test_group(candidate)[0] >= limit",
        "self.test_group(candidate)[0] >= 2.0 * best", "tests/adjustment/test_rival_gcps.py",
    ),
    Mutant(
        "sigma0 dropped from what residuals are judged by", "adjustment/result.py", "return max(self.sigma0, 1.0)",
        "return 1.0", TRUTH,
    ),
    Mutant(
        "check points judged by the measurement and survey alone", "results/residuals.py",
        "np.where(check[points, None, None], predicted, 0.0)", "0.0 * predicted",
        TRUTH,
    ),
    Mutant(
        "drift that is not followed left out of the sigmas", "results/residuals.py",
        "drift[:, :, None] * drift[:, None, :]", "0.0 * drift[:, :, None] * drift[:, None, :]", OUTLIERS,
    ),
    Mutant(
        "outliers counted as listed", "results/outliers.py", '"outlier_count": len(worst)',
        '"outlier_count": min(len(worst), MOST_OUTLIERS)', OUTLIERS,
    ),
    Mutant(
        "flags by another limit than the list", "results/outliers.py",
        "outlier = is_outlier(left.statistic)", "outlier = left.statistic > 6.0", OUTLIERS,
    ),
    Mutant("2 %: CE90", "adjustment/statistics/precision.py", "= 1.5175,", "= 1.5479,", TRUTH),
    Mutant("2 %: LE90", "adjustment/statistics/precision.py", ", 1.6449", ", 1.6778", TRUTH),
    Mutant(
        "2 %: ground sample distance", "block/imaging_geometry.py", "np.hypot(steps[:, 0], steps[:, 1]).tolist()",
        "(1.02 * np.hypot(steps[:, 0], steps[:, 1])).tolist()",
        TRUTH,
    ),
    Mutant(
        "2 %: RMSE in all tables", "results/residuals.py", "return float(np.sqrt(np.mean(finite**2)))",
        "return 1.02 * float(np.sqrt(np.mean(finite**2)))", TRUTH,
    ),
    Mutant(
        "2 %: distance of a kind's residuals", "laboratory/registration.py", "float(np.hypot(*std))",
        "1.02 * float(np.hypot(*std))", PAGE + "chapter2",
    ),
    Mutant(
        "2 %: prior of the direct methods", "laboratory/direct_methods.py", '20.0, "px", "sys', '20.4, "px", "sys',
        PAGE + "thesis",
    ),
)  # fmt: skip


def fails(parent: Path, tests: str) -> bool:
    """Return whether a file's tests fail with the package ``parent/hrsi``; raise RuntimeError where none can run."""
    environment = os.environ | {"PYTHONPATH": str(parent), "PYTHONDONTWRITEBYTECODE": "1", "CI": ""}
    if tests.startswith(PAGE):
        words = [sys.executable, "benchmarks/figures.py", "check", tests.removeprefix(PAGE)]
        done = subprocess.run(
            words, cwd=parent / "hrsi", env=environment | {"HRSI_TEST_DATA": str(DATA)}, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        return done.returncode == 1
    command = [sys.executable, "-m", "pytest", "-p", "no:pytest_qgis", "-p", "no:cacheprovider", "-q", "-x"]
    arguments = tests.split(" ", 2)
    done = subprocess.run(
        [*command, *arguments], cwd=parent / "hrsi", env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{tests}: pytest ends with {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.returncode == 1


def verdict_on(mutant: Mutant, parent: Path) -> str:
    """Return ``dies``, ``SURVIVES`` or ``TEXT GONE``; the copy is as it was afterwards."""
    path = parent / "hrsi" / "hrsi_engine" / mutant.file
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    if mutant.old not in text:
        return "TEXT GONE"
    path.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
    try:
        return "dies" if fails(parent, mutant.tests) else "SURVIVES"
    finally:
        path.write_text(text, encoding="utf-8")


def copy_package(parent: Path) -> None:
    """Copy what the tests need to ``parent/hrsi``."""
    (parent / "hrsi").mkdir()
    for name in COPIED:
        source, target = ROOT / name, parent / "hrsi" / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, target)


def main(words: Sequence[str]) -> int:
    """Try the mutants, print a table; return the exit code."""
    chosen = [mutant for mutant in MUTANTS if not words or any(word in mutant.name for word in words)]
    with tempfile.TemporaryDirectory() as folder:
        parent = Path(folder)
        copy_package(parent)
        broken = [tests for tests in dict.fromkeys(mutant.tests for mutant in chosen) if fails(parent, tests)]
        for tests in broken:
            print(f"fails without any mutant: {tests}")
        print(f"| {'mutant':<57} | {'verdict':<9} | tests |\n|{'-' * 59}|{'-' * 11}|-------|")
        bad = len(broken)
        for mutant in chosen:
            found = verdict_on(mutant, parent)
            bad += found != "dies"
            print(f"| {mutant.name:<57} | {found:<9} | `{mutant.tests}` |", flush=True)
    print(f"{len(chosen)} mutants")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
