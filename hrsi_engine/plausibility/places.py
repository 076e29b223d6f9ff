"""Points outside their images, rounded or copied surveys, heights outside RPC ranges, wrong DEMs, duplicate images."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from ..block.block import Block, Image
from ..block.control_visibility import CONTROL_VISIBILITY
from ..block.placement import PlacementDoubt, judge_size
from ..block.points import Role, are_apart
from ..camera.rpc import RPC
from ..foundation.errors import list_ids
from ..foundation.large_arrays import finite_rows
from ..foundation.reasons import Level, Reason
from ..foundation.thresholds import EQUALITY, GRIDS, GROUND, SIGNIFICANCE, threshold, thresholds
from ..ground.geodesy import metres_per_degree, to_ecef
from ..ground.geoids import height_difference
from ..surface.dem import (
    RAY_TRACING,
    HeightSurface,
    Status,
    cell_size_m,
    dem_sigma_m,
    intersect_surface,
    surface_heights,
)
from .accuracy import ImageAccuracy
from .control import CONTROL_FIT, GROUP
from .mistakes import FEET_M, describe_height_unit, find_undulations


@thresholds
class PLACEMENT:
    """Limits for the positions of image points, heights and a DEM relative to the images."""

    far_outside: float = threshold(0.5, "", "distance of a point outside an image, over its size, that is an error")
    bent_px: float = threshold(
        0.01,
        "px",
        "curvature of rays beyond which the order of RPC00A is tested",
        "60 vendor RPCs of 12 sensors: medians up to 0.014 px; in that order 0.05 to 200 px, 2026-11-25",
    )
    covered_share: float = threshold(0.8, "", "share of the images' ground that a DEM covers without a message")


#: Position in the order of RPC00A of each term of RPC00B.
A_TO_B = np.array([0, 1, 2, 3, 4, 5, 6, 8, 9, 10, 7, 11, 14, 17, 12, 15, 18, 13, 16, 19])
#: Image positions of the rays that are tested, in half extents from the centre of the RPC's image.
RAY_PLACES = np.array([[0.0, 0.0], [-0.8, -0.8], [0.8, -0.8], [-0.8, 0.8], [0.8, 0.8]])


@thresholds
class SURVEY:
    """Limits for rounded coordinates of surveys, and for check points that are copies of GCPs."""

    coarse_decimals: int = threshold(
        5, "decimals", "decimals of a degree without effect", "theory: 1e-5 degrees are 1.1 m"
    )
    harmful_px: float = threshold(0.5, "px", "smallest standard deviation of the rounding that is reported")
    same_target_px: float = threshold(1.5, "px", "largest distance of two measurements of one target")
    same_id_m: float = threshold(10.0, "m", "largest distance of two places of one id that are one point")


def find_points_outside(block: Block) -> list[Reason]:
    """Return reasons for images with points measured far outside them, or with most of their points outside."""
    measured = block.measurements
    reasons = []
    has_size = np.array([image.size is not None for image in block.images])
    if not has_size.any():
        return []
    middle = np.array([image.centre_px for image in block.images])[measured.image]
    half = np.array([image.half_size_px + 0.5 for image in block.images])[measured.image]
    beyond = np.abs(measured.xy - middle) - half
    is_far = (beyond > PLACEMENT.far_outside * 2.0 * half).any(axis=1) & has_size[measured.image]
    outside = (beyond > CONTROL_VISIBILITY.edge_px).any(axis=1) & has_size[measured.image]
    count = np.bincount(measured.image, minlength=len(has_size))
    mostly_outside = np.bincount(measured.image[outside], minlength=len(has_size)) > np.maximum(
        EQUALITY.majority * count, GROUP.fewest_points
    )
    is_wrong = is_far | (outside & mostly_outside[measured.image])
    for index in np.unique(measured.image[is_wrong]):
        rows = is_wrong & (measured.image == index)
        ids = tuple(np.unique(block.points.ids[measured.point[rows]]).tolist())
        image = block.images[index]
        message = (
            f"{rows.sum()} of {count[index]} points on image {image.id} lie outside its {image.size[0]} x "
            f"{image.size[1]} px, by up to {beyond[rows].max():.0f} px ({list_ids(ids)})"
        )
        advice = "check the columns sample and line, and that the points were measured on this image"
        reasons.append(Reason("outside-image", Level.DOUBTFUL, message, advice, (image.id,), ids))
    return reasons


def find_placement_reasons(block: Block) -> list[Reason]:
    """Return the reason for images without file that are not those of their RPCs, by their sizes.

    Readers of files know more (`io.rpc_files.placement`).
    """
    doubts = {image.id: judge_size(image.rpc, image.size) for image in block.images if image.size and not image.path}
    return list_placement_reasons({name: doubt for name, doubt in doubts.items() if doubt is not None})


def list_placement_reasons(doubts: Mapping[str, PlacementDoubt]) -> list[Reason]:
    """Return the reason for images whose RPC may not be that of their pixels, from the doubts by image."""
    gross = {name: doubt for name, doubt in doubts.items() if doubt.is_gross}
    if not gross:
        return []
    worst = max(gross, key=lambda name: gross[name].offset_px)
    advice = "use the RPC of these pixels: make the image again with 'crop', or write their RPC into it (write-rpc)"
    message = (
        f"image {list_ids(gross)}: {gross[worst]}"
        if len(gross) == 1
        else (f"images {list_ids(gross)} may not have the RPCs of their pixels; {worst}: {gross[worst]}")
    )
    return [Reason("rpc-placement", Level.DOUBTFUL, message, advice, tuple(gross))]


def find_reordered_rpcs(block: Block) -> list[Reason]:
    """Return the reason for RPCs whose rays are bent, but straight with the coefficients in the order of RPC00A.

    Some products were converted from that order twice.
    """
    bent: dict[str, float] = {}
    for image in block.images:
        bend_px = _compute_bend_px(image.rpc)
        if bend_px > PLACEMENT.bent_px:
            polynomials = {name: getattr(image.rpc, name) for name in ("line_num", "line_den", "samp_num", "samp_den")}
            reordered_px = [
                _compute_bend_px(replace(image.rpc, **{name: one[order] for name, one in polynomials.items()}))
                for order in (A_TO_B, np.argsort(A_TO_B))
            ]
            if min(reordered_px) < EQUALITY.negligible * bend_px:
                bent[image.id] = bend_px
    if not bent:
        return []
    message = (
        f"the RPC of image {list_ids(bent)} has its coefficients in the order of RPC00A: in the order of RPC00B rays "
        f"deviate from a straight line by {max(bent.values()):.2g} px over the height range, after reordering they are "
        "straight"
    )
    advice = "get the RPC in another format, or reorder its coefficients"
    return [Reason("rpc-order", Level.DOUBTFUL, message, advice, tuple(bent))]


def _compute_bend_px(rpc: RPC) -> float:
    """Return the distance of a ray's middle from the line between its ends, median in pixels: rays are straight."""
    xy = np.array([rpc.samp_off, rpc.line_off]) + RAY_PLACES * [rpc.samp_scale, rpc.line_scale]
    heights_m = np.repeat(rpc.height_off + rpc.height_scale * np.array([-0.9, 0.0, 0.9, 0.0]), len(xy))
    ground = rpc.localize(np.concatenate([xy, xy, xy, xy + [1.0, 0.0]]), heights_m).ground
    low, middle, high, next_column = to_ecef(ground).reshape(4, -1, 3)
    deviation = np.linalg.norm(np.cross(middle - low, high - low), axis=1) / np.linalg.norm(high - low, axis=1)
    return float(np.median(deviation / np.linalg.norm(next_column - middle, axis=1)))


