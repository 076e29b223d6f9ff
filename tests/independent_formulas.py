"""The formulas of HRSI's outputs, written again from their definitions: NumPy and PROJ, nothing of HRSI.

GDAL, OGR and SQLite only read files. Image coordinates are (sample, line), 0 in the centre of the first pixel; ground
coordinates are lon, lat in degrees and the ellipsoidal height.
"""

import csv
import json
import math
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from osgeo import gdal, ogr
from pyproj import Transformer

#: NSSDA and the normal distribution: CE90 of a circular error from its radial RMSE, LE90 of a height from its RMSE.
CE90_OF_RADIAL = math.sqrt(2.302585092994046)  # chi2(2) quantile 0.9 is 2 ln 10; half of it is for the radial RMSE
LE90 = 1.6448536269514722
MAD_TO_SIGMA = 1.4826022185056018


# ---- cameras ---------------------------------------------------------------------------------------------------------


class Camera:
    """An RPC00B camera from the tag of an image, from its ``_RPC.TXT``, or from a dictionary of that form."""

    def __init__(self, path: str | Path) -> None:
        path = Path(path)
        if path.suffix.upper() == ".TXT":
            value = {
                name.strip(): number.split()[0]
                for name, number in (line.split(":") for line in path.read_text().splitlines() if ":" in line)
            }
            for axis in ("LINE_NUM", "LINE_DEN", "SAMP_NUM", "SAMP_DEN"):
                value[f"{axis}_COEFF"] = " ".join(value[f"{axis}_COEFF_{k}"] for k in range(1, 21))
        else:
            dataset = gdal.Open(str(path))
            value = dataset.GetMetadata("RPC")
            self.size = dataset.RasterXSize, dataset.RasterYSize
        self.value = value
        number = {name: float(text) for name, text in value.items() if re.fullmatch(r"[-+.\deE]+", text.strip())}
        self.err_bias, self.err_rand = number.get("ERR_BIAS"), number.get("ERR_RAND")
        self.offset = np.array([number[f"{name}_OFF"] for name in ("LONG", "LAT", "HEIGHT")])
        self.scale = np.array([number[f"{name}_SCALE"] for name in ("LONG", "LAT", "HEIGHT")])
        self.image_offset = np.array([number["SAMP_OFF"], number["LINE_OFF"]])
        self.image_scale = np.array([number["SAMP_SCALE"], number["LINE_SCALE"]])
        self.coefficients = [
            [np.array([float(one) for one in value[f"{axis}_{part}_COEFF"].split()]) for part in ("NUM", "DEN")]
            for axis in ("SAMP", "LINE")
        ]

    def project(self, ground: Any) -> np.ndarray:
        """Return sample and line, ``(n, 2)``, of ground points ``(n, 3)``."""
        L, P, H = ((np.atleast_2d(ground) - self.offset) / self.scale).T
        terms = np.array([
            np.ones_like(L), L, P, H, L * P, L * H, P * H, L * L, P * P, H * H, P * L * H, L**3, L * P * P, L * H * H,
            L * L * P, P**3, P * H * H, L * L * H, P * P * H, H**3,
        ])  # fmt: skip
        quotients = [(top @ terms) / (bottom @ terms) for top, bottom in self.coefficients]
        return np.column_stack(quotients) * self.image_scale + self.image_offset

    def localize(self, xy: Any, height: Any) -> np.ndarray:
        """Return the ground points ``(n, 3)`` of image points at heights, by Newton's method with differences."""
        xy = np.atleast_2d(np.asarray(xy, dtype=float))
        height = np.broadcast_to(np.asarray(height, dtype=float), len(xy))
        ground = np.column_stack([np.tile(self.offset[:2], (len(xy), 1)), height])
        step = self.scale[:2] * 1e-4
        for _ in range(12):
            at = self.project(ground)
            by = [(self.project(ground + np.r_[d, 0.0]) - at) / d.sum() for d in np.diag(step)]
            jacobian = np.stack(by, axis=2)
            ground[:, :2] += np.linalg.solve(jacobian, (xy - at)[:, :, None])[:, :, 0]
        return ground


# ---- the Earth -------------------------------------------------------------------------------------------------------


@cache
def _frame(lon: float, lat: float, height: float) -> Transformer:
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lon_0={lon!r} +lat_0={lat!r} +h_0={height!r}"
    )


def metres(to: Any, origin: Any) -> np.ndarray:
    """Return east, north, up of positions seen from others, ``(n, 3)``, by PROJ."""
    to, origin = np.atleast_2d(to), np.atleast_2d(origin)
    return np.array([
        _frame(*map(float, here)).transform(*there)
        for here, there in zip(np.broadcast_to(origin, to.shape), to, strict=True)
    ])  # fmt: skip


