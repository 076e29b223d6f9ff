"""COLMAP and programs that read its models: a perspective camera for each crop, and the tie points as sparse model.

``cameras.txt`` (PINHOLE, one for each image), ``images.txt`` (poses, with the measured tie points) and
``points3D.txt`` are in a local frame, metres east, north and up of the origin in ``scene.json``; the images are 8 bit
PNG, stretched, and sheared if the pixel axes of the pushbroom are not perpendicular. ``scene.json`` contains the
differences of the perspective cameras from the RPCs. COLMAP's pixels refer to the corner, the centre of the first is
(0.5, 0.5). Source: https://colmap.github.io/format.html. Trainers of splats need ``images/`` and ``sparse/0/``, which
the first command makes.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from osgeo import gdal
from scipy.spatial.transform import Rotation

from ...camera.perspective import PerspectiveCamera, fit_perspective_camera
from ...foundation.errors import OutputError
from ...foundation.json_values import json_text
from ...ground.geodesy import LocalFrame
from ..opening.datasets import config_option, gdal_messages
from ..rasters.cropping import open_window
from .project import PROJECTS, BlockProject, FileContent, PlannedProject
from .views import CropView, find_views, sample_volume

_CORNER = 0.5  # from the centre of the first pixel to its corner


class PerspectiveView(NamedTuple):
    """A crop with its perspective camera; size : of the sheared image; error_px : camera minus RPC, RMS and maximum."""

    view: CropView
    camera: PerspectiveCamera
    size: tuple[int, int]
    error_px: tuple[float, float]


def plan_colmap_project(project: BlockProject) -> PlannedProject:
    """Return the plan of images, cameras, poses, points, and ``scene.json``."""
    volume = sample_volume(project)
    frame = LocalFrame(*volume.mean(axis=0).tolist())
    views = [_approximate(view, volume, frame) for view in find_views(project)]
    local = frame.from_ground(project.points.ground)
    files: dict[str, FileContent] = {f"{one.view.image.id}.png": partial(write_shear, one) for one in views}
    cameras, images, tracks, misses = list[str](), list[str](), dict[int, list[str]](), dict[int, list[float]]()
    for number, (view, camera, size, _) in enumerate(views, 1):
        xy = camera.shear_points(view.xy)
        miss = np.hypot(*(camera.project(local[view.point]) - xy).T)
        for index, row in enumerate(view.point.tolist()):
            tracks.setdefault(row, []).append(f"{number} {index}")
            misses.setdefault(row, []).append(float(miss[index]))
        numbers = *camera.focal.tolist(), *(camera.principal + _CORNER).tolist()
        cameras.append(f"{number} PINHOLE {size[0]} {size[1]} {' '.join(map(repr, numbers))}")
        x, y, z, w = Rotation.from_matrix(camera.rotation).as_quat().tolist()
        pose = " ".join(map(repr, (w, x, y, z, *camera.translation.tolist())))
        images.append(f"{number} {pose} {number} {view.image.id}.png")
        observations = zip((xy + _CORNER).tolist(), view.point.tolist(), strict=True)
        images.append(" ".join(f"{x!r} {y!r} {row + 1}" for (x, y), row in observations))
    points = [
        f"{row + 1} {' '.join(map(repr, local[row].tolist()))} 128 128 128 {np.mean(misses[row]):.4f} {' '.join(track)}"
        for row, track in sorted(tracks.items())
    ]
    for name, lines in (("cameras", cameras), ("images", images), ("points3D", points)):
        files[f"{name}.txt"] = "\n".join(lines) + "\n"
    errors = {one.view.image.id: {"rms_px": one.error_px[0], "max_px": one.error_px[1]} for one in views}
    origin = [frame.lon_deg, frame.lat_deg, frame.height_m]
    scene = {"origin": origin, "axes": "east, north, up (m)", "perspective": errors}
    files["scene.json"] = json_text(scene, indent=1) + "\n"
    return PlannedProject(
        files,
        (
            "mkdir -p images sparse/0 && cp *.png images && cp cameras.txt images.txt points3D.txt sparse/0",
            "colmap image_undistorter --image_path images --input_path sparse/0 --output_path dense",
            "colmap patch_match_stereo --workspace_path dense",
            "colmap stereo_fusion --workspace_path dense --output_path dense/fused.ply",
        ),
        "dense/fused.ply",
        tuple(
            f"{name}: its perspective camera differs from its RPC by {error['rms_px']:.2f} px (RMS), at most "
            f"{error['max_px']:.2f} px: take a smaller `extent`"
            for name, error in errors.items()
            if error["max_px"] > PROJECTS.perspective_px
        ),
        {"perspective": errors},
    )


def _approximate(view: CropView, volume: np.ndarray, frame: LocalFrame) -> PerspectiveView:
    """Return a view with the perspective camera that approximates its RPC over the volume ``(n, 3)``."""
    local, xy = frame.from_ground(volume), view.rpc.project(volume)
    middle = np.array(view.window.size)[None] / 2.0
    upper, lower = (
        frame.from_ground(view.rpc.localize(middle, height).ground)[0]
        for height in (volume[:, 2].max(), volume[:, 2].min())
    )
    camera = fit_perspective_camera(local, xy, (lower - upper) / np.linalg.norm(lower - upper))
    miss = np.hypot(*(camera.project(local) - camera.shear_points(xy)).T)
    width, height = view.window.size
    corners = np.array([[x, y] for x in (-_CORNER, width - _CORNER) for y in (-_CORNER, height - _CORNER)])
    across = camera.shear_points(corners)[:, 0] + _CORNER
    left, right = int(np.floor(across.min())), int(np.ceil(across.max()))
    error = float(np.sqrt(np.mean(miss**2))), float(miss.max())
    return PerspectiveView(view, camera.begin_at(left), (right - left, height), error)


def write_shear(one: PerspectiveView, path: str) -> None:
    """Write the pixels of a view as PNG, sheared and stretched to 8 bit."""
    (width, height), shear = one.size, one.camera.shear
    source = open_window(one.view.image.path, one.view.window, "cubic")
    bands = [1, 2, 3] if source.RasterCount >= 3 else [1]
    pixels = one.view.image.pixels.read(*one.view.window.bounds)
    low, high = np.percentile(pixels[0][pixels[1]], PROJECTS.stretch_percent) if pixels[1].any() else (0.0, 1.0)
    copy = None
    with gdal_messages() as messages, config_option("GDAL_PAM_ENABLED", "NO"):
        begin = shear * (one.camera.principal[1] + _CORNER) - one.camera.left
        source.SetGeoTransform((begin, 1.0, -shear, 0.0, 0.0, -1.0))
        stretched = gdal.Translate(
            "", source, format="VRT", bandList=bands, outputType=gdal.GDT_Byte,
            scaleParams=[[float(low), float(high), 0.0, 255.0]] * len(bands),
        )  # fmt: skip
        sheared = gdal.Warp(
            "", stretched, format="MEM", outputBounds=(0.0, -height, width, 0.0), width=width, height=height,
            resampleAlg="cubic",
        )  # fmt: skip
        copy = sheared and gdal.GetDriverByName("PNG").CreateCopy(path, sheared)
    if copy is None:
        raise OutputError(f"{path}: cannot be written ({messages.reason})")
