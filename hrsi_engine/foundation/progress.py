"""Progress in GDAL's manner: ``progress(fraction, message) -> bool``; False asks to stop."""

from __future__ import annotations

from collections.abc import Callable

from .errors import Cancelled

Progress = Callable[[float, str], bool]


def silent(fraction: float, message: str = "") -> bool:
    """Say nothing and never cancel."""
    return True


def advance(progress: Progress, fraction: float, message: str = "") -> None:
    """Report progress; raise `Cancelled` when the callback answers False."""
    if progress(fraction, message) is False:
        raise Cancelled("cancelled; nothing was written")


def stage(progress: Progress, start: float, end: float) -> Progress:
    """Return a callback whose 0..1 is the part ``start``..``end`` of ``progress``."""

    def scaled(fraction: float, message: str = "") -> bool:
        return progress(start + (end - start) * fraction, message)

    return scaled
