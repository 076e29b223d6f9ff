"""Blocks that believed their own inside: what the command line said of them, and says: `evidence.py [--docs]`.

Each row is a case that was found with the command line on real data (HRSI_TEST_DATA, see CONTRIBUTING.md) or on
simulated blocks, what was printed when it was found, and what is printed now. `evidence.py NAME …` runs the rows whose
name begins so.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import json
import random
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from osgeo import ogr

from hrsi.benchmarks.pages import DOCS, HOBART_NOTE
from hrsi.benchmarks.real_blocks import DATA, ZY3_CONTROL
from hrsi.benchmarks.thesis_tables import render
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.processing_algorithms.command_line import cli

PAGE = DOCS / "protocols/evidence.md"
THESIS, REAL = DATA / "thesis", DATA / "real"
HOBART = sorted(str(path) for path in THESIS.glob("hobart_ikonos_*_RPC.TXT"))
HOBART_POINTS = [
    "--gcps", str(THESIS / "hobart_ground_points.csv"), "--image-points", str(THESIS / "hobart_image_points.csv"),
    "--height-datum", "ellipsoidal",
]  # fmt: skip
#: An accuracy of Hobart's points that is three to five times too good.
TOO_GOOD = ["--sigma-image", "0.1", "--sigma-gcp-xy", "0.1", "--sigma-gcp-h", "0.5"]
FOUR_DATES = [str(REAL / "kahramanmaras_phr4" / f"{when}_event_img{k}.tif") for when in ("pre", "post") for k in (1, 2)]
#: Biased sensors, their bias in metres, and what was said of it in eight directions.
BIASED = (
    ("pleiades", 60.0, '*unusable*, "converted from NTF"'),
    ("worldview-2", 40.0, "*unusable*, a datum named"),
    ("ikonos", 30.0, '*unusable*, "WGS 72BE" in 2 of 8'),
)


# ---- the command line ----------------------------------------------------------------------------------------------


def run(algorithm: str, *words: str, out: str) -> dict[str, Any]:
    """Return the report of a command that writes into a folder ``out``; an unusable block has one, too."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
        code = cli.main([algorithm, *words, "--output-dir", out, "--overwrite"])
    if code not in (0, 3):
        raise RuntimeError(f"{algorithm} {' '.join(words)}\n{told.getvalue()}")
    return dict(json.loads((Path(out) / "report.json").read_text(encoding="utf-8")))


def simulate(out: str, seed: int, *words: str) -> list[str]:
    """Return the images of a simulated block without pixels, and the options that name its points."""
    run("simulate", "--no-pixels", "--seed", str(seed), *words, out=out)
    return [
        *(str(path) for path in sorted(Path(out).glob("*_RPC.TXT"))),
        "--gcps", f"{out}/ground_points.csv", "--image-points", f"{out}/image_points.csv",
        "--height-datum", "ellipsoidal",
    ]  # fmt: skip


def triangulate(*words: str, out: str, ties: str = "none") -> dict[str, Any]:
    """Return the report of `triangulate`."""
    return run("triangulate", *words, "--tie-points", ties, "--no-report", "--write", "sidecar", out=out)


def tell(report: Mapping[str, Any]) -> str:
    """Return verdict and reasons in a line."""
    verdict = report["verdict"]
    codes = ", ".join(dict.fromkeys(reason["code"] for reason in verdict["reasons"]))
    return f"sigma0 {report['sigma0']:.2f}; {verdict['sentence']}; *{verdict['level']}*" + (
        f" ({codes})" if codes else ""
    )


def count_levels(reports: Sequence[Mapping[str, Any]]) -> str:
    """Return how often each verdict and reason was given."""
    levels = Counter(report["verdict"]["level"] for report in reports)
    codes = Counter(code for report in reports for code in {one["code"] for one in report["verdict"]["reasons"]})
    text = ", ".join(f"*{level}* {count}" for level, count in levels.most_common())
    return text + (": " + ", ".join(f"{code} {count}" for code, count in codes.most_common()) if codes else "")


# ---- rows ----------------------------------------------------------------------------------------------------------