def find_height_reasons(block: Block, contradicted: bool = False) -> list[Reason]:
    """Return reasons for surveyed heights outside the range of the RPCs of their images, and for heights all equal.

    contradicted : True if the images contradict the survey: equal heights make it unusable then
    """
    measured, points = block.measurements, block.points
    rows = np.flatnonzero(block.known[measured.point])
    if not len(rows):
        return []
    ranges = np.array([image.rpc.height_range for image in block.images])[measured.image[rows]]
    slack = np.full(len(ranges), GROUND.margin_m)
    height = points.ground[measured.point[rows], 2]
    wrong = _is_outside_range(height, ranges, slack)
    reasons = []
    if wrong.any():
        which = np.unique(measured.point[rows[wrong]])
        ids = tuple(points.ids[which].tolist())
        low, high = np.median(ranges[wrong], axis=0)
        images = tuple(block.images[index].id for index in np.unique(measured.image[rows[wrong]]))
        text = (
            f"the height of ground point {list_ids(ids)} ({height[wrong].min():.0f} to {height[wrong].max():.0f} m) is "
            f"outside the height range of the RPCs, {low:.0f} to {high:.0f} m"
        )
        in_feet = (
            wrong.mean() > CONTROL_FIT.agreeing_share and not _is_outside_range(height * FEET_M, ranges, slack).any()
        )
        reasons.append(
            Reason("height-unit", Level.DOUBTFUL, f"{text}; as feet they are inside", "give metres", images, ids)
            if in_feet
            else Reason(
                "height-offset",
                Level.DOUBTFUL,
                text,
                "check unit and height datum (`height_datum`) of the heights",
                images,
                ids,
            )
        )
    which = np.unique(measured.point[rows])
    heights = points.ground[which, 2]
    if len(which) >= GROUP.fewest_points and np.ptp(heights) == 0.0:
        reasons.append(
            Reason(
                "heights-alike",
                Level.UNUSABLE if contradicted else Level.DOUBTFUL,
                f"all {len(which)} ground points have the same height, {heights[0]:g} m: the heights are missing",
                "name the field with the heights, or a DEM",
                points=tuple(points.ids[which].tolist()),
            )
        )
    return reasons


