"""Refined RPCs in other programs: GDAL, rasterio, rpcm, shareloc and orthority project to the same pixel.

``python benchmarks/bridges.py [IMAGE …]`` refines the RPC of each image (of two simulated ones without any) with a
made-up shift and drift, writes it in every format of `write-rpc`, and has each program project the same ground points
with its own reader. The programs are installed from PyPI in an environment of their own, ``build/bridges``, because
their wheels bring a second GDAL; this script runs itself there with ``--read`` for that part. GDAL, and what reads
through it, gets the sidecars beside images that have no RPC of their own.

Conventions: image coordinates of RPCs, GDAL's metadata, rasterio, rpcm and orthority have (0, 0) at the CENTRE of the
first pixel; shareloc adds (0.5, 0.5), and so does GDAL's transformer, because they count from its corner.
"""

import json
import subprocess
import sys
import types
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT, FOLDER = ROOT / "build" / "bridges", ROOT / "build" / "bridges_files"
#: rpcm's optional elevation service does not build everywhere, so it comes without what it depends on.
PACKAGES = (("rasterio", "shareloc", "orthority", "geojson"), ("--no-deps", "rpcm"))
WAYS = ("copy", "sidecar", "rpb", "xml", "geom", "json")
LIMIT_PX = 1e-6
GDAL_READS = (".tif", "_RPC.TXT", ".RPB", ".xml")


def image_of(path: str) -> str:
    """Return the image that a file belongs to: itself, or the one without an RPC of its own beside it."""
    return path if path.endswith(".tif") else str(Path(path).parent / f"{Path(path).stem.removesuffix('_RPC')}.tif")


# ---- with the other programs: run by the interpreter of their environment -----------------------------------------


def by_gdal(path: str, ground: np.ndarray) -> np.ndarray | None:
    """GDAL's transformer, through rasterio's wheel; needs an image."""
    import rasterio
    from rasterio.transform import RPCTransformer

    if not path.endswith(GDAL_READS):
        return None
    with rasterio.open(image_of(path)) as image, RPCTransformer(image.rpcs) as transformer:
        rows, columns = transformer.rowcol(*ground.T, op=lambda value: value)
    return np.column_stack([columns, rows]) - 0.5


def by_rpcm(path: str, ground: np.ndarray) -> np.ndarray | None:
    """rpcm (s2p), with its own readers; srtm4, which it asks for heights, is not needed here."""
    sys.modules.setdefault("srtm4", types.ModuleType("srtm4"))
    import rpcm

    if path.endswith(".tif"):
        rpc = rpcm.rpc_from_geotiff(path)
    elif path.endswith("_RPC.TXT"):
        rpc = rpcm.rpc_from_rpc_file(path)
    elif path.endswith(".json"):
        rpc = rpcm.RPCModel(json.loads(Path(path).read_text())["rpc"], dict_format="rpcm")
    else:
        return None
    return np.column_stack(rpc.projection(*ground.T))


def by_shareloc(path: str, ground: np.ndarray) -> np.ndarray | None:
    """shareloc (CARS); its readers take GDAL's formats and ``.geom``, and count from the pixel's corner."""
    from shareloc.geomodels import GeoModel

    if not path.endswith((*GDAL_READS, ".geom")):
        return None
    row, column, _ = GeoModel(path if path.endswith(".geom") else image_of(path)).inverse_loc(*ground.T)
    return np.column_stack([column, row]) - 0.5


def by_orthority(path: str, ground: np.ndarray) -> np.ndarray | None:
    """orthority, through its reader of images."""
    from orthority import param_io
    from orthority.camera import RpcCamera

    if not path.endswith(GDAL_READS):
        return None
    parameters = next(iter(param_io.read_im_rpc_param([image_of(path)]).values()))
    camera = RpcCamera(parameters["im_size"], parameters["rpc"], crs="EPSG:4979")
    return camera.world_to_pixel(ground.T.copy()).T


READERS = {"GDAL": by_gdal, "rpcm": by_rpcm, "shareloc": by_shareloc, "orthority": by_orthority}


def read_all(request: str) -> None:
    """Print the image points that each program gives, as JSON."""
    files, points = (json.loads(Path(request).read_text())[key] for key in ("files", "points"))
    found: dict[str, dict[str, list | str | None]] = {}
    for path, name in files.items():
        ground = np.array(points[name])
        found[path] = {}
        for program, read in READERS.items():
            try:
                xy = read(path, ground)
                found[path][program] = None if xy is None else np.asarray(xy, dtype=float).tolist()
            except Exception as error:  # whatever another program raises is the result here
                found[path][program] = f"{type(error).__name__}: {error}"
    print(json.dumps(found))


