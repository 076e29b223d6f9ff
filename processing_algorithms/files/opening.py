"""Opening of images, with their pixels where they are needed, and of the terrain, as several algorithms need it.

Coordinates as lines of text, in the format of `gdaltransform`.
"""

import math
import os
import sys
from collections.abc import Iterable, Sequence
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from ...hrsi_engine.block.block import Image, Raster
from ...hrsi_engine.block.exposures import join_exposures
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import LISTS
from ...hrsi_engine.ground.operation_uses import require_strict_datums
from ...hrsi_engine.io.opening.files import has_decimal_commas, parse_finite
from ...hrsi_engine.io.rasters.images import RPC_SUFFIX, GdalRaster, image_id, open_image_and_source, placement_doubt
from ...hrsi_engine.io.rpc_files.find import read_rpc_or_none
from ...hrsi_engine.io.surfaces import open_dtm, open_surface
from ...hrsi_engine.measurement.interest_points.windows import Area
from ...hrsi_engine.surface.dem import HeightSurface, cell_size_m, dem_sigma_m, intersect_surface
from ...hrsi_engine.surface.grid_surface import ConstantHeight, GridSurface
from ..interface.declare import Context, Report
from ..interface.option_groups import DemOptions, PointFiles, SurfaceFile, TerrainOptions
from .result_folder import tell


def open_images(paths: Sequence[str], context: Context, always: bool = True) -> list[Image]:
    """Open the images of an algorithm, or RPC files alone; log the source of each RPC, other sources, and doubts.

    For a filter (not ``always``) only a choice between several RPCs is logged.
    """
    require_ids(paths, [image_id(path) for path in paths])
    images = []
    for path in paths:
        image, found = open_image_and_source(path)
        if found.ignored or (always and len(paths) <= LISTS.images):
            context.log(f"{image.id}: {found.summary}")
        images.append(image)
    images = join_exposures(images)
    for image in images:
        tell([f"{image.id}: {doubt}"] if (doubt := placement_doubt(image)) else [], context)
    return images


def require_ids(paths: Sequence[str], ids: Sequence[str]) -> None:
    """Raise `InputError` if two images have the same id."""
    named: dict[str, str] = {}
    for path, name in zip(paths, ids, strict=True):
        if name in named:
            if named[name] == path:
                raise InputError(f"{path} is given twice: name each image once")
            is_shortened = any(
                f"{name}{RPC_SUFFIX}.".lower() in os.path.basename(str(file)).lower() for file in (path, named[name])
            )
            reason = ", which leaves out _RPC at the end of a file name" if is_shortened else ""
            raise InputError(
                f"{named[name]} and {path} have the same id {name!r}{reason}: rename one, or give only one"
            )
        named[name] = path


def is_on_image(image: Image, xy: np.ndarray) -> np.ndarray:
    """Return the mask of image points ``(n, 2)`` on the image's pixels, or in the validity domain of an RPC file."""
    low, high = np.reshape(image.domain_px, (2, 2)).T  # of sample and line
    return np.asarray(((xy >= low - 0.5) & (xy <= high + 0.5)).all(axis=1))


class ImagePixels(NamedTuple):
    """An image opened for its pixels; ``rpc`` is None if it has none."""

    id: str
    path: str
    raster: Raster
    rpc: RPC | None


def open_pixels(path: str, band: int = 1) -> ImagePixels:
    """Open an image; raise `InputError` if it has no pixels, or a damaged RPC."""
    raster = GdalRaster(path, band)
    found = read_rpc_or_none(path)
    return ImagePixels(image_id(path), path, raster, None if found is None else found.rpc)


def ground_of(image: ImagePixels, xy: np.ndarray, surface: HeightSurface | None) -> np.ndarray:
    """Return lon, lat, height ``(n, 3)`` of image points on a surface, or at the RPC's mean height without a surface.

    NaN without RPC.
    """
    if image.rpc is None or not len(xy):
        return np.full((len(xy), 3), np.nan)
    if surface is None:
        return image.rpc.localize(xy, image.rpc.height_off).ground
    return intersect_surface(image.rpc, xy, surface)[0]


def window_area(text: str | None, argument: str) -> Area | None:
    """Return the window of ``sample,line,samples,lines``; raise `InputError` with the argument for other text."""
    if text is None:
        return None
    try:
        sample, line, samples, lines = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"`{argument}` {text!r} is not SAMPLE,LINE,SAMPLES,LINES: give four whole numbers") from None
    return Area(sample, line, sample + samples, line + lines)


