"""Blocks without GCPs held by what is free: laser heights, a DEM: `free_control.py [--docs] [--seeds N] [PART …]`."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from osgeo import gdal
from scipy import ndimage

from hrsi.hrsi_engine.ground.geodesy import metres_per_degree
from hrsi.hrsi_engine.io.dems import open_dem
from hrsi.hrsi_engine.io.simulated_block import write_laser_points
from hrsi.hrsi_engine.simulation.laser import LaserSpec, simulate_laser
from hrsi.hrsi_engine.simulation.terrain import Chart, SimulatedTerrain
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.processing_algorithms import run

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "real" / "s2p_triplet_phr"
DSM = DATA / "s2p_reference_dsm.tif"
START_OFF_M = 20.0
EVEN_M, STEEPEST_EVEN = 3.0, 0.4  # at trees and walls ties stand on edges that a DSM of 0.5 m rounds off
AROUND = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (0.5, 0.5), (-0.5, 0.5), (0.5, -0.5), (-0.5, -0.5))
AREA_HALF_M, POST_M, FILLED_M = 230.0, 0.5, 5.0


def dsm_terrain() -> SimulatedTerrain:
    """Return the triplet's DSM as a surface that a simulated laser flies over."""
    dsm = open_dem(str(DSM), "ellipsoidal")
    chart = Chart(5.4429, 43.2617)
    axis = np.arange(-AREA_HALF_M, AREA_HALF_M + POST_M, POST_M)
    east, north = np.meshgrid(axis, axis[::-1])
    place = chart.to_ground(np.column_stack([east.ravel(), north.ravel()]), np.zeros(east.size))
    height = surface_heights(dsm, place[:, :2]).reshape(east.shape)
    away, nearest = ndimage.distance_transform_edt(np.isnan(height), return_indices=True)
    height = np.where(away * POST_M <= FILLED_M, height[tuple(nearest)], np.nan)  # stereo has holes at every wall
    return SimulatedTerrain(chart, height.astype(np.float32), -AREA_HALF_M, AREA_HALF_M, POST_M)


def moved_images(folder: Path, by_m: float) -> list[str]:
    """Write the triplet with RPCs that put all ground higher."""
    paths = []
    for number in (1, 2, 3):
        name = f"img_0{number}.tif"
        copy = gdal.GetDriverByName("GTiff").CreateCopy(str(folder / name), gdal.Open(str(DATA / name)))
        rpc = copy.GetMetadata("RPC")
        rpc["HEIGHT_OFF"] = repr(float(rpc["HEIGHT_OFF"]) + by_m)
        copy.SetMetadata(rpc, "RPC")
        paths.append(str(folder / name))
    return paths


def height_offset_m(layers: str) -> tuple[float, int]:
    """Return the median of adjusted tie points over the DSM, and their number."""
    dataset = gdal.OpenEx(layers, gdal.OF_VECTOR)
    rows = [feature.GetGeometryRef().GetPoint() for feature in dataset.GetLayerByName("ground_points")]
    ground = np.array(rows)
    dsm = open_dem(str(DSM), "ellipsoidal")
    step = EVEN_M / metres_per_degree(ground)[:, :2]
    around = [surface_heights(dsm, ground[:, :2] + step * place) for place in AROUND]
    even = np.ptp(around, axis=0) < EVEN_M * STEEPEST_EVEN
    over = (ground[:, 2] - around[0])[even]
    return float(np.median(over)), len(over)


def triplet(seed: int) -> list[list[str]]:
    """Return rows of what holds the triplet and how high it lies over its DSM, from a start 20 m away."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        laser = simulate_laser(
            dsm_terrain(), AREA_HALF_M, LaserSpec(30, canopy=0.0, segment_m=12.0, clouds=0.03), seed
        ).points
        file = str(folder / "laser.csv")
        write_laser_points(file, laser.select(np.isfinite(laser.ground[:, 2])))
        dem = str(folder / "dem30.tif")
        gdal.Warp(dem, str(DSM), xRes=30.0, yRes=30.0, resampleAlg="average", srcNodata="nan", dstNodata=-9999)
        images = moved_images(folder, START_OFF_M)
        run("tie-points", images=images, output_dir=str(folder / "ties"), csv=True)
        ties = str(folder / "ties" / "tie_points.csv")
        for title, more in (
            ("nothing", {}),
            ("laser", {"laser": file}),
            ("DEM", {"dem": dem, "height_datum": "ellipsoidal", "sigma_dem": 3.0}),
            ("laser and DEM", {"laser": file, "dem": dem, "height_datum": "ellipsoidal"}),
        ):
            start = time.process_time()
            out = folder / title.replace(" ", "_")
            report = run(
                "triangulate", images=images, output_dir=str(out), tie_points=ties, write="none", report=False, **more
            )
            offset, count = height_offset_m(str(out / "block.gpkg"))
            used = report.get("laser", {}).get("used", 0)
            rows.append([title, f"{offset:+.3f}", str(count), str(used), report["verdict"]["level"],
                         f"{time.process_time() - start:.1f}"])  # fmt: skip
            print(rows[-1], flush=True)
            for text in report["warnings"]:
                print("   ", text[:200])
            if title != "nothing":
                print(
                    [
                        (
                            h["source"],
                            h["observations"],
                            h["left_out"],
                            round(h["sigma_m"], 2),
                            round(h["sigma_factor"], 2),
                            round(h["share"], 3),
                            round(h["alone_m"], 3),
                        )
                        for h in report["heights"]
                    ],
                    report.get("laser", {}).get("left_out"),
                )
    return rows


def main() -> None:
    """Print the tables; ``--docs`` writes the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--seeds", type=int, default=100)
    parser.parse_args()
    triplet(1)


if __name__ == "__main__":
    gdal.UseExceptions()
    main()
