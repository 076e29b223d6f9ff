"""More folders as people have them: other deliveries, exports of other programs, and files that do not belong there."""

import json
import os
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import folders
import pyproj
from osgeo import gdal

from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.processing_algorithms import run

MEASURED_FIELDS = ["id", "image", "sample", "line"]


def zip_beside_delivery(source: folders.Source, folder: Path) -> None:
    """A delivery that was unpacked beside its archive."""
    folders.maxar_delivery(source, folder)
    with zipfile.ZipFile(folder / "050123456010_01.zip", "w") as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file() and "050123456010_01_P00" in path.parent.name:
                archive.write(path, Path("050123456010_01") / path.relative_to(folder))


def zip_alone(source: folders.Source, folder: Path) -> None:
    """A delivery that is still an archive, with points beside it."""
    zip_beside_delivery(source, folder)
    for path in list(folder.iterdir()):
        if path.is_dir():
            shutil.rmtree(path)


def airbus_volumes(source: folders.Source, folder: Path) -> None:
    """Two volumes of a DIMAP order, with previews, masks and icons."""
    folders.airbus_delivery(source, folder)
    (folder / "DEM").mkdir()
    shutil.move(folder / "dem.tif", folder / "DEM" / "dem.tif")
    for number in (1, 2):
        volume = folder / f"VOL_{number}"
        volume.mkdir()
        shutil.move(folder / "IMG_PHR1A_P" / f"IMG_PHR1A_P_00{number}", volume / f"IMG_PHR1A_P_00{number}")
        shutil.copy(folder / "VOL_PHR.XML", volume)
        place = volume / f"IMG_PHR1A_P_00{number}"
        scene = next(place.glob("DIM_*.XML")).stem.removeprefix("DIM_")
        for name in ("PREVIEW", "ICON"):
            gdal.Translate(str(place / f"{name}_{scene}.JPG"), str(source.images[0]), format="JPEG", width=64,
                           height=64, outputType=gdal.GDT_Byte, scaleParams=[[]])  # fmt: skip
        (place / "MASKS").mkdir()
        (place / "MASKS" / f"ROI_{scene}_MSK.GML").write_text(
            "<?xml version='1.0'?><Mask xmlns:gml='http://www.opengis.net/gml'></Mask>"
        )
    shutil.rmtree(folder / "IMG_PHR1A_P")
    (folder / "VOL_PHR.XML").unlink()


def excel_with_units(source: folders.Source, folder: Path) -> None:
    """Excel's CSV: BOM, semicolons, decimal commas, units in the header, a title above it, an empty last column."""
    folders.copy(source, folder, gcps=False)
    lines = ["Passpunkte Los 3;;;;", "Pkt.-Nr.;Rechtswert [m];Hochwert [m];Höhe ü. Ell. [m];"]
    for row in folders.in_utm(source.ground):
        lines.append(";".join([row["id"], *(row[key].replace(".", ",") for key in ("x", "y", "height")), ""]))
    (folder / "Passpunkte.csv").write_text("\r\n".join(lines) + "\r\n", encoding="utf-8-sig")
    folders.write_measured(source, folder)


def comments_and_units(source: folders.Source, folder: Path) -> None:
    """A survey's CSV with comments, and units in the header."""
    folders.copy(source, folder)
    text = "# static GNSS, 2024-06-01\n# WGS 84, ellipsoidal\nPoint,Longitude (deg),Latitude (deg),Height (m),Remark\n"
    for row in source.ground:
        text += f"{row['id']},{row['lon']},{row['lat']},{row['height']},corner of wall\n"
    (folder / "gcps.csv").write_text(text)


def ids_with_blanks(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, gcps=False)
    ground, measured = ([{**row, "id": f"Point No. {row['id']} (b)"} for row in rows]
                        for rows in (source.ground, source.measured))  # fmt: skip
    folders.write_csv(folder / "gcps.csv", ground, ["id", "lon", "lat", "height"])
    folders.write_csv(folder / "measured.csv", measured, ["id", "image", "sample", "line"])


