"""`evaluate`: sets of RPCs side by side, on a simulated block whose true cameras are known and on the real triplet."""

import csv
import json
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files.csv_text import write_measurements
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.evaluate import summarise


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three views with ties, GCPs and check points measured to 0.2 px, and the block adjusted by half of the ties."""
    folder = tmp_path_factory.mktemp("block")
    run("simulate", output_dir=str(folder / "sim"), size=1500, images=3, along=["-14", "0", "14"], relief=80.0, gcps=6,
        checks=12, ties=240, pixels=False, noise_image=0.2, noise_gcp_xy=0.05, noise_gcp_h=0.05, seed=8)  # fmt: skip
    select_points(folder, "made.csv", lambda name: name[:1] != "T" or int(name[1:]) % 2 == 0)
    run("adjust", images=images(folder), gcps=str(folder / "sim" / "ground_points.csv"), height_datum="ellipsoidal",
        image_points=str(folder / "made.csv"), output_dir=str(folder / "refined"), model="affine",
        report=False)  # fmt: skip
    return folder


def select_points(folder: Path, name: str, chosen: Callable[[str], bool]) -> set[str]:
    """Write the image points whose ids are chosen; return the ids of the tie points among them."""
    with (folder / "sim" / "image_points.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    with (folder / name).open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(row for row in rows if chosen(row["id"]))
    return {row["id"] for row in rows if chosen(row["id"]) and row["id"].startswith("T")}


def images(folder: Path) -> list[str]:
    return sorted(str(path) for path in (folder / "sim").glob("image_?_RPC.TXT"))


def evaluate(folder: Path, out: Path, **options: Any) -> dict[str, Any]:
    given = {
        "images": images(folder), "tracks": "none", "image_points": str(folder / "sim" / "image_points.csv"),
        "gcps": str(folder / "sim" / "ground_points.csv"), "height_datum": "ellipsoidal", "output_dir": str(out),
        "rpcs": [f"refined={folder / 'refined'}"],
    }  # fmt: skip
    return run("evaluate", **(given | options))


def test_refined_rpcs_come_out_better_by_every_figure(block: Path, tmp_path: Path) -> None:
    report = evaluate(block, tmp_path / "out", dem=str(block / "sim" / "dem.tif"))
    own, refined = report["sets"]["own"], report["sets"]["refined"]
    assert set(report["best"].values()) == {"refined"}
    assert refined["predicted_rmse_px"] < 0.5 * own["predicted_rmse_px"]
    # The image points' own noise: 0.2 px a coordinate, enlarged by the prediction; three rays leave 3 of 6 free
    assert refined["predicted_rmse_px"] == pytest.approx(0.2 * np.sqrt(2.0) * refined["noise_enlargement"], rel=0.25)
    assert refined["fit_rmse_px"] == pytest.approx(0.2 * np.sqrt(2.0 * 3.0 / 6.0), rel=0.2)
    assert own["control"]["points"] == 6 and own["check"]["points"] == 12
    assert refined["check"]["ce90_m"] < own["check"]["ce90_m"]
    assert abs(refined["dem"]["median_m"]) < abs(own["dem"]["median_m"])
    assert {pair["points"] for pair in own["pairs"]} == {report["tracks"]["points"]}
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "refined" in page and "<svg" in page
    with sqlite3.connect(tmp_path / "out" / "evaluation.gpkg") as database:
        styles = dict(database.execute("SELECT f_table_name, styleQML FROM layer_styles"))
        rows = dict(database.execute("SELECT residual, count(*) FROM residuals_refined GROUP BY residual"))
        rmse = database.execute(
            "SELECT avg(residual_sample_px * residual_sample_px + residual_line_px * residual_line_px) "
            "FROM residuals_refined WHERE residual = 'predicted'"
        ).fetchone()[0]
    assert {"residuals_own", "residuals_refined", "images"} <= set(styles)
    assert rows["predicted"] == refined["predictions"]
    assert np.sqrt(rmse) == pytest.approx(refined["predicted_rmse_px"])
    assert "best: refined" in summarise(json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8")))


def test_the_images_named_again_are_no_set_of_their_own(block: Path, tmp_path: Path) -> None:
    report = evaluate(block, tmp_path / "out", rpcs=f"raw={block / 'sim'};refined={block / 'refined'}", report=False)
    assert list(report["sets"]) == ["raw", "refined"]


def test_names_with_the_image_s_name_in_them_are_found(block: Path, tmp_path: Path) -> None:
    """As other tools name what they adjusted; ``image_1`` is not ``image_10``."""
    other = tmp_path / "other"
    other.mkdir()
    for path in map(Path, images(block)):
        refined = block / "refined" / path.name
        shutil.copy(refined, other / f"run-{path.name}")
        shutil.copy(path, other / path.name.replace("image_", "image_0"))
    report = evaluate(block, tmp_path / "out", rpcs={"other": other, "refined": block / "refined"}, report=False)
    other_set, refined_set = report["sets"]["other"], report["sets"]["refined"]
    assert other_set["predicted_rmse_px"] == refined_set["predicted_rmse_px"]
    assert set(report["best"].values()) == {None}  # equal sets: none is the best


def test_tracks_beside_used_points_are_left_out(block: Path, tmp_path: Path) -> None:
    ties = select_points(block, "all.csv", lambda name: True)
    used = select_points(block, "used.csv", lambda name: name in sorted(ties)[:50])
    raw = [f"raw={block / 'sim'}"]
    report = evaluate(block, tmp_path / "out", rpcs=raw, used_points=str(block / "used.csv"), apart=0.5, report=False)
    assert len(used) == 50 and report["tracks"]["points"] == len(ties) - 50


def test_tracks_that_made_rpcs_do_not_judge_them(block: Path, tmp_path: Path) -> None:
    """The refined RPCs' folder tells which tracks made them, wherever their images are named from."""
    ties = select_points(block, "all.csv", lambda name: True)
    made = select_points(block, "made.csv", lambda name: name[:1] != "T" or int(name[1:]) % 2 == 0)
    report = evaluate(block, tmp_path / "out", report=False)
    assert report["tracks"]["points"] == len(ties) - len(made) == 120
    assert report["tracks"]["made_rpcs"] == 120 and report["tracks"]["independent"]
    assert report["sets"]["refined"]["made_by"] == str(block / "refined" / "report.json")
    assert report["sets"]["own"]["made_by"] is None and report["best"]["predicted"] == "refined"
    # Of the tracks that made them alone nothing follows
    alone = evaluate(block, tmp_path / "alone", image_points=str(block / "made.csv"), report=False)
    assert alone["tracks"]["points"] == 120 and not alone["tracks"]["independent"]
    assert alone["best"]["predicted"] is None and alone["best"]["fit"] is None
    assert any("all 120 tracks were used for RPCs refined" in text for text in alone["warnings"])


