"""Draw docs/pictures/before_after.png: two orthoimages over each other, with the original and the refined RPCs.

``python docs/make_before_after.py`` after ``make demo-images``. Fields of a chessboard alternate between orthoimages
of two images; both halves show the same ground at one scale, so that streets and walls break at the edges of the fields
where the RPCs are wrong.
"""

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from osgeo import gdal

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "build" / "demo-images"
PAIR = ("image_1_ortho.tif", "image_2_ortho.tif")
SIZE_PX, FIELD_PX, PIXEL_M = 400, 100, 0.7
#: Shift of the picture from the middle of the area, in pixels east and south: houses and streets.
PLACE_PX = (60, 120)


def read_window(path: Path, easting: float, northing: float) -> np.ndarray:
    """Return SIZE_PX x SIZE_PX grey values around a position of the map."""
    dataset = gdal.Open(str(path))
    west, pixel, _, north, _, _ = dataset.GetGeoTransform()
    column, row = round((easting - west) / pixel) - SIZE_PX // 2, round((north - northing) / pixel) - SIZE_PX // 2
    return dataset.ReadAsArray(column, row, SIZE_PX, SIZE_PX).astype(float)


def draw_chessboard(folder: Path, easting: float, northing: float) -> np.ndarray:
    """Return the windows of both orthoimages in alternating fields."""
    first, second = (read_window(folder / name, easting, northing) for name in PAIR)
    rows, columns = np.indices(first.shape) // FIELD_PX
    return np.where((rows + columns) % 2, second, first)


def main() -> None:
    """Write the picture."""
    dataset = gdal.Open(str(IMAGES / "ortho" / PAIR[0]))
    west, pixel, _, north, _, _ = dataset.GetGeoTransform()
    easting = west + pixel * (dataset.RasterXSize / 2 + PLACE_PX[0])
    northing = north - pixel * (dataset.RasterYSize / 2 + PLACE_PX[1])
    figure, axes = plt.subplots(1, 2, figsize=(10, 5.45), dpi=100)
    titles = ("original RPCs: 20 px apart", "refined RPCs: 0.06 px apart")
    for axis, folder, title in zip(axes, ("ortho-before", "ortho"), titles, strict=True):
        board = draw_chessboard(IMAGES / folder, easting, northing)
        axis.imshow(board, cmap="gray", vmin=np.percentile(board, 1), vmax=np.percentile(board, 99))
        axis.set_title(title, fontsize=13)
        axis.set_xticks([]), axis.set_yticks([])
        axis.plot([20, 20 + 50 / PIXEL_M], [SIZE_PX - 18] * 2, color="yellow", linewidth=4)
        axis.text(20, SIZE_PX - 26, "50 m", color="yellow", fontsize=12)
    figure.tight_layout(pad=0.6)
    figure.savefig(ROOT / "docs" / "pictures" / "before_after.png")


if __name__ == "__main__":
    main()
