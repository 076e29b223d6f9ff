"""The orthoimages of a plan: how each is made, and what tells one from another."""

import hashlib
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.json_values import json_text
from ...hrsi_engine.io.catalogue.versions import versions
from ...hrsi_engine.io.rasters.ortho_warp import OrthoSource, Warp
from ...hrsi_engine.io.rasters.orthoimages import OrthoFormat, file_state, fingerprint
from ...hrsi_engine.ortho.grid import MapGrid
from ...hrsi_engine.ortho.mapping import OrthoMapping
from ..declarations.orthorectify import OrthorectifyOptions
from .inputs import BlockPlan

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
