"""Fields of any name: ``FILE|columns=id=nr,sigma_h=sH`` reads what a file with HRSI's own names holds."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from gdal_files import write_layer
from osgeo import ogr

import hrsi
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.laser_files import read_laser
from hrsi.hrsi_engine.io.point_files import ogr_layer, read_image_points, read_points
from hrsi.processing_algorithms.command_line.cli import main

HOBART = Path(__file__).resolve().parents[2] / "examples" / "hobart"
LONLAT = np.array([[147.24, -42.81], [147.25, -42.82], [147.26, -42.83]])
#: What the survey knows, under names of its own, beside fields that have HRSI's names and mean something else.
SURVEY = {
    "nr": ["P7", "P8", "P9"], "hoehe": [12.5, 13.25, 14.0], "sE": [0.02, 0.03, 0.04], "sN": [0.05, 0.06, 0.07],
    "sH": [0.1, 0.2, 0.3], "id": ["a", "b", "c"], "height": [900.0, 901.0, 902.0],
}  # fmt: skip
CHOSEN = "columns=id=nr,height=hoehe,sigma_east=sE,sigma_north=sN,sigma_h=sH"
DRIVERS = {"gpkg": "GPKG", "shp": "ESRI Shapefile", "geojson": "GeoJSON", "fgb": "FlatGeobuf"}


def write_survey(path: Path) -> Path:
    """Write the survey in the format of a name's suffix."""
    suffix = path.suffix[1:]
    if suffix in DRIVERS:
        xyz = np.column_stack([LONLAT, np.zeros(3)])
        return write_layer(path, DRIVERS[suffix], "EPSG:4326", xyz, SURVEY, with_z=False)
    texts = [[*map(str, row)] for row in zip(*SURVEY.values(), *LONLAT.T.tolist(), strict=True)]
    header = [*SURVEY, "lon", "lat"]
    if suffix == "tsv":  # decimal commas, for which NumPy's reader has no ear
        texts = [[text.replace(".", ",") for text in row] for row in texts]
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, delimiter="\t" if suffix == "tsv" else ",").writerows([header, *texts])
    return path


def require_survey(tables) -> None:
    ground = tables.ground.select(np.argsort(tables.ground.ids))  # FlatGeobuf sorts by place
    assert ground.ids.tolist() == SURVEY["nr"]
    np.testing.assert_allclose(ground.ground[:, :2], LONLAT, atol=1e-9)
    np.testing.assert_allclose(ground.ground[:, 2], SURVEY["hoehe"], atol=1e-9)
    sigmas = np.sqrt(ground.covariance_m2[:, range(3), range(3)])
    np.testing.assert_allclose(sigmas, np.column_stack([SURVEY[name] for name in ("sE", "sN", "sH")]), atol=1e-9)


@pytest.mark.parametrize("suffix", [*DRIVERS, "csv", "tsv"])
def test_survey_with_names_of_its_own(suffix: str, tmp_path: Path) -> None:
    path = write_survey(tmp_path / f"survey.{suffix}")
    require_survey(read_points(f"{path}|{CHOSEN}", height_datum="ellipsoidal"))
    own = read_points(str(path), height_datum="ellipsoidal").ground
    assert sorted(own.ids.tolist()) == SURVEY["id"] and own.covariance_m2 is None


def test_feature_by_feature(tmp_path: Path, monkeypatch) -> None:
    """Where there is no Arrow stream."""
    path = write_survey(tmp_path / "survey.gpkg")
    monkeypatch.setattr(ogr_layer, "_read_columns", lambda *_: None)
    require_survey(read_points(f"{path}|layername=points|{CHOSEN}", height_datum="ellipsoidal"))


