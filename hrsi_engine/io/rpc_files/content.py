"""XML of small side files, and the files of a folder; every fault is an `InputError` with the file."""

import os
import time
from collections.abc import Sequence
from functools import lru_cache

# Bandit warns of this package because its parsers expand entities. None of them is used: `read_xml` parses with expat,
# which refuses document types and therefore entities; these three only store and write a tree.
from xml.etree.ElementTree import Element, TreeBuilder, tostring  # nosec B405
from xml.parsers import expat

from osgeo import gdal

from ...foundation.errors import InputError
from ..opening.datasets import call_quiet
from ..opening.files import read_bytes

SETTLED_NS = 2_000_000_000  # a folder is cached if it is unchanged for longer than the resolution of file times


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


def element_text(root: Element, name: str) -> str | None:
    """Return the text of the first element with this name anywhere below ``root``."""
    element = next(root.iter(name), None)
    return None if element is None else (element.text or "")


def texts_below(root: Element) -> dict[str, str]:
    """Return name -> text of the first element with this name, for all elements below ``root``."""
    return {element.tag: element.text or "" for element in reversed([*root.iter()])}


def positive_size(samples: str | None, lines: str | None) -> tuple[int, int] | None:
    """Return an image size given as text, None unless both are whole numbers above zero."""
    try:
        size = int(samples or ""), int(lines or "")
    except ValueError:
        return None
    return size if min(size) > 0 and max(size) < 2**31 else None


def siblings(path: str) -> dict[str, str]:
    """Return the files in the folder of ``path``: name in lower case -> full path.

    Case may matter in a file system, and vendors write ``_RPC.TXT`` and ``_rpc.txt``. Of names that differ in case
    only, the first in sorted order (capitals) is used.
    """
    folder = os.path.dirname(path)
    if folder.startswith("/vsi"):
        return _by_lower_case(folder, call_quiet(gdal.ReadDir, folder) or [])
    try:
        status = os.stat(folder or ".")
        settled = time.time_ns() - status.st_mtime_ns > SETTLED_NS
        list_files = _list_folder if settled else _list_folder.__wrapped__
        return list_files(folder, (status.st_dev, status.st_ino, status.st_mtime_ns))
    except OSError:
        return {}


@lru_cache(maxsize=8)
def _list_folder(folder: str, _identity: tuple[int, int, int]) -> dict[str, str]:
    return _by_lower_case(folder, os.listdir(folder or "."))


def _by_lower_case(folder: str, names: Sequence[str]) -> dict[str, str]:
    return {name.lower(): os.path.join(folder, name) for name in sorted(names, reverse=True)}
