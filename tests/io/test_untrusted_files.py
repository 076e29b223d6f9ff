"""Files of others: nothing in them is run, XML has no entities, and what points elsewhere leads where GDAL would go."""

import ast
import http.server
import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal, ogr
from parsed_sources import walk_sources
from rpc_samples import sample_rpc, write_image

from hrsi.hrsi_engine.foundation.errors import HrsiError, InputError, OutputError
from hrsi.hrsi_engine.io.geopackage.layer_tables import replace_layers
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.opening.databases import insert_text, sql_text
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.hrsi_engine.io.safety.array_files import PartStore

SECRET = "root:x:0:0:secret"


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """A file that no message may show."""
    path = tmp_path / "secret.txt"
    path.write_text(SECRET + "\n")
    return path


# ---- XML -------------------------------------------------------------------------------------------------------------

LAUGHS = "".join(f"<!ENTITY l{k} '{f'&l{k - 1};' * 10}'>" for k in range(1, 12))
#: Document types by what they would do: 10^11 laughs, one long text, a file, a file through a parameter.
DOCTYPES: dict[str, str] = {
    "laughs": f"<!DOCTYPE d [<!ENTITY l0 'ha'>{LAUGHS}]>",
    "quadratic": f"<!DOCTYPE d [<!ENTITY l11 '{'a' * 1500}'>]>",
    "file": "<!DOCTYPE d [<!ENTITY l11 SYSTEM 'file://{secret}'>]>",
    "parameter": "<!DOCTYPE d [<!ENTITY % p SYSTEM 'file://{secret}'> %p; <!ENTITY l11 'a'>]>",
    "external": "<!DOCTYPE d SYSTEM 'file://{secret}'>",
}


def as_dimap(folder: Path, doctype: str, encoding: str) -> Path:
    text = "<Dimap_Document><Rational_Function_Model>&l11;</Rational_Function_Model></Dimap_Document>"
    return put(folder / "RPC_x.XML", doctype + text, encoding)


def as_isd(folder: Path, doctype: str, encoding: str) -> Path:
    return put(folder / "x.XML", f"{doctype}<isd><RPB>&l11;</RPB></isd>", encoding)


def as_side_file_of_gdal(folder: Path, doctype: str, encoding: str) -> Path:
    write_image(folder / "x.tif", None)
    put(folder / "x.tif.aux.xml", f"{doctype}<PAMDataset><Metadata domain='RPC'><MDI key='LINE_OFF'>&l11;</MDI>"
        "</Metadata></PAMDataset>", encoding)  # fmt: skip
    return folder / "x.tif"


def as_product_of_tiles(folder: Path, doctype: str, encoding: str) -> Path:
    """A tile beside a sound RPC file; the size of tiles stands in the product's own file."""
    write_image(folder / "IMG_x_R2C1.tif", None)
    write_rpc_of_dimap(folder / "RPC_x.XML")
    put(folder / "DIM_x.XML", f"{doctype}<Dimap_Document><NTILES_SIZE ncols='&l11;'/></Dimap_Document>", encoding)
    return folder / "IMG_x_R2C1.tif"


def write_rpc_of_dimap(path: Path) -> None:
    from hrsi.hrsi_engine.io.rpc_files.xml_formats import DIMAP_NAMES

    values = sample_rpc()
    scalars = "".join(f"<{tag}>{getattr(values, name)}</{tag}>" for name, tag in DIMAP_NAMES.items()
                      if np.ndim(getattr(values, name)) == 0)  # fmt: skip
    terms = "".join(f"<{tag}_{k + 1}>{term}</{tag}_{k + 1}>" for name, tag in DIMAP_NAMES.items()
                    if np.ndim(getattr(values, name)) for k, term in enumerate(getattr(values, name)))  # fmt: skip
    path.write_text(
        "<Dimap_Document><METADATA_FORMAT version='2.0'>DIMAP</METADATA_FORMAT><Rational_Function_Model>"
        f"<Inverse_Model>{terms}</Inverse_Model><RFM_Validity>{scalars}</RFM_Validity></Rational_Function_Model></Dimap_Document>"
    )


