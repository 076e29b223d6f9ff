"""Places of an orthoimage worth looking for: the most textured spot of every cell of a grid over the images' ground."""

from collections.abc import Sequence

import numpy as np

from ...block.block import Image
from ...block.orthoimage import Orthoimage
from ...foundation.pixel_filters import SCHARR, blur, box_mean, compute_smaller_eigenvalue, erode, slopes
from ...surface.dem import HeightSurface, Status, intersect_surface, surface_heights
from .predicted_patches import PATCH, read_means


def choose_places(
    images: Sequence[Image], reference: Orthoimage, surface: HeightSurface, points: int, window_px: int
) -> np.ndarray:
    """Return lon, lat, height ``(m, 3)`` of places, about ``points`` of them in each image."""
    rays = [intersect_surface(image.rpc, image.grid_px(PATCH.rays, PATCH.rays), surface) for image in images]
    below = [ground[status == Status.FOUND] for ground, status in rays if (status == Status.FOUND).any()]
    if not below:
        return np.zeros((0, 3))
    # Areas in the orthoimage's pixels of the upright boxes around what the images show
    extents = [np.ptp(reference.to_pixels(ground[:, :2]), axis=0) for ground in below]
    cell = max(float(np.sqrt(min(np.prod(np.maximum(extent, 1.0)) for extent in extents) / points)), 4.0)
    px_per_m = float(images[0].rpc.px_per_m(below[0][len(below[0]) // 2][None])[0])
    step = max(round(1.0 / px_per_m / reference.gsd_m), 1)
    # Column and row of the cells that an image sees; evenly thinned out where there are too many
    pixels = np.concatenate([reference.to_pixels(ground[:, :2]) for ground in below])
    size = np.array(reference.raster.size)
    inside = np.all((pixels >= 0.0) & (pixels < size), axis=1)
    # The positions and their neighbours half a cell away: rays may be farther apart than cells
    steps = np.array([[x, y] for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)]) * cell
    dense = np.unique(np.floor((pixels[inside][:, None] + steps).reshape(-1, 2) / cell).astype(np.int64), axis=0)
    last = np.floor((size - 1) / cell)
    dense = dense[np.all((dense >= 0) & (dense <= last), axis=1)]
    cells = dense[:: max(len(dense) // PATCH.most_cells, 1)]
    spots, texture = [], []
    for column, row in cells:
        spot = _find_best_spot(reference, column * cell, row * cell, cell, step, window_px)
        if spot is not None:
            spots.append(spot[0])
            texture.append(spot[1])
    if not spots:
        return np.zeros((0, 3))
    strong = np.array(texture) > PATCH.flat * np.median(texture)
    lonlat = reference.to_lonlat(np.array(spots)[strong])
    ground = np.column_stack([lonlat, surface_heights(surface, lonlat)])
    return ground[np.isfinite(ground[:, 2])]


def _find_best_spot(
    reference: Orthoimage, left: float, top: float, cell: float, step: int, window_px: int
) -> tuple[np.ndarray, float] | None:
    """Return the pixel position of a cell's most textured window and its texture; None where it shows nothing."""
    looked = int(min(cell / step, PATCH.cell_px))
    margin = window_px // 2 + 2
    side = max(looked, 1) + 2 * margin
    start = np.floor(np.array([left, top]) + 0.5 * cell - 0.5 * step * side).astype(int)
    grey, valid = read_means(reference.raster, int(start[0]), int(start[1]), step * side, step * side, step)
    if not valid.any():
        return None
    # The smaller eigenvalue of the structure tensor over a window around each pixel; 0 where not all is valid.
    # Gradient lengths count by their square root: one bright roof is no better than a whole field pattern.
    gx, gy = slopes(blur(grey, 1.0), *SCHARR)
    damp = 1.0 / np.maximum(np.sqrt(np.hypot(gx, gy)), 1e-6)
    xx, yy, xy = (box_mean(a * b * damp**2, window_px) for a, b in ((gx, gx), (gy, gy), (gx, gy)))
    least = compute_smaller_eigenvalue(xx, yy, xy)
    whole = erode(valid, window_px, outside=False)
    texture = np.where(whole, np.maximum(least, 0.0), 0.0)[margin:-margin, margin:-margin]
    row, column = np.unravel_index(int(np.argmax(texture)), texture.shape)
    if texture[row, column] <= 0.0:
        return None
    return start + step * (margin + np.array([column, row])) + (step - 1) / 2.0, float(texture[row, column])
