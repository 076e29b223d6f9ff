"""Surface models that CARS and s2p make of handed-over projects, compared with the reference of the s2p triplet.

`python benchmarks/hand_over.py [cars s2p heights] [--bin cars=DIR …] [--all-pairs] [--work DIR] [--docs]`: each
program is installed from the package registry in an environment of its own below build/environments, unless --bin
names the folder of its commands. The triplet is adjusted by tie points alone, handed over, and the printed command is
run as it stands; then the same project with the vendor's RPCs in its images, and for CARS with those that its own
``cars-bundleadjustment`` finds. CARS gets the best pair (with --all-pairs all of them, five times as long). What is
finished in --work is not run again; without --work all is run, in a temporary folder. A program that fails gets a row
that says so. With --docs the tables go into docs/how-to/hand-over.md.

The reference was made by s2p with the vendor's RPCs, whose position no GCP controls; refined RPCs lie a little beside
it as a whole. So the median difference is told apart, and the spread also after the best shift in plan and height.
``heights`` says where the vendor's RPCs put the tie points, by pairs of images: they contradict each other.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from osgeo import gdal
from scipy.optimize import least_squares

from hrsi.benchmarks.pages import DOCS, ROOT, make_parser, put_between, render
from hrsi.hrsi_engine.io.geopackage.layer_tables import read_layer_table
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.processing_algorithms import run
from hrsi.tests.conftest import TEST_DATA

PAGE = DOCS / "how-to" / "hand-over.md"
ENVIRONMENTS = ROOT / "build" / "environments"
TRIPLET = TEST_DATA / "real" / "s2p_triplet_phr"
REFERENCE = TRIPLET / "s2p_reference_dsm.tif"
IMAGES = [str(TRIPLET / f"img_0{number}.tif") for number in (1, 2, 3)]
WILD_M = 20.0  # a difference beyond this is a wrong match and not counted in RMSE; completeness leaves it out too


#: What pip installs, one call after another. s2p asks for a pyproj that does not compile any more, and writes np.bool.
PACKAGES = {
    "cars": [["cars==1.3.0", "rpcfit"]],
    "s2p": [
        ["numpy<1.24", "scipy<1.12", "rasterio<1.4", "utm", "pyproj==3.4.1", "beautifulsoup4", "lxml", "plyfile",
         "plyflatten", "ransac", "rpcm", "srtm4", "requests"],
        ["--no-deps", "s2p==1.0b25"],
    ],
}  # fmt: skip
#: Debian packages with what parts of both are compiled with; they are unpacked below the environment, not installed.
HEADERS = ["libfftw3-dev", "libfftw3-double3", "libfftw3-single3", "libgdal-dev", "libtiff-dev", "libtiffxx6",
           "libpng-dev", "libjpeg62-turbo-dev", "zlib1g-dev"]  # fmt: skip
BUILDING = ["setuptools<81", "wheel"]  # their setup.py import pkg_resources, which later ones have not


def installed(program: str) -> str:
    """Return the folder of a program's commands in an environment of its own, which is made where it is missing."""
    environment = ENVIRONMENTS / program
    finished = environment / "installed"
    if not finished.exists():
        environment.mkdir(parents=True, exist_ok=True)
        subprocess.run(["apt-get", "-qq", "download", *HEADERS], cwd=environment, check=True)
        for package in environment.glob("*.deb"):
            subprocess.run(["dpkg", "-x", str(package), str(environment / "debian")], check=True)
        usr = environment / "debian" / "usr"
        libraries = next((usr / "lib").glob("*-linux-gnu"))
        for link in libraries.iterdir():
            if link.is_symlink() and not link.exists():  # to a library that the system has
                target = Path("/usr/lib") / libraries.name / os.readlink(link)
                link.unlink()
                link.symlink_to(target)
        headers = [usr / "include", usr / "include" / libraries.name, usr / "include" / "gdal"]
        constraints = environment / "constraints.txt"  # of the environments in which packages are built, too
        constraints.write_text("\n".join(BUILDING))
        words = os.environ | {
            "CPATH": ":".join(map(str, headers)), "LIBRARY_PATH": str(libraries), "LD_LIBRARY_PATH": str(libraries),
            "PKG_CONFIG_PATH": str(libraries / "pkgconfig"),
            "PATH": f"{usr / 'bin'}:{os.environ['PATH']}",
            "PIP_CONSTRAINT": str(constraints),
        }  # fmt: skip
        subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
        pip = [str(environment / "bin" / "python"), "-m", "pip", "install", "--quiet"]
        for packages in (BUILDING, *PACKAGES[program]):
            subprocess.run([*pip, *packages], check=True, env=words)
        finished.touch()
    return str(environment / "bin")


