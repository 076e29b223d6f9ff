"""Adjusted points for point cloud software, and GCPs for GDAL, QGIS and the Ames Stereo Pipeline.

``tie_points.ply`` and ``tie_points.las`` have positions as east, north (of the result CRS) and ellipsoidal height with
standard deviations and number of rays; ``gcps.gcp`` has one point in each line: id, lat, lon, height, three sigmas,
then image, sample, line and two sigmas for each measurement (ASP, ``bundle_adjust``). ``ID.points`` is for the QGIS
georeferencer, with pixels from the corner and y upwards, and ``ID_gcps.txt`` has ``-gcp`` arguments, from the corner,
for ``gdal_translate --optfile``.

The LAS is of version 1.4, point format 6; sigmas and rays of each point are extra bytes. Source: LAS
Specification 1.4 R15 (ASPRS 2019), tables 3 (header), 8 (variable length records), 14 (format 6) and 24 (extra bytes
descriptor). No package is needed to write it; laspy, PDAL, QGIS and CloudCompare read it.
"""

import struct
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from osgeo import osr

from ...block.block import Role
from ...ground.map_crs import project_to_map
from .project import BlockProject, FileContent, PlannedProject

_PLY_HEAD = (
    "ply\nformat binary_little_endian 1.0\ncomment east north height: EPSG:{epsg}, ellipsoidal\n"
    "element vertex {count}\n"
    "property double x\nproperty double y\nproperty double z\nproperty float sigma_plan\nproperty float sigma_height\n"
    "property int rays\nend_header\n"
)
_ROW = np.dtype([("xyz", "<f8", 3), ("sigma", "<f4", 2), ("rays", "<i4")])

_HEADER = "<4sHHIHH8sBB32s32sHHHIIBHI5I12dQQIQ15Q"
_SCALE_M = 0.001
_WKT, _EXTRA_BYTES, _FLOAT, _UNSIGNED_SHORT = 2112, 4, 9, 3
_HEIGHTS = 'VERT_CS["ellipsoidal height",VERT_DATUM["WGS 84 ellipsoid",2002],UNIT["metre",1],AXIS["Up",UP]]'
_POINT = np.dtype([
    ("xyz", "<i4", 3), ("intensity", "<u2"), ("returns", "u1"), ("flags", "u1"), ("class", "u1"), ("user", "u1"),
    ("angle", "<i2"), ("source", "<u2"), ("time", "<f8"), ("sigma", "<f4", 2), ("rays", "<u2"),
])  # fmt: skip
_EXTRA = (
    ("sigma_plan", "standard deviation, m", _FLOAT),
    ("sigma_height", "standard deviation, m", _FLOAT),
    ("rays", "images that show the point", _UNSIGNED_SHORT),
)


def plan_points_project(project: BlockProject) -> PlannedProject:
    """Return the plan of the block's points as point clouds, and of its GCPs and check points."""
    files: dict[str, FileContent] = {
        f"tie_points.{suffix}": partial(_write_cloud, project, write)
        for suffix, write in (("ply", _write_ply), ("las", _write_las))
    }
    # Texts of GCPs and check points, by file name
    surveyed, measured = project.surveyed, project.measured
    place = {image.id: Path(image.path).name for image in project.images}
    rows_of: dict[str, list[int]] = {}
    for row, name in enumerate(measured.ids.tolist()):
        rows_of.setdefault(name, []).append(row)
    texts: dict[str, list[str]] = {}
    for row in np.flatnonzero((surveyed.role == Role.GCP) | (surveyed.role == Role.CHECK)).tolist():
        name, (lon, lat, height), (plan, up) = str(surveyed.ids[row]), surveyed.ground[row], surveyed.sigma_m[row]
        words = [name, f"{lat:.10f} {lon:.10f} {height:.4f} {plan:.4f} {plan:.4f} {up:.4f}"]
        for index in rows_of.get(name, []):
            image, (x, y), sigma = str(measured.image_ids[index]), measured.xy[index], measured.sigma_px[index]
            words += [place[image], f"{x:.4f}", f"{y:.4f}", f"{sigma:.3f}", f"{sigma:.3f}"]
            qgis, gdal_words = texts.setdefault(f"{image}.points", []), texts.setdefault(f"{image}_gcps.txt", [])
            qgis.append(f"{lon:.10f},{lat:.10f},{x + 0.5:.4f},{-y - 0.5:.4f},1")
            gdal_words.append(f"-gcp {x + 0.5:.4f} {y + 0.5:.4f} {lon:.10f} {lat:.10f} {height:.4f}")
        if len(words) > 2:
            texts.setdefault("gcps.gcp", ["# WKT: EPSG:4326"]).append(" ".join(words))
    heads = {name: ["mapX,mapY,pixelX,pixelY,enable"] for name in texts if name.endswith(".points")}
    files |= {name: "\n".join([*heads.get(name, []), *lines]) + "\n" for name, lines in texts.items()}
    return PlannedProject(files, (), "tie_points.las")


def _write_cloud(project: BlockProject, write: Callable[..., None], path: str) -> None:
    points, count = project.points, Counter(project.measured.ids.tolist())
    xyz = np.column_stack([project_to_map(points.ground, project.epsg), points.ground[:, 2]])
    write(path, xyz, points.sigma_m, np.array([count[name] for name in points.ids.tolist()]), project.epsg)


def _write_ply(path: str, xyz: np.ndarray, sigma_m: np.ndarray, rays: np.ndarray, epsg: int) -> None:
    rows = np.zeros(len(xyz), dtype=_ROW)
    rows["xyz"], rows["sigma"], rows["rays"] = xyz, sigma_m, rays
    Path(path).write_bytes(_PLY_HEAD.format(epsg=epsg, count=len(rows)).encode("ascii") + rows.tobytes())


def _write_las(path: str, xyz: np.ndarray, sigma_m: np.ndarray, rays: np.ndarray, epsg: int) -> None:
    """Write points ``(n, 3)``, map coordinates and ellipsoidal height, sigmas ``(n, 2)`` and rays ``(n,)`` as LAS."""
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
    """Return a variable length record of LAS."""
    return struct.pack("<H16sHH32s", 0, user, number, len(content), b"") + content
