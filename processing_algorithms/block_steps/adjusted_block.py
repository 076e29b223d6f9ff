"""The adjusted block of a result folder: images with refined RPCs, its points, its ground, and its stereo pairs."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from ...hrsi_engine.block.block import GroundPoints, Image, ImagePoints
from ...hrsi_engine.block.imaging_geometry import PairGeometry, ViewDirection, compute_all_pairs, intersect_footprints
from ...hrsi_engine.block.stereo_pairs import StereoPair, choose_stereo_pairs
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.ground.sun import SunAngles
from ...hrsi_engine.io.catalogue.block_records import read_record
from ...hrsi_engine.io.output_dir import find_image_outputs, read_report
from ...hrsi_engine.io.point_files import read_points
from ...hrsi_engine.io.point_files.find import read_table
from ...hrsi_engine.io.point_files.interpret import interpret
from ...hrsi_engine.io.point_files.positions import Reference
from ...hrsi_engine.io.rasters.sun_angles import read_sun, read_time
from ...hrsi_engine.io.rpc_files import read_rpc
from ...hrsi_engine.ortho.point_surface import surface_of_points
from ...hrsi_engine.surface.dem import HeightSurface
from ..files.opening import dem_surface
from ..files.result_folder import REPORT_FILE
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
