"""`stac`: items of the refined images are valid STAC, tell the truth about them, and lead back to the same block."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rpc_samples import write_image

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.catalogue.stac_items import images_of_items
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.hrsi_engine.io.rpc_files.fields import numbers_of
from hrsi.hrsi_engine.results.stac import STAC_EXTENSIONS
from hrsi.processing_algorithms import run

IMAGES = ("hobart_ikonos_1", "hobart_ikonos_2", "hobart_ikonos_3")
#: Fields that the extensions' schemas allow with their prefix (additionalProperties: false), of those that are written.
ALLOWED = {
    "view": {"incidence_angle": (0, 90), "azimuth": (0, 360), "sun_azimuth": (0, 360), "sun_elevation": (-90, 90)},
    "accuracy": {"geometric_x_stddev": (0, 1e3), "geometric_y_stddev": (0, 1e3), "geometric_rmse": (0, 1e3)},
    "processing": {"lineage": str, "software": dict},
}


@pytest.fixture(scope="module")
def options(repository: Path) -> dict[str, Any]:
    data = repository / "examples" / "hobart"
    return {
        "gcps": str(data / "hobart_ground_points.csv"), "image_points": str(data / "hobart_image_points.csv"),
        "gcp_ids": "H003,H022,H024,H035,H048,H058",
    }  # fmt: skip


@pytest.fixture(scope="module")
def sources(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An item collection of the Hobart images: small pixels, and RPCs as assets in another folder."""
    folder = tmp_path_factory.mktemp("sources")
    (folder / "pixels").mkdir()
    data, items = repository / "examples" / "hobart", []
    for number, name in enumerate(IMAGES):
        write_image(folder / "pixels" / f"{number}.tif", None, size=(40, 30))
        items.append({
            "type": "Feature", "stac_version": "1.0.0", "id": name, "geometry": None, "links": [],
            "properties": {"datetime": f"2003-02-22T00:0{number}:00Z", "platform": "ikonos-2", "view:sun_azimuth": 61.5,
                           "view:sun_elevation": 46.0},
            "assets": {"pan": {"href": f"./pixels/{number}.tif", "type": "image/tiff", "roles": ["data"]},
                       "pan_rpc": {"href": str(data / f"{name}_RPC.TXT")}},
        })  # fmt: skip
    (folder / "items.json").write_text(json.dumps({"type": "FeatureCollection", "features": items}))
    return folder


@pytest.fixture(scope="module")
def refined(sources: Path, options: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("refined") / "out"
    report = run("adjust", images=[str(sources / "items.json")], output_dir=str(folder), stac=True, **options)
    assert list(report["images"]) == list(IMAGES)
    assert report["outputs"]["stac"] == str(folder / "stac.json")
    return folder


def read(folder: Path, name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / name).read_text(encoding="utf-8"))
    return found


def test_items_are_valid(refined: Path):
    """By the schemas of STAC 1.1 that pystac brings; extensions' by what theirs allow."""
    pystac = pytest.importorskip("pystac")
    validation = pytest.importorskip("pystac.validation.stac_validator")
    collection = pystac.ItemCollection.from_file(str(refined / "stac.json"))
    assert [item.id for item in collection] == list(IMAGES)
    for name in IMAGES:
        document = read(refined, f"{name}_stac.json")
        assert document in read(refined, "stac.json")["features"]
        validation.JsonSchemaSTACValidator().validate_core(document, pystac.STACObjectType.ITEM, "1.1.0")
        assert pystac.Item.from_dict(document).get_assets(role="data")["image"].href == f"./{name}.tif"
        for key, value in document["properties"].items():
            prefix, _, field = key.partition(":")
            if prefix in ALLOWED:
                limits = ALLOWED[prefix][field]
                assert isinstance(value, limits) if isinstance(limits, type) else limits[0] <= value <= limits[1]
        used = {key.partition(":")[0] for part in (document["properties"], *document["assets"].values())
                for key in part if ":" in key}  # fmt: skip
        assert used - {"rpc", "hrsi"} == set(STAC_EXTENSIONS)


def test_items_tell_what_is_so(refined: Path, sources: Path):
    """Beside the numbers, which `tests/oracle` compares."""
    report = read(refined, "report.json")
    for name in IMAGES:
        document, file = read(refined, f"{name}_stac.json"), refined / f"{name}.tif"
        told, asset = document["properties"], document["assets"]["image"]
        assert asset["file:checksum"] == "1220" + hashlib.sha256(file.read_bytes()).hexdigest()
        assert (asset["file:size"], asset["proj:shape"]) == (file.stat().st_size, [30, 40])
        assert told["datetime"] == f"2003-02-22T00:0{IMAGES.index(name)}:00Z"
        assert (told["platform"], told["view:sun_azimuth"]) == ("ikonos-2", 61.5)
        assert told["hrsi:verdict"] == report["verdict"]["level"]
        assert document["links"][0]["rel"] == "derived_from"
        assert (refined / document["links"][0]["href"]).resolve() == sources / "items.json"


