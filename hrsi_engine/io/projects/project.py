"""The adjusted block as all writers of projects get it, and the parts that their projects share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np
from osgeo import gdal, osr
from scipy.ndimage import distance_transform_edt
from shapely.geometry import Polygon

from ...block.block import GroundPoints, Image, ImagePoints
from ...block.stereo_pairs import StereoPair
from ...foundation.errors import InputError, OutputError
from ...foundation.thresholds import GRIDS, MEMORY, threshold, thresholds
from ...ground.geodesy import WGS84, metres_per_degree
from ...ground.sun import SunAngles
from ...surface.dem import HeightSurface, surface_heights
from ..opening.datasets import gdal_messages
from ..rpc_files.write import write_geotiff_copy, write_vrt

DEM_FILE = "dem.tif"
NO_HEIGHT = -32768.0  # nodata value of the initial DEM; not used, since all nodes have heights

Bounds = tuple[float, float, float, float]


@thresholds
class PROJECTS:
    """Sizes, margins and resolutions of projects for other programs."""

    node_pixels: float = threshold(4.0, "px", "smallest spacing of the initial DEM in image pixels")
    margin: float = threshold(0.25, "", "margin of the initial DEM relative to the area's extent")
    margin_deg: float = threshold(0.02, "deg", "margin of the initial DEM in addition to that")
    held_out_of: int = threshold(8, "views", "one of so many views is held out for a test", "custom of LLFF")


@dataclass(frozen=True, eq=False)
class BlockProject:
    """An adjusted block to be written as a project for another program.

    images : with refined RPCs; ``path`` is the file with the pixels
    pairs : stereo pairs, the best first
    area : region of interest, lon and lat; whole : whether it is the complete area of the block
    surface : ellipsoidal heights of the ground
    gsd_m : ground sampling distance; epsg : projected CRS for results
    copy : whether images are copied; otherwise VRTs refer to them
    factor : ratio of the size of crops to that of the images
    suns, times : position of the sun and acquisition time of the images, by id; None if unknown
    points, surveyed : the adjusted points; the known points among them as surveyed
    measured : image measurements of the points
    """

    images: tuple[Image, ...]
    pairs: tuple[StereoPair, ...]
    area: Polygon
    whole: bool
    surface: HeightSurface
    gsd_m: float
    epsg: int
    copy: bool
    factor: float
    suns: dict[str, SunAngles | None]
    times: dict[str, datetime | None]
    points: GroundPoints
    surveyed: GroundPoints
    measured: ImagePoints

    @property
    def paired(self) -> tuple[Image, ...]:
        """The images that belong to a stereo pair."""
        names = {name for pair in self.pairs for name in (pair.left, pair.right)}
        return tuple(image for image in self.images if image.id in names)

    @property
    def outline(self) -> dict[str, object]:
        """The area as a GeoJSON geometry."""
        return {"type": "Polygon", "coordinates": [[list(corner) for corner in self.area.exterior.coords]]}


FileContent = str | Callable[[str], object]  # text, or a function that writes a path


@dataclass(frozen=True)
class PlannedProject:
    """Contents of a project.

    files : contents by name; no file is written, and no pixel read, before `write`
    commands : to be run in the folder; result : file or folder that the program writes; notices : for the user
    told : entries of the report
    """

    files: dict[str, FileContent]
    commands: tuple[str, ...]
    result: str
    notices: tuple[str, ...] = ()
    told: dict[str, object] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write all files into a folder."""
        for name, content in self.files.items():
            if isinstance(content, str):
                (folder / name).write_text(content, encoding="utf-8")
            else:
                content(str(folder / name))


ProjectPlanner = Callable[[BlockProject], PlannedProject]


def plan_images(
    project: BlockProject, images: Sequence[Image], copy: bool
) -> tuple[dict[str, str], dict[str, FileContent]]:
    """Return the names of images in the project, by id, and the files: copies or VRTs with their refined RPCs."""
    suffix, write = (".tif", write_geotiff_copy) if copy else (".vrt", write_vrt)
    names, files = {}, dict[str, FileContent]()
    for image in images:
        if image.raster is None:
            raise InputError(f"{image.id}: has no pixels, which dense matching needs: adjust the images, not RPC files")
        names[image.id] = f"{image.id}{suffix}"
        files[names[image.id]] = partial(write, image.path, rpc=image.rpc)
    return names, files


def find_window(image: Image, area: Polygon, surface: HeightSurface) -> tuple[int, int, int, int]:
    """Return the window (first sample and line, samples, lines) of an image that shows an area; of size 0 outside."""
    ground = sample_area(area.bounds, surface, GRIDS.fine).reshape(-1, 3)
    xy = image.rpc.project(ground[np.isfinite(ground[:, 2])])
    last = np.array(image.known_size)
    low = np.clip(np.floor(xy.min(axis=0) + 0.5), 0, last).astype(int)
    high = np.clip(np.ceil(xy.max(axis=0) + 0.5), low, last).astype(int)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def sample_area(bounds: Bounds, surface: HeightSurface, columns: int, rows: int = 0) -> np.ndarray:
    """Return ground points ``(rows, columns, 3)`` of a grid over a box (west, south, east, north), from the north."""
    west, south, east, north = bounds
    lonlat = np.stack(
        np.meshgrid(np.linspace(west, east, columns), np.linspace(north, south, rows or columns)), axis=-1
    )
    return np.dstack([lonlat, surface_heights(surface, lonlat.reshape(-1, 2)).reshape(lonlat.shape[:2])])


def write_initial_dem(project: BlockProject, path: str) -> None:
    """Write the initial DEM: heights above the WGS84 ELLIPSOID at lon, lat nodes.

    It extends beyond the images, and nodes with unknown terrain get the height of the nearest known node: programs that
    interpolate in it, or intersect rays with it, must meet neither gaps nor steps.
    """
    west, south, east, north = project.area.bounds
    margin = PROJECTS.margin * np.array([east - west, north - south]) + PROJECTS.margin_deg
    low, high = np.array([west, south]) - margin, np.array([east, north]) + margin
    extent_m = (high - low) * metres_per_degree(np.array([[west, south, 0.0]]))[0, :2]
    step_m = max(PROJECTS.node_pixels * project.gsd_m, float(extent_m.max()) / MEMORY.part_px)
    columns, rows = (np.ceil(extent_m / step_m).astype(int) + 1).tolist()
    heights = sample_area((*low, *high), project.surface, columns, rows)[..., 2]
    nearest = distance_transform_edt(~np.isfinite(heights), return_distances=False, return_indices=True)
    dx, dy = ((high - low) / (columns - 1, rows - 1)).tolist()
    crs = osr.SpatialReference()
    crs.ImportFromEPSG(WGS84)
    with gdal_messages() as messages:
        dataset = gdal.GetDriverByName("GTiff").Create(path, columns, rows, 1, gdal.GDT_Float32, ["COMPRESS=DEFLATE"])
        dataset.SetProjection(crs.ExportToWkt())
        dataset.SetGeoTransform((float(low[0]) - dx / 2, dx, 0.0, float(high[1]) + dy / 2, 0.0, -dy))
        dataset.SetMetadataItem("HEIGHTS", "metres above the WGS84 ellipsoid")
        dataset.GetRasterBand(1).SetNoDataValue(NO_HEIGHT)
        dataset.GetRasterBand(1).WriteArray(heights[tuple(nearest)].astype(np.float32))
        del dataset
    if messages:
        raise OutputError(f"{path}: cannot be written ({messages[-1]})")
