"""Crops of the region of interest with the data that a multi-view reconstruction needs of each view.

Radiance fields and splatting with RPCs: a JSON for each view in the format of Sat-NeRF, crops, and tie points.

The JSON of a view has image, size, RPC (as `rpcm` writes it), sun, date, ground outline, and the lowest and highest
height of the scene, between which rays are sampled; ``keypoints`` are its tie points, with their rows in ``pts3d.npy``
(geocentric metres). ``train.txt`` and ``test.txt`` list training and held-out views. ``scene.json`` has the local
frame, the radius, and for each view the near and far distances along its central ray below the highest height.
Source: https://github.com/centreborelli/satnerf, ``datasets/satellite.py``; EO-NeRF and EOGS read the same files.

COLMAP and programs that read its models: a perspective camera for each crop, and the tie points as sparse model.

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

from ...block.block import Image
from ...camera.perspective import PerspectiveCamera, fit_perspective_camera
from ...camera.rpc import RPC
from ...foundation.errors import InputError, OutputError
from ...foundation.json_values import json_text
from ...foundation.pixel_filters import STRETCH
from ...foundation.progress import silent
from ...foundation.thresholds import EQUALITY, GRIDS, GROUND
from ...ground.geodesy import LocalFrame, to_ecef
from ..opening.datasets import config_option, gdal_messages
from ..rasters.cropping import CropWindow, open_window, save_image
from ..rasters.orthoimages import OrthoFormat
from ..rpc_files.crop import crop_rpc
from ..rpc_files.fields import json_members
from ..rpc_files.text_formats import RPCM_NAMES
from ..rpc_files.write import NO_LINEAGE
from .project import PROJECTS, BlockProject, FileContent, PlannedProject, find_window, sample_area

_FORMAT, _KERNEL = OrthoFormat("gtiff", "deflate"), "cubic"


class CropView(NamedTuple):
    """A crop of an image.

    image : the image; rpc : camera of the crop; window : its place in the image, and its samples and lines
    xy : (n, 2) points measured in the crop, from the centre of its first pixel; point : (n,) their rows in the block
    """

    image: Image
    rpc: RPC
    window: CropWindow
    xy: np.ndarray
    point: np.ndarray


def find_views(project: BlockProject) -> list[CropView]:
    """Return the crops of the images that show the region, resampled by the project's factor."""
    rows = {name: row for row, name in enumerate(project.points.ids.tolist())}
    views = []
    for image in project.images:
        bounds = find_window(image, project.area, project.surface)
        if min(bounds[2:]) < 1:
            continue
        if image.raster is None:
            raise InputError(f"{image.id}: has no pixels: adjust the images, not RPC files")
        window = CropWindow(
            bounds, (max(1, round(project.factor * bounds[2])), max(1, round(project.factor * bounds[3])))
        )
        image_points = project.measured.select(project.measured.image_ids == image.id)
        image_points = image_points.select(np.array([name in rows for name in image_points.ids.tolist()], dtype=bool))
        xy = window.place.from_scene(image_points.xy)
        is_inside = ((xy >= -0.5) & (xy <= np.array(window.size) - 0.5)).all(axis=1)
        point = np.array([rows[name] for name in image_points.ids[is_inside].tolist()], dtype=np.int64)
        views.append(CropView(image, crop_rpc(image.rpc, window.place, window.size), window, xy[is_inside], point))
    return views


def sample_volume(project: BlockProject) -> np.ndarray:
    """Return ground points ``(n, 3)`` over the region, in layers from below the lowest to above the highest terrain."""
    ground = sample_area(project.area.bounds, project.surface, GRIDS.fine)
    low, high = np.nanmin(ground[..., 2]), np.nanmax(ground[..., 2])
    heights = np.linspace(low - GROUND.margin_m, high + GROUND.margin_m, GRIDS.coarse)
    return np.concatenate(
        [np.column_stack([ground[..., :2].reshape(-1, 2), np.full(ground[..., 0].size, height)]) for height in heights]
    )


