"""What a result says of its making: date, command, inputs with their hashes, options, CRS, versions."""

import contextlib
import hashlib
import json
import os
import shlex
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyproj
import pytest
import simulated_blocks as blocks
from every_algorithm import sound_options, words_of
from long_tests import mark_beyond
from osgeo import gdal

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.foundation.version import VERSION
from hrsi.hrsi_engine.io.catalogue import lineage
from hrsi.hrsi_engine.io.catalogue.lineage import without_secrets_in
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.hrsi_engine.io.rpc_files.fields import numbers_of
from hrsi.hrsi_engine.results.lineage import lineage_items, state_accuracy
from hrsi.processing_algorithms import REGISTRY, run
from hrsi.processing_algorithms.command_line.command_parser import algorithm_parser
from hrsi.processing_algorithms.interface.options import check_options

EPOCH, DATE = "1767225600", "2026-01-01T00:00:00Z"
#: Algorithms that take long for what is looked at here; the others go the same way.
SLOW = {"match", "tie-points", "gcps-from-reference", "evaluate", "triangulate"}
WITH_FOLDER = [name for name, algorithm in REGISTRY.items() if "output_dir" in algorithm.defaults()]


@pytest.fixture(scope="module")
def scene(sound_inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(sound_inputs, tmp_path_factory.mktemp("own") / "scene"))


@pytest.mark.parametrize(
    "name", mark_beyond(4, "thorough", [name for name in WITH_FOLDER if name not in SLOW and name != "write-rpc"])
)
def test_report_tells_its_run(name: str, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything that it takes to follow a run, under the same names for every algorithm."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", EPOCH)
    algorithm = REGISTRY[name]
    given = sound_options(algorithm, scene) | {"output_dir": str(tmp_path / "out")}
    run(name, **{key: value for key, value in given.items() if key in algorithm.defaults()})
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (report["schema"], report["algorithm"], report["version"], report["date"]) == (1, name, VERSION, DATE)
    assert report["crs"]["positions"] == "EPSG:4979"
    assert {"gdal", "proj", "numpy", "python"} <= report["versions"].keys() and report["platform"]
    # The command, read as the command line reads it, gives the same options again
    program, first, *words = shlex.split(report["command"])
    assert (program, first) == ("hrsi", name)
    again = check_options(algorithm, algorithm_parser(algorithm).parse_words(words))
    assert again == check_options(algorithm, report["options"])
    # Every file that was named is there with its hash, which another program computes
    named = [text for text in map(str, _flat(report["options"].values())) if os.path.isfile(text)]
    entries = {entry["path"]: entry for entry in report["inputs"]}
    assert set(named) <= entries.keys()
    for path, entry in entries.items():
        assert entry["sha256"] == hashlib.sha256(Path(path).read_bytes()).hexdigest()
        assert entry["size"] == os.path.getsize(path) and entry["option"] in algorithm.defaults()


def _flat(values) -> list:
    return [item for value in values for item in (value if isinstance(value, list) else [value])]


def test_command_line_is_recorded_as_typed(scene: Path, tmp_path: Path) -> None:
    algorithm = REGISTRY["rpc-info"]
    words = [*words_of(algorithm, sound_options(algorithm, scene)), "--output-dir", str(tmp_path / "an out")]
    subprocess.run([sys.executable, "-m", "hrsi", *words], check=True, capture_output=True, cwd=tmp_path)
    report = json.loads((tmp_path / "an out" / "report.json").read_text())
    assert shlex.split(report["command"]) == ["hrsi", *words]
    assert report["directory"] == str(tmp_path)


def test_input_has_its_crs_and_side_files(scene: Path, tmp_path: Path) -> None:
    image = tmp_path / "a.tif"
    image.write_bytes((scene / "image_1.tif").read_bytes())
    (tmp_path / "a_RPC.TXT").write_bytes((scene / "cameras" / "image_1_RPC.TXT").read_bytes())
    entries = lineage.input_entries({"images": [str(image), "auto"], "dem": [str(scene / "geoid.tif"), str(image)]})
    assert [(entry["option"], Path(entry["path"]).name, entry["crs"]) for entry in entries] == [
        ("images", "a.tif", None), ("images", "a_RPC.TXT", None), ("dem", "geoid.tif", "EPSG:4326"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("PG:host=a user=me password=secret dbname=b", "PG:host=a user=me password=*** dbname=b"),
        ("/vsicurl/https://me:secret@host/a.tif", "/vsicurl/https://me:***@host/a.tif"),
        ("tls://10.0.0.1:8786 a:b@c.tif", "tls://10.0.0.1:8786 a:b@c.tif"),
    ],
)
def test_no_password_gets_into_a_report(text: str, shown: str) -> None:
    assert without_secrets_in(text) == shown


# ---- files that tell of themselves ----------------------------------------------------------------------------------

