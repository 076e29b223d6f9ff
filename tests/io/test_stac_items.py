"""STAC items as images: which asset is the image, where its RPC is, what it tells of the sun; errors name the item."""

import json
import pickle
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from rpc_samples import sample_rpc, write_image

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.catalogue.deliveries import resolve_images
from hrsi.hrsi_engine.io.catalogue.stac_items import href_of, href_path
from hrsi.hrsi_engine.io.rasters.images import open_image, open_image_and_source
from hrsi.hrsi_engine.io.rasters.sun_angles import read_sun, read_time
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text
from hrsi.hrsi_engine.io.rpc_files.fields import STAC_NAMES, json_members, numbers_of

GEOTIFF = "image/tiff; application=geotiff; profile=cloud-optimized"
SUN = {"view:sun_azimuth": 151.25, "view:sun_elevation": 48.5}


def item(name: str = "scene", assets: dict[str, Any] | None = None, **properties: Any) -> dict[str, Any]:
    """Return an item; by default with an image that holds its RPC, ``a/image.tif``."""
    return {
        "type": "Feature", "stac_version": "1.0.0", "id": name, "geometry": None, "links": [],
        "properties": {"datetime": "2021-06-03T10:20:30Z", "platform": "worldview-3", **properties},
        "assets": {"visual": {"href": "./a/image.tif", "type": GEOTIFF, "roles": ["data"]}}
        if assets is None else assets,
    }  # fmt: skip


