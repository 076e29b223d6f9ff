"""Reads texts and opens rasters within their size limits; invalid files raise `InputError`.

Parsing of numbers in text: the complete text is a number or none, so ``43,5`` is never read as 43.
"""

import codecs
import json
import math
import os
import re
from collections.abc import Sequence
from typing import Any

# Bandit warns of this package because its parsers expand entities. None of them is used: `read_xml` parses with expat,
# which refuses document types and therefore entities; these three only store and write a tree.
from xml.etree.ElementTree import Element, TreeBuilder, tostring  # nosec B405
from xml.parsers import expat

import numpy as np
from osgeo import gdal

from ...foundation.errors import InputError
from .budgets import MIB, MOST_BYTES, require_raster
from .datasets import check_advice, gdal_messages, open_dataset, read_head, require_plain, virtual_status


def file_bytes(path: str) -> int | None:
    """Return the size of a file, None if it has none (address of a database, folder)."""
    status = virtual_status(path)
    return None if status is None or status.IsDirectory() else int(status.size)


def require_size(path: str, kind: str) -> None:
    """Raise `InputError` if a file is larger than any of its ``kind``, a key of `MOST_BYTES`, or is no regular file."""
    require_plain(path)
    size, limit = file_bytes(path), MOST_BYTES[kind]
    if size is not None and size > limit:
        raise InputError(
            f"{path}: has {size / MIB:.0f} MiB, more than a file of {kind} can have ({limit // MIB}): name another file"
        )


def read_bytes(path: str, kind: str = "RPC") -> bytes:
    """Return the content of a file, also of one in GDAL's virtual file systems (``/vsizip/…``).

    ``kind`` is the kind of its content, a key of `budgets.MOST_BYTES`. Raises `InputError` if it cannot be read or is
    too large.
    """
    require_size(path, kind)
    return read_head(path, MOST_BYTES[kind])


def read_text(path: str, kind: str = "RPC") -> str:
    """Return a file's text, as UTF-16 by its mark, UTF-8 or, if that fails, Latin-1; raises as `read_bytes`."""
    content = read_bytes(path, kind)
    is_marked = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))  # some editors save texts so
    try:
        return content.decode("utf-16" if is_marked else "utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def read_json(path: str, kind: str) -> Any:
    """Return the content of a JSON file (UTF-8, with or without a byte order mark); raises as `read_bytes`."""
    try:
        return json.loads(read_bytes(path, kind).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # the last: brackets nested thousands deep
        raise InputError(f"{path}: is no JSON that can be read ({error}): obtain the file again") from None


def local_name(name: str) -> str:
    """Return an XML name without its namespace prefix: ``isd:RPB`` is RPB."""
    return name.rpartition(":")[2]


def read_xml(path: str) -> Element:
    """Return the root element of an XML file; elements and attributes have their local names, in any namespace.

    Raises `InputError` if it is not well-formed or declares a document type: entities can expand without limit or read
    other files, and no RPC file needs them.
    """
    content = read_bytes(path)
    tree, parser = TreeBuilder(), expat.ParserCreate()

    def refuse(*_declaration: object) -> None:
        raise InputError(f"{path}: contains a DOCTYPE declaration, which RPC files do not need: remove it")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = lambda name, values: tree.start(
        local_name(name), {local_name(key): value for key, value in values.items()}
    )
    parser.EndElementHandler = lambda name: tree.end(local_name(name))
    parser.CharacterDataHandler = tree.data
    try:
        parser.Parse(content, True)
        return tree.close()
    except (expat.ExpatError, AssertionError, ValueError, LookupError) as error:
        raise InputError(f"{path}: not well-formed XML ({error}): obtain the file again") from None


def xml_bytes(root: Element) -> bytes:
    """Return an XML tree as the content of a file."""
    return bytes(tostring(root, encoding="utf-8"))


def open_raster(path: str) -> gdal.Dataset:
    """Return an image opened by GDAL; raise `InputError` if it is no image."""
    dataset, message = open_dataset(path)
    if dataset is None and not path.startswith("/vsi") and ":" not in path and not os.path.exists(path):
        raise InputError(f"{path}: no such file: check the path")
    if dataset is None or dataset.RasterCount < 1:
        reason = f" ({message})" if message else ""
        raise InputError(f"{path}: neither an image nor an RPC file{reason}: {check_advice(path, 'check the file')}")
    require_raster(path, dataset)
    return dataset


def read_pixels(
    path: str, dataset: gdal.Dataset, bands: Sequence[int], window: tuple[int, int, int, int], masked: bool, **how: Any
) -> tuple[list[np.ndarray], np.ndarray | None]:
    """Return the values of bands in a window, and the mask of the first of them if ``masked`` (0: invalid).

    window : first sample, first line, samples, lines; how : further arguments of GDAL's ``ReadAsArray``
    Raises `InputError` if the pixels cannot be read.
    """
    found: list[np.ndarray | None] = []
    with gdal_messages() as messages:
        found += [dataset.GetRasterBand(number).ReadAsArray(*window, **how) for number in bands]
        found += [dataset.GetRasterBand(bands[0]).GetMaskBand().ReadAsArray(*window, **how)] if masked else []
    read = [values for values in found if values is not None]
    if len(read) < len(bands) + masked:
        raise InputError(
            f"{path}: pixels at sample {window[0]}, line {window[1]} cannot be read ({messages.reason}): obtain the "
            "file again"
        )
    return (read[:-1], read[-1]) if masked else (read, None)


_COMMAS = re.compile(r"\s*[+-]?\d+,\d+\s+[+-]?\d+,\d+(\s|$)", re.ASCII)


def parse_finite(text: str | None) -> float | None:
    """Return the number that the complete text is, in ASCII; None for anything else, and for None.

    So ``43,5``, ``43.5abc``, ``1_000``, ``0x10``, full-width digits, ``nan`` and ``1e400`` are no numbers.
    """
    try:
        value = float(text) if text and text.isascii() and "_" not in text else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


_ANGLE = re.compile(
    r"""\s*([NSEW]?)\s*([+-]?)(\d+(?:\.\d+)?)\s*[°º:d\s]\s*(?:(\d+(?:\.\d+)?)\s*(?:['′’:m\s]|$)\s*)?"""
    r"""(?:(\d+(?:\.\d+)?)\s*(?:["″”s]|''|$)?)?\s*([NSEW]?)\s*""",
    re.IGNORECASE,
)


def parse_angle(text: str) -> float | None:
    """Return the decimal degrees of degrees, minutes and seconds; None for anything else.

    ``43°31'30.5"N``, ``43:31:30.5``, ``W 5 26 24``: with a sign of degrees, colons, or a letter of the hemisphere.
    """
    match = _ANGLE.fullmatch(text.replace(",", "."))
    if match is None or not (match[1] or match[6] or any(sign in text for sign in "°º:")) or (match[1] and match[6]):
        return None
    degrees, minutes, seconds = (float(part or 0.0) for part in match.group(3, 4, 5))
    if minutes >= 60.0 or seconds >= 60.0:
        return None
    negative = match[2] == "-" or (match[1] or match[6]).upper() in ("S", "W")
    return (-1.0 if negative else 1.0) * (degrees + minutes / 60.0 + seconds / 3600.0)


def has_decimal_commas(line: str) -> bool:
    """Return whether a line, separated by blanks or commas, begins with two decimal-comma numbers (``43,5 7,1``)."""
    return _COMMAS.match(line) is not None
