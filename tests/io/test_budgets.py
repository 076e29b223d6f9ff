"""What readers refuse before they work with it, and that what is large and real passes."""

import contextlib
import os
import resource
import sqlite3
import struct
import subprocess
import sys
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import TEST_DATA
from hypothesis import settings
from osgeo import gdal, ogr, osr
from rpc_samples import sample_rpc

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.geoids import geoid_heights
from hrsi.hrsi_engine.io.catalogue.deliveries import resolve_images
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.large_tables import write_large_table
from hrsi.hrsi_engine.io.opening import budgets
from hrsi.hrsi_engine.io.opening.databases import require_sound, widths
from hrsi.hrsi_engine.io.opening.datasets import quiet
from hrsi.hrsi_engine.io.opening.files import require_size
from hrsi.hrsi_engine.io.output_dir import names_of_last_run
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rasters.dems import open_dem, open_geoid, read_geoid_heights
from hrsi.hrsi_engine.io.rasters.images import GdalRaster, open_image
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text
from hrsi.hrsi_engine.io.rpc_files.tiff_tag import read_directory
from hrsi.hrsi_engine.io.safety.array_files import PartStore

GIB = 2**30


def raster(
    path: Path, size: tuple[int, int], kind: int = gdal.GDT_Float32, options=(), crs: int = 4326
) -> gdal.Dataset:
    """Make an empty raster near 7 degrees east, 45 north, and return it for changes."""
    dataset = gdal.GetDriverByName("GTiff").Create(str(path), *size, 1, kind, list(options))
    reference = osr.SpatialReference()
    reference.ImportFromEPSG(crs)
    dataset.SetProjection(reference.ExportToWkt())
    dataset.SetGeoTransform((7.0, 1e-4, 0.0, 45.0, 0.0, -1e-4))
    return dataset


def points_file(path: Path, rows: int, name: str = "P") -> Path:
    ids = np.char.add(name, np.arange(rows).astype(str))
    fields = {"id": ids, "image": np.full(rows, "image_1"), "sample": np.arange(rows) * 1.0, "line": np.zeros(rows)}
    write_geopackage(str(path), [Layer("image_points", "PointZ", 4326, np.zeros((rows, 3)), fields)])
    return path


def change_rows(path: Path, statement: str, value: str, database: sqlite3.Connection | None = None) -> None:
    """Change rows as a program does that knows nothing of GeoPackage's functions, which its triggers call."""
    with contextlib.closing(sqlite3.connect(path)) as own:
        used = database or own
        triggers = used.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall()
        for (name,) in triggers:
            used.execute(f'DROP TRIGGER "{name}"')
        used.execute(statement, (value,))
        used.commit()


# ---- databases -----------------------------------------------------------------------------------------------------


def test_one_long_text_among_many_rows(tmp_path: Path) -> None:
    """OGR's columns would take rows x longest: here 20 000 x 400 kB = 8 GB."""
    path = points_file(tmp_path / "points.gpkg", 20_000)
    change_rows(path, "UPDATE image_points SET id = ? WHERE fid = 7", "x" * 400_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=r"points.gpkg: field 'id' contains a text of 400000 characters .20000 rows"):
        read_points(str(path), image_ids=["image_1"])
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


def test_one_polygon_among_points(tmp_path: Path) -> None:
    """Its size is that of no point; it is named instead of giving every point room for it."""
    path = points_file(tmp_path / "points.gpkg", 5_000)
    ring = ", ".join(f"{np.cos(a):.6f} {np.sin(a):.6f}" for a in np.linspace(0, 2 * np.pi, 60_000)[:-1]) + ", 1 0"
    dataset = gdal.OpenEx(str(path), gdal.OF_VECTOR | gdal.OF_UPDATE)
    dataset.ExecuteSQL("UPDATE image_points SET geom = NULL WHERE fid = 9")
    layer = dataset.GetLayer(0)
    feature = layer.GetFeature(9)
    feature.SetGeometry(ogr.CreateGeometryFromWkt(f"POLYGON(({ring}))"))
    with quiet():  # GDAL warns of the polygon
        layer.SetFeature(feature)
    del feature, layer, dataset
    with pytest.raises(InputError, match=r"feature 9: is a Polygon: give a layer of points"):
        read_points(str(path), image_ids=["image_1"])


