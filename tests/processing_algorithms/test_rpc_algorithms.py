"""`rpc-info`, `project`, `localize` and `fit-rpc`: files, filters, faults; positions against GDAL."""

import csv
import io
import json
import sys
from pathlib import Path

import numpy as np
import pyproj
import pytest

import hrsi
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.tests.test_rpc import synthetic_rpc
from hrsi.tests.test_rpc_fit import pushbroom_points


@pytest.fixture
def scene(tmp_path: Path) -> tuple[str, RPC]:
    """An RPC file alone."""
    path = str(tmp_path / "scene_RPC.TXT")
    write_rpc_text(path, synthetic_rpc(12.0, 48.0))
    return path, read_rpc(path).rpc


def pipe_in(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))


def write_rows(path: Path, header: str, rows: np.ndarray, ids: bool = True) -> str:
    lines = [f"{f'p{number},' if ids else ''}{','.join(map(repr, row))}" for number, row in enumerate(rows.tolist())]
    path.write_text("\n".join([f"{'id,' if ids else ''}{header}", *lines]) + "\n")
    return str(path)


# ---- filters ---------------------------------------------------------------------------------------------------


def test_localize_then_project_as_filters(
    scene: tuple[str, RPC], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, rpc = scene
    pipe_in(monkeypatch, "100 200 first point\n\n5000.5, 6000.25, 650.0\n")
    assert main(["localize", path, "--height", "300"]) == 0
    printed = capsys.readouterr().out
    ground = [line.split() for line in printed.splitlines()]
    assert ground[0][3:] == ["first", "point"]
    expected, _ = rpc.localize(np.array([[100.0, 200.0], [5000.5, 6000.25]]), np.array([300.0, 650.0]))
    np.testing.assert_allclose(np.array([row[:3] for row in ground], dtype=float), expected, rtol=1e-14)
    pipe_in(monkeypatch, printed)
    assert main(["project", path]) == 0
    image = [line.split() for line in capsys.readouterr().out.splitlines()]
    # 15 digits of a longitude are 1e-13 degree
    np.testing.assert_allclose(np.array([r[:2] for r in image], float), [[100, 200], [5000.5, 6000.25]], atol=1e-7)


def test_projected_lines_have_the_crs_and_the_datum_of_the_options(
    scene: tuple[str, RPC], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Eastings, northings and heights above the geoid, made by PROJ of known points; an impossible latitude is none."""
    path, rpc = scene
    ground = np.array([[12.01, 48.02, 400.0], [12.02, 48.01, 650.0]])
    to_map = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:32633+5773", always_xy=True)
    rows = np.column_stack(to_map.transform(*ground.T))
    assert abs(rows[0, 2] - 400.0) > 30.0
    pipe_in(monkeypatch, "".join(f"{x:.6f} {y:.6f} {h:.6f} P{k}\n" for k, (x, y, h) in enumerate(rows)))
    assert main(["project", path, "--ground-crs", "EPSG:32633", "--height-datum", "egm96"]) == 0
    found = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [row[2] for row in found] == ["P0", "P1"]
    np.testing.assert_allclose(np.array([row[:2] for row in found], float), rpc.project(ground), atol=0.02)
    pipe_in(monkeypatch, "12 93 100\n")
    assert main(["project", path]) == 2
    assert "line 1: lon 12, lat 93" in capsys.readouterr().err


def test_json_holds_the_points(
    scene: tuple[str, RPC], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pipe_in(monkeypatch, "1 2 300\n1e12 1e12 300\n")
    assert main(["localize", scene[0], "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [point["status"] for point in report["points"]] == ["found", "no ray"]
    assert report["points"][1]["lon"] is None
    assert report["warnings"] == ["1 points have no ground position: no ray"]


@pytest.mark.parametrize(
    ("algorithm", "text", "options", "message"),
    [
        ("localize", "5 x\n", ["--height", "3"], "line 1: '5 x'"),
        ("localize", "1 2 3\n\n5\n", ["--height", "3"], "line 3: '5'"),
        ("localize", "5 6\n", [], "point 1 has no height"),
        ("project", "12 48\n", [], "point 1 has no height"),
        ("project", "12 48\n", ["--height", "3", "--dem", "x.tif"], "--dem and --height"),
        ("project", "12 48\n", ["--dem", "x.tif"], "x.tif"),
        ("project", "12 48 100\n48 12 100\n", [], "longitude and latitude of point 2 are swapped"),
    ],
)
def test_wrong_lines_are_named(
    scene: tuple[str, RPC],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    algorithm: str,
    text: str,
    options: list[str],
    message: str,
) -> None:
    pipe_in(monkeypatch, text)
    assert main([algorithm, scene[0], *options]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


def test_nobody_waits_for_a_person(scene: tuple[str, RPC], monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.StringIO()
    terminal.isatty = lambda: True  # type: ignore[method-assign]
    for stdin in (terminal, None):
        monkeypatch.setattr(sys, "stdin", stdin)
        with pytest.raises(InputError, match="`points`"):
            run("project", images=[scene[0]])


# ---- point files -----------------------------------------------------------------------------------------------


def test_points_without_height_take_the_dem(real_data: Path, tmp_path: Path) -> None:
    folder = real_data / "ventoux_phr_pair"
    dem = {"dem": str(folder / "dem" / "N44E005.hgt"), "dem_datum": str(folder / "dem" / "egm96_15.gtx")}
    images = [str(folder / "left_image.tif"), str(folder / "right_image.tif")]
    rows = tmp_path / "image.csv"
    rows.write_text("image,sample,line\nleft_image,250,250\nright_image.tif,100,100\n")
    ground = run("localize", images=images, points=str(rows), **dem)["points"]
    assert all(450.0 < point["height"] < 650.0 for point in ground)
    flat = tmp_path / "ground.csv"
    flat.write_text("id,lon,lat\n" + "".join(f"{k},{p['lon']!r},{p['lat']!r}\n" for k, p in enumerate(ground)))
    back = run("project", images=images, points=str(flat), **dem)["points"]
    same = [back[0], back[3]]  # rows are all points in the first image, then all in the second
    np.testing.assert_allclose(
        [[p["sample"], p["line"]] for p in same], [[250, 250], [100, 100]], atol=5e-3
    )  # a millimetre of height


def test_exchanged_coordinates_are_named_in_files_and_arrays(scene: tuple[str, RPC], tmp_path: Path) -> None:
    ground = np.array([[12.0, 48.0, 100.0], [48.0, 12.0, 100.0]])
    rows = write_rows(tmp_path / "ground.csv", "lon,lat,height", ground)
    with pytest.raises(InputError, match="of p1 are swapped"):
        run("project", images=[scene[0]], points=rows)
    with pytest.raises(InputError, match="of point 2 are swapped"):
        hrsi.project(scene[0], ground)
    far = hrsi.project(scene[0], [[12.0, 43.0, 100.0]])  # far away, but in order: as asked
    assert np.isfinite(far).all() or np.isnan(far).all()


def test_points_of_another_image_are_refused(scene: tuple[str, RPC], tmp_path: Path) -> None:
    rows = tmp_path / "image.csv"
    rows.write_text("image,sample,line\nother,1,2\n")
    with pytest.raises(InputError, match="'other'"):
        run("localize", images=[scene[0]], points=str(rows), height=3.0)


# ---- rpc-info --------------------------------------------------------------------------------------------------


def test_rpc_info_says_that_overlap_depends_on_height(real_data: Path) -> None:
    images = [str(real_data / "ventoux_phr_pair" / name) for name in ("left_image.tif", "right_image.tif")]
    report = run("rpc-info", images=images)
    assert report["pairs"][0]["convergence_deg"] is None
    assert "`dem` or `height`" in report["warnings"][0]
    with pytest.raises(InputError, match="is given twice"):
        run("rpc-info", images=[images[0], images[0]])


# ---- fit-rpc ---------------------------------------------------------------------------------------------------


def test_fit_rpc_of_a_pushbrooms_grid(tmp_path: Path) -> None:
    ground, image = pushbroom_points((15, 15, 6))
    table = write_rows(tmp_path / "grid.csv", "lon,lat,height,sample,line", np.hstack([ground, image]), ids=False)
    out = tmp_path / "out"
    report = run("fit-rpc", points=table, height_datum="ellipsoidal", output_dir=str(out), max_height=2500.0)
    assert report["check"]["points"] == 270
    assert report["max_px"] < 1e-4
    assert report["check"]["max_px"] < 1e-4
    assert "extrapolates" in report["warnings"][-1]
    fitted = read_rpc(str(out / "grid_RPC.TXT")).rpc
    check, expected = pushbroom_points((16, 16, 7))
    np.testing.assert_allclose(fitted.project(check), expected, atol=1e-4)
    assert report["read_back_px"] < 1e-6


def test_fit_rpc_of_noisy_points_is_damped(tmp_path: Path) -> None:
    rng = np.random.default_rng(52)
    ground, image = pushbroom_points((8, 8, 3))
    table = write_rows(
        tmp_path / "noisy.csv", "lon,lat,height,sample,line",
        np.hstack([ground, image + rng.normal(0, 0.5, image.shape)]),
    )  # fmt: skip
    report = run("fit-rpc", points=table, height_datum="ellipsoidal", output_dir=str(tmp_path), id="scene")
    check, expected = pushbroom_points((16, 16, 7))
    residual = read_rpc(str(tmp_path / "scene_RPC.TXT")).rpc.project(check) - expected
    assert np.sqrt(np.mean(residual**2)) < 1.0  # 192 points of 0.5 px, 78 unknowns
    assert 0.3 < report["check"]["rms_px"] < 3.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lon,lat,height,sample\n1,2,3,4\n", "'line'"),
        ("sample,line\n1,2\n", "no ground positions"),
        ("lon,lat,height,sample,line\n12,48,3,,5\n", "sample or line is empty"),
        ("lon,lat,height,sample,line\n12,48,,4,5\n", "height"),
    ],
)
def test_fit_rpc_names_what_is_missing(tmp_path: Path, text: str, message: str) -> None:
    table = tmp_path / "table.csv"
    table.write_text(text)
    with pytest.raises(InputError, match=message):
        run("fit-rpc", points=str(table), output_dir=str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_printed_tables_are_csv(scene: tuple[str, RPC], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = write_rows(tmp_path / "ground.csv", "lon,lat,height", np.array([[12.0, 48.0, 100.0]]))
    assert main(["project", scene[0], "--points", points, "--height-datum", "ellipsoidal"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert rows[0]["id"] == "p0"
    assert float(rows[0]["sample"]) == pytest.approx(scene[1].project(np.array([[12.0, 48.0, 100.0]]))[0, 0])
