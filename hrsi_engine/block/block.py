"""The block: images with their cameras, points on the ground, and where the points were measured on the images.

Everything is columns of NumPy arrays; text ids are resolved to integer indices once, in `assemble`.
`GroundPoints` and `ImagePoints` are what files and matchers deliver; a `Block` is what is adjusted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from ..camera.rpc import RPC
from ..foundation.errors import InputError, list_ids
from ..foundation.large_arrays import any_of_rows, finite_rows
from ..ground.operation_uses import OperationUse
from .default_sigmas import DefaultSigmas
from .names import find_unique_ids, isin, join_names
from .points import UNSET, GroundPoints, ImagePoints, Measurements, Role, are_apart
from .similar_ids import find_similar_ids


class Raster(Protocol):
    """Pixels of an image; the readers of `hrsi_engine.io` provide it."""

    @property
    def size(self) -> tuple[int, int]:
        """Number of samples and lines."""

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a window's grey values ``(lines, samples)`` and its mask of valid pixels (bool).

        Parameters
        ----------
        sample, line : int
            The window's first pixel.
        samples, lines : int
            Its size.

        Returns
        -------
        tuple of (lines, samples) ndarray
            Grey values; and True where they are valid.
        """


class ArrayRaster:
    """Pixels in memory: ``grey (lines, samples)``, and which of them are ``valid``, by default all."""

    def __init__(self, grey: np.ndarray, valid: np.ndarray | None = None) -> None:
        self.grey = grey
        self.valid = np.ones(grey.shape, dtype=bool) if valid is None else valid
        self.size: tuple[int, int] = (grey.shape[1], grey.shape[0])

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a window within the image and its mask of valid pixels."""
        window = np.s_[line : line + lines, sample : sample + samples]
        return self.grey[window], self.valid[window]


@dataclass(frozen=True)
class Tile:
    """Where an image lies in the scene that it is a part of: all tiles of a scene have one camera.

    Parameters
    ----------
    scene : str
        What names the scene: the file that holds its RPC.
    first : tuple of float
        The scene's sample and line at the image's first pixel.
    size : tuple of int, optional
        The scene's samples and lines, where known.
    """

    scene: str
    first: tuple[float, float]
    size: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class Image:
    """One image: its id, its camera and, where they are known, its size and pixels.

    Parameters
    ----------
    id : str
        Its name in the block, in files and messages.
    rpc : RPC
        Its camera.
    size : tuple of int, optional
        Samples and lines.
    path : str
        Of the file; empty for an image that comes from arrays.
    raster : Raster, optional
        Its pixels.
    tile : Tile, optional
        Where it lies in its scene, when it is a part of one.
    stated_height_m : float, optional
        Ellipsoidal height of the scene's middle, where the delivery states one.
    sensor : str
        What its metadata call the satellite; empty where they do not say.
    """

    id: str
    rpc: RPC
    size: tuple[int, int] | None = None
    path: str = ""
    raster: Raster | None = None
    tile: Tile | None = None
    stated_height_m: float | None = None
    sensor: str = ""

    def __repr__(self) -> str:
        size = f"{self.size[0]} x {self.size[1]} px" if self.size else "size not known"
        return f"<Image {self.id}: {size}{'' if self.raster is not None else ', no pixels'}, {self.rpc!r}>"

    @property
    def middle_height_m(self) -> float:
        """Ellipsoidal height of the ground, where nothing better is known: as stated, else the RPC's HEIGHT_OFF."""
        return self.rpc.height_off if self.stated_height_m is None else self.stated_height_m

    @property
    def known_size(self) -> tuple[int, int]:
        """`size`, for what cannot do without it; raises `InputError` where it is not known."""
        if self.size is None:
            raise InputError(f"{self.id}: the size of the image is not known: name the image itself, not its RPC file")
        return self.size

    @property
    def pixels(self) -> Raster:
        """`raster`, for what cannot do without it; raises `InputError` for an image without pixels."""
        if self.raster is None:
            raise InputError(f"{self.id} has no pixels: name the image itself, not its RPC file")
        return self.raster

    @property
    def domain_px(self) -> tuple[float, float, float, float]:
        """Image area: first and last sample, first and last line (pixel centres).

        From the image size; from OFF and SCALE only where there are no pixels, because crops keep the full
        scene's values there.
        """
        if self.size is not None:
            return 0.0, self.size[0] - 1.0, 0.0, self.size[1] - 1.0
        rpc = self.rpc
        return (
            rpc.samp_off - rpc.samp_scale, rpc.samp_off + rpc.samp_scale,
            rpc.line_off - rpc.line_scale, rpc.line_off + rpc.line_scale,
        )  # fmt: skip

    @property
    def centre_px(self) -> np.ndarray:
        """Middle of the image area, ``(2,)`` sample and line."""
        first_sample, last_sample, first_line, last_line = self.domain_px
        return np.array([(first_sample + last_sample) / 2.0, (first_line + last_line) / 2.0])

    @property
    def half_size_px(self) -> np.ndarray:
        """Half the extent of the image area, ``(2,)``."""
        first_sample, last_sample, first_line, last_line = self.domain_px
        return np.array([(last_sample - first_sample) / 2.0, (last_line - first_line) / 2.0])

    @property
    def camera_centre_px(self) -> np.ndarray:
        """Middle of what the camera took, ``(2,)``: origin of the refinements. Of a tile the middle of its scene."""
        if self.tile is None or self.tile.size is None:
            return self.centre_px
        return (np.array(self.tile.size) - 1.0) / 2.0 - np.array(self.tile.first)

    @property
    def camera_half_size_px(self) -> np.ndarray:
        """Half the extent of what the camera took, ``(2,)``."""
        if self.tile is None or self.tile.size is None:
            return self.half_size_px
        return (np.array(self.tile.size) - 1.0) / 2.0

    def grid_px(self, samples: int, lines: int, margin: float = 0.0) -> np.ndarray:
        """Return a regular grid over the image area.

        Parameters
        ----------
        samples, lines : int
            Its points along each axis.
        margin : float
            By which it is larger than the image, as a share of it; below 0 smaller.

        Returns
        -------
        (samples * lines, 2) ndarray
            Sample, line in pixels.
        """
        reach = (1.0 + margin) * self.half_size_px
        axes = [
            c + r * np.linspace(-1.0, 1.0, n) for c, r, n in zip(self.centre_px, reach, (samples, lines), strict=True)
        ]
        return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)

    def outline_px(self, per_side: int = 5) -> np.ndarray:
        """Return points around the image area (outer pixel edges), clockwise.

        Parameters
        ----------
        per_side : int
            Their number on each side.

        Returns
        -------
        (4 * per_side, 2) ndarray
            Sample, line in pixels.
        """
        first_sample, last_sample, first_line, last_line = self.domain_px
        s0, s1, l0, l1 = first_sample - 0.5, last_sample + 0.5, first_line - 0.5, last_line + 0.5
        t = np.arange(per_side) / per_side
        sample = np.concatenate([s0 + (s1 - s0) * t, np.full(per_side, s1), s1 - (s1 - s0) * t, np.full(per_side, s0)])
        line = np.concatenate([np.full(per_side, l0), l0 + (l1 - l0) * t, np.full(per_side, l1), l1 - (l1 - l0) * t])
        return np.column_stack([sample, line])


