"""Decisions on a folder: inputs of a project, height datums, steps that apply, and the question to the user.

DatumEvidence decides where it can, and each decision has its reason. What remains is one question at most.
"""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import GroundPoints
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.io.rasters.dems import fill_gaps, open_geoid, read_geoid_heights
from ...hrsi_engine.plausibility.places import compute_coverage
from ...hrsi_engine.surface.dem import surface_heights
from .folder_files import FileRole, FolderContent, HeightRaster
from .height_evidence import (
    DatumEvidence,
    RayHeights,
    find_installed_geoid,
    intersect_tracks,
    measure_rays,
    weigh_hypotheses,
)
from .point_sources import PointRoles, PointSource, decide_roles
from .project_file import ASK

LAYER, ELLIPSOIDAL = "layer", "ellipsoidal"


@thresholds
class UNDERSTANDING:
    """Limits for the choice of a DEM."""

    dem_share: float = threshold(0.5, "", "smallest share of the images' ground that a DEM must cover to be used")
    flat_geoid_m: float = threshold(2.0, "m", "undulation below which ellipsoidal and geoid heights are taken as equal")


@dataclass
class Understanding:
    """What was understood of a folder.

    shared : options of all steps; steps : options of the steps that run; left_out : reasons of the others, by step
    decisions : for the user, one line each; question : what only the user can answer, or empty
    """

    content: FolderContent
    shared: dict[str, Any] = field(default_factory=dict)
    steps: dict[str, dict[str, Any]] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    decisions: list[str] = field(default_factory=list)
    question: str = ""

    @property
    def roles(self) -> list[FileRole]:
        """Roles of all files."""
        return self.content.roles


def understand(content: FolderContent, height_datum: str | None = None) -> Understanding:
    """Return the decisions on the content of a folder; ``height_datum`` is the user's answer to the question."""
    if height_datum not in (None, ELLIPSOIDAL):
        open_geoid(str(height_datum))  # an error is reported now
    made = Understanding(content)
    points = decide_roles(content.sources)
    content.roles += [FileRole(path, *role) for path, role in points.roles.items()]
    made.shared["images"] = [image.path for image in content.images]
    measured = {name for one in content.sources for name in one.measured_ids}
    surveyed = {name for one in points.control for name in one.ground_ids}
    has_control = bool(surveyed & measured)
    if surveyed and not has_control:
        made.decisions.append(
            f"{_names(points.control)}: not measured in an image: measure them in the panel HRSI Points, and name "
            "image_points"
        )
    if has_control:
        made.shared |= {key: value for key, value in points.options.items() if key != "tie_points"}
        made.decisions.append(f"{len(surveyed & measured)} of {len(surveyed)} ground points are measured in images")
    elif points.measured:
        points.ties = points.measured
    dem = _choose_dem(made, needed=has_control and not all(one.has_heights for one in points.control))
    _decide_datums(made, points if has_control else PointRoles(ties=points.ties), dem, height_datum)
    _choose_steps(made, points, dem, has_control)
    return made


def _names(sources: Iterable[PointSource]) -> str:
    return ", ".join(dict.fromkeys(one.name for one in sources))


def _choose_dem(made: Understanding, needed: bool) -> HeightRaster | None:
    """Return the raster of heights that covers most of the images' ground; None if none covers enough."""
    images = made.content.images
    for one in made.content.heights:
        surface = fill_gaps(one.surface, one.gap_cells) if one.gap_cells else one.surface
        one.share = float(np.mean([compute_coverage(image, surface) for image in images]))
    least = UNDERSTANDING.dem_share
    ranked = sorted(made.content.heights, key=lambda one: (one.share >= least, not one.is_dsm, one.share))
    dem = ranked.pop() if ranked else None
    for one in ranked:
        made.decisions.append(f"{os.path.basename(one.path)}: not used, {os.path.basename(dem.path)} is")  # type: ignore[union-attr]
    if dem is None:
        return None
    told = f"{os.path.basename(dem.path)}: covers {dem.share:.0%} of the images' ground"
    if dem.share < least and not needed and len(images) > 1:
        made.decisions.append(f"{told}: not used, orthoimages take the heights of the adjusted points")
        return None
    if dem.nodata is not None:
        told += f"; the value {dem.nodata:g} is no height and not declared: read as nodata"
    if dem.gap_cells:
        told += f"; gaps up to {dem.gap_cells} cells are interpolated (fill_gaps)"
    made.decisions.append(told)
    return dem


# ---- height datums ---------------------------------------------------------------------------------------------------