def test_pages_that_contradict_each_other(tmp_path: Path) -> None:
    """A page of the table's tree leads to another table's: rows would come twice, or without end."""
    path = points_file(tmp_path / "points.gpkg", 20_000)
    content = bytearray(path.read_bytes())
    page = int.from_bytes(content[16:18], "big")
    half = len(content) // page // 2 * page
    content[half : half + page] = content[half - page : half]
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match=r"points.gpkg: is a damaged database .*: obtain it again") as caught:
        read_points(str(path), image_ids=["image_1"])
    assert "\n" not in str(caught.value)


def test_a_view_without_end_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = points_file(tmp_path / "points.gpkg", 100)
    database = sqlite3.connect(path)
    database.execute(
        "CREATE VIEW endless AS WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) "
        "SELECT n AS id, 'a' AS image, n AS sample, n AS line FROM c"
    )
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier) VALUES ('endless', 'attributes', 'endless')"
    )
    database.commit()
    database.close()
    monkeypatch.setattr("hrsi.hrsi_engine.io.opening.databases.database_seconds", lambda size: 0.5)
    started = time.thread_time()
    with pytest.raises(InputError, match="no answer after"):
        read_points(f"{path}|layername=endless", image_ids=["a"])
    assert time.thread_time() - started < 3.0


def test_sound_databases_pass(tmp_path: Path) -> None:
    path = points_file(tmp_path / "it's 50% “ok”?.gpkg", 1000)
    require_sound(str(path))
    assert widths(str(path), "image_points", ["id", "image"]) == (1000, {"id": 4, "image": 7})
    table = read_points(str(path), image_ids=["image_1"]).image
    assert table is not None and len(table) == 1000
    with pytest.raises(InputError, match="no such table"):
        widths(str(path), 'no "such" table', [])


def test_a_database_that_another_program_writes_is_read(tmp_path: Path) -> None:
    """QGIS keeps files open with a write-ahead log; what is in it counts."""
    path = points_file(tmp_path / "points.gpkg", 10)
    other = sqlite3.connect(path)
    other.execute("PRAGMA journal_mode = WAL")
    change_rows(path, "UPDATE image_points SET id = ? WHERE fid = 3", "renamed", other)
    table = read_points(str(path), image_ids=["image_1"]).image
    other.close()
    assert table is not None and "renamed" in table.ids
    read_points(str(path), image_ids=["image_1"])
    assert [file.name for file in tmp_path.iterdir()] == ["points.gpkg"]


@pytest.mark.large
def test_millions_of_points_are_looked_through_quickly(tmp_path: Path) -> None:
    """The time of looking through is a small part of reading; the figure for 7 million: 1.7 s of 9.4 s."""
    path = points_file(tmp_path / "points.gpkg", 200_000)
    started = time.thread_time()
    require_sound(str(path))
    widths(str(path), "image_points", ["id", "image", "geom"])
    looked = time.thread_time() - started
    read_points(str(path), image_ids=["image_1"])
    assert looked < 0.5 * (time.thread_time() - started - looked) + 0.1


