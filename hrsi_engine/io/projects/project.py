"""What is handed over, whatever the target: the adjusted block as the writers of projects get it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from osgeo import gdal, osr
from shapely.geometry import Polygon

from ...block.block import GroundPoints, Image, ImagePoints
from ...block.stereo_pairs import StereoPair
from ...foundation.errors import InputError, OutputError
from ...foundation.thresholds import threshold, thresholds
from ...ground.geodesy import WGS84, metres_per_degree
from ...ground.sun import SunAngles
from ...surface.dem import HeightSurface, surface_heights
from ..opening.datasets import gdal_messages
from ..rpc_files.write import write_geotiff_copy, write_vrt

DEM_FILE = "dem.tif"


@thresholds
class PROJECTS:
    """What is written of the terrain for other programs."""

    most_nodes: int = threshold(
        1000, "nodes", "of the initial DEM along each side", "a start for matching needs no more"
    )
    node_pixels: float = threshold(4.0, "px", "of the images, distance of the initial DEM's nodes at least")
    margin: float = threshold(0.1, "", "of the area's extent, by which the initial DEM reaches beyond it")
    dsm_pixels: float = threshold(4.0, "px", "of the images, cell of a surface model", "advice of ASP's handbook")
    outline_nodes: int = threshold(21, "nodes", "along each side of an area that is carried into an image")
    held_out_of: int = threshold(8, "views", "of which one is held out, to judge a reconstruction", "custom of LLFF")
    height_margin_m: float = threshold(30.0, "m", "below and above the terrain where matches are looked for")


@dataclass(frozen=True, eq=False)
class BlockProject:
    """An adjusted block on its way to another program.

    Parameters
    ----------
    images : tuple of Image
        With refined RPCs; ``path`` is the file with the pixels.
    pairs : tuple of StereoPair
        Stereo pairs, the best first.
    area : Polygon
        Region of interest, lon and lat.
    whole : bool
        Whether the area is all that the block covers.
    surface : HeightSurface
        Ellipsoidal heights of the ground.
    gsd_m : float
        Ground sample distance.
    epsg : int
        Projected CRS for results.
    copy : bool
        Whether images are copied; else VRTs refer to them.
    factor : float
        Size of crops to that of the images.
    suns, times : dict
        Sun and acquisition time of the images by id; None where not known.
    points, surveyed : GroundPoints
        The points as adjusted, and the known ones among them as surveyed.
    measured : ImagePoints
        Where they were measured.
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

    def image(self, name: str) -> Image:
        """Return the image of an id."""
        return next(image for image in self.images if image.id == name)

    @property
    def paired(self) -> tuple[Image, ...]:
        """The images that are part of a stereo pair."""
        names = {name for pair in self.pairs for name in (pair.left, pair.right)}
        return tuple(image for image in self.images if image.id in names)

    @property
    def outline(self) -> dict[str, object]:
        """The area as a GeoJSON geometry."""
        return {"type": "Polygon", "coordinates": [[list(corner) for corner in self.area.exterior.coords]]}

    @property
    def geojson(self) -> dict[str, object]:
        """The area as a GeoJSON collection of one polygon."""
        feature = {"type": "Feature", "properties": {}, "geometry": self.outline}
        return {"type": "FeatureCollection", "features": [feature]}


@dataclass(frozen=True)
class WrittenProject:
    """What a writer made: the commands to type in the folder, where the program leaves its result, and notices."""

    commands: tuple[str, ...]
    result: str
    notices: tuple[str, ...] = ()


ProjectWriter = Callable[[BlockProject, Path], WrittenProject]


def write_project_images(project: BlockProject, folder: Path, images: Sequence[Image]) -> dict[str, str]:
    """Write images with their refined RPCs into a folder; return their names by id."""
    names = {}
    for image in images:
        if image.raster is None:
            raise InputError(f"{image.id}: has no pixels, which dense matching needs: adjust the images, not RPC files")
        names[image.id] = f"{image.id}{'.tif' if project.copy else '.vrt'}"
        target = str(folder / names[image.id])
        if project.copy:
            write_geotiff_copy(image.path, target, image.rpc)
        else:
            write_vrt(image.path, target, image.rpc)
    return names


def find_window(image: Image, area: Polygon, surface: HeightSurface) -> tuple[int, int, int, int]:
    """Return the window (first sample and line, samples, lines) of an image that shows an area; empty outside it."""
    ground = sample_area(area, surface, PROJECTS.outline_nodes)[0].reshape(-1, 3)
    xy = image.rpc.project(ground[np.isfinite(ground[:, 2])])
    last = np.array(image.known_size)
    low = np.clip(np.floor(xy.min(axis=0) + 0.5), 0, last).astype(int)
    high = np.clip(np.ceil(xy.max(axis=0) + 0.5), low, last).astype(int)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def sample_area(
    area: Polygon, surface: HeightSurface, columns: int, rows: int = 0, margin: float = 0.0
) -> tuple[np.ndarray, float, float]:
    """Return ground points ``(rows, columns, 3)`` of a grid over an area's box, from the north, and its steps (deg)."""
    west, south, east, north = area.bounds
    wide, high = margin * (east - west), margin * (north - south)
    lon = np.linspace(west - wide, east + wide, columns)
    lat = np.linspace(north + high, south - high, rows or columns)
    lonlat = np.stack(np.meshgrid(lon, lat), axis=-1)
    heights = surface_heights(surface, lonlat.reshape(-1, 2)).reshape(lonlat.shape[:2])
    return np.dstack([lonlat, heights]), float(lon[1] - lon[0]), float(lat[0] - lat[1])


def write_initial_dem(project: BlockProject, folder: Path) -> tuple[float, float]:
    """Write the initial DEM: heights above the WGS84 ELLIPSOID at lon, lat nodes; return the lowest and highest.

    Nodes where the terrain is not known get the median height: programs that follow rays down stop at gaps.
    """
    west, south, east, north = project.area.bounds
    scale = metres_per_degree(np.array([[west, south, 0.0]]))[0, :2]
    extent_m = np.array([east - west, north - south]) * scale * (1.0 + 2.0 * PROJECTS.margin)
    step_m = max(PROJECTS.node_pixels * project.gsd_m, float(extent_m.max()) / PROJECTS.most_nodes)
    columns, rows = (np.ceil(extent_m / step_m).astype(int) + 2).tolist()
    ground, dx, dy = sample_area(project.area, project.surface, columns, rows, PROJECTS.margin)
    heights = ground[..., 2]
    heights[~np.isfinite(heights)] = np.nanmedian(heights)
    crs = osr.SpatialReference()
    crs.ImportFromEPSG(WGS84)
    path = str(folder / DEM_FILE)
    with gdal_messages() as messages:
        dataset = gdal.GetDriverByName("GTiff").Create(path, columns, rows, 1, gdal.GDT_Float32, ["COMPRESS=DEFLATE"])
        dataset.SetProjection(crs.ExportToWkt())
        first = ground[0, 0]
        dataset.SetGeoTransform((float(first[0] - dx / 2), dx, 0.0, float(first[1] + dy / 2), 0.0, -dy))
        dataset.SetMetadataItem("HEIGHTS", "metres above the WGS84 ellipsoid")
        dataset.GetRasterBand(1).WriteArray(heights.astype(np.float32))
        del dataset
    if messages:
        raise OutputError(f"{path}: cannot be written ({messages[-1]})")
    return float(heights.min()), float(heights.max())
