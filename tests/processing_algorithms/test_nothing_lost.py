"""No run takes away what another made, what a vendor delivered, or what it reads itself."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.jitter_files import JitterFile
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main


@pytest.fixture(scope="module")
def delivered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three small images with the RPC in their tag and a vendor's ``_RPC.TXT`` beside, and their points."""
    folder = tmp_path_factory.mktemp("delivered")
    run("simulate", sensor="pleiades", images=3, along="-12,0,12", size=300, gcps=6, checks=4, ties=40, seed=11,
        output_dir=str(folder))  # fmt: skip
    bare = tmp_path_factory.mktemp("bare")
    run("simulate", sensor="pleiades", images=3, along="-12,0,12", size=300, gcps=6, checks=4, ties=40, seed=11,
        pixels=False, output_dir=str(bare))  # fmt: skip
    for file in bare.glob("*_RPC.TXT"):
        text = "\n".join(line for line in file.read_text().splitlines() if "HRSI" not in line) + "\n"
        (folder / file.name).write_text(text)
    for name in ("report.json", "truth.gpkg"):
        (folder / name).unlink()
    return folder


@pytest.fixture
def folder(delivered: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(delivered, tmp_path / "v"))


def adjust(folder: Path, output: Path, **options: object) -> dict:
    images = [str(folder / f"image_{number}.tif") for number in (1, 2, 3)]
    points = {"gcps": str(folder / "ground_points.csv"), "image_points": str(folder / "image_points.csv")}
    return run(
        "adjust", **{"images": images, **points, "height_datum": "ellipsoidal", "output_dir": str(output)} | options
    )


def digests(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir() if path.is_file()}


def test_vendors_rpc_files_are_not_overwritten_unasked(folder: Path) -> None:
    before = digests(folder)
    with pytest.raises(InputError, match=r"image_1_RPC\.TXT exists"):
        adjust(folder, folder, write="sidecar")
    assert digests(folder) == before


def test_vendors_rpc_files_are_kept_once(folder: Path) -> None:
    before = digests(folder)
    adjust(folder, folder, write="sidecar", overwrite=True)
    first = digests(folder)
    assert first["image_1_RPC.TXT.original"] == before["image_1_RPC.TXT"] != first["image_1_RPC.TXT"]
    adjust(folder, folder, write="sidecar", overwrite=True)
    kept = [name for name in digests(folder) if ".original" in name]
    assert sorted(kept) == [f"image_{number}_RPC.TXT.original" for number in (1, 2, 3)]
    for number in (1, 2, 3):
        run("write-rpc", images=[str(folder / f"image_{number}.tif")], restore=True)
    after = digests(folder)
    assert {name: after[name] for name in before} == before


def test_an_input_is_never_an_output(folder: Path, tmp_path: Path) -> None:
    """GCPs from an earlier result, written over that result; RPC files, over themselves."""
    result = tmp_path / "o1"
    adjust(folder, result, write="none")
    before = digests(result)
    gcps = f"{result / 'block.gpkg'}|layername=ground_points"
    with pytest.raises(InputError, match="is an input"):
        adjust(folder, result, write="none", gcps=gcps, overwrite=True)
    assert digests(result) == before
    files, before = sorted(map(str, folder.glob("*_RPC.TXT"))), digests(folder)
    with pytest.raises(InputError, match="is an input"):  # sidecars beside the RPC files that were adjusted
        adjust(folder, folder, images=files, write="sidecar", overwrite=True)
    assert digests(folder) == before


@pytest.mark.parametrize(
    ("name", "options", "foreign"),
    [
        ("simulate", {"images": 2, "size": 100, "pixels": False}, "dem.tif"),
        ("fit-rpc", {"id": "image_1"}, "image_1_RPC.TXT"),
        ("adjust", {}, "image_2.tif"),
        ("adjust", {"write": "none"}, "report.html"),
    ],
)
def test_files_of_others_stay(folder: Path, tmp_path: Path, name: str, options: dict, foreign: str) -> None:
    output = tmp_path / "out"
    output.mkdir()
    (output / foreign).write_text("mine")
    calls = {
        "adjust": lambda: adjust(folder, output, **options),
        "fit-rpc": lambda: run(name, points=str(correspondences(tmp_path)), output_dir=str(output), **options),
        "simulate": lambda: run(name, output_dir=str(output), **options),
    }
    with pytest.raises(InputError, match=f"{foreign} exists"):
        calls[name]()
    assert (output / foreign).read_text() == "mine" and [path.name for path in output.iterdir()] == [foreign]


def correspondences(folder: Path) -> Path:
    """Write points of a plain affine camera."""
    rows = ["lon,lat,height,sample,line"]
    for k in range(64):
        east, north, up = k % 4, k // 4 % 4, k // 16
        rows.append(f"{5 + 0.01 * east},{43 + 0.01 * north},{50 * up},{1000 * east + 7 * up},{3000 - 1000 * north}")
    path = folder / "grid.csv"
    path.write_text("\n".join(rows))
    return path


