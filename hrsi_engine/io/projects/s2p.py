"""s2p: a configuration in JSON; its paths are relative to the working directory.

The first image is the reference, and every other image forms a stereo pair with it. The DEM has ellipsoidal heights,
so ``exogenous_dem_geoid_mode`` is false. Source: ``s2p/config.py`` and the README of s2p 1.0b25.
"""

from collections import Counter
from functools import partial

from ...foundation.json_values import json_text
from .project import DEM_FILE, BlockProject, PlannedProject, find_window, plan_images, write_initial_dem

_FILE, _RESULT = "s2p.json", "out/dsm.tif"


def plan_s2p_project(project: BlockProject) -> PlannedProject:
    """Return the plan of the reference image, its partners, initial DEM and ``s2p.json``."""
    images, score = {image.id: image for image in project.images}, Counter[str]()
    for pair in project.pairs:
        score.update({pair.left: pair.score, pair.right: pair.score})
    reference = max(score, key=lambda name: score[name])
    reference_pairs = [pair for pair in project.pairs if reference in (pair.left, pair.right)]
    partners = [pair.right if pair.left == reference else pair.left for pair in reference_pairs]
    left_out = len(project.pairs) - len(reference_pairs)
    names, files = plan_images(project, [images[name] for name in (reference, *partners)], project.copy)
    x, y, w, h = find_window(images[reference], project.area, project.surface)
    configuration = {
        "out_dir": "out", "temporary_dir": "tmp", "images": [{"img": file} for file in names.values()],
        "roi": {"x": x, "y": y, "w": w, "h": h}, "exogenous_dem": DEM_FILE, "exogenous_dem_geoid_mode": False,
        "timeout": 3600, "mgm_timeout": 3600,
        "dsm_resolution": round(project.gsd_m, 2), "out_crs": f"epsg:{project.epsg}",
    }  # fmt: skip
    files[DEM_FILE] = partial(write_initial_dem, project)
    files[_FILE] = json_text(configuration, indent=1) + "\n"
    notice = f"s2p pairs all images with {reference}; chosen pairs that are left out: {left_out}"
    return PlannedProject(files, (f"s2p {_FILE}",), _RESULT, (notice,) * bool(left_out))
