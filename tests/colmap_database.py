"""Databases of COLMAP, written as its documentation tells."""

import sqlite3
from pathlib import Path

import numpy as np


def write_database(
    path: Path, keypoints: dict[str, np.ndarray], matches: dict[tuple[int, int], list], verified: dict | None = None
) -> str:
    """Write a database with COLMAP's tables; keypoints as COLMAP counts, image_id from 1 in the order of names."""
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER)")
        columns = "rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB"
        database.execute(f"CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, {columns})")
        for number, (name, xy) in enumerate(keypoints.items(), 1):
            rows = np.column_stack([xy, np.ones((len(xy), 4))]).astype("<f4")  # x, y and an affine shape
            database.execute("INSERT INTO images VALUES (?, ?, 1)", (number, name))
            database.execute("INSERT INTO keypoints VALUES (?, ?, ?, ?)", (number, len(xy), 6, rows.tobytes()))
        for table, pairs in (("matches", matches), ("two_view_geometries", verified or {})):
            database.execute(f"CREATE TABLE {table} (pair_id INTEGER PRIMARY KEY, {columns})")
            for (a, b), index in pairs.items():
                rows = np.array(index, dtype="<u4").reshape(-1, 2)
                values = (2147483647 * a + b, len(rows), 2, rows.tobytes())
                database.execute(f"INSERT INTO {table} VALUES (?, ?, ?, ?)", values)
    return str(path)