# ---- here ------------------------------------------------------------------------------------------------------


def interpreter() -> Path:
    """Return the Python of the environment of the other programs, made where it is missing."""
    python = ENVIRONMENT / "bin" / "python"
    if not (ENVIRONMENT / "complete").exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(ENVIRONMENT)], check=True)
        for packages in PACKAGES:
            subprocess.run([str(python), "-m", "pip", "install", "--quiet", *packages], check=True)
        (ENVIRONMENT / "complete").touch()
    return python


def simulated() -> list[Path]:
    """Return two small simulated images."""
    from hrsi.processing_algorithms import run

    run("simulate", images=2, size=128, seed=5, output_dir=str(FOLDER / "simulated"), overwrite=True)
    return sorted((FOLDER / "simulated").glob("image_*.tif"))


def prepare(paths: list[Path]) -> tuple[dict[str, str], dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Write every refined RPC every way; return files by image id, ground points, and where HRSI projects them."""
    from hrsi.hrsi_engine.io.rasters.images import open_image
    from hrsi.hrsi_engine.io.rpc_files import write_rpc_text
    from hrsi.hrsi_engine.refinement import MODELS
    from hrsi.processing_algorithms import run

    values = np.array([3.21, 1e-4, -2e-4, -7.65, 5e-5, 1.5e-4])  # such as an adjustment gives
    files, points, expected = {}, {}, {}
    for path in paths:
        image = open_image(str(path))
        rpc = MODELS["affine"].compute_refined_rpc(image, values).rpc
        (FOLDER / "refined").mkdir(parents=True, exist_ok=True)
        new = FOLDER / "refined" / f"{image.id}_RPC.TXT"
        write_rpc_text(str(new), rpc)
        low, high = rpc.height_range
        grid = image.grid_px(7, 7)
        points[image.id] = np.concatenate([rpc.localize(grid, h).ground for h in np.linspace(low, high, 5)])
        expected[image.id] = rpc.project(points[image.id])
        for way in WAYS:
            report = run(
                "write-rpc", images=[str(path)], rpc=str(new), write=way, overwrite=True,
                output_dir=str(FOLDER / way),
            )  # fmt: skip
            output = report["images"][image.id]["output"]
            files[output] = image.id
            if way != "copy" and output.endswith(GDAL_READS):
                bare_image(image_of(output), image.size)
    return files, points, expected


def bare_image(path: str, size: tuple[int, int]) -> None:
    """Write an empty image without RPC."""
    from osgeo import gdal

    Path(path).unlink(missing_ok=True)
    gdal.GetDriverByName("GTiff").Create(path, *size, 1, gdal.GDT_Byte, ["SPARSE_OK=TRUE"]).FlushCache()


def main(arguments: list[str]) -> int:
    """Print the table; return 1 where a program differs or fails."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    files, points, expected = prepare([Path(name) for name in arguments] or simulated())
    request = FOLDER / "request.json"
    request.write_text(json.dumps({"files": files, "points": {name: p.tolist() for name, p in points.items()}}))
    told = subprocess.run(
        [str(interpreter()), __file__, "--read", str(request)], check=True, capture_output=True, text=True
    )
    found = json.loads(told.stdout.splitlines()[-1])
    bad = False
    print(f"{'file':<34}" + "".join(f"{name:>13}" for name in READERS) + "   largest difference, px")
    for path, image_id in files.items():
        cells = []
        for answer in found[path].values():
            if isinstance(answer, str):
                print(f"  {answer}")
            apart = np.nan if answer is None or isinstance(answer, str) else _apart(answer, expected[image_id])
            bad |= isinstance(answer, str) or apart > LIMIT_PX
            cells.append(f"{'-' if answer is None else 'fails' if isinstance(answer, str) else f'{apart:.1e}':>13}")
        print(f"{Path(path).parent.name + '/' + Path(path).name:<34}" + "".join(cells))
    print("all within 1e-6 px" if not bad else "DIFFERENCES")
    return int(bad)


def _apart(answer: list, expected: np.ndarray) -> float:
    return float(np.abs(np.array(answer) - expected).max())


if __name__ == "__main__":
    if sys.argv[1:2] == ["--read"]:
        read_all(sys.argv[2])
    else:
        sys.exit(main(sys.argv[1:]))