def adjusted(work: Path) -> Path:
    """Return the triplet's result folder: tie points, no GCPs."""
    folder = work / "result"
    if not folder.exists():
        run("triangulate", images=IMAGES, output_dir=str(folder), report=False)
    return folder


def typed(folder: Path, commands: list[str], result: Path, programs: str) -> None:
    """Run the printed commands in a shell, unless their result is there."""
    if not result.exists():
        compiled_with = ":".join(map(str, Path(programs).parent.glob("debian/usr/lib/*-linux-gnu")))  # s2p's mgm: FFTW
        environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"}
        if compiled_with:
            environment["LD_LIBRARY_PATH"] = compiled_with
        with open(f"{folder}.log", "w", encoding="utf-8") as log:
            subprocess.run(" && ".join(commands), shell=True, check=True, env=environment, stdout=log, stderr=log)


def read_end(folder: Path) -> str:
    """Return the end of what the commands of a project said."""
    return Path(f"{folder}.log").read_text(encoding="utf-8", errors="replace")[-2000:]


def handed(work: Path, target: str, programs: str, best_pair: bool) -> dict[str, Path]:
    """Return the surface models of a target by the RPCs that it got; those that failed are not there."""
    own, vendor = (work / f"{target}_{name}{'_pair' * best_pair}" for name in ("refined", "vendor"))
    if not own.exists():
        run("hand-over", result=str(adjusted(work)), to=target, output_dir=str(own))
        if best_pair:
            configuration = json.loads((own / "cars.json").read_text())
            configuration["input"]["pairing"] = configuration["input"]["pairing"][:1]
            (own / "cars.json").write_text(json.dumps(configuration))
    report = json.loads((own / "report.json").read_text())
    result = Path(report["expected"]).relative_to(own)
    if not vendor.exists():
        shutil.copytree(own, vendor, ignore=shutil.ignore_patterns("out", "tmp"))
        for image in IMAGES:
            shutil.copy(image, vendor)
    made = {"HRSI's": own, "vendor's": vendor}
    for name, folder in made.items():
        try:
            typed(folder, [f"cd {folder}", *report["commands"][1:]], folder / result, programs)
        except subprocess.CalledProcessError:
            print(f"{target} failed with {name} RPCs: {read_end(folder)}")
    return {name: folder / result for name, folder in made.items()}


def bundle_adjusted(work: Path, programs: str, best_pair: bool) -> Path:
    """Return the surface model of CARS with the RPCs of its own bundle adjustment."""
    folder, vendor = (work / f"cars_{name}{'_pair' * best_pair}" for name in ("bundle", "vendor"))
    if not folder.exists():
        shutil.copytree(vendor, folder, ignore=shutil.ignore_patterns("out"))
        whole = json.loads((folder / "cars.json").read_text())
        pairing = [["img_01", "img_02"], ["img_01", "img_03"]]  # each pair begins with an image of those before
        matching = {"decimation_factor": 100, "save_intermediate_data": True}
        whole["tie_points"] = {"applications": {
            "bundle_adjustment": {"pairing": pairing, "separate": False}, "sparse_matching": matching,
        }}  # fmt: skip
        whole["output"] = {"directory": "adjusted"}  # it takes neither CRS nor datum
        (folder / "bundle.json").write_text(json.dumps(whole))
    typed(folder, [f"cd {folder}", "cars-bundleadjustment bundle.json"], folder / "adjusted" / "img_01.geom", programs)
    configuration = json.loads((vendor / "cars.json").read_text())
    for name, sensor in configuration["input"]["sensors"].items():
        sensor["geomodel"] = f"adjusted/{name}.geom"
    (folder / "refined.json").write_text(json.dumps(configuration))
    typed(folder, [f"cd {folder}", "cars refined.json"], folder / "out/dsm/dsm.tif", programs)
    return folder / "out/dsm/dsm.tif"


