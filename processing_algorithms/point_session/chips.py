"""Library of image chips: GCPs that were measured once are found in new images by matching.

A chip has the pixels around a measured GCP, their size on the ground, and the survey of the GCP. In a new image it is
compared with the pixels around the predicted position, resampled by the local geometry of both images: with the metres
east and north of a pixel of the chip, G (2, 2), and the derivatives of the new image's coordinates by metres east and
north, P (2, 2), a step in the chip corresponds to P G times that step in the image. Matching and its tests are those of
points that are transferred between images (`measurement.point_transfer`).

Pictures for recognising a point: photographs of its survey, and chips of its earlier measurements.
"""

import base64
import os
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import Raster
from ...hrsi_engine.drawing.target_chips import draw_target_chip, encode_png
from ...hrsi_engine.ground.geodesy import WGS84, move_ground
from ...hrsi_engine.io.geopackage.declared_layers import ChipRows
from ...hrsi_engine.io.geopackage.layer_tables import replace_layers
from ...hrsi_engine.io.geopackage.layers import Layer
from ...hrsi_engine.io.rasters.images import close_images
from ...hrsi_engine.io.rasters.sun_angles import read_time
from ...hrsi_engine.measurement.point_transfer import Transfer, transfer_point
from ...hrsi_engine.measurement.targets.measuring import make_refusal
from ...hrsi_engine.plausibility.places import SURVEY
from ..files.target_chip import chip_of
from .chip_library import CHIPS, ChipLibrary
from .rows import ROLES, SurveyPoint
from .session import PointSession
from .targets import BY_HAND