@dataclass(frozen=True, eq=False)
class Block:
    """Images, ground points and measurements with consistent indices; every sigma is set.

    Parameters
    ----------
    images : tuple of Image
        The images.
    points : GroundPoints
        The ground points.
    measurements : Measurements
        Where they were measured, with indices of images and points.
    warnings : tuple of str
        What was put right on the way.
    unmeasured : GroundPoints
        Known points that were given and are measured on no image, with their roles.
    """

    images: tuple[Image, ...]
    points: GroundPoints
    measurements: Measurements
    warnings: tuple[str, ...] = field(default=())
    unmeasured: GroundPoints = field(default_factory=lambda: GroundPoints.create([], np.empty((0, 3))))

    def __repr__(self) -> str:
        return f"<Block: {len(self.images)} images, {len(self.points)} points, {len(self.measurements)} measurements>"

    @property
    def known(self) -> np.ndarray:
        """Mask of the points whose ground position was surveyed: GCPs and check points."""
        return self.points.role != Role.TIE

    def rays_per_point(self) -> np.ndarray:
        """Return the number of different images on which each point was measured.

        Returns
        -------
        (m,) ndarray
            Numbers of images.
        """
        point, image = self.measurements.point, self.measurements.image  # sorted by point, then by image
        another = np.ones(len(point), dtype=bool)
        another[1:] = (point[1:] != point[:-1]) | (image[1:] != image[:-1])
        return np.bincount(point[another], minlength=len(self.points))

    def with_ties(self, ties: ImagePoints) -> Block:
        """Return the block with further tie points behind its own.

        Parameters
        ----------
        ties : ImagePoints
            Measurements on images of the block, with a sigma each; none of their points is in the block yet.

        Returns
        -------
        Block
            With new points and measurements.
        """
        ids, point = find_unique_ids(ties.ids)
        image = _find_image_indices(ties, self.images).astype(self.measurements.image.dtype)
        order = np.lexsort((image, point))
        added = GroundPoints.create(ids, np.full((len(ids), 3), np.nan), Role.TIE)
        columns = {
            "point": (len(self.points) + point).astype(self.measurements.point.dtype), "image": image, "xy": ties.xy,
            "sigma_px": ties.sigma_px, "kind": ties.kind, "quality": ties.quality,
        }  # fmt: skip
        rows = {
            name: np.concatenate([getattr(self.measurements, name), values[order]]) for name, values in columns.items()
        }
        own = self.points
        points = GroundPoints(
            np.concatenate([own.ids, added.ids]), np.concatenate([own.ground, added.ground]),
            np.concatenate([own.role, added.role]), np.concatenate([own.sigma_m, added.sigma_m]), own.source,
            _join_covariances([own, added]), *_join_operations([own, added]),
        )  # fmt: skip
        return replace(self, points=points, measurements=Measurements(**rows))

    def with_measurements(self, keep: np.ndarray) -> Block:
        """Return the block with only the chosen measurements; points stay.

        Parameters
        ----------
        keep : (n,) ndarray
            True for those to keep.

        Returns
        -------
        Block
            The smaller block.
        """
        return replace(self, measurements=self.measurements.select(keep))

    def with_cameras(self, cameras: Sequence[RPC]) -> Block:
        """Return the block seen by other cameras.

        Parameters
        ----------
        cameras : sequence of RPC
            One an image, in their order.

        Returns
        -------
        Block
            The same points and measurements.
        """
        images = tuple(replace(image, rpc=rpc) for image, rpc in zip(self.images, cameras, strict=True))
        return replace(self, images=images)