def _decide_datums(made: Understanding, points: PointRoles, dem: HeightRaster | None, answer: str | None) -> None:
    """Set `height_datum` and `dem_datum`, by what states them, by evidence, or by the question."""
    open_points = [one for one in points.control if one.datum is None and one.has_heights]
    stated = [one.datum for one in points.control if one.datum]
    of_points = answer if open_points else stated[0] if stated else LAYER
    of_dem = None if dem is None else dem.datum or (LAYER if dem.datum == "" else answer)
    if dem is not None and dem.datum:
        made.decisions.append(f"{os.path.basename(dem.path)}: heights {dem.datum}, by its name")
    if of_points is None or (dem is not None and of_dem is None):
        of_points, of_dem, told = _weigh_evidence(made, points, open_points, dem, of_points, of_dem)
        made.decisions += told
    unknown = [] if of_points is not None else [_names(open_points)]
    unknown += [os.path.basename(dem.path)] if dem is not None and of_dem is None else []
    if unknown:
        keys = [key for key, value in (("height_datum", of_points), ("dem_datum", of_dem)) if value is None]
        keys = keys[:1] if dem is None or len(unknown) > 1 else keys
        made.question = (
            f"Do the heights of {' and '.join(unknown)} refer to the ellipsoid or to the geoid (sea level)? Set "
            f'{" and ".join(keys)} = "ellipsoidal" or "egm2008" in the project file, or give `height_datum`'
        )
    if points.control:
        made.shared["height_datum"] = of_points or ASK
    if dem is not None:
        made.shared["dem"] = dem.path
        made.shared["dem_datum"] = of_dem or (ASK if of_points else made.shared["height_datum"])


def _weigh_evidence(
    made: Understanding, points: PointRoles, open_points: Sequence[PointSource], dem: HeightRaster | None,
    of_points: str | None, of_dem: str | None,
) -> tuple[str | None, str | None, list[str]]:  # fmt: skip
    """Return the datums of points and DEM by evidence, None if it does not decide, and the reasons."""
    told = list[str]()
    images = made.content.images
    middle = images[0].rpc.localize(images[0].centre_px[None], images[0].middle_height_m).ground
    geoid = find_installed_geoid(middle)
    if geoid is not None and abs(float(geoid[1][0])) < UNDERSTANDING.flat_geoid_m:
        told.append(f"the geoid is {geoid[1][0]:+.1f} m from the ellipsoid here: heights without datum taken above it")
        return of_points or geoid[0], of_dem or (geoid[0] if dem else None), told
    ground = [one.ground for one in (open_points or points.control) if one.ground is not None and one.has_heights]
    surveyed = np.concatenate([one.ground for one in ground]) if ground else np.empty((0, 3))
    file = os.path.basename(dem.path) if dem is not None else ""
    if dem is not None and len(surveyed):
        of_cells = surface_heights(dem.surface, surveyed[:, :2])
        if of_points is None and of_dem is not None:
            cells = of_cells + _geoid_offset(surveyed, of_dem)
            found = weigh_hypotheses(surveyed[:, :2], cells, surveyed[:, 2], 0.0, f"{file}: heights")
            told += _tell(found, _names(open_points))
            of_points = found.datum
        elif of_points is not None and of_dem is None:
            heights = surveyed[:, 2] + _geoid_offset(surveyed, of_points)
            found = weigh_hypotheses(surveyed[:, :2], heights, of_cells, 0.0, f"{_names(points.control)}: heights")
            told += _tell(found, file)
            of_dem = found.datum
        else:
            of_points, of_dem = _compare_both(surveyed, of_cells, geoid)
            if of_points is not None:
                told.append(f"{_names(open_points)}: {of_points}, {file}: {of_dem}, by their difference")
    if of_points is None or (dem is not None and of_dem is None):
        height = float(np.median(surveyed[:, 2])) if len(surveyed) else images[0].middle_height_m
        if dem is not None and not len(surveyed):
            lonlat = images[0].rpc.localize(images[0].grid_px(9, 9), images[0].middle_height_m).ground[:, :2]
            height = float(np.nanmedian(np.append(surface_heights(dem.surface, lonlat), height)))
        tables = [table for one in made.content.sources for table in one.measured]
        rays = intersect_tracks(images, tables, height) if tables else None
        rays = measure_rays(images, height) if rays is None else rays
        if rays is not None:
            return _weigh_rays(rays, open_points, ground, dem, of_points, of_dem, told)
    return of_points, of_dem, told


