"""A session as tables of the engine, and as a file: a GeoPackage with images, ground_points and image_points."""

import json
import os
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ...hrsi_engine.block.assembly import stack_image_points
from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.exposures import join_exposures
from ...hrsi_engine.block.imaging_geometry import compute_footprint
from ...hrsi_engine.block.points import ROLE_LABELS, GroundPoints, ImagePoints, Role
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.json_values import json_text
from ...hrsi_engine.ground.geodesy import WGS84
from ...hrsi_engine.ground.operation_uses import read_entry
from ...hrsi_engine.io.geopackage.declared_layers import GroundPointRows, ImagePointRows, ImageRows
from ...hrsi_engine.io.geopackage.layer_tables import layer_names, replace_layers, text_columns
from ...hrsi_engine.io.geopackage.layers import Layer
from ...hrsi_engine.io.output_dir import read_report
from ...hrsi_engine.io.point_files import read_points
from ...hrsi_engine.io.point_files.find import read_table, split_spec
from ...hrsi_engine.io.point_files.positions import SURVEYED
from ...hrsi_engine.io.rasters.images import close_images, open_image
from ...hrsi_engine.results.layers import block_layers, name_point_operations
from .rows import ROLES, TIE, ImageMeasurement, SurveyPoint
from .session import PointSession


def ground_points(session: PointSession, names: Collection[str] | None = None) -> GroundPoints:
    """Return the points of the list, or only those with the ``names``."""
    points = [point for point in session.points.values() if names is None or point.id in names]
    operations = list(dict.fromkeys(point.operation for point in points if point.operation))
    number = np.array([operations.index(one.operation) if one.operation else -1 for one in points], dtype=np.int16)
    table = GroundPoints(
        [point.id for point in points],
        np.array([[point.lon, point.lat, point.height] for point in points]).reshape(-1, 3),
        np.array([int(Role[point.role.upper()]) for point in points], dtype=np.int8),
        np.array([[point.sigma_xy, point.sigma_h] for point in points]).reshape(-1, 2),
        "the list of points",
    )
    uses = (read_entry(json.loads(one), int((number == k).sum())) for k, one in enumerate(operations))
    return replace(table, operation=number, operations=tuple(uses))


def image_points(session: PointSession, names: Collection[str] | None = None) -> ImagePoints:
    """Return the measurements of the points of the list, or only of those with the ``names``."""
    keys = [key for key in session.measured if names is None or key[0] in names]
    rows = [session.measured[key] for key in keys]
    return ImagePoints(
        [name for name, _ in keys],
        [image for _, image in keys],
        np.array([[row.sample, row.line] for row in rows]).reshape(-1, 2),
        np.array([row.sigma for row in rows], dtype=np.float64),
        np.array([row.kind for row in rows], dtype=str),
        np.array([row.quality for row in rows], dtype=np.float64),
    )


def images_layer(session: PointSession) -> Layer:
    """Return the layer of the images' footprints at the mean height of the points."""
    images = list(session.images.values())
    heights = [point.height for point in session.points.values()] or [image.middle_height_m for image in images]
    height = float(np.mean(heights))
    columns = ImageRows(
        id=np.array([image.id for image in images], dtype=str),
        path=np.array([image.path for image in images], dtype=str),
        samples=np.array([image.size[0] if image.size else 0 for image in images], dtype=np.int64),
        lines=np.array([image.size[1] if image.size else 0 for image in images], dtype=np.int64),
        observations=np.zeros(len(images), dtype=np.int64),
        footprint_height_m=np.full(len(images), height),
    )
    return Layer("images", "Polygon", WGS84, [compute_footprint(image, height) for image in images], columns)


def point_layers(session: PointSession) -> list[Layer]:
    """Return the layers ``ground_points`` and ``image_points`` of the present state, without residuals."""
    known = ground_points(session)
    unknown = np.full(len(known), np.nan)
    # All measurements, also of tie points; at the surveyed positions if there are any
    measured = stack_image_points([image_points(session), *([] if session.ties is None else [session.ties])])
    ids, xy = np.asarray(measured.ids), measured.xy
    index = {name: row for row, name in enumerate(known.ids.tolist())}
    at = np.array([index.get(name, -1) for name in ids.tolist()], dtype=np.int64)
    ground = GroundPointRows(
        id=known.ids,
        role=ROLE_LABELS[known.role],
        height=known.ground[:, 2],
        sigma_east_m=unknown,
        sigma_north_m=unknown,
        sigma_height_m=unknown,
        rays=np.bincount(at[at >= 0], minlength=len(known)),
        # The survey, for any geometry of the layer
        survey_lon=known.ground[:, 0],
        survey_lat=known.ground[:, 1],
        survey_height=known.ground[:, 2],
        sigma_xy=known.sigma_m[:, 0],
        sigma_h=known.sigma_m[:, 1],
    )
    place = np.vstack([known.ground, np.full((1, 3), np.nan)])[at]
    roles = np.append(ROLE_LABELS[known.role], "tie")[at]
    nothing = np.full(len(ids), np.nan)
    columns = ImagePointRows(
        id=ids, role=roles, image=np.asarray(measured.image_ids), sample=xy[:, 0], line=xy[:, 1],
        sigma_px=measured.sigma_px, kind=measured.kind, quality=measured.quality,
        residual_sample_px=nothing, residual_line_px=nothing, sigma_sample_px=nothing, sigma_line_px=nothing,
        weight=nothing, flag=np.full(len(ids), ""),
    )  # fmt: skip
    return [
        Layer("ground_points", "PointZ", WGS84, known.ground, ground, name_point_operations(known)),
        Layer("image_points", "PointZ", WGS84, place, columns),
    ]


