"""One block through each face: every warning, reason and figure is the same.

The faces are the commands `triangulate` and `adjust`, the step of a project, Python and the points panel; for one
image the command `refine-rpc`, the step of a project and Python. The block is simulated, without pixels.
"""

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from osgeo import gdal

import hrsi
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.interface.declare import is_unusable
from hrsi.processing_algorithms.point_session import files
from hrsi.processing_algorithms.point_session.adjusting import adjust_block, block_of

#: Entries of a report that describe the run, not the block.
OF_THE_RUN = {"algorithm", "command", "crs", "date", "document", "inputs", "options", "outputs", "seconds", "settings"}
MOVED_M, DEM_OFFSET_M = 12.0, 40.0  # a GCP in plan; the DEM


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three images of 4000 px, seven GCPs of which G003 is wrong, a DEM, and the same DEM 40 m too high."""
    folder = tmp_path_factory.mktemp("one_run")
    words = "--images 3 --size 4000 --no-pixels --gcps 7 --checks 10 --ties 150 --seed 4 --quiet"
    assert main(["simulate", *words.split(), "--output-dir", str(folder)]) == 0
    rows = list(csv.DictReader((folder / "ground_points.csv").open()))
    gcps = [row for row in rows if row["role"] == "gcp"]
    gcps[3]["lat"] = str(float(gcps[3]["lat"]) + MOVED_M / 111_000.0)
    with (folder / "wrong_gcp.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    gdal.Translate(str(folder / "high_dem.tif"), str(folder / "dem.tif"))
    dem = gdal.Open(str(folder / "high_dem.tif"), gdal.GA_Update)
    dem.GetRasterBand(1).WriteArray(dem.ReadAsArray() + DEM_OFFSET_M)
    return folder


def images(block: Path, count: int = 3) -> list[str]:
    return [str(block / f"image_{number}_RPC.TXT") for number in range(1, count + 1)]


#: The inputs of each block: with a wrong GCP; without GCPs on a DEM that is too high; one image.
INPUTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "wrong GCP": lambda block: {"images": images(block), "gcps": str(block / "wrong_gcp.csv")},
    "high DEM": lambda block: {"images": images(block), "dem": str(block / "high_dem.tif"), "model": "shift"},
    "one image": lambda block: {"images": images(block, 1), "gcps": str(block / "ground_points.csv")},
}


def by_command(algorithm: str) -> Callable[[dict[str, Any], Path], dict[str, Any]]:
    def face(given: dict[str, Any], folder: Path) -> dict[str, Any]:
        words = [
            word for key, value in given.items() if key != "images" for word in (f"--{key.replace('_', '-')}", value)
        ]
        code = main([algorithm, *given["images"], *words, "--quiet", "--output-dir", str(folder)])
        report = json.loads((folder / "report.json").read_text())
        assert code == (3 if is_unusable(report) else 0)
        return report

    return face


def by_python(algorithm: str) -> Callable[[dict[str, Any], Path], dict[str, Any]]:
    def face(given: dict[str, Any], folder: Path) -> dict[str, Any]:
        return getattr(hrsi, algorithm)(**given, output_dir=folder, report=False).report

    return face


def by_project(given: dict[str, Any], folder: Path) -> dict[str, Any]:
    own = {"tie_points", "hold_out", "model", "residual_crs"} & given.keys()
    shared = "\n".join(f"{key} = {json.dumps(value)}" for key, value in given.items() if key not in own)
    table = "\n".join(f"{key} = {given[key]!r}" for key in own)
    folder.mkdir()
    project = folder / "project.toml"
    project.write_text(f"{shared}\n[triangulate]\n{table}\n", encoding="utf-8")
    run("run", project=str(project), output_dir=str(folder / "result"), steps="triangulate")
    return json.loads((folder / "result" / "triangulated" / "report.json").read_text())


TRIANGULATE = {"tie_points": "none"}
#: Faces of a block: what they need beside the inputs, and how they run.
FACES = {
    "triangulate": (TRIANGULATE, by_command("triangulate")),
    "adjust": ({}, by_command("adjust")),
    "Python triangulate": (TRIANGULATE, by_python("triangulate")),
    "Python adjust": ({}, by_python("adjust")),
    "project": (TRIANGULATE, by_project),
}
FACES_OF_ONE = {
    "refine-rpc": ({}, by_command("refine-rpc")),
    "Python refine": ({}, by_python("refine")),
    "project": ({}, by_project),
}


def require_equal(found: Any, expected: Any, place: str) -> None:
    """Compare two reports; numbers to a part in 1e9, for sums are formed in another order with other threads."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys(), place
        for key in expected.keys() - {"output"}:  # path of an image's new RPC
            require_equal(found[key], expected[key], f"{place}/{key}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), place
        for number, (one, other) in enumerate(zip(found, expected, strict=True)):
            require_equal(one, other, f"{place}/{number}")
    elif isinstance(expected, float):
        assert math.isclose(found, expected, rel_tol=1e-9, abs_tol=1e-9), (place, found, expected)
    else:
        assert found == expected, (place, found, expected)


@pytest.mark.parametrize(
    ("name", "faces", "code", "warning"),
    [
        ("wrong GCP", FACES, "control-outliers", "GCP"),
        ("high DEM", FACES, "", "below the DEM"),
        ("one image", FACES_OF_ONE, "", ""),
    ],
)
def test_faces_agree(block: Path, tmp_path: Path, name: str, faces: Any, code: str, warning: str) -> None:
    given = INPUTS[name](block) | {"image_points": str(block / "image_points.csv"), "height_datum": "ellipsoidal"}
    given |= {"hold_out": "0"} if len(given["images"]) > 1 else {}
    reports = {face: make({**given, **extra}, tmp_path / str(number))
               for number, (face, (extra, make)) in enumerate(faces.items())}  # fmt: skip
    first = next(iter(reports.values()))
    assert not code or code in [reason["code"] for reason in first["verdict"]["reasons"]]
    assert any(warning in text for text in [*first["warnings"], *(r["message"] for r in first["verdict"]["reasons"])])
    for face, report in reports.items():
        for part in (first, report):
            for key in OF_THE_RUN & part.keys():
                del part[key]
        require_equal(report, first, f"{face}: ")


def test_panel_agrees(block: Path, tmp_path: Path) -> None:
    """The panel shows the verdict, the warnings and the figures of the check points of `adjust`."""
    given = INPUTS["wrong GCP"](block) | {"image_points": str(block / "image_points.csv")}
    report = run("adjust", **given, height_datum="ellipsoidal", hold_out=0.0, model="shift", output_dir=str(tmp_path))
    session = files.new_session(**given, height_datum="ellipsoidal")
    view = adjust_block(block_of(session), "shift")
    require_equal(json.loads(json.dumps(view.verdict.entry())), report["verdict"], "verdict")
    assert list(view.warnings) == report["warnings"]
    require_equal(json.loads(json.dumps(view.check)), report["check"], "check")
    corrections = {name: [entry["value"] for entry in image["parameters"].values()]
                   for name, image in report["images"].items()}  # fmt: skip
    for image, values in view.corrections.items():
        np.testing.assert_allclose(values, corrections[image], rtol=1e-9, atol=1e-9)
