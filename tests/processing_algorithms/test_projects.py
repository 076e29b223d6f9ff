"""A new user's path, by the real command line: a folder of images, points as text and a DEM with gaps, to the report.

The images, points and terrain are simulated, so that the truth is known.
"""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from browser import chromium_program
from osgeo import gdal

import hrsi
from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.projects.project_file import FOLDERS, read_project

PROJECT = """\
title = "Valley <1>"
images = "images"
gcps = "points.txt|columns=id,lat,lon,height"
image_points = "measured.txt"
dem = "dem.tif"
[orthorectify]
fill_gaps = 8
[evaluate]
tracks = "none"
"""
ROOT = Path(__file__).resolve().parents[2]
GCPS = "points.txt|columns=id,lat,lon,height"
HOLES, HOLE = 40, (3, 4)  #: gaps of the DEM, each of so many rows and columns


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a client sends it: no header lines, latitude before longitude, a DEM with gaps."""
    folder = tmp_path_factory.mktemp("client")
    words = "--images 3 --along=-12,0,12 --size 320 --gcps 6 --checks 12 --ties 0 --relief 60 --quiet"
    assert main(["simulate", *words.split(), "--output-dir", str(folder / "block")]) == 0
    block, survey = folder / "block", folder / "survey"
    (survey / "images").mkdir(parents=True)
    for image in block.glob("image_*.tif"):
        shutil.copy(image, survey / "images")
    rows = [list(csv.DictReader((block / f"{name}.csv").open())) for name in ("ground_points", "image_points")]
    (survey / "points.txt").write_text(
        "".join(f"{r['id']} {float(r['lat']):.9f} {float(r['lon']):.9f} {float(r['height']):.3f}\n" for r in rows[0])
    )
    (survey / "measured.txt").write_text(
        "".join(f"{r['id']} {r['image']} {r['sample']} {r['line']}\n" for r in rows[1])
    )
    gdal.Translate(str(survey / "dem.tif"), str(block / "dem.tif"), noData=-9999)
    dem = gdal.Open(str(survey / "dem.tif"), gdal.GA_Update)
    heights = dem.ReadAsArray()
    generator = np.random.default_rng(3)
    for row, column in generator.integers(5, np.array(heights.shape) - 9, (HOLES, 2)):
        heights[row : row + HOLE[0], column : column + HOLE[1]] = -9999
    dem.GetRasterBand(1).WriteArray(heights)
    return survey


def hrsi_command(folder: Path, *words: str) -> tuple[list[str], str]:
    """Run the command itself in a folder; return the lines of stdout, and stderr."""
    command = [sys.executable, "-m", "hrsi", *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=600)
    assert done.returncode == 0, (words, done.stderr)
    return done.stdout.splitlines(), done.stderr


@pytest.mark.programs
def test_twelve_steps_from_a_folder_to_the_document(survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    work = survey.parent
    shutil.rmtree(survey / "result", ignore_errors=True)
    # 1 and 2: what is there? 3: the project file
    assert re.search(r"^  init ", "\n".join(hrsi_command(work, "--help")[0]), re.MULTILINE)
    assert "PROJECT" in "\n".join(hrsi_command(work, "run", "--help")[0])
    made, told = hrsi_command(work, "init", "survey", "--overwrite")
    assert made == [os.path.join("survey", "project.toml")]
    # 4: how the folder was understood
    roles = dict(re.findall(r"^(\S+) +(DEM|GCPs|image measurements|image): ", told, re.MULTILINE))
    assert (roles["points.txt"], roles["measured.txt"], roles["dem.tif"]) == ("GCPs", "image measurements", "DEM")
    assert "18 of 18 ground points are measured in images" in told and "columns id, lat, lon, height" in told
    assert "gaps up to" in told and "heights ellipsoidal: heights of dem.tif are" in told
    # 5: the title, and no tie points for the comparison, which takes minutes; 6: a look before the run
    file = survey / "project.toml"
    assert tomllib.loads(file.read_text())["orthorectify"]["fill_gaps"] >= max(HOLE)
    file.write_text(
        file.read_text().replace('title = "survey"', 'title = "Valley <1>"').replace("# tracks =", "tracks =")
    )
    assert "nothing wrong was found" in "\n".join(hrsi_command(work, "run", "survey/project.toml", "--dry-run")[0])
    assert not (survey / "result").exists()
    # 7: the run; 8: its outputs
    made, told = hrsi_command(work, "run", "survey/project.toml")
    assert all(os.path.isfile(work / path) for path in made)
    for name in ("triangulated/image_1.tif", "orthoimages/image_2_ortho.tif", "check/report.html", "report.html"):
        assert os.path.join("survey", "result", name) in made
    for line in filter(None, map(str.strip, told.splitlines())):
        assert re.fullmatch(r"[.0-9]+( - done\.)?", line) or told.count(f"\n{line}\n") <= 1, line
    report = json.loads((survey / "result" / "report.json").read_text())
    statuses = {step: entry["status"] for step, entry in report["steps"].items()}
    assert statuses == dict.fromkeys(FOLDERS, "done") | {"surface-model": "left out"}  # takes minutes: on request
    assert report["verdict"]["level"] == "ok"
    # 9: again, and nothing is done; 10: another resolution, and only what depends on it is
    _, told = hrsi_command(work, "run", "survey/project.toml")
    assert told.count("nothing has changed, kept") == 4
    file.write_text(file.read_text().replace("# resolution = 0.5 ", "resolution = 1.0 "))
    os.remove(survey / "result" / "evaluation" / "report.html")
    _, told = hrsi_command(work, "run", "survey/project.toml")
    kept = re.findall(r"^(\S+): nothing has changed", told, re.MULTILINE)
    assert kept == ["triangulate"]
    # 11: the report, a chapter for each step; 12: as PDF, where there is a browser
    page = (survey / "result" / "report.html").read_text()
    assert "Valley &lt;1&gt;" in page and page.count('<section class="chapter"') == 4
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert {target for target in re.findall(r'href="#([^"]+)"', page)} <= set(ids)
    chromium = chromium_program()
    if chromium is not None:
        pdf = tmp_path / "report.pdf"
        source = (survey / "result" / "report.html").as_uri()
        words = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}", f"--print-to-pdf={pdf}"]
        subprocess.run([chromium, *words, source], check=True, capture_output=True, timeout=300)
        assert pdf.read_bytes().startswith(b"%PDF") and pdf.read_bytes().count(b"/Type /Page\n") >= 2


def test_one_image_is_refined_by_itself(survey: Path, tmp_path: Path):
    folder = tmp_path / "one"
    shutil.copytree(survey, folder, ignore=shutil.ignore_patterns("result", "image_2*", "image_3*", "*.toml"))
    measured = (folder / "measured.txt").read_text().splitlines(keepends=True)
    (folder / "measured.txt").write_text("".join(line for line in measured if " image_1 " in line))
    assert main(["init", str(folder)]) == 0
    result = hrsi.run(folder / "project.toml", report=False)
    assert result.report["steps"]["triangulate"]["algorithm"] == "refine-rpc"
    assert result.report["steps"]["ortho-check"]["told"] == "fewer than two orthoimages"
    assert (folder / "result" / "orthoimages" / "image_1_ortho.tif").exists()


@pytest.fixture(scope="module")
def single(survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of one image with GCPs and DEM, after `hrsi.run(hrsi.init(folder))`."""
    folder = tmp_path_factory.mktemp("single") / "block"
    shutil.copytree(survey, folder, ignore=shutil.ignore_patterns("result", "image_2*", "image_3*", "*.toml", "*.vrt"))
    result = hrsi.run(hrsi.init(folder), report=False)
    assert {step: entry["status"] for step, entry in result.report["steps"].items()} == {
        "triangulate": "done", "surface-model": "left out", "orthorectify": "done", "ortho-check": "left out",
        "evaluate": "done",
    }  # fmt: skip
    return folder


