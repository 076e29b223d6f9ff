"""Granules of laser altimeters (HDF5), read through GDAL: ICESat-2 ATL06 and ATL08, GEDI L2A.

A granule has a group for each beam, in it one of the product's points, whose arrays have one row a point. `PRODUCTS`
says for each product how its arrays are called and which of them tell that a point is not to be trusted. Sources: the
products' specifications (Smith et al., ATBD for ATL06; Neuenschwander et al., ATBD for ATL08; Dubayah et al., GEDI L2A
data dictionary). All heights are ellipsoidal (WGS84, ITRF2014).
"""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from osgeo import gdal

from ...block.laser import LaserPoints
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from ..opening.budgets import FILE_BUDGETS
from ..opening.datasets import gdal_messages, quiet

HDF5_HEAD = b"\x89HDF\r\n\x1a\n"


@thresholds
class GRANULE_FILL:
    """Which numbers of a granule stand for no value."""

    largest: float = threshold(1e30, "m", "largest value", "the products fill with 3.4e38")
    lowest: float = threshold(-9990.0, "m", "lowest value", "the products fill with -9999")


#: A beam's arrays by our names, as far as the granule has them.
BeamArrays = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Product:
    """How a product is laid out.

    beam, points : what the names of beams begin with; the group of points in a beam (empty: the beam itself)
    arrays : our names -> paths of arrays below that group
    doubts : why a point is not to be trusted -> which are not, from the arrays
    stated_sigma_m : of a height, where the granule states none
    """

    title: str
    beam: str
    points: str
    arrays: Mapping[str, str]
    doubts: Mapping[str, Callable[[BeamArrays], np.ndarray | None]]
    stated_sigma_m: float = float("nan")


def _is_equal(name: str, *values: float) -> Callable[[BeamArrays], np.ndarray | None]:
    return lambda arrays: np.isin(arrays[name], values) if name in arrays else None


def _is_not(name: str, value: float) -> Callable[[BeamArrays], np.ndarray | None]:
    return lambda arrays: arrays[name] != value if name in arrays else None


def _is_above(name: str, limit: float) -> Callable[[BeamArrays], np.ndarray | None]:
    return lambda arrays: arrays[name] > limit if name in arrays else None


def _is_below(name: str, limit: float) -> Callable[[BeamArrays], np.ndarray | None]:
    return lambda arrays: arrays[name] < limit if name in arrays else None


PRODUCTS: dict[str, Product] = {
    "ATL06": Product(
        "ICESat-2 ATL06", "gt", "land_ice_segments",
        {
            "lon": "longitude", "lat": "latitude", "height": "h_li", "sigma": "h_li_sigma",
            "slope": "fit_statistics/dh_fit_dx", "misfit": "fit_statistics/h_rms_misfit",
            "photons": "fit_statistics/n_fit_photons", "quality": "atl06_quality_summary",
        },
        {"flagged by the product": _is_not("quality", 0.0)},
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
            "cloud over the point": _is_above("cloud", 1.0),
            "water": _is_equal("water", 1.0),
            "light scattered more than once": _is_above("scattering", 1.0),
            "terrain flagged by the product": _is_equal("doubtful", 0.0),
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
            "flagged by the product": _is_not("quality", 1.0),
            "orbit or pointing degraded": _is_above("degraded", 0.0),
            "far from the terrain known there": _is_equal("surface", 0.0),
            "too little sensitivity": _is_below("sensitivity", 0.9),
        },
        stated_sigma_m=1.0,
    ),
}  # fmt: skip


def read_granule(path: str) -> LaserPoints:
    """Return all points of a granule with heights; raise `InputError` where it is none that is known."""
    dataset = None
    with gdal_messages() as messages:
        dataset = gdal.OpenEx(path, gdal.OF_MULTIDIM_RASTER, allowed_drivers=["HDF5"])
    if dataset is None:
        if gdal.GetDriverByName("HDF5") is None:
            raise InputError(f"{path}: this GDAL reads no HDF5: get the points as GeoParquet or CSV from SlideRule")
        raise InputError(f"{path}: cannot be opened as HDF5 ({' '.join(messages) or 'damaged'}): get it again")
    with quiet():
        root = dataset.GetRootGroup()
        for product in PRODUCTS.values():
            found = list(_read_beams(path, root, product))
            if found:
                return _stack_beams(path, product, found)
    titles = ", ".join(product.title for product in PRODUCTS.values())
    raise InputError(f"{path}: is no granule that is known ({titles}): name another file")


