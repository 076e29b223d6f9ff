"""Heights of laser altimeters: choice of the reader of a file, and the check of its rows.

`read_laser` takes granules of ICESat-2 and GEDI as the archives deliver them (HDF5: ATL06, ATL08, GEDI L2A), what
SlideRule writes (GeoParquet, GeoPackage, CSV), or a vector layer with the fields ``height`` and ``sigma_h``. GeoParquet
is read through PyArrow: GDAL has a driver for it only where it was built with one.

A granule, read through GDAL, has a group for each beam, in it one of the product's points, whose arrays have one row a
point. `PRODUCTS` has for each product the names of its arrays, and which of them mark unreliable points.
Sources: the products' specifications (Smith et al., ATBD for ATL06; Neuenschwander et al., ATBD for ATL08;
Dubayah et al., GEDI L2A data dictionary). All heights are ellipsoidal (WGS84, ITRF2014).
"""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from osgeo import gdal

from ..block.imaging_geometry import GEOMETRY
from ..block.laser import LaserPoints
from ..foundation.errors import InputError
from ..foundation.json_values import json_text
from .opening.budgets import FILE_BUDGETS, RASTER_BUDGETS
from .opening.datasets import quiet, read_head
from .opening.hdf5 import HDF5_HEAD, open_hdf5, read_array
from .point_files.find import choose_fields, read_table, split_spec
from .point_files.ogr_layer import parse_wkb_points
from .point_files.positions import Reference, ground_positions, has_positions
from .point_files.table import NUMBER_FIELDS, PointTable, match_fields


def read_laser(
    spec: str, height_datum: str = "ellipsoidal", ground_crs: str | None = None, epoch: float | None = None
) -> LaserPoints:
    """Return the laser points of a file.

    spec : a granule (ATL06, ATL08, GEDI L2A), GeoParquet, or ``FILE[|layername=L]`` of points with the fields
    ``height`` or ``h_mean``, and ``sigma_h`` or ``h_sigma``
    height_datum : reference of the heights of a layer: ``ellipsoidal``, ``layer`` (as its CRS states), ``egm96``,
    ``egm2008`` or a geoid grid file. Granules are always ellipsoidal
    ground_crs : CRS of x and y in a file that states none; longitudes and latitudes are WGS84
    epoch : year at which coordinates in a plate-fixed CRS are transformed to WGS84

    All points are returned; those with impossible heights have a ``doubt``. Raises `InputError` with file, field and
    remedy.
    """
    path, _layer = split_spec(spec)
    head = read_head(path, len(HDF5_HEAD)) if os.path.isfile(path) else b""  # readers of point files report errors
    if head == HDF5_HEAD:
        points = read_granule(path)
    else:
        table = read_parquet(path, choose_fields(spec)) if head.startswith(b"PAR1") else read_table(spec)
        points = _read_points(table, Reference(ground_crs or "", height_datum, epoch=epoch))
    is_impossible = (points.ground[:, 2] <= RASTER_BUDGETS.no_data_m) | (
        points.ground[:, 2] > GEOMETRY.highest_height_m
    )
    if not len(points) or is_impossible.all():
        raise InputError(f"{points.source}: none of its points has a height that is on the ground: obtain it again")
    return replace(points, doubt=np.where(is_impossible & (points.doubt == ""), "a height of no ground", points.doubt))


def _read_points(table: PointTable, reference: Reference) -> LaserPoints:
    """Return the rows of a table that have a position and a height."""
    if not len(table):
        raise InputError(f"{table.source}: contains no points: name another file or layer")
    if not has_positions(table):
        raise InputError(
            f"{table.source}: has no positions (point geometry, or fields lon and lat); its fields are "
            f"{', '.join(table.field_names) or 'none'}: add them"
        )
    heights = table.columns.get("height")
    if heights is None and (table.geometry is None or not np.isfinite(table.geometry[:, 2]).any()):
        raise InputError(
            f"{table.source}: has no heights: laser points need a field height (or h_mean), or points with z"
        )
    # Points without a height are omitted, so that their height is not taken from a DEM
    z = np.full(len(table), np.nan) if table.geometry is None else table.geometry[:, 2]
    has_height = ~np.isnan(z) if heights is None else ~(np.isnan(heights) & np.isnan(z))
    if not has_height.any():
        raise InputError(f"{table.source}: none of its points has a height: name another file or layer")
    if not has_height.all():
        table = table.select(has_height)
    if table.geometry is None and not {"x", "y"} <= table.columns.keys():
        reference = replace(reference, ground_crs="")
    placed = ground_positions(table, reference)
    nothing = np.full(len(table), np.nan)
    sigma = table.columns.get("sigma_h", nothing)
    sources = {name: table.columns.get(name, nothing) for name in ("slope", "misfit", "photons", "canopy")}
    ids = table.columns.get("id")
    # Track of each row: from the file, or reference ground track and cycle
    if "track" in table.columns:
        track = table.columns["track"]
    else:
        text = np.full(len(table), "", dtype=str)
        for field in ("rgt", "cycle"):  # these identify a pass of ICESat-2; its beams share most errors
            if field in table.columns:
                number = np.char.mod("%g", table.columns[field])
                text = np.char.add(np.char.add(text, np.where(text == "", f"{field} ", f", {field} ")), number)
        track = text
    return LaserPoints(
        placed.ground,
        ids=None if ids is None or (ids == "").any() else ids,
        track=track,
        sigma_m=np.where(sigma > 0.0, sigma, np.nan),
        slope=sources["slope"],
        misfit_m=sources["misfit"],
        photons=sources["photons"],
        canopy_m=sources["canopy"],
        source=table.source,
        operations=placed.operations,
    )


