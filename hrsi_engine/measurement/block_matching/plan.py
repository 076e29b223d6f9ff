"""Which windows of a reference image are matched, so that all of it gets points at a bounded cost.

An image up to 2048 px is matched everywhere. Of a larger one every cell of a grid gets a small window, and further
ones where the first gives too little (water, cloud, nodata): a fraction of the pixels is read.
"""

from itertools import pairwise

from ...block.block import Image
from .star import Cell
from .windows import TIE_WINDOWS, ImageWindow


def is_matched_everywhere(image: Image, step: int = 1) -> bool:
    """Tell whether all of an image is matched."""
    return max(image.known_size) <= TIE_WINDOWS.full_px * step


def plan_cells(image: Image, cells: int, per_cell: int, step: int = 1) -> list[list[Cell]]:
    """Return the cells of an image, a list for each row of them: rows share the lines that are read.

    step : pixels per pixel that windows are read at; windows cover ``step`` times as many pixels
    """
    if is_matched_everywhere(image, step):
        size, rows = image.known_size, []
        for top, lines in _divide_length(size[1], TIE_WINDOWS.full_window_px * step):
            row = []
            for left, samples in _divide_length(size[0], TIE_WINDOWS.full_window_px * step):
                own = ImageWindow(left, top, samples, lines)
                row.append(Cell((own.grow(TIE_WINDOWS.overlap_px * step).inside(size),), (own,), 0, 0))
            rows.append(row)
        return rows
    return _plan_samples(image, cells, per_cell, step)


def _divide_length(length: int, side: int) -> list[tuple[int, int]]:
    """Return start and length of equal parts of about a side's length."""
    count = max(1, round(length / side))
    edges = [length * k // count for k in range(count + 1)]
    return [(start, end - start) for start, end in pairwise(edges)]


def _plan_samples(image: Image, cells: int, per_cell: int, step: int) -> list[list[Cell]]:
    size, side = image.known_size, TIE_WINDOWS.window_px * step
    columns, rows = (max(1, min(cells, length // side)) for length in size)
    grid = []
    for r in range(rows):
        row = []
        for c in range(columns):
            left, right = size[0] * c // columns, size[0] * (c + 1) // columns
            top, bottom = size[1] * r // rows, size[1] * (r + 1) // rows
            windows = tuple(
                ImageWindow(sample, line, side, side).inside(size)
                for sample, line in _place_windows(left, right, top, bottom, side, size)
            )
            row.append(Cell(windows, windows, per_cell, TIE_WINDOWS.surplus * per_cell))
        grid.append(row)
    return grid


def _place_windows(
    left: int, right: int, top: int, bottom: int, side: int, size: tuple[int, int]
) -> list[tuple[int, int]]:
    """Return where windows of a cell are tried: the file's tile in the middle first, then others far from it."""
    samples, lines = (
        [at for at in range(first // side * side, last, side) if at >= first - side // 2 and at + side // 2 <= last]
        or [max(0, min((first + last - side) // 2, most - side))]
        for first, last, most in ((left, right, size[0]), (top, bottom, size[1]))
    )
    middle = ((left + right - side) / 2.0, (top + bottom - side) / 2.0)
    places = [(sample, line) for line in lines for sample in samples]
    places.sort(key=lambda place: (place[0] - middle[0]) ** 2 + (place[1] - middle[1]) ** 2)
    chosen = places[:1]
    while len(chosen) < min(TIE_WINDOWS.attempts, len(places)):  # the one farthest from those that are chosen
        rest = [place for place in places if place not in chosen]
        chosen.append(max(rest, key=lambda place: min((place[0] - s) ** 2 + (place[1] - t) ** 2 for s, t in chosen)))
    return chosen