def assemble(
    images: Sequence[Image],
    ground_points: Iterable[GroundPoints],
    image_points: Iterable[ImagePoints],
    gcp_ids: Sequence[str] | None = None,
    check_ids: Sequence[str] | None = None,
    defaults: DefaultSigmas | None = None,
) -> Block:
    """Put images, ground points and measurements together.

    A known point is a GCP unless its role says otherwise; with ``gcp_ids`` those are the GCPs and every other known
    point a check point; ``check_ids`` are check points in any case, and with both given all other known points take no
    part. Nor does a point whose role is off, unless it is named. Points that are only measured are tie points.

    Parameters
    ----------
    images : sequence of Image
        The images.
    ground_points : iterable of GroundPoints
        Tables of known points.
    image_points : iterable of ImagePoints
        Tables of measurements.
    gcp_ids, check_ids : sequence of str, optional
        Who is control and who is not.
    defaults : DefaultSigmas, optional
        Standard deviations of what has none of its own.

    Returns
    -------
    Block
        Consistent indices; every sigma is set.

    Raises
    ------
    InputError
        Ids that do not exist or contradict each other.
    """
    defaults = defaults or DefaultSigmas()
    image_ids = [image.id for image in images]
    twice = sorted(name for name, count in Counter(image_ids).items() if count > 1)
    if twice:
        raise InputError(f"image id {list_ids(twice)} occurs more than once: rename one of the files")
    known = _merge_ground(list(ground_points))
    rows = _join_image_points([table for table in image_points if len(table)])
    known, rows = _drop_points_off(known, rows, [*(gcp_ids or ()), *(check_ids or ())])
    if gcp_ids and check_ids:
        known, rows = _select_points(known, rows, [*gcp_ids, *check_ids])
    warnings: list[str] = []
    image_index = _find_image_indices(rows, images)
    ids, point_index = find_unique_ids(rows.ids)
    warnings += _warn_of_similar_ids(ids, rows, known)
    measured = np.isin(known.ids, ids)
    known, unmeasured = known.select(measured), known.select(~measured)
    if len(unmeasured):
        warnings.append(
            f"{len(unmeasured)} ground points are measured on no image and are left out: {list_ids(unmeasured.ids)}"
        )
    role = _assign_roles(known, gcp_ids, check_ids)
    points = _make_points(ids, known, role, defaults)
    order = np.lexsort((image_index, point_index))
    sigma = np.where(np.isnan(rows.sigma_px), defaults.sigma_image_px, rows.sigma_px)
    measurements = Measurements(point_index, image_index, rows.xy, sigma, rows.kind, rows.quality).select(order)
    measurements = _drop_repetitions(measurements, ids, warnings)
    _require_finite(measurements, ids, images)
    unmeasured = replace(unmeasured, role=_assign_roles(unmeasured, None, None))
    return Block(tuple(images), points, measurements, tuple(warnings), unmeasured)