def put(path: Path, text: str, encoding: str) -> Path:
    path.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>{text}'.encode(encoding))
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("doctype", DOCTYPES)
@pytest.mark.parametrize("reader", [as_dimap, as_isd, as_side_file_of_gdal, as_product_of_tiles])
def test_xml_has_no_entities(
    reader: Callable[[Path, str, str], Path], doctype: str, encoding: str, tmp_path: Path, secret: Path
):
    """The file is refused at its first line, for each reader of XML: nothing is expanded, nothing else is read."""
    (tmp_path / "in").mkdir()
    path = reader(tmp_path / "in", DOCTYPES[doctype].replace("{secret}", str(secret)), encoding)
    started = time.process_time()
    with pytest.raises(InputError) as error:
        read_rpc(str(path))
    assert time.process_time() - started < 2.0
    assert SECRET not in str(error.value)
    if encoding == "utf-8" or reader is as_side_file_of_gdal:
        assert "DOCTYPE" in str(error.value)


def test_the_tile_reads_without_the_document_type(tmp_path: Path):
    """The scene of the test above is sound but for that."""
    path = as_product_of_tiles(tmp_path, "", "utf-8")
    put(tmp_path / "DIM_x.XML", "<Dimap_Document><NTILES_SIZE ncols='20' nrows='30'/></Dimap_Document>", "utf-8")
    assert read_rpc(str(path)).source == "DIMAP XML RPC_x.XML, moved to the crop at sample 0, line 30 of its scene"


def test_xml_is_parsed_in_one_place(repository: Path):
    """So no reader can forget to refuse entities."""
    importers = {
        path.relative_to(repository).as_posix()
        for path, node in walk_sources(["xml"])
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for name in [getattr(node, "module", None) or "", *(alias.name for alias in node.names)]
        if name.partition(".")[0] in ("xml", "lxml", "defusedxml")
    }
    assert importers == {"hrsi_engine/io/opening/files.py"}


# ---- files that point elsewhere ------------------------------------------------------------------------------------

VRT = """<VRTDataset rasterXSize="64" rasterYSize="64"><Metadata domain="RPC">{rpc}</Metadata>
<VRTRasterBand dataType="UInt16" band="1"{derived}><SimpleSource>
<SourceFilename relativeToVRT="0">{source}</SourceFilename><SourceBand>1</SourceBand></SimpleSource>
</VRTRasterBand></VRTDataset>"""
PYTHON = """ subClass="VRTDerivedRasterBand"><PixelFunctionLanguage>Python</PixelFunctionLanguage>
<PixelFunctionType>run</PixelFunctionType><PixelFunctionCode><![CDATA[
open({canary!r}, "w").close()
def run(*arguments, **named):
    open({canary!r}, "w").close()
]]></PixelFunctionCode"""


def write_vrt(path: Path, source: str, derived: str = "") -> str:
    image = path.with_name("rpc_source.tif")
    write_image(image, sample_rpc())
    items = gdal.Open(str(image)).GetMetadata("RPC").items()
    rpc = "".join(f'<MDI key="{key}">{value}</MDI>' for key, value in items)
    path.write_text(VRT.format(rpc=rpc, derived=derived, source=source))
    return str(path)


def read_pixels(path: str) -> np.ndarray:
    raster = open_image(path).pixels
    return raster.read(0, 0, 64, 64)[0]


def test_code_in_a_vrt_is_not_run(tmp_path: Path):
    """GDAL runs Python in a VRT only where its user has allowed that; HRSI does not."""
    canary = tmp_path / "canary"
    image = tmp_path / "pixels.tif"
    write_image(image, None)
    path = write_vrt(tmp_path / "x.vrt", str(image), PYTHON.format(canary=str(canary)))
    with pytest.raises(InputError):
        read_pixels(path)
    assert not canary.exists()


def test_no_option_of_gdal_is_loosened(repository: Path):
    """Those that let files run code, load libraries or go where they would not."""
    loose = ("GDAL_VRT_ENABLE_PYTHON", "VRT_ALLOW", "LOAD_EXTENSION", "enable_load_extension", "GDAL_HTTP_UNSAFESSL",
             "allow_pickle=True", "XML_PARSE_HUGE", "shell=True")  # fmt: skip
    found = [
        (path.name, word)
        for part in ("hrsi_engine", "processing_algorithms", "plugin")
        for path in (repository / part).rglob("*.py")
        for word in loose
        if word in path.read_text(encoding="utf-8")
    ]
    assert found == []


