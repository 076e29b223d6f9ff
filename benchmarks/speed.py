"""Speed figures, section by section.

    python benchmarks/speed.py [--points 1000000] [--rivals/--no-rivals] [--rpc FILE] [SECTION ...]

Section ``rpc``: RPC evaluation in one process, next to GDAL's transformer called through rasterio and through osgeo
in the same run, and to rpcm and shareloc in an environment of their own (``build/bench-venv``, made with pip at the
first run; a package that cannot be had is named and left out). Wanted: ``project`` at 10 times GDAL's transformer
called through rasterio, ``localize`` at height at 1.5 times while it closes to 1e-8 px.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio.rpc
from osgeo import gdal
from rasterio.transform import RPCTransformer

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.io.rpc_files import read_rpc

ROOT = Path(__file__).resolve().parents[1]
DEFAULT_RPC = ROOT / "examples" / "hobart" / "hobart_ikonos_1_RPC.TXT"
VENV = ROOT / "build" / "bench-venv"
RIVALS = Path(__file__).with_name("rivals") / "rpc_seconds.py"
ROUNDS = 11
#: What is installed for the comparison. rpcm alone: its dependency srtm4 needs a C compiler and is not used.
RIVAL_PACKAGES = (["numpy", "rasterio", "pyproj", "geojson"], ["--no-deps", "rpcm"], ["shareloc"])


@dataclass(frozen=True)
class Row:
    """A line of the table: seconds for all points, None where something cannot do it or was not run."""

    name: str
    project_s: float | None
    localize_s: float | None
    note: str = ""


def best_seconds(*functions: Callable[[], object], rounds: int = ROUNDS) -> list[float]:
    """Return the best time of each function; they take turns, so that a busy machine treats all alike."""
    best = [np.inf] * len(functions)
    for _ in range(rounds):
        for number, function in enumerate(functions):
            start = time.perf_counter()
            function()
            best[number] = min(best[number], time.perf_counter() - start)
    return best


def points_of(rpc: RPC, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return image points over the RPC's whole image and the ground points there over its whole height range."""
    rng = np.random.default_rng(0)
    centre, half = (rpc.samp_off, rpc.line_off), np.array([rpc.samp_scale, rpc.line_scale])
    image = centre + half * rng.uniform(-1.0, 1.0, (count, 2))
    ground, converged = rpc.localize(image, rng.uniform(*rpc.height_range, count))
    return image[converged], ground[converged]


def metadata(rpc: RPC) -> dict[str, str]:
    """Return GDAL's RPC metadata of an RPC."""
    items = {name.upper(): getattr(rpc, name) for name in ("line_off", "samp_off", "lat_off", "long_off", "height_off")}
    items |= {f"{name[:-4].upper()}_SCALE": getattr(rpc, f"{name[:-4]}_scale") for name in map(str.lower, items)}
    coefficients = {
        f"{name.upper()}_COEFF": " ".join(map(repr, getattr(rpc, name).tolist()))
        for name in ("line_num", "line_den", "samp_num", "samp_den")
    }
    return {name: repr(value) for name, value in items.items()} | coefficients


def gdal_image(rpc: RPC, path: str) -> gdal.Dataset:
    """Write an image of one pixel with the RPC, for programs that want a file."""
    dataset = gdal.GetDriverByName("GTiff").Create(path, 1, 1)
    dataset.SetMetadata(metadata(rpc), "RPC")
    dataset.FlushCache()
    return dataset


def rasterio_rpc(rpc: RPC) -> rasterio.rpc.RPC:
    """Return the RPC as rasterio has it."""
    values = {name: getattr(rpc, name) for name in RPC.__dataclass_fields__}
    coefficients = {
        f"{name}_coeff": values.pop(name).tolist() for name in list(values) if name.endswith(("num", "den"))
    }
    return rasterio.rpc.RPC(**values, **coefficients)


def measure(rpc: RPC, image: np.ndarray, ground: np.ndarray, path: str) -> list[Row]:
    """Time HRSI, and GDAL's transformer through rasterio and osgeo."""
    lon, lat, height = (np.ascontiguousarray(axis) for axis in ground.T)
    sample, line = (np.ascontiguousarray(axis) for axis in image.T)
    transformer = gdal.Transformer(gdal_image(rpc, path), None, ["METHOD=RPC"])
    pixels = np.column_stack([image + 0.5, height])
    with RPCTransformer(rasterio_rpc(rpc)) as rasterio_transformer:
        project, localize, by_rowcol, by_raw = best_seconds(
            lambda: rpc.project(ground),
            lambda: rpc.localize(image, height),
            lambda: rasterio_transformer.rowcol(lon, lat, height),
            lambda: rasterio_transformer.rowcol(lon, lat, height, op=float),
        )
        (by_xy,) = best_seconds(lambda: rasterio_transformer.xy(line, sample, height), rounds=2)
    to_pixel, to_ground = best_seconds(
        lambda: transformer.TransformPoints(True, ground), lambda: transformer.TransformPoints(False, pixels), rounds=2
    )
    closure = np.abs(rpc.project(rpc.localize(image, height).ground) - image).max()
    return [
        Row("HRSI", project, localize, f"closes to {closure:.1e} px"),
        Row("rasterio, rowcol and xy", by_rowcol, by_xy),
        Row("rasterio, rowcol op=float", by_raw, None),
        Row("osgeo, TransformPoints", to_pixel, to_ground),
    ]


