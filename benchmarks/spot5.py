"""The SPOT 5 image of thesis section 4.4 as a simulation: its 37 GCPs and their printed residuals.

The image itself is not published. A SPOT 5-like pushbroom (832 km, 2.5 m, 24000 x 24000 px) looks at the middle of the
GCPs from 10 degrees off nadir with heading 12 degrees; the GCPs are measured where it sees them, minus the residual
that the thesis prints for the vendor's model. The vendor's RPC is fitted to the same sensor, disturbed by the errors
of table 4.8: position in metres east, north, up, attitude as roll, pitch, yaw.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import pyproj

from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.laboratory.simulation import SENSORS, OrientationError, PushbroomCamera, aim_camera, fit_camera
from hrsi.hrsi_engine.refinement.estimate import Control

SIZE = (24_000, 24_000)
HEADING_DEG, OFF_NADIR_DEG = 12.0, 10.0
HEIGHTS_M = (-100.0, 1000.0)
UTM = 32650  # the zone is not printed: any near the equator gives the same geometry
SIGMA_PX = 1.0  # of a GCP's measurement, as good as a 2.5 m pixel allows; survey 0.2 and 0.3 m
#: Table 4.8: case -> position error of each axis (m), attitude error of each angle (rad). 0 is the undisturbed image.
CASES = {
    0: (0.0, 0.0), 1: (1000.0, 0.1), 2: (100.0, 0.01), 3: (10.0, 0.001), 4: (1000.0, 0.0), 5: (100.0, 0.0),
    6: (10.0, 0.0), 7: (0.0, 0.1), 8: (0.0, 0.01), 9: (0.0, 0.001),
}  # fmt: skip
#: GCPs of each experiment; the rest are check points, with all 37 the GCPs themselves.
CONTROL = {1: ("14",), 3: ("3", "14", "30"), 7: ("3", "11", "14", "15", "21", "25", "30")}


@dataclass(frozen=True, eq=False)
class Spot5:
    """Ids (37,), ground points (37, 3), printed residuals (37, 2): projected minus observed, sample and line."""

    ids: np.ndarray
    ground: np.ndarray
    printed_px: np.ndarray

    @cached_property
    def camera(self) -> PushbroomCamera:
        """The true camera."""
        middle = np.array([*self.ground[:, :2].mean(axis=0), 0.0])
        return aim_camera(SENSORS["spot5"], SIZE, middle, 0.0, OFF_NADIR_DEG, HEADING_DEG)

    @cached_property
    def observed_px(self) -> np.ndarray:
        """Where the GCPs are measured, ``(37, 2)``."""
        return np.asarray(self.camera.ground_to_image(self.ground) - self.printed_px)

    @cached_property
    def _images(self) -> dict[int, Image]:
        return {}

    def image(self, case: int) -> Image:
        """Return the image with the vendor's RPC of a case."""
        if case not in self._images:
            self._images[case] = self._disturbed(case)
        return self._images[case]

    def _disturbed(self, case: int) -> Image:
        position, attitude = CASES[case]
        error = OrientationError(position_m=(position,) * 3, attitude_rad=(attitude,) * 3)
        return Image("spot5", fit_camera(self.camera.disturb(error), HEIGHTS_M).rpc, SIZE)

    def control(self, count: int) -> tuple[Control, Control]:
        """Return control and check points of the experiment with ``count`` GCPs."""
        everything = Control.create(self.ground, self.observed_px, self.ids, SIGMA_PX)
        if count not in CONTROL:
            return everything, everything
        used = np.isin(self.ids, CONTROL[count])
        return everything.select(used), everything.select(~used)


@cache
def read_spot5(folder: Path) -> Spot5:
    """Return the GCPs of ``spot5_gcps.csv``."""
    with open(folder / "spot5_gcps.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    x, y, height = (np.array([float(row[name]) for row in rows]) for name in ("x_m", "y_m", "h_m"))
    lon, lat = pyproj.Transformer.from_crs(UTM, 4326, always_xy=True).transform(x, y)
    printed = [[float(row["sample_residual_px"]), float(row["line_residual_px"])] for row in rows]
    return Spot5(np.array([row["gcp"] for row in rows]), np.column_stack([lon, lat, height]), np.array(printed))


def read_printed_checks(folder: Path) -> dict[int, dict[str, np.ndarray]]:
    """Return number of GCPs -> id -> printed check residuals: bias sample, line, generic sample, line."""
    table: dict[int, dict[str, np.ndarray]] = {}
    with open(folder / "spot5_expected_check_residuals.csv", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            names = ("bias_sample_px", "bias_line_px", "generic_sample_px", "generic_line_px")
            table.setdefault(int(row["n_gcps"]), {})[row["gcp"]] = np.array([float(row[name]) for name in names])
    return table
