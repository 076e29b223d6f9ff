"""The first contact with a folder: init, the dry run and the run, as the README prints them; what a newcomer gets.

``python tests/first_contact/contact.py [--plan] [NAME...]`` prints the table of all folders, simulated and real;
with ``--plan`` without the runs.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shutil
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))

from client_folders import CLIENT_FOLDERS
from folders import FOLDERS, Source, simulate

from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files.find import read_rpc_or_none
from hrsi.processing_algorithms.command_line.cli import main

REAL = ("s2p_triplet_phr", "qb2_gcp", "zy3_stereo_gcp", "kahramanmaras_phr4", "ventoux_phr_pair",
        "skysat_miami_university", "spot7_tiepoints")  # fmt: skip


@dataclass
class Contact:
    """What happened: exit codes of init, dry run and run, the question, verdict, statuses of steps, and output."""

    name: str
    codes: list[int]
    question: str = ""
    verdict: str = ""
    steps: dict[str, str] | None = None
    roles: dict[str, str] | None = None
    error_px: float = np.nan
    seconds: float = 0.0
    text: str = ""

    @property
    def faults(self) -> list[str]:
        """What must never happen."""
        found = ["traceback"] if "Traceback" in self.text or "unexpected" in self.text else []
        if self.codes[0] == 0 and not self.question and 2 in self.codes[1:]:
            found.append("exit code 2 after a clean init")
        failed = [step for step, status in (self.steps or {}).items() if status == "failed"]
        if failed and (self.verdict == "ok" or self.codes[-1] == 0):
            found.append(f"{failed[0]} failed, and that is no failure")
        return found

    def line(self) -> str:
        """Return a row of the table."""
        steps = "".join(
            {"done": "+", "failed": "!", "left out": "-"}.get(one, "?") for one in (self.steps or {}).values()
        )
        asked = int(bool(self.question))
        return (f"{self.name:34} {asked:2} {' '.join(map(str, self.codes)):8} {self.verdict:9} {steps:5} "
                f"{self.error_px:8.2f} {self.seconds:6.1f}  {'; '.join(self.faults)}")  # fmt: skip


HEAD = f"{'folder':34} ask {'codes':7} {'verdict':9} {'steps':5} {'true px':>8} {'CPU s':>6}  faults"


def meet(name: str, folder: Path, answer: str = "ellipsoidal", run: bool = True) -> Contact:
    """Run init, the dry run and the run on a folder; a question is answered."""
    begun = time.process_time()
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        met = Contact(name, [main(["init", str(folder)])])
        project = folder / "project.toml"
        if "question:" in out.getvalue():
            met.question = out.getvalue().partition("question: ")[2].splitlines()[0]
            assert main(["run", str(project), "--dry-run"]) == 2
            met.codes[0] = main(["init", str(folder), "--height-datum", answer, "--overwrite"])
        if project.exists() and met.codes[0] == 0:
            met.codes.append(main(["run", str(project), "--dry-run"]))
            if run:
                met.codes.append(main(["run", str(project), "--no-report"]))
    met.text, met.seconds = out.getvalue(), time.process_time() - begun
    if project.exists():
        tomllib.loads(project.read_text())
        lines = [line[2:] for line in project.read_text().splitlines() if line.startswith("# ") and "  " in line]
        met.roles = {text.partition("  ")[0]: text.partition("  ")[2].strip() for text in lines}
    report = folder / "result" / "report.json"
    if report.exists():
        told = json.loads(report.read_text())
        met.verdict = told["verdict"]["level"]
        met.steps = {step: entry["status"] for step, entry in told["steps"].items()}
    return met


def true_error_px(source: Source, folder: Path) -> float:
    """Return the RMSE (px) of the true points in the images with refined RPCs, against their true positions."""
    truth = source.folder / "truth.gpkg"
    refined = folder / "result" / "triangulated"
    ground = read_points(f"{truth}|layername=true_ground_points").ground
    images = [
        path for path in refined.glob("*") if path.suffix.lower() in (".tif", ".txt") and read_rpc_or_none(str(path))
    ]
    if ground is None or not images:
        return float("nan")
    place = {str(name): xyz for name, xyz in zip(ground.ids, ground.ground, strict=True)}
    measured = read_points(f"{truth}|layername=true_image_points").image
    squares = []
    for path in images:
        image = open_image(str(path))
        name = re.sub(r"^(?:.*-P1BS-.*00|DIM_.*00|Aufnahme .* )(\d)$", r"image_\1", image.id)  # of a product
        rows = [row for row in range(len(measured)) if str(measured.image_ids[row]) == name
                and str(measured.ids[row]) in place]  # fmt: skip
        if not rows:  # multispectral: the truth is in panchromatic pixels
            continue
        found = image.rpc.project(np.array([place[str(measured.ids[row])] for row in rows]))
        squares.append(np.sum((found - measured.xy[rows]) ** 2, axis=1))
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def print_table(names: list[str], data: Path | None, run: bool = True) -> int:
    """Meet all folders, print the table, and return the number of faults."""
    print(HEAD, flush=True)
    faults = 0
    with tempfile.TemporaryDirectory(prefix="first-contact-") as place:
        source = simulate(Path(place) / "source")
        for layout in (*FOLDERS, *CLIENT_FOLDERS):
            if not names or layout.__name__ in names:
                folder = Path(place) / layout.__name__
                layout(source, folder)
                met = meet(layout.__name__, folder, run=run)
                met.error_px = true_error_px(source, folder)
                print(met.line(), flush=True)
                if met.faults or names:
                    print(met.text)
                faults += len(met.faults)
        for name in REAL if data is not None else ():
            if not names or name in names:
                folder = Path(place) / name
                shutil.copytree(data / name, folder)
                met = meet(name, folder, run=run)
                print(met.line(), flush=True)
                if met.faults or names:
                    print(met.text)
                faults += len(met.faults)
    return faults


if __name__ == "__main__":
    root = os.environ.get("HRSI_TEST_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data"
    shared = Path(root) / "real" if (Path(root) / "real").is_dir() else None
    words = [word for word in sys.argv[1:] if word != "--plan"]
    sys.exit(min(print_table(words, shared, "--plan" not in sys.argv), 1))
