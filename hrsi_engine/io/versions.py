"""Versions of what a result depends on, so that a run can be repeated."""

from __future__ import annotations

import platform

import numpy as np
import pyproj
import scipy
from osgeo import gdal

from ..foundation.version import VERSION


def versions() -> dict[str, str]:
    """Return name and version of HRSI and of the libraries that decide its figures."""
    return {
        "hrsi": VERSION,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "gdal": gdal.__version__,
        "proj": pyproj.proj_version_str,
    }