def rival_rows(path: str, image: np.ndarray, ground: np.ndarray, folder: str) -> list[Row]:
    """Time rpcm and shareloc in their own environment, which is made when it is missing."""
    python = VENV / "bin" / "python"
    if not python.exists():
        print(f"making {VENV} for rpcm and shareloc (once) ...", file=sys.stderr)
        subprocess.run([sys.executable, "-m", "venv", str(VENV)], check=True)
        for packages in RIVAL_PACKAGES:
            subprocess.run([str(python), "-m", "pip", "install", "--quiet", *packages], check=False)
    points = os.path.join(folder, "points.npz")
    np.savez(points, image=image, ground=ground)
    done = subprocess.run([str(python), str(RIVALS), path, points], capture_output=True, text=True, check=False)
    if done.returncode:
        return [Row("rpcm and shareloc", None, None, f"not available: {done.stderr.strip().splitlines()[-1]}")]
    results = json.loads(done.stdout.splitlines()[-1])
    return [rival_row(name, result) for name, result in results.items()]


def rival_row(name: str, result: dict[str, float] | str) -> Row:
    """Return a package's line of the table."""
    if isinstance(result, str):
        return Row(name, None, None, f"not available: {result}")
    note = f"differs by {result['project_px']:.1e} px, {result['localize_m']:.1e} m"
    return Row(name, result["project_s"], result["localize_s"], note)


def working_memory_mb(rpc: RPC, image: np.ndarray, ground: np.ndarray) -> float:
    """Return the peak of memory in MB beyond the result, of both directions."""
    peaks = []
    for function in (lambda: rpc.project(ground), lambda: rpc.localize(image, ground[:, 2]).ground):
        tracemalloc.start()
        result = function()
        peaks.append(tracemalloc.get_traced_memory()[1] - result.nbytes)
        tracemalloc.stop()
    return max(peaks) / 1e6


def print_table(rows: list[Row], count: int) -> None:
    """Print seconds per million points, millions of points per second and how much faster HRSI is."""
    print(f"{'':28}{'ground -> image':>32}{'image -> ground':>34}")
    print(f"{'per million points':28}{'s':>9}{'M/s':>8}{'HRSI is x':>15}{'s':>11}{'M/s':>8}{'HRSI is x':>15}")
    for row in rows:
        cells = cell(row.project_s, rows[0].project_s, count) + "  " + cell(row.localize_s, rows[0].localize_s, count)
        print(f"{row.name:28}{cells}  {row.note}")


def cell(seconds: float | None, ours: float | None, count: int) -> str:
    """Return one direction's figures."""
    if seconds is None or ours is None:
        return f"{'-':>9}{'-':>8}{'-':>15}"
    return f"{seconds / count * 1e6:9.3f}{count / seconds / 1e6:8.1f}{seconds / ours:15.1f}"


def rpc_section(given: argparse.Namespace) -> None:
    """Print the figures of RPC evaluation."""
    rpc = read_rpc(str(given.rpc)).rpc
    image, ground = points_of(rpc, given.points)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "image.tif")
        rows = measure(rpc, image, ground, path)
        if given.rivals:
            rows += rival_rows(path, image, ground, folder)
    print(f"RPC evaluation, {len(image)} points, one process, GDAL {gdal.VersionInfo('RELEASE_NAME')}")
    print_table(rows, len(image))
    few, many = (working_memory_mb(rpc, image[:n], ground[:n]) for n in (len(image) // 4, len(image)))
    print(f"working memory beyond the result: {few:.1f} MB for a quarter of the points, {many:.1f} MB for all")


SECTIONS: dict[str, Callable[[argparse.Namespace], None]] = {"rpc": rpc_section}


def main() -> None:
    """Run the sections named on the command line, by default all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", choices=[*SECTIONS, []], default=[])
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--rpc", type=Path, default=DEFAULT_RPC)
    parser.add_argument("--rivals", action=argparse.BooleanOptionalAction, default=True)
    given = parser.parse_args()
    for name in given.sections or SECTIONS:
        SECTIONS[name](given)


if __name__ == "__main__":
    main()