@pytest.mark.parametrize("stream", [True, False])
def test_feature_ids_of_a_geopackage(stream: bool, tmp_path: Path, monkeypatch) -> None:
    """QGIS shows the feature id as a field `fid`, OGR has no such field."""
    path = write_survey(tmp_path / "survey.gpkg")
    if not stream:
        monkeypatch.setattr(ogr_layer, "_read_columns", lambda *_: None)
    assert read_points(f"{path}|columns=id=fid", height_datum="ellipsoidal").ground.ids.tolist() == ["1", "2", "3"]


def test_capitals_one_field_for_two_and_names_with_commas(tmp_path: Path) -> None:
    path = tmp_path / "survey.csv"
    path.write_text('Nr,nR,"Lage, m",lon,lat,height\nA,B,0.02,147.1,-42.1,5\n', encoding="utf-8")
    ground = read_points(f"{path}|columns=id=nR,Sigma_E=lage, m,sigma_north=Lage, m,sigma_h=Lage, m").ground
    assert ground.ids.tolist() == ["B"]  # the spelling decides where two names differ in capitals
    np.testing.assert_allclose(np.sqrt(ground.covariance_m2[0].diagonal()), 0.02)
    assert read_points(f"{path}|columns=id=NR").ground.ids.tolist() == ["A"]


def test_a_chosen_field_loses_its_own_meaning(tmp_path: Path) -> None:
    """Columns called x and y that are longitude and latitude are no map coordinates beside."""
    path = tmp_path / "survey.csv"
    path.write_text("id,x,y,z\nA,147.1,-42.1,5\n", encoding="utf-8")
    ground = read_points(f"{path}|columns=lon=x,lat=y", height_datum="ellipsoidal").ground
    np.testing.assert_allclose(ground.ground, [[147.1, -42.1, 5.0]], atol=1e-9)


