"""The real GCPs of the test data as `Control`."""

from pathlib import Path

import numpy as np

from hrsi.hrsi_engine import open_image
from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.refinement.estimate import Control

ZY3_CONTROL = ("1", "2", "11", "21", "26", "31", "41")


def quickbird(real_data: Path) -> tuple[Image, Control]:
    """Return the reduced QuickBird image and its 5 GCPs (Orthority GeoJSON)."""
    folder = real_data / "qb2_gcp"
    image = open_image(str(folder / "qb2_basic1b.tif"))
    tables = read_points(str(folder / "gcps.geojson"), image_ids=[image.id])
    place = {name: row for row, name in enumerate(tables.ground.ids.tolist())}
    ground = tables.ground.ground[[place[name] for name in tables.image.ids.tolist()]]
    return image, Control(ground, tables.image.xy, tables.image.ids)


def ziyuan(real_data: Path) -> dict[str, tuple[Image, Control]]:
    """Return forward and backward image of ZY-3 with the 42 surveyed points (id, lat, lon, h; id, line, sample …)."""
    folder = real_data / "zy3_stereo_gcp"
    image_points = np.loadtxt(folder / "image_points_fwd_bwd.txt", skiprows=1)
    ground_points = np.loadtxt(folder / "ground_points_all42.txt", skiprows=1)
    image_points = image_points[np.argsort(image_points[:, 0])]
    ground_points = ground_points[np.argsort(ground_points[:, 0])]
    assert np.array_equal(image_points[:, 0], ground_points[:, 0])
    ids = ground_points[:, 0].astype(int).astype(str)
    result = {}
    for column, name in ((1, "fwd"), (3, "bwd")):
        image = open_image(str(folder / f"zy301a_{name}_381_6138_rpc.txt"))
        result[name] = image, Control(ground_points[:, [2, 1, 3]], image_points[:, [column + 1, column]], ids)
    return result


def rmse_2d(residual: np.ndarray) -> float:
    """Return sqrt(mean(dx² + dy²))."""
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))
