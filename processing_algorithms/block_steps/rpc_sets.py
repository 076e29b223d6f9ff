"""Sets of RPCs in directories, and the image points from which they were estimated, found by the report of the run.

An RPC that was adjusted to a tie point fits it, for any true camera. Points from which an RPC was estimated therefore
do not evaluate it; those that its run held out do.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...hrsi_engine.block.assembly import stack_image_points
from ...hrsi_engine.block.block import Block, Image, ImagePoints, Role
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.io.catalogue.lineage import find_refining_report
from ...hrsi_engine.io.output_dir import find_image_outputs, read_report
from ...hrsi_engine.io.point_files import PointTables, read_points
from ...hrsi_engine.io.rasters.images import image_id
from ...hrsi_engine.io.rpc_files import read_rpc_or_none, rpc_for_image, rpc_reader_of
from ..files.result_folder import REPORT_FILE
from ..interface.declare import Log
from .outputs import LAYERS_FILE

REFINING_ALGORITHMS = ("triangulate", "adjust", "refine-rpc")  #: algorithms that refine RPCs


@thresholds
class RPC_SETS:
    """Limits for points that were used to estimate RPCs, and for the number of predictions."""

    denser: int = threshold(3, "", "factor of the tie points per cell in a further search")


@dataclass(frozen=True, eq=False)
class EstimationPoints:
    """Image points of the run that refined a set of RPCs; None if its layers do not exist any more.

    used : measurements of GCPs and tie points, which influenced the cameras
    held_out : measurements of tie points that the run held out
    """

    report: str
    used: ImagePoints | None = None
    held_out: ImagePoints | None = None


def find_estimation_points(files: Sequence[str], image_ids: Sequence[str]) -> EstimationPoints | None:
    """Return the points from which the RPCs of some files were estimated; None if HRSI refined none of them."""
    reports: dict[str, bool] = {}
    for file in files:
        told = find_refining_report(file)
        beside = os.path.join(os.path.dirname(os.path.abspath(file)), REPORT_FILE)
        found = next((one for one in (beside, told) if one and _names_output(one, file)), None)
        if found or told is not None:
            reports[found or told or ""] = found is not None
    if not reports:
        return None
    first = next(iter(reports))
    if not all(reports.values()):
        return EstimationPoints(next(name for name, there in reports.items() if not there))
    tables = []
    for report in reports:
        layers = os.path.join(os.path.dirname(report), LAYERS_FILE)
        try:
            tables.append(read_points(f"{layers}|layername=image_points", image_ids=image_ids))
        except InputError:
            return EstimationPoints(report)
    return EstimationPoints(first, *split_measurements(tables))


def _names_output(path: str, file: str) -> bool:
    """Return whether a report belongs to a run that wrote a file; its folder may have been moved."""
    report = read_report(path)
    if report is None or report["algorithm"] not in REFINING_ALGORITHMS:
        return False
    return os.path.basename(file) in map(os.path.basename, find_image_outputs(report).values())


def split_measurements(tables: Sequence[PointTables]) -> tuple[ImagePoints, ImagePoints]:
    """Return the image points that influenced cameras, and those of held-out tie points; neither has check points."""
    used, held = list[ImagePoints](), list[ImagePoints]()
    for image, ground in ((one.image, one.ground) for one in tables if one.image is not None):
        passive, out = (
            np.isin(image.ids, [] if ground is None else ground.ids[ground.role == role])
            for role in (Role.CHECK, Role.HELD_OUT)
        )
        used.append(image.select(~passive & ~out))
        held.append(image.select(out))
    return stack_image_points(used), stack_image_points(held)


def find_points_near(block: Block, measured: ImagePoints, apart_px: float) -> np.ndarray:
    """Return the mask of the points of a block within ``apart_px`` of a ``measured`` point in at least one image."""
    rows = block.measurements
    near = np.zeros(len(block.points), dtype=bool)
    image_ids = np.asarray(measured.image_ids)
    for index, image in enumerate(block.images):
        here, there = np.flatnonzero(rows.image == index), measured.xy[image_ids == image.id]
        if len(here) and len(there):
            distance, _ = cKDTree(there).query(rows.xy[here], distance_upper_bound=apart_px * (1.0 + 1e-9))
            near[rows.point[here[distance <= apart_px]]] = True
    return near


NEVER_RPC = (".gpkg", ".json", ".html", ".csv", ".aux.xml", ".png", ".jpg", ".log", ".gpkg-wal", ".gpkg-shm")


def rpcs_of_folder(folder: str, images: Sequence[Image], log: Log) -> tuple[list[str], list[RPC]]:
    """Return files and RPCs in a directory for images; raise `InputError` if one is missing.

    For an image ``a.tif`` the RPC is that of ``a.tif``, of another file with the id ``a`` (``a.vrt``, ``a_RPC.TXT``),
    or of a file whose name contains ``a`` as a word (``run-a.adjusted_rpc.xml``). The RPC of a scene is moved to the
    image's crop.
    """
    if not os.path.isdir(folder):
        raise InputError(f"{folder}: no such directory: `rpcs` needs NAME=DIR")
    names = sorted(name for name in os.listdir(folder) if not name.lower().endswith(NEVER_RPC))
    found = [_rpc_of(folder, names, image) for image in images]
    files = ", ".join(name for name, _ in found[:3]) + (", …" if len(found) > 3 else "")
    log(f"{folder}: {len(found)} RPCs ({files})")
    return [os.path.join(folder, name) for name, _ in found], [rpc for _, rpc in found]


def _rpc_of(folder: str, names: Sequence[str], image: Image) -> tuple[str, RPC]:
    """Return the file and the RPC of one image in a directory."""
    same = [name for name in names if name == os.path.basename(image.path)]
    of_id = [name for name in names if image_id(name).lower() == image.id.lower() and name not in same]
    word = re.compile(rf"(?<![A-Za-z0-9]){re.escape(image.id)}(?![A-Za-z0-9])", re.IGNORECASE)
    others = [name for name in names if word.search(name) and name not in same and name not in of_id]
    for name in (*same, *of_id, *others):
        path = os.path.join(folder, name)
        if os.path.isdir(path):
            continue
        try:
            if rpc_reader_of(path) is not None:
                return name, rpc_for_image(path, image.path).rpc
            reading = read_rpc_or_none(path)
        except InputError:
            if name not in others:
                raise
            continue  # another file whose name contains that of the image
        if reading is not None:
            return name, reading.rpc
    raise InputError(
        f"{folder}: contains no RPC for {image.id} ({image.id}.tif with RPC, {image.id}_RPC.TXT, {image.id}.RPB …): "
        "check the directory"
    )
