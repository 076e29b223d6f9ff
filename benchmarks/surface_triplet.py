"""A displaced Pleiades triplet on a DSM without GCPs: `surface_triplet.py [VECTORS]`.

The RPCs of s2p's triplet (HRSI_TEST_DATA, see CONTRIBUTING.md) are displaced by random vectors of 5 to 40 m in three
dimensions, and adjusted with s2p's reference DSM (0.5 m cells, standard deviation taken for 1 m), and with the mean of
its heights in cells of 30 m (3 m), as only control. The judge is not the matching of HRSI: SciPy's Nelder-Mead moves
the adjusted tie points over the reference DSM of 0.5 m until the NMAD of their height differences is smallest.
"""

import argparse
import tempfile
import time
from dataclasses import replace

import numpy as np
import pyproj
from osgeo import gdal
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from hrsi.benchmarks.pages import render
from hrsi.benchmarks.real_blocks import DATA
from hrsi.hrsi_engine import AdjustOptions, adjust, find_tie_points, judge, open_image
from hrsi.hrsi_engine.adjustment import Adjustment
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, Image, Role
from hrsi.hrsi_engine.io.rasters.dems import open_dem

FOLDER = DATA / "real" / "s2p_triplet_phr"
DSM = FOLDER / "s2p_reference_dsm.tif"
CELL_M = 30.0


def displace_rpc(image: Image, offset_m: np.ndarray) -> Image:
    """Return an image whose RPC puts everything ``offset_m (3,)`` east, north, up of where it is."""
    rpc = image.rpc
    lat_m = np.radians(6378137.0)  # metres of a degree, to 0.5 % of some metres
    moved = replace(
        rpc, long_off=rpc.long_off + offset_m[0] / lat_m / np.cos(np.radians(rpc.lat_off)),
        lat_off=rpc.lat_off + offset_m[1] / lat_m, height_off=rpc.height_off + offset_m[2],
    )  # fmt: skip
    return replace(image, rpc=moved)


def draw_vectors(count: int) -> np.ndarray:
    """Return vectors ``(count, 3)`` of 5 to 40 m in directions that are uniform on the sphere."""
    rng = np.random.default_rng(40)
    directions = rng.normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1)[:, None] * rng.uniform(5.0, 40.0, (count, 1))


class Judge:
    """The reference DSM, read by GDAL, interpolated by SciPy."""

    def __init__(self) -> None:
        dataset = gdal.Open(str(DSM))
        self.origin, self.heights = dataset.GetGeoTransform(), dataset.ReadAsArray().astype(np.float64)
        self.to_utm = pyproj.Transformer.from_crs("EPSG:4979", dataset.GetProjection(), always_xy=True)

    def find_offset(self, ground: np.ndarray) -> np.ndarray:
        """Return how far ``ground (n, 3)`` lies east, north, up of the DSM."""
        east, north, up = self.to_utm.transform(*ground.T)

        def differences(plan: np.ndarray) -> np.ndarray:
            column = (east - plan[0] - self.origin[0]) / self.origin[1] - 0.5
            row = (north - plan[1] - self.origin[3]) / self.origin[5] - 0.5
            miss = up - map_coordinates(self.heights, [row, column], order=1, cval=np.nan)
            return miss[np.isfinite(miss)]

        def spread(plan: np.ndarray) -> float:
            miss = differences(plan)
            return float(1.4826 * np.median(np.abs(miss - np.median(miss))))

        grid = [np.array([e, n]) for e in np.arange(-6.0, 6.1, 0.5) for n in np.arange(-6.0, 6.1, 0.5)]
        start = min(grid, key=spread)
        simplex = start + 0.5 * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        plan = minimize(spread, start, method="Nelder-Mead", options={"initial_simplex": simplex, "xatol": 0.005}).x
        return np.append(plan, np.median(differences(plan)))


def write_degraded(folder: str) -> str:
    """Write the DSM as means of cells of 30 m; return the file."""
    path = f"{folder}/dsm_30m.tif"
    gdal.Warp(path, str(DSM), xRes=CELL_M, yRes=CELL_M, resampleAlg="average", srcNodata="nan", dstNodata="nan")
    return path


def adjust_on(block: Block, dem: str, sigma_m: float, search_m: float) -> tuple[Adjustment, float]:
    """Return the adjusted block and its CPU seconds."""
    began = time.process_time()
    options = AdjustOptions(dem=open_dem(dem, "ellipsoidal"), sigma_dem_m=sigma_m, surface_search_m=search_m)
    result = adjust(block, replace(options, reject_sigma=4.0))
    return result, time.process_time() - began


def measure(count: int) -> tuple[list[list[str]], list[list[str]]]:
    """Return the rows of each displacement, and of each surface."""
    images = [open_image(str(FOLDER / f"img_0{k}.tif")) for k in (1, 2, 3)]
    ties = find_tie_points(images).image_points
    rows, sums, judge_dsm = [], [], Judge()
    with tempfile.TemporaryDirectory() as folder:
        for name, dem, sigma_m in (("0.5 m", str(DSM), 1.0), ("30 m", write_degraded(folder), 3.0)):
            errors, bounds, spent = [], [], []
            for offset in draw_vectors(count):
                block = assemble([displace_rpc(image, offset) for image in images], [], [ties])
                result, seconds = adjust_on(block, dem, sigma_m, 100.0)
                _, without = adjust_on(block, dem, sigma_m, 0.0)
                error = judge_dsm.find_offset(result.ground[result.block.points.role == Role.TIE])
                reasons = [reason.code for reason in judge(result).reasons]
                part = result.parts[0]
                errors.append([np.hypot(*error[:2]), abs(error[2])])
                bounds.append([part.ce90_m, part.le90_m])
                spent.append(seconds - without)
                away, up = (f"{np.hypot(*offset[:2]):.1f}", f"{offset[2]:+.1f}")
                rows.append([
                    name, away, up, *(f"{one:.2f}" for one in errors[-1]), *(f"{one:.2f}" for one in bounds[-1]),
                    f"{spent[-1]:.1f}", ", ".join(reasons),
                ])  # fmt: skip
                print(rows[-1], flush=True)
            errors, bounds = np.array(errors), np.array(bounds)
            within = (errors <= bounds).sum(axis=0)
            sums.append([
                name, *(f"{one:.2f}" for one in (*errors.max(axis=0), *np.median(bounds, axis=0))),
                *(f"{one} of {count}" for one in within), f"{max(spent):.1f}",
            ])  # fmt: skip
    return rows, sums


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("vectors", nargs="?", type=int, default=12)
    options = parser.parse_args()
    rows, sums = measure(options.vectors)
    print(render(("cells", "displaced m", "up m", "left m", "up m", "CE90 m", "LE90 m", "CPU s", "reasons"), rows))
    head = ("cells", "worst in plan m", "in height m", "CE90 m", "LE90 m", "within CE90", "within LE90", "CPU s")
    print(render(head, sums))


if __name__ == "__main__":
    main()
