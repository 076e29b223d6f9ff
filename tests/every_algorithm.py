"""Every algorithm on small sound inputs, chosen from what it declares: for tests that run over all of them.

A new algorithm or option is covered as it is declared; what is sound for it comes from `SOUND` by its key, else by its
kind. Where that does not do, `ESPECIALLY` and `BESIDES` say what does.
"""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gdal_files import write_raster
from osgeo import gdal

from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.interface.declare import POSITIONAL_KINDS, READ_KINDS, Algorithm, Kind, Param

IMAGES, DEM, REFERENCE, POINTS, RPC_FILE, GRID, FOLDER = (
    "image", "DEM", "orthoimage", "points", "RPC file", "geoid grid", "folder",
)  # fmt: skip

#: Sound values of options by key, as names in the scene; other options that name files take those of `BY_KIND`.
SOUND: dict[str, Any] = {
    "images": ["image_1.tif", "image_2.tif"], "gcps": "ground_points.csv", "image_points": "image_points.csv",
    "tie_points": "ties.csv", "tracks": "ties.csv", "used_points": "points.csv", "points": "points.csv",
    "edges": "edges.csv", "terrain_points": "points.csv",
    "dem": "dem.tif", "reference": "orthophoto.tif", "rpc": "cameras/image_1_RPC.TXT", "before": "before",
    "height_datum": "geoid.tif", "dem_datum": "geoid.tif", "laser": "ground_points.csv",
    "laser_datum": "geoid.tif", "work_dir": "kept", "matches": "ties.csv", "surface": "dem.tif",
    "surface_datum": "geoid.tif", "reference_datum": "geoid.tif", "result": "adjusted", "project": "project.toml",
    "folder": "delivered",
}  # fmt: skip
BY_KIND = {Kind.IMAGES: SOUND["images"], Kind.RASTER: "dem.tif", Kind.POINTS: "points.csv", Kind.FILE: "points.csv"}
#: Where one algorithm needs something else.
ESPECIALLY: dict[str, dict[str, Any]] = {
    "ortho-check": {"images": ["ortho_1.tif", "ortho_2.tif"], "reference": "ortho_1.tif"},
    "project": {"points": "without_heights.csv"},
    "localize": {"points": "without_heights.csv"},
    "write-rpc": {"images": ["image_1.tif"]},
    "strip": {"images": ["part_1.tif", "part_2.tif"]},
    "measure-targets": {"points": "ground_points.csv"},
    "surface-model": {"reference": "dem.tif"},
}
#: Options that make runs short, or have the input used that is looked at.
BESIDES: dict[str, dict[str, Any]] = {
    "simulate": {"size": 64, "gcps": 1, "checks": 0, "ties": 0, "pixels": False},
    "triangulate": {"sigma_dem": 2.0, "no_report": True},
    "adjust": {"sigma_dem": 2.0, "no_report": True},
    "refine-rpc": {"no_report": True},
    "tie-points": {"cells": 2},
    "register": {"model": "rpc-affine"},
    "gcps-from-reference": {"reference_points": 24, "reference_search": 64.0},
    "crop": {"window": "20,30,100,80"},
    "match": {"window_1": "0,0,120,120", "window_2": "0,0,120,120"},
}
#: Inputs that stand for one another.
INSTEAD_OF = {
    "edges": ("points",),
    "terrain_points": ("dem", "dem_datum"),
    "dem": ("terrain_points",),
    "images": ("tie_points", "tracks"),
    "work_dir": ("tie_points", "tracks"),
    "matches": ("tie_points", "tracks"),
}
#: Inputs without which another one is not read.
READ_WITH = {"surface_datum": "surface", "reference_datum": "reference"}
#: Inputs that are given only where they are looked at.
SELDOM = set(
    [
        "reference",
        "surface",
        "surface_datum",
        "reference_datum",
        "edges",
        "terrain_points",
        "rpc",
        "before",
        "work_dir",
        "matches",
        "height_datum",
        "dem_datum",
        "laser_datum",
    ]
)
#: Results, projects, matrices, curves and multispectral images, which have tests of their own, as certificates have.
OTHER_FILES = {"add_to", "pansharpen", "result", "folder", "project", "coefficient_covariance", "jitter"}
#: What kind of input an option takes, by its key; else by its kind.
ROLES = {"reference": REFERENCE, "rpc": RPC_FILE, "before": FOLDER, "work_dir": FOLDER}
ROLE_OF_KIND = {Kind.IMAGES: IMAGES, Kind.RASTER: DEM, Kind.POINTS: POINTS, Kind.FILE: POINTS, Kind.TEXT: GRID}


def role_of(param: Param) -> str | None:
    """Return what kind of input an option takes; None where it names nothing that is read."""
    named = set(param.metavar.split("|")) & {"FILE", "DIR"}
    if param.key.startswith("scheduler_") or param.key in OTHER_FILES:
        return None
    if param.kind is Kind.OUTPUT_DIR or not (param.kind in READ_KINDS or named):
        return None
    return ROLES.get(param.key, ROLE_OF_KIND[param.kind])


def inputs_of(algorithm: Algorithm) -> dict[str, str]:
    """Return the role of each input that an algorithm declares, by key."""
    found = {param.key: role for param in algorithm.params if (role := role_of(param)) is not None}
    return found | ({"images": REFERENCE} if algorithm.name == "ortho-check" else {})


