"""Point files of a folder: how each is read, and what its points are in the block: GCPs, check points, tie points."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain, pairwise, product
from typing import Any

import numpy as np
import pyproj

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.points import GroundPoints, ImagePoints, Role, are_apart
from ...hrsi_engine.foundation.errors import HrsiError, InputError
from ...hrsi_engine.foundation.thresholds import EQUALITY, SAMPLES
from ...hrsi_engine.ground.geodesy import ground_difference_m
from ...hrsi_engine.ground.map_crs import list_local_crs
from ...hrsi_engine.io.geopackage.layer_tables import layer_names
from ...hrsi_engine.io.point_files import PointTables, read_points
from ...hrsi_engine.io.point_files.find import read_table
from ...hrsi_engine.io.point_files.table import match_fields
from ...hrsi_engine.plausibility.places import SURVEY
from . import column_roles
from .column_roles import POSITION_NAMES, match_image, share_near
from .unusable_points import find_fault, holds_most, read_ids

#: Words of file names and of fields that state the role of points.
CHECK_WORDS = re.compile(r"(?<![a-z])(check|chk|cp|icp|ckp|validation|verif|test|kontroll?|pruef)", re.IGNORECASE)
CONTROL_WORDS = re.compile(r"(?<![a-z])(control|ctrl|gcp|pass)", re.IGNORECASE)
#: Words of fields of vector layers that are ids and heights.
ID_FIELD = re.compile(r"id|nr|no|num|name|nom|punkt|point|pt|mat", re.IGNORECASE)
HEIGHT_FIELD = re.compile(
    r"^(?!.*(sigma|std|err|acc|rms)).*(height|h(ö|oe)he|(?<![a-z])((h|z|hgt|h?_?ell)(?![a-z])|alt|ele|cota|quota|haut))",
    re.IGNORECASE,
)
#: Words of files and fields that state a height datum, and the value of the option.
DATUM_WORDS = (
    ("egm2008", r"egm_?(20)?08"),
    ("egm96", r"egm_?(19)?96|srtm|\.hgt$"),
    ("ellipsoidal", r"ellip|(?<![a-z])(hae|h?_?ell)(?![a-z])"),
    (
        "egm2008",
        r"(?<![a-z])(msl|ortho_?h|orthometric|geoid|above_sea|nhn|dhhn|navd|ign69|ngf|evrf|odn)|"
        r"cop(ernicus)?.?(dem|dsm|glo)|aw3d|nasadem",
    ),
)
GEOCENTRIC = "EPSG:4978"  #: X, Y, Z from the centre of the Earth, as GNSS software writes them
HEIGHT_UNKNOWN, HEIGHT_MISSING = "the height datum is not known", "have no height"  #: words of warnings of the reader


@dataclass
class PointSource:
    """A point file or layer: how it is read, and its points.

    specs : texts for the options, several if each image has columns or a file of its own
    crs : CRS for a file that states none; datum : height datum, '' if its CRS states it, None if nothing states it
    ground, measured : points; notes : how the file was read, for the user
    fault : why a file with the fields of points cannot be read; measures : whether its points are image points
    """

    path: str
    specs: list[str]
    crs: str = ""
    datum: str | None = ""
    ground: GroundPoints | None = None
    measured: list[ImagePoints] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    has_heights: bool = True
    fault: str = ""
    measures: bool = False

    @property
    def name(self) -> str:
        """Name of the file, and of the layer if it has several."""
        return os.path.basename(self.specs[0].partition("|columns")[0].partition("|image")[0])

    @property
    def ground_ids(self) -> set[str]:
        """Ids of the ground points."""
        return set() if self.ground is None else {str(one) for one in self.ground.ids}

    def count(self, role: Role) -> int:
        """Return the number of ground points with a role in the file."""
        return 0 if self.ground is None else int((self.ground.role == role).sum())

    @property
    def measured_ids(self) -> set[str]:
        """Ids of the measured points."""
        return {str(one) for table in self.measured for one in table.ids}


def state_datum(*texts: str) -> str | None:
    """Return the height datum that names of a file and its fields state; None if they state none."""
    stated = (datum for text, (datum, words) in product(texts, DATUM_WORDS) if re.search(words, text, re.IGNORECASE))
    return next(stated, None)


def read_sources(
    paths: Sequence[str], images: Mapping[str, Image], region: np.ndarray, crs_names: Sequence[str]
) -> list[PointSource]:
    """Return the point files among some files, in two passes: measurements are identified by the ground points."""
    found = list[PointSource]()
    for path in paths:
        layers = list(layer_names(path)) if path.lower().endswith(".gpkg") else []
        specs = [f"{path}|layername={layer}" for layer in layers] if len(layers) > 1 else [path]
        sources = [_read_source(path, spec, images, region, crs_names) for spec in specs]
        found += [one for one in sources if one is not None]
    known, read = _place_ids(found), {one.path for one in found}
    rest = [path for path in paths if path not in read]
    found += [one for path in rest if (one := _read_image_columns(path, images, known)) is not None]
    rest = sorted({*rest} - {one.path for one in found})
    surveyed = {name for one in found for name in one.ground_ids}
    measured = {name for one in found for name in one.measured_ids}
    for path in rest:
        ids = read_ids(path)
        measures, surveys = holds_most(ids, surveyed - measured), holds_most(ids, measured - surveyed)
        if fault := find_fault(path, region, crs_names, images, measures or surveys):
            found.append(PointSource(path, [path], fault=fault, measures=measures))
    return found


def _place_ids(sources: Sequence[PointSource]) -> dict[str, np.ndarray]:
    """Return the positions (3,) of the ground points of files by id, of the last file for an id in several."""
    tables = [one.ground for one in sources if one.ground is not None]
    return {str(name): xyz for table in tables for name, xyz in zip(table.ids, table.ground, strict=True)}


def _read_source(
    path: str, spec: str, images: Mapping[str, Image], region: np.ndarray, crs_names: Sequence[str]
) -> PointSource | None:
    """Return a file that is read by the names or the usual order of its columns, or by the content of columns."""
    for crs in chain(("", *crs_names), _list_crs(spec, region)):
        tables = _try(spec, images, crs)
        if tables is not None and _is_plausible(tables, images, region):
            return _make_source(path, *_complete(spec, tables, images, crs), crs)
    table = column_roles.read_text_table(path) if column_roles.is_text(path) else None
    readings = []
    for names in column_roles.list_ground_columns(table) if table is not None else _list_fields(spec):
        chosen = f"{spec}|columns={','.join(names)}"
        for crs in chain(("",), crs_names, _list_crs(chosen, region)) if table is None or "x" in names else ("",):
            tables = _try(chosen, images, crs)
            if tables is not None and tables.ground is not None and _is_plausible(tables, images, region):
                readings.append((share_near(tables.ground.ground[:, :2], region), ",".join(names), tables, crs))
                break
    if not readings:
        return None
    _, listed, tables, crs = max(readings, key=lambda one: one[0])
    source = _make_source(path, *_complete(f"{spec}|columns={listed}", tables, images, crs), crs)
    if source.datum is None:
        source.datum = state_datum(*(table.names if table is not None else [listed]))
    return source


def _list_crs(spec: str, region: np.ndarray) -> Iterator[str]:
    """Yield the CRSs in which the coordinates of a file that states none lie near the images; read when asked for."""
    try:
        table = read_table(spec)
    except HrsiError:
        return
    xy = table.geometry[:, :2] if table.geometry is not None and not table.crs else np.empty((0, 2))
    if {"x", "y"} <= table.columns.keys():
        xy = np.column_stack([table.columns["x"], table.columns["y"]])
    if np.isfinite(xy).any():
        yield from list_local_crs(region.mean(axis=0), np.nanmedian(xy, axis=0))
        yield GEOCENTRIC


def _list_fields(spec: str) -> Iterator[list[str]]:
    """Yield choices of the fields of a vector layer or spreadsheet that are ids, heights, and positions."""
    try:
        table = read_table(spec)
    except HrsiError:
        return
    names = table.field_names
    heights = [name for name in names if HEIGHT_FIELD.search(name)]
    for name in sorted(names, key=lambda name: not ID_FIELD.search(name)):
        if table.geometry is not None:
            yield [f"id={name}", *(f"height={one}" for one in heights[:1] if one != name)]
            continue
        for k, (first, second) in enumerate(pairwise(names)):
            following = [*names[k + 2 : k + 3], *heights][:1]
            for axes in POSITION_NAMES if name not in (first, second, *following) else ():
                heights_of = [f"height={one}" for one in following]
                yield [f"id={name}", f"{axes[0]}={first}", f"{axes[1]}={second}", *heights_of]


def _try(spec: str, images: Mapping[str, Image], crs: str) -> PointTables | None:
    """Return the points of a file; heights that are missing become 0. None if it cannot be read so."""
    try:
        return read_points(
            spec, ground_crs=crs or None, image_ids=list(images), surface=lambda lonlat: np.zeros(len(lonlat))
        )
    except HrsiError:
        return None


def _is_plausible(tables: PointTables, images: Mapping[str, Image], region: np.ndarray) -> bool:
    """Return whether points lie on the ground of the images, or name images."""
    is_here = tables.ground is None or share_near(tables.ground.ground[:, :2], region) >= EQUALITY.majority
    # of this block, or of a larger one
    return is_here and (tables.image is None or bool(np.isin(tables.image.image_ids, list(images)).any()))


def _make_source(path: str, spec: str, tables: PointTables, crs: str) -> PointSource:
    """Return a file's points as read, with the height datum that its name states and notes on how it was read."""
    told = " ".join(tables.warnings)
    names = os.path.basename(path), spec.partition("|columns=")[2]
    datum = state_datum(*names) if HEIGHT_UNKNOWN in told else ""
    notes = [note.partition(": ")[2] for note in tables.warnings if ": read as the columns" in note]
    notes += [f"columns {spec.partition('|columns=')[2]}"] if "|columns=" in spec and not notes else []
    notes += [f"CRS {crs} ({pyproj.CRS(crs).name}) by the place of the images"] if crs else []
    return PointSource(
        path,
        [spec],
        crs,
        datum=datum,
        ground=tables.ground,
        measured=[tables.image] if tables.image is not None else [],
        notes=notes,
        has_heights=HEIGHT_MISSING not in told,
    )


