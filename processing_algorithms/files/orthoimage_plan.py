"""From options to the orthoimages of a block: terrain, common grid, and the warping of their chunks.

Threads share opened files; workers of a scheduler open their own.
"""

import hashlib
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import pyproj

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.imaging_geometry import ViewDirection
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.json_values import json_text
from ...hrsi_engine.foundation.thresholds import GRIDS, threshold, thresholds
from ...hrsi_engine.foundation.workers.scheduling import Calls
from ...hrsi_engine.ground.crs_operations import operations_of
from ...hrsi_engine.ground.operation_uses import OperationUse, list_operation_warnings
from ...hrsi_engine.ground.proj_operations import parse_crs
from ...hrsi_engine.io.catalogue.lineage import versions
from ...hrsi_engine.io.jitter_files import JitterFile, find_jitter_file
from ...hrsi_engine.io.point_files import read_points
from ...hrsi_engine.io.point_files.find import split_spec
from ...hrsi_engine.io.rasters import orthoimages
from ...hrsi_engine.io.rasters.dems import fill_gaps
from ...hrsi_engine.io.rasters.images import path_elsewhere
from ...hrsi_engine.io.rasters.ortho_warp import OrthoSource, Warp
from ...hrsi_engine.io.rasters.pansharpening import Pansharpening
from ...hrsi_engine.ortho import grid as map_grids
from ...hrsi_engine.ortho.mapping import OrthoMapping
from ...hrsi_engine.surface.dem import HeightSurface
from ...hrsi_engine.surface.grid_surface import ConstantHeight, GridSurface
from ..declarations.orthoimages import OrthorectifyOptions
from .opening import open_terrain


@thresholds
class ORTHO_GRID:
    """Limits for the grids of orthoimages, and height error in a warning."""

    largest_ratio: float = threshold(
        200.0, "", "largest ratio of the pixel sizes of orthoimages and images, or inverse (else wrong unit)"
    )
    notable_height_m: float = threshold(10.0, "m", "height difference whose displacement a warning states")


METRES_PER_DEGREE = 111_320.0


@dataclass(frozen=True, eq=False)
class Terrain:
    """The ground surface, what identifies it in fingerprints, and warnings for the user."""

    surface: HeightSurface
    identity: list[Any]
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class BlockPlan:
    """Orthoimages of a block: grids and ground points ``(n, 3)`` by image id; all grids are on one lattice."""

    images: Sequence[Image]
    terrain: Terrain
    crs: str
    resolution: float
    grids: Mapping[str, map_grids.MapGrid]
    gsd_m: Mapping[str, float]
    terrain_points: Mapping[str, np.ndarray]
    warnings: list[str]
    operations: tuple[OperationUse, ...] = ()


def open_ortho_terrain(options: OrthorectifyOptions) -> Terrain:
    """Return the terrain of the options: a DEM, points, both (the points fill gaps of the DEM), or a height."""
    cells, dem = options.fill_gaps, options.terrain.dem
    others = {"dem": dem.dem, "terrain_points": options.terrain_points}
    if options.terrain.height is not None and (other := next((key for key in others if others[key] is not None), "")):
        raise InputError(f"`height` and `{other}` both define the height of the ground: give one of them")
    points = None if options.terrain_points is None else _open_terrain_points(options.terrain_points, options)
    surface = open_terrain(options.terrain)
    if surface is None and points is not None:
        return Terrain(*points)
    if surface is None:
        raise InputError(
            "orthoimages need the height of the ground: give `dem` FILE, `terrain_points` FILE (ground_points of a "
            "triangulation) or, for flat land, `height` M"
        )
    if not isinstance(surface, GridSurface):
        return Terrain(surface, ["height", options.terrain.height])
    identity = [*orthoimages.file_state(str(dem.dem)), dem.dem_datum or options.terrain.height_datum, cells]
    warnings = []
    if cells:
        surface = fill_gaps(surface, cells)
        warnings.append(f"gaps of the DEM up to {cells} cells were interpolated")
    if points is None:
        return Terrain(surface, identity, warnings)
    warnings.append("where the DEM has no height, the terrain was interpolated between points")
    base, identity_of_points, _ = points
    return Terrain(surface.fill_from(base), [*identity, *identity_of_points], warnings)


