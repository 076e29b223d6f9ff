"""The flag `shadow` of dark centres on real images: does it know where the sun stood?

    python benchmarks/shadow_flags.py [--real | --docs] [--year FOLDER]

Nobody has marked the shadows of the real images. But a rule that only finds what is dark finds as much with a wrong sun
as with the right one. So the sun is turned by 90, 180 and 270 degrees: what is flagged with it turned by 180 degrees is
what chance gives, and one less its share is how many of those flagged owe it to the sun. The sun's angles follow from
time and place; the time is that of the metadata or in the name of the delivery's RPC file, and of the second image of
a pass the same one (a minute is a quarter of a degree). Then how many dark centres are found again, flagged or not,
in the view of the same date and of another one: `interest_points_real.Truth` tells it.

The real dates have like suns. So a simulated year tells whether centres are found again on dates with another sun: by
the true cameras and the DEM a dark centre must be within `NEAR_PX` of where it was; what stands up is beside it in all
cases alike. --year names a folder that `many_dates.py` made;
--real leaves the year out. --docs writes all tables into
docs/protocols/interest_points_accuracy.md.
"""

from __future__ import annotations

import argparse
import itertools
import json
import tempfile
from collections import defaultdict
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

from hrsi.benchmarks.interest_points_real import truths
from hrsi.benchmarks.many_dates import simulated, true_cameras
from hrsi.benchmarks.matching import PAIRS
from hrsi.benchmarks.pages import DOCS, put_between
from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.ground.sun import sun_at_time
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.laboratory.interest_points import DetectionOptions, detect_interest_points
from hrsi.hrsi_engine.laboratory.interest_points.shadows import compute_image_direction, find_shadows
from hrsi.hrsi_engine.measurement.interest_points import CentreOptions
from hrsi.hrsi_engine.measurement.interest_points.options import CANDIDATE_QUALITY
from hrsi.hrsi_engine.surface.dem import intersect_surface
from hrsi.tests.conftest import TEST_DATA

PAGE = DOCS / "protocols/interest_points_accuracy.md"
#: Times of acquisition, by the folder and beginning of the file's name.
TIMES = {
    ("ventoux_phr_pair", ""): datetime(2013, 8, 5, 10, 42, 19, tzinfo=UTC),  # of RPC_PHR1B_P_201308051042194_…
    ("kahramanmaras_phr4", "post"): datetime(2023, 4, 15, 8, 34, 39, tzinfo=UTC),  # IMAGING_TIME of the second
}
TURNS_DEG = (0.0, 90.0, 180.0, 270.0)
DATES, EVERY, SIDE, SEED = 40, 3, 1000, 42  # of the simulated year: each third date is looked at
SUNS_APART_DEG = (0.0, 5.0, 10.0, 20.0, 40.0, 90.0)  # directions towards the sun
NEAR_PX, BORDER_PX = 2.0, 30.0
MOST_SNOW = 0.2  # share of the ground: under snow nothing is found again
ELSEWHERE_PX = (37.0, 23.0)  # where chance alone finds something


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=TEST_DATA / "real")
    parser.add_argument("--docs", action="store_true", help=f"write the tables into {PAGE.name}")
    parser.add_argument("--year", type=Path, help="a simulated year of 40 dates; by default it is made")
    parser.add_argument("--real", action="store_true", help="only the real images, no simulated year")
    given = parser.parse_args()
    if given.docs and given.real:
        parser.error("--docs writes all tables: leave --real out")
    cv2.setNumThreads(1)
    options = DetectionOptions(centres=CentreOptions(quality=CANDIDATE_QUALITY), threads=1)
    seen = {}
    flags = [
        "| image | sun's azimuth, elevation | dark centres | flagged | sun rotated 90°, 180°, 270° | due to the sun |",
        "|---|---|---|---|---|---|",
    ]
    for folder, name in dict.fromkeys((pair.folder, file) for pair in PAIRS for file in pair.files):
        time = next((time for (at, begin), time in TIMES.items() if folder == at and name.startswith(begin)), None)
        image = open_image(str(given.data / folder / name))
        raster = ArrayRaster(*image.raster.read(0, 0, *image.raster.size))
        points = detect_interest_points(raster, "centres", options)
        points = points.select(points.contrast < 0.0)
        seen[folder, name] = image, raster, points, None
        if time is None:
            continue
        sun = sun_at_time(time, image.rpc.long_off, image.rpc.lat_off)
        found = [
            find_shadows(raster, points, compute_image_direction(image.rpc, raster.size, sun.azimuth_deg + turn))
            for turn in TURNS_DEG
        ]
        seen[folder, name] = image, raster, points, found[0]
        count = [int(mask.sum()) for mask in found]
        flags.append(
            f"| {Path(name).stem} | {sun.azimuth_deg:.0f}°, {sun.elevation_deg:.0f}° | {len(points)} | {count[0]} "
            f"| {', '.join(map(str, count[1:]))} | {max(1.0 - count[2] / max(count[0], 1), 0.0):.0%} |"
        )
    again = ["", "| centres of | searched for in | flagged found again | other dark ones |", "|---|---|---|---|"]
    for pair in PAIRS:
        both = [seen[pair.folder, file] for file in pair.files]
        if all(entry[3] is None for entry in both):
            continue
        ways = truths([both[0][0], both[1][0]], [both[0][1], both[1][1]], pair.height_m)
        for own, other in ((0, 1), (1, 0)):
            flagged = both[own][3]
            if flagged is None:
                continue
            found = ways[own].found_again(both[own][2], both[other][2].xy)
            shares = [
                f"{np.mean(found[(found > -2) & chosen] >= 0):.0%} of {int(np.sum((found > -2) & chosen))}"
                for chosen in (flagged, ~flagged)
            ]
            names = (Path(pair.files[k]).stem for k in (own, other))
            again.append(f"| {' | '.join(names)} | {' | '.join(shares)} |")
    print("\n".join([*flags, *again]), flush=True)
    if given.real:
        return
    with tempfile.TemporaryDirectory() as scratch:
        year = of_year(given.year or Path(scratch) / "year", options)
    print("\n".join(year))
    if given.docs:
        put_between(PAGE, "shadow flags", "\n".join([*flags, *again, *year]))