def _weigh_rays(
    rays: RayHeights, open_points: Sequence[PointSource], ground: Sequence[GroundPoints], dem: HeightRaster | None,
    of_points: str | None, of_dem: str | None, told: list[str],
) -> tuple[str | None, str | None, list[str]]:  # fmt: skip
    """Return the datums by heights of rays, with the reasons."""
    what = "heights of rays"
    if of_points is None:
        heights = {str(name): xyz[2] for one in ground for name, xyz in zip(one.ids, one.ground, strict=True)}
        given = np.array([heights.get(name, np.nan) for name in rays.ids])
        found = weigh_hypotheses(rays.lonlat, rays.height_m, given, rays.sigma_m, what)
        told += _tell(found, _names(open_points))
        of_points = found.datum
    if dem is not None and of_dem is None:
        cells = surface_heights(dem.surface, rays.lonlat)
        found = weigh_hypotheses(rays.lonlat, rays.height_m, cells, rays.sigma_m, what)
        told += _tell(found, os.path.basename(dem.path))
        of_dem = found.datum
        of_points = of_points or (found.datum if open_points else None)
    return of_points, of_dem, told


def _tell(found: DatumEvidence, file: str) -> list[str]:
    return [f"{file}: heights {found.datum or 'undecided'}: {found.reason}"] if found.reason else []


def _geoid_offset(ground: np.ndarray, datum: str) -> np.ndarray:
    return np.zeros(len(ground)) if datum in (LAYER, ELLIPSOIDAL) else read_geoid_heights(ground, open_geoid(datum))


def _compare_both(
    surveyed: np.ndarray, of_cells: np.ndarray, geoid: tuple[str, np.ndarray] | None
) -> tuple[str | None, str | None]:
    """Return the datums of points and DEM, of which neither is known, if they differ by the undulation."""
    difference = float(np.nanmedian(surveyed[:, 2] - of_cells)) if np.isfinite(of_cells).any() else np.nan
    if geoid is None or not np.isfinite(difference):
        return None, None
    undulation = float(geoid[1][0])
    if abs(difference - undulation) < abs(undulation) / 4.0:
        return ELLIPSOIDAL, geoid[0]
    if abs(difference + undulation) < abs(undulation) / 4.0:
        return geoid[0], ELLIPSOIDAL
    return None, None


# ---- steps -----------------------------------------------------------------------------------------------------------


def _choose_steps(made: Understanding, points: PointRoles, dem: HeightRaster | None, has_control: bool) -> None:
    """Set the options of the steps that apply to the images, and the reasons of those that do not."""
    images, content = made.content.images, made.content
    pixels = [image for image in images if image.raster is not None]
    triangulate: dict[str, Any] = {}
    if points.ties:
        triangulate["tie_points"] = [spec for one in points.ties for spec in one.specs]
    elif len(pixels) < len(images) and len(images) > 1:
        triangulate["tie_points"] = "none"
    has_ties = len(images) > 1 and triangulate.get("tie_points") != "none"
    if len(images) > 1 and has_ties:
        if content.laser:
            triangulate["laser"] = content.laser[0]
        if content.clouds and not has_control:
            triangulate["surface"] = content.clouds[0]
        if content.references and dem is not None and not has_control:
            triangulate["reference"] = content.references[0]
        elif content.references:
            why = "GCPs are given" if has_control else "matching with it needs a DEM"
            made.decisions.append(f"{os.path.basename(content.references[0])}: not used, {why}")
    steps, left_out = made.steps, made.left_out
    if has_control or has_ties:
        steps["triangulate"] = triangulate
    else:
        left_out["triangulate"] = (
            "one image without measured GCPs: its RPC is used as delivered" if len(images) == 1 else
            "RPC files without pixels, and no tie points or measured GCPs"
        )  # fmt: skip
    if not pixels:
        left_out["orthorectify"] = "RPC files without pixels"
    else:
        steps["orthorectify"] = {"fill_gaps": dem.gap_cells} if dem is not None and dem.gap_cells else {}
        if dem is None and not has_ties:
            ground = [one.ground.ground[:, 2] for one in points.control if one.ground is not None and has_control]
            height = float(np.median(np.concatenate(ground) if ground else [one.middle_height_m for one in images]))
            steps["orthorectify"]["height"] = round(height, 1)
            made.decisions.append(f"no DEM: orthoimages are made at the height {height:.1f} m")
    if "orthorectify" in steps and len(pixels) > 1:
        steps["ortho-check"] = {}
    else:
        left_out["ortho-check"] = "fewer than two orthoimages"
    if "triangulate" not in steps:
        left_out["evaluate"] = "no RPC is refined"
    else:
        tracks = {} if len(pixels) > 1 and not points.ties else {"tracks": triangulate.get("tie_points", "none")}
        steps["evaluate"] = {"tracks": "none"} if len(images) == 1 else tracks
    if not steps:
        reason = next(iter(left_out.values()))
        raise InputError(
            f"{content.folder}: no step can run ({reason}): add images, tie points, or GCPs with their measurements"
        )
