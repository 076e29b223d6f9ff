"""Point files: every format, CRS and height datum gives the same points; damaged ones a clear error.

Outside authorities: pyproj for coordinates, GDAL (``ogr2ogr``'s library) and rasterio for writing the files.
"""

import json
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
from gdal_files import write_layer
from osgeo import gdal, ogr
from rasterio.control import GroundControlPoint

from hrsi.hrsi_engine.block.points import UNSET, Role
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files import POINT_READERS, read_points

IDS = ["H001", "H002", "Ü-3", "a b"]
GROUND = np.array([
    [147.240401210, -42.814473760, 94.4649],
    [147.243218430, -42.809852060, 59.0294],
    [147.231733670, -42.815955450, 129.6879],
    [147.300000000, -42.900000000, 3.0000],
])  # fmt: skip
#: Positions must come back to 1e-9 degrees (0.1 mm) and 0.1 mm: every format keeps doubles or enough digits.
DEGREES, METRES = 1e-9, 1e-4


def crs_wkt(code: str) -> str:
    return pyproj.CRS.from_user_input(code).to_wkt()


def in_crs(code: str, ground: np.ndarray = GROUND) -> np.ndarray:
    """Return points in a CRS, by pyproj."""
    transformer = pyproj.Transformer.from_crs("EPSG:4979", code, always_xy=True)
    return np.column_stack(transformer.transform(*ground.T))


def write_text(path: Path, text: str, encoding: str = "utf-8") -> str:
    path.write_text(text, encoding=encoding)
    return str(path)


def assert_ground(found: np.ndarray, wanted: np.ndarray = GROUND) -> None:
    np.testing.assert_allclose(found[:, :2], wanted[:, :2], rtol=0.0, atol=DEGREES)
    np.testing.assert_allclose(found[:, 2], wanted[:, 2], rtol=0.0, atol=METRES)


CASES = [
    ("gpkg", "GPKG", "EPSG:4979"),
    ("gpkg", "GPKG", "EPSG:32755"),
    ("gpkg", "GPKG", "EPSG:28355"),
    ("shp", "ESRI Shapefile", "EPSG:4326"),
    ("shp", "ESRI Shapefile", "EPSG:32755"),
    ("geojson", "GeoJSON", "EPSG:4979"),
    ("geojson", "GeoJSON", "EPSG:28355"),
    ("kml", "KML", "EPSG:4326"),
]


@pytest.mark.parametrize(("extension", "driver", "code"), CASES)
def test_layers_in_any_crs_give_the_same_points(tmp_path: Path, extension: str, driver: str, code: str) -> None:
    fields = {"Name" if driver == "KML" else "ID": IDS}
    path = write_layer(tmp_path / f"p.{extension}", driver, code, in_crs(code), fields)
    tables = read_points(str(path), height_datum="ellipsoidal")
    assert tables.image is None
    assert tables.ground.ids.tolist() == IDS
    assert_ground(tables.ground.ground)
    assert (tables.ground.role == UNSET).all()
    assert np.isnan(tables.ground.sigma_m).all()
    assert tables.warnings == ()


def test_a_geojson_in_metres_has_no_crs(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "p.geojson", "GeoJSON", "EPSG:4326", in_crs("EPSG:32755"), {"id": IDS})
    assert_ground(read_points(str(path), ground_crs="EPSG:32755", height_datum="ellipsoidal").ground.ground)


def test_flags_of_check_points_and_of_points_in_use(tmp_path: Path) -> None:
    rows = ["A,1,yes", "B,0,yes", "C,1,no", "D,0,Yes"]
    path = tmp_path / "p.csv"
    path.write_text("\n".join(["id,check,use,lon,lat,height", *(f"{row},147,-42,30" for row in rows)]))
    ground = read_points(str(path), height_datum="ellipsoidal").ground
    assert ground.role.tolist() == [Role.CHECK, Role.GCP, Role.OFF, Role.GCP]
    path.write_text(path.read_text().replace("check,use", "check,enabled").replace("C,1", "C,maybe"))
    ground = read_points(str(path), height_datum="ellipsoidal").ground
    assert ground.role.tolist() == [UNSET, UNSET, Role.OFF, UNSET]


