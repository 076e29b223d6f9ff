"""Speed of `orthorectify` against GDAL's own RPC warper, and the position errors of both: ``ortho_speed.py [SIZE …]``.

Simulated Pleiades-like images of SIZE x SIZE pixels (5000 by default) with a DEM of 5.6 m are warped by every way to
the same pixels of one map grid, in the same run, each in a process of its own: CPU seconds (user and system of the
process) and wall seconds, start of the program included. They take turns, and the least of HRSI_ORTHO_ROUNDS counts:
what a machine does that is busy with other things too. Both write the same kind of file: an uncompressed GeoTIFF, or a
COG with or without deflate and predictor, with tiles of 512 and averaged overviews. Python finds its compiled modules
in a cache, as an installation has them. Position errors are distances in the raw image to GDAL's RPC transformer with
the same DEM, at random pixels of the orthoimage.

``rough`` among the arguments repeats all with a DSM of 1 m with houses; ``quick`` compares with -et 0 only, 1 thread.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from osgeo import gdal

from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rasters.ortho_warp import OrthoSource, Warp, warp_chunk
from hrsi.hrsi_engine.io.rasters.orthoimages import chunk_size
from hrsi.hrsi_engine.ortho.grid import GridWindow, MapGrid, find_terrain_points
from hrsi.hrsi_engine.ortho.mapping import OrthoMapping
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.declarations.orthoimages import OrthorectifyOptions

RESOLUTION = 0.7
EXACT, OURS = "gdalwarp -rpc -et 0", "hrsi orthorectify"
COG = ("BLOCKSIZE=512", "OVERVIEW_RESAMPLING=AVERAGE")
DEFLATE = ("COMPRESS=DEFLATE", "PREDICTOR=YES")
#: Format, compression, threads; those of the first group are all that ``quick`` compares.
QUICK_JOBS = (("gtiff", "none", 1), ("cog", "deflate", 1))
JOBS = (*QUICK_JOBS, ("gtiff", "none", 2), ("cog", "deflate", 2), ("cog", "none", 1))
ROUNDS = int(os.environ.get("HRSI_ORTHO_ROUNDS", "1"))


def simulated(folder: Path, size: int) -> tuple[str, str]:
    """Return the paths of a simulated image and its DEM; made where they are not there."""
    if not (folder / "report.json").exists():
        run("simulate", images=1, size=size, along=["-15"], relief=200.0, gcps=5, ties=0, checks=0,
            output_dir=str(folder), overwrite=True)  # fmt: skip
    return str(folder / "image_1.tif"), str(folder / "dem.tif")


def rough_dem(dem: str, target: str) -> str:
    """Write the DEM at 1 m, with houses of 6 m on it: the terrain that no interpolation between nodes follows."""
    gdal.Warp(target, dem, dstSRS="EPSG:32631", xRes=1.0, yRes=1.0, resampleAlg="bilinear")
    dataset = gdal.Open(target, gdal.GA_Update)
    heights = dataset.ReadAsArray()
    rows, columns = np.indices(heights.shape)
    heights[((rows % 40) < 12) & ((columns % 50) < 15)] += 6.0
    dataset.WriteArray(heights)
    return target


def measured(command: list[str], threads: int, cache: Path) -> tuple[float, float]:
    """Return CPU and wall seconds of a command; Python keeps its compiled modules in a cache."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "GDAL_NUM_THREADS": str(threads)}
    environment |= {"PYTHONPYCACHEPREFIX": str(cache), "PYTHONDONTWRITEBYTECODE": ""}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wall, after = time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


Job = tuple[str, str, int]


def commands(image: str, dem: str, folder: Path, job: Job, grid: MapGrid) -> dict[str, list[str]]:
    """Return the commands to be compared, by name."""
    form, compression, threads = job
    west, south, east, north = grid.bounds
    gdalwarp = [
        "gdalwarp", "-q", "-overwrite", "-rpc", "-to", f"RPC_DEM={dem}", "-t_srs", "EPSG:32631", "-r", "cubic", "-te",
        *map(str, (west, south, east, north)), "-tr", str(RESOLUTION), str(RESOLUTION), "-dstnodata", "0", "-wm", "500",
        "-multi", "-wo", f"NUM_THREADS={threads}", *_creation(job), image,
    ]  # fmt: skip
    ours = [
        sys.executable, "-m", "hrsi.processing_algorithms.command_line.cli", "orthorectify", image, "--dem", dem,
        "--height-datum",
        "ellipsoidal", "--crs", "EPSG:32631", "--resolution", str(RESOLUTION), "--extent",
        f"{west},{south},{east},{north}", "--format", form, "--compression", compression,
        "--threads", str(threads), "--quiet", "--overwrite", "--no-report", "--output-dir",
    ]  # fmt: skip
    return {
        EXACT: [*gdalwarp, "-et", "0", str(folder / "exact.tif")],
        "gdalwarp -rpc -et 0.125": [*gdalwarp, "-et", "0.125", str(folder / "approximate.tif")],
        OURS: [*ours, str(folder / "ours")],
    }