def intersect(cameras: list, seen: list[np.ndarray], ground: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the least-squares intersections (n, 3) of rays, from near ones, and the RMS of their residuals (px)."""
    for _ in range(6):
        slopes, misfits = [], []
        for camera, xy in zip(cameras, seen, strict=True):
            at = camera.project(ground)
            steps = [ground + step for step in np.diag([1e-6, 1e-6, 1.0])]
            slopes.append(np.stack([camera.project(one) - at for one in steps], axis=2) / [1e-6, 1e-6, 1.0])
            misfits.append(xy - at)
        slope, misfit = np.concatenate(slopes, axis=1), np.concatenate(misfits, axis=1)
        step = np.linalg.solve(slope.swapaxes(1, 2) @ slope, slope.swapaxes(1, 2) @ misfit[..., None])
        ground = ground + step[..., 0]
    return ground, float(np.sqrt(np.mean((misfit - (slope @ step)[..., 0]) ** 2)))


def compare_heights(work: Path) -> list[list[str]]:
    """Return for each pair, and all images: median height by the vendor's RPCs less that by HRSI's, and residuals."""
    folder = adjusted(work)
    ids = [Path(image).stem for image in IMAGES]
    told, known = (read_layer_table(str(folder / "block.gpkg"), f"{name}_points") for name in ("image", "ground"))
    place = dict(zip(known["id"], np.column_stack([known[name] for name in ("lon", "lat", "height")]), strict=True))
    measured: dict[str, dict[str, tuple[float, float]]] = {}
    for name, image, *xy in zip(told["id"], told["image"], told["sample"], told["line"], strict=True):
        measured.setdefault(name, {})[image] = tuple(xy)
    tracks = [name for name, images in measured.items() if set(ids) <= images.keys()]
    ground = np.array([place[name] for name in tracks])
    seen = {image: np.array([measured[name][image] for name in tracks]) for image in ids}
    cameras = {
        whose: {image: read_rpc(str(path / f"{image}.tif")).rpc for image in ids}
        for whose, path in (("vendor's", TRIPLET), ("HRSI's", folder))
    }
    rows = []
    for images in ([ids[0], ids[2]], ids[:2], ids[1:], ids):
        (vendor, before), (own, after) = (
            intersect([of[image] for image in images], [seen[image] for image in images], ground)
            for of in cameras.values()
        )
        higher = float(np.median(vendor[:, 2] - own[:, 2]))
        rows.append([", ".join(images), f"{higher:+.2f}", f"{before:.2f}", f"{after:.2f}"])
    return rows


def heights_of(path: Path, like: gdal.Dataset) -> np.ndarray:
    """Return a surface model on the grid of another one, NaN where it has no height."""
    left, dx, _, top, _, dy = like.GetGeoTransform()
    bounds = (left, top + dy * like.RasterYSize, left + dx * like.RasterXSize, top)
    warped = gdal.Warp("", str(path), format="MEM", outputBounds=bounds, xRes=dx, yRes=-dy, dstNodata=np.nan,
                       resampleAlg="bilinear", dstSRS=like.GetProjection(), outputType=gdal.GDT_Float64)  # fmt: skip
    return np.asarray(warped.ReadAsArray())


def nmad(values: np.ndarray) -> float:
    """Return the normalised median absolute deviation."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def coregistered(difference: np.ndarray, reference: np.ndarray, cell_m: float) -> np.ndarray:
    """Return differences without what a shift of the whole in plan and height explains (Nuth and Kaeaeb 2011)."""
    down, right = np.gradient(reference, cell_m)
    known = np.isfinite(difference) & np.isfinite(down) & np.isfinite(right) & (np.hypot(down, right) < 1.0)
    design = np.column_stack([right[known], down[known], np.ones(known.sum())])
    found = least_squares(lambda x: design @ x - difference[known], np.zeros(3), loss="soft_l1", f_scale=0.3)
    return (difference - (found.x[0] * right + found.x[1] * down + found.x[2]))[known]


def figures(path: Path) -> list[str]:
    """Return a row of figures on a surface model."""
    dataset = gdal.Open(str(REFERENCE))
    reference = dataset.ReadAsArray().astype(np.float64)
    reference[~np.isfinite(reference) | (reference < -1000.0)] = np.nan
    difference = heights_of(path, dataset) - reference
    difference[np.abs(difference) > WILD_M] = np.nan
    complete = np.isfinite(difference).sum() / np.isfinite(reference).sum()
    shifted = coregistered(difference, reference, dataset.GetGeoTransform()[1])
    flat = difference[np.isfinite(difference)]
    middle, rms = float(np.median(flat)), float(np.sqrt(np.mean(flat**2)))
    return [f"{rms:.3f}", f"{middle:+.3f}", f"{nmad(flat):.3f}", f"{np.sqrt(np.mean(shifted**2)):.3f}",
            f"{nmad(shifted):.3f}", f"{complete:.1%}"]  # fmt: skip


def main() -> None:
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("programs", nargs="*", default=["cars", "s2p", "heights"])
    parser.add_argument("--all-pairs", action="store_true", help="CARS: all pairs, not only the best one")
    parser.add_argument("--bin", action="append", default=[], metavar="PROGRAM=DIR", help="where a program lies")
    parser.add_argument("--work", type=Path, help="folder of projects and results that are kept")
    options = parser.parse_args()
    with open_work_folder(options.work) as work:
        compare(work, options)


@contextmanager
def open_work_folder(kept: Path | None) -> Iterator[Path]:
    """Give the folder of projects and results: one that is kept, else a temporary one."""
    if kept:
        kept.mkdir(parents=True, exist_ok=True)
        yield kept.resolve()
        return
    with tempfile.TemporaryDirectory() as work:
        yield Path(work)


def compare(work: Path, options: argparse.Namespace) -> None:
    """Print the tables of the command line's options, and write them into the page if it says so."""
    rows = []
    given = dict(entry.split("=", 1) for entry in options.bin)
    best_pair = not options.all_pairs
    for target in (name for name in options.programs if name != "heights"):
        programs = given.get(target) or installed(target)
        models = handed(work, target, programs, best_pair and target == "cars")
        if target == "cars":
            try:
                models["cars-bundleadjustment's"] = bundle_adjusted(work, programs, best_pair)
            except subprocess.CalledProcessError as error:
                said = read_end(work / f"cars_bundle{'_pair' * best_pair}")
                print(f"cars-bundleadjustment failed ({error.returncode}): {said}")
        rows += [
            [
                f"{target}{', best pair' * (target == 'cars' and best_pair)}",
                name,
                *(figures(path) if path.exists() else ["failed", *[""] * 5]),
            ]
            for name, path in models.items()
        ]
    header = ["program", "RPCs", "RMSE m", "median m", "NMAD m", "RMSE m, shifted", "NMAD m, shifted", "complete"]
    parts = {"surface models": render(header, rows)} if rows else {}
    if "heights" in options.programs:
        header = ["images", "vendor's height less HRSI's, m", "residuals px, vendor's", "HRSI's"]
        parts["heights by pairs"] = render(header, compare_heights(work))
    for part, text in parts.items():
        print(text)
        if options.docs:
            put_between(PAGE, part, text)


if __name__ == "__main__":
    main()