def _warn_of_similar_ids(ids: np.ndarray, rows: ImagePoints, known: GroundPoints) -> list[str]:
    """Return a warning on measured ids that have no ground point, but differ from one that has by their spelling only.

    Two that are measured on the same image are two points.
    """
    surveyed = known.ids[finite_rows(known.ground)]
    found = []
    for tie, others in find_similar_ids(ids[~np.isin(ids, surveyed)], surveyed).items():
        images = rows.image_ids[rows.ids == tie]
        for name in others:
            if not np.isin(images, rows.image_ids[rows.ids == name]).any():
                found.append(f"{tie!r} ({name!r} has one)")
    if not found:
        return []
    return [
        f"measured, but without a ground point: {list_ids(found)}: ids are compared as text, so these are different "
        "points; if two are meant to be one, give both the same id"
    ]


def group_tiles(images: Sequence[Image], apart: Sequence[Sequence[str]] = ()) -> list[list[str]]:
    """Return the ids of images that are tiles of one scene, a list a scene; but for those in groups of their own."""
    named = {name for group in apart for name in group}
    scenes: dict[str, list[str]] = {}
    for image in images:
        if image.tile is not None and image.id not in named:
            scenes.setdefault(image.tile.scene, []).append(image.id)
    return [tiles for tiles in scenes.values() if len(tiles) > 1]


def _merge_ground(tables: list[GroundPoints]) -> GroundPoints:
    """Concatenate tables; the same id twice must mean the same position."""
    if not tables:
        return GroundPoints.create([], np.empty((0, 3)))
    merged = GroundPoints(
        np.concatenate([t.ids for t in tables]),
        np.concatenate([t.ground for t in tables]),
        np.concatenate([t.role for t in tables]),
        np.concatenate([t.sigma_m for t in tables]),
        tables[0].source,
        _join_covariances(tables),
        *_join_operations(tables),
    )
    _, first, inverse = np.unique(merged.ids, return_index=True, return_inverse=True)
    apart = are_apart(merged.ground, merged.ground[first[inverse]])
    if apart.any():
        raise InputError(
            f"ground point {list_ids(np.unique(merged.ids[apart]))} is given with different positions in "
            f"{merged.source}: keep one"
        )
    return merged.select(first)