def _open_terrain_points(spec: str, options: OrthorectifyOptions) -> tuple[GridSurface, list[Any], list[str]]:
    """Return the fields of the `Terrain` between the ground points of a file; raise `InputError` if it has none."""
    from ...hrsi_engine.ortho.point_surface import surface_of_points  # needs SciPy

    datum = options.terrain.height_datum
    ground = read_points(spec, ground_crs=options.ground_crs, height_datum=datum, adjusted=True).ground
    if ground is None:
        raise InputError(f"{spec}: has no ground points: name the layer ground_points of a triangulation")
    of_points, left_out = surface_of_points(ground.ground, ground.sigma_m[:, 1])
    warnings = ["the terrain was interpolated between points: objects between them have no separate height"]
    if left_out:
        warnings.append(f"{spec}: {left_out} points are far above or below their neighbours and were not used")
    return of_points, [*orthoimages.file_state(split_spec(spec)[0]), spec, datum], warnings


def plan_block(images: Sequence[Image], terrain: Terrain, options: OrthorectifyOptions) -> BlockPlan:
    """Return the grids of all images, and warnings for the user."""
    seen: dict[str, str] = {}
    if options.visibility and isinstance(terrain.surface, ConstantHeight):
        raise InputError("`visibility` needs the heights of buildings and trees: give a surface model as `dem`")
    for image in images:
        if image.raster is None:
            raise InputError(f"{image.path}: an RPC file without pixels: name the image itself")
        if not image.path:
            raise InputError(f"{image.id} comes from arrays: save it as a GeoTIFF and name that")
        if image.id in seen:
            raise InputError(f"{seen[image.id]} and {image.path} would both become {image.id}_ortho.tif: rename one")
        seen[image.id] = image.path
    below = {image.id: map_grids.find_terrain_points(image, terrain.surface) for image in images}
    if bare := [name for name, ground in below.items() if not len(ground)]:
        raise InputError(f"{bare[0]}: the DEM has no heights where the image lies: use a DEM that covers it")
    gsd = {image.id: map_grids.compute_ground_sample_m(image, below[image.id]) for image in images}
    ground, finest_m = np.concatenate(list(below.values())), min(gsd.values())
    crs = map_grids.choose_map_crs(ground, options.crs)
    unit = pyproj.CRS.from_wkt(crs).axis_info[0]
    unit_m = METRES_PER_DEGREE if pyproj.CRS.from_wkt(crs).is_geographic else float(unit.unit_conversion_factor)
    fitting = map_grids.round_resolution(finest_m / unit_m)
    resolution = options.resolution or fitting
    if not 1.0 / ORTHO_GRID.largest_ratio <= resolution * unit_m / finest_m <= ORTHO_GRID.largest_ratio:
        raise InputError(  # wrong unit
            f"`resolution` {resolution:g} is in units of the CRS {pyproj.CRS.from_wkt(crs).name!r}, {unit.unit_name}, "
            f"and makes pixels of {resolution * unit_m:.3g} m, where the images have {finest_m:.3g} m: give about "
            f"{fitting:g}, or a `crs` in metres"
        )
    # Operations of the terrain to WGS84, and from there to the map of the orthoimages
    operations = (*getattr(terrain.surface, "operations", ()), *operations_of(crs).uses_at("orthoimages", ground))
    warnings = [*terrain.warnings, *_terrain_warnings(images, terrain, below), *list_operation_warnings(operations)]
    grids = _make_grids(images, terrain.surface, crs, resolution, options.extent)
    return BlockPlan(
        images,
        terrain,
        crs,
        resolution=resolution,
        grids=grids,
        gsd_m=gsd,
        terrain_points=below,
        warnings=warnings,
        operations=operations,
    )


def label_crs(wkt: str) -> str:
    """Return the EPSG code of a CRS (``EPSG:32631``), or its name if it has none."""
    crs = pyproj.CRS.from_wkt(wkt)
    return f"EPSG:{code}" if (code := crs.to_epsg()) else str(crs.name)