@pytest.mark.parametrize("name", ["../evil", "a/b", "..", "/tmp/evil"])
def test_ids_are_no_paths(tmp_path: Path, name: str) -> None:
    output = tmp_path / "a" / "out"
    with pytest.raises(InputError, match="id"):
        run("fit-rpc", points=str(correspondences(tmp_path)), id=name, output_dir=str(output))
    assert not list(tmp_path.rglob("*_RPC.TXT"))


WRITER = """
import sys
from hrsi.processing_algorithms.command_line.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_report_names_what_was_written(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "o"
    report = adjust(folder, output)
    written = json.loads((output / "report.json").read_text())
    named = {os.path.basename(image["output"]) for image in written["images"].values()}
    named |= {os.path.basename(file) for file in written["outputs"].values()}
    assert named == {path.name for path in output.iterdir()}
    assert report["outputs"] == written["outputs"]


def test_a_dem_is_not_replaced_by_its_orthoimage(folder: Path, tmp_path: Path) -> None:
    """By its path, and by a symbolic or hard link to it."""
    output = tmp_path / "o"
    output.mkdir()
    target = output / "image_1_ortho.tif"
    shutil.copy(folder / "dem.tif", target)
    (tmp_path / "symbolic.tif").symlink_to(target)
    (tmp_path / "hard.tif").hardlink_to(target)
    before = digests(output)
    for dem in (target, tmp_path / "symbolic.tif", tmp_path / "hard.tif", os.path.relpath(target)):
        with pytest.raises(InputError, match="is an input"):
            run("orthorectify", images=[str(folder / "image_1.tif")], dem=str(dem), output_dir=str(output),
                overwrite=True)  # fmt: skip
    assert digests(output) == before


@pytest.mark.killed
def test_one_of_six_runs_in_place_wins(folder: Path, tmp_path: Path) -> None:
    words = ["adjust", *(str(folder / f"image_{k}.tif") for k in (1, 2, 3)), "--gcps",
             str(folder / "ground_points.csv"), "--image-points", str(folder / "image_points.csv"), "--height-datum",
             "ellipsoidal", "--write", "in-place", "--no-report", "--output-dir"]  # fmt: skip
    runs = [
        subprocess.Popen([sys.executable, "-c", WRITER, *words, str(tmp_path / f"o{number}")], stderr=subprocess.PIPE)
        for number in range(6)
    ]
    said = [one.communicate(timeout=120)[1] for one in runs]
    won = [number for number, one in enumerate(runs) if one.returncode == 0]
    assert won and all(
        one.returncode == 0 or b"another run writes it now" in text for one, text in zip(runs, said, strict=True)
    )
    assert sorted(path.name for path in tmp_path.iterdir() if path.name[0] == "o") == [f"o{number}" for number in won]
    assert not list(folder.rglob(".*"))


@pytest.mark.thorough
def test_a_simulation_of_fewer_images_leaves_nothing_of_the_earlier_one(tmp_path: Path) -> None:
    options = {"sensor": "pleiades", "size": 64, "gcps": 1, "checks": 0, "ties": 0, "output_dir": str(tmp_path / "s")}
    run("simulate", images=3, along="-9,0,9", ortho=True, **options)
    (tmp_path / "s" / "image_3.txt").write_text("mine")
    run("simulate", images=2, along="-9,9", overwrite=True, **options)
    there = {path.name for path in (tmp_path / "s").iterdir()}
    assert "image_3.txt" in there and not there & {"image_3.tif", "orthophoto.tif"}


def test_memory_is_no_output_directory(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rpc-info", str(folder / "image_1.tif"), "--output-dir", "/vsimem/x"]) == 2
    assert "nothing would remain" in capsys.readouterr().err


@pytest.mark.thorough
def test_jitter_of_images_in_place_lies_beside_them_and_goes_with_them(folder: Path, tmp_path: Path) -> None:
    names = [f"image_{number}" for number in (1, 2, 3)]
    before = digests(folder)
    adjust(folder, tmp_path / "o", write="in-place", jitter="40")
    beside = folder / "jitter.csv"
    found = {
        name: JitterFile(str(beside)).find_curve(name, read_rpc(str(folder / f"{name}.tif")).rpc) for name in names
    }
    assert all(curve is not None and not told for curve, told in found.values())
    run("write-rpc", images=[str(folder / "image_1.tif")], restore=True)
    assert JitterFile(str(beside)).ids == set(names)  # it serves the two others
    adjust(folder, tmp_path / "o", write="in-place", jitter="40", overwrite=True)
    run("write-rpc", images=[str(folder / f"{name}.tif") for name in names], restore=True)
    assert not beside.exists()
    assert {name for name in digests(folder) if "jitter" in name or name not in before} == set()


def test_jitter_of_results_stays_where_nothing_is_restored(folder: Path, tmp_path: Path) -> None:
    adjust(folder, tmp_path / "o", write="sidecar", jitter="40")
    report = run(
        "write-rpc", images=[str(tmp_path / "o" / f"image_{number}_RPC.TXT") for number in (1, 2)], restore=True
    )
    assert (tmp_path / "o" / "jitter.csv").exists() and len(report["warnings"]) == 2
