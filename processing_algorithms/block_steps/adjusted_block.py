"""The adjusted block of a result folder: images with refined RPCs, its points, its ground, and its stereo pairs.

Also sets of RPCs in directories.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from ...hrsi_engine.block.block import GroundPoints, Image, ImagePoints
from ...hrsi_engine.block.imaging_geometry import PairGeometry, ViewDirection, compute_all_pairs, intersect_footprints
from ...hrsi_engine.block.stereo_pairs import StereoPair, choose_stereo_pairs
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.ground.sun import SunAngles
from ...hrsi_engine.io.catalogue.block_records import read_record
from ...hrsi_engine.io.output_dir import find_image_outputs, read_report
from ...hrsi_engine.io.point_files import read_points
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
from .outputs import RESAMPLED

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