def swapped_columns(source: folders.Source, folder: Path) -> None:
    """Longitudes below ``lat``, latitudes below ``lon``."""
    folders.copy(source, folder)
    folders.write_csv(
        folder / "gcps.csv", source.ground, ["id", "lat", "lon", "height"], header=["id", "lon", "lat", "height"]
    )


def lambert_shapefile(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, gcps=False)
    folders.write_vector(folder / "points_appui.shp", folders.in_utm(source.ground, 2154), "ESRI Shapefile", 2154)
    folders.write_measured(source, folder)


def lambert_text(source: folders.Source, folder: Path) -> None:
    """A CSV in the national grid, which it does not name."""
    folders.copy(source, folder, gcps=False)
    folders.write_csv(folder / "points_appui.csv", folders.in_utm(source.ground, 2154), ["id", "x", "y", "height"], ";",
              header=["Matricule", "X", "Y", "Z"])  # fmt: skip
    folders.write_measured(source, folder)


def dem_tiles(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, dem=False)
    write_tiles(source, folder)


def write_tiles(source: folders.Source, folder: Path) -> list[str]:
    whole = gdal.Open(str(source.folder / "dem.tif"))
    width, height = whole.RasterXSize // 2, whole.RasterYSize // 2
    paths = []
    for row in (0, 1):
        for column in (0, 1):
            paths.append(str(folder / f"dtm_{row}_{column}.tif"))
            gdal.Translate(paths[-1], whole, srcWin=[column * width, row * height, width, height])
    return paths


def dem_tiles_in_vrt(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, dem=False)
    (folder / "tiles").mkdir()
    gdal.BuildVRT(str(folder / "dtm.vrt"), write_tiles(source, folder / "tiles"))


def dem_alone(source: folders.Source, folder: Path) -> None:
    folder.mkdir(parents=True)
    shutil.copy(source.folder / "dem.tif", folder)


def copernicus(source: folders.Source, folder: Path) -> None:
    """A tile of a global DEM as it is downloaded, GCPs without heights."""
    folders.copy(source, folder, dem=False)
    dem = folder / "Copernicus_DSM_COG_10_N43_00_E005_00_DEM.tif"
    folders.write_dem(source, dem, lambda h: h - folders.undulation(source), epsg=4326)
    folders.write_csv(folder / "gcps.csv", source.ground, ["id", "lon", "lat"])


def long_names(source: folders.Source, folder: Path) -> None:
    """Names of more than 100 characters, with blanks and umlauts."""
    folder = folder / "Projekt Größe (Endfassung)"
    folder.mkdir(parents=True)
    stem = "Aufnahme vom ersten Juni zweitausendvierundzwanzig über der Südseite des Hafengeländes in Grauwerten, Teil"
    for number, image in enumerate(source.images, start=1):
        shutil.copy(image, folder / f"{stem} {number}.tif")
    shutil.copy(source.folder / "dem.tif", folder / "Höhenmodell (neu).tif")
    folders.write_csv(folder / "Paßpunkte.csv", source.ground, ["id", "lon", "lat", "height"])
    rows = [{**row, "image": f"{stem} {row['image'][-1]}.tif"} for row in source.measured]
    folders.write_csv(folder / "Messungen im Bild.csv", [{**row, "image": f'"{row["image"]}"'} for row in rows],
              ["id", "image", "sample", "line"])  # fmt: skip


def symlinks(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, ())
    folders.write_measured(source, folder)
    for image in source.images:
        os.symlink(image, folder / image.name)