_ROLES = {Role.CHECK: "check", Role.OFF: "off", Role.TIE: TIE, Role.HELD_OUT: TIE}


def open_block(path: str) -> PointSession:
    """Open the GeoPackage of a session or of a result of `triangulate`, `adjust` or `refine-rpc`.

    The session's ``model`` is that of the report in the same folder, if there is one.

    Raises `InputError` if a layer is missing, or an image is not found.
    """
    names = layer_names(path)
    missing = [name for name in ("images", "ground_points", "image_points") if name not in names]
    if missing:
        raise InputError(f"{path}: has no layer {missing[0]!r}: open the block.gpkg of a result, or begin a new one")
    # The files of the images: as named, or in the folder of the GeoPackage
    folder, found = os.path.dirname(os.path.abspath(path)), []
    for file in text_columns(path, "images", ("path",))["path"]:
        candidates = (file, os.path.join(folder, file), os.path.join(folder, os.path.basename(file)))
        if not (existing := [name for name in candidates if name and os.path.exists(name)]):
            raise InputError(
                f"{path}: its image {file!r} is missing: restore it, or copy it into the folder of the GeoPackage"
            )
        found.append(existing[0])
    images = _open_images(found)
    ids = [image.id for image in images]
    ground = read_points(f"{path}|layername=ground_points", image_ids=ids).ground if names["ground_points"] else None
    image = read_points(f"{path}|layername=image_points", image_ids=ids).image if names["image_points"] else None
    session = _make_session(images, ground, image, path, _read_tie_list(path))
    report = read_report(os.path.join(os.path.dirname(path), "report.json")) or {}
    session.model = str(report.get("model") or "")
    gcps = str((report.get("options") or {}).get("gcps") or "")
    with suppress(InputError):  # a file of another program, or without photographs
        if os.path.exists(split_spec(gcps)[0]):
            find_photos(session, gcps)
        columns = text_columns(path, "ground_points", ("id", "photo"))
        _enter_photos(session, folder, dict(zip(columns["id"], columns["photo"], strict=True)))
    return session


def _read_tie_list(path: str) -> set[str]:
    """Return the tie points that the user placed: only these have their own position next to the adjusted one."""
    with suppress(InputError):  # of another program, without these columns
        if layer_names(path)["ground_points"]:
            columns = text_columns(path, "ground_points", ("id", "role", "survey_lon"))
            rows = zip(columns["id"], columns["role"], columns["survey_lon"], strict=True)
            return {name for name, role, placed in rows if role == TIE and placed}
    return set()


def new_session(
    images: Sequence[str],
    gcps: str = "",
    image_points: str = "",
    ground_crs: str | None = None,
    height_datum: str = "layer",
) -> PointSession:
    """Return a session of image files and, if given, files of ground and image points."""
    opened = _open_images(images)
    ids = [image.id for image in opened]
    tables = [
        read_points(source, ground_crs=ground_crs, height_datum=height_datum, image_ids=ids)
        for source in (gcps, image_points)
        if source
    ]
    measured = [table.image for table in tables if table.image is not None]
    session = _make_session(opened, tables[0].ground if gcps else None, measured[-1] if measured else None, "")
    if gcps and session.points:
        find_photos(session, gcps)
    session.sources = {
        "images": [os.path.abspath(path) for path in images],
        "gcps": gcps,
        "image_points": image_points,
        "ground_crs": ground_crs,
        "height_datum": height_datum,
    }
    return session


def find_photos(session: PointSession, source: str) -> None:
    """Enter the photographs that a file of points names in its field ``photo``, relative to its folder.

    Without such a field they are in the folder ``photos`` next to the file, if it exists.
    """
    columns, folder = read_table(source).columns, os.path.dirname(os.path.abspath(split_spec(source)[0]))
    photos = columns.get("photo", np.full(len(columns["id"]), ""))
    _enter_photos(session, folder, dict(zip(columns["id"].tolist(), photos.tolist(), strict=True)))


def _enter_photos(session: PointSession, folder: str, named: Mapping[str, str]) -> None:
    """Enter the photographs or folders of photographs that exist, ``named`` by point id relative to a folder."""
    for name, point in session.points.items():
        path = os.path.normpath(os.path.join(folder, named.get(name) or "photos"))
        if name in named and os.path.exists(path):
            session.points[name] = replace(point, photo=path)


