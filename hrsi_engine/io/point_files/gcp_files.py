"""GCPs in the formats of other programs.

* ``.gcp`` of the Ames Stereo Pipeline, one point a line: id, lat, lon, height above the ellipsoid, three sigmas (m),
  then for each image its name, column and row from the centre of the first pixel, and their sigmas (px). Fields are
  separated by blanks or commas. The sigmas are those of the geocentric x, y and z, as bundle_adjust reads them by
  default; if they differ, east, north and height are correlated.
* GCPs stored in an image file. In GDAL their pixel and line refer to the upper left *corner* of the image. Ids that are
empty or numbers get the id of the image as a prefix. GDAL cannot express a missing height: if all heights are exactly
0 they are regarded as missing.
* Orthority's GCP GeoJSON: points with ``ji`` = [column, row] from the centre of the first pixel, and ``filename``.
  Positions are longitude, latitude and ellipsoidal height, as in GeoJSON (RFC 7946).
* ``.points`` of the QGIS Georeferencer: map coordinates and pixels, no heights and no names. Pixels refer to the upper
left *corner* of the image, with y negative downwards. Points that were switched off there are not used. The id of a
point is ``IMAGE-ROW``; the image is that of the file's name (``a.tif.points``).
* ``.pts`` of ENVI, one point a line: map x, y, elevation (of points for an RPC orthorectification), image x and y,
where the first pixel is (1, 1). The image is that of the file's name (``a.pts``). CRS: degrees or UTM on WGS84 in
``projection info``, else the WKT in ``coordinate system string``; others need `ground_crs`.

Text files of GCPs and tie points of other programs.

* Reference of Agisoft Metashape: ``# CoordinateSystem: WKT``, then the column names after another ``#``, the first of
them Label. Errors and estimated positions are not used; rows may omit empty fields at their end.
* OrthoEngine of PCI (CATALYST): one point in each line, fields separated by blanks, tabs or commas, in an order that
the user gives as in OrthoEngine's dialog, ``FILE|columns=ID,P,L,X,Y,Z`` or ``TP_ID,Image,P,L,E``. P and L (pixel and
line) refer to the corner of the first pixel: 0.5 is subtracted. eP is used as the standard deviation of both; eX, eY
and eZ have no certain unit. S is G (GCP), C (check point) or I (inactive). (CATALYST Professional help.)
"""

import csv
import math
import os
import re
from dataclasses import replace
from typing import Any

import numpy as np

from ...foundation.errors import InputError
from ...ground.geodesy import east_north_up
from ..opening.datasets import open_dataset
from ..opening.files import has_decimal_commas, parse_finite, read_json, read_text
from ..rasters.images import image_id
from .csv_text import NAMED_COLUMNS, read_plain_text
from .table import PointReader, PointTable, parse_numbers

# ---- Ames Stereo Pipeline ------------------------------------------------------------------------------------------

_POINT_FIELDS, _IMAGE_FIELDS = 7, 5
_ASP_FIELDS = ("id", "lat", "lon", "height", "sigma_xy", "sigma_h", "image", "sample", "line", "sigma")
_Row = tuple[int, str, str, list[float]]


def read_asp_gcps(path: str, _layer: str = "") -> PointTable:
    """Return one row for each point and image; raise `InputError` with the line if one is damaged."""
    rows: list[_Row] = []
    for number, text in enumerate(read_text(path, "points").splitlines(), start=1):
        data = text.partition("#")[0]
        if has_decimal_commas(data.partition(" ")[2]):
            raise InputError(f"{path}, line {number}: has decimals behind commas: write them with a point")
        fields = data.replace(",", " ").split()
        rows += _parse_line(path, number, fields) if fields else []
    values = np.array([row[3] for row in rows], dtype=np.float64).reshape(-1, 10)
    lat, lon, height, sx, sy, sz, sample, line, s_sample, s_line = values.T
    columns = {
        "id": np.array([row[1] for row in rows], dtype=str),
        "image": np.array([row[2] for row in rows], dtype=str),
        "sample": sample,
        "line": line,
        "sigma": np.hypot(s_sample, s_line) / math.sqrt(2.0),
    }
    notes: tuple[str, ...] = ()
    if ((sx == sy) & (sx == sz)).all():
        columns |= {"sigma_xy": sx, "sigma_h": sz}
    else:  # the covariance of east, north and height
        axes = east_north_up(lon, lat)
        covariance = (axes * np.column_stack([sx, sy, sz])[:, None, :] ** 2) @ axes.swapaxes(1, 2)
        columns |= {f"cov_{'enh'[i]}{'enh'[j]}": covariance[:, i, j] for i in range(3) for j in range(i, 3)}
        notes = (
            f"{path}: the three sigmas of a point differ: they are taken along the geocentric x, y and z axes, as "
            "bundle_adjust does by default",
        )
    geometry = np.column_stack([lon, lat, height])
    return PointTable(
        path, columns, _ASP_FIELDS, lambda row: f"line {rows[row][0]}", geometry, crs="EPSG:4979", notes=notes
    )