def read_parquet(path: str, selection: Mapping[str, str] | None = None) -> PointTable:
    """Return the points of a GeoParquet file with its known fields, or with the ``selection`` ones (`match_fields`)."""
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise InputError(
            f"{path}: reading GeoParquet needs PyArrow (pip install pyarrow), or a GDAL with a Parquet driver; or save "
            "the points as GeoPackage or CSV"
        ) from None
    try:
        file = parquet.ParquetFile(path)
        if file.metadata.num_rows > FILE_BUDGETS.array_values:
            raise InputError(
                f"{path}: claims {file.metadata.num_rows} rows, more than any table of laser points has: "
                "obtain it again"
            )
        # The file's description of its geometry
        try:
            geo = json.loads((file.schema_arrow.metadata or {}).get(b"geo", b"{}"))
        except (ValueError, RecursionError):
            geo = None
        if not isinstance(geo, dict) or not isinstance(geo.get("columns", {}), dict):
            raise InputError(f"{path}: its description of the geometry ('geo') is damaged: obtain it again")
        names = list(file.schema_arrow.names)
        result = {
            field: names[index]
            for field, index in match_fields(names, selection, path).items()
            if field in NUMBER_FIELDS
        }
        place = geo.get("primary_column", "geometry")
        table = file.read(columns=[*result.values(), *([place] if place in names else [])])
        columns = {}
        for field, name in result.items():
            values = table.column(name).to_numpy()
            if values.dtype.kind not in "iufb" and not all(v is None or isinstance(v, (int, float)) for v in values):
                raise InputError(f"{path}: field {name!r} contains no numbers: correct it")
            columns[field] = np.asarray(values, dtype=np.float64)  # NaN where it is null
        geometry = None
        if place in names:  # points in well-known binary, of equal length
            points = [value for value in table.column(place).to_pylist() if isinstance(value, bytes)]
            geometry = parse_wkb_points(b"".join(points), len(points))
            if geometry is None or len(points) < len(table) or len(set(map(len, points))) > 1:
                raise InputError(f"{path}: its geometry is not points alone: give a layer of points")
    except (ArrowException, OSError, ValueError, MemoryError, OverflowError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: cannot be read as GeoParquet ({reason}): obtain it again") from None
    crs = geo.get("columns", {}).get(place, {}).get("crs", "OGC:CRS84")
    text = json_text(crs) if isinstance(crs, dict) else str(crs or "")
    return PointTable(path, columns, tuple(names), partial("row {}".format), geometry, text)


#: Arrays of a beam, by HRSI's names; arrays that the granule lacks are omitted.
BeamArrays = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Product:
    """Layout of a product.

    beam, points : first letters of the groups of beams; group of the points in a beam (empty: the beam itself)
    arrays : HRSI's names -> paths of arrays below that group
    doubts : reason why a point is unreliable -> array, comparison and number that select these points
    stated_sigma_m : standard deviation of a height, if the granule states none
    """

    title: str
    beam: str
    points: str
    arrays: Mapping[str, str]
    doubts: Mapping[str, tuple[str, Callable[[np.ndarray, float], np.ndarray], float]]
    stated_sigma_m: float = float("nan")


PRODUCTS: dict[str, Product] = {
    "ATL06": Product(
        "ICESat-2 ATL06", "gt", "land_ice_segments",
        {
            "lon": "longitude", "lat": "latitude", "height": "h_li", "sigma": "h_li_sigma",
            "slope": "fit_statistics/dh_fit_dx", "misfit": "fit_statistics/h_rms_misfit",
            "photons": "fit_statistics/n_fit_photons", "quality": "atl06_quality_summary",
        },
        {"flagged by the product": ("quality", np.not_equal, 0.0)},
    ),
    "ATL08": Product(
        "ICESat-2 ATL08", "gt", "land_segments",
        {
            "lon": "longitude", "lat": "latitude", "height": "terrain/h_te_best_fit",
            "misfit": "terrain/h_te_std", "slope": "terrain/terrain_slope", "photons": "terrain/n_te_photons",
            "canopy": "canopy/h_canopy", "cloud": "cloud_flag_atm", "water": "segment_watermask",
            "scattering": "msw_flag", "doubtful": "terrain_flg",
        },
        {
            "cloud over the point": ("cloud", np.greater, 1.0),
            "water": ("water", np.equal, 1.0),
            "light scattered more than once": ("scattering", np.greater, 1.0),
            "terrain flagged by the product": ("doubtful", np.equal, 0.0),
        },
    ),
    "GEDI02_A": Product(
        "GEDI L2A", "BEAM", "",
        {
            "lon": "lon_lowestmode", "lat": "lat_lowestmode", "height": "elev_lowestmode",
            "sensitivity": "sensitivity", "quality": "quality_flag", "degraded": "degrade_flag",
            "surface": "surface_flag", "modes": "num_detectedmodes", "heights": "rh",
        },
        {
            "flagged by the product": ("quality", np.not_equal, 1.0),
            "orbit or pointing degraded": ("degraded", np.greater, 0.0),
            "far from the terrain known there": ("surface", np.equal, 0.0),
            "too little sensitivity": ("sensitivity", np.less, 0.9),
        },
        stated_sigma_m=1.0,
    ),
}  # fmt: skip


def read_granule(path: str) -> LaserPoints:
    """Return all points with heights of a granule; raise `InputError` if it is of no known product."""
    root = open_hdf5(path)
    with quiet():
        for product in PRODUCTS.values():
            result = list(_read_beams(path, root, product))
            if result:
                return _stack_beams(path, product, result)
    titles = ", ".join(product.title for product in PRODUCTS.values())
    raise InputError(f"{path}: is no granule that is known ({titles}): name another file")


def _read_beams(path: str, root: gdal.Group, product: Product) -> Iterator[tuple[str, BeamArrays]]:
    """Yield the beams of a product that have heights, with their arrays."""
    for beam in root.GetGroupNames() or []:
        if not beam.startswith(product.beam):
            continue
        place = f"/{beam}/{product.points}".rstrip("/")
        read = {name: read_array(path, root, f"{place}/{part}") for name, part in product.arrays.items()}
        known = {name: np.asarray(values, np.float64) for name, values in read.items() if values is not None}
        limits = RASTER_BUDGETS.no_data_m, np.finfo(np.float32).max  # fill values lie beyond them
        arrays = {name: np.where((v > limits[0]) & (v < limits[1]), v, np.nan) for name, v in known.items()}
        if {"lon", "lat", "height"} <= arrays.keys():
            count = len(arrays["height"])
            damaged = [name for name, values in arrays.items() if len(values) != count]
            if damaged:
                raise InputError(
                    f"{path}, {place}: {', '.join(sorted(damaged))} have another length than the heights: "
                    "obtain it again"
                )
            yield beam, arrays


def _stack_beams(path: str, product: Product, beams: list[tuple[str, BeamArrays]]) -> LaserPoints:
    """Return the points of all beams as one table."""
    parts: dict[str, list[np.ndarray]] = {}
    name = os.path.basename(path)
    for beam, arrays in beams:
        ground = np.column_stack([arrays["lon"], arrays["lat"], arrays["height"]])
        finite = np.flatnonzero(np.isfinite(ground).all(axis=1))
        empty = np.full(len(ground), np.nan)
        doubt = np.full(len(ground), "", dtype="U64")
        for reason, (name_of_array, compare, limit) in product.doubts.items():
            if name_of_array in arrays:
                doubt[compare(arrays[name_of_array], limit) & (doubt == "")] = reason
        canopy = arrays["heights"][:, -3] if arrays.get("heights", empty).ndim == 2 else arrays.get("canopy", empty)
        columns = {
            "ground": ground,
            "sigma_m": arrays.get("sigma", np.full(len(ground), product.stated_sigma_m)),
            "slope": arrays.get("slope", empty),
            "misfit_m": arrays.get("misfit", empty),
            "photons": arrays.get("photons", empty),
            "canopy_m": canopy,
            "doubt": doubt,
            "track": np.full(len(ground), name),
            "ids": np.char.add(f"{beam}-", np.arange(len(ground)).astype(str)),
        }
        for column, values in columns.items():
            parts.setdefault(column, []).append(values[finite])
    return LaserPoints(source=path, **{column: np.concatenate(values) for column, values in parts.items()})
