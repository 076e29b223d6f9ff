"""Measures the target near a click in an image: its centre or corner, with a chip that shows the fit."""

import math
from dataclasses import dataclass

import numpy as np

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.drawing.target_chips import draw_target_chip
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.rasters.images import close_images
from ...hrsi_engine.measurement.interest_points.gravity_centres import CENTRE
from ...hrsi_engine.measurement.targets.measuring import TARGET_CENTER, make_refusal, measure_target
from ...hrsi_engine.plausibility.places import SURVEY
from ..files.target_chip import chip_of
from .rows import ImageMeasurement

BY_HAND = "point"
#: Error of identifying the surveyed point with the centre of an object, and of the cameras' models, in px: the sigma
#: of a fit, about 0.01 px, does not include them, and would make every click an outlier among other measurements.
IDENTIFICATION_PX = 0.1


@dataclass(frozen=True)
class Fit:
    """Result of a click: the measurement, or the reason why it was refused, and a chip (SVG) in both cases."""

    measured: ImageMeasurement
    refusal: str
    chip_svg: str


def fit_target(image: Image, click: tuple[float, float], kind: str, is_seen: bool = True) -> Fit:
    """Measure the target near a click (sample, line) as `measure-targets` does; ``point`` uses the click itself.

    A ``center`` must be that of a clear shape that covers the click, or nearly so. In texture without a shape, the
    click itself is used if the user has seen the point (``is_seen``), otherwise the measurement is refused.

    Raises `InputError` for an image without pixels.
    """
    xy = np.array(click, dtype=np.float64)
    try:
        made = None if kind == BY_HAND or image.raster is None else measure_target(image.raster, xy, kind)
        if made is not None and kind == TARGET_CENTER and not made.refusal:
            reach_px = np.hypot(*(made.edges - made.xy).T).max() + SURVEY.same_target_px
            if made.quality < CENTRE.strong_quality or np.hypot(*(made.xy - xy)) > reach_px:
                made = make_refusal(kind, "no clear closed object lies there")
        on_image = image.size is None or ((xy > -0.5) & (xy < np.array(image.size) - 0.5)).all()
        if made is not None and kind == TARGET_CENTER and made.refusal and is_seen and on_image:
            made, kind = None, BY_HAND
        if kind == BY_HAND:
            shown = make_refusal(kind, BY_HAND)
            chip = "" if image.raster is None else draw_target_chip(chip_of(shown, xy, image.raster))
            return Fit(ImageMeasurement(float(xy[0]), float(xy[1]), kind=kind), "", chip)
        if made is None or image.raster is None:
            raise InputError(f"{image.id} has no pixels to measure on: enter sample and line in the table")
        sigma_px = math.hypot(made.sigma_px, IDENTIFICATION_PX)
        measured = ImageMeasurement(float(made.xy[0]), float(made.xy[1]), sigma_px, made.kind, float(made.quality))
        return Fit(measured, made.refusal, draw_target_chip(chip_of(made, xy, image.raster)))
    finally:
        close_images()  # open files cannot be replaced on all systems
