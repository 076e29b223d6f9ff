"""Real and published blocks: functions that return a `hrsi_engine` Block, and what is measured on them.

`block_tables` prints the figures. The data lie in HRSI_TEST_DATA (see CONTRIBUTING.md). `real_blocks.py [--blocks NAME
…] [--docs]` adjusts them with a tenth of their tie tracks held out, and tabulates how well these fit.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hrsi.benchmarks.pages import DATA, DOCS, make_parser, render, write_sections
from hrsi.hrsi_engine import AdjustOptions, adjust, check_block, find_tie_points, judge, open_image
from hrsi.hrsi_engine.adjustment import Adjustment
from hrsi.hrsi_engine.adjustment.hold_out import hold_out_ties
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints, Role
from hrsi.hrsi_engine.block.default_sigmas import DefaultSigmas
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.results.figures import summarise_held_out

TEN = tuple(["H003", "H022", "H024", "H035", "H048", "H058", "H077", "H098", "H103", "H105"])
ZY3_CONTROL = ("1", "2", "11", "21", "26", "31", "41")


# ---- blocks --------------------------------------------------------------------------------------------------------


def hobart(gcp_ids: Sequence[str] = TEN, defaults: DefaultSigmas | None = None) -> Block:
    """Return the IKONOS triplet of Hobart; all points that are not GCPs are check points."""
    folder = DATA / "thesis"
    images = [open_image(str(folder / f"hobart_ikonos_{k}_RPC.TXT")) for k in (1, 2, 3)]
    ground = read_points(str(folder / "hobart_ground_points.csv"), height_datum="ellipsoidal").ground
    ids = [image.id for image in images]
    measured = read_points(str(folder / "hobart_image_points.csv"), image_ids=ids).image
    return assemble(images, [ground], [measured], gcp_ids, defaults=defaults)


def zy3(control: Sequence[str] = ZY3_CONTROL, ties: bool = False) -> Block:
    """Return the ZY-3 stereo pair: 42 surveyed points on both images; those that are not control are check points."""
    folder = DATA / "real" / "zy3_stereo_gcp"
    images = [open_image(str(folder / f"zy301a_{view}_381_6138_rpc.txt")) for view in ("fwd", "bwd")]
    point = np.loadtxt(folder / "image_points_fwd_bwd.txt", skiprows=1, dtype=str)
    ground = np.loadtxt(folder / "ground_points_all42.txt", skiprows=1, dtype=str)
    xy = point[:, 1:].astype(float)
    measured = [
        ImagePoints(point[:, 0], [image.id] * len(point), xy[:, columns])
        for image, columns in zip(images, ([1, 0], [3, 2]), strict=True)
    ]
    role = np.where(np.isin(ground[:, 0], control), Role.GCP, Role.CHECK)
    survey = GroundPoints(ground[:, 0], ground[:, [2, 1, 3]].astype(float), role)
    return assemble(images, [survey], measured)


def quickbird() -> Block:
    """Return the QuickBird-2 image with five GCPs."""
    folder = DATA / "real" / "qb2_gcp"
    image = open_image(str(folder / "qb2_basic1b.tif"))
    tables = read_points(str(folder / "gcps.geojson"), image_ids=[image.id])
    return assemble([image], [tables.ground], [tables.image])


def spot7() -> Block:
    """Return the SPOT 7 pair with 115 109 tie points of MicMac."""
    folder = DATA / "real" / "spot7_tiepoints"
    images = [open_image(str(folder / f"RPC_1{k}.xml")) for k in "AB"]
    ids = [image.id for image in images]
    measured = [
        read_points(f"{folder / f'PMUL-SPOT_1{k}.tif.csv'}|image={image.id}", image_ids=ids).image
        for image, k in zip(images, "AB", strict=True)
    ]
    return assemble(images, [], measured)


def triplet() -> Block:
    """Return the Pleiades triplet of s2p with tracks of OpenCV's SIFT, found without the project's own matcher."""
    folder = DATA / "real" / "s2p_triplet_phr"
    images = [open_image(str(folder / f"img_0{k}.tif")) for k in (1, 2, 3)]
    return assemble(images, [], sift_tracks(images))


def sift_tracks(images: Sequence) -> list[ImagePoints]:
    """Return tracks: 8000 keypoints an image, ratio 0.75, mutual, MAGSAC for each pair; no RPC is used."""
    features = [describe_sift(image, 8000) for image in images]
    edges = [
        ((i, a), (j, b))
        for i, j in itertools.combinations(range(len(images)), 2)
        for a, b in match_sift(features[i], features[j]).tolist()
    ]
    tracks = _tracks(edges)
    ids = [f"T{number:06d}" for number, track in enumerate(tracks) for _ in track]
    flat = [node for track in tracks for node in track]
    xy = np.array([features[i][0][k] for i, k in flat])
    return [ImagePoints(ids, [images[i].id for i, _ in flat], xy)]


def describe_sift(image: Image, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and descriptors of OpenCV's SIFT on an image stretched between its percentiles 1 and 99."""
    import cv2

    grey = image.raster.read(0, 0, *image.size)[0].astype(np.float64)
    low, high = np.percentile(grey, (1, 99))
    eight_bit = np.clip((grey - low) / (high - low) * 255.0, 0, 255).astype(np.uint8)
    keypoints, descriptors = cv2.SIFT_create(count, contrastThreshold=0.01).detectAndCompute(eight_bit, None)
    return np.array([k.pt for k in keypoints[:count]]), descriptors[:count]