def compare_four_dates() -> str:
    """Two dates without GCPs: what is delivered against the shift model on the same ties."""
    report = triangulate(*FOUR_DATES, out="dates", ties="auto")
    run("adjust", *FOUR_DATES, "--tie-points", "dates", "--model", "shift", "--write", "none", out="shifts")
    auto, shift = (_read_points(f"{name}/block.gpkg") for name in ("dates", "shifts"))
    both = sorted(auto.keys() & shift.keys())
    apart = ground_difference_m(*(np.array([points[name] for name in both]) for points in (shift, auto)))
    drift = max(abs(image["parameters"]["sample_l"]["value"]) for image in report["images"].values())
    east, _, up = np.abs(apart).max(axis=0)
    return (
        f"`sample_l` up to {drift:.1e}; ground up to {east:.2f} m east, {up:.2f} m in height from the shift "
        f"model's; {tell(report)}"
    )


def _read_points(path: str) -> dict[str, tuple[float, float, float]]:
    source = ogr.Open(path)
    features = list(source.GetLayerByName("ground_points"))
    place = {one["id"]: one.GetGeometryRef().GetPoint(0) for one in features}
    return {name: point for name, point in place.items() if np.isfinite(point).all()}


def state_hobart(gcps: int, model: str = "auto") -> str:
    """Hobart with GCPs stated too well: sigma0, and the share of check points within ellipses and headline."""
    with open(THESIS / "hobart_image_points.csv", encoding="utf-8") as file:
        ids = sorted({row["id"] for row in csv.DictReader(file)})
    chosen = random.Random(3).sample(ids, min(gcps, len(ids)))
    control = ["--gcp-ids", ",".join(sorted(chosen)), "--model", model]
    report = triangulate(*HOBART, *HOBART_POINTS, *TOO_GOOD, *control, out="hobart")
    return tell(report) + (_cover([report]) if report["check"]["points"] else "")


def _cover(reports: Sequence[Mapping[str, Any]]) -> str:
    """Return the shares of check points within their own 90 % intervals and within their block's headline."""
    own, headline = [], []
    for report in reports:
        points, predicted = report["check_points"], report["check"]["predicted"]
        error, sigma = (
            np.array([[one[f"{kind}{axis}_m"] for axis in ("east", "north", "height")] for one in points], dtype=float)
            for kind in ("", "sigma_")
        )
        seen = np.isfinite(error).all(axis=1)
        error, sigma = np.abs(error[seen]), sigma[seen]
        own.append(error < 1.645 * sigma)  # 90 % of a normal distribution
        plan = np.hypot(error[:, 0], error[:, 1]) < predicted["ce90_m"]
        headline.append(np.column_stack([plan, error[:, 2] < predicted["le90_m"]]))
    east, north, height = np.concatenate(own).mean(axis=0)
    ce90, le90 = np.concatenate(headline).mean(axis=0)
    return (
        f"; within their own 90 % east {east:.0%}, north {north:.0%}, height {height:.0%}, "
        f"within the headline CE90 {ce90:.0%}, LE90 {le90:.0%}"
    )


def refine_hobart() -> str:
    """Return the verdict of `refine-rpc` on an image of Hobart with GCPs stated too well."""
    words = [*HOBART_POINTS, *TOO_GOOD, "--write", "none", "--no-report"]
    return tell(run("refine-rpc", HOBART[0], *words, out="refined"))


def understate_sigmas() -> str:
    """WorldView-2 with 9 GCPs, all sigmas a third of what they are: verdicts and coverage over 20 seeds."""
    reports = []
    for seed in range(700, 720):
        words = simulate("third", seed, "--sensor", "worldview-2", "--gcps", "9", "--checks", "50")
        for name, columns in (("ground_points", ("sigma_xy", "sigma_h")), ("image_points", ("sigma",))):
            _scale_columns(Path("third") / f"{name}.csv", columns, 1.0 / 3.0)
        reports.append(triangulate(*words, out="thirds"))
    return count_levels(reports) + _cover(reports)


def _scale_columns(path: Path, columns: Sequence[str], factor: float) -> None:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(row | {name: float(row[name]) * factor for name in columns if row[name]} for row in rows)


def measure_one_image() -> str:
    """QuickBird-2 with five GCPs: one image predicts no height."""
    folder = REAL / "qb2_gcp"
    return tell(triangulate(str(folder / "qb2_basic1b.tif"), "--gcps", str(folder / "gcps.geojson"), out="single"))