POINTS = ("gcps", "ground_points.csv"), ("image_points", "image_points.csv")


def adjusted(scene: Path, output: Path, **options: object) -> dict:
    files = {key: str(scene / name) for key, name in POINTS}
    images = [str(scene / "image_1.tif"), str(scene / "image_2.tif")]
    return run("adjust", images=images, **{**files, "height_datum": "ellipsoidal", "output_dir": str(output)} | options)


def own_metadata(path: Path) -> dict[str, str]:
    return {key: text for key, text in gdal.Open(str(path)).GetMetadata().items() if key.startswith("HRSI_")}


@pytest.mark.parametrize(("write", "name"), [("copy", "image_1.tif"), ("vrt", "image_1.vrt")])
def test_refined_image_tells_of_its_making(write: str, name: str, scene: Path, tmp_path: Path) -> None:
    report = adjusted(scene, tmp_path / "out", write=write)
    told = own_metadata(tmp_path / "out" / name)
    assert told == {
        "HRSI_VERSION": VERSION, "HRSI_DATE": report["date"], "HRSI_ALGORITHM": "adjust",
        "HRSI_MODEL": report["model"], "HRSI_BLOCK": "image_1, image_2", "HRSI_SOURCE": "image_1.tif",
        "HRSI_REPORT": str(tmp_path / "out" / "report.json"), "HRSI_VERDICT": report["verdict"]["level"],
        "HRSI_CE90_M": f"{report['check']['ce90_m']:.4g}", "HRSI_LE90_M": f"{report['check']['le90_m']:.4g}",
        "HRSI_ACCURACY_FROM": "check points",
    }  # fmt: skip
    vendor = read_rpc(str(scene / "image_1.tif")).rpc
    kept = gdal.Open(str(tmp_path / "out" / name)).GetMetadata("HRSI_ORIGINAL_RPC")
    assert float(kept["LINE_OFF"]) == vendor.line_off and float(kept["LONG_OFF"]) == vendor.long_off
    pixels = gdal.Open(str(scene / "image_1.tif")).ReadAsArray()
    assert np.array_equal(gdal.Open(str(tmp_path / "out" / name)).ReadAsArray(), pixels)


def test_original_from_a_sidecar_is_what_comes_back(scene: Path, tmp_path: Path) -> None:
    """GDAL takes the vendor's sidecar before the tag; the copy has no sidecar, and keeps what the sidecar said."""
    shutil.copytree(scene, tmp_path / "own")
    vendor = read_rpc(str(scene / "image_1.tif")).rpc.shift(3.0, -2.0)
    write_rpc_text(str(tmp_path / "own" / "image_1_RPC.TXT"), vendor)
    adjusted(tmp_path / "own", tmp_path / "out")
    copy = tmp_path / "out" / "image_1.tif"
    run("write-rpc", images=[str(copy)], restore=True)
    assert numbers_of(read_rpc(str(copy)).rpc) == pytest.approx(numbers_of(vendor), rel=1e-15)


def test_sidecar_tells_of_its_making_and_others_read_it(scene: Path, tmp_path: Path) -> None:
    report = adjusted(scene, tmp_path / "out", write="sidecar")
    text = (tmp_path / "out" / "image_1_RPC.TXT").read_text()
    assert f"HRSI_DATE: {report['date']}\n" in text and "HRSI_SOURCE: image_1.tif\n" in text
    (tmp_path / "out" / "image_1.tif").write_bytes((scene / "orthophoto.tif").read_bytes())
    theirs = gdal.Open(str(tmp_path / "out" / "image_1.tif")).GetMetadata("RPC")
    ours = read_rpc(str(tmp_path / "out" / "image_1_RPC.TXT")).rpc
    assert float(theirs["LINE_OFF"]) == ours.line_off and float(theirs["ERR_BIAS"]) == pytest.approx(ours.err_bias)


