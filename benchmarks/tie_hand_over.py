"""How fast the measurements of `tie-points` are read by `adjust`: as columns, as layer, as CSV.

`python benchmarks/tie_hand_over.py [--rows N] [--docs]`: the same N random measurements of points on three of a hundred
images in all three forms, each read through to the table of image points and compared with what was written; then put
together as a block. With --docs the table goes into docs/protocols/large_blocks.md.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hrsi.benchmarks.pages import DOCS, put_between
from hrsi.benchmarks.thesis_tables import render
from hrsi.hrsi_engine.block.columns import find_unique_ids
from hrsi.hrsi_engine.block.points import ImagePoints
from hrsi.hrsi_engine.ground.geodesy import WGS84_3D
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.point_files import read_image_points, read_points
from hrsi.hrsi_engine.io.point_files.csv_text import write_measurements
from hrsi.hrsi_engine.io.point_files.kept_columns import COLUMNS_FILE, write_columns

PAGE = DOCS / "protocols/large_blocks.md"
IMAGES, VIEWS, MILLION = 100, 3, 1e6


def made_points(rows: int) -> tuple[ImagePoints, np.ndarray]:
    """Return measurements, and the track of each."""
    rng = np.random.default_rng(1)
    track = np.arange(rows) // VIEWS
    return ImagePoints.create(
        np.char.add("T", np.char.zfill(track.astype(str), 8)),
        np.array([f"image_{number}" for number in range(IMAGES)])[rng.integers(0, IMAGES, rows)],
        rng.uniform(0.0, 3e4, (rows, 2)), rng.uniform(0.05, 0.2, rows), np.array(["corner", "center"])[track % 2],
        rng.uniform(0.0, 1.0, rows),
    ), track  # fmt: skip


def written(points: ImagePoints, track: np.ndarray, folder: Path) -> None:
    """Write the three forms."""
    columns = {
        "id": points.ids, "image": points.image_ids, "sample": points.xy[:, 0], "line": points.xy[:, 1],
        "sigma": points.sigma_px, "quality": points.quality, "kind": points.kind,
    }  # fmt: skip
    ground = np.random.default_rng(2).uniform(0.0, 1.0, (track[-1] + 1, 3))[track]
    layers = [Layer("tie_points", "PointZ", WGS84_3D, ground[:1], {"id": points.ids[:1]}),
              Layer("image_points", "PointZ", WGS84_3D, ground, columns)]  # fmt: skip
    write_geopackage(str(folder / "block.gpkg"), layers, {})
    write_columns(str(folder), points)
    write_measurements(str(folder / "tie_points.csv"), points)


def timed(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """Return what is returned, and the seconds of the processor and of the clock."""
    cpu, clock = time.process_time(), time.monotonic()
    done = work()
    return done, time.process_time() - cpu, time.monotonic() - clock


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=3_000_000)
    parser.add_argument("--docs", action="store_true", help="put the table into docs/protocols/large_blocks.md")
    options = parser.parse_args()
    points, track = made_points(options.rows)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written(points, track, folder)
        layer = f"{folder}/block.gpkg|layername=image_points"
        forms: dict[str, tuple[str, Callable[[], Any]]] = {
            "columns": (COLUMNS_FILE, lambda: read_image_points(layer)),
            "layer": ("block.gpkg", lambda: read_points(layer)),
            "CSV": ("tie_points.csv", lambda: read_points(str(folder / "tie_points.csv"))),
        }
        small = folder / "few.csv"
        write_measurements(str(small), points.select(np.arange(100)))
        read_points(str(small))  # compiled code is loaded
        for form, (file, read) in forms.items():
            found, cpu, clock = timed(read)
            read_back = found.image
            same = all(
                np.array_equal(np.asarray(getattr(read_back, column)), getattr(points, column))
                for column in ("ids", "image_ids", "xy", "sigma_px", "kind", "quality")
            )
            _, names_cpu, _ = timed(
                lambda read_back=read_back: (find_unique_ids(read_back.ids), find_unique_ids(read_back.image_ids))
            )
            million = options.rows / MILLION
            rows.append([form, file, f"{os.path.getsize(folder / file) / options.rows:.0f}", f"{cpu / million:.2f}",
                         f"{clock / million:.2f}", f"{names_cpu / million:.2f}", "yes" if same else "NO"])  # fmt: skip
    header = [
        "form",
        "file",
        "bytes a row",
        "CPU s a million rows",
        "s a million rows",
        "ids resolved, CPU s",
        "same bits",
    ]
    text = f"{options.rows} rows:\n\n{render(header, rows)}"
    print(text)
    if options.docs:
        put_between(PAGE, "hand-over", text)


if __name__ == "__main__":
    main()
