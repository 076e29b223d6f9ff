"""Decisions on a folder: inputs of a project, height datums, steps that apply, and the question to the user.

Evidence decides where it can, and each decision has its reason. What remains is one question at most.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...hrsi_engine.block.assembly import find_similar_ids
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import EQUALITY
from ...hrsi_engine.io.rasters.dems import fill_gaps, open_geoid, read_geoid_heights
from ...hrsi_engine.plausibility.places import compute_coverage
from ...hrsi_engine.surface.dem import cell_size_m, dem_sigma_m, surface_heights
from .folder_files import BROKEN_IMAGE, FileRole, FolderContent
from .height_evidence import RayHeights, find_installed_geoid, intersect_tracks, measure_rays, weigh_hypotheses
from .height_rasters import HeightRaster
from .point_sources import PointRoles, PointSource, decide_roles
from .project_file import ASK

LAYER, ELLIPSOIDAL = "layer", "ellipsoidal"


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

    def list_map(self) -> dict[str, Any]:
        """Return what a map of the block shows before it is adjusted: images, ground points by file, and the DEM."""
        surveyed = [(one.name, one.ground) for one in self.content.sources if one.ground is not None]
        return {
            "images": [image.path for image in self.content.images],
            "points": {
                "id": [str(name) for _, ground in surveyed for name in ground.ids],
                "file": [name for name, ground in surveyed for _ in range(len(ground))],
                "position": [row for _, ground in surveyed for row in ground.ground.tolist()],
            },
            "dems": [path for one in self.content.heights if one.path == self.shared.get("dem") for path in one.paths],
        }


def understand(content: FolderContent, height_datum: str | None = None) -> Understanding:
    """Return the decisions on the content of a folder; ``height_datum`` is the user's answer to the question."""
    if height_datum not in (None, ELLIPSOIDAL):
        open_geoid(str(height_datum))  # an error is reported now
    points = decide_roles(content.sources)
    content.roles += [FileRole(path, *role) for path, role in points.roles.items()]
    broken = [one for one in content.roles if one.role == BROKEN_IMAGE]
    told = [*points.notes, *(f"{os.path.basename(one.path)}: image, not used: {one.reason}" for one in broken)]
    made = Understanding(content, {"images": [image.path for image in content.images]}, decisions=told)
    measured = {name for one in content.sources for name in one.measured_ids}
    surveyed = {name for one in points.control for name in one.ground_ids}
    has_control = bool(surveyed & measured)
    has_faults = any(one.fault for one in content.sources)  # which a run reports, as it does other ids
    if surveyed and not has_control and not has_faults:
        alike = find_similar_ids(sorted(surveyed), sorted(measured))
        similar = [f"{name!r} is {names[0]!r}" for name, names in alike.items()]
        made.decisions.append(
            f"{_names(points.control)}: not measured in an image: "
            + (
                f"the ids have another spelling there ({', '.join(similar[:3])}): use the same ids in both files"
                if similar
                else "measure them in the panel HRSI Points, and name image_points"
            )
        )
    if has_control or has_faults or (points.ties and all(one.has_heights for one in points.control)):
        made.shared |= {key: value for key, value in points.options.items() if key != "tie_points"}
    if has_control:
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
    least = EQUALITY.majority
    if not made.content.heights:
        return None
    *others, dem = sorted(made.content.heights, key=lambda one: (one.share >= least, not one.is_dsm, one.share))
    made.decisions += [f"{one.name}: not used, {dem.name} is" for one in others]
    told = f"{dem.name}: covers {dem.share:.0%} of the images' ground"
    if dem.share < least and not needed and len(images) > 1:
        made.decisions.append(f"{told}: not used, orthoimages take the heights of the adjusted points")
        return None
    if dem.facts.nodata is not None:
        told += f"; the value {dem.facts.nodata:g} is no height and not declared: read as nodata"
    if dem.gap_cells:
        told += f"; gaps up to {dem.gap_cells} cells are interpolated (fill_gaps)"
    made.decisions.append(told)
    return dem