def test_geopackage_describes_itself(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Layers, fields and lineage in the standard's own tables, for OGR and any other reader; the same bytes again."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", EPOCH)
    adjusted(scene, tmp_path / "out")
    path = tmp_path / "out" / "block.gpkg"
    dataset = gdal.OpenEx(str(path), gdal.OF_VECTOR)
    lineage = dataset.GetLayerByName("ground_points").GetMetadata()
    assert (lineage["HRSI_ALGORITHM"], lineage["HRSI_DATE"]) == ("adjust", DATE)
    with contextlib.closing(sqlite3.connect(path)) as database:
        told = dict(database.execute("SELECT table_name, description FROM gpkg_contents"))
        described = set(
            database.execute("SELECT table_name, column_name FROM gpkg_data_columns WHERE description != ''")
        )
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert "gpkg_schema" in {row[0] for row in database.execute("SELECT extension_name FROM gpkg_extensions")}
    for index in range(dataset.GetLayerCount()):
        layer = dataset.GetLayer(index)
        name, definition = layer.GetName(), layer.GetLayerDefn()
        if name == "layer_styles":
            continue
        assert told[name]
        fields = {(name, definition.GetFieldDefn(k).GetName()) for k in range(definition.GetFieldCount())}
        assert fields <= described
        code = layer.GetSpatialRef().GetAuthorityCode(None)
        assert code == {"images": "4326", "residuals_utm": "32631"}.get(name, "4979")
    del dataset, layer
    adjusted(scene, tmp_path / "out", overwrite=True)
    first = path.read_bytes()
    adjusted(scene, tmp_path / "out", overwrite=True)
    assert path.read_bytes() == first


def test_ellipsoidal_heights_hold_from_layer_to_layer(scene: Path, tmp_path: Path) -> None:
    """PROJ brings the layer in EPSG:4979 to the UTM zone's 3D coordinates as the layer in UTM has them."""
    adjusted(scene, tmp_path / "out")
    dataset = gdal.OpenEx(str(tmp_path / "out" / "block.gpkg"), gdal.OF_VECTOR)
    pairs = zip(dataset.GetLayerByName("residuals_wgs84"), dataset.GetLayerByName("residuals_utm"), strict=True)
    to_utm = pyproj.Transformer.from_crs("EPSG:4979", pyproj.CRS("EPSG:32631").to_3d(), always_xy=True)
    for ground, utm in pairs:
        expected = to_utm.transform(*ground.GetGeometryRef().GetPoint())
        assert utm.GetGeometryRef().GetPoint() == pytest.approx(expected, abs=1e-4)


def test_orthoimage_names_image_rpc_and_terrain(scene: Path, tmp_path: Path) -> None:
    report = adjusted(scene, tmp_path / "out")
    for folder, rpc in ((scene, "as delivered"), (tmp_path / "out", f"refined by HRSI {VERSION} on {report['date']}")):
        output = tmp_path / f"ortho_{folder.name}"
        run("orthorectify", images=[str(folder / "image_1.tif")], dem=str(scene / "dem.tif"),
            height_datum="ellipsoidal", output_dir=str(output))  # fmt: skip
        told = own_metadata(output / "image_1_ortho.tif")
        assert told["HRSI_RPC"].startswith(rpc) and told["HRSI_TERRAIN"] == str(scene / "dem.tif")
        assert told["HRSI_SOURCE"] == "image_1.tif" and len(told["HRSI_RPC_SHA256"]) == 64


@pytest.mark.parametrize(("images", "complete"), [(6, True), (10_000, False)])
def test_the_tag_of_a_block_names_its_images_and_is_no_longer_than_a_page(images: int, complete: bool) -> None:
    """Two stereo triplets by name; of an archive a page of text (4 kB), for which programs have room in their lists."""
    report = {
        "images": [f"IMG_PHR1A_P_201312251{number:05d}_SEN_PRG_FC" for number in range(images)],
        **dict.fromkeys(("version", "date", "algorithm", "model"), ""),
        "verdict": {"level": "usable"}, "check": {"ce90_m": 1.0, "le90_m": 1.0},
    }  # fmt: skip
    tag = lineage_items(report, "report.json")["HRSI_BLOCK"]
    assert len(tag) < 4096 and all(name in tag for name in report["images"]) == complete


@pytest.mark.coverage
def test_stated_errors_hold_over_sixty_blocks() -> None:
    """ERR_BIAS is the root mean square of what all points of an image share, by the truth of simulated cameras.

    360 figures; the three images of a block share its GCPs, so they count as 120.

    Power (chi², 120 values, 0.8 to 1.2): 1.00 fails with 0.2 %, 1.40 with 98.7 %;
    Power (chi², 120 values, 0.8 to 1.2): 1.00 fails with 0.2 %, 0.70 with 98.6 %.
    """
    scaled, rest = [], []
    for seed in range(60):
        block, _, errors = blocks.block(gcps=5, checks=0, ties=12, seed=seed, drift=1e-4)
        result = adjust(block, AdjustOptions(model="affine", sigma_drift=1e-4))
        plain = [result.model.compute_refined_rpc(im, v) for im, v in zip(block.images, result.values, strict=True)]
        for image, new, error in zip(block.images, state_accuracy(result, plain), errors, strict=True):
            xy = image.grid_px(5, 5)
            ground = image.rpc.localize(xy, 200.0).ground
            true = image.rpc.project(ground) + error[:, 0] + (xy - 2000.0) @ error[:, 1:].T
            wrong = new.rpc.project(ground) - true  # pixels of one metre, turned by the heading
            shared = wrong.mean(axis=0)
            scaled.append(shared / new.rpc.err_bias)
            rest.append((wrong - shared) / new.rpc.err_rand)
    scale, spread = (float(np.sqrt(np.mean(np.square(np.concatenate(rows))))) for rows in (scaled, rest))
    assert 0.8 < scale < 1.2 and 0.8 < spread < 1.2