def test_items_lead_back_to_the_refined_block(refined: Path):
    """The collection opens as the refined images, with all digits of their RPCs."""
    for path in images_of_items(str(refined / "stac.json"), print):
        assert numbers_of(open_image(path).rpc) == numbers_of(read_rpc(str(refined / f"{path.item.id}.tif")).rpc)


@pytest.mark.parametrize("write", ["sidecar", "vrt"])
def test_pixels_that_stay_where_they_are(write: str, sources: Path, options: dict[str, Any], tmp_path: Path):
    given = {"images": [str(sources / "items.json")], "output_dir": str(tmp_path / "out"), "write": write}
    run("adjust", stac=True, **given, **options)
    assets = read(tmp_path / "out", "stac.json")["features"][1]["assets"]
    if write == "vrt":
        assert assets["image"]["href"] == "./hobart_ikonos_2.vrt"
        return
    assert (tmp_path / "out" / assets["image"]["href"]).resolve() == sources / "pixels" / "1.tif"
    assert assets["rpc"] == assets["rpc"] | {"href": "./hobart_ikonos_2_RPC.TXT", "roles": ["metadata", "rpc"]}


def test_images_of_items_refined_in_place(sources: Path, options: dict[str, Any], tmp_path: Path):
    """The image takes the refined RPC, although its item names another; the new item has it too."""
    pixels = tmp_path / "pixels"
    shutil.copytree(sources / "pixels", pixels)
    (tmp_path / "items.json").write_text((sources / "items.json").read_text())
    items, out = str(tmp_path / "items.json"), tmp_path / "out"
    run("adjust", images=[items], output_dir=str(out), stac=True, write="in-place", **options)
    offsets = []
    for number, document in enumerate(read(out, "stac.json")["features"]):
        assert (out / document["assets"]["image"]["href"]).resolve() == pixels / f"{number}.tif"
        rpc, before = read_rpc(str(pixels / f"{number}.tif")).rpc, open_image(images_of_items(items, print)[number]).rpc
        assert rpc.samp_off == document["properties"]["rpc:samp_off"]
        offsets.append(rpc.samp_off - before.samp_off)
    assert np.abs(offsets)[[0, 2]].min() > 1.0  # the second image has no control


def test_rpcs_alone_of_unknown_time(repository: Path, options: dict[str, Any], tmp_path: Path):
    """RPC files without pixels have no image to name; what no file tells is a span of time, and a warning."""
    files = [str(repository / "examples" / "hobart" / f"{name}_RPC.TXT") for name in IMAGES]
    report = run("adjust", images=files, output_dir=str(tmp_path / "out"), stac=True, **options)
    assert any("the acquisition time of hobart_ikonos_1" in text for text in report["warnings"])
    document = read(tmp_path / "out", "hobart_ikonos_1_stac.json")
    assert set(document["assets"]) == {"rpc", "report"}
    assert document["properties"]["datetime"] is None and document["properties"]["end_datetime"] == report["date"]


def test_items_need_refined_images(repository: Path, options: dict[str, Any], tmp_path: Path):
    files = [str(repository / "examples" / "hobart" / f"{name}_RPC.TXT") for name in IMAGES]
    with pytest.raises(InputError, match="`stac` describes refined images"):
        run("adjust", images=files, output_dir=str(tmp_path / "out"), stac=True, write="none", **options)


def test_a_block_of_items_grows(sources: Path, options: dict[str, Any], tmp_path: Path):
    """An earlier block is opened again with what its items told: ids, and RPCs that stand beside no image."""
    items = read(sources, "items.json")["features"]
    for name, some in (("two.json", items[:2]), ("third.json", items[2:])):
        (sources / name).write_text(json.dumps({"type": "FeatureCollection", "features": some}))
    run("adjust", images=[str(sources / "two.json")], output_dir=str(tmp_path / "first"), write="sidecar", **options)
    grown = run("adjust", images=[str(sources / "third.json")], add_to=str(tmp_path / "first"),
                image_points=options["image_points"], output_dir=str(tmp_path / "second"), write="sidecar")  # fmt: skip
    assert set(grown["images"]) == set(IMAGES)
    (sources / "two.json").write_text(json.dumps({"type": "FeatureCollection", "features": items[:1]}))
    with pytest.raises(InputError, match="has no item 'hobart_ikonos_2' any more"):
        run("adjust", images=[str(sources / "third.json")], add_to=str(tmp_path / "first"),
            image_points=options["image_points"], output_dir=str(tmp_path / "third"))  # fmt: skip