@pytest.mark.large
def test_the_largest_block_of_the_pages_is_read(tmp_path: Path) -> None:
    """7 million image points; of 2 million rows of ground points all but 300 are tie points, which are no attack."""
    ties, gcps = 2_000_000, 300
    ids = np.char.add("P", np.arange(ties + gcps).astype(str))
    ground = {
        "id": ids, "role": np.repeat(["gcp", "tie"], [gcps, ties]),
        "lon": np.linspace(14.0, 15.0, len(ids)), "lat": np.linspace(44.0, 45.0, len(ids)),
        "height": np.full(len(ids), 500.0),
    }  # fmt: skip
    rows = np.repeat(np.arange(len(ids)), 4)[:7_000_000]
    image = np.array(["image_1", "image_2"])[np.arange(len(rows)) % 2]
    place = np.arange(len(rows)) % 30_000 + 0.25
    measured = {"id": ids[rows], "image": image, "sample": place, "line": place}
    files = {"ground_points.csv": ground, "image_points.csv": measured}
    for name, columns in files.items():
        step = 500_000
        parts = [{key: one[k : k + step] for key, one in columns.items()} for k in range(0, len(columns["id"]), step)]
        write_large_table(str(tmp_path / name), parts)
    budgets.require_gcp_rows(str(tmp_path / "ground_points.csv"))
    points = read_points(str(tmp_path / "ground_points.csv"), height_datum="ellipsoidal").ground
    assert points is not None and len(points) == ties + gcps
    image_points = read_points(str(tmp_path / "image_points.csv"), image_ids=["image_1", "image_2"]).image
    assert image_points is not None and len(image_points) == len(rows)
    np.testing.assert_allclose(image_points.xy[:, 0], place, atol=1e-6)


# ---- other point files ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", "id,image,sample,line\nA,image_1,1,2\n" + "x" * 5000 + ",image_1,3,4\n", "a text of 5000 characters"),
        ("b.csv", "id,image,sample,line\n" + "x" * (6 << 20), "bytes without a line break"),
        ("c.csv", "id,image,sample,line\nA,image_1,1e12,2\n", "line 2 .id 'A'.: sample 1e.12, line 2 is in no image"),
        ("d.csv", "id,lon,lat,height\nA,7,45,300\nB,7,45,29000\n", "line 3 .id 'B'.: the height 29000 m"),
        ("e.geojson", '{"ji": 1, "features": ' + "[" * 100_000, "is no JSON that can be read"),
        ("i-a__b.match", b"\x01" + b"\0" * 7 + b"\x01" + b"\0" * 7 + b"\xff" * 200, "is no complete match file"),
    ],
)
def test_points_that_cannot_be(tmp_path: Path, name: str, content: str | bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(InputError, match=message) as caught:
        read_points(str(path), image_ids=["image_1"], height_datum="ellipsoidal")
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_spreadsheet_that_unfolds_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "points.xlsx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet1.xml", b"\0" * (21 * budgets.MIB))
    monkeypatch.setattr(budgets, "FILE_BUDGETS", replace(budgets.FILE_BUDGETS, binary_bytes=20 * budgets.MIB))
    with pytest.raises(InputError, match=r"points.xlsx: unfolds to 21 MiB"):
        read_points(str(path))


def test_files_too_large_to_be_read_whole(tmp_path: Path) -> None:
    """Nothing of them is read: they are holes on the disk."""
    for name, kind in (("points.gcp", "points"), ("a.points", "points"), ("x-a__b.match", "matches")):
        path = tmp_path / name
        with open(path, "wb") as file:
            file.truncate(budgets.MOST_BYTES[kind] + 1)
        with pytest.raises(InputError, match=f"{name}: has .* MiB, more than"):
            read_points(str(path), image_ids=["a"])


def test_points_of_the_largest_block_pass_and_a_file_beyond_the_memory_does_not(tmp_path: Path) -> None:
    (path := tmp_path / "file").touch()
    os.truncate(path, 7_000_000 * 36)
    require_size(str(path), "points")
    os.truncate(path, 8 * GIB)
    with pytest.raises(InputError, match="more than a file of points can have"):
        require_size(str(path), "points")


# ---- rasters and RPCs ----------------------------------------------------------------------------------------------