def write_crop(view: CropView, path: str) -> None:
    """Write the pixels of a view with its RPC as GeoTIFF."""
    pixels = open_window(view.image.path, view.window, _KERNEL)
    save_image(pixels, path, view.rpc, form=_FORMAT, lineage=NO_LINEAGE, progress=silent)


def plan_nerf_project(project: BlockProject) -> PlannedProject:
    """Return the plan of crops, JSON of the views, tie points, lists, and ``scene.json``."""
    volume = sample_volume(project)
    low, high = float(volume[:, 2].min()), float(volume[:, 2].max())
    centre = (*project.area.centroid.coords[0], (low + high) / 2.0)
    frame, rays, views = LocalFrame(*centre), {}, find_views(project)
    files: dict[str, FileContent] = {f"{view.image.id}.tif": partial(write_crop, view) for view in views}
    for view in views:
        sun, time = project.suns[view.image.id], project.times[view.image.id]
        camera = {
            "img": f"{view.image.id}.tif",
            "width": view.window.size[0],
            "height": view.window.size[1],
            "window": view.window.bounds,
            "rpc": json_members(view.rpc, RPCM_NAMES),
            "sun_elevation": None if sun is None else sun.elevation_deg,
            "sun_azimuth": None if sun is None else sun.azimuth_deg,
            "acquisition_date": None if time is None else f"{time:%Y%m%d%H%M%S}",
            "min_alt": low,
            "max_alt": high,
            "geojson": project.outline | {"center": list(centre[:2])},
            "keypoints": {"2d_coordinates": view.xy.tolist(), "pts3d_indices": view.point.tolist()},
        }
        files[f"{view.image.id}.json"] = json_text(camera, indent=1) + "\n"
        middle = np.array([view.window.size]) / 2.0
        upper, lower = (to_ecef(view.rpc.localize(middle, height).ground) for height in (high, low))
        rays[view.image.id] = {"near_m": 0.0, "far_m": float(np.linalg.norm(upper - lower))}
    files["pts3d.npy"] = partial(np.save, arr=to_ecef(project.points.ground))
    names = [f"{view.image.id}.json" for view in views]
    # One view of so many is held out, beginning in the middle of the first run
    step = PROJECTS.held_out_of
    held_out = names[step // 2 :: step] if len(names) > step // 2 else names[-1:]
    files["train.txt"] = "".join(f"{name}\n" for name in names if name not in held_out)
    files["test.txt"] = "".join(f"{name}\n" for name in held_out)
    radius = float(np.linalg.norm(frame.from_ground(volume), axis=1).max())
    scene = {"origin": list(centre), "axes": "east, north, up (m)", "radius_m": radius, "rays": rays}
    files["scene.json"] = json_text(scene, indent=1) + "\n"
    return PlannedProject(files, ("python main.py --model sat-nerf --root_dir . --img_dir .",), "logs")


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
    tables = {"cameras": cameras, "images": images, "points3D": points}
    files |= {f"{name}.txt": "\n".join(lines) + "\n" for name, lines in tables.items()}
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
            if error["max_px"] > EQUALITY.rpc_px
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
    low, high = np.percentile(pixels[0][pixels[1]], STRETCH.percent) if pixels[1].any() else (0.0, 1.0)
    copy = None
    with gdal_messages() as messages, config_option("GDAL_PAM_ENABLED", "NO"):
        begin = shear * (one.camera.principal[1] + _CORNER) - one.camera.left
        source.SetGeoTransform((begin, 1.0, -shear, 0.0, 0.0, -1.0))
        stretched = gdal.Translate(
            "",
            source,
            format="VRT",
            bandList=bands,
            outputType=gdal.GDT_Byte,
            scaleParams=[[float(low), float(high), 0.0, 255.0]] * len(bands),
        )
        sheared = gdal.Warp(
            "",
            stretched,
            format="MEM",
            outputBounds=(0.0, -height, width, 0.0),
            width=width,
            height=height,
            resampleAlg="cubic",
        )
        copy = sheared and gdal.GetDriverByName("PNG").CreateCopy(path, sheared)
    if copy is None:
        raise OutputError(f"{path}: cannot be written ({messages.reason})")