def _terrain_warnings(images: Sequence[Image], terrain: Terrain, below: Mapping[str, np.ndarray]) -> list[str]:
    """Return what flat ground displaces, or which images lie partly beyond the DEM; ``below`` is ground by image."""
    if isinstance(terrain.surface, ConstantHeight):
        tangents = {
            im.id: math.tan(math.radians(ViewDirection(im, terrain.surface).geometry().incidence_deg)) for im in images
        }
        worst = max(tangents, key=lambda name: tangents[name])
        return [
            f"the ground is assumed to be flat: where it is {ORTHO_GRID.notable_height_m:g} m higher or lower, {worst} "
            f"is displaced by {ORTHO_GRID.notable_height_m * tangents[worst]:.1f} m; a DEM avoids this"
        ]
    shares = {name: len(ground) / map_grids.GRIDS.nodes**2 for name, ground in below.items()}
    return [
        f"{name}: only {share:.0%} of the image lies on known terrain; the rest becomes nodata"
        for name, share in shares.items()
        if share < 1.0
    ]


def parse_box(
    extent: str, crs: str, words: str = "each, union, overlap, or ", whose: str = "the orthoimages' CRS"
) -> tuple[float, ...]:
    """Return west, south, east, north in a CRS, of ``W,S,E,N``, or the bounding box of ``W,S,E,N [CRS]`` in it.

    In messages ``whose`` names the CRS, and ``words`` the other values of the option.
    """
    numbers, _, named = extent.strip().removesuffix("]").partition("[")
    try:
        box = tuple(float(value) for value in numbers.replace(",", " ").split())
    except ValueError:
        box = ()
    if len(box) != 4 or not (box[0] < box[2] and box[1] < box[3]) or not all(map(math.isfinite, box)):
        raise InputError(
            f"`extent` {extent!r}: give {words}west,south,east,north in {whose}, or in another CRS with its name "
            "behind: … [EPSG:4326]"
        )
    if not named:
        return box
    # The outline is transformed by way of WGS84, as all positions are
    west, south, east, north = box
    x, y = np.linspace(west, east, GRIDS.fine), np.linspace(south, north, GRIDS.fine)
    sides = [np.stack(np.broadcast_arrays(*side), axis=1) for side in ((x, south), (x, north), (west, y), (east, y))]
    outline = np.pad(np.concatenate(sides), ((0, 0), (0, 1)))
    xy = operations_of(crs).from_wgs84(operations_of(parse_crs(named, "`extent`: ").to_wkt()).to_wgs84(outline))
    box = (*xy.min(axis=0).tolist(), *xy.max(axis=0).tolist())
    if not (box[0] < box[2] and box[1] < box[3]) or not all(map(math.isfinite, box)):
        raise InputError(f"`extent` {extent!r} is no box in {whose}: give it in that")
    return box


def _make_grids(
    images: Sequence[Image], surface: HeightSurface, crs: str, resolution: float, extent: str
) -> dict[str, map_grids.MapGrid]:
    """Return the grid of each image for the extent of the option."""
    bounds = {image.id: map_grids.compute_footprint_bounds(image, surface, crs, resolution) for image in images}
    every = np.array(list(bounds.values()))
    if extent == "each":
        return {name: map_grids.MapGrid.from_bounds(crs, resolution, box) for name, box in bounds.items()}
    if extent == "union":
        box = (*every[:, :2].min(axis=0), *every[:, 2:].max(axis=0))
    elif extent == "overlap":
        box = (*every[:, :2].max(axis=0), *every[:, 2:].min(axis=0))
        if box[0] >= box[2] or box[1] >= box[3]:
            raise InputError("`extent` overlap: there is no ground that all images show; use union or each")
    else:
        box = parse_box(extent, crs)
    grid = map_grids.MapGrid.from_bounds(crs, resolution, box)
    missed = [name for name, (w, s, e, n) in bounds.items() if w >= box[2] or e <= box[0] or s >= box[3] or n <= box[1]]
    if missed:
        raise InputError(f"`extent` {extent} does not overlap {', '.join(missed)}: remove them or enlarge the extent")
    return dict.fromkeys(bounds, grid)