def project_with_slopes(session: PointSession, image_id: str, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of ground points ``(n, 3)`` in an image, and their derivatives by metres ``(n, 2, 2)``.

    Rows are sample and line, columns east and north.
    """
    steps = [np.tile(step, (len(ground), 1)) for step in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))]
    places = session.project(image_id, np.concatenate([ground, *(move_ground(ground, step) for step in steps)]))
    seen, *aside = np.split(places, 3)
    return seen, np.stack([place - seen for place in aside], axis=-1)


def differentiate_by_metres(session: PointSession, image_id: str, point: SurveyPoint) -> np.ndarray:
    """Return the derivatives of sample and line (rows) by metres east and north (columns) at a point, ``(2, 2)``."""
    return np.asarray(project_with_slopes(session, image_id, np.array([[point.lon, point.lat, point.height]]))[1][0])


def find_by_chips(session: PointSession, name: str, images: Sequence[str]) -> dict[str, Transfer]:
    """Measure a point in images by matching its chips in the library; return an empty dict if there are none."""
    library, point = session.library, session.points[name]
    if library is None or not len(rows := library.find_rows(point)):
        return {}
    return {image_id: _find_on_image(session, library, rows.tolist(), point, image_id) for image_id in images}


def _find_on_image(
    session: PointSession, library: ChipLibrary, rows: Sequence[int], point: SurveyPoint, image_id: str
) -> Transfer:
    """Match the most similar chips, ``rows`` of the library, in an image; refused if they are found apart."""
    raster = session.images[image_id].raster
    if raster is None:
        return Transfer(refusal="no pixels")
    line = np.array([session.predict_place(point.id, image_id)] * 2)
    by_metres, margin_px = differentiate_by_metres(session, image_id, point), session.estimate_margin_px(image_id)
    by_chip = {row: by_metres @ library.read_geometry(row) for row in rows}
    alike = sorted(rows, key=lambda row: abs(np.log(abs(np.linalg.det(by_chip[row])))))
    found = [
        transfer_point(
            library.read_pixels(row),
            library.read_position(row),
            raster,
            line=line,
            by_first=by_chip[row],
            margin_px=margin_px,
            around_px=CHIPS.half_px,
        )
        for row in alike[: CHIPS.most]
    ]
    best, *others = sorted(found, key=lambda one: (bool(one.refusal), -one.correlation))
    differ = any(np.hypot(*np.subtract(one.xy, best.xy)) > SURVEY.same_target_px for one in others if not one.refusal)
    return Transfer(refusal="its chips are found at different places") if differ else best


def list_library_points(session: PointSession) -> list[SurveyPoint]:
    """Return the GCPs of the library that are in an image of the session and not in its list, each once."""
    library, found = session.library, dict[str, SurveyPoint]()
    if library is None:
        return []
    listed = {row for point in session.points.values() for row in library.find_rows(point).tolist()}
    for point in (library.point(row) for row in range(len(library)) if row not in listed):
        if point.id not in session.points and session.is_seen(point):
            found.setdefault(point.id, point)
    return list(found.values())


def save_chips(session: PointSession) -> int:
    """Add chips of all measured GCPs and check points to the library; return the number of new or changed chips.

    Suspicious measurements are omitted. A chip replaces that of the same point and image.
    """
    if session.library is None:
        return 0
    library = session.library = ChipLibrary(session.library.path)  # read again: other programs may have changed it
    old = library.rows
    keys = list(zip(*(np.asarray(old[name]).tolist() for name in ("id", "image")), strict=True))
    places = zip(*(np.asarray(old[name]).tolist() for name in ("image_sample", "image_line")), strict=True)
    known, made, dates = dict(zip(keys, places, strict=True)), list[dict[str, Any]](), dict[str, str]()
    try:
        for key, measured in session.measured.items():
            point, is_known = session.points[key[0]], known.get(key) == (measured.sample, measured.line)
            if point.role in ROLES[:2] and not is_known and not session.judge(key)[2]:
                made += _cut_chip(session, point, key[1], dates)
    finally:
        close_images()
    if made:
        new, replaced = ChipRows.of_entries(made), {(row["id"], row["image"]) for row in made}
        kept = np.array([key not in replaced for key in keys], dtype=bool)
        library.rows = ChipRows(**{name: np.concatenate([np.asarray(old[name])[kept], new[name]]) for name in new})
        place = np.column_stack([library.rows[name] for name in ("lon", "lat", "height")])
        replace_layers(library.path, [Layer(ChipRows.layer, "PointZ", WGS84, place, library.rows)])
    return len(made)


def _cut_chip(session: PointSession, point: SurveyPoint, image_id: str, dates: dict[str, str]) -> list[dict[str, Any]]:
    """Return the row of a chip in a list, empty if it has no contrast; ``dates`` caches the dates of images."""
    image, measured = session.images[image_id], session.measured[(point.id, image_id)]
    xy = np.array([measured.sample, measured.line])
    low = np.maximum(np.round(xy).astype(int) - CHIPS.half_px, 0)
    high = np.minimum(np.round(xy).astype(int) + CHIPS.half_px + 1, image.size or 0)
    if image.raster is None or (high <= low).any():
        return []
    grey, valid = image.raster.read(*low.tolist(), *(high - low).tolist())
    shown = np.where(valid, grey, np.nan).astype(np.float64)
    darkest, brightest = (np.nanmin(shown), np.nanmax(shown)) if valid.any() else (0.0, 0.0)
    if darkest == brightest:
        return []
    pixels = np.nan_to_num(1.0 + 65534.0 * (shown - darkest) / (brightest - darkest)).round().astype(np.uint16)
    if image_id not in dates:
        time = read_time(image.path)
        dates[image_id] = "" if time is None else f"{time:%Y-%m-%d}"
    ground = np.linalg.inv(differentiate_by_metres(session, image_id, point))  # metres by sample and line
    return [{
        "id": point.id, "image": image_id, "sensor": image.sensor, "acquired": dates[image_id],
        "kind": measured.kind, "sigma_px": measured.sigma, "image_sample": measured.sample,
        "image_line": measured.line, "sample": xy[0] - low[0], "line": xy[1] - low[1],
        "gsd_m": float(np.sqrt(abs(np.linalg.det(ground)))), "east_by_sample_m": ground[0, 0],
        "north_by_sample_m": ground[1, 0], "east_by_line_m": ground[0, 1], "north_by_line_m": ground[1, 1],
        "lon": point.lon, "lat": point.lat, "height": point.height, "sigma_xy": point.sigma_xy,
        "sigma_h": point.sigma_h, "operation": point.operation,
        "pixels": base64.b64encode(encode_png(pixels)).decode("ascii"),
    }]  # fmt: skip


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
    return [
        os.path.join(point.photo, name)
        for name, stem in stems.items()
        if stem == own or stem.startswith((f"{own}_", f"{own}-", f"{own} "))
    ]


def list_pictures(
    session: PointSession, name: str, known: Mapping[Hashable, PointPicture]
) -> dict[Hashable, PointPicture]:
    """Return the pictures of a point by key; pictures that are ``known`` are not made again."""
    point, library = session.points[name], session.library
    made: dict[Hashable, PointPicture] = {
        path: PointPicture(os.path.basename(path), path) for path in list_photos(point)
    }
    try:
        for (other, image_id), measured in session.measured.items():
            raster, xy = session.images[image_id].raster, (measured.sample, measured.line)
            if other == name and raster is not None:
                place = name, image_id, xy
                made[place] = known.get(place) or PointPicture(image_id, svg=_draw_chip(raster, np.array(xy)))
    finally:
        close_images()
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