def _complete(spec: str, tables: PointTables, images: Mapping[str, Image], crs: str) -> tuple[str, PointTables]:
    """Return the text and the points of a file with what its other fields state: roles, heights, image positions."""
    if tables.ground is None or len(tables.ground) > SAMPLES.large:
        return spec, tables
    try:
        table = read_table(spec)
    except HrsiError:
        return spec, tables
    if len(table) > SAMPLES.large:
        return spec, tables
    listed = spec.partition("|columns=")[2]  # meanings of all columns, or fields chosen by name
    known = [k for field, k in match_fields(table.field_names).items() if field not in ("check", "use")]
    names = [] if listed and "=" not in listed else table.field_names
    spare = [name for k, name in enumerate(names) if k not in known and f"={name}" not in listed]
    for name in spare:
        if not (tables.ground.role >= 0).any():  # by its words, whatever its name
            read = _try(f"{spec}|columns=role={name}", images, crs)
            if read is not None and read.ground is not None and (read.ground.role == Role.GCP).any():
                spec, tables = f"{spec}|columns=role={name}", read
        if HEIGHT_FIELD.search(name.strip()) and HEIGHT_MISSING in " ".join(tables.warnings):
            read = _try(f"{spec}|columns=height={name}", images, crs)
            spec, tables = (spec, tables) if read is None else (f"{spec}|columns=height={name}", read)
    if tables.image is not None:
        return spec, tables
    named = "image" not in table.columns and match_image(os.path.basename(table.source), list(images))
    for chosen in _list_image_fields(spec, listed, spare):
        for image in [""] if "image" in table.columns else [f"|image={one}" for one in ([named] if named else images)]:
            read = _try(chosen + image, images, crs)
            if read is not None and column_roles.agrees(read, images):
                return chosen + image, read
    return spec, tables


