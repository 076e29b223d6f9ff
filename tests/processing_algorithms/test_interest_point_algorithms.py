"""`interest-points`, `measure-targets` and `register`: from files to layers, pages and reports."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from gdal_files import write_raster
from independent_formulas import layer

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.laboratory.interest_points import DETECTORS
from hrsi.hrsi_engine.laboratory.interest_points.options import DETECTOR_SETS
from hrsi.hrsi_engine.laboratory.registration import REGISTRATION_FORMS
from hrsi.hrsi_engine.laboratory.registration_options import REGISTRATION_MODELS
from hrsi.hrsi_engine.measurement.interest_points import STRONG_QUALITY
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.laboratory.declarations.interest_points import ALGORITHM as INTEREST_POINTS
from hrsi.tests.measurement.test_targets import CENTRE, disc, image


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """A GeoTIFF without RPC: one bright disc at `CENTRE`."""
    return Path(write_raster(tmp_path / "picture.tif", image(disc(12.0)).grey.astype(np.uint16)))


def test_choices_are_the_engine_s():
    assert {name for names in DETECTOR_SETS.values() for name in names} == set(DETECTORS)
    assert {form for form, _ in REGISTRATION_MODELS.values()} == set(REGISTRATION_FORMS)
    assert next(param.default for param in INTEREST_POINTS.params if param.name == "quality") == STRONG_QUALITY


def test_interest_points_with_rpc_lie_on_the_ground(real_data: Path, tmp_path: Path):
    source = str(real_data / "ventoux_phr_pair" / "left_image.tif")
    report = run("interest-points", images=[source], output_dir=tmp_path / "out", per_cell=20)
    rows = layer(tmp_path / "out" / "interest_points.gpkg", "interest_points")
    assert len(rows) == report["images"]["left_image"]["points"] > 50
    assert json.loads((tmp_path / "out" / "report.json").read_text())["detector"] == "all"
    again = read_points(str(tmp_path / "out" / "interest_points.gpkg") + "|layername=interest_points").image
    assert len(again) == len(rows)
    np.testing.assert_allclose(again.xy[:, 0], [row["sample"] for row in rows])
    assert np.all((again.sigma_px > 0.0) & (again.sigma_px < 1.0))


def test_interest_points_without_rpc_and_in_a_window(picture: Path, tmp_path: Path):
    report = run(
        "interest-points", images=[picture], detector="centres", window="100,100,200,200", output_dir=tmp_path / "out"
    )
    assert report["images"]["picture"]["kinds"] == {"ellipse": 1}
    row = layer(tmp_path / "out" / "interest_points.gpkg", "interest_points")[0]
    assert np.hypot(*(np.array([row["sample"], row["line"]]) - CENTRE)) < 0.1
    assert row["length_px"] == pytest.approx(24.0, abs=0.3)
    with pytest.raises(InputError, match="four whole numbers"):
        run("interest-points", images=[picture], window="1,2,3", output_dir=tmp_path / "other")


def test_targets_near_positions(picture: Path, tmp_path: Path):
    points = tmp_path / "clicked.csv"
    points.write_text("id,sample,line,kind\nA,184,207,center\nB,60,60,corner\n")
    report = run("measure-targets", images=[picture], points=points, output_dir=tmp_path / "out")
    assert (report["measured"], report["refused"]) == (1, 1)
    row = layer(tmp_path / "out" / "targets.gpkg", "targets")[0]
    assert np.hypot(*(np.array([row["sample"], row["line"]]) - CENTRE)) < 0.1
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count('<svg class="chip"') == page.count("data:image/png;base64,") == 2
    assert "no two straight edges meet" in page


def test_targets_from_edges(thesis_data: Path, tmp_path: Path):
    edges = thesis_data / "hobart_roundabout_edges.csv"
    report = run("measure-targets", edges=edges, output_dir=tmp_path / "out")
    assert (report["measured"], report["refused"]) == (51, 0)
    first = report["targets"][0]
    assert (first["sample"], first["line"]) == (pytest.approx(3205.466, abs=0.05), pytest.approx(943.845, abs=0.05))


def test_register_quickbird(thesis_data: Path, tmp_path: Path):
    path = tmp_path / "points.csv"
    with open(thesis_data / "quickbird_ms_pan_tie_points.csv") as source, open(path, "w", newline="") as target:
        writer = csv.writer(target)
        writer.writerow(["id", "image", "sample", "line", "kind"])
        for row in csv.DictReader(source):
            for name in ("ms", "pan"):
                writer.writerow(
                    [row["kind"] + row["no"], name, row[f"{name}_sample"], row[f"{name}_line"], row["kind"]]
                )
    report = run("register", image_points=path, gsd=0.61, output_dir=tmp_path / "out")
    assert report["together"]["center"]["distance"] == pytest.approx(1.0, abs=0.05)
    assert report["together"]["corner"]["distance"] == pytest.approx(2.1, abs=0.05)
    assert len(layer(tmp_path / "out" / "registration.gpkg", "residuals")) == 52
    assert (tmp_path / "out" / "report.html").read_text().count("<svg") == 4
    with pytest.raises(InputError, match="needs both images"):
        run("register", image_points=path, model="rpc-shift", output_dir=tmp_path / "other")
    with pytest.raises(InputError, match="no points on image 'x'"):
        run("register", image_points=path, first="x", output_dir=tmp_path / "other")


def test_register_by_rpc(thesis_data: Path, tmp_path: Path):
    """Over the ground at one height the relief remains in the residuals; the shift takes the rest."""
    images = [thesis_data / f"hobart_ikonos_{number}_RPC.TXT" for number in (1, 3)]
    points = thesis_data / "hobart_image_points.csv"
    by_rpc = run(
        "register", images=images, image_points=points, model="rpc-shift", height=100.0, output_dir=tmp_path / "out"
    )
    assert by_rpc["points"] == 71
    assert by_rpc["first"] == "hobart_ikonos_1"


def test_what_is_missing_is_said(picture: Path, tmp_path: Path):
    for options, reason in (({"images": [picture]}, "give either `points`"), ({"points": picture}, "need the images")):
        with pytest.raises(InputError, match=reason):
            run("measure-targets", output_dir=tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()