def test_height_field_of_a_2d_layer(tmp_path: Path) -> None:
    fields = {"id": IDS, "HEIGHT": GROUND[:, 2].tolist()}
    fields |= {"role": ["gcp", "Check", None, "tie"], "sigma_xy": [0.1, None, 2, 3]}
    path = write_layer(tmp_path / "p.gpkg", "GPKG", "EPSG:32755", in_crs("EPSG:32755"), fields, with_z=False)
    ground = read_points(f"{path}|layername=points", height_datum="ellipsoidal").ground
    assert_ground(ground.ground)
    assert ground.role.tolist() == [Role.GCP, Role.CHECK, UNSET, Role.TIE]
    np.testing.assert_array_equal(ground.sigma_m[:, 0], [0.1, np.nan, 2.0, 3.0])


def test_missing_heights_come_from_a_surface_or_are_an_error(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "p.gpkg", "GPKG", "EPSG:32755", in_crs("EPSG:32755"), {"id": IDS}, with_z=False)
    with pytest.raises(InputError, match=r"feature 1 \(id 'H001'\): has no height: add a field 'height'"):
        read_points(str(path))
    tables = read_points(str(path), surface=lambda lonlat: lonlat[:, 0] + lonlat[:, 1])
    assert_ground(tables.ground.ground, np.column_stack([GROUND[:, :2], GROUND[:, :2].sum(axis=1)]))
    assert "4 points have no height" in tables.warnings[0]


def test_geoid_heights_by_grid_file_and_by_compound_crs(tmp_path: Path, real_data: Path) -> None:
    """Oracle: the EGM96 grid read by GDAL as a raster and interpolated bilinearly here."""
    grid = real_data / "ventoux_phr_pair" / "dem" / "egm96_15.gtx"
    ground = np.array([[5.19, 44.21, 500.0], [147.3, -42.9, 20.0]])
    orthometric = np.column_stack([ground[:, :2], ground[:, 2] - bilinear(grid, ground[:, :2])])
    rows = [f"P{i},{x!r},{y!r},{h!r}" for i, (x, y, h) in enumerate(orthometric.tolist())]
    path = write_text(tmp_path / "p.csv", "id,lon,lat,height\n" + "\n".join(rows))
    found = read_points(path, height_datum=str(grid))
    assert_ground(found.ground.ground, ground)
    assert found.warnings == ()
    layer = write_layer(tmp_path / "c.gpkg", "GPKG", "EPSG:4326+5773", orthometric, {"id": ["P0", "P1"]})
    if pyproj.transformer.TransformerGroup("EPSG:4326+5773", "EPSG:4979").best_available:
        compound = read_points(str(layer))
        assert_ground(compound.ground.ground, ground)
        assert compound.warnings == ()
    plain = read_points(str(layer), height_datum="ellipsoidal").ground
    assert_ground(plain.ground, orthometric)


def bilinear(grid: Path, lonlat: np.ndarray) -> np.ndarray:
    dataset = gdal.Open(str(grid))
    values, (x0, dx, _, y0, _, dy) = dataset.ReadAsArray(), dataset.GetGeoTransform()
    column, row = (lonlat[:, 0] - x0) / dx - 0.5, (lonlat[:, 1] - y0) / dy - 0.5
    c, r = np.floor(column).astype(int), np.floor(row).astype(int)
    u, v = column - c, row - r
    top = values[r, c] * (1 - u) + values[r, c + 1] * u
    return top * (1 - v) + (values[r + 1, c] * (1 - u) + values[r + 1, c + 1] * u) * v


def test_missing_geoid_grid_is_an_error(tmp_path: Path) -> None:
    path = write_text(tmp_path / "p.csv", "id,lon,lat,height\nA,5,44,1\n")
    with pytest.raises(InputError, match="geoid grid"):
        read_points(path, height_datum=str(tmp_path / "none.gtx"))


def test_image_points_and_image_names(tmp_path: Path, thesis_data: Path) -> None:
    tables = read_points(str(thesis_data / "hobart_image_points.csv"), image_ids=["hobart_ikonos_1"])
    assert tables.ground is None
    assert len(tables.image) == 159
    assert tables.image.xy[0].tolist() == [3205.4660, 943.8452]
    assert tables.image.kind[0] == "center"
    names = ["img", "img.tif", "/data/img_RPC.TXT", r"C:\data\img.tif", "other.tif"]
    rows = [f"P{i},{name},{i}.5,2" for i, name in enumerate(names)]
    path = write_text(tmp_path / "i.csv", "id,Image,sample,line\n" + "\n".join(rows))
    image = read_points(path, image_ids=["img"]).image
    assert image.image_ids.tolist() == ["img"] * 4 + ["other.tif"]
    assert np.isnan(image.sigma_px).all()


