"""Rasters of heights in a folder: tiles of one DEM become a mosaic, and what a file does not state is found.

A CRS that is missing is one in which the raster lies where the images are; a value that is no height is nodata. Both,
and mosaics, become a virtual raster next to the project file.
"""

import os
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import cast

import numpy as np
from scipy import ndimage

from ...hrsi_engine.foundation.thresholds import EQUALITY, MEMORY
from ...hrsi_engine.ground.map_crs import list_local_crs
from ...hrsi_engine.ground.proj_operations import has_heights
from ...hrsi_engine.io.opening.datasets import open_dataset
from ...hrsi_engine.io.rasters.dems import RasterFacts, RasterKind, find_raster_kind, write_virtual_raster
from ...hrsi_engine.surface.grid_surface import GridSurface
from .. import REGISTRY
from .point_sources import state_datum

OWN_ENDING = "_hrsi.vrt"  #: of virtual rasters that `init` writes


@dataclass
class HeightRaster:
    """A raster of heights: its height datum ('' if stated by the CRS, None if unknown), and gaps near the images.

    paths : its files; crs, nodata : what they do not state, else empty and None
    share : of the images' ground with heights
    """

    paths: tuple[str, ...]
    facts: RasterFacts
    crs: str = ""
    share: float = 0.0
    gap_cells: int = 0

    @property
    def path(self) -> str:
        """The first file."""
        return self.paths[0]

    @property
    def name(self) -> str:
        """Name of the file, and the number of further tiles."""
        more = f" and {len(self.paths) - 1} more tiles" if len(self.paths) > 1 else ""
        return os.path.basename(self.path) + more

    @property
    def surface(self) -> GridSurface:
        """Its heights."""
        return cast(GridSurface, self.facts.surface)

    @property
    def is_dsm(self) -> bool:
        """Whether its name states that it is a surface model."""
        return any(word in os.path.basename(self.path).lower() for word in ("dsm", "surface", "mns"))

    @property
    def datum(self) -> str | None:
        """Height datum by its name; '' if the CRS states it, None if nothing does."""
        crs, name = self.facts.crs, os.path.basename(self.path).lower()
        return "" if crs is not None and has_heights(crs) else state_datum(name, crs.name if crs is not None else "")

    @property
    def target(self) -> str:
        """Name of the virtual raster that states what the files do not; empty if they state everything."""
        stem = os.path.splitext(os.path.basename(self.path))[0]
        return stem + OWN_ENDING if self.crs or self.facts.nodata is not None or len(self.paths) > 1 else ""

    def write_target(self, folder: str) -> str:
        """Write the virtual raster to a folder and return its path; the file itself if it states everything."""
        if not self.target:
            return self.path
        write_virtual_raster(self.paths, os.path.join(folder, self.target), self.crs, self.facts.nodata)
        return os.path.join(folder, self.target)


def find_heights(path: str, facts: RasterFacts, region: np.ndarray) -> HeightRaster | None:
    """Return a raster with heights where the images lie, ``region`` (2, 2); None if it has none there.

    Raises `InputError` if it cannot be read.
    """
    candidates = [("", facts)]
    if facts.kind is RasterKind.UNPLACED and facts.centre is not None:
        candidates = [
            (crs, found)
            for crs in list_local_crs(region.mean(axis=0), np.array(facts.centre))
            if (found := find_raster_kind(path, crs)) is not None
        ]
    for crs, found in candidates:
        heights, step = (np.empty(0), 0) if found.surface is None else _sample_heights(found.surface, region)
        known = np.isfinite(heights)
        if known.any():
            holes = ndimage.binary_fill_holes(known) & ~known  # without the area beyond its edge
            gap = step * (2 + int(np.ceil(2.0 * ndimage.distance_transform_edt(holes).max()))) if holes.any() else 0
            widest = REGISTRY["orthorectify"].param("fill_gaps").maximum or gap
            return HeightRaster((path,), found, crs, gap_cells=int(min(gap, widest)))
    return None


def merge_tiles(rasters: Sequence[HeightRaster], region: np.ndarray) -> list[HeightRaster]:
    """Return the rasters with tiles of one DEM merged: equal CRS and cells, and little overlap."""
    groups = defaultdict[tuple[object, ...], list[HeightRaster]](list)
    for one in rasters:
        groups[(one.facts.crs, *np.round(one.facts.cell, 9).tolist(), one.is_dsm, one.facts.nodata)].append(one)
    merged = list[HeightRaster]()
    for tiles in groups.values():
        if len(tiles) == 1 or any(_overlap(*pair) > EQUALITY.majority for pair in combinations(tiles, 2)):
            merged += tiles
            continue
        paths = tuple(one.path for one in tiles)
        virtual = f"/vsimem/{tiles[0].target or os.path.basename(paths[0])}_tiles.vrt"
        write_virtual_raster(paths, virtual, tiles[0].crs, tiles[0].facts.nodata)
        facts = find_raster_kind(virtual)
        found = find_heights(virtual, facts, region) if facts is not None else None
        if found is not None:
            found.paths, found.crs, found.facts.nodata = paths, tiles[0].crs, tiles[0].facts.nodata
        merged += tiles if found is None else [found]
    return merged


def _overlap(first: HeightRaster, second: HeightRaster) -> float:
    """Return the share of the smaller raster that the other covers."""
    centres = np.array([first.facts.centre, second.facts.centre])
    sides = np.abs([np.multiply(one.facts.cell, one.facts.size) for one in (first, second)])
    common = (centres + 0.5 * sides).min(axis=0) - (centres - 0.5 * sides).max(axis=0)
    return float(np.prod(np.maximum(common, 0.0)) / np.prod(sides, axis=1).min())


def _sample_heights(surface: GridSurface, region: np.ndarray) -> tuple[np.ndarray, int]:
    """Return heights on a lattice of cells where the surface and the images' ground overlap, and its step in cells.

    heights : (rows, columns); empty if they do not overlap
    """
    (west, south), (east, north) = region
    cells = surface.grid_coordinates(np.array([[west, south], [west, north], [east, south], [east, north]]))
    rows, columns = surface.shape
    low = np.maximum(np.floor(cells.min(axis=0)), 0).astype(int)
    high = np.minimum(np.ceil(cells.max(axis=0)), (columns - 1, rows - 1)).astype(int)
    if (high <= low).any():
        return np.empty(0), 0
    step = max(1, int((high - low).max()) // MEMORY.window_px)
    column, row = np.meshgrid(np.arange(low[0], high[0] + 1, step), np.arange(low[1], high[1] + 1, step))
    heights = surface.heights(np.column_stack([column.ravel(), row.ravel()]).astype(np.float64))
    return heights.reshape(column.shape), step


def parts_of(path: str, endings: tuple[str, ...]) -> list[str]:
    """Return the other files from which GDAL reads a raster: tiles, sources of a virtual raster."""
    dataset = open_dataset(path)[0]
    files = [] if dataset is None else dataset.GetFileList() or []
    return sorted({os.path.abspath(one) for one in files if one.lower().endswith(endings)} - {path})
