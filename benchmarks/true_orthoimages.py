"""True orthoimages and mosaics of simulated cities against the truth: ``true_orthoimages.py [--docs] [SEED …]``.

Three images of a city look 15 degrees forward, 3 and 20 back. Their RPCs have the errors of a vendor; `triangulate`
refines them with 2000 tie points, 20 GCPs of 2 cm, and the surface as `--dem` with 0.1 m. So the block lies on the
surface, as it does on one that was made from the block. They are orthorectified on this surface, and a mosaic is made
of them. What an image shows is what the renderer drew: the first intersection of the true ray of the pixel with the
surface.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from osgeo import gdal, ogr

from hrsi.benchmarks.pages import DOCS, put_between, render
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.ground.crs_operations import operations_of
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.laboratory.simulation.pushbroom import PushbroomCamera
from hrsi.hrsi_engine.laboratory.simulation.surface import compute_ray_paths, meet_surface
from hrsi.hrsi_engine.laboratory.simulation.synthesis import BlockSimulation, simulate_block
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.interface.declare import fill_options
from hrsi.processing_algorithms.laboratory.declarations.simulate import SimulateOptions
from hrsi.processing_algorithms.laboratory.simulate import make_views

SEEDS = (11, 21, 22)
CITY: dict[str, Any] = {
    "landform": "city",
    "images": 3,
    "along": ("-15", "3", "20"),
    "gcps": 20,
    "checks": 0,
    "ties": 2000,
    "noise_gcp_xy": 0.02,
    "noise_gcp_h": 0.02,
}

PAGE = DOCS / "protocols/true_orthoimages.md"


def simulate(folder: Path, seed: int, size: int) -> BlockSimulation:
    """Write a city; return its truth."""
    options = {**CITY, "seed": seed, "size": size}
    run("simulate", output_dir=str(folder), **{**options, "along": ",".join(CITY["along"])})
    given = fill_options(SimulateOptions, {**options, "output_dir": ""})
    return simulate_block(given.scene, make_views(given.views, given.vendor, given.scene), given.points, given.noise)


class Truth:
    """What an image truly shows on the pixels of an orthoimage or mosaic, ``(rows, columns)``."""

    def __init__(self, simulated: BlockSimulation, image_id: str, grid: gdal.Dataset) -> None:
        self.camera: PushbroomCamera = simulated.truth.cameras[simulated.index(image_id)]
        west, self.step_m, _, north, _, _ = grid.GetGeoTransform()
        x = west + self.step_m * (0.5 + np.arange(grid.RasterXSize))
        y = north - self.step_m * (0.5 + np.arange(grid.RasterYSize))
        self.shape, self.xy = (len(y), len(x)), np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self._to_wgs84 = operations_of(grid.GetProjection()).to_wgs84
        terrain = simulated.scene.terrain
        lonlat = self._to_wgs84(np.pad(self.xy, ((0, 0), (0, 1))))[:, :2]
        self.ground = np.column_stack([lonlat, terrain.height_at(lonlat)])
        self.image = self.camera.ground_to_image(self.ground)
        inside = ((self.image > -0.5) & (self.image < np.array(self.camera.size) - 0.5)).all(axis=1)
        above = np.zeros(len(self.ground))
        for rows in np.array_split(np.flatnonzero(inside), 20):
            above[rows] = meet_surface(compute_ray_paths(self.camera, terrain, self.image[rows]), terrain)
        above[inside] -= self.ground[inside, 2]
        self.inside, self.hidden = inside.reshape(self.shape), (inside & (above > 0.02)).reshape(self.shape)

    def displacement_px(self, rpc: RPC, rows: np.ndarray) -> np.ndarray:
        """Return how far what an RPC shows at pixels is from its true position, ``(n, 2)`` in pixels of the map."""
        error = rpc.project(self.ground[rows]) - self.image[rows]
        jacobian = []
        for shift in (self.step_m, 0.0), (0.0, -self.step_m):
            lonlat = self._to_wgs84(np.pad(self.xy[rows] + shift, ((0, 0), (0, 1))))[:, :2]
            moved = self.camera.ground_to_image(np.column_stack([lonlat, self.ground[rows, 2]]))
            jacobian.append(moved - self.image[rows])
        return np.asarray(np.linalg.solve(np.stack(jacobian, axis=-1), error[..., None])[..., 0])


def read_labels(seamlines: str, names: list[str], grid: gdal.Dataset) -> np.ndarray:
    """Return the number of the image of each pixel by the polygons of the seamlines, from 0; -1: none."""
    labels = gdal.GetDriverByName("MEM").Create("", grid.RasterXSize, grid.RasterYSize, 1, gdal.GDT_Int16)
    labels.SetGeoTransform(grid.GetGeoTransform())
    labels.GetRasterBand(1).Fill(-1)
    source = ogr.Open(seamlines)
    for number, name in enumerate(names):
        layer = source.ExecuteSQL(f"SELECT * FROM seamlines WHERE id = '{name}'")
        gdal.RasterizeLayer(labels, [1], layer, burn_values=[number])
    return np.asarray(labels.ReadAsArray())


def study(folder: Path, seed: int, size: int) -> tuple[list[list[str]], list[str]]:
    """Return the rows of a city's images, and the row of its mosaic."""
    simulated = simulate(folder / "city", seed, size)
    names = [image.id for image in simulated.block.images]
    city = {name: str(folder / "city" / f"{name}.tif") for name in names}
    dem: dict[str, Any] = {"dem": str(folder / "city" / "dem.tif"), "height_datum": "ellipsoidal", "report": False}
    run(
        "triangulate",
        images=list(city.values()),
        gcps=str(folder / "city" / "ground_points.csv"),
        tie_points="none",
        image_points=str(folder / "city" / "image_points.csv"),
        dem=dem["dem"],
        sigma_dem=0.1,
        height_datum="ellipsoidal",
        report=False,
        output_dir=str(folder / "refined"),
    )
    refined = [str(folder / "refined" / f"{name}.tif") for name in names]
    dem |= {"mosaic": True, "extent": "union"}
    reports = {
        state: run("orthorectify", images=refined, visibility=state == "true", output_dir=str(folder / state), **dem)
        for state in ("usual", "true")
    }
    rows, counts = [], np.zeros(3, dtype=int)
    grid = gdal.Open(reports["true"]["mosaic"]["output"])
    truths = [Truth(simulated, name, grid) for name in names]
    for name, truth in zip(names, truths, strict=True):
        is_shown = gdal.Open(reports["true"]["images"][name]["output"]).ReadAsArray() > 0
        hidden, area = truth.hidden.sum(), truth.inside.sum()
        masked = (truth.inside & ~truth.hidden & ~is_shown).sum()
        ghosts = (truth.hidden & is_shown).sum()
        counts += hidden, ghosts, masked
        incidence_deg = reports["true"]["mosaic"]["incidence_deg"][name]
        counted = [f"{hidden / area:.2%}", str(hidden), str(ghosts), f"{masked / area:.2%}"]
        rows.append([f"{seed}, {name}", f"{incidence_deg:.1f}", *counted])
    rows.append([f"{seed}, all", "", "", str(counts[0]), f"{counts[1]} ({counts[1] / counts[0]:.2%})", ""])
    hidden_anywhere = np.any([truth.hidden for truth in truths], axis=0)
    ghosts_of = {}
    for state, report in reports.items():
        labels = read_labels(report["mosaic"]["seamlines"], names, gdal.Open(report["mosaic"]["output"]))
        wrong = np.any([truth.hidden & (labels == number) for number, truth in enumerate(truths)], axis=0)
        ghosts_of[state] = (wrong & hidden_anywhere).sum() / hidden_anywhere.sum()
    # Pairs of neighbouring pixels from two images
    left, right = labels[:, :-1].ravel(), labels[:, 1:].ravel()
    pixel = np.arange(labels.size).reshape(labels.shape)[:, :-1].ravel()
    at_seam = (left != right) & (left >= 0) & (right >= 0)
    rpcs = [open_image(path).rpc for path in refined]
    shifts = np.array([truth.displacement_px(rpc, pixel[at_seam]) for truth, rpc in zip(truths, rpcs, strict=True)])
    order = np.arange(at_seam.sum())
    apart = np.hypot(*(shifts[left[at_seam], order] - shifts[right[at_seam], order]).T)
    unfilled = reports["true"]["mosaic"]["unfilled_pixels"] / np.any([truth.inside for truth in truths], axis=0).sum()
    row = [str(seed), f"{ghosts_of['usual']:.2%}", f"{ghosts_of['true']:.2%}", f"{unfilled:.2%}", str(at_seam.sum()),
           f"{np.median(apart):.3f}", f"{np.percentile(apart, 95):.3f}", f"{apart.max():.3f}"]  # fmt: skip
    return rows, row


