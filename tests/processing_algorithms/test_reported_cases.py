"""Cases that people reported of other programs: cut images, points without heights, files in other forms.

The right values are those of `../shared/data/cases/*/expected.md`; the scene is simulated, so that positions are known.
"""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal
from pyproj import CRS, Transformer
from rpc_samples import write_image

from hrsi.hrsi_engine.foundation.errors import InputError, SolveError
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.processing_algorithms import run

CENTRE = np.array([[5.45006, 43.53009, 250.0]])


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a simulated image of 300 x 300 px with GCPs and a DEM."""
    folder = tmp_path_factory.mktemp("scene")
    run("simulate", images=1, along="10", size=300, gcps=6, checks=6, ties=0, relief=60.0, output_dir=str(folder))
    return folder


def write_points(scene: Path, path: Path) -> None:
    """Write the GCPs as the QGIS Georeferencer does, without heights."""
    ground = np.genfromtxt(scene / "ground_points.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    measured = np.genfromtxt(scene / "image_points.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    places = {row["id"]: (row["lon"], row["lat"]) for row in ground if row["role"] == "gcp"}
    rows = [f"{places[m['id']][0]},{places[m['id']][1]},{m['sample'] + 0.5},{-m['line'] - 0.5},1,0,0,0"
            for m in measured if m["id"] in places]  # fmt: skip
    path.write_text("\n".join(["#CRS: EPSG:4326", "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual", *rows]))


def test_points_without_heights_on_one_image(scene: Path, tmp_path: Path) -> None:
    """Without a DEM the message names the option that refine-rpc has; with it the check points agree to 0.5 px."""
    points = tmp_path / "image_1.tif.points"
    write_points(scene, points)
    given = {"images": [str(scene / "image_1.tif")], "gcps": str(points), "output_dir": str(tmp_path / "out")}
    with pytest.raises(InputError, match="name a DEM with `dem`"):
        run("refine-rpc", **given)
    run("refine-rpc", dem=str(scene / "dem.tif"), **given)
    refined = read_rpc(str(tmp_path / "out" / "image_1.tif")).rpc
    truth = read_points(str(scene / "ground_points.csv"), height_datum="ellipsoidal").ground
    measured = read_points(str(scene / "image_points.csv"), image_ids=["image_1"]).image
    assert truth is not None and measured is not None
    row = [truth.ids.tolist().index(name) for name in measured.ids.tolist()]
    errors = refined.project(truth.ground[row]) - measured.xy
    is_check = np.char.startswith(measured.ids, "C")
    assert is_check.sum() >= 4
    assert np.sqrt(np.mean(errors[is_check] ** 2, axis=0)).max() < 0.7  # 0.39, 0.26 px there; 4.4, 14.6 px before


def test_no_match_is_no_wrong_input(scene: Path, tmp_path: Path) -> None:
    """A flipped image: the search says what it tried and which causes are likely, and is not solvable (exit code 1).

    Points that were measured before it was flipped orient it all the same: the verdict has the cause.
    """
    block = tmp_path / "block"
    run("simulate", images=2, along="-10,10", size=300, gcps=4, checks=0, ties=0, relief=60.0, output_dir=str(block))
    source = gdal.Open(str(block / "image_1.tif"))
    flipped = gdal.GetDriverByName("GTiff").CreateCopy(str(tmp_path / "flipped.tif"), source)
    flipped.WriteArray(np.ascontiguousarray(source.ReadAsArray()[::-1]))
    del flipped
    images = [str(tmp_path / "flipped.tif"), str(block / "image_2.tif")]
    with pytest.raises(SolveError, match=r"no match in 1 pair.*flipped.*mirror"):
        run("triangulate", images=images, output_dir=str(tmp_path / "out"))
    (tmp_path / "flipped.tif").rename(tmp_path / "image_1.tif")
    images[0] = str(tmp_path / "image_1.tif")
    points = {"gcps": str(block / "ground_points.csv"), "image_points": str(block / "image_points.csv")}
    report = run("triangulate", images=images, **points, height_datum="ellipsoidal", output_dir=str(tmp_path / "out"))
    (reason,) = report["verdict"]["reasons"]
    assert reason["code"] == "few-ties" and "mirror" in reason["message"]


def test_rpc_and_points_in_other_forms(scene: Path, tmp_path: Path, case_data: Path, real_data: Path) -> None:
    """Orthority's YAML (9 digits), text of gdalinfo (17 digits), and ENVI's points, whose first pixel is (1, 1)."""
    tag = read_rpc(str(real_data / "qb2_gcp" / "qb2_basic1b.tif")).rpc
    found = read_rpc(str(case_data / "09" / "rpc_param.yaml"))
    assert found.size == (850, 1450)
    place = np.array([[tag.long_off, tag.lat_off, tag.height_off]])
    np.testing.assert_allclose(found.rpc.project(place), tag.project(place), atol=1e-3)
    text = gdal.Info(str(scene / "image_1.tif"))
    (tmp_path / "info_RPC.txt").write_text(text[text.index("RPC Metadata") :])
    expected = read_rpc(str(scene / "image_1.tif")).rpc.project(CENTRE)
    np.testing.assert_allclose(read_rpc(str(tmp_path / "info_RPC.txt")).rpc.project(CENTRE), expected, atol=1e-6)
    (tmp_path / "info.json").write_text(json.dumps(gdal.Info(str(scene / "image_1.tif"), format="json")))
    described = read_rpc(str(tmp_path / "info.json"))
    np.testing.assert_allclose(described.rpc.project(CENTRE), expected, atol=1e-6)
    assert described.size == (300, 300)
    flow = (case_data / "09" / "rpc_param.yaml").read_text()  # lists with one number a line, as other writers of YAML
    block = re.sub(r": \[([^\]]*)\]", lambda m: ":" + "".join(f"\n    - {n.strip()}" for n in m[1].split(",")), flow)
    (tmp_path / "block.yaml").write_text(block)
    assert block.count("- ") > 80 and read_rpc(str(tmp_path / "block.yaml")).rpc == found.rpc
    points = read_points(f"{case_data}/09/envi.pts", image_ids=["envi"], height_datum="ellipsoidal")
    assert points.image is not None and points.ground is not None
    np.testing.assert_allclose(points.image.xy[0], [413.2175, 418.8003])
    np.testing.assert_allclose(points.ground.ground[0], [5.45008456, 43.52985789, 255.8369])


@pytest.mark.parametrize(("projection", "epsg"), [
    ("projection info = {UTM, 31, North, WGS-84, units=Meters}", 32631),
    ("projection info = {UTM, 31, South, WGS-84, units=Meters}", 32731),
    (f"projection info = {{RGF93}}\n; coordinate system string = {{{CRS.from_epsg(2154).to_wkt('WKT1_ESRI')}}}", 2154),
])  # fmt: skip
def test_the_projection_of_envi_points(tmp_path: Path, projection: str, epsg: int) -> None:
    """Map coordinates without heights ("Image to Map"), in the projection of the header."""
    lonlat = np.array([[5.4501, 43.5298], [5.4474, 43.5327]])
    xy = np.column_stack(Transformer.from_crs(4326, epsg, always_xy=True).transform(*lonlat.T))
    rows = [f"  {x:.4f}  {y:.4f}  414.25  419.5" for x, y in xy.tolist()]
    header = ["; ENVI Image to Map GCP File", f"; {projection}", "; Map (x,y), Image (x,y)", ";"]
    (tmp_path / "a.pts").write_text("\n".join([*header, *rows]))
    points = read_points(str(tmp_path / "a.pts"), image_ids=["a"], surface=lambda lonlat: np.full(len(lonlat), 250.0))
    assert points.image is not None and points.ground is not None
    np.testing.assert_allclose(points.image.xy[0], [413.25, 418.5])
    np.testing.assert_allclose(points.ground.ground[:, :2], lonlat, atol=1e-8)


@pytest.mark.parametrize("beside", [False, True])
def test_alos_without_its_header_file(tmp_path: Path, case_data: Path, beside: bool) -> None:
    """Own parser of the record (JAXA) and NumPy: sample 2941.29954, line 3229.84623 for 32.0 E 55.9 N 1000 m."""
    path = tmp_path / "RPC-md_alos.txt"
    shutil.copy(case_data / "08" / path.name, path)
    if beside:
        path = tmp_path / "IMG-md_alos.tif"
        write_image(path, None)
    found = read_rpc(str(path)).rpc.project(np.array([[32.0, 55.9, 1000.0]]))
    np.testing.assert_allclose(found, [[2941.29954, 3229.84623]], atol=1e-5)


def test_a_clip_of_a_map_product(scene: Path, tmp_path: Path) -> None:
    """The RPC of the product copied beside a clip that begins at sample 140, line 120: told in pixels and metres."""
    source, height = gdal.Open(str(scene / "image_1.tif")), 250.0
    options = [f"RPC_HEIGHT={height}"]
    product = gdal.Warp(str(tmp_path / "or2a.tif"), source, rpc=True, transformerOptions=options, errorThreshold=0,
                        dstSRS="EPSG:32631", xRes=0.7, yRes=0.7)  # fmt: skip
    to_map = gdal.Transformer(source, product, [*options, "METHOD=RPC", "RPC_PIXEL_ERROR_THRESHOLD=1e-6"])
    rpc = read_rpc(str(scene / "image_1.tif")).rpc
    lon, lat, heights = (axis.ravel() for axis in np.meshgrid(
        CENTRE[0, 0] + np.linspace(-0.0014, 0.0014, 12), CENTRE[0, 1] + np.linspace(-0.001, 0.001, 12),
        np.linspace(170.0, 330.0, 5),
    ))  # fmt: skip
    pixels = rpc.project(np.column_stack([lon, lat, heights]))
    placed = np.array([to_map.TransformPoint(0, x + 0.5, y + 0.5)[1][:2] for x, y in pixels.tolist()]) - 0.5
    rows = np.column_stack([lon, lat, heights, placed])
    header = {"header": "lon,lat,height,sample,line", "comments": "", "fmt": "%.12f", "delimiter": ","}
    np.savetxt(tmp_path / "grid.csv", rows, **header)
    run("fit-rpc", points=str(tmp_path / "grid.csv"), height_datum="ellipsoidal", id="or2a", output_dir=str(tmp_path))
    west, _, _, north, _, _ = product.GetGeoTransform()
    del product
    bounds = [west + 98.0, north - 189.0, west + 217.0, north - 84.0]
    gdal.Warp(str(tmp_path / "clip.tif"), str(tmp_path / "or2a.tif"), outputBounds=bounds, xRes=0.7, yRes=0.7)
    shutil.copy(tmp_path / "or2a_RPC.TXT", tmp_path / "clip_RPC.TXT")
    for name, is_told in (("or2a", False), ("clip", True)):
        warnings = run("rpc-info", images=[str(tmp_path / f"{name}.tif")], height=height)["warnings"]
        assert any("place the same pixels" in text and " m) apart" in text for text in warnings) is is_told, warnings
