"""Folders as people have them: one simulated block, its files written as clients and programs write them."""

import csv
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import deliveries
import numpy as np
from gdal_files import write_layer, write_raster
from osgeo import gdal, ogr, osr

from hrsi.hrsi_engine.ground.geoids import geoid_heights
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.hrsi_engine.io.rpc_files.text_formats import geom_text
from hrsi.hrsi_engine.io.rpc_files.xml_formats import isd_text
from hrsi.processing_algorithms import run

Row = dict[str, str]
CROP = 300, 200  #: sample and line of a crop's first pixel in its scene


@dataclass(frozen=True)
class Source:
    """A simulated block: its folder, and the rows of its ground points and image points."""

    folder: Path
    ground: list[Row]
    measured: list[Row]

    @property
    def images(self) -> list[Path]:
        return sorted(self.folder.glob("image_?.tif"))


def simulate(folder: Path) -> Source:
    """Return the block: three small images, 6 GCPs, 12 check points, ellipsoidal heights near 50 m of undulation."""
    run(
        "simulate", images=3, along="-12,0,12", size=256, gcps=6, checks=12, ties=0, relief=60.0, free_ortho=1.0,
        laser_passes=2, ms=True, output_dir=str(folder),
    )  # fmt: skip
    ground, measured = (list(csv.DictReader((folder / f"{name}.csv").open())) for name in
                        ("ground_points", "image_points"))  # fmt: skip
    return Source(folder, ground, measured)


# ---- parts -----------------------------------------------------------------------------------------------------------


