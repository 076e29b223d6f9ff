"""True errors of refined RPCs, by GDAL's evaluation of them: what a wrong input costs, and whether it is told."""

from __future__ import annotations

import itertools
import tempfile
import traceback
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from osgeo import gdal

from hrsi.benchmarks.pages import DOCS, render
from hrsi.benchmarks.wrong_inputs import Inputs, TruePoints, clean, make_generator, written
from hrsi.benchmarks.wrong_kinds import TRUE_KINDS, TrueKind
from hrsi.hrsi_engine.foundation.errors import HrsiError

HALF_RAY_M = 100.0
PAGE = DOCS / "protocols/harmful_inputs.md"


class Harm(NamedTuple):
    """What came of a run: its verdict, the codes of its reasons, and true against predicted errors in metres.

    ``verdict`` is ``refused`` where the inputs were refused; errors are NaN where no refined RPC was written.
    """

    verdict: str
    codes: tuple[str, ...]
    ce90_m: float
    le90_m: float
    predicted_ce90_m: float
    predicted_le90_m: float
    told: str

    @property
    def times(self) -> float:
        """The larger of both errors as a multiple of what was predicted; 0 where nothing was written."""
        ratios = [self.ce90_m / self.predicted_ce90_m, self.le90_m / self.predicted_le90_m]
        return float(np.nanmax([0.0, *ratios]))

    @property
    def is_harmful(self) -> bool:
        """Whether refined RPCs were written that err by more than twice what was predicted."""
        return self.times > 2.0

    @property
    def is_silent(self) -> bool:
        """Whether nothing was said."""
        return self.verdict == "ok"


def run_for_harm(inputs: Inputs) -> Harm:
    """Adjust files as the command line does, and measure what the refined RPCs are worth."""
    from hrsi.processing_algorithms import run

    nothing = (np.nan,) * 4
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            report = run("adjust", **written(inputs, folder))
        except HrsiError as error:
            return Harm("refused", (), *nothing, str(error))
        except Exception:
            return Harm("crashed", (), *nothing, traceback.format_exc())
        verdict = report["verdict"]
        codes = tuple(reason["code"] for reason in verdict["reasons"])
        rpcs = [read_rpc_text(folder / "out" / f"{Path(path).stem}_RPC.TXT") for path in _paths(inputs)]
        assert inputs.truth is not None
        error = measure_errors(rpcs, inputs.truth)
        part = next((part for part in report["parts"] if part["ce90_m"] is not None), None) or {}
        predicted = (float(part.get("ce90_m") or np.nan), float(part.get("le90_m") or np.nan))
        return Harm(verdict["level"], codes, *error, *predicted, verdict["sentence"])


def _paths(inputs: Inputs) -> list[str]:
    return [image.path or image.id for image in inputs.images]