def test_one_layer_holds_ground_and_image_points(tmp_path: Path) -> None:
    """Long format: a point on two images, one on none; rows of a point share its position."""
    xyz = in_crs("EPSG:32755")[[0, 0, 1, 2]]
    fields = {
        "id": ["A", "A", "B", "C"], "image": ["i1", "i2", "i1", None], "sample": [1.0, 2.0, 3.0, None],
        "line": [4.0, 5.0, 6.0, None], "sigma": [0.5, None, 1.0, None],
    }  # fmt: skip
    path = write_layer(tmp_path / "p.gpkg", "GPKG", "EPSG:32755", xyz, fields)
    tables = read_points(str(path), height_datum="ellipsoidal")
    assert tables.ground.ids.tolist() == ["A", "B", "C"]
    assert_ground(tables.ground.ground, GROUND[:3])
    assert tables.image.ids.tolist() == ["A", "A", "B"]
    assert tables.image.xy.tolist() == [[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]]
    np.testing.assert_array_equal(tables.image.sigma_px, [0.5, np.nan, 1.0])


def test_the_only_image_needs_no_name(tmp_path: Path) -> None:
    path = write_text(tmp_path / "p.csv", "id,lon,lat,height,sample,line\nA,5,44,1,10,20\n")
    image = read_points(path, image_ids=["img"]).image
    assert image.image_ids.tolist() == ["img"]
    with pytest.raises(InputError, match="no field 'image'"):
        read_points(path, image_ids=["a", "b"])


def test_orthority_gcps(real_data: Path) -> None:
    path = real_data / "qb2_gcp" / "gcps.geojson"
    features = json.loads(path.read_text())["features"]
    tables = read_points(str(path), image_ids=["qb2_basic1b"])
    assert tables.warnings == ()  # GeoJSON says that heights are ellipsoidal
    np.testing.assert_array_equal(tables.ground.ground, [f["geometry"]["coordinates"] for f in features])
    np.testing.assert_array_equal(tables.image.xy, [f["properties"]["ji"] for f in features])
    assert set(tables.image.image_ids) == {"qb2_basic1b"}


@pytest.mark.parametrize("name", ["img.tif.points", "img.tif.csv"])
def test_qgis_georeferencer_points(tmp_path: Path, name: str) -> None:
    """The centre of the first pixel is (0.5, -0.5) in QGIS."""
    en = in_crs("EPSG:32755")
    lines = [
        f"{x!r},{y!r},{10.5 + k},{-20.5 - k},{0 if k == 2 else 1},0,0,0" for k, (x, y, _) in enumerate(en.tolist())
    ]
    header = f"#CRS: {crs_wkt('EPSG:32755')}\nmapX,mapY,sourceX,sourceY,enable,dX,dY,residual\n"
    path = write_text(tmp_path / name, header + "\n".join(lines))
    tables = read_points(path, surface=lambda lonlat: np.full(len(lonlat), 7.0), image_ids=["img"])
    assert tables.ground.ids.tolist() == ["img-1", "img-2", "img-4"]
    np.testing.assert_allclose(tables.ground.ground[:, :2], GROUND[[0, 1, 3], :2], rtol=0.0, atol=DEGREES)
    assert tables.image.xy.tolist() == [[10.0, 20.0], [11.0, 21.0], [13.0, 23.0]]
    assert any("switched off" in text for text in tables.warnings)
    with pytest.raises(InputError, match="no height"):
        read_points(path)


