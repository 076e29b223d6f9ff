"""Tables as CSV files that appear whole or not at all."""

import csv
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..block.points import ImagePoints
from .safety.replacing import replacing


def write_csv(path: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a table as CSV.

    Parameters
    ----------
    path : str
        The file, replaced in one step.
    header : sequence of str
        Names of the columns.
    rows : iterable of sequences
        Their values.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def write_measurements(path: str, points: ImagePoints) -> None:
    """Write image points: id, image, sample, line, sigma, kind, and quality where it is known."""
    columns = {
        "id": points.ids, "image": points.image_ids, "sample": points.xy[:, 0], "line": points.xy[:, 1],
        "sigma": points.sigma_px, "kind": points.kind,
    }  # fmt: skip
    if np.isfinite(points.quality).any():
        columns["quality"] = points.quality
    write_csv(path, list(columns), zip(*(column.tolist() for column in columns.values()), strict=True))