def _creation(job: Job) -> list[str]:
    """Return gdalwarp's options for a kind of file."""
    form, compression, threads = job
    options = [*COG, *(DEFLATE if compression == "deflate" else ()), f"NUM_THREADS={threads}"] if form == "cog" else []
    return [*(["-of", "COG"] if form == "cog" else []), *(word for option in options for word in ("-co", option))]


def open_mapping(image: str, dem: str, grid: MapGrid) -> OrthoMapping:
    """Return the mapping that `orthorectify` uses by default."""
    opened, surface = open_image(image), open_dem(dem, "ellipsoidal")
    terrain = find_terrain_points(opened, surface)
    return OrthoMapping(opened.rpc, opened.size, surface, terrain, grid, OrthorectifyOptions.error_px)


def position_errors(image: str, dem: str, grid: MapGrid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return errors (px) against GDAL's transformer of the mapping used, of our exact one, and of -et 0.125."""
    mapping = open_mapping(image, dem, grid)
    dataset = gdal.Open(image)
    options = ["METHOD=RPC", f"RPC_DEM={dem}", "DST_SRS=EPSG:32631"]
    transformer = gdal.Transformer(dataset, None, options)
    errors: list[list[np.ndarray]] = [[], []]
    rng = np.random.default_rng(1)
    for window in grid.chunks(*chunk_size(1.0)):
        found = mapping.chunk(window)
        if found is None:
            continue
        at = rng.integers(0, [window.columns, window.rows], (100, 2)).astype(float)
        x = (grid.left + window.column + at[:, 0] + 0.5) * grid.resolution
        y = (grid.top - window.row - at[:, 1] - 0.5) * grid.resolution
        points, good = transformer.TransformPoints(1, np.column_stack([x, y, np.zeros(len(x))]).tolist())
        theirs = np.array(points)[:, :2] - 0.5
        keep = np.array(good, dtype=bool)
        for errors_of, ours in zip(
            errors,
            (found.interpolate(at), mapping.exact(at + window[:2])),
            strict=True,
        ):
            errors_of.append(np.hypot(*(ours - theirs).T)[keep])
    return tuple(np.concatenate(parts) for parts in errors)  # type: ignore[return-value]


def pixels_differ(first: str, second: str) -> str:
    """Return how much two orthoimages differ, as text."""
    a, b = (gdal.Open(path).ReadAsArray().astype(float) for path in (first, second))
    both = (a > 0) & (b > 0)
    difference = np.abs(a - b)[both]
    return (
        f"grey values (both shown {both.mean():.0%}, one only {np.mean((a > 0) != (b > 0)):.2%}): "
        f"mean |difference| {difference.mean():.3f}, 99.9 % {np.percentile(difference, 99.9):.1f}, "
        f"of {a[both].mean():.0f}"
    )


def main() -> None:
    words = {"rough", "quick"} & set(sys.argv[1:])
    with tempfile.TemporaryDirectory() as scratch:
        for size in [int(word) for word in sys.argv[1:] if word not in words] or [5000]:
            compare(Path(os.environ.get("HRSI_ORTHO_SCRATCH") or scratch), size, words)


def compare(folder: Path, size: int, words: set[str]) -> None:
    """Print all tables of an image of size x size pixels."""
    image, smooth = simulated(folder / f"simulated_{size}", size)
    dems = {"DEM of 5.6 m": smooth}
    if "rough" in words:
        dems["DSM of 1 m"] = rough_dem(smooth, str(folder / "rough.tif"))
    for name, dem in dems.items():
        probe = run("orthorectify", images=[image], dem=dem, height_datum="ellipsoidal", resolution=RESOLUTION,
                    output_dir=str(folder / "probe"), overwrite=True, report=False)  # fmt: skip
        entry = next(iter(probe["images"].values()))
        grid = MapGrid.from_bounds(probe["grid"]["wkt"], RESOLUTION, entry["bounds"])
        megapixels = entry["columns"] * entry["rows"] / 1e6
        print(f"\n{name}: {megapixels:.1f} Mpx of map, {entry['shown_pixels'] / 1e6:.1f} Mpx shown, cubic")
        used, exact = position_errors(image, dem, grid)
        for label, errors in (("positions used", used), ("exact positions", exact)):
            print(
                f"  {label} against GDAL's transformer, {len(errors)} pixels: RMS {np.sqrt(np.mean(errors**2)):.2e}"
                f", 99 % {np.percentile(errors, 99):.4f}, largest {errors.max():.4f} px"
            )
        if "quick" not in words:
            in_process(image, dem, grid)
        tables(image, dem, folder, grid, megapixels, "quick" in words)


def in_process(image: str, dem: str, grid: MapGrid) -> None:
    """Print CPU seconds of warping alone, of a square of 1024 pixels in memory: the least of some repetitions.

    The least is what a machine does that is busy with other things too.
    """
    source = OrthoSource(image)
    column, row = grid.columns // 2 - 512, grid.rows // 2 - 512
    west, _, _, north, _, _ = grid.geotransform
    corner = west + column * RESOLUTION, north - row * RESOLUTION
    bounds = corner[0], corner[1] - 1024 * RESOLUTION, corner[0] + 1024 * RESOLUTION, corner[1]
    mapping = open_mapping(image, dem, grid)

    def theirs(error_px: float) -> None:
        gdal.Warp(
            "", image, format="MEM", rpc=True, errorThreshold=error_px, dstSRS=grid.crs, outputBounds=bounds,
            xRes=RESOLUTION, yRes=RESOLUTION, resampleAlg="cubic", transformerOptions=[f"RPC_DEM={dem}"],
        )  # fmt: skip

    def ours() -> None:
        for window in GridWindow(column, row, 1024, 1024).parts(*chunk_size(1.0)):
            chunk = mapping.chunk(window)
            assert chunk is not None
            warp_chunk(source, chunk, window.columns, window.rows, Warp("cubic", 1.0, 0.0))

    ways: dict[str, Callable[[], None]] = {EXACT: lambda: theirs(0.0), "gdalwarp -rpc -et 0.125": lambda: theirs(0.125)}
    ways[OURS] = ours
    least = dict.fromkeys(ways, float("inf"))
    for _ in range(5):
        for name, way in ways.items():
            start = time.process_time()
            way()
            least[name] = min(least[name], time.process_time() - start)
    print("  warping alone, 1.05 Mpx, 1 thread   CPU s/Mpx  times as fast")
    for name, seconds in least.items():
        print(f"  {name:<34}{seconds / 1.048576:11.3f}{least[EXACT] / seconds:15.1f}", flush=True)


HEAD = f"{'CPU s':>8}{'wall s':>8}{'CPU s/Mpx':>11}{'times as fast: CPU':>20}{'wall':>6}"


def tables(image: str, dem: str, folder: Path, grid: MapGrid, megapixels: float, quick: bool) -> None:
    """Print CPU and wall seconds of every way."""
    measured(commands(image, dem, folder, QUICK_JOBS[0], grid)[OURS], 1, folder / "compiled")  # fills Python's cache
    for job in QUICK_JOBS if quick else JOBS:
        form, compression, threads = job
        print(f"  {f'{form}, {compression}, {threads} threads':<28}{HEAD}")
        times: dict[str, tuple[float, float]] = {}
        for _ in range(ROUNDS):
            shutil.rmtree(folder / "ours", ignore_errors=True)  # a finished orthoimage would be kept
            for name, command in commands(image, dem, folder, job, grid).items():
                if not quick or name in (EXACT, OURS):
                    found = measured(command, threads, folder / "compiled")
                    times[name] = min(found, times.get(name, found))
        for name, least in times.items():
            line(name, least, times[EXACT], megapixels)
        start = measured(commands(image, dem, folder, job, grid)[OURS], threads, folder / "compiled")  # keeps the file
        print(f"  {'the program alone':<28}{start[0]:8.2f}{start[1]:8.2f}")
        print("  " + pixels_differ(str(folder / "exact.tif"), str(folder / "ours" / "image_1_ortho.tif")), flush=True)


def line(name: str, times: tuple[float, float], exact: tuple[float, float], megapixels: float) -> None:
    """Print one line of a table."""
    (cpu, wall), (cpu_exact, wall_exact) = times, exact
    print(f"  {name:<28}{cpu:8.2f}{wall:8.2f}{cpu / megapixels:11.3f}{cpu_exact / cpu:20.1f}{wall_exact / wall:6.1f}")


if __name__ == "__main__":
    main()