def test_gcps_in_an_image(tmp_path: Path) -> None:
    """rasterio's row and col of a GCP count from the pixel's corner, as GDAL's do."""
    gcps = [
        GroundControlPoint(row=20.5 + k, col=10.5 + k, x=x, y=y, z=z, id=name)
        for k, (name, (x, y, z)) in enumerate(zip("ABCD", GROUND.tolist(), strict=True))
    ]
    path = tmp_path / "img.tif"
    with rasterio.open(path, "w", driver="GTiff", width=64, height=64, count=1, dtype="uint8") as image:
        image.gcps = (gcps, rasterio.crs.CRS.from_epsg(4326))
    tables = read_points(str(path), height_datum="ellipsoidal")
    assert_ground(tables.ground.ground)
    assert tables.image.xy[0].tolist() == [10.0, 20.0]
    assert tables.ground.ids.tolist() == ["img-1", "img-2", "img-3", "img-4"]  # GeoTIFF keeps no names
    named = [gdal.GCP(*GROUND[0].tolist(), 1.0, 2.0, "", "A"), gdal.GCP(*GROUND[1].tolist(), 3.0, 4.0, "", "7")]
    virtual = gdal.GetDriverByName("VRT").CreateCopy(str(tmp_path / "v.vrt"), gdal.Open(str(path)))
    virtual.SetGCPs(named, crs_wkt("EPSG:4326"))
    del virtual
    ground = read_points(str(tmp_path / "v.vrt")).ground
    assert ground.ids.tolist() == ["A", "v-7"]


def test_ames_stereo_pipeline_gcps(tmp_path: Path) -> None:
    """The sample line of the program's manual, and one with commas."""
    text = (
        "# id lat lon height sigmas\n"
        "5 23.7 160.1 427.1 1.0 1.0 1.0 image1.tif 124.5 19.7 1.0 1.0 image2.tif 254.3 73.9 1.0 1.0\n"
        "6,-23.5,10.25,1.5,3,4,0.5\n"
    )
    tables = read_points(write_text(tmp_path / "a.gcp", text), image_ids=["image1", "image2"])
    assert tables.ground.ground.tolist() == [[160.1, 23.7, 427.1], [10.25, -23.5, 1.5]]
    covariance = tables.ground.survey_covariance_m2()
    np.testing.assert_allclose(covariance[0], np.eye(3), atol=1e-12)
    # the same numbers by finite differences of PROJ's geocentric coordinates
    to_xyz = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    here = np.array([10.25, -23.5, 1.5])
    axes = []
    for axis in np.eye(3) * [1e-5, 1e-5, 1.0]:
        step = np.subtract(to_xyz.transform(*(here + axis)), to_xyz.transform(*(here - axis)))
        axes.append(step / np.linalg.norm(step))
    rotation = np.array(axes)
    np.testing.assert_allclose(covariance[1], rotation @ np.diag([9.0, 16.0, 0.25]) @ rotation.T, atol=1e-5)
    assert tables.image.image_ids.tolist() == ["image1", "image2"]
    assert tables.image.xy.tolist() == [[124.5, 19.7], [254.3, 73.9]]
    assert len(tables.warnings) == 1
    assert "geocentric" in tables.warnings[0]


def test_csv_details(tmp_path: Path) -> None:
    """Comments, blank lines, quoted separators, trailing empty fields, Latin-1, Windows line ends."""
    text = '# made by hand\r\n\r\nid,note,lon,lat,height\r\n"A, 1","x\r\ny", 5.0 ,44,1,,\r\n\r\nÄ,,6,45,2\r\n,,,,\r\n'
    ground = read_points(write_text(tmp_path / "p.csv", text, "latin-1")).ground
    assert ground.ids.tolist() == ["A, 1", "Ä"]
    assert ground.ground.tolist() == [[5.0, 44.0, 1.0], [6.0, 45.0, 2.0]]


def test_ground_crs_tells_the_datum_of_geographic_csv(tmp_path: Path) -> None:
    path = write_text(tmp_path / "p.csv", "id,lon,lat,height\nA,5,44,1\n")
    assert read_points(path, ground_crs="EPSG:4979").warnings == ()


@pytest.mark.parametrize("adjusted", [False, True])
def test_heights_of_own_layers_are_ellipsoidal_in_every_run(tmp_path: Path, adjusted: bool) -> None:
    """The chain of a project hands its datum, that of the survey, on with the adjusted points."""
    text = "id,lon,lat,height,survey_lon,survey_lat,survey_height\nA,5,44,100,5.1,44.1,110\n"
    path = write_text(tmp_path / "p.csv", text)
    ground = read_points(path, height_datum="egm96", adjusted=adjusted).ground.ground
    assert ground.tolist() == [[5.0, 44.0, 100.0] if adjusted else [5.1, 44.1, 110.0]]