def test_a_giant_with_nothing_in_it(tmp_path: Path) -> None:
    """1e6 x 1e6 pixels without a byte of them; a block of that would be searched for months."""
    path = tmp_path / "giant.tif"
    raster(path, (1_000_000, 1_000_000), gdal.GDT_Byte, ("SPARSE_OK=YES", "TILED=YES", "BLOCKXSIZE=4096",
                                                         "BLOCKYSIZE=4096", "BIGTIFF=YES"))  # fmt: skip
    assert path.stat().st_size < 4_000_000
    for opened in (GdalRaster, open_image, open_dem):
        with pytest.raises(InputError, match=r"giant.tif: claims 1000000 x 1000000 pixels"):
            opened(str(path))


def test_an_empty_image_is_told_from_a_large_one(tmp_path: Path) -> None:
    """40 000 x 40 000 px pass where their bytes are there, in the file or in those that a VRT names."""
    empty, full, mosaic = tmp_path / "empty.tif", tmp_path / "full.tif", tmp_path / "mosaic.vrt"
    size = (40_000, 40_000)
    raster(empty, size, gdal.GDT_Byte, ("SPARSE_OK=YES", "TILED=YES", "BLOCKXSIZE=4096", "BLOCKYSIZE=4096"))
    with pytest.raises(InputError, match=r"empty.tif: claims 40000 x 40000 pixels in .* bytes: nearly all"):
        GdalRaster(str(empty))
    raster(full, size, gdal.GDT_Byte)  # a hole on the disk where the pixels are to be
    assert full.stat().st_size > 1_600_000_000
    assert GdalRaster(str(full)).size == size
    gdal.BuildVRT(str(mosaic), [str(full)]).FlushCache()
    assert GdalRaster(str(mosaic)).size == size
    assert open_dem(str(mosaic), "ellipsoidal").shape == size


def test_a_mosaic_of_a_continent_passes(tmp_path: Path) -> None:
    """Of a DEM of 30 m over 60 x 60 degrees, as a VRT, only what is needed is read."""
    tile, mosaic = tmp_path / "tile.tif", tmp_path / "continent.vrt"
    heights = raster(tile, (3600, 3600), gdal.GDT_Int16)
    heights.GetRasterBand(1).Fill(321)
    del heights
    step = 1.0 / 3600.0
    source = (
        '<SimpleSource><SourceFilename relativeToVRT="1">tile.tif</SourceFilename><SourceBand>1</SourceBand>'
        '<SrcRect xOff="0" yOff="0" xSize="3600" ySize="3600"/>'
        '<DstRect xOff="{0}" yOff="{1}" xSize="3600" ySize="3600"/></SimpleSource>'
    )
    sources = "".join(source.format(3600 * i, 3600 * j) for i in range(60) for j in range(60))
    mosaic.write_text(
        f'<VRTDataset rasterXSize="216000" rasterYSize="216000"><SRS>EPSG:4326</SRS><GeoTransform>-20, {step}, 0, 60, '
        f'0, -{step}</GeoTransform><VRTRasterBand dataType="Int16" band="1">{sources}</VRTRasterBand></VRTDataset>'
    )
    surface = open_dem(str(mosaic), "ellipsoidal")
    lonlat = np.array([[7.5, 45.5], [39.9, 0.1]])
    np.testing.assert_array_equal(surface.heights(surface.grid_coordinates(lonlat)), 321.0)


def test_blocks_too_large_to_be_read(tmp_path: Path) -> None:
    path = tmp_path / "strip.tif"
    raster(path, (40_000, 40_000), gdal.GDT_UInt16, ("COMPRESS=LZW", "BLOCKYSIZE=40000", "SPARSE_OK=YES"))
    with open(path, "ab") as file:
        file.truncate(GIB)
    with pytest.raises(InputError, match=r"strip.tif: its pixels come in blocks of 40000 x 40000, 3051 MiB each"):
        GdalRaster(str(path))


