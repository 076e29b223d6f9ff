"""What a viewer needs to show places on the ground on an image, and what it needs to know of them."""

from dataclasses import dataclass

import numpy as np

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.ground.crs_operations import operations_of as operations_of
from ...hrsi_engine.io.rasters.cropping import grey_range, pixel_view
from ...hrsi_engine.io.rasters.dems import open_dem
from ...hrsi_engine.surface.dem import surface_heights
from .rows import PANEL
from .session import PointSession


@dataclass(frozen=True)
class View:
    """An image around a place (sample, line): a source in which map x is the sample and map y minus the line.

    ``source`` is empty for an image without pixels; ``grey_range`` are the grey values to show as black and white.
    """

    source: str
    middle: tuple[float, float]
    grey_range: tuple[float, float]


def view_of(session: PointSession, name: str, image_id: str) -> View:
    """Return the view of a point on an image, around where it was measured, else where it is predicted."""
    measured = session.measured.get((name, image_id))
    middle = session.predict_place(name, image_id) if measured is None else (measured.sample, measured.line)
    image = session.images[image_id]
    if image.raster is None:
        return View("", middle, (0.0, 1.0))
    return View(pixel_view(image.path), middle, grey_range(image.raster, middle, PANEL.half_stretch_px))


def place_on(session: PointSession, image_id: str, lonlat: tuple[float, float], height_m: float) -> tuple[float, float]:
    """Return where an image sees a place on the ground (sample, line), by the last adjustment if there is one."""
    (xy,) = session.project(image_id, np.array([[*lonlat, height_m]]))
    return float(xy[0]), float(xy[1])


def dem_height(dem: str, height_datum: str, lonlat: tuple[float, float]) -> float:
    """Return the ellipsoidal height (m) of a DEM at a place; raise `InputError` where it has none."""
    (height,) = surface_heights(open_dem(dem, height_datum), np.array([lonlat]))
    if not np.isfinite(height):
        raise InputError(f"{dem}: has no height at {lonlat[0]:.6f}, {lonlat[1]:.6f}: type one")
    return float(height)