def ground_warnings(images: Sequence[ImagePixels], grounds: Sequence[np.ndarray]) -> list[str]:
    """Return a warning for each image with an RPC in which some or all points ``(n, 3)`` have no ground position."""
    lost = {
        image.id: int(np.isnan(ground).any(axis=1).sum())
        for image, ground in zip(images, grounds, strict=True)
        if image.rpc is not None
    }
    return [f"{name}: {count} points have no position on the terrain" for name, count in lost.items() if count]


def dem_surface(
    dem: DemOptions, height_datum: str, epoch: float | None = None, strict_datum: bool = False
) -> GridSurface | None:
    """Return the opened DEM of the options, None if none is named; its own datum precedes ``height_datum``.

    With ``strict_datum`` raises `InputError` if a geoid or the grid of a coordinate operation is missing.
    """
    surface = open_dtm(dem.dem, dem.dem_datum or height_datum, epoch) if dem.dem else None
    require_strict_datums(() if surface is None else surface.operations, strict_datum)
    return surface


def open_control_surface(
    file: SurfaceFile, points: PointFiles, kind: str, near: RPC
) -> tuple[GridSurface, float] | None:
    """Return the surface of the options, and the standard deviation (m) of its heights near an image; None if none.

    kind : ``dsm`` or ``dtm``
    """
    if not file.surface:
        return None
    datum, middle = file.surface_datum or points.height_datum, np.array([near.long_off, near.lat_off, near.height_off])
    surface = open_surface(str(file.surface), datum, points.ground_crs, points.gcp_epoch, kind)
    return surface, file.sigma_surface or dem_sigma_m(cell_size_m(surface, middle))


def open_terrain(options: TerrainOptions) -> HeightSurface | None:
    """Return the ground surface of the options, a DEM or a constant height; None if they name none."""
    if options.dem.dem is not None and options.height is not None:
        raise InputError("`dem` and `height` both define the height of the ground: give one of them")
    if options.height is not None:
        return ConstantHeight(options.height)
    return dem_surface(options.dem, options.height_datum, strict_datum=options.strict_datum)


def standard_input(example: str) -> Iterable[str]:
    """Return the piped lines; if there is no pipe, raise `InputError` instead of waiting for keyboard input."""
    if sys.stdin is None or sys.stdin.closed or sys.stdin.isatty():
        raise InputError(f"no points are given: name a file with `points`, or pipe lines {example!r} into the command")
    return sys.stdin


def parse_lines(lines: Iterable[str], names: Sequence[str]) -> tuple[np.ndarray, list[str]]:
    """Return the numbers of lines ``(n, len(names))`` and the rest of each line.

    Numbers are separated by blanks, tabs or commas; the last may be missing (NaN). Empty lines are skipped. Raises
    `InputError` with the number of the line.
    """
    numbers, rest = [], []
    for count, line in enumerate(lines, start=1):
        if has_decimal_commas(line):
            raise InputError(f"line {count}: {line.strip()[:60]!r} has decimals behind commas: write them with a point")
        words = line.replace(",", " ").split()
        if not words:
            continue
        values = list(takewhile(lambda value: value is not None, map(parse_finite, words[: len(names)])))
        if len(values) < len(names) - 1:
            raise InputError(f"line {count}: {line.strip()[:60]!r} does not begin with {' '.join(names)}: correct it")
        rest.append(" ".join(words[len(values) :]))
        numbers.append(values + [math.nan] * (len(names) - len(values)))
    return np.array(numbers, dtype=np.float64).reshape(-1, len(names)), rest


def list_points(report: Report, kind: str, names: Sequence[str], line: Sequence[str]) -> str:
    """Return the points of a report as lines: ``names`` under a header if they are from a file, otherwise ``line``.

    Points that are in a folder are only counted, as ``kind``.
    """
    if "points" not in report:
        return f"{report['count']} {kind}"
    if report["from_file"]:
        return format_lines([names, *map(dict.values, report["points"])], ",")
    return format_lines((row[name] for name in line) for row in report["points"])


def format_lines(rows: Iterable[Iterable[float | str | None]], separator: str = " ") -> str:
    """Return rows as text with 15 significant digits, and ``nan`` for a missing value."""
    texts = (
        ["nan" if cell is None else cell if isinstance(cell, str) else f"{cell:.15g}" for cell in row if cell != ""]
        for row in rows
    )
    return "\n".join(map(separator.join, texts))
