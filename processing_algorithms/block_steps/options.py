"""Options that the algorithms on blocks share: where points come from, what is control, where results go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from ...hrsi_engine.block.default_sigmas import Defaults
from ...hrsi_engine.foundation.options import nested, option
from ..files.terrain import ground_crs_option, height_datum_option
from ..interface.declare import Common, Kind, ResultFolder


def images_option(help: str = "Images with RPC, or RPC files alone (_RPC.TXT, .RPB, XML, .geom)") -> Any:
    """Return the field of the images, the positional arguments."""
    return option(help=help, kind=Kind.IMAGES, metavar="IMAGE")


@dataclass(frozen=True)
class PointFiles:
    """Files of ground and image points, and which points are control."""

    gcps: str | None = option(
        None,
        "Ground points with known position: a vector layer or CSV",
        kind=Kind.POINTS,
        metavar="FILE[|layername=L]",
    )
    image_points: str | None = option(
        None,
        "Where points were measured on the images; ground positions in it are not used",
        kind=Kind.POINTS,
        metavar="FILE",
    )
    gcp_ids: tuple[str, ...] | None = option(
        None, "These points are control, all other known points are check points", metavar="A,B,…"
    )
    check_ids: tuple[str, ...] | None = option(
        None,
        "These points are check points; with `gcp_ids` too, all other known points take no part",
        metavar="A,B,…",
    )
    ground_crs: str | None = ground_crs_option()
    height_datum: str = height_datum_option()
    sigmas: Defaults = nested(Defaults)


@dataclass(frozen=True, kw_only=True)
class BlockOutput:
    """What is written of an adjusted block, and where."""

    folder: ResultFolder = nested(ResultFolder)
    write: str = option(
        "copy",
        "Where refined RPCs go: into copies of the images, into the images themselves (write-rpc --restore brings the "
        "original back), into virtual images, into _RPC.TXT files, or nowhere; an RPC file without image gets a new "
        "_RPC.TXT",
        choices=("copy", "in-place", "vrt", "sidecar", "none"),
    )
    force_write: bool = option(
        False, "Write the refined RPCs although the verdict on the result is unusable", advanced=True
    )
    residual_crs: str = option("both", "Coordinate systems of the residual layers", choices=("both", "wgs84", "utm"))
    report: bool = option(True, "Write report.html")
    common: Common = nested(Common)


class BlockOptions(Protocol):
    """What the options of all algorithms on blocks have."""

    @property
    def images(self) -> tuple[str, ...]:
        """Image files."""

    @property
    def points(self) -> PointFiles:
        """Where points come from."""

    @property
    def output(self) -> BlockOutput:
        """What is written, and where."""