def _read_beams(path: str, root: gdal.Group, product: Product) -> Iterator[tuple[str, BeamArrays]]:
    """Yield the beams of a product that have heights, with their arrays."""
    for beam in root.GetGroupNames() or []:
        if not beam.startswith(product.beam):
            continue
        place = f"/{beam}/{product.points}".rstrip("/")
        arrays = {name: values for name, below in product.arrays.items()
                  if (values := _read_array(path, root, f"{place}/{below}")) is not None}  # fmt: skip
        if {"lon", "lat", "height"} <= arrays.keys():
            count = len(arrays["height"])
            damaged = [name for name, values in arrays.items() if len(values) != count]
            if damaged:
                raise InputError(f"{path}, {place}: {', '.join(sorted(damaged))} have another length than the heights: "
                                 "get it again")  # fmt: skip
            yield beam, arrays


def _read_array(path: str, root: gdal.Group, name: str) -> np.ndarray | None:
    """Return an array as numbers, NaN where it is filled; None where the granule has none of that name."""
    try:
        array = root.OpenMDArrayFromFullname(name)
    except RuntimeError:
        return None
    if array is None:
        return None
    size = int(np.prod([dimension.GetSize() for dimension in array.GetDimensions()], dtype=np.float64))
    if size > FILE_BUDGETS.laser_values:
        raise InputError(f"{path}, {name}: claims {size} values, more than any granule has: get it again")
    values = None
    with gdal_messages() as messages:
        values = array.ReadAsArray()
    if values is None:
        raise InputError(f"{path}, {name}: cannot be read ({' '.join(messages)}): get it again")
    numbers = np.asarray(values, dtype=np.float64)
    return np.where((np.abs(numbers) > GRANULE_FILL.largest) | (numbers < GRANULE_FILL.lowest), np.nan, numbers)


def _stack_beams(path: str, product: Product, beams: list[tuple[str, BeamArrays]]) -> LaserPoints:
    """Return the beams' points as one table."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in ("ground", "sigma", "slope", "misfit", "photons",
                                                                "canopy", "doubt", "track", "ids")}  # fmt: skip
    name = os.path.basename(path)
    for beam, arrays in beams:
        ground = np.column_stack([arrays["lon"], arrays["lat"], arrays["height"]])
        known = np.flatnonzero(np.isfinite(ground).all(axis=1))
        empty = np.full(len(ground), np.nan)
        doubt = np.full(len(ground), "", dtype="U64")
        for why, told in product.doubts.items():
            wrong = told(arrays)
            if wrong is not None:
                doubt[wrong & (doubt == "")] = why
        canopy = arrays["heights"][:, -3] if arrays.get("heights", empty).ndim == 2 else arrays.get("canopy", empty)
        columns = {
            "ground": ground, "sigma": arrays.get("sigma", np.full(len(ground), product.stated_sigma_m)),
            "slope": arrays.get("slope", empty), "misfit": arrays.get("misfit", empty),
            "photons": arrays.get("photons", empty), "canopy": canopy, "doubt": doubt,
            "track": np.full(len(ground), name),
            "ids": np.char.add(f"{beam}-", np.arange(len(ground)).astype(str)),
        }  # fmt: skip
        for column, values in columns.items():
            parts[column].append(values[known])
    joined = {column: np.concatenate(values) for column, values in parts.items()}
    return LaserPoints.create(
        joined["ground"], ids=joined["ids"], track=joined["track"],
        sigma_m=joined["sigma"],
        slope=joined["slope"], misfit_m=joined["misfit"], photons=joined["photons"], canopy_m=joined["canopy"],
        doubt=joined["doubt"], source=path,
    )  # fmt: skip
