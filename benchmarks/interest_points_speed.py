"""Seconds per megapixel and peak memory of the interest point detectors, next to OpenCV's on the same images.

    python benchmarks/interest_points_speed.py [--data DIR] [--large 8192] [--page PAGE]

Every detector runs in a process of its own on the same pixels, one thread; peak memory is the process's maximum
resident set beyond what it was before. OpenCV's functions get the whole image at once (8 bit, 1-99 % stretch).
``--large N`` adds images of N/2 and N pixels a side: memory must not grow with the image.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import cv2
import numpy as np

from hrsi.benchmarks import pages
from hrsi.hrsi_engine.io.rasters.images import GdalRaster
from hrsi.hrsi_engine.laboratory.interest_points import DETECTORS, detect_interest_points
from hrsi.hrsi_engine.measurement.interest_points import STRONG_QUALITY
from hrsi.hrsi_engine.measurement.tile_matching.features import stretch_to_byte

DATA = pages.DATA / "real"
IMAGES = (
    "s2p_triplet_phr/img_01.tif", "s2p_triplet_phr/img_02.tif", "s2p_triplet_phr/img_03.tif",
    "kahramanmaras_phr4/pre_event_img1.tif", "kahramanmaras_phr4/pre_event_img2.tif",
    "kahramanmaras_phr4/post_event_img1.tif", "kahramanmaras_phr4/post_event_img2.tif",
    "ventoux_phr_pair/left_image.tif", "ventoux_phr_pair/right_image.tif", "qb2_gcp/qb2_basic1b.tif",
    "formats/nitf_ichipb/po_39928_pan_0000000_chip_700_700_noICHIPB.nitf", "formats/nitf_rpc00b/wv3_20.NTF",
)  # fmt: skip


class Tiled:
    """A small image repeated to any size, made window by window: a full scene without its memory."""

    def __init__(self, path: str, side: int) -> None:
        self._grey, _ = GdalRaster(path).read(0, 0, *GdalRaster(path).size)
        self.size = (side, side)

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a window and its mask."""
        rows = np.arange(line, line + lines) % self._grey.shape[0]
        columns = np.arange(sample, sample + samples) % self._grey.shape[1]
        return self._grey[np.ix_(rows, columns)], np.ones((lines, samples), dtype=bool)


def run_opencv(raster: GdalRaster, name: str) -> tuple[np.ndarray, dict[str, int]]:
    """Return points (n, 2) of one of OpenCV's detectors on the whole image."""
    grey, valid = raster.read(0, 0, *raster.size)
    byte = stretch_to_byte(grey, valid)
    assert byte is not None
    if name == "goodFeaturesToTrack":
        found = cv2.goodFeaturesToTrack(byte, 0, 0.01, 4.0, useHarrisDetector=True, k=0.04)
        xy = found.reshape(-1, 2)
    else:
        xy = np.array([point.pt for point in cv2.SIFT_create().detect(byte, None)])
    return xy, {name: len(xy)}


def measure(path: str, name: str, side: int) -> dict:
    """Run one detector here and return its figures."""
    cv2.setNumThreads(1)
    raster = Tiled(path, side) if side else GdalRaster(path)
    before = resource.getrusage(resource.RUSAGE_SELF)
    start = time.perf_counter()
    if name in DETECTORS:
        points = detect_interest_points(raster, name)
        xy, kinds = points.xy, dict(Counter(points.kind.tolist()))
        if points.is_centre.any():
            kinds["of them strong"] = int(np.sum(points.quality >= STRONG_QUALITY))
    else:
        xy, kinds = run_opencv(raster, name)  # type: ignore[arg-type]
    seconds = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_SELF)
    quarters = np.bincount((xy > np.array(raster.size) / 2.0) @ [1, 2], minlength=4)
    return {
        "seconds": seconds, "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "mib": (after.ru_maxrss - before.ru_maxrss) / 1024.0, "megapixels": 1e-6 * raster.size[0] * raster.size[1],
        "points": len(xy), "kinds": kinds, "quarters": quarters.tolist(),
    }  # fmt: skip


def in_own_process(path: Path, name: str, side: int = 0) -> dict:
    """Return the figures of one detector, run in a process of its own."""
    command = [sys.executable, __file__, "--one", str(path), name, str(side)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def page_row(image: str, name: str, row: dict) -> str:
    """Return one line of a Markdown table."""
    kinds = ", ".join(f"{count} {kind}" for kind, count in row["kinds"].items())
    rates = [row[key] / row["megapixels"] for key in ("seconds", "cpu")]
    return (
        f"| {image} | {name} | {row['points']} | {kinds} | {row['quarters']} | {rates[0]:.2f} | {rates[1]:.2f} | "
        f"{row['mib']:.0f} |"
    )


def print_row(image: str, name: str, row: dict) -> None:
    """Print one line."""
    rate, cpu = row["seconds"] / row["megapixels"], row["cpu"] / row["megapixels"]
    print(
        f"{image:24.24s} {name:20s} {row['points']:7d}  quarters {row['quarters']}  {rate:6.2f} s/Mpx (cpu {cpu:5.2f}) "
        f"{row['mib']:6.0f} MiB  {row['kinds']}",
        flush=True,
    )


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--large", type=int, default=0)
    parser.add_argument("--page", type=Path, help="write the table as Markdown")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(measure(given.one[0], given.one[1], int(given.one[2]))))
        return
    runs = [(Path(image).stem, image, 0, (*DETECTORS, "goodFeaturesToTrack", "SIFT")) for image in IMAGES]
    for side in (given.large // 2, given.large) if given.large else ():
        runs.append((f"{side} x {side}", IMAGES[0], side, tuple(DETECTORS)))
    lines = []
    for title, image, side, names in runs:
        for name in names:
            row = in_own_process(given.data / image, name, side)
            print_row(title, name, row)
            lines.append(page_row(title, name, row))
    if given.page:
        given.page.write_text("\n".join([PAGE_HEAD, *lines, ""]), encoding="utf-8")


PAGE_HEAD = """# Interest points on real images: counts, time and memory

Made by `benchmarks/interest_points_speed.py --page`; one thread, each detector in a process of its own. Quarters are
the points in the upper left, upper right, lower left and lower right of the image. Centres are all of quality 0.5 and
better; the strong ones are those that `interest-points` returns by itself. CPU seconds are what to compare: the others
depend on what else the machine does. Of the time for centres, a quarter to a third is spent on the extremal regions, a
quarter on outlines and a third on shapes. The rows named by a size alone are the first image repeated to that size.

| image | detector | points | kinds | quarters | s/Mpx | CPU s/Mpx | MiB |
|---|---|---|---|---|---|---|---|"""


if __name__ == "__main__":
    main()
