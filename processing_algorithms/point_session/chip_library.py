"""Library of image chips, `chips.gpkg`: pixels around measured GCPs, with their survey."""

import base64
import os

import numpy as np

from ...hrsi_engine.block.block import ArrayRaster
from ...hrsi_engine.drawing.target_chips import decode_png
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.ground.geodesy import metres_per_degree
from ...hrsi_engine.io.geopackage.declared_layers import ChipRows
from ...hrsi_engine.io.geopackage.layer_tables import read_layer_table
from ...hrsi_engine.plausibility.places import SURVEY
from .rows import ROLES, SurveyPoint


@thresholds
class CHIPS:
    """Size of chips, their assignment to points, and number compared."""

    half_px: int = threshold(64, "px", "half side of a chip, sufficient for images of a third of its resolution")
    same_place_m: float = threshold(0.5, "m", "largest distance of a chip with another id")
    most: int = threshold(6, "chips", "largest number compared for a point, most similar pixel sizes first")


class ChipLibrary:
    """Chips of the GeoPackage ``path`` as columns ``rows``; empty if the file does not exist."""

    def __init__(self, path: str) -> None:
        self.path, found = path, dict.fromkeys(ChipRows.declared, np.empty(0))
        if os.path.exists(path):
            found = read_layer_table(path, ChipRows.layer)
            if missing := [name for name in ChipRows.declared if name not in found]:
                raise InputError(f"{path}: layer {ChipRows.layer!r} has no field {missing[0]!r}: name another file")
        self.rows = ChipRows(**{name: found[name] for name in ChipRows.declared})

    def __len__(self) -> int:
        return len(self.rows.id)

    def point(self, row: int) -> SurveyPoint:
        """Return the GCP of a chip."""
        names = ("lon", "lat", "height", "sigma_xy", "sigma_h")
        lon, lat, height, sigma_xy, sigma_h = (float(self.rows[name][row]) for name in names)
        operation = str(self.rows.operation[row])
        return SurveyPoint(
            id=str(self.rows.id[row]),
            lon=lon,
            lat=lat,
            height=height,
            role=ROLES[0],
            sigma_xy=sigma_xy,
            sigma_h=sigma_h,
            operation=operation,
        )

    def find_rows(self, point: SurveyPoint) -> np.ndarray:
        """Return the rows of a point's chips ``(k,)``: chips of its id near it, and chips of any id at its position."""
        here = np.array([[point.lon, point.lat, point.height]])
        places = np.column_stack([self.rows.lon, self.rows.lat])
        away_m = np.hypot(*((places - here[:, :2]) * metres_per_degree(here)[:, :2]).T)
        limit_m = np.where(np.asarray(self.rows.id) == point.id, SURVEY.same_id_m, CHIPS.same_place_m)
        return np.flatnonzero(away_m <= limit_m)

    def read_pixels(self, row: int) -> ArrayRaster:
        """Return the pixels of a chip; the value 0 means no pixel."""
        grey = decode_png(base64.b64decode(str(self.rows.pixels[row])))
        return ArrayRaster(grey.astype(np.float32), grey > 0)

    def read_position(self, row: int) -> np.ndarray:
        """Return the position of the point in a chip: sample, line ``(2,)``."""
        return np.array([self.rows.sample[row], self.rows.line[row]], dtype=np.float64)

    def read_geometry(self, row: int) -> np.ndarray:
        """Return the metres east and north (rows) per sample and line (columns) of a chip, ``(2, 2)``."""
        names = ("east_by_sample_m", "east_by_line_m", "north_by_sample_m", "north_by_line_m")
        return np.array([self.rows[name][row] for name in names], dtype=np.float64).reshape(2, 2)