def one_broken_rpc(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, (0, 1))
    folders.write_measured(source, folder)
    third = source.images[2]
    folders.without_tag(third, folder / third.name)
    write_rpc_text(str(folder / f"{third.stem}_RPC.TXT"), read_rpc(str(third)).rpc)
    text = (folder / f"{third.stem}_RPC.TXT").read_text()
    (folder / f"{third.stem}_RPC.TXT").write_text(text[: len(text) // 2])


def two_rpcs_each(source: folders.Source, folder: Path) -> None:
    """Each image has its RPC in the tag and beside it, once equal and once with another offset."""
    folders.copy(source, folder)
    for number, image in enumerate(source.images):
        rpc = read_rpc(str(image)).rpc
        write_rpc_text(str(folder / f"{image.stem}_RPC.TXT"), rpc if number else rpc.shift(3.0, 0.0))
        write_rpc_text(str(folder / f"{image.stem}.RPB"), rpc, kind="rpb")


def jpeg2000(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, ())
    folders.write_csv(folder / "measured.csv", [{**row, "image": f"{row['image']}.JP2"} for row in source.measured],
              ["id", "image", "sample", "line"])  # fmt: skip
    for image in source.images:
        path = folder / f"{image.stem}.JP2"
        gdal.Translate(str(path), str(image), format="JP2OpenJPEG", creationOptions=["QUALITY=100", "REVERSIBLE=YES"])
        path.with_name(f"{path.name}.aux.xml").unlink(missing_ok=True)
        write_rpc_text(str(folder / f"{image.stem}.RPB"), read_rpc(str(image)).rpc, kind="rpb")


def quick_looks(source: folders.Source, folder: Path) -> None:
    """JPEGs and small TIFFs of the images beside them, papers, and files of the operating system."""
    folders.copy(source, folder)
    for image in source.images:
        for name, format_ in ((f"{image.stem}.jpg", "JPEG"), (f"{image.stem}_preview.tif", "GTiff"),
                              (f"{image.stem}_browse.png", "PNG")):  # fmt: skip
            gdal.Translate(str(folder / name), str(image), format=format_, width=64, height=64,
                           outputType=gdal.GDT_Byte, scaleParams=[[]])  # fmt: skip
    for name in ("Thumbs.db", "desktop.ini", ".DS_Store", "Lieferschein.pdf", "~$report.docx", "licence.docx"):
        (folder / name).write_bytes(b"\x00\x01binary")


def folders_of_kinds(source: folders.Source, folder: Path) -> None:
    """Folders for images, points and heights; paths of another computer in the measurements."""
    for name in ("01_images", "02_GCP", "03_DEM", "04_empty"):
        (folder / name).mkdir(parents=True)
    for image in source.images:
        shutil.copy(image, folder / "01_images")
    shutil.copy(source.folder / "dem.tif", folder / "03_DEM")
    folders.write_csv(folder / "02_GCP" / "survey.csv", folders.in_utm(source.ground), ["id", "x", "y", "height"],
              header=["Name", "Easting", "Northing", "Elevation"])  # fmt: skip
    rows = [{**row, "image": f"C:\\Data\\Projekt\\{row['image']}.tif"} for row in source.measured]
    folders.write_csv(folder / "02_GCP" / "pixel.csv", rows, ["id", "image", "sample", "line"],
              header=["Name", "Image", "Pixel", "Line"])  # fmt: skip


def arcgis_table(source: folders.Source, folder: Path) -> None:
    """A table of ArcGIS: object ids first, POINT_X, POINT_Y, POINT_Z."""
    folders.copy(source, folder)
    rows = [{**row, "OBJECTID": str(k), "kind": "wall"} for k, row in enumerate(folders.in_utm(source.ground), start=1)]
    folders.write_csv(folder / "gcps.csv", rows, ["OBJECTID", "id", "kind", "x", "y", "height"],
              header=["OBJECTID", "GCP_ID", "Descr", "POINT_X", "POINT_Y", "POINT_Z"])  # fmt: skip


def one_file_of_everything(source: folders.Source, folder: Path) -> None:
    """A row for each measurement, with image and ground coordinates and a type."""
    folders.copy(source, folder, gcps=False)
    place = {row["id"]: row for row in source.ground}
    rows = [{**row, **place[row["id"]], "sample": row["sample"], "line": row["line"],
             "type": {"gcp": "control", "check": "check"}[place[row["id"]]["role"]]}
            for row in source.measured if row["id"] in place]  # fmt: skip
    folders.write_csv(folder / "points.csv", rows, ["id", "image", "sample", "line", "lon", "lat", "height", "type"])


def spreadsheet(source: folders.Source, folder: Path) -> None:
    """The GCPs are a spreadsheet in UTM, with German names."""
    folders.copy(source, folder)
    folders.write_csv(folder / "gcps.csv", folders.in_utm(source.ground), ["id", "x", "y", "height"],
              header=["Nummer", "Rechtswert", "Hochwert", "Hoehe"])  # fmt: skip
    table = gdal.OpenEx(str(folder / "gcps.csv"), open_options=["AUTODETECT_TYPE=YES"])
    gdal.VectorTranslate(str(folder / "gcps.xlsx"), table, format="XLSX")
    (folder / "gcps.csv").unlink()


def spreadsheets_only(source: folders.Source, folder: Path) -> None:
    """GCPs and measurements are spreadsheets, with a row for each point; the name of the heights is a compound."""
    folders.copy(source, folder, gcps=False)
    folders.write_csv(folder / "gcps.csv", source.ground, ["id", "lon", "lat", "height"],
              header=["name", "longitude", "latitude", "Ellipsoidhöhe"])  # fmt: skip
    folders.write_matrix(source, folder / "mesures.csv")
    for name, driver in (("gcps", "XLSX"), ("mesures", "ODS")):
        table = gdal.OpenEx(str(folder / f"{name}.csv"), open_options=["AUTODETECT_TYPE=YES"])
        gdal.VectorTranslate(str(folder / f"{name}.{driver.lower()}"), table, format=driver)
        (folder / f"{name}.csv").unlink()


def gps_waypoints(source: folders.Source, folder: Path) -> None:
    """The GCPs are waypoints of a receiver: a GPX file of five layers, four of them empty."""
    folders.copy(source, folder)
    (folder / "gcps.csv").unlink()
    points = [f'<wpt lat="{row["lat"]}" lon="{row["lon"]}"><ele>{row["height"]}</ele><name>{row["id"]}</name></wpt>'
              for row in source.ground]  # fmt: skip
    head = '<gpx version="1.1" creator="receiver" xmlns="http://www.topografix.com/GPX/1/1">'
    (folder / "waypoints.gpx").write_text(f'<?xml version="1.0"?>{head}{"".join(points)}</gpx>')


def orthometric_control_without_dem(source: folders.Source, folder: Path) -> None:
    """Heights above the geoid, as the header says, and no DEM: orthoimages take the heights of the adjusted points."""
    folders.copy(source, folder, dem=False)
    above = folders.undulation(source)
    rows = [{**row, "height": f"{float(row['height']) - above:.3f}"} for row in source.ground]
    folders.write_csv(folder / "gcps.csv", rows, ["id", "lon", "lat", "height"], header=["id", "lon", "lat", "H egm96"])


def geocentric(source: folders.Source, folder: Path) -> None:
    """X, Y, Z of GNSS software."""
    folders.copy(source, folder)
    to_xyz = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    places = [to_xyz.transform(*(float(row[name]) for name in ("lon", "lat", "height"))) for row in source.ground]
    rows = [{"id": row["id"], **dict(zip("xyz", map("{:.4f}".format, xyz), strict=True))}
            for row, xyz in zip(source.ground, places, strict=True)]  # fmt: skip
    folders.write_csv(folder / "gcps.csv", rows, ["id", "x", "y", "z"], header=["Punkt", "X", "Y", "Z"])


def swapped_geojson(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder)
    (folder / "gcps.csv").unlink()
    rows = [{**row, "lon": row["lat"], "lat": row["lon"]} for row in source.ground]
    folders.write_vector(folder / "gcps.geojson", rows, "GeoJSON")


def next_zone(source: folders.Source, folder: Path) -> None:
    """Eastings and northings of the neighbouring zone, whose CRS the layer states wrongly."""
    folders.copy(source, folder)
    (folder / "gcps.csv").unlink()
    rows = [{**row, "lon": str(float(row["lon"]) + 6.0)} for row in source.ground]
    folders.write_vector(folder / "gcps.geojson", rows, "GeoJSON")


def thousands(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder)
    text = (folder / "gcps.csv").read_text().replace(source.ground[0]["height"], '"1,234.5"')
    (folder / "gcps.csv").write_text(text)


def cut_row(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder)
    text = (folder / "measured.csv").read_text().rstrip()
    (folder / "measured.csv").write_text(text[: text.rindex(",")])


def foreign_fields(source: folders.Source, folder: Path) -> None:
    """A Shapefile of points without .prj, with other names of fields, in the national grid."""
    folders.copy(source, folder, gcps=False)
    rows = folders.in_utm(source.ground, 2154)
    folders.write_vector(folder / "points.shp", rows, "ESRI Shapefile", 2154)
    table = gdal.OpenEx(str(folder / "points.shp"), gdal.OF_VECTOR | gdal.OF_UPDATE)
    for old, new in (("id", "MATRICULE"), ("height", "ALT_M")):
        table.ExecuteSQL(f"ALTER TABLE points RENAME COLUMN {old} TO {new}")
    del table
    (folder / "points.prj").unlink()
    folders.write_measured(source, folder)


def kml_placemarks(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder)
    marks = "".join(
        f"<Placemark><name>{row['id']}</name><Point><coordinates>{row['lon']},{row['lat']},{row['height']}"
        "</coordinates></Point></Placemark>" for row in source.ground
    )  # fmt: skip
    (folder / "gcps.csv").unlink()
    (folder / "gcps.kml").write_text(
        f'<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>{marks}</Document></kml>'
    )


def georeferencer_with_crs(source: folders.Source, folder: Path) -> None:
    """Points of QGIS 3.26 and later: a CRS in the first line, in UTM."""
    folders.copy(source, folder, (0,), gcps=False)
    place = {row["id"]: row for row in folders.in_utm(source.ground)}
    crs = gdal.Open(str(source.folder / "dem.tif")).GetSpatialRef()
    crs.ImportFromEPSG(32631)
    lines = [f"#CRS: {crs.ExportToWkt(['FORMAT=WKT2_2019'])}", "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual"]
    for row in (row for row in source.measured if row["image"] == source.images[0].stem):
        at = place[row["id"]]
        lines.append(f"{at['x']},{at['y']},{float(row['sample']) + 0.5},{-float(row['line']) - 0.5},1,0,0,0")
    (folder / f"{source.images[0].stem}.points").write_text("\n".join(lines) + "\n")


def nitf(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, ())
    folders.write_measured(source, folder)
    for image in source.images:
        gdal.Translate(str(folder / f"{image.stem}.ntf"), str(image), format="NITF")


def mixed_sensors(source: folders.Source, folder: Path) -> None:
    """One of the images has pixels of twice the size."""
    folders.copy(source, folder, (0, 1))
    coarse = folder.parent / f"{folder.name}_coarse"
    run("crop", images=[str(source.images[2])], factor=0.5, output_dir=str(coarse), overwrite=True)
    shutil.copy(next(coarse.glob("*.tif")), folder / "coarse.tif")
    rows = [row for row in source.measured if row["image"] != source.images[2].stem]
    for row in source.measured:
        if row["image"] == source.images[2].stem:
            place = {axis: str((float(row[axis]) + 0.5) / 2.0 - 0.5) for axis in ("sample", "line")}
            rows.append({**row, "image": "coarse", **place})
    folders.write_csv(folder / "measured.csv", rows, ["id", "image", "sample", "line"])


def orthoimage_with_rpc_left(source: folders.Source, folder: Path) -> None:
    """A vendor's orthoimage of one of the images, 8 bit in three bands, beside the images."""
    folders.copy(source, folder)
    gdal.Translate(str(folder / "ortho_vendor.tif"), str(source.folder / "free_ortho.tif"), bandList=[1, 1, 1],
                   outputType=gdal.GDT_Byte, scaleParams=[[]])  # fmt: skip


def ascii_dem_without_crs(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, dem=False)
    gdal.Translate(str(folder / "dtm.asc"), str(source.folder / "dem.tif"), format="AAIGrid")
    for one in folder.glob("dtm*.xml"):
        one.unlink()
    (folder / "dtm.prj").unlink(missing_ok=True)


def points_not_measured(source: folders.Source, folder: Path) -> None:
    """GCPs that nobody has measured in an image yet."""
    folders.copy(source, folder)
    (folder / "measured.csv").unlink()


def two_surveys(source: folders.Source, folder: Path) -> None:
    """Two surveys with the same numbers for other points, of which one was measured."""
    folders.copy(source, folder)
    moved = [{**row, "lon": str(float(row["lon"]) + 0.0007)} for row in source.ground]
    folders.write_csv(folder / "gcps_2019.csv", moved, ["id", "lon", "lat", "height"])


def holes_and_zeros(source: folders.Source, folder: Path) -> None:
    """A DEM with undeclared -32768, in another zone, geoid heights; points as text with tabs."""
    folders.copy(source, folder, dem=False, gcps=False)
    folders.write_dem(source, folder / "mnt.tif", lambda h: h - folders.undulation(source), epsg=32632)
    dataset = gdal.Open(str(folder / "mnt.tif"), gdal.GA_Update)
    band = dataset.GetRasterBand(1)
    band.WriteArray(folders.with_holes(band.ReadAsArray(), -32768.0))
    band.DeleteNoDataValue()
    folders.write_csv(folder / "gcp.txt", source.ground, ["id", "lat", "lon", "height"], "\t",
              header=["Nom", "Latitude", "Longitude", "Altitude"])  # fmt: skip
    folders.write_csv(folder / "mesures.txt", source.measured, ["image", "id", "line", "sample"], "\t",
              header=["image", "point", "ligne", "colonne"])  # fmt: skip


def _rows_of_image(source: folders.Source, number: int) -> list[folders.Row]:
    """Return the measurements in an image with their ground positions in UTM; most points are in several images."""
    place = {row["id"]: row for row in folders.in_utm(source.ground)}
    rows = [row for row in source.measured if row["image"] == source.images[number].stem]
    return [{**place[row["id"]], **row} for k, row in enumerate(rows) if k % 6 != number]


def csv_per_image_with_pixels(source: folders.Source, folder: Path) -> None:
    """A CSV for each image with ground positions and pixels; names of fields that others use."""
    folders.copy(source, folder, gcps=False)
    for number in range(3):
        rows = _rows_of_image(source, number)
        folders.write_csv(folder / f"image_{number + 1}.csv", rows, ["id", "sample", "line", "lon", "lat", "height"],
                  header=["Name", "px", "py", "Longitude", "Latitude", "Elev"])  # fmt: skip


def text_per_image_with_pixels(source: folders.Source, folder: Path) -> None:
    """Rows of id, easting, northing, height, column, row, without header."""
    folders.copy(source, folder, gcps=False)
    for number in range(3):
        fields = ["id", "x", "y", "height", "sample", "line"]
        folders.write_csv(
            folder / f"image_{number + 1}_gcp.txt", _rows_of_image(source, number), fields, " ", header=[]
        )


def geojson_per_image_with_pixels(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, gcps=False)
    for number in range(3):
        features = [
            {"type": "Feature", "geometry": {"type": "Point", "coordinates": [float(row["lon"]), float(row["lat"])]},
             "properties": {"name": row["id"], "u": float(row["sample"]), "v": float(row["line"]),
                            "z_ell": float(row["height"])}}
            for row in _rows_of_image(source, number)
        ]  # fmt: skip
        text = json.dumps({"type": "FeatureCollection", "features": features})
        (folder / f"gcps_image_{number + 1}.geojson").write_text(text)


def heights_of_zero(source: folders.Source, folder: Path) -> None:
    """GCPs whose heights are 0, as programs write points without a height, beside a DEM."""
    folders.copy(source, folder)
    rows = [{**row, "height": "0"} for row in source.ground]
    folders.write_csv(folder / "gcps.csv", rows, ["id", "lon", "lat", "height"])


def lines_upwards(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder)
    rows = [{**row, "line": str(-float(row["line"]))} for row in source.measured]
    folders.write_csv(
        folder / "measured.csv", rows, ["id", "image", "sample", "line"], header=["id", "image", "x", "y"]
    )


def ids_with_zeros(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder)
    number = {row["id"]: k + 1 for k, row in enumerate(source.ground)}
    for name, fields, width in (("gcps", ["id", "lon", "lat", "height"], 1), ("measured", MEASURED_FIELDS, 3)):
        rows = [{**row, "id": str(number[row["id"]]).zfill(width)}
                for row in (source.ground if name == "gcps" else source.measured)]  # fmt: skip
        folders.write_csv(folder / f"{name}.csv", rows, fields)


def measured_at_half_size(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder)
    half = {axis: lambda text: str(float(text) / 2.0) for axis in ("sample", "line")}
    rows = [{key: half[key](text) if key in half and row["image"] == source.images[2].stem else text
             for key, text in row.items()} for row in source.measured]  # fmt: skip
    folders.write_csv(folder / "measured.csv", rows, MEASURED_FIELDS)


def heights_in_feet(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder, dem=False)
    rows = [{**row, "height": str(float(row["height"]) / 0.3048)} for row in source.ground]
    folders.write_csv(folder / "gcps.csv", rows, ["id", "lon", "lat", "height"])


def images_by_number(source: folders.Source, folder: Path) -> None:
    """Measurements whose images are 1, 2, 3."""
    folders.copy(source, folder)
    rows = [{**row, "image": row["image"][-1]} for row in source.measured]
    folders.write_csv(folder / "measured.csv", rows, MEASURED_FIELDS, header=["id", "img", "col", "row"])


def png_with_rpc_file(source: folders.Source, folder: Path) -> None:
    """Images of 8 bit as PNG, with an RPC of the same stem that GDAL does not read beside PNG."""
    folders.copy(source, folder, ())
    folders.write_measured(source, folder)
    for image in source.images:
        gdal.Translate(str(folder / f"{image.stem}.png"), str(image), outputType=gdal.GDT_Byte, scaleParams=[[]])
        write_rpc_text(str(folder / f"{image.stem}.rpc"), read_rpc(str(image)).rpc)
        for one in folder.glob("*.aux.xml"):
            one.unlink()


def repeated_id(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder)
    moved = {**source.ground[0], "lon": str(float(source.ground[0]["lon"]) + 1e-3)}
    folders.write_csv(folder / "gcps.csv", [*source.ground, moved], ["id", "lon", "lat", "height"])


def damaged_number(source: folders.Source, folder: Path) -> None:
    folders.copy(source, folder)
    text = (folder / "measured.csv").read_text()
    (folder / "measured.csv").write_text(text.replace(source.measured[0]["line"], "12O.5"))


#: Folders with a mistake, and what is said of it.
MISTAKES: dict[Callable[[folders.Source, Path], None], tuple[str, str]] = {
    lines_upwards: ("lines are negative, counted upwards", "change the sign of the lines"),
    ids_with_zeros: ("'1' is measured as '001'", "use the same ids in both files"),
    measured_at_half_size: ("pixels twice as large on image image_3", "measure on the image itself"),
    repeated_id: ("gcps.csv, line 20 (id 'C000001'): occurs in line 2 already", "keep one, or rename it"),
    damaged_number: ("field 'line', line 2: '12O.5' is not a number", "correct it"),
    heights_in_feet: ("are in feet", "give heights in metres"),
    swapped_geojson: ("longitude and latitude are exchanged", "exchange"),
    next_zone: ("the UTM zone is 1 too far east", "correct the CRS"),
    thousands: ("line 2: '1,234.5' is not a number", "correct it"),
    cut_row: ("field 'line' is empty", "fill it in"),
}

CLIENT_FOLDERS: tuple[Callable[[folders.Source, Path], None], ...] = (
    zip_beside_delivery, zip_alone, airbus_volumes, excel_with_units, comments_and_units, ids_with_blanks,
    swapped_columns, lambert_shapefile, lambert_text, dem_tiles, dem_tiles_in_vrt, dem_alone, copernicus, long_names,
    symlinks, one_broken_rpc, two_rpcs_each, jpeg2000, quick_looks, folders_of_kinds, arcgis_table,
    one_file_of_everything, spreadsheet, foreign_fields, kml_placemarks, georeferencer_with_crs, nitf, mixed_sensors,
    orthoimage_with_rpc_left, ascii_dem_without_crs, points_not_measured, two_surveys, holes_and_zeros,
    csv_per_image_with_pixels, text_per_image_with_pixels, geojson_per_image_with_pixels, heights_of_zero,
    images_by_number, png_with_rpc_file, spreadsheets_only, gps_waypoints, orthometric_control_without_dem,
    geocentric,
)  # fmt: skip
