"""Heights and surfaces against the block.

Laser points and DEM are compared with each other, the GCPs, and the ground in the images; the position of the block by
the relief of a surface with the a priori accuracy of its RPCs.
"""

from collections.abc import Iterator

import numpy as np

from ...adjustment.external.laser_heights import MISFIT
from ...adjustment.source_results import HeightAgreement, SourceGroup
from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import EQUALITY, GROUND, SAMPLES
from .evidence import Evidence


def find_conflicting_heights(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for laser points or a DEM that contradict one another, or the GCPs, in the block's height.

    GCPs that agree decide, and so do most parts of a DEM; otherwise it is ambiguous which height is correct.
    """
    le90_m = max((part.le90_m for part in evidence.result.parts if part.le90_m is not None), default=np.inf)
    for one in evidence.result.heights:
        off, compared = one.gcps
        # Groups whose offset exceeds its full standard deviation: with the error common to the whole source. Trees and
        # buildings are a known error of surface models: parts that were left out because they are higher are no
        # contradiction, unless they are most of the DEM
        beyond = [
            group
            for group in one.groups
            if group.wrong and abs(group.offset_m) > ROBUST.outlier * _compute_full_sigma_m(one, group)
        ]
        higher = [group for group in beyond if group.left_out and 0.0 < group.offset_m < GROUND.margin_m]
        covered = sum(group.observations for group in higher)
        is_wooded = one.source == "DEM" and covered <= EQUALITY.majority * one.observations
        contradicting = [group for group in beyond if group not in higher] if is_wooded else beyond
        undecided = any(not group.left_out for group in contradicting)
        contradicting = [group for group in contradicting if not (undecided and group.left_out)]
        middle = float(np.median([group.offset_m for group in contradicting])) if contradicting else 0.0
        share = sum(group.observations for group in contradicting) / max(one.observations, 1)
        outvoted = off > EQUALITY.majority * compared and one.left_out < one.observations
        if not (undecided or outvoted or share > EQUALITY.negligible):
            continue
        open_between = undecided or (not compared and share > EQUALITY.majority)
        if outvoted:
            what = f"its heights contradict those of {off} of {compared} GCPs, and outweigh them in the adjustment"
        else:
            who = (
                "all of its heights"
                if len(contradicting) == len(one.groups)
                else f"the heights of {list_ids(group.name for group in contradicting)}"
            )
            done = "were used, because the wrong ones cannot be identified" if undecided else "were not used"
            what = f"{who} differ by {middle:+.1f} m (median) from the other height observations of the block"
            what += f" (sigma {_compute_full_sigma_m(one, contradicting[0]):.1f} m); they {done}"
        unusable = outvoted or (open_between and abs(middle) > 2.0 * le90_m)
        yield Reason(
            "sources-disagree",
            Level.UNUSABLE if unusable else Level.DOUBTFUL,
            f"{one.source}: {what}",
            "check the height datum of laser points, DEM and GCPs: heights above a geoid and above the ellipsoid "
            "differ by tens of metres; a DEM with contradicting parts may be a mosaic with steps",
        )


def _compute_full_sigma_m(source: HeightAgreement, group: SourceGroup) -> float:
    """Return the standard deviation of a group's offset, with the stated one of its source, in metres."""
    return float(np.hypot(group.sigma_m, source.sigma_m / source.sigma_factor))


def find_heights_off_rpcs(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for heights that move the block by more than the errors of its RPCs explain."""
    result = evidence.result
    sigma_m = result.rpcs_height_sigma_m
    if not result.heights or result.rpcs_alone_m is None or sigma_m is None:
        return
    away_m = -result.rpcs_alone_m[2]
    if abs(away_m) > ROBUST.outlier * sigma_m:
        held = [one.source for one in result.heights if one.left_out < one.observations]
        yield Reason(
            "sources-disagree",
            Level.DOUBTFUL,
            f"the heights of {' and '.join(held)} move the block by {away_m:+.1f} m from its height by the RPCs "
            f"alone, {abs(away_m) / sigma_m:.0f} times the standard deviation of that height",
            "check unit and datum of these heights (`laser_datum`, `dem_datum`): heights above a geoid and above "
            "the ellipsoid differ by tens of metres",
        )


def find_height_scatter(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for heights whose scatter about the ground is much larger than their standard deviations."""
    for one in evidence.result.heights:
        if one.sigma_factor > ROBUST.outlier and not one.contradicts:
            yield Reason(
                "sources-disagree",
                Level.DOUBTFUL,
                f"{one.source}: the RMS difference of its heights from the ground in the images is {one.rmse_m:.0f} "
                f"m, {one.sigma_factor:.0f} times the given standard deviation",
                "check position, column and unit of these heights, or give a realistic sigma",
            )


def find_laser_canopy(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for laser points rejected because they are lower: the used ones may be canopy."""
    laser = evidence.result.laser
    if laser is None:
        return
    fits = laser.reason == ""
    low = (laser.reason == MISFIT) & (laser.residual_m < -GROUND.canopy_m)
    if low.sum() < max(SAMPLES.fewest, EQUALITY.negligible * (fits.sum() + (laser.reason == MISFIT).sum())):
        return
    yield Reason(
        "sources-disagree",
        Level.DOUBTFUL,
        f"{low.sum()} laser points are {-np.median(laser.residual_m[low]):.1f} m (median) lower than the "
        f"{fits.sum()} used ones, which may be canopy or roofs",
        "use ground heights (terrain heights of ATL08, a SlideRule fit without canopy), give the canopy height in "
        "a field `canopy_m`, or name a DEM",
    )


def find_unused_laser(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for a file of laser points of which none, or too few to control one another, are used."""
    found = evidence.result.laser
    if found is None:
        return
    used, number = int((found.reason == "").sum()), len(found.reason)
    enough = min(SAMPLES.fewest, EQUALITY.negligible * number)
    if used and (used >= enough or any(part.gcps for part in evidence.result.parts)):
        return
    reasons, count = np.unique(found.reason[found.reason != ""], return_counts=True)
    most = ", ".join(f"{count[k]} {reasons[k]}" for k in np.argsort(-count)[:3].tolist())
    yield Reason(
        "laser-few",
        Level.DOUBTFUL,
        f"{f'only {used}' if used else 'none'} of the {number} laser points can be used for the height of the block: "
        f"{most}",
        "the layer laser_points lists the reason for each; check coordinates and datum of the file, or name a file "
        "with more passes over the images",
    )


def find_surface_reasons(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for parts that the relief displaces by more than the pointing error of their RPCs explains.

    A relief that does not determine a part in plan is a reason of level OK, if nothing else does.
    """
    result = evidence.result
    has_control = result.plan is not None or any(part.gcps for part in result.parts)
    for one in result.surfaces:
        east, north, up = one.match.displacement_m.tolist()
        if one.open and not has_control:
            yield Reason(
                "not-determined",
                Level.OK,
                f"the relief of the surface does not determine {list_ids(one.images)} in plan: {one.open}",
                "the position in plan follows from the RPCs alone, with the stated CE90: add GCPs or a reference "
                "orthoimage",
                images=one.images,
            )
        elif not one.open and one.beyond_pointing > ROBUST.outlier:
            yield Reason(
                "surface-offset",
                Level.DOUBTFUL,
                f"matching with the relief of the surface shifts {list_ids(one.images)} by "
                f"{np.hypot(east, north):.1f} m in plan ({east:+.1f} m east, {north:+.1f} m north, {up:+.1f} m up), "
                f"{one.beyond_pointing:.1f} times the standard deviation (of the RPCs: {one.pointing_m:.1f} m per "
                "coordinate)",
                "check the georeference and height datum of the surface with one or two surveyed points",
                images=one.images,
            )
