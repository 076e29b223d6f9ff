"""The flag `shadow` of dark centres on real images: does it know where the sun stood?

    python benchmarks/shadow_flags.py [--docs]

Nobody has marked the shadows of the real images. But a rule that only finds what is dark finds as much with a wrong sun
as with the right one. So the sun is turned by 90, 180 and 270 degrees: what is flagged with it turned by 180 degrees is
what chance gives, and one less its share is how many of those flagged owe it to the sun. The sun's angles follow from
time and place; the time is that of the metadata or in the name of the delivery's RPC file, and of the second image of
a pass the same one (a minute is a quarter of a degree). Then how many dark centres are found again, flagged or not,
in the view of the same date and of another one: `interest_points_real.Truth` tells it. --docs writes both tables into
docs/interest_points_accuracy.md.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np

from hrsi.benchmarks.interest_points_real import truths
from hrsi.benchmarks.matching import PAIRS
from hrsi.benchmarks.pages import put_between
from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.ground.sun import sun_at_time
from hrsi.hrsi_engine.io.rasters import open_image
from hrsi.hrsi_engine.measurement.interest_points import CentreOptions, DetectionOptions, detect_interest_points
from hrsi.hrsi_engine.measurement.interest_points.options import CANDIDATE_QUALITY
from hrsi.hrsi_engine.measurement.interest_points.shadows import find_shadows, image_direction
from hrsi.tests.conftest import TEST_DATA

PAGE = Path(__file__).resolve().parents[1] / "docs" / "interest_points_accuracy.md"
#: Times of acquisition, by the folder and beginning of the file's name.
TIMES = {
    ("ventoux_phr_pair", ""): datetime(2013, 8, 5, 10, 42, 19, tzinfo=UTC),  # of RPC_PHR1B_P_201308051042194_…
    ("kahramanmaras_phr4", "post"): datetime(2023, 4, 15, 8, 34, 39, tzinfo=UTC),  # IMAGING_TIME of the second
}
TURNS_DEG = (0.0, 90.0, 180.0, 270.0)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=TEST_DATA / "real")
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/interest_points_accuracy.md")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    options = DetectionOptions(centres=CentreOptions(quality=CANDIDATE_QUALITY), threads=1)
    seen = {}
    flags = [
        "| image | sun's azimuth, elevation | dark centres | flagged | sun turned 90°, 180°, 270° | owed to the sun |",
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
            find_shadows(raster, points, image_direction(image.rpc, raster.size, sun.azimuth_deg + turn))
            for turn in TURNS_DEG
        ]
        seen[folder, name] = image, raster, points, found[0]
        count = [int(mask.sum()) for mask in found]
        flags.append(
            f"| {Path(name).stem} | {sun.azimuth_deg:.0f}°, {sun.elevation_deg:.0f}° | {len(points)} | {count[0]} "
            f"| {', '.join(map(str, count[1:]))} | {max(1.0 - count[2] / max(count[0], 1), 0.0):.0%} |"
        )
    again = ["", "| centres of | looked for in | flagged found again | other dark ones |", "|---|---|---|---|"]
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
    print("\n".join([*flags, *again]))
    if given.docs:
        put_between(PAGE, "shadow flags", "\n".join([*flags, *again]))


if __name__ == "__main__":
    main()