def _is_outside_range(height: np.ndarray, ranges: np.ndarray, slack: np.ndarray) -> np.ndarray:
    return np.asarray((height < ranges[:, 0] - slack) | (height > ranges[:, 1] + slack))


def compute_coverage(image: Image, surface: HeightSurface) -> float:
    """Return the share of an image whose rays meet the surface: the share of pixels that an orthoimage can show."""
    xy = image.grid_px(GRIDS.fine, GRIDS.fine)
    return float(np.mean(intersect_surface(image.rpc, xy, surface).status == Status.FOUND))


def find_dem_reasons(block: Block, surface: HeightSurface) -> list[Reason]:
    """Return reasons for a DEM that does not cover the block, or whose heights differ from the surveyed heights."""
    reasons = []
    covered = np.array([compute_coverage(image, surface) for image in block.images])
    if covered.mean() < PLACEMENT.covered_share:
        ids = tuple(one.id for one, share in zip(block.images, covered, strict=True) if share < PLACEMENT.covered_share)
        message = f"the DEM covers {covered.mean():.0%} of the images' ground" + (
            f", and less than {PLACEMENT.covered_share:.0%} of {list_ids(ids)}" if len(ids) < len(covered) else ""
        )
        advice = "name a DEM of the whole block, and check its CRS"
        reasons.append(Reason("dem-coverage", Level.DOUBTFUL, message, advice, ids))
    known = block.known & finite_rows(block.points.ground)
    ground = block.points.ground[known]
    of_dem = surface_heights(surface, ground[:, :2])
    of_dem[np.abs(ground[:, 2] - of_dem) < RAY_TRACING.accuracy_m] = np.nan  # read from the DEM: no comparison
    geoid = find_undulations(ground)
    found = height_difference(ground[:, 2], of_dem, np.full(len(ground), np.nan) if geoid is None else geoid[1])
    if found is None or not found.significant:
        return reasons
    ids = tuple(block.points.ids[known].tolist())
    text = (
        f"the heights of {found.points} ground points are {abs(found.median_m):.1f} m "
        f"{'above' if found.median_m > 0.0 else 'below'} the DEM (median)"
    )
    if found.sign_of_geoid:
        low, high = ("DEM", "ground points") if found.sign_of_geoid > 0 else ("ground points", "DEM")
        argument = "dem_datum" if found.sign_of_geoid > 0 else "height_datum"
        message = (
            f"{text}, and the geoid undulation is {found.undulation_m:+.1f} m: the heights of the {low} refer to the "
            f"geoid but are used as ellipsoidal, or those of the {high} were converted twice"
        )
        advice = f"check the height datum of both (`{argument}`)"
        reasons.append(Reason("height-datum", Level.DOUBTFUL, message, advice, (), ids))
    elif abs(found.median_m) > GROUND.canopy_m + SIGNIFICANCE.gross * dem_sigma_m(cell_size_m(surface, ground[0])):
        if unit := describe_height_unit(ground[:, 2], of_dem):
            reasons.append(Reason("height-unit", Level.DOUBTFUL, text, unit, (), ids))
        else:
            advice = "check height datum (`height_datum`, `dem_datum`) and unit of both"
            reasons.append(Reason("height-offset", Level.DOUBTFUL, text, advice, (), ids))
    return reasons


