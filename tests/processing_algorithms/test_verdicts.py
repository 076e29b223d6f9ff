"""The verdict as a user meets it: exit codes, what is written and what is not, the last line, the page."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from long_tests import mark_beyond
from rpc_samples import write_image
from simulated_blocks import VIEWS, oblique_rpc

from hrsi.hrsi_engine.foundation.errors import InputError, SolveError
from hrsi.hrsi_engine.ground.geodesy import move_ground
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.hrsi_engine.results import judged_block
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main

SIZE, GSD_M = 301, 10.0
WRITTEN = {"copy": ".tif", "vrt": ".vrt", "sidecar": "_RPC.TXT"}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three images with pixels, 8 GCPs and 6 check points; measurements right, and with samples and lines swapped."""
    folder = tmp_path_factory.mktemp("scene")
    rng = np.random.default_rng(3)
    cameras = {f"image{k}": oblique_rpc(*VIEWS[k], GSD_M, (SIZE - 1) / 2.0, heading=0.1 * k) for k in range(3)}
    first = cameras["image0"]
    metres = np.column_stack([rng.uniform(-900, 900, (14, 2)), rng.uniform(-80, 150, 14)])
    ground = move_ground(np.tile([first.long_off, first.lat_off, first.height_off], (14, 1)), metres)
    ids = [f"{'G' if k < 8 else 'C'}{k:02d}" for k in range(14)]
    with open(folder / "ground.csv", "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["id", "lon", "lat", "height", "role"])
        rows.writerows(
            [name, *position, "gcp" if name[0] == "G" else "check"]
            for name, position in zip(ids, ground.tolist(), strict=True)
        )
    measured = []
    for name, rpc in cameras.items():
        write_image(folder / f"{name}.tif", rpc, size=(SIZE, SIZE))
        xy = rpc.project(ground) + rng.normal(0.0, 2.0, 2) + rng.normal(0.0, 0.2, (14, 2))
        measured += [(point, name, *position) for point, position in zip(ids, xy.tolist(), strict=True)]
    for file_name, turned in (("image_points.csv", False), ("swapped.csv", True)):
        with open(folder / file_name, "w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["id", "image", "sample", "line"])
            rows.writerows((point, name, *((y, x) if turned else (x, y))) for point, name, x, y in measured)
    return folder


def options(scene: Path, output: Path, points: str = "image_points.csv") -> dict[str, object]:
    """Return what `adjust` and `refine-rpc` take of the scene."""
    return {
        "images": [str(scene / f"image{k}.tif") for k in range(3)], "gcps": str(scene / "ground.csv"),
        "image_points": str(scene / points), "height_datum": "ellipsoidal", "output_dir": str(output),
    }  # fmt: skip


def words(scene: Path, output: Path, points: str = "image_points.csv") -> list[str]:
    """Return the same for the command line."""
    given = options(scene, output, points)
    named = [f"--{key.replace('_', '-')}={value}" for key, value in given.items() if key != "images"]
    return [*given["images"], *named]


def test_sound_block_is_ok(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["adjust", *words(scene, tmp_path / "out")]) == 0
    last = capsys.readouterr().err.splitlines()[-1]
    verdict = json.loads((tmp_path / "out" / "report.json").read_text())["verdict"]
    assert verdict["level"] == "ok" and verdict["reasons"] == []
    assert last == f"{verdict['sentence']}. Verdict: ok"
    assert last.startswith("3 images; 8 GCPs, 6 check points: CE90 ")


def test_verdict_is_first_in_the_report(scene: Path, tmp_path: Path):
    report = run("adjust", **options(scene, tmp_path / "out"))
    keys = list(report)
    assert keys[:2] == ["schema", "algorithm"]
    assert keys.index("verdict") < keys.index("model")  # after how the run came about, before all that it found
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.index('class="verdict ok"') < page.index("<dt>CE90")


@pytest.mark.parametrize("how", mark_beyond(1, "wrong_inputs", [*WRITTEN, "in-place"]))
@pytest.mark.parametrize("algorithm", mark_beyond(1, "wrong_inputs", ["adjust", "triangulate", "refine-rpc"]))
def test_unusable_result_writes_no_rpc(algorithm, how, scene, tmp_path, capsys):
    for file in scene.iterdir():
        shutil.copyfile(file, tmp_path / file.name)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    given = [*words(tmp_path, tmp_path / "out", "swapped.csv"), "--write", how]
    if algorithm == "triangulate":
        given += ["--tie-points", "none"]
    if algorithm == "refine-rpc":
        given += ["--model", "shift"]
    assert main([algorithm, *given]) == 3
    told = capsys.readouterr().err.splitlines()
    assert told[-1].endswith("Verdict: unusable")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["verdict"]["level"] == "unusable"
    assert all(image["output"] is None for image in report["images"].values())
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [
        "block.gpkg",
        "block.json",
        *(["block_cameras.npz"] if algorithm != "refine-rpc" else []),
        "report.html",
        "report.json",
    ]
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()} == before


@pytest.mark.parametrize("how", mark_beyond(1, "wrong_inputs", [*WRITTEN, "in-place"]))
def test_force_write_writes_all_the_same(how, scene, tmp_path, capsys):
    for file in scene.iterdir():
        shutil.copyfile(file, tmp_path / file.name)
    given = [*words(tmp_path, tmp_path / "out", "swapped.csv"), "--write", how, "--force-write", "--quiet"]
    assert main(["adjust", *given]) == 3
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("ERROR: the result is unusable: ") and err.count("\n") == 1
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    for image in report["images"].values():
        assert read_rpc(image["output"]).rpc != read_rpc(str(scene / Path(image["path"]).name)).rpc


def test_unusable_result_leaves_no_rpc_of_an_earlier_run(scene: Path, tmp_path: Path):
    folder = tmp_path / "out"
    run("adjust", **options(scene, folder), write="sidecar")
    assert (folder / "image0_RPC.TXT").exists()
    (folder / "notes.txt").write_text("mine")
    report = run("adjust", **options(scene, folder, "swapped.csv"), write="sidecar", overwrite=True)
    assert report["verdict"]["level"] == "unusable"
    assert sorted(file.name for file in folder.iterdir()) == [
        "block.gpkg",
        "block.json",
        "block_cameras.npz",
        "notes.txt",
        "report.html",
        "report.json",
    ]


def test_reasons_say_what_to_do_on_terminal_and_page(scene: Path, tmp_path: Path, capsys):
    assert main(["adjust", *words(scene, tmp_path / "out", "swapped.csv")]) == 3
    out = capsys.readouterr().err
    page = (tmp_path / "out" / "report.html").read_text()
    reasons = json.loads((tmp_path / "out" / "report.json").read_text())["verdict"]["reasons"]
    assert reasons[0]["level"] == "unusable"
    assert [reason["level"] for reason in reasons] == sorted((reason["level"] for reason in reasons), reverse=True)
    for reason in reasons:
        assert reason["message"] in out and reason["advice"] in out and f"[{reason['code']}]" in out
        assert reason["code"] in page


@pytest.mark.parametrize("name", ["adjust", "refine-rpc"])
def test_a_camera_that_wrong_inputs_spoilt_is_told_by_what_is_wrong_with_them(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
):
    """Refined cameras may end where there is no ground: then the slip is named, not what became of it."""

    def fail(*_given: object) -> None:
        raise SolveError("the RPC has no ground positions")

    monkeypatch.setattr(judged_block, "state_accuracy", fail)
    with pytest.raises(InputError, match=r"sample and line are exchanged.*image-axes.*no ground positions"):
        run(name, **options(scene, tmp_path / "out", "swapped.csv"))
    with pytest.raises(SolveError, match=r"^the RPC has no ground positions$"):
        run(name, **options(scene, tmp_path / "out"))
    assert not (tmp_path / "out").exists()