def test_a_copied_project_repeats_nothing(single: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder = shutil.copytree(single, tmp_path / "elsewhere" / "block copied")
    assert main(["run", str(folder), "--no-report"]) == 0
    assert capsys.readouterr().err.count("nothing has changed, kept") == 3

    def list_kept() -> list[str]:
        assert main(["run", str(folder), "--no-report"]) == 0
        return re.findall(r"^(\S+): nothing has changed", capsys.readouterr().err, re.MULTILINE)

    project = folder / "project.toml"
    project.write_text(project.read_text().replace("[orthorectify]", "[orthorectify]\nresolution = 20.0"))
    assert list_kept() == ["triangulate", "evaluate"]
    dem = gdal.Open(str(folder / "dem.tif"), gdal.GA_Update)
    dem.GetRasterBand(1).WriteArray(dem.ReadAsArray() + 1.0)
    del dem
    assert list_kept() == [], "every step may read the DEM: GCPs without heights take its"


def test_a_step_that_fails_is_a_failure_and_hides_no_other(single: Path, tmp_path: Path):
    folder = shutil.copytree(single, tmp_path / "block", ignore=shutil.ignore_patterns("result"))
    assert main(["run", str(folder), "--steps", "orthorectify"]) == 2  # there are no refined RPCs
    report = json.loads((folder / "result" / "report.json").read_text())
    assert report["verdict"]["level"] == "unusable" and "no refined RPCs" in report["verdict"]["sentence"]
    project = folder / "project.toml"
    project.write_text(project.read_text().replace('tracks = "none"', 'tracks = "nowhere.csv"'))
    assert main(["run", str(folder), "--dry-run"]) == 2
    assert main(["run", str(folder)]) == 2
    report = json.loads((folder / "result" / "report.json").read_text())
    statuses = {step: entry["status"] for step, entry in report["steps"].items()}
    assert (statuses["triangulate"], statuses["orthorectify"], statuses["evaluate"]) == ("done", "done", "failed")
    assert "nowhere.csv" in report["verdict"]["sentence"] and report["verdict"]["level"] != "ok"
    assert (folder / "result" / "report.html").exists()


def test_own_orthoimages_are_no_control_and_ids_are_unique(survey: Path, single: Path, tmp_path: Path, capsys):
    folder = tmp_path / "block"
    folder.mkdir()
    for path in [*survey.glob("images/*"), survey / "dem.tif", single / "result/orthoimages/image_1_ortho.tif"]:
        shutil.copy(path, folder)
    assert main(["init", str(folder), "--height-datum", "ellipsoidal"]) == 0
    assert "image_1_ortho.tif  orthoimage of HRSI: not used" in capsys.readouterr().err
    (folder / "again").mkdir()
    shutil.copy(folder / "image_1.tif", folder / "again" / "image_1.tif")
    assert main(["init", str(folder), "--overwrite"]) == 2
    assert "have the same id 'image_1': rename one" in capsys.readouterr().err


def test_a_run_that_is_stopped_in_its_first_step_continues(single: Path, tmp_path: Path, monkeypatch, capsys):
    folder = shutil.copytree(single, tmp_path / "block", ignore=shutil.ignore_patterns("result"))

    def stop(*_args: object, **_named: object) -> None:
        (folder / "result" / "triangulated" / "unfinished_tie_points").mkdir(parents=True)
        raise Cancelled

    with monkeypatch.context() as patched:
        patched.setattr("hrsi.processing_algorithms.run_project._do_step", stop)
        assert main(["run", str(folder)]) == 130
    assert main(["run", str(folder), "--no-report", "--steps", "triangulate"]) == 0
    assert main(["run", str(tmp_path)]) == 2
    assert f"has no project.toml: make it with `hrsi init {tmp_path}`" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "fragments"),
    [
        ("images = ['a']\ndem_datum = 'ask'", ["ellipsoid or to the geoid", "dem_datum"]),
        ("images = [", ["cannot be read as a project file", "correct it"]),
        ("title = 'a'", ["names no images"]),
        ("imges = ['a']", ["'imges'", "did you mean images"]),
        ("images = ['a']\n[triangulate]\nmodle = 'affine'", ["[triangulate]", "did you mean model"]),
        ("images = ['a']\ntriangulate = 3", ["write [triangulate]"]),
    ],
)
def test_what_a_project_file_may_not_hold(tmp_path: Path, text: str, fragments: list[str]):
    path = tmp_path / "project.toml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_project(str(path))
    assert all(fragment in str(error.value) for fragment in fragments)