def read_rpc_text(path: Path) -> dict[str, str] | None:
    """Return the fields of an ``_RPC.TXT`` as GDAL's metadata domain; None where there is no file."""
    if not path.exists():
        return None
    fields: dict[str, str] = {}
    terms: dict[str, list[str]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        name, _, value = line.partition(":")
        key, value = name.strip(), value.split()[0] if value.split() else ""
        head, _, number = key.rpartition("_")
        if head.endswith("COEFF") and number.isdigit():
            terms.setdefault(head, []).append(value)
        else:
            fields[key] = value
    return fields | {name: " ".join(values) for name, values in terms.items()}


def measure_errors(rpcs: Sequence[dict[str, str] | None], truth: TruePoints) -> tuple[float, float]:
    """Return the 90 % quantiles of plan and height errors (m) of points intersected from their true pixels.

    Parameters
    ----------
    rpcs : sequence of dict
        GDAL's metadata of each image, None where it has no refined RPC.
    truth : TruePoints
        True positions, and their pixels.

    Returns
    -------
    tuple of float
        CE90 and LE90; NaN where no point is on two of these images (CE90 of one image is at the true height).
    """
    error = intersect_pixels(rpcs, truth)
    if len(error):
        return float(np.quantile(np.hypot(*error[:, :2].T), 0.9)), float(np.quantile(np.abs(error[:, 2]), 0.9))
    plan = []
    for index, metadata in enumerate(rpcs):
        rows = truth.image == index
        if metadata is not None and rows.any():
            ground = truth.ground[truth.point[rows]]
            off = _offsets_m(_localize(metadata, truth.xy[rows], ground[:, 2]), ground)
            plan.append(np.hypot(*off[:, :2].T))
    return (float(np.quantile(np.concatenate(plan), 0.9)) if plan else np.nan), np.nan


def intersect_pixels(rpcs: Sequence[dict[str, str] | None], truth: TruePoints) -> np.ndarray:
    """Return the errors ``(k, 3)`` east, north, up (m) of points intersected from true pixels on two images or more.

    Arguments as of `measure_errors`. A point's rays are taken from 100 m below to 100 m above where it lies.
    """
    normals = np.zeros((len(truth.ground), 3, 3))
    sums = np.zeros((len(truth.ground), 3))
    rays = np.zeros(len(truth.ground), dtype=int)
    for index, metadata in enumerate(rpcs):
        rows = truth.image == index
        if metadata is None or not rows.any():
            continue
        ground, points = truth.ground[truth.point[rows]], truth.point[rows]
        low, high = (
            _offsets_m(_localize(metadata, truth.xy[rows], ground[:, 2] + step), ground)
            for step in (-HALF_RAY_M, HALF_RAY_M)
        )
        along = high - low
        along /= np.linalg.norm(along, axis=1)[:, None]
        across = np.eye(3) - along[:, :, None] * along[:, None, :]
        normals[points] += across
        sums[points] += np.einsum("nij,nj->ni", across, low)
        rays[points] += 1
    met = rays > 1
    off = np.where(np.isfinite(sums[met]).all(axis=1)[:, None], sums[met], 1e6)
    matrix = np.where(np.isfinite(normals[met]).all(axis=(1, 2))[:, None, None], normals[met], np.eye(3))
    return np.linalg.solve(matrix, off[..., None])[..., 0] if met.any() else np.empty((0, 3))


def _localize(metadata: dict[str, str], xy: np.ndarray, height_m: np.ndarray) -> np.ndarray:
    """Return lon, lat, height ``(n, 3)`` of pixels at heights, by GDAL; NaN where it finds none."""
    dataset = gdal.GetDriverByName("MEM").Create("", 1, 1)
    dataset.SetMetadata(metadata, "RPC")
    transformer = gdal.Transformer(dataset, None, ["METHOD=RPC", "RPC_PIXEL_ERROR_THRESHOLD=0.0001"])
    found, ok = transformer.TransformPoints(0, np.column_stack([xy + 0.5, height_m]).tolist())
    ground = np.array(found)[:, :3]
    ground[~np.array(ok, dtype=bool)] = np.nan
    return ground


def _offsets_m(ground: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return east, north, up (m) of positions from others near them; WGS84's radii of curvature."""
    a, e2 = 6378137.0, 0.00669437999014
    sine = np.sin(np.radians(origin[:, 1]))
    prime = a / np.sqrt(1.0 - e2 * sine**2)
    meridian = prime * (1.0 - e2) / (1.0 - e2 * sine**2)
    step = ground - origin
    return np.column_stack([
        np.radians(step[:, 0]) * (prime + origin[:, 2]) * np.cos(np.radians(origin[:, 1])),
        np.radians(step[:, 1]) * (meridian + origin[:, 2]), step[:, 2],
    ])  # fmt: skip


class HarmRow(NamedTuple):
    """What came of the runs of one kind: how many ended with each verdict, did harm, and did it silently."""

    kind: TrueKind
    runs: list[tuple[str, int, Harm]]

    def count(self, *verdicts: str) -> int:
        """Return the number of runs that ended so."""
        return sum(harm.verdict in verdicts for _, _, harm in self.runs)

    @property
    def silent_and_harmful(self) -> list[tuple[str, int, Harm]]:
        """The runs that did harm without a word."""
        return [run for run in self.runs if run[2].is_silent and run[2].is_harmful]

    def cells(self) -> list[str]:
        """Return the row's figures as text."""
        harms = [harm for _, _, harm in self.runs]
        codes = Counter(code for harm in harms for code in harm.codes)
        return [
            self.kind.name, str(len(harms)), str(self.count("refused", "unusable")), str(self.count("doubtful")),
            str(self.count("ok")), str(sum(harm.is_harmful for harm in harms)), str(len(self.silent_and_harmful)),
            f"{max(harm.times for harm in harms):.1f}", ", ".join(code for code, _ in codes.most_common(3)),
            self.kind.untold,
        ]  # fmt: skip


def run_kind(kind: TrueKind, sensors: Sequence[str], seeds: Sequence[int], tell: bool = False) -> HarmRow:
    """Run one kind on blocks of sensors and seeds."""
    row = HarmRow(kind, [])
    for sensor, seed in itertools.product(sensors, seeds):
        right = clean(sensor, seed, kind.images, kind.gcps, kind.relief_m, kind.checks, kind.place)
        harm = run_for_harm(kind.spoil(right, make_generator(seed, kind.name)))
        row.runs.append((sensor, seed, harm))
        if tell and (harm.verdict in ("ok", "crashed") or harm.is_harmful):
            print("   ", sensor, seed, harm.verdict, f"{harm.times:.1f}", *harm.codes, harm.told[-300:], flush=True)
    return row


HEAD = ["wrong input", "runs", "no result", "doubtful", "ok", "biased", "undetected bias", "error / predicted",
        "reasons", "why it is not detectable"]  # fmt: skip
INTRODUCTION = """# Wrong inputs: effect on the result

Made by `python benchmarks/wrong_inputs.py --true-errors --docs {words}`.

{count} more kinds of wrong input are each run on blocks of {sensors}. The seeds were not used for tuning, and `adjust`
reads the inputs as files. GDAL evaluates the refined RPCs: points are intersected from the pixels in which the
simulated cameras, which are not RPCs, observe them. The results are compared with the true positions. *No result*: the
inputs were refused, or no refined RPC was written. *Biased*: CE90 or LE90 of these errors is more than twice the
prediction of the report. *Undetected bias*: the result is biased and the verdict is *ok*. *Error / predicted*: the
largest ratio of all runs.
"""


def print_harm(sensors: Sequence[str], seeds: Sequence[int], names: Sequence[str] | None, tell: bool) -> list[HarmRow]:
    """Run kinds whose name begins with one of ``names`` (all without), and print their rows."""
    rows = []
    for kind in TRUE_KINDS:
        if names is None or any(kind.name.startswith(name) for name in names):
            rows.append(run_kind(kind, sensors, seeds, tell))
            print(" | ".join(rows[-1].cells()), flush=True)
    told = [row for row in rows if not row.kind.untold]
    print(
        f"{len(rows)} kinds: {sum(bool(row.silent_and_harmful) for row in told)} silent and harmful though the block "
        f"could tell, {len(rows) - len(told)} that nothing can tell"
    )
    return rows


def write_page(rows: Sequence[HarmRow], sensors: Sequence[str], words: str) -> None:
    """Write the page; of some kinds their rows alone, in the place of earlier ones, and by what they were made."""
    cells = {row.kind.name: row.cells() for row in rows}
    head = INTRODUCTION.format(words=words, count=len(TRUE_KINDS), sensors=", ".join(sensors))
    if len(rows) < len(TRUE_KINDS):
        text = PAGE.read_text(encoding="utf-8")
        head, _, table = text.partition("\n| ")
        before = [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in table.splitlines()[2:]]
        untold = {kind.name: kind.untold for kind in TRUE_KINDS}  # reasons as they are now
        earlier = {
            line[0]: [*line[:9], *[""] * (9 - len(line)), untold[line[0]]] for line in before if line[0] in untold
        }
        cells = earlier | cells
        head += f"\nMade by `{words}`: {'; '.join(row.kind.name for row in rows)}.\n"
    ordered = [cells[kind.name] for kind in TRUE_KINDS if kind.name in cells]
    PAGE.write_text(f"{head}\n{render(HEAD, ordered)}\n", encoding="utf-8")