def test_a_vrt_that_points_to_no_image_shows_nothing_of_it(tmp_path: Path, secret: Path):
    path = write_vrt(tmp_path / "x.vrt", str(secret))
    with pytest.raises(InputError) as error:
        read_pixels(path)
    assert SECRET not in str(error.value) and "\n" not in str(error.value)


class Requests(http.server.BaseHTTPRequestHandler):
    """Serves nothing and notes what it is asked for."""

    asked: set[str] = set()

    def do_GET(self) -> None:
        self.asked.add(self.path)
        self.send_error(404)

    def do_HEAD(self) -> None:
        self.do_GET()

    def log_message(self, *_arguments: object) -> None:
        pass


@pytest.fixture
def server() -> Iterator[http.server.ThreadingHTTPServer]:
    found = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Requests)
    threading.Thread(target=found.serve_forever, daemon=True).start()
    yield found
    found.shutdown()
    found.server_close()


def test_a_vrt_that_points_to_a_server_asks_it_for_no_more_than_gdal_does(
    tmp_path: Path, server: http.server.ThreadingHTTPServer
):
    asked = []
    for number, read in enumerate((lambda path: gdal.Open(path).ReadAsArray(), read_pixels)):
        Requests.asked = set()
        gdal.VSICurlClearCache()
        url = f"/vsicurl/http://127.0.0.1:{server.server_port}/elsewhere/image.tif"
        path = write_vrt(tmp_path / f"{number}.vrt", url)
        gdal.PushErrorHandler("CPLQuietErrorHandler")
        try:
            read(path)
        except (RuntimeError, InputError):
            pass
        finally:
            gdal.PopErrorHandler()
        asked.append(Requests.asked)
    by_gdal, by_hrsi = asked
    assert "/elsewhere/image.tif" in by_gdal  # the server is heard
    assert by_hrsi <= by_gdal


OGR_VRT = """<OGRVRTDataSource><OGRVRTLayer name="points"><SrcDataSource>{source}</SrcDataSource>
<SrcLayer>{layer}</SrcLayer><GeometryType>wkbPoint25D</GeometryType><LayerSRS>EPSG:4979</LayerSRS>
<GeometryField encoding="PointFromColumns" x="lon" y="lat" z="height"/></OGRVRTLayer></OGRVRTDataSource>"""


def ids_by_ogr(path: Path, layer: str) -> list[str]:
    dataset = ogr.Open(str(path))  # held: its layers do not live without it
    return [feature.GetField("id") for feature in dataset.GetLayerByName(layer)]


def test_a_vector_file_that_points_elsewhere_leads_where_ogr_goes(tmp_path: Path, secret: Path):
    """To another table of points; into a text it shows nothing."""
    (tmp_path / "table.csv").write_text("id,lon,lat,height\nA,147.3,-42.8,12\nB,147.4,-42.9,13\n")
    path = tmp_path / "points.vrt"
    path.write_text(OGR_VRT.format(source=tmp_path / "table.csv", layer="table"))
    ground = read_points(str(path), height_datum="ellipsoidal").ground
    assert ground.ids.tolist() == ids_by_ogr(path, "points") == ["A", "B"]
    path.write_text(OGR_VRT.format(source=secret, layer="secret"))
    with pytest.raises(HrsiError) as error:
        read_points(str(path), height_datum="ellipsoidal")
    assert SECRET not in str(error.value)


@pytest.fixture
def geopackage(tmp_path: Path) -> Path:
    """Two ground points."""
    path = tmp_path / "points.gpkg"
    write_geopackage(str(path), [points_layer(["A", "B"])])
    return path


def points_layer(ids: list[str]) -> Layer:
    xyz = np.column_stack([np.linspace(147.3, 147.4, len(ids)), np.full(len(ids), -42.8), np.full(len(ids), 12.0)])
    return Layer("ground_points", "PointZ", 4979, xyz, {"id": np.array(ids)})