# ---- height datums ---------------------------------------------------------------------------------------------------


def _decide_datums(made: Understanding, points: PointRoles, dem: HeightRaster | None, answer: str | None) -> None:
    """Set `height_datum` and `dem_datum`, by what states them, by evidence, or by the question."""
    made.decisions += [
        f"{one.name}: heights {one.datum}, by the names of file and columns" for one in points.control if one.datum
    ]
    open_points = [one for one in points.control if one.datum is None and one.has_heights]
    stated = [one.datum for one in points.control if one.datum]
    datums = {"height_datum": answer if open_points else stated[0] if stated else LAYER}
    names = {"height_datum": _names(open_points or points.control)}
    if dem is not None:
        datums["dem_datum"] = dem.datum or (LAYER if dem.datum == "" else answer)
        names["dem_datum"] = dem.name
        if dem.datum:
            made.decisions.append(f"{names['dem_datum']}: heights {dem.datum}, by its name")
    if None in datums.values():
        _weigh_evidence(made, [one for one in open_points or points.control if one.has_heights], dem, datums, names)
    unknown = [key for key, datum in datums.items() if datum is None]
    if unknown:
        made.question = (
            f"Do the heights of {' and '.join(names[key] for key in unknown)} refer to the ellipsoid or to the geoid "
            f'(sea level)? Set {" and ".join(unknown)} = "ellipsoidal" or "egm2008" in the project file, or give '
            "`height_datum`"
        )
    if points.control:
        made.shared["height_datum"] = datums["height_datum"] or ASK
    if dem is not None:
        made.shared |= {"dem": dem.path, "dem_datum": datums["dem_datum"] or ASK}


def _weigh_evidence(
    made: Understanding,
    surveys: Sequence[PointSource],
    dem: HeightRaster | None,
    datums: dict[str, str | None],
    names: Mapping[str, str],
) -> None:
    """Replace unknown datums by evidence: heights of points and DEM against each other, then both against rays."""
    surveyed = np.concatenate([np.empty((0, 3)), *(one.ground.ground for one in surveys if one.ground is not None)])
    ids = [str(name) for one in surveys if one.ground is not None for name in one.ground.ids]

    def weigh(key: str, *heights: Any) -> None:
        found = weigh_hypotheses(*heights)
        datums[key] = found.datum
        if found.reason:
            made.decisions.append(f"{names[key]}: heights {found.datum or 'of unknown datum'}: {found.reason}")

    def compare() -> None:
        known, unknown = sorted(datums, key=lambda key: datums[key] is None)[:2] if dem is not None else ("", "")
        if dem is None or not len(surveyed) or datums[unknown] is not None:
            return
        heights = {"height_datum": surveyed[:, 2], "dem_datum": surface_heights(dem.surface, surveyed[:, :2])}
        if (datum := datums[known]) is not None:
            if datum not in (LAYER, ELLIPSOIDAL):
                heights[known] = heights[known] + read_geoid_heights(surveyed, open_geoid(datum))
            weigh(unknown, surveyed[:, :2], heights[known], heights[unknown], 0.0, f"heights of {names[known]}")
        elif geoid := find_installed_geoid(surveyed):  # a difference of the undulation shows both
            share = float(np.nanmedian((heights["height_datum"] - heights["dem_datum"]) / geoid[1]))
            if abs(abs(share) - 1.0) < EQUALITY.size - 1.0:
                datums.update(zip(names, (ELLIPSOIDAL, geoid[0])[:: 1 if share > 0.0 else -1], strict=True))
                made.decisions.append(
                    " and ".join(f"{names[key]}: heights {datums[key]}" for key in names)
                    + ", by their difference, the undulation"
                )

    compare()
    rays = _find_rays(made, surveyed, dem) if None in datums.values() else None
    if rays is not None:
        surveyed_m = dict(zip(ids, surveyed[:, 2].tolist(), strict=True))
        heights = {"height_datum": np.array([surveyed_m.get(name, np.nan) for name in rays.ids])}
        if dem is not None:
            heights["dem_datum"] = surface_heights(dem.surface, rays.lonlat)
        for key in [key for key, datum in datums.items() if datum is None]:
            weigh(key, rays.lonlat, rays.height_m, heights[key], rays.sigma_m, "heights of rays")
        compare()


