"""Pictures for recognising a point: photographs of its survey, and chips of its earlier measurements."""

import os
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...hrsi_engine.block.block import Raster
from ...hrsi_engine.drawing.target_chips import draw_target_chip
from ...hrsi_engine.io.rasters.images import close_images
from ...hrsi_engine.measurement.targets.measuring import make_refusal
from ..files.target_chip import chip_of
from .rows import SurveyPoint
from .session import PointSession
from .targets import BY_HAND

PHOTO_ENDINGS = (".jpg", ".jpeg", ".png", ".webp", ".gif", ".bmp", ".tif", ".tiff")


@dataclass(frozen=True)
class PointPicture:
    """A photograph (``path``) or a chip (``svg``) of a point, with a title."""

    title: str
    path: str = ""
    svg: str = ""


def list_photos(point: SurveyPoint) -> list[str]:
    """Return the photographs of a point: the named file, or the files of a folder whose names begin with its id."""
    if not os.path.isdir(point.photo):
        return [point.photo] if os.path.isfile(point.photo) else []
    names = [name for name in sorted(os.listdir(point.photo)) if name.lower().endswith(PHOTO_ENDINGS)]
    stems = {name: os.path.splitext(name)[0].casefold() for name in names}
    own = point.id.casefold()
    fitting = [
        name for name in names if stems[name] == own or stems[name].startswith((f"{own}_", f"{own}-", f"{own} "))
    ]
    return [os.path.join(point.photo, name) for name in fitting]


def list_pictures(
    session: PointSession, name: str, known: Mapping[Hashable, PointPicture]
) -> dict[Hashable, PointPicture]:
    """Return the pictures of a point by key; pictures that are ``known`` are not made again."""
    point, made = session.points[name], dict[Hashable, PointPicture]()
    for path in list_photos(point):
        made[path] = PointPicture(os.path.basename(path), path)
    try:
        for (other, image_id), measured in session.measured.items():
            raster, xy = session.images[image_id].raster, (measured.sample, measured.line)
            if other == name and raster is not None:
                place = name, image_id, xy
                made[place] = known.get(place) or PointPicture(image_id, svg=_draw_chip(raster, np.array(xy)))
    finally:
        close_images()
    library = session.library
    for row in [] if library is None else library.find_rows(point).tolist():
        if library is not None and (name, library.rows.image[row]) not in session.measured:
            key = library.path, row, len(library)
            title = " ".join(filter(None, (str(library.rows.image[row]), str(library.rows.acquired[row]))))
            made[key] = known.get(key) or PointPicture(
                title, svg=_draw_chip(library.read_pixels(row), library.read_position(row))
            )
    return made


def _draw_chip(raster: Raster, xy: np.ndarray) -> str:
    """Return the pixels around a measured position, with a cross there, as SVG."""
    return draw_target_chip(replace(chip_of(make_refusal(BY_HAND, BY_HAND), xy, raster), position=xy))