def _join_covariances(tables: list[GroundPoints]) -> np.ndarray | None:
    if all(table.covariance_m2 is None for table in tables):
        return None
    nothing = [np.full((len(t), 3, 3), np.nan) if t.covariance_m2 is None else t.covariance_m2 for t in tables]
    return np.concatenate(nothing)


def _join_operations(tables: Sequence[GroundPoints]) -> tuple[np.ndarray, tuple[OperationUse, ...]]:
    """Return which operation brought each point of several tables to WGS84, and all operations."""
    operations: tuple[OperationUse, ...] = ()
    number = []
    for table in tables:
        number.append(np.where(table.operation >= 0, table.operation + len(operations), -1))
        operations += table.operations
    return np.concatenate(number), operations


def _join_image_points(tables: list[ImagePoints]) -> ImagePoints:
    if not tables:
        return ImagePoints.create([], [], np.empty((0, 2)))
    if len(tables) == 1:
        return tables[0]
    columns = {
        name: join([getattr(table, name) for table in tables])
        for join, names in ((join_names, ("ids", "image_ids")), (np.concatenate, ("xy", "sigma_px", "kind", "quality")))
        for name in names
    }
    return ImagePoints(**columns, source=tables[0].source)


def _find_image_indices(rows: ImagePoints, images: Sequence[Image]) -> np.ndarray:
    """Return each row's image index; raise `InputError` for image ids that are not in the block."""
    measured, inverse = find_unique_ids(rows.image_ids)
    position = {image.id: index for index, image in enumerate(images)}
    unknown = [name for name in measured if str(name) not in position]
    if unknown:
        where = f" of {rows.source}" if rows.source else ""
        raise InputError(
            f"image {list_ids(map(repr, map(str, unknown)))} in the image points{where} is not in the block (images: "
            f"{list_ids(position)}): name the image file too, correct the 'image' field, or write FILE|image=ID"
        )
    return np.array([position[str(name)] for name in measured], dtype=np.int64)[inverse]


def _drop_points_off(known: GroundPoints, rows: ImagePoints, named: Sequence[str]) -> tuple[GroundPoints, ImagePoints]:
    """Return the points without those that are off, unless they are named; these take no part, as ties neither."""
    off = (known.role == Role.OFF) & ~np.isin(known.ids, named)
    return (known.select(~off), rows.select(~isin(rows.ids, known.ids[off]))) if off.any() else (known, rows)


def _select_points(known: GroundPoints, rows: ImagePoints, chosen: Sequence[str]) -> tuple[GroundPoints, ImagePoints]:
    """Return the points without the surveyed ones that are not chosen; these take no part, as ties neither."""
    other = ~np.isin(known.ids, chosen) & (known.role != Role.TIE) & finite_rows(known.ground)
    return known.select(~other), rows.select(~isin(rows.ids, known.ids[other]))


def _assign_roles(known: GroundPoints, gcp_ids: Sequence[str] | None, check_ids: Sequence[str] | None) -> np.ndarray:
    for option, chosen in (("gcp_ids", gcp_ids), ("check_ids", check_ids)):
        missing = sorted(set(chosen).difference(known.ids.tolist())) if chosen else []
        if missing:
            alike = [repr(name) for others in find_similar_ids(missing, known.ids).values() for name in others]
            raise InputError(
                f"`{option}` names {list_ids(missing)}, not among the measured ground points"
                f"{f' of {known.source}' if known.source else ''}: correct the ids"
                f"{f'; there is {list_ids(alike)}' if alike else ''}"
            )
    both = sorted(set(gcp_ids or ()) & set(check_ids or ()))
    if both:
        raise InputError(f"{list_ids(both)} is in `gcp_ids` and in `check_ids`: a point is control or check, not both")
    role = np.where(known.role == UNSET, Role.GCP, known.role)
    if gcp_ids:
        role = np.where(np.isin(known.ids, list(gcp_ids)), Role.GCP, np.where(role == Role.TIE, role, Role.CHECK))
    if check_ids:
        role = np.where(np.isin(known.ids, list(check_ids)), Role.CHECK, role)
    return np.where(any_of_rows(np.isnan(known.ground)), Role.TIE, role)