def of_year(folder: Path, options: DetectionOptions) -> list[str]:
    """Return the table of a simulated year: dark centres found again, by how far apart the suns stood."""
    paths = [Path(path) for path in simulated(folder, DATES, SEED, SIDE)][::EVERY]
    truth, cameras = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["images"], true_cameras(folder)
    surface = open_dem(str(folder / "dem.tif"), "ellipsoidal")
    suns, dark, flagged, ground = {}, {}, {}, {}
    for name in (path.stem for path in paths):
        told = truth[name]["acquisition"]
        if told["snow"] > MOST_SNOW:
            continue
        image = open_image(str(folder / f"{name}.tif"))
        raster = ArrayRaster(*image.raster.read(0, 0, *image.raster.size))
        points = detect_interest_points(raster, "centres", options)
        dark[name] = points.select(points.contrast < 0.0)
        towards = compute_image_direction(image.rpc, raster.size, told["sun_azimuth_deg"])
        flagged[name] = find_shadows(raster, dark[name], towards)
        ground[name] = intersect_surface(cameras[name], dark[name].xy, surface).ground
        azimuth, elevation = np.radians([told["sun_azimuth_deg"], told["sun_elevation_deg"]])
        suns[name] = np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation),
                               np.sin(elevation)])  # fmt: skip
    found = defaultdict(list)  # by the class of angle: flagged, whether found again, whether by chance
    for one, other in itertools.permutations(suns, 2):
        apart = np.degrees(np.arccos(np.clip(suns[one] @ suns[other], -1.0, 1.0)))
        there = cameras[other].project(ground[one])
        asked = np.isfinite(there).all(axis=1)
        asked[asked] = ((there[asked] > BORDER_PX) & (there[asked] < SIDE - 1.0 - BORDER_PX)).all(axis=1)
        tree = cKDTree(dark[other].xy)
        ways = [tree.query(there[asked] + shift)[0] <= NEAR_PX for shift in (np.zeros(2), np.array(ELSEWHERE_PX))]
        found[int(np.searchsorted(SUNS_APART_DEG, apart, "right"))].append(
            np.column_stack([flagged[one][asked], *ways])
        )
    rows = ["", "| simulated dates, angle of suns | pairs | flagged found again | other dark ones | by chance |",
            "|---|---|---|---|---|"]  # fmt: skip
    for number, parts in sorted(found.items()):
        shadow, again, chance = np.concatenate(parts).T.astype(bool)
        shares = [f"{np.mean(again[chosen]):.0%} of {chosen.sum()}" for chosen in (shadow, ~shadow)]
        apart = f"{SUNS_APART_DEG[number - 1]:g}° to {SUNS_APART_DEG[number]:g}°"
        rows.append(f"| {apart} | {len(parts)} | {' | '.join(shares)} | {np.mean(chance):.0%} |")
    return rows


if __name__ == "__main__":
    main()