@pytest.mark.parametrize("wrong", [-32768.0, -99999.0, 3.4e38, 12_345.0])
def test_heights_that_no_ground_has(tmp_path: Path, wrong: float) -> None:
    """An undeclared value for no data, or damage: the first cell is named, and how many there are."""
    path = tmp_path / "dem.tif"
    dataset = raster(path, (60, 50))
    cells = np.full((50, 60), 300.0)
    cells[30, 20:23] = wrong
    dataset.GetRasterBand(1).WriteArray(cells)
    del dataset
    surface = open_dem(str(path), "ellipsoidal")
    with pytest.raises(InputError, match=r"dem.tif, row 30, column 20: the height .* \(so are 3 of 3000 there\)"):
        surface.heights(np.array([[5.0, 5.0]]))
    dataset = gdal.Open(str(path), gdal.GA_Update)
    dataset.GetRasterBand(1).SetNoDataValue(float(np.float32(wrong)))
    del dataset
    surface = open_dem(str(path), "ellipsoidal")
    assert surface.heights(np.array([[5.0, 5.0], [21.0, 30.0]])).tolist()[0] == 300.0


@pytest.mark.parametrize(
    ("geotransform", "message"),
    [
        ((7.0, 1e-13, 0.0, 45.0, 0.0, -1e-13), "its cells are"),
        ((7.0, 1e-4, 0.0, 450.0, 0.0, -1e-4), "nowhere on Earth"),
        ((7.0, 90.0, 0.0, 45.0, 0.0, -1e-4), "its cells are|nowhere on Earth"),
    ],
)
def test_grids_that_lie_nowhere(tmp_path: Path, geotransform: tuple[float, ...], message: str) -> None:
    path = tmp_path / "dem.tif"
    raster(path, (60, 50)).SetGeoTransform(geotransform)
    with pytest.raises(InputError, match=f"dem.tif: .*({message})"):
        open_dem(str(path), "ellipsoidal")


def test_a_projection_in_no_encoding(tmp_path: Path) -> None:
    (tmp_path / "dem.asc").write_text(
        "ncols 3\nnrows 2\nxllcorner 7\nyllcorner 45\ncellsize 0.001\n300 301 302\n303 304 305\n"
    )
    reference = osr.SpatialReference()
    reference.ImportFromEPSG(4326)
    (tmp_path / "dem.prj").write_bytes(reference.ExportToWkt().encode().replace(b"WGS 84", b"W\xf2\xff 84"))
    with pytest.raises(InputError, match=r"dem.asc: PROJ does not understand its CRS"):
        open_dem(str(tmp_path / "dem.asc"), "ellipsoidal")


def test_a_geoid_of_kilometres(tmp_path: Path) -> None:
    path = tmp_path / "geoid.tif"
    dataset = raster(path, (60, 50))
    dataset.GetRasterBand(1).Fill(7000.0)
    del dataset
    with pytest.raises(InputError, match=r"geoid.tif contains 7000 m, which is not possible for a geoid"):
        geoid_heights(np.array([[7.003, 44.998]]), str(path))


def test_a_geoid_grid_that_claims_other_cells(tmp_path: Path) -> None:
    """PROJ would make room for 2 billion cells: 4 GB and 8 s."""
    path = tmp_path / "geoid.gtx"
    path.write_bytes(struct.pack(">4d2i", 44.0, 6.0, 0.1, 0.1, 65_536, 30_000) + b"\0" * 4000)
    with pytest.raises(InputError, match=r"geoid.gtx: is no geoid grid: its header declares 65536 x 30000 cells"):
        read_geoid_heights(np.array([[6.1, 44.1]]), open_geoid(str(path)))


def with_line(folder: Path, text: str, name: str, value: str) -> Path:
    path = folder / "b_RPC.TXT"
    path.write_text("\n".join(f"{name}: {value}" if line.startswith(f"{name}:") else line for line in text.split("\n")))
    return path


