"""Lineage of a result: input files, run, date and versions, as a report lists them so that a run can be repeated.

An input is identified by the SHA-256 of its content. Of a file larger than `CONTENT_SAMPLING.whole_bytes`, and of all
files after the first `RASTER_BUDGETS.block_bytes`, only beginning, end and blocks between them are hashed (see
`content_marks`): this detects another image under the same name, but not every changed pixel.
"""

import hashlib
import os
import platform
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import pyproj
import shapely
from osgeo import gdal, osr
from shapely.geos import geos_version

from ...foundation.version import VERSION, run_date
from ..opening.budgets import FILE_BUDGETS, RASTER_BUDGETS
from ..opening.datasets import metadata_of, open_dataset, quiet, virtual_status
from ..safety.content_marks import CONTENT_SAMPLING, places_of, read_places

#: Endings of text files that no GDAL driver reads: without this list GDAL would try all its drivers, 1 ms a file.
_TEXTS = ("_rpc.txt", ".csv")
HIDDEN = "***"  #: replaces a password


def run_record(command: str, names: Mapping[str, Iterable[str]] | None) -> dict[str, Any]:
    """Return the report's entries on the run.

    ``version``, ``date``, ``command``, ``directory`` (of relative paths), ``inputs``, ``versions``, ``platform``.
    ``names`` has the files and folders that each option names for reading; with None, ``inputs`` is None.
    """
    return {
        "version": VERSION,
        "date": run_date(),
        "command": command,
        "directory": os.getcwd(),
        "inputs": None if names is None else input_entries(names),
        "versions": versions(),
        "platform": platform.platform(),
    }


def read_refinement(path: str) -> dict[str, str] | None:
    """Return the metadata of an image whose RPC a run refined (`Lineage.items`); None if no run did.

    ``HRSI_MODEL``, ``HRSI_VERSION``, ``HRSI_DATE``, and ``HRSI_REPORT``, the path of the run's report.
    """
    if path.lower().endswith(_TEXTS):
        return None
    dataset, _ = open_dataset(path)
    metadata = {} if dataset is None else metadata_of(dataset)
    return metadata if "HRSI_MODEL" in metadata else None