def _list_image_fields(spec: str, listed: str, spare: Sequence[str]) -> Iterator[str]:
    """Yield texts in which two neighbouring columns without a meaning are sample and line, in both orders."""
    columns = listed.split(",")
    for order in (("sample", "line"), ("line", "sample")):
        for pair in pairwise(spare):
            yield f"{spec}|columns={order[0]}={pair[0]},{order[1]}={pair[1]}"
        for k, pair in enumerate(pairwise(columns)):
            if set(pair) == {column_roles.UNUSED}:
                yield spec.replace(listed, ",".join([*columns[:k], *order, *columns[k + 2 :]]))


def _read_image_columns(path: str, images: Mapping[str, Image], known: Mapping[str, np.ndarray]) -> PointSource | None:
    """Return a file of measurements whose images follow from its columns, its name, or its agreement with points."""
    stem = os.path.basename(path).partition(".csv")[0]
    if image := match_image(stem, list(images)):  # formats with a reader of their own, but other names of images
        tables = _try(f"{path}|image={image}", images, "")
        if tables is not None and tables.image is not None and tables.ground is None:
            return PointSource(path, [f"{path}|image={image}"], measured=[tables.image], notes=[f"image {image}"])
    table = None
    with suppress(InputError):
        is_table = column_roles.is_text(path) or path.lower().endswith(column_roles.SPREADSHEETS)
        table = column_roles.read_text_table(path) if is_table else None
    if table is None:
        return None
    if roles := column_roles.find_measurement_columns(table, images, known):
        spec = column_roles.name_columns(path, table, roles)
        tables = _try(spec, images, "")
        return None if tables is None else _make_source(path, spec, tables, "")
    source = PointSource(path, [])
    for one in column_roles.find_image_columns(table, stem, images, known):
        spec = f"{column_roles.name_columns(path, table, one.roles(table))}|image={one.image}"
        tables = _try(spec, images, "")
        if tables is None or tables.image is None:
            return None
        source.specs.append(spec)
        source.measured.append(tables.image)
        fit = f", scatter {one.scatter_px:.2f} px" if np.isfinite(one.scatter_px) else ""
        source.notes.append(
            f"{table.numbers.shape[1]} columns: {one.image} sample {one.sample + 1}, line {one.line + 1}{fit}"
        )
    return source if source.specs else None


