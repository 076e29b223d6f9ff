"""Image filters by NumPy and SciPy, for Python installations without OpenCV; described in `pixel_filters`."""

import numpy as np
from scipy import ndimage, sparse

MARGIN_PX = 3  # rows and columns beyond the edge that cubic convolution needs
SAMPLED_AT_A_TIME = 1 << 14  # positions per pass, so that their weights fit into the processor's cache
CUBIC = -0.75  # derivative of the cubic convolution kernel at distance 1 (Keys 1981), as in OpenCV


class ArrayFilters:
    """Filters by NumPy and SciPy, called by the functions of the same names in `pixel_filters`."""

    @staticmethod
    def filter_separable(image: np.ndarray, along_row: np.ndarray, along_column: np.ndarray, border: str) -> np.ndarray:
        for axis, kernel in ((1, along_row), (0, along_column)):
            if len(kernel) > 1 or kernel[0] != 1:
                # Padded rows: with a power of two as row length all pixels of a column compete for the same cache lines
                spare = 24 if image.shape[1] % 256 == 0 else 0
                result = np.empty((image.shape[0], image.shape[1] + spare), image.dtype)[:, : image.shape[1]]
                ndimage.correlate1d(image, np.asarray(kernel, np.float64), axis, result, border)
                image = result
        return np.ascontiguousarray(image)

    @staticmethod
    def blur(image: np.ndarray, sigma_px: float, border: str) -> np.ndarray:
        reach = round(8.0 * sigma_px + 1.0) // 2
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
        kernel /= kernel.sum()
        return ArrayFilters.filter_separable(image, kernel, kernel, border)

    @staticmethod
    def box_mean(image: np.ndarray, side: int) -> np.ndarray:
        return np.asarray(ndimage.uniform_filter(image, side, mode="mirror"))

    @staticmethod
    def erode(mask: np.ndarray, side: int, outside: bool) -> np.ndarray:
        if mask.all():  # the most frequent case
            (rows, columns), half = mask.shape, 0 if outside else side // 2
            eroded = np.zeros_like(mask)
            eroded[half : rows - half, half : columns - half] = True
            return eroded
        return ndimage.minimum_filter(mask.view(np.uint8), side, mode="constant", cval=int(outside)).view(bool)

    @staticmethod
    def compute_local_maximum(image: np.ndarray, radius_px: float) -> np.ndarray:
        reach = int(radius_px)
        rows, columns = image.shape
        around = np.pad(image, reach, constant_values=-np.inf)
        largest = image.copy()
        along_row = around[:, reach : reach + columns].copy()  # maximum of `width` neighbours to both sides
        width = 0
        for away in range(reach, -1, -1):  # rows above and below: the chord of the disc is shortest farthest away
            chord = int(np.sqrt(radius_px**2 - away**2))
            while width < chord:
                width += 1
                for side in (reach - width, reach + width):
                    np.maximum(along_row, around[:, side : side + columns], out=along_row)
            for start in {reach - away, reach + away}:
                np.maximum(largest, along_row[start : start + rows], out=largest)
        return largest

    @staticmethod
    def reduce_by_area(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        by_column, by_row = (_area_shares(old, new) for old, new in zip(image.shape[::-1], size, strict=True))
        return np.ascontiguousarray((by_column @ (by_row @ image).T).T)

    @staticmethod
    def reduce_mask(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        columns, rows = (
            np.minimum(np.floor(np.arange(new) * (old / new)).astype(np.int64), old - 1)
            for old, new in zip(mask.shape[::-1], size, strict=True)
        )
        return mask[rows[:, None], columns]

    @staticmethod
    def enlarge(image: np.ndarray, factor: int) -> np.ndarray:
        by_row, by_column = (_between_pixels(length, factor) for length in image.shape)
        return np.ascontiguousarray((by_column @ (by_row @ image).T).T)

    @staticmethod
    def interpolate(image: np.ndarray, x: np.ndarray, y: np.ndarray, order: int, outside: float | None) -> np.ndarray:
        if outside is None:
            padded = np.pad(image, MARGIN_PX, mode="edge")
        else:
            padded = np.pad(image, MARGIN_PX, constant_values=outside)
        shape, result = x.shape, np.empty(x.size, image.dtype)
        x, y = x.ravel(), y.ravel()
        for start in range(0, len(x), SAMPLED_AT_A_TIME):
            part = slice(start, start + SAMPLED_AT_A_TIME)
            result[part] = _interpolate_part(padded, image.shape, x[part], y[part], order)
        return result.reshape(shape)


def _area_shares(old: int, new: int) -> sparse.csr_matrix:
    """Return the matrix ``(new, old)`` of area weights for reducing a row of ``old`` pixels to ``new`` larger ones."""
    edge = np.linspace(0.0, old, new + 1)
    first = np.floor(edge[:-1]).astype(np.int64)
    pixel = first[:, None] + np.arange(int(np.ceil(old / new)) + 1)
    share = np.minimum(pixel + 1.0, edge[1:, None]) - np.maximum(pixel, edge[:-1, None])
    share = np.where(pixel < old, np.maximum(share, 0.0), 0.0) * (new / old)
    row = np.broadcast_to(np.arange(new)[:, None], pixel.shape)
    entries = share.astype(np.float32).ravel(), (row.ravel(), np.minimum(pixel, old - 1).ravel())
    return sparse.csr_matrix(entries, shape=(new, old))


def _between_pixels(length: int, factor: int) -> sparse.csr_matrix:
    """Return the matrix of linear interpolation from ``length`` pixels to ``factor`` times as many."""
    position = np.clip((np.arange(length * factor) + 0.5) / factor - 0.5, 0.0, length - 1.0)
    first = np.minimum(position.astype(np.int64), max(length - 2, 0))
    second = np.minimum(first + 1, length - 1)
    share = (position - first).astype(np.float32)
    row = np.arange(len(position))
    entries = np.r_[1.0 - share, share].astype(np.float32), (np.r_[row, row], np.r_[first, second])
    return sparse.csr_matrix(entries, shape=(len(position), length))


def _interpolate_part(
    padded: np.ndarray, shape: tuple[int, ...], x: np.ndarray, y: np.ndarray, order: int
) -> np.ndarray:
    x, y = np.clip(x, -1.0, shape[1]), np.clip(y, -1.0, shape[0])
    column, row = (np.rint(at) if order == 0 else np.floor(at) for at in (x, y))
    flat, width = padded.ravel(), padded.shape[1]
    base = (row.astype(np.int64) + MARGIN_PX) * width + column.astype(np.int64) + MARGIN_PX
    if order == 0:
        return flat.take(base)
    of_column, of_row = (_kernel_weights(at - whole, order) for at, whole in ((x, column), (y, row)))
    first = 0 if order == 1 else -1  # offset of the first neighbour from the pixel at or before the position
    base += first * (width + 1)
    total = np.zeros(len(x), np.float32)
    for j, down in enumerate(of_row):
        line = np.zeros(len(x), np.float32)
        for i, across in enumerate(of_column):
            line += across * flat.take(base + (j * width + i))
        total += down * line
    return total


def _kernel_weights(t: np.ndarray, order: int) -> list[np.ndarray]:
    """Return the weights of two pixels (linear) or four (cubic convolution) for the fractional position t."""
    t = t.astype(np.float32)
    if order == 1:
        return [1.0 - t, t]
    s = 1.0 - t
    inner = [((CUBIC + 2.0) * u - (CUBIC + 3.0)) * u * u + 1.0 for u in (t, s)]
    outer = [((CUBIC * u - 5.0 * CUBIC) * u + 8.0 * CUBIC) * u - 4.0 * CUBIC for u in (1.0 + t, 1.0 + s)]
    return [outer[0], *inner, outer[1]]
