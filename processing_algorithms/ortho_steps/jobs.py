"""The orthoimages of a plan: how each is made, what tells one from another, and who warps their chunks.

Threads share what is open here; workers open it themselves.
"""

import hashlib
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.json_values import json_text
from ...hrsi_engine.foundation.workers.scheduling import Calls
from ...hrsi_engine.io.catalogue.lineage import versions
from ...hrsi_engine.io.point_files.find import split_spec
from ...hrsi_engine.io.rasters.images import path_elsewhere
from ...hrsi_engine.io.rasters.ortho_warp import OrthoSource, Warp
from ...hrsi_engine.io.rasters.orthoimages import (
    OrthoChunk,
    OrthoFormat,
    chunk_windows,
    file_state,
    fingerprint,
    make_chunk,
)
from ...hrsi_engine.ortho.grid import GridWindow, MapGrid
from ...hrsi_engine.ortho.mapping import OrthoMapping
from ...hrsi_engine.surface.dem import HeightSurface
from ..declarations.orthoimages import OrthorectifyOptions
from .inputs import BlockPlan, open_ortho_terrain

ENDING = "_ortho.tif"
MASK = "mask"
#: Whose versions decide about the bytes of an orthoimage.
DECISIVE = ("hrsi", "gdal", "proj")


@dataclass(frozen=True, eq=False)
class OrthoJob:
    """One orthoimage: how its pixels map, how it is warped, and all that it is made from, for the fingerprint."""

    image: Image
    path: str
    source: OrthoSource
    mapping: OrthoMapping
    warp: Warp
    form: OrthoFormat
    made_from: Mapping[str, Any]

    @property
    def grid(self) -> MapGrid:
        return self.mapping.grid

    @cached_property
    def key(self) -> str:
        """The fingerprint that its file will carry."""
        return fingerprint(self.made_from)


def jobs_of(plan: BlockPlan, options: OrthorectifyOptions) -> list[OrthoJob]:
    """Return the orthoimages of a plan."""
    form, used = OrthoFormat(options.format, options.compression), versions()
    jobs = []
    for image in plan.images:
        source = OrthoSource(image.path)
        grid = plan.grids[image.id]
        mapping = OrthoMapping(image.rpc, source.size, plan.terrain.surface, grid, options.error_px)
        scale = mapping.source_pixels_per_pixel()
        warp = Warp(options.resampling, scale, _nodata_value(options.nodata, source))
        path = os.path.join(options.folder.output_dir, image.id + ENDING)
        # Everything on which the pixels and the file depend
        coefficients = {name: np.asarray(value).tolist() for name, value in vars(image.rpc).items() if name[0] != "_"}
        made_from = {
            "image": file_state(image.path), "terrain": plan.terrain.identity, "crs": grid.crs,
            "rpc": hashlib.sha256(json_text(coefficients, sort_keys=True).encode()).hexdigest(),
            "grid": [grid.resolution, grid.left, grid.top, grid.columns, grid.rows], "resampling": warp.resampling,
            "nodata": str(warp.nodata), "error_px": options.error_px, "format": form.name,
            "compression": form.compression, "versions": {name: used[name] for name in DECISIVE},
        }  # fmt: skip
        jobs.append(OrthoJob(image, path, source, mapping, warp, form, made_from))
    return jobs


def _nodata_value(given: str | None, source: OrthoSource) -> float | None:
    """Return the value of pixels that the image does not show; None for a mask band."""
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
        raise InputError(f"`nodata` {given}: {source.path} has {source.type_name} pixels, which cannot hold it")
    return value


@dataclass(frozen=True)
class OrthoRecipe:
    """All that a worker needs to make chunks of an orthoimage; ``key`` tells one from another."""

    key: str
    path: str = field(compare=False)
    rpc: RPC = field(compare=False)
    terrain: OrthorectifyOptions = field(compare=False)
    grid: MapGrid = field(compare=False)
    error_px: float = field(compare=False)
    warp: Warp = field(compare=False)
    versions: Mapping[str, str] = field(compare=False)


def chunks_of(jobs: Sequence[OrthoJob], options: OrthorectifyOptions, calls: Calls) -> Iterator[OrthoChunk]:
    """Yield the chunks of all orthoimages, in the order in which they are written."""
    windows = ((job, window) for job in jobs for window in chunk_windows(job.grid, job.warp))
    if not calls.elsewhere:
        yield from calls.answers(_chunk_here, windows)
        return
    recipes = {job.key: recipe_of(job, options) for job in jobs}
    yield from calls.answers(_chunk_elsewhere, ((recipes[job.key], window) for job, window in windows))


def _chunk_here(part: tuple[OrthoJob, GridWindow]) -> OrthoChunk:
    job, window = part
    return make_chunk(job.source, job.mapping.chunk, job.warp, window)


def recipe_of(job: OrthoJob, options: OrthorectifyOptions) -> OrthoRecipe:
    """Return what travels of a job: names of files by which other processes find them, nothing that is open."""
    terrain = options.terrain
    dem = replace(terrain.dem, dem=_elsewhere(terrain.dem.dem), dem_datum=_elsewhere(terrain.dem.dem_datum))
    datum = path_elsewhere(terrain.height_datum)
    points = options.terrain_points
    if points is not None:
        file, _ = split_spec(points)
        points = path_elsewhere(file) + points[len(file) :]
    named = replace(options, images=(), terrain=replace(terrain, dem=dem, height_datum=datum), terrain_points=points)
    used = versions()
    return OrthoRecipe(
        job.key, path_elsewhere(job.image.path), job.image.rpc, named, replace(job.grid), options.error_px, job.warp,
        {name: used[name] for name in DECISIVE},
    )  # fmt: skip


def _elsewhere(path: str | None) -> str | None:
    return None if path is None else path_elsewhere(path)


def _chunk_elsewhere(part: tuple[OrthoRecipe, GridWindow]) -> OrthoChunk:
    recipe, window = part
    used = versions()
    for name, version in recipe.versions.items():
        if used[name] != version:
            raise InputError(
                f"{name} {used[name]} where {version} is wanted: orthoimages would differ from chunk to chunk: install "
                "the same version everywhere"
            )
    source, mapping = _open_recipe(recipe)
    return make_chunk(source, mapping.chunk, recipe.warp, window)


@lru_cache(maxsize=8)
def _open_recipe(recipe: OrthoRecipe) -> tuple[OrthoSource, OrthoMapping]:
    """Return image and mapping of a recipe, kept for its next chunks."""
    source = OrthoSource(recipe.path)
    mapping = OrthoMapping(recipe.rpc, source.size, _open_surface(recipe.terrain), recipe.grid, recipe.error_px)
    return source, mapping


@lru_cache(maxsize=2)
def _open_surface(options: OrthorectifyOptions) -> HeightSurface:
    return open_ortho_terrain(options).surface