# ---- roles ----------------------------------------------------------------------------------------------------------


@dataclass
class PointRoles:
    """What the point files of a folder are: options by key, and the role of each file with the reason."""

    options: dict[str, Any] = field(default_factory=dict)
    roles: dict[str, tuple[str, str]] = field(default_factory=dict)
    control: list[PointSource] = field(default_factory=list)
    measured: list[PointSource] = field(default_factory=list)
    ties: list[PointSource] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def _pair_positions(source: PointSource, others: Sequence[PointSource]) -> np.ndarray:
    """Return the positions ``(2, n, 3)`` of points with one id in a file and in other files."""
    known = _place_ids(others)
    pairs = [(xyz, known[name]) for name, xyz in _place_ids([source]).items() if name in known]
    return np.array(pairs).reshape(-1, 2, 3).swapaxes(0, 1)


def _find_contradiction(source: PointSource, others: Sequence[PointSource]) -> str:
    """Return how far points are from those with the same ids in other files; empty if they agree."""
    first, second = _pair_positions(source, others)
    if not len(first):
        return ""
    distance = float(np.nanmedian(np.linalg.norm(ground_difference_m(first, second)[:, :2], axis=1)))
    differ = f"{len(first)} of its points have other places (median {distance:.0f} m) in {others[0].name}"
    return "" if distance < SURVEY.same_id_m else differ


def decide_roles(sources: Sequence[PointSource]) -> PointRoles:
    """Return the roles of point files: by their fields, by ids that are in another file, and by their names."""
    found = PointRoles()
    ground = sorted((one for one in sources if one.ground is not None), key=lambda one: -len(one.ground_ids))
    check_ids, gcp_ids, ids = set[str](), set[str](), set[str]()
    for one in ground:
        own = one.ground_ids
        is_check = bool(CHECK_WORDS.search(one.name)) and not CONTROL_WORDS.search(one.name)
        what = "check points" if is_check else "GCPs"
        reason = f"{len(own)} ground points"
        counts = {"GCPs": one.count(Role.GCP), "check points": one.count(Role.CHECK)}
        if any(counts.values()):
            what, reason = "ground points with roles", ", ".join(f"{n} {label}" for label, n in counts.items())
        elif (apart := _find_contradiction(one, found.control)) and own & ids:
            found.roles[one.path] = ("ground points, not used", apart)
            found.notes.append(f"{one.name}: {apart}: not used; exchange gcps if it is the right one")
            continue
        elif own & ids and (not one.measured or are_apart(*_pair_positions(one, found.control)).any()):
            others = f"in {found.control[0].name} too"
            if not own <= ids:
                found.roles[one.path] = ("ground points, not used", f"some of its ids are {others}")
                continue
            (check_ids if is_check else gcp_ids).update(own)
            whose = "GCPs" if is_check else "check points"
            found.roles[one.path] = (what, f"{reason}, {others}, whose other points are {whose}")
            continue
        elif is_check:
            check_ids |= own
            reason += ", by the name of the file"
        elif one.measured:
            reason += ", with their measurements"
        ids |= own
        found.control.append(one)
        found.roles[one.path] = (what, reason)
    for one in ground:  # how the file was read
        what, reason = found.roles[one.path]
        found.roles[one.path] = (what, "; ".join([reason, *one.notes]))
    for one in (one for one in sources if one.fault):  # a run reports it
        found.roles[one.path] = ("points with an error", one.fault.removeprefix(f"{one.path}").lstrip(":, "))
        found.options.setdefault("image_points" if one.measures else "gcps", []).append(one.specs[0])
    for one in (one for one in sources if one.ground is None and not one.fault):
        shared = len(one.measured_ids & ids)
        (found.measured if shared else found.ties).append(one)
        told = f"{sum(map(len, one.measured))} image points of {len(one.measured_ids)} points"
        told += f", {shared} of them with a ground position" if shared else ""
        found.roles[one.path] = ("image measurements" if shared else "tie points", "; ".join([told, *one.notes]))
    for key, chosen in (("gcps", found.control), ("image_points", found.measured), ("tie_points", found.ties)):
        if chosen:
            found.options[key] = [spec for one in chosen for spec in one.specs] + found.options.get(key, [])
    crs = {one.crs for one in found.control if one.crs}
    found.options |= {"ground_crs": crs.pop()} if len(crs) == 1 else {}
    if listed := check_ids or gcp_ids:
        found.options["check_ids" if check_ids else "gcp_ids"] = sorted(listed)
    return found