def find_duplicate_images(block: Block) -> list[Reason]:
    """Return reasons for images that are one scene under two ids: equal RPCs, or equal pixels of most common points."""
    groups: dict[RPC, list[int]] = {}
    for index, image in enumerate(block.images):
        groups.setdefault(image.rpc, []).append(index)
    twins = {(a, b) for is_same in groups.values() for a, b in pairwise(is_same)}
    measured = block.measurements
    first = np.flatnonzero((measured.point[1:] == measured.point[:-1]) & (measured.image[1:] != measured.image[:-1]))
    key = measured.image[first].astype(np.int64) * len(block.images) + measured.image[first + 1]
    is_same = np.all(measured.xy[first] == measured.xy[first + 1], axis=1)
    for pair in np.unique(key[is_same]):
        rows = key == pair
        if rows.sum() >= GROUP.fewest_points and is_same[rows].mean() > 0.5:
            twins.add((int(pair) // len(block.images), int(pair) % len(block.images)))
    return [
        Reason(
            "duplicate-images",
            Level.DOUBTFUL,
            f"images {block.images[a].id} and {block.images[b].id} are the same scene: their rays are used twice and "
            "do not determine heights",
            "remove one of them",
            (block.images[a].id, block.images[b].id),
        )
        for a, b in sorted(twins)
    ]


# ---- surveyed coordinates alone --------------------------------------------------------------------------------------


def find_rounding_reasons(block: Block, accuracies: Sequence[ImageAccuracy], level: Level) -> list[Reason]:
    """Return the reason for rounded or cut coordinates whose error exceeds their sigmas and half a pixel.

    A rounding error is uniform over one step of the last decimal: its standard deviation is step / sqrt(12).
    level : level of the returned reason
    """
    points = np.unique(block.measurements.point[block.known[block.measurements.point]])
    ground = block.points.ground[points]
    if len(points) < GROUP.fewest_points or not np.isfinite(ground).all():
        return []
    per_degree_m = float(metres_per_degree(ground)[:, :2].max())
    found, advice = list[str](), list[str]()
    for name, columns, unit_m, decimals, sigmas_m, remedy in (
        ("longitude and latitude", slice(0, 2), per_degree_m, range(SURVEY.coarse_decimals + 1),
         block.points.sigma_m[points, 0], "use at least 7 decimals of a degree; without them, give a sigma_xy"),
        ("the height", slice(2, 3), 1.0, range(-2, 1), block.points.sigma_m[points, 1],
         "use heights with their decimals; without them, give a sigma_h"),
    ):  # fmt: skip
        step_m = next((unit_m * 10.0**-k for k in decimals if _have_step(ground[:, columns], 10.0**-k)), 0.0)
        sigma_m, stated_m = step_m / np.sqrt(12.0), float(np.median(np.nan_to_num(sigmas_m, posinf=np.inf)))
        if sigma_m > max(stated_m, SURVEY.harmful_px * min(accuracy.gsd_m for accuracy in accuracies)):
            found.append(
                f"{name} of all {len(points)} ground points is a multiple of {step_m:.3g} m: rounding causes an error "
                f"of {sigma_m:.2g} m (standard deviation), cutting a common one of {0.5 * step_m:.2g} m"
            )
            advice.append(f"{remedy} that includes this error")
    if not found:
        return []
    ids = tuple(block.points.ids[points].tolist())
    return [Reason("coordinates-rounded", level, "; ".join(found), "; ".join(advice), points=ids)]


def _have_step(values: np.ndarray, step: float) -> bool:
    """Return True if coordinates ``(k, c)`` differ by multiples of a step, also after a change of their datum."""
    steps = (values - values[0]) / step
    return bool((np.abs(steps - np.rint(steps)) < EQUALITY.alike).all() and np.ptp(np.rint(steps)) > 0.0)


def find_dependent_check_points(block: Block) -> list[Reason]:
    """Return the reason for check points at the positions of GCPs (on the ground or in images), which verify nothing.

    Copies of GCPs, with a little noise or surveyed again, are mostly measured at the same pixels of every image.
    """
    points = np.flatnonzero(np.bincount(block.measurements.point, minlength=len(block.points)))
    positioned = points[finite_rows(block.points.ground[points])]
    role = block.points.role[positioned]
    gcps, checks = positioned[role == Role.GCP], positioned[role == Role.CHECK]
    if not (len(gcps) and len(checks)):
        return []
    ground = block.points.ground
    _, nearest = cKDTree(to_ecef(ground[gcps])).query(to_ecef(ground[checks]))
    is_copy = ~are_apart(ground[checks], ground[gcps[nearest]])
    # True for check points at the same pixels as the nearest GCP, in every image that has both
    rows, is_alike = block.measurements, np.zeros(len(checks), dtype=bool)
    compared = np.flatnonzero(np.isin(rows.point, np.concatenate([checks, gcps])))  # without tie points, for speed
    rows_of_point: dict[int, dict[int, int]] = {}  # rows of each point, by image
    columns = compared.tolist(), rows.point[compared].tolist(), rows.image[compared].tolist()
    for row, point, image in zip(*columns, strict=True):
        rows_of_point.setdefault(point, {})[image] = row
    for number, (one, gcp) in enumerate(zip(checks.tolist(), gcps[nearest].tolist(), strict=True)):
        check_rows, gcp_rows = rows_of_point[one], rows_of_point[gcp]
        distances = [
            float(np.hypot(*(rows.xy[check_rows[k]] - rows.xy[gcp_rows[k]])))
            for k in check_rows.keys() & gcp_rows.keys()
        ]
        is_alike[number] = bool(distances) and max(distances) < SURVEY.same_target_px
    if is_alike.mean() > EQUALITY.majority:  # a few may be next to a GCP by chance
        is_copy |= is_alike
    if not is_copy.any():
        return []
    ids = tuple(block.points.ids[checks[is_copy]].tolist())
    control = block.points.ids[gcps[nearest[is_copy]]].tolist()
    message = (
        f"{len(ids)} of {len(checks)} check points are at the positions of GCPs ({ids[0]} at {control[0]}"
        f"{', …' if len(ids) > 1 else ''}): they are no independent measure of accuracy"
    )
    advice = f"use other check points, or remove these ({list_ids(ids)})"
    return [Reason("check-is-control", Level.DOUBTFUL, message, advice, points=ids)]
