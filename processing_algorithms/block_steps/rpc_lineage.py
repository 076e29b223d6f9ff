"""Which image points made a set of RPCs: the folder of the run that refined them tells.

An RPC that was adjusted to a tie point fits it, whatever the camera is in truth. So points that made an RPC do not
judge it; those that its run held out do.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...hrsi_engine.block.assembly import stack_image_points
from ...hrsi_engine.block.block import Block, ImagePoints, Role
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.io.catalogue.lineage import maker_of
from ...hrsi_engine.io.output_dir import read_report
from ...hrsi_engine.io.point_files import PointTables, read_points
from ..files.dry_run import REPORT_FILE
from .outputs import LAYERS_FILE

MAKERS = ("triangulate", "adjust", "refine-rpc")  #: algorithms that refine RPCs


@thresholds
class RPC_LINEAGE:
    """When a measurement is one that made an RPC."""

    same_px: float = threshold(0.1, "px", "distance of two measurements that are the same one, read or found again")


@dataclass(frozen=True, eq=False)
class MakingPoints:
    """The image points of the run that refined a set of RPCs; None where its layers are not there any more.

    used : those of GCPs and tie points that could bend the cameras
    held_out : those of tie points that the run held out
    """

    report: str
    used: ImagePoints | None = None
    held_out: ImagePoints | None = None


def find_making_points(files: Sequence[str], image_ids: Sequence[str]) -> MakingPoints | None:
    """Return the points that made the RPCs of some files; None where no file says that it was refined here."""
    reports: dict[str, bool] = {}
    for file in files:
        told = maker_of(file)
        beside = os.path.join(os.path.dirname(os.path.abspath(file)), REPORT_FILE)
        found = next((one for one in (beside, told) if one and _names_output(one, file)), None)
        if found or told is not None:
            reports[found or told or ""] = found is not None
    if not reports:
        return None
    first = next(iter(reports))
    if not all(reports.values()):
        return MakingPoints(next(name for name, there in reports.items() if not there))
    tables = []
    for report in reports:
        layers = os.path.join(os.path.dirname(report), LAYERS_FILE)
        try:
            tables.append(read_points(f"{layers}|layername=image_points", image_ids=image_ids))
        except InputError:
            return MakingPoints(report)
    return MakingPoints(first, *split_measurements(tables))


def _names_output(path: str, file: str) -> bool:
    """Return whether a report is of a run that wrote a file; its folder may have been moved."""
    report = read_report(path)
    if report is None or report["algorithm"] not in MAKERS:
        return False
    outputs = [image.get("output") for image in report.get("images", {}).values()]
    return os.path.basename(file) in [os.path.basename(output) for output in outputs if output]


def split_measurements(tables: Sequence[PointTables]) -> tuple[ImagePoints, ImagePoints]:
    """Return the image points that could bend cameras and those of held-out ties; check points are neither."""
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
    """Return a mask of the points of a block that come near one of the ``measured`` image points on any image."""
    rows = block.measurements
    near = np.zeros(len(block.points), dtype=bool)
    image_ids = np.asarray(measured.image_ids)
    for index, image in enumerate(block.images):
        here, there = np.flatnonzero(rows.image == index), measured.xy[image_ids == image.id]
        if len(here) and len(there):
            distance, _ = cKDTree(there).query(rows.xy[here], distance_upper_bound=apart_px * (1.0 + 1e-9))
            near[rows.point[here[distance <= apart_px]]] = True
    return near