ENDING = "_ortho.tif"
MASK = "mask"
#: Packages whose versions influence the bytes of an orthoimage.
DECISIVE = ("hrsi", "gdal", "proj")


@dataclass(frozen=True, eq=False)
class OrthoJob:
    """One orthoimage: mapping of its pixels, parameters of the warping, and all inputs for the fingerprint.

    source : the image whose bands the orthoimage has; with ``pansharpening`` it is the multispectral one
    """

    image: Image
    path: str
    source: OrthoSource
    mapping: OrthoMapping
    warp: Warp
    form: orthoimages.OrthoFormat
    made_from: Mapping[str, Any]
    pansharpening: Pansharpening | None = None

    @property
    def grid(self) -> map_grids.MapGrid:
        return self.mapping.grid

    @cached_property
    def key(self) -> str:
        """Fingerprint that the file of the orthoimage will contain."""
        return orthoimages.fingerprint(self.made_from)

    def make_chunk(self, window: map_grids.GridWindow) -> orthoimages.OrthoChunk:
        """Return a window of the orthoimage."""
        if self.pansharpening is not None:
            return self.pansharpening.make_chunk(window)
        return orthoimages.make_chunk(self.source, self.mapping.chunk, self.warp, window)


def jobs_of(plan: BlockPlan, options: OrthorectifyOptions) -> list[OrthoJob]:
    """Return the orthoimages of a plan, one job each."""
    form, used = orthoimages.OrthoFormat(options.format, options.compression), versions()
    jobs, jitter_files = [], dict[str, JitterFile]()
    for image in plan.images:
        source, grid = OrthoSource(image.path), plan.grids[image.id]
        mapping = make_mapping(image, source, plan, grid, options, jitter_files)
        warp = Warp(options.resampling, mapping.source_pixels_per_pixel(), choose_nodata(options.nodata, source))
        # All data on which the pixels and the file depend
        made_from: dict[str, Any] = {
            "terrain": plan.terrain.identity,
            "crs": grid.crs,
            "grid": [grid.resolution, grid.left, grid.top, grid.columns, grid.rows],
            "resampling": warp.resampling,
            "nodata": str(warp.nodata),
            "error_px": options.error_px,
            "format": form.name,
            "compression": form.compression,
            "versions": {name: used[name] for name in DECISIVE},
            **identify_image(image, mapping),
            **({"visibility": True} if options.visibility else {}),
        }
        path = os.path.join(options.folder.output_dir, image.id + ENDING)
        jobs.append(OrthoJob(image, path, source, mapping=mapping, warp=warp, form=form, made_from=made_from))
    return jobs


def make_mapping(
    image: Image,
    source: OrthoSource,
    plan: BlockPlan,
    grid: map_grids.MapGrid,
    options: OrthorectifyOptions,
    jitter_files: dict[str, JitterFile],
) -> OrthoMapping:
    """Return the mapping of an image, with its jitter; warnings are added to the plan, opened files to the dict."""
    jitter, path = None, find_jitter_file(image.path)
    if path is not None:
        if path not in jitter_files:
            jitter_files[path] = JitterFile(path)
        jitter, told = jitter_files[path].find_curve(image.id, image.rpc)
        plan.warnings.extend([told] if told else [])
    known = plan.terrain_points.get(image.id)
    return OrthoMapping(
        image.rpc,
        source.size,
        plan.terrain.surface,
        terrain=map_grids.find_terrain_points(image, plan.terrain.surface) if known is None else known,
        grid=grid,
        error_px=options.error_px,
        jitter=jitter,
        masks_occlusions=options.visibility,
    )


def identify_image(image: Image, mapping: OrthoMapping) -> dict[str, Any]:
    """Return the state of an image's file, RPC and jitter for the fingerprint."""
    coefficients = {name: np.asarray(value).tolist() for name, value in vars(image.rpc).items() if name[0] != "_"}
    identity = {
        "image": orthoimages.file_state(image.path),
        "rpc": hashlib.sha256(json_text(coefficients, sort_keys=True).encode()).hexdigest(),
    }
    if mapping.jitter is not None:
        identity["jitter"] = hashlib.sha256(mapping.jitter.shift_px.tobytes()).hexdigest()
    return identity


