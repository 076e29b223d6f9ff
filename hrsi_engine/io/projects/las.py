"""Point clouds in LAS 1.4, point format 6, with the adjustment's own figures of each point as extra bytes.

Source: LAS Specification 1.4 R15 (ASPRS 2019), tables 3 (header), 8 (variable length records), 14 (format 6) and 24
(extra bytes descriptor). Needs no package: laspy, PDAL, QGIS and CloudCompare read the result.
"""

import struct
from pathlib import Path

import numpy as np
from osgeo import osr

_HEADER = "<4sHHIHH8sBB32s32sHHHIIBHI5I12dQQIQ15Q"
_SCALE_M = 0.001
_WKT, _EXTRA_BYTES, _FLOAT, _UNSIGNED_SHORT = 2112, 4, 9, 3
_HEIGHTS = 'VERT_CS["ellipsoidal height",VERT_DATUM["WGS 84 ellipsoid",2002],UNIT["metre",1],AXIS["Up",UP]]'
_POINT = np.dtype([
    ("xyz", "<i4", 3), ("intensity", "<u2"), ("returns", "u1"), ("flags", "u1"), ("class", "u1"), ("user", "u1"),
    ("angle", "<i2"), ("source", "<u2"), ("time", "<f8"), ("sigma", "<f4", 2), ("rays", "<u2"),
])  # fmt: skip
_EXTRA = (
    ("sigma_plan", "standard deviation, m", _FLOAT), ("sigma_height", "standard deviation, m", _FLOAT),
    ("rays", "images that show the point", _UNSIGNED_SHORT),
)  # fmt: skip


def write_las(path: str, xyz: np.ndarray, sigma_m: np.ndarray, rays: np.ndarray, epsg: int) -> None:
    """Write points ``(n, 3)`` of a projected CRS and ellipsoidal heights, their sigmas ``(n, 2)`` and rays ``(n,)``."""
    crs = osr.SpatialReference()
    crs.ImportFromEPSG(epsg)
    wkt = f'COMPD_CS["EPSG:{epsg}, ellipsoidal heights",{crs.ExportToWkt(["FORMAT=WKT1_GDAL"])},{_HEIGHTS}]\0'.encode()
    described = b"".join(
        struct.pack("<HBB32s4s24s24s24s24s24s32s", 0, kind, 0, name.encode(), *(b"",) * 6, text.encode())
        for name, text, kind in _EXTRA
    )
    records = _record(b"LASF_Projection", _WKT, wkt) + _record(b"LASF_Spec", _EXTRA_BYTES, described)
    low, high, count = xyz.min(axis=0), xyz.max(axis=0), len(xyz)
    origin = np.floor(low)
    rows = np.zeros(count, dtype=_POINT)
    rows["xyz"], rows["returns"], rows["class"] = np.rint((xyz - origin) / _SCALE_M), 0x11, 1
    rows["sigma"], rows["rays"] = sigma_m, rays
    size = struct.calcsize(_HEADER)
    bounds = np.column_stack([high, low]).ravel().tolist()
    header = struct.pack(
        _HEADER, b"LASF", 0, 16, 0, 0, 0, b"", 1, 4, b"bundle adjustment", b"HRSI", 1, 2000, size, size + len(records),
        2, 6, _POINT.itemsize, 0, *(0,) * 5, *(_SCALE_M,) * 3, *origin.tolist(), *bounds, 0, 0, 0, count, count,
        *(0,) * 14,
    )  # fmt: skip
    Path(path).write_bytes(header + records + rows.tobytes())


def _record(user: bytes, number: int, content: bytes) -> bytes:
    """Return a variable length record."""
    return struct.pack("<H16sHH32s", 0, user, number, len(content), b"") + content