def test_a_spreadsheet_of_unknown_columns_is_told_its_columns(tmp_path: Path) -> None:
    path = str(tmp_path / "p.xlsx")
    dataset = ogr.GetDriverByName("XLSX").CreateDataSource(path)
    layer = dataset.CreateLayer("Blatt1")
    for name in ("Punktnr", "Rechts", "Hoch"):
        layer.CreateField(ogr.FieldDefn(name, ogr.OFTReal))
    feature = ogr.Feature(layer.GetLayerDefn())
    feature.SetField(0, 1.0)
    layer.CreateFeature(feature)
    del feature, layer, dataset
    with pytest.raises(InputError, match=r"its fields are Punktnr, Rechts, Hoch: .*columns=id=NAME"):
        read_points(path)


def test_waypoints_of_a_gps_receiver(tmp_path: Path) -> None:
    """The one layer of a GPX file that is not empty is meant; ``ele`` is its height."""
    point = '<wpt lat="44.5" lon="5.25"><ele>210.5</ele><name>A1</name></wpt>'
    text = f'<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">{point}</gpx>'
    ground = read_points(write_text(tmp_path / "p.gpx", text)).ground
    assert ground.ids.tolist() == ["A1"] and ground.ground.tolist() == [[5.25, 44.5, 210.5]]


def test_images_are_found_whatever_the_case_of_their_names(tmp_path: Path) -> None:
    """As on Windows; where two images differ in nothing else, names are taken as they stand."""
    text = "id,image,sample,line\n" + "".join(f"P{k},{name},1,2\n" for k, name in enumerate(NAMES_IN_CAPITALS))
    path = write_text(tmp_path / "p.csv", text)
    image = read_points(path, image_ids=["img", "Nadir", "twin", "Twin"]).image
    assert image.image_ids.tolist() == ["img", "img", "Nadir", "Twin", "TWIN"]


NAMES_IN_CAPITALS = (r"D:\DATA\IMG.TIF", "IMG", "nadir.tif", "Twin", "TWIN")

DAMAGED = [
    ("id,lon,lat,height\nA,5,x44,1\n", r"line 2: 'x44' is not a number|field 'lat', line 2"),
    ("id,lon,lat,height\nA,5,44,1\nB,5,inf,1\n", "line 3: 'inf' is not a number"),
    *((f"id,lon,lat,height\nA,5,{text},1\n", f"'{text}' is not a number") for text in ("0x10", "４３.5", "43.5abc")),
    ("id,lon,lat,height\nA,5,1e400,1\n", "'1e400' is not a number"),
    ("id,lon,lat,height\nA,5,1_0,1\n", "'1_0' is not a number: correct it"),
    ('id,lon,lat,height\nA,5,"44,5",1\n', "'44,5' is not a number: write decimals with a point"),
    ("id,lon,lat,height\nA,5,44°75'N,1\n", "is not a number: write degrees as 43.525"),
    ("id,lon,lat,height\nA,5,44,nan\n", r"line 2 \(id 'A'\): has no height"),
    ("id,lon,lat,height\nA,5,,1\n", "has no position"),
    ("id,lon,lat,height\n ,5,44,1\n", "line 2: field 'id' is empty"),
    ("id,lon,lat,height\nA,5,44,1\n\nB,5,44,1\nA,5,44,1.5\n", r"line 5 \(id 'A'\): occurs in line 2 already"),
    ("id,lon,lat,height\nA,-42.8,147.2,1\n", "latitude and longitude look swapped"),
    ("id,lon,lat,height\nA,519653,5259759,1\n", "no degrees"),
    ("id,lon,lat\nA,5,44\n", "has no height"),
    ("lon,lat,height\n5,44,1\n", "has no field 'id'"),
    ("id,lon,lat,height,role\nA,5,44,1,contrl\n", "role 'contrl' is unknown: use gcp, check, tie or off"),
    ("id,lon,lat,height,sigma_xy\nA,5,44,1,0\n", "field 'sigma_xy' is 0"),
    ("id,lon,lat,height\n", "contains no points"),
    ("id,x,y,z\nA,5,44,1\n", "ground_crs"),
    ("id,foo\nA,1\n", "neither positions"),
    ("Punkt;Rechtswert;Hochwert\nA;1;2\n", "name those meant: FILE|columns=id=Punkt,"),
    ("5,44,1\n6,45,2\n", "add a header line"),
    ("2\nA 44 105 1\nB 44 105\n", "line 3: has 3 columns, but 4 are in the first row"),
    ("", "add a header line"),
    ("id,image,sample,line\nA,i,5,\n", "field 'line' is empty"),
    ("id,image,sample\nA,i,5\n", "has no field 'line'"),
    ("id,image,sample,line\nA,,5,6\n", "field 'image' is empty"),
    ("id,lon,lat,height\nA,5,1,44,2,1\n", "has 6 fields, the header 4"),
    ("id,image,sample,line,lon,lat,height\nA,i,1,2,5,44,1\nA,j,1,2,6,44,1\n", "with another position"),
]