def _find_rays(made: Understanding, surveyed: np.ndarray, dem: HeightRaster | None) -> RayHeights | None:
    """Return heights of rays about those of the points or the DEM: of measured points, else of pixels."""
    images = made.content.images
    around = surveyed[:, 2]
    if dem is not None and not len(surveyed):
        around = surface_heights(
            dem.surface, images[0].rpc.localize(images[0].grid_px(9, 9), images[0].middle_height_m).ground[:, :2]
        )
    height = float(np.nanmedian(around)) if np.isfinite(around).any() else images[0].middle_height_m
    tables = [table for one in made.content.sources for table in one.measured]
    return intersect_tracks(images, tables, height) or measure_rays(images, height)


# ---- steps -----------------------------------------------------------------------------------------------------------


def _choose_other_control(made: Understanding, dem: HeightRaster | None, has_control: bool) -> dict[str, Any]:
    """Return the options for laser points and, without GCPs, for a point cloud, a reference or the heights of a DEM."""
    content, chosen = made.content, dict[str, Any]()
    if content.laser:
        chosen["laser"] = content.laser[0]
    if content.clouds and not has_control:
        chosen["surface"] = content.clouds[0]
    if content.references and dem is not None and not has_control:
        chosen["reference"] = content.references[0]
    elif content.references:
        why = "GCPs are given" if has_control else "matching with it needs a DEM"
        made.decisions.append(f"{os.path.basename(content.references[0])}: not used, {why}")
    if dem is not None and not has_control and not chosen:
        first = content.images[0]
        middle = first.rpc.localize(first.centre_px[None], first.middle_height_m).ground[0]
        chosen["sigma_dem"] = round(dem_sigma_m(cell_size_m(dem.surface, middle)), 1)
        made.decisions.append(
            f"{dem.name}: gives the block its heights, as there are no GCPs; standard deviation "
            f"{chosen['sigma_dem']:g} m, by the size of its cells"
        )
    return chosen


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
    if has_ties:
        triangulate |= _choose_other_control(made, dem, has_control)
    steps, left_out = made.steps, made.left_out
    if has_control or has_ties:
        steps["triangulate"] = triangulate
    else:
        left_out["triangulate"] = (
            "one image without measured GCPs: its RPC is used as delivered"
            if len(images) == 1
            else "RPC files without pixels, and no tie points or measured GCPs"
        )
    left_out["surface-model"] = (
        "not asked for: remove this `skip` for a surface model, and orthoimages on it"
        if len(pixels) > 1
        else "fewer than two images"
    )
    if not pixels:
        left_out["orthorectify"] = "RPC files without pixels"
    else:
        steps["orthorectify"] = {"fill_gaps": dem.gap_cells} if dem is not None and dem.gap_cells else {}
        if dem is None and not has_ties:
            ground = [one.ground.ground[:, 2] for one in points.control if one.ground is not None and has_control]
            height = float(np.median(np.concatenate(ground) if ground else [one.middle_height_m for one in images]))
            steps["orthorectify"]["height"] = round(height, 1)
            made.decisions.append(f"no DEM: orthoimages are made at the height {height:.1f} m")
    if len(pixels) > 1:
        steps["ortho-check"] = {}
    else:
        left_out["ortho-check"] = "fewer than two orthoimages"
    if "triangulate" not in steps:
        left_out["evaluate"] = "no RPC is refined"
    else:
        tracks = {} if len(pixels) > 1 and not points.ties else {"tracks": triangulate.get("tie_points", "none")}
        steps["evaluate"] = {"tracks": "none"} if len(images) == 1 else tracks
    if not steps:
        raise InputError(
            f"{content.folder}: no step can run ({next(iter(left_out.values()))}): add images, tie points, or GCPs "
            "with their measurements"
        )