def collection(*items: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": list(items), **more}


def saved(folder: Path, document: Any, name: str = "items.json") -> str:
    (folder / name).write_text(json.dumps(document), encoding="utf-8")
    return str(folder / name)


def images(name: str) -> tuple[str, ...]:
    return resolve_images([name], lambda _text: None)


def same(first: RPC, second: RPC) -> bool:
    return numbers_of(first) == numbers_of(second)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with images of the same name, one with an RPC and one without, and an RPC apart from them."""
    for name, rpc in (("a", sample_rpc(1)), ("b", None)):
        (tmp_path / name).mkdir()
        write_image(tmp_path / name / "image.tif", rpc)
    (tmp_path / "meta").mkdir()
    write_rpc_text(str(tmp_path / "meta" / "camera_RPC.TXT"), sample_rpc(2))
    return tmp_path


def test_an_image_with_its_rpc_has_the_items_name(folder: Path):
    found = open_image(images(saved(folder, item()))[0])
    assert found.id == "scene"
    assert found.sensor == "worldview-3"
    assert found.path == str(folder / "a" / "image.tif")
    assert same(found.rpc, sample_rpc(1))
    assert found.pixels.read(0, 0, 4, 4)[1].all()


def test_items_of_a_page_and_files_beside_them(folder: Path):
    """Images of the same name are told apart by the items; a page of several says so."""
    page = collection(item("first"), item("second"), links=[{"rel": "next", "href": "https://example.com/2"}])
    told: list[str] = []
    listed = resolve_images([saved(folder, page), str(folder / "a" / "image.tif")], told.append)
    assert [open_image(name).id for name in listed] == ["first", "second", "image"]
    assert any("one page of several" in text for text in told)


def test_lists_name_items(folder: Path):
    saved(folder, collection(item("first"), item("second")))
    (folder / "all.txt").write_text("items.json\n")
    assert [open_image(name).id for name in images(f"@{folder / 'all.txt'}")] == ["first", "second"]


def with_rpc(**rpc: Any) -> dict[str, Any]:
    return {
        "thumb": {"href": "./t.png", "type": "image/png", "roles": ["thumbnail"]},
        "pan": {"href": "./b/image.tif", "type": GEOTIFF, "roles": ["data"], **rpc.pop("of_image", {})},
        **rpc,
    }


@pytest.mark.parametrize(
    "asset",
    [
        {"pan_rpc": {"href": "./meta/camera_RPC.TXT", "type": "text/plain"}},
        {"camera": {"href": "./meta/camera_RPC.TXT", "roles": ["metadata"]}},
        {"x": {"href": "./no.xml", "roles": ["thumbnail"]}, "y": {"href": "./meta/camera_RPC.TXT", "roles": ["rpc"]}},
    ],
)
def test_an_asset_that_is_an_rpc_file(folder: Path, asset: dict[str, Any]):
    image, source = open_image_and_source(images(saved(folder, item(assets=with_rpc(**asset))))[0])
    assert same(image.rpc, sample_rpc(2))
    assert "camera_RPC.TXT" in source.source


def test_metadata_that_is_no_rpc_is_passed_over(folder: Path):
    (folder / "meta" / "about.xml").write_text("<about/>")
    about = {"about": {"href": "./meta/about.xml", "roles": ["metadata"]}}
    document = item(assets=with_rpc(**about, camera={"href": "./meta/camera_RPC.TXT", "roles": ["metadata"]}))
    assert same(open_image(images(saved(folder, document))[0]).rpc, sample_rpc(2))


def test_fields_count_before_files_those_of_the_asset_before_those_of_the_item(folder: Path):
    of_item, of_asset = (json_members(sample_rpc(seed, err_bias=2.0), STAC_NAMES) for seed in (3, 4))
    files = {"camera_rpc": {"href": "./meta/camera_RPC.TXT"}}
    found = [
        open_image_and_source(images(saved(folder, item(assets=with_rpc(of_image=own, **files), **of_item)))[0])
        for own in ({}, of_asset)
    ]
    for (image, _source), seed in zip(found, (3, 4), strict=True):
        assert same(image.rpc, sample_rpc(seed, err_bias=2.0))
    assert found[0][1].source == "rpc: fields of the STAC item scene"


def test_an_item_without_pixels_is_an_rpc_alone(folder: Path):
    found = open_image(images(saved(folder, item(assets={"rpc": {"href": "meta/camera_RPC.TXT"}})))[0])
    assert (found.id, found.raster) == ("scene", None)


def test_one_of_several_images_is_named_as_gdal_names_it(folder: Path):
    several = {key: {"href": f"./{key}/image.tif", "type": GEOTIFF, "roles": ["data"]} for key in ("a", "b")}
    name = saved(folder, item(assets=several))
    with pytest.raises(InputError, match=r"item 'scene': has several images \(a, b\): name one, as STACIT"):
        images(name)
    for named in (f'STACIT:"{name}":asset=a', f"STACIT:{name}:asset=a"):
        assert open_image(images(named)[0]).path == str(folder / "a" / "image.tif")
    with pytest.raises(InputError, match="has no asset 'c'"):
        images(f'STACIT:"{name}":asset=c')


def test_sun_and_time_of_an_item(folder: Path):
    path = images(saved(folder, item(**SUN)))[0]
    sun = read_sun(path, sample_rpc())
    assert sun is not None and sun.angles == (151.25, 48.5)
    assert "item scene" in sun.source
    time = read_time(images(saved(folder, item()))[0])
    assert time is not None and f"{time:%Y-%m-%d %H:%M:%S}" == "2021-06-03 10:20:30"


def test_an_items_image_travels_to_other_processes(folder: Path):
    image = pickle.loads(pickle.dumps(open_image(images(saved(folder, item(**SUN)))[0])))
    assert image.pixels.read(0, 0, 2, 2)[1].all()
    assert read_sun(image.path, image.rpc).angles == (151.25, 48.5)


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (collection(), "item collection without items"),
        (collection({"type": "Feature", "id": "x", "properties": {}}), "feature 1 has no assets"),
        (item(assets={"m": {"href": "a.png", "roles": ["thumbnail"]}}), "no asset that is an image"),
        (item(assets={"m": {"type": GEOTIFF}}), "item 'scene', asset 'm': has no href"),
        (item("a/b"), "item 'a/b': the id cannot be used"),
        (item(assets={"m": {"href": "ftp://h/a.tif"}}), "begin with ftp"),
        ({"type": "Catalog", "stac_version": "1.0.0", "links": []}, "refers to items elsewhere"),
    ],
)  # fmt: skip
def test_errors_name_file_and_item(folder: Path, document: dict[str, Any], message: str):
    with pytest.raises(InputError, match=message) as error:
        images(saved(folder, document))
    assert "items.json" in str(error.value) or "ftp" in message


def test_a_wrong_rpc_field_is_named(folder: Path):
    fields = json_members(sample_rpc(), STAC_NAMES)
    name = saved(folder, item(**{**fields, "rpc:samp_num_coeff": [1.0, 2.0]}))
    with pytest.raises(InputError, match="item 'scene': rpc:samp_num_coeff has 2 coefficients"):
        open_image(images(name)[0])
    name = saved(folder, item(**{**fields, "rpc:lat_off": "north"}))
    with pytest.raises(InputError, match=r"rpc:lat_off is 'north'"):
        open_image(images(name)[0])


def test_json_that_holds_an_rpc_is_no_item(folder: Path):
    (folder / "other.json").write_text('{"rpc": {}}')
    assert images(str(folder / "other.json")) == (str(folder / "other.json"),)


@pytest.mark.parametrize(
    ("href", "base", "path"),
    [
        ("https://h/a.tif?sig=1", "/d/items.json", "/vsicurl/https://h/a.tif?sig=1"),
        ("s3://bucket/x/a.tif", "/d/items.json", "/vsis3/bucket/x/a.tif"),
        ("gs://bucket/a.tif", "/d/items.json", "/vsigs/bucket/a.tif"),
        ("../a.tif", "/d/e/items.json", "/d/a.tif"),
        ("./a.tif", "https://h/c/item.json", "/vsicurl/https://h/c/a.tif"),
        ("../a.tif", "s3://bucket/c/item.json", "/vsis3/bucket/a.tif"),
        ("a.tif", "/vsis3/bucket/c/items.json", "/vsis3/bucket/c/a.tif"),
        ("./a.tif", "/vsicurl/https://h/c/item.json", "/vsicurl/https://h/c/a.tif"),
        ("file:///d/my%20image.tif", "", "/d/my image.tif"),
        ("/vsizip/a.zip/a.tif", "", "/vsizip/a.zip/a.tif"),
    ],
)
def test_addresses(href: str, base: str, path: str):
    assert href_path(href, base) == path


@pytest.mark.parametrize("path", ["/vsicurl/https://h/a.tif", "/vsis3/b/a.tif", "/d/out/a.tif", "/d/in/a.tif"])
def test_addresses_lead_back(path: str):
    assert href_path(href_of(path, "/d/out"), "/d/out/item.json") == path


@pytest.fixture
def server(folder: Path) -> Iterator[str]:
    """The folder on a server of this machine."""
    handler = partial(SimpleHTTPRequestHandler, directory=str(folder))
    handler.log_message = lambda *_words: None  # type: ignore[attr-defined]
    serving = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    Thread(target=serving.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{serving.server_port}"
    serving.shutdown()


def test_items_and_images_on_a_server(folder: Path, server: str):
    """The page lies here and names files there; or lies there itself, with relative addresses."""
    asset = {"pan": {"href": f"{server}/b/image.tif", "type": GEOTIFF, "roles": ["data"]},
             "pan_rpc": {"href": f"{server}/meta/camera_RPC.TXT"}}  # fmt: skip
    found = open_image(images(saved(folder, item(assets=asset)))[0])
    assert found.path == f"/vsicurl/{server}/b/image.tif"
    assert same(found.rpc, sample_rpc(2))
    saved(folder, item(), "there.json")
    there = open_image(images(f"/vsicurl/{server}/there.json")[0])
    assert there.path == f"/vsicurl/{server}/a/image.tif"
    assert np.array_equal(
        there.pixels.read(0, 0, 9, 9)[0], open_image(str(folder / "a/image.tif")).pixels.read(0, 0, 9, 9)[0]
    )


def test_a_crop_has_the_moved_rpc_of_its_asset(folder: Path):
    """An RPC of a whole scene is moved to a crop as one that lies beside it is."""
    rpc = replace(sample_rpc(5), line_scale=3000.0, samp_scale=4000.0, line_off=3000.0, samp_off=4000.0)
    write_image(folder / "crop.tif", None, geotransform=(1000.0, 1.0, 0.0, 500.0, 0.0, 1.0))
    write_rpc_text(str(folder / "meta" / "scene_RPC.TXT"), rpc)
    asset = {"crop": {"href": "crop.tif", "type": GEOTIFF}, "crop_rpc": {"href": "meta/scene_RPC.TXT"}}
    found = open_image(images(saved(folder, item(assets=asset)))[0])
    assert (found.rpc.samp_off, found.rpc.line_off) == (3000.0, 2500.0)
