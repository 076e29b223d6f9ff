"""The adjusted block of a result folder: images with refined RPCs, its points, its ground, and its stereo pairs.

Sets of RPCs in directories, and the image points from which they were estimated, found by the report of the run.

An RPC that was adjusted to a tie point fits it, for any true camera. Points from which an RPC was estimated therefore
do not evaluate it; those that its run held out do.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from ...hrsi_engine.block.assembly import stack_image_points
from ...hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints, Role
from ...hrsi_engine.block.imaging_geometry import PairGeometry, ViewDirection, compute_all_pairs, intersect_footprints
from ...hrsi_engine.block.stereo_pairs import StereoPair, choose_stereo_pairs
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.ground.sun import SunAngles
from ...hrsi_engine.io.catalogue.block_records import read_record
from ...hrsi_engine.io.catalogue.lineage import find_refining_report
from ...hrsi_engine.io.output_dir import find_image_outputs, read_report
from ...hrsi_engine.io.point_files import PointTables, read_points
from ...hrsi_engine.io.point_files.find import read_table
from ...hrsi_engine.io.point_files.interpret import interpret
from ...hrsi_engine.io.point_files.positions import Reference
from ...hrsi_engine.io.rasters.images import image_id
from ...hrsi_engine.io.rasters.sun_angles import read_sun, read_time
from ...hrsi_engine.io.rpc_files import read_rpc, read_rpc_or_none, rpc_for_image, rpc_reader_of
from ...hrsi_engine.ortho.point_surface import surface_of_points
from ...hrsi_engine.surface.dem import HeightSurface
from ..files.opening import dem_surface
from ..files.result_folder import REPORT_FILE
from ..interface.declare import Log
from ..interface.option_groups import DemOptions
from .inputs import open_block_images
from .outputs import LAYERS_FILE, RESAMPLED

SHAKEN = (
    "the images contain jitter that the refined RPCs do not: surface models get waves; adjust the block with `write` "
    "resampled, and use that result"
)


@dataclass(frozen=True, eq=False)
class AdjustedBlock:
    """An adjusted block as it is read from its folder.

    images : with their refined RPCs; told : the report of the adjustment
    points, surveyed : adjusted ground points, and known points as surveyed; measured : the image points
    surface : a DEM, or a surface through the adjusted points
    views, geometries : viewing directions, and geometry of all pairs of images
    suns, times : sun angles and time by image id, None if unknown
    """

    images: tuple[Image, ...]
    told: Mapping[str, Any]
    points: GroundPoints
    surveyed: GroundPoints | None
    measured: ImagePoints
    surface: HeightSurface
    views: dict[str, ViewDirection]
    geometries: list[PairGeometry]
    suns: dict[str, SunAngles | None]
    times: dict[str, Any]

    def choose_pairs(self, most: int) -> list[StereoPair]:
        """Return the pairs for dense matching, the best first."""
        ties = {image.id: set(self.measured.ids[self.measured.image_ids == image.id].tolist()) for image in self.images}
        incidence = {name: view.geometry().incidence_deg for name, view in self.views.items()}
        return choose_stereo_pairs(self.geometries, incidence, self.suns, self.times, ties, most)

    def common_area(self, pairs: list[StereoPair]) -> BaseGeometry:
        """Return the ground that pairs show, in degrees."""
        return unary_union(
            [intersect_footprints(self.views[one.left].footprint, self.views[one.right].footprint) for one in pairs]
        )

    @property
    def warnings(self) -> list[str]:
        """What the user should know of the block."""
        return [SHAKEN] if (self.told.get("outputs") or {}).get("jitter") else []


def read_adjusted_block(folder: str, dem: DemOptions, height_datum: str) -> AdjustedBlock:
    """Read the block of a result folder; raise `InputError` if it has no adjusted points or no refined RPCs."""
    record, told = read_record(folder), read_report(os.path.join(folder, REPORT_FILE)) or {}
    images = tuple(_use_refined_rpc(image, told, folder) for image in open_block_images(record))
    known = read_table(record.layer("ground_points"))
    points, surveyed = (interpret(known, Reference(adjusted=adjusted), ()).ground for adjusted in (True, False))
    measured = read_points(record.layer("image_points"), image_ids=[image.id for image in images]).image
    if points is None or measured is None:
        raise InputError(f"{folder}: has no adjusted points: adjust the block again")
    given = dem_surface(dem, height_datum)
    surface = surface_of_points(points.ground, points.sigma_m[:, 1])[0] if given is None else given
    views = [ViewDirection(image, surface) for image in images]
    return AdjustedBlock(
        images,
        told,
        points,
        surveyed=surveyed,
        measured=measured,
        surface=surface,
        views={view.image.id: view for view in views},
        geometries=compute_all_pairs(views),
        suns={image.id: sun.angles if (sun := read_sun(image.path, image.rpc)) else None for image in images},
        times={image.id: read_time(image.path) for image in images},
    )


def _use_refined_rpc(image: Image, told: Mapping[str, Any], folder: str) -> Image:
    """Return an image with its refined RPC from the result folder, and with the pixels to which that RPC belongs."""
    found = find_image_outputs(told, folder).get(image.id, "")
    if not os.path.isfile(found):
        raise InputError(
            f"{folder}: contains no refined RPC of {image.id}: adjust the block again and let it be written"
        )
    resampled = (told.get("options") or {}).get("write") == RESAMPLED  # without jitter, which an RPC cannot represent
    return replace(image, rpc=read_rpc(found).rpc, path=found if resampled else image.path)


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