def judge_zy3() -> str:
    """ZY-3 with seven GCPs: the model that is delivered, and what its residuals show of the sigmas."""
    folder = REAL / "zy3_stereo_gcp"
    images = [str(folder / f"zy301a_{view}_381_6138_rpc.txt") for view in ("fwd", "bwd")]
    point = np.loadtxt(folder / "image_points_fwd_bwd.txt", skiprows=1, dtype=str)
    ground = np.loadtxt(folder / "ground_points_all42.txt", skiprows=1, dtype=str)
    with open("zy3_image.csv", "w", encoding="utf-8") as file:
        file.write("id,image,sample,line\n")
        for k, view in enumerate(("fwd", "bwd")):
            file.writelines(f"{p[0]},zy301a_{view}_381_6138,{p[2 + 2 * k]},{p[1 + 2 * k]}\n" for p in point)
    with open("zy3_ground.csv", "w", encoding="utf-8") as file:
        file.write("id,lon,lat,height\n")
        file.writelines(f"{g[0]},{g[2]},{g[1]},{g[3]}\n" for g in ground)
    report = triangulate(
        *images, "--gcps", "zy3_ground.csv", "--image-points", "zy3_image.csv", "--gcp-ids", ",".join(ZY3_CONTROL),
        "--height-datum", "ellipsoidal", out="zy3",
    )  # fmt: skip
    choice = report["model_choice"]
    predicted = ", ".join(f"{name} {value['block_px']:.2f}" for name, value in choice["leave_one_out"].items()
                          if value["block_px"])  # fmt: skip
    return f"model {report['model']} (leave-one-out, px: {predicted}); {tell(report)}"


def bias_rpcs(sensor: str, bias_m: float) -> str:
    """Return verdicts of eight GCPs on RPCs biased in eight directions."""
    reports = []
    for direction in range(8):
        east, north = bias_m * np.sin(direction * np.pi / 4), bias_m * np.cos(direction * np.pi / 4)
        bias = f"--vendor-position={east:.3f},{north:.3f},0"
        reports.append(triangulate(*simulate("biased", 20 + direction, "--sensor", sensor, bias, "--gcps", "8"),
                                   out="unbiased"))  # fmt: skip
    return count_levels(reports)


def spoil(*words: str) -> str:
    """Return verdicts on five blocks with blunders, and how often RPCs were written."""
    reports = []
    written = 0
    for seed in range(31, 36):
        out = f"spoilt_{seed}_{len(words[0])}"
        reports.append(triangulate(*simulate("spoilt", seed, "--gcps", "7", *words), out=out))
        written += bool(list(Path(out).glob("*_RPC.TXT")))
    return f"{count_levels(reports)}; RPCs written {written} of {len(reports)}"


def evaluate_used_ties() -> str:
    """Return what `evaluate` says of refined RPCs, by the very ties that made them and with ties held out."""
    told = []
    for ties in ("300", "1000"):
        words = simulate(f"used{ties}", 41, "--gcps", "8", "--checks", "0", "--ties", ties)
        triangulate(*words, out=f"made{ties}")
        images = [word for word in words if word.endswith("_RPC.TXT")]
        report = run("evaluate", *images, "--rpcs", f"refined=made{ties}", "--tracks", f"made{ties}/block.gpkg",
                     "--no-report", out="judged")  # fmt: skip
        note = next((one for one in report["warnings"] if "used for RPCs" in one), "no warning").split(";")[0]
        best = ", ".join(f"{one} ({by})" for by, one in report["best"].items() if one) or "none"
        told.append(f"{ties} tie points: best {best}; {note}")
    return ". ".join(told)


def resample_unknown() -> str:
    """Return the CE90 predicted of an unknown sensor's images, whole and at half resolution."""
    images = [str(REAL / "s2p_triplet_phr" / f"img_0{k}.tif") for k in (1, 2, 3)]
    run("crop", *images, "--factor", "0.5", out="half")
    half = [str(path) for path in sorted(Path("half").glob("*.tif"))]
    figures = [triangulate(*of, out="unknown", ties="auto")["parts"][0] for of in (images, half)]
    told = (f"CE90 {one['ce90_m']:.1f} m, LE90 {one['le90_m']:.0f} m" for one in figures)
    return "{}; at half resolution {}".format(*told)