@pytest.mark.parametrize(("text", "message"), DAMAGED)
def test_damaged_csv_names_what_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    path = write_text(tmp_path / "points.csv", text)
    with pytest.raises(InputError, match=message) as caught:
        read_points(path)
    assert "points.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_number_of_points_in_the_first_line_is_no_point(tmp_path: Path) -> None:
    path = write_text(tmp_path / "points.txt", "2 \n1 \t34.5\t113.25\t176.9\n11 \t34.25\t113.5\t443.7\n")
    ground = read_points(path).ground
    assert ground.ids.tolist() == ["1", "11"]
    assert ground.ground.tolist() == [[113.25, 34.5, 176.9], [113.5, 34.25, 443.7]]
    with pytest.raises(InputError, match="line 1: has 1 columns"):  # a damaged line, not a number of points
        read_points(write_text(tmp_path / "damaged.txt", "3\n1 34.5 113.25 176.9\n") + "|columns=id,lat,lon,height")


def test_damaged_layers_name_what_is_wrong(tmp_path: Path) -> None:
    no_crs = write_layer(tmp_path / "n.gpkg", "GPKG", "", GROUND, {"id": IDS})
    with pytest.raises(InputError, match="assign one to the layer, or give `ground_crs`"):
        read_points(str(no_crs))
    assert_ground(read_points(str(no_crs), ground_crs="EPSG:4979").ground.ground)  # type: ignore[union-attr]
    text = write_layer(
        tmp_path / "t.shp", "ESRI Shapefile", "EPSG:4326", GROUND, {"id": IDS, "height": ["1", "2", "drei", "4"]}
    )
    with pytest.raises(InputError, match=r"feature 2, field 'height': 'drei' is not a number"):
        read_points(str(text))
    wrong = write_layer(tmp_path / "w.gpkg", "GPKG", "EPSG:32755", GROUND, {"id": IDS})
    with pytest.raises(InputError, match="look like degrees"):
        read_points(str(wrong))
    with pytest.raises(InputError, match=r"has no layer 'q' \(layers: points\)"):
        read_points(f"{wrong}|layername=q")
    with pytest.raises(InputError, match="is not understood"):
        read_points(f"{wrong}|subset=x")
    with pytest.raises(InputError, match="no such file"):
        read_points(str(tmp_path / "none.gpkg"))
    with pytest.raises(InputError, match="unknown coordinate reference system 'EPSG:0'"):
        read_points(str(no_crs), ground_crs="EPSG:0")


def test_lines_are_no_points(tmp_path: Path) -> None:
    geojson = {
        "type": "FeatureCollection",
        "features": [{"type": "Feature", "properties": {"id": "A"},
                      "geometry": {"type": "LineString", "coordinates": [[0, 0], [1, 1]]}}],
    }  # fmt: skip
    with pytest.raises(InputError, match="is a Linestring: give a layer of points"):
        read_points(write_text(tmp_path / "l.geojson", json.dumps(geojson)))


def test_two_layers_must_be_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "two.gpkg"
    write_layer(path, "GPKG", "EPSG:4979", GROUND, {"id": IDS}, layer="a")
    dataset = gdal.OpenEx(str(path), gdal.OF_VECTOR | gdal.OF_UPDATE)
    dataset.CopyLayer(dataset.GetLayer(0), "b")
    del dataset
    with pytest.raises(InputError, match=r"has 2 layers \(a, b\): name one: two.gpkg\|layername=LAYER"):
        read_points(str(path))
    for spec in ("layername=b", "layerid=1", "layerid=1|geometrytype=PointZ"):
        assert_ground(read_points(f"{path}|{spec}").ground.ground)  # type: ignore[union-attr]


def test_every_reader_is_described() -> None:
    known = "csv micmac micmac-homol metashape orthoengine ogr qgis-points envi image-gcps orthority asp-gcp asp-match "
    assert set((known + "asp-match-text colmap hloc sat-bundleadjust").split()) == set(POINT_READERS)
    assert all(reader.title for reader in POINT_READERS.values())