def moved(ground: Any, offset_m: Any) -> np.ndarray:
    """Return positions moved by metres east, north, up, ``(n, 3)``, by PROJ."""
    ground, offset_m = np.atleast_2d(ground), np.atleast_2d(offset_m)
    ground = np.broadcast_to(ground, (max(len(ground), len(offset_m)), 3))
    offset_m = np.broadcast_to(offset_m, ground.shape)
    return np.array([
        _frame(*map(float, here)).transform(*by, direction="INVERSE")
        for here, by in zip(ground, offset_m, strict=True)
    ])  # fmt: skip


def jacobian(camera: Camera, ground: Any) -> np.ndarray:
    """Return the derivatives of the image points by metres east, north, up, ``(n, 2, 3)``, by differences."""
    ground = np.atleast_2d(ground)
    return np.stack(
        [(camera.project(moved(ground, step)) - camera.project(moved(ground, -step))) / 2.0 for step in np.eye(3)], 2
    )


def to_satellite(camera: Camera, xy: Any, height: float, by_m: float = 100.0) -> np.ndarray:
    """Return unit vectors (east, north, up) from the ground to the satellite at image points, ``(n, 3)``."""
    low = camera.localize(xy, height)
    ray = metres(camera.localize(xy, height + by_m), low)
    return ray / np.linalg.norm(ray, axis=1)[:, None]


# ---- adjustment ------------------------------------------------------------------------------------------------------


def intersect(rays: list[tuple[Camera, np.ndarray]], near: Any, weights: Any = None) -> np.ndarray:
    """Return where rays meet: the weighted least sum of squared image residuals."""
    position = np.array(near, dtype=float)
    root = np.repeat(np.sqrt(np.ones(len(rays)) if weights is None else np.asarray(weights)), 2)
    for _ in range(6):
        miss = np.concatenate([xy - camera.project(position)[0] for camera, xy in rays])
        by = np.concatenate([jacobian(camera, position)[0] for camera, _ in rays])
        position = moved(position, np.linalg.lstsq(by * root[:, None], miss * root, rcond=None)[0])[0]
    return position


def predict(rays: list[tuple[Camera, np.ndarray]], near: Any) -> np.ndarray:
    """Return observed - predicted of each ray, ``(n, 2)``, from the intersection of all others."""
    found = []
    for index, (camera, xy) in enumerate(rays):
        others = rays[:index] + rays[index + 1 :]
        found.append(xy - camera.project(intersect(others, near))[0])
    return np.array(found)


# ---- statistics ------------------------------------------------------------------------------------------------------


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=float)))))


def nmad(values: Any) -> float:
    values = np.asarray(values, dtype=float)
    return float(MAD_TO_SIGMA * np.median(np.abs(values - np.median(values))))


# ---- files -----------------------------------------------------------------------------------------------------------


def table(path: str | Path) -> list[dict[str, str]]:
    with Path(path).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def numbers(row: Any, *names: str) -> np.ndarray:
    return np.array([float(row[name]) for name in names])


def layer(path: str | Path, name: str) -> list[dict[str, Any]]:
    """Return the rows of a layer; ``geometry`` is a list of its coordinates."""
    dataset = ogr.Open(str(path))
    found = dataset.GetLayerByName(name)
    assert found is not None, f"{path} has no layer {name}"
    return [
        feature.items() | {"geometry": json.loads(feature.GetGeometryRef().ExportToJson(["COORDINATE_PRECISION=15"]))}
        if feature.GetGeometryRef() is not None else feature.items()
        for feature in found
    ]  # fmt: skip


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Return path and value of all numbers of a JSON document."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from leaves(part, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for index, part in enumerate(value):
            yield from leaves(part, f"{path}[{index}]")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, value


#: Numbers of every report that repeat what was asked for or what it ran on.
OF_THE_RUN = r"schema|versions\..*|options\..*|settings\..*|seconds\..*|inputs.*|runtime.*"


def compare(found: Any, expected: dict[str, tuple[float, float]], without: dict[str, str]) -> None:
    """Compare all numbers of a document with (value, tolerance); ``without``: patterns that no formula covers, and why.

    A number that is neither expected nor named fails, and so does an expected one that is not there.
    """
    told = dict(leaves(found))
    patterns = [*without, OF_THE_RUN]
    uncovered = [p for p in told if p not in expected and not any(re.fullmatch(one, p) for one in patterns)]
    assert not uncovered, f"no oracle covers {uncovered}"
    missing = [path for path in expected if path not in told]
    assert not missing, f"not in the output: {missing}"
    wrong = [
        f"{path}: {told[path]} and not {value} +- {tolerance}"
        for path, (value, tolerance) in expected.items() if not abs(told[path] - value) <= tolerance
    ]  # fmt: skip
    assert not wrong, "\n".join(wrong)
