"""Kill a process that writes RPCs at random moments; each time the image must hold the old RPC or a new one.

``python tests/kill_rpc_writer.py --kills 200`` forks a writer that switches an image between RPCs (in place, then
back by ``restore``, with a sidecar that has to be set aside), kills it with SIGKILL and reads the image again.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from osgeo import gdal

sys.path.insert(0, str(Path(__file__).parent))
from rpc_samples import restore, sample_rpc, write_image, write_in_place

from hrsi.hrsi_engine.io.rpc_files import difference_px, read_rpc, write_rpc_text
from hrsi.hrsi_engine.io.rpc_files.fields import rpc_from_entries

ORIGINAL, FIRST, SECOND = sample_rpc(1), sample_rpc(2), sample_rpc(3)


def write_for_ever(image: Path, sidecar: Path) -> None:
    """Switch the image between RPCs until killed."""
    while True:
        write_in_place(str(image), FIRST)
        write_rpc_text(str(sidecar), ORIGINAL)
        write_in_place(str(image), SECOND)
        restore(str(image))


def check(image: Path, pixels: np.ndarray) -> int:
    """Return which of the three RPCs the image has; raise where it has none, or the pixels or GDAL disagree."""
    found = read_rpc(str(image)).rpc
    dataset = gdal.Open(str(image))
    if dataset is None or not np.array_equal(dataset.ReadAsArray(), pixels):
        raise RuntimeError(f"{image} is torn")
    if not difference_px(found, rpc_from_entries("GDAL", dataset.GetMetadata("RPC"))) < 1e-6:
        raise RuntimeError(f"{image}: GDAL finds another RPC")
    return [ORIGINAL, FIRST, SECOND].index(found)


def main() -> int:
    """Kill as often as asked; print how often which RPC was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, counts = random.Random(options.seed), [0, 0, 0]
    folder = Path(tempfile.mkdtemp(prefix="hrsi-kill-"))
    image = folder / "image.tif"
    pixels = write_image(image, ORIGINAL, size=(1000, 800))
    for _ in range(options.kills):
        child = os.fork()
        if child == 0:
            write_for_ever(image, folder / "image_RPC.TXT")
        time.sleep(rng.uniform(0.0, 0.08))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        counts[check(image, pixels)] += 1
    shutil.rmtree(folder)
    print(f"{options.kills} kills: original {counts[0]}, first {counts[1]}, second {counts[2]}, torn or unreadable 0")
    return 0


if __name__ == "__main__":
    sys.exit(main())