def draw(folder: Path, path: Path, side: int = 340) -> None:
    """Draw a part of the most oblique orthoimage as usual and without ghosts, and of the mosaic, pixel by pixel."""
    import cv2

    files = [
        folder / "usual" / "image_3_ortho.tif",
        folder / "true" / "image_3_ortho.tif",
        folder / "true" / "mosaic.tif",
    ]
    views = [gdal.Open(str(file)) for file in files]
    west, step, _, north, _, _ = views[0].GetGeoTransform()
    columns, rows = views[0].RasterXSize, views[0].RasterYSize
    x, y = west + step * (columns - side) // 2, north - step * (rows - side) // 2
    parts = []
    for view in views:
        left, _, _, top, _, _ = view.GetGeoTransform()
        grey = view.ReadAsArray(round((x - left) / step), round((top - y) / step), side, side).astype(float)
        parts += [np.clip((grey - 150.0) / 4.5, 0, 255), np.full((side, 6), 255.0)]
    cv2.imwrite(str(path), np.hstack(parts[:-1]).astype(np.uint8))


def main() -> None:
    """Print the tables, or write the page and its picture."""
    words = [word for word in sys.argv[1:] if word != "--docs"]
    size, images, mosaics = 560, [], []
    for seed in [int(word) for word in words] or SEEDS:
        with tempfile.TemporaryDirectory() as folder:
            rows, row = study(Path(folder), seed, size)
            images += rows
            mosaics.append(row)
            if "--docs" in sys.argv and len(mosaics) == 1:
                draw(Path(folder), DOCS / "pictures" / "true_orthoimages.png")
    of_images = render(["seed, image", "incidence, degrees", "hidden", "hidden px", "ghosts px", "masked"], images)
    head = [
        "seed",
        "ghosts without",
        "ghosts",
        "unfilled",
        "pixels at seamlines",
        "misregistration: median px",
        "95 % px",
    ]
    of_mosaics = render([*head, "largest px"], mosaics)
    if "--docs" in sys.argv:
        put_between(PAGE, "images", of_images)
        put_between(PAGE, "mosaics", of_mosaics)
    print(of_images, of_mosaics, sep="\n\n")


if __name__ == "__main__":
    main()