def match_sift(first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return index pairs (n, 2) of what `describe_sift` found: ratio 0.75 and mutual, MAGSAC with 1 px."""
    import cv2

    matcher = cv2.BFMatcher(cv2.NORM_L2)
    best = [
        {m.queryIdx: m.trainIdx for m, n in matcher.knnMatch(one[1], other[1], k=2) if m.distance < 0.75 * n.distance}
        for one, other in ((first, second), (second, first))
    ]
    pairs = np.array([(a, b) for a, b in best[0].items() if best[1].get(b) == a])
    _, inlier = cv2.findFundamentalMat(
        first[0][pairs[:, 0]], second[0][pairs[:, 1]], cv2.USAC_MAGSAC, 1.0, 0.9999, 10000
    )
    return pairs[inlier.ravel() > 0]


def _tracks(edges: Sequence) -> list[list[tuple[int, int]]]:
    """Return connected keypoints; a track that has two keypoints on an image is dropped."""
    parent: dict = {}

    def root(node: tuple[int, int]) -> tuple[int, int]:
        while parent.setdefault(node, node) != node:
            node = parent[node]
        return node

    for a, b in edges:
        parent[root(a)] = root(b)
    groups: dict = {}
    for node in sorted(parent):
        groups.setdefault(root(node), []).append(node)
    return [group for group in groups.values() if len({i for i, _ in group}) == len(group)]


# ---- figures -------------------------------------------------------------------------------------------------------


def check_rmse(result: Adjustment, kind: str | None = None, of: np.ndarray | None = None) -> np.ndarray:
    """Return the RMSE east, north, height (m) of the check points seen on two images, all, of one kind or a mask's."""
    block = result.block
    chosen = (block.points.role == Role.CHECK) & (block.rays_per_point() > 1)
    if of is not None:
        chosen &= of
    if kind is not None:
        of_kind = np.zeros(len(block.points), dtype=bool)
        of_kind[block.measurements.point[block.measurements.kind == kind]] = True
        chosen &= of_kind
    return np.sqrt(np.mean(ground_difference_m(block.points.ground[chosen], result.ground[chosen]) ** 2, axis=0))


def tie_rmse(result: Adjustment, rays: int | None = None) -> float:
    """Return sqrt(mean(dx² + dy²)) over the tie measurements that took part."""
    block = result.block
    rows = (block.points.role == Role.TIE)[block.measurements.point] & np.isfinite(result.residual_px[:, 0])
    if rays is not None:
        rows &= (np.bincount(block.measurements.point[rows], minlength=len(block.points)) == rays)[
            block.measurements.point
        ]
    return float(np.sqrt(np.mean(np.sum(result.residual_px[rows] ** 2, axis=1))))


def moved_gcp(block: Block, name: str, metres_east: float = 40 * 3.4) -> Block:
    """Return the block with a GCP's ground position moved east."""
    ground = block.points.ground.copy()
    row = np.flatnonzero(block.points.ids == name)
    ground[row] = move_ground(ground[row], np.array([[metres_east, 0.0, 0.0]]))
    return replace(block, points=replace(block.points, ground=ground))


def mismeasured(block: Block, name: str, images: Sequence[int], shift_px: float = 40.0) -> Block:
    """Return the block with a point's measurements on some images moved along the samples."""
    rows = block.measurements
    wrong = (rows.point == np.flatnonzero(block.points.ids == name)[0]) & np.isin(rows.image, images)
    xy = rows.xy + np.where(wrong, shift_px, 0.0)[:, None] * [1.0, 0.0]
    return replace(block, measurements=replace(rows, xy=xy))


def unmeasured(block: Block, name: str, image: int) -> Block:
    """Return the block without a point's measurement on one image."""
    rows = block.measurements
    return block.with_measurements((rows.point != np.flatnonzero(block.points.ids == name)[0]) | (rows.image != image))


def left_out(block: Block, name: str) -> Block:
    """Return the block with a GCP whose survey is not known: a tie point."""
    role = np.where(block.points.ids == name, Role.TIE, block.points.role)
    return replace(block, points=replace(block.points, role=role))


# ---- held-out ties ---------------------------------------------------------------------------------------------------

PAGE = DOCS / "protocols/held_out.md"
HELD_OUT_HEAD = [
    "block", "images", "tie points", "held out", "wrong", "RMSE px: held out", "used", "epipolar px: held out", "used",
    "verdict",
]  # fmt: skip


def matched(folder: str, names: Sequence[str]) -> Block:
    """Return a block of real images with the tie points that HRSI finds in them."""
    images = [open_image(str(DATA / "real" / folder / name)) for name in names]
    return assemble(images, [], [find_tie_points(images).image_points])


def skysat(folder: str, frames: Sequence[int] | None = None) -> Block:
    """Return SkySat frames, all or some of them, with the tie points that come with them."""
    images = [open_image(str(path)) for path in sorted((DATA / "real" / folder).glob("*.rpc"))]
    table = f"/vsigzip/{DATA / 'real' / folder / 'image_points.csv.gz'}"
    points = read_points(table, image_ids=[image.id for image in images]).image
    chosen = [images[k] for k in frames or range(len(images))]
    return assemble(chosen, [], [points.select(np.isin(points.image_ids, [image.id for image in chosen]))])


#: Blocks with more than 500 tie tracks, from files or found in the pixels.
WITH_TIES = {
    "SPOT 7 pair, MicMac's tie points": spot7,
    "SkySat, San Luis Obispo, tie points of the dataset": lambda: skysat("skysat_san_luis_obispo_mountains"),
    "SkySat, Miami University, tie points of the dataset": lambda: skysat("skysat_miami_university"),
    "Pleiades triplet, OpenCV's tie points": triplet,
    "Pleiades triplet": lambda: matched("s2p_triplet_phr", [f"img_0{k}.tif" for k in (1, 2, 3)]),
    "Ventoux, Pleiades pair": lambda: matched("ventoux_phr_pair", ("left_image.tif", "right_image.tif")),
    "Kahramanmaras, Pleiades, two dates": lambda: matched(
        "kahramanmaras_phr4", [f"{when}_event_img{k}.tif" for when in ("pre", "post") for k in (1, 2)]
    ),
}


def judge_by_held_out(name: str) -> list[str]:
    """Return the row of a block's table."""
    block = hold_out_ties(WITH_TIES[name](), 0.1)
    result = adjust(block, AdjustOptions())
    refined = [result.model.compute_refined_rpc(*pair) for pair in zip(block.images, result.values, strict=True)]
    entry = summarise_held_out(result, refined)
    ties, adjusting = entry["ties"], np.unique(block.measurements.point[result.has_residual])
    return [
        name, str(len(block.images)), str(int((block.points.role[adjusting] == Role.TIE).sum())),
        str(entry["points"]), str(entry["wrong"]),
        *(
            "-" if part[key] is None else f"{part[key]:.3f}"
            for key in ("rmse_px", "epipolar_rmse_px")
            for part in (entry, ties)
        ),
        judge(result, check_block(block)).level.label,
    ]  # fmt: skip


def main(words: Sequence[str] | None = None) -> None:
    """Print the table of held-out ties; ``--docs`` writes the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--blocks", nargs="*", default=list(WITH_TIES), help="blocks whose name begins so")
    options = parser.parse_args(words)
    rows = []
    for name in WITH_TIES:
        if any(name.startswith(asked) for asked in options.blocks):
            rows.append(judge_by_held_out(name))
            print(" | ".join(rows[-1]), flush=True)
    if options.docs:
        write_sections(PAGE, {"": render(HELD_OUT_HEAD, rows)})


if __name__ == "__main__":
    main()
