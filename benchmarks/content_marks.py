"""What telling the content of an image of 40 000 x 40 000 pixels costs: ``python benchmarks/content_marks.py``.

Cold: the system holds nothing of the file; warm: it does. Beside it a file that is small enough to be hashed whole.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from hrsi.hrsi_engine.io.safety.content_marks import CONTENT_SAMPLING, content_mark

HEADER = (
    "ENVI\nsamples = {side}\nlines = {side}\nbands = 1\nheader offset = 0\nfile type = ENVI Standard\n"
    "data type = 12\ninterleave = bsq\nbyte order = 0\n"
)


def write(path: Path, side: int) -> None:
    """Write an image of random grey values."""
    strip = np.random.default_rng(1).integers(0, 2000, (side // 40, side)).astype(np.uint16)
    with path.open("wb") as file:
        for _ in range(40):
            strip.tofile(file)
        file.flush()
        os.fsync(file.fileno())
    path.with_suffix(".hdr").write_text(HEADER.format(side=side))


def forget(path: Path) -> None:
    """Have the system drop what it holds of a file."""
    with path.open("rb") as file:
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def main() -> int:
    """Print the table."""
    print("| image | bytes | state | wall s | CPU s |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="hrsi-content-marks-") as folder:
        for side in (int((CONTENT_SAMPLING.whole_bytes / 2) ** 0.5) // 40 * 40 - 40, 40_000):
            path = Path(folder) / f"image_{side}.img"
            write(path, side)
            for state in ("cold", "warm", "warm"):
                if state == "cold":
                    forget(path)
                wall, cpu = time.perf_counter(), time.process_time()
                content_mark(str(path))
                wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
                print(f"| {side} x {side} | {path.stat().st_size} | {state} | {wall:.3f} | {cpu:.3f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
