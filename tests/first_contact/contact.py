"""The first contact with a folder: init, the dry run and the run, as the README prints them; what a newcomer gets."""

import contextlib
import io
import json
import re
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from folders import Source

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
    misregistration_px: float = 0.0
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
        if self.verdict == "ok" and self.misregistration_px > 1.0:
            found.append(f"orthoimages {self.misregistration_px:.1f} px apart, and the verdict is ok")
        return found

    def line(self) -> str:
        """Return folder, whether it was asked, exit codes, verdict, steps, true error (px), CPU seconds and faults."""
        steps = "".join(
            {"done": "+", "failed": "!", "left out": "-"}.get(one, "?") for one in (self.steps or {}).values()
        )
        asked = int(bool(self.question))
        return (f"{self.name:34} {asked:2} {' '.join(map(str, self.codes)):8} {self.verdict:9} {steps:5} "
                f"{self.error_px:8.2f} {self.seconds:6.1f}  {'; '.join(self.faults)}")  # fmt: skip


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
        if met.steps.get("ortho-check") == "done":
            check = json.loads((folder / "result" / "check" / "report.json").read_text())
            met.misregistration_px = check["all"]["after"]["median_px"]
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
