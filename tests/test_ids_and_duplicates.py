"""Ids are compared as text, look-alikes are told; the same point twice is told by metres on the ground."""

import ast
import json
import math
from pathlib import Path

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st
from parsed_sources import walk_sources
from simulated_blocks import images as simulated_images

from hrsi.hrsi_engine.block.assembly import assemble, find_similar_ids, normalise_spellings
from hrsi.hrsi_engine.block.block import Block, Image
from hrsi.hrsi_engine.block.points import GroundPoints, ImagePoints, are_apart
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.json_values import json_text
from hrsi.hrsi_engine.ground.geodesy import distances_m
from hrsi.hrsi_engine.io.point_files import read_points

ANY_RPC = simulated_images(1)[0].rpc


@pytest.mark.parametrize(
    "alike",
    [
        ["7", "007", " 7", "7 ", "7.0", "７"],
        ["GCP-7", "gcp-7", "GCP 7", "GCP_07", "GCP\u20137", "GCP\u22127", "GCP\u00a07", "GCP7", "G\u200bCP-7"],
        ["Straße 3", "STRASSE-3"],
        ["tower", "Tower ", "\ufefftower"],
    ],
)
def test_what_people_take_for_the_same_has_one_spelling(alike: list[str]):
    assert len(set(normalise_spellings(alike))) == 1


@pytest.mark.parametrize(
    "different",
    [["1-12", "11-2", "112"], ["1.5", "1.05", "15"], ["7", "70", "17"], ["A1", "B1"], ["100", "1"], ["0", ""]],
)
def test_other_points_keep_other_spellings(different: list[str]):
    assert len(set(normalise_spellings(different))) == len(different)


@given(ids=st.lists(st.text(max_size=6), max_size=6))
def test_spellings_do_not_depend_on_the_neighbours(ids: list[str]):
    """All ids are spelt in one text; each comes out as it does alone."""
    assert normalise_spellings(ids) == [normalise_spellings([name])[0] for name in ids]
    assert all(name in find_similar_ids([name], ids)[name] for name in ids)


NAMES = st.text("Gg017-_. \u00c4\u00e4\u2013\u00a0\u2167", min_size=1, max_size=5)


@given(st.lists(NAMES, max_size=20), st.lists(NAMES, max_size=20))
def test_who_resembles_whom_follows_from_the_spellings(strangers, known):
    spelt = {name: normalise_spellings([name])[0] for name in [*strangers, *known]}
    expected = {name: [other for other in known if spelt[other] == spelt[name]] for name in strangers}
    assert find_similar_ids(strangers, known) == {name: others for name, others in expected.items() if others}


def block_of(ground_ids: list[str], measured: dict[str, list[str]], **chosen: list[str]) -> Block:
    """Return a block whose ground points have these ids; ``measured`` are the ids on each image."""
    images = [Image(name, ANY_RPC, (1000, 1000)) for name in measured]
    known = GroundPoints(ground_ids, np.column_stack([np.linspace(0.0, 0.01, len(ground_ids))] * 3))
    rows = [(name, image) for image, names in measured.items() for name in names]
    ids, image_ids = map(list, zip(*rows, strict=True))
    return assemble(images, [known], [ImagePoints(ids, image_ids, np.zeros((len(rows), 2)))], **chosen)


def test_near_misses_are_named():
    """`7` without a ground point while `007` has one; not where both were measured on one image, nor for equal ids."""
    block = block_of(["007", "A 1", "B2"], {"left": ["7", "A1", "B2", "T5"], "right": ["7", "B2", "b2"]})
    (warning,) = [text for text in block.warnings if "compared as text" in text]
    assert "'7' ('007' has one)" in warning and "'A1' ('A 1' has one)" in warning
    assert "b2" not in warning and "T5" not in warning
    assert {str(name) for name in block.points.ids} == {"7", "A1", "B2", "b2", "T5"}  # told, never taken for the same


def test_a_chosen_id_that_is_not_there_has_its_look_alike_named():
    with pytest.raises(InputError, match=r"names 7, not among .*correct the ids; there is '007'$"):
        block_of(["007"], {"left": ["007"]}, gcp_ids=["7"])