def test_measurements(tmp_path: Path) -> None:
    path = tmp_path / "measured.csv"
    path.write_text("Punkt,Bild,Spalte,Zeile\nA,left,10.5,20.25\n", encoding="utf-8")
    spec = f"{path}|columns=id=Punkt,image=Bild,sample=Spalte,line=Zeile"
    image = read_image_points(spec, image_ids=["left", "right"]).image
    assert image.image_ids.tolist() == ["left"] and image.xy.tolist() == [[10.5, 20.25]]
    with pytest.raises(InputError, match=r"has the image of each point in a field: remove \|image="):
        read_points(f"{spec}|image=left", image_ids=["left"])
    spec = f"{path}|columns=id=Punkt,sample=Spalte,line=Zeile|image=right"
    assert read_points(spec, image_ids=["left", "right"]).image.image_ids.tolist() == ["right"]


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ("id=nummer", "has no field 'nummer'; its fields are nr, hoehe, sE, sN, sH, id, height"),
        ("nummer=nr", "'nummer=nr' behind |columns= chooses no field of points: write FIELD=NAME"),
        ("id=", "'id=' behind |columns= chooses no field of points: write FIELD=NAME"),
        ("nr,id=nr", "'nr' behind |columns= chooses no field of points: write FIELD=NAME"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("suffix", ["gpkg", "csv"])
def test_what_is_wrong_with_the_names(suffix: str, columns: str, told: str, tmp_path: Path) -> None:
    path = write_survey(tmp_path / f"survey.{suffix}")
    with pytest.raises(InputError) as error:
        read_points(f"{path}|columns={columns}")
    assert str(path) in str(error.value) and told in str(error.value)


def test_a_missing_field_says_how_to_name_it(tmp_path: Path) -> None:
    path = tmp_path / "survey.csv"
    path.write_text("nr,lon,lat,height\nA,147.1,-42.1,5\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"has no field 'id'; its fields are nr, lon.*FILE\|columns=id=NAME"):
        read_points(str(path))


def test_formats_with_fixed_names_refuse(tmp_path: Path) -> None:
    path = tmp_path / "left.points"
    path.write_text("mapX,mapY,pixelX,pixelY,enable\n147.1,-42.1,10,-20,1\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"left\.points: the fields of the format QGIS.* have fixed names"):
        read_points(f"{path}|columns=id=mapX", image_ids=["left"])


def test_laser_points_in_geoparquet(tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = {"lon": [147.1, 147.2], "lat": [-42.1, -42.2], "hoehe": [5.0, 6.0], "sH": [0.1, 0.2]}
    parquet.write_table(arrow.table(columns), tmp_path / "laser.parquet")
    points = read_laser(f"{tmp_path / 'laser.parquet'}|columns=height=hoehe,sigma_h=sH")
    np.testing.assert_allclose(points.ground[:, 2], columns["hoehe"])
    np.testing.assert_allclose(points.sigma_m, columns["sH"])


def test_on_the_command_line_and_in_python(tmp_path: Path) -> None:
    """The Hobart block with ids and heights under other names has the accuracies of the block as it is."""
    table = list(csv.reader((HOBART / "hobart_ground_points.csv").open(encoding="utf-8")))
    table[0] = [{"id": "Punktnummer", "height": "Hell"}.get(name, name) for name in table[0]]
    path = tmp_path / "survey.csv"
    csv.writer(path.open("w", encoding="utf-8", newline="")).writerows(table)
    spec = f"{path}|columns=id=Punktnummer,height=Hell"
    images = sorted(str(one) for one in HOBART.glob("*_RPC.TXT"))
    given = {
        "image_points": str(HOBART / "hobart_image_points.csv"), "height_datum": "ellipsoidal",
        "gcp_ids": ["H003", "H022", "H024", "H035", "H048", "H058"],
    }  # fmt: skip
    plain = hrsi.adjust(images, gcps=str(HOBART / "hobart_ground_points.csv"), **given)
    named = hrsi.adjust(images, gcps=spec, **given)
    assert named.report["check_points"] == plain.report["check_points"]
    words = [
        "adjust", *images, "--gcps", spec, "--image-points", given["image_points"], "--height-datum", "ellipsoidal",
        "--gcp-ids", ",".join(given["gcp_ids"]), "--output-dir", str(tmp_path / "out"), "--no-report", "--quiet",
    ]  # fmt: skip
    assert main(words) == 0
    written = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert len(written["check_points"]) == 65 and written["check_points"] == plain.report["check_points"]


def test_layers_of_a_file_with_several(tmp_path: Path) -> None:
    path = write_survey(tmp_path / "survey.gpkg")
    with_more = ogr.Open(str(path), 1)
    with_more.CreateLayer("other", None, ogr.wkbPoint)
    del with_more
    require_survey(read_points(f"{path}|layername=points|{CHOSEN}", height_datum="ellipsoidal"))
    with pytest.raises(InputError, match="layer 'points': has no field 'x1'"):
        read_points(f"{path}|layername=points|columns=id=x1")


def test_columns_by_their_order_skip_a_header_line(tmp_path: Path) -> None:
    """Where all columns are named in their order, a first line of words is the file's own header and no point."""
    rows = "P7;519653,2;5259759,1;12,5\nP8;519700,0;5259800,4;13,0\n"
    plain, headed = tmp_path / "plain.csv", tmp_path / "headed.csv"
    plain.write_text(rows, encoding="utf-8")
    headed.write_text("Punkt;Rechtswert;Hochwert;Höhe\n" + rows, encoding="utf-8-sig")
    grounds = [read_points(f"{path}|columns=id,x,y,height", ground_crs="EPSG:32755").ground for path in (plain, headed)]
    assert [ground.ids.tolist() for ground in grounds] == [["P7", "P8"]] * 2
    assert np.array_equal(grounds[0].ground, grounds[1].ground)


def test_names_that_are_no_fields_are_those_that_were_given(tmp_path: Path) -> None:
    """Not those of the header line, which the names in their order replace."""
    path = tmp_path / "headed.csv"
    path.write_text("Punkt;Rechtswert;Hochwert\nP7;519653;5259759\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"headed.csv: nr, east_, north_ are no fields of points"):
        read_points(f"{path}|columns=nr,east_,north_", ground_crs="EPSG:32755")