def test_paths_count_from_the_project_file_and_the_schema_has_every_key(tmp_path: Path):
    (tmp_path / "geoid.tif").write_bytes(b"")
    path = tmp_path / "project.toml"
    path.write_text('images = ["a", "/b/c.tif"]\ngcps = "p.txt|columns=id,x,y"\nheight_datum = "egm96"\n'
                    'dem_datum = "geoid.tif"\n[evaluate]\nskip = true\n')  # fmt: skip
    project = read_project(str(path))
    assert project.shared["images"] == [str(tmp_path / "a"), "/b/c.tif"]
    assert project.shared["gcps"] == f"{tmp_path / 'p.txt'}|columns=id,x,y"
    assert (project.shared["height_datum"], project.shared["dem_datum"]) == ("egm96", str(tmp_path / "geoid.tif"))
    assert "evaluate" not in project.steps
    known = json.loads((ROOT / "docs" / "project.schema.json").read_text())["properties"]
    assert {"images", "gcps", "dem", "title"} <= known.keys() and set(FOLDERS) <= known.keys()
    for step in FOLDERS:
        declared = {param.key for param in REGISTRY[step].params}
        assert declared == known[step]["properties"].keys() - {"skip"}, "run scripts/make_schema.py"
    assert known["orthorectify"]["properties"]["fill_gaps"]["type"] == "integer"


@pytest.mark.thorough
def test_results_stand_for_their_files(survey: Path, tmp_path: Path):
    """A result goes where its images, its folder of RPCs or its layers go."""
    assert hrsi.__version__
    folder = tmp_path / "project"
    path = survey / "project.toml"
    path.write_text(PROJECT)
    hrsi.run(path, steps=["triangulate"], output_dir=folder, report=False)
    result = hrsi.read_result(folder / "triangulated")
    made = hrsi.orthorectify(result, terrain_points=result, output_dir=tmp_path / "ortho", report=False)
    assert set(made.report["images"]) == {"image_1", "image_2", "image_3"}
    images = sorted((survey / "images").glob("*.tif"))
    found = hrsi.evaluate(images, rpcs={"r": result}, tracks="none", gcps=str(survey / GCPS),
                          image_points=survey / "measured.txt")  # fmt: skip
    assert found.report["sets"]["r"]["check"]["points"] or found.report["sets"]["r"]["control"]["points"]