def merged(first: tuple[float, float, float], second: tuple[float, float, float]) -> GroundPoints:
    tables = [GroundPoints(["P"], np.array([position])) for position in (first, second)]
    row = ImagePoints(["P"], ["left"], np.zeros((1, 2)))
    return assemble([Image("left", ANY_RPC, (9, 9))], tables, [row]).points


#: Places where degrees times a constant tell nothing of metres.
PLACES = [(12.0, 0.0), (12.0, 60.0), (12.0, -85.0), (180.0, 10.0), (-180.0, -66.0), (180.0, 89.0), (45.0, 89.99999)]


@pytest.mark.parametrize(("lon", "lat"), PLACES)
@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 217.0, 270.0])
def test_two_positions_are_one_point_by_metres(lon: float, lat: float, azimuth_deg: float):
    """2 cm apart: the same; 30 cm apart: an error, wherever on the earth; PROJ's geodesics say where that is."""
    geod = pyproj.Geod(ellps="WGS84")
    near, far = (geod.fwd(lon, lat, azimuth_deg, metres)[:2] for metres in (0.02, 0.3))
    assert len(merged((lon, lat, 50.0), (*near, 50.0))) == 1
    with pytest.raises(InputError, match="different positions"):
        merged((lon, lat, 50.0), (*far, 50.0))
    with pytest.raises(InputError, match="different positions"):
        merged((lon, lat, 50.0), (lon, lat, 50.3))


def test_heights_that_are_not_known_do_not_differ():
    known, unknown = np.array([[179.9999999, 10.0, 50.0]]), np.array([[-180.0000001, 10.0, np.nan]])
    assert not are_apart(known, unknown).any()
    assert are_apart(known, unknown + [0.0, 1e-5, 0.0]).all()


def test_positions_in_a_table_of_measurements_are_told_by_metres(tmp_path: Path):
    """The same point with each of its measurements, on both sides of the date line and a metre beside."""
    table = "id,image,sample,line,lon,lat,height\nA,i,1,2,{lon},44,1\nA,j,1,2,-179.9999999,44,1\n"
    path = tmp_path / "points.csv"
    path.write_text(table.format(lon=179.9999999))
    assert len(read_points(str(path), height_datum="ellipsoidal").ground) == 1
    path.write_text(table.format(lon=179.99998))
    with pytest.raises(InputError, match="with another position"):
        read_points(str(path), height_datum="ellipsoidal")


@given(
    lon=st.floats(-180, 180), lat=st.floats(-90, 90), azimuth_deg=st.floats(0, 360), metres=st.floats(0.0, 100.0)
)  # fmt: skip
def test_distances_are_the_geodesics(lon: float, lat: float, azimuth_deg: float, metres: float):
    there = pyproj.Geod(ellps="WGS84").fwd(lon, lat, azimuth_deg, metres)[:2]
    distance = distances_m(np.array([[lon, lat, 0.0]]), np.array([[*there, 0.0]]))[0]
    assert distance == pytest.approx(metres, abs=1e-6)  # chord and arc of 100 m differ by 1e-9 m; ECEF rounds at 1e-9


@given(value=st.recursive(st.floats() | st.integers() | st.text() | st.none(), st.lists, max_leaves=8))
def test_json_texts_have_no_nan(value: object):
    """What is no number becomes null, all else comes back as it was."""
    back = json.loads(json_text({"value": value, "array": np.array([1.0, math.nan])}), parse_constant=pytest.fail)
    assert back["array"] == [1.0, None]


def test_json_is_written_in_one_place(repository: Path):
    """No other module makes JSON texts: so no NaN can get into any."""
    makers = [
        f"{path.relative_to(repository)}:{node.lineno}"
        for path, node in walk_sources(["dump", "JSONEncoder"])
        if isinstance(node, ast.Attribute)
        and node.attr in ("dump", "dumps", "JSONEncoder")
        and not (isinstance(node.value, ast.Name) and node.value.id == "pickle")
    ]
    assert [maker.partition(":")[0] for maker in makers] == ["hrsi_engine/foundation/json_values.py"]