def without_secrets_in(value: Any) -> Any:
    """Return a text, or dicts and lists of texts, with the passwords of connections to databases and servers hidden."""
    if isinstance(value, Mapping):
        return {key: without_secrets_in(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_secrets_in(item) for item in value]
    if not isinstance(value, str):
        return value
    secrets = r"((?:password|passwd|pwd)=)[^\s'&]+|(://[^/\s:@]*:)[^/\s@]+(?=@)"
    return re.sub(secrets, lambda found: f"{found[1] or found[2]}{HIDDEN}", value, flags=re.IGNORECASE)


def input_entries(names: Mapping[str, Iterable[str]]) -> list[dict[str, Any]]:
    """Return the report's entry for each input file, including the files that GDAL lists with it.

    ``option``, ``path``, ``size``, ``modified``, ``sha256`` or ``sampled_sha256`` (the other is None), ``crs``.
    ``names`` has paths by the key of the option that names them; names that are no files (``auto``) are omitted.
    """
    entries: list[dict[str, Any]] = []
    real_paths: set[str] = set()
    read = 0
    for option, paths in names.items():
        for path, crs in _list_files(paths):
            if (real := os.path.realpath(path)) in real_paths:
                continue
            real_paths.add(real)
            entry = {"option": option, **file_entry(path, complete=read < RASTER_BUDGETS.block_bytes), "crs": crs}
            read += entry["size"] or 0
            entries.append(entry)
    return entries


def file_entry(path: str, complete: bool = True) -> dict[str, Any]:
    """Return path, size, modification time and SHA-256 of a file (of samples, if it is large or not ``complete``)."""
    if path.startswith("/vsi"):
        status = virtual_status(path)
        size, time = (None, None) if status is None else (status.size, status.mtime)
        return {"path": path, "size": size, "modified": _iso_time(time), "sha256": None, "sampled_sha256": None}
    status = os.stat(path)
    complete = complete and status.st_size <= CONTENT_SAMPLING.whole_bytes
    with open(path, "rb", buffering=0) as file:
        state = hashlib.sha256()
        for block in read_places(file, [(0, status.st_size)] if complete else places_of(status.st_size)):
            state.update(block)
    digest = state.hexdigest()
    return {
        "path": path,
        "size": status.st_size,
        "modified": _iso_time(status.st_mtime),
        "sha256": digest if complete else None,
        "sampled_sha256": None if complete else digest,
    }


def _iso_time(time: float | None) -> str | None:
    return None if not time else datetime.fromtimestamp(time, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _list_files(paths: Iterable[str]) -> Iterator[tuple[str, str | None]]:
    """Yield the files behind paths with the CRS that they state: the files in a folder, the side files of a dataset.

    Files that cannot be read are omitted: the reader of the option reports them.
    """
    for path in paths:
        if os.path.isdir(path):
            names = sorted(os.path.join(path, name) for name in os.listdir(path))[: FILE_BUDGETS.delivery_files]
            yield from ((name, None) for name in names if _is_readable(name))
        elif path.startswith("/vsi"):
            if virtual_status(path) is not None:
                yield path, None
        elif _is_readable(path):
            crs, side_files = _crs_and_files(path)
            yield path, crs
            yield from ((name, None) for name in side_files if _is_readable(name) and name != path)


def _is_readable(path: str) -> bool:
    return os.path.isfile(path) and os.access(path, os.R_OK)


def _crs_and_files(path: str) -> tuple[str | None, list[str]]:
    """Return the CRS of a dataset and the files that belong to it."""
    if path.lower().endswith(_TEXTS):
        return None, []
    dataset, _ = open_dataset(path)
    if dataset is not None:
        with quiet():
            return _crs_name(dataset.GetSpatialRef()), sorted(dataset.GetFileList() or [])
    with quiet():
        try:
            layered = ["GPKG", "ESRI Shapefile", "FlatGeobuf"]  # whose CRS is known without reading rows
            dataset = gdal.OpenEx(path, gdal.OF_VECTOR, allowed_drivers=layered)
        except (RuntimeError, SystemError, UnicodeDecodeError):
            dataset = None
        if dataset is None or not dataset.GetLayerCount():
            return None, []
        return _crs_name(dataset.GetLayer(0).GetSpatialRef()), sorted(dataset.GetFileList() or [])


def _crs_name(crs: osr.SpatialReference | None) -> str | None:
    """Return a CRS as ``EPSG:code``, or its name if it has no code."""
    if crs is None:
        return None
    authority, code = crs.GetAuthorityName(None), crs.GetAuthorityCode(None)
    return f"{authority}:{code}" if authority and code else str(crs.GetName() or "") or None


#: Packages whose versions are found without importing them, by the names of their distributions.
_DISTRIBUTIONS = {
    "scipy": ("scipy",),
    "numba": ("numba",),
    "dask": ("dask",),
    "jinja2": ("Jinja2",),
    "opencv": ("opencv-python-headless", "opencv-python", "opencv-contrib-python-headless", "opencv"),
}


@cache
def versions() -> dict[str, str]:
    """Return name and version of HRSI and of the installed libraries that influence its results."""
    result = {
        "hrsi": VERSION,
        "python": platform.python_version(),
        "gdal": gdal.__version__,
        "proj": pyproj.proj_version_str,
        "geos": ".".join(map(str, geos_version)),
        "numpy": np.__version__,
        "shapely": shapely.__version__,
        "pyproj": pyproj.__version__,
    }
    for name, distributions in _DISTRIBUTIONS.items():
        for distribution in distributions:
            with suppress(PackageNotFoundError):
                result.setdefault(name, version(distribution))
    return result
