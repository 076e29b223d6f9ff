"""The adjusted points for point cloud tools, and GCPs for GDAL, QGIS and the Ames Stereo Pipeline.

``tie_points.ply`` has positions as east, north (of the result CRS) and ellipsoidal height with standard deviations and
number of rays; ``gcps.gcp`` holds a point a line: id, lat, lon, height, three sigmas, then image, sample, line and two
sigmas for each measurement (ASP, ``bundle_adjust``). ``ID.points`` is the QGIS georeferencer's, which counts pixels
from the corner with y upwards, and ``ID_gcps.txt`` has ``-gcp`` arguments, from the corner, for ``gdal_translate
--optfile``.
"""

from collections import Counter
from pathlib import Path

import numpy as np

from ...block.block import Role
from ...ground.map_crs import project_to_map
from .project import BlockProject, WrittenProject

_PLY_HEAD = (
    "ply\nformat binary_little_endian 1.0\ncomment east north height: EPSG:{epsg}, ellipsoidal\n"
    "element vertex {count}\n"
    "property double x\nproperty double y\nproperty double z\nproperty float sigma_plan\nproperty float sigma_height\n"
    "property int rays\nend_header\n"
)
_ROW = np.dtype([("xyz", "<f8", 3), ("sigma", "<f4", 2), ("rays", "<i4")])


def write_points_project(project: BlockProject, folder: Path) -> WrittenProject:
    """Write the points of the block."""
    points, surveyed, measured = project.points, project.surveyed, project.measured
    rows = np.zeros(len(points), dtype=_ROW)
    rows["xyz"] = np.column_stack([project_to_map(points.ground, project.epsg), points.ground[:, 2]])
    rays = Counter(measured.ids.tolist())
    rows["sigma"], rows["rays"] = points.sigma_m, [rays[name] for name in points.ids.tolist()]
    with open(folder / "tie_points.ply", "wb") as file:
        file.write(_PLY_HEAD.format(epsg=project.epsg, count=len(rows)).encode("ascii") + rows.tobytes())
    known = np.flatnonzero((surveyed.role == Role.GCP) | (surveyed.role == Role.CHECK))
    place = {image.id: image.path for image in project.images}
    lines: list[str] = []
    texts: dict[str, list[str]] = {}
    for row in known.tolist():
        name, (lon, lat, height), (plan, up) = str(surveyed.ids[row]), surveyed.ground[row], surveyed.sigma_m[row]
        own = np.flatnonzero(measured.ids == name)
        words = [name, f"{lat:.10f} {lon:.10f} {height:.4f} {plan:.4f} {plan:.4f} {up:.4f}"]
        for index in own.tolist():
            image, (x, y), sigma = str(measured.image_ids[index]), measured.xy[index], measured.sigma_px[index]
            words += [Path(place[image]).name, f"{x:.4f}", f"{y:.4f}", f"{sigma:.3f}", f"{sigma:.3f}"]
            texts.setdefault(f"{image}.points", []).append(f"{lon:.10f},{lat:.10f},{x + 0.5:.4f},{-y - 0.5:.4f},1")
            gdal_words = f"-gcp {x + 0.5:.4f} {y + 0.5:.4f} {lon:.10f} {lat:.10f} {height:.4f}"
            texts.setdefault(f"{image}_gcps.txt", []).append(gdal_words)
        lines += [" ".join(words)] * bool(own.size)
    if lines:
        texts["gcps.gcp"] = ["# WKT: EPSG:4326", *lines]
    for target, content in texts.items():
        head = ["mapX,mapY,pixelX,pixelY,enable"] if target.endswith(".points") else []
        (folder / target).write_text("\n".join([*head, *content]) + "\n", encoding="utf-8")
    return WrittenProject((), "tie_points.ply")
