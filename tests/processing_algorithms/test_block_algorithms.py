"""`triangulate` and `adjust` as a user runs them: the Hobart field, the real triplet, and input that is wrong."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
from gdal_files import write_layer
from osgeo import gdal
from rasterio.transform import RPCTransformer

from hrsi.hrsi_engine.adjustment import WEIGHTS
from hrsi.hrsi_engine.adjustment.options import GROUPING_NAMES, MODEL_NAMES, WEIGHT_NAMES
from hrsi.hrsi_engine.adjustment.statistics.variance_components import GROUPINGS
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.hrsi_engine.laboratory.direct_methods import DIRECT
from hrsi.hrsi_engine.refinement import MODELS
from hrsi.hrsi_engine.refinement.model_table import DIRECT_MODEL_NAMES
from hrsi.hrsi_engine.refinement.selection import RULES
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main

GCPS = "H003,H022,H024,H035,H048,H058,H077,H098,H103,H105"


@pytest.fixture(scope="module")
def adjusted(hobart, tmp_path_factory) -> tuple[dict, Path]:
    folder = tmp_path_factory.mktemp("hobart")
    report = run("adjust", **hobart, gcp_ids=GCPS.split(","), model="shift", output_dir=str(folder))
    return report, folder


@pytest.fixture(scope="module")
def triplet(real_data, tmp_path_factory) -> tuple[dict, Path]:
    """The real triplet through the command line, as anyone would."""
    folder = tmp_path_factory.mktemp("triplet")
    images = [str(real_data / "s2p_triplet_phr" / f"img_0{k}.tif") for k in (1, 2, 3)]
    assert main(["triangulate", *images, "--output-dir", str(folder), "--quiet"]) == 0
    return json.loads((folder / "report.json").read_text()), folder


def layer_columns(path: Path, name: str) -> dict[str, np.ndarray]:
    dataset = gdal.OpenEx(str(path))
    layer = dataset.GetLayerByName(name)
    names = [layer.GetLayerDefn().GetFieldDefn(k).GetName() for k in range(layer.GetLayerDefn().GetFieldCount())]
    rows = [[*(feature.GetField(n) for n in names), feature.geometry().Clone()] for feature in layer]
    return {n: np.array([row[k] for row in rows], dtype=object) for k, n in enumerate([*names, "geometry"])}


def test_choices_are_the_engines():
    """Declarations know names without loading what they name; each list is held against what is there."""
    for names, where, known, table in (
        (MODEL_NAMES, "refinement/model_table.py and RULE_NAMES", {**MODELS, **RULES}, "models.py and RULES"),
        (DIRECT_MODEL_NAMES, "refinement/model_table.py", DIRECT, "laboratory/direct_methods.py"),
        (WEIGHT_NAMES, "adjustment/options.py", WEIGHTS, "WEIGHTS"),
        (GROUPING_NAMES, "adjustment/options.py", GROUPINGS, "GROUPINGS"),
    ):
        differing = sorted(set(names) ^ set(known))
        assert not differing, f"{differing}: enter the name in {where} as well as in {table} of the engine"


# ---- Hobart ---------------------------------------------------------------------------------------------------------


def test_with_control_and_check_named_the_others_take_no_part(hobart, tmp_path):
    """Not as check points, and not as ties: as if they were in no file."""
    chosen = {"gcp_ids": GCPS.split(","), "check_ids": ["H001", "H002"]}
    report = run("adjust", **hobart, **chosen, output_dir=str(tmp_path / "all"), check_as_ties=True)
    assert (report["control"]["points"], report["check"]["points"], report["ties"]["points"]) == (10, 2, 0)
    known = {*GCPS.split(","), "H001", "H002"}
    assert set(layer_columns(tmp_path / "all" / "block.gpkg", "ground_points")["id"]) == known
    for name in ("gcps", "image_points"):
        with open(hobart[name]) as file:
            header, *rows = file.readlines()
        kept = [row for row in rows if row.split(",")[header.strip().split(",").index("id")] in known]
        (tmp_path / f"{name}.csv").write_text("".join([header, *kept]))
    files = {name: str(tmp_path / f"{name}.csv") for name in ("gcps", "image_points")}
    alone = run("adjust", **hobart | files, **chosen, output_dir=str(tmp_path / "alone"), check_as_ties=True)
    assert alone["check"] == report["check"]
    assert alone["sigma0"] == pytest.approx(report["sigma0"])


def test_utm_residuals_lie_at_the_printed_coordinates(adjusted, hobart):
    """Eastings and northings of the field were printed independently (UTM 55S)."""
    rows = layer_columns(adjusted[1] / "block.gpkg", "residuals_utm")
    with open(hobart["gcps"]) as file:
        printed = {row["id"]: (float(row["easting"]), float(row["northing"])) for row in csv.DictReader(file)}
    ground = rows["level"] == "ground"
    for point, geometry in zip(rows["id"][ground], rows["geometry"][ground], strict=True):
        assert (geometry.GetX(), geometry.GetY()) == pytest.approx(printed[point], abs=0.002)


def test_results_can_be_fed_back(adjusted, hobart, tmp_path):
    """The layer of measurements that HRSI wrote is image points again; its adjusted positions are no GCPs."""
    report, folder = adjusted
    options = hobart | {"image_points": f"{folder / 'block.gpkg'}|layername=image_points"}
    again = run("adjust", **options, gcp_ids=GCPS.split(","), model="shift", output_dir=str(tmp_path))
    for figure, value in report["check"].items():
        assert again["check"][figure] == pytest.approx(value, abs=1e-9), figure


def test_gcps_and_measurements_in_one_layer(hobart, tmp_path):
    """A GCP layer that was measured on an image is both at once."""
    with open(hobart["gcps"]) as file:
        ground = {row["id"]: row for row in csv.DictReader(file)}
    with open(hobart["image_points"]) as file:
        rows = [row | {k: ground[row["id"]][k] for k in ("lon", "lat", "height")} for row in csv.DictReader(file)]
    with open(tmp_path / "both.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    both = str(tmp_path / "both.csv")
    report = run("adjust", images=hobart["images"], gcps=both, output_dir=str(tmp_path / "result"))
    assert report["control"]["points"] == 71


def test_triangulate_does_the_same(adjusted, hobart, tmp_path):
    report = run("triangulate", **hobart, tie_points="none", gcp_ids=GCPS.split(","), output_dir=str(tmp_path / "new"))
    assert report["check"] == adjusted[0]["check"]


def test_residual_crs_chooses_the_layers(hobart, tmp_path):
    few = GCPS.split(",")
    run("adjust", **hobart, gcp_ids=few, residual_crs="utm", report=False, write="none", output_dir=str(tmp_path))
    dataset = gdal.OpenEx(str(tmp_path / "block.gpkg"))
    assert dataset.GetLayerByName("residuals_utm")
    assert dataset.GetLayerByName("residuals_wgs84") is None
    names = {"block.gpkg", "block.json", "block_cameras.npz", "report.json"}
    assert {file.name for file in tmp_path.iterdir()} == names


# ---- the real triplet -----------------------------------------------------------------------------------------------


@pytest.mark.real
def test_triplet_ties_fit(triplet):
    ties = triplet[0]["ties"]["by_rays"]["3"]
    assert ties["points"] > 1000
    assert 0.5 < ties["before_rmse_px"] < 0.66  # about 0.58 by an independent matcher
    assert ties["rmse_px"] <= 0.20


@pytest.mark.real
def test_refined_copies_read_by_rasterio_and_gdal_project_as_reported(triplet):
    """Adjusted tie points through the copies' RPCs, by two other programs, against the report's layer: 0.01 px."""
    report, folder = triplet
    ground = layer_columns(folder / "block.gpkg", "ground_points")
    place = {i: (g.GetX(), g.GetY(), g.GetZ()) for i, g in zip(ground["id"], ground["geometry"], strict=True)}
    points = layer_columns(folder / "block.gpkg", "image_points")
    for image_id, entry in report["images"].items():
        here = (points["image"] == image_id) & (points["flag"] != "rejected")
        computed = np.column_stack(
            [(points[n][here] - points[f"residual_{n}_px"][here]).astype(float) for n in ("sample", "line")]
        )
        lon, lat, height = np.array([place[i] for i in points["id"][here]]).T
        with rasterio.open(entry["output"]) as image, RPCTransformer(image.rpcs) as transformer:
            line, sample = transformer.rowcol(lon, lat, height, op=np.float64)
        by_rasterio = np.column_stack([sample, line]) - 0.5  # rasterio counts from the corner
        transformer = gdal.Transformer(gdal.Open(entry["output"]), None, ["METHOD=RPC"])
        by_gdal = np.array(transformer.TransformPoints(1, list(zip(lon, lat, height, strict=True)))[0])[:, :2] - 0.5
        worst = [np.abs(other - computed).max() for other in (by_rasterio, by_gdal)]
        assert max(worst) < 0.01


@pytest.mark.real
def test_ties_without_gcps_stay_near_the_vendors_position(triplet, real_data):
    """The block's height is the vendor's within the RPCs' accuracy: 206 m by the data's description, 85 to 275 m."""
    ground = layer_columns(triplet[1] / "block.gpkg", "ground_points")
    heights = np.array([g.GetZ() for g in ground["geometry"]])
    assert abs(np.median(heights) - 206) < 60


@pytest.mark.real
def test_dem_narrows_the_search(real_data, tmp_path):
    """Ventoux: 28 % overlap at the terrain's height, none at the RPCs' HEIGHT_OFF; a -3.4 px bias goes away."""
    folder = real_data / "ventoux_phr_pair"
    report = run(
        "triangulate",
        images=[str(folder / f"{side}_image.tif") for side in ("left", "right")],
        dem=str(folder / "dem" / "N44E005.hgt"),
        height_datum=str(folder / "dem" / "egm96_15.gtx"),
        output_dir=str(tmp_path),
    )
    ties = report["ties"]
    assert ties["points"] > 300
    assert ties["before_rmse_px"] > 2.0
    assert ties["rmse_px"] < 0.25


# ---- wrong input ----------------------------------------------------------------------------------------------------


def layer_without_crs(path: Path) -> str:
    return str(write_layer(path, "ESRI Shapefile", "", np.array([[147.24, -42.81, 94.0]]), {"id": ["H003"]}))


def wrong_image_id(path: Path, hobart: dict) -> str:
    text = Path(hobart["image_points"]).read_text().replace("hobart_ikonos_2", "hobart_9")
    path.write_text(text)
    return str(path)


def two_points(path: Path, hobart: dict) -> str:
    lines = Path(hobart["image_points"]).read_text().splitlines()
    path.write_text("\n".join([lines[0], *[line for line in lines if line.startswith(("H003,", "H022,"))]]) + "\n")
    return str(path)


BAD = {
    "GCP layer without CRS": (
        lambda t, h, r: [
            "adjust", *h["images"], "--gcps", layer_without_crs(t / "g.shp"), "--image-points", h["image_points"],
        ],
        2, "--ground-crs",
    ),
    "unknown image id": (
        lambda t, h, r: [
            "adjust", *h["images"], "--gcps", h["gcps"], "--image-points", wrong_image_id(t / "p.csv", h),
        ],
        2, "hobart_9",
    ),
    "unknown GCP id": (
        lambda t, h, r: [
            "adjust", *h["images"], "--gcps", h["gcps"], "--image-points", h["image_points"], "--gcp-ids", "H003,Q1",
        ],
        2, "Q1",
    ),
    "too few observations": (
        lambda t, h, r: [
            "adjust", *h["images"], "--gcps", h["gcps"], "--image-points", two_points(t / "p.csv", h),
            "--model", "affine",
        ],
        1, "--model",
    ),
    "GCPs that are measured nowhere": (
        lambda t, h, r: ["triangulate", *h["images"], "--gcps", h["gcps"], "--tie-points", "none"], 2, "--image-points",
    ),
    "no pixels to match": (lambda t, h, r: ["triangulate", *h["images"]], 2, "pixels"),
    "one image twice": (
        lambda t, h, r: ["adjust", h["images"][0], h["images"][0], "--image-points", h["image_points"]],
        2, "is given twice",
    ),
    "one name for two images": (
        lambda t, h, r: ["adjust", h["images"][0], shutil.copy(h["images"][0], t), "--image-points", h["image_points"]],
        2, "have the same id",
    ),
    "a name with _RPC at its end, and without": (
        lambda t, h, r: [
            "adjust", h["images"][0], shutil.copy(h["images"][0], f"{t}/{Path(h['images'][0]).stem[:-4]}.txt"),
            "--image-points", h["image_points"],
        ],
        2, "leaves out _RPC at the end of a file name: rename one, or give only one",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(case, hobart, real_data, tmp_path, capfd):
    arguments, code, word = BAD[case]
    output = tmp_path / "result"
    status = main([*arguments(tmp_path, hobart, real_data), "--output-dir", str(output)])
    printed = capfd.readouterr()
    errors = [line for line in printed.err.splitlines() if line.startswith("ERROR:")]
    assert status == code
    assert len(errors) == 1
    assert word in errors[0]
    assert "Traceback" not in printed.err
    assert printed.out == ""
    assert not output.exists()


def test_an_earlier_result_is_not_replaced_unasked(hobart, tmp_path, capfd):
    arguments = ["adjust", *hobart["images"], "--gcps", hobart["gcps"], "--image-points", hobart["image_points"]]
    arguments += ["--gcp-ids", GCPS, "--output-dir", str(tmp_path / "r"), "--quiet"]
    assert main(arguments) == 0
    before = (tmp_path / "r" / "report.json").read_bytes()
    assert main(arguments) == 2
    assert "--overwrite" in capfd.readouterr().err
    assert (tmp_path / "r" / "report.json").read_bytes() == before
    assert main([*arguments, "--overwrite"]) == 0


def test_cancel_leaves_nothing(hobart, tmp_path):
    from hrsi.hrsi_engine.foundation.errors import Cancelled

    folder = tmp_path / "result"
    with pytest.raises(Cancelled):
        run(
            "adjust",
            **hobart,
            gcp_ids=GCPS.split(","),
            output_dir=str(folder),
            progress=lambda fraction, _: fraction < 0.7,
        )
    assert not folder.exists()


# ---- where refined RPCs go ------------------------------------------------------------------------------------------


@pytest.fixture
def pair(real_data, tmp_path) -> list[str]:
    """Copies of two real images that a test may write into."""
    for k in (1, 2):
        shutil.copyfile(real_data / "s2p_triplet_phr" / f"img_0{k}.tif", tmp_path / f"img_0{k}.tif")
    return [str(tmp_path / f"img_0{k}.tif") for k in (1, 2)]


@pytest.fixture(scope="module")
def ties(real_data, tmp_path_factory) -> str:
    """Tie points at 206 m on a grid of the first real image, where its neighbours lie 3 px beside their RPCs."""
    rpcs = [read_rpc(str(real_data / "s2p_triplet_phr" / f"img_0{k}.tif")).rpc for k in (1, 2, 3)]
    grid = np.stack(np.meshgrid(np.arange(400.0, 601.0, 10.0), np.arange(400.0, 601.0, 10.0)), axis=-1).reshape(-1, 2)
    ground = rpcs[0].localize(grid, 206.0).ground
    noise = np.random.default_rng(1).normal(0.0, 0.2, (3, len(grid), 2))
    path = tmp_path_factory.mktemp("ties") / "ties.csv"
    rows = [
        f"t{point},img_0{number + 1},{sample:.3f},{line:.3f}\n"
        for number, rpc in enumerate(rpcs)
        for point, (sample, line) in enumerate(rpc.project(ground) + 3.0 * number + noise[number])
    ]
    path.write_text("id,image,sample,line\n" + "".join(rows))
    return str(path)


@pytest.mark.parametrize("how", ["copy", "vrt", "sidecar", "in-place"])
def test_every_way_of_writing_gives_the_same_camera(how, pair, ties, tmp_path):
    before = [Path(path).read_bytes() for path in pair]
    # a shift is folded into the offsets, where it can be seen
    same = {"images": pair, "tie_points": ties, "model": "shift"}
    report = run("triangulate", **same, write=how, output_dir=str(tmp_path / "result"))
    reference = run("triangulate", **same, write="none", output_dir=str(tmp_path / "reference"))
    for path, original in zip(pair, before, strict=True):
        image = report["images"][Path(path).stem]
        shift = [image["parameters"][name]["value"] for name in ("sample_0", "line_0")]
        assert reference["images"][Path(path).stem]["output"] is None
        written = read_rpc(image["output"]).rpc
        vendor = tmp_path / "vendor.tif"
        vendor.write_bytes(original)
        expected = read_rpc(str(vendor)).rpc.shift(*shift)
        np.testing.assert_allclose(written.samp_off, expected.samp_off, atol=1e-9)
        np.testing.assert_allclose(written.line_off, expected.line_off, atol=1e-9)
        assert (Path(path).read_bytes() == original) == (how != "in-place")


def test_tie_points_of_a_larger_block_serve_a_part_of_it(pair, ties, tmp_path):
    report = run("triangulate", images=pair, tie_points=ties, write="none", output_dir=str(tmp_path / "result"))
    assert report["ties"]["points"] == 441
    assert any("img_03" in warning for warning in report["warnings"])


def test_a_sidecar_of_an_earlier_run_does_not_win_over_the_copy(pair, ties, tmp_path):
    folder = str(tmp_path / "result")
    same = {"images": pair, "tie_points": ties, "model": "shift", "output_dir": folder}  # folded into the offsets
    run("triangulate", **same, write="sidecar", sigma_image=0.2)
    stale = tmp_path / "result" / "img_01_RPC.TXT"
    stale.write_text(stale.read_text().replace("LINE_OFF: ", "LINE_OFF: 9"))
    report = run("triangulate", **same, write="copy", overwrite=True)
    shift = report["images"]["img_01"]["parameters"]["line_0"]["value"]
    with rasterio.open(report["images"]["img_01"]["output"]) as copy, rasterio.open(pair[0]) as source:
        assert copy.rpcs.line_off - source.rpcs.line_off == pytest.approx(shift, abs=1e-6)
    assert any("img_01_RPC.TXT" in warning for warning in report["warnings"])


@pytest.mark.real
def test_copies_warp_with_gdal(triplet, tmp_path):
    """The output goes straight into gdalwarp -rpc."""
    output = triplet[0]["images"]["img_01"]["output"]
    warped = gdal.Warp(str(tmp_path / "ortho.tif"), output, rpc=True, dstSRS="EPSG:32631", xRes=2, yRes=2)
    assert warped.RasterXSize > 200
    assert (warped.ReadAsArray() > 0).mean() > 0.5