def _make_points(ids: np.ndarray, known: GroundPoints, role: np.ndarray, defaults: DefaultSigmas) -> GroundPoints:
    """Return one row for every measured id; unknown ones are tie points at NaN."""
    empty = np.full((len(ids), 3, 3), np.nan) if known.covariance_m2 is not None else None
    points = GroundPoints.create(
        ids.tolist(), np.full((len(ids), 3), np.nan), Role.TIE, source=known.source, covariance_m2=empty
    )
    points = replace(points, operations=known.operations)
    row = np.searchsorted(ids, known.ids)
    if points.covariance_m2 is not None and known.covariance_m2 is not None:
        _require_covariances(known)
        points.covariance_m2[row] = known.covariance_m2
    points.ground[row], points.role[row], points.sigma_m[row] = known.ground, role, known.sigma_m
    points.operation[row] = known.operation
    for column, default in enumerate((defaults.sigma_gcp_xy_m, defaults.sigma_gcp_h_m)):
        sigma = points.sigma_m[:, column]
        sigma[np.isnan(sigma)] = default
    bad = ids[~(points.sigma_m > 0.0).all(axis=1)]
    if len(bad):
        raise InputError(
            f"ground point {list_ids(bad)} has a sigma that is not positive: give metres above 0, or leave it empty"
        )
    return points


def _require_covariances(known: GroundPoints) -> None:
    """Raise `InputError` for a covariance that no random vector has."""
    given = known.survey_covariance_m2()
    given = np.where(np.isnan(given), np.eye(3), given)  # sigmas that the defaults will fill
    open_axis = np.isinf(given.diagonal(axis1=1, axis2=2))
    finite = np.where(open_axis[:, :, None] | open_axis[:, None, :], np.eye(3), given)
    scale = np.sqrt(np.abs(finite.diagonal(axis1=1, axis2=2)))
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.nan_to_num(finite / (scale[:, :, None] * scale[:, None, :]))
    bad = known.ids[~(np.linalg.eigvalsh(correlation).min(axis=1, initial=1.0) > 1e-9)]
    if len(bad):
        raise InputError(
            f"ground point {list_ids(bad)} has a covariance that is not positive definite: correlations must lie "
            "between -1 and 1 and agree with each other"
        )


def _drop_repetitions(rows: Measurements, ids: np.ndarray, warnings: list[str]) -> Measurements:
    """Drop exact repetitions of a measurement (copied rows); genuinely repeated measurements stay."""
    if len(rows) < 2:
        return rows
    same_point = (rows.point[1:] == rows.point[:-1]) & (rows.image[1:] == rows.image[:-1])
    repeated = np.r_[False, same_point & np.all(rows.xy[1:] == rows.xy[:-1], axis=1)]
    if not repeated.any():
        return rows
    warnings.append(
        f"{repeated.sum()} image points are given twice and used once: {list_ids(ids[rows.point[repeated]])}"
    )
    return rows.select(~repeated)


def _require_finite(rows: Measurements, ids: np.ndarray, images: Sequence[Image]) -> None:
    bad = ~(finite_rows(rows.xy) & (rows.sigma_px > 0.0))
    if bad.any():
        first = np.flatnonzero(bad)[0]
        raise InputError(
            f"point {ids[rows.point[first]]!s} on image {images[rows.image[first]].id} has sample, line "
            f"{rows.xy[first].tolist()} and sigma {rows.sigma_px[first]}: numbers are needed, and a sigma above 0"
        )