def test_rpc_terms_that_cannot_be(tmp_path: Path) -> None:
    write_rpc_text(str(tmp_path / "a_RPC.TXT"), sample_rpc())
    text = (tmp_path / "a_RPC.TXT").read_text()
    with pytest.raises(InputError, match=r"b_RPC.TXT: SAMP_NUM_COEFF has -3.1e\+231, which is not possible"):
        open_image(str(with_line(tmp_path, text, "SAMP_NUM_COEFF_7", "-3.1e231")))
    with pytest.raises(InputError, match=r"b_RPC.TXT: HEIGHT_SCALE is 1e-06, which is not possible"):
        open_image(str(with_line(tmp_path, text, "HEIGHT_SCALE", "1e-6")))
    with pytest.raises(InputError, match=r"b_RPC.TXT: SAMP_DEN_COEFF starts with 1e-09, and its largest"):
        open_image(str(with_line(tmp_path, text, "SAMP_DEN_COEFF_1", "1e-9")))
    for name in ("LAT_OFF", "LONG_OFF", "HEIGHT_OFF", "LINE_OFF", "SAMP_SCALE", "HEIGHT_SCALE"):
        with pytest.raises(InputError, match=rf"b_RPC.TXT: {name} is 7e\+11, which is not possible"):
            open_image(str(with_line(tmp_path, text, name, "7e+11")))


@pytest.mark.parametrize("offset", [2**64 - 1, 2**63, 2**40])
def test_a_directory_that_lies_nowhere(tmp_path: Path, offset: int) -> None:
    """BigTIFF: the first of them found by coverage-guided fuzzing."""
    path = tmp_path / "a.tif"
    path.write_bytes(struct.pack("<2sHHHQ", b"II", 43, 8, 0, offset))
    with pytest.raises(InputError, match=r"a.tif: the TIFF directory is cut short or damaged"):
        read_directory(str(path))


# ---- what HRSI itself keeps ----------------------------------------------------------------------------------------


def test_kept_results_that_are_none(tmp_path: Path) -> None:
    """They are made again: too large, compressed (which could unfold to anything), of a method that Python lacks."""
    parts = PartStore(str(tmp_path))
    parts.save("part", {"a": np.arange(5)})
    path = tmp_path / "part.npz"
    sound = path.read_bytes()
    assert parts.load("part") is not None
    method = sound.index(b"PK\x01\x02") + 10
    for name, content in (
        ("method", sound[:method] + b"\x63" + sound[method + 1 :]),
        ("cut", sound[:-40]),
        ("pickle", b"\x80\x04\x95"),
    ):
        path.write_bytes(content)
        assert parts.load("part") is None, name
    np.savez_compressed(path, a=np.zeros(10))
    assert parts.load("part") is None
    with open(path, "wb") as file:
        file.truncate(budgets.MOST_BYTES["result"] + 1)
    assert parts.load("part") is None


def test_a_list_that_names_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list.txt").write_text("a.tif\n@list.txt\n")
    with pytest.raises(InputError, match=r"list.txt: names the list @list.txt"):
        resolve_images(["@list.txt"], print)
    with open(tmp_path / "long.txt", "wb") as file:
        file.truncate(budgets.MOST_BYTES["names"] + 1)
    with pytest.raises(InputError, match=r"long.txt: has 32 MiB, more than a file of names can have"):
        resolve_images(["@long.txt"], print)


def test_a_report_nested_without_end(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text('{"schema": 1, "algorithm": ' + "[" * 200_000)
    assert names_of_last_run(str(tmp_path)) == set()


@pytest.mark.fuzz
@pytest.mark.wrong_inputs
def test_damaged_files_through_every_reader(tmp_path: Path, repository: Path) -> None:
    """Some hundred; under ``make fuzz`` ten thousand. A process of its own, without threads, because it forks."""
    runs = 120 if settings().max_examples <= 1000 else 10_000
    data, kept = str(TEST_DATA) if TEST_DATA.is_dir() else "-", str(tmp_path / "kept")
    command = [sys.executable, str(repository / "tests" / "damaged_files.py"), str(runs), "7", data, kept]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | threads)
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
