"""Opens GDAL datasets without printed messages, whether GDAL exceptions are enabled or not.

Of GDAL's global state only the time limits for servers are set (`HTTP_PATIENCE`); GDAL itself would wait for ever.
Complete files are read and written in GDAL's virtual file systems: object stores (``/vsis3/…``), archives, servers,
memory. An object store stores a file on closing, completely or not at all; it has no folders, only names with slashes.

Checks that a file can be opened: it must be a regular file, and its name valid text.

A named pipe, socket or device that the user names, or that has the name of a side file of an image (``a_RPC.TXT``,
``a.tif.aux.xml``), would block GDAL and every other reader for ever. `require_plain` is called before a file is
opened, `require_plain_around` before GDAL opens a file and looks for its side files.
"""

import html
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, TypeVar

from osgeo import gdal

from ...foundation.errors import InputError, OutputError

Told = TypeVar("Told")
#: Time limits of servers in seconds: for the connection, and while they send fewer bytes per second than the limit; and
#: number and interval of retries if a server is busy (429, 500, 502, 503, 504). Values that the user has set as GDAL
#: options, in the environment or in a program, take precedence.
HTTP_PATIENCE = {
    "GDAL_HTTP_CONNECTTIMEOUT": "10",
    "GDAL_HTTP_LOW_SPEED_TIME": "15",
    "GDAL_HTTP_LOW_SPEED_LIMIT": "10",
    "GDAL_HTTP_MAX_RETRY": "3",
    "GDAL_HTTP_RETRY_DELAY": "1",
}


def set_http_patience() -> None:
    """Set the GDAL options of `HTTP_PATIENCE` that are not set yet.

    They apply to the complete process, because GDAL reads pixels in any thread. They are set when this module is
    imported, so that every process that reads files has them, including workers of a cluster.
    """
    for name, value in HTTP_PATIENCE.items():
        if gdal.GetConfigOption(name) is None:
            gdal.SetConfigOption(name, value)


set_http_patience()


def check_advice(path: str, otherwise: str = "check the path") -> str:
    """Return the advice on a file that cannot be opened; for a remote file, that its server may be slow."""
    servers = ("http://", "https://", "/vsis3", "/vsigs", "/vsiaz", "/vsioss", "/vsiswift")
    if not any(server in path for server in servers):
        return otherwise
    return (
        "check the address, and whether its server answers (the GDAL options GDAL_HTTP_CONNECTTIMEOUT and "
        "GDAL_HTTP_LOW_SPEED_TIME set the time limit)"
    )


class Messages(list[str]):
    """Failures that GDAL reported."""

    @property
    def reason(self) -> str:
        """The last one."""
        return self[-1] if self else "unknown reason"


@contextmanager
def gdal_messages() -> Iterator[Messages]:
    """Collect the failures that GDAL reports in the calling thread instead of printing them.

    RuntimeError (GDAL with exceptions enabled) and SystemError (GDAL 3.6 with a message that is not UTF-8) are added to
    the messages. The body may then be incomplete: preset its results.
    """
    messages = Messages()

    def collect(severity: int, _code: int, text: str) -> None:
        if severity >= gdal.CE_Failure:
            messages.append(" ".join(text.split()))

    gdal.PushErrorHandler(collect)
    try:
        yield messages
    except (RuntimeError, SystemError) as error:
        messages.append(" ".join(str(error).split()))
    finally:
        gdal.PopErrorHandler()


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress GDAL's messages, for example on damaged files; their text may have an unknown encoding."""
    gdal.PushErrorHandler("CPLQuietErrorHandler")
    try:
        yield
    finally:
        gdal.PopErrorHandler()


def call_quiet(function: Callable[..., Told], *words: Any) -> Told:
    """Call a function with GDAL's messages suppressed.

    PROJ needs this too: it reads grids with the TIFF library, whose messages GDAL prints through its handler.
    """
    with quiet():
        return function(*words)