def read_ground_points(source: str) -> list[SurveyPoint]:
    """Return the ground points of a layer or file, for adding them to a session."""
    ground = read_points(source).ground
    if ground is None:
        raise InputError(f"{source}: contains no ground positions: name another layer")
    return _survey_points(ground)


def save(session: PointSession, path: str = "") -> None:
    """Save a session, with the residuals of its adjustment if nothing was edited since; other layers are kept."""
    target = path or session.path
    if not target:
        raise InputError("the block has no file yet: name one")
    layers = {layer.name: layer for layer in (images_layer(session), *point_layers(session))}
    adjusted = session.adjusted
    if adjusted is not None and session.is_adjusted:
        plain = layers
        layers = {layer.name: layer for layer in block_layers(adjusted.result, adjusted.left)}
        # Mark the tie points of the list among the ground points, by their own position
        ground = layers["ground_points"]
        columns = {name: np.array(ground.fields[name], dtype=np.float64) for name in SURVEYED}
        for row, name in enumerate(np.asarray(ground.fields["id"]).tolist()):
            point = session.points.get(name)
            if point is not None and point.role == TIE:
                columns["survey_lon"][row], columns["survey_lat"][row] = point.lon, point.lat
                columns["survey_height"][row] = point.height
        layers["ground_points"] = replace(ground, fields=GroundPointRows(**{**ground.fields, **columns}))
        # … and add points that were not used: those with the role off, or in no image
        layers |= {name: _with_others(layers[name], plain[name]) for name in ("ground_points", "image_points")}
    if any(point.photo for point in session.points.values()):
        layer = layers["ground_points"]
        photos = [session.points[name].photo if name in session.points else "" for name in layer.fields["id"].tolist()]
        layers["ground_points"] = replace(layer, fields={**layer.fields, "photo": np.array(photos, dtype=str)})
    replace_layers(target, list(layers.values()))
    session.note_save(target)


def _with_others(full: Layer, plain: Layer) -> Layer:
    """Return a layer of an adjustment with the rows of the session that it lacks, by point and image."""
    named = [name for name in ("id", "image") if name in plain.fields]
    there = set(zip(*(np.asarray(full.fields[name]).tolist() for name in named), strict=True))
    keys = zip(*(np.asarray(plain.fields[name]).tolist() for name in named), strict=True)
    more = np.array([key not in there for key in keys], dtype=bool)
    if not more.any():
        return full
    added = {name: np.asarray(column)[more] for name, column in plain.fields.items()}
    columns = {name: np.concatenate([np.asarray(column), added[name]]) for name, column in full.fields.items()}
    place = np.vstack([np.asarray(full.coordinates), np.asarray(plain.coordinates)[more]])
    return Layer(full.name, full.geometry, full.crs, place, type(full.fields)(**columns), plain.metadata)


def _open_images(paths: Sequence[str]) -> list[Image]:
    """Return the images of a block, exposures of one strip joined; raises `InputError` for an id that occurs twice."""
    images = join_exposures([open_image(path) for path in paths])
    close_images()
    twice = {image.id for image in images if [other.id for other in images].count(image.id) > 1}
    if twice:
        raise InputError(f"image id {sorted(twice)[0]} occurs more than once: rename one of the files")
    return images


def _make_session(
    images: Sequence[Image],
    ground: GroundPoints | None,
    image: ImagePoints | None,
    path: str,
    listed_ties: Collection[str] = (),
) -> PointSession:
    """Return a session; measurements of points that are not in its list become tie points."""
    points = [] if ground is None else _survey_points(ground, listed_ties)
    if image is None:
        return PointSession(images, points, path=path)
    own = np.isin(image.ids, [point.id for point in points])
    measured = {
        (str(image.ids[row]), str(image.image_ids[row])): ImageMeasurement(
            float(image.xy[row, 0]),
            float(image.xy[row, 1]),
            float(image.sigma_px[row]),
            str(image.kind[row]),
            float(image.quality[row]),
        )
        for row in np.flatnonzero(own)
    }
    unknown = sorted({name for _, name in measured} - {one.id for one in images})
    if unknown:
        raise InputError(f"{image.source} names the image {unknown[0]!r}, which is not in the block: add it")
    return PointSession(images, points, measured, None if own.all() else image.select(~own), path)


def _survey_points(ground: GroundPoints, listed_ties: Collection[str] = ()) -> list[SurveyPoint]:
    operations = [*(json_text(use.entry()) for use in ground.operations), ""]  # the last one belongs to number -1
    return [
        SurveyPoint(
            str(ground.ids[row]),
            float(ground.ground[row, 0]),
            float(ground.ground[row, 1]),
            height=float(ground.ground[row, 2]),
            role=_ROLES.get(ground.role[row], ROLES[0]),
            sigma_xy=float(ground.sigma_m[row, 0]),
            sigma_h=float(ground.sigma_m[row, 1]),
            operation=operations[ground.operation[row]],
        )
        for row in range(len(ground))
        if _ROLES.get(ground.role[row]) != TIE or ground.ids[row] in listed_ties
    ]