def _parse_line(path: str, number: int, fields: list[str]) -> list[_Row]:
    """Return the rows of one line; a point without images gives one row without a measurement."""
    point, images = fields[:_POINT_FIELDS], fields[_POINT_FIELDS:]
    if len(point) < _POINT_FIELDS or len(images) % _IMAGE_FIELDS:
        raise InputError(
            f"{path}, line {number}: needs {_POINT_FIELDS} fields and {_IMAGE_FIELDS} more for each image: complete it"
        )
    position = _parse_floats(path, number, point[1:])
    if not images:
        return [(number, point[0], "", position + [math.nan] * 4)]
    groups = [images[start : start + _IMAGE_FIELDS] for start in range(0, len(images), _IMAGE_FIELDS)]
    return [(number, point[0], group[0], position + _parse_floats(path, number, group[1:])) for group in groups]


def _parse_floats(path: str, number: int, texts: list[str]) -> list[float]:
    values = []
    for text in texts:
        value = parse_finite(text)
        if value is None:
            raise InputError(f"{path}, line {number}: {text[:40]!r} is not a number: correct it")
        values.append(value)
    return values


ASP_GCPS = PointReader("Ames Stereo Pipeline GCPs", lambda _path, name, _head: name.endswith(".gcp"), read_asp_gcps)

# ---- GDAL ----------------------------------------------------------------------------------------------------------


def read_image_gcps(path: str, _layer: str = "") -> PointTable:
    """Return the GCPs of an image; raise `InputError` if it has none."""
    dataset, message = open_dataset(path)
    if dataset is None:
        raise InputError(f"{path}: cannot be opened as an image ({message}): check the file")
    gcps = dataset.GetGCPs()
    if not gcps:
        raise InputError(f"{path}: is an image without GCPs: name a point layer or CSV instead")
    image = image_id(path)
    ids = [str(gcp.Id).strip() or str(number) for number, gcp in enumerate(gcps, start=1)]
    columns = {
        "id": np.array([f"{image}-{name}" if name.isdigit() else name for name in ids], dtype=str),
        "image": np.full(len(gcps), image),
        "sample": np.array([gcp.GCPPixel for gcp in gcps]) - 0.5,
        "line": np.array([gcp.GCPLine for gcp in gcps]) - 0.5,
    }
    geometry = np.array([[gcp.GCPX, gcp.GCPY, gcp.GCPZ] for gcp in gcps])
    if not geometry[:, 2].any():
        geometry[:, 2] = np.nan
    reference = dataset.GetGCPSpatialRef()
    crs = reference.ExportToWkt(["FORMAT=WKT2_2019"]) if reference is not None else ""
    return PointTable(path, columns, tuple(columns), lambda row: f"GCP {row + 1}", geometry, crs)


IMAGE_GCPS = PointReader(
    "GCPs in an image", lambda path, _name, _head: open_dataset(path)[0] is not None, read_image_gcps
)

# ---- Orthority -----------------------------------------------------------------------------------------------------


def read_orthority_gcps(path: str, _layer: str = "") -> PointTable:
    """Return the GCPs of a file; raise `InputError` with the feature if one is damaged."""
    try:
        features = read_json(path, "points")["features"]
    except (TypeError, KeyError) as error:
        raise InputError(f"{path}: is no GeoJSON feature collection ({error}): check the file") from None
    if not isinstance(features, list):
        raise InputError(f"{path}: 'features' is no list: check the file")
    rows = [_read_feature(path, number, feature) for number, feature in enumerate(features)]
    values = np.array([row[2] for row in rows], dtype=np.float64).reshape(-1, 5)
    columns = {
        "id": np.array([row[0] for row in rows], dtype=str),
        "image": np.array([row[1] for row in rows], dtype=str),
        "sample": values[:, 0],
        "line": values[:, 1],
    }
    return PointTable(path, columns, ("id", "filename", "ji"), "feature {}".format, values[:, 2:], "EPSG:4979")