def make_scene(folder: Path) -> None:
    """Write sound inputs: a block of two small images, its points, DEM, orthoimages, and what else is asked for."""
    folder.mkdir(parents=True, exist_ok=True)
    run(
        "simulate", sensor="pleiades", images=2, along="-4,4", size=160, gcps=8, checks=4, ties=20, ortho=True, seed=7,
        output_dir=str(folder),
    )  # fmt: skip
    for name in ("report.json", "truth.gpkg", "truth.json"):
        (folder / name).unlink()
    images = [open_image(str(folder / name)) for name in SOUND["images"]]
    (folder / "cameras").mkdir()
    write_rpc_text(str(folder / SOUND["rpc"]), images[0].rpc)
    # Points with everything that a point file may have: positions on the ground and in the second image
    rows = ["id,image,sample,line,lon,lat,height"]
    for height in (200.0, 260.0, 320.0):
        xy = images[1].grid_px(5, 5)
        for number, (place, ground) in enumerate(zip(xy, images[1].rpc.localize(xy, height).ground, strict=True)):
            values = ",".join(f"{value:.10f}" for value in (*place, *ground))
            rows.append(f"P{number:02d}_{height:.0f},image_2,{values}")
    (folder / "points.csv").write_text("\n".join(rows) + "\n")
    (folder / "without_heights.csv").write_text("\n".join(row.rpartition(",")[0] for row in rows) + "\n")
    measured = (folder / "image_points.csv").read_text().splitlines()
    (folder / "ties.csv").write_text("\n".join([measured[0], *(row for row in measured if row.startswith("T"))]) + "\n")
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    edges = [f"E1,image_1,{60 + 8 * np.cos(angle):.3f},{70 + 5 * np.sin(angle):.3f}" for angle in angles]
    (folder / "edges.csv").write_text("\n".join(["id,image,sample,line", *edges]) + "\n")
    (folder / "before").mkdir()
    (folder / "kept").mkdir()
    for number, noise in ((1, 0.0), (2, 3.0)):
        name = f"ortho_{number}.tif"
        gdal.Translate(str(folder / name), str(folder / "orthophoto.tif"), srcWin=[300, 300, 300, 300])
        dataset = gdal.Open(str(folder / name), gdal.GA_Update)
        grey = dataset.ReadAsArray() + np.random.default_rng(1).normal(0.0, noise, (300, 300))
        dataset.GetRasterBand(1).WriteArray(grey.round())
        del dataset
        shutil.copy(folder / name, folder / "before" / name)
    for number, line in ((1, 0), (2, 70)):
        gdal.Translate(str(folder / f"part_{number}.tif"), str(folder / "image_1.tif"), srcWin=[0, line, 160, 90])
    names = {key: SOUND[key] for key in ("images", "gcps", "image_points", "dem")}
    lines = [*(f"{key} = {json.dumps(value)}" for key, value in names.items()), 'height_datum = "ellipsoidal"']
    lines += ["[triangulate]", 'tie_points = "none"', "[evaluate]", 'tracks = "none"']
    (folder / "project.toml").write_text("\n".join(lines) + "\n")
    run(
        "adjust", images=[str(folder / name) for name in SOUND["images"]], gcps=str(folder / SOUND["gcps"]),
        height_datum="ellipsoidal", image_points=str(folder / SOUND["image_points"]), report=False,
        output_dir=str(folder / SOUND["result"]),
    )  # fmt: skip
    (folder / "delivered").mkdir()
    for name in (*SOUND["images"], SOUND["gcps"], SOUND["image_points"], SOUND["dem"]):
        shutil.copy(folder / name, folder / "delivered" / name)
    write_raster(folder / "geoid.tif", np.zeros((9, 9), np.float32), (1.0, 1.0, 0.0, 48.0, 0.0, -1.0), "EPSG:4326")


def sound_options(algorithm: Algorithm, scene: Path, varied: str = "") -> dict[str, Any]:
    """Return options with which an algorithm runs to its end, reading the input ``varied`` among others."""
    own, needed = ESPECIALLY.get(algorithm.name, {}), (varied, READ_WITH.get(varied))
    without = INSTEAD_OF.get(varied, ())
    options = dict(BESIDES.get(algorithm.name, {}))
    for key in inputs_of(algorithm):
        param = algorithm.param(key)
        if key in without or (key in SELDOM and key not in needed and not param.required):
            continue
        value = own.get(key, SOUND.get(key, BY_KIND.get(param.kind)))
        options[key] = [str(scene / name) for name in value] if isinstance(value, list) else str(scene / value)
    named = (Kind.RESULT, Kind.PROJECT)
    options |= {param.key: str(scene / SOUND[param.key]) for param in algorithm.params if param.kind in named}
    if "height_datum" in algorithm.defaults() and varied != "height_datum":
        options["height_datum"] = "ellipsoidal"
    return options


def words_of(algorithm: Algorithm, options: Mapping[str, Any]) -> list[str]:
    """Return the command line of options; images and results come last."""
    words, last = [algorithm.name], {param.key for param in algorithm.params if param.kind in POSITIONAL_KINDS}
    for key, value in options.items():
        if key in last:
            continue
        name = "--" + key.replace("_", "-")
        words += ([name] if value else ["--no-" + name[2:]]) if isinstance(value, bool) else [f"{name}={value}"]
    alone = [options[key] for key in ("result", "project", "folder") if key in last]
    return [*words, *(alone or options.get("images", []))]