def test_held_out_tracks_judge_the_rpcs_that_they_did_not_make(block: Path, tmp_path: Path) -> None:
    """600 tracks of which a tenth is held out: these alone judge, whether read from the result or the file."""
    run("simulate", output_dir=str(tmp_path / "sim"), size=1500, images=2, ties=600, gcps=6, checks=0, pixels=False,
        seed=9)  # fmt: skip
    paths = sorted(str(path) for path in (tmp_path / "sim").glob("image_?_RPC.TXT"))
    points, known = str(tmp_path / "sim" / "image_points.csv"), str(tmp_path / "sim" / "ground_points.csv")
    made = run("adjust", images=paths, gcps=known, image_points=points, height_datum="ellipsoidal", report=False,
               output_dir=str(tmp_path / "refined"))  # fmt: skip
    for number, file in enumerate((points, str(tmp_path / "refined" / "block.gpkg"))):
        report = run("evaluate", images=paths, rpcs=[f"refined={tmp_path / 'refined'}"], tracks="none", gcps=known,
                     height_datum="ellipsoidal", image_points=file, output_dir=str(tmp_path / f"out{number}"),
                     report=False)  # fmt: skip
        assert report["tracks"]["made_rpcs"] == 540 and report["tracks"]["held_out"] == 60
        fit = report["sets"]["refined"]
        assert report["tracks"]["wrong"] == made["held_out"]["wrong"] == 0
        assert fit["fit_rmse_px"] == pytest.approx(made["held_out"]["rmse_px"], rel=1e-6)


def test_faults_are_told(block: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for options, message in (
        ({"rpcs": ["refined"]}, "NAME=DIR"),
        ({"rpcs": ["own=x"]}, "choose a name"),
        ({"rpcs": [f"a={block / 'sim'}", f"a={block / 'refined'}"]}, "twice"),
        ({"rpcs": [f"a={tmp_path / 'nowhere'}"]}, "no such directory"),
        ({"rpcs": [f"a={tmp_path / 'empty'}"]}, "contains no RPC for image_1"),
    ):
        with pytest.raises(InputError, match=message):
            evaluate(block, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


@pytest.mark.real
def test_the_triplet_under_raw_and_adjusted_rpcs(real_data: Path, tmp_path: Path, monkeypatch) -> None:
    """SIFT's tracks, found without RPCs, took no part. An independent calculation gives the raw RPCs' figures:
    medians across the epipolar lines of 0.482, 0.844 and 0.367 px, three-view tracks 0.583 px."""
    from hrsi.benchmarks import real_blocks

    monkeypatch.setattr(real_blocks, "DATA", real_data.parent)
    tracks = real_blocks.triplet()
    paths = [image.path for image in tracks.images]
    write_measurements(str(tmp_path / "sift.csv"), real_blocks.sift_tracks(tracks.images)[0])
    run("triangulate", images=paths, output_dir=str(tmp_path / "hrsi"), write="sidecar", report=False)
    report = run("evaluate", images=paths, rpcs={"hrsi": tmp_path / "hrsi"}, tracks=str(tmp_path / "sift.csv"),
                 reject=0.0, output_dir=str(tmp_path / "out"), report=False)  # fmt: skip
    raw, ours = report["sets"]["own"], report["sets"]["hrsi"]
    assert [abs(pair["bias_px"]) for pair in raw["pairs"]] == pytest.approx([0.482, 0.844, 0.367], abs=0.01)
    assert raw["fit_by_views"]["3"] == pytest.approx(0.583, abs=0.01)
    assert max(abs(pair["bias_px"]) for pair in ours["pairs"]) < 0.02
    assert ours["fit_by_views"]["3"] < 0.18 and ours["fit_rmse_px"] < 0.16
