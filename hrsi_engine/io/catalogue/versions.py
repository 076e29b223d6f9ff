"""Versions of what a result depends on, so that a run can be repeated."""

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version

import numpy as np
import pyproj
import shapely
from osgeo import gdal
from shapely.geos import geos_version

from ...foundation.version import VERSION

#: Packages that are asked for their versions without loading them, by the names of their distributions.
_DISTRIBUTIONS = {
    "scipy": ("scipy",),
    "opencv": ("opencv-python-headless", "opencv-python", "opencv-contrib-python-headless", "opencv"),
    "numba": ("numba",),
    "dask": ("dask",),
    "jinja2": ("Jinja2",),
}


@cache
def versions() -> dict[str, str]:
    """Return name and version of HRSI and of the libraries that decide its figures; those that are there."""
    found = {
        "hrsi": VERSION,
        "python": platform.python_version(),
        "gdal": gdal.__version__,
        "proj": pyproj.proj_version_str,
        "geos": ".".join(map(str, geos_version)),
        "numpy": np.__version__,
        "shapely": shapely.__version__,
        "pyproj": pyproj.__version__,
    }
    return found | {name: text for name, names in _DISTRIBUTIONS.items() if (text := _find_version(names))}


def _find_version(names: tuple[str, ...]) -> str:
    for name in names:
        try:
            return version(name)
        except PackageNotFoundError:
            continue
    return ""
