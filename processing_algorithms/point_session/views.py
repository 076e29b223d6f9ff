"""What a viewer needs to show a point on an image."""

from __future__ import annotations

from dataclasses import dataclass

from ...hrsi_engine.io.pixel_views import grey_range, pixel_view
from .session import PointSession

STRETCH_HALF_PX = 128


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
    middle = session.predicted(name, image_id) if measured is None else (measured.sample, measured.line)
    image = session.images[image_id]
    if image.raster is None:
        return View("", middle, (0.0, 1.0))
    return View(pixel_view(image.path), middle, grey_range(image.raster, middle, STRETCH_HALF_PX))