def make_view(path: Path, query: str) -> None:
    """Put a view in place of the layer."""
    with closing(sqlite3.connect(path)) as database:
        for (trigger,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
            database.execute(f'DROP TRIGGER "{trigger}"')
        database.execute("ALTER TABLE ground_points RENAME TO behind")
        database.execute(f"CREATE VIEW ground_points AS {query}")
        database.commit()


def test_a_view_is_read_as_ogr_reads_it(geopackage: Path):
    make_view(geopackage, "SELECT * FROM behind WHERE id = 'B'")
    assert ids_by_ogr(geopackage, "ground_points") == ["B"]
    assert read_points(f"{geopackage}|layername=ground_points", height_datum="ellipsoidal").ground.ids.tolist() == ["B"]


@pytest.mark.parametrize(
    "call", ["load_extension('{canary}')", "writefile('{canary}', 'x')", "readfile('{secret}')", "edit('{secret}')"]
)
def test_a_view_that_calls_out_is_not_followed(geopackage: Path, tmp_path: Path, secret: Path, call: str):
    canary = tmp_path / "canary"
    make_view(geopackage, f"SELECT fid, geom, {call.format(canary=canary, secret=secret)} AS id FROM behind")
    told = ""
    try:
        ground = read_points(f"{geopackage}|layername=ground_points", height_datum="ellipsoidal").ground
        told = str(None if ground is None else ground.ids)
    except HrsiError as error:
        told = str(error)
    assert SECRET not in told
    assert not canary.exists()


def test_hostile_names_in_a_geopackage_stay_names(geopackage: Path):
    """Rows are replaced; a trigger and a column whose names would be commands are kept as they are."""
    trigger, column = 'x"; DROP TABLE kept; --', 'y"; DROP TABLE kept; --'
    with closing(sqlite3.connect(geopackage)) as database:
        database.execute("CREATE TABLE kept (a)")
        name = trigger.replace('"', '""')
        database.execute(f'CREATE TRIGGER "{name}" AFTER INSERT ON ground_points BEGIN SELECT 1; END')
        database.commit()
    layer = points_layer(["C"])
    replace_layers(str(geopackage), [Layer(layer.name, layer.geometry, layer.crs, layer.coordinates,
                                           {**layer.fields, column: np.array([1.5])})])  # fmt: skip
    with closing(sqlite3.connect(geopackage)) as database:
        names = {row[0] for row in database.execute("SELECT name FROM sqlite_master")}
        columns = [row[1] for row in database.execute("SELECT * FROM pragma_table_info('ground_points')")]
        rows = database.execute("SELECT id FROM ground_points").fetchall()
    assert {"kept", trigger} <= names
    assert column in columns
    assert rows == [("C",)]


# ---- caches --------------------------------------------------------------------------------------------------------


class Canary:
    """Its pickle makes a folder where it is loaded."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.mkdir, (self.path,)


def test_a_cache_with_code_is_no_cache(tmp_path: Path):
    np.savez(tmp_path / "part-1.npz", found=np.array([Canary(str(tmp_path / "ran"))], dtype=object))
    assert PartStore(str(tmp_path)).load("part-1") is None
    assert not (tmp_path / "ran").exists()


# ---- names in SQL texts ----------------------------------------------------------------------------------------------


HOSTILE = ['a"b', '"; DROP TABLE kept; --', "it's", "{table}", "select", "naïve 名", "a]b`c", "%s ?", " "]


@pytest.mark.parametrize("name", HOSTILE)
def test_any_name_is_one_identifier(name: str):
    """SQLite itself tells the names of what was made with them; nothing else happened."""
    column = f"{name}x"
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute("CREATE TABLE kept (a)")
        database.execute(sql_text("CREATE TABLE {table} ({columns})", table=name, columns=["one", column]))
        database.execute(insert_text(name, ["one", column]), (1, name))
        rows = database.execute(sql_text("SELECT {column} FROM {table}", table=name, column=column)).fetchall()
        columns = [row[1] for row in database.execute("SELECT * FROM pragma_table_info(?)", (name,))]
        tables = {row[0] for row in database.execute("SELECT name FROM sqlite_master")}
    assert rows == [(name,)]
    assert columns == ["one", column]
    assert tables == {"kept", name}


def test_a_zero_byte_is_refused():
    with pytest.raises(OutputError, match="zero byte"):
        sql_text("DELETE FROM {table}", table="a\0b")
