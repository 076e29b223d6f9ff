"""The loops of matching are compiled in a process of their own when the plugin starts for the first time.

`compile_loops` triangulates a small simulated block, so that numba compiles all loops and stores them next to
their modules. A first run in QGIS then need not wait for them, and the process can be ended at any time. This module
imports nothing of QGIS: ``python -m hrsi.plugin.compile_loops FOLDER``, with the folder of packages in the profile.
"""

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from .dependencies import use_packages

BLOCK: dict[str, Any] = {
    "images": 3,
    "along": "-12,0,12",
    "size": 400,
    "gcps": 6,
    "checks": 0,
    "ties": 0,
    "relief": 20.0,
}
NICENESS = 10  # of the process: it uses what other programs leave


def compile_loops() -> None:
    """Triangulate a simulated block in a temporary folder."""
    from ..processing_algorithms import run  # after `use_packages`

    with tempfile.TemporaryDirectory() as folder:
        run("simulate", output_dir=f"{folder}/block", **BLOCK)
        run(
            "triangulate",
            images=[f"{folder}/block/image_{number}.tif" for number in range(1, BLOCK["images"] + 1)],
            gcps=f"{folder}/block/ground_points.csv",
            image_points=f"{folder}/block/image_points.csv",
            height_datum="ellipsoidal",
            output_dir=f"{folder}/result",
        )


if __name__ == "__main__":
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    use_packages(Path(sys.argv[1]))
    compile_loops()
