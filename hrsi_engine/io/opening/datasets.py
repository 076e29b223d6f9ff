"""Opening GDAL datasets quietly, with or without GDAL exceptions enabled.

Of GDAL's global state nothing is touched but what it would do without an end: wait for a server (`HTTP_PATIENCE`).
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from osgeo import gdal

from ...foundation.errors import InputError
from .plain_files import require_plain_around

Told = TypeVar("Told")
#: How long servers are waited for, in seconds: until they take a connection, and while they send less than some bytes a
#: second; and how often what a busy one refuses (429, 500, 502, 503, 504) is asked for again,
#: after how many. Whoever sets these options of GDAL, in the environment or by the program, has his own.
HTTP_PATIENCE = {
    "GDAL_HTTP_CONNECTTIMEOUT": "10", "GDAL_HTTP_LOW_SPEED_TIME": "15", "GDAL_HTTP_LOW_SPEED_LIMIT": "10",
    "GDAL_HTTP_MAX_RETRY": "3", "GDAL_HTTP_RETRY_DELAY": "1",
}  # fmt: skip


_SERVERS = ("http://", "https://", "/vsis3", "/vsigs", "/vsiaz", "/vsioss", "/vsiswift")


def set_http_patience() -> None:
    """Give GDAL the options of `HTTP_PATIENCE` that nobody has set.

    They count in the whole process, because GDAL fetches pixels in whatever thread reads them; this module does it when
    it is imported, so that every process has them that reads anything, workers of a cluster too.
    """
    for name, value in HTTP_PATIENCE.items():
        if gdal.GetConfigOption(name) is None:
            gdal.SetConfigOption(name, value)


set_http_patience()


def check_advice(path: str, otherwise: str = "check the path") -> str:
    """Return the advice on a file that cannot be opened; for a remote file, that its server may be slow."""
    if not any(server in path for server in _SERVERS):
        return otherwise
    return (
        "check the address, and whether its server answers (GDAL's options GDAL_HTTP_CONNECTTIMEOUT and "
        "GDAL_HTTP_LOW_SPEED_TIME say how long it is waited for)"
    )


@contextmanager
def gdal_messages() -> Iterator[list[str]]:
    """Collect the failures that GDAL reports in the calling thread instead of printing them.

    RuntimeError (GDAL with exceptions enabled) and SystemError (GDAL 3.6 given a message that is not UTF-8) are
    taken as such a failure: results must be preset.
    """
    messages: list[str] = []

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
    """Suppress GDAL's messages, as on damaged files, whose text may be in no known encoding."""
    gdal.PushErrorHandler("CPLQuietErrorHandler")
    try:
        yield
    finally:
        gdal.PopErrorHandler()


def call_quiet(function: Callable[..., Told], *words: Any) -> Told:
    """Call a function with GDAL's messages suppressed.

    PROJ reads grids through the TIFF library that GDAL has report to its own handler.
    """
    with quiet():
        return function(*words)


@contextmanager
def config_option(name: str, value: str) -> Iterator[None]:
    """Set one of GDAL's configuration options in the calling thread for a while."""
    before = gdal.GetThreadLocalConfigOption(name)
    gdal.SetThreadLocalConfigOption(name, value)
    try:
        yield
    finally:
        gdal.SetThreadLocalConfigOption(name, before)


def open_dataset(path: str, flags: int = 0) -> tuple[gdal.Dataset | None, str]:
    """Return a raster dataset opened for reading (or with ``flags``) and GDAL's last message; None where it fails."""
    with quiet():
        gdal.ErrorReset()
        try:
            require_plain_around(path)
            dataset = gdal.OpenEx(path, gdal.OF_RASTER | flags)
            return dataset, "" if dataset is not None else " ".join(gdal.GetLastErrorMsg().split())
        except (InputError, RuntimeError, SystemError, UnicodeError) as error:
            return None, " ".join(str(error).split())


def metadata_of(dataset: gdal.Dataset, domain: str = "") -> dict[str, str]:
    """Return a metadata domain as text, quietly; GDAL gives bytes where damaged text is not UTF-8."""
    with quiet():
        metadata = dataset.GetMetadata(domain)
    return {_decode(key): _decode(value) for key, value in metadata.items()} if isinstance(metadata, dict) else {}


def _decode(value: str | bytes) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else value
