"""Radiance fields and splatting with RPCs: a JSON for each view in the format of Sat-NeRF, crops, and tie points.

The JSON of a view has image, size, RPC (as `rpcm` writes it), sun, date, ground outline, and the lowest and highest
height of the scene, between which rays are sampled; ``keypoints`` are its tie points, with their rows in ``pts3d.npy``
(geocentric metres). ``train.txt`` and ``test.txt`` list training and held-out views. ``scene.json`` has the local
frame, the radius, and for each view the near and far distances along its central ray below the highest height.
Source: https://github.com/centreborelli/satnerf, ``datasets/satellite.py``; EO-NeRF and EOGS read the same files.
"""

from functools import partial

import numpy as np

from ...foundation.json_values import json_text
from ...ground.geodesy import LocalFrame, to_ecef
from ..rpc_files.fields import json_members
from ..rpc_files.text_formats import RPCM_NAMES
from .project import PROJECTS, BlockProject, FileContent, PlannedProject
from .views import find_views, sample_volume, split_views, write_crop


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
            "img": f"{view.image.id}.tif", "width": view.window.size[0], "height": view.window.size[1],
            "window": view.window.bounds,
            "rpc": json_members(view.rpc, RPCM_NAMES),
            "sun_elevation": None if sun is None else sun.elevation_deg,
            "sun_azimuth": None if sun is None else sun.azimuth_deg,
            "acquisition_date": None if time is None else f"{time:%Y%m%d%H%M%S}", "min_alt": low, "max_alt": high,
            "geojson": project.outline | {"center": list(centre[:2])},
            "keypoints": {"2d_coordinates": view.xy.tolist(), "pts3d_indices": view.point.tolist()},
        }  # fmt: skip
        files[f"{view.image.id}.json"] = json_text(camera, indent=1) + "\n"
        middle = np.array([view.window.size]) / 2.0
        upper, lower = (to_ecef(view.rpc.localize(middle, height).ground) for height in (high, low))
        rays[view.image.id] = {"near_m": 0.0, "far_m": float(np.linalg.norm(upper - lower))}
    files["pts3d.npy"] = partial(np.save, arr=to_ecef(project.points.ground))
    names = [f"{view.image.id}.json" for view in views]
    for file, view_names in zip(("train.txt", "test.txt"), split_views(names, PROJECTS.held_out_of), strict=True):
        files[file] = "".join(f"{name}\n" for name in view_names)
    radius = float(np.linalg.norm(frame.from_ground(volume), axis=1).max())
    scene = {"origin": list(centre), "axes": "east, north, up (m)", "radius_m": radius, "rays": rays}
    files["scene.json"] = json_text(scene, indent=1) + "\n"
    return PlannedProject(files, ("python main.py --model sat-nerf --root_dir . --img_dir .",), "logs")