@contextmanager
def config_option(name: str, value: str) -> Iterator[None]:
    """Set a GDAL configuration option in the calling thread, and restore it at the end."""
    previous = gdal.GetThreadLocalConfigOption(name)
    gdal.SetThreadLocalConfigOption(name, value)
    try:
        yield
    finally:
        gdal.SetThreadLocalConfigOption(name, previous)


def open_dataset(path: str) -> tuple[gdal.Dataset | None, str]:
    """Return a raster dataset opened for reading (None on failure), and GDAL's last message."""
    with quiet():
        gdal.ErrorReset()
        try:
            require_plain_around(path)
            dataset = gdal.OpenEx(path, gdal.OF_RASTER)
            return dataset, "" if dataset is not None else " ".join(gdal.GetLastErrorMsg().split())
        except (InputError, RuntimeError, SystemError, UnicodeError) as error:
            return None, " ".join(str(error).split())


def metadata_of(dataset: gdal.Dataset, domain: str = "") -> dict[str, str]:
    """Return a metadata domain as text; damaged text that is not UTF-8, for which GDAL returns bytes, as Latin-1."""
    with quiet():
        metadata = dataset.GetMetadata(domain)
    if not isinstance(metadata, dict):
        return {}
    entries = [
        [one.decode("latin-1") if isinstance(one, bytes) else one for one in entry] for entry in metadata.items()
    ]
    return {key: value for key, value in entries}


VIRTUAL = "/vsi"
HEAD_BYTES = 2**20  # enough to recognise the format of a file


def virtual_status(path: str) -> Any | None:
    """Return GDAL's status of a virtual path (``/vsizip/…``, ``/vsicurl/…``), None if it does not exist."""
    with quiet():
        try:
            return gdal.VSIStatL(path)
        except RuntimeError:  # GDAL with exceptions enabled
            return None


def read_virtual(path: str, limit: int | None = None) -> bytes | None:
    """Return the content of a file, or its first ``limit`` bytes; None if it cannot be read."""
    if limit is None:
        status = virtual_status(path)
        if status is None:
            return None
        limit = status.size
    with quiet():
        try:
            handle = gdal.VSIFOpenL(path, "rb")
        except RuntimeError:  # GDAL with exceptions enabled
            return None
        if handle is None:
            return None
        content = bytes(gdal.VSIFReadL(1, limit, handle) or b"")
        gdal.VSIFCloseL(handle)
    return content


def read_head(path: str, count: int = HEAD_BYTES) -> bytes:
    """Return the first bytes of a file; raise `InputError` if it cannot be read."""
    require_plain(path)
    if path.startswith(VIRTUAL):
        content = read_virtual(path, count)
        if content is None:
            raise InputError(f"{path}: cannot be read: {check_advice(path)}")
        return content
    try:
        with open(path, "rb") as file:
            return file.read(min(count, os.fstat(file.fileno()).st_size or count))  # allocate only what exists
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}): check the path and its permissions") from None


def write_virtual(path: str, blocks: Iterable[bytes]) -> None:
    """Write a file from blocks of bytes; raise `OutputError` if that fails."""
    is_complete = False
    with gdal_messages() as messages:
        handle = gdal.VSIFOpenL(path, "wb")
        if handle is not None:
            is_complete = all(gdal.VSIFWriteL(block, 1, len(block), handle) == len(block) for block in blocks)
            is_complete &= gdal.VSIFCloseL(handle) == 0
    if not is_complete:
        reason = messages[-1] if messages else "it takes no new files"
        raise OutputError(f"{path}: cannot be written ({reason}): choose another `output_dir`")


def list_virtual(folder: str) -> list[str]:
    """Return the present names in a folder, without GDAL's cache; an empty list if there is no folder."""
    names: list[str] = []
    with gdal_messages():
        gdal.VSICurlPartialClearCache(folder)
        names = gdal.ReadDir(folder) or []
    return [name for name in names if name not in (".", "..")]


