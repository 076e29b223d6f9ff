"""Images cut, reduced, enlarged and converted by the usual programs, with the RPC of their scene in all its carriers.

Each case has the true position of its pixels in the scene, so that the error of any RPC of it is known. Programs:
gdal_translate and gdalwarp of GDAL (which are also what "clip" in QGIS runs), rasterio, and Pillow, which knows no RPC.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rasterio
from osgeo import gdal, osr
from PIL import Image as Picture
from rasterio.windows import Window
from rpc_samples import sample_rpc

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.io.rasters.images import open_image_and_source, placement_doubt
from hrsi.hrsi_engine.io.rpc_files.fields import gdal_metadata, rpc_from_entries
from hrsi.hrsi_engine.io.rpc_files.text_formats import geom_text, rpb_text, rpc_txt_text
from hrsi.hrsi_engine.io.rpc_files.xml_formats import isd_text

SIZE = (800, 600)
#: First sample and line, samples and lines of the part of the scene, and samples and lines of the image made of it.
SHAPES = {
    "scene": ((0, 0, *SIZE), SIZE),
    "crop": ((210, 130, 340, 260), (340, 260)),
    "tile R1C1": ((0, 0, 400, 300), (400, 300)),
    "reduced": ((0, 0, *SIZE), (400, 300)),
    "enlarged": ((0, 0, *SIZE), (1600, 1200)),
    "crop reduced": ((210, 130, 340, 260), (170, 130)),
    "MS of PAN": ((0, 0, *SIZE), (200, 150)),
}
TOOLS = ("gdal_translate", "gdalwarp", "rasterio", "QGIS clip", "PIL")
#: Carrier of the RPC, and whether its file states the size of the scene.
CARRIERS = (("tag", False), ("aux.xml", False), ("_RPC.TXT", False), ("RPB", False), ("RPB", True), ("XML", False),
            ("XML", True), ("geom", False), ("geom", True))  # fmt: skip
GRIDS = ("none", "pixel", "map")
CRS = "EPSG:4326"


@dataclass(frozen=True)
class Case:
    """One image: how it was made, its carrier of the RPC, and its grid."""

    shape: str
    tool: str
    carrier: str
    states_size: bool
    grid: str

    def __str__(self) -> str:
        size = "size stated" if self.states_size else ""
        return f"{self.shape}, {self.tool}, {self.carrier}, {self.grid} grid, {size}".rstrip(", ")


@dataclass(frozen=True)
class Finding:
    """Largest error of the RPC as it is in the files, what HRSI says, and the error of the RPC that HRSI reads."""

    before_px: float
    says: str
    after_px: float


def list_cases() -> Iterator[Case]:
    """Return all combinations that a program can produce."""
    for shape in SHAPES:
        for carrier, states_size in CARRIERS:
            for grid in GRIDS:
                for tool in TOOLS:
                    case = Case(shape, tool, carrier, states_size, grid)
                    if _is_possible(case):
                        yield case


def _is_possible(case: Case) -> bool:
    if case.shape == "MS of PAN":  # delivered as such
        return case.tool == "gdal_translate" and case.grid == "none" and case.carrier not in ("tag", "aux.xml")
    if case.carrier == "aux.xml" and case.tool != "PIL":
        return False  # GDAL moves it as a tag
    if case.tool == "QGIS clip":  # by map coordinates
        return case.grid == "map" and case.shape in ("crop", "tile R1C1")
    if case.tool == "PIL":  # keeps no georeference
        return case.grid == "none" and case.carrier != "tag"
    if case.tool == "gdalwarp":  # removes the tag, needs a georeference
        return case.carrier != "tag" and case.grid != "none" and case.shape in ("crop", "tile R1C1", "reduced")
    return True


def scene_rpc(grid: str) -> RPC:
    """Return the RPC of the scene; of a map product, it follows the map to 0.1 px."""
    rpc = replace(sample_rpc(2), samp_off=SIZE[0] / 2 - 0.5, line_off=SIZE[1] / 2 - 0.5,
                  samp_scale=SIZE[0] / 2 + 9.5, line_scale=SIZE[1] / 2 + 11.5)  # fmt: skip
    if grid != "map":
        return rpc
    one, lon, lat, height = np.eye(20)[:4]
    return replace(rpc, samp_num=lon + 0.03 * height, line_num=-lat + 0.02 * height, samp_den=one, line_den=one)


def _geotransform(rpc: RPC, grid: str) -> tuple[float, ...] | None:
    if grid == "none":
        return None
    if grid == "pixel":  # as Airbus delivers
        return (0.5, 1.0, 0.0, 0.5, 0.0, 1.0)
    step_lon, step_lat = rpc.long_scale / rpc.samp_scale, rpc.lat_scale / rpc.line_scale
    west = rpc.long_off - (rpc.samp_off + 0.5) * step_lon
    return (west, step_lon, 0.0, rpc.lat_off + (rpc.line_off + 0.5) * step_lat, 0.0, -step_lat)


def write_case(case: Case, folder: Path) -> Path:
    """Write the scene and make the image of a case; return its path."""
    scene = scene_rpc(case.grid)
    source, name = folder / "scene.tif", "image_R1C1" if case.shape == "tile R1C1" else "image"
    dataset = gdal.GetDriverByName("GTiff").Create(str(source), *SIZE, 1, gdal.GDT_Byte)
    dataset.GetRasterBand(1).WriteArray(np.add.outer(np.arange(SIZE[1]), np.arange(SIZE[0])).astype(np.uint8))
    if geotransform := _geotransform(scene, case.grid):
        dataset.SetGeoTransform(geotransform)
    if case.grid == "map":
        crs = osr.SpatialReference()
        crs.ImportFromEPSG(4326)
        dataset.SetProjection(crs.ExportToWkt())
    if case.carrier == "tag":
        dataset.SetMetadata(gdal_metadata(scene), "RPC")
    del dataset
    path = folder / f"{name}.{'png' if case.carrier == 'aux.xml' else 'tif'}"
    _run_tool(case, source, path)
    for side_file, text in _side_files(case, scene).items():
        (folder / side_file.format(name=name, file=path.name)).write_text(text)
    return path


def _run_tool(case: Case, source: Path, path: Path) -> None:
    window, size = SHAPES[case.shape]
    if case.tool == "PIL":
        first, extent = window[:2], window[2:]
        with Picture.open(source) as picture:
            part = picture.crop((*first, first[0] + extent[0], first[1] + extent[1]))
            part.resize(size).save(path)
    elif case.tool == "rasterio":
        with rasterio.open(source) as opened:
            part = Window(*window)
            step = rasterio.Affine.scale(window[2] / size[0], window[3] / size[1])
            profile = {**opened.profile, "width": size[0], "height": size[1],
                       "transform": opened.window_transform(part) * step}  # fmt: skip
            with rasterio.open(path, "w", **profile) as made:
                made.write(opened.read(window=part, out_shape=(1, *size[::-1])))
                if opened.rpcs is not None:
                    made.rpcs = opened.rpcs
    elif case.tool == "gdal_translate":
        gdal.Translate(str(path), str(source), srcWin=window, width=size[0], height=size[1])
    else:
        corners = [gdal.ApplyGeoTransform(gdal.Open(str(source)).GetGeoTransform(), window[0] + right, window[1] + down)
                   for right, down in ((0, 0), (window[2], window[3]))]  # fmt: skip
        (x0, y0), (x1, y1) = corners
        if case.tool == "QGIS clip":
            gdal.Translate(str(path), str(source), projWin=[x0, y0, x1, y1])
        else:
            gdal.Warp(str(path), str(source), outputBounds=[x0, min(y0, y1), x1, max(y0, y1)], width=size[0],
                      height=size[1])  # fmt: skip


def _side_files(case: Case, rpc: RPC) -> dict[str, str]:
    """Return the files that the user copies beside the image, with the name of the scene's files changed to its own."""
    rows = f"<NUMROWS>{SIZE[1]}</NUMROWS><NUMCOLUMNS>{SIZE[0]}</NUMCOLUMNS>" if case.states_size else ""
    if case.carrier == "_RPC.TXT":
        return {"{name}_RPC.TXT": rpc_txt_text(rpc)}
    if case.carrier == "RPB":
        stated = {"{name}.IMD": f"numRows = {SIZE[1]};\nnumColumns = {SIZE[0]};\nEND;\n"} if case.states_size else {}
        return {"{name}.RPB": rpb_text(rpc), **stated}
    if case.carrier == "XML":
        return {"{name}.XML": isd_text(rpc).replace("<isd>", f"<isd><IMD>{rows}</IMD>")}
    if case.carrier == "geom":
        return {
            "{name}.geom": geom_text(rpc) + (f"number_samples: {SIZE[0]}\nnumber_lines: {SIZE[1]}\n" if rows else "")
        }
    if case.carrier == "aux.xml":
        items = "".join(f'<MDI key="{key}">{value}</MDI>' for key, value in gdal_metadata(rpc).items())
        return {"{file}.aux.xml": f'<PAMDataset><Metadata domain="RPC">{items}</Metadata></PAMDataset>'}
    return {}