def compare_control() -> str:
    """Return the residuals of control by `triangulate`, and by `evaluate` of what it wrote."""
    words = simulate("control", 41, "--gcps", "8")
    first = triangulate(*words, out="controlled")["control"]
    images = [str(path) for path in sorted(Path("controlled").glob("*_RPC.TXT"))]
    options = [word for word in words if not word.endswith("_RPC.TXT")]
    report = run("evaluate", *images, "--tracks", "none", *options, "--no-report", out="again")
    second = report["sets"]["own"]["control"]
    told = [
        " / ".join(f"{one[f'rmse_{axis}_m']:.3f}" for axis in ("east", "north", "height")) for one in (first, second)
    ]
    return "triangulate {} m, evaluate {} m (east / north / height)".format(*told)


#: Name of a case: what was printed when it was found, and what prints it now.
ROWS: Mapping[str, tuple[str, Callable[[], str]]] = {
    "four-date Pléiades block, no GCPs": (
        "`sample_l` 3.0e-03 to 3.5e-03; ground −1.7…+1.4 m east, −2.2…+4.3 m in height from the shift model's; *ok*",
        compare_four_dates,
    ),
    "Hobart, sigmas 3 to 5 times too small, 10 GCPs": (
        "estimated well, coverage 80 to 98 %", lambda: state_hobart(10),
    ),
    "Hobart, the same, 25 GCPs": ("sigma0 2.7 without a warning", lambda: state_hobart(25)),
    "Hobart, the same, 45 GCPs": (
        "sigma0 3.1; CE90 1.5 m (predicted 0.35), 28 % covered; *ok*", lambda: state_hobart(45),
    ),
    "Hobart, the same, 45 GCPs, generic": ("33 to 53 % covered", lambda: state_hobart(45, "generic")),
    "Hobart, the same, all GCPs": (
        "sigma0 3.4; predicted CE90 0.41 m, 0.8 m by leave-one-out; 5044 m with a GCP left out",
        lambda: state_hobart(99),
    ),
    "Hobart, refine-rpc of one image": ("sigma0 4.78; *ok*", refine_hobart),
    "WorldView-2, 9 GCPs, sigmas 3 times too small, 20 seeds": (
        "ellipses 86 %, headline 65.5 %; *ok* 20", understate_sigmas,
    ),
    "QuickBird-2, one image, 5 GCPs": ("predicted LE90 0.49 m, the GCPs' own sigma", measure_one_image),
    "ZY-3, 7 GCPs": (
        "affine, though shift predicts 2.196 and affine 3.749 px; sigma0 2.83, LE90 5.97 m, 14.25 predicted; *ok*",
        judge_zy3,
    ),
    **{
        f"{sensor} biased by {bias:.0f} m in 8 directions, 8 GCPs": (before, partial(bias_rpcs, sensor, bias))
        for sensor, bias, before in BIASED
    },
    "2 of 7 GCP heights wrong, 5 seeds": (
        "*unusable*, no RPC written", lambda: spoil("--wrong-heights", "0.286"),
    ),
    "30 % of tie measurements wrong, 5 seeds": ("*unusable*, no RPC written", lambda: spoil("--blunders", "0.3")),
    "evaluate with the tie points of the adjustment": ('"best: refined", no warning', evaluate_used_ties),
    "unknown sensor": ("half the resolution, twice the metres", resample_unknown),
    "residuals of control": ("triangulate 0.07 m, evaluate 2.4 m", compare_control),
}  # fmt: skip
INTRODUCTION = f"""# Verdicts of critical blocks, before and now

Made by `python benchmarks/evidence.py --docs`.

In these cases the verdict relied on residuals, a drift or tie points of the block itself. They were found with the
command line on real and simulated data. The column *before* was printed when they were found, the column *now* is
printed now. [Verdict](../verdict.md) explains the reasons. The coverage is that of check points. If the sigmas of
the GCPs are stated too small, so are those of the check points.

{HOBART_NOTE}"""


def main(words: Sequence[str] = ()) -> None:
    """Print the table; ``--docs`` writes the page."""
    parser = argparse.ArgumentParser(prog="evidence.py", description=__doc__)
    parser.add_argument("names", nargs="*", default=[""], help="rows whose name begins so")
    parser.add_argument("--docs", action="store_true", help=f"write {PAGE.name}")
    options = parser.parse_args(list(words))
    rows = []
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name, (before, measure) in ROWS.items():
            if any(name.startswith(one) for one in options.names):
                rows.append([name, before, measure()])
                print(" | ".join(rows[-1]), flush=True)
    if options.docs:
        PAGE.write_text(f"{INTRODUCTION}\n{render(['case', 'before', 'now'], rows)}\n", encoding="utf-8")


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