def remove_virtual(folder: str) -> None:
    """Remove a folder and its content; files that cannot be removed remain."""
    with gdal_messages():
        gdal.RmdirRecursive(folder)


_SOURCE = re.compile(rb"<Source(?:Filename|Dataset)[^>]*>([^<]+)<")
MOST_OF_VRT = 2**25  # bytes of a VRT that are searched: enough for a mosaic of 100 000 tiles
DEEPEST_VRT = 4  # levels of nested VRTs
_KINDS = (
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def require_plain(path: str) -> None:
    """Raise `InputError` for a pipe, socket or device, and for a name that is not UTF-8; a missing file is accepted.

    For a path into an archive, the archive is checked.
    """
    try:
        path.encode()
    except UnicodeEncodeError:
        printable = path.encode("utf-8", "backslashreplace").decode()
        raise InputError(f"{printable}: its name is no UTF-8, which GDAL and all results need: rename it") from None
    if "\0" in path:
        raise InputError(f"{path!r}: no file has such a name: correct it")
    way = next((way for way in ("/vsizip/", "/vsitar/", "/vsigzip/") if path.startswith(way)), "")
    place = path.removeprefix(way)
    while way and len(place) > 1 and not os.path.exists(place):
        place = os.path.dirname(place)
    kind = "" if place.startswith("/vsi") else _special_kind(place)
    of_the_shell = place.startswith(("/dev/fd/", "/dev/stdin", "/proc/self/fd/"))  # `<(…)` of a shell: its writer ends
    if kind and not (kind == "a named pipe" and of_the_shell):
        raise InputError(f"{path}: is {kind}, which may never end: name a file, or remove it")


def require_plain_around(path: str) -> None:
    """Raise `InputError` if a file, or a file in its folder that GDAL may open with it, is a pipe, socket or device."""
    require_plain(path)
    folder, name = os.path.split(path)
    if name.lower().endswith(".vrt") and os.path.isfile(path):
        _require_plain_sources(path, folder, 0)
    try:
        changed = os.stat(folder or ".").st_mtime_ns
        names = () if path.startswith("/vsi") else _special_names(folder or ".", changed)
    except OSError:  # not a folder on disk
        return
    stem = os.path.splitext(name)[0].lower()
    for neighbour in names:
        # GDAL looks for files with these endings under names that differ from the image's
        if stem in neighbour.lower() or neighbour.lower().endswith((".xml", ".dim", ".imd")):
            require_plain(os.path.join(folder, neighbour))


def _require_plain_sources(path: str, folder: str, depth: int) -> None:
    """Raise `InputError` if a VRT, or a VRT among its sources, has a pipe, socket or device as a source."""
    with open(path, "rb") as file:
        sources = _SOURCE.findall(file.read(MOST_OF_VRT))
    for source in {html.unescape(source.decode(errors="replace")).strip() for source in sources}:
        for place in {source, os.path.join(folder, source)}:  # relative to the working folder, or to the VRT's
            require_plain(place)
            if place.lower().endswith(".vrt") and os.path.isfile(place) and depth < DEEPEST_VRT:
                _require_plain_sources(place, os.path.dirname(place), depth + 1)


def _special_kind(path: str) -> str:
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):  # broken links: opening them fails at once
        return ""
    return next((word for is_kind, word in _KINDS if is_kind(mode)), "")


@lru_cache(maxsize=64)
def _special_names(folder: str, _changed_ns: int) -> tuple[str, ...]:
    """Return the names in a folder that are no regular files; cached for all images in the folder."""
    with os.scandir(folder) as entries:
        others = [
            one for one in entries if not (one.is_file(follow_symlinks=False) or one.is_dir(follow_symlinks=False))
        ]
    return tuple(one.name for one in others if _special_kind(one.path))