def _read_feature(path: str, number: int, feature: Any) -> tuple[str, str, list[float]]:
    """Return id, file name and column, row, lon, lat, height of one feature."""
    try:
        properties, coordinates = feature["properties"], feature["geometry"]["coordinates"]
        values = [float(value) for value in (*properties["ji"], *coordinates)]
        name, filename = properties["id"], properties["filename"]
        if len(properties["ji"]) != 2 or len(coordinates) not in (2, 3) or not all(map(math.isfinite, values)):
            raise ValueError("numbers are missing or too many")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}, feature {number}: needs id, filename, ji and point ({error}): correct it") from None
    return str(name).strip(), str(filename).strip(), values + [math.nan] * (5 - len(values))


ORTHORITY_GCPS = PointReader(
    "Orthority GCPs",
    lambda _path, name, head: name.endswith((".geojson", ".json")) and b'"ji"' in head,
    read_orthority_gcps,
)

# ---- QGIS ----------------------------------------------------------------------------------------------------------


_QGIS_HEADER = re.compile(rb"^\W*mapX,mapY,(?:source|pixel)X,", re.MULTILINE)


def read_qgis_points(path: str, _layer: str = "") -> PointTable:
    """Return the points that are switched on; raise `InputError` if the file is damaged."""
    lines = read_text(path, "points").splitlines()
    try:
        rows = [row for row in csv.reader(line for line in lines if not line.startswith("#")) if row]
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read ({error}): save the points again in the Georeferencer") from None
    crs = next((line.partition(":")[2].strip() for line in lines if line.lower().startswith("#crs:")), "")
    names = [name.strip() for name in rows[0]] if rows else []
    position = {name.lower(): index for index, name in reversed([*enumerate(names)])}

    def get_text(row: list[str], name: str) -> str:
        index = position.get(name, len(row))
        return row[index] if index < len(row) else ""

    def get_column(*aliases: str) -> np.ndarray:
        alias = next((alias for alias in aliases if alias in position), None)
        if alias is None:
            raise InputError(f"{path}: has no field {aliases[0]!r}: save the points again in the Georeferencer")
        texts = [get_text(row, alias) for _, row in body]
        return parse_numbers(texts, lambda at: f"{path}, point {body[at][0]}, field {aliases[0]!r}")

    body = [(number, row) for number, row in enumerate(rows[1:], 1) if get_text(row, "enable").strip() != "0"]
    disabled = len(rows) - 1 - len(body)
    image = image_id(os.path.splitext(path)[0])
    geometry = np.column_stack([get_column("mapx"), get_column("mapy"), np.full(len(body), np.nan)])
    columns = {
        "id": np.array([f"{image}-{number}" for number, _ in body], dtype=str),
        "image": np.full(len(body), image),
        "sample": get_column("sourcex", "pixelx") - 0.5,  # since QGIS 3.26, and before
        "line": -get_column("sourcey", "pixely") - 0.5,
    }
    notes = (f"{path}: {disabled} points are switched off and left out",) if disabled > 0 else ()
    return PointTable(path, columns, tuple(names), lambda row: f"point {body[row][0]}", geometry, crs=crs, notes=notes)


QGIS_POINTS = PointReader(
    "QGIS Georeferencer points",
    lambda _path, name, head: name.endswith(".points") or bool(_QGIS_HEADER.search(head)),
    read_qgis_points,
)

# ---- ENVI ----------------------------------------------------------------------------------------------------------

_ENVI_HEADER = re.compile(rb"^;\s*ENVI .*GCP", re.IGNORECASE)


def read_envi_points(path: str, _layer: str = "") -> PointTable:
    """Return the points of a ``.pts`` file; raise `InputError` with the line if one is damaged."""
    lines = read_text(path, "points").splitlines()
    header = " ".join(line for line in lines if line.startswith(";"))
    rows = [(number, line.split()) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith(";")]
    width = 5 if "elevation" in header.lower() else 4
    for number, row in rows:
        if len(row) != width:
            raise InputError(f"{path}, line {number}: has {len(row)} numbers, {width} are needed: correct the line")
    texts = [list(column) for column in zip(*(row for _, row in rows), strict=True)] or [[] for _ in range(width)]
    values = [parse_numbers(column, lambda at: f"{path}, line {rows[at][0]}") for column in texts]
    image = image_id(os.path.splitext(path)[0] if path.lower().endswith(".tif.pts") else path)
    height = values[2] if width == 5 else np.full(len(rows), np.nan)
    columns = {
        "id": np.array([f"{image}-{number}" for number in range(1, len(rows) + 1)], dtype=str),
        "image": np.full(len(rows), image),
        "sample": values[-2] - 1.0,
        "line": values[-1] - 1.0,
    }
    geometry = np.column_stack([values[0], values[1], height])
    return PointTable(
        path,
        columns,
        ("x", "y", "elevation", "image x", "image y"),
        lambda row: f"line {rows[row][0]}",
        geometry,
        _find_envi_crs(header),
    )


