"""Why a file of points of a folder cannot be used: exchanged degrees, another place, damaged rows, other images."""

import csv
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.foundation.errors import HrsiError, list_ids
from ...hrsi_engine.foundation.thresholds import EQUALITY, SAMPLES
from ...hrsi_engine.io.point_files import csv_text, read_points
from ...hrsi_engine.io.point_files.find import read_table
from ...hrsi_engine.io.point_files.table import match_fields
from .column_roles import TextTable, is_text, place_images, read_text_table, share_near

POINT_FIELDS = ({"lon", "lat"}, {"x", "y", "height"}, {"image", "sample", "line"})


def read_ids(path: str) -> set[str]:
    """Return the first column of a text, or the id column of a vector file; empty for other files."""
    with suppress(HrsiError, OSError, UnicodeError):
        if not is_text(path):
            return {str(name) for name in read_table(path).columns.get("id", ())}
        lines = csv_text.read_lines(path, SAMPLES.large)
        return {re.split(r"[,;\t ]", line.strip(), maxsplit=1)[0].strip('"') for line in lines}
    return set()


def holds_most(found: set[str], ids: set[str]) -> bool:
    """Return whether ids that were found in a file are most of some ids, and these are not too few."""
    return len(ids) >= SAMPLES.plane and len(found & ids) >= EQUALITY.majority * len(ids)


def find_fault(
    path: str, region: np.ndarray, crs_names: Sequence[str], images: Mapping[str, Image], is_needed: bool
) -> str:
    """Return why a file of points cannot be used; empty for other files, and for points of other places.

    ``is_needed`` is whether it has ids that other files survey or measure: then it is one, whatever its columns.
    """
    if _has_exchanged_degrees(path, region):
        return "longitude and latitude are exchanged: exchange them in the file"
    table = read_text_table(path) if is_text(path) else None
    fields = match_fields(table.names) if table is not None else dict[str, int]()
    has_degrees = {"lon", "lat"} <= fields.keys()
    if is_needed and (fault := _find_fault_of_rows(path, table, fields, images)):
        return fault
    if not is_needed and ("id" not in fields or not any(names <= fields.keys() for names in POINT_FIELDS)):
        return ""
    if table is not None and has_degrees and not is_needed:
        lonlat = table.numbers[:, [fields["lon"], fields["lat"]]]
        if share_near(lonlat[np.isfinite(lonlat).all(axis=1)], region) < EQUALITY.majority:
            return ""
    if has_degrees:
        crs_names = ("",)
    elif table is None:
        crs_names = ("", *crs_names)
    faults = []
    for crs in crs_names or ("",):
        try:
            ground = read_points(path, ground_crs=crs or None).ground
        except HrsiError as error:
            faults.append(str(error))
        else:
            if not is_needed or ground is None:
                return ""
            lon, lat = np.median(ground.ground[:, :2], axis=0)
            faults.append(
                f"its points, near lon {lon:.4g}, lat {lat:.4g}, are not on the ground of the images: correct their "
                "CRS or coordinates"
            )
    return faults[0]


def _find_fault_of_rows(
    path: str, table: TextTable | None, fields: Mapping[str, int], images: Mapping[str, Image]
) -> str:
    """Return what is wrong with the rows of a text of points or measurements; empty if they are equal and name images.

    ``table`` is the text's, None if its rows are not of equal length; ``fields`` are its columns by their names.
    """
    if table is None and is_text(path):
        lines = csv_text.read_lines(path, SAMPLES.large)
        separator, rows = csv_text.split_rows(lines)
        rows = list(csv.reader(lines, delimiter=separator)) if separator else rows
        odd = next((number for number, row in enumerate(rows) if len(row) != len(rows[0])), 0)
        return f"row {odd + 1} has {len(rows[odd])} columns, and the first {len(rows[0])}: complete it" if odd else ""
    if table is None or "image" not in fields:
        return ""
    names = sorted(set(table.columns[fields["image"]]))
    if (place_images(names, list(images)) >= 0).any():
        return ""
    return f"names the images {list_ids(names)}; those here are {list_ids(list(images))}: rename them"


def _has_exchanged_degrees(path: str, region: np.ndarray) -> bool:
    """Return whether the points of a file lie near the images with longitude and latitude exchanged."""
    try:
        table = read_table(path)
    except HrsiError:
        return False
    degrees = [table.columns[name] for name in ("lon", "lat") if name in table.columns]
    if table.geometry is None and len(degrees) < 2:
        return False
    lonlat = np.column_stack(degrees) if table.geometry is None else table.geometry[:, :2]
    lonlat = lonlat[np.isfinite(lonlat).all(axis=1)]
    return len(lonlat) > 0 and share_near(lonlat[:, ::-1], region) >= EQUALITY.majority