def measure_error(case: Case, rpc: RPC) -> float:
    """Return the largest error (px) of an RPC in the image of a case, from its true place in the scene."""
    window, size = SHAPES[case.shape]
    step = np.array(window[2:]) / size
    pixels = np.stack(np.meshgrid(*(np.linspace(0.0, end - 1.0, 5) for end in size)), -1).reshape(-1, 2)
    scene, errors, in_scene = scene_rpc(case.grid), [], (pixels + 0.5) * step + window[:2] - 0.5
    if case.tool == "gdalwarp" and case.grid == "pixel":  # it turns an image upside down whose lines increase downwards
        in_scene[:, 1] = 2.0 * window[1] + window[3] - 1.0 - in_scene[:, 1]
    for height in (250.0, 300.0, 350.0):
        ground = scene.localize(in_scene, height).ground
        errors.append(np.hypot(*(rpc.project(ground) - pixels).T).max())
    return float(max(errors))


def examine(case: Case, path: Path) -> Finding:
    """Return the error of the RPC as in the files, what HRSI says, and the error of the RPC that it reads."""
    metadata = gdal.Open(str(path)).GetMetadata("RPC")
    given = rpc_from_entries("GDAL", metadata) if metadata else scene_rpc(case.grid)
    image, found = open_image_and_source(str(path))
    doubt = placement_doubt(image)
    says = "moved" if "moved to the crop" in found.source else ""
    if doubt is not None:
        says = f"{'contradictory' if doubt.contradictory else 'unknown'}, {doubt.offset_px:.4g} px"
    return Finding(measure_error(case, given), says, measure_error(case, image.rpc))
