"""The adjusted points for point cloud tools, and GCPs for GDAL, QGIS and the Ames Stereo Pipeline.

``tie_points.ply`` and ``tie_points.las`` have positions as east, north (of the result CRS) and ellipsoidal height with
standard deviations and number of rays; ``gcps.gcp`` holds a point a line: id, lat, lon, height, three sigmas, then
image, sample, line and two sigmas for each measurement (ASP, ``bundle_adjust``). ``ID.points`` is the QGIS
georeferencer's, which counts pixels from the corner with y upwards, and ``ID_gcps.txt`` has ``-gcp`` arguments, from
the corner, for ``gdal_translate --optfile``.
"""

from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from ...block.block import Role
from ...ground.map_crs import project_to_map
from .las import write_las
from .project import BlockProject, FileContent, PlannedProject

_PLY_HEAD = (
    "ply\nformat binary_little_endian 1.0\ncomment east north height: EPSG:{epsg}, ellipsoidal\n"
    "element vertex {count}\n"
    "property double x\nproperty double y\nproperty double z\nproperty float sigma_plan\nproperty float sigma_height\n"
    "property int rays\nend_header\n"
)
_ROW = np.dtype([("xyz", "<f8", 3), ("sigma", "<f4", 2), ("rays", "<i4")])


def plan_points_project(project: BlockProject) -> PlannedProject:
    """Return the points of the block as clouds, and its GCPs and check points."""
    files: dict[str, FileContent] = {
        f"tie_points.{suffix}": partial(_write_cloud, project, write)
        for suffix, write in (("ply", _write_ply), ("las", write_las))
    }
    # The files of GCPs and check points by their names
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