def _find_envi_crs(header: str) -> str:
    """Return the CRS that the header of an ENVI file states, "" if it is neither WGS84 nor WKT."""
    if re.search(r"\{\s*Geographic Lat/Lon.*WGS-84", header, re.IGNORECASE):
        return "EPSG:4326"
    if zone := re.search(r"\{\s*UTM,\s*(\d+),\s*(North|South),\s*WGS-84", header, re.IGNORECASE):
        return f"EPSG:{(32600 if zone[2].lower() == 'north' else 32700) + int(zone[1])}"
    wkt = re.search(r"coordinate system string\s*=\s*\{(.+?)\}", header)
    return wkt[1] if wkt else ""


ENVI_GCPS = PointReader("ENVI GCPs", lambda _path, _name, head: bool(_ENVI_HEADER.search(head)), read_envi_points)

_HEADER = re.compile(rb"^#\s*label\s*([,;\t ])", re.IGNORECASE | re.MULTILINE)
_METASHAPE = {
    "label": "id", "x/easting": "x", "y/northing": "y", "x/longitude": "lon", "y/latitude": "lat",
    "z/altitude": "height", "z": "height", "accuracy_x/y_(m)": "sigma_xy", "accuracy_x_(m)": "sigma_east",
    "accuracy_y_(m)": "sigma_north", "accuracy_z_(m)": "sigma_h",
}  # fmt: skip
_ORTHOENGINE = {"tp_id": "id", "p": "sample", "l": "line", "z": "height", "e": "height", "s": "role", "ep": "sigma"}
_ROLES = {"G": "gcp", "C": "check", "I": "off"}


def read_metashape(path: str, _layer: str = "") -> PointTable:
    """Return the surveyed positions of a reference file; raise `InputError` with the line if it is damaged."""
    lines = read_text(path, "points").splitlines()
    start, header = next(
        (current, result) for current, line in enumerate(lines, 1) if (result := _HEADER.match(line.encode()))
    )
    mark = header[1].decode()
    names = lines[start - 1].lstrip("# ").rstrip(f"{mark} ").split(mark.strip(" ") or None)
    texts = next(
        (line.partition(":")[2].strip() for line in lines if line.lower().startswith("# coordinatesystem:")), ""
    )
    rows = [line.rstrip(f"{mark} ") for line in lines[start:]]
    body = [row and row + f"{mark}nan" * (len(names) - len(row.split(mark.strip(" ") or None))) for row in rows]
    field_names = [_METASHAPE.get(name.strip().lower(), name) for name in names]
    table = read_plain_text(path, [""] * start + body, field_names)  # so that lines keep their numbers
    if not texts or texts.startswith("LOCAL_CS"):
        return table
    columns, empty = dict(table.columns), np.full(len(table), np.nan)
    position = [columns.pop(a, columns.pop(b, empty)) for a, b in (("x", "lon"), ("y", "lat"), ("height", ""))]
    return replace(table, columns=columns, geometry=np.column_stack(position), crs=texts)


METASHAPE_REFERENCE = PointReader(
    "Metashape reference",
    lambda _path, name, head: name.endswith((".csv", ".txt")) and bool(_HEADER.search(head)),
    read_metashape,
)


def read_orthoengine(path: str, columns_option: str) -> PointTable:
    """Return the points of a text whose columns ``columns_option`` names; raise `InputError` if it is damaged."""
    names = columns_option.removeprefix(NAMED_COLUMNS).split(",")
    fields = [re.findall(r'"[^"]*"|[^\s,]+', line) for line in read_text(path, "points").splitlines()]
    field_names = [_ORTHOENGINE.get(name.strip().lower(), name) for name in names]
    table = read_plain_text(path, ["\t".join(row) for row in fields], field_names)
    columns = table.columns | {axis: table.columns[axis] - 0.5 for axis in ("sample", "line")}
    if "role" in columns:
        columns["role"] = np.array([_ROLES.get(status.upper(), status) for status in columns["role"].tolist()])
    return replace(table, columns=columns)


#: The file does not state the order of its fields: this reader is chosen if the user names OrthoEngine's columns, P and
#: L for pixel and line among them.
ORTHOENGINE_TEXT = PointReader(
    "PCI OrthoEngine text",
    lambda _path, _name, _head: False,
    read_orthoengine,
    lambda names: {"p", "l"} <= {name.strip().lower() for name in names},
)