def copy(source: Source, folder: Path, images: Sequence[int] = (0, 1, 2), dem: bool = True, gcps: bool = True) -> None:
    """Copy some images, the DEM, and the points as they were simulated."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in images:
        shutil.copy(source.images[number], folder)
    if dem:
        shutil.copy(source.folder / "dem.tif", folder)
    if gcps:
        write_csv(folder / "gcps.csv", source.ground, ["id", "lon", "lat", "height"])
        write_measured(source, folder, images)


def write_measured(source: Source, folder: Path, images: Sequence[int] = (0, 1, 2)) -> None:
    """Write the measurements in some images as one CSV."""
    names = {source.images[number].stem for number in images}
    rows = [row for row in source.measured if row["image"] in names]
    write_csv(folder / "measured.csv", rows, ["id", "image", "sample", "line"])


def write_csv(path: Path, rows: Sequence[Row], fields: Sequence[str], separator: str = ",", encoding: str = "utf-8",
              header: Sequence[str] | None = None) -> None:  # fmt: skip
    """Write fields of rows, numbers with decimal commas where semicolons separate."""
    lines = [separator.join(header or fields)] if header != [] else []
    for row in rows:
        texts = [row[field] for field in fields]
        lines.append(separator.join(text.replace(".", ",") if separator == ";" else text for text in texts))
    path.write_text("\n".join(lines) + "\n", encoding=encoding)


def in_utm(rows: Sequence[Row], epsg: int = 32631) -> list[Row]:
    """Return rows with x and y in a projected CRS."""
    source, target = osr.SpatialReference(), osr.SpatialReference()
    source.ImportFromEPSG(4326)
    target.ImportFromEPSG(epsg)
    for one in (source, target):
        one.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
    transform = osr.CoordinateTransformation(source, target)
    found = [transform.TransformPoint(float(row["lon"]), float(row["lat"])) for row in rows]
    return [{**row, "x": f"{x:.3f}", "y": f"{y:.3f}"} for row, (x, y, _) in zip(rows, found, strict=True)]


def write_vector(path: Path, rows: Sequence[Row], driver: str, epsg: int = 4326) -> None:
    """Write ground points as a vector layer with the fields id and height."""
    axes = ("lon", "lat") if epsg == 4326 else ("x", "y")
    plan = np.array([[float(row[axis]) for axis in axes] for row in rows])
    fields = {"id": [row["id"] for row in rows], "height": [float(row["height"]) for row in rows]}
    write_layer(path, driver, f"EPSG:{epsg}", plan, fields, with_z=False, layer=path.stem)


def write_dem(source: Source, path: Path, change: Callable[[np.ndarray], np.ndarray], nodata: float | None = None,
              epsg: int | None = None) -> None:  # fmt: skip
    """Write the DEM with other heights, in another projected CRS if ``epsg`` names one."""
    dataset = gdal.GetDriverByName("MEM").CreateCopy("", gdal.Open(str(source.folder / "dem.tif")))
    band = dataset.GetRasterBand(1)
    band.DeleteNoDataValue()
    band.WriteArray(change(band.ReadAsArray().astype(np.float32)))
    if epsg is not None:
        dataset = gdal.Warp("", dataset, format="MEM", dstSRS=f"EPSG:{epsg}", dstNodata=-32768.0,
                            resampleAlg="bilinear")  # fmt: skip
    made = (
        gdal.Translate(str(path), dataset, noData=nodata) if nodata is not None else gdal.Translate(str(path), dataset)
    )
    del made


def undulation(source: Source) -> float:
    """Return the undulation of the geoid at the block, m."""
    row = source.ground[0]
    return float(geoid_heights(np.array([[float(row["lon"]), float(row["lat"]), 0.0]]), "egm96")[0])


def with_holes(heights: np.ndarray, value: float) -> np.ndarray:
    """Return heights with gaps of a few cells."""
    changed = heights.copy()
    for row, column in np.random.default_rng(3).integers(20, np.array(heights.shape) - 24, (12, 2)):
        changed[row : row + 3, column : column + 4] = value
    return changed


def without_tag(source: Path, target: Path) -> None:
    """Write an image without its RPC."""
    write_raster(target, gdal.Open(str(source)).ReadAsArray())


# ---- folders ---------------------------------------------------------------------------------------------------------


def as_simulated(source: Source, folder: Path) -> None:
    copy(source, folder)


def text_without_header(source: Source, folder: Path) -> None:
    copy(source, folder, dem=False, gcps=False)
    write_dem(source, folder / "dem.tif", lambda h: with_holes(h, -9999.0))
    write_csv(folder / "points.txt", source.ground, ["id", "lat", "lon", "height"], " ", header=[])
    write_csv(folder / "measured.txt", source.measured, ["id", "image", "sample", "line"], " ", header=[])


def geopackage_and_file_per_image(source: Source, folder: Path) -> None:
    copy(source, folder, gcps=False)
    write_vector(folder / "survey.gpkg", source.ground, "GPKG")
    for image in source.images:
        rows = [row for row in source.measured if row["image"] == image.stem]
        write_csv(folder / f"{image.stem}_points.txt", rows, ["id", "sample", "line"], "\t", header=[])


def shapefile_and_orthometric_dem(source: Source, folder: Path) -> None:
    copy(source, folder, dem=False)
    (folder / "gcps.csv").unlink()
    write_vector(folder / "punkte.shp", in_utm(source.ground), "ESRI Shapefile", 32631)
    write_dem(source, folder / "dtm.tif", lambda h: h - undulation(source), epsg=32632)


def geojson_and_nan(source: Source, folder: Path) -> None:
    copy(source, folder, dem=False)
    (folder / "gcps.csv").unlink()
    write_vector(folder / "gcps.geojson", source.ground, "GeoJSON")
    write_dem(source, folder / "dem.tif", lambda h: with_holes(h, np.nan))


def excel(source: Source, folder: Path) -> None:
    copy(source, folder, gcps=False)
    write_csv(folder / "Passpunkte.csv", in_utm(source.ground), ["id", "x", "y", "height"], ";", "utf-8-sig",
              ["Punkt", "Rechtswert", "Hochwert", "Höhe"])  # fmt: skip
    write_measured(source, folder)


def degrees_minutes_seconds(source: Source, folder: Path) -> None:
    copy(source, folder)

    def spell(value: str, positive: str) -> str:
        degrees = float(value)
        minutes = (degrees - int(degrees)) * 60.0
        return f"{int(degrees)}°{int(minutes):02d}'{(minutes - int(minutes)) * 60.0:08.5f}\"{positive}"

    rows = [{**row, "lon": spell(row["lon"], "E"), "lat": spell(row["lat"], "N")} for row in source.ground]
    write_csv(folder / "gcps.csv", rows, ["id", "lat", "lon", "height"])


def georeferencer(source: Source, folder: Path) -> None:
    copy(source, folder, gcps=False)
    place = {row["id"]: row for row in source.ground}
    for image in source.images:
        lines = ["mapX,mapY,sourceX,sourceY,enable,dX,dY,residual"]
        for row in (row for row in source.measured if row["image"] == image.stem):
            at = place[row["id"]]
            lines.append(f"{at['lon']},{at['lat']},{float(row['sample']) + 0.5},{-float(row['line']) - 0.5},1,0,0,0")
        (folder / f"{image.name}.points").write_text("\n".join(lines) + "\n")


def control_and_check_apart(source: Source, folder: Path) -> None:
    copy(source, folder, gcps=False)
    for role, name in (("gcp", "control"), ("check", "check")):
        rows = [row for row in source.ground if row["role"] == role]
        write_csv(folder / f"{name}_points.csv", rows, ["id", "lon", "lat", "height"])
    write_matrix(source, folder / "measured.csv")


def write_matrix(source: Source, path: Path) -> None:
    """Write a row for each point, with columns for each image."""
    place = {(row["id"], row["image"]): row for row in source.measured}
    names = [image.stem for image in source.images]
    lines = [",".join(["id", *(f"{name}_{axis}" for name in names for axis in ("col", "row"))])]
    for one in source.ground:
        found = [place.get((one["id"], name)) for name in names]
        lines.append(",".join([one["id"], *(f"{row['sample']},{row['line']}" if row else "," for row in found)]))
    path.write_text("\n".join(lines) + "\n")


def role_column(source: Source, folder: Path) -> None:
    copy(source, folder)
    words = {"gcp": "Ground control", "check": "independent check"}
    rows = [{**row, "remarks": words[row["role"]], "enabled": "yes"} for row in source.ground]
    write_csv(folder / "gcps.csv", rows, ["id", "remarks", "lon", "lat", "height", "enabled"])


def rpc_files_alone(source: Source, folder: Path) -> None:
    copy(source, folder, (), dem=False)
    write_measured(source, folder)
    for image in source.images:
        write_rpc_text(str(folder / f"{image.stem}_RPC.TXT"), read_rpc(str(image)).rpc)


def side_files(source: Source, folder: Path) -> None:
    copy(source, folder, (2,))
    write_measured(source, folder)
    first, second, _ = source.images
    without_tag(first, folder / first.name)
    write_rpc_text(str(folder / f"{first.stem}_RPC.TXT"), read_rpc(str(first)).rpc)
    without_tag(second, folder / second.name)
    gdal.Open(str(folder / second.name)).SetMetadata(gdal.Open(str(second)).GetMetadata("RPC"), "RPC")  # .aux.xml


def virtual_and_cloud_optimised(source: Source, folder: Path) -> None:
    copy(source, folder, (2,))
    write_measured(source, folder)
    (folder / "pixels").mkdir()
    first, second, _ = source.images
    without_tag(first, folder / "pixels" / "raw.tif")
    made = gdal.Translate(str(folder / f"{first.stem}.vrt"), str(folder / "pixels" / "raw.tif"), format="VRT")
    made.SetMetadata(gdal.Open(str(first)).GetMetadata("RPC"), "RPC")
    del made
    gdal.Translate(str(folder / second.name), str(second), format="COG")


def orthometric_dem_without_control(source: Source, folder: Path) -> None:
    copy(source, folder, dem=False, gcps=False)
    write_dem(source, folder / "dem.tif", lambda h: h - undulation(source), epsg=32632)


def without_control(source: Source, folder: Path) -> None:
    copy(source, folder, gcps=False)


def images_alone(source: Source, folder: Path) -> None:
    copy(source, folder, dem=False, gcps=False)


def one_image_with_control(source: Source, folder: Path) -> None:
    copy(source, folder, (0,))


def one_image_alone(source: Source, folder: Path) -> None:
    copy(source, folder, (0,), dem=False, gcps=False)


def rpb_beside_images(source: Source, folder: Path) -> None:
    copy(source, folder, ())
    write_measured(source, folder)
    for image in source.images:
        without_tag(image, folder / image.name)
        write_rpc_text(str(folder / f"{image.stem}.RPB"), read_rpc(str(image)).rpc, kind="rpb")


def geom_beside_crops(source: Source, folder: Path) -> None:
    """Crops whose files place them in their scenes, of which the ``.geom`` files are."""
    copy(source, folder, ())
    write_measured(source, folder)
    for image in source.images:
        scene = read_rpc(str(image)).rpc.shift(*CROP)
        without_tag(image, folder / image.name)
        gdal.Open(str(folder / image.name), gdal.GA_Update).SetGeoTransform((CROP[0], 1, 0, CROP[1], 0, 1))
        (folder / f"{image.stem}.geom").write_text(geom_text(scene))


def panchromatic_and_multispectral(source: Source, folder: Path) -> None:
    copy(source, folder)
    for image in source.images:
        shutil.copy(image.with_name(f"{image.stem}_ms.tif"), folder)


def maxar_delivery(source: Source, folder: Path) -> None:
    """Two products of an order, PAN and MUL each, with all files that come with them; points of the client."""
    rename = {}
    for number, image in enumerate(source.images[:2], start=1):
        for kind, letter, pixels in (("PAN", "P", image), ("MUL", "M", image.with_name(f"{image.stem}_ms.tif"))):
            place = folder / f"050123456010_01_P00{number}_{kind}"
            stem = f"24JUN0{number}1030{number}7-{letter}1BS-050123456010_01_P00{number}"
            if kind == "PAN":
                rename[image.stem] = stem
            write_product(pixels, place, stem, kind)
    shapes = folder / "GIS_FILES"
    shapes.mkdir()
    write_area(source, shapes / "050123456010_01_ORDER_SHAPE.shp")
    (folder / "050123456010_01_README.TXT").write_text("BEGIN_GROUP = README\n\tcopyright = none;\nEND_GROUP\nEND;\n")
    write_csv(folder / "gcps.csv", source.ground, ["id", "lon", "lat", "height"])
    rows = [{**row, "image": rename[row["image"]]} for row in source.measured if row["image"] in rename]
    write_csv(folder / "measured.csv", rows, ["id", "image", "sample", "line"])
    shutil.copy(source.folder / "dem.tif", folder)


def write_product(pixels: Path, folder: Path, stem: str, kind: str) -> None:
    """Write a product of Maxar: image, .IMD, .TIL, .RPB, ISD XML, picture and text."""
    folder.mkdir(parents=True)
    gdal.Translate(str(folder / f"{stem}.TIF"), str(pixels), creationOptions=["PROFILE=BASELINE"])
    (folder / f"{stem}.TIF.aux.xml").unlink(missing_ok=True)
    size = gdal.Open(str(pixels))
    rpc = read_rpc(str(pixels)).rpc
    write_rpc_text(str(folder / f"{stem}.RPB"), rpc, kind="rpb")
    (folder / f"{stem}.XML").write_text(isd_text(rpc))
    (folder / f"{stem}.IMD").write_text(
        f'version = "28.3";\nproductLevel = "LV1B";\nbandId = "{"P" if kind == "PAN" else "Multi"}";\n'
        f"numRows = {size.RasterYSize};\nnumColumns = {size.RasterXSize};\nEND;\n"
    )
    (folder / f"{stem}.TIL").write_text(
        f'bandId = "P";\nnumTiles = 1;\nBEGIN_GROUP = TILE_1\n\tfilename = "{stem}.TIF";\n\tULColOffset = 0;\n'
        f"\tULRowOffset = 0;\n\tLRColOffset = {size.RasterXSize - 1};\n\tLRRowOffset = {size.RasterYSize - 1};\n"
        "END_GROUP = TILE_1\nEND;\n"
    )
    gdal.Translate(str(folder / f"{stem}-BROWSE.JPG"), str(pixels), format="JPEG", bandList=[1],
                   outputType=gdal.GDT_Byte, scaleParams=[[]])  # fmt: skip
    (folder / f"{stem}_README.TXT").write_text("README\n")


def write_area(source: Source, path: Path) -> None:
    """Write the area of an order as a polygon."""
    lons, lats = ([float(row[axis]) for row in source.ground] for axis in ("lon", "lat"))
    crs = osr.SpatialReference()
    crs.ImportFromEPSG(4326)
    layer = ogr.GetDriverByName("ESRI Shapefile").CreateDataSource(str(path))
    area = layer.CreateLayer(path.stem, crs, ogr.wkbPolygon)
    feature = ogr.Feature(area.GetLayerDefn())
    west, east, south, north = min(lons), max(lons), min(lats), max(lats)
    corners = [(west, south), (west, north), (east, north), (east, south), (west, south)]
    text = ", ".join(f"{x} {y}" for x, y in corners)
    feature.SetGeometry(ogr.CreateGeometryFromWkt(f"POLYGON (({text}))"))
    area.CreateFeature(feature)


def airbus_delivery(source: Source, folder: Path) -> None:
    """A stereo pair in DIMAP: a folder for each image, one in tiles; points that name the scenes."""
    rename = {}
    for number, image in enumerate(source.images[:2], start=1):
        scene = f"PHR1A_P_20240601103000{number}_SEN_7654321101-00{number}"
        place = folder / "IMG_PHR1A_P" / f"IMG_PHR1A_P_00{number}"
        (place / "LIBRARY").mkdir(parents=True)
        size = gdal.Open(str(image)).RasterXSize
        tile = size if number == 1 else size // 2
        names = {}
        for row, column in [(1, 1)] if number == 1 else [(1, 1), (1, 2), (2, 1), (2, 2)]:
            name = f"IMG_{scene}_R{row}C{column}.TIF"
            names[name] = row, column
            deliveries.cut_tile(image, place / name, ((column - 1) * tile, (row - 1) * tile, tile, tile))
        (place / f"RPC_{scene}.XML").write_text(deliveries.dimap_rpc(read_rpc(str(image)).rpc))
        product = deliveries.dimap_product(f"RPC_{scene}.XML", (size, size), (tile, tile), names)
        (place / f"DIM_{scene}.XML").write_text(product)
        rename[image.stem] = f"IMG_{scene}_R1C1.TIF" if number == 1 else scene
    (folder / "INDEX.HTM").write_text("<html><body>delivery</body></html>")
    (folder / "VOL_PHR.XML").write_text("<?xml version='1.0'?><Dimap_Document><Metadata_Identification>"
                                        "<METADATA_FORMAT version='2.15'>DIMAP</METADATA_FORMAT>"
                                        "</Metadata_Identification></Dimap_Document>")  # fmt: skip
    write_csv(folder / "gcps.csv", source.ground, ["id", "lon", "lat", "height"])
    rows = [{**row, "image": rename[row["image"]]} for row in source.measured if row["image"] in rename]
    write_csv(folder / "measured.csv", rows, ["id", "image", "sample", "line"])
    shutil.copy(source.folder / "dem.tif", folder)


def earlier_result(source: Source, folder: Path) -> None:
    copy(source, folder)
    run("adjust", images=[str(path) for path in source.images], gcps=str(source.folder / "ground_points.csv"),
        image_points=str(source.folder / "image_points.csv"), output_dir=str(folder / "old"), report=False)  # fmt: skip


def nothing_usable(source: Source, folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "readme.txt").write_text("images follow by post\n")


def umlauts_and_blanks(source: Source, folder: Path) -> None:
    copy(source, folder / "Übersicht Süd", gcps=False)
    write_csv(folder / "Paß punkte (neu).csv", source.ground, ["id", "lon", "lat", "height"])
    write_measured(source, folder)


def small_dem(source: Source, folder: Path) -> None:
    copy(source, folder)
    whole = gdal.Open(str(source.folder / "dem.tif"))
    gdal.Translate(str(folder / "dem.tif"), whole, srcWin=[0, 0, whole.RasterXSize, 2 * whole.RasterYSize // 3])


def laser(source: Source, folder: Path) -> None:
    copy(source, folder, gcps=False)
    shutil.copy(source.folder / "laser.csv", folder / "atl06sr.csv")


def reference_orthoimage(source: Source, folder: Path) -> None:
    copy(source, folder, gcps=False)
    shutil.copy(source.folder / "free_ortho.tif", folder / "orthophoto.tif")


def rpc_files_with_tie_points(source: Source, folder: Path) -> None:
    rpc_files_alone(source, folder)
    (folder / "gcps.csv").unlink()


def control_outside_the_image(source: Source, folder: Path) -> None:
    copy(source, folder, (0,))
    path = folder / source.images[0].name
    cut = gdal.Translate("", str(source.images[0]), format="MEM")
    values = cut.ReadAsArray()
    inside = np.zeros(values.shape, bool)
    inside[:, : values.shape[1] // 2] = True
    cut.GetRasterBand(1).WriteArray(np.where(inside, values, 0))
    cut.GetRasterBand(1).SetNoDataValue(0)
    gdal.Translate(str(path), cut)


FOLDERS: tuple[Callable[[Source, Path], None], ...] = (
    as_simulated, text_without_header, geopackage_and_file_per_image, shapefile_and_orthometric_dem, geojson_and_nan,
    excel, degrees_minutes_seconds, georeferencer, control_and_check_apart, role_column, rpc_files_alone, side_files,
    virtual_and_cloud_optimised, without_control, images_alone, one_image_with_control, one_image_alone,
    earlier_result, nothing_usable, umlauts_and_blanks, small_dem, laser, reference_orthoimage,
    orthometric_dem_without_control, rpc_files_with_tie_points, control_outside_the_image,
    rpb_beside_images, geom_beside_crops, panchromatic_and_multispectral, maxar_delivery, airbus_delivery,
)  # fmt: skip