def choose_nodata(given: str | None, source: OrthoSource) -> float | None:
    """Return the value of pixels outside the image; None for a mask band."""
    own = [value for value in source.nodata if value is not None]
    if given == MASK or (given is None and not own and source.masked):
        return None
    if given is None:
        return float(own[0]) if own else (0.0 if source.is_integer else math.nan)
    try:
        value = float(given)
    except ValueError:
        raise InputError(f"`nodata` {given!r} is neither a number nor mask") from None
    if not source.holds(value):
        raise InputError(f"`nodata` {given}: {source.path} has {source.type_name} pixels, which cannot represent it")
    return value


@dataclass(frozen=True)
class OrthoRecipe:
    """All data that a worker needs for chunks of an orthoimage; it opens the surface of ``mapping`` itself."""

    key: str
    path: str = field(compare=False)
    mapping: OrthoMapping = field(compare=False)
    terrain: OrthorectifyOptions = field(compare=False)
    warp: Warp = field(compare=False)
    versions: Mapping[str, str] = field(compare=False)


def chunks_of(jobs: Sequence[OrthoJob], options: OrthorectifyOptions, calls: Calls) -> Iterator[orthoimages.OrthoChunk]:
    """Yield the chunks of all orthoimages in the order in which they are written."""
    windows = ((job, window) for job in jobs for window in orthoimages.chunk_windows(job.grid, job.warp))
    if not calls.elsewhere:
        yield from calls.answers(lambda part: part[0].make_chunk(part[1]), windows)
        return
    recipes = {job.key: recipe_of(job, options) for job in jobs}
    yield from calls.answers(_chunk_elsewhere, ((recipes[job.key], window) for job, window in windows))


def recipe_of(job: OrthoJob, options: OrthorectifyOptions) -> OrthoRecipe:
    """Return the data of a job for other processes: file names that are valid there, and no opened files."""
    terrain = options.terrain
    dem = replace(terrain.dem, dem=_elsewhere(terrain.dem.dem), dem_datum=_elsewhere(terrain.dem.dem_datum))
    datum, points, used = path_elsewhere(terrain.height_datum), options.terrain_points, versions()
    if points is not None:
        file, _ = split_spec(points)
        points = path_elsewhere(file) + points[len(file) :]
    named = replace(options, images=(), terrain=replace(terrain, dem=dem, height_datum=datum), terrain_points=points)
    return OrthoRecipe(
        job.key,
        path_elsewhere(job.image.path),
        replace(job.mapping, surface=ConstantHeight(0.0)),
        named,
        job.warp,
        {name: used[name] for name in DECISIVE},
    )


def _elsewhere(path: str | None) -> str | None:
    return None if path is None else path_elsewhere(path)


def _chunk_elsewhere(part: tuple[OrthoRecipe, map_grids.GridWindow]) -> orthoimages.OrthoChunk:
    """Return a chunk of a recipe; raise `InputError` if another version of a program would make it otherwise."""
    (recipe, window), used = part, versions()
    if others := [f"{name} {used[name]} where {text}" for name, text in recipe.versions.items() if used[name] != text]:
        raise InputError(
            f"{others[0]} is wanted: orthoimages would differ from chunk to chunk: install the same version everywhere"
        )
    source, mapping = _open_recipe(recipe)
    return orthoimages.make_chunk(source, mapping.chunk, recipe.warp, window)


@lru_cache(maxsize=8)
def _open_recipe(recipe: OrthoRecipe) -> tuple[OrthoSource, OrthoMapping]:
    """Return image and mapping of a recipe, cached for its next chunks."""
    return OrthoSource(recipe.path), replace(recipe.mapping, surface=_open_surface(recipe.terrain))


@lru_cache(maxsize=2)
def _open_surface(options: OrthorectifyOptions) -> HeightSurface:
    return open_ortho_terrain(options).surface
