"""Places in the areas of use of 62 CRS, and what cs2cs and PROJ's own lists say of them."""

import csv
import subprocess
import warnings
from collections import defaultdict
from pathlib import Path

import numpy as np
import pyproj
from pyproj.transformer import TransformerGroup

from hrsi.hrsi_engine.ground.crs_operations import operations_of
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.ground.operation_uses import describe_missing_grid


def read_places() -> dict[int, np.ndarray]:
    """Return three places (lon, lat) for each EPSG code."""
    places = defaultdict(list)
    with Path(__file__).with_name("crs_places.csv").open(encoding="ascii") as file:
        for row in csv.DictReader(file):
            places[int(row["epsg"])].append((float(row["lon"]), float(row["lat"])))
    return {code: np.array(lonlat) for code, lonlat in places.items()}


def convert_by_cs2cs(xy: np.ndarray, crs: pyproj.CRS) -> np.ndarray:
    """Return lon, lat ``(n, 2)`` of x (east), y points by the program."""
    north_first = crs.axis_info[0].direction.lower() in ("north", "south") and "Polar" not in crs.name
    lines = "\n".join(" ".join(map(repr, (row[::-1] if north_first else row).tolist())) for row in xy)
    done = subprocess.run(
        ["cs2cs", "-f", "%.12f", f"EPSG:{crs.to_epsg()}", "EPSG:4326"],
        input=lines, capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = [[float(word) if word != "*" else np.inf for word in line.split()[:2]] for line in done.stdout.splitlines()]
    return np.array(found)[:, ::-1]


def horizontal_m(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the horizontal distances of lon, lat points."""
    both = (np.column_stack([lonlat[:, :2], np.zeros(len(lonlat))]) for lonlat in (first, second))
    return np.linalg.norm(ground_difference_m(*both)[:, :2], axis=1)


def list_losses() -> list[tuple[int, bool]]:
    """Return the CRS of each place where a better operation (by 0.1 m) lacks its grid, and whether it is reported."""
    found = []
    for code, places in read_places().items():
        operations = operations_of(f"EPSG:{code}")
        for place in places:
            best = find_accuracy_without_grids(operations.crs, place)
            (use,) = operations.uses_at("points", place[None])
            used = use.operation.accuracy_m
            if best is not None and not (used is not None and used - best <= 0.1):
                found.append((code, bool(describe_missing_grid(use))))
    return found


def find_accuracy_without_grids(crs: pyproj.CRS, place: np.ndarray) -> float | None:
    """Return the accuracy of the best operation at a place that lacks a grid, by PROJ alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        group = TransformerGroup(crs, 4326, always_xy=True)
    known = []
    for one in group.unavailable_operations:
        if "allpark" in one.name or one.accuracy is None or one.accuracy < 0.0 or one.area_of_use is None:
            continue
        west, south, east, north = one.area_of_use.bounds
        if (place[0] - west) % 360.0 <= (east - west) % 360.0 and south <= place[1] <= north:
            known.append(float(one.accuracy))
    return min(known, default=None)
